# SPDX-License-Identifier: MIT
"""What parts are worth: fitted meshes against meshes of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import four_bar, slider_crank, three_motions

import dolfinx_ffr as ffr


def strip(p: np.ndarray) -> np.ndarray:
    return 0.01 - np.abs(p[:, 1])


def flanges(p: np.ndarray) -> np.ndarray:
    return np.abs(p[:, 1]) - 0.01


def on_cells(domain: ffr.Domain, field) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Density one where a field is positive; the sides of cells are on its zero line."""
    return np.where(domain.solid_cells | (field(domain.centroids) > 0.0), 1.0, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("field", [strip, flanges])
def test_psi_of_a_mesh_of_its_own(comm: MPI.Comm, field) -> None:  # type: ignore[no-untyped-def]
    """A fitted part has the psi of quadrilaterals of order 2 that fit it, without their void."""
    body = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(80, 16), order=2)
    problem = slider_crank(comm, domain=body, interpolation=ffr.SIMP(floor=1e-9))
    evaluation = problem.value(on_cells(body, field))
    part = ffr.Part(body, field, material=problem.flexible["rod"].material)
    found = part.verify(problem, evaluation, size=0.004, tolerance=3e-3)
    assert found.converged
    # inner corners are singular, and psi of both meshes still grows by 2e-3 with each refinement
    assert found.difference == pytest.approx(0.0, abs=3e-3)
    (rod,) = found.fitted[-1].bodies.values()
    assert rod.mass == pytest.approx(part.mass, rel=1e-9)
    assert rod.volume == pytest.approx(part.area / body.area, rel=1e-9)
    frequencies = evaluation.fixed_interface_frequencies["rod"]
    np.testing.assert_allclose(rod.frequencies, frequencies, rtol=1e-2)
    assert "psi stands still" in found.summary()
    assert "MPa" in str(found)


@pytest.mark.mpi
def test_several_bodies_and_other_modes(comm: MPI.Comm) -> None:
    """Two parts are verified together; all ranks see the same numbers."""
    problem = four_bar(comm, ffr.IntegralCompliance())
    full = {name: np.ones(body.domain.n_cells) for name, body in problem.flexible.items()}
    evaluation = problem.value(full)
    parts = {
        name: ffr.Part(body.domain, lambda p: np.ones(len(p)), material=body.material)
        for name, body in problem.flexible.items()
    }
    with pytest.warns(ffr.PartWarning, match="% above what was reported"):
        found = ffr.verify(problem, parts, evaluation, modes={"coupler": 4}, most=3, tolerance=5e-3)
    assert found.modes == {"coupler": 4, "rocker": 3}
    assert len(found.fitted[-1].bodies["coupler"].frequencies) == 4
    # coarse cells of order 1 are stiffer than they should be
    assert 0.0 < found.difference < 0.2
    for name, part in parts.items():
        assert found.fitted[-1].bodies[name].mass == pytest.approx(part.mass, rel=1e-9)
    assert len(set(comm.allgather(found.psi))) == 1


@pytest.mark.mpi
def test_a_part_in_several_motions(comm: MPI.Comm) -> None:
    """Psi of the worst case, and of each motion, beside what was reported."""
    problem = three_motions(comm, ffr.WorstCase({"slow": 1.5, "fast": 1.0, "lever": 0.0}))
    rod = problem.flexible["rod"]
    evaluation = problem.value(np.ones(rod.domain.n_cells))
    part = ffr.Part(rod.domain, lambda p: np.ones(len(p)), material=rod.material)
    with pytest.warns(ffr.PartWarning) as warned:
        found = ffr.verify(problem, {"rod": part}, evaluation, most=2, tolerance=5e-3)
    said = [str(each.message) for each in warned]
    assert "% above what was reported" in said[0]
    # the full rod is too heavy for the fast motion before it is meshed anew
    assert len(said) == 2
    assert "'fast: JointForce' by 48.4 % of the bound; the design exceeds it by 4" in said[1]
    # coarse cells of order 1 are stiffer than they should be
    assert 0.0 < found.difference < 0.1
    psi = found.fitted[-1].motions
    assert found.psi == max(1.5 * psi["slow"], psi["fast"])
    assert psi["lever"] == pytest.approx(evaluation.motions["lever"].psi, rel=0.1)
    assert "lever: stress" in str(found) and "motion lever: psi" in str(found)
    assert found.record()["psi_part_by_motion"] == psi


def test_fitted_mesh_has_the_interfaces_and_regions_of_the_body(comm: MPI.Comm) -> None:
    body = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(40, 8))
    part = ffr.Part(body, lambda p: np.hypot(p[:, 0] - 0.2, p[:, 1]) - 0.009)
    mesh = part.domain(0.006)
    assert list(mesh.interfaces) == list(body.interfaces)
    for name, interface in mesh.interfaces.items():
        np.testing.assert_allclose(interface.center, body.interfaces[name].center, atol=1e-15)
        assert interface.extent == pytest.approx(0.04, rel=1e-12)
    solid = mesh.sum(mesh.cell_volumes * mesh.solid_cells)
    assert solid == pytest.approx(4 * 0.01 * 0.04, rel=1e-12)
    # sides of order 2 on the hole
    assert mesh.area == pytest.approx(part.area, rel=1e-5)


@pytest.mark.mpi
def test_volumes_of_a_part_are_shares_of_the_body(comm: MPI.Comm) -> None:
    """Of a region by predicate or by a mask over the cells, as bounds on the design are."""
    body = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(20, 8))
    regions: dict[str, Any] = {
        "left": lambda x: x[0] < 0.36,
        "mask": body.centroids[:, 0] < 0.36,
        "all": None,
    }
    bounds = [
        ffr.Constraint(ffr.Volume("rod", region), upper=0.5 if name == "mask" else 0.7, name=name)
        for name, region in regions.items()
    ]
    scene = slider_crank(comm, domain=body, modes=2)
    problem = ffr.Problem(scene.bodies, scene.mechanism, scene.integrator, ffr.Mass("rod"), bounds)
    part = ffr.Part(body, strip, material=problem.flexible["rod"].material)
    with pytest.warns(ffr.PartWarning, match="the part violates 'mask' by 11.1 %"):
        found = part.verify(problem, problem.value(on_cells(body, strip)), most=2)
    assert "constraint mask: 0.5556 -> 0.5556, 11.1 % beyond its bound" in found.summary()
    (rod,) = found.fitted[-1].bodies.values()
    assert rod.volume == pytest.approx(0.6, rel=1e-9)
    assert found.fitted[-1].constraints == pytest.approx(
        {"left": 5 / 9, "mask": 5 / 9, "all": 0.6}, rel=1e-9
    )


def test_what_cannot_be_verified(comm: MPI.Comm) -> None:
    problem = slider_crank(comm, (20, 4), modes=2, steps=100)
    body = problem.flexible["rod"].domain
    evaluation = problem.value(np.ones(body.n_cells))
    part = ffr.Part(body, lambda p: np.ones(len(p)))
    with pytest.raises(ValueError, match=r"parts for \['arm'\], but the flexible bodies are"):
        ffr.verify(problem, {"arm": part}, evaluation)
    with pytest.raises(TypeError, match="evaluation must be an Evaluation"):
        part.verify(problem, evaluation.psi)  # type: ignore[arg-type]
    with (
        pytest.warns(ffr.PartWarning, match="above what was reported"),
        pytest.warns(ffr.PartWarning, match="psi still changes by"),
    ):
        part.verify(problem, evaluation, tolerance=1e-12, most=2, size=0.04)


@pytest.mark.mpi
def test_result_of_a_design_as_a_part(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """A design that keeps all its material has the body as its part, with its psi."""
    problem = slider_crank(comm, (40, 4), modes=2, steps=100)
    rod = problem.flexible["rod"].domain
    levelset = ffr.LevelSet(rod)
    start = levelset.even(1.0)
    result = ffr.optimize(problem, levelset, start, volume=1.0, iterations=0, progress=False)
    part = result.part()
    assert part is result.part("rod")
    assert part.area == pytest.approx(rod.area, rel=1e-12)
    found = result.finish(shared_tmp_path, tolerance=5e-3)
    assert found is not None
    full = problem.value(np.ones(rod.n_cells)).psi
    assert found.psi == pytest.approx(full, rel=0.1)
    record = found.record()
    assert record["part_pieces"] == 1
    assert record["part_holes"] == 0
    assert record["part_mass"] == pytest.approx(part.mass, rel=1e-12)
    with pytest.raises(ValueError, match="result: part must be 'rod', but it is 'arm'"):
        result.part("arm")
    for kind in ("svg", "dxf", "step", "stl", "png"):
        assert (shared_tmp_path / f"part.{kind}").stat().st_size > 500, kind
