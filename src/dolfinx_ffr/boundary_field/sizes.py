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
    chosen = _one_of_each_place(field, middle, width)
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
    options, edge, grid = field.space.options, field.edge, field.space.grid
    points = edge.points[edge.moves]
    turn = _curvature(field, points)
    sharp = np.flatnonzero(np.abs(turn) * least * options.seen > 1.0)
    # a line that ends at what stays solid has a corner there
    cornered = shapely.dwithin(field.space.solid, shapely.points(points[sharp]), least)
    sharp = sharp[~cornered]
    points, turn = points[sharp], turn[sharp]
    chosen = _one_of_each_place(field, points, -np.abs(turn))
    points, turn = points[chosen], turn[chosen]
    slopes = _curvature_slopes(field, points)
    # as the boundary moves along its normal a circle becomes larger or smaller
    speed = np.linalg.norm(field.gradient(points), axis=1)
    slopes = slopes + diags(turn**2 / speed) @ grid.rows(points)
    # curvatures are linear in the motion, and radii of sharp corners are not
    values = np.abs(turn) * least - 1.0
    return values, csr_matrix(diags(least * np.sign(turn)) @ slopes), points


def _curvature(field: BoundaryField, points: Array) -> Array:
    """Curvature of the field's lines at points, positive in notches, (n,) [1/m]."""
    (xx, xy), (_, yy) = field.space.grid.bend(field.variables, points)
    x, y = field.gradient(points).T
    size = np.maximum(np.hypot(x, y), 1e-300)
    return np.asarray((xx * y**2 - 2.0 * xy * x * y + yy * x**2) / size**3)


def _curvature_slopes(field: BoundaryField, points: Array) -> csr_matrix:
    """The derivative of that curvature by the variables, (n, variables) [1/m^2]."""
    grid, turn = field.space.grid, _curvature(field, points)
    (xx, xy), (_, yy) = grid.bend(field.variables, points)
    (by_xx, by_xy), (_, by_yy) = grid.bend_rows(points)
    by_x, by_y = grid.slope_rows(points)
    x, y = field.gradient(points).T
    size = np.maximum(np.hypot(x, y), 1e-300)
    numerator = diags(y**2) @ by_xx - diags(2.0 * x * y) @ by_xy + diags(x**2) @ by_yy
    numerator += diags(2.0 * (yy * x - xy * y)) @ by_x + diags(2.0 * (xx * y - xy * x)) @ by_y
    along = diags(x) @ by_x + diags(y) @ by_y  # the derivative of size^2 / 2
    return csr_matrix(diags(size**-3) @ numerator - diags(3.0 * turn / size**2) @ along)


def _one_of_each_place(field: BoundaryField, points: Array, sizes: Array) -> Integers:
    """The numbers of the smallest size in each bin of the body; mirror images are one place."""
    width = field.space.options.bin * field.space.member
    center = field.space.grid.center
    images = np.stack([g(points) - center for g in field.space.isometries])
    # of all images the one that is last in a direction that no mirror leaves
    chosen = np.argmax(images @ np.array([1.0, np.sqrt(2.0)]), axis=0)
    bins = np.floor(images[chosen, np.arange(len(points))] / width).astype(np.int64)
    order = np.argsort(sizes, kind="stable")
    return np.asarray(order[np.unique(bins[order], axis=0, return_index=True)[1]])
