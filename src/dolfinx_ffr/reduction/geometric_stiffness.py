# SPDX-License-Identifier: MIT
"""Geometric stiffness of a body by its own inertia and by forces at markers, and its pullback.

A body under stress is stiffer, or softer, against bending: a spinning blade, a strut. Linear shape
functions miss that. For each unit load b of the body's inertia, with body force rho F_b,

    F = w_0 by omega^2,     F = -J w_0 by alpha,     F = -e_x, -e_y by the frame's acceleration,

in space

    F = -w_0^l e_k by the entries k, l of [alpha] + [omega]^2,     F = -e_k by the acceleration,

the stress of the undeformed body follows from the static displacement u_b under the conditions of
the frame of reference, and the geometric stiffness from the quadratic part of Green's strain,

    K_b,ij = int sigma_x(u_b) : (grad phi_i^T grad phi_j) dX.

To the dynamics it is the work of the load on a displacement of second order: elastic forces gain it
times the present load, and inertia its counterpart. Likewise for each marker P and unit forces at
it along the body's axes,

    T_Pd,ij = int sigma_x(u_Pd) : (grad phi_i^T grad phi_j) dX.

Since a force works along the marker's displacement, T_P is at the same time the second derivative
of the displacement: to second order it is Phi_P q - 1/2 q . T_P q. The mechanism moves markers by
that, and so all forces and point masses at markers stiffen the body without being known here.

References:
    J. Wallrapp, R. Schwertassek, Representation of geometric stiffening in multibody system
    simulation, International Journal for Numerical Methods in Engineering 32 (1991),
    doi:10.1002/nme.1620320818.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import islice

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem

from ..arrays import symmetric
from ..body import LOADS, VolumeIntegrals
from ..fem import Array, Block, FieldPairs, add_ghosts
from .craig_bampton import CraigBampton, ReducedBasis, ShapesBar
from .factored_body import FactoredBody
from .krylov import projected
from .point_marker import PointMarker

#: Factor and columns of `CraigBampton.unit_gradients` in the loads that vary over the body
VARYING = {"omega2": (1.0, np.s_[:1]), "alpha": (-1.0, np.s_[1:]), "rotation": (-1.0, np.s_[:])}
#: Name of the loads at markers
MARKERS = "markers"


class GeometricStiffening:
    """Geometric stiffness of one body under some ``loads``; ValueError if one is not known."""

    def __init__(
        self, reduction: CraigBampton, loads: Sequence[str], markers: Mapping[str, PointMarker]
    ) -> None:
        self._shapes = LOADS[reduction.elasticity.dimension]
        available = [*self._shapes, MARKERS]
        if not loads or not set(loads) <= set(available):
            raise ValueError(
                f"geometric stiffening: loads {list(loads)} must be some of {available}"
            )
        self.reduction = reduction
        self.elasticity = elasticity = reduction.elasticity
        self.loads = frozenset(loads)
        self._inertia = tuple(load for load in self._shapes if load in loads)
        self._markers = dict(markers) if MARKERS in loads else {}
        # markers fixed by the frame take forces without stress
        self._interfaces = {
            name: motion
            for name in (elasticity.domain.interfaces if MARKERS in loads else ())
            if np.any(motion := reduction.interface_motion(name)[0])
        }
        # filled before each use
        space = elasticity.domain.space
        self._fields = displacement, phi, kappa = [fem.Function(space) for _ in range(3)]
        self._force = fem.Function(space)
        u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
        degree = {"quadrature_degree": 3 * elasticity.domain.order}
        dx = ufl.Measure("dx", domain=elasticity.domain.mesh, metadata=degree)

        def energy(load: object, a: object, b: object) -> ufl.Form:
            strain = ufl.dot(ufl.transpose(ufl.grad(a)), ufl.grad(b))
            return ufl.inner(elasticity.stress(load), strain) * dx

        self._matrix_form = fem.form(energy(displacement, u, v))
        self._matrix: PETSc.Mat = fem.petsc.create_matrix(self._matrix_form)
        # symmetric in phi and kappa, as sigma is
        self._load_form = fem.form(energy(v, phi, kappa))
        self._energy = energy(displacement, phi, kappa)
        self._density_form = elasticity.density_form(self._energy)

    @cached_property
    def _node_form(self) -> fem.Form:
        return self.elasticity.nodes.form(self._energy)

    def stiffened(
        self, factored: FactoredBody, basis: ReducedBasis, integrals: VolumeIntegrals
    ) -> VolumeIntegrals:
        """The integrals of the same body with its geometric stiffness, the same on every rank."""
        self.elasticity.set_density(factored.matrices.density)
        displacements = self._displacements(factored, basis)
        matrices = map(self._assembled, displacements.T)  # one at a time, in the same memory
        reduced = iter([projected(self.elasticity, m, basis.shapes) for m in matrices])

        def stacked(shape: tuple[int, ...]) -> Array:
            matrices_of_load = np.array(list(islice(reduced, math.prod(shape))))
            return matrices_of_load.reshape(*shape, *matrices_of_load.shape[1:])

        inertia = {load: stacked(self._shapes[load]) for load in self._inertia}
        markers = dict(integrals.markers)
        for name in [*self._interfaces, *self._markers]:
            stiffening = stacked((self.elasticity.dimension,))
            markers[name] = replace(markers[name], stiffening=stiffening)
        return replace(integrals, markers=markers, stiffening=inertia)

    def pullback(
        self,
        factored: FactoredBody,
        basis: ReducedBasis,
        bar: VolumeIntegrals,
        nodes: Array | None = None,
    ) -> tuple[ShapesBar, Array]:
        """The transpose of the derivative of `stiffened`, from the derivatives ``bar``.

        The adjoint fields z_b are the static displacements under the derivatives by u_b. The pairs
        of fields are F_b and z_b in the mass, u_b and -z_b in the stiffness. Besides them stands
        the derivative by the densities at fixed displacements and shape functions, (cells,). That
        by the nodes of the mesh is added to ``nodes``.
        """
        elasticity, shapes = self.elasticity, basis.shapes
        matrix_bars = self._bars(bar)
        elasticity.set_density(factored.matrices.density)
        displacements = self._displacements(factored, basis)
        density_bar = elasticity.cell_zeros()
        shapes_bar = np.zeros_like(shapes)
        # derivatives by the displacements u_b
        forces = np.zeros_like(displacements)
        for b, displacement in enumerate(displacements.T):
            if not np.any(matrix_bars[b]):
                continue
            kappas = shapes @ symmetric(matrix_bars[b])
            shapes_bar += 2.0 * elasticity.apply(self._assembled(displacement), kappas)
            self._force.x.array[:] = 0.0
            for phi, kappa in zip(shapes.T, kappas.T, strict=True):
                elasticity.set(self._fields[1], phi)
                elasticity.set(self._fields[2], kappa)
                # each adds to its vector: new vectors would cost more than their entries
                fem.assemble_vector(density_bar, self._density_form)
                if nodes is not None:
                    fem.assemble_vector(nodes, self._node_form)
                fem.assemble_vector(self._force.x.array, self._load_form)
            add_ghosts(self._force)
            forces[:, b] = self._force.x.array[: len(forces)]
        loads = np.zeros_like(displacements)
        inertia = self._load_fields()
        loads[:, : inertia.shape[1]] = inertia
        adjoints = self._static(factored, basis, forces)
        pairs = FieldPairs(loads, adjoints, displacements, -adjoints)
        shapes_and_pairs = ShapesBar(shapes_bar, pairs=pairs)
        if nodes is not None:
            reference = self._reference(factored, adjoints[:, : inertia.shape[1]])
            lifted, coefficients = self._lifted(factored, basis, forces, displacements, adjoints)
            # those of the unit forces: first at the interfaces, then at the other markers
            by_marker = coefficients[:, inertia.shape[1] :]
            by_marker = by_marker.reshape(len(coefficients), -1, elasticity.dimension)
            by_interface = zip(self._interfaces, by_marker.transpose(1, 2, 0), strict=False)
            shapes_and_pairs = replace(
                shapes_and_pairs, reference=reference, lifted=lifted, loads=dict(by_interface)
            )
        return shapes_and_pairs, density_bar[: elasticity.domain.n_cells]

    def _reference(self, factored: FactoredBody, adjoints: Block) -> Array:
        """The derivative of sum_b m_x(F_b, z_b) with respect to the reference position, (dofs,)."""
        bars = self.elasticity.apply(factored.matrices.mass, adjoints)
        by_gradients = np.zeros((len(bars), 2 if self.elasticity.dimension == 2 else 9))
        column = 0
        for load in self._inertia:
            count = math.prod(self._shapes[load])
            if load in VARYING:
                factor, columns = VARYING[load]
                by_gradients[:, columns] += factor * bars[:, column : column + count]
            column += count
        return self.reduction.reference_pullback(by_gradients)

    def _lifted(
        self,
        factored: FactoredBody,
        basis: ReducedBasis,
        forces: Block,
        displacements: Block,
        adjoints: Block,
    ) -> tuple[Block, Array]:
        """Derivative by the constraint modes' values at the interfaces, (dofs, modes).

        Beside it the coefficients of these modes in the ``adjoints``, (modes, loads).
        """
        # at the interfaces u_b and z_b are combinations of these modes: the residual of the
        # equation of u_b counts times the coefficients of z_b, and the other way round
        elasticity, modes, d = self.elasticity, basis.constraint, self.elasticity.dimension
        if not modes.shape[1]:
            return modes, np.zeros((0, adjoints.shape[1]))
        loads, inertia = np.zeros_like(displacements), self._load_fields()
        loads[:, : inertia.shape[1]] = elasticity.apply(factored.matrices.mass, inertia)
        if self._markers:
            loads[:, -d * len(self._markers) :] = np.hstack(self._unit_forces())
        stiff_u, stiff_z, stiff_modes = (
            elasticity.apply(factored.matrices.stiffness, block)
            for block in (displacements, adjoints, modes)
        )
        reduced = elasticity.inner(modes, stiff_modes)
        u, z = (
            np.linalg.solve(reduced, elasticity.inner(modes, stiff_field))
            for stiff_field in (stiff_u, stiff_z)
        )
        return np.asarray((forces - stiff_z) @ u.T + (loads - stiff_u) @ z.T), z

    def _unit_forces(self) -> list[Block]:
        """Unit forces at each marker besides the interfaces, (dofs, dimension) each."""
        return [m.rows[: self.elasticity.dimension].T.toarray() for m in self._markers.values()]

    def _bars(self, bar: VolumeIntegrals) -> list[Array]:
        """The derivatives by the matrices K_b and T_Pd, (r, r) each, in the order of the u_b."""
        r, d = bar.modes, self.elasticity.dimension
        # by a load that is left out the derivative is zero
        zeros = {load: np.zeros((*shape, r, r)) for load, shape in self._shapes.items()}
        by_load = zeros | bar.stiffening

        matrices = [np.zeros((0, r, r))]
        matrices += [by_load[load].reshape(-1, r, r) for load in self._inertia]
        for name in [*self._interfaces, *self._markers]:
            of_marker = bar.markers[name].stiffening
            matrices.append(np.zeros((d, r, r)) if of_marker is None else of_marker)
        return list(np.concatenate(matrices))

    def _load_fields(self) -> Block:
        """The fields F_b of the loads of the inertia that are modelled."""
        varying = self.reduction.unit_gradients

        def of(load: str) -> Block:
            factor, columns = VARYING.get(load, (-1.0, None))
            return factor * (varying[:, columns] if columns else self.reduction.unit_translations)

        return np.hstack([varying[:, :0], *map(of, self._inertia)])

    def _displacements(self, factored: FactoredBody, basis: ReducedBasis) -> Block:
        """The static displacements u_b by inertia, forces at interfaces, and at other markers."""
        elasticity = self.elasticity
        blocks = [np.zeros((elasticity.n_dofs, 0))]
        if self._inertia:
            loads = elasticity.apply(factored.matrices.mass, self._load_fields())
            blocks.append(self._static(factored, basis, loads))
        for motion in self._interfaces.values():
            blocks.append(self._of_modes(factored, basis, motion.T))
        blocks += [self._static(factored, basis, forces) for forces in self._unit_forces()]
        return np.hstack(blocks)

    def _static(self, factored: FactoredBody, basis: ReducedBasis, forces: Block) -> Block:
        """The static displacements under forces, the body fixed by its frame alone."""
        # constraint modes and displacements that vanish at the interfaces have no common energy
        interior = forces.copy()
        interior[self.reduction.clamped] = 0.0
        generalised = self.elasticity.inner(basis.constraint, forces)
        of_modes = self._of_modes(factored, basis, generalised)
        return of_modes + factored.solve(interior)

    def _of_modes(self, factored: FactoredBody, basis: ReducedBasis, forces: Array) -> Block:
        """The static displacements under generalised forces on the constraint modes."""
        modes, elasticity = basis.constraint, self.elasticity
        if not modes.shape[1]:
            return np.zeros((len(modes), forces.shape[1]))
        image = elasticity.apply(factored.matrices.stiffness, modes)
        return modes @ np.linalg.solve(elasticity.inner(modes, image), forces)

    def _assembled(self, displacement: Array) -> PETSc.Mat:
        """The geometric stiffness matrix of one static displacement."""
        self.elasticity.set(self._fields[0], displacement)
        self._matrix.zeroEntries()
        fem.petsc.assemble_matrix(self._matrix, self._matrix_form)
        self._matrix.assemble()
        return self._matrix
