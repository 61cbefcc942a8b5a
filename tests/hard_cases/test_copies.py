# SPDX-License-Identifier: MIT
"""Problems cannot be copied, and can be used by several threads."""

from __future__ import annotations

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import slider_crank

import dolfinx_ffr as ffr


def even(problem: ffr.Problem, value: float) -> np.ndarray:
    return np.full(problem.flexible["rod"].domain.n_cells, value)


def small(comm: MPI.Intracomm = MPI.COMM_SELF) -> ffr.Problem:
    return slider_crank(comm, (12, 3), modes=2, steps=100)


#: Round-off of LAPACK and MUMPS depends on places in memory: some 1e-14 here, while another density
#: or another mesh changes the first digits.
SAME = 1e-9


def same_evaluation(found: ffr.Evaluation, expected: ffr.Evaluation) -> None:
    assert found.psi == pytest.approx(expected.psi, rel=SAME)
    assert found.gradient is not None and expected.gradient is not None
    for one, other in (
        (found.gradient["rod"], expected.gradient["rod"]),
        (found.trajectory.y, expected.trajectory.y),
    ):
        scale = np.max(np.abs(other), initial=0.0)
        np.testing.assert_allclose(one, other, rtol=0.0, atol=SAME * scale)


@pytest.mark.mpi
def test_what_holds_a_mesh_cannot_be_copied(comm: MPI.Intracomm) -> None:
    problem = small(comm)
    design = ffr.DensityDesign(problem.flexible["rod"].domain)
    for thing in (problem, design, problem.flexible["rod"]):
        for copied in (pickle.dumps, copy.deepcopy):
            with pytest.raises(TypeError, match="cannot be pickled or copied; make it anew"):
                copied(thing)
    # what a rank holds of an evaluation are arrays
    evaluation = problem.value(even(problem, 1.0))
    assert pickle.loads(pickle.dumps(evaluation)).psi == evaluation.psi


def test_one_problem_in_several_threads() -> None:
    """Each thread has the numbers of its own density, as if it were alone."""
    problem = small()
    designs = [even(problem, value) for value in np.linspace(0.3, 1.0, 8)]
    expected = [problem.gradient(x) for x in designs]
    with ThreadPoolExecutor(4) as pool:
        evaluations = list(pool.map(problem.gradient, designs))
    for one, other in zip(evaluations, expected, strict=True):
        same_evaluation(one, other)
