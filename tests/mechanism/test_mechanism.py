# SPDX-License-Identifier: MIT
"""Mechanisms: assembly of the start position, and refused descriptions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from shared.scenes import SCENES, Bodies, four_bar

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import assemble_model
from dolfinx_ffr.dynamics.initial import started
from dolfinx_ffr.dynamics.kinematics import evaluate_equations
from dolfinx_ffr.mechanism import AppliedForce, Joint, Marker

TIMES = np.linspace(0.0, 1.0, 101)


def bar(name: str = "bar") -> Bodies:
    markers = {"left": (-0.5, 0.0), "right": (0.5, 0.0), "middle": (0.0, 0.0)}
    return {name: ffr.VolumeIntegrals.rigid(1.0, (0.0, 0.0), 1.0 / 12.0, markers)}


def placed(*parts: Joint | AppliedForce, **options: Any) -> Callable[[], ffr.Mechanism]:
    """What makes a mechanism of the bar with its left end at the origin."""
    joints = [part for part in parts if isinstance(part, Joint)]
    forces = [part for part in parts if isinstance(part, AppliedForce)]
    placements = {"bar": ffr.Placement((0.5, 0.0))}
    return lambda: ffr.Mechanism(placements, joints, forces=forces, **options)


LEFT, RIGHT, GROUND, AWAY = ("bar", "left"), ("bar", "right"), ffr.Ground(), ffr.Ground((1, 0))
PIN = ffr.Revolute(LEFT, GROUND, name="pin")


def start(mechanism: ffr.Mechanism, bodies: Bodies) -> tuple[np.ndarray, np.ndarray]:
    return started(assemble_model(mechanism, bodies, TIMES))[1:]


def residuals(mechanism: ffr.Mechanism, bodies: Bodies) -> np.ndarray:
    model = assemble_model(mechanism, bodies, TIMES)
    _, y, v = started(model)
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
    fastest = max(1.0, float(np.max(np.abs(started(model)[2]))))
    worst = np.max(np.abs(residuals(rough_mechanism, scene.bodies)))
    assert worst < 8 * np.finfo(float).eps * fastest


@pytest.mark.parametrize(
    ("joint", "message"),
    [
        (
            ffr.Distance(RIGHT, GROUND, length=50.0, name="strut"),
            r"body 'bar' starts 49 m and .* joint 'strut' is open the most in the .*, by 49 m",
        ),
        (
            ffr.Revolute(RIGHT, GROUND, name="pin"),
            r"body 'bar' starts .* m and .* rad from its placement.* joint 'pin' .*, by 1 m",
        ),
        (
            ffr.Weld(LEFT, GROUND, 0.5, name="clamp"),
            r"body 'bar' starts .* and 0.\d+ rad from its placement.* joint 'clamp'",
        ),
    ],
    ids=["strut", "wrong end", "angle"],
)
def test_far_placements_are_reported(joint: Joint, message: str) -> None:
    with pytest.warns(ffr.PlacementWarning, match=message):
        ffr.simulate(placed(joint)(), bar(), ffr.GeneralizedAlpha(0.1, 1))


def test_correction_is_the_smallest() -> None:
    # A pin at the origin: the bar's centre is a third of the gap away, and it does not turn.
    y, v = start(ffr.Mechanism({"bar": ffr.Placement((0.5, 0.3))}, [PIN]), bar())
    assert np.hypot(y[0] - 0.5, y[1] - 0.3) < 0.3
    assert np.hypot(y[0], y[1]) == pytest.approx(0.5, rel=1e-14)
    np.testing.assert_array_equal(v, 0.0)


def test_velocities_follow_the_drive() -> None:
    drive = ffr.PrescribedAngle(LEFT, ffr.Motion.polynomial([0.0, 3.0]))
    y, v = start(placed(PIN, drive)(), bar())
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
    placements = {"bar": ffr.Placement((0.5, 0.0), 0.2)}
    given = ffr.Weld(LEFT, ffr.Ground(angle=0.1), angle=0.3)
    for weld, angle in ((ffr.Weld(LEFT, GROUND), 0.2), (given, 0.4)):
        y, _ = start(ffr.Mechanism(placements, [weld]), bar())
        assert y[2] == pytest.approx(angle, abs=1e-14)


def test_what_is_unnamed_is_named_after_its_markers_and_numbered() -> None:
    joint, force = ffr.PointOnLine(LEFT, GROUND), ffr.Force(LEFT, 1.0)
    pin = ffr.Revolute(LEFT, ffr.Ground(name="wall"))
    mechanism = placed(joint, pin, joint, force, force)()
    assert mechanism.joint_names == [
        "PointOnLine(bar.left, ground)",
        "Revolute(bar.left, wall)",
        "PointOnLine(bar.left, ground) #2",
    ]
    assert mechanism.force_names == ["Force(bar.left)", "Force(bar.left) #2"]


PUSH = ffr.Force(LEFT, 1.0, name="push")
NO_NUMBER = ffr.Motion(lambda t: np.nan * t, np.zeros_like, np.zeros_like, "lost")
WRONG = ffr.Motion(np.cos, np.cos, np.cos, "swing")


def brake(marker: Marker, name: str, angle: ffr.Motion | None = None) -> Joint:
    return ffr.PrescribedAngle(marker, angle or ffr.Motion.constant(0.0), name=name)


def rod(length: Any, to: Marker = AWAY) -> Joint:
    return ffr.Distance(LEFT, to, length, name="rod")


def spring(to: Marker = GROUND, **options: Any) -> AppliedForce:
    return ffr.SpringDamper(LEFT, to, 1.0, name="s", **options)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            placed(ffr.Revolute(("rod", "left"), GROUND, name="pin")),
            r"joint 'pin' refers to body 'rod', but the bodies are \['bar'\]",
        ),
        (
            placed(ffr.Revolute(("bar", "end"), GROUND, name="pin")),
            r"joint 'pin' refers to marker 'end' of body 'bar', whose markers are "
            r"\['left', 'right', 'middle'\]",
        ),
        (
            placed(ffr.Force(("rod", "pin"), 1.0)),
            r"'Force\(rod.pin\)' refers to body 'rod', but the",
        ),
        (
            placed(PIN, point_masses=[ffr.PointMass(("bar", "end"), 1.0)]),
            r"point mass refers to marker 'end' of body 'bar'",
        ),
        (
            placed(PIN, damping={"rod": ffr.RayleighDamping(1.0)}),
            r"damping for 'rod', but the bodies are \['bar'\]",
        ),
        (
            placed(PIN, damping={"bar": ffr.RayleighDamping(1.0)}),
            "damping for body 'bar', which is rigid and has no elastic coordinates",
        ),
        (
            lambda: ffr.Mechanism({"rod": ffr.Placement()}, [PIN]),
            r"placement for 'rod', but the bodies are \['bar'\]",
        ),
        (
            lambda: ffr.Mechanism({}, [PIN]),
            r"body 'bar' has no placement; placements are given for \[\]",
        ),
        (placed(PIN, PIN), "two joints have the name 'pin'"),
        (placed(PUSH, PUSH), "two forces have the name 'push'"),
        (placed(ffr.Distance(GROUND, AWAY)), "has no marker on a body"),
        (
            placed(ffr.SpringDamper(GROUND, GROUND, 1.0)),
            r"'SpringDamper\(ground, ground\)' has no marker",
        ),
        (placed(rod(0.0, GROUND)), "'rod': the length must be positive, but it"),
        (placed(rod(None, GROUND)), "'rod': the markers coincide in the placements"),
        (
            placed(rod(ffr.Motion.polynomial([0.5, -1.0]))),
            "'rod': the length must be positive at all times, but it is 0 m at t = 0.5 s",
        ),
        (placed(rod(WRONG)), "joint 'rod': motion 'swing': the velocity is not the derivative"),
        (
            placed(ffr.Revolute(LEFT, ffr.Moving(NO_NUMBER, ffr.Motion.constant(0)))),
            "joint 'Revolute.*', marker 'moving marker': motion 'lost': the value is NaN",
        ),
        (placed(spring(length=-0.1)), "'s': the length must not be"),
        (placed(spring()), "'s': the markers coincide in the placem"),
        (placed(spring(length=0.2)), "'s': the markers coincide at"),
        (placed(spring(AWAY, length=lambda t: 0.1 - t)), "must not be negati"),
        (
            placed(ffr.TorsionalSpringDamper(LEFT, GROUND, np.inf)),
            "must be finite; a joint holds",
        ),
        (placed(replace(PUSH, x=np.nan)), "force 'push': x must be finite, but it is nan"),
        (placed(replace(PUSH, y=lambda t: 1.0 / (t - 0.5))), r"y is NaN or infinite at t = 0.5 s"),
        (
            placed(ffr.Torque(LEFT, lambda t: np.ones(3))),
            r"moment about z at 12 times has shape \(3,\)",
        ),
        (
            placed(gravity=(0.0, lambda t: np.nan * t)),
            "gravity along y is NaN or infinite at t = 0 s",
        ),
        (
            placed(PIN, ffr.Revolute(RIGHT, ffr.Ground((1.2, 0.0)), name="far")),
            r"cannot be assembled: joint '(pin|far)' stays open by 0.1 m "
            r"\(joints involved: \['pin', 'far'\]\)",
        ),
        (
            placed(PIN, brake(LEFT, "brake"), brake(RIGHT, "other", ffr.Motion.constant(0.5))),
            r"stays open by 0.25 rad \(joints involved: \['brake', 'other'\]\); the joints "
            "contradict each other",
        ),
        (
            placed(
                PIN, brake(LEFT, "brake"), brake(RIGHT, "motor", ffr.Motion.polynomial([0.0, 1.0]))
            ),
            r"cannot be set in motion with the elastic coordinates at rest: joint "
            r"'(brake|motor)' stays open by 0.5 rad/s \(joints involved: \['brake', 'motor'\]\)",
        ),
        (
            placed(PIN, ffr.PointOnLine(LEFT, GROUND, name="slider")),
            r"1 of the 3 constraints is redundant; joints involved: \['pin', 'slider'\]",
        ),
        (
            placed(ffr.Weld(LEFT, GROUND, name="clamp"), PIN),
            r"2 of the 5 constraints are redundant; joints involved: \['clamp', 'pin'\]",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_refused(make: Callable[[], ffr.Mechanism], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ffr.simulate(make(), bar(), ffr.GeneralizedAlpha(1.0, 10))


def test_a_mechanism_needs_a_body() -> None:
    with pytest.raises(ValueError, match="needs at least one body"):
        assemble_model(ffr.Mechanism({}), {}, TIMES)


def test_integrals_are_checked_under_their_name() -> None:
    bodies = {"bar": replace(bar()["bar"], mass=-1.0)}
    with pytest.raises(ValueError, match="body 'bar': the mass must be positive"):
        assemble_model(placed(PIN)(), bodies, TIMES)


def test_four_bar_on_parallel_cranks_in_line_is_singular() -> None:
    bodies = bar("left") | bar("top") | bar("right")
    mechanism = ffr.Mechanism(
        {
            "left": ffr.Placement((0.5, 0.0)),
            "top": ffr.Placement((1.5, 0.0)),
            "right": ffr.Placement((1.5, 0.0)),
        },
        [
            ffr.Revolute(("left", "left"), ffr.Ground(), name="A"),
            ffr.Revolute(("left", "right"), ("top", "left"), name="B"),
            ffr.Revolute(("top", "right"), ("right", "right"), name="C"),
            ffr.Revolute(("right", "left"), ffr.Ground((1.0, 0.0)), name="D"),
        ],
    )
    with pytest.raises(ValueError, match=r"1 of the 8 constraints is redundant.*not singular"):
        start(mechanism, bodies)
