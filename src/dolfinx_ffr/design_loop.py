# SPDX-License-Identifier: MIT
"""What every design loop needs, whatever updates the design: history, checkpoints, interruption.

An optimiser (`LevelSetEvolution`, `MMA`) decides which densities are tried next. The `DesignLoop`
evaluates them, writes a row of the history for each, keeps a checkpoint from which a killed run
goes on, shows the progress, calls back, and says when the user wants to stop.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from .domain import Domain
from .gradient_method import Distance, GradientErrors, GradientMethod, GradientReport
from .io import CheckpointError, HistoryFile, load_checkpoint, save_checkpoint
from .sensitivity import Evaluation, Problem

__all__ = ["COLUMNS", "DesignLoop", "Result", "gray_fraction"]

Array = NDArray[np.float64]
Row = dict[str, float]
Callback = Callable[[int, Any, Evaluation], None]

#: columns of the history, one row an iteration; of several bodies the worst or the sum
COLUMNS = [
    "iteration",  # number, 0 is the start
    "psi",  # objective of the design that is kept
    "volume",  # filled share of the bodies
    "frequency",  # first fixed-interface frequency [Hz]
    "gray",  # share of the bodies' area between void and solid
    "accepted",  # 1 if the step was kept
    "step",  # size of the step (level set: spacings; MMA: largest change, share of the bounds)
    "multiplier",  # of the volume bound
    "width",  # of the smoothed Heaviside function (level set: [m]; density: 1 / beta)
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
#: columns that each of several bodies has of its own, "volume of rod"
OF_BODY = ["volume", "frequency", "gray"]

#: relative difference from which on a resumed psi counts as another problem's; the number of ranks
#: and the release of DOLFINx change less
SAME = 1e-6

_UNKNOWN = GradientErrors(float("nan"), float("nan"), float("nan"))


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


@dataclass(frozen=True)
class Result:
    """A design and how it came about."""

    densities: dict[str, Array]  #: of this rank's cells by body, shape (cells,)
    #: by body, the same on every rank: coefficients of a level set, shape (knots,), or design
    #: variables of a `DensityDesign`, shape (designed cells,)
    variables: dict[str, Array]
    evaluation: Evaluation = field(repr=False)  #: psi, gradient and motion of the design
    history: dict[str, Array] = field(repr=False)  #: columns over the iterations
    #: why the loop ended: "converged", "iterations" (none were left), "interrupted", or "stalled"
    #: (the design would fall apart with a narrower Heaviside function)
    reason: str

    @property
    def x(self) -> Array:
        """Density of this rank's cells, shape (cells,), where one body is designed."""
        return only(self.densities)

    @property
    def coefficients(self) -> Array:
        """Coefficients of the level set, shape (knots,), where one body is designed."""
        return only(self.variables)

    @property
    def psi(self) -> float:
        """Objective of the design."""
        return self.evaluation.psi

    @property
    def iterations(self) -> int:
        """Number of steps tried."""
        return int(self.history["iteration"][-1])


def only(by_name: Mapping[str, Any]) -> Any:
    """Return the value of a mapping with one name.

    Args:
        by_name: values by body.

    Raises:
        ValueError: if there are several.
    """
    if len(by_name) > 1:
        raise ValueError(
            f"several bodies are designed ({sorted(by_name)}): ask by name, for example "
            f"result.densities[{next(iter(by_name))!r}]"
        )
    return next(iter(by_name.values()))


class DesignLoop:
    """Evaluations, history, checkpoint, progress and interruption of one run.

    Args:
        problem: what is minimised.
        domains: of the designed bodies by name.
        gradient: how derivatives are found.
        iterations: steps at most.
        output: folder for ``history.csv`` and ``checkpoint``; None writes nothing.
        resume: go on from the checkpoint in ``output``, if there is one.
        progress: show a progress bar on rank 0.
        callback: called after each iteration with its number, densities and evaluation.
    """

    def __init__(
        self,
        problem: Problem,
        domains: Mapping[str, Domain],
        *,
        gradient: GradientMethod,
        iterations: int,
        output: Path | None = None,
        resume: bool = False,
        progress: bool = True,
        callback: Callback | None = None,
    ) -> None:
        self.problem = problem
        self.domains = dict(domains)
        self.gradient = gradient
        self.iterations = iterations
        self.comm: MPI.Comm = next(iter(self.domains.values())).comm
        self.rows: list[Row] = []
        self._columns: list[str] = []
        self._reports: dict[str, GradientReport] = {}
        self._output, self._resume = output, resume
        self._history: HistoryFile | None = None
        self._callback = callback
        self._interrupted: Callable[[], bool] = lambda: False
        self._began = perf_counter()
        self._bar = tqdm(
            total=iterations,
            disable=not progress or self.comm.rank > 0,
            unit="iteration",
            dynamic_ncols=True,
        )

    @contextmanager
    def running(self) -> Iterator[None]:
        """Show the progress and catch signals within this context."""
        with self._bar, _interruptible(self.comm) as self._interrupted:
            yield

    def interrupted(self) -> bool:
        """Return, alike on every rank, whether the user wants to stop."""
        return self._interrupted()

    # ------------------------------------------------------------------ evaluations

    def value(self, densities: Mapping[str, Array]) -> Evaluation:
        """Return objective and constraints.

        Args:
            densities: of this rank's cells by body, shape (cells,).

        Raises:
            SimulationError: on every rank, if the motion cannot be computed.
        """
        return self.problem.value(densities if len(densities) > 1 else only(densities))

    def differentiate(
        self, evaluation: Evaluation, distance: Distance, iteration: int
    ) -> Evaluation:
        """Return an evaluation with its gradient, whose report goes into the history.

        Args:
            evaluation: what `value` returned last.
            distance: from the active boundary, by name of the body, see `GradientMethod`.
            iteration: number of the iteration.
        """
        found, self._reports = self.gradient(self.problem, evaluation, distance, iteration)
        return found

    # ------------------------------------------------------------------ files

    def earlier(self, identity: Mapping[str, Any]) -> dict[str, Any] | None:
        """Return the state of the run that is to be resumed; None if there is none.

        Args:
            identity: what a checkpoint and the run that reads it must have in common.

        Raises:
            CheckpointError: on every rank, if the checkpoint is damaged or of another problem.
        """
        self._identity = dict(identity)
        path = self._checkpoint
        if path is None or not self._resume or not self.comm.bcast(path.is_file(), root=0):
            return None
        data = load_checkpoint(self.comm, path)
        for key, value in self._identity.items():
            if key not in data or not np.array_equal(data[key], value):
                raise self._other_problem(f"it differs in {key!r}")
        self._columns = [str(name) for name in data["columns"]]
        self.rows = [dict(zip(self._columns, map(float, row), strict=True)) for row in data["rows"]]
        return data

    def resumed(self, evaluation: Evaluation) -> None:
        """Check that a design evaluates as it did in the earlier run, and go on with its history.

        Args:
            evaluation: of the design that was kept last.

        Raises:
            CheckpointError: on every rank, if it does not.
        """
        before = self.rows[-1]["psi"]
        if self._columns != self._all_columns(evaluation):
            raise self._other_problem("it differs in the names of bodies or constraints")
        if not abs(evaluation.psi - before) <= SAME * abs(before):
            raise self._other_problem(
                f"psi of its design was {before:.8g} and is {evaluation.psi:.8g} here"
            )
        self._began = perf_counter() - self.rows[-1]["seconds"]
        self._bar.update(int(self.rows[-1]["iteration"]))
        self._open_history()

    def _other_problem(self, why: str) -> CheckpointError:
        return CheckpointError(
            f"checkpoint {self._checkpoint} is of another problem: {why}. Delete it to start "
            "anew, or write into another folder"
        )

    @property
    def _checkpoint(self) -> Path | None:
        return None if self._output is None else self._output / "checkpoint"

    def _open_history(self) -> None:
        if self._output is not None:
            self._history = HistoryFile(
                self.comm, self._output / "history.csv", self._columns, self.rows
            )

    # ------------------------------------------------------------------ records

    def record(
        self,
        iteration: int,
        densities: Mapping[str, Array],
        evaluation: Evaluation,
        *,
        accepted: bool,
        step: float,
        width: float,
        multiplier: float = float("nan"),
        state: Mapping[str, Any] | None = None,
    ) -> None:
        """Add an iteration to history, checkpoint and progress, and call back.

        Args:
            iteration: its number; 0 is the start, from which the clock runs.
            densities: of the design that is kept, this rank's cells by body.
            evaluation: of the design that is kept.
            accepted: whether it is the one that was tried.
            step: size of the step.
            width: of the smoothed Heaviside function.
            multiplier: of the volume bound.
            state: what a later run needs to go on; None writes no checkpoint.
        """
        if iteration == 0:
            self._began = perf_counter()
        if not self._columns:
            self._columns = self._all_columns(evaluation)
        row = {
            **self._row(densities, evaluation),
            "iteration": iteration,
            "accepted": int(accepted),
            "step": step,
            "width": width,
            "multiplier": multiplier,
            "seconds": self.comm.bcast(perf_counter() - self._began if iteration else 0.0, root=0),
        }
        self.rows.append(row)
        if self._history is None:
            self._open_history()
        else:
            self._history.append(row)
        path = self._checkpoint
        if path is not None and state is not None:
            table = np.array([[row[name] for name in self._columns] for row in self.rows])
            save_checkpoint(
                self.comm,
                path,
                {**state, **self._identity, "columns": self._columns, "rows": table},
            )
        if iteration == 0:
            return
        self._bar.update()
        self._bar.set_postfix_str(
            f"psi {row['psi']:.4g}, volume {row['volume']:.3f}, "
            f"first frequency {row['frequency']:.4g} Hz"
            + (f", gradient to {row['gradient_estimate']:.1%}" if row["gradient_estimate"] else "")
        )
        if self._callback is not None:
            x = dict(densities)
            self._callback(iteration, x if len(x) > 1 else only(x), evaluation)

    def _all_columns(self, evaluation: Evaluation) -> list[str]:
        several = list(self.domains) if len(self.domains) > 1 else []
        return [
            *COLUMNS,
            *(f"{column} of {name}" for name in several for column in OF_BODY),
            *(f"constraint {label}" for label in evaluation.constraints),
        ]

    def _row(self, densities: Mapping[str, Array], evaluation: Evaluation) -> Row:
        """Return what a design's evaluation says, and the report of the last gradient."""
        area = {name: domain.area for name, domain in self.domains.items()}
        gray = {
            name: gray_fraction(domain, densities[name]) for name, domain in self.domains.items()
        }
        first = {
            name: float(found[0]) if len(found := evaluation.frequencies[name]) else float("nan")
            for name in self.domains
        }
        total = sum(area.values())
        several = len(self.domains) > 1
        reports = list(self._reports.values())
        worst = max(reports, key=lambda report: report.estimate)
        true, band = worst.errors or _UNKNOWN, worst.band_errors or _UNKNOWN
        row = {
            "psi": evaluation.psi,
            "volume": sum(evaluation.volume[name] * area[name] for name in area) / total,
            "frequency": min(first.values()),
            "gray": sum(gray[name] * area[name] for name in area) / total,
            "outer_gap": min(evaluation.outer_gap[name] for name in area),
            "solver_iterations": sum(evaluation.solver_iterations.values()),
            "gradient_elements": sum(report.elements for report in reports),
            "gradient_estimate": worst.estimate,
            "gradient_error": true.l2,
            "gradient_cosine": true.cosine,
            "gradient_worst": true.worst,
            "band_error": band.l2,
            "band_cosine": band.cosine,
            "band_worst": band.worst,
        }
        if several:
            for name in area:
                row[f"volume of {name}"] = evaluation.volume[name]
                row[f"frequency of {name}"] = first[name]
                row[f"gray of {name}"] = gray[name]
        for label, constraint in evaluation.constraints.items():
            row[f"constraint {label}"] = constraint.value
        return row

    def result(
        self,
        densities: Mapping[str, Array],
        variables: Mapping[str, Array],
        evaluation: Evaluation,
        reason: str,
    ) -> Result:
        """Return the design that was kept last, with the history.

        Args:
            densities: of this rank's cells by body.
            variables: by body.
            evaluation: of the design.
            reason: why the loop ended.
        """
        history = {name: np.array([row[name] for row in self.rows]) for name in self._columns}
        return Result(dict(densities), dict(variables), evaluation, history, reason)


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
