# SPDX-License-Identifier: MIT
"""Parts written for CAD and machines, read back by other programs."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import ezdxf
import ezdxf.path
import numpy as np
import pytest
import pyvista
import shapely
import svgelements
from meshes.connecting_rod import ConnectingRod
from scipy.spatial import cKDTree

import dolfinx_ffr as ffr
from dolfinx_ffr.fem import gmsh_model

STEEL = ffr.PlaneStress(young=210e9, poisson=0.3, density=7850.0, thickness=0.012)
#: Numbers of a file agree with those of the part to this length [m]
EXACT = 1e-9


@pytest.fixture(scope="module")
def part() -> ffr.Part:
    """A connecting rod of lines and arcs with a smooth hole and one with corners."""
    body = ConnectingRod().domain(MPI.COMM_SELF, 0.01, order=2)

    def field(p: np.ndarray) -> np.ndarray:
        hole = np.hypot((p[:, 0] - 0.15) / 1.7, p[:, 1]) - 0.0123
        box = np.maximum(np.abs(p[:, 0] - 0.27) - 0.02, np.abs(p[:, 1]) - 0.0111)
        return np.minimum(hole, box)

    return ffr.Part(body, field, material=STEEL)


def distance(part: ffr.Part, points: np.ndarray) -> float:
    """The largest distance of points from the boundary of a part [m]."""
    fine = np.vstack(
        [c.at(np.linspace(0, 1, 20001)) for loops in part.outlines for loop in loops for c in loop]
    )
    gaps, nearest = cKDTree(fine).query(points)
    # the neighbours on both sides make up the polygon
    sides = [fine[np.clip(nearest + k, 0, len(fine) - 1)] for k in (-1, 0, 1)]
    lines = shapely.linestrings(np.stack(sides, axis=1))
    return float(np.max(np.minimum(gaps, shapely.distance(lines, shapely.points(points)))))


def test_svg(part: ffr.Part, tmp_path: Path) -> None:
    """Paths in millimetres, y downwards, with the interfaces by name."""
    (path,) = part.write(tmp_path / "rod.svg")
    # so that a unit is a millimetre: that is how many inches the reader takes for one
    svg = svgelements.SVG.parse(path, ppi=1.0 / 0.0393701)
    paths = {each.id: each for each in svg.select(lambda e: isinstance(e, svgelements.Path))}
    assert set(paths) == {"part", "left", "right"}
    offset, size = np.array([float(v) for v in svg.values["viewBox"].split()]).reshape(2, 2)
    t = np.linspace(0.0, 1.0, 9)
    points = np.array(
        [
            [p.x, p.y]
            for s in paths["part"]
            if not isinstance(s, svgelements.Move)
            for p in map(s.point, t)
        ]
    )
    assert np.all((points > 0.0) & (points < size)), "outside of the frame of the drawing"
    points = 1e-3 * (points + offset) * [1.0, -1.0]
    assert distance(part, points) < EXACT
    loops = list(paths["part"].as_subpaths())
    assert len(loops) == 5
    bores = 2e3 * np.array(ConnectingRod().bores)
    for name, diameter in zip(("left", "right"), bores, strict=True):
        x0, y0, x1, y1 = paths[name].bbox()
        assert (x1 - x0, y1 - y0) == pytest.approx((diameter, diameter), rel=1e-6)


@pytest.mark.parametrize("unit", ["mm", "m"])
def test_dxf(part: ffr.Part, tmp_path: Path, unit: str) -> None:
    """Lines, arcs and splines on layers, in the unit that the header names, without faults."""
    (path,) = part.write(tmp_path / "rod.dxf", unit=unit)
    drawing = ezdxf.readfile(path)
    audit = drawing.audit()
    assert not audit.errors and not audit.fixes
    assert drawing.header["$INSUNITS"] == {"mm": 4, "m": 6}[unit]
    entities = list(drawing.modelspace())
    assert {e.dxftype() for e in entities} >= {"LINE", "ARC", "SPLINE"}
    assert {e.dxf.layer for e in entities} == {"part", "left", "right"}
    scale = {"mm": 1e-3, "m": 1.0}[unit]
    points = [
        [p.x, p.y]
        for e in entities
        if e.dxftype() == "SPLINE"
        for p in e.construction_tool().approximate(200)
    ]
    for entity in entities:
        if entity.dxftype() == "LINE":
            points += [[p.x, p.y] for p in (entity.dxf.start, entity.dxf.end)]
        elif entity.dxftype() in ("ARC", "CIRCLE"):
            path_of = ezdxf.path.make_path(entity)
            points += [[path_of.start.x, path_of.start.y], [path_of.end.x, path_of.end.y]]
    assert distance(part, scale * np.array(points)) < EXACT


def test_step(part: ffr.Part, tmp_path: Path) -> None:
    """One solid, whose volume is area times thickness and whose ends are those of the part."""
    (path,) = part.write(tmp_path / "rod.step")
    with gmsh_model() as gmsh:
        gmsh.model.occ.importShapes(str(path))
        gmsh.model.occ.synchronize()
        ((_, solid),) = gmsh.model.getEntities(3)
        volume = gmsh.model.occ.getMass(3, solid)
        points = np.array([gmsh.model.getValue(0, tag, []) for _, tag in gmsh.model.getEntities(0)])
        inside = []
        for _, tag in gmsh.model.getEntities(1):
            (first,), (last,) = gmsh.model.getParametrizationBounds(1, tag)
            inside.append(gmsh.model.getValue(1, tag, np.linspace(first, last, 30)).reshape(-1, 3))
    assert 1e-9 * volume == pytest.approx(part.area * 0.012, rel=1e-9)
    assert sorted(set(np.round(points[:, 2], 9))) == [0.0, 12.0]
    assert distance(part, 1e-3 * np.vstack([points, *inside])[:, :2]) < EXACT


def test_masses_in_cad_of_long_splines(tmp_path: Path) -> None:
    """OpenCASCADE would take too few points along them, and find less than there is."""
    body = ffr.Domain.rectangle(MPI.COMM_SELF, 0.1, 0.04, elements=(25, 10))

    def wavy(x: np.ndarray) -> np.ndarray:
        return 0.016 + 1.5e-3 * np.sin(300 * x[:, 0]) - np.abs(x[:, 1])

    part = ffr.Part(body, wavy, 0.002, material=STEEL)
    (path,) = part.write(tmp_path / "rod.step")
    with gmsh_model() as gmsh:
        gmsh.model.occ.importShapes(str(path))
        gmsh.model.occ.synchronize()
        volume = gmsh.model.occ.getMass(3, gmsh.model.getEntities(3)[0][1])
    assert 1e-9 * volume == pytest.approx(part.area * 0.012, rel=1e-9)


def test_stl(part: ffr.Part, tmp_path: Path) -> None:
    """A closed surface around the polygon of the part."""
    (path,) = part.write(tmp_path / "rod.stl")
    surface = pyvista.read(path).clean()
    assert surface.n_open_edges == 0
    # its numbers have seven digits
    assert 1e-9 * surface.volume == pytest.approx(part.polygon.area * 0.012, rel=1e-6)
    assert surface.volume * 1e-9 == pytest.approx(part.area * 0.012, rel=1e-4)


@pytest.mark.mpi
def test_all_files_into_a_folder(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    body = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(20, 4))
    part = ffr.Part(body, lambda p: np.ones(len(p)), material=STEEL)
    files = part.write(shared_tmp_path / "out")
    assert [file.name for file in files] == ["part.svg", "part.dxf", "part.step", "part.stl"]
    (shared_tmp_path / "v1.2").mkdir(exist_ok=True)
    again = part.write(shared_tmp_path / "v1.2")
    assert again == [shared_tmp_path / "v1.2" / file.name for file in files]
    comm.Barrier()
    assert all(file.stat().st_size > 0 for file in files)


def test_what_cannot_be_written(comm: MPI.Comm, tmp_path: Path) -> None:
    part = ffr.Part(ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(20, 4)), lambda p: p[:, 0] + 1)
    with pytest.raises(ValueError, match=r"ends in '\.obj'; parts are written as \.svg"):
        part.write(tmp_path / "part.obj")
    with pytest.raises(ValueError, match="part: unit must be 'mm' or 'm'"):
        part.write(tmp_path / "part.svg", unit="inch")
    with pytest.raises(ValueError, match="its thickness needs a material"):
        part.write(tmp_path / "part.step")


def test_round_trip(part: ffr.Part, tmp_path: Path) -> None:
    """A part that was written is a body to design again, with its interfaces by name."""
    (path,) = part.write(tmp_path / "rod.dxf")
    interfaces = {"left": "left", "right": "right"}
    body = ffr.Domain.from_outline(MPI.COMM_SELF, path, interfaces=interfaces, size=0.004, order=2)
    assert body.area == pytest.approx(part.area, rel=1e-6)
    for name, interface in body.interfaces.items():
        center = part.body.interfaces[name].center
        np.testing.assert_allclose(interface.center, center, atol=EXACT)
