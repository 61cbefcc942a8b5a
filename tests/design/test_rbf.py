# SPDX-License-Identifier: MIT
"""Radial basis functions: closed forms, definiteness, bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dolfinx_ffr.design.rbf import (
    ExponentialSpline,
    Gaussian,
    Kernel,
    Multiquadric,
    ThinPlate,
    Wendland,
)
from dolfinx_ffr.verification import convergence_order


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


@pytest.mark.parametrize("kernel", [Wendland, Multiquadric, ExponentialSpline, Gaussian])
@pytest.mark.parametrize("length", [0.0, -1.0, math.nan, math.inf])
def test_kernel_lengths_are_checked(kernel: type, length: float) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        kernel(length)
