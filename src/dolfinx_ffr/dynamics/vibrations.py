# SPDX-License-Identifier: MIT
"""Vibrations excited at the start and at jumps, whether or not the steps resolve them.

About a state a mechanism vibrates with the frequencies of the stiffness K of its bodies and springs
and of its mass M on the motions that its joints allow, K phi = omega^2 M phi. In quasi-static
balance strains do not accelerate, K w = 0. Elsewhere the coordinate of each mode starts with the
acceleration phi . K w / omega^2, that is, phi . K w / omega^4 away from its static position under
the present load, and vibrates about that position; likewise with the velocity phi . K w' / omega^4,
w' being the rate of the accelerations. A method that damps vibrations beyond its steps hides all of
this in its first steps.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ..arrays import Array
from .equations import CONSTRAINTS, FORCES, TANGENT
from .integration.start import accelerations_at_jump, start_accelerations
from .kinematics import Kinematics, mass_norm, norm_floors
from .model import FlatModel, without
from .tables import BESIDE_JUMP
from .trajectory import Trajectory

#: Share of the largest singular value below which a row of the joints counts as redundant
_REDUNDANT = 1e-10
#: Share of the largest squared frequency below which one is round-off
_RIGID = 1e-12
#: Phase of the fastest vibration after which accelerations are evaluated a second time [rad]
SOON = 1e-2
#: Most jumps that are looked at
_JUMPS = 32


@dataclass(frozen=True, eq=False)
class LostVibrations:
    """Vibrations that a motion excites and that its steps damp away."""

    #: Their share of the mean strain energy of all bodies, or, where none is flexible, of the mean
    #: square of the accelerations by mass [-].
    share: float
    frequency: float  #: Frequency of the mode with the largest share [Hz].
    time: float  #: Time at which that mode is excited [s].


def lost_vibrations(trajectory: Trajectory) -> LostVibrations:
    """Vibrations excited by the start and the known jumps that the steps have damped away.

    Each mode is followed from there to the end with the damping of the machine, and with the
    damping of machine and method; the difference of the mean energies is lost.
    """
    model, method = trajectory.model, trajectory.integrator
    flexible = [name for name, body in model.bodies.items() if body.modes]
    weights = trajectory.weights
    if weights is None:
        weights = np.gradient(trajectory.t)
    weights = weights / np.sum(weights)
    end, h = float(trajectory.t[-1]), float(np.median(np.diff(trajectory.step_ends)))
    displacement, _, strain, _ = norm_floors(model.arrays, end)
    if flexible:
        mean = sum(float(weights @ trajectory.strain_energy(name)) for name in flexible)
        mean += strain**2
    else:
        mean = float(weights @ mass_norm(model.arrays, trajectory.w) ** 2)
        mean += (displacement / end**2) ** 2
    worst, lost = (0.0, math.nan, math.nan), 0.0
    for t, modes, w, jerk in _excited(trajectory):
        energies, moving = modes.excited(w, jerk)
        size = 0.5 * (energies * modes.strain_shares(model) if flexible else moving)
        kept = np.array([method.amplification(omega * h) for omega in modes.frequencies])
        rates = modes.decay - np.log(np.maximum(kept, 1e-300)) / h
        gone = size * (_mean_square(modes.decay, end - t) - _mean_square(rates, end - t))
        gone *= (end - t) / end
        lost += float(np.sum(gone))
        if gone.size and (k := int(np.argmax(gone))) >= 0 and gone[k] > worst[0]:
            worst = float(gone[k]), float(modes.frequencies[k]) / (2.0 * math.pi), t
    share = lost / (mean + lost) if lost > 0.0 else 0.0
    return LostVibrations(share, *worst[1:])


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
    modes, jerk = _Modes.at(kinematics, y[0], v[0], w, multipliers), np.zeros_like(w)
    if modes.frequencies.size:
        # a time within which no vibration changes much
        h = SOON / float(modes.frequencies[-1])
        late = Kinematics(model.arrays._replace(**model.tables.tabulate(np.full(2, h))))
        late.begin(y[0])
        moved = model.arrays.retract(y[0], y[0] + h * v[0] + 0.5 * h * h * w)
        found = start_accelerations(late, 0, moved, v[0] + h * w)
        if found is not None:
            jerk = (found[0] - w) / h
    yield 0.0, modes, w, jerk
    jumps = model.tables.jumps
    for t in jumps[jumps < trajectory.t[-1]][:_JUMPS].tolist():
        k = max(int(np.searchsorted(trajectory.t, t * (1.0 + BESIDE_JUMP), "right")) - 1, 0)
        here = model.counting_from(trajectory.turns[k : k + 1])
        sides = accelerations_at_jump(here, t, y[k], v[k])
        if sides is not None:
            (_, before, _), (kinematics, after, multipliers) = sides
            modes = _Modes.at(kinematics, y[k], v[k], after, multipliers)
            yield t, modes, after - before, np.zeros_like(after)


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
        eq, every = kinematics.equations, CONSTRAINTS | FORCES | TANGENT
        kinematics.evaluate(0, every, 1.0)
        both = _symmetric(eq.M)
        kinematics.evaluate(0, every, 0.0)
        mass, stiffness = _symmetric(eq.M), _symmetric(eq.Ky)
        # The stiffness without elastic bodies and springs is not that of vibrations.
        loose = Kinematics(without(kinematics.model, 0, "K"))
        loose.begin(y)
        loose.set(y, v, w, multipliers)
        loose.evaluate(0, every, 0.0)
        stiffness -= _symmetric(loose.equations.Ky)
        free = np.eye(y.size)
        if len(eq.C):
            unit = 1.0 / np.sqrt(np.diag(mass))
            free = unit[:, None] * scipy.linalg.null_space(eq.C * unit, rcond=_REDUNDANT)
        if not free.shape[1]:
            return _Modes(np.zeros(0), np.zeros((y.size, 0)), np.zeros(0), stiffness)
        squares, vectors = scipy.linalg.eigh(free.T @ stiffness @ free, free.T @ mass @ free)
        elastic = squares > _RIGID * max(float(squares[-1]), 0.0)
        shapes = (free @ vectors)[:, elastic]
        decay = 0.5 * np.maximum(np.sum(shapes * ((both - mass) @ shapes), axis=0), 0.0)
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
            n, part = int(model.arrays.modes[b]), self.shapes[model.coordinates(name).elastic]
            strain += np.sum(part * (model.arrays.K[b, :n, :n] @ part), axis=0)
        return np.minimum(strain / self.frequencies**2, 1.0)


def _symmetric(matrix: Array) -> Array:
    return 0.5 * (matrix + matrix.T)
