# SPDX-License-Identifier: MIT
"""The method of moving asymptotes: one step from values and gradients to the next variables.

    min over x of f_0(x)   such that   f_i(x) <= 0,   lower <= x <= upper.

Each function is replaced by r_i + sum_j p_ij / (U_j - x_j) + q_ij / (x_j - L_j), which has its
value and gradient at the present variables. The asymptotes L and U of a variable come closer when
it oscillates, and move away when it keeps its direction. The separable convex problem is solved by
its dual, which has one variable for each constraint.

The largest of several functions is minimised by bounding them,

    min over x, z of f_0(x) + z   such that   f_i(x) <= z for some i,   f_i(x) <= 0 for the others,

in which z has neither bounds nor asymptotes: the subproblem is minimised over it exactly, with a
quadratic term so weak that it only makes the dual smooth.

A constraint that cannot be satisfied is relaxed at a price (the "elastic" variables of the paper),
so that each step is defined, and leads towards the feasible side.

Each approximation of the paper is monotone in each variable. If the function is not, as a density
is a load and a strength at once, the variable oscillates. The difference of two gradients gives the
second derivative by each variable along the last step; where it exceeds that of the
approximation, both p and q are enlarged to match it (Bruyneel, Duysinx and Fleury).

References:
    K. Svanberg, International Journal for Numerical Methods in Engineering 24 (1987),
    doi:10.1002/nme.1620240207.
    M. Bruyneel, P. Duysinx, C. Fleury, Structural and Multidisciplinary Optimization 24 (2002),
    doi:10.1007/s00158-002-0238-7.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from ..arrays import Array, Mask

#: Distance of the asymptotes as a share of the range: at the start, and its bounds
FIRST, LEAST, MOST = 0.5, 0.01, 10.0
#: Factors of that distance if a variable keeps its direction, and if it turns round
WIDEN, TIGHTEN = 1.2, 0.7
#: Share of the distance to an asymptote that a step leaves
MARGIN = 0.1
#: Curvature of a function without a slope, in units of its mean slope
CURVATURE = 1e-5
#: Multiplier above which a constraint is relaxed; slopes of log psi are about one
PRICE = 1e3
#: Factor of the quadratic term of the bound z, which changes the multipliers, whose sum is one, by
#: this times the change of z, a logarithm
WEAK = 1e-2
#: Least change of a variable, as a share of the largest one, that gives a second derivative; less
#: is near round-off. With 0 and 1e-3 a hanging bar takes 26 and 23 iterations, with 0.1 55.
CHANGED = 1e-3
#: Share of the last second derivative below which the next does not fall, as changes of the other
#: variables may hide it for a step. With 0 a hanging bar ends 6 % above its optimum and a spinning
#: one takes 44 iterations instead of 20; with 0.9 they take 37 and 27 instead of 23 and 20.
MEMORY = 0.5


@dataclass(frozen=True, eq=False)
class Secants:
    """Second derivatives of the functions by each variable, from the gradients of two points."""

    x: Array  #: The later point, shape (n,)
    gradients: Array  #: Of the objective and the constraints there, shape (1 + m, n)
    curvature: Array  #: Second derivatives by each variable, shape (1 + m, n); 0 where unknown

    @classmethod
    def begin(cls, x: Array, gradients: Array) -> Secants:
        """The first point, at which second derivatives are unknown."""
        return cls(x, gradients, np.zeros_like(gradients))

    def next(self, x: Array, gradients: Array, comparable: Mask | bool = True) -> Secants:
        """The secants after a step to the point ``x``.

        The mask ``comparable`` (1 + m,) marks functions that have not changed since the last point;
        second derivatives of other functions are unknown.
        """
        if gradients.shape != self.gradients.shape:
            return Secants.begin(x, gradients)
        change = x - self.x
        largest = np.max(np.abs(change))
        if largest == 0.0:  # a step was rejected
            return self
        changed = np.abs(change) > CHANGED * largest
        quotients = (gradients - self.gradients) / np.where(changed, change, 1.0)
        curvature = np.maximum(quotients, MEMORY * self.curvature)
        curvature = np.where(changed, curvature, self.curvature)
        is_known = np.broadcast_to(comparable, len(gradients))
        return Secants(x, gradients, np.where(is_known[:, None], curvature, 0.0))


@dataclass(frozen=True, eq=False)
class Asymptotes:
    """The state of the method: present and earlier variables, asymptotes, second derivatives.

    A step returns a new state.
    """

    lower: Array
    upper: Array
    x: Array
    move: float = 0.1
    previous: Array | None = None  #: Variables one step earlier, shape (n,)
    second_last: Array | None = None  #: Variables two steps earlier, shape (n,)
    reach: Array | None = None  #: Distance of both asymptotes from ``previous``, shape (n,)
    secants: Secants | None = None  #: Given if the functions are the same from step to step

    def step(
        self, slope: Array, values: Array, slopes: Array, bounded: int = 0
    ) -> tuple[Asymptotes, Array]:
        """The state at the next variables, and the multipliers of the constraints, shape (m,).

        Args:
            slope: Gradient of the objective, shape (n,), of any scale, which multipliers share.
            values: Values of the f_i, shape (m,).
            slopes: Their gradients, shape (m, n).
            bounded: Number of the first f_i, of the size of one, that z bounds; it is minimised
                together with the objective.
        """
        x, width = self.x, self.upper - self.lower
        reach = self._reach()
        low, high = x - reach, x + reach
        # the move limits keep clear of the asymptotes
        alpha = np.maximum(self.lower, np.maximum(low + MARGIN * reach, x - self.move * width))
        beta = np.minimum(self.upper, np.minimum(high - MARGIN * reach, x + self.move * width))
        gradients = np.vstack([slope[None, :], slopes.reshape(len(values), len(x))])
        typical = np.mean(np.abs(gradients), axis=1, keepdims=True)
        convexity = 0.001 * np.abs(gradients) + CURVATURE * typical
        if self.secants is not None:
            # the second derivative is 2 (p + q) / reach^3, p + q = reach^2 (|slope| + 2 convexity)
            curvature = self.secants.curvature
            convexity = np.maximum(convexity, 0.25 * curvature * reach - 0.5 * np.abs(gradients))

        p = reach**2 * (np.maximum(gradients, 0.0) + convexity)
        q = reach**2 * (np.maximum(-gradients, 0.0) + convexity)
        r = values - np.sum((p[1:] + q[1:]) / reach, axis=1)
        if bounded:  # z is measured from its present value, the largest of the functions
            r[:bounded] -= np.max(values[:bounded])

        minimiser, multipliers = _Subproblem(low, high, alpha, beta, x, p, q, r, bounded).solve()
        state = replace(self, x=minimiser, previous=x, second_last=self.previous, reach=reach)
        return state, multipliers

    def retreat(self, origin: Asymptotes) -> Asymptotes:
        """The state ``origin`` of a step that was rejected, with shorter next steps.

        This state is the one that the step led to. Without secants the reach is halved, too.
        """
        assert self.reach is not None
        # as both earlier points are the same, the next step does not change the reach
        return replace(
            origin,
            previous=origin.x,
            second_last=origin.x,
            reach=(0.5 if self.secants is None else 1.0) * self.reach,
            move=0.5 * origin.move,
        )

    def possible_gain(
        self,
        slope: Array,
        values: Array,
        slopes: Array,
        multipliers: Array,
        move: float,
        bounded: int = 0,
    ) -> float:
        """An upper bound of the fall of the objective, to first order, by a change of ``move``.

        The change is in shares of the range, and the constraints are linearised. The other
        arguments are those of `step` and the ``multipliers`` that it has returned. By duality of
        linear programs any multipliers give an upper bound, which is zero if the first-order
        conditions hold with them. The multipliers of a step are those at its end; where many
        constraints are active, multipliers that fit the conditions here may give a lower bound.
        """
        width = move * (self.upper - self.lower)
        down = np.minimum(width, self.x - self.lower)
        up = np.minimum(width, self.upper - self.x)
        slack = np.array(values, dtype=float)
        if bounded:
            slack[:bounded] -= np.max(slack[:bounded])
        slack = np.minimum(slack, 0.0)

        def gain(multipliers: Array) -> float:
            lagrangian = slope + multipliers @ slopes
            change = np.where(lagrangian > 0.0, lagrangian * down, -lagrangian * up)
            return float(np.sum(change) - multipliers @ slack)

        if len(values) < 2 or bounded:  # the multipliers of bounded functions have the sum one
            return gain(multipliers)
        free = np.minimum(down, up)
        conditions = np.vstack([(slopes * free).T, np.diag(slack)])
        fitted, _ = nnls(conditions, np.concatenate([-slope * free, np.zeros(len(slack))]))
        return min(gain(multipliers), gain(fitted))

    def _reach(self) -> Array:
        """The distance of both asymptotes from the present variables."""
        width = self.upper - self.lower
        if self.previous is None or self.reach is None or self.second_last is None:
            return FIRST * width
        agreement = (self.x - self.previous) * (self.previous - self.second_last)
        tighten = TIGHTEN if self.secants is None else 1.0
        factor = np.where(agreement > 0.0, WIDEN, np.where(agreement < 0.0, tighten, 1.0))
        return np.asarray(np.clip(factor * self.reach, LEAST * width, MOST * width))


@dataclass(frozen=True, eq=False)
class _Subproblem:
    """The separable convex problem of one step."""

    low: Array
    high: Array
    alpha: Array
    beta: Array
    x: Array  #: Point at which values and gradients are those of the original problem
    p: Array  #: Of the objective and each constraint, shape (1 + m, n)
    q: Array
    r: Array  #: (m,)
    bounded: int = 0  #: Number of the first constraints that are bounded by z instead of 0

    def solve(self) -> tuple[Array, Array]:
        """The minimiser and the multipliers, by Newton's method for the concave dual."""
        multipliers = np.zeros(len(self.r))
        x = self._minimiser(multipliers)
        if not len(multipliers):
            return x, multipliers
        dual, gradient = self._dual(multipliers, x)
        for _ in range(200):
            free = (multipliers > 0.0) | (gradient > 0.0)
            if np.max(np.abs(gradient[free]), initial=0.0) < 1e-12:
                break
            hessian = self._curvature(multipliers, x)[np.ix_(free, free)]
            # where all variables are at their bounds the dual is linear
            hessian += np.eye(len(hessian)) * (1e-12 * np.trace(hessian) + 1e-14)
            direction = np.zeros_like(multipliers)
            if self.bounded:
                direction[free] = _ascent(hessian, gradient[free], multipliers[free])
            else:
                direction[free] = np.linalg.solve(hessian, gradient[free])
            if gradient @ direction <= 1e-15 * max(1.0, abs(dual)):
                # the remaining gain is round-off of the dual, but not of its gradient
                multipliers = np.maximum(multipliers + direction, 0.0)
                return self._minimiser(multipliers), multipliers
            size = 1.0
            for _ in range(80):
                trial = np.maximum(multipliers + size * direction, 0.0)
                x_trial = self._minimiser(trial)
                value, slope = self._dual(trial, x_trial)
                gain = gradient @ (trial - multipliers)
                if value >= dual + 1e-4 * gain:
                    break
                # a gain below the round-off of the dual is seen by its gradient alone
                if gain < 1e-14 * max(1.0, abs(dual)):
                    if np.linalg.norm(slope[free]) < 0.5 * np.linalg.norm(gradient[free]):
                        break
                    return x, multipliers
                size *= 0.5
            else:
                break  # as exact as round-off allows
            multipliers, x, dual, gradient = trial, x_trial, value, slope
        return x, multipliers

    def _weighted(self, multipliers: Array) -> tuple[Array, Array]:
        """The coefficients p and q of the Lagrangian, shape (n,) each."""
        weights = np.concatenate([[1.0], multipliers])
        return weights @ self.p, weights @ self.q

    def _minimiser(self, multipliers: Array) -> Array:
        """The variables that minimise the Lagrangian."""
        p, q = map(np.sqrt, self._weighted(multipliers))
        total = p + q
        is_flat = total == 0.0
        x = (self.low * p + self.high * q) / np.where(is_flat, 1.0, total)
        return np.clip(np.where(is_flat, self.x, x), self.alpha, self.beta)

    def _dual(self, multipliers: Array, x: Array) -> tuple[float, Array]:
        """The dual function and its gradient."""
        values = self.p @ (1.0 / (self.high - x)) + self.q @ (1.0 / (x - self.low))
        relaxed = np.maximum(multipliers - PRICE, 0.0)
        constraints = self.r + values[1:]
        dual = values[0] + multipliers @ constraints - 0.5 * relaxed @ relaxed
        if self.bounded:
            excess = np.sum(multipliers[: self.bounded]) - 1.0
            dual -= 0.5 * excess**2 / WEAK
            constraints[: self.bounded] -= excess / WEAK
        return float(dual), constraints - relaxed

    def _curvature(self, multipliers: Array, x: Array) -> Array:
        """The negative second derivative of the dual function, shape (m, m)."""
        p, q = self._weighted(multipliers)
        above, below = self.high - x, x - self.low
        curvature = 2.0 * (p / above**3 + q / below**3)
        slopes = self.p[1:] / above**2 - self.q[1:] / below**2

        # how far the minimiser of the Lagrangian gives way to a slope: not at all at its bounds
        is_between = (x > self.alpha) & (x < self.beta)
        compliance = np.where(is_between, 1.0 / np.where(curvature > 0.0, curvature, 1.0), 0.0)

        hessian = (slopes * compliance) @ slopes.T + np.diag((multipliers > PRICE).astype(float))
        hessian[: self.bounded, : self.bounded] += 1.0 / WEAK
        return hessian


def _ascent(hessian: Array, gradient: Array, multipliers: Array) -> Array:
    """Newton's direction to the maximum of the dual's quadratic model over multipliers >= 0, (m,).

    The sum of the bounded functions' multipliers hardly changes, so cutting Newton's direction off
    where one multiplier reaches zero would spoil it for the others. With H = R^T R the maximum of
    the model minimises |R m - R^-T (g + H m_0)|.
    """
    root = np.linalg.cholesky(hessian).T
    target = np.linalg.solve(root.T, gradient + hessian @ multipliers)
    maximiser, _ = nnls(root, target)
    return np.asarray(maximiser - multipliers)
