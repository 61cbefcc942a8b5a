# SPDX-License-Identifier: MIT
"""The design loop: level set, exact gradient, explicit steps, history, checkpoints.

    min over alpha of psi(x(alpha))   such that   volume(x(alpha)) <= bound,

with x(alpha) the fill fraction of a level set. Each iteration makes one explicit step
(`dolfinx_ffr.evolution`) and keeps it if psi falls; otherwise the next step is half as long.
The smoothed Heaviside function starts wide, so that derivatives reach over an element, and narrows
in stages, so that the final design is nearly solid and void.
"""

from __future__ import annotations

import signal
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from .domain import Domain
from .dynamics import SimulationError
from .evolution import Evolution
from .gradient_method import ExactAdjoint, GradientErrors, GradientMethod, GradientReport
from .io import CheckpointError, HistoryFile, load_checkpoint, save_checkpoint
from .levelset import LevelSet
from .sensitivity import Evaluation, Problem

__all__ = ["Result", "gray_fraction", "optimize"]

Array = NDArray[np.float64]

#: columns of the history, one row an iteration
COLUMNS = [
    "iteration",  # number, 0 is the start
    "psi",  # objective of the design that is kept
    "volume",  # filled share of the body
    "frequency",  # first fixed-interface frequency [Hz]
    "gray",  # share of the body's area between void and solid
    "accepted",  # 1 if the step was kept
    "step",  # size of the step in spacings
    "multiplier",  # of the volume bound
    "width",  # of the smoothed Heaviside function [m]
    "outer_gap",  # relative gap of eigenvalues beyond the last mode
    "solver_iterations",  # of the last pullback
    "gradient_elements",  # elements with exact derivatives
    "gradient_estimate",  # estimated relative error of the gradient
    "gradient_error",  # true relative error of the gradient, where it was measured
    "gradient_cosine",  # of the angle to the exact gradient
    "gradient_worst",  # largest error of an element relative to the largest derivative
    "band_error",  # the same three near the active boundary
    "band_cosine",
    "band_worst",
    "seconds",  # since the start
]

#: factors of the step's size after one that was kept and one that was not
GROW, SHRINK = 1.3, 0.5
#: a step shorter than this share of a spacing means that there is no descent left
SHORTEST = 1e-3
#: iterations over which convergence is judged
WINDOW = 5
#: relative difference from which on a resumed psi counts as another problem's; the number of ranks
#: and the release of DOLFINx change less
SAME = 1e-6
#: a design this many times softer than what it is compared with is in pieces: its gradient tells of
#: the void that holds it together, and leads nowhere
APART = 1e3


def gray_fraction(domain: Domain, x: Array, low: float = 0.1, high: float = 0.9) -> float:
    """Return the share of the body's area whose density is neither void nor solid.

    Args:
        domain: the body.
        x: density of this rank's cells, shape (cells,).
        low: densities up to this one count as void.
        high: densities from this one on count as solid.
    """
    gray = (x > low) & (x < high)
    return domain.sum(domain.cell_volumes * gray) / domain.area


_UNKNOWN = GradientErrors(float("nan"), float("nan"), float("nan"))


@dataclass(frozen=True)
class Result:
    """A design and how it came about."""

    x: Array  #: density of this rank's cells, shape (cells,)
    coefficients: Array  #: of the level set, shape (knots,), the same on every rank
    evaluation: Evaluation = field(repr=False)  #: psi, gradient and motion of the design
    history: dict[str, Array] = field(repr=False)  #: columns over the iterations
    #: why the loop ended: "converged", "iterations" (none were left), "interrupted", or "stalled"
    #: (the design would fall apart with a narrower Heaviside function)
    reason: str

    @property
    def psi(self) -> float:
        """Objective of the design."""
        return self.evaluation.psi

    @property
    def iterations(self) -> int:
        """Number of steps tried."""
        return int(self.history["iteration"][-1])


@dataclass
class _State:
    """All that the next iteration depends on."""

    phi: Array
    iteration: int = 0
    stage: int = 0
    size: float = 1.0
    accepted: int = 0  # since the last re-initialisation
    since: int = 0  # iteration in which the stage began
    seconds: float = 0.0


def optimize(
    problem: Problem,
    levelset: LevelSet,
    start: Array,
    *,
    volume: float = 0.5,
    evolution: Evolution | None = None,
    gradient: GradientMethod | None = None,
    iterations: int = 100,
    widths: Sequence[float] = (1.0, 0.6, 0.35, 0.2),
    step: float = 1.0,
    tolerance: float = 1e-3,
    reinitialize_every: int = 5,
    output: str | Path | None = None,
    resume: bool = False,
    progress: bool = True,
    callback: Callable[[int, Array, Evaluation], None] | None = None,
) -> Result:
    """Design one body by a level set and the gradient of all its elements.

    Ctrl-C (or SIGTERM) ends the loop after the iteration at hand and returns the design so far; a
    second one interrupts at once. The history and the checkpoint are on the disk after every
    iteration. (mpirun itself kills its processes a second after Ctrl-C; call again with ``resume``
    to have the design, on any number of ranks.)

    Args:
        problem: has exactly one body with a density.
        levelset: on that body's domain.
        start: coefficients of the start design, shape (knots,), for example from
            `LevelSet.with_holes`; shrunk until the volume bound holds. Where that makes it fall
            apart, the loop warns and begins with an even density.
        volume: upper bound of the filled share of the body, in (0, 1].
        evolution: how the level set moves; by default an `Evolution` of ``levelset`` with that
            bound. One that is given brings its own bound.
        gradient: how derivatives are found; by default `ExactAdjoint`. The report of each goes
            into the history.
        iterations: steps at most.
        widths: half-widths of the smoothed Heaviside function in units of a mean element, one a
            stage. The next stage begins where one has converged, or has had its share of the
            iterations. Below a fifth of an element derivatives miss the quadrature points.
            ``levelset`` keeps the last width.
        step: largest change of phi in one iteration, in knot spacings (CFL number); above one the
            zero line overshoots thin struts.
        tolerance: a stage has converged when psi falls by less than this, relatively, over five
            iterations.
        reinitialize_every: steps kept between re-initialisations to the signed distance; 0 for
            none.
        output: folder for ``history.csv`` and ``checkpoint``; None writes nothing.
        resume: go on from the checkpoint in ``output``, if there is one.
        progress: show a progress bar on rank 0.
        callback: called after each iteration with its number, the density of this rank's cells and
            the evaluation of the design that is kept.

    Returns:
        The last design that was kept, on every rank.

    Raises:
        ValueError: on every rank, if the arguments do not fit each other.
        SimulationError: on every rank, if not even the motion of an even density can be computed.
        CheckpointError: on every rank, if the checkpoint is damaged or of another problem.
        OSError: on every rank, if a file cannot be written.
    """
    loop = _Loop(
        problem,
        levelset,
        evolution or Evolution(levelset, volume),
        iterations,
        widths,
        step,
        tolerance,
        reinitialize_every,
        gradient or ExactAdjoint(),
    )
    comm = levelset.domain.comm
    files = None if output is None else Path(output)
    rows: list[dict[str, float]] = []
    checkpoint = None if files is None else files / "checkpoint"
    if resume and checkpoint is not None and comm.bcast(checkpoint.is_file(), root=0):
        state, rows = loop.load(checkpoint)
        evaluation = loop.resume(state, rows, checkpoint)
    else:
        state, evaluation = loop.begin(start)
        rows = [loop.row(state, evaluation, accepted=True, multiplier=0.0)]
    history = None if files is None else HistoryFile(comm, files / "history.csv", COLUMNS, rows)
    began = perf_counter() - state.seconds
    reason = ""
    bar = tqdm(
        total=iterations,
        initial=state.iteration,
        disable=not progress or comm.rank > 0,
        unit="iteration",
        dynamic_ncols=True,
    )
    with bar, _interruptible(comm) as interrupted:
        while not reason:
            reason = loop.ended(state, rows)
            if not reason and interrupted():
                reason = "interrupted"
            if reason:
                break
            if loop.stage_ended(state, rows):
                narrowed = loop.next_stage(state, evaluation)
                if narrowed is None:
                    reason = "stalled"
                    break
                state, evaluation = narrowed
            state, evaluation, accepted, multiplier = loop.iterate(state, evaluation)
            state.seconds = comm.bcast(perf_counter() - began, root=0)
            row = loop.row(state, evaluation, accepted=accepted, multiplier=multiplier)
            rows.append(row)
            if history is not None and checkpoint is not None:
                history.append(row)
                loop.save(checkpoint, state, rows)
            bar.update()
            bar.set_postfix_str(
                f"psi {row['psi']:.4g}, volume {row['volume']:.3f}, "
                f"first frequency {row['frequency']:.4g} Hz"
                + (
                    f", gradient to {row['gradient_estimate']:.1%}"
                    if row["gradient_estimate"]
                    else ""
                )
            )
            if callback is not None:
                callback(state.iteration, loop.density(state), evaluation)
    coefficients = levelset.interpolate(state.phi)
    return Result(
        x=levelset.fill_fraction(coefficients),
        coefficients=coefficients,
        evaluation=evaluation,
        history={name: np.array([row[name] for row in rows]) for name in COLUMNS},
        reason=reason,
    )


class _Loop:
    """What an iteration does, apart from files, progress and signals."""

    def __init__(
        self,
        problem: Problem,
        levelset: LevelSet,
        evolution: Evolution,
        iterations: int,
        widths: Sequence[float],
        step: float,
        tolerance: float,
        reinitialize_every: int,
        gradient: GradientMethod,
    ) -> None:
        if len(problem.flexible) != 1:
            raise ValueError(
                f"optimize: designs one body, and the problem has {sorted(problem.flexible)}; give "
                "the others as VolumeIntegrals"
            )
        self.name, body = next(iter(problem.flexible.items()))
        if body.domain is not levelset.domain:
            raise ValueError("optimize: the level set is not on the domain of the problem's body")
        if evolution.levelset is not levelset:
            raise ValueError("optimize: the evolution moves another level set")
        for name, value, fits in (
            ("iterations", iterations, iterations >= 0),
            ("widths", tuple(widths), len(widths) > 0 and all(0.0 < w < np.inf for w in widths)),
            ("step", step, 0.0 < step < np.inf),
            ("tolerance", tolerance, 0.0 <= tolerance < np.inf),
            ("reinitialize_every", reinitialize_every, reinitialize_every >= 0),
        ):
            if not fits:
                raise ValueError(f"optimize: {name} = {value} must be positive and finite")
        self.problem, self.levelset, self.evolution = problem, levelset, evolution
        self.iterations, self.step, self.tolerance = iterations, step, tolerance
        self.widths = [levelset.element * w for w in widths]
        self.reinitialize_every = reinitialize_every
        self.gradient = gradient
        #: of the gradient that was computed last
        self.report: GradientReport | None = None

    # ------------------------------------------------------------------ evaluations

    def density(self, state: _State) -> Array:
        """Return the density of this rank's cells."""
        return self.levelset.fill_fraction(self.levelset.interpolate(state.phi))

    def evaluate(self, state: _State) -> Evaluation:
        """Return the value of a state."""
        self.levelset.width = self.widths[state.stage]
        return self.problem.value(self.density(state))

    def differentiate(self, evaluation: Evaluation, state: _State) -> Evaluation:
        """Return the evaluation of a state with its gradient."""

        def distance(name: str) -> Array:
            return self.levelset.boundary_distance(self.levelset.interpolate(state.phi))

        found, reports = self.gradient(self.problem, evaluation, distance, state.iteration)
        self.report = reports[self.name]
        return found

    def begin(self, start: Array) -> tuple[_State, Evaluation]:
        """Return the first state with its evaluation."""
        self.levelset.width = self.widths[0]
        given = _State(self.evolution.start(np.asarray(start, dtype=np.float64)), size=self.step)
        even = replace(given, phi=self.evolution.bounded(np.zeros(len(given.phi))))
        limit = APART * self.problem.value(self.density(even)).psi
        try:
            evaluation = self.evaluate(given)
            if evaluation.psi <= limit:
                return given, self.differentiate(evaluation, given)
        except SimulationError:  # so soft that it cannot move
            pass
        warnings.warn(
            "optimize: the start design has fallen apart; the loop begins with an even density "
            "instead. Take smaller or fewer holes, or raise the volume bound, to which the start "
            "design is shrunk",
            stacklevel=3,
        )
        return even, self.differentiate(self.evaluate(even), even)

    def resume(self, state: _State, rows: list[dict[str, float]], path: Path) -> Evaluation:
        """Return value and gradient of a state that was loaded from ``path``."""
        evaluation = self.evaluate(state)
        before = rows[-1]["psi"]
        if not abs(evaluation.psi - before) <= SAME * abs(before):
            raise CheckpointError(
                f"checkpoint {path} is of another problem: psi of its design was {before:.8g} and "
                f"is {evaluation.psi:.8g} here. Delete it to start anew, or write into another "
                "folder"
            )
        return self.differentiate(evaluation, state)

    def iterate(
        self, state: _State, evaluation: Evaluation
    ) -> tuple[_State, Evaluation, bool, float]:
        """Return the state after one step that was tried, its evaluation, and what became of it."""
        if evaluation.gradient is None:
            raise AssertionError("the design that is kept has its gradient")
        phi, multiplier = self.evolution.step(state.phi, evaluation.gradient[self.name], state.size)
        due = self.reinitialize_every and state.accepted + 1 >= self.reinitialize_every
        if due:
            phi = self.evolution.reinitialize(phi)
        trial = replace(state, phi=phi, iteration=state.iteration + 1)
        try:
            found = self.problem.value(self.density(trial))
        except SimulationError:  # so soft that it cannot move: as bad as can be
            found = None
        if found is not None and found.psi < evaluation.psi:
            trial.size = min(GROW * state.size, self.step)
            trial.accepted = 0 if due else state.accepted + 1
            return trial, self.differentiate(found, trial), True, multiplier
        kept = replace(state, iteration=state.iteration + 1, size=SHRINK * state.size)
        if due:
            kept.accepted = 0  # the next trial does without
        return kept, evaluation, False, multiplier

    # ------------------------------------------------------------------ stages

    def stage_ended(self, state: _State, rows: list[dict[str, float]]) -> bool:
        """Return whether a narrower Heaviside function is due."""
        if state.stage + 1 >= len(self.widths):
            return False
        share = (state.stage + 1) * self.iterations / len(self.widths)
        return state.iteration >= share or self._converged(state, rows)

    def next_stage(self, state: _State, evaluation: Evaluation) -> tuple[_State, Evaluation] | None:
        """Return the state at the beginning of the next stage; None if it falls apart there."""
        self.levelset.width = self.widths[state.stage + 1]
        narrowed = replace(
            state,
            phi=self.evolution.bounded(state.phi),
            stage=state.stage + 1,
            since=state.iteration,
            size=max(state.size, 0.3 * self.step),
        )
        try:
            found = self.evaluate(narrowed)
            if found.psi <= APART * evaluation.psi:
                return narrowed, self.differentiate(found, narrowed)
        except SimulationError:  # so soft that it cannot move
            pass
        self.levelset.width = self.widths[state.stage]
        return None

    def ended(self, state: _State, rows: list[dict[str, float]]) -> str:
        """Return why the loop ends here, or nothing."""
        if state.stage + 1 == len(self.widths) and self._converged(state, rows):
            return "converged"
        return "iterations" if state.iteration >= self.iterations else ""

    def _converged(self, state: _State, rows: list[dict[str, float]]) -> bool:
        if state.size < SHORTEST:
            return True
        # the row in which a stage began still holds the value before it was narrowed
        if state.iteration - state.since <= WINDOW:
            return False
        before, now = rows[-1 - WINDOW]["psi"], rows[-1]["psi"]
        # a halved step may well bring a descent that the longer one missed
        return before - now < self.tolerance * before and rows[-1]["accepted"] > 0

    # ------------------------------------------------------------------ records

    def row(
        self, state: _State, evaluation: Evaluation, *, accepted: bool, multiplier: float
    ) -> dict[str, float]:
        """Return the history's row of a state."""
        x = self.density(state)
        frequencies = evaluation.frequencies[self.name]
        report = self.report
        if report is None:
            raise AssertionError("the design that is kept has its gradient")
        true, band = report.errors or _UNKNOWN, report.band_errors or _UNKNOWN
        return {
            "iteration": state.iteration,
            "psi": evaluation.psi,
            "volume": evaluation.volume[self.name],
            "frequency": float(frequencies[0]) if len(frequencies) else float("nan"),
            "gray": gray_fraction(self.levelset.domain, x),
            "accepted": int(accepted),
            "step": state.size,
            "multiplier": multiplier,
            "width": self.levelset.width,
            "outer_gap": evaluation.outer_gap[self.name],
            "solver_iterations": evaluation.solver_iterations.get(self.name, 0),
            "gradient_elements": report.elements,
            "gradient_estimate": report.estimate,
            "gradient_error": true.l2,
            "gradient_cosine": true.cosine,
            "gradient_worst": true.worst,
            "band_error": band.l2,
            "band_cosine": band.cosine,
            "band_worst": band.worst,
            "seconds": state.seconds,
        }

    def save(self, path: Path, state: _State, rows: list[dict[str, float]]) -> None:
        """Write all that a later run needs to go on."""
        table = np.array([[row[name] for name in COLUMNS] for row in rows])
        save_checkpoint(
            self.levelset.domain.comm, path, {**vars(state), **self._identity(), "rows": table}
        )

    def _identity(self) -> dict[str, Any]:
        """Return what a checkpoint and the loop that reads it have in common."""
        return {
            "knots": self.levelset.knots,
            "kernel": repr(self.levelset.basis.kernel),
            "cells": self.levelset.domain.n_cells_global,
            "widths": self.widths,
            "volume": self.evolution.bisection.bound,
            "columns": len(COLUMNS),
        }

    def load(self, path: Path) -> tuple[_State, list[dict[str, float]]]:
        """Return the state and the history of an earlier run."""
        data = load_checkpoint(self.levelset.domain.comm, path)
        for key, value in self._identity().items():
            if key not in data or not np.array_equal(data[key], value):
                raise CheckpointError(
                    f"checkpoint {path} is of another problem: it differs in {key!r}. Delete it to "
                    "start anew, or write into another folder"
                )
        names = _State.__dataclass_fields__
        fields: dict[str, Any] = {k: data[k] if k == "phi" else data[k].item() for k in names}
        state = _State(**fields)
        rows = [dict(zip(COLUMNS, map(float, values), strict=True)) for values in data["rows"]]
        return state, rows


@contextmanager
def _interruptible(comm: MPI.Comm) -> Iterator[Callable[[], bool]]:
    """Give a function that tells, alike on every rank, whether the user wants to stop."""
    asked = threading.Event()
    previous: dict[signal.Signals, Any] = {}

    def handle(number: int, frame: Any) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            previous[number] = signal.signal(number, handle)
    try:
        yield lambda: bool(comm.allreduce(asked.is_set(), MPI.LOR))
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
