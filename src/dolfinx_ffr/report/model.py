# SPDX-License-Identifier: MIT
"""The sections about the model: parts with their dimensions, and the scene."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from .folder import Row, Run, Table, words
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


def parts(run: Run) -> list[Table]:
    """The dimensions of each part."""
    tables = [_dimensions(name, part) for name, part in run.mapping("parts").items()]
    return [table for table in tables if table]


def _dimensions(name: str, part: Mapping[str, Any]) -> Table | None:
    rows: list[Row] = []

    def row(quantity: str, value: Any, unit: str, digits: int = 4) -> None:
        rows.append((quantity, *Scale.of(unit, value, digits)))

    x_min, y_min, x_max, y_max = part["bounds"]
    length, height = x_max - x_min, y_max - y_min
    row("Length, along x", length, "m")
    row("Height, along y", height, "m")
    row("Thickness", part.get("thickness"), "m")
    row("Area", part["area"], "m^2", 5)
    row("Mass", part.get("mass"), "kg")
    # of the center of mass five digits of the size are of interest
    resolution = 10.0 ** (math.floor(math.log10(max(length, height))) - 4)
    for axis, value in zip("xy", part["center"], strict=True):
        row(f"Centre of mass, {axis}", resolution * round(value / resolution), "m")
    for key in ("thinnest_member", "narrowest_gap"):
        quantity, width = key.replace("_", " ").capitalize(), part.get(key)
        rows.append((quantity, *(Scale.of("m", width["value"], 3) if width else ("none", ""))))
    counts = {"Pieces": "pieces", "Holes": "holes", "Loose pieces left out": "loose"}
    rows += [(quantity, fixed(part[key]), "") for quantity, key in counts.items()]
    return Table.of(f"Part {name}", ["", "Value", "Unit"], rows, [1])


def scene(run: Run) -> dict[str, Any]:
    """Bodies, materials, joints, loads, time integration and the text of `model_report`."""
    recorded = run.mapping("scene")
    cases = run.mapping("load_cases")
    bodies: list[Row] = []
    materials: list[Row] = []
    for name, body in recorded.get("bodies", {}).items():
        numbers = [fixed(body.get(key)) for key in _BODY]
        bodies.append((name, str(body.get("kind", "")), *numbers, percent(body.get("softening"))))
        material = dict(body.get("material") or {})
        model = words(str(material.pop("kind", ""))).lower()
        for key, value in material.items():
            quantity, unit = _MATERIAL.get(key, (key, ""))
            scale = Scale(unit, value)
            materials.append((name, model, quantity, scale.without_zeros(value), scale.name))
    return {
        "text": str(recorded.get("text") or ""),
        "integrator": _integration(recorded),
        "load_cases": _load_cases(cases),
        "loads": [str(load) for load in recorded.get("loads", [])],
        "left_out": [str(name) for name in recorded.get("left_out", [])],
        "bodies": Table.of(
            "Bodies", ["Body", "Kind", *_BODY.values(), "Softening [%]"], bodies, range(2, 9)
        ),
        "materials": Table.of("Materials", ["Body", "Model", "", "Value", "Unit"], materials, [3]),
        "joints": _joints(recorded.get("joints", []), len(cases)),
    }


def _load_cases(cases: Mapping[str, Any]) -> Table | None:
    rows: list[Row] = []
    for name, case in cases.items():
        loads = "; ".join(map(str, case.get("loads", []))) or "none"
        rows.append((name, _integration(case), loads))
    return Table.of("Load cases", ["Load case", "Time integration", "Loads beside inertia"], rows)


def _joints(joints: Sequence[Mapping[str, Any]], n_cases: int) -> Table | None:
    """The joints; with several load cases, those that have each of them."""
    cases_of_joint: dict[tuple[str, str, str], list[str]] = {}
    for joint in joints:
        key = str(joint["name"]), str(joint["kind"]), ", ".join(map(str, joint["between"]))
        cases_of_joint.setdefault(key, []).append(str(joint.get("load_case", "")))
    head, rows = ["Joint", "Kind", "Between"], list[Row](cases_of_joint)
    if n_cases:
        head.append("In load case")
        rows = [
            (*key, "all" if len(cases) == n_cases else ", ".join(cases))
            for key, cases in cases_of_joint.items()
        ]
    return Table.of("Joints", head, rows)


def _integration(recorded: Mapping[str, Any]) -> str:
    """The time integration in words."""
    if not recorded.get("integrator"):
        return ""
    method = re.sub(r"(?<=[a-z])(?=[A-Z])", "-", str(recorded["integrator"]))
    text = f"{method} of order {recorded.get('order', NOTHING)}"
    if real(recorded.get("duration")):
        text += f", {Scale('', 1).without_zeros(recorded['duration'])} s"
    if recorded.get("steps"):
        text += f" in {fixed(recorded['steps'])} steps"
    return text
