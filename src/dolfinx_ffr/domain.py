# SPDX-License-Identifier: MIT
"""The mesh of one body with its interfaces, and its design and non-design regions.

An interface is a set of boundary facets that moves as a rigid body: a bearing surface, a clamped end. Interfaces are
named by a predicate on coordinates, by facets, or by the physical groups of a gmsh file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from . import _compat
from .form_cache import claim_form_cache

__all__ = ["Domain", "Interface"]

Predicate = Callable[[NDArray[np.float64]], NDArray[np.bool_]]


@dataclass(frozen=True)
class Interface:
    """Boundary facets that move as one rigid body."""

    name: str  #: how joints and frames refer to it
    facets: NDArray[np.int32]  #: local facets on this rank, ghosts included
    dofs: NDArray[np.int32]  #: local (blocked) dofs on this rank, ghosts included
    center: NDArray[np.float64]  #: (2,) reference point of the rigid motion [m], the same on every rank


class Domain:
    """The mesh of one body in the plane, with named interfaces and solid (non-design) cells.

    Args:
        domain: DOLFINx mesh of triangles or quadrilaterals with two coordinates [m], distributed over its communicator.
        interfaces: for each name either a predicate on coordinates ``(3, points) -> bool`` (picks boundary facets all
            of whose vertices fulfil it), or an array of local facets on this rank.
        solid: cells that are not designed and stay solid: a predicate on coordinates (cells all of whose vertices
            fulfil it), an array of local cells, or None.
        order: polynomial order of the displacements.
        centers: reference points of interfaces [m]; by default the centroid of each interface's facets.

    Raises:
        ValueError: on every rank, if an interface is missing, empty, a single point, or shares nodes with another, if
            a piece of the mesh touches no interface, or if cells are inverted or hanging.
    """

    def __init__(
        self,
        domain: mesh.Mesh,
        interfaces: Mapping[str, Predicate | ArrayLike],
        solid: Predicate | ArrayLike | None = None,
        *,
        order: int = 1,
        centers: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        if domain.topology.dim != 2 or domain.geometry.dim != 2:
            raise ValueError(
                f"domain: the mesh has topological dimension {domain.topology.dim} in "
                f"{domain.geometry.dim} dimensions; a body in the plane needs 2 in 2 (with gmsh, read with gdim=2)"
            )
        if int(order) != order or order < 1:
            raise ValueError(f"domain: order = {order} must be a whole number of at least 1")
        claim_form_cache(domain.comm)
        self.mesh = domain
        self.order = int(order)
        self.comm: MPI.Comm = domain.comm
        domain.topology.create_entities(1)
        domain.topology.create_connectivity(1, 2)
        domain.topology.create_connectivity(2, 1)
        domain.topology.create_connectivity(2, 0)
        self.space = _compat.function_space(domain, "Lagrange", self.order, (2,))  #: displacements
        self.density_space = _compat.function_space(domain, "DG", 0)  #: one density a cell
        cells = domain.topology.index_map(2)
        #: cells owned by this rank, cells on all ranks
        self.n_cells, self.n_cells_global = int(cells.size_local), int(cells.size_global)
        if not np.array_equal(
            _compat.dofmap_array(self.density_space).ravel(),
            np.arange(cells.size_local + cells.num_ghosts),
        ):
            raise RuntimeError("domain: DG0 dofs are not numbered like cells in this DOLFINx release")
        self._check_cells()
        self.interfaces = self._find_interfaces(interfaces, centers or {})
        self._check_hanging_nodes()
        self._check_held()
        self.design_cells = self._find_design_cells(solid)

    # ------------------------------------------------------------------ built-in and file meshes

    @classmethod
    def rectangle(
        cls,
        comm: MPI.Comm,
        length: float,
        height: float,
        *,
        elements: tuple[int, int],
        cell: str = "quadrilateral",
        order: int = 1,
        solid_columns: int = 2,
    ) -> Domain:
        """Return a straight rod along x with the rigid interfaces ``"left"`` and ``"right"``.

        The rod spans 0 <= x <= length and -height/2 <= y <= height/2.

        Args:
            comm: communicator over which the mesh is distributed.
            length: extent in x [m].
            height: extent in y [m].
            elements: numbers of elements in x and y. With triangles each of these rectangles is cut into four, so that
                the mesh has the symmetries of the rod.
            cell: ``"quadrilateral"`` or ``"triangle"``.
            order: polynomial order of the displacements.
            solid_columns: element columns at each end that are not designed.

        Raises:
            ValueError: if a number is out of range.
        """
        nx, ny = elements
        if not (np.isfinite(length) and np.isfinite(height) and length > 0 and height > 0):
            raise ValueError(f"rectangle: length = {length} and height = {height} must be positive")
        if nx < 1 or ny < 1:
            raise ValueError(f"rectangle: elements = {elements} must be at least 1 in each direction")
        if solid_columns < 0 or 2 * solid_columns >= nx:
            raise ValueError(
                f"rectangle: solid_columns = {solid_columns} leaves nothing to design among {nx} element columns"
            )
        kinds = {"quadrilateral": mesh.CellType.quadrilateral, "triangle": mesh.CellType.triangle}
        if cell not in kinds:
            raise ValueError(f"rectangle: cell = {cell!r} must be one of {sorted(kinds)}")
        corners = [np.array([0.0, -height / 2]), np.array([length, height / 2])]
        options = {"diagonal": mesh.DiagonalType.crossed} if cell == "triangle" else {}
        domain = mesh.create_rectangle(comm, corners, [nx, ny], kinds[cell], **options)
        eps = 1e-6 * length / nx
        inner = solid_columns * length / nx
        return cls(
            domain,
            {"left": lambda x: x[0] < eps, "right": lambda x: x[0] > length - eps},
            (lambda x: (x[0] < inner + eps) | (x[0] > length - inner - eps)) if solid_columns else None,
            order=order,
        )

    @classmethod
    def from_gmsh(
        cls,
        comm: MPI.Comm,
        path: str | Path,
        *,
        interfaces: Sequence[str] = ("left", "right"),
        solid: Sequence[str] = ("solid",),
        order: int = 1,
        centers: Mapping[str, Sequence[float]] | None = None,
    ) -> Domain:
        """Read a body from a gmsh file (``.msh``) by the names of its physical groups.

        Args:
            comm: communicator over which the mesh is distributed; rank 0 reads the file.
            path: the file; it holds physical groups of curves (interfaces) and of surfaces (material).
            interfaces: names of the physical curves that are rigid interfaces.
            solid: names of physical surfaces that are not designed; names that the file does not have are passed over
                unless no surface would be left to design.
            order: polynomial order of the displacements.
            centers: reference points of interfaces [m]; by default the centroid of each interface's facets.

        Raises:
            FileNotFoundError: if there is no such file.
            ValueError: if the file lacks a named interface (the message lists the groups that are there).
        """
        domain, cell_tags, facet_tags, groups = _read_gmsh(comm, Path(path))
        curves = {name: tag for (dim, name), tag in groups.items() if dim == 1}
        surfaces = {name: tag for (dim, name), tag in groups.items() if dim == 2}
        missing = [name for name in interfaces if name not in curves]
        if missing:
            raise ValueError(
                f"{path}: no physical curve named {', '.join(map(repr, missing))}; the file has the physical curves "
                f"{sorted(curves) or 'none'} and the physical surfaces {sorted(surfaces) or 'none'}. "
                "Name the groups in gmsh, or pass interfaces=[...]"
            )
        facets = {name: facet_tags.indices[facet_tags.values == curves[name]] for name in interfaces}
        solid_tags = [surfaces[name] for name in solid if name in surfaces]
        cells = cell_tags.indices[np.isin(cell_tags.values, solid_tags)]
        return cls(domain, facets, cells, order=order, centers=centers)

    # ------------------------------------------------------------------ geometry

    @cached_property
    def cell_volumes(self) -> NDArray[np.float64]:
        """Area of each cell owned by this rank, shape (cells,) [m^2]."""
        return self._cell_integral(1.0)

    @cached_property
    def centroids(self) -> NDArray[np.float64]:
        """Centroid of each cell owned by this rank, shape (cells, 2) [m]."""
        points, weights = self.quadrature_points(2)
        return np.einsum("cqd,cq->cd", points, weights)

    @cached_property
    def bounding_box(self) -> NDArray[np.float64]:
        """Lower and upper corner of the body, shape (2, 2) [m], the same on every rank."""
        x = self.mesh.geometry.x[:, :2]
        low = np.min(x, axis=0, initial=np.inf)
        high = np.max(x, axis=0, initial=-np.inf)
        box = np.empty((2, 2))
        self.comm.Allreduce(low, box[0], MPI.MIN)
        self.comm.Allreduce(high, box[1], MPI.MAX)
        return box

    @property
    def area(self) -> float:
        """Area of the whole body [m^2], the same on every rank."""
        return self.sum(self.cell_volumes)

    def sum(self, values: NDArray[np.float64]) -> float:
        """Return the sum of an array over all ranks, bit-identical on every rank."""
        return float(self.comm.bcast(self.comm.reduce(float(np.sum(values)), root=0), root=0))

    def quadrature_points(self, n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points inside each cell owned by this rank with weights that average over the cell.

        Args:
            n: points in each direction (triangles: a rule of degree 2 n - 1).

        Returns:
            Points of shape (cells, q, 2) [m] and weights of shape (cells, q) with sum 1 in each cell.
        """
        cell = getattr(basix.CellType, self.mesh.ufl_cell().cellname())
        reference, weights = basix.make_quadrature(cell, 2 * n - 1)
        cells = np.arange(self.n_cells, dtype=np.int32)
        points = self._evaluate(ufl.SpatialCoordinate(self.mesh), reference, cells)
        jacobian = self._evaluate(ufl.JacobianDeterminant(self.mesh), reference, cells)[:, :, 0]
        averaging = weights[None, :] * np.abs(jacobian)
        return points, averaging / averaging.sum(axis=1, keepdims=True)

    def _evaluate(self, expression: Any, points: NDArray[np.float64], cells: NDArray[np.int32]) -> Any:
        return _compat.evaluate_expression(expression, np.asarray(points), self.mesh, cells)

    def _cell_integral(self, integrand: Any) -> NDArray[np.float64]:
        test = ufl.TestFunction(self.density_space)
        form = fem.form(integrand * test * ufl.dx(domain=self.mesh))
        return np.array(fem.assemble_vector(form).array[: self.n_cells])

    # ------------------------------------------------------------------ densities

    def check_density(self, x: ArrayLike, name: str = "density") -> NDArray[np.float64]:
        """Return ``x`` as an array, or raise the same clear error on every rank.

        Args:
            x: one density for each cell owned by this rank, shape (cells,), in [0, 1].
            name: what the message calls it.

        Raises:
            ValueError: if the size is wrong, or a value is NaN or outside [0, 1].
        """
        array = np.asarray(x, dtype=np.float64)
        if self._anywhere(array.shape != (self.n_cells,)):
            raise ValueError(
                f"{name}: has shape {array.shape} on rank {self.comm.rank}, expected ({self.n_cells},), one value for "
                "each cell owned by the rank; start from numpy.ones(domain.n_cells)"
            )
        bad = int(self.comm.allreduce(int(np.count_nonzero(~np.isfinite(array)))))
        if bad:
            raise ValueError(f"{name}: {bad} of {self.n_cells_global} values are NaN or infinite")
        low = self.comm.allreduce(float(np.min(array, initial=np.inf)), MPI.MIN)
        high = self.comm.allreduce(float(np.max(array, initial=-np.inf)), MPI.MAX)
        if low < 0.0 or high > 1.0:
            raise ValueError(f"{name}: values from {low:.6g} to {high:.6g} leave [0, 1]; clip them first")
        return array

    # ------------------------------------------------------------------ checks

    def _anywhere(self, condition: Any) -> bool:
        return bool(self.comm.allreduce(bool(condition), MPI.LOR))

    def _check_cells(self) -> None:
        """Refuse cells whose map from the reference cell folds over."""
        cell = getattr(basix.CellType, self.mesh.ufl_cell().cellname())
        reference = np.vstack([basix.geometry(cell), basix.make_quadrature(cell, 3)[0]])
        cells = np.arange(self.n_cells, dtype=np.int32)
        jacobian = self._evaluate(ufl.JacobianDeterminant(self.mesh), reference, cells)[:, :, 0]
        scale = np.max(np.abs(jacobian), axis=1, initial=0.0)
        folded = np.min(jacobian * np.sign(jacobian[:, :1]), axis=1, initial=np.inf) <= 1e-12 * scale
        bad = int(self.comm.allreduce(int(np.count_nonzero(folded))))
        if bad:
            where = [tuple(np.round(p, 6)) for p in self._cell_midpoints()[folded][:3]]
            where = [p for part in self.comm.allgather(where) for p in part][:3]
            raise ValueError(
                f"mesh: {bad} cells are inverted or without area, the first near {where} m; "
                "repair the mesh (in gmsh: another algorithm, or straighter high-order cells)"
            )

    def _cell_midpoints(self) -> NDArray[np.float64]:
        nodes = _compat.cell_geometry(self.mesh)[: self.n_cells]
        return np.asarray(self.mesh.geometry.x[nodes][:, :, :2].sum(axis=1) / max(nodes.shape[1], 1))

    def _find_interfaces(
        self, interfaces: Mapping[str, Predicate | ArrayLike], centers: Mapping[str, Sequence[float]]
    ) -> dict[str, Interface]:
        if not interfaces:
            raise ValueError(
                "domain: no interfaces given; a body needs at least one rigid interface to be held by"
            )
        unknown = sorted(set(centers) - set(interfaces))
        if unknown:
            raise ValueError(f"domain: centers for unknown interfaces {unknown}; there are {sorted(interfaces)}")
        found: dict[str, Interface] = {}
        owner: dict[str, NDArray[np.int32]] = {}
        coordinates = self.space.tabulate_dof_coordinates()
        for name, where in interfaces.items():
            if callable(where):
                facets = mesh.locate_entities_boundary(self.mesh, 1, where)
            else:
                facets = np.unique(np.asarray(where, dtype=np.int32))
            facets = np.asarray(facets, dtype=np.int32)
            if self.comm.allreduce(len(facets)) == 0:
                low, high = self.bounding_box
                raise ValueError(
                    f"interface {name!r} has no facets: its predicate or tag picks no boundary facet of the body, which "
                    f"spans x from {low[0]:.6g} to {high[0]:.6g} m and y from {low[1]:.6g} to {high[1]:.6g} m"
                )
            dofs = np.asarray(fem.locate_dofs_topological(self.space, 1, facets), dtype=np.int32)
            for other, taken in owner.items():
                shared = np.intersect1d(dofs, taken)
                if self._anywhere(len(shared)):
                    raise ValueError(
                        f"interfaces {other!r} and {name!r} overlap: they share nodes, and a node cannot follow two "
                        "rigid motions; leave at least one free facet between them or join them into one"
                    )
            points = self.comm.allgather(coordinates[dofs][:, :2])
            extent = np.ptp(np.vstack(points), axis=0).max()
            if not extent > 0.0:
                raise ValueError(f"interface {name!r} is a single point: it cannot hold the body against rotation")
            center = np.asarray(centers.get(name, self._facet_centroid(facets)), dtype=np.float64)
            if center.shape != (2,) or not np.all(np.isfinite(center)):
                raise ValueError(f"interface {name!r}: center {center} must be two finite coordinates [m]")
            owner[name] = dofs
            found[name] = Interface(name, facets, dofs, center)
        return found

    def _facet_centroid(self, facets: NDArray[np.int32]) -> NDArray[np.float64]:
        tags = mesh.meshtags(self.mesh, 1, np.sort(facets), np.full(len(facets), 1, dtype=np.int32))
        ds = ufl.Measure("ds", domain=self.mesh, subdomain_data=tags)(1)
        x = ufl.SpatialCoordinate(self.mesh)
        one = fem.Constant(self.mesh, np.float64(1.0))
        moments = [
            self.comm.allreduce(fem.assemble_scalar(fem.form(f * ds))) for f in (one, one * x[0], one * x[1])
        ]
        return np.array(moments[1:]) / moments[0]

    def _boundary_segments(self) -> NDArray[np.float64]:
        """Return end points of all facets on the boundary, shape (facets, 2, 2), the same on every rank."""
        self.mesh.topology.create_connectivity(1, 2)
        everything = mesh.locate_entities_boundary(self.mesh, 1, lambda x: np.full(x.shape[1], True))
        owned = everything[everything < self.mesh.topology.index_map(1).size_local]
        ends = self._vertex_nodes()[_compat.entity_vertices(self.mesh, 1)[owned].reshape(-1, 2)]
        return np.vstack(self.comm.allgather(self.mesh.geometry.x[ends][:, :, :2]))

    def _vertex_nodes(self) -> NDArray[np.int32]:
        """Return the geometry node of each local vertex."""
        table = _compat.entity_vertices(self.mesh, 2)
        nodes = np.zeros(table.max(initial=-1) + 1, dtype=np.int32)
        # vertices come first among a cell's geometry nodes, in the same order
        nodes[table.ravel()] = _compat.cell_geometry(self.mesh)[:, : table.shape[1]].ravel()
        return nodes

    def _check_hanging_nodes(self) -> None:
        """Refuse a boundary vertex in the middle of another boundary facet: two cells that only seem to be joined."""
        segments = self._boundary_segments()
        middle = segments.mean(axis=1)
        direction = segments[:, 1] - segments[:, 0]
        length = np.linalg.norm(direction, axis=1)
        vertices = np.unique(np.round(segments.reshape(-1, 2), 14), axis=0)
        near = cKDTree(vertices).query_ball_point(middle, 0.499 * length)
        for i, candidates in enumerate(near):
            offset = vertices[candidates] - middle[i]
            across = np.abs(offset[:, 0] * direction[i, 1] - offset[:, 1] * direction[i, 0])
            hits = np.flatnonzero(across < 1e-9 * length[i] ** 2)
            if len(hits):
                raise ValueError(
                    f"mesh: hanging node at {tuple(np.round(vertices[candidates][hits[0]], 6))} m, in the middle of "
                    "another cell's edge; refine conformingly so that neighbouring cells share whole edges"
                )

    def _check_held(self) -> None:
        """Refuse pieces of the mesh that touch no interface and would float away."""
        topology = self.mesh.topology
        table = _compat.entity_vertices(self.mesh, 2)
        vertex_map = topology.index_map(0)
        global_vertices = vertex_map.local_to_global(np.arange(table.max(initial=-1) + 1, dtype=np.int32))
        held = np.zeros(len(global_vertices), dtype=bool)
        facet_vertices = _compat.entity_vertices(self.mesh, 1)
        for interface in self.interfaces.values():
            held[facet_vertices[interface.facets].ravel()] = True
        n = int(vertex_map.size_global)
        piece = _pieces(table, len(global_vertices))
        # a vertex stands for its piece on each rank; ranks meet in shared vertices
        first = np.full(piece.max(initial=-1) + 1, n, dtype=np.int64)
        np.minimum.at(first, piece, global_vertices)
        edges = np.unique(np.column_stack([global_vertices, first[piece]]), axis=0)
        gathered = np.vstack(self.comm.allgather(edges))
        held_global = np.unique(np.concatenate(self.comm.allgather(global_vertices[held])))
        graph = coo_matrix((np.ones(len(gathered)), (gathered[:, 0], gathered[:, 1])), shape=(n, n))
        count, label = connected_components(graph, directed=False)
        floating = np.setdiff1d(np.arange(count), label[held_global])
        if len(floating):
            low, high = self.bounding_box
            raise ValueError(
                f"mesh: {len(floating)} of {count} separate pieces of the body touch no interface "
                f"{sorted(self.interfaces)} and would float; give each piece an interface, or merge coincident nodes "
                f"(body between {tuple(np.round(low, 6))} and {tuple(np.round(high, 6))} m)"
            )

    def _find_design_cells(self, solid: Predicate | ArrayLike | None) -> NDArray[np.bool_]:
        design = np.ones(self.n_cells, dtype=bool)
        if solid is not None:
            cells = mesh.locate_entities(self.mesh, 2, solid) if callable(solid) else np.asarray(solid)
            cells = np.asarray(cells, dtype=np.int64)
            design[cells[cells < self.n_cells]] = False
        if not self._anywhere(np.any(design)):
            raise ValueError("domain: all cells are solid, nothing is left to design; make the solid region smaller")
        return design


def _pieces(table: NDArray[np.int32], n_vertices: int) -> NDArray[np.int32]:
    """Return the number of the connected piece of each vertex on this rank."""
    rows = np.repeat(table[:, :1].ravel(), max(table.shape[1] - 1, 0))
    columns = table[:, 1:].ravel()
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(n_vertices, n_vertices))
    return connected_components(graph, directed=False)[1]


def _read_gmsh(comm: MPI.Comm, path: Path) -> tuple[mesh.Mesh, Any, Any, dict[tuple[int, str], int]]:
    """Read mesh, tags and physical names; errors on rank 0 are raised on every rank."""
    error: Exception | None = None
    groups: dict[tuple[int, str], int] = {}
    gmsh = None
    if comm.rank == 0:
        try:
            groups, gmsh = _open_gmsh(path)
        except (OSError, ValueError, ImportError) as exc:
            error = exc
    error = comm.bcast(error, root=0)
    if error is not None:
        raise error
    groups = comm.bcast(groups, root=0)
    try:
        model = gmsh.model if gmsh is not None else None
        domain, cell_tags, facet_tags = _compat.gmsh_model_to_mesh(model, comm, 0)
    finally:
        if gmsh is not None:
            gmsh.finalize()
    return domain, cell_tags, facet_tags, groups


def _open_gmsh(path: Path) -> tuple[dict[tuple[int, str], int], Any]:
    if not path.is_file():
        raise FileNotFoundError(f"mesh file {path} does not exist")
    try:
        import gmsh
    except ImportError as exc:
        raise ImportError(f"reading {path} needs gmsh's Python module (Debian: python3-gmsh)") from exc
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
    except Exception as exc:
        gmsh.finalize()
        raise ValueError(f"{path} is not a mesh that gmsh can read: {exc}") from exc
    groups = {
        (dim, gmsh.model.getPhysicalName(dim, tag)): tag for dim, tag in gmsh.model.getPhysicalGroups()
    }
    names = {dim: [name for d, name in groups if d == dim] for dim in (1, 2)}
    if not names[1] or not names[2]:
        gmsh.finalize()
        raise ValueError(
            f"{path}: needs physical groups of curves (interfaces) and of surfaces (material); it has the curves "
            f"{sorted(names[1]) or 'none'} and the surfaces {sorted(names[2]) or 'none'}"
        )
    return groups, gmsh
