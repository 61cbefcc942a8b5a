# SPDX-License-Identifier: MIT
"""Level set: a mean of its coefficients, densities and penalties with exact derivatives, sizes."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.optimize import brentq
from shared.derivatives import check_slope, difference
from shared.meshes import rod_file

import dolfinx_ffr as ffr
from dolfinx_ffr.verification import convergence_order

LENGTH, HEIGHT = 0.4, 0.08
AXIS = ffr.Mirror((0.2, 0.0), (0.0, 1.0))


def rod(
    comm: MPI.Intracomm, cell: str = "quadrilateral", elements: tuple[int, int] = (40, 8)
) -> ffr.Domain:
    return ffr.Domain.rectangle(comm, LENGTH, HEIGHT, elements=elements, cell=cell)


def box(comm: MPI.Intracomm) -> ffr.Domain:
    return ffr.Domain.box(comm, 0.8, 0.2, 0.3, elements=(16, 4, 6), solid_layers=1)


def wavy(x: np.ndarray) -> np.ndarray:
    """Coefficients of a field with boundaries all over the rod."""
    return np.asarray(0.5 + 0.4 * np.sin(45.0 * x[:, 0] + 0.4) * np.cos(60.0 * x[:, 1] + 0.3))


def ways(x: np.ndarray) -> np.ndarray:
    """A direction in which to change them."""
    return np.asarray(np.cos(31.0 * x[:, 0] - 45.0 * x[:, 1]))


def level_sets(comm: MPI.Intracomm, kind: str, folder: Path) -> ffr.LevelSet:
    """On meshes and knots of several kinds."""
    if kind == "gmsh":
        path = rod_file(comm, folder, length=LENGTH, height=HEIGHT, size=0.016)
        return ffr.LevelSet(ffr.Domain.from_gmsh(comm, path, solid=["solid"]))
    if kind == "mirrored":
        return ffr.LevelSet(rod(comm, "triangle", (20, 4)), mirrors=[AXIS])
    if kind == "box":
        return ffr.LevelSet(box(comm))
    if kind == "order 2":
        domain = ffr.Domain.rectangle(comm, LENGTH, HEIGHT, elements=(20, 4), order=2)
        return ffr.LevelSet(domain, minimum_member=0.03, minimum_gap=0.022)
    return ffr.LevelSet(rod(comm, kind))


@pytest.fixture(scope="module")
def levelset() -> ffr.LevelSet:
    """One on a grid of knots, on one rank."""
    return ffr.LevelSet(rod(MPI.COMM_SELF))


KINDS = ["quadrilateral", "triangle", "order 2", "gmsh", "mirrored", "box"]


def test_the_field_is_a_mean_of_its_coefficients(levelset: ffr.LevelSet) -> None:
    """Even coefficients give an even field, on the body and beside it; none leaves their range."""
    points = np.random.default_rng(0).uniform([-0.005, -0.045], [0.405, 0.045], (500, 2))
    for value in (0.0, 0.3, 1.0):
        np.testing.assert_allclose(levelset.level(levelset.even(value))(points), value - 0.5)
        x = levelset.with_sharpness(1.0).density(levelset.even(value))
        expected = 0.5 + math.tanh(value - 0.5) / (2.0 * math.tanh(0.5))
        np.testing.assert_allclose(x[levelset.domain.design_cells], expected, atol=1e-15)
    u = np.random.default_rng(1).uniform(0.2, 0.7, levelset.size)
    field = levelset.level(u)(points) + 0.5
    assert 0.2 < field.min() < 0.4 and 0.5 < field.max() < 0.7
    # beyond the reach of all knots there is no material
    assert levelset.level(levelset.even(1.0))([[1.0, 1.0]]).tolist() == [-0.5]


def test_default_knots_are_a_grid_of_the_size_of_the_elements(levelset: ffr.LevelSet) -> None:
    """Those that no element sees are left out; a size that is not asked for follows the other."""
    assert levelset.radius == pytest.approx(0.0225)
    # nearly the radius over 2.75, so that they divide the sides
    assert levelset.spacing == pytest.approx(0.4 / 49)
    assert levelset.size == len(levelset.knots) == 50 * 11
    domain = levelset.domain
    coarse = ffr.LevelSet(domain, minimum_member=2.0 * levelset.minimum_member)
    assert coarse.radius == pytest.approx(0.045)
    assert levelset.minimum_gap == pytest.approx(0.00642, abs=1e-5)
    # a gap follows the member, whatever the elements, and a member that a cutter fits beside it
    assert coarse.minimum_gap == coarse.minimum_member == 2.0 * levelset.minimum_member
    assert ffr.LevelSet(domain, minimum_member=0.03).minimum_gap == 0.03
    assert ffr.LevelSet(domain, minimum_gap=0.03).minimum_member == 0.0075


@pytest.mark.mpi
@pytest.mark.parametrize("kind", KINDS)
def test_density_and_penalty_are_differentiated_exactly(
    comm: MPI.Intracomm, kind: str, shared_tmp_path: Path
) -> None:
    """From open to sharp, and eroded."""
    levelset = level_sets(comm, kind, shared_tmp_path)
    domain, u = levelset.domain, wavy(levelset.knots)
    c = domain.centroids
    weight = domain.cell_volumes * (np.sin(40.0 * c[:, 0] + 50.0 * c[:, 1]) + 0.3)
    sharper = [levelset.with_sharpness(sharpness) for sharpness in (1.0, 8.0, 32.0)]
    for design in (*sharper, sharper[-1].eroded):
        direction = 0.5 * ways(levelset.knots) / design.sharpness

        def value(way: float, design: Any = design, direction: Any = direction) -> float:
            return domain.sum(weight * design.density(u + way * direction))

        bar = design.pullback(u, weight)
        assert len(set(comm.allgather(bar.tobytes()))) == 1
        check_slope(value, float(bar @ direction), 1e-2)
        assert bar @ direction == pytest.approx(difference(value, 1e-3), rel=1e-6)
    for design in sharper[::2] if kind in ("order 2", "gmsh", "mirrored", "box") else ():
        direction = ways(levelset.knots) / max(design.sharpness, 8.0)
        penalty, slope = design.penalty(u)
        assert penalty > 0.0
        # its second derivative jumps at the thresholds
        check_slope(
            lambda way, d=design, ahead=direction: d.penalty(u + way * ahead)[0],
            float(slope @ direction),
            1e-2,
        )


@pytest.mark.mpi
def test_density_is_one_with_solid_regions(comm: MPI.Intracomm) -> None:
    """They pass no derivative on."""
    levelset = ffr.LevelSet(rod(comm))
    domain, u = levelset.domain, wavy(levelset.knots)
    x, designed = levelset.density(u), domain.design_cells
    assert np.array_equal(domain.check_density(x), x)
    assert comm.allreduce(np.min(x, initial=1.0), MPI.MIN) < 1e-9
    assert np.all(x[~designed] == 1.0)
    assert np.array_equal(levelset.density(levelset.even(0.0)), np.where(designed, 0.0, 1.0))
    assert not np.any(levelset.pullback(u, np.where(designed, 0.0, 1.0)))


@pytest.mark.mpi
@pytest.mark.parametrize("make", [rod, box])
def test_ranks_hold_the_same_bits_and_the_serial_numbers(
    comm: MPI.Intracomm, make: Callable[[MPI.Intracomm], ffr.Domain]
) -> None:
    results = []
    for each in (comm, MPI.COMM_SELF):
        domain = make(each)
        levelset = ffr.LevelSet(domain)
        c, u = domain.centroids, wavy(levelset.knots)
        bar = levelset.pullback(u, np.sin(40.0 * c[:, 0] + 50.0 * c[:, 1]))
        results.append((levelset.knots, bar, levelset.penalty(u)))
    (knots, bar, (value, slope)), (knots_1, bar_1, (value_1, slope_1)) = results
    for array in (knots, bar, slope, np.array(value)):
        assert len(set(comm.allgather(array.tobytes()))) == 1
    assert np.array_equal(knots, knots_1)
    assert bar == pytest.approx(bar_1, rel=1e-12, abs=1e-13 * np.max(np.abs(bar_1)))
    assert value == pytest.approx(value_1, rel=1e-12)
    assert slope == pytest.approx(slope_1, abs=1e-12 * np.max(np.abs(slope_1)))


@pytest.mark.mpi
def test_sharp_densities_are_what_the_boundary_encloses(comm: MPI.Intracomm) -> None:
    """A disc that is cut out of the rod, whose area the elements' densities are short of."""
    domain = rod(comm, elements=(80, 16))
    levelset = ffr.LevelSet(domain)
    radius = 0.03
    u = levelset.from_distance(lambda x: np.hypot(x[:, 0] - 0.2, x[:, 1]) - radius)
    removed = LENGTH * HEIGHT - domain.sum(domain.cell_volumes * levelset.density(u))
    around = levelset.distance(u, np.array([[0.2, 0.0]]))[0]  # negative: void
    assert removed == pytest.approx(math.pi * around**2, rel=0.005)
    assert -around == pytest.approx(radius, abs=0.1 * levelset.element)
    assert ffr.gray_fraction(domain, levelset.density(u)) < 0.1


def test_a_sharper_design_is_another_object(levelset: ffr.LevelSet) -> None:
    """So is one with its penalty; the level set stays as it was."""
    u = wavy(levelset.knots)
    old_density = levelset.density(u)
    steps = [levelset.at(progress) for progress in (0.0, 0.3, 0.6, 1.0)]
    assert [design.sharpness for design in steps] == pytest.approx([1.0, 32.0**0.5, 32.0, 32.0])
    penalties = [design.penalty(u)[0] for design in steps]
    assert penalties[:2] == [0.0, 0.0] and penalties[3] > penalties[2] > 0.0
    gray = [ffr.gray_fraction(levelset.domain, design.density(u)) for design in steps[:3]]
    assert gray[0] > gray[1] > gray[2]
    assert np.array_equal(levelset.density(u), old_density)
    # near the end it is analysed a little within its boundary
    assert np.array_equal(old_density, steps[-1].nominal.density(u))
    assert np.all(steps[-1].density(u) <= old_density)
    with pytest.raises(ValueError, match="progress must lie between 0 and 1"):
        levelset.at(1.1)


def _share(distance: float, width: float) -> float:
    """F across a strip of coefficients 1, off its middle [radii], by quadrature in closed form."""

    def kernel(s: float) -> float:
        return (1.0 - s) ** 4 * (4.0 * s + 1.0) if s < 1.0 else 0.0

    def across(y: float) -> float:
        half = math.sqrt(max(1.0 - y * y, 0.0))
        return 2.0 * quad(lambda x: kernel(math.hypot(x, y)), 0.0, half)[0]

    low, high = distance - 0.5 * width, distance + 0.5 * width
    return quad(across, max(low, -1.0), min(high, 1.0))[0] / quad(across, -1.0, 1.0)[0]


def test_thresholds_are_those_of_a_strip_of_the_minimum_width() -> None:
    """The strip as wide as the minimum member has f = eta_s in its middle: closed form."""
    domain = ffr.Domain.rectangle(MPI.COMM_SELF, 0.1, 0.08, elements=(10, 8))
    levelset = ffr.LevelSet(domain, minimum_member=0.009, minimum_gap=0.012, spacing=0.0013)
    # what is aimed at is 1.3 times what is asked for
    expected = 1.3 * levelset.minimum_member / levelset.radius

    def enclosed(width: float) -> float:
        return 2.0 * float(brentq(lambda d: _share(d, width) - 0.5, 0.0, 1.0, xtol=1e-6))

    least = brentq(lambda w: _share(0.0, w) - 0.501, 0.1, 0.6)
    width = brentq(lambda w: enclosed(w) - expected, least, 0.6, xtol=1e-5)
    flat = _share(0.0, width)
    assert 0.5 < flat < 0.6
    assert levelset._solid == pytest.approx(flat, abs=2e-4)
    assert levelset._void == pytest.approx(0.4, abs=1e-12)  # the larger size sets the radius
    # and so it is on many knots, each of which stands for its row
    inside = np.abs(levelset.knots[:, 1]) < 0.5 * width * levelset.radius
    rows = np.unique(levelset.knots[:, 1].round(9))
    width = np.unique(levelset.knots[inside, 1].round(9)).size * (rows[1] - rows[0])
    width /= levelset.radius
    along = levelset.level(np.where(inside, 1.0, 0.0))
    assert along([[0.05, 0.0]])[0] + 0.5 == pytest.approx(_share(0.0, width), abs=2e-3)
    half = brentq(lambda y: float(along([[0.05, y]])[0]), 0.0, 0.02)
    assert 2.0 * half == pytest.approx(enclosed(width) * levelset.radius, rel=0.01)


def test_thin_members_and_narrow_gaps_are_penalised() -> None:
    """Much more than those of twice the minimum size, and thin members more than narrow gaps."""
    levelset = ffr.LevelSet(rod(MPI.COMM_SELF), minimum_member=0.0154)

    def penalty(width: float, sign: float) -> float:
        # a strip so wide that f encloses less
        u = np.where(np.abs(levelset.knots[:, 1]) < 0.5 * width + 1e-9, 1.0, 0.0)
        return levelset.penalty(u if sign > 0.0 else 1.0 - u)[0]

    thin, thick = penalty(0.02, 1.0), penalty(0.06, 1.0)
    narrow = penalty(0.02, -1.0)
    assert thin > 10.0 * thick and thin > narrow > 10.0 * penalty(0.06, -1.0)


def test_sizes_that_elements_do_not_resolve_are_left_to_the_boundary() -> None:
    """The part has them, and the elements the smallest that they resolve."""
    domain = rod(MPI.COMM_SELF)
    usual, finer = ffr.LevelSet(domain), ffr.LevelSet(domain, minimum_member=0.004)
    assert usual.minimum_member == pytest.approx(0.006418, rel=1e-3)
    assert (finer.minimum_member, finer.minimum_gap) == (0.004, 0.004)
    assert finer.radius == usual.radius and finer.size == usual.size
    variables = usual.with_holes(4, 2, 0.012)
    assert finer.penalty(variables)[0] == usual.penalty(variables)[0]


NO_LINE, NO_PLANE = (
    r"no mirror line.*mirror_lines\(dom",
    r"is no mirror plane of the b.*_planes\(dom",
)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"minimum_member": 0.05, "minimum_gap": 0.011}, "may differ .* by a factor of four"),
        ({"spacing": 0.1}, "spacing is too large for the body .* fewer than 3 across it"),
        ({"minimum_member": 5.0}, "minimum_member or minimum_gap is too large .* in metres"),
        ({"spacing": 0.04}, "% of the body is beyond the reach of all knots"),
        ({"mirrors": [ffr.Mirror((0.2, 0.01), (0.0, 1.0))]}, NO_LINE),
        ({"mirrors": [ffr.Mirror((0.2, 0.0), (-0.2, 1.0))]}, NO_LINE),
        ({"mirrors": [ffr.Mirror((0.15, 0.0), (1.0, 0.0))]}, NO_LINE),
        ({"mirrors": [(1.0, 0.0)]}, "a list of mirror lines of the body"),
        ({"mirrors": [ffr.Mirror((0.1, 0.0, 0.0), (1.0, 0.0, 0.0))]}, NO_PLANE),
        ({"mirrors": [ffr.Mirror((0.0, 0.0), (1.0, 0.0))]}, "is no mirror plane of the body"),
    ],
)
def test_bad_level_sets_are_refused(
    comm: MPI.Intracomm, options: dict[str, Any], message: str
) -> None:
    domain = box(comm) if "plane" in message else rod(comm)
    with pytest.raises(TypeError if "list" in message else ValueError, match=message):
        ffr.LevelSet(domain, **options)


@pytest.mark.mpi
def test_start_with_holes(comm: MPI.Intracomm) -> None:
    """The holes have nearly their area, and lie alike on both sides of the axis."""
    domain = rod(comm, elements=(80, 16))
    levelset = ffr.LevelSet(domain)
    u = levelset.with_holes(6, 2, 0.012)
    removed = LENGTH * HEIGHT - domain.sum(domain.cell_volumes * levelset.density(u))
    # the kernel rounds them off by less than a fifth of an element all around
    smaller, full = (12 * math.pi * r**2 for r in (0.012 - 0.2 * levelset.element, 0.012))
    assert smaller < removed < full
    for rows in (1, 3, 4):
        field = levelset.level(levelset.with_holes(5, rows, 0.01))
        points = np.column_stack([np.linspace(0.0, 0.4, 60), np.linspace(-0.04, 0.04, 60)])
        np.testing.assert_allclose(field(points), field(points * [1.0, -1.0]), atol=1e-12)
    staggered = levelset.level(levelset.with_holes(4, 3, 0.01, margin=0.02))
    signs = np.sign(staggered([[0.05, -0.02], [0.1, 0.0], [0.05, 0.0], [0.1, 0.02]]))
    assert signs.tolist() == [-1.0, -1.0, 1.0, 1.0]


def test_a_start_begins_with_a_quarter_of_its_contrast(levelset: ffr.LevelSet) -> None:
    start = levelset.with_holes(4, 1, 0.014)
    assert start.min() < 0.31 and start.max() == 1.0
    np.testing.assert_allclose(levelset.begin(start) - 0.5, 0.25 * (start - 0.5))
    beyond = np.linspace(-1.0, 2.0, levelset.size)
    np.testing.assert_array_equal(levelset.check(beyond), np.clip(beyond, 0.0, 1.0))
    assert np.array_equal(levelset.even(), np.full(levelset.size, 0.5))


@pytest.mark.mpi
def test_distance_of_a_circle(comm: MPI.Intracomm) -> None:
    """At the centroids and at given points: exact up to the square of the spacing."""

    def exact(x: np.ndarray) -> np.ndarray:
        return np.hypot(x[:, 0] - 0.19, x[:, 1] - 0.003) - 0.025

    errors, spacings = [], []
    for n in (8, 16, 32):
        levelset = ffr.LevelSet(rod(comm, elements=(5 * n, n)))
        u = levelset.from_distance(exact)
        at_cells = levelset.distance(u) - exact(levelset.domain.centroids)
        errors.append(comm.allreduce(float(np.max(np.abs(at_cells), initial=0.0)), MPI.MAX))
        spacings.append(levelset.spacing)
    assert errors[-1] < 0.15 * spacings[-1]
    assert convergence_order(spacings, errors) > 1.8
    points = np.array([[0.19, 0.003], [0.24, 0.003], [0.0, 0.0]])
    distances = levelset.distance(u, points)
    assert distances == pytest.approx(exact(points), abs=0.15 * spacings[-1])
    assert levelset.distance(u, np.zeros((0, 2))).shape == (0,)


@pytest.mark.mpi
def test_distance_from_a_ball(comm: MPI.Intracomm) -> None:
    """The boundary of a ball is a ball, up to what the kernel smooths."""

    def exact(x: np.ndarray) -> np.ndarray:
        return np.linalg.norm(x - [0.4, 0.0, 0.0], axis=1) - 0.13

    domain = ffr.Domain.box(comm, 0.8, 0.4, 0.4, elements=(16, 8, 8), solid_layers=0)
    levelset, off = ffr.LevelSet(domain), exact(domain.centroids)
    near, distances = np.abs(off) < 0.1, levelset.distance(levelset.from_distance(exact))
    assert_allclose(distances[near], off[near], atol=0.25 * levelset.element)
    assert np.all(np.isposinf(levelset.distance(levelset.even(1.0))))


def test_distance_without_a_boundary_is_infinite(levelset: ffr.LevelSet) -> None:
    for value, distance in ((1.0, math.inf), (0.2, -math.inf)):
        assert np.all(levelset.distance(levelset.even(value)) == distance)
    for points in ([0.0, 0.0], [[0.0, math.nan]]):
        with pytest.raises(ValueError, match="points in an array"):
            levelset.distance(levelset.even(), points)
