# SPDX-License-Identifier: MIT
"""What a run leaves in summary.json for its report.

All keys are optional to the report, which says what it misses. Numbers are in SI units, relative
errors are shares (0.01 is one percent), and None stands for what is not known.

| key | |
|---|---|
| ``title`` | heading |
| ``psi``, ``reason``, ``iterations``, ``feasible``, ``violations``, ``volume``, ``gray``, ``modes``, ``mode_error`` | those of `Result.summary` |
| ``objective`` | ``name`` and ``unit`` of psi |
| ``motions`` | of several, by name: ``psi``, ``objective`` (``name`` and ``unit``), ``weight``, ``integrator``, ``order``, ``duration`` [s], ``steps``, ``loads`` |
| ``references`` | psi of other designs by name, to compare with; the first is what psi is relative to |
| ``constraints`` | by name: ``value`` and ``bound`` in ``unit``, ``kind`` ("at most", "at least"), ``violation`` relative to the bound, 0 where it holds |
| ``frequencies`` | by body, with its interfaces held [Hz] |
| ``stress`` | by body: ``value``, the largest von Mises stress of the motion [Pa], ``time`` [s], ``position`` [m], of several motions the ``motion`` |
| ``scene`` | ``text`` of `model_report` and its ``modes_error``, ``step_error``, ``coordinates``, ``rows``, ``left_out``; ``bodies`` by name (kind, modes, frequencies [Hz], elements, order, material); ``joints`` (name, kind, between, of several motions the motion); of one motion ``loads`` in words; ``integrator`` and its ``duration`` [s], ``steps``, ``order`` |
| ``parts`` | by body: ``area`` [m^2], ``thickness`` [m], ``mass`` [kg], ``center`` and ``bounds`` [m], ``thinnest_member`` and ``narrowest_gap`` (``value`` and both ``ends`` [m]), ``pieces``, ``holes``, ``loose`` (number of pieces left out), ``deviation`` of the curves [m] |
| ``verification`` | ``reported`` and ``part``: psi; ``difference``, ``change`` by the last mesh, ``tolerance``, ``converged``; ``meshes`` (``size`` [m], ``psi``); ``constraints`` by name, pairs; ``motions``, of several the pairs of psi by name; ``bodies`` by name: ``cells`` and what they are, ``elements``, ``modes``, of solids ``thinnest_member`` and ``narrowest_gap`` [m], and pairs reported, part of ``mass`` [kg], ``volume``, ``stress`` [Pa], ``frequencies`` [Hz] |
| ``warnings`` | ``category`` and ``message`` of each, in their order |
| ``versions`` | of the package and of what it is built on, by name; operating system and machine |
| ``command``, ``date``, ``ranks``, ``seconds`` | how to repeat it, when it ended (ISO 8601), MPI ranks, time of the design loop [s] |
"""  # noqa: E501  the table is one line a key

from __future__ import annotations

import math
import os
import platform
import shlex
import sys
import warnings as python_warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

from slepc4py import SLEPc

from .. import validation
from ..dynamics import SimulationError, Trajectory
from ..mechanical_problem import ConstraintValue, MechanicalProblem
from ..mechanism import Gear, Mechanism, PrescribedAngle, marker_name
from ..objective import Constraint, JointForce, Objective
from ..optimization import Result
from ..parallel import on_rank_0
from ..part import Part, Solid, Verification, Width
from ..postprocessing import ModelReport, model_report, worst_stress
from ..problem import Evaluation, Problem

__all__ = ["KEYS", "recorded_warnings", "run_record"]

#: Keys that the report knows
KEYS = (
    "title",
    "psi",
    "reason",
    "iterations",
    "feasible",
    "violations",
    "volume",
    "gray",
    "modes",
    "mode_error",
    "objective",
    "motions",
    "references",
    "constraints",
    "frequencies",
    "stress",
    "scene",
    "parts",
    "verification",
    "warnings",
    "versions",
    "command",
    "date",
    "ranks",
    "seconds",
)
#: How many frequencies of each body are recorded
_FREQUENCIES = 6


@contextmanager
def recorded_warnings() -> Iterator[list[dict[str, str]]]:
    """Context in which warnings are listed beside being shown, each once, for `run_record`.

    Yields:
        A list that grows: category and message of each warning of this rank.
    """
    show = python_warnings.showwarning
    found: list[dict[str, str]] = []

    def shown(message: Warning | str, category: type[Warning], *rest: Any, **options: Any) -> None:
        entry = {"category": category.__name__, "message": str(message)}
        if entry not in found:
            found.append(entry)
        show(message, category, *rest, **options)

    python_warnings.showwarning = shown
    try:
        yield found
    finally:
        python_warnings.showwarning = show


def run_record(
    result: Result,
    *,
    title: str = "",
    parts: Mapping[str, Part] | None = None,
    verification: Verification | None = None,
    warnings: Sequence[Mapping[str, str]] = (),
    references: Mapping[str, float] | None = None,
    volume: float | Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """What the report of a run needs beside its files, for `write_summary`; collective.

    It estimates the errors of the model and recovers the stress of the design, which takes a few
    simulations; where the estimate fails, a warning is recorded. The keys are listed where this
    function is defined.

    Args:
        result: What `optimize` returned.
        title: Heading of the report.
        parts: By name of the body, what the designs enclose.
        verification: What `verify` found of these parts.
        warnings: Those of the run, from `recorded_warnings`.
        references: psi of other designs, by what they are called; the first one, the full body for
            example, is what psi is given relative to.
        volume: Upper bound of the volume, as `optimize` was given it.

    Returns:
        Numbers, texts, lists and mappings that JSON can hold, the same on every rank.

    Raises:
        TypeError: If an argument is of a wrong kind.
        ValueError: If ``parts`` or ``volume`` name a body that has no density.
    """
    validation.instance("run_record: result", result, Result, "what optimize() returned")
    validation.instance("run_record: title", title, str, "a text")
    bodies = result.problem.flexible
    given = validation.instances_by_name("run_record: parts", parts or {}, Part, "a Part")
    bounds = dict.fromkeys(result.densities, volume) if not isinstance(volume, Mapping) else volume
    for what, names in (("parts", given), ("volume", bounds)):
        if unknown := sorted(set(names) - set(bodies)):
            raise ValueError(
                f"run_record: {what} are given for {unknown}, and the bodies with a density are "
                f"{sorted(bodies)}"
            )
    if verification is not None:
        needed = "what verify() returned"
        validation.instance("run_record: verification", verification, Verification, needed)
    problem, evaluation = result.problem, result.evaluation
    said = [dict(entry) for entry in warnings]
    found = {
        "title": title,
        **result.summary(),
        "objective": _objective(problem),
        "motions": _motions(problem, evaluation) if len(problem.motions) > 1 else {},
        "references": {name: float(psi) for name, psi in (references or {}).items()},
        "constraints": {
            **{f"volume of {n}": _volume(b, result, n) for n, b in bounds.items() if b is not None},
            **_constraints(problem, evaluation),
        },
        "frequencies": {
            name: [float(f) for f in values[:_FREQUENCIES]]
            for name, values in evaluation.fixed_interface_frequencies.items()
        },
        "stress": _stress(problem, evaluation),
        "scene": _scene(problem, evaluation, said),
        "parts": on_rank_0(problem.comm, lambda: {n: _part(part) for n, part in given.items()}),
        "verification": None if verification is None else _verification(verification),
        "warnings": said,
        "versions": _versions(),
        "command": _command(problem.comm),
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "ranks": problem.comm.size,
        "seconds": float(result.history["seconds"][-1]),
    }
    same_on_all: dict[str, Any] = problem.comm.bcast(_plain(found), root=0)
    return same_on_all


def _plain(value: Any) -> Any:
    """A value as JSON holds it; what is not finite becomes None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


# ---------------------------------------------------------------------- the scene


def _unit(objective: Objective, mechanism: Mechanism) -> str:
    if isinstance(objective, JointForce):
        joints = dict(zip(mechanism.joint_names, mechanism.joints, strict=True))
        turns = isinstance(joints.get(objective.joint), Gear | PrescribedAngle)
        return "N m" if objective.moment or turns else "N"
    return objective.unit


def _objective(problem: Problem) -> dict[str, str]:
    """What psi is; weights of several motions may have any unit."""
    units = {_unit(motion.objective, motion.mechanism) for motion in problem.motions.values()}
    name, combine = type(problem.combine).__name__, problem.combine
    if len(problem.motions) == 1:
        name = type(problem.objective).__name__
    unit = units.pop() if combine.weights is None and len(units) == 1 else ""
    return {"name": name, "unit": unit}


def _motions(problem: Problem, evaluation: Evaluation) -> dict[str, Any]:
    return {
        name: {
            "psi": evaluation.motions[name].psi,
            "objective": {
                "name": type(motion.objective).__name__,
                "unit": _unit(motion.objective, motion.mechanism),
            },
            "weight": problem.combine.weight(name),
            "loads": _loads(motion.mechanism),
            **_integration(motion, evaluation.motions[name].trajectory),
        }
        for name, motion in problem.motions.items()
    }


def _integration(motion: MechanicalProblem, trajectory: Trajectory | None) -> dict[str, Any]:
    integrator = motion.integrator
    found = {
        "integrator": type(integrator).__name__,
        "duration": integrator.end_time,
        "order": integrator.order,
    }
    if trajectory is not None:
        found["steps"] = len(trajectory.step_ends) - 1
    return found


def _scene(problem: Problem, evaluation: Evaluation, said: list[dict[str, str]]) -> dict[str, Any]:
    several = len(problem.motions) > 1
    found: dict[str, Any] = {
        "bodies": {name: {"kind": "flexible"} for name in problem.flexible},
        "joints": [
            {
                "name": name,
                "kind": type(joint).__name__,
                "between": _names(joint.markers),
                **({"motion": motion} if several else {}),
            }
            for motion, part in problem.motions.items()
            for name, joint in zip(part.mechanism.joint_names, part.mechanism.joints, strict=True)
        ],
    }
    if not several:
        motion = next(iter(problem.motions.values()))
        found["loads"] = _loads(motion.mechanism)
        found |= _integration(motion, evaluation.trajectory)
    if evaluation.moves:
        try:
            found |= _model(model_report(problem, evaluation))
        except SimulationError as error:  # with steps twice as long, which is told
            said.append(
                {
                    "category": type(error).__name__,
                    "message": f"the errors by modes and time step could not be estimated: {error}",
                }
            )
    for name, body in problem.flexible.items():
        found["bodies"][name] |= {
            "elements": body.domain.n_cells_global,
            "order": body.domain.order,
            "material": _numbers_of(body.material),
        }
    return found


def _model(report: ModelReport) -> dict[str, Any]:
    return {
        "text": str(report),
        "modes_error": report.modes_error,
        "step_error": report.step_error,
        "coordinates": report.coordinates,
        "rows": report.rows,
        "left_out": report.left_out,
        "bodies": {
            name: {f.name: getattr(body, f.name) for f in fields(body)}
            for name, body in report.bodies.items()
        },
    }


def _names(markers: Sequence[Any]) -> list[str]:
    return [marker_name(marker) for marker in markers]


def _loads(mechanism: Mechanism) -> list[str]:
    """What acts on the bodies beside their inertia, in words."""
    said = [f"point mass {p.mass:g} kg at {marker_name(p.marker)}" for p in mechanism.point_masses]
    for what, pair in (
        ("gravity", mechanism.gravity),
        ("acceleration of the ground", mechanism.ground_acceleration),
    ):
        if all(validation.is_number(component) for component in pair):
            if any(pair):
                said.append(f"{what} ({pair[0]:g}, {pair[1]:g}) m/s²")
        else:
            said.append(f"{what} as a function of time")
    for name, force in zip(mechanism.force_names, mechanism.forces, strict=True):
        said.append(f"{type(force).__name__} {name} at {', '.join(_names(force.markers))}")
    for name, damping in mechanism.damping.items():
        if damping.alpha or damping.beta:
            said.append(f"damping of {name}: {damping.alpha:g} 1/s, {damping.beta:g} s")
    return said


def _numbers_of(material: Any) -> dict[str, Any]:
    """Kind and numbers of a material that is a dataclass."""
    found: dict[str, Any] = {"kind": type(material).__name__}
    if is_dataclass(material):
        for field in fields(material):
            value = getattr(material, field.name)
            if validation.is_number(value):
                found[field.name] = float(value)
    return found


# ---------------------------------------------------------------------- results


def _volume(bound: float, result: Result, name: str) -> dict[str, Any]:
    return {
        "value": result.evaluation.volume[name],
        "bound": float(bound),
        "unit": "",
        "kind": "at most",
        "violation": result.violations.get(f"volume of {name}", 0.0),
    }


def _constraints(problem: Problem, evaluation: Evaluation) -> dict[str, Any]:
    """Those of all motions, by the names under which they are evaluated."""
    given = [(c, m.mechanism) for m in problem.motions.values() for c in m.constraints]
    return {
        named.label: _constraint(constraint, evaluation.constraints[named.label], mechanism)
        for named, (constraint, mechanism) in zip(problem.constraints, given, strict=True)
    }


def _constraint(
    constraint: Constraint, value: ConstraintValue, mechanism: Mechanism
) -> dict[str, Any]:
    return {
        "value": value.psi,
        "bound": constraint.bound,
        "unit": _unit(constraint.objective, mechanism),
        "kind": "at least" if constraint.upper is None else "at most",
        "violation": max(value.value, 0.0),
    }


def _stress(problem: Problem, evaluation: Evaluation) -> dict[str, Any]:
    if not evaluation.moves:
        return {}
    found = {n: worst_stress(b, evaluation, n) for n, b in problem.flexible.items()}
    return {
        name: {
            "value": s.largest,
            "time": s.largest_time,
            "position": s.largest_position,
            **({"motion": s.motion} if len(problem.motions) > 1 else {}),
        }
        for name, s in found.items()
    }


def _part(part: Part) -> dict[str, Any]:
    material = part.material
    weighs = material is not None and getattr(material, "density", None) is not None
    return {
        "area": part.area,
        "thickness": part.thickness if material is not None else None,
        "mass": part.mass if weighs else None,
        "center": part.center,
        "bounds": list(part.polygon.bounds),
        "thinnest_member": _width(part.thinnest_member),
        "narrowest_gap": _width(part.narrowest_gap),
        "pieces": part.pieces,
        "holes": part.holes,
        "loose": len(part.loose),
        "deviation": part.deviation,
    }


def _width(width: Width | None) -> dict[str, Any] | None:
    return None if width is None else {"value": width.value, "ends": width.ends}


def _sizes(part: object) -> dict[str, float | None]:
    """Of a solid; those of parts in the plane stand with the parts."""
    if not isinstance(part, Solid):
        return {}
    widths = {"thinnest_member": part.thinnest_member, "narrowest_gap": part.narrowest_gap}
    return {what: None if width is None else width.value for what, width in widths.items()}


def _verification(found: Verification) -> dict[str, Any]:
    before, after = found.reported, found.fitted[-1]
    return {
        "reported": before.psi,
        "part": found.psi,
        "difference": found.difference,
        "change": found.change,
        "tolerance": found.tolerance,
        "converged": found.converged,
        "meshes": [{"size": row.size, "psi": row.psi} for row in found.fitted],
        "constraints": {n: [before.constraints[n], v] for n, v in after.constraints.items()},
        "motions": {n: [before.motions[n], v] for n, v in after.motions.items()},
        "bodies": {
            name: {
                "cells": body.cells,
                "elements": found.parts[name].elements,
                "modes": found.modes[name],
                **_sizes(found.parts[name]),
                "mass": [before.bodies[name].mass, body.mass],
                "volume": [before.bodies[name].volume, body.volume],
                "stress": [before.bodies[name].stress, body.stress],
                "frequencies": [
                    before.bodies[name].frequencies[:_FREQUENCIES],
                    body.frequencies[:_FREQUENCIES],
                ],
            }
            for name, body in after.bodies.items()
        },
    }


# ---------------------------------------------------------------------- surroundings


def _versions() -> dict[str, str]:
    """What the numbers were made with."""
    system = platform.freedesktop_os_release() if Path("/etc/os-release").exists() else {}
    name = system.get("PRETTY_NAME", platform.platform())
    point_release = Path("/etc/debian_version")
    if point_release.is_file():
        name = f"{name}, {point_release.read_text().strip()}"
    return {
        "dolfinx_ffr": _installed("dolfinx_ffr"),
        "DOLFINx": _installed("fenics-dolfinx"),
        "PETSc": ".".join(map(str, PETSc.Sys.getVersion())),
        "SLEPc": ".".join(map(str, SLEPc.Sys.getVersion())),
        "NumPy": _installed("numpy"),
        "SciPy": _installed("scipy"),
        "Python": platform.python_version(),
        "Operating system": name,
        "Machine": f"{platform.machine()}, {os.cpu_count()} processors",
    }


def _installed(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return "not installed as a package"


def _command(comm: MPI.Comm) -> str:
    """The command that was called, with the number of ranks."""
    program, *arguments = sys.orig_argv or ["python"]
    ranks = ["mpirun", "-n", str(comm.size)] if comm.size > 1 else []
    return shlex.join([*ranks, Path(program).name, *arguments])
