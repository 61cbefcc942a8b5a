# SPDX-License-Identifier: MIT
"""Normal modes are added where psi needs them."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.optimization.enough_modes import with_enough_modes


def frame(domain: ffr.Domain) -> np.ndarray:
    """Two flanges and a few webs: a body that shears, of which its lowest modes tell little."""
    x, y = domain.centroids.T
    web = np.mod(x, 0.1) < 0.02
    return np.where((np.abs(y) > 0.012) | web | ~domain.design_cells, 1.0, 1e-3)


@pytest.mark.mpi
def test_modes_are_added_until_psi_stands(comm: MPI.Intracomm) -> None:
    problem = slider_crank(comm, (40, 8), modes=1, steps=200)
    x = {"rod": frame(problem.flexible["rod"].domain)}
    few = problem.value(x)
    more, result, errors = with_enough_modes(problem, x, few, 2e-3, {"rod": 1})
    assert more.flexible["rod"].modes > 1 and problem.flexible["rod"].modes == 1
    assert 0.0 <= errors["rod"] <= 2e-3
    exact = problem.with_modes({"rod": 24}).value(x).psi
    assert abs(result.psi / exact - 1.0) < 4e-3 < abs(few.psi / exact - 1.0)
    # and stay where they are enough
    same, again, _ = with_enough_modes(more, x, result, 2e-3, {"rod": 1})
    assert same is more and again is result


def test_modes_that_are_never_enough_are_said() -> None:
    problem = slider_crank(MPI.COMM_SELF, (20, 4), modes=1, steps=100)
    x = {"rod": frame(problem.flexible["rod"].domain)}
    with pytest.warns(ffr.DesignWarning, match="normal modes of 'rod' leave out"):
        more, _, errors = with_enough_modes(problem, x, problem.value(x), 1e-12, {"rod": 1})
    assert more.flexible["rod"].modes == 16 and errors["rod"] > 1e-12


@pytest.mark.filterwarnings("ignore:optimize. 29 normal modes of 'rod' leave out")
def test_a_coarse_mesh_has_no_more_modes() -> None:
    problem = slider_crank(MPI.COMM_SELF, (6, 2), modes=8, steps=100)
    x = {"rod": np.ones(12)}
    more, _, errors = with_enough_modes(problem, x, problem.value(x), 1e-16, {"rod": 8})
    assert more.flexible["rod"].modes == 29 and errors["rod"] < 1e-10


@pytest.mark.parametrize("kind", [ffr.SimulationError, RuntimeError])
def test_a_failure_loses_nothing(monkeypatch: pytest.MonkeyPatch, kind: type[RuntimeError]) -> None:
    """The estimate is missing, and that is said."""
    problem = slider_crank(MPI.COMM_SELF, (20, 4), modes=1, steps=100)
    x = {"rod": np.ones(80)}
    value = problem.value(x)

    def fails(*_: object) -> None:
        raise kind("failed", *([value.trajectory] if kind is ffr.SimulationError else []))

    monkeypatch.setattr("dolfinx_ffr.optimization.enough_modes.mode_error", fails)
    with pytest.warns(ffr.DesignWarning, match=r"cannot be estimated, as .* \(failed"):
        same, again, errors = with_enough_modes(problem, x, value, 2e-3, {"rod": 1})
    assert same is problem and again is value and np.isnan(errors["rod"])
