# SPDX-License-Identifier: MIT
"""Meshes, constraints and topology changes of boundaries in the plane and of surfaces in space."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any, ClassVar, Generic, TypeVar

from mpi4py import MPI

import numpy as np
import shapely

from ..arrays import Array
from ..fem import CurveError, Domain, ShapeError
from ..part import Solid
from ..reduction import Struts
from .derivative import CurveMotion, NodeMotion
from .options import CURVES, IN_SPACE, BoundaryOptions
from .outline import Boundary
from .sizes import Rows, control_position_rows, radius_rows, size_rows
from .spread import spread
from .step import best_step
from .struts import missing
from .surface import Surface, SurfaceMotion

B = TypeVar("B", Boundary, Surface)
#: Share of psi that the strut between two curves carries
StrutShares = dict[tuple[int, int], float]


class BoundaryGeometry(ABC, Generic[B]):
    """Meshes, constraints and topology changes of boundaries of one dimension."""

    boundary_type: ClassVar[type]
    type_name: ClassVar[str]  #: What users are asked for
    options: ClassVar[BoundaryOptions]  #: Numbers of the steps
    finer_meshes: ClassVar[int]  #: Most finer meshes on which the result is evaluated
    mesh_tolerance: ClassVar[float]  #: Change of psi from one of them to the next that ends them

    @abstractmethod
    def mesh(self, boundary: B, size: float, turn: float) -> Domain:
        """A mesh of a size [m], and in notches of ``turn`` radii, that fits."""

    @abstractmethod
    def motion(self, boundary: B, domain: Domain) -> NodeMotion[Any]:
        """The motion of the nodes of that mesh with the controls of the boundary."""

    def agreed(self, boundary: B, comm: MPI.Comm) -> B:
        """The boundary of rank 0, from which others may differ by round-off."""
        return boundary

    @abstractmethod
    def sizes(self, boundary: B) -> Rows:
        """Constraints on members and gaps."""

    def radii(self, boundary: B) -> Rows:
        """Constraints on radii of curvature."""
        return Rows.none(boundary.n_controls)

    def position_rows(self, boundary: B, reach: float) -> Rows:
        """Constraints on the positions of controls after a step of at most ``reach`` [m]."""
        return Rows.none(boundary.n_controls)

    @abstractmethod
    def size(self, boundary: B, given: float | None) -> float:
        """The ``given`` size of cells [m], or one that is fine enough for psi and members."""

    def worse(self, merit: float, before: float, best: float) -> bool:
        """Whether a step to a merit is taken back, by the merits before it and of the best trial.

        Another mesh alone may change the merit, and the changes of several steps add up.
        """
        noise = self.options.mesh_noise
        return merit > before + noise or (noise > 0.0 and merit > best + noise)

    def with_minimum_sizes(self, boundary: B, tolerance: float) -> B:
        """The boundary with the sizes enlarged that a step has left too small.

        Sizes may remain below their minimum by a share, the ``tolerance``.
        """
        return boundary

    def normal_displacement(self, before: B, after: B) -> Array:
        """Offsets of all orbits from one boundary to the next, (orbits,), in minimum members.

        Empty if they are not known.
        """
        return np.zeros(0)

    def finer(self, boundary: B) -> B:
        """The boundary for the finer mesh of a result; ValueError if that is too fine."""
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
    options = CURVES
    finer_meshes, mesh_tolerance = 1, math.inf

    def mesh(self, boundary: Boundary, size: float, turn: float) -> Domain:
        if not boundary.valid:
            raise CurveError("boundary: curves cross, or leave the body")
        options = boundary.options
        across = options.triangle_across
        if turn == math.inf:
            across *= options.coarser
            size = max(size, min(options.coarser * size, _size_of_enough(boundary)))
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

    def size(self, boundary: Boundary, given: float | None) -> float:
        if given is not None:
            return given
        return min(boundary.options.triangle * boundary.member, _size_of_enough(boundary))

    def with_minimum_sizes(self, boundary: Boundary, tolerance: float) -> Boundary:
        boundary, options = spread(boundary), boundary.options
        reach, member, expansion = options.longest, boundary.member, boundary.expansion
        first_area = _area(boundary)[0]

        metric = (expansion.T @ boundary.metric(options.smooth * member) @ expansion).tocsc()
        no_gradient = np.zeros(expansion.shape[1])
        fixed = expansion.T @ boundary.fixed > 0

        for _ in range(options.mending):
            rows = [self.sizes(boundary), self.radii(boundary)]
            violation = max(size_rows.size_violation for size_rows in rows)
            area, area_slopes = _area(boundary)
            added_area = area - first_area
            if violation <= tolerance and added_area <= options.material * member**2:
                break
            rows.append(self.position_rows(boundary, 1.5 * reach * member))

            # a member that becomes wider takes no more material: one more row, of length one
            area_row = member * (area_slopes @ expansion)
            length = max(float(np.linalg.norm(area_row)), 1e-300)
            by_orbits = [member * (block.slopes @ expansion) for block in rows]
            slopes = np.vstack([*by_orbits, area_row / length])
            values = np.concatenate([*(block.values for block in rows), [added_area / length]])

            step = best_step(metric, no_gradient, values, slopes, fixed, reach, None, options)
            boundary = boundary.moved(member * (expansion @ step.offsets))
        return boundary

    def normal_displacement(self, before: Boundary, after: Boundary) -> Array:
        first, last = (
            np.vstack([curve.control for curve in boundary.free.values()])
            for boundary in (before, after)
        )
        offsets = np.einsum("kd,kd->k", last - first, before.normals)
        expansion = before.expansion
        controls_of_orbit = expansion.sum(axis=0).A1
        return np.asarray(expansion.T @ offsets / controls_of_orbit / before.member)

    def with_insertions(self, boundary: Boundary, struts: Struts) -> Iterator[tuple[Boundary, int]]:
        for ends in missing(boundary, struts):
            try:
                yield boundary.with_strut(ends), 1
            except ShapeError:
                continue

    def strut_shares(self, boundary: Boundary, struts: Struts) -> StrutShares:
        domain = struts.domain
        x, y = domain.everywhere(domain.centroids)[:, :2].T
        carried = domain.everywhere(struts.carried)
        strut_shares = StrutShares()
        for pair, strut in boundary.struts():
            shapely.prepare(strut)
            strut_shares[pair] = float(np.sum(carried[shapely.contains_xy(strut, x, y)]))
        return strut_shares

    def without_idle_struts(
        self, boundary: Boundary, shares: StrutShares
    ) -> Iterator[tuple[Boundary, int]]:
        holes, options = set(boundary.holes), boundary.options
        idle = [
            pair
            for pair, share in shares.items()
            if share < options.idle and holes.issuperset(pair)
        ]
        idle.sort(key=lambda pair: shares[pair])
        for pair in idle[: options.idle_tried]:
            try:
                joined = boundary.joined(pair)
            except ShapeError:
                continue
            yield joined, max(len(holes) - len(joined.holes), 1)


def _area(boundary: Boundary) -> tuple[float, Array]:
    """The area within free curves but for a constant [m^2], and its slopes by offsets [m]."""
    areas, slopes = zip(*(curve.area for curve in boundary.free.values()), strict=True)
    return sum(areas), np.concatenate(slopes)


def _size_of_enough(boundary: Boundary) -> float:
    """The size of triangles of which there are just enough [m]."""
    return math.sqrt(4.0 / math.sqrt(3.0) * boundary.material.area / boundary.options.triangles)


class SpatialGeometry(BoundaryGeometry[Surface]):
    """Zero surfaces of fields in space, on tetrahedra that are cut."""

    boundary_type, type_name = Surface, "a Surface"
    options = IN_SPACE
    finer_meshes, mesh_tolerance = 2, Solid.tolerance

    def mesh(self, boundary: Surface, size: float, turn: float) -> Domain:
        return boundary.part.domain(boundary.size)

    def motion(self, boundary: Surface, domain: Domain) -> SurfaceMotion:
        return SurfaceMotion(boundary, domain)

    def sizes(self, boundary: Surface) -> Rows:
        return boundary.rows(boundary.walls)

    def size(self, boundary: Surface, given: float | None) -> float:
        return boundary.size

    def normal_displacement(self, before: Surface, after: Surface) -> Array:
        return before.offsets_to(after) / before.member

    def with_drawn_sizes(self, boundary: Surface) -> Surface:
        return boundary.with_drawn_sizes()

    def finer(self, boundary: Surface) -> Surface:
        return boundary.finer()

    def with_insertions(self, boundary: Surface, struts: Struts) -> Iterator[tuple[Surface, int]]:
        everywhere = struts.domain.everywhere
        yield from boundary.pierced(everywhere(struts.domain.centroids), everywhere(struts.removed))

    def remarks(self, boundary: Surface) -> list[str]:
        return list(boundary.drawn.warnings)
