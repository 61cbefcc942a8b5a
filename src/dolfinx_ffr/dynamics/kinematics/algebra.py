# SPDX-License-Identifier: MIT
"""Products of small vectors and matrices for the kernels; results go to other arrays.

The first functions take vectors of the model's d components, the others vectors of three.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compilation import Matrix, Vector, kernel
from .arrays import Arrays


@kernel
def nothing(*_: Any) -> None:
    """Do nothing, where only the plane or only space has something to do."""


@kernel
def inner(model: Arrays, a: Vector, b: Vector) -> float:
    """Scalar product of a and b."""
    total = a[0] * b[0]
    for k in range(1, model.d):
        total += a[k] * b[k]
    return total


@kernel
def turned(model: Arrays, A: Matrix, x: Vector, out: Vector) -> None:
    """Set out to A x."""
    for k in range(model.d):
        total = A[k, 0] * x[0]
        for i in range(1, model.d):
            total += A[k, i] * x[i]
        out[k] = total


@kernel
def turned_back(model: Arrays, A: Matrix, x: Vector, out: Vector) -> None:
    """Set out to A^T x."""
    for k in range(model.d):
        total = A[0, k] * x[0]
        for i in range(1, model.d):
            total += A[i, k] * x[i]
        out[k] = total


@kernel
def add_multiple(x: Vector, factor: float, out: Vector) -> None:
    """Add factor times x to out, of any length."""
    # Unsigned bounds let the compiler vectorise, see integration/linear.py.
    for i in range(np.uintp(out.size)):
        out[i] += factor * x[i]


@kernel
def cross(a: Vector, b: Vector, out: Vector) -> None:
    """Set out to a x b; it may not be one of them."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def add_cross(a: Vector, b: Vector, factor: float, out: Vector) -> None:
    """Add factor times a x b to out."""
    out[0] += factor * (a[1] * b[2] - a[2] * b[1])
    out[1] += factor * (a[2] * b[0] - a[0] * b[2])
    out[2] += factor * (a[0] * b[1] - a[1] * b[0])


@kernel
def dot(a: Vector, b: Vector) -> float:
    """Scalar product of a and b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


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
