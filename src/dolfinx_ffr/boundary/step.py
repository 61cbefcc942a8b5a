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
from .options import CURVES, BoundaryOptions

#: Rounds in which the weight of the gradient is found: its reach is then within 10 %
_ROUNDS = 6
#: Iterations for many multipliers, and their change, relative to the largest, that ends them
_ITERATIONS, _CHANGE = 250, 1e-5
#: Iterations for the largest eigenvalue of their matrix, and a factor of safety
_POWERS, _MARGIN = 12, 1.1
#: How a matrix that is symmetric, and needs no pivots, is factored with fewer entries
_SYMMETRIC = {
    "permc_spec": "MMD_AT_PLUS_A",
    "diag_pivot_thresh": 0.0,
    "options": {"SymmetricMode": True},
}

#: The motion, and its multipliers, by values and the weight of the gradient
Motion = Callable[[Array, float], tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class Step:
    """A motion of the controls, and what its constraints cost."""

    offsets: Array  #: Along the normals, one for each control [m]
    multipliers: Array  #: What each constraint costs of psi, not negative
    weight: float  #: Of the gradient
    promised: float  #: Fall of psi by its gradient and the curvature that is known


def best_step(
    metric: csc_matrix,
    gradient: Array,
    values: Array,
    slopes: Array | csr_matrix,
    fixed: Mask,
    reach: float,
    curved: Array | None = None,
    options: BoundaryOptions = CURVES,
) -> Step:
    """The step a that minimises 1/2 a.M a + mu (g.a + 1/2 |a.W|^2) within values + slopes a <= 0.

    The weight mu is that for which the longest offset is ``reach`` [m], and ``curved`` W (n, k)
    what is known of the curvature, see `curvature`. By duality it is a problem of non-negative
    least squares in the multipliers (C. L. Lawson, R. J. Hanson, Solving Least Squares Problems,
    SIAM 1995, doi:10.1137/1.9781611971217). Where slopes are sparse, of many constraints,
    multipliers are found by accelerated gradients (A. Beck, M. Teboulle, SIAM Journal on Imaging
    Sciences 2, 2009, doi:10.1137/080716542). Shapes: metric (n, n), gradient and fixed (n,), values
    (m,), slopes (m, n).
    """
    free = np.flatnonzero(~fixed)
    how: dict[str, Any] = _SYMMETRIC if issparse(slopes) else {}
    factor = splu(metric[free][:, free].tocsc(), **how)
    downhill = -factor.solve(gradient[free])
    # no step changes a constraint without a slope, and its multiplier is not determined
    squares: Any = slopes.multiply(slopes) if issparse(slopes) else slopes**2  # type: ignore[union-attr]
    able = np.flatnonzero(np.asarray(squares[:, free].sum(axis=1)).ravel())
    slopes, wanted = slopes[able][:, free], np.minimum(values[able], options.at_once)
    bends = np.zeros((len(free), 0)) if curved is None else curved[free]
    step = (
        _accelerated(factor, slopes, downhill, bends)
        if issparse(slopes)
        else _exact(factor, slopes, downhill, bends)
    )
    mends = not np.any(gradient)
    weight = reach / max(float(np.max(np.abs(downhill), initial=0.0)), 1e-300)
    for _ in range(_ROUNDS):
        inner = step(wanted, weight)[0]
        longest = float(np.max(np.abs(inner), initial=0.0))
        if (mends and not issparse(slopes)) or longest == 0.0 or 0.9 < longest / reach < 1.1:
            break
        weight *= float(np.clip(reach / longest, 0.3, 3.0))
    if longest > 1.5 * reach:
        inner *= 1.5 * reach / longest
    offsets = np.zeros(len(gradient))
    offsets[free] = inner
    # what it takes to mend a violation is no cost of psi
    costs = np.zeros(len(values))
    if not mends:
        costs[able] = step(np.minimum(wanted, 0.0), weight)[1] / weight
    promised = -float(gradient[free] @ inner + 0.5 * np.sum((inner @ bends) ** 2))
    return Step(offsets, costs, weight, promised)


def secants(known: Array, move: Array, gradient: Array, count: int = CURVES.secants) -> Array:
    """The last ``count`` steps (2, steps, n): moves, and the gradient before each; one more."""
    last = np.stack([move, gradient])[:, None]
    return np.hstack([known, last])[:, -count:] if known.size else last


def curvature(
    metric: csc_matrix, known: Array, gradient: Array, least_share: float = CURVES.curvature_share
) -> Array:
    """Columns W (n, k) of the curvature W W^T that the last steps have shown.

    Along moves S, columns, the gradient has changed by Y. If Y = H S for a symmetric H, that is
    Y (S^T Y)^-1 Y^T: what the moves tell of H, never more than it. Moves along which the curvature
    is not positive tell nothing, nor do those of less than the ``least_share`` of the largest:
    the gradient is as much another one on another mesh.
    """
    if not known.size:
        return np.zeros((len(gradient), 0))
    moves, change = known[0].T, np.diff([*known[1], gradient], axis=0).T
    size, way = np.linalg.eigh(moves.T @ (metric @ moves))
    apart = size > 1e-6 * size[-1]
    way = way[:, apart] / np.sqrt(size[apart])
    bend = way.T @ (moves.T @ change) @ way
    along, turn = np.linalg.eigh(0.5 * (bend + bend.T))
    is_known = along > least_share * np.max(along, initial=0.0)
    return np.asarray(change @ way @ turn[:, is_known] / np.sqrt(along[is_known]))


def _exact(factor: Any, slopes: Array, downhill: Array, bends: Array) -> Motion:
    """The step with a curvature W W^T by the columns W of ``bends``."""
    count = len(slopes)
    every = np.column_stack([slopes.T, bends])
    every = np.column_stack([downhill, factor.solve(every) if every.size else every])
    stiff = every[:, 1 + count :]

    def step(wanted: Array, weight: float) -> tuple[Array, Array]:
        # the inverse of M + mu W W^T by that of M
        inner = np.eye(bends.shape[1]) / weight + bends.T @ stiff
        ways = every[:, : 1 + count]
        ways = ways - stiff @ np.linalg.solve(inner, bends.T @ ways)
        way = np.asarray(weight * ways[:, 0])
        toward: Array = ways[:, 1:]
        if not count:
            return way, wanted
        gram = slopes @ toward
        # constraints that say the same leave the multipliers undetermined, and not the step
        gram += 1e-10 * np.trace(gram) / count * np.eye(count)
        root = np.linalg.cholesky(gram)
        right = np.linalg.solve(root, wanted + slopes @ way)
        costs = np.asarray(nnls(root.T, right, maxiter=100 * count)[0])
        return way - toward @ costs, costs

    return step


def _accelerated(factor: Any, slopes: csr_matrix, downhill: Array, bends: Array) -> Motion:
    """The same for thousands of constraints, without their products; from those of the last call.

    Rows are of length one, so that those of a bound count as those of a wall.
    """
    length = np.sqrt(np.asarray(slopes.multiply(slopes).sum(axis=1)).ravel() + 1e-300)
    rows = diags(1.0 / length) @ slopes
    stiff = factor.solve(bends) if bends.size else bends
    last, largest = np.zeros(len(length)), np.sin(1.0 + np.arange(len(length)))
    for _ in range(_POWERS):
        largest = rows @ factor.solve(rows.T @ largest / max(np.linalg.norm(largest), 1e-300))
    step = 1.0 / max(_MARGIN * float(np.linalg.norm(largest)), 1e-300)

    def step_of(wanted: Array, weight: float) -> tuple[Array, Array]:
        nonlocal last
        inverse = np.linalg.inv(np.eye(bends.shape[1]) / weight + bends.T @ stiff)

        def curved(way: Array) -> Array:
            """By the inverse of M + mu W W^T, from that of M."""
            return np.asarray(way - stiff @ (inverse @ (bends.T @ way)))

        way = weight * curved(downhill)
        ahead, pace = last, 1.0
        for _ in range(_ITERATIONS):
            inner = way - curved(factor.solve(rows.T @ ahead))
            found = np.maximum(ahead + step * (wanted / length + rows @ inner), 0.0)
            if (ahead - found) @ (found - last) > 0.0:  # it went too far
                pace = 1.0
            before, pace = pace, 0.5 + np.sqrt(0.25 + pace**2)
            ahead = found + (before - 1.0) / pace * (found - last)
            change, last = np.max(np.abs(found - last), initial=0.0), found
            if change <= _CHANGE * np.max(found, initial=0.0):
                break
        costs = last / length
        return way - curved(factor.solve(slopes.T @ costs)), costs

    return step_of
