# SPDX-License-Identifier: MIT
"""Discrete adjoint in space: exact derivatives with respect to all integrals of all bodies."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from shared import derivatives
from shared.spatial_bodies import cloud, stiffened_cloud

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Integrator
from dolfinx_ffr.mechanism import AngleCoupling

#: What is tested are derivatives, of motions that no one would want.
pytestmark = [
    pytest.mark.filterwarnings(f"ignore::dolfinx_ffr.{name}Warning")
    for name in ("LargeDeformation", "Softening", "TiltedAxis", "TimeStep")
]

Array = NDArray[np.float64]
Bodies = dict[str, ffr.VolumeIntegrals]
Make = Callable[[int, int], ffr.VolumeIntegrals]

ONE, TWO, ROOT, TIP = ("one", "tip"), ("two", "root"), ("one", "root"), ("two", "tip")
PLACES = {
    "one": ffr.Placement((0.5, 0.0, 0.0)),
    "two": ffr.Placement((1.5, 0.1, -0.1), rotation=(0.2, 0.1, 0.0)),
}
CRANK = ffr.Moving.circle(
    (0.0, 0.0, 0.0), 0.2, ffr.Motion.smooth_step(6.0, 0.5), axis=(0.3, 0.2, 1.0)
)


@dataclass(frozen=True)
class Case:
    """A mechanism of two flexible bodies, and what is asked of it."""

    mechanism: ffr.Mechanism
    objective: ffr.Objective
    make: Make = cloud
    integrator: Integrator = field(default_factory=lambda: ffr.GeneralizedAlpha(0.3, 30))

    @property
    def bodies(self) -> Bodies:
        return {"one": self.make(3, 1), "two": self.make(2, 2)}

    @property
    def problem(self) -> ffr.MechanicalProblem:
        return ffr.MechanicalProblem(self.mechanism, self.integrator, self.objective)


def loop() -> Case:
    """A closed chain on a crank: ball, Hooke's joint, plane."""
    mechanism = ffr.Mechanism(
        PLACES,
        joints=[
            ffr.Spherical(ROOT, CRANK),
            ffr.Universal(ONE, TWO, (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), "cross"),
            ffr.PointOnPlane(TIP, ffr.Ground((0.0, 0.0, -0.3)), (0.1, 0.1, 1.0)),
        ],
        gravity=(0.0, 0.0, -9.81),
    )
    path = ffr.PathTracking("two", "tip", (lambda t: 2.0 + t, 0.1, -0.3))
    objective = ffr.IntegralCompliance() + 0.1 * ffr.JointForce("cross") + path
    objective += 1e-3 * ffr.MarkerAcceleration("two", "tip") + ffr.MarkerVelocity(*ONE)
    return Case(mechanism, objective)


def stiffened() -> Case:
    """An open chain with all kinds of forces and stiffening, that starts deformed and in motion."""
    mechanism = ffr.Mechanism(
        PLACES,
        joints=[ffr.Revolute(ROOT, CRANK, axis=(0.0, 1.0, 0.0)), ffr.Spherical(ONE, TWO)],
        gravity=(0.0, 0.0, -9.81),
        damping={"one": ffr.RayleighDamping(0.3, 0.001)},
        forces=[
            ffr.Force(TIP, 1.0, -2.0, follower=True, z=0.5),
            ffr.Torque(TIP, (0.3, 0.2, -0.4)),
            ffr.TorsionalSpringDamper(ONE, TWO, 5.0, 0.7, axis=(0.0, 0.0, 1.0)),
            ffr.SpringDamper(TIP, ffr.Ground((1.0, 1.0, 1.0)), 50.0, 2.0),
        ],
        point_masses=[ffr.PointMass(TIP, 0.3)],
        start=ffr.Assembled({"one": [0.05, 0.02, -0.03]}, {"two": [0.3, -0.2]}),
    )
    path = ffr.PathTracking("two", "tip", (2.0, 0.1, -0.3))
    objective = ffr.IntegralCompliance() + path + 1e-3 * ffr.MarkerAcceleration(*ONE)
    return Case(mechanism, objective, stiffened_cloud)


def settled() -> Case:
    """From the static equilibrium, with a drive and a bushing."""
    motion, place, y = ffr.Motion.polynomial([0.0, 0.0, 3.0]), (2.0, 0.2, 0.0), (0.0, 1.0, 0.0)
    mechanism = ffr.Mechanism(
        PLACES,
        joints=[
            ffr.Revolute(ROOT, ffr.Ground(), axis=y),
            ffr.Revolute(ONE, TWO, axis=(0.0, 1.0, 0.3)),
            ffr.PrescribedAngle(ROOT, motion, name="drive", axis=y),
        ],
        gravity=(1.0, 3.0, -9.81),
        forces=[
            ffr.TorsionalSpringDamper(ONE, TWO, 15.0, 0.7, axis=(0.0, 1.0, 0.3)),
            ffr.Bushing(TIP, ffr.Ground(place), (20.0, 30.0, 10.0), (1.0, 1.0, 1.0), (2, 3, 4)),
        ],
        start=ffr.StaticEquilibrium(),
    )
    return Case(mechanism, ffr.IntegralCompliance() + 0.01 * ffr.JointForce("drive"))


def hub(modes: int, seed: int) -> ffr.VolumeIntegrals:
    """A body with a marker at the origin of its frame."""
    body = cloud(modes, seed, 4e5)
    root = replace(body.markers["root"], position=np.zeros(3))
    return replace(body, markers={**body.markers, "root": root})


def spun() -> Case:
    """A body that is spun on a spring and turns a geared one, by up to a turn in each step."""
    tilted = (0.0, 0.6, 0.8)
    turn, spin = 4.0 * np.array(tilted), 20.0 * np.array(tilted)
    mechanism = ffr.Mechanism(
        {
            "one": ffr.Placement((0.0, 0.0, 0.0), rotation=turn, angular_velocity=spin),
            "two": ffr.Placement((0.0, 1.0, 0.0), angular_velocity=(0.0, 0.0, -40.0)),
        },
        joints=[
            ffr.Revolute(ROOT, ffr.Ground(), axis=tilted),
            ffr.Revolute(("two", "root"), ffr.Ground((0.0, 1.0, 0.0))),
            AngleCoupling(("two", "root"), ROOT, -2.0, "gear", (0.0, 0.0, 1.0), tilted),
        ],
        forces=[ffr.TorsionalSpringDamper(ROOT, ffr.Ground(), 5.0, 0.02, angle=0.0, axis=tilted)],
    )
    objective = ffr.IntegralCompliance() + 0.1 * ffr.JointForce("gear") + ffr.MarkerVelocity(*ONE)
    rigid = ffr.GeneralizedAlpha(1.0, 5)
    return Case(mechanism, objective, lambda modes, seed: hub(0, seed), rigid)


CASES: dict[str, Callable[[], Case]] = {
    **{make.__name__: make for make in (loop, stiffened, settled, spun)},
    "stiffened by radau": lambda: replace(stiffened(), integrator=ffr.RadauIIA(0.3, steps=12)),
    "spun by radau": lambda: replace(spun(), make=hub, integrator=ffr.RadauIIA(1.0, steps=5)),
}


def towards_others(bodies: Bodies, seed: int, make: Make) -> Bodies:
    """A change of all integrals, to those of other bodies."""
    others = {"one": make(bodies["one"].modes, seed), "two": make(bodies["two"].modes, seed + 1)}
    return {name: others[name] + body.scaled(-1.0) for name, body in bodies.items()}


def only(direction: Bodies, part: str) -> Bodies:
    """A change of one part of the integrals of all bodies."""
    out = {}
    for name, change in direction.items():
        kept = {part: getattr(change, part)}
        if part == "P":
            # of which G and N follow
            kept |= {"G": np.zeros((0, 0)), "N": np.zeros((0, 0))}
        out[name] = replace(change.zeros_like(), **kept)
    return out


@pytest.fixture(scope="module", params=list(CASES))
def case(request: pytest.FixtureRequest) -> tuple[Case, Bodies]:
    found = CASES[request.param]()
    gradient = found.problem.gradient(found.bodies).integrals_gradient
    assert gradient is not None
    return found, gradient


def along(case: Case, direction: Bodies) -> Callable[[float], float]:
    problem = case.problem
    return derivatives.along(lambda bodies: problem.value(bodies).psi, case.bodies, direction)


def test_taylor_order(case: tuple[Case, Bodies]) -> None:
    made, gradient = case
    direction = towards_others(made.bodies, 5, made.make)
    value, slope = along(made, direction), derivatives.dot(gradient, direction)
    derivatives.check_slope(value, slope, 2e-4, ratio=10.0**0.5, points=4)


@pytest.mark.slow
@pytest.mark.parametrize("part", ["mass", "S", "P", "K", "markers", "stiffening"])
def test_derivatives_with_respect_to_each_part(case: tuple[Case, Bodies], part: str) -> None:
    made, gradient = case
    direction, step = towards_others(made.bodies, 6, made.make), 5e-5
    whole = sum(abs(gradient[name].dot(direction[name])) for name in gradient)
    change = only(direction, part)
    expected = derivatives.difference(along(made, change), step)
    # Differences of psi cannot tell what is smaller than its round-off over the step.
    assert derivatives.dot(gradient, change) == pytest.approx(expected, rel=1e-6, abs=1e-8 * whole)


def test_order_of_a_flexible_loop() -> None:
    """Second order of generalised-alpha, also of multipliers; of Radau's method fifth and third."""
    case = loop()

    def end(integrator: Integrator) -> tuple[Array, Array, Array]:
        run = ffr.simulate(case.mechanism, case.bodies, integrator)
        place = run.marker_path("two", "tip")[-1]
        return np.concatenate([place, run.elastic("one")[-1]]), run.v[-1], run.multipliers[-1]

    reference = end(ffr.RadauIIA(0.3, steps=320))

    def orders(coarse: Integrator, fine: Integrator) -> list[float]:
        pairs = zip(end(coarse), end(fine), reference, strict=True)
        sizes = [(np.max(np.abs(a - exact)), np.max(np.abs(b - exact))) for a, b, exact in pairs]
        return [math.log2(a / b) for a, b in sizes]

    found = orders(ffr.GeneralizedAlpha(0.3, 100), ffr.GeneralizedAlpha(0.3, 200))
    np.testing.assert_allclose(found, 2.0, atol=0.05)
    found = orders(ffr.RadauIIA(0.3, steps=20), ffr.RadauIIA(0.3, steps=40))
    np.testing.assert_allclose(found, [5.0, 5.0, 3.0], atol=0.3)
