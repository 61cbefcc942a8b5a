# SPDX-License-Identifier: MIT
"""What tests of motions share: orders in time, energies and momenta, a pendulum, starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Trajectory
from dolfinx_ffr.verification import convergence_order
from shared.scenes import Bodies, Scene

Array = NDArray[np.float64]


def check_order(
    error: Callable[[int], ArrayLike], steps: ArrayLike, *limits: float, order: float = 2.0
) -> None:
    """Demand that errors fall with an order from numbers of steps to others, below limits."""
    counts = np.asarray(steps)
    for column, limit in zip(np.transpose([error(int(n)) for n in counts]), limits, strict=True):
        assert column[-1] < limit
        assert convergence_order(1.0 / counts, column) == pytest.approx(order, abs=0.1)


def energy_and_momenta(t: Trajectory) -> tuple[Array, Array, Array]:
    """Kinetic and strain energy, linear and angular momentum of all bodies, at all instants."""
    bodies = list(t.model.bodies)
    energy = sum(t.strain_energy(b) + t.kinetic_energy(b) for b in bodies)
    linear = sum(t.linear_momentum(b) for b in bodies)
    return energy, linear, sum(t.angular_momentum(b) for b in bodies)


def pendulum() -> Scene:
    """A rigid bar that falls from the horizontal about its end."""
    bar = ffr.VolumeIntegrals.rigid(1.0, (0.0, 0.0), 1.0 / 12.0, {"pin": (-0.5, 0.0)})
    pin = ffr.Revolute(("rod", "pin"), ffr.Ground(), name="pin")
    mechanism = ffr.Mechanism({"rod": ffr.Placement((0.5, 0.0))}, [pin], gravity=(0.0, -9.81))
    return Scene(mechanism, {"rod": bar}, ffr.GeneralizedAlpha(2.0, 50))


def deformed(scene: Scene, size: float) -> Scene:
    """A scene whose flexible bodies are bent and swing at the start."""
    rng, values = np.random.default_rng(0), []
    for rate in (1.0, 30.0):
        part = {
            name: size * rate * rng.uniform(-1.0, 1.0, body.modes) / np.arange(1, body.modes + 1)
            for name, body in scene.bodies.items()
            if body.modes
        }
        values.append(part)
    return replace(scene, mechanism=replace(scene.mechanism, start=ffr.Assembled(*values)))


def yoke() -> tuple[ffr.Mechanism, Bodies]:
    """A slide of 2 kg that a turning pin in its slot moves back and forth by 0.1 m sin(15 t)."""
    turn = ffr.Motion.polynomial([-0.5 * np.pi, 15.0])
    pin = ffr.Moving.circle((0.0, 0.0), 0.1, turn)
    joints = [
        ffr.Translational(("yoke", "pin"), ffr.Ground(), name="rails"),
        ffr.PointOnLine(pin, ("yoke", "pin"), direction=(0.0, 1.0), name="slot"),
    ]
    body = ffr.VolumeIntegrals.rigid(2.0, (0.0, 0.0), 0.1, {"pin": (0.0, 0.0)})
    return ffr.Mechanism({"yoke": ffr.Placement()}, joints), {"yoke": body}
