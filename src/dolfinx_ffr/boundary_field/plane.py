# SPDX-License-Identifier: MIT
"""The boundary of a part in the plane, as steps move it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import shapely

from ..arrays import Array
from ..design import Mirror
from ..fem import Domain
from ..part import TURN, Part
from ..reduction import Struts
from .displacements import translated
from .field import BoundaryField, FieldSpace
from .fitted import FittedNodes
from .moving import Change, MovingBoundary
from .operations import best_hole, cut, missing_members, most_idle, small_voids, united
from .options import FieldOptions
from .projection import SmoothMotion
from .sizes import SizeRows
from .smoothing import at_bounds, free_variables, is_uneven, mended, metric, redistanced
from .start import check_start, field_with_sizes, space_of

#: Share by which a size of a result may be missed before that is warned of
_MISSED = 0.01

Promising = Callable[["PlaneBoundary", Struts], Iterator[shapely.Geometry]]
Operation = Callable[["PlaneBoundary", shapely.Geometry], "PlaneBoundary"]


def _change(promising: Promising, operation: Operation, *, simplifies: bool) -> Change:
    """The change by an operation with promising shapes."""

    def candidates(boundary: PlaneBoundary, struts: Struts) -> Iterator[PlaneBoundary]:
        for shape in promising(boundary, struts):
            yield operation(boundary, shape)

    return Change(candidates, simplifies)


def _one(
    promising: Callable[[PlaneBoundary, Struts], shapely.Geometry | None],
) -> Promising:
    """The most promising shape alone, where there is one."""

    def shapes(boundary: PlaneBoundary, struts: Struts) -> Iterator[shapely.Geometry]:
        shape = promising(boundary, struts)
        if shape is not None:
            yield shape

    return shapes


class PlaneBoundary(BoundaryField, MovingBoundary):
    """The boundary of a part in the plane: the zero of a spline field, on triangles."""

    changes = (
        _change(missing_members, united, simplifies=False),
        _change(_one(best_hole), cut, simplifies=False),
        _change(_one(most_idle), cut, simplifies=True),
        _change(_one(lambda boundary, _: small_voids(boundary)), united, simplifies=True),
    )
    finer_meshes, still = 1, math.inf

    @staticmethod
    def of(
        part: Part,
        member: float,
        *,
        gap: float | None = None,
        rim: float | None = None,
        radius: float | None = None,
        outline: bool = True,
        mirrors: Sequence[Mirror] = (),
        volume: float = 1.0,
        options: FieldOptions = FieldOptions(),  # noqa: B008
    ) -> PlaneBoundary:
        """The boundary of a part, as near as minimum sizes allow.

        What of the part is thinner than these is widened, and what splines cannot show is left out.

        Args:
            part: From a level set or densities, in one piece, or in pieces that a web joins.
            member: Minimum member [m].
            gap: Minimum gap [m]; by default as the member.
            rim: Width of the rim of material around each hole of the body's drawing [m]; by default
                as the member. With 0 such holes may grow and join others, but are never filled.
            radius: Smallest radius of curvature [m]; by default half a minimum gap.
            outline: Whether sides on the outer edge of the body may move, too.
            mirrors: Lines about which the part is its own mirror image, and stays it exactly.
            volume: Largest filled share of the body. It is kept where sizes are mended; steps keep
                that of `move_boundary`.
            options: Numbers of the method.

        Raises:
            ValueError: If a number is out of range, the part is in pieces or has lost an interface,
                nothing of its boundary can move, it is not its own mirror image, a minimum member
                does not fit into the body, or the part falls apart as its sizes are mended.

        Warns:
            PartWarning: Of holes of the design that are left out, as they are too small. Holes of
                the body's drawing never are.
        """
        sizes = {"member": member, "gap": gap, "rim": rim, "radius": radius, "volume": volume}
        space = space_of(part, sizes, outline, mirrors, options)
        boundary = first_field(space, part.polygon)
        check_start(boundary, part)
        return boundary

    @classmethod
    def of_material(cls, space: FieldSpace, material: shapely.Geometry) -> PlaneBoundary:
        """That of a ``material`` [m], where it is not that of what stays."""
        return cls(space, space.of_material(material).variables)

    def with_volume(self, volume: float) -> PlaneBoundary:
        """The same whose ``volume``, a share of the body, is kept where sizes are mended."""
        full = (volume - self.space.web) / (1.0 - self.space.web)
        if full == self.space.volume:
            return self
        space = replace(self.space, volume=full)
        # all else that is known of the space stays
        known = {name: value for name, value in vars(self.space).items() if name != "volume"}
        space.__dict__.update(known)
        return replace(self, space=space)

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

    def mesh(self, turn: float, *, fine: bool, size: float | None = None) -> Domain:
        options, part = self.options, self.part
        # pockets are meshed, too
        area = part.area + part.pocket_area
        # the meshes of steps in which no stress counts are coarser by a third
        coarser = 1.3
        if turn == math.inf:
            enough = math.sqrt(4.0 / math.sqrt(3.0) * area / options.triangles)
            size = size or min(coarser * options.triangle * self.member, enough)
            domain = part.domain(size, across=options.triangle_across, turn=turn)
        else:
            least = coarser**2 * options.triangles
            enough = math.sqrt(4.0 / math.sqrt(3.0) * area / least)
            size = size or min(options.triangle * self.member, enough)
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

    def remarks(self) -> list[str]:
        missed = self.sizes.violation
        if missed <= _MISSED:
            return []
        return [
            f"a member, gap or radius is {missed:.1%} below its minimum: take more iterations, "
            "another start or other bounds"
        ]


def first_field(space: FieldSpace, material: shapely.Geometry) -> PlaneBoundary:
    """The boundary whose zero is the free boundary of a ``material``, as near as sizes allow."""
    return PlaneBoundary(space, field_with_sizes(space, material).variables)
