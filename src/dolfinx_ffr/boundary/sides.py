# SPDX-License-Identifier: MIT
"""Which sides of a drawing stay, and along which points those run that may move.

The sides of a drawing's faces are grouped into *chains*: curves of one kind, one after the other. A
chain of sides that may move becomes one `Run`, along which a spline is fitted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely

from ..arrays import Array, Mask
from ..fem import CurveError, Drawing, Face

#: Distance between curves of a drawing and the polygons along which splines are fitted [m]
_ACCURACY = 2e-5


@dataclass(frozen=True)
class Side:
    """A curve of a loop: number among those that stay or those that move, and its direction."""

    free: bool
    number: int
    forward: bool = True


Loop = tuple[Side, ...]
#: Group of each face, and its loops
Loops = tuple[tuple[str, tuple[Loop, ...]], ...]
#: Curves of a drawing one after the other, by number and whether they run forwards
Chain = list[tuple[int, bool]]
#: Chains by the node at which they begin
ChainsByNode = dict[int, Chain]


@dataclass(frozen=True, eq=False)
class Run:
    """Points along sides that may move: a closed ring, or from one curve that stays to another."""

    points: Array  #: (n, 2), the first point of a ring is not repeated [m]
    nodes: tuple[int, int] | None  #: Of the drawing at both ends, None of a ring


def sides_of(
    drawing: Drawing,
    edge: shapely.Geometry,
    near: float,
    outline: bool = True,
    holes: shapely.Geometry | None = None,
) -> tuple[list[Run], Loops]:
    """The runs that may move, by number, and all faces by their sides.

    Interfaces, solid regions and what lies between them stay. A void beside a solid region becomes
    a hole of its own, and a run that meets the side of a solid region goes on along it to where it
    ends: so there is no notch without a radius, where stress would have no limit. ``edge`` is the
    outline of the whole body, found to a distance ``near`` [m]: what lies on it moves only where
    the ``outline`` is free. What lies on drawn ``holes`` stays.
    """
    may_move, beside_solid = _kinds_of_curves(drawing, edge, near, outline, holes)
    sorting = _Sorting(_Chains(drawing))
    for face in drawing.faces:
        sorting.add(face, may_move, beside_solid)
    sorting.extend_along_solid_regions()
    sorting.close_loops()
    return sorting.runs, (*sorting.faces, *_designed_faces(sorting.loops))


def _kinds_of_curves(
    drawing: Drawing,
    edge: shapely.Geometry,
    near: float,
    outline: bool,
    holes: shapely.Geometry | None,
) -> tuple[Mask, Mask]:
    """Whether each curve may move, and whether it is the side of a solid region beside void."""
    groups_of_faces: list[set[str]] = [set() for _ in drawing.curves]
    for face in drawing.faces:
        for loop in face.loops:
            for i, _ in loop:
                groups_of_faces[i].add(face.group)
    is_designed = np.array([groups == {"design"} for groups in groups_of_faces])
    is_solid = np.array([groups == {"solid"} for groups in groups_of_faces])
    is_interface = np.array([bool(name) for name in drawing.groups])

    middles = shapely.points([curve.at(np.array([0.5]))[0] for curve in drawing.curves])
    is_inside = shapely.distance(middles, edge) > near
    is_on_hole = shapely.intersects(middles, holes or shapely.MultiPolygon())
    is_free = is_inside | (outline & ~is_on_hole)
    return is_designed & ~is_interface & is_free, is_solid & ~is_interface & is_inside


class _Chains:
    """Ends and points of chains of a drawing's curves."""

    def __init__(self, drawing: Drawing) -> None:
        self.drawing = drawing

    def first_node(self, chain: Chain) -> int:
        i, forward = chain[0]
        return self.drawing.nodes[i][0 if forward else 1]

    def last_node(self, chain: Chain) -> int:
        i, forward = chain[-1]
        return self.drawing.nodes[i][1 if forward else 0]

    def end(self, chain: Chain) -> Array:
        """Last point, shape (2,) [m]."""
        i, forward = chain[-1]
        curve = self.drawing.curves[i]
        return curve.end if forward else curve.start

    def points(self, chain: Chain) -> Array:
        """Vertices of a fine polygon along a chain without the last one, shape (n, 2) [m]."""
        vertices = []
        for i, forward in chain:
            points = self.drawing.curves[i].points(_ACCURACY)
            vertices.append((points if forward else points[::-1])[:-1])
        return np.vstack(vertices)


@dataclass(eq=False)
class _Sorting:
    """The sides of faces, sorted step by step into runs and loops."""

    chains: _Chains
    runs: list[Run] = field(default_factory=list)
    faces: list[tuple[str, tuple[Loop, ...]]] = field(default_factory=list)  #: Solid regions
    #: Loops around designed regions and holes in them, with their polygons (n, 2) [m]
    loops: list[tuple[Loop, Array]] = field(default_factory=list)
    solid: ChainsByNode = field(default_factory=dict)  #: Sides of solid regions beside void
    moving: ChainsByNode = field(default_factory=dict)  #: Sides of designed regions that may move
    staying: list[Chain] = field(default_factory=list)  #: Other sides of designed regions

    def add(self, face: Face, may_move: Mask, beside_solid: Mask) -> None:
        """Add the chains of a face."""
        first_node = self.chains.first_node
        for loop in face.loops:
            if face.group == "solid":
                for chain, is_beside in _split(loop, beside_solid):
                    if is_beside:
                        self.solid[first_node(chain)] = chain
            elif all(may_move[i] for i, _ in loop):
                self._add_ring(self.chains.points(list(loop)))
            else:
                for chain, moves in _split(loop, may_move):
                    if moves:
                        self.moving[first_node(chain)] = chain
                    else:
                        self.staying.append(chain)
        if face.group == "solid":
            sides = [tuple(Side(False, i, forward) for i, forward in loop) for loop in face.loops]
            self.faces.append((face.group, tuple(sides)))

    def _add_run(self, points: Array, nodes: tuple[int, int] | None = None) -> Side:
        self.runs.append(Run(points, nodes))
        return Side(True, len(self.runs) - 1)

    def _add_ring(self, points: Array) -> None:
        self.loops.append(((self._add_run(points),), points))

    def extend_along_solid_regions(self) -> None:
        """Make one run of sides that move and those of solid regions that go on from them.

        A chain along a solid region is walked back on its other side, in a loop of the design.
        """
        chains = self.chains
        for node in list(self.moving):
            if node not in self.moving:
                continue
            if extended := self._extended(node):
                self.staying += [
                    _reversed(chain) for chain in extended if chain is not self.moving[node]
                ]
                del self.moving[node]
                joined = [side for chain in extended for side in chain]
                self.moving[chains.first_node(joined)] = joined
            elif ring := self._ring(node):
                self._add_ring(np.vstack([chains.points(chain) for chain in ring]))
                for chain in ring[::2]:
                    del self.moving[chains.first_node(chain)]
                self.staying += map(_reversed, ring[1::2])

    def _extended(self, node: int) -> list[Chain]:
        """A moving chain with those of solid regions before and after it that end at no other.

        Empty if there are none.
        """
        first_node, last_node = self.chains.first_node, self.chains.last_node
        moving_starts = {first_node(chain) for chain in self.moving.values()}
        moving_ends = {last_node(chain) for chain in self.moving.values()}
        preceding = next((c for c in self.solid.values() if last_node(c) == node), None)
        following = self.solid.get(last_node(self.moving[node]))

        extended = [preceding] if preceding and first_node(preceding) not in moving_ends else []
        extended.append(self.moving[node])
        extended += [following] if following and last_node(following) not in moving_starts else []
        return extended if len(extended) > 1 else []

    def _ring(self, first_node: int) -> list[Chain]:
        """Chains around a void between designed and solid regions, of both in turn, or nothing."""
        ring: list[Chain] = []
        node = first_node
        for chains in (self.moving, self.solid) * len(self.moving):
            if node not in chains or chains[node] in ring:
                return []
            ring.append(chains[node])
            node = self.chains.last_node(chains[node])
            if node == first_node and chains is self.solid:
                return ring
        return []

    def close_loops(self) -> None:
        """Join the chains of designed regions to loops, and add a run for each moving chain."""
        chains = self.chains
        remaining = {chains.first_node(c): c for c in [*self.staying, *self.moving.values()]}
        while remaining:
            sides: list[Side] = []
            points: list[Array] = []
            node = next(iter(remaining))
            while node in remaining:
                chain = remaining.pop(node)
                points.append(chains.points(chain))
                if self.moving.get(node) is chain:
                    ends = node, chains.last_node(chain)
                    run_points = np.vstack([points[-1], chains.end(chain)[None]])
                    sides.append(self._add_run(run_points, ends))
                else:
                    sides += [Side(False, i, forward) for i, forward in chain]
                node = chains.last_node(chain)
            self.loops.append((tuple(sides), np.vstack(points)))


def _designed_faces(
    loops: Sequence[tuple[Loop, Array]],
) -> Iterator[tuple[str, tuple[Loop, ...]]]:
    """Loops around designed regions, counterclockwise, each with the holes in it, clockwise.

    Given are sides and polygons (n, 2) of all loops.
    """
    # chains that go along a solid region and back enclose nothing
    rings = [points if len(points) > 2 else np.zeros((0, 2)) for _, points in loops]
    regions = [shapely.Polygon(points).buffer(0.0) for points in rings]
    outer = [k for k, (_, points) in enumerate(loops) if _twice_signed_area(points) > 0.0]
    # of nested regions the smallest one is looked at first
    by_area = sorted(outer, key=lambda k: regions[k].area)
    holes: dict[int, list[int]] = {k: [] for k in by_area}
    for k, region in enumerate(regions):
        if k in holes:
            continue
        # a hole along the rim of a bore may touch the outline, and leave it by round-off
        half = 0.5 * region.area
        around = [j for j in by_area if regions[j].intersection(region).area >= half]
        if not around:
            raise CurveError("boundary: a hole lies in no face, because curves cross")
        holes[around[0]].append(k)
    for k in outer:
        yield "design", tuple(loops[j][0] for j in (k, *holes[k]))


def _twice_signed_area(ring: Array) -> float:
    """Twice the area of a polygon (n, 2), positive if it is counterclockwise [m^2]."""
    x, y = ring.T
    following_x, following_y = np.roll(ring, -1, axis=0).T
    return float(np.sum(x * following_y - y * following_x))


def _reversed(chain: Chain) -> Chain:
    return [(i, not forward) for i, forward in chain[::-1]]


def _split(loop: Sequence[tuple[int, bool]], chosen: Mask) -> Iterator[tuple[Chain, bool]]:
    """The loop in chains of curves that are chosen and of others, each as long as can be."""
    changes = (k for k, (i, _) in enumerate(loop) if chosen[i] != chosen[loop[k - 1][0]])
    start = next(changes, 0)
    chain: Chain = []
    for i, forward in [*loop[start:], *loop[:start]]:
        if chain and chosen[chain[-1][0]] != chosen[i]:
            yield chain, bool(chosen[chain[-1][0]])
            chain = []
        chain.append((i, forward))
    yield chain, bool(chosen[chain[-1][0]])
