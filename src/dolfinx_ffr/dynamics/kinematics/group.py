# SPDX-License-Identifier: MIT
"""Rotations by their vectors: exponential map, its derivative, composition.

The rotation of a body is A = exp([a]) exp([u]) with coordinates a + u, a those at the beginning of
a step, so that u is the vector of a short rotation and coordinates add up within a step. For
variations dth in the body's axes, dA = A [dth],

    dth = T(u) du,     T(u) = 1 - (1 - cos t)/t^2 [u] + (t - sin t)/t^3 [u]^2,     t = |u|.

Between steps the vector of the composed rotation takes the place of a (A. Iserles, H. Z.
Munthe-Kaas, S. P. Nørsett, A. Zanna, Lie-group methods, Acta Numerica 9 (2000),
doi:10.1017/S0962492900002154). Its length may exceed a turn: of the vectors of one rotation it is
the one closest to a + u, which it is where the axis stays.
"""

from __future__ import annotations

import math

from ..compilation import Matrix, Vector, kernel

#: Square of an angle below which series take the place of quotients.
_SERIES = 1e-4


@kernel
def coefficients(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Sin t / t, (1 - cos t) / t^2 and (t - sin t) / t^3 of the length t of a vector."""
    q = x * x + y * y + z * z
    if q < _SERIES:
        a = 1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0))
        b = 0.5 - q / 24.0 * (1.0 - q / 30.0 * (1.0 - q / 56.0))
        c = 1.0 / 6.0 - q / 120.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0))
        return a, b, c
    t = math.sqrt(q)
    half = math.sin(0.5 * t)
    a = math.sin(t) / t
    return a, 2.0 * half * half / q, (1.0 - a) / q


@kernel
def squared(x: float, y: float, z: float, first: float, second: float, out: Matrix) -> None:
    """Set out to 1 + first [u] + second [u]^2 with u = (x, y, z)."""
    q = x * x + y * y + z * z
    out[0, 0] = 1.0 + second * (x * x - q)
    out[1, 1] = 1.0 + second * (y * y - q)
    out[2, 2] = 1.0 + second * (z * z - q)
    out[0, 1], out[1, 0] = second * x * y - first * z, second * x * y + first * z
    out[0, 2], out[2, 0] = second * x * z + first * y, second * x * z - first * y
    out[1, 2], out[2, 1] = second * y * z - first * x, second * y * z + first * x


@kernel
def exponential(x: float, y: float, z: float, out: Matrix) -> None:
    """Set out to the matrix of the rotation by a vector."""
    a, b, _ = coefficients(x, y, z)
    squared(x, y, z, a, b, out)


@kernel
def tangent(x: float, y: float, z: float, out: Matrix) -> None:
    """Set out to T."""
    _, b, c = coefficients(x, y, z)
    squared(x, y, z, -b, c, out)


@kernel
def inverse_tangent(x: float, y: float, z: float, out: Matrix) -> None:
    """Set out to the inverse of T."""
    q = x * x + y * y + z * z
    if q < _SERIES:
        second = 1.0 / 12.0 + q / 720.0 * (1.0 + q / 42.0)
    else:
        a, b, _ = coefficients(x, y, z)
        second = (1.0 - 0.5 * a / b) / q
    squared(x, y, z, 0.5, second, out)


@kernel
def quaternion(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Quaternion of the rotation by a vector, the scalar first."""
    h, _, _ = coefficients(0.5 * x, 0.5 * y, 0.5 * z)
    t = math.sqrt(x * x + y * y + z * z)
    return math.cos(0.5 * t), 0.5 * h * x, 0.5 * h * y, 0.5 * h * z


@kernel
def composed(
    a: float, b: float, c: float, x: float, y: float, z: float
) -> tuple[float, float, float, float]:
    """Quaternion of exp(a, b, c) exp(x, y, z), with a scalar that is not negative."""
    p, px, py, pz = quaternion(a, b, c)
    q, qx, qy, qz = quaternion(x, y, z)
    s = p * q - px * qx - py * qy - pz * qz
    u = p * qx + q * px + py * qz - pz * qy
    v = p * qy + q * py + pz * qx - px * qz
    w = p * qz + q * pz + px * qy - py * qx
    if s < 0.0:
        return -s, -u, -v, -w
    return s, u, v, w


@kernel
def rotation_between(
    a: float, b: float, c: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Shortest vector u with exp(a, b, c) exp(u) = exp(x, y, z)."""
    s, u, v, w = composed(-a, -b, -c, x, y, z)
    length = math.sqrt(u * u + v * v + w * w)
    factor = 2.0 * math.atan2(length, s) / length if length > 0.0 else 2.0
    return factor * u, factor * v, factor * w


@kernel
def compose(y: Vector, base: Vector, i: int) -> None:
    """Replace y[i:i+3] by the vector of the rotation that it and base[i:i+3] stand for."""
    a, b, c, x, p, q = base[i], base[i + 1], base[i + 2], y[i], y[i + 1], y[i + 2]
    s, u, v, w = composed(a, b, c, x - a, p - b, q - c)
    length = math.sqrt(u * u + v * v + w * w)
    if not length > 0.0:
        # Full turns, if any, about the axis of a + u.
        s, u, v, w = 1.0, x, p, q
        length = math.sqrt(u * u + v * v + w * w)
        if not length > 0.0:
            return
        angle = 0.0
    else:
        angle = 2.0 * math.atan2(length, s)
    u, v, w = u / length, v / length, w / length
    turns = round((x * u + p * v + q * w - angle) / (2.0 * math.pi))
    angle += 2.0 * math.pi * turns
    y[i], y[i + 1], y[i + 2] = angle * u, angle * v, angle * w
