# SPDX-License-Identifier: MIT
"""Stiffness and mass of one body as functions of its density, and their derivatives.

With the density field x (one value a cell) the two bilinear forms are

    k_x(u, v) = int E(x) sigma(u) : eps(v) dX,      m_x(u, v) = int rho(x) u . v dX.

Fields of the body are handled in blocks: arrays of shape (dofs owned by this rank, columns).
"""

from __future__ import annotations

import warnings
import weakref
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import ArrayLike, NDArray
from ufl.algorithms import extract_coefficients
from ufl.checks import is_cellwise_constant
from ufl.core.expr import Expr

from .. import validation
from ..arrays import Array, Integers
from ..limits import give_back_memory
from ..parallel import on_every_rank
from . import _compat
from .domain import Domain
from .material import ElasticMaterial, Interpolation
from .nodes import MeshNodes, add_ghosts

#: Fields, shape (dofs owned by this rank, columns)
Block = Array
#: Fields on the nodes of each cell, shape (cells, nodes, dimension, columns)
CellFields = Array


@dataclass(frozen=True)
class ElasticityOptions:
    """Sizes of blocks of arithmetic, and tolerances for round-off and wrong inputs."""

    rows: int = 4096  #: Of blocks that are multiplied at a time
    cells: int = 2048  #: Whose fields are multiplied at a time
    #: Difference of matrices of cells, relative to their entries, that is round-off of positions
    alike: float = 1e-11
    #: Thickness over the extent of a body in its plane that is no slip, in plane stress
    thickest_stress: float = 10.0
    thickest_strain: float = 1000.0  #: The same in plane strain


ELASTICITY = ElasticityOptions()


class FieldPairs(NamedTuple):
    """Pairs of fields on which psi depends by sum_a m(w_a, y_a) + sum_i k(phi_i, kappa_i)."""

    w: Block  #: (dofs, a)
    y: Block  #: (dofs, a)
    phi: Block  #: (dofs, i)
    kappa: Block  #: (dofs, i)

    @staticmethod
    def in_mass(w: Block, y: Block) -> FieldPairs:
        """Pairs without any in the stiffness."""
        return FieldPairs(w, y, w[:, :0], w[:, :0])

    @staticmethod
    def in_stiffness(phi: Block, kappa: Block) -> FieldPairs:
        """Pairs without any in the mass."""
        return FieldPairs(phi[:, :0], phi[:, :0], phi, kappa)


@dataclass(frozen=True, eq=False)
class Matrices:
    """Stiffness and mass of a body at one density."""

    #: (cells,) of this rank; `assemble` takes no copy
    density: Array = field(repr=False)
    stiffness: PETSc.Mat = field(repr=False)  #: [N/m]
    mass: PETSc.Mat = field(repr=False)  #: [kg]

    def destroy(self) -> None:
        """Free the memory on all ranks together."""
        self.stiffness.destroy()
        self.mass.destroy()


class Elasticity:
    """Stiffness and mass of a body as functions of its density.

    By its mesh ``domain``, its solid ``material`` and an ``interpolation`` between void and solid.
    It holds nothing that belongs to one density: `assemble` returns that.
    """

    def __init__(
        self, domain: Domain, material: ElasticMaterial, interpolation: Interpolation
    ) -> None:
        validation.instance("body: domain", domain, Domain, "a Domain")
        needed = "an elastic material, as PlaneStress(...)"
        members = ("on", "thickness", "out_of_plane")
        validation.implementation("body: material", material, members, needed)
        check_dimension(domain, material)
        warn_of_thickness(domain, material)
        needed = "SIMP(...) or RAMP(...)"
        validation.implementation("body: interpolation", interpolation, ("on",), needed)
        self.domain = domain
        self.comm: MPI.Comm = domain.comm
        space = domain.space
        # each method that needs a density fills it
        self._density = fem.Function(domain.density_space, name="density")
        # the law may be a user's
        u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
        # exact on affine cells; UFL's estimate would count powers of the cellwise constant density
        degree = 2 * domain.order + 2 * (_compat.coordinate_element(domain.mesh).degree - 1)
        dx = ufl.Measure("dx", domain=domain.mesh, metadata={"quadrature_degree": degree})
        self._material, self._interpolation, self._dx = material, interpolation, dx
        self._energy_forms: dict[str, fem.Form] = {}
        with on_every_rank(self.comm, "an elastic body"):
            self._bound = material.on(domain.mesh)
            self._factors = [ufl.as_ufl(k) for k in interpolation.on(domain.mesh, self._density)]
            if not all(map(is_cellwise_constant, self._factors)):
                raise ValueError(
                    "body: the factors of the interpolation vary within cells; give an "
                    "interpolation that depends on the density alone, and put other variation "
                    "into the material"
                )
            stiffness = self._stiffness_density(u, v) * dx
            mass = self._mass_density(u, v) * dx
        self._stiffness_form, self._mass_form = fem.form(stiffness), fem.form(mass)
        # one pair of fields for the mass and one for the stiffness: the number of modes does not
        # enter the compiled form
        self._fields = [fem.Function(space) for _ in range(4)]
        index_map = space.dofmap.index_map
        #: Displacements of a node: 2 in the plane, 3 in space
        self.dimension = domain.dimension
        #: Displacement dofs owned by this rank
        self.n_dofs = int(index_map.size_local) * self.dimension
        self.n_dofs_global = int(index_map.size_global) * self.dimension
        self.set_density(np.ones(domain.n_cells))
        #: Matrices whose sparsity patterns all others share, a stiffness and a mass, once made
        self._pattern: list[PETSc.Mat] = kept_by(self, self.comm)
        PETSc.garbage_cleanup(self.comm)  # matrices of bodies before this one

    def _stiffness_density(self, a: Expr, b: Expr) -> Expr:
        return self._factors[0] * self._solid_stiffness(a, b)

    def _mass_density(self, a: Expr, b: Expr) -> Expr:
        return self._factors[1] * self._solid_mass(a, b)

    def _solid_stiffness(self, a: Expr, b: Expr) -> Expr:
        return ufl.inner(self._bound.stress(a), ufl.sym(ufl.grad(b)))

    def _solid_mass(self, a: Expr, b: Expr) -> Expr:
        return self._bound.density * ufl.inner(a, b)

    def _pairing(self, w: Expr, y: Expr, phi: Expr, kappa: Expr) -> ufl.Form:
        return (self._mass_density(w, y) + self._stiffness_density(phi, kappa)) * self._dx

    def assemble(self, density: Array) -> Matrices:
        """Stiffness and mass matrix at a ``density`` (cells,) from `Domain.check_density`."""
        self.set_density(density)
        stiffness, mass = self.new_matrix(), self.new_matrix(mass=True)
        for matrix, form in ((stiffness, self._stiffness_form), (mass, self._mass_form)):
            fem.petsc.assemble_matrix(matrix, form)
            matrix.assemble()
        return Matrices(density, stiffness, mass)

    def new_matrix(self, *, mass: bool = False) -> PETSc.Mat:
        """A matrix of zeros with the entries of a stiffness, or of a mass, which has fewer."""
        if not self._pattern:
            self._pattern.append(fem.petsc.assemble_matrix(self._stiffness_form))
            self._pattern[0].assemble()
            self._pattern.append(self._uncoupled(self._pattern[0]))
            give_back_memory()
        pattern = self._pattern[-1 if mass else 0]
        return pattern.duplicate(PETSc.Mat.DuplicateOption.SHARE_NONZERO_PATTERN)

    def release(self) -> None:
        """Free the matrices that others are like, which are made again for the next one."""
        while self._pattern:
            self._pattern.pop().destroy()

    def _uncoupled(self, matrix: PETSc.Mat) -> PETSc.Mat:
        """Zeros where a ``matrix`` has entries of one axis: the mass does not couple the axes."""
        indptr, columns, _ = matrix.getValuesCSR()
        rows = np.repeat(np.arange(self.n_dofs), np.diff(indptr))  # each rank has whole nodes
        same_axis = (rows - columns) % self.dimension == 0
        ends = np.concatenate([[0], np.cumsum(same_axis)])[indptr].astype(PETSc.IntType)
        csr = ends, columns[same_axis], np.zeros(int(ends[-1]))
        pattern = PETSc.Mat().createAIJ(matrix.sizes, self.dimension, csr=csr, comm=self.comm)
        pattern.setLGMap(*matrix.getLGMap())
        pattern.setOption(PETSc.Mat.Option.IGNORE_ZERO_ENTRIES, True)  # those of elements couple
        pattern.assemble()
        return pattern

    def set_density(self, x: Array) -> None:
        """Give the forms a density ``x`` (cells,)."""
        self._density.x.array[: self.domain.n_cells] = x
        self._density.x.scatter_forward()

    def density_form(self, integral: ufl.Form) -> fem.Form:
        """The compiled derivative of an ``integral`` with respect to the density of each cell."""
        test = ufl.TestFunction(self.domain.density_space)
        return fem.form(ufl.derivative(integral, self._density, test))

    def cell_zeros(self) -> Array:
        """A sum to which `density_form` adds, shape (cells of this rank, ghosts included)."""
        return np.zeros(len(self._density.x.array))

    @property
    def mass_over_diagonal(self) -> int:
        """A number whose product with its diagonal is at least the mass: nodes of an element."""
        return int(self.domain.space.dofmap.dof_layout.num_dofs)

    @cached_property
    def nodes(self) -> MeshNodes:
        """The nodes of the mesh, for derivatives with respect to their positions."""
        return MeshNodes(self.domain.space)

    @cached_property
    def cell_space(self) -> Any:
        """The displacements' space but that cells share no dofs."""
        mesh, order = self.domain.mesh, self.domain.order
        return _compat.function_space(mesh, "DG", order, (self.dimension,))

    @cached_property
    def _cell_dofs(self) -> Integers:
        """Where the dofs of this rank's cells stand in a field of `cell_space`, (cells, dofs)."""
        nodes = _compat.dofmap_array(self.cell_space)[: self.domain.n_cells, :, None]
        dofs = self.dimension * nodes.astype(np.int64) + np.arange(self.dimension)
        return dofs.reshape(len(nodes), self.dimension * nodes.shape[1])

    @cached_property
    def _node_form(self) -> fem.Form:
        return self.nodes.form(self._pairing(*self._fields))

    @cached_property
    def _areas_form(self) -> fem.Form:
        return self.nodes.form(self._density * ufl.dx(domain=self.domain.mesh))

    def add_areas_gradient(self, nodes: Array, bar: Array) -> None:
        """Add the derivative of sum ``bar`` (cells,) . cell volumes to ``nodes`` of `MeshNodes`."""
        self.set_density(bar)
        fem.assemble_vector(nodes, self._areas_form)

    def density_gradient(self, x: Array, pairs: FieldPairs) -> Array:
        """Derivative by the densities of m_x(w, y) + k_x(phi, kappa), summed over all pairs.

        At the density ``x`` (cells,) and fixed fields, shape (cells,).
        """
        stiffness, mass = self._solid_matrices
        stiffness_energies = self._energies(stiffness, pairs.phi, pairs.kappa)
        mass_energies = self._energies(mass, pairs.w, pairs.y)
        stiffness_slopes, mass_slopes = self._slopes(x)
        return stiffness_slopes * stiffness_energies + mass_slopes * mass_energies

    def add_node_gradient(self, nodes: Array, x: Array, pairs: FieldPairs) -> None:
        """Add the derivative of the same sum by the nodes to ``nodes``, from `MeshNodes.zeros`.

        At the density ``x`` (cells,) and fixed values of the ``pairs`` at the nodes.
        """
        self.set_density(x)
        for a in range(max(pairs.w.shape[1], pairs.phi.shape[1])):
            for function, block in zip(self._fields, pairs, strict=True):
                self.set(function, block[:, a] if a < block.shape[1] else np.zeros(self.n_dofs))
            # it adds: a new vector for each pair of fields would mean new communicators
            fem.assemble_vector(nodes, self._node_form)

    @cached_property
    def _slope_forms(self) -> list[fem.Form | None]:
        """Slopes of the factors of stiffness and mass times volumes; None for a constant factor."""
        return [
            self.density_form(factor * self._dx)
            if self._density in extract_coefficients(factor)
            else None
            for factor in self._factors
        ]

    def _slopes(self, x: Array) -> list[Array]:
        """Slopes of the factors of stiffness and mass at a density ``x``, shape (cells,) each."""
        self.set_density(x)
        slopes = []
        for form in self._slope_forms:
            times_volume = self.cell_zeros()
            if form is not None:
                fem.assemble_vector(times_volume, form)
            slopes.append(times_volume[: self.domain.n_cells] / self.domain.cell_volumes)
        return slopes

    @cached_property
    def _solid_matrices(self) -> tuple[Array, Array]:
        """Matrices of solid cells: stiffness (cells, dofs, dofs), and mass (cells, nodes, nodes).

        The mass is that of one component of displacements.
        """
        return (
            self._cell_matrices(self._solid_stiffness, 1),
            self._cell_matrices(self._solid_mass, self.dimension),
        )

    def _cell_matrices(self, density: Callable[[Any, Any], Expr], step: int) -> Array:
        """Matrices of a bilinear form by its density, of every ``step``-th dof of each cell.

        The shape is (cells, n, n) for n such dofs; cells alike but for round-off share a matrix.
        """
        function, test = fem.Function(self.cell_space), ufl.TestFunction(self.cell_space)
        form = fem.form(density(function, test) * self._dx)

        # a unit displacement of one dof of every cell at once gives a row of each matrix
        rows = []
        for unit in np.eye(self._cell_dofs.shape[1])[::step]:
            self.set_cells(function, unit)
            values = np.zeros(len(function.x.array))
            fem.assemble_vector(values, form)
            row = values[self._cell_dofs[:, ::step]]

            round_off = ELASTICITY.alike * np.max(np.abs(row), initial=0.0)
            equal = len(row) > 0 and np.max(np.ptp(row, axis=0)) <= round_off
            rows.append(row[:1] if equal else row)
        matrices = np.stack(np.broadcast_arrays(*rows), axis=1)
        return np.broadcast_to(matrices, (self.domain.n_cells, *matrices.shape[1:]))

    def _energies(self, matrices: Array, left: Block, right: Block) -> Array:
        """Sum over the columns of two blocks of left^T A right in each cell, shape (cells,).

        The ``matrices`` A are of the dofs of cells, or of their nodes for each component.
        """
        energies, size = np.zeros(self.domain.n_cells), matrices.shape[1]
        if left.shape[1] == 0:
            return energies
        nodes = _compat.dofmap_array(self.domain.space)[: self.domain.n_cells]
        left, right = self._by_nodes(left), self._by_nodes(right)
        for begin in range(0, len(nodes), ELASTICITY.cells):
            chunk = slice(begin, begin + ELASTICITY.cells)
            rows, columns = (
                values[nodes[chunk]].reshape(len(nodes[chunk]), size, -1)
                for values in (left, right)
            )
            products = rows @ columns.swapaxes(1, 2)
            energies[chunk] = np.einsum("cij,cij->c", matrices[chunk], products)
        return energies

    def cell_derivatives(self, x: Array, w: Block, phi: Block) -> tuple[CellFields, CellFields]:
        """(dM/dx_e) w_a and (dK/dx_e) phi_i on the nodes of element e, for every element.

        The density ``x`` is of shape (cells,), ``w`` of shape (dofs, a) and ``phi`` of shape
        (dofs, i); returned are (cells, nodes, dimension, a) and (cells, nodes, dimension, i),
        with nodes as in the space's dofmap.
        """
        derivatives = []
        for block, matrices, slopes in zip(
            (phi, w), self._solid_matrices, self._slopes(x), strict=True
        ):
            local = self.at_cells(block)
            size = len(local), matrices.shape[1], local[:1].size // matrices.shape[1]
            forces = slopes[:, None, None] * (matrices.swapaxes(1, 2) @ local.reshape(size))
            derivatives.append(forces.reshape(local.shape))
        stiffness_forces, mass_forces = derivatives
        return mass_forces, stiffness_forces

    def at_cells(self, block: Block) -> CellFields:
        """The fields of a ``block`` on the nodes of each cell owned by this rank."""
        nodes = _compat.dofmap_array(self.domain.space)[: self.domain.n_cells]
        return self._by_nodes(block)[nodes]

    def _by_nodes(self, block: Block) -> Array:
        """`with_ghosts` of a ``block``, shape (nodes, dimension, columns)."""
        extended = self.with_ghosts(block)
        return extended.reshape(len(extended) // self.dimension, self.dimension, block.shape[1])

    def set_cells(self, function: fem.Function, values: Array, cells: slice = slice(None)) -> None:
        """Give a ``function`` of `cell_space` values (cells, dofs) or (dofs,) in ``cells``."""
        function.x.array[self._cell_dofs[cells]] = values

    def with_ghosts(self, block: Block) -> Block:
        """The fields of a ``block`` at the nodes of this rank and its ghosts."""
        if self.comm.size == 1:
            return np.ascontiguousarray(block)
        function = self._fields[0]
        result = np.empty((len(function.x.array), block.shape[1]))
        for i, column in enumerate(block.T):
            self.set(function, column)
            result[:, i] = function.x.array
        return result

    def from_cells(self, cells: Integers, columns: Iterable[Array]) -> Block:
        """A block summed from fields on cells, the transpose of `at_cells`.

        The ``columns`` are values on the dofs of ``cells`` (k,) of this rank, of the size
        (k * nodes * dimension) each.
        """
        nodes = _compat.dofmap_array(self.domain.space)[cells, :, None]
        dofs = (self.dimension * nodes + np.arange(self.dimension)).ravel()
        gathered, summed_columns = self._fields[0], []
        for values in columns:
            array = gathered.x.array
            array[:] = np.bincount(dofs, values.ravel(), minlength=len(array))
            add_ghosts(gathered)
            summed_columns.append(array[: self.n_dofs].copy())
        return np.array(summed_columns).reshape(len(summed_columns), self.n_dofs).T

    def dofs_of(self, nodes: NDArray[np.int32]) -> Integers:
        """Dofs of the locally owned nodes among the local ``nodes``, in the given order."""
        owned = nodes[nodes < self.n_dofs // self.dimension].astype(np.int64)
        return np.asarray(self.dimension * owned[:, None] + np.arange(self.dimension)).ravel()

    def solid_pairing(self, points: Array) -> Callable[..., Array]:
        """A function to sum rho w . y + sigma(phi) : eps(kappa) of the solid at points of cells.

        The ``points`` are in the reference cell, shape (points, dimension). Of the four blocks w
        and y have as many columns, phi and kappa too. It gives the sums, shape (cells, points),
        and is collective.
        """
        w, y, phi, kappa = self._fields
        mass, stiffness = self._solid_mass(w, y), self._solid_stiffness(phi, kappa)
        evaluate = [
            _compat.compiled_expression(ufl.as_vector([integrand]), points, self.domain.mesh)
            for integrand in (mass, stiffness)
        ]
        cells = np.arange(self.domain.n_cells, dtype=np.int32)

        def paired(*blocks: Block) -> Array:
            total = np.zeros((len(cells), len(points)))
            for evaluated, functions, pair in zip(
                evaluate, ((w, y), (phi, kappa)), (blocks[:2], blocks[2:]), strict=True
            ):
                for columns in zip(*(block.T for block in pair), strict=True):
                    for function, column in zip(functions, columns, strict=True):
                        self.set(function, column)
                    total += evaluated(cells)[..., 0]
            return total

        return paired

    def strain_energy(self, x: ArrayLike, field: Array) -> Array:
        """Energies 1/2 k_x(u, u) of cells (cells,) [J] at ``x`` (cells,), ``field`` u (dofs,)."""
        return self._energy(self._stiffness_density, x, field)

    def kinetic_energy(self, x: ArrayLike, field: Array) -> Array:
        """Energies 1/2 m_x(v, v) of cells (cells,) [J] at ``x`` (cells,), ``field`` v (dofs,)."""
        return self._energy(self._mass_density, x, field)

    def _energy(self, density: Callable[[Any, Any], Expr], x: ArrayLike, field: Array) -> Array:
        self.set_density(self.domain.check_density(x))
        function = self._fields[0]
        self.set(function, field)
        name = density.__name__
        if name not in self._energy_forms:
            test = ufl.TestFunction(self.domain.density_space)
            self._energy_forms[name] = fem.form(0.5 * density(function, function) * test * self._dx)
        energies = fem.assemble_vector(self._energy_forms[name]).array
        return np.array(energies[: self.domain.n_cells])

    def stress(self, displacement: Expr) -> Expr:
        """The stress resultant of a ``displacement`` at the present density, as UFL [N/m]."""
        return self._factors[0] * self._bound.stress(displacement)

    def set(self, function: fem.Function, column: Array) -> None:
        """Give a ``function`` the values of one ``column`` of a block, ghosts included."""
        function.x.array[: self.n_dofs] = column
        function.x.scatter_forward()

    # ------------------------------------------------------------------ blocks of fields

    def apply(self, matrix: PETSc.Mat, block: Block) -> Block:
        """The product of `matrix` and `block`, shape (dofs, columns)."""
        return by_dense(matrix.matMult, self.dense(block))

    def dense(self, block: Block) -> PETSc.Mat:
        """A block as a distributed dense matrix."""
        return dense_matrix(self.comm, block)

    def inner(self, a: Block, b: Block) -> Array:
        """a^T b, shape (columns of a, columns of b), bit-identical on every rank."""
        # by slices that stay in the cache: for many rows of few columns BLAS takes twice as long
        total = np.zeros((a.shape[1], b.shape[1]))
        for begin in range(0, len(a), ELASTICITY.rows):
            rows = slice(begin, begin + ELASTICITY.rows)
            total += a[rows].T @ b[rows]
        return self.sum(total)

    def sum(self, local: Array) -> Array:
        """The sum over the ranks of the array ``local``, bit-identical on every rank."""
        return summed(self.comm, local)

    def decided(self, value: Any) -> Any:
        """The ``value`` of rank 0, so that all ranks go on with the same bits."""
        return value if self.comm.size == 1 else self.comm.bcast(value)

    def largest(self, local: Array) -> float:
        """The largest entry of ``local`` over all ranks; zero if there is none."""
        return float(self.comm.allreduce(float(np.max(local, initial=0.0)), MPI.MAX))

    def coordinates(self) -> Array:
        """The position of each node owned by this rank, shape (nodes, dimension) [m]."""
        n, d = self.n_dofs // self.dimension, self.dimension
        return self.domain.space.tabulate_dof_coordinates()[:n, :d]


def summed(comm: MPI.Comm, local: Array) -> Array:
    """The sum over the ranks of a contiguous array, bit-identical on every rank."""
    if comm.size == 1:
        return local
    total = np.empty_like(local)
    comm.Reduce(local, total, root=0)
    comm.Bcast(total, root=0)
    return total


def dense_matrix(comm: MPI.Comm, block: Block) -> PETSc.Mat:
    """A block as a dense matrix with the same distribution of rows."""
    matrix = PETSc.Mat().createDense(
        ((len(block), PETSc.DETERMINE), (PETSc.DECIDE, block.shape[1])),
        array=np.asfortranarray(block, dtype=PETSc.ScalarType).ravel(order="F"),
        comm=comm,
    )
    matrix.assemble()
    return matrix


def by_dense(function: Callable[[PETSc.Mat], PETSc.Mat], dense: PETSc.Mat) -> Block:
    """This rank's part of a function of a dense matrix; both matrices are destroyed."""
    product = function(dense)
    result = np.array(product.getDenseArray(), order="F")
    product.destroy()
    dense.destroy()
    return result


def kept_by(owner: object, comm: MPI.Comm) -> list[Any]:
    """An empty list for PETSc objects that ``owner`` keeps; on one rank they are freed with it.

    On several ranks PETSc keeps an object until all ask together (`PETSc.garbage_cleanup`).
    """
    objects: list[Any] = []

    def drop() -> None:
        objects.clear()
        PETSc.garbage_cleanup(comm)

    if comm.size == 1:
        # the end of the program comes after PETSc's
        weakref.finalize(owner, drop).atexit = False
    return objects


def check_dimension(domain: Domain, material: ElasticMaterial) -> None:
    """Refuse a ``material`` of the plane for a ``domain`` in space, and the other way round."""
    dimension, d, name = (
        getattr(material, "dimension", 2),
        domain.dimension,
        type(material).__name__,
    )
    if dimension != d:
        spaces = {2: "the plane", 3: "space"}
        remedy = "PlaneStress(...) or PlaneStrain(...)" if d == 2 else "Isotropic(...)"
        if not hasattr(material, "dimension"):
            remedy += ", or a law that has the attribute dimension = 3"
        raise ValueError(
            f"body: {name} is a material for {spaces[dimension]}, but the mesh is in {spaces[d]}; "
            f"take {remedy}"
        )


def warn_of_thickness(domain: Domain, material: ElasticMaterial) -> None:
    """Warn of a plane body far thicker than it is long, as where numbers are in a wrong order.

    No length is known by itself, as any consistent system of units serves.
    """
    thickness, name = material.thickness, type(material).__name__
    if domain.dimension == 3 or thickness is None:
        return
    extent = float(np.max(np.ptp(domain.bounding_box, axis=0)))
    # in plane strain a part may be long, and of unit thickness
    thickest = (
        ELASTICITY.thickest_stress if material.out_of_plane == 0.0 else ELASTICITY.thickest_strain
    )
    if thickness > thickest * extent and not (material.out_of_plane and thickness == 1.0):
        warnings.warn(
            f"body: the thickness {thickness:g} m of {name} is {thickness / extent:.3g} times the "
            f"extent of the body in its plane, {extent:.3g} m: check the order of density and "
            f"thickness, {name}(young, poisson, density, thickness), and the units of the mesh",
            stacklevel=4,
        )


def rotated(block: Block) -> Block:
    """J u for each field of a block in the plane: a quarter turn, (u_x, u_y) -> (-u_y, u_x)."""
    result = np.empty_like(block)
    result[0::2], result[1::2] = -block[1::2], block[0::2]
    return result


def rigid_fields(coordinates: Array, center: Array) -> Block:
    """Unit translations and rotations about ``center`` at nodes (nodes, d), 3 or 6 columns."""
    d = len(center)
    # in the plane, too, rotations are vectors of three components
    offset = np.zeros((len(coordinates), 3))
    offset[:, :d] = coordinates - center
    axes = np.eye(3) if d == 3 else np.eye(3)[2:]

    block = np.zeros((len(offset), d, d + len(axes)))
    block[:, :, :d] = np.eye(d)
    for k, axis in enumerate(axes):
        block[:, :, d + k] = np.cross(axis, offset)[:, :d]
    return block.reshape(d * len(offset), -1)
