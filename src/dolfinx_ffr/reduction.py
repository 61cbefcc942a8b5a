# SPDX-License-Identifier: MIT
"""Craig-Bampton reduction of one body: shape functions by SLEPc, and the derivative of their span.

Interfaces move as rigid bodies. With the interfaces' nodes held, K and M below are the matrices of
the remaining (interior) dofs.

- Constraint modes psi_k: K psi_k = 0 in the interior, unit rigid motion on one interface, zero on
  the others. A frame of reference drops the motions that it fixes.
- Fixed-interface normal modes phi_i: K phi_i = lambda_i M phi_i, phi_i^T M phi_i = 1.

K is factored once for each density (CHOLMOD on one rank, MUMPS on several) and serves the
constraint modes, the eigenvalue problem (shift-invert about zero) and the pullback.

References:
    R. R. Craig and M. C. C. Bampton, AIAA Journal 6 (1968), doi:10.2514/3.4741.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Protocol

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray
from slepc4py import SLEPc

from .domain import Domain
from .elasticity import Block, Elasticity, rigid_fields

__all__ = ["ChordFrame", "CraigBampton", "Frame", "ReducedBasis", "TangentFrame"]

#: relative distance below which neighbouring eigenvalues count as one cluster
CLUSTER = 1e-3


class Frame(Protocol):
    """Reference conditions: which rigid motions of interfaces the body's frame takes over."""

    def origin(self, domain: Domain) -> NDArray[np.float64]:
        """Return the frame's origin in the undeformed ``domain``, shape (2,) [m]."""
        ...

    def retained(self, domain: Domain) -> dict[str, NDArray[np.float64]]:
        """Return the elastic motions (u_x, u_y, rotation), (k, 3) by interface of ``domain``."""
        ...


def _interface(domain: Domain, name: str, frame: str) -> None:
    if name not in domain.interfaces:
        raise ValueError(
            f"{frame}: the body has no interface {name!r}; it has {sorted(domain.interfaces)}"
        )


@dataclass(frozen=True)
class TangentFrame:
    """Frame fixed to one interface, whose three rigid motions are dropped.

    Args:
        interface: name of the interface.
    """

    interface: str

    def origin(self, domain: Domain) -> NDArray[np.float64]:
        """Return the center of the interface of ``domain``, shape (2,) [m]."""
        _interface(domain, self.interface, "tangent frame")
        return domain.interfaces[self.interface].center

    def retained(self, domain: Domain) -> dict[str, NDArray[np.float64]]:
        """Return all motions of the other interfaces of ``domain``."""
        _interface(domain, self.interface, "tangent frame")
        return {name: np.eye(3) for name in domain.interfaces if name != self.interface}


@dataclass(frozen=True)
class ChordFrame:
    """Frame with its origin in one interface and its axis through another.

    Dropped are both displacements of the first interface and the second one's displacement
    perpendicular to the chord.

    Args:
        start: interface in the origin.
        end: interface on the axis.
    """

    start: str
    end: str

    def origin(self, domain: Domain) -> NDArray[np.float64]:
        """Return the center of the first interface of ``domain``, shape (2,) [m]."""
        _interface(domain, self.start, "chord frame")
        return domain.interfaces[self.start].center

    def retained(self, domain: Domain) -> dict[str, NDArray[np.float64]]:
        """Return rotations, the stretch of the chord, and all others of ``domain``."""
        for name in (self.start, self.end):
            _interface(domain, name, "chord frame")
        chord = domain.interfaces[self.end].center - domain.interfaces[self.start].center
        length = float(np.linalg.norm(chord))
        size = float(np.max(np.ptp(domain.bounding_box, axis=0)))
        if self.start == self.end or length <= 1e-9 * size:
            raise ValueError(
                f"chord frame: the interfaces {self.start!r} and {self.end!r} have the same "
                f"center, "
                "which leaves the angle of the frame undetermined; use TangentFrame or two "
                "interfaces apart"
            )
        motions = {name: np.eye(3) for name in domain.interfaces}
        motions[self.start] = np.array([[0.0, 0.0, 1.0]])
        direction = chord / length
        motions[self.end] = np.array([[direction[0], direction[1], 0.0], [0.0, 0.0, 1.0]])
        return motions


@dataclass(frozen=True)
class ReducedBasis:
    """Shape functions of one body at one density."""

    shapes: Block  #: (dofs of this rank, r) constraint modes, then normal modes [-]
    n_constraint: int  #: number of constraint modes
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

    Args:
        elasticity: stiffness and mass of the body.
        frame: reference conditions, `ChordFrame` or `TangentFrame`.
        modes: number of normal modes.
        tolerance: relative residual of the eigenvalue problem, and of the adjoint systems.

    Raises:
        ValueError: on every rank, if the frame names an interface that is not there or leaves the
            frame undetermined, or if there are more modes than interior degrees of freedom.
    """

    def __init__(
        self, elasticity: Elasticity, frame: Frame, modes: int, *, tolerance: float = 1e-11
    ) -> None:
        self.elasticity = elasticity
        self.frame = frame
        self.modes = int(modes)
        self.tolerance = tolerance
        domain = elasticity.domain
        self.origin = frame.origin(domain)
        self.motions = frame.retained(domain)
        n = elasticity.n_dofs
        self.held = np.zeros(n, dtype=bool)
        for interface in domain.interfaces.values():
            nodes = interface.dofs[interface.dofs < n // 2]
            self.held[2 * nodes] = self.held[2 * nodes + 1] = True
        free = elasticity.comm.allreduce(int(n - np.count_nonzero(self.held)))
        if not 0 <= self.modes < free:
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
        self._start = _smooth_field(coordinates, domain.bounding_box)
        self._start[self.held] = 0.0
        self._held_rows = np.flatnonzero(self.held).astype(np.int32)
        #: the matrices with all interfaces held: one and zero on the diagonal of held rows
        self.held_stiffness: PETSc.Mat = elasticity.stiffness.duplicate()
        self.held_mass: PETSc.Mat = elasticity.mass.duplicate()
        self._ksp = PETSc.KSP().create(elasticity.comm)
        self._ksp.setType("preonly")
        pc = self._ksp.getPC()
        pc.setType("cholesky")
        pc.setFactorSolverType(_direct_solver(elasticity.comm.size))
        self._ksp.setErrorIfNotConverged(True)
        self._eps: SLEPc.EPS | None = None

    def _lift(self, domain: Domain) -> Block:
        """Return the retained interface motions as fields that vanish off their interface."""
        coordinates = self.elasticity.coordinates()
        columns = []
        for name, motions in self.motions.items():
            interface = domain.interfaces[name]
            nodes = interface.dofs[interface.dofs < len(coordinates)]
            rigid = rigid_fields(coordinates, interface.center) @ motions.T
            field_ = np.zeros_like(rigid)
            for rows in (2 * nodes, 2 * nodes + 1):
                field_[rows] = rigid[rows]
            columns.append(field_)
        return np.hstack(columns) if columns else np.zeros((2 * len(coordinates), 0))

    def interface_motion(self, name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return displacement and rotation shape functions at an interface's center.

        They do not depend on the density.

        Args:
            name: of the interface.

        Returns:
            Phi_P of shape (2, r) [-] and Psi_P of shape (r,) [1/m], r constraint and normal modes.
        """
        r = self.n_constraint + self.modes
        motion = np.zeros((3, r))
        column = 0
        for interface, motions in self.motions.items():
            if interface == name:
                motion[:, column : column + len(motions)] = motions.T
            column += len(motions)
        return motion[:2], motion[2]

    # ------------------------------------------------------------------ forward

    def factor(self) -> None:
        """Hold the interfaces in the assembled matrices and factor the stiffness.

        Raises:
            RuntimeError: on every rank, if the held stiffness is singular.
        """
        for source, target, diagonal in (
            (self.elasticity.stiffness, self.held_stiffness, 1.0),
            (self.elasticity.mass, self.held_mass, 0.0),
        ):
            source.copy(target, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
            target.zeroRowsColumnsLocal(self._held_rows, diagonal)
        if self._eps is not None:
            # it shares the factor with us, and takes it along when it goes
            self._eps.destroy()
            self._eps = None
        self._ksp.setOperators(self.held_stiffness)
        try:
            self._ksp.setUp()
        except PETSc.Error as error:
            raise RuntimeError(
                "reduction: the stiffness with all interfaces held is singular: a part of the body "
                "can move without strain (nodes joined in one point only, or a void without floor)"
            ) from error

    def solve(self, block: Block) -> Block:
        """Return K^{-1} times block with all interfaces held, several right-hand sides at once."""
        if block.shape[1] == 0:
            return np.zeros_like(block)
        right = self.elasticity.dense(block)
        left = self.elasticity.dense(np.zeros_like(block))
        self._ksp.getPC().getFactorMatrix().matSolve(right, left)
        result = np.array(left.getDenseArray())
        right.destroy()
        left.destroy()
        return result

    def basis(self) -> ReducedBasis:
        """Return the shape functions at the density that is assembled.

        Warns:
            UserWarning: if the number of modes cuts through a cluster of frequencies.

        Raises:
            RuntimeError: on every rank, if a solver fails.
        """
        self.factor()
        load = self.elasticity.apply(self.elasticity.stiffness, self._lifted)
        load[self.held] = 0.0
        constraint = self._lifted - self.solve(load)
        eigenvalues, normal = self._normal_modes()
        self._warn_about_cluster(eigenvalues)
        n = self.modes
        mass_normal = self.elasticity.apply(self.held_mass, normal) if n else normal
        return ReducedBasis(
            shapes=np.hstack([constraint, normal[:, :n]]),
            n_constraint=self.n_constraint,
            eigenvalues=eigenvalues[:n],
            mass_times_normal=mass_normal[:, :n],
            outer_eigenvalues=eigenvalues[n:],
            outer_modes=normal[:, n:],
            mass_times_outer=mass_normal[:, n:],
        )

    def _normal_modes(self) -> tuple[NDArray[np.float64], Block]:
        """Return the converged eigenpairs, at least one beyond the modes kept, ascending."""
        if self.modes == 0:
            return np.zeros(0), np.zeros((self.elasticity.n_dofs, 0))
        eps = SLEPc.EPS().create(self.elasticity.comm)
        self._eps = eps
        eps.setOperators(self.held_stiffness, self.held_mass)
        eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
        eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        eps.setTarget(0.0)
        eps.setDimensions(self.modes + 1)
        eps.setTolerances(self.tolerance, 200)
        transform = eps.getST()
        transform.setType(SLEPc.ST.Type.SINVERT)
        transform.setShift(0.0)
        transform.setKSP(self._ksp)
        # SLEPc's purification stays on: where there is void there is no mass, and round-off of the
        # Krylov space grows there without bound as modes become many
        start = self.held_stiffness.createVecRight()
        start.setArray(self._start)
        eps.setInitialSpace([start])
        eps.solve()
        converged = eps.getConverged()
        if converged < self.modes + 1:
            raise RuntimeError(
                f"reduction: only {converged} of {self.modes + 1} normal modes converged in "
                f"{eps.getIterationNumber()} iterations; the mesh may be too coarse for so "
                "many modes, or the design may have fallen apart"
            )
        vector = self.held_stiffness.createVecRight()
        eigenvalues = np.empty(converged)
        vectors = np.empty((self.elasticity.n_dofs, converged))
        for i in range(converged):
            eigenvalues[i] = eps.getEigenpair(i, vector).real
            vectors[:, i] = vector.getArray()
        order = np.argsort(eigenvalues, kind="stable")
        vectors = vectors[:, order]
        # the held rows have no mass: what the solver leaves there has no meaning
        vectors[self.held] = 0.0
        return eigenvalues[order], vectors

    def _warn_about_cluster(self, eigenvalues: NDArray[np.float64]) -> None:
        gaps = np.diff(eigenvalues) / eigenvalues[1:]
        if self.modes == 0 or len(gaps) < self.modes or gaps[self.modes - 1] >= CLUSTER:
            return
        wide = np.flatnonzero(gaps >= CLUSTER) + 1
        better = [int(k) for k in wide if k != self.modes]
        advice = (
            f"take modes = {min(better, key=lambda k: abs(k - self.modes))}"
            if better
            else ("take a few more or fewer")
        )
        pair = np.sqrt(eigenvalues[self.modes - 1 : self.modes + 1]) / (2 * np.pi)
        warnings.warn(
            f"reduction: modes = {self.modes} cuts through a cluster of frequencies "
            f"({pair[0]:.6g} and {pair[1]:.6g} Hz): the gradient is ill-defined; {advice}",
            stacklevel=4,
        )

    # ------------------------------------------------------------------ pullback

    def pullback(self, basis: ReducedBasis, shapes_bar: Block) -> Pullback:
        """Return the fields through which the span of the shape functions depends on the density.

        Psi must not depend on the choice of basis within the span. With
        K z_k = -Phi_bar_k for the constraint modes, and
        (K - lambda_i M) z_i = -(Phi_bar_i projected off the retained modes), z_i M-orthogonal to
        them, the derivative of psi is  sum_k z_k^T dK psi_k + sum_i z_i^T (dK - lambda_i dM) phi_i.
        The second systems are solved together by conjugate gradients, preconditioned with the
        factor of K and deflated by the retained modes.

        Args:
            basis: the shape functions, from `basis` at the density that is still assembled.
            shapes_bar: derivative of psi with respect to the shape functions at fixed K and M,
                shape (dofs, r).

        Returns:
            The adjoint fields and how long the iteration took.

        Raises:
            RuntimeError: on every rank, if the iteration does not converge.
        """
        right = -shapes_bar
        right[self.held] = 0.0
        fields = np.zeros_like(right)
        k = basis.n_constraint
        fields[:, :k] = self.solve(right[:, :k])
        fields[:, k:], iterations = self.solve_shifted(basis, right[:, k:], basis.eigenvalues)
        return Pullback(fields, iterations)

    def solve_shifted(
        self, basis: ReducedBasis, right: Block, shifts: NDArray[np.float64]
    ) -> tuple[Block, int]:
        """Solve (K - shift_j M) z_j = right_j on the complement of the retained modes.

        All columns go through the conjugate gradients side by side, so that the factor serves
        several right-hand sides at once; a column that has converged stays as it is. Along the
        modes that the eigenvalue solver found beyond the retained ones the solution is known.

        Args:
            basis: the shape functions, from `basis` at the density that is still assembled.
            right: right-hand sides, zero where the body is held, shape (dofs, columns); their part
                along the retained modes is projected off.
            shifts: retained eigenvalues, one a column, shape (columns,) [rad^2/s^2].

        Returns:
            Solutions M-orthogonal to the retained modes, shape (dofs, columns), and the number of
            iterations.

        Raises:
            RuntimeError: on every rank, if the iteration does not converge.
        """
        inner = self.elasticity.inner
        if right.shape[1] == 0:
            return np.zeros_like(right), 0
        outer = basis.outer_modes
        solution = outer @ (inner(outer, right) / (basis.outer_eigenvalues[:, None] - shifts))
        normal = np.hstack([basis.shapes[:, basis.n_constraint :], outer])
        mass_normal = np.hstack([basis.mass_times_normal, basis.mass_times_outer])
        residual = right - mass_normal @ inner(normal, right)
        active = np.arange(right.shape[1])
        direction = np.zeros_like(right)
        energy = np.ones(right.shape[1])
        target = np.zeros(right.shape[1])
        for iteration in range(MAX_ITERATIONS):
            z = self.solve(residual[:, active])
            z -= normal @ inner(mass_normal, z)
            new_energy = self._column_products(residual[:, active], z)
            if iteration == 0:
                target = self.tolerance**2 * np.abs(new_energy)
                beta = np.zeros(len(active))
            else:
                beta = new_energy / energy[active]
            energy[active] = new_energy
            open_ = new_energy > target[active]
            direction[:, active] = z + beta * direction[:, active]
            active = active[open_]
            if len(active) == 0:
                return solution, iteration
            d = direction[:, active]
            image = self.elasticity.apply(self.held_stiffness, d)
            image -= shifts[active] * self.elasticity.apply(self.held_mass, d)
            # the images lie off the modes' range only up to round-off, which would grow
            image -= mass_normal @ inner(normal, image)
            curvature = self._column_products(d, image)
            if np.any(curvature <= 0.0):
                break
            step = energy[active] / curvature
            solution[:, active] += step * d
            residual[:, active] -= step * image
        raise RuntimeError(
            f"reduction: the adjoint of the normal modes did not converge in {MAX_ITERATIONS} "
            f"iterations (relative gap to the first frequency left out {basis.outer_gap:.1e}); "
            "choose a number of modes that does not cut through close frequencies"
        )

    def _column_products(self, a: Block, b: Block) -> NDArray[np.float64]:
        return self.elasticity.sum(np.einsum("ij,ij->j", a, b))


def _direct_solver(ranks: int) -> str:
    """Return the library that factors K: CHOLMOD solves faster, but runs on one rank only."""
    packages = ("cholmod", "suitesparse")  # PETSc's name for it depends on how it was built
    if ranks == 1 and any(map(PETSc.Sys.hasExternalPackage, packages)):
        return "cholmod"
    return "mumps"


#: conjugate gradient iterations after which the pullback gives up
MAX_ITERATIONS = 500


@dataclass(frozen=True)
class Pullback:
    """Adjoint fields of the shape functions."""

    fields: Block  #: (dofs of this rank, r) z of constraint modes, then of normal modes
    iterations: int  #: conjugate gradient iterations


def _smooth_field(
    coordinates: NDArray[np.float64], box: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a field without symmetries that does not depend on the mesh's partition.

    Starting the eigenvalue solver from it gives the same modes on any number of ranks.
    """
    s = (coordinates - box[0]) / np.ptp(box, axis=0).max()
    field_ = np.empty((len(s), 2))
    field_[:, 0] = np.sin(7.3 * s[:, 0] + 0.4) + np.cos(23.1 * s[:, 0] + 17.9 * s[:, 1] + 1.1)
    field_[:, 1] = np.cos(5.1 * s[:, 0] + 0.7) + np.sin(19.7 * s[:, 0] - 29.3 * s[:, 1] + 0.3)
    return field_.ravel()
