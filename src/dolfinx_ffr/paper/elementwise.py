# SPDX-License-Identifier: MIT
"""The gradient element by element: exact values at any chosen subset of elements.

The route of the paper. For the density x_e of each chosen element,

1. the derivative of every shape function (`mode_derivatives`);
2. from it the derivative of every volume integral, for example

       dG_ab = w_a^T dM w_b + dw_a^T M w_b + w_a^T M dw_b;

3. the gradient function, integrated over time,

       dpsi/dx_e = int (T_OF - mu^T T_KR - nu^T T_EM) dt,

   T_OF, T_KR and T_EM: derivatives of the objective at fixed motion, of the kinematic relations
   (the markers by which joints, forces and point masses hold on to the body), and of the equations
   of motion; mu and nu: adjoint variables.

The equations of motion are linear in the volume integrals, which do not depend on time. So mu and
nu are integrated over time against each integral once, by the discrete adjoint
(`Problem.integral_gradients`), and step 3 is one inner product for each element.

References:
    A. Held, S. Knüfer, R. Seifried, Multibody System Dynamics 40 (2017),
    doi:10.1007/s11044-016-9540-9.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike
from tqdm.auto import tqdm

from .. import validation
from ..arrays import Integers
from ..body import VolumeIntegrals
from ..fem import Array, rotated
from ..problem import Evaluation, Problem
from ..reduction import FlexibleBody, ReducedBody
from .mode_derivatives import Solver, cell_numbers, check_reduced, mode_derivatives


@dataclass(frozen=True, eq=False)
class IntegralDerivatives:
    """Derivatives of a body's volume integrals with respect to the densities of some elements.

    Attributes:
        cells: (cells,) elements of this rank.
        mass: (cells,) [kg].
        S: (cells, r + 1, 2) [kg m].
        G: (cells, r + 1, r + 1) [kg m^2].
        N: (cells, r + 1, r + 1) [kg m^2].
        K: (cells, r, r) [N/m].
        markers: By name of the marker, displacement (cells, 2, r) and rotation shape functions
            (cells, r); markers at interfaces do not depend on densities and are left out.
    """

    cells: Integers
    mass: Array
    S: Array
    G: Array
    N: Array
    K: Array
    markers: dict[str, tuple[Array, Array]] = field(default_factory=dict)

    def through_integrals(self, bar: VolumeIntegrals) -> Array:
        """Pull derivatives ``bar`` by mass, S, G, N and K back to the densities, shape (cells,)."""
        total = bar.mass * self.mass
        for name in "SGNK":
            total = total + np.einsum("cab,ab->c", getattr(self, name), getattr(bar, name))
        return total

    def through_markers(self, bar: VolumeIntegrals) -> Array:
        """Pull derivatives ``bar`` by the markers' shape functions back to densities, (cells,)."""
        total = np.zeros(len(self.cells))
        for name, (displacement, rotation) in self.markers.items():
            total += np.einsum("cka,ka->c", displacement, bar.markers[name].displacement)
            total += rotation @ bar.markers[name].rotation
        return total


@dataclass(frozen=True, eq=False)
class ElementGradient:
    """Exact derivatives of psi with respect to the densities of some elements of one body.

    Attributes:
        cells: (cells,) elements of this rank.
        objective: (cells,) share of T_OF.
        kinematics: (cells,) share of T_KR.
        motion: (cells,) share of T_EM.
        count: Elements on all ranks.
        seconds: Time spent [s].
    """

    cells: Integers
    objective: Array
    kinematics: Array
    motion: Array
    count: int
    seconds: float

    @property
    def values(self) -> Array:
        """The derivatives, shape (cells,)."""
        return self.objective + self.kinematics + self.motion


def integral_derivatives(
    body: FlexibleBody,
    reduced: ReducedBody,
    cells: ArrayLike | None = None,
    *,
    solver: Solver = "bordered",
    progress: bool = False,
) -> IntegralDerivatives:
    """The derivatives of a body's volume integrals with respect to single densities.

    ``body``, ``reduced``, ``cells`` (None: all elements of this rank) and ``solver`` are those of
    `mode_derivatives`; ``progress`` shows a progress bar on rank 0.

    Raises:
        ValueError: If an element does not exist, the solver is not known, or the body has geometric
            stiffness or is one in space.
        RuntimeError: If a solver fails.
    """
    check_reduced("integral derivatives", body, reduced)
    if body.domain.dimension == 3 or body.stiffening is not None:
        missing = "geometric stiffness" if body.domain.dimension == 2 else "bodies in space"
        raise ValueError(
            f"element by element: derivatives of {missing} are not available; use Problem.gradient"
        )
    elasticity, reduction, basis = body.elasticity, body.reduction, reduced.basis
    chosen = cell_numbers(body, cells)
    n, r = len(chosen), basis.shapes.shape[1]
    fields = np.column_stack([reduction.reference, basis.shapes])
    unit = reduction.unit_translations

    # the change of the matrices at fixed shape functions; a unit translation gives the mass
    with_translation = np.column_stack([fields, unit[:, 0]])
    forces = elasticity.cell_derivatives(reduced.density, with_translation, basis.shapes)
    mass_forces, stiffness_forces = (cell_forces[chosen] for cell_forces in forces)
    mass = mass_forces[:, :, 0, r + 1].sum(axis=1)
    mass_forces = mass_forces[..., : r + 1]
    local = elasticity.at_cells(fields)[chosen]
    turned = np.stack([-local[:, :, 1], local[:, :, 0]], axis=2)
    S = mass_forces.sum(axis=1).transpose(0, 2, 1).copy()
    G = np.einsum("cnda,cndb->cab", local, mass_forces)
    N = np.einsum("cnda,cndb->cab", turned, mass_forces)
    K = np.einsum("cnda,cndb->cab", local[..., 1:], stiffness_forces)
    markers = {name: (np.zeros((n, 2, r)), np.zeros((n, r))) for name in body.markers}

    # the change of the shape functions, multiplied by the test fields of G, N, S, K and the markers
    matrices = body.factored(reduced).matrices
    mass_fields = elasticity.apply(matrices.mass, fields)
    test_fields = [mass_fields, -rotated(mass_fields), elasticity.apply(matrices.mass, unit)]
    test_fields.append(elasticity.apply(matrices.stiffness, basis.shapes))
    test_fields += [marker.rows.T.toarray() for marker in body.markers.values()]
    ends = np.cumsum([block.shape[1] for block in test_fields])[:-1]
    all_test_fields = np.hstack(test_fields)
    bar = tqdm(
        total=elasticity.comm.allreduce(n) * r,
        disable=not progress or elasticity.comm.rank > 0,
        unit="system",
        desc="element by element",
        leave=False,
    )
    with bar:
        for derivative in mode_derivatives(body, reduced, chosen, solver=solver):
            products = elasticity.inner(all_test_fields, derivative.fields)
            i, (number, column) = derivative.shape, derivative.cells.T
            dG, dN, dS, dK, *d_markers = np.split(products[:, column].T, ends, axis=1)
            G[number, i + 1, :] += dG
            G[number, :, i + 1] += dG
            N[number, i + 1, :] += dN
            N[number, :, i + 1] -= dN
            S[number, i + 1, :] += dS
            K[number, i, :] += dK
            K[number, :, i] += dK
            for (displacement, rotation), d_marker in zip(markers.values(), d_markers, strict=True):
                displacement[number, :, i] = d_marker[:, :2]
                rotation[number, i] = d_marker[:, 2]
            bar.update(products.shape[1])
    return IntegralDerivatives(chosen, mass, S, G, N, K, markers)


def elementwise_gradient(
    problem: Problem,
    evaluation: Evaluation,
    cells: Mapping[str, ArrayLike] | ArrayLike | None = None,
    *,
    solver: Solver = "bordered",
    progress: bool = True,
) -> dict[str, ElementGradient]:
    """Exact derivatives of psi with respect to the densities of chosen elements, by body.

    The ``evaluation`` is what `value` of the ``problem`` returned, at any time. Elements ``cells``
    of this rank are a mask or numbers, with more than one flexible body a mapping by name; None
    takes all. The ``solver`` is an argument of `mode_derivatives`; ``progress`` shows a bar.

    Raises:
        ValueError: If a body or an element does not exist, the solver is not known, or the
            objective depends on the stress of a body.
        RuntimeError: If a solver fails.
    """
    validation.instance("element by element: problem", problem, Problem, "a Problem")
    needed = "what `Problem.value` returned"
    validation.instance("element by element: evaluation", evaluation, Evaluation, needed)
    names = sorted(problem.flexible)
    if not (cells is None or isinstance(cells, Mapping) or len(names) == 1):
        raise ValueError(
            f"element by element: {len(names)} bodies have densities ({names}); give a mapping "
            "from name to elements"
        )
    chosen = dict(cells) if isinstance(cells, Mapping) else dict.fromkeys(problem.flexible, cells)
    unknown = sorted(set(chosen) - set(names))
    if unknown:
        raise ValueError(f"element by element: no flexible body {unknown[0]!r}; there are {names}")
    partial = problem.partial_derivatives(evaluation)
    if partial.stresses:
        raise ValueError(
            "element by element: derivatives of the stress of shape functions, on which "
            f"{problem.objective} depends, are not available; use Problem.gradient"
        )
    direct, motion = problem.integral_gradients(evaluation)
    result = {}
    for name, body_cells in chosen.items():
        start = perf_counter()
        body, reduced = problem.flexible[name], evaluation.bodies[name]
        change = integral_derivatives(body, reduced, body_cells, solver=solver, progress=progress)
        objective = np.zeros(len(change.cells))
        if name in direct:
            integrals_bar = direct[name]
            objective += change.through_integrals(integrals_bar)
            objective += change.through_markers(integrals_bar)
        if name in partial.densities:
            objective += partial.densities[name][change.cells]
        result[name] = ElementGradient(
            cells=change.cells,
            objective=objective,
            kinematics=change.through_markers(motion[name]),
            motion=change.through_integrals(motion[name]),
            count=body.domain.comm.allreduce(len(change.cells)),
            seconds=perf_counter() - start,
        )
    return result
