# SPDX-License-Identifier: MIT
"""What parts are worth: fitted meshes against meshes of their own."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import four_bar, slider_crank, three_load_cases
from spatial_slider_crank import spatial_problem

import dolfinx_ffr as ffr
from dolfinx_ffr.part import ball_widths
from dolfinx_ffr.reduction import flexible_body


def strip(p: np.ndarray) -> np.ndarray:
    return 0.01 - np.abs(p[:, 1])


def flanges(p: np.ndarray) -> np.ndarray:
    return np.abs(p[:, 1]) - 0.01


def full(p: np.ndarray) -> np.ndarray:
    return np.ones(len(p))


def solid(problem: ffr.Problem) -> dict[str, np.ndarray]:
    """Densities one of all bodies."""
    return {name: np.ones(body.domain.n_cells) for name, body in problem.flexible.items()}


def part_of(problem: ffr.Problem, field: Any = full, name: str = "rod") -> ffr.Part:
    """The part of a body, by default all of it."""
    body = problem.flexible[name]
    return ffr.Part(body.domain, field, material=body.material)


def untouched(problem: ffr.Problem, kind: type[ffr.design.Design] = ffr.LevelSet) -> ffr.Result:
    """The result of a design that keeps all its material."""
    design = kind(problem.flexible["rod"].domain)
    start = design.even(1.0)
    return ffr.optimize(problem, design, start, volume=1.0, iterations=0, progress=False)


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
    part = part_of(problem, field)
    verification = part.verify(problem, evaluation, size=0.004, tolerance=3e-3)
    assert verification.converged
    # inner corners are singular, and psi of both meshes still grows by 2e-3 with each refinement
    assert verification.difference == pytest.approx(0.0, abs=3e-3)
    (rod,) = verification.fitted[-1].bodies.values()
    assert rod.mass == pytest.approx(part.mass, rel=1e-9)
    assert rod.volume == pytest.approx(part.area / body.area, rel=1e-9)
    frequencies = evaluation.fixed_interface_frequencies["rod"]
    np.testing.assert_allclose(rod.frequencies, frequencies, rtol=1e-2)
    assert "psi has converged" in verification.summary()
    assert "MPa" in str(verification)


@pytest.mark.mpi
def test_several_bodies_and_other_modes(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """Two parts are verified together and exported; all ranks see the same numbers."""
    problem = four_bar(comm, ffr.IntegralCompliance())
    evaluation = problem.value(solid(problem))
    part_by_name = {name: part_of(problem, name=name) for name in problem.flexible}
    with pytest.warns(ffr.PartWarning, match="% above the reported value"):
        verification = ffr.verify(
            problem, part_by_name, evaluation, modes={"coupler": 4}, most=3, tolerance=5e-3
        )
    assert verification.modes == {"coupler": 4, "rocker": 3}
    assert len(verification.fitted[-1].bodies["coupler"].frequencies) == 4
    # coarse cells of order 1 are stiffer than they should be
    assert 0.0 < verification.difference < 0.2
    for name, part in part_by_name.items():
        assert verification.fitted[-1].bodies[name].mass == pytest.approx(part.mass, rel=1e-9)
    assert len(set(comm.allgather(verification.psi))) == 1
    integrals = verification.bodies["coupler"][1].integrals
    for name in ("coupler.SID_FEM", "coupler.npz"):
        verification.export(shared_tmp_path / name, "coupler")
        read = ffr.VolumeIntegrals.load(shared_tmp_path / name)
        assert read.dimension == (2 if name.endswith("npz") else 3)
        np.testing.assert_allclose(
            read.G[1:, 1:], integrals.G[1:, 1:], atol=1e-12 * np.max(integrals.G)
        )
        np.testing.assert_allclose(read.K, integrals.K, rtol=1e-12)
    with pytest.raises(ValueError, match="name = None, but the parts are"):
        verification.export(shared_tmp_path / "either.npz")
    with pytest.raises(OSError, match="nowhere"):
        verification.export(shared_tmp_path / "nowhere" / "rod.npz", "rocker")


def test_a_part_in_several_load_cases(comm: MPI.Comm) -> None:
    """Psi of the worst case, and of each load case, beside what was reported."""
    problem = three_load_cases(comm, ffr.WorstCase({"slow": 1.5, "fast": 1.0, "lever": 0.0}))
    evaluation = problem.value(solid(problem))
    with pytest.warns(ffr.PartWarning) as warned:
        verification = part_of(problem).verify(problem, evaluation, most=2, tolerance=5e-3)
    messages = [str(each.message) for each in warned]
    assert "% above the reported value" in messages[0]
    # the full rod is too heavy for the fast load case before it is meshed anew
    assert len(messages) == 3 and "the parts differ from their design: psi " in messages[1]
    assert "'fast: JointForce' by 48.4 % of the bound (11.87 of the design" in messages[2]
    assert "at most 8); the design itself exceeds it by 48.4 %" in messages[2]
    # coarse cells of order 1 are stiffer than they should be
    assert 0.0 < verification.difference < 0.1
    psi = verification.fitted[-1].load_cases
    assert verification.psi == max(1.5 * psi["slow"], psi["fast"])
    assert psi["lever"] == pytest.approx(evaluation.load_cases["lever"].psi, rel=0.1)
    assert "lever: stress" in str(verification) and "load case lever: psi" in str(verification)
    assert verification.record()["load_cases"]["lever"][1] == psi["lever"]


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
    evaluation = problem.value(on_cells(body, strip))
    with pytest.warns(ffr.PartWarning, match="the part violates 'mask' by 11.1 %"):
        verification = part_of(problem, strip).verify(problem, evaluation, most=2)
    message = "constraint mask: 0.5556 -> 0.5556, at most 0.5, 11.1 % beyond its bound"
    assert message in verification.summary()
    (rod,) = verification.fitted[-1].bodies.values()
    assert rod.volume == pytest.approx(0.6, rel=1e-9)
    shares = {"left": 5 / 9, "mask": 5 / 9, "all": 0.6}
    assert verification.fitted[-1].constraints == pytest.approx(shares, rel=1e-9)


def test_what_cannot_be_verified(comm: MPI.Comm) -> None:
    problem = slider_crank(comm, (20, 4), modes=2, steps=100)
    evaluation, part = problem.value(solid(problem)), part_of(problem)
    with pytest.raises(ValueError, match=r"parts for \['arm'\], but the flexible bodies are"):
        ffr.verify(problem, {"arm": part}, evaluation)
    with pytest.raises(ValueError, match=r"volume is given for \['arm'\], but the flexible bodies"):
        part.verify(problem, evaluation, volume={"arm": 0.5})
    with pytest.raises(TypeError, match="evaluation must be an Evaluation"):
        part.verify(problem, evaluation.psi)  # type: ignore[arg-type]
    with (
        pytest.warns(ffr.PartWarning, match="above the reported value"),
        pytest.warns(ffr.PartWarning, match="psi still changes by"),
    ):
        part.verify(problem, evaluation, tolerance=1e-12, most=2, size=0.04)


@pytest.mark.mpi
def test_memory_is_told_before_a_mesh_is_tried(
    comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That of a factor, if there is one, and of the fields of modes and stress."""
    problem = slider_crank(comm, (20, 4), modes=2, steps=100)
    evaluation, part = problem.value(solid(problem)), part_of(problem)
    monkeypatch.setattr(flexible_body, "agreed_memory", lambda comm: 1_000_000 // comm.size)
    with pytest.raises(ValueError, match=r"a mesh of 'rod' with cells of .* left; give a larger"):
        part.verify(problem, evaluation)
    # where the first mesh fits and the next does not, the first is told
    rooms = iter([2**50, 0])
    monkeypatch.setattr(flexible_body, "agreed_memory", lambda comm: next(rooms))
    with pytest.warns(ffr.part.PartWarning, match="the last mesh could not be made") as caught:
        verification = part.verify(problem, evaluation)
    assert len(verification.fitted) == 1 and not verification.converged
    assert not any("still changes by" in str(one.message) for one in caught)
    assert (
        verification.fitted[0].bodies["rod"].stress > 0.0
        and "one mesh only" in verification.summary()
    )


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore:verify. psi still changes")
@pytest.mark.parametrize("kind", [ffr.Part, pytest.param(ffr.Solid, marks=pytest.mark.slow)])
def test_result_of_a_design_as_a_part(
    comm: MPI.Comm, shared_tmp_path: Path, kind: type, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A design that keeps all its material has the body as its part, with its psi."""
    plane = kind is ffr.Part
    if plane:
        problem = slider_crank(comm, (40, 4), modes=2, steps=100)
    else:
        monkeypatch.setattr(ball_widths, "MOST_SAMPLES", 3_000)
        problem = spatial_problem(comm, (10, 2, 2), modes=2, steps=240)
    result = untouched(problem, ffr.LevelSet if plane else ffr.DensityDesign)
    part, rod = result.part(), problem.flexible["rod"].domain
    assert isinstance(part, kind) and part is result.part("rod")
    assert (part.area if plane else part.volume) == pytest.approx(rod.area, rel=1e-12)
    verification = result.finish(shared_tmp_path, **({"tolerance": 5e-3} if plane else {}))
    assert verification is not None
    record = verification.record()["bodies"]["rod"]
    assert record["pieces"] == 1
    if plane:
        assert verification.psi == pytest.approx(problem.value(solid(problem)).psi, rel=0.1)
        assert record["holes"] == 0
        assert record["mass"][1] == pytest.approx(part.mass, rel=1e-12)
    else:
        assert (
            0.0 < verification.difference < 4.0
        )  # linear elements are stiffer than they should be
        rod = ffr.run_record(result, verification=verification)["verification"]["bodies"]["rod"]
        assert rod["elements"] == "tetrahedra" and rod["thinnest_member"] is None
    with pytest.raises(ValueError, match="result: part must be 'rod', but it is 'arm'"):
        result.part("arm")
    for suffix in ("svg", "dxf", "step", "stl", "png") if plane else ("stl", "png"):
        assert (shared_tmp_path / f"{part.kind}.{suffix}").stat().st_size > 500, suffix


def test_a_limit_that_the_part_exceeds(comm: MPI.Comm) -> None:
    """The largest stress of the part itself is held against the limit, not a mean of it."""
    body = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(20, 8))
    scene = slider_crank(comm, domain=body, modes=2, steps=200)
    peak, x = ffr.PeakStress("rod"), on_cells(body, strip)
    problem = ffr.Problem(scene.bodies, scene.mechanism, scene.integrator, peak)
    reported = problem.calibrated(problem.value(x))[1].psi
    limits = [
        ffr.Constraint(peak, upper=1.1 * reported, name="stress"),
        ffr.Constraint(2.0 * peak + ffr.Mass("rod"), upper=1.0, name="sum"),
    ]
    load_cases = {
        name: ffr.MechanicalProblem(scene.mechanism, scene.integrator, peak, limits[:1])
        for name in ("one", "other")
    }
    for problem in (
        ffr.Problem(scene.bodies, scene.mechanism, scene.integrator, peak, limits),
        ffr.Problem.of_load_cases(scene.bodies, load_cases, ffr.WorstCase()),
    ):
        with pytest.warns(ffr.PartWarning) as warned:
            part = part_of(problem, strip)
            computed = part.verify(problem, problem.value(x), most=2, tolerance=1e-12)
        finest = computed.fitted[-1]
        stress = finest.bodies["rod"].stress
        assert stress is not None and stress > 1.3 * reported
        message = (
            f"largest stress of 'rod' {reported / 1e6:.4g} MPa, of the part {stress / 1e6:.4g} MPa"
        )
        assert message in computed.differences and message in computed.record()["differences"]
        assert any(message in str(each.message) for each in warned)
        assert computed.reported.psi == pytest.approx(reported, rel=1e-6)
        assert computed.psi == pytest.approx(stress, rel=1e-9)
        for name, value in finest.constraints.items():
            exact = stress if "stress" in name else 2.0 * stress + finest.bodies["rod"].mass
            assert value == pytest.approx(exact, rel=1e-9)
            limit = problem.constraints[list(finest.constraints).index(name)].bound
            numbers = f"{computed.reported.constraints[name]:.4g} of the design, {value:.4g} of "
            numbers += f"the part, at most {limit:.4g}"
            messages = [str(each.message) for each in warned if repr(name) in str(each.message)]
            assert len(messages) == 1 and numbers in messages[0]
            assert f"constraint {name}: " in computed.summary()
            assert f"at most {limit:.4g}" in computed.summary()
        assert computed.record()["violations"] == pytest.approx(computed.violations)
        assert set(computed.violations) == set(finest.constraints)
        # bounds that are exceeded by less than they changed are not decided
        assert computed.decided
        barely = dataclasses.replace(finest, excesses=dict.fromkeys(finest.excesses, 1e-3))
        unsure = dataclasses.replace(
            computed, fitted=[*computed.fitted[:-1], barely], tolerance=2e-3
        )
        assert not unsure.decided


def test_a_part_of_more_volume_than_is_allowed(comm: MPI.Comm) -> None:
    """The bound of `optimize` is held against the part, too, when the result is verified."""
    problem = slider_crank(comm, (20, 4), modes=2, steps=200)
    result = untouched(problem)
    narrower = dataclasses.replace(result, bounds={"rod": 0.8})
    with pytest.warns(ffr.PartWarning, match="'volume of rod' by 25.0 % .*, 1 of the part, at mo"):
        verification = narrower.verify(tolerance=1e-2)
    assert verification.violations == pytest.approx({"volume of rod": 0.25})
    assert narrower.violations == verification.violations and not narrower.summary()["feasible"]
    assert result.bounds == {"rod": 1.0} and result.feasible


@pytest.mark.mpi
def test_a_folder_that_is_none_is_refused_before_anything_is_computed(
    comm: MPI.Comm, shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = slider_crank(comm, (10, 2), modes=1, steps=200)
    result = untouched(problem)
    monkeypatch.setattr(ffr.Result, "verify", None)
    with pytest.raises(TypeError, match="finish: folder must be a path, but it is None"):
        result.finish(None)  # type: ignore[arg-type]
    file = shared_tmp_path / "file"
    if comm.rank == 0:
        file.write_text("")
    comm.Barrier()
    with pytest.raises(NotADirectoryError, match=r"finish: folder: .*file' is a file; give a fol"):
        result.finish(file)
    with pytest.raises(NotADirectoryError, match=r"file/below'"):
        result.finish(file / "below")
    with pytest.raises(NotADirectoryError, match=r"optimize: output: .*file' is a file"):
        ffr.optimize(problem, result.designs["rod"], iterations=0, progress=False, output=file)
