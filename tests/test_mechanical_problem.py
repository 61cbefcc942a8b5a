# SPDX-License-Identifier: MIT
"""Several numbers from one simulation, and parameters of given bodies; without a mesh."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from shared.derivatives import check_slope
from shared.scenes import Scene, four_bar

import dolfinx_ffr as ffr
from dolfinx_ffr import mechanical_problem

CONSTRAINTS = [
    ffr.Constraint(ffr.Mass("coupler"), upper=0.2, name="light"),
    ffr.Constraint(ffr.Frequency("rocker"), lower=50.0),
    ffr.Constraint(ffr.JointForce("motor", power=8.0), upper=3.0, name="motor"),
]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return four_bar(steps=60)


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """How often is simulated, and an adjoint solved."""
    values = {"simulate": 0, "adjoint": 0}
    originals = {name: getattr(mechanical_problem, name) for name in values}
    for name in values:

        def counted(*args: Any, name: str = name) -> Any:
            values[name] += 1
            return originals[name](*args)

        monkeypatch.setattr(mechanical_problem, name, counted)
    return values


def test_several_numbers_from_one_simulation(scene: Scene, calls: dict[str, int]) -> None:
    arguments = (scene.mechanism, scene.integrator)
    problem = ffr.MechanicalProblem(*arguments, ffr.IntegralCompliance(), CONSTRAINTS)
    result = problem.gradient(scene.bodies)
    # One adjoint pass for the compliance and one for the motor; mass and frequency need none.
    assert calls == {"simulate": 1, "adjoint": 2}
    assert list(result.constraints) == ["light", "Frequency", "motor"]
    light, mass = result.constraints["light"], scene.bodies["coupler"].mass
    assert light.value == mass and light.violation == pytest.approx(mass / 0.2 - 1.0, rel=1e-13)
    frequency = result.constraints["Frequency"]
    assert frequency.violation == pytest.approx(1.0 - frequency.value / 50.0, rel=1e-13)
    for constraint in CONSTRAINTS:
        problem_alone = ffr.MechanicalProblem(*arguments, constraint.objective)
        assert result.constraints[constraint.label].value == problem_alone.value(scene.bodies).psi


def test_nothing_is_simulated_without_need(scene: Scene, calls: dict[str, int]) -> None:
    psi = 2.0 * ffr.Mass("coupler") + ffr.Mass("rocker")
    problem = ffr.MechanicalProblem(scene.mechanism, scene.integrator, psi, CONSTRAINTS[1:2])
    assert not problem.needs_trajectory
    result = problem.gradient(scene.bodies)
    assert calls == {"simulate": 0, "adjoint": 0}
    assert result.trajectory is None
    assert result.integrals_gradient is not None
    values = {name: bar.mass for name, bar in result.integrals_gradient.items()}
    assert values == {"crank": 0.0, "coupler": 2.0, "rocker": 1.0}
    # Bodies that are not valid are refused all the same.
    broken = {**scene.bodies, "crank": replace(scene.bodies["crank"], mass=-1.0)}
    with pytest.raises(ValueError, match="'crank': the mass must be positive"):
        problem.value(broken)


def test_objective_without_influence_needs_no_adjoint(scene: Scene, calls: dict[str, int]) -> None:
    problem = ffr.MechanicalProblem(scene.mechanism, scene.integrator, 0.0 * ffr.PeakCompliance())
    result = problem.gradient(scene.bodies)
    assert result.psi == 0.0
    assert calls == {"simulate": 1, "adjoint": 0}


class Stretched(ffr.IntegralCompliance):
    """An objective that stands for three times the compliance."""

    def calibrated(self, response: ffr.Response) -> ffr.Objective:
        return 3.0 * ffr.IntegralCompliance()


def test_calibrated_at_an_evaluation(scene: Scene, calls: dict[str, int]) -> None:
    """The problem and the evaluation, without another simulation, as those with meshes do it."""
    problem = ffr.MechanicalProblem(scene.mechanism, scene.integrator, Stretched())
    value = problem.value(scene.bodies)
    corrected, calibrated = problem.calibrated(value)
    assert calibrated.psi == pytest.approx(3.0 * value.psi, rel=1e-14)
    assert corrected.gradient(scene.bodies).psi == calibrated.psi
    assert calls["simulate"] == 2
    assert corrected.calibrated(calibrated) == (corrected, calibrated)


def test_names_of_constraints(scene: Scene) -> None:
    twice = [ffr.Constraint(ffr.Mass("coupler"), 1.0), ffr.Constraint(ffr.Mass("rocker"), 1.0)]
    with pytest.raises(ValueError, match="two constraints have the name 'Mass'"):
        ffr.MechanicalProblem(scene.mechanism, scene.integrator, ffr.Mass("crank"), twice)


def crank(p: np.ndarray) -> ffr.VolumeIntegrals:
    """A crank whose mass and centre of mass are free."""
    markers = {"left": (-0.05, 0.0), "right": (0.05, 0.0)}
    return ffr.VolumeIntegrals.rigid(p[0], (p[1], 0.005), 4e-4, markers)


def crank_jacobian(p: np.ndarray) -> list[ffr.VolumeIntegrals]:
    zero, (mass, x) = crank(p).zeros_like(), p
    by_mass = {"mass": 1.0, "S": np.array([[x, 0.005]]), "G": np.array([[x**2 + 0.005**2]])}
    by_center = {"S": np.array([[mass, 0.0]]), "G": np.array([[2.0 * mass * x]])}
    return [replace(zero, **by_mass), replace(zero, **by_center)]


def test_parameters_of_a_given_body(scene: Scene) -> None:
    force = ffr.JointForce("motor bearing")
    problem = ffr.MechanicalProblem(scene.mechanism, scene.integrator, force)
    p = np.array([0.3, 0.02])
    direction = np.array([0.1, -0.02])

    def value(way: float) -> float:
        return problem.value({**scene.bodies, "crank": body(p + way * direction)}).psi

    def transpose(p: np.ndarray, bar: ffr.VolumeIntegrals) -> list[float]:
        return [bar.dot(d) for d in crank_jacobian(p)]

    for way in ({"jacobian": crank_jacobian}, {"pullback": transpose}):
        body = ffr.ParametricBody(crank, **way)
        gradient = problem.gradient({**scene.bodies, "crank": body(p)}).integrals_gradient
        assert gradient is not None
        slope = body.pullback(p, gradient["crank"]) @ direction
        check_slope(value, float(slope), 1e-2)


def test_parametric_body_refuses() -> None:
    with pytest.raises(ValueError, match="either a jacobian or a pullback"):
        ffr.ParametricBody(crank)
    with pytest.raises(ValueError, match="either a jacobian or a pullback"):
        ffr.ParametricBody(crank, crank_jacobian, pullback=lambda p, bar: p)
    body = ffr.ParametricBody(crank, lambda p: crank_jacobian(p)[:1])
    with pytest.raises(ValueError, match="finite numbers"):
        body([0.3, float("nan")])
    with pytest.raises(ValueError, match="mass must be positive"):
        body([-0.3, 0.0])
    with pytest.raises(ValueError, match=r"2 parameters, but derivatives of shape \(1,\)"):
        body.pullback([0.3, 0.0], body([0.3, 0.0]).zeros_like())
