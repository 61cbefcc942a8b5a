# SPDX-License-Identifier: MIT
"""The sections about the model: parts with their dimensions, and the scene."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from .drawing import Drawing, read_outline
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
