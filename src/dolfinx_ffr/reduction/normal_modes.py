# SPDX-License-Identifier: MIT
"""The lowest fixed-interface normal modes of a body, with all copies of repeated frequencies.

They are found in a block Krylov space of K^-1 M: a few vectors at a time cost little more than one,
and the images of the space under K^-1 M make eigenvectors clean at no further solution. A space
that grows from two vectors holds two vectors of each eigenspace: further copies of an eigenvalue
come in by round-off, late or not at all. So noise joins the space, which brings in the copies that
are missing, as of equal blades on a hub, and proves at a risk of 1e-10 that there are no more
(`Certificate`). Where the space would grow too large, SLEPc's Krylov-Schur method takes over from a
scattered start, and modes are counted by another factor.

Without a factor, by multigrid, a block of scattered fields is iterated, which holds as many copies
as it has fields; nothing is proved then.

References:
    R. G. Grimes, J. G. Lewis, H. D. Simon, A shifted block Lanczos algorithm for solving sparse
    symmetric generalized eigenproblems, SIAM Journal on Matrix Analysis and Applications 15 (1994),
    doi:10.1137/S0895479888151111.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ..arrays import Mask
from ..fem import Array, Block, Elasticity
from .certificate import Certificate, noise
from .eigenpairs import lowest_eigenpairs
from .factored_body import FactoredBody
from .krylov import KrylovSpace, projected
from .multigrid import MultigridSolver

#: Relative distance below which neighbouring eigenvalues count as one cluster. A retained mode has
#: a share of about solver tolerance / distance of the first truncated one: a thousandth at 1e-6
CLUSTER = 1e-3


@dataclass(frozen=True)
class SearchOptions:
    """Numbers by which modes are searched; results are the same to round-off for others nearby."""

    #: Fields of a block. More of them make larger spaces, but the time to read a large factor
    #: hardly depends on their number
    block: int = 4
    narrow_block: int = 2  #: The same for a body in the plane with less than `small` unknowns
    small: int = 30_000  #: Unknowns
    most: int = 100  #: Fields of a space, at most, and
    most_for_a_mode: int = 6  #: so many more for each mode
    #: Relative residual of modes from which on noise joins the space: it needs some blocks to tell
    #: anything, by which modes become accurate
    join_noise_at: float = 1e-3
    look_again: float = 1 / 16  #: Share by which a space grows between two looks at its modes
    #: How far below the first truncated eigenvalue is counted, relative to it: more than the
    #: round-off of ill-conditioned bodies
    below_truncated: float = 1e-2
    #: Fields that are iterated beyond those asked for, without a factor: the last converge slowly
    guards: int = 2


SEARCH = SearchOptions()


@dataclass(frozen=True, eq=False)
class LowestModes:
    """The lowest modes, to the end of the last one's `cluster` and beyond."""

    eigenvalues: Array  #: (k,)
    fields: Block  #: (dofs, k), of modal mass one
    mass_fields: Block  #: (dofs, k) M times them
    static: Block  #: K^-1 times the loads that were given, (dofs, columns)


class EigenSolver:
    """Lowest eigenpairs of a clamped body, from starts that no partition of the mesh changes."""

    def __init__(self, elasticity: Elasticity, clamped: Mask, tolerance: float) -> None:
        self.elasticity = elasticity
        self.tolerance = tolerance  # relative residual
        self._clamped = clamped
        free = int(np.count_nonzero(~clamped))
        self.freedoms = elasticity.comm.allreduce(free)  #: Number of dofs that are not clamped
        box = elasticity.domain.bounding_box
        self._positions = (elasticity.coordinates() - box[0]) / np.ptp(box, axis=0).max()
        self._smooth = self._without_clamped(_smooth_field(self._positions))
        narrow = elasticity.dimension == 2 and elasticity.n_dofs_global < SEARCH.small
        width = SEARCH.narrow_block if narrow else SEARCH.block
        self._block = np.hstack([self._smooth, *map(self._scattered, range(1, width))])

    def lowest(self, factored: FactoredBody, number: int, loads: Block) -> LowestModes:
        """The ``number`` lowest modes, to the end of the last one's `cluster` and beyond.

        With K^-1 times ``loads`` (dofs, columns), for which the factor is not read once more.
        RuntimeError if modes do not converge or remain missing.
        """
        iterative = isinstance(factored.clamped.solver, MultigridSolver)
        # where solutions are approximate, a Krylov space loses its recurrence
        certified = None if iterative else self._in_krylov_space(factored, number, loads)
        if certified is not None:
            return certified
        eigenvalues, fields = self._search(factored, self._smooth, number + 1)
        while True:
            end = cluster(eigenvalues, number)[1]
            if end == self.freedoms:
                break
            missing, below = len(eigenvalues), np.inf
            if end < len(eigenvalues):
                below = below_following(eigenvalues, end)
                missing = 0 if iterative else factored.count_below(below) - end
            if missing == 0:
                break
            # A few at a time: each further copy of the low ones brings the last one asked for, and
            # with it the missing ones, further down.
            count = min(missing, max(4, number // 4), self.freedoms - len(eigenvalues))
            start = self._scattered(len(eigenvalues))
            further, further_fields = self._search(factored, start, count, fields)
            if not np.any(further < below):
                raise RuntimeError(
                    f"reduction: {end} normal modes were found below "
                    f"{np.sqrt(below) / (2.0 * np.pi):.6g} Hz, but a count gives {end + missing}: "
                    "the body is too ill-conditioned; give void more stiffness, or take another "
                    "number of modes"
                )
            eigenvalues, fields = self._ritz(factored, np.hstack([fields, further_fields]))
        masses = self.elasticity.apply(factored.clamped.mass, fields)
        return LowestModes(eigenvalues, fields, masses, factored.solve(loads))

    def _in_krylov_space(
        self, factored: FactoredBody, number: int, loads: Block
    ) -> LowestModes | None:
        """The modes of `lowest`, certified, or None if that takes too many vectors."""
        # K^-1 M V y, unlike V y, is free of fields that the mass does not see, in void
        space = KrylovSpace(factored, self._block)
        certificate: Certificate | None = None
        right_sides = [space.mass_last, noise(factored, self._clamped, 0), loads]
        ends = np.cumsum([block.shape[1] for block in right_sides])
        image: Block | None
        image, noisy, static = np.split(factored.solve(np.hstack(right_sides)), ends[:2], axis=1)
        rounds = looked = n_accurate = 0
        while space.size <= SEARCH.most + SEARCH.most_for_a_mode * max(number, n_accurate):
            if not space.invariant:
                space.grow(image)
                image = None
                if space.complete < max(number + 1, (1.0 + SEARCH.look_again) * looked):
                    continue
            looked = space.complete
            # all ranks decide by the same numbers, to the last bit
            inverses, vectors = self.elasticity.decided(np.linalg.eigh(space.projected))
            inverses, vectors = inverses[::-1].copy(), vectors[:, ::-1].copy()
            accurate = self.tolerance if certificate else max(self.tolerance, SEARCH.join_noise_at)
            open_ = space.residual_norms(vectors) > accurate * np.abs(inverses)
            n_accurate = int(np.argmax(open_)) if np.any(open_) else len(open_)
            eigenvalues = 1.0 / inverses[:n_accurate]
            end = cluster(eigenvalues, number)[1] if n_accurate > number else n_accurate
            holds = None if certificate else False
            if certificate and end < n_accurate:
                limit = 1.0 / below_following(eigenvalues, end)
                holds = self.elasticity.decided(certificate.holds(limit, end))
            if holds or end == self.freedoms:
                fields = space.image_of(vectors[:, :n_accurate])
                del space, certificate, image, noisy, right_sides  # larger than the modes
                fields, masses = self._normalized(factored, fields)
                return LowestModes(eigenvalues, fields, masses, static)
            if space.invariant or (end < n_accurate and holds is False):
                if rounds:
                    noisy = factored.solve(noise(factored, self._clamped, rounds))
                certificate = Certificate(space, noisy)
                rounds += 1
                if space.invariant and end == n_accurate:
                    return None  # there is nothing else
        return None

    def _search(
        self, factored: FactoredBody, start: Block, number: int, deflated: Block | None = None
    ) -> tuple[Array, Block]:
        """At least ``number`` lowest eigenpairs in the complement of known modes, by SLEPc."""
        if number < 1:
            return np.zeros(0), np.zeros((self.elasticity.n_dofs, 0))
        mass, solver = factored.clamped.mass, factored.clamped.solver
        if isinstance(solver, MultigridSolver):
            have = 0 if deflated is None else deflated.shape[1]
            width = min(number + SEARCH.guards, self.freedoms - have)
            starts = np.hstack([self._scattered(have + k) for k in range(width)])
            return solver.modes(mass, number, starts, deflated)
        eigenvalues, fields = lowest_eigenpairs(
            factored.clamped.stiffness,
            mass,
            number,
            starts=start,
            known=deflated,
            inverse=factored.solve,
            tolerance=self.tolerance,
        )
        # In void and in clamped rows there is no mass, and round-off grows there without bound as
        # modes become many. K^-1 M only scales an eigenvector, and takes that away.
        fields = factored.solve(self.elasticity.apply(mass, fields))
        return eigenvalues, self._normalized(factored, fields)[0]

    def _normalized(self, factored: FactoredBody, fields: Block) -> tuple[Block, Block]:
        """Fields with zeros in clamped rows, and of modal mass one, and M times them."""
        fields[self._clamped] = 0.0
        image = self.elasticity.apply(factored.clamped.mass, fields)
        # a sum along a column could differ in its last bit by where the memory lies
        norms = np.sqrt(np.diag(self.elasticity.inner(fields, image)))
        fields /= norms
        image /= norms
        return fields, image

    def _ritz(self, factored: FactoredBody, fields: Block) -> tuple[Array, Block]:
        """The best eigenpairs in the span of fields."""
        matrices = factored.clamped.stiffness, factored.clamped.mass
        pairs = scipy.linalg.eigh(*(projected(self.elasticity, m, fields) for m in matrices))
        # bases of repeated eigenvalues are arbitrary: all ranks must take the same
        eigenvalues, vectors = self.elasticity.decided(pairs)
        return eigenvalues, fields @ vectors

    def _scattered(self, number: int) -> Block:
        """A field of noise: the fractions of large numbers, others for each number."""
        waves = [[129.898, 393.467, 272.09], [782.33, 113.517, 627.41], [531.77, 917.2, 71.3]]
        d = self.elasticity.dimension
        shift = number * np.array([1.7, 2.9, 4.3])[:d]
        angles = self._positions @ np.array(waves)[:d, :d] + shift
        return self._without_clamped(1e4 * np.sin(angles) % 1.0 - 0.5)

    def _without_clamped(self, field_: Array) -> Block:
        return np.where(self._clamped, 0.0, field_.ravel())[:, None]


def cluster(eigenvalues: Array, number: int) -> tuple[int, int]:
    """The numbers of modes before the cluster of mode ``number``, and up to its end."""
    is_gap = np.diff(eigenvalues) >= CLUSTER * eigenvalues[1:]
    ends = np.array([0, *(np.flatnonzero(is_gap) + 1), len(eigenvalues)])
    return int(ends[ends < number][-1]), int(ends[ends >= number][0])


def below_following(eigenvalues: Array, end: int) -> float:
    """Where eigenvalues are counted: between the ``end``-th one and the following one, near it."""
    following = eigenvalues[end]
    half_gap = 0.5 * (following - eigenvalues[end - 1])
    return float(following - min(half_gap, SEARCH.below_truncated * following))


def _smooth_field(position: Array) -> Array:
    """A field without symmetries at positions (nodes, dimension), of the same shape."""
    x, y, z = np.pad(position, ((0, 0), (0, 3 - position.shape[1]))).T
    # waves of unrelated lengths and phases, so that no mode is orthogonal to the field by symmetry
    tilt = 13.7 * z
    components = [
        np.sin(7.3 * x + 0.4) + np.cos(23.1 * x + 17.9 * y + tilt + 1.1),
        np.cos(5.1 * x + 0.7) + np.sin(19.7 * x - 29.3 * y - tilt + 0.3),
        np.sin(6.1 * x + 0.9) + np.cos(21.3 * x + 11.1 * y + 2.0 * tilt + 0.6),
    ]
    return np.column_stack(components[: position.shape[1]])
