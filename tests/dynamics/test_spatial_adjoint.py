# SPDX-License-Identifier: MIT
"""Discrete adjoint in space: exact derivatives with respect to all integrals of all bodies."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.spatial_bodies import cloud, stiffened_cloud

from dolfinx_ffr.body import BodyMarker, VolumeIntegrals
from dolfinx_ffr.dynamics import GeneralizedAlpha, Integrator, RadauIIA, simulate
from dolfinx_ffr.mechanical_problem import MechanicalProblem
from dolfinx_ffr.mechanism import (
    Assembled,
    Bushing,
    Force,
    Gear,
    Ground,
    Mechanism,
    Motion,
    Moving,
    Placement,
    PointMass,
    PointOnPlane,
    PrescribedAngle,
    RayleighDamping,
    Revolute,
    Spherical,
    SpringDamper,
    StaticEquilibrium,
    Torque,
    TorsionalSpringDamper,
    Universal,
)
from dolfinx_ffr.objective import (
    IntegralCompliance,
    JointForce,
    MarkerAcceleration,
    MarkerVelocity,
    Objective,
    PathTracking,
)
from dolfinx_ffr.verification import assert_taylor_order, taylor_test

#: What is tested are derivatives, of motions that no one would want.
pytestmark = [
    pytest.mark.filterwarnings(f"ignore::dolfinx_ffr.dynamics.validity.{name}Warning")
    for name in ("LargeDeformation", "Softening", "TiltedAxis", "TimeStep")
]

Array = NDArray[np.float64]
Bodies = dict[str, VolumeIntegrals]

ONE, TWO, ROOT, TIP = ("one", "tip"), ("two", "root"), ("one", "root"), ("two", "tip")
PLACES = {
    "one": Placement((0.5, 0.0, 0.0)),
    "two": Placement((1.5, 0.1, -0.1), rotation=(0.2, 0.1, 0.0)),
}
CRANK = Moving.circle((0.0, 0.0, 0.0), 0.2, Motion.smooth_step(6.0, 0.5), axis=(0.3, 0.2, 1.0))


@dataclass(frozen=True)
class Case:
    """A mechanism of two flexible bodies, and what is asked of it."""

    mechanism: Mechanism
    objective: Objective
    make: Callable[[int, int], VolumeIntegrals] = cloud
    integrator: Integrator = field(default_factory=lambda: GeneralizedAlpha(0.3, 30))

    @property
    def bodies(self) -> Bodies:
        return {"one": self.make(3, 1), "two": self.make(2, 2)}

    @property
    def problem(self) -> MechanicalProblem:
        return MechanicalProblem(self.mechanism, self.integrator, self.objective)


def loop() -> Case:
    """A closed chain on a crank: ball, Hooke's joint, plane."""
    mechanism = Mechanism(
        PLACES,
        joints=[
            Spherical(ROOT, CRANK),
            Universal(ONE, TWO, (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), "cross"),
            PointOnPlane(TIP, Ground((0.0, 0.0, -0.3)), (0.1, 0.1, 1.0)),
        ],
        gravity=(0.0, 0.0, -9.81),
    )
    path = PathTracking("two", "tip", (lambda t: 2.0 + t, 0.1, -0.3))
    objective = IntegralCompliance() + 0.1 * JointForce("cross") + path
    objective += 1e-3 * MarkerAcceleration("two", "tip") + MarkerVelocity(*ONE)
    return Case(mechanism, objective)


def forced(make: Callable[[int, int], VolumeIntegrals] = cloud) -> Case:
    """An open chain with all kinds of forces, that starts deformed and in motion."""
    mechanism = Mechanism(
        PLACES,
        joints=[Revolute(ROOT, CRANK, axis=(0.0, 1.0, 0.0)), Spherical(ONE, TWO)],
        gravity=(0.0, 0.0, -9.81),
        damping={"one": RayleighDamping(0.3, 0.001)},
        forces=[
            Force(TIP, 1.0, -2.0, follower=True, z=0.5),
            Torque(TIP, (0.3, 0.2, -0.4)),
            TorsionalSpringDamper(ONE, TWO, 5.0, 0.7, axis=(0.0, 0.0, 1.0)),
            SpringDamper(TIP, Ground((1.0, 1.0, 1.0)), 50.0, 2.0),
        ],
        point_masses=[PointMass(TIP, 0.3)],
        start=Assembled({"one": [0.05, 0.02, -0.03]}, {"two": [0.3, -0.2]}),
    )
    path = PathTracking("two", "tip", (2.0, 0.1, -0.3))
    return Case(mechanism, IntegralCompliance() + path + 1e-3 * MarkerAcceleration(*ONE), make)


def stiffened() -> Case:
    """The same with geometric stiffening."""
    return forced(stiffened_cloud)


def settled() -> Case:
    """From the static equilibrium, with a gear, a drive and a bushing."""
    mechanism = Mechanism(
        PLACES,
        joints=[
            Revolute(ROOT, Ground(), axis=(0.0, 1.0, 0.0)),
            Revolute(ONE, TWO, axis=(0.0, 1.0, 0.3)),
            PrescribedAngle(
                ROOT, Motion.polynomial([0.0, 0.0, 3.0]), name="drive", axis=(0.0, 1.0, 0.0)
            ),
        ],
        gravity=(1.0, 3.0, -9.81),
        forces=[
            TorsionalSpringDamper(ONE, TWO, 15.0, 0.7, axis=(0.0, 1.0, 0.3)),
            Bushing(TIP, Ground((2.0, 0.2, 0.0)), (20.0, 30.0, 10.0), (1.0, 1.0, 1.0), (2, 3, 4)),
        ],
        start=StaticEquilibrium(),
    )
    return Case(mechanism, IntegralCompliance() + 0.01 * JointForce("drive"))


def geared() -> Case:
    """Two bodies on bearings of their own whose angles a gear couples, one of them driven."""
    mechanism = Mechanism(
        {"one": PLACES["one"], "two": Placement((0.5, 1.0, 0.0))},
        joints=[
            Revolute(ROOT, Ground(), axis=(0.0, 1.0, 0.0)),
            Revolute(TWO, Ground((0.0, 1.0, 0.0)), axis=(0.0, 0.0, 1.0)),
            Gear(ROOT, TWO, -2.0, "gear", (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        ],
        forces=[Torque(ROOT, (0.0, 90.0, 0.0))],
    )
    return Case(mechanism, IntegralCompliance() + 0.1 * JointForce("gear"))


def loop_by_radau() -> Case:
    """The loop by Radau's method."""
    return replace(loop(), integrator=RadauIIA(0.3, steps=12))


def stiffened_by_radau() -> Case:
    """All kinds of forces and stiffening by Radau's method."""
    return replace(stiffened(), integrator=RadauIIA(0.3, steps=30))


MAKERS = (loop, forced, stiffened, settled, geared, loop_by_radau, stiffened_by_radau)
CASES = {make.__name__: make for make in MAKERS}


def random_direction(bodies: Mapping[str, VolumeIntegrals], seed: int) -> Bodies:
    """A random change of the integrals with their symmetry."""
    rng = np.random.default_rng(seed)

    def symmetric(array: Array) -> Array:
        change = rng.standard_normal(array.shape)
        return 0.5 * (change + np.swapaxes(change, -1, -2))

    out = {}
    for name, body in bodies.items():
        assert body.P is not None
        P = rng.standard_normal(body.P.shape)
        markers = {
            key: BodyMarker(
                np.zeros(3),
                rng.standard_normal(marker.displacement.shape),
                rng.standard_normal(marker.rotation.shape),
                None if marker.stiffening is None else symmetric(marker.stiffening),
            )
            for key, marker in body.markers.items()
        }
        out[name] = VolumeIntegrals.in_space(
            rng.standard_normal(),
            rng.standard_normal(body.S.shape),
            0.5 * (P + P.transpose(1, 0, 3, 2)),
            100.0 * symmetric(body.K),
            markers,
            {load: symmetric(array) for load, array in body.stiffening.items()},
        )
    return out


def only(direction: Bodies, name: str, part: str) -> Bodies:
    """A change of one part of the integrals of one body."""
    out = {key: change.zeros_like() for key, change in direction.items()}
    kept = {part: getattr(direction[name], part)}
    if part == "P":
        # of which G and N follow
        kept |= {"G": np.zeros((0, 0)), "N": np.zeros((0, 0))}
    out[name] = replace(out[name], **kept)
    return out


@pytest.fixture(scope="module", params=list(CASES))
def case(request: pytest.FixtureRequest) -> tuple[Case, Bodies]:
    found = CASES[request.param]()
    gradient = found.problem.gradient(found.bodies).integrals_gradient
    assert gradient is not None
    return found, gradient


def along(case: Case, direction: Bodies) -> Callable[[float], float]:
    bodies, problem = case.bodies, case.problem

    def value(step: float) -> float:
        moved = {name: body + direction[name].scaled(step) for name, body in bodies.items()}
        return problem.value(moved).psi

    return value


def test_taylor_order(case: tuple[Case, Bodies]) -> None:
    made, gradient = case
    direction = random_direction(made.bodies, 5)
    slope = sum(gradient[name].dot(direction[name]) for name in gradient)
    value = along(made, direction)
    result = taylor_test(
        lambda step: value(float(step)),
        lambda step: float(step) * slope,
        0.0,
        1.0,
        steps=[2e-4 / 10.0 ** (0.5 * k) for k in range(5)],
    )
    assert_taylor_order(result, points=4)


@pytest.mark.parametrize("part", ["mass", "S", "P", "K", "markers", "stiffening"])
def test_derivatives_with_respect_to_each_part(case: tuple[Case, Bodies], part: str) -> None:
    made, gradient = case
    direction, step = random_direction(made.bodies, 6), 2e-5
    whole = sum(abs(gradient[name].dot(direction[name])) for name in gradient)
    for name in made.bodies:
        change = only(direction, name, part)
        slope = gradient[name].dot(change[name])
        value = along(made, change)
        weights = {1: 0.75, 2: -0.15, 3: 1.0 / 60.0}
        difference = sum(w * (value(k * step) - value(-k * step)) for k, w in weights.items())
        # Differences of psi cannot tell what is smaller than its round-off over the step.
        assert difference / step == pytest.approx(slope, rel=1e-6, abs=1e-8 * whole)


def test_order_of_a_flexible_loop() -> None:
    """Second order of generalised-alpha, also of multipliers; of Radau's method fifth and third."""
    case = loop()

    def end(integrator: Integrator) -> tuple[Array, Array, Array]:
        run = simulate(case.mechanism, case.bodies, integrator)
        place = run.marker_path("two", "tip")[-1]
        return np.concatenate([place, run.elastic("one")[-1]]), run.v[-1], run.multipliers[-1]

    reference = end(RadauIIA(0.3, steps=320))

    def orders(coarse: Integrator, fine: Integrator) -> list[float]:
        pairs = zip(end(coarse), end(fine), reference, strict=True)
        sizes = [(np.max(np.abs(a - exact)), np.max(np.abs(b - exact))) for a, b, exact in pairs]
        return [math.log2(a / b) for a, b in sizes]

    found = orders(GeneralizedAlpha(0.3, 100), GeneralizedAlpha(0.3, 200))
    np.testing.assert_allclose(found, 2.0, atol=0.05)
    found = orders(RadauIIA(0.3, steps=20), RadauIIA(0.3, steps=40))
    np.testing.assert_allclose(found, [5.0, 5.0, 3.0], atol=0.3)
