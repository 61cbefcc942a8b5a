# SPDX-License-Identifier: MIT
"""The sections about the model: parts, their drawings with dimensions, and the scene."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from .folder import Row, Run, Table, data_uri
from .numbers import NOTHING, Scale, fixed, percent, real

#: Numbers of a material, with their units of SI
_MATERIAL = {
    "young": ("Young's modulus", "Pa"),
    "poisson": ("Poisson's ratio", ""),
    "density": ("Density", "kg/m^3"),
    "thickness": ("Thickness", "m"),
    "shear": ("Shear modulus", "Pa"),
    "angle": ("Angle of the fibres", "rad"),
}
#: Numbers of a body, with their headings
_BODY = {
    "elements": "Elements",
    "order": "Order",
    "constraint_modes": "Constraint modes",
    "normal_modes": "Normal modes",
    "highest_frequency": "Highest mode [Hz]",
    "next_frequency": "Next mode [Hz]",
}
_NAMESPACE = "{http://www.w3.org/2000/svg}"
#: Data of a path
_PATH = re.compile(r"[MLACQZHVmlacqzhv0-9eE+\-.,\s]+")
#: Smallest width of a drawing in units of the height of its letters
_LETTERS = 62.0


def parts(run: Run) -> list[dict[str, Any]]:
    """Name, drawing and table of each part."""
    found = []
    recorded = run.mapping("parts")
    for name, given in recorded.items():
        file, drawing = run.folder.drawing_of(name, alone=len(recorded) == 1), None
        if file is None:
            run.missing(f"part.svg: the drawing of the part {name} (Part.write)")
        else:
            try:
                drawing = Drawing(read_outline(file), given)
            except (KeyError, TypeError, ValueError) as error:
                run.missing(f"{file.name}: the drawing of the part {name} cannot be used ({error})")
        found.append({"name": name, "drawing": drawing, "table": _dimensions(name, given)})
    return found


def outline(run: Run) -> str:
    """The file part.svg as an address, where no part is recorded; else ""."""
    file = run.folder.drawing_of("part", alone=True)
    if run.mapping("parts") or file is None:
        return ""
    try:
        read_outline(file)
    except ValueError as error:
        run.missing(f"{file.name}: {error}")
        return ""
    return data_uri(file.read_bytes(), "image/svg+xml")


def _dimensions(name: str, given: Mapping[str, Any]) -> Table | None:
    rows: list[Row] = []

    def row(what: str, value: Any, unit: str, digits: int = 4) -> None:
        rows.append((what, *Scale.of(unit, value, digits)))

    x0, y0, x1, y1 = given["bounds"]
    step = 10.0 ** (math.floor(math.log10(max(x1 - x0, y1 - y0))) - 4)  # as fine as is of interest
    row("Length, along x", x1 - x0, "m")
    row("Height, along y", y1 - y0, "m")
    row("Thickness", given.get("thickness"), "m")
    row("Area", given["area"], "m^2", 5)
    row("Mass", given.get("mass"), "kg")
    for axis, value in zip("xy", given["center"], strict=True):
        row(f"Centre of mass, {axis}", step * round(value / step), "m")
    for key in ("thinnest_member", "narrowest_gap"):
        what, width = key.replace("_", " ").capitalize(), given.get(key)
        rows.append((what, *(Scale.of("m", width["value"], 3) if width else ("none", ""))))
    counts = {"Pieces": "pieces", "Holes": "holes", "Loose pieces left out": "loose"}
    rows += [(what, fixed(given[key]), "") for what, key in counts.items()]
    rows.append(("Deviation of the drawn curves", fixed(1e6 * given["deviation"], 2), "µm"))
    return Table.of(f"Part {name}", ["", "Value", "Unit"], rows, [1])


def scene(run: Run) -> dict[str, Any]:
    """Bodies, materials, joints, loads, time integration and the text of `model_report`."""
    recorded = run.mapping("scene")
    bodies: list[Row] = []
    materials: list[Row] = []
    for name, body in recorded.get("bodies", {}).items():
        numbers = [fixed(body.get(key)) for key in _BODY]
        kind, softening = str(body.get("kind", "")), percent(body.get("softening"))
        bodies.append((name, kind, *numbers, softening))
        material = dict(body.get("material") or {})
        kind = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", str(material.pop("kind", ""))).lower()
        for key, value in material.items():
            what, unit = _MATERIAL.get(key, (key, ""))
            scale = Scale(unit, value)
            materials.append((name, kind, what, scale.given(value), scale.name))
    cases = run.mapping("load_cases")
    used: dict[tuple[str, str, str], list[str]] = {}  # a joint, and the load cases that have it
    for j in recorded.get("joints", []):
        key = str(j["name"]), str(j["kind"]), ", ".join(map(str, j["between"]))
        used.setdefault(key, []).append(str(j.get("load_case", "")))
    joints: list[Row] = [
        (*key, *(["all" if len(names) == len(cases) else ", ".join(names)] if cases else []))
        for key, names in used.items()
    ]
    moved: list[Row] = [
        (name, _integration(given), "; ".join(map(str, given.get("loads", []))) or "none")
        for name, given in cases.items()
    ]
    head = ["Load case", "Time integration", "Loads beside inertia"]
    body_head = ["Body", "Kind", *_BODY.values(), "Softening [%]"]
    joint_head = ["Joint", "Kind", "Between", *(["In load case"] if cases else [])]
    return {
        "text": str(recorded.get("text") or ""),
        "integrator": _integration(recorded),
        "load_cases": Table.of("Load cases", head, moved),
        "loads": [str(load) for load in recorded.get("loads", [])],
        "left_out": [str(what) for what in recorded.get("left_out", [])],
        "bodies": Table.of("Bodies", body_head, bodies, range(2, 9)),
        "materials": Table.of("Materials", ["Body", "Model", "", "Value", "Unit"], materials, [3]),
        "joints": Table.of("Joints", joint_head, joints),
    }


def _integration(recorded: Mapping[str, Any]) -> str:
    """The time integration in words."""
    if not recorded.get("integrator"):
        return ""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", "-", str(recorded["integrator"]))
    said = f"{words} of order {recorded.get('order', NOTHING)}"
    if real(recorded.get("duration")):
        said += f", {Scale('', 1).given(recorded['duration'])} s"
    if recorded.get("steps"):
        said += f" in {fixed(recorded['steps'])} steps"
    return said


@dataclass(frozen=True)
class Outline:
    """Outline of a part in its SVG file: millimetres, y downwards."""

    path: str  #: Data of the path
    interfaces: dict[str, str]  #: Data of their paths, by name
    scale: float  #: Units of the file in one millimetre


@dataclass(frozen=True)
class Label:
    """A text with the lines that lead to the place that it names."""

    text: str
    x: float
    y: float
    turned: bool = False
    lines: list[tuple[float, float, float, float]] = field(default_factory=list)


def read_outline(path: Path) -> Outline:
    """The outlines in an SVG file that `Part.write` has written, or a ValueError."""
    try:
        root = ElementTree.fromstring(path.read_bytes())
    except (ElementTree.ParseError, LookupError) as error:
        raise ValueError(f"{path.name} is no SVG file: {error}") from None
    found = {e.get("id", ""): e.get("d", "") for e in root.iter(f"{_NAMESPACE}path")}
    box = (root.get("viewBox") or "").split()
    width = re.fullmatch(r"([0-9.eE+-]+)mm", root.get("width") or "")
    good = all(_PATH.fullmatch(data) for data in found.values())
    if "part" not in found or not good or len(box) != 4 or width is None:
        raise ValueError(f"{path.name} is no drawing of a part")
    outline = found.pop("part")
    return Outline(outline, found, float(box[2]) / float(width[1]))


class Drawing:
    """A part with dimensions, in millimetres with y downwards; the template draws it.

    The ``figures`` are recorded: ``bounds``, ``center``, ``thinnest_member``, ``narrowest_gap``
    [m]. A KeyError or TypeError is raised where the first two are missing or no numbers.
    """

    def __init__(self, outline: Outline, figures: Mapping[str, Any]) -> None:
        self.outline = outline
        x0, y0, x1, y1 = (1e3 * float(v) for v in figures["bounds"])
        left, right, top, bottom = x0, x1, -y1, -y0
        wide, high = right - left, bottom - top
        #: Height of letters [mm]
        self.letter = max(wide, 0.6 * high) / _LETTERS
        h = self.letter
        #: Centre of mass
        self.center = (1e3 * float(figures["center"][0]), -1e3 * float(figures["center"][1]))
        self.labels: list[Label] = []
        self.widths: list[tuple[str, float, float, float, float]] = []
        rows = self._callouts(figures, left, right, top)
        below, beside = bottom + 2.6 * h, left - 2.6 * h
        along, across = (
            f"{Scale('m', wide).given(1e-3 * round(length, 3))} mm" for length in (wide, high)
        )
        self.labels.append(Label(along, 0.5 * (left + right), below - 0.5 * h))
        self.labels.append(Label(across, beside - 0.5 * h, 0.5 * (top + bottom), turned=True))
        #: Lines of dimension and of extension: x1, y1, x2, y2, whether with arrows
        self.lines = [
            (left, below, right, below, True),
            (left, bottom + 0.5 * h, left, below + 0.8 * h, False),
            (right, bottom + 0.5 * h, right, below + 0.8 * h, False),
            (beside, top, beside, bottom, True),
            (left - 0.5 * h, top, beside - 0.8 * h, top, False),
            (left - 0.5 * h, bottom, beside - 0.8 * h, bottom, False),
        ]
        above = (2.2 + 1.6 * rows) * h if rows else h
        low, head = left - 5.5 * h, top - above
        #: Of the whole drawing
        self.box = (low, head, right + 3.0 * h - low, below + 2.0 * h - head)

    def _callouts(self, figures: Mapping[str, Any], left: float, right: float, top: float) -> int:
        """Name thinnest member and narrowest gap above the part; returns the rows of text."""
        h, found = self.letter, []
        for key in ("thinnest_member", "narrowest_gap"):
            if width := figures.get(key):
                ends = 1e3 * np.asarray(width["ends"], dtype=np.float64) * [1.0, -1.0]
                text = f"{key.replace('_', ' ')} {Scale.of('m', width['value'], 3)[0]} mm"
                found.append((float(ends[:, 0].mean()), ends, text, key))
        found.sort(key=lambda each: each[0])
        halves = [0.32 * h * len(text) for _, _, text, _ in found]
        pairs = zip(found, halves, strict=True)
        middles = [min(max(each[0], left + half), right - half) for each, half in pairs]
        rows = [0] * len(found)
        if len(found) == 2 and middles[1] - halves[1] < middles[0] + halves[0] + h:
            # one below the other, the lower one beside the line of the upper one
            lower = 0 if found[0][0] - 2.0 * halves[0] > left else 1
            aside = halves[lower] + 0.4 * h
            middles[lower] = found[lower][0] + (aside if lower else -aside)
            rows[1 - lower] = 1
        places = zip(found, middles, halves, rows, strict=True)
        for (x, ends, text, key), middle, half, row in places:
            y = top - (1.6 + 1.6 * row) * h
            (xa, ya), (xb, yb) = ends
            self.widths.append((key, xa, ya, xb, yb))
            line = (x, y + 0.45 * h if abs(middle - x) < half else y - 0.8 * h)
            leader = (*line, x, float(ends[:, 1].mean()))
            self.labels.append(Label(text, middle, y, lines=[leader]))
        return max(rows) + 1 if found else 0
