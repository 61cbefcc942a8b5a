# SPDX-License-Identifier: MIT
"""Where a body loses its stiffness by its rotation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.linalg

from ...arrays import Array

#: Steps whose stiffness is looked at together.
_CHUNK = 2000


def soft_steps(K: Array, G: Array, loads: Array, parts: Array) -> Iterator[int]:
    """Time steps at which K plus parts (n, r, r) times loads (instants, n) is indefinite.

    K and G are elastic stiffness and mass, shape (r, r).
    """
    # In the basis of the modes at rest, so that no unit hides a slip.
    squares, modes = scipy.linalg.eigh(K, G)
    parts = modes.T @ parts @ modes
    parts = 0.5 * (parts + parts.transpose(0, 2, 1))
    for start in range(0, len(loads), _CHUNK):
        stiffness = np.diag(squares) + np.tensordot(loads[start : start + _CHUNK], parts, 1)
        soft = np.linalg.eigvalsh(stiffness)[:, 0] < min(0.0, -1e-12 * squares[-1])
        yield from start + np.flatnonzero(soft)
