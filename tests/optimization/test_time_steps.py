# SPDX-License-Identifier: MIT
"""Time steps that were chosen are right for all bodies, and looked at again along a run."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import crank_motion, slider_crank

import dolfinx_ffr as ffr

TOLERANCE = 1e-3


def problem_of(comm: MPI.Intracomm) -> ffr.Problem:
    """A rod on a crank, its steps chosen."""
    rod = slider_crank(comm).flexible["rod"]
    interval = ffr.TimeInterval(0.4, TOLERANCE)
    return ffr.Problem({"rod": rod}, crank_motion(0.4), interval, ffr.IntegralCompliance())


def too_few(problem: ffr.Problem) -> ffr.Problem:
    """The same with far longer steps, as if they had been chosen."""
    method = ffr.GeneralizedAlpha(0.4, 100, chosen_for=TOLERANCE)
    return problem.with_integrators(dict.fromkeys(problem.load_cases, method))


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore::dolfinx_ffr.SofteningWarning")  # of what is tried
@pytest.mark.filterwarnings("ignore::dolfinx_ffr.LargeDeformationWarning")
def test_steps_that_do_no_more_are_chosen_anew(comm: MPI.Intracomm, tmp_path: Path) -> None:
    """In a run, from its start, and kept where it is resumed."""
    problem = too_few(problem_of(comm))
    x = np.full(problem.flexible["rod"].domain.n_cells, 0.5)
    again = problem.with_steps_for(problem.value(x))
    assert again is not problem and again.integrator != problem.integrator
    (error,) = again.time_errors(again.value(x)).values()
    assert error <= TOLERANCE
    folder = comm.bcast(tmp_path)
    options = {"volume": 0.6, "output": folder, "progress": False, "mode_tolerance": None}
    options["boundary"] = 0
    design = ffr.DensityDesign(problem.flexible["rod"].domain, radius=0.02)
    with pytest.warns(ffr.DesignWarning):  # gray after so few iterations
        result = ffr.optimize(problem, design, iterations=2, **options)
        assert result.problem.integrator == again.integrator
        more = ffr.optimize(problem, design, iterations=3, resume=True, **options)
    assert more.history["psi"][2] == pytest.approx(result.history["psi"][2], rel=1e-6)
    assert more.problem.integrator == again.integrator
