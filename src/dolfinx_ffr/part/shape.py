# SPDX-License-Identifier: MIT
"""What a design encloses, and a flat shape between closed curves: what it measures."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray

from .. import validation
from ..fem import Curve, Domain, Drawing, ElasticMaterial, enclosed, polygon
from ..problem import Problem
from .widths import Width, narrowest_gap, thinnest_member

__all__ = ["Enclosed", "LoosePiece", "PartWarning", "Shape"]

Array = NDArray[np.float64]

#: Size of the first triangles of order 2, in spacings
_FIRST = 2.0


class PartWarning(UserWarning):
    """What is drawn as a part is not all of the design, or not held as it should be."""


@dataclass(frozen=True, eq=False)
class LoosePiece:
    """A piece of a design that nothing holds, and that is left out of the part."""

    area: float  #: [m^2]
    center: Array  #: (2,) of its area [m]
    outline: list[list[Curve]]  #: Its outer loop, counterclockwise, then its holes, clockwise


class Enclosed(ABC):
    """What a design encloses, a part in the plane or a solid in space, to be evaluated again."""

    elements: ClassVar[str]  #: What its meshes are made of
    #: Largest change of psi from one of its meshes to the next that counts as none, by default
    tolerance: ClassVar[float]
    most: ClassVar[int]  #: Number of meshes that are tried by default
    body: Domain  #: The body that was designed

    @property
    @abstractmethod
    def pieces(self) -> int:
        """Number of connected pieces of material."""

    @property
    @abstractmethod
    def lost_interfaces(self) -> list[str]:
        """Interfaces that are left without material."""

    @abstractmethod
    def sizes(self, size: float | None, count: int) -> list[float]:
        """Sizes of the meshes on which it is evaluated, each finer than the last [m].

        Args:
            size: Of the first one [m], or None for a size that suits it.
            count: How many.
        """

    @abstractmethod
    def domain(self, size: float, order: int = 2) -> Domain:
        """A mesh that fits it; collective.

        Args:
            size: Of its cells [m].
            order: Polynomial order of the displacements.
        """

    def measures(self) -> dict[str, Width | int | None]:
        """What summaries tell of it beside its pieces: its holes, its thinnest member."""
        return {}

    def _only_body(self, problem: Problem) -> str:
        """The name of the only designed body of a problem."""
        names = list(problem.flexible)
        if len(names) != 1:
            kind = type(self).__name__.lower()
            raise ValueError(
                f"{kind}: the problem designs the bodies {sorted(names)}; verify them together by "
                f"verify(problem, {{name: {kind}, ...}}, evaluation)"
            )
        return names[0]


class Shape(Enclosed):
    """Pieces of material of one thickness between closed curves."""

    elements = "triangles"
    tolerance = 2e-3
    most = 5
    spacing: float  #: Length on which the field varies [m]
    material: ElasticMaterial | None  #: Of the part
    accuracy: float  #: Of the polygons that stand for the curves [m]
    drawing: Drawing  #: Curves, and the faces between them in designed and solid cells
    #: For each piece the outer loop of curves, counterclockwise, then its holes, clockwise
    outlines: list[list[list[Curve]]]
    _groups: dict[int, str]  #: Interface of each curve of the outlines by its identity

    @property
    def pieces(self) -> int:
        """Number of connected pieces of material."""
        return len(self.outlines)

    @property
    def holes(self) -> int:
        """Number of holes in all pieces."""
        return sum(len(loops) - 1 for loops in self.outlines)

    def interface(self, name: str) -> list[Curve]:
        """The curves that are an interface.

        Args:
            name: Of the interface.

        Raises:
            ValueError: If the body has no such interface.
        """
        validation.choice("part: interface", name, self.body.interfaces)
        drawn = self.drawing
        return [c for c, group in zip(drawn.curves, drawn.groups, strict=True) if group == name]

    def group(self, curve: Curve) -> str:
        """The interface that a curve of `outlines` belongs to, "" if it is none.

        Args:
            curve: One of `outlines`.
        """
        return self._groups[id(curve)]

    def sizes(self, size: float | None, count: int) -> list[float]:
        first = _FIRST * self.spacing if size is None else size
        return [first / 2**halving for halving in range(count)]

    # ------------------------------------------------------------------ what it measures

    def measures(self) -> dict[str, Width | int | None]:
        return {
            "holes": self.holes,
            "thinnest member": self.thinnest_member,
            "narrowest gap": self.narrowest_gap,
        }

    @cached_property
    def _moments(self) -> Array:
        return np.sum([enclosed(loop) for loops in self.outlines for loop in loops], axis=0)

    @property
    def area(self) -> float:
        """Area between the curves [m^2], exact for them."""
        return float(self._moments[0])

    @property
    def center(self) -> Array:
        """Centre of the area, shape (2,) [m]."""
        return np.asarray(self._moments[1:] / self._moments[0])

    @property
    def thickness(self) -> float:
        """Extent perpendicular to the plane [m].

        Raises:
            ValueError: If the part was made without a material.
        """
        return float(self._made_of("its thickness").thickness)

    @property
    def mass(self) -> float:
        """Mass [kg].

        Raises:
            ValueError: If the part was made without a material that has a density [kg/m^3].
        """
        material = self._made_of("its mass")
        density = getattr(material, "density", None)
        if density is None:
            raise ValueError("part: its material has no attribute density [kg/m^3]")
        return self.area * material.thickness * float(density)

    def _made_of(self, what: str) -> ElasticMaterial:
        if self.material is None:
            raise ValueError(
                f"part: {what} is that of a material; make it with Part(..., material=)"
            )
        return self.material

    @cached_property
    def polygon(self) -> shapely.MultiPolygon:
        """Polygons within `accuracy` of the curves, one a piece."""
        rings = [[polygon(loop, self.accuracy) for loop in loops] for loops in self.outlines]
        return shapely.MultiPolygon([shapely.Polygon(first, rest) for first, *rest in rings])

    @cached_property
    def thinnest_member(self) -> Width | None:
        """The thinnest member, by discs that do not fit; None if it is as wide as the part."""
        return thinnest_member(self.polygon, 10.0 * self.accuracy, self._widest)

    @cached_property
    def narrowest_gap(self) -> Width | None:
        """The narrowest gap or hole; None if there is none narrower than the part."""
        return narrowest_gap(self.polygon, 10.0 * self.accuracy, self._widest)

    @property
    def _widest(self) -> float:
        low, high = np.reshape(self.polygon.bounds, (2, 2))
        return float(np.min(high - low))
