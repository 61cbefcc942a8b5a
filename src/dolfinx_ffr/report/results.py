# SPDX-License-Identifier: MIT
"""The sections about the result: psi beside its errors, constraints, densities and part."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .folder import Row, Run, Table, words
from .numbers import NOTHING, Scale, fixed, percent, real

#: Share by which a part may exceed a bound before the first sentence says so
_BEYOND = 5e-3
#: Why a run ended, in words
_REASONS = {
    "converged": "the first-order conditions of the optimum hold",
    "iterations": "all iterations were used",
    "interrupted": "it was interrupted",
    "stalled": "no further step lowered psi, though the first-order conditions do not hold",
    "infeasible": "no design was found that fulfils all constraints",
}


def status(run: Run) -> list[str]:
    """How the run ended, in sentences."""
    record = run.record
    said = []
    beyond = {name: over for name, over in _beyond_by_part(run).items() if over > _BEYOND}
    each = (f"{n} by {percent(over)} % ({_told_of_part(run, n)})" for n, over in beyond.items())
    by_part = ", ".join(each)
    if record.get("feasible") is True:
        of = " as reported" if run.moved else " for the densities"
        but = f"{of}, but the part exceeds {by_part}" if by_part else ""
        said.append(f"All constraints hold{but}.")
    elif record.get("feasible") is False:
        broken = ", ".join(f"{n} by {percent(v)} %" for n, v in run.mapping("violations").items())
        said.append(f"Constraints are violated: {broken or 'see the table below'}.")
    if by_part and record.get("feasible") is not True:
        said.append(f"The part exceeds {by_part}.")
    reason = str(record.get("reason") or "")
    if reason:
        iterations = record.get("iterations")
        after = f" after {iterations} iterations" if isinstance(iterations, int) else ""
        said.append(f"The run ended{after}: {_REASONS.get(reason, reason)}.")
    bound = run.mapping("bound")
    if real(bound.get("gap")):
        text = str(bound.get("text"))
        said.append(f"{text[:1].upper()}{text[1:]}.")
    if run.verification.get("converged") is False:
        said.append("ψ of the part still changes with its mesh.")
    given = record.get("warnings")
    if isinstance(given, list) and given:
        said.append(f"{len(given)} {'warning' if len(given) == 1 else 'warnings'}, see below.")
    return said


def cards(run: Run) -> list[dict[str, str]]:
    """The few numbers that matter most: label, value, unit and a line below."""
    found: list[dict[str, str]] = []

    def card(label: str, value: str, unit: str, below: str) -> None:
        found.append({"label": label, "value": value, "unit": unit, "below": below})

    psi, part = run.record.get("psi"), run.verification.get("part")
    unit = run.psi.name
    if real(part):
        card("ψ of the part", run.psi.text(part), unit, f"reported {run.psi.text(psi)} {unit}")
    elif real(psi):
        what = "part" if run.moved else "densities"
        card(
            f"ψ of the {what}",
            run.psi.text(psi),
            unit,
            f"not verified{'' if run.moved else ' as a part'}",
        )
    best = part if real(part) else psi
    if run.references and real(best):
        name, reference = next(iter(run.references.items()))
        card("ψ relative", percent(best / reference, 3), "%", f"of that of the {name}")
    volume = [(name, share) for name, share in run.mapping("volume").items() if real(share)]
    for name, share in volume[:2]:
        bound = run.bounds.get(f"volume of {name}")
        limit = f", at most {Scale('', 1).given(100.0 * bound)} %" if real(bound) else ""
        card("Material", percent(share, 3), "%", f"of the full {name}{limit}")
    for name, given in list(run.mapping("parts").items())[:2]:
        if real(given.get("mass")):
            card("Mass", *Scale.of("kg", given["mass"]), f"of the part {name}")
    stress = {n: s["value"] for n, s in run.mapping("stress").items()}
    of = "densities"
    for name, body in run.mapping("verification").get("bodies", {}).items():
        if real(body["stress"][1]):
            stress[name], of = body["stress"][1], "part"
    if stress:
        worst = max(stress, key=lambda name: stress[name])
        card("Largest stress", *Scale.of("Pa", stress[worst]), f"von Mises, {of} {worst}")
    return found


def accuracy(run: Run) -> dict[str, Any]:
    """The objective beside its errors."""
    found, scene = run.verification, run.mapping("scene")
    psi, gray, unit = run.record.get("psi"), run.record.get("gray"), run.psi.name
    values: list[Row] = []
    if real(psi):
        of = "part, on the mesh of its last step" if run.moved else "densities"
        values.append((f"Reported, of the {of}", run.psi.text(psi, 5), unit, "0"))
    kinds = {body.get("elements", "triangles") for body in found.get("bodies", {}).values()}
    elements = kinds.pop() if len(kinds) == 1 else "cells"
    for mesh in found["meshes"] if found else []:
        what = f"Part, {elements} of {' '.join(Scale.of('m', mesh['size'], 3))}"
        change = mesh["psi"] / found["reported"] - 1.0
        values.append((what, run.psi.text(mesh["psi"], 5), unit, percent(change, 3, sign=True)))
    errors: list[Row] = []

    def error(what: str, share: Any, how: str, *, sign: bool = False) -> None:
        if real(share):
            size = run.psi.text(share * psi, 2) if real(psi) else NOTHING
            plus = "+" if sign and share > 0.0 else ""
            errors.append((what, percent(share, sign=sign), plus + size, how))

    modes = scene.get("modes_error", run.record.get("mode_error"))
    if found:
        how = "the part, simulated anew"
        what = "Part on finer meshes" if run.moved else "Part instead of densities"
        error(what, found["difference"], how, sign=True)
        still = "stands still" if found.get("converged") else "still changes"
        limit = f"{still} within {percent(found.get('tolerance'))} %"
        error("Mesh of the part", found.get("change"), f"{elements} made smaller: {limit}")
    error("Normal modes left out", modes, "estimated by residual modes")
    error("Time step", scene.get("step_error"), "estimated by two methods with shorter steps")
    head = ["", "ψ", "Unit", "Beside reported [%]"]
    note = f"{percent(gray)} % of the area is neither void nor solid." if real(gray) else ""
    told = Table.of(f"{run.objective} ψ", head, values, [1, 3], note)
    head = ["", "Relative [%]", f"Absolute [{unit}]" if unit else "Absolute", "How it is known"]
    note = "The design was not evaluated as a part."
    if found:
        note = "Modes and time step were judged at the reported design."
    return {"values": told, "errors": Table.of("Errors of ψ", head, errors, [1, 2], note)}


def constraints(run: Run) -> Table | None:
    """Values and bounds."""
    rows, beyond = [], _beyond_by_part(run)
    for name, given in run.mapping("constraints").items():
        scale = Scale(str(given["unit"]), given["bound"])
        broken, over = given["violation"], beyond.get(name)
        values = (scale.text(given["value"]), scale.text(_of_part(run, name)))
        bound = f"{given['kind']} {scale.given(given['bound'])}"
        violation = f"{percent(broken)} %" if broken else "none"
        by_part = NOTHING if over is None else "none" if over <= 0.0 else f"{percent(over)} %"
        rows.append((name, *values, bound, scale.name or NOTHING, violation, by_part))
    head = ["Constraint", "Reported", "Part", "Bound", "Unit", "Violation", "by the part"]
    return Table.of("Constraints", head, rows, [1, 2])


def parameters(run: Run) -> Table | None:
    """Parameters of the mechanism: start, value, bounds, and whether they stand at one."""
    ends: dict[str, Any] = {}
    for at in run.mapping("at_bounds").values():
        ends |= at
    rows = []
    for name, given in run.mapping("parameters").items():
        scale = Scale(given["unit"], given["value"])
        numbers = (scale.text(given[key]) for key in ("start", "value", "lower", "upper"))
        at_bound = f"{ends[name]} bound" if name in ends else NOTHING
        rows.append((name, *numbers, scale.name or NOTHING, at_bound))
    head = ["Parameter", "Start", "Value", "Lower bound", "Upper bound", "Unit", "Stands at"]
    return Table.of("Parameters of the mechanism", head, rows, [1, 2, 3, 4])


def _of_part(run: Run, name: str) -> float | None:
    """The part's value of a constraint; values of volume bounds stand with the bodies."""
    volumes = run.verification.get("bodies", {})
    if name.startswith("volume of ") and name[10:] in volumes:
        found = volumes[name[10:]]["volume"]
    else:
        found = run.verification.get("constraints", {}).get(name, [None, None])
    return None if found[1] is None else float(found[1])


def _beyond_by_part(run: Run) -> dict[str, float]:
    """By how much the part exceeds bounds, relative to these; negative where they hold."""
    beyond = {}
    for name, given in run.mapping("constraints").items():
        part, bound = _of_part(run, name), given["bound"]
        if part is not None and bound:
            sign = -1.0 if given["kind"] == "at least" else 1.0
            beyond[name] = sign * (part - bound) / abs(bound)
    return beyond


def _told_of_part(run: Run, name: str) -> str:
    """Value of the densities and of the part beside the bound."""
    given = run.mapping("constraints")[name]
    scale = Scale(str(given["unit"]), given["bound"])
    told, part = scale.text(given["value"]), scale.text(_of_part(run, name))
    bound = f"{given['kind']} {scale.given(given['bound'])} {scale.name}".rstrip()
    return f"reported {told}, part {part}, {bound}"


def load_cases(run: Run) -> Table | None:
    """The contribution of each of several load cases."""
    of_part, rows = run.verification.get("load_cases", {}), []
    for name, case in run.mapping("load_cases").items():
        psi, weight, objective = case["psi"], case["weight"], case["objective"]
        scale = Scale(str(objective["unit"]), psi)
        part = scale.text(of_part.get(name, [None, None])[1])
        numbers = (fixed(weight, 4), fixed(weight * psi, 4))
        unit = scale.name or NOTHING
        rows.append((name, words(objective["name"]), scale.text(psi), part, unit, *numbers))
    note = f"ψ of the design is their {words(run.objective).lower()}."
    head = ["Load case", "Objective", "Reported", "Part", "Unit", "Weight", "Reported, weighted"]
    return Table.of("Load cases", head, rows, [2, 3, 5, 6], note)


def comparison(run: Run) -> Table | None:
    """The design beside others."""
    if not run.references:
        return None
    name, reference = next(iter(run.references.items()))
    reported, part = run.record.get("psi"), run.verification.get("part")
    given = {"Design, reported": reported, "Design, part": part}
    given |= {key[:1].upper() + key[1:]: psi for key, psi in run.references.items()}
    rows = [
        (key, run.psi.text(psi), run.psi.name or NOTHING, percent(psi / reference, 3))
        for key, psi in given.items()
        if real(psi)
    ]
    head = ["", "ψ", "Unit", f"Of the {name} [%]"]
    return Table.of("Beside other designs", head, rows, [1, 3])


def reported_and_part(run: Run) -> list[Table]:
    """For each body the values of the densities beside those of the part."""
    found = []
    for name, body in run.verification.get("bodies", {}).items():
        rows: list[Row] = []

        def row(what: str, unit: str, pair: Sequence[Any], rows: list[Row] = rows) -> None:
            before, after = pair
            if real(before) or real(after):
                scale = Scale(unit, max(abs(v) for v in pair if real(v)))
                both = real(before) and real(after) and before
                change = percent(after / before - 1.0, 3, sign=True) if both else NOTHING
                rows.append((what, scale.text(before), scale.text(after), scale.name, change))

        row("Mass", "kg", body["mass"])
        row("Share of the full body", "-", body["volume"])
        row("Thinnest member", "m", (None, body.get("thinnest_member")))
        row("Narrowest gap", "m", (None, body.get("narrowest_gap")))
        row("Largest stress", "Pa", body["stress"])
        for number, pair in enumerate(zip(*body["frequencies"], strict=False), 1):
            row(f"Frequency {number}", "Hz", pair)
        note = (
            f"Part: {fixed(body['cells'])} {body.get('elements', 'triangles')}, {body['modes']} "
            "normal modes. Stress: von Mises, over the whole simulation. Frequencies: with all "
            "interfaces held."
        )
        head = ["", "Reported", "Part", "Unit", "Change [%]"]
        found.append(Table.of(f"Body {name}", head, rows, [1, 2, 4], note))
    return [table for table in found if table]


def own_figures(run: Run) -> Table | None:
    """Stress and frequencies of the densities, where no part was verified."""
    done = run.verification.get("bodies", {})
    rows = []
    for name, given in run.mapping("stress").items():
        if name not in done:
            place = zip("xyz", (Scale("m", 1.0).text(v) for v in given["position"]), strict=False)
            at = ", ".join(f"{axis} = {value} mm" for axis, value in place)
            case = f", in load case {given['load_case']}" if given.get("load_case") else ""
            where = f"at {' '.join(Scale.of('s', given['time']))}, {at}{case}"
            value = Scale.of("Pa", given["value"])
            rows.append((name, "Largest von Mises stress", *value, where))
    for name, values in run.mapping("frequencies").items():
        if name not in done:
            for number, f in enumerate(values, 1):
                rows.append((name, f"Frequency {number}", fixed(f), "Hz", "interfaces held"))
    head = ["Body", "", "Value", "Unit", ""]
    return Table.of("Stress and frequencies of the densities", head, rows, [2])
