# SPDX-License-Identifier: MIT
"""Joints that exist in space only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .joints import Joint, _Between
from .marker import Marker, Triple, axis_vector
from .rows import Row, Undeformed
from .spatial_parts import coincidence, on_line, on_plane, parallel, perpendicular_to
from .spatial_rows import SpatialRow, UndeformedInSpace, direction
from .symbols import Pin, Slider, Symbol

__all__ = ["Cylindrical", "Planar", "PointOnPlane", "Spherical", "Universal"]

#: Sine of the angle of two axes below which they count as parallel.
_PARALLEL = 1e-6


@dataclass(frozen=True)
class _InSpace(Joint):
    """A joint that has no counterpart in the plane."""

    dimension: ClassVar[int | None] = 3
    #: What takes its place there.
    in_plane: ClassVar[str] = ""

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        raise ValueError(
            f"joint {label!r}: {type(self).__name__} is a joint in space, but the bodies are in "
            f"the plane{self.in_plane}"
        )


@dataclass(frozen=True)
class Spherical(_Between, _InSpace):
    """Two markers coincide: r_a - r_b = 0, three rows."""

    #: Name for results and messages.
    name: str = ""

    in_plane: ClassVar[str] = "; there it is a Revolute"

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        return coincidence(self.a, self.b)


@dataclass(frozen=True)
class Universal(_Between, _InSpace):
    """A universal joint, or Hooke's: two markers coincide, and two axes stay perpendicular.

    Four rows. Each axis is that of a fork: fixed to one of the bodies, while the other body turns
    about it.
    """

    #: Axis of the first marker's fork, in its axes and of any length.
    axis: Triple = (0.0, 1.0, 0.0)
    #: Axis of the second marker's fork, in its axes and of any length.
    second_axis: Triple = (0.0, 0.0, 1.0)
    #: Name for results and messages.
    name: str = ""

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        here = undeformed.axes(self.a) @ np.asarray(self.axis)
        there = undeformed.axes(self.b) @ np.asarray(self.second_axis)
        size = np.linalg.norm(here) * np.linalg.norm(there)
        if float(np.linalg.norm(np.cross(here, there))) < _PARALLEL * size:
            raise ValueError(
                f"joint {label!r}: the two axes of the universal joint are parallel in the "
                "placements; they must be perpendicular"
            )
        forks = perpendicular_to(direction(self.a, self.axis), direction(self.b, self.second_axis))
        return [*coincidence(self.a, self.b), forks]

    def _check(self, what: str) -> None:
        axis_vector(f"{what}: the axis", self.axis)
        axis_vector(f"{what}: the second axis", self.second_axis)


@dataclass(frozen=True)
class Cylindrical(_Between, _InSpace):
    """A marker slides along an axis through another and turns about it: four rows.

    The axis stays that of the placements on the first body, too.
    """

    #: Axis, in the axes of the second marker and of any length.
    axis: Triple = (0.0, 0.0, 1.0)
    #: Name for results and messages.
    name: str = ""

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        turned = parallel(self.a, self.b, self.axis, undeformed)
        return [*on_line(self.a, self.b, self.axis), *turned]

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return (Slider(self.markers),)

    def _check(self, what: str) -> None:
        axis_vector(f"{what}: the axis", self.axis)


@dataclass(frozen=True)
class Planar(_Between, _InSpace):
    """A marker moves in a plane through another and turns about its normal: three rows.

    The normal stays that of the placements on the first body, too.
    """

    #: Normal of the plane, in the axes of the second marker and of any length.
    normal: Triple = (0.0, 0.0, 1.0)
    #: Name for results and messages.
    name: str = ""

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        turned = parallel(self.a, self.b, self.normal, undeformed)
        return [on_plane(self.a, self.b, self.normal), *turned]

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return (Pin(self.markers),)

    def _check(self, what: str) -> None:
        axis_vector(f"{what}: the normal", self.normal)


@dataclass(frozen=True)
class PointOnPlane(_InSpace):
    """A point stays on a plane through another marker: one row.

    The plane is fixed to the axes of its marker and turns with them.
    """

    #: Marker of the point.
    point: Marker
    #: Marker through which the plane passes.
    plane: Marker
    #: Normal of the plane, in the axes of its marker and of any length.
    normal: Triple = (0.0, 0.0, 1.0)
    #: Name for results and messages.
    name: str = ""

    in_plane: ClassVar[str] = "; there it is a PointOnLine"

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return self.point, self.plane

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        return [on_plane(self.point, self.plane, self.normal)]

    def _check(self, what: str) -> None:
        axis_vector(f"{what}: the normal", self.normal)
