# SPDX-License-Identifier: MIT
"""A flexible body: from the density of its elements to the few arrays that the mechanism sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .body import VolumeIntegrals
from .domain import Domain
from .elasticity import Elasticity
from .integrals import volume_integrals, volume_integrals_pullback
from .markers import PointMarker
from .material import SIMP, ElasticMaterial, Interpolation
from .reduction import CraigBampton, Frame, ReducedBasis
from .stiffening import GeometricStiffening

__all__ = ["FlexibleBody", "ReducedBody"]


@dataclass(frozen=True)
class ReducedBody:
    """A flexible body at one density, reduced to its shape functions."""

    integrals: VolumeIntegrals  #: what the mechanism sees, bit-identical on every rank
    basis: ReducedBasis  #: shape functions of this rank's dofs, frequencies
    density: NDArray[np.float64]  #: (cells,) of this rank
    seconds: dict[str, float] = field(default_factory=dict)  #: time spent in each room [s]


class FlexibleBody:
    """An elastic body with one density for each cell.

    Forward, a density becomes shape functions and volume integrals (`reduce`); backward, the
    derivative with respect to the integrals becomes one with respect to each cell's density
    (`pullback`). The cost of both does not depend on how many densities are designed.

    Args:
        domain: mesh, interfaces and solid regions.
        material: the solid.
        interpolation: stiffness and mass between void and solid.
        frame: reference conditions of the floating frame.
        modes: number of fixed-interface normal modes.
        points: markers besides the interfaces: name and position in the coordinates of the mesh,
            shape (2,) [m].
        tolerance: relative residual of the eigenvalue problem and of the adjoint systems.
        stiffening: loads whose geometric stiffness is modelled (`GeometricStiffening`): some of
            ``"omega2"``, ``"alpha"``, ``"acceleration"`` of the body's own inertia, and
            ``"markers"`` for the forces of joints, springs and others at markers, and the inertia
            of point masses there; none by default.

    Raises:
        ValueError: on every rank, if frame, modes or points do not fit the domain.
    """

    def __init__(
        self,
        domain: Domain,
        material: ElasticMaterial,
        *,
        frame: Frame,
        modes: int = 8,
        interpolation: Interpolation | None = None,
        points: Mapping[str, Sequence[float]] | None = None,
        tolerance: float = 1e-11,
        stiffening: Sequence[str] = (),
    ) -> None:
        self.domain = domain
        self.material = material
        self.interpolation = interpolation if interpolation is not None else SIMP()
        clash = sorted(set(points or {}) & set(domain.interfaces))
        if clash:
            raise ValueError(f"body: points {clash} have the names of interfaces; rename them")
        self.points = {
            name: PointMarker.at(domain, position, name)
            for name, position in (points or {}).items()
        }
        self.elasticity = Elasticity(domain, material, self.interpolation)
        self.reduction = CraigBampton(self.elasticity, frame, modes, tolerance=tolerance)
        self.stiffening = (
            GeometricStiffening(self.elasticity, self.reduction, stiffening, self.points)
            if stiffening
            else None
        )

    def with_modes(self, modes: int) -> FlexibleBody:
        """Return the same body with another number of normal modes.

        Args:
            modes: number of fixed-interface normal modes.
        """
        return FlexibleBody(
            self.domain,
            self.material,
            frame=self.reduction.frame,
            modes=modes,
            interpolation=self.interpolation,
            points={name: point.position.tolist() for name, point in self.points.items()},
            tolerance=self.reduction.tolerance,
            stiffening=() if self.stiffening is None else self.stiffening.loads,
        )

    @property
    def modes(self) -> int:
        """Number of elastic coordinates: constraint modes and normal modes."""
        return self.reduction.n_constraint + self.reduction.modes

    def volume(self, x: ArrayLike) -> tuple[float, NDArray[np.float64]]:
        """Return the filled share of the body's area, and its derivative.

        Args:
            x: one density for each cell owned by this rank, shape (cells,), in [0, 1].

        Returns:
            The share, the same on every rank, and its derivative with respect to the density of
            each cell owned by this rank, shape (cells,).

        Raises:
            ValueError: on every rank, if the density has the wrong size, is NaN or leaves [0, 1].
        """
        domain = self.domain
        share = domain.cell_volumes / domain.area
        return domain.sum(domain.check_density(x) * share), share

    def reduce(self, x: ArrayLike) -> ReducedBody:
        """Return shape functions and volume integrals at a density.

        Args:
            x: one density for each cell owned by this rank, shape (cells,), in [0, 1].

        Raises:
            ValueError: on every rank, if the density has the wrong size, is NaN or leaves [0, 1].
            RuntimeError: on every rank, if a solver fails.
        """
        start = perf_counter()
        self.elasticity.assemble(x)
        assembled = perf_counter()
        basis = self.reduction.basis()
        reduced = perf_counter()
        integrals = volume_integrals(self.elasticity, self.reduction, basis, self.points)
        if self.stiffening is not None:
            integrals = self.stiffening.stiffened(integrals, basis)
        return ReducedBody(
            integrals,
            basis,
            np.array(x, dtype=np.float64),
            {
                "assembly": assembled - start,
                "reduction": reduced - assembled,
                "integrals": perf_counter() - reduced,
            },
        )

    def pullback(
        self, reduced: ReducedBody, bar: VolumeIntegrals
    ) -> tuple[NDArray[np.float64], dict[str, float]]:
        """Return the derivative with respect to each density, given that to the integrals.

        Args:
            reduced: what `reduce` returned last. (The factor of an earlier density is gone.)
            bar: derivative of psi with respect to the integrals; psi must not depend on the choice
                of basis within the span of the shape functions, as no physical quantity does.

        Returns:
            Derivative for each cell owned by this rank, shape (cells,), and what was learnt:
            ``iterations`` of the adjoint systems and seconds spent.
        """
        self.require_current(reduced)
        start = perf_counter()
        pull = volume_integrals_pullback(
            self.elasticity, self.reduction, reduced.basis, self.points, bar
        )
        shapes_bar, stiff = pull.shapes, None
        if self.stiffening is not None:
            stiff = self.stiffening.pullback(reduced.basis, bar)
            shapes_bar = shapes_bar + stiff.shapes
        before = perf_counter()
        adjoint = self.reduction.pullback(reduced.basis, shapes_bar)
        solved = perf_counter()
        shapes, k = reduced.basis.shapes, reduced.basis.n_constraint
        w, y, kappa = pull.w, pull.y, pull.kappa + adjoint.fields
        y[:, 1 + k : -1] -= reduced.basis.eigenvalues * adjoint.fields[:, k:]
        if stiff is not None:
            w, y = np.hstack([w, stiff.loads]), np.hstack([y, stiff.adjoints])
            shapes = np.hstack([shapes, stiff.displacements])
            kappa = np.hstack([kappa, -stiff.adjoints])
        gradient = self.elasticity.density_gradient(w, y, shapes, kappa)
        if stiff is not None:
            gradient += stiff.direct
        return gradient, {
            "iterations": adjoint.iterations,
            "reduction pullback": solved - before,
            "integrals pullback": perf_counter() - solved + before - start,
        }

    def require_current(self, reduced: ReducedBody) -> None:
        """Refuse a reduction whose matrices and factor are gone.

        Args:
            reduced: what `reduce` returned.

        Raises:
            RuntimeError: on every rank, if the body has been reduced at another density since.
        """
        if not self.is_current(reduced):
            raise RuntimeError(
                "pullback: the body has been reduced at another density since; call reduce again"
            )

    def is_current(self, reduced: ReducedBody) -> bool:
        """Return whether matrices and factor are still those of a reduction; the same on all ranks.

        Args:
            reduced: what `reduce` returned.
        """
        now = self.elasticity.density.x.array[: self.domain.n_cells]
        return all(self.domain.comm.allgather(np.array_equal(reduced.density, now)))
