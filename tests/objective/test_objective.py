# SPDX-License-Identifier: MIT
"""Objectives: values, derivatives through the whole mechanical chain, refused names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import scipy.optimize
from shared.beams import beam
from shared.derivatives import along, check_slope, difference, dot, moved, random_direction
from shared.motions import yoke
from shared.scenes import Bodies, four_bar, robot
from shared.spatial_bodies import cloud

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Trajectory, simulate
from dolfinx_ffr.objective import DrivePower, DriveWork, ResidualVibration
from dolfinx_ffr.verification import convergence_order


def rigid_path(t: np.ndarray, distance: float = 0.2) -> np.ndarray:
    """Where a point of the robot's arm would be if the arm did not bend, shape (n, 2)."""
    angle = 0.3 + 0.8 * np.sin(7.0 * t)
    lift = 0.3 * t + 1.5 * t**2
    return np.column_stack([distance * np.cos(angle), lift + distance * np.sin(angle)])


ARM_X = ffr.Motion(lambda t: rigid_path(t)[:, 0], np.zeros_like, np.zeros_like)
END = rigid_path(np.linspace(0.0, 0.3, 121), 0.4)
OBJECTIVES: dict[str, tuple[str, ffr.Objective]] = {
    "integral compliance": ("four-bar", ffr.IntegralCompliance(weights={"rocker": 0.5})),
    "mean compliance": ("four-bar", ffr.PeakCompliance(power=1)),
    "peak compliance": ("four-bar", ffr.PeakCompliance(power=8)),
    "path": ("robot", ffr.PathTracking("arm", "middle", (ARM_X, lambda t: rigid_path(t)[:, 1]))),
    "end of a path": (
        "robot",
        ffr.PathTracking("arm", "right", END, (0.2, 0.3), lambda t: 1.0 + t),
    ),
    "velocity": ("four-bar", ffr.MarkerVelocity("coupler", "middle", (0.1, 0.3))),
    "acceleration": ("four-bar", ffr.MarkerAcceleration("coupler", "middle")),
    "acceleration of a rigid body": ("robot", ffr.MarkerAcceleration("rider", "pin")),
    "acceleration at the end": ("robot", ffr.MarkerAcceleration("arm", "right", (0.2, 0.3))),
    "swing after a stop": ("robot", ResidualVibration("arm", "right", (0.2, 0.3), 0.01)),
    "force of a pin": ("four-bar", ffr.JointForce("coupler pin")),
    "peak force of a pin": ("four-bar", ffr.JointForce("rocker bearing", power=12.0)),
    "driving moment": ("four-bar", ffr.JointForce("motor", window=(0.1, 0.3))),
    "force on the frame": ("four-bar", ffr.JointForce(("motor bearing", "rocker bearing"))),
    "force on a rail": ("robot", ffr.JointForce(("rail", "base x", "base y"))),
    "power of drives": ("robot", DrivePower(("swing", "base y"), power=6.0)),
    "power at a moving rail": ("robot", DrivePower("rail")),
    "work with recuperation": ("four-bar", DriveWork("motor", recovered=0.4, window=(0.1, 0.3))),
    "force of a weld": ("robot", ffr.JointForce("flange")),
    "moment of a weld": ("robot", ffr.JointForce("flange", moment=True, power=3.0)),
    "mass": ("four-bar", ffr.Mass("coupler")),
    "frequency": ("four-bar", ffr.Frequency("rocker")),
    "cluster of frequencies": ("four-bar", ffr.Frequency("coupler", cluster=2)),
    "free frequency": ("four-bar", ffr.Frequency("coupler", number=2, free=True)),
    "free one with what hangs on it": (
        "robot",
        ffr.Frequency("arm", cluster=3, free=True, point_masses=True),
    ),
    "sum": (
        "four-bar",
        1e4 * ffr.IntegralCompliance()
        - 2.0 * ffr.Mass("rocker")
        + 1e-3 * ffr.MarkerAcceleration("rocker", "left")
        + ffr.JointForce("coupler pin") * 0.1,
    ),
}
#: First step of the Taylor tests: the mode shapes of the four-bar nearly contain rigid motions.
STEP = {"four-bar": 2e-4, "robot": 4e-4}


SCENES = {"four-bar": four_bar(), "robot": robot()}
DIRECTIONS = {name: random_direction(scene.bodies, 3) for name, scene in SCENES.items()}


@cache
def response(name: str, step: float) -> ffr.Response:
    """The motion of a scene with its bodies moved along their direction, for all objectives."""
    scene = SCENES[name]
    bodies = moved(scene.bodies, DIRECTIONS[name], step)
    trajectory = simulate(scene.mechanism, bodies, scene.integrator)
    return ffr.Response(trajectory, bodies, point_masses=scene.mechanism.point_masses)


@pytest.mark.parametrize("name", list(OBJECTIVES))
def test_taylor_order_through_the_mechanical_chain(name: str) -> None:
    objective_scene, objective = OBJECTIVES[name]
    scene = SCENES[objective_scene]
    problem = ffr.MechanicalProblem(scene.mechanism, scene.integrator, objective)
    gradient = problem.gradient(scene.bodies).integrals_gradient
    assert gradient is not None
    assert list(gradient) == list(scene.bodies)

    def psi(step: float) -> float:
        return problem.evaluated(response(objective_scene, float(step))).psi

    result = check_slope(
        psi, dot(gradient, DIRECTIONS[objective_scene]), STEP[objective_scene], points=4
    )
    if name != "mass":  # the test must be able to see a wrong derivative
        assert result.remainders[0] < 0.5 * result.differences[0]
    assert result.slope == pytest.approx(difference(psi, 0.3 * STEP[objective_scene]), rel=1e-6)


#: A motion, its bodies, and both as objectives take them
Moved = tuple[Trajectory, Bodies, ffr.Response]


@pytest.fixture(scope="module")
def motion() -> Moved:
    scene = four_bar(steps=60)
    trajectory = simulate(scene.mechanism, scene.bodies, scene.integrator)
    return trajectory, scene.bodies, ffr.Response(trajectory, scene.bodies)


def test_compliance_is_twice_the_integral_of_the_strain_energy(motion: Moved) -> None:
    trajectory, bodies, response = motion
    expected = {
        name: 2.0 * scipy.integrate.trapezoid(trajectory.strain_energy(name), trajectory.t)
        for name in bodies
    }
    assert expected["coupler"] > 0.0
    for name in bodies:
        value = ffr.IntegralCompliance([name]).evaluate(response)
        assert value == pytest.approx(expected[name], rel=1e-13)
    total = ffr.IntegralCompliance().evaluate(response)
    assert total == pytest.approx(sum(expected.values()), rel=1e-13)
    weighted = ffr.IntegralCompliance(weights={"coupler": 3.0}).evaluate(response)
    assert weighted == pytest.approx(total + 2.0 * expected["coupler"], rel=1e-13)


def test_peak_lies_between_mean_and_maximum(motion: Moved) -> None:
    trajectory, bodies, response = motion
    compliance = sum(2.0 * trajectory.strain_energy(name) for name in bodies)
    duration = trajectory.t[-1]
    mean = ffr.IntegralCompliance().evaluate(response) / duration
    powers = (1.0, 2.0, 8.0, 64.0, 1000.0)
    values = [ffr.PeakCompliance(power=p).evaluate(response) for p in powers]
    assert values[0] == pytest.approx(mean, rel=1e-13)
    assert np.all(np.diff(values) > 0.0)
    # One step out of 60 carries at least 1/120 of the weight.
    assert np.max(compliance) * 120.0**-1e-3 <= values[-1] <= np.max(compliance)


@pytest.mark.parametrize("size", [1e-200, 1e150])
def test_peak_does_not_overflow(motion: Moved, size: float) -> None:
    trajectory, bodies, response = motion
    scaled = {name: replace(body, K=size * body.K) for name, body in bodies.items()}
    peak = ffr.PeakCompliance(power=100.0)
    expected = size * peak.evaluate(response)
    assert peak.evaluate(ffr.Response(trajectory, scaled)) == pytest.approx(expected, rel=1e-12)
    bars = peak.derivatives(ffr.Response(trajectory, scaled)).integrals
    np.testing.assert_allclose(
        bars["coupler"].K, peak.derivatives(response).integrals["coupler"].K, rtol=1e-10
    )


def test_forces_outside_the_window_do_not_matter(motion: Moved) -> None:
    trajectory, bodies, response = motion
    objective = ffr.JointForce("motor", power=100.0, window=(0.1, 0.2))
    knocked = replace(trajectory, multipliers=trajectory.multipliers.copy())
    knocked.multipliers[-1] = 1e100
    assert objective.evaluate(ffr.Response(knocked, bodies)) == objective.evaluate(response)
    bar = objective.derivatives(ffr.Response(knocked, bodies)).trajectory
    expected = objective.derivatives(response).trajectory
    np.testing.assert_array_equal(bar.multipliers, expected.multipliers)


WINDOW = (0.5123, 0.5234)


@pytest.mark.parametrize(
    "integrator",
    [
        ffr.GeneralizedAlpha(2.0, 500),
        ffr.RadauIIA(2.0, steps=200),
        ffr.TimeInterval(2.0, 1e-2),
    ],
)
@pytest.mark.parametrize("window", [WINDOW, (0.7771, 5.0), (-1.0, 0.3333)])
def test_a_window_is_integrated_to_its_own_ends(
    integrator: ffr.Integrator, window: tuple[float, float]
) -> None:
    """Wherever they are within the steps; a slide is moved back and forth as prescribed."""
    mechanism, bodies = yoke()
    path = ffr.PathTracking("yoke", "pin", (0.0, 0.0), window=window)
    problem = ffr.MechanicalProblem(mechanism, integrator, path)
    begin, end = max(window[0], 0.0), min(window[1], 2.0)
    # of (0.1 sin(15 t))^2
    exact = 0.005 * (end - begin - (np.sin(30.0 * end) - np.sin(30.0 * begin)) / 30.0)
    assert problem.value(bodies).psi == pytest.approx(exact, rel=1e-2)


def test_body_at_rest_has_no_peak(motion: Moved) -> None:
    trajectory, bodies, _ = motion
    at_rest = replace(trajectory, y=np.zeros_like(trajectory.y))
    assert ffr.PeakCompliance().evaluate(ffr.Response(at_rest, bodies)) == 0.0
    bar = ffr.PeakCompliance().derivatives(ffr.Response(at_rest, bodies)).trajectory
    assert not bar.y.any()


def test_path_beside_the_motion(motion: Moved) -> None:
    trajectory, _, response = motion
    path = trajectory.marker_path("coupler", "middle") + np.array([0.3, -0.4])
    objective = ffr.PathTracking("coupler", "middle", path)
    assert objective.evaluate(response) == pytest.approx(0.25 * 0.3, rel=1e-13)
    # 60 steps of 5 ms: the window holds 20 of them.
    end = replace(objective, window=(0.2, 0.3))
    assert end.evaluate(response) == pytest.approx(0.25 * 0.1, rel=1e-12)
    bar = end.derivatives(response).trajectory
    assert not bar.y[:40].any()
    assert bar.y[40:].any()
    weighted = replace(objective, weight=2.0 * trajectory.t)
    assert weighted.evaluate(response) == pytest.approx(0.25 * 0.3**2, rel=1e-12)


def spinning(omega: float, gravity: float = 0.0) -> tuple[Trajectory, ffr.Response]:
    """A rigid bar of 2 kg on a bearing at the origin, turned by a motor."""
    bar = ffr.VolumeIntegrals.rigid(2.0, (0.25, 0.0), 0.1, {"hub": (0, 0), "tip": (0.4, 0.3)})
    mechanism = ffr.Mechanism(
        {"bar": ffr.Placement()},
        [
            ffr.Revolute(("bar", "hub"), ffr.Ground(), name="bearing"),
            ffr.PrescribedAngle(("bar", "hub"), ffr.Motion.polynomial([0.0, omega]), name="motor"),
        ],
        gravity=(0.0, -gravity),
    )
    trajectory = simulate(mechanism, {"bar": bar}, ffr.GeneralizedAlpha(0.5, 50))
    return trajectory, ffr.Response(trajectory, {"bar": bar})


def test_uniform_rotation_and_weight_at_rest() -> None:
    trajectory, response = spinning(omega=7.0)
    tip = ffr.MarkerAcceleration("bar", "tip")
    # Towards the centre: omega^2 times the distance of 0.5 m.
    path = trajectory.marker_path("bar", "tip")
    np.testing.assert_allclose(tip.vectors(response), -49.0 * path, atol=1e-9)
    assert tip.evaluate(response) == pytest.approx(24.5**2 * 0.5, rel=1e-10)
    speed = ffr.MarkerVelocity("bar", "tip").evaluate(response)
    assert speed == pytest.approx(3.5**2 * 0.5, rel=1e-10)
    # A whole turn about the mean, by place and by velocity over omega alike.
    whole_turns = spinning(omega=4.0 * np.pi)[1]
    swing = ResidualVibration("bar", "tip", tau=0.25 / np.pi)
    assert swing.evaluate(whole_turns) == pytest.approx(2.0 * 0.25, rel=1e-9)
    with pytest.raises(ValueError, match="residual vibration: the place"):
        ResidualVibration("bar", "tip", place=(0.0, 0.0, 0.0)).evaluate(whole_turns)
    # The bearing holds 2 kg at 0.25 m on their circle.
    for power in (1.5, 2.0, 40.0):
        force = ffr.JointForce("bearing", power=power).evaluate(response)
        assert force == pytest.approx(2.0 * 49.0 * 0.25, rel=1e-9)
    assert ffr.JointForce("motor").evaluate(response) == pytest.approx(0.0, abs=1e-9)
    _, response = spinning(omega=0.0, gravity=10.0)
    assert ffr.JointForce("bearing").evaluate(response) == pytest.approx(20.0, rel=1e-11)
    assert ffr.JointForce("motor").evaluate(response) == pytest.approx(5.0, rel=1e-11)


def test_forces_on_the_frame_add_up_as_vectors() -> None:
    """Of two bars in mirrored turns those along y cancel, whichever marker a joint names first."""
    bodies, joints = {}, list[ffr.mechanism.Joint]()
    for name, sense in (("one", 1.0), ("two", -1.0)):
        bodies[name] = ffr.VolumeIntegrals.rigid(2.0, (0.25, 0.0), 0.1, {"hub": (0, 0)})
        turn, pair = (
            ffr.Motion.polynomial([0.0, sense * 4.0 * np.pi]),
            [(name, "hub"), ffr.Ground()],
        )
        joints.append(ffr.Revolute(*(pair if sense > 0 else pair[::-1]), name=f"bearing {name}"))
        joints.append(ffr.PrescribedAngle((name, "hub"), turn))
    mechanism = ffr.Mechanism({"one": ffr.Placement(), "two": ffr.Placement()}, joints)
    response = ffr.Response(simulate(mechanism, bodies, ffr.GeneralizedAlpha(0.5, 400)), bodies)
    square_of_spin = 2.0 * 0.25 * (4.0 * np.pi) ** 2
    force = ffr.JointForce(("bearing one", "bearing two"))
    assert force.evaluate(response) == pytest.approx(np.sqrt(2.0) * square_of_spin, rel=1e-8)
    assert force.largest(response) == pytest.approx(2.0 * square_of_spin, rel=1e-8)
    # at the start, where both bars lie along x, all of it is left
    start = replace(force, window=(0.0, 0.01)).evaluate(response)
    assert start == pytest.approx(2.0 * square_of_spin, rel=1e-2)
    assert ffr.JointForce(("bearing two",)).evaluate(response) == pytest.approx(
        square_of_spin, rel=1e-8
    )


def test_acceleration_is_the_second_derivative_of_the_path(motion: Moved) -> None:
    """Coordinates that are known functions of time, whose path is differenced."""
    trajectory, bodies, _ = motion
    rng = np.random.default_rng(0)
    rate, phase = rng.uniform(1.0, 9.0, trajectory.y.shape[1]), rng.uniform(0.0, 6.0)
    errors = []
    for steps in (200, 400, 800):
        t = np.linspace(0.0, 1.0, steps + 1)
        angle = rate * t[:, None] + phase
        moving = replace(
            trajectory,
            t=t,
            y=0.3 * np.sin(angle),
            v=0.3 * rate * np.cos(angle),
            w=-0.3 * rate**2 * np.sin(angle),
        )
        path = moving.marker_path("coupler", "middle")
        second = (path[2:] - 2.0 * path[1:-1] + path[:-2]) * steps**2
        a = ffr.MarkerAcceleration("coupler", "middle").vectors(ffr.Response(moving, bodies))
        errors.append(np.max(np.abs(second - a[1:-1])) / np.max(np.abs(a)))
    assert errors[-1] < 1e-4
    assert convergence_order([4.0, 2.0, 1.0], errors) == pytest.approx(2.0, abs=0.05)


def hanging(rod: ffr.VolumeIntegrals) -> ffr.Response:
    """A rod with a mass at its last marker, and another body's mass."""
    places = ("rod", list(rod.markers)[-1]), ("another", "right")
    return ffr.Response(None, {"rod": rod}, point_masses=[ffr.PointMass(p, 0.3) for p in places])


def frequency(rod: ffr.VolumeIntegrals, number: int = 1, **options: Any) -> float:
    return ffr.Frequency("rod", number, **options).evaluate(hanging(rod))


def tip_root(ratio: float) -> float:
    """Root of the first frequency of a clamped beam with a mass at its end, relative to its own."""

    def condition(b: float) -> float:
        sway = np.cos(b) * np.sinh(b) - np.sin(b) * np.cosh(b)
        return float(1.0 + np.cos(b) * np.cosh(b) + ratio * b * sway)

    return float(scipy.optimize.brentq(condition, 0.1, 1.9))


def test_frequencies_of_a_beam() -> None:
    """Cantilever and free beam against Euler and Bernoulli; of free ones in any frame."""
    length, speed = 0.4, np.sqrt(2.1e11 / 7850.0) * 0.01 / np.sqrt(12.0)
    size = {"height": 0.01, "elements": 10, "modes": 25}
    clamped, floating = (beam(length, frame=frame, **size) for frame in ("tangent", "free"))
    for computed, root in (
        (frequency(clamped), 1.87510406871196),
        (frequency(clamped, 2), 4.69409113297417),
        (frequency(floating), 4.73004074486270),
        (frequency(floating, free=True), 4.73004074486270),
        (frequency(clamped, pinned=["right"]), 3.92660231204792),
        (frequency(clamped, point_masses=True), tip_root(0.3 / clamped.mass)),
    ):
        assert computed == pytest.approx((root / length) ** 2 * speed / (2 * np.pi), rel=1e-4)
    tangent, chord = (beam(frame=frame, elements=3, modes=9) for frame in ("tangent", "chord"))
    for number in range(1, 6):
        expected = pytest.approx(frequency(chord, number, free=True), rel=1e-9)
        assert frequency(tangent, number, free=True) == expected


def test_frequency_by_a_mass_that_is_designed() -> None:
    """The mass is a parameter of a mechanism that is not simulated."""

    def machine(tip: float) -> ffr.Mechanism:
        weights = [ffr.PointMass(("rod", "right"), tip)]
        return ffr.Mechanism({"rod": ffr.Placement()}, point_masses=weights)

    mechanism = ffr.Parameters(tip=(0.3, 0.1, 0.5)).mechanism(machine)
    objective, bodies = ffr.Frequency("rod", point_masses=True), {"rod": beam(frame="tangent")}
    problem = ffr.MechanicalProblem(mechanism, ffr.GeneralizedAlpha(0.1, 2), objective)
    slope = problem.gradient(bodies).parameters["tip"]
    check_slope(lambda way: problem.at([0.3 + way]).value(bodies).psi, slope, 0.02)


def test_cluster_of_equal_frequencies_has_a_derivative() -> None:
    rod = beam(modes=4, elements=6)
    _, vectors = scipy.linalg.eigh(rod.K, rod.G[1:, 1:])
    dual = rod.G[1:, 1:] @ vectors
    bodies = {"rod": replace(rod, K=(dual * np.array([4.0, 4.0, 4.0, 9.0]) * 1e6) @ dual.T)}
    cluster = ffr.Frequency("rod", cluster=3)
    assert cluster.evaluate(ffr.Response(None, bodies)) == pytest.approx(
        2e3 / (2 * np.pi), rel=1e-12
    )
    bars = cluster.derivatives(ffr.Response(None, bodies)).integrals
    direction = random_direction(bodies, 2, "GK")
    value = along(lambda moved: cluster.evaluate(ffr.Response(None, moved)), bodies, direction)
    check_slope(value, dot(bars, direction), 1e-3)
    with pytest.warns(UserWarning, match="frequencies 2 and 3 of body 'rod' are equal"):
        ffr.Frequency("rod", cluster=2).derivatives(ffr.Response(None, bodies))


def test_sums(motion: Moved) -> None:
    _, _, response = motion
    a, b, c = ffr.IntegralCompliance(), ffr.JointForce("motor"), ffr.Mass("coupler")
    total = 0.3 * a - b + sum([c, 2.0 * (a + b) * 0.5])
    assert [weight for weight, _ in total.terms] == [0.3, -1.0, 1.0, 1.0, 1.0]
    values = [objective.evaluate(response) for objective in (a, b, c)]
    assert total.evaluate(response) == pytest.approx(1.3 * values[0] + values[2], rel=1e-12)
    assert (-c).evaluate(response) == -values[2]
    assert total.needs_trajectory
    assert not (c + ffr.Frequency("rocker")).needs_trajectory
    assert ffr.Sum([(2.0, c), (1.0, ffr.Mass("rocker"))]).derivatives(response).trajectory is None


UNKNOWN_BODY = r"of body 'rod', but the bodies are \['crank', 'coupler'"


@pytest.mark.parametrize(
    ("objective", "message"),
    [
        (ffr.IntegralCompliance(["rod"]), UNKNOWN_BODY),
        (ffr.IntegralCompliance(weights={"rod": 1.0}), UNKNOWN_BODY),
        (ffr.Mass("crank") + 2.0 * ffr.Mass("rod"), UNKNOWN_BODY),
        (
            ffr.MarkerAcceleration("rocker", "tip"),
            r"marker 'tip', but the markers of body 'rocker' are \['left', 'middle', 'right'\]",
        ),
        (ffr.JointForce("pin"), r"joint 'pin', but the joints are \['motor bearing', 'crank pin'"),
        (DrivePower("pin"), r"joint 'pin', but the joints are \['motor bearing', 'crank pin'"),
        (DriveWork("crank pin"), r"'crank pin' has no drive.* prescribed motion are \['motor'\]"),
        (ffr.JointForce("crank pin", moment=True), "joint 'crank pin' carries no moment"),
        (ffr.JointForce(("motor bearing", "crank pin")), "joint 'crank pin' connects two bodies"),
        (ffr.JointForce(("motor",)), "carry no forces"),
        (
            ffr.Frequency("rocker", number=2, cluster=2),
            "2 elastic coordinates, too few for .* 2 to 3",
        ),
        (ffr.Frequency("crank"), "'crank' is rigid and has no frequency"),
        (ffr.Frequency("rocker", point_masses=True), "does not contain the point masses"),
        (ffr.Frequency("rocker", pinned=["tip"]), "marker 'tip', but the markers of body 'rocker'"),
        (ffr.Frequency("rocker", pinned=["middle", "right"]), "besides those that its pins hold"),
        (
            ffr.PathTracking("rocker", "left", np.zeros((60, 2))),
            r"the path has shape \(60, 2\), but with 61 time steps it must have \(61, 2\)",
        ),
        (ffr.PathTracking("rocker", "left", np.full((61, 2), np.nan)), "the path holds NaN"),
        (
            ffr.PathTracking("rocker", "left", (0.0, lambda t: t[:-1])),
            r"path along y at 61 times has shape \(60,",
        ),
        (ffr.PathTracking("rocker", "left", (0.0, 0.0), weight=np.ones(3)), "weight has shape"),
        (
            ffr.PathTracking("rocker", "left", (0.0, 0.0), weight=lambda t: 0.25 - t),
            "the weight is negative, first at t = 0.2",
        ),
        (
            ffr.PathTracking("rocker", "left", (0.0, 0.0), (0.4, 0.5)),
            "window .* is outside of the motion",
        ),
    ],
)
def test_refused_with_the_names_that_exist(
    motion: Moved, objective: ffr.Objective, message: str
) -> None:
    _, _, response = motion
    with pytest.raises(ValueError, match=message):
        objective.evaluate(response)
    with pytest.raises(ValueError, match=message):
        objective.derivatives(response)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ffr.PeakCompliance(weights={"rod": -1.0}), "'rod' must not be negative"),
        (lambda: ffr.JointForce("pin", power=1.0), "with a power of 1 the mean has a kink"),
        (lambda: ffr.JointForce("pin", window=(1.0, 1.0)), "begin < end"),
        (lambda: ffr.JointForce(("pin", "pin")), "one joint, or different names"),
        (lambda: ffr.JointForce(("pin", "hub"), moment=True), "do not add up"),
        (lambda: ffr.Frequency("rod", free=True, pinned=["left"]), "either free or pinned"),
        (lambda: DriveWork("pin", recovered=1.5), "recovered must lie between -1 and 1"),
        (lambda: DriveWork("pin", rounding=0.0), "rounding must be positive"),
        (lambda: ffr.Constraint(ffr.Mass("rod")), "'Mass' needs either an upper or a lower bound"),
        (lambda: ffr.Constraint(ffr.Mass("rod"), 1.0, 2.0), "for both, give two constraints"),
        (
            lambda: ffr.Constraint(ffr.Mass("rod"), 0.0, name="light"),
            "'light': the bound must be a number other than zero",
        ),
    ],
)
def test_refused_when_made(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"free": True},
        {"free": True, "point_masses": True},
        {"pinned": ["root"], "point_masses": True},
    ],
    ids=str,
)
def test_derivative_of_a_frequency(options: dict[str, Any]) -> None:
    """Of a body in space, by mass, S, P, K and the shape functions at its markers."""
    body, rng, objective = cloud(6), np.random.default_rng(5), ffr.Frequency("rod", 2, **options)
    assert body.P is not None
    S, P, K = (rng.standard_normal(array.shape) for array in (body.S, body.P, body.K))
    P, K = P + P.transpose(1, 0, 3, 2), 100.0 * (K + K.T)
    markers = {
        name: replace(marker.scaled(0.0), displacement=rng.standard_normal((3, 6)))
        for name, marker in body.markers.items()
    }
    direction = ffr.VolumeIntegrals.in_space(rng.standard_normal(), S, P, K, markers)
    bars = objective.derivatives(hanging(body)).integrals
    check_slope(
        lambda way: objective.evaluate(hanging(body + direction.scaled(way))),
        bars["rod"].dot(direction),
        1e-4,
    )
    body = cloud(4)
    # without stiffness along one shape there is one zero frequency more
    singular = replace(body, K=np.diag([1.0, 1.0, 1.0, 0.0]))
    with pytest.raises(ValueError, match="frequency 1 of body 'rod' is zero"):
        frequency(singular, free=True)
