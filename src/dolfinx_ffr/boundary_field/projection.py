# SPDX-License-Identifier: MIT
"""The smooth step that lowers a function most within linear constraints, and its curvature.

The step a minimises 1/2 a.M a + w (g.a + 1/2 |W^T a|^2) within v + S a <= 0. By duality it is a
problem of non-negative least squares in the multipliers (C. L. Lawson, R. J. Hanson, Solving Least
Squares Problems, SIAM 1995, doi:10.1137/1.9781611971217).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import nnls
from scipy.sparse import block_diag, csc_matrix, csr_matrix
from scipy.sparse.linalg import splu

from ..arrays import Array, Mask
from .field import SYMMETRIC

#: Value of a constraint that a step exceeds by no more than round-off
_EXCEEDED = 1e-9


@dataclass(frozen=True, eq=False)
class Step:
    """A step, and what its constraints cost."""

    motion: Array  #: Of all variables, (n,) [m]
    multipliers: Array  #: Costs of the constraints per weight of the function, (rows,)
    weight: float  #: Of the function beside the metric
    promised: float  #: Fall of the function by its gradient and curvature


class SmoothMotion:
    """A metric M (n, n) of motions, factored for the variables that are ``free`` (n,)."""

    def __init__(self, metric: csc_matrix, free: Mask) -> None:
        self.metric = metric
        self.free = np.flatnonzero(free)
        self._factor: Any = splu(metric[self.free][:, self.free].tocsc(), **SYMMETRIC)

    def without(self, held: Mask) -> SmoothMotion:
        """The motions without those of ``held`` variables (n,)."""
        free = np.zeros(len(held), dtype=bool)
        free[self.free] = True
        return SmoothMotion(self.metric, free & ~held)

    def solve(self, slopes: Array) -> Array:
        """The motions of free variables whose product with M is ``slopes`` (free, ...)."""
        return np.asarray(self._factor.solve(slopes)) if slopes.size else slopes


class JoinedMotions:
    """Motions of several fields as one."""

    def __init__(self, motions: Sequence[SmoothMotion]) -> None:
        self._motions = motions
        self.metric = csc_matrix(block_diag([motion.metric for motion in motions]))
        sizes = [motion.metric.shape[0] for motion in motions]
        first = np.cumsum([0, *sizes[:-1]])
        self.free = np.concatenate([m.free + k for m, k in zip(motions, first, strict=True)])
        self._ends = np.cumsum([len(motion.free) for motion in motions])[:-1]

    def solve(self, slopes: Array) -> Array:
        """The motions of free variables whose product with M is ``slopes`` (free, ...)."""
        parts = zip(self._motions, np.split(slopes, self._ends), strict=True)
        return np.concatenate([motion.solve(part) for motion, part in parts])


class Projection:
    """Steps from one point by one metric.

    Args:
        smooth: The metric M, and which variables move.
        gradient: g of the function that falls, (n,).
        slopes: S of the constraints, (rows, n).
        bends: W, the curvature of the function as columns, (n, k).
    """

    def __init__(
        self,
        smooth: SmoothMotion | JoinedMotions,
        gradient: Array,
        slopes: csr_matrix,
        bends: Array | None = None,
    ) -> None:
        self._smooth, self._free = smooth, smooth.free
        self._size = len(gradient)
        self._gradient = gradient[self._free]
        self._downhill = -smooth.solve(self._gradient)
        self._slopes = slopes[:, self._free]
        # no step changes a constraint without a slope
        self._able = np.asarray(abs(self._slopes).sum(axis=1)).ravel() > 0.0
        self._bends = np.zeros((len(self._free), 0)) if bends is None else bends[self._free]
        self._stiff = smooth.solve(self._bends)
        #: Constraints that have been active, and the motions M^-1 S^T by their multipliers
        self._active = np.zeros(0, dtype=np.int64)
        self._toward = np.zeros((len(self._free), 0))

    def step(self, values: Array, weight: float) -> tuple[Array, Array]:
        """The step (n,) for a weight of the function, and the multipliers (rows,)."""
        inner, costs = self._inner(values, weight)
        return self._whole(inner), costs

    def within(self, values: Array, reach: float, weight: float | None = None) -> Step:
        """The step whose longest motion is about a ``reach``; from an earlier ``weight`` on."""
        if weight is None:
            weight = reach / max(float(np.max(np.abs(self._downhill), initial=0.0)), 1e-300)
        inner = self._downhill
        longest = 0.0
        for _ in range(6):
            inner, _ = self._inner(values, weight)
            longest = float(np.max(np.abs(inner), initial=0.0))
            if longest == 0.0 or 0.9 < longest / reach < 1.1:
                break
            weight *= float(np.clip(reach / longest, 0.3, 3.0))
        if longest > 1.5 * reach:
            inner = inner * (1.5 * reach / longest)
        # what it takes to mend a violation is no cost of the function
        costs = self.step(np.minimum(values, 0.0), weight)[1] / weight
        bent = 0.5 * float(np.sum((inner @ self._bends) ** 2))
        return Step(self._whole(inner), costs, weight, -float(self._gradient @ inner) - bent)

    def _whole(self, inner: Array) -> Array:
        motion = np.zeros(self._size)
        motion[self._free] = inner
        return motion

    def _inner(self, values: Array, weight: float) -> tuple[Array, Array]:
        """The step of the free variables, and the multipliers of all constraints.

        Constraints that the step of the others exceeds join these, as most are never active.
        """
        costs = np.zeros(len(values))
        while True:
            inner, costs[self._active] = self._among_active(values, weight)
            exceeded = values + self._slopes @ inner > _EXCEEDED
            exceeded[self._active] = False
            joining = np.flatnonzero(exceeded & self._able)
            if not len(joining):
                return inner, costs
            slopes = np.asfortranarray(self._slopes[joining].toarray().T)
            self._active = np.append(self._active, joining)
            self._toward = np.column_stack([self._toward, self._smooth.solve(slopes)])

    def _among_active(self, values: Array, weight: float) -> tuple[Array, Array]:
        """The same within the constraints that have been active, with their multipliers."""
        ways = np.column_stack([weight * self._downhill, self._toward])
        if self._bends.size:
            # the inverse of M + w W W^T by that of M
            inner = np.eye(self._bends.shape[1]) / weight + self._bends.T @ self._stiff
            ways = ways - self._stiff @ np.linalg.solve(inner, self._bends.T @ ways)
        way, toward = ways[:, 0], ways[:, 1:]
        count = len(self._active)
        if not count:
            return way, np.zeros(0)
        slopes = self._slopes[self._active]
        gram = slopes @ toward
        # constraints that say the same leave their multipliers undetermined, and not the step
        gram += 1e-10 * np.trace(gram) / count * np.eye(count)
        root = np.linalg.cholesky(gram)
        right = np.linalg.solve(root, values[self._active] + slopes @ way)
        costs = np.asarray(nnls(root.T, right, maxiter=100 * count)[0])
        return way - toward @ costs, costs


@dataclass(frozen=True, eq=False)
class Secants:
    """What the last steps tell of the curvature: motions, and the gradient before each."""

    motions: tuple[Array, ...] = ()
    gradients: tuple[Array, ...] = ()

    def after(self, motion: Array, gradient: Array, most: int) -> Secants:
        """With one step more, and of all the last ``most``."""
        motions = (*self.motions, motion)[-most:]
        return Secants(motions, (*self.gradients, gradient)[-most:])

    def bends(self, metric: csc_matrix, gradient: Array, share: float) -> Array:
        """Columns W of the curvature W W^T, (n, k).

        Along the motions S the gradient has changed by Y. If Y = H S for a symmetric H, that is
        Y (S^T Y)^-1 Y^T: what the motions tell of H, and never more. Directions in which the
        curvature is less than a ``share`` of the largest one tell nothing but noise.
        """
        if not self.motions:
            return np.zeros((len(gradient), 0))
        motions = np.stack(self.motions, axis=1)
        change = np.diff(np.stack([*self.gradients, gradient], axis=1), axis=1)
        size, way = np.linalg.eigh(motions.T @ (metric @ motions))
        apart = size > 1e-6 * size[-1]
        way = way[:, apart] / np.sqrt(size[apart])
        bend = way.T @ (motions.T @ change) @ way
        along, turn = np.linalg.eigh(0.5 * (bend + bend.T))
        told = along > share * np.max(along, initial=0.0)
        return np.asarray(change @ way @ turn[:, told] / np.sqrt(along[told]))
