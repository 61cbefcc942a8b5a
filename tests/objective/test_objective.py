# SPDX-License-Identifier: MIT
"""Objectives: values, derivatives through the whole mechanical chain, refused names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from shared.beams import beam
from shared.scenes import Bodies, Scene, four_bar, moved, random_direction, robot

from dolfinx_ffr.body.volume_integrals import VolumeIntegrals
from dolfinx_ffr.dynamics import GeneralizedAlpha, Trajectory, simulate
from dolfinx_ffr.mechanical_problem import MechanicalProblem
from dolfinx_ffr.mechanism import Ground, Mechanism, Placement, PrescribedAngle, Revolute
from dolfinx_ffr.mechanism.motion import Motion
from dolfinx_ffr.objective import (
    Constraint,
    Frequency,
    IntegralCompliance,
    JointForce,
    MarkerAcceleration,
    MarkerVelocity,
    Mass,
    Objective,
    PathTracking,
    PeakCompliance,
    Sum,
)
from dolfinx_ffr.verification import (
    assert_taylor_order,
    central_difference,
    convergence_order,
    taylor_test,
)


def rigid_path(t: np.ndarray, distance: float = 0.2) -> np.ndarray:
    """Where a point of the robot's arm would be if the arm did not bend, shape (n, 2)."""
    angle = 0.3 + 0.8 * np.sin(7.0 * t)
    lift = 0.3 * t + 1.5 * t**2
    return np.column_stack([distance * np.cos(angle), lift + distance * np.sin(angle)])


ARM_X = Motion(lambda t: rigid_path(t)[:, 0], np.zeros_like, np.zeros_like)
OBJECTIVES: dict[str, tuple[str, Objective]] = {
    "integral compliance": ("four-bar", IntegralCompliance(weights={"rocker": 0.5})),
    "mean compliance": ("four-bar", PeakCompliance(power=1)),
    "peak compliance": ("four-bar", PeakCompliance(power=8)),
    "peak of one body": ("four-bar", PeakCompliance(["coupler"], power=30.0)),
    "path": ("robot", PathTracking("arm", "middle", (ARM_X, lambda t: rigid_path(t)[:, 1]))),
    "end of a path": (
        "robot",
        PathTracking(
            "arm",
            "right",
            rigid_path(np.linspace(0.0, 0.3, 121), 0.4),
            window=(0.2, 0.3),
            weight=lambda t: 1.0 + t,
        ),
    ),
    "velocity": ("four-bar", MarkerVelocity("coupler", "middle", (0.1, 0.3))),
    "acceleration": ("four-bar", MarkerAcceleration("coupler", "middle")),
    "acceleration of a rigid body": ("robot", MarkerAcceleration("rider", "pin")),
    "acceleration at the end": ("robot", MarkerAcceleration("arm", "right", (0.2, 0.3))),
    "force of a pin": ("four-bar", JointForce("coupler pin")),
    "peak force of a pin": ("four-bar", JointForce("rocker bearing", power=12.0)),
    "driving moment": ("four-bar", JointForce("motor", window=(0.1, 0.3))),
    "force of a weld": ("robot", JointForce("flange")),
    "moment of a weld": ("robot", JointForce("flange", moment=True, power=3.0)),
    "force of a guide": ("robot", JointForce("guide")),
    "mass": ("four-bar", Mass("coupler")),
    "frequency": ("four-bar", Frequency("rocker")),
    "second frequency": ("four-bar", Frequency("coupler", number=2)),
    "cluster of frequencies": ("four-bar", Frequency("coupler", cluster=2)),
    "free frequency": ("four-bar", Frequency("coupler", number=2, free=True)),
    "cluster of free frequencies": ("robot", Frequency("arm", cluster=3, free=True)),
    "sum": (
        "four-bar",
        1e4 * IntegralCompliance()
        - 2.0 * Mass("rocker")
        + 1e-3 * MarkerAcceleration("rocker", "left")
        + JointForce("coupler pin") * 0.1,
    ),
}
#: First step of the Taylor tests: the mode shapes of the four-bar nearly contain rigid motions.
STEP = {"four-bar": 2e-4, "robot": 4e-4}


@pytest.fixture(scope="module")
def scenes() -> dict[str, Scene]:
    return {"four-bar": four_bar(), "robot": robot()}


@pytest.mark.parametrize("name", list(OBJECTIVES))
def test_taylor_order_through_the_mechanical_chain(name: str, scenes: dict[str, Scene]) -> None:
    which, objective = OBJECTIVES[name]
    scene = scenes[which]
    problem = MechanicalProblem(scene.mechanism, scene.integrator, objective)
    gradient = problem.gradient(scene.bodies).integrals_gradient
    assert gradient is not None
    assert list(gradient) == list(scene.bodies)
    direction = random_direction(scene.bodies, 3)
    slope = sum(gradient[body].dot(direction[body]) for body in gradient)

    def along(step: np.ndarray) -> float:
        return problem.value(moved(scene.bodies, direction, float(step))).psi

    steps = [STEP[which] / 2.0**k for k in range(5)]
    result = taylor_test(along, lambda step: float(step) * slope, 0.0, 1.0, steps=steps)
    assert_taylor_order(result, points=4)
    if name != "mass":  # the test must be able to see a wrong derivative
        assert result.remainders[0] < 0.5 * result.differences[0]
    difference = central_difference(along, 0.0, 1.0, 0.3 * STEP[which])
    assert slope == pytest.approx(difference, rel=1e-6)


@pytest.fixture(scope="module")
def motion() -> tuple[Trajectory, Bodies]:
    scene = four_bar(steps=60)
    return simulate(scene.mechanism, scene.bodies, scene.integrator), scene.bodies


def test_is_twice_the_integral_of_the_strain_energy(motion: tuple[Trajectory, Bodies]) -> None:
    trajectory, bodies = motion
    expected = {
        name: 2.0 * scipy.integrate.trapezoid(trajectory.strain_energy(name), trajectory.t)
        for name in bodies
    }
    assert expected["coupler"] > 0.0
    for name in bodies:
        value = IntegralCompliance([name]).value(trajectory, bodies)
        assert value == pytest.approx(expected[name], rel=1e-13)
    total = IntegralCompliance().value(trajectory, bodies)
    assert total == pytest.approx(sum(expected.values()), rel=1e-13)
    weighted = IntegralCompliance(weights={"coupler": 3.0}).value(trajectory, bodies)
    assert weighted == pytest.approx(total + 2.0 * expected["coupler"], rel=1e-13)


def test_pullback_at_fixed_integrals(motion: tuple[Trajectory, Bodies]) -> None:
    trajectory, bodies = motion
    objective = IntegralCompliance(weights={"rocker": 0.5})
    bar, _ = objective.pullback(trajectory, bodies)
    for part in (bar.v, bar.w, bar.multipliers):
        np.testing.assert_array_equal(part, 0.0)
    direction = np.random.default_rng(0).normal(size=trajectory.y.shape) * trajectory.y.std(axis=0)
    result = taylor_test(
        lambda y: objective.value(replace(trajectory, y=y), bodies),
        lambda d: float(np.sum(bar.y * d)),
        trajectory.y,
        direction,
        steps=[0.5 / 2.0**k for k in range(5)],
    )
    assert_taylor_order(result)


def test_pullback_at_fixed_trajectory(motion: tuple[Trajectory, Bodies]) -> None:
    trajectory, bodies = motion
    objective = IntegralCompliance(["coupler"])
    _, explicit = objective.pullback(trajectory, bodies)
    assert not explicit["rocker"].K.any()
    # The value is linear in K.
    doubled = {**bodies, "coupler": replace(bodies["coupler"], K=2.0 * bodies["coupler"].K)}
    growth = objective.value(trajectory, doubled) - objective.value(trajectory, bodies)
    slope = float(np.sum(explicit["coupler"].K * bodies["coupler"].K))
    assert growth == pytest.approx(slope, rel=1e-13)


def test_peak_lies_between_mean_and_maximum(motion: tuple[Trajectory, Bodies]) -> None:
    trajectory, bodies = motion
    compliance = sum(2.0 * trajectory.strain_energy(name) for name in bodies)
    duration = trajectory.t[-1]
    mean = IntegralCompliance().value(trajectory, bodies) / duration
    powers = (1.0, 2.0, 8.0, 64.0, 1000.0)
    values = [PeakCompliance(power=p).value(trajectory, bodies) for p in powers]
    assert values[0] == pytest.approx(mean, rel=1e-13)
    assert np.all(np.diff(values) > 0.0)
    # One step out of 60 carries at least 1/120 of the weight.
    assert np.max(compliance) * 120.0**-1e-3 <= values[-1] <= np.max(compliance)


@pytest.mark.parametrize("size", [1e-200, 1e150])
def test_peak_does_not_overflow(motion: tuple[Trajectory, Bodies], size: float) -> None:
    trajectory, bodies = motion
    scaled = {name: replace(body, K=size * body.K) for name, body in bodies.items()}
    peak = PeakCompliance(power=100.0)
    expected = size * peak.value(trajectory, bodies)
    assert peak.value(trajectory, scaled) == pytest.approx(expected, rel=1e-12)
    _, bars = peak.pullback(trajectory, scaled)
    np.testing.assert_allclose(
        bars["coupler"].K, peak.pullback(trajectory, bodies)[1]["coupler"].K, rtol=1e-10
    )


def test_forces_outside_the_window_do_not_matter(motion: tuple[Trajectory, Bodies]) -> None:
    trajectory, bodies = motion
    objective = JointForce("motor", power=100.0, window=(0.1, 0.2))
    knocked = replace(trajectory, multipliers=trajectory.multipliers.copy())
    knocked.multipliers[-1] = 1e100
    assert objective.value(knocked, bodies) == objective.value(trajectory, bodies)
    bar, _ = objective.pullback(knocked, bodies)
    expected, _ = objective.pullback(trajectory, bodies)
    np.testing.assert_array_equal(bar.multipliers, expected.multipliers)


def test_body_at_rest_has_no_peak(motion: tuple[Trajectory, Bodies]) -> None:
    trajectory, bodies = motion
    at_rest = replace(trajectory, y=np.zeros_like(trajectory.y))
    assert PeakCompliance().value(at_rest, bodies) == 0.0
    bar, _ = PeakCompliance().pullback(at_rest, bodies)
    assert not bar.y.any()


def test_path_beside_the_motion(motion: tuple[Trajectory, Bodies]) -> None:
    trajectory, bodies = motion
    path = trajectory.marker_path("coupler", "middle") + np.array([0.3, -0.4])
    objective = PathTracking("coupler", "middle", path)
    assert objective.value(trajectory, bodies) == pytest.approx(0.25 * 0.3, rel=1e-13)
    # 60 steps of 5 ms: the window holds 20 of them.
    end = replace(objective, window=(0.2, 0.3))
    assert end.value(trajectory, bodies) == pytest.approx(0.25 * 0.1, rel=1e-12)
    bar, _ = end.pullback(trajectory, bodies)
    assert not bar.y[:40].any()
    assert bar.y[40:].any()
    weighted = replace(objective, weight=2.0 * trajectory.t)
    assert weighted.value(trajectory, bodies) == pytest.approx(0.25 * 0.3**2, rel=1e-12)


def spinning(omega: float = 7.0, gravity: float = 0.0) -> Scene:
    """A rigid bar of 2 kg on a bearing at the origin, turned by a motor."""
    bar = VolumeIntegrals.rigid(2.0, (0.25, 0.0), 0.1, {"hub": (0, 0), "tip": (0.4, 0.3)})
    mechanism = Mechanism(
        {"bar": Placement()},
        [
            Revolute(("bar", "hub"), Ground(), name="bearing"),
            PrescribedAngle(("bar", "hub"), Motion.polynomial([0.0, omega]), name="motor"),
        ],
        gravity=(0.0, -gravity),
    )
    return Scene(mechanism, {"bar": bar}, GeneralizedAlpha(0.5, 50))


def test_uniform_rotation() -> None:
    scene = spinning(omega=7.0)
    trajectory = simulate(scene.mechanism, scene.bodies, scene.integrator)
    tip = MarkerAcceleration("bar", "tip")
    # Towards the centre: omega^2 times the distance of 0.5 m.
    path = trajectory.marker_path("bar", "tip")
    np.testing.assert_allclose(tip.acceleration(trajectory, scene.bodies), -49.0 * path, atol=1e-9)
    assert tip.value(trajectory, scene.bodies) == pytest.approx(24.5**2 * 0.5, rel=1e-10)
    speed = MarkerVelocity("bar", "tip").value(trajectory, scene.bodies)
    assert speed == pytest.approx(3.5**2 * 0.5, rel=1e-10)
    # The bearing holds 2 kg at 0.25 m on their circle.
    for power in (1.5, 2.0, 40.0):
        force = JointForce("bearing", power=power).value(trajectory, scene.bodies)
        assert force == pytest.approx(2.0 * 49.0 * 0.25, rel=1e-9)
    assert JointForce("motor").value(trajectory, scene.bodies) == pytest.approx(0.0, abs=1e-9)


def test_weight_at_rest() -> None:
    scene = spinning(omega=0.0, gravity=10.0)
    trajectory = simulate(scene.mechanism, scene.bodies, scene.integrator)
    assert JointForce("bearing").value(trajectory, scene.bodies) == pytest.approx(20.0, rel=1e-11)
    assert JointForce("motor").value(trajectory, scene.bodies) == pytest.approx(5.0, rel=1e-11)


def test_acceleration_is_the_second_derivative_of_the_path(
    motion: tuple[Trajectory, Bodies],
) -> None:
    """Coordinates that are known functions of time, whose path is differenced."""
    trajectory, bodies = motion
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
        a = MarkerAcceleration("coupler", "middle").acceleration(moving, bodies)
        errors.append(np.max(np.abs(second - a[1:-1])) / np.max(np.abs(a)))
    assert errors[-1] < 1e-4
    assert convergence_order([4.0, 2.0, 1.0], errors) == pytest.approx(2.0, abs=0.05)


def test_frequencies_of_a_beam() -> None:
    """Cantilever and free beam against Euler and Bernoulli."""
    length, speed = 0.4, np.sqrt(2.1e11 / 7850.0) * 0.01 / np.sqrt(12.0)
    size = {"height": 0.01, "elements": 10, "modes": 8}
    clamped, free = beam(length, frame="tangent", **size), beam(length, frame="free", **size)
    for number, root in enumerate((1.87510406871196, 4.69409113297417), 1):
        value = Frequency("rod", number=number).value(None, {"rod": clamped})
        assert value == pytest.approx((root / length) ** 2 * speed / (2 * np.pi), rel=1e-4)
    expected = (4.73004074486270 / length) ** 2 * speed / (2 * np.pi)
    for frame_is_free in (False, True):
        value = Frequency("rod", free=frame_is_free).value(None, {"rod": free})
        assert value == pytest.approx(expected, rel=1e-4)


def test_free_frequencies_do_not_depend_on_the_frame() -> None:
    every = {"elements": 3, "modes": 9}
    values = [
        [Frequency("rod", number, free=True).value(None, {"rod": rod}) for number in range(1, 6)]
        for rod in (beam(frame="tangent", **every), beam(frame="chord", **every))
    ]
    np.testing.assert_allclose(values[0], values[1], rtol=1e-9)


def test_cluster_of_equal_frequencies_has_a_derivative() -> None:
    rod = beam(modes=4, elements=6)
    _, vectors = scipy.linalg.eigh(rod.K, rod.G[1:, 1:])
    dual = rod.G[1:, 1:] @ vectors
    bodies = {"rod": replace(rod, K=(dual * np.array([4.0, 4.0, 4.0, 9.0]) * 1e6) @ dual.T)}
    cluster = Frequency("rod", cluster=3)
    assert cluster.value(None, bodies) == pytest.approx(2e3 / (2 * np.pi), rel=1e-12)
    _, bars = cluster.pullback(None, bodies)
    direction = random_direction(bodies, 2, "GK")
    result = taylor_test(
        lambda step: cluster.value(None, moved(bodies, direction, float(step))),
        lambda step: float(step) * bars["rod"].dot(direction["rod"]),
        0.0,
        1.0,
        steps=[1e-3 / 2.0**k for k in range(5)],
    )
    assert_taylor_order(result)
    with pytest.warns(UserWarning, match="frequencies 2 and 3 of body 'rod' are equal"):
        Frequency("rod", cluster=2).pullback(None, bodies)


def test_sums(motion: tuple[Trajectory, Bodies]) -> None:
    trajectory, bodies = motion
    a, b, c = IntegralCompliance(), JointForce("motor"), Mass("coupler")
    total = 0.3 * a - b + sum([c, 2.0 * (a + b) * 0.5])
    assert [weight for weight, _ in total.terms] == [0.3, -1.0, 1.0, 1.0, 1.0]
    values = [objective.value(trajectory, bodies) for objective in (a, b, c)]
    assert total.value(trajectory, bodies) == pytest.approx(1.3 * values[0] + values[2], rel=1e-12)
    assert (-c).value(trajectory, bodies) == -values[2]
    assert total.needs_trajectory
    assert not (c + Frequency("rocker")).needs_trajectory
    assert Sum([(2.0, c), (1.0, Mass("rocker"))]).pullback(trajectory, bodies)[0] is None


UNKNOWN_BODY = r"of body 'rod', but the bodies are \['crank', 'coupler'"


@pytest.mark.parametrize(
    ("objective", "message"),
    [
        (IntegralCompliance(["rod"]), UNKNOWN_BODY),
        (IntegralCompliance(weights={"rod": 1.0}), UNKNOWN_BODY),
        (PeakCompliance(["rod"]), UNKNOWN_BODY),
        (PathTracking("rod", "tip", (0.0, 0.0)), UNKNOWN_BODY),
        (MarkerAcceleration("rod", "tip"), UNKNOWN_BODY),
        (Mass("rod"), UNKNOWN_BODY),
        (Frequency("rod"), UNKNOWN_BODY),
        (Mass("crank") + 2.0 * Mass("rod"), UNKNOWN_BODY),
        (
            MarkerAcceleration("rocker", "tip"),
            r"marker 'tip', but the markers of body 'rocker' are \['left', 'middle', 'right'\]",
        ),
        (JointForce("pin"), r"joint 'pin', but the joints are \['motor bearing', 'crank pin'"),
        (JointForce("crank pin", moment=True), "joint 'crank pin' carries no moment"),
        (Frequency("rocker", number=2, cluster=2), "2 elastic coordinates, too few for .* 2 to 3"),
        (Frequency("crank"), "'crank' is rigid, and has none"),
        (
            PathTracking("rocker", "left", np.zeros((60, 2))),
            r"the path has shape \(60, 2\), but with 61 time steps it must have \(61, 2\)",
        ),
        (PathTracking("rocker", "left", np.full((61, 2), np.nan)), "the path holds NaN"),
        (
            PathTracking("rocker", "left", (0.0, lambda t: t[:-1])),
            r"path along y at 61 times has shape \(60,",
        ),
        (PathTracking("rocker", "left", (0.0, 0.0), weight=np.ones(3)), "weight has shape"),
        (PathTracking("rocker", "left", (0.0, 0.0), (0.4, 0.5)), "fewer than two time steps lie"),
    ],
)
def test_refused_with_the_names_that_exist(
    motion: tuple[Trajectory, Bodies], objective: Objective, message: str
) -> None:
    trajectory, bodies = motion
    with pytest.raises(ValueError, match=message):
        objective.value(trajectory, bodies)
    with pytest.raises(ValueError, match=message):
        objective.pullback(trajectory, bodies)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: IntegralCompliance(weights={"rod": float("nan")}),
            "weights: that of body 'rod' must be finite, but it is nan",
        ),
        (lambda: PeakCompliance(weights={"rod": -1.0}), "weight of body 'rod' is negative"),
        (lambda: PeakCompliance(power=0.5), "power must be at least 1, but it is 0.5"),
        (lambda: JointForce("pin", power=1.0), "with a power of 1 the mean has a kink"),
        (lambda: JointForce("pin", window=(1.0, 1.0)), "begin < end"),
        (lambda: MarkerAcceleration("a", "b", (1.0, 0.0)), "begin < end"),
        (lambda: Frequency("rod", number=0), "number must be a positive whole number"),
        (lambda: Frequency("rod", cluster=1.5), "cluster must be a positive whole number"),
        (lambda: PathTracking("a", "b", (np.sin, 0.0, 0.0, 0.0)), "a pair .* not of 4 entries"),
        (lambda: IntegralCompliance([]), "bodies is an empty list, and nothing would count"),
        (lambda: Sum([]), "at least one term"),
        (
            lambda: float("inf") * Mass("rod"),
            "weight of an objective must be finite, but it is inf",
        ),
        (lambda: Constraint(Mass("rod")), "'Mass' needs either an upper or a lower bound"),
        (lambda: Constraint(Mass("rod"), 1.0, 2.0), "for both, give two constraints"),
        (
            lambda: Constraint(Mass("rod"), 0.0, name="light"),
            "'light': the bound must be a number other than zero",
        ),
        (lambda: Constraint(Mass("rod"), float("nan")), "the bound must be finite, but it is nan"),
    ],
)
def test_refused_when_made(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
