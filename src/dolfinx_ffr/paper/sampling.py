# SPDX-License-Identifier: MIT
"""Selection of the elements at which exact gradient values are computed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from .. import validation
from ..arrays import Integers, Mask
from ..fem import Array, Domain

#: Part of the share that goes to the grid where no spacing is given; the band takes the rest
GRID_PART = 0.25
#: A grid point lies in the body, or within about one element of it, if its distance from the
#: nearest centroid is at most this many sizes of that cell
NEAR = 1.5
#: Coordinates and distances that differ by less than this part of a mean element are equal
ROUND_OFF = 1e-6


@dataclass(frozen=True)
class GradientElements:
    """Elements on a coarse grid and in a band around the active boundary.

    Give a grid spacing, the half-width of a band, or both; or a share, with or without a grid
    spacing. With a share the grid comes first, and the band is as wide as the share asks for;
    without a spacing a quarter of the share goes to the grid. Where no boundary is known the whole
    share goes to the grid, as nearly as a regular grid can meet it.

    Only designed cells are selected. The set does not depend on the number of ranks nor on the
    numbering of the mesh: ties are broken by coordinates (in favor of the cell next to the middle
    of the body, so that a mirror-symmetric mesh gets a mirror-symmetric selection off the axis),
    and in the band all cells that are equally far from the boundary are in or out together.

    Example:
        >>> from mpi4py import MPI
        >>> from dolfinx_ffr import Domain
        >>> from dolfinx_ffr.paper import GradientElements
        >>> rod = Domain.rectangle(MPI.COMM_SELF, 0.4, 0.04, elements=(40, 4))
        >>> int(GradientElements(grid=0.04).select(rod).sum())
        10

    Raises:
        ValueError: If nothing is given, a band as well as a share, a length that is not positive,
            or a share outside ]0, 1].
    """

    #: Spacing of the grid [m]; its points lie in the middle of equal rectangles over the bounding
    #: box, and those in the body or within about one element of it take the nearest cell
    grid: float | None = None
    #: Half-width of the band around the active boundary, between cell centroids and boundary [m]
    band: float | None = None
    #: Selected share of the body's designed cells, in ]0, 1]
    share: float | None = None

    def __post_init__(self) -> None:
        """Check the parameters."""
        if self.grid is None and self.band is None and self.share is None:
            raise ValueError("gradient elements: give a grid spacing, a band or a share")
        for name, most, unit in (("grid", np.inf, "m"), ("band", np.inf, "m"), ("share", 1.0, "")):
            if (value := getattr(self, name)) is not None:
                what = f"gradient elements: {name}"
                validation.number(what, value, above=0.0, most=most, unit=unit)
        if self.share is not None and self.band is not None:
            raise ValueError(
                "gradient elements: a share widens or narrows the band by itself; give either a "
                "band or a share"
            )

    def select(self, domain: Domain, distance: ArrayLike | None = None) -> Mask:
        """Which cells of a ``domain`` on this rank are selected, shape (cells,); collective.

        The signed or absolute ``distance`` of their centroids from the active boundary, shape
        (cells,) [m], is such as `LevelSet.distance`; None, or infinite in all cells: there is none.

        Raises:
            ValueError: On every rank, if the distances do not fit the cells or are NaN, no cell is
                selected, or the grid alone exceeds the share.
        """
        away = self._check(domain, distance)
        # arrays of the cells of all ranks
        design = domain.everywhere(domain.design_cells)
        designed = int(np.count_nonzero(design))
        eps = ROUND_OFF * domain.cell_size
        selected = np.zeros(len(design), dtype=bool)
        spacing = self.grid
        if spacing is None and self.share is not None:
            wanted = designed * self.share * (1.0 if away is None else GRID_PART)
            area = domain.sum(np.where(domain.design_cells, domain.cell_volumes, 0.0))
            spacing = math.sqrt(area / wanted)
        if spacing is not None:
            selected[_nearest_cells(domain, spacing, eps)] = True
            selected &= design
        if away is not None and self.band is not None:
            selected |= design & (away <= self.band + eps)
        if self.share is not None:
            on_grid = int(np.count_nonzero(selected))
            # a spacing that follows from the share meets it by itself, as nearly as a grid can
            if self.grid is not None and on_grid > self.share * designed + 1.0:
                raise ValueError(
                    f"gradient elements: the grid of spacing {self.grid} m takes {on_grid} of "
                    f"{designed} designed cells, more than the share of {self.share}; take a "
                    "larger spacing or share"
                )
            missing = round(self.share * designed) - on_grid
            if away is not None and missing > 0:
                free = design & ~selected & np.isfinite(away)
                farthest = np.max(np.sort(away[free])[:missing], initial=0.0)
                selected |= free & (away <= farthest + eps)
        if not np.any(selected):
            raise ValueError(
                f"gradient elements: {self} selects none of {designed} designed cells; take a "
                "smaller grid spacing, a wider band or a larger share"
            )
        return domain.owned(selected)

    def _check(self, domain: Domain, distance: ArrayLike | None) -> Array | None:
        """The absolute distance, shape (cells of all ranks,), or None without a boundary."""
        away = np.full(domain.n_cells, np.inf)
        if distance is not None:
            away = np.abs(validation.numbers("gradient elements: distance", distance))
        wrong = away.shape != (domain.n_cells,) or bool(np.any(np.isnan(away)))
        if domain.comm.allreduce(wrong, MPI.LOR):
            raise ValueError(
                "gradient elements: expected the distance of each cell's centroid from the "
                f"boundary, shape ({domain.n_cells},) on rank {domain.comm.rank}, without NaN; got "
                + ("none" if distance is None else f"shape {away.shape}")
            )
        away = domain.everywhere(away)
        if np.any(np.isfinite(away)):
            return away
        if self.grid is None and self.share is None:
            raise ValueError(
                "gradient elements: a band needs a boundary, and none is known; give a grid "
                "spacing too, or a share"
            )
        return None


def _nearest_cells(domain: Domain, spacing: float, eps: float) -> Integers:
    """The cells nearest to points of the grid in or near the body, ties within ``eps`` broken."""
    low, high = domain.bounding_box
    counts = np.maximum(np.rint((high - low) / spacing), 1.0).astype(int)
    middles = np.indices(counts).reshape(len(counts), -1).T + 0.5
    points = low + middles * (high - low) / counts
    x, areas = map(domain.everywhere, (domain.centroids, domain.cell_volumes))
    tree = cKDTree(x)
    nearest = tree.query(points)[0]
    found = tree.query_ball_point(points, nearest + eps)
    point = np.repeat(np.arange(len(points)), list(map(len, found)))
    cell = np.concatenate(list(found)).astype(np.int64)
    close = nearest[point] <= NEAR * np.sqrt(areas[cell]) + eps
    point, cell = point[close], cell[close]
    for key in (np.linalg.norm(x - 0.5 * (low + high), axis=1), x[:, 0], x[:, 1]):
        least = np.full(len(points), np.inf)
        np.minimum.at(least, point, key[cell])
        tied = key[cell] <= least[point] + eps
        point, cell = point[tied], cell[tied]
    return np.unique(cell)
