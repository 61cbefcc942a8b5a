# SPDX-License-Identifier: MIT
"""Several numbers from one simulation, and parameters of given bodies; without a mesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shared.scenes import Scene, four_bar, moved, random_direction

from dolfinx_ffr import mechanical_problem
from dolfinx_ffr.body.parametric import ParametricBody
from dolfinx_ffr.body.volume_integrals import VolumeIntegrals
from dolfinx_ffr.mechanical_problem import MechanicalProblem
from dolfinx_ffr.objective import (
    Constraint,
    Frequency,
    IntegralCompliance,
    JointForce,
    Mass,
    PeakCompliance,
)
from dolfinx_ffr.verification import assert_taylor_order, central_difference, taylor_test

CONSTRAINTS = [
    Constraint(Mass("coupler"), upper=0.2, name="light"),
    Constraint(Frequency("rocker"), lower=50.0),
    Constraint(JointForce("motor", power=8.0), upper=3.0, name="motor"),
]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return four_bar(steps=60)


class Count:
    """Counts the calls of the simulation and of the adjoint."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.calls = {"simulate": 0, "adjoint": 0}
        for name in self.calls:
            monkeypatch.setattr(mechanical_problem, name, self._counted(name))

    def _counted(self, name: str):  # type: ignore[no-untyped-def]
        function = getattr(mechanical_problem, name)

        def counted(*args):  # type: ignore[no-untyped-def]
            self.calls[name] += 1
            return function(*args)

        return counted


def test_several_numbers_from_one_simulation(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    count = Count(monkeypatch)
    problem = MechanicalProblem(
        scene.mechanism, scene.integrator, IntegralCompliance(), CONSTRAINTS
    )
    result = problem.gradient(scene.bodies)
    # One adjoint pass for the compliance and one for the motor; mass and frequency need none.
    assert count.calls == {"simulate": 1, "adjoint": 2}
    assert list(result.constraints) == ["light", "Frequency", "motor"]
    assert result.constraints["light"].psi == scene.bodies["coupler"].mass
    assert result.constraints["light"].value == pytest.approx(
        scene.bodies["coupler"].mass / 0.2 - 1.0, rel=1e-13
    )
    frequency = result.constraints["Frequency"]
    assert frequency.value == pytest.approx(1.0 - frequency.psi / 50.0, rel=1e-13)
    direction = random_direction(scene.bodies, 3)
    for constraint in CONSTRAINTS:
        alone = MechanicalProblem(scene.mechanism, scene.integrator, constraint.objective)
        own = result.constraints[constraint.label]
        assert own.psi == alone.value(scene.bodies).psi

        def g(step: np.ndarray, label: str = constraint.label) -> float:
            bodies = moved(scene.bodies, direction, float(step))
            return problem.value(bodies).constraints[label].value

        assert own.integrals_gradient is not None
        slope = sum(bar.dot(direction[name]) for name, bar in own.integrals_gradient.items())
        assert slope == pytest.approx(central_difference(g, 0.0, 1.0, 1e-4), rel=1e-6)


def test_nothing_is_simulated_where_the_motion_does_not_matter(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = Count(monkeypatch)
    problem = MechanicalProblem(
        scene.mechanism, scene.integrator, 2.0 * Mass("coupler") + Mass("rocker"), CONSTRAINTS[1:2]
    )
    assert not problem.needs_trajectory
    result = problem.gradient(scene.bodies)
    assert count.calls == {"simulate": 0, "adjoint": 0}
    assert result.trajectory is None
    assert result.integrals_gradient is not None
    assert {name: bar.mass for name, bar in result.integrals_gradient.items()} == {
        "crank": 0.0,
        "coupler": 2.0,
        "rocker": 1.0,
    }
    # Bodies that are not valid are refused all the same.
    broken = {**scene.bodies, "crank": replace(scene.bodies["crank"], mass=-1.0)}
    with pytest.raises(ValueError, match="'crank': the mass must be positive"):
        problem.value(broken)


def test_objective_without_influence_needs_no_adjoint(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = Count(monkeypatch)
    problem = MechanicalProblem(scene.mechanism, scene.integrator, 0.0 * PeakCompliance())
    result = problem.gradient(scene.bodies)
    assert result.psi == 0.0
    assert count.calls == {"simulate": 1, "adjoint": 0}


def test_names_of_constraints(scene: Scene) -> None:
    twice = [Constraint(Mass("coupler"), 1.0), Constraint(Mass("rocker"), 1.0)]
    with pytest.raises(ValueError, match="two constraints have the name 'Mass'"):
        MechanicalProblem(scene.mechanism, scene.integrator, Mass("crank"), twice)


def crank(p: np.ndarray) -> VolumeIntegrals:
    """A crank whose mass and centre of mass are free."""
    markers = {"left": (-0.05, 0.0), "right": (0.05, 0.0)}
    return VolumeIntegrals.rigid(p[0], (p[1], 0.005), 4e-4, markers)


def crank_jacobian(p: np.ndarray) -> list[VolumeIntegrals]:
    zero = crank(p).zeros_like()
    by_mass = replace(
        zero, mass=1.0, S=np.array([[p[1], 0.005]]), G=np.array([[p[1] ** 2 + 0.005**2]])
    )
    by_center = replace(zero, S=np.array([[p[0], 0.0]]), G=np.array([[2.0 * p[0] * p[1]]]))
    return [by_mass, by_center]


def test_parameters_of_a_given_body(scene: Scene) -> None:
    problem = MechanicalProblem(scene.mechanism, scene.integrator, JointForce("motor bearing"))
    p = np.array([0.3, 0.02])
    direction = np.array([0.1, -0.02])

    def value(p: np.ndarray) -> float:
        return problem.value({**scene.bodies, "crank": body(p)}).psi

    jacobian = ParametricBody(crank, crank_jacobian)
    transpose = ParametricBody(
        crank, pullback=lambda p, bar: [bar.dot(d) for d in crank_jacobian(p)]
    )
    for body in (jacobian, transpose):
        gradient = problem.gradient({**scene.bodies, "crank": body(p)}).integrals_gradient
        assert gradient is not None
        slope = body.pullback(p, gradient["crank"])
        result = taylor_test(value, lambda d, slope=slope: float(slope @ d), p, direction)
        assert_taylor_order(result)


def test_parametric_body_refuses() -> None:
    with pytest.raises(ValueError, match="either a jacobian or a pullback"):
        ParametricBody(crank)
    with pytest.raises(ValueError, match="either a jacobian or a pullback"):
        ParametricBody(crank, crank_jacobian, pullback=lambda p, bar: p)
    body = ParametricBody(crank, lambda p: crank_jacobian(p)[:1])
    with pytest.raises(ValueError, match="finite numbers"):
        body([0.3, float("nan")])
    with pytest.raises(ValueError, match="mass must be positive"):
        body([-0.3, 0.0])
    with pytest.raises(ValueError, match=r"2 parameters, but derivatives of shape \(1,\)"):
        body.pullback([0.3, 0.0], body([0.3, 0.0]).zeros_like())
