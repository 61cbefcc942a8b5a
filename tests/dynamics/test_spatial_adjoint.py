# SPDX-License-Identifier: MIT
"""Discrete adjoint in space: exact derivatives with respect to all integrals of all bodies."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from shared import derivatives
from shared.spatial_scenes import Bodies, Case, Make, hub, loop, settled, spun, stiffened

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Integrator

#: What is tested are derivatives, of motions that no one would want.
pytestmark = [
    pytest.mark.filterwarnings(f"ignore::dolfinx_ffr.dynamics.{name}Warning")
    for name in ("LargeDeformation", "Softening", "TiltedAxis", "TimeStep")
]

Array = NDArray[np.float64]
CASES: dict[str, Callable[[], Case]] = {
    **{make.__name__: make for make in (loop, stiffened, settled, spun)},
    "stiffened by radau": lambda: replace(stiffened(), integrator=ffr.RadauIIA(0.3, steps=12)),
    "spun by radau": lambda: replace(spun(), make=hub, integrator=ffr.RadauIIA(1.0, steps=5)),
}


def towards_others(bodies: Bodies, seed: int, make: Make) -> Bodies:
    """A change of all integrals, to those of other bodies."""
    other_settings = {
        "one": make(bodies["one"].modes, seed),
        "two": make(bodies["two"].modes, seed + 1),
    }
    return {name: other_settings[name] + body.scaled(-1.0) for name, body in bodies.items()}


@pytest.fixture(scope="module", params=list(CASES))
def case(request: pytest.FixtureRequest) -> tuple[Case, Bodies]:
    example = CASES[request.param]()
    gradient = example.problem.gradient(example.bodies).integrals_gradient
    assert gradient is not None
    return example, gradient


def along(case: Case, direction: Bodies) -> Callable[[float], float]:
    problem = case.problem
    return derivatives.along(lambda bodies: problem.value(bodies).psi, case.bodies, direction)


def test_taylor_order(case: tuple[Case, Bodies]) -> None:
    example, gradient = case
    direction = towards_others(example.bodies, 5, example.make)
    value, slope = along(example, direction), derivatives.dot(gradient, direction)
    derivatives.check_slope(value, slope, 2e-4, ratio=10.0**0.5, points=4)


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

    observed = orders(ffr.GeneralizedAlpha(0.3, 100), ffr.GeneralizedAlpha(0.3, 200))
    np.testing.assert_allclose(observed, 2.0, atol=0.05)
    observed = orders(ffr.RadauIIA(0.3, steps=20), ffr.RadauIIA(0.3, steps=40))
    np.testing.assert_allclose(observed, [5.0, 5.0, 3.0], atol=0.3)
