# SPDX-License-Identifier: MIT
"""Parameters of a mechanism through `Problem` and `optimize`, beside bodies and alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.objective import DrivePower
from dolfinx_ffr.verification import taylor_test

pytestmark = pytest.mark.filterwarnings("ignore::dolfinx_ffr.TimeStepWarning")

END, PIN = ("arm", "end"), ("arm", "pin")
MARKERS = {"pin": (-0.3, 0.0), "end": (0.2, 0.0)}
PARAMETERS = ffr.Parameters(
    stiffness=(40.0, 10.0, 200.0, "N/m", "log"),
    mass=(0.3, 0.1, 0.5, "kg"),
    anchor=(0.7, 0.5, 0.9, "m"),
)


def arm(stiffness: float, mass: float, anchor: float) -> tuple[ffr.Mechanism, dict[str, Any]]:
    """A rigid arm that a motor lifts, with a spring; its own mass is the parameter."""
    spring = ffr.SpringDamper(END, ffr.Ground((0.0, anchor)), stiffness, length=0.1)
    angle = ffr.PrescribedAngle(PIN, ffr.Motion.smooth_step(1.0, 0.5), name="motor")
    joints = [ffr.Revolute(PIN, ffr.Ground()), angle]
    body = ffr.VolumeIntegrals.rigid(mass, (0.02, 0.01), 0.05, MARKERS)
    placed = {"arm": ffr.Placement((0.3, 0.0))}
    mechanism = ffr.Mechanism(placed, joints, gravity=(0.0, -9.81), forces=[spring])
    return mechanism, {"arm": body}


def arm_problem(build: Any = arm, parameters: ffr.Parameters = PARAMETERS) -> ffr.Problem:
    times, power = ffr.GeneralizedAlpha(0.5, 30), ffr.Constraint(DrivePower("motor"), upper=6.0)
    mechanism = parameters.mechanism(build)
    return ffr.Problem({}, mechanism, times, ffr.JointForce("motor"), [power])
