# SPDX-License-Identifier: MIT
"""The circle on which the nodes of a bearing surface lie.

The centre (a, b) and c = r^2 - a^2 - b^2 minimise sum (x^2 + y^2 - 2 a x - 2 b y - c)^2, a linear
problem (I. Kasa, IEEE Transactions on Instrumentation and Measurement 25 (1976),
doi:10.1109/TIM.1976.6312298), whose solution is exact for points on a circle.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh
from numpy.typing import NDArray

from .mesh_checks import facet_points

__all__ = ["fit_circle", "interface_center"]

#: Fewer points lie on a circle by chance: any three do, and the corners of a rectangle
FEWEST = 5
#: Largest distance of a point from the circle, relative to its radius
ROUND = 1e-4


def fit_circle(points: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """The centre of the circle on which all points lie.

    Args:
        points: Shape (points, 2) [m]; some may stand several times.

    Returns:
        Centre, shape (2,) [m]; None if there are fewer than five points, if they do not lie on one
        circle, or if they are so small an arc of it (less than about a sixth) that its centre is
        not near them.
    """
    middle = points.mean(axis=0)
    extent = float(np.max(np.linalg.norm(points - middle, axis=1)))
    if not extent > 0.0:
        return None
    s = (points - middle) / extent
    if len(np.unique(np.round(s, 9), axis=0)) < FEWEST:
        return None
    matrix = np.column_stack([2.0 * s, np.ones(len(s))])
    solution, _, rank, _ = np.linalg.lstsq(matrix, np.sum(s**2, axis=1), rcond=1e-9)
    if rank < 3:
        return None
    center = solution[:2]
    radii = np.linalg.norm(s - center, axis=1)
    radius = float(radii.mean())
    # the chord of a sixth of the circle is as long as the radius; these points extend to its half
    if np.max(np.abs(radii - radius)) > ROUND * radius or radius > 2.0 * (1.0 + ROUND):
        return None
    return np.asarray(middle + extent * center)


def interface_center(domain: mesh.Mesh, facets: NDArray[np.int32]) -> NDArray[np.float64]:
    """The centre of the circle on which facets lie, or else their centroid; collective.

    Args:
        domain: The mesh.
        facets: Local facets on this rank, ghosts included.

    Returns:
        Shape (2,) [m], the same on every rank.
    """
    circle = fit_circle(facet_points(domain, facets))
    if circle is not None:
        return circle
    tags = mesh.meshtags(domain, 1, np.sort(facets), np.full(len(facets), 1, dtype=np.int32))
    ds = ufl.Measure("ds", domain=domain, subdomain_data=tags)(1)
    x = ufl.SpatialCoordinate(domain)
    one = fem.Constant(domain, np.float64(1.0))
    comm: MPI.Comm = domain.comm
    moments = [
        comm.allreduce(fem.assemble_scalar(fem.form(f * ds))) for f in (one, one * x[0], one * x[1])
    ]
    return np.array(moments[1:]) / moments[0]
