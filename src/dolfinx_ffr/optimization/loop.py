# SPDX-License-Identifier: MIT
"""What every design loop needs, whatever updates the design: history, checkpoints, interruption.

An optimiser (`LevelSetEvolution`, `MMA`) decides which densities are tried next. The `DesignLoop`
evaluates them, writes a row of the history for each, keeps a checkpoint from which a killed run
goes on, shows the progress, calls back, and says when the user wants to stop.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ..design import Design
from ..fem import Domain
from ..gradients import Distance, GradientErrors, GradientMethod, GradientReport
from ..io import CheckpointError, load_checkpoint, save_checkpoint, write_history
from ..parallel import check_alike, on_every_rank, on_rank_0, same
from ..problem import Evaluation, Problem
from .enough_modes import EVERY, with_enough_modes
from .result import DesignWarning, Result, gray_fraction, of_problem
from .running import interruptible, warnings_above

__all__ = [
    "COLUMNS",
    "GRADIENT_COLUMNS",
    "DesignLoop",
    "Optimizer",
]

Array = NDArray[np.float64]
Row = dict[str, float]
Callback = Callable[[int, Any, Evaluation], None]

#: Columns of the history, one row an iteration; of several bodies the worst or the sum. They tell
#: the design as it is analysed, a level set near the end of a run a little within its boundary.
COLUMNS = [
    "iteration",  # number, 0 is the start
    "psi",  # objective of the design that is kept
    "volume",  # filled share of the bodies
    "frequency",  # first fixed-interface frequency [Hz]
    "gray",  # share of the bodies' area between void and solid
    "accepted",  # 1 if the step was kept
    "step",  # size of the step (level set: spacings; MMA: largest change, share of the bounds)
    "multiplier",  # of the volume bound
    "sharpness",  # steepness of the projection from void to solid: 1 is open, 32 is crisp
    "merit",  # what is minimised: log psi and the penalty of sizes (explicit steps: psi)
    "modes",  # normal modes of all bodies together
    "mode_error",  # estimated relative error of psi by the modes left out, when last estimated
    "outer_gap",  # relative gap of eigenvalues beyond the last mode
    "solver_iterations",  # of the last pullback
    "seconds",  # since the start
]
#: Columns that approximate gradients add
GRADIENT_COLUMNS = [
    "gradient_elements",  # elements with exact derivatives
    "gradient_estimate",  # estimated relative error of the gradient
    "gradient_error",  # true relative error of the gradient, where it was measured
    "gradient_cosine",  # of the angle to the exact gradient
    "gradient_worst",  # largest error of an element relative to the largest derivative
    "band_error",  # the same three near the active boundary
    "band_cosine",
    "band_worst",
]
#: Columns that each of several bodies has of its own, "volume of rod"
OF_BODY = ["volume", "frequency", "gray"]

#: Columns that each of several motions has of its own, "psi of fast"
OF_MOTION = ["psi"]

#: Relative difference from which on a resumed psi counts as another problem's; the number of ranks
#: and the release of DOLFINx change less
SAME = 1e-6
#: Constraints hold to this, relative to their bounds
FEASIBLE = 1e-8
#: Steepness from which on the densities of a level set are shares of cut elements
CRISP = 16.0
#: Share of a body's area between void and solid from which on a design is no part yet
GRAY = 0.1
_UNKNOWN = GradientErrors(float("nan"), float("nan"), float("nan"))


class DesignLoop:
    """Evaluations, history, checkpoint, progress and interruption of one run.

    Args:
        problem: What is minimised.
        domains: Of the designed bodies by name.
        gradient: How derivatives are found.
        iterations: Steps at most.
        output: Folder for ``history.csv`` and ``checkpoint``; None writes nothing.
        resume: Go on from the checkpoint in ``output``; a `DesignWarning` says if there is none.
        progress: Show a progress bar on rank 0.
        callback: Called after each iteration with its number, densities and evaluation.
        mode_tolerance: Relative error of psi by the modes that a body leaves out, above which it
            gets more; None leaves the modes as they are.
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
        mode_tolerance: float | None = None,
    ) -> None:
        #: With as many modes as the design needed last
        self.problem = problem
        self._mode_tolerance = mode_tolerance
        self._first_modes = {name: body.modes for name, body in problem.flexible.items()}
        self._calibrates = False
        self._mode_error = float("nan")
        self.domains = dict(domains)
        self.gradient = gradient
        self.iterations = iterations
        self.comm: MPI.Comm = next(iter(self.domains.values())).comm
        self.rows: list[Row] = []
        #: Iterations of a stage at most, see `plan`
        self.stage_iterations = float("nan")
        self._columns: list[str] = []
        self._reports: dict[str, GradientReport] = {}
        self._output, self._resume = output, resume
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
        """Show the progress, catch signals, and warn of each limit once within this context."""
        with self._bar, warnings_above(self._bar), interruptible(self.comm) as self._interrupted:
            yield

    def interrupted(self) -> bool:
        """Whether the user wants to stop, alike on every rank."""
        return self._interrupted()

    # ------------------------------------------------------------------ evaluations

    def value(self, densities: Mapping[str, Array]) -> Evaluation:
        """Objective and constraints.

        Args:
            densities: Of this rank's cells by body, shape (cells,).

        Raises:
            SimulationError: On every rank, if the motion cannot be computed.
        """
        return self.problem.value(of_problem(densities))

    def with_modes(
        self, evaluation: Evaluation, densities: Mapping[str, Array], iteration: int
    ) -> Evaluation:
        """The evaluation of a design that is kept, with as many modes as it needs.

        Args:
            evaluation: What `value` returned.
            densities: Of this rank's cells by body, shape (cells,).
            iteration: Number of the iteration; every fifth one is looked at.
        """
        if self._mode_tolerance is None or iteration % EVERY:
            return evaluation
        self.problem, evaluation, errors = with_enough_modes(
            self.problem, densities, evaluation, self._mode_tolerance, self._first_modes
        )
        self._mode_error = max(errors.values())
        return evaluation

    def calibrated(self, evaluation: Evaluation) -> Evaluation:
        """The evaluation of a design that is kept, with objectives corrected there.

        `PeakStress` then is the largest stress, and the next designs are evaluated with its scale.
        Once done for one design it must be done for all that are kept.

        Args:
            evaluation: What `value` returned.
        """
        self._calibrates = True
        self.problem, evaluation = self.problem.calibrated(evaluation)
        return evaluation

    def differentiate(
        self, evaluation: Evaluation, distance: Distance, iteration: int
    ) -> Evaluation:
        """An evaluation with its gradient, whose report goes into the history.

        Args:
            evaluation: What `value` returned, at any time.
            distance: From the active boundary, by name of the body, see `GradientMethod`.
            iteration: Number of the iteration.
        """
        found, self._reports = self.gradient(self.problem, evaluation, distance, iteration)
        return found

    # ------------------------------------------------------------------ files

    def earlier(self, identity: Mapping[str, Any]) -> dict[str, Any] | None:
        """The state of the run that is to be resumed; None if there is none.

        Args:
            identity: What a checkpoint and the run that reads it must have in common.

        Raises:
            ValueError: On every rank, if what the ranks identify differs.
            CheckpointError: On every rank, if the checkpoint is damaged or of another problem.
        """
        check_alike(self.comm, "optimize", identity)
        self._identity = dict(identity)
        if len(self.problem.motions) > 1:
            self._identity["motions"] = f"{list(self.problem.motions)} by {self.problem.combine!r}"
        path = self._checkpoint
        if path is None or not self._resume:
            return None
        if not on_rank_0(self.comm, path.is_file):
            warnings.warn(
                f"optimize: there is no checkpoint {path} to go on from: the run begins anew",
                DesignWarning,
                stacklevel=4,
            )
            return None
        data = load_checkpoint(self.comm, path)
        for key, value in self._identity.items():
            if key not in data or not same(data[key], value):
                raise self._other_problem(f"it differs in {key!r}")
        self.stage_iterations = float(data.get("stage_iterations", np.nan))
        modes = dict(zip(self.problem.flexible, map(int, data["modes"]), strict=True))
        if not same(self._modes, data["modes"]):
            self.problem = self.problem.with_modes(modes)
        self._mode_error = float(data["mode_error"])
        self._columns = [str(name) for name in data["columns"]]
        self.rows = [dict(zip(self._columns, map(float, row), strict=True)) for row in data["rows"]]
        return data

    def plan(self, stages: int, each: int | None) -> None:
        """Share out the iterations among the stages, where an earlier run has not done so.

        So the stages of a run end alike, however often it is interrupted and resumed, and with
        however many iterations.

        Args:
            stages: Their number.
            each: Iterations of a stage at most; None shares out those of the run.
        """
        if math.isnan(self.stage_iterations):
            self.stage_iterations = self.iterations / stages if each is None else float(each)

    def resumed(self, evaluation: Evaluation) -> None:
        """Check that a design evaluates as it did in the earlier run, and go on with its history.

        Args:
            evaluation: Of the design that was kept last.

        Raises:
            CheckpointError: On every rank, if it does not.
        """
        before = self.rows[-1]["psi"]
        found = self._columns
        self._columns = self._all_columns(evaluation)
        names = [set(columns) - set(GRADIENT_COLUMNS) for columns in (found, self._columns)]
        if names[0] != names[1]:
            raise self._other_problem("it differs in the names of bodies, motions or constraints")
        if not abs(evaluation.psi - before) <= SAME * abs(before):
            raise self._other_problem(
                f"psi of its design was {before:.8g} and is {evaluation.psi:.8g} here"
            )
        # the earlier run may have approximated its gradient, or this one may begin to do so
        self._columns += [name for name in found if name not in self._columns]
        self.rows = [{n: row.get(n, float("nan")) for n in self._columns} for row in self.rows]
        self._began = perf_counter() - self.rows[-1]["seconds"]
        self._bar.update(int(self.rows[-1]["iteration"]))
        self._write_history()

    def _other_problem(self, why: str) -> CheckpointError:
        return CheckpointError(
            f"checkpoint {self._checkpoint} is of another problem: {why}. Delete it to start "
            "anew, or write into another folder"
        )

    @property
    def _modes(self) -> list[int]:
        """Normal modes of each body."""
        return [body.modes for body in self.problem.flexible.values()]

    @property
    def _checkpoint(self) -> Path | None:
        return None if self._output is None else self._output / "checkpoint"

    def _write_history(self) -> None:
        if self._output is not None:
            write_history(self.comm, self._output / "history.csv", self._columns, self.rows)

    # ------------------------------------------------------------------ records

    def record(
        self,
        iteration: int,
        densities: Mapping[str, Array],
        evaluation: Evaluation,
        *,
        accepted: bool,
        step: float,
        sharpness: float,
        merit: float,
        multiplier: float = float("nan"),
        state: Mapping[str, Any] | None = None,
    ) -> None:
        """Add an iteration to history, checkpoint and progress, and call back.

        Args:
            iteration: Its number; 0 is the start, from which the clock runs.
            densities: Of the design that is kept, this rank's cells by body.
            evaluation: Of the design that is kept.
            accepted: Whether it is the one that was tried.
            step: Size of the step.
            sharpness: Steepness of the projection.
            merit: Of the design that is kept.
            multiplier: Of the volume bound.
            state: What a later run needs to go on; None writes no checkpoint.
        """
        if iteration == 0:
            self._began = perf_counter()
        if not self._columns:
            self._columns = self._all_columns(evaluation)
        found = {
            **self._row(densities, evaluation),
            "iteration": iteration,
            "accepted": int(accepted),
            "step": step,
            "sharpness": sharpness,
            "merit": merit,
            "multiplier": multiplier,
            "seconds": self.comm.bcast(perf_counter() - self._began if iteration else 0.0, root=0),
        }
        row = {name: found[name] for name in self._columns}
        self.rows.append(row)
        self._write_history()
        path = self._checkpoint
        if path is not None and state is not None:
            table = np.array([[row[name] for name in self._columns] for row in self.rows])
            save_checkpoint(
                self.comm,
                path,
                {
                    **state,
                    **self._identity,
                    "stage_iterations": self.stage_iterations,
                    "modes": self._modes,
                    "mode_error": self._mode_error,
                    "columns": self._columns,
                    "rows": table,
                },
            )
        if iteration == 0:
            return
        self._bar.update()
        self._bar.set_postfix_str(
            f"psi {row['psi']:.4g}, volume {row['volume']:.3f}, "
            f"first frequency (interfaces held) {row['frequency']:.4g} Hz"
            + (f", gradient to {error:.1%}" if (error := found["gradient_estimate"]) else "")
        )
        x = dict(densities)
        with on_every_rank(self.comm, "the callback of a design loop"):
            if self._callback is not None:
                self._callback(iteration, of_problem(x), evaluation)

    def _all_columns(self, evaluation: Evaluation) -> list[str]:
        several = list(self.domains) if len(self.domains) > 1 else []
        motions = list(evaluation.motions) if len(evaluation.motions) > 1 else []
        return [
            *COLUMNS,
            *([] if self.gradient.exact else GRADIENT_COLUMNS),
            *(f"{column} of {name}" for name in several for column in OF_BODY),
            *(f"{column} of {name}" for name in motions for column in OF_MOTION),
            *(f"constraint {label}" for label in evaluation.constraints),
        ]

    def _row(self, densities: Mapping[str, Array], evaluation: Evaluation) -> Row:
        """What a design's evaluation says, and the report of the last gradient."""
        area = {name: domain.area for name, domain in self.domains.items()}
        gray = {
            name: gray_fraction(domain, densities[name]) for name, domain in self.domains.items()
        }
        held = evaluation.fixed_interface_frequencies
        first = {
            name: float(held[name][0]) if len(held[name]) else float("nan") for name in self.domains
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
            "modes": sum(self._modes),
            "mode_error": self._mode_error,
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
        if len(evaluation.motions) > 1:
            for name, motion in evaluation.motions.items():
                row[f"psi of {name}"] = motion.psi
        for label, constraint in evaluation.constraints.items():
            row[f"constraint {label}"] = constraint.value
        return row

    def result(
        self,
        designs: Mapping[str, Design],
        variables: Mapping[str, Array],
        evaluation: Evaluation,
        reason: str,
        volume: Mapping[str, float] | None = None,
    ) -> Result:
        """The design that was kept last, with the history.

        A crisp level set is evaluated once more with the law of cut elements, which is that of the
        part its boundary encloses. A `DesignWarning` says which constraints it violates, and if
        more than a tenth of a body is gray.

        Args:
            designs: By body, as sharp as in the last stage.
            variables: By body.
            evaluation: Of the design.
            reason: Why the loop ended.
            volume: Upper bounds of the filled shares by body, if there are any.
        """
        densities = {name: design.density(variables[name]) for name, design in designs.items()}
        cut = {
            name: self.problem.flexible[name].with_cut_elements()
            for name, design in designs.items()
            if design.fills and design.sharpness >= CRISP
        }
        problem, told = self.problem, evaluation
        if any(body is not problem.flexible[name] for name, body in cut.items()):
            problem = problem.with_bodies(cut)
            told = problem.value(of_problem(densities))
        errors: dict[str, float] = {}
        if self._mode_tolerance is not None:
            problem, told, errors = with_enough_modes(
                problem, densities, told, self._mode_tolerance, self._first_modes
            )
        if self._calibrates:
            problem, told = problem.calibrated(told)
        over = {
            f"volume of {name}": told.volume[name] / bound - 1.0
            for name, bound in (volume or {}).items()
        }
        over |= {name: found.value for name, found in told.constraints.items()}
        # what is not a number is no value below a bound
        violations = {name: value for name, value in over.items() if not value <= FEASIBLE}
        if violations:
            reason = "interrupted" if reason == "interrupted" else "infeasible"
            said = ", ".join(f"{name!r} by {value:.3%}" for name, value in violations.items())
            warnings.warn(
                f"optimize: the design violates {said} of the bound, after "
                f"{int(self.rows[-1]['iteration'])} iterations ({reason}): relax the bound, give "
                "more volume or more iterations",
                DesignWarning,
                stacklevel=4,
            )
        history = {name: np.array([row[name] for row in self.rows]) for name in self._columns}
        if reason != "interrupted":
            self._warn_of_gray(designs, densities)
        return Result(
            densities,
            dict(variables),
            told,
            history,
            reason,
            dict(designs),
            problem,
            violations,
            errors,
        )

    def _warn_of_gray(self, designs: Mapping[str, Design], densities: Mapping[str, Array]) -> None:
        """Say which bodies are no parts yet, and what helps."""
        for name, design in designs.items():
            gray = gray_fraction(design.domain, densities[name])
            # of a crisp level set that is what the boundary cuts
            crisp = design.fills and design.sharpness >= CRISP
            if gray > GRAY and not crisp:
                unfinished = design.sharpness < design.at(1.0).sharpness
                warnings.warn(
                    f"optimize: {100.0 * gray:.0f} % of {name!r} is gray, neither void nor solid, "
                    "and no part can be cut out of that: "
                    + (
                        "give more iterations, as the run ended before the design was sharp "
                        "(resume=True goes on from here)"
                        if unfinished
                        else "take smaller elements, or ask for larger minimum sizes"
                    ),
                    DesignWarning,
                    stacklevel=5,
                )


class Optimizer(Protocol):
    """Updates designs, by the services of a `DesignLoop`."""

    def run(
        self,
        loop: DesignLoop,
        designs: Mapping[str, Any],
        start: Mapping[str, Array],
        volume: Mapping[str, float],
    ) -> Result:
        """The last design that was kept.

        Args:
            loop: Evaluates and records.
            designs: By name of the body.
            start: Variables by name of the body.
            volume: Upper bound of the filled share by name of the body.

        Raises:
            ValueError: On every rank, if the parts do not fit each other.
            SimulationError: On every rank, if not even the motion of the start can be computed.
        """
        ...
