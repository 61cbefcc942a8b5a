# SPDX-License-Identifier: MIT
"""The outline of a body as it was drawn: its outer edge and its holes, by the mesh alone.

A hole of a body in the plane is what a closed inner line of its outline surrounds. A hole of a body
in space is a cylinder that its surface follows all around, with the material outside of it: a bore.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from dolfinx import mesh

from ..arrays import Array, Integers
from . import _compat
from .interface import fit_cylinder
from .mesh_checks import connected, facet_nodes, vertex_nodes

#: Sides of the mesh that turn by less are those of a curve: a regular decagon is a circle, an
#: octagon is an octagon [rad]
_CURVED = 0.65
#: How often each side of a curve is halved, its middle on the curve: chords are then 64 times
#: nearer to it
_HALVINGS = 3
#: Distance of points from the cylinder that they are on, in radii, and share of a facet's normal
#: along the axis, as triangles on a coarse cylinder are inclined
_ON_CYLINDER, _INCLINED = 1e-3, 0.3
#: Distance of points that are one, in sizes of the body
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class FlatHole:
    """A hole of a body in the plane."""

    shape: shapely.Polygon  #: What the hole is [m]

    @property
    def center(self) -> Array:
        """Centroid of the hole, shape (2,) [m]."""
        return np.array(self.shape.centroid.coords[0])

    @property
    def box(self) -> Array:
        """Lower and upper corner around the hole, shape (2, 2) [m]."""
        return np.reshape(self.shape.bounds, (2, 2))

    def distance(self, points: Array) -> Array:
        """The distance of ``points`` (n, 2) from the hole, zero inside, (n,) [m]."""
        shapely.prepare(self.shape)
        return np.asarray(shapely.distance(self.shape, shapely.points(points)))


@dataclass(frozen=True, eq=False)
class RoundHole:
    """A round hole of a body in space."""

    center: Array  #: The middle of its axis, shape (3,) [m]
    axis: Array  #: Unit vector, shape (3,)
    radius: float  #: [m]
    length: float  #: Of the cylinder along its axis [m]
    walls: Array  #: Centroids of the facets on the cylinder, shape (facets, 3) [m]

    @property
    def box(self) -> Array:
        """Lower and upper corner around the hole, shape (2, 3) [m]."""
        reach = 0.5 * self.length * np.abs(self.axis) + self.radius
        return np.array([self.center - reach, self.center + reach])

    def distance(self, points: Array) -> Array:
        """The distance of ``points`` (n, 3) from the cylinder, zero inside, (n,) [m]."""
        offset = points - self.center
        along = offset @ self.axis
        across = np.linalg.norm(offset - along[:, None] * self.axis, axis=1) - self.radius
        beyond = np.abs(along) - 0.5 * self.length
        return np.hypot(np.maximum(across, 0.0), np.maximum(beyond, 0.0))


#: A hole in the drawing of a body: it has no material, and material around it
DrawnHole = FlatHole | RoundHole


def flat_outline(domain: mesh.Mesh) -> shapely.Geometry:
    """The polygons that the mesh of a body in the plane covers, on every rank [m].

    Sides of the mesh that follow a curve are divided, with the new corners on it.
    """
    corners = _boundary_corners(domain)[0]
    area = shapely.build_area(shapely.multilinestrings(shapely.linestrings(corners)))
    polygons = [
        shapely.Polygon(_on_curves(piece.exterior), [_on_curves(ring) for ring in piece.interiors])
        for piece in shapely.get_parts(area)
    ]
    return shapely.union_all(polygons)


def flat_holes(outline: shapely.Geometry) -> list[FlatHole]:
    """The holes of an outline in the plane."""
    rings = [ring for piece in shapely.get_parts(outline) for ring in piece.interiors]
    return [FlatHole(shapely.Polygon(ring)) for ring in rings]


def bores(domain: mesh.Mesh) -> list[RoundHole]:
    """The round holes of a body in space, on every rank."""
    corners, outward = _boundary_corners(domain)
    smooth = _smooth_patches(corners, outward)
    patches = [np.flatnonzero(smooth == number) for number in range(smooth.max(initial=-1) + 1)]
    candidates = (_bore(corners[patch], outward[patch]) for patch in patches)
    return [bore for bore in candidates if bore is not None]


def _boundary_corners(domain: mesh.Mesh) -> tuple[Array, Array]:
    """Corners (facets, corners, dimension) [m] and outward normals of the facets of all ranks."""
    d = domain.topology.dim
    boundary_facets = mesh.locate_entities_boundary(
        domain, d - 1, lambda x: np.full(x.shape[1], True)
    )
    facets = boundary_facets[boundary_facets < domain.topology.index_map(d - 1).size_local]
    x = domain.geometry.x[:, :d]
    corners = x[facet_nodes(domain, facets)]
    cell_of = domain.topology.connectivity(d - 1, d)
    cells = np.array([cell_of.links(facet)[0] for facet in facets], dtype=np.int64)
    nodes = vertex_nodes(domain)[_compat.entity_vertices(domain, d)[cells]]
    middles = corners.mean(axis=1)
    inward = x[nodes].reshape(len(facets), -1, d).mean(axis=1) - middles
    if d == 2:
        along = corners[:, 1] - corners[:, 0]
        normal = np.column_stack([along[:, 1], -along[:, 0]])
    else:
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= -np.sign(np.einsum("fi,fi->f", normal, inward))[:, None]
    gathered = domain.comm.allgather((corners, normal))
    return tuple(np.concatenate(arrays) for arrays in zip(*gathered, strict=True))


def _on_curves(ring: shapely.LinearRing) -> Array:
    """The corners of a ring, and others between them where it follows a curve, (n, 2) [m].

    Two sides that turn by a small angle are chords of one circle, whose middle is half a chord
    times the tangent of a quarter of that angle away from the chord.
    """
    points = shapely.get_coordinates(ring)[:-1]
    for _ in range(_HALVINGS):
        chord = np.roll(points, -1, axis=0) - points
        previous_chord = np.roll(chord, 1, axis=0)
        cross = previous_chord[:, 0] * chord[:, 1] - previous_chord[:, 1] * chord[:, 0]
        turn = np.arctan2(cross, np.einsum("ij,ij->i", previous_chord, chord))
        turn[np.abs(turn) > _CURVED] = 0.0
        bulge = 0.5 * np.tan(0.125 * (turn + np.roll(turn, -1)))
        right = np.column_stack([chord[:, 1], -chord[:, 0]])
        middles = points + 0.5 * chord + bulge[:, None] * right
        points = np.stack([points, middles], axis=1).reshape(-1, 2)
    return points


def _smooth_patches(corners: Array, outward: Array) -> Integers:
    """Number of the patch of each facet; facets of one patch meet without an edge, (facets,)."""
    count, around, d = corners.shape
    flat = corners.reshape(-1, d)
    step = _SAME * float(np.max(np.ptp(flat, axis=0)))
    node = np.unique(np.round(flat / step), axis=0, return_inverse=True)[1].reshape(count, around)
    # the corners of quadrilaterals are in the order of a tensor product
    sides = [(0, 1), (1, 2), (2, 0)] if around == 3 else [(0, 1), (1, 3), (3, 2), (2, 0)]
    ends = np.sort(node[:, sides], axis=2).reshape(-1, 2)
    facet = np.repeat(np.arange(count), len(sides))
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    ends, facet = ends[order], facet[order]
    shared = np.flatnonzero(np.all(ends[1:] == ends[:-1], axis=1))
    pairs = np.column_stack([facet[shared], facet[shared + 1]])
    cosine = np.einsum("pi,pi->p", outward[pairs[:, 0]], outward[pairs[:, 1]])
    return connected(pairs[cosine > np.cos(_CURVED)], count)


def _bore(corners: Array, outward: Array) -> RoundHole | None:
    """The bore whose wall is a patch of facets, None where the patch is no such wall."""
    _, spread, axes = np.linalg.svd(outward, full_matrices=False)
    if len(outward) < 5 or spread[2] > _INCLINED * spread[0] or spread[1] < _INCLINED * spread[0]:
        return None
    points = corners.reshape(-1, 3)
    cylinder = fit_cylinder(points, axes[2])
    if cylinder is None:
        return None
    middle, axis = cylinder
    along = (points - middle) @ axis
    radial = points - middle - along[:, None] * axis
    away = np.linalg.norm(radial, axis=1)
    radius = float(away.mean())
    walls = corners.mean(axis=1)
    from_axis = np.cross(np.cross(axis, walls - middle), axis)
    convex = np.einsum("fi,fi->f", outward, from_axis) > 0.0
    first_direction, second_direction = np.linalg.svd(axis[None, :])[2][1:]
    angles = np.sort(np.arctan2(radial @ second_direction, radial @ first_direction))
    gaps = np.diff(angles, append=angles[0] + 2.0 * np.pi)
    on_it = np.max(np.abs(away - radius)) < _ON_CYLINDER * radius
    if not on_it or np.any(convex) or np.max(gaps) > 2.0 * _CURVED:
        return None
    center = middle + 0.5 * (along.min() + along.max()) * axis
    return RoundHole(center, axis, radius, float(np.ptp(along)), walls)
