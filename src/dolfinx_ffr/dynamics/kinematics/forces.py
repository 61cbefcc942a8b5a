# SPDX-License-Identifier: MIT
"""Springs, which are rows with a law, and loads on points and spins, with their transposes."""

from __future__ import annotations

from ..compilation import kernel
from ..equations import Equations
from .arrays import PLACE, SHIFT, Arrays, Work
from .rows import add_row_curvature, gradient_of_row, row_drift, row_pullback, row_rate
from .vectors import pull


@kernel
def evaluate_load(model: Arrays, work: Work, i: int, instant: int) -> None:
    """Load i in the global axes, work.loads."""
    out, table = work.loads[i], model.load_table[instant, i]
    if model.load_axes[i, 0] < 0:
        for k in range(model.d):
            out[k] = table[k]
        return
    for k in range(model.d):
        out[k] = 0.0
        for a in range(model.d):
            out[k] += table[a] * work.s[model.load_axes[i, a], k]


@kernel
def tension_of(model: Arrays, eq: Equations, work: Work, s: int, instant: int) -> float:
    """Force of spring s, its multiplier."""
    i = eq.value.size + s
    stretch = work.stretch[s] - model.drive[instant, i, 0]
    return model.law[s, 0] * stretch + model.law[s, 1] * row_rate(model, work, i)


@kernel
def add_forces(
    model: Arrays, eq: Equations, work: Work, instant: int, cv: float, tangent: bool
) -> None:
    """Add r of all springs and loads to eq.r, r_w + cv r_v to eq.M, and if asked for r_y to eq.Ky.

    Rotations count as dA = A [dth]. Vectors must have been placed.
    """
    rows, n, line, drift = eq.value.size, eq.r.size, work.line, work.drift
    for s in range(model.law.shape[0]):
        i, stiffness, damping = rows + s, model.law[s, 0], model.law[s, 1]
        work.tension[s] = tension_of(model, eq, work, s, instant)
        gradient_of_row(model, work, i, line)
        for p in range(n):
            eq.r[p] += work.tension[s] * line[p]
        for p in range(n):
            if line[p] != 0.0 and damping != 0.0:
                for q in range(n):
                    eq.M[p, q] += cv * damping * line[p] * line[q]
        if tangent:
            row_drift(model, eq, work, i, drift)
            for p in range(n):
                if line[p] != 0.0:
                    for q in range(n):
                        eq.Ky[p, q] += line[p] * (stiffness * line[q] + damping * drift[q])
            add_row_curvature(model, eq, work, i, work.tension[s])
    for i in range(model.load_vector.size):
        evaluate_load(model, work, i, instant)
        e, load = model.load_vector[i], work.loads[i]
        for k in range(model.d):
            work.u[k] = -load[k]
        pull(model, work, e, work.u, 0, eq.r)
        if tangent:
            for k in range(model.d):
                work.forces[e, k] -= load[k]
            if model.load_axes[i, 0] >= 0:
                add_follower(model, eq, work, i, instant)


@kernel
def add_follower(model: Arrays, eq: Equations, work: Work, i: int, instant: int) -> None:
    """Subtract the derivative of a load by its axes, which turn, from eq.Ky."""
    e = model.load_vector[i]
    p, L = model.first[model.vector_body[e]], work.L[e]
    size = model.rigid + model.modes[model.vector_body[e]]
    for a in range(model.d):
        f = model.load_axes[i, a]
        for j in range(size):
            for k in range(model.d):
                push_ = model.load_table[instant, i, a] * work.L[f, k, j]
                for q in range(size):
                    eq.Ky[p + q, p + j] -= L[k, q] * push_


@kernel
def forces_pullback(model: Arrays, eq: Equations, work: Work, instant: int) -> None:
    """Subtract the derivative of adjoint . r of all springs and loads from work.bars."""
    rows, bars = eq.value.size, work.bars
    for s in range(model.law.shape[0]):
        i, stiffness, damping = rows + s, model.law[s, 0], model.law[s, 1]
        gradient_of_row(model, work, i, work.line)
        along = 0.0
        for p in range(eq.r.size):
            along += work.line[p] * eq.adjoint[p]
        tension = tension_of(model, eq, work, s, instant)
        row_pullback(model, eq, work, i, tension, stiffness * along, damping * along, 0.0)
        work.drive_bars[instant, i, 0] += stiffness * along
        work.law_bars[s, 0] -= along * (work.stretch[s] - model.drive[instant, i, 0])
        work.law_bars[s, 1] -= along * row_rate(model, work, i)
    for i in range(model.load_vector.size):
        evaluate_load(model, work, i, instant)
        e = model.load_vector[i]
        for k in range(model.d):
            bars[e, SHIFT, k] += work.loads[i, k]
        if model.load_axes[i, 0] < 0:
            for k in range(model.d):
                work.load_table_bars[instant, i, k] += work.shift[e, k]
        else:
            for a in range(model.d):
                for k in range(model.d):
                    along = work.s[model.load_axes[i, a], k] * work.shift[e, k]
                    work.load_table_bars[instant, i, a] += along
                    bars[model.load_axes[i, a], PLACE, k] += (
                        model.load_table[instant, i, a] * work.shift[e, k]
                    )
