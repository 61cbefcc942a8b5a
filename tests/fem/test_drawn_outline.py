# SPDX-License-Identifier: MIT
"""The outline of a body as it was drawn, and its holes, found by the mesh alone."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import shapely
from shared.meshes import write_pierced_block

import dolfinx_ffr as ffr


def plate(order: int) -> tuple[shapely.Geometry, ffr.Domain]:
    """A plate of 60 x 20 mm with a round hole and a slot, and the body."""
    slot = shapely.LineString([(0.04, 0.01), (0.045, 0.01)]).buffer(0.003, quad_segs=24)
    around = shapely.box(0.0, 0.0, 0.06, 0.02)
    shape = around.difference(shapely.Point(0.02, 0.01).buffer(0.004, quad_segs=24))
    shape = shape.difference(slot)
    body = ffr.Domain.from_outline(
        MPI.COMM_WORLD,
        shape,
        interfaces={"left": lambda x: x[0] < 1e-9},
        size=0.004,
        order=order,
    )
    return shape, body


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
def test_holes_in_the_plane_on_several_ranks(order: int) -> None:
    shape, body = plate(order)
    assert body.outline.symmetric_difference(shape).area < 2e-4 * shape.area
    middles = sorted(hole.center.tolist() for hole in body.holes)
    np.testing.assert_allclose(middles, [(0.02, 0.01), (0.0425, 0.01)], atol=1e-5)
    round_hole = min(body.holes, key=lambda hole: hole.center[0])
    away = round_hole.distance(np.array([[0.02, 0.01], [0.02, 0.016], [0.03, 0.01]]))
    np.testing.assert_allclose(away, [0.0, 2e-3, 6e-3], atol=1e-5)


def test_a_coarse_circle_is_told_as_one_and_an_octagon_is_none() -> None:
    areas = {}
    for corners in (8, 12):
        angle = 2.0 * np.pi * np.arange(corners) / corners
        ring = 0.01 + 0.004 * np.column_stack([np.cos(angle), np.sin(angle)])
        shape = shapely.box(0.0, 0.0, 0.02, 0.02).difference(shapely.Polygon(ring))
        left = {"left": lambda x: x[0] < 1e-9}
        body = ffr.Domain.from_outline(MPI.COMM_WORLD, shape, interfaces=left, size=0.006)
        (hole,) = body.holes
        areas[corners] = hole.shape.area / (np.pi * 0.004**2)
    assert areas[12] == pytest.approx(1.0, abs=1e-3)
    assert areas[8] == pytest.approx(8.0 * np.sin(np.pi / 4.0) / (2.0 * np.pi), rel=1e-9)


def test_void_cells_are_outside_of_the_outline_and_no_hole() -> None:
    body = ffr.Domain.rectangle(
        MPI.COMM_WORLD,
        0.4,
        0.04,
        elements=(40, 4),
        void=lambda x: (abs(x[0] - 0.2) < 0.051) & (abs(x[1]) < 0.0101),
    )
    assert body.outline.area == pytest.approx(0.4 * 0.04 - 0.1 * 0.02)
    assert not body.holes


@pytest.mark.mpi
def test_a_tilted_bore_in_space_on_several_ranks(shared_tmp_path: Path) -> None:
    path, tilt = shared_tmp_path / "block.msh", 0.3
    if MPI.COMM_WORLD.rank == 0:
        write_pierced_block(path, tilt=tilt)
    MPI.COMM_WORLD.Barrier()
    (bore,) = ffr.Domain.from_gmsh(MPI.COMM_WORLD, path, interfaces=["left"]).holes
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    np.testing.assert_allclose(bore.center, turn @ [0.2, 0.05, 0.1], atol=1e-6)
    np.testing.assert_allclose(np.abs(bore.axis), np.abs(turn[:, 2]), atol=1e-6)
    assert (bore.radius, bore.length) == pytest.approx((0.1, 0.2), rel=1e-6)
    points = np.array([[0.2, 0.05, 0.0], [0.2, 0.2, 0.1], [0.2, 0.05, 0.25]]) @ turn.T
    np.testing.assert_allclose(bore.distance(points), [0.0, 0.05, 0.05], atol=1e-6)


def test_a_box_in_space_has_no_bore() -> None:
    assert not ffr.Domain.box(MPI.COMM_WORLD, 0.2, 0.02, 0.02, elements=(10, 2, 2)).holes
