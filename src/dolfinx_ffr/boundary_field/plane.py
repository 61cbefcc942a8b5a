# SPDX-License-Identifier: MIT
"""The boundary of a part in the plane, as steps move it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import shapely

from ..arrays import Array
from ..fem import Domain
from ..part import TURN, Part
from ..reduction import Struts
from .displacements import translated
from .field import BoundaryField, FieldSpace
from .fitted import FittedNodes
from .moving import Change, MovingBoundary
from .operations import best_hole, best_member, cut, most_idle, small_voids, united
from .options import FieldOptions
from .projection import SmoothMotion
from .sizes import SizeRows
from .smoothing import at_bounds, free_variables, is_uneven, mended, metric, redistanced

Promising = Callable[["PlaneBoundary", Struts], shapely.Geometry | None]
Operation = Callable[["PlaneBoundary", shapely.Geometry], "PlaneBoundary"]


def _change(promising: Promising, operation: Operation, *, simplifies: bool) -> Change:
    """The change by an operation with the most promising shape."""

    def candidates(boundary: PlaneBoundary, struts: Struts) -> Iterator[PlaneBoundary]:
        shape = promising(boundary, struts)
        if shape is not None:
            yield operation(boundary, shape)

    return Change(candidates, simplifies)


class PlaneBoundary(BoundaryField, MovingBoundary):
    """The boundary of a part in the plane: the zero of a spline field, on triangles."""

    changes = (
        _change(best_member, united, simplifies=False),
        _change(best_hole, cut, simplifies=False),
        _change(most_idle, cut, simplifies=True),
        _change(lambda boundary, _: small_voids(boundary), united, simplifies=True),
    )
    finer_meshes, still = 1, math.inf

    @classmethod
    def of_material(cls, space: FieldSpace, material: shapely.Geometry) -> PlaneBoundary:
        """That of a ``material`` [m], where it is not that of what stays."""
        return cls(space, space.of_material(material).variables)

    @property
    def options(self) -> FieldOptions:
        return self.space.options

    @property
    def member(self) -> float:
        return self.space.member

    @property
    def gap(self) -> float:
        return self.space.gap

    @property
    def rim(self) -> float:
        return self.space.rims.width

    @property
    def n_motions(self) -> int:
        return len(self.variables)

    @property
    def drawn(self) -> Part:
        return self.part

    @property
    def n_holes(self) -> int:
        return self.part.holes

    def mesh(self, turn: float, *, fine: bool) -> Domain:
        options, part = self.options, self.part
        # the meshes of steps in which no stress counts are coarser by a third
        coarser = 1.3
        if turn == math.inf:
            enough = math.sqrt(4.0 / math.sqrt(3.0) * part.area / options.triangles)
            size = min(coarser * options.triangle * self.member, enough)
            domain = part.domain(size, across=options.triangle_across, turn=turn)
        else:
            least = coarser**2 * options.triangles
            enough = math.sqrt(4.0 / math.sqrt(3.0) * part.area / least)
            size = min(options.triangle * self.member, enough)
            if fine and turn < TURN:
                size *= 0.5
            domain = part.domain(size, across=options.triangle_across / coarser, turn=turn)
        domain.whole = self.body
        return domain

    def node_motion(self, domain: Domain) -> FittedNodes:
        return FittedNodes(self, domain)

    @property
    def sizes(self) -> SizeRows:
        return SizeRows.of(self)

    def smooth_motion(self, slope: Array) -> SmoothMotion:
        # variables at their bounds that would leave these stay
        free = free_variables(self) & ~(at_bounds(self) & (slope < 0.0))
        return SmoothMotion(metric(self), free)

    def moved(self, motion: Array, smooth: SmoothMotion) -> PlaneBoundary:
        field = self.with_variables(self.variables + motion)
        field = redistanced(field) if is_uneven(field) else field
        return mended(field, self.options.longest_reach * self.member, smooth)

    def motion_to(self, after: PlaneBoundary) -> Array:
        return after.variables - self.variables

    def translated(self, slope: Array) -> PlaneBoundary:
        return translated(self, slope)
