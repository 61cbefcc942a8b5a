# SPDX-License-Identifier: MIT
"""Meshes, constraints and topology changes of boundaries in the plane and of surfaces in space."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, ClassVar, Generic, TypeVar

from mpi4py import MPI

import numpy as np
import shapely

from ..arrays import Array
from ..fem import CurveError, Domain, ShapeError
from ..part import Solid
from ..reduction import Struts
from .derivative import CurveMotion, NodeMotion
from .holes import HolePair, joined, struts_between_holes, with_strut
from .options import CURVES, PLANE_STEPS, SPACE_STEPS, StepOptions
from .outline import Boundary
from .sizes import Rows, control_position_rows, radius_rows, size_rows
from .spread import spread
from .step import best_step
from .struts import missing_strut
from .surface import Surface, SurfaceMotion

B = TypeVar("B", Boundary, Surface)
#: Share of psi that the strut between two curves carries
StrutShares = dict[HolePair, float]


class BoundaryGeometry(ABC, Generic[B]):
    """Meshes, constraints and topology changes of boundaries of one dimension."""

    boundary_type: ClassVar[type]
    type_name: ClassVar[str]  #: What users are asked for
    steps: ClassVar[StepOptions]
    finer_meshes: ClassVar[int]  #: Most finer meshes on which the result is evaluated
    mesh_tolerance: ClassVar[float]  #: Change of psi from one of them to the next that ends them

    @abstractmethod
    def mesh(self, boundary: B, size: float, turn: float) -> Domain:
        """A mesh of cells of a ``size`` [m], and of ``turn`` radii in notches, that fits."""

    @abstractmethod
    def motion(self, boundary: B, domain: Domain) -> NodeMotion[Any]:
        """The motion of the nodes of that mesh with the boundary."""

    def agreed(self, boundary: B, comm: MPI.Comm) -> B:
        """The boundary of rank 0, from which others may differ by round-off."""
        return boundary

    @abstractmethod
    def sizes(self, boundary: B) -> Rows:
        """Constraints on members and gaps."""

    def radii(self, boundary: B) -> Rows:
        """Constraints on radii of curvature."""
        return Rows.none(boundary.n_offsets)

    def position_rows(self, boundary: B, reach: float) -> Rows:
        """Constraints on the positions of controls after a step of at most ``reach`` [m]."""
        return Rows.none(boundary.n_offsets)

    @abstractmethod
    def cell_size(self, boundary: B, user_size: float | None) -> float:
        """The size of cells [m] of a user, by default one fine enough for psi and members."""

    def with_minimum_sizes(self, boundary: B, tolerance: float) -> B:
        """The boundary with the sizes enlarged that a step has left too small.

        Sizes may remain below their minimum by a share, the ``tolerance``.
        """
        return boundary

    @abstractmethod
    def offsets_between(self, before: B, after: B) -> Array:
        """Offsets from one boundary to another one, (offsets,) [m]."""

    def finer(self, boundary: B) -> B:
        """The boundary for the finer mesh of a result; a ShapeError if that is too fine."""
        return boundary

    def with_drawn_sizes(self, boundary: B) -> B:
        """The boundary whose drawing, too, has the minimum sizes, for a result."""
        return boundary

    def strut_shares(self, boundary: B, struts: Struts) -> StrutShares:
        """Share of psi that each strut carries, by the pair of curves beside it."""
        return {}

    def without_idle_struts(self, boundary: B, shares: StrutShares) -> Iterator[tuple[B, int]]:
        """Boundaries without one idle strut each, and the numbers of removed struts."""
        return iter(())

    def with_insertions(self, boundary: B, struts: Struts) -> Iterator[tuple[B, int]]:
        """Boundaries with promising struts or windows inserted, and the numbers of those."""
        return iter(())

    def remarks(self, boundary: B) -> list[str]:
        """Sentences for warnings of the part of a result."""
        return []


class PlaneGeometry(BoundaryGeometry[Boundary]):
    """Curves in the plane, on meshes of triangles."""

    boundary_type, type_name = Boundary, "a Boundary"
    steps = PLANE_STEPS
    finer_meshes, mesh_tolerance = 1, math.inf

    def mesh(self, boundary: Boundary, size: float, turn: float) -> Domain:
        if not boundary.valid:
            raise CurveError("boundary: curves cross, or leave the body")
        across = CURVES.triangle_across
        if turn == math.inf:
            across *= CURVES.coarser
            size = max(size, min(CURVES.coarser * size, _size_of_enough(boundary)))
        return boundary.part.domain(size, across=across, turn=turn)

    def agreed(self, boundary: Boundary, comm: MPI.Comm) -> Boundary:
        return boundary.restored(comm.bcast(boundary.state())) if comm.size > 1 else boundary

    def motion(self, boundary: Boundary, domain: Domain) -> CurveMotion:
        return CurveMotion(boundary, domain)

    def sizes(self, boundary: Boundary) -> Rows:
        return size_rows(boundary)

    def radii(self, boundary: Boundary) -> Rows:
        return radius_rows(boundary)

    def position_rows(self, boundary: Boundary, reach: float) -> Rows:
        return control_position_rows(boundary, reach)

    def cell_size(self, boundary: Boundary, user_size: float | None) -> float:
        if user_size is not None:
            return user_size
        return min(CURVES.triangle * boundary.member, _size_of_enough(boundary))

    def with_minimum_sizes(self, boundary: Boundary, tolerance: float) -> Boundary:
        boundary, member, reach = spread(boundary), boundary.member, self.steps.longest
        first_area = _area(boundary)[0]
        metric = boundary.metric(self.steps.smooth * member)
        no_gradient, fixed = np.zeros(boundary.n_offsets), boundary.fixed_offsets

        for _ in range(CURVES.mending):
            constraints = [self.sizes(boundary), self.radii(boundary)]
            violation = max(rows.size_violation for rows in constraints)
            if violation <= tolerance:
                break
            constraints.append(self.position_rows(boundary, 1.5 * reach * member))

            # a member that becomes wider takes no more material: one more row, of length one
            area, area_slopes = _area(boundary)
            area_row = member * area_slopes
            length = max(float(np.linalg.norm(area_row)), 1e-300)
            size_slopes = [member * rows.slopes for rows in constraints]
            slopes = np.vstack([*size_slopes, area_row / length])
            size_values = [rows.values for rows in constraints]
            values = np.concatenate([*size_values, [(area - first_area) / length]])

            step = best_step(metric, no_gradient, values, slopes, fixed, reach, None, self.steps)
            boundary = boundary.moved(member * step.offsets)
        return boundary

    def offsets_between(self, before: Boundary, after: Boundary) -> Array:
        controls = [
            np.vstack([curve.control for curve in boundary.free.values()])
            for boundary in (before, after)
        ]
        motion = controls[1] - controls[0]
        return before.mean_of_orbits(np.einsum("kd,kd->k", motion, before.normals))

    def with_insertions(self, boundary: Boundary, struts: Struts) -> Iterator[tuple[Boundary, int]]:
        ends = missing_strut(boundary, struts)
        if ends is not None:
            with suppress(ShapeError):
                yield with_strut(boundary, ends), 1

    def strut_shares(self, boundary: Boundary, struts: Struts) -> StrutShares:
        domain = struts.domain
        x, y = domain.everywhere(domain.centroids)[:, :2].T
        carried = domain.everywhere(struts.carried)
        shares = StrutShares()
        for pair, strut in struts_between_holes(boundary):
            shapely.prepare(strut)
            shares[pair] = float(np.sum(carried[shapely.contains_xy(strut, x, y)]))
        return shares

    def without_idle_struts(
        self, boundary: Boundary, shares: StrutShares
    ) -> Iterator[tuple[Boundary, int]]:
        holes = set(boundary.holes)
        idle_pairs = [
            pair for pair, share in shares.items() if share < CURVES.idle and holes.issuperset(pair)
        ]
        idle_pairs.sort(key=lambda pair: shares[pair])
        for pair in idle_pairs[: CURVES.idle_tried]:
            try:
                without_strut = joined(boundary, pair)
            except ShapeError:
                continue
            yield without_strut, max(len(holes) - len(without_strut.holes), 1)


def _area(boundary: Boundary) -> tuple[float, Array]:
    """The area within free curves but for a constant [m^2], and its slopes by the offsets [m]."""
    areas, slopes = zip(*(curve.area for curve in boundary.free.values()), strict=True)
    return sum(areas), np.concatenate(slopes) @ boundary.expansion


def _size_of_enough(boundary: Boundary) -> float:
    """The size of triangles of which there are just enough [m]."""
    return math.sqrt(4.0 / math.sqrt(3.0) * boundary.material.area / CURVES.triangles)


class SpatialGeometry(BoundaryGeometry[Surface]):
    """Zero surfaces of fields in space, on tetrahedra that are cut."""

    boundary_type, type_name = Surface, "a Surface"
    steps = SPACE_STEPS
    finer_meshes, mesh_tolerance = 2, Solid.tolerance

    def mesh(self, boundary: Surface, size: float, turn: float) -> Domain:
        return boundary.part.domain(boundary.size)

    def motion(self, boundary: Surface, domain: Domain) -> SurfaceMotion:
        return SurfaceMotion(boundary, domain)

    def sizes(self, boundary: Surface) -> Rows:
        return boundary.rows(boundary.walls)

    def cell_size(self, boundary: Surface, user_size: float | None) -> float:
        return boundary.size

    def offsets_between(self, before: Surface, after: Surface) -> Array:
        return before.offsets_to(after)

    def with_drawn_sizes(self, boundary: Surface) -> Surface:
        return boundary.with_drawn_sizes()

    def finer(self, boundary: Surface) -> Surface:
        return boundary.finer()

    def with_insertions(self, boundary: Surface, struts: Struts) -> Iterator[tuple[Surface, int]]:
        everywhere = struts.domain.everywhere
        centroids, changes = everywhere(struts.domain.centroids), everywhere(struts.removed)
        yield from boundary.with_windows(centroids, changes)

    def remarks(self, boundary: Surface) -> list[str]:
        return list(boundary.drawn.warnings)
