# SPDX-License-Identifier: MIT
"""Names of the types of arrays, sums of arrays by name, and symmetric parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from operator import add
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]


def summed(a: Mapping, b: Mapping, plus: Callable[[Any, Any], Any] = add) -> dict[str, Any]:
    """The sums by name of two sets of values; a missing value is zero."""
    return {**a, **b, **{name: plus(a[name], b[name]) for name in a if name in b}}


def symmetric(matrices: Array) -> Array:
    """The symmetric part of a square matrix, or of several, shape (..., n, n)."""
    return np.asarray(0.5 * (matrices + np.swapaxes(matrices, -1, -2)))
