# SPDX-License-Identifier: MIT
"""Struts that end free: they carry nothing, and only their minimum width keeps them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from ..arrays import Array
from ..fem import cross
from .asked_sizes import solid_regions
from .part import Part


@dataclass(frozen=True)
class FreeEndOptions:
    """What counts as a strut that ends free; lengths are in minimum members."""

    sample: float = 0.2  #: Distance of the points of the boundary
    widest: float = 3.0  #: Largest width of such a strut
    shortest: float = 4.0  #: Least length of the curve around it
    #: The same, in widths of the strut where it begins: less is a corner, of 60 degrees
    slender: float = 2.0
    within: float = 0.05  #: Distance by which a strut may leave the material by round-off
    held: float = 0.5  #: Distance of a strut from what holds it, at most


OPTIONS = FreeEndOptions()


def free_ends(part: Part, member: float, bearings: Array) -> list[Array]:
    """A place (2,) in each strut of a part that ends free [m], the longest strut first.

    A strut that is solid, touches an interface or holds one of the ``bearings`` (n, 2) [m], at
    which forces may act, does not end free. The ``member`` is the minimum member [m].
    """
    holding = [*solid_regions(part), *map(shapely.Point, bearings)]
    for name in part.body.interfaces:
        holding += [
            shapely.LineString(curve.points(part.accuracy)) for curve in part.interface(name)
        ]
    held_region = shapely.union_all(holding).buffer(OPTIONS.held * member)

    rings = [ring for piece in part.polygon.geoms for ring in (piece.exterior, *piece.interiors)]
    struts = _free_struts(rings, part.polygon, member)
    return [
        np.array(strut.representative_point().coords[0])
        for strut in struts
        if not strut.intersects(held_region)
    ]


def _free_struts(
    rings: list[shapely.LinearRing], material: shapely.Geometry, member: float
) -> list[shapely.Polygon]:
    """The struts of a ``material`` that end free and do not overlap, the longest first.

    A ring of its boundary that passes a narrow place twice encloses a strut in between, if no other
    ring is inside.
    """
    room = material.buffer(OPTIONS.within * member)
    shapely.prepare(room)
    struts: list[tuple[float, shapely.Polygon]] = []
    for ring in rings:
        points = shapely.get_coordinates(shapely.segmentize(ring, OPTIONS.sample * member))[:-1]
        for length, strut in _enclosed(points, member):
            if any(strut.intersects(longer) for _, longer in struts):
                continue
            if strut.is_valid and room.covers(strut):
                struts.append((length, strut))
    struts.sort(key=lambda pair: -pair[0])
    return [strut for _, strut in struts]


def _enclosed(ring: Array, member: float) -> Iterator[tuple[float, shapely.Polygon]]:
    """What pieces of a ring (n, 2) enclose whose ends are near each other, the longest first.

    The material is on the left of the ring; returned are lengths of the pieces and polygons.
    """
    near_pairs = cKDTree(ring).query_pairs(OPTIONS.widest * member, output_type="ndarray")
    # a piece may run over the first point of the ring
    pairs = np.vstack([near_pairs, near_pairs[:, ::-1] + [0, len(ring)]])
    points = np.vstack([ring, ring])

    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    arc_length = np.concatenate([[0.0], np.cumsum(chords)])
    swept_area = np.concatenate([[0.0], np.cumsum(0.5 * cross(points[:-1], points[1:]))])

    first, last = pairs.T
    length = arc_length[last] - arc_length[first]
    width = np.linalg.norm(points[last] - points[first], axis=1)
    area = swept_area[last] - swept_area[first] + 0.5 * cross(points[last], points[first])

    is_long = length > np.maximum(OPTIONS.slender * width, OPTIONS.shortest * member)
    is_narrow = (area > 0.0) & (2.0 * area < OPTIONS.widest * member * length)
    struts = np.flatnonzero(is_long & is_narrow)
    for k in struts[np.argsort(-length[struts], kind="stable")]:
        yield float(length[k]), shapely.Polygon(points[first[k] : last[k] + 1])
