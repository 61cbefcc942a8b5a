# SPDX-License-Identifier: MIT
"""Craig-Bampton reduction of one body: shape functions, and the derivative of their span.

Interfaces move as rigid bodies. K and M below are the matrices of the interior dofs: all interfaces
are clamped.

- Constraint modes psi_k: K psi_k = 0 in the interior, unit rigid motion on one interface, zero on
  the others. A frame of reference drops the motions that it fixes.
- Fixed-interface normal modes phi_i: K phi_i = lambda_i M phi_i, phi_i^T M phi_i = 1.

References:
    R. R. Craig and M. C. C. Bampton, AIAA Journal 6 (1968), doi:10.2514/3.4741.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field

from petsc4py import PETSc

import numpy as np

from .. import validation
from ..body import BodyMarker
from ..documentation import Shown
from ..fem import Array, Block, Domain, Elasticity, FieldPairs, Matrices, rigid_fields, rotated
from .direct_solver import DIRECT, SOLVERS
from .factored_body import ClampedMatrices, FactoredBody
from .frame import Frame
from .krylov import KrylovSpace
from .multigrid import MultigridSolver
from .normal_modes import CLUSTER, EigenSolver, LowestModes, below_following, cluster


@dataclass(frozen=True)
class ReductionOptions:
    """Bounds of the solvers' tolerance, and where iterations and differences end."""

    tightest: float = 1e-14  #: Least tolerance: round-off leaves no less
    loosest: float = 1e-2  #: Largest tolerance: beyond it no digit would be right
    round_off: float = 1e-14  #: Relative round-off of eigenvalues, at least
    most_blocks: int = 100  #: Blocks of the space of adjoint fields, at most
    #: By which centers are moved for differences of what follows them, in extents of interfaces
    step_of_centers: float = 3e-4


REDUCTION = ReductionOptions()


@dataclass(frozen=True, repr=False)
class ReducedBasis(Shown):
    """Shape functions of one body at one density."""

    shapes: Block  #: (dofs of this rank, r) constraint modes, then normal modes [-]
    n_constraint: int  #: Number of constraint modes
    eigenvalues: Array  #: (modes,) fixed-interface lambda_i [rad^2/s^2]
    mass_times_normal: Block = field(repr=False)  #: (dofs, modes) M phi_i, interior
    truncated_eigenvalues: Array  #: (k,) of the modes that follow, found but left out [rad^2/s^2]
    truncated_modes: Block = field(repr=False)  #: (dofs, k)
    mass_times_truncated: Block = field(repr=False)  #: (dofs, k), interior

    @property
    def constraint(self) -> Block:
        """The constraint modes, shape (dofs, n_constraint)."""
        return self.shapes[:, : self.n_constraint]

    @property
    def normal(self) -> Block:
        """The retained normal modes, shape (dofs, modes)."""
        return self.shapes[:, self.n_constraint :]

    @property
    def frequencies(self) -> Array:
        """Fixed-interface natural frequencies, shape (modes,) [Hz]."""
        return np.sqrt(np.maximum(self.eigenvalues, 0.0)) / (2.0 * np.pi)

    @property
    def first_truncated_eigenvalue(self) -> float:
        """The first truncated eigenvalue [rad^2/s^2]; inf if no mode was asked for."""
        return float(self.truncated_eigenvalues[0]) if len(self.truncated_eigenvalues) else np.inf

    @property
    def spectral_gap(self) -> float:
        """Relative gap between the last retained eigenvalue and the first truncated one."""
        if len(self.eigenvalues) == 0:
            return np.inf
        return self.first_truncated_eigenvalue / float(self.eigenvalues[-1]) - 1.0


@dataclass(frozen=True)
class ShapesBar:
    """Derivative of psi with respect to shape functions Phi and densities, at fixed integrals.

    Psi changes by  <shapes, d Phi> + <K, d(Phi^T K Phi)> + sum_a m_dx(w_a, y_a) +
    sum_i k_dx(phi_i, kappa_i).
    """

    shapes: Block  #: (dofs, r)
    K: Array | None = None  #: (r, r), or None where the stiffness does not matter
    pairs: FieldPairs | None = None  #: In the mass and in the stiffness
    #: (dofs,) with respect to the reference position, where positions of nodes are asked for
    reference: Array | None = None
    #: (dofs, k) with respect to the constraint modes' values at the interfaces, besides ``shapes``
    lifted: Block | None = None
    #: By interface (dimension, k) with respect to the displacements that forces there work on
    loads: dict[str, Array] = field(default_factory=dict)
    #: Fields (dofs, j), and derivatives by their stress (cells, points, components, j)
    stress: tuple[Block, Array] | None = None


class CraigBampton:
    """Constraint modes and fixed-interface normal modes, and the pullback of their span.

    No state here belongs to one density: it is returned (`factor`, `basis`) and handed on.

    Args:
        elasticity: Stiffness and mass of the body.
        frame: Reference conditions, `ChordFrame` or `TangentFrame`.
        modes: Number of normal modes.
        tolerance: Tolerance of modes and adjoint fields, as for `FlexibleBody`.
        solver: ``"direct"`` or ``"iterative"``, as for `FlexibleBody`.

    Raises:
        ValueError: If the frame names an interface that is not there or leaves the frame
            undetermined, or if there are more modes than interior degrees of freedom.
    """

    def __init__(
        self,
        elasticity: Elasticity,
        frame: Frame,
        modes: int,
        *,
        tolerance: float = 1e-8,
        solver: str = DIRECT,
    ) -> None:
        validation.instance("reduction: elasticity", elasticity, Elasticity, "an Elasticity")
        needed = "ChordFrame(...) or TangentFrame(...)"
        validation.implementation("body: frame", frame, ("origin", "retained"), needed)
        validation.number(
            "body: tolerance", tolerance, least=REDUCTION.tightest, most=REDUCTION.loosest
        )
        self.elasticity = elasticity
        self.frame = frame
        self.modes = validation.integer("reduction: modes", modes, least=-np.inf)
        self.tolerance = tolerance
        self.solver = validation.choice("body: solver", solver, SOLVERS)
        domain = elasticity.domain
        self.origin = frame.origin(domain)
        self.motions = frame.retained(domain)
        #: Whether a dof of this rank belongs to an interface, shape (dofs,)
        self.clamped = np.zeros(elasticity.n_dofs, dtype=bool)
        for interface in domain.interfaces.values():
            self.clamped[elasticity.dofs_of(interface.dofs)] = True
        self._eigensolver = EigenSolver(elasticity, self.clamped, tolerance)
        free = self._eigensolver.freedoms
        self.most_modes = free - 1  #: Normal modes that the body can have at most
        if not 0 <= self.modes <= self.most_modes:
            raise ValueError(
                f"reduction: modes = {modes} must be between 0 and {free - 1}: the mesh has {free} "
                "degrees of freedom inside the interfaces; take fewer modes or a finer mesh"
            )
        self._lifted = self._lift(domain, self.motions)
        self.n_constraint = self._lifted.shape[1]
        if self.n_constraint + self.modes == 0:
            raise ValueError("reduction: no shape functions at all; take at least one normal mode")
        coordinates = elasticity.coordinates()
        self.reference = (coordinates - self.origin).ravel()  #: w_0 of this rank's dofs [m]

    def _lift(self, domain: Domain, retained: Mapping[str, Array]) -> Block:
        """The retained interface motions as fields that vanish off their interface."""
        coordinates = self.elasticity.coordinates()
        columns = [np.zeros((coordinates.size, 0))]
        for name, motions in retained.items():
            interface = domain.interfaces[name]
            rows = self.elasticity.dofs_of(interface.dofs)
            columns.append(np.zeros((coordinates.size, len(motions))))
            columns[-1][rows] = (rigid_fields(coordinates, interface.center) @ motions.T)[rows]
        return np.hstack(columns)

    @property
    def unit_translations(self) -> Block:
        """The body's displacements by one metre along each axis, shape (dofs, dimension) [m]."""
        d = self.elasticity.dimension
        return np.tile(np.eye(d), (self.elasticity.n_dofs // d, 1))

    @property
    def unit_gradients(self) -> Block:
        """The fields through which an undeformed body's acceleration varies over it [m].

        In the plane w_0, of -omega^2, and J w_0, of alpha, shape (dofs, 2). In space the products
        w_0^l e_k, of the entries k, l of [alpha] + [omega]^2, shape (dofs, 9), k first.
        """
        reference, d = self.reference[:, None], self.elasticity.dimension
        if d == 2:
            return np.hstack([reference, rotated(reference)])
        fields = np.einsum("nl,ik->nikl", reference.reshape(-1, d), np.eye(d))
        return np.asarray(fields.reshape(len(reference), d * d))

    def reference_pullback(self, gradients_bar: Block) -> Array:
        """From ``gradients_bar``, by `unit_gradients`, to that by the reference, (dofs,)."""
        d = self.elasticity.dimension
        if d == 2:  # J^T = -J
            return np.asarray(gradients_bar[:, 0] - rotated(gradients_bar[:, 1:])[:, 0])
        # node, component, k, l
        return np.einsum("nkkl->nl", gradients_bar.reshape(-1, d, d, d)).ravel()

    def lifted_pullback(self, values_bar: Block) -> Array:
        """Derivative through the constraint modes' values at the interfaces' nodes, (dofs,).

        They are rigid motions about centers that stay where they are, so they change with the
        positions of these nodes; ``values_bar``, (dofs, k), is the derivative with respect to them.
        """
        d = self.elasticity.dimension
        total = np.zeros((len(values_bar) // d, d))  # by node
        columns = iter(values_bar.T)  # the columns of one interface after those of another
        for name, motions in self.motions.items():
            rows = self.elasticity.dofs_of(self.elasticity.domain.interfaces[name].dofs)
            for motion, column in zip(motions, columns, strict=False):
                bar = np.zeros((len(rows) // d, 3))
                bar[:, :d] = column[rows].reshape(-1, d)
                # a node that moves by dx changes the value by axis x dx
                axis = motion[d:] if d == 3 else (0.0, 0.0, motion[2])
                total[rows[::d] // d] += np.cross(bar, axis)[:, :d]
        return total.ravel()

    def centers_pullback(
        self,
        values_bar: Block,
        reference_bar: Array,
        markers_bar: Mapping[str, BodyMarker],
        loads_bar: Mapping[str, Array],
    ) -> Array:
        """Derivative by the centers of all interfaces, (interfaces, dimension), on every rank.

        Frame, constraint modes and markers follow them, by differences of the geometry alone. Bars:
        ``values_bar`` by the constraint modes at the interfaces, (dofs, k), ``reference_bar`` by
        the reference position, (dofs,), ``markers_bar`` by the markers, ``loads_bar`` by the
        displacements of interfaces that forces at them work on, (dimension, k).
        """
        domain, d = self.elasticity.domain, self.elasticity.dimension
        shifted = reference_bar.reshape(-1, d).sum(axis=0)

        def along(name: str, step: Array) -> float:
            center = domain.interfaces[name].center + step
            moved = domain.with_center(name, center)
            origin, motions = self.frame.origin(moved), self.frame.retained(moved)
            total = float(np.sum(values_bar * self._lift(moved, motions)) - shifted @ origin)
            for marker, bar in markers_bar.items() if domain.comm.rank == 0 else ():
                total -= float(bar.position @ origin)
                if marker in domain.interfaces:
                    displacement, rotation = self.interface_motion(marker, motions)
                    k = displacement.shape[1]
                    total += float(bar.position @ moved.interfaces[marker].center)
                    loaded = bar.displacement[:, :k] + loads_bar.get(marker, 0.0)
                    total += float(np.sum(loaded * displacement))
                    total += float(np.sum(bar.rotation[..., :k] * rotation))
            return total

        result = np.zeros((len(domain.interfaces), d))
        for row, (name, interface) in zip(result, domain.interfaces.items(), strict=True):
            steps = REDUCTION.step_of_centers * interface.extent * np.eye(d)
            row[:] = [along(name, step) - along(name, -step) for step in steps]
            row /= 2.0 * REDUCTION.step_of_centers * interface.extent
        return np.asarray(sum(domain.comm.allgather(result)))

    def interface_motion(
        self, name: str, motions: Mapping[str, Array] | None = None
    ) -> tuple[Array, Array]:
        """Displacement and rotation of the k constraint modes at the center of interface ``name``.

        Phi_P of shape (2, k) [-] and Psi_P of shape (k,) [1/m]; in space both of shape (3, k), by
        default for the ``motions`` that the frame retains.
        """
        d = self.elasticity.dimension
        motions_by_name = (self.motions if motions is None else motions).items()
        rows = [m if interface == name else np.zeros_like(m) for interface, m in motions_by_name]
        motion = np.vstack([np.zeros((0, 3 * d - 3)), *rows]).T
        return motion[:d], motion[2] if d == 2 else motion[d:]

    # ------------------------------------------------------------------ forward

    def factor(self, matrices: Matrices, recycled: ClampedMatrices | None = None) -> FactoredBody:
        """The ``matrices`` of a density with all interfaces clamped, and the factor of K.

        The ``recycled`` matrices of another density, from `FactoredBody.recycle`, are used up:
        their pattern and their ordering serve again.
        """
        rows = np.flatnonzero(self.clamped).astype(np.int32)
        if recycled is not None:
            try:
                recycled.fill(matrices, rows)
                return FactoredBody(self.elasticity, matrices, recycled)
            except PETSc.Error:  # a new ordering may do
                recycled.destroy()

        clamped = ClampedMatrices.of(self.elasticity, self.clamped, self.solver, self.tolerance)
        try:
            clamped.fill(matrices, rows)
        except PETSc.Error as error:
            clamped.destroy()
            matrices.destroy()
            raise RuntimeError(
                "reduction: the stiffness with clamped interfaces is singular: a part of the body "
                "can move without strain (nodes joined in one point only, or a void without floor)"
            ) from error
        return FactoredBody(self.elasticity, matrices, clamped)

    def basis(self, factored: FactoredBody) -> ReducedBasis:
        """The shape functions of a ``factored`` body.

        Warns:
            UserWarning: If the number of modes cuts through a cluster of frequencies.
        """
        load = self.elasticity.apply(factored.matrices.stiffness, self._lifted)
        load[self.clamped] = 0.0
        n = self.modes
        if n:
            lowest = self._eigensolver.lowest(factored, n, load)
            self._warn_about_cluster(lowest.eigenvalues)
        else:
            none = np.zeros((self.elasticity.n_dofs, 0))
            lowest = LowestModes(np.zeros(0), none, none, factored.solve(load))
        return ReducedBasis(
            shapes=np.hstack([self._lifted - lowest.static, lowest.fields[:, :n]]),
            n_constraint=self.n_constraint,
            eigenvalues=lowest.eigenvalues[:n],
            mass_times_normal=lowest.mass_fields[:, :n],
            truncated_eigenvalues=lowest.eigenvalues[n:],
            truncated_modes=lowest.fields[:, n:],
            mass_times_truncated=lowest.mass_fields[:, n:],
        )

    def _warn_about_cluster(self, eigenvalues: Array) -> None:
        bounds = cluster(eigenvalues, self.modes)
        if self.modes in bounds:
            return
        pair = np.sqrt(eigenvalues[self.modes - 1 : self.modes + 1]) / (2 * np.pi)
        warnings.warn(
            f"reduction: modes = {self.modes} cuts through a cluster of frequencies ({pair[0]:.6g} "
            f"and {pair[1]:.6g} Hz), so that psi and its gradient depend on the choice of modes by "
            f"the solver; take modes = {self._possible(bounds)}",
            stacklevel=4,
        )

    def _possible(self, bounds: tuple[int, int]) -> str:
        """The numbers of modes around a cluster that the body can have, for a message."""
        return " or ".join(str(k) for k in bounds if 0 < k < self._eigensolver.freedoms)

    def warn_of_missing_modes(self, factored: FactoredBody, basis: ReducedBasis) -> None:
        """Count the modes of a body with its ``basis`` again; the ``factored`` body is freed.

        Warns:
            UserWarning: If there are others than those found, or they cannot be counted.
        """
        values = np.append(basis.eigenvalues, basis.truncated_eigenvalues)
        end = cluster(values, self.modes)[1] if self.modes else len(values)
        if end == len(values) or self.solver != DIRECT:  # all that there are, or no factor
            return
        limit = below_following(values, end)
        try:
            counted = factored.count_last(limit)
        except RuntimeError as error:
            warnings.warn(f"{error}; a mode is missing with a probability of 1e-10", stacklevel=2)
            return
        if counted != end:
            warnings.warn(
                f"reduction: {end} normal modes were found below "
                f"{np.sqrt(limit) / (2.0 * np.pi):.6g} Hz, but a count gives {counted}: psi may "
                "lack a mode, or the body is too ill-conditioned for a count; give void more "
                "stiffness, or take another number of modes",
                stacklevel=2,
            )

    def check_gap(self, factored: FactoredBody, basis: ReducedBasis) -> None:
        """Refuse a ``basis`` of a ``factored`` body that cuts a cluster of eigenvalues.

        The span of such a basis has no derivative. Across a relative gap g the round-off r of the
        eigenvalues, relative to them, leaves a share r / g of the first truncated mode in the last
        retained one, and the span turns by 1 / g: the gradient is wrong by r / g^2 of its size, and
        below g = sqrt(r) it has no digit.
        """
        if basis.spectral_gap >= CLUSTER:
            return
        n = len(basis.eigenvalues)
        values = np.array([basis.eigenvalues[-1], basis.first_truncated_eigenvalue])
        pair = np.hstack([basis.shapes[:, -1:], basis.truncated_modes[:, :1]])
        reach = self._reach(factored, values, pair)
        if basis.spectral_gap >= reach:
            return
        uncut = cluster(np.append(basis.eigenvalues, basis.truncated_eigenvalues), n)
        raise RuntimeError(
            f"reduction: modes = {n} cuts through modes of the same frequency "
            f"({basis.frequencies[-1]:.6g} Hz, relative gap {basis.spectral_gap:.1e}, and "
            f"round-off reaches to {reach:.0e}): there is no gradient; take modes = "
            f"{self._possible(uncut)}"
        )

    def _reach(self, factored: FactoredBody, values: Array, pair: Block) -> float:
        """The relative gap of two eigenvalues below which their modes have no derivative."""
        image = self.elasticity.apply(factored.clamped.stiffness, pair)
        off = np.abs(self.elasticity.inner(pair, image) - np.diag(values)) / values[0]
        return float(np.sqrt(max(float(np.max(off)), REDUCTION.round_off)))

    # ------------------------------------------------------------------ pullback

    def pullback(
        self, factored: FactoredBody, basis: ReducedBasis, shapes_bar: Block
    ) -> tuple[Block, int]:
        """The fields through which the span of the shape functions depends on the density.

        Psi must not depend on the choice of basis within the span. With
        K z_k = -Phi_bar_k for the constraint modes, and
        (K - lambda_i M) z_i = -(Phi_bar_i projected off the retained modes), z_i M-orthogonal to
        them, the derivative of psi is  sum_k z_k^T dK psi_k + sum_i z_i^T (dK - lambda_i dM) phi_i.
        The second systems are solved together in one block Krylov space (`solve_shifted`).

        For a ``factored`` body with its shape functions ``basis``, ``shapes_bar`` is the derivative
        of psi with respect to these at fixed K and M, shape (dofs, r). Returned are the adjoint
        fields z, shape (dofs, r), and the number of blocks of the Krylov space or of iterations.
        """
        self.check_gap(factored, basis)
        right = -shapes_bar
        right[self.clamped] = 0.0
        k = basis.n_constraint
        static, of_normal_modes = np.split(right, [k], axis=1)
        return self.solve_shifted(factored, basis, of_normal_modes, basis.eigenvalues, static)

    def solve_shifted(
        self,
        factored: FactoredBody,
        basis: ReducedBasis,
        right: Block,
        shifts: Array,
        static: Block | None = None,
    ) -> tuple[Block, int]:
        """Solve (K - shift_j M) z_j = right_j on the complement of the retained modes.

        With T = K^-1 M and z_0 = K^-1 right all solutions lie near one block Krylov space V of T
        that grows from all z_0: Galerkin's method for (1 - shift_j T) z_j = z_0j gives V y_j, and
        z_j = z_0j + shift_j T V y_j. Its error in the norm of K is at most
        shift_j / (1 - shift_j / lambda) / sqrt(lambda) times the norm by mass of z_j - V y_j, with
        the first eigenvalue lambda that the space does not know. Along the truncated modes the
        solution is known. Without a factor, conjugate gradients solve each system.

        For a ``factored`` body and its shape functions ``basis``, the columns of ``right``
        (dofs, columns) are zero in clamped rows, and ``shifts`` (columns,) [rad^2/s^2] are retained
        eigenvalues. Solutions are M-orthogonal to the retained modes; the number of blocks or
        iterations follows. Before them are those of K z = ``static`` (dofs, k), as any field, where
        it is given. The error of each in the norm of K is at most the tolerance times the
        largest norm of all solutions, both times the square roots of their shifts. In `pullback`
        that bounds the error of the gradient relative to its largest part.
        """
        inner = self.elasticity.inner
        static = right[:, :0] if static is None else static
        if right.shape[1] == 0:
            return factored.solve(static), 0
        truncated, eigenvalues = basis.truncated_modes, basis.truncated_eigenvalues
        shares = inner(truncated, right) / (eigenvalues[:, None] - shifts)
        normal = np.hstack([basis.normal, truncated])
        mass_normal = np.hstack([basis.mass_times_normal, basis.mass_times_truncated])
        loads = right - mass_normal @ inner(normal, right)
        if isinstance(factored.clamped.solver, MultigridSolver):
            matrices = factored.clamped.stiffness, factored.clamped.mass
            solution, iterations = factored.clamped.solver.solve_shifted(
                matrices, loads, shifts, (normal, mass_normal)
            )
            columns = [factored.solve(static), solution + truncated @ shares]
            return np.hstack(columns), iterations
        solutions = factored.solve(np.hstack([static, loads]))
        static, unshifted = np.split(solutions, [static.shape[1]], axis=1)
        unshifted -= normal @ inner(mass_normal, unshifted)
        energies_of_first = self.elasticity.sum(np.einsum("ij,ij->j", unshifted, loads))
        energies_without_space = energies_of_first + eigenvalues @ shares**2
        reach = shifts**2.5 / (1.0 - shifts / eigenvalues[-1]) / np.sqrt(eigenvalues[-1])
        # by their share in the error; directions with a tenth of what is allowed are not followed
        weights = reach / shifts
        floor = 0.1 * self.tolerance * float(np.sqrt(np.max(shifts * energies_without_space)))
        without = normal, mass_normal
        space = KrylovSpace(factored, unshifted * weights, without, floor=floor)
        if space.invariant:  # nothing to solve for
            return np.hstack([static, unshifted + truncated @ shares]), 0
        for iteration in range(REDUCTION.most_blocks):
            start = np.zeros((space.complete, len(shifts)))
            start[: len(space.start)] = (space.start / weights)[: space.complete]
            values, vectors = np.linalg.eigh(space.projected)
            answers = vectors @ ((vectors.T @ start) / (1.0 - shifts * values[:, None]))
            if space.complete:
                energies = energies_without_space + shifts * np.einsum(
                    "ij,ij->j", answers, 2.0 * start + shifts * (space.projected @ answers)
                )
                largest = np.sqrt(max(np.max(shifts * energies), 0.0))
                if np.max(reach * space.residual_norms(answers)) <= self.tolerance * largest:
                    solution = unshifted + shifts * space.image_of(answers)
                    solution -= normal @ inner(mass_normal, solution)
                    return np.hstack([static, solution + truncated @ shares]), iteration
            if space.invariant:
                break
            space.grow()
        raise RuntimeError(
            "reduction: the adjoint of the normal modes did not converge in "
            f"{REDUCTION.most_blocks} iterations (relative gap to the first frequency left "
            f"out {basis.spectral_gap:.1e}); "
            "choose a number of modes that does not cut through close frequencies"
        )
