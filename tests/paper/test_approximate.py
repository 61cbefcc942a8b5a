# SPDX-License-Identifier: MIT
"""The approximate gradient, the errors it shows, and the design loop with each gradient."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from numpy.testing import assert_allclose
from slider_crank import reference_problem

import dolfinx_ffr as ffr
from dolfinx_ffr.paper import gradient_errors

Distance = Callable[[str], np.ndarray | None]


def holed(comm: MPI.Comm) -> tuple[ffr.Problem, ffr.Evaluation, Distance]:
    """A coarse rod with holes, evaluated, and the distance from their edges."""
    problem = reference_problem(comm, (30, 6), modes=4, steps=100)
    levelset = ffr.LevelSet(problem.flexible["rod"].domain)
    alpha = levelset.with_holes(5, 1, 0.012)
    distance = levelset.distance(alpha)
    return problem, problem.value(levelset.density(alpha)), lambda name: distance


def smooth(comm: MPI.Comm) -> tuple[ffr.Problem, ffr.Evaluation]:
    """A rod of even density, whose gradient is smooth inside, evaluated."""
    problem = reference_problem(comm, (60, 12), modes=4, steps=200)
    domain = problem.flexible["rod"].domain
    return problem, problem.value(np.where(domain.design_cells, 0.8, 1.0))


def approximate(
    problem: ffr.Problem,
    evaluation: ffr.Evaluation,
    distance: Distance = lambda name: None,
    *,
    share: float,
    kernel: Any = ffr.ThinPlate(),  # noqa: B008
    **options: Any,
) -> tuple[np.ndarray, ffr.optimization.GradientReport]:
    """The gradient by a share of the elements, and its report."""
    elements = ffr.paper.GradientElements(share=share)
    method = ffr.paper.ApproximateGradient(elements, kernel, **options)
    approximation, reports = method(problem, evaluation, distance, 0)
    assert approximation.gradient is not None
    return approximation.gradient["rod"], reports["rod"]


def assert_exact(
    problem: ffr.Problem, evaluation: ffr.Evaluation, found: np.ndarray, cells: np.ndarray
) -> None:
    """Demand the exact gradient at some of the cells."""
    exact = problem.differentiate(evaluation).gradient
    assert exact is not None
    largest = problem.comm.allreduce(np.abs(exact["rod"]).max(initial=0.0), MPI.MAX)
    assert_allclose(found[cells], exact["rod"][cells], rtol=1e-7, atol=1e-10 * largest)


@pytest.mark.slow
@pytest.mark.mpi
def test_all_elements_selected_is_exact(comm: MPI.Comm) -> None:
    """Nothing is left to interpolate: the exact gradient, and errors of zero."""
    problem, evaluation, distance = holed(comm)
    approximation, report = approximate(problem, evaluation, distance, share=1.0)
    assert_exact(problem, evaluation, approximation, problem.flexible["rod"].domain.design_cells)
    assert report.share == 1.0 and report.estimate == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "kernel",
    [ffr.ExponentialSpline(0.1), ffr.ThinPlate()],
    ids=lambda kernel: type(kernel).__name__,
)
def test_more_elements_less_error(comm: MPI.Comm, kernel: ffr.rbf.Kernel) -> None:
    """Selected values are exact, and the error falls as more of them are selected."""
    scene = smooth(comm)
    errors = []
    for share in (0.1, 0.2, 0.6):
        options = {"kernel": kernel, "degree": 1, "compare_every": 1}
        approximation, report = approximate(*scene, share=share, **options)
        assert report.errors is not None
        assert_exact(*scene, approximation, report.selected)
        assert report.elements == comm.allreduce(int(np.count_nonzero(report.selected)))
        errors.append(report.errors.l2)
        assert report.errors.cosine > 1.0 - report.errors.l2
        assert report.band_errors is None  # no boundary is known
    assert errors[2] < 0.5 * errors[1] < 0.5 * errors[0]


def test_estimate_follows_the_true_error(comm: MPI.Comm) -> None:
    """On a smooth gradient the estimate is right within a factor of three, at any share."""
    scene = smooth(comm)
    for share in (0.1, 0.2, 0.4, 0.6):
        report = approximate(*scene, share=share, compare_every=1)[1]
        assert report.errors is not None
        assert report.errors.l2 / 3.0 < report.estimate < 3.0 * report.errors.l2


@pytest.mark.mpi
def test_same_on_any_number_of_ranks(comm: MPI.Comm) -> None:
    """Selection, gradient and estimate are those of one rank."""
    values = []
    for ranks in (comm, MPI.COMM_SELF):
        scene = holed(ranks)
        gradient, report = approximate(*scene, share=0.3, kernel=ffr.ExponentialSpline(0.1))
        domain = scene[0].flexible["rod"].domain
        local = (domain.centroids, report.selected, gradient)
        values.append([*map(domain.everywhere, local), report.estimate])
    (centers, selected, gradient, estimate), alone = values
    assert_allclose(centers, alone[0])
    assert np.array_equal(selected, alone[1])
    assert_allclose(gradient, alone[2], rtol=1e-7, atol=1e-8 * np.abs(alone[2]).max())
    assert estimate == pytest.approx(alone[3], rel=1e-6)


def test_errors_of_a_gradient(comm: MPI.Comm) -> None:
    """Closed forms: scaled, turned and locally wrong gradients."""
    domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(10, 4))
    exact = np.cos(20.0 * domain.centroids[:, 0])
    all_cells = np.ones(domain.n_cells, dtype=bool)
    scaled = gradient_errors(domain, 1.1 * exact, exact, all_cells)
    assert scaled.l2 == pytest.approx(0.1) and scaled.cosine == pytest.approx(1.0)
    assert gradient_errors(domain, -exact, exact, all_cells).cosine == pytest.approx(-1.0)
    half = domain.centroids[:, 0] < 0.2
    wrong = np.where(half, exact, 0.0)
    assert gradient_errors(domain, wrong, exact, half).l2 == 0.0
    largest = comm.allreduce(np.abs(exact).max(initial=0.0), MPI.MAX)
    missed = comm.allreduce(np.abs(exact[~half]).max(initial=0.0), MPI.MAX)
    assert gradient_errors(domain, wrong, exact, all_cells).worst == pytest.approx(missed / largest)
    assert np.isnan(gradient_errors(domain, exact, 0.0 * exact, all_cells).l2)


def test_length_chosen_by_leaving_out(comm: MPI.Comm) -> None:
    """A class in place of a kernel: its length is reported, and no worse than one far off."""
    scene = smooth(comm)
    chosen, far = (
        approximate(*scene, share=0.2, kernel=kernel, compare_every=1)[1]
        for kernel in (ffr.ExponentialSpline, ffr.ExponentialSpline(0.001))
    )
    assert chosen.errors is not None and far.errors is not None
    assert chosen.length > 0.0
    assert chosen.errors.l2 < far.errors.l2
