# SPDX-License-Identifier: MIT
"""Holes of a boundary that are joined or divided: struts between them go or come."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
import shapely
from scipy.spatial import cKDTree

from ..arrays import Array, Integers
from ..fem import ShapeError, connected
from .options import CURVES
from .outline import Boundary
from .sides import Run

#: Numbers of the closed curves of two holes
HolePair = tuple[int, int]


def struts_between_holes(boundary: Boundary) -> Iterator[tuple[HolePair, shapely.Geometry]]:
    """Pairs of holes that are near each other, and the strut between them with its mirror images.

    Of mirror images only one is a pair.
    """
    holes = {key: boundary.hole(key) for key in boundary.holes}
    farthest = CURVES.joined * boundary.member
    all_struts: shapely.Geometry = shapely.MultiPolygon()
    for i, j in combinations(holes, 2):
        if holes[i].distance(holes[j]) >= farthest:
            continue
        both_holes = shapely.union_all([holes[i], holes[j]])
        strut = _bridge(boundary, i, j).difference(both_holes)
        if strut.representative_point().intersects(all_struts):
            continue
        images = [shapely.transform(strut, isometry) for isometry in boundary.isometries]
        strut_with_images = shapely.union_all(images)
        all_struts = all_struts.union(strut_with_images)
        yield (i, j), strut_with_images


def _bridge(boundary: Boundary, i: int, j: int) -> shapely.Geometry:
    """The convex hull of those parts of two holes that face each other."""
    a, b = boundary.hole(i), boundary.hole(j)
    reach = a.distance(b) + CURVES.convex * boundary.member
    facing = a.intersection(b.buffer(reach)), b.intersection(a.buffer(reach))
    return shapely.union_all(facing).convex_hull


def joined(boundary: Boundary, pair: HolePair) -> Boundary:
    """The boundary with a ``pair`` of holes made one, and their mirror images likewise.

    The material between them goes. Raises a ShapeError if that is wider than six minimum members,
    or the holes are not both of one face.
    """
    holes = boundary.holes
    hole, other_hole = (boundary.hole(key) for key in pair)
    are_far = hole.distance(other_hole) > CURVES.joined * boundary.member
    pairs = _images_of_pair(boundary, pair)
    group = connected(pairs, len(holes))
    group_of_pair = group[pairs[:, 0]]

    runs, removed = [], []
    for number in np.unique(group_of_pair):
        members = [holes[i] for i in np.flatnonzero(group == number)]
        bridges = [
            _bridge(boundary, holes[i], holes[j])
            for i, j in pairs[group_of_pair == number].tolist()
        ]
        union = shapely.union_all([*bridges, *(boundary.hole(key) for key in members)])
        # no place is narrower than a member, which curves so coarse could not follow
        radius = 0.5 * boundary.member
        union = union.buffer(-radius).buffer(radius)
        if are_far or not isinstance(union, shapely.Polygon) or union.is_empty or union.interiors:
            raise ShapeError("boundary: the holes are too far apart to be merged")
        runs.append(_run_around(union))
        removed += members
    return boundary.with_other_holes(removed, runs)


def _images_of_pair(boundary: Boundary, pair: HolePair) -> Integers:
    """The pair and its mirror images, by the positions in the list of holes, (pairs, 2)."""
    holes = boundary.holes
    tree = cKDTree([boundary.hole(key).centroid.coords[0] for key in holes])
    centers = tree.data[[holes.index(key) for key in pair]]
    pairs = {
        tuple(sorted(tree.query(isometry(centers))[1].tolist())) for isometry in boundary.isometries
    }
    return np.array(sorted(pairs))


def with_strut(boundary: Boundary, ends: Array) -> Boundary:
    """The boundary with a straight strut between ``ends`` (2, 2) [m], and its mirror images.

    Raises a ShapeError if there is no hole where it is, or nothing is left of it.
    """
    member, gap = boundary.member, boundary.gap
    lines = [isometry(ends) for isometry in boundary.isometries]
    width = CURVES.strut_width * member
    struts = shapely.union_all(shapely.linestrings(lines)).buffer(0.5 * width)

    runs, removed = [], []
    for key in boundary.holes:
        hole = boundary.hole(key)
        if hole.intersection(struts).area <= member**2:
            continue
        removed.append(key)
        # only where the narrowest hole fits
        remaining = hole.difference(struts).buffer(-0.5 * gap).buffer(0.5 * gap)
        runs += [
            _run_around(piece)
            for piece in getattr(remaining, "geoms", [remaining])
            if piece.area > CURVES.smallest_hole * member**2
        ]
    if not runs:
        raise ShapeError("boundary: a strut needs a hole, but no hole is near it")
    return boundary.with_other_holes(removed, runs)


def _run_around(hole: shapely.Polygon) -> Run:
    """The rim of a hole, with the material on its left."""
    clockwise = shapely.geometry.polygon.orient(hole, -1.0).exterior
    return Run(np.asarray(clockwise.coords)[:-1], None)
