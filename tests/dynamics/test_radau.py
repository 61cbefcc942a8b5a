# SPDX-License-Identifier: MIT
"""Radau IIA: orders, constraints, tolerance, discrete adjoint, and refused runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.beams import beam
from shared.scenes import SCENES, Bodies, Scene, moved, random_direction, slider_crank

from dolfinx_ffr.body.volume_integrals import VolumeIntegrals
from dolfinx_ffr.dynamics import (
    GeneralizedAlpha,
    RadauIIA,
    SimulationError,
    Trajectory,
    TrajectoryBar,
    adjoint,
    simulate,
)
from dolfinx_ffr.dynamics.integration.stages import NODES, stage_integrals
from dolfinx_ffr.dynamics.kinematics import evaluate_equations
from dolfinx_ffr.mechanical_problem import MechanicalProblem
from dolfinx_ffr.mechanism import (
    Force,
    Ground,
    Mechanism,
    Moving,
    Placement,
    PointMass,
    PointOnLine,
    PrescribedAngle,
    Revolute,
    SpringDamper,
)
from dolfinx_ffr.mechanism.initial_conditions import StaticEquilibrium
from dolfinx_ffr.mechanism.motion import Motion
from dolfinx_ffr.objective import IntegralCompliance, JointForce, MarkerAcceleration, PathTracking
from dolfinx_ffr.verification import (
    assert_taylor_order,
    central_difference,
    convergence_order,
    taylor_test,
)

Array = NDArray[np.float64]
QUANTITIES = ("y", "v", "w", "multipliers")


def make(name: str) -> Scene:
    """A scene; random geometric stiffness is made so small that no motion runs away."""
    scene = SCENES[name]()
    bodies = {
        key: replace(body, stiffening={load: 0.2 * a for load, a in body.stiffening.items()})
        for key, body in scene.bodies.items()
    }
    return replace(scene, bodies=bodies)


def run(scene: Scene, **changes: object) -> Trajectory:
    integrator = RadauIIA(scene.integrator.end_time, **changes)
    return simulate(scene.mechanism, scene.bodies, integrator)


def compliance(trajectory: Trajectory) -> float:
    return IntegralCompliance().value(trajectory, trajectory.model.bodies)


# --- Orders and constraints ----------------------------------------------------------------------


def soft(name: str) -> Scene:
    """A scene over a short time whose bodies vibrate slowly enough to be resolved."""
    scene = slider_crank(modes=2) if name == "slider-crank" else SCENES[name]()
    bodies = {
        key: replace(body, K=0.02 * body.K, stiffening={}) for key, body in scene.bodies.items()
    }
    return Scene(scene.mechanism, bodies, GeneralizedAlpha(0.02, 100))


@pytest.mark.parametrize("name", ["slider-crank", "four-bar", "robot", "loader"])
def test_orders(name: str) -> None:
    # Enough steps for the fastest vibration, few enough for errors above round-off.
    scene = soft(name)
    steps = np.array([1, 2, 4]) * (80 if name == "slider-crank" else 40)
    runs = [run(scene, steps=int(count)) for count in (*steps, 4 * steps[-1])]

    def order(value: Callable[[Trajectory], Array]) -> float:
        exact = value(runs[-1])
        errors = [float(np.max(np.abs(value(r) - exact))) for r in runs[:-1]]
        return convergence_order(1.0 / steps, errors)

    assert order(lambda r: r.y[-1]) > 4.8
    assert order(lambda r: r.v[-1]) > 4.8
    assert order(lambda r: np.array(compliance(r))) > 4.8
    assert order(lambda r: r.multipliers[-1]) > 2.8
    assert order(lambda r: r.w[-1]) > 2.8


@pytest.mark.parametrize("name", SCENES)
def test_equations_and_constraints_hold_to_round_off_at_all_times(name: str) -> None:
    trajectory = run(make(name), steps=300)
    model, n = trajectory.model, trajectory.model.size
    speed, force = np.max(np.abs(trajectory.v)), np.max(np.abs(trajectory.multipliers))
    elastic = [trajectory.elastic(name) @ body.K for name, body in model.bodies.items()]
    force = max(force, *(np.max(np.abs(part), initial=0.0) for part in elastic))
    residuals = np.array(
        [
            evaluate_equations(
                model.arrays, k, *(getattr(trajectory, part)[k] for part in QUANTITIES)
            )[0]
            for k in range(trajectory.steps + 1)
        ]
    )
    assert np.max(np.abs(residuals[:, :n])) < 1e-11 * force
    assert np.max(np.abs(residuals[:, n : n + model.rows])) < 1e-14  # metres, of parts of 0.4 m
    assert np.max(np.abs(residuals[:, n + model.rows :])) < 1e-14 * speed


@pytest.mark.slow
@pytest.mark.parametrize("name", ["slider-crank", "robot"])
def test_agrees_with_generalised_alpha_extrapolated(name: str) -> None:
    scene = soft(name)
    values = []
    for steps in (1000, 2000, 4000, 8000):
        integrator = GeneralizedAlpha(0.02, steps)
        values.append(compliance(simulate(scene.mechanism, scene.bodies, integrator)))
    for power in (2, 3, 4):  # of the step, in the error that one more halving removes
        factor = 2.0**power
        values = [(factor * fine - coarse) / (factor - 1.0) for coarse, fine in pairwise(values)]
    assert compliance(run(scene, tolerance=1e-10)) == pytest.approx(values[-1], rel=1e-8)


def test_pendulum_keeps_its_energy_over_a_long_time() -> None:
    body = VolumeIntegrals.rigid(1.0, (0.0, 0.0), 1.0 / 12.0, {"pin": (-0.5, 0.0)})
    mechanism = Mechanism(
        {"rod": Placement((0.5, 0.0))},
        [Revolute(("rod", "pin"), Ground(), name="pin")],
        gravity=(0.0, -9.81),
    )
    trajectory = simulate(mechanism, {"rod": body}, RadauIIA(60.0, tolerance=1e-10))
    energy = trajectory.kinetic_energy("rod") + trajectory.potential_energy("rod")
    ends = energy[::3] / np.max(trajectory.kinetic_energy("rod"))
    assert np.max(np.abs(ends)) < 1e-7
    assert np.max(np.abs(np.hypot(*trajectory.rigid("rod")[:, :2].T) - 0.5)) < 1e-14


def test_parallelograms_through_their_singular_positions() -> None:
    """IFToMM benchmark A02, to which links in line add errors that no step has made."""
    markers = {"left": (-0.5, 0.0), "middle": (0.0, 0.0), "right": (0.5, 0.0)}
    bodies, placements, joints = {}, {}, []
    for i in range(3):
        bodies[f"crank {i}"] = VolumeIntegrals.rigid(1.0, (0.0, 0.0), 1.0 / 12.0, markers)
        placements[f"crank {i}"] = Placement((float(i), 0.5), 0.5 * math.pi, (0.5, 0.0), -1.0)
        joints.append(Revolute((f"crank {i}", "left"), Ground((float(i), 0.0))))
    for i in range(2):
        bodies[f"coupler {i}"] = VolumeIntegrals.rigid(1.0, (0.0, 0.0), 1.0 / 12.0, markers)
        placements[f"coupler {i}"] = Placement((i + 0.5, 1.0), 0.0, (1.0, 0.0), 0.0)
        joints.append(Revolute((f"crank {i}", "right"), (f"coupler {i}", "left")))
        joints.append(Revolute((f"coupler {i}", "right"), (f"crank {i + 1}", "right")))
    mechanism = Mechanism(placements, joints, gravity=(0.0, -9.81))
    trajectory = simulate(mechanism, bodies, RadauIIA(10.0, tolerance=1e-10))
    end = trajectory.marker_path("crank 0", "right")[-1]
    assert end == pytest.approx((0.3284581115, 0.9445185382), abs=5e-6)
    assert trajectory.step_ends.size < 2000


# --- Tolerance -----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", ["slider-crank", "four-bar", "robot", "loader"])
def test_adaptive_steps_reach_their_tolerance(name: str) -> None:
    scene = soft(name)
    exact = run(scene, steps=1500)
    psi = compliance(exact)
    counts = []
    for tolerance in (1e-4, 1e-6, 1e-8):
        trajectory = run(scene, tolerance=tolerance)
        assert abs(compliance(trajectory) / psi - 1.0) < 10.0 * tolerance
        assert trajectory.error < tolerance * (1.0 + 1e-12)
        counts.append(trajectory.step_ends.size)
    assert counts[0] < counts[1] < counts[2] < 1500


def test_steps_that_were_taken_can_be_taken_again() -> None:
    scene = slider_crank()
    first = run(scene, tolerance=1e-5)
    again = run(scene, steps=first.step_ends)
    np.testing.assert_array_equal(first.t, again.t)
    scale = np.max(np.abs(first.w), axis=0)
    assert np.max(np.abs(first.w - again.w) / scale) < 1e-9
    # The sizes of the motion are those of the run itself, not also those of the one before it.
    assert again.error == pytest.approx(first.error, rel=1e-2)


def test_bounds_of_the_steps() -> None:
    scene = slider_crank(end_time=0.1)
    trajectory = run(scene, tolerance=1e-2, first_step=1e-5, largest_step=2e-4)
    lengths = np.diff(trajectory.step_ends)
    assert lengths[0] <= 1e-5 * (1.0 + 1e-9)
    assert np.max(lengths) <= 2e-4 * (1.0 + 1e-9)
    assert trajectory.t[-1] == 0.1


def test_mechanism_at_rest() -> None:
    body = VolumeIntegrals.rigid(1.0, (0.0, 0.0), 0.1, {"left": (-0.5, 0.0), "right": (0.5, 0.0)})
    mechanism = Mechanism(
        {"rod": Placement((0.5, 0.0))},
        [Revolute(("rod", "left"), Ground()), PointOnLine(("rod", "right"), Ground())],
        gravity=(0.0, -9.81),
    )
    trajectory = simulate(mechanism, {"rod": body}, RadauIIA(1.0))
    assert trajectory.step_ends.size < 60
    assert np.max(np.abs(trajectory.y - trajectory.y[0])) < 1e-14


# --- Jumps ---------------------------------------------------------------------------------------


def jerky(known: bool = True) -> Scene:
    """A bar driven with a trapezoidal velocity, and a force that sets in."""
    a, ramp, total, begin = 40.0, 0.1, 0.4, 0.0503

    def angle(t: Array) -> Array:
        early, late = np.minimum(t, ramp), np.clip(t - (total - ramp), 0.0, ramp)
        cruise = np.clip(t - ramp, 0.0, total - ramp)
        return 0.5 * a * early**2 + a * ramp * cruise - 0.5 * a * late**2

    drive = Motion(
        angle,
        lambda t: a * np.clip(np.minimum(t, total - t), 0.0, ramp),
        lambda t: np.where(t < ramp, a, np.where((t < total - ramp) | (t >= total), 0.0, -a)),
        "drive",
        (ramp, total - ramp, total) if known else (),
    )
    bar = beam(0.4, 0.01, 0.01, elements=8, modes=2)
    mechanism = Mechanism(
        {"bar": Placement((0.2, 0.0))},
        [
            Revolute(("bar", "left"), Ground(), name="hinge"),
            PrescribedAngle(("bar", "left"), drive, name="motor"),
        ],
        forces=[Force(("bar", "right"), 0.0, lambda t: np.where(t > begin, 2.0, 0.0))],
        gravity=(0.0, -9.81),
        jumps=[begin] if known else [],
    )
    return Scene(mechanism, {"bar": replace(bar, K=0.05 * bar.K)}, GeneralizedAlpha(0.5, 1000))


def test_order_across_jumps() -> None:
    scene = jerky()
    steps = np.array([400, 800, 1600])
    exact = run(scene, steps=6400)
    errors = [
        [abs(compliance(r) / compliance(exact) - 1.0), np.max(np.abs(r.y[-1] - exact.y[-1]))]
        for r in (run(scene, steps=int(count)) for count in steps)
    ]
    for column in np.array(errors).T:
        assert convergence_order(1.0 / steps, column) > 4.7
    ends = run(scene, steps=7).step_ends
    assert {0.0503, 0.1, 0.4 - 0.1, 0.4} < set(ends)
    np.testing.assert_array_equal(run(scene, steps=ends).step_ends, ends)
    assert {0.0503, 0.1} < set(run(scene, steps=[0.0, 0.02, 0.3, 0.5]).step_ends)


def test_steps_end_at_jumps() -> None:
    """Steps that know of the jumps are fewer, and keep what they promise."""
    scene, unaware = jerky(), jerky(known=False)
    exact = compliance(run(scene, steps=6400))
    for tolerance in (1e-5, 1e-7, 1e-9):
        aware = run(scene, tolerance=tolerance)
        other = run(unaware, tolerance=tolerance)
        assert {0.0503, 0.1, 0.4 - 0.1, 0.4} < set(aware.step_ends)
        assert aware.step_ends.size < other.step_ends.size
        assert abs(compliance(aware) - exact) < 0.2 * abs(compliance(other) - exact)


def test_values_at_jumps_are_those_before() -> None:
    scene = jerky()
    trajectory = run(scene, steps=100)
    at = int(np.flatnonzero(trajectory.t == 0.0503)[0])
    force = trajectory.applied_force(scene.mechanism.force_names[0])[:, 1]
    assert force[at] == 0.0 and force[at + 1] == 2.0


def test_gradient_across_jumps() -> None:
    scene = jerky()
    problem = MechanicalProblem(scene.mechanism, RadauIIA(0.5, steps=400), IntegralCompliance())
    direction = random_direction(scene.bodies, 3)
    slope = dot(problem.gradient(scene.bodies).integrals_gradient, direction)
    result = taylor_test(
        lambda step: problem.value(moved(scene.bodies, direction, float(step))).psi,
        lambda step: float(step) * slope,
        0.0,
        1.0,
        steps=[4e-4 / 2.0**k for k in range(5)],
    )
    assert_taylor_order(result, points=4)


# --- Integrals over time -------------------------------------------------------------------------


def test_weights_integrate_polynomials_exactly() -> None:
    trajectory = run(slider_crank(end_time=0.1), steps=np.array([0.0, 0.01, 0.04, 0.1]))
    for power in range(5):
        exact = 0.1 ** (power + 1) / (power + 1)
        assert trajectory.weights @ trajectory.t**power == pytest.approx(exact, rel=1e-12)
    whole = stage_integrals(np.array([1.0]))[0]
    np.testing.assert_allclose(whole @ NODES[:, None] ** np.arange(3), 1.0 / np.arange(1, 4))


def test_a_window_may_cut_steps() -> None:
    scene = slider_crank(end_time=0.1)
    trajectory = run(scene, steps=np.array([0.0, 0.01, 0.04, 0.1]))
    weights = []
    for window in ((0.0, 0.033), (0.033, 0.1), None):
        path = PathTracking("rod", "right", (0.0, 0.0), window)
        weights.append(path._weights(trajectory))
    np.testing.assert_allclose(weights[0] + weights[1], weights[2], atol=1e-16)
    for power in range(3):
        exact = 0.033 ** (power + 1) / (power + 1)
        assert weights[0] @ trajectory.t**power == pytest.approx(exact, rel=1e-12)
    with pytest.raises(ValueError, match="is outside of the motion"):
        PathTracking("rod", "right", (0.0, 0.0), (0.2, 0.3)).value(trajectory, scene.bodies)


# --- Adjoint -------------------------------------------------------------------------------------


def uneven(scene: Scene) -> RadauIIA:
    """Steps of unlike lengths, short enough for every scene."""
    end = scene.integrator.end_time
    ends = np.linspace(0.0, 1.0, 241 if scene.bodies.get("arm", beam()).stiffening else 121)
    return RadauIIA(end, steps=end * (ends + 0.05 * np.sin(2.0 * np.pi * ends)))


def dot(bars: Bodies, direction: Bodies) -> float:
    return sum(bars[name].dot(direction[name]) for name in bars)


@pytest.fixture(scope="module", params=list(SCENES))
def case(request: pytest.FixtureRequest) -> tuple[str, Scene, MechanicalProblem, Bodies]:
    scene = make(request.param)
    problem = MechanicalProblem(scene.mechanism, uneven(scene), IntegralCompliance())
    gradient = problem.gradient(scene.bodies).integrals_gradient
    assert gradient is not None
    return request.param, scene, problem, gradient


#: First step of the Taylor tests; see test_adjoint.py.
STEP = {"slider-crank": 4e-3, "four-bar": 2e-4, "robot": 4e-3, "loader": 4e-3, "stiffened": 4e-3}


@pytest.mark.slow
def test_taylor_order(case: tuple[str, Scene, MechanicalProblem, Bodies]) -> None:
    name, scene, problem, gradient = case
    direction = random_direction(scene.bodies, 3)
    slope = dot(gradient, direction)
    result = taylor_test(
        lambda step: problem.value(moved(scene.bodies, direction, float(step))).psi,
        lambda step: float(step) * slope,
        0.0,
        1.0,
        steps=[STEP[name] / 2.0**k for k in range(5)],
    )
    assert_taylor_order(result, points=4)


# Fields one by one where that takes little time: how each enters the equations does not depend on
# the time integration, and test_adjoint.py looks at it in all scenes.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "fields"),
    [*((name, "mSGNKWPT") for name in SCENES), *(("four-bar", field) for field in "mSGNKW")],
    indirect=["case"],
)
def test_central_differences(
    case: tuple[str, Scene, MechanicalProblem, Bodies], fields: str
) -> None:
    name, scene, problem, gradient = case
    direction = random_direction(scene.bodies, 4, fields)
    difference = central_difference(
        lambda step: problem.value(moved(scene.bodies, direction, float(step))).psi,
        0.0,
        1.0,
        0.05 * STEP[name],
    )
    # Where the slope nearly vanishes, the difference is that of two values rounded off.
    noise = 1e-12 * problem.value(scene.bodies).psi / (0.05 * STEP[name])
    assert dot(gradient, direction) == pytest.approx(difference, rel=1e-6, abs=noise)


@pytest.mark.slow
def test_every_part_of_the_trajectory(
    case: tuple[str, Scene, MechanicalProblem, Bodies],
) -> None:
    """Random weighted sums of coordinates, velocities, accelerations and multipliers."""
    name, scene, problem, _ = case
    integrator = problem.integrator
    trajectory = simulate(scene.mechanism, scene.bodies, integrator)
    weights = {}
    for part in QUANTITIES:
        values = getattr(trajectory, part)
        weights[part] = np.random.default_rng(0).uniform(-1.0, 1.0, values.shape) / values.size
        weights[part] /= np.sqrt(np.mean(values**2, axis=0))
    direction = random_direction(scene.bodies, 3)

    @cache
    def run_at(step: float) -> Trajectory:
        return simulate(scene.mechanism, moved(scene.bodies, direction, step), integrator)

    for part in QUANTITIES:
        bar = TrajectoryBar.zeros(trajectory)
        getattr(bar, part)[:] = weights[part]
        difference = central_difference(
            lambda step, part=part: np.sum(weights[part] * getattr(run_at(float(step)), part)),
            0.0,
            1.0,
            max(0.02 * STEP[name], 2e-5),
        )
        slope = dot(adjoint(trajectory, bar), direction)
        assert slope == pytest.approx(difference, rel=2e-5), part


def test_gradient_of_an_adaptive_run() -> None:
    """It is that of the steps taken, and close to the one of the exact motion."""
    scene = soft("robot")
    direction = random_direction(scene.bodies, 3)
    slopes = []
    for integrator in (RadauIIA(0.02, tolerance=1e-7), RadauIIA(0.02, steps=500)):
        problem = MechanicalProblem(scene.mechanism, integrator, IntegralCompliance())
        slopes.append(dot(problem.gradient(scene.bodies).integrals_gradient, direction))
    assert slopes[0] == pytest.approx(slopes[1], rel=1e-6)


@pytest.mark.filterwarnings("ignore::dolfinx_ffr.LargeDeformationWarning")  # it is soft
def test_gradient_from_a_static_equilibrium() -> None:
    """A beam on a pin and a spring sags under its weight, and is then pulled."""
    mechanism = Mechanism(
        {"beam": Placement((0.2, 0.0))},
        [Revolute(("beam", "left"), Ground(), name="pin")],
        forces=[
            SpringDamper(("beam", "right"), Ground((0.4, 0.3)), 500.0, 2.0, 0.25, "spring"),
            Force(("beam", "middle"), 0.0, lambda t: 20.0 * np.sin(30.0 * t) ** 2, name="pull"),
        ],
        gravity=(0.0, -9.81),
        start=StaticEquilibrium(),
    )
    bodies = {"beam": beam(0.4, 0.01, 0.01, 1e9, elements=8, modes=3, frame="tangent")}
    for objective in (IntegralCompliance(), JointForce("pin"), MarkerAcceleration("beam", "right")):
        problem = MechanicalProblem(mechanism, RadauIIA(0.1, steps=80), objective)
        direction = random_direction(bodies, 3)
        difference = central_difference(
            lambda step, p=problem, d=direction: p.value(moved(bodies, d, float(step))).psi,
            0.0,
            1.0,
            1e-5,
        )
        slope = dot(problem.gradient(bodies).integrals_gradient, direction)
        assert slope == pytest.approx(difference, rel=1e-6)


# --- Refused -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"end_time": 0.0}, "end_time must be positive"),
        ({"tolerance": 0.0}, "tolerance must lie between 1e-13 and 0.1"),
        ({"first_step": -1.0}, "first_step must be positive"),
        ({"largest_step": math.nan}, "largest_step must be positive"),
        ({"steps": 0}, "steps must be a positive whole number"),
        ({"steps": [0.0, 0.5, 0.5, 1.0]}, "times that grow"),
        ({"steps": [0.0, 0.5]}, "steps must go from 0 to end_time"),
    ],
)
def test_refused(changes: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RadauIIA(**{"end_time": 1.0, **changes})


@pytest.mark.parametrize("steps", [None, 200])
def test_a_motion_that_cannot_go_on(steps: int | None) -> None:
    """A pin moves away until the rod cannot reach its guide, at t = 0.4 s."""
    pin = Moving(Motion.constant(0.0), Motion.polynomial([0.0, 2.5]), name="lift")
    ends = {"left": (-0.5, 0.0), "right": (0.5, 0.0)}
    bodies = {"rod": VolumeIntegrals.rigid(1.0, (0.0, 0.0), 0.1, ends)}
    mechanism = Mechanism(
        {"rod": Placement((0.5, 0.0))},
        [
            Revolute(("rod", "left"), pin, name="pin"),
            PointOnLine(("rod", "right"), Ground(), name="guide"),
        ],
    )
    with pytest.raises(SimulationError, match=r"at t = 0\.[34].*trajectory") as caught:
        simulate(mechanism, bodies, RadauIIA(1.0, tolerance=1e-6, steps=steps))
    trajectory = caught.value.trajectory
    assert 0.39 < trajectory.t[-1] <= 0.4
    # The motion so far has derivatives, too.
    bar = TrajectoryBar.zeros(trajectory)
    bar.y[:] = 1.0
    assert np.isfinite(adjoint(trajectory, bar)["rod"].mass)


@pytest.mark.parametrize("steps", [41, 42])
def test_a_sudden_force_on_a_stiff_body(steps: int) -> None:
    """Accelerations at the start, of vibrations that no step resolves, are no guess of a step."""
    rod = beam(elements=10, modes=16)
    angle = Motion.smooth_step(10.0 * math.pi, 2.0)
    mechanism = Mechanism(
        placements={"rod": Placement((0.1, 0.0))},
        joints=[
            Revolute(("rod", "left"), Moving.circle((0.0, 0.0), 0.1, angle)),
            PointOnLine(("rod", "right"), Ground()),
        ],
        point_masses=[PointMass(("rod", "right"), 0.1)],
        forces=[Force(("rod", "right"), x=-60.0)],
    )
    problem = MechanicalProblem(mechanism, RadauIIA(2.0, steps=steps), IntegralCompliance())
    fine = replace(problem, integrator=RadauIIA(2.0, steps=200))
    psi = [each.value({"rod": rod}).psi for each in (problem, fine)]
    assert psi[0] == pytest.approx(psi[1], rel=1e-3)


def test_unsteady_drive_is_found() -> None:
    wrong = Motion(np.sin, lambda t: 2.0 * np.cos(t), lambda t: -np.sin(t), "wrong")
    mechanism = Mechanism(
        {"rod": Placement()},
        [
            Revolute(("rod", "left"), Ground()),
            PrescribedAngle(("rod", "left"), wrong, name="motor"),
        ],
    )
    with pytest.raises(ValueError, match=r"joint .motor.: .*velocity is not the derivative"):
        simulate(mechanism, {"rod": beam()}, RadauIIA(1.0))
