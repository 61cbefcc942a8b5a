# SPDX-License-Identifier: MIT
"""Files of all formats: round trips, bodies in the plane, what is left out, damage."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared import TOP
from shared.rods import rod, solid, waves
from shared.spatial_bodies import cloud, stiffened_cloud

import dolfinx_ffr as ffr
from dolfinx_ffr.body import VolumeIntegrals
from dolfinx_ffr.dynamics.kinematics import evaluate_equations
from dolfinx_ffr.dynamics.model import assemble_model
from dolfinx_ffr.interchange import FORMATS, InterchangeWarning, sid
from dolfinx_ffr.interchange.format import FEATURES, ReadableFormat

#: Formats that can be read again, with an ending for a file
FILES = {
    name: (kind.endings or (".npz",))[0]
    for name, kind in FORMATS.items()
    if isinstance(kind, ReadableFormat)
}
FOREIGN = sorted(set(FILES) - {"npz"})


def whole(modes: int = 3) -> VolumeIntegrals:
    """A body with geometric stiffness and a marker with axes of its own."""
    body = stiffened_cloud(modes)
    axes = Rotation.from_rotvec([0.3, -0.2, 0.4]).as_matrix()
    return replace(body, markers={**body.markers, "tip": replace(body.markers["tip"], axes=axes)})


def held_by(body: VolumeIntegrals, holds: tuple[str, ...]) -> VolumeIntegrals:
    """What a format that holds some features keeps of a body."""

    def kept(point: Any) -> Any:
        changes: dict[str, Any] = {}
        if "axes of markers" not in holds:
            changes["axes"] = None
        if "stiffening by forces at markers" not in holds:
            changes["stiffening"] = None
        if "rotations of markers" not in holds:
            changes["rotation"] = np.zeros_like(point.rotation)
        return replace(point, **changes)

    stiffening = body.stiffening if "geometric stiffening" in holds else {}
    markers = {name: kept(point) for name, point in body.markers.items()}
    return replace(body, markers=markers, stiffening=stiffening)


def assert_same(found: VolumeIntegrals, body: VolumeIntegrals) -> None:
    def alike(one: Any, other: Any, key: str = "") -> None:
        if key == "axes":  # those of the body
            one, other = (np.eye(3) if axes is None else axes for axes in (one, other))
        assert (one is None) == (other is None)
        if other is not None:
            size = np.max(np.abs(other), initial=0.0)
            np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-12 * size)

    for key in "SPK":
        alike(getattr(found, key), getattr(body, key))
    assert list(found.markers) == list(body.markers)
    assert found.stiffening.keys() == body.stiffening.keys()
    for load, array in body.stiffening.items():
        alike(found.stiffening[load], array)
    for name, point in body.markers.items():
        for key in ("position", "displacement", "rotation", "stiffening", "axes"):
            alike(getattr(found.markers[name], key), getattr(point, key), key)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.filterwarnings("ignore::dolfinx_ffr.interchange.InterchangeWarning")
def test_round_trips(tmp_path: Path, name: str) -> None:
    for body in (whole(), cloud(1), ffr.VolumeIntegrals.rigid(2.0, (0.1, 0, 0), (1.0, 2.0, 2.5))):
        path = tmp_path / f"body{FILES[name]}"
        body.save(path, format=name)
        assert_same(VolumeIntegrals.load(path, format=name), held_by(body, FORMATS[name].holds))


@pytest.mark.parametrize("name", FOREIGN)
def test_what_a_format_cannot_hold_is_said(tmp_path: Path, name: str) -> None:
    body, holds = cloud(2), FORMATS[name].holds
    damping = ffr.RayleighDamping(0.1, 0.0)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        whole(2).save(tmp_path / "a", format=name, damping=damping)
        body.save(tmp_path / "b", format=name)
    messages = "".join(str(w.message) for w in caught if w.category is InterchangeWarning)
    for feature in ("geometric stiffening", "axes of markers", "damping"):
        assert (feature in messages) == (feature not in holds)


@pytest.mark.filterwarnings("ignore::dolfinx_ffr.interchange.InterchangeWarning")
def test_a_body_in_the_plane_is_one_in_space(tmp_path: Path) -> None:
    """Its equations in the plane stay the same, with geometric stiffening."""
    loads = ["omega2", "alpha", "acceleration", "markers"]
    body = rod(MPI.COMM_SELF, (6, 2), stiffening=loads, modes=2)
    reduced = solid(body)
    flat, deep = reduced.integrals, body.in_space(reduced)
    with pytest.raises(ValueError, match="in the plane"):
        flat.save(tmp_path / "rod.SID_FEM")
    uneven = replace(body.in_space(body.reduce(waves(body.domain))), stiffening={})
    for name in FOREIGN:  # nothing moves out of the plane, not by round-off either
        uneven.save(tmp_path / "rod", format=name)
        VolumeIntegrals.load(tmp_path / "rod", format=name)
    m, (a, b, c) = deep.mass, (0.4, 0.04, 0.01)
    inertia = m * np.array([(b**2 + c**2) / 12, a**2 / 3 + c**2 / 12, a**2 / 3 + b**2 / 12])
    assert deep.P is not None
    np.testing.assert_allclose(ffr.body.theta(deep.P[0, 0]), np.diag(inertia), atol=1e-12)
    rng, r, residuals = np.random.default_rng(0), flat.modes, []
    state = rng.standard_normal((3, 3 + r)) * np.array([1.0] * 3 + [1e-2] * r)
    state[0, :3] = 0.0
    for load, entries in (("omega2", ((0, 0, -1), (1, 1, -1))), ("alpha", ((1, 0, 1), (0, 1, -1)))):
        total = sum(sign * deep.stiffening["rotation"][row, k] for row, k, sign in entries)
        np.testing.assert_allclose(total, flat.stiffening[load], rtol=1e-12)
    flat, deep = replace(flat, stiffening={}), replace(deep, stiffening={})
    for one, place in ((flat, (0.0, 0.0)), (deep, (0.0, 0.0, 0.0))):
        model = assemble_model(
            ffr.Mechanism({"rod": ffr.Placement(place)}), {"rod": one}, np.linspace(0, 1, 3)
        )
        columns = np.arange(3 + r) if one is flat else np.array([0, 1, 5, *range(6, 6 + r)])
        states = np.zeros((3, model.size))
        states[:, columns] = state
        residuals.append(
            evaluate_equations(model.arrays, 0, *states, np.zeros(0)).residual[columns]
        )
    np.testing.assert_allclose(
        residuals[1], residuals[0], rtol=1e-9, atol=1e-9 * np.abs(residuals[0]).max()
    )


def test_the_table_of_the_documentation_says_what_formats_hold() -> None:
    page = (TOP / "docs" / "interchange.md").read_text()
    rows = [[cell.strip(" `") for cell in row.split("|")[1:-1]] for row in page.splitlines()]
    table = {row[0]: row for row in rows if row and row[0] in FORMATS and len(row) == 9}
    assert list(table) == list(FORMATS)
    for name, kind in FORMATS.items():
        answers = [what in kind.holds for what in FEATURES] + [isinstance(kind, ReadableFormat)]
        assert table[name][3:] == ["yes" if each else "no" for each in answers], name
        assert table[name][1] in (*kind.endings, ".npz")


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """A file cut short, with bytes changed, or with a line or a piece gone or twice."""
    kind, n = rng.integers(4), len(content)
    place_in_file = int(rng.integers(n))
    if kind == 0:
        return content[:place_in_file]
    if kind == 1:
        bytes_ = bytearray(content)
        for k in rng.integers(n, size=rng.integers(1, 4)):
            bytes_[k] = (bytes_[k] + int(rng.integers(1, 256))) % 256
        return bytes(bytes_)
    end = place_in_file + int(rng.integers(1, 200))
    return (
        content[:place_in_file] + content[end:]
        if kind == 2
        else content[:end] + content[place_in_file:]
    )


@pytest.mark.parametrize("name", FILES)
@pytest.mark.filterwarnings("ignore::dolfinx_ffr.interchange.InterchangeWarning")
def test_three_hundred_damaged_files(tmp_path: Path, name: str) -> None:
    """Each is a clear error that names the file, or is read as it was; none is another body."""
    body, path = replace(cloud(1)), tmp_path / f"body{FILES[name]}"
    body.save(path, format=name)
    content, rng, refused = path.read_bytes(), np.random.default_rng(5), 0
    for _ in range(300):
        path.write_bytes(damaged(content, rng))
        try:
            loaded = VolumeIntegrals.load(path, format=name)
        except ValueError as error:
            assert str(path) in str(error)
            refused += 1
            continue
        renamed = dict(zip(body.markers, loaded.markers.values(), strict=True))
        assert_same(replace(loaded, markers=renamed), held_by(body, FORMATS[name].holds))
    assert refused > 250


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("sid", rb"markers=\[.*\]", b"markers=" + b"[" * 100_000 + b"]", "recursion"),
        ("sid", rb"x", b"x", "of 2 modes is more than the memory"),
    ],
)
@pytest.mark.filterwarnings("ignore::dolfinx_ffr.interchange.InterchangeWarning")
def test_files_that_are_meant_to_do_harm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, old: bytes, new: bytes, message: str
) -> None:
    path = tmp_path / f"body{FILES[name]}"
    cloud(2).save(path, format=name)
    content = path.read_bytes().replace(b"dolfinx_ffr crc32", b"others")
    path.write_bytes(re.sub(old, new, content, count=1))
    if "memory" in message:
        monkeypatch.setattr(sid, "available_memory", lambda: 150)  # of a term without its modes
    with pytest.raises(ValueError, match=f"body file {re.escape(str(path))}: .*{message}"):
        VolumeIntegrals.load(path, format=name)


def test_unknown_endings_and_formats_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"must end in \.npz, \.SID_FEM"):
        cloud(1).save(tmp_path / "body.txt")
    with pytest.raises(ValueError, match="format must be one of"):
        cloud(1).save(tmp_path / "body.txt", format="mnf")
    with pytest.raises(OSError, match="missing"):
        VolumeIntegrals.load(tmp_path / "missing.SID_FEM")
