# SPDX-License-Identifier: MIT
"""Copies of problems and results: by pickle into other processes, by deepcopy, and threads."""

from __future__ import annotations

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from shared import processes
from shared.meshes import prongs
from shared.problems import slider_crank

import dolfinx_ffr as ffr

#: Designs of the demo's problem in a process that is started anew.
PROGRAM = """
import multiprocessing, os
from mpi4py import MPI
import numpy as np
from slider_crank import reference_problem

def value(problem, x):
    return problem.gradient(x).psi

if __name__ == "__main__":
    problem = reference_problem(MPI.COMM_WORLD, (12, 3), modes=2, steps=100)
    cells = problem.flexible["rod"].domain.n_cells
    designs = [np.full(cells, density) for density in (0.5, 1.0)]
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        found = pool.starmap(value, [(problem, x) for x in designs])
    np.testing.assert_allclose(found, [problem.value(x).psi for x in designs], rtol=1e-9)
    print("the same", os.environ["OMP_THREAD_LIMIT"])
"""


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


@pytest.mark.slow
def test_multiprocessing_spawn(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    done = processes.run(str(program), OMP_NUM_THREADS="1")
    assert done.stdout.strip() == "the same 1", done.stderr[-2000:]


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_pickled_problem_computes_the_same(cell: str) -> None:
    """With markers, stiffening, a curved order and a kept evaluation."""
    comm = MPI.COMM_SELF
    domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(12, 3), cell=cell, order=2)
    of_the_rod = {"markers": {"middle": (0.2, 0.0)}, "stiffening": ("omega2",)}
    problem = slider_crank(comm, domain=domain, modes=2, steps=100, **of_the_rod)
    x = even(problem, 0.7)
    evaluation = problem.gradient(x)
    twin, kept = pickle.loads(pickle.dumps((problem, evaluation)))
    same_evaluation(kept, evaluation)
    same_evaluation(twin.gradient(x), evaluation)
    # an evaluation that has come through pickle can be differentiated, there and here
    for other, value in ((twin, problem.value(x)), (problem, pickle.loads(pickle.dumps(kept)))):
        same_evaluation(other.differentiate(value), evaluation)


def test_pickled_domain_is_numbered_alike() -> None:
    fork = prongs(MPI.COMM_SELF)
    tip = fork.centroids[:, 0] > 0.9
    domain = ffr.Domain(fork.mesh, {"root": fork.interfaces["root"].facets}, void=tip)
    twin = pickle.loads(pickle.dumps(domain))
    for name in ("centroids", "design_cells", "void_cells"):
        np.testing.assert_array_equal(getattr(twin, name), getattr(domain, name), name)
    np.testing.assert_array_equal(twin.interfaces["root"].facets, domain.interfaces["root"].facets)


class OwnDomain(ffr.Domain): ...


class OwnBody(ffr.FlexibleBody): ...


def test_copies_are_of_the_class_that_a_user_derives() -> None:
    rod = small().flexible["rod"]
    own = OwnDomain(rod.domain.mesh, {"left": rod.domain.interfaces["left"].facets})
    body = OwnBody(own, rod.material, frame=ffr.TangentFrame("left"), modes=1)
    for twin in (copy.deepcopy(body), pickle.loads(pickle.dumps(body)), body.with_modes(2)):
        assert (type(twin), type(twin.domain)) == (OwnBody, OwnDomain)


def test_a_design_that_was_pickled_apart_is_refused_with_what_to_do() -> None:
    problem = small()
    design = ffr.DensityDesign(problem.flexible["rod"].domain)
    apart = pickle.loads(pickle.dumps(design))
    with pytest.raises(ValueError, match="pickle problem and design together"):
        ffr.optimize(problem, apart, apart.even(0.5), volume=0.5, progress=False)


def test_pickled_result_goes_on() -> None:
    """A design can be evaluated, and designed further, after it has been kept."""
    problem = slider_crank(MPI.COMM_SELF, (20, 4), modes=2, steps=100)
    levelset = ffr.LevelSet(problem.flexible["rod"].domain)
    start = levelset.with_holes(4, 1, 0.004)
    options = {"volume": 0.85, "boundary": 0, "progress": False}
    options["optimizer"] = ffr.LevelSetEvolution()
    result = ffr.optimize(problem, levelset, start, iterations=2, **options)
    found, twin, again = pickle.loads(pickle.dumps((result, problem, levelset)))
    np.testing.assert_array_equal(found.x, result.x)
    assert found.psi == result.psi
    np.testing.assert_array_equal(found.designs["rod"].density(found.coefficients), result.x)
    assert found.problem.value(found.x).psi == pytest.approx(result.psi, rel=SAME)
    further = ffr.optimize(twin, again, found.coefficients, iterations=1, **options)
    assert np.isfinite(further.psi)


@pytest.mark.mpi
def test_deep_copies_are_independent(comm: MPI.Intracomm) -> None:
    problem = small(comm)
    x = even(problem, 0.7)
    evaluation = problem.gradient(x)
    twin, kept = copy.deepcopy(problem), copy.deepcopy(evaluation)
    problem.value(even(problem, 0.5))
    same_evaluation(twin.gradient(x), evaluation)
    kept.trajectory.y[:] = 0.0
    assert np.any(evaluation.trajectory.y)


@pytest.mark.mpi
def test_distributed_domain_says_that_it_cannot_be_pickled(comm: MPI.Intracomm) -> None:
    problem = small(comm)
    if comm.size > 1:
        with pytest.raises(pickle.PicklingError, match=f"a Domain on {comm.size} ranks"):
            pickle.dumps(problem)
    # what a rank holds of an evaluation are arrays
    evaluation = problem.value(even(problem, 1.0))
    assert pickle.loads(pickle.dumps(evaluation)).psi == evaluation.psi


def test_one_problem_in_several_threads() -> None:
    """Each thread has the numbers of its own density, as if it were alone."""
    problem = small()
    designs = [even(problem, value) for value in np.linspace(0.3, 1.0, 8)]
    expected = [problem.gradient(x) for x in designs]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(problem.gradient, designs))
    for one, other in zip(found, expected, strict=True):
        same_evaluation(one, other)
