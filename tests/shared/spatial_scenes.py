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


def stiffened() -> Case:
    """An open chain with all kinds of forces and stiffening, that starts deformed and in motion."""
    mechanism = ffr.Mechanism(
        PLACES,
        joints=[ffr.Revolute(ROOT, CRANK, axis=(0.0, 1.0, 0.0)), ffr.Spherical(ONE, TWO)],
        gravity=(0.0, 0.0, -9.81),
        damping={"one": ffr.RayleighDamping(0.3, 0.001)},
        forces=[
            ffr.Force(TIP, 1.0, -2.0, follower=True, z=0.5),
            ffr.Torque(TIP, (0.3, 0.2, -0.4)),
            ffr.TorsionalSpringDamper(ONE, TWO, 5.0, 0.7, axis=(0.0, 0.0, 1.0)),
            ffr.SpringDamper(TIP, ffr.Ground((1.0, 1.0, 1.0)), 50.0, 2.0),
        ],
        point_masses=[ffr.PointMass(TIP, 0.3)],
        start=ffr.Assembled({"one": [0.05, 0.02, -0.03]}, {"two": [0.3, -0.2]}),
    )
    path = ffr.PathTracking("two", "tip", (2.0, 0.1, -0.3))
    objective = ffr.IntegralCompliance() + path + 1e-3 * ffr.MarkerAcceleration(*ONE)
    return Case(mechanism, objective, stiffened_cloud)


def settled() -> Case:
    """From the static equilibrium, with a drive and a bushing."""
    motion, place, y = ffr.Motion.polynomial([0.0, 0.0, 3.0]), (2.0, 0.2, 0.0), (0.0, 1.0, 0.0)
    mechanism = ffr.Mechanism(
        PLACES,
        joints=[
            ffr.Revolute(ROOT, ffr.Ground(), axis=y),
            ffr.Revolute(ONE, TWO, axis=(0.0, 1.0, 0.3)),
            ffr.PrescribedAngle(ROOT, motion, name="drive", axis=y),
        ],
        gravity=(1.0, 3.0, -9.81),
        forces=[
            ffr.TorsionalSpringDamper(ONE, TWO, 15.0, 0.7, axis=(0.0, 1.0, 0.3)),
            ffr.Bushing(TIP, ffr.Ground(place), (20.0, 30.0, 10.0), (1.0, 1.0, 1.0), (2, 3, 4)),
        ],
        start=ffr.StaticEquilibrium(),
    )
    return Case(mechanism, ffr.IntegralCompliance() + 0.01 * ffr.JointForce("drive"))


def hub(modes: int, seed: int) -> ffr.VolumeIntegrals:
    """A body with a marker at the origin of its frame."""
    body = cloud(modes, seed, 4e5)
    root = replace(body.markers["root"], position=np.zeros(3))
    return replace(body, markers={**body.markers, "root": root})


def spun() -> Case:
    """A body that is spun on a spring and turns a geared one, by up to a turn in each step."""
    tilted = (0.0, 0.6, 0.8)
    turn, spin = 4.0 * np.array(tilted), 20.0 * np.array(tilted)
    mechanism = ffr.Mechanism(
        {
            "one": ffr.Placement((0.0, 0.0, 0.0), rotation=turn, angular_velocity=spin),
            "two": ffr.Placement((0.0, 1.0, 0.0), angular_velocity=(0.0, 0.0, -40.0)),
        },
        joints=[
            ffr.Revolute(ROOT, ffr.Ground(), axis=tilted),
            ffr.Revolute(("two", "root"), ffr.Ground((0.0, 1.0, 0.0))),
            AngleCoupling(("two", "root"), ROOT, -2.0, "gear", (0.0, 0.0, 1.0), tilted),
        ],
        forces=[ffr.TorsionalSpringDamper(ROOT, ffr.Ground(), 5.0, 0.02, angle=0.0, axis=tilted)],
    )
    objective = ffr.IntegralCompliance() + 0.1 * ffr.JointForce("gear") + ffr.MarkerVelocity(*ONE)
    rigid = ffr.GeneralizedAlpha(1.0, 5)
    return Case(mechanism, objective, lambda modes, seed: hub(0, seed), rigid)


#: All mechanisms by name
IN_SPACE: dict[str, Callable[[], Case]] = {
    make.__name__ + " in space": make for make in (loop, stiffened, settled, spun)
}
