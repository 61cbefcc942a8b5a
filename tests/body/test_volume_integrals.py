# SPDX-License-Identifier: MIT
"""Volume integrals in the plane and in space: structure, point masses, files, refused data."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared.beams import beam
from shared.derivatives import random_direction
from shared.spatial_bodies import cloud, cloud_of_mass

from dolfinx_ffr import archive
from dolfinx_ffr.body import BodyMarker, VolumeIntegrals, axial, cross_matrix, theta

EPS = np.finfo(float).eps


def test_rigid_body_about_its_centre_of_mass() -> None:
    body = VolumeIntegrals.rigid(3.0, (0.2, -0.1), 0.5, {"tip": (1.0, 2.0)})
    assert body.modes == 0
    np.testing.assert_allclose(body.S[0], [0.6, -0.3], rtol=4 * EPS)
    np.testing.assert_allclose(body.G, [[0.5 + 3.0 * 0.05]], rtol=4 * EPS)
    assert body.markers["tip"].displacement.shape == (2, 0)
    body.validate("rigid")


@pytest.mark.parametrize("frame", ["chord", "tangent", "free"])
def test_beam_has_mass_and_inertia_of_a_rod(frame: str) -> None:
    """Its mass matrix is positive; free modes neither move the centre nor turn."""
    rod = beam(length=0.4, height=0.04, width=0.01, density=7850.0, modes=4, frame=frame)
    mass = 7850.0 * 0.4 * 0.04 * 0.01
    assert rod.mass == pytest.approx(mass, rel=1e-13)
    np.testing.assert_allclose(rod.S[0], 0.0, atol=1e-15)
    assert rod.G[0, 0] == pytest.approx(mass * 0.4**2 / 12.0, rel=1e-13)
    matrix = rod.mass_matrix()
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-12, atol=1e-14)
    assert np.linalg.eigvalsh(matrix)[0] > 0.0
    rod.validate("rod")
    if frame == "free":
        np.testing.assert_allclose(rod.S[1:], 0.0, atol=1e-10)
        np.testing.assert_allclose(rod.N[0, 1:], 0.0, atol=1e-10)


def test_integrals_are_those_of_the_points() -> None:
    _, masses, fields = cloud_of_mass(modes=2)
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
    # kinetic energy of any motion of the undeformed body
    v, omega, rate = np.array([0.3, -1.0, 0.7]), np.array([2.0, 0.1, -0.4]), np.array([0.2, -0.5])
    speed = v + np.cross(omega, X) + np.einsum("a,apk->pk", rate, fields[1:])
    state = np.concatenate([v, omega, rate])
    energy = 0.5 * masses @ np.sum(speed**2, axis=1)
    assert 0.5 * state @ body.mass_matrix() @ state == pytest.approx(energy, rel=1e-13)


def test_rigid_body_of_its_tensor() -> None:
    J = np.diag([2.0, 3.0, 4.0]) + 0.1 * np.ones((3, 3))
    center = np.array([0.1, -0.2, 0.3])
    body = VolumeIntegrals.rigid(2.0, center, J, {"tip": (1.0, 0.0, 0.0)})
    assert body.dimension == 3
    assert body.markers["tip"].rotation.shape == (3, 0)
    matrix, arm = body.mass_matrix(), cross_matrix(center)
    np.testing.assert_allclose(matrix[3:, 3:], J + 2.0 * arm.T @ arm, atol=1e-15)
    np.testing.assert_allclose(matrix[3:, :3], 2.0 * arm)


def small(space: bool) -> VolumeIntegrals:
    return cloud(modes=2) if space else beam(modes=3, elements=4)


def change(space: bool, seed: int) -> VolumeIntegrals:
    """A random change of the body, at whose markers only the shape functions change.

    The stiffness stays: it would outweigh the rest in inner products.
    """
    if not space:
        return random_direction({"rod": small(space)}, seed, "mSGNWP")["rod"]
    body = cloud(modes=2, seed=1 + seed)
    still = {name: replace(m, position=np.zeros(3)) for name, m in body.markers.items()}
    return replace(body, K=0.0 * body.K, markers=still)


@pytest.mark.parametrize("space", [False, True])
def test_point_mass_equals_a_point_in_the_integrals(space: bool) -> None:
    body, marker = small(space), "tip" if space else "right"
    heavier, W = body.with_point_mass(marker, 0.7), body.markers[marker].basis
    assert heavier.mass == pytest.approx(body.mass + 0.7, rel=2 * EPS)
    np.testing.assert_allclose(heavier.S, body.S + 0.7 * W.T, rtol=1e-14)
    np.testing.assert_allclose(heavier.G, body.G + 0.7 * W.T @ W, rtol=1e-14)
    if heavier.P is not None and body.P is not None:
        more = 0.7 * np.einsum("ka,lb->abkl", W, W)
        np.testing.assert_allclose(heavier.P - body.P, more, atol=1e-16)
        return
    turned = np.array([-W[1], W[0]])
    np.testing.assert_allclose(heavier.N, body.N + 0.7 * turned.T @ W, rtol=0, atol=1e-14)
    np.testing.assert_allclose(heavier.N, -heavier.N.T, rtol=0, atol=1e-15)


@pytest.mark.parametrize("space", [False, True])
def test_point_mass_pullback(space: bool) -> None:
    """What a point adds is quadratic in the shape functions: differences are exact."""
    body, marker = small(space), "tip" if space else "middle"
    direction, weights = change(space, 0), change(space, 10)
    bar = body.point_mass_pullback(weights, marker, 0.7)
    ahead, behind = (
        weights.dot((body + direction.scaled(h)).with_point_mass(marker, 0.7)) for h in (0.5, -0.5)
    )
    assert bar.dot(direction) == pytest.approx(ahead - behind, rel=1e-9)
    if not space:
        np.testing.assert_array_equal(bar.G, bar.G.T)
        np.testing.assert_array_equal(bar.N, -bar.N.T)


@pytest.mark.parametrize("space", [False, True])
def test_sum_scale_and_inner_product(space: bool) -> None:
    a, b = small(space), change(space, 1)
    total = a + b.scaled(-2.0)
    assert total.mass == pytest.approx(a.mass - 2.0 * b.mass)
    np.testing.assert_allclose(total.G, a.G - 2.0 * b.G)
    assert total.dot(b) == pytest.approx(a.dot(b) - 2.0 * b.dot(b), rel=1e-12)
    assert a.zeros_like().dot(a) == 0.0
    assert a.leading(1).modes == 1
    second = "P" if space else "G"
    np.testing.assert_array_equal(getattr(a.leading(1), second), getattr(a, second)[:2, :2])
    with pytest.raises(ValueError, match=r"different markers cannot be combined"):
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
        (lambda: broken("S", (0, 0), np.nan), "'rod': integral S holds NaN or infinity"),
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


def assert_same(a: VolumeIntegrals, b: VolumeIntegrals) -> None:
    """Equal to the last bit."""
    assert list(a.markers) == list(b.markers) and a.stiffening.keys() == b.stiffening.keys()
    pairs = [(a, b, key) for key in ("mass", *"SGNKP")]
    for name, marker in a.markers.items():
        keys = ("position", "displacement", "rotation")
        pairs += [(marker, b.markers[name], key) for key in keys]
    for one, other, key in pairs:
        np.testing.assert_array_equal(getattr(one, key), getattr(other, key))
    for load, array in a.stiffening.items():
        np.testing.assert_array_equal(array, b.stiffening[load])


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
        cloud(modes=2),
    ],
    ids=["elastic", "no markers", "rigid", "stiffening", "in space"],
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
        ({"mass": None}, r"keys \['mass'\] are missing; the file has \['G', 'K', 'N', 'S'"),
        ({"K": None}, r"S has shape \(4, 2\) of an elastic body, but its stiffness is missing"),
        ({"marker_rotations": None}, r"keys \['marker_rotations'\] are missing"),
        ({"stiffness": np.eye(3)}, r"unknown keys \['stiffness'\]; the keys are \['mass', 'S'"),
        ({"S": np.zeros((3, 2))}, r"S must have shape \(4, 2\) .* but it has shape \(3, 2"),
        ({"mass": np.ones(2)}, r"mass must be one number, but it has shape \(2,\)"),
        ({"K": np.array([["a"]])}, "K must hold real numbers, but its type is <U1"),
        ({"P": np.zeros((4, 4, 2, 2))}, r"give either P or both G and N, not \['P', 'G', 'N'\]"),
        ({"P": np.zeros((4, 4)), "G": None, "N": None}, r"P must have shape \(4, 4, 2, 2\)"),
        ({"marker_positions": np.zeros((2, 2))}, r"must have shape \(3, 2\) .* and 3 markers"),
        ({"markers": np.array(["a", "a", "b"])}, "have the same name"),
        ({"markers": np.zeros(3)}, "markers must hold text"),
        ({"stiffening_alpha": np.eye(2)}, r"stiffening_alpha must have shape \(3, 3\)"),
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
    path, table = tmp_path / "rod.npz", tmp_path / "table.npy"
    beam(modes=3, elements=4).save(path)
    np.save(table, np.zeros(3))
    content = path.read_bytes()
    middle = len(content) // 2
    flipped = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
    for damaged in (content[:middle], flipped, b"", b"a table of numbers", table.read_bytes()):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"rod.npz is damaged or no .npz file"):
            VolumeIntegrals.load(path)
    with pytest.raises(FileNotFoundError):
        VolumeIntegrals.load(tmp_path / "none.npz")


@pytest.mark.parametrize(
    ("key", "shape", "message"),
    [
        ("S", (10**6, 2), r"S must have shape \(4, 2\) .* has shape \(1000000, 2\)"),
        ("zeros", (10**6,), r"unknown keys \['zeros'\]"),
    ],
)
def test_zeros_that_are_packed_are_refused_before_they_are_read(
    key: str, shape: tuple[int, ...], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "rod.npz"
    beam(modes=3, elements=4).save(path)
    with np.load(path) as file:
        np.savez_compressed(path, **{**file, key: np.zeros(shape)})
    assert path.stat().st_size < 30_000
    monkeypatch.setattr(archive.Archive, "read", lambda self: pytest.fail("it was read"))
    with pytest.raises(ValueError, match=f"body file .*rod.npz: {message}"):
        VolumeIntegrals.load(path)


def test_archives_that_promise_more_than_they_can_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    def packed(**arrays: Any) -> bytes:
        content = io.BytesIO()
        np.savez_compressed(content, **arrays)
        return content.getvalue()

    zeros = packed(zeros=np.zeros(10**5))
    np.testing.assert_array_equal(archive.Archive.of(zeros).read()["zeros"], np.zeros(10**5))
    with pytest.raises(
        ValueError, match=r"need 800,000 bytes, more than the file itself has, [0-9,]{3,5} b"
    ):
        archive.Archive.of(zeros, packed=False)
    with pytest.raises(ValueError, match="holds objects of Python, which are never read"):
        archive.Archive.of(packed(zeros=np.array([{}], dtype=object)))
    head = b"'shape': (100000,)"
    raw = io.BytesIO()
    np.savez(raw, zeros=np.zeros(10**5))
    with pytest.raises(ValueError, match="has another size than its shape"):
        archive.Archive.of(raw.getvalue().replace(head, head.replace(b"1", b"9")))
    monkeypatch.setattr(archive, "available_memory", lambda: 799_999)
    with pytest.raises(ValueError, match="need 800,000 bytes, more than the free memory"):
        archive.Archive.of(zeros)


def test_arrays_refused() -> None:
    given, rod, disc = (
        VolumeIntegrals.from_arrays,
        beam(modes=2, elements=4),
        {"G": [[1]], "N": [[0]]},
    )
    flat, body = second_moments(rod), cloud(modes=2)
    flat[0, 1, 0, 0] += 1.0
    assert body.P is not None
    negative, uneven = body.P.copy(), body.P.copy()
    negative[0, 0] = np.diag([1.0, 1.0, -0.2]) * np.trace(negative[0, 0])
    uneven[0, 1, 0, 2] += 1.0
    # a coupling of two modes that the mass matrix of the undeformed body does not see
    turned = rod.N.copy()
    turned[1, 2] += 2.0 * np.sqrt(rod.G[1, 1] * rod.G[2, 2])
    turned[2, 1] = -turned[1, 2]
    views, unit = {"G": body.G, "N": body.N[..., 2]}, 0.1 * np.eye(3)[None, None]
    refused: list[tuple[tuple[Any, ...], dict[str, Any], str]] = [
        (
            (rod.mass, rod.S),
            {"P": flat, "K": rod.K, "name": "rod"},
            "'rod': .* P must satisfy P_ab",
        ),
        (
            (rod.mass, rod.S),
            {"G": rod.G, "N": rod.N, "K": rod.K, "markers": {"a": [0]}},
            "give a BodyMarker with its shape functions",
        ),
        (
            (body.mass, body.S),
            {"P": negative, "K": body.K},
            "no distribution of mass has these m, S and P",
        ),
        ((body.mass, body.S), {"P": uneven, "K": body.K}, "P_ab = P_ba"),
        ((rod.mass, rod.S), {"G": rod.G, "N": turned, "K": rod.K}, "these m, S, G and N"),
        (
            (rod.mass, np.ma.masked_equal(rod.S, rod.S[1, 0])),
            {"G": rod.G, "N": rod.N, "K": rod.K},
            "has [0-9] masked entries, which are no values",
        ),
        ((body.mass, body.S), {**views, "K": body.K}, "in space give P"),
        (
            (1.0, np.zeros((1, 3))),
            {"P": unit, "markers": {"tip": (1.0, 0.0)}},
            r"position must have shape \(3,\)",
        ),
    ]
    for arguments, options, message in refused:
        with pytest.raises(ValueError, match=message):
            given(*arguments, **options)
    computed = given(1, [[0, 0]], **disc, markers={"a": [1, 2]})
    np.testing.assert_array_equal(computed.markers["a"].position, [1.0, 2.0])
    with pytest.raises(ValueError, match="read-only"):
        body.G[0, 0] = 1.0


@pytest.mark.parametrize(
    ("inertia", "message"),
    [
        ((1.0, 2.0, 3.5), "none may exceed the sum of the two others"),
        ((1.0, 2.0, -3.0), "positive diagonal"),
        (np.diag([1.0, 1.0, 1.0]) + np.eye(3, k=1), "must be symmetric"),
        ((1.0, 2.0), r"must have shape \(3, 3\), or \(3,\) for its diagonal"),
    ],
)
def test_impossible_inertia_is_refused(inertia: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        VolumeIntegrals.rigid(1.0, inertia=inertia)
    with pytest.raises(ValueError, match="3 components"):
        VolumeIntegrals.rigid(1.0, (0.0, 0.0), (1.0, 1.0, 1.0))
