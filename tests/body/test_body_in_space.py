# SPDX-License-Identifier: MIT
"""Volume integrals of bodies in space: second moments, rigid bodies, files, refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from shared.spatial_bodies import cloud, cloud_of_mass

from dolfinx_ffr.body import BodyMarker, VolumeIntegrals
from dolfinx_ffr.body.moments import axial, cross_matrix, theta


def test_integrals_are_those_of_the_points() -> None:
    points, masses, fields = cloud_of_mass(modes=2)
    body = cloud(modes=2)
    X, Y = fields[0], fields[1]
    assert body.mass == pytest.approx(masses.sum())
    np.testing.assert_allclose(body.S, np.einsum("p,apk->ak", masses, fields))
    np.testing.assert_allclose(body.G[0, 1], masses @ np.sum(X * Y, axis=1))
    np.testing.assert_allclose(body.N[0, 1], masses @ np.cross(X, Y), atol=1e-16)
    inertia = sum(m * cross_matrix(x).T @ cross_matrix(x) for m, x in zip(masses, X, strict=True))
    assert body.P is not None
    np.testing.assert_allclose(theta(body.P[0, 0]), inertia)
    np.testing.assert_allclose(axial(body.P[1, 0]), masses @ np.cross(X, Y), atol=1e-16)
    # Kinetic energy of any motion of the undeformed body.
    v, omega, rate = np.array([0.3, -1.0, 0.7]), np.array([2.0, 0.1, -0.4]), np.array([0.2, -0.5])
    speed = v + np.cross(omega, X) + np.einsum("a,apk->pk", rate, fields[1:])
    state = np.concatenate([v, omega, rate])
    energy = 0.5 * masses @ np.sum(speed**2, axis=1)
    assert 0.5 * state @ body.mass_matrix() @ state == pytest.approx(energy, rel=1e-13)
    assert points.shape[1] == 3


def test_rigid_body_of_its_tensor() -> None:
    J = np.diag([2.0, 3.0, 4.0]) + 0.1 * np.ones((3, 3))
    center = np.array([0.1, -0.2, 0.3])
    body = VolumeIntegrals.rigid(2.0, center, J, {"tip": (1.0, 0.0, 0.0)})
    assert body.dimension == 3
    assert body.markers["tip"].rotation.shape == (3, 0)
    matrix = body.mass_matrix()
    arm = cross_matrix(center)
    np.testing.assert_allclose(matrix[3:, 3:], J + 2.0 * arm.T @ arm, atol=1e-15)
    np.testing.assert_allclose(matrix[3:, :3], 2.0 * arm)


@pytest.mark.parametrize(
    ("inertia", "message"),
    [
        ((1.0, 2.0, 3.5), "none may exceed the sum of the two others"),
        ((1.0, 2.0, -3.0), "positive diagonal"),
        (np.diag([1.0, 1.0, 1.0]) + np.eye(3, k=1), "must be symmetric"),
        ((1.0, 2.0), r"must have shape \(3, 3\), or \(3,\) for its diagonal"),
        ((0.0, 1.0, 1.0), "positive diagonal"),
    ],
)
def test_impossible_inertia_is_refused(inertia: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        VolumeIntegrals.rigid(1.0, inertia=inertia)  # type: ignore[arg-type]


def test_center_of_another_dimension_is_refused() -> None:
    with pytest.raises(ValueError, match="3 components"):
        VolumeIntegrals.rigid(1.0, (0.0, 0.0), (1.0, 1.0, 1.0))


def test_impossible_moments_are_refused() -> None:
    body = cloud(modes=2)
    assert body.P is not None
    P = body.P.copy()
    P[0, 0] = np.diag([1.0, 1.0, -0.2]) * np.trace(P[0, 0])
    with pytest.raises(ValueError, match="no distribution of mass has these m, S and P"):
        VolumeIntegrals.from_arrays(body.mass, body.S, P=P, K=body.K)
    P = body.P.copy()
    P[0, 1, 0, 2] += 1.0
    with pytest.raises(ValueError, match="P_ab = P_ba"):
        VolumeIntegrals.from_arrays(body.mass, body.S, P=P, K=body.K)
    with pytest.raises(ValueError, match="in space give P"):
        VolumeIntegrals.from_arrays(body.mass, body.S, G=body.G, N=body.N[..., 2], K=body.K)
    with pytest.raises(ValueError, match=r"position must have shape \(3,\)"):
        VolumeIntegrals.from_arrays(
            1.0, np.zeros((1, 3)), P=0.1 * np.eye(3)[None, None], markers={"tip": (1.0, 0.0)}
        )


def test_files(tmp_path: Path) -> None:
    body = cloud(modes=2)
    body.save(tmp_path / "body.npz")
    again = VolumeIntegrals.load(tmp_path / "body.npz")
    assert again.P is not None
    np.testing.assert_array_equal(again.P, body.P)
    np.testing.assert_array_equal(again.S, body.S)
    for name, marker in body.markers.items():
        np.testing.assert_array_equal(again.markers[name].rotation, marker.rotation)
        np.testing.assert_array_equal(again.markers[name].displacement, marker.displacement)


def test_point_mass_and_its_pullback() -> None:
    body, direction, bar = (cloud(modes=2, seed=seed) for seed in (0, 1, 2))
    heavier = body.with_point_mass("tip", 0.3)
    W = body.markers["tip"].basis
    assert heavier.P is not None
    assert body.P is not None
    np.testing.assert_allclose(heavier.P - body.P, 0.3 * np.einsum("ka,lb->abkl", W, W), atol=1e-16)
    pulled = body.point_mass_pullback(bar, "tip", 0.3)

    def value(step: float) -> float:
        marker = body.markers["tip"]
        shifted = BodyMarker(
            marker.position,
            marker.displacement + step * direction.markers["tip"].displacement,
            marker.rotation,
        )
        moved = VolumeIntegrals.in_space(
            body.mass, body.S, body.P, body.K, {**body.markers, "tip": shifted}
        )
        found = moved.with_point_mass("tip", 0.3)
        return float(np.sum(bar.S * found.S) + np.sum(bar.P * found.P))

    slope = (value(1e-4) - value(-1e-4)) / 2e-4
    change = direction.markers["tip"].displacement
    own = pulled.markers["tip"].displacement - bar.markers["tip"].displacement
    assert slope == pytest.approx(float(np.sum(own * change)), rel=1e-9)


def test_sums_and_fewer_shape_functions() -> None:
    body = cloud(modes=3)
    twice = body + body
    assert twice.dot(body) == pytest.approx(2.0 * body.dot(body))
    assert body.leading(1).modes == 1
    np.testing.assert_array_equal(body.leading(1).P, body.P[:2, :2])
    assert body.zeros_like().dot(body) == 0.0
    with pytest.raises(ValueError, match="read-only"):
        body.G[0, 0] = 1.0
