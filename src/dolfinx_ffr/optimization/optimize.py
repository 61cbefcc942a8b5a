# SPDX-License-Identifier: MIT
"""One call for every kind of design and every way to update it.

min over the design of psi(x)   such that   volume(x) <= bound (and constraints).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any

from mpi4py import MPI

from numpy.typing import ArrayLike

from .. import validation
from ..design import SHARP_PROGRESS, Design, Variables
from ..mechanism import Parameters
from ..parallel import on_every_rank
from ..problem import Problem
from .arguments import VOLUME, RunSettings, checked
from .loop import Callback, DesignLoop, ExactAdjoint, GradientMethod, Optimizer
from .mma import MMA
from .moved_parts import with_checked_parts, with_moved_boundaries
from .result import Result, ranks_of
from .running import alone_in


def optimize(
    problem: Problem,
    design: Variables | Parameters | Mapping[str, Variables | Parameters],
    start: ArrayLike | Mapping[str, ArrayLike] | None = None,
    *,
    optimizer: Optimizer | None = None,
    volume: float | Mapping[str, float] = VOLUME,
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
            (with several bodies by name) and the evaluation of the accepted design; there
            ``objective.evaluate(problem.response(evaluation))`` gives any other objective.
        mode_tolerance: Relative error of psi by the normal modes that a body leaves out. It is
            estimated every five iterations, and modes are added where it is exceeded; None leaves
            the modes as they are.
        boundary: Steps of the boundaries of the parts that follow the iterations, see
            `move_boundary`: `Result.moved` has their outcome, to which psi, violations and parts of
            the result belong. By default half as many as the iterations, and 25 at most, for
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
        _refuse(options, optimizer)
        run = checked(
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
        chosen = _with_length(optimizer or MMA(), run, iterations)
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


def _with_length(optimizer: Optimizer, run: RunSettings, iterations: int) -> Optimizer:
    """The ``optimizer`` with the iterations over which designs become sharp, where it has none."""
    if not isinstance(optimizer, MMA) or optimizer.length is not None:
        return optimizer
    if not run.domains:
        return replace(optimizer, length=1)  # nothing becomes sharp
    if run.steps:
        # a sharp design is where the boundary begins: it finds sizes better than elements do
        return replace(optimizer, length=max(math.ceil(iterations / SHARP_PROGRESS), 1))
    return optimizer


def check_run(problem: Problem, design: Any, **settings: Any) -> None:
    """Raise the errors of `optimize` for wrong arguments, without a computation.

    It takes the arguments of `optimize`.
    """
    comm = _ranks(problem)
    with on_every_rank(comm, "optimize"):
        bound_arguments = signature(optimize).bind(problem, design, **settings)
        bound_arguments.apply_defaults()
        arguments = dict(bound_arguments.arguments)
        _refuse(arguments.pop("options"), arguments["optimizer"])
        checked(comm, **arguments)


def _refuse(options: Mapping[str, Any], optimizer: Optimizer | None) -> None:
    """Refuse keywords that `optimize` does not have; those of an optimizer belong to it."""
    if options:
        kind = MMA if optimizer is None else type(optimizer)
        validation.keywords("optimize", options, optimize, kind)
        raise ValueError(
            f"optimize: give {sorted(options)} to the optimizer, optimizer={kind.__name__}(...)"
        )


def _ranks(problem: Problem) -> MPI.Comm:
    """The communicator of a problem."""
    kind = ("flexible", "value", "differentiate", "calibrated")
    validation.implementation("optimize: problem", problem, kind, "a Problem")
    return ranks_of(problem)
