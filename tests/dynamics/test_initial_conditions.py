# SPDX-License-Identifier: MIT
"""Start of the motion: given deformation, static equilibrium, and their share of the gradient."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.beams import beam
from shared.motions import check_order, deformed
from shared.scenes import Bodies, Scene, four_bar, loader, robot, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import assemble_model, initial
from dolfinx_ffr.dynamics.kinematics import evaluate_equations
from dolfinx_ffr.mechanism import AppliedForce, Joint

Array = NDArray[np.float64]

TIMES = np.linspace(0.0, 1.0, 11)


def state(mechanism: ffr.Mechanism, bodies: Bodies) -> tuple[Array, Array]:
    return initial.started(assemble_model(mechanism, bodies, TIMES))[1:]


def held(*joints: Joint, **options: Any) -> ffr.Mechanism:
    """A beam on joints, without any clamped at its left end, from equilibrium if nothing else."""
    clamp = ffr.Weld(("beam", "left"), ffr.Ground(), name="clamp")
    options = {"start": ffr.StaticEquilibrium(), **options}
    return ffr.Mechanism({"beam": ffr.Placement((0.2, 0.0))}, joints or [clamp], **options)


@pytest.mark.filterwarnings("ignore:.*excites vibrations:dolfinx_ffr.TimeStepWarning")
@pytest.mark.parametrize("make", [slider_crank, four_bar, robot, loader])
def test_given_deformation_is_kept_and_the_joints_close(make: Callable[[], Scene]) -> None:
    scene = deformed(make(), 2e-4)
    mechanism, start = scene.mechanism, scene.mechanism.start
    assert isinstance(start, ffr.Assembled)
    model = assemble_model(mechanism, scene.bodies, TIMES)
    _, y, v = initial.started(model)
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
        t = ffr.simulate(mechanism, scene.bodies, ffr.GeneralizedAlpha(h, 1))
        second_order = t.y[0] + h * t.v[0] + 0.5 * h**2 * t.w[0], t.v[0] + h * t.w[0]
        gaps = evaluate_equations(t.model.arrays, 1, *second_order, *zero)[0][model.size :]
        drifts.append(np.linalg.norm(gaps[model.rows :]))
    assert drifts[0] / drifts[1] > 3.5


def test_released_beam_swings_in_its_first_mode() -> None:
    """A clamped beam let go in the shape of its first mode: q = q_0 cos(omega t)."""
    body, q0 = beam(0.4, 0.01, 0.01, elements=8, modes=3, frame="tangent"), 1e-3
    omega = math.sqrt(body.K[0, 0] / body.G[1, 1])
    start = ffr.Assembled({"beam": [q0, 0.0, 0.0]}, {"beam": [0.5 * omega * q0, 0.0, 0.0]})
    mechanism = held(start=start)

    def error(steps: int) -> list[float]:
        integrator = ffr.GeneralizedAlpha(4.0 * math.pi / omega, steps)
        t = ffr.simulate(mechanism, {"beam": body}, integrator)
        exact = np.cos(omega * t.t) + 0.5 * np.sin(omega * t.t)
        return [float(np.max(np.abs(t.elastic("beam")[:, 0] / q0 - exact)))]

    check_order(error, [200, 400, 800], 1e-2)


def test_cantilever_under_load_bends_as_its_stiffness_says() -> None:
    body = beam(0.4, 0.01, 0.01, elements=8, modes=5, frame="tangent")
    loads = [ffr.Force(("beam", "right"), 2.0, -5.0), ffr.Torque(("beam", "middle"), 0.3)]
    mechanism = held(gravity=(0.0, -9.81), forces=loads)
    y, v = state(mechanism, {"beam": body})
    tip, middle = body.markers["right"], body.markers["middle"]
    load = tip.displacement.T @ [2.0, -5.0] + 0.3 * middle.rotation - 9.81 * body.S[1:, 1]
    np.testing.assert_allclose(y[3:], np.linalg.solve(body.K, load), rtol=1e-11, atol=1e-18)
    np.testing.assert_array_equal(v, 0.0)
    # Nothing moves, and the clamp carries the load in its deformed place.
    t = ffr.simulate(mechanism, {"beam": body}, ffr.GeneralizedAlpha(0.1, 20))
    np.testing.assert_allclose(t.y, np.tile(y, (21, 1)), atol=1e-13)
    force = t.joint_force("clamp")
    np.testing.assert_allclose(force[:, 0], -2.0, rtol=1e-9)
    np.testing.assert_allclose(force[:, 1], 5.0 + 9.81 * body.mass, rtol=1e-9)
    place = np.array([0.4, 0.0]) + tip.displacement @ y[3:]
    weight = 9.81 * (0.2 * body.mass + body.S[1:, 0] @ y[3:])
    moment = -(place[0] * -5.0 - place[1] * 2.0) - 0.3 + weight
    np.testing.assert_allclose(force[:, 2], moment, rtol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1.4, -1.5, 3.0])
def test_pendulum_comes_to_hang(angle: float) -> None:
    body = ffr.VolumeIntegrals.rigid(1.0, (0.0, 0.0), 0.1, {"left": (-0.5, 0.0)})
    mechanism = ffr.Mechanism(
        {"bar": ffr.Placement((0.5 * math.cos(angle), 0.5 * math.sin(angle)), angle)},
        [ffr.Revolute(("bar", "left"), ffr.Ground())],
        gravity=(0.0, -9.81),
        start=ffr.StaticEquilibrium(),
    )
    y, _ = state(mechanism, {"bar": body})
    np.testing.assert_allclose(y[:2], [0.0, -0.5], atol=1e-12)
    assert math.cos(y[2]) == pytest.approx(0.0, abs=1e-12)


def bar() -> Bodies:
    return {
        "bar": ffr.VolumeIntegrals.rigid(1.0, (0, 0), 0.1, {"left": (-0.5, 0), "right": (0.5, 0)})
    }


HINGE = ffr.Revolute(("bar", "left"), ffr.Ground(), name="pin")
FAR = ffr.Revolute(("bar", "right"), ffr.Ground((2, 0)), name="far")
DOWN = {"gravity": (0.0, -9.81)}
NONE = "no (unique )?static equilibrium .* body 'bar' (can move without resistance|still moves)"


def turned(moment: float, damping: float) -> list[AppliedForce]:
    slow = ffr.TorsionalSpringDamper(("bar", "left"), ffr.Ground(), 0.0, damping)
    return [ffr.Torque(("bar", "right"), moment), slow]


@pytest.mark.parametrize(
    ("joints", "options", "message"),
    [
        ([], DOWN, "no unique static equilibrium: body 'bar' can move"),
        ([], {}, "body 'bar' can move without resistance; hold it by a joint, a drive or a spring"),
        ([HINGE], {}, "body 'bar' can move without resistance; hold it by a joint"),
        ([HINGE], {"forces": turned(1.0, 0.0)[:1]}, NONE),
        ([HINGE], {"forces": [ffr.Force(("bar", "right"), 0.0, 1.0, follower=True)]}, NONE),
        (
            [HINGE],
            {"forces": turned(9.0, 5.0), **DOWN},
            "no static equilibrium under gravity and the forces at t = 0 found: body 'bar' still",
        ),
        ([HINGE, FAR], {}, "1 of the 4 constraints is redundant"),
    ],
)
def test_no_equilibrium(joints: list[Joint], options: Any, message: str) -> None:
    placements, start = {"bar": ffr.Placement((0.5, 0.0))}, ffr.StaticEquilibrium()
    with pytest.raises(ValueError, match=message):
        state(ffr.Mechanism(placements, joints, start=start, **options), bar())


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ffr.Assembled({"bar": [1.0]}), r"elastic of body 'bar' .* \(0,\), but it has sh"),
        (lambda: ffr.Assembled({}, {"rod": []}), r"elastic_velocity of 'rod', but the bodies are"),
        (lambda: ffr.Assembled({"rod": [np.nan]}), "start: elastic of body 'rod' holds NaN"),
        (lambda: "rest", "start must be Assembled"),
    ],
)
def test_refused(make: Callable[[], Any], message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        state(ffr.Mechanism({"bar": ffr.Placement()}, start=make()), bar())


def test_deformation_that_tears_a_joint_is_refused() -> None:
    body = beam(0.4, 0.01, 0.01, elements=8, modes=3, frame="free")
    mechanism = held(
        ffr.Weld(("beam", "left"), ffr.Ground(), name="clamp"),
        ffr.PointOnLine(("beam", "right"), ffr.Ground(), name="support"),
        start=ffr.Assembled({"beam": [0.01, 0.0, 0.0]}),
    )
    message = "cannot be assembled with the given elastic coordinates: joint '(clamp|support)'"
    with pytest.raises(ValueError, match=message):
        state(mechanism, {"beam": body})
