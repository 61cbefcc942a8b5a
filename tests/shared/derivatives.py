# SPDX-License-Identifier: MIT
"""Checks of exact derivatives along random changes of bodies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from dolfinx_ffr.body import BodyMarker, VolumeIntegrals
from dolfinx_ffr.verification import (
    TaylorResult,
    assert_taylor_order,
    taylor_test,
)

Bodies = dict[str, VolumeIntegrals]


def dot(bars: Mapping[str, VolumeIntegrals] | None, direction: Bodies) -> float:
    """The derivative along a change of all bodies."""
    assert bars is not None
    return sum(bars[name].dot(direction[name]) for name in bars)


def random_direction(bodies: Bodies, seed: int, fields: str = "mSGNKWPT") -> Bodies:
    """A random change of the integrals, in proportion to their size and with their symmetry.

    The letters choose what changes: mass m, the arrays S, G, N, K, and of the markers the
    displacement shape functions W, the rotation shape functions P and the positions R; T is
    geometric stiffness.
    """
    rng = np.random.default_rng(seed)
    out = {}
    for name, body in bodies.items():
        length = max([np.hypot(*m.position) for m in body.markers.values()] + [0.1])
        g, k = np.sqrt(np.diag(body.G)), np.sqrt(np.diag(body.K))
        size = {"S": np.sqrt(body.mass) * g[:, None] * np.ones(2), "G": np.outer(g, g)}
        size |= {"N": size["G"], "K": np.outer(k, k)}
        arrays = {}
        for key, sign in {"S": 0.0, "G": 1.0, "N": -1.0, "K": 1.0}.items():
            change = size[key] * rng.uniform(-1.0, 1.0, size[key].shape)
            if sign:
                change = 0.5 * (change + sign * change.T)
            arrays[key] = change * (key in fields)
        markers = {
            m: BodyMarker(
                0.05 * length * rng.uniform(-1.0, 1.0, 2) if "R" in fields else np.zeros(2),
                rng.uniform(-1.0, 1.0, point.displacement.shape) * ("W" in fields),
                rng.uniform(-1.0, 1.0, point.rotation.shape) / length * ("P" in fields),
            )
            for m, point in body.markers.items()
        }
        stiffening = {}
        for load, array in body.stiffening.items():
            change = rng.uniform(-1.0, 1.0, array.shape) * ("T" in fields)
            change *= 0.1 * np.max(np.abs(array))
            stiffening[load] = 0.5 * (change + np.swapaxes(change, -1, -2))
        mass = body.mass * rng.uniform(-1.0, 1.0) * ("m" in fields)
        out[name] = VolumeIntegrals(mass, **arrays, markers=markers, stiffening=stiffening)
    return out


def moved(bodies: Bodies, direction: Bodies, step: float) -> Bodies:
    """Bodies moved by a step along a direction."""
    return {name: body + direction[name].scaled(step) for name, body in bodies.items()}


def along(
    value: Callable[[Bodies], float], bodies: Bodies, direction: Bodies
) -> Callable[[float], float]:
    """A number of bodies as a function of the way along a direction."""
    return lambda step: value(moved(bodies, direction, float(step)))


def check_slope(
    value: Callable[[float], float],
    slope: float,
    first_step: float,
    *,
    count: int = 5,
    ratio: float = 2.0,
    points: int = 3,
    roundoff: float = 1e-14,
) -> TaylorResult:
    """Demand Taylor's order 2 of a function of the way along a direction, at zero.

    Of `count` steps, each smaller by `ratio`, `points` must stand clear of round-off.
    """
    result = taylor_test(
        lambda step: value(float(step)),
        lambda step: float(step) * slope,
        0.0,
        1.0,
        steps=[first_step / ratio**k for k in range(count)],
        roundoff=roundoff,
    )
    assert_taylor_order(result, points=points)
    return result


def difference(value: Callable[[float], float], step: float) -> float:
    """Central difference of fourth order, at zero."""

    def slope(s: float) -> float:
        return (value(s) - value(-s)) / (2.0 * s)

    return (4.0 * slope(step / 2.0) - slope(step)) / 3.0


def waves(problem: Any) -> dict[str, np.ndarray]:
    """Densities of all bodies of a problem, functions of position alone."""
    return {
        name: 0.7
        + 0.2 * np.sin(body.domain.centroids @ [50.0, 90.0, 70.0][: body.domain.dimension])
        for name, body in problem.flexible.items()
    }


def check_gradient(
    problem: Any,
    x: dict[str, np.ndarray] | None = None,
    direction: dict[str, np.ndarray] | None = None,
    *,
    taylor: float | None = None,
    step: float | None = None,
    rel: float = 1e-6,
    roundoff: float = 1e-12,
) -> None:
    """Demand that the gradient by all densities is right along a direction.

    By Taylor's order from a first step on, by a central difference with a step, or by both.
    """
    x = x or waves(problem)
    domains = {name: body.domain for name, body in problem.flexible.items()}
    direction = direction or {
        name: np.cos(domain.centroids @ [80.0, 200.0, -60.0][: domain.dimension])
        for name, domain in domains.items()
    }
    gradient = problem.gradient(x).gradient
    assert gradient is not None
    slope = sum(domains[name].sum(gradient[name] * d) for name, d in direction.items())

    def psi(way: float) -> float:
        return problem.value({**x, **{n: x[n] + way * d for n, d in direction.items()}}).psi

    if taylor is not None:
        check_slope(psi, slope, taylor, count=4, roundoff=roundoff)
    if step is not None:
        assert slope == pytest.approx(difference(psi, step), rel=rel)
