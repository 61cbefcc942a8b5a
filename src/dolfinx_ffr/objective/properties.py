# SPDX-License-Identifier: MIT
"""Objectives of a body alone, which need no simulation: mass, volume, natural frequency."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from .. import validation
from ..arrays import Array, Mask
from ..body import QUARTER_TURN, VolumeIntegrals, axial, cross_matrix, theta
from ..mechanism import PointMass
from .base import DensityField, Derivatives, Inventory, Objective, Response, no_body, no_marker

#: Relative distance of two eigenvalues below which they count as equal.
_EQUAL = 1e-6
#: Displacement of a pin, relative to others, that is round-off, as the frame holds the pin
_ROUND_OFF = 1e-9


class _WithoutTrajectory(Objective):
    """An objective of a body alone, for which nothing is simulated."""

    @property
    def needs_trajectory(self) -> bool:
        return False


@dataclass(frozen=True)
class Mass(_WithoutTrajectory):
    """Mass of a body [kg], without the point masses of the mechanism.

    Attributes:
        body: Name of the body.
    """

    unit: ClassVar[str] = "kg"

    body: str

    def __post_init__(self) -> None:
        validation.name("mass: body", self.body)

    def evaluate(self, response: Response) -> float:
        return self._body(response).mass

    def derivatives(self, response: Response) -> Derivatives:
        bar = replace(self._body(response).zeros_like(), mass=1.0)
        return Derivatives(integrals={self.body: bar})

    def validate(self, inventory: Inventory) -> None:
        if self.body not in inventory.modes:
            raise no_body("mass", self.body, inventory.modes)

    def _body(self, response: Response) -> VolumeIntegrals:
        self.validate(response.inventory)
        return response.bodies[self.body]


@dataclass(frozen=True, eq=False)
class Volume(_WithoutTrajectory):
    """Filled share of the area of a body with a density, or of a region of it, between 0 and 1.

        psi = sum_cells area x / sum_cells area,    in space with the volumes of the cells.

    It is a function of the densities alone. :class:`Mass` is similar and needs no density.

    Several regions, each with a :class:`Constraint` of its own, bound where the material goes.
    Cells that are not designed count: solid ones as filled, void ones as empty. Of a part that is
    verified it is the share of the body, or of its region, that the part fills.

    Raises:
        ValueError: If the body has no density, or the region does not fit its cells or holds none
            of them, when the problem is made.

    Attributes:
        body: Name of the body.
        region: Cells that count: a predicate on coordinates of shape (3, cells), the
            centroids in the undeformed body [m], or a mask over the cells of this rank, shape
            (cells,). Regions cut at a line so share no cell and leave none out. None takes all.
    """

    body: str
    region: Callable[[Array], ArrayLike] | Mask | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        validation.name("volume: body", self.body)
        if self.region is not None and not callable(self.region):
            mask = np.asarray(self.region)
            if mask.dtype != np.bool_ or mask.ndim != 1:
                raise TypeError(
                    "volume: the region must be a predicate, as lambda x: x[0] < 0.1, or a mask "
                    "over the cells of the rank, but it is "
                    f"{validation.described(self.region)}"
                )

    def validate(self, inventory: Inventory) -> None:
        self._areas(self._density(inventory))

    def evaluate(self, response: Response) -> float:
        density = self._density(response)
        areas, total = self._areas(density)
        return density.sum(density.values * (areas / total))

    def derivatives(self, response: Response) -> Derivatives:
        density = self._density(response)
        areas, total = self._areas(density)
        fixed = 0.0 if density.whole else self.evaluate(response)
        by_areas = np.where(self._chosen(density), density.values - fixed, 0.0) / total
        return Derivatives(densities={self.body: areas / total}, areas={self.body: by_areas})

    def _density(self, of: Inventory | Response) -> DensityField:
        """Density of the body."""
        if self.body not in of.densities:
            raise ValueError(
                f"volume of body {self.body!r}, but the bodies with a density are "
                f"{sorted(of.densities)}; Mass is similar and needs no density"
            )
        return of.densities[self.body]

    def _areas(self, density: DensityField) -> tuple[Array, float]:
        """Area of each cell, (cells,), zero outside of the region, and the area of the region."""
        areas = np.where(self._chosen(density), density.areas, 0.0)
        full = density.whole
        total = full.sum(full.areas * self._chosen(full)) if full else density.sum(areas)
        if not total > 0.0:
            raise ValueError(
                f"volume of body {self.body!r}: its region holds no cell; the centroids of cells, "
                "in metres and in the coordinates of the mesh, are what a predicate sees"
            )
        return areas, total

    def _chosen(self, density: DensityField) -> Mask:
        """Which cells lie in the region, shape (cells,)."""
        n, region = len(density.areas), self.region
        if region is None:
            return np.ones(n, dtype=bool)
        selected = region
        if callable(region):
            points = np.zeros((3, n))
            points[: density.centroids.shape[1]] = density.centroids.T
            selected = np.asarray(region(points))
        mask = np.asarray(selected)
        if density.whole and not callable(region):  # by the nearest cell of the designed body
            full = density.whole
            cells = cKDTree(np.concatenate(full.gathered(full.centroids)))
            return np.concatenate(full.gathered(mask))[cells.query(density.centroids)[1]]
        if mask.dtype != np.bool_ or mask.shape != (n,):
            raise ValueError(
                f"volume of body {self.body!r}: the region must say True or False for each of the "
                f"rank's {n} cells, but it gives an array of shape {mask.shape} of {mask.dtype}"
            )
        return mask


@dataclass(frozen=True)
class Frequency(_WithoutTrajectory):
    """Natural frequency of one body from its reduced matrices [Hz].

        K v_i = lambda_i M v_i,     psi = sqrt(lambda) / (2 pi),
        1 / lambda = mean of 1 / lambda_i,   i = number, ..., number + cluster - 1

    By default the body's frame is fixed, M = G without its first row and column. In a tangent frame
    the body is clamped at one interface and free otherwise; in a chord frame it is hinged at one
    interface while the other may slide along the chord. (The basis of the reduction has others,
    with all interfaces fixed: `Evaluation.fixed_interface_frequencies`.) With ``free`` nothing is
    fixed: M is the mass matrix of the body with its frame, rigid-body modes are left out, and the
    frame does not matter. Maximising it removes material from the interfaces, whose mass only
    lowers it, up to a torn design; a frequency of the held body needs the interfaces.

    The rest of the mechanism has no influence, except point masses if ``point_masses`` is set.
    Bearings that the frame does not contain are ``pinned`` markers.

    A single frequency has a kink where it equals its neighbour. The inverse mean of a cluster has
    none as long as other frequencies differ from the frequencies of the cluster; for two to four it
    is close to the lowest.

    Warns:
        UserWarning: If the derivative is asked for where the cluster touches its neighbour.

    Attributes:
        body: Name of the body.
        number: Number of the first frequency that counts, from 1.
        cluster: How many frequencies count.
        free: Leave the body's frame free instead of held.
        point_masses: Count the mechanism's point masses that are fixed to the body.
        pinned: Markers that do not move in the body's frame, but may turn; not of a free body.
    """

    unit: ClassVar[str] = "Hz"

    body: str
    number: int = 1
    cluster: int = 1
    free: bool = False
    point_masses: bool = False
    pinned: Sequence[str] = ()

    def __post_init__(self) -> None:
        validation.name("frequency: body", self.body)
        validation.integer("frequency: number", self.number, least=1)
        validation.integer("frequency: cluster", self.cluster, least=1)
        validation.flag("frequency: free", self.free)
        validation.flag("frequency: point_masses", self.point_masses)
        object.__setattr__(
            self, "pinned", tuple(validation.names("frequency: pinned", self.pinned))
        )
        if self.free and self.pinned:
            raise ValueError(
                "frequency: a body is either free or pinned; give free=True or pinned=[...], not "
                "both"
            )

    def evaluate(self, response: Response) -> float:
        eigenvalues, _, chosen = self._eigenpairs(response)
        return math.sqrt(1.0 / float(np.mean(1.0 / eigenvalues[chosen]))) / (2.0 * math.pi)

    def derivatives(self, response: Response) -> Derivatives:
        eigenvalues, vectors, chosen = self._eigenpairs(response)
        self._warn_of_neighbours(eigenvalues, chosen)
        lambdas, v = eigenvalues[chosen], vectors[:, chosen]
        body = response.bodies[self.body]
        mean = 1.0 / np.mean(1.0 / lambdas)
        # d psi = psi / (2 lambda) d lambda, d lambda_i = v_i . (dK - lambda_i dM) v_i
        psi = math.sqrt(mean) / (2.0 * math.pi)
        weights = 0.5 * psi * mean / (self.cluster * lambdas**2)
        K = (weights * v) @ v.T
        M = -(weights * lambdas * v) @ v.T
        bar = self._bar(body, K, M)
        if self.pinned:
            bar = self._with_pins(bar, self._loaded(response), lambdas, v, weights)
        for point in self._points(response):
            bar = body.point_mass_pullback(bar, point.marker[1], point.mass)
        return Derivatives(integrals={self.body: bar})

    def validate(self, inventory: Inventory) -> None:
        if self.body not in inventory.modes:
            raise no_body("frequency", self.body, inventory.modes)
        markers = inventory.markers[self.body]
        for marker in self.pinned:
            if marker not in markers:
                raise no_marker("frequency", marker, self.body, markers)
        count, highest = inventory.modes[self.body], self.number - 1 + self.cluster
        if highest > count:
            if count == 0:
                raise ValueError(
                    f"frequency: body {self.body!r} is rigid and has no frequency; give a flexible "
                    "body"
                )
            several = f"frequencies {self.number} to {highest}"
            raise ValueError(
                f"frequency: body {self.body!r} has {count} elastic coordinates, too few for "
                f"{several if self.cluster > 1 else f'number {highest}'}; give it more modes"
            )

    def _eigenpairs(self, response: Response) -> tuple[Array, Array, slice]:
        """Ascending eigenvalues, M-orthonormal eigenvectors, and the places of the cluster."""
        self.validate(response.inventory)
        body = self._loaded(response)
        n = 3 * body.dimension - 3 if self.free else 0  # rigid-body modes, which come first
        lowest = n + self.number - 1
        M = body.mass_matrix()[-n - body.modes :, -n - body.modes :]
        K = np.zeros_like(M)
        K[n:, n:] = body.K
        # motions that the pins leave free, in columns
        basis = (
            scipy.linalg.null_space(self._pins(body), _ROUND_OFF) if self.pinned else np.eye(len(M))
        )
        if lowest + self.cluster > basis.shape[1]:
            raise ValueError(
                f"frequency: body {self.body!r} has {basis.shape[1]} elastic coordinates besides "
                "those that its pins hold, too few; give it more modes"
            )
        K, M = basis.T @ K @ basis, basis.T @ M @ basis
        eigenvalues, vectors = scipy.linalg.eigh(0.5 * (K + K.T), 0.5 * (M + M.T))
        if not eigenvalues[lowest] > 1e-12 * eigenvalues[-1]:
            raise ValueError(
                f"frequency: frequency {self.number} of body {self.body!r} is zero; its stiffness "
                "is singular"
            )
        return eigenvalues, basis @ vectors, slice(lowest, lowest + self.cluster)

    def _points(self, response: Response) -> list[PointMass]:
        """Point masses of the body that count."""
        if not self.point_masses:
            return []
        if response.point_masses is None:
            raise ValueError(
                "frequency: the response does not contain the point masses of the mechanism"
            )
        points = [point for point in response.point_masses if point.marker[0] == self.body]
        markers = response.bodies[self.body].markers
        for point in points:
            if point.marker[1] not in markers:
                raise no_marker("point mass", point.marker[1], self.body, markers)
        return points

    def _loaded(self, response: Response) -> VolumeIntegrals:
        """Integrals of the body with the point masses that count."""
        body = response.bodies[self.body]
        for point in self._points(response):
            body = body.with_point_mass(point.marker[1], point.mass)
        return body

    def _pins(self, body: VolumeIntegrals) -> Array:
        """Displacements of the pinned markers by elastic coordinates, (2 or 3 each, modes)."""
        return np.vstack([body.markers[marker].displacement for marker in self.pinned])

    def _with_pins(
        self, bar: VolumeIntegrals, body: VolumeIntegrals, lambdas: Array, v: Array, weights: Array
    ) -> VolumeIntegrals:
        """Add the derivatives by the displacements of pinned markers to ``bar``.

        Pins that hold D v = 0 by forces p, (K - lambda M) v + D' p = 0, add 2 p . dD v to d lambda.
        """
        residual = body.K @ v - body.mass_matrix()[-body.modes :, -body.modes :] @ v * lambdas
        forces = -np.linalg.lstsq(self._pins(body).T, residual, rcond=_ROUND_OFF)[0]
        pin_bars = np.split(2.0 * (weights * forces) @ v.T, len(self.pinned))
        markers = dict(bar.markers)
        for name, pin_bar in zip(self.pinned, pin_bars, strict=True):
            markers[name] = replace(
                markers[name], displacement=markers[name].displacement + pin_bar
            )
        return replace(bar, markers=markers)

    def _warn_of_neighbours(self, eigenvalues: Array, chosen: slice) -> None:
        start, stop, rigid = chosen.start, chosen.stop, chosen.start - self.number + 1
        for inside, outside in ((start, start - 1), (stop - 1, stop)):
            if not rigid <= outside < eigenvalues.size:
                continue
            if abs(eigenvalues[outside] - eigenvalues[inside]) < _EQUAL * eigenvalues[inside]:
                warnings.warn(
                    f"frequency: frequencies {inside + 1 - rigid} and {outside + 1 - rigid} of "
                    f"body {self.body!r} are equal, but the objective contains only one of them, "
                    "so that it has no derivative; enlarge the cluster",
                    stacklevel=4,
                )

    def _bar(self, body: VolumeIntegrals, K: Array, M: Array) -> VolumeIntegrals:
        """Pull derivatives by K and M, (n, n) each, back to the integrals of a body."""
        bar, n = body.zeros_like(), len(M) - body.modes
        bar.K[:] = K[n:, n:]
        if bar.P is not None:
            return _bar_in_space(bar, M)
        bar.G[1:, 1:] = M[n:, n:]
        if not self.free:
            return bar
        bar.S[0] = 2.0 * QUARTER_TURN.T @ M[:2, 2]
        bar.S[1:] = 2.0 * M[3:, :2]
        bar.G[0, 0] = M[2, 2]
        bar.N[0, 1:] = M[2, 3:]
        bar.N[1:, 0] = -M[2, 3:]
        return replace(bar, mass=float(np.trace(M[:2, :2])))


def _bar_in_space(bar: VolumeIntegrals, M: Array) -> VolumeIntegrals:
    """Pull derivatives by the mass matrix of a body in space, or by G, back to its integrals.

    ``M`` is (6 + modes, 6 + modes), or (modes, modes) of a body that is held.
    """
    n_rigid = len(M) - bar.modes
    S, P = np.zeros_like(bar.S), np.zeros((*bar.G.shape, 3, 3))
    P[1:, 1:] = np.multiply.outer(M[n_rigid:, n_rigid:], np.eye(3))
    mass = 0.0
    if n_rigid:
        mass = float(np.trace(M[:3, :3]))
        # the factor is 2 as S stands in `mass_matrix` above and below the diagonal
        S[0] = 2.0 * axial(M[3:6, :3])
        S[1:] = 2.0 * M[6:, :3]
        P[0, 0] = theta(M[3:6, 3:6])
        for j, row in enumerate(M[6:, 3:6], start=1):
            P[j, 0] = cross_matrix(row)
            P[0, j] = P[j, 0].T
    return replace(bar, mass=mass, S=S, P=P)
