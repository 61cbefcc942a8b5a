# SPDX-License-Identifier: MIT
"""Optimisation of a design: one call for every kind of design and every way to update it.

    min over the design of psi(x)   such that   volume(x) <= bound (and constraints),

with x the densities of the elements of one or several bodies. The design is a level set
(`LevelSet`) or a filtered and projected density (`DensityDesign`); it is updated by explicit steps
(`LevelSetEvolution`) or by the method of moving asymptotes (`MMA`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .design import Design
from .design_loop import COLUMNS, Callback, DesignLoop, Result, gray_fraction
from .evolution import Evolution
from .gradient_method import ExactAdjoint, GradientMethod
from .level_set_evolution import LevelSetEvolution
from .levelset import LevelSet
from .mma import MMA
from .sensitivity import Problem

__all__ = ["COLUMNS", "Optimizer", "Result", "gray_fraction", "optimize"]

Array = NDArray[np.float64]
AnyDesign = LevelSet | Design


class Optimizer(Protocol):
    """Updates designs, by the services of a `DesignLoop`."""

    def run(
        self,
        loop: DesignLoop,
        designs: Mapping[str, Any],
        start: Mapping[str, Array],
        volume: Mapping[str, float],
    ) -> Result:
        """Return the last design that was kept.

        Args:
            loop: evaluates and records.
            designs: by name of the body.
            start: variables by name of the body.
            volume: upper bound of the filled share by name of the body.
        """
        ...


def optimize(
    problem: Problem,
    design: AnyDesign | Mapping[str, AnyDesign],
    start: ArrayLike | Mapping[str, ArrayLike],
    *,
    optimizer: Optimizer | None = None,
    volume: float | Mapping[str, float] = 0.5,
    gradient: GradientMethod | None = None,
    iterations: int = 100,
    output: str | Path | None = None,
    resume: bool = False,
    progress: bool = True,
    callback: Callback | None = None,
    evolution: Evolution | Mapping[str, Evolution] | None = None,
    widths: Sequence[float] | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    reinitialize_every: int | None = None,
) -> Result:
    """Design one or several bodies by the gradient of all their elements.

    Ctrl-C (or SIGTERM) ends the loop after the iteration at hand and returns the design so far; a
    second one interrupts at once. The history and the checkpoint are on the disk after every
    iteration. (mpirun itself kills its processes a second after Ctrl-C; call again with ``resume``
    to have the design, on any number of ranks.)

    Args:
        problem: what is minimised; its constraints hold too, if the optimiser takes any.
        design: on the domain of the problem's body, a `LevelSet` or a `DensityDesign`; with several
            flexible bodies a mapping from their names to one each.
        start: variables of the start design, with several bodies by name: coefficients of the level
            set, shape (knots,), for example from `LevelSet.with_holes`, or those of
            `DensityDesign.even`. It is shrunk until the volume bound holds. Where that makes a
            level set fall apart, the loop warns and begins with an even density.
        optimizer: `LevelSetEvolution` or `MMA`; by default the former for level sets and the latter
            for densities.
        volume: upper bound of the filled share of the body, in (0, 1]; for several bodies one
            number for each, or a mapping by name.
        gradient: how derivatives are found; by default `ExactAdjoint`. The report of each goes
            into the history.
        iterations: steps at most.
        output: folder for ``history.csv`` and ``checkpoint``; None writes nothing.
        resume: go on from the checkpoint in ``output``, if there is one.
        progress: show a progress bar on rank 0.
        callback: called after each iteration with its number, the density of this rank's cells
            (with several bodies by name) and the evaluation of the design that is kept.
        evolution: of `LevelSetEvolution`, where no optimizer is given.
        widths: of `LevelSetEvolution`, where no optimizer is given.
        step: of `LevelSetEvolution`, where no optimizer is given.
        tolerance: of `LevelSetEvolution` or `MMA`, where no optimizer is given.
        reinitialize_every: of `LevelSetEvolution`, where no optimizer is given.

    Returns:
        The last design that was kept, on every rank.

    Raises:
        ValueError: on every rank, if the arguments do not fit each other.
        SimulationError: on every rank, if not even the motion of the start can be computed.
        CheckpointError: on every rank, if the checkpoint is damaged or of another problem.
        OSError: on every rank, if a file cannot be written.
    """
    if iterations < 0:
        raise ValueError(f"optimize: iterations = {iterations} must be positive and finite")
    designs = _by_body(problem, design)
    options: dict[str, Any] = {
        name: value
        for name, value in (
            ("evolution", evolution),
            ("widths", widths),
            ("step", step),
            ("tolerance", tolerance),
            ("reinitialize_every", reinitialize_every),
        )
        if value is not None
    }
    if optimizer is None:
        level_sets = all(isinstance(part, LevelSet) for part in designs.values())
        if not level_sets and set(options) - {"tolerance"}:
            raise ValueError(
                f"optimize: {sorted(set(options) - {'tolerance'})} are of LevelSetEvolution, which "
                "moves level sets only"
            )
        optimizer = LevelSetEvolution(**options) if level_sets else MMA(**options)
    elif options:
        raise ValueError(
            f"optimize: give {sorted(options)} to the optimizer, {type(optimizer).__name__}(...)"
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
    )
    starts = start if isinstance(start, Mapping) else dict.fromkeys(designs, start)
    bounds = volume if isinstance(volume, Mapping) else dict.fromkeys(designs, volume)
    for what, given in (("start", starts), ("volume", bounds)):
        if set(given) != set(designs):
            raise ValueError(
                f"optimize: {what} is given for {sorted(given)}, and the designs are of "
                f"{sorted(designs)}"
            )
    return optimizer.run(
        loop,
        designs,
        {name: np.asarray(starts[name], dtype=np.float64) for name in designs},
        {name: float(bounds[name]) for name in designs},
    )


def _by_body(problem: Problem, design: AnyDesign | Mapping[str, AnyDesign]) -> dict[str, AnyDesign]:
    """Return the designs in the order of the problem's bodies."""
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
        if part.domain is not problem.flexible[name].domain:
            kind = "level set" if isinstance(part, LevelSet) else "design"
            raise ValueError(f"optimize: the {kind} is not on the domain of the problem's body")
    return found
