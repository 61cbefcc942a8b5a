# SPDX-License-Identifier: MIT
"""Discrete adjoint: exact derivatives with respect to all integrals of all bodies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from shared.scenes import SCENES, Bodies, Scene, moved, random_direction, slider_crank

from dolfinx_ffr.body.volume_integrals import VolumeIntegrals
from dolfinx_ffr.dynamics import (
    GeneralizedAlpha,
    SimulationError,
    Trajectory,
    TrajectoryBar,
    adjoint,
    simulate,
)
from dolfinx_ffr.mechanism import (
    Ground,
    Mechanism,
    Moving,
    Placement,
    PointOnLine,
    Revolute,
    Weld,
)
from dolfinx_ffr.mechanism.motion import Motion
from dolfinx_ffr.objective import IntegralCompliance
from dolfinx_ffr.verification import assert_taylor_order, central_difference, taylor_test

#: First step of the Taylor tests. In the four-bar's frames the mode shapes nearly contain rigid
#: motions, so it bears smaller changes of its integrals than the others.
STEP = {"slider-crank": 4e-3, "four-bar": 2e-4, "robot": 4e-3, "loader": 1e-3, "stiffened": 4e-3}


def compliance(scene: Scene, bodies: Bodies) -> float:
    trajectory = simulate(scene.mechanism, bodies, scene.integrator)
    return IntegralCompliance().value(trajectory, bodies)


def compliance_gradient(scene: Scene) -> Bodies:
    trajectory = simulate(scene.mechanism, scene.bodies, scene.integrator)
    bar, explicit = IntegralCompliance().pullback(trajectory, scene.bodies)
    through_motion = adjoint(trajectory, bar)
    return {name: through_motion[name] + explicit[name] for name in scene.bodies}


def dot(bars: Bodies, direction: Bodies) -> float:
    return sum(bars[name].dot(direction[name]) for name in bars)


def along(scene: Scene, direction: Bodies) -> Callable[[float], float]:
    return lambda step: compliance(scene, moved(scene.bodies, direction, float(step)))


@pytest.fixture(scope="module", params=list(SCENES))
def case(request: pytest.FixtureRequest) -> tuple[str, Scene, Bodies]:
    scene = SCENES[request.param]()
    return request.param, scene, compliance_gradient(scene)


def test_taylor_order_over_decades(case: tuple[str, Scene, Bodies]) -> None:
    name, scene, gradient = case
    direction = random_direction(scene.bodies, 5)
    slope = dot(gradient, direction)
    steps = [STEP[name] / 10.0 ** (0.5 * k) for k in range(7)]
    result = taylor_test(
        along(scene, direction), lambda step: float(step) * slope, 0.0, 1.0, steps=steps
    )
    assert_taylor_order(result, points=5)


@pytest.mark.slow
def test_rotation_shape_functions() -> None:
    # Robot and loader have joints that feel the rotation of elastic markers, the others do not.
    for name, make in SCENES.items():
        scene = make()
        gradient = compliance_gradient(scene)
        direction = random_direction(scene.bodies, 3, "P")
        slope = dot(gradient, direction)
        if name in ("robot", "loader", "stiffened"):
            steps = [STEP[name] / 2.0**k for k in range(5)]
            assert_taylor_order(
                taylor_test(
                    along(scene, direction), lambda s, g=slope: float(s) * g, 0, 1, steps=steps
                ),
                points=4,
            )
        elif name == "slider-crank":
            assert slope == 0.0
            assert along(scene, direction)(0.1) == along(scene, direction)(0.0)


@pytest.mark.parametrize("fields", ["m", "S", "G", "N", "K", "W", "mSGNKWP"])
def test_central_differences(case: tuple[str, Scene, Bodies], fields: str) -> None:
    name, scene, gradient = case
    direction = random_direction(scene.bodies, 4, fields)
    step = 0.15 * STEP[name]
    difference = central_difference(along(scene, direction), 0.0, 1.0, step)
    assert dot(gradient, direction) == pytest.approx(difference, rel=1e-6)


def test_geometric_stiffness() -> None:
    scene = SCENES["stiffened"]()
    gradient = compliance_gradient(scene)
    direction = random_direction(scene.bodies, 3, "T")
    slope = dot(gradient, direction)
    steps = [4e-2 / 2.0**k for k in range(5)]
    result = taylor_test(
        along(scene, direction), lambda step: float(step) * slope, 0.0, 1.0, steps=steps
    )
    assert_taylor_order(result, points=4)
    difference = central_difference(along(scene, direction), 0.0, 1.0, 5e-3)
    assert slope == pytest.approx(difference, rel=1e-7)


@pytest.mark.parametrize("part", ["y", "v", "w", "multipliers"])
def test_every_part_of_the_trajectory(case: tuple[str, Scene, Bodies], part: str) -> None:
    """A random weighted sum of all coordinates, velocities, accelerations or multipliers."""
    name, scene, _ = case
    trajectory = simulate(scene.mechanism, scene.bodies, scene.integrator)
    values = getattr(trajectory, part)
    rng = np.random.default_rng(0)
    weights = rng.uniform(-1.0, 1.0, values.shape) / values.size
    weights /= np.sqrt(np.mean(values**2, axis=0))
    bar = TrajectoryBar.zeros(trajectory)
    getattr(bar, part)[:] = weights
    direction = random_direction(scene.bodies, 3)

    def function(step: float) -> float:
        bodies = moved(scene.bodies, direction, float(step))
        return float(
            np.sum(weights * getattr(simulate(scene.mechanism, bodies, scene.integrator), part))
        )

    difference = central_difference(function, 0.0, 1.0, 0.5 * STEP[name])
    assert dot(adjoint(trajectory, bar), direction) == pytest.approx(difference, rel=1e-6)


@pytest.mark.parametrize("radius", [0.0, 0.5, 1.0])
def test_spectral_radius(radius: float) -> None:
    scene = slider_crank(steps=80)
    scene = replace(scene, integrator=replace(scene.integrator, spectral_radius=radius))
    direction = random_direction(scene.bodies, 3)
    slope = dot(compliance_gradient(scene), direction)
    steps = (4e-3, 2e-3, 1e-3)
    result = taylor_test(
        along(scene, direction), lambda step: float(step) * slope, 0.0, 1.0, steps=steps
    )
    assert_taylor_order(result)


@pytest.mark.parametrize("name", ["robot", "loader", "stiffened"])
@pytest.mark.parametrize("steps", [1, 2])
def test_first_steps_alone(name: str, steps: int) -> None:
    """With one or two steps the initial accelerations and the method's start are all there is."""
    scene = SCENES[name]()
    scene = replace(scene, integrator=replace(scene.integrator, steps=steps, end_time=2e-3 * steps))
    trajectory = simulate(scene.mechanism, scene.bodies, scene.integrator)
    bar = TrajectoryBar.zeros(trajectory)
    rng = np.random.default_rng(1)
    bar.w[:] = rng.uniform(-1.0, 1.0, bar.w.shape) / np.max(np.abs(trajectory.w))
    bar.multipliers[:] = rng.uniform(-1.0, 1.0, bar.multipliers.shape)
    bar.multipliers[:] /= np.max(np.abs(trajectory.multipliers))
    direction = random_direction(scene.bodies, 3)
    slope = dot(adjoint(trajectory, bar), direction)

    def function(step: float) -> float:
        bodies = moved(scene.bodies, direction, float(step))
        t = simulate(scene.mechanism, bodies, scene.integrator)
        return float(np.sum(bar.w * t.w) + np.sum(bar.multipliers * t.multipliers))

    assert central_difference(function, 0.0, 1.0, 2e-3) == pytest.approx(slope, rel=1e-7)


def test_structure_of_the_derivatives(case: tuple[str, Scene, Bodies]) -> None:
    _, scene, gradient = case
    for name, bar in gradient.items():
        np.testing.assert_array_equal(bar.G, bar.G.T)
        np.testing.assert_array_equal(bar.N, -bar.N.T)
        np.testing.assert_array_equal(bar.K, bar.K.T)
        assert bar.markers.keys() == scene.bodies[name].markers.keys()
        for marker in bar.markers.values():
            np.testing.assert_array_equal(marker.position, 0.0)


def test_derivatives_add_up() -> None:
    scene = slider_crank(steps=50)
    trajectory = simulate(scene.mechanism, scene.bodies, scene.integrator)
    rng = np.random.default_rng(0)
    bars = []
    for _ in range(2):
        bar = TrajectoryBar.zeros(trajectory)
        for part in (bar.y, bar.v, bar.w, bar.multipliers):
            part[:] = rng.normal(size=part.shape)
        bars.append(bar)
    direction = random_direction(scene.bodies, 1)
    apart = sum(dot(adjoint(trajectory, bar), direction) for bar in bars)
    assert dot(adjoint(trajectory, bars[0] + bars[1]), direction) == pytest.approx(apart, rel=1e-9)


def test_mechanism_at_rest_without_joints_that_move() -> None:
    # A welded body in the field of gravity: only its weight bends it, and no number is NaN.
    body = slider_crank().bodies["rod"]
    mechanism = Mechanism(
        {"rod": Placement((0.2, 0.0))},
        [Weld(("rod", "left"), Ground(), name="clamp")],
        gravity=(0.0, -9.81),
    )
    scene = Scene(mechanism, {"rod": body}, replace(slider_crank().integrator, steps=60))
    direction = random_direction(scene.bodies, 3)
    slope = dot(compliance_gradient(scene), direction)
    difference = central_difference(along(scene, direction), 0.0, 1.0, 1e-4)
    assert slope == pytest.approx(difference, rel=1e-6)


def test_motion_up_to_a_failure_has_derivatives_too() -> None:
    trajectory = interrupted()
    bar = TrajectoryBar.zeros(trajectory)
    bar.y[-1, 3:] = 1.0
    bars = adjoint(trajectory, bar)
    assert np.all(np.isfinite(bars["rod"].K))
    assert np.any(bars["rod"].K != 0.0)


def interrupted() -> Trajectory:
    """Flexible arm on a rigid rod whose pin moves away until the rod cannot reach its guide."""
    pin = Moving(Motion.constant(0.0), Motion.polynomial([0.0, 2.5]), name="lift")
    ends = {"left": (-0.5, 0.0), "right": (0.5, 0.0)}
    bodies = {
        "carrier": VolumeIntegrals.rigid(1.0, (0.0, 0.0), 0.1, ends),
        "rod": slider_crank().bodies["rod"],
    }
    mechanism = Mechanism(
        {"carrier": Placement((0.5, 0.0)), "rod": Placement((1.2, 0.0))},
        [
            Revolute(("carrier", "left"), pin, name="pin"),
            PointOnLine(("carrier", "right"), Ground(), name="guide"),
            Weld(("rod", "left"), ("carrier", "right"), name="flange"),
        ],
    )
    with pytest.raises(SimulationError) as caught:
        simulate(mechanism, bodies, GeneralizedAlpha(1.0, 200))
    return caught.value.trajectory


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda bar: replace(bar, y=bar.y[:-1]), r"bar.y must have shape \(51, 9\)"),
        (lambda bar: replace(bar, w=np.nan * bar.w), "bar.w holds NaN"),
        (
            lambda bar: replace(bar, multipliers=bar.multipliers[:, :2]),
            r"bar.multipliers must have shape \(51, 3\), but it has shape \(51, 2\)",
        ),
    ],
)
def test_refused(change: Callable[[TrajectoryBar], TrajectoryBar], message: str) -> None:
    scene = slider_crank(steps=50)
    trajectory = simulate(scene.mechanism, scene.bodies, scene.integrator)
    with pytest.raises(ValueError, match=message):
        adjoint(trajectory, change(TrajectoryBar.zeros(trajectory)))
