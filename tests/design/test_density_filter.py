# SPDX-License-Identifier: MIT
"""Density filter and projection: invariants, transposes, the same on any number of ranks."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import mesh
from shared.derivatives import check_slope

import dolfinx_ffr as ffr
from dolfinx_ffr.design.base import check_volume


def rod(comm: MPI.Intracomm, cell: str = "triangle") -> ffr.Domain:
    """A short rod; its triangles have corners of different angles at the edges."""
    return ffr.Domain.rectangle(comm, 0.2, 0.05, elements=(24, 6), cell=cell)


def waves(domain: ffr.Domain) -> np.ndarray:
    """Values of all cells in [0, 1] that vary in both directions."""
    c = domain.everywhere(domain.centroids)
    return np.asarray(0.5 + 0.45 * np.sin(90.0 * c[:, 0]) * np.cos(160.0 * c[:, 1] + 0.4))


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
@pytest.mark.parametrize("elements", [0.0, 1.5, 3.0])
def test_constants_and_volume_are_kept(comm: MPI.Intracomm, cell: str, elements: float) -> None:
    domain = rod(comm, cell)
    density_filter = ffr.design.DensityFilter(domain, elements * 0.2 / 24)
    z = waves(domain)
    areas = domain.everywhere(domain.cell_volumes)
    np.testing.assert_allclose(density_filter(np.full(len(z), 0.3)), 0.3, rtol=1e-13)
    y = density_filter(z)
    assert areas @ y == pytest.approx(areas @ z, rel=1e-13)
    assert z.min() - 1e-13 < y.min() and y.max() < z.max() + 1e-13


def test_a_radius_that_filters_nothing_is_reported_but_zero() -> None:
    domain = rod(MPI.COMM_SELF, "quadrilateral")
    z = waves(domain)
    np.testing.assert_allclose(ffr.design.DensityFilter(domain, 0.0)(z), z, rtol=1e-14)
    for share, radius in ((0.9, "0.0075"), (1.0, "0.008333")):  # at the radius the weight is zero
        message = rf"radius = {radius} m .* 0\.008333 m, and filters nothing"
        with pytest.warns(UserWarning, match=message):
            means = ffr.design.DensityFilter(domain, share * 0.2 / 24)(z)
        np.testing.assert_allclose(means, z, rtol=1e-13)


def test_no_value_reaches_beyond_the_radius() -> None:
    domain = rod(MPI.COMM_SELF)
    radius = 0.02
    z = np.zeros(domain.n_cells)
    z[70] = 1.0
    c = domain.everywhere(domain.centroids)
    distance = np.linalg.norm(c - c[70], axis=1)
    y = ffr.design.DensityFilter(domain, radius)(z)
    np.testing.assert_array_equal(y > 0.0, distance < radius)


@pytest.mark.mpi
@pytest.mark.parametrize(("beta", "eta"), [(0.5, 0.5), (4.0, 0.3), (16.0, 0.6)])
def test_filter_and_projection_with_their_derivative(
    comm: MPI.Intracomm, beta: float, eta: float
) -> None:
    """The same on any number of ranks, and exact."""
    filtered, alone = (
        ffr.design.DensityFilter(domain, 0.02) for domain in (rod(comm), rod(MPI.COMM_SELF))
    )
    projection, z = ffr.design.HeavisideProjection(beta, eta), waves(rod(comm))
    np.testing.assert_allclose(filtered(z), alone(waves(rod(MPI.COMM_SELF))), rtol=1e-12)
    rng = np.random.default_rng(4)
    weights, direction = rng.random(len(z)), rng.standard_normal(len(z))

    def value(way: float) -> float:
        return float(weights @ projection(filtered(z + way * direction)) ** 2)

    means = filtered(z)
    bar = filtered.pullback(projection.pullback(means, 2.0 * weights * projection(means)))
    check_slope(value, float(bar @ direction), 1e-2)


def test_pullback_is_the_transpose_where_cells_differ() -> None:
    """With cells of equal size the matrix would be its own transpose."""
    graded = mesh.create_rectangle(MPI.COMM_SELF, [np.zeros(2), np.array([0.2, 0.05])], (12, 3))
    graded.geometry.x[:, 0] = 0.2 * (graded.geometry.x[:, 0] / 0.2) ** 1.6
    graded.topology.create_connectivity(1, 2)
    ends = {"left": mesh.locate_entities_boundary(graded, 1, lambda x: x[0] < 1e-9)}
    domain = ffr.Domain(graded, ends)
    density_filter, rng = ffr.design.DensityFilter(domain, 0.03), np.random.default_rng(7)
    a, b = rng.standard_normal((2, domain.n_cells))
    assert a @ density_filter(b) == pytest.approx(density_filter.pullback(a) @ b, rel=1e-12)
    assert abs(a @ density_filter(b) - density_filter(a) @ b) > 1e-2 * abs(a @ density_filter(b))


@pytest.mark.parametrize("beta", [1e-3, 1.0, 64.0])
def test_projection_maps_the_interval_onto_itself(beta: float) -> None:
    projection = ffr.design.HeavisideProjection(beta, 0.4)
    y = np.linspace(0.0, 1.0, 101)
    x = projection(y)
    assert x[0] == 0.0 and x[-1] == 1.0
    assert np.all(np.diff(x) >= 0.0)
    if beta < 0.01:
        np.testing.assert_allclose(x, y, atol=1e-6)
    if beta > 50.0:
        np.testing.assert_allclose(x[y < 0.3], 0.0, atol=1e-4)
        np.testing.assert_allclose(x[y > 0.5], 1.0, atol=1e-4)


@pytest.mark.mpi
def test_regions_that_are_not_designed_enter_the_means_of_their_neighbours(
    comm: MPI.Intracomm,
) -> None:
    """Solid ones as 1, void ones as 0, with the exact transpose."""
    domain = ffr.Domain.rectangle(
        comm, 0.2, 0.05, elements=(24, 6), void=lambda x: np.abs(x[0] - 0.1) < 0.021
    )
    design = ffr.DensityDesign(domain)
    x = design.density(design.even(1.0))
    passive = ~domain.design_cells
    np.testing.assert_array_equal(x[passive], domain.passive_density[passive])
    away = np.abs(domain.centroids[:, 0] - 0.1)
    assert np.all(x[(away > 0.02) & (away < 0.022)] < 1.0)
    np.testing.assert_allclose(x[away > 0.05], 1.0, rtol=1e-12)
    rng = np.random.default_rng(6)
    z, direction = 0.2 + 0.6 * rng.random(design.size), rng.standard_normal(design.size)
    weights = domain.cell_volumes / domain.area
    gradient = design.pullback(z, weights)
    check_slope(
        lambda way: domain.sum(weights * design.density(z + way * direction)),
        float(gradient @ direction),
        1e-2,
    )
    with pytest.raises(ValueError, match=r"the solid regions alone fill 0\.1667 of the body"):
        check_volume(domain, 0.15)
