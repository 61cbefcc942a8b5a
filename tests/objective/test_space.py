# SPDX-License-Identifier: MIT
"""Objectives of bodies in space, and the von Mises stress of six components."""

from __future__ import annotations

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shared.spatial_bodies import cloud

import dolfinx_ffr as ffr
from dolfinx_ffr import Frequency, VolumeIntegrals
from dolfinx_ffr.objective import von_mises_root
from dolfinx_ffr.verification import assert_taylor_order, taylor_test


@pytest.mark.parametrize("free", [False, True])
def test_derivative_of_a_frequency(free: bool) -> None:
    """Of a body in its frame and of a free one, by mass, S, P and K."""
    body, objective = cloud(4), Frequency("rod", number=2, free=free)
    rng = np.random.default_rng(5)
    assert body.P is not None
    P = rng.standard_normal(body.P.shape)
    K = rng.standard_normal(body.K.shape)
    direction = VolumeIntegrals.in_space(
        rng.standard_normal(),
        rng.standard_normal(body.S.shape),
        P + P.transpose(1, 0, 3, 2),
        100.0 * (K + K.T),
        {name: marker.scaled(0.0) for name, marker in body.markers.items()},
    )
    _, bars = objective.pullback(None, {"rod": body})
    result = taylor_test(
        lambda step: objective.value(None, {"rod": body + direction.scaled(float(step))}),
        lambda step: float(step) * bars["rod"].dot(direction),
        0.0,
        1.0,
        steps=[1e-4 / 2.0**k for k in range(5)],
    )
    assert_taylor_order(result)


def test_singular_stiffness_is_refused() -> None:
    """A body without stiffness along one shape has one zero frequency more, which is refused."""
    body = cloud(3)
    singular = replace(body, K=np.diag([1.0, 1.0, 0.0]))
    with pytest.raises(ValueError, match="frequency 1 of body 'rod' is zero"):
        Frequency("rod", free=True).value(None, {"rod": singular})


def test_von_mises_stress_in_space() -> None:
    """The length of six numbers; in the plane it is that of three."""
    rng = np.random.default_rng(0)
    stress = rng.standard_normal(6)
    sx, sy, sz, txy, tyz, txz = stress
    exact = sx**2 + sy**2 + sz**2 - sx * sy - sy * sz - sz * sx + 3 * (txy**2 + tyz**2 + txz**2)
    assert np.sum((von_mises_root(0.0, 6) @ stress) ** 2) == pytest.approx(exact, rel=1e-13)
    flat = np.array([sx, sy, 0.3 * (sx + sy), txy, 0.0, 0.0])
    plane = von_mises_root(0.3) @ [sx, sy, txy]
    assert_allclose(np.linalg.norm(von_mises_root(0.0, 6) @ flat), np.linalg.norm(plane))


def arm(comm: MPI.Intracomm, modes: int) -> ffr.Problem:
    """A short arm that is started askew about its end, and held there."""
    box = ffr.Domain.box(comm, 0.3, 0.06, 0.04, elements=(5, 2, 1), solid_layers=0)
    soft = ffr.Isotropic(young=2e8, poisson=0.3, density=1200.0)
    still = ffr.Motion.constant(0.0)
    turn = ffr.Motion.smooth_step(2.0, 0.1)
    shaft = ffr.Moving(still, still, turn, z=still, axis=(0.2, 0.5, 1.0))
    mechanism = ffr.Mechanism(
        {"arm": ffr.Placement((0.0, 0.0, 0.0))},
        [ffr.Weld(("arm", "left"), shaft)],
        gravity=(0.0, 0.0, -9.81),
    )
    body = ffr.FlexibleBody(box, soft, frame=ffr.TangentFrame("left"), modes=modes)
    return ffr.Problem(
        {"arm": body}, mechanism, ffr.GeneralizedAlpha(0.1, 60), ffr.PeakStress("arm", 4.0)
    )


@pytest.mark.mpi
def test_stress_follows_the_modes_left_out(comm: MPI.Intracomm) -> None:
    """With two modes the corrected stress is near that of many, and its gradient is exact."""
    problem, many = arm(comm, 2), arm(comm, 30)
    domain = problem.flexible["arm"].domain
    x = 0.7 + 0.3 * np.sin(40.0 * domain.centroids @ [1.0, 2.0, 3.0])
    exact = ffr.worst_stress(many.flexible["arm"], many.value(x), "arm")
    evaluation = problem.gradient(x)
    plain, corrected = (
        ffr.worst_stress(problem.flexible["arm"], evaluation, "arm", correction=correction)
        for correction in (False, True)
    )
    errors = [
        comm.allreduce(np.max(np.abs(found.stress - exact.stress), initial=0.0), MPI.MAX)
        / exact.largest
        for found in (plain, corrected)
    ]
    assert errors[1] < 2e-3 and errors[1] < 0.05 * errors[0]
    assert evaluation.gradient is not None
    direction = np.cos(30.0 * domain.centroids @ [1.0, -2.0, 0.5])
    above, below = (problem.value(x + step * direction).psi for step in (1e-5, -1e-5))
    slope = comm.allreduce(evaluation.gradient["arm"] @ direction)
    assert slope == pytest.approx((above - below) / 2e-5, rel=1e-6)
