# SPDX-License-Identifier: MIT
"""One step of the boundary: the smooth motion that lowers psi most within linear constraints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import nnls
from scipy.sparse import csc_matrix, csr_matrix, diags, issparse
from scipy.sparse.linalg import splu

from ..arrays import Array, Mask
from .options import PLANE_STEPS, StepOptions


@dataclass(frozen=True)
class SolverOptions:
    """How the problem of a step is solved."""

    weight_rounds: int = 6  #: Rounds in which the weight of the gradient is found
    reach_accuracy: float = 0.1  #: Share by which the longest offset may miss the reach then
    weight_factors: tuple[float, float] = (0.3, 3.0)  #: Factors of the weight in one round
    most_reach: float = 1.5  #: Largest offset, in reaches, if a violation asks for more
    iterations: int = 250  #: Most iterations for many multipliers
    change: float = 1e-5  #: Change of the multipliers, relative to the largest, that ends them
    power_iterations: int = 12  #: Iterations for the largest eigenvalue of the multipliers' matrix
    eigenvalue_margin: float = 1.1  #: Factor of safety of this eigenvalue


SOLVER = SolverOptions()
#: How a matrix that is symmetric, and needs no pivots, is factored with fewer entries
_SYMMETRIC = {
    "permc_spec": "MMD_AT_PLUS_A",
    "diag_pivot_thresh": 0.0,
    "options": {"SymmetricMode": True},
}


@dataclass(frozen=True, eq=False)
class Step:
    """A motion of the boundary, and the multipliers of its constraints."""

    offsets: Array  #: Along the normals, in the unit of the reach, (n,)
    multipliers: Array  #: Change of psi by each constraint, not negative, (m,)
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
    options: StepOptions = PLANE_STEPS,
) -> Step:
    """The step a that minimises 1/2 a.M a + mu (g.a + 1/2 |a.W|^2) within values + slopes a <= 0.

    The weight mu is that for which the longest offset is the ``reach``, and ``curved`` W (n, k)
    what is known of the curvature, see `curvature`. By duality it is a problem of non-negative
    least squares in the multipliers (C. L. Lawson, R. J. Hanson, Solving Least Squares Problems,
    SIAM 1995, doi:10.1137/1.9781611971217). Where slopes are sparse, of many constraints,
    multipliers are found by accelerated gradients (A. Beck, M. Teboulle, SIAM Journal on Imaging
    Sciences 2, 2009, doi:10.1137/080716542). Shapes: metric (n, n), gradient and fixed (n,), values
    (m,), slopes (m, n).
    """
    free = np.flatnonzero(~fixed)
    are_many = issparse(slopes)
    factor = splu(metric[free][:, free].tocsc(), **(_SYMMETRIC if are_many else {}))
    downhill = -factor.solve(gradient[free])
    curvature_columns = np.zeros((len(free), 0)) if curved is None else curved[free]

    # no step changes a constraint without a slope, and its multiplier is not determined
    squares: Any = slopes.multiply(slopes) if are_many else slopes**2  # type: ignore[union-attr]
    with_slope = np.flatnonzero(np.asarray(squares[:, free].sum(axis=1)).ravel())
    free_slopes = slopes[with_slope][:, free]
    # a step removes only a share of a large violation
    limited_values = np.minimum(values[with_slope], options.violation_share)
    solver_type = _ManyConstraints if are_many else _FewConstraints
    solver = solver_type(factor, free_slopes, downhill, curvature_columns)

    only_mends = not np.any(gradient)
    weight = reach / max(float(np.max(np.abs(downhill), initial=0.0)), 1e-300)
    for _ in range(SOLVER.weight_rounds):
        motion = solver.solve(limited_values, weight)[0]
        longest = float(np.max(np.abs(motion), initial=0.0))
        if longest == 0.0 or (only_mends and not are_many):
            break  # the weight of a zero gradient does not matter where the solution is exact
        if 1.0 - SOLVER.reach_accuracy < longest / reach < 1.0 + SOLVER.reach_accuracy:
            break
        weight *= float(np.clip(reach / longest, *SOLVER.weight_factors))
    if longest > SOLVER.most_reach * reach:
        motion *= SOLVER.most_reach * reach / longest

    offsets = np.zeros(len(gradient))
    offsets[free] = motion
    multipliers = np.zeros(len(values))
    if not only_mends:  # removing a violation is not counted as a change of psi
        satisfied = np.minimum(limited_values, 0.0)
        multipliers[with_slope] = solver.solve(satisfied, weight)[1] / weight
    quadratic = 0.5 * np.sum((motion @ curvature_columns) ** 2)
    promised = -float(gradient[free] @ motion + quadratic)
    return Step(offsets, multipliers, weight, promised)


class _FewConstraints:
    """The step within some hundred constraints, whose multipliers are found exactly.

    Args:
        factor: Factors of the metric M.
        slopes: Of the constraints, (m, n).
        downhill: Steepest descent -M^-1 g, (n,).
        curvature_columns: W of the curvature W W^T, (n, k).
    """

    def __init__(
        self, factor: Any, slopes: Array, downhill: Array, curvature_columns: Array
    ) -> None:
        self._slopes, self._columns = slopes, curvature_columns
        right = np.column_stack([slopes.T, curvature_columns])
        solved: Array = np.column_stack([downhill, factor.solve(right) if right.size else right])
        n_constraints = len(slopes)
        #: M^-1 times -g and the slopes
        self._solved = solved[:, : 1 + n_constraints]
        #: M^-1 W
        self._solved_columns = solved[:, 1 + n_constraints :]

    def solve(self, violations: Array, weight: float) -> tuple[Array, Array]:
        """The step, and the multipliers of constraints with these values."""
        columns, slopes = self._columns, self._slopes
        # the inverse of M + mu W W^T by that of M
        small = np.eye(columns.shape[1]) / weight + columns.T @ self._solved_columns
        correction = np.linalg.solve(small, columns.T @ self._solved)
        solved = self._solved - self._solved_columns @ correction
        unconstrained = np.asarray(weight * solved[:, 0])
        along_slopes: Array = solved[:, 1:]
        count = len(slopes)
        if not count:
            return unconstrained, violations

        gram = slopes @ along_slopes
        # constraints that say the same leave the multipliers undetermined, and not the step
        gram += 1e-10 * np.trace(gram) / count * np.eye(count)
        root = np.linalg.cholesky(gram)
        right = np.linalg.solve(root, violations + slopes @ unconstrained)
        multipliers = np.asarray(nnls(root.T, right, maxiter=100 * count)[0])
        return unconstrained - along_slopes @ multipliers, multipliers


class _ManyConstraints:
    """The step within thousands of constraints, without products of all of them.

    Rows are scaled to length one, so that those of a bound count as those of a wall. Arguments are
    those of `_FewConstraints`.
    """

    def __init__(
        self, factor: Any, slopes: csr_matrix, downhill: Array, curvature_columns: Array
    ) -> None:
        self._factor, self._downhill, self._slopes = factor, downhill, slopes
        self._columns = curvature_columns
        self._solved_columns = (
            factor.solve(curvature_columns) if curvature_columns.size else curvature_columns
        )
        squares = np.asarray(slopes.multiply(slopes).sum(axis=1)).ravel()
        self._lengths = np.sqrt(squares + 1e-300)
        self._rows = diags(1.0 / self._lengths) @ slopes
        eigenvalue = SOLVER.eigenvalue_margin * self._largest_eigenvalue()
        self._step_size = 1.0 / max(eigenvalue, 1e-300)
        #: Multipliers of the scaled rows, with which the next solution begins
        self._scaled = np.zeros(len(self._lengths))

    def _largest_eigenvalue(self) -> float:
        """Of the matrix of the multipliers, by power iteration."""
        vector = np.sin(1.0 + np.arange(len(self._lengths)))
        for _ in range(SOLVER.power_iterations):
            force = (self._rows.T @ vector) / max(np.linalg.norm(vector), 1e-300)
            vector = self._rows @ self._factor.solve(force)
        return float(np.linalg.norm(vector))

    def solve(self, violations: Array, weight: float) -> tuple[Array, Array]:
        """The step, and the multipliers of constraints with these values."""
        columns, rows = self._columns, self._rows
        small = np.linalg.inv(np.eye(columns.shape[1]) / weight + columns.T @ self._solved_columns)

        def with_curvature(solved: Array) -> Array:
            """By the inverse of M + mu W W^T, from that of M."""
            return np.asarray(solved - self._solved_columns @ (small @ (columns.T @ solved)))

        unconstrained = weight * with_curvature(self._downhill)
        multipliers = extrapolated = self._scaled
        momentum = 1.0
        for _ in range(SOLVER.iterations):
            forces = self._factor.solve(rows.T @ extrapolated)
            motion = unconstrained - with_curvature(forces)
            slope = violations / self._lengths + rows @ motion
            updated = np.maximum(extrapolated + self._step_size * slope, 0.0)
            if (extrapolated - updated) @ (updated - multipliers) > 0.0:  # it went too far
                momentum = 1.0
            previous, momentum = momentum, 0.5 + np.sqrt(0.25 + momentum**2)
            change = updated - multipliers
            extrapolated = updated + (previous - 1.0) / momentum * change
            multipliers = updated
            largest_change = np.max(np.abs(change), initial=0.0)
            if largest_change <= SOLVER.change * np.max(updated, initial=0.0):
                break
        self._scaled = multipliers
        unscaled = multipliers / self._lengths
        forces = self._factor.solve(self._slopes.T @ unscaled)
        return unconstrained - with_curvature(forces), unscaled


def secants(known: Array, move: Array, gradient: Array, count: int = PLANE_STEPS.secants) -> Array:
    """The motions of the last ``count`` steps, and the gradients before them, (2, steps, n).

    The ``known`` ones and one more, with its motion ``move``.
    """
    newest = np.stack([move, gradient])[:, None]
    return np.hstack([known, newest])[:, -count:] if known.size else newest


def curvature(metric: csc_matrix, known: Array, gradient: Array) -> Array:
    """Columns W (n, k) of the curvature W W^T that the last steps have shown.

    Along moves S, columns, the gradient has changed by Y. If Y = H S for a symmetric H, that is
    Y (S^T Y)^-1 Y^T: what the moves show of H, never more than it. Moves along which the curvature
    is not positive show nothing.
    """
    if not known.size:
        return np.zeros((len(gradient), 0))
    round_off = 1e-6  # share of the largest square or curvature that counts as zero
    moves = known[0].T
    changes = np.diff([*known[1], gradient], axis=0).T

    # combinations of the moves that are orthonormal in the metric
    squares, combinations = np.linalg.eigh(moves.T @ (metric @ moves))
    independent = squares > round_off * squares[-1]
    basis = combinations[:, independent] / np.sqrt(squares[independent])

    projected = basis.T @ (moves.T @ changes) @ basis
    curvatures, directions = np.linalg.eigh(0.5 * (projected + projected.T))
    is_positive = curvatures > round_off * np.max(curvatures, initial=0.0)
    columns = changes @ basis @ directions[:, is_positive]
    return np.asarray(columns / np.sqrt(curvatures[is_positive]))
