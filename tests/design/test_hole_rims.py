# SPDX-License-Identifier: MIT
"""Rims around the holes of a drawing stay solid, whatever the design is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import shapely
from shared.meshes import write_pierced_block

import dolfinx_ffr as ffr

RADIUS, RIM = 0.003, 0.004
CENTER = np.array([0.02, 0.009])


def plate() -> ffr.Domain:
    """A plate of 60 x 20 mm with a round hole that has no name."""
    shape = shapely.box(0.0, 0.0, 0.06, 0.02).difference(shapely.Point(CENTER).buffer(RADIUS))
    left = {"left": lambda x: x[0] < 1e-9}
    return ffr.Domain.from_outline(MPI.COMM_WORLD, shape, interfaces=left, size=0.0025)


def level_set(body: ffr.Domain, rim: float | None, member: float = RIM) -> ffr.LevelSet:
    return ffr.LevelSet(body, minimum_member=member, hole_rim=rim)


def densities(body: ffr.Domain, rim: float | None) -> ffr.DensityDesign:
    return ffr.DensityDesign(body, hole_rim=rim)


KINDS = pytest.mark.parametrize("kind", [level_set, densities])


@pytest.mark.mpi
@KINDS
def test_rims_are_solid_where_nothing_else_is(kind: Callable[..., ffr.design.Design]) -> None:
    body = plate()
    away = np.linalg.norm(body.centroids - CENTER, axis=1) - RADIUS
    size = 2.0 * body.cell_size
    design = kind(body, RIM)
    empty = design.density(design.even(0.0))
    assert np.all(empty[away < RIM - size] > 1.0 - 1e-12)
    assert np.max(empty[away > RIM + size]) < 1e-9
    none = kind(body, 0.0)
    assert np.max(none.density(none.even(0.0))) < 1e-9


@pytest.mark.mpi
@KINDS
def test_the_pullback_with_rims_is_exact(kind: Callable[..., ffr.design.Design]) -> None:
    design = kind(plate(), RIM).at(0.3)
    rng = np.random.default_rng(2)
    u, way = rng.uniform(0.3, 0.7, design.size), rng.standard_normal(design.size)
    cells = design.domain.everywhere(np.arange(design.domain.n_cells))
    bar = design.domain.owned(np.sin(np.arange(len(cells))))
    step = 1e-6
    change = (design.density(u + step * way) - design.density(u - step * way)) / (2.0 * step)
    slope = float(design.pullback(u, bar) @ way)
    assert slope == pytest.approx(design.domain.sum(bar * change), rel=1e-6)


@KINDS
def test_the_field_of_a_part_has_a_round_rim_where_the_design_is_void(
    kind: Callable[..., ffr.design.Design],
) -> None:
    body = plate()
    design = kind(body, None if kind is level_set else RIM)
    variables = design.even(0.0)
    level = design.level(variables)
    angle = np.linspace(0.0, 6.0, 50)
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    assert np.all(level(CENTER + (RADIUS + 0.99 * RIM) * around) > 0.0)
    assert np.all(level(CENTER + (RADIUS + 1.01 * RIM) * around) < 0.0)


def block(folder: Path, tool: str) -> ffr.Domain:
    path = folder / "block.msh"
    if MPI.COMM_WORLD.rank == 0:
        write_pierced_block(path, tool=tool, size=0.07)
    MPI.COMM_WORLD.Barrier()
    return ffr.Domain.from_gmsh(MPI.COMM_WORLD, path, interfaces=["left"])


def test_the_rim_of_a_bore_in_space(tmp_path: Path) -> None:
    design = ffr.LevelSet(block(tmp_path, "bore"), minimum_member=0.1)
    level = design.level(design.even(0.0))
    points = np.array([[0.2, 0.05 + r, z] for r in (0.11, 0.19) for z in (0.0, 0.1, 0.2)])
    assert np.all(level(points) > 0.0)
    assert level(np.array([[0.2, -0.2, 0.1]]))[0] < 0.0


@pytest.mark.mpi
@KINDS
def test_the_rim_of_a_slot_in_space(
    kind: Callable[..., ffr.design.Design], shared_tmp_path: Path
) -> None:
    rim, body = 0.1, block(shared_tmp_path, "slot")
    design = level_set(body, rim, rim) if kind is level_set else kind(body, rim)
    empty = design.even(0.0)
    x, y, _ = np.abs(design.domain.centroids - [0.2, 0.05, 0.0]).T
    away = np.hypot(np.maximum(x - 0.1, 0.0), y) - 0.05
    density, size = design.density(empty), 2.0 * design.domain.cell_size
    assert np.all(density[away < rim - size] > 1.0 - 1e-12)
    assert np.max(density[away > rim + size], initial=0.0) < 1e-9

    level = design.level(empty)
    x, y = np.meshgrid([0.1, 0.2, 0.3], [0.05 - 0.05 - 0.95 * rim, 0.05 + 0.05 + 0.95 * rim])
    within = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.1)])
    assert np.all(level(within) > 0.0)
    assert level(np.array([[-0.2, 0.05, 0.1]]))[0] < 0.0


def test_a_negative_rim_is_refused() -> None:
    with pytest.raises(ValueError, match="hole_rim"):
        ffr.LevelSet(plate(), hole_rim=-1e-3)
