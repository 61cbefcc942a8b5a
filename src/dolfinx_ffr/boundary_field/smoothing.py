# SPDX-License-Identifier: MIT
"""What a smooth motion of a boundary is, how sizes are mended by one, and fields with slope one."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix, diags, vstack
from scipy.spatial import cKDTree

from ..arrays import Array, Integers, Mask
from .field import AnyField, BoundaryField
from .projection import Projection, SmoothMotion
from .sizes import SizeRows


def metric(field: BoundaryField) -> csc_matrix:
    """The square of a motion's size: along the boundary with its slope, and in the bulk, [m].

    M = int (v^2 + (smooth dv/ds)^2) + bulk (int u^2 / h + h int |grad u|^2), where u is the change
    of the field, v = u / |grad phi| the motion of the boundary along its normal, and h the spacing.
    """
    space, edge = field.space, field.edge
    smooth = space.options.smooth * space.member
    moves = np.flatnonzero(edge.moves)
    motion, lengths = edge.rows[moves], diags(edge.lengths[moves])
    slope = _along(field, moves)
    mass, stiffness = space.grid.integrals
    total = motion.T @ lengths @ motion + smooth**2 * (slope.T @ lengths @ slope)
    return csc_matrix(total + space.options.bulk * (mass + stiffness))


def _along(field: BoundaryField, moves: Integers) -> csr_matrix:
    """The slope of the motion along the boundary, where it moves, by the variables."""
    edge = field.edge
    normals = edge.normals[moves]
    along = np.column_stack([-normals[:, 1], normals[:, 0]]) / edge.slopes[moves, None]
    return field.space.grid.slope_rows(edge.points[moves], along)


def free_variables(field: BoundaryField) -> Mask:
    """The variables that move the boundary, and may."""
    free = np.zeros(len(field.variables), dtype=bool)
    free[field.edge.rows.indices] = True
    return free & ~field.space.held


def mended(field: AnyField, reach: float, smooth: SmoothMotion | None = None) -> AnyField:
    """The field with its minimum sizes and largest volume, by the smallest motions for them.

    They are small by the metric of the field, or by a ``smooth`` one of a field nearby.
    """
    options = field.space.options
    for _ in range(options.mending):
        rows, beyond = SizeRows.of(field), _beyond_volume(field)
        if max(rows.violation, beyond) <= options.unmended:
            break
        smooth = smooth or SmoothMotion(metric(field), free_variables(field))
        near = np.flatnonzero(rows.values > -options.at_once)
        slopes = vstack([rows.slopes[near], _volume_slope(field)], format="csr")
        violations = np.minimum(np.append(rows.values[near], beyond), options.at_once)
        motion = _least(smooth, slopes, violations)
        # variables at their bounds that would leave these stay from now on
        leaving = at_bounds(field) & (motion > 0.0)
        if np.any(leaving):
            smooth = smooth.without(leaving)
            motion = _least(smooth, slopes, violations)
        longest = float(np.max(np.abs(motion), initial=0.0))
        motion *= min(1.0, reach / max(longest, 1e-300))
        field = field.with_variables(field.variables + motion)
    return field


def _least(smooth: SmoothMotion, rows: csr_matrix, violations: Array) -> Array:
    """The smallest motion by a metric that mends violations."""
    return Projection(smooth, np.zeros(rows.shape[1]), rows).step(violations, 1.0)[0]


def _beyond_volume(field: BoundaryField) -> float:
    """By what share a field encloses more than it may, negative where it encloses less."""
    if field.space.volume >= 1.0:
        return -1.0
    return field.area / (field.space.volume * field.space.body.area) - 1.0


def _volume_slope(field: BoundaryField) -> csr_matrix:
    """The derivative of that share by the variables, (1, variables) [1/m]."""
    most = field.space.volume * field.space.body.area
    return csr_matrix(field.edge.rows.T @ field.edge.lengths / most)


def at_bounds(field: BoundaryField) -> Mask:
    """The variables that are as large as they may be, as the outline is near."""
    return np.asarray(field.variables >= field.space.upper - 1e-9)


def is_uneven(field: BoundaryField) -> bool:
    """Whether the slope of a field at its zero is too steep or too flat."""
    options, edge = field.space.options, field.edge
    share = options.steep_share
    low, high = np.quantile(edge.slopes[edge.moves], (share, 1.0 - share))
    return bool(low < options.slopes[0] or high > options.slopes[1])


def redistanced(field: AnyField) -> AnyField:
    """A field with the same zero and slopes of one there, that keeps minimum sizes.

    It minimises a int phi^2 / h^2 + int (dphi/dn + 1)^2 + b sum (phi - d)^2 / h^2 within the rows
    of sizes, with options a of the zero and b of what is far from it, at the distance d.
    """
    space, options, edge = field.space, field.space.options, field.edge
    grid, moves = space.grid, np.flatnonzero(edge.moves)
    spacing = grid.spacing
    points, normals = edge.points[moves], edge.normals[moves]
    weights = diags(edge.lengths[moves] / spacing)
    values = grid.rows(points)
    outward = grid.slope_rows(points, normals)
    nodes = grid.nodes[space.near_nodes]
    distance = np.minimum(cKDTree(points).query(nodes)[0], options.cut_off * spacing)
    target = np.sign(field.spline(nodes)) * distance
    at_nodes = grid.rows(nodes)
    far = options.far_weight / spacing**2
    zero = options.zero_weight / spacing**2
    matrix = zero * values.T @ weights @ values + outward.T @ weights @ outward
    matrix = csc_matrix(
        matrix + far * (at_nodes.T @ at_nodes + options.bending_weight * grid.bending)
    )
    right = -outward.T @ edge.lengths[moves] / spacing + far * at_nodes.T @ target
    rows = SizeRows.of(field)
    violations = np.minimum(rows.values, options.at_once)
    slope = matrix @ field.variables - right
    # variables at their bounds that would leave these stay
    smooth = SmoothMotion(matrix, ~space.held & ~(at_bounds(field) & (slope < 0.0)))
    motion, _ = Projection(smooth, slope, rows.slopes).step(violations, 1.0)
    return field.with_variables(field.variables + motion)
