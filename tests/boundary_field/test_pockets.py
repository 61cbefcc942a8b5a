# SPDX-License-Identifier: MIT
"""Pockets, whose edges are the zero of a field and whose floors are a web."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from slider_crank import reference_problem

import dolfinx_ffr as ffr
from dolfinx_ffr.boundary_field import PlaneBoundary
from dolfinx_ffr.fem import PLATE
from dolfinx_ffr.optimization.field_trial import FieldProblem

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

MEMBER, WEB = 4e-3, 0.2


def pocketed() -> tuple[FieldProblem, PlaneBoundary]:
    """The rod of the slider-crank with two pockets, in one of which there is an island."""
    problem = reference_problem(MPI.COMM_WORLD, (40, 4), steps=60, modes=3)
    body = problem.flexible["rod"]
    plates = problem.with_bodies({"rod": body.with_interpolation(PLATE)})

    def level(x: np.ndarray) -> np.ndarray:
        long = np.maximum(np.abs(x[:, 0] - 0.12) - 0.06, np.abs(x[:, 1]) - 0.014)
        long = np.maximum(long, 0.006 - np.hypot(x[:, 0] - 0.12, x[:, 1]))
        return np.minimum(long, np.hypot(x[:, 0] - 0.26, x[:, 1]) - 0.013)

    part = ffr.Part(body.domain, level, 0.01, material=body.material, web=WEB)
    boundary = PlaneBoundary.of(part, MEMBER)
    return FieldProblem(plates, {"rod": 0.9}, {}, boundary.options, size=4e-3), boundary


@pytest.mark.mpi
def test_derivatives_by_the_edges_of_pockets_are_exact_on_all_ranks() -> None:
    problem, boundary = pocketed()
    gradients = problem.gradients(problem.trial({"rod": boundary}))
    smooth = boundary.smooth_motion(gradients.psi)
    motion = np.zeros(boundary.n_motions)
    motion[smooth.free] = -smooth.solve(gradients.psi[smooth.free])
    motion *= 2e-4 / np.max(np.abs(motion))
    trials = [
        problem.trial({"rod": boundary.with_variables(boundary.variables + side * motion)})
        for side in (1.0, -1.0)
    ]
    # new meshes alone change psi by some 1e-5
    psi = [np.log(trial.evaluation.psi) for trial in trials]
    assert 0.5 * (psi[0] - psi[1]) == pytest.approx(float(gradients.psi @ motion), rel=2e-2)
    filled = [trial.violations["volume of rod"] for trial in trials]
    slope = float((gradients.slopes[-1] @ motion)[0])
    assert 0.5 * (filled[0] - filled[1]) == pytest.approx(slope, rel=5e-3)


def test_islands_and_the_outline_stay() -> None:
    _, boundary = pocketed()
    part = boundary.part
    assert (part.pieces, part.holes, len(part.pockets)) == (2, 0, 2)
    # pockets that reach the outline are none
    opened = boundary.with_variables(boundary.variables - 0.008)
    with pytest.raises(ffr.fem.ShapeError, match="open at the outline"):
        _ = opened.part.pockets
