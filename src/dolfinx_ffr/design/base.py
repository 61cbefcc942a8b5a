# SPDX-License-Identifier: MIT
"""Designs: how bounded variables, alike on every rank, become the density of a body's elements."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from .. import validation
from ..fem import Array, Domain
from ..mechanism import Parameters
from .rbf import Wendland, neighbours

#: Steepness of the projection of a sharp design: a step within a fifth of an element with the
#: shortest kernel, and in proportion to its radius
SHARP = 32.0
#: Progress from which on a design is sharp; the best sharp boundary is found after it
SHARP_PROGRESS = 0.55
#: Progress between which the projection becomes steeper, by the same factor each iteration; the
#: topology is found before it
SHARPENING = (0.05, SHARP_PROGRESS)
#: Radius of the mean of densities, in edges of a square or cube as large as the cell
_REACH = 1.5


def density_field(domain: Domain, x: ArrayLike) -> Callable[[ArrayLike], Array]:
    """A smooth field whose zero line is where the densities of cells cross one half.

        phi(X) = sum_e w_e(X) x_e / sum_e w_e(X) - 1/2,    w_e(X) = g(|X - X_e| / r_e),

    with `Wendland`'s function g of the distance from the centroids. The radius r_e is 1.5 times the
    size of the cell: an edge between solid and void cells stays where it is, and members of one row
    of cells stay members.

    Args:
        domain: The body.
        x: Densities in [0, 1] of the cells of this rank, shape (cells,).

    Returns:
        A function of positions (n, dimension) [m] that gives (n,) numbers, the same on every rank.
    """
    arrays = domain.check_density(x), domain.centroids, domain.cell_volumes
    values, centers, volumes = map(domain.everywhere, arrays)
    radii = _REACH * volumes ** (1.0 / domain.dimension)
    tree, reach, wendland = cKDTree(centers), float(radii.max()), Wendland(1.0)

    def field(positions: ArrayLike) -> Array:
        points = np.asarray(positions, dtype=np.float64)
        pairs = neighbours(points, tree, reach)
        weight = wendland(pairs["v"] / radii[pairs["j"]])  # zero beyond the radius of the cell
        places = pairs["i"], pairs["j"]
        matrix = csr_matrix((weight, places), shape=(len(points), len(centers)))
        total = np.asarray(matrix.sum(axis=1)).ravel()
        bare = ~(total > 0.0)  # without a centroid nearby, as the cell is much longer than wide
        means = np.asarray(matrix @ values) / np.where(bare, 1.0, total)
        means[bare] = values[tree.query(points[bare])[1]]
        return means - 0.5

    return field


def steepness(progress: float) -> float:
    """Steepness of the projection at a progress in [0, 1]: 1 at the start, 32 from 0.55 on."""
    validation.number("design: progress", progress, least=0.0, most=1.0)
    begin, end = SHARPENING
    return float(SHARP ** min(max((progress - begin) / (end - begin), 0.0), 1.0))


class Variables(ABC):
    """Bounded variables, alike on every rank, that describe a body or parameters."""

    lower: float = 0.0  #: Smallest value of a variable
    upper: float = 1.0  #: Largest value of a variable
    size: int  #: Number of variables
    each: ClassVar[str]  #: The thing that has one variable, for messages

    def at(self, progress: float) -> Self:
        """The design as it is at a ``progress`` between 0, the start, and 1, the end."""
        return self

    @abstractmethod
    def identity(self) -> dict[str, Any]:
        """The data that a checkpoint and the run that reads it must have in common."""

    def even(self, value: float = 0.5) -> Array:
        """Variables that all lie at the same share ``value`` of their range, shape (size,)."""
        share = validation.number("design: value", value, least=0, most=1)
        return np.full(self.size, self.lower + share * (self.upper - self.lower))

    def point(self, variables: Array) -> Array:
        """The values at which a problem is evaluated; by default the ``variables`` themselves."""
        return variables

    def pullback(self, variables: Array, x_bar: Array) -> Array:
        """Pull the derivative ``x_bar`` by `point` back to the ``variables``, shape (size,)."""
        return validation.real_array("design: the derivative", x_bar, (self.size,))

    def penalty(self, variables: Array) -> tuple[float, Array]:
        """A term that is added to log psi at ``variables``, and its derivative, shape (size,)."""
        return 0.0, np.zeros(self.size)

    def begin(self, start: ArrayLike) -> Array:
        """The variables with which moving asymptotes begin at a ``start``, shape (size,)."""
        return self.check(start)

    def check(self, start: ArrayLike) -> Array:
        """``start`` as variables of shape (size,), within the bounds."""
        variables = finite_vector(start, self.size, "design", f"variables, one a {self.each}")
        return np.clip(variables, self.lower, self.upper)


class Design(Variables):
    """A map from bounded variables to the density of one body, with its transpose."""

    domain: Domain  #: Of the body
    #: Steepness of the step from void to solid: 1 is gray, 32 is sharp, as designs without a step
    sharpness: float = SHARP
    #: Width of the rim around each hole of the body's drawing that the design keeps solid [m]
    hole_rim: float = 0.0
    #: Thickness of the web that stays where material is milled away, as a share of the part's
    #: thickness; zero where holes are cut
    web: float = 0.0
    #: Whether a density is the share of its element that the boundary encloses
    fills: ClassVar[bool] = False

    @property
    def nominal(self) -> Design:
        """The nominal design, which differs if an eroded one is analysed, see `LevelSet`."""
        return self

    def point(self, variables: Array) -> Array:
        return self.density(variables)

    def with_web(self, x: Array) -> Array:
        """Thickness of cells (cells,) with density x, as a share of the part's thickness."""
        return np.where(self.domain.void_cells, x, self.web + (1.0 - self.web) * x)

    @abstractmethod
    def density(self, variables: Array) -> Array:
        """The density of this rank's cells, shape (cells,), at ``variables`` (size,)."""

    @abstractmethod
    def pullback(self, variables: Array, x_bar: Array) -> Array:
        """The derivative by the ``variables``, (size,), from the derivative ``x_bar`` by density.

        The map is the transpose of the derivative of `density`. The array ``x_bar`` has the shape
        (cells,) of this rank's cells; the result is bit-identical on every rank.
        """

    def level(self, variables: Array) -> Callable[[ArrayLike], Array]:
        """The field whose zero line bounds the material at ``variables``.

        It is a function of positions (n, dimension) [m] that each rank may call alone, positive in
        the material; by default a smooth mean of the densities less one half (`density_field`).
        """
        return density_field(self.domain, self.density(variables))

    def distance(self, variables: Array) -> Array | None:
        """The distance of this rank's cells from the boundary at ``variables``, or None."""
        return None


def volume_multiplier(
    volume: Callable[[float], float], bound: float, tolerance: float = 1e-6
) -> float:
    """The smallest Lambda >= 0 with ``volume`` (Lambda) <= bound, a falling function."""
    if volume(0.0) <= bound:
        return 0.0
    low, high = 0.0, 1.0
    while volume(high) > bound:
        low, high = high, 2.0 * high
        if high > 1e12:
            raise ValueError(
                f"the volume stays at {volume(high):.6g}, above its bound {bound:.6g}, whatever "
                "the multiplier: raise the bound, or shrink the solid regions and rims"
            )
    for _ in range(200):
        middle = 0.5 * (low + high)
        filled = volume(middle)
        if filled > bound:
            low = middle
        else:
            high = middle
            if filled >= bound * (1.0 - tolerance):
                break
        if high - low <= 1e-14 * high:
            break
    return high


def checked_web(where: str, domain: Domain, web: float, rim: float) -> float:
    """The thickness of a ``web`` as a share, or a ValueError where there cannot be one."""
    share = validation.number(f"{where}: web", web, least=0.0, below=1.0)
    if share and domain.dimension == 3:
        raise ValueError(
            f"{where}: web = {share:g} is for plates, bodies in the plane, from which pockets are "
            "milled; this body is in space: leave the web out"
        )
    if share and not rim:
        raise ValueError(
            f"{where}: hole_rim = 0 leaves pockets open at the outline and at holes, and a web "
            f"without a rim; give the width of the rim [m], or leave hole_rim out"
        )
    return share


def check_volume(domain: Domain, volume: float, web: float = 0.0) -> None:
    """Refuse a bound of the filled share that leaves nothing to design."""
    validation.number("design: volume", volume, above=0.0, most=1.0)
    least = np.where(domain.design_cells, web, domain.passive_density)
    solid = domain.sum(domain.cell_volumes * least) / domain.area
    if volume <= solid * (1.0 + 1e-9):
        fixed = "the web and the solid regions" if web else "the solid regions alone"
        raise ValueError(
            f"design: volume = {volume:.4g} leaves nothing to design: {fixed} fill {solid:.4g} of "
            "the body"
        )


def filled_share(design: Design, variables: Array) -> float:
    """The filled share of the body's area, in space of its volume."""
    domain = design.domain
    return domain.sum(design.density(variables) * domain.cell_volumes) / domain.area


def shrunk(design: Design, variables: Array, volume: float) -> Array:
    """Variables lowered evenly until the filled share is at most ``volume``, or ValueError."""
    check_volume(design.domain, volume, design.web)

    def lowered(shift: float) -> Array:
        range_ = design.upper - design.lower
        return np.asarray(np.clip(variables - shift * range_, design.lower, design.upper))

    share = volume_multiplier(lambda shift: filled_share(design, lowered(shift)), volume)
    return lowered(share)


def finite_vector(values: ArrayLike, size: int, where: str, what: str) -> Array:
    """Finite numbers ``values``, shape (size,); messages of ``where`` name them ``what``."""
    vector = validation.numbers(f"{where}: {what}", values)
    finite = bool(np.all(np.isfinite(vector)))
    if vector.shape != (size,) or not finite:
        raise ValueError(
            f"{where}: expected {size} finite {what}, and got an array of shape {vector.shape}"
            + ("" if finite else " with NaN or infinity")
        )
    return vector


class ParameterDesign(Variables):
    """Parameters of a mechanism; the variables are linear or logarithmic shares of their ranges."""

    each: ClassVar[str] = "parameter"

    def __init__(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self.size = len(parameters.names)

    def even(self, value: float | None = None) -> Array:
        """The values of the start, shape (size,); or all at a share ``value`` of their range."""
        if value is None:
            return self.parameters.array
        return self.parameters.from_shares(super().even(value))[0]

    def begin(self, start: ArrayLike) -> Array:
        """The variables at values ``start`` of the parameters, shape (size,)."""
        values = finite_vector(start, self.size, "design", "values, one a parameter")
        return self.parameters.shares(self.parameters.at(values).array)

    def point(self, variables: Array) -> Array:
        return self.parameters.from_shares(variables)[0]

    def pullback(self, variables: Array, x_bar: Array) -> Array:
        bar = validation.real_array("design: the derivative by parameters", x_bar, (self.size,))
        return bar * self.parameters.from_shares(variables)[1]

    def identity(self) -> dict[str, Any]:
        scales = [entry.scale for entry in self.parameters.entries.values()]
        names = f"{self.parameters.names} {scales}"
        return {"parameters": names, "bounds": np.ravel(self.parameters.bounds)}
