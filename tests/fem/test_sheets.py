# SPDX-License-Identifier: MIT
"""Drawings of other people: centre lines, several parts, gaps, small loops, damaged numbers."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

from mpi4py import MPI

import ezdxf
import numpy as np
import pytest
import shapely
from ezdxf.math import Matrix44, Vec2

from dolfinx_ffr import Domain
from dolfinx_ffr.fem import Bore, Box, closed_outline, gmsh_model, read_outline
from dolfinx_ffr.limits import INSIST

ENDS = {"pin": Bore((0.02, 0.01)), "wall": Box((-1e-4, -1.0), (1e-4, 1.0))}


def area(path: Any, unit: str | None = None, **sheet: Any) -> float:
    """The area of the faces of a drawing [m^2]."""
    layers = sheet.pop("layers", None)
    drawing = closed_outline("outline", read_outline(path, unit, layers), **sheet)
    return float(sum(drawing.moments(face.loops)[0] for face in drawing.faces))


def plate(space: Any, layer: str = "0", x: float = 0.0, gap: float = 0.0) -> None:
    """A rectangle of 100 x 20 with a bore of radius 4, whose last side may end too early."""
    corners = [(x, 0), (x + 100, 0), (x + 100, 20), (x, 20), (x, gap)]
    for a, b in pairwise(corners):
        space.add_line(a, b, dxfattribs={"layer": layer})
    space.add_circle((20 + x, 10), 4, dxfattribs={"layer": layer})


PLATE = 100e-3 * 20e-3 - np.pi * 4e-3**2


def drawn(path: Path, draw: Callable[[Any, Any], object], version: str = "R2010") -> Path:
    """A DXF file in millimetres with what a function adds to a drawing and its model space."""
    drawing = ezdxf.new(version)
    drawing.header["$INSUNITS"] = 4
    drawing.linetypes.add("STRICHPUNKT", [20.0, 12.0, -3.0, 2.0, -3.0])
    draw(drawing, drawing.modelspace())
    drawing.saveas(path)
    return path


def test_centre_lines_and_hidden_edges_are_no_outline(tmp_path: Path) -> None:
    """By the pattern of the line type, also of layers and blocks, or by its name."""

    def draw(drawing: Any, space: Any) -> None:
        plate(space)
        drawing.layers.add("axes", linetype="STRICHPUNKT")
        block = drawing.blocks.new("cross")
        block.add_line((0, 0), (40, 20), dxfattribs={"linetype": "BYBLOCK"})
        block.add_line((0, 20), (40, 0), dxfattribs={"layer": "axes"})
        space.add_blockref("cross", (0, 0), dxfattribs={"linetype": "STRICHPUNKT"})
        space.add_line((-5, 10), (105, 10), dxfattribs={"linetype": "CENTER"})
        space.add_lwpolyline([(0, 0), (5, 5), (0, 20)], dxfattribs={"linetype": "HIDDEN2"})
        note = space.add_multileader_mtext("Standard")
        note.set_content("a note")
        note.build(insert=Vec2(3, 3))

    path = drawn(tmp_path / "plate.dxf", draw)
    assert area(path) == pytest.approx(PLATE, rel=1e-9)

    def side_is_hidden(drawing: Any, space: Any) -> None:
        corners = [(0, 0), (100, 0), (100, 20), (0, 20)]
        space.add_lwpolyline(corners)
        space.add_line(corners[-1], corners[0], dxfattribs={"linetype": "HIDDEN"})

    path = drawn(tmp_path / "open.dxf", side_is_hidden)
    with pytest.raises(ValueError, match=r"outline is open.*line types HIDDEN, which have gaps"):
        area(path)


def test_layers_of_the_outline_are_named(tmp_path: Path) -> None:
    """What is on others may be anything; curves that meet are told with their layers."""

    def draw(drawing: Any, space: Any) -> None:
        plate(space, "part")
        space.add_line((-5, 10), (105, 10), dxfattribs={"layer": "axes"})
        space.add_line((0, 0), (0, -9), dxfattribs={"layer": "axes"})
        space.add_3dface([(0, 0, 0), (1, 0, 0), (1, 1, 0)], dxfattribs={"layer": "model"})

    path = drawn(tmp_path / "plate.dxf", draw)
    with pytest.raises(ValueError, match=r"'model' holds a 3DFACE.*layers=\[...\]"):
        area(path)
    with pytest.raises(ValueError, match=r"open: .*\(on 'axes'\).*layers=\[...\]"):
        area(path, layers=["part", "axes"])
    assert area(path, layers=["PART"]) == pytest.approx(PLATE, rel=1e-9)
    with pytest.raises(ValueError, match="no curves that are drawn on 'prat'"):
        area(path, layers=["prat"])


@pytest.mark.mpi
def test_one_of_several_parts_on_a_sheet(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """Within a frame, beside a broken part, with interfaces by place, on every rank."""

    def draw(drawing: Any, space: Any) -> None:
        space.add_lwpolyline([(-50, -50), (300, -50), (300, 90), (-50, 90)], close=True)
        space.add_line((-50, -30), (300, -30))
        plate(space)
        plate(space, x=150.0, gap=5.0)
        space.add_lwpolyline([(0, 40), (20, 60), (20, 40), (0, 60)], close=True)

    path = shared_tmp_path / "sheet.dxf"
    if comm.rank == 0:
        drawn(path, draw)
    comm.Barrier()
    body = Domain.from_outline(
        comm, path, interfaces=ENDS, size=0.004, inside=(0.05, 0.01), order=2
    )
    assert body.area == pytest.approx(PLATE, rel=1e-4)
    np.testing.assert_allclose(body.interfaces["pin"].center, [0.02, 0.01], atol=1e-9)
    np.testing.assert_allclose(body.interfaces["wall"].center, [0.0, 0.01], atol=1e-9)
    for inside, interfaces, message in (
        ((0.5, 0.5), ENDS, r"no closed curve lies around inside = \(500, 500\) mm"),
        ((0.2, 0.01), ENDS, "closed curves of the outline cross or touch"),  # in the frame
        (
            (0.05, 0.01),
            {"pin": Bore((0.05, 0.01))},
            r"\(50, 10\) mm lies in no bore; .* \(20, 10\) mm",
        ),
        (
            (0.05, 0.01),
            {"a": ENDS["pin"], "b": Bore((0.021, 0.01))},
            "'a' and 'b' overlap: they have a curve in common",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            Domain.from_outline(comm, path, interfaces=interfaces, size=0.004, inside=inside)


def test_curves_that_meet_the_chosen_part_are_refused(tmp_path: Path) -> None:
    for other, message in (
        (lambda space: space.add_line((40, 5), (60, 5)), "the outline is open: 2 curves"),
        (lambda space: space.add_circle((100, 10), 4), "cross or touch"),
    ):
        path = drawn(tmp_path / "plate.dxf", lambda _, space, o=other: (plate(space), o(space)))
        with pytest.raises(ValueError, match=message):
            area(path, inside=np.array([0.05, 0.01]))


def test_two_parts_without_a_choice(comm: MPI.Comm, tmp_path: Path) -> None:
    path = drawn(tmp_path / "two.dxf", lambda _, space: (plate(space), plate(space, x=150.0)))
    with pytest.raises(ValueError, match=r"pieces .* choose one part .* inside=\(x, y\)"):
        Domain.from_outline(comm, path, interfaces=ENDS, size=0.01)


def test_gaps_are_closed_as_far_as_is_asked(tmp_path: Path) -> None:
    """Small ones without being asked; a circle that is almost one is one."""

    def rounded(_: Any, space: Any) -> None:
        plate(space, gap=0.005)

    assert area(drawn(tmp_path / "a.dxf", rounded)) == pytest.approx(PLATE, rel=1e-4)
    wide = drawn(tmp_path / "b.dxf", lambda _, space: plate(space, gap=0.3))
    with pytest.raises(ValueError, match=r"0\.3 mm from the nearest other end.*a larger gap="):
        area(wide)
    # both ends meet halfway
    assert area(wide, gap=4e-4) == pytest.approx(PLATE - 0.5 * 0.1 * 0.15e-3, rel=1e-9)

    def almost_round(_: Any, space: Any) -> None:
        space.add_arc((0, 0), 10, 0.02, 360.0)
        space.add_lwpolyline([(-20, -20), (20, -20), (20, 20), (-20, 20)], close=True)

    disc = drawn(tmp_path / "c.dxf", almost_round)
    assert area(disc) == pytest.approx(1600e-6 - np.pi * 1e-4, rel=1e-6)
    # the ends of a piece of an arc are not joined to each other
    bit = drawn(
        tmp_path / "d.dxf", lambda _, space: (plate(space), space.add_arc((50, 10), 5, 0, 1))
    )
    with pytest.raises(ValueError, match="the outline is open: 2 curves"):
        area(bit, gap=1e-3)


CORNERS = [(0.0, 0.0), (9.0, 0.0), (9.0, 4.0), (0.0, 4.0)]


@pytest.mark.parametrize(
    ("corners", "times"),
    [
        (CORNERS, 1),
        ([*CORNERS, (0.0, 0.0)], 1),  # a closing line of no length
        ([*CORNERS, (0.0, 1e-7)], 1),
        ([*CORNERS[:2], *CORNERS[1:]], 1),
        (CORNERS, 2),
    ],
)
@pytest.mark.parametrize("mirrored", [False, True])
def test_polylines_that_end_where_they_begin(
    tmp_path: Path, corners: list[tuple[float, float]], times: int, mirrored: bool
) -> None:
    """Corners and whole outlines that are drawn twice count once."""
    drawn_corners = [(-x if mirrored else x, y) for x, y in corners]

    def draw(_: Any, space: Any) -> None:
        for _ in range(times):
            space.add_lwpolyline(drawn_corners, close=True)

    path = drawn(tmp_path / "plate.dxf", draw)
    assert area(path) == pytest.approx(36e-6, rel=1e-6)


def test_curls_at_corners_are_left_out_with_a_warning() -> None:
    """As programs for lasers draw them; a loop that is longer than a side is none."""

    def with_curl(radius: float) -> list[list[tuple[float, float]]]:
        away = [(9.0, 0.0), (9.0 + radius, 0.0), (9.0, -radius), (9.0, 0.0)]
        sides = [[*pair] for pair in pairwise([*CORNERS, CORNERS[0]])]
        return [sides[0], away, *sides[1:]]

    with pytest.warns(UserWarning, match=r"1 small loops .* longest of .* mm at \(9, -?0\) mm"):
        assert area([with_curl(0.5)], unit="mm") == pytest.approx(36e-6, rel=1e-9)
    with pytest.raises(ValueError, match="4 curves meet at"):
        area([with_curl(5.0)], unit="mm")


def in_paper_space(drawing: Any, space: Any) -> None:
    plate(drawing.layout("Layout1"))


DAMAGED = [
    (lambda _, space: space.add_circle((0, 0), float("nan")), "has the coordinate nan mm"),
    (lambda _, space: space.add_line((0, 0), (1e300, 1)), r"coordinate 2\.5e\+299 mm"),
    (lambda _, space: space.add_circle((0, 0), 1e300), r"a curve on '0' has the coordinate"),
    (lambda _, space: space.add_circle((0, 0), 0.0), "no curve that has a length"),
    (
        lambda _, space: space.add_open_spline([(k, k % 7, 0) for k in range(400)], degree=300),
        "a SPLINE on the layer '0' is damaged .*; delete it",
    ),
    (in_paper_space, "its curves are in paper space, on the layout 'Layout1'.*CHSPACE"),
]


@pytest.mark.parametrize(("draw", "message"), DAMAGED)
def test_damaged_numbers_and_paper_space(
    tmp_path: Path, draw: Callable[[Any, Any], object], message: str
) -> None:
    path = drawn(tmp_path / "plate.dxf", draw)
    with pytest.raises(ValueError, match=message):
        area(path)


def test_vertices_of_polylines_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(INSIST, "1000")
    turn = np.linspace(0.0, 2.0 * np.pi, 1_001)
    ring = 50.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    path = drawn(tmp_path / "ring.dxf", lambda _, space: space.add_lwpolyline(ring))
    with pytest.raises(ValueError, match="some 1,001 curves are more than the 1,000"):
        area(path)


def test_a_unit_slip_is_refused_before_the_mesh(comm: MPI.Comm, tmp_path: Path) -> None:
    """A drawing that says inches and is in millimetres has 645 times the area."""

    def draw(_: Any, space: Any) -> None:
        plate(space)
        for entity in space:
            entity.transform(Matrix44.scale(25.4))

    path = drawn(tmp_path / "plate.dxf", draw)
    message = r"triangles of 0\.004 m .*right unit= of the drawing, which is 2\.54 m x 0\.508 m now"
    with pytest.raises(ValueError, match=message):
        Domain.from_outline(
            comm, path, interfaces={"a": Bore((0.508, 0.254))}, size=0.004, unit=None, gap=0.0
        )


def ring(radius: float) -> shapely.Geometry:
    return shapely.Point(0, 0).buffer(radius)


def test_a_whole_edge_is_no_interface(comm: MPI.Comm, tmp_path: Path) -> None:
    """All curves on one layer, the outer edge alone, a predicate that is always true."""
    path = drawn(tmp_path / "plate.dxf", lambda _, space: plate(space))
    shape = ring(0.02).difference(ring(0.01))
    everywhere = {"all": lambda x: x[0] < 9.0}
    for outline, interfaces in ((path, {"all": "0"}), (shape, everywhere)):
        with pytest.raises(ValueError, match="'all' holds the whole edge of the body"):
            Domain.from_outline(comm, outline, interfaces=interfaces, size=0.01)
    # a wheel between a rim and a hub is a body
    both = {"rim": lambda x: np.hypot(x[0], x[1]) > 0.015, "hub": Bore((0.0, 0.0))}
    Domain.from_outline(comm, shape, interfaces=both, size=0.01)

    def apart(drawing: Any, space: Any) -> None:
        plate(space)
        for entity in space.query("LINE"):
            entity.dxf.layer = "outline"

    path = drawn(tmp_path / "plate.dxf", apart)
    with pytest.raises(ValueError, match="'a' holds the whole edge of the body"):
        Domain.from_outline(comm, path, interfaces={"a": "outline"}, size=0.01)


def test_a_whole_edge_of_a_mesh_is_no_interface(comm: MPI.Comm) -> None:
    with gmsh_model() as gmsh:
        gmsh.model.occ.addRectangle(0.0, 0.0, 0.0, 1.0, 1.0)
        gmsh.model.occ.synchronize()
        for dim, name in ((1, "edge"), (2, "plate")):
            tags = [tag for _, tag in gmsh.model.getEntities(dim)]
            gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, tags), name)
        gmsh.model.mesh.generate(2)
        with pytest.raises(ValueError, match="'edge' holds the whole edge of the body"):
            Domain.from_gmsh_model(comm, gmsh.model, interfaces=["edge"])


def test_an_interface_that_is_called_outline_is_no_more_than_that(
    comm: MPI.Comm, tmp_path: Path
) -> None:
    """Names of layers and interfaces are not those of groups within."""

    def draw(_: Any, space: Any) -> None:
        plate(space)
        space.add_line((0, 0), (0, 20), dxfattribs={"layer": "outline"})

    path = drawn(tmp_path / "plate.dxf", draw)
    body = Domain.from_outline(comm, path, interfaces={"wall": "outline"}, size=0.01)
    assert body.interfaces["wall"].extent == pytest.approx(0.02, rel=1e-9)


def test_boxes() -> None:
    points = np.array([[0.0, 1.0, 2.0], [0.0, 1.0, 0.0], [0.0, 5.0, 0.0]])
    assert Box((0, 0), (1, 1))(points).tolist() == [True, True, False]
    assert Box((0, 0, 0), (1, 1, 1))(points).tolist() == [True, False, False]
    for corners in (((0, 0), (1, 0)), ((0,), (1,)), ((0, 0), (1, 1, 1))):
        with pytest.raises(ValueError, match=r"box: lower .* are no corners"):
            Box(*corners)
    with pytest.raises(ValueError, match="bore: at must have two coordinates"):
        Bore((0, 0, 0))  # type: ignore[arg-type]
