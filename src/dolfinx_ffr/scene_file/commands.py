# SPDX-License-Identifier: MIT
"""Commands for scene files: design with part and report, check, and examples."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.resources import as_file, files
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI

from .. import plotting, validation
from ..dynamics import SimulationError
from ..files import file_names
from ..io import write_density, write_summary
from ..objective import JointForce
from ..optimization import Result, default_steps
from ..parallel import on_rank_0
from ..part import Part
from ..postprocessing import model_report
from ..problem import DesignedBodies, Evaluation, Problem
from ..report import recorded_warnings, run_record, write_report
from .calls import SceneError
from .reading import near
from .scene import Scene, read_scene

#: Exit codes of a shell for SIGINT and SIGTERM
INTERRUPTED, TERMINATED = 130, 143
COMM = MPI.COMM_WORLD
_EXAMPLES = files(__package__) / "examples"
#: Gradients of an even density that an iteration, a step of the boundary, and all that comes after
#: them take as long as, by dimension: measured on the examples, see docs/command.md; steps of a
#: surface in space were not measured
_GRADIENTS = {2: (2.0, 10.0, 170.0), 3: (5.0, 0.0, 170.0)}
#: Files by which a folder shows that a run has written into it
_RESULTS = ("summary.json", "checkpoint", "history.csv")
#: Files that belong to an example
_COMPANIONS = {"outline": ("lever.dxf", "angles.csv")}


def design(file: Path, *, output: Path | None, resume: bool, overwrite: bool = False) -> int:
    """Design the bodies of a scene file, write parts, pictures and report; the exit code.

    Results of an earlier run are refused unless it goes on from them or overwrites them.
    """
    scene = read_scene(file)
    folder = _folder(scene, output)
    if not (resume or overwrite):
        _refuse_results(folder)
    with _plain_warnings(), recorded_warnings() as warning_entries:
        problem, maker = scene.made()
        _say(f"{scene.title}: {_sizes(problem)}")
        result = scene.optimized(maker, output=folder, resume=resume)
        if (result.moved or result).reason in ("interrupted", "terminated"):
            code = TERMINATED if result.terminated else INTERRUPTED
            output_option = f" --output {output}" if output else ""
            _say(f"interrupted; to go on: dolfinx_ffr design {file}{output_option} --resume")
            return code
        verification = result.finish(folder)
        parts = _flat_parts(result) if verification else {}
        full = _full(result)
        record = run_record(
            result,
            title=scene.title,
            parts=parts,
            verification=verification,
            warnings=warning_entries,
            references=full,
        )
        _say("drawing")
        unit = record["objective"]["unit"]
        _draw(result, folder, unit)
    write_summary(COMM, folder / "summary.json", record)
    report = write_report(COMM, folder)
    reason = "" if result.reason == "iterations" else f" ({result.reason})"
    count = f"{result.iterations} iterations{reason}"
    share = f", {result.psi / full['full']:.1%} of the full bodies'" if full.get("full") else ""
    _say(f"psi = {result.psi:.6g} {unit} after {count}{share}")
    _say(record["bound"]["text"])
    if verification is None:
        raise SceneError(f"{file}: the design encloses no part; see {report}")
    _say(f"{verification}\nthe part and the report are in {folder} ({report.name})")
    return 0


def check(file: Path, *, output: Path | None) -> int:
    """Simulate the full bodies of a scene file, draw the scene, and estimate the design's time."""
    scene = read_scene(file)
    folder = _folder(scene, output)
    with _plain_warnings():
        problem, maker = scene.made()
        scene.check_run(maker)
        full = problem.value(DesignedBodies(problem.bodies).filled(1.0))
        _say(f"{scene.title}: {_sizes(problem)}")
        for name, body in problem.integrals(full).items():
            text = f"  {name}: {body.mass:.4g} kg"
            if (frequencies := full.fixed_interface_frequencies.get(name)) is not None:
                several = ", ".join(f"{f:.4g}" for f in frequencies[:4])
                text += f"; with its interfaces held {several} Hz"
            _say(text)
        _say(model_report(problem, full))
        for name in problem.load_cases:
            of = f" in load case {name}" if len(problem.load_cases) > 1 else ""
            _say(f"largest forces of the joints{of}:")
            _say(*_forces(problem.alone(name), full.alone(name)), sep="\n")
        on_rank_0(COMM, lambda: folder.mkdir(parents=True, exist_ok=True))
        picture = plotting.plot_scene(*_first(problem, full), folder / "check.png")
        _say(_estimate(scene, problem))
    _say(f"the scene is drawn in {picture}")
    return 0


def _folder(scene: Scene, output: Path | None) -> Path:
    """The folder of the results: of the command, or of the scene."""
    return scene.output if output is None else validation.path("output", output)


def _refuse_results(folder: Path) -> None:
    """Refuse to overwrite the results of a run, or the checkpoint of one that was interrupted."""

    def check() -> None:
        present = [name for name in _RESULTS if (folder / name).exists()]
        if present:
            raise SceneError(
                f"{folder} holds the results of an earlier run ({', '.join(present)}); go on from "
                "them by --resume, write elsewhere by --output FOLDER, or replace them by "
                "--overwrite"
            )

    on_rank_0(COMM, check)


def new(name: str | None, folder: Path) -> int:
    """Write an example, with the files that it needs, or say which there are."""
    names = sorted(p.name.removesuffix(".toml") for p in _EXAMPLES.iterdir() if ".toml" in p.name)
    if name is None:
        for example in names:
            title = (_EXAMPLES / f"{example}.toml").read_text(encoding="utf-8").splitlines()[0]
            _say(f"{example:14}{title.removeprefix('# ')}")
        return 0
    if name not in names:
        raise SceneError(f"there is no example {name!r}; {near(name, names)}")
    targets = [
        folder / f"{name}.toml",
        *(folder / companion for companion in _COMPANIONS.get(name, ())),
    ]

    def copy() -> None:
        for target in targets:
            if target.exists():
                raise SceneError(f"{target} is there already; move it, or go to another folder")
        for target in targets:
            with as_file(_EXAMPLES / target.name) as source:
                shutil.copyfile(source, target)

    on_rank_0(COMM, copy)
    _say(f"wrote {', '.join(map(str, targets))}; next: dolfinx_ffr check {targets[0]}")
    return 0


def _say(*words: object, sep: str = " ") -> None:
    """Print on rank 0."""
    if COMM.rank == 0 and words:
        print(*words, sep=sep, flush=True)


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """Context in which warnings are lines without a place in the code, of rank 0 alone."""
    usual = warnings.formatwarning

    def plain(message: Warning | str, *_: Any, **__: Any) -> str:
        return f"warning: {message}\n" if COMM.rank == 0 else ""

    warnings.formatwarning = plain
    try:
        yield
    finally:
        warnings.formatwarning = usual


def _sizes(problem: Problem) -> str:
    """Elements and degrees of freedom of the flexible bodies."""
    sizes = []
    for name, body in problem.flexible.items():
        space, cells = body.domain.space.dofmap, body.domain.n_cells_global
        unknowns = space.index_map.size_global * space.index_map_bs
        sizes.append(f"{name} has {cells:,} elements and {unknowns:,} degrees of freedom")
    return ", ".join(sizes)


def _flat_parts(result: Result) -> dict[str, Part]:
    """The parts in the plane."""
    parts = {name: result.part(name) for name in result.densities}
    return {name: part for name, part in parts.items() if isinstance(part, Part)}


def _first(problem: Problem, evaluation: Evaluation) -> tuple[Problem, Evaluation]:
    """The first of several load cases, which is drawn."""
    name = next(iter(problem.load_cases))
    return problem.alone(name), evaluation.alone(name)


def _draw(result: Result, folder: Path, unit: str) -> None:
    """Draw densities, history, scene and film."""
    files = file_names(result.densities)
    for name, x in result.densities.items():
        file = folder / (files[name] if len(files) > 1 else "design")
        domain = result.problem.flexible[name].domain
        write_density(domain, x, file.with_name(f"{file.name}.xdmf"))
        plotting.plot_design(domain, x, file.with_name(f"{file.name}.png"), title=name)
    plotting.plot_history(result.history, folder / "history.png", psi_unit=unit)
    first_case = _first(*result.final)
    plotting.plot_scene(*first_case, folder / "scene.png")
    plotting.animate_motion(*first_case, folder / "motion.gif")


def _full(result: Result) -> dict[str, float]:
    """Psi of the full bodies, with the modes of the design; empty if it cannot be simulated."""
    modes = {n: body.modes for n, body in (result.moved or result).problem.flexible.items()}
    with suppress(SimulationError):
        problem = result.problem.with_modes(modes)
        return {"full": problem.value(DesignedBodies(problem.bodies).filled(1.0)).psi}
    return {}


def _forces(problem: Problem, evaluation: Evaluation) -> Iterator[str]:
    """The largest force of each joint, of drives of angles the largest moment."""
    model, response = evaluation.trajectory.model, problem.response(evaluation)
    for name in problem.mechanism.joint_names:
        unit = "N m" if model.angular[model.joints[name]].all() else "N"
        yield f"  {name}: {JointForce(name).largest(response):.4g} {unit}"


def _estimate(scene: Scene, problem: Problem) -> str:
    """Estimated time of a design, from measured gradients."""
    even, seconds = DesignedBodies(problem.bodies).filled(0.5), []
    for _ in range(2):  # the first one compiles forms
        began = perf_counter()
        problem.gradient(even)
        seconds.append(perf_counter() - began)
    gradient, settings = COMM.bcast(min(seconds)), scene.run.arguments
    iterations = settings.get("iterations", 100)
    dimension = max(body.domain.dimension for body in problem.flexible.values())
    steps = settings.get("boundary", default_steps(iterations) if dimension == 2 else 0)
    per_iteration, per_step, finish = (gradient * count for count in _GRADIENTS[dimension])
    loop, moving = per_iteration * iterations, per_step * steps
    boundary = f", {steps} steps of the boundary {_time(moving)}" if moving else ""
    boundary = ", with steps of the surface on top" if steps and not moving else boundary
    return (
        f"a gradient takes {gradient:.2g} s; a design about {_time(loop + moving + finish)}: "
        f"{iterations} iterations {_time(loop)}{boundary}, verification and pictures "
        f"{_time(finish)}; more where it needs more modes"
    )


def _time(seconds: float) -> str:
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
