# SPDX-License-Identifier: MIT
"""Designs: how bounded variables, alike on every rank, become the density of a body's elements.

`DensityDesign` has one variable for each designed element,

    variables z -> filter -> projection -> density x,

and `LevelSetDesign` the coefficients of a `LevelSet`. Both become sharper in stages, and hand
derivatives back by the exact transpose.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .density_filter import DensityFilter, HeavisideProjection
from .domain import Domain
from .evolution import VolumeBisection
from .levelset import LevelSet

__all__ = ["DensityDesign", "Design", "LevelSetDesign", "shrunk"]

Array = NDArray[np.float64]


class Design(Protocol):
    """From bounded variables to the density of one body, and back."""

    domain: Domain  #: of the body
    lower: float  #: smallest value of a variable
    upper: float  #: largest value of a variable
    stages: int  #: number of stages, each sharper than the one before

    @property
    def width(self) -> float:
        """Width of the smoothed step from void to solid in the present stage."""
        ...

    def begin(self, stage: int) -> None:
        """Become as sharp as in ``stage``, counted from 0."""
        ...

    def check(self, start: ArrayLike) -> Array:
        """Return ``start`` as variables within the bounds.

        Raises:
            ValueError: on every rank, if it has another size or is not finite.
        """
        ...

    def density(self, variables: Array) -> Array:
        """Return the density of this rank's cells, shape (cells,), at ``variables``."""
        ...

    def pullback(self, variables: Array, x_bar: Array) -> Array:
        """Return the transpose of the derivative of `density`, bit-identical on every rank.

        Args:
            variables: where.
            x_bar: derivative with respect to the density of this rank's cells, shape (cells,).
        """
        ...

    def distance(self, variables: Array) -> Array | None:
        """Return the distance of this rank's cells from the boundary at ``variables``, or None."""
        ...

    def identity(self) -> dict[str, Any]:
        """Return what a checkpoint and the run that reads it must have in common."""
        ...


class DensityDesign:
    """One variable in [0, 1] for each designed element, filtered and projected (SIMP).

    Elements that are not designed stay solid, and enter the means of their neighbours as such.

    Args:
        domain: the body.
        radius: of the filter [m]; by default two and a half mean elements. With shorter ones
            struts may hang together by corners of elements, which looks stiffer than it is.
        betas: steepness of the projection, one a stage.
        eta: threshold of the projection.

    Raises:
        ValueError: on every rank, if a number is out of range.
    """

    lower, upper = 0.0, 1.0

    def __init__(
        self,
        domain: Domain,
        *,
        radius: float | None = None,
        betas: Sequence[float] = (2.0, 4.0, 8.0, 16.0, 32.0),
        eta: float = 0.5,
    ) -> None:
        if len(betas) == 0:
            raise ValueError("density design: betas = () must have a steepness for each stage")
        self.domain = domain
        element = float(np.sqrt(domain.area / domain.n_cells_global))
        self.filter = DensityFilter(domain, 2.5 * element if radius is None else radius)
        #: of the stages
        self.projections = [HeavisideProjection(float(beta), eta) for beta in betas]
        self.stages = len(self.projections)
        self.projection = self.projections[0]  #: of the present stage
        self._designed = domain.everywhere(domain.design_cells)

    @property
    def width(self) -> float:
        """Inverse of the steepness of the projection in the present stage."""
        return 1.0 / self.projection.beta

    def begin(self, stage: int) -> None:
        """Become as sharp as in ``stage``, counted from 0."""
        self.projection = self.projections[stage]

    def even(self, value: float) -> Array:
        """Return variables that all have the same ``value``, shape (designed cells,)."""
        return np.full(int(np.count_nonzero(self._designed)), float(value))

    def check(self, start: ArrayLike) -> Array:
        """Return ``start`` as variables of shape (designed cells,), within [0, 1].

        Raises:
            ValueError: on every rank, if it has another size or is not finite.
        """
        return _check(start, int(np.count_nonzero(self._designed)), "designed cell", self)

    def density(self, variables: Array) -> Array:
        """Return the density of this rank's cells, shape (cells,).

        Args:
            variables: one for each designed cell of all ranks in the order of
                `Domain.everywhere`, shape (designed cells,), in [0, 1].
        """
        x = np.where(self._designed, self.projection(self._means(variables)), 1.0)
        return self.domain.owned(x)

    def pullback(self, variables: Array, x_bar: Array) -> Array:
        """Return the transpose of the derivative of `density`, bit-identical on every rank.

        Args:
            variables: where, shape (designed cells,).
            x_bar: derivative with respect to the density of this rank's cells, shape (cells,).

        Returns:
            Derivative with respect to the variables, shape (designed cells,).
        """
        bar = np.where(self._designed, self.domain.everywhere(x_bar), 0.0)
        means_bar = self.projection.pullback(self._means(variables), bar)
        return np.asarray(self.filter.pullback(means_bar)[self._designed])

    def distance(self, variables: Array) -> None:
        """Return None: at any ``variables`` there is no line between void and solid."""
        return None

    def identity(self) -> dict[str, Any]:
        """Return what a checkpoint and the run that reads it must have in common."""
        return {
            "cells": self.domain.n_cells_global,
            "radius": self.filter.radius,
            "betas": [projection.beta for projection in self.projections],
            "eta": self.projection.eta,
        }

    def _means(self, variables: Array) -> Array:
        values = np.ones(len(self._designed))
        values[self._designed] = variables
        return self.filter(values)


class LevelSetDesign:
    """The coefficients of a level set, bounded.

    Args:
        levelset: of radial basis functions; keeps the width of the last stage.
        widths: half-widths of the smoothed Heaviside function in units of a mean element, one a
            stage.
        bound: largest size of a coefficient, in knot spacings.

    Raises:
        ValueError: if a number is out of range.
    """

    def __init__(
        self,
        levelset: LevelSet,
        *,
        widths: Sequence[float] = (1.0, 0.6, 0.35),
        bound: float = 1.0,
    ) -> None:
        if len(widths) == 0 or not all(0.0 < w < np.inf for w in widths):
            raise ValueError(
                f"level set design: widths = {tuple(widths)} must be positive and finite"
            )
        if not 0.0 < bound < np.inf:
            raise ValueError(f"level set design: bound = {bound} must be positive and finite")
        self.levelset = levelset
        self.domain = levelset.domain
        self.stages = len(widths)
        self.upper = bound * levelset.spacing
        self.lower = -self.upper
        self._widths = [float(w) for w in widths]
        self.begin(0)

    @property
    def width(self) -> float:
        """Half-width of the smoothed Heaviside function in the present stage [m]."""
        return self.levelset.width

    def begin(self, stage: int) -> None:
        """Become as sharp as in ``stage``, counted from 0."""
        self.levelset.width = self.levelset.element * self._widths[stage]

    def check(self, start: ArrayLike) -> Array:
        """Return ``start`` as coefficients of shape (knots,), within the bounds.

        Raises:
            ValueError: on every rank, if it has another size or is not finite.
        """
        return _check(start, len(self.levelset.knots), "knot", self)

    def density(self, variables: Array) -> Array:
        """Return the density of this rank's cells, shape (cells,), at ``variables`` (knots,)."""
        return self.levelset.fill_fraction(variables)

    def pullback(self, variables: Array, x_bar: Array) -> Array:
        """Return the transpose of the derivative of `density`, bit-identical on every rank.

        Args:
            variables: coefficients, shape (knots,).
            x_bar: derivative with respect to the density of this rank's cells, shape (cells,).
        """
        return self.levelset.pullback(variables, x_bar)

    def distance(self, variables: Array) -> Array:
        """Return the distance of this rank's cells from the zero line at ``variables``."""
        return self.levelset.boundary_distance(variables)

    def identity(self) -> dict[str, Any]:
        """Return what a checkpoint and the run that reads it must have in common."""
        return {
            "knots": self.levelset.knots,
            "kernel": repr(self.levelset.basis.kernel),
            "cells": self.domain.n_cells_global,
            "widths": self._widths,
            "bound": self.upper,
        }


def shrunk(design: Design, variables: Array, volume: float) -> Array:
    """Return variables lowered evenly until the volume bound holds.

    Args:
        design: gives the volume.
        variables: within the bounds of the design.
        volume: upper bound of the filled share of the body.

    Raises:
        ValueError: on every rank, if the bound is out of range, or the body exceeds it even with
            all variables at their lower bound.
    """
    if not 0.0 < volume <= 1.0:
        raise ValueError(f"design: volume = {volume} must be a share in (0, 1]")
    domain = design.domain
    solid = domain.sum(domain.cell_volumes * ~domain.design_cells) / domain.area
    if volume <= solid * (1.0 + 1e-9):
        raise ValueError(
            f"design: volume = {volume:.4g} leaves nothing to design: the solid regions alone fill "
            f"{solid:.4g} of the body"
        )

    def lowered(shift: float) -> Array:
        range_ = design.upper - design.lower
        return np.asarray(np.clip(variables - shift * range_, design.lower, design.upper))

    def filled(shift: float) -> float:
        x = design.density(lowered(shift))
        return domain.sum(x * domain.cell_volumes) / domain.area

    return lowered(VolumeBisection(volume).multiplier(filled))


def _check(start: ArrayLike, size: int, each: str, design: Design) -> Array:
    variables = np.asarray(start, dtype=np.float64)
    if variables.shape != (size,) or not np.all(np.isfinite(variables)):
        raise ValueError(
            f"design: expected {size} finite variables, one a {each}, and got an array of shape "
            f"{variables.shape}"
            + ("" if np.all(np.isfinite(variables)) else " with NaN or infinity")
        )
    return np.clip(variables, design.lower, design.upper)
