# SPDX-License-Identifier: MIT
"""Parts in STEP files, as CAD programs use them: masses, offsets of tool paths, meshes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import shapely
from meshes.connecting_rod import ConnectingRod
from scipy.spatial import cKDTree
from shared.rods import STEEL

import dolfinx_ffr as ffr
from dolfinx_ffr.boundary.curve import FreeCurve
from dolfinx_ffr.fem import Line, gmsh_model

#: Radius of the cutter by which outlines are offset [mm]
CUTTER = 1.0


def rounds(*holes: tuple[float, float, float]) -> Callable[[np.ndarray], np.ndarray]:
    """A field that is zero on ellipses, twice as long as high, of centres and half heights [m]."""

    def field(p: np.ndarray) -> np.ndarray:
        holes_of_part = [np.hypot((p[:, 0] - x) / 2.0, p[:, 1] - y) - r for x, y, r in holes]
        return np.min(holes_of_part, axis=0)

    return field


def rod() -> ffr.Part:
    """A bar whose sides move, between solid ends, as of most demos."""
    body = ffr.Domain.rectangle(MPI.COMM_SELF, 0.4, 0.04, elements=(80, 8))
    holes = rounds((0.1, 0.0, 0.007), (0.22, 0.001, 0.01))

    def field(p: np.ndarray) -> np.ndarray:
        waist = 0.016 + 0.003 * np.cos(30.0 * p[:, 0]) - np.abs(p[:, 1])
        return np.minimum(holes(p), waist)

    return ffr.Boundary.of(ffr.Part(body, field, material=STEEL), 0.003).part


def connecting_rod() -> ffr.Part:
    """The rod of a gmsh mesh, whose outline stays."""
    body = ConnectingRod().domain(MPI.COMM_SELF, 0.01, order=2)
    part = ffr.Part(body, rounds((0.2, 0.0, 0.009)), material=STEEL)
    return ffr.Boundary.of(part, 0.003, outline=False).part


def outline() -> ffr.Part:
    """A drawn arm with two eyes, whose outline begins and ends on them."""
    eyes = [shapely.Point(x, 0.0).buffer(0.02, 48) for x in (0.0, 0.15)]
    bores = [shapely.Point(x, 0.0).buffer(0.009, 48) for x in (0.0, 0.15)]
    drawn = shapely.union_all([shapely.box(0.0, -0.014, 0.15, 0.014), *eyes])
    body = ffr.Domain.from_outline(
        MPI.COMM_SELF,
        drawn.difference(shapely.union_all(bores)),
        interfaces={
            "left": lambda x: np.hypot(x[0], x[1]) < 0.0092,
            "right": lambda x: np.hypot(x[0] - 0.15, x[1]) < 0.0092,
        },
        size=0.004,
        solid_rim=0.004,
    )
    return ffr.Boundary.of(ffr.Part(body, rounds((0.075, 0.0, 0.006)), material=STEEL), 0.004).part


def link() -> ffr.Part:
    """A link of dimensions, of lines and arcs."""
    low, high = (
        [[0.0, -0.02], [0.15, -0.01], [0.3, -0.015]],
        [[0.3, 0.015], [0.15, 0.01], [0, 0.02]],
    )
    body = ffr.Domain.from_outline(
        MPI.COMM_SELF,
        [[low, [low[-1], high[0]], high, [high[-1], low[0]]]],
        interfaces={"left": lambda x: x[0] < 1e-9, "right": lambda x: x[0] > 0.3 - 1e-9},
        size=0.01,
        order=2,
    )
    return ffr.Part(body, lambda p: np.ones(len(p)), material=STEEL)


@pytest.fixture(scope="module", params=[rod, connecting_rod, outline, link])
def part(request: pytest.FixtureRequest) -> ffr.Part:
    part_of_test: ffr.Part = request.param()
    return part_of_test


@pytest.fixture
def cad(part: ffr.Part, tmp_path: Path) -> Iterator[Any]:
    """OpenCASCADE, by gmsh, with the part's STEP file."""
    (path,) = part.write(tmp_path / "part.step")
    with gmsh_model() as gmsh:
        gmsh.model.occ.importShapes(str(path))
        gmsh.model.occ.synchronize()
        yield gmsh


def base_edges(gmsh: Any) -> tuple[np.ndarray, np.ndarray]:
    """Points and derivatives along each edge of the face at z = 0, (edges, points, 2) [mm]."""
    tops = {tag: gmsh.model.getBoundingBox(2, tag)[5] for _, tag in gmsh.model.getEntities(2)}
    base = min(tops, key=lambda tag: tops[tag])
    points, slopes = [], []
    for _, tag in gmsh.model.getBoundary([(2, base)], oriented=False):
        (first,), (last,) = gmsh.model.getParametrizationBounds(1, tag)
        t = np.linspace(first, last, 41)
        points.append(gmsh.model.getValue(1, tag, t).reshape(-1, 3)[:, :2])
        slopes.append(gmsh.model.getDerivative(1, tag, t).reshape(-1, 3)[:, :2])
    return np.array(points), np.array(slopes)


def test_the_mass_in_cad_is_that_of_the_part(part: ffr.Part, cad: Any) -> None:
    ((_, solid),) = cad.model.getEntities(3)
    volume = 1e-9 * cad.model.occ.getMass(3, solid)
    assert volume == pytest.approx(part.area * part.thickness, rel=1e-9)


def test_outlines_can_be_offset(cad: Any) -> None:
    """Edges join, each has a normal all along, and a millimetre along it is a millimetre away."""
    points, slopes = base_edges(cad)
    speed = np.linalg.norm(slopes, axis=2)
    assert np.all(np.min(speed, axis=1) > 0.1 * np.max(speed, axis=1))

    tangents = slopes / speed[:, :, None]
    ends, along = (holes_of_part[:, [0, -1]].reshape(-1, 2) for holes_of_part in (points, tangents))
    joins = cKDTree(ends).query_pairs(1e-6, output_type="ndarray")
    assert sorted(joins.ravel()) == list(range(len(ends)))

    # a cutter goes round a corner, or does not come near it
    one, other = along[joins].transpose(1, 2, 0)
    corners = ends[joins[np.abs(one[0] * other[1] - one[1] * other[0]) > 1e-2, 0]]
    cut = points.reshape(-1, 2)
    far = shapely.distance(shapely.MultiPoint(corners), shapely.points(cut)) > 2.0 * CUTTER
    far |= not len(corners)
    normals = tangents.reshape(-1, 2)[:, ::-1] * [1.0, -1.0]
    outline = shapely.MultiLineString(list(points))
    for side in (CUTTER, -CUTTER):
        path = shapely.points((cut + side * normals)[far])
        np.testing.assert_allclose(shapely.distance(outline, path), CUTTER, atol=0.01)


def test_meshing_by_curvature_ends(part: ffr.Part, cad: Any) -> None:
    for _, tag in cad.model.getEntities(1):
        (first,), (last,) = cad.model.getParametrizationBounds(1, tag)
        curvature = cad.model.getCurvature(1, tag, np.linspace(first, last, 41))
        assert np.max(curvature) < 1.0  # [1/mm]
    options = {"Mesh.MeshSizeFromCurvature": 12, "Mesh.MeshSizeMax": 10.0}
    with ExitStack() as stack:
        for name, value in options.items():
            stack.callback(cad.option.setNumber, name, cad.option.getNumber(name))
            cad.option.setNumber(name, value)
        cad.model.mesh.generate(1)
    around = sum(cad.model.occ.getMass(1, tag) for _, tag in cad.model.getEntities(1))
    edges = len(cad.model.getEntities(1))
    assert len(cad.model.mesh.getNodes()[0]) < around / 1.0 + 2 * edges


def test_a_curve_that_moved_ends_in_lines() -> None:
    """Its first and last polynomials are straight; what is between has a slope everywhere."""
    x = np.linspace(0.0, 0.1, 800)
    curve = FreeCurve.fit(np.column_stack([x, 1e-3 * np.sin(60.0 * x)]), 5e-3, (3, 7))
    first, middle, last = curve.spline().with_lines()
    assert isinstance(first, Line)
    assert isinstance(last, Line)
    spans = np.array([1.0, curve.spans - 1.0])
    np.testing.assert_allclose([first.end, last.start], curve.at(spans), atol=1e-15)
    t = np.linspace(0.0, 1.0, 301)
    np.testing.assert_allclose(middle.at(t), curve.at(spans[0] + np.ptp(spans) * t), atol=1e-15)
    speed = np.linalg.norm(middle.slope(t), axis=1)
    assert np.min(speed) > 0.4 * np.max(speed)
