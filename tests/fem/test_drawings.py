# SPDX-License-Identifier: MIT
"""Drawings made at random whose area has a closed form: fifty SVG files, fifty DXF files."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest

from dolfinx_ffr.fem.curves import enclosed
from dolfinx_ffr.fem.outline import closed_outline, read_outline

Rng = np.random.Generator

#: Cells of a plate, each 2 x 2 with one shape of a radius of at most 0.9, across and down
GRID = (5, 3)


def area(path: Path, unit: str | None = None) -> float:
    """That of the faces of a drawing, by Green's theorem [m^2]."""
    drawing = closed_outline(str(path), read_outline(path, unit), [])
    loops = [loop for face in drawing.faces for loop in face.loops]
    curves = [
        [drawing.curves[i] if forward else drawing.curves[i].reversed() for i, forward in loop]
        for loop in loops
    ]
    return float(sum(enclosed(loop)[0] for loop in curves))


def number(rng: Rng, low: float, high: float) -> float:
    return round(float(rng.uniform(low, high)), 4)


#: A shape within the unit circle, and its area
Shape = tuple[str, float]


def svg_shape(rng: Rng) -> Shape:
    a, b = number(rng, 0.3, 0.6), number(rng, 0.3, 0.6)
    n = int(rng.integers(3, 8))
    ring = [
        (a * math.cos(2 * math.pi * k / n), a * math.sin(2 * math.pi * k / n)) for k in range(n)
    ]
    points = " ".join(f"{x!r},{y!r}" for x, y in ring)
    regular = 0.5 * n * a * a * math.sin(2 * math.pi / n)
    slot = f"M {-a},{-b} h {2 * a} a {0.3},{b} 0 0 1 0,{2 * b} h {-2 * a} z"
    wave = f"M {-a},{b} Q 0,{-b} {a},{b} C {a},{b + 0.3} {-a},{b + 0.3} {-a},{b} Z"
    r = 0.2
    return [
        (f'<rect x="{-a}" y="{-b}" width="{2 * a}" height="{2 * b}"/>', 4 * a * b),
        (
            f'<rect x="{-a}" y="{-b}" width="{2 * a}" height="{2 * b}" rx="{r}" ry="{r}"/>',
            4 * a * b - (4 - math.pi) * r * r,
        ),
        (f'<circle r="{a}"/>', math.pi * a * a),
        (f'<ellipse rx="{a}" ry="{b}" transform="rotate(33)"/>', math.pi * a * b),
        (f'<polygon points="{points}"/>', regular),
        (f'<path d="M {points} Z"/>', regular),
        (f'<path d="{slot}"/>', 4 * a * b + 0.5 * math.pi * 0.3 * b),
        # a parabola, two thirds of its control point's triangle; a cubic arch, 3/4 of the frame
        (f'<path d="{wave}"/>', 2 / 3 * 2 * a * b + 0.75 * 0.3 * 2 * a * 0.8),
        (f'<circle r="0.6"/><circle cx="0.1" r="{0.5 * a}"/>', math.pi * (0.36 - 0.25 * a * a)),
    ][int(rng.integers(9))]


def svg_placed(rng: Rng, shape: Shape, x: float, y: float, k: int) -> tuple[str, str, float]:
    """A shape about a place: definitions, what is drawn, the area."""
    text, size = shape
    angle, factor = number(rng, -180, 180), number(rng, 0.6, 1.0)
    turned = f"translate({x},{y}) rotate({angle}) scale({factor})"
    view = 'viewBox="-1 -1 2 2"'
    scaled = size * factor**2
    flat = number(rng, 0.4, 0.9)  # height of a view whose width is 1.6
    wide = f'width="1.6" height="{2 * flat}"'
    at = f'x="{x - 0.8}" y="{y - flat}"'
    none = 'preserveAspectRatio="none"'
    return [
        ("", f'<g transform="translate({x} {y})">{text}</g>', size),
        ("", f'<g transform="{turned}">{text}</g>', scaled),
        ("", f'<g transform="{turned} scale(-1,0.7)">{text}</g>', 0.7 * scaled),
        ("", f'<g transform="translate({x},{y})"><g transform="skewX(5)">{text}</g></g>', size),
        (f'<g id="d{k}">{text}</g>', f'<use href="#d{k}" x="{x}" y="{y}"/>', size),
        (
            f'<g id="d{k}">{text}</g>'
            f'<use id="e{k}" xlink:href="#d{k}" transform="scale({factor})"/>',
            f'<use xlink:href="#e{k}" transform="translate({x},{y}) rotate({angle})"/>',
            scaled,
        ),
        (
            f'<symbol id="d{k}" {view}>{text}</symbol>',
            f'<use href="#d{k}" {at} {wide}/>',
            size * min(0.8, flat) ** 2,
        ),
        (
            f'<symbol id="d{k}" {view} {none}>{text}</symbol>',
            f'<use href="#d{k}" {at} {wide}/>',
            size * 0.8 * flat,
        ),
        ("", f"<svg {at} {wide} {view}>{text}</svg>", size * min(0.8, flat) ** 2),
        ("", f"<svg {at} {wide} {view} {none}>{text}</svg>", size * 0.8 * flat),
        ("", f'<g transform="{turned}"><rect id="d{k}" x="-50%" y="-.4" '
         f'width="10%" height=".8" transform="translate(4.5,0)"/></g>', 0.8 * factor**2),
    ][int(rng.integers(11))]  # fmt: skip


def svg_hidden(rng: Rng, text: str, k: int) -> str:
    return [
        f'<g display="none">{text}</g>',
        f'<g style="fill:red; display : none !important"><g display="inline">{text}</g></g>',
        f'<g class="red off">{text}</g>',
        f'<g id="gone{k}">{text}</g><style>#gone{k} {{ display: none }}</style>',
        f'<g visibility="hidden">{text}</g>',
        f'<g style="visibility:collapse">{text}</g>',
        f'<g class="unseen">{text}</g>',
        f"<defs>{text}</defs>",
        f'<symbol viewBox="0 0 9 9">{text}</symbol>',
        f'<clipPath id="c{k}">{text}</clipPath>',
        f"<mask>{text}</mask>",
        f"<marker>{text}</marker>",
    ][int(rng.integers(12))]


def svg_seen(rng: Rng, text: str) -> str:
    """In a group that is hidden what is visible is seen, and what is not drawn may be used."""
    return [
        text,
        text,
        f'<g visibility="hidden"><g style="visibility:visible">{text}</g></g>',
        f'<g class="red">{text}</g>',
    ][int(rng.integers(4))]


UNITS = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254, "pt": 0.0254 / 72, "pc": 0.0254 / 6}


def svg_drawing(rng: Rng) -> tuple[str, float]:
    """A plate with holes, and its area [m^2]."""
    width, height = 2.0 * GRID[0], 2.0 * GRID[1]
    definitions, drawn, whole = "", "", width * height
    for k, (i, j) in enumerate(np.ndindex(*GRID)):
        x, y = 2.0 * i + 1.0, 2.0 * j + 1.0
        defined, text, hole = svg_placed(rng, svg_shape(rng), x, y, k)
        definitions += defined
        if rng.random() < 0.4:
            drawn += svg_hidden(rng, text, k)
        else:
            drawn += svg_seen(rng, text)
            whole -= hole
    w, h = number(rng, 20, 60), number(rng, 20, 60)
    unit, other = rng.choice(list(UNITS), 2)
    sx, sy = w * UNITS[unit] / width, h * UNITS[other] / height
    kind = str(rng.choice(["", "none", "xMinYMax meet", "xMidYMid slice", "no height"]))
    across, down = {
        "none": (sx, sy),
        "xMidYMid slice": (max(sx, sy),) * 2,
        "no height": (sx, sx),
    }.get(kind, (min(sx, sy),) * 2)
    page = f'width="{w}{unit}"'
    if kind != "no height":
        page += f' height="{h}{other}"'
        page += f' preserveAspectRatio="{kind}"' if kind else ""
    text = (
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        f'{page} viewBox="0 0 {width} {height}"><defs>{definitions}</defs>'
        f'<rect width="{width}" height="100%"/>{drawn}'
        "<style>.off { display:none } .unseen { visibility: hidden } .red { fill: red }</style>"
        "</svg>"
    )
    return text, whole * across * down


@pytest.mark.parametrize("seed", range(50))
def test_svg(tmp_path: Path, seed: int) -> None:
    """Uses, symbols, views in views, transforms, units, per cent; what is hidden is not cut."""
    text, expected = svg_drawing(np.random.default_rng(seed))
    path = tmp_path / "plate.svg"
    path.write_text(text)
    assert area(path) == pytest.approx(expected, rel=2e-6)


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


@pytest.mark.parametrize("seed", range(50))
def test_dxf(tmp_path: Path, seed: int) -> None:
    """Blocks scaled, turned, mirrored, in blocks and in rows; layers that are off or frozen."""
    path = tmp_path / "plate.dxf"
    expected = dxf_drawing(np.random.default_rng(seed), path)
    assert area(path) == pytest.approx(expected, rel=2e-6)
