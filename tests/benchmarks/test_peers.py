# SPDX-License-Identifier: MIT
"""The model that the benchmarks hand to other packages is ours; none of them is needed here."""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import numpy as np
import peer_packages
import peers
import pytest
import run
import scipy.sparse
import scipy.sparse.linalg
from peer_exudyn import Crank, crank_pin
from peer_motion import hand_over
from peer_pymoto import Plate, random_density
from peer_report import ALPHA, EXUDYN, OURS, RADAU, TRAPEZOIDAL
from report import Study
from scene import slider_crank
from shared.derivatives import check_gradient

import dolfinx_ffr as ffr


@pytest.mark.parametrize("elements", [(10, 2), (6, 1, 1)])
def test_the_rod_handed_over_is_ours_with_the_slider(
    tmp_path: Path, elements: tuple[int, ...]
) -> None:
    body = slider_crank(MPI.COMM_SELF, elements, modes=2).flexible["rod"]
    reduced = body.reduce(np.linspace(0.5, 1.0, body.domain.n_cells))
    hand_over(tmp_path / "rod.npz", body, reduced, 0.5)
    ours = body.in_space(reduced)
    rod = ffr.VolumeIntegrals.load(tmp_path / "rod.npz", format="exudyn")
    w = ours.markers["right"].basis
    assert rod.mass == pytest.approx(ours.mass + 0.5, rel=1e-15)
    np.testing.assert_allclose(rod.S, ours.S + 0.5 * w.T, atol=1e-14)
    heavy = ours.P + 0.5 * np.einsum("ka,lb->abkl", w, w)
    np.testing.assert_allclose(rod.P, heavy, rtol=0.0, atol=1e-12 * np.abs(heavy).max())
    # nodes of the guides: one on the rod's y axis, and the slider
    nodes = np.load(tmp_path / "rod.npz")["xRef"].reshape(-1, 3)
    left = ours.markers["left"].position
    assert nodes[4] == pytest.approx(ours.markers["right"].position)
    assert nodes[2, 1] > left[1] and nodes[2, ::2] == pytest.approx(left[::2])


def test_the_crank_pin_moves_as_ours() -> None:
    crank = Crank(0.1, 5.0, 2.0)
    angle = ffr.Motion.smooth_step(2.0 * np.pi * crank.turns, crank.duration)
    pin = crank_pin(SimpleNamespace(symbolic=np), crank)
    times = np.linspace(0.0, 2.0, 9)
    for t, phi, speed in zip(times, *angle.tabulate(times)[:2], strict=True):
        turned = np.array([np.cos(phi) - 1.0, np.sin(phi)])
        moving = speed * np.array([-np.sin(phi), np.cos(phi)])
        for (position, velocity), place, rate in zip(pin, turned, moving, strict=True):
            assert position(None, t, 0, 0.0) == pytest.approx(crank.radius * place, abs=1e-14)
            assert velocity(None, t, 0, 0.0) == pytest.approx(crank.radius * rate, abs=1e-12)


def test_the_plate_has_the_compliance_of_its_finite_elements() -> None:
    plate = Plate((9, 4))
    problem = peers.plate_problem(MPI.COMM_SELF, plate)
    body = problem.flexible["plate"]
    x = random_density(plate.elements)
    evaluation = problem.value(x)
    stiffness = body.elasticity.assemble(x).stiffness
    K = scipy.sparse.csr_matrix(stiffness.getValuesCSR()[::-1], shape=stiffness.getSize())
    nodes = body.domain.interfaces["right"].dofs
    u = np.zeros(body.elasticity.n_dofs)
    u[2 * nodes + 1] = 1.0
    free = ~body.reduction.clamped
    u[free] = scipy.sparse.linalg.spsolve(K[free][:, free], -(K @ u)[free])
    assert evaluation.psi == pytest.approx(plate.force**2 / (u @ (K @ u)), rel=1e-10)
    direction = np.random.default_rng(1).uniform(-1.0, 1.0, len(x))
    check_gradient(problem, {"plate": 0.9 * x}, {"plate": direction}, taylor=0.01)


def test_missing_peers_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(peer_packages, "FOLDER", tmp_path / "peers")
    monkeypatch.setattr(peer_packages, "PEERS", {"surely_not_installed": "1.0"})
    before = list(sys.path)
    with pytest.raises(SystemExit, match=r"surely_not_installed.*make benchmark-peers"):
        run.parse(["--only", "peers"])
    options = run.parse([])  # all the others
    assert "peers" not in options.only and "growth" in options.only
    monkeypatch.setattr(sys, "path", before)


def test_peers_come_last_on_the_path(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "numpy.py").write_text("raise ImportError('the wrong NumPy')")
    monkeypatch.setattr(peer_packages, "FOLDER", tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    peer_packages.use_peers()
    assert sys.path[-1] == str(tmp_path) and peer_packages.importlib.util.find_spec("numpy").origin
    computed = peer_packages.importlib.machinery.PathFinder.find_spec("numpy", sys.path)
    assert computed is not None and not str(computed.origin).startswith(str(tmp_path))


@pytest.mark.slow
def test_reports_hold_what_was_measured(tmp_path: Path) -> None:
    jobs = {f"{job.function} {job.parameters}": job for job in peers.peers_jobs(quick=True)}
    results = [(job, made_up(job)) for job in jobs.values()]
    study = Study(tmp_path, "peers")
    peers.report_peers(study, results)
    tables = study.write()
    for table in tables:
        with (tmp_path / f"{table.name}.csv").open() as file:
            assert len(list(csv.DictReader(file))) == len(table.rows) > 0
    page = (tmp_path / "peers.md").read_text()
    assert "extrapolated" in page and "(peers.png)" in page and (tmp_path / "peers.png").exists()
    equal = {table.name: table for table in tables}["peers_equal_error"]
    for row in equal.rows:
        # made up so that the peer takes four times as long for each step
        assert row["ratio_alpha"] == pytest.approx(4.0)


def made_up(job: Any) -> dict[str, Any]:
    """Results of a job as they might be."""
    if job.function == "slider_crank_times":
        methods = ((OURS, ALPHA), (EXUDYN, ALPHA), (EXUDYN, TRAPEZOIDAL), (OURS, RADAU))
        rows = [
            {"code": code, "method": method, "steps": n, "seconds": 1e-5 * slow * n}
            | {"error_psi": 300.0 * n**-2.0, "error_deflection": 150.0 * n**-2.0}
            for (code, method), slow in zip(methods, (1.0, 4.0, 3.0, 5.0), strict=True)
            for n in (500, 4000)
        ]
        names = ("psi", "reference_error_psi", "reference_error_deflection", "deflection", "value")
        names += ("gradient", "exudyn_value", "reduction", "exudyn_setup", "agreement", "duration")
        numbers = {**dict.fromkeys(names, 1e-3), "elements": 360, "modes": 11}
        return {"rows": rows, "steps": 2000, "reference": 9, **numbers}
    if job.function == "plate_times":
        values = {"seconds": {OURS: 0.1, "SuperLU": 0.3, "CHOLMOD": 0.2}}
        values["differences"] = dict.fromkeys(("SuperLU", "CHOLMOD"), (1e-12, 2e-12))
        return {**values, "compliance": 1.0, "unknowns": 100}
    return {"base": 100.0, "beyond": 3.0}
