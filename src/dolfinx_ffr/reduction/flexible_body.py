# SPDX-License-Identifier: MIT
"""A flexible body: from the density of its elements to the few arrays that the mechanism sees."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from threading import RLock
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation
from ..body import VolumeIntegrals
from ..fem import (
    SIMP,
    Domain,
    Elasticity,
    ElasticMaterial,
    Interpolation,
    StressRecovery,
    cut_exponent,
    kept_by,
)
from ..parallel import check_alike
from .craig_bampton import CraigBampton, ReducedBasis
from .factored_body import FactoredBody
from .frame import Frame
from .geometric_stiffness import GeometricStiffening
from .integrals import volume_integrals, volume_integrals_pullback
from .linear_solver import DIRECT
from .point_marker import PointMarker
from .static_correction import ShapesBar, static_correction, static_correction_pullback

__all__ = ["FlexibleBody", "ReducedBody"]


@dataclass(frozen=True)
class ReducedBody:
    """A flexible body at one density, reduced to its shape functions.

    It holds arrays only. Matrices and factor of its density are those of `FlexibleBody.factored`.
    """

    integrals: VolumeIntegrals  #: What the mechanism sees, bit-identical on every rank
    basis: ReducedBasis  #: Shape functions of this rank's dofs, frequencies
    density: NDArray[np.float64]  #: (cells,) of this rank, not to be written to
    seconds: dict[str, float] = field(default_factory=dict)  #: Time spent by name of the part [s]

    def leading(self, shapes: int) -> ReducedBody:
        """The same body with its first shape functions alone.

        Args:
            shapes: Number of shape functions that are kept, the constraint modes among them.

        Raises:
            ValueError: If the body has fewer, or more constraint modes.
        """
        k = self.basis.n_constraint
        if shapes < k:
            raise ValueError(f"the body has {k} constraint modes, and cannot keep {shapes} shapes")
        basis = replace(
            self.basis,
            shapes=self.basis.shapes[:, :shapes],
            eigenvalues=self.basis.eigenvalues[: shapes - k],
            mass_times_normal=self.basis.mass_times_normal[:, : shapes - k],
        )
        return replace(self, basis=basis, integrals=self.integrals.leading(shapes))


class FlexibleBody:
    """An elastic body with one density for each cell.

    Forward, a density becomes shape functions and volume integrals (`reduce`); backward, the
    derivative with respect to the integrals becomes one with respect to each cell's density
    (`pullback`). The cost of both does not depend on how many densities are designed.

    A body may stand in several places of a mechanism and in several problems. It keeps matrices and
    factor of one density, the last one that was worked at; those of another are made again where
    they are asked for (`factored`), so that every reduction can be differentiated at any time.
    Several threads may call `reduce` and `pullback`, and so `Problem.value` and `gradient`; one of
    them works at a time. All else that needs matrices (`factored`, derivatives of modes, residual
    modes, stresses) belongs into one thread.

    Args:
        domain: Mesh, interfaces and solid regions.
        material: The solid.
        interpolation: Stiffness and mass between void and solid.
        frame: Reference conditions of the floating frame.
        modes: Number of fixed-interface normal modes.
        markers: Markers besides the interfaces: name and position in the coordinates of the mesh,
            shape (dimension,) [m].
        tolerance: Largest residual of a mode, relative to it, and error of its adjoint field,
            relative to the largest (`CraigBampton.solve_shifted`). What that leaves in a gradient
            is smaller by some three digits.
        stiffening: Loads whose geometric stiffness is modelled (`GeometricStiffening`): some of
            ``"omega2"``, ``"alpha"``, ``"acceleration"`` of the body's own inertia (in space
            ``"rotation"``, ``"acceleration"``), and ``"markers"`` for the forces of joints, springs
            and others at markers, and the inertia of point masses there; none by default.
        solver: ``"direct"`` factors the stiffness (CHOLMOD, MUMPS). ``"iterative"`` takes conjugate
            gradients with algebraic multigrid (PETSc's GAMG) to a hundredth of ``tolerance``, for
            bodies in space whose factor is too large for the memory; it is slower, and does not
            certify by a count that no mode is missing.
        points: The name of ``markers`` in the release before; goes with the next one.

    Raises:
        TypeError: If an argument is of a wrong kind.
        ValueError: On every rank, if frame, modes or markers do not fit the domain, or a number is
            out of range.
    """

    def __init__(
        self,
        domain: Domain,
        material: ElasticMaterial,
        *,
        frame: Frame,
        modes: int = 8,
        interpolation: Interpolation | None = None,
        markers: Mapping[str, Sequence[float]] | None = None,
        tolerance: float = 1e-8,
        stiffening: Sequence[str] = (),
        solver: str = DIRECT,
        points: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        if points is not None:
            _warn_of_points()
            markers = {**points, **(markers or {})}
        self.domain = validation.instance("body: domain", domain, Domain, "a Domain")
        check_alike(
            domain.comm,
            "body",
            {
                "modes": modes,
                "frame": frame,
                "material": material,
                "interpolation": interpolation,
                "markers": markers,
                "tolerance": tolerance,
                "stiffening": stiffening,
                "solver": solver,
            },
        )
        self.material = material
        self.interpolation = SIMP() if interpolation is None else interpolation
        validation.by_name("body: markers", markers or {}, "positions")
        validation.names("body: stiffening", stiffening)
        clash = sorted(set(markers or {}) & set(domain.interfaces))
        if clash:
            raise ValueError(f"body: markers {clash} have the names of interfaces; rename them")
        #: Markers besides the interfaces
        self.markers = {
            name: PointMarker.at(domain, position, name)
            for name, position in (markers or {}).items()
        }
        self.elasticity = Elasticity(domain, material, self.interpolation)
        self.reduction = CraigBampton(
            self.elasticity, frame, modes, tolerance=tolerance, solver=solver
        )
        self.stiffening = (
            GeometricStiffening(self.reduction, stiffening, self.markers) if stiffening else None
        )
        #: The one that was worked at last, or nothing
        self._latest: list[FactoredBody] = kept_by(self, domain.comm)
        #: One thread at a time works with the matrices and with what fills them.
        self._working = RLock()

    def with_modes(self, modes: int) -> FlexibleBody:
        """The same body with another number of normal modes.

        Args:
            modes: Number of fixed-interface normal modes.
        """
        return type(self)(self.domain, self.material, **{**self._options, "modes": modes})

    def with_domain(self, domain: Domain) -> FlexibleBody:
        """The same body on another mesh.

        Args:
            domain: With the same interfaces.
        """
        return type(self)(domain, self.material, **self._options)

    def with_interpolation(self, interpolation: Interpolation) -> FlexibleBody:
        """The same body with another law between void and solid.

        Args:
            interpolation: Stiffness and mass.
        """
        return type(self)(
            self.domain, self.material, **{**self._options, "interpolation": interpolation}
        )

    def with_cut_elements(self) -> FlexibleBody:
        """The same body, for densities that are shares of elements which a boundary cuts.

        Its interpolation law is the one that its own law's method ``cut`` returns for cells of its
        kind and order: by that the body is as stiff as one whose mesh fits the boundary. A law
        without that method stays.
        """
        cut = getattr(self.interpolation, "cut", None)
        if cut is None:
            return self
        exponent = cut_exponent(self.domain.cell, self.domain.order)
        return self.with_interpolation(cut(exponent))

    def __reduce__(self) -> tuple[Callable[..., FlexibleBody], tuple[Any, ...]]:
        """How pickle and copy make the body anew, without matrices of a density."""
        return partial(type(self), **self._options), (self.domain, self.material)

    @property
    def _options(self) -> dict[str, Any]:
        """The arguments by which the body differs from others of its domain and material."""
        return {
            "frame": self.reduction.frame,
            "modes": self.modes,
            "interpolation": self.interpolation,
            "markers": {name: point.position.tolist() for name, point in self.markers.items()},
            "tolerance": self.reduction.tolerance,
            "stiffening": () if self.stiffening is None else self.stiffening.loads,
            "solver": self.reduction.solver,
        }

    @property
    def modes(self) -> int:
        """Number of fixed-interface normal modes."""
        return self.reduction.modes

    @property
    def n_elastic(self) -> int:
        """Number of elastic coordinates: constraint modes and normal modes."""
        return self.reduction.n_constraint + self.reduction.modes

    @property
    def points(self) -> dict[str, PointMarker]:
        """The name of `markers` in the release before."""
        _warn_of_points()
        return self.markers

    @cached_property
    def stress_recovery(self) -> StressRecovery:
        """Stress of the solid at points of each cell, from displacements."""
        return StressRecovery(self.elasticity, self.material)

    def volume(self, x: ArrayLike) -> tuple[float, NDArray[np.float64]]:
        """The filled share of the body's area, and its derivative.

        Args:
            x: One density for each cell owned by this rank, shape (cells,), in [0, 1].

        Returns:
            The share, the same on every rank, and its derivative with respect to the density of
            each cell owned by this rank, shape (cells,).

        Raises:
            ValueError: On every rank, if the density has the wrong size, is NaN or leaves [0, 1].
        """
        domain = self.domain
        share = domain.cell_volumes / domain.area
        return domain.sum(domain.check_density(x) * share), share

    def reduce(self, x: ArrayLike) -> ReducedBody:
        """Shape functions and volume integrals at a density.

        Args:
            x: One density for each cell owned by this rank, shape (cells,), in [0, 1].

        Raises:
            TypeError: On every rank, if the density holds something else than real numbers.
            ValueError: On every rank, if the density has the wrong size, is NaN or leaves [0, 1],
                or if the body has no mass.
            RuntimeError: On every rank, if a solver fails.
        """
        return self.reduce_checked(self.domain.check_density(x))

    def reduce_checked(self, density: NDArray[np.float64]) -> ReducedBody:
        """What `reduce` does, at a density that has been checked.

        Args:
            density: What `Domain.check_density` has returned, shape (cells,) of this rank.

        Raises:
            ValueError: On every rank, if the body has no mass.
            RuntimeError: On every rank, if a solver fails.
        """
        density = np.array(density)
        density.setflags(write=False)
        with self._working:
            return self._reduce(density)

    def _reduce(self, density: NDArray[np.float64]) -> ReducedBody:
        """Shape functions and volume integrals at a density that has been checked."""
        start = perf_counter()
        self._release()
        matrices = self.elasticity.assemble(density)
        if not matrices.mass.norm() > 0.0:
            matrices.destroy()
            raise ValueError(
                "body: the design is empty: no cell has a mass, with densities up to "
                f"{self.elasticity.largest(density):.3g}; give at least a part of it material"
            )
        assembled = perf_counter()
        factored = self.reduction.factor(matrices)
        self._latest.append(factored)
        basis = self.reduction.basis(factored)
        reduced = perf_counter()
        integrals = self.integrals(factored, basis)
        return ReducedBody(
            integrals,
            basis,
            density,
            {
                "assembly": assembled - start,
                "reduction": reduced - assembled,
                "integrals": perf_counter() - reduced,
            },
        )

    def factored(self, reduced: ReducedBody) -> FactoredBody:
        """Matrices and factor at the density of a reduction.

        They are made again if the body has been worked at another density since, and live until it
        is the next time. Collective, in the same order on all ranks.

        Args:
            reduced: What `reduce` returned, at any time.

        Raises:
            RuntimeError: On every rank, if a solver fails.
        """
        # The array itself is the mark, not its values: all ranks decide alike without asking.
        if not self._latest or self._latest[0].matrices.density is not reduced.density:
            self._release()
            matrices = self.elasticity.assemble(reduced.density)
            self._latest.append(self.reduction.factor(matrices))
        return self._latest[0]

    def count_below(self, reduced: ReducedBody, limit: float) -> int:
        """How many fixed-interface eigenvalues lie below a limit, copies included.

        Args:
            reduced: What `reduce` returned, at any time.
            limit: Not an eigenvalue itself [rad^2/s^2].

        Raises:
            RuntimeError: On every rank, if they cannot be counted.
        """
        with self._working:
            return self.factored(reduced).count_below(limit)

    def _release(self) -> None:
        """Free matrices and factor on all ranks together; garbage collection would not be so."""
        while self._latest:
            self._latest.pop().destroy()

    def integrals(self, factored: FactoredBody, basis: ReducedBasis) -> VolumeIntegrals:
        """What the mechanism sees of the body at one density.

        Args:
            factored: The body at this density.
            basis: Its shape functions.
        """
        found = volume_integrals(self.reduction, factored.matrices, basis, self.markers)
        if self.stiffening is None:
            return found
        return self.stiffening.stiffened(factored, basis, found)

    def pullback(
        self, reduced: ReducedBody, bar: VolumeIntegrals, shapes: ShapesBar | None = None
    ) -> tuple[NDArray[np.float64], dict[str, float]]:
        """The derivative with respect to each density, given that to the integrals.

        Args:
            reduced: What `reduce` returned, at any time. If the body has been worked at another
                density since, its matrices are assembled and factored again.
            bar: Derivative of psi with respect to the integrals; psi must not depend on the choice
                of basis within the span of the shape functions, as no physical quantity does.
            shapes: Derivative of psi with respect to the shape functions themselves, at fixed
                integrals, where it has one (`stress_pullback`). Only psi as a whole need not
                depend on the choice of basis, and one adjoint solution serves both.

        Returns:
            Derivative for each cell owned by this rank, shape (cells,), and what was learnt:
            ``iterations`` of the adjoint systems and seconds spent.
        """
        with self._working:
            return self._pullback(reduced, bar, shapes)

    def _pullback(
        self, reduced: ReducedBody, bar: VolumeIntegrals, fields: ShapesBar | None
    ) -> tuple[NDArray[np.float64], dict[str, float]]:
        """The pullback while no other thread works with the body."""
        start = perf_counter()
        factored = self.factored(reduced)
        if fields is not None and fields.K is not None:
            bar = replace(bar, K=bar.K + fields.K)
        pull = volume_integrals_pullback(
            self.reduction, factored.matrices, reduced.basis, self.markers, bar
        )
        shapes_bar, stiff = pull.shapes, None
        if fields is not None:
            shapes_bar = shapes_bar + fields.shapes
        if self.stiffening is not None:
            stiff = self.stiffening.pullback(factored, reduced.basis, bar)
            shapes_bar = shapes_bar + stiff.shapes
        before = perf_counter()
        adjoint = self.reduction.pullback(factored, reduced.basis, shapes_bar)
        solved = perf_counter()
        shapes, k = reduced.basis.shapes, reduced.basis.n_constraint
        w, y, kappa = pull.w, pull.y, pull.kappa + adjoint.fields
        y[:, 1 + k : -1] -= reduced.basis.eigenvalues * adjoint.fields[:, k:]
        if stiff is not None:
            w, y = np.hstack([w, stiff.loads]), np.hstack([y, stiff.adjoints])
            shapes = np.hstack([shapes, stiff.displacements])
            kappa = np.hstack([kappa, -stiff.adjoints])
        if fields is not None and fields.pairs is not None:
            w, y, shapes, kappa = (
                np.hstack(both) for both in zip((w, y, shapes, kappa), fields.pairs, strict=True)
            )
        gradient = self.elasticity.density_gradient(reduced.density, w, y, shapes, kappa)
        if stiff is not None:
            gradient += stiff.direct
        return gradient, {
            "iterations": adjoint.iterations,
            "reduction pullback": solved - before,
            "integrals pullback": perf_counter() - solved + before - start,
        }

    def stress_modes(self, reduced: ReducedBody, *, correction: bool) -> NDArray[np.float64]:
        """Stress s_x, s_y, t_xy of the solid for unit coordinates; collective.

        Args:
            reduced: What `reduce` returned, at any time.
            correction: Whether the fields of the static correction follow the shape functions.

        Returns:
            Of the cells owned by this rank, shape (cells, points, components, coordinates) [Pa].
        """
        with self._working:
            fields = reduced.basis.shapes
            if correction:
                factored = self.factored(reduced)
                more = static_correction(self.reduction, factored, reduced.basis)
                fields = np.hstack([fields, more])
            return self.stress_recovery(fields)

    def stress_pullback(self, reduced: ReducedBody, bar: NDArray[np.float64]) -> ShapesBar:
        """The transpose of the derivative of `stress_modes`, for `pullback`; collective.

        Args:
            reduced: What `reduce` returned, at any time.
            bar: Derivative with respect to the stress for unit coordinates, of this rank's cells,
                shape (cells, points, components, coordinates), with or without the correction.
        """
        basis, r = reduced.basis, reduced.basis.shapes.shape[1]
        with self._working:
            fields = self.stress_recovery.transposed(bar)
            if fields.shape[1] == r:
                return ShapesBar(fields)
            factored = self.factored(reduced)
            through = static_correction_pullback(self.reduction, factored, basis, fields[:, r:])
        return replace(through, shapes=fields[:, :r] + through.shapes)


def _warn_of_points() -> None:
    warnings.warn(
        "FlexibleBody: points is now called markers; the old name goes with the next release",
        DeprecationWarning,
        stacklevel=3,
    )
