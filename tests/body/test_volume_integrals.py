# SPDX-License-Identifier: MIT
"""Volume integrals of a body: structure, point masses, refused data."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shared.beams import beam
from shared.scenes import random_direction

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
        (lambda: VolumeIntegrals.rigid(1.0), "give its moment of inertia"),
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


def second_moments(body: VolumeIntegrals) -> np.ndarray:
    """A P with the G and N of a body; its other two views, which do not matter, are at random."""
    rng = np.random.default_rng(0)
    n = body.modes + 1
    P = np.zeros((n, n, 2, 2))
    other = rng.normal(size=(2, n, n))
    other = other + other.transpose(0, 2, 1)
    P[..., 0, 0], P[..., 1, 1] = 0.5 * body.G + other[0], 0.5 * body.G - other[0]
    P[..., 0, 1], P[..., 1, 0] = 0.5 * body.N + other[1], -0.5 * body.N + other[1]
    return P


def test_second_moments_of_points() -> None:
    """P of a cloud of points gives the G and N of the same cloud."""
    rng = np.random.default_rng(1)
    W, rho = rng.normal(size=(20, 2, 4)), rng.uniform(0.5, 1.0, 20)
    turned = np.stack([-W[:, 1], W[:, 0]], axis=1)
    body = VolumeIntegrals.from_arrays(
        rho.sum(),
        np.einsum("p,pia->ai", rho, W),
        P=np.einsum("p,pia,pjb->abij", rho, W, W),
        K=np.eye(3),
    )
    np.testing.assert_allclose(body.G, np.einsum("p,pia,pib->ab", rho, W, W), atol=1e-13)
    np.testing.assert_allclose(body.N, np.einsum("p,pia,pib->ab", rho, turned, W), atol=1e-13)


def assert_same(a: VolumeIntegrals, b: VolumeIntegrals) -> None:
    """Equal to the last bit."""
    assert a.mass == b.mass
    for key in "SGNK":
        np.testing.assert_array_equal(getattr(a, key), getattr(b, key))
    assert a.stiffening.keys() == b.stiffening.keys()
    for load, array in a.stiffening.items():
        np.testing.assert_array_equal(array, b.stiffening[load])
    assert list(a.markers) == list(b.markers)
    for name, marker in a.markers.items():
        for key in ("position", "displacement", "rotation"):
            np.testing.assert_array_equal(getattr(marker, key), getattr(b.markers[name], key))


@pytest.mark.parametrize(
    "body",
    [
        beam(modes=3, elements=4),
        replace(beam(modes=1, elements=4), markers={}),
        VolumeIntegrals.rigid(2.0, (0.1, 0.2), 0.3, {"Zapfen ä": (1.0, 0.0)}),
        replace(
            beam(modes=2, elements=4),
            stiffening={"omega2": np.eye(2), "acceleration": np.ones((2, 2, 2)) / 3.0},
        ),
    ],
    ids=["elastic", "no markers", "rigid", "stiffening"],
)
def test_file_keeps_every_bit(body: VolumeIntegrals, tmp_path: Path) -> None:
    body.save(tmp_path / "body.npz")
    assert_same(VolumeIntegrals.load(tmp_path / "body.npz"), body)
    body.save(str(tmp_path / "body.npz"))  # replaces the older one and leaves nothing behind
    assert [file.name for file in tmp_path.iterdir()] == ["body.npz"]


def test_file_of_another_code(tmp_path: Path) -> None:
    rod = beam(modes=3, elements=4)
    np.savez(tmp_path / "rod.npz", mass=rod.mass, S=rod.S, P=second_moments(rod), K=rod.K)
    loaded = VolumeIntegrals.load(tmp_path / "rod.npz")
    np.testing.assert_allclose(loaded.G, rod.G, atol=1e-14)
    np.testing.assert_allclose(loaded.N, rod.N, atol=1e-14)
    np.savez(tmp_path / "disc.npz", mass=2, S=[[0, 0]], G=[[1]], N=[[0]])
    assert_same(
        VolumeIntegrals.load(tmp_path / "disc.npz"), VolumeIntegrals.rigid(2.0, inertia=1.0)
    )


def test_invalid_body_is_not_saved(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="'rod': the mass must be positive"):
        replace(beam(modes=2), mass=-1.0).save(tmp_path / "rod.npz")
    with pytest.raises(ValueError, match=r"rod.txt: the name must end in .npz"):
        beam(modes=2).save(tmp_path / "rod.txt")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": None}, r"keys \['mass'\] are missing, there are \['G', 'K', 'N', 'S'"),
        ({"G": None}, r"keys \['G'\] are missing.*P may stand instead of G and N"),
        ({"K": None}, r"S has shape \(4, 2\), that of an elastic body; give its stiffness K"),
        ({"marker_rotations": None}, r"keys \['marker_rotations'\] are missing"),
        ({"stiffness": np.eye(3)}, r"unknown keys \['stiffness'\]; the keys are \['mass', 'S'"),
        ({"S": np.zeros((3, 2))}, r"integral S must have shape \(4, 2\), but it has shape \(3, 2"),
        ({"mass": np.ones(2)}, r"mass must be one number, but it has shape \(2,\)"),
        ({"mass": np.nan}, "the mass must be positive, but it is nan"),
        ({"K": np.full((3, 3), np.nan)}, "integral K holds NaN or infinity"),
        ({"K": np.zeros(3)}, r"K must be a matrix, not of shape \(3,\)"),
        ({"K": np.array([["a"]])}, "K must hold real numbers, but its type is <U1"),
        ({"P": np.zeros((4, 4, 2, 2))}, r"give either P or both G and N, not \['P', 'G', 'N'\]"),
        ({"P": np.zeros((4, 4)), "G": None, "N": None}, r"P must have shape \(4, 4, 2, 2\)"),
        ({"marker_positions": np.zeros((2, 2))}, "but there are 3 markers"),
        ({"marker_positions": np.zeros((3, 3))}, r"marker 'left': position must have shape \(2,\)"),
        ({"markers": np.array(["a", "a", "b"])}, "have the same name"),
        ({"markers": np.zeros(3)}, "markers must hold text"),
        ({"stiffening_alpha": np.eye(2)}, r"stiffening by 'alpha' must have shape \(3, 3\)"),
    ],
)
def test_file_refused(change: dict[str, object], message: str, tmp_path: Path) -> None:
    path = tmp_path / "rod.npz"
    beam(modes=3, elements=4).save(path)
    with np.load(path) as file:
        arrays = {**file, **change}
    np.savez(path, **{key: array for key, array in arrays.items() if array is not None})
    with pytest.raises(ValueError, match=f"body file .*rod.npz: .*{message}"):
        VolumeIntegrals.load(path)


def test_damaged_file(tmp_path: Path) -> None:
    path = tmp_path / "rod.npz"
    beam(modes=3, elements=4).save(path)
    content = path.read_bytes()
    middle = len(content) // 2
    wrong = bytes([content[middle] ^ 1])
    for damaged in (
        content[:middle],
        content[:middle] + wrong + content[middle + 1 :],
        b"",
        b"a table of numbers",
    ):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"rod.npz is damaged or no .npz file"):
            VolumeIntegrals.load(path)
    with path.open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(ValueError, match=r"rod.npz is damaged or no .npz file"):
        VolumeIntegrals.load(path)
    with pytest.raises(FileNotFoundError):
        VolumeIntegrals.load(tmp_path / "none.npz")


def test_arrays_refused() -> None:
    rod = beam(modes=2, elements=4)
    P = second_moments(rod)
    P[0, 1, 0, 0] += 1.0
    with pytest.raises(ValueError, match="'rod': integral P must satisfy P_ab = P_ba"):
        VolumeIntegrals.from_arrays(rod.mass, rod.S, P=P, K=rod.K, name="rod")
    with pytest.raises(ValueError, match="give a BodyMarker with its shape functions"):
        VolumeIntegrals.from_arrays(rod.mass, rod.S, G=rod.G, N=rod.N, K=rod.K, markers={"a": [0]})
    disc = VolumeIntegrals.from_arrays(1, [[0, 0]], G=[[1]], N=[[0]], markers={"a": [1, 2]})
    np.testing.assert_array_equal(disc.markers["a"].position, [1.0, 2.0])
