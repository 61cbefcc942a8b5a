# SPDX-License-Identifier: MIT
"""What parts in the plane and solids in space have in common."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import pyvista

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting

WEIGHTLESS = SimpleNamespace(thickness=0.01, out_of_plane=0.0, on=lambda domain: None)


def body(comm: MPI.Comm, dimension: int) -> ffr.Domain:
    if dimension == 3:
        return ffr.Domain.box(comm, 0.8, 0.2, 0.1, elements=(8, 2, 1))
    return ffr.Domain.rectangle(comm, 0.8, 0.2, elements=(8, 2))


def whole(comm: MPI.Comm, dimension: int, material: Any = None) -> ffr.Part | ffr.Solid:
    kind = {2: ffr.Part, 3: ffr.Solid}[dimension]
    return kind(body(comm, dimension), lambda x: np.ones(len(x)), material=material)


@pytest.mark.mpi
@pytest.mark.parametrize("dimension", [2, 3])
def test_volume_and_mass(comm: MPI.Comm, dimension: int) -> None:
    """Of a plate and of a block, both of 16 litres."""
    densities = (1.0, 0.3, 500.0)
    material = {2: ffr.PlaneStress(*densities, 0.1), 3: ffr.Isotropic(*densities)}[dimension]
    part = whole(comm, dimension, material)
    assert isinstance(part, ffr.part.Enclosed)
    assert part.volume == pytest.approx(0.016, rel=1e-12)
    assert part.mass == pytest.approx(8.0, rel=1e-12)
    assert part.pieces == 1
    assert not part.lost_interfaces
    assert set(part.measures()) >= {"thinnest member", "narrowest gap"}


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_material_without_density(comm: MPI.Comm, shared_tmp_path: Path, dimension: int) -> None:
    """That is what is said, and not that no material was given; pictures tell no mass."""
    part = whole(comm, dimension, WEIGHTLESS)
    with pytest.raises(
        ValueError, match="the material SimpleNamespace needs the attribute density"
    ):
        _ = part.mass
    assert plotting.plot_part(part, shared_tmp_path / "part.png").exists()
    kind = type(part).__name__
    with pytest.raises(ValueError, match=rf"its mass needs a material; make the .* with {kind}\("):
        _ = whole(comm, dimension).mass


def test_what_is_no_material(comm: MPI.Comm) -> None:
    for dimension, kind in ((2, "part"), (3, "solid")):
        with pytest.raises(TypeError, match=f"{kind}: material must be an elastic material"):
            whole(comm, dimension, 7850.0)


@pytest.mark.parametrize("dimension", [2, 3])
def test_of_a_design(comm: MPI.Comm, dimension: int) -> None:
    """Both are made of a design by the same call."""
    design = ffr.DensityDesign(body(comm, dimension))
    kind, other = (ffr.Part, ffr.Solid)[:: 1 if dimension == 2 else -1]
    part = kind.of(design, design.even(1.0))
    assert part.pieces == 1
    filled = part.area if dimension == 2 else part.volume
    assert filled == pytest.approx(design.domain.area, rel=1e-12)
    with pytest.raises(ValueError, match=f"take a {kind.__name__} for bodies in "):
        other.of(design, design.even(1.0))


@pytest.mark.mpi
def test_files_of_a_solid(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """In millimetres, as slicers take them, or in metres; the solid itself stays in metres."""
    solid = whole(comm, 3)
    assert solid.write(shared_tmp_path / "made") == [shared_tmp_path / "made" / "solid.stl"]
    (path,) = solid.write(shared_tmp_path / "block.ply", unit="m")
    for file, scale in ((shared_tmp_path / "made" / "solid.stl", 1e3), (path, 1.0)):
        low, high = np.reshape(pyvista.read(file).bounds, (3, 2)).T
        np.testing.assert_allclose(high - low, scale * np.array([0.8, 0.2, 0.1]), rtol=1e-6)
    assert np.ptp(solid.points, axis=0)[0] == pytest.approx(0.8, rel=1e-12)
    with pytest.raises(TypeError, match=r"solid.write has no option 'units'; did you mean 'unit'"):
        solid.write(shared_tmp_path, units="mm")
    with pytest.raises(ValueError, match="solid: unit must be"):
        solid.write(shared_tmp_path, unit="inch")
