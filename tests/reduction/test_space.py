# SPDX-License-Identifier: MIT
"""Bodies in space reduced to their shape functions, and back to their densities."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose

import dolfinx_ffr as ffr
from dolfinx_ffr.fem import rigid_fields
from dolfinx_ffr.verification import assert_taylor_order, central_difference, taylor_test

pytestmark = pytest.mark.mpi

STEEL = ffr.Isotropic(210e9, 0.3, 7800.0)


def rod(
    comm: MPI.Intracomm,
    sizes: tuple[float, float, float] = (0.4, 0.04, 0.03),
    elements: tuple[int, int, int] = (12, 2, 2),
    order: int = 1,
    **options: object,
) -> ffr.FlexibleBody:
    """A rod of hexahedra, held at its left end if nothing else is said."""
    domain = ffr.Domain.box(comm, *sizes, elements=elements, order=order, solid_layers=1)
    given: dict[str, object] = {"frame": ffr.TangentFrame("left"), "modes": 6, **options}
    return ffr.FlexibleBody(domain, STEEL, **given)  # type: ignore[arg-type]


@pytest.mark.parametrize("frame", [ffr.TangentFrame("left"), ffr.ChordFrame("left", "right")])
def test_rigid_motions_and_inertia(comm: MPI.Intracomm, frame: ffr.Frame) -> None:
    """Mass and inertia tensor of a box; no mode but six per interface less the frame's six."""
    body = rod(comm, frame=frame, modes=2, markers={"tip": (0.37, 0.01, -0.012)})
    integrals = body.reduce(np.ones(body.domain.n_cells)).integrals
    integrals.validate("rod")
    assert integrals.P is not None
    assert body.n_elastic == 6 + 2
    a, b, c = 0.4, 0.04, 0.03
    mass = 7800.0 * a * b * c
    assert integrals.mass == pytest.approx(mass, rel=1e-12)
    assert_allclose(integrals.S[0], [0.5 * mass * a, 0.0, 0.0], atol=1e-14)
    second = np.diag(mass * np.array([a**2 / 3, b**2 / 12, c**2 / 12]))
    assert_allclose(integrals.P[0, 0], second, atol=1e-14)
    motions = rigid_fields(body.elasticity.coordinates(), np.zeros(3))
    displacement, rotation = body.markers["tip"].motion(motions)
    assert_allclose(rotation, np.eye(6)[3:], atol=1e-9)
    turned = np.cross(np.eye(3), [0.37, 0.01, -0.012]).T
    assert_allclose(displacement, np.hstack([np.eye(3), turned]), atol=1e-12)


@pytest.mark.parametrize("width", [0.04, 0.02])
def test_beam_in_two_planes_and_torsion(comm: MPI.Intracomm, width: float) -> None:
    """Clamped-free frequencies in both planes (Timoshenko) and of torsion (Saint-Venant).

    The first of bending is 3.50264107 sqrt(EI / rho A L^4) for sqrt(I / A) / L = 0.02, nu = 0.3 and
    a shear factor 5/6, and 3.51265 for 0.01. J_t = 0.140577015 h^4 of a square section.
    """
    height = 0.04
    length = height / np.sqrt(12.0) / 0.02
    elements, modes = ((12, 2, 2), 5) if width == height else ((12, 2, 1), 6)
    body = rod(comm, (length, height, width), elements, order=2, modes=modes)
    integrals = body.reduce(np.ones(body.domain.n_cells)).integrals
    squares = scipy.linalg.eigh(integrals.K, integrals.G[1:, 1:], eigvals_only=True)
    found = np.sqrt(squares) * length**2 / np.sqrt(STEEL.young / 12 / STEEL.density)
    factors = {0.04: 3.50264107, 0.02: 3.51265}
    # rigid ends and the mesh: less than one percent
    assert found[0] == pytest.approx(factors[width] * width, rel=1e-2)
    assert found[1] == pytest.approx(factors[height] * height, rel=1e-2)
    if width == height:
        stiffness = STEEL.lame[1] * 0.140577015 / (STEEL.density / 6)
        twist = 0.5 * np.pi / length * np.sqrt(stiffness)
        # rigid ends cannot warp, 0.6 %, and the mesh adds 0.8 %
        assert np.min(np.abs(np.sqrt(squares) / twist - 1.0)) < 1.5e-2


@pytest.mark.parametrize(
    ("speed", "flap"), [(2.0, 4.1373196), (6.0, 7.3603730), (10.0, 11.2023279)]
)
def test_rotating_cantilever(comm: MPI.Intracomm, speed: float, flap: float) -> None:
    """Flap and chord of a square beam that spins about its clamped end, hub radius 0.

    Flap: A. D. Wright et al., Journal of Applied Mechanics 49 (1982), doi:10.1115/1.3161966;
    chord^2 = flap^2 - speed^2 but for the section's own inertia. The unit of frequency is taken
    from the beam at rest, 3.5160153, since it is no Euler beam.
    """
    body = rod(comm, (1.0, 0.02, 0.02), (12, 1, 1), order=2, stiffening=["rotation"])
    integrals = body.reduce(np.ones(body.domain.n_cells)).integrals
    assert integrals.P is not None
    G, K = integrals.G[1:, 1:], integrals.K
    unit = np.sqrt(scipy.linalg.eigh(K, G, eigvals_only=True)[0]) / 3.5160153
    omega = speed * unit
    centrifugal = np.diag([-(omega**2), -(omega**2), 0.0])
    K = K + np.einsum("kl,klij->ij", centrifugal, integrals.stiffening["rotation"])
    K = K + np.einsum("kl,ijkl->ij", centrifugal, integrals.P[1:, 1:])
    chord, out = np.sqrt(scipy.linalg.eigh(K, G, eigvals_only=True)[:2]) / unit
    assert out == pytest.approx(flap, rel=3e-3)
    assert chord**2 + speed**2 == pytest.approx(out**2, rel=1e-3)


class Response:
    """A number that reads every integral and does not depend on the choice of basis.

    psi = f^T (K + sums of geometric stiffness - D:P)^-1 f + P_00:C, with loads f of S, P and
    markers.
    """

    def __init__(self) -> None:
        rng = np.random.default_rng(3)
        self.a, self.b, self.c = rng.standard_normal((3, 3))
        self.C, D = 30.0 * rng.standard_normal((2, 3, 3))
        self.D = 4e3 * (D + D.T)
        self.B = 3e3 * rng.standard_normal((3, 3))
        self.force = np.array([40.0, 10.0, -20.0])

    def matrix(self, integrals: ffr.VolumeIntegrals) -> np.ndarray:
        """What stands for the stiffness."""
        assert integrals.P is not None
        K = integrals.K - np.einsum("kl,ijkl->ij", self.D, integrals.P[1:, 1:])
        if "rotation" in integrals.stiffening:
            K = K + np.einsum("kl,klij->ij", self.B, integrals.stiffening["rotation"])
        if "acceleration" in integrals.stiffening:
            K = K + np.einsum("k,kij->ij", 1e3 * self.a, integrals.stiffening["acceleration"])
        for name in ("tip", "right"):
            stiffening = integrals.markers[name].stiffening
            if stiffening is not None:
                K = K + np.tensordot(self.force, stiffening, 1)
        return np.asarray(0.5 * (K + K.T))

    def load(self, integrals: ffr.VolumeIntegrals) -> np.ndarray:
        """The load f."""
        assert integrals.P is not None
        f = integrals.S[1:] @ self.a + np.einsum("kl,jkl->j", self.C, integrals.P[0, 1:])
        tip, right = integrals.markers["tip"], integrals.markers["right"]
        f = f + 0.1 * self.b @ tip.displacement + 0.01 * self.c @ tip.rotation
        return np.asarray(f + 0.1 * self.a @ right.rotation)

    def value(self, integrals: ffr.VolumeIntegrals) -> float:
        """The number."""
        assert integrals.P is not None
        f = self.load(integrals)
        still = 1e-6 * np.sum(self.C * integrals.P[0, 0]) + 1e-7 * integrals.mass
        return float(f @ np.linalg.solve(self.matrix(integrals), f) + still)

    def bar(self, integrals: ffr.VolumeIntegrals) -> ffr.VolumeIntegrals:
        """Its derivative."""
        q = np.linalg.solve(self.matrix(integrals), self.load(integrals))
        square, bar = np.outer(q, q), integrals.zeros_like()
        assert bar.P is not None
        P, S, K = bar.P.copy(), bar.S.copy(), -square
        S[1:] = np.outer(2.0 * q, self.a)
        P[0, 1:] = 2.0 * np.einsum("j,kl->jkl", q, self.C)
        P[0, 0] = 1e-6 * self.C
        P[1:, 1:] = np.einsum("ij,kl->ijkl", square, self.D)
        loads = {}
        if bar.stiffening:
            loads["rotation"] = -np.einsum("kl,ij->klij", self.B, square)
            loads["acceleration"] = -np.einsum("k,ij->kij", 1e3 * self.a, square)
        markers = dict(bar.markers)
        for name in ("tip", "right"):
            at = integrals.markers[name]
            displacement = 0.2 * np.outer(self.b, q) if name == "tip" else 0.0 * at.displacement
            rotation = np.outer(0.02 * self.c if name == "tip" else 0.2 * self.a, q)
            stiffening = None
            if at.stiffening is not None:
                stiffening = -np.einsum("k,ij->kij", self.force, square)
            markers[name] = ffr.BodyMarker(np.zeros(3), displacement, rotation, stiffening)
        return ffr.VolumeIntegrals.in_space(1e-7, S, P, K, markers, loads)


@pytest.mark.parametrize(
    ("width", "stiffening"),
    [(0.03, ()), (0.04, ()), (0.03, ("rotation", "acceleration", "markers"))],
    ids=["rectangular", "square", "stiffened"],
)
def test_pullback_to_the_densities(
    comm: MPI.Intracomm, width: float, stiffening: tuple[str, ...]
) -> None:
    """Taylor order 2, and agreement with differences; a square rod has repeated frequencies."""
    body = rod(
        comm,
        (0.4, 0.04, width),
        (8, 2, 2),
        frame=ffr.ChordFrame("left", "right"),
        modes=6,
        markers={"tip": (0.21, 0.003, 0.004)},
        stiffening=stiffening,
    )
    psi = Response()
    c = body.domain.centroids
    density = 0.6 + 0.3 * np.sin(40 * c[:, 0])
    if width != 0.04:
        density = 0.6 + 0.3 * np.sin(40 * c[:, 0] + 200 * c[:, 1] + 110 * c[:, 2])
    direction = np.cos(37 * c[:, 0] + 130 * c[:, 1] - 90 * c[:, 2] + 0.3)
    reduced = body.reduce(density)
    gradient, _ = body.pullback(reduced, psi.bar(reduced.integrals))

    def value(x: np.ndarray) -> float:
        return psi.value(body.reduce(x).integrals)

    def slope(d: np.ndarray) -> float:
        return comm.allreduce(float(gradient @ d))

    steps = [1e-2 / 2**k for k in range(4)]
    assert_taylor_order(taylor_test(value, slope, density, direction, steps=steps, roundoff=1e-10))
    difference = central_difference(value, density, direction, 2e-3)
    assert slope(direction) == pytest.approx(difference, rel=1e-6)


def test_same_numbers_on_any_number_of_ranks(comm: MPI.Intracomm) -> None:
    """Frequencies, and a number that reads every integral, do not depend on the partition."""
    psi, found = Response(), []
    for ranks in (comm, MPI.COMM_SELF):
        options = {"markers": {"tip": (0.21, 0.003, 0.004)}, "stiffening": ["rotation", "markers"]}
        body = rod(ranks, (0.4, 0.04, 0.03), (8, 2, 2), modes=4, **options)
        reduced = body.reduce(np.full(body.domain.n_cells, 0.7))
        found.append([*reduced.basis.frequencies, psi.value(reduced.integrals)])
    assert_allclose(found[0], found[1], rtol=1e-9)
