# SPDX-License-Identifier: MIT
"""The sections about the result: psi beside its errors, constraints, densities and part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .folder import Row, Run, Table, words
from .numbers import NOTHING, Scale, fixed, percent, real

#: Share of a bound by which a part may exceed it without a sentence at the top
_BEYOND = 5e-3
#: Why a run ended, in words
_REASONS = {
    "converged": "the first-order conditions of the optimum hold",
    "iterations": "all iterations were used",
    "interrupted": "it was interrupted",
    "stalled": "no further step lowered psi, though the first-order conditions do not hold",
    "infeasible": "no design was found that satisfies all constraints",
}


def status(run: Run) -> list[str]:
    """Sentences on the constraints, the end of the run, and its warnings."""
    record = run.record
    sentences = []
    exceeded = {name: excess for name, excess in _excess_of_part(run).items() if excess > _BEYOND}
    by_part = ", ".join(
        f"{name} by {percent(excess)} % ({_values_and_bound(run, name)})"
        for name, excess in exceeded.items()
    )
    if record.get("feasible") is True:
        of_design = " as reported" if run.moved else " for the densities"
        exception = f"{of_design}, but the part exceeds {by_part}" if by_part else ""
        sentences.append(f"All constraints hold{exception}.")
    elif record.get("feasible") is False:
        violations = run.mapping("violations").items()
        names = ", ".join(f"{name} by {percent(share)} %" for name, share in violations)
        sentences.append(f"Constraints are violated: {names or 'see the table below'}.")
    if by_part and record.get("feasible") is not True:
        sentences.append(f"The part exceeds {by_part}.")
    reason = str(record.get("reason") or "")
    if reason:
        iterations = record.get("iterations")
        duration = f" after {iterations} iterations" if isinstance(iterations, int) else ""
        sentences.append(f"The run ended{duration}: {_REASONS.get(reason, reason)}.")
    bound = run.mapping("bound")
    if real(bound.get("gap")):
        text = str(bound.get("text"))
        sentences.append(f"{text[:1].upper()}{text[1:]}.")
    if run.verification.get("converged") is False:
        sentences.append("ψ of the part still changes with its mesh.")
    warnings = record.get("warnings")
    if isinstance(warnings, list) and warnings:
        count = len(warnings)
        sentences.append(f"{count} {'warning' if count == 1 else 'warnings'}, see below.")
    return sentences


def cards(run: Run) -> list[dict[str, str]]:
    """The most important numbers: label, value, unit and a line below."""
    numbers: list[dict[str, str]] = []

    def card(label: str, value: str, unit: str, below: str) -> None:
        numbers.append({"label": label, "value": value, "unit": unit, "below": below})

    psi, part_psi = run.record.get("psi"), run.verification.get("part")
    unit = run.psi.name
    if real(part_psi):
        card("ψ of the part", run.psi.text(part_psi), unit, f"reported {run.psi.text(psi)} {unit}")
    elif real(psi):
        kind = "part" if run.moved else "densities"
        card(
            f"ψ of the {kind}",
            run.psi.text(psi),
            unit,
            f"not verified{'' if run.moved else ' as a part'}",
        )
    best = part_psi if real(part_psi) else psi
    if run.references and real(best):
        name, reference = next(iter(run.references.items()))
        card("ψ relative", percent(best / reference, 3), "%", f"of ψ of the {name}")
    volume = [(name, share) for name, share in run.mapping("volume").items() if real(share)]
    for name, share in volume[:2]:
        bound = run.bounds.get(f"volume of {name}")
        limit = f", at most {Scale('', 1).without_zeros(100.0 * bound)} %" if real(bound) else ""
        card("Material", percent(share, 3), "%", f"of the full {name}{limit}")
    for name, entry in list(run.mapping("parts").items())[:2]:
        if real(entry.get("mass")):
            card("Mass", *Scale.of("kg", entry["mass"]), f"of the part {name}")
    stress = {name: entry["value"] for name, entry in run.mapping("stress").items()}
    source = "densities"
    for name, body in run.mapping("verification").get("bodies", {}).items():
        if real(body["stress"][1]):
            stress[name], source = body["stress"][1], "part"
    if stress:
        worst = max(stress, key=lambda name: stress[name])
        card("Largest stress", *Scale.of("Pa", stress[worst]), f"von Mises, {source} {worst}")
    return numbers


def accuracy(run: Run) -> dict[str, Any]:
    """Tables of psi, by densities and parts, and of its errors."""
    verification, scene = run.verification, run.mapping("scene")
    psi, gray, unit = run.record.get("psi"), run.record.get("gray"), run.psi.name
    values: list[Row] = []
    if real(psi):
        source = "part, on the mesh of its last step" if run.moved else "densities"
        values.append((f"Reported, of the {source}", run.psi.text(psi, 5), unit, "0"))
    kinds = {body.get("elements", "triangles") for body in verification.get("bodies", {}).values()}
    elements = kinds.pop() if len(kinds) == 1 else "cells"
    for mesh in verification["meshes"] if verification else []:
        label = f"Part, {elements} of {' '.join(Scale.of('m', mesh['size'], 3))}"
        change = mesh["psi"] / verification["reported"] - 1.0
        values.append((label, run.psi.text(mesh["psi"], 5), unit, percent(change, 3, sign=True)))
    errors: list[Row] = []

    def error(label: str, share: Any, how: str, *, sign: bool = False) -> None:
        if real(share):
            size = run.psi.text(share * psi, 2) if real(psi) else NOTHING
            plus = "+" if sign and share > 0.0 else ""
            errors.append((label, percent(share, sign=sign), plus + size, how))

    modes = scene.get("modes_error", run.record.get("mode_error"))
    if verification:
        label = "Part on finer meshes" if run.moved else "Part instead of densities"
        error(label, verification["difference"], "the part, simulated anew", sign=True)
        state = "converged" if verification.get("converged") else "still changes"
        limit = f"{state} within {percent(verification.get('tolerance'))} %"
        error("Mesh of the part", verification.get("change"), f"{elements} made smaller: {limit}")
    error("Normal modes left out", modes, "estimated by residual modes")
    error("Time step", scene.get("step_error"), "estimated by two methods with shorter steps")
    head = ["", "ψ", "Unit", "Beside reported [%]"]
    note = f"{percent(gray)} % of the area is neither void nor solid." if real(gray) else ""
    psi_table = Table.of(f"{run.objective} ψ", head, values, [1, 3], note)
    head = ["", "Relative [%]", f"Absolute [{unit}]" if unit else "Absolute", "How it is known"]
    note = "The design was not evaluated as a part."
    if verification:
        note = "Modes and time step were judged at the reported design."
    return {"values": psi_table, "errors": Table.of("Errors of ψ", head, errors, [1, 2], note)}


def constraints(run: Run) -> Table | None:
    """Values and bounds."""
    rows, excess = [], _excess_of_part(run)
    for name, entry in run.mapping("constraints").items():
        scale = Scale(str(entry["unit"]), entry["bound"])
        violated, excess_of_part = entry["violation"], excess.get(name)
        values = (scale.text(entry["value"]), scale.text(_of_part(run, name)))
        bound = f"{entry['kind']} {scale.without_zeros(entry['bound'])}"
        violation = f"{percent(violated)} %" if violated else "none"
        by_part = NOTHING
        if excess_of_part is not None:
            by_part = f"{percent(excess_of_part)} %" if excess_of_part > 0.0 else "none"
        rows.append((name, *values, bound, scale.name or NOTHING, violation, by_part))
    head = ["Constraint", "Reported", "Part", "Bound", "Unit", "Violation", "by the part"]
    return Table.of("Constraints", head, rows, [1, 2])


def parameters(run: Run) -> Table | None:
    """Parameters of the mechanism: start, value, bounds, and whether they are at a bound."""
    ends: dict[str, Any] = {}
    for of_owner in run.mapping("at_bounds").values():
        ends |= of_owner
    rows = []
    for name, entry in run.mapping("parameters").items():
        scale = Scale(entry["unit"], entry["value"])
        numbers = (scale.text(entry[key]) for key in ("start", "value", "lower", "upper"))
        at_bound = f"{ends[name]} bound" if name in ends else NOTHING
        rows.append((name, *numbers, scale.name or NOTHING, at_bound))
    head = ["Parameter", "Start", "Value", "Lower bound", "Upper bound", "Unit", "Stands at"]
    return Table.of("Parameters of the mechanism", head, rows, [1, 2, 3, 4])


def _of_part(run: Run, name: str) -> float | None:
    """The value of a constraint for the part; volumes are recorded with the bodies."""
    bodies, body = run.verification.get("bodies", {}), name.removeprefix("volume of ")
    if body != name and body in bodies:
        _, value = bodies[body]["volume"]
    else:
        _, value = run.verification.get("constraints", {}).get(name, [None, None])
    return None if value is None else float(value)


def _excess_of_part(run: Run) -> dict[str, float]:
    """Share by which the part exceeds each bound; negative if the bound is satisfied."""
    excess = {}
    for name, entry in run.mapping("constraints").items():
        value, bound = _of_part(run, name), entry["bound"]
        if value is not None and bound:
            sign = -1.0 if entry["kind"] == "at least" else 1.0
            excess[name] = sign * (value - bound) / abs(bound)
    return excess


def _values_and_bound(run: Run, name: str) -> str:
    """The reported value, the value of the part, and the bound."""
    entry = run.mapping("constraints")[name]
    scale = Scale(str(entry["unit"]), entry["bound"])
    reported, of_part = scale.text(entry["value"]), scale.text(_of_part(run, name))
    bound = f"{entry['kind']} {scale.without_zeros(entry['bound'])} {scale.name}".rstrip()
    return f"reported {reported}, part {of_part}, {bound}"


def load_cases(run: Run) -> Table | None:
    """The contribution of each of several load cases."""
    of_part, rows = run.verification.get("load_cases", {}), []
    for name, case in run.mapping("load_cases").items():
        psi, weight, objective = case["psi"], case["weight"], case["objective"]
        scale = Scale(str(objective["unit"]), psi)
        part_psi = scale.text(of_part.get(name, [None, None])[1])
        numbers = (fixed(weight, 4), fixed(weight * psi, 4))
        unit = scale.name or NOTHING
        rows.append((name, words(objective["name"]), scale.text(psi), part_psi, unit, *numbers))
    note = f"ψ of the design is their {words(run.objective).lower()}."
    head = ["Load case", "Objective", "Reported", "Part", "Unit", "Weight", "Reported, weighted"]
    return Table.of("Load cases", head, rows, [2, 3, 5, 6], note)


def comparison(run: Run) -> Table | None:
    """The design compared with others."""
    if not run.references:
        return None
    name, reference = next(iter(run.references.items()))
    reported, part_psi = run.record.get("psi"), run.verification.get("part")
    designs = {"Design, reported": reported, "Design, part": part_psi}
    designs |= {key[:1].upper() + key[1:]: psi for key, psi in run.references.items()}
    rows = [
        (key, run.psi.text(psi), run.psi.name or NOTHING, percent(psi / reference, 3))
        for key, psi in designs.items()
        if real(psi)
    ]
    head = ["", "ψ", "Unit", f"Of the {name} [%]"]
    return Table.of("Beside other designs", head, rows, [1, 3])


def reported_and_part(run: Run) -> list[Table]:
    """Tables that compare the reported values of each body with the values of its part."""
    bodies = run.verification.get("bodies", {})
    tables = [_body_table(run, name, body) for name, body in bodies.items()]
    return [table for table in tables if table]


def _body_table(run: Run, name: str, body: Mapping[str, Any]) -> Table | None:
    quantities = [("Mass", "kg", body["mass"]), ("Share of the full body", "-", body["volume"])]
    if name not in run.mapping("parts"):  # whose tables have the widths
        quantities += [
            ("Thinnest member", "m", (None, body.get("thinnest_member"))),
            ("Narrowest gap", "m", (None, body.get("narrowest_gap"))),
        ]
    quantities.append(("Largest stress", "Pa", body["stress"]))
    frequencies = enumerate(zip(*body["frequencies"], strict=False), 1)
    quantities += [(f"Frequency {number}", "Hz", pair) for number, pair in frequencies]
    rows = [row for quantity in quantities if (row := _compared(*quantity))]
    note = (
        f"Part: {fixed(body['cells'])} {body.get('elements', 'triangles')}, {body['modes']} "
        "normal modes. Stress: von Mises, over the whole simulation. Frequencies: with all "
        "interfaces held."
    )
    head = ["", "Reported", "Part", "Unit", "Change [%]"]
    return Table.of(f"Body {name}", head, rows, [1, 2, 4], note)


def _compared(quantity: str, unit: str, pair: Sequence[Any]) -> Row | None:
    """A reported value beside the value of the part; None where both are unknown."""
    reported, of_part = pair
    if not (real(reported) or real(of_part)):
        return None
    scale = Scale(unit, max(abs(value) for value in pair if real(value)))
    change = NOTHING
    if real(reported) and real(of_part) and reported:
        change = percent(of_part / reported - 1.0, 3, sign=True)
    return quantity, scale.text(reported), scale.text(of_part), scale.name, change


def figures_of_densities(run: Run) -> Table | None:
    """Stress and frequencies of the densities of bodies without a verified part."""
    verified = run.verification.get("bodies", {})
    rows = []
    for name, stress in run.mapping("stress").items():
        if name not in verified:
            position = (Scale("m", 1.0).text(v) for v in stress["position"])
            place = ", ".join(f"{x} = {v} mm" for x, v in zip("xyz", position, strict=False))
            case = f", in load case {stress['load_case']}" if stress.get("load_case") else ""
            place_and_time = f"at {' '.join(Scale.of('s', stress['time']))}, {place}{case}"
            value = Scale.of("Pa", stress["value"])
            rows.append((name, "Largest von Mises stress", *value, place_and_time))
    for name, values in run.mapping("frequencies").items():
        if name not in verified:
            for number, f in enumerate(values, 1):
                rows.append((name, f"Frequency {number}", fixed(f), "Hz", "interfaces held"))
    head = ["Body", "", "Value", "Unit", ""]
    return Table.of("Stress and frequencies of the densities", head, rows, [2])
