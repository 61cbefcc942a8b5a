# SPDX-License-Identifier: MIT
"""Dense linear systems of the size of a mechanism, factored once for solve and transpose.

Written as loops: for systems of 10 to 50 unknowns the call of a library routine costs more than
the factorisation itself.
"""

from __future__ import annotations

import numpy as np

from .arrays import Array, Integers, kernel

#: A pivot below this share of its row is taken for zero.
PIVOT_FLOOR = 1e-14


@kernel
def lu_factor(A: Array, n: int, pivot: Integers, scale: Array) -> bool:
    """LU factors in place with scaled partial pivoting; False where the matrix is singular."""
    for i in range(n):
        big = 0.0
        for j in range(n):
            big = max(big, abs(A[i, j]))
        if not big > 0.0:
            return False
        scale[i] = 1.0 / big
    # Unsigned bounds tell the compiler that no index counts from the end; it vectorises then.
    end = np.uintp(n)
    for k in range(n):
        best, p = 0.0, k
        for i in range(k, n):
            size = abs(A[i, k]) * scale[i]
            if size > best:
                best, p = size, i
        if not best > PIVOT_FLOOR:
            return False
        pivot[k] = p
        top = A[k]
        if p != k:
            other = A[p]
            for j in range(n):
                top[j], other[j] = other[j], top[j]
            scale[p] = scale[k]
        inverse = 1.0 / top[k]
        after = np.uintp(k + 1)
        for i in range(k + 1, n):
            row = A[i]
            factor = row[k]
            if factor != 0.0:
                factor *= inverse
                row[k] = factor
                for j in range(after, end):
                    row[j] -= factor * top[j]
    return True


@kernel
def lu_solve(A: Array, n: int, pivot: Integers, b: Array) -> None:
    """Solve A x = b in place."""
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
def lu_solve_transposed(A: Array, n: int, pivot: Integers, b: Array) -> None:
    """Solve A^T x = b in place with the factors of A."""
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
