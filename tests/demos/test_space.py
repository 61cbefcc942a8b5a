# SPDX-License-Identifier: MIT
"""Demos in space on small meshes, and Haug's slider-crank in numbers."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import spatial_robot_arm
from spatial_blade import blade_problem
from spatial_slider_crank import main, slider_of, spatial_problem

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.verification import assert_taylor_order, taylor_test

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::UserWarning")]


def test_way_of_the_slider() -> None:
    """The closed form, beside E. J. Haug's numbers for angles that he counts from z."""
    for degrees, x in ((0, 0.2), (45, 0.238615293517), (90, 0.274226184016), (180, 0.28)):
        assert slider_of(np.radians(degrees + 90.0)) == pytest.approx(x, abs=1e-12)


@pytest.mark.mpi
def test_design_on_any_number_of_ranks(
    comm: MPI.Intracomm, shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The program leaves its files; several ranks find the design that one does."""
    monkeypatch.setattr(plotting, "animate_motion", lambda *_, **__: None)
    monkeypatch.setattr(plotting, "plot_modes", lambda *_, **__: None)
    monkeypatch.setattr(plotting, "plot_scene", lambda *_, **__: None)
    out = shared_tmp_path / "out"
    small = ["--elements", "16", "4", "4", "--steps", "400", "--iterations", "6"]
    main([*small, "--output", str(out)])
    comm.Barrier()
    found = json.loads((out / "summary.json").read_text())
    assert found["gradient"] == pytest.approx(found["central_difference"], rel=1e-5)
    for name in (
        "design.xdmf",
        "design.png",
        "solid.stl",
        "solid.png",
        "stress.png",
        "report.html",
    ):
        assert (out / name).stat().st_size > 500, name
    problem = spatial_problem(MPI.COMM_SELF, (16, 4, 4), steps=400)
    with warnings.catch_warnings():  # no good design in so few iterations
        warnings.simplefilter("ignore")
        levelset = ffr.LevelSet(problem.flexible["rod"].domain)
        options = {"volume": 0.5, "iterations": 6, "progress": False}
        alone = ffr.optimize(problem, levelset, **options)
    assert found["compliance_final"] == pytest.approx(alone.psi, rel=1e-6)


def test_arm_follows_its_motors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The program of the arm leaves its files, and its hand is where that of a rigid arm is."""
    monkeypatch.setattr(plotting, "animate_motion", lambda *_, **__: None)
    small = ["--elements", "12", "3", "3", "--steps", "150", "--iterations", "2"]
    spatial_robot_arm.main([*small, "--output", str(tmp_path)])
    found = json.loads((tmp_path / "summary.json").read_text())
    assert found["error_full"] < 0.01 * spatial_robot_arm.FORE[0]
    assert found["error_full"] < found["error_bars"]
    for name in ("scene.png", "forearm/solid.stl", "upper_arm/design.xdmf", "report.html"):
        assert (tmp_path / name).stat().st_size > 500, name


@pytest.mark.mpi
def test_pull_stiffens_the_blade(comm: MPI.Intracomm) -> None:
    """It bends less than a linear one, and the gradient holds the nine loads of rotation."""
    problem = blade_problem(comm, (8, 3, 1), steps=200)
    domain = problem.flexible["blade"].domain
    linear = blade_problem(comm, (8, 3, 1), stiffening=False, steps=200)
    ones = np.ones(domain.n_cells)
    assert problem.value(ones).psi < 0.9 * linear.value(ones).psi
    c = domain.centroids
    x = np.where(domain.design_cells, 0.7 + 0.2 * np.sin(40 * c[:, 0] + 90 * c[:, 1]), 1.0)
    direction = np.cos(60 * c[:, 0] - 70 * c[:, 1]) * domain.design_cells
    gradient = problem.gradient(x).gradient
    assert gradient is not None
    # thin elements of order 2 are ill-conditioned: the spread over densities that hardly differ
    values = [problem.value(x * (1.0 - k * 1e-13)).psi for k in range(4)]
    result = taylor_test(
        lambda d: problem.value(d).psi,
        lambda d: comm.allreduce(float(gradient["blade"] @ d)),
        x,
        direction,
        steps=[0.04, 0.02, 0.01, 0.005],
        roundoff=4.0 * float(np.ptp(values)) / values[0],
    )
    assert_taylor_order(result)
