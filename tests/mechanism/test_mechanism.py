# SPDX-License-Identifier: MIT
"""Mechanisms: assembly of the start position, and refused descriptions."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from shared.scenes import SCENES, Bodies, four_bar, slider_crank

from dolfinx_ffr.body.volume_integrals import VolumeIntegrals
from dolfinx_ffr.dynamics import assemble_model, initial_state
from dolfinx_ffr.dynamics.kinematics import evaluate_equations
from dolfinx_ffr.mechanism import (
    Ground,
    Joint,
    Mechanism,
    Moving,
    Placement,
    PointMass,
    PointOnLine,
    PrescribedAngle,
    PrescribedPosition,
    RayleighDamping,
    Revolute,
    Weld,
)
from dolfinx_ffr.mechanism.motion import Motion

TIMES = np.linspace(0.0, 1.0, 101)


def bar(name: str = "bar") -> Bodies:
    markers = {"left": (-0.5, 0.0), "right": (0.5, 0.0), "middle": (0.0, 0.0)}
    return {name: VolumeIntegrals.rigid(1.0, (0.0, 0.0), 1.0 / 12.0, markers)}


def start(mechanism: Mechanism, bodies: Bodies) -> tuple[np.ndarray, np.ndarray]:
    return initial_state(assemble_model(mechanism, bodies, TIMES))


def residuals(mechanism: Mechanism, bodies: Bodies) -> np.ndarray:
    model = assemble_model(mechanism, bodies, TIMES)
    y, v = initial_state(model)
    zero = np.zeros(model.size), np.zeros(model.rows)
    return evaluate_equations(model.arrays, 0, y, v, *zero)[0][model.size :]


@pytest.mark.parametrize("name", SCENES)
def test_rough_placements_are_corrected_until_all_joints_close(name: str) -> None:
    scene = SCENES[name]()
    rough = {
        body: replace(
            p, position=(p.position[0] + 0.01, p.position[1] - 0.015), angle=p.angle + 0.05
        )
        for body, p in scene.mechanism.placements.items()
    }
    rough_mechanism = replace(scene.mechanism, placements=rough)
    # a few units in the last place of positions around 1 m and of the fastest velocity
    model = assemble_model(rough_mechanism, scene.bodies, TIMES)
    fastest = max(1.0, float(np.max(np.abs(initial_state(model)[1]))))
    worst = np.max(np.abs(residuals(rough_mechanism, scene.bodies)))
    assert worst < 8 * np.finfo(float).eps * fastest


def test_correction_is_the_smallest() -> None:
    # A pin at the origin: the bar's centre is a third of the gap away, and it does not turn.
    mechanism = Mechanism({"bar": Placement((0.5, 0.3))}, [Revolute(("bar", "left"), Ground())])
    y, v = start(mechanism, bar())
    assert np.hypot(y[0] - 0.5, y[1] - 0.3) < 0.3
    assert np.hypot(y[0], y[1]) == pytest.approx(0.5, rel=1e-14)
    np.testing.assert_array_equal(v, 0.0)


def test_velocities_follow_the_drive() -> None:
    mechanism = Mechanism(
        {"bar": Placement((0.5, 0.0))},
        [
            Revolute(("bar", "left"), Ground()),
            PrescribedAngle(("bar", "left"), Motion.polynomial([0.0, 3.0])),
        ],
    )
    y, v = start(mechanism, bar())
    np.testing.assert_allclose(y, [0.5, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(v, [0.0, 1.5, 3.0], atol=1e-14)


def test_start_does_not_depend_on_the_integrals() -> None:
    scene = four_bar()
    heavy = {name: replace(body, K=7.0 * body.K) for name, body in scene.bodies.items()}
    heavy["crank"] = replace(heavy["crank"], mass=2.0)
    first, second = (start(scene.mechanism, bodies) for bodies in (scene.bodies, heavy))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)


def test_weld_keeps_the_angle_of_the_placements_or_the_given_one() -> None:
    placements = {"bar": Placement((0.5, 0.0), 0.2)}
    y, _ = start(Mechanism(placements, [Weld(("bar", "left"), Ground())]), bar())
    assert y[2] == pytest.approx(0.2, abs=1e-14)
    ground = Ground(angle=0.1)
    y, _ = start(Mechanism(placements, [Weld(("bar", "left"), ground, angle=0.3)]), bar())
    assert y[2] == pytest.approx(0.4, abs=1e-14)


def test_unnamed_joints_are_named_after_their_markers_and_numbered() -> None:
    joint = PointOnLine(("bar", "left"), Ground())
    mechanism = Mechanism({}, [joint, Revolute(("bar", "left"), Ground(name="wall")), joint])
    assert mechanism.joint_names == [
        "PointOnLine(bar.left, ground)",
        "Revolute(bar.left, wall)",
        "PointOnLine(bar.left, ground) #2",
    ]


def placed(*joints: Joint, **options: object) -> Mechanism:
    placements = {"bar": Placement((0.5, 0.0))}
    return Mechanism(placements, list(joints), **options)  # type: ignore[arg-type]


PIN = Revolute(("bar", "left"), Ground(), name="pin")
NO_NUMBER = Motion(lambda t: np.nan * t, np.zeros_like, np.zeros_like, "lost")


@pytest.mark.parametrize(
    ("mechanism", "message"),
    [
        (
            placed(Revolute(("rod", "left"), Ground(), name="pin")),
            r"joint 'pin' refers to body 'rod', but the bodies are \['bar'\]",
        ),
        (
            placed(Revolute(("bar", "end"), Ground(), name="pin")),
            r"joint 'pin' refers to marker 'end' of body 'bar', whose markers are "
            r"\['left', 'right', 'middle'\]",
        ),
        (
            placed(PIN, point_masses=[PointMass(("bar", "end"), 1.0)]),
            r"point mass refers to marker 'end' of body 'bar'",
        ),
        (
            placed(PIN, damping={"rod": RayleighDamping(1.0)}),
            r"damping for 'rod', but the bodies are \['bar'\]",
        ),
        (
            Mechanism({"rod": Placement()}, [PIN]),
            r"placement for 'rod', but the bodies are \['bar'\]",
        ),
        (Mechanism({}, [PIN]), r"body 'bar' has no placement; placements are given for \[\]"),
        (
            placed(PIN, PrescribedAngle(("bar", "left"), Motion(np.sin, np.sin, np.cos, "swing"))),
            "joint 'PrescribedAngle.*motion 'swing': the velocity is not the derivative",
        ),
        (
            placed(Revolute(("bar", "left"), Moving(NO_NUMBER, Motion.constant(0)))),
            "joint 'Revolute.*', marker 'moving marker': motion 'lost': the value is NaN",
        ),
        (
            placed(PIN, Revolute(("bar", "right"), Ground((1.2, 0.0)), name="far")),
            r"cannot be assembled: joint '(pin|far)' stays open by 0.1 m "
            r"\(joints involved: \['pin', 'far'\]\)",
        ),
        (
            placed(
                PIN,
                PrescribedAngle(("bar", "left"), Motion.constant(0.0), name="brake"),
                PrescribedAngle(("bar", "right"), Motion.constant(0.5), name="other brake"),
            ),
            r"stays open by 0.25 rad \(joints involved: \['brake', 'other brake'\]\); the joints "
            "contradict each other",
        ),
        (
            placed(
                PIN,
                PrescribedAngle(("bar", "left"), Motion.constant(0.0), name="brake"),
                PrescribedAngle(("bar", "right"), Motion.polynomial([0.0, 1.0]), name="motor"),
            ),
            r"cannot be set in motion with the elastic coordinates at rest: joint "
            r"'(brake|motor)' stays open by 0.5 rad/s \(joints involved: \['brake', 'motor'\]\)",
        ),
        (
            placed(PIN, PointOnLine(("bar", "left"), Ground(), name="slider")),
            r"1 of the 3 constraints is redundant; joints involved: \['pin', 'slider'\]",
        ),
        (
            placed(PIN, Revolute(("bar", "left"), Ground(), name="second pin")),
            r"2 of the 4 constraints are redundant; joints involved: \['pin', 'second pin'\]",
        ),
        (
            placed(Weld(("bar", "left"), Ground(), name="clamp"), PIN),
            r"2 of the 5 constraints are redundant; joints involved: \['clamp', 'pin'\]",
        ),
    ],
)
def test_refused_when_assembled(mechanism: Mechanism, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        start(mechanism, bar())


def test_a_mechanism_needs_a_body() -> None:
    with pytest.raises(ValueError, match="needs at least one body"):
        assemble_model(Mechanism({}), {}, TIMES)


def test_integrals_are_checked_under_their_name() -> None:
    bodies = {"bar": replace(bar()["bar"], mass=-1.0)}
    with pytest.raises(ValueError, match="body 'bar': the mass must be positive"):
        assemble_model(placed(PIN), bodies, TIMES)


def test_four_bar_on_parallel_cranks_in_line_is_singular() -> None:
    bodies = bar("left") | bar("top") | bar("right")
    mechanism = Mechanism(
        {
            "left": Placement((0.5, 0.0)),
            "top": Placement((1.5, 0.0)),
            "right": Placement((1.5, 0.0)),
        },
        [
            Revolute(("left", "left"), Ground(), name="A"),
            Revolute(("left", "right"), ("top", "left"), name="B"),
            Revolute(("top", "right"), ("right", "right"), name="C"),
            Revolute(("right", "left"), Ground((1.0, 0.0)), name="D"),
        ],
    )
    with pytest.raises(ValueError, match=r"1 of the 8 constraints is redundant.*not singular"):
        start(mechanism, bodies)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: placed(gravity=(0.0, np.nan)), "gravity along y must be finite, but it is nan"),
        (
            lambda: Mechanism({"bar": Placement(angle=np.inf)}),
            "placement of body 'bar': angle must be finite",
        ),
        (lambda: placed(point_masses=[PointMass(("bar", "left"), 0.0)]), "bar.left: the mass must"),
        (
            lambda: placed(damping={"bar": RayleighDamping(-1.0)}),
            "'bar': alpha must not be negative, but it is -1.0",
        ),
        (lambda: placed(Revolute(Ground(), Ground((1, 0)))), "has no marker on a body"),
        (lambda: placed(PIN, PIN), "two joints have the name 'pin'"),
        (
            lambda: placed(PointOnLine(("bar", "left"), Ground(), (0.0, 0.0))),
            "direction of the line must not be zero",
        ),
        (
            lambda: placed(PrescribedPosition(("bar", "left"), "w", Motion.constant(0))),  # type: ignore[arg-type]
            "axis must be one of .*, but it is 'w'",
        ),
    ],
)
def test_refused_description(make, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_names_of_bodies_and_joints_are_listed() -> None:
    scene = slider_crank()
    model = assemble_model(scene.mechanism, scene.bodies, TIMES)
    with pytest.raises(ValueError, match=r"no body 'crank'; the bodies are \['rod'\]"):
        model.coordinates("crank")
    assert model.joint_of_row(2) == "slider"
    assert model.body_of_coordinate(model.size - 1) == "rod"
    assert math.isclose(model.offset, 1e-6)
