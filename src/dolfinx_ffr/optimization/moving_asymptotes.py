# SPDX-License-Identifier: MIT
"""The method of moving asymptotes: one step from values and gradients to the next variables.

    min over x of f_0(x)   such that   f_i(x) <= 0,   lower <= x <= upper.

Each function is replaced by r_i + sum_j p_ij / (U_j - x_j) + q_ij / (x_j - L_j), which has its
value and gradient at the present variables. The asymptotes L and U draw near where a variable
swings, and move away where it keeps on. The separable convex problem is solved by its dual, which
has one variable for each constraint.

The largest of several functions is minimised by bounding them,

    min over x, z of f_0(x) + z   such that   f_i(x) <= z for some i,   f_i(x) <= 0 for the others,

in which z has neither bounds nor asymptotes: the subproblem is minimised over it exactly, with a
quadratic term so weak that it only makes the dual smooth.

A constraint that cannot be met is relaxed at a price (the "elastic" variables of the paper), so
that each step is defined, and leads towards the feasible side.

Each approximation of the paper is monotone in each variable, and a function that is not (a density
is a load and a strength at once) lets it swing. The difference of two gradients gives the second
derivative by each variable along the last step; where it is larger than that of the approximation,
both p and q grow until it is met (Bruyneel, Duysinx and Fleury).

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

#: Distance of the asymptotes in shares of the range: at first, at least, at most
FIRST, LEAST, MOST = 0.5, 0.01, 10.0
#: Factors of that distance where a variable keeps its direction, and where it turns round
WIDEN, TIGHTEN = 1.2, 0.7
#: Share of the distance to an asymptote that a step leaves
MARGIN = 0.1
#: Curvature where there is no slope, in units of the mean slope
CURVATURE = 1e-5
#: Multiplier beyond which a constraint is relaxed rather than met; slopes of log psi are about one
PRICE = 1e3
#: Of the quadratic term of the bound z: it changes the multipliers, whose sum is one, by as much as
#: this times the change of z, which is that of a logarithm
WEAK = 1e-2
#: Share of the largest change of a variable from which on its change tells a second derivative;
#: less is near round-off. Of a hanging bar 0 and 1e-3 take 26 and 23 iterations, 0.1 takes 55.
CHANGED = 1e-3
#: Share of a second derivative that stays where the next is smaller: what the other variables do to
#: a slope may hide it for a step. With 0 a hanging bar ends 6 % above its optimum and a spinning
#: one takes 44 iterations in the place of 20; with 0.9 they take 37 and 27 instead of 23 and 20.
MEMORY = 0.5


@dataclass(frozen=True, eq=False)
class Secants:
    """Second derivatives of the functions by each variable, from the gradients of two points."""

    x: Array  #: The later point, shape (n,)
    gradients: Array  #: Of the objective and the constraints there, shape (1 + m, n)
    curvature: Array  #: Second derivatives by each variable, shape (1 + m, n); 0 where unknown

    @classmethod
    def begin(cls, x: Array, gradients: Array) -> Secants:
        """The first point, where nothing is known of second derivatives."""
        return cls(x, gradients, np.zeros_like(gradients))

    def next(self, x: Array, gradients: Array, same: Mask | bool = True) -> Secants:
        """The secants that end at another point.

        ``same`` (1 + m,) tells which functions are those of the point before; of the others nothing
        is known.
        """
        if gradients.shape != self.gradients.shape:
            return Secants.begin(x, gradients)
        change = x - self.x
        largest = np.max(np.abs(change))
        if largest == 0.0:  # a step was taken back
            return self
        changed = np.abs(change) > CHANGED * largest
        quotients = (gradients - self.gradients) / np.where(changed, change, 1.0)
        curvature = np.maximum(quotients, MEMORY * self.curvature)
        curvature = np.where(changed, curvature, self.curvature)
        known = np.broadcast_to(same, len(gradients))
        return Secants(x, gradients, np.where(known[:, None], curvature, 0.0))


@dataclass(frozen=True, eq=False)
class Asymptotes:
    """Present variables with what the next step needs; it is not changed by a step."""

    lower: Array
    upper: Array
    x: Array
    move: float = 0.1
    before: Array | None = None  #: Variables one step earlier, shape (n,)
    earlier: Array | None = None  #: Two steps earlier, shape (n,)
    reach: Array | None = None  #: Distance of both asymptotes from ``before``, shape (n,)
    secants: Secants | None = None  #: Where the functions are the same from step to step

    def step(
        self, slope: Array, values: Array, slopes: Array, bounded: int = 0
    ) -> tuple[Asymptotes, Array]:
        """The state at the next variables, and the multipliers of the constraints, shape (m,).

        ``slope`` (n,) is the gradient of the objective, of any scale: multipliers share it.
        ``values`` (m,) are the f_i, ``slopes`` (m, n) their gradients. The first ``bounded`` of
        them, of the size of one, are bounded by z, which is minimised beside the objective.
        """
        x, width = self.x, self.upper - self.lower
        reach = self._reach()
        low, high = x - reach, x + reach
        alpha = np.maximum(self.lower, np.maximum(low + MARGIN * reach, x - self.move * width))
        beta = np.minimum(self.upper, np.minimum(high - MARGIN * reach, x + self.move * width))
        gradients = np.vstack([slope[None, :], slopes.reshape(len(values), len(x))])
        typical = np.mean(np.abs(gradients), axis=1, keepdims=True)
        bent = 0.001 * np.abs(gradients) + CURVATURE * typical
        if self.secants is not None:
            # p + q = reach^2 (|slope| + 2 bent), and the second derivative is 2 (p + q) / reach^3
            curvature = self.secants.curvature
            bent = np.maximum(bent, 0.25 * curvature * reach - 0.5 * np.abs(gradients))
        p = reach**2 * (np.maximum(gradients, 0.0) + bent)
        q = reach**2 * (np.maximum(-gradients, 0.0) + bent)
        r = values - np.sum((p[1:] + q[1:]) / reach, axis=1)
        if bounded:  # z from its present value, the largest of the functions
            r[:bounded] -= np.max(values[:bounded])
        found, multipliers = _Subproblem(low, high, alpha, beta, x, p, q, r, bounded).solve()
        return replace(self, x=found, before=x, earlier=self.before, reach=reach), multipliers

    def retreat(self, kept: Asymptotes) -> Asymptotes:
        """The state ``kept`` from which this one was reached, with half its reach."""
        assert self.reach is not None
        # at the next step, before and earlier alike, the reach stays as it is set here
        kept = replace(
            kept,
            before=kept.x,
            earlier=kept.x,
            reach=(0.5 if self.secants is None else 1.0) * self.reach,
        )
        return replace(kept, move=0.5 * kept.move)

    def possible_gain(
        self,
        slope: Array,
        values: Array,
        slopes: Array,
        multipliers: Array,
        move: float,
        bounded: int = 0,
    ) -> float:
        """How far the objective can fall at most, to first order, by a change of ``move``.

        The change is in shares of the range, and the constraints are linearised. The other
        arguments are those of `step` and the ``multipliers`` that it has returned. By duality of
        linear programs the number is an upper bound for any multipliers, and zero where the
        first-order conditions hold with them. Those of the step are the ones where it ends; where
        many constraints are active, those that fit the conditions best here give a lower number.
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

        if len(values) < 2 or bounded:  # what shares a bound has multipliers whose sum is one
            return gain(multipliers)
        free = np.minimum(down, up)
        conditions = np.vstack([(slopes * free).T, np.diag(slack)])
        fitted, _ = nnls(conditions, np.concatenate([-slope * free, np.zeros(len(slack))]))
        return min(gain(multipliers), gain(fitted))

    def _reach(self) -> Array:
        """The distance of both asymptotes from the present variables."""
        width = self.upper - self.lower
        if self.before is None or self.reach is None or self.earlier is None:
            return FIRST * width
        swing = (self.x - self.before) * (self.before - self.earlier)
        factor = np.where(
            swing > 0.0, WIDEN, np.where(swing < 0.0, TIGHTEN if self.secants is None else 1.0, 1.0)
        )
        return np.asarray(np.clip(factor * self.reach, LEAST * width, MOST * width))


@dataclass(frozen=True, eq=False)
class _Subproblem:
    """The separable convex problem of one step."""

    low: Array
    high: Array
    alpha: Array
    beta: Array
    x: Array  #: Where it touches the original one
    p: Array  #: Of the objective and each constraint, shape (1 + m, n)
    q: Array
    r: Array  #: (m,)
    bounded: int = 0  #: How many of the constraints, the first ones, are bounded by z instead of 0

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
                # what is left to gain is round-off of the dual, but not of its gradient
                multipliers = np.maximum(multipliers + direction, 0.0)
                return self._minimiser(multipliers), multipliers
            size = 1.0
            for _ in range(80):
                trial = np.maximum(multipliers + size * direction, 0.0)
                found = self._minimiser(trial)
                value, slope = self._dual(trial, found)
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
            multipliers, x, dual, gradient = trial, found, value, slope
        return x, multipliers

    def _weighted(self, multipliers: Array) -> tuple[Array, Array]:
        weights = np.concatenate([[1.0], multipliers])
        return weights @ self.p, weights @ self.q

    def _minimiser(self, multipliers: Array) -> Array:
        """The variables that minimise the Lagrangian."""
        p, q = (np.sqrt(part) for part in self._weighted(multipliers))
        both = p + q
        flat = both == 0.0
        x = (self.low * p + self.high * q) / np.where(flat, 1.0, both)
        return np.clip(np.where(flat, self.x, x), self.alpha, self.beta)

    def _dual(self, multipliers: Array, x: Array) -> tuple[float, Array]:
        """The dual function and its gradient."""
        values = self.p @ (1.0 / (self.high - x)) + self.q @ (1.0 / (x - self.low))
        relaxed = np.maximum(multipliers - PRICE, 0.0)
        constraints = self.r + values[1:]
        dual = values[0] + multipliers @ constraints - 0.5 * relaxed @ relaxed
        if self.bounded:
            rest = np.sum(multipliers[: self.bounded]) - 1.0
            dual -= 0.5 * rest**2 / WEAK
            constraints[: self.bounded] -= rest / WEAK
        return float(dual), constraints - relaxed

    def _curvature(self, multipliers: Array, x: Array) -> Array:
        """The negative second derivative of the dual function, shape (m, m)."""
        p, q = self._weighted(multipliers)
        above, below = self.high - x, x - self.low
        moving = (x > self.alpha) & (x < self.beta)
        curvature = 2.0 * (p / above**3 + q / below**3)
        slopes = self.p[1:] / above**2 - self.q[1:] / below**2
        compliance = np.where(moving, 1.0 / np.where(curvature > 0.0, curvature, 1.0), 0.0)
        found = (slopes * compliance) @ slopes.T + np.diag((multipliers > PRICE).astype(float))
        found[: self.bounded, : self.bounded] += 1.0 / WEAK
        return found


def _ascent(hessian: Array, gradient: Array, multipliers: Array) -> Array:
    """Newton's direction to the maximum of the dual's quadratic model over multipliers >= 0, (m,).

    The sum of the bounded functions' multipliers hardly changes, so that cutting Newton's direction
    off where one multiplier reaches zero would spoil it for the others. With H = R^T R the model
    is at its maximum where |R m - R^-T (g + H m_0)| is smallest.
    """
    root = np.linalg.cholesky(hessian).T
    aim = np.linalg.solve(root.T, gradient + hessian @ multipliers)
    found, _ = nnls(root, aim)
    return np.asarray(found - multipliers)
