# SPDX-License-Identifier: MIT
"""Radial basis functions: closed forms, interpolation, transposes, bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.sparse

from dolfinx_ffr.design.rbf import (
    ExponentialSpline,
    Gaussian,
    Kernel,
    Multiquadric,
    RadialBasis,
    ThinPlate,
    Wendland,
)
from dolfinx_ffr.verification import convergence_order

EPS = np.finfo(float).eps


def grid(n: int) -> np.ndarray:
    """A square of n x n knots, slightly irregular."""
    x, y = np.meshgrid(np.linspace(0.0, 1.0, n), np.linspace(0.0, 1.0, n), indexing="ij")
    wobble = 0.1 / n * np.sin(7.0 * x + 11.0 * y)
    return np.column_stack([(x + wobble).ravel(), (y - wobble).ravel()])


KERNELS = [Wendland(0.35), Multiquadric(0.1), ExponentialSpline(0.3), Gaussian(0.12)]


def test_wendland_is_twice_differentiable_where_it_ends() -> None:
    """Near the edge of its support the function falls like the fourth power of the distance."""
    kernel = Wendland(0.5)
    assert kernel(np.array([0.0, 0.25, 0.5, 0.7])) == pytest.approx([1.0, 3.0 / 16.0, 0.0, 0.0])
    gaps = np.array([0.04, 0.02, 0.01])
    assert convergence_order(gaps, kernel(0.5 - gaps)) == pytest.approx(4.0, abs=0.1)
    # flat at the knot: no kink there
    assert convergence_order(gaps, 1.0 - kernel(gaps)) == pytest.approx(2.0, abs=0.2)


def test_multiquadric_is_hardys() -> None:
    kernel = Multiquadric(2.0)
    assert kernel(np.array([0.0, 1.5, 2.0])) == pytest.approx([1.0, 1.25, math.sqrt(2.0)])
    assert math.isinf(kernel.support)


def test_exponential_spline_has_a_kink_at_its_knot() -> None:
    """It falls linearly there, with slope -1 / length."""
    kernel = ExponentialSpline(2.0)
    assert kernel(np.array([0.0, 2.0, 6.0])) == pytest.approx([1.0, math.exp(-1), math.exp(-3)])
    gaps = np.array([0.04, 0.02, 0.01])
    assert convergence_order(gaps, 1.0 - kernel(gaps)) == pytest.approx(1.0, abs=0.02)
    assert (kernel(gaps[-1:]) - 1.0) / gaps[-1] == pytest.approx(-0.5, rel=0.01)


def test_gaussian_and_thin_plate_are_as_written() -> None:
    assert Gaussian(2.0)(np.array([0.0, 2.0])) == pytest.approx([1.0, math.exp(-1.0)])
    expected = [0.0, 0.0, math.e**2, 0.25 * math.log(0.5)]
    assert ThinPlate()(np.array([0.0, 1.0, math.e, 0.5])) == pytest.approx(expected)


@pytest.mark.parametrize("kernel", [*KERNELS, ThinPlate()], ids=repr)
def test_kernels_are_definite_beside_polynomials_of_their_degree(kernel: Kernel) -> None:
    """(-1)^(m + 1) g is positive definite on what is orthogonal to polynomials of degree m."""
    x = grid(7)
    degree = kernel.minimal_degree
    matrix = kernel(np.linalg.norm(x[:, None, :] - x[None, :, :], axis=2))
    polynomials = np.column_stack([np.ones(len(x)), x])[:, : {-1: 0, 0: 1, 1: 3}[degree]]
    rest = np.linalg.qr(polynomials, mode="complete")[0][:, polynomials.shape[1] :]
    eigenvalues = np.linalg.eigvalsh((-1.0) ** (degree + 1) * rest.T @ matrix @ rest)
    assert eigenvalues.min() > 1e-10 * eigenvalues.max()
    if degree >= 0:  # and not without them
        assert np.linalg.eigvalsh((-1.0) ** (degree + 1) * matrix).min() < 0.0


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
def test_matrix_holds_the_kernel_of_all_distances(kernel: Kernel) -> None:
    basis = RadialBasis(grid(9), kernel)
    points = np.random.default_rng(0).uniform(-0.2, 1.2, (40, 2))
    distance = np.linalg.norm(points[:, None, :] - basis.knots[None, :, :], axis=2)
    matrix = basis.matrix(points)
    assert scipy.sparse.issparse(matrix) == math.isfinite(kernel.support)
    dense = matrix.toarray() if isinstance(matrix, scipy.sparse.csr_matrix) else matrix
    assert np.max(np.abs(dense - kernel(distance))) < 20 * EPS


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
def test_interpolation_reproduces_the_values_at_the_knots(kernel: Kernel) -> None:
    basis = RadialBasis(grid(11), kernel)
    values = np.random.default_rng(1).standard_normal(len(basis.knots))
    coefficients = basis.interpolate(values)
    assert basis.matrix(basis.knots) @ coefficients == pytest.approx(values, abs=1e-10)


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
def test_interpolation_recovers_a_field_of_the_basis(kernel: Kernel) -> None:
    """Also between the knots, where only the right coefficients give the right values."""
    basis = RadialBasis(grid(8), kernel)
    true = np.random.default_rng(2).standard_normal(len(basis.knots))
    points = np.random.default_rng(3).uniform(0.0, 1.0, (30, 2))
    found = basis.interpolate(basis.matrix(basis.knots) @ true)
    assert basis.matrix(points) @ found == pytest.approx(basis.matrix(points) @ true, abs=1e-8)


def test_interpolation_converges_with_the_knots() -> None:
    """With a fixed radius a smooth field is met with order 3 or better.

    That is twice the order 3/2 of the fields in the native space of Wendland's C2 function.
    """
    points = np.random.default_rng(4).uniform(0.2, 0.8, (200, 2))

    def smooth(x: np.ndarray) -> np.ndarray:
        return np.sin(3.0 * x[:, 0]) * np.cos(2.0 * x[:, 1])

    counts = [9, 17, 33]
    errors = []
    for n in counts:
        basis = RadialBasis(grid(n), Wendland(0.5))
        field = basis.matrix(points) @ basis.interpolate(smooth(basis.knots))
        errors.append(np.max(np.abs(field - smooth(points))))
    assert convergence_order([1.0 / (n - 1) for n in counts], errors) > 2.9
    assert errors[-1] < 1e-4


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
def test_interpolate_transposed_is_the_transpose(kernel: Kernel) -> None:
    basis = RadialBasis(grid(10), kernel)
    rng = np.random.default_rng(5)
    u, v = rng.standard_normal((2, len(basis.knots)))
    left, right = basis.interpolate(u) @ v, u @ basis.interpolate_transposed(v)
    assert left == pytest.approx(right, rel=1e-9)


@pytest.mark.parametrize("kernel", [Wendland, Multiquadric, ExponentialSpline, Gaussian])
@pytest.mark.parametrize("length", [0.0, -1.0, math.nan, math.inf])
def test_kernel_lengths_are_checked(kernel: type, length: float) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        kernel(length)


@pytest.mark.parametrize(
    ("knots", "kernel", "message"),
    [
        (np.zeros((0, 2)), Wendland(1.0), "no knots"),
        (np.array([[0.0, np.nan], [1.0, 0.0]]), Wendland(2.0), "NaN or infinite"),
        (np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0]]), Wendland(2.0), "two knots coincide"),
        (grid(5), Wendland(0.1), "does not reach from knot to knot"),
        (grid(12), Multiquadric(5.0), "ill-conditioned"),
        (grid(5), ThinPlate(), r"ThinPlate\(\) needs a polynomial of degree 1"),
    ],
)
def test_bad_knots_are_refused(knots: np.ndarray, kernel: Kernel, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RadialBasis(knots, kernel)


def test_bad_values_are_refused() -> None:
    basis = RadialBasis(grid(4), Wendland(0.8))
    with pytest.raises(ValueError, match="expected 16 finite values"):
        basis.interpolate(np.ones(15))
    with pytest.raises(ValueError, match="with NaN or infinity"):
        basis.interpolate(np.full(16, np.nan))
