# SPDX-License-Identifier: MIT
"""Planar mechanisms for the tests of dynamics and adjoint, and random changes of their bodies."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dolfinx_ffr.body import BodyMarker, VolumeIntegrals
from dolfinx_ffr.dynamics import GeneralizedAlpha
from dolfinx_ffr.mechanism import (
    Distance,
    Force,
    Gear,
    Ground,
    Mechanism,
    Moving,
    Placement,
    PointMass,
    PointOnLine,
    PrescribedAngle,
    PrescribedPosition,
    RayleighDamping,
    Revolute,
    SpringDamper,
    Torque,
    TorsionalSpringDamper,
    Translational,
    Weld,
)
from dolfinx_ffr.mechanism.motion import Motion
from shared.beams import beam

Bodies = dict[str, VolumeIntegrals]


@dataclass(frozen=True)
class Scene:
    """A mechanism, its bodies and a time integration."""

    mechanism: Mechanism
    bodies: Bodies
    integrator: GeneralizedAlpha


def slider_crank_mechanism(
    motion: Motion, *, crank: float = 0.1, rod: float = 0.4, slider: float = 0.5
) -> Mechanism:
    """A prescribed crank, a rod with its frame half-way between its ends, a slider with a mass."""
    return Mechanism(
        placements={"rod": Placement(position=(crank + 0.5 * rod, 0.0))},
        joints=[
            Revolute(("rod", "left"), Moving.circle((0.0, 0.0), crank, motion), name="crank pin"),
            PointOnLine(("rod", "right"), Ground(), name="slider"),
        ],
        point_masses=[PointMass(("rod", "right"), slider)],
    )


def slider_crank(end_time: float = 0.4, steps: int = 160, modes: int = 6) -> Scene:
    """Flexible rod between a prescribed crank and a slider of 0.5 kg."""
    mechanism = slider_crank_mechanism(Motion.smooth_step(4.0 * math.pi, 0.5))
    return Scene(mechanism, {"rod": beam(modes=modes)}, GeneralizedAlpha(end_time, steps))


#: Lengths of the links of the four-bar linkage [m]; the ground's is the distance of the bearings.
CRANK, COUPLER, ROCKER, GROUND = 0.1, 0.4, 0.3, 0.4


def four_bar_mechanism(damping: dict[str, RayleighDamping], *, origin: float) -> Mechanism:
    """A crank driven by a motor, upright at the start, a coupler and a rocker, under gravity.

    The markers of each link are "left" and "right". The origins of their frames lie at a share of
    the way from left to right.
    """
    # the coupler's end is where two circles meet
    bearing, pin, pivot = np.zeros(2), np.array([0.0, CRANK]), np.array([GROUND, 0.0])
    gap = pivot - pin
    d = float(np.hypot(*gap))
    along = (COUPLER**2 - ROCKER**2 + d**2) / (2.0 * d)
    across = math.sqrt(COUPLER**2 - along**2)
    end = pin + along * gap / d + across * np.array([-gap[1], gap[0]]) / d
    drive = Motion(
        lambda t: 0.5 * np.pi + 12.0 * t + 0.5 * np.sin(9.0 * t),
        lambda t: 12.0 + 4.5 * np.cos(9.0 * t),
        lambda t: -40.5 * np.sin(9.0 * t),
        "motor",
    )

    def placed(left: np.ndarray, right: np.ndarray) -> Placement:
        position = (1.0 - origin) * left + origin * right
        return Placement(tuple(position), math.atan2(*(right - left)[::-1]))

    return Mechanism(
        placements={
            "crank": placed(bearing, pin),
            "coupler": placed(pin, end),
            "rocker": placed(end, pivot),
        },
        joints=[
            Revolute(("crank", "left"), Ground(), name="motor bearing"),
            Revolute(("crank", "right"), ("coupler", "left"), name="crank pin"),
            Revolute(("coupler", "right"), ("rocker", "left"), name="coupler pin"),
            Revolute(("rocker", "right"), Ground((GROUND, 0.0)), name="rocker bearing"),
            PrescribedAngle(("crank", "left"), drive, name="motor"),
        ],
        gravity=(0.0, -9.81),
        damping=damping,
    )


def four_bar(end_time: float = 0.3, steps: int = 150) -> Scene:
    """Rigid crank driven by a motor, flexible coupler and flexible rocker, gravity and damping."""
    damping = {"coupler": RayleighDamping(2.0, 1e-5), "rocker": RayleighDamping(0.0, 2e-5)}
    bodies = {
        "crank": VolumeIntegrals.rigid(
            0.3, (0.01, 0.005), 4e-4, {"left": (-0.05, 0.0), "right": (0.05, 0.0)}
        ),
        "coupler": beam(COUPLER, 0.01, 0.01, elements=8, modes=3, frame="chord"),
        "rocker": beam(ROCKER, 0.008, 0.01, elements=8, modes=2, frame="tangent"),
    }
    mechanism = four_bar_mechanism(damping, origin=0.5)
    return Scene(mechanism, bodies, GeneralizedAlpha(end_time, steps))


def robot(end_time: float = 0.3, steps: int = 120) -> Scene:
    """Arm on a lifted base, welded tip, a slider that runs along the bending arm, a moving rail.

    Nearly every term of every kind of joint is at work: lines on flexible, moving and ground
    markers, a weld and a prescribed angle in the middle of flexible bodies, prescribed positions.
    """
    swing = Motion(
        lambda t: 0.3 + 0.8 * np.sin(7.0 * t),
        lambda t: 5.6 * np.cos(7.0 * t),
        lambda t: -39.2 * np.sin(7.0 * t),
        "swing",
    )
    lift = Motion.polynomial([0.0, 0.3, 1.5], "lift")
    rail = Moving(
        Motion.polynomial([0.25, 0.1]),
        Motion.polynomial([0.35, 0.0, 0.5]),
        Motion.polynomial([0.2, 1.0, -2.0]),
        "rail",
    )
    angle = 0.3
    along = np.array([math.cos(angle), math.sin(angle)])
    tip = 0.4 * along
    mechanism = Mechanism(
        placements={
            "arm": Placement(tuple(0.2 * along), angle),
            "tip": Placement(tuple(tip + 0.1 * along), angle),
            "rider": Placement(tuple(0.25 * along), angle),
            "link": Placement((0.3, 0.25), 1.2),
        },
        joints=[
            PrescribedPosition(("arm", "left"), "x", Motion.constant(0.0), name="base x"),
            PrescribedPosition(("arm", "left"), "y", lift, name="base y"),
            PrescribedAngle(("arm", "left"), swing, name="swing"),
            Weld(("arm", "right"), ("tip", "left"), name="flange"),
            PointOnLine(("rider", "pin"), ("arm", "middle"), (1.0, 0.1), name="guide"),
            Revolute(("link", "left"), ("rider", "pin"), name="rider pin"),
            PointOnLine(("link", "right"), rail, name="rail"),
            PointOnLine(("tip", "right"), ("link", "middle"), (0.3, 1.0), name="wedge"),
        ],
        point_masses=[PointMass(("tip", "middle"), 0.2), PointMass(("arm", "right"), 0.1)],
        gravity=(1.0, -9.81),
        damping={"arm": RayleighDamping(5.0, 1e-4)},
    )
    bodies = {
        "arm": beam(0.4, 0.01, 0.01, elements=8, modes=5, frame="free"),
        "tip": beam(0.2, 0.008, 0.01, elements=6, modes=3, frame="free"),
        "rider": VolumeIntegrals.rigid(0.4, (0.02, 0.01), 1e-3, {"pin": (0.0, 0.0)}),
        "link": beam(0.3, 0.008, 0.01, elements=8, modes=3, frame="free"),
    }
    return Scene(mechanism, bodies, GeneralizedAlpha(end_time, steps, 0.7))


def loader(end_time: float = 0.2, steps: int = 120) -> Scene:
    """Boom on elastic bearings with a geared arm, a sliding carriage and a cylinder, on a shaker.

    Every kind of force, and the joints that the robot lacks, on flexible bodies.
    """
    shaft = Moving(
        Motion.polynomial([0.5, 0.0, 0.3]),
        Motion.polynomial([0.3, 0.2]),
        Motion.polynomial([0.1, 1.0, 4.0]),
        "shaft",
    )
    stroke = Motion(
        lambda t: 0.32 + 0.02 * np.sin(11.0 * t),
        lambda t: 0.22 * np.cos(11.0 * t),
        lambda t: -2.42 * np.sin(11.0 * t),
        "stroke",
    )
    mechanism = Mechanism(
        placements={
            "boom": Placement((0.0, 0.0), 0.1, (0.2, 0.1), 1.0),
            "arm": Placement((0.3, 0.13), 0.9),
            "link": Placement((0.5, 0.15), -1.4, (0.0, 0.0), 2.0),
            "carriage": Placement((0.0, 0.08), 0.3),
        },
        joints=[
            Revolute(("arm", "left"), ("boom", "right"), name="elbow"),
            Revolute(("link", "left"), shaft, name="shaft"),
            Gear(("arm", "left"), ("link", "middle"), -0.6, name="gear"),
            Translational(("carriage", "left"), ("boom", "middle"), (1.0, 0.3), name="rails"),
            Distance(("arm", "right"), ("carriage", "right"), stroke, name="cylinder"),
            Distance(("link", "right"), ("boom", "right"), name="strut"),
        ],
        forces=[
            SpringDamper(("boom", "left"), Ground((-0.2, -0.02)), 3e3, 4.0, 0.0, "bearing"),
            SpringDamper(("boom", "right"), Ground((0.2, 0.4)), 2e3, 5.0, 0.35, "rope"),
            SpringDamper(
                ("carriage", "middle"), ("boom", "left"), 1e3, 3.0, lambda t: 0.2 + 0.5 * t
            ),
            SpringDamper(("link", "middle"), ("boom", "middle"), 40.0, 2.0, 0.0, "bush"),
            TorsionalSpringDamper(("boom", "middle"), Ground(angle=0.05), 30.0, 0.2, 0.0),
            TorsionalSpringDamper(("arm", "middle"), ("boom", "right"), 5.0, 0.05),
            TorsionalSpringDamper(("carriage", "right"), shaft, 1.0, 0.02, lambda t: np.sin(9 * t)),
            Force(("arm", "right"), 3.0, lambda t: 20.0 * np.sin(30.0 * t), name="load"),
            Force(("link", "right"), 4.0, Motion.polynomial([1.0, 50.0]), True, name="jet"),
            Torque(("boom", "right"), lambda t: 0.8 * np.cos(40.0 * t), name="motor"),
        ],
        gravity=(0.0, lambda t: -9.81 * np.exp(-t)),
        ground_acceleration=(lambda t: 15.0 * np.sin(25.0 * t), 1.0),
        damping={"boom": RayleighDamping(2.0, 1e-5)},
        point_masses=[PointMass(("arm", "right"), 0.1)],
    )
    bodies = {
        "boom": beam(0.4, 0.01, 0.01, elements=8, modes=4, frame="free"),
        "arm": beam(0.3, 0.008, 0.01, elements=6, modes=3, frame="free"),
        "link": beam(0.3, 0.008, 0.01, elements=6, modes=2, frame="free"),
        "carriage": beam(0.2, 0.01, 0.01, elements=6, modes=2, frame="free"),
    }
    return Scene(mechanism, bodies, GeneralizedAlpha(end_time, steps))


def stiffened(end_time: float = 0.3, steps: int = 120) -> Scene:
    """The robot with geometric stiffness of every kind, large enough to matter at its speed."""
    scene, rng = robot(end_time, steps), np.random.default_rng(7)
    # About the largest angular velocity squared, angular acceleration and acceleration.
    loads = {"omega2": ((), 100.0), "alpha": ((), 1000.0), "acceleration": ((2,), 200.0)}
    bodies = dict(scene.bodies)
    for name in ("arm", "link"):
        body = bodies[name]
        size = np.sqrt(np.outer(np.diag(body.K), np.diag(body.K)))
        arrays = {}
        for load, (shape, value) in loads.items():
            array = rng.uniform(-1.0, 1.0, (*shape, *size.shape)) * size
            arrays[load] = 0.1 / value * (array + np.swapaxes(array, -1, -2))
        if name == "link":
            del arrays["alpha"]
        bodies[name] = replace(body, stiffening=arrays)
    return replace(scene, bodies=bodies)


SCENES: dict[str, Callable[..., Scene]] = {
    "slider-crank": slider_crank,
    "four-bar": four_bar,
    "robot": robot,
    "loader": loader,
    "stiffened": stiffened,
}


def random_direction(bodies: Bodies, seed: int, fields: str = "mSGNKWPT") -> Bodies:
    """A random change of the integrals, in proportion to their size and with their symmetry.

    The letters choose what changes: mass m, the arrays S, G, N, K, and of the markers the
    displacement shape functions W and the rotation shape functions P; T is geometric stiffness.
    """
    rng = np.random.default_rng(seed)
    out = {}
    for name, body in bodies.items():
        length = max([np.hypot(*m.position) for m in body.markers.values()] + [0.1])
        g = np.sqrt(np.diag(body.G))
        size = {"S": np.sqrt(body.mass) * g[:, None] * np.ones(2), "G": np.outer(g, g)}
        size["N"] = size["G"]
        k = np.sqrt(np.diag(body.K)) if body.modes else np.zeros(0)
        size["K"] = np.outer(k, k)
        arrays = {}
        for key in "SGNK":
            change = size[key] * rng.uniform(-1.0, 1.0, size[key].shape)
            if key in "GK":
                change = 0.5 * (change + change.T)
            if key == "N":
                change = 0.5 * (change - change.T)
            arrays[key] = change * (key in fields)
        markers = {
            m: BodyMarker(
                np.zeros(2),
                rng.uniform(-1.0, 1.0, point.displacement.shape) * ("W" in fields),
                rng.uniform(-1.0, 1.0, point.rotation.shape) / length * ("P" in fields),
            )
            for m, point in body.markers.items()
        }
        stiffening = {}
        for load, array in body.stiffening.items():
            change = rng.uniform(-1.0, 1.0, array.shape) * ("T" in fields)
            change *= 0.1 * np.max(np.abs(array))
            stiffening[load] = 0.5 * (change + np.swapaxes(change, -1, -2))
        mass = body.mass * rng.uniform(-1.0, 1.0) * ("m" in fields)
        out[name] = VolumeIntegrals(mass, **arrays, markers=markers, stiffening=stiffening)
    return out


def moved(bodies: Bodies, direction: Bodies, step: float) -> Bodies:
    """Bodies moved by a step along a direction."""
    return {name: body + direction[name].scaled(step) for name, body in bodies.items()}
