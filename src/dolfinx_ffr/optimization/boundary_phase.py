# SPDX-License-Identifier: MIT
"""Boundaries of parts that move: a mesh for each step, the exact gradient, constraints that hold.

Which steps are taken is up to the stepper; here are what precedes and follows them, and their
history, checkpoint and result, for boundaries of any geometry.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from .. import validation
from ..arrays import Array
from ..boundary import Boundary, StepOptions, Surface
from ..objective import is_stress
from ..parallel import nearly_equal
from ..part import TURN, PartViolation, PartWarning
from ..problem import Problem
from .checkpoint import Checkpoint
from .curve_steps import CurveSteps
from .descent import Descent, geometry_of, of_stress
from .history import History
from .part_checks import part_violations
from .result import BoundaryResult, ranks_of
from .running import Run
from .stepper import FEASIBLE, BoundarySteps, BoundaryTrial, follow, with_prefix, without_prefix

#: Relative difference of controls from which on two starts are others; round-off is amplified by
#: iterations of a design and changes less
_SAME = 1e-5
#: The same of psi, which is that of a mesh made anew: another release of gmsh makes another one
_SAME_PSI = 1e-4

#: Makes steps that show texts, from a state or from the start
MakeSteps = Callable[[Callable[[str], object], Mapping[str, Any] | None], BoundarySteps]


def move_boundary(
    problem: Problem,
    boundary: Boundary | Surface | Mapping[str, Boundary | Surface],
    *,
    volume: float | Mapping[str, float] | None = None,
    variables: Mapping[str, Array] | None = None,
    iterations: int = 30,
    size: float | None = None,
    mode_tolerance: float | None = 2e-3,
    progress: bool = True,
) -> BoundaryResult:
    """Lower the objective by moving the boundaries of parts.

    Each step makes new meshes that fit the boundaries, and takes the exact derivative with respect
    to each of their nodes. Constraints of the problem, the volume, and the minimum size of members,
    gaps and radii are linear constraints of the step. Before the first step and every fifth one
    after it, struts are inserted across holes of a body in the plane if psi falls by them, and
    windows in walls of a solid; struts that carry little are removed on trial, and crossings slide
    as a whole. Every five steps normal modes are added where they do not suffice. Ctrl-C ends the
    run after the step at hand.

    The result is evaluated on finer meshes. A bound that is violated there, but not on the meshes
    of the steps, is tightened by the difference, and four more steps follow, up to three times.

    Args:
        problem: The problem for which the parts were designed.
        boundary: The boundary of the part; for several designed bodies a mapping by name.
        volume: Upper bound of the filled share of the body, of several one for each, or None.
        variables: Values of designs without a domain by name, shape (size,), and densities of
            bodies that stay as they are, (cells,).
        iterations: Number of steps, at most, but for up to twelve that then mend a bound.
        size: Size of triangles [m]; by default 3.2 minimum members, or the size of 800 triangles.
        mode_tolerance: Relative error of psi by the normal modes that a body leaves out, above
            which it gets more; None leaves the modes as they are.
        progress: Show a progress bar on rank 0.

    Returns:
        The best boundaries, on every rank.

    Raises:
        ValueError: If a number is out of range, a designed body has no boundary, psi is zero, or
            boundaries that are given cannot be meshed.
        SimulationError: If those parts cannot be simulated.

    Warns:
        PartWarning: If a bound or a minimum size is missed by more than 1 %.
        DesignWarning: If no number of modes suffices.
    """
    options = variables, iterations, size, mode_tolerance, progress
    return moved(problem, boundary, volume, *options)


def moved(
    problem: Problem,
    boundary: Boundary | Surface | Mapping[str, Boundary | Surface],
    volume: float | Mapping[str, float] | None,
    variables: Mapping[str, Array] | None,
    iterations: int,
    size: float | None,
    mode_tolerance: float | None,
    progress: bool,
    checkpoint: Checkpoint | None = None,
) -> BoundaryResult:
    """Run `move_boundary` and store its state in a ``checkpoint`` after each step."""
    validation.instance("boundary: problem", problem, Problem, "a Problem")
    steps = validation.integer("boundary: iterations", iterations, least=1)
    validation.flag("boundary: progress", progress)
    if mode_tolerance is not None:
        validation.number("boundary: mode_tolerance", mode_tolerance, above=0.0)
    names = [name for name in problem.flexible if name not in (variables or {})]
    boundaries = boundary if isinstance(boundary, Mapping) else dict.fromkeys(names[:1], boundary)
    if set(boundaries) != set(names):
        raise ValueError(
            f"boundary: boundaries are given for {sorted(boundaries)}, and the problem designs "
            f"{sorted(names)}; give a mapping from name to boundary, or some bodies by their "
            "volume integrals (evaluation.bodies[name].integrals)"
        )
    geometry = geometry_of(problem)
    for name in names:
        expected = geometry.boundary_type, geometry.type_name
        validation.instance(f"boundary of {name!r}", boundaries[name], *expected)
    shares = volume if isinstance(volume, Mapping) else dict.fromkeys(names, volume)
    bounds = {}
    for name, most in shares.items():
        if most is not None:
            validation.choice("boundary: volume", name, names)
            bounds[name] = validation.number("boundary: volume", most, above=0.0, most=1.0)
    if size is not None:
        validation.number("boundary: size", size, above=0.0, unit="m")
    sizes = {n: geometry.cell_size(boundaries[n], size) for n in names}
    others = {n: validation.numbers(f"boundary: {n}", x) for n, x in (variables or {}).items()}
    objectives = [case.objective for case in problem.load_cases.values()]
    objectives += [constraint.objective for constraint in problem.constraints]
    turn = TURN if any(map(is_stress, objectives)) else math.inf
    descent = Descent(
        problem, bounds, sizes, others, turn, of_stress(problem, geometry.steps.stress_margin)
    )
    ordered = {name: boundaries[name] for name in names}

    def steps_from(show: Callable[[str], object], state: Mapping[str, Any] | None) -> CurveSteps:
        return CurveSteps(replace(descent, tell=show), ordered, steps, mode_tolerance, state)

    run = Run(ranks_of(problem), steps, "step", progress, "boundary")
    phase = BoundaryPhase(run, steps, CurveSteps.identity(ordered), checkpoint, geometry.steps)
    return phase.result(steps_from)


class BoundaryPhase:
    """The steps of boundaries with their progress, history, checkpoint and result.

    Args:
        run: Progress, and the user's wish to stop.
        steps: Number of steps, but for those that then mend a bound.
        identity: Arrays that the checkpoint of an earlier run must have in common with this one.
        checkpoint: Checkpoint of the whole run; None stores nothing.
        options: Numbers of the steps.
    """

    def __init__(
        self,
        run: Run,
        steps: int,
        identity: Mapping[str, Array],
        checkpoint: Checkpoint | None,
        options: StepOptions,
    ) -> None:
        self._options = options
        self._run, self._steps, self._identity = run, steps, identity
        self._checkpoint = checkpoint or Checkpoint(run.comm, None, False)
        folder = self._checkpoint.path
        file = None if folder is None else folder.with_name("boundary.csv")
        self._history = History(run.comm, file)
        #: What the boundaries enclose at each step, by body
        self._materials: dict[str, list[BaseGeometry]] = {}

    def result(self, steps_from: MakeSteps) -> BoundaryResult:
        """The best boundaries of all steps, evaluated on finer meshes; collective."""
        run, more = self._run, self._options.more_steps
        with run.running():
            trials = count(1)

            def show(text: str) -> None:
                run.show(f"{text}, trial {next(trials)} between steps")

            state = self._earlier()
            steps = steps_from(show, state)
            if state is None:
                self._add(steps.row, steps.trial)
            else:
                self._check(state, steps)
                run.advance(steps.number)
            beyond = max(0, steps.number - self._steps)
            steps.last = self._steps + more * math.ceil(beyond / more)
            ends: list[tuple[Any, float]] = []
            while True:
                reason = follow(
                    steps,
                    lambda _: self._record(steps),
                    run.stopped,
                    lambda: steps.number < steps.last,
                )
                ends.append(steps.refined())
                used_up = steps.last >= self._steps + self._options.more_rounds * more
                if reason != "iterations" or used_up or not steps.tighten(ends[-1][0]):
                    break
                steps.last += more
                run.bar.total = steps.last
            best, change = min(ends, key=lambda end: steps.rank(end[0]))
            self._add(steps.row_of(best), best)
        for warned in best.warned:
            warnings.warn_explicit(warned.message, warned.category, warned.filename, warned.lineno)
        missing = _part_violations(best)
        _warn_of_missing(steps, best, missing, change)
        violations = {name: value for name, value in best.violations.items() if value > FEASIBLE}
        violations |= {name: violation.share for name, violation in missing.items()}
        return BoundaryResult(
            boundaries=dict(best.boundaries),
            problem=best.problem,
            evaluation=best.evaluation,
            history=self._history.arrays(),
            reason=reason,
            mode_errors=steps.mode_errors,
            materials=self._materials,
            violations=violations,
            begun=steps.first,
        )

    def _record(self, steps: BoundarySteps) -> None:
        """Add a step to history, checkpoint and progress."""
        self._add(steps.row, steps.trial)
        self._run.show(f"psi {steps.trial.evaluation.psi:.5g}")
        self._run.advance()
        films = {
            name: np.frombuffer(b"".join(map(shapely.to_wkb, film)), np.uint8)
            for name, film in self._materials.items()
        }
        lengths = {
            name: [len(shapely.to_wkb(material)) for material in film]
            for name, film in self._materials.items()
        }
        self._checkpoint.save(
            "boundary",
            {
                **with_prefix("start", self._identity),
                **with_prefix("steps", steps.state()),
                **with_prefix("film", films),
                **with_prefix("lengths", lengths),
                **self._history.state(),
                "psi": steps.trial.evaluation.psi,
            },
        )

    def _add(self, row: Mapping[str, float], trial: BoundaryTrial) -> None:
        """Add a row to the history, and a picture of each body."""
        self._history.add(row)
        for name, material in trial.materials.items():
            self._materials.setdefault(name, []).append(material)

    def _earlier(self) -> dict[str, Any] | None:
        """The state of the steps of an earlier run, if it is to be resumed."""
        section = self._checkpoint.section("boundary")
        if section is None:
            return None
        start = without_prefix("start", section)
        if start.keys() != self._identity.keys() or not all(
            nearly_equal(start[name], array, _SAME) for name, array in self._identity.items()
        ):
            raise self._checkpoint.of_another_problem("its steps began with other boundaries")
        self._history.restore(section)
        for name, film in without_prefix("film", section).items():
            ends = np.cumsum(section[f"lengths {name}"])[:-1]
            self._materials[name] = [
                shapely.from_wkb(piece.tobytes()) for piece in np.split(film, ends)
            ]
        self._psi = float(section["psi"])
        return without_prefix("steps", section)

    def _check(self, state: Mapping[str, Any], steps: BoundarySteps) -> None:
        """Refuse a state whose boundaries have another psi here."""
        psi = steps.trial.evaluation.psi
        if not abs(psi - self._psi) <= _SAME_PSI * abs(self._psi):
            raise self._checkpoint.of_another_problem(
                f"psi of its boundaries was {self._psi:.8g}, and is {psi:.8g} in this run"
            )


def _part_violations(trial: BoundaryTrial) -> dict[str, PartViolation]:
    """Violations of required sizes and rims by the parts of a trial, by name."""
    sizes = {name: (minimum.member, minimum.gap) for name, minimum in trial.asked.items()}
    rims = {name: (minimum.rim, minimum.member) for name, minimum in trial.asked.items()}
    return part_violations(trial.problem, trial.parts, sizes, rims)


def _warn_of_missing(
    steps: BoundarySteps,
    trial: BoundaryTrial,
    missing: Mapping[str, PartViolation],
    change: float,
) -> None:
    """Warn of bounds and sizes that do not hold, of coarse meshes, and of what the parts are."""
    texts = []
    exceeded = [
        f"{name!r} is violated by {share:.2%} of its bound"
        for name, share in trial.violations.items()
        if share > FEASIBLE
    ]
    if exceeded:
        texts.append(f"{'; '.join(exceeded)}: take more iterations, another start or other bounds")
    for violation, about in missing.items():
        texts.append(f"{violation.partition(':')[0]!r}: {about.message}")
    if change > steps.mesh_tolerance:
        accuracy = (
            f"psi still changes by {change:.1%} on the finest mesh, whose value is reported"
            if math.isfinite(change)
            else "psi belongs to the mesh of the steps, as no finer mesh could be made"
        )
        texts.append(f"{accuracy}: take smaller cells of the body, or a smaller size")
    texts += steps.remarks(trial)
    for text in texts:
        warnings.warn(f"boundary: {text}", PartWarning, stacklevel=5)
