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


def block(folder: Path, tool: str, tilt: float = 0.0) -> ffr.Domain:
    """A block of 1 x 0.5 x 0.2 m without what a tool takes."""
    path = folder / "block.msh"
    if MPI.COMM_WORLD.rank == 0:
        write_pierced_block(path, tool=tool, tilt=tilt, size=0.09)
    MPI.COMM_WORLD.Barrier()
    return ffr.Domain.from_gmsh(MPI.COMM_WORLD, path, interfaces=["left"])


@pytest.mark.mpi
def test_a_tilted_bore_in_space_on_several_ranks(shared_tmp_path: Path) -> None:
    """Distances are those from its cylinder, on however coarse a mesh."""
    tilt = 0.3
    (bore,) = block(shared_tmp_path, "bore", tilt).holes
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    np.testing.assert_allclose(bore.center, turn @ [0.2, 0.05, 0.1], atol=1e-5)
    assert bore.radius == pytest.approx(0.1, rel=1e-6)
    angle, depth, height = np.random.default_rng(3).uniform(size=(3, 200))
    away = 0.1 + 0.02 + 0.1 * depth
    around = np.cos(6.3 * angle) * away, np.sin(6.3 * angle) * away
    points = np.column_stack([0.2 + around[0], 0.05 + around[1], 0.2 * height])
    np.testing.assert_allclose(bore.distance(points @ turn.T), away - 0.1, atol=2e-4)


@pytest.mark.parametrize(
    ("tool", "low", "high"),
    [
        pytest.param("slot", (0.05, 0.0, 0.0), (0.35, 0.1, 0.2), marks=pytest.mark.mpi),
        ("pocket", (0.1, -0.05, 0.1), (0.3, 0.15, 0.2)),
        ("cone", (0.06, -0.09, 0.0), (0.34, 0.19, 0.2)),
        ("oblique bore", (0.083, -0.01, 0.0), (0.317, 0.11, 0.2)),
        ("cavity", (0.14, -0.01, 0.04), (0.26, 0.11, 0.16)),
        ("crossing bores", (0.14, -0.25, 0.0), (0.26, 0.25, 0.2)),
    ],
)
def test_holes_of_any_shape_in_space(
    shared_tmp_path: Path, tool: str, low: tuple[float, ...], high: tuple[float, ...]
) -> None:
    (hole,) = block(shared_tmp_path, tool).holes
    # what is no cylinder is found as the mesh has it
    np.testing.assert_allclose(hole.box, [low, high], atol=1e-2)


@pytest.mark.parametrize("tool", ["fork", "groove", "half bore"])
def test_what_is_open_at_its_side_is_no_hole(shared_tmp_path: Path, tool: str) -> None:
    assert not block(shared_tmp_path, tool).holes


def test_a_box_in_space_has_no_bore() -> None:
    assert not ffr.Domain.box(MPI.COMM_WORLD, 0.2, 0.02, 0.02, elements=(10, 2, 2)).holes
