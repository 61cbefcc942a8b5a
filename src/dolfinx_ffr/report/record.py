# SPDX-License-Identifier: MIT
"""The entries of summary.json that a report of a run uses.

All keys are optional to the report, which says what it misses. Numbers are in SI units, relative
errors are shares (0.01 is one percent), and None stands for unknown values.

| key | |
|---|---|
| ``title`` | heading |
| ``psi``, ``reason``, ``residual``, ``iterations``, ``feasible``, ``violations``, ``volume``, ``gray``, ``modes``, ``mode_error`` | those of `Result.summary` |
| ``objective`` | ``name`` and ``unit`` of psi |
| ``load_cases`` | of several, by name: ``psi``, ``objective`` (``name`` and ``unit``), ``weight``, ``integrator``, ``order``, ``duration`` [s], ``steps``, ``loads`` |
| ``references`` | psi of other designs by name, to compare with; the first is what psi is relative to |
| ``constraints`` | by name: ``value`` and ``bound`` in ``unit``, ``kind`` ("at most", "at least"), ``violation`` relative to the bound, 0 where it holds |
| ``frequencies`` | by body, with its interfaces held [Hz] |
| ``stress`` | by body: ``value``, the largest von Mises stress [Pa], ``time`` [s], ``position`` [m], of several load cases the ``load_case`` |
| ``scene`` | ``text`` of `model_report` and its ``modes_error``, ``step_error``, ``coordinates``, ``rows``, ``left_out``; ``bodies`` by name (kind, modes, frequencies [Hz], elements, order, material); ``joints`` (name, kind, between, of several motions the motion); of one motion ``loads`` in words; ``integrator`` and its ``duration`` [s], ``steps``, ``order`` |
| ``parts`` | by body: ``area`` [m^2], ``thickness`` [m], ``mass`` [kg], ``center`` and ``bounds`` [m], ``thinnest_member`` and ``narrowest_gap`` (``value`` and both ``ends`` [m]), ``pieces``, ``holes``, ``loose`` (number of pieces left out) |
| ``bound`` | ``text`` on the lower bound of psi, or why there is none; where there is one its ``psi``, psi of the ``full`` bodies and of the best ``sheet`` without vibrations, and the ``gap`` by which psi of the design is above it at most |
| ``verification`` | ``reported`` and ``part``: psi; ``difference``, ``change`` by the last mesh, ``tolerance``, ``converged``; ``differences`` in words, ``violations`` by name; ``meshes`` (``size`` [m], ``psi``); ``constraints`` by name, pairs; ``load_cases``, of several the pairs of psi by name; ``bodies`` by name: ``cells`` and what they are, ``elements``, ``modes``, ``pieces``, ``holes`` and ``pockets`` of flat parts, ``thinnest_member`` and ``narrowest_gap`` [m], and pairs reported, part of ``mass`` [kg], ``volume``, ``stress`` [Pa], ``frequencies`` [Hz] |
| ``warnings`` | ``category`` and ``message`` of each, in their order |
| ``versions`` | of the package and of what it is built on, by name; operating system and machine |
| ``command``, ``date``, ``ranks``, ``seconds`` | how to repeat it, when it ended (ISO 8601), MPI ranks, time of the design loop [s] |
"""  # noqa: E501  the table is one line a key

from __future__ import annotations

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
from ..io import plain
from ..mechanical_problem import MechanicalProblem
from ..mechanism import Mechanism, marker_name
from ..objective import JointForce, Objective
from ..optimization import Result
from ..parallel import on_rank_0
from ..part import Part, Verification, Width
from ..postprocessing import model_report, worst_stress
from ..problem import Evaluation, Problem

#: Keys that the report knows
KEYS = (
    "title psi reason residual iterations feasible violations volume gray modes mode_error "
    "objective bound load_cases references constraints frequencies stress scene parts verification "
    "warnings versions command date ranks seconds"
).split()
#: How many frequencies of each body are recorded
_FREQUENCIES = 6


@contextmanager
def recorded_warnings() -> Iterator[list[dict[str, str]]]:
    """Context in which warnings are listed beside being shown, each once, for `run_record`.

    Yields:
        A list that grows: category and message of each warning of this rank.
    """
    show = python_warnings.showwarning
    entries: list[dict[str, str]] = []

    def record(message: Warning | str, category: type[Warning], *rest: Any, **options: Any) -> None:
        entry = {"category": category.__name__, "message": str(message)}
        if entry not in entries:
            entries.append(entry)
        show(message, category, *rest, **options)

    python_warnings.showwarning = record
    try:
        yield entries
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
    """The entries of summary.json for the report of a run, for `write_summary`.

    They are about the parts if boundaries were moved, else about the densities. The errors of the
    model are estimated and the stress is recovered, which takes a few simulations; if the estimate
    fails, a warning is recorded.

    Args:
        result: The result of `optimize`.
        title: Heading of the report.
        parts: The parts that the designs enclose, by name of the body.
        verification: The result of `verify` for these parts.
        warnings: Warnings of the run, from `recorded_warnings`.
        references: psi of other designs by name; psi is given relative to the first one, for
            example of the full body.
        volume: Upper bound of the volume; by default the argument of `optimize`.

    Returns:
        Numbers, texts, lists and mappings that JSON can hold, the same on every rank.
    """
    validation.instance("run_record: result", result, Result, "what optimize() returned")
    validation.instance("run_record: title", title, str, "a text")
    bodies = result.problem.flexible
    planar_parts = validation.instances_by_name("run_record: parts", parts or {}, Part, "a Part")
    if volume is None:
        volume = result.bounds
    bounds = volume if isinstance(volume, Mapping) else dict.fromkeys(result.densities, volume)
    for argument, names in (("parts", planar_parts), ("volume", bounds)):
        if unknown := sorted(set(names) - set(bodies)):
            raise ValueError(
                f"run_record: {argument} are given for {unknown}, and the bodies with a density "
                f"are {sorted(bodies)}"
            )
    if verification is not None:
        needed = "what verify() returned"
        validation.instance("run_record: verification", verification, Verification, needed)
    final = result.moved or result
    problem, evaluation = final.problem, final.evaluation
    warning_entries = [dict(entry) for entry in warnings]
    record = {
        "title": title,
        **result.summary(),
        "objective": _objective(problem, evaluation),
        "load_cases": _load_cases(problem, evaluation) if len(problem.load_cases) > 1 else {},
        "references": {name: float(psi) for name, psi in (references or {}).items()},
        "constraints": _constraints(result, bounds),
        "frequencies": {
            name: [float(f) for f in values[:_FREQUENCIES]]
            for name, values in evaluation.fixed_interface_frequencies.items()
        },
        "stress": _stress(problem, evaluation),
        "scene": _scene(problem, evaluation, warning_entries),
        "parts": on_rank_0(
            problem.comm, lambda: {name: _part(part) for name, part in planar_parts.items()}
        ),
        "verification": None if verification is None else verification.record(),
        "bound": _bound(result, evaluation.psi if verification is None else verification.psi),
        "warnings": warning_entries,
        "versions": _versions(),
        "command": _command(problem.comm),
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "ranks": problem.comm.size,
        "seconds": float(result.history["seconds"][-1]),
    }
    of_root: dict[str, Any] = problem.comm.bcast(plain(record), root=0)
    return of_root


def _bound(result: Result, psi: float) -> dict[str, Any]:
    """The lower bound and its gap to ``psi``, or the reason why there is none."""
    try:
        return result.lower_bound.record(psi)
    except (ValueError, SimulationError) as error:
        return {"text": str(error)}


def _unit(objective: Objective, trajectory: Trajectory | None) -> str:
    """Unit of an ``objective``; joints whose rows are all angles carry moments."""
    if isinstance(objective, JointForce) and trajectory is not None:
        model = trajectory.model
        is_drive = isinstance(objective.joint, str) and all(
            model.angular[model.joints[objective.joint]]
        )
        return "N m" if objective.moment or is_drive else "N"
    return objective.unit


def _objective(problem: Problem, evaluation: Evaluation) -> dict[str, str]:
    """Name and unit of psi; of several load cases the unit is known without weights only."""
    units = {
        _unit(case.objective, evaluation.load_cases[name].trajectory)
        for name, case in problem.load_cases.items()
    }
    name, combine = type(problem.combine).__name__, problem.combine
    if len(problem.load_cases) == 1:
        name = type(problem.objective).__name__
    unit = units.pop() if combine.weights is None and len(units) == 1 else ""
    return {"name": name, "unit": unit}


def _load_cases(problem: Problem, evaluation: Evaluation) -> dict[str, Any]:
    entries: dict[str, Any] = {}
    for name, case in problem.load_cases.items():
        objective, case_evaluation = case.objective, evaluation.load_cases[name]
        kind = {
            "name": type(objective).__name__,
            "unit": _unit(objective, case_evaluation.trajectory),
        }
        entries[name] = {
            "psi": case_evaluation.psi,
            "objective": kind,
            "weight": problem.combine.weight(name),
        }
        entries[name] |= {
            "loads": _loads(case.mechanism),
            **_integration(case, case_evaluation.trajectory),
        }
    return entries


def _integration(case: MechanicalProblem, trajectory: Trajectory | None) -> dict[str, Any]:
    integrator = case.integrator
    entry: dict[str, Any] = {
        "integrator": type(integrator).__name__,
        "duration": integrator.end_time,
    }
    if trajectory is not None:
        entry["order"] = case.method.order
        entry["steps"] = len(trajectory.step_ends) - 1
    return entry


def _scene(
    problem: Problem, evaluation: Evaluation, warning_entries: list[dict[str, str]]
) -> dict[str, Any]:
    bodies: dict[str, Any] = {name: {"kind": "flexible"} for name in problem.flexible}
    joints: list[dict[str, Any]] = []
    entry: dict[str, Any] = {"bodies": bodies, "joints": joints}
    for load_case, case in problem.load_cases.items():
        for name, joint in zip(case.mechanism.joint_names, case.mechanism.joints, strict=True):
            between = [marker_name(marker) for marker in joint.markers]
            joints.append({"name": name, "kind": type(joint).__name__, "between": between})
            if len(problem.load_cases) > 1:
                joints[-1]["load_case"] = load_case
    if len(problem.load_cases) == 1:
        entry["loads"] = _loads(case.mechanism)
        entry |= _integration(case, evaluation.trajectory if evaluation.is_simulated else None)
    if evaluation.is_simulated:
        try:
            report = model_report(problem, evaluation)
            names = ("modes_error", "step_error", "coordinates", "rows", "left_out")
            entry |= {"text": str(report), **_attributes(report, *names)}
            bodies |= {name: {**vars(body)} for name, body in report.bodies.items()}
        except SimulationError as error:  # with longer steps, which a warning reports
            message = f"the errors by modes and time step could not be estimated: {error}"
            warning_entries.append({"category": type(error).__name__, "message": message})
    for name, body in problem.flexible.items():
        bodies[name] |= {"elements": body.domain.n_cells_global, "order": body.domain.order}
        bodies[name]["material"] = _numbers_of(body.material)
    return entry


def _attributes(thing: Any, *names: str) -> dict[str, Any]:
    return {name: getattr(thing, name) for name in names}


def _loads(mechanism: Mechanism) -> list[str]:
    """The loads on the bodies besides their inertia, in words."""
    loads = [f"point mass {p.mass:g} kg at {marker_name(p.marker)}" for p in mechanism.point_masses]
    ground = {"acceleration of the ground": mechanism.ground_acceleration}
    for name, pair in {"gravity": mechanism.gravity, **ground}.items():
        if not all(validation.is_number(component) for component in pair):
            loads.append(f"{name} as a function of time")
        elif any(pair):
            loads.append(f"{name} ({', '.join(f'{component:g}' for component in pair)}) m/s²")
    for name, force in zip(mechanism.force_names, mechanism.forces, strict=True):
        markers = ", ".join(marker_name(marker) for marker in force.markers)
        loads.append(f"{type(force).__name__} {name} at {markers}")
    for name, damping in mechanism.damping.items():
        if damping.alpha or damping.beta:
            loads.append(f"damping of {name}: {damping.alpha:g} 1/s, {damping.beta:g} s")
    return loads


def _numbers_of(material: Any) -> dict[str, Any]:
    """Class and numbers of a material that is a dataclass."""
    names = [field.name for field in fields(material)] if is_dataclass(material) else []
    values = _attributes(material, *names)
    numbers = {name: float(v) for name, v in values.items() if validation.is_number(v)}
    return {"kind": type(material).__name__, **numbers}


def _constraints(result: Result, bounds: Mapping[str, float]) -> dict[str, Any]:
    """The bounds of volumes, and the constraints of all load cases by their labels."""
    keys = ("value", "bound", "unit", "kind", "violation")
    final = result.moved or result
    problem, evaluation, entries = final.problem, final.evaluation, {}
    shares = (result.moved or evaluation).volume
    for body, bound in bounds.items():
        name = f"volume of {body}"
        violation = result.violations.get(name, 0.0)
        entries[name] = shares[body], float(bound), "", "at most", violation
    trajectories = [
        evaluation.load_cases[name].trajectory
        for name, case in problem.load_cases.items()
        for _ in case.constraints
    ]
    for constraint, trajectory in zip(problem.constraints, trajectories, strict=True):
        constraint_value = evaluation.constraints[constraint.label]
        kind = "at least" if constraint.upper is None else "at most"
        unit = _unit(constraint.objective, trajectory)
        violation = max(constraint_value.violation, 0.0)
        value = constraint_value.value
        entries[constraint.label] = value, constraint.bound, unit, kind, violation
    return {name: dict(zip(keys, values, strict=True)) for name, values in entries.items()}


def _stress(problem: Problem, evaluation: Evaluation) -> dict[str, Any]:
    entries: dict[str, Any] = {}
    for name, body in problem.flexible.items() if evaluation.is_simulated else ():
        worst = worst_stress(body, evaluation, name)
        entries[name] = {key: getattr(worst, f"largest_{key}") for key in ("time", "position")}
        entries[name]["value"] = worst.largest
        if len(problem.load_cases) > 1:
            entries[name]["load_case"] = worst.load_case
    return entries


def _part(part: Part) -> dict[str, Any]:
    def width(measured: Width | None) -> dict[str, Any] | None:
        return None if measured is None else _attributes(measured, "value", "ends")

    return {
        **_attributes(part, "area", "center", "pieces", "holes"),
        "thickness": part.thickness if part.material is not None else None,
        "mass": part.mass if part.weighs else None,
        "bounds": list(part.polygon.bounds),
        "thinnest_member": width(part.thinnest_member),
        "narrowest_gap": width(part.narrowest_gap),
        "loose": len(part.loose),
    }


def _versions() -> dict[str, str]:
    """Versions of the software, and the machine."""
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
