# SPDX-License-Identifier: MIT
"""Static equilibrium of a mechanism under gravity and the forces at the start, and its transpose.

The coordinates and multipliers solve

    f(y, lam) = r(y, 0, 0) + C_y(y)^T lam = 0,      C(y, 0) = 0

by Newton's method, with the mass matrix M times a shift mu added to f_y: mu is the least that makes
the reduced stiffness positive and the step bounded, and zero in the end. The steps lead downhill,
and close to the equilibrium the convergence is quadratic (J. Nocedal, S. J. Wright, Numerical
Optimization, 2nd ed., Springer 2006, section 4.3, doi:10.1007/978-0-387-40065-5).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ..arrays import Array, symmetric
from .kinematics import Kinematics, equations_pullback
from .model import FlatModel, without


@dataclass(frozen=True)
class EquilibriumOptions:
    """Options of the search for an equilibrium."""

    most_iterations: int = 300
    longest_step: float = 0.3  #: Longest step, in parts of the mechanism's size and in radians.
    last_step: float = 1e-12  #: A step of this share of the mechanism's size is the last.
    #: Squared frequencies below this share of the largest stiffness over mass mean that nothing
    #: resists a motion.
    neutral: float = 1e-13
    #: Share of the largest singular value below which a row of the joints counts as redundant.
    redundant: float = 1e-10
    #: Least shift, in parts of the squared rate at which the forces would set the bodies moving.
    least_shift: float = 1e-9


OPTIONS = EquilibriumOptions()


class NoEquilibriumError(ValueError):
    """No static equilibrium was found, whether there is one or not."""


def static_equilibrium(model: FlatModel, y: Array, length: float) -> tuple[Array, Array]:
    """Coordinates in equilibrium (size,) and unwrapped angles (see :meth:`Kinematics.turns`).

    The search begins at y (size,), with steps in parts of the length of the bodies [m]. A
    ValueError says that the mechanism still moves freely there.
    """
    arrays, n = without(model.arrays, 1, "alpha", "beta"), model.size
    kinematics = Kinematics(arrays)
    y, lam = y.copy(), np.zeros(model.rows)
    # Angles count as the arc at the mechanism's size.
    size = np.where(model.rotations, length, 1.0)
    residual, C, M, K = _evaluate(kinematics, y, lam)
    lam = _multipliers(C, M, residual[:n])
    step, converged = np.zeros(n), False
    for _ in range(OPTIONS.most_iterations):
        residual, C, M, K = _evaluate(kinematics, y, lam)
        frequencies, shapes = free_vibrations(C, M, K)
        neutral = _neutral(M, K)
        force = residual[:n] - C.T @ lam
        pull = float(np.max(np.abs(size * force / np.diag(M))[model.rigid])) / length
        least = max(neutral, OPTIONS.least_shift * pull)
        shift = 0.0
        if frequencies.size and frequencies[0] <= neutral:
            shift = max(-1.2 * frequencies[0], least)
        while True:
            rhs = -np.concatenate([force, residual[n : n + model.rows]])
            solution = _solve(K + shift * M, C, M, rhs)
            step = solution[:n]
            longest = float(np.max(np.abs(size * step)[model.rigid])) / length
            if longest <= OPTIONS.longest_step or least == 0.0 or not np.isfinite(longest):
                break
            shift = max(4.0 * shift, least)
        y, lam = arrays.retract(y, y + step), solution[n:]
        small = OPTIONS.last_step * length * np.sqrt(np.sum(arrays.mass))
        if abs(float(step @ M @ step)) < small**2:
            converged = shift == 0.0
            break
    residual, C, M, K = _evaluate(kinematics, y, lam)
    frequencies, shapes = free_vibrations(C, M, K)
    if frequencies.size and abs(frequencies[0]) <= _neutral(M, K):
        name = _moving_body(model, M, shapes[:, 0])
        raise ValueError(
            f"the mechanism has no unique static equilibrium: body {name!r} can move without "
            "resistance; hold it by a joint, a drive or a spring, or start with Assembled()"
        )
    if not converged:
        name = _moving_body(model, M, step)
        raise NoEquilibriumError(
            f"no static equilibrium under gravity and the forces at t = 0 found: body {name!r} "
            f"still moves after {OPTIONS.most_iterations} iterations; hold the mechanism by a "
            "joint, a drive or a spring, or start with Assembled()"
        )
    return y, kinematics.turns(1)


def equilibrium_pullback(model: FlatModel, y: Array, y_bar: Array, markers: Array) -> Array:
    """Transpose of :func:`static_equilibrium` at its result y; adds to the bars of the markers.

    Gives the adjoint x of the forces, shape (size,): the derivative with respect to an integral is
    minus x . dr at this position.
    """
    arrays, n = without(model.arrays, 1, "alpha", "beta"), model.size
    kinematics = Kinematics(arrays)

    # the stiffness K depends on the multipliers, which balance the forces at y
    residual, C, M, _ = _evaluate(kinematics, y, np.zeros(model.rows))
    lam = _multipliers(C, M, residual[:n])
    _, C, M, K = _evaluate(kinematics, y, lam)

    # the adjoints x of the forces and m2 of the constraints, as `equations_pullback` names them
    solution = _solve(K.T, C, M, np.concatenate([y_bar, np.zeros(model.rows)]))
    x, m2 = solution[:n].copy(), solution[n:].copy()
    adjoints = x, m2, np.zeros(model.rows)
    equations_pullback(kinematics, (y, np.zeros(n), lam), adjoints, forces=True)
    markers += kinematics.marker_bars
    return x


def _evaluate(kinematics: Kinematics, y: Array, lam: Array) -> tuple[Array, Array, Array, Array]:
    """Residuals at rest, constraint Jacobian, mass matrix, derivative of the forces.

    Angles are unwrapped from the previous evaluation; the next one overwrites the matrices.
    """
    zeros = np.zeros(y.size)
    residual, C, M, K = kinematics.evaluated(0, y, zeros, zeros, lam)
    kinematics.begin(y)
    return residual, C, M, K


def _units(C: Array, M: Array) -> tuple[Array, Array]:
    """Units of coordinates by mass, and of multipliers by their rows, see set_units."""
    unit = 1.0 / np.sqrt(np.diag(M))
    reach = np.max(np.abs(C * unit), axis=1, initial=np.finfo(float).tiny)
    return unit, 1.0 / reach


def _multipliers(C: Array, M: Array, force: Array) -> Array:
    """Multipliers that balance a force best in the mass norm."""
    unit, unit_of_row = _units(C, M)
    matrix = unit[:, None] * C.T * unit_of_row
    return unit_of_row * np.linalg.lstsq(matrix, -unit * force, rcond=None)[0]


def _solve(K: Array, C: Array, M: Array, rhs: Array) -> Array:
    """Solution with the matrix [[K, C^T], [C, 0]], scaled; if it is singular, the shortest."""
    unit, unit_of_row = _units(C, M)
    # The largest squared frequency makes the stiffness a number, like the constraints.
    rate = math.sqrt(float(np.max(np.abs(unit[:, None] * K * unit)))) or 1.0
    units = np.concatenate([unit / rate, unit_of_row * rate])
    matrix = np.block([[K, C.T], [C, np.zeros((len(C), len(C)))]])
    in_units = units[:, None] * matrix * units

    # then the largest entry of each row comes near one
    largest = np.max(np.abs(in_units), axis=1)
    row_scale = 1.0 / np.sqrt(np.maximum(largest, np.finfo(float).tiny))
    scaled = row_scale[:, None] * in_units * row_scale

    scale = row_scale * units
    try:
        solution = np.linalg.solve(scaled, scale * rhs)
    except np.linalg.LinAlgError:
        solution = np.linalg.lstsq(scaled, scale * rhs, rcond=1e-14)[0]
    return scale * solution


def free_vibrations(C: Array, M: Array, K: Array) -> tuple[Array, Array]:
    """Squared frequencies of the motions that the joints leave, and these motions."""
    scale, scale_of_row = _units(C, M)
    free = np.diag(scale)
    if C.shape[0]:
        rows = scale_of_row[:, None] * C * scale
        free = scale[:, None] * scipy.linalg.null_space(rows, rcond=OPTIONS.redundant)
    if free.shape[1] == 0:
        return np.zeros(0), free
    stiffness, mass = free.T @ K @ free, free.T @ M @ free
    values, vectors = scipy.linalg.eigh(symmetric(stiffness), symmetric(mass))
    return values, free @ vectors


def _neutral(M: Array, K: Array) -> float:
    """Squared frequency below which a motion counts as free of resistance [1/s^2]."""
    scale = 1.0 / np.sqrt(np.diag(M))
    return OPTIONS.neutral * float(np.max(np.abs(scale[:, None] * K * scale)))


def _moving_body(model: FlatModel, M: Array, step: Array) -> str:
    """Name of the body that moves the most."""
    columns = [model.coordinates(name).all for name in model.bodies]
    return list(model.bodies)[int(np.argmax([step[w] @ M[w, w] @ step[w] for w in columns]))]
