# SPDX-License-Identifier: MIT
"""Radial basis functions on scattered knots.

Each kernel states the least degree m of the polynomial that interpolation with it needs: -1 (none)
for positive definite kernels, 0 (a constant) for the multiquadric, 1 (linear) for the thin plate.
Then (-1)^(m + 1) g is conditionally positive definite of order m + 1; `ScatteredInterpolation`
brings the polynomial.

References:
    C. A. Micchelli, Interpolation of scattered data, Constructive Approximation 2 (1986),
    doi:10.1007/BF01893414.
    H. Wendland, Scattered Data Approximation, Cambridge University Press,
    doi:10.1017/CBO9780511617539.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import brentq
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree
from scipy.special import xlogy

from .. import validation
from ..arrays import Array


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
    """The kernel, or TypeError for anything else; ``what`` names the user in the message."""
    needed = "a radial basis function, as Wendland(...)"
    checked: Kernel = validation.implementation(
        f"{what}: the kernel", kernel, ("support", "minimal_degree", "__call__"), needed
    )
    return checked


@dataclass(frozen=True)
class Wendland(Kernel):
    """Wendland's compactly supported C2 function (1 - s)^4 (4 s + 1), s = r / radius.

    Positive definite in the plane and in space.

    Attributes:
        radius: Support [m]; two to four knot spacings are usual.
    """

    radius: float

    def __post_init__(self) -> None:
        validation.number("Wendland kernel: radius", self.radius, above=0.0, unit="m")

    @property
    def support(self) -> float:
        return self.radius

    def __call__(self, r: Array) -> Array:
        s = np.minimum(np.asarray(r) / self.radius, 1.0)
        return (1.0 - s) ** 4 * (4.0 * s + 1.0)


@dataclass(frozen=True)
class _Global(Kernel):
    """A kernel with a length and without an end."""

    length: float  #: Shape parameter [m], measured by the spacing of the knots

    def __post_init__(self) -> None:
        label = f"{type(self).__name__} kernel: length"
        validation.number(label, self.length, above=0.0, unit="m")


@dataclass(frozen=True)
class Multiquadric(_Global):
    """Hardy's global multiquadric sqrt(1 + (r / length)^2).

    Its matrix is dense, and ill-conditioned once the length exceeds a few knot spacings. The theory
    of its errors asks for a constant beside it; its matrix is nonsingular without (Micchelli 1986).
    About one knot spacing is a good length.

    Attributes:
        length: Shape parameter [m], measured by the spacing of the knots.
    """

    minimal_degree = 0

    def __call__(self, r: Array) -> Array:
        return np.sqrt(1.0 + (np.asarray(r) / self.length) ** 2)


@dataclass(frozen=True)
class ExponentialSpline(_Global):
    """The exponential spline exp(-r / length), a global kernel that decays.

    Positive definite in every dimension. It has a kink at its knot, where it is not differentiable:
    fields of it follow rough data without overshoot, and smooth data at a low order. A few knot
    spacings and more are a good length.

    Attributes:
        length: Shape parameter [m], measured by the spacing of the knots.
    """

    def __call__(self, r: Array) -> Array:
        return np.exp(-np.asarray(r) / self.length)


@dataclass(frozen=True)
class Gaussian(_Global):
    """The Gaussian exp(-(r / length)^2), a global kernel that decays.

    Positive definite in every dimension and infinitely smooth; its matrix is ill-conditioned once
    the length exceeds one or two knot spacings.

    Attributes:
        length: Shape parameter [m], measured by the spacing of the knots.
    """

    def __call__(self, r: Array) -> Array:
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
        distance = np.asarray(r)
        return distance * xlogy(distance, distance)


def neighbours(points: Array, knots: cKDTree, reach: float) -> NDArray[Any]:
    """Pairs of points (n, dimension) and knots within reach: numbers "i", "j", distance "v"."""
    pairs: NDArray[Any] = cKDTree(points).sparse_distance_matrix(
        knots, reach, output_type="ndarray"
    )
    return pairs


def kernel_matrix(kernel: Kernel, points: Array, knots: cKDTree) -> csr_matrix:
    """g(|X_i - X_j|) of points (n, dimension) and knots within the support, (n, knots)."""
    pairs = neighbours(points, knots, kernel.support)
    return csr_matrix((kernel(pairs["v"]), (pairs["i"], pairs["j"])), shape=(len(points), knots.n))


@cache
def _strip(d: int) -> tuple[Array, Array]:
    """Share of the kernel on one side of a line, in space a plane, over its distance in radii."""
    r = np.linspace(0.0, 1.0, 1001)
    table = Wendland(1.0)(np.hypot(r[:, None], r[None, :]))
    across = table @ np.where(r > 0.0, 2.0, 1.0) if d == 2 else table @ r
    r, across = np.r_[-r[:0:-1], r], np.r_[across[:0:-1], across]
    share = cumulative_trapezoid(across, r, initial=0.0)
    return r, share / share[-1]


def strip_width(middle: float, d: int) -> float:
    """The width of a strip of ones, in space a plate, in a normalised field of Wendland's kernel.

    It is enclosed by the value 1/2, in radii, if the field is ``middle`` in the middle.
    """
    r, share = _strip(d)

    def f(x: float, width: float) -> float:
        return float(np.diff(np.interp([x - 0.5 * width, x + 0.5 * width], r, share))[0])

    width = brentq(lambda w: f(0.0, w) - middle, 0.0, 2.0)
    return 2.0 * float(brentq(lambda x: f(x, width) - 0.5, 0.0, 1.0))


def strip_middle(width: float, d: int) -> float:
    """The inverse of `strip_width`."""
    return float(brentq(lambda middle: strip_width(middle, d) - width, 0.5001, 0.99))
