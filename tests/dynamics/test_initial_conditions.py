# SPDX-License-Identifier: MIT
"""Start of the motion: given deformation, static equilibrium, and their share of the gradient."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.beams import beam
from shared.scenes import (
    Bodies,
    Scene,
    four_bar,
    loader,
    moved,
    random_direction,
    robot,
    slider_crank,
)

from dolfinx_ffr.body.volume_integrals import VolumeIntegrals
from dolfinx_ffr.dynamics import (
    GeneralizedAlpha,
    Trajectory,
    TrajectoryBar,
    adjoint,
    assemble_model,
    initial_state,
    simulate,
)
from dolfinx_ffr.dynamics.kinematics import evaluate_equations
from dolfinx_ffr.mechanism import Mechanism, Placement
from dolfinx_ffr.mechanism.forces import Force, SpringDamper, Torque, TorsionalSpringDamper
from dolfinx_ffr.mechanism.initial_conditions import Assembled, Start, StaticEquilibrium
from dolfinx_ffr.mechanism.joints import PointOnLine, PrescribedAngle, Revolute, Weld
from dolfinx_ffr.mechanism.marker import Ground
from dolfinx_ffr.mechanism.motion import Motion
from dolfinx_ffr.verification import assert_taylor_order, central_difference, taylor_test

Array = NDArray[np.float64]

TIMES = np.linspace(0.0, 1.0, 11)


def state(mechanism: Mechanism, bodies: Bodies) -> tuple[Array, Array]:
    return initial_state(assemble_model(mechanism, bodies, TIMES))


def started(scene: Scene, start: Start) -> Scene:
    return replace(scene, mechanism=replace(scene.mechanism, start=start))


def random_elastic(scene: Scene, size: float) -> Assembled:
    rng = np.random.default_rng(0)
    parts = []
    for rate in (1.0, 30.0):
        part = {
            name: size * rate * rng.uniform(-1.0, 1.0, body.modes) / np.arange(1, body.modes + 1)
            for name, body in scene.bodies.items()
            if body.modes
        }
        parts.append(part)
    return Assembled(*parts)


# --- Given deformation ---------------------------------------------------------------------------


@pytest.mark.parametrize("make", [slider_crank, four_bar, robot, loader])
def test_given_deformation_is_kept_and_the_joints_close(make: Callable[[], Scene]) -> None:
    scene = make()
    start = random_elastic(scene, 2e-4)
    mechanism = replace(scene.mechanism, start=start)
    model = assemble_model(mechanism, scene.bodies, TIMES)
    y, v = initial_state(model)
    for name, q in start.elastic.items():
        where = model.coordinates(name).elastic
        np.testing.assert_array_equal(y[where], q)
        np.testing.assert_array_equal(v[where], start.elastic_velocity[name])
    zero = np.zeros(model.size), np.zeros(model.rows)
    gaps = evaluate_equations(model.arrays, 0, y, v, *zero)[0][model.size :]
    assert np.max(np.abs(gaps[: model.rows])) < 1e-14
    assert np.max(np.abs(gaps[model.rows :])) < 1e-14 * max(1.0, float(np.max(np.abs(v))))
    # The accelerations fit too: moved along them, the velocities leave the joints by order two.
    drifts = []
    for h in (1e-3, 5e-4):
        t = simulate(mechanism, scene.bodies, GeneralizedAlpha(h, 1))
        near = t.y[0] + h * t.v[0] + 0.5 * h**2 * t.w[0], t.v[0] + h * t.w[0]
        gaps = evaluate_equations(t.model.arrays, 1, *near, *zero)[0][model.size :]
        drifts.append(np.linalg.norm(gaps[model.rows :]))
    assert drifts[0] / drifts[1] > 3.5


def test_released_beam_swings_in_its_first_mode() -> None:
    """A clamped beam let go in the shape of its first mode: q = q_0 cos(omega t)."""
    body = beam(0.4, 0.01, 0.01, elements=8, modes=3, frame="tangent")
    q0, errors, steps = 1e-3, [], np.array([200, 400, 800])
    omega = math.sqrt(body.K[0, 0] / body.G[1, 1])
    mechanism = Mechanism(
        {"beam": Placement((0.2, 0.0))},
        [Weld(("beam", "left"), Ground())],
        start=Assembled({"beam": [q0, 0.0, 0.0]}, {"beam": [0.5 * omega * q0, 0.0, 0.0]}),
    )
    for count in steps:
        t = simulate(mechanism, {"beam": body}, GeneralizedAlpha(4.0 * math.pi / omega, int(count)))
        exact = q0 * (np.cos(omega * t.t) + 0.5 * np.sin(omega * t.t))
        errors.append(float(np.max(np.abs(t.elastic("beam")[:, 0] - exact)) / q0))
    assert errors[-1] < 1e-2
    assert np.polyfit(np.log(1.0 / steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.1)


# --- Equilibrium: closed forms -------------------------------------------------------------------


def test_cantilever_under_load_bends_as_its_stiffness_says() -> None:
    body = beam(0.4, 0.01, 0.01, elements=8, modes=5, frame="tangent")
    mechanism = Mechanism(
        {"beam": Placement((0.2, 0.0))},
        [Weld(("beam", "left"), Ground(), name="clamp")],
        gravity=(0.0, -9.81),
        forces=[Force(("beam", "right"), 2.0, -5.0), Torque(("beam", "middle"), 0.3)],
        start=StaticEquilibrium(),
    )
    y, v = state(mechanism, {"beam": body})
    tip, middle = body.markers["right"], body.markers["middle"]
    load = tip.displacement.T @ [2.0, -5.0] + 0.3 * middle.rotation - 9.81 * body.S[1:, 1]
    np.testing.assert_allclose(y[3:], np.linalg.solve(body.K, load), rtol=1e-11, atol=1e-18)
    np.testing.assert_array_equal(v, 0.0)
    # Nothing moves, and the clamp carries the load in its deformed place.
    t = simulate(mechanism, {"beam": body}, GeneralizedAlpha(0.1, 20))
    np.testing.assert_allclose(t.y, np.tile(y, (21, 1)), atol=1e-13)
    force = t.joint_force("clamp")
    np.testing.assert_allclose(force[:, 0], -2.0, rtol=1e-9)
    np.testing.assert_allclose(force[:, 1], 5.0 + 9.81 * body.mass, rtol=1e-9)
    at = np.array([0.4, 0.0]) + tip.displacement @ y[3:]
    weight = 9.81 * (0.2 * body.mass + body.S[1:, 0] @ y[3:])
    moment = -(at[0] * -5.0 - at[1] * 2.0) - 0.3 + weight
    np.testing.assert_allclose(force[:, 2], moment, rtol=1e-9)


def test_tip_of_a_cantilever_sinks_by_the_beam_formula() -> None:
    # P L^3 / (3 E I); the modes that are left out hold 3 per cent with one, and less with more.
    exact = 5.0 * 0.4**3 / (3.0 * 2.1e11 * 0.01**4 / 12.0)
    errors = []
    for modes in (1, 3, 8):
        body = beam(0.4, 0.01, 0.01, elements=12, modes=modes, frame="tangent")
        mechanism = Mechanism(
            {"beam": Placement((0.2, 0.0))},
            [Weld(("beam", "left"), Ground())],
            forces=[Force(("beam", "right"), 0.0, -5.0)],
            start=StaticEquilibrium(),
        )
        t = simulate(mechanism, {"beam": body}, GeneralizedAlpha(0.1, 1))
        errors.append(abs(t.marker_path("beam", "right")[0, 1] / -exact - 1.0))
    assert errors[0] < 0.03
    assert errors[2] < 1e-3
    assert errors[0] > errors[1] > errors[2]


@pytest.mark.parametrize("angle", [0.0, 1.4, -1.5, 3.0])
def test_pendulum_comes_to_hang(angle: float) -> None:
    body = VolumeIntegrals.rigid(1.0, (0.0, 0.0), 0.1, {"left": (-0.5, 0.0)})
    mechanism = Mechanism(
        {"bar": Placement((0.5 * math.cos(angle), 0.5 * math.sin(angle)), angle)},
        [Revolute(("bar", "left"), Ground())],
        gravity=(0.0, -9.81),
        start=StaticEquilibrium(),
    )
    y, _ = state(mechanism, {"bar": body})
    np.testing.assert_allclose(y[:2], [0.0, -0.5], atol=1e-12)
    assert math.cos(y[2]) == pytest.approx(0.0, abs=1e-12)


def test_body_hangs_on_a_spring() -> None:
    body = VolumeIntegrals.rigid(2.0, (0.0, 0.0), 0.1, {"hook": (0.0, 0.1)})
    mechanism = Mechanism(
        {"body": Placement((0.05, -0.8), 0.3)},
        forces=[SpringDamper(("body", "hook"), Ground(), 100.0, 7.0, 0.5)],
        gravity=(0.0, -9.81),
        start=StaticEquilibrium(),
    )
    y, _ = state(mechanism, {"body": body})
    np.testing.assert_allclose(y, [0.0, -0.1 - 0.5 - 2.0 * 9.81 / 100.0, 0.0], atol=1e-12)


def test_velocities_of_the_drive_start_from_the_equilibrium() -> None:
    body = beam(0.4, 0.01, 0.01, elements=8, modes=3, frame="tangent")
    mechanism = Mechanism(
        {"beam": Placement((0.2, 0.0))},
        [
            Revolute(("beam", "left"), Ground(), name="hub"),
            PrescribedAngle(("beam", "left"), Motion.polynomial([0.0, 3.0]), name="drive"),
        ],
        gravity=(0.0, -9.81),
        start=StaticEquilibrium(),
    )
    t = simulate(mechanism, {"beam": body}, GeneralizedAlpha(0.01, 10))
    q = np.linalg.solve(body.K, -9.81 * body.S[1:, 1])
    np.testing.assert_allclose(t.elastic("beam")[0], q, rtol=1e-11, atol=1e-18)
    np.testing.assert_allclose(t.v[0], [0.0, 0.6, 3.0, 0.0, 0.0, 0.0], atol=1e-12)
    # The accelerations at the start fit the constraint: the hub does not move.
    hub = t.w[0, :2] + np.array([0.2 * 9.0, 0.0])
    np.testing.assert_allclose(hub, 0.0, atol=1e-10)


def test_beam_clamped_at_both_ends_is_closed_by_bending() -> None:
    body = beam(0.4, 0.01, 0.01, elements=8, modes=6, frame="free")
    mechanism = Mechanism(
        {"beam": Placement((0.2, 0.0))},
        [
            Weld(("beam", "left"), Ground(), angle=0.0, name="clamp"),
            PointOnLine(("beam", "right"), Ground((0.0, 0.002)), name="support"),
        ],
        start=StaticEquilibrium(),
    )
    t = simulate(mechanism, {"beam": body}, GeneralizedAlpha(0.01, 5))
    assert np.max(np.abs(t.elastic("beam")[0])) > 1e-5
    np.testing.assert_allclose(t.marker_path("beam", "right")[:, 1], 0.002, atol=1e-14)
    np.testing.assert_allclose(t.y, np.tile(t.y[0], (6, 1)), atol=1e-12)


# --- Refused -------------------------------------------------------------------------------------


def bar() -> Bodies:
    return {"bar": VolumeIntegrals.rigid(1.0, (0, 0), 0.1, {"left": (-0.5, 0), "right": (0.5, 0)})}


@pytest.mark.parametrize(
    ("joints", "options", "message"),
    [
        ([], {"gravity": (0.0, -9.81)}, "no static equilibrium of its own: body 'bar' can move"),
        ([], {}, "body 'bar' can move without resistance; hold it by a joint, a drive or a spring"),
        (
            [Revolute(("bar", "left"), Ground())],
            {},
            "body 'bar' can move without resistance; hold it by a joint",
        ),
        (
            [Revolute(("bar", "left"), Ground())],
            {"forces": [Torque(("bar", "right"), 1.0)]},
            "no static equilibrium .* body 'bar' (can move without resistance|still moves)",
        ),
        (
            [Revolute(("bar", "left"), Ground())],
            {"forces": [Force(("bar", "right"), 0.0, 1.0, follower=True)]},
            "no static equilibrium .* body 'bar' (can move without resistance|still moves)",
        ),
        (
            [Revolute(("bar", "left"), Ground())],
            {
                "forces": [
                    Torque(("bar", "right"), 9.0),
                    TorsionalSpringDamper(("bar", "left"), Ground(), 0.0, 5.0),
                ],
                "gravity": (0.0, -9.81),
            },
            "no static equilibrium under gravity and the forces at t = 0 found: body 'bar' still",
        ),
        (
            [
                Revolute(("bar", "left"), Ground(), name="pin"),
                Revolute(("bar", "right"), Ground((2, 0)), name="far"),
            ],
            {},
            "1 of the 4 constraints is redundant",
        ),
    ],
)
def test_no_equilibrium(joints: list, options: dict, message: str) -> None:
    mechanism = Mechanism(
        {"bar": Placement((0.5, 0.0))}, joints, start=StaticEquilibrium(), **options
    )
    with pytest.raises(ValueError, match=message):
        state(mechanism, bar())


@pytest.mark.parametrize(
    ("start", "message"),
    [
        (Assembled({"bar": [1.0]}), r"elastic of body 'bar' must have shape \(0,\), but it has sh"),
        (Assembled({}, {"rod": []}), r"elastic_velocity of 'rod', but the bodies are \['bar'\]"),
    ],
)
def test_refused_when_assembled(start: Start, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        state(Mechanism({"bar": Placement()}, start=start), bar())


def test_refused_description() -> None:
    with pytest.raises(ValueError, match="start: elastic of body 'rod' holds NaN"):
        Assembled({"rod": [np.nan]})
    with pytest.raises(TypeError, match="start must be Assembled"):
        Mechanism({}, start="rest")  # type: ignore[arg-type]


def test_deformation_that_tears_a_joint_is_refused() -> None:
    body = beam(0.4, 0.01, 0.01, elements=8, modes=3, frame="free")
    mechanism = Mechanism(
        {"rod": Placement((0.2, 0.0))},
        [
            Weld(("rod", "left"), Ground(), name="clamp"),
            PointOnLine(("rod", "right"), Ground(), name="support"),
        ],
        start=Assembled({"rod": [0.01, 0.0, 0.0]}),
    )
    message = "cannot be assembled with the given elastic coordinates: joint '(clamp|support)'"
    with pytest.raises(ValueError, match=message):
        state(mechanism, {"rod": body})


# --- Gradient ------------------------------------------------------------------------------------


def hanging_loader(steps: int = 40) -> Scene:
    """The loader from its equilibrium, its cylinder and its shaft already in motion."""
    scene = loader(end_time=0.05, steps=steps)
    return started(scene, StaticEquilibrium())


def deformed(make: Callable[..., Scene], steps: int = 40) -> Scene:
    scene = make(end_time=0.05, steps=steps)
    return started(scene, random_elastic(scene, 1e-4))


GRADIENT_SCENES: dict[str, Callable[[], Scene]] = {
    "equilibrium": hanging_loader,
    "deformed loader": lambda: deformed(loader),
    "deformed robot": lambda: deformed(robot),
    "deformed slider-crank": lambda: deformed(slider_crank),
}


def weights(trajectory: Trajectory) -> TrajectoryBar:
    """A random sum of everything, the first instant at a hundredfold."""
    rng = np.random.default_rng(0)
    bar = TrajectoryBar.zeros(trajectory)
    for name in ("y", "v", "w", "multipliers"):
        values = getattr(trajectory, name)
        part = rng.uniform(-1.0, 1.0, values.shape) / values.size
        part /= np.maximum(np.sqrt(np.mean(values**2, axis=0)), 1e-9)
        part[0] *= 100.0
        getattr(bar, name)[:] = part
    return bar


def number(scene: Scene, bodies: Bodies, bar: TrajectoryBar) -> float:
    t = simulate(scene.mechanism, bodies, scene.integrator)
    names = ("y", "v", "w", "multipliers")
    return float(sum(np.sum(getattr(bar, name) * getattr(t, name)) for name in names))


@pytest.fixture(scope="module", params=list(GRADIENT_SCENES))
def case(request: pytest.FixtureRequest) -> tuple[Scene, TrajectoryBar, Bodies]:
    scene = GRADIENT_SCENES[request.param]()
    trajectory = simulate(scene.mechanism, scene.bodies, scene.integrator)
    bar = weights(trajectory)
    return scene, bar, adjoint(trajectory, bar)


@pytest.mark.parametrize("fields", ["m", "S", "G", "N", "K", "W", "P", "mSGNKWP"])
def test_gradient(case: tuple[Scene, TrajectoryBar, Bodies], fields: str) -> None:
    scene, bar, bars = case
    direction = random_direction(scene.bodies, 3, fields)
    slope = sum(bars[name].dot(direction[name]) for name in bars)

    def along(step: Array | float) -> float:
        return number(scene, moved(scene.bodies, direction, float(step)), bar)

    difference = central_difference(along, 0.0, 1.0, 3e-3)
    assert slope == pytest.approx(difference, rel=1e-6, abs=1e-9 * abs(along(0.0)))


@pytest.mark.parametrize("fields", ["W", "mSGNKWP"])
def test_taylor_order(case: tuple[Scene, TrajectoryBar, Bodies], fields: str) -> None:
    scene, bar, bars = case
    direction = random_direction(scene.bodies, 3, fields)
    slope = sum(bars[name].dot(direction[name]) for name in bars)
    result = taylor_test(
        lambda step: number(scene, moved(scene.bodies, direction, float(step)), bar),
        lambda step: float(step) * slope,
        0.0,
        1.0,
        steps=[4e-3 / 2.0**k for k in range(4)],
    )
    assert_taylor_order(result)
