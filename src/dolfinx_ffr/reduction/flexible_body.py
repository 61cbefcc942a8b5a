# SPDX-License-Identifier: MIT
"""A flexible body: from the density of its elements to the few arrays that the mechanism sees."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from threading import RLock
from time import perf_counter
from typing import Any, NamedTuple
from uuid import uuid4

from petsc4py import PETSc

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation
from ..body import VolumeIntegrals
from ..documentation import Shown
from ..fem import (
    SIMP,
    Array,
    Block,
    Domain,
    Elasticity,
    ElasticMaterial,
    FieldPairs,
    Interpolation,
    StressRecovery,
    _compat,
    cut_exponent,
    kept_by,
)
from ..limits import check_count, give_back_memory, held_memory
from ..parallel import agreed_memory, check_alike, in_words
from .craig_bampton import CraigBampton, ReducedBasis, ShapesBar
from .direct_solver import DIRECT, factor_entries
from .factored_body import FactoredBody
from .frame import Frame
from .geometric_stiffness import GeometricStiffening
from .integrals import second_moments, volume_integrals, volume_integrals_pullback
from .point_marker import PointMarker
from .static_correction import static_correction, static_correction_pullback
from .struts import Struts


@dataclass(frozen=True, repr=False)
class ReducedBody(Shown):
    """A flexible body at one density, reduced to its shape functions.

    It holds arrays only; `FlexibleBody.factored` has matrices and factor of its density.

    Attributes:
        integrals: Volume integrals for the mechanism, bit-identical on every rank.
        basis: Shape functions of this rank's dofs, frequencies.
        density: (cells,) of this rank, not to be written to.
        seconds: Time spent by name of the part [s].
        mark: `FlexibleBody.mark` of the body that was reduced.
        law: Its interpolation between void and solid, in words.
    """

    integrals: VolumeIntegrals
    basis: ReducedBasis
    density: Array
    seconds: dict[str, float] = field(default_factory=dict)
    mark: str = field(default="", repr=False, compare=False)
    law: str = field(default="", repr=False, compare=False)

    def leading(self, shapes: int) -> ReducedBody:
        """The same body with its first ``shapes`` shape functions, constraint modes first."""
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


class BodyPullback(NamedTuple):
    """Derivatives of a number psi with respect to one body's densities and nodes."""

    density: Array  #: For each cell owned by this rank, shape (cells,)
    #: For each node of the mesh on this rank in the order of ``mesh.geometry.x``, ghosts included,
    #: shape (nodes, dimension); None where it was not asked for
    nodes: Array | None
    #: For the center of each interface of the domain, shape (interfaces, dimension), on every rank;
    #: None where nodes were not asked for
    centers: Array | None
    learnt: dict[str, float]  #: ``iterations`` of the adjoint systems, and seconds spent by part


class _Adjoint(NamedTuple):
    """Fields of the adjoint problem of one body."""

    pairs: FieldPairs
    bar: VolumeIntegrals  #: Derivative of psi with respect to the integrals
    parts: list[ShapesBar]
    adjoint: Block  #: Of the shape functions, (dofs, r)
    direct: Array  #: Part of the derivative with respect to the densities, (cells,)
    iterations: int
    seconds: float  #: That the adjoint systems took [s]


#: Matrices of a body, with their columns' numbers, in entries of the pattern
_MATRICES = 6.0


class FlexibleBody:
    """An elastic body with one density for each cell.

    Forward, a density becomes shape functions and volume integrals (`reduce`); backward, the
    derivative with respect to the integrals becomes one with respect to each cell's density
    (`pullback`). The cost of both does not depend on how many densities are designed.

    A body may stand in several places of a mechanism and in several problems. It keeps matrices and
    factor of one density, the last one that was worked at, and makes those of another density again
    when they are asked for (`factored`), so that every reduction can be differentiated at any time.
    Several threads may call `reduce` and `pullback`, and so `Problem.value` and `gradient`; one of
    them works at a time. Everything else that needs matrices (`factored`, derivatives of modes,
    residual modes, stresses) belongs into one thread.

    Args:
        domain: Mesh, interfaces and solid regions.
        material: The solid.
        interpolation: Stiffness and mass between void and solid.
        frame: Reference conditions of the floating frame.
        modes: Number of fixed-interface normal modes.
        markers: Markers besides the interfaces: name and position in the coordinates of the mesh,
            shape (dimension,) [m].
        tolerance: Largest residual of a mode, relative to it, and error of its adjoint field,
            relative to the largest (`CraigBampton.solve_shifted`). The error of a gradient is
            smaller by some three digits.
        stiffening: Loads whose geometric stiffness is modelled (`GeometricStiffening`): some of
            ``"omega2"``, ``"alpha"``, ``"acceleration"`` of the body's own inertia (in space
            ``"rotation"``, ``"acceleration"``), and ``"markers"`` for the forces of joints, springs
            and others at markers, and the inertia of point masses there; none by default.
        solver: ``"direct"`` factors the stiffness (CHOLMOD, MUMPS). ``"iterative"`` takes conjugate
            gradients with multigrid to a hundredth of ``tolerance``, for bodies in space whose
            factor is too large for the memory: by nested boxes where the nodes stand on a lattice
            (`Domain.rectangle`, `Domain.box`), else by aggregates (PETSc's GAMG). It takes half the
            memory, and less time from some 200,000 unknowns on boxes on, more below; it does not
            certify by a count that no mode is missing. Where it stalls it warns and goes on with a
            factor. A factor that the memory does not hold is refused with the first density
            (ValueError).

    Raises:
        ValueError: If frame, modes or markers do not fit the domain, or a number is out of range.
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
    ) -> None:
        self.domain = validation.instance("body: domain", domain, Domain, "a Domain")
        #: The arguments by which the body differs from others of its domain and material
        self._options: dict[str, Any] = {"frame": frame, "modes": modes, "markers": markers}
        self._options |= {"interpolation": interpolation, "tolerance": tolerance}
        self._options |= {"stiffening": stiffening, "solver": solver}
        check_alike(domain.comm, "body", {**self._options, "material": material})
        self.material = material
        self.interpolation = SIMP() if interpolation is None else interpolation
        markers = validation.by_name("body: markers", markers or {}, "positions")
        self._options["markers"] = markers
        validation.names("body: stiffening", stiffening)
        clash = sorted(set(markers) & set(domain.interfaces))
        if clash:
            raise ValueError(f"body: markers {clash} have the names of interfaces; rename them")
        #: Markers besides the interfaces
        self.markers = {
            name: PointMarker.at(domain, position, name) for name, position in markers.items()
        }
        self.elasticity = Elasticity(domain, material, self.interpolation)
        self.reduction = CraigBampton(
            self.elasticity, frame, modes, tolerance=tolerance, solver=solver
        )
        self.stiffening = (
            GeometricStiffening(self.reduction, stiffening, self.markers) if stiffening else None
        )
        #: At the density that was worked at last, if any
        self._latest: list[FactoredBody] = kept_by(self, domain.comm)
        #: One thread at a time works with the matrices and with the forms that fill them.
        self._working = RLock()
        #: Identifies what this body has reduced
        self.mark = uuid4().hex

    def with_modes(self, modes: int) -> FlexibleBody:
        """The same body with another number of normal ``modes``."""
        return self._alike(modes=modes)

    def _alike(self, **changed: Any) -> FlexibleBody:
        """A body that accepts what this one has reduced: mesh, material and frame stay."""
        body = type(self)(self.domain, self.material, **{**self._options, **changed})
        body.mark = self.mark
        return body

    def with_domain(self, domain: Domain) -> FlexibleBody:
        """The same body on the mesh ``domain``, which has the same interfaces."""
        return type(self)(domain, self.material, **self._options)

    def with_interpolation(self, interpolation: Interpolation) -> FlexibleBody:
        """The same body with another ``interpolation`` between void and solid."""
        return self._alike(interpolation=interpolation)

    def with_cut_elements(self) -> FlexibleBody:
        """The same body, for densities that are shares of elements which a boundary cuts.

        Its law becomes what its method ``cut``, if it has one, returns for cells of this kind and
        order: so the body is as stiff as one whose mesh fits the boundary.
        """
        cut = getattr(self.interpolation, "cut", None)
        if cut is None:
            return self
        return self.with_interpolation(cut(cut_exponent(self.domain.cell, self.domain.order)))

    @property
    def modes(self) -> int:
        """Number of fixed-interface normal modes."""
        return self.reduction.modes

    @property
    def n_elastic(self) -> int:
        """Number of elastic coordinates: constraint modes and normal modes."""
        return self.reduction.n_constraint + self.reduction.modes

    @cached_property
    def stress_recovery(self) -> StressRecovery:
        """Stress of the solid at points of each cell, from displacements."""
        return StressRecovery(self.elasticity, self.material)

    @property
    def marker_nodes(self) -> NDArray[np.int32]:
        """Nodes of the mesh, of this rank's cells that contain markers besides the interfaces."""
        cells = [cell for marker in self.markers.values() for cell, _ in marker.cells]
        return np.unique(_compat.cell_geometry(self.domain.mesh)[cells])

    def volume(self, x: ArrayLike) -> tuple[float, Array]:
        """The filled share of the body's area, equal on every rank, and its derivative.

        For the density ``x`` of this rank's cells, shape (cells,), as `reduce`.
        """
        domain = self.domain
        share = domain.cell_volumes / domain.area
        return domain.sum(domain.check_density(x) * share), share

    def reduce(self, x: ArrayLike) -> ReducedBody:
        """Shape functions and volume integrals at a density.

        Args:
            x: One density for each cell owned by this rank, shape (cells,), in [0, 1].

        Raises:
            ValueError: If the density has the wrong size, is NaN or leaves [0, 1], or if the body
                has no mass.
            RuntimeError: If a solver fails.
        """
        return self.reduce_checked(self.domain.check_density(x))

    def reduce_checked(self, density: Array) -> ReducedBody:
        """`reduce` at a ``density`` that `Domain.check_density` has returned, shape (cells,)."""
        density = np.array(density)
        density.setflags(write=False)
        with self._working:
            start = perf_counter()
            factored, assembly = self._factor(density)
            basis = self.reduction.basis(factored)
            reduced = perf_counter()
            integrals = self.integrals(factored, basis)
        seconds = {
            "assembly": assembly,
            "reduction": reduced - start - assembly,
            "integrals": perf_counter() - reduced,
        }
        law = in_words(self.interpolation)
        return ReducedBody(integrals, basis, density, seconds, self.mark, law)

    def refuse_foreign(self, reduced: ReducedBody, name: str = "") -> None:
        """Refuse, by a ValueError, a ``reduced`` body that this one has not reduced.

        The ``name`` of the body stands in the message.
        """
        validation.instance("body: reduced", reduced, ReducedBody, "what its `reduce` returned")
        if reduced.mark != self.mark:
            whose = f"body {name!r}" if name else "the body"
            raise ValueError(
                f"{whose} is not the body that was evaluated: its mesh, material or frame may "
                "differ; give a problem or body with its own evaluation, as result.problem and "
                "result.evaluation"
            )

    def factored(self, reduced: ReducedBody) -> FactoredBody:
        """Matrices and factor at the density of a ``reduced`` body, a result of `reduce`.

        They are made again if the body has been worked at another density since, and live until it
        is worked at another one. Collective, in the same order on all ranks.

        Raises:
            RuntimeError: If a solver fails.
            ValueError: If another body was reduced.
        """
        self.refuse_foreign(reduced)
        # The array itself is the mark, not its values: all ranks decide alike without asking.
        if not self._latest or self._latest[0].matrices.density is not reduced.density:
            self._factor(reduced.density)
        return self._latest[0]

    def _factor(self, density: Array) -> tuple[FactoredBody, float]:
        """Matrices and factor of a density in the place of the last ones, and the assembly [s]."""
        start = perf_counter()
        recycled = self._latest.pop().recycle() if self._latest else None
        matrices = self.elasticity.assemble(density)
        assembly = perf_counter() - start
        if not matrices.mass.norm() > 0.0:
            for item in (matrices, recycled):
                if item is not None:
                    item.destroy()
            raise ValueError(
                "body: the design is empty: no cell has a mass, with densities up to "
                f"{self.elasticity.largest(density):.3g}; give at least a part of it material"
            )
        self._latest.append(self.reduction.factor(matrices, recycled))
        return self._latest[0], assembly

    def count_below(self, reduced: ReducedBody, limit: float) -> int:
        """How many fixed-interface eigenvalues of a ``reduced`` body lie below a ``limit``.

        Raises:
            RuntimeError: If they cannot be counted.
        """
        with self._working:
            return self.factored(reduced).count_below(limit)

    def warn_of_missing_modes(self, reduced: ReducedBody) -> None:
        """Count the modes of a ``reduced`` body by one more factor, as for a final result.

        `reduce` proves that none is missing at a risk of 1e-10. The matrices of the body are freed.

        Warns:
            UserWarning: If there are others than those found, or they cannot be counted.
        """
        with self._working:
            self.reduction.warn_of_missing_modes(self.factored(reduced), reduced.basis)
            self._release()

    def check_memory(self, what: str, remedy: str) -> None:
        """Refuse a body whose modes and stress the memory does not hold: ValueError.

        Counted are a factor, if it is solved by one, six matrices, and blocks of fields, beside
        what the processes hold. The error names ``what`` is too large and the ``remedy``.
        """
        comm, d, r = self.domain.comm, self.domain.dimension, self.n_elastic
        room = max(comm.size * agreed_memory(comm) - comm.allreduce(held_memory()), 0)
        matrix = self.elasticity.new_matrix()
        entries = _MATRICES * matrix.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_allocated"]
        # shape functions, and those of inertia turned about each axis, twice; a Krylov space; and
        # fields of stress, seven times the shape functions: with 41 of them as much was measured
        entries += matrix.size[0] * r * (2.0 * (3 + d * (d - 1) // 2) + 7.0)
        if self.reduction.solver == DIRECT:
            entries += factor_entries(self.elasticity, matrix, room / 8.0 - entries)
        matrix.destroy()
        options: dict[str, Any] = {"each": 8.0, "most": math.inf, "whose": "that are left"}
        check_count(what, entries, "numbers", remedy, available=room, **options)

    def release(self) -> None:
        """Free matrices and factor, which are made again where they are needed."""
        with self._working:
            self._release()
            self.elasticity.release()
            self.__dict__.pop("stress_recovery", None)
        give_back_memory()

    def _release(self) -> None:
        """Free matrices and factor on all ranks together; garbage collection would not be so."""
        while self._latest:
            self._latest.pop().destroy()

    def integrals(self, factored: FactoredBody, basis: ReducedBasis) -> VolumeIntegrals:
        """The volume integrals of a ``factored`` body with the shape functions ``basis``."""
        integrals = volume_integrals(self.reduction, factored.matrices, basis, self.markers)
        if self.stiffening is None:
            return integrals
        return self.stiffening.stiffened(factored, basis, integrals)

    def in_space(self, reduced: ReducedBody) -> VolumeIntegrals:
        """The integrals of a ``reduced`` body in space, as programs for space take it.

        A body in the plane lies in z = 0 and has the thickness of its material, see
        `VolumeIntegrals.extruded`.

        Raises:
            ValueError: If the material has no thickness.
        """
        if self.domain.dimension == 3:
            return reduced.integrals
        if self.material.thickness is None:
            raise ValueError(
                f"body: the material {type(self.material).__name__} has no thickness, which a body "
                "in space has; give it one"
            )
        with self._working:
            matrices = self.factored(reduced).matrices
            moments = second_moments(self.reduction, matrices, reduced.basis)
        return reduced.integrals.extruded(float(self.material.thickness), moments)

    def pullback(
        self,
        reduced: ReducedBody,
        bar: VolumeIntegrals,
        shapes: ShapesBar | None = None,
        *,
        nodes: bool = False,
        cells: bool = True,
    ) -> BodyPullback:
        """The derivatives of psi by each density and each node, given that by the integrals.

        Args:
            reduced: A result of `reduce`, see `factored`.
            bar: Derivative of psi with respect to the integrals; psi must not depend on the choice
                of basis within the span of the shape functions, as no physical quantity does.
            shapes: Derivative of psi with respect to the shape functions themselves, at fixed
                integrals, where it has one (`stress_pullback`). Only psi as a whole need not
                depend on the choice of basis, and one adjoint solution serves both.
            nodes: Whether the derivatives with respect to the nodes of the mesh, at fixed centers
                of interfaces, and to these centers, which the frame follows, are wanted, too.
                Markers besides the interfaces move with their cells.
            cells: Whether those by the densities are wanted; else they are zero.

        Raises:
            ValueError: If another body was reduced, or by another law between void and solid.
        """
        self.refuse_foreign(reduced)
        if reduced.law != in_words(self.interpolation):
            raise ValueError(
                f"body: the body was reduced with the law {reduced.law}, but the gradient with the "
                f"law {in_words(self.interpolation)} is wanted; give a problem with its own "
                "evaluation, as result.problem and result.evaluation"
            )
        with self._working:
            start = perf_counter()
            moved = self.elasticity.nodes.zeros() if nodes else None
            adjoint = self._adjoint(reduced, bar, shapes, moved)
            gradient = np.zeros(self.domain.n_cells)
            if cells:
                gradient = self.elasticity.density_gradient(reduced.density, adjoint.pairs)
            by_nodes, by_centers = None, None
            if moved is not None:
                self.elasticity.add_node_gradient(moved, reduced.density, adjoint.pairs)
                by_nodes, by_centers = self._by_nodes(moved, reduced, adjoint)
            learnt = {
                "iterations": adjoint.iterations,
                "reduction pullback": adjoint.seconds,
                "integrals pullback": perf_counter() - start - adjoint.seconds,
            }
            return BodyPullback(gradient + adjoint.direct, by_nodes, by_centers, learnt)

    def _adjoint(
        self,
        reduced: ReducedBody,
        bar: VolumeIntegrals,
        fields: ShapesBar | None = None,
        moved: Array | None = None,
    ) -> _Adjoint:
        """All fields whose products give the derivatives as integrals, see `pullback`."""
        factored, basis = self.factored(reduced), reduced.basis
        if fields is not None and fields.K is not None:
            bar = replace(bar, K=bar.K + fields.K)
        matrices, direct = factored.matrices, np.zeros(self.domain.n_cells)
        of_integrals = volume_integrals_pullback(self.reduction, matrices, basis, self.markers, bar)
        shares = [of_integrals] if fields is None else [of_integrals, fields]
        if self.stiffening is not None:
            stiff, direct = self.stiffening.pullback(factored, basis, bar, moved)
            shares.append(stiff)
        start = perf_counter()
        shapes_bar = sum((share.shapes for share in shares[1:]), of_integrals.shapes)
        adjoint, iterations = self.reduction.pullback(factored, basis, shapes_bar)
        seconds = perf_counter() - start
        assert of_integrals.pairs is not None
        of_integrals.pairs.kappa[:] += adjoint
        of_integrals.pairs.y[:, 1 + basis.n_constraint : -1] -= (
            basis.eigenvalues * adjoint[:, basis.n_constraint :]
        )
        pairs_of_shares = [share.pairs for share in shares if share.pairs is not None]
        pairs = FieldPairs(*map(np.hstack, zip(*pairs_of_shares, strict=True)))
        return _Adjoint(pairs, bar, shares, adjoint, direct, iterations, seconds)

    def struts(self, reduced: ReducedBody, bar: VolumeIntegrals) -> Struts:
        """What struts of a ``reduced`` body carry, others would, and holes change.

        The body is of full density, and ``bar`` the derivative by the integrals, as for `pullback`.
        """
        with self._working:
            pairs, matrices = self._adjoint(reduced, bar).pairs, self.factored(reduced).matrices
            return Struts(self.elasticity, matrices, pairs, reduced.basis)

    def _by_nodes(
        self, moved: Array, reduced: ReducedBody, adjoint: _Adjoint
    ) -> tuple[Array, Array]:
        """Derivatives by the nodes and by the centers; ``moved`` has the part by the pairs.

        Shapes (nodes, dimension) and (interfaces, dimension).
        """
        basis, bar, shares = reduced.basis, adjoint.bar, adjoint.parts
        k, mesh_nodes = basis.n_constraint, self.elasticity.nodes
        stiffness = self.factored(reduced).matrices.stiffness
        values = self.elasticity.apply(stiffness, adjoint.adjoint[:, :k])
        reference = np.zeros(len(values))
        for share in shares:
            values += share.shapes[:, :k]
            values += 0.0 if share.lifted is None else share.lifted
            reference += 0.0 if share.reference is None else share.reference
            if share.stress is not None:
                self.stress_recovery.add_node_gradient(moved, *share.stress)
        mesh_nodes.add_positions(moved, reference + self.reduction.lifted_pullback(values))
        for name, marker in self.markers.items():
            marker.add_node_gradient(moved, self.elasticity, basis.shapes, bar.markers[name])
        loads = {name: bar for share in shares for name, bar in share.loads.items()}
        by_centers = self.reduction.centers_pullback(values, reference, bar.markers, loads)
        return mesh_nodes.collected(moved), by_centers

    def measures_pullback(self, areas: Array | None, weights: Array | None) -> Array:
        """Derivative with respect to the nodes through areas of cells and of points of the stress.

        From ``areas``, by `Domain.cell_volumes`, shape (cells,), and ``weights``, by the areas that
        the points of the stress stand for, shape (cells, points), or None; as `BodyPullback.nodes`.
        """
        moved = self.elasticity.nodes.zeros()
        if areas is not None:
            self.elasticity.add_areas_gradient(moved, areas)
        if weights is not None:
            self.stress_recovery.add_weights_gradient(moved, weights)
        return self.elasticity.nodes.collected(moved)

    def stress_modes(self, reduced: ReducedBody, *, correction: bool) -> Array:
        """Stress of the solid for unit coordinates of a ``reduced`` body.

        With ``correction`` the fields of the static correction follow the shape functions. For this
        rank's cells, shape (cells, points, components, coordinates) [Pa].
        """
        with self._working:
            return self.stress_recovery(self.stress_fields(reduced, correction=correction))

    def stress_fields(self, reduced: ReducedBody, *, correction: bool) -> Block:
        """The displacements of `stress_modes`, shape (dofs, coordinates).

        Of the ``reduced`` body, with the static ``correction`` or without it.
        """
        with self._working:
            fields = [reduced.basis.shapes]
            if correction:
                factored = self.factored(reduced)
                fields.append(static_correction(self.reduction, factored, reduced.basis))
            return np.hstack(fields)

    def stress_pullback(self, reduced: ReducedBody, bar: Array) -> ShapesBar:
        """The transpose of the derivative of `stress_modes`, for `pullback`.

        ``bar`` is the derivative by the stress of the ``reduced`` body, with or without correction.
        """
        basis, r = reduced.basis, reduced.basis.shapes.shape[1]
        with self._working:
            fields = self.stress_recovery.transposed(bar)
            if fields.shape[1] == r:
                return ShapesBar(fields, stress=(basis.shapes, bar))
            factored = self.factored(reduced)
            of_correction, correction = static_correction_pullback(
                self.reduction, factored, basis, fields[:, r:]
            )
        stress = np.hstack([basis.shapes, correction]), bar
        return replace(of_correction, shapes=fields[:, :r] + of_correction.shapes, stress=stress)
