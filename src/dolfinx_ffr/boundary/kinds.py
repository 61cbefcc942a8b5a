# SPDX-License-Identifier: MIT
"""What the descent asks of boundaries in the plane and of surfaces in space."""

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
from .sizes import Rows, radius_rows, room_rows, size_rows
from .spread import spread
from .step import best_step
from .struts import missing
from .surface import Surface, SurfaceMotion

B = TypeVar("B", Boundary, Surface)
#: Share of psi that the strut between two curves carries
Carried = dict[tuple[int, int], float]


class Kind(ABC, Generic[B]):
    """What the descent asks of one kind of boundary."""

    kind: ClassVar[type]
    article: ClassVar[str]  #: What users are asked for
    options: ClassVar[BoundaryOptions]  #: Numbers of the steps
    meshes: ClassVar[int]  #: Most finer meshes on which the result is evaluated
    still: ClassVar[float]  #: Change of psi from one of them to the next that ends them

    @abstractmethod
    def mesh(self, boundary: B, size: float, turn: float) -> Domain:
        """A mesh of a size [m], and in notches of ``turn`` radii, that fits."""

    @abstractmethod
    def motion(self, boundary: B, domain: Domain) -> NodeMotion[Any]:
        """How the nodes of that mesh follow."""

    def agreed(self, boundary: B, comm: MPI.Comm) -> B:
        """The boundary of rank 0, from which others may differ by round-off."""
        return boundary

    @abstractmethod
    def sizes(self, boundary: B) -> Rows:
        """Members and gaps."""

    def radii(self, boundary: B) -> Rows:
        """Radii of curvature."""
        return Rows.none(boundary.n_controls)

    def room(self, boundary: B, reach: float) -> Rows:
        """Where controls may be, after a step of at most ``reach`` [m]."""
        return Rows.none(boundary.n_controls)

    @abstractmethod
    def size(self, boundary: B, given: float | None) -> float:
        """The size of cells [m], by default one that is fine enough for psi and the members."""

    def worse(self, merit: float, before: float, best: float) -> bool:
        """Whether a step to a merit is taken back, by the merits before it and of the best trial.

        Another mesh alone may change the merit, and the changes of several steps add up.
        """
        noise = self.options.mesh_noise
        return merit > before + noise or (noise > 0.0 and merit > best + noise)

    def mended(self, boundary: B, missed: float) -> B:
        """The boundary with sizes mended that a step has left too small.

        Sizes may be below their minimum by a share ``missed``.
        """
        return boundary

    def way(self, before: B, after: B) -> Array:
        """Offsets of masters from one boundary to the next, in members; empty if not known."""
        return np.zeros(0)

    def finer(self, boundary: B) -> B:
        """The same for a finer mesh, to tell the result by; ValueError if that is too fine."""
        return boundary

    def settled(self, boundary: B) -> B:
        """The same with what is drawn mended, to tell the result by."""
        return boundary

    def carried(self, boundary: B, struts: Struts) -> Carried:
        """What struts carry."""
        return {}

    def simpler(self, boundary: B, carried: Carried) -> Iterator[tuple[B, int]]:
        """The boundary without struts that may not pay, and how many of them are gone."""
        return iter(())

    def braced(self, boundary: B, struts: Struts) -> Iterator[tuple[B, int]]:
        """The boundary with a strut, or windows, more, and how many.

        One for each that is to be tried, as it may lower psi.
        """
        return iter(())

    def said(self, boundary: B) -> list[str]:
        """What is to be said of the part of a result, and was not of those of trials."""
        return []


class InThePlane(Kind[Boundary]):
    """Curves, on meshes of triangles."""

    kind, article = Boundary, "a Boundary"
    options = CURVES
    meshes, still = 1, math.inf

    def mesh(self, boundary: Boundary, size: float, turn: float) -> Domain:
        if not boundary.valid:
            raise CurveError("boundary: curves cross, or leave the body")
        options = boundary.options
        across = options.triangle_across
        if turn == math.inf:
            across *= options.coarser
            size = max(size, min(options.coarser * size, _enough(boundary)))
        return boundary.part.domain(size, across=across, turn=turn)

    def agreed(self, boundary: Boundary, comm: MPI.Comm) -> Boundary:
        return boundary.restored(comm.bcast(boundary.state())) if comm.size > 1 else boundary

    def motion(self, boundary: Boundary, domain: Domain) -> CurveMotion:
        return CurveMotion(boundary, domain)

    def sizes(self, boundary: Boundary) -> Rows:
        return size_rows(boundary)

    def radii(self, boundary: Boundary) -> Rows:
        return radius_rows(boundary)

    def room(self, boundary: Boundary, reach: float) -> Rows:
        return room_rows(boundary, reach)

    def size(self, boundary: Boundary, given: float | None) -> float:
        if given is not None:
            return given
        return min(boundary.options.triangle * boundary.member, _enough(boundary))

    def mended(self, boundary: Boundary, missed: float) -> Boundary:
        boundary, options = spread(boundary), boundary.options
        reach = options.longest
        most, shares, member = _area(boundary)[0], boundary.shares, boundary.member
        metric = (shares.T @ boundary.metric(options.smooth * member) @ shares).tocsc()
        still, held = np.zeros(shares.shape[1]), shares.T @ boundary.held > 0
        for _ in range(options.mending):
            rows = [self.sizes(boundary), self.radii(boundary)]
            # a member that becomes wider takes no more material
            area, gains = _area(boundary)
            more, gain = area - most, member * (gains @ shares)
            if max(part.missed for part in rows) <= missed and more <= options.material * member**2:
                break
            rows.append(self.room(boundary, 1.5 * reach * member))
            scale = max(float(np.linalg.norm(gain)), 1e-300)
            values = np.concatenate([*(part.values for part in rows), [more / scale]])
            slopes = np.vstack([*(member * (part.slopes @ shares) for part in rows), gain / scale])
            step = best_step(metric, still, values, slopes, held, reach, None, options)
            boundary = boundary.moved(member * (shares @ step.offsets))
        return boundary

    def way(self, before: Boundary, after: Boundary) -> Array:
        control = [np.vstack([c.control for c in b.free.values()]) for b in (before, after)]
        along = np.einsum("kd,kd->k", control[1] - control[0], before.normals)
        return np.asarray(before.shares.T @ along / before.shares.sum(axis=0).A1 / before.member)

    def braced(self, boundary: Boundary, struts: Struts) -> Iterator[tuple[Boundary, int]]:
        for ends in missing(boundary, struts):
            try:
                yield boundary.braced(ends), 1
            except ShapeError:
                continue

    def carried(self, boundary: Boundary, struts: Struts) -> Carried:
        domain = struts.domain
        x, y = domain.everywhere(domain.centroids)[:, :2].T
        shares = domain.everywhere(struts.carried)
        carried = Carried()
        for pair, strut in boundary.struts():
            shapely.prepare(strut)
            carried[pair] = float(np.sum(shares[shapely.contains_xy(strut, x, y)]))
        return carried

    def simpler(self, boundary: Boundary, carried: Carried) -> Iterator[tuple[Boundary, int]]:
        holes, options = set(boundary.holes), boundary.options
        idle = [
            pair
            for pair, share in carried.items()
            if share < options.idle and holes.issuperset(pair)
        ]
        idle.sort(key=lambda pair: carried[pair])
        for pair in idle[: options.idle_tried]:
            try:
                joined = boundary.joined(pair)
            except ShapeError:
                continue
            yield joined, max(len(holes) - len(joined.holes), 1)


def _area(boundary: Boundary) -> tuple[float, Array]:
    """The area within free curves but for a constant [m^2], and its slopes by offsets [m]."""
    areas, gains = zip(*(curve.area for curve in boundary.free.values()), strict=True)
    return sum(areas), np.concatenate(gains)


def _enough(boundary: Boundary) -> float:
    """The size of triangles of which there are just enough [m]."""
    return math.sqrt(4.0 / math.sqrt(3.0) * boundary.material.area / boundary.options.triangles)


class InSpace(Kind[Surface]):
    """Surfaces of fields, on tetrahedra that are cut."""

    kind, article = Surface, "a Surface"
    options = IN_SPACE
    meshes, still = 2, Solid.tolerance

    def mesh(self, boundary: Surface, size: float, turn: float) -> Domain:
        return boundary.part.domain(boundary.size)

    def motion(self, boundary: Surface, domain: Domain) -> SurfaceMotion:
        return SurfaceMotion(boundary, domain)

    def sizes(self, boundary: Surface) -> Rows:
        return boundary.rows(boundary.walls)

    def size(self, boundary: Surface, given: float | None) -> float:
        return boundary.size

    def way(self, before: Surface, after: Surface) -> Array:
        return before.offsets_to(after) / before.member

    def settled(self, boundary: Surface) -> Surface:
        return boundary.settled()

    def finer(self, boundary: Surface) -> Surface:
        return boundary.finer()

    def braced(self, boundary: Surface, struts: Struts) -> Iterator[tuple[Surface, int]]:
        everywhere = struts.domain.everywhere
        yield from boundary.pierced(everywhere(struts.domain.centroids), everywhere(struts.removed))

    def said(self, boundary: Surface) -> list[str]:
        return list(boundary.drawn.warnings)
