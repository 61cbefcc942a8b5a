# SPDX-License-Identifier: MIT
"""What a scene models, and how many modes it needs."""

from __future__ import annotations

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from shared.rods import STEEL
from slider_crank import reference_problem

import dolfinx_ffr as ffr


@pytest.mark.mpi
def test_report_of_the_slider_crank(comm: MPI.Intracomm) -> None:
    """Counts are right, and estimated errors are near those against a finer model."""
    problem = reference_problem(comm, (60, 6), modes=6, steps=800)
    x = np.ones(problem.flexible["rod"].domain.n_cells)
    evaluation = problem.value(x)
    report = ffr.model_report(problem, evaluation)
    rod = report.bodies["rod"]
    assert (rod.kind, rod.constraint_modes, rod.normal_modes) == ("flexible", 3, 6)
    assert (report.coordinates, report.rows) == (12, 3)
    assert (rod.elements, rod.order) == (360, 1)
    assert 0.0 < rod.softening < 0.01
    assert rod.highest_frequency < rod.next_frequency
    assert report.left_out == ["gravity", "damping", "forces", "geometric stiffening"]
    many = problem.with_modes({"rod": 16}).value(x).psi
    problem.integrator = replace(problem.integrator, steps=8000)
    fine = problem.value(x).psi
    assert report.step_error == pytest.approx(abs(evaluation.psi / fine - 1.0), rel=0.3)
    missing = abs(evaluation.psi / many - 1.0)
    assert missing / 1.2 < report.modes_error < 1.2 * missing
    text = str(report)
    assert "3 constraint and 6 normal modes" in text and "left out: gravity" in text
    assert "elements of order 1 lock: where few of them are across, rod is too stiff" in text
    assert "the error by the mesh is not estimated" in text
    quadratic = replace(report, bodies={"rod": replace(rod, order=2)})
    assert "lock" not in str(quadratic) and "not estimated" in str(quadratic)


@pytest.mark.filterwarnings("ignore:.*excites vibrations:dolfinx_ffr.TimeStepWarning")
@pytest.mark.mpi
@pytest.mark.parametrize(("half", "named"), [(0.11, {"slot": 0.5}), (0.03, {})])
def test_long_interfaces_are_named(comm: MPI.Comm, half: float, named: dict[str, float]) -> None:
    """A slot of half the length of a body is; a short piece of it, and the end, are not."""
    grid = ffr.Domain.rectangle(comm, 0.4, 0.02, elements=(20, 1)).mesh
    slot = lambda x: (x[1] > 0.009) & (np.abs(x[0] - 0.2) < half)  # noqa: E731
    domain = ffr.Domain(grid, {"pin": lambda x: x[0] < 1e-6, "slot": slot})
    bodies = {"rocker": ffr.FlexibleBody(domain, STEEL, frame=ffr.TangentFrame("pin"), modes=1)}
    pin = ffr.Revolute(("rocker", "pin"), ffr.Ground())
    mechanism = ffr.Mechanism({"rocker": ffr.Placement()}, [pin], gravity=(0.0, -9.81))
    integrator = ffr.GeneralizedAlpha(0.1, 40)
    problem = ffr.Problem(bodies, mechanism, integrator, ffr.IntegralCompliance())
    report = ffr.model_report(problem, problem.value(np.ones(domain.n_cells)))
    assert report.bodies["rocker"].long_interfaces == pytest.approx(named, rel=0.01)
    assert ("interface 'slot' spans 50 % of rocker" in str(report)) == bool(named)


def test_stiff_damping_in_long_steps_is_told_from_missing_modes(comm: MPI.Intracomm) -> None:
    """The steps leave psi in each mode that is added; half as long, a tenth of it."""
    problem = reference_problem(comm, (20, 2), modes=4, steps=1000)
    mechanism = replace(problem.mechanism, damping={"rod": ffr.RayleighDamping(beta=1e-3)})
    problem = ffr.Problem(problem.bodies, mechanism, problem.integrator, problem.objective)
    evaluation = problem.value(np.ones(problem.flexible["rod"].domain.n_cells))
    with pytest.warns(ffr.TimeStepWarning, match="shorter steps: the steps are too"):
        error = ffr.mode_error(problem, evaluation)["rod"]
    assert error > 0.1
