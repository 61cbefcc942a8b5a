# SPDX-License-Identifier: MIT
"""Description of a planar mechanism: placements, joints, forces, point masses, gravity, damping.

A mechanism says how bodies are put together; the bodies themselves come as volume integrals, so
one mechanism serves all designs. Joints and forces act between markers (:mod:`.points`); their
kinds are described in :mod:`.joints` and :mod:`.forces`.

Example:
    >>> crank = Moving.circle((0.0, 0.0), 0.1, Motion.smooth_step(distance=62.8, duration=2.0))
    >>> slider_crank = Mechanism(
    ...     placements={"rod": Placement(position=(0.3, 0.0))},
    ...     joints=[
    ...         Revolute(("rod", "left"), crank),
    ...         PointOnLine(("rod", "right"), Ground(), name="slider"),
    ...     ],
    ...     point_masses=[PointMass(("rod", "right"), 0.5)],
    ...     forces=[SpringDamper(("rod", "right"), Ground((0.7, 0.0)), stiffness=500.0)],
    ... )
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from .forces import AppliedForce, Force, SpringDamper, Torque, TorsionalSpringDamper
from .joints import (
    Distance,
    Gear,
    Joint,
    PointOnLine,
    PrescribedAngle,
    PrescribedPosition,
    Revolute,
    Translational,
    Weld,
)
from .motion import Motion, Signal
from .points import BodyPoint, Ground, Marker, Moving, Pair, marker_name
from .start import Assembled, Start, StaticEquilibrium

__all__ = [
    "AppliedForce",
    "Assembled",
    "BodyPoint",
    "Distance",
    "Force",
    "Gear",
    "Ground",
    "Joint",
    "Marker",
    "Mechanism",
    "Moving",
    "Placement",
    "PointMass",
    "PointOnLine",
    "PrescribedAngle",
    "PrescribedPosition",
    "RayleighDamping",
    "Revolute",
    "SpringDamper",
    "Start",
    "StaticEquilibrium",
    "Torque",
    "TorsionalSpringDamper",
    "Translational",
    "Weld",
    "marker_name",
]


@dataclass(frozen=True)
class Placement:
    """Where a body starts, roughly: position and velocity are corrected so that the joints close.

    The correction is the smallest one in position and angle (velocities alike).
    """

    #: Position of the origin of the body's frame [m].
    position: Pair = (0.0, 0.0)
    #: Angle of the body's frame [rad].
    angle: float = 0.0
    #: Velocity of the origin of the body's frame [m/s].
    velocity: Pair = (0.0, 0.0)
    #: Angular velocity [rad/s].
    angular_velocity: float = 0.0


@dataclass(frozen=True)
class PointMass:
    """A point mass fixed to a marker of a body."""

    #: Name of the body and name of the marker.
    marker: BodyPoint
    #: Mass [kg].
    mass: float


@dataclass(frozen=True)
class RayleighDamping:
    """Damping of the elastic coordinates, alpha times their mass plus beta times the stiffness."""

    #: Mass-proportional coefficient [1/s].
    alpha: float = 0.0
    #: Stiffness-proportional coefficient [s].
    beta: float = 0.0


@dataclass(frozen=True)
class Mechanism:
    """A planar mechanism.

    Raises:
        ValueError: If a number is out of range, a joint lacks a body, or a name stands twice.
    """

    #: Start of every body, by name of the body.
    placements: Mapping[str, Placement]
    #: Joints, in the order of their rows in the multipliers.
    joints: Sequence[Joint] = ()
    #: Point masses.
    point_masses: Sequence[PointMass] = ()
    #: Acceleration of free fall [m/s^2], for instance (0, -9.81); numbers or functions of time.
    gravity: tuple[Signal, Signal] = (0.0, 0.0)
    #: Damping, by name of the body.
    damping: Mapping[str, RayleighDamping] = field(default_factory=dict)
    #: Forces, springs and dampers.
    forces: Sequence[AppliedForce] = ()
    #: Acceleration of the ground [m/s^2], numbers or functions of time. All positions are then
    #: counted from the moving ground, on which the bodies feel the opposite acceleration.
    ground_acceleration: tuple[Signal, Signal] = (0.0, 0.0)
    #: How the motion begins: assembled from the placements, or from the static equilibrium.
    start: Start = field(default_factory=Assembled)
    #: Times at which a force, gravity or a prescribed motion jumps, or a derivative of it [s],
    #: beside the :attr:`Motion.jumps`; :class:`RadauIIA` ends steps there.
    jumps: Sequence[float] = ()

    def __post_init__(self) -> None:
        """Check the numbers."""
        for what in ("gravity", "ground_acceleration"):
            given = getattr(self, what)
            if len(given) != 2:
                raise ValueError(f"{what} must have two components, but it has {len(given)}")
            numbers = [g for g in given if not (callable(g) or isinstance(g, Motion))]
            if not np.all(np.isfinite(np.asarray(numbers, dtype=float))):
                raise ValueError(f"{what} holds NaN or infinity: {given}")
        if not np.all(np.isfinite(np.asarray(self.jumps, dtype=float))):
            raise ValueError(f"jumps hold NaN or infinity: {self.jumps}")
        for name, placement in self.placements.items():
            numbers = [*placement.position, placement.angle, *placement.velocity]
            if not np.all(np.isfinite((*numbers, placement.angular_velocity))):
                raise ValueError(f"placement of body {name!r} holds NaN or infinity")
        for point in self.point_masses:
            if not (math.isfinite(point.mass) and point.mass > 0.0):
                raise ValueError(
                    f"point mass at {marker_name(point.marker)}: the mass must be positive, "
                    f"but it is {point.mass} kg"
                )
        for name, d in self.damping.items():
            if not (math.isfinite(d.alpha + d.beta) and d.alpha >= 0.0 and d.beta >= 0.0):
                raise ValueError(
                    f"damping of body {name!r}: the coefficients must not be negative, "
                    f"but they are {d.alpha} and {d.beta}"
                )
        if not isinstance(self.start, Assembled | StaticEquilibrium):
            raise ValueError(
                f"start must be Assembled(...) or StaticEquilibrium(), not {self.start!r}"
            )
        for joint, label in zip(self.joints, self.joint_names, strict=True):
            joint.validate(label)
        for force, label in zip(self.forces, self.force_names, strict=True):
            force.validate(label)

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints; names made from the markers are numbered where they repeat.

        Raises:
            ValueError: If two joints have been given the same name.
        """
        return _names(self.joints, "joints")

    @property
    def force_names(self) -> list[str]:
        """Names of the forces; names made from the markers are numbered where they repeat.

        Raises:
            ValueError: If two forces have been given the same name.
        """
        return _names(self.forces, "forces")


def _names(things: Sequence[Joint] | Sequence[AppliedForce], what: str) -> list[str]:
    names: list[str] = []
    for thing in things:
        label, count = thing.label, 1
        while label in names:
            if getattr(thing, "name", ""):
                raise ValueError(f"two {what} have the name {label!r}")
            count += 1
            label = f"{thing.label} #{count}"
        names.append(label)
    return names
