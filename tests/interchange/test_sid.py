# SPDX-License-Identifier: MIT
"""Standard input data: equations of motion from the file alone, files of others, damage."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.spatial_bodies import cloud, stiffened_cloud

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics.kinematics import evaluate_equations
from dolfinx_ffr.dynamics.model import assemble_model

Array = NDArray[np.float64]


def skew(x: Array) -> Array:
    return np.cross(np.eye(3), -x)


class NewtonEuler:
    """The equations of motion of Wallrapp's standard, by the entries of a file and nothing else."""

    def __init__(self, path: Path) -> None:
        text = path.read_text()
        self.mass = float(re.search(r"mass +=\s*(\S+)", text)[1].replace("D", "e"))  # type: ignore[index]
        self.nodes = re.split(r"new node", text.partition("end frame")[0])[1:]
        self.text = text.partition("end frame")[2]

    def term(self, name: str, q: Array, text: str = "") -> Array:
        """M(q) = m0 + sum q_k m1_k."""
        block = re.search(rf"^ *{name}\n(.*?)^ *end {name}", text or self.text, re.M | re.S)[1]  # type: ignore[index]
        size = [int(re.search(rf"{key} *= *(\d+)", block)[1]) for key in ("nrow", "ncol")]  # type: ignore[index]
        computed = np.zeros(size)
        for order, index, value in re.findall(r"m([01])\(([\d, ]+)\) *= *(\S+)", block):
            *k, value = *(int(n) - 1 for n in index.split(",")), float(value.replace("D", "e"))
            computed[k[0], k[-1]] += value * (q[k[1]] if order == "1" else 1.0)
        return computed

    def residual(self, q: Array, v: Array, a: Array, frame: tuple[Array, Array, Array]) -> Array:
        """Inertia less gravity, for a frame's acceleration, velocity of turn and its rate."""
        f, w, e = frame
        d, j = self.term("mdCM", q)[:, 0], self.term("J", q)[:, 0]
        J = np.array([[j[0], j[3], j[4]], [j[3], j[1], j[5]], [j[4], j[5], j[2]]])
        Ct, Cr, Me, Ke, De = (self.term(name, q) for name in ("Ct", "Cr", "Me", "Ke", "De"))
        none = np.zeros_like(q)
        Gr = np.einsum("k,ikj->ij", v, self.term("Gr", none).reshape(3, len(q), 3))
        Ge = np.einsum("k,ikj->ij", v, self.term("Ge", none).reshape(len(q), len(q), 3))
        squares = np.array([w[0] ** 2, w[1] ** 2, w[2] ** 2, w[0] * w[1], w[1] * w[2], w[0] * w[2]])
        force = self.mass * f - np.cross(d, e) + Ct.T @ a
        force += np.cross(w, np.cross(w, d)) + 2.0 * np.cross(w, Ct.T @ v)
        moment = np.cross(d, f) + J @ e + Cr.T @ a + Gr @ w + np.cross(w, J @ w)
        elastic = Ct @ f + Cr @ e + Me @ a + Ge @ w + self.term("Oe", q) @ squares
        return np.concatenate([force, moment, elastic + Ke @ q + De @ v])


def first_orders(function: object, *where: float) -> Array:
    """The parts of order zero and one of a polynomial of degree four in a factor."""
    steps = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    values = np.array([function(step) for step in steps])  # type: ignore[operator]
    return np.linalg.solve(np.vander(steps, increasing=True), values)[:2]


@pytest.mark.parametrize("state", range(3))
def test_equations_of_motion_from_the_file_alone(tmp_path: Path, state: int) -> None:
    """To first order in the deformation, as the standard holds them, with geometric stiffening."""
    rng, damping = np.random.default_rng(state), ffr.RayleighDamping(0.3, 0.02)
    body = stiffened_cloud(3)
    body.save(tmp_path / "body.SID_FEM", damping=damping)
    read = NewtonEuler(tmp_path / "body.SID_FEM")
    gravity = rng.standard_normal(3)
    mechanism = ffr.Mechanism(
        {"body": ffr.Placement((0.0, 0.0, 0.0))}, gravity=tuple(gravity), damping={"body": damping}
    )
    model = assemble_model(mechanism, {"body": body}, np.linspace(0.0, 1.0, 3))
    acceleration, w, e, q, v, a = rng.standard_normal((6, 3))

    def ours(t: float) -> Array:
        none = np.zeros(6)
        y, rate = np.concatenate([none, t * q]), np.concatenate([none[:3], w, t * v])
        second = np.concatenate([acceleration, e, t * a])
        return np.asarray(
            evaluate_equations(model.arrays, 0, y, rate, second, np.zeros(0)).residual
        )

    def theirs(t: float) -> Array:
        return read.residual(t * q, t * v, t * a, (acceleration - gravity, w, e))

    expected, computed = first_orders(ours), first_orders(theirs)
    np.testing.assert_allclose(computed, expected, rtol=0.0, atol=1e-10 * np.max(np.abs(expected)))
    marker = body.markers["tip"]
    origin, phi = (
        read.term(key, t * q, read.nodes[1]) for key, t in (("origin", 1.0), ("phi", 0.5))
    )
    np.testing.assert_allclose(origin[:, 0], marker.position + marker.displacement @ q, rtol=1e-12)
    np.testing.assert_allclose(marker.position + phi @ q, marker.position + marker.shift(q))


def test_files_that_contradict_themselves(tmp_path: Path) -> None:
    """One is read with a warning where Gr differs, and refused where no mass moves so."""
    path = tmp_path / "body.SID_FEM"
    cloud(2).save(path)
    text = path.read_text().replace("dolfinx_ffr crc32", "others")
    terms = text.split("           Gr\n")
    path.write_text(
        terms[0]
        + "           Gr\n"
        + re.sub(r"(m0\(   1,   1\) +=).*", r"\1 1.0D+00", terms[1], count=1)
    )
    with pytest.warns(ffr.interchange.InterchangeWarning, match="contradicts itself: Gr"):
        ffr.VolumeIntegrals.load(path)
    path.write_text(re.sub(r"(?s)(           J\n.*?m0\(   1,   1\) +=)[^\n]*", r"\1 1.0D-09", text))
    with pytest.raises(ValueError, match=r"body\.SID_FEM: .*(inertia|no distribution of mass)"):
        ffr.VolumeIntegrals.load(path)
