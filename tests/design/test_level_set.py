# SPDX-License-Identifier: MIT
"""Level set: fill fractions and their exact derivative, start designs, signed distance."""

from __future__ import annotations

import math
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import dolfinx_ffr as ffr
from dolfinx_ffr.verification import (
    assert_taylor_order,
    central_difference,
    convergence_order,
    taylor_test,
)

LENGTH, HEIGHT = 0.4, 0.08


def rod(comm: MPI.Intracomm, cell: str = "quadrilateral", elements: tuple[int, int] = (40, 8)):
    return ffr.Domain.rectangle(comm, LENGTH, HEIGHT, elements=elements, cell=cell)


def wavy(x: np.ndarray) -> np.ndarray:
    """A phi with zero lines all over the rod."""
    return 0.02 * np.sin(25.0 * x[:, 0] + 0.4) * np.cos(60.0 * x[:, 1] + 0.3)


def scattered(n: int = 10) -> np.ndarray:
    """Knots without any order, more or less evenly over the rod and beyond its edge."""
    x, y = np.meshgrid(
        np.linspace(-0.01, 0.41, 4 * n - 4), np.linspace(-0.05, 0.05, n), indexing="ij"
    )
    return np.column_stack(
        [
            (x + 0.03 / n * np.sin(91.0 * y + 40.0 * x)).ravel(),
            (y + 0.02 / n * np.cos(77.0 * x)).ravel(),
        ]
    )


LEVEL_SETS: dict[str, dict[str, Any]] = {
    "compact": {},
    "coarse": {"spacing": 0.02, "kernel": ffr.Wendland(0.05)},
    "global": {"spacing": 0.02, "kernel": ffr.Multiquadric(0.02)},
    "scattered": {"knots": scattered(), "kernel": ffr.Wendland(0.04)},
}


# ---------------------------------------------------------------------- fill fraction


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
@pytest.mark.parametrize("kind", LEVEL_SETS)
def test_fill_fraction_is_differentiated_exactly(comm: MPI.Intracomm, cell: str, kind: str) -> None:
    domain = rod(comm, cell)
    levelset = ffr.LevelSet(domain, **LEVEL_SETS[kind])
    alpha = levelset.interpolate(wavy)
    direction = levelset.interpolate(lambda x: 0.01 * np.cos(31.0 * x[:, 0] - 45.0 * x[:, 1]))
    c = domain.centroids
    weight = np.sin(40.0 * c[:, 0] + 50.0 * c[:, 1]) + 0.3

    def value(a: np.ndarray) -> float:
        return domain.sum(weight * levelset.fill_fraction(a))

    bar = levelset.pullback(alpha, weight)
    assert_taylor_order(taylor_test(value, lambda d: float(bar @ d), alpha, direction))
    difference = central_difference(value, alpha, direction, 1e-3)
    assert bar @ direction == pytest.approx(difference, rel=1e-8)


@pytest.mark.mpi
def test_ranks_hold_the_same_bits_and_the_serial_numbers(comm: MPI.Intracomm) -> None:
    results = []
    for each in (comm, MPI.COMM_SELF):
        domain = rod(each)
        levelset = ffr.LevelSet(domain)
        alpha = levelset.interpolate(wavy)
        c = domain.centroids
        bar = levelset.pullback(alpha, np.sin(40.0 * c[:, 0] + 50.0 * c[:, 1]))
        results.append((alpha, bar, levelset.volume(alpha)))
    (alpha, bar, volume), (alpha_1, bar_1, volume_1) = results
    for array in (alpha, bar, np.array(volume)):
        assert len(set(comm.allgather(array.tobytes()))) == 1
    assert np.array_equal(alpha, alpha_1)
    assert bar == pytest.approx(bar_1, rel=1e-12, abs=1e-13 * np.max(np.abs(bar_1)))
    assert volume == pytest.approx(volume_1, rel=1e-14)


@pytest.mark.mpi
def test_fill_fraction_is_a_density_with_solid_regions(comm: MPI.Intracomm) -> None:
    domain = rod(comm)
    levelset = ffr.LevelSet(domain)
    x = levelset.fill_fraction(levelset.interpolate(wavy))
    assert np.array_equal(domain.check_density(x), x)
    assert comm.allreduce(np.min(x, initial=1.0), MPI.MIN) == 0.0
    assert np.all(x[~domain.design_cells] == 1.0)
    void = levelset.fill_fraction(levelset.interpolate(np.full(len(levelset.knots), -1.0)))
    assert np.array_equal(void, np.where(domain.design_cells, 0.0, 1.0))
    # and the solid regions pass no derivative on
    bar = np.where(domain.design_cells, 0.0, 1.0)
    assert not np.any(levelset.pullback(levelset.interpolate(wavy), bar))


@pytest.mark.mpi
def test_volume_of_a_disc(comm: MPI.Intracomm) -> None:
    """The smoothed Heaviside function keeps areas, up to the square of its width."""
    domain = rod(comm, elements=(80, 16))
    radius = 0.03

    def disc(x: np.ndarray) -> np.ndarray:
        return np.minimum(np.hypot(x[:, 0] - 0.2, x[:, 1]) - radius, 0.03)

    levelset = ffr.LevelSet(domain, width=0.003)
    removed = 1.0 - levelset.volume(levelset.interpolate(disc))
    assert removed * LENGTH * HEIGHT == pytest.approx(math.pi * radius**2, rel=0.01)


# ---------------------------------------------------------------------- phi on the knots


@pytest.mark.parametrize("kind", LEVEL_SETS)
def test_phi_takes_the_values_given_at_the_knots(kind: str) -> None:
    levelset = ffr.LevelSet(rod(MPI.COMM_SELF), **LEVEL_SETS[kind])
    phi = wavy(levelset.knots)
    assert levelset.at_knots(levelset.interpolate(phi)) == pytest.approx(phi, abs=1e-10)
    assert np.array_equal(levelset.interpolate(wavy), levelset.interpolate(phi))
    assert levelset.on_grid(levelset.interpolate(phi)).shape == tuple(map(len, levelset.grid))


def test_default_knots_are_a_grid_of_the_size_of_the_elements() -> None:
    levelset = ffr.LevelSet(rod(MPI.COMM_SELF))
    assert levelset.spacing == pytest.approx(0.01)
    assert len(levelset.knots) == 41 * 9
    columns, rows = levelset.grid
    assert np.array_equal(levelset.knots.reshape(41, 9, 2)[:, 0, 0], columns)
    assert np.array_equal(levelset.knots.reshape(41, 9, 2)[0, :, 1], rows)


@pytest.mark.mpi
def test_start_with_holes(comm: MPI.Intracomm) -> None:
    """The holes have their area, and lie alike on both sides of the axis."""
    domain = rod(comm, elements=(160, 32))
    levelset = ffr.LevelSet(domain, width=0.0005)
    alpha = levelset.with_holes(6, 2, 0.012)
    removed = (1.0 - levelset.volume(alpha)) * LENGTH * HEIGHT
    assert removed == pytest.approx(12 * math.pi * 0.012**2, rel=0.01)
    for rows in (1, 2, 3, 4, 5):
        phi = levelset.on_grid(levelset.with_holes(5, rows, 0.01))
        assert phi == pytest.approx(phi[:, ::-1], abs=1e-12)
        assert np.min(phi) == pytest.approx(-0.01, abs=0.0025)


def test_rows_are_staggered() -> None:
    levelset = ffr.LevelSet(rod(MPI.COMM_SELF, elements=(160, 32)))
    phi = levelset.on_grid(levelset.with_holes(4, 3, 0.01, margin=0.02))
    columns, rows = levelset.grid
    outer, middle = np.argmin(np.abs(rows + 0.02)), np.argmin(np.abs(rows))
    assert phi[np.argmin(np.abs(columns - 0.05)), outer] == pytest.approx(-0.01, abs=1e-10)
    assert phi[np.argmin(np.abs(columns - 0.10)), middle] == pytest.approx(-0.01, abs=1e-10)
    assert phi[np.argmin(np.abs(columns - 0.05)), middle] > 0.0


# ---------------------------------------------------------------------- signed distance


def distorted(x: np.ndarray) -> np.ndarray:
    """Zero on a circle, and anything but a distance elsewhere."""
    r = np.hypot(x[:, 0] - 0.19, x[:, 1] - 0.003)
    return (r**2 - 0.025**2) * (40.0 + 900.0 * np.abs(x[:, 1]) + 200.0 * x[:, 0])


def test_signed_distance_of_a_circle() -> None:
    """Exact up to the square of the spacing."""
    errors, spacings = [], []
    for n in (8, 16, 32):
        levelset = ffr.LevelSet(rod(MPI.COMM_SELF, elements=(5 * n, n)))
        knots = levelset.knots
        found = levelset.signed_distance(distorted(knots))
        exact = np.hypot(knots[:, 0] - 0.19, knots[:, 1] - 0.003) - 0.025
        errors.append(np.max(np.abs(found - exact)))
        spacings.append(levelset.spacing)
    assert errors[-1] < 0.1 * spacings[-1]
    assert convergence_order(spacings, errors) > 1.8


@pytest.mark.parametrize("knots", [None, scattered(20)], ids=["grid", "scattered"])
def test_signed_distance_has_unit_slope_and_keeps_the_zero_line(
    knots: np.ndarray | None,
) -> None:
    levelset = ffr.LevelSet(rod(MPI.COMM_SELF, elements=(80, 16)), knots=knots)
    found = levelset.interpolate(levelset.signed_distance(distorted(levelset.knots)))
    turn = np.linspace(0.0, 2.0 * math.pi, 200)
    normal = np.column_stack([np.cos(turn), np.sin(turn)])
    circle = np.array([0.19, 0.003]) + 0.025 * normal

    def phi(points: np.ndarray) -> np.ndarray:
        return levelset.basis.matrix(points) @ found

    h = 0.25 * levelset.spacing
    assert np.max(np.abs(phi(circle))) < 0.1 * levelset.spacing
    slope = (phi(circle + h * normal) - phi(circle - h * normal)) / (2.0 * h)
    assert np.mean(slope) == pytest.approx(1.0, abs=0.03)
    assert slope == pytest.approx(1.0, abs=0.1)


def test_signed_distance_keeps_a_mirror_symmetry_exactly() -> None:
    levelset = ffr.LevelSet(rod(MPI.COMM_SELF))
    shape = tuple(map(len, levelset.grid))
    phi = wavy(levelset.knots).reshape(shape)
    phi = phi + phi[:, ::-1]
    found = levelset.signed_distance(phi.ravel()).reshape(shape)
    assert found == pytest.approx(found[:, ::-1], abs=1e-14)


def test_signed_distance_without_a_zero_line_is_phi_itself() -> None:
    levelset = ffr.LevelSet(rod(MPI.COMM_SELF))
    phi = np.full(len(levelset.knots), 0.3)
    assert np.array_equal(levelset.signed_distance(phi), phi)


@pytest.mark.mpi
def test_boundary_distance_of_a_circle(comm: MPI.Intracomm) -> None:
    """At the centroids and at given points: exact up to the square of the spacing."""

    def exact(x: np.ndarray) -> np.ndarray:
        return np.hypot(x[:, 0] - 0.19, x[:, 1] - 0.003) - 0.025

    errors, spacings = [], []
    for n in (8, 16, 32):
        levelset = ffr.LevelSet(rod(comm, elements=(5 * n, n)))
        alpha = levelset.interpolate(distorted)
        at_cells = levelset.boundary_distance(alpha) - exact(levelset.domain.centroids)
        errors.append(comm.allreduce(float(np.max(np.abs(at_cells), initial=0.0)), MPI.MAX))
        spacings.append(levelset.spacing)
    assert errors[-1] < 0.1 * spacings[-1]
    assert convergence_order(spacings, errors) > 1.8
    points = np.array([[0.19, 0.003], [0.24, 0.003], [0.0, 0.0]])
    found = levelset.boundary_distance(alpha, points)
    assert found == pytest.approx(exact(points), abs=0.1 * spacings[-1])
    assert found[:2] == pytest.approx([-0.025, 0.025], abs=0.1 * spacings[-1])
    assert levelset.boundary_distance(alpha, np.zeros((0, 2))).shape == (0,)


def test_boundary_distance_is_that_of_re_initialisation() -> None:
    levelset = ffr.LevelSet(rod(MPI.COMM_SELF))
    alpha = levelset.interpolate(wavy)
    expected = levelset.signed_distance(levelset.at_knots(alpha))
    found = levelset.boundary_distance(alpha, levelset.knots)
    assert found == pytest.approx(expected, abs=1e-12)


def test_boundary_distance_without_a_boundary_is_infinite() -> None:
    levelset = ffr.LevelSet(rod(MPI.COMM_SELF))
    for sign in (1.0, -1.0):
        alpha = levelset.interpolate(np.full(len(levelset.knots), 0.01 * sign))
        assert np.all(levelset.boundary_distance(alpha) == sign * math.inf)
    for points in ([0.0, 0.0], [[0.0, math.nan]]):
        with pytest.raises(ValueError, match="points in an array"):
            levelset.boundary_distance(alpha, points)


# ---------------------------------------------------------------------- bad input


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"spacing": 0.0}, "spacing must be positive, but it is 0.0"),
        ({"spacing": math.nan}, "spacing must be positive, but it is nan"),
        ({"width": -1.0}, "width must be positive, but it is -1.0"),
        ({"spacing": 0.1}, "leaves fewer than 3 knots across the body"),
        ({"kernel": ffr.Wendland(0.005)}, "does not reach from knot to knot"),
        ({"quadrature": 0}, "quadrature must be a positive whole number"),
        ({"knots": np.zeros((0, 2))}, "no usable knots"),
        ({"knots": np.zeros((5, 3))}, "no usable knots"),
        ({"knots": np.full((5, 2), np.nan)}, "NaN or infinite"),
        ({"knots": np.zeros((5, 2))}, "two knots coincide"),
        ({"knots": scattered()[:200]}, "% of the body is beyond the reach of all knots"),
        ({"spacing": 2e-4, "kernel": ffr.Multiquadric(2e-4)}, "dense matrix of .* GB"),
    ],
)
def test_bad_level_sets_are_refused(
    comm: MPI.Intracomm, options: dict[str, Any], message: str
) -> None:
    domain = rod(comm)
    with pytest.raises(ValueError, match=message):
        ffr.LevelSet(domain, **options)


@pytest.mark.mpi
def test_bad_coefficients_are_refused(comm: MPI.Intracomm) -> None:
    levelset = ffr.LevelSet(rod(comm))
    n = len(levelset.knots)
    for call in (
        levelset.fill_fraction,
        levelset.volume,
        levelset.at_knots,
        lambda a: levelset.pullback(a, np.ones(levelset.domain.n_cells)),
    ):
        with pytest.raises(ValueError, match=f"expected {n} finite coefficients"):
            call(np.ones(n + 1))
        with pytest.raises(ValueError, match="with NaN or infinity"):
            call(np.full(n, np.nan))
    with pytest.raises(ValueError, match=f"expected {n} finite values"):
        levelset.interpolate(np.ones(n - 1))
    for columns, rows, radius in ((0, 1, 0.01), (1, 0, 0.01), (1, 1, -0.01), (1, 1, math.nan)):
        with pytest.raises(ValueError, match="holes must"):
            levelset.with_holes(columns, rows, radius)
