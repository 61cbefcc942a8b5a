# SPDX-License-Identifier: MIT
"""Two flexible bodies on two meshes: one adjoint pass gives the gradients of both."""

from __future__ import annotations

import math

from mpi4py import MPI

import numpy as np
import pytest

import dolfinx_ffr as ffr
from dolfinx_ffr.verification import assert_taylor_order, central_difference, taylor_test

CRANK, COUPLER, ROCKER, GROUND = 0.1, 0.4, 0.3, 0.4


def link(comm: MPI.Comm, length: float, elements: tuple[int, int], frame: object, **options):  # type: ignore[no-untyped-def]
    """A flexible link of a rubbery plastic on a small mesh of its own."""
    domain = ffr.Domain.rectangle(comm, length, 0.03, elements=elements)
    return ffr.FlexibleBody(
        domain, ffr.PlaneStress(3e9, 0.35, 1200.0, 0.01), frame=frame, modes=3, **options
    )


def four_bar(comm: MPI.Comm, objective: ffr.Objective, steps: int = 150, **options) -> ffr.Problem:  # type: ignore[no-untyped-def]
    """Rigid crank driven by a motor, flexible coupler and flexible rocker."""
    # Start with the crank upright; the coupler's end is where two circles meet.
    pin, pivot = np.array([0.0, CRANK]), np.array([GROUND, 0.0])
    gap = pivot - pin
    d = float(np.hypot(*gap))
    along = (COUPLER**2 - ROCKER**2 + d**2) / (2.0 * d)
    end = pin + along * gap / d
    end += math.sqrt(COUPLER**2 - along**2) * np.array([-gap[1], gap[0]]) / d
    drive = ffr.Motion(
        lambda t: 0.5 * np.pi + 12.0 * t + 0.5 * np.sin(9.0 * t),
        lambda t: 12.0 + 4.5 * np.cos(9.0 * t),
        lambda t: -40.5 * np.sin(9.0 * t),
        "motor",
    )
    mechanism = ffr.Mechanism(
        placements={
            "crank": ffr.Placement((0.0, 0.0), 0.5 * math.pi),
            "coupler": ffr.Placement(tuple(pin), math.atan2(*(end - pin)[::-1])),
            "rocker": ffr.Placement(tuple(end), math.atan2(*(pivot - end)[::-1])),
        },
        joints=[
            ffr.Revolute(("crank", "hub"), ffr.Ground(), name="motor bearing"),
            ffr.Revolute(("crank", "pin"), ("coupler", "left"), name="crank pin"),
            ffr.Revolute(("coupler", "right"), ("rocker", "left"), name="coupler pin"),
            ffr.Revolute(("rocker", "right"), ffr.Ground((GROUND, 0.0)), name="rocker bearing"),
            ffr.PrescribedAngle(("crank", "hub"), drive, name="motor"),
        ],
        gravity=(0.0, -9.81),
        damping={"coupler": ffr.RayleighDamping(1.0, 1e-5)},
    )
    bodies = {
        "crank": ffr.VolumeIntegrals.rigid(
            0.2, (0.05, 0.0), 3e-4, {"hub": (0.0, 0.0), "pin": (CRANK, 0.0)}
        ),
        "coupler": link(comm, COUPLER, (20, 4), ffr.ChordFrame("left", "right")),
        "rocker": link(comm, ROCKER, (15, 3), ffr.TangentFrame("right")),
    }
    return ffr.Problem(bodies, mechanism, ffr.GeneralizedAlpha(0.25, steps), objective, **options)


def designs(problem: ffr.Problem) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Densities, and directions in which to move them, as functions of position alone."""
    centroids = {name: body.domain.centroids for name, body in problem.flexible.items()}
    x = {name: 0.7 + 0.2 * np.sin(60 * c[:, 0] + 90 * c[:, 1]) for name, c in centroids.items()}
    return x, {name: np.cos(50 * c[:, 0] + 70 * c[:, 1]) for name, c in centroids.items()}


def slope(comm: MPI.Comm, gradient: dict[str, np.ndarray], direction: dict[str, np.ndarray]):  # type: ignore[no-untyped-def]
    """Derivative in a direction, summed over bodies and ranks; only bodies with a direction."""
    return comm.allreduce(sum(float(gradient[name] @ d) for name, d in direction.items()))


@pytest.mark.mpi
def test_gradients_of_both_bodies(comm: MPI.Intracomm) -> None:
    weights = {"coupler": 1.0, "rocker": 3.0}
    problem = four_bar(comm, ffr.IntegralCompliance(["coupler", "rocker"], weights))
    x, directions = designs(problem)
    evaluation = problem.gradient(x)
    assert evaluation.gradient is not None
    assert list(evaluation.gradient) == ["coupler", "rocker"]
    for moving in (["coupler"], ["rocker"], ["coupler", "rocker"]):
        direction = {name: directions[name] for name in moving}

        def value(step: np.ndarray, direction=direction) -> float:  # type: ignore[no-untyped-def]
            y = {name: x[name] + float(step) * d for name, d in direction.items()}
            return problem.value({**x, **y}).psi

        expected = slope(comm, evaluation.gradient, direction)
        assert expected == pytest.approx(central_difference(value, 0.0, 1.0, 2e-3), rel=1e-6)
        if len(moving) == 2:
            steps = [4e-3 / 2.0**k for k in range(4)]
            assert_taylor_order(
                taylor_test(value, lambda s, e=expected: float(s) * e, 0.0, 1.0, steps=steps)
            )


@pytest.mark.mpi
def test_weights_of_bodies_add_up(comm: MPI.Intracomm) -> None:
    """Psi and both gradients are linear in the weights."""
    results = {}
    for key, weights in (("coupler", (1, 0)), ("rocker", (0, 1)), ("both", (0.3, 2.0))):
        objective = ffr.IntegralCompliance(
            weights={"crank": 1.0, **dict(zip(("coupler", "rocker"), weights, strict=True))}
        )
        problem = four_bar(comm, objective)
        x, directions = designs(problem)
        result = problem.gradient(x)
        assert result.gradient is not None
        results[key] = np.array([result.psi, slope(comm, result.gradient, directions)])
    expected = 0.3 * results["coupler"] + 2.0 * results["rocker"]
    np.testing.assert_allclose(results["both"], expected, rtol=1e-9)
    # Each matters: the rocker bends under the coupler's inertia.
    assert min(results["coupler"][0], results["rocker"][0]) > 0.01 * results["both"][0]
