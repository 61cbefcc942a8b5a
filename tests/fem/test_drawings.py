# SPDX-License-Identifier: MIT
"""Drawings made at random whose area has a closed form: 25 DXF files."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest

from dolfinx_ffr.fem.outline import closed_outline, read_outline

Rng = np.random.Generator

#: Cells of a plate, each 2 x 2 with one shape of a radius of at most 0.9, across and down
GRID = (5, 3)


def area(path: Path, unit: str | None = None) -> float:
    """That of the faces of a drawing, by Green's theorem [m^2]."""
    drawing = closed_outline(str(path), read_outline(path, unit), [])
    return float(sum(drawing.moments(face.loops)[0] for face in drawing.faces))


def number(rng: Rng, low: float, high: float) -> float:
    return round(float(rng.uniform(low, high)), 4)


def dxf_shape(rng: Rng, layout: Any, layer: str) -> float:
    """Draw a shape about the origin, and return its area."""
    a, b = number(rng, 0.3, 0.6), number(rng, 0.3, 0.6)
    on = {"layer": layer}
    kind = ["rectangle", "circle", "ring", "ellipse", "arcs", "bulges", "spline", "rational", "-"]
    match kind[int(rng.integers(9))]:
        case "rectangle":
            corners = [(-a, -b), (a, -b), (a, b), (-a, b)]
            for p, q in zip(corners, corners[1:] + corners[:1], strict=True):
                layout.add_line(p, q, dxfattribs=on)
            return 4 * a * b
        case "circle":
            layout.add_circle((0, 0), a, dxfattribs=on)
            return math.pi * a * a
        case "ring":
            layout.add_circle((0, 0), 0.6, dxfattribs=on)
            layout.add_circle((0.1, 0), 0.5 * a, dxfattribs=on)
            return math.pi * (0.36 - 0.25 * a * a)
        case "ellipse":
            ratio = number(rng, 0.3, 1.0)
            layout.add_ellipse((0, 0), (0.8 * a, 0.6 * a), ratio, dxfattribs=on)
            return math.pi * ratio * a * a
        case "arcs":
            layout.add_arc((a, 0), 0.3, -90, 90, dxfattribs=on)
            layout.add_arc((-a, 0), 0.3, 90, 270, dxfattribs=on)
            for y in (0.3, -0.3):
                layout.add_line((-a, y), (a, y), dxfattribs=on)
            return 4 * a * 0.3 + math.pi * 0.09
        case "bulges":
            # a bulge is the tangent of a quarter of the angle: 1 is a half circle
            points = [(-a, -b, 0), (a, -b, 1), (a, b, 0), (-a, b, -0.2)]
            add = layout.add_lwpolyline if rng.random() < 0.5 else layout.add_polyline2d
            add(points, format="xyb", close=True, dxfattribs=on)
            angle = 4 * math.atan(0.2)
            radius = b / math.sin(0.5 * angle)
            return 4 * a * b + 0.5 * math.pi * b * b - 0.5 * radius**2 * (angle - math.sin(angle))
        case "spline":
            # a Bezier arch over a line, 3/4 of the frame by the ratio of its widths
            control = [(-a, 0, 0), (-a, b, 0), (a, b, 0), (a, 0, 0)]
            layout.add_open_spline(control, dxfattribs=on)
            layout.add_line((-a, 0), (a, 0), dxfattribs=on)
            return 0.75 * b * 2 * a * 0.8
        case "rational":
            ring = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)]
            layout.add_rational_spline(
                [(a * x, a * y, 0) for x, y in ring],
                weights=[1, math.sqrt(0.5)] * 4 + [1],
                degree=2,
                knots=[0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4],
                dxfattribs=on,
            )
            return math.pi * a * a
    # a closed uniform spline through a square of control points, of degree 2: corners are
    # parabolas between the middles of the sides, each of which cuts off a sixth
    square = [(-a, -a, 0), (a, -a, 0), (a, a, 0), (-a, a, 0)]
    layout.add_spline(dxfattribs=on).set_closed(square, degree=2)
    return 4 * a * a * (1 - 4 * 0.5 * 0.25 / 3)


def dxf_drawing(rng: Rng, path: Path) -> float:
    """Write a plate with holes, and return its area [m^2]."""
    code, unit = [(1, 0.0254), (2, 0.3048), (4, 1e-3), (5, 1e-2), (6, 1.0)][int(rng.integers(5))]
    drawing = ezdxf.new("R2010")
    drawing.header["$INSUNITS"] = code
    drawing.layers.add("Off").off()
    drawing.layers.add("Frozen").freeze()
    drawing.layers.add("holes")
    space = drawing.modelspace()
    width, height = 2.0 * GRID[0], 2.0 * GRID[1]
    space.add_lwpolyline([(0, 0), (width, 0), (width, height), (0, height)], close=True)
    whole = width * height
    for k, (i, j) in enumerate(np.ndindex(*GRID)):
        place = (2.0 * i + 1.0, 2.0 * j + 1.0)
        block = drawing.blocks.new(f"b{k}")
        layer, own, attributes, seen = [
            ("0", "0", {}, True),
            ("holes", "0", {}, True),
            ("0", "holes", {}, True),
            ("off", "holes", {}, True),  # of a block that is off, what is on other layers is drawn
            ("OFF", "0", {}, False),
            ("frozen", "holes", {}, False),
            ("holes", "OFF", {}, False),
            ("holes", "frozen", {}, False),
            ("0", "0", {"invisible": 1}, False),
        ][int(rng.integers(9))]
        hole = dxf_shape(rng, block, own)
        x, y = number(rng, 0.5, 1.0), number(rng, 0.5, 1.0)
        name = block.name
        if rng.random() < 0.3:  # a block in a block
            outer = drawing.blocks.new(f"outer{k}")
            outer.add_blockref(name, (0, 0), dxfattribs={"rotation": number(rng, 0, 360)})
            name = outer.name
        kind = int(rng.integers(5))
        scales = [(1.0, 1.0), (x, x), (x, y), (-x, x), (x, -y)][kind]
        placed = {
            "layer": layer,
            "rotation": number(rng, 0, 360),
            "xscale": scales[0],
            "yscale": scales[1],
            **attributes,
        }
        if rng.random() < 0.2:  # four small ones in rows and columns
            placed |= {"xscale": 0.3 * scales[0], "yscale": 0.3 * scales[1], "rotation": 0}
            placed |= {"row_count": 2, "column_count": 2, "row_spacing": 0.8, "column_spacing": 0.8}
            place = (place[0] - 0.4, place[1] - 0.4)
            hole *= 4 * 0.09
        space.add_blockref(name, place, dxfattribs=placed)
        if seen:
            whole -= hole * abs(scales[0] * scales[1])
    drawing.saveas(path)
    return whole * unit**2


@pytest.mark.parametrize("seed", range(25))
def test_dxf(tmp_path: Path, seed: int) -> None:
    """Blocks scaled, turned, mirrored, in blocks and in rows; layers that are off or frozen."""
    path = tmp_path / "plate.dxf"
    expected = dxf_drawing(np.random.default_rng(seed), path)
    assert area(path) == pytest.approx(expected, rel=2e-6)
