# SPDX-License-Identifier: MIT
"""Walls of a solid no thinner than a minimum, as constraints on the motion of its surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from .sizes import SEEN, SPARE, Rows
from .surface import Surface

Array = NDArray[np.float64]

#: Product of the direction and the normal across the wall, beyond which it is one where it is
#: thinnest, and no wedge: the thickness changes by the tangent of their angle along the surface
_ACROSS = 0.985
#: What a wall without thickness costs, as share of psi, over its cell's share of the body: some
#: times what as much material is worth
_COST = 25.0
#: Most constraints of one body: the thinnest walls
_MOST = 300


def wall_rows(surface: Surface, dear: float = 1.0) -> Rows:
    """1 - d / d_min for the thinnest walls, one in each cell of the grid of the motion.

    The thickness d is the way through the material along the normal of the field to a triangle that
    lies across it. At its ends it grows as the surface moves outwards. Violations cost the more the
    larger the factor ``dear`` is.
    """
    least = SPARE * surface.member
    points, part = surface.moving, surface.part
    start, inward = surface.probes()
    ray, triangle, way, weights = _hits(start, inward, part.points[part.triangles], SEEN * least)
    # outward normals across: of the field where the surface moves, else of the triangle
    where = np.full(len(part.points), -1)
    where[points.numbers] = np.arange(len(points.numbers))
    corners = where[part.triangles[triangle]]
    a, b, c = np.moveaxis(part.points[part.triangles[triangle]], 1, 0)
    smooth = -np.einsum("rc,rcd->rd", weights, points.inward[corners])
    normal = np.where(np.all(corners >= 0, axis=1)[:, None], smooth, np.cross(b - a, c - a))
    cosine = np.einsum("rd,rd->r", normal, inward[ray]) / np.linalg.norm(normal, axis=1)
    across = np.flatnonzero(cosine > _ACROSS)
    order = across[np.argsort(way[across], kind="stable")]
    # of each cell of the grid the thinnest wall, found from either side
    middle = start[ray[order]] + 0.5 * way[order, None] * inward[ray[order]]
    cell = np.floor((middle - surface.body.bounding_box[0]) / surface.knots + 1e-9).astype(int)
    first = np.sort(np.unique(cell, axis=0, return_index=True)[1])
    chosen = order[first[:_MOST]]
    # outwards at the start, and at the corners of the triangle which move
    corners = corners[chosen]
    share = np.where(corners >= 0, weights[chosen] / cosine[chosen, None], 0.0)
    count = len(chosen)
    places = np.repeat(np.arange(count), 3), np.maximum(corners, 0).ravel()
    end = csr_matrix((share.ravel(), places), shape=(count, len(points.numbers)))
    apart = surface.outwards(start[ray[chosen]]) + end @ points.rows
    none = np.full((count, 2), -1)
    cost = np.full(count, dear * _COST * float(np.prod(surface.knots)) / surface.body.area)
    slopes = -apart.toarray() / least
    return Rows(1.0 - way[chosen] / least, slopes, np.full(count, least), none, cost)


def _hits(
    start: Array, direction: Array, corners: Array, longest: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, Array]:
    """Where rays first meet one of the triangles (t, 3, 3), up to a longest way.

    The numbers of the rays and of their triangles, the ways, and the weights of the corners.
    """
    center = corners.mean(axis=1)
    reach = float(np.max(np.linalg.norm(corners - center[:, None], axis=2), initial=0.0))
    middle = cKDTree(start + 0.5 * longest * direction)
    pairs = middle.sparse_distance_matrix(
        cKDTree(center), 0.5 * longest + reach, output_type="ndarray"
    )
    ray, triangle = pairs["i"], pairs["j"]
    a, b, c = np.moveaxis(corners[triangle], 1, 0)
    one, two, d, away = b - a, c - a, direction[ray], start[ray] - a
    p = np.cross(d, two)
    size = np.einsum("nd,nd->n", one, p)
    q = np.cross(away, one)
    with np.errstate(divide="ignore", invalid="ignore"):
        v = np.einsum("nd,nd->n", away, p) / size
        w = np.einsum("nd,nd->n", d, q) / size
        way = np.einsum("nd,nd->n", two, q) / size
        hit = (v > -1e-9) & (w > -1e-9) & (v + w < 1.0 + 1e-9)
        hit &= (way > 1e-6 * longest) & (way < longest)
    found = np.flatnonzero(hit)
    found = found[np.argsort(way[found], kind="stable")]
    found = found[np.unique(ray[found], return_index=True)[1]]
    weights = np.column_stack([1.0 - v[found] - w[found], v[found], w[found]])
    return ray[found], triangle[found], way[found], weights
