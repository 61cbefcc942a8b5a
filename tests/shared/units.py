# SPDX-License-Identifier: MIT
"""Scenes in other units: every quantity of a scene, with its dimension, stands in one table."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

import dolfinx_ffr as ffr
from shared.scenes import Scene

#: Powers of kilogram, metre and second.
Powers = tuple[int, int, int]

LENGTH, TIME, MASS, NUMBER = (0, 1, 0), (0, 0, 1), (1, 0, 0), (0, 0, 0)
SPEED, RATE, ACCELERATION = (0, 1, -1), (0, 0, -1), (0, 1, -2)
FORCE, MOMENT = (1, 1, -2), (1, 2, -2)
COMPLIANCE = (1, 2, -1)

#: Dimensions of what is not a number without unit, a name or a marker, by class and field.
DIMENSIONS: Mapping[type, Mapping[str, Powers]] = {
    ffr.Ground: {"position": LENGTH},
    ffr.Moving: {"x": LENGTH, "y": LENGTH, "angle": NUMBER},
    ffr.Placement: {"position": LENGTH, "velocity": SPEED, "angular_velocity": RATE},
    ffr.PointMass: {"mass": MASS},
    ffr.RayleighDamping: {"alpha": RATE, "beta": TIME},
    ffr.Mechanism: {"gravity": ACCELERATION, "ground_acceleration": ACCELERATION, "jumps": TIME},
    ffr.Distance: {"length": LENGTH},
    ffr.PrescribedAngle: {"motion": NUMBER},
    ffr.PrescribedPosition: {"motion": LENGTH},
    ffr.Force: {"x": FORCE, "y": FORCE},
    ffr.Torque: {"moment": MOMENT},
    ffr.SpringDamper: {"stiffness": (1, 0, -2), "damping": (1, 0, -1), "length": LENGTH},
    ffr.TorsionalSpringDamper: {"stiffness": MOMENT, "damping": (1, 2, -1), "angle": NUMBER},
    ffr.GeneralizedAlpha: {"end_time": TIME},
    ffr.RadauIIA: {"end_time": TIME},
    ffr.BodyMarker: {"position": LENGTH, "rotation": (0, -1, 0), "stiffening": (0, -1, 0)},
}


@dataclass(frozen=True)
class Units:
    """A system of units, each in SI: ``Units(m=1e-3)`` counts in millimetres."""

    kg: float = 1.0
    m: float = 1.0
    s: float = 1.0

    def factor(self, powers: Powers) -> float:
        """What a number in SI is multiplied by."""
        return float(self.kg ** -powers[0] * self.m ** -powers[1] * self.s ** -powers[2])

    def quantity(self, value: Any, powers: Powers) -> Any:
        """A number, an array, a tuple of these, a function of time or a motion in these units."""
        factor = self.factor(powers)

        def of_time(function: Callable[..., Any], rate: int = 0) -> Callable[..., Any]:
            size = factor * self.s**rate
            return lambda t: size * np.asarray(function(np.asarray(t) * self.s))

        if isinstance(value, ffr.Motion):
            parts = (value.value, value.velocity, value.acceleration)
            functions = [of_time(part, rate) for rate, part in enumerate(parts)]
            return ffr.Motion(*functions, value.name, tuple(t / self.s for t in value.jumps))
        if isinstance(value, tuple | list):
            return tuple(self.quantity(part, powers) for part in value)
        if callable(value):
            return of_time(value)
        return value if value is None else factor * value

    def body(self, body: ffr.VolumeIntegrals) -> ffr.VolumeIntegrals:
        """A body whose elastic coordinates are lengths; derivatives with respect to it go back."""
        kg, m, s = (self.factor(powers) for powers in (MASS, LENGTH, TIME))
        length = np.ones(body.modes + 1)
        length[0] = m
        loads = {"omega2": kg, "alpha": kg, "acceleration": kg / m}
        return ffr.VolumeIntegrals(
            kg * body.mass,
            kg * length[:, None] * body.S,
            kg * np.outer(length, length) * body.G,
            kg * np.outer(length, length) * body.N,
            kg / s**2 * body.K,
            {name: self.of(marker) for name, marker in body.markers.items()},
            {load: loads[load] * array for load, array in body.stiffening.items()},
        )

    def of(self, thing: Any) -> Any:
        """A scene, or a part of it, in these units."""
        if isinstance(thing, ffr.VolumeIntegrals):
            return self.body(thing)
        if isinstance(thing, dict):
            return {name: self.of(part) for name, part in thing.items()}
        if isinstance(thing, tuple | list):
            return type(thing)(self.of(part) for part in thing)
        if not is_dataclass(thing) or isinstance(thing, ffr.Motion | type):
            return thing
        dimensions = DIMENSIONS.get(type(thing), {})
        parts = {field.name: getattr(thing, field.name) for field in fields(thing)}
        return replace(
            thing,
            **{
                name: self.quantity(part, dimensions[name]) if name in dimensions else self.of(part)
                for name, part in parts.items()
            },
        )

    def scene(self, scene: Scene) -> Scene:
        """A scene in these units."""
        converted = self.of(scene)
        assert isinstance(converted, Scene)
        return converted


#: Systems in which results must be the same: each base unit small, usual and large, and mixed.
SYSTEMS = (
    *(Units(**{unit: size}) for unit in ("kg", "m", "s") for size in (1e-9, 1e-3, 1e9)),
    Units(kg=1e-9, m=1e9, s=1e-9),
    Units(kg=1e9, m=1e-9, s=1e9),
    Units(kg=1e-3, m=1e-6, s=1e-3),
)
