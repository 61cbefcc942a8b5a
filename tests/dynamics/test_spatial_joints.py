# SPDX-License-Identifier: MIT
"""Joints and forces in space: what they leave free, what they carry, what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared.spatial_bodies import cloud

from dolfinx_ffr.body import BodyMarker, VolumeIntegrals
from dolfinx_ffr.dynamics import (
    GeneralizedAlpha,
    Integrator,
    RadauIIA,
    TiltedAxisWarning,
    Trajectory,
    simulate,
    spatial,
)
from dolfinx_ffr.dynamics.kinematics import evaluate_equations, place_markers
from dolfinx_ffr.dynamics.model import assemble_model
from dolfinx_ffr.mechanism import (
    AppliedForce,
    Bushing,
    Cylindrical,
    Distance,
    Force,
    Gear,
    Ground,
    Joint,
    LinearDrive,
    Mechanism,
    Motion,
    Moving,
    Placement,
    Planar,
    PointOnLine,
    PointOnPlane,
    PrescribedAngle,
    PrescribedPosition,
    Revolute,
    Spherical,
    SpringDamper,
    Torque,
    TorsionalSpringDamper,
    Translational,
    Universal,
    Weld,
)

PIN, END = ("body", "pin"), ("body", "end")


def block(**markers: tuple[float, float, float]) -> VolumeIntegrals:
    """A rigid body of mass 2 with its centre at the origin of its frame."""
    points = {"pin": (0.0, 0.0, 0.0), "end": (0.3, 0.1, 0.2), **markers}
    return VolumeIntegrals.rigid(2.0, inertia=(0.2, 0.3, 0.4), markers=points)


def motion(
    *joints: Joint,
    end: float = 0.5,
    steps: int = 50,
    integrator: Integrator | None = None,
    **scene: object,
) -> Trajectory:
    """A block with joints from a placement at rest."""
    placement = scene.pop("placement", Placement((0.0, 0.0, 0.0)))
    mechanism = Mechanism({"body": placement}, joints, **scene)  # type: ignore[arg-type, dict-item]
    return simulate(mechanism, {"body": block()}, integrator or GeneralizedAlpha(end, steps))


@pytest.mark.parametrize(
    ("joint", "rows"),
    [
        (Spherical(PIN, Ground()), 3),
        (Revolute(PIN, Ground()), 5),
        (Universal(PIN, Ground()), 4),
        (Cylindrical(PIN, Ground()), 4),
        (Translational(PIN, Ground()), 5),
        (Planar(PIN, Ground()), 3),
        (Weld(PIN, Ground()), 6),
        (PointOnLine(PIN, Ground()), 2),
        (PointOnPlane(PIN, Ground()), 1),
        (Distance(PIN, Ground((1.0, 0.0, 0.0))), 1),
        (PrescribedAngle(PIN, Motion.constant(0.0)), 1),
        (PrescribedPosition(PIN, "z", Motion.constant(0.0)), 1),
        (LinearDrive(PIN, Ground(), Motion.constant(0.0)), 1),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Joint) else "",
)
def test_joints_hold_under_a_force(joint: Joint, rows: int) -> None:
    trajectory = motion(joint, forces=[Force(END, 1.0, -2.0, z=0.5), Torque(PIN, (0.3, -0.2, 0.4))])
    assert trajectory.joint_force(joint.label).shape == (51, rows)
    model = trajectory.model
    assert model.rows == rows
    # Positions and velocities hold to round-off at the end.
    state = trajectory.y[-1], trajectory.v[-1], trajectory.w[-1], trajectory.multipliers[-1]
    residual = evaluate_equations(model.arrays, len(trajectory.t) - 1, *state).residual
    np.testing.assert_allclose(residual[6:], 0.0, atol=1e-12)
    moves = float(np.max(np.abs(trajectory.v[-1]))) > 1e-3
    assert moves != isinstance(joint, Weld)


def test_forces_and_moments_of_joints() -> None:
    """They balance what acts on a block at rest, about the axes that the pages name."""
    force, moment = np.array([1.0, -2.0, 0.5]), np.array([0.3, -0.2, 0.4])
    loads = [Force(PIN, *force[:2], z=force[2]), Torque(PIN, tuple(moment))]
    weld = motion(Weld(PIN, Ground(), name="weld"), forces=loads).joint_force("weld")
    np.testing.assert_allclose(weld[-1], [*-force, *-moment], atol=1e-12)
    for axis, others in (((0, 0, 1.0), (0, 1)), ((1.0, 0, 0), (1, 2)), ((0, 1.0, 0), (2, 0))):
        loads[1] = Torque(PIN, tuple(moment * (1.0 - np.array(axis))))
        hinge = motion(Revolute(PIN, Ground(), "hinge", axis), forces=loads).joint_force("hinge")
        np.testing.assert_allclose(hinge[-1], [*-force, *-moment[list(others)]], atol=1e-12)
    slider = motion(Translational(PIN, Ground(), name="slide"), forces=loads).joint_force("slide")
    # Along x: forces along y and z, moments about y, z and x; the last torque is not about y.
    expected = [-force[1], -force[2], 0.0, -moment[2], -moment[0]]
    np.testing.assert_allclose(slider[-1], expected, atol=1e-12)


def test_driven_shaft_turns_many_times_and_needs_its_moment() -> None:
    axis, rate = (0.0, 1.0, 1.0), 40.0
    trajectory = motion(
        Revolute(PIN, Ground(), axis=axis),
        PrescribedAngle(PIN, Motion.polynomial([0.0, 0.0, 0.5 * rate]), name="drive", axis=axis),
        end=1.0,
        steps=400,
    )
    # The moment of inertia about the axis, through the centre of mass.
    np.testing.assert_allclose(
        trajectory.joint_force("drive")[:, 0], rate * 0.5 * (0.3 + 0.4), rtol=1e-9
    )
    turn = np.linalg.norm(trajectory.y[:, 3:6], axis=1)
    np.testing.assert_allclose(turn, 0.5 * rate * trajectory.t**2, atol=1e-9)


@pytest.mark.parametrize("integrator", [GeneralizedAlpha(1.0, 400), RadauIIA(1.0, 1e-4)], ids=str)
def test_gear_counts_turns(integrator: Integrator) -> None:
    mechanism = Mechanism(
        {"body": Placement((0.0, 0.0, 0.0)), "other": Placement((1.0, 0.0, 0.0))},
        joints=[
            Revolute(PIN, Ground()),
            Revolute(("other", "pin"), Ground((1.0, 0.0, 0.0)), axis=(1.0, 0.0, 0.0)),
            Gear(PIN, ("other", "pin"), -2.5, "gear", (0, 0, 1.0), (1.0, 0.0, 0.0)),
        ],
        forces=[Torque(PIN, (0.0, 0.0, 30.0))],
    )
    bodies = {"body": block(), "other": block()}
    trajectory = simulate(mechanism, bodies, integrator)
    first, second = trajectory.y[:, 5], trajectory.y[:, 9]
    np.testing.assert_allclose(first, -2.5 * second, atol=1e-10)
    # Reduced inertia 0.4 + 0.2 / 2.5^2.
    np.testing.assert_allclose(
        first, 0.5 * 30.0 / (0.4 + 0.2 / 6.25) * trajectory.t**2, rtol=1e-4, atol=1e-6
    )
    assert first[-1] > 5.0 * math.pi


def test_torsional_spring_counts_turns() -> None:
    """A wheel on a spring swings by ten radians."""
    stiffness, inertia, speed = 40.0, 0.4, 100.0
    spring = TorsionalSpringDamper(PIN, Ground(), stiffness, name="spring")
    frequency = math.sqrt(stiffness / inertia)
    trajectory = motion(
        Revolute(PIN, Ground()),
        placement=Placement((0.0, 0.0, 0.0), angular_velocity=(0.0, 0.0, speed)),
        forces=[spring],
        end=1.0,
        steps=1000,
    )
    exact = speed / frequency * np.sin(frequency * trajectory.t)
    np.testing.assert_allclose(trajectory.y[:, 5], exact, atol=3e-3)
    tension = trajectory.applied_force("spring")[:, 0]
    np.testing.assert_allclose(tension, stiffness * trajectory.y[:, 5], atol=1e-9)
    # Radau's method takes its steps in stretches, each of which goes on counting.
    trajectory = motion(
        Revolute(PIN, Ground()),
        placement=Placement((0.0, 0.0, 0.0), angular_velocity=(0.0, 0.0, speed)),
        forces=[spring],
        integrator=RadauIIA(1.0, 1e-7),
    )
    exact = speed / frequency * np.sin(frequency * trajectory.t)
    np.testing.assert_allclose(trajectory.y[:, 5], exact, atol=1e-5)


def test_follower_moment_keeps_its_axis() -> None:
    """About a principal axis of a free body that lies askew."""
    trajectory = motion(
        placement=Placement((0.0, 0.0, 0.0), rotation=(0.4, -0.3, 0.2)),
        forces=[Torque(PIN, (0.0, 6.0, 0.0), follower=True)],
        end=0.2,
    )
    np.testing.assert_allclose(trajectory.v[:, 4], 20.0 * trajectory.t, atol=1e-10)
    np.testing.assert_allclose(trajectory.v[:, [3, 5]], 0.0, atol=1e-12)


def test_bushing_has_a_stiffness_along_and_about_each_axis() -> None:
    """Small vibrations of a block on its centre."""
    along, about = (300.0, 200.0, 100.0), (3.0, 5.0, 7.0)
    small = 1e-4
    trajectory = motion(
        placement=Placement(
            (0.0, 0.0, 0.0), velocity=(small,) * 3, angular_velocity=(small, -small, small)
        ),
        forces=[Bushing(PIN, Ground(), along, torsional_stiffness=about)],
        end=0.3,
        steps=600,
    )
    t = trajectory.t
    for k in range(3):
        w = math.sqrt(along[k] / 2.0)
        np.testing.assert_allclose(trajectory.y[:, k], small / w * np.sin(w * t), atol=2e-9)
        w = math.sqrt(about[k] / (0.2, 0.3, 0.4)[k])
        sign = -1.0 if k == 1 else 1.0
        np.testing.assert_allclose(
            trajectory.y[:, 3 + k], sign * small / w * np.sin(w * t), atol=1e-8
        )


def test_markers_of_the_ground_with_rotations_are_told_apart() -> None:
    """Given as arrays, which Python compares entry by entry."""
    turned = [Ground(np.zeros(3), rotation=Q) for Q in (np.eye(3), np.eye(3), np.eye(3)[[1, 2, 0]])]
    assert turned[0] == turned[1]
    assert turned[0] != turned[2]
    joints = [PointOnPlane(PIN, marker) for marker in turned[1:]]
    trajectory = motion(*joints, gravity=(1.0, 2.0, 3.0), end=0.1, steps=10)
    np.testing.assert_allclose(trajectory.y[-1, :3], (0.005, 0.0, 0.0), atol=1e-12)


def test_acceleration_of_the_ground_is_felt() -> None:
    trajectory = motion(ground_acceleration=(1.0, 2.0, 3.0), gravity=(0.0, 0.0, -9.81), end=0.1)
    np.testing.assert_allclose(trajectory.v[-1, :3], (-0.1, -0.2, -1.281), atol=1e-12)


@pytest.mark.parametrize("joint", [Revolute(PIN, Ground()), Weld(PIN, Ground())])
@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (math.pi, 0.0, 0.0), (0.0, 0.0, math.pi)])
def test_axis_the_other_way_round_is_noticed(joint: Joint, turn: tuple[float, ...]) -> None:
    """The rows of a joint hold for a reversed axis, too."""
    mechanism = Mechanism({"body": Placement((0.0, 0.0, 0.0))}, [joint])
    model = assemble_model(mechanism, {"body": block()}, np.linspace(0.0, 1.0, 2))
    assert isinstance(model.arrays, spatial.ModelArrays)
    before, after = (
        place_markers(model.arrays, 0, np.array([0.0, 0.0, 0.0, *phi])) for phi in ([0.0] * 3, turn)
    )
    wrong = any(turn) and (isinstance(joint, Weld) or turn[0] > 0.0)
    row = spatial.reversed_row(model.arrays, model.joints.values(), before, after)
    assert (row >= 0) == wrong


FOUR = [(0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 1.0, 0.0), (1.0, 0.0, 0.0)]


def four_bar(last: type[Joint]) -> Trajectory:
    """A parallelogram with hinges about z."""
    bar = VolumeIntegrals.rigid(
        1.0, (0.5, 0, 0), (0.01, 0.1, 0.1), {"a": (0, 0, 0), "b": (1.0, 0, 0)}
    )
    turn = {0: math.pi / 2.0, 1: 0.0, 2: -math.pi / 2.0}
    mechanism = Mechanism(
        {f"bar {k}": Placement(FOUR[k], rotation=(0.0, 0.0, turn[k])) for k in range(3)},
        joints=[
            Revolute(("bar 0", "a"), Ground(), "first"),
            Revolute(("bar 1", "a"), ("bar 0", "b")),
            Revolute(("bar 2", "a"), ("bar 1", "b")),
            last(("bar 2", "b"), Ground(FOUR[3]), name="last"),  # type: ignore[call-arg]
        ],
        gravity=(0.0, -9.81, 0.0),
    )
    return simulate(mechanism, {f"bar {k}": bar for k in range(3)}, GeneralizedAlpha(0.1, 20))


def test_redundant_rows_are_refused_with_a_proposal() -> None:
    message = (
        r"3 of the 20 constraints are redundant; joints involved: .*'first'.*'last' need not hold "
        "1 position and 2 rotations: in place of a Revolute, a Spherical leaves"
    )
    with pytest.raises(ValueError, match=message):
        four_bar(Revolute)
    # A ball at the end still holds one position too many: that out of the plane.
    with pytest.raises(ValueError, match="'last' need not hold 1 position"):
        four_bar(Spherical)


@pytest.mark.parametrize(
    ("joint", "force"),
    [
        (PrescribedAngle(PIN, Motion.constant(0.0), name="loose"), None),
        (Gear(PIN, Ground(), 1.0, name="loose"), None),
        (Spherical(PIN, Ground()), TorsionalSpringDamper(PIN, Ground(), 1.0, name="loose")),
        (
            Spherical(PIN, Ground()),
            Bushing(PIN, Ground(), (1.0,) * 3, torsional_stiffness=(1e-3,) * 3, name="loose"),
        ),
    ],
    ids=lambda value: type(value).__name__,
)
def test_an_axis_that_nothing_holds_is_reported(joint: Joint, force: AppliedForce | None) -> None:
    turn = Placement((0.0, 0.0, 0.0), angular_velocity=(1.5, 2.0, 0.0))
    with pytest.warns(TiltedAxisWarning, match="'loose': the axes of its markers part by [01]"):
        motion(joint, forces=[force] if force else [], placement=turn)


def in_space(*joints: Joint, **scene: object) -> None:
    motion(*joints, **scene)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: in_space(Revolute(PIN, Ground((1.0, 0.0)), "hinge")),
            "joint 'hinge': marker 'ground' is in the plane, but body 'body' is in space",
        ),
        (
            lambda: in_space(placement=Placement((0.1, 0.2), 0.3)),
            "placement of body 'body' is in the plane, but body 'body' is in space",
        ),
        (lambda: in_space(gravity=(0.0, -9.81)), "gravity with 2 components is in the plane"),
        (lambda: Revolute(PIN, Ground(), axis=(0, 0, 0)).validate("x"), "axis has no length"),
        (
            lambda: in_space(Universal(PIN, Ground(), (1.0, 0, 0), (1.0, 0, 0), "cross")),
            "two axes of the universal joint are parallel",
        ),
        (lambda: in_space(Weld(PIN, Ground(), 0.3)), "in space the relative rotation is that of"),
        (lambda: in_space(forces=[Torque(PIN, 1.0)]), "in space the moment has three components"),
        (lambda: Torque(PIN, (1.0, 2.0)).validate("t"), "moment has three components"),
        (
            lambda: Placement((0.0, 0.0, 0.0), 0.3).validate("placement"),
            "in space give a rotation instead of an angle",
        ),
        (
            lambda: Placement((0.0, 0.0, 0.0), rotation=2.0 * np.eye(3)).validate("placement"),
            "must be the matrix of a rotation",
        ),
        (
            lambda: Placement((0.0, 0.0, 0.0), angular_velocity=1.0).validate("placement"),
            "angular_velocity must have three components",
        ),
        (lambda: Ground((1.0, 0.0, 0.0), 0.2), "axes turn by a rotation, not by an angle"),
        (
            lambda: in_space(forces=[SpringDamper(PIN, Ground(), 5.0, name="s")]),
            "force 's': the markers coincide in the placements",
        ),
        (
            lambda: in_space(forces=[SpringDamper(PIN, Ground(), 5.0, 0.0, 0.3, "s")]),
            "force 's': the markers coincide at the start",
        ),
        (
            lambda: in_space(Distance(PIN, Ground(), name="strut")),
            "joint 'strut': the markers coincide in the placements; a Spherical joins them",
        ),
    ],
)
def test_what_does_not_fit_is_refused(make, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        ([Spherical(PIN, Ground())], "is in space|is a joint in space.*Revolute"),
        ([PointOnLine(PIN, Ground(), (1.0, 0.0, 0.0))], "direction of the line has three"),
        ([Revolute(PIN, Ground(), axis=(1.0, 0.0, 0.0))], "perpendicular to the plane"),
        ([PrescribedPosition(PIN, "z", Motion.constant(0.0))], "no axis z in the plane"),
    ],
)
def test_joints_in_space_are_refused_in_the_plane(joints: list[Joint], message: str) -> None:
    body = VolumeIntegrals.rigid(1.0, inertia=0.1, markers={"pin": (0.0, 0.0)})
    mechanism = Mechanism({"body": Placement()}, joints)
    with pytest.raises(ValueError, match=message):
        simulate(mechanism, {"body": body}, GeneralizedAlpha(0.1, 4))


def test_bodies_of_two_kinds_are_refused() -> None:
    flat = VolumeIntegrals.rigid(1.0, inertia=0.1)
    mechanism = Mechanism({"body": Placement(), "other": Placement()})
    with pytest.raises(ValueError, match="body 'other' is in space, but body 'body' is in the pl"):
        simulate(mechanism, {"body": flat, "other": cloud(2)}, GeneralizedAlpha(0.1, 4))


def test_moving_marker_has_the_derivatives_of_its_motion() -> None:
    crank = Moving.circle(
        (0.1, 0.2, 0.3), 0.5, Motion.polynomial([0.3, 1.0, 2.0]), axis=(1.0, 2.0, 3.0)
    )
    t, h = np.array([0.4]), 1e-4
    here, before, after = (crank.tabulate_in_space(t + k * h, "")[0] for k in (0, -1, 1))
    np.testing.assert_allclose((after[0] - before[0]) / (2 * h), here[1], atol=1e-6)
    np.testing.assert_allclose((after[1] - before[1]) / (2 * h), here[2], atol=1e-6)
    axes = here[0, 1:]
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(axes[2], np.array([1.0, 2.0, 3.0]) / math.sqrt(14.0), atol=1e-14)
    # The first axis points along the radius.
    np.testing.assert_allclose(here[0, 0] - (0.1, 0.2, 0.3), 0.5 * axes[0], atol=1e-14)


def test_markers_have_axes_of_their_own(tmp_path: Path) -> None:
    """Axes of joints and directions of followers are given in them; files keep them."""
    Q = Rotation.from_rotvec((0.5, -0.3, 0.8)).as_matrix()
    turned = VolumeIntegrals.rigid(
        2.0,
        inertia=(0.2, 0.3, 0.4),
        markers={"pin": BodyMarker.of_rigid_body((0.1, 0.0, 0.0), Q), "end": (0.3, 0.1, 0.2)},
    )
    turned.save(tmp_path / "turned.npz")
    axis = np.array([0.0, 0.6, 0.8])

    def spin(body: VolumeIntegrals, direction: np.ndarray) -> Trajectory:
        mechanism = Mechanism(
            {"body": Placement((0.0, 0.0, 0.0))},
            [Revolute(Ground((0.1, 0.0, 0.0)), ("body", "pin"), axis=tuple(direction))],
            forces=[Torque(("body", "pin"), tuple(2.0 * direction), follower=True)],
        )
        return simulate(mechanism, {"body": body}, GeneralizedAlpha(0.5, 50))

    plain = VolumeIntegrals.rigid(2.0, inertia=(0.2, 0.3, 0.4), markers={"pin": (0.1, 0.0, 0.0)})
    expected = spin(plain, Q @ axis)
    for body in (turned, VolumeIntegrals.load(tmp_path / "turned.npz")):
        np.testing.assert_allclose(spin(body, axis).y, expected.y, atol=1e-12)
    bad = {"pin": BodyMarker.of_rigid_body((0.0, 0.0, 0.0), 2.0 * np.eye(3))}
    with pytest.raises(ValueError, match="axes must be perpendicular unit vectors"):
        VolumeIntegrals.rigid(1.0, inertia=(1.0, 1.0, 1.0), markers=bad).validate("body")
