# SPDX-License-Identifier: MIT
"""Descent of boundaries: a mesh for each step, the exact gradient, constraints that hold."""

from __future__ import annotations

import math
import signal
import warnings
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import count
from typing import Any

import numpy as np
from tqdm.auto import tqdm

from .. import validation
from ..arrays import Array
from ..boundary import Boundary, Kind, Surface
from ..objective import is_stress
from ..part import TURN, PartViolation, PartWarning
from ..problem import Problem
from .descent import HELD, LONGEST, NONE, Descent, Trial, kind_of, of_stress
from .enough_modes import EVERY
from .part_checks import part_violations
from .result import BoundaryResult, drawn_of, ranks_of
from .running import interruptible, warnings_above
from .signed_log import SignedLog
from .steps_checkpoint import Learnt, StepsCheckpoint
from .topology import changed, shifted
from .trial_failed import TrialFailed

#: First step, in minimum members, and factor of the reach after one that is better
_FIRST, _LONGER = 0.5, 1.2
#: Share of what a step promises that it must keep to be better
_PROMISED = 0.25
#: Shortest step where the stress counts, in minimum members
_NOISE = 0.06
#: By which share of its violation a bound is tightened there, and at most
_TIGHTENED, _TIGHTEST = 0.4, 0.08
#: By how much stress is kept below its bounds in steps
_SPARE = 0.01
#: Steps that follow where a bound is kept by the mesh of the steps and not by finer ones, and how
#: often
_MENDING, _ROUNDS = 4, 3
#: Weight of the largest violation of bounds in the merit, which decides whether a step is taken; at
#: least so many times the sum of their multipliers, beyond which a penalty is exact
_OF_BOUNDS, _EXACT = 1.5, 1.5
#: Share by which the result may miss a minimum size before that is warned of
_MISSED = 0.01


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
    after it, and where no step is better, struts are inserted across holes of a body in the plane
    if psi falls by them, and windows in walls of a solid; struts that carry little or cost more
    than they carry, and small holes, are tried without, and crossings slide as a whole. Every five
    steps normal modes are added where they do not suffice. Ctrl-C ends the run after the step at
    hand.

    The result is told by finer meshes. Where these exceed a bound that those of the steps keep, it
    is tightened by the difference, and four more steps follow, up to three times.

    Args:
        problem: As the parts were designed.
        boundary: Of the part; of several designed bodies a mapping from their names to one each.
        volume: Upper bound of the filled share of the body, of several one for each, or None.
        variables: Values of designs without a domain by name, shape (size,), and densities of
            bodies that stay as they are, (cells,).
        iterations: Number of steps, at most, but for up to twelve that then mend a bound.
        size: Of the triangles [m]; by default 3.2 minimum members, or what gives 800 triangles.
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
    checkpoint: StepsCheckpoint | None = None,
) -> BoundaryResult:
    """As `move_boundary`, its state kept in a ``checkpoint`` after each step."""
    validation.instance("boundary: problem", problem, Problem, "a Problem")
    steps = validation.integer("boundary: iterations", iterations, least=1)
    validation.flag("boundary: progress", progress)
    if mode_tolerance is not None:
        validation.number("boundary: mode_tolerance", mode_tolerance, above=0.0)
    names = [name for name in problem.flexible if name not in (variables or {})]
    given = boundary if isinstance(boundary, Mapping) else dict.fromkeys(names[:1], boundary)
    if set(given) != set(names):
        raise ValueError(
            f"boundary: boundaries are given for {sorted(given)}, and the problem designs "
            f"{sorted(names)}; give a mapping from name to boundary, or some bodies by their "
            "volume integrals (evaluation.bodies[name].integrals)"
        )
    kind = kind_of(problem)
    for name in names:
        validation.instance(f"boundary: that of {name!r}", given[name], kind.kind, kind.article)
    shares = volume if isinstance(volume, Mapping) else dict.fromkeys(names, volume)
    bounds = {}
    for name, most in shares.items():
        if most is not None:
            validation.choice("boundary: volume", name, names)
            bounds[name] = validation.number("boundary: volume", most, above=0.0, most=1.0)
    if size is not None:
        validation.number("boundary: size", size, above=0.0, unit="m")
    sizes = {n: kind.size(given[n], size) for n in names}
    others = {n: validation.numbers(f"boundary: {n}", x) for n, x in (variables or {}).items()}
    objectives = [case.objective for case in problem.load_cases.values()]
    objectives += [constraint.objective for constraint in problem.constraints]
    turn = TURN if any(map(is_stress, objectives)) else math.inf
    descent = Descent(problem, bounds, sizes, others, turn, of_stress(problem, _SPARE))
    ordered = {name: given[name] for name in names}
    return _descended(descent, ordered, steps, mode_tolerance, progress, checkpoint)


def _descended(
    descent: Descent,
    boundaries: dict[str, Boundary | Surface],
    steps: int,
    tolerance: float | None,
    progress: bool,
    checkpoint: StepsCheckpoint | None,
) -> BoundaryResult:
    """The best of all steps."""
    comm = ranks_of(descent.problem)
    first = {name: body.modes for name, body in descent.problem.flexible.items()}
    silent = not progress or comm.rank > 0
    with (
        tqdm(total=steps, desc="boundary", unit="step", disable=silent) as bar,
        warnings_above(bar),
        interruptible(comm) as interrupted,
    ):
        trials = count(1)
        descent = replace(
            descent,
            tell=lambda psi: bar.set_postfix_str(f"{psi}, trial {next(trials)} between steps"),
        )
        pace, reason = descent.kind.pace, "iterations"
        if checkpoint is not None and (kept := checkpoint.load(boundaries)):
            descent, trial, best = descent.restored(kept)
            checkpoint.check(kept, trial.evaluation.psi)
            errors = known = kept.errors
            reach, weight, margin = kept.learnt.reach, kept.learnt.weight, kept.learnt.margin
            told, shown, secants = kept.told, kept.shown, kept.known
            bar.update(len(told) - 1)
        else:
            try:
                trial = descent.tried(boundaries)
            except TrialFailed as failed:  # there is nothing to go back to
                raise failed.__cause__ or failed from None
            descent, trial, errors = descent.accurate(trial, tolerance, first)
            logarithm = SignedLog.around(trial.evaluation.psi)
            descent = replace(descent, logarithm=logarithm)
            trial = replace(trial, logarithm=logarithm)
            best, known = trial, errors
            reach, weight, margin, secants = _FIRST, _OF_BOUNDS, 0.0, NONE
            told = [trial.told(0.0, 0, 0, 0)]
            shown = {n: [b.material] for n, b in boundaries.items() if b.material is not None}
        last = steps - _MENDING * (min(0, steps + 1 - len(told)) // _MENDING)
        ends: list[tuple[Trial, float]] = []
        for number in count(len(told)):
            if number > last:
                ends.append(descent.finer(best))
                tighter = descent.tightened(best, ends[-1][0])
                if not tighter or last >= steps + _ROUNDS * _MENDING:
                    break
                descent = replace(descent, spare=tighter)
                trial = best = replace(best, spare=tighter)
                # what is near its best moves little
                reach, secants = min(reach, 2.0 * _NOISE), NONE
                last += _MENDING
                bar.total = last
            if asked := interrupted():
                reason = "terminated" if asked == signal.SIGTERM else "interrupted"
                break
            slopes, rejected, found = descent.slopes(trial, margin), 0, None
            inserted = removed = 0
            # where no step is better, there may be one without what crowds or ends free there
            for stuck in (False, True):
                if (stuck or number % EVERY == 1) and number < max(steps - 1, 2):
                    before, there = trial, descent.step(trial, slopes, reach)
                    own = slopes.evaluation, there.of_bounds, weight
                    trial, inserted, removed = changed(descent, trial, *own, stuck)
                    if trial is not before:
                        before.release()
                        slopes, reach = descent.slopes(trial, margin), max(reach, pace.again)
                        secants = NONE
                    before, old = trial, slopes
                    trial, slopes = shifted(descent, trial, slopes, there.of_bounds, weight)
                    if trial is not before:
                        before.release()
                        secants = descent.secants(secants, before, old, trial)
                while found is None and reach >= pace.shortest:
                    step = descent.step(trial, slopes, reach, secants)
                    weight = max(weight, _EXACT * float(np.sum(step.of_bounds)))
                    found = descent.moved(trial, step)
                    merits = (each.merit(weight) for each in (trial, best))
                    if found is not None and pace.worse(found.merit(weight), *merits):
                        # shorter steps change the largest stress less than another mesh does
                        if descent.turn < math.inf and reach <= _NOISE:
                            break
                        found = None
                    if found is None:
                        reach, rejected = 0.5 * reach, rejected + 1
                if found is not None:
                    break
                reach = _FIRST
            if found is None:
                reason = "no better step"
                break
            # one that keeps little of what it promises by its curvature was too long
            promised = _PROMISED * max(0.0, step.promised) if secants.size else 0.0
            better = found.merit(weight) < trial.merit(weight) - promised
            reach = min(reach * (_LONGER if better else pace.shorter), LONGEST)
            if descent.turn < math.inf:
                reach = max(reach, _NOISE)
                # its largest value is always a little more than its slopes say
                late = _TIGHTENED * found.excess if found.excess > HELD else -0.2 * margin
                margin = min(margin + late, _TIGHTEST)
            trial.release()
            secants, trial = descent.secants(secants, trial, slopes, found), found
            if number % EVERY == 0 or number == last:
                latest = best is trial
                grown, trial, errors = descent.accurate(trial, tolerance, first)
                if grown is not descent:  # what was told with fewer modes does not count
                    descent, known, secants = grown, errors, NONE
                    if latest:
                        best = trial
                    else:
                        best = descent.tried(best.boundaries)
                        best.release()
                reach = max(reach, pace.again)
            if trial.rank(weight) <= best.rank(weight):
                best, known = trial, errors
            longest = max(float(np.max(np.abs(a))) for a in step.offsets.values())
            told.append(trial.told(longest, rejected, removed, inserted))
            for name, film in shown.items():
                film.append(trial.boundaries[name].material)
            bar.set_postfix_str(f"psi {trial.evaluation.psi:.5g}")
            bar.update()
            if checkpoint:
                learnt = Learnt(trial.evaluation.psi, reach, weight, margin)
                checkpoint.save(descent.kept(learnt, trial, best, known, told, shown, secants))
        if reason != "iterations":
            ends.append(descent.finer(best))
        best, change = min(ends, key=lambda end: end[0].rank(weight))
        told.append(best.told(0.0, 0, 0, 0))
        if checkpoint:
            checkpoint.tell(told)
        for name, film in shown.items():
            film.append(best.boundaries[name].material)
    for warned in best.warned:
        warnings.warn_explicit(warned.message, warned.category, warned.filename, warned.lineno)
    sizes = {
        n: (b.member, b.gap if isinstance(b, Boundary) else 0.0) for n, b in boundaries.items()
    }
    rims = {name: (boundary.rim, boundary.member) for name, boundary in boundaries.items()}
    missed = part_violations(
        descent.problem, {n: drawn_of(b) for n, b in best.boundaries.items()}, sizes, rims
    )
    _warn_of_missed(best, missed, descent.kind, change)
    history = {key: np.array([row[key] for row in told]) for key in told[0]}
    of_best = best.boundaries, best.problem, best.evaluation
    over = {name: value for name, value in best.excesses.items() if value > HELD}
    over |= {name: each.share for name, each in missed.items()}
    begun = partial(descent.resolved, boundaries)
    return BoundaryResult(*of_best, history, reason, known, shown, over, begun)


def _warn_of_missed(
    trial: Trial, missed: Mapping[str, PartViolation], kind: Kind[Any], change: float
) -> None:
    """Warn of bounds and sizes that do not hold, of coarse meshes, and of what the parts are."""
    said = [
        f"{name!r} is violated by {over:.2%} of its bound"
        for name, over in trial.excesses.items()
        if over > HELD
    ]
    said += [
        f"a radius of {name!r} is {rows.missed:.1%} below its minimum"
        for name, rows in trial.radii.items()
        if rows.missed > _MISSED
    ]
    if said:
        warnings.warn(
            f"boundary: {'; '.join(said)}: take more iterations, another start or other bounds",
            PartWarning,
            stacklevel=5,
        )
    for violation, each in missed.items():
        name = violation.partition(":")[0]
        warnings.warn(f"boundary: {name!r}: {each.said}", PartWarning, stacklevel=5)
    if change > kind.still:
        told = (
            f"psi still changes by {change:.1%} on the finest mesh, whose value is reported"
            if math.isfinite(change)
            else "psi is that of the mesh of the steps, as no finer one could be made"
        )
        warnings.warn(
            f"boundary: {told}: take smaller cells of the body, or a smaller size",
            PartWarning,
            stacklevel=5,
        )
    for name, boundary in trial.boundaries.items():
        for text in kind.said(boundary):
            warnings.warn(f"boundary: {name!r}: {text}", PartWarning, stacklevel=5)
