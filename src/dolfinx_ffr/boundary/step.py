# SPDX-License-Identifier: MIT
"""One step of the boundary: the smooth motion that lowers psi most within linear constraints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import nnls
from scipy.sparse import csc_matrix, csr_matrix, diags, issparse
from scipy.sparse.linalg import splu

from ..arrays import Array, Mask

#: Violations beyond this are mended in several steps
_AT_ONCE = 0.25
#: How often the weight of the gradient is found anew
_ROUNDS = 6
#: Iterations for many multipliers, and their change, relative to the largest, that ends them;
#: iterations for the largest eigenvalue of their matrix, and a factor of safety
_ITERATIONS, _STILL, _POWERS, _MARGIN = 250, 1e-5, 12, 1.1
#: How a matrix that is symmetric, and needs no pivots, is factored with fewer entries
_SYMMETRIC = {
    "permc_spec": "MMD_AT_PLUS_A",
    "diag_pivot_thresh": 0.0,
    "options": {"SymmetricMode": True},
}

#: By values and the weight of the gradient; the motion by multipliers
Multipliers = Callable[[Array, float], Array]
Motion = Callable[[Array], Array]


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
    slopes: Array | csr_matrix,
    held: Mask,
    reach: float,
) -> Step:
    """The step a that minimises 1/2 a.M a + mu g.a within values + slopes a <= 0.

    The weight mu is that for which the longest offset is ``reach`` [m]. By duality it is a problem
    of non-negative least squares in the multipliers (C. L. Lawson, R. J. Hanson, Solving Least
    Squares Problems, SIAM 1995, doi:10.1137/1.9781611971217). Where slopes are sparse, of many
    constraints, multipliers are found by accelerated gradients (A. Beck, M. Teboulle, SIAM Journal
    on Imaging Sciences 2, 2009, doi:10.1137/080716542). Shapes: metric (n, n), gradient and held
    (n,), values (m,), slopes (m, n).
    """
    free = np.flatnonzero(~held)
    how: dict[str, Any] = _SYMMETRIC if issparse(slopes) else {}
    factor = splu(metric[free][:, free].tocsc(), **how)
    downhill = -factor.solve(gradient[free])
    wanted = np.minimum(values, _AT_ONCE)
    found = _accelerated if issparse(slopes) else _exact
    multipliers, moved = found(factor, slopes[:, free], downhill)

    weight = reach / max(float(np.max(np.abs(downhill), initial=0.0)), 1e-300)
    for _ in range(_ROUNDS):
        inner = weight * downhill - moved(multipliers(wanted, weight))
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


def _exact(factor: Any, slopes: Array, downhill: Array) -> tuple[Multipliers, Motion]:
    """Multipliers by values and the weight of the gradient, and the motion that they cost."""
    count = len(slopes)
    toward = factor.solve(slopes.T) if count else np.zeros((len(downhill), 0))
    gram = slopes @ toward
    # constraints that say the same leave the multipliers undetermined, and not the step
    gram += 1e-10 * np.trace(gram) / max(count, 1) * np.eye(count)
    root = np.linalg.cholesky(gram) if count else gram

    def multipliers(wanted: Array, weight: float) -> Array:
        if not count:
            return wanted
        right = np.linalg.solve(root, wanted + weight * (slopes @ downhill))
        return np.asarray(nnls(root.T, right, maxiter=100 * count)[0])

    return multipliers, lambda costs: np.asarray(toward @ costs)


def _accelerated(factor: Any, slopes: csr_matrix, downhill: Array) -> tuple[Multipliers, Motion]:
    """The same for thousands of constraints, without their products; from those of the last call.

    Rows are of length one, so that those of a bound count as those of a wall.
    """
    length = np.sqrt(np.asarray(slopes.multiply(slopes).sum(axis=1)).ravel() + 1e-300)
    rows = diags(1.0 / length) @ slopes
    last, largest = np.zeros(len(length)), np.sin(1.0 + np.arange(len(length)))
    for _ in range(_POWERS):
        largest = rows @ factor.solve(rows.T @ largest / max(np.linalg.norm(largest), 1e-300))
    step = 1.0 / max(_MARGIN * float(np.linalg.norm(largest)), 1e-300)

    def multipliers(wanted: Array, weight: float) -> Array:
        nonlocal last
        ahead, pace = last, 1.0
        for _ in range(_ITERATIONS):
            inner = weight * downhill - factor.solve(rows.T @ ahead)
            found = np.maximum(ahead + step * (wanted / length + rows @ inner), 0.0)
            if (ahead - found) @ (found - last) > 0.0:  # it went too far
                pace = 1.0
            before, pace = pace, 0.5 + np.sqrt(0.25 + pace**2)
            ahead = found + (before - 1.0) / pace * (found - last)
            change, last = np.max(np.abs(found - last), initial=0.0), found
            if change <= _STILL * np.max(found, initial=0.0):
                break
        return last / length

    return multipliers, lambda costs: np.asarray(factor.solve(slopes.T @ costs))
