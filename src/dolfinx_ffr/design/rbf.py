# SPDX-License-Identifier: MIT
"""Radial basis functions on scattered knots.

A field is s(X) = sum_j alpha_j g(|X - X_j|) with knots X_j that know nothing of a mesh. Compactly
supported kernels give sparse matrices and suit many knots; global kernels give dense ones.

Each kernel states the least degree m of the polynomial that interpolation with it needs: -1 (none)
for positive definite kernels, 0 (a constant) for the multiquadric, 1 (linear) for the thin plate.
Then (-1)^(m + 1) g is conditionally positive definite of order m + 1. `RadialBasis` has no
polynomial part; `ScatteredInterpolation` has.

References:
    C. A. Micchelli, Interpolation of scattered data, Constructive Approximation 2 (1986),
    doi:10.1007/BF01893414.
    H. Wendland, Scattered Data Approximation, Cambridge University Press,
    doi:10.1017/CBO9780511617539.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.special import xlogy

from .. import validation

__all__ = [
    "ExponentialSpline",
    "Gaussian",
    "Kernel",
    "Multiquadric",
    "RadialBasis",
    "ThinPlate",
    "Wendland",
]

Array = NDArray[np.float64]


class Kernel(Protocol):
    """A function g(r) of the distance from a knot."""

    @property
    def support(self) -> float:
        """Distance beyond which the kernel vanishes [m]; infinite for a global kernel."""
        return math.inf

    @property
    def minimal_degree(self) -> int:
        """Least degree of the polynomial beside the kernel; -1 if none is needed."""
        return -1

    def __call__(self, r: Array) -> Array:
        """G at distances ``r`` [m]."""
        ...


def check_kernel(what: str, kernel: object) -> Kernel:
    """The kernel, or refuse what is none.

    Args:
        what: Who asks, for the message.
        kernel: What is given for it.

    Raises:
        TypeError: If it is no kernel.
    """
    needed = "a radial basis function, as Wendland(...)"
    found: Kernel = validation.provider(
        f"{what}: the kernel", kernel, ("support", "minimal_degree", "__call__"), needed
    )
    return found


@dataclass(frozen=True)
class Wendland(Kernel):
    """Wendland's compactly supported C2 function (1 - s)^4 (4 s + 1), s = r / radius.

    Positive definite in the plane and in space.

    Args:
        radius: Support [m]; two to four knot spacings are usual.
    """

    radius: float

    def __post_init__(self) -> None:
        """Check the radius."""
        validation.number("Wendland kernel: radius", self.radius, above=0.0, unit="m")

    @property
    def support(self) -> float:
        """The radius [m]."""
        return self.radius

    def __call__(self, r: Array) -> Array:
        """G at distances ``r`` [m]."""
        s = np.minimum(np.asarray(r) / self.radius, 1.0)
        return (1.0 - s) ** 4 * (4.0 * s + 1.0)


@dataclass(frozen=True)
class _Global(Kernel):
    """What kernels with a length and without an end have in common."""

    length: float

    def __post_init__(self) -> None:
        """Check the length."""
        what = f"{type(self).__name__} kernel: length"
        validation.number(what, self.length, above=0.0, unit="m")


@dataclass(frozen=True)
class Multiquadric(_Global):
    """Hardy's global multiquadric sqrt(1 + (r / length)^2).

    Its matrix is dense, and ill-conditioned once the length exceeds a few knot spacings. The theory
    of its errors asks for a constant beside it; its matrix is nonsingular without (Micchelli 1986).

    Args:
        length: Shape parameter [m]; about one knot spacing.
    """

    minimal_degree = 0

    def __call__(self, r: Array) -> Array:
        """G at distances ``r`` [m]."""
        return np.sqrt(1.0 + (np.asarray(r) / self.length) ** 2)


@dataclass(frozen=True)
class ExponentialSpline(_Global):
    """The exponential spline exp(-r / length), a global kernel that decays.

    Positive definite in every dimension. It has a kink at its knot, where it is not differentiable:
    fields of it follow rough data without overshoot, and smooth data at a low order.

    Args:
        length: Distance over which the kernel falls to 1/e [m]; a few knot spacings and more.
    """

    def __call__(self, r: Array) -> Array:
        """G at distances ``r`` [m]."""
        return np.exp(-np.asarray(r) / self.length)


@dataclass(frozen=True)
class Gaussian(_Global):
    """The Gaussian exp(-(r / length)^2), a global kernel that decays.

    Positive definite in every dimension and infinitely smooth; its matrix is ill-conditioned once
    the length exceeds one or two knot spacings.

    Args:
        length: Shape parameter [m]; about one knot spacing.
    """

    def __call__(self, r: Array) -> Array:
        """G at distances ``r`` [m]."""
        return np.exp(-((np.asarray(r) / self.length) ** 2))


@dataclass(frozen=True)
class ThinPlate(Kernel):
    """The thin-plate spline r^2 log r, a global kernel without a shape parameter.

    Conditionally positive definite of order 2: it needs a linear polynomial beside it. With that,
    the interpolant is the one of least bending energy, and does not depend on the unit of length
    (J. Duchon, doi:10.1007/BFb0086566).
    """

    minimal_degree = 1

    def __call__(self, r: Array) -> Array:
        """G at distances ``r`` [m]."""
        distance = np.asarray(r)
        return distance * xlogy(distance, distance)


def finite_vector(values: ArrayLike, size: int, where: str, what: str) -> Array:
    """``values`` as finite numbers, shape (size,).

    Args:
        values: What is checked.
        size: How many there must be.
        where: Who asks.
        what: Their name, for the message.

    Raises:
        ValueError: If there are more or fewer, or one is not finite.
    """
    vector = validation.numbers(f"{where}: {what}", values)
    finite = bool(np.all(np.isfinite(vector)))
    if vector.shape != (size,) or not finite:
        raise ValueError(
            f"{where}: expected {size} finite {what}, and got an array of shape {vector.shape}"
            + ("" if finite else " with NaN or infinity")
        )
    return vector


class RadialBasis:
    """A kernel on knots, with the factored interpolation matrix.

    Args:
        knots: Shape (knots, d) [m], all different.
        kernel: Function of the distance.

    Raises:
        ValueError: If there are no knots, two coincide, a coordinate is not finite, the kernel
            needs a linear polynomial beside it, its support does not reach the next knot, or the
            interpolation is ill-conditioned.
    """

    def __init__(self, knots: ArrayLike, kernel: Kernel) -> None:
        self.knots = np.ascontiguousarray(validation.numbers("radial basis: knots", knots))
        self.kernel = check_kernel("radial basis", kernel)
        if kernel.minimal_degree > 0:
            raise ValueError(
                f"radial basis: {kernel!r} needs a polynomial of degree {kernel.minimal_degree} "
                "beside it, which this basis does not have; take Wendland, Multiquadric, "
                "ExponentialSpline or Gaussian"
            )
        if self.knots.ndim != 2 or len(self.knots) == 0:
            raise ValueError(f"radial basis: no knots (array of shape {self.knots.shape})")
        if not np.all(np.isfinite(self.knots)):
            raise ValueError("radial basis: a knot has a coordinate that is NaN or infinite")
        self._tree = cKDTree(self.knots)
        if len(self.knots) > 1:
            nearest = self._tree.query(self.knots, k=2)[0][:, 1]
            if nearest.min() == 0.0:
                raise ValueError("radial basis: two knots coincide; remove one of them")
            if kernel.support <= nearest.max():
                raise ValueError(
                    f"radial basis: the kernel's support {kernel.support:.4g} m does not reach "
                    f"from knot to knot ({nearest.max():.4g} m); take a larger radius or more knots"
                )
        matrix = self.matrix(self.knots)
        self._solve = _factored(matrix)
        probe = np.cos(np.arange(len(self.knots)))
        defect = np.max(np.abs(matrix @ self.interpolate(probe) - probe))
        if not defect < 1e-8:
            raise ValueError(
                f"radial basis: interpolation on {len(self.knots)} knots is ill-conditioned "
                f"(values reproduced to {defect:.1e} only); shorten the kernel's length"
            )

    def __reduce__(self) -> tuple[type[RadialBasis], tuple[Array, Kernel]]:
        """How pickle and copy make it anew, with the factor."""
        return type(self), (self.knots, self.kernel)

    def matrix(self, points: ArrayLike) -> Array | scipy.sparse.csr_matrix:
        """g(|X_i - X_j|) for points X_i and knots X_j, shape (points, knots).

        Args:
            points: Shape (points, d) [m].

        Returns:
            Sparse for compactly supported kernels, dense for global ones.
        """
        x = np.asarray(points, dtype=np.float64).reshape(-1, self.knots.shape[1])
        if math.isinf(self.kernel.support):
            return self.kernel(cdist(x, self.knots))
        near = cKDTree(x).sparse_distance_matrix(
            self._tree, self.kernel.support, output_type="ndarray"
        )
        return scipy.sparse.csr_matrix(
            (self.kernel(near["v"]), (near["i"], near["j"])), shape=(len(x), len(self.knots))
        )

    def interpolate(self, values: ArrayLike) -> Array:
        """The coefficients alpha for which the field takes ``values`` (knots,) at the knots.

        Raises:
            ValueError: If there is not one finite value a knot.
        """
        v = finite_vector(values, len(self.knots), "radial basis", "values, one a knot")
        return self._solve(v, False)

    def interpolate_transposed(self, coefficients_bar: ArrayLike) -> Array:
        """The transpose of `interpolate` on ``coefficients_bar``, shape (knots,)."""
        return self._solve(np.asarray(coefficients_bar, dtype=np.float64), True)


def _factored(matrix: Array | scipy.sparse.csr_matrix) -> Callable[[Array, bool], Array]:
    """The solution for a right-hand side, with the matrix or with its transpose."""
    if isinstance(matrix, np.ndarray):
        factor = scipy.linalg.lu_factor(matrix)
        return lambda v, transposed: scipy.linalg.lu_solve(factor, v, trans=int(transposed))
    # symmetric and positive definite: a symmetric ordering, and no pivoting to spoil it
    solver = scipy.sparse.linalg.splu(
        matrix.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return lambda v, transposed: solver.solve(v, trans="T" if transposed else "N")
