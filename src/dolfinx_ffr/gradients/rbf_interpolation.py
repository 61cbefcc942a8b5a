# SPDX-License-Identifier: MIT
"""Interpolation of values at scattered points by radial basis functions and a polynomial.

    s(X) = sum_j alpha_j g(|X - X_j|) + sum_k beta_k p_k(X),      sum_j alpha_j p_k(X_j) = 0

takes the given values at the points X_j. The system is dense and factored once.

Leave-one-out errors need no refitting: with the system's matrix M and alpha found from all values,
the error at X_i of the interpolant through all other points is alpha_i / (M^-1)_ii.

Everything here is serial and acts on plain arrays; on ranks that hold the same arrays the results
are the same.

References:
    S. Rippa, Advances in Computational Mathematics 11 (1999), doi:10.1023/A:1018975909870.
    H. Wendland, Scattered Data Approximation, Cambridge University Press,
    doi:10.1017/CBO9780511617539.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import lapack
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from .. import validation
from ..design import Kernel, check_kernel

__all__ = ["IllConditionedWarning", "ScatteredInterpolation", "best_length"]

Array = NDArray[np.float64]

#: Condition number above which interpolation is stabilised, with a warning
LARGEST_CONDITION = 1e13
#: What is then added to the diagonal, in units of the matrix's norm
RIDGE = 1e-12
#: Entries of the largest dense matrix (4 GB)
LARGEST = 2**29
#: Entries of the arrays that one batch makes
BATCH = 2**22


class IllConditionedWarning(UserWarning):
    """The interpolation system is ill-conditioned, and a stabilised one is solved in its place."""


class ScatteredInterpolation:
    """Interpolation on fixed points, for any number of vectors of values.

    Where the condition number exceeds 1e13, an `IllConditionedWarning` says so, and a stabilised
    system is solved: 1e-12 of the matrix's norm is added to its diagonal. Values at the points are
    then met only approximately.

    Example:
        >>> import numpy as np
        >>> from dolfinx_ffr import ExponentialSpline, ScatteredInterpolation
        >>> points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
        >>> through = ScatteredInterpolation(points, ExponentialSpline(2.0), degree=1)
        >>> through(points @ [1.0, 2.0], [[0.5, 0.5]]).round(12)
        array([1.5])

    Args:
        points: Shape (n, 2) [m], all different.
        kernel: Radial basis function.
        degree: Of the polynomial, -1 for none; by default the least that the kernel needs. Exact
            for polynomials up to this degree.

    Raises:
        ValueError: If there are no points, two coincide, a coordinate is not finite, the points
            are too few for the polynomial or lie on a line (on a curve, for degree 2), the degree
            is below what the kernel needs, the kernel's support does not reach from point to
            point, or the dense matrix would not fit into memory.
    """

    def __init__(
        self,
        points: ArrayLike,
        kernel: Kernel,
        *,
        degree: int | None = None,
    ) -> None:
        self.points = _check_points(points)
        self.kernel = check_kernel("scattered interpolation", kernel)
        if degree is None:
            degree = kernel.minimal_degree
        self.degree = validation.integer("scattered interpolation: degree", degree, least=-1)
        n = len(self.points)
        # a multiquadric is nonsingular without its constant as well (Micchelli 1986)
        least = -1 if kernel.minimal_degree == 0 else kernel.minimal_degree
        if self.degree < least:
            raise ValueError(
                f"scattered interpolation: degree = {degree}, but {kernel!r} needs a polynomial of "
                f"degree {least} or more"
            )
        nearest = cKDTree(self.points).query(self.points, k=2)[0][:, 1] if n > 1 else np.ones(1)
        if nearest.min() <= 1e-12 * np.ptp(self.points, axis=0).max():
            raise ValueError(
                "scattered interpolation: two points coincide; remove one of them, or average"
            )
        if n > 1 and kernel.support <= nearest.max():
            raise ValueError(
                f"scattered interpolation: the support {kernel.support:.4g} m of {kernel!r} does "
                f"not reach from point to point ({nearest.max():.4g} m); take a larger radius"
            )
        terms = (self.degree + 1) * (self.degree + 2) // 2
        if n < terms:
            raise ValueError(
                f"scattered interpolation: {n} points are too few for a polynomial of degree "
                f"{self.degree} with {terms} coefficients"
            )
        polynomial = _polynomial(self.points, self.points, self.degree)
        if terms and np.linalg.matrix_rank(polynomial, tol=1e-10 * math.sqrt(n)) < terms:
            raise ValueError(
                f"scattered interpolation: the {n} points do not determine a polynomial of degree "
                f"{self.degree}: they lie on a {'line' if self.degree == 1 else 'curve'}; take a "
                "lower degree or other points"
            )
        if n**2 > LARGEST:
            raise ValueError(
                f"scattered interpolation: {n} points make a dense matrix of {8e-9 * n**2:.1f} GB; "
                "give fewer"
            )
        self._system = _System(self.points, kernel, self.degree)
        self.condition = self._system.condition  #: Condition number of the system in the 1-norm
        if not self.condition <= LARGEST_CONDITION:
            warnings.warn(
                f"interpolation of {n} points with {kernel!r} is ill-conditioned (condition number "
                f"{self.condition:.1e}), and a stabilised system is solved; shorten the kernel's "
                "length, or take ExponentialSpline or Wendland",
                IllConditionedWarning,
                stacklevel=2,
            )

    def __call__(self, values: ArrayLike, queries: ArrayLike) -> Array:
        """The interpolant of ``values`` at ``queries``.

        Args:
            values: At the points, shape (n,), or (n, m) for m fields.
            queries: Positions, shape (q, 2) [m].

        Returns:
            Shape (q,), or (q, m), in the unit of the values.

        Raises:
            ValueError: If there is not one finite value a point, or a query is not finite.
        """
        v = self._check_values(values)
        x = validation.real_array("scattered interpolation: queries", queries, (None, 2))
        fields = v.reshape(len(v), -1)
        found = np.empty((len(x), fields.shape[1]))
        solution = self._system.solve(fields)
        step = max(1, BATCH // len(v))
        for low in range(0, len(x), step):
            part = slice(low, low + step)
            found[part] = self._system.row(x[part]) @ solution
        return found.reshape(x.shape[:1] + v.shape[1:])

    def leave_one_out(self, values: ArrayLike) -> Array:
        """At each point, its value less the interpolant through all other points.

        The cost is that of one inverse.

        Args:
            values: At the points, shape (n,), or (n, m) for m fields.

        Returns:
            Errors, of the shape and unit of the values.

        Raises:
            ValueError: If there is not one finite value a point, or as many points as the
                polynomial has coefficients.
        """
        v = self._check_values(values)
        fields = v.reshape(len(v), -1)
        n = len(v)
        terms = (self.degree + 1) * (self.degree + 2) // 2
        if n <= max(terms, 1):
            raise ValueError(
                f"scattered interpolation: none of {n} points can be left out with a polynomial of "
                f"degree {self.degree}; give more points or a lower degree"
            )
        errors = self._system.solve(fields)[:n] / self._system.inverse_diagonal()[:, None]
        return errors.reshape(v.shape)

    def _check_values(self, values: ArrayLike) -> Array:
        n, shape = len(self.points), np.shape(values)
        expected = f"{n} values, one a point, or several of each in columns"
        wanted = (n, None) if len(shape) == 2 else (n,)
        what = "scattered interpolation: values"
        return validation.real_array(what, values, wanted, expected=expected)


def best_length(
    kernel: Callable[[float], Kernel],
    points: ArrayLike,
    values: ArrayLike,
    *,
    degree: int | None = None,
    bounds: tuple[float, float] | None = None,
) -> float:
    """The kernel's length for which the leave-one-out errors of ``values`` are smallest.

    Nine lengths over the bounds are compared, then the best is refined between its neighbors. A
    length at which the system is ill-conditioned is passed over. Each of about twenty lengths
    costs an inverse.

    Args:
        kernel: Class of the kernel, such as ``Gaussian``, or a function of its length [m].
        points: Shape (n, 2) [m].
        values: At the points, shape (n,), or (n, m) for m fields.
        degree: Of the polynomial, as in `ScatteredInterpolation`.
        bounds: Shortest and longest length [m]; by default from half the median distance of nearest
            points (for a compact kernel, from where it reaches from point to point) to the extent.

    Returns:
        The length [m].

    Raises:
        ValueError: As `ScatteredInterpolation`, if the bounds are not positive and in order, or if
            the system is ill-conditioned at every length.
    """
    x = _check_points(points)
    if len(x) < 3:
        raise ValueError(f"best length: {len(x)} points are too few to leave one out")
    validation.function("best length: kernel", kernel, "a length")
    if bounds is None:
        nearest = cKDTree(x).query(x, k=2)[0][:, 1]
        extent = float(np.max(np.ptp(x, axis=0)))
        low = 0.5 * float(np.median(nearest))
        if math.isfinite(kernel(extent).support):
            low = 1.001 * float(np.max(nearest))
        bounds = (low, max(extent, 2.0 * low))
    bounds = validation.plane_vector("best length: bounds", bounds)
    if not 0.0 < bounds[0] < bounds[1]:
        raise ValueError(f"best length: bounds {bounds} must be positive, finite and in order")

    def error(log_length: float) -> float:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", IllConditionedWarning)
            trial = ScatteredInterpolation(x, kernel(math.exp(log_length)), degree=degree)
            size = float(np.sqrt(np.mean(trial.leave_one_out(values) ** 2)))
        return size if trial.condition <= LARGEST_CONDITION else math.inf

    lengths = np.linspace(math.log(bounds[0]), math.log(bounds[1]), 9)
    errors = np.array([error(length) for length in lengths])
    if not np.any(np.isfinite(errors)):
        raise ValueError(
            f"best length: interpolation of {len(x)} points is ill-conditioned at every length "
            f"from {bounds[0]:.4g} m to {bounds[1]:.4g} m; allow shorter ones"
        )
    best = int(np.argmin(errors))
    # the search compares numbers, so that a length passed over counts as the worst of the others
    worst = float(np.max(errors[np.isfinite(errors)]))
    refined = minimize_scalar(
        lambda length: min(error(length), worst),
        bounds=(lengths[max(best - 1, 0)], lengths[min(best + 1, 8)]),
        method="bounded",
        options={"xatol": 0.05},
    )
    return math.exp(refined.x if refined.fun < errors[best] else lengths[best])


class _System:
    """The system of all points, factored, with the kernel scaled to a largest entry of one."""

    def __init__(self, points: Array, kernel: Kernel, degree: int) -> None:
        self.points, self.kernel, self.degree = points, kernel, degree
        n = len(points)
        block = kernel(cdist(points, points))
        self.scale = float(np.max(np.abs(block))) or 1.0
        block /= self.scale
        polynomial = _polynomial(points, points, degree)
        self._definite = polynomial.shape[1] == 0 and kernel.minimal_degree < 0
        matrix = block
        if polynomial.shape[1]:
            matrix = np.zeros((n + polynomial.shape[1],) * 2)
            matrix[:n, :n] = block
            matrix[:n, n:] = polynomial
            matrix[n:, :n] = polynomial.T
        norm = float(np.linalg.norm(matrix, 1))
        self.condition = self._factorise(matrix, norm)
        if not self.condition <= LARGEST_CONDITION:
            # of the sign in which the kernel is definite
            sign = (-1.0) ** (kernel.minimal_degree + 1)
            matrix[np.arange(n), np.arange(n)] += sign * RIDGE * norm
            self._factorise(matrix, norm)
        self._diagonal: Array | None = None

    def _factorise(self, matrix: Array, norm: float) -> float:
        """Factor the matrix and return its condition number, infinite where it is singular."""
        if self._definite:
            self._factor, info = lapack.dpotrf(matrix, lower=1)
            if info:
                return math.inf
            reciprocal = lapack.dpocon(self._factor, norm, uplo="L")[0]
        else:
            self._factor, self._pivots, info = lapack.dgetrf(matrix)
            if info:
                return math.inf
            reciprocal = lapack.dgecon(self._factor, norm)[0]
        return 1.0 / reciprocal if reciprocal > 0.0 else math.inf

    def solve(self, fields: Array) -> Array:
        """The coefficients of the kernel and of the polynomial, shape (n + terms, m)."""
        right = np.zeros((len(self._factor), fields.shape[1]))
        right[: len(fields)] = fields
        if self._definite:
            return scipy.linalg.cho_solve((self._factor, True), right)
        return scipy.linalg.lu_solve((self._factor, self._pivots), right)

    def inverse_diagonal(self) -> Array:
        """The diagonal of the inverse at the points, shape (n,)."""
        if self._diagonal is None:
            if self._definite:
                inverse = lapack.dpotri(self._factor, lower=1)[0]
            else:
                inverse = lapack.dgetri(self._factor, self._pivots)[0]
            self._diagonal = np.diag(inverse)[: len(self.points)].copy()
        return self._diagonal

    def row(self, x: Array) -> Array:
        """What the coefficients are multiplied by at positions x, shape (q, n + terms)."""
        block = self.kernel(cdist(x, self.points)) / self.scale
        polynomial = _polynomial(self.points, x, self.degree)
        return np.hstack([block, polynomial]) if polynomial.shape[1] else block


def _check_points(points: ArrayLike) -> Array:
    x = validation.real_array("scattered interpolation: points", points, (None, 2))
    if len(x) == 0:
        raise ValueError("scattered interpolation: there are no points")
    return np.ascontiguousarray(x)


def _polynomial(points: Array, x: Array, degree: int) -> Array:
    """The monomials at x (n, 2), scaled to the extent of points (k, 2); shape (n, terms)."""
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    half = 0.5 * float(np.max(high - low))
    s = (x - 0.5 * (low + high)) / (half if half > 0.0 else 1.0)
    powers = [(total - j, j) for total in range(degree + 1) for j in range(total + 1)]
    columns = [s[:, 0] ** i * s[:, 1] ** j for i, j in powers]
    return np.stack(columns, axis=1) if columns else np.zeros((len(x), 0))
