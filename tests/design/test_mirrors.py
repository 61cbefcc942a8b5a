# SPDX-License-Identifier: MIT
"""Mirror lines and planes: the images they generate, those of a body, of a gradient."""

from __future__ import annotations

import math

from mpi4py import MPI

import numpy as np
import pytest
import shapely
from meshes.connecting_rod import ConnectingRod
from numpy.testing import assert_allclose
from shared.meshes import annulus, plate, prongs
from shared.problems import slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.design.mirrors import images


def line(degrees: float, point: tuple[float, float] = (0.3, -0.1)) -> ffr.Mirror:
    return ffr.Mirror(point, (-math.sin(math.radians(degrees)), math.cos(math.radians(degrees))))


def angles(mirrors: list[ffr.Mirror]) -> list[float]:
    """Of the lines [degrees]."""
    return [round(math.degrees(math.atan2(-m.normal[0], m.normal[1])) % 180.0, 3) for m in mirrors]


@pytest.mark.parametrize(
    ("degrees", "number"),
    [((), 1), ((0,), 2), ((10, 10), 2), ((0, 90), 4), ((0, 36), 10)],
)
def test_lines_at_an_angle_of_pi_over_n_have_2n_images(
    degrees: tuple[float, ...], number: int
) -> None:
    axes = images([line(angle) for angle in degrees])
    assert len(axes) == number
    np.testing.assert_array_equal(axes[0].turn, np.eye(2))
    points = np.array([[0.1, 0.4], [0.7, 0.2], [-0.3, 0.5]])
    center = np.array([0.3, -0.1])
    for image in axes:
        np.testing.assert_allclose(image.turn @ image.turn.T, np.eye(2), atol=1e-14)
        np.testing.assert_allclose(
            np.linalg.norm(image(points) - center, axis=1), np.linalg.norm(points - center, axis=1)
        )


def test_lines_without_an_end_of_images_are_refused() -> None:
    for mirrors in ([line(0), line(0, (0.3, 0.2))], [line(0), line(math.sqrt(2.0))]):
        with pytest.raises(ValueError, match="must meet in one point at angles that divide"):
            images(mirrors)


@pytest.mark.mpi
def test_lines_of_bodies(comm: MPI.Intracomm) -> None:
    """Two of a rectangle on either mesh, four of a square, twelve of a ring, two of a fork."""
    for cell in ("quadrilateral", "triangle"):
        domain = ffr.Domain.rectangle(comm, 0.4, 0.08, elements=(20, 4), cell=cell)
        mirrors = ffr.mirror_lines(domain)
        assert angles(mirrors) == [0.0, 90.0]
        assert len({mirrors[0].point, mirrors[1].point}) == 1
        assert mirrors[0].point == pytest.approx((0.2, 0.0), abs=1e-14)
        assert len(set(comm.allgather(repr(mirrors)))) == 1
    assert angles(ffr.mirror_lines(plate(comm, 8, hole=2))) == [0.0, 45.0, 90.0, 135.0]
    assert len(ffr.mirror_lines(annulus(comm, 24, 3))) == 12
    assert angles(ffr.mirror_lines(prongs(comm))) == [0.0, 90.0]
    # one that is solid at one end only has one line less
    domain = ffr.Domain.rectangle(comm, 0.4, 0.08, elements=(20, 4), solid=lambda x: x[0] < 0.11)
    assert angles(ffr.mirror_lines(domain)) == [0.0]


@pytest.mark.mpi
def test_the_gradient_confirms_the_axis_of_the_slider_crank(comm: MPI.Intracomm) -> None:
    """The rod's two ends bear different loads; above and below, run backwards, they are alike."""
    problem = slider_crank(comm)
    domain = problem.flexible["rod"].domain
    x = np.where(domain.design_cells, 0.5, 1.0)
    gradient = problem.gradient(x).gradient
    assert gradient is not None
    assert angles(ffr.mirror_lines(domain)) == [0.0, 90.0]
    assert angles(ffr.mirror_lines(domain, gradient["rod"])) == [0.0]
    with pytest.raises(ValueError, match="mirror lines: gradient"):
        ffr.mirror_lines(domain, gradient["rod"][1:])


@pytest.mark.mpi
def test_a_graded_mesh_without_the_symmetry_of_its_body(comm: MPI.Intracomm) -> None:
    """Image cells are none of the mesh: a gradient is compared between centroids."""
    domain = ConnectingRod().domain(comm, 0.005)
    assert angles(ffr.mirror_lines(domain)) == [0.0]
    x, y = 10.0 * domain.centroids.T
    density = np.cos(x) + np.cos(3.0 * y)
    assert angles(ffr.mirror_lines(domain, domain.cell_volumes * density)) == [0.0]
    odd = density + 0.1 * np.sin(5.0 * y)
    with pytest.warns(
        UserWarning, match=r"no mirror symmetry.*the gradient differs.*% of it have no image"
    ):
        assert angles(ffr.mirror_lines(domain, domain.cell_volumes * odd)) == []


def eyes(comm: MPI.Intracomm, size: float, bolt: float = 0.0) -> ffr.Domain:
    """A rod between two eyes with rims, and a bolt hole above its axis, from a drawing."""
    middles = shapely.MultiPoint([(0, 0), (0.15, 0)])
    shape = shapely.box(0, -0.014, 0.15, 0.014).union(middles.buffer(0.02, 48))
    shape = shape.difference(middles.buffer(0.009, 48))
    shape = shape.difference(shapely.Point(0.075, 0.007).buffer(bolt))
    bores = {"bores": lambda x: np.hypot(0.075 - np.abs(x[0] - 0.075), x[1]) < 0.0092}
    return ffr.Domain.from_outline(comm, shape, interfaces=bores, size=size, solid_rim=0.004)


@pytest.mark.mpi
def test_lines_of_a_drawing_whatever_its_mesh(comm: MPI.Intracomm) -> None:
    """Triangles have no images; a bolt hole beside a line, smaller than they are, tells."""
    domain = eyes(comm, 0.006)
    mirrors = ffr.mirror_lines(domain)
    assert angles(mirrors) == [0.0, 90.0]
    assert len(ffr.LevelSet(domain, mirrors=mirrors).mirrors) == 2
    assert angles(ffr.mirror_lines(eyes(comm, 0.006, bolt=0.0025))) == [90.0]


def rod(comm: MPI.Intracomm, width: float = 0.3, cell: str = "", **options: object) -> ffr.Domain:
    """A short rod of cubes, or of squares or triangles."""
    if cell:
        kind = "triangle" if cell == "triangle" else "quadrilateral"
        return ffr.Domain.rectangle(comm, 0.8, 0.2, elements=(16, 4), cell=kind)
    options |= {"elements": (16, 4, round(width / 0.05)), "solid_layers": 1}
    return ffr.Domain.box(comm, 0.8, 0.2, width, **options)  # type: ignore[arg-type]


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("body", "number"), [((0.3, ""), 3), ((0.2, ""), 5), ((0.0, "triangle"), 2), ((0.0, "quad"), 2)]
)
def test_a_mirrored_level_set_is_symmetric_exactly(
    comm: MPI.Intracomm, body: tuple[float, str], number: int
) -> None:
    """Whatever the coefficients and the mesh: a triangle's mirror image is none of the mesh.

    A square rod has the diagonals as planes, too.
    """
    width, cell = body
    domain = rod(comm, width, cell)
    find = ffr.mirror_planes if width else ffr.mirror_lines
    axes = find(domain)
    assert len(axes) == number
    weight = domain.cell_volumes * (1.0 + domain.centroids[:, 1])
    assert len(find(domain, weight)) < number
    levelset = ffr.LevelSet(domain, mirrors=axes[:2])
    u = np.random.default_rng(0).uniform(0.0, 1.0, levelset.size)
    levels, d = levelset.level(u), domain.dimension
    points = np.random.default_rng(1).uniform(-0.1, 0.1, (200, d)) + 0.4 * np.eye(d)[0]
    for mirror in axes[:2]:
        assert_allclose(levels(points), levels(mirror.reflection(points)), atol=1e-13)
    assert np.ptp(levels(points)) > 0.1
    assert len(levelset.identity()["mirrors"]) == 2


@pytest.mark.mpi
def test_a_body_without_mirror_planes(comm: MPI.Intracomm) -> None:
    """The warning has the reason for each plane that was looked for."""
    domain = rod(comm, void=lambda x: (np.abs(x[0] - 0.5) < 0.11) & (x[1] > -1e-9) & (x[2] > -1e-9))
    with pytest.warns(
        UserWarning, match="mirror planes: the body has no.*are designed and their image is not"
    ):
        assert ffr.mirror_planes(domain) == []
    with pytest.raises(ValueError, match="the body has 3 dimensions; take mirror_planes"):
        ffr.mirror_lines(domain)
