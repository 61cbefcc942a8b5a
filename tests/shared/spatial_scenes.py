# SPDX-License-Identifier: MIT
"""Mechanisms of two bodies in space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Integrator
from dolfinx_ffr.mechanism import AngleCoupling

from .spatial_bodies import cloud, stiffened_cloud

Bodies = dict[str, ffr.VolumeIntegrals]
Make = Callable[[int, int], ffr.VolumeIntegrals]

ONE, TWO, ROOT, TIP = ("one", "tip"), ("two", "root"), ("one", "root"), ("two", "tip")
PLACES = {
    "one": ffr.Placement((0.5, 0.0, 0.0)),
    "two": ffr.Placement((1.5, 0.1, -0.1), rotation=(0.2, 0.1, 0.0)),
}
CRANK = ffr.Moving.circle(
    (0.0, 0.0, 0.0), 0.2, ffr.Motion.smooth_step(6.0, 0.5), axis=(0.3, 0.2, 1.0)
)


@dataclass(frozen=True)
class Case:
    """A mechanism of two flexible bodies, and what is asked of it."""

    mechanism: ffr.Mechanism
    objective: ffr.Objective
    make: Make = cloud
    integrator: Integrator = field(default_factory=lambda: ffr.GeneralizedAlpha(0.3, 30))

    @property
    def bodies(self) -> Bodies:
        return {"one": self.make(3, 1), "two": self.make(2, 2)}

    @property
    def problem(self) -> ffr.MechanicalProblem:
        return ffr.MechanicalProblem(self.mechanism, self.integrator, self.objective)


def loop() -> Case:
    """A closed chain on a crank: ball, Hooke's joint, plane."""
    mechanism = ffr.Mechanism(
        PLACES,
        joints=[
            ffr.Spherical(ROOT, CRANK),
            ffr.Universal(ONE, TWO, (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), "cross"),
            ffr.PointOnPlane(TIP, ffr.Ground((0.0, 0.0, -0.3)), (0.1, 0.1, 1.0)),
        ],
        gravity=(0.0, 0.0, -9.81),
    )
    path = ffr.PathTracking("two", "tip", (lambda t: 2.0 + t, 0.1, -0.3))
    objective = ffr.IntegralCompliance() + 0.1 * ffr.JointForce("cross") + path
    objective += 1e-3 * ffr.MarkerAcceleration("two", "tip") + ffr.MarkerVelocity(*ONE)
    return Case(mechanism, objective)


def chain(
    turn: float = 6.0,
    radius: float = 0.2,
    fall: float = 9.81,
    alpha: float = 0.3,
    beta: float = 1e-3,
    push: float = 1.0,
    moment: float = 0.2,
    stiffness: float = 5.0,
    damping: float = 0.7,
    anchor: float = 1.0,
    tip: float = 0.3,
    bent: float = 0.05,
) -> ffr.Mechanism:
    """An open chain on a crank with all kinds of forces, that starts deformed and in motion."""
    angle = ffr.Motion.smooth_step(turn, 0.5)
    crank = ffr.Moving.circle((0.0, 0.0, 0.0), radius, angle, axis=(0.3, 0.2, 1.0))
    return ffr.Mechanism(
        PLACES,
        joints=[ffr.Revolute(ROOT, crank, axis=(0.0, 1.0, 0.0)), ffr.Spherical(ONE, TWO)],
        gravity=(0.0, 0.0, -fall),
        damping={"one": ffr.RayleighDamping(alpha, beta)},
        forces=[
            ffr.Force(TIP, push, -2.0, follower=True, z=0.5),
            ffr.Torque(TIP, (0.3, moment, -0.4)),
            ffr.TorsionalSpringDamper(ONE, TWO, stiffness, damping, axis=(0.0, 0.0, 1.0)),
            ffr.SpringDamper(TIP, ffr.Ground((anchor, 1.0, 1.0)), 50.0, 2.0),
        ],
        point_masses=[ffr.PointMass(TIP, tip)],
        start=ffr.Assembled({"one": [bent, 0.02, -0.03]}, {"two": [0.3, -0.2]}),
    )


def stiffened() -> Case:
    """The open chain of bodies with stiffening."""
    path = ffr.PathTracking("two", "tip", (2.0, 0.1, -0.3))
    objective = ffr.IntegralCompliance() + path + 1e-3 * ffr.MarkerAcceleration(*ONE)
    return Case(chain(), objective, stiffened_cloud)


def driven(
    drive: float = 3.0,
    place: float = 0.2,
    pin: float = 0.0,
    axis: float = 0.3,
    side: float = 3.0,
    stiffness: float = 15.0,
    bushing: float = 30.0,
) -> ffr.Mechanism:
    """From the static equilibrium, with a drive and a bushing."""
    motion, y = ffr.Motion.polynomial([0.0, 0.0, drive]), (0.0, 1.0, 0.0)
    along, post = (20.0, bushing, 10.0), ffr.Ground((2.0, place, 0.0))
    return ffr.Mechanism(
        PLACES,
        joints=[
            ffr.Revolute(ROOT, ffr.Ground((0.0, 0.0, pin)), axis=y),
            ffr.Revolute(ONE, TWO, axis=(0.0, 1.0, axis)),
            ffr.PrescribedAngle(ROOT, motion, name="drive", axis=y),
        ],
        gravity=(1.0, side, -9.81),
        forces=[
            ffr.TorsionalSpringDamper(ONE, TWO, stiffness, 0.7, axis=(0.0, 1.0, 0.3)),
            ffr.Bushing(TIP, post, along, (1.0, 1.0, 1.0), (2, 3, 4)),
        ],
        start=ffr.StaticEquilibrium(),
    )


def settled() -> Case:
    """From the static equilibrium, with a drive and a bushing."""
    return Case(driven(), ffr.IntegralCompliance() + 0.01 * ffr.JointForce("drive"))


def hub(modes: int, seed: int) -> ffr.VolumeIntegrals:
    """A body with a marker at the origin of its frame."""
    body = cloud(modes, seed, 4e5)
    root = replace(body.markers["root"], position=np.zeros(3))
    return replace(body, markers={**body.markers, "root": root})


def geared(
    spin: float = 20.0, ratio: float = -2.0, stiffness: float = 5.0, rest: float = 0.0
) -> ffr.Mechanism:
    """A body that is spun on a spring and turns a geared one."""
    tilted = np.array((0.0, 0.6, 0.8))
    turn, turning = 4.0 * tilted, spin * tilted
    return ffr.Mechanism(
        {
            "one": ffr.Placement((0.0, 0.0, 0.0), rotation=turn, angular_velocity=turning),
            "two": ffr.Placement((0.0, 1.0, 0.0), angular_velocity=(0.0, 0.0, -40.0)),
        },
        joints=[
            ffr.Revolute(ROOT, ffr.Ground(), axis=tilted),
            ffr.Revolute(("two", "root"), ffr.Ground((0.0, 1.0, 0.0))),
            AngleCoupling(("two", "root"), ROOT, ratio, "gear", (0.0, 0.0, 1.0), tilted),
        ],
        forces=[
            ffr.TorsionalSpringDamper(ROOT, ffr.Ground(), stiffness, 0.02, angle=rest, axis=tilted)
        ],
    )


def spun() -> Case:
    """The geared bodies, by up to a turn in each step."""
    objective = ffr.IntegralCompliance() + 0.1 * ffr.JointForce("gear") + ffr.MarkerVelocity(*ONE)
    rigid = ffr.GeneralizedAlpha(1.0, 5)
    return Case(geared(), objective, lambda modes, seed: hub(0, seed), rigid)


#: All mechanisms by name
IN_SPACE: dict[str, Callable[[], Case]] = {
    make.__name__ + " in space": make for make in (loop, stiffened, settled, spun)
}
