# SPDX-License-Identifier: MIT
"""Products of vectors and matrices of three, for the kernels; results go to other arrays."""

from __future__ import annotations

import numpy as np

from ..compilation import Matrix, Vector, kernel


@kernel
def cross(a: Vector, b: Vector, out: Vector) -> None:
    """Set out to a x b; it may not be one of them."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def add_multiple(x: Vector, factor: float, out: Vector) -> None:
    """Add factor times x to out, of any length."""
    # Unsigned bounds let the compiler vectorise, see integration/linear.py.
    for i in range(np.uintp(out.size)):
        out[i] += factor * x[i]


@kernel
def dot(a: Vector, b: Vector) -> float:
    """Scalar product of a and b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def turned(A: Matrix, x: Vector, out: Vector) -> None:
    """Set out to A x."""
    for k in range(3):
        out[k] = A[k, 0] * x[0] + A[k, 1] * x[1] + A[k, 2] * x[2]


@kernel
def turned_back(A: Matrix, x: Vector, out: Vector) -> None:
    """Set out to A^T x."""
    for k in range(3):
        out[k] = A[0, k] * x[0] + A[1, k] * x[1] + A[2, k] * x[2]


@kernel
def product(A: Matrix, B: Matrix, out: Matrix) -> None:
    """Set out to A B."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@kernel
def cross_matrix(x: Vector, out: Matrix) -> None:
    """Set out to the matrix of the cross product with x."""
    out[0, 0] = out[1, 1] = out[2, 2] = 0.0
    out[0, 1], out[0, 2], out[1, 2] = -x[2], x[1], -x[0]
    out[1, 0], out[2, 0], out[2, 1] = x[2], -x[1], x[0]


@kernel
def axial(Z: Matrix, out: Vector) -> None:
    """Set out to the vector of the antisymmetric part of Z."""
    out[0] = Z[2, 1] - Z[1, 2]
    out[1] = Z[0, 2] - Z[2, 0]
    out[2] = Z[1, 0] - Z[0, 1]


@kernel
def theta(Z: Matrix, out: Matrix) -> None:
    """Set out to tr(Z) 1 - Z."""
    trace = Z[0, 0] + Z[1, 1] + Z[2, 2]
    for i in range(3):
        for j in range(3):
            out[i, j] = -Z[i, j]
        out[i, i] += trace
