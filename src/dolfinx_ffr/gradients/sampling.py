# SPDX-License-Identifier: MIT
"""Selection of the elements at which exact gradient values are computed.

They lie on a coarse grid over the body and in a band around the active boundary, where material
meets void and the design moves. Grid and band are given as lengths, or follow from the share of the
designed cells that is wanted: neither knows of the mesh. From the values there,
`ScatteredInterpolation` builds the gradient of all elements.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from .. import validation
from ..fem import Domain

__all__ = ["GradientElements"]

Array = NDArray[np.float64]

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
    spacing. With a share the grid comes first, and the band is as wide as it takes to reach the
    share; without a spacing a quarter of the share goes to the grid. Where no boundary is known
    there is only the grid, to which the whole share then goes, as nearly as a regular grid can
    meet it.

    Cells that are not designed are never selected, for no design changes them. The selected set
    does not depend on the number of ranks nor on the numbering of the mesh: ties are broken by
    coordinates (in favor of the cell next to the middle of the body, so that a mirror-symmetric
    mesh gets a mirror-symmetric selection off the axis), and in the band all cells that are equally
    far from the boundary are in or out together.

    Example:
        >>> from mpi4py import MPI
        >>> from dolfinx_ffr import Domain, GradientElements
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
        for name, value in (("grid", self.grid), ("band", self.band)):
            if value is not None:
                validation.number(f"gradient elements: {name}", value, above=0.0, unit="m")
        if self.share is not None:
            validation.number("gradient elements: share", self.share, above=0.0, most=1.0)
        if self.share is not None and self.band is not None:
            raise ValueError(
                "gradient elements: a share widens or narrows the band by itself; give either a "
                "band or a share"
            )

    def select(self, domain: Domain, distance: ArrayLike | None = None) -> NDArray[np.bool_]:
        """Which cells of this rank are selected.

        Collective: every rank of the domain calls it.

        Args:
            domain: The body.
            distance: Signed or absolute distance of the centroid of each cell owned by this rank
                from the active boundary, shape (cells,) [m], such as
                `LevelSet.distance`. None, or infinite in all cells: there is no boundary.

        Returns:
            Shape (cells,), for the cells owned by this rank.

        Raises:
            ValueError: On every rank, if the distances do not fit the cells or are NaN, no cell is
                selected, or the grid alone exceeds the share.
        """
        away = self._check(domain, distance)
        comm: MPI.Comm = domain.comm
        design = domain.design_cells
        designed = int(comm.allreduce(int(np.count_nonzero(design))))
        eps = ROUND_OFF * domain.cell_size
        selected = np.zeros(domain.n_cells, dtype=bool)
        spacing = self.grid
        if spacing is None and self.share is not None:
            wanted = designed * self.share * (1.0 if away is None else GRID_PART)
            area = domain.sum(np.where(design, domain.cell_volumes, 0.0))
            spacing = math.sqrt(area / wanted)
        if spacing is not None:
            selected[_nearest_cells(domain, spacing, eps)] = True
            selected &= design
        if away is not None and self.band is not None:
            selected |= design & (away <= self.band + eps)
        if self.share is not None:
            on_grid = int(comm.allreduce(int(np.count_nonzero(selected))))
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
                selected |= free & (away <= _threshold(comm, away[free], missing) + eps)
        if not comm.allreduce(bool(np.any(selected)), MPI.LOR):
            raise ValueError(
                f"gradient elements: {self} selects none of {designed} designed cells; take a "
                "smaller grid spacing, a wider band or a larger share"
            )
        return selected

    def _check(self, domain: Domain, distance: ArrayLike | None) -> Array | None:
        """The absolute distance, or None where there is no boundary on any rank."""
        comm: MPI.Comm = domain.comm
        away = (
            None
            if distance is None
            else np.abs(validation.numbers("gradient elements: distance", distance))
        )
        wrong = away is not None and (away.shape != (domain.n_cells,) or np.any(np.isnan(away)))
        if comm.allreduce(bool(wrong), MPI.LOR):
            raise ValueError(
                "gradient elements: expected the distance of each cell's centroid from the "
                f"boundary, shape ({domain.n_cells},) on rank {comm.rank}, without NaN; got "
                + ("none" if away is None else f"shape {away.shape}")
            )
        # a rank without cells, or far from the boundary, must not decide alone
        known = away is not None and bool(np.any(np.isfinite(away)))
        if not comm.allreduce(known, MPI.LOR):
            if self.grid is None and self.share is None:
                raise ValueError(
                    "gradient elements: a band needs a boundary, and none is known; give a grid "
                    "spacing too, or a share"
                )
            return None
        return np.full(domain.n_cells, np.inf) if away is None else away


def _nearest_cells(domain: Domain, spacing: float, eps: float) -> NDArray[np.int64]:
    """The cells of this rank that are nearest to a point of the grid, in or near the body.

    Args:
        domain: The body.
        spacing: Of the grid [m].
        eps: Difference of coordinates that is round-off [m].
    """
    low, high = domain.bounding_box
    counts = np.maximum(np.rint((high - low) / spacing), 1.0).astype(int)
    axes = [
        a + (np.arange(n) + 0.5) * (b - a) / n for a, b, n in zip(low, high, counts, strict=True)
    ]
    points = np.column_stack([x.ravel() for x in np.meshgrid(*axes, indexing="ij")])
    comm: MPI.Comm = domain.comm
    # for each point: the cells of this rank that may be the nearest of all ranks
    x = domain.centroids  # collective when first used
    tree = cKDTree(x) if domain.n_cells else None
    distance = np.full(len(points), np.inf) if tree is None else tree.query(points)[0]
    nearest = _smallest(comm, distance)
    found = [[]] * len(points) if tree is None else tree.query_ball_point(points, nearest + eps)
    point = np.repeat(np.arange(len(points)), [len(each) for each in found])
    cell = np.concatenate(list(found)).astype(np.int64)
    close = nearest[point] <= NEAR * np.sqrt(domain.cell_volumes[cell]) + eps
    point, cell = point[close], cell[close]
    for key in (np.linalg.norm(x - 0.5 * (low + high), axis=1), x[:, 0], x[:, 1]):
        value = np.full(len(points), np.inf)
        np.minimum.at(value, point, key[cell])
        tied = key[cell] <= _smallest(comm, value)[point] + eps
        point, cell = point[tied], cell[tied]
    return np.unique(cell)


def _smallest(comm: MPI.Comm, values: Array) -> Array:
    smallest = np.empty_like(values)
    comm.Allreduce(values, smallest, MPI.MIN)
    return smallest


def _threshold(comm: MPI.Comm, values: Array, count: int) -> float:
    """The largest of the ``count`` smallest values of all ranks."""
    # no more than these can be among the smallest
    local = np.sort(values)[:count]
    everything = np.concatenate(comm.allgather(local))
    if len(everything) <= count:
        return float(np.max(everything, initial=0.0))
    return float(np.partition(everything, count - 1)[count - 1])
