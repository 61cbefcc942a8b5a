# SPDX-License-Identifier: MIT
"""The approximate gradient, the errors it shows, and the design loop with each gradient."""

from __future__ import annotations

from collections.abc import Callable

from mpi4py import MPI

import numpy as np
import pytest
from numpy.testing import assert_allclose
from slider_crank import reference_problem

import dolfinx_ffr as ffr
from dolfinx_ffr.gradients.method import gradient_errors

Distance = Callable[[str], np.ndarray | None]


def holed(comm: MPI.Comm) -> tuple[ffr.Problem, np.ndarray, Distance]:
    """A coarse rod with holes, and the distance from their edges."""
    problem = reference_problem(comm, (30, 6), modes=4, steps=100)
    levelset = ffr.LevelSet(problem.flexible["rod"].domain)
    alpha = levelset.with_holes(5, 1, 0.012)
    distance = levelset.distance(alpha)
    return problem, levelset.density(alpha), lambda name: distance


def smooth(comm: MPI.Comm) -> tuple[ffr.Problem, np.ndarray]:
    """A rod of even density, whose gradient is smooth inside."""
    problem = reference_problem(comm, (60, 12), modes=4, steps=200)
    domain = problem.flexible["rod"].domain
    return problem, np.where(domain.design_cells, 0.8, 1.0)


@pytest.mark.slow
@pytest.mark.mpi
def test_all_elements_selected_is_exact(comm: MPI.Intracomm) -> None:
    """Nothing is left to interpolate: the exact gradient, and errors of zero."""
    problem, x, distance = holed(comm)
    evaluation = problem.value(x)
    method = ffr.ApproximateGradient(ffr.GradientElements(share=1.0), ffr.ThinPlate())
    exact = problem.differentiate(evaluation).gradient
    found, reports = method(problem, evaluation, distance, 0)
    assert exact is not None and found.gradient is not None
    design = problem.flexible["rod"].domain.design_cells
    largest = comm.allreduce(np.abs(exact["rod"]).max(initial=0.0), MPI.MAX)
    assert_allclose(
        found.gradient["rod"][design], exact["rod"][design], rtol=1e-7, atol=1e-10 * largest
    )
    assert reports["rod"].share == 1.0 and reports["rod"].estimate == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "kernel",
    [
        pytest.param(ffr.ExponentialSpline(0.1), marks=pytest.mark.mpi),
        ffr.Gaussian(0.01),
        ffr.Multiquadric(0.01),
        ffr.ThinPlate(),
        ffr.Wendland(0.1),
    ],
    ids=lambda kernel: type(kernel).__name__,
)
def test_more_elements_less_error(comm: MPI.Intracomm, kernel: ffr.rbf.Kernel) -> None:
    """Selected values are exact, and the error falls as more of them are selected."""
    problem, x = smooth(comm)
    evaluation = problem.value(x)
    exact = problem.differentiate(evaluation).gradient
    assert exact is not None
    errors = []
    for share in (0.1, 0.2, 0.6):
        method = ffr.ApproximateGradient(
            ffr.GradientElements(share=share), kernel, degree=1, compare_every=1
        )
        found, reports = method(problem, evaluation, lambda name: None, 0)
        report = reports["rod"]
        assert found.gradient is not None and report.errors is not None
        chosen = report.selected
        largest = comm.allreduce(np.abs(exact["rod"]).max(initial=0.0), MPI.MAX)
        assert_allclose(
            found.gradient["rod"][chosen], exact["rod"][chosen], rtol=1e-7, atol=1e-10 * largest
        )
        assert report.elements == comm.allreduce(int(np.count_nonzero(chosen)))
        errors.append(report.errors.l2)
        assert report.errors.cosine > 1.0 - report.errors.l2
        assert report.band_errors is None  # no boundary is known
    assert errors[2] < 0.5 * errors[1] < 0.5 * errors[0]


def test_estimate_follows_the_true_error(comm: MPI.Intracomm) -> None:
    """On a smooth gradient the estimate is right within a factor of three, at any share."""
    problem, x = smooth(comm)
    evaluation = problem.value(x)
    for share in (0.1, 0.2, 0.4, 0.6):
        method = ffr.ApproximateGradient(
            ffr.GradientElements(share=share), ffr.ThinPlate(), compare_every=1
        )
        report = method(problem, evaluation, lambda name: None, 0)[1]["rod"]
        assert report.errors is not None
        assert report.errors.l2 / 3.0 < report.estimate < 3.0 * report.errors.l2


@pytest.mark.mpi
def test_refinement_until_the_tolerance(comm: MPI.Intracomm) -> None:
    """Elements are added where the estimate is worst, until it holds or the share is used up."""
    problem, x, distance = holed(comm)
    evaluation = problem.value(x)

    def report(tolerance: float | None, largest: float = 1.0) -> ffr.GradientReport:
        method = ffr.ApproximateGradient(
            ffr.GradientElements(share=0.15),
            ffr.ThinPlate(),
            tolerance=tolerance,
            largest_share=largest,
            compare_every=1,
        )
        return method(problem, evaluation, distance, 0)[1]["rod"]

    plain, refined, bounded = report(None), report(0.05), report(0.05, 0.3)
    assert plain.errors is not None and refined.errors is not None
    assert refined.estimate <= 0.05 < plain.estimate
    assert refined.errors.l2 < 0.5 * plain.errors.l2
    assert plain.elements < bounded.elements < refined.elements
    assert bounded.share <= 0.3


@pytest.mark.mpi
def test_same_on_any_number_of_ranks(comm: MPI.Intracomm) -> None:
    """Selection, gradient and estimate are those of one rank."""
    method = ffr.ApproximateGradient(
        ffr.GradientElements(share=0.3), ffr.ExponentialSpline(0.1), tolerance=0.3
    )
    problem, x, distance = holed(comm)
    domain = problem.flexible["rod"].domain
    found, reports = method(problem, problem.value(x), distance, 0)
    alone, x_alone, distance_alone = holed(MPI.COMM_SELF)
    serial, reports_alone = method(alone, alone.value(x_alone), distance_alone, 0)
    assert found.gradient is not None and serial.gradient is not None
    other = alone.flexible["rod"].domain
    assert_allclose(domain.everywhere(domain.centroids), other.everywhere(other.centroids))
    assert np.array_equal(
        domain.everywhere(reports["rod"].selected), other.everywhere(reports_alone["rod"].selected)
    )
    expected = other.everywhere(serial.gradient["rod"])
    assert_allclose(
        domain.everywhere(found.gradient["rod"]),
        expected,
        rtol=1e-7,
        atol=1e-8 * np.abs(expected).max(),
    )
    assert reports["rod"].estimate == pytest.approx(reports_alone["rod"].estimate, rel=1e-6)


@pytest.mark.mpi
def test_errors_of_a_gradient(comm: MPI.Intracomm) -> None:
    """Closed forms: scaled, turned and locally wrong gradients."""
    domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(10, 4))
    exact = np.cos(20.0 * domain.centroids[:, 0])
    every = np.ones(domain.n_cells, dtype=bool)
    scaled = gradient_errors(domain, 1.1 * exact, exact, every)
    assert scaled.l2 == pytest.approx(0.1) and scaled.cosine == pytest.approx(1.0)
    assert gradient_errors(domain, -exact, exact, every).cosine == pytest.approx(-1.0)
    half = domain.centroids[:, 0] < 0.2
    wrong = np.where(half, exact, 0.0)
    assert gradient_errors(domain, wrong, exact, half).l2 == 0.0
    largest = comm.allreduce(np.abs(exact).max(initial=0.0), MPI.MAX)
    missed = comm.allreduce(np.abs(exact[~half]).max(initial=0.0), MPI.MAX)
    assert gradient_errors(domain, wrong, exact, every).worst == pytest.approx(missed / largest)
    assert np.isnan(gradient_errors(domain, exact, 0.0 * exact, every).l2)


def test_length_chosen_by_leaving_out(comm: MPI.Intracomm) -> None:
    """A class in place of a kernel: its length is reported, and no worse than one far off."""
    problem, x = smooth(comm)
    evaluation = problem.value(x)
    elements = ffr.GradientElements(share=0.2)

    def error(kernel: object) -> tuple[float, float]:
        method = ffr.ApproximateGradient(elements, kernel, compare_every=1)  # type: ignore[arg-type]
        report = method(problem, evaluation, lambda name: None, 0)[1]["rod"]
        assert report.errors is not None
        return report.errors.l2, report.length

    chosen, length = error(ffr.ExponentialSpline)
    assert length > 0.0
    assert chosen < error(ffr.ExponentialSpline(0.001))[0]


@pytest.mark.slow
@pytest.mark.mpi
def test_design_loop_with_each_gradient(comm: MPI.Intracomm) -> None:
    """Exact adjoint and element by element walk the same way; the history tells of errors."""

    def run(method: ffr.GradientMethod | None) -> ffr.Result:
        problem = reference_problem(comm, (24, 6), modes=3, steps=100)
        levelset = ffr.LevelSet(problem.flexible["rod"].domain)
        return ffr.optimize(
            problem,
            levelset,
            levelset.with_holes(4, 1, 0.01),
            volume=0.7,
            gradient=method,
            optimizer=ffr.LevelSetEvolution(sharpness=(11.0,)),
            iterations=4,
            progress=False,
        )

    exact, element = run(None), run(ffr.ElementByElement())
    assert_allclose(element.history["psi"], exact.history["psi"], rtol=1e-6)
    assert list(element.history) == list(exact.history)
    assert "gradient_estimate" not in exact.history
    near = run(
        ffr.ApproximateGradient(ffr.GradientElements(share=0.4), ffr.ThinPlate(), compare_every=2)
    )
    history = near.history
    domain = exact.designs["rod"].domain
    designed = comm.allreduce(int(np.count_nonzero(domain.design_cells)))
    assert np.all(history["gradient_elements"] < 0.5 * designed)
    assert np.all(history["gradient_estimate"] > 0.0)
    kept = history["accepted"] > 0
    measured = np.isfinite(history["gradient_error"]) & np.isfinite(history["band_error"])
    assert np.all(measured[kept & (history["iteration"] % 2 == 0)])
    assert history["psi"][-1] < history["psi"][0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"tolerance": 0.0}, "tolerance must be positive, but it is 0.0"),
        ({"largest_share": 1.5}, "largest_share must lie between 0 and 1"),
        ({"compare_every": -1}, "compare_every must be a whole number"),
        ({"band": 0.0}, "band must be positive"),
    ],
)
def test_bad_numbers(arguments: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ffr.ApproximateGradient(**arguments)  # type: ignore[arg-type]
