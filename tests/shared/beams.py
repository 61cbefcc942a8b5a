# SPDX-License-Identifier: MIT
"""Volume integrals of beams by a small finite-element model, independent of DOLFINx."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from dolfinx_ffr.body import BodyMarker, VolumeIntegrals

Array = NDArray[np.float64]


def beam(
    length: float = 0.4,
    height: float = 0.04,
    width: float = 0.01,
    youngs_modulus: float = 2.1e11,
    density: float = 7850.0,
    elements: int = 12,
    modes: int = 6,
    frame: str = "chord",
    stiffening: bool = False,
) -> VolumeIntegrals:
    """Euler-Bernoulli beam along x, from -length/2 to length/2, with its lowest modes.

    Hermite elements; each cross-section has mass but no rotary inertia. Markers "left", "middle"
    and "right". The frame is the "chord" between the ends (the right end may slide along it), the
    "tangent" at the left end, or "free": free-free modes about the centre of mass. Geometric
    stiffness is that of the axial force in a beam whose right end is free.
    """
    area, inertia = height * width, width * height**3 / 12.0
    h = length / elements
    n = 3 * (elements + 1)  # per node: u, v, angle
    points, weights = np.polynomial.legendre.leggauss(5)
    M, K = np.zeros((n, n)), np.zeros((n, n))
    spun, pulled = np.zeros((n, n)), np.zeros((n, n))
    fields, rhos = [], []
    for e in range(elements):
        dofs = np.arange(3 * e, 3 * e + 6)
        for xi, weight in zip(0.5 * (points + 1.0), 0.5 * h * weights, strict=True):
            shape = np.zeros((2, n))
            shape[0, dofs[[0, 3]]] = 1.0 - xi, xi
            shape[1, dofs[[1, 2, 4, 5]]] = hermite(xi, h)
            stretch, bend = np.zeros(n), np.zeros(n)
            stretch[dofs[[0, 3]]] = -1.0 / h, 1.0 / h
            bend[dofs[[1, 2, 4, 5]]] = hermite(xi, h, 2)
            M += density * area * weight * shape.T @ shape
            K += weight * youngs_modulus * area * np.outer(stretch, stretch)
            K += weight * youngs_modulus * inertia * np.outer(bend, bend)
            position = np.array([-0.5 * length + (e + xi) * h, 0.0])
            slope = np.zeros(n)
            slope[dofs[[1, 2, 4, 5]]] = hermite(xi, h, 1)
            turned, beyond = weight * np.outer(slope, slope), 0.5 * length - position[0]
            spun += density * area * 0.5 * (0.25 * length**2 - position[0] ** 2) * turned
            pulled -= density * area * beyond * turned
            fields.append((position, shape))
            rhos.append(density * area * weight)
    last = n - 3
    if frame == "free":
        keep = np.arange(n)
        _, vectors = scipy.linalg.eigh(K, M)
        basis = vectors[:, 3 : 3 + modes]
    else:
        held = [0, 1, last + 1] if frame == "chord" else [0, 1, 2]
        keep = np.setdiff1d(np.arange(n), held)
        _, vectors = scipy.linalg.eigh(K[np.ix_(keep, keep)], M[np.ix_(keep, keep)])
        basis = np.zeros((n, modes))
        basis[keep] = vectors[:, :modes]
        # Unit deflection instead of unit modal mass: elastic coordinates in metres.
        basis *= np.sqrt(density * area * length)
    # LAPACK's releases differ in signs, and random changes of bodies would differ with them
    largest = np.argmax(np.abs(basis) > 0.9 * np.abs(basis).max(axis=0, initial=0.0), axis=0)
    basis *= np.where(basis[largest, np.arange(modes)] < 0.0, -1.0, 1.0)
    W = np.array([np.column_stack([x, shape @ basis]) for x, shape in fields])
    rho = np.array(rhos)
    turned = np.stack([-W[:, 1], W[:, 0]], axis=1)
    middle = 3 * (elements // 2)
    markers = {
        name: BodyMarker(np.array([x, 0.0]), basis[node : node + 2].copy(), basis[node + 2].copy())
        for name, node, x in (
            ("left", 0, -0.5 * length),
            ("middle", middle, -0.5 * length + h * (elements // 2)),
            ("right", last, 0.5 * length),
        )
    }
    geometric = {
        "omega2": basis.T @ spun @ basis,
        "acceleration": np.stack([basis.T @ pulled @ basis, np.zeros((modes, modes))]),
    }
    return VolumeIntegrals(
        mass=float(rho.sum()),
        S=np.einsum("p,pia->ai", rho, W),
        G=np.einsum("p,pia,pib->ab", rho, W, W),
        N=np.einsum("p,pia,pib->ab", rho, turned, W),
        K=basis.T @ K @ basis,
        markers=markers,
        stiffening=geometric if stiffening else {},
    )


#: Of xi, for deflection and slope at both ends of an element of length one, a column each
HERMITE = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [-3, -2, 3, -1], [2, 1, -2, 1]], dtype=float)


def hermite(xi: float, h: float, derivative: int = 0) -> Array:
    """Hermite polynomials of an element, or their derivatives along it."""
    values = polynomial.polyval(xi, polynomial.polyder(HERMITE, derivative))
    return values * [1.0, h, 1.0, h] / h**derivative
