# SPDX-License-Identifier: MIT
"""Wherever a machine stands, it moves the same: round-off is that of lengths, not of places."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest
from shared.scenes import SCENES
from shared.spatial_scenes import IN_SPACE

import dolfinx_ffr as ffr

#: The motions in space are none that anyone would want.
pytestmark = [
    pytest.mark.filterwarnings(f"ignore::dolfinx_ffr.dynamics.{name}Warning")
    for name in ("LargeDeformation", "Softening", "TiltedAxis", "TimeStep")
]


def moved(thing: Any, shift: np.ndarray) -> Any:
    """A mechanism, or a part of it, at another place."""
    if isinstance(thing, ffr.Ground | ffr.Placement):
        # the ground's origin stands for that of space, too
        position = np.append(thing.position, np.zeros(len(shift) - len(thing.position)))
        return replace(thing, position=tuple(position + shift))
    if isinstance(thing, ffr.Moving):
        names = "xy" if thing.z is None else "xyz"
        coordinates = {name: getattr(thing, name) + shift["xyz".index(name)] for name in names}
        return replace(thing, **coordinates)
    if isinstance(thing, ffr.PrescribedPosition):
        return replace(thing, motion=thing.motion + shift["xyz".index(thing.axis)])
    if isinstance(thing, dict):
        return {name: moved(part, shift) for name, part in thing.items()}
    if isinstance(thing, tuple | list):
        return type(thing)(moved(part, shift) for part in thing)
    if not is_dataclass(thing) or isinstance(thing, ffr.Motion | type):
        return thing
    return replace(thing, **{f.name: moved(getattr(thing, f.name), shift) for f in fields(thing)})


@pytest.mark.parametrize("distance", [0.0, 1e-3, 1.0, 1e3])
@pytest.mark.parametrize("name", [*SCENES, *IN_SPACE])
def test_a_machine_at_another_place(name: str, distance: float) -> None:
    """It moves the same, to the round-off of coordinates in a few steps."""
    scene = SCENES[name]() if name in SCENES else IN_SPACE[name]()
    bodies = scene.bodies
    dimension = next(iter(bodies.values())).dimension
    shift = distance * np.random.default_rng(0).uniform(-1.0, 1.0, dimension)
    elsewhere = moved(scene.mechanism, shift)
    for method in (ffr.GeneralizedAlpha(0.01, 10), ffr.RadauIIA(0.01, steps=5)):
        here, there = (
            ffr.simulate(mechanism, bodies, method) for mechanism in (scene.mechanism, elsewhere)
        )
        for body in bodies:
            displacement = there.rigid(body) - here.rigid(body)
            displacement[:, :dimension] -= shift
            assert np.max(np.abs(displacement)) < 1e-11 * (1.0 + distance)


@pytest.mark.parametrize("place", [0.0, 1e-3, 1.0, 1e3])
def test_a_boom_on_a_strut(place: float) -> None:
    """Whose coordinates are zero at the origin, and whose strut has a length with round-off."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        length, (x, y) = rng.uniform(0.2, 1.5), rng.uniform(-1.0, 1.0, 2)
        end_time, eye = 10.0 ** rng.uniform(-2.0, 1.0), length * rng.uniform(0.2, 1.0)
        ends = {"pin": (0.0, 0.0), "eye": (eye, 0.0)}
        boom = ffr.VolumeIntegrals.rigid(5.0, (0.5 * length, 0.0), 2.0, ends)
        joints = [
            ffr.Revolute(("boom", "pin"), ffr.Ground((place, place))),
            ffr.Distance(("boom", "eye"), ffr.Ground((place + x, place + y)), name="strut"),
        ]
        placements = {"boom": ffr.Placement((place, place))}
        mechanism = ffr.Mechanism(placements, joints, gravity=(0.0, -9.81))
        for method in (ffr.RadauIIA(end_time, steps=22), ffr.GeneralizedAlpha(end_time, 100)):
            motion = ffr.simulate(mechanism, {"boom": boom}, method)
            force = np.abs(motion.joint_force("strut"))
            assert np.ptp(force) <= 1e-6 * np.max(force)
