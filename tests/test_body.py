# SPDX-License-Identifier: MIT
"""Volume integrals of a body: structure, point masses, refused data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from beam_bodies import beam
from scenes import random_direction

from dolfinx_ffr.body import BodyMarker, VolumeIntegrals
from dolfinx_ffr.verification import assert_taylor_order, taylor_test

EPS = np.finfo(float).eps


def test_rigid_body_about_its_centre_of_mass() -> None:
    body = VolumeIntegrals.rigid(3.0, (0.2, -0.1), 0.5, {"tip": (1.0, 2.0)})
    assert body.modes == 0
    np.testing.assert_allclose(body.S[0], [0.6, -0.3], rtol=4 * EPS)
    np.testing.assert_allclose(body.G, [[0.5 + 3.0 * 0.05]], rtol=4 * EPS)
    assert body.markers["tip"].displacement.shape == (2, 0)
    body.validate("rigid")


def test_beam_has_mass_and_inertia_of_a_rod() -> None:
    rod = beam(length=0.4, height=0.04, width=0.01, density=7850.0, modes=5)
    mass = 7850.0 * 0.4 * 0.04 * 0.01
    assert rod.mass == pytest.approx(mass, rel=1e-13)
    np.testing.assert_allclose(rod.S[0], 0.0, atol=1e-15)
    assert rod.G[0, 0] == pytest.approx(mass * 0.4**2 / 12.0, rel=1e-13)


@pytest.mark.parametrize("frame", ["chord", "tangent", "free"])
def test_mass_matrix_is_the_kinetic_energy_of_the_points(frame: str) -> None:
    # The quadratic form is that of a sum over points, hence positive for all velocities.
    rod = beam(modes=4, frame=frame)
    matrix = rod.mass_matrix()
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-12, atol=1e-14)
    assert np.linalg.eigvalsh(matrix)[0] > 0.0
    rod.validate("rod")


def test_free_modes_neither_move_the_centre_nor_turn() -> None:
    rod = beam(modes=4, frame="free")
    np.testing.assert_allclose(rod.S[1:], 0.0, atol=1e-10)
    np.testing.assert_allclose(rod.N[0, 1:], 0.0, atol=1e-10)


def test_point_mass_equals_a_point_in_the_integrals() -> None:
    rod = beam(modes=3, elements=4)
    heavier = rod.with_point_mass("right", 0.7)
    W = rod.markers["right"].basis
    turned = np.array([-W[1], W[0]])
    assert heavier.mass == pytest.approx(rod.mass + 0.7, rel=2 * EPS)
    np.testing.assert_allclose(heavier.S, rod.S + 0.7 * W.T, rtol=1e-14)
    np.testing.assert_allclose(heavier.G, rod.G + 0.7 * W.T @ W, rtol=1e-14)
    np.testing.assert_allclose(heavier.N, rod.N + 0.7 * turned.T @ W, rtol=0, atol=1e-14)
    np.testing.assert_allclose(heavier.N, -heavier.N.T, rtol=0, atol=1e-15)


@pytest.mark.parametrize("seed", range(3))
def test_point_mass_pullback(seed: int) -> None:
    rod = beam(modes=3, elements=4)
    weights = random_direction({"rod": rod}, 10 + seed)["rod"]
    direction = random_direction({"rod": rod}, seed)["rod"]
    bar = rod.point_mass_pullback(weights, "middle", 0.7)

    def function(step: np.ndarray) -> float:
        body = rod + direction.scaled(float(step))
        moved = body.with_point_mass("middle", 0.7)
        return weights.dot(moved)

    assert_taylor_order(taylor_test(function, lambda d: float(d) * bar.dot(direction), 0.0, 1.0))
    np.testing.assert_array_equal(bar.G, bar.G.T)
    np.testing.assert_array_equal(bar.N, -bar.N.T)


def test_sum_scale_and_inner_product() -> None:
    a = beam(modes=2, elements=4)
    b = random_direction({"rod": a}, 1)["rod"]
    total = a + b.scaled(-2.0)
    assert total.mass == pytest.approx(a.mass - 2.0 * b.mass)
    np.testing.assert_allclose(total.G, a.G - 2.0 * b.G)
    assert total.dot(b) == pytest.approx(a.dot(b) - 2.0 * b.dot(b), rel=1e-12)
    assert a.zeros_like().dot(a) == 0.0
    with pytest.raises(ValueError, match=r"different markers: \['left', 'middle', 'right'\]"):
        _ = a + replace(b, markers={})


def broken(field: str, index: tuple[int, ...], value: float) -> VolumeIntegrals:
    body = beam(modes=3, elements=4)
    array = getattr(body, field).copy()
    array[index] = value
    return replace(body, **{field: array})


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (lambda: replace(beam(modes=3), mass=-1.0), "'rod': the mass must be positive.* -1 kg"),
        (lambda: replace(beam(modes=3), mass=float("nan")), "the mass must be positive"),
        (lambda: broken("S", (0, 0), np.nan), "'rod': integral S holds NaN or infinity"),
        (lambda: broken("K", (1, 1), np.inf), "integral K holds NaN or infinity"),
        (lambda: broken("G", (0, 1), 1.0), "integral G must be symmetric"),
        (lambda: broken("N", (1, 2), 1.0), "integral N must be antisymmetric"),
        (lambda: broken("G", (2, 2), 0.0), "mass matrix is not positive definite"),
        (lambda: broken("K", (0, 0), -1e9), "stiffness K has a negative eigenvalue"),
        (lambda: replace(beam(modes=3), S=np.zeros((3, 2))), r"S must have shape \(4, 2\)"),
        (
            lambda: replace(
                beam(modes=3), markers={"pin": BodyMarker([0, 0], np.zeros((2, 2)), np.zeros(3))}
            ),
            r"marker 'pin': displacement must have shape \(2, 3\)",
        ),
        (lambda: VolumeIntegrals.rigid(1.0), "mass matrix is not positive definite"),
    ],
)
def test_refused(body, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        body().validate("rod")


def test_rigid_motion_among_the_shape_functions_is_refused() -> None:
    rod = beam(modes=2, elements=4)
    # A third shape function, the translation along x, repeats what R_x does.
    r = rod.modes
    S = np.vstack([rod.S, [rod.mass, 0.0]])
    G = np.block([[rod.G, rod.S[:, :1]], [rod.S[:, :1].T, rod.mass]])
    N = np.block([[rod.N, -rod.S[:, 1:]], [rod.S[:, 1:].T, 0.0]])
    K = np.block([[rod.K, np.zeros((r, 1))], [np.zeros((1, r)), 0.0]])
    with pytest.raises(ValueError, match="no shape function is a rigid-body motion"):
        VolumeIntegrals(rod.mass, S, G, N, K).validate("rod")
