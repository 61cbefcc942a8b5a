# SPDX-License-Identifier: MIT
"""Curves between regions: splines along the zero line of a field, lines and arcs of the mesh."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count, pairwise

import numpy as np

from ..arrays import Array, Integers, Mask
from ..fem import Arc, Curve, Drawing, Line, nearest_circle, turns
from .cut import Segments
from .field import Field
from .fitting import corners, fitted, followed, thinned
from .lattice import Lattice
from .options import CURVES

#: Nodes along a chain, and its marks
Chain = tuple[list[int], Integers]


@dataclass(frozen=True, eq=False)
class Boundaries:
    """Curves between the regions of a body, directed so that material is on their left."""

    lines: Drawing  #: The curves, those of interfaces in a group by its name; without faces
    left: Sequence[int]  #: DESIGN or SOLID, for each curve
    right: Sequence[int]  #: VOID, or SOLID right of DESIGN, for each curve

    def around(self, kind: int) -> list[tuple[int, bool]]:
        """The sides of curves beside a kind of region; forward where that is on the left."""
        forward = [(i, True) for i, left in enumerate(self.left) if left == kind]
        return forward + [(i, False) for i, right in enumerate(self.right) if right == kind]


def boundaries(
    lattice: Lattice,
    segments: Segments,
    field: Field,
    step: float,
    tolerance: float,
    names: Sequence[str],
) -> Boundaries:
    """Join the segments between the regions of a body to curves.

    ``step`` is the length of the lattice's sides [m]; no curve is farther than the tolerance [m]
    from the ends of its segments; ``names`` are the interfaces by their number.
    """
    primitive, circles = _primitives(lattice)
    on_field = segments.edge < 0
    on_primitive = np.where(on_field, -1, primitive[segments.edge])
    interface = np.where(on_field, -1, lattice.interface[segments.edge])
    marks = np.column_stack([segments.left, segments.right, on_primitive, interface])
    points = segments.points.copy()
    chains = list(_chains(segments.ends, marks))
    _onto_circles(points, chains, circles, step)

    curves: list[Curve] = []
    nodes: list[tuple[int, int]] = []
    marks_of_curves: list[Integers] = []
    corner_numbers = count(len(points))
    for chain, mark in chains:
        if mark[2] < 0:
            zero = segments.zero
            of_chain = _zero_line(points, chain, zero, corner_numbers, field, step, tolerance)
        else:
            circle = circles.get(int(mark[2]))
            of_chain = iter([_side_of_mesh(points, chain, circle, lattice, tolerance)])
        for ends, curve in of_chain:
            curves.append(curve)
            nodes.append(ends)
            marks_of_curves.append(mark)
    left, right, _, interfaces = np.reshape(marks_of_curves, (-1, 4)).T.tolist()
    groups = ["" if number < 0 else names[number] for number in interfaces]
    return Boundaries(Drawing(curves, nodes, groups, []), left, right)


def _onto_circles(
    points: Array, chains: Sequence[Chain], circles: dict[int, Array], step: float
) -> None:
    """Move the ends of chains from chords onto their circles, straight on along the zero line."""
    directions: dict[int, Array] = {}  # of the zero line where it ends, by the node
    for chain, mark in chains:
        if mark[2] < 0 and chain[0] != chain[-1]:
            for end, *inner in (chain, chain[::-1]):
                lengths = np.linalg.norm(points[inner] - points[end], axis=1)
                clear = np.flatnonzero(lengths > CURVES.thin * step)
                ray = points[end] - points[inner[clear[0] if len(clear) else -1]]
                directions[end] = ray / max(float(np.hypot(*ray)), 1e-300)
    for chain, mark in chains:
        circle = circles.get(int(mark[2]))
        if circle is None:
            continue
        for node in {chain[0], chain[-1]}:
            radial = points[node] - circle[:2]
            normal = radial / np.hypot(*radial)
            ray = directions.get(node, normal)
            # |radial + s ray| = radius, the solution nearer to the chord
            b, c = float(ray @ radial), float(radial @ radial) - circle[2] ** 2
            if abs(ray @ normal) > 0.2 and b * b > c:
                root = np.sqrt(b * b - c)
                s = min(-b - root, -b + root, key=abs)
                radial = radial + s * ray
            # on the circle to the last bit
            points[node] = circle[:2] + circle[2] / np.hypot(*radial) * radial


def _side_of_mesh(
    points: Array, chain: list[int], circle: Array | None, lattice: Lattice, tolerance: float
) -> tuple[tuple[int, int], Curve]:
    """The curve of a chain along the mesh, and the nodes at its ends."""
    x, ends = points[chain], (chain[0], chain[-1])
    if circle is not None:
        return ends, Arc.along(x, circle[:2])
    if lattice.curved:
        return ends, fitted(x, 1e-3 * tolerance, closed=chain[0] == chain[-1])
    return ends, Line(x[0], x[-1])


def _zero_line(
    points: Array,
    chain: list[int],
    zero: Mask,
    corner_numbers: Iterator[int],
    field: Field,
    step: float,
    tolerance: float,
) -> Iterator[tuple[tuple[int, int], Curve]]:
    """The curves of a chain along the zero line, with the nodes at their ends."""
    x, closed = points[chain], chain[0] == chain[-1]
    # where short segments were contracted, a point is near the zero line, but not on it
    is_exact = zero[chain]
    is_exact[[0, -1]] = True
    if np.count_nonzero(is_exact) > 3:
        x = x[is_exact]
    x = thinned(x, CURVES.thin * step)
    at_corners: list[int] = []
    if len(x) > 4:
        x, at_corners = corners(x, field, closed=closed)
    if closed and not at_corners:
        yield (chain[0], chain[0]), followed(x, field, tolerance, closed=True)
        return
    if closed:  # begin at a corner
        first_corner = at_corners[0]
        x = np.vstack([x[first_corner:-1], x[: first_corner + 1]])
        at_corners = [i - first_corner for i in at_corners[1:]]
    cuts = [0, *at_corners, len(x) - 1]
    # corners are nodes of their own
    nodes_at_cuts = [next(corner_numbers) for _ in cuts]
    if closed:
        nodes_at_cuts[-1] = nodes_at_cuts[0]
    else:
        nodes_at_cuts[0], nodes_at_cuts[-1] = chain[0], chain[-1]
    for nodes, (first, last) in zip(pairwise(nodes_at_cuts), pairwise(cuts), strict=True):
        yield nodes, followed(x[first : last + 1], field, tolerance)


def _primitives(lattice: Lattice) -> tuple[Integers, dict[int, Array]]:
    """For each edge of the mesh the number of its line, circle or free curve, and the circles.

    The number, shape (edges,), is that of the first edge of the line, circle or curve. The circles
    are given by this number, each as its centre and radius, shape (3,) [m].
    """
    primitive = np.arange(len(lattice.edges))  # each edge a line of its own, until others join it
    circles: dict[int, Array] = {}

    # chains of edges between the same two kinds of cells and of the same interface
    between_kinds = np.flatnonzero(lattice.sides[:, 0] != lattice.sides[:, 1])
    low, high = lattice.sides.min(axis=1), lattice.sides.max(axis=1)
    marks = np.column_stack([low, high, lattice.interface])[between_kinds]
    edge_of_ends = {frozenset(map(int, lattice.edges[e])): int(e) for e in between_kinds}
    halfway = lattice.chains.shape[1] // 2
    for chain, _ in _chains(lattice.edges[between_kinds], marks, directed=False):
        edges = np.array([edge_of_ends[frozenset(ends)] for ends in pairwise(chain)])
        x = lattice.points[chain]

        # an edge is straight where the point in its middle lies in the middle of its chord
        middles = lattice.points[lattice.chains[edges, halfway]]
        bulge = np.linalg.norm(middles - 0.5 * (x[1:] + x[:-1]), axis=1)
        length = np.linalg.norm(np.diff(x, axis=0), axis=1)
        is_straight = bulge < CURVES.straight * length

        for first, end, circle in _runs(x, middles, is_straight, lattice.curved):
            primitive[edges[first:end]] = edges[first]
            if circle is not None:
                circles[int(edges[first])] = circle
    return primitive, circles


def _runs(
    x: Array, middles: Array, is_straight: Mask, curved: bool
) -> Iterable[tuple[int, int, Array | None]]:
    """Runs of sides of a chain that make up one line, circle or smooth curve.

    The chain has the vertices x (n + 1, 2) [m] and the ``middles`` (n, 2) [m] of its sides, which
    ``is_straight`` (n,) tells from bent ones.

    Yields:
        The number of the first side, the number after that of the last one, and the circle, see
        `_circle`; None for a line or a smooth curve.
    """
    n = len(x) - 1
    turn = np.abs(turns(np.diff(x, axis=0)))
    is_round = (turn < CURVES.round) & (turn >= CURVES.straight)
    first = 0
    while first < n:
        end, circle = first + 1, None
        # a line
        while end < n and turn[end - 1] < CURVES.straight and is_straight[[first, end]].all():
            end += 1
        if end == first + 1:
            end, circle = _longest_circle(x, middles, is_round, first, curved)
            # a smooth curve, up to where a circle begins
            if circle is None and curved and not is_straight[first]:
                while end < n and turn[end - 1] < CURVES.round and not is_straight[end]:
                    if _longest_circle(x, middles, is_round, end, curved)[1] is not None:
                        break
                    end += 1
        yield first, end, circle
        first = end


def _longest_circle(
    x: Array, middles: Array, is_round: Mask, first: int, curved: bool
) -> tuple[int, Array | None]:
    """The end of the longest run of sides from ``first`` on a circle, and the circle, if any.

    At the inner ones of the vertices x (n + 1, 2) the mask ``is_round`` (n - 1,) tells where the
    chain turns, but without a corner. If ``curved``, the ``middles`` (n, 2) of the sides are on the
    curve.
    """
    fewest = CURVES.fewest_curved if curved else CURVES.fewest
    end = first + 1
    while end < len(x) - 1 and is_round[end - 1]:
        end += 1
    if end - first < fewest:
        return first + 1, None
    points, stride = x[first : end + 1], 1
    if curved:
        stride, with_middles = 2, np.empty((2 * (end - first) + 1, 2))
        with_middles[::2], with_middles[1::2] = points, middles[first:end]
        points = with_middles
    seed = _circle(points[: stride * fewest + 1])
    if seed is None:
        return first + 1, None
    distance = np.abs(np.hypot(*(points - seed[:2]).T) - seed[2])
    is_on_it = distance < 10.0 * CURVES.on_circle * seed[2]
    count = len(is_on_it) if np.all(is_on_it) else int(np.argmin(is_on_it))
    sides = (count - 1) // stride
    circle = _circle(points[: stride * sides + 1]) if sides >= fewest else None
    return (first + 1, None) if circle is None else (first + sides, circle)


def _circle(x: Array) -> Array | None:
    """Centre and radius, (3,) [m], of the circle on which points (n, 2) lie; None if on none."""
    circle = nearest_circle(x, CURVES.on_circle)
    return None if circle is None else np.array([*circle[0], circle[1]])


def _chains(ends: Integers, marks: Integers, *, directed: bool = True) -> Iterable[Chain]:
    """Chains of segments (segments, 2) with the same marks, between nodes where others meet them.

    The first node of a closed one is its last, too. Directed segments are only walked forwards.
    """
    pairs, keys = ends.tolist(), [tuple(mark) for mark in marks.tolist()]
    segments_at: dict[int, list[int]] = {}
    for i, pair in enumerate(pairs):
        for node in pair:
            segments_at.setdefault(node, []).append(i)

    def follows(node: int, segment: int) -> int | None:
        """The segment after another one, where nothing ends."""
        at_node = segments_at[node]
        if len(at_node) != 2:
            return None
        following = at_node[0] if at_node[1] == segment else at_node[1]
        return following if keys[following] == keys[segment] else None

    unused = set(range(len(pairs)))
    ends_to_start_at = 1 if directed else 2
    starts = [
        i
        for i, pair in enumerate(pairs)
        for node in pair[:ends_to_start_at]
        if follows(node, i) is None
    ]
    for start in [*starts, *range(len(pairs))]:
        if start not in unused:
            continue
        unused.discard(start)
        a, b = pairs[start]
        if follows(a, start) is not None and follows(b, start) is None and not directed:
            a, b = b, a
        chain, segment = [a, b], start
        while (following := follows(chain[-1], segment)) is not None and following in unused:
            unused.discard(following)
            p, q = pairs[following]
            chain.append(q if p == chain[-1] else p)
            segment = following
        yield chain, marks[start]
