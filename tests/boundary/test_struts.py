# SPDX-License-Identifier: MIT
"""Struts that are missing: what they would change, where they are inserted, what that brings."""

from __future__ import annotations

from functools import partial

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial import cKDTree
from slider_crank import reference_problem

import dolfinx_ffr as ffr
from dolfinx_ffr.boundary import Boundary, slides
from dolfinx_ffr.optimization import move_boundary

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

MEMBER = 2e-3


@pytest.mark.mpi
def test_what_a_strut_would_change_is_what_it_changes() -> None:
    """A row of elements across a void, along which the rod bends, soft and so without force."""
    problem = reference_problem(MPI.COMM_WORLD, (200, 20), steps=150, modes=6)
    law = ffr.SIMP(1.0, floor=1e-9, mass=ffr.LinearMass())
    rod = problem.flexible["rod"].with_interpolation(law)
    problem = problem.with_bodies({"rod": rod})
    x, y = rod.domain.centroids.T[:2]
    hole = np.maximum(np.abs(x - 0.2), np.abs(y)) < 0.012
    strip = hole & (np.abs(y - 0.009) < 5e-4)
    computed = problem.gradient(np.where(hole, 0.0, 1.0))
    assert computed.integrals_gradient is not None
    struts = rod.struts(computed.bodies["rod"], computed.integrals_gradient["rod"])
    # both edges of the row are bars of half its width
    ends = np.array([[0.188, 0.008], [0.212, 0.008], [0.188, 0.01], [0.212, 0.01]])
    changes = struts.changes(ends, np.array([[0, 1], [2, 3]]), 1e-3 * 2e-3)
    there = problem.value(np.where(strip, 1e-3, np.where(hole, 0.0, 1.0)))
    assert np.mean(changes) == pytest.approx(there.psi - computed.psi, rel=5e-3)
    assert np.mean(changes) < -1e-5 * computed.psi
    # what all elements carry is what psi, in which the load does not depend on them, depends on
    assert rod.domain.sum(struts.carried) > computed.psi


@pytest.mark.slow
def test_what_a_hole_would_change_is_what_it_changes() -> None:
    """On meshes that fit it, but for the square of its radius; and whatever the body's law."""
    rod = ffr.Domain.rectangle(MPI.COMM_SELF, 0.4, 0.04, elements=(400, 40))
    problem, computed = reference_problem(MPI.COMM_SELF, domain=rod, steps=100, modes=6), []
    for law in (ffr.RAMP(), ffr.SIMP(3.0)):
        body = problem.flexible["rod"].with_interpolation(law)
        there = problem.with_bodies({"rod": body}).gradient(np.ones(rod.n_cells))
        assert there.integrals_gradient is not None and there.gradient is not None
        computed.append(body.struts(there.bodies["rod"], there.integrals_gradient["rod"]).removed)
    exact, values, reported = -there.gradient["rod"], [], []
    # but for the stiffness of void, 1e-6 of that of the solid
    np.testing.assert_allclose(computed, [exact] * 2, rtol=0.0, atol=1e-5 * np.abs(exact).max())
    for r in (-1.0, 1e-3, 2e-3):  # none, and two
        away = partial(lambda r, x: np.hypot(x[:, 0] - 0.2, x[:, 1] - 0.012) - r, r)
        mesh = ffr.Part(rod, away).domain(4e-3, 2)
        fit = problem.with_bodies({"rod": problem.flexible["rod"].with_domain(mesh)})
        values.append(fit.value(np.ones(mesh.n_cells)).psi)
        near = away(rod.centroids) < 0.0
        reported.append(
            np.pi * r**2 * np.sum((exact / rod.cell_volumes)[near]) / max(np.sum(near), 1)
        )
    small, large = (np.array(values[1:]) - values[0]) / reported[1:] - 1.0
    assert abs(small) < 0.03 and 3.0 < large / small < 6.0


def test_a_void_that_needs_struts_gets_them() -> None:
    """A long hole, mirrored in two lines: sizes hold, and all stays its own mirror image."""
    problem = reference_problem(MPI.COMM_SELF, (40, 4), steps=150, modes=6)
    body = problem.flexible["rod"].domain

    def hollow(x: np.ndarray) -> np.ndarray:
        sides = ((x[:, 0] - 0.2) / 0.14) ** 8 + (x[:, 1] / 0.013) ** 8
        return 0.013 * (sides ** (1 / 8) - 1.0)

    lines = (ffr.Mirror((0.2, 0.0), (1.0, 0.0)), ffr.Mirror((0.2, 0.0), (0.0, 1.0)))
    start = Boundary.of(ffr.Part(body, hollow, 0.01), MEMBER, mirrors=lines)
    assert len(start.holes) == 1
    result = move_boundary(problem, start, volume=0.6, iterations=3, progress=False)
    psi, inserted = result.history["psi"], result.history["inserted"]
    assert inserted[1] > 0 and np.sum(inserted) == inserted[1]
    assert len(result.boundary.holes) > 3 and psi[1] < 0.8 * psi[0] and result.psi < psi[1]
    # crossings slide along the rod, and across it where they have an image
    motions = slides(end := result.boundary)
    assert len(motions) and np.max(np.abs(motions), axis=(1, 2)) == pytest.approx(1.0)
    for motion in (0.0 * motions[0], *motions):
        control = np.vstack([c.control for c in end.slid(MEMBER * motion).free.values()])
        for line in lines:
            assert np.max(cKDTree(control).query(line.reflection(control))[0]) < 1e-12
