# SPDX-License-Identifier: MIT
"""Two flexible bodies on two meshes: one adjoint pass gives the gradients of both."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import four_bar

import dolfinx_ffr as ffr
from dolfinx_ffr.problem import spread


def designs(problem: ffr.Problem) -> dict[str, np.ndarray]:
    """Densities as functions of position alone."""
    centroids = {name: body.domain.centroids for name, body in problem.flexible.items()}
    return {name: 0.7 + 0.2 * np.sin(60 * c[:, 0] + 90 * c[:, 1]) for name, c in centroids.items()}


WAY = (lambda t: 0.2 + t, 0.3)
#: One of every kind; the first four need no motion.
CONSTRAINTS = [
    ffr.Constraint(ffr.Volume("coupler"), upper=0.5),
    ffr.Constraint(ffr.Mass("rocker"), upper=0.05),
    ffr.Constraint(ffr.Frequency("coupler"), lower=30.0, name="bending"),
    ffr.Constraint(ffr.Frequency("rocker", cluster=2, free=True), lower=30.0, name="free"),
    ffr.Constraint(ffr.PeakCompliance(power=6.0), upper=1e-3),
    ffr.Constraint(ffr.JointForce("coupler pin", power=6.0), upper=5.0),
    ffr.Constraint(ffr.MarkerAcceleration("rocker", "left"), upper=100.0),
    ffr.Constraint(ffr.PathTracking("coupler", "right", WAY, (0.2, 0.25)), upper=1e-3),
]


@pytest.mark.mpi
def test_all_gradients_of_one_simulation(comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of psi and of every constraint, with respect to the densities of each body."""
    calls = {"integrate": 0, "adjoint": 0}
    originals = {name: getattr(spread, name) for name in calls}
    for name in calls:

        def counted(*args, name=name):  # type: ignore[no-untyped-def]
            calls[name] += 1
            return originals[name](*args)

        monkeypatch.setattr(spread, name, counted)
    weights = {"coupler": 1.0, "rocker": 3.0}
    psi = ffr.IntegralCompliance(["coupler", "rocker"], weights)
    problem = four_bar(comm, psi, constraints=CONSTRAINTS)
    x = designs(problem)
    result = problem.gradient(x)
    assert calls == {"integrate": 1, "adjoint": 5}
    assert list(result.constraints) == [constraint.label for constraint in CONSTRAINTS]
    gradients = [result.gradient, *(bound.gradient for bound in result.constraints.values())]
    at_x = np.array([result.psi, *(bound.violation for bound in result.constraints.values())])
    for name, body in problem.flexible.items():
        c = body.domain.centroids
        direction = np.cos(50 * c[:, 0] + 70 * c[:, 1])

        def values(step: float, name: str = name, direction: np.ndarray = direction) -> np.ndarray:
            computed = problem.value({**x, name: x[name] + step * direction})
            return np.array([computed.psi, *(g.violation for g in computed.constraints.values())])

        # sixth order: in shorter steps round-off of accelerations is a millionth of their slope
        changes = [values(step) - values(-step) for step in (1e-3, 2e-3, 3e-3)]
        expected = np.dot([0.75, -0.15, 1.0 / 60.0], changes) / 1e-3
        # what the last places of the values, four units of each, make of this difference
        roundoff = 2.0 * 4.0 * np.finfo(float).eps * np.abs(at_x) / 1e-3
        slopes = []
        for gradient in gradients:
            assert gradient is not None and list(gradient) == ["coupler", "rocker"]
            slopes.append(body.domain.sum(gradient[name] * direction))
        assert np.all(np.abs(slopes - expected) <= 1e-6 * np.abs(expected) + roundoff)
    volume = result.constraints["Volume"]
    assert volume.value == result.volume["coupler"]
    assert volume.violation == pytest.approx(volume.value / 0.5 - 1.0, rel=1e-14)
    assert volume.gradient is not None
    assert not volume.gradient["rocker"].any()
