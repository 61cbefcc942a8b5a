# SPDX-License-Identifier: MIT
"""What the descent asks of boundaries in the plane and of surfaces in space."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

from mpi4py import MPI

import numpy as np
import shapely

from ..arrays import Array
from ..fem import CurveError, Domain, ShapeError
from ..part import Solid
from ..reduction import Struts
from .derivative import CurveMotion, NodeMotion
from .outline import Boundary
from .sizes import Rows, radius_rows, room_rows, size_rows
from .spread import spread
from .step import best_step
from .struts import missing
from .surface import Surface, SurfaceMotion

B = TypeVar("B", Boundary, Surface)
#: Share of psi that the strut between two curves carries
Carried = dict[tuple[int, int], float]

#: Size of triangles, in minimum members, and at most in widths of members; and their number at
#: least, so that psi of a part with few members is told as well; how much larger they may be in
#: steps in which no stress counts, as psi differs by no more than 0.1 % by them
_SIZE, _ACROSS, _CELLS, _LARGER = 3.2, 1.2, 800, 1.3
#: Share of psi that a strut carries at most to be tried without it, and how many are tried at once
_IDLE, _TRIED = 2e-3, 3
#: Rounds in which sizes are mended, and squares of the minimum member more that this may take
_MENDED, _MORE = 3, 0.1


@dataclass(frozen=True)
class Pace:
    """When a step is taken back, and how long the next one is; lengths in minimum members."""

    rise: float  #: Of the merit beyond which a step is taken back; another mesh alone changes it
    drift: float  #: The same beside the best one: rises of several steps add up
    shorter: float  #: Factor of the reach after a step that is no better
    shortest: float  #: Step, below which another mesh changes more
    again: float  #: Reach at least when modes may have changed
    smooth: float  #: Distance over which a step is smooth, in minimum members

    def worse(self, merit: float, before: float, best: float) -> bool:
        """Whether a step to a merit is taken back, by those before it and of the best one."""
        return merit > min(before + self.rise, best + self.drift)


class Kind(ABC, Generic[B]):
    """What the descent asks of one kind of boundary."""

    kind: ClassVar[type]
    article: ClassVar[str]  #: What users are asked for
    pace: ClassVar[Pace]
    meshes: ClassVar[int]  #: Finer ones at most on which the result is told
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

    def mended(self, boundary: B, missed: float, reach: float) -> B:
        """The boundary with sizes mended that a step has left too small.

        Sizes may be missed by a share ``missed``; ``reach`` is the longest step, in members.
        """
        return boundary

    def way(self, before: B, after: B) -> Array:
        """Normal displacements of independent controls, in members; empty if unknown."""
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
    pace = Pace(rise=0.0, drift=math.inf, shorter=0.7, shortest=1e-3, again=0.0, smooth=2.4)
    meshes, still = 1, math.inf

    def mesh(self, boundary: Boundary, size: float, turn: float) -> Domain:
        if not boundary.valid:
            raise CurveError("boundary: curves cross, or leave the body")
        across = _ACROSS
        if turn == math.inf:
            across *= _LARGER
            size = max(size, min(_LARGER * size, _enough(boundary)))
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
        return min(_SIZE * boundary.member, _enough(boundary))

    def mended(self, boundary: Boundary, missed: float, reach: float) -> Boundary:
        boundary = spread(boundary)
        most, shares, member = _area(boundary)[0], boundary.shares, boundary.member
        metric = (shares.T @ boundary.metric(self.pace.smooth * member) @ shares).tocsc()
        still, held = np.zeros(shares.shape[1]), shares.T @ boundary.held > 0
        for _ in range(_MENDED):
            rows = [self.sizes(boundary), self.radii(boundary)]
            # a member that becomes wider takes no more material
            area, gains = _area(boundary)
            more, gain = area - most, member * (gains @ shares)
            if max(part.missed for part in rows) <= missed and more <= _MORE * member**2:
                break
            rows.append(self.room(boundary, 1.5 * reach * member))
            scale = max(float(np.linalg.norm(gain)), 1e-300)
            values = np.concatenate([*(part.values for part in rows), [more / scale]])
            slopes = np.vstack([*(member * (part.slopes @ shares) for part in rows), gain / scale])
            step = best_step(metric, still, values, slopes, held, reach)
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
        holes = set(boundary.holes)
        idle = [pair for pair, share in carried.items() if share < _IDLE and holes.issuperset(pair)]
        idle.sort(key=lambda pair: carried[pair])
        for pair in idle[:_TRIED]:
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
    """The largest size of triangles that resolves the part [m]."""
    return math.sqrt(4.0 / math.sqrt(3.0) * boundary.material.area / _CELLS)


class InSpace(Kind[Surface]):
    """Surfaces of fields, on tetrahedra that are cut."""

    kind, article = Surface, "a Surface"
    pace = Pace(rise=2e-2, drift=2e-2, shorter=0.9, shortest=0.02, again=0.3, smooth=1.4)
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
