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
from numpy.typing import NDArray

from .. import validation
from .level_set import LevelSet
from .parametrization import VolumeBisection, check_volume
from .rbf import RadialBasis, Wendland

__all__ = ["Evolution", "VelocityExtension"]

Array = NDArray[np.float64]


class VelocityExtension:
    """Carries derivatives from the neighbourhood of the zero line to the knots around.

    A derivative with respect to phi at the knots is smoothed with a positive definite kernel, so
    that the negative result is a descent direction for any basis of the level set.

    Args:
        levelset: Gives the knots.
        radius: Of the smoothing kernel [m]; by default three spacings.
    """

    def __init__(self, levelset: LevelSet, radius: float | None = None) -> None:
        self.levelset = validation.instance(
            "velocity extension: levelset", levelset, LevelSet, "a LevelSet"
        )
        kernel = Wendland(3.0 * levelset.spacing if radius is None else radius)
        if levelset.basis.kernel == kernel:
            self._matrix = None  # smoothing undoes the interpolation exactly
        else:
            self._matrix = RadialBasis(levelset.knots, kernel).matrix(levelset.knots)

    def __call__(self, coefficients_bar: Array) -> Array:
        """The extended derivative at the knots, given ``coefficients_bar`` (knots,)."""
        if self._matrix is None:
            return coefficients_bar
        return np.asarray(
            self._matrix @ self.levelset.basis.interpolate_transposed(coefficients_bar)
        )


class Evolution:
    """Explicit steps of a level set.

    Args:
        levelset: What moves.
        volume: Upper bound of the filled share of the body's area, in (0, 1].
        band: Phi is kept within this many spacings of its zero line, so that a hole or a strut of
            that size can vanish within that many steps.
        extension: Velocity extension; by default with its default radius.
        distance: Re-initialiser, from phi at the knots (knots,) to a signed distance at the knots;
            by default `LevelSet.signed_distance`.

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
        self.band = band * levelset.spacing
        self.bisection = VolumeBisection(volume)
        self.extension = extension or VelocityExtension(levelset)
        self.distance = distance or levelset.signed_distance
        self._cell_share = np.where(domain.design_cells, domain.cell_volumes, 0.0)

    def with_width(self, width: float) -> Evolution:
        """The same steps of a level set whose Heaviside function has another ``width`` [m]."""
        other = copy(self)
        other.levelset = self.levelset.with_width(width)
        return other

    def start(self, coefficients: Array) -> Array:
        """Phi at the knots of a start design, shrunk evenly until the volume bound holds.

        A design without a zero line becomes an even gray of the bound's volume.

        Args:
            coefficients: Of the start design, shape (knots,).
        """
        return self.reinitialize(self.levelset.at_knots(coefficients))

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
            gradient: dpsi/dx of the cells owned by this rank, shape (cells,).
            size: CFL number c: largest change of phi in spacings.

        Returns:
            New values at the knots, shape (knots,), and Lambda >= 0 in units of the scaled
            velocity.
        """
        coefficients = self.levelset.interpolate(phi)
        psi_bar = self.extension(self.levelset.pullback(coefficients, gradient))
        volume_bar = self.extension(self.levelset.pullback(coefficients, self._cell_share))
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
            return self.levelset.volume(self.levelset.interpolate(family(multiplier)))

        multiplier = self.bisection.multiplier(volume)
        return family(multiplier), multiplier


def _typical(values: Array) -> float:
    """A size that most values stay below, and outliers do not set."""
    return float(np.percentile(np.abs(values), 80)) or 1.0
