# SPDX-License-Identifier: MIT
"""Motions that strain the time integration: long, fast, stiff, jerky, singular, contradictory."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from shared import scenes
from shared.beams import beam
from shared.scenes import Scene, moved, slider_crank_mechanism

import dolfinx_ffr as ffr
from dolfinx_ffr.verification import assert_taylor_order, taylor_test

G = 9.81

Integrator = ffr.GeneralizedAlpha | ffr.RadauIIA
Method = Callable[[float, int], Integrator]


def generalized_alpha(end_time: float, steps: int) -> Integrator:
    """The method with equal steps."""
    return ffr.GeneralizedAlpha(end_time, steps)


def radau(end_time: float, steps: int) -> Integrator:
    """The method with a quarter of the steps, each of which costs more."""
    return ffr.RadauIIA(end_time, steps=max(steps // 4, 1))


#: Of a crank [rad].
EVEN_TURN = ffr.Motion.polynomial([0.0, 3.0])

both_methods = pytest.mark.parametrize("method", [generalized_alpha, radau])


def flexible_pendulum(
    stiffness: float = 1.0,
) -> tuple[ffr.Mechanism, dict[str, ffr.VolumeIntegrals]]:
    """A bar that hangs from a hinge and is let go at an angle, without any damping."""
    bar = beam(0.4, 0.01, 0.01, elements=8, modes=3, frame="chord")
    bar = replace(bar, K=stiffness * bar.K)
    mechanism = ffr.Mechanism(
        placements={"bar": ffr.Placement((0.2, 0.0), 0.0)},
        joints=[ffr.Revolute(("bar", "left"), ffr.Ground(), name="hinge")],
        gravity=(0.0, -G),
    )
    return mechanism, {"bar": bar}


def energy(trajectory: ffr.Trajectory) -> np.ndarray:
    """The total energy of the bar [J]."""
    parts = (trajectory.kinetic_energy, trajectory.strain_energy, trajectory.potential_energy)
    return sum(part("bar") for part in parts)


def softer_and_heavier(body: ffr.VolumeIntegrals) -> ffr.VolumeIntegrals:
    """A change of a body that does not depend on the signs of its shape functions."""
    heavier = body.scaled(0.7)
    fixed = {
        name: ffr.BodyMarker(0.0 * m.position, 0.0 * m.displacement, 0.0 * m.rotation)
        for name, m in body.markers.items()
    }
    return replace(heavier, K=-0.4 * body.K, markers=fixed)


def check_gradient(
    mechanism: ffr.Mechanism,
    bodies: dict[str, ffr.VolumeIntegrals],
    integrator: Integrator,
) -> None:
    """Demand Taylor order 2 of the derivative by the bodies' integrals."""
    problem = ffr.MechanicalProblem(mechanism, integrator, ffr.IntegralCompliance())
    evaluation = problem.gradient(bodies)
    assert evaluation.integrals_gradient is not None
    direction = {name: softer_and_heavier(body) for name, body in bodies.items()}
    slope = sum(evaluation.integrals_gradient[name].dot(d) for name, d in direction.items())
    result = taylor_test(
        lambda s: problem.value(moved(bodies, direction, float(s[0]))).psi,
        lambda s: float(s[0] * slope),
        np.zeros(1),
        np.ones(1),
        steps=[1e-3 / 2**k for k in range(4)],
        roundoff=1e-11,
    )
    assert_taylor_order(result)


@pytest.mark.slow
def test_energy_over_a_hundred_thousand_steps() -> None:
    """Without damping, physical or numerical, the energy stays where it is."""
    mechanism, bodies = flexible_pendulum()
    # some twenty steps a period of the first bending mode; 250 swings
    integrator = ffr.GeneralizedAlpha(250.0, 100_000, spectral_radius=1.0)
    trajectory = ffr.simulate(mechanism, bodies, integrator)
    total = energy(trajectory)
    swing = np.ptp(trajectory.kinetic_energy("bar"))
    assert np.abs(total - total[0]).max() < 0.02 * swing
    late, early = total[-20_000:], total[:20_000]
    assert abs(late.mean() - early.mean()) < 2e-3 * swing
    hinge = trajectory.marker_path("bar", "left")
    assert np.abs(hinge).max() < 1e-9  # no drift


@both_methods
@pytest.mark.parametrize("stiffness", [1e-2, 1e6])
def test_very_soft_and_very_stiff(stiffness: float, method: Method) -> None:
    """The soft bar bends a lot, the stiff one is rigid; both have an exact gradient."""
    mechanism, bodies = flexible_pendulum(stiffness)
    integrator = method(0.5, 1000)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ffr.SofteningWarning)
        trajectory = ffr.simulate(mechanism, bodies, integrator)
        assert np.all(np.isfinite(trajectory.y))
        check_gradient(mechanism, bodies, integrator)
    if stiffness > 1.0:
        rigid = {"bar": bodies["bar"].leading(0)}
        expected = ffr.simulate(mechanism, rigid, integrator).rigid("bar")
        # the chord frame of a bar that does not bend is the rigid bar's
        assert np.abs(trajectory.rigid("bar") - expected).max() < 1e-5


@both_methods
@pytest.mark.filterwarnings("ignore::dolfinx_ffr.SofteningWarning")  # of motions far from any
@pytest.mark.filterwarnings("ignore::dolfinx_ffr.LargeDeformationWarning")
def test_steps_far_too_large(method: Method) -> None:
    """The result is finite or the error is clear; no NaN is handed on."""
    mechanism, bodies = flexible_pendulum()
    for steps in (1, 2, 3, 5, 8, 32):
        try:
            trajectory = ffr.simulate(mechanism, bodies, method(20.0, steps))
        except ffr.SimulationError as error:
            assert "take smaller steps" in str(error) and "t = " in str(error)
            trajectory = error.trajectory
        assert np.all(np.isfinite(trajectory.y)) and np.all(np.isfinite(trajectory.multipliers))


@pytest.mark.parametrize(
    ("integrator", "message"),
    [
        (ffr.GeneralizedAlpha(0.5, 1), r"of its positions, .* error of 0\.\d in .* instead of 1,"),
        (ffr.GeneralizedAlpha(0.5, 5), r"of its positions, .* error of 0\.\d in .* instead of 5,"),
        (ffr.RadauIIA(0.5, steps=1), r"of its positions, .* error of \S+ in .* instead of 1,"),
    ],
)
@pytest.mark.filterwarnings("error::dolfinx_ffr.TimeStepWarning")
def test_too_few_steps_are_reported(integrator: Integrator, message: str) -> None:
    """The number of steps that the message advises is accepted."""
    rod = beam(modes=2, elements=4)
    mechanism = slider_crank_mechanism(ffr.Motion.smooth_step(10.0 * math.pi, 2.0))
    with pytest.warns(ffr.TimeStepWarning, match=message) as caught:
        ffr.simulate(mechanism, {"rod": rod}, integrator)
    enough = int(str(caught[0].message).split("take ")[1].split(" steps")[0])
    ffr.simulate(mechanism, {"rod": rod}, replace(integrator, steps=enough))


@pytest.mark.parametrize(("name", "steps"), [("robot", 16), ("robot", 32), ("slider_crank", 32)])
@pytest.mark.filterwarnings("error::dolfinx_ffr.TimeStepWarning")
def test_too_few_steps_for_vibrations_are_reported(name: str, steps: int) -> None:
    """Where psi is off by 16, 24 and 6 percent, though the rigid motion is well resolved."""
    shipped: Scene = getattr(scenes, name)()
    with pytest.warns(ffr.TimeStepWarning, match=r"of its deformations, an estimated") as caught:
        ffr.simulate(shipped.mechanism, shipped.bodies, replace(shipped.integrator, steps=steps))
    enough = int(str(caught[0].message).split("take ")[1].split(" steps")[0])
    # that many and the shipped ones are silent
    ffr.simulate(shipped.mechanism, shipped.bodies, replace(shipped.integrator, steps=enough))
    ffr.simulate(shipped.mechanism, shipped.bodies, shipped.integrator)


@pytest.mark.parametrize("steps", [8, 12])
def test_vibrations_that_radau_damps_away_are_reported(steps: int) -> None:
    """Where psi is off by 43 and 17 percent, and the order of the method would promise little."""
    shipped = scenes.robot()
    integrator = ffr.RadauIIA(shipped.integrator.end_time, steps=steps)
    with pytest.warns(ffr.TimeStepWarning, match=rf"of its deformations, .* instead of {steps},"):
        ffr.simulate(shipped.mechanism, shipped.bodies, integrator)


@pytest.mark.filterwarnings("error::dolfinx_ffr.TimeStepWarning")
def test_vibrations_that_nothing_excites_are_not_reported() -> None:
    """A rod on a crank from rest to rest: five of its modes are above what the steps resolve."""
    rod = beam(modes=6)
    mechanism = slider_crank_mechanism(ffr.Motion.smooth_step(math.pi, 4.0))
    highest = scipy.linalg.eigh(rod.K, rod.G[1:, 1:], eigvals_only=True)[-5:]
    assert np.all(np.sqrt(highest) * 4.0 / 60 > math.pi)
    ffr.simulate(mechanism, {"rod": rod}, ffr.GeneralizedAlpha(4.0, 60))


@both_methods
def test_a_rod_driven_at_both_ends_is_reported(method: Method) -> None:
    """A linear rod may be stretched to any length, which the warning says in numbers."""
    rod = beam(modes=4, elements=4)
    mechanism = slider_crank_mechanism(ffr.Motion.polynomial([0.0, 2.0]))
    held = ffr.Revolute(("rod", "right"), ffr.Ground((0.5, 0.0)))
    mechanism = replace(mechanism, joints=[mechanism.joints[0], held], point_masses=[])
    integrator = method(math.pi / 2.0, 400)
    # At the end it reaches over 0.6 m, a half more, by quarter of a sine: a half over root two.
    message = r"body 'rod' is deformed by 0\.35 of its length \(root mean square\) at t = 1\.571 s"
    with pytest.warns(ffr.LargeDeformationWarning, match=message):
        ffr.simulate(mechanism, {"rod": rod}, integrator)


@both_methods
@pytest.mark.parametrize("ratio", [0.5, 0.98, 1.02, 3.0])
def test_around_the_softening_limit(ratio: float, method: Method) -> None:
    """Below the first frequency the bar is sound; from there on it is reported by name."""
    bar = beam(1.0, 0.01, 0.01, elements=8, modes=3, frame="tangent")
    lowest = math.sqrt(np.min(np.linalg.eigvals(np.linalg.solve(bar.G[1:, 1:], bar.K)).real))
    speed = ratio * lowest
    spin = ffr.Motion.polynomial([0.0, speed], "spin")
    zero = ffr.Motion.constant(0.0)
    mechanism = ffr.Mechanism(
        placements={"bar": ffr.Placement((0.0, 0.0), 0.0, angular_velocity=speed)},
        joints=[ffr.Weld(("bar", "left"), ffr.Moving(zero, zero, spin, "hub"), angle=0.0)],
    )
    integrator = method(4.0 * math.pi / lowest, 400)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            trajectory = ffr.simulate(mechanism, {"bar": bar}, integrator)
        except ffr.SimulationError as error:
            assert ratio > 1.0
            trajectory = error.trajectory
    warned = [w for w in caught if issubclass(w.category, ffr.SofteningWarning)]
    assert bool(warned) == (ratio > 1.0)
    assert all("'bar' turns with" in str(w.message) for w in warned)
    assert np.all(np.isfinite(trajectory.y))


@both_methods
def test_jumps_in_the_prescribed_acceleration(method: Method) -> None:
    """A trapezoidal velocity profile: joints hold, and the gradient is exact."""
    a, ramp, total = 40.0, 0.1, 0.4

    def acceleration(t: np.ndarray) -> np.ndarray:
        return np.where(t < ramp, a, np.where(t < total - ramp, 0.0, np.where(t < total, -a, 0.0)))

    def velocity(t: np.ndarray) -> np.ndarray:
        return a * np.clip(np.minimum(t, total - t), 0.0, ramp)

    def angle(t: np.ndarray) -> np.ndarray:
        t = np.clip(t, 0.0, total)
        late = np.clip(t - (total - ramp), 0.0, None)
        early = np.minimum(t, ramp)
        return 0.5 * a * early**2 + a * ramp * np.clip(t - ramp, 0.0, None) - 0.5 * a * late**2

    mechanism, bodies = flexible_pendulum()
    motion = ffr.Motion(angle, velocity, acceleration, "drive", (ramp, total - ramp, total))
    drive = ffr.PrescribedAngle(("bar", "left"), motion)
    mechanism = replace(mechanism, joints=[*mechanism.joints, drive])
    integrator = method(0.5, 500)
    trajectory = ffr.simulate(mechanism, bodies, integrator)
    assert np.abs(trajectory.marker_path("bar", "left")).max() < 1e-12
    assert np.all(np.isfinite(trajectory.multipliers))
    check_gradient(mechanism, bodies, integrator)


@both_methods
def test_force_that_jumps(method: Method) -> None:
    """A step load: momentum balance holds over the jump, and the gradient is exact."""
    bar = beam(0.4, 0.01, 0.01, elements=8, modes=3, frame="free")
    push = ffr.Force(("bar", "right"), 0.0, lambda t: np.where(np.asarray(t) > 0.0503, 5.0, 0.0))
    mechanism = ffr.Mechanism(placements={"bar": ffr.Placement()}, forces=[push], jumps=[0.0503])
    integrator = method(0.2, 2000)
    trajectory = ffr.simulate(mechanism, {"bar": bar}, integrator)
    gained = trajectory.linear_momentum("bar")[-1, 1]
    # a step's worth, or nothing where a step ends at the jump
    tolerance = 2e-3 if method is generalized_alpha else 1e-9
    assert gained == pytest.approx(5.0 * (0.2 - 0.0503), rel=tolerance)
    check_gradient(mechanism, {"bar": bar}, integrator)


@both_methods
def test_start_with_inconsistent_velocities(method: Method) -> None:
    """Velocities that tear the joints are corrected to the nearest that do not."""
    mechanism, bodies = flexible_pendulum()
    wrong = ffr.Placement((0.2, 0.0), 0.0, velocity=(3.0, -2.0), angular_velocity=1.0)
    mechanism = replace(mechanism, placements={"bar": wrong})
    trajectory = ffr.simulate(mechanism, bodies, method(0.2, 400))
    path = trajectory.marker_path("bar", "left")
    assert np.abs(path).max() < 1e-12
    assert np.abs(np.diff(path, axis=0)).max() < 1e-12
    check_gradient(mechanism, bodies, method(0.2, 400))


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("length", [0.1001, 0.101, 0.12])
def test_crank_nearly_as_long_as_the_rod(length: float, method: Method) -> None:
    """The slider-crank turns through its dead centres, where the rod stands across."""
    rod = beam(length, 0.01, 0.01, elements=8, modes=3, frame="chord")
    mechanism = slider_crank_mechanism(EVEN_TURN, rod=length, slider=0.1)
    integrator = method(2.2, 4400)
    trajectory = ffr.simulate(mechanism, {"rod": rod}, integrator)
    slider = trajectory.marker_path("rod", "right")
    assert np.abs(slider[:, 1]).max() < 1e-10
    phi = 3.0 * trajectory.t
    # the bending is far below the tolerance, so the rigid mechanism's closed form holds
    root = np.sqrt(length**2 - (0.1 * np.sin(phi)) ** 2)
    assert np.abs(slider[:, 0] - (0.1 * np.cos(phi) + root)).max() < 1e-3 * length
    if length > 0.11:
        check_gradient(mechanism, {"rod": rod}, integrator)


def test_adaptive_steps_through_dead_centres() -> None:
    """Where the rod stands across, steps become short; around it they are long."""
    length = 0.101
    rod = beam(length, 0.01, 0.01, elements=8, modes=2, frame="chord")
    mechanism = replace(slider_crank_mechanism(EVEN_TURN, rod=length), point_masses=[])
    trajectory = ffr.simulate(mechanism, {"rod": rod}, end_time=2.2, tolerance=1e-5)
    lengths = np.diff(trajectory.step_ends)
    shortest = trajectory.step_ends[np.argmin(lengths[5:]) + 5]
    assert abs(np.sin(3.0 * shortest)) > 0.9
    slider = trajectory.marker_path("rod", "right")[:, 0]
    phi = 3.0 * trajectory.t
    exact = 0.1 * np.cos(phi) + np.sqrt(length**2 - (0.1 * np.sin(phi)) ** 2)
    assert np.abs(slider - exact).max() < 1e-5 * length


@both_methods
def test_redundant_joints_are_named(method: Method) -> None:
    mechanism, bodies = flexible_pendulum()
    twice = replace(
        mechanism,
        joints=[*mechanism.joints, ffr.Revolute(("bar", "left"), ffr.Ground(), name="again")],
    )
    with pytest.raises(ValueError, match=r"redundant; joints involved: \['hinge', 'again'\]"):
        ffr.simulate(twice, bodies, method(0.1, 10))


def test_contradictory_joints_are_named() -> None:
    mechanism, bodies = flexible_pendulum()
    apart = replace(
        mechanism,
        joints=[
            *mechanism.joints,
            ffr.Revolute(("bar", "right"), ffr.Ground((5.0, 0.0)), name="far"),
        ],
    )
    with pytest.raises(ValueError, match="far"):
        ffr.simulate(apart, bodies, ffr.GeneralizedAlpha(0.1, 10))
