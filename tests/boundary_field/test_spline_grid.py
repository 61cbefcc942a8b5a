# SPDX-License-Identifier: MIT
"""Spline fields beside their differences, and their mirror images."""

from __future__ import annotations

import numpy as np

from dolfinx_ffr.boundary_field import SplineGrid
from dolfinx_ffr.design import Mirror, images

BOX = np.array([[0.0, 0.0], [0.4, 0.05]])


def random_field() -> tuple[SplineGrid, np.ndarray, np.ndarray]:
    """A grid along an inclined mirror line, random variables, and points in the box."""
    normal = np.array([0.3, 1.0]) / np.hypot(0.3, 1.0)
    isometries = images([Mirror((0.2, 0.01), tuple(normal))])
    axes = np.array([normal, [-normal[1], normal[0]]])
    grid = SplineGrid.around(BOX, 4e-3, isometries, axes)
    random = np.random.default_rng(0)
    return grid, random.standard_normal(grid.size), random.uniform(*BOX, (30, 2))


def test_a_field_is_its_own_mirror_image_to_round_off() -> None:
    grid, variables, points = random_field()
    image = images([Mirror((0.2, 0.01), (0.3, 1.0))])[1](points)
    assert np.allclose(grid.value(variables, image), grid.value(variables, points), atol=1e-12)


def test_rows_are_the_values_and_derivatives_of_a_field() -> None:
    grid, variables, points = random_field()
    step = 1e-7
    assert np.allclose(grid.rows(points) @ variables, grid.value(variables, points), atol=1e-13)
    for i, unit in enumerate(np.eye(2)):
        ends = [grid.value(variables, points + side * step * unit) for side in (1.0, -1.0)]
        slope = grid.slope_rows(points, np.tile(unit, (30, 1))) @ variables
        assert np.allclose(slope, (ends[0] - ends[1]) / (2.0 * step), rtol=1e-5, atol=1e-3)
        ends = [grid.gradient(variables, points + side * step * unit) for side in (1.0, -1.0)]
        for j in (0, 1):
            only = np.zeros((30, 2, 2))
            only[:, i, j] = 1.0
            bend = grid.bend_rows(points, only, np.zeros((30, 2)), np.zeros(30)) @ variables
            difference = (ends[0] - ends[1])[:, j] / (2.0 * step)
            assert np.allclose(bend, difference, rtol=1e-4, atol=1.0)


def test_splines_reproduce_linear_fields() -> None:
    grid = SplineGrid.around(BOX, 4e-3, images([]), np.eye(2))
    points = np.random.default_rng(1).uniform(*BOX, (30, 2))
    variables = grid.nodes @ [2.0, -3.0] + 1.0
    assert np.allclose(grid.value(variables, points), points @ [2.0, -3.0] + 1.0, atol=1e-13)
