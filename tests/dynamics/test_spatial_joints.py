# SPDX-License-Identifier: MIT
"""Joints and forces in space: what they leave free, what they carry, what is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared.spatial_bodies import cloud

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Trajectory
from dolfinx_ffr.dynamics.kinematics import is_spatial, place_vectors, reversed_row
from dolfinx_ffr.dynamics.model import assemble_model
from dolfinx_ffr.mechanism import AppliedForce, Joint

PIN, GROUND, ORIGIN = ("body", "pin"), ffr.Ground(), (0.0, 0.0, 0.0)
SOFT = ffr.SpringDamper(PIN, GROUND, 5.0, name="s")


def block(**markers: tuple[float, float, float]) -> ffr.VolumeIntegrals:
    """A rigid body of mass 2 with its centre at the origin of its frame."""
    points = {"pin": (0.0, 0.0, 0.0), "end": (0.3, 0.1, 0.2), **markers}
    return ffr.VolumeIntegrals.rigid(2.0, inertia=(0.2, 0.3, 0.4), markers=points)


def two_kinds() -> Trajectory:
    """A body in the plane and one in space."""
    bodies = {"body": ffr.VolumeIntegrals.rigid(1.0, inertia=0.1), "other": cloud(2)}
    mechanism = ffr.Mechanism(dict.fromkeys(bodies, ffr.Placement()))
    return ffr.simulate(mechanism, bodies, ffr.GeneralizedAlpha(0.1, 4))


def motion(*joints: Joint, end: float = 0.5, steps: int = 50, **scene: Any) -> Trajectory:
    """A block with joints from a placement at rest."""
    placement = scene.pop("placement", ffr.Placement(ORIGIN))
    mechanism = ffr.Mechanism({"body": placement}, joints, **scene)
    return ffr.simulate(mechanism, {"body": block()}, ffr.GeneralizedAlpha(end, steps))


def test_forces_and_moments_of_joints() -> None:
    """They balance what acts on a block at rest, about the axes that the pages name."""
    force, moment = np.array([1.0, -2.0, 0.5]), np.array([0.3, -0.2, 0.4])
    loads = [ffr.Force(PIN, *force[:2], z=force[2]), ffr.Torque(PIN, tuple(moment))]

    def found(joint: Joint) -> np.ndarray:
        return motion(joint, forces=loads).joint_force("joint")[-1]

    weld = ffr.Weld(PIN, GROUND, name="joint")
    np.testing.assert_allclose(found(weld), [*-force, *-moment], atol=1e-12)
    for axis, others in (((0, 0, 1.0), (0, 1)), ((1.0, 0, 0), (1, 2)), ((0, 1.0, 0), (2, 0))):
        loads[1] = ffr.Torque(PIN, tuple(moment * (1.0 - np.array(axis))))
        expected = [*-force, *-moment[list(others)]]
        hinge = ffr.Revolute(PIN, GROUND, "joint", axis)
        np.testing.assert_allclose(found(hinge), expected, atol=1e-12)
    # Along x: forces along y and z, moments about y, z and x; the last torque is not about y.
    expected = [-force[1], -force[2], 0.0, -moment[2], -moment[0]]
    slider = ffr.Translational(PIN, GROUND, name="joint")
    np.testing.assert_allclose(found(slider), expected, atol=1e-12)


def test_driven_shaft_turns_many_times_and_needs_its_moment() -> None:
    axis, rate = (0.0, 1.0, 1.0), 40.0
    trajectory = motion(
        ffr.Revolute(PIN, GROUND, axis=axis),
        ffr.PrescribedAngle(
            PIN, ffr.Motion.polynomial([0.0, 0.0, 0.5 * rate]), name="drive", axis=axis
        ),
        end=1.0,
        steps=400,
    )
    # The moment of inertia about the axis, through the centre of mass.
    np.testing.assert_allclose(
        trajectory.joint_force("drive")[:, 0], rate * 0.5 * (0.3 + 0.4), rtol=1e-9
    )
    turn = np.linalg.norm(trajectory.y[:, 3:6], axis=1)
    np.testing.assert_allclose(turn, 0.5 * rate * trajectory.t**2, atol=1e-9)


def test_follower_moment_keeps_its_axis() -> None:
    """About a principal axis of a free body that lies askew."""
    trajectory = motion(
        placement=ffr.Placement(ORIGIN, rotation=(0.4, -0.3, 0.2)),
        forces=[ffr.Torque(PIN, (0.0, 6.0, 0.0), follower=True)],
        end=0.2,
    )
    np.testing.assert_allclose(trajectory.v[:, 4], 20.0 * trajectory.t, atol=1e-10)
    np.testing.assert_allclose(trajectory.v[:, [3, 5]], 0.0, atol=1e-12)


def test_bushing_has_a_stiffness_along_and_about_each_axis() -> None:
    """Small vibrations of a block on its centre."""
    along, about = (300.0, 200.0, 100.0), (3.0, 5.0, 7.0)
    small = 1e-4
    trajectory = motion(
        placement=ffr.Placement(
            ORIGIN, velocity=(small,) * 3, angular_velocity=(small, -small, small)
        ),
        forces=[ffr.Bushing(PIN, GROUND, along, torsional_stiffness=about)],
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
    turned = [
        ffr.Ground(np.zeros(3), rotation=Q) for Q in (np.eye(3), np.eye(3), np.eye(3)[[1, 2, 0]])
    ]
    assert turned[0] == turned[1]
    assert turned[0] != turned[2]
    joints = [ffr.PointOnPlane(PIN, marker) for marker in turned[1:]]
    trajectory = motion(*joints, gravity=(1.0, 2.0, 3.0), end=0.1, steps=10)
    np.testing.assert_allclose(trajectory.y[-1, :3], (0.005, 0.0, 0.0), atol=1e-12)


def test_acceleration_of_the_ground_is_felt() -> None:
    trajectory = motion(ground_acceleration=(1.0, 2.0, 3.0), gravity=(0.0, 0.0, -9.81), end=0.1)
    np.testing.assert_allclose(trajectory.v[-1, :3], (-0.1, -0.2, -1.281), atol=1e-12)


@pytest.mark.parametrize("joint", [ffr.Revolute(PIN, GROUND), ffr.Weld(PIN, GROUND)])
@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (math.pi, 0.0, 0.0), (0.0, 0.0, math.pi)])
def test_axis_the_other_way_round_is_noticed(joint: Joint, turn: tuple[float, ...]) -> None:
    """The rows of a joint hold for a reversed axis, too."""
    mechanism = ffr.Mechanism({"body": ffr.Placement(ORIGIN)}, [joint])
    model = assemble_model(mechanism, {"body": block()}, np.linspace(0.0, 1.0, 2))
    assert is_spatial(model.arrays)
    before, after = (
        place_vectors(model.arrays, 0, np.array([0.0, 0.0, 0.0, *phi])) for phi in ([0.0] * 3, turn)
    )
    wrong = any(turn) and (isinstance(joint, ffr.Weld) or turn[0] > 0.0)
    row = reversed_row(model.arrays, model.joints.values(), before, after)
    assert (row >= 0) == wrong


FOUR = [(0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 1.0, 0.0), (1.0, 0.0, 0.0)]


def four_bar(last: type[Joint]) -> Trajectory:
    """A parallelogram with hinges about z."""
    bar = ffr.VolumeIntegrals.rigid(
        1.0, (0.5, 0, 0), (0.01, 0.1, 0.1), {"a": (0, 0, 0), "b": (1.0, 0, 0)}
    )
    turn = {0: math.pi / 2.0, 1: 0.0, 2: -math.pi / 2.0}
    mechanism = ffr.Mechanism(
        {f"bar {k}": ffr.Placement(FOUR[k], rotation=(0.0, 0.0, turn[k])) for k in range(3)},
        joints=[
            ffr.Revolute(("bar 0", "a"), GROUND, "first"),
            ffr.Revolute(("bar 1", "a"), ("bar 0", "b")),
            ffr.Revolute(("bar 2", "a"), ("bar 1", "b")),
            last(("bar 2", "b"), ffr.Ground(FOUR[3]), name="last"),  # type: ignore[call-arg]
        ],
        gravity=(0.0, -9.81, 0.0),
    )
    return ffr.simulate(
        mechanism, {f"bar {k}": bar for k in range(3)}, ffr.GeneralizedAlpha(0.1, 20)
    )


def test_redundant_rows_are_refused_with_a_proposal() -> None:
    message = (
        r"3 of the 20 constraints are redundant; joints involved: .*'first'.*'last' need not hold "
        "1 position and 2 rotations: in place of a Revolute, a Spherical leaves"
    )
    with pytest.raises(ValueError, match=message):
        four_bar(ffr.Revolute)
    # A ball at the end still holds one position too many: that out of the plane.
    with pytest.raises(ValueError, match="'last' need not hold 1 position"):
        four_bar(ffr.Spherical)


@pytest.mark.parametrize(
    ("joint", "force"),
    [
        (ffr.PrescribedAngle(PIN, ffr.Motion.constant(0.0), name="loose"), None),
        (ffr.mechanism.AngleCoupling(PIN, GROUND, 1.0, name="loose"), None),
        (
            ffr.Spherical(PIN, GROUND),
            ffr.TorsionalSpringDamper(PIN, GROUND, 1.0, name="loose"),
        ),
        (
            ffr.Spherical(PIN, GROUND),
            ffr.Bushing(PIN, GROUND, (1.0,) * 3, torsional_stiffness=(1e-3,) * 3, name="loose"),
        ),
    ],
    ids=lambda value: type(value).__name__,
)
def test_an_axis_that_nothing_holds_is_reported(joint: Joint, force: AppliedForce | None) -> None:
    turn = ffr.Placement(ORIGIN, angular_velocity=(1.5, 2.0, 0.0))
    with pytest.warns(
        ffr.dynamics.TiltedAxisWarning, match="'loose': the axes of its markers differ by [01]"
    ):
        motion(joint, forces=[force] if force else [], placement=turn)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: motion(ffr.Revolute(PIN, ffr.Ground((1.0, 0.0)), "hinge")),
            "joint 'hinge': marker 'ground' is in the plane, but body 'body' is in space",
        ),
        (
            lambda: motion(placement=ffr.Placement((0.1, 0.2), 0.3)),
            "placement of body 'body' is in the plane, but body 'body' is in space",
        ),
        (lambda: motion(gravity=(0.0, -9.81)), "gravity with 2 components is in the plane"),
        (
            lambda: ffr.Revolute(PIN, GROUND, axis=(0, 0, 0)).validate("x"),
            "axis has no length",
        ),
        (
            lambda: motion(ffr.Universal(PIN, GROUND, (1.0, 0, 0), (1.0, 0, 0), "cross")),
            "two axes of the universal joint must be perpendicular.*are parallel",
        ),
        (
            lambda: motion(ffr.Universal(PIN, GROUND, (1.0, 0, 0), (1.0, 0, 1.0), "cross")),
            "joint 'cross': .* must be perpendicular, but in the placements they are at 45 degrees",
        ),
        (
            lambda: ffr.Revolute(PIN, GROUND, axis=(1e300, 1e300, 0.0)).validate("x"),
            r"the axis is too long, 1.41e\+300; give a direction",
        ),
        (
            lambda: ffr.Bushing(PIN, GROUND, (math.inf, 1.0, 1.0)).validate("b"),
            "must be finite; a joint holds without giving way",
        ),
        (
            lambda: ffr.VolumeIntegrals.rigid(2.0, (0.0, 0.0, 0.0), 0.4),
            r"in space the inertia is a tensor, or three .* of a ball it is \(0.4, 0.4, 0.4\)",
        ),
        (
            lambda: ffr.VolumeIntegrals.rigid(2.0, None, 0.4, {"pin": (0.0, 0.0, 0.0)}),
            "in space the inertia is a tensor, or three moments",
        ),
        (
            lambda: motion(ffr.Weld(PIN, GROUND, 0.3)),
            "in space the placements give the relative rotation",
        ),
        (
            lambda: motion(forces=[ffr.Torque(PIN, 1.0)]),
            "in space the moment has three components",
        ),
        (lambda: ffr.Torque(PIN, (1.0, 2.0)).validate("t"), "moment has three components"),
        (
            lambda: ffr.Placement(ORIGIN, 0.3).validate("placement"),
            "in space give a rotation instead of an angle",
        ),
        (
            lambda: ffr.Placement(ORIGIN, rotation=2.0 * np.eye(3)).validate("placement"),
            "must be the matrix of a rotation",
        ),
        (
            lambda: ffr.Placement(ORIGIN, angular_velocity=1.0).validate("placement"),
            "angular_velocity must have three components",
        ),
        (lambda: ffr.Ground((1.0, 0.0, 0.0), 0.2), "axes turn by a rotation, not by an angle"),
        (
            lambda: motion(forces=[SOFT]),
            "force 's': the markers coincide in the placements",
        ),
        (
            lambda: motion(forces=[replace(SOFT, length=0.3)]),
            "force 's': the markers coincide at the start",
        ),
        (
            lambda: motion(ffr.Distance(PIN, GROUND, name="strut")),
            "joint 'strut': the markers coincide in the placements; a Spherical joins them",
        ),
        (two_kinds, "body 'other' is in space, but body 'body' is in the pl"),
    ],
)
def test_what_does_not_fit_is_refused(make, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_markers_have_axes_of_their_own(tmp_path: Path) -> None:
    """Axes of joints and directions of followers are given in them; files keep them."""
    Q = Rotation.from_rotvec((0.5, -0.3, 0.8)).as_matrix()
    turned = ffr.VolumeIntegrals.rigid(
        2.0,
        inertia=(0.2, 0.3, 0.4),
        markers={"pin": ffr.BodyMarker.of_rigid_body((0.1, 0.0, 0.0), Q), "end": (0.3, 0.1, 0.2)},
    )
    turned.save(tmp_path / "turned.npz")
    axis = np.array([0.0, 0.6, 0.8])

    def spin(body: ffr.VolumeIntegrals, direction: np.ndarray) -> Trajectory:
        mechanism = ffr.Mechanism(
            {"body": ffr.Placement(ORIGIN)},
            [ffr.Revolute(ffr.Ground((0.1, 0.0, 0.0)), ("body", "pin"), axis=tuple(direction))],
            forces=[ffr.Torque(("body", "pin"), tuple(2.0 * direction), follower=True)],
        )
        return ffr.simulate(mechanism, {"body": body}, ffr.GeneralizedAlpha(0.5, 50))

    plain = ffr.VolumeIntegrals.rigid(
        2.0, inertia=(0.2, 0.3, 0.4), markers={"pin": (0.1, 0.0, 0.0)}
    )
    expected = spin(plain, Q @ axis)
    for body in (turned, ffr.VolumeIntegrals.load(tmp_path / "turned.npz")):
        np.testing.assert_allclose(spin(body, axis).y, expected.y, atol=1e-12)
    bad = {"pin": ffr.BodyMarker.of_rigid_body((0.0, 0.0, 0.0), 2.0 * np.eye(3))}
    with pytest.raises(
        ValueError, match=r"axes must be .* whose columns are perpendicular unit vectors"
    ):
        ffr.VolumeIntegrals.rigid(1.0, inertia=(1.0, 1.0, 1.0), markers=bad).validate("body")


@pytest.mark.parametrize("digits", [6, 16])
def test_rounded_rotation_matrices_are_taken(digits: int) -> None:
    """That of the nearest rotation, for placements, the ground and markers alike."""
    rotation = Rotation.from_rotvec([0.4, -0.3, 1.1])
    rounded = np.round(rotation.as_matrix(), digits)
    marker = ffr.BodyMarker.of_rigid_body((0.0, 0.0, 0.0), axes=rounded)
    body = ffr.VolumeIntegrals.rigid(2.0, inertia=(0.2, 0.3, 0.4), markers={"pin": marker})
    body.validate("body")
    placed = ffr.Placement(ORIGIN, rotation=rounded)
    ground = ffr.Ground((0.0, 0.0, 0.0), rotation=rounded.tolist())
    mechanism = ffr.Mechanism({"body": placed}, [ffr.Weld(("body", "pin"), ground)])
    trajectory = ffr.simulate(mechanism, {"body": body}, ffr.GeneralizedAlpha(0.1, 1))
    np.testing.assert_allclose(trajectory.rotation("body")[0], rotation.as_matrix(), atol=1e-6)
    table = ground.tabulate_in_space(np.zeros(1), "here")[0, 0, 1:]
    for A in (body.markers["pin"].axes, table, trajectory.rotation("body")[0]):
        np.testing.assert_allclose(A @ A.T, np.eye(3), atol=1e-14)


@pytest.mark.parametrize(
    "make",
    [
        lambda: ffr.Placement(angle=90.0).validate("placement"),
        lambda: ffr.Placement(ORIGIN, rotation=(0.0, 90.0, 0.0)).validate("placement"),
        lambda: ffr.Ground((0.0, 0.0), -90.0),
        lambda: ffr.Ground((0.0, 0.0, 0.0), rotation=(90.0, 0.0, 0.0)),
    ],
)
def test_angles_in_degrees_are_asked_about(make: Callable[[], object]) -> None:
    with pytest.warns(ffr.PlacementWarning, match=r"in degrees, give np.deg2rad\(-?90\)"):
        make()
