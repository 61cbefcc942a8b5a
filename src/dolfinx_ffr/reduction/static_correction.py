# SPDX-License-Identifier: MIT
"""Static response of the truncated modes to inertia forces, and its pullback.

The acceleration of the body's points in its frame is a combination of a few fields F that do not
depend on time (`objective.stress_coordinates` has the factors): unit translations, the reference
position w_0 and J w_0, the constraint modes, and J times all shape functions. In space they are
unit translations, the products w_0^l e_k, the constraint modes, and e_k x w_j of all shape
functions, k first. Each causes the displacement

    C = (K^-1 - Phi Lambda^-1 Phi^T) L,     L = -M F,     Lambda = Phi^T K Phi,

interfaces clamped, with the retained normal modes Phi (the method of mode accelerations, D. Rixen,
AIAA 2001-1300, doi:10.2514/6.2001-1300).
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, symmetric
from ..fem import Block, FieldPairs, rotated
from .craig_bampton import CraigBampton, ReducedBasis, ShapesBar
from .factored_body import FactoredBody

#: Loads that are solved for at a time
_COLUMNS = 32


def static_correction(
    reduction: CraigBampton, factored: FactoredBody, basis: ReducedBasis
) -> Block:
    """The displacements C, shape (dofs, 4 + k + r), in space (dofs, 12 + k + 3 r)."""
    fields = _inertia_fields(reduction, basis)
    for begin in range(0, fields.shape[1], _COLUMNS):  # all of them at once take gigabytes
        columns = np.s_[:, begin : begin + _COLUMNS]
        loads = _loads(reduction, factored, fields[columns])
        static, modal = _static(reduction, factored, basis, loads)
        fields[columns] = static - basis.normal @ modal
    return fields


def static_correction_pullback(
    reduction: CraigBampton, factored: FactoredBody, basis: ReducedBasis, bar: Block
) -> tuple[ShapesBar, Block]:
    """The transpose of the derivative of `static_correction`, for that by C, and C itself."""
    elasticity, k, r = reduction.elasticity, basis.n_constraint, basis.shapes.shape[1]
    fields = _inertia_fields(reduction, basis)
    loads = _loads(reduction, factored, fields)
    inner = bar.copy()
    inner[reduction.clamped] = 0.0
    static, modal = _static(reduction, factored, basis, loads)
    adjoint, modal_bar = _static(reduction, factored, basis, inner)
    partners = adjoint - basis.normal @ modal_bar  # of the loads
    fields_bar = -elasticity.apply(factored.matrices.mass, partners)
    n_rigid = 4 if elasticity.dimension == 2 else 12
    shapes = -_turned(reduction, fields_bar[:, n_rigid + k :], transposed=True)
    shapes[:, :k] += fields_bar[:, n_rigid : n_rigid + k]
    shapes[:, k:] -= inner @ modal.T + loads @ modal_bar.T
    K = np.zeros((r, r))
    K[k:, k:] = symmetric(modal_bar @ modal.T)
    reference = reduction.reference_pullback(fields_bar[:, elasticity.dimension : n_rigid])
    pairs = FieldPairs(fields, -partners, static, -adjoint)
    return ShapesBar(shapes, K, pairs, reference), static - basis.normal @ modal


def _inertia_fields(reduction: CraigBampton, basis: ReducedBasis) -> Block:
    """The fields F, shape (dofs, 4 + k + r), in space (dofs, 12 + k + 3 r)."""
    rigid = reduction.unit_translations, reduction.unit_gradients
    return np.hstack([*rigid, basis.constraint, _turned(reduction, basis.shapes)])


def _turned(reduction: CraigBampton, block: Block, *, transposed: bool = False) -> Block:
    """J times the fields of a block, in space e_k x each, k first; or minus the transpose."""
    if reduction.elasticity.dimension == 2:
        return rotated(block)
    axes, count = np.eye(3), block.shape[1] // 3 if transposed else block.shape[1]
    by_axis = np.split(block, 3, axis=1) if transposed else [block] * 3
    turned = [
        np.cross(axis[None, :, None], of_axis.reshape(-1, 3, count), axis=1).reshape(-1, count)
        for axis, of_axis in zip(axes, by_axis, strict=True)
    ]
    return np.asarray(sum(turned)) if transposed else np.hstack(turned)


def _loads(reduction: CraigBampton, factored: FactoredBody, fields: Block) -> Block:
    """The loads L of fields, zero in clamped rows."""
    loads = -reduction.elasticity.apply(factored.matrices.mass, fields)
    loads[reduction.clamped] = 0.0
    return np.asarray(loads)


def _static(
    reduction: CraigBampton, factored: FactoredBody, basis: ReducedBasis, loads: Block
) -> tuple[Block, Array]:
    """K^-1 L, and Lambda^-1 Phi^T L."""
    modal = reduction.elasticity.inner(basis.normal, loads) / basis.eigenvalues[:, None]
    return factored.solve(loads), modal
