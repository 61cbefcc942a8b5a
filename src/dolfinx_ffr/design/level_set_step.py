# SPDX-License-Identifier: MIT
"""Explicit evolution of a level set under a velocity, with an upper bound on the volume.

One step moves phi at the knots by at most a CFL number times the knots' spacing h,

    phi <- phi + c h clip(v - Lambda m, -1, 1),        Lambda >= 0,

where v is the smoothed, scaled negative gradient of psi and m that of the volume. The multiplier
Lambda is the smallest for which the volume bound holds: zero where the bound is not active, because
less material may well be better when inertia is the load.

Velocities reach as far from the zero line as the smoothed Heaviside function and the kernel do.
Holes merge and vanish, but none opens within solid material farther away: a start design has more
holes than the final one will need, or none at all, which the volume bound then turns into an even
gray from which the gradient carves.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .. import validation
from .level_set import LevelSet
from .parametrization import VolumeBisection, check_volume
from .rbf import Wendland

__all__ = ["Evolution", "VelocityExtension"]

Array = NDArray[np.float64]


class VelocityExtension:
    """Carries derivatives from the neighbourhood of the boundary to the knots around.

    A derivative with respect to phi at the knots is smoothed with a positive definite kernel, so
    that the negative result is a descent direction.

    Args:
        levelset: Gives the knots.
        radius: Of the smoothing kernel [m]; by default that of the level set's kernel.
    """

    def __init__(self, levelset: LevelSet, radius: float | None = None) -> None:
        validation.instance("velocity extension: levelset", levelset, LevelSet, "a LevelSet")
        kernel = Wendland(levelset.radius if radius is None else radius)
        tree = cKDTree(levelset.knots)
        near = tree.sparse_distance_matrix(tree, kernel.support, output_type="ndarray")
        size = len(levelset.knots)
        self._matrix = scipy.sparse.csr_matrix(
            (kernel(near["v"]), (near["i"], near["j"])), shape=(size, size)
        )

    def __call__(self, phi_bar: Array) -> Array:
        """The extended derivative at the knots, given ``phi_bar`` (knots,)."""
        return np.asarray(self._matrix @ phi_bar)


class Evolution:
    """Explicit steps of a level set.

    Args:
        levelset: What moves.
        volume: Upper bound of the filled share of the body's area, in (0, 1].
        band: Phi is kept within this many spacings of its zero line, so that a hole or a strut of
            that size can vanish within that many steps.
        extension: Velocity extension; by default with its default radius.
        distance: Re-initialiser, from phi at the knots (knots,) to a signed distance at the knots;
            by default that from the boundary of the level set.

    Raises:
        ValueError: On every rank, if the bound is out of range or below the share of the regions
            that stay solid.
    """

    def __init__(
        self,
        levelset: LevelSet,
        volume: float,
        *,
        band: float = 3.0,
        extension: Callable[[Array], Array] | None = None,
        distance: Callable[[Array], Array] | None = None,
    ) -> None:
        validation.instance("evolution: levelset", levelset, LevelSet, "a LevelSet")
        domain = levelset.domain
        validation.number("evolution: band", band, above=0.0)
        check_volume(domain, volume)
        self.levelset = levelset
        #: The level set whose densities are analysed, and whose derivatives move the boundary
        self.analysed = levelset
        self.band = band * levelset.spacing
        self.bisection = VolumeBisection(volume)
        self.extension = extension or VelocityExtension(levelset)
        self.distance = distance or self._signed_distance
        self._cell_share = np.where(domain.design_cells, domain.cell_volumes, 0.0)

    def with_sharpness(self, sharpness: float, *, eroded: bool = False) -> Evolution:
        """The same steps of a level set whose projection has another ``sharpness``.

        Args:
            sharpness: Steepness of the projection.
            eroded: Whether what is analysed lies a little within the boundary, `LevelSet.eroded`;
                the volume bound is always that of the boundary itself.
        """
        other = copy(self)
        other.levelset = self.levelset.with_sharpness(sharpness)
        other.analysed = other.levelset.eroded if eroded else other.levelset
        return other

    def variables(self, phi: Array) -> Array:
        """The coefficients of a level set with ``phi`` (knots,) [m] at the knots."""
        return np.asarray(0.5 + 0.5 * np.clip(phi / self.band, -1.0, 1.0))

    def start(self, variables: Array) -> Array:
        """Phi at the knots of a start design, shrunk evenly until the volume bound holds.

        A design without a boundary becomes an even gray of the bound's volume.

        Args:
            variables: Of the start design, shape (knots,).
        """
        return self.reinitialize(self.band * (2.0 * np.asarray(variables) - 1.0))

    def _signed_distance(self, phi: Array) -> Array:
        """Phi whose mean by the level set's kernel is a signed distance near the boundary.

        The kernel smooths: a distance given as coefficients would shrink holes. What the mean lacks
        of the distance is added, which is nothing on the boundary itself.
        """
        levelset, variables = self.levelset, self.variables(phi)
        found = levelset.distance(variables, levelset.knots)
        if not np.all(np.isfinite(found)):
            return phi
        mean = 2.0 * self.band * levelset.level(variables)(levelset.knots)
        return np.asarray(phi + np.clip(found, -self.band, self.band) - mean)

    def reinitialize(self, phi: Array) -> Array:
        """The signed distance from the zero line of ``phi`` (knots,), within the bounds.

        It ends at the band, and is shrunk evenly until the volume bound holds.
        """
        return self.bounded(np.clip(self.distance(phi), -self.band, self.band))

    def bounded(self, phi: Array) -> Array:
        """``phi`` (knots,), shrunk evenly until the volume bound holds."""
        return self._bounded(lambda shift: phi - shift * self.levelset.spacing)[0]

    def step(self, phi: Array, gradient: Array, size: float) -> tuple[Array, float]:
        """Phi after one explicit step, and the multiplier of the volume bound.

        Args:
            phi: At the knots, shape (knots,) [m].
            gradient: dpsi/dx of the cells owned by this rank, shape (cells,), at the densities of
                the level set that is `analysed`.
            size: CFL number c: largest change of phi in spacings.

        Returns:
            New values at the knots, shape (knots,), and Lambda >= 0 in units of the scaled
            velocity.
        """
        variables = self.variables(phi)
        psi_bar = self.extension(self.analysed.pullback(variables, gradient))
        volume_bar = self.extension(self.levelset.pullback(variables, self._cell_share))
        near = np.abs(volume_bar) > 1e-3 * np.max(np.abs(volume_bar), initial=0.0)
        if not np.any(near):
            return phi.copy(), 0.0
        velocity = -psi_bar / _typical(psi_bar[near])
        removal = volume_bar / _typical(volume_bar[near])
        move = size * self.levelset.spacing

        def moved(multiplier: float) -> Array:
            return phi + move * np.clip(velocity - multiplier * removal, -1.0, 1.0)

        return self._bounded(moved)

    def _bounded(self, family: Callable[[float], Array]) -> tuple[Array, float]:
        """The first member of a family of shrinking designs that keeps the volume bound."""

        def volume(multiplier: float) -> float:
            x = self.levelset.density(self.variables(family(multiplier)))
            domain = self.levelset.domain
            return domain.sum(x * domain.cell_volumes) / domain.area

        multiplier = self.bisection.multiplier(volume)
        return family(multiplier), multiplier


def _typical(values: Array) -> float:
    """A size that most values stay below, and outliers do not set."""
    return float(np.percentile(np.abs(values), 80)) or 1.0
