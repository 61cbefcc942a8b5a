# SPDX-License-Identifier: MIT
"""One step of the boundary: the smooth motion that lowers psi most within linear constraints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from ..arrays import Array, Mask

#: Violations beyond this are mended in several steps
_AT_ONCE = 0.25
#: How often the weight of the gradient is found anew
_ROUNDS = 6


@dataclass(frozen=True, eq=False)
class Step:
    """A motion of the controls, and what its constraints cost."""

    offsets: Array  #: Along the normals, one for each control [m]
    multipliers: Array  #: What each constraint costs of psi, not negative
    weight: float  #: Of the gradient


def best_step(
    metric: csc_matrix,
    gradient: Array,
    values: Array,
    slopes: Array,
    held: Mask,
    reach: float,
) -> Step:
    """The step a that minimises 1/2 a.M a + mu g.a within values + slopes a <= 0.

    The weight mu is that for which the longest offset is ``reach`` [m]. By duality it is a problem
    of non-negative least squares in the multipliers (C. L. Lawson, R. J. Hanson, Solving Least
    Squares Problems, SIAM 1995, doi:10.1137/1.9781611971217). Shapes: metric (n, n), gradient and
    held (n,), values (m,), slopes (m, n).
    """
    free = np.flatnonzero(~held)
    factor = splu(metric[free][:, free].tocsc())
    downhill = -factor.solve(gradient[free])
    toward = factor.solve(slopes[:, free].T) if len(values) else np.zeros((len(free), 0))
    gram = slopes[:, free] @ toward
    # constraints that say the same leave the multipliers undetermined, and not the step
    gram += 1e-10 * np.trace(gram) / max(len(values), 1) * np.eye(len(values))
    root = np.linalg.cholesky(gram) if len(values) else gram
    wanted = np.minimum(values, _AT_ONCE)

    def multipliers(wanted: Array, weight: float) -> Array:
        if not len(values):
            return values
        right = np.linalg.solve(root, wanted + weight * (slopes[:, free] @ downhill))
        return np.asarray(nnls(root.T, right, maxiter=100 * len(values))[0])

    weight = reach / max(float(np.max(np.abs(downhill), initial=0.0)), 1e-300)
    for _ in range(_ROUNDS):
        inner = weight * downhill - toward @ multipliers(wanted, weight)
        longest = float(np.max(np.abs(inner), initial=0.0))
        if longest == 0.0 or 0.9 < longest / reach < 1.1:
            break
        weight *= float(np.clip(reach / longest, 0.3, 3.0))
    if longest > 1.5 * reach:
        inner *= 1.5 * reach / longest
    offsets = np.zeros(len(gradient))
    offsets[free] = inner
    # what it takes to mend a violation is no cost of psi
    return Step(offsets, multipliers(np.minimum(wanted, 0.0), weight) / weight, weight)
