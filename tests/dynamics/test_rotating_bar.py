# SPDX-License-Identifier: MIT
"""A bar that turns steadily: Code_Aster SSLV104 and SSLV105, published and closed-form values.

A bar of length L = 0.5 m, E = 2e11 Pa, nu = 0, rho = 7800 kg/m^3 turns with omega = 3000 rad/s
about its clamped end. Under the inertia of the undeformed bar (K u = load) its tip moves by

    rho omega^2 L^3 / (3 E) = 0.014625 m.

The inertia of the displacement itself, which the floating frame of reference carries along
((K - omega^2 M) u = load), makes this tan(a L) / a - L with a^2 = rho omega^2 / E.

References:
    Code_Aster, validation manual, tests SSLV104 and SSLV105 (code-aster.org).
"""

from __future__ import annotations

import math

from mpi4py import MPI

import numpy as np
import pytest

import dolfinx_ffr as ffr
from dolfinx_ffr.postprocessing import StressModes

# steady stretching is stable, bending at this speed is not, and is not excited
pytestmark = pytest.mark.filterwarnings("ignore::dolfinx_ffr.SofteningWarning")

LENGTH, HEIGHT, YOUNG, DENSITY, OMEGA = 0.5, 0.02, 2e11, 7800.0, 3000.0
WAVE = OMEGA * math.sqrt(DENSITY / YOUNG)
#: As published, under the load of the undeformed bar and with the inertia of its displacement
LOAD_ONLY, LINEAR = 0.014625, 0.0151572423864638


def bar(comm: MPI.Intracomm, cell: str = "quadrilateral", modes: int = 60) -> ffr.FlexibleBody:
    """The bar with rigid interfaces at both ends, in the frame of the clamped one.

    Slender, so that axial modes are among the first: each lowers the error of the tip.
    """
    domain = ffr.Domain.rectangle(
        comm, LENGTH, HEIGHT, elements=(20, 1), order=2, cell=cell, solid_columns=1
    )
    steel = ffr.PlaneStress(YOUNG, 0.0, DENSITY, 0.01)
    return ffr.FlexibleBody(domain, steel, frame=ffr.TangentFrame("left"), modes=modes)


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_tip_under_the_load_of_the_undeformed_bar(comm: MPI.Intracomm, cell: str) -> None:
    """Static solution of the reduced equations, K q = omega^2 int rho w_0 . phi."""
    body = bar(comm, cell)
    integrals = body.reduce(np.ones(body.domain.n_cells)).integrals
    q = np.linalg.solve(integrals.K, OMEGA**2 * integrals.G[0, 1:])
    tip = integrals.markers["right"].displacement @ q
    np.testing.assert_allclose(tip, [LOAD_ONLY, 0.0], rtol=1e-6, atol=1e-6 * LOAD_ONLY)


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_tip_in_steady_motion(comm: MPI.Intracomm, cell: str) -> None:
    """Started in the steady state, the simulated bar stays there, with the stress of the bar."""
    body = bar(comm, cell)
    reduced = body.reduce(np.ones(body.domain.n_cells))
    integrals = reduced.integrals
    q = np.linalg.solve(integrals.K - OMEGA**2 * integrals.G[1:, 1:], OMEGA**2 * integrals.G[0, 1:])
    shaft = ffr.Moving.circle((0.0, 0.0), 0.0, ffr.Motion.polynomial([0.0, OMEGA]), name="shaft")
    mechanism = ffr.Mechanism(
        placements={"bar": ffr.Placement()},
        joints=[ffr.Weld(("bar", "left"), shaft, name="clamp")],
        start=ffr.Assembled(elastic={"bar": q}),
    )
    revolution = 2.0 * math.pi / OMEGA
    trajectory = ffr.simulate(
        mechanism, {"bar": integrals}, ffr.GeneralizedAlpha(revolution / 4.0, 50)
    )
    path = trajectory.marker_path("bar", "right")
    elongation = np.linalg.norm(path, axis=1) - LENGTH
    np.testing.assert_allclose(elongation, LINEAR, rtol=1e-6)
    np.testing.assert_allclose(path[-1] / (LENGTH + LINEAR), [0.0, 1.0], atol=1e-6)
    # the clamp pulls with the whole centrifugal force, sigma A = E A u'(0)
    force = trajectory.joint_force("clamp")
    pull = YOUNG * HEIGHT * 0.01 * (1.0 / math.cos(WAVE * LENGTH) - 1.0)
    np.testing.assert_allclose(np.hypot(force[:, 0], force[:, 1]), pull, rtol=1e-5)
    modes = StressModes.of(body, reduced)
    stress = modes.von_mises(modes.coordinates(trajectory, "bar")[-1])
    x = modes.points[..., 0]
    # (x + u)'' + a^2 (x + u) = 0, clamped and free ends
    exact = YOUNG * (np.cos(WAVE * x) / math.cos(WAVE * LENGTH) - 1.0)
    assert np.max(np.abs(stress - exact), initial=0.0) < 1e-3 * YOUNG * WAVE**2 * LENGTH**2
