# SPDX-License-Identifier: MIT
"""Meshes, interfaces, regions, and what is refused."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import mesh
from shared.meshes import rod_file

from dolfinx_ffr import Domain
from dolfinx_ffr.fem import _compat, gmsh_model

pytestmark = pytest.mark.mpi


def strip(comm: MPI.Intracomm, nx: int = 8, ny: int = 2) -> mesh.Mesh:
    """A mesh of the rectangle [0, 4] x [0, 1]."""
    corners = [np.zeros(2), np.array([4.0, 1.0])]
    return mesh.create_rectangle(comm, corners, [nx, ny], mesh.CellType.quadrilateral)


def test_one_layer_between_the_solid_ends_is_designed(comm: MPI.Intracomm) -> None:
    """Though all its nodes are nodes of the ends."""
    box = Domain.box(comm, 0.1, 0.04, 0.04, elements=(5, 2, 2))
    rectangle = Domain.rectangle(comm, 0.1, 0.04, elements=(5, 2))
    for domain, cells in ((box, 4), (rectangle, 2)):
        assert domain.comm.allreduce(int(np.count_nonzero(domain.design_cells))) == cells


@pytest.mark.parametrize(("order", "ends"), [(1, {}), (2, {"solid_length": 0.05})])
@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_geometry_of_a_rod(comm: MPI.Intracomm, cell: str, order: int, ends: dict) -> None:  # type: ignore[type-arg]
    """Area, centroid, centers and averaging points are exact on a rectangle."""
    domain = Domain.rectangle(comm, 0.4, 0.04, elements=(10, 2), cell=cell, order=order, **ends)
    assert domain.area == pytest.approx(0.016, rel=1e-13)
    moment = [domain.sum(domain.cell_volumes * domain.centroids[:, i]) for i in range(2)]
    np.testing.assert_allclose(np.array(moment) / domain.area, [0.2, 0.0], atol=1e-14)
    np.testing.assert_allclose(domain.interfaces["left"].center, [0.0, 0.0], atol=1e-14)
    np.testing.assert_allclose(domain.interfaces["right"].center, [0.4, 0.0], atol=1e-14)
    np.testing.assert_allclose(domain.bounding_box, [[0, -0.02], [0.4, 0.02]], atol=1e-14)
    points, weights = domain.quadrature_points(3)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-13)
    # a rule of degree 5 integrates x^2 y^2 exactly
    mean = np.einsum("cq,cq->c", weights, points[:, :, 0] ** 2 * points[:, :, 1] ** 2)
    exact = 0.4**3 / 3 * 2 * 0.02**3 / 3
    assert domain.sum(domain.cell_volumes * mean) == pytest.approx(exact, rel=1e-12)
    solid = domain.sum(domain.cell_volumes * ~domain.design_cells)
    assert solid == pytest.approx(2.0 * ends.get("solid_length", 0.08) * 0.04, rel=1e-13)
    domain_with_centers = Domain(domain.mesh, LEFT, centers={"left": (-1.0, 0.5)}, order=order)
    np.testing.assert_array_equal(domain_with_centers.interfaces["left"].center, [-1.0, 0.5])


LEFT = {"left": lambda x: x[0] < 1e-9}
ENDS = {"a": lambda x: x[0] < 1e-9, "b": lambda x: x[0] > 4.0 - 1e-9}
Corners = list[tuple[float, ...]]


def block(low: tuple[float, ...], high: tuple[float, ...]) -> Corners:
    """Corners of a rectangle or a box."""
    return [c[::-1] for c in itertools.product(*zip(low[::-1], high[::-1], strict=True))]


Made = Callable[[MPI.Intracomm], Domain]


def joined(*cells: Corners, alone: bool = False) -> Made:
    """Quadrilaterals or hexahedra from rank 0, held at the left; equal corners are one node."""

    def make(comm: MPI.Intracomm) -> Domain:
        points, numbers = np.unique(np.concatenate(cells), axis=0, return_inverse=True)
        nodes = numbers.reshape(len(cells), -1).astype(np.int64)
        if comm.rank > 0 and not alone:
            points, nodes = points[:0], nodes[:0]
        kind = "quadrilateral" if nodes.shape[1] == 4 else "hexahedron"
        comm = MPI.COMM_SELF if alone else comm
        return Domain(_compat.create_mesh(comm, nodes, points, kind, 1), LEFT)

    return make


def prisms(comm: MPI.Intracomm) -> Domain:
    cells = mesh.create_unit_cube(comm, 2, 1, 1, cell_type=mesh.CellType.prism)
    return Domain(cells, LEFT)


def held(solid: Any = None, void: Any = None, at: Any = ENDS) -> Made:
    """The strip with regions and interfaces."""
    return lambda comm: Domain(strip(comm), at, solid, void=void)


def cube(**options: Any) -> Made:
    return lambda comm: Domain.box(comm, 1.0, 1.0, 1.0, **options)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (held(at={}), "no interfaces given"),
        (held(at={"pin": lambda x: x[0] > 99.0}), r"interface 'pin' has no facets.*0 to 4 m"),
        (held(at={**ENDS, "c": lambda x: x[1] < 1e-9}), "interfaces 'a' and 'c' overlap"),
        (held(lambda x: x[0] > -1.0), "nothing is left to design"),
        (held(lambda x: x[0] < 2.01, lambda x: x[0] > 1.99), "nothing is left to design"),
        (
            held(lambda x: x[0] < 1.01, lambda x: x[0] < 2.01),
            r"4 cells are in the solid region and in the void region",
        ),
        (held(None, lambda x: x[0] > 3.49), "interface 'b' lies on void cells only"),
        (
            held(
                lambda x: (x[0] > 1.49) & (x[0] < 2.51),
                lambda x: (np.abs(x[0] - 1.25) < 0.26) | (np.abs(x[0] - 2.75) < 0.26),
            ),
            "1 of 3 separate pieces of the body touch no interface .* void region",
        ),
        (held(None, lambda x: x[0].astype(int)), "void: the predicate must give True or False"),
        (
            joined(block((0, 0), (1, 1)), block((3, 0), (4, 1))),
            "1 of 2 separate pieces of the body touch no interface",
        ),
        (
            joined([(0, 0), (1, 0), (0, 1), (0.2, 0.2)], [(1, 0), (2, 0), (0.2, 0.2), (2, 1)]),
            "1 cells are inverted or without area, the first near",
        ),
        (
            joined(block((0, 0), (2, 2)), block((2, 0), (4, 1)), block((2, 1), (4, 2))),
            r"hanging node at \(2, 1\)",
        ),
        (
            joined(
                block((0, 0, 0), (1, 1, 1)),
                block((1, 0, 0), (2, 1, 0.5)),
                block((1, 0, 0.5), (2, 1, 1)),
                alone=True,
            ),
            r"hanging node at \(1, [01], 0\.5\) m",
        ),
        (prisms, r"of the kind 'prism'; take .* tetrahedron or hexahedron"),
        (cube(elements=(5, 1)), "elements must have three numbers"),
        (
            cube(elements=(6, 1, 1), solid_layers=3),
            "solid_layers = 3 leaves nothing to design among 6",
        ),
        (cube(elements=(6, 1, 1), solid_length=0.5), "solid_length must lie between 0 and 0.5"),
    ],
)
def test_faulty_bodies(comm: MPI.Intracomm, make: Made, message: str) -> None:
    """What no design could mend is refused on every rank, named and located."""
    with pytest.raises(ValueError, match=message):
        make(comm)


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_void_region(comm: MPI.Intracomm, cell: str) -> None:
    """Void cells are not designed and have no density; predicate, mask and numbers agree."""
    domain = Domain.rectangle(
        comm,
        4.0,
        1.0,
        elements=(8, 4),
        cell=cell,
        solid=lambda x: np.abs(x[0] - 2.0) < 0.51,
        void=lambda x: (x[0] > 2.49) & (x[0] < 3.01) & (x[1] > -0.01),
    )
    shares = [
        domain.sum(domain.cell_volumes * part) / domain.area
        for part in (domain.solid_cells, domain.void_cells, domain.design_cells)
    ]
    np.testing.assert_allclose(shares, [6 / 8, 1 / 16, 3 / 16], rtol=1e-13)
    np.testing.assert_array_equal(
        domain.passive_density[~domain.design_cells] == 1.0,
        domain.solid_cells[~domain.design_cells],
    )
    for void in (domain.void_cells, np.flatnonzero(domain.void_cells)):
        again = Domain(domain.mesh, {"left": lambda x: x[0] < 1e-9}, domain.solid_cells, void=void)
        np.testing.assert_array_equal(again.void_cells, domain.void_cells)
        np.testing.assert_array_equal(again.design_cells, domain.design_cells)


@pytest.mark.parametrize("order", [1, 2])
def test_gmsh_file(comm: MPI.Intracomm, shared_tmp_path: Path, order: int) -> None:
    """Physical groups name interfaces and the solid region; messages list those of the file."""
    path = rod_file(comm, shared_tmp_path, order=order)
    domain = Domain.from_gmsh(comm, path, order=order)
    assert domain.area == pytest.approx(0.016, rel=1e-12)
    np.testing.assert_allclose(domain.interfaces["right"].center, [0.4, 0.0], atol=1e-12)
    solid = domain.sum(domain.cell_volumes * ~domain.design_cells)
    assert solid == pytest.approx(0.02 * 0.04, rel=1e-12)
    assert not np.any(domain.void_cells)
    assert np.all(Domain.from_gmsh(comm, path, solid=[], order=order).design_cells)
    refused: list[tuple[dict[str, Any], type[Exception], str]] = [
        # the design surface lies between the solid end and the other one
        ({"solid": [], "void": ["d"]}, ValueError, "interface 'right' lies on void cells only"),
        (
            {"interfaces": ["left", "eye"]},
            ValueError,
            r"no physical curve named 'eye'.*\['left', 'right'\]",
        ),
        ({"solid": ["typo"]}, ValueError, r"no physical surface named 'typo'.*\['d', 'solid'\]"),
        ({"void": ["typo"]}, ValueError, r"no physical surface named 'typo'.* void=\[\.\.\.\]"),
        ({"solid": "solid"}, TypeError, r"solid must be a list of texts, as \['solid'\]"),
    ]
    for options, error, message in refused:
        with pytest.raises(error, match=message):
            Domain.from_gmsh(comm, path, order=order, **options)


def test_gmsh_files_without_names_or_not_there(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    path = rod_file(comm, shared_tmp_path, names=False)
    with pytest.raises(ValueError, match="physical curve"):
        Domain.from_gmsh(comm, path)
    with pytest.raises(FileNotFoundError, match=r"nowhere\.msh does not exist"):
        Domain.from_gmsh(comm, "nowhere.msh")


@pytest.mark.parametrize(
    ("dim", "sheet", "message"),
    [
        (
            3,
            0,
            r"needs physical groups of surfaces \(interfaces\).*none and the volumes \['part'\]",
        ),
        (2, 0, r"leaves the x-y plane: its z spans 0\.1 m"),
        (3, 1, r"surface 7 of the physical surface 'left' is no boundary of the physical volumes"),
        (
            2,
            1,
            r"mixes Quadrilateral 4 \('part'\) and Triangle 3 \('part'\); mesh all surfaces wit",
        ),
    ],
)
def test_gmsh_models_that_are_refused(
    comm: MPI.Intracomm, shared_tmp_path: Path, dim: int, sheet: int, message: str
) -> None:
    """A volume held by a curve, a surface out of the plane; with a sheet beside either."""
    path = shared_tmp_path / "part.msh"
    with gmsh_model() as gmsh:
        if dim == 3:
            gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        else:
            gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
        if sheet:
            sheet = gmsh.model.occ.addRectangle(2, 0, 0, 1, 1)
        elif dim == 2:
            gmsh.model.occ.rotate([(2, 1)], 0, 0, 0, 1, 0, 0, np.arcsin(0.1))
        gmsh.model.occ.synchronize()
        parts, held = ([1], [sheet]) if sheet and dim == 3 else ([1, sheet][: 1 + sheet], [1])
        for d, group, name in ((dim, parts, "part"), (2 if held != [1] else 1, held, "left")):
            gmsh.model.setPhysicalName(d, gmsh.model.addPhysicalGroup(d, group), name)
        gmsh.option.setNumber("Mesh.MeshSizeMin", 1.0)
        if sheet and dim == 2:
            gmsh.model.mesh.setRecombine(2, 1)
        gmsh.model.mesh.generate(dim)
        with pytest.raises(ValueError, match=message):
            Domain.from_gmsh_model(comm, gmsh.model, interfaces=["left"])
        if comm.rank == 0:
            gmsh.write(str(path))
    comm.Barrier()
    with pytest.raises(ValueError, match=message):
        Domain.from_gmsh(comm, path, interfaces=["left"])


def test_masked_arrays_are_refused(comm: MPI.Intracomm) -> None:
    """NumPy would take what stands below the mask."""
    domain = Domain.rectangle(comm, 0.4, 0.04, elements=(6, 2))
    masked = np.ma.masked_less(np.ones(domain.n_cells), 2.0)
    ends = {"left": lambda x: x[0] < 1e-9}
    for call in (
        lambda: domain.check_density(masked),
        lambda: Domain(domain.mesh, ends, np.ma.masked_less(np.arange(4), 2)),
        lambda: Domain(domain.mesh, {"left": lambda x: np.ma.masked_less(x[0], 1e-9) > 1.0}),
    ):
        with pytest.raises(ValueError, match="masked entries, which are no values; fill them"):
            call()


def test_a_center_that_fails_leaves_the_mesh_where_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    domain = Domain.rectangle(MPI.COMM_SELF, 0.4, 0.04, elements=(20, 4))
    x = domain.mesh.geometry.x
    before, rates = x.copy(), np.ones((len(x), 2, 1))

    def failing(*_: object) -> None:
        raise RuntimeError("no circle")

    monkeypatch.setattr("dolfinx_ffr.fem.interface._surface", failing)
    with pytest.raises(RuntimeError, match="no circle"):
        domain.interfaces["left"].center_rates(domain.mesh, rates)
    np.testing.assert_array_equal(x, before)
