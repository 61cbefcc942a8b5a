# SPDX-License-Identifier: MIT
"""Domains from outlines: DXF, polygons; what is refused."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

import ezdxf
import numpy as np
import pytest
import shapely
from ezdxf.xclip import XClip

from dolfinx_ffr import Domain, Part
from dolfinx_ffr.fem import _compat


def left(x: np.ndarray) -> np.ndarray:
    return x[0] < 1e-9


Draw = Callable[[Any, Any], object]


def drawn(path: Path, draw: Draw, unit: int = 4) -> Path:
    """A DXF file with what ``draw`` adds to a drawing and its modelspace."""
    drawing = ezdxf.new("R2010")
    drawing.header["$INSUNITS"] = unit
    drawing.layers.add("pin")
    draw(drawing, drawing.modelspace())
    drawing.saveas(path)
    return path


def rectangle(drawing: Any, space: Any) -> None:
    """A closed polyline of 100 x 20 with a round right end of radius 10."""
    points = [(0, -10, 0), (100, -10, 1), (100, 10, 0), (0, 10, 0)]
    space.add_lwpolyline(points, format="xyb", close=True)


@pytest.mark.mpi
def test_dxf_with_all_kinds_of_curves(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """Polylines with arcs, a circle on a layer, a block, an ellipse, a closed spline; no notes."""

    def draw(drawing: Any, space: Any) -> None:
        rectangle(drawing, space)
        space.add_circle((100, 0), 4, dxfattribs={"layer": "pin"})
        block = drawing.blocks.new("slot")
        block.add_ellipse((0, 0), major_axis=(6, 0), ratio=0.5)
        space.add_blockref("slot", (30, 0))
        space.add_text("a note").set_placement((50, 50))
        space.add_spline(fit_points=[(60, -3), (66, 0), (60, 3), (54, 0), (60, -3)])

    path = shared_tmp_path / "rod.dxf"
    if comm.rank == 0:
        drawn(path, draw)
    comm.Barrier()
    sides = {"pin": "pin", "wall": left}
    body = Domain.from_outline(comm, path, interfaces=sides, size=0.002, order=2)
    ellipse, bore = np.pi * 0.006 * 0.003, np.pi * 0.004**2
    plain = 0.1 * 0.02 + 0.5 * np.pi * 0.01**2 - ellipse - bore
    hole = plain - body.area
    assert 0.5 * 12e-3 * 6e-3 < hole < 12e-3 * 6e-3  # between rhombus and rectangle
    np.testing.assert_allclose(body.interfaces["pin"].center, [0.1, 0.0], atol=1e-12)
    np.testing.assert_allclose(body.interfaces["wall"].center, [0.0, 0.0], atol=1e-12)
    assert body.interfaces["wall"].extent == pytest.approx(0.02, rel=1e-12)
    # a part of large straight cells has the bore as an arc
    coarse = Domain.from_outline(comm, path, interfaces=sides, size=0.008)
    assert len(Part(coarse, lambda x: np.ones(len(x))).interface("pin")) == 1


def vertices_of(body: Domain, cells: np.ndarray) -> np.ndarray:
    """The vertices of this rank's cells, (vertices, 2)."""
    nodes = np.unique(_compat.cell_geometry(body.mesh)[: body.n_cells, :3][cells])
    return body.mesh.geometry.x[nodes, :2]


@pytest.mark.mpi
def test_a_rim_of_solid_cells(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """Circles around bores, two of them as one, and a straight line along a wall."""

    def draw(drawing: Any, space: Any) -> None:
        rectangle(drawing, space)
        for x, radius in ((97, 4), (40, 5), (53, 5)):
            space.add_circle((x, 0), radius, dxfattribs={"layer": f"pin{x}"})

    path = shared_tmp_path / "rod.dxf"
    if comm.rank == 0:
        drawn(path, draw)
    comm.Barrier()
    make = partial(Domain.from_outline, comm, path, size=0.002, order=2)
    body = make(interfaces={f"pin{x}": f"pin{x}" for x in (97, 40, 53)}, solid_rim=0.002)
    solid, x = body.solid_cells, body.centroids[:, 0]
    ring = body.sum(body.cell_volumes * (solid & (x > 0.07)))
    assert ring == pytest.approx(np.pi * (0.006**2 - 0.004**2), rel=1e-3)
    lens = 2 * 0.007**2 * np.arccos(6.5 / 7) - 0.0065 * np.sqrt(4 * 0.007**2 - 0.013**2)
    two_ends = body.sum(body.cell_volumes * (solid & (x < 0.07)))
    assert two_ends == pytest.approx(2 * np.pi * (0.007**2 - 0.005**2) - lens, rel=1e-3)
    assert not body.designed_interfaces
    wall = make(interfaces={"wall": left}, solid_rim=0.004)
    assert wall.sum(wall.cell_volumes * wall.solid_cells) == pytest.approx(0.004 * 0.02, rel=1e-9)
    with pytest.raises(ValueError, match=r"solid_rim must be at least 0\.001.*but it is 0\.0005 m"):
        make(interfaces={"wall": left}, solid_rim=0.0005)


@pytest.mark.parametrize("width", [0.003, 0.006, 0.0085, 0.0108, 0.013])
def test_a_rim_of_a_bore_that_a_predicate_names(comm: MPI.Comm, width: float) -> None:
    """Of polygons, within the eye, nearly as wide and wider; a half bore at the other end."""
    eyes = shapely.MultiPoint([(0.0, 0.0), (0.1, 0.0)])
    bar = shapely.box(0, -0.014, 0.1, 0.014).union(eyes.buffer(0.02, 48))
    bar = bar.difference(eyes.buffer(0.009, 48)).intersection(shapely.box(-1, -1, 0.1, 1))

    def off(x: np.ndarray) -> np.ndarray:
        """The distance from the nearer bore."""
        return np.hypot(0.05 - np.abs(x[0] - 0.05), x[1]) - 0.009

    interfaces = {"a": lambda x: np.abs(off(x)) < 1e-5}
    body = Domain.from_outline(comm, bar, interfaces=interfaces, size=0.004, solid_rim=width)
    solid, designed = (off(vertices_of(body, on).T) for on in (body.solid_cells, body.design_cells))
    # a layer as thin as a twentieth of its width belongs to it; ends on the outline may be moved
    # by a hundredth
    assert np.max(solid) < (1.05 if 0.01 < width < 0.011 else 1.01) * width
    assert np.min(designed) > 0.99 * width
    # polygons by which curves are crossed are as accurate as that
    assert np.count_nonzero(np.abs(solid - width) < 1e-4 * width) > 5


@pytest.mark.parametrize(
    ("code", "unit", "length"), [(4, None, 0.1), (6, None, 100.0), (0, "cm", 1)]
)
def test_units(comm: MPI.Comm, tmp_path: Path, code: int, unit: str | None, length: float) -> None:
    path = drawn(tmp_path / "rod.dxf", rectangle, code)
    body = Domain.from_outline(
        comm, path, interfaces={"a": left}, size=length / 5, unit=unit, order=2
    )
    area = length**2 * (0.2 + 0.5 * np.pi * 0.01)
    assert body.area == pytest.approx(area, rel=1e-3)


def test_polygons(comm: MPI.Comm) -> None:
    """Rings of points, with a hole and a piece of its own in the hole; polygons of shapely."""
    rings = [np.array(shapely.box(*b).exterior.coords) for b in ((0, 0, 9, 9), (1, 1, 8, 8))]
    island = np.array(shapely.box(3, 3, 5, 5).exterior.coords)[::-1]
    interfaces = {"a": lambda x: x[0] < 1e-9, "b": lambda x: np.isclose(x[0], 0.003)}
    body = Domain.from_outline(comm, [*rings, island], interfaces=interfaces, size=0.001, unit="mm")
    assert body.area == pytest.approx(1e-6 * (81 - 49 + 4), rel=1e-12)
    shape = shapely.box(0, 0, 9, 9).difference(shapely.box(1, 1, 8, 8))
    body = Domain.from_outline(comm, shape, interfaces={"a": left}, size=1.0)
    assert body.area == pytest.approx(32.0, rel=1e-12)
    assert body.interfaces["a"].extent == pytest.approx(9.0)


def in_itself(drawing: Any, space: Any) -> None:
    for name, inner in (("A", "b"), ("b", "a")):
        drawing.blocks.new(name).add_blockref(inner, (1, 0))
    space.add_blockref("a", (0, 0))


def clipped(drawing: Any, space: Any) -> None:
    drawing.blocks.new("hole").add_circle((0, 0), 4)
    XClip(space.add_blockref("hole", (0, 0))).set_block_clipping_path([(0, 0), (9, 9)])


def on_hidden_layer(drawing: Any, space: Any) -> None:
    drawing.layers.get("pin").off()
    space.add_circle((0, 0), 4, dxfattribs={"layer": "pin"})


def beside(add: Callable[[Any], object]) -> Draw:
    """The rectangle and something else."""
    return lambda drawing, space: (rectangle(drawing, space), add(space))


CORNERS = [(0, 0), (100, 0), (100, 20), (0, 20), (0, 0.5)]


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (
            lambda drawing, space: space.add_lwpolyline(CORNERS),
            r"the outline is open: 2 curves end .* 0\.5 mm from the nearest other end",
        ),
        (
            lambda drawing, space: space.add_lwpolyline(np.array(CORNERS)[[0, 2, 1, 3, 0]]),
            r"the outline crosses itself at \(50, 10\) mm",
        ),
        (beside(lambda space: space.add_line((0, -10), (100, 10))), r"3 curves meet at"),
        (
            beside(lambda space: space.add_circle((50, 10), 5)),
            r"two closed curves of the outline cross or touch at \((45|55), 10\) mm",
        ),
        (
            beside(lambda space: space.add_3dface([(0, 0, 0), (1, 0, 0), (1, 1, 0)])),
            r"holds a 3DFACE, which is no curve in the plane",
        ),
        (lambda drawing, space: None, "it holds no curves"),
        (in_itself, "the block 'a' contains itself|the block 'A' contains itself"),
        (clipped, "an insert of the block 'hole' is clipped"),
        (
            lambda drawing, space: space.add_blockref("bracket", (0, 0)),
            "the block 'bracket' is not in the file; bind",
        ),
        (on_hidden_layer, "no curves that are drawn; hidden ones, and those on layers"),
        (
            lambda drawing, space: space.add_circle((0, 0), 4, dxfattribs={"extrusion": (0, 1, 0)}),
            "holds a CIRCLE, which is no curve in the plane",
        ),
    ],
)
def test_faulty_drawings(comm: MPI.Comm, tmp_path: Path, draw: Draw, message: str) -> None:
    path = drawn(tmp_path / "rod.dxf", draw)
    with pytest.raises(ValueError, match=message):
        Domain.from_outline(comm, path, interfaces={"a": left}, size=0.01)


def test_an_entity_of_an_unknown_kind(comm: MPI.Comm, tmp_path: Path) -> None:
    path = drawn(tmp_path / "rod.dxf", rectangle)
    path.write_text(path.read_text().replace("\nLWPOLYLINE\n", "\nLW^OLYLINE\n"))
    with pytest.raises(ValueError, match=r"a LW\^OLYLINE cannot be placed"):
        Domain.from_outline(comm, path, interfaces={"a": left}, size=0.01)


@pytest.mark.parametrize("outline", [[], shapely.Polygon(), [np.zeros((0, 2))], [np.ones((3, 2))]])
def test_empty_outlines(comm: MPI.Comm, outline: Any) -> None:
    with pytest.raises(ValueError, match="outline: it is empty; give rings of at least three"):
        Domain.from_outline(comm, outline, interfaces={"a": left}, size=0.01)


def test_triangles_larger_than_the_outline(comm: MPI.Comm) -> None:
    """A size in a wrong unit is refused, one that is too coarse to compute with is told."""
    bar = shapely.box(0.0, 0.0, 0.1, 0.02)
    with pytest.raises(ValueError, match=r"size = 2 m is larger than the outline of 0\.1 m x"):
        Domain.from_outline(comm, bar, interfaces={"a": left}, size=2.0)
    with pytest.warns(UserWarning, match=r"than the outline .* is across.*give 0\.002 m or less"):
        Domain.from_outline(comm, bar, interfaces={"a": left}, size=0.03)


def test_a_wall_that_is_thinner_than_chords_bend(comm: MPI.Comm, tmp_path: Path) -> None:
    """Cells that cross are refused with the place before gmsh would divide them without end."""

    def draw(drawing: Any, space: Any) -> None:
        space.add_circle((0, 0), 100)
        space.add_circle((49.5 * np.cos(0.3), 49.5 * np.sin(0.3)), 50)

    path = drawn(tmp_path / "disc.dxf", draw)
    place = r"almost touch, near \(0\.0\d+, -?0\.0\d+\) m where cells of 0\.05 m"
    with pytest.raises(ValueError, match=place):
        Domain.from_outline(comm, path, interfaces={"a": left}, size=0.05)
    fine = Domain.from_outline(comm, path, interfaces={"a": lambda x: x[0] > 0.09}, size=0.003)
    assert fine.cell_volumes.sum() == pytest.approx(np.pi * (0.1**2 - 0.05**2), rel=2e-3)


@pytest.mark.mpi
def test_what_is_missing(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """Errors come on every rank, before anything is meshed."""
    path = shared_tmp_path / "rod.dxf"
    if comm.rank == 0:
        drawn(path, rectangle, 0)
        (shared_tmp_path / "broken.dxf").write_text("no drawing")
    comm.Barrier()

    no_unit, unreadable = r"does not say its unit.*give unit='mm'", "file that can be read"
    faults: list[tuple[str, dict[str, Any], type[Exception], str]] = [
        ("rod.dxf", {"unit": None}, ValueError, no_unit),
        ("broken.dxf", {}, ValueError, unreadable),
        ("rod.dxf", {"interfaces": {"a": "b"}}, ValueError, r"no curve has the name 'b'.*\['0'\]"),
        ("rod.dxf", {"unit": "foot"}, ValueError, "outline: unit must be one of"),
        ("rod.svg", {}, ValueError, r"ends in \.dxf, .* Inkscape, save \.dxf, too"),
        ("none.dxf", {}, FileNotFoundError, "does not exist"),
        ("rod.dxf", {"size": 0.0}, ValueError, "size must be positive"),
    ]
    for name, options, error, message in faults:
        settings = {"interfaces": {"a": left}, "size": 0.01, "unit": "mm", **options}
        with pytest.raises(error, match=message):
            Domain.from_outline(comm, shared_tmp_path / name, **settings)


def test_a_ring_of_pieces() -> None:
    """Lines, arcs and splines stay what they are, so cells of order 2 fit them."""
    half = [(0.0, -0.02), (0.02, 0.0), (0.0, 0.02)]
    wave = np.column_stack([0.05 * np.linspace(0.0, -1.0, 9), np.full(9, 0.02)])
    wave[1:-1, 1] += 0.002 * np.sin(np.linspace(0.0, 2.0 * np.pi, 9))[1:-1]
    ring = [half, wave, [(-0.05, 0.02), (-0.05, -0.02)], [(-0.05, -0.02), (0.0, -0.02)]]
    bore = [[(0.01, 0.0), (0.0, 0.01), (-0.01, 0.0)], [(-0.01, 0.0), (0.0, -0.01), (0.01, 0.0)]]
    interfaces = {"bore": lambda x: np.hypot(x[0], x[1]) < 0.0101}
    body = Domain.from_outline(
        MPI.COMM_SELF, [ring, bore], interfaces=interfaces, size=0.005, order=2
    )
    area = 0.05 * 0.04 + 0.5 * np.pi * 0.02**2 - np.pi * 0.01**2  # the wave adds nothing
    assert body.area == pytest.approx(area, rel=1e-4)
    np.testing.assert_allclose(body.interfaces["bore"].center, 0.0, atol=1e-12)
    with pytest.raises(ValueError, match="a piece of a ring needs at least two points"):
        Domain.from_outline(MPI.COMM_SELF, [[half, half[:1]]], interfaces=interfaces, size=0.01)
