# SPDX-License-Identifier: MIT
"""The mesh of one body with its interfaces, and its design and non-design regions.

An interface is a set of boundary facets that moves as a rigid body: a bearing surface, a clamped
end. Interfaces are named by a predicate on coordinates, by facets, or by the physical groups of a
gmsh file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from mpi4py import MPI

import basix
import numpy as np
import ufl
from dolfinx import fem, mesh
from numpy.typing import ArrayLike, NDArray

from . import _compat
from .circles import fit_circle
from .form_cache import claim_form_cache
from .mesh_checks import check_cells, check_hanging_nodes, check_held, facet_points
from .mesh_file import TaggedMesh, read_gmsh, read_gmsh_model

__all__ = ["Domain", "Interface"]

Predicate = Callable[[NDArray[np.float64]], NDArray[np.bool_]]


@dataclass(frozen=True)
class Interface:
    """Boundary facets that move as one rigid body."""

    name: str  #: how joints and frames refer to it
    facets: NDArray[np.int32]  #: local facets on this rank, ghosts included
    dofs: NDArray[np.int32]  #: local (blocked) dofs on this rank, ghosts included
    #: (2,) reference point of the rigid motion [m], the same on every rank
    center: NDArray[np.float64]


class Domain:
    """The mesh of one body in the plane, with named interfaces and solid (non-design) cells.

    Args:
        domain: DOLFINx mesh of triangles or quadrilaterals with two coordinates [m], distributed
            over its communicator.
        interfaces: for each name either a predicate on coordinates ``(3, points) -> bool`` (picks
            boundary facets all of whose vertices fulfil it), or an array of local facets on this
            rank.
        solid: cells that are not designed and stay solid: a predicate on coordinates (cells all of
            whose vertices fulfil it), an array of local cells, or None.
        order: polynomial order of the displacements.
        centers: reference points of interfaces [m]; by default the centre of the circle on which
            an interface's nodes lie (a bore, or an arc of at least a sixth of one), or else the
            centroid of its facets.

    Raises:
        ValueError: on every rank, if an interface is missing, empty, a single point, or shares
            nodes with another, if a piece of the mesh touches no interface, or if cells are
            inverted or hanging.
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
                f"{domain.geometry.dim} dimensions; a body in the plane needs 2 in 2 (with "
                f"gmsh, read with gdim=2)"
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
            raise RuntimeError(
                "domain: DG0 dofs are not numbered like cells in this DOLFINx release"
            )
        check_cells(domain)
        self.interfaces = self._find_interfaces(interfaces, centers or {})
        check_hanging_nodes(domain)
        check_held(domain, [part.facets for part in self.interfaces.values()])
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
            elements: numbers of elements in x and y. With triangles each of these rectangles is
                cut into four, so that the mesh has the symmetries of the rod.
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
            raise ValueError(
                f"rectangle: elements = {elements} must be at least 1 in each direction"
            )
        if solid_columns < 0 or 2 * solid_columns >= nx:
            raise ValueError(
                f"rectangle: solid_columns = {solid_columns} leaves nothing to design among "
                f"{nx} element columns"
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
            (lambda x: (x[0] < inner + eps) | (x[0] > length - inner - eps))
            if solid_columns
            else None,
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
            path: the file; it holds physical groups of curves (interfaces) and of surfaces
                (material).
            interfaces: names of the physical curves that are rigid interfaces.
            solid: names of physical surfaces that are not designed; names that the file does not
                have are passed over unless no surface would be left to design.
            order: polynomial order of the displacements.
            centers: reference points of interfaces [m]; by default as described for `Domain`.

        Raises:
            FileNotFoundError: if there is no such file.
            ValueError: if the file lacks a named interface (the message lists the groups that are
                there).
        """
        return cls._from_tags(read_gmsh(comm, Path(path)), interfaces, solid, order, centers)

    @classmethod
    def from_gmsh_model(
        cls,
        comm: MPI.Comm,
        model: Any,
        *,
        interfaces: Sequence[str] = ("left", "right"),
        solid: Sequence[str] = ("solid",),
        order: int = 1,
        centers: Mapping[str, Sequence[float]] | None = None,
    ) -> Domain:
        """Take a body from gmsh's current model, as `from_gmsh` does from a file.

        Args:
            comm: communicator over which the mesh is distributed.
            model: ``gmsh.model`` with a mesh on rank 0; not used on the others.
            interfaces: names of the physical curves that are rigid interfaces.
            solid: names of physical surfaces that are not designed.
            order: polynomial order of the displacements.
            centers: reference points of interfaces [m]; by default as described for `Domain`.

        Raises:
            ValueError: on every rank, if the model lacks a named interface, has no mesh, or has a
                surface in several physical groups.
        """
        return cls._from_tags(read_gmsh_model(comm, model), interfaces, solid, order, centers)

    @classmethod
    def _from_tags(
        cls,
        read: TaggedMesh,
        interfaces: Sequence[str],
        solid: Sequence[str],
        order: int,
        centers: Mapping[str, Sequence[float]] | None,
    ) -> Domain:
        curves, surfaces = read.groups(1), read.groups(2)
        missing = [name for name in interfaces if name not in curves]
        if missing:
            raise ValueError(
                f"{read.source}: no physical curve named {', '.join(map(repr, missing))}; it has "
                f"the physical curves {sorted(curves) or 'none'} and the physical surfaces "
                f"{sorted(surfaces) or 'none'}. "
                "Name the groups in gmsh, or pass interfaces=[...]"
            )
        tags = read.facet_tags
        facets = {name: tags.indices[tags.values == curves[name]] for name in interfaces}
        solid_tags = [surfaces[name] for name in solid if name in surfaces]
        cells = read.cell_tags.indices[np.isin(read.cell_tags.values, solid_tags)]
        return cls(read.mesh, facets, cells, order=order, centers=centers)

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
        """Return the sum of ``values`` over all ranks, bit-identical on every rank."""
        return float(self.comm.bcast(self.comm.reduce(float(np.sum(values)), root=0), root=0))

    def everywhere(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return values of all cells on every rank, in the order in which the mesh was made.

        Args:
            values: of the cells owned by this rank, shape (cells, ...).

        Returns:
            Shape (cells of all ranks, ...), whatever the number of ranks.
        """
        parts = self.comm.allgather(np.asarray(values))
        return np.asarray(np.concatenate(parts)[self._order[0]])

    def owned(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the part that this rank owns of values of all cells, the inverse of `everywhere`.

        Args:
            values: of all cells, shape (cells of all ranks, ...).
        """
        return np.asarray(values[self._order[1]])

    @cached_property
    def _order(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Where each cell stands among those sent by the ranks; where this rank's cells stand."""
        number = np.asarray(self.mesh.topology.original_cell_index)[: self.n_cells]
        parts = self.comm.allgather(number)
        order = np.argsort(np.concatenate(parts), kind="stable")
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        first = sum(len(part) for part in parts[: self.comm.rank])
        return order, place[first : first + self.n_cells]

    def quadrature_points(self, n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points in each cell of this rank with weights that average over the cell.

        Args:
            n: points in each direction (triangles: a rule of degree 2 n - 1).

        Returns:
            Points of shape (cells, q, 2) [m] and weights of shape (cells, q) with sum 1 in each
            cell.
        """
        cell = getattr(basix.CellType, self.mesh.ufl_cell().cellname())
        reference, weights = basix.make_quadrature(cell, 2 * n - 1)
        cells = np.arange(self.n_cells, dtype=np.int32)
        points = self._evaluate(ufl.SpatialCoordinate(self.mesh), reference, cells)
        jacobian = self._evaluate(ufl.JacobianDeterminant(self.mesh), reference, cells)[:, :, 0]
        averaging = weights[None, :] * np.abs(jacobian)
        return points, averaging / averaging.sum(axis=1, keepdims=True)

    def _evaluate(
        self, expression: Any, points: NDArray[np.float64], cells: NDArray[np.int32]
    ) -> Any:
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
                f"{name}: has shape {array.shape} on rank {self.comm.rank}, expected "
                f"({self.n_cells},), one value for "
                "each cell owned by the rank; start from numpy.ones(domain.n_cells)"
            )
        bad = int(self.comm.allreduce(int(np.count_nonzero(~np.isfinite(array)))))
        if bad:
            raise ValueError(f"{name}: {bad} of {self.n_cells_global} values are NaN or infinite")
        low = self.comm.allreduce(float(np.min(array, initial=np.inf)), MPI.MIN)
        high = self.comm.allreduce(float(np.max(array, initial=-np.inf)), MPI.MAX)
        if low < 0.0 or high > 1.0:
            raise ValueError(
                f"{name}: values from {low:.6g} to {high:.6g} leave [0, 1]; clip them first"
            )
        return array

    # ------------------------------------------------------------------ checks

    def _anywhere(self, condition: Any) -> bool:
        return bool(self.comm.allreduce(bool(condition), MPI.LOR))

    def _find_interfaces(
        self,
        interfaces: Mapping[str, Predicate | ArrayLike],
        centers: Mapping[str, Sequence[float]],
    ) -> dict[str, Interface]:
        if not interfaces:
            raise ValueError(
                "domain: no interfaces given; a body needs at least one rigid interface to be "
                "held by"
            )
        unknown = sorted(set(centers) - set(interfaces))
        if unknown:
            raise ValueError(
                f"domain: centers for unknown interfaces {unknown}; there are {sorted(interfaces)}"
            )
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
                    f"interface {name!r} has no facets: its predicate or tag picks no boundary "
                    f"facet of the body, which "
                    f"spans x from {low[0]:.6g} to {high[0]:.6g} m and y from {low[1]:.6g} to "
                    f"{high[1]:.6g} m"
                )
            dofs = np.asarray(fem.locate_dofs_topological(self.space, 1, facets), dtype=np.int32)
            for other, taken in owner.items():
                shared = np.intersect1d(dofs, taken)
                if self._anywhere(len(shared)):
                    raise ValueError(
                        f"interfaces {other!r} and {name!r} overlap: they share nodes, and a "
                        f"node cannot follow two "
                        "rigid motions; leave at least one free facet between them or join them "
                        "into one"
                    )
            points = self.comm.allgather(coordinates[dofs][:, :2])
            extent = np.ptp(np.vstack(points), axis=0).max()
            if not extent > 0.0:
                raise ValueError(
                    f"interface {name!r} is a single point: it cannot hold the body against "
                    f"rotation"
                )
            center = np.asarray(
                centers[name] if name in centers else self._center(facets), dtype=np.float64
            )
            if center.shape != (2,) or not np.all(np.isfinite(center)):
                raise ValueError(
                    f"interface {name!r}: center {center} must be two finite coordinates [m]"
                )
            owner[name] = dofs
            found[name] = Interface(name, facets, dofs, center)
        return found

    def _center(self, facets: NDArray[np.int32]) -> NDArray[np.float64]:
        circle = fit_circle(facet_points(self.mesh, facets))
        return self._facet_centroid(facets) if circle is None else circle

    def _facet_centroid(self, facets: NDArray[np.int32]) -> NDArray[np.float64]:
        tags = mesh.meshtags(self.mesh, 1, np.sort(facets), np.full(len(facets), 1, dtype=np.int32))
        ds = ufl.Measure("ds", domain=self.mesh, subdomain_data=tags)(1)
        x = ufl.SpatialCoordinate(self.mesh)
        one = fem.Constant(self.mesh, np.float64(1.0))
        moments = [
            self.comm.allreduce(fem.assemble_scalar(fem.form(f * ds)))
            for f in (one, one * x[0], one * x[1])
        ]
        return np.array(moments[1:]) / moments[0]

    def _find_design_cells(self, solid: Predicate | ArrayLike | None) -> NDArray[np.bool_]:
        design = np.ones(self.n_cells, dtype=bool)
        if solid is not None:
            cells = (
                mesh.locate_entities(self.mesh, 2, solid) if callable(solid) else np.asarray(solid)
            )
            cells = np.asarray(cells, dtype=np.int64)
            design[cells[cells < self.n_cells]] = False
        if not self._anywhere(np.any(design)):
            raise ValueError(
                "domain: all cells are solid, nothing is left to design; make the solid region "
                "smaller"
            )
        return design
