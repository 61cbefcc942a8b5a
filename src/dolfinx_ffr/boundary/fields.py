# SPDX-License-Identifier: MIT
"""Fields in space, and points at which they have a level."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import Array

#: Values (n,) or gradients (n, 3) at points (n, 3)
Field = Callable[[Array], Array]


def contour(
    field: Field, low: Array, high: Array, spacing: float | Array, level: float = 0.0
) -> Array:
    """Points at which a field has a ``level``, (n, 3) [m], by a grid of at most a ``spacing``.

    The grid fills the box from ``low`` to ``high``, (3,) [m] each.
    """
    import pyvista  # takes a while

    # round-off of an exact number of intervals adds none
    counts = np.ceil((high - low) / spacing - 1e-9).astype(int) + 1
    grid_spacing = (high - low) / (counts - 1)
    nodes = low + grid_spacing * np.indices(counts).reshape(3, -1).T
    grid = pyvista.ImageData(dimensions=tuple(counts), origin=low, spacing=grid_spacing)
    # x varies fastest in pyvista, and slowest in the nodes
    values = np.asarray(field(nodes)).reshape(counts).ravel(order="F")
    return np.asarray(grid.contour([level], scalars=values).points, dtype=np.float64)
