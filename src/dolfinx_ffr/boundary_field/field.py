# SPDX-License-Identifier: MIT
"""The boundary of a body as the zero of a spline field, positive in the material."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self, TypeVar

import numpy as np
import shapely
from scipy.sparse import csc_matrix, csr_matrix, diags, eye
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from ..arrays import Array, Mask
from ..design import HoleRims, Isometry, Mirror, images
from ..fem import Domain, ElasticMaterial, FlatHole, ShapeError, with_rims
from ..parallel import on_rank_0
from ..part import Part, solid_regions
from .drawing import BodyDrawing, FieldDrawing, designed_faces
from .options import FieldOptions
from .spline_grid import SplineGrid

#: How a symmetric positive definite matrix is factored with few entries
SYMMETRIC: dict[str, Any] = {
    "permc_spec": "MMD_AT_PLUS_A",
    "diag_pivot_thresh": 0.0,
    "options": {"SymmetricMode": True},
}
#: Rounds that bring the largest zero into the outline, within a hundredth of a spacing at a notch
_INSIDE = 12


@dataclass(frozen=True, eq=False)
class FieldSpace:
    """What all boundary fields of one body have in common."""

    grid: SplineGrid
    body: Domain  #: The body that is designed
    material: ElasticMaterial | None  #: Of the part
    upper: Array  #: Largest variables, which keep the material inside the outline [m]
    held: Mask  #: Variables that stay, as they are near an interface that nothing keeps solid
    isometries: Sequence[Isometry]  #: That leave every field, the identity first
    rims: HoleRims  #: Around the holes of the body's drawing
    member: float  #: Minimum member [m]
    gap: float  #: Minimum gap [m]
    radius: float  #: Minimum radius of curvature [m]
    volume: float  #: Largest share of the body that has the full thickness
    web: float  #: Thickness in voids, as a share of the part's: pockets are milled there
    strip: shapely.Geometry  #: Along an outline that is kept, where material stays [m]
    options: FieldOptions

    @staticmethod
    def of(
        body: Domain,
        member: float,
        gap: float,
        *,
        radius: float | None = None,
        volume: float = 1.0,
        rim: float = 0.0,
        outline: bool = True,
        web: float = 0.0,
        mirrors: Sequence[Mirror] = (),
        material: ElasticMaterial | None = None,
        options: FieldOptions = FieldOptions(),  # noqa: B008
    ) -> FieldSpace:
        """The fields of a ``body`` with minimum sizes [m]; a minimum radius is half a gap.

        Where sizes are mended, the ``volume``, a share of the body, is kept as well. Without
        ``outline`` the outer edge of the body stays, and with a ``web`` it has to.
        """
        isometries = images(mirrors)
        axes = np.eye(2)
        if mirrors:
            normal = np.array(mirrors[0].normal) / np.linalg.norm(mirrors[0].normal)
            axes = np.array([normal, [-normal[1], normal[0]]])
        corners = shapely.get_coordinates(body.outline)
        grid = SplineGrid.around(corners, options.spacing * member, isometries, axes)
        radius = 0.5 * gap if radius is None else radius
        upper, strip = _distance_to_outline(body, grid), shapely.MultiPolygon()
        if not outline:
            # no field is as large as a body
            upper = np.full(grid.size, float(np.linalg.norm(np.ptp(corners, axis=0))))
            inner = _within_edges(body).buffer(-options.spare * member - radius).buffer(radius)
            strip = body.outline.difference(inner)
        rims = HoleRims(body, rim)
        sizes = (member, gap, radius, volume, web, strip, options)
        held = _near_undefended(body, grid, rims)
        return FieldSpace(grid, body, material, upper, held, isometries, rims, *sizes)

    def bounded(self, variables: Array) -> Array:
        """The ``variables`` where they are no larger than they may be."""
        return np.minimum(variables, self.upper)

    @cached_property
    def full(self) -> Part:
        """All of the body as a part."""
        # its spacing tells the accuracy of polygons
        return Part(
            self.body,
            lambda x: np.ones(len(x)),
            self.member,
            material=self.material,
            resolution=2,
            web=self.web,
        )

    @cached_property
    def solid(self) -> shapely.Geometry:
        """What of the body stays solid, rims around the holes of its drawing among it [m]."""
        solid = shapely.union_all([self._regions, *self._rims_of_holes.values()])
        shapely.prepare(solid)
        return solid

    @cached_property
    def _regions(self) -> shapely.Geometry:
        """What of the body stays solid without its rims [m]."""
        return shapely.union_all(solid_regions(self.full))

    @cached_property
    def _rims_of_holes(self) -> dict[int, shapely.Geometry]:
        """The rims by the number of the hole, where nothing else stays solid as widely [m]."""
        if not self.rims.width:
            return {}
        stays = self._regions.buffer(1e-2 * self.rims.width)
        return {
            number: rim
            for number, (_, rim) in enumerate(self.rims.regions)
            if not stays.covers(rim)
        }

    @cached_property
    def drawn_corners(self) -> shapely.Geometry:
        """Where the body's outline is sharper than the minimum radius, inside and outside [m]."""
        outline, radius = self.body.outline, self.options.spare * self.radius
        inside = outline.difference(outline.buffer(-radius).buffer(radius))
        outside = outline.buffer(radius).buffer(-radius).difference(outline)
        fine = self._accuracy
        corners = shapely.union_all([inside, outside]).buffer(-0.5 * fine).buffer(fine)
        shapely.prepare(corners)
        return corners

    @property
    def drawn_holes(self) -> list[shapely.Polygon]:
        """The holes of the body's drawing [m]."""
        return [hole.shape for hole in self.body.holes if isinstance(hole, FlatHole)]

    @cached_property
    def body_drawing(self) -> BodyDrawing:
        """The drawing of the full body, divided where its rims end."""
        drawing, step = self.full.drawing, 0.5 * self.grid.spacing
        if self._rims_of_holes:
            rimmed = [self.drawn_holes[number].boundary for number in self._rims_of_holes]
            holes = shapely.union_all(rimmed)
            fine = 1e-3 * self.rims.width
            points = [curve.points(fine) for curve in drawing.curves]
            near = holes.buffer(10.0 * fine)
            held = [np.full(len(x) - 1, near.covers(shapely.LineString(x))) for x in points]
            drawing = with_rims(drawing, points, held, self.rims.width)
        joined = self.web > 0.0
        return BodyDrawing.of(drawing, self.solid.buffer(1e-3 * step), step, joined)

    @cached_property
    def designed(self) -> shapely.Geometry:
        """Where the field decides [m]."""
        return self.body_drawing.designed

    @cached_property
    def drawn_lines(self) -> shapely.Geometry:
        """The boundary of the designed region [m]."""
        lines = self.designed.boundary
        shapely.prepare(lines)
        return lines

    @property
    def _accuracy(self) -> float:
        """Distance of polygons that stand for the same curve, at most [m]."""
        return 0.02 * self.grid.spacing

    @cached_property
    def all_rows(self) -> csr_matrix:
        """The shares of the variables on a raster of half a spacing over the grid."""
        return self.grid.rows(self._raster)

    @property
    def _raster(self) -> Array:
        counts = [np.arange(-2 * n, 2 * n + 1) for n in self.grid.half]
        steps = np.stack(np.meshgrid(*counts, indexing="ij"), axis=-1).reshape(-1, 2)
        return np.asarray(self.grid.center + 0.5 * self.grid.spacing * steps @ self.grid.axes)

    @cached_property
    def near(self) -> Mask:
        """Which points of the raster tell a field: the designed region, and beside its outline."""
        return self._tells(self._raster)

    @cached_property
    def near_nodes(self) -> Mask:
        """Which nodes of the grid tell a field."""
        return self._tells(self.grid.nodes)

    def _tells(self, points: Array) -> Mask:
        """Not what stays and holes: there a field goes on smoothly, and no zero is along it."""
        inner = _within_edges(self.body)
        region = self.designed.buffer(self.grid.spacing).difference(inner).union(self.designed)
        shapely.prepare(region)
        return np.asarray(shapely.contains_xy(region, *points.T))

    @property
    def raster(self) -> Array:
        """Those points, (n, 2) [m]."""
        return self._raster[self.near]

    @cached_property
    def raster_rows(self) -> csr_matrix:
        """The shares of the variables there, (n, variables)."""
        return self.all_rows[self.near]

    @cached_property
    def _fit(self) -> Any:
        """The factor of the least squares by which values on the raster tell a field."""
        matrix = (
            self.raster_rows.T @ self.raster_rows + self.options.bending_weight * self.grid.bending
        )
        return splu(csc_matrix(matrix + 1e-9 * eye(self.grid.size)), **SYMMETRIC)

    def fitted(self, values: Array) -> BoundaryField:
        """The smooth field nearest to ``values`` (n,) at the points of the raster."""
        variables = self._fit.solve(self.raster_rows.T @ values)
        return BoundaryField(self, self.bounded(variables))

    def of_material(self, material: shapely.Geometry) -> BoundaryField:
        """The field of a ``material``, whose boundary moves where it is not that of what stays."""
        fixed = shapely.union_all([self.body.outline.boundary, self.solid.boundary])
        edge = material.boundary.difference(fixed.buffer(self._accuracy))
        far = self.options.cut_off * self.grid.spacing
        distance = self._signed_distance(material, edge, self.raster, far)
        field = self.fitted(np.minimum(distance, self.raster_rows @ self.upper))
        # far from the edge the outline is the boundary, which a fit would only come near to
        inner = self._signed_distance(material, edge, self.grid.nodes, far) >= far
        return field.with_variables(np.where(inner, far, field.variables))

    def _signed_distance(
        self, material: shapely.Geometry, edge: shapely.Geometry, points: Array, far: float
    ) -> Array:
        """The distance of ``points`` from an edge, negative in void, ``far`` at most, (n,) [m]."""
        distance = np.full(len(points), far)
        if not edge.is_empty:
            dense = shapely.segmentize(edge, 0.1 * self.grid.spacing)
            nearest, _ = cKDTree(shapely.get_coordinates(dense)).query(points)
            distance = np.minimum(nearest, far)
        # polygons of one curve differ by their accuracy, which is neither void nor material
        void, filled = (
            region.buffer(-self._accuracy).buffer(self._accuracy)
            for region in (
                self.designed.difference(material),
                self.designed.intersection(material),
            )
        )
        shapely.prepare([void, filled])
        solid = shapely.contains_xy(filled, *points.T)
        # beside the designed region a point is as the region is there, so that no zero is along it
        beyond = np.flatnonzero(~solid & ~shapely.contains_xy(void, *points.T))
        places = shapely.points(points[beyond])
        to_void = np.full(len(beyond), np.inf) if void.is_empty else shapely.distance(void, places)
        solid[beyond] = ~(to_void < shapely.distance(filled, places))
        return np.where(solid, distance, -distance)


def _distance_to_outline(body: Domain, grid: SplineGrid) -> Array:
    """The distance from the outer edge of a body at each variable, negative outside [m].

    A spline field of a distance differs from it where the edge is curved or has a corner, which a
    few corrections of the variables make good.
    """
    inside = _within_edges(body)
    shapely.prepare(inside)
    points = shapely.points(grid.nodes)
    sign = np.where(shapely.contains(inside, points), 1.0, -1.0)
    distance = sign * shapely.distance(inside.boundary, points)
    values, upper = grid.rows(grid.nodes), distance
    for _ in range(4):
        error = distance - values @ upper
        upper = upper + np.clip(error, -0.5 * grid.spacing, 0.5 * grid.spacing)
    # in a notch, whose distance no spline follows, the material stays inside
    on_edge = grid.rows(shapely.get_coordinates(inside.boundary.segmentize(0.25 * grid.spacing)))
    shares = np.maximum(on_edge.T @ np.ones(on_edge.shape[0]), 1e-9)
    for _ in range(_INSIDE):
        upper = upper - 1.5 * (on_edge.T @ np.maximum(on_edge @ upper, 0.0)) / shares
    return np.asarray(upper)


def _within_edges(body: Domain) -> shapely.Geometry:
    """The region within the outer edges of a body, with its holes [m]."""
    edges = [shapely.Polygon(piece.exterior) for piece in shapely.get_parts(body.outline)]
    return shapely.union_all(edges)


def _near_undefended(body: Domain, grid: SplineGrid, rims: HoleRims) -> Mask:
    """Variables that count at an interface along which cells are designed and no rim is."""
    undefended = [n for n in body.designed_interfaces if not (rims.width and body.on_hole(n))]
    held = np.zeros(grid.size, dtype=bool)
    if undefended:
        whole = Part(body, lambda x: np.ones(len(x)), grid.spacing, resolution=2)
        for name in undefended:
            for curve in whole.interface(name):
                count = max(2, int(2.0 * curve.length / grid.spacing))
                held[grid.rows(curve.at(np.linspace(0.0, 1.0, count))).indices] = True
    return held


@dataclass(frozen=True, eq=False)
class Edge:
    """Points on the boundary of a part, half a sample from its corners at least."""

    points: Array  #: (n, 2) [m]
    normals: Array  #: Out of the material, (n, 2)
    lengths: Array  #: Of boundary for which each stands, (n,) [m]
    moves: Mask  #: Whether it moves with the zero of the field, (n,)
    slopes: Array  #: |grad phi|, (n,)
    rows: csr_matrix  #: Motion along the normal by each variable, zero where it stays, (n, v)
    beside: float  #: Area between the zero of the field and its chords [m^2]


@dataclass(frozen=True, eq=False)
class BoundaryField:
    """One boundary: where the field of some variables is zero."""

    space: FieldSpace
    variables: Array  #: (variables,) [m]

    @property
    def body(self) -> Domain:
        """The body that is designed."""
        return self.space.body

    def with_variables(self, variables: Array) -> Self:
        """The field of other ``variables``, as far as these are allowed."""
        return replace(self, variables=self.space.bounded(variables))

    def spline(self, points: Array) -> Array:
        """The spline field at ``points`` (n, 2) [m], (n,) [m]."""
        return self.space.grid.value(self.variables, points)

    def gradient(self, points: Array) -> Array:
        """Its gradient, (n, 2)."""
        return self.space.grid.gradient(self.variables, points)

    def derivatives(self, points: Array) -> tuple[Array, Array]:
        """Its value (n,) [m] and gradient (n, 2) at ``points`` (n, 2) [m]."""
        value, gradient = self.space.grid.derivatives(self.variables, points, 1)
        return value, gradient

    @cached_property
    def on_raster(self) -> Array:
        """The spline field on a raster of half a spacing over the grid, (2 n + 1 each way)."""
        return np.asarray(self.space.all_rows @ self.variables).reshape(
            4 * self.space.grid.half + 1
        )

    @cached_property
    def part(self) -> Part:
        """What the field encloses; a ShapeError if it falls apart."""
        drawing = on_rank_0(
            self.space.body.comm,
            lambda: FieldDrawing(self, self.space.grid, self.space.body_drawing).drawing,
        )
        return self.space.full.redrawn(drawing)

    @cached_property
    def material(self) -> shapely.Polygon | shapely.MultiPolygon:
        """The region of its largest piece, between chords of its zero; a ShapeError if empty.

        Where a web joins them, it is that of all pieces.
        """
        drawing = self.space.body_drawing
        faces = [*designed_faces(self, self.space.grid, drawing), drawing.kept]
        # neighbors share an edge to round-off
        joined = shapely.union_all(faces, grid_size=1e-6 * drawing.step)
        pieces = [piece for piece in shapely.get_parts(joined) if piece.area > 0.0]
        if not pieces:
            raise ShapeError("boundary: there is no material")
        if self.space.web:
            return shapely.MultiPolygon([shapely.geometry.polygon.orient(p) for p in pieces])
        return shapely.geometry.polygon.orient(max(pieces, key=lambda piece: piece.area))

    @property
    def holes(self) -> list[shapely.LinearRing]:
        """The inner edges of its material."""
        return [ring for piece in shapely.get_parts(self.material) for ring in piece.interiors]

    @property
    def area(self) -> float:
        """The area of its material, without the curves of its part [m^2]."""
        return float(self.material.area + self.edge.beside)

    @cached_property
    def edge(self) -> Edge:
        """Points on all of its boundary, a sample apart."""
        step = self.space.options.sample * self.space.member
        outer = [piece.exterior for piece in shapely.get_parts(self.material)]
        rings = [*outer, *self.holes]
        samples = [spread(shapely.get_coordinates(ring)[:-1], step) for ring in rings]
        points, normals, lengths = (np.concatenate(x) for x in zip(*samples, strict=True))
        return self._edge(points, normals, lengths)

    def _edge(self, points: Array, normals: Array, lengths: Array) -> Edge:
        grid, near = self.space.grid, self.space.options.on_zero * self.space.grid.spacing
        value, gradient = grid.derivatives(self.variables, points, 1)
        slopes = np.linalg.norm(gradient, axis=1)
        places = shapely.points(points)
        drawn = shapely.dwithin(self.space.drawn_lines, places, 1e-3 * grid.spacing)
        # away from the body's drawing these points are on chords of the zero
        moves = ~drawn | (np.abs(value) < near * slopes)
        moves[moves] = ~self._fixed(points[moves], places[moves])

        value, gradient, moved = value[moves], gradient[moves], points[moves]
        beside = 0.0
        for _ in range(2):
            size = np.maximum(np.linalg.norm(gradient, axis=1), 1e-6)
            way = np.clip(value / size, -0.25 * grid.spacing, 0.25 * grid.spacing)
            beside += float(lengths[moves] @ way)
            moved = moved - (way / size)[:, None] * gradient
            value, gradient = grid.derivatives(self.variables, moved, 1)
        points, normals = points.copy(), normals.copy()
        points[moves] = moved
        # a field without a slope has no zero that moves
        slopes[moves] = np.maximum(np.linalg.norm(gradient, axis=1), 1e-300)
        normals[moves] = -gradient / slopes[moves, None]

        motion = csr_matrix(diags(1.0 / slopes[moves]) @ grid.rows(moved))
        of_row = np.zeros(len(points), dtype=np.int64)
        of_row[moves] = np.diff(motion.indptr)
        ends = np.concatenate([[0], np.cumsum(of_row)])
        rows = csr_matrix((motion.data, motion.indices, ends), (len(points), grid.size))
        return Edge(points, normals, lengths, moves, slopes, rows, beside)

    def _fixed(self, points: Array, places: Array) -> Mask:
        """Whether ``points`` of the boundary are sides of what stays solid, or of rims."""
        near = 1e-3 * self.space.grid.spacing
        solid = shapely.dwithin(self.space.solid, places, near)
        return np.asarray(solid | (self.space.rims.margin(points) > -near))


#: A kind of boundary field
AnyField = TypeVar("AnyField", bound=BoundaryField)


def spread(ring: Array, step: float) -> tuple[Array, Array, Array]:
    """Points about a ``step`` apart on a ring around material on its left, normals and lengths."""
    side = np.roll(ring, -1, axis=0) - ring
    length = np.linalg.norm(side, axis=1)
    along = np.concatenate([[0.0], np.cumsum(length)])
    count = max(3, int(np.ceil(along[-1] / step)))
    at = (np.arange(count) + 0.5) / count * along[-1]
    number = np.clip(np.searchsorted(along, at, side="right") - 1, 0, len(ring) - 1)
    way = side[number] / np.maximum(length[number], 1e-300)[:, None]
    points = ring[number] + (at - along[number])[:, None] * way
    normals = np.column_stack([way[:, 1], -way[:, 0]])
    return points, normals, np.full(count, along[-1] / count)
