# SPDX-License-Identifier: MIT
"""Interpolation of values at scattered points by radial basis functions and a polynomial.

    s(X) = sum_j alpha_j g(|X - X_j|) + sum_k beta_k p_k(X),      sum_j alpha_j p_k(X_j) = 0

takes given values at the points X_j. Leave-one-out errors need no refitting: with the system's
matrix M and alpha of all values, the error at X_i of the interpolant through all other points is
alpha_i / (M^-1)_ii.

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
from numpy.typing import ArrayLike
from scipy.linalg import lapack
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from .. import validation
from ..arrays import Array
from ..design import Kernel, check_kernel

#: Condition number above which interpolation is stabilised, with a warning
LARGEST_CONDITION = 1e13
#: Part of the matrix's norm that is added to the diagonal to stabilise it
RIDGE = 1e-12
#: Largest number of entries of the dense matrix, 4 GB
MOST_ENTRIES = 2**29
#: Number of entries of an array that is evaluated at once, 32 MB
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
        >>> from dolfinx_ffr import ExponentialSpline
        >>> from dolfinx_ffr.paper import ScatteredInterpolation
        >>> points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
        >>> through = ScatteredInterpolation(points, ExponentialSpline(2.0), degree=1)
        >>> through(points @ [1.0, 2.0], [[0.5, 0.5]]).round(12)
        array([1.5])

    Args:
        points: Shape (n, 2) [m], all different.
        kernel: Radial basis function.
        degree: Degree of the polynomial, -1 for none; by default the least that the kernel needs.
            Exact for polynomials up to this degree.

    Raises:
        ValueError: If points are missing, coincide or are not finite, are too few for the
            polynomial or on a line (for degree 2 on a curve), the kernel needs a higher degree or
            does not reach from point to point, or the dense matrix would not fit into memory.
    """

    def __init__(self, points: ArrayLike, kernel: Kernel, *, degree: int | None = None) -> None:
        self.points = _check_points(points)
        self.kernel = check_kernel("scattered interpolation", kernel)
        degree = kernel.minimal_degree if degree is None else degree
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
        self._terms = terms = (self.degree + 1) * (self.degree + 2) // 2
        if n < terms:
            raise ValueError(
                f"scattered interpolation: {n} points are too few for a polynomial of degree "
                f"{self.degree} with {terms} coefficients"
            )
        polynomial = self._monomials(self.points)
        if terms and np.linalg.matrix_rank(polynomial, tol=1e-10 * math.sqrt(n)) < terms:
            raise ValueError(
                f"scattered interpolation: the {n} points do not determine a polynomial of degree "
                f"{self.degree}: they lie on a {'line' if self.degree == 1 else 'curve'}; take a "
                "lower degree or other points"
            )
        if n**2 > MOST_ENTRIES:
            raise ValueError(
                f"scattered interpolation: {n} points make a dense matrix of {8e-9 * n**2:.1f} GB; "
                "give fewer"
            )
        self._diagonal: Array | None = None  # of the inverse
        self.condition = self._factor_system()  #: Condition number of the system in the 1-norm
        if not self.condition <= LARGEST_CONDITION:
            warnings.warn(
                f"interpolation of {n} points with {kernel!r} is ill-conditioned (condition number "
                f"{self.condition:.1e}), and a stabilised system is solved; shorten the kernel's "
                "length, or take ExponentialSpline or Wendland",
                IllConditionedWarning,
                stacklevel=2,
            )

    def __call__(self, values: ArrayLike, queries: ArrayLike) -> Array:
        """Interpolate ``values`` (n,) or (n, m) at ``queries`` (q, 2) [m]; (q,) or (q, m)."""
        v = self._check_values(values)
        x = validation.real_array("scattered interpolation: queries", queries, (None, 2))
        fields = v.reshape(len(v), -1)
        interpolated = np.empty((len(x), fields.shape[1]))
        solution = self._solve(fields)
        step = max(1, BATCH // len(v))
        for low in range(0, len(x), step):
            batch = slice(low, low + step)
            kernels = self.kernel(cdist(x[batch], self.points)) / self._scale
            interpolated[batch] = np.hstack([kernels, self._monomials(x[batch])]) @ solution
        return interpolated.reshape(x.shape[:1] + v.shape[1:])

    def leave_one_out(self, values: ArrayLike) -> Array:
        """At each point, its value less the interpolant through all other points.

        For ``values`` (n,) or (n, m), of the same shape. It costs one inverse.
        """
        v = self._check_values(values)
        fields, n = v.reshape(len(v), -1), len(v)
        if n <= max(self._terms, 1):
            raise ValueError(
                f"scattered interpolation: none of {n} points can be left out with a polynomial of "
                f"degree {self.degree}; give more points or a lower degree"
            )
        if self._diagonal is None:
            inverse = lapack.dgetri(*self._factor)[0]
            self._diagonal = np.diag(inverse)[:n].copy()
        return (self._solve(fields)[:n] / self._diagonal[:, None]).reshape(v.shape)

    def _check_values(self, values: ArrayLike) -> Array:
        n = len(self.points)
        expected = f"{n} values, one a point, or several of each in columns"
        shape = (n, None) if np.ndim(values) == 2 else (n,)
        label = "scattered interpolation: values"
        return validation.real_array(label, values, shape, expected=expected)

    def _factor_system(self) -> float:
        """Factor the system, stabilised if it is ill-conditioned; return its condition number.

        It is scaled to a largest entry of one.
        """
        n = len(self.points)
        matrix = np.zeros((n + self._terms,) * 2)
        matrix[:n, :n] = self.kernel(cdist(self.points, self.points))
        self._scale = float(np.max(np.abs(matrix))) or 1.0
        matrix /= self._scale
        matrix[:n, n:] = self._monomials(self.points)
        matrix[n:, :n] = matrix[:n, n:].T
        norm = float(np.linalg.norm(matrix, 1))
        condition = self._factorise(matrix, norm)
        if not condition <= LARGEST_CONDITION:
            # of the sign in which the kernel is definite
            sign = (-1.0) ** (self.kernel.minimal_degree + 1)
            matrix[np.arange(n), np.arange(n)] += sign * RIDGE * norm
            self._factorise(matrix, norm)
        return condition

    def _factorise(self, matrix: Array, norm: float) -> float:
        """Factor the matrix; return its condition number, which is infinite if it is singular."""
        *self._factor, info = lapack.dgetrf(matrix)
        reciprocal = 0.0 if info else lapack.dgecon(self._factor[0], norm)[0]
        return 1.0 / reciprocal if reciprocal > 0.0 else math.inf

    def _solve(self, fields: Array) -> Array:
        """The coefficients of the kernel and of the polynomial, shape (n + terms, m)."""
        right = np.vstack([fields, np.zeros((self._terms, fields.shape[1]))])
        return scipy.linalg.lu_solve(self._factor, right)

    def _monomials(self, x: Array) -> Array:
        """The monomials at x (q, 2), scaled to the extent of the points, shape (q, terms)."""
        low, high = np.min(self.points, axis=0), np.max(self.points, axis=0)
        half = 0.5 * float(np.max(high - low))
        s = (x - 0.5 * (low + high)) / (half if half > 0.0 else 1.0)
        powers = [(total - j, j) for total in range(self.degree + 1) for j in range(total + 1)]
        columns = [s[:, 0] ** i * s[:, 1] ** j for i, j in powers]
        return np.stack(columns, axis=1) if columns else np.zeros((len(x), 0))


def best_length(
    kernel: Callable[[float], Kernel],
    points: ArrayLike,
    values: ArrayLike,
    *,
    degree: int | None = None,
    bounds: tuple[float, float] | None = None,
) -> float:
    """The kernel's length [m] for which the leave-one-out errors of ``values`` are smallest.

    Nine lengths over the bounds are compared, then the best is refined between its neighbors;
    ill-conditioned ones are passed over. Each of about twenty lengths costs an inverse.

    Args:
        kernel: Class of the kernel, such as ``Gaussian``, or a function of its length [m].
        points: Shape (n, 2) [m].
        values: At the points, shape (n,), or (n, m) for m fields.
        degree: Degree of the polynomial, as in `ScatteredInterpolation`.
        bounds: Shortest and longest length [m]; by default from half the median distance of nearest
            points (for a compact kernel, from where it reaches from point to point) to the extent.

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
    ends = validation.real_array("best length: bounds", bounds, (2,), expected="two components")
    bounds = tuple(ends.tolist())
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
    # the search compares numbers, so an ill-conditioned length counts as the worst of the others
    worst = float(np.max(errors[np.isfinite(errors)]))
    refined = minimize_scalar(
        lambda length: min(error(length), worst),
        bounds=(lengths[max(best - 1, 0)], lengths[min(best + 1, 8)]),
        method="bounded",
        options={"xatol": 0.05},
    )
    return math.exp(refined.x if refined.fun < errors[best] else lengths[best])


def _check_points(points: ArrayLike) -> Array:
    x = validation.real_array("scattered interpolation: points", points, (None, 2))
    if len(x) == 0:
        raise ValueError("scattered interpolation: there are no points")
    return np.ascontiguousarray(x)
