# SPDX-License-Identifier: MIT
"""Parts that leave their body, and rims of drawn holes that are too thin, are found."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import shapely
from shared.meshes import write_pierced_block

import dolfinx_ffr as ffr
from dolfinx_ffr.part import outline_violations

MEMBER, RADIUS, CENTER = 0.004, 0.003, np.array([0.02, 0.009])
WHOLE = shapely.box(0.0, 0.0, 0.06, 0.02)
LEFT = {"left": lambda x: x[0] < 1e-9}


def shares(part: ffr.Part | ffr.Solid, rim: float, least: float) -> dict[str, float]:
    return {each.name: each.share for each in outline_violations(part, rim, least)}


def plate(shape: shapely.Geometry) -> ffr.Domain:
    return ffr.Domain.from_outline(MPI.COMM_WORLD, shape, interfaces=LEFT, size=0.003)


@pytest.fixture(scope="module")
def drilled() -> ffr.Domain:
    return plate(WHOLE.difference(shapely.Point(CENTER).buffer(RADIUS, quad_segs=12)))


def test_a_hole_that_is_filled_is_material_outside_of_the_body(drilled: ffr.Domain) -> None:
    part = ffr.Part(plate(WHOLE), lambda x: np.ones(len(x)))
    assert shares(part, MEMBER, MEMBER) == {}
    part.body = drilled
    outside = shares(part, MEMBER, MEMBER)
    assert list(outside) == ["material outside of the body near (20, 9) mm"]
    assert outside.popitem()[1] == pytest.approx(RADIUS / MEMBER, rel=0.02)


def test_a_bump_beyond_the_outer_edge_is_material_outside_of_the_body() -> None:
    bump = shapely.box(0.03, 0.01, 0.034, 0.021)
    part = ffr.Part(plate(WHOLE.union(bump)), lambda x: np.ones(len(x)))
    part.body = plate(WHOLE)
    ((what, depth),) = shares(part, MEMBER, MEMBER).items()
    assert what.startswith("material outside of the body near (32, 20.")
    assert depth == pytest.approx(0.001 / MEMBER, rel=0.02)


@pytest.mark.parametrize(("width", "missing"), [(1.0, None), (0.9, 0.1), (0.5, 0.5), (0.0, 1.0)])
def test_rims_that_are_too_thin(drilled: ffr.Domain, width: float, missing: float | None) -> None:
    """A void of 4 mm beside the hole leaves a rim of some width, or none."""
    center = CENTER + np.array([RADIUS + width * MEMBER + 0.002, 0.0])
    part = ffr.Part(drilled, lambda x: np.linalg.norm(x - center, axis=1) - 0.002)
    outside = shares(part, MEMBER, MEMBER)
    if missing is None:
        assert outside == {}
    else:
        assert list(outside) == ["rim of the hole near (20, 9) mm"]
        assert outside.popitem()[1] == pytest.approx(missing, abs=0.01)
    assert shares(part, 0.0, MEMBER) == {}


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("tool", "below", "middle", "radius"),
    [("bore", -0.05, "(200, 50, 100)", 0.1), ("slot", 0.0, "(200, 50, 100)", 0.05)],
)
def test_a_hole_in_space(
    shared_tmp_path: Path, tool: str, below: float, middle: str, radius: float
) -> None:
    path = shared_tmp_path / "block.msh"
    if MPI.COMM_WORLD.rank == 0:
        write_pierced_block(path, tool=tool)
    MPI.COMM_WORLD.Barrier()
    body = ffr.Domain.from_gmsh(MPI.COMM_WORLD, path, interfaces=["left"])
    member = 0.08
    full = ffr.Solid(body, lambda x: np.ones(len(x)))
    assert shares(full, member, member) == {}

    cut = ffr.Solid(body, lambda x: x[:, 1] - below + 0.04)  # from 0.04 below the hole on
    assert shares(cut, 0.03, member) == {}
    ((what, missing),) = shares(cut, member, member).items()
    assert what == f"rim of the hole near {middle} mm"
    assert missing == pytest.approx(0.5, abs=0.05)

    block = ffr.Domain.box(MPI.COMM_WORLD, 1.0, 0.5, 0.2, elements=(10, 5, 2), solid_layers=1)
    block.mesh.geometry.x[:] -= [0.5, 0.0, -0.1]
    filled = ffr.Solid(block, lambda x: np.ones(len(x)))
    filled.body = body
    outside = shares(filled, 0.0, member)
    depth = outside[f"material outside of the body near {middle} mm"]
    assert depth == pytest.approx(radius / member, rel=0.1)
