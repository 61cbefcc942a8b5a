# SPDX-License-Identifier: MIT
"""The services of a design loop: evaluations, history, checkpoint, progress, interruption.

An optimiser (`LevelSetEvolution`, `MMA`) decides which design is tried next, by these services.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, ClassVar, Protocol

from mpi4py import MPI

import numpy as np

from .. import validation
from ..arrays import Array, Mask
from ..design import Design, Variables
from ..fem import Domain
from ..parallel import check_alike, nearly_equal, on_every_rank, on_rank_0
from ..problem import Evaluation, Problem
from .checkpoint import Checkpoint
from .enough_modes import (
    EVERY,
    chosen_methods,
    with_enough_modes,
    with_methods,
    with_steps_for,
)
from .history import History, Row
from .result import Result, gray_fraction, of_problem, ranks_of, warn
from .running import Run
from .signed_log import SignedLog, check_start
from .stepper import Optimizes, follow

Callback = Callable[[int, Any, Evaluation], None]
#: By name: designs, arrays of their variables or densities, bounds of volumes
Designs = Mapping[str, Any]
Arrays = Mapping[str, Array]
Bounds = Mapping[str, float]

#: Columns of the history, one row an iteration; of several bodies the worst or the sum, NaN where
#: no density is designed. The design is the analysed one, which is eroded near the end of a run.
COLUMNS = [
    "iteration",  # number, 0 is the start
    "psi",  # objective of the accepted design
    "volume",  # filled share of the bodies
    "frequency",  # first fixed-interface frequency [Hz]
    "gray",  # share of the bodies' area between void and solid
    "accepted",  # 1 if the step was accepted
    "step",  # size of the step (level set: spacings; MMA: largest change, share of the bounds)
    "multiplier",  # of the volume bound
    "sharpness",  # steepness of the projection from void to solid: 1 is gray, 32 is sharp
    "merit",  # the minimised number: log psi and the penalty of sizes (explicit steps: psi)
    "modes",  # number of normal modes of all bodies
    "mode_error",  # last estimate of the relative error of psi by the modes left out
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
    "band_error",  # these three errors near the active boundary
    "band_cosine",
    "band_worst",
]

#: Largest relative difference of psi when a run is resumed; the number of ranks and the release of
#: DOLFINx change less
SAME_PSI = 1e-6
#: Largest violation of a satisfied constraint, relative to its bound
FEASIBLE = 1e-8
#: Factor by which psi changes before chosen time steps are judged again
CHANGED = 2.0
#: Steepness from which on the densities of a level set are shares of cut elements
CUT_FROM = 16.0
#: Largest share of gray area of a body from which a part can be made
GRAY = 0.1
NAN = float("nan")
Distance = Callable[[str], Array | None]


@dataclass(frozen=True)
class GradientErrors:
    """Errors of an approximate gradient, relative to the exact one, over some elements.

    Attributes:
        l2: Euclidean norm of the difference, relative to that of the exact gradient.
        cosine: Cosine of the angle between both.
        worst: Largest difference of an element, relative to the largest exact value.
    """

    l2: float
    cosine: float
    worst: float


@dataclass(frozen=True, eq=False)
class GradientReport:
    """How the gradient of one body was computed, and how accurate it is.

    Attributes:
        elements: Number of elements with exact values, on all ranks.
        share: Their share of the designed elements.
        selected: Mask of these elements among the cells of this rank.
        estimate: Estimated relative error (Euclidean norm) over the designed elements; 0 for exact
            gradients.
        errors: True errors over the designed elements, where asked for.
        band_errors: True errors over the designed elements near the active boundary, where asked
            for.
        length: Length of the kernel [m].
        condition: Condition number of the interpolation.
    """

    elements: int
    share: float
    selected: Mask = field(repr=False)
    estimate: float = 0.0
    errors: GradientErrors | None = None
    band_errors: GradientErrors | None = None
    length: float = math.nan
    condition: float = math.nan


class GradientMethod(Protocol):
    """Adds the gradient to an evaluation; `dolfinx_ffr.paper` has two that are not exact."""

    exact: ClassVar[bool]  #: Whether there is no error to report

    def __call__(
        self, problem: Problem, evaluation: Evaluation, distance: Distance, iteration: int
    ) -> tuple[Evaluation, dict[str, GradientReport]]:
        """The ``evaluation`` of a ``problem`` with a gradient, and a report for each body.

        ``distance`` gives, by name of the body, the distance of the centroid of each cell of this
        rank from the active boundary, shape (cells,) [m], or None where there is no boundary.
        ``iteration`` is the number of the iteration.
        """
        ...


@dataclass(frozen=True)
class ExactAdjoint:
    """The exact gradient of `Problem.differentiate`."""

    exact: ClassVar[bool] = True

    def __call__(
        self, problem: Problem, evaluation: Evaluation, distance: Distance, iteration: int
    ) -> tuple[Evaluation, dict[str, GradientReport]]:
        """The evaluation with the exact gradient, see `GradientMethod`."""
        reports = {}
        for name, body in problem.flexible.items():
            design = body.domain.design_cells
            count = body.domain.comm.allreduce(int(np.count_nonzero(design)))
            reports[name] = GradientReport(count, 1.0, design)
        return problem.differentiate(evaluation), reports


@dataclass(frozen=True, eq=False)
class Iterate:
    """The accepted design of an optimiser after a step.

    Attributes:
        iteration: Number of the step; 0 is the start.
        x: The accepted design, by name as for `Problem.value`.
        evaluation: Its evaluation.
        accepted: Whether the step led to it, or was rejected.
        step: Size of the step.
        sharpness: Steepness of the projection.
        merit: The number that is minimised.
        multiplier: Multiplier of the volume bound.
        state: Numbers and arrays with which a later run continues; without them there is no
            checkpoint.
    """

    iteration: int
    x: Mapping[str, Array]
    evaluation: Evaluation
    accepted: bool
    step: float
    sharpness: float
    merit: float
    multiplier: float = NAN
    state: Mapping[str, Any] | None = None


class OptimizesDesigns(Optimizes, Protocol):
    """An optimiser of designs, which begins at a start or continues from a checkpoint."""

    def identity(self) -> dict[str, Any]:
        """The entries that a checkpoint and the run that reads it must have in common."""

    def begin(self, start: Arrays) -> Iterate:
        """The first iterate, from variables by body."""

    def load(self, data: Mapping[str, Any]) -> None:
        """Continue from the state in a checkpoint."""


class DesignLoop:
    """Evaluations, history, checkpoint, progress and interruption of one run.

    Its methods take a point x as `Problem.value` does, but always by name: densities of this rank's
    cells, shape (cells,), or variables of a design without a domain.

    Args:
        problem, gradient, iterations, output, resume, progress, callback, mode_tolerance: Arguments
            of `optimize`.
        domains: Domains of the bodies whose density is designed, by name.
        start: Variables of the start design if the user gives them, by name.
        followed: Whether steps of boundaries follow, which reduce violations of the design.
        webs: Thicknesses of webs as shares, by name.
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
        start: Mapping[str, Array] | None = None,
        mode_tolerance: float | None = None,
        followed: bool = False,
        webs: Mapping[str, float] | None = None,
    ) -> None:
        #: The problem with the number of modes that the last design needed
        self.problem = problem
        self.domains = dict(domains)
        self.webs = dict.fromkeys(domains, 0.0) | dict(webs or {})
        self.gradient = gradient
        self.iterations = iterations
        self.comm: MPI.Comm = ranks_of(problem)
        #: Largest number of iterations of a stage, see `plan`
        self.stage_iterations = NAN
        self._mode_tolerance, self._followed = mode_tolerance, followed
        self._first_modes = {name: body.modes for name, body in problem.flexible.items()}
        self._calibrates = False
        self._logarithm: SignedLog | None = None
        self._mode_error = self._psi_of_steps = NAN
        self._reports: dict[str, GradientReport] = {}
        self._other_start = False
        file = None if output is None else output / "history.csv"
        self.history = History(self.comm, file)
        path = None if output is None else output / "checkpoint"
        #: Of all phases of the run
        self.checkpoint = Checkpoint(self.comm, path, resume)
        self._start = np.concatenate([np.zeros(0), *map(np.ravel, (start or {}).values())])
        self._callback = callback
        #: Progress, and the user's wish to stop
        self.run = Run(self.comm, iterations, "iteration", progress)
        self._began = perf_counter()

    @property
    def rows(self) -> list[Row]:
        """Rows of the history."""
        return self.history.rows

    @contextmanager
    def running(self) -> Iterator[None]:
        """Show the progress, catch signals, and warn of each limit once within this context."""
        with self.run.running():
            yield

    def interrupted(self) -> bool:
        """Whether the user wants to stop, alike on every rank."""
        return bool(self.run.stopped())

    def value(self, x: Mapping[str, Array]) -> Evaluation:
        """Objective and constraints at ``x``; a SimulationError where it cannot move."""
        evaluation = self.problem.value(of_problem(x))
        psi = validation.number("optimize: psi of the problem", evaluation.psi)
        if self._logarithm is None:
            start = self.rows[0]["psi"] if self.rows else psi
            check_start("optimize", start)
            self._logarithm = SignedLog.around(start)
        return evaluation

    @property
    def logarithm(self) -> SignedLog:
        """The logarithm by which psi of this run is minimised, known after the first value."""
        assert self._logarithm is not None
        return self._logarithm

    def accurate(self, evaluation: Evaluation, x: Arrays, iteration: int) -> Evaluation:
        """The ``evaluation`` of an accepted ``x``, after adding time steps and modes if needed.

        Chosen steps are judged again if psi has changed by a factor of two since, modes at every
        fifth ``iteration``.
        """
        ratio = evaluation.psi / self._psi_of_steps
        if not 1.0 / CHANGED <= ratio <= CHANGED:
            self._psi_of_steps = evaluation.psi
            self.problem, evaluation = with_steps_for(self.problem, x, evaluation)
        if self._mode_tolerance is None or iteration % EVERY:
            return evaluation
        self.problem, evaluation, errors = with_enough_modes(
            self.problem, x, evaluation, self._mode_tolerance, self._first_modes
        )
        self._mode_error = max(errors.values(), default=NAN)
        return evaluation

    def calibrated(self, evaluation: Evaluation) -> Evaluation:
        """The ``evaluation`` of an accepted design, with objectives corrected there.

        `PeakStress` then is the largest stress, and the next designs are evaluated with its scale.
        It must be called for all accepted designs or for none.
        """
        self._calibrates = True
        self.problem, evaluation = self.problem.calibrated(evaluation)
        return evaluation

    def differentiate(
        self,
        evaluation: Evaluation,
        distance: Distance,
        iteration: int,
        problem: Problem | None = None,
    ) -> Evaluation:
        """The ``evaluation`` with its gradient, whose report goes into the history.

        Args:
            evaluation: Evaluation of the problem at an accepted design.
            distance: Distance from the active boundary, see `GradientMethod`.
            iteration: Number of the iteration.
            problem: The evaluated problem, if it is not the problem of the loop.
        """
        problem = problem or self.problem
        differentiated, self._reports = self.gradient(problem, evaluation, distance, iteration)
        gradients = {"psi": differentiated.gradient}
        for name, constraint in differentiated.constraints.items():
            gradients[f"constraint {name!r}"] = constraint.gradient
        for name, gradient in gradients.items():
            label = f"optimize: the gradient of {name}"
            by_body = validation.by_name(label, gradient, "numbers")  # type: ignore[arg-type]
            for body, domain in self.domains.items():
                validation.real_array(f"{label} by {body!r}", by_body.get(body), (domain.n_cells,))
        return differentiated

    def earlier(self, identity: Mapping[str, Any]) -> dict[str, Any] | None:
        """The state of the run that is to be resumed; None if there is none.

        A checkpoint and the run that reads it must have the ``identity`` in common, else it is a
        CheckpointError. A ValueError is raised if the identity differs between the ranks.
        """
        check_alike(self.comm, "optimize", identity)
        self._identity = dict(identity)
        if len(self.problem.load_cases) > 1:
            cases = list(self.problem.load_cases)
            self._identity["load_cases"] = f"{cases} by {self.problem.combine!r}"
        data = self.checkpoint.section("design") if self.checkpoint.read() else None
        if data is None:
            if self.checkpoint.resume and (path := self.checkpoint.path):
                warn(f"optimize: there is no checkpoint {path} to resume: the run begins anew")
            return None
        for key, value in self._identity.items():
            if key not in data or not nearly_equal(data[key], value):
                raise self.checkpoint.of_another_problem(f"it differs in {key!r}")
        self.stage_iterations = float(data.get("stage_iterations", np.nan))
        start = data.get("start", np.zeros(0))
        both_are_given = bool(self._start.size and start.size)
        self._other_start = both_are_given and not nearly_equal(start, self._start)
        self._start = start
        modes = dict(zip(self.problem.flexible, map(int, data["modes"]), strict=True))
        if not nearly_equal(self._modes, data["modes"]):
            self.problem = self.problem.with_modes(modes)
        self._mode_error = float(data["mode_error"])
        self.problem = with_methods(self.problem, data.get("steps", []))
        self.history.restore(data)
        return data

    def plan(self, stages: int, stage_iterations: int | None) -> None:
        """Divide the iterations among the stages, unless an earlier run has done so.

        So the stages end after the same iterations, however often a run is resumed. A stage has at
        most ``stage_iterations``; None divides the iterations of the run by the number of
        ``stages``.
        """
        if math.isnan(self.stage_iterations):
            shared = self.iterations / stages
            self.stage_iterations = shared if stage_iterations is None else float(stage_iterations)

    def resumed(self, evaluation: Evaluation) -> None:
        """Continue the history of an earlier run, whose last design has this ``evaluation``.

        A CheckpointError is raised if psi of the earlier run differs.
        """
        earlier_psi, earlier_columns = self.rows[-1]["psi"], self.history.columns
        columns = self._all_columns(evaluation)
        # the earlier run may have approximated its gradient, or this one may begin to do so
        if (set(earlier_columns) ^ set(columns)) - set(GRADIENT_COLUMNS):
            raise self.checkpoint.of_another_problem(
                "the names of its bodies, load cases or constraints differ"
            )
        if not abs(evaluation.psi - earlier_psi) <= SAME_PSI * abs(earlier_psi):
            raise self.checkpoint.of_another_problem(
                f"psi of its design was {earlier_psi:.8g}, and is {evaluation.psi:.8g} in this run"
            )
        columns += [name for name in earlier_columns if name not in columns]
        rows = [{name: row.get(name, NAN) for name in columns} for row in self.rows]
        self.history.columns, self.history.rows = columns, rows
        if self._other_start:
            warn(
                f"optimize: the run continues from the checkpoint {self.checkpoint.path} and "
                "ignores the start, which differs from the start of that run; to use it, leave "
                "resume out, or write into another folder"
            )
        self._began = perf_counter() - self.rows[-1]["seconds"]
        self.run.advance(int(self.rows[-1]["iteration"]))
        self.history.write()

    @property
    def _modes(self) -> list[int]:
        """Number of normal modes of each body."""
        return [body.modes for body in self.problem.flexible.values()]

    def follow(
        self,
        optimizer: OptimizesDesigns,
        start: Arrays,
        stages: int,
        stage_iterations: int | None,
    ) -> str:
        """Run an ``optimizer`` from its ``start``, or from a checkpoint; return why it ended.

        Each iterate is recorded. See `plan` for ``stages`` and ``stage_iterations``.
        """
        state = self.earlier(optimizer.identity())
        self.plan(stages, stage_iterations)
        if state is None:
            self.record(optimizer.begin(start))
        else:
            optimizer.load(state)
        return follow(
            optimizer,
            self.record,
            lambda: "interrupted" if self.interrupted() else "",
            lambda: self.rows[-1]["iteration"] < self.iterations,
        )

    def record(self, iterate: Iterate) -> None:
        """Add an iterate to history, checkpoint and progress, and call the user's callback.

        The time of a run is counted from its first iterate.
        """
        iteration, x, evaluation = iterate.iteration, iterate.x, iterate.evaluation
        if iteration == 0:
            self._began = perf_counter()
            if (path := self.checkpoint.path) is not None:  # steps of an earlier design
                on_rank_0(self.comm, lambda: path.with_name("boundary.csv").unlink(missing_ok=True))
        if not self.history.columns:
            self.history.columns = self._all_columns(evaluation)
        seconds = self.comm.bcast(perf_counter() - self._began if iteration else 0.0, root=0)
        row = self._row(x, evaluation) | {"accepted": int(iterate.accepted), "seconds": seconds}
        columns = ("iteration", "step", "sharpness", "merit", "multiplier")
        row |= {name: getattr(iterate, name) for name in columns}
        self.history.add(row)
        if iterate.state is not None:
            common = {"stage_iterations": self.stage_iterations, "start": self._start}
            common |= {"modes": self._modes, "mode_error": self._mode_error}
            common |= {"steps": chosen_methods(self.problem), **self.history.state()}
            self.checkpoint.save("design", {**iterate.state, **self._identity, **common})
        if iteration == 0:
            return
        self.run.advance()
        texts = [f"psi {row['psi']:.4g}"]
        if self.domains:
            texts.append(f"volume {row['volume']:.3f}")
            texts.append(f"first frequency (interfaces held) {row['frequency']:.4g} Hz")
        if error := row["gradient_estimate"]:
            texts.append(f"gradient to {error:.1%}")
        self.run.show(", ".join(texts))
        with on_every_rank(self.comm, "the callback of a design loop"):
            if self._callback is not None:
                self._callback(iteration, of_problem(x), evaluation)

    def _all_columns(self, evaluation: Evaluation) -> list[str]:
        bodies = list(self.domains) if len(self.domains) > 1 else []
        cases = list(evaluation.load_cases) if len(evaluation.load_cases) > 1 else []
        return [
            *COLUMNS,
            *([] if self.gradient.exact else GRADIENT_COLUMNS),
            *(f"{key} of {name}" for name in bodies for key in ("volume", "frequency", "gray")),
            *(f"psi of {name}" for name in cases),
            *(f"constraint {label}" for label in evaluation.constraints),
            *evaluation.labelled_values,
        ]

    def _row(self, x: Mapping[str, Array], evaluation: Evaluation) -> Row:
        """All columns that follow from an evaluation and the report of the last gradient."""
        area = {name: domain.area for name, domain in self.domains.items()}
        gray = {
            name: gray_fraction(domain, x[name], self.webs[name])
            for name, domain in self.domains.items()
        }
        frequencies = evaluation.fixed_interface_frequencies
        lowest = {
            name: float(frequencies[name][0]) if len(frequencies[name]) else NAN for name in area
        }

        def mean(share: Mapping[str, float]) -> float:
            return sum(share[n] * area[n] for n in area) / sum(area.values()) if area else NAN

        reports = list(self._reports.values())
        worst = max(reports, key=lambda report: report.estimate, default=None)
        row = {
            "psi": evaluation.psi,
            "volume": mean(evaluation.volume),
            "frequency": min(lowest.values(), default=NAN),
            "gray": mean(gray),
            "modes": sum(self._modes),
            "mode_error": self._mode_error,
            "outer_gap": min((evaluation.outer_gap[name] for name in area), default=NAN),
            "solver_iterations": sum(evaluation.solver_iterations.values()),
            "gradient_elements": sum(report.elements for report in reports),
            "gradient_estimate": worst.estimate if worst else 0.0,
        }
        for region, key in (("gradient", "errors"), ("band", "band_errors")):
            errors = getattr(worst, key, None) or GradientErrors(NAN, NAN, NAN)
            row |= {f"{region}_error": errors.l2, f"{region}_cosine": errors.cosine}
            row[f"{region}_worst"] = errors.worst
        for key, values in (("volume", evaluation.volume), ("frequency", lowest), ("gray", gray)):
            row |= {f"{key} of {name}": values[name] for name in area}
        row |= {f"psi of {name}": case.psi for name, case in evaluation.load_cases.items()}
        row |= {f"constraint {label}": c.violation for label, c in evaluation.constraints.items()}
        return row | evaluation.labelled_values

    def result(
        self,
        designs: Mapping[str, Variables],
        variables: Mapping[str, Array],
        evaluation: Evaluation,
        reason: str,
        volume: Mapping[str, float] | None = None,
        residual: float = NAN,
    ) -> Result:
        """The result of the run, with its history.

        A sharp level set is evaluated once more with the law of cut elements. A `DesignWarning`
        names violated constraints, and bodies of which more than a tenth is gray.

        Args:
            designs: Designs by body, with the sharpness of the last stage.
            variables: Their variables.
            evaluation: Their evaluation.
            reason: Why the loop ended.
            volume: Upper bounds of the filled shares, by body.
            residual: Residual of the first-order conditions.
        """
        x = {name: design.point(variables[name]) for name, design in designs.items()}
        dense = {name: design for name, design in designs.items() if isinstance(design, Design)}
        sharp = [n for n, d in dense.items() if d.fills and d.sharpness >= CUT_FROM]
        problem, final, errors = self._evaluated_at_last(x, evaluation, sharp)

        bounds = dict(volume or {})
        values = {f"volume of {n}": final.volume[n] / bound - 1.0 for n, bound in bounds.items()}
        values |= {name: bound.violation for name, bound in final.constraints.items()}
        # NaN violates a constraint
        violations = {name: value for name, value in values.items() if not value <= FEASIBLE}
        if violations:
            reason = "interrupted" if reason == "interrupted" else "infeasible"
        if violations and (reason == "interrupted" or not self._followed):
            self._warn_of_violations(violations, reason)
        densities = {name: x[name] for name in dense}
        if reason != "interrupted":
            for name, design in dense.items():
                # gray cells of a sharp level set are cut by its boundary
                if name not in sharp:
                    _warn_of_gray(name, design, densities[name])
        return Result(
            densities,
            dict(variables),
            final,
            self.history.arrays(),
            reason,
            dict(designs),
            problem,
            violations,
            errors,
            bounds,
            residual=residual,
        )

    def _evaluated_at_last(
        self, x: Mapping[str, Array], evaluation: Evaluation, sharp: Collection[str]
    ) -> tuple[Problem, Evaluation, dict[str, float]]:
        """The problem, evaluation and mode errors of the last design ``x``, as they are reported.

        Elements of ``sharp`` level sets are cut, and modes and time steps suffice for the design.
        """
        problem, final = self.problem, evaluation
        cut = {name: problem.flexible[name].with_cut_elements() for name in sharp}
        if any(body is not problem.flexible[name] for name, body in cut.items()):
            problem = problem.with_bodies(cut)
            final = problem.value(of_problem(x))
        errors: dict[str, float] = {}
        if self._mode_tolerance is not None:
            problem, final, errors = with_enough_modes(
                problem, x, final, self._mode_tolerance, self._first_modes
            )
        problem, final = with_steps_for(problem, x, final)
        if self._calibrates:
            problem, final = problem.calibrated(final)
        for name, reduced in final.bodies.items():
            if name in problem.flexible:  # the others have no density
                problem.flexible[name].warn_of_missing_modes(reduced)
        return problem, final, errors

    def _warn_of_violations(self, violations: Mapping[str, float], reason: str) -> None:
        """Warn of violated bounds of the last design."""
        exceeded = ", ".join(f"{name!r} by {value:.3%}" for name, value in violations.items())
        warn(
            f"optimize: the design violates {exceeded} of the bound, after "
            f"{int(self.rows[-1]['iteration'])} iterations ({reason}): relax the bound, give "
            "more volume or more iterations",
            stacklevel=5,
        )


def _warn_of_gray(name: str, design: Design, x: Array) -> None:
    """Warn of a body of which too much is gray, of densities ``x``, shape (cells,)."""
    gray = gray_fraction(design.domain, x, design.web)
    if gray <= GRAY:
        return
    remedy = "take smaller elements, or ask for larger minimum sizes"
    if design.sharpness < design.at(1.0).sharpness:
        remedy = (
            "give more iterations, as the run ended before the design was sharp "
            "(resume=True continues from here)"
        )
    warn(
        f"optimize: {100.0 * gray:.0f} % of {name!r} is gray, neither void nor solid, "
        f"and no part can be cut out of that: {remedy}",
        stacklevel=5,
    )


class Optimizer(Protocol):
    """Updates designs, by the services of a `DesignLoop`."""

    def run(self, loop: DesignLoop, designs: Designs, start: Arrays, volume: Bounds) -> Result:
        """Optimise ``designs`` from their ``start`` variables with the services of a ``loop``.

        Designs, variables and the upper bounds of ``volume`` are by name. A ValueError is raised if
        these do not fit each other, and a SimulationError if the motion of the start cannot be
        computed.
        """
