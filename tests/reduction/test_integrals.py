# SPDX-License-Identifier: MIT
"""Volume integrals: rigid-body invariants, and the motion of markers."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shared.rods import CHORD, HELD, STEEL, rod, solid

import dolfinx_ffr as ffr
from dolfinx_ffr.fem import rigid_fields
from dolfinx_ffr.reduction.point_marker import PointMarker

pytestmark = pytest.mark.mpi


@pytest.mark.parametrize(
    ("elements", "options"),
    [
        *(
            ((12, 2), {"cell": c, "order": k})
            for c in ("quadrilateral", "triangle")
            for k in (1, 2)
        ),
        ((12, 2), {"frame": ffr.TangentFrame("right")}),
        ((12, 2, 2), {"frame": HELD}),
        ((12, 2, 2), {"frame": CHORD}),
    ],
)
def test_rigid_body(
    comm: MPI.Intracomm, elements: tuple[int, ...], options: dict[str, Any]
) -> None:
    """Mass, first and second moments, and rigid motions at markers, which any frame holds."""
    d, size = len(elements), np.array([0.4, 0.04, 0.03])[: len(elements)]
    place = np.array([0.37, 0.01, -0.012])[:d]
    body = rod(comm, elements, markers={"tip": place}, **options)
    integrals = solid(body).integrals
    integrals.validate("rod")
    # none for the rigid motions of the frame
    assert body.n_elastic == 3 * (d - 1) + 3 == integrals.modes
    origin = 0.4 if body.reduction.frame == ffr.TangentFrame("right") else 0.0
    mass = STEEL.density * np.prod(size) * (STEEL.thickness if d == 2 else 1.0)
    assert integrals.mass == pytest.approx(mass, rel=1e-12)
    assert_allclose(integrals.S[0], mass * (0.5 * size - origin) * np.eye(d)[0], atol=1e-14)
    second = mass * np.array([size[0] ** 2 / 3, *size[1:] ** 2 / 12])
    assert integrals.G[0, 0] == pytest.approx(second.sum(), rel=1e-12)
    if integrals.P is not None:
        assert_allclose(integrals.P[0, 0], np.diag(second), atol=1e-14)
    else:
        np.testing.assert_array_equal(integrals.N, -integrals.N.T)
    for name, x in (("left", 0.0), ("right", 0.4)):
        marker = integrals.markers[name]
        assert_allclose(marker.position, (x - origin) * np.eye(d)[0], atol=1e-15)
        if body.reduction.frame == ffr.TangentFrame("right"):
            expected = np.zeros((2, 6)) if name == "right" else np.eye(6)[:2]
            np.testing.assert_array_equal(marker.displacement, expected)
    rigid = rigid_fields(body.elasticity.coordinates(), np.zeros(d))
    displacement, rotation = body.markers["tip"].motion(rigid)
    assert_allclose(np.atleast_2d(rotation), np.eye(3 * (d - 1))[d:], atol=1e-9)
    turned = np.cross(np.eye(3), place).T if d == 3 else [[-place[1]], [place[0]]]
    assert_allclose(displacement, np.hstack([np.eye(d), turned]), atol=1e-12)


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
@pytest.mark.parametrize("order", [1, 2])
def test_marker_motion_of_known_fields(comm: MPI.Intracomm, cell: str, order: int) -> None:
    """Displacement and rotation at a point are exact for fields that the space holds."""
    domain = ffr.Domain.rectangle(comm, 1.0, 0.3, elements=(7, 3), cell=cell, order=order)
    x = domain.space.tabulate_dof_coordinates()[: domain.space.dofmap.index_map.size_local, :2]
    fields = np.zeros((2 * len(x), 2))
    fields[0::2, 0], fields[1::2, 0] = 1.0 - 2.0 * x[:, 1], 0.5 + 3.0 * x[:, 0]
    if order == 2:
        fields[1::2, 1] = x[:, 0] ** 2
    # inside a cell, on an edge, in a vertex, and on the boundary
    for point in ([0.31, 0.07], [0.31, 0.05], [2 / 7, 0.05], [1.0, 0.15]):
        displacement, rotation = PointMarker.at(domain, point).motion(fields)
        exact = [1.0 - 2.0 * point[1], 0.5 + 3.0 * point[0]]
        assert_allclose(displacement[:, 0], exact, rtol=1e-12)
        assert rotation[0] == pytest.approx(2.5, rel=1e-11)
        if order == 2:
            assert displacement[1, 1] == pytest.approx(point[0] ** 2, rel=1e-12)
            assert rotation[1] == pytest.approx(point[0], rel=1e-11)
