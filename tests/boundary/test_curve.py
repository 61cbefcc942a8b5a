# SPDX-License-Identifier: MIT
"""Curves that move: uniform cubic B-splines."""

from __future__ import annotations

import numpy as np
import pytest

from dolfinx_ffr.boundary.curve import FreeCurve

ANGLES = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
CIRCLE = 5e-3 * np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
SINE = np.column_stack([np.linspace(0.0, 0.1, 800), 1e-3 * np.sin(np.linspace(0.0, 6.0, 800))])


@pytest.mark.parametrize("curve", [FreeCurve.fit(CIRCLE, 2e-3), FreeCurve.fit(SINE, 5e-3, (3, 7))])
def test_the_spline_of_a_drawing_is_the_same_curve(curve: FreeCurve) -> None:
    spline = curve.spline()
    t = np.linspace(0.0, 1.0, 301)
    assert np.max(np.abs(spline.at(t) - curve.at(t * curve.spans))) < 1e-15
    assert np.array_equal(spline.start, spline.end) == curve.closed


def test_a_circle_keeps_its_radius_steps_go_and_ends_stay() -> None:
    for spacing in (2e-3, 4e-3, 7e-3):  # with 16, 8 and 5 controls
        fitted = FreeCurve.fit(CIRCLE, spacing)
        s = np.linspace(0.0, fitted.spans, 500)
        assert np.max(np.abs(np.linalg.norm(fitted.at(s), axis=1) / 5e-3 - 1.0)) < 0.02, spacing
    # steps of 0.4 mm along a line, as elements leave them
    stairs = np.column_stack([np.linspace(0.0, 0.1, 2000), 2e-4 * (ANGLES * 40 % 2 > 1)])
    fitted = FreeCurve.fit(stairs, 5e-3, (0, 1))
    inner = fitted.at(np.linspace(0.2, 0.8, 400) * fitted.spans)
    assert np.ptp(inner[:, 1]) < 2e-5
    assert np.max(np.abs(fitted.at(np.array([0.0, fitted.spans])) - stairs[[0, -1]])) < 1e-16
    assert fitted.fixed.tolist() == [True, *[False] * (len(fitted.control) - 2), True]


def test_slopes_are_those_of_the_points() -> None:
    for curve in (FreeCurve.fit(CIRCLE, 2e-3), FreeCurve.fit(SINE, 5e-3, (3, 7))):
        s, h = np.linspace(0.1, curve.spans - 0.1, 50), 1e-5
        for order in (1, 2):
            slope = curve.rows(s, order) @ curve.control
            beside = [curve.rows(s + side * h, order - 1) @ curve.control for side in (1.0, -1.0)]
            computed = (beside[0] - beside[1]) / (2.0 * h)
            inner = np.floor(s + h) == np.floor(s - h)  # third derivatives have steps
            assert np.max(np.abs(slope - computed)[inner]) < 1e-8 * np.max(np.abs(slope)) + 1e-12


def test_normals_point_out_of_the_material() -> None:
    # material is on the left: within a counterclockwise circle, and normals point away from it
    curve = FreeCurve.fit(CIRCLE, 2e-3)
    radial = curve.control / np.linalg.norm(curve.control, axis=1)[:, None]
    assert np.min(np.einsum("ij,ij->i", radial, curve.control_normals)) > 0.99


@pytest.mark.parametrize(("off", "accuracy"), [(0.0, 1e-15), (2e-4, 1e-10)])
def test_nearest_points(off: float, accuracy: float) -> None:
    """Of points on the curve by Newton's method; beside it the curvature is left out."""
    curve = FreeCurve.fit(CIRCLE, 2e-3)
    s = np.linspace(0.0, curve.spans, 40, endpoint=False)
    points = curve.at(s) + off * curve.normals(s)
    computed = curve.nearest(points, (s + 0.1) % curve.spans)
    assert np.max(np.abs(curve.at(computed) - curve.at(s))) < accuracy


def test_the_area_and_its_slopes() -> None:
    """The area of a circle's polygon, and central differences, which are exact as it is square."""
    curve = FreeCurve.fit(CIRCLE, 2e-3)
    x, y = curve.at(np.linspace(0.0, curve.spans, 4000, endpoint=False)).T
    polygon = 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    area, slopes = curve.area
    assert area == pytest.approx(polygon, rel=1e-6)
    offsets = np.cos(np.arange(len(curve.control)))
    step = 1e-4 * offsets[:, None] * curve.control_normals
    ahead, behind = (curve.moved(curve.control + side * step).area[0] for side in (1.0, -1.0))
    assert slopes @ offsets == pytest.approx((ahead - behind) / 2e-4, rel=1e-9)
