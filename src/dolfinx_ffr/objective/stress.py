# SPDX-License-Identifier: MIT
"""The largest von Mises stress of a body in motion, as a number that can be differentiated.

The von Mises stress,

    s_v^2 = sx^2 + sy^2 + sz^2 - sx sy - sy sz - sz sx + 3 txy^2,      sz = k (sx + sy),

with k = 0 in plane stress and k = nu in plane strain, is the length of three numbers that are
linear in the coordinates of the body; in space, with all shear stresses, of six. All points and
instants are gone through in blocks, so that no more than a block of them is held at a time.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import ClassVar

import numpy as np

from .. import validation
from ..arrays import Array, Integers, Mask
from ..dynamics import Trajectory
from .base import Derivatives, Inventory, Objective, Response, StressField
from .stress_coordinates import stress_coordinates, stress_coordinates_pullback
from .time_average import time_weights

#: Numbers in one block of stresses over time.
BLOCK = 1_000_000
#: Shares of the derivative that are left out, as round-off does.
NEGLIGIBLE = 1e-18
#: Where ranges of stress below the largest one begin, as shares of it
LEVELS = (0.75, 0.9, 0.97)


def von_mises_root(out_of_plane: float, components: int = 3) -> Array:
    """The matrix R, (components, components), by which the von Mises stress is |R (sx, sy, txy)|.

    ``out_of_plane`` is sz / (sx + sy); of 6 components the order is sx, sy, sz, txy, tyz, txz.
    """
    if components == 6:
        root = math.sqrt(3.0) * np.eye(6)
        root[:3, :3] = math.sqrt(0.5) * np.array([[1, -1, 0], [0, 1, -1], [-1, 0, 1]])
        return root
    # of sx + sy and sx - sy the square is a diagonal form
    mean, difference = 0.5 * abs(1.0 - 2.0 * out_of_plane), 0.5 * math.sqrt(3.0)
    return np.array([[mean, mean, 0.0], [difference, -difference, 0.0], [0.0, 0.0, math.sqrt(3.0)]])


@dataclass(frozen=True)
class PeakStress(Objective):
    """Power mean over a body and the time of the von Mises stress, close to its peak [Pa].

        psi = scale (1/(A T) int int (x^s s_v)^p dA dt)^(1/p),    in space over the volume.

    s_v is the stress of the solid at the strain of a cell, as in :func:`worst_stress`, at the same
    points and instants. Cells of density x count with x^s of it, so that one may vanish without a
    jump (the relaxation of C. Le et al., Structural and Multidisciplinary Optimization 41 (2010),
    doi:10.1007/s00158-009-0440-y, with s = 1/2); void has no stress.

    With ``scale`` 1 psi is never above the largest stress, and about half of it with the default
    power: a constraint on psi then bounds the mean. :meth:`calibrated` gives the objective with the
    scale that makes psi the largest stress at one design, as `MMA` does (and Le et al.) at each
    design that it keeps. :meth:`largest` is the largest stress itself. Larger powers are closer to
    the peak, but so nonlinear that moving asymptotes get stuck.

    Raises:
        ValueError: If a number is out of range; when the problem is made, if the body has no mesh.
    """

    unit: ClassVar[str] = "Pa"

    body: str  #: Name of the body
    power: float = 8.0  #: The power p, at least 2
    #: Exponent s of the density; zero relaxes nothing, else more than 1 / p.
    relaxation: float = 0.5
    #: Whether modes that were left out follow the inertia forces statically.
    correction: bool = True
    scale: float = 1.0  #: Factor of the mean
    #: Distance from interfaces within which no stress counts [m]: interfaces are rigid, and where
    #: an edge begins at one the stress grows without limit as meshes are refined
    clear: float = 0.0
    #: Of one mesh the points that count, (cells, points) of this rank; None for all
    counted: Mask | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        what = "peak stress"
        validation.name(f"{what}: body", self.body)
        validation.number(f"{what}: the power", self.power, least=2.0)
        validation.number(f"{what}: relaxation", self.relaxation, least=0.0)
        validation.flag(f"{what}: correction", self.correction)
        validation.number(f"{what}: scale", self.scale, above=0.0)
        validation.number(f"{what}: clear", self.clear, least=0.0, unit="m")
        if 0.0 < self.relaxation * self.power <= 1.0:
            raise ValueError(
                f"{what}: relaxation = {self.relaxation:g} times the power = {self.power:g} must "
                "be above 1, or void has no derivative; take a larger one of both"
            )

    def validate(self, inventory: Inventory) -> None:
        self._check_body(inventory.densities)

    def _check_body(self, bodies: Collection[str]) -> None:
        if self.body not in bodies:
            raise ValueError(
                f"peak stress of body {self.body!r}, but the bodies with a mesh and a density are "
                f"{sorted(bodies)}"
            )

    def evaluate(self, response: Response) -> float:
        return self.scale * self._mean(self._parts(response)).value

    def largest(self, response: Response) -> float:
        """The largest von Mises stress of all points and instants, times x^s [Pa]; collective.

        It is that of ``worst_stress(..., relaxation=s, void=0.0)``, at a ``response``, for example
        `Problem.response(evaluation)`; it raises what :meth:`evaluate` raises.
        """
        return math.sqrt(self._mean(self._parts(response)).largest)

    def calibrated(self, response: Response) -> PeakStress:
        mean = self._mean(self._parts(response))
        if mean.value == 0.0:
            return self
        return replace(self, scale=math.sqrt(mean.largest) / mean.value)

    def parts(self, response: Response) -> list[Objective]:
        """Those of points whose highest stress, at a ``response``, is in a range below the largest.

        The mean over all of a body says little of a short notch beside a long member under almost
        as much stress (E. Holmberg, B. Torstenfelt, A. Klarbring, Structural and Multidisciplinary
        Optimization 48 (2013), doi:10.1007/s00158-012-0880-7).
        """
        parts = self._parts(response)
        mean = self._mean(parts)
        if mean.largest == 0.0:
            return [self]
        level = np.sqrt(mean.highest / mean.largest)
        found: list[Objective] = []
        for low, high in pairwise((*LEVELS, math.inf)):
            counted = (level >= low) & (level < high)
            if any(parts.field.gathered(bool(np.any(counted)))):
                shape = parts.field.weights.shape
                of_these = replace(self, counted=counted.reshape(shape))
                found.append(of_these.calibrated(response))
        return found

    def derivatives(self, response: Response) -> Derivatives:
        parts = self._parts(response)
        mean, p = self._mean(parts), self.power
        z = parts.coordinates
        z_bar, modes_bar = np.zeros_like(z), np.zeros_like(parts.modes)
        x_bar, weights_bar = np.zeros(len(parts.density)), np.zeros(len(parts.cell))
        if mean.value > 0.0:
            # d psi / d s_v^2 = 1/2 scale / (mean A T) weight (x^s)^p (s_v / mean)^(p - 2)
            weights_bar -= self.scale * mean.value / (p * parts.area)
            share = (mean.highest / mean.value**2) ** (0.5 * p - 1.0)  # at least 1 at the peak
            chosen = np.flatnonzero(share > NEGLIGIBLE)
            for part, stress in parts.blocks(chosen):
                own = parts.share[part, None]
                squared = own * np.einsum("ipt,ipt->pt", stress, stress)
                slope = _power(squared / mean.value**2, 0.5 * p - 1.0)
                slope *= 0.5 * self.scale / mean.value * parts.areas[part, None] * parts.times
                through = np.einsum("pt,pt->p", slope, squared)
                weights_bar[part] += 2.0 / p * through / (parts.areas[part] * parts.area)
                x_bar += np.bincount(parts.cell[part], through, minlength=len(x_bar))
                slope *= 2.0 * own
                stress *= slope
                modes_bar[:, part] = stress @ z
                for row, modes in zip(stress, parts.modes[:, part], strict=True):
                    z_bar += row.T @ modes
            positive = parts.density > 0.0
            x_bar[positive] *= 2.0 * self.relaxation / parts.density[positive]
        field = parts.field
        root = von_mises_root(field.out_of_plane, len(parts.modes))
        shape = (*field.weights.shape, z.shape[1], len(root))
        stress_bar = np.tensordot(modes_bar, root, axes=(0, 0)).reshape(shape)
        return Derivatives(
            stress_coordinates_pullback(
                parts.trajectory, self.body, field.n_constraint, field.sum(z_bar)
            ),
            densities={self.body: x_bar},
            stresses={self.body: np.swapaxes(stress_bar, 2, 3)},
            weights={self.body: weights_bar.reshape(field.weights.shape)},
        )

    def _parts(self, response: Response) -> _Parts:
        """The quantities that the mean is made of."""
        self._check_body(response.stresses)
        field, density = response.stresses[self.body], response.densities[self.body].values
        trajectory = response.trajectory
        modes, (cells, points) = field.modes(self.correction), field.weights.shape
        root = von_mises_root(field.out_of_plane, modes.shape[2])
        weighted = np.einsum("ij,cpjn->icpn", root, modes)
        times = time_weights(trajectory)
        cell = np.repeat(np.arange(cells), points)
        area = sum(field.gathered(float(np.sum(field.weights))))
        share = density[cell] ** (2.0 * self.relaxation)
        if self.clear > 0.0:
            share = np.where(field.interface_distance.ravel() < self.clear, 0.0, share)
        if self.counted is not None:
            share = np.where(self.counted.ravel(), share, 0.0)
        return _Parts(
            field=field,
            trajectory=trajectory,
            density=density,
            modes=weighted.reshape(len(root), len(cell), modes.shape[3]),
            coordinates=stress_coordinates(
                trajectory, self.body, field.n_constraint, correction=self.correction
            ),
            times=times / np.sum(times),
            cell=cell,
            areas=field.weights.ravel() / area,
            area=area,
            share=share,
        )

    def _mean(self, parts: _Parts) -> _Mean:
        """The mean over all points and instants, the same on every rank."""
        half, counts = 0.5 * self.power, parts.times > 0.0
        highest = np.zeros(len(parts.areas))
        # the largest value so far is divided out, so that no power overflows
        largest = reference = total = 0.0
        for part, stress in parts.blocks(np.arange(len(highest))):
            squared = np.einsum("ipt,ipt->pt", stress, stress)
            squared *= parts.share[part, None]
            largest = max(largest, float(np.max(squared, initial=0.0)))
            # the start does not count in the integrals of Radau IIA
            squared = squared[:, counts]
            highest[part] = np.max(squared, axis=1)
            now = float(np.max(highest[part], initial=0.0))
            if now > reference:
                total *= (reference / now) ** half
                reference = now
            if reference > 0.0:
                powers = _power(squared / reference, half)
                total += float(parts.areas[part] @ (powers @ parts.times[counts]))
        ranks = parts.field.gathered((largest, reference, total))
        largest, reference = (max(rank[i] for rank in ranks) for i in (0, 1))
        if reference == 0.0:
            return _Mean(0.0, largest, highest)
        total = sum(part * (own / reference) ** half for _, own, part in ranks)
        return _Mean(math.sqrt(reference) * total ** (1.0 / self.power), largest, highest)


@dataclass(frozen=True, eq=False)
class _Parts:
    """Stress for unit coordinates, coordinates over time, and how much each point counts."""

    field: StressField
    trajectory: Trajectory
    density: Array  #: (cells,) of this rank
    modes: Array  #: (3 or 6, points of all cells, coordinates) R times the stress of the solid [Pa]
    coordinates: Array  #: (steps + 1, coordinates)
    times: Array  #: (steps + 1,) share of each instant in the time
    cell: Integers  #: (points of all cells,) of each point
    areas: Array  #: (points of all cells,) share of each point in the area of the body
    area: float  #: Area of the body, in space volume [m^2], [m^3]
    share: Array  #: (points of all cells,) x^(2 s), zero beside interfaces

    def blocks(self, chosen: Integers) -> Iterator[tuple[Integers, Array]]:
        """Some of the chosen points, and R times their stress, (3 or 6, points, steps + 1)."""
        history = np.ascontiguousarray(self.coordinates.T)
        several = max(1, BLOCK // (len(self.modes) * history.shape[1]))
        for first in range(0, len(chosen), several):
            part = chosen[first : first + several]
            yield part, self.modes[:, part] @ history


@dataclass(frozen=True, eq=False)
class _Mean:
    """A power mean, and what else was seen on the way."""

    value: float  #: The mean, without its scale [Pa]
    largest: float  #: Largest square of all points and instants, the same on every rank [Pa^2]
    highest: Array  #: (points of all cells,) largest square of each over the time that counts


def _power(values: Array, exponent: float) -> Array:
    """Values to a power, by products where it is a whole number."""
    if exponent != int(exponent):
        return np.asarray(values**exponent)
    result, square, left = np.ones_like(values), values.copy(), int(exponent)
    while left:
        if left % 2:
            result *= square
        left //= 2
        if left:
            square *= square
    return result
