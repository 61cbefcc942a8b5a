# SPDX-License-Identifier: MIT
"""Meshes, interfaces, regions, and what is refused."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import mesh
from shared.meshes import write_rod

from dolfinx_ffr import Domain

pytestmark = pytest.mark.mpi


def strip(comm: MPI.Intracomm, nx: int = 8, ny: int = 2) -> mesh.Mesh:
    """A mesh of the rectangle [0, 4] x [0, 1]."""
    corners = [np.zeros(2), np.array([4.0, 1.0])]
    return mesh.create_rectangle(comm, corners, [nx, ny], mesh.CellType.quadrilateral)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_geometry_of_a_rod(comm: MPI.Intracomm, cell: str, order: int) -> None:
    """Area, centroid, centers and averaging points are exact on a rectangle."""
    domain = Domain.rectangle(comm, 0.4, 0.04, elements=(10, 2), cell=cell, order=order)
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
    assert solid == pytest.approx(4 / 10 * domain.area, rel=1e-13)


def test_interfaces_by_facets_equal_those_by_predicate(comm: MPI.Intracomm) -> None:
    """An array of facets and a predicate name the same interface."""
    strip_mesh = strip(comm)
    left = mesh.locate_entities_boundary(strip_mesh, 1, lambda x: np.isclose(x[0], 0.0))
    by_facets = Domain(strip_mesh, {"a": left})
    by_predicate = Domain(strip_mesh, {"a": lambda x: np.isclose(x[0], 0.0)})
    np.testing.assert_array_equal(by_facets.interfaces["a"].dofs, by_predicate.interfaces["a"].dofs)
    np.testing.assert_allclose(by_facets.interfaces["a"].center, [0.0, 0.5], atol=1e-14)


def test_given_center(comm: MPI.Intracomm) -> None:
    """The reference point of an interface may be given."""
    domain = Domain(strip(comm), {"a": lambda x: x[0] < 1e-9}, centers={"a": (-1.0, 0.5)})
    np.testing.assert_array_equal(domain.interfaces["a"].center, [-1.0, 0.5])


def test_no_interface(comm: MPI.Intracomm) -> None:
    """A body without any interface is refused."""
    with pytest.raises(ValueError, match="no interfaces given"):
        Domain(strip(comm), {})


def test_empty_interface(comm: MPI.Intracomm) -> None:
    """An interface without facets is named, with the extent of the body."""
    with pytest.raises(ValueError, match=r"interface 'pin' has no facets.*0 to 4 m"):
        Domain(strip(comm), {"pin": lambda x: x[0] > 99.0})


def test_overlapping_interfaces(comm: MPI.Intracomm) -> None:
    """Interfaces that share a corner are named."""
    with pytest.raises(ValueError, match="interfaces 'left' and 'bottom' overlap"):
        Domain(strip(comm), {"left": lambda x: x[0] < 1e-9, "bottom": lambda x: x[1] < 1e-9})


def test_nothing_to_design(comm: MPI.Intracomm) -> None:
    """A body that is solid everywhere is refused."""
    with pytest.raises(ValueError, match="nothing is left to design"):
        Domain(strip(comm), {"left": lambda x: x[0] < 1e-9}, lambda x: x[0] > -1.0)


def unstructured(
    comm: MPI.Intracomm, cells: list[list[int]], points: list[list[float]]
) -> mesh.Mesh:
    """A mesh of quadrilaterals from rank 0."""
    from dolfinx_ffr.fem import _compat

    nodes = np.array(cells, dtype=np.int64) if comm.rank == 0 else np.zeros((0, 4), np.int64)
    x = np.array(points, dtype=np.float64) if comm.rank == 0 else np.zeros((0, 2))
    return _compat.create_mesh(comm, nodes, x, "quadrilateral", 1)


def test_floating_piece(comm: MPI.Intracomm) -> None:
    """A piece of the mesh that touches no interface is found."""
    points = [[0, 0], [1, 0], [0, 1], [1, 1], [3, 0], [4, 0], [3, 1], [4, 1]]
    cells = [[0, 1, 2, 3], [4, 5, 6, 7]]
    with pytest.raises(ValueError, match="1 of 2 separate pieces of the body touch no interface"):
        Domain(unstructured(comm, cells, points), {"left": lambda x: x[0] < 1e-9})


def test_inverted_cell(comm: MPI.Intracomm) -> None:
    """A cell that folds over is found and located."""
    points = [[0, 0], [1, 0], [0, 1], [0.2, 0.2], [2, 0], [2, 1]]
    cells = [[0, 1, 2, 3], [1, 4, 3, 5]]
    with pytest.raises(ValueError, match=r"1 cells are inverted or without area, the first near"):
        Domain(unstructured(comm, cells, points), {"left": lambda x: x[0] < 1e-9})


def test_hanging_node(comm: MPI.Intracomm) -> None:
    """A node in the middle of a neighbour's edge is found and located."""
    points = [[0, 0], [2, 0], [0, 2], [2, 2], [4, 0], [2, 1], [4, 1], [4, 2]]
    cells = [[0, 1, 2, 3], [1, 4, 5, 6], [5, 6, 3, 7]]
    with pytest.raises(ValueError, match=r"hanging node at \(2, 1\)"):
        Domain(unstructured(comm, cells, points), {"left": lambda x: x[0] < 1e-9})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"length": -1.0}, "length must be positive, but it is -1.0 m"),
        ({"elements": (0, 2)}, "elements must be a positive whole number, but it is 0"),
        ({"cell": "hexagon"}, "cell must be .* but it is 'hexagon'"),
        ({"solid_columns": 5}, "solid_columns = 5"),
        ({"order": 0}, "order must be a positive whole number"),
    ],
)
def test_bad_rod(comm: MPI.Intracomm, change: dict[str, object], message: str) -> None:
    """Numbers out of range are named."""
    arguments = {"length": 1.0, "height": 0.1, "elements": (10, 2), **change}
    with pytest.raises(ValueError, match=message):
        Domain.rectangle(comm, **arguments)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda x: x[:-1] if len(x) else x, "has shape"),
        (lambda x: np.where(np.arange(len(x)) == 0, np.nan, x), "are NaN or infinite"),
        (lambda x: x + 0.5, "leave \\[0, 1\\]"),
        (lambda x: x - 1.5, "leave \\[0, 1\\]"),
    ],
)
def test_bad_density(comm: MPI.Intracomm, spoil: object, message: str) -> None:
    """Densities of the wrong size, NaN, or out of bounds raise on every rank."""
    domain = Domain.rectangle(comm, 1.0, 0.1, elements=(10, 2))
    with pytest.raises(ValueError, match=message):
        domain.check_density(spoil(np.ones(domain.n_cells)))  # type: ignore[operator]


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


@pytest.mark.parametrize(
    ("solid", "void", "message"),
    [
        (
            lambda x: x[0] < 1.01,
            lambda x: x[0] < 2.01,
            r"4 cells are in the solid region and in the void one",
        ),
        (lambda x: x[0] < 2.01, lambda x: x[0] > 1.99, "nothing is left to design"),
        (None, lambda x: x[0] > 3.49, "interface 'b' lies on void cells only"),
        (
            lambda x: (x[0] > 1.49) & (x[0] < 2.51),
            lambda x: (np.abs(x[0] - 1.25) < 0.26) | (np.abs(x[0] - 2.75) < 0.26),
            "1 of 3 separate pieces of the body touch no interface .* void region",
        ),
        (None, lambda x: x[0].astype(int), "domain: void: the predicate must give True or False"),
    ],
    ids=["overlap", "nothing", "interface", "floating", "predicate"],
)
def test_regions_that_are_refused(
    comm: MPI.Intracomm, solid: object, void: object, message: str
) -> None:
    """What no design could mend is refused on every rank."""
    ends = {"a": lambda x: x[0] < 1e-9, "b": lambda x: x[0] > 4.0 - 1e-9}
    with pytest.raises(ValueError, match=message):
        Domain(strip(comm), ends, solid, void=void)  # type: ignore[arg-type]


@pytest.mark.parametrize("order", [1, 2])
def test_gmsh_file(comm: MPI.Intracomm, shared_tmp_path: Path, order: int) -> None:
    """Physical groups name interfaces and the solid region."""
    path = shared_tmp_path / "rod.msh"
    if comm.rank == 0:
        write_rod(path, order=order)
    comm.Barrier()
    domain = Domain.from_gmsh(comm, path, order=order)
    assert domain.area == pytest.approx(0.016, rel=1e-12)
    np.testing.assert_allclose(domain.interfaces["right"].center, [0.4, 0.0], atol=1e-12)
    solid = domain.sum(domain.cell_volumes * ~domain.design_cells)
    assert solid == pytest.approx(0.02 * 0.04, rel=1e-12)
    assert not np.any(domain.void_cells)
    # the design surface lies between the solid end and the other one
    with pytest.raises(ValueError, match="interface 'right' lies on void cells only"):
        Domain.from_gmsh(comm, path, solid=[], void=["d"], order=order)


def test_gmsh_file_without_the_groups(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """The message lists the groups that the file has."""
    path = shared_tmp_path / "rod.msh"
    if comm.rank == 0:
        write_rod(path)
    comm.Barrier()
    with pytest.raises(ValueError, match=r"no physical curve named 'eye'.*\['left', 'right'\]"):
        Domain.from_gmsh(comm, path, interfaces=["left", "eye"])
    with pytest.raises(ValueError, match=r"no physical surface named 'typo'.*\['d', 'solid'\]"):
        Domain.from_gmsh(comm, path, solid=["typo"])
    with pytest.raises(ValueError, match=r"no physical surface named 'typo'.* void=\[\.\.\.\]"):
        Domain.from_gmsh(comm, path, void=["typo"])
    with pytest.raises(TypeError, match=r"solid must be a list of texts, as \['solid'\]"):
        Domain.from_gmsh(comm, path, solid="solid")
    assert np.all(Domain.from_gmsh(comm, path, solid=[]).design_cells)


@pytest.mark.parametrize(
    ("dim", "message"),
    [
        (3, r"needs physical groups of surfaces \(interfaces\).*none and the volumes \['part'\]"),
        (2, r"leaves the x-y plane: its z spans 0\.1 m"),
    ],
)
def test_gmsh_model_in_space(
    comm: MPI.Intracomm, shared_tmp_path: Path, dim: int, message: str
) -> None:
    """A volume held by a curve, and a surface that is turned out of the plane."""
    path = shared_tmp_path / "part.msh"
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        if dim == 3:
            gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        else:
            gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
            gmsh.model.occ.rotate([(2, 1)], 0, 0, 0, 1, 0, 0, np.arcsin(0.1))
        gmsh.model.occ.synchronize()
        for d, name in ((1, "left"), (dim, "part")):
            gmsh.model.setPhysicalName(d, gmsh.model.addPhysicalGroup(d, [1]), name)
        gmsh.option.setNumber("Mesh.MeshSizeMin", 1.0)
        gmsh.model.mesh.generate(dim)
        with pytest.raises(ValueError, match=message):
            Domain.from_gmsh_model(comm, gmsh.model, interfaces=["left"])
        if comm.rank == 0:
            gmsh.write(str(path))
    finally:
        gmsh.finalize()
    comm.Barrier()
    with pytest.raises(ValueError, match=message):
        Domain.from_gmsh(comm, path, interfaces=["left"])


@pytest.mark.parametrize(
    ("dim", "message"),
    [
        (3, r"surface 7 of the physical surface 'left' is no boundary of the physical volumes"),
        (2, r"mixes Quadrilateral 4 \('part'\) and Triangle 3 \('part'\); mesh all surfaces with"),
    ],
)
def test_gmsh_model_of_several_kinds(comm: MPI.Intracomm, dim: int, message: str) -> None:
    """A sheet beside a volume, and triangles beside quadrilaterals."""
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        if dim == 3:
            gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        else:
            gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
        sheet = gmsh.model.occ.addRectangle(2, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        parts, held = ([1], [sheet]) if dim == 3 else ([1, sheet], [1])
        for d, group, name in ((dim, parts, "part"), (dim - 1, held, "left")):
            gmsh.model.setPhysicalName(d, gmsh.model.addPhysicalGroup(d, group), name)
        gmsh.option.setNumber("Mesh.MeshSizeMin", 1.0)
        if dim == 2:
            gmsh.model.mesh.setRecombine(2, 1)
        gmsh.model.mesh.generate(dim)
        with pytest.raises(ValueError, match=message):
            Domain.from_gmsh_model(comm, gmsh.model, interfaces=["left"])
    finally:
        gmsh.finalize()


def test_gmsh_file_without_names(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """A file whose groups have no names is refused."""
    path = shared_tmp_path / "rod.msh"
    if comm.rank == 0:
        write_rod(path, names=False)
    comm.Barrier()
    with pytest.raises(ValueError, match="physical curve"):
        Domain.from_gmsh(comm, path)


def test_no_gmsh_file(comm: MPI.Intracomm) -> None:
    """A missing file is named."""
    with pytest.raises(FileNotFoundError, match=r"nowhere\.msh does not exist"):
        Domain.from_gmsh(comm, "nowhere.msh")


def test_cell_integral_matches_ufl(comm: MPI.Intracomm) -> None:
    """Cell volumes are those of UFL."""
    from dolfinx import fem

    domain = Domain.rectangle(comm, 1.0, 0.1, elements=(7, 3), cell="triangle")
    one = fem.Constant(domain.mesh, np.float64(1.0))
    area = comm.allreduce(fem.assemble_scalar(fem.form(one * ufl.dx)))
    assert domain.area == pytest.approx(area, rel=1e-13)
