# SPDX-License-Identifier: MIT
"""The sections about what was designed: parts with their dimensions, and the scene."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from .drawing import Drawing, read_outline
from .folder import data_uri
from .numbers import NOTHING, Scale, fixed, percent
from .run import Row, Run, Table, real

__all__ = ["outline", "parts", "scene"]

#: Numbers of a material, with their units of SI
_MATERIAL = {
    "young": ("Young's modulus", "Pa"),
    "poisson": ("Poisson's ratio", ""),
    "density": ("Density", "kg/m^3"),
    "thickness": ("Thickness", "m"),
    "shear": ("Shear modulus", "Pa"),
    "angle": ("Angle of the fibres", "rad"),
}


def parts(run: Run) -> list[dict[str, Any]]:
    """Name, drawing and table of each part.

    Args:
        run: The run.
    """
    found = []
    recorded = run.mapping("parts")
    for name, given in recorded.items():
        file = run.folder.drawing_of(name, alone=len(recorded) == 1)
        drawing = None
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
    """The file part.svg as an address, where nothing else is known of the part; else "".

    Args:
        run: The run.
    """
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
        scale = Scale(unit, value)
        rows.append((what, scale.text(value, digits), scale.name))

    x0, y0, x1, y1 = given["bounds"]
    step = 10.0 ** (math.floor(math.log10(max(x1 - x0, y1 - y0))) - 4)  # as fine as is of interest
    row("Length, along x", x1 - x0, "m")
    row("Height, along y", y1 - y0, "m")
    row("Thickness", given.get("thickness"), "m")
    row("Area", given["area"], "m^2", 5)
    row("Mass", given.get("mass"), "kg")
    for axis, value in zip("xy", given["center"], strict=True):
        row(f"Centre of mass, {axis}", step * round(value / step), "m")
    for key, what in (("thinnest_member", "Thinnest member"), ("narrowest_gap", "Narrowest gap")):
        width = given.get(key)
        if width:
            row(what, width["value"], "m", 3)
        else:
            rows.append((what, "none", ""))
    for key in ("pieces", "holes"):
        rows.append((key.capitalize(), fixed(given[key]), ""))
    rows.append(("Loose pieces left out", fixed(given["loose"]), ""))
    rows.append(("Deviation of the drawn curves", fixed(1e6 * given["deviation"], 2), "µm"))
    return Table.of(f"Part {name}", ["", "Value", "Unit"], rows, [1])


def scene(run: Run) -> dict[str, Any]:
    """Bodies, materials, joints, loads, time integration and the text of `model_report`.

    Args:
        run: The run.
    """
    recorded = run.mapping("scene")
    bodies: list[Row] = []
    materials: list[Row] = []
    for name, body in recorded.get("bodies", {}).items():
        bodies.append(
            (
                name,
                str(body.get("kind", "")),
                fixed(body.get("elements")) if body.get("elements") else NOTHING,
                fixed(body.get("order")),
                fixed(body.get("constraint_modes")),
                fixed(body.get("normal_modes")),
                fixed(body.get("highest_frequency")),
                fixed(body.get("next_frequency")),
                percent(body.get("softening")),
            )
        )
        material = dict(body.get("material") or {})
        kind = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", str(material.pop("kind", ""))).lower()
        for key, value in material.items():
            what, unit = _MATERIAL.get(key, (key, ""))
            scale = Scale(unit, value)
            materials.append((name, kind, what, scale.given(value), scale.name))
    motions = run.mapping("motions")
    used: dict[tuple[str, str, str], list[str]] = {}  # a joint, and the motions that have it
    for j in recorded.get("joints", []):
        key = str(j["name"]), str(j["kind"]), ", ".join(map(str, j["between"]))
        used.setdefault(key, []).append(str(j.get("motion", "")))
    joints: list[Row] = [
        (*key, *(["all" if len(names) == len(motions) else ", ".join(names)] if motions else []))
        for key, names in used.items()
    ]
    moved: list[Row] = [
        (name, _integration(given), "; ".join(map(str, given.get("loads", []))) or "none")
        for name, given in motions.items()
    ]
    return {
        "text": str(recorded.get("text") or ""),
        "integrator": _integration(recorded),
        "motions": Table.of(
            "Motions", ["Motion", "Time integration", "Loads beside inertia"], moved
        ),
        "loads": [str(load) for load in recorded.get("loads", [])],
        "left_out": [str(what) for what in recorded.get("left_out", [])],
        "bodies": Table.of(
            "Bodies",
            [
                "Body",
                "Kind",
                "Elements",
                "Order",
                "Constraint modes",
                "Normal modes",
                "Highest mode [Hz]",
                "Next mode [Hz]",
                "Softening [%]",
            ],
            bodies,
            [2, 3, 4, 5, 6, 7, 8],
        ),
        "materials": Table.of("Materials", ["Body", "Model", "", "Value", "Unit"], materials, [3]),
        "joints": Table.of(
            "Joints", ["Joint", "Kind", "Between", *(["In motion"] if motions else [])], joints
        ),
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
