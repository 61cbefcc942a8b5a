# SPDX-License-Identifier: MIT
"""The lowest fixed-interface normal modes of a body, with all copies of repeated frequencies.

They are found in a block Krylov space of K^-1 M: two vectors at a time cost little more than one,
and what is known of K^-1 M in the space leaves eigenvectors clean at no further solution. A space
that grows from two vectors holds two vectors of each eigenspace: further copies of an eigenvalue
come in by round-off, late or not at all. Bodies with symmetries have pairs, equal blades on a rigid
hub as many copies as there are blades. So what is found is certified by counting: by Sylvester's
law of inertia the factor of K - sigma M has as many negative pivots as there are eigenvalues below
sigma. As long as some are missing, SLEPc's Krylov-Schur method goes on from a scattered start in
the complement of what has been found. It also takes over where the space would grow too large.

Without a factor, by multigrid, a block of scattered fields is iterated, which holds as many copies
as it has fields; nothing is counted then.

References:
    R. G. Grimes, J. G. Lewis, H. D. Simon, A shifted block Lanczos algorithm for solving sparse
    symmetric generalized eigenproblems, SIAM Journal on Matrix Analysis and Applications 15 (1994),
    doi:10.1137/S0895479888151111.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from petsc4py import PETSc

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from slepc4py import SLEPc

from ..fem import Block, Elasticity
from .factored_body import FactoredBody
from .krylov import KrylovSpace
from .multigrid import MultigridSolver

__all__ = ["CLUSTER", "EigenSolver", "NormalModes", "cluster"]

#: Relative distance below which neighbouring eigenvalues count as one cluster. A kept mode holds a
#: share of about solver tolerance / distance of the first one left out: a thousandth at 1e-6
CLUSTER = 1e-3
#: How far below the first eigenvalue left out is counted, relative to it: more than the round-off
#: of ill-conditioned bodies
ROOM = 1e-2
#: Vectors of a block: more of them make larger spaces
BLOCK = 2
#: Most vectors of a space, and how many more for each mode
MOST, MOST_EACH = 100, 6
#: Share by which a space grows between two looks at its modes
LOOK = 1 / 16
#: Fields that are iterated beyond those asked for, without a factor: the last ones converge slowly
GUARDS = 2


@dataclass(frozen=True)
class NormalModes:
    """Eigenpairs of a body with all interfaces held, ascending, none left out below the last."""

    eigenvalues: NDArray[np.float64]  #: (k,) lambda_i [rad^2/s^2]
    fields: Block = field(repr=False)  #: (dofs of this rank, k) phi_i, phi_i^T M phi_i = 1
    #: Numbers of modes that keep the cluster around the last mode asked for together: the largest
    #: below the number asked for, and the least that is not below it
    cluster_bounds: tuple[int, int]


class EigenSolver:
    """Lowest eigenpairs of K phi = lambda M phi with all interfaces held.

    Nothing here belongs to one density.

    Args:
        elasticity: The body.
        held: Whether a dof of this rank belongs to an interface, shape (dofs,).
        tolerance: Relative residual.
    """

    def __init__(self, elasticity: Elasticity, held: NDArray[np.bool_], tolerance: float) -> None:
        self.elasticity = elasticity
        self.tolerance = tolerance
        self._held = held
        free = int(np.count_nonzero(~held))
        self.freedoms = elasticity.comm.allreduce(free)  #: Number of dofs that are not held
        box = elasticity.domain.bounding_box
        self._place = (elasticity.coordinates() - box[0]) / np.ptp(box, axis=0).max()
        self._smooth = self._start(_smooth_field(self._place))
        scattered = [self._start(_scattered_field(self._place, k)) for k in range(1, BLOCK)]
        self._block = np.hstack([self._smooth, *scattered])

    def lowest(self, factored: FactoredBody, number: int) -> NormalModes:
        """The lowest modes, and those that follow to the end of the last one's cluster and beyond.

        Args:
            factored: The body at one density.
            number: How many are asked for, at least one.

        Raises:
            RuntimeError: On every rank, if modes do not converge or remain missing.
        """
        iterative = isinstance(factored.held.solver, MultigridSolver)
        # where solutions are approximate, a Krylov space loses its recurrence
        first = None if iterative else self._in_krylov_space(factored, number + 1)
        eigenvalues, fields = first or self._search(factored, self._smooth, number + 1)
        while True:
            last, end = cluster(eigenvalues, number)
            if end == self.freedoms:
                break
            missing, below = len(eigenvalues), np.inf
            if end < len(eigenvalues):
                following = eigenvalues[end]
                below = following - min(0.5 * (following - eigenvalues[end - 1]), ROOM * following)
                missing = 0 if iterative else factored.count_below(below) - end
            if missing == 0:
                break
            # A few at a time: each further copy of the low ones brings the last one asked for, and
            # with it what is missing, further down.
            wanted = min(missing, max(4, number // 4), self.freedoms - len(eigenvalues))
            start = self._start(_scattered_field(self._place, len(eigenvalues)))
            found, others = self._search(factored, start, wanted, fields)
            if not np.any(found < below):
                raise RuntimeError(
                    f"reduction: {end} normal modes were found below "
                    f"{np.sqrt(below) / (2.0 * np.pi):.6g} Hz, and {end + missing} were counted: "
                    "the body is too ill-conditioned to tell; a void with more stiffness, or "
                    "another number of modes, may help"
                )
            eigenvalues, fields = self._ritz(factored, np.hstack([fields, others]))
        return NormalModes(eigenvalues, fields, (last, end))

    def _in_krylov_space(
        self, factored: FactoredBody, number: int
    ) -> tuple[NDArray[np.float64], Block] | None:
        """At least ``number`` eigenpairs, the lowest ones, or None if too many vectors were needed.

        With theta and y of K^-1 M projected on the basis V, K^-1 M V y / theta is the mode: where
        there is void, and in held rows, V holds what the mass does not see, and this does not.
        """
        space = KrylovSpace(factored, self._block, answers=True)
        looked = 0
        while not space.invariant and space.size <= MOST + MOST_EACH * number:
            space.grow()
            if space.complete < max(number, (1.0 + LOOK) * looked):
                continue
            looked = space.complete
            # all ranks decide by the same numbers, to the last bit
            inverses, vectors = self.elasticity.comm.bcast(np.linalg.eigh(space.projected))
            inverses, vectors = inverses[::-1].copy(), vectors[:, ::-1].copy()
            open_ = space.leaving(vectors) > self.tolerance * np.abs(inverses)
            found = int(np.argmax(open_)) if np.any(open_) else len(open_)
            if found >= number:
                # column by column in memory, as what is solved for
                fields = (vectors[:, :found].T @ space.answers.T).T
                return 1.0 / inverses[:found], self._normalized(factored, fields)
        return None

    def _search(
        self, factored: FactoredBody, start: Block, number: int, known: Block | None = None
    ) -> tuple[NDArray[np.float64], Block]:
        """At least ``number`` eigenpairs, the lowest ones in the complement of known ones."""
        if number < 1:
            return np.zeros(0), np.zeros((self.elasticity.n_dofs, 0))
        if isinstance(factored.held.solver, MultigridSolver):
            return self._iterated(factored, factored.held.solver, number, known)
        eps = SLEPc.EPS().create(self.elasticity.comm)
        transform = eps.getST()
        ksp = transform.getKSP()
        vector = factored.held_stiffness.createVecRight()
        starts = _vectors(factored, start)
        deflated = [] if known is None else _vectors(factored, known)
        try:
            eps.setOperators(factored.held_stiffness, factored.held_mass)
            eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
            eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
            eps.setTarget(0.0)
            eps.setDimensions(number)
            eps.setTolerances(self.tolerance, 200)
            transform.setType(SLEPc.ST.Type.SINVERT)
            transform.setShift(0.0)
            ksp.setType("preonly")
            ksp.getPC().setType("python")
            ksp.getPC().setPythonContext(_Solution(factored))
            eps.setPurify(False)  # done below for all at once
            eps.setInitialSpace(starts)
            if deflated:
                eps.setDeflationSpace(deflated)
            eps.solve()
            converged = eps.getConverged()
            if converged < number:
                before = len(deflated)
                raise RuntimeError(
                    f"reduction: only {before + converged} of {before + number} normal modes "
                    f"converged in {eps.getIterationNumber()} iterations; the mesh may be too "
                    "coarse for so many modes, or the design may have fallen apart"
                )
            eigenvalues = np.empty(converged)
            fields = np.empty((self.elasticity.n_dofs, converged))
            for i in range(converged):
                eigenvalues[i] = eps.getEigenpair(i, vector).real
                fields[:, i] = vector.getArray()
        finally:
            # by name, as PETSc keeps what Python drops last until the end of the program
            for item in (ksp, transform, eps, vector, *starts, *deflated):
                item.destroy()
        # all ranks decide by the same numbers, to the last bit
        eigenvalues = self.elasticity.comm.bcast(eigenvalues)
        order = np.argsort(eigenvalues, kind="stable")
        return eigenvalues[order], self._purified(factored, fields[:, order])

    def _iterated(
        self, factored: FactoredBody, solver: MultigridSolver, number: int, known: Block | None
    ) -> tuple[NDArray[np.float64], Block]:
        """What `_search` does, without a factor: a block that holds all of them at once."""
        have = 0 if known is None else known.shape[1]
        width = min(number + GUARDS, self.freedoms - have)
        starts = np.hstack(
            [self._start(_scattered_field(self._place, have + k)) for k in range(width)]
        )
        eigenvalues, fields = solver.modes(factored.held_mass, starts, number, known)
        eigenvalues = self.elasticity.comm.bcast(eigenvalues)
        order = np.argsort(eigenvalues, kind="stable")
        return eigenvalues[order], fields[:, order]

    def _purified(self, factored: FactoredBody, fields: Block) -> Block:
        """Eigenvectors without what the mass does not see.

        Where there is void, and in held rows, there is no mass, and round-off of the Krylov space
        grows there without bound as modes become many. K^-1 M leaves an eigenvector as it is but
        for a factor, and takes that away.
        """
        fields = factored.solve(self.elasticity.apply(factored.held_mass, fields))
        return self._normalized(factored, fields)

    def _normalized(self, factored: FactoredBody, fields: Block) -> Block:
        """Fields with zeros where the body is held, and of modal mass one."""
        elasticity = self.elasticity
        fields[self._held] = 0.0
        image = elasticity.apply(factored.held_mass, fields)
        # a sum along a column could differ in its last bit by where the memory lies
        return fields / np.sqrt(np.diag(elasticity.inner(fields, image)))

    def _ritz(self, factored: FactoredBody, fields: Block) -> tuple[NDArray[np.float64], Block]:
        """The best eigenpairs in the span of fields."""
        projected = [
            self.elasticity.inner(fields, self.elasticity.apply(matrix, fields))
            for matrix in (factored.held_stiffness, factored.held_mass)
        ]
        pairs = scipy.linalg.eigh(*(0.5 * (a + a.T) for a in projected))
        # bases of repeated eigenvalues are arbitrary: all ranks must take the same
        eigenvalues, vectors = self.elasticity.comm.bcast(pairs)
        return eigenvalues, fields @ vectors

    def _start(self, field_: NDArray[np.float64]) -> Block:
        field_[self._held] = 0.0
        return field_[:, None]


def cluster(eigenvalues: NDArray[np.float64], number: int) -> tuple[int, int]:
    """The numbers before the cluster of the last one of some modes and up to its end.

    Args:
        eigenvalues: Ascending.
        number: Of modes, at least one.
    """
    apart = np.diff(eigenvalues) >= CLUSTER * eigenvalues[1:]
    ends = np.array([0, *(np.flatnonzero(apart) + 1), len(eigenvalues)])
    return int(ends[ends < number][-1]), int(ends[ends >= number][0])


class _Solution:
    """What SLEPc solves with: a factor as a preconditioner of PETSc's.

    Args:
        factored: The body at one density.
    """

    def __init__(self, factored: FactoredBody) -> None:
        self._factored = factored

    def apply(self, _: PETSc.PC, right: PETSc.Vec, solution: PETSc.Vec) -> None:
        solution.setArray(self._factored.solve(right.getArray(readonly=True)[:, None])[:, 0])


def _vectors(factored: FactoredBody, block: Block) -> list[PETSc.Vec]:
    vectors = []
    for column in block.T:
        vectors.append(factored.held_stiffness.createVecRight())
        vectors[-1].setArray(column)
    return vectors


# Starting the eigenvalue solver from fields that do not depend on the mesh's partition gives the
# same modes on any number of ranks.


def _smooth_field(place: NDArray[np.float64]) -> NDArray[np.float64]:
    """A field without symmetries."""
    x, y = place.T[:2]
    tilt = 13.7 * place[:, 2] if place.shape[1] == 3 else 0.0
    field_ = np.empty(place.shape)
    field_[:, 0] = np.sin(7.3 * x + 0.4) + np.cos(23.1 * x + 17.9 * y + tilt + 1.1)
    field_[:, 1] = np.cos(5.1 * x + 0.7) + np.sin(19.7 * x - 29.3 * y - tilt + 0.3)
    if place.shape[1] == 3:
        field_[:, 2] = np.sin(6.1 * x + 0.9) + np.cos(21.3 * x + 11.1 * y + 2.0 * tilt + 0.6)
    return field_.ravel()


def _scattered_field(place: NDArray[np.float64], number: int) -> NDArray[np.float64]:
    """A field of noise: the fractions of large numbers, others for each ``number``."""
    waves = np.array([[129.898, 393.467, 272.09], [782.33, 113.517, 627.41], [531.77, 917.2, 71.3]])
    d = place.shape[1]
    angles = place @ waves[:d, :d] + number * np.array([1.7, 2.9, 4.3])[:d]
    return np.ravel(1e4 * np.sin(angles) % 1.0 - 0.5)
