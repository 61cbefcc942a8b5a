# SPDX-License-Identifier: MIT
"""Planar mechanisms for the tests of dynamics and adjoint."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import dolfinx_ffr as ffr
from shared.beams import beam

Bodies = dict[str, ffr.VolumeIntegrals]


@dataclass(frozen=True)
class Scene:
    """A mechanism, its bodies and a time integration."""

    mechanism: ffr.Mechanism
    bodies: Bodies
    integrator: ffr.GeneralizedAlpha


def swing(start: float, size: float, rate: float, speed: float = 0.0) -> ffr.Motion:
    """A sine about a start, or about what moves with a speed."""
    return ffr.Motion(
        lambda t: start + speed * t + size * np.sin(rate * t),
        lambda t: speed + size * rate * np.cos(rate * t),
        lambda t: -size * rate**2 * np.sin(rate * t),
        "swing",
    )


def slider_crank_mechanism(
    motion: ffr.Motion,
    *,
    crank: float = 0.1,
    rod: float = 0.4,
    slider: float = 0.5,
    origin: float = 0.5,
    **options: Any,
) -> ffr.Mechanism:
    """A prescribed crank, a rod with its frame at a share of the way, a slider with a mass."""
    return ffr.Mechanism(
        placements={"rod": ffr.Placement(position=(crank + origin * rod, 0.0))},
        joints=[
            ffr.Revolute(
                ("rod", "left"), ffr.Moving.circle((0.0, 0.0), crank, motion), name="crank pin"
            ),
            ffr.PointOnLine(("rod", "right"), ffr.Ground(), name="slider"),
        ],
        point_masses=[ffr.PointMass(("rod", "right"), slider)],
        **options,
    )


def slider_crank(end_time: float = 0.4, steps: int = 160, modes: int = 6) -> Scene:
    """Flexible rod between a prescribed crank and a slider of 0.5 kg."""
    mechanism = slider_crank_mechanism(ffr.Motion.smooth_step(4.0 * math.pi, 0.5))
    return Scene(mechanism, {"rod": beam(modes=modes)}, ffr.GeneralizedAlpha(end_time, steps))


#: Lengths of the links of the four-bar linkage [m]; the ground's is the distance of the bearings.
CRANK, COUPLER, ROCKER, GROUND = 0.1, 0.4, 0.3, 0.4


def four_bar_mechanism(damping: dict[str, ffr.RayleighDamping], *, origin: float) -> ffr.Mechanism:
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
    drive = swing(0.5 * np.pi, 0.5, 9.0, 12.0)

    def placed(left: np.ndarray, right: np.ndarray) -> ffr.Placement:
        position = (1.0 - origin) * left + origin * right
        return ffr.Placement(tuple(position), math.atan2(*(right - left)[::-1]))

    return ffr.Mechanism(
        placements={
            "crank": placed(bearing, pin),
            "coupler": placed(pin, end),
            "rocker": placed(end, pivot),
        },
        joints=[
            ffr.Revolute(("crank", "left"), ffr.Ground(), name="motor bearing"),
            ffr.Revolute(("crank", "right"), ("coupler", "left"), name="crank pin"),
            ffr.Revolute(("coupler", "right"), ("rocker", "left"), name="coupler pin"),
            ffr.Revolute(("rocker", "right"), ffr.Ground((GROUND, 0.0)), name="rocker bearing"),
            ffr.PrescribedAngle(("crank", "left"), drive, name="motor"),
        ],
        gravity=(0.0, -9.81),
        damping=damping,
    )


def four_bar(end_time: float = 0.3, steps: int = 150) -> Scene:
    """Rigid crank driven by a motor, flexible coupler and flexible rocker, gravity and damping."""
    damping = {"coupler": ffr.RayleighDamping(2.0, 1e-5), "rocker": ffr.RayleighDamping(0.0, 2e-5)}
    bodies = {
        "crank": ffr.VolumeIntegrals.rigid(
            0.3, (0.01, 0.005), 4e-4, {"left": (-0.05, 0.0), "right": (0.05, 0.0)}
        ),
        "coupler": beam(COUPLER, 0.01, 0.01, elements=8, modes=3, frame="chord"),
        "rocker": beam(ROCKER, 0.008, 0.01, elements=8, modes=2, frame="tangent"),
    }
    mechanism = four_bar_mechanism(damping, origin=0.5)
    return Scene(mechanism, bodies, ffr.GeneralizedAlpha(end_time, steps))


def robot(end_time: float = 0.3, steps: int = 120) -> Scene:
    """Arm on a lifted base, welded tip, a slider that runs along the bending arm, a moving rail.

    Nearly every term of every kind of joint is at work: lines on flexible, moving and ground
    markers, a weld and a prescribed angle in the middle of flexible bodies, prescribed positions.
    """
    lift = ffr.Motion.polynomial([0.0, 0.3, 1.5], "lift")
    rail = ffr.Moving(
        ffr.Motion.polynomial([0.25, 0.1]),
        ffr.Motion.polynomial([0.35, 0.0, 0.5]),
        ffr.Motion.polynomial([0.2, 1.0, -2.0]),
        "rail",
    )
    angle = 0.3
    along = np.array([math.cos(angle), math.sin(angle)])
    tip = 0.4 * along
    mechanism = ffr.Mechanism(
        placements={
            "arm": ffr.Placement(tuple(0.2 * along), angle),
            "tip": ffr.Placement(tuple(tip + 0.1 * along), angle),
            "rider": ffr.Placement(tuple(0.25 * along), angle),
            "link": ffr.Placement((0.3, 0.25), 1.2),
        },
        joints=[
            ffr.PrescribedPosition(("arm", "left"), "x", ffr.Motion.constant(0.0), name="base x"),
            ffr.PrescribedPosition(("arm", "left"), "y", lift, name="base y"),
            ffr.PrescribedAngle(("arm", "left"), swing(0.3, 0.8, 7.0), name="swing"),
            ffr.Weld(("arm", "right"), ("tip", "left"), name="flange"),
            ffr.PointOnLine(("rider", "pin"), ("arm", "middle"), (1.0, 0.1), name="guide"),
            ffr.Revolute(("link", "left"), ("rider", "pin"), name="rider pin"),
            ffr.PointOnLine(("link", "right"), rail, name="rail"),
            ffr.PointOnLine(("tip", "right"), ("link", "middle"), (0.3, 1.0), name="wedge"),
        ],
        point_masses=[ffr.PointMass(("tip", "middle"), 0.2), ffr.PointMass(("arm", "right"), 0.1)],
        gravity=(1.0, -9.81),
        damping={"arm": ffr.RayleighDamping(5.0, 1e-4)},
    )
    bodies = {
        "arm": beam(0.4, 0.01, 0.01, elements=8, modes=5, frame="free"),
        "tip": beam(0.2, 0.008, 0.01, elements=6, modes=3, frame="free"),
        "rider": ffr.VolumeIntegrals.rigid(0.4, (0.02, 0.01), 1e-3, {"pin": (0.0, 0.0)}),
        "link": beam(0.3, 0.008, 0.01, elements=8, modes=3, frame="free"),
    }
    return Scene(mechanism, bodies, ffr.GeneralizedAlpha(end_time, steps, 0.7))


def loader(end_time: float = 0.2, steps: int = 120) -> Scene:
    """Boom on elastic bearings with a geared arm, a sliding carriage and a cylinder, on a shaker.

    Every kind of force, and the joints that the robot lacks, on flexible bodies.
    """
    shaft = ffr.Moving(
        ffr.Motion.polynomial([0.5, 0.0, 0.3]),
        ffr.Motion.polynomial([0.3, 0.2]),
        ffr.Motion.polynomial([0.1, 1.0, 4.0]),
        "shaft",
    )
    mechanism = ffr.Mechanism(
        placements={
            "boom": ffr.Placement((0.0, 0.0), 0.1, (0.2, 0.1), 1.0),
            "arm": ffr.Placement((0.3, 0.13), 0.9),
            "link": ffr.Placement((0.5, 0.15), -1.4, (0.0, 0.0), 2.0),
            "carriage": ffr.Placement((0.0, 0.08), 0.3),
        },
        joints=[
            ffr.Revolute(("arm", "left"), ("boom", "right"), name="elbow"),
            ffr.Revolute(("link", "left"), shaft, name="shaft"),
            ffr.mechanism.AngleCoupling(("arm", "left"), ("link", "middle"), -0.6, name="gear"),
            ffr.Translational(("carriage", "left"), ("boom", "middle"), (1.0, 0.3), name="rails"),
            ffr.Distance(
                ("arm", "right"), ("carriage", "right"), swing(0.32, 0.02, 11.0), name="cylinder"
            ),
            ffr.Distance(("link", "right"), ("boom", "right"), name="strut"),
        ],
        forces=[
            ffr.SpringDamper(("boom", "left"), ffr.Ground((-0.2, -0.02)), 3e3, 4.0, 0.0, "bearing"),
            ffr.SpringDamper(("boom", "right"), ffr.Ground((0.2, 0.4)), 2e3, 5.0, 0.35, "rope"),
            ffr.SpringDamper(
                ("carriage", "middle"), ("boom", "left"), 1e3, 3.0, lambda t: 0.2 + 0.5 * t
            ),
            ffr.SpringDamper(("link", "middle"), ("boom", "middle"), 40.0, 2.0, 0.0, "bush"),
            ffr.TorsionalSpringDamper(("boom", "middle"), ffr.Ground(angle=0.05), 30.0, 0.2, 0.0),
            ffr.TorsionalSpringDamper(("arm", "middle"), ("boom", "right"), 5.0, 0.05),
            ffr.TorsionalSpringDamper(
                ("carriage", "right"), shaft, 1.0, 0.02, lambda t: np.sin(9 * t)
            ),
            ffr.Force(("arm", "right"), 3.0, lambda t: 20.0 * np.sin(30.0 * t), name="load"),
            ffr.Force(("link", "right"), 4.0, ffr.Motion.polynomial([1.0, 50.0]), True, name="jet"),
            ffr.Torque(("boom", "right"), lambda t: 0.8 * np.cos(40.0 * t), name="motor"),
        ],
        gravity=(0.0, lambda t: -9.81 * np.exp(-t)),
        ground_acceleration=(lambda t: 15.0 * np.sin(25.0 * t), 1.0),
        damping={"boom": ffr.RayleighDamping(2.0, 1e-5)},
        point_masses=[ffr.PointMass(("arm", "right"), 0.1)],
    )
    bodies = {
        "boom": beam(0.4, 0.01, 0.01, elements=8, modes=4, frame="free"),
        "arm": beam(0.3, 0.008, 0.01, elements=6, modes=3, frame="free"),
        "link": beam(0.3, 0.008, 0.01, elements=6, modes=2, frame="free"),
        "carriage": beam(0.2, 0.01, 0.01, elements=6, modes=2, frame="free"),
    }
    return Scene(mechanism, bodies, ffr.GeneralizedAlpha(end_time, steps))


def stiffened(end_time: float = 0.3, steps: int = 120) -> Scene:
    """The robot with geometric stiffness of every kind, large enough to matter at its speed."""
    scene, rng = robot(end_time, steps), np.random.default_rng(7)
    # About the largest angular velocity squared, angular acceleration and acceleration.
    loads = {"omega2": ((), 100.0), "alpha": ((), 1000.0), "acceleration": ((2,), 200.0)}
    bodies = dict(scene.bodies)
    for name in ("arm", "link"):
        body = bodies[name]
        # Slopes of modes, to whose squares geometric stiffness belongs, grow like frequencies.
        slopes = np.sqrt(np.sqrt(body.K[0, 0] * np.diag(body.K)))
        size = np.outer(slopes, slopes)
        arrays = {}
        for load, (shape, value) in loads.items():
            array = rng.uniform(-1.0, 1.0, (*shape, *size.shape)) * size
            arrays[load] = 0.01 / value * (array + np.swapaxes(array, -1, -2))
        if name == "link":
            del arrays["alpha"]
        bodies[name] = replace(body, stiffening=arrays)
    return replace(scene, bodies=bodies)


def calm(name: str) -> Scene:
    """A scene whose random geometric stiffness is so small that no motion runs away."""
    scene = SCENES[name]()
    bodies = {
        key: replace(body, stiffening={load: 0.2 * a for load, a in body.stiffening.items()})
        for key, body in scene.bodies.items()
    }
    return replace(scene, bodies=bodies)


def trapezoidal_drive(known: bool = True) -> ffr.Motion:
    """An angle with a trapezoidal velocity, whose acceleration jumps at 0.1, 0.3 and 0.4 s."""
    a, ramp, total = 40.0, 0.1, 0.4

    def angle(t: np.ndarray) -> np.ndarray:
        early, late = np.minimum(t, ramp), np.clip(t - (total - ramp), 0.0, ramp)
        cruise = np.clip(t - ramp, 0.0, total - ramp)
        return 0.5 * a * early**2 + a * ramp * cruise - 0.5 * a * late**2

    return ffr.Motion(
        angle,
        lambda t: a * np.clip(np.minimum(t, total - t), 0.0, ramp),
        lambda t: np.where(t < ramp, a, np.where((t < total - ramp) | (t >= total), 0.0, -a)),
        "drive",
        (ramp, total - ramp, total) if known else (),
    )


SCENES: dict[str, Callable[..., Scene]] = {
    "slider-crank": slider_crank,
    "four-bar": four_bar,
    "robot": robot,
    "loader": loader,
    "stiffened": stiffened,
}


def out_of_reach() -> tuple[ffr.Mechanism, Bodies]:
    """A flexible arm on a rod whose pin moves away: at t = 0.4 s its guide is out of reach."""
    pin = ffr.Moving(ffr.Motion.constant(0.0), ffr.Motion.polynomial([0.0, 2.5]), name="lift")
    ends = {"left": (-0.5, 0.0), "right": (0.5, 0.0)}
    bodies = {
        "carrier": ffr.VolumeIntegrals.rigid(1.0, (0.0, 0.0), 0.1, ends),
        "rod": slider_crank().bodies["rod"],
    }
    mechanism = ffr.Mechanism(
        {"carrier": ffr.Placement((0.5, 0.0)), "rod": ffr.Placement((1.2, 0.0))},
        [
            ffr.Revolute(("carrier", "left"), pin, name="pin"),
            ffr.PointOnLine(("carrier", "right"), ffr.Ground(), name="guide"),
            ffr.Weld(("rod", "left"), ("carrier", "right"), name="flange"),
        ],
    )
    return mechanism, bodies


def parallelograms(loops: int = 2) -> tuple[ffr.Mechanism, Bodies]:
    """IFToMM benchmark A02, parallelograms in a row; passes positions with all links in line."""
    markers = {"left": (-0.5, 0.0), "middle": (0.0, 0.0), "right": (0.5, 0.0)}
    link = ffr.VolumeIntegrals.rigid(1.0, (0.0, 0.0), 1.0 / 12.0, markers)
    bodies: Bodies = {}
    placements, joints = {}, []
    for i in range(loops + 1):
        bodies[f"crank {i}"] = link
        placements[f"crank {i}"] = ffr.Placement((float(i), 0.5), 0.5 * math.pi, (0.5, 0.0), -1.0)
        joints.append(ffr.Revolute((f"crank {i}", "left"), ffr.Ground((float(i), 0.0))))
    for i in range(loops):
        bodies[f"coupler {i}"] = link
        placements[f"coupler {i}"] = ffr.Placement((i + 0.5, 1.0), 0.0, (1.0, 0.0), 0.0)
        joints.append(ffr.Revolute((f"crank {i}", "right"), (f"coupler {i}", "left")))
        joints.append(ffr.Revolute((f"coupler {i}", "right"), (f"crank {i + 1}", "right")))
    return ffr.Mechanism(placements, joints, gravity=(0.0, -9.81)), bodies
