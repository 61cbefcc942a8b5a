# SPDX-License-Identifier: MIT
"""Objectives of bodies in space, and the von Mises stress of six components."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shared.spatial_bodies import cloud

from dolfinx_ffr import Frequency, VolumeIntegrals
from dolfinx_ffr.objective import von_mises_root
from dolfinx_ffr.verification import assert_taylor_order, taylor_test


@pytest.mark.parametrize("free", [False, True])
def test_derivative_of_a_frequency(free: bool) -> None:
    """Of a body in its frame and of a free one, by mass, S, P and K."""
    body, objective = cloud(4), Frequency("rod", number=2, free=free)
    rng = np.random.default_rng(5)
    assert body.P is not None
    P = rng.standard_normal(body.P.shape)
    K = rng.standard_normal(body.K.shape)
    direction = VolumeIntegrals.in_space(
        rng.standard_normal(),
        rng.standard_normal(body.S.shape),
        P + P.transpose(1, 0, 3, 2),
        100.0 * (K + K.T),
        {name: marker.scaled(0.0) for name, marker in body.markers.items()},
    )
    _, bars = objective.pullback(None, {"rod": body})
    result = taylor_test(
        lambda step: objective.value(None, {"rod": body + direction.scaled(float(step))}),
        lambda step: float(step) * bars["rod"].dot(direction),
        0.0,
        1.0,
        steps=[1e-4 / 2.0**k for k in range(5)],
    )
    assert_taylor_order(result)


def test_singular_stiffness_is_refused() -> None:
    """A body without stiffness along one shape has one zero frequency more, which is refused."""
    body = cloud(3)
    singular = replace(body, K=np.diag([1.0, 1.0, 0.0]))
    with pytest.raises(ValueError, match="frequency 1 of body 'rod' is zero"):
        Frequency("rod", free=True).value(None, {"rod": singular})


def test_von_mises_stress_in_space() -> None:
    """The length of six numbers; in the plane it is that of three."""
    rng = np.random.default_rng(0)
    stress = rng.standard_normal(6)
    sx, sy, sz, txy, tyz, txz = stress
    exact = sx**2 + sy**2 + sz**2 - sx * sy - sy * sz - sz * sx + 3 * (txy**2 + tyz**2 + txz**2)
    assert np.sum((von_mises_root(0.0, 6) @ stress) ** 2) == pytest.approx(exact, rel=1e-13)
    flat = np.array([sx, sy, 0.3 * (sx + sy), txy, 0.0, 0.0])
    plane = von_mises_root(0.3) @ [sx, sy, txy]
    assert_allclose(np.linalg.norm(von_mises_root(0.0, 6) @ flat), np.linalg.norm(plane))
