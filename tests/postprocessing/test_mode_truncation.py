# SPDX-License-Identifier: MIT
"""How many modes a design needs that has become a truss, and which of them are wasted."""

from __future__ import annotations

import warnings

from mpi4py import MPI

import numpy as np
import pytest
from slider_crank import reference_problem

import dolfinx_ffr as ffr

ELEMENTS = (48, 12)
BAY = 8  # columns of cells between two nodes of the truss


def truss(domain: ffr.Domain, patch: float = 0.0) -> np.ndarray:
    """Two flanges with struts between them; a patch in the third bay has no contact to either."""
    x, y = domain.centroids.T
    columns, rows = ELEMENTS
    i = np.floor(x / 0.4 * columns).astype(int)
    j = np.floor((y / 0.04 + 0.5) * rows).astype(int)
    up = (i % BAY) * rows / BAY
    strut = np.abs(j - np.where((i // BAY) % 2 == 0, up, rows - 1 - up)) <= 1.6
    solid = (j == 0) | (j == rows - 1) | strut | ~domain.design_cells
    inside = (i >= 2 * BAY) & (i < 2 * BAY + 2) & (j >= 7) & (j < 10)
    return np.where(solid, 1.0, np.where(inside, patch, 0.0))


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore::dolfinx_ffr.LocalModesWarning")
@pytest.mark.parametrize("patch", [0.0, 1.0, 0.15])
def test_error_of_eight_modes_of_a_truss(comm: MPI.Intracomm, patch: float) -> None:
    """The estimate is near the error, the proposed number holds, and a loose patch is named."""
    problem = reference_problem(comm, ELEMENTS, steps=400)
    domain = problem.flexible["rod"].domain
    x = truss(domain, patch)
    evaluation = problem.value(x)
    finer = problem.with_modes({"rod": 24})
    many = finer.value(x)
    error = abs(evaluation.psi / many.psi - 1.0)
    assert error > 0.01
    assert ffr.mode_error(problem, evaluation)["rod"] == pytest.approx(error, rel=0.1)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ffr.LocalModesWarning)
        proposed = ffr.propose_modes(problem, evaluation)
    assert 8 < proposed["rod"] < 16
    better = problem.with_modes(proposed)
    enough = better.value(x)
    assert abs(enough.psi / many.psi - 1.0) < 2e-3
    # whoever has more than enough is proposed fewer
    assert ffr.propose_modes(better, enough)["rod"] <= proposed["rod"]
    local = ffr.local_modes(problem, evaluation)["rod"]
    if not patch:
        assert len(local.numbers) == 0 and not caught
        return
    assert local.numbers[0] == 1
    assert local.places[0] == pytest.approx([0.4 * 17 / 48, 0.04 * (8.5 / 12 - 0.5)], abs=1e-3)
    # what swings there adds to psi what the truss alone does not have, besides what the constraint
    # modes strain there
    share = ffr.local_modes(finer, many)["rod"].share
    assert share == pytest.approx(1.0 - finer.value(truss(domain)).psi / many.psi, rel=0.2)
    (warning,) = caught
    assert warning.category is ffr.LocalModesWarning and warning.filename == __file__
    assert f"{len(local.numbers)} of 8 normal modes of body 'rod'" in str(warning.message)


def test_modes_of_an_even_thin_body_are_not_local(comm: MPI.Intracomm) -> None:
    """What is thin everywhere is the body itself."""
    problem = reference_problem(comm, (24, 4), modes=4, steps=100)
    domain = problem.flexible["rod"].domain
    evaluation = problem.value(np.where(domain.design_cells, 0.2, 1.0))
    assert len(ffr.local_modes(problem, evaluation)["rod"].numbers) == 0
    # a tolerance that anything holds; no number is one if there are constraint modes
    assert ffr.propose_modes(problem, evaluation, tolerance=10.0) == {"rod": 0}


@pytest.mark.mpi
def test_local_modes_in_space(comm: MPI.Intracomm) -> None:
    """A block that floats above a beam swings first, and is found where it is."""
    domain = ffr.Domain.box(comm, 0.3, 0.06, 0.06, elements=(12, 6, 6), solid_layers=1)
    x, y, z = domain.centroids.T
    block = (np.abs(x - 0.15) < 0.02) & (y > 0.01) & (np.abs(z) < 0.011)
    density = np.where(block | (y < -0.02) | domain.solid_cells, 1.0, 1e-3)
    material, frame = ffr.Isotropic(3e9, 0.35, 1200.0), ffr.TangentFrame("left")
    beam = ffr.FlexibleBody(domain, material, frame=frame, modes=3)
    mechanism = ffr.Mechanism(
        {"beam": ffr.Placement((0.0, 0.0, 0.0))},
        [ffr.Weld(("beam", "left"), ffr.Ground((0.0, 0.0, 0.0)))],
        gravity=(0.0, 0.0, -9.81),
    )
    steps, objective = ffr.GeneralizedAlpha(0.02, 20), ffr.IntegralCompliance()
    problem = ffr.Problem({"beam": beam}, mechanism, steps, objective)
    local = ffr.local_modes(problem, problem.value(density))["beam"]
    assert local.numbers[0] == 1
    assert local.places.shape == (len(local.numbers), 3)
    assert local.places[0] == pytest.approx([0.15, 0.02, 0.0], abs=2e-3)


def test_without_a_motion_there_is_no_error(comm: MPI.Intracomm) -> None:
    problem = reference_problem(comm, (24, 4), modes=2, steps=100)
    problem = ffr.Problem(problem.bodies, problem.mechanism, problem.integrator, ffr.Mass("rod"))
    evaluation = problem.value(np.ones(problem.flexible["rod"].domain.n_cells))
    for call in (ffr.mode_error, ffr.propose_modes, ffr.local_modes):
        with pytest.raises(ValueError, match="nothing was simulated"):
            call(problem, evaluation)


def test_modes_for_an_accuracy(comm: MPI.Intracomm) -> None:
    """The chosen number keeps the accuracy; one chosen for less accuracy is smaller."""
    problem = reference_problem(comm, (60, 6), modes=14, steps=400)
    x = np.ones(problem.flexible["rod"].domain.n_cells)
    psi = problem.with_modes({"rod": 60}).value(x).psi
    rough, fine = (ffr.select_modes(problem, tolerance=t) for t in (1e-2, 1e-4))
    assert 0 < rough.modes["rod"] < fine.modes["rod"] < 13
    for selection, tolerance in ((rough, 1e-2), (fine, 1e-4)):
        smaller = problem.with_modes(selection.modes)
        assert smaller.flexible["rod"].reduction.modes == selection.modes["rod"]
        error = abs(smaller.value(x).psi / psi - 1.0)
        assert error <= tolerance
        assert error == pytest.approx(selection.error, rel=0.1)
        # one mode less would not do
        assert selection.errors["rod"][selection.modes["rod"] - 1] > tolerance
    with pytest.raises(ValueError, match="give the problem more modes"):
        ffr.select_modes(problem.with_modes({"rod": 3}), tolerance=1e-6)
    with pytest.raises(ValueError, match="no flexible body 'crank'"):
        problem.with_modes({"crank": 3})
