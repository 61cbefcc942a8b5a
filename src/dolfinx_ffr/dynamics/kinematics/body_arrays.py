# SPDX-License-Identifier: MIT
"""Bodies as flat arrays, in the plane and in space alike."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias, TypeGuard

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, symmetric
from ...body import VolumeIntegrals
from ...mechanism import RayleighDamping
from .carried import padded_stiffening
from .plane import PlaneArrays
from .space import SpaceArrays

#: A mechanism as flat arrays, in the plane or in space.
ModelArrays: TypeAlias = PlaneArrays | SpaceArrays
#: The two by dimension: whatever is not alike in plane and space is an attribute of these classes.
KINDS: dict[int, type[ModelArrays]] = {2: PlaneArrays, 3: SpaceArrays}


def is_spatial(model: ModelArrays) -> TypeGuard[SpaceArrays]:
    """Whether a mechanism is one in space."""
    return model.d == 3


def body_arrays(
    bodies: Mapping[str, VolumeIntegrals], damping: Mapping[str, RayleighDamping]
) -> dict[str, NDArray]:
    """Padded arrays of all bodies, by name of the field of ModelArrays."""
    count, kind = len(bodies), KINDS[next(iter(bodies.values())).dimension]
    d, carried, rigid = kind.d, kind.carries, kind.rigid
    modes_of_body = np.array([integrals.modes for integrals in bodies.values()], dtype=np.int64)
    stiffened = np.array([bool(b.stiffening) for b in bodies.values()], dtype=np.int64)
    fields, modes = modes_of_body + carried * stiffened, int(modes_of_body.max())
    with_stiffening, n = count if np.any(stiffened) else 0, int(fields.max()) + 1
    rayleigh = [damping.get(name, RayleighDamping()) for name in bodies]
    out = {
        "first": np.concatenate([[0], np.cumsum(rigid + modes_of_body)[:-1]]).astype(np.int64),
        "modes": modes_of_body,
        "fields": fields,
        "mass": np.array([integrals.mass for integrals in bodies.values()]),
        "S": np.zeros((count, n, d)),
        "G": np.zeros((count, n, n)),
        "N": np.zeros((count, n, n)),
        "P": np.zeros((count, n, 9 * n)),
        "K": np.zeros((count, n - 1, n - 1)),
        "alpha": np.array([float(r.alpha) for r in rayleigh]),
        "beta": np.array([float(r.beta) for r in rayleigh]),
        "stiffened": stiffened,
        "stiffening": np.zeros((with_stiffening, carried, modes, modes)),
        "carried": np.zeros((with_stiffening, carried, modes, modes)),
        "inverse": np.zeros((count, modes + rigid, modes + rigid)),
    }
    for b, integrals in enumerate(bodies.values()):
        T = None
        if integrals.stiffening:
            T = out["stiffening"][b] = padded_stiffening(integrals.stacked_stiffening, modes)
        r, inverse = int(modes_of_body[b]), out["inverse"][b]
        out["K"][b, :r, :r] = symmetric(integrals.K)
        inverse[range(d), range(d)] = 1.0 / integrals.mass
        inverse[d:rigid, d:rigid] = _inverse_mass(kind.set_moments(out, b, integrals, T))
        if r:
            G = integrals.G[1:, 1:]
            inverse[rigid : rigid + r, rigid : rigid + r] = _inverse_mass(symmetric(G))
    return out


def _inverse_mass(G: Array) -> Array:
    """Inverse of a mass matrix (r, r), found at unit diagonal, where its units do not matter."""
    scale = 1.0 / np.sqrt(np.diag(G))
    inverse = np.outer(scale, scale) * np.linalg.inv(G * np.outer(scale, scale))
    return symmetric(np.asarray(inverse))
