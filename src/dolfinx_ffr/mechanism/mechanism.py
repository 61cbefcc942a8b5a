# SPDX-License-Identifier: MIT
"""Description of a mechanism: placements, joints, forces, point masses, gravity, damping.

A mechanism says how bodies are put together; the bodies themselves come as volume integrals, so
one mechanism serves all designs. Joints and forces act between markers (:mod:`.marker`); their
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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

from .. import validation
from .connection import Connection
from .forces import AppliedForce
from .initial_conditions import Assembled, Placement, Start
from .joints import Joint
from .marker import BodyPoint, check_marker, marker_name
from .motion import Signal, check_signal


@dataclass(frozen=True)
class PointMass:
    """A point mass fixed to a marker of a body.

    Attributes:
        marker: Name of the body and name of the marker.
        mass: Mass [kg].
    """

    marker: BodyPoint
    mass: float


@dataclass(frozen=True)
class RayleighDamping:
    """Damping of the elastic coordinates, alpha times their mass plus beta times the stiffness.

    Attributes:
        alpha: Mass-proportional coefficient [1/s].
        beta: Stiffness-proportional coefficient [s].
    """

    alpha: float = 0.0
    beta: float = 0.0


@dataclass(frozen=True)
class Mechanism:
    """A mechanism, in the plane or in space, as its bodies are.

    Raises:
        ValueError: If a number is out of range, a joint lacks a body, or a name stands twice.

    Attributes:
        placements: Start of every body, by name of the body.
        joints: Joints, in the order of their rows in the multipliers.
        point_masses: Point masses.
        gravity: Acceleration of free fall [m/s^2], for instance (0, -9.81), of three components in
            space; numbers or functions of time.
        damping: Damping, by name of the body.
        forces: Forces, springs and dampers.
        ground_acceleration: Acceleration of the ground [m/s^2], likewise. All positions are then
            relative to the moving ground, on which the bodies feel the opposite acceleration.
        start: How the motion begins: assembled from the placements, or from the static equilibrium.
        jumps: Times at which a force, gravity or a prescribed motion jumps, or a derivative of it
            [s], beside the :attr:`Motion.jumps`; :class:`RadauIIA` ends steps there.
    """

    placements: Mapping[str, Placement]
    joints: Sequence[Joint] = ()
    point_masses: Sequence[PointMass] = ()
    gravity: tuple[Signal, ...] = (0.0, 0.0)
    damping: Mapping[str, RayleighDamping] = field(default_factory=dict)
    forces: Sequence[AppliedForce] = ()
    ground_acceleration: tuple[Signal, ...] = (0.0, 0.0)
    start: Start = field(default_factory=Assembled)
    jumps: Sequence[float] = ()

    # Of a `ParametricMechanism`: the mechanism at other parameter values that are all different,
    # and the volume integrals of bodies that depend on parameters.
    twin: ClassVar[Mechanism | None] = None
    own_bodies: ClassVar[Mapping[str, Any]] = {}

    def __post_init__(self) -> None:
        for name in ("gravity", "ground_acceleration"):
            components = validation.listed(name, getattr(self, name), "a pair")
            if len(components) not in (2, 3):
                raise ValueError(
                    f"{name} must have two components, in space three, but it has {len(components)}"
                )
            for axis, signal in zip("xyz", components, strict=False):
                check_signal(f"{name} along {axis}", signal)
            object.__setattr__(self, name, tuple(components))
        validation.real_array("jumps", self.jumps, (None,))
        placements = validation.instances_by_name(
            "placements", self.placements, Placement, "Placement(...)"
        )
        for name, placement in placements.items():
            placement.validate(f"placement of body {name!r}")
        point_masses = validation.instances(
            "point_masses", self.point_masses, PointMass, "point masses"
        )
        for point in point_masses:
            check_marker("point mass", point.marker)
            label = f"point mass at {marker_name(point.marker)}: the mass"
            validation.number(label, point.mass, above=0.0, unit="kg")
        damping = validation.instances_by_name(
            "damping", self.damping, RayleighDamping, "RayleighDamping(...)"
        )
        for name, coefficients in damping.items():
            for coefficient in ("alpha", "beta"):
                label = f"damping of body {name!r}: {coefficient}"
                validation.number(label, getattr(coefficients, coefficient), least=0.0)
        validation.instance("start", self.start, Start, "Assembled(...) or StaticEquilibrium()")
        joints = validation.instances("joints", self.joints, Joint, "joints, as Revolute(...)")
        forces = validation.instances("forces", self.forces, AppliedForce, "forces, as Force(...)")
        object.__setattr__(self, "joints", joints)
        object.__setattr__(self, "forces", forces)
        object.__setattr__(self, "point_masses", point_masses)
        for connection, label in self.connections:
            connection.validate(label)

    @property
    def connections(self) -> list[tuple[Connection, str]]:
        """All joints and forces, each with its name."""
        connections: tuple[Connection, ...] = (*self.joints, *self.forces)
        return list(zip(connections, [*self.joint_names, *self.force_names], strict=True))

    @cached_property
    def joint_names(self) -> list[str]:
        """Names of the joints; names made from the markers are numbered where they repeat."""
        return _names(self.joints, "joints")

    @cached_property
    def force_names(self) -> list[str]:
        """Names of the forces; names made from the markers are numbered where they repeat."""
        return _names(self.forces, "forces")


def _names(connections: Sequence[Connection], kind: str) -> list[str]:
    """Names of all joints or all forces; a ValueError if a given name stands twice."""
    names: list[str] = []
    for connection in connections:
        label, count = connection.label, 1
        while label in names:
            if getattr(connection, "name", ""):
                raise ValueError(f"two {kind} have the name {label!r}")
            count += 1
            label = f"{connection.label} #{count}"
        names.append(label)
    return names
