# SPDX-License-Identifier: MIT
"""Craig-Bampton reduction of one body: shape functions, and the derivative of their span.

Interfaces move as rigid bodies. With the interfaces' nodes held, K and M below are the matrices of
the remaining (interior) dofs.

- Constraint modes psi_k: K psi_k = 0 in the interior, unit rigid motion on one interface, zero on
  the others. A frame of reference drops the motions that it fixes.
- Fixed-interface normal modes phi_i: K phi_i = lambda_i M phi_i, phi_i^T M phi_i = 1.

K is factored once for each density (`direct_solver`) and serves the constraint modes, the
eigenvalue problem (`normal_modes`) and the pullback, all of them several columns at a time; of
bodies whose factor is too large multigrid takes its place (`multigrid`).

References:
    R. R. Craig and M. C. C. Bampton, AIAA Journal 6 (1968), doi:10.2514/3.4741.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..fem import Block, Domain, Elasticity, Matrices, kept_by, rigid_fields, rotated
from .factored_body import FactoredBody, HeldMatrices
from .frame import Frame
from .inertia import InertiaCount
from .krylov import KrylovSpace
from .linear_solver import DIRECT, SOLVERS
from .multigrid import MultigridSolver
from .normal_modes import CLUSTER, EigenSolver, NormalModes, cluster

__all__ = ["CraigBampton", "ReducedBasis"]

#: Bounds of the solvers' tolerance: round-off leaves no less, and beyond no digit would be right.
TIGHTEST, LOOSEST = 1e-14, 1e-2
#: Relative round-off of eigenvalues at least
ROUND_OFF = 1e-14


@dataclass(frozen=True)
class ReducedBasis:
    """Shape functions of one body at one density."""

    shapes: Block  #: (dofs of this rank, r) constraint modes, then normal modes [-]
    n_constraint: int  #: Number of constraint modes
    eigenvalues: NDArray[np.float64]  #: (modes,) fixed-interface lambda_i [rad^2/s^2]
    mass_times_normal: Block = field(repr=False)  #: (dofs, modes) M phi_i, interior
    #: (k,) eigenvalues that follow: found with the others, but left out [rad^2/s^2]
    outer_eigenvalues: NDArray[np.float64]
    outer_modes: Block = field(repr=False)  #: (dofs, k) their modes
    mass_times_outer: Block = field(repr=False)  #: (dofs, k) M times them, interior

    @property
    def frequencies(self) -> NDArray[np.float64]:
        """Fixed-interface natural frequencies, shape (modes,) [Hz]."""
        return np.sqrt(np.maximum(self.eigenvalues, 0.0)) / (2.0 * np.pi)

    @property
    def outer_eigenvalue(self) -> float:
        """The first eigenvalue left out [rad^2/s^2]; inf if no mode was asked for."""
        return float(self.outer_eigenvalues[0]) if len(self.outer_eigenvalues) else np.inf

    @property
    def outer_gap(self) -> float:
        """Relative gap between the last eigenvalue kept and the first one left out."""
        if len(self.eigenvalues) == 0:
            return np.inf
        return self.outer_eigenvalue / float(self.eigenvalues[-1]) - 1.0


class CraigBampton:
    """Constraint modes and fixed-interface normal modes, and the pullback of their span.

    Nothing here belongs to one density: what does is returned (`factor`, `basis`) and handed on.

    Args:
        elasticity: Stiffness and mass of the body.
        frame: Reference conditions, `ChordFrame` or `TangentFrame`.
        modes: Number of normal modes.
        tolerance: Largest residual of a mode, relative to it, and error of its adjoint field,
            relative to the largest (`CraigBampton.solve_shifted`). What that leaves in a gradient
            is smaller by some three digits.
        solver: ``"direct"``, by factors of the stiffness, or ``"iterative"``, by conjugate
            gradients with multigrid (`FlexibleBody`).

    Raises:
        ValueError: On every rank, if the frame names an interface that is not there or leaves the
            frame undetermined, or if there are more modes than interior degrees of freedom.
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
        validation.number("body: tolerance", tolerance, least=TIGHTEST, most=LOOSEST)
        self.elasticity = elasticity
        self.frame = frame
        self.modes = validation.integer("reduction: modes", modes, least=-np.inf)
        self.tolerance = tolerance
        self.solver = validation.choice("body: solver", solver, SOLVERS)
        domain = elasticity.domain
        self.origin = frame.origin(domain)
        self.motions = frame.retained(domain)
        n = elasticity.n_dofs
        self.held = np.zeros(n, dtype=bool)
        for interface in domain.interfaces.values():
            self.held[elasticity.dofs_of(interface.dofs)] = True
        self._inertia = InertiaCount(elasticity)
        #: Of a density before, for the next one: at most one
        self._spare: list[HeldMatrices] = kept_by(self, elasticity.comm)
        self._eigensolver = EigenSolver(elasticity, self.held, tolerance)
        free = self._eigensolver.freedoms
        self.most_modes = free - 1  #: Normal modes that the body can have at most
        if not 0 <= self.modes <= self.most_modes:
            raise ValueError(
                f"reduction: modes = {modes} must be between 0 and {free - 1}: the mesh has {free} "
                "degrees of freedom inside the interfaces; take fewer modes or a finer mesh"
            )
        self._lifted = self._lift(domain)
        self.n_constraint = self._lifted.shape[1]
        if self.n_constraint + self.modes == 0:
            raise ValueError("reduction: no shape functions at all; take at least one normal mode")
        coordinates = elasticity.coordinates()
        self.reference = (coordinates - self.origin).ravel()  #: w_0 of this rank's dofs [m]
        self._held_rows = np.flatnonzero(self.held).astype(np.int32)

    def __reduce__(self) -> tuple[Callable[..., CraigBampton], tuple[Any, ...]]:
        """How pickle and copy make it anew."""
        made = partial(type(self), tolerance=self.tolerance, solver=self.solver)
        return made, (self.elasticity, self.frame, self.modes)

    def _lift(self, domain: Domain) -> Block:
        """The retained interface motions as fields that vanish off their interface."""
        coordinates = self.elasticity.coordinates()
        columns = []
        for name, motions in self.motions.items():
            interface = domain.interfaces[name]
            rigid = rigid_fields(coordinates, interface.center) @ motions.T
            field_ = np.zeros_like(rigid)
            rows = self.elasticity.dofs_of(interface.dofs)
            field_[rows] = rigid[rows]
            columns.append(field_)
        return np.hstack(columns) if columns else np.zeros((coordinates.size, 0))

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

    def interface_motion(self, name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Displacement and rotation of the constraint modes at an interface's center.

        They do not depend on the density. Normal modes leave interfaces where they are.

        Args:
            name: Of the interface.

        Returns:
            Phi_P of shape (2, k) [-] and Psi_P of shape (k,) [1/m] of k constraint modes; in space
            both of shape (3, k).
        """
        d = self.elasticity.dimension
        motion = np.zeros((3 * d - 3, self.n_constraint))
        column = 0
        for interface, motions in self.motions.items():
            if interface == name:
                motion[:, column : column + len(motions)] = motions.T
            column += len(motions)
        return motion[:d], motion[2] if d == 2 else motion[d:]

    # ------------------------------------------------------------------ forward

    def factor(self, matrices: Matrices) -> FactoredBody:
        """The matrices with all interfaces held, and the factor of the stiffness.

        Args:
            matrices: Of the body at one density.

        Raises:
            RuntimeError: On every rank, if the held stiffness is singular.
        """
        try:
            held = self._filled(matrices)
        except PETSc.Error as error:
            matrices.destroy()
            raise RuntimeError(
                "reduction: the stiffness with all interfaces held is singular: a part of the body "
                "can move without strain (nodes joined in one point only, or a void without floor)"
            ) from error
        return FactoredBody(self.elasticity, matrices, self._inertia, [held], self._spare)

    def _filled(self, matrices: Matrices) -> HeldMatrices:
        """The matrices with all interfaces held, with an ordering from before if there is one."""
        while True:
            used = bool(self._spare)
            held = self._spare.pop() if used else self._new_matrices()
            try:
                held.fill(matrices, self._held_rows)
                return held
            except PETSc.Error:
                held.destroy()
                if not used:  # else a new ordering may do
                    raise

    def _new_matrices(self) -> HeldMatrices:
        return HeldMatrices.of(self.elasticity, self.held, self.solver, self.tolerance)

    def basis(self, factored: FactoredBody) -> ReducedBasis:
        """The shape functions at one density.

        Args:
            factored: The body at this density.

        Warns:
            UserWarning: If the number of modes cuts through a cluster of frequencies.

        Raises:
            RuntimeError: On every rank, if a solver fails.
        """
        load = self.elasticity.apply(factored.matrices.stiffness, self._lifted)
        load[self.held] = 0.0
        constraint = self._lifted - factored.solve(load)
        n = self.modes
        eigenvalues, normal = np.zeros(0), np.zeros((self.elasticity.n_dofs, 0))
        if n:
            found = self._eigensolver.lowest(factored, n)
            self._warn_about_cluster(found)
            eigenvalues, normal = found.eigenvalues, found.fields
        mass_normal = self.elasticity.apply(factored.held_mass, normal) if n else normal
        return ReducedBasis(
            shapes=np.hstack([constraint, normal[:, :n]]),
            n_constraint=self.n_constraint,
            eigenvalues=eigenvalues[:n],
            mass_times_normal=mass_normal[:, :n],
            outer_eigenvalues=eigenvalues[n:],
            outer_modes=normal[:, n:],
            mass_times_outer=mass_normal[:, n:],
        )

    def _warn_about_cluster(self, found: NormalModes) -> None:
        if self.modes in found.cluster_bounds:
            return
        possible = range(1, self._eigensolver.freedoms)
        advice = " or ".join(str(number) for number in found.cluster_bounds if number in possible)
        pair = np.sqrt(found.eigenvalues[self.modes - 1 : self.modes + 1]) / (2 * np.pi)
        warnings.warn(
            f"reduction: modes = {self.modes} cuts through a cluster of frequencies "
            f"({pair[0]:.6g} and {pair[1]:.6g} Hz): psi and its gradient depend on how the solver "
            f"tells them apart, and where it cannot the gradient is refused; take modes = {advice}",
            stacklevel=4,
        )

    def check_gap(self, factored: FactoredBody, basis: ReducedBasis) -> None:
        """Refuse modes whose span has no derivative: others, left out, have the same frequency.

        Across a relative gap g the round-off r of the eigenvalues, relative to them, leaves a share
        r / g of the first mode left out in the last one kept; where the density changes, the span
        turns by 1 / g. So the gradient is wrong by r / g^2 of its size, and below g = sqrt(r), 1e-7
        with most bodies, it has no digit.

        Args:
            factored: The body at one density.
            basis: Its shape functions.

        Raises:
            RuntimeError: On every rank, if the modes cannot be told apart.
        """
        if basis.outer_gap >= CLUSTER:
            return
        n = len(basis.eigenvalues)
        values = np.array([basis.eigenvalues[-1], basis.outer_eigenvalue])
        pair = np.hstack([basis.shapes[:, -1:], basis.outer_modes[:, :1]])
        image = self.elasticity.apply(factored.held_stiffness, pair)
        off = np.abs(self.elasticity.inner(pair, image) - np.diag(values)) / values[0]
        reach = np.sqrt(max(float(np.max(off)), ROUND_OFF))
        if basis.outer_gap >= reach:
            return
        uncut = cluster(np.append(basis.eigenvalues, basis.outer_eigenvalues), n)
        advice = " or ".join(str(k) for k in uncut if 0 < k < self._eigensolver.freedoms)
        raise RuntimeError(
            f"reduction: modes = {n} cuts through modes of the same frequency "
            f"({basis.frequencies[-1]:.6g} Hz, relative gap {basis.outer_gap:.1e}, and round-off "
            f"reaches to {reach:.0e}): there is no gradient; take modes = {advice}"
        )

    # ------------------------------------------------------------------ pullback

    def pullback(self, factored: FactoredBody, basis: ReducedBasis, shapes_bar: Block) -> Pullback:
        """The fields through which the span of the shape functions depends on the density.

        Psi must not depend on the choice of basis within the span. With
        K z_k = -Phi_bar_k for the constraint modes, and
        (K - lambda_i M) z_i = -(Phi_bar_i projected off the retained modes), z_i M-orthogonal to
        them, the derivative of psi is  sum_k z_k^T dK psi_k + sum_i z_i^T (dK - lambda_i dM) phi_i.
        The second systems are solved together in one block Krylov space (`solve_shifted`).

        Args:
            factored: The body at one density.
            basis: Its shape functions.
            shapes_bar: Derivative of psi with respect to the shape functions at fixed K and M,
                shape (dofs, r).

        Returns:
            The adjoint fields and how long the iteration took.

        Raises:
            RuntimeError: On every rank, if the iteration does not converge, or as `check_gap` does.
        """
        self.check_gap(factored, basis)
        right = -shapes_bar
        right[self.held] = 0.0
        k = basis.n_constraint
        adjoint, iterations = self.solve_shifted(factored, basis, right[:, k:], basis.eigenvalues)
        return Pullback(np.hstack([factored.solve(right[:, :k]), adjoint]), iterations)

    def solve_shifted(
        self,
        factored: FactoredBody,
        basis: ReducedBasis,
        right: Block,
        shifts: NDArray[np.float64],
    ) -> tuple[Block, int]:
        """Solve (K - shift_j M) z_j = right_j on the complement of the retained modes.

        With T = K^-1 M and z_0 = K^-1 right all solutions lie near one block Krylov space V of T
        that grows from all z_0: Galerkin's method for (1 - shift_j T) z_j = z_0j gives V y_j, and
        z_j = z_0j + shift_j T V y_j. Its error in the norm of K is at most
        shift_j / (1 - shift_j / lambda) / sqrt(lambda) times the norm by mass of z_j - V y_j, with
        the first eigenvalue lambda that the space does not know. Along the modes that the
        eigenvalue solver found beyond the retained ones the solution is known. Without a factor,
        conjugate gradients solve each system.

        Args:
            factored: The body at one density.
            basis: Its shape functions.
            right: Right-hand sides, zero where the body is held, shape (dofs, columns); their part
                along the retained modes is projected off.
            shifts: Retained eigenvalues, one a column, shape (columns,) [rad^2/s^2].

        Returns:
            Solutions M-orthogonal to the retained modes, shape (dofs, columns), and the number of
            blocks or iterations. The error of each in the norm of K is at most the tolerance times
            the largest norm of all solutions, both times the square roots of their shifts: where
            the columns are those of `pullback`, that bounds the error of the gradient relative to
            the largest part of it.

        Raises:
            RuntimeError: On every rank, if the iteration does not converge.
        """
        inner = self.elasticity.inner
        if right.shape[1] == 0:
            return np.zeros_like(right), 0
        outer, outer_values = basis.outer_modes, basis.outer_eigenvalues
        shares = inner(outer, right) / (outer_values[:, None] - shifts)
        normal = np.hstack([basis.shapes[:, basis.n_constraint :], outer])
        mass_normal = np.hstack([basis.mass_times_normal, basis.mass_times_outer])
        loads = right - mass_normal @ inner(normal, right)
        if isinstance(factored.held.solver, MultigridSolver):
            matrices = factored.held_stiffness, factored.held_mass
            solution, iterations = factored.held.solver.solve_shifted(
                matrices, loads, shifts, (normal, mass_normal)
            )
            return solution + outer @ shares, iterations
        first = factored.solve(loads)
        first -= normal @ inner(mass_normal, first)
        known = self._column_products(first, loads) + outer_values @ shares**2
        reach = shifts**2.5 / (1.0 - shifts / outer_values[-1]) / np.sqrt(outer_values[-1])
        # directions whose bound is a tenth of what is allowed are not followed
        allowed = self.tolerance * np.sqrt(np.max(shifts * known))
        floor = 0.1 * allowed / float(np.max(reach / shifts, initial=0.0))
        without = normal, mass_normal
        space = KrylovSpace(factored, first, without, answers=True, floor=floor)
        if space.invariant:  # nothing to solve for
            return first + outer @ shares, 0
        for iteration in range(MAX_ITERATIONS):
            start = space.start[: space.complete]
            start = np.pad(start, ((0, space.complete - len(start)), (0, 0)))
            values, vectors = np.linalg.eigh(space.projected)
            answers = vectors @ ((vectors.T @ start) / (1.0 - shifts * values[:, None]))
            if space.complete:
                energies = known + shifts * np.einsum(
                    "ij,ij->j", answers, 2.0 * start + shifts * (space.projected @ answers)
                )
                largest = np.sqrt(max(np.max(shifts * energies), 0.0))
                if np.max(reach * space.leaving(answers)) <= self.tolerance * largest:
                    solution = first + shifts * (space.answers @ answers)
                    solution -= normal @ inner(mass_normal, solution)
                    return solution + outer @ shares, iteration
            if space.invariant:
                break
            space.grow()
        raise RuntimeError(
            f"reduction: the adjoint of the normal modes did not converge in {MAX_ITERATIONS} "
            f"iterations (relative gap to the first frequency left out {basis.outer_gap:.1e}); "
            "choose a number of modes that does not cut through close frequencies"
        )

    def _column_products(self, a: Block, b: Block) -> NDArray[np.float64]:
        return self.elasticity.sum(np.einsum("ij,ij->j", a, b))


#: Blocks after which the pullback gives up
MAX_ITERATIONS = 100


@dataclass(frozen=True)
class Pullback:
    """Adjoint fields of the shape functions."""

    fields: Block  #: (dofs of this rank, r) z of constraint modes, then of normal modes
    iterations: int  #: Blocks of the Krylov space, or conjugate gradient iterations
