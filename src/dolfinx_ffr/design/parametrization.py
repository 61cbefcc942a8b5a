# SPDX-License-Identifier: MIT
"""Designs: how bounded variables, alike on every rank, become the density of a body's elements.

`DensityDesign` has one variable for each designed element,

    variables z -> filter -> projection -> density x,

and a `LevelSet` one for each knot. Both become sharper along a run, and hand derivatives back by
the exact transpose.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation
from ..fem import Domain
from .density_field import density_field
from .density_filter import DensityFilter, HeavisideProjection

__all__ = [
    "DensityDesign",
    "Design",
    "VolumeBisection",
    "check_volume",
    "finite_vector",
    "shrunk",
    "steepness",
]

Array = NDArray[np.float64]


#: Steepness of the projection of a finished design: a step within a fifth of an element with the
#: shortest kernel, and in proportion to its radius
SHARP = 32.0
#: Progress between which the projection becomes steeper, by the same factor each iteration: time
#: before it to find the topology, and after it to find the best crisp boundary
SHARPENING = (0.05, 0.55)


def steepness(progress: float) -> float:
    """Steepness of the projection: 1 at the beginning, 32 from a progress of 0.55 on.

    Args:
        progress: In [0, 1].

    Raises:
        ValueError: If it is out of range.
    """
    validation.number("design: progress", progress, least=0.0, most=1.0)
    begin, end = SHARPENING
    return float(SHARP ** min(max((progress - begin) / (end - begin), 0.0), 1.0))


class Design(ABC):
    """From bounded variables to the density of one body, and back.

    A design never changes: the sharper one of a later iteration is another object.
    """

    domain: Domain  #: Of the body
    lower: float  #: Smallest value of a variable
    upper: float  #: Largest value of a variable
    size: int  #: Number of variables
    each: ClassVar[str]  #: What there is one variable for
    sharpness: float  #: Steepness of the step from void to solid; 1 is open, 32 is crisp
    #: Whether a density is the share of its element that the boundary encloses
    fills: ClassVar[bool] = False

    @abstractmethod
    def at(self, progress: float) -> Design:
        """The design as sharp as at a ``progress`` between 0, the start, and 1, the end."""

    @property
    def nominal(self) -> Design:
        """The design as it is made, where another one is analysed in its place, see `LevelSet`."""
        return self

    @abstractmethod
    def density(self, variables: Array) -> Array:
        """The density of this rank's cells, shape (cells,), at ``variables`` (size,)."""

    @abstractmethod
    def pullback(self, variables: Array, x_bar: Array) -> Array:
        """The transpose of the derivative of `density`, bit-identical on every rank.

        Args:
            variables: Where, shape (size,).
            x_bar: Derivative with respect to the density of this rank's cells, shape (cells,).

        Returns:
            Derivative with respect to the variables, shape (size,).
        """

    @abstractmethod
    def identity(self) -> dict[str, Any]:
        """What a checkpoint and the run that reads it must have in common."""

    @abstractmethod
    def even(self, value: float = 0.5) -> Array:
        """Variables that all have the same ``value``, shape (size,)."""

    @abstractmethod
    def level(self, variables: Array) -> Callable[[Array], Array]:
        """The field whose zero line bounds the material at ``variables``.

        Collective; what it returns takes positions (n, dimension) [m] and gives (n,) numbers,
        positive in the material, on any rank alone.
        """

    def penalty(self, variables: Array) -> tuple[float, Array]:
        """What is added to log psi at ``variables``, and its derivative, shape (size,)."""
        return 0.0, np.zeros(self.size)

    def begin(self, start: ArrayLike) -> Array:
        """The variables from which moving asymptotes take up a ``start``, shape (size,)."""
        return self.check(start)

    def distance(self, variables: Array) -> Array | None:
        """The distance of this rank's cells from the boundary at ``variables``, or None."""
        return None

    def check(self, start: ArrayLike) -> Array:
        """``start`` as variables of shape (size,), within the bounds.

        Raises:
            ValueError: On every rank, if it has another size or is not finite.
        """
        variables = finite_vector(start, self.size, "design", f"variables, one a {self.each}")
        return np.clip(variables, self.lower, self.upper)


class DensityDesign(Design):
    """One variable in [0, 1] for each designed element, filtered and projected (SIMP).

    Elements that are not designed stay solid or void, and enter the means of their neighbours so.
    Variables have the order of `Domain.everywhere`.

    Args:
        domain: The body.
        radius: Of the filter [m]; by default two and a half mean elements. With shorter ones
            struts may hang together by corners of elements, which looks stiffer than it is. Zero
            filters nothing.
        eta: Threshold of the projection.

    Raises:
        ValueError: On every rank, if a number is out of range.
    """

    each: ClassVar[str] = "designed cell"
    lower, upper = 0.0, 1.0

    def __init__(
        self,
        domain: Domain,
        *,
        radius: float | None = None,
        eta: float = 0.5,
    ) -> None:
        self.domain = validation.instance("density design: domain", domain, Domain, "a Domain")
        self.filter = DensityFilter(domain, 2.5 * domain.cell_size if radius is None else radius)
        #: From means to densities
        self.projection = HeavisideProjection(SHARP, eta)
        self._designed = domain.everywhere(domain.design_cells)
        self._passive = domain.everywhere(domain.passive_density)
        self.size = int(np.count_nonzero(self._designed))

    @property
    def sharpness(self) -> float:  # type: ignore[override]
        """Steepness of the projection."""
        return self.projection.beta

    def at(self, progress: float) -> DensityDesign:
        """The design as sharp as at a ``progress``."""
        other = copy(self)
        other.projection = HeavisideProjection(steepness(progress), self.projection.eta)
        return other

    def even(self, value: float = 0.5) -> Array:
        """Variables that all have the same ``value`` in [0, 1], shape (designed cells,)."""
        return np.full(
            self.size, validation.number("density design: value", value, least=0, most=1)
        )

    def density(self, variables: Array) -> Array:
        """The projected means of the ``variables``."""
        x = np.where(self._designed, self.projection(self._means(variables)), self._passive)
        return self.domain.owned(x)

    def pullback(self, variables: Array, x_bar: Array) -> Array:
        """The transposes of projection and filter at ``variables``, applied to ``x_bar``."""
        bar = np.where(self._designed, self.domain.everywhere(x_bar), 0.0)
        means_bar = self.projection.pullback(self._means(variables), bar)
        return np.asarray(self.filter.pullback(means_bar)[self._designed])

    def level(self, variables: Array) -> Callable[[Array], Array]:
        """Where a smooth mean of the densities at ``variables`` is one half (`density_field`)."""
        return density_field(self.domain, self.density(variables))

    def identity(self) -> dict[str, Any]:
        """Cells, filter and projections."""
        return {
            "cells": self.domain.n_cells_global,
            "radius": self.filter.radius,
            "eta": self.projection.eta,
        }

    def _means(self, variables: Array) -> Array:
        values = self._passive.copy()
        what = "density design: variables"
        values[self._designed] = validation.real_array(what, variables, (self.size,))
        return self.filter(values)


@dataclass(frozen=True)
class VolumeBisection:
    """Smallest multiplier for which a volume stays below its bound.

    Args:
        bound: Upper bound of the volume (any unit; here a share of the body's area).
        tolerance: How far below the bound the volume may end, in units of the bound.

    Raises:
        ValueError: If the bound is not positive.
    """

    bound: float
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        """Check the bound."""
        validation.number("volume bound", self.bound, above=0.0)
        validation.number("volume bisection: tolerance", self.tolerance, least=0.0, below=1.0)

    def multiplier(self, volume: Callable[[float], float]) -> float:
        """The smallest Lambda >= 0 with volume(Lambda) <= bound.

        Args:
            volume: Falling function of the multiplier.

        Raises:
            ValueError: If no multiplier brings the volume below its bound.
        """
        if volume(0.0) <= self.bound:
            return 0.0
        low, high = 0.0, 1.0
        while volume(high) > self.bound:
            low, high = high, 2.0 * high
            if high > 1e12:
                raise ValueError(
                    f"the volume stays at {volume(high):.6g}, above its bound {self.bound:.6g}, "
                    "whatever the multiplier: raise the bound or shrink the solid regions"
                )
        for _ in range(200):
            middle = 0.5 * (low + high)
            found = volume(middle)
            if found > self.bound:
                low = middle
            else:
                high = middle
                if found >= self.bound * (1.0 - self.tolerance):
                    break
            if high - low <= 1e-14 * high:
                break
        return high


def check_volume(domain: Domain, volume: float) -> None:
    """Refuse a volume bound that leaves nothing to design.

    Args:
        domain: The body.
        volume: Upper bound of the filled share of its area, in space of its volume.

    Raises:
        ValueError: On every rank, if it is no share in (0, 1], or not above that of the cells that
            stay solid.
    """
    validation.number("design: volume", volume, above=0.0, most=1.0)
    solid = domain.sum(domain.cell_volumes * domain.passive_density) / domain.area
    if volume <= solid * (1.0 + 1e-9):
        raise ValueError(
            f"design: volume = {volume:.4g} leaves nothing to design: the solid regions alone fill "
            f"{solid:.4g} of the body"
        )


def shrunk(design: Design, variables: Array, volume: float) -> Array:
    """Variables lowered evenly until the volume bound holds.

    Args:
        design: Gives the volume.
        variables: Within the bounds of the design.
        volume: Upper bound of the filled share of the body.

    Raises:
        ValueError: On every rank, if the bound is out of range, or the body exceeds it even with
            all variables at their lower bound.
    """
    domain = design.domain
    check_volume(domain, volume)

    def lowered(shift: float) -> Array:
        range_ = design.upper - design.lower
        return np.asarray(np.clip(variables - shift * range_, design.lower, design.upper))

    def filled(shift: float) -> float:
        x = design.density(lowered(shift))
        return domain.sum(x * domain.cell_volumes) / domain.area

    return lowered(VolumeBisection(volume).multiplier(filled))


def finite_vector(values: ArrayLike, size: int, where: str, what: str) -> Array:
    """``values`` as finite numbers, shape (size,).

    Args:
        values: What is checked.
        size: How many there must be.
        where: Who asks.
        what: Their name, for the message.

    Raises:
        ValueError: If there are more or fewer, or one is not finite.
    """
    vector = validation.numbers(f"{where}: {what}", values)
    finite = bool(np.all(np.isfinite(vector)))
    if vector.shape != (size,) or not finite:
        raise ValueError(
            f"{where}: expected {size} finite {what}, and got an array of shape {vector.shape}"
            + ("" if finite else " with NaN or infinity")
        )
    return vector
