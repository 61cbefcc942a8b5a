# SPDX-License-Identifier: MIT
"""Geometric stiffness of a body by its own inertia and by forces at markers, and its pullback.

A body under stress is stiffer, or softer, against bending: a spinning blade, a strut. Linear shape
functions miss that. For each unit load b of the body's inertia, with body force rho F_b,

    F = w_0 by omega^2,     F = -J w_0 by alpha,     F = -e_x, -e_y by the frame's acceleration,

in space

    F = -w_0^l e_k by the entries k, l of [alpha] + [omega]^2,     F = -e_k by the acceleration,

the stress of the undeformed body is that of the static displacement u_b, held by the conditions of
the frame of reference, and the geometric stiffness is the share of the quadratic part of Green's
strain,

    K_b,ij = int sigma_x(u_b) : (grad phi_i^T grad phi_j) dX.

The dynamics multiplies it with the present load. Likewise for each marker P and unit forces at it
along the body's axes,

    T_Pd,ij = int sigma_x(u_Pd) : (grad phi_i^T grad phi_j) dX.

Since the work of a force is that of the marker's displacement, T_P is at the same time the second
derivative of the latter: to second order the marker is displaced by Phi_P q - 1/2 q . T_P q. The
mechanism takes markers there, and so the forces of joints, springs and others, and the inertia of
point masses, stiffen the body without being known here. The rigid interface of a marker may take
its force anywhere, as the displacement u_Pd does not depend on where.

References:
    J. Wallrapp, R. Schwertassek, Representation of geometric stiffening in multibody system
    simulation, International Journal for Numerical Methods in Engineering 32 (1991),
    doi:10.1002/nme.1620320818.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from ..body import VolumeIntegrals
from ..fem import Block
from .craig_bampton import CraigBampton, ReducedBasis
from .factored_body import FactoredBody
from .point_marker import PointMarker

__all__ = ["GeometricStiffening", "StiffeningPullback"]

Array = NDArray[np.float64]

#: Loads of the body's inertia, and the shape of the fields of each, by dimension
LOADS: dict[int, dict[str, tuple[int, ...]]] = {
    2: {"omega2": (), "alpha": (), "acceleration": (2,)},
    3: {"rotation": (3, 3), "acceleration": (3,)},
}

#: Name of the loads at markers
MARKERS = "markers"


@dataclass(frozen=True)
class StiffeningPullback:
    """Derivative of a number psi through the geometric stiffness.

    At fixed shape functions psi changes by  ``direct``  for each cell's density, and by
    sum_b m_dx(F_b, z_b) - k_dx(u_b, z_b); of forces at markers F_b is zero.
    """

    direct: Array  #: (cells of this rank,)
    loads: Block  #: (dofs, b) the fields F_b
    displacements: Block  #: (dofs, b) static displacements u_b
    adjoints: Block  #: (dofs, b) the fields z_b
    shapes: Block  #: (dofs, r) derivative with respect to the shape functions at fixed density


class GeometricStiffening:
    """Geometric stiffness of one body.

    Args:
        reduction: The body and its frame of reference.
        loads: Which of ``"omega2"``, ``"alpha"``, ``"acceleration"``, ``"markers"`` are modelled,
            in space of ``"rotation"``, ``"acceleration"``, ``"markers"``; the last one stands for
            the forces at all markers.
        markers: Markers besides the interfaces.

    Raises:
        ValueError: If a load is not known or none is given.
    """

    def __init__(
        self,
        reduction: CraigBampton,
        loads: Sequence[str],
        markers: Mapping[str, PointMarker] | None = None,
    ) -> None:
        #: Loads of the inertia, and the shape of the fields of each
        self._shapes = LOADS[reduction.elasticity.dimension]
        known = [*self._shapes, MARKERS]
        if not loads or not set(loads) <= set(known):
            raise ValueError(f"geometric stiffening: loads {list(loads)} must be some of {known}")
        self.reduction = reduction
        self.elasticity = elasticity = reduction.elasticity
        self.loads = tuple(load for load in known if load in loads)
        self._inertia = tuple(load for load in self._shapes if load in loads)
        self._markers = dict(markers or {}) if MARKERS in loads else {}
        # Markers that the frame holds take forces without stress.
        self._interfaces = {
            name: motion
            for name in (elasticity.domain.interfaces if MARKERS in loads else ())
            if np.any(motion := reduction.interface_motion(name)[0])
        }
        # for a density and fields, filled before each use
        self._density = fem.Function(elasticity.domain.density_space)
        space = elasticity.domain.space
        self._fields = [fem.Function(space) for _ in range(3)]
        displacement, phi, kappa = self._fields
        u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
        degree = {"quadrature_degree": 3 * elasticity.domain.order}
        dx = ufl.Measure("dx", domain=elasticity.domain.mesh, metadata=degree)

        def energy(load: object, a: object, b: object) -> ufl.Form:
            strain = ufl.dot(ufl.transpose(ufl.grad(a)), ufl.grad(b))
            return ufl.inner(elasticity.stress(load, self._density), strain) * dx

        self._matrix_form = fem.form(energy(displacement, u, v))
        self._matrix: PETSc.Mat = fem.petsc.create_matrix(self._matrix_form)
        # symmetric in phi and kappa, as sigma is
        self._load_form = fem.form(energy(v, phi, kappa))
        test = ufl.TestFunction(elasticity.domain.density_space)
        self._density_form = fem.form(
            ufl.derivative(energy(displacement, phi, kappa), self._density, test)
        )

    def matrices(
        self, factored: FactoredBody, basis: ReducedBasis
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """The geometric stiffness at one density.

        Args:
            factored: The body at this density.
            basis: Its shape functions.

        Returns:
            By load of the inertia, shape (r, r), or (2, r, r) for ``"acceleration"``; and by marker
            on which a force stresses the body, shape (2, r, r); the same on every rank. In space
            (3, 3, r, r) for ``"rotation"``, and 3 for 2.
        """
        shapes, d = basis.shapes, self.elasticity.dimension
        found = []
        self._set_density(factored)
        for displacement in self._displacements(factored, basis).T:
            matrix = self._assembled(displacement)
            part = self.elasticity.inner(shapes, self.elasticity.apply(matrix, shapes))
            found.append(0.5 * (part + part.T))
        inertia, markers, first = {}, {}, 0
        for load in self._inertia:
            shape = self._shapes[load]
            count = int(np.prod(shape))
            stacked = np.stack(found[first : first + count])
            inertia[load] = stacked.reshape(*shape, *stacked.shape[1:])
            first += count
        for name in [*self._interfaces, *self._markers]:
            markers[name] = np.stack(found[first : first + d])
            first += d
        return inertia, markers

    def stiffened(
        self, factored: FactoredBody, basis: ReducedBasis, integrals: VolumeIntegrals
    ) -> VolumeIntegrals:
        """The integrals of the same body with its geometric stiffness.

        Args:
            factored: The body at one density.
            basis: Its shape functions.
            integrals: Of the shape functions.
        """
        inertia, at_markers = self.matrices(factored, basis)
        markers = {
            name: replace(marker, stiffening=at_markers.get(name))
            for name, marker in integrals.markers.items()
        }
        return replace(integrals, markers=markers, stiffening=inertia)

    def pullback(
        self, factored: FactoredBody, basis: ReducedBasis, bar: VolumeIntegrals
    ) -> StiffeningPullback:
        """The transpose of the derivative of `stiffened`.

        Args:
            factored: As in the forward map.
            basis: As in the forward map.
            bar: Derivative of psi with respect to the integrals, geometric stiffness included.
        """
        elasticity, shapes = self.elasticity, basis.shapes
        bars = self._bars(bar)
        self._set_density(factored)
        displacements = self._displacements(factored, basis)
        direct = np.zeros(len(self._density.x.array))
        shapes_bar = np.zeros_like(shapes)
        forces = np.zeros_like(displacements)
        for b, displacement in enumerate(displacements.T):
            if not np.any(bars[b]):
                continue
            partner = shapes @ (0.5 * (bars[b] + bars[b].T))
            shapes_bar += 2.0 * elasticity.apply(self._assembled(displacement), partner)
            vector: PETSc.Vec | None = None
            for phi, kappa in zip(shapes.T, partner.T, strict=True):
                elasticity.set(self._fields[1], phi)
                elasticity.set(self._fields[2], kappa)
                # both add to what is there: new vectors would cost more than what is in them
                fem.assemble_vector(direct, self._density_form)
                if vector is None:
                    vector = fem.petsc.assemble_vector(self._load_form)
                else:
                    fem.petsc.assemble_vector(vector, self._load_form)
            assert vector is not None
            vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
            forces[:, b] = vector.array[: len(forces)]
            vector.destroy()
        loads = np.zeros_like(displacements)
        inertia = self._load_fields()
        loads[:, : inertia.shape[1]] = inertia
        return StiffeningPullback(
            direct=direct[: elasticity.domain.n_cells],
            loads=loads,
            displacements=displacements,
            adjoints=self._static(factored, basis, forces),
            shapes=shapes_bar,
        )

    def _bars(self, bar: VolumeIntegrals) -> list[Array]:
        """The derivatives by the matrices, in the order of the displacements."""
        r, d = bar.modes, self.elasticity.dimension
        none = {load: np.zeros((*shape, r, r)) for load, shape in self._shapes.items()}
        parts = [np.zeros((0, r, r))]
        parts += [(none | bar.stiffening)[load].reshape(-1, r, r) for load in self._inertia]
        for name in [*self._interfaces, *self._markers]:
            of_marker = bar.markers[name].stiffening
            parts.append(np.zeros((d, r, r)) if of_marker is None else of_marker)
        return list(np.concatenate(parts))

    def _load_fields(self) -> Block:
        """The fields F_b of the loads of the inertia that are modelled."""
        unit, varying = self.reduction.unit_translations, self.reduction.unit_gradients
        fields = {"acceleration": -unit}
        if self.elasticity.dimension == 2:
            fields |= {"omega2": varying[:, :1], "alpha": -varying[:, 1:]}
        else:
            fields["rotation"] = -varying
        return np.hstack([unit[:, :0], *(fields[load] for load in self._inertia)])

    def _set_density(self, factored: FactoredBody) -> None:
        density = factored.matrices.density
        self._density.x.array[: len(density)] = density
        self._density.x.scatter_forward()

    def _displacements(self, factored: FactoredBody, basis: ReducedBasis) -> Block:
        """The static displacements u_b, then those by forces at interfaces and other markers."""
        elasticity = self.elasticity
        blocks = [np.zeros((elasticity.n_dofs, 0))]
        if self._inertia:
            loads = elasticity.apply(factored.matrices.mass, self._load_fields())
            blocks.append(self._static(factored, basis, loads))
        for motion in self._interfaces.values():
            blocks.append(self._of_modes(factored, basis, motion.T))
        for marker in self._markers.values():
            unit_forces = marker.rows[: self.elasticity.dimension].T.toarray()
            blocks.append(self._static(factored, basis, unit_forces))
        return np.hstack(blocks)

    def _static(self, factored: FactoredBody, basis: ReducedBasis, forces: Block) -> Block:
        """The static displacements under forces, the body held by its frame alone.

        Constraint modes have no strain energy together with displacements that vanish at the
        interfaces, so both parts are found apart.
        """
        interior = forces.copy()
        interior[self.reduction.held] = 0.0
        modes = basis.shapes[:, : basis.n_constraint]
        of_modes = self._of_modes(factored, basis, self.elasticity.inner(modes, forces))
        return of_modes + factored.solve(interior)

    def _of_modes(self, factored: FactoredBody, basis: ReducedBasis, forces: Array) -> Block:
        """The static displacements under generalised forces on the constraint modes."""
        modes = basis.shapes[:, : basis.n_constraint]
        if not modes.shape[1]:
            return np.zeros((len(modes), forces.shape[1]))
        stiffness = self.elasticity.inner(
            modes, self.elasticity.apply(factored.matrices.stiffness, modes)
        )
        return modes @ np.linalg.solve(stiffness, forces)

    def _assembled(self, displacement: Array) -> PETSc.Mat:
        """The geometric stiffness matrix of one static displacement."""
        self.elasticity.set(self._fields[0], displacement)
        self._matrix.zeroEntries()
        fem.petsc.assemble_matrix(self._matrix, self._matrix_form)
        self._matrix.assemble()
        return self._matrix
