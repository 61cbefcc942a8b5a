# SPDX-License-Identifier: MIT
"""Dense linear systems of the size of a mechanism, factored once for solve and transpose.

Written as loops: for systems of 10 to 50 unknowns the call of a library routine costs more than
the factorisation itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compilation import IntVector, Matrix, Vector, kernel

#: A pivot below this share of its row is taken for zero, each entry times the unit of its column.
PIVOT_FLOOR = 1e-14


class LinearSystem(NamedTuple):
    """A matrix, or its factors in the same place, and a right-hand side that becomes a solution."""

    A: Matrix  # (size, size)
    rhs: Vector  # (size,)
    scale: Vector  # (size,) of the rows
    unit: Vector  # (size,) what counts as one of each unknown, to compare metres with radians
    pivot: IntVector  # (size,)


def linear_system(size: int) -> LinearSystem:
    """A system of zeros with a number of unknowns."""
    rhs, scale, unit = (np.zeros(size) for _ in range(3))
    return LinearSystem(np.zeros((size, size)), rhs, scale, unit, np.zeros(size, dtype=np.int64))


@kernel
def lu_factor(system: LinearSystem, n: int) -> bool:
    """LU factors of the leading n rows in place, with scaled partial pivoting.

    False where the matrix is singular. With units of the unknowns in system.unit, pivots and this
    verdict do not depend on those in which the entries are given.
    """
    A, scale, unit = system.A, system.scale, system.unit
    for i in range(n):
        big = 0.0
        for j in range(n):
            big = max(big, abs(A[i, j] * unit[j]))
        if not big > 0.0:
            return False
        scale[i] = 1.0 / big
    # Two pivots at a time: the rest of the matrix is gone through half as often.
    for k in range(0, n - 1, 2):
        if not take_pivot(system, k, n):
            return False
        inverse = 1.0 / A[k, k]
        for i in range(k + 1, n):
            A[i, k] *= inverse
            A[i, k + 1] -= A[i, k] * A[k, k + 1]
        if not take_pivot(system, k + 1, n):
            return False
        first, second, inverse = A[k], A[k + 1], 1.0 / A[k + 1, k + 1]
        # Unsigned bounds tell the compiler that no index counts from the end; it vectorises then.
        after, end = np.uintp(k + 2), np.uintp(n)
        factor = second[k]
        for j in range(after, end):
            second[j] -= factor * first[j]
        for i in range(k + 2, n):
            row = A[i]
            row[k + 1] *= inverse
            f, g = row[k], row[k + 1]
            if f != 0.0 or g != 0.0:
                for j in range(after, end):
                    row[j] = (row[j] - f * first[j]) - g * second[j]
    return n % 2 == 0 or take_pivot(system, n - 1, n)


@kernel
def take_pivot(system: LinearSystem, k: int, n: int) -> bool:
    """Exchange rows so that the pivot of column k is in row k; False where there is none."""
    A, scale = system.A, system.scale
    best, p = 0.0, k
    for i in range(k, n):
        size = abs(A[i, k]) * scale[i]
        if size > best:
            best, p = size, i
    if not best * system.unit[k] > PIVOT_FLOOR:
        return False
    system.pivot[k] = p
    if p != k:
        top, other = A[k], A[p]
        for j in range(n):
            top[j], other[j] = other[j], top[j]
        scale[p] = scale[k]
    return True


@kernel
def lu_solve(system: LinearSystem, n: int) -> None:
    """Solve A x = rhs in place."""
    A, pivot, b = system.A, system.pivot, system.rhs
    for k in range(n):
        p = pivot[k]
        b[k], b[p] = b[p], b[k]
    for i in range(n):
        total = b[i]
        for j in range(i):
            total -= A[i, j] * b[j]
        b[i] = total
    for i in range(n - 1, -1, -1):
        total = b[i]
        for j in range(i + 1, n):
            total -= A[i, j] * b[j]
        b[i] = total / A[i, i]


@kernel
def lu_solve_transposed(system: LinearSystem, n: int) -> None:
    """Solve A^T x = rhs in place with the factors of A."""
    A, pivot, b = system.A, system.pivot, system.rhs
    for i in range(n):
        b[i] /= A[i, i]
        for j in range(i + 1, n):
            b[j] -= A[i, j] * b[i]
    for i in range(n - 1, -1, -1):
        for j in range(i):
            b[j] -= A[i, j] * b[i]
    for k in range(n - 1, -1, -1):
        p = pivot[k]
        b[k], b[p] = b[p], b[k]
