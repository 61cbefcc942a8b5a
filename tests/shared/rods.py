# SPDX-License-Identifier: MIT
"""Flexible rods on small meshes, and a number that reads every volume integral of a body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np

import dolfinx_ffr as ffr

STEEL = ffr.PlaneStress(210e9, 0.3, 7850.0, 0.01)
CHORD, HELD = ffr.ChordFrame("left", "right"), ffr.TangentFrame("left")
OF_THE_DOMAIN = ("cell", "order", "solid", "void", "solid_columns", "solid_layers")


def rod(
    comm: MPI.Intracomm,
    elements: Sequence[int] = (20, 4),
    sizes: Sequence[float] = (0.4, 0.04, 0.03),
    material: Any = None,
    **options: Any,
) -> ffr.FlexibleBody:
    """A rod of steel along x, in space where there are three numbers of elements.

    The options are those of the domain and of the body; by default it has three normal modes and a
    chord between its ends.
    """
    own = {key: options.pop(key) for key in OF_THE_DOMAIN if key in options}
    if len(elements) == 2:
        domain = ffr.Domain.rectangle(comm, *sizes[:2], elements=elements, **own)
    else:
        domain = ffr.Domain.box(comm, *sizes, elements=elements, **{"solid_layers": 1, **own})
        material = material or ffr.Isotropic(STEEL.young, STEEL.poisson, STEEL.density)
    return ffr.FlexibleBody(domain, material or STEEL, **{"frame": CHORD, "modes": 3, **options})


def solid(body: ffr.FlexibleBody) -> ffr.reduction.ReducedBody:
    """The full body."""
    return body.reduce(np.ones(body.domain.n_cells))


def waves(domain: ffr.Domain, phase: float = 0.0) -> np.ndarray:
    """Densities that are not symmetric, functions of position alone."""
    place = domain.centroids @ [40.0, 200.0, 110.0][: domain.dimension]
    return 0.6 + 0.3 * np.sin(place + phase)


def ways(domain: ffr.Domain) -> np.ndarray:
    """A direction in which to change them."""
    return np.cos(domain.centroids @ [37.0, 130.0, -90.0][: domain.dimension] + 0.3)


class Response:
    """psi = f^T A^-1 f + c, which reads every integral and does not depend on the choice of basis.

    A is the stiffness, that by loads included, less second moments; f has parts of S, of the second
    moments, and of displacement and rotation at the markers "tip" and "right".
    """

    def __init__(self, dimension: int) -> None:
        d, rng = dimension, np.random.default_rng(3)
        self.a, self.b, self.force = rng.standard_normal((3, d)) * [[1.0], [1.0], [5e2]]
        self.turn = rng.standard_normal(1 if d == 2 else 3)
        #: Weights of the moments, G and N in the plane and P in space
        self.C, D = 60.0 * rng.standard_normal((2, 2 if d == 2 else 9))
        # a symmetric matrix, to which N adds nothing
        self.D = 40.0 * (
            D * [1.0, 0.0] if d == 2 else (D.reshape(3, 3) + D.reshape(3, 3).T).ravel()
        )
        by_rotation, by_acceleration = 3e4 * rng.standard_normal((3, 3)), 3e3 * self.a
        self.loads = {"omega2": np.array(1e4), "alpha": np.array(1e6)}
        self.loads |= {"rotation": by_rotation, "acceleration": by_acceleration}

    @staticmethod
    def moments(integrals: ffr.VolumeIntegrals) -> np.ndarray:
        """Second moments, shape (modes + 1, modes + 1, views)."""
        n = integrals.modes + 1
        if integrals.P is None:
            return np.stack([integrals.G, integrals.N], axis=-1)
        return integrals.P.reshape(n, n, 9)

    def solved(self, integrals: ffr.VolumeIntegrals) -> tuple[np.ndarray, np.ndarray]:
        """The load f, and A^-1 f."""
        A = integrals.K - self.moments(integrals)[1:, 1:] @ self.D
        for load, array in integrals.stiffening.items():
            A = A + np.tensordot(self.loads[load], array, self.loads[load].ndim)
        for marker in integrals.markers.values():
            if marker.stiffening is not None:
                A = A + np.tensordot(self.force, marker.stiffening, 1)
        tip, right = (integrals.markers[name] for name in ("tip", "right"))
        f = integrals.S[1:] @ self.a + self.moments(integrals)[0, 1:] @ self.C
        f = f + 0.1 * self.b @ tip.displacement + 0.01 * self.turn @ np.atleast_2d(tip.rotation)
        f = f + 0.1 * self.turn @ np.atleast_2d(right.rotation)
        return f, np.linalg.solve(0.5 * (A + A.T), f)

    def value(self, integrals: ffr.VolumeIntegrals) -> float:
        """The number."""
        f, q = self.solved(integrals)
        still = self.moments(integrals)[0, 0] @ self.C + self.a @ integrals.S[0] + integrals.mass
        return float(f @ q) + 1e-6 * still

    def bar(self, integrals: ffr.VolumeIntegrals) -> ffr.VolumeIntegrals:
        """Its derivative."""
        _, q = self.solved(integrals)
        square, bar = np.outer(q, q), integrals.zeros_like()
        bar.S[0], bar.S[1:] = 1e-6 * self.a, np.outer(2.0 * q, self.a)
        bar.K[:] = -square
        moments = np.zeros_like(self.moments(integrals))
        moments[0, 0], moments[0, 1:] = 1e-6 * self.C, np.outer(2.0 * q, self.C)
        moments[1:, 1:] = square[..., None] * self.D
        for load, array in bar.stiffening.items():
            array[:] = -np.multiply.outer(self.loads[load], square)
        for marker in bar.markers.values():
            if marker.stiffening is not None:
                marker.stiffening[:] = -np.multiply.outer(self.force, square)
        bar.markers["tip"].displacement[:] = 0.2 * np.outer(self.b, q)
        for name, size in (("tip", 0.02), ("right", 0.2)):
            rotation = bar.markers[name].rotation
            rotation[:] = size * np.outer(self.turn, q).reshape(rotation.shape)
        if bar.P is not None:
            return replace(bar, mass=1e-6, P=moments.reshape(bar.P.shape))
        G, N = np.moveaxis(moments, -1, 0)
        return replace(bar, mass=1e-6, G=0.5 * (G + G.T), N=0.5 * (N - N.T))
