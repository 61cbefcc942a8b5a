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
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, csr_matrix, vstack

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
    polygon,
    ring,
)
from ..part import Part, PartWarning
from .curve import FreeCurve, confined
from .options import CURVES
from .sides import Loop, Loops, Run, Side, sides_of
from .symmetry import fitted


@dataclass(frozen=True, eq=False)
class Samples:
    """Points of the boundary of the material, shapes (points, ...)."""

    points: Array  #: (points, 2) [m]
    normals: Array  #: (points, 2) out of the material
    rows: csr_matrix  #: Weights of the controls, (points, controls); zero where the curve stays


@dataclass(frozen=True, eq=False)
class Boundary:
    """The boundary of one part; every rank holds all of it.

    Controls that are mirror images of each other form an *orbit*, and have the same offset along
    their normals. So the boundary moves by one offset for each orbit.

    Attributes:
        origin: Whose curves that stay are used.
        free: The curves that move, by number.
        faces: Group and loops of each face, material on the left.
        orbits: Number of the orbit of each control of each curve.
        isometries: Isometries that leave the boundary unchanged, the identity first.
        body_polygon: The body [m].
        member: Minimum member [m].
        gap: Minimum gap [m].
        rim: Width of the rim around each hole of the body's drawing [m].
        radius: Smallest radius of curvature [m].
        spacing: Distance of the controls of holes [m]; twice that in outlines.
        required: Rims of the first part, which stay material.
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
    required: shapely.Geometry

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

        Raises:
            ValueError: If a number is out of range, the part is in pieces or has lost an interface,
                nothing of its boundary can move, a curve has no mirror image, a minimum member does
                not fit into the body, or curves cross once they are smoothed.

        Warns:
            PartWarning: Of holes and islands of the design that are left out, as they are smaller
                than five squares of the minimum member. Holes of the body's drawing never are.
        """
        validation.instance("boundary: part", part, Part, "a Part, of a body in the plane")
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

        body_polygon = _body_polygon(part, CURVES.accuracy * member)
        drawn_holes = (
            _drawn_holes(part.body).boundary.buffer(CURVES.clear * member) if rim else None
        )
        near_edge = _crossing_tolerance(member)
        runs, faces = sides_of(part.drawing, body_polygon.boundary, near_edge, outline, drawn_holes)
        if not runs:
            raise ValueError(
                "boundary: interfaces, solid regions and the holes of the drawing cover the whole "
                "boundary, so that no side can move; make them smaller, or give boundary=0"
            )
        isometries = tuple(images(lines))
        # round-off of a rank may decide nothing
        curves, orbits = part.body.comm.bcast(fitted(runs, spacing, isometries))
        rough = Boundary(
            origin=part,
            free=curves,
            faces=faces,
            orbits=orbits,
            isometries=isometries,
            body_polygon=body_polygon,
            member=member,
            gap=gap,
            rim=rim,
            radius=radius,
            spacing=spacing,
            required=shapely.MultiPolygon(),
        )
        if rough._control_region.buffer(-member).is_empty:
            raise ValueError(
                f"boundary: minimum members of {1e3 * member:.4g} mm do not fit into the body; "
                "give smaller ones"
            )
        rough = rough._without_specks()
        smooth = rough.moved(np.zeros(rough.n_offsets))
        if not smooth.valid:
            raise CurveError(
                "boundary: curves cross after smoothing, because members are thinner than the "
                "controls can represent; give a smaller member or spacing, or a design without "
                "thin members"
            )
        rims = smooth._rims.intersection(smooth.material)
        return replace(smooth, required=rims.buffer(-2.0 * smooth._tolerance))

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

    def controls_of(self, key: int) -> slice:
        """The numbers of the controls of the free curve with the number ``key``."""
        return slice(self.first[key], self.first[key] + len(self.free[key].control))

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
        orbit = np.concatenate([self.orbits[key] for key in self.free])
        _, column = np.unique(orbit, return_inverse=True)
        return csr_matrix((np.ones(len(column)), (np.arange(len(column)), column)))

    @cached_property
    def leads(self) -> Mask:
        """Whether a control is the first one of its orbit, shape (controls,)."""
        leads = np.zeros(self.n_controls, dtype=bool)
        leads[np.asarray(self.expansion.argmax(axis=0)).ravel()] = True
        return leads

    def on_all_controls(self, rows: csr_matrix, key: int) -> csr_matrix:
        """The matrix of ``rows`` (m, controls of the curve ``key``) for the controls of all curves.

        Its shape is (m, controls), zero in the columns of the other curves.
        """
        coo = rows.tocoo()
        columns = coo.col + self.first[key]
        return csr_matrix((coo.data, (coo.row, columns)), (rows.shape[0], self.n_controls))

    # ------------------------------------------------------------------ its motion

    @property
    def n_offsets(self) -> int:
        """Number of independent offsets, one for each orbit."""
        return int(self.expansion.shape[1])

    @cached_property
    def fixed_offsets(self) -> Mask:
        """Whether an orbit stays, shape (orbits,)."""
        return np.asarray(self.expansion.T @ self.fixed > 0)

    def mean_of_orbits(self, values: Array) -> Array:
        """Means of ``values`` (controls,) over the controls of each orbit, (orbits,)."""
        return np.asarray(self.expansion.T @ values / self.expansion.sum(axis=0).A1)

    def metric(self, length: float) -> csc_matrix:
        """The matrix of motions that are smooth over a ``length`` [m], (orbits, orbits).

        It is 1 + length^2 times second differences along each curve; controls of open curves are
        twice as far apart as those of closed ones.
        """
        every_control = np.arange(self.n_controls)
        rows, columns, values = [every_control], [every_control], [np.ones(len(every_control))]
        for key, curve in self.free.items():
            numbers = self.first[key] + np.arange(len(curve.control))
            spacing = self.spacing if curve.closed else 2.0 * self.spacing
            weight = (length / spacing) ** 2
            if curve.closed:
                controls, following = numbers, np.roll(numbers, -1)
            else:
                controls, following = numbers[:-1], numbers[1:]
            rows += [numbers, controls, following]
            columns += [numbers, following, controls]
            values += [
                np.full(len(numbers), 2.0 * weight),
                *2 * [np.full(len(controls), -weight)],
            ]
        places = np.concatenate(rows), np.concatenate(columns)
        of_controls = csc_matrix((np.concatenate(values), places), 2 * (self.n_controls,))
        return csc_matrix(self.expansion.T @ of_controls @ self.expansion)

    def moved(self, offsets: Array) -> Boundary:
        """The boundary with its orbits moved by ``offsets`` (orbits,) along their normals [m]."""
        return self.slid((self.expansion @ offsets)[:, None] * self.normals)

    def slid(self, motion: Array) -> Boundary:
        """The boundary after a ``motion`` of its controls (controls, 2) [m].

        Curves are then moved to where they may be.
        """
        step = CURVES.clear * self.member
        free = {
            key: confined(
                curve,
                curve.control + motion[self.controls_of(key)],
                self._control_region,
                self._curve_region,
                step,
            )
            for key, curve in self.free.items()
        }
        moved = replace(self, free=free)
        # solid regions, the body and its holes stay, and regions by them are costly
        unchanged = ("_rims", "_control_region", "_curve_region", "_limit")
        moved.__dict__.update({name: getattr(self, name) for name in unchanged})
        return moved

    def free_paths(self, reach: float) -> Array:
        """How far each control may move along its normal and against it, up to ``reach`` [m].

        Shape (2, controls).
        """
        paths = []
        for key, curve in self.free.items():
            path = reach * self.normals[self.controls_of(key)]
            # where its curve may not follow, a control does not go either
            starts = (
                (curve.control, self._control_region),
                (curve.at(curve.peaks), self._curve_region),
            )
            lengths = []
            for start, region in starts:
                ends = [np.stack([start, start + sign * path], axis=1) for sign in (1.0, -1.0)]
                inside = shapely.intersection(shapely.linestrings(np.stack(ends)), region)
                lengths.append(shapely.length(inside))
            paths.append(np.min(lengths, axis=0))
        return np.hstack(paths)

    # ------------------------------------------------------------------ where curves may be

    @property
    def _accuracy(self) -> float:
        """Distance between curves and their polygons [m]."""
        return CURVES.accuracy * self.member

    @property
    def _tolerance(self) -> float:
        return _crossing_tolerance(self.member)

    @cached_property
    def _control_region(self) -> shapely.Geometry:
        """Where controls may be that are no ends."""
        return self._away_from_solid(CURVES.off_solid)

    @cached_property
    def _curve_region(self) -> shapely.Geometry:
        """Where their curves may be."""
        return self._away_from_solid(CURVES.clear)

    def _away_from_solid(self, distance: float) -> shapely.Geometry:
        """The body without rims, and without what is near solid regions, in minimum members."""
        solid = shapely.MultiPolygon(
            [self._polygon(loops) for group, loops in self.faces if group == "solid"]
        )
        # curves along the outer edge of the body pass rims there
        holes = _drawn_holes(self.body).buffer(CURVES.clear * self.member)
        inside = self.body_polygon.union(holes).buffer(-self._tolerance)
        rims = self._rims.intersection(inside)
        return self.body_polygon.difference(solid.buffer(distance * self.member)).difference(rims)

    @cached_property
    def _rims(self) -> shapely.Geometry:
        """Rims around the holes of the body's drawing, and the holes."""
        return _drawn_holes(self.body).buffer(self.rim)

    @cached_property
    def _limit(self) -> shapely.Geometry:
        """What the material stays in: the body, but for the accuracy of curves."""
        return self.body_polygon.buffer(self._tolerance)

    @property
    def valid(self) -> bool:
        """Whether no curve crosses itself, another, the outline of the body or a rim of a hole."""
        faces = [(group, self._polygon(loops)) for group, loops in self.faces]
        if not all(face.is_valid for _, face in faces):
            return False
        designed = [face for group, face in faces if group == "design"]
        overlap = sum(face.area for face in designed) - shapely.union_all(designed).area
        if overlap > self._tolerance * self.member:  # an island crosses the edge of its pocket
            return False
        material = shapely.union_all([face for _, face in faces])
        has_rims = self.required.is_empty or material.covers(self.required)
        return bool(has_rims and self._limit.covers(material))

    # ------------------------------------------------------------------ what it encloses

    def curve(self, side: Side) -> Curve:
        """The curve of a ``side``, with the material on its left."""
        curve = self._splines[side.number] if side.free else self.drawing.curves[side.number]
        return curve if side.forward else curve.reversed()

    @cached_property
    def _splines(self) -> dict[int, Curve]:
        return {key: curve.spline() for key, curve in self.free.items()}

    def _polygon(self, loops: Sequence[Loop]) -> shapely.Polygon:
        rings = [ring([self.curve(side) for side in loop], self._accuracy) for loop in loops]
        return shapely.Polygon(rings[0], rings[1:])

    @property
    def material(self) -> shapely.Geometry:
        """The enclosed material as polygons [m]."""
        return shapely.union_all([self._polygon(loops) for _, loops in self.faces])

    def _sides(self) -> Iterator[Side]:
        """The sides of all faces."""
        for _, loops in self.faces:
            for loop in loops:
                yield from loop

    def samples(self) -> Samples:
        """Points of the boundary of the material, dense beside the minimum member.

        Sides of solid regions that are beside void, as bores, are among them.
        """
        step = CURVES.sample * self.member
        points, normals, rows = [], [], []
        for key, curve in self.free.items():
            s = curve.sampled(step)
            curve_rows = curve.rows(s)
            points.append(curve_rows @ curve.control)
            normals.append(curve.normals(s))
            rows.append(self.on_all_controls(curve_rows, key))

        # sides of two faces are within the material
        faces_beside = Counter(side.number for side in self._sides() if not side.free)
        for side in self._sides():
            if side.free or faces_beside[side.number] > 1:
                continue
            fixed_curve = self.curve(side)
            count = max(int(fixed_curve.length / step), 2)
            t = (np.arange(count) + 0.5) / count
            slope = fixed_curve.slope(t)
            normal = np.column_stack([slope[:, 1], -slope[:, 0]])
            points.append(fixed_curve.at(t))
            normals.append(normal / np.linalg.norm(normal, axis=1)[:, None])
            rows.append(csr_matrix((count, self.n_controls)))
        return Samples(np.vstack(points), np.vstack(normals), csr_matrix(vstack(rows)))

    @property
    def smallest_radius(self) -> float:
        """The smallest radius of curvature of all curves that move [m]."""
        return min(curve.smallest_radius for curve in self.free.values())

    def drawn(self) -> Drawing:
        """The boundary as a drawing, to be meshed or written."""
        numbers: dict[tuple[bool, int], int] = {}
        curves: list[Curve] = []
        nodes: list[tuple[int, int]] = []
        groups: list[str] = []
        first_new_node = 1 + max(max(pair) for pair in self.drawing.nodes)

        def number(side: Side) -> int:
            key = side.free, side.number
            if key in numbers:
                return numbers[key]
            numbers[key] = len(curves)
            if side.free:
                closing_node = first_new_node + side.number
                curves.append(self._splines[side.number])
                nodes.append(self.free[side.number].nodes or (closing_node, closing_node))
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

    # ------------------------------------------------------------------ its holes

    @property
    def holes(self) -> list[int]:
        """The numbers of the closed curves around void, not of those around material."""
        outer = {loops[0][0].number for _, loops in self.faces if loops[0][0].free}
        return [key for key in self._closed if key not in outer]

    @property
    def _closed(self) -> list[int]:
        """The numbers of the closed curves, of holes and of islands in pockets."""
        return [key for key, curve in self.free.items() if curve.closed]

    def hole(self, key: int) -> shapely.Polygon:
        """The region inside the closed curve ``key``."""
        curve = self.free[key]
        return shapely.Polygon(curve.at(curve.sampled(CURVES.sample * self.member)))

    def without(self, holes: Iterable[int]) -> Boundary:
        """The boundary without some ``holes``, by the numbers of their curves.

        Islands in them go, too.
        """
        filled = shapely.union_all([self.hole(key) for key in holes])
        removed = [key for key in self._closed if filled.covers(self.hole(key))]
        return self.with_other_holes(removed, [])

    def with_other_holes(self, removed: Iterable[int], runs: Sequence[Run]) -> Boundary:
        """The boundary without ``removed`` closed curves, and with holes along runs in their face.

        Raises a ShapeError if the holes are not of one face.
        """
        removed = set(removed)
        faces_of_removed = [
            number
            for number, (_, loops) in enumerate(self.faces)
            if any(_is_closed_curve_of(loop, removed) for loop in loops)
        ]
        if runs and len(faces_of_removed) != 1:
            raise ShapeError("boundary: the holes belong to different faces")
        curves, orbits = fitted(runs, self.spacing, self.isometries)
        first_curve = 1 + max(self.free)
        first_orbit = 1 + max(int(np.max(numbers)) for numbers in self.orbits.values())

        faces = []
        for number, (group, loops) in enumerate(self.faces):
            new_loops = [loop for loop in loops if not _is_closed_curve_of(loop, removed)]
            if number in faces_of_removed:
                new_loops += [(Side(True, first_curve + key),) for key in curves]
            if new_loops:  # of an island nothing may be left
                faces.append((group, tuple(new_loops)))

        free = {key: curve for key, curve in self.free.items() if key not in removed}
        free |= {first_curve + key: curve for key, curve in curves.items()}
        all_orbits = {key: self.orbits[key] for key in free if key in self.orbits}
        all_orbits |= {first_curve + key: first_orbit + numbers for key, numbers in orbits.items()}
        return replace(self, faces=tuple(faces), free=free, orbits=all_orbits)

    def _without_specks(self) -> Boundary:
        """The boundary without holes and islands of the design that are too small; it warns."""
        drawn_holes = _drawn_holes(self.body)
        smallest = CURVES.smallest_hole * self.member**2
        specks = [
            key
            for key in self._closed
            if self.hole(key).area < smallest and not self.hole(key).intersects(drawn_holes)
        ]
        if not specks:
            return self
        centers = [1e3 * np.mean(self.free[key].control, axis=0) for key in specks]
        places = ", ".join(f"({x:.4g}, {y:.4g})" for x, y in centers)
        warnings.warn(
            f"boundary: holes or islands of the design near {places} mm are left out: each is "
            "smaller than five squares of the minimum member",
            PartWarning,
            stacklevel=4,
        )
        return self.without(specks)

    # ------------------------------------------------------------------ in a checkpoint

    def state(self) -> dict[str, NDArray[Any]]:
        """What has changed since `of`, as arrays by name."""
        keys = list(self.free)
        sides = [
            (face, loop_number, side.free, side.number, side.forward)
            for face, (_, loops) in enumerate(self.faces)
            for loop_number, loop in enumerate(loops)
            for side in loop
        ]
        return {
            "curves": np.array(keys),
            "counts": np.array([len(self.free[key].control) for key in keys]),
            "nodes": np.array([self.free[key].nodes or (-1, -1) for key in keys]),
            "control": np.vstack([self.free[key].control for key in keys]),
            "orbits": np.concatenate([self.orbits[key] for key in keys]),
            "sides": np.array(sides),
            "groups": np.array([group for group, _ in self.faces]),
        }

    def restored(self, state: Mapping[str, NDArray[Any]]) -> Boundary:
        """The boundary with that `state`, which this one had come to."""
        keys = state["curves"].tolist()
        ends = np.cumsum(state["counts"])[:-1]
        controls, orbits = (np.split(state[name], ends) for name in ("control", "orbits"))
        # a closed curve begins and ends at no node
        nodes = [None if pair[0] < 0 else (pair[0], pair[1]) for pair in state["nodes"].tolist()]
        free = dict(zip(keys, map(FreeCurve, controls, nodes), strict=True))

        loops: list[list[list[Side]]] = [[] for _ in state["groups"]]
        for face, loop, is_free, number, forward in state["sides"].tolist():
            if loop == len(loops[face]):
                loops[face].append([])
            loops[face][loop].append(Side(bool(is_free), number, bool(forward)))

        faces = tuple(
            (str(group), tuple(map(tuple, face_loops)))
            for group, face_loops in zip(state["groups"], loops, strict=True)
        )
        return replace(self, free=free, faces=faces, orbits=dict(zip(keys, orbits, strict=True)))


def _crossing_tolerance(member: float) -> float:
    """Distance by which polygons of curves may cross, as each is as far from its curve [m]."""
    return 2.0 * CURVES.accuracy * member


def _body_polygon(part: Part, accuracy: float) -> shapely.Geometry:
    """The body of a part as polygons within an ``accuracy`` [m]."""
    full = Part(part.body, lambda x: np.ones(len(x)), part.spacing, resolution=2)
    faces = [[polygon(loop, accuracy) for loop in loops] for loops in full.outlines]
    return shapely.union_all([shapely.Polygon(outer, holes) for outer, *holes in faces])


def _drawn_holes(body: Domain) -> shapely.MultiPolygon:
    """The holes of a body's drawing [m]."""
    return shapely.MultiPolygon([hole.shape for hole in body.holes if isinstance(hole, FlatHole)])


def _is_closed_curve_of(loop: Loop, curves: set[int]) -> bool:
    """Whether a loop is one of some closed curves, given by their numbers."""
    return loop[0].free and loop[0].number in curves
