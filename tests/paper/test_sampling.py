# SPDX-License-Identifier: MIT
"""Elements of exact gradient values: grid, band, share; any number of ranks, any mesh."""

from __future__ import annotations

import math

from mpi4py import MPI

import numpy as np
import pytest
import shapely
from dolfinx import mesh
from scipy.spatial import cKDTree

from dolfinx_ffr import Domain
from dolfinx_ffr.paper import GradientElements

LENGTH, HEIGHT = 0.4, 0.08


def rod(comm: MPI.Comm, cell: str = "quadrilateral", n: int = 8, solid: int = 2) -> Domain:
    size = (5 * n, n)
    return Domain.rectangle(comm, LENGTH, HEIGHT, elements=size, cell=cell, solid_columns=solid)


def hook(comm: MPI.Comm) -> Domain:
    """A body with a hole and a notch, of unstructured triangles of different sizes."""
    shape = shapely.box(0.0, -0.04, LENGTH, 0.04) - shapely.box(0.1, 0.0, 0.15, 0.05)
    shape -= shapely.Point(0.25, 0.0).buffer(0.02, quad_segs=5)
    ends = {"left": lambda x: x[0] < 1e-9, "right": lambda x: x[0] > LENGTH - 1e-9}
    return Domain.from_outline(comm, shape, interfaces=ends, size=0.012)


def body(comm: MPI.Comm, kind: str) -> Domain:
    return hook(comm) if kind == "gmsh" else rod(comm, kind)


def circle(domain: Domain) -> np.ndarray:
    """Signed distance of the centroids from a circle about the rod's middle."""
    x = domain.centroids
    return np.hypot(x[:, 0] - 0.5 * LENGTH, x[:, 1]) - 0.025


def gathered(domain: Domain, cells: np.ndarray) -> np.ndarray:
    """Centroids of the cells of all ranks, in no particular order."""
    return np.vstack(domain.comm.allgather(domain.centroids[cells]))


def assert_same_points(a: np.ndarray, b: np.ndarray) -> None:
    assert len(a) == len(b)
    distance, index = cKDTree(a).query(b)
    assert np.max(distance) < 1e-12
    assert len(np.unique(index)) == len(a)


SELECTIONS = [
    GradientElements(grid=0.02),
    GradientElements(band=0.01),
    GradientElements(grid=0.04, band=0.01),
    GradientElements(share=0.35),
    GradientElements(share=1.0),
]


@pytest.mark.mpi
@pytest.mark.parametrize("elements", SELECTIONS, ids=repr)
@pytest.mark.parametrize("kind", ["quadrilateral", "triangle", "gmsh"])
def test_ranks_do_not_matter(comm: MPI.Comm, kind: str, elements: GradientElements) -> None:
    """The same cells on any number of ranks; they are designed, and they are distinct."""
    chosen = []
    for domain in (body(comm, kind), body(MPI.COMM_SELF, kind)):
        selected = elements.select(domain, circle(domain))
        assert selected.shape == (domain.n_cells,)
        assert not np.any(selected & ~domain.design_cells)
        chosen.append(gathered(domain, selected))
    assert_same_points(*chosen)


@pytest.mark.parametrize("kind", ["quadrilateral", "triangle"])
def test_band_is_all_designed_cells_near_the_boundary(comm: MPI.Comm, kind: str) -> None:
    domain = rod(comm, kind)
    at_circle = (np.abs(circle(domain)) < 0.012) & domain.design_cells
    for distance in (circle(domain), np.abs(circle(domain))):
        selected = GradientElements(band=0.012).select(domain, distance)
        np.testing.assert_array_equal(selected, at_circle)


def test_grid_takes_the_cells_around_its_points(comm: MPI.Comm) -> None:
    """Points in the middle of elements take these; a row or column of points is never lost."""
    domain = rod(comm, n=12, solid=0)
    selected = GradientElements(grid=0.02).select(domain)
    x, y = np.meshgrid(0.01 + 0.02 * np.arange(20), -0.03 + 0.02 * np.arange(4))
    assert_same_points(gathered(domain, selected), np.column_stack([x.ravel(), y.ravel()]))
    sparse = gathered(domain, GradientElements(grid=0.2).select(domain))
    assert len(sparse) == 2
    assert np.max(np.abs(sparse[:, 1])) < HEIGHT / 12


def test_ties_are_broken_alike_on_both_sides_of_the_axis(comm: MPI.Comm) -> None:
    """Grid points on vertices of the mesh, four cells equally near."""
    domain = rod(comm, n=8, solid=0)
    selected = gathered(domain, GradientElements(grid=0.02).select(domain))
    assert len(selected) == 80
    assert_same_points(selected, selected * [1.0, -1.0])
    assert_same_points(selected, [LENGTH, 0.0] + selected * [-1.0, 1.0])


@pytest.mark.parametrize("kind", ["quadrilateral", "triangle", "gmsh"])
@pytest.mark.parametrize("share", [0.1, 0.6])
def test_share_is_reached(comm: MPI.Comm, kind: str, share: float) -> None:
    """By the cells nearest to the boundary; more only where the last of them are equally far."""
    domain = body(comm, kind)
    design, at_circle = domain.design_cells, np.abs(circle(domain))
    designed = domain.sum(design.astype(float))
    area = domain.sum(domain.cell_volumes * design)
    default = math.sqrt(area / (0.25 * share * designed))
    for given, spacing in ((None, default), (0.04, 0.04)):
        selected = GradientElements(grid=given, share=share).select(domain, circle(domain))
        grid = GradientElements(grid=spacing).select(domain)
        assert np.all(selected[grid])
        band = comm.allreduce(float(np.max(at_circle[selected & ~grid], initial=0.0)), MPI.MAX)
        assert np.all(at_circle[design & ~selected] > band)
        closer = grid | (design & (at_circle < band - 1e-9))
        target = round(share * designed)
        assert domain.sum(closer.astype(float)) < target <= domain.sum(selected.astype(float))


def test_without_a_boundary_the_share_goes_to_the_grid(comm: MPI.Comm) -> None:
    domain = rod(comm, n=16)
    designed = domain.sum(domain.design_cells.astype(float))
    nowhere = np.full(domain.n_cells, np.inf)
    for share in (0.1, 0.35, 0.6):
        selected = GradientElements(share=share).select(domain)
        assert domain.sum(selected.astype(float)) / designed == pytest.approx(share, rel=0.15)
        np.testing.assert_array_equal(
            GradientElements(share=share).select(domain, nowhere), selected
        )
    everything = GradientElements(share=1.0).select(domain)
    np.testing.assert_array_equal(everything, domain.design_cells)
    both, only = GradientElements(grid=0.02, band=0.01), GradientElements(grid=0.02)
    np.testing.assert_array_equal(both.select(domain), only.select(domain))


@pytest.mark.mpi
def test_a_rank_may_have_no_cells(comm: MPI.Comm) -> None:
    corners = [np.zeros(2), np.array([2.0, 1.0])]
    two_cells = mesh.create_rectangle(comm, corners, [2, 1], mesh.CellType.quadrilateral)
    domain = Domain(two_cells, {"left": lambda x: x[0] < 1e-9})
    assert len(gathered(domain, GradientElements(grid=1.0).select(domain))) == 2
    selected = GradientElements(share=0.5).select(domain, domain.centroids[:, 0])
    np.testing.assert_allclose(gathered(domain, selected), [[0.5, 0.5]], atol=1e-12)


def test_bad_selections_are_refused(comm: MPI.Comm) -> None:
    """On every rank, also where only one rank has the bad distances."""
    domain = rod(comm)
    distance, nowhere = circle(domain), np.full(domain.n_cells, np.inf)
    short = distance[: -1 if comm.rank == 0 else None]
    spoiled = np.where((np.arange(domain.n_cells) == 0) & (comm.rank == 0), np.nan, distance)
    band = {"band": 0.01}
    for options, given, message in (
        ({}, distance, "give a grid spacing, a band or a share"),
        ({"band": 0.01, "share": 0.3}, distance, "give either a band or a share"),
        (band, short, "expected the distance of each cell"),
        (band, spoiled, "without NaN"),
        (band, None, "needs a boundary"),
        (band, nowhere, "needs a boundary"),
        (band, distance + 1.0, "selects none of"),
        ({"grid": 0.01, "share": 0.2}, distance, "more than the share"),
    ):
        with pytest.raises(ValueError, match=message):
            GradientElements(**options).select(domain, given)
