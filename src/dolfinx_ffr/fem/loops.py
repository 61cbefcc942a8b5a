# SPDX-License-Identifier: MIT
"""From the curves of a drawing to faces: ends are joined, loops found, interfaces named."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.spatial import cKDTree

from ..arrays import Array, Integers
from .curves import Curve, Drawn, polygon
from .drawing import CurveLoop, CurveSide, Drawing, Face
from .interface import Bore
from .mesh_checks import connected


@dataclass(frozen=True)
class DrawingOptions:
    """Tolerances for curves that nearly meet, and limits for refusing a drawing."""

    joined: float = 1e-6  #: Ends nearer to each other than this are one, in extents of the drawing
    #: Accuracy of the polygons by which crossings are found, and the largest distance between loose
    #: ends that are joined if no other is given, in extents of the drawing
    fine: float = 1e-4
    listed: int = 8  #: Bores that a message lists
    farthest: float = 1e6  #: No coordinate of a body is farther away [m]
    thinnest_rim: float = 0.5  #: Least width of a rim, in sizes of triangles


DRAWING = DrawingOptions()


def closed_outline(
    source: str,
    drawn: Sequence[Drawn],
    named: Mapping[str, str | Bore] | None = None,
    *,
    inside: Array | None = None,
    gap: float | None = None,
) -> Drawing:
    """The faces that closed curves bound, each curve once: outer loops, holes, islands in holes.

    The groups of the curves are the interfaces that are ``named`` by a layer or a bore. With a
    point ``inside`` (2,) [m] there is one face, that around the point, and curves that do not meet
    it do not count. Loose ends nearer to each other than the ``gap`` are joined [m].
    """
    named = named or {}
    _refuse_unknown_names(source, drawn, named)
    line_types = sorted({curve.line_type for curve in drawn if curve.line_type})
    note = f"; curves of the line types {', '.join(line_types)}, which have gaps, do not count"
    try:
        return _drawing(
            [curve for curve in drawn if not curve.line_type], source, named, inside, gap
        )
    except ValueError as error:
        if line_types:
            raise ValueError(f"{error}{note}") from error
        raise


def _drawing(
    drawn: Sequence[Drawn],
    source: str,
    named: Mapping[str, str | Bore],
    inside: Array | None,
    gap: float | None,
) -> Drawing:
    """The faces of `closed_outline`, of curves that all count."""
    points = samples([curve.curve for curve in drawn])
    extent = float(np.max(np.ptp(points, axis=0))) if drawn else 0.0
    tolerance, fine = DRAWING.joined * extent, DRAWING.fine * extent
    is_long = np.array([curve.curve.length > tolerance for curve in drawn], dtype=bool)
    if not np.any(is_long):
        raise ValueError(f"{source}: it holds no curve that has a length")

    long_enough = [curve for curve, long in zip(drawn, is_long, strict=True) if long]
    once = _once(long_enough, points.reshape(-1, 5, 2)[is_long], tolerance)
    curves, nodes = _joined([curve.curve for curve in once], tolerance)
    curves, nodes = _bridged(curves, nodes, fine if gap is None else gap)
    chosen = _without_curls(source, curves, nodes)
    groups = [""] * len(chosen)
    lines = Drawing([curves[i] for i in chosen], [nodes[i] for i in chosen], groups, [])
    layers = [once[i].names for i in chosen]

    closed = _closed(lines.nodes)
    loops = _loops(lines.nodes, closed)
    if inside is None:
        _refuse_open(source, lines, layers, range(len(chosen)))
        faces = _faces(source, lines, loops, fine)
    else:
        faces = [_face_around(source, lines, loops, fine, inside)]
        stray = sorted(set(range(len(chosen))) - set(closed))
        _refuse_stray(source, lines, layers, stray, lines.polygon(faces[0].loops, fine), fine)
    return _grouped(source, replace(lines, faces=faces), layers, named, fine)


def _refuse_unknown_names(
    source: str, drawn: Sequence[Drawn], named: Mapping[str, str | Bore]
) -> None:
    """Refuse interfaces of layers that no curve is on."""
    layers = frozenset[str]().union(*(curve.names for curve in drawn))
    asked_layers = [place for place in named.values() if isinstance(place, str)]
    missing = [name for name in asked_layers if name not in layers]
    if missing:
        raise ValueError(
            f"{source}: no curve has the name {', '.join(map(repr, missing))}; its layers "
            f"are {sorted(layers) or 'none'}"
        )


def _grouped(
    source: str,
    drawing: Drawing,
    layers: Sequence[frozenset[str]],
    named: Mapping[str, str | Bore],
    fine: float,
) -> Drawing:
    """The drawing with the curves of its faces alone, each in the group of its interface."""
    holes = [
        (drawing.polygon([loop], fine), loop) for face in drawing.faces for loop in face.loops[1:]
    ]
    used = sorted({i for face in drawing.faces for loop in face.loops for i, _ in loop})
    groups = [""] * len(drawing.curves)
    for name, place in named.items():
        if isinstance(place, Bore):
            members = _bore(source, name, place, holes)
        else:
            members = [i for i in used if place in layers[i]]
        if not members:
            raise ValueError(
                f"{source}: interface {name!r}: no curve of the outline itself is on {place!r}"
            )
        other_groups = {groups[i] for i in members} - {""}
        if other_groups:
            raise ValueError(
                f"{source}: the interfaces {other_groups.pop()!r} and {name!r} overlap: they have "
                "a curve in common; give each layers or places of its own, or join them into one"
            )
        for i in members:
            groups[i] = name
    named_curves = replace(drawing, groups=groups)
    return named_curves.selected(used, drawing.faces)


def _bore(
    source: str,
    name: str,
    bore: Bore,
    holes: Sequence[tuple[shapely.Polygon, CurveLoop]],
) -> list[int]:
    """The curves of the hole in which the point of a bore lies."""
    point = shapely.Point(*bore.at)
    around = [(shape.area, loop) for shape, loop in holes if shape.contains(point)]
    if not around:
        middles = [
            _point(np.array(shape.centroid.coords[0])) for shape, _ in holes[: DRAWING.listed]
        ]
        ellipsis = ", ..." if len(holes) > DRAWING.listed else ""
        raise ValueError(
            f"{source}: interface {name!r}: the point {_point(np.array(bore.at))} lies in no bore; "
            f"its bores have their middles at {', '.join(middles) or 'no place'}{ellipsis}"
        )
    return [i for i, _ in min(around, key=lambda each: each[0])[1]]


def samples(curves: Sequence[Curve]) -> Array:
    """Five points of each curve, one after the other, shape (n, 2) [m]."""
    t = np.linspace(0.0, 1.0, 5)
    return np.reshape([curve.at(t) for curve in curves], (-1, 2))


def _once(drawn: Sequence[Drawn], marks: Array, tolerance: float) -> list[Drawn]:
    """Curves without those that lie on others, whose names go to these.

    The ``marks`` are the `samples` of each curve, (curves, 5, 2) [m].
    """
    tree = cKDTree(marks[:, 2])
    distinct: list[Drawn | None] = list(drawn)
    for i, j in sorted(tree.query_pairs(2.0 * tolerance)):
        curve_i, curve_j = distinct[i], distinct[j]
        if curve_i is None or curve_j is None:
            continue
        gaps = [np.max(np.abs(marks[i] - mark)) for mark in (marks[j], marks[j][::-1])]
        if min(gaps) < 2.0 * tolerance:
            distinct[i], distinct[j] = replace(curve_i, names=curve_i.names | curve_j.names), None
    return [curve for curve in distinct if curve is not None]


def _joined(curves: Sequence[Curve], tolerance: float) -> tuple[list[Curve], list[tuple[int, int]]]:
    """The curves with common ends, and the numbers of the ends."""
    ends = np.array([end for curve in curves for end in (curve.start, curve.end)])
    pairs = cKDTree(ends).query_pairs(tolerance, output_type="ndarray").reshape(-1, 2)
    node_of_end = connected(pairs, len(ends))
    positions = ends[np.unique(node_of_end, return_index=True)[1]]
    nodes = [(a, b) for a, b in node_of_end.reshape(-1, 2).tolist()]
    moved = [
        curve.moved(positions[a], positions[b]) for curve, (a, b) in zip(curves, nodes, strict=True)
    ]
    return moved, nodes


def _bridged(
    curves: Sequence[Curve], nodes: Sequence[tuple[int, int]], gap: float
) -> tuple[list[Curve], list[tuple[int, int]]]:
    """The curves with loose ends joined to the loose ends next to them, up to a ``gap`` [m]."""
    positions = {
        n: end
        for c, ns in zip(curves, nodes, strict=True)
        for n, end in zip(ns, (c.start, c.end), strict=True)
    }
    degree = np.bincount(np.ravel(nodes))
    loose = np.flatnonzero(degree == 1)
    if len(loose) < 2:
        return list(curves), list(nodes)
    positions_of_loose = np.array([positions[n] for n in loose])
    distance, nearest = cKDTree(positions_of_loose).query(positions_of_loose, k=2)
    # of points at the same place the first neighbour may be either
    partner = np.where(nearest[:, 0] == np.arange(len(loose)), nearest[:, 1], nearest[:, 0])
    # a short curve is no closed one
    short = {frozenset(ns) for c, ns in zip(curves, nodes, strict=True) if c.length <= 2.0 * gap}
    renamed = {}
    for i, j in enumerate(partner.tolist()):
        pair = int(loose[i]), int(loose[j])
        if i < j and partner[j] == i and distance[i, 1] <= gap and frozenset(pair) not in short:
            renamed[pair[1]] = pair[0]
            positions[pair[0]] = 0.5 * (positions_of_loose[i] + positions_of_loose[j])
    joined = [(renamed.get(a, a), renamed.get(b, b)) for a, b in nodes]
    moved = [
        curve.moved(positions[a], positions[b])
        for curve, (a, b) in zip(curves, joined, strict=True)
    ]
    return moved, joined


def _without_curls(
    source: str, curves: Sequence[Curve], nodes: Sequence[tuple[int, int]]
) -> list[int]:
    """Numbers of the curves without curls, as programs for lasers draw them at corners.

    A curl is a closed curve that hangs on a corner of two others, and is shorter than both.
    """
    curves_at: dict[int, list[int]] = {}
    for i, ends in enumerate(nodes):
        for node in ends:
            curves_at.setdefault(node, []).append(i)
    curls = []
    for i, (start, end) in enumerate(nodes):
        sides = [curves[j].length for j in curves_at[start] if j != i]
        if start == end and len(sides) == 2 and curves[i].length < min(sides):
            curls.append(i)
    if curls:
        longest = max(curls, key=lambda i: curves[i].length)
        warnings.warn(
            f"{source}: {len(curls)} small loops that hang on corners of the outline are left "
            f"out, the longest of {1e3 * curves[longest].length:.3g} mm at "
            f"{_point(curves[longest].start)}; draw those that are holes apart from the outline",
            stacklevel=2,
        )
    return [i for i in range(len(curves)) if i not in set(curls)]


def _closed(nodes: Sequence[tuple[int, int]]) -> list[int]:
    """Numbers of the curves that belong to closed loops and meet no others."""
    degree = np.bincount(np.ravel(nodes))
    piece = connected(np.array(nodes), len(degree))
    faulty = set(piece[(degree > 0) & (degree != 2)].tolist())
    return [i for i, (node, _) in enumerate(nodes) if piece[node] not in faulty]


def _refuse_open(
    source: str, lines: Drawing, layers: Sequence[frozenset[str]], chosen: Sequence[int]
) -> None:
    """Refuse loose ends of chosen curves, and points where more than two of them meet."""
    ends_at: dict[int, list[tuple[Array, int]]] = {}
    for i in chosen:
        for node, end in zip(
            lines.nodes[i], (lines.curves[i].start, lines.curves[i].end), strict=True
        ):
            ends_at.setdefault(node, []).append((end, i))
    loose = [ends[0] for ends in ends_at.values() if len(ends) == 1]
    if loose:
        positions, gap = np.array([end for end, _ in loose]), ""
        if len(loose) > 1:
            distance = float(cKDTree(positions).query(positions[0], k=2)[0][1])
            gap = f", {1e3 * distance:.3g} mm from the nearest other end"
        raise ValueError(
            f"{source}: the outline is open: {len(loose)} curves end where no other begins, the "
            f"first at {_point(positions[0])}{_on([layers[loose[0][1]]])}{gap}; close it, give a "
            "larger gap=, or name the layers of the outline by layers=[...]"
        )
    several = [ends for ends in ends_at.values() if len(ends) > 2]
    if several:
        raise ValueError(
            f"{source}: {len(several[0])} curves meet at {_point(several[0][0][0])}"
            f"{_on([layers[i] for _, i in several[0]])}, where an outline has two; delete what is "
            "no outline, as inner lines and axes, or name the layers of the outline by "
            "layers=[...]"
        )


def _refuse_stray(
    source: str,
    lines: Drawing,
    layers: Sequence[frozenset[str]],
    stray: Sequence[int],
    region: shapely.Polygon,
    fine: float,
) -> None:
    """Refuse stray curves that meet the region of the part."""
    meeting = [
        i for i in stray if region.intersects(shapely.LineString(lines.curves[i].points(fine)))
    ]
    _refuse_open(source, lines, layers, meeting)
    if meeting:
        first = meeting[0]
        raise ValueError(
            f"{source}: a curve at {_point(lines.curves[first].start)}{_on([layers[first]])} meets "
            "the part, and is no boundary of it; delete it, or name the layers of the outline by "
            "layers=[...]"
        )


def _on(layers: Sequence[frozenset[str]]) -> str:
    """The layers of some curves, for a message."""
    names = sorted(frozenset[str]().union(*layers))
    return f" (on {', '.join(map(repr, names))})" if names else ""


def _loops(nodes: Sequence[tuple[int, int]], chosen: Sequence[int]) -> list[list[CurveSide]]:
    """Closed loops of the chosen curves: their numbers, and whether each is walked forward."""
    curves_at: dict[int, list[int]] = {}
    for i in chosen:
        for node in nodes[i]:
            curves_at.setdefault(node, []).append(i)
    unused, loops_found = set(chosen), []
    for current in chosen:
        node, loop = nodes[current][0], []
        while current in unused:
            unused.discard(current)
            forward = nodes[current][0] == node
            loop.append((current, forward))
            node = nodes[current][1 if forward else 0]
            current = next((i for i in curves_at[node] if i in unused), -1)
        loops_found += [loop] if loop else []
    return loops_found


def _faces(source: str, lines: Drawing, loops: Sequence[CurveLoop], fine: float) -> list[Face]:
    """Loops at even depth with the holes right in them."""
    shapes = [_shape(source, polygon(lines.walked(loop), fine)) for loop in loops]
    rings = [shape.exterior for shape in shapes]
    for i, j in shapely.STRtree(rings).query(rings, predicate="intersects").T:
        if i != j:
            _refuse_touching(source, rings[i].intersection(rings[j]))
    is_forward = shapely.is_ccw(rings) == (_depths(shapes) % 2 == 0)
    sides = [
        side
        for loop, forward in zip(loops, is_forward, strict=True)
        for side in _directed(loop, forward=forward)
    ]
    return [Face("design", around) for around in lines.faces_beside(sides, fine)]


def _face_around(
    source: str, lines: Drawing, loops: Sequence[CurveLoop], fine: float, inside: Array
) -> Face:
    """The face around a point: the smallest loop around it, and the loops right in that."""
    rings = [polygon(lines.walked(loop), fine) for loop in loops]
    shapes = [shapely.Polygon(ring) if len(ring) > 2 else shapely.Polygon() for ring in rings]
    # a loop that crosses itself counts only where it is the one that is meant
    sound = [shape if shape.is_valid else shapely.Polygon() for shape in shapes]
    point = shapely.Point(inside)
    around = [i for i, shape in enumerate(sound) if shape.contains(point)]
    if not around:
        low, high = (
            _point(bound(np.vstack(rings), axis=0)) if rings else "no place"
            for bound in (np.min, np.max)
        )
        raise ValueError(
            f"{source}: no closed curve lies around inside = {_point(inside)}; give a point in the "
            f"material of the part that is meant; closed curves reach from {low} to {high}"
        )

    outer, depths = min(around, key=lambda i: shapes[i].area), _depths(sound)
    is_hole = (depths == depths[outer] + 1) & shapely.within(sound, sound[outer])
    holes = np.flatnonzero(is_hole).tolist()
    sides = _directed(loops[outer], forward=sound[outer].exterior.is_ccw)
    for i in holes:
        sides += _directed(loops[i], forward=not sound[i].exterior.is_ccw)

    region = shapely.Polygon(rings[outer], [rings[i] for i in holes])
    boundary = [outer, *holes]
    for i, ring in enumerate(rings):
        edge = shapely.LinearRing(ring) if len(ring) > 2 else shapely.LineString(ring)
        limits = [shapes[j].exterior for j in boundary if j != i] if i in boundary else [region]
        for limit in limits:
            if edge.intersects(limit):
                _refuse_touching(source, edge.intersection(limit))
    (face,) = lines.faces_beside(sides, fine)
    return Face("design", face)


def _depths(shapes: Sequence[shapely.Polygon]) -> Integers:
    """How many other polygons each is within, (shapes,)."""
    inner, outer = shapely.STRtree(shapes).query(shapes, predicate="within")
    return np.bincount(inner[inner != outer], minlength=len(shapes))


def _directed(loop: CurveLoop, *, forward: bool) -> list[CurveSide]:
    """A loop as it is, or walked backwards."""
    return list(loop) if forward else [(i, not along) for i, along in reversed(loop)]


def _refuse_touching(source: str, common: shapely.Geometry) -> None:
    """Refuse two closed curves that have points in ``common``."""
    raise ValueError(
        f"{source}: two closed curves of the outline cross or touch at "
        f"{_point(shapely.get_coordinates(common)[0])}; trim them to one boundary, or name the "
        "layers of the outline by layers=[...]"
    )


def _shape(source: str, ring: Array) -> shapely.Polygon:
    """The polygon within a ring, which must not cross itself."""
    shape = shapely.Polygon(ring) if len(ring) > 2 else shapely.Polygon()
    fault = "has a closed curve without area" if shape.is_empty else ""
    if not fault and not shape.is_valid:
        reason = shapely.is_valid_reason(shape)  # "Self-intersection[x y]"
        numbers = reason.partition("[")[2].strip("]").split()
        position = _point(np.array(numbers, dtype=float)) if len(numbers) == 2 else reason
        fault = f"crosses itself at {position}"
    if fault:
        raise ValueError(f"{source}: the outline {fault}; repair it in the drawing")
    return shape


def _point(position: Array) -> str:
    return f"({1e3 * position[0]:.6g}, {1e3 * position[1]:.6g}) mm"
