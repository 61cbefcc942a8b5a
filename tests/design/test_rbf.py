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
    strip_width,
)


def grid(n: int) -> np.ndarray:
    """A square of n x n knots, slightly irregular."""
    x, y = np.meshgrid(np.linspace(0.0, 1.0, n), np.linspace(0.0, 1.0, n), indexing="ij")
    wobble = 0.1 / n * np.sin(7.0 * x + 11.0 * y)
    return np.column_stack([(x + wobble).ravel(), (y - wobble).ravel()])


KERNELS = [Wendland(0.35), Multiquadric(0.1), ExponentialSpline(0.3), Gaussian(0.12)]


@pytest.mark.parametrize(
    ("kernel", "values"),
    [
        (Wendland(0.5), {0.0: 1.0, 0.25: 3.0 / 16.0, 0.5: 0.0, 0.7: 0.0}),
        (Multiquadric(2.0), {0.0: 1.0, 1.5: 1.25, 2.0: math.sqrt(2.0)}),
        (ExponentialSpline(2.0), {0.0: 1.0, 2.0: math.exp(-1), 6.0: math.exp(-3)}),
        (Gaussian(2.0), {0.0: 1.0, 2.0: math.exp(-1.0)}),
        (ThinPlate(), {0.0: 0.0, 1.0: 0.0, math.e: math.e**2, 0.5: 0.25 * math.log(0.5)}),
    ],
)
def test_kernels_are_as_written(kernel: Kernel, values: dict[float, float]) -> None:
    assert kernel(np.array(list(values))) == pytest.approx(list(values.values()))


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


@pytest.mark.parametrize("dimension", [2, 3])
def test_width_of_a_strip_in_the_field(dimension: int) -> None:
    """Beside the convolution of the kernel with a strip of 0.8 radii, on a grid."""
    r, beside = np.linspace(-1.0, 1.0, 2001), np.linspace(0.0, 1.0, 500)
    profile = Wendland(1.0)(np.hypot(r[:, None], beside)) @ beside ** (dimension - 2)
    places = np.linspace(0.0, 0.8, 801)
    field = np.array([np.sum(profile[np.abs(r - x) < 0.4]) for x in places]) / np.sum(profile)
    edge = np.interp(-0.5, -field, places)
    assert strip_width(field[0], dimension) == pytest.approx(2.0 * edge, rel=5e-3)
