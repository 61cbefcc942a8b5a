# SPDX-License-Identifier: MIT
"""Error that time steps make near a resonance of a flexible body.

A method follows a vibration at a frequency that is slightly wrong, and damps it slightly. Far from
resonance that hardly matters. Near it the amplitude changes by as much as the frequency moves, in
parts of its distance from that of the load, which may be a hundred times more. The load of each
mode is known along a trajectory from accelerations, velocities and deformations, and one oscillator
under a known load is integrated exactly at the price of a sum over the instants.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.interpolate import CubicSpline

from ..arrays import Array
from .kinematics import elastic_mass, norm_floors
from .trajectory import Trajectory

#: Phase in a step up to which a mode counts as one that the steps follow [rad]; those beyond are
#: vibrations that are lost (`vibrations`). In a rod that is shaken at 0.9 and 0.99 of its first
#: frequency the estimate is within 7 % of the error of Radau IIA at 1.3 rad, and of the size of the
#: error of the trapezoidal rule up to 0.6 rad, where that error is 0.7.
LARGEST_PHASE = 1.0
#: Exponent of the decay over a whole motion up to which its powers are numbers of the machine
LARGEST_DECAY = 0.5 * math.log(np.finfo(float).max)
#: Share of an error that matters below which the kinetic energy of a mode is not looked at: the
#: error of its energy would have to be ten times the energy itself
SMALL = 0.1
#: Second difference of a load between instants, in parts of its range, up to which it is smooth. In
#: the same rod it leaves out the trapezoidal rule from 0.9 rad on, where the estimate is off by a
#: factor of five and more, and Radau IIA from 1.8 rad on, where it is off by 40 %.
LARGEST_BEND = 0.3
#: Points and weights of Gauss and Legendre in each interval, for loads times vibrations
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(2)


@dataclass(frozen=True)
class ResonanceError:
    """Error of the mean strain energy, as steps shift and damp the modes of the bodies."""

    error: float  #: Relative to the mean strain energy of all bodies [-].
    frequency: float  #: Frequency of the mode with the largest share in it [Hz].
    body: str  #: Name of the body with this mode; empty where there is no error.


def resonance_error(trajectory: Trajectory, tolerance: float) -> ResonanceError:
    """Error of the mean strain energy by modes that the steps follow at another frequency.

    Each body is looked at with its frame at rest, and only what may exceed a relative `tolerance`.
    Loads that jump, or that the instants do not follow, tell nothing: their modes are left out.
    """
    model, t = trajectory.model, trajectory.t
    error, largest = 0.0, ResonanceError(0.0, 0.0, "")
    if np.any(model.tables.jumps < t[-1]):
        return largest
    candidates = list(_followed_modes(trajectory))
    if not candidates:
        return largest

    weights = np.gradient(t) if trajectory.weights is None else trajectory.weights
    weights = weights / np.sum(weights)
    flexible = [name for name, body in model.bodies.items() if body.modes]
    energy = sum(float(weights @ trajectory.strain_energy(name)) for name in flexible)
    energy += norm_floors(model.arrays, float(t[-1]))[2] ** 2
    for name, square, decay, to_mode in candidates:
        elastic = model.coordinates(name).elastic
        x, v, w = (
            part[:, elastic] @ to_mode for part in (trajectory.y, trajectory.v, trajectory.w)
        )
        if 0.5 * (weights @ v**2) <= SMALL * tolerance * energy:
            continue
        load = w + 2.0 * decay * v + square * x
        exact = _oscillator(t, load, square, decay, (float(x[0]), float(v[0])))
        if exact is None:
            continue
        change = 0.5 * square * float(weights @ (exact**2 - x**2)) / energy
        error += change
        if abs(change) > largest.error:
            largest = ResonanceError(abs(change), math.sqrt(square) / (2.0 * math.pi), name)
    return ResonanceError(abs(error), largest.frequency, largest.body)


def _followed_modes(trajectory: Trajectory) -> Iterator[tuple[str, float, float, Array]]:
    """Modes of single bodies that vibrate for long and that the steps follow.

    For each the name of the body, the squared frequency [1/s^2], the rate of decay [1/s], and the
    vector (modes of the body,) that takes elastic coordinates to the coordinate of the mode.
    """
    model, end = trajectory.model, float(trajectory.t[-1])
    step = end / (trajectory.step_ends.size - 1)
    for b, (name, body) in enumerate(model.bodies.items()):
        if not body.modes:
            continue
        mass = elastic_mass(model.arrays, b)
        squares, shapes = scipy.linalg.eigh(body.K, mass)
        decays = 0.5 * (model.arrays.alpha[b] + model.arrays.beta[b] * squares)
        followed = (squares > decays**2) & (squares * step**2 < LARGEST_PHASE**2)
        for k in np.flatnonzero(followed & (decays * end < LARGEST_DECAY)):
            yield name, float(squares[k]), float(decays[k]), mass @ shapes[:, k]


def _oscillator(
    t: Array, load: Array, square: float, decay: float, start: tuple[float, float]
) -> Array | None:
    """Displacements with x'' + 2 decay x' + square x = load, shape (instants,) as the load.

    It is None where the load is not smooth between the instants. Displacement and velocity begin
    with `start`. The complex amplitude c = x' - conj(rate) x has one rate only, c' = rate c + load.
    """
    rate = complex(-decay, math.sqrt(square - decay**2))
    half, middle = 0.5 * np.diff(t), 0.5 * (t[1:] + t[:-1])
    cubic = CubicSpline(t, load).c
    bends = 2.0 * np.max(np.abs(cubic[1]) * np.diff(t) ** 2)
    if bends > LARGEST_BEND * np.ptp(load):
        return None
    pushed = np.zeros(half.size, dtype=np.complex128)
    for point, weight in zip(POINTS, WEIGHTS, strict=True):
        s = half * (1.0 + point)
        value = ((cubic[0] * s + cubic[1]) * s + cubic[2]) * s + cubic[3]
        pushed += weight * np.exp(-rate * (half * point)) * value
    pushed *= half * np.exp(-rate * middle)
    amplitude = start[1] - rate.conjugate() * start[0] + np.append(0.0, np.cumsum(pushed))
    return np.asarray((np.exp(rate * t) * amplitude).imag / rate.imag)
