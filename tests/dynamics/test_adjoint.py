# SPDX-License-Identifier: MIT
"""Discrete adjoint: exact derivatives with respect to all integrals of all bodies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from shared.beams import beam
from shared.derivatives import along, check_slope, difference, dot, moved, random_direction
from shared.motions import deformed
from shared.scenes import SCENES, Bodies, Scene, calm, loader, robot, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Integrator, Trajectory, TrajectoryBar, adjoint

# Derivatives are those of the steps taken, which lose vibrations of some starts.
pytestmark = pytest.mark.filterwarnings("ignore:.*excites vibrations:dolfinx_ffr.TimeStepWarning")

QUANTITIES = ("y", "v", "w", "multipliers")
#: First step of the Taylor tests. In the four-bar's frames the mode shapes nearly contain rigid
#: motions, so it bears smaller changes of its integrals than the others.
STEP = {"slider-crank": 4e-3, "four-bar": 2e-4, "robot": 4e-3, "loader": 1e-3, "stiffened": 4e-3}


def hanging(scene: Scene) -> Scene:
    """A scene from its equilibrium, its drives already in motion."""
    return replace(scene, mechanism=replace(scene.mechanism, start=ffr.StaticEquilibrium()))


def soft_slider_crank() -> Scene:
    """One that starts deformed, soft enough for its steps."""
    scene = replace(slider_crank(0.05, 80), bodies={"rod": beam(modes=2, youngs_modulus=5e8)})
    return deformed(scene, 1e-4)


#: Scenes, and others whose start depends on the bodies
MAKE: dict[str, Callable[[], Scene]] = {
    **SCENES,
    "hanging loader": lambda: hanging(loader(0.05, 40)),
    "deformed loader": lambda: deformed(loader(0.05, 40), 1e-4),
    "deformed robot": lambda: deformed(robot(0.05, 40), 1e-4),
    "deformed slider-crank": soft_slider_crank,
}


@dataclass(frozen=True)
class Case:
    """A scene, its time integration, and the compliance as a function of the bodies."""

    name: str
    scene: Scene
    integrator: Integrator

    @property
    def radau(self) -> bool:
        return isinstance(self.integrator, ffr.RadauIIA)

    @property
    def step(self) -> float:
        return 4e-3 if self.radau and self.name == "loader" else STEP[self.name.split()[-1]]

    @property
    def problem(self) -> ffr.MechanicalProblem:
        objective = ffr.IntegralCompliance()
        return ffr.MechanicalProblem(self.scene.mechanism, self.integrator, objective)

    @property
    def gradient(self) -> Bodies:
        gradient = self.problem.gradient(self.scene.bodies).integrals_gradient
        assert gradient is not None
        return gradient

    def along(self, direction: Bodies) -> Callable[[float], float]:
        problem = self.problem
        return along(lambda bodies: problem.value(bodies).psi, self.scene.bodies, direction)

    def run(self, bodies: Bodies | None = None) -> Trajectory:
        return ffr.simulate(self.scene.mechanism, bodies or self.scene.bodies, self.integrator)


def case_of(name: str, *, radau: bool = False) -> Case:
    if not radau:
        scene = MAKE[name]()
        return Case(name, scene, scene.integrator)
    # Steps of unlike lengths, short enough for every scene.
    scene = calm(name)
    end = scene.integrator.end_time
    ends = np.linspace(0.0, 1.0, 241 if scene.bodies.get("arm", beam()).stiffening else 121)
    ends = end * (ends + 0.05 * np.sin(2.0 * np.pi * ends))
    return Case(name, scene, ffr.RadauIIA(end, steps=ends))


BY_RADAU = [pytest.param((name, True), marks=pytest.mark.slow) for name in SCENES]


@pytest.fixture(scope="module", params=[*((name, False) for name in MAKE), *BY_RADAU], ids=str)
def case(request: pytest.FixtureRequest) -> tuple[Case, Bodies]:
    """A case and its gradient."""
    name, radau = request.param
    example = case_of(name, radau=radau)
    return example, example.gradient


def test_taylor_order_over_decades(case: tuple[Case, Bodies]) -> None:
    example, gradient = case
    direction = random_direction(example.scene.bodies, 3 if example.radau else 5)
    slope, psi = dot(gradient, direction), example.along(direction)
    if example.radau:
        check_slope(psi, slope, example.step, points=4)
    else:
        # psi of the four-bar changes by 1e-13 of itself where bodies change by less than round-off
        check_slope(psi, slope, example.step, count=7, ratio=10.0**0.5, points=5, roundoff=1e-13)


# the placements of these close the joints
@pytest.mark.slow
@pytest.mark.parametrize(
    "case", [("slider-crank", False), ("four-bar", False), ("four-bar", True)], indirect=True
)
def test_positions_of_markers(case: tuple[Case, Bodies]) -> None:
    example, gradient = case
    direction = random_direction(example.scene.bodies, 4, "R")
    step = (0.05 if example.radau else 0.15) * example.step
    psi = example.along(direction)
    noise = 1e-12 * psi(0.0) / step
    expected = pytest.approx(difference(psi, step), rel=1e-6, abs=noise)
    assert dot(gradient, direction) == expected


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", [(name, radau) for radau in (False, True) for name in SCENES], indirect=True, ids=str
)
def test_every_part_of_the_trajectory(case: tuple[Case, Bodies]) -> None:
    """Random weighted sums of all coordinates, velocities, accelerations and multipliers."""
    example, _ = case
    trajectory, direction = example.run(), random_direction(example.scene.bodies, 3)

    @cache
    def run_at(step: float) -> Trajectory:
        return example.run(moved(example.scene.bodies, direction, step))

    for part in QUANTITIES:
        values = getattr(trajectory, part)
        weights = np.random.default_rng(0).uniform(-1.0, 1.0, values.shape) / values.size
        weights /= np.sqrt(np.mean(values**2, axis=0))
        bar = TrajectoryBar.zeros(trajectory)
        getattr(bar, part)[:] = weights
        expected = difference(
            lambda step, part=part, weights=weights: np.sum(weights * getattr(run_at(step), part)),
            max(0.02 * example.step, 2e-5) if example.radau else 0.5 * example.step,
        )
        slope = dot(adjoint(trajectory, bar).bodies, direction)
        assert slope == pytest.approx(expected, rel=2e-5 if example.radau else 1e-6), part


@pytest.mark.parametrize("radius", [0.0, 0.5, 1.0])
def test_spectral_radius(radius: float) -> None:
    scene = slider_crank(steps=80)
    example = Case("slider-crank", scene, replace(scene.integrator, spectral_radius=radius))
    direction = random_direction(scene.bodies, 3)
    check_slope(example.along(direction), dot(example.gradient, direction), 4e-3, count=3)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [name for name in MAKE if name not in ("slider-crank", "four-bar")]
)
def test_first_steps_alone(name: str) -> None:
    """With two steps the initial accelerations and the method's start are nearly all there is."""
    example = case_of(name)
    example = replace(example, integrator=replace(example.integrator, steps=2, end_time=4e-3))
    trajectory = example.run()
    bar, rng = TrajectoryBar.zeros(trajectory), np.random.default_rng(1)
    for part in QUANTITIES:
        values = getattr(trajectory, part)
        getattr(bar, part)[:] = rng.uniform(-1.0, 1.0, values.shape) / np.max(np.abs(values))
    direction = random_direction(example.scene.bodies, 3)

    def number(bodies: Bodies) -> float:
        t = example.run(bodies)
        return float(sum(np.sum(getattr(bar, part) * getattr(t, part)) for part in QUANTITIES))

    slope = dot(adjoint(trajectory, bar).bodies, direction)
    expected = difference(along(number, example.scene.bodies, direction), 2e-3)
    assert expected == pytest.approx(slope, rel=1e-7)


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
    trajectory = ffr.simulate(scene.mechanism, scene.bodies, scene.integrator)
    with pytest.raises(ValueError, match=message):
        adjoint(trajectory, change(TrajectoryBar.zeros(trajectory)))
