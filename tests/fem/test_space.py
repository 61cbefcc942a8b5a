# SPDX-License-Identifier: MIT
"""Bodies in space: meshes and their interfaces, stiffness, mass and stress against closed forms."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shared.meshes import write_pierced_block

import dolfinx_ffr as ffr
from dolfinx_ffr import Domain
from dolfinx_ffr.fem import Elasticity, StressRecovery, rigid_fields

pytestmark = pytest.mark.mpi

STEEL = ffr.Isotropic(210e9, 0.3, 7800.0)
CELLS = [("hexahedron", 1), ("hexahedron", 2), ("tetrahedron", 2)]


def box(comm: MPI.Intracomm, cell: str, order: int) -> Domain:
    """A short rod of some cells."""
    return Domain.box(comm, 0.5, 0.2, 0.1, elements=(6, 2, 2), cell=cell, order=order)


@pytest.mark.parametrize(("cell", "order"), CELLS)
def test_the_mass_has_entries_within_each_axis_alone(
    comm: MPI.Intracomm, cell: str, order: int
) -> None:
    """A third of the stiffness's entries, and the same rows and columns for every axis."""
    elasticity = Elasticity(box(comm, cell, order), STEEL, ffr.SIMP())
    matrices = elasticity.assemble(np.linspace(0.1, 1.0, elasticity.domain.n_cells))
    stiffness, mass = (m.getValuesCSR() for m in (matrices.stiffness, matrices.mass))
    assert 3 * len(mass[1]) == len(stiffness[1])
    lengths = np.diff(mass[0])
    rows = np.repeat(np.arange(len(lengths)), lengths)
    assert not np.any((rows - mass[1]) % 3)
    moved = elasticity.apply(matrices.mass, np.ones((elasticity.n_dofs, 1))).reshape(-1, 3)
    assert_allclose(moved, moved[:, :1] @ np.ones((1, 3)), rtol=1e-13)
    matrices.destroy()


@pytest.mark.parametrize(("cell", "order"), CELLS)
def test_rigid_motions_and_a_linear_field(comm: MPI.Intracomm, cell: str, order: int) -> None:
    """Volume and inertia are exact, rigid motions have no stress, even strains have Hooke's.

    The strains are e_x = 1e-3 and the shear g_yz = 2e-3; the recovery has its exact transpose.
    """
    domain = box(comm, cell, order)
    assert domain.area == pytest.approx(0.01, rel=1e-12)
    assert domain.sum(domain.cell_volumes * ~domain.design_cells) == pytest.approx(0.01 * 4 / 6)
    for name, at, normal in (("left", 0.0, -1.0), ("right", 0.5, 1.0)):
        interface = domain.interfaces[name]
        assert_allclose(interface.center, [at, 0.0, 0.0], atol=1e-14)
        assert interface.axis is not None
        assert_allclose(interface.axis, [normal, 0.0, 0.0], atol=1e-13)
    elasticity = Elasticity(domain, STEEL, ffr.SIMP())
    matrices, x = elasticity.assemble(np.ones(domain.n_cells)), elasticity.coordinates()
    motions = rigid_fields(x, np.array([0.25, 0.0, 0.0]))
    gram = elasticity.inner(motions, elasticity.apply(matrices.mass, motions))
    mass, (a, b, c) = 78.0, (0.5, 0.2, 0.1)
    about = np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    assert_allclose(gram, np.diag([mass] * 3 + list(mass / 12 * about)), atol=1e-11)
    forces = elasticity.apply(matrices.stiffness, motions)
    assert elasticity.largest(np.abs(forces)) < 1e-12 * STEEL.young
    matrices.destroy()
    field = np.column_stack([1e-3 * x[:, 0], 2e-3 * x[:, 2], 0.0 * x[:, 0]]).reshape(-1, 1)
    recovery = StressRecovery(elasticity, STEEL)
    first, second = STEEL.lame
    exact = np.array([first + 2 * second, first, first, 0.0, 2 * second, 0.0]) * 1e-3
    recovered = recovery(field)
    assert_allclose(
        recovered, np.broadcast_to(exact[:, None], recovered.shape), atol=1e-10 * exact[0]
    )
    energy = elasticity.strain_energy(np.ones(domain.n_cells), field[:, 0])
    density = 0.5 * (1e-3 * exact[0] + 2e-3 * exact[4])
    assert_allclose(energy, density * domain.cell_volumes, rtol=1e-10)
    bar = np.random.default_rng(comm.rank).standard_normal(recovered.shape)
    product = comm.allreduce(float(np.sum(bar * recovered)))
    right = float(elasticity.inner(recovery.transposed(bar), field)[0, 0])
    assert product == pytest.approx(right, rel=1e-10)


def test_materials_of_the_other_dimension_are_refused(comm: MPI.Intracomm) -> None:
    """A plane material for a mesh in space, and the other way round."""
    flat = Domain.rectangle(comm, 1.0, 1.0, elements=(6, 1))
    solid, law = box(comm, "hexahedron", 1), SimpleNamespace(thickness=1.0, out_of_plane=0.0)
    law.on = STEEL.on
    for domain, material, message in (
        (
            solid,
            ffr.PlaneStress(1.0, 0.3, 1.0),
            "PlaneStress is a material for the plane.*Isotropi",
        ),
        (solid, law, "or a law that has the attribute dimension = 3"),
        (flat, STEEL, "Isotropic is a material for space.*PlaneStress"),
    ):
        with pytest.raises(ValueError, match=message):
            Elasticity(domain, material, ffr.SIMP())


def test_gmsh_file_with_a_bore(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """Volumes and surfaces by their names; centre and axis of a tilted bore are found."""
    path, angle = shared_tmp_path / "block.msh", 0.3
    if comm.rank == 0:
        write_pierced_block(path, tilt=angle)
    comm.Barrier()
    domain = Domain.from_gmsh(comm, path, interfaces=["left", "bore"])
    assert domain.cell == "tetrahedron"
    turn = np.array(
        [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]
    )
    bore, left = domain.interfaces["bore"], domain.interfaces["left"]
    assert_allclose(bore.center, turn @ [0.2, 0.05, 0.1], atol=1e-9)
    assert bore.axis is not None
    assert_allclose(bore.axis, turn @ [0.0, 0.0, 1.0], atol=1e-9)
    assert_allclose(left.center, turn @ [-0.5, 0.0, 0.1], atol=1e-9)
    with pytest.raises(ValueError, match=r"no physical surface named 'eye'.*\['bore', 'left'\]"):
        Domain.from_gmsh(comm, path, interfaces=["eye"])
