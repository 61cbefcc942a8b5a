# SPDX-License-Identifier: MIT
"""Vibrations that time steps lose, and those that they follow at a slightly wrong frequency.

About a state a mechanism vibrates with the frequencies of the stiffness K of its bodies and springs
and of its mass M on the motions that its joints allow, K phi = omega^2 M phi. In quasi-static
balance strains do not accelerate, K w = 0. Elsewhere the coordinate of each mode starts with the
acceleration phi . K w / omega^2, that is, phi . K w / omega^4 away from its static position under
the present load, and vibrates about that position; likewise with the velocity phi . K w' / omega^4,
w' being the rate of the accelerations. A method that damps vibrations beyond its steps hides all of
this in its first steps (`lost_vibrations`).

A method follows a vibration that its steps resolve at a slightly wrong frequency, and damps it
slightly. Far from resonance this error hardly matters. Near resonance the relative change of the
amplitude is the error of the frequency divided by the distance between the frequencies of vibration
and load, which may be a hundred times the relative error of the frequency. The load of each mode is
known along a trajectory from accelerations, velocities and deformations, and one oscillator under a
known load is integrated exactly at the price of a sum over the instants (`resonance_error`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.interpolate import CubicSpline

from ..arrays import Array, symmetric
from .equations import CONSTRAINTS, FORCES, TANGENT
from .equilibrium import free_vibrations
from .integration.start import accelerations_at_jump, start_accelerations
from .kinematics import Kinematics, elastic_mass, mass_norm, norm_floors
from .model import FlatModel, without
from .tables import BESIDE_JUMP
from .trajectory import Trajectory


@dataclass(frozen=True)
class VibrationOptions:
    """Which vibrations are looked at."""

    #: Share of the largest squared frequency below which one is round-off.
    rigid: float = 1e-12
    #: Phase of the fastest vibration after which accelerations are evaluated again [rad].
    soon: float = 1e-2
    most_jumps: int = 32  #: Most jumps that are looked at.
    #: Phase in a step up to which a mode counts as one that the steps follow [rad]; those beyond
    #: are lost. In a rod that is shaken at 0.9 and 0.99 of its first frequency the estimate is
    #: within 7 % of the error of Radau IIA at 1.3 rad, and of the size of the error of the
    #: trapezoidal rule up to 0.6 rad, where that error is 0.7.
    largest_phase: float = 1.0
    #: Second difference of a load between instants, in parts of its range, up to which it is
    #: smooth. In the same rod it leaves out the trapezoidal rule from 0.9 rad on, where the
    #: estimate is off by a factor of five and more, and Radau IIA from 1.8 rad on, where it is off
    #: by 40 %.
    largest_bend: float = 0.3
    #: Exponent of the decay over a whole motion up to which its powers are numbers of the machine.
    largest_decay: float = 0.5 * math.log(np.finfo(float).max)
    #: Share of an error that matters below which the kinetic energy of a mode is not looked at: the
    #: error of its energy would have to be ten times the energy itself.
    small: float = 0.1


OPTIONS = VibrationOptions()


@dataclass(frozen=True)
class VibrationError:
    """Relative change of the mean strain energy of vibrations by time steps."""

    #: Relative to the mean strain energy of all bodies, or, of lost vibrations where none is
    #: flexible, to the mean square of the accelerations by mass [-].
    share: float = 0.0
    frequency: float = math.nan  #: Frequency of the mode with the largest share [Hz].
    time: float = math.nan  #: Time at which that mode is excited, where it is lost [s].
    body: str = ""  #: Name of the body with that mode, where it is in resonance.


def lost_vibrations(trajectory: Trajectory) -> VibrationError:
    """Vibrations excited by the start and the known jumps that the steps have damped away.

    Each mode is followed from there to the end with the damping of the machine, and with the
    damping of machine and method; the difference of the mean energies is lost.
    """
    model, end = trajectory.model, float(trajectory.t[-1])
    flexible = any(body.modes for body in model.bodies.values())
    if flexible:
        mean = _mean_strain_energy(trajectory)
    else:
        squares = mass_norm(model.arrays, trajectory.w) ** 2
        floor = norm_floors(model.arrays, end)[0] / end**2
        mean = float(_time_weights(trajectory) @ squares) + floor**2

    largest, lost = (0.0, math.nan, math.nan), 0.0
    for t, modes, w, jerk in _excited(trajectory):
        energies, squares = modes.excited(w, jerk)
        excited = 0.5 * (energies * modes.strain_shares(model) if flexible else squares)
        duration, rates = end - t, _numerical_decay(trajectory, modes)
        of_machine = _mean_square(modes.decay, duration)
        lost_of_modes = excited * (of_machine - _mean_square(rates, duration))
        lost_of_modes *= duration / end
        lost += float(np.sum(lost_of_modes))
        k = int(np.argmax(lost_of_modes)) if lost_of_modes.size else -1
        if k >= 0 and lost_of_modes[k] > largest[0]:
            frequency = float(modes.frequencies[k]) / (2.0 * math.pi)
            largest = float(lost_of_modes[k]), frequency, t
    _, frequency, time = largest
    return VibrationError(lost / (mean + lost) if lost > 0.0 else 0.0, frequency, time)


def resonance_error(trajectory: Trajectory, tolerance: float) -> VibrationError:
    """Error of the mean strain energy by modes that the steps follow at another frequency.

    Each body is looked at with its frame at rest, and only what may exceed a relative `tolerance`.
    Loads that jump, or that the instants do not follow, tell nothing: their modes are left out.
    """
    model, t = trajectory.model, trajectory.t
    if np.any(model.tables.jumps < t[-1]):
        return VibrationError()
    candidates = list(_followed_modes(trajectory))
    if not candidates:
        return VibrationError()

    weights, energy = _time_weights(trajectory), _mean_strain_energy(trajectory)
    error, largest = 0.0, VibrationError()
    for name, square, decay, to_mode in candidates:
        elastic = model.coordinates(name).elastic
        x, v, w = (
            states[:, elastic] @ to_mode for states in (trajectory.y, trajectory.v, trajectory.w)
        )
        if 0.5 * (weights @ v**2) <= OPTIONS.small * tolerance * energy:
            continue
        load = w + 2.0 * decay * v + square * x
        exact = _oscillator(t, load, square, decay, (float(x[0]), float(v[0])))
        if exact is None:
            continue
        change = 0.5 * square * float(weights @ (exact**2 - x**2)) / energy
        error += change
        if abs(change) > largest.share:
            frequency = math.sqrt(square) / (2.0 * math.pi)
            largest = VibrationError(abs(change), frequency, body=name)
    return VibrationError(abs(error), largest.frequency, body=largest.body)


def _time_weights(trajectory: Trajectory) -> Array:
    """Weights of means over time, shape (instants,), whose sum is one."""
    weights = trajectory.weights
    if weights is None:
        weights = np.gradient(trajectory.t)
    return np.asarray(weights / np.sum(weights))


def _mean_strain_energy(trajectory: Trajectory) -> float:
    """Mean over time of the strain energy of all bodies, no less than round-off [J]."""
    model, weights = trajectory.model, _time_weights(trajectory)
    flexible = [name for name, body in model.bodies.items() if body.modes]
    energy = sum(float(weights @ trajectory.strain_energy(name)) for name in flexible)
    return energy + float(norm_floors(model.arrays, float(trajectory.t[-1]))[2]) ** 2


def _numerical_decay(trajectory: Trajectory, modes: _Modes) -> Array:
    """Rates at which machine and method together damp the modes, shape (modes,) [1/s]."""
    h = float(np.median(np.diff(trajectory.step_ends)))
    factors = [trajectory.integrator.amplification(omega * h) for omega in modes.frequencies]
    return modes.decay - np.log(np.maximum(np.array(factors), 1e-300)) / h


def _mean_square(rates: Array, duration: float) -> Array:
    """Mean over a duration of exp(-2 rate t), for each rate."""
    x = np.maximum(2.0 * rates * duration, 1e-12)
    return -np.expm1(-x) / x


def _excited(trajectory: Trajectory) -> Iterator[tuple[float, _Modes, Array, Array]]:
    """Times of the start and of the jumps, the modes there, and what excites these.

    The latter are the accelerations that begin there, and their rate of change, shape (n,) each.
    """
    model, y, v = trajectory.model, trajectory.y, trajectory.v
    w, multipliers = trajectory.w[0], trajectory.multipliers[0]
    kinematics = Kinematics(model.arrays)
    kinematics.begin(y[0])
    modes = _Modes.at(kinematics, y[0], v[0], w, multipliers)
    jerk = np.zeros_like(w)
    if modes.frequencies.size:
        # the jerk is a difference quotient, over a time within which no vibration changes much
        h = OPTIONS.soon / float(modes.frequencies[-1])
        late = Kinematics(model.arrays._replace(**model.tables.tabulate(np.full(2, h))))
        late.begin(y[0])
        moved = model.arrays.retract(y[0], y[0] + h * v[0] + 0.5 * h * h * w)
        solution = start_accelerations(late, 0, moved, v[0] + h * w)
        if solution is not None:
            jerk = (solution[0] - w) / h
    yield 0.0, modes, w, jerk

    jumps = model.tables.jumps
    for t in jumps[jumps < trajectory.t[-1]][: OPTIONS.most_jumps].tolist():
        # the last instant that is not after the jump, but for round-off
        k = max(int(np.searchsorted(trajectory.t, t * (1.0 + BESIDE_JUMP), "right")) - 1, 0)
        counted = model.counting_from(trajectory.turns[k : k + 1])
        sides = accelerations_at_jump(counted, t, y[k], v[k])
        if sides is not None:
            (_, w_before, _), (kinematics, w_after, multipliers) = sides
            modes = _Modes.at(kinematics, y[k], v[k], w_after, multipliers)
            yield t, modes, w_after - w_before, np.zeros_like(w_after)


@dataclass(frozen=True, eq=False)
class _Modes:
    """Modes about a state, without rigid motions."""

    frequencies: Array  #: Angular frequencies, shape (modes,) [rad/s].
    shapes: Array  #: Modes of unit mass, shape (n, modes).
    decay: Array  #: Rates at which their amplitudes decay, shape (modes,) [1/s].
    stiffness: Array  #: Stiffness of bodies and springs, shape (n, n).

    @staticmethod
    def at(kinematics: Kinematics, y: Array, v: Array, w: Array, multipliers: Array) -> _Modes:
        """Modes at a state, shape (n,) each, with its multipliers (rows,)."""
        kinematics.set(y, v, w, multipliers)
        eq, extent = kinematics.equations, CONSTRAINTS | FORCES | TANGENT
        kinematics.evaluate(0, extent, 1.0)
        mass_and_damping = symmetric(eq.M)
        kinematics.evaluate(0, extent, 0.0)
        mass, stiffness = symmetric(eq.M), symmetric(eq.Ky)
        # Stiffness that remains without elastic bodies and springs causes no vibrations.
        loose = Kinematics(without(kinematics.model, 0, "K"))
        loose.begin(y)
        loose.set(y, v, w, multipliers)
        loose.evaluate(0, extent, 0.0)
        stiffness -= symmetric(loose.equations.Ky)
        squares, shapes = free_vibrations(eq.C, mass, stiffness)
        elastic = squares > OPTIONS.rigid * np.max(squares, initial=0.0)
        shapes = shapes[:, elastic]
        damping = np.sum(shapes * ((mass_and_damping - mass) @ shapes), axis=0)
        decay = 0.5 * np.maximum(damping, 0.0)
        return _Modes(np.sqrt(squares[elastic]), shapes, decay, stiffness)

    def excited(self, w: Array, jerk: Array) -> tuple[Array, Array]:
        """Energies [J], and squares of accelerations by mass, of the vibrations that w starts."""
        squares = self.frequencies**2
        acceleration = self.shapes.T @ (self.stiffness @ w) / squares
        velocity = self.shapes.T @ (self.stiffness @ jerk) / squares**2
        energies = 0.5 * (acceleration**2 / squares + velocity**2)
        return energies, acceleration**2 + squares * velocity**2

    def strain_shares(self, model: FlatModel) -> Array:
        """Shares of the bodies' strains in the potential energies of the modes, shape (modes,)."""
        strain = np.zeros_like(self.frequencies)
        for b, name in enumerate(model.bodies):
            n, shapes = int(model.arrays.modes[b]), self.shapes[model.coordinates(name).elastic]
            strain += np.sum(shapes * (model.arrays.K[b, :n, :n] @ shapes), axis=0)
        return np.minimum(strain / self.frequencies**2, 1.0)


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
        vibrates = squares > decays**2
        is_followed = squares * step**2 < OPTIONS.largest_phase**2
        lasts = decays * end < OPTIONS.largest_decay
        for k in np.flatnonzero(vibrates & is_followed & lasts):
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
    if bends > OPTIONS.largest_bend * np.ptp(load):
        return None

    # exp(-rate t) c is its start and the integral of exp(-rate t) load, interval by interval
    impulses = np.zeros(half.size, dtype=np.complex128)
    for point in (-math.sqrt(1.0 / 3.0), math.sqrt(1.0 / 3.0)):  # Gauss points, of unit weight
        s = half * (1.0 + point)
        value = ((cubic[0] * s + cubic[1]) * s + cubic[2]) * s + cubic[3]
        impulses += np.exp(-rate * (half * point)) * value
    impulses *= half * np.exp(-rate * middle)

    amplitude = start[1] - rate.conjugate() * start[0] + np.append(0.0, np.cumsum(impulses))
    return np.asarray((np.exp(rate * t) * amplitude).imag / rate.imag)
