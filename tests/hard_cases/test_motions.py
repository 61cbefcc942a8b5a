# SPDX-License-Identifier: MIT
"""Motions that strain the time integration: long, fast, stiff, jerky, singular, contradictory."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from shared import scenes
from shared.beams import beam
from shared.derivatives import Bodies, along, check_slope, dot
from shared.motions import energy_and_momenta
from shared.scenes import Scene, slider_crank_mechanism, trapezoidal_drive

import dolfinx_ffr as ffr

# of bodies that are let go; what is about them says so
pytestmark = pytest.mark.filterwarnings("ignore:.*excites vibrations:dolfinx_ffr.TimeStepWarning")

Integrator = ffr.GeneralizedAlpha | ffr.RadauIIA
Method = Callable[[float, int], Integrator]


def radau(end_time: float, steps: int) -> Integrator:
    """The method with a quarter of the steps, each of which costs more."""
    return ffr.RadauIIA(end_time, steps=max(steps // 4, 1))


#: Of a crank [rad].
EVEN_TURN = ffr.Motion.polynomial([0.0, 3.0])

both_methods = pytest.mark.parametrize("method", [ffr.GeneralizedAlpha, radau])


def flexible_pendulum(stiffness: float = 1.0) -> tuple[ffr.Mechanism, Bodies]:
    """A bar that hangs from a hinge and is let go at an angle, without any damping."""
    bar = beam(0.4, 0.01, 0.01, elements=8, modes=3, frame="chord")
    hinge = ffr.Revolute(("bar", "left"), ffr.Ground(), name="hinge")
    mechanism = ffr.Mechanism({"bar": ffr.Placement((0.2, 0.0))}, [hinge], gravity=(0.0, -9.81))
    return mechanism, {"bar": replace(bar, K=stiffness * bar.K)}


def softer_and_heavier(body: ffr.VolumeIntegrals) -> ffr.VolumeIntegrals:
    """A change of a body that does not depend on the signs of its shape functions."""
    return replace(body.scaled(0.7), K=-0.4 * body.K, markers=body.zeros_like().markers)


def check_gradient(mechanism: ffr.Mechanism, bodies: Bodies, integrator: Integrator) -> None:
    """Demand Taylor order 2 of the derivative by the bodies' integrals."""
    problem = ffr.MechanicalProblem(mechanism, integrator, ffr.IntegralCompliance())
    direction = {name: softer_and_heavier(body) for name, body in bodies.items()}
    slope = dot(problem.gradient(bodies).integrals_gradient, direction)
    psi = along(lambda moved: problem.value(moved).psi, bodies, direction)
    check_slope(psi, slope, 1e-3, count=4, roundoff=1e-11)


@pytest.mark.slow
def test_energy_over_a_hundred_thousand_steps() -> None:
    """Without damping, physical or numerical, the energy stays where it is."""
    mechanism, bodies = flexible_pendulum()
    # some twenty steps a period of the first bending mode; 250 swings
    integrator = ffr.GeneralizedAlpha(250.0, 100_000, spectral_radius=1.0)
    trajectory = ffr.simulate(mechanism, bodies, integrator)
    total = energy_and_momenta(trajectory)[0] + trajectory.potential_energy("bar")
    swing = np.ptp(trajectory.kinetic_energy("bar"))
    assert np.abs(total - total[0]).max() < 0.02 * swing
    assert abs(total[-20_000:].mean() - total[:20_000].mean()) < 2e-3 * swing
    assert np.abs(trajectory.marker_path("bar", "left")).max() < 1e-9  # no drift


@both_methods
@pytest.mark.filterwarnings("ignore::dolfinx_ffr.SofteningWarning")
@pytest.mark.parametrize("stiffness", [1e-2, 1e6])
def test_very_soft_and_very_stiff(stiffness: float, method: Method) -> None:
    """The soft bar bends a lot, the stiff one is rigid; both have an exact gradient."""
    mechanism, bodies = flexible_pendulum(stiffness)
    integrator = method(0.5, 1000)
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
            assert "or RadauIIA(end_time, tolerance=1e-6), which takes short ones" in str(error)
            trajectory = error.trajectory
        assert np.all(np.isfinite(trajectory.y)) and np.all(np.isfinite(trajectory.multipliers))


def test_a_step_of_seconds_is_no_singular_mechanism() -> None:
    """As where end time and number of steps are exchanged: the length of the step is told."""
    scene = scenes.slider_crank()
    with pytest.raises(ffr.SimulationError, match=r"step 1 of 60, 8\.33 s each\) Newton's method"):
        ffr.simulate(scene.mechanism, scene.bodies, ffr.GeneralizedAlpha(500, 60))


def advised(caught: Any, kind: str) -> int:
    """The number of steps that a message of some kind advises."""
    message = next(str(w.message) for w in caught if f"of its {kind}" in str(w.message))
    return int(message.split("take ")[1].split(" steps")[0])


def check_silent(mechanism: ffr.Mechanism, bodies: Bodies, *integrators: Integrator) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", ffr.TimeStepWarning)
        warnings.filterwarnings("ignore", ".*excites vibrations")
        for integrator in integrators:
            ffr.simulate(mechanism, bodies, integrator)


@pytest.mark.parametrize(
    ("integrator", "error"),
    [
        (ffr.GeneralizedAlpha(0.5, 5), r"0\.\d, .* instead of 5,"),
        (ffr.RadauIIA(0.5, steps=1), r"\S+, .* instead of 1,"),
    ],
)
def test_too_few_steps_are_reported(integrator: Integrator, error: str) -> None:
    rod = {"rod": beam(modes=2, elements=4)}
    mechanism = slider_crank_mechanism(ffr.Motion.smooth_step(10.0 * math.pi, 2.0))
    message = f"of its positions has .* error of {error}"
    with pytest.warns(ffr.TimeStepWarning, match=message) as caught:
        ffr.simulate(mechanism, rod, integrator)
    check_silent(mechanism, rod, replace(integrator, steps=advised(caught, "positions")))


@pytest.mark.parametrize(
    ("name", "method", "steps"),
    [
        ("robot", ffr.GeneralizedAlpha, 32),
        ("slider_crank", ffr.GeneralizedAlpha, 32),
        ("robot", ffr.RadauIIA, 12),
    ],
)
def test_too_few_steps_for_vibrations_are_reported(name: str, method: Any, steps: int) -> None:
    """Where psi is off by 6 to 43 percent, though the rigid motion is well resolved."""
    shipped: Scene = getattr(scenes, name)()
    integrator = method(shipped.integrator.end_time, steps=steps)
    message = rf"of its deformations has .* instead of {steps},"
    with pytest.warns(ffr.TimeStepWarning, match=message) as caught:
        ffr.simulate(shipped.mechanism, shipped.bodies, integrator)
    if method is ffr.GeneralizedAlpha:  # that many and the shipped ones are silent
        enough = replace(integrator, steps=advised(caught, "deformations"))
        check_silent(shipped.mechanism, shipped.bodies, enough, shipped.integrator)


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
    joint = ffr.Revolute(("rod", "right"), ffr.Ground((0.5, 0.0)))
    mechanism = replace(mechanism, joints=[mechanism.joints[0], joint], point_masses=[])
    integrator = method(math.pi / 2.0, 400)
    # At the end it reaches over 0.6 m, a half more, by quarter of a sine: a half over root two.
    message = r"body 'rod' is deformed by 0\.35 of its length \(root mean square\) at t = 1\.571 s"
    with pytest.warns(ffr.LargeDeformationWarning, match=message):
        ffr.simulate(mechanism, {"rod": rod}, integrator)


@both_methods
@pytest.mark.parametrize("ratio", [0.98, 1.02])
def test_around_the_softening_limit(ratio: float, method: Method) -> None:
    """Below the first frequency the bar is sound; from there on it is reported by name."""
    bar = beam(1.0, 0.01, 0.01, elements=8, modes=3, frame="tangent")
    lowest = math.sqrt(np.min(np.linalg.eigvals(np.linalg.solve(bar.G[1:, 1:], bar.K)).real))
    speed = ratio * lowest
    spin, zero = ffr.Motion.polynomial([0.0, speed], "spin"), ffr.Motion.constant(0.0)
    hub = ffr.Weld(("bar", "left"), ffr.Moving(zero, zero, spin, "hub"), angle=0.0)
    mechanism = ffr.Mechanism({"bar": ffr.Placement(angular_velocity=speed)}, [hub])
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
@pytest.mark.parametrize("jumps", [True, False], ids=["jumps", "wrong velocities"])
def test_a_joint_holds(jumps: bool, method: Method) -> None:
    """And the gradient is exact: with a trapezoidal velocity of a drive, whose acceleration jumps.

    And with velocities at the start that tear it, which are corrected to the nearest that do not.
    """
    mechanism, bodies = flexible_pendulum()
    if jumps:
        drive = ffr.PrescribedAngle(("bar", "left"), trapezoidal_drive())
        mechanism = replace(mechanism, joints=[*mechanism.joints, drive])
        integrator = method(0.5, 500)
    else:
        wrong = ffr.Placement((0.2, 0.0), 0.0, velocity=(3.0, -2.0), angular_velocity=1.0)
        mechanism = replace(mechanism, placements={"bar": wrong})
        integrator = method(0.2, 400)
    trajectory = ffr.simulate(mechanism, bodies, integrator)
    path = trajectory.marker_path("bar", "left")
    assert np.abs(path).max() < 1e-12 and np.abs(np.diff(path, axis=0)).max() < 1e-12
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
    tolerance = 2e-3 if method is ffr.GeneralizedAlpha else 1e-9
    assert gained == pytest.approx(5.0 * (0.2 - 0.0503), rel=tolerance)
    check_gradient(mechanism, {"bar": bar}, integrator)


def off_the_closed_form(trajectory: ffr.dynamics.Trajectory, length: float) -> float:
    """How far the slider of a rod of some length is from where that of a rigid one is."""
    phi = 3.0 * trajectory.t
    exact = 0.1 * np.cos(phi) + np.sqrt(length**2 - (0.1 * np.sin(phi)) ** 2)
    return float(np.abs(trajectory.marker_path("rod", "right")[:, 0] - exact).max())


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("length", [0.1001, 0.12])
def test_crank_nearly_as_long_as_the_rod(length: float, method: Method) -> None:
    """The slider-crank turns through its dead centres, where the rod stands across."""
    rod = beam(length, 0.01, 0.01, elements=8, modes=3, frame="chord")
    mechanism = slider_crank_mechanism(EVEN_TURN, rod=length, slider=0.1)
    integrator = method(2.2, 4400)
    trajectory = ffr.simulate(mechanism, {"rod": rod}, integrator)
    assert np.abs(trajectory.marker_path("rod", "right")[:, 1]).max() < 1e-10
    # the bending is far below the tolerance, so the rigid mechanism's closed form holds
    assert off_the_closed_form(trajectory, length) < 1e-3 * length
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
    assert off_the_closed_form(trajectory, length) < 1e-5 * length
