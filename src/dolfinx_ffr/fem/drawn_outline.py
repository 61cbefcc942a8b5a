# SPDX-License-Identifier: MIT
"""The outline of a body in the plane as it was drawn: its edge and its holes, by the mesh alone.

A hole of a body in the plane is what a closed inner line of its outline surrounds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from dolfinx import mesh

from ..arrays import Array
from . import _compat
from .mesh_checks import facet_nodes, vertex_nodes
from .polylines import angles


@dataclass(frozen=True)
class CurveOptions:
    """What is a curve in a mesh with straight sides."""

    #: Sides of the mesh that turn by less are those of a curve: a regular decagon is a circle, an
    #: octagon is an octagon [rad]
    turn: float = 0.65
    #: How often each side of a curve is halved, its middle on the curve: chords are then 64 times
    #: nearer to it
    halvings: int = 3


CURVES = CurveOptions()


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


def flat_outline(domain: mesh.Mesh) -> shapely.Geometry:
    """The polygons that the mesh of a body in the plane covers, on every rank [m].

    Sides of the mesh that follow a curve are divided, with the new corners on it.
    """
    corners = boundary_corners(domain)[0]
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


def boundary_corners(domain: mesh.Mesh) -> tuple[Array, Array]:
    """Corners (facets, corners, dimension) [m] and outward normals of the facets of all ranks."""
    d = domain.topology.dim
    facets = mesh.exterior_facet_indices(domain.topology)
    x = domain.geometry.x[:, :d]
    corners = x[facet_nodes(domain, facets)]

    # from the middle of each facet to that of its cell
    cell_of = domain.topology.connectivity(d - 1, d)
    cells = np.array([cell_of.links(facet)[0] for facet in facets], dtype=np.int64)
    nodes = vertex_nodes(domain)[_compat.entity_vertices(domain, d)[cells]]
    cell_middles = x[nodes].reshape(len(facets), -1, d).mean(axis=1)
    inward = cell_middles - corners.mean(axis=1)

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
    for _ in range(CURVES.halvings):
        chord = np.roll(points, -1, axis=0) - points
        previous_chord = np.roll(chord, 1, axis=0)
        turn = angles(previous_chord, chord)
        turn[np.abs(turn) > CURVES.turn] = 0.0
        bulge = 0.5 * np.tan(0.125 * (turn + np.roll(turn, -1)))
        right = np.column_stack([chord[:, 1], -chord[:, 0]])
        middles = points + 0.5 * chord + bulge[:, None] * right
        points = np.stack([points, middles], axis=1).reshape(-1, 2)
    return points
