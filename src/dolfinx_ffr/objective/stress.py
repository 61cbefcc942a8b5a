# SPDX-License-Identifier: MIT
"""The largest von Mises stress of a body in motion, as a number that can be differentiated.

The von Mises stress,

    s_v^2 = sx^2 + sy^2 + sz^2 - sx sy - sy sz - sz sx + 3 txy^2,      sz = k (sx + sy),

with k = 0 in plane stress and k = nu in plane strain, is the length of three numbers that are
linear in the coordinates of the body; in space, with all shear stresses, of six.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import ClassVar

import numpy as np

from .. import validation
from ..arrays import Array, Integers, Mask
from .base import Derivatives, Inventory, Objective, Response
from .stress_coordinates import stress_coordinates, stress_coordinates_pullback
from .stress_mean import Mean, Stresses
from .time_average import time_weights

#: Largest number of stresses that are stored for the derivative, 32 MB
_MOST_STORED = 4_000_000
#: Lower ends of the ranges of stress of `PeakStress.parts`, as shares of the largest one
LEVELS = (0.75, 0.9, 0.97)
#: Number of boxes into which a body is divided for `PeakStress.places`
PLACES = 8

#: Lower and upper corner of a box [m]
Box = tuple[tuple[float, ...], tuple[float, ...]]


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
    accepted design. :meth:`largest` is the largest stress itself. Larger powers are closer to the
    peak, but so nonlinear that moving asymptotes get stuck.

    Raises:
        ValueError: If a number is out of range; when the problem is made, if the body has no mesh.

    Attributes:
        body: Name of the body.
        power: The power p, at least 2.
        relaxation: Exponent s of the density; zero relaxes nothing, else more than 1 / p.
        correction: Whether modes that were left out follow the inertia forces statically.
        scale: Factor of the mean.
        clear: Distance from interfaces within which no stress counts [m]: interfaces are rigid, and
            where an edge begins at one the stress grows without limit as meshes are refined.
        counted: Of one mesh the points that count, (cells, points) of this rank; None for all.
        box: Lower and upper corner of a box of the undeformed body, whose points alone count [m];
            None for all.
    """

    unit: ClassVar[str] = "Pa"

    body: str
    power: float = 8.0
    relaxation: float = 0.5
    correction: bool = True
    scale: float = 1.0
    clear: float = 0.0
    counted: Mask | None = field(default=None, repr=False, compare=False)
    box: Box | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        validation.name("peak stress: body", self.body)
        validation.number("peak stress: the power", self.power, least=2.0)
        validation.number("peak stress: relaxation", self.relaxation, least=0.0)
        validation.flag("peak stress: correction", self.correction)
        validation.number("peak stress: scale", self.scale, above=0.0)
        validation.number("peak stress: clear", self.clear, least=0.0, unit="m")
        if 0.0 < self.relaxation * self.power <= 1.0:
            raise ValueError(
                f"peak stress: relaxation = {self.relaxation:g} times the power = {self.power:g} "
                "must be above 1, or void has no derivative; raise one of them"
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
        return self.scale * self._mean(response).value

    def largest(self, response: Response) -> float:
        """The largest von Mises stress of all points and instants, times x^s [Pa].

        It equals ``worst_stress(..., relaxation=s, void=0.0)``, at a ``response``, for example
        `Problem.response(evaluation)`.
        """
        return math.sqrt(self._mean(response).largest)

    def calibrated(self, response: Response) -> PeakStress:
        mean = self._mean(response)
        if mean.value == 0.0:
            return self
        return replace(self, scale=math.sqrt(mean.largest) / mean.value)

    def parts(self, response: Response) -> list[Objective]:
        """Objectives of points whose highest stress at a ``response`` is in a range of stress.

        The mean over all of a body hardly depends on a short notch beside a long member under
        almost the same stress (E. Holmberg, B. Torstenfelt, A. Klarbring, Structural and
        Multidisciplinary Optimization 48 (2013), doi:10.1007/s00158-012-0880-7).
        """
        mean = self._mean(response)
        if mean.largest == 0.0:
            return [self]
        stress = response.stresses[self.body]
        level, ranges = np.sqrt(mean.highest / mean.largest), list[Objective]()
        for low, high in pairwise((*LEVELS, math.inf)):
            counted = (level >= low) & (level < high)
            if any(stress.gathered(bool(np.any(counted)))):
                ranges.append(replace(self, counted=counted).calibrated(response))
        return ranges

    def places(self, response: Response) -> list[Objective]:
        """The largest stress of each of some boxes that fill the body, at a ``response``.

        If the stress is nearly uniform, the gradient of a mean over all of the body does not tell
        which place needs more material. The boxes have equal shares in the mean, so they are small
        where the stress is high.
        """
        mean, field = self._mean(response), response.stresses[self.body]
        if mean.largest == 0.0:
            return [self]
        shares = field.weights * (mean.highest / mean.largest) ** (0.5 * self.power)
        dimension = field.points.shape[2]
        points = np.vstack(field.gathered(field.points.reshape(-1, dimension)))
        boxes = _boxes(points, np.concatenate(field.gathered(shares.ravel())), PLACES)
        return [replace(self, box=box).calibrated(response) for box in boxes]

    def derivatives(self, response: Response) -> Derivatives:
        mean = self._mean(response)
        points = response.cache[self._key][1] or self._points(response)
        field, x = response.stresses[self.body], response.densities[self.body].values
        modes_bar, z_bar = points.stresses.slopes(mean, self.power)
        modes_bar *= self.scale
        # derivative by s_v^2 of each point, times s_v^2
        by_square = 0.5 * np.einsum("ipn,ipn->p", modes_bar, points.stresses.modes)
        cell, areas = points.chosen // field.weights.shape[1], points.stresses.areas
        x_bar = np.zeros(len(x))
        x_bar += np.bincount(cell, by_square, minlength=len(x))
        x_bar[x > 0.0] *= 2.0 * self.relaxation / x[x > 0.0]
        weights_bar = points.scattered(2.0 / self.power * by_square / areas)
        weights_bar = (weights_bar - self.scale * mean.value / self.power) / points.area
        modes_bar *= points.share[:, None]
        stress_bar = points.scattered(np.moveaxis(_times(points.root.T, modes_bar), 0, 1))
        z_bar = field.sum(self.scale * z_bar)
        return Derivatives(
            stress_coordinates_pullback(response.trajectory, self.body, field.n_constraint, z_bar),
            densities={self.body: x_bar},
            stresses={self.body: stress_bar},
            weights={self.body: weights_bar},
        )

    def _points(self, response: Response) -> _Points:
        """The points that count, and their stress."""
        self._check_body(response.stresses)
        field, x = response.stresses[self.body], response.densities[self.body].values
        share = np.repeat(x**self.relaxation, field.weights.shape[1])
        if self.clear > 0.0:
            share[field.interface_distance.ravel() < self.clear] = 0.0
        if self.counted is not None:
            share[~self.counted.ravel()] = 0.0
        if self.box is not None:
            low, high = self.box
            inside = np.all((field.points >= low) & (field.points < high), axis=2)
            share[~inside.ravel()] = 0.0
        chosen = np.flatnonzero(share)
        area = sum(field.gathered(float(np.sum(field.weights))))
        modes, options = field.modes(self.correction), {"correction": self.correction}
        root = von_mises_root(field.out_of_plane, modes.shape[2])
        solid = modes.reshape(len(share), *modes.shape[2:])
        weighted = _times(root, np.moveaxis(solid if share.all() else solid[chosen], 1, 0))
        weighted *= share[chosen, None]
        z = stress_coordinates(response.trajectory, self.body, field.n_constraint, **options)
        times, areas = time_weights(response.trajectory), field.weights.ravel()[chosen] / area
        stresses = Stresses(weighted, z, areas, times / np.sum(times))
        return _Points(field.weights.shape, area, chosen, share[chosen], root, stresses)

    def _mean(self, response: Response) -> Mean:
        """The mean over all points and instants, the same on every rank, computed once."""
        if self._key not in response.cache:
            points = self._points(response)
            points_mean = points.stresses.mean(self.power, response.stresses[self.body].gathered)
            mean = replace(points_mean, highest=points.scattered(points_mean.highest))
            # the mask stays alive with its id, which is in the key
            cached_points = points if points.stresses.modes.size <= _MOST_STORED else None
            response.cache[self._key] = mean, cached_points, self.counted
        cached: Mean = response.cache[self._key][0]
        return cached

    @property
    def _key(self) -> tuple[PeakStress, int]:
        """The key of the mean in the cache of a response."""
        return replace(self, scale=1.0), id(self.counted)


@dataclass(frozen=True, eq=False)
class _Points:
    """The points that count, and their stress."""

    shape: tuple[int, ...]  #: Cells, and points of each
    area: float  #: Area of the body, in space volume [m^2], [m^3]
    chosen: Integers  #: (points,) their numbers among all points
    share: Array  #: (points,) x^s
    root: Array  #: R
    stresses: Stresses  #: R times the stress of the solid times x^s

    def scattered(self, values: Array) -> Array:
        """Values (points, ...) for all points, (cells, points of each, ...); else zeros."""
        total = math.prod(self.shape)
        all_values = values if len(values) == total else np.zeros((total, *values.shape[1:]))
        if len(values) < total:
            all_values[self.chosen] = values
        return all_values.reshape(*self.shape, *values.shape[1:])


def _boxes(points: Array, shares: Array, count: int) -> list[Box]:
    """A ``count`` of boxes that fill space, with nearly equal ``shares`` (points,) of ``points``.

    Boxes are cut across the direction in which their points are spread farthest.
    """

    def cut(low: Array, high: Array, inside: Integers, count: int) -> list[Box]:
        weights = shares[inside]
        center = np.average(points[inside], axis=0, weights=weights)
        spread = np.average((points[inside] - center) ** 2, axis=0, weights=weights)
        axis = int(np.argmax(spread))
        places, index = np.unique(points[inside, axis], return_inverse=True)
        if count == 1 or len(places) == 1:
            return [(tuple(low.tolist()), tuple(high.tolist()))]
        fewer = count // 2
        reached = np.cumsum(np.bincount(index, weights))
        split = int(np.searchsorted(reached, reached[-1] * fewer / count))
        split = min(split, len(places) - 2)
        border = 0.5 * (places[split] + places[split + 1])
        below = index <= split
        split_high, split_low = high.copy(), low.copy()
        split_high[axis] = split_low[axis] = border
        return [
            *cut(low, split_high, inside[below], fewer),
            *cut(split_low, high, inside[~below], count - fewer),
        ]

    everywhere = np.full(points.shape[1], math.inf)
    return cut(-everywhere, everywhere, np.flatnonzero(shares > 0.0), count)


def is_stress(objective: Objective) -> bool:
    """Whether an objective is the largest stress, or a sum with it."""
    return any(isinstance(term, PeakStress) for _, term in objective._summands())


def _times(matrix: Array, stresses: Array) -> Array:
    """A matrix times stresses (3 or 6, points, coordinates)."""
    flat = stresses.reshape(len(stresses), -1)
    return np.asarray((matrix @ flat).reshape(stresses.shape))
