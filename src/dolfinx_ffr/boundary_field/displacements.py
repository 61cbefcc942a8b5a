# SPDX-License-Identifier: MIT
"""Smooth displacements of the plane, which translate what crosses as a whole.

A motion that is smooth along the boundary hardly moves a crossing, whose edges have all normals.
"""

from __future__ import annotations

import numpy as np
import shapely
from scipy.sparse import csc_matrix, identity
from scipy.sparse.linalg import splu

from ..arrays import Array
from ..design import images
from .field import SYMMETRIC, AnyField
from .operations import refitted
from .spline_grid import SplineGrid


def translated(field: AnyField, slope: Array) -> AnyField:
    """The field with its material displaced downhill, by one minimum member at most.

    The displacement u minimises int |u|^2 / h + h int |grad u|^2 with the ``slope`` (variables,) of
    the function that falls, h being the length over which it differs.
    """
    space = field.space
    length = space.options.shift * space.member
    corners = shapely.get_coordinates(space.body.outline)
    grid = SplineGrid.around(corners, length, images([]), space.grid.axes)
    mass, stiffness = grid.integrals
    # splines that the box hardly holds stay
    stiff = mass + stiffness + 1e-6 * mass.diagonal().max() * identity(grid.size)
    factor = splu(csc_matrix(stiff), **SYMMETRIC)

    # a variable changes by -u . grad phi where it stands
    steepness, rows = field.gradient(space.grid.nodes), grid.rows(space.grid.nodes)
    spline = np.asarray(factor.solve(rows.T @ (slope[:, None] * steepness)))
    places = space.raster

    # the mean of all mirror images is its own mirror image
    way = np.zeros_like(places)
    for image in space.isometries:
        way += grid.rows(image(places)) @ spline @ image.turn
    way *= space.member / max(float(np.max(np.linalg.norm(way, axis=1))), 1e-300)
    far = space.options.cut_off * space.grid.spacing
    return refitted(field, np.clip(field.spline(places - way), -far, far))
