# SPDX-License-Identifier: MIT
"""Fields of users, positive in material: their values, and where they are zero."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .. import validation
from ..arrays import Array, Integers
from ..fem import ShapeError
from .options import CURVES

#: Of positions (n, d) [m], gives (n,) numbers
Field = Callable[[Array], Array]


def evaluated(field: Field, points: Array) -> Array:
    """Values (n,) of a field of a user at points (n, d), or one clear error."""
    kind = "part" if points.shape[1] == 2 else "solid"
    values = np.empty(len(points))
    for first in range(0, len(points), CURVES.points_at_once):
        block = points[first : first + CURVES.points_at_once]
        of_block = validation.numbers(f"{kind}: what the field gives", field(block))
        if of_block.shape != (len(block),):
            raise ValueError(
                f"{kind}: the field gives an array of shape {of_block.shape} for {len(block)} "
                "points; it must give one number for each"
            )
        values[first : first + CURVES.points_at_once] = of_block
    bad = ~np.isfinite(values)
    if np.any(bad):
        position = ", ".join(f"{x:.6g}" for x in points[int(np.argmax(bad))])
        raise ValueError(
            f"{kind}: the field is NaN or infinite at {int(np.count_nonzero(bad))} points, the "
            f"first ({position}) m; it must be finite all over the body"
        )
    return values


def refuse_zero(kind: str, values: Array, cells: Integers) -> None:
    """Refuse values (points,) that are zero all over designed cells (cells, corners)."""
    if count := int(np.count_nonzero(np.all(values[cells] == 0.0, axis=1))):
        raise ShapeError(
            f"{kind}: the field is zero all over {count} of {len(cells)} cells of the lattice, "
            "which leaves open whether there is material; give a field that is positive in "
            "material and negative in void, as density - 0.5"
        )


def zeros_between(field: Field, a: Array, b: Array, at_a: Array, at_b: Array) -> Array:
    """How far from a to b, (n, d) each, the field is zero, as a share (n,) of the way.

    The method of Anderson and Bjoerck, BIT 13 (1973), doi:10.1007/BF01933951: regula falsi that
    shrinks the bracket from both sides. Without a change of sign it is the end nearer to zero.
    """
    # the zero is between the shares s and t, where the field is f and g; t is found last
    s, t = np.zeros(len(a)), np.ones(len(a))
    f, g = at_a.copy(), at_b.copy()
    zeros = np.where(np.abs(f) <= np.abs(g), s, t)
    active = np.flatnonzero(f * g < 0.0)
    size = np.maximum(np.abs(f), np.abs(g))
    for step in range(CURVES.zero_steps):
        if not len(active):
            break
        i = active
        u = t[i] - g[i] * (t[i] - s[i]) / (g[i] - f[i])
        if step % 4 == 3:  # some bisections bound the number of steps
            u = 0.5 * (s[i] + t[i])
        value = evaluated(field, a[i] + u[:, None] * (b[i] - a[i]))

        # an end that stays counts as nearer to zero than it is, so that the next u passes the zero
        crossed = value * g[i] < 0.0
        shrink = 1.0 - value / np.where(g[i] == 0.0, 1.0, g[i])
        shrink = np.where(shrink > 0.0, shrink, 0.5)
        s[i] = np.where(crossed, t[i], s[i])
        f[i] = np.where(crossed, g[i], f[i] * shrink)
        t[i], g[i] = u, value

        zeros[i] = u
        done = (np.abs(value) <= 1e-14 * size[i]) | (np.abs(t[i] - s[i]) < 1e-14)
        active = i[~done]
    return zeros
