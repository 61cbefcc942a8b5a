# SPDX-License-Identifier: MIT
"""The mesh of one body with its interfaces, and its design and non-design regions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NoReturn

from mpi4py import MPI

import basix
import numpy as np
import shapely
import ufl
from dolfinx import fem, mesh
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from .. import validation
from ..arrays import Array, Integers, Mask
from ..parallel import gathered, on_every_rank, on_rank_0
from . import _compat
from .drawn_outline import FlatHole, flat_holes, flat_outline
from .form_cache import claim_form_cache
from .holes_in_space import SpatialHole, holes_in_space
from .interface import (
    Bore,
    Box,
    Interface,
    Predicate,
    find_interfaces,
    located_cells,
    refuse_whole_edge,
)
from .mesh_checks import (
    check_cells,
    check_hanging_nodes,
    check_held,
    facet_nodes,
    facet_points,
)
from .mesh_file import GroupedMesh, read_gmsh, read_gmsh_model
from .outline import Sheet, mesh_outline
from .rod import rod_mesh

#: Cells of bodies in the plane and in space
CELLS = ("triangle", "quadrilateral"), ("tetrahedron", "hexahedron")


@dataclass(frozen=True)
class DomainOptions:
    """Accuracy of densities, rims and holes."""

    round_off: float = 1e-14  #: Densities that leave [0, 1] by less count as 0 or 1
    on_rim: float = 1e-4  #: Share of the width of a rim by which a vertex on its edge may be off
    on_hole: float = 1e-6  #: Distance of points that are on a hole, in sizes of the body


DOMAIN = DomainOptions()


class Domain:
    """The mesh of one body, with named interfaces, and cells that are not designed.

    Args:
        domain: DOLFINx mesh, distributed over its communicator: of triangles or quadrilaterals with
            two coordinates [m] for a body in the plane, of tetrahedra or hexahedra with three for
            one in space.
        interfaces: For each name either a predicate on coordinates ``(3, points) -> bool`` (picks
            boundary facets all of whose vertices fulfil it), or an array of local facets on this
            rank, or a mask over them.
        solid: Cells that are not designed and stay solid: a predicate on coordinates (cells all of
            whose vertices fulfil it), an array of local cells or a mask over them, or None.
            Numbers and masks may count this rank's own facets and cells alone, or its ghosts too.
        void: Cells that are not designed and stay void, likewise. They count in the body's area,
            to which volumes are relative, but hold no material.
        order: Polynomial order of the displacements.
        centers: Reference points of interfaces [m]; by default the centre of the circle on which
            an interface's nodes lie (a bore, or an arc of at least a sixth of one), in space the
            middle of the axis of such a cylinder, or else the centroid of its facets.
        solid_rim: Width of a rim along each interface, for example around a bore [m]: cells that
            reach into it stay solid, so that it follows the mesh and is nowhere narrower; at least
            that of an element, or 0 for none. `from_outline` meshes its edge as a curve.

    Raises:
        ValueError: If an interface is missing, empty, a single point, shares nodes with another or
            lies on void, if a facet or cell does not exist, if a cell is to stay both solid and
            void or none is left to design, if a piece of the mesh or of its cells that are not void
            touches no interface, or if cells are inverted or hanging.
    """

    def __init__(
        self,
        domain: mesh.Mesh,
        interfaces: Mapping[str, Predicate | ArrayLike],
        solid: Predicate | ArrayLike | None = None,
        *,
        void: Predicate | ArrayLike | None = None,
        order: int = 1,
        centers: Mapping[str, Sequence[float]] | None = None,
        solid_rim: float = 0.0,
    ) -> None:
        validation.instance("domain: the mesh", domain, mesh.Mesh, "a DOLFINx mesh")
        if domain.topology.dim not in (2, 3) or domain.geometry.dim != domain.topology.dim:
            raise ValueError(
                f"domain: the mesh has topological dimension {domain.topology.dim} in "
                f"{domain.geometry.dim} dimensions; a body in the plane needs 2 in 2, one in space "
                "3 in 3 (with gmsh, read with gdim=2 or gdim=3)"
            )
        self.order = validation.integer("domain: order", order, least=1)
        claim_form_cache(domain.comm)
        self.mesh = domain
        dim = self.dimension = int(domain.topology.dim)  #: 2 in the plane, 3 in space
        #: ``"triangle"``, ``"quadrilateral"``, ``"tetrahedron"`` or ``"hexahedron"``
        self.cell = _compat.cell_name(domain)
        if self.cell not in CELLS[dim - 2]:
            raise ValueError(
                f"domain: the mesh has cells of the kind {self.cell!r}; take cells of the kind "
                f"{' or '.join(CELLS[dim - 2])}"
            )
        self.comm: MPI.Comm = domain.comm
        domain.topology.create_entities(dim - 1)
        domain.topology.create_connectivity(dim - 1, dim)
        domain.topology.create_connectivity(dim, dim - 1)
        domain.topology.create_connectivity(dim, 0)
        #: Displacements
        self.space = _compat.function_space(domain, "Lagrange", self.order, (dim,))
        self.density_space = _compat.function_space(domain, "DG", 0)  #: One density a cell
        cells = domain.topology.index_map(dim)
        #: Cells owned by this rank, cells on all ranks
        self.n_cells, self.n_cells_global = int(cells.size_local), int(cells.size_global)
        check_cells(domain)
        #: Interfaces by name
        self.interfaces: dict[str, Interface] = find_interfaces(
            self.space,
            validation.by_name("domain: interfaces", interfaces, "predicates or facets"),
            validation.by_name("domain: centers", centers or {}, "points"),
            self.bounding_box,
        )
        check_hanging_nodes(domain)
        check_held(domain, [interface.facets for interface in self.interfaces.values()])
        #: Cells owned by this rank that stay solid, and that stay void, shape (cells,)
        self.solid_cells, self.void_cells = (
            located_cells(self.mesh, f"domain: {name}", region)
            for name, region in (("solid", solid), ("void", void))
        )
        if solid_rim:
            self.solid_cells |= self._rim(solid_rim)
        #: The body as it was designed, where this is a mesh of the part that came of it
        self.whole: Domain | None = None
        #: Cells owned by this rank that are designed, shape (cells,)
        self.design_cells = ~(self.solid_cells | self.void_cells)
        self._check_passive()

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
        solid_length: float | None = None,
        solid: Predicate | None = None,
        void: Predicate | None = None,
    ) -> Domain:
        """A straight rod along x with the rigid interfaces ``"left"`` and ``"right"``.

        The rod spans 0 <= x <= length and -height/2 <= y <= height/2.

        Args:
            comm: Communicator over which the mesh is distributed.
            length: Extent in x [m].
            height: Extent in y [m].
            elements: Numbers of elements in x and y. With triangles each of these rectangles is
                cut into four, so that the mesh has the symmetries of the rod.
            cell: ``"quadrilateral"`` or ``"triangle"``.
            order: Polynomial order of the displacements.
            solid_columns: Element columns at each end that are not designed.
            solid_length: Instead a length at each end, to which columns are fitted [m].
            solid: Further cells that stay solid, a predicate as for `Domain`.
            void: Cells that stay void, a predicate.
        """
        ends, sizes = (solid_columns, solid_length), (length, height)
        rod = rod_mesh("rectangle", comm, sizes, elements, cell, ends, solid)
        return cls(*rod, void=void, order=order)

    @classmethod
    def box(
        cls,
        comm: MPI.Comm,
        length: float,
        height: float,
        width: float,
        *,
        elements: tuple[int, int, int],
        cell: str = "hexahedron",
        order: int = 1,
        solid_layers: int = 2,
        solid_length: float | None = None,
        solid: Predicate | None = None,
        void: Predicate | None = None,
    ) -> Domain:
        """A straight rod along x in space, with the rigid interfaces ``"left"`` and ``"right"``.

        Hexahedra of order 1 lock in bending: have four or more of them across, or take order 2.

        Args:
            comm: As for `rectangle`, as are ``order``, ``solid``, ``void`` and errors.
            length: Extent in x, from 0 [m].
            height: Extent in y, about 0 [m].
            width: Extent in z, about 0 [m].
            elements: Their numbers in x, y and z.
            cell: ``"hexahedron"`` or ``"tetrahedron"``, of which each box is cut into six.
            order: Polynomial order of the displacements.
            solid_layers: Layers of elements at each end that are not designed.
            solid_length: Instead a length at each end, to which layers are fitted [m].
            solid: Further cells that stay solid.
            void: Cells that stay void.
        """
        ends, sizes = (solid_layers, solid_length), (length, height, width)
        rod = rod_mesh("box", comm, sizes, elements, cell, ends, solid)
        return cls(*rod, void=void, order=order)

    @classmethod
    def from_gmsh(
        cls,
        comm: MPI.Comm,
        path: str | Path,
        *,
        interfaces: Sequence[str | int] = ("left", "right"),
        solid: Sequence[str | int] | Predicate | None = None,
        void: Sequence[str | int] | Predicate | None = None,
        order: int = 1,
        centers: Mapping[str, Sequence[float]] | None = None,
        solid_rim: float = 0.0,
    ) -> Domain:
        """Read a body from a gmsh file (``.msh``) by the names of its physical groups.

        The file is data: one that does not begin as a mesh is refused, as gmsh would execute it.

        Args:
            comm: Communicator over which the mesh is distributed; rank 0 reads the file.
            path: The file; for a body in the plane it holds physical groups of curves (interfaces)
                and of surfaces (material), for one in space of surfaces and of volumes.
            interfaces: Names of the physical curves, in space surfaces, that are rigid interfaces.
                Numbers of groups are taken, too; a group without a name is called by its number,
                as "7".
            solid: Names of physical surfaces, in space volumes, that stay solid, or a predicate as
                for `Domain`; by default the group "solid", if there is one.
            void: Names of groups that stay void, or a predicate; by default "void", if there.
            order: Polynomial order of the displacements.
            centers: Reference points of interfaces [m]; by default as described for `Domain`.
            solid_rim: Width of a rim along each interface that stays solid [m], 0 for none. Cells
                that reach into it belong to it; for an edge that is a curve, draw it in gmsh, as a
                surface of the group "solid".

        Raises:
            FileNotFoundError: If there is no such file.
            ValueError: If the file lacks a named group (the message lists the groups that are
                there), has no mesh or one that is damaged, has cells in several physical groups, or
                is flat and leaves the plane.
        """
        validation.instance("from_gmsh: comm", comm, MPI.Comm, "an MPI communicator")
        read = read_gmsh(comm, validation.path("from_gmsh: path", path))
        regions = {"solid": solid, "void": void}
        options = {"order": order, "centers": centers, "solid_rim": solid_rim}
        return cls._from_groups(read, interfaces, regions, **options)

    @classmethod
    def from_gmsh_model(
        cls,
        comm: MPI.Comm,
        model: Any,
        *,
        interfaces: Sequence[str | int] = ("left", "right"),
        solid: Sequence[str | int] | Predicate | None = None,
        void: Sequence[str | int] | Predicate | None = None,
        order: int = 1,
        centers: Mapping[str, Sequence[float]] | None = None,
        solid_rim: float = 0.0,
    ) -> Domain:
        """Take a body from gmsh's current model, as `from_gmsh` does from a file.

        The ``model`` is ``gmsh.model`` with a mesh on rank 0 of ``comm``, and not used on the
        others; ``interfaces``, ``solid``, ``void``, ``order``, ``centers``, ``solid_rim`` and
        errors are those of `from_gmsh`.
        """
        read, regions = read_gmsh_model(comm, model), {"solid": solid, "void": void}
        options = {"order": order, "centers": centers, "solid_rim": solid_rim}
        return cls._from_groups(read, interfaces, regions, **options)

    @classmethod
    def from_outline(
        cls,
        comm: MPI.Comm,
        outline: str | Path | Any,
        *,
        interfaces: Mapping[str, Predicate | Bore | Box | str],
        size: float,
        unit: str | None = None,
        layers: Sequence[str] | None = None,
        inside: Sequence[float] | None = None,
        gap: float | None = None,
        solid: Predicate | None = None,
        void: Predicate | None = None,
        order: int = 1,
        centers: Mapping[str, Sequence[float]] | None = None,
        solid_rim: float = 0.0,
    ) -> Domain:
        """Mesh a closed outline, with holes or without, by triangles.

        Args:
            comm: Communicator over which the mesh is distributed; rank 0 reads and meshes.
            outline: A .dxf file, rings of points (n, 2), or polygons of shapely. Lines, arcs and
                splines stay what they are. A ring may be a list of pieces (n, 2) that follow each
                other: two points are a line, three an arc of the circle through them, more a cubic
                spline.
            interfaces: For each name the layer of its curves, a point in it,
                ``ffr.fem.Bore(at=(x, y))``, the box that it lies in, ``ffr.fem.Box``, or a
                predicate as for `Domain`. A curve on a boundary that is drawn already only names
                it.
            size: Size of the triangles [m].
            unit: Of the outline, "mm", "cm", "m" or "in"; by default that of the file, or metres.
            layers: Of a file, those of the outline; layers that name interfaces count, too. By
                default all. Curves of line types with gaps (CENTER, HIDDEN) never do.
            inside: Of several parts on a sheet that around this point, which is in its material
                [m]; curves that do not meet the part are left out.
            gap: Loose ends nearer to each other than this are joined [m]; by default a ten
                thousandth of the drawing's extent.
            solid: Cells that stay solid, a predicate.
            void: Cells that stay void, a predicate.
            order: Polynomial order of the displacements; cells at curves are curved from 2 on.
            centers: Reference points of interfaces [m]; by default as described for `Domain`.
            solid_rim: Width of a rim along each interface that stays solid [m], at least half the
                size of triangles, 0 for none. Its edge is meshed as a circle around a round bore,
                and as the offset curve of any other interface, so its cells are the rim.

        Raises:
            FileNotFoundError: If there is no such file.
            ValueError: If curves are open, cross or touch, a layer or id is not there, the file
                does not say its unit, the triangles are larger than the outline or more than can be
                made in minutes, or the mesh does not suit `Domain`.

        Warns:
            UserWarning: If the triangles are larger than the outline is across.
        """
        places = validation.by_name("from_outline: interfaces", interfaces, "predicates or layers")
        degree = min(validation.integer("from_outline: order", order, least=1), 2)
        sheet = Sheet(unit, layers, inside, gap)
        read, facets = mesh_outline(comm, outline, places, size, sheet, degree, solid_rim)
        stays = located_cells(read.mesh, "domain: solid", solid)
        rims = read.cells.get("solid", np.zeros(0, dtype=np.int32))
        stays[rims[rims < len(stays)]] = True
        options = {"void": void, "order": order, "centers": centers}
        by_name: dict[str, Any] = {**places, **facets}
        body = cls(read.mesh, by_name, stays, **options)  # type: ignore[arg-type]
        refuse_whole_edge(body.mesh, body.interfaces)
        return body

    @classmethod
    def _from_groups(
        cls,
        read: GroupedMesh,
        interfaces: Sequence[str | int],
        regions: dict[str, Sequence[str | int] | Predicate | None],
        **options: Any,
    ) -> Domain:
        facets = read.facets_of("interfaces", interfaces)
        for name, region in regions.items():
            default = [name] if name in read.cells else []
            groups = default if region is None else region
            options[name] = groups if callable(groups) else read.cells_of(name, groups)
        body = cls(read.mesh, facets, **options)
        refuse_whole_edge(body.mesh, body.interfaces)
        return body

    # ------------------------------------------------------------------ copies

    def __reduce__(self) -> NoReturn:
        """Refuse `pickle` and `copy.deepcopy`, for everything that holds a mesh."""
        raise TypeError(
            "a Domain, and the Problem, body, design or Result that holds one, cannot be pickled "
            "or copied; make it anew in the other process, from densities and an Evaluation"
        )

    def with_center(self, name: str, center: Array) -> Domain:
        """The same domain with the ``center`` (dimension,) [m] of the interface ``name``."""
        domain: Domain = object.__new__(type(self))
        moved = replace(self.interfaces[name], center=center)
        vars(domain).update(vars(self), interfaces={**self.interfaces, name: moved})
        return domain

    # ------------------------------------------------------------------ geometry

    @cached_property
    def cell_volumes(self) -> Array:
        """Area of each cell owned by this rank, in space volume, shape (cells,) [m^2], [m^3]."""
        test = ufl.TestFunction(self.density_space)
        form = fem.form(test * ufl.dx(domain=self.mesh))
        return np.array(fem.assemble_vector(form).array[: self.n_cells])

    @cached_property
    def centroids(self) -> Array:
        """Centroid of each cell owned by this rank, shape (cells, dimension) [m]."""
        points, weights = self.quadrature_points(2)
        return np.einsum("cqd,cq->cd", points, weights)

    @cached_property
    def bounding_box(self) -> Array:
        """Lower and upper corner of the body, shape (2, dimension) [m], the same on every rank."""
        x = self.mesh.geometry.x[:, : self.dimension]
        box = np.empty((2, self.dimension))
        self.comm.Allreduce(np.min(x, axis=0, initial=np.inf), box[0], MPI.MIN)
        self.comm.Allreduce(np.max(x, axis=0, initial=-np.inf), box[1], MPI.MAX)
        return box

    @cached_property
    def outline(self) -> shapely.Geometry:
        """What a body in the plane covers, the void region left out, as polygons [m].

        It is the limit that no part of the body crosses, the same on every rank.
        """
        return self._drawn_outline.difference(self._void_polygons)

    @cached_property
    def holes(self) -> Sequence[FlatHole | SpatialHole]:
        """The holes of the body's drawing, with a name or without, on every rank.

        In the plane a hole is what a closed inner line of the outline surrounds. In space it is
        what is such a hole in a plane section: bores, slots, pockets and cavities of any shape,
        through or blind; the gap of a fork and a groove with an open side are no holes.
        """
        if self.dimension == 3:
            return holes_in_space(self.mesh, self.cell_size)
        return flat_holes(self._drawn_outline)

    @cached_property
    def _drawn_outline(self) -> shapely.Geometry:
        return flat_outline(self.mesh)

    @property
    def _void_polygons(self) -> shapely.Geometry:
        order = [0, 1, 2] if self.cell == "triangle" else [0, 1, 3, 2]
        nodes = _compat.cell_geometry(self.mesh)[: self.n_cells, order]
        corners = self.everywhere(self.mesh.geometry.x[nodes][:, :, :2])
        return shapely.union_all(shapely.polygons(corners[self.everywhere(self.void_cells)]))

    @property
    def area(self) -> float:
        """Area of the whole body, in space its volume [m^2], [m^3]; the same on every rank."""
        return self.sum(self.cell_volumes)

    @property
    def cell_size(self) -> float:
        """Edge of a square or a cube as large as a mean cell [m], the same on every rank."""
        return float((self.area / self.n_cells_global) ** (1.0 / self.dimension))

    @cached_property
    def cell_edges(self) -> Array:
        """Mean edges of hexahedra along their own axes, shape (3,) [m], the same on every rank.

        All of them are `cell_size` where the axes of one cell are not those of the next.
        """
        # corners of a hexahedron are numbered by bits, one for each axis: (axes, 4 edges, 2 ends)
        edges_of_axis = [[(i, i | 1 << k) for i in range(8) if not i >> k & 1] for k in range(3)]
        corners = _compat.cell_geometry(self.mesh)[: self.n_cells, :8]
        number = np.asarray(self.mesh.geometry.input_global_indices, dtype=np.int64)
        cells = self.on_rank_0(number[corners])

        def axes_agree() -> bool:
            """Whether each edge is along the same axis of all its cells."""
            edges = np.sort(cells[:, edges_of_axis], axis=3)  # (cells, axes, 4, 2)
            axis = np.broadcast_to(np.arange(3)[:, None, None], (*edges.shape[:3], 1))
            with_axis = np.unique(np.concatenate([edges, axis], axis=3).reshape(-1, 3), axis=0)
            # an edge along two axes stands there twice
            return len(with_axis) == len(np.unique(with_axis[:, :2], axis=0))

        if not on_rank_0(self.comm, axes_agree):
            return np.full(3, self.cell_size)

        ends = self.mesh.geometry.x[corners][:, edges_of_axis]
        length = np.linalg.norm(ends[..., 1, :] - ends[..., 0, :], axis=-1).mean(axis=2)
        return np.array([self.sum(lengths) for lengths in length.T]) / self.n_cells_global

    def sum(self, values: Array) -> float:
        """The sum of ``values`` over all ranks, bit-identical on every rank."""
        return float(sum(gathered(self.comm, "a sum over the cells", float(np.sum(values)))))

    def everywhere(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values of all cells on every rank, in the order in which the mesh was made.

        The ``values`` are those of the cells owned by this rank, shape (cells, ...).
        """
        of_ranks = gathered(self.comm, "the values of all cells", np.asarray(values))
        return np.asarray(np.concatenate(of_ranks)[self._order[0]])

    def owned(self, values: NDArray[Any]) -> NDArray[Any]:
        """This rank's own part of the ``values`` of all cells, the inverse of `everywhere`."""
        return np.asarray(values[self._order[1]])

    def on_rank_0(self, values: NDArray[Any]) -> NDArray[Any]:
        """The ``values`` of the cells as of `everywhere`, but on rank 0 alone; none elsewhere."""
        order, sent = self._order[0], self.comm.gather(values)
        return values[:0] if sent is None else np.concatenate(sent)[order]

    def on_cells(self, block: Array) -> Array:
        """A ``block`` (dofs of this rank, columns) by cells: (cells, nodes, dimension, columns)."""
        nodes, field = _compat.dofmap_array(self.space)[: self.n_cells], fem.Function(self.space)
        values = np.empty((*nodes.shape, self.dimension, block.shape[1]))
        for i, column in enumerate(block.T):
            field.x.array[: len(column)] = column
            field.x.scatter_forward()
            values[..., i] = field.x.array.reshape(-1, self.dimension)[nodes]
        return values

    @cached_property
    def _order(self) -> tuple[Integers, Integers]:
        """Positions of all cells among those gathered from the ranks, and of this rank's cells."""
        number = np.asarray(self.mesh.topology.original_cell_index)[: self.n_cells]
        of_ranks = self.comm.allgather(number)
        order = np.argsort(np.concatenate(of_ranks), kind="stable")
        first_cell = sum(map(len, of_ranks[: self.comm.rank]))
        return order, np.argsort(order)[first_cell : first_cell + self.n_cells]

    def quadrature_points(self, n: int) -> tuple[Array, Array]:
        """Points in each cell of this rank with weights that average over the cell.

        There are ``n`` points in each direction (triangles, tetrahedra: a rule of degree 2 n - 1).
        Points are of shape (cells, q, dimension) [m]; weights (cells, q) sum to 1 in each cell.
        """
        n = validation.integer("quadrature points: n", n, least=1)
        _, points, volumes = quadrature(self, 2 * n - 1)
        return points, volumes / volumes.sum(axis=1, keepdims=True)

    # ------------------------------------------------------------------ densities

    @cached_property
    def passive_density(self) -> Array:
        """Density of the cells that are not designed, shape (cells,): 1 solid, 0 void.

        It has zeros for designed cells. A density of the whole body is
        ``numpy.where(domain.design_cells, x, domain.passive_density)``.
        """
        return self.solid_cells.astype(np.float64)

    def check_density(self, x: ArrayLike, name: str = "density") -> Array:
        """``x`` as an array, or raise an error that calls it ``name``.

        There is one density for each cell owned by this rank, shape (cells,), in [0, 1]; a value
        that leaves it by round-off is taken as 0 or 1.

        Raises:
            ValueError: If the size is wrong, or a value is NaN or outside [0, 1].
        """
        with on_every_rank(self.comm, f"the check of the {name}"):
            array = validation.numbers(name, x)
            if array.shape != (self.n_cells,):
                raise ValueError(
                    f"{name}: has shape {array.shape} on rank {self.comm.rank}, expected "
                    f"({self.n_cells},), one value for each cell owned by the rank; start from "
                    "numpy.ones(domain.n_cells)"
                )
        bad = int(self.comm.allreduce(int(np.count_nonzero(~np.isfinite(array)))))
        if bad:
            raise ValueError(f"{name}: {bad} of {self.n_cells_global} values are NaN or infinite")
        low = self.comm.allreduce(float(np.min(array, initial=np.inf)), MPI.MIN)
        high = self.comm.allreduce(float(np.max(array, initial=-np.inf)), MPI.MAX)
        if low < -DOMAIN.round_off or high > 1.0 + DOMAIN.round_off:
            raise ValueError(
                f"{name}: values from {low:.6g} to {high:.6g} leave [0, 1]; clip them first"
            )
        return array if low >= 0.0 and high <= 1.0 else np.clip(array, 0.0, 1.0)

    def _anywhere(self, condition: Any) -> bool:
        return bool(self.comm.allreduce(bool(condition), MPI.LOR))

    def _check_passive(self) -> None:
        """Refuse regions that overlap or leave nothing, and void that cuts off parts of a body."""
        overlap = int(
            self.comm.allreduce(int(np.count_nonzero(self.solid_cells & self.void_cells)))
        )
        if overlap:
            raise ValueError(
                f"domain: {overlap} cells are in the solid region and in the void region; take "
                "them out of one region"
            )
        if not self._anywhere(np.any(self.design_cells)):
            raise ValueError(
                "domain: all cells are solid or void, nothing is left to design; make the solid "
                "region or the void one smaller"
            )
        if not self._anywhere(np.any(self.void_cells)):
            return
        void = self._with_ghosts(self.void_cells)
        for name in self._not_along(~void):
            raise ValueError(
                f"interface {name!r} lies on void cells only: nothing joins it to the body; "
                "leave cells along it out of the void region"
            )
        check_held(self.mesh, [interface.facets for interface in self.interfaces.values()], void)

    @property
    def designed_interfaces(self) -> list[str]:
        """Interfaces along which no cell stays solid: a design may empty them."""
        return self._not_along(self._with_ghosts(self.solid_cells))

    def on_hole(self, name: str) -> bool:
        """Whether the interface ``name`` lies on a hole of the body's drawing."""
        points = facet_points(self.mesh, self.interfaces[name].facets)
        tolerance = DOMAIN.on_hole * float(np.max(np.ptp(self.bounding_box, axis=0)))
        return any(np.max(hole.distance(points)) < tolerance for hole in self.holes)

    def _rim(self, width: float) -> Mask:
        """Cells of this rank that reach within a width of the interfaces, shape (cells,)."""
        width = validation.number("domain: solid_rim", width, least=self.cell_size, unit="m")
        facets = [
            facet_nodes(self.mesh, interface.facets) for interface in self.interfaces.values()
        ]
        x, d = self.mesh.geometry.x[:, : self.dimension], self.dimension
        # points amid the sides of a facet, too, as it is no farther than its nodes
        points = [x[facet_corners] for facet_corners in facets]
        points += [
            0.5 * (facet_corners + np.roll(facet_corners, 1, axis=1)) for facet_corners in points
        ]
        points_of_rank = np.concatenate([facet_corners.reshape(-1, d) for facet_corners in points])
        distance = cKDTree(np.vstack(self.comm.allgather(points_of_rank))).query(x)[0]
        corners = _compat.cell_geometry(self.mesh)[: self.n_cells]
        return np.asarray(np.any(distance[corners] < (1.0 - DOMAIN.on_rim) * width, axis=1))

    def _with_ghosts(self, cells: Mask) -> Mask:
        """A mask over this rank's cells, extended to ghosts."""
        marked = fem.Function(self.density_space)
        marked.x.array[: self.n_cells] = cells
        marked.x.scatter_forward()
        return np.asarray(marked.x.array > 0.5)

    def _not_along(self, cells: Mask) -> list[str]:
        """Interfaces along which none of the cells is, ghosts included."""
        cells_of = self.mesh.topology.connectivity(self.dimension - 1, self.dimension)
        return [
            name
            for name, interface in self.interfaces.items()
            if not self._anywhere(any(cells[cells_of.links(f)[0]] for f in interface.facets))
        ]


def quadrature(domain: Domain, degree: int) -> tuple[tuple[Array, Array], Array, Array]:
    """The quadrature rule of a ``degree`` in all cells of this rank.

    Returns:
        Points (q, d) and weights (q,) of the reference cell; the points in the cells, shape
        (cells, q, d) [m]; and their weights, areas or volumes of shape (cells, q) [m^2], [m^3].
    """
    cell_type = getattr(basix.CellType, domain.cell)
    points, weights = map(np.asarray, basix.make_quadrature(cell_type, degree))
    cells = np.arange(domain.n_cells, dtype=np.int32)
    positions, jacobian = (
        _compat.compiled_expression(expression(domain.mesh), points, domain.mesh)(cells)
        for expression in (ufl.SpatialCoordinate, ufl.JacobianDeterminant)
    )
    return (points, weights), positions, weights * np.abs(jacobian[:, :, 0])
