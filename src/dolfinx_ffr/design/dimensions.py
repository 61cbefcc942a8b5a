# SPDX-License-Identifier: MIT
"""Bodies by named dimensions: a user's function gives their outline, or a model of gmsh."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, ClassVar

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..fem import (
    Array,
    Domain,
    closed_outline,
    gathered_nodes,
    gmsh_model,
    quiet,
    read_outline,
    surfaces,
)
from ..parallel import on_every_rank, on_rank_0
from .node_motion import DimensionMotion, NodesOnGeometry, extended, outer_facets
from .parametrization import Variables

#: Change of a dimension for differences of the geometry, as share of its range
_STEP = 1e-5
#: Motion by such a change, in sizes of the body, beyond which curves are taken for exchanged
_JUMP = 1e-2
#: Share of the range within which a dimension stands at a bound
_AT = 1e-3


class DimensionDesign(Variables):
    """Named dimensions of one body, each between two bounds, as design variables.

    Widths, radii, positions of holes, the place of a bearing. The derivative by a dimension is that
    by the nodes of the mesh and the centers of interfaces, which move with the geometry; only the
    geometry itself is differentiated by differences.

    Args:
        shape: A function of a mapping from names to numbers. In the plane it returns a mapping of
            what `Domain.from_outline` takes: ``outline`` (rings, or rings of pieces, or polygons)
            and ``interfaces``, and where wanted ``centers``, ``solid``, ``void``. Or a function of
            that mapping and ``gmsh.model`` on rank 0, which builds a geometry there with physical
            groups, in the plane or in space, and makes no mesh. It must have as many curves and
            faces for all values; values for which it has not, or raises, are not taken.
        dimensions: Lower and upper bound by name, lower < upper.
        size: Of the triangles or tetrahedra [m].
        start: Values at the start by name; by default the middles between the bounds.
        order: Polynomial order of the displacements.
        interfaces: With ``gmsh.model`` the names of the physical groups that are interfaces.

    Raises:
        TypeError: If an argument is of a wrong kind.
        ValueError: If a bound is not finite or not below the other, or a start is outside.
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
        every = [
            validation.real_array(f"dimensions: {n!r}", pair, (2,), expected="two bounds")
            for n, pair in bounds.items()
        ]
        self.lower, self.upper = np.array(every).T  # type: ignore[assignment]
        for name, (low, high) in zip(self.names, every, strict=True):
            if not (np.isfinite(low) and low < high < np.inf):
                raise ValueError(
                    f"dimensions: {name!r} is between {low:.6g} and {high:.6g}; give two finite "
                    "bounds, the lower one first"
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
        """The dimensions by name, of ``variables`` (size,)."""
        return dict(zip(self.names, np.asarray(variables, dtype=float).tolist(), strict=True))

    def variables(self, values: Mapping[str, float], others: Array | None = None) -> Array:
        """The variables, shape (size,), of ``values`` by name.

        Those that are not named have the values of ``others``, by default of the start. A
        ValueError if a name is not known, or a value is not within its bounds.
        """
        found = np.array(self._start if others is None else others)
        for name, value in values.items():
            i = self.names.index(validation.choice("dimensions: name", name, self.names))
            low, high = np.asarray(self.lower)[i], np.asarray(self.upper)[i]
            found[i] = validation.number(f"dimensions: {name!r}", value, least=low, most=high)
        return found

    def even(self, value: float | None = None) -> Array:  # type: ignore[override]
        """The variables of the start, shape (size,); or all at a share ``value`` of their range."""
        return self._start.copy() if value is None else super().even(value)

    def at_bounds(self, variables: ArrayLike) -> dict[str, str]:
        """Which dimensions of ``variables`` (size,) stand at a bound: "lower" or "upper"."""
        share = (np.asarray(variables) - self.lower) / (np.asarray(self.upper) - self.lower)
        ends = zip(self.names, share < _AT, share > 1.0 - _AT, strict=True)
        return {n: "lower" if low else "upper" for n, low, high in ends if low or high}

    def identity(self) -> dict[str, Any]:
        bounds = np.concatenate([np.asarray(self.lower), np.asarray(self.upper)])
        return {"dimensions": str(self.names), "bounds": bounds}

    # ------------------------------------------------------------------ geometry and meshes

    def domain(self, comm: MPI.Comm, variables: ArrayLike | None = None) -> Domain:
        """The body at ``variables`` (size,), by default those of the start; collective.

        Raises:
            ValueError: On every rank, if there is no valid geometry, it has another number of
                curves or faces than the first one had, or it cannot be meshed.
        """
        x = self._start if variables is None else np.asarray(variables, dtype=np.float64)
        with self._explained(comm, x):
            if self._drawn:
                with on_every_rank(comm, "the outline of dimensions"):
                    given = self._given(x)
                on_rank_0(comm, lambda: self._check(x))
                return Domain.from_outline(comm, **given, size=self._length, order=self._order)
            with ExitStack() as stack:
                model = on_rank_0_only(comm, lambda: self._meshed(stack, x))
                interfaces = self._interfaces
                return Domain.from_gmsh_model(
                    comm, model, interfaces=interfaces, order=self._order
                )

    def motion(self, domain: Domain, variables: Array) -> DimensionMotion:
        """How the nodes of the ``domain`` of these ``variables`` move with them; collective."""
        comm = domain.comm
        x, cells, (numbers, own) = gathered_nodes(domain)
        with self._explained(comm, variables):
            rates = on_rank_0(comm, lambda: self._rates(x, cells, variables))
            here = rates[numbers]
            centers = self._center_rates(comm, variables)
        found = []
        for name, part in domain.interfaces.items():
            given = centers.get(name)
            found.append(part.center_rates(domain.mesh, here) if given is None else given)
        return DimensionMotion(comm, here * own[:, None, None], np.array(found))

    @contextmanager
    def _explained(self, comm: MPI.Comm, variables: Array) -> Iterator[None]:
        """Errors of the user's function and of gmsh name the dimensions; on every rank."""
        try:
            with on_every_rank(comm, "a geometry of dimensions"):
                yield
        except Exception as error:  # gmsh raises nothing more precise, and users' functions do
            where = ", ".join(f"{n} = {v:.6g}" for n, v in self.named(variables).items())
            raise ValueError(f"dimensions: no body with {where}: {error}") from error

    def _given(self, variables: Array) -> dict[str, Any]:
        """What the user's function returns for an outline."""
        given = self._shape(self.named(variables))
        needed = "a mapping with 'outline' and 'interfaces'"
        validation.instance("dimensions: shape(...)", given, Mapping, needed)
        known = ("outline", "interfaces", "centers", "solid", "void", "unit")
        for name in given:
            validation.choice("dimensions: shape(...)", name, known)
        if not {"outline", "interfaces"} <= set(given):
            raise ValueError(f"dimensions: shape(...) returns {sorted(given)}; return {needed}")
        return dict(given)

    def _built(self, gmsh: Any, variables: Array) -> Any:
        """The geometry in gmsh's current model, and its numbers of curves and faces; on rank 0."""
        if self._drawn:
            given = self._given(variables)
            layers = [where for where in given["interfaces"].values() if isinstance(where, str)]
            drawn = read_outline(given["outline"], given.get("unit"))
            surfaces(gmsh, closed_outline("outline", drawn, layers))
        else:
            with quiet():
                self._shape(self.named(variables), gmsh.model)
                gmsh.model.occ.synchronize()
        model = gmsh.model
        groups = [(d, model.getPhysicalName(d, tag)) for d, tag in model.getPhysicalGroups()]
        parts = [len(model.getEntitiesForPhysicalGroup(*g)) for g in model.getPhysicalGroups()]
        counts = [len(model.getEntities(d)) for d in range(4)]
        return counts, sorted(zip(groups, parts, strict=True))

    def _check(self, variables: Array, gmsh: Any = None) -> None:
        """Build the geometry, and refuse another topology than that of the first one."""
        with ExitStack() as stack:
            found = self._built(gmsh or stack.enter_context(gmsh_model()), variables)
        if self._topology is None:
            self._topology = found
        if found != self._topology:
            raise ValueError(
                f"the geometry has {found[0][1]} curves and {found[0][2]} faces, and not the "
                f"{self._topology[0][1]} and {self._topology[0][2]} of the first one, or other "
                "physical groups: keep the topology, or narrow the bounds"
            )

    def _meshed(self, stack: ExitStack, variables: Array) -> Any:
        """gmsh's model with a mesh, until the stack ends; on rank 0."""
        gmsh = stack.enter_context(gmsh_model("dimensions need"))
        self._check(variables, gmsh)
        before = gmsh.option.getNumber("Mesh.MeshSizeMax")
        stack.callback(gmsh.option.setNumber, "Mesh.MeshSizeMax", before)
        gmsh.option.setNumber("Mesh.MeshSizeMax", self._length)
        with quiet():
            gmsh.model.mesh.generate(gmsh.model.getDimension())
        gmsh.model.mesh.renumberNodes()
        return gmsh.model

    def _rates(self, x: Array, cells: Any, variables: Array) -> Array:
        """Motion of all nodes by each dimension, (nodes, dimension, k); on rank 0."""
        d, size = x.shape[1], float(np.max(np.ptp(x, axis=0)))
        outer = np.unique(outer_facets(cells[:, : d + 1]))
        rates, known = np.zeros((len(x), d, self.size)), np.zeros(len(x), dtype=bool)
        with gmsh_model("dimensions need") as gmsh:
            self._check(variables, gmsh)
            on = NodesOnGeometry(gmsh.model, x, np.union1d(outer, cells[:, d + 1 :]))
            faces = on.on_faces(gmsh.model) if d == 3 else None
        nodes = on.nodes
        known[nodes] = True
        if not np.all(known[outer]):
            raise ValueError("the nodes of the mesh do not lie on its geometry")
        for k, (ends, steps) in enumerate(map(self._beside, [variables] * self.size, range(self.size))):
            places = []
            for end in ends:
                with gmsh_model() as gmsh:
                    self._check(end, gmsh)
                    places.append(on.positions(gmsh.model))
            change = places[0] - places[1]
            if np.max(np.abs(change), initial=0.0) > _JUMP * size:
                raise ValueError(
                    f"curves or faces are exchanged by a small change of {self.names[k]!r}: build "
                    "them in the same order for all values"
                )
            rates[nodes, :, k] = change / steps
        return extended(x, cells, rates, known, faces)

    def _beside(self, variables: Array, k: int) -> tuple[list[Array], float]:
        """Variables on both sides in dimension k, and how far apart these are."""
        step = _STEP * float(np.asarray(self.upper)[k] - np.asarray(self.lower)[k])
        ends = [variables + side * step * np.eye(self.size)[k] for side in (1.0, -1.0)]
        return ends, 2.0 * step

    def _center_rates(self, comm: MPI.Comm, variables: Array) -> dict[str, Array]:
        """Motion (dimension, k) of the centers that the user's function gives, by interface."""
        if not self._drawn or not (given := self._given(variables).get("centers")):
            return {}
        found = {name: np.zeros((len(center), self.size)) for name, center in given.items()}
        for k in range(self.size):
            ends, apart = self._beside(variables, k)
            one, other = (self._given(end)["centers"] for end in ends)
            for name, rate in found.items():
                rate[:, k] = (np.asarray(one[name]) - np.asarray(other[name])) / apart
        return found


def on_rank_0_only(comm: MPI.Comm, action: Callable[[], Any]) -> Any:
    """What ``action`` returns on rank 0, None elsewhere; an error of it is raised on every rank."""
    found = None
    with on_every_rank(comm, "a geometry of dimensions"):
        if comm.rank == 0:
            found = action()
    return found
