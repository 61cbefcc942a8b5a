# SPDX-License-Identifier: MIT
"""A Scotch yoke, built from the lists of ``docs/how_to``: a pin in a slot drives a rod.

    pin = radius (cos phi, sin phi),   x(slot) = pin_x,   the rod slides along x

The slot is a line across the rod's left end, so that the pin's force also bends the rod.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from shared.derivatives import check_gradient

import dolfinx_ffr as ffr

RADIUS, LENGTH, HEIGHT = 0.05, 0.3, 0.02  # [m]
LOAD, DURATION = 0.4, 0.5  # [kg], [s]
ALUMINIUM = ffr.PlaneStress(young=70e9, poisson=0.33, density=2700.0, thickness=0.01)
TURN = ffr.Motion.smooth_step(4.0 * np.pi, DURATION, name="crank angle")
PIN = ffr.Moving.circle((0.0, 0.0), RADIUS, TURN)


#: A rod that is pushed at its left end by a pin in a slot, and guided at its right end
MECHANISM = ffr.Mechanism(
    placements={"rod": ffr.Placement((RADIUS, 0.0))},
    joints=[
        ffr.PointOnLine(PIN, ("rod", "left"), direction=(0.0, 1.0), name="slot"),
        ffr.Translational(("rod", "right"), ffr.Ground(), direction=(1.0, 0.0), name="guide"),
    ],
    point_masses=[ffr.PointMass(("rod", "right"), LOAD)],
)


def test_rigid_yoke_follows_the_cosine() -> None:
    """Position to round-off; force mass times acceleration, of second order in the step."""
    mass = 0.2
    rod = ffr.VolumeIntegrals.rigid(
        mass, (LENGTH / 2, 0.0), 1e-3, {"left": (0.0, 0.0), "right": (LENGTH, 0.0)}
    )
    errors = []
    for steps in (400, 800):
        motion = ffr.simulate(MECHANISM, {"rod": rod}, ffr.GeneralizedAlpha(DURATION, steps))
        x, _, acceleration = PIN.x.tabulate(motion.t)
        path = motion.marker_path("rod", "right")
        np.testing.assert_allclose(path[:, 0], x + LENGTH, atol=1e-12)
        np.testing.assert_allclose(path[:, 1], 0.0, atol=1e-12)
        # joint_force is that on the first marker, the pin; the rod feels the opposite, along the
        # normal of the slot, which is -x
        force = motion.joint_force("slot")[:, 0]
        expected = (mass + LOAD) * acceleration
        scale = np.max(np.abs(expected))
        errors.append(np.max(np.abs(force - expected)) / scale)
        # the pin is off the axis: the guide holds against the turning moment
        moment = motion.joint_force("guide")[:, 1]
        y = PIN.y.tabulate(motion.t)[0]
        errors[-1] = max(errors[-1], np.max(np.abs(moment - y * expected)) / (RADIUS * scale))
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] > 3.5


@pytest.mark.parametrize(
    "objective",
    [
        ffr.IntegralCompliance(),
        ffr.JointForce("slot", power=4.0),
        ffr.PathTracking("rod", "right", (lambda t: PIN.x.value(t) + LENGTH, 0.0)),
    ],
    ids=["compliance", "force", "path"],
)
def test_gradient(comm: MPI.Intracomm, objective: ffr.Objective) -> None:
    domain = ffr.Domain.rectangle(comm, LENGTH, HEIGHT, elements=(24, 4))
    rod = ffr.FlexibleBody(domain, ALUMINIUM, frame=ffr.ChordFrame("left", "right"), modes=4)
    integrator = ffr.GeneralizedAlpha(DURATION, 400)
    problem = ffr.Problem({"rod": rod}, MECHANISM, integrator, objective)
    check_gradient(problem, taylor=8e-3, step=2e-3)
