# SPDX-License-Identifier: MIT
"""Bodies by named dimensions: a user's function gives their outline, or a model of gmsh."""

from __future__ import annotations

import inspect
import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from mpi4py import MPI

import basix
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu

from .. import validation
from ..arrays import Integers, Mask
from ..fem import (
    Array,
    Domain,
    Drawing,
    ShapeError,
    built_on_rank_0,
    closed_outline,
    gathered_nodes,
    gmsh_model,
    gmsh_options,
    laplace,
    quiet,
    read_outline,
    surfaces,
)
from ..limits import check_count
from ..parallel import on_every_rank, on_rank_0
from .base import Variables

#: Change of a dimension for differences of the geometry, as a part of its range
_STEP = 1e-5
#: Digits to which a dimension is rounded, as a part of its range: the step is a multiple of them
_DIGITS = 8
#: Largest motion by such a step, in sizes of the body; curves that move farther have been exchanged
_JUMP = 1e-2
#: Part of its range within which a dimension stands at a bound
_AT_BOUND = 1e-3
#: Largest distance of a node from a curve or face on which it lies, in sizes of the body
_ON = 1e-7


class NodesOnGeometry:
    """The nodes of a mesh that lie on points, curves and faces of a gmsh model; made on rank 0.

    While the model changes, their parameters are constant shares of the range of the curve or face.
    Nodes within a face move across it with the face, and along it by Laplace's equation from its
    edges; all other vertices follow by Laplace's equation (`extended`).
    """

    def __init__(self, model: Any, x: Array, outer: Integers) -> None:
        """Find the entities on which the ``outer`` ones of the nodes ``x`` (nodes, 2 or 3) lie."""
        self.dimension = x.shape[1]
        points = np.pad(x, ((0, 0), (0, 3 - self.dimension)))
        self._near = _ON * float(np.max(np.ptp(points, axis=0)))
        #: Dimension and tag of each point, curve or face, the numbers of the nodes on it, and their
        #: shares (nodes on it, its dimension) of the ranges of its parameters
        self._entities: list[tuple[int, int, Integers, Array]] = []
        unplaced = np.zeros(len(x), dtype=bool)
        unplaced[outer] = True
        for dim, tag in model.getEntities():  # points first
            if dim >= self.dimension:
                continue
            box = np.reshape(model.getBoundingBox(dim, tag), (2, 3))
            margin = 1e-3 * float(np.max(np.ptp(points, axis=0)))
            inside = np.all((points > box[0] - margin) & (points < box[1] + margin), axis=1)
            candidates = np.flatnonzero(unplaced & inside)
            if not len(candidates):
                continue
            shares = np.zeros((len(candidates), dim))
            if dim:
                low, width = _range(model, dim, tag)
                parameters = model.getParametrization(dim, tag, points[candidates].ravel())
                shares = (np.reshape(parameters, (-1, dim)) - low) / width
            positions = _at(model, dim, tag, shares)
            is_on = np.linalg.norm(positions - points[candidates], axis=1) < self._near
            unplaced[candidates[is_on]] = False
            self._entities.append((dim, tag, candidates[is_on], shares[is_on]))

    @property
    def nodes(self) -> Integers:
        """The numbers of the nodes on the geometry, in the order of `positions`."""
        return np.concatenate([nodes for _, _, nodes, _ in self._entities]).astype(np.int64)

    def positions(self, model: Any) -> Array:
        """Positions of `nodes` in a ``model`` of the same topology, (nodes there, 2 or 3) [m]."""
        positions = [_at(model, dim, tag, shares) for dim, tag, _, shares in self._entities]
        return np.concatenate(positions)[:, : self.dimension]

    def on_faces(self, model: Any) -> tuple[Integers, Array]:
        """Numbers of the nodes on faces of a body in space, and unit normals there (nodes, 3)."""
        nodes, normals = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))]
        for dim, tag, on_face, shares in self._entities:
            if dim == 2 and len(on_face):
                low, width = _range(model, dim, tag)
                nodes.append(on_face)
                normals.append(
                    np.reshape(model.getNormal(tag, (low + shares * width).ravel()), (-1, 3))
                )
        return np.concatenate(nodes), np.concatenate(normals)


def _range(model: Any, dim: int, tag: int) -> tuple[Array, Array]:
    """The lowest parameters of a curve or face, and the extents of their ranges, (dim,) each."""
    low, high = (np.asarray(bound) for bound in model.getParametrizationBounds(dim, tag))
    return low, high - low


def _at(model: Any, dim: int, tag: int, shares: Array) -> Array:
    """Points (n, 3) at shares (n, dim) of the parameters [m]."""
    if not dim:
        return np.tile(model.getValue(0, tag, []), (len(shares), 1))
    low, width = _range(model, dim, tag)
    return np.reshape(model.getValue(dim, tag, (low + shares * width).ravel()), (-1, 3))


def extended(
    x: Array,
    cells: Integers,
    rates: Array,
    known: Mask,
    faces: tuple[Integers, Array] | None,
) -> Array:
    """Extend the motions ``rates`` (nodes, dimension, k) of ``known`` nodes to all nodes.

    In space ``faces`` are the nodes on faces and the normals there: of the ``rates`` of these nodes
    only the components across the faces count.
    """
    d = x.shape[1]
    corners, rates, known = cells[:, : d + 1], rates.copy(), known.copy()
    outer = outer_facets(corners)
    if faces is not None:
        nodes, normals = faces
        across = np.einsum("ni,nik->nk", normals, rates[nodes])
        known[nodes] = False
        known[np.setdiff1d(np.unique(outer), np.union1d(nodes, np.flatnonzero(known)))] = True
        _fill(x, outer, rates, known)
        across -= np.einsum("ni,nik->nk", normals, rates[nodes])
        rates[nodes] += normals[:, :, None] * across[:, None, :]
    known[np.unique(outer)] = True
    _fill(x, corners, rates, known)
    kind = basix.CellType.triangle if d == 2 else basix.CellType.tetrahedron
    sides = basix.topology(kind)[1]
    for local in range(d + 1, cells.shape[1]):  # middles of sides
        middle = cells[:, local]
        is_unknown = ~known[middle]
        ends = cells[:, sides[local - d - 1]]
        rates[middle[is_unknown]] = rates[ends[is_unknown]].mean(axis=1)
    return rates


def _fill(x: Array, simplices: Integers, rates: Array, known: Mask) -> None:
    """Give the unknown vertices of simplices rates by Laplace's equation, in place."""
    vertices = np.unique(simplices)
    free, known_vertices = vertices[~known[vertices]], vertices[known[vertices]]
    if len(free):
        matrix: csr_matrix = laplace(x, simplices)
        known_rates = rates[known_vertices].reshape(len(known_vertices), -1)
        load = matrix[free][:, known_vertices] @ known_rates
        solution = splu(matrix[free][:, free].tocsc()).solve(-load)
        rates[free] = solution.reshape(len(free), *rates.shape[1:])
        known[free] = True


def outer_facets(corners: Integers) -> Integers:
    """The facets, by their vertices, that belong to one simplex alone."""
    n = corners.shape[1]
    facets = np.concatenate([np.delete(corners, i, axis=1) for i in range(n)])
    _, first_index, count = np.unique(
        np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True
    )
    return facets[first_index[count == 1]]


@dataclass(frozen=True, eq=False)
class DimensionMotion:
    """Rates of the nodes and centers of a domain by each dimension."""

    comm: MPI.Comm
    nodes: Array  #: For each node of this rank, zero for ghosts, shape (nodes, dimension, k)
    centers: Array  #: Of interfaces, on every rank, shape (interfaces, dimension, k)

    def pullback(self, nodes: Array, centers: Array) -> Array:
        """Pull derivatives by nodes and centers back to the dimensions, (k,), on every rank."""
        through_nodes = np.einsum("nd,ndk->k", nodes, self.nodes)
        through_centers = np.einsum("id,idk->k", centers, self.centers)
        return np.asarray(sum(self.comm.allgather(through_nodes)) + through_centers)


class DimensionDesign(Variables):
    """Named dimensions of one body, each between two bounds, as design variables.

    Examples are widths, radii, positions of holes and the place of a bearing. The derivative by a
    dimension follows exactly from derivatives by the nodes of the mesh and the centers of
    interfaces; only their motion with the geometry is found by differences.

    Args:
        shape: A function of a mapping from names to numbers. In the plane it returns a mapping of
            arguments of `Domain.from_outline`: ``outline`` (rings or polygons), ``interfaces``
            (predicates), and optionally ``centers``. Or it is a function of that mapping and
            ``gmsh.model`` on rank 0, which builds a geometry there by ``model.occ``, in the plane
            or in space, names its physical groups, and makes no mesh. An optimiser rejects values
            for which it raises, or for which the number of curves or faces changes.
        dimensions: Lower and upper bound by name, lower < upper.
        size: Size of the triangles or tetrahedra [m].
        start: Values at the start by name; by default the middles between the bounds.
        order: Polynomial order of the displacements.
        interfaces: Names of the physical groups that are interfaces, with ``gmsh.model``.
    """

    each: ClassVar[str] = "dimension"

    def __init__(
        self,
        shape: Callable[..., Any],
        dimensions: Mapping[str, tuple[float, float]],
        *,
        size: float,
        start: Mapping[str, float] | None = None,
        order: int = 1,
        interfaces: Sequence[str] = ("left", "right"),
    ) -> None:
        validation.function("dimensions: shape", shape, "the dimensions")
        bounds = validation.by_name("dimensions: dimensions", dimensions, "pairs of bounds")
        if not bounds:
            raise ValueError("dimensions: none are given; give at least one, name: (lower, upper)")
        #: Their names, in the order of the variables
        self.names = [validation.name("dimensions: a name", name) for name in bounds]
        pairs = [
            validation.real_array(f"dimensions: {n!r}", pair, (2,), expected="two bounds")
            for n, pair in bounds.items()
        ]
        self.lower, self.upper = np.array(pairs).T
        for name, (low, high) in zip(self.names, pairs, strict=True):
            if not low < high:
                raise ValueError(
                    f"dimensions: {name!r} is between {low:.6g} and {high:.6g}; give two bounds, "
                    "the lower one first"
                )
        self.size = len(self.names)
        self._shape = shape
        self._drawn = len(inspect.signature(shape).parameters) < 2
        self._length = validation.number("dimensions: size", size, above=0.0, unit="m")
        self._order = validation.integer("dimensions: order", order, least=1)
        self._interfaces = validation.names("dimensions: interfaces", interfaces)
        self._start = self.variables(dict(start or {}), super().even())
        self._topology: Any = None

    # ------------------------------------------------------------------ names and numbers

    def named(self, variables: ArrayLike) -> dict[str, float]:
        """The dimensions by name, of ``variables`` (size,), rounded to 1e-8 of their ranges."""
        return dict(zip(self.names, self._rounded(variables).tolist(), strict=True))

    def _rounded(self, variables: ArrayLike) -> Array:
        """Variables rounded to `_DIGITS`, so that round-off does not change the mesh."""
        width = np.asarray(self.upper) - self.lower
        share = np.round((np.asarray(variables) - self.lower) / width, _DIGITS)
        return np.where(share == 1.0, self.upper, self.lower + share * width)

    def variables(self, values: Mapping[str, float], others: Array | None = None) -> Array:
        """The variables, shape (size,), of ``values`` by name.

        Variables that are not named have the values of ``others``, by default of the start. A
        ValueError refuses unknown names and values that are not within their bounds.
        """
        variables = np.array(self._start if others is None else others)
        for name, value in values.items():
            i = self.names.index(validation.choice("dimensions: name", name, self.names))
            low, high = np.asarray(self.lower)[i], np.asarray(self.upper)[i]
            variables[i] = validation.number(f"dimensions: {name!r}", value, least=low, most=high)
        return variables

    def even(self, value: float | None = None) -> Array:
        """The variables of the start, shape (size,); or all at a share ``value`` of their range."""
        return self._start.copy() if value is None else super().even(value)

    def at_bounds(self, variables: ArrayLike) -> dict[str, str]:
        """Which dimensions of ``variables`` (size,) stand at a bound: "lower" or "upper"."""
        share = (np.asarray(variables) - self.lower) / (np.asarray(self.upper) - self.lower)
        ends = zip(self.names, share < _AT_BOUND, share > 1.0 - _AT_BOUND, strict=True)
        return {n: "lower" if low else "upper" for n, low, high in ends if low or high}

    def identity(self) -> dict[str, Any]:
        bounds = np.concatenate([np.asarray(self.lower), np.asarray(self.upper)])
        return {"dimensions": str(self.names), "bounds": bounds}

    # ------------------------------------------------------------------ geometry and meshes

    def domain(self, comm: MPI.Comm, variables: ArrayLike | None = None) -> Domain:
        """The body at ``variables`` (size,), by default the start, over ``comm``.

        Raises:
            ValueError: If there is no valid geometry, its curves or faces are others than at the
                start, or it cannot be meshed.
        """
        x = self._start if variables is None else np.asarray(variables, dtype=np.float64)
        with self._explained(x):
            if self._drawn:
                with on_every_rank(comm, "the outline of dimensions"):
                    outline = self._outline_arguments(x)
                on_rank_0(comm, lambda: self._check(x))
                return Domain.from_outline(comm, **outline, size=self._length, order=self._order)
            options: dict[str, Any] = {"interfaces": self._interfaces, "order": self._order}
            with built_on_rank_0(comm, lambda gmsh: self._mesh(gmsh, x)) as model:
                return Domain.from_gmsh_model(comm, model, **options)

    def motion(
        self, domain: Domain, variables: Array, still: NDArray[np.int32] | None = None
    ) -> DimensionMotion:
        """Rates of the nodes of the ``domain`` of these ``variables`` by the dimensions.

        The nodes ``still`` of this rank do not move; a ValueError if they are on a boundary that
        moves.
        """
        comm = domain.comm
        x, cells, (numbers, owned) = gathered_nodes(domain)
        at_rest = np.concatenate(comm.allgather(numbers[[] if still is None else still]))
        with self._explained(variables):
            node_rates = on_rank_0(comm, lambda: self._rates(x, cells, variables, at_rest))[numbers]
            with on_every_rank(comm, "the centers of dimensions"):
                centers = self._center_rates(variables)
        center_rates = []
        for name, interface in domain.interfaces.items():
            rates = centers.get(name)
            if rates is None:
                rates = interface.center_rates(domain.mesh, node_rates)
            center_rates.append(rates)
        motion = DimensionMotion(comm, node_rates * owned[:, None, None], np.array(center_rates))
        fastest_nodes = comm.allgather(np.max(np.abs(node_rates), axis=(0, 1), initial=0.0))
        fastest_centers = np.max(np.abs(center_rates), axis=1)
        largest = np.max([*fastest_nodes, *fastest_centers], axis=0)
        rates_by_name = zip(self.names, largest, strict=True)
        if without_effect := [name for name, rate in rates_by_name if rate == 0.0]:
            warnings.warn(
                f"dimensions: {without_effect} have no influence on the body; use them in the "
                "function, or leave them out",
                stacklevel=2,
            )
        return motion

    @contextmanager
    def _explained(self, variables: Array) -> Iterator[None]:
        """A context in which errors of the user's function and of gmsh name the dimensions."""
        try:
            yield
        except Exception as error:  # gmsh raises nothing more precise, and users' functions do
            values = ", ".join(f"{n} = {v:.6g}" for n, v in self.named(variables).items())
            kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
            raise ShapeError(
                f"dimensions: no body can be made with {values}: {kind}{error}"
            ) from error

    def _outline_arguments(self, variables: Array) -> dict[str, Any]:
        """The arguments of `Domain.from_outline` that the user's function returns."""
        drawn = self._shape(self.named(variables))
        needed = "a mapping with 'outline' and 'interfaces'"
        validation.instance("dimensions: shape(...)", drawn, Mapping, needed)
        for name in drawn:
            validation.choice("dimensions: shape(...)", name, ("outline", "interfaces", "centers"))
        if not {"outline", "interfaces"} <= set(drawn):
            raise ValueError(f"dimensions: shape(...) returns {sorted(drawn)}; return {needed}")
        return dict(drawn)

    def drawing(self, variables: Array) -> Drawing | None:
        """The outline at ``variables`` (size,) with its interfaces; None of a model of gmsh."""
        if not self._drawn:
            return None
        shape = self._outline_arguments(variables)
        drawn = closed_outline("outline", read_outline(shape["outline"], None))
        groups = [""] * len(drawn.curves)
        for name, is_interface in shape["interfaces"].items():
            for i, curve in enumerate(drawn.curves):
                points = np.pad(curve.at(np.linspace(0.0, 1.0, 9)), ((0, 0), (0, 1)))
                groups[i] = name if np.all(is_interface(points.T)) else groups[i]
        return replace(drawn, groups=groups)

    def _built(self, gmsh: Any, variables: Array) -> Any:
        """The geometry in gmsh's current model, and its numbers of curves and faces; on rank 0."""
        drawing = self.drawing(variables)
        if drawing is not None:
            surfaces(gmsh, drawing)
        else:
            with quiet():
                self._shape(self.named(variables), gmsh.model)
                gmsh.model.occ.synchronize()
        model = gmsh.model
        groups = [(d, model.getPhysicalName(d, tag)) for d, tag in model.getPhysicalGroups()]
        sizes = [len(model.getEntitiesForPhysicalGroup(*g)) for g in model.getPhysicalGroups()]
        counts = [len(model.getEntities(d)) for d in range(4)]
        return counts, sorted(zip(groups, sizes, strict=True))

    def _check(self, variables: Array, gmsh: Any = None) -> None:
        """Build the geometry, and refuse a topology that differs from the start; on rank 0."""
        if self._topology is None:
            with gmsh_model() as gmsh_at_start:
                self._topology = self._built(gmsh_at_start, self._start)
        with ExitStack() as stack:
            topology = self._built(gmsh or stack.enter_context(gmsh_model()), variables)
        if topology != self._topology:
            counts = topology[0], self._topology[0]
            sizes, sizes_at_start = (f"{n[1]} curves and {n[2]} faces" for n in counts)
            raise ValueError(
                f"the geometry has {sizes}, and at the start {sizes_at_start}, or other physical "
                "groups: keep the topology for all values, or narrow the bounds"
            )

    def _mesh(self, gmsh: Any, variables: Array) -> None:
        """Build and mesh the geometry in gmsh's model, on rank 0."""
        self._check(variables, gmsh)
        self._check_count(gmsh.model)
        with gmsh_options(gmsh, {"Mesh.MeshSizeMax": self._length}), quiet():
            gmsh.model.mesh.generate(gmsh.model.getDimension())
        gmsh.model.mesh.renumberNodes()

    def _check_count(self, model: Any) -> None:
        """Refuse more cells than gmsh makes in minutes, as for dimensions in a wrong unit."""
        d = model.getDimension()
        measure = sum(model.occ.getMass(*entity) for entity in model.occ.getEntities(d))
        # equilateral triangles and regular tetrahedra
        count = (4.0 / math.sqrt(3.0), 6.0 * math.sqrt(2.0))[d - 2] * measure / self._length**d
        box = model.getBoundingBox(-1, -1)
        sides = " x ".join(f"{box[k + 3] - box[k]:.4g} m" for k in range(d))
        remedy = f"give a larger size [m], or all dimensions in metres: the body is {sides}"
        check_count("the mesh", count, f"cells of {self._length:.4g} m", remedy)

    def _rates(self, x: Array, cells: Integers, variables: Array, still: Integers) -> Array:
        """Rates of all nodes by each named dimension k, (nodes, 2 or 3, k); on rank 0.

        The mesh has the nodes ``x`` and the ``cells``; the nodes ``still`` do not move.
        """
        d, body_length = x.shape[1], float(np.max(np.ptp(x, axis=0)))
        outer = np.unique(outer_facets(cells[:, : d + 1]))
        rates, is_known = np.zeros((len(x), d, self.size)), np.zeros(len(x), dtype=bool)
        with gmsh_model() as gmsh:
            self._check(variables, gmsh)
            on_geometry = NodesOnGeometry(gmsh.model, x, np.union1d(outer, cells[:, d + 1 :]))
            faces = on_geometry.on_faces(gmsh.model) if d == 3 else None
        nodes = on_geometry.nodes
        is_known[nodes] = True
        if not np.all(is_known[outer]):
            raise ValueError("the nodes of the mesh do not lie on its geometry")
        for k in range(self.size):
            (above, below), difference = self._beside(variables, k)
            change = self._positions(on_geometry, above) - self._positions(on_geometry, below)
            if np.max(np.abs(change), initial=0.0) > _JUMP * body_length:
                raise ValueError(
                    f"curves or faces are exchanged by a small change of {self.names[k]!r}: build "
                    "them in the same order for all values"
                )
            rates[nodes, :, k] = change / difference
        if np.any(rates[still]):
            raise ValueError(
                "a marker is in a cell whose boundary moves; move the marker farther inside, or "
                "make it an interface"
            )
        is_known[still] = True
        return extended(x, cells, rates, is_known, faces)

    def _positions(self, on_geometry: NodesOnGeometry, variables: Array) -> Array:
        """Positions of the nodes on the geometry at variables, (nodes there, dimension) [m]."""
        with gmsh_model() as gmsh:
            self._check(variables, gmsh)
            return on_geometry.positions(gmsh.model)

    def _beside(self, variables: Array, k: int) -> tuple[list[Array], float]:
        """Variables above and below in dimension k, within the bounds, and their difference."""
        step, center = np.zeros(self.size), self._rounded(variables)
        step[k] = _STEP * float((np.asarray(self.upper) - self.lower)[k])
        ends = [np.clip(center + s * step, self.lower, self.upper) for s in (1.0, -1.0)]
        return ends, float(ends[0][k] - ends[1][k])

    def _center_rates(self, variables: Array) -> dict[str, Array]:
        """Rates (2, k) by the named dimensions of the user's centers, by interface."""
        if not self._drawn or not (centers := self._outline_arguments(variables).get("centers")):
            return {}
        rates = {name: np.zeros((len(center), self.size)) for name, center in centers.items()}
        for k in range(self.size):
            ends, difference = self._beside(variables, k)
            above, below = (self._outline_arguments(end)["centers"] for end in ends)
            for name, rate in rates.items():
                rate[:, k] = (np.asarray(above[name]) - np.asarray(below[name])) / difference
        return rates
