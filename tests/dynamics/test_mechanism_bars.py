# SPDX-License-Identifier: MIT
"""Derivatives by the numbers of a mechanism, against differences of whole simulations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Integrator, TrajectoryBar, adjoint, parameter_slopes
from dolfinx_ffr.mechanism import ParametricMechanism

END = ("arm", "end")


def bodies(mass: float = 1.3) -> dict[str, ffr.VolumeIntegrals]:
    markers = {"pin": (-0.3, 0.0), "end": (0.2, 0.0)}
    return {"arm": ffr.VolumeIntegrals.rigid(mass, (0.02, 0.01), 0.05, markers)}


def machine(
    stiffness: float,
    damping: float,
    rest: float,
    tip: float,
    fall: float,
    push: float,
    height: float,
    anchor: float,
    speed: float,
    mass: float,
) -> Any:
    """A pendulum with a spring, whose pin and anchor share a point at the start values."""
    return ffr.Mechanism(
        {"arm": ffr.Placement((0.3, 0.0), angular_velocity=speed, velocity=(0.0, 0.3 * speed))},
        [ffr.Revolute(("arm", "pin"), ffr.Ground((0.0, height)))],
        point_masses=[ffr.PointMass(END, tip)],
        gravity=(0.0, -fall),
        forces=[
            ffr.SpringDamper(END, ffr.Ground((anchor, 0.0)), stiffness, length=rest),
            ffr.SpringDamper(END, ffr.Ground((0.1, -0.4)), 0.0, damping, length=0.3),
            ffr.Force(END, x=lambda t: push * np.sin(9.0 * t), follower=True),
        ],
    ), bodies(mass)


BOUNDS = {
    "stiffness": (40.0, 10.0, 90.0),
    "damping": (0.4, 0.0, 2.0),
    "rest": (0.25, 0.1, 0.4),
    "tip": (0.2, 0.1, 0.5),
    "fall": (9.81, 5.0, 15.0),
    "push": (1.0, -2.0, 2.0),
    "height": (0.0, -0.1, 0.1),
    "anchor": (0.0, -0.1, 0.1),
    "speed": (0.5, -1.0, 1.0),
    "mass": (1.3, 1.0, 2.0),
}
METHODS: list[Integrator] = [ffr.GeneralizedAlpha(0.3, 60), ffr.RadauIIA(0.3, steps=25)]


@pytest.mark.parametrize("integrator", METHODS, ids=["alpha", "radau"])
def test_slopes_are_those_of_differences(integrator: Integrator) -> None:
    mechanism = ParametricMechanism.built(machine, BOUNDS)
    run = ffr.simulate(mechanism, bodies(), integrator)
    bar, rng = TrajectoryBar.zeros(run), np.random.default_rng(0)
    parts = ("y", "v", "w", "multipliers")
    for part in parts:
        values = getattr(run, part)
        getattr(bar, part)[:] = rng.uniform(-1.0, 1.0, values.shape) / np.max(np.abs(values))
    found = adjoint(run, bar).mechanism

    def built(shift: np.ndarray) -> Any:
        other = mechanism.shifted(shift)
        return other, {**bodies(), **other.own_bodies}

    start = run.y[0], run.v[0]
    slopes = parameter_slopes(run.model, start, built, mechanism.ranges, [(found, {})])[0]

    def number(shift: np.ndarray) -> float:
        t = ffr.simulate(mechanism.shifted(shift), bodies(), integrator)
        return float(sum(np.sum(getattr(bar, p) * getattr(t, p)) for p in parts))

    for k, (name, below, above) in enumerate(mechanism.ranges):
        errors = []
        for share in (1e-3, 3e-4, 1e-4):
            h = share * (below + above) * np.eye(len(slopes))[k]
            # of fourth order
            near, far = (number(h * s) - number(-h * s) for s in (1.0, 2.0))
            expected = (8.0 * near - far) / (12.0 * h[k])
            errors.append(abs(slopes[k] - expected) / abs(expected))
        assert min(errors) < 1e-7, (name, errors)
