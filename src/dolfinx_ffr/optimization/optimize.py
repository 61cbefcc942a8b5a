# SPDX-License-Identifier: MIT
"""Optimisation of a design: one call for every kind of design and every way to update it.

    min over the design of psi(x)   such that   volume(x) <= bound (and constraints),

with x the densities of the elements of one or several bodies. The design is a level set
(`LevelSet`) or a filtered and projected density (`DensityDesign`); it is updated by explicit steps
(`LevelSetEvolution`) or by the method of moving asymptotes (`MMA`).
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from .. import validation
from ..design import Design
from ..gradients import ExactAdjoint, GradientMethod
from ..parallel import check_alike, on_every_rank
from ..problem import Problem
from .loop import Callback, DesignLoop, Optimizer
from .mma import MMA
from .result import Result

__all__ = ["optimize"]


def optimize(
    problem: Problem,
    design: Design | Mapping[str, Design],
    start: ArrayLike | Mapping[str, ArrayLike] | None = None,
    *,
    optimizer: Optimizer | None = None,
    volume: float | Mapping[str, float] = 0.5,
    gradient: GradientMethod | None = None,
    iterations: int = 100,
    output: str | Path | None = None,
    resume: bool = False,
    progress: bool = True,
    callback: Callback | None = None,
    mode_tolerance: float | None = 2e-3,
    **options: Any,
) -> Result:
    """Design one or several bodies by the gradient of all their elements.

    Ctrl-C (or SIGTERM) ends the loop after the iteration at hand and returns the design so far; a
    second one interrupts at once. The history and the checkpoint are on the disk after every
    iteration. (mpirun itself kills its processes a second after Ctrl-C; call again with ``resume``
    to have the design, on any number of ranks.)

    Args:
        problem: What is minimised; its constraints hold too, if the optimiser takes any.
        design: On the domain of the problem's body, a `LevelSet` or a `DensityDesign`; with several
            flexible bodies a mapping from their names to one each.
        start: Variables of the start design, with several bodies by name: coefficients of the level
            set, shape (knots,), for example from `LevelSet.with_holes`, or variables of a density.
            By default all are one half (`Design.even`). They are lowered until the volume bound
            holds. Where that makes a level set fall apart that explicit steps move, the loop warns
            and begins with an even density.
        optimizer: `MMA` (the default) or `LevelSetEvolution`.
        volume: Upper bound of the filled share of the body, in (0, 1]; for several bodies one
            number for each, or a mapping by name.
        gradient: How derivatives are found; by default `ExactAdjoint`. The report of each goes
            into the history.
        iterations: Steps at most, those before ``resume`` among them; a run that has made as many
            is returned as it is. A run that begins becomes crisp over them, and keeps to that when
            it is resumed with others.
        output: Folder for ``history.csv`` and ``checkpoint``; None writes nothing.
        resume: Go on from the checkpoint in ``output``. If there is none, the run begins anew, with
            a `DesignWarning`.
        progress: Show a progress bar on rank 0.
        callback: Called after each iteration with its number, the density of this rank's cells
            (with several bodies by name) and the evaluation of the design that is kept.
        mode_tolerance: Relative error of psi by the normal modes that a body leaves out. It is
            estimated every five iterations, and modes are added where it is exceeded; None leaves
            the modes as they are.
        options: Those of the optimizer, where none is given. Deprecated: give an optimizer.

    Returns:
        The last design that was kept, on every rank. A `DesignWarning` names the constraints that
        it violates (`Result.violations`), and says if more than a tenth of a body is gray.

    Raises:
        TypeError: If an argument is of a wrong kind.
        ValueError: On every rank, if the arguments do not fit each other.
        SimulationError: On every rank, if not even the motion of the start can be computed.
        CheckpointError: On every rank, if the checkpoint is damaged or of another problem.
        OSError: On every rank, if a file cannot be written.
    """
    kind = ("flexible", "value", "differentiate", "calibrated")
    validation.implementation("optimize: problem", problem, kind, "a Problem")
    comm = next(iter(problem.flexible.values())).domain.comm
    # what is a user's own may fail on one rank: designs, objectives, gradients, callbacks
    with on_every_rank(comm, "optimize"):
        check_alike(
            comm,
            "optimize",
            {
                "iterations": iterations,
                "volume": volume,
                "resume": resume,
                "output": output is not None,
                "optimizer": optimizer,
                "gradient": gradient,
                "options": options,
                "mode_tolerance": mode_tolerance,
            },
        )
        iterations = validation.integer("optimize: iterations", iterations)
        validation.flag("optimize: resume", resume)
        validation.flag("optimize: progress", progress)
        if output is not None:
            validation.instance("optimize: output", output, (str, Path), "a path")
        if callback is not None:
            of = "iteration, density and evaluation"
            validation.function("optimize: callback", callback, of)
        if gradient is not None:
            validation.implementation(
                "optimize: gradient", gradient, ("__call__", "exact"), "ExactAdjoint()"
            )
        if mode_tolerance is not None:
            validation.number("optimize: mode_tolerance", mode_tolerance, above=0.0)
        if resume and output is None:
            raise ValueError(
                "optimize: resume=True needs the folder of the checkpoint: give it as output"
            )
        designs = _by_body(problem, design)
        if optimizer is not None:
            needed = "LevelSetEvolution(...) or MMA(...)"
            validation.implementation("optimize: optimizer", optimizer, ("run",), needed)
        if optimizer is None:
            optimizer = _default_optimizer(designs, options)
        elif options:
            raise ValueError(
                f"optimize: give {sorted(options)} to the optimizer, "
                f"{type(optimizer).__name__}(...)"
            )
        loop = DesignLoop(
            problem,
            {name: part.domain for name, part in designs.items()},
            gradient=gradient or ExactAdjoint(),
            iterations=iterations,
            output=None if output is None else Path(output),
            resume=resume,
            progress=progress,
            callback=callback,
            mode_tolerance=mode_tolerance,
        )
        if start is None:
            start = {name: part.even() for name, part in designs.items()}
        starts = start if isinstance(start, Mapping) else dict.fromkeys(designs, start)
        bounds = volume if isinstance(volume, Mapping) else dict.fromkeys(designs, volume)
        for what, given in (("start", starts), ("volume", bounds)):
            if set(given) != set(designs):
                raise ValueError(
                    f"optimize: {what} is given for {sorted(given)}, and the designs are of "
                    f"{sorted(designs)}"
                )
        begin = {name: validation.numbers("optimize: start", starts[name]) for name in designs}
        check_alike(comm, "optimize", {f"the start of {n!r}": x for n, x in begin.items()})
        filled = {name: validation.number("optimize: volume", bounds[name]) for name in designs}
        result = optimizer.run(loop, designs, begin, filled)
    return result


def _default_optimizer(designs: Mapping[str, Design], options: dict[str, Any]) -> Optimizer:
    """The first optimizer that can move all designs."""
    kind = MMA
    if options:
        warnings.warn(
            f"optimize: {sorted(options)} are options of the optimizer, and go there with the next "
            f"release: optimizer={kind.__name__}(...)",
            DeprecationWarning,
            stacklevel=3,
        )
    return kind(**options)


def _by_body(problem: Problem, design: Design | Mapping[str, Design]) -> dict[str, Design]:
    """The designs in the order of the problem's bodies."""
    names = list(problem.flexible)
    if isinstance(design, Mapping):
        if set(design) != set(names):
            raise ValueError(
                f"optimize: designs are given for {sorted(design)}, and the problem has {names}"
            )
        found = {name: design[name] for name in names}
    elif len(names) != 1:
        raise ValueError(
            f"optimize: one design designs one body, and the problem has {sorted(names)}; give a "
            "mapping from name to design, or some bodies as VolumeIntegrals"
        )
    else:
        found = {names[0]: design}
    for name, part in found.items():
        needed = "a LevelSet or a DensityDesign"
        validation.instance(f"optimize: the design of {name!r}", part, Design, needed)
        if part.domain is not problem.flexible[name].domain:
            raise ValueError(
                f"optimize: the design of {name!r} is not on the domain of the problem's body; "
                f"make it on problem.bodies[{name!r}].domain (what is pickled apart has a domain "
                "of its own each: pickle problem and design together, as one tuple)"
            )
    return found
