# SPDX-License-Identifier: MIT
"""Flexible bodies in space made of a few points, and beams with closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dolfinx_ffr.body import BodyMarker, VolumeIntegrals

Array = NDArray[np.float64]


def cloud_of_mass(modes: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """Points (n, 3) [m], their masses (n,) [kg] and fields w_a at them, (modes + 1, n, 3)."""
    rng = np.random.default_rng(seed)
    # More points than functions, which are 1 and three components of each field.
    n = 8 + 3 * modes
    points = rng.uniform(-1.0, 1.0, (n, 3)) * np.array([0.5, 0.2, 0.1])
    fields = np.concatenate([points[None], 0.5 * rng.standard_normal((modes, n, 3))])
    return points, rng.uniform(0.2, 0.4, n), fields


def cloud(modes: int, seed: int = 0, stiffness: float = 400.0) -> VolumeIntegrals:
    """A body of random points, with two markers on which all shape functions act."""
    rng = np.random.default_rng(100 + seed)
    _, masses, fields = cloud_of_mass(modes, seed)
    root = rng.standard_normal((modes, modes)) + 3.0 * np.eye(modes)
    markers = {
        name: BodyMarker(np.array(position), *0.5 * rng.standard_normal((2, 3, modes)))
        for name, position in (("root", (-0.5, 0.0, 0.0)), ("tip", (0.5, 0.1, -0.1)))
    }
    return VolumeIntegrals.from_arrays(
        masses.sum(),
        np.einsum("p,apk->ak", masses, fields),
        P=np.einsum("p,apk,bpl->abkl", masses, fields, fields),
        K=stiffness * root @ root.T,
        markers=markers,
    )


def stiffened_cloud(modes: int, seed: int = 0) -> VolumeIntegrals:
    """The same with geometric stiffness, also at its markers."""
    rng = np.random.default_rng(200 + seed)

    def symmetric(*shape: int) -> Array:
        array = rng.standard_normal((*shape, modes, modes))
        return array + np.swapaxes(array, -1, -2)

    body = cloud(modes, seed)
    markers = {
        name: replace(marker, stiffening=0.3 * symmetric(3))
        for name, marker in body.markers.items()
    }
    loads = {"rotation": 0.2 * symmetric(3, 3), "acceleration": 0.2 * symmetric(3)}
    return replace(body, markers=markers, stiffening=loads)


def flat_cloud(modes: int, seed: int = 0, *, space: bool = False) -> VolumeIntegrals:
    """A body of random points in a plane, with geometric stiffness, in the plane or in space.

    In space the points have a thickness, which does not matter to motions in the plane.
    """
    rng, d, flat = np.random.default_rng(400 + seed), 3 if space else 2, np.array([1.0, 1.0, 0.0])

    def symmetric(*shape: int) -> Array:
        array = rng.standard_normal((*shape, modes, modes))
        return array + np.swapaxes(array, -1, -2)

    n = 8 + 2 * modes
    points, masses = rng.uniform(-1.0, 1.0, (n, 3)) * [0.5, 0.2, 0.0], rng.uniform(0.2, 0.4, n)
    W = np.concatenate([points[None], 0.5 * rng.standard_normal((modes, n, 3)) * flat])
    P = np.einsum("p,apk,bpl->abkl", masses, W, W)
    P[0, 0, 2, 2] = 0.01
    root = rng.standard_normal((modes, modes)) + 3.0 * np.eye(modes)
    # the points' displacements of second order: moved, stretched and turned
    kinds = np.diag(flat), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    slopes = sum(0.1 * np.einsum("kl,ij->klij", kind, symmetric()) for kind in kinds)
    second = 0.1 * symmetric(3) * flat[:, None, None] + np.einsum("klij,pl->pkij", slopes, points)
    pairs = np.einsum("p,pl,pkij->klij", masses, points, second)
    loads = {"acceleration": np.einsum("p,pkij->kij", masses, second)[:d]}
    if space:
        loads["rotation"] = pairs
    else:
        loads |= {"omega2": -pairs[0, 0] - pairs[1, 1], "alpha": pairs[1, 0] - pairs[0, 1]}
    markers = {}
    for name, position in (("root", (-0.5, 0.0, 0.0)), ("tip", (0.5, 0.1, 0.0))):
        turns, shapes = 0.5 * rng.standard_normal(modes), 0.5 * rng.standard_normal((3, modes))
        markers[name] = BodyMarker(
            np.array(position[:d]),
            (shapes * flat[:, None])[:d],
            np.outer([0.0, 0.0, 1.0], turns) if space else turns,
            (0.3 * symmetric(3) * flat[:, None, None])[:d],
        )
    S, K = np.einsum("p,apk->ak", masses, W)[:, :d], 400.0 * root @ root.T
    settings = {"P": P[..., :d, :d], "K": K, "markers": markers, "stiffening": loads}
    return VolumeIntegrals.from_arrays(masses.sum(), S, **settings)
