# SPDX-License-Identifier: MIT
"""Members, gaps and radii no smaller than a minimum, as linear constraints on the variables."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from scipy.sparse import csr_matrix, diags, vstack
from scipy.spatial import cKDTree

from ..arrays import Array, Integers, Mask
from .field import BoundaryField, Edge
from .options import FieldOptions


@dataclass(frozen=True, eq=False)
class SizeRows:
    """Constraints value + slope . step <= 0, one for each narrow or sharp place."""

    values: Array  #: (rows,), how much is missing as a share of the minimum with its spare
    slopes: csr_matrix  #: (rows, variables) [1/m]
    places: Array  #: In the middle of each, (rows, 2) [m]
    members: int  #: Number of rows of members, which are the first ones
    violation: float  #: Largest share by which a minimum itself is missed

    @staticmethod
    @lru_cache(maxsize=4)
    def of(field: BoundaryField) -> SizeRows:
        """The rows of all members, gaps and radii of a field."""
        space, options = field.space, field.space.options
        spare = options.spare
        members = _widths(field, -1.0, spare * space.member)
        gaps = _widths(field, 1.0, spare * space.gap)
        radii = _radii(field, spare * space.radius) if space.radius else _none(field)
        values, slopes, places = zip(members, gaps, radii, strict=True)
        widths = np.concatenate(values[:2])
        sharpness = 1.0 + values[2]
        # a width is (1 - value) and a radius 1 / (1 + value) of its minimum with the spare
        least = min(1.0 - np.max(widths, initial=-1.0), 1.0 / np.max(sharpness, initial=0.5))
        violation = max(0.0, 1.0 - spare * float(least))
        rows = csr_matrix(vstack(slopes))
        return SizeRows(
            np.concatenate(values), rows, np.concatenate(places), len(values[0]), violation
        )


def _none(field: BoundaryField) -> tuple[Array, csr_matrix, Array]:
    return np.zeros(0), csr_matrix((0, len(field.variables))), np.zeros((0, 2))


def _widths(field: BoundaryField, side: float, least: float) -> tuple[Array, csr_matrix, Array]:
    """The narrowest places through the material (``side`` -1) or through the void (1)."""
    options, edge = field.space.options, field.edge
    points, normals = edge.points, edge.normals
    first, second, width = opposite(points, normals, side, options.seen * least, options)
    moves = edge.moves[first] | edge.moves[second]
    if side < 0.0:
        moves &= ~_within_solid(field, points[first], points[second])
    else:
        # where the zero ends at what stays is a corner, and no gap
        middle = 0.5 * (points[first] + points[second])
        moves &= cKDTree(_ends(edge)).query(middle)[0] > least
    first, second, width = first[moves], second[moves], width[moves]
    if not len(first):
        return _none(field)

    middle = 0.5 * (points[first] + points[second])
    chosen = _one_of_each_place(field, middle, width, options.bin * field.space.member)
    first, second, width = first[chosen], second[chosen], width[chosen]
    across = _across(normals[first], normals[second])
    cosines = [np.abs(np.einsum("ij,ij->i", across, normals[k])) for k in (first, second)]
    motion = [diags(c) @ edge.rows[k] for c, k in zip(cosines, (first, second), strict=True)]
    # outward motion of the boundary widens members and narrows gaps
    slopes = (side / least) * (motion[0] + motion[1])
    return 1.0 - width / least, csr_matrix(slopes), middle[chosen]


def opposite(
    points: Array, normals: Array, side: float, reach: float, options: FieldOptions
) -> tuple[Integers, Integers, Array]:
    """The nearest opposite point of each point of a boundary, and the width between both.

    Through the material (``side`` -1) or the void (1), for points that have one within a ``reach``.
    """
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    facing = np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]])
    pairs = pairs[facing < options.facing]
    first, second = np.concatenate([pairs, pairs[:, ::-1]]).T
    way = points[second] - points[first]
    distance = np.linalg.norm(way, axis=1)
    straight = side * np.einsum("ij,ij->i", way, normals[first]) > options.across * distance
    first, second, distance = (x[straight] for x in (first, second, distance))
    order = np.argsort(distance, kind="stable")
    order = order[np.unique(first[order], return_index=True)[1]]
    first, second = first[order], second[order]
    # across both sides, as points on them are not opposite to the last bit
    across = _across(normals[first], normals[second])
    width = np.abs(np.einsum("ij,ij->i", points[second] - points[first], across))
    return first, second, width


def _across(first: Array, second: Array) -> Array:
    """The unit direction between opposite normals, (n, 2)."""
    across = first - second
    return np.asarray(across / np.linalg.norm(across, axis=1, keepdims=True))


def _within_solid(field: BoundaryField, first: Array, second: Array) -> Mask:
    """Whether what stays solid gives the minimum width between points already."""
    space = field.space
    inside = np.zeros(len(first), dtype=bool)
    amid = np.flatnonzero(shapely.contains_xy(space.solid, *(0.5 * (first + second)).T))
    lines = shapely.linestrings(np.stack([first[amid], second[amid]], axis=1))
    length = shapely.length(shapely.intersection(lines, space.solid))
    inside[amid] = length > (1.0 - 1e-2) * space.member
    return inside


def _ends(edge: Edge) -> Array:
    """Where the zero ends at what stays, (n, 2) [m]."""
    points, after = edge.points, np.roll(edge.points, -1, axis=0)
    follows = np.linalg.norm(after - points, axis=1) < 2.0 * edge.lengths
    ends = follows & (edge.moves != np.roll(edge.moves, -1))
    return np.asarray(0.5 * (points + after)[ends]).reshape(-1, 2)


def _radii(field: BoundaryField, least: float) -> tuple[Array, csr_matrix, Array]:
    """Where the curvature of the boundary is larger than it may be, or nearly so."""
    options, edge = field.space.options, field.edge
    points = edge.points[edge.moves]
    turn = curvatures(field, points)
    sharp = np.flatnonzero(np.abs(turn) * least * options.seen > 1.0)
    # the sharpest place may be between two points
    beside = _beside(field, points[sharp], options.sample * field.space.member / 3.0)
    points = np.concatenate([points[sharp], beside])
    turn = np.concatenate([turn[sharp], curvatures(field, beside)])
    # a line that ends at what stays solid has a corner there, and the body's drawing may have some
    cornered = shapely.dwithin(field.space.solid, shapely.points(points), least)
    cornered |= shapely.intersects_xy(field.space.drawn_corners, *points.T)
    points, turn = points[~cornered], turn[~cornered]
    chosen = _one_of_each_place(field, points, -np.abs(turn), options.bin * least)
    points, turn = points[chosen], turn[chosen]
    slopes = _curvature_slopes(field, points)
    # curvatures are linear in the motion, and radii of sharp corners are not
    values = np.abs(turn) * least - 1.0
    return values, csr_matrix(diags(least * np.sign(turn)) @ slopes), points


def _beside(field: BoundaryField, points: Array, step: float) -> Array:
    """Points on the zero a ``step`` [m] before and after ``points`` (n, 2) on it, (2 n, 2)."""
    gradient = field.gradient(points)
    way = np.column_stack([-gradient[:, 1], gradient[:, 0]])
    way *= step / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-300)
    beside = np.concatenate([points - way, points + way])
    for _ in range(2):
        value, gradient = field.derivatives(beside)
        square = np.maximum(np.sum(gradient**2, axis=1), 1e-12)
        beside -= (value / square)[:, None] * gradient
    return beside


def curvatures(field: BoundaryField, points: Array) -> Array:
    """Curvature of the field's lines at points, positive in notches, (n,) [1/m]."""
    _, gradient, bend = field.space.grid.derivatives(field.variables, points, 2)
    x, y = gradient.T
    size = np.maximum(np.hypot(x, y), 1e-300)
    xx, xy, yy = bend[:, 0, 0], bend[:, 0, 1], bend[:, 1, 1]
    return np.asarray((xx * y**2 - 2.0 * xy * x * y + yy * x**2) / size**3)


def _curvature_slopes(field: BoundaryField, points: Array) -> csr_matrix:
    """The derivative of the curvature of the zero by the variables, (n, variables) [1/m^2].

    As the boundary moves along its normal a circle becomes larger or smaller.
    """
    grid, turn = field.space.grid, curvatures(field, points)
    _, gradient, bend = grid.derivatives(field.variables, points, 2)
    (x, y), (xx, xy, yy) = gradient.T, (bend[:, 0, 0], bend[:, 0, 1], bend[:, 1, 1])
    size = np.maximum(np.hypot(x, y), 1e-300)
    by_bends = np.stack([np.stack([y**2, -x * y], 1), np.stack([-x * y, x**2], 1)], axis=1)
    by_slopes = 2.0 * np.stack([yy * x - xy * y, xx * y - xy * x], axis=1)
    by_slopes -= (3.0 * turn * size)[:, None] * gradient  # the power of the size
    cube = size**3
    ways = by_slopes / cube[:, None]
    return grid.bend_rows(points, by_bends / cube[:, None, None], ways, turn**2 / size)


def _one_of_each_place(field: BoundaryField, points: Array, sizes: Array, width: float) -> Integers:
    """The numbers of the smallest size in each bin of a ``width``; mirror images are one place."""
    center = field.space.grid.center
    images = np.stack([g(points) - center for g in field.space.isometries])
    # of all images the one that is last in a direction that no mirror leaves
    chosen = np.argmax(images @ np.array([1.0, np.sqrt(2.0)]), axis=0)
    bins = np.floor(images[chosen, np.arange(len(points))] / width).astype(np.int64)
    order = np.argsort(sizes, kind="stable")
    return np.asarray(order[np.unique(bins[order], axis=0, return_index=True)[1]])
