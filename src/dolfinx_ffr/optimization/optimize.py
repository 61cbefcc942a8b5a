# SPDX-License-Identifier: MIT
"""One call for every kind of design and every way to update it.

min over the design of psi(x)   such that   volume(x) <= bound (and constraints).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from inspect import signature
from pathlib import Path
from typing import Any

from mpi4py import MPI

from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array
from ..design import SHARP_PROGRESS, Design, ParameterDesign, Variables
from ..fem import PLATE, Domain
from ..mechanism import Parameters
from ..objective import PeakStress
from ..parallel import check_alike, on_every_rank
from ..problem import Problem
from .loop import Callback, DesignLoop, ExactAdjoint, GradientMethod, Optimizer
from .mma import MMA
from .moved_parts import with_checked_parts, with_moved_boundaries
from .result import Result, ranks_of, warn
from .running import alone_in
from .sizing import sized

#: Filled share by default, and most steps of boundaries
_VOLUME, _BOUNDARY = 0.5, 25


def optimize(
    problem: Problem,
    design: Variables | Parameters | Mapping[str, Variables | Parameters],
    start: ArrayLike | Mapping[str, ArrayLike] | None = None,
    *,
    optimizer: Optimizer | None = None,
    volume: float | Mapping[str, float] = _VOLUME,
    gradient: GradientMethod | None = None,
    iterations: int = 100,
    output: str | Path | None = None,
    resume: bool = False,
    progress: bool = True,
    callback: Callback | None = None,
    mode_tolerance: float | None = 2e-3,
    boundary: int | None = None,
    **options: Any,
) -> Result:
    """Design bodies by the gradient of all their elements, and parameters of their mechanism.

    Ctrl-C (or SIGTERM) ends the loop after the iteration at hand and returns the design so far,
    with `Result.reason` "interrupted"; a second one raises KeyboardInterrupt at once, as mpirun
    does a second after the first. After SIGTERM `Result.finish` makes no parts: who sends it wants
    the program to end. ``resume`` goes on from the checkpoint, which is written after every
    iteration and every step of a boundary, on any number of ranks.

    Args:
        problem: The problem with objective and constraints, if the optimiser takes constraints.
        design: On the domain of the problem's body, a `LevelSet` or a `DensityDesign`, or its
            dimensions, a `DimensionDesign`, which takes no ``volume``; with several flexible
            bodies a mapping from their names to one each, of any kind. The `Parameters` of the
            mechanism have a name of their own in the mapping, or are the design where no body has
            a density. So have other `Variables` without a domain: a problem of one's own is
            evaluated at them by that name, and has a gradient with respect to them, shape (size,).
        start: Variables of the start design, shape (size,), with several by name, for example from
            `LevelSet.with_holes`, and the values of parameters; by default `Variables.even`, and
            the parameters' own values. Densities are lowered until the volume bound holds. If a
            level set falls apart by that, `LevelSetEvolution` warns and begins with an even
            density.
        optimizer: `MMA` (the default) or `LevelSetEvolution`.
        volume: Upper bound of the filled share of the body, in (0, 1]; for several bodies one
            number for each, or a mapping by name.
        gradient: How derivatives are found; by default `ExactAdjoint`.
        iterations: Steps at most, those before ``resume`` among them. A run that begins becomes
            sharp over them, and keeps to that when it is resumed with others.
        output: Folder for ``history.csv`` and ``checkpoint``; None writes nothing. While the loop
            runs, another program that is to write there is refused.
        resume: Go on from the checkpoint in ``output``. A `DesignWarning` says if there is none, or
            if ``start``, which then counts for nothing, is not the one that the run began with.
        progress: Show a progress bar on rank 0.
        callback: Called after each iteration with its number, the density of this rank's cells
            (with several bodies by name) and the evaluation of the design that is kept; there
            ``objective.evaluate(problem.response(evaluation))`` gives any other objective.
        mode_tolerance: Relative error of psi by the normal modes that a body leaves out. It is
            estimated every five iterations, and modes are added where it is exceeded; None leaves
            the modes as they are.
        boundary: Steps of the boundaries of the parts after those of the densities, see
            `move_boundary`: `Result.moved` has what they come to, and psi, violations and parts of
            the result are theirs. By default half as many as the iterations, and 25 at most, for
            bodies in the plane and exact gradients, and none in space; 0 leaves the boundaries to
            the mesh. Up to twelve more follow where finer meshes exceed a bound. Where such steps
            follow, the iterations end as soon as the design is sharp; without them, nearly as many
            again settle its sizes.
        options: None; the error says which name is meant, or that it belongs to the optimizer.

    Returns:
        The result, the same on every rank.

    Warns:
        DesignWarning: Names violated constraints (`Result.violations`), bodies more than a tenth of
            which is gray, loose pieces, designs that make no part, the reason why a boundary was
            not moved, and, before the loop, interfaces along which no cell stays solid, and
            parameters of the mechanism without a design.

    Raises:
        ValueError: If the arguments do not fit each other, or psi of the start is zero.
        SimulationError: If not even the motion of the start can be computed.
        CheckpointError: If the checkpoint is damaged or of another problem.
        OSError: If a file cannot be written, or another program writes into ``output``.
    """
    comm = _ranks(problem)
    # code of users may fail on one rank: designs, objectives, gradients, callbacks
    with on_every_rank(comm, "optimize"):
        run = _checked(
            comm,
            problem,
            design,
            start,
            optimizer=optimizer,
            volume=volume,
            gradient=gradient,
            iterations=iterations,
            output=output,
            resume=resume,
            progress=progress,
            callback=callback,
            mode_tolerance=mode_tolerance,
            boundary=boundary,
            options=options,
        )
        loop = DesignLoop(
            run.problem,
            run.domains,
            gradient=gradient or ExactAdjoint(),
            iterations=iterations,
            output=run.folder,
            resume=resume,
            progress=progress,
            callback=callback,
            start=None if start is None else run.begin,
            mode_tolerance=mode_tolerance if run.sizing is None else None,
            followed=run.steps > 0,
            webs={n: d.web for n, d in run.designs.items() if isinstance(d, Design)},
        )
        if run.tuned:
            problem.check_influence()
        chosen = optimizer or MMA()
        if run.steps and isinstance(chosen, MMA) and chosen.length is None:
            # a sharp design is where the boundary begins: it finds sizes better than elements do
            chosen = replace(chosen, length=max(math.ceil(iterations / SHARP_PROGRESS), 1))
        if not run.domains and isinstance(chosen, MMA) and chosen.length is None:
            chosen = replace(chosen, length=1)  # nothing becomes sharp
        with alone_in(comm, run.folder, "optimize: output"):
            result = chosen.run(loop, run.designs, run.begin, run.filled)
            if run.sizing is not None:
                result = run.sizing[0].finished(result, mode_tolerance)
            if run.steps and result.reason != "interrupted":
                result = with_moved_boundaries(
                    result, run.steps, mode_tolerance, progress, loop.checkpoint
                )
            elif isinstance(problem, Problem) and result.feasible:
                result = with_checked_parts(result)
    ended = loop.run.terminated or (result.moved and result.moved.reason == "terminated")
    return replace(result, terminated=True) if ended else result


@dataclass(frozen=True)
class _Checked:
    """The arguments of `optimize`, checked, with defaults in place."""

    problem: Problem
    designs: dict[str, Variables]
    domains: dict[str, Domain]
    begin: dict[str, Array]  #: Variables of the start by design
    filled: dict[str, float]  #: Bounds of the volume by body
    sizing: Any  #: Problem and design of dimensions, None without them
    tuned: bool  #: Whether parameters of the mechanism are designed
    folder: Path | None
    steps: int  #: Of the boundary


def check_run(problem: Problem, design: Any, **settings: Any) -> None:
    """Raise the errors of `optimize` for wrong arguments, without a computation.

    Arguments and errors are those of `optimize`.
    """
    comm = _ranks(problem)
    with on_every_rank(comm, "optimize"):
        bound_arguments = signature(optimize).bind(problem, design, **settings)
        bound_arguments.apply_defaults()
        _checked(comm, **bound_arguments.arguments)


def _ranks(problem: Problem) -> MPI.Comm:
    """The communicator of a problem."""
    kind = ("flexible", "value", "differentiate", "calibrated")
    validation.implementation("optimize: problem", problem, kind, "a Problem")
    return ranks_of(problem)


def _checked(
    comm: MPI.Comm,
    problem: Problem,
    design: Any,
    start: Any,
    *,
    optimizer: Optimizer | None,
    volume: float | Mapping[str, float],
    gradient: GradientMethod | None,
    iterations: int,
    output: str | Path | None,
    resume: bool,
    progress: bool,
    callback: Callback | None,
    mode_tolerance: float | None,
    boundary: int | None,
    options: Mapping[str, Any],
) -> _Checked:
    """The arguments of `optimize`, or an error if they do not fit each other."""
    compared: dict[str, Any] = {"iterations": iterations, "volume": volume, "resume": resume}
    compared |= {"output": output is not None, "optimizer": optimizer, "gradient": gradient}
    compared |= {"options": options, "mode_tolerance": mode_tolerance, "boundary": boundary}
    check_alike(comm, "optimize", compared)
    iterations = validation.integer("optimize: iterations", iterations)
    if boundary is not None:
        validation.integer("optimize: boundary", boundary)
    validation.flag("optimize: resume", resume)
    validation.flag("optimize: progress", progress)
    folder = None if output is None else validation.path("optimize: output", output)
    if callback is not None:
        takes = "iteration, density and evaluation"
        validation.function("optimize: callback", callback, takes)
    if gradient is not None:
        members = ("__call__", "exact")
        validation.implementation("optimize: gradient", gradient, members, "ExactAdjoint()")
    if mode_tolerance is not None:
        validation.number("optimize: mode_tolerance", mode_tolerance, above=0.0)
    if resume and output is None:
        raise ValueError(
            "optimize: resume=True needs the folder of the checkpoint: give it as output"
        )
    design = _with_parameters(problem, design)
    sizing = sized(problem, design)
    all_sized = sizing is not None and not sizing[0].flexible
    given_volume = all_sized and volume != _VOLUME
    if sizing and (given_volume or gradient or not isinstance(optimizer, MMA | None)):
        raise ValueError(
            "optimize: a design by dimensions needs MMA, the exact gradient, and no volume; bound "
            "the material by a constraint, ffr.Constraint(ffr.Mass(name), upper=...)"
        )
    designs = _by_body(*(sizing or (problem, design)))
    tuned = [d for d in designs.values() if isinstance(d, ParameterDesign)]
    if tuned and gradient is not None and not gradient.exact:
        raise ValueError("optimize: parameters take the exact gradient")
    if optimizer is not None:
        needed = "LevelSetEvolution(...) or MMA(...)"
        validation.implementation("optimize: optimizer", optimizer, ("run",), needed)
    if options:
        taker = MMA if optimizer is None else type(optimizer)
        validation.keywords("optimize", options, optimize, taker)
        give = f"give {sorted(options)} to the optimizer"
        raise ValueError(f"optimize: {give}, optimizer={taker.__name__}(...)")
    problem = _of_plates(problem, designs, optimizer)
    starts = start if isinstance(start, Mapping) else dict.fromkeys(designs, start)
    if start is None:
        starts = {name: d.even() for name, d in designs.items()}
    domains = {name: d.domain for name, d in designs.items() if isinstance(d, Design)}
    bounds = volume if isinstance(volume, Mapping) else dict.fromkeys(domains, volume)
    for argument, by_body, names in (("start", starts, designs), ("volume", bounds, domains)):
        if set(by_body) != set(names):
            raise ValueError(
                f"optimize: {argument} is given for {sorted(by_body)}, and the designs are of "
                f"{sorted(names)}"
            )
    begin = {name: validation.numbers("optimize: start", starts[name]) for name in designs}
    check_alike(comm, "optimize", {f"the start of {n!r}": x for n, x in begin.items()})
    flat = isinstance(problem, Problem) and {d.dimension for d in domains.values()} == {2}
    steps = boundary or 0
    if boundary is None and flat and (gradient is None or gradient.exact):
        steps = default_steps(iterations)
    if steps and not (isinstance(problem, Problem) and domains):
        raise ValueError(
            "optimize: only the boundary of a Problem with densities can be moved; give boundary=0"
        )
    filled = {
        name: validation.number(f"optimize: volume of {name!r}", bounds[name], above=0.0, most=1.0)
        for name in domains
    }
    return _Checked(
        problem=problem if sizing is None else sizing[0],  # type: ignore[arg-type]
        designs=designs,
        domains=domains,
        begin=begin,
        filled=filled,
        sizing=sizing,
        tuned=bool(tuned),
        folder=folder,
        steps=steps,
    )


def _of_plates(
    problem: Problem, designs: Mapping[str, Variables], optimizer: Optimizer | None
) -> Problem:
    """The problem with stiffness and mass in proportion to the thickness of designs with a web.

    A ValueError is raised if that is not so, or if the web would not matter.
    """
    webs = [n for n, design in designs.items() if isinstance(design, Design) and design.web]
    if not webs:
        return problem
    named = ", ".join(map(repr, webs))
    if optimizer is not None and not isinstance(optimizer, MMA):
        raise ValueError(f"optimize: the web of {named} takes MMA(...), not {optimizer!r}")
    for name in webs:
        if problem.flexible[name].material.out_of_plane:
            raise ValueError(
                f"optimize: the web of {name!r} is for plane stress, in which stiffness and mass "
                "are in proportion to the thickness; give the body PlaneStress(...), or leave the "
                "web out"
            )
    objectives = [case.objective for case in problem.load_cases.values()]
    objectives += [constraint.objective for constraint in problem.constraints]
    for term in (term for objective in objectives for _, term in objective._summands()):
        if isinstance(term, PeakStress) and term.body in webs and term.relaxation:
            raise ValueError(
                f"optimize: PeakStress({term.body!r}) would count only a share of the stress in "
                "the web; give it relaxation=0"
            )
    plates = {name: problem.flexible[name].with_interpolation(PLATE) for name in webs}
    return problem.with_bodies(plates)


def default_steps(iterations: int) -> int:
    """The default number of boundary steps for a number of iterations on the elements."""
    return min(iterations // 2, _BOUNDARY)


def _with_parameters(
    problem: Problem, design: Variables | Parameters | Mapping[str, Variables | Parameters]
) -> Variables | Mapping[str, Variables]:
    """The designs with parameters as variables, or an error if the problem has others."""
    if isinstance(design, Parameters) and not problem.flexible:
        design = {"parameters": design}
    by_name = design if isinstance(design, Mapping) else {"": design}
    parameters = {name: entry for name, entry in by_name.items() if isinstance(entry, Parameters)}
    expected = getattr(problem, "parameters", None)
    for name, entry in parameters.items():
        if expected is None or not entry.fits(expected):
            raise ValueError(
                f"optimize: {name or 'the design'!r} has the parameters {entry.names}, but the "
                f"mechanism of the problem has {'none' if expected is None else expected.names}, "
                "or other bounds; make the mechanism by parameters.mechanism(...)"
            )
        if name in problem.bodies or len(parameters) > 1:
            raise ValueError(
                f"optimize: give the parameters once, and not by the name of a body, {name!r}"
            )
    if not parameters:
        if expected is not None:
            warn(
                f"optimize: the parameters {expected.names} of the mechanism keep their values, as "
                "no design is given for them; give a mapping, as {'rod': design, 'machine': "
                "problem.parameters}, to design them, too, or make the mechanism without them",
            )
        return design  # type: ignore[return-value]
    return {n: ParameterDesign(p) if n in parameters else p for n, p in by_name.items()}  # type: ignore[misc, arg-type]


def _by_body(problem: Problem, design: Variables | Mapping[str, Variables]) -> dict[str, Variables]:
    """The designs in the order of the problem's bodies, and then those without a domain."""
    names = list(problem.flexible)
    if isinstance(design, Mapping):
        without_domain = [
            n for n, entry in design.items() if n not in names and not isinstance(entry, Design)
        ]
        if set(design) != {*names, *without_domain} or not design:
            raise ValueError(
                f"optimize: designs are given for {sorted(design)}, and the problem has {names}"
            )
        by_body = {name: design[name] for name in [*names, *without_domain]}
    elif len(names) != 1:
        raise ValueError(
            f"optimize: one design designs one body, and the problem has {sorted(names)}; give a "
            "mapping from name to design, or some bodies as VolumeIntegrals"
        )
    else:
        by_body = {names[0]: design}
    for name, entry in by_body.items():
        label = f"optimize: the design of {name!r}"
        if name in names:
            validation.instance(label, entry, Design, "a LevelSet or a DensityDesign")
        else:
            validation.instance(label, entry, Variables, "Variables")
        if not isinstance(entry, Design):
            continue
        if entry.domain is not problem.flexible[name].domain:
            raise ValueError(
                f"optimize: the design of {name!r} is not on the domain of the problem's body; "
                f"make it on problem.bodies[{name!r}].domain"
            )
        # with a web there is a rim along all of the outline
        undefended = [] if entry.web else entry.domain.designed_interfaces
        if entry.hole_rim:
            undefended = [
                interface for interface in undefended if not entry.domain.on_hole(interface)
            ]
        if undefended:
            warn(
                f"optimize: no cell of {name!r} along {', '.join(map(repr, undefended))} stays "
                "solid, so that the design may lose all material there and enclose no part; keep "
                "cells along each interface solid (Domain(..., solid=...))",
            )
    return by_body
