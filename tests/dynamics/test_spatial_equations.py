# SPDX-License-Identifier: MIT
"""Equations of motion in space at one instant: derivatives against differences, transposes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.spatial_bodies import cloud, stiffened_cloud

from dolfinx_ffr.body import VolumeIntegrals
from dolfinx_ffr.dynamics.equations import (
    ACCELERATIONS,
    BODY_FORCES,
    CONSTRAINTS,
    CORRECTIONS,
    FORCES,
    OTHER_FORCES,
    ROWS,
    TANGENT,
)
from dolfinx_ffr.dynamics.kinematics import Kinematics, settled
from dolfinx_ffr.dynamics.model import FlatModel, assemble_model
from dolfinx_ffr.mechanism import (
    Bushing,
    Cylindrical,
    Distance,
    Force,
    Gear,
    Ground,
    Joint,
    Mechanism,
    Motion,
    Moving,
    Placement,
    Planar,
    PointOnLine,
    PointOnPlane,
    PrescribedAngle,
    RayleighDamping,
    Revolute,
    Spherical,
    SpringDamper,
    Torque,
    TorsionalSpringDamper,
    Translational,
    Universal,
    Weld,
)
from dolfinx_ffr.mechanism.forces import AppliedForce

Array = NDArray[np.float64]

ONE, TWO, ROOT = ("one", "tip"), ("two", "root"), ("one", "root")
CRANK = Moving.circle(
    (0.1, 0.2, 0.3), 0.2, Motion.polynomial([0.1, 2.0, 3.0]), axis=(1.0, 1.0, 0.2)
)
JOINTS: list[Joint] = [
    Spherical(ONE, TWO),
    Revolute(ONE, CRANK, axis=(0.3, 1.0, 0.2)),
    Universal(ONE, TWO, (0.2, 1.0, 0.0), (0.0, 0.1, 1.0)),
    Cylindrical(TWO, ONE, (1.0, 0.2, 0.1)),
    Translational(TWO, ONE, (1.0, 0.2, 0.1)),
    Planar(TWO, Ground((0.0, 0.0, 0.1)), (0.2, 0.2, 1.0)),
    Weld(ROOT, TWO),
    PointOnLine(TWO, ONE),
    PointOnPlane(ROOT, CRANK),
    Distance(ONE, TWO, Motion.polynomial([0.7, 0.2, 0.1])),
    PrescribedAngle(TWO, Motion.polynomial([0.1, 0.3, -0.4]), ONE, axis=(0.1, 0.0, 1.0)),
    Gear(ONE, TWO, -1.7, axis=(0.0, 0.2, 1.0), second_axis=(1.0, 0.0, 0.1)),
]
FORCES_OF_ALL_KINDS: list[AppliedForce] = [
    Force(ONE, 1.0, -2.0, z=0.5),
    Force(TWO, 1.0, -2.0, follower=True, z=0.5, name="follower"),
    Torque(ONE, (0.3, 0.2, -0.4)),
    Torque(TWO, (0.3, 0.2, -0.4), follower=True, name="turning"),
    SpringDamper(ONE, TWO, 30.0, 4.0, 0.2),
    SpringDamper(ONE, CRANK, 20.0, 3.0, 0.0),
    TorsionalSpringDamper(ONE, TWO, 5.0, 0.7, 0.1, axis=(0.1, 0.0, 1.0)),
    Bushing(ROOT, TWO, (3.0, 4.0, 5.0), (1.0, 0.5, 0.2), (3.0, 2.0, 1.0), (0.1, 0.2, 0.3)),
]


def scene(stiffened: bool = False) -> FlatModel:
    """Two flexible bodies with all joints and forces at once, which need not hold."""
    make = stiffened_cloud if stiffened else cloud
    bodies: dict[str, VolumeIntegrals] = {"one": make(3, 1), "two": make(2, 2)}
    mechanism = Mechanism(
        {
            "one": Placement((0.0, 0.1, 0.0), rotation=(0.3, -0.2, 0.5)),
            "two": Placement((0.5, 0.1, 0.2), rotation=(-0.1, 0.4, 0.2)),
        },
        joints=JOINTS,
        forces=FORCES_OF_ALL_KINDS,
        gravity=(1.0, -3.0, 9.0),
        damping={"one": RayleighDamping(0.3, 0.01)},
    )
    return assemble_model(mechanism, bodies, np.linspace(0.0, 1.0, 3))


def random_state(model: FlatModel, seed: int = 0) -> tuple[Array, Array, Array, Array]:
    rng = np.random.default_rng(seed)
    y, v, w = 0.5 * rng.standard_normal((3, model.size))
    for name in model.bodies:
        y[model.coordinates(name).elastic] *= 0.2
    return y, v, w, rng.standard_normal(model.rows)


def difference(function: Callable[[float], Array], step: float = 2e-3) -> Array:
    """Sixth-order difference at zero."""
    weights = {1: 0.75, 2: -0.15, 3: 1.0 / 60.0}
    total = sum(f * (function(k * step) - function(-k * step)) for k, f in weights.items())
    return np.asarray(total / step)


@pytest.fixture(scope="module", params=[False, True], ids=["plain", "stiffened"])
def model(request: pytest.FixtureRequest) -> FlatModel:
    return scene(request.param)


def evaluated(
    model: FlatModel, y: Array, base: Array, v: Array, w: Array, lam: Array
) -> Kinematics:
    kinematics = Kinematics(model.arrays)
    kinematics.set(y, v, w, lam)
    kinematics.equations.base[:] = base
    kinematics.evaluate(1, CONSTRAINTS | FORCES | TANGENT | CORRECTIONS | ACCELERATIONS)
    return kinematics


def test_jacobians_are_derivatives(model: FlatModel) -> None:
    """Also away from the beginning of a step, where coordinates are those of the chart."""
    rng = np.random.default_rng(3)
    base, v, w, lam = random_state(model)
    y = base + 0.4 * rng.standard_normal(model.size) * model.rotations
    dy, dv, dw = rng.standard_normal((3, model.size))
    eq = evaluated(model, y, base, v, w, lam).equations

    def forces(step: float, by: str) -> Array:
        moved = (y + step * dy, v) if by == "y" else (y, v + step * dv)
        other = evaluated(model, moved[0], base, moved[1], w, lam).equations
        return np.concatenate([other.r + other.C.T @ lam, other.value, other.rate])

    n, rows = model.size, model.rows
    by_y = difference(lambda step: forces(step, "y"))
    by_v = difference(lambda step: forces(step, "v"))
    scale = np.max(np.abs(by_y))
    np.testing.assert_allclose(eq.Ky @ dy, by_y[:n], atol=1e-9 * scale)
    np.testing.assert_allclose(eq.Cy @ dy, by_y[n : n + rows], atol=1e-9)
    np.testing.assert_allclose(eq.D @ dy, by_y[n + rows :], atol=1e-8)
    np.testing.assert_allclose(eq.C @ dv, by_v[n + rows :], atol=1e-9)
    np.testing.assert_allclose(by_v[n : n + rows], 0.0, atol=1e-10)
    # M = r_w + cv r_v with cv = 1
    mass = difference(lambda step: _along(model, (y, base, v, w, lam), dw, step))
    np.testing.assert_allclose(eq.M @ dw, mass, atol=1e-9 * scale)


def _along(model: FlatModel, state: tuple[Array, ...], direction: Array, step: float) -> Array:
    """Forces with accelerations and velocities both moved."""
    y, base, v, w, lam = state
    moved = evaluated(model, y, base, v + step * direction, w + step * direction, lam)
    return moved.equations.r.copy()


def test_rate_and_acceleration_are_derivatives_in_time(model: FlatModel) -> None:
    y, v, w, lam = random_state(model)
    tables = model.tables
    eq = evaluated(model, y, y, v, w, lam).equations
    t = model.times[1]

    def rows(step: float) -> Array:
        # y(t) to third order: its chart at y has T = 1 - [u] / 2 + ...
        u = step * v + 0.5 * step**2 * w
        arrays = model.arrays._replace(**tables.tabulate(np.array([t + step, t + step])))
        other = Kinematics(arrays)
        other.set(settled(model.arrays, y, y + u), v + step * w)
        other.evaluate(0, CONSTRAINTS)
        return np.concatenate([other.equations.value, other.equations.rate])

    n, h = model.rows, 1e-4
    first = (rows(h) - rows(-h)) / (2.0 * h)
    np.testing.assert_allclose(first[:n], eq.rate, atol=1e-6)
    np.testing.assert_allclose(first[n:], eq.acceleration, atol=1e-5)


def test_transpose_belongs_to_the_derivatives(model: FlatModel) -> None:
    """y_bar and v_bar are minus the derivatives of Q, see equations.py."""
    rng = np.random.default_rng(4)
    base, v, w, lam = random_state(model)
    y = base + 0.4 * rng.standard_normal(model.size) * model.rotations
    x, m2, m3, m4 = (rng.standard_normal(k) for k in (model.size, *[model.rows] * 3))
    kinematics = evaluated(model, y, base, v, w, lam)
    eq = kinematics.equations
    eq.adjoint[:], eq.on_values[:], eq.on_rates[:], eq.on_accelerations[:] = x, m2, m3, m4
    kinematics.pullback(1, BODY_FORCES | OTHER_FORCES | ROWS)
    dy, dv = rng.standard_normal((2, model.size))

    def Q(step: float, by: str) -> Array:
        moved = (y + step * dy, v) if by == "y" else (y, v + step * dv)
        other = evaluated(model, moved[0], base, moved[1], w, lam).equations
        total = x @ (other.r + other.C.T @ lam) + m2 @ other.value + m3 @ other.rate
        return np.array(total + m4 @ other.acceleration)

    scale = np.linalg.norm(eq.y_bar) * np.linalg.norm(dy)
    assert abs(difference(lambda s: Q(s, "y")) + eq.y_bar @ dy) < 1e-9 * scale
    assert abs(difference(lambda s: Q(s, "v")) + eq.v_bar @ dv) < 1e-9 * scale
