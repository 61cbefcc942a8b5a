# SPDX-License-Identifier: MIT
"""Machines whose motion is prescribed: a tolerance controls their forces, and the error is told."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.motions import yoke

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Trajectory
from dolfinx_ffr.objective import DriveWork

Array = NDArray[np.float64]
Machine = tuple[ffr.Mechanism, dict[str, ffr.VolumeIntegrals]]

MASS, RADIUS, SPEED, END_TIME = 2.0, 0.1, 15.0, 2.0
BODY = ffr.VolumeIntegrals.rigid(MASS, (0.0, 0.0), 0.1, {"pin": (0.0, 0.0)})


def held(load: Callable[[Array], Array]) -> Machine:
    """A body that is welded to the ground, under a load along x."""
    weld = ffr.Weld(("body", "pin"), ffr.Ground(), name="weld")
    force = ffr.Force(("body", "pin"), load)
    return ffr.Mechanism({"body": ffr.Placement()}, [weld], forces=[force]), {"body": BODY}


PEAK = MASS * RADIUS * SPEED**2


def off(motion: Trajectory) -> float:
    """The error of the force in the slot, in parts of its peak."""
    force = np.abs(motion.joint_force("slot")[:, 0])
    return float(np.max(np.abs(force - PEAK * np.abs(np.sin(SPEED * motion.t))))) / PEAK


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 1e-9])
def test_the_force_that_moves_a_yoke(tolerance: float) -> None:
    """Its positions are exact with any steps; its force and its peak are as near as is told."""
    mechanism, bodies = yoke()
    motion = ffr.simulate(mechanism, bodies, end_time=END_TIME, tolerance=tolerance)
    assert motion.error <= tolerance and motion.force_error <= math.sqrt(tolerance)
    assert 0.1 * motion.force_error < off(motion) <= motion.force_error
    assert np.max(np.abs(motion.joint_force("slot"))) == pytest.approx(
        PEAK, rel=math.sqrt(tolerance)
    )


def test_force_and_work_by_adaptive_steps() -> None:
    """The root mean square of the force, and the work of driving when braking is lost."""
    mechanism, bodies = yoke()
    adaptive = ffr.RadauIIA(END_TIME, tolerance=1e-6)
    energy, turns = 0.5 * MASS * (RADIUS * SPEED) ** 2, SPEED * END_TIME
    square = 0.5 - math.sin(2.0 * turns) / (4.0 * turns)
    psi = ffr.MechanicalProblem(mechanism, adaptive, ffr.JointForce("slot")).value(bodies).psi
    assert psi == pytest.approx(PEAK * math.sqrt(square), rel=1e-6)
    # begun at full speed, the slide is driven from rest to full speed twice a turn
    halves, remainder = divmod(turns, math.pi)
    driven = energy * (halves + (math.cos(remainder) ** 2 if remainder > 0.5 * math.pi else 0.0))
    work = DriveWork("slot", rounding=1e-6)
    psi = ffr.MechanicalProblem(mechanism, adaptive, work).value(bodies).psi
    assert psi == pytest.approx(driven, rel=2e-3)


def test_a_slow_crane_under_its_weight() -> None:
    """Forces hardly change beside the weight, and steps follow the motion all the same."""
    pin = ffr.Moving.circle((0.0, 0.0), RADIUS, ffr.Motion.polynomial([0.0, 0.1]))
    weld = ffr.Weld(("load", "pin"), pin, angle=0.0)
    mechanism = ffr.Mechanism({"load": ffr.Placement((RADIUS, 0.0))}, [weld], gravity=(0.0, -9.81))
    end_time = 100.0 * math.pi
    path = ffr.PathTracking("load", "pin", (RADIUS, 0.0))
    method = ffr.RadauIIA(end_time, tolerance=1e-6)
    psi = ffr.MechanicalProblem(mechanism, method, path).value({"load": BODY}).psi
    assert psi == pytest.approx(2.0 * RADIUS**2 * end_time, rel=1e-6)


@pytest.mark.parametrize(
    ("load", "square", "error"),
    [
        (lambda t: np.sin(30.0 * t), 1.0 - math.sin(120.0) / 120.0, 1e-6),
        (lambda t: np.where(t > 0.777, 1.0, 0.0), 1.223, 1e-9),
        (lambda t: np.sin(np.pi * np.clip(1e3 * (t - 0.7), 0.0, 1.0)) ** 2, 0.375e-3, 1e-4),
        (lambda t: np.sign(np.sin(20.0 * t)), 2.0, 1e-9),
        (lambda t: 0.0 * t, 0.0, 1e-9),
    ],
    ids=["harmonic", "jump", "blow", "square waves", "none"],
)
def test_the_load_of_a_body_that_stands_still(
    load: Callable[[Array], Array], square: float, error: float
) -> None:
    """Only the multipliers tell how long steps may be; what jumps ends no motion."""
    mechanism, bodies = held(load)
    motion = ffr.simulate(mechanism, bodies, ffr.RadauIIA(END_TIME, tolerance=1e-6))
    assert motion.weights is not None
    mean_square = motion.weights @ motion.joint_force("weld")[:, 0] ** 2
    assert mean_square == pytest.approx(square, rel=error, abs=1e-12)
