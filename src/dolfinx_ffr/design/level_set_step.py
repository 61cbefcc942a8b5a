# SPDX-License-Identifier: MIT
"""Explicit evolution of a level set under a velocity, with an upper bound on the volume.

One step moves phi at the knots by at most a CFL number times the knots' spacing h,

    phi <- phi + c h clip(v - Lambda m, -1, 1),        Lambda >= 0,

where v is the smoothed, scaled negative gradient of psi and m the gradient of the volume. The
multiplier Lambda is the smallest for which the volume bound holds: zero if the bound is not active,
because less material may well be better when inertia is the load.

Holes merge and vanish, but none opens within solid material beyond the reach of the kernel: a start
design has more holes than the final one will need, or none at all, which the volume bound then
turns into an even gray from which the gradient carves.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy

import numpy as np
from scipy.spatial import cKDTree

from .. import validation
from ..arrays import Array
from .base import check_volume, filled_share, volume_multiplier
from .densities import check_neighbours
from .level_set import LevelSet
from .rbf import Wendland, kernel_matrix


class VelocityExtension:
    """Extends derivatives from the boundary to the knots in its neighbourhood.

    A derivative with respect to phi at the knots of ``levelset`` is smoothed by a positive definite
    kernel, so that the negative result is a descent direction. Its ``radius`` [m] is by default the
    radius of the level set's kernel.
    """

    def __init__(self, levelset: LevelSet, radius: float | None = None) -> None:
        validation.instance("velocity extension: levelset", levelset, LevelSet, "a LevelSet")
        kernel = Wendland(levelset.radius if radius is None else radius)
        sizes, reach = (levelset.size, levelset.size), kernel.support / levelset.spacing
        remedy = "take a smaller radius [m]"
        check_neighbours(levelset.domain, "velocity extension", sizes, reach, remedy)
        self._matrix = kernel_matrix(kernel, levelset.knots, cKDTree(levelset.knots))

    def __call__(self, phi_bar: Array) -> Array:
        """The extended derivative at the knots, given ``phi_bar`` (knots,)."""
        return np.asarray(self._matrix @ phi_bar)


class Evolution:
    """Explicit steps of a level set.

    Args:
        levelset: The level set.
        volume: Upper bound of the filled share of the body's area, in (0, 1].
        band: Number of spacings that bounds phi, so that a hole or a strut of that size can vanish
            within that many steps.
    """

    def __init__(self, levelset: LevelSet, volume: float, *, band: float = 3.0) -> None:
        validation.instance("evolution: levelset", levelset, LevelSet, "a LevelSet")
        domain = levelset.domain
        validation.number("evolution: band", band, above=0.0)
        check_volume(domain, volume)
        self.levelset = levelset
        #: The level set whose densities are evaluated, and whose derivatives move the boundary
        self.analysed = levelset
        self.band = band * levelset.spacing
        self.bound = volume  #: Of the filled share
        self.extension: Callable[[Array], Array] = VelocityExtension(levelset)
        self._cell_share = np.where(domain.design_cells, domain.cell_volumes, 0.0)

    def with_sharpness(self, sharpness: float, *, eroded: bool = False) -> Evolution:
        """The same steps with another ``sharpness``, and with psi of the ``eroded`` level set."""
        evolution = copy(self)
        evolution.levelset = self.levelset.with_sharpness(sharpness)
        evolution.analysed = evolution.levelset.eroded if eroded else evolution.levelset
        return evolution

    def variables(self, phi: Array) -> Array:
        """The coefficients of a level set with ``phi`` (knots,) [m] at the knots."""
        return np.asarray(0.5 + 0.5 * np.clip(phi / self.band, -1.0, 1.0))

    def start(self, variables: Array) -> Array:
        """Phi at the knots of the start ``variables`` (knots,), shrunk until the bound holds."""
        return self.reinitialize(self.band * (2.0 * np.asarray(variables) - 1.0))

    def _signed_distance(self, phi: Array) -> Array:
        """Phi whose mean by the level set's kernel is a signed distance near the boundary."""
        # the kernel smooths: a distance given as coefficients would shrink holes
        levelset, variables = self.levelset, self.variables(phi)
        distance = levelset.distance(variables, levelset.knots)
        if not np.all(np.isfinite(distance)):
            return phi
        mean = 2.0 * self.band * levelset.level(variables)(levelset.knots)
        return np.asarray(phi + np.clip(distance, -self.band, self.band) - mean)

    def reinitialize(self, phi: Array) -> Array:
        """The signed distance from the zero line of ``phi`` (knots,), within the bounds.

        It ends at the band, and is shrunk evenly until the volume bound holds.
        """
        return self.bounded(np.clip(self._signed_distance(phi), -self.band, self.band))

    def bounded(self, phi: Array) -> Array:
        """``phi`` (knots,), shrunk evenly until the volume bound holds."""
        return self._bounded(lambda shift: phi - shift * self.levelset.spacing)[0]

    def step(self, phi: Array, gradient: Array, size: float) -> tuple[Array, float]:
        """``phi`` (knots,) [m] after one explicit step, and the multiplier Lambda of the bound.

        The ``gradient`` is dpsi/dx of this rank's cells, shape (cells,), at the densities of the
        level set that is `analysed`, ``size`` the CFL number c, the largest change in spacings.
        """
        variables = self.variables(phi)
        psi_bar = self.extension(self.analysed.pullback(variables, gradient))
        volume_bar = self.extension(self.levelset.pullback(variables, self._cell_share))
        is_near = np.abs(volume_bar) > 1e-3 * np.max(np.abs(volume_bar), initial=0.0)
        if not np.any(is_near):
            return phi.copy(), 0.0
        velocity = -psi_bar / _typical(psi_bar[is_near])
        removal = volume_bar / _typical(volume_bar[is_near])
        move = size * self.levelset.spacing

        def moved(multiplier: float) -> Array:
            return phi + move * np.clip(velocity - multiplier * removal, -1.0, 1.0)

        return self._bounded(moved)

    def _bounded(self, family: Callable[[float], Array]) -> tuple[Array, float]:
        """The first member of a family of shrinking designs that satisfies the volume bound."""
        multiplier = volume_multiplier(
            lambda m: filled_share(self.levelset, self.variables(family(m))), self.bound
        )
        return family(multiplier), multiplier


def _typical(values: Array) -> float:
    """A size below which most values stay, whatever the outliers."""
    return float(np.percentile(np.abs(values), 80)) or 1.0
