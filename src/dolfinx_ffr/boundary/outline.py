# SPDX-License-Identifier: MIT
"""The boundary of a part as curves that stay and curves that move.

Interfaces, solid regions and what lies between them stay: their lines and arcs are those of the
part's drawing. So do the holes of the body's drawing, with rims of a given width around them. The
outline of the body is a limit that no curve crosses. All other sides become uniform B-splines: a
closed one for each hole, an open one for each free side of the outline between two curves that
stay.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, csr_matrix, vstack
from scipy.spatial import cKDTree

from .. import validation
from ..arrays import Array, Integers, Mask
from ..design import Isometry, Mirror, images
from ..fem import (
    Curve,
    CurveError,
    Domain,
    Drawing,
    Face,
    FlatHole,
    ShapeError,
    connected,
    polygon,
    ring,
)
from ..part import Part, PartWarning
from .curve import FreeCurve, kept
from .options import CURVES, BoundaryOptions
from .sides import Loops, Run, Side, sides_of
from .symmetry import fitted


@dataclass(frozen=True, eq=False)
class Samples:
    """Points of the boundary of the material, shapes (points, ...)."""

    points: Array  #: (points, 2) [m]
    normals: Array  #: (points, 2) out of the material
    rows: csr_matrix  #: Shares of the controls, (points, controls); zero where the curve stays


@dataclass(frozen=True, eq=False)
class Boundary:
    """The boundary of one part; every rank holds all of it.

    Attributes:
        origin: Whose curves that stay are used.
        free: The curves that move, by number.
        faces: Group and loops of each face, material on the left.
        orbits: Number of the orbit of each control of each curve: controls of one orbit are mirror
            images of each other, and have the same offset.
        isometries: Isometries that leave the boundary unchanged, the identity first.
        body_polygon: The body [m].
        member: Minimum member [m].
        gap: Minimum gap [m].
        rim: Width of the rim around each hole of the body's drawing [m].
        radius: Smallest radius of curvature [m].
        spacing: Distance of the controls of holes [m]; twice that in outlines.
        needed: Rims of the first part, which stay material.
        options: Numbers of the method.
    """

    origin: Part
    free: dict[int, FreeCurve]
    faces: Loops
    orbits: dict[int, Integers]
    isometries: tuple[Isometry, ...]
    body_polygon: shapely.Geometry
    member: float
    gap: float
    rim: float
    radius: float
    spacing: float
    needed: shapely.Geometry
    options: BoundaryOptions = CURVES

    @property
    def _fine(self) -> float:
        """Accuracy of polygons [m]."""
        return self.options.accuracy * self.member

    @property
    def _tolerance(self) -> float:
        """Distance by which polygons of curves may cross, as each is as far from its curve [m]."""
        return 2.0 * self.options.accuracy * self.member

    @staticmethod
    def of(
        part: Part,
        member: float,
        *,
        gap: float | None = None,
        rim: float | None = None,
        radius: float | None = None,
        spacing: float | None = None,
        outline: bool = True,
        mirrors: Sequence[Mirror] = (),
        options: BoundaryOptions = CURVES,
    ) -> Boundary:
        """The boundary of a part, its free sides smoothed.

        Args:
            part: A part from a level set or densities, in one piece or in pieces that a web joins.
            member: Minimum member [m].
            gap: Minimum gap [m]; by default as the member.
            rim: Width of the rim of material around each hole of the body's drawing [m]; by default
                as the member. With 0 such holes may grow and join others, but are never filled.
            radius: Smallest radius of curvature [m]; by default half a minimum gap.
            spacing: Distance of the controls of holes [m]; by default two minimum members.
            outline: Whether sides on the outer edge of the body may move, too.
            mirrors: Lines about which the part is its own mirror image, and stays it exactly.
            options: Numbers of the method.

        Raises:
            ValueError: If a number is out of range, the part is in pieces or has lost an interface,
                nothing of its boundary can move, a curve has no mirror image, a minimum member does
                not fit into the body, or curves cross once they are smoothed.

        Warns:
            PartWarning: Of holes and islands of the design that are left out, as they are smaller
                than five squares of the minimum member. Holes of the body's drawing never are.
        """
        needed = "a Part, of a body in the plane"
        validation.instance("boundary: part", part, Part, needed)
        validation.number("boundary: member", member, above=0.0, unit="m")
        gap = member if gap is None else gap
        validation.number("boundary: gap", gap, above=0.0, unit="m")
        rim = member if rim is None else rim
        validation.number("boundary: rim", rim, least=0.0, unit="m")
        # the narrowest round hole has the radius of half a gap
        radius = 0.5 * gap if radius is None else radius
        validation.number("boundary: radius", radius, least=0.0, unit="m")
        spacing = 2.0 * member if spacing is None else spacing
        validation.number("boundary: spacing", spacing, above=0.0, unit="m")
        validation.flag("boundary: outline", outline)
        lines = validation.instances("boundary: mirrors", mirrors, Mirror, "lines of symmetry")
        for line in lines:
            if len(line.normal) != 2:
                raise ValueError(f"boundary: {line} is a plane; give lines, of two components")
        if (part.pieces != 1 and not part.web) or part.lost_interfaces:
            raise ValueError(
                f"boundary: the part has {part.pieces} pieces and has lost the interfaces "
                f"{part.lost_interfaces}; take a design in one piece that all interfaces hold"
            )
        whole = Part(part.body, lambda x: np.ones(len(x)), part.spacing, resolution=2)
        rings = [
            [polygon(loop, options.accuracy * member) for loop in loops] for loops in whole.outlines
        ]
        body_polygon = shapely.union_all([shapely.Polygon(ring, holes) for ring, *holes in rings])
        drawn = _drawn_holes(part.body).boundary.buffer(options.clear * member) if rim else None
        # arcs are as near to the polygon of the outline as that is to them
        near = 2.0 * options.accuracy * member
        runs, faces = sides_of(part.drawing, body_polygon.boundary, near, outline, drawn)
        if not runs:
            raise ValueError(
                "boundary: interfaces, solid regions and the holes of the drawing cover the whole "
                "boundary, so that no side can move; make them smaller, or give boundary=0"
            )
        # the last bits of a rank may decide nothing
        alike = tuple(images(lines))
        curves, orbits = part.body.comm.bcast(fitted(runs, spacing, alike))
        sizes, none = (member, gap, rim, radius, spacing), shapely.MultiPolygon()
        found = Boundary(part, curves, faces, orbits, alike, body_polygon, *sizes, none, options)
        if found._inner.buffer(-member).is_empty:
            raise ValueError(
                f"boundary: minimum members of {1e3 * member:.4g} mm do not fit into the body; "
                "give smaller ones"
            )
        found = found._without_specks()
        found = found.moved(np.zeros(found.n_controls))
        if not found.valid:
            raise CurveError(
                "boundary: curves cross after smoothing, because members are thinner than the "
                "controls can represent; give a smaller member or spacing, or a design without "
                "thin members"
            )
        rims = found._rims.intersection(found.material)
        return replace(found, needed=rims.buffer(-2.0 * found._tolerance))

    @property
    def body(self) -> Domain:
        """The body that was designed."""
        return self.origin.body

    @property
    def drawing(self) -> Drawing:
        """Material of the part that the steps began with."""
        return self.origin.drawing

    @cached_property
    def part(self) -> Part:
        """The enclosed part, to be measured, written and verified."""
        return self.origin.redrawn(self.drawn())

    # ------------------------------------------------------------------ its controls

    @cached_property
    def first(self) -> dict[int, int]:
        """Number of the first control of each free curve."""
        starts = np.cumsum([0, *(len(curve.control) for curve in self.free.values())])
        return {key: int(start) for key, start in zip(self.free, starts, strict=False)}

    @property
    def n_controls(self) -> int:
        """Number of controls of all free curves."""
        return sum(len(curve.control) for curve in self.free.values())

    @cached_property
    def normals(self) -> Array:
        """Normals of the controls, out of the material, shape (controls, 2)."""
        return np.vstack([curve.control_normals for curve in self.free.values()])

    @cached_property
    def fixed(self) -> Mask:
        """Whether a control stays, shape (controls,)."""
        return np.concatenate([curve.fixed for curve in self.free.values()])

    @cached_property
    def expansion(self) -> csr_matrix:
        """The offset of each control by those of the orbits, (controls, orbits)."""
        number = np.concatenate([self.orbits[key] for key in self.free])
        _, column = np.unique(number, return_inverse=True)
        return csr_matrix((np.ones(len(column)), (np.arange(len(column)), column)))

    @cached_property
    def leads(self) -> Mask:
        """Whether a control is the first one of its number, shape (controls,)."""
        found = np.zeros(self.n_controls, dtype=bool)
        found[np.asarray(self.expansion.argmax(axis=0)).ravel()] = True
        return found

    def metric(self, radius: float) -> csc_matrix:
        """1 + radius^2 times second differences along each curve, (controls, controls)."""
        whole = np.arange(self.n_controls)
        rows, columns, values = [whole], [whole], [np.ones(len(whole))]
        for key, curve in self.free.items():
            own = self.first[key] + np.arange(len(curve.control))
            weight = (radius / (self.spacing * (1.0 if curve.closed else 2.0))) ** 2
            before, after = (own, np.roll(own, -1)) if curve.closed else (own[:-1], own[1:])
            rows += [own, before, after]
            columns += [own, after, before]
            values += [np.full(len(own), 2.0 * weight), *2 * [np.full(len(before), -weight)]]
        where = np.concatenate(rows), np.concatenate(columns)
        return csc_matrix((np.concatenate(values), where), 2 * (self.n_controls,))

    def wide(self, rows: csr_matrix, key: int) -> csr_matrix:
        """``rows`` on the controls of the curve ``key`` as rows on those of all."""
        coo = rows.tocoo()
        where = (coo.row, coo.col + self.first[key])
        return csr_matrix((coo.data, where), (rows.shape[0], self.n_controls))

    def moved(self, offsets: Array) -> Boundary:
        """The same with its controls moved by ``offsets`` (controls,) along their normals [m]."""
        return self.slid(offsets[:, None] * self.normals)

    def slid(self, motion: Array) -> Boundary:
        """The same with a ``motion`` of its controls, (controls, 2) [m], kept where they may be."""
        free, step = {}, self.options.clear * self.member
        for key, curve in self.free.items():
            part = slice(self.first[key], self.first[key] + len(curve.control))
            control = curve.control + motion[part]
            free[key] = kept(curve, control, self._inner, self._clear, step, self.options)
        moved = replace(self, free=free)
        # as solid regions, the body and its holes stay
        same = ("_rims", "_inner", "_clear", "_limit")
        moved.__dict__.update({name: getattr(self, name) for name in same})
        return moved

    def ways(self, reach: float) -> Array:
        """How far each control may move along its normal and against it, up to ``reach`` [m].

        Shape (2, controls).
        """
        found = []
        for key, curve in self.free.items():
            first = self.first[key]
            way = reach * self.normals[first : first + len(curve.control)]
            free = []
            # where its curve may not follow, a control does not go either
            for start, room in ((curve.control, self._inner), (curve.at(curve.peaks), self._clear)):
                lines = [np.stack([start, start + side * way], axis=1) for side in (1.0, -1.0)]
                ways = shapely.intersection(shapely.linestrings(np.stack(lines)), room)
                free.append(shapely.length(ways))
            found.append(np.min(free, axis=0))
        return np.hstack(found)

    @cached_property
    def _inner(self) -> shapely.Geometry:
        """Where controls may be that are no ends."""
        return self._off_solid(self.options.off_solid)

    @cached_property
    def _clear(self) -> shapely.Geometry:
        """Where their curves may be."""
        return self._off_solid(self.options.clear)

    def _off_solid(self, distance: float) -> shapely.Geometry:
        """The body without rims and what is near what must stay solid, in minimum members."""
        solid = shapely.MultiPolygon(
            [self._polygon(loops) for group, loops in self.faces if group == "solid"]
        )
        # curves along the outer edge of the body pass rims there
        holes = _drawn_holes(self.body).buffer(self.options.clear * self.member)
        rims = self._rims.intersection(self.body_polygon.union(holes).buffer(-self._tolerance))
        return self.body_polygon.difference(solid.buffer(distance * self.member)).difference(rims)

    @cached_property
    def _rims(self) -> shapely.Geometry:
        """Rims around the holes of the body's drawing, and the holes."""
        return _drawn_holes(self.body).buffer(self.rim)

    @cached_property
    def _limit(self) -> shapely.Geometry:
        """What the material stays in: the body, but for the accuracy of curves."""
        return self.body_polygon.buffer(self._tolerance)

    def _polygon(self, loops: Sequence[Sequence[Side]]) -> shapely.Polygon:
        rings = [ring([self.curve(side) for side in loop], self._fine) for loop in loops]
        return shapely.Polygon(rings[0], rings[1:])

    # ------------------------------------------------------------------ in a checkpoint

    def state(self) -> dict[str, NDArray[Any]]:
        """What has changed since `of`, as arrays by name."""
        keys = list(self.free)
        rows = [
            (face, loop, side.free, side.number, side.forward)
            for face, (_, loops) in enumerate(self.faces)
            for loop, sides in enumerate(loops)
            for side in sides
        ]
        return {
            "curves": np.array(keys),
            "counts": np.array([len(self.free[key].control) for key in keys]),
            "nodes": np.array([self.free[key].nodes or (-1, -1) for key in keys]),
            "control": np.vstack([self.free[key].control for key in keys]),
            "orbits": np.concatenate([self.orbits[key] for key in keys]),
            "sides": np.array(rows),
            "groups": np.array([group for group, _ in self.faces]),
        }

    def restored(self, state: Mapping[str, NDArray[Any]]) -> Boundary:
        """The boundary with that `state`, which this one had come to."""
        keys, ends = state["curves"].tolist(), np.cumsum(state["counts"])[:-1]
        controls, orbits = (np.split(state[name], ends) for name in ("control", "orbits"))
        nodes = [None if pair[0] < 0 else (pair[0], pair[1]) for pair in state["nodes"].tolist()]
        free = dict(zip(keys, map(FreeCurve, controls, nodes), strict=True))
        loops: list[list[list[Side]]] = [[] for _ in state["groups"]]
        for face, loop, *side in state["sides"].tolist():
            if loop == len(loops[face]):
                loops[face].append([])
            loops[face][loop].append(Side(bool(side[0]), side[1], bool(side[2])))
        faces = tuple(
            (str(group), tuple(map(tuple, own)))
            for group, own in zip(state["groups"], loops, strict=True)
        )
        own = dict(zip(keys, orbits, strict=True))
        return replace(self, free=free, faces=faces, orbits=own)

    # ------------------------------------------------------------------ what it encloses

    def curve(self, side: Side) -> Curve:
        """The curve of a ``side``, with the material on its left."""
        curve = self._splines[side.number] if side.free else self.drawing.curves[side.number]
        return curve if side.forward else curve.reversed()

    @cached_property
    def _splines(self) -> dict[int, Curve]:
        return {key: curve.spline() for key, curve in self.free.items()}

    @property
    def material(self) -> shapely.Geometry:
        """The enclosed material as polygons [m]."""
        return shapely.union_all([self._polygon(loops) for _, loops in self.faces])

    @property
    def sides(self) -> Iterator[tuple[str, Side]]:
        """All sides, with the group of their face."""
        for group, loops in self.faces:
            for loop in loops:
                for side in loop:
                    yield group, side

    def samples(self) -> Samples:
        """Points of the boundary of the material, dense beside the minimum member.

        Sides of solid regions that are beside void, as bores, are among them.
        """
        step = self.options.sample * self.member
        points, normals, rows = [], [], []
        for key, curve in self.free.items():
            s = curve.sampled(step)
            value = curve.rows(s)
            points.append(value @ curve.control)
            normals.append(curve.normals(s))
            rows.append(self.wide(value, key))
        # sides of two faces are within the material
        faces = Counter(side.number for _, side in self.sides if not side.free)
        for _, side in self.sides:
            if side.free or faces[side.number] > 1:
                continue
            curve_ = self.curve(side)
            count = max(int(curve_.length / step), 2)
            t = (np.arange(count) + 0.5) / count
            slope = curve_.slope(t)
            normal = np.column_stack([slope[:, 1], -slope[:, 0]])
            points.append(curve_.at(t))
            normals.append(normal / np.linalg.norm(normal, axis=1)[:, None])
            rows.append(csr_matrix((count, self.n_controls)))
        return Samples(np.vstack(points), np.vstack(normals), csr_matrix(vstack(rows)))

    @property
    def valid(self) -> bool:
        """Whether no curve crosses itself, another, the outline of the body or a rim of a hole."""
        faces = [self._polygon(loops) for _, loops in self.faces]
        if not all(face.is_valid for face in faces):
            return False
        kinds = [kind for kind, _ in self.faces]
        designed = [f for f, kind in zip(faces, kinds, strict=True) if kind == "design"]
        twice = sum(face.area for face in designed) - shapely.union_all(designed).area
        if twice > self._tolerance * self.member:  # an island crosses the edge of its pocket
            return False
        material = shapely.union_all(faces)
        rims = self.needed.is_empty or material.covers(self.needed)
        return bool(rims and self._limit.covers(material))

    @property
    def smallest_radius(self) -> float:
        """The smallest radius of curvature of all curves that move [m]."""
        return min(curve.smallest_radius for curve in self.free.values())

    @property
    def holes(self) -> list[int]:
        """The numbers of the closed curves around void, not of those around material."""
        outer = {loops[0][0].number for _, loops in self.faces if loops[0][0].free}
        return [key for key in self._closed if key not in outer]

    @property
    def _closed(self) -> list[int]:
        """The numbers of the closed curves, of holes and of islands in pockets."""
        return [key for key, curve in self.free.items() if curve.closed]

    def without(self, holes: Iterable[int]) -> Boundary:
        """The boundary without some ``holes``, by the numbers of their curves.

        Islands in them go, too.
        """
        gone = list(holes)
        filled = shapely.union_all([self.hole(key) for key in gone])
        return self._with_holes([k for k in self._closed if filled.covers(self.hole(k))], [])

    def joined(self, pair: tuple[int, int]) -> Boundary:
        """The boundary with a ``pair`` of holes made one, and their mirror images likewise.

        What is between them goes. ValueError if that is wider than six minimum members, or the
        holes are not both of one face.
        """
        keys = self.holes
        tree = cKDTree([self.hole(key).centroid.coords[0] for key in keys])
        where = tree.data[[keys.index(key) for key in pair]]
        edges = {tuple(sorted(tree.query(g(where))[1].tolist())) for g in self.isometries}
        pairs = np.array(sorted(edges))
        number = connected(pairs, len(keys))
        bays = self.options.bays * self.member
        farthest = self.options.joined * self.member
        runs, gone = [], []
        for group in np.unique(number[pairs[:, 0]]):
            among = [keys[i] for i in np.flatnonzero(number == group)]
            own = pairs[number[pairs[:, 0]] == group]
            between = [self._between(keys[i], keys[j]) for i, j in own.tolist()]
            union = shapely.union_all([*between, *(self.hole(key) for key in among)])
            union = union.buffer(bays).buffer(-bays)
            # nothing narrower than a member, which curves so coarse could not follow
            union = union.buffer(-0.5 * self.member).buffer(0.5 * self.member)
            far = self.hole(pair[0]).distance(self.hole(pair[1])) > farthest
            if far or not isinstance(union, shapely.Polygon) or union.is_empty or union.interiors:
                raise ShapeError("boundary: the holes are too far apart to be merged")
            ring = shapely.geometry.polygon.orient(union, -1.0).exterior
            runs.append(Run(np.asarray(ring.coords)[:-1], None))
            gone += among
        return self._with_holes(gone, runs)

    def struts(self) -> Iterator[tuple[tuple[int, int], shapely.Geometry]]:
        """Pairs of holes with material that can go between them, and where that and its images are.

        Of mirror images only one is a pair.
        """
        holes = {key: self.hole(key) for key in self.holes}
        keys, seen = list(holes), shapely.MultiPolygon()
        for i, j in combinations(keys, 2):
            if holes[i].distance(holes[j]) < self.options.joined * self.member:
                strut = self._between(i, j).difference(shapely.union_all([holes[i], holes[j]]))
                if strut.representative_point().intersects(seen):
                    continue
                whole = shapely.union_all([shapely.transform(strut, g) for g in self.isometries])
                seen = seen.union(whole)
                yield (i, j), whole

    def _between(self, i: int, j: int) -> shapely.Geometry:
        """What goes between two holes that are joined, and parts of these."""
        a, b = self.hole(i), self.hole(j)
        way = a.distance(b) + self.options.convex * self.member
        facing = a.intersection(b.buffer(way)), b.intersection(a.buffer(way))
        return shapely.union_all(facing).convex_hull

    def with_strut(self, ends: Array) -> Boundary:
        """The boundary with a straight strut between ``ends`` (2, 2) [m], and its mirror images.

        ValueError if there is no hole where it is, or nothing is left of it.
        """
        lines = [g(ends) for g in self.isometries]
        bars = shapely.union_all(shapely.linestrings(lines))
        bars = bars.buffer(0.5 * self.options.bar * self.member)
        gone, runs = [], []
        for key in self.holes:
            hole = self.hole(key)
            if hole.intersection(bars).area > self.member**2:
                gone.append(key)
                # only where the narrowest hole fits
                left = hole.difference(bars).buffer(-0.5 * self.gap).buffer(0.5 * self.gap)
                for piece in getattr(left, "geoms", [left]):
                    if piece.area > self.options.smallest_hole * self.member**2:
                        ring = shapely.geometry.polygon.orient(piece, -1.0).exterior
                        runs.append(Run(np.asarray(ring.coords)[:-1], None))
        if not runs:
            raise ShapeError("boundary: a strut needs a hole, but no hole is near it")
        return self._with_holes(gone, runs)

    def _with_holes(self, gone: Iterable[int], runs: Sequence[Run]) -> Boundary:
        """Without some holes, and with others along closed runs where these were."""
        left = set(gone)
        inside = [
            n for n, (_, loops) in enumerate(self.faces) if any(_is_hole(x, left) for x in loops)
        ]
        if runs and len(inside) != 1:
            raise ShapeError("boundary: the holes belong to different faces")
        beyond = 1 + max(self.free)
        curves, orbits = fitted(runs, self.spacing, self.isometries)
        alike = 1 + max(int(np.max(numbers)) for numbers in self.orbits.values())
        faces = []
        for n, (group, loops) in enumerate(self.faces):
            kept = [loop for loop in loops if not _is_hole(loop, left)]
            if n in inside:
                kept += [(Side(True, beyond + k),) for k in curves]
            if kept:  # of an island nothing may be left
                faces.append((group, tuple(kept)))
        free = {k: c for k, c in self.free.items() if k not in left}
        free |= {beyond + k: curve for k, curve in curves.items()}
        own = {k: self.orbits[k] for k in free if k in self.orbits}
        own |= {beyond + k: alike + numbers for k, numbers in orbits.items()}
        return replace(self, faces=tuple(faces), free=free, orbits=own)

    def hole(self, key: int) -> shapely.Polygon:
        """The region inside the closed curve ``key``."""
        curve = self.free[key]
        return shapely.Polygon(curve.at(curve.sampled(self.options.sample * self.member)))

    def _below(self, share: float) -> list[int]:
        """The numbers of closed curves around less than so many squares of the minimum member."""
        return [key for key in self._closed if self.hole(key).area < share * self.member**2]

    def _without_specks(self) -> Boundary:
        """Without holes and islands of the design that are too small, which is warned of."""
        drawn = _drawn_holes(self.body)
        small = self._below(self.options.smallest_hole)
        specks = [key for key in small if not self.hole(key).intersects(drawn)]
        if not specks:
            return self
        centers = [1e3 * np.mean(self.free[key].control, axis=0) for key in specks]
        near = ", ".join(f"({x:.4g}, {y:.4g})" for x, y in centers)
        warnings.warn(
            f"boundary: holes or islands of the design near {near} mm are left out: each is "
            "smaller than five squares of the minimum member",
            PartWarning,
            stacklevel=4,
        )
        return self.without(specks)

    def drawn(self) -> Drawing:
        """The boundary as a drawing, to be meshed or written."""
        numbers: dict[tuple[bool, int], int] = {}
        curves: list[Curve] = []
        nodes: list[tuple[int, int]] = []
        groups: list[str] = []
        beyond = 1 + max(max(pair) for pair in self.drawing.nodes)

        def number(side: Side) -> int:
            key = side.free, side.number
            if key not in numbers:
                numbers[key] = len(curves)
                if side.free:
                    own = beyond + side.number
                    curves.append(self._splines[side.number])
                    nodes.append(self.free[side.number].nodes or (own, own))
                    groups.append("")
                else:
                    curves.append(self.drawing.curves[side.number])
                    nodes.append(self.drawing.nodes[side.number])
                    groups.append(self.drawing.groups[side.number])
            return numbers[key]

        faces = [
            Face(group, [[(number(side), side.forward) for side in loop] for loop in loops])
            for group, loops in self.faces
        ]
        return Drawing(curves, nodes, groups, faces)


def _drawn_holes(body: Domain) -> shapely.MultiPolygon:
    """The holes of a body's drawing [m]."""
    return shapely.MultiPolygon([hole.shape for hole in body.holes if isinstance(hole, FlatHole)])


def _is_hole(loop: Sequence[Side], holes: set[int]) -> bool:
    return loop[0].free and loop[0].number in holes
