# SPDX-License-Identifier: MIT
"""Stiffness and mass of one body as functions of its density, and their derivatives.

With the density field x (one value a cell) the two bilinear forms are

    k_x(u, v) = int E(x) sigma(u) : eps(v) dX,      m_x(u, v) = int rho(x) u . v dX.

Fields of the body are handled in blocks: arrays of shape (dofs owned by this rank, columns), one
field a column.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import ArrayLike, NDArray

from .. import validation
from ..parallel import on_every_rank
from . import _compat
from .domain import Domain
from .lifetime import free_dropped, kept_by
from .material import ElasticMaterial, Interpolation

__all__ = ["Elasticity", "Matrices"]

Block = NDArray[np.float64]
#: Rows of fields that are multiplied at a time
ROWS = 4096
#: Values on the nodes of each cell, shape (cells, nodes, dimension, columns)
CellFields = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Matrices:
    """Stiffness and mass of a body at one density."""

    #: (cells,) of this rank, the same array that was given
    density: NDArray[np.float64] = field(repr=False)
    stiffness: PETSc.Mat = field(repr=False)  #: [N/m]
    mass: PETSc.Mat = field(repr=False)  #: [kg]

    def destroy(self) -> None:
        """Free the memory on all ranks together."""
        self.stiffness.destroy()
        self.mass.destroy()


class Elasticity:
    """Stiffness and mass of a body as functions of its density.

    Nothing here belongs to one density: what does is returned (`assemble`) and handed on.

    Args:
        domain: The mesh of the body.
        material: The solid.
        interpolation: Stiffness and mass between void and solid.
    """

    def __init__(
        self, domain: Domain, material: ElasticMaterial, interpolation: Interpolation
    ) -> None:
        validation.instance("body: domain", domain, Domain, "a Domain")
        needed = "an elastic material, as PlaneStress(...)"
        members = ("on", "thickness", "out_of_plane")
        validation.implementation("body: material", material, members, needed)
        check_dimension(domain, material)
        needed = "SIMP(...) or RAMP(...)"
        validation.implementation("body: interpolation", interpolation, ("on",), needed)
        self.domain = domain
        self.comm: MPI.Comm = domain.comm
        space = domain.space
        # for the argument of each method, which fills it first
        self._density = fem.Function(domain.density_space, name="density")
        # the law may be a user's
        with on_every_rank(self.comm, "an elastic body"):
            bound = material.on(domain.mesh)
            stiffness_factor, mass_factor = interpolation.on(domain.mesh, self._density)
        u, v = ufl.TrialFunction(space), ufl.TestFunction(space)

        def stiffness_density(a: ufl.core.expr.Expr, b: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
            return stiffness_factor * ufl.inner(bound.stress(a), ufl.sym(ufl.grad(b)))

        def mass_density(a: ufl.core.expr.Expr, b: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
            return mass_factor * bound.density * ufl.inner(a, b)

        # exact on affine cells; UFL's estimate would count powers of the cellwise constant density
        degree = 2 * domain.order + 2 * (_compat.coordinate_element(domain.mesh).degree - 1)
        dx = ufl.Measure("dx", domain=domain.mesh, metadata={"quadrature_degree": degree})
        self._material, self._interpolation, self._dx = material, interpolation, dx
        self._stiffness_density, self._mass_density = stiffness_density, mass_density
        with on_every_rank(self.comm, "an elastic body"):
            stiffness, mass = stiffness_density(u, v) * dx, mass_density(u, v) * dx
        self._stiffness_form, self._mass_form = fem.form(stiffness), fem.form(mass)
        # one pair of fields for the mass and one for the stiffness: compiled once, whatever the
        # number of modes
        self._fields = [fem.Function(space) for _ in range(4)]
        w, y, phi, kappa = self._fields
        pairing = (mass_density(w, y) + stiffness_density(phi, kappa)) * dx
        test = ufl.TestFunction(domain.density_space)
        self._gradient_form = fem.form(ufl.derivative(pairing, self._density, test))
        index_map = space.dofmap.index_map
        #: Displacements of a node: 2 in the plane, 3 in space
        self.dimension = domain.dimension
        #: Displacement dofs owned by this rank
        self.n_dofs = int(index_map.size_local) * self.dimension
        self.n_dofs_global = int(index_map.size_global) * self.dimension
        self._layout = (self.n_dofs, self.n_dofs_global)
        self._set_density(np.ones(domain.n_cells))
        #: An assembled matrix, whose sparsity pattern all others share
        self._pattern: list[PETSc.Mat] = kept_by(self, self.comm)
        self._pattern.append(fem.petsc.assemble_matrix(self._stiffness_form))
        self._pattern[0].assemble()
        free_dropped(self.comm)  # what bodies before this one have left

    def __reduce__(self) -> tuple[type[Elasticity], tuple[Any, ...]]:
        """How pickle and copy make it anew: forms and matrices cannot be handed on."""
        return type(self), (self.domain, self._material, self._interpolation)

    def assemble(self, density: NDArray[np.float64]) -> Matrices:
        """Stiffness and mass matrix at a density.

        Args:
            density: What `Domain.check_density` has returned, shape (cells,) of this rank; it is
                not checked again.
        """
        self._set_density(density)
        stiffness, mass = self.new_matrix(), self.new_matrix()
        for matrix, form in ((stiffness, self._stiffness_form), (mass, self._mass_form)):
            fem.petsc.assemble_matrix(matrix, form)
            matrix.assemble()
        return Matrices(density, stiffness, mass)

    def new_matrix(self) -> PETSc.Mat:
        """A matrix of zeros with the entries that `assemble` fills."""
        return self._pattern[0].duplicate(PETSc.Mat.DuplicateOption.SHARE_NONZERO_PATTERN)

    def _set_density(self, x: NDArray[np.float64]) -> None:
        self._density.x.array[: self.domain.n_cells] = x
        self._density.x.scatter_forward()

    def density_gradient(
        self, x: NDArray[np.float64], w: Block, y: Block, phi: Block, kappa: Block
    ) -> NDArray[np.float64]:
        """d/dx of sum_a m_x(w_a, y_a) + sum_i k_x(phi_i, kappa_i) at fixed fields.

        Args:
            x: One density for each cell owned by this rank, shape (cells,).
            w: Fields of the mass term, shape (dofs, a).
            y: Their partners, shape (dofs, a).
            phi: Fields of the stiffness term, shape (dofs, i), i <= a.
            kappa: Their partners, shape (dofs, i).

        Returns:
            Derivative for each cell owned by this rank, shape (cells,).
        """
        if phi.shape[1] > w.shape[1]:
            raise ValueError("density_gradient: more stiffness pairs than mass pairs")
        self._set_density(x)
        # a new vector for each pair of fields would mean new communicators
        total = np.zeros(len(self._density.x.array))
        for a in range(w.shape[1]):
            self.set(self._fields[0], w[:, a])
            self.set(self._fields[1], y[:, a])
            if a < phi.shape[1]:
                self.set(self._fields[2], phi[:, a])
                self.set(self._fields[3], kappa[:, a])
            elif a == phi.shape[1]:
                self._fields[3].x.array[:] = 0.0
            fem.assemble_vector(total, self._gradient_form)
        return total[: self.domain.n_cells]

    def cell_derivatives(
        self, x: NDArray[np.float64], w: Block, phi: Block
    ) -> tuple[CellFields, CellFields]:
        """What one element's density changes in M w and K phi, for every element.

        Args:
            x: One density for each cell owned by this rank, shape (cells,).
            w: Fields of the mass term, shape (dofs, a).
            phi: Fields of the stiffness term, shape (dofs, i).

        Returns:
            (dM/dx_e) w_a and (dK/dx_e) phi_i on the dofs of element e alone, for the cells owned by
            this rank: shapes (cells, nodes, dimension, a) and (cells, nodes, dimension, i), nodes
            as in the space's dofmap.
        """
        self._set_density(x)
        space, mass_form, stiffness_form = self._cell_forms
        nodes = _compat.dofmap_array(space)[: self.domain.n_cells]
        result = []
        for form, number, block in ((mass_form, 0, w), (stiffness_form, 2, phi)):
            part = np.empty((*nodes.shape, self.dimension, block.shape[1]))
            for i, column in enumerate(block.T):
                self.set(self._fields[number], column)
                values = fem.assemble_vector(form).array
                part[..., i] = values.reshape(-1, self.dimension)[nodes]
            result.append(part)
        return result[0], result[1]

    @cached_property
    def _cell_forms(self) -> tuple[Any, fem.Form, fem.Form]:
        """A space whose cells share no dofs, and each form's derivative tested with it."""
        domain = self.domain
        space = _compat.function_space(domain.mesh, "DG", domain.order, (self.dimension,))
        test, unit = ufl.TestFunction(space), fem.Function(domain.density_space)
        unit.x.array[:] = 1.0
        forms = [
            fem.form(ufl.derivative(density(field, test) * self._dx, self._density, unit))
            for density, field in (
                (self._mass_density, self._fields[0]),
                (self._stiffness_density, self._fields[2]),
            )
        ]
        return space, *forms

    def at_cells(self, block: Block) -> CellFields:
        """Fields on the nodes of each cell of this rank, shape (cells, nodes, dimension, columns).

        Args:
            block: Fields, shape (dofs, columns).
        """
        nodes = _compat.dofmap_array(self.domain.space)[: self.domain.n_cells]
        result = np.empty((*nodes.shape, self.dimension, block.shape[1]))
        for i, column in enumerate(block.T):
            self.set(self._fields[0], column)
            result[..., i] = self._fields[0].x.array.reshape(-1, self.dimension)[nodes]
        return result

    def from_cells(self, cells: NDArray[np.int64], fields: CellFields, columns: int) -> Block:
        """A block of fields summed from the nodes of cells, the transpose of `at_cells`.

        Collective: parts on nodes of other ranks are sent there.

        Args:
            cells: A cell of this rank and a column for each field, shape (fields, 2).
            fields: On the nodes of these cells, shape (fields, nodes, dimension).
            columns: Number of columns of the block.
        """
        nodes = _compat.dofmap_array(self.domain.space)[cells[:, 0]]
        column = np.broadcast_to(cells[:, 1:], nodes.shape)
        block = np.zeros((self.n_dofs // self.dimension, self.dimension, columns))
        ours = nodes < len(block)
        _add_at(block, nodes[ours], column[ours], fields[ours])
        if self.comm.size > 1:
            index_map = self.domain.space.dofmap.index_map
            theirs = np.asarray(index_map.local_to_global(nodes[~ours].astype(np.int32)))
            first, last = index_map.local_range
            for node, where, value in self.comm.allgather((theirs, column[~ours], fields[~ours])):
                mine = (node >= first) & (node < last)
                _add_at(block, node[mine] - first, where[mine], value[mine])
        return block.reshape(self.n_dofs, columns)

    def dofs_of(self, nodes: NDArray[np.int32]) -> NDArray[np.int64]:
        """The dofs of those of some nodes that this rank owns, in their order.

        Args:
            nodes: Local numbers, those of ghosts among them.
        """
        own = nodes[nodes < self.n_dofs // self.dimension].astype(np.int64)
        return np.asarray(self.dimension * own[:, None] + np.arange(self.dimension)).ravel()

    def strain_energy(self, x: ArrayLike, field: NDArray[np.float64]) -> NDArray[np.float64]:
        """The elastic energy of each cell.

        Args:
            x: One density for each cell owned by this rank, shape (cells,), in [0, 1].
            field: Displacement of this rank's dofs, shape (dofs,) [m].

        Returns:
            Energy 1/2 k_x(u, u) of each cell owned by this rank, shape (cells,) [J].
        """
        return self._energy(self._strain_energy_form, x, field)

    def kinetic_energy(self, x: ArrayLike, field: NDArray[np.float64]) -> NDArray[np.float64]:
        """The kinetic energy of each cell.

        Args:
            x: One density for each cell owned by this rank, shape (cells,), in [0, 1].
            field: Velocity of this rank's dofs, shape (dofs,) [m/s].

        Returns:
            Energy 1/2 m_x(v, v) of each cell owned by this rank, shape (cells,) [J].
        """
        return self._energy(self._kinetic_energy_form, x, field)

    def _energy(
        self, form: fem.Form, x: ArrayLike, field: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        self._set_density(self.domain.check_density(x))
        self.set(self._fields[0], field)
        return np.array(fem.assemble_vector(form).array[: self.domain.n_cells])

    @cached_property
    def _strain_energy_form(self) -> fem.Form:
        field = self._fields[0]
        return self._energy_form(self._stiffness_density(field, field))

    @cached_property
    def _kinetic_energy_form(self) -> fem.Form:
        field = self._fields[0]
        return self._energy_form(self._mass_density(field, field))

    def _energy_form(self, density: ufl.core.expr.Expr) -> fem.Form:
        return fem.form(0.5 * density * ufl.TestFunction(self.domain.density_space) * self._dx)

    def stress(
        self, displacement: ufl.core.expr.Expr, density: ufl.core.expr.Expr
    ) -> ufl.core.expr.Expr:
        """The stress resultant of a ``displacement`` at a field of ``density``, as UFL [N/m]."""
        factor, _ = self._interpolation.on(self.domain.mesh, density)
        return factor * self._material.on(self.domain.mesh).stress(displacement)

    def set(self, function: fem.Function, column: NDArray[np.float64]) -> None:
        """Give a ``function`` the values of one ``column`` of a block, ghosts included."""
        function.x.array[: self.n_dofs] = column
        function.x.scatter_forward()

    # ------------------------------------------------------------------ blocks of fields

    def apply(self, matrix: PETSc.Mat, block: Block) -> Block:
        """The product of `matrix` and `block`, shape (dofs, columns)."""
        dense = self.dense(block)
        product = matrix.matMult(dense)
        result = np.array(product.getDenseArray())
        product.destroy()
        dense.destroy()
        return result

    def dense(self, block: Block) -> PETSc.Mat:
        """A block as a distributed dense matrix."""
        matrix = PETSc.Mat().createDense(
            (self._layout, (PETSc.DECIDE, block.shape[1])),
            array=np.asfortranarray(block, dtype=PETSc.ScalarType).ravel(order="F"),
            comm=self.comm,
        )
        matrix.assemble()
        return matrix

    def inner(self, a: Block, b: Block) -> NDArray[np.float64]:
        """a^T b, shape (columns of a, columns of b), bit-identical on every rank."""
        # by slices that stay in the cache: for many rows of few columns BLAS takes twice as long
        total = np.zeros((a.shape[1], b.shape[1]))
        for first in range(0, len(a), ROWS):
            rows = slice(first, first + ROWS)
            total += a[rows].T @ b[rows]
        return self.sum(total)

    def sum(self, local: NDArray[np.float64]) -> NDArray[np.float64]:
        """The sum over the ranks of the array ``local``, bit-identical on every rank."""
        if self.comm.size == 1:
            return local
        total = np.empty_like(local)
        self.comm.Reduce(local, total, root=0)
        self.comm.Bcast(total, root=0)
        return total

    def largest(self, local: NDArray[np.float64]) -> float:
        """The largest entry of ``local`` over all ranks; zero if there is none."""
        return float(self.comm.allreduce(float(np.max(local, initial=0.0)), MPI.MAX))

    def coordinates(self) -> NDArray[np.float64]:
        """The position of each node owned by this rank, shape (nodes, dimension) [m]."""
        n, d = self.n_dofs // self.dimension, self.dimension
        return self.domain.space.tabulate_dof_coordinates()[:n, :d]


def check_dimension(domain: Domain, material: ElasticMaterial) -> None:
    """Refuse a ``material`` of the plane for a ``domain`` in space, and the other way round.

    Raises:
        ValueError: Naming a material that serves.
    """
    of, name = int(getattr(material, "dimension", 2)), type(material).__name__
    if of != domain.dimension:
        where = {2: "the plane", 3: "space"}
        remedy = {2: "PlaneStress(...) or PlaneStrain(...)", 3: "Isotropic(...)"}
        raise ValueError(
            f"body: {name} is a material for {where[of]}, but the mesh is in "
            f"{where[domain.dimension]}; take {remedy[domain.dimension]}"
        )


def _add_at(
    block: NDArray[np.float64],
    nodes: NDArray[np.int64],
    columns: NDArray[np.int64],
    values: NDArray[np.float64],
) -> None:
    """Add values (n, dimension) to the nodes and columns of a block (nodes, dimension, columns)."""
    for component in range(block.shape[1]):
        np.add.at(block[:, component], (nodes, columns), values[:, component])


def rotated(block: Block) -> Block:
    """J u for each field of a block in the plane: a quarter turn, (u_x, u_y) -> (-u_y, u_x)."""
    result = np.empty_like(block)
    result[0::2], result[1::2] = -block[1::2], block[0::2]
    return result


def rigid_fields(coordinates: NDArray[np.float64], center: NDArray[np.float64]) -> Block:
    """The unit translations along the axes and the unit rotations about ``center``.

    Args:
        coordinates: Node positions, shape (nodes, d) [m].
        center: Shape (d,) [m].

    Returns:
        Block of shape (d nodes, k): u_x, u_y and the rotation in the plane, u_x, u_y, u_z and the
        rotations about the axes in space.
    """
    offset = coordinates - center
    nodes, d = offset.shape
    if d == 2:
        block = np.zeros((nodes, 2, 3))
        block[:, 0, 2], block[:, 1, 2] = -offset[:, 1], offset[:, 0]
    else:
        block = np.zeros((nodes, 3, 6))
        for k, axis in enumerate(np.eye(3)):
            block[:, :, 3 + k] = np.cross(axis, offset)
    block[:, :, :d] = np.eye(d)
    return block.reshape(d * nodes, -1)
