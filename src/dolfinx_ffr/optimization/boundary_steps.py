# SPDX-License-Identifier: MIT
"""Descent of boundaries: a mesh for each step, the exact gradient, constraints that hold."""

from __future__ import annotations

import math
import signal
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import block_diag as sparse_block_diag
from scipy.sparse import csc_matrix
from tqdm.auto import tqdm

from .. import validation
from ..arrays import Array
from ..boundary import Boundary, Costs, InSpace, InThePlane, Kind, Rows, Surface, best_step
from ..dynamics import SimulationError
from ..mechanical_problem import MechanicalProblem
from ..objective import Objective, PeakStress
from ..part import PartWarning
from ..problem import Evaluation, Problem
from .enough_modes import (
    EVERY,
    chosen_methods,
    with_enough_modes,
    with_methods,
    with_steps_for,
)
from .result import BoundaryResult, ranks_of
from .running import interruptible, warnings_above
from .steps_checkpoint import Kept, Learnt, StepsCheckpoint

#: By the dimension of the bodies
_KINDS: dict[int, Kind[Any]] = {2: InThePlane(), 3: InSpace()}

#: Distance over which steps are smooth, in minimum members
_SMOOTH = 2.4
#: First and longest step, in minimum members, and factor of the reach after one that is better
_FIRST, _LONGEST, _LONGER = 0.5, 0.65, 1.2
#: Shortest step where the stress counts, in minimum members
_NOISE = 0.06
#: By which share of its violation a bound is tightened there, and at most
_TIGHTENED, _TIGHTEST = 0.4, 0.08
#: By how much stress is kept below its bounds in steps, and where it is told: it differs as much
#: from mesh to mesh
_SPARE, _SPARED = 0.01, 5e-3
#: Steps that follow where a bound is kept by the mesh of the steps and not by finer ones, and how
#: often
_MENDING, _ROUNDS = 4, 3
#: Size of triangles in notches, in radii, where the stress counts, and where the result is told:
#: by coarser ones it is up to 5 % off, and a limit that the steps keep is missed by what is told
_TURN = 0.25
#: Weights of the largest violations in the merit, which decides whether a step is taken; that of
#: bounds is at least so many times the sum of their multipliers, beyond which a penalty is exact
_OF_SIZES, _OF_BOUNDS, _EXACT = 0.05, 1.5, 1.5
#: Violation of bounds and of minimum sizes up to which a boundary may be the best one
_HELD = 2e-3
#: Rise of log psi up to which a strut is taken away
_GONE = 5e-4
#: Share by which the result may miss a bound or a minimum size before that is warned of
_MISSED = 0.01


@dataclass(frozen=True, eq=False)
class Trial:
    """Boundaries with the meshes that fit them, and what was computed there."""

    boundaries: dict[str, Boundary | Surface]
    problem: Problem
    evaluation: Evaluation
    sizes: dict[str, Rows]  #: Of members and gaps
    radii: dict[str, Rows]
    excesses: dict[str, float]  #: Values of constraints by name, positive where they are violated
    spare: dict[str, float]  #: By how much more than to their bounds some of them are kept

    @property
    def kept(self) -> dict[str, float]:
        """What the steps keep below zero, by the names of the constraints."""
        return {name: value + self.spare.get(name, 0.0) for name, value in self.excesses.items()}

    @property
    def excess(self) -> float:
        """Largest violation of what the steps keep, at least zero."""
        return max(0.0, *self.kept.values()) if self.excesses else 0.0

    def merit(self, of_bounds: float) -> float:
        """Logarithm of psi and the violations with their weights."""
        rows = [*self.sizes.values(), *self.radii.values()]
        narrow = max((float(np.max(part.values, initial=0.0)) for part in rows), default=0.0)
        return self.carries(of_bounds) + _OF_SIZES * narrow

    def carries(self, of_bounds: float) -> float:
        """The same without sizes, which steps mend where a strut has gone."""
        return math.log(self.evaluation.psi) + of_bounds * self.excess

    def rank(self, of_bounds: float, worth: float = 0.0) -> tuple[bool, float]:
        """Which is the best: one that keeps bounds and sizes, and of those the least merit.

        The merit is less by what it is ``worth`` that something has gone.
        """
        return max(self.excess, self.missed) > _HELD, self.merit(of_bounds) - worth

    @property
    def missed(self) -> float:
        """The largest share by which a member, gap or radius is below its minimum."""
        rows = (*self.sizes.values(), *self.radii.values())
        return max((part.missed for part in rows), default=0.0)

    def told(self, step: float, rejected: int, removed: int) -> dict[str, float]:
        """One row of the history."""
        bodies = self.problem.flexible
        area = sum(bodies[name].domain.area for name in self.boundaries)
        return {
            "psi": self.evaluation.psi,
            "volume": area / sum(b.body.area for b in self.boundaries.values()),
            "narrowest": min(rows.smallest for rows in self.sizes.values()),
            "tightest": min(rows.smallest for rows in self.radii.values()),
            "excess": max(0.0, *self.excesses.values()) if self.excesses else 0.0,
            "step": step,
            "cells": sum(bodies[name].domain.n_cells_global for name in self.boundaries),
            "modes": sum(bodies[name].modes for name in self.boundaries),
            "rejected": rejected,
            "removed": removed,
        }


@dataclass(frozen=True, eq=False)
class _Slopes:
    """Derivatives by the offsets of the masters along their normals, in minimum members."""

    psi: Array  #: Of log psi, (masters,)
    values: Array  #: Of the constraints: members and gaps, radii, bounds, (m,)
    slopes: Array  #: Their derivatives, (m, masters)
    bounds: int  #: Number of bounds


@dataclass(frozen=True, eq=False)
class _Descent:
    """Steps of the boundaries of a problem's designed bodies."""

    problem: Problem
    volume: dict[str, float]  #: Upper bounds of the filled shares
    sizes: dict[str, float]  #: Of the triangles [m]
    others: dict[str, Array]  #: Variables of designs without a domain, and densities, that stay
    turn: float = math.inf  #: Size of triangles in notches, in radii
    spare: dict[str, float] = field(default_factory=dict)  #: Of `Trial`

    @property
    def kind(self) -> Kind[Any]:
        """What its boundaries are."""
        return _kind(self.problem)

    def point(self, problem: Problem) -> dict[str, Array]:
        """Where the problem is evaluated: full bodies."""
        full = {name: np.ones(body.domain.n_cells) for name, body in problem.flexible.items()}
        return full | self.others

    def tried(self, boundaries: dict[str, Boundary | Surface]) -> Trial:
        """Boundaries meshed and evaluated; collective."""
        bodies = dict(self.problem.bodies)
        for name, boundary in boundaries.items():
            domain = self.kind.mesh(boundary, self.sizes[name], self.turn)
            domain.whole = boundary.body
            bodies[name] = self.problem.flexible[name].with_domain(domain)
        problem = self.problem.with_bodies(bodies)
        return self.evaluated(boundaries, problem, problem.value(self.point(problem)))

    def evaluated(
        self, boundaries: dict[str, Boundary | Surface], problem: Problem, found: Evaluation
    ) -> Trial:
        """A trial of which all but the constraints is known; collective."""
        # stress limits are those of these parts
        problem, found = problem.calibrated(found)
        if not found.psi > 0.0:
            raise ValueError(
                f"boundary: psi is {found.psi:.6g}, and steps are measured by its logarithm; give "
                "an objective that is positive"
            )
        excesses = {name: float(bound.value) for name, bound in found.constraints.items()}
        for name, most in self.volume.items():
            share = problem.flexible[name].domain.area / boundaries[name].body.area
            excesses[f"volume of {name}"] = share / most - 1.0
        sizes = {name: self.kind.sizes(boundary) for name, boundary in boundaries.items()}
        radii = {name: self.kind.radii(boundary) for name, boundary in boundaries.items()}
        return Trial(boundaries, problem, found, sizes, radii, excesses, self.spare)

    def slopes(self, trial: Trial, margin: float = 0.0) -> _Slopes:
        """Derivatives of psi and of constraints, tightened by a margin, at a trial; collective."""
        bodies, boundaries = trial.problem.flexible, trial.boundaries
        problem, found = trial.problem.adapted(trial.evaluation, MechanicalProblem.parted)
        evaluation = problem.differentiate(found, nodes=True)
        motions = {n: self.kind.motion(b, bodies[n].domain) for n, b in boundaries.items()}

        def along(nodes: Mapping[str, Array] | None) -> Array:
            assert nodes is not None
            parts = []
            for name, boundary in boundaries.items():
                bar = np.zeros(boundary.n_controls)
                if name in nodes:
                    by_control = motions[name].pullback(nodes[name])
                    bar = np.einsum("kd,kd->k", by_control, boundary.normals)
                parts.append(boundary.member * (boundary.shares.T @ bar))
            return np.concatenate(parts)

        def rows(found: dict[str, Rows]) -> Array:
            own = [b.member * (found[n].slopes @ b.shares) for n, b in boundaries.items()]
            return np.asarray(block_diag(*own))

        bounds = [along(bound.nodes) for bound in evaluation.constraints.values()]
        excesses = []
        for name, bound in evaluation.constraints.items():
            # of several parts of a bound each is kept as that
            own = [v for n, v in trial.spare.items() if name == n or name.startswith(f"{n}, part")]
            excesses.append(float(bound.value) + max(own, default=0.0) + margin)
        excesses += [trial.kept[f"volume of {name}"] for name in self.volume]
        for name, most in self.volume.items():
            body = bodies[name]
            areas = body.measures_pullback(np.ones(body.domain.n_cells), None)
            bounds.append(along({name: areas}) / (most * boundaries[name].body.area))
        # no offset is longer than 1.5 times that of the step
        rooms = {n: self.kind.room(b, 1.5 * _LONGEST * b.member) for n, b in boundaries.items()}
        geometric = (trial.sizes, trial.radii, rooms)
        every = [part for found in geometric for part in found.values()]
        values = [part.values for part in every]
        return _Slopes(
            along(evaluation.nodes) / evaluation.psi,
            np.concatenate([*values, excesses]),
            np.vstack([*map(rows, geometric), *bounds]),
            len(bounds),
        )

    def step(self, trial: Trial, found: _Slopes, reach: float) -> _Step:
        """The best step, the longest offset of which is ``reach`` minimum members."""
        boundaries = trial.boundaries
        metrics = [
            b.shares.T @ b.metric(_SMOOTH * b.member) @ b.shares for b in boundaries.values()
        ]
        held = [b.shares.T @ b.held > 0 for b in boundaries.values()]
        step = best_step(
            csc_matrix(sparse_block_diag(metrics)),
            found.psi,
            found.values,
            found.slopes,
            np.concatenate(held),
            reach,
        )
        cost = step.multipliers
        offsets, costs, first, row = {}, {}, 0, 0
        for name, boundary in boundaries.items():
            count, shares = boundary.shares.shape[1], boundary.shares
            offsets[name] = boundary.member * (shares @ step.offsets[first : first + count])
            first += count
            costs[name] = own = Costs()
            for pair in trial.sizes[name].members.tolist():
                a, b = sorted(pair)
                if 0 <= a < b and cost[row] > 0.0:
                    own[a, b] = own.get((a, b), 0.0) + float(cost[row])
                row += 1
        return _Step(offsets, costs, float(np.sum(cost[len(cost) - found.bounds :])))

    def kept(self, learnt: Learnt, trial: Trial, best: Trial, *others: Any) -> Kept:
        """The state after a step; ``others`` are the last fields of `Kept`."""
        modes = {name: body.modes for name, body in self.problem.flexible.items()}
        also = None if best is trial else best.boundaries
        methods = chosen_methods(self.problem)
        return Kept(learnt, self.spare, trial.boundaries, also, modes, methods, *others)

    def restored(self, kept: Kept) -> tuple[_Descent, Trial, Trial]:
        """The descent, its boundaries and the best ones in an earlier state; collective."""
        problem = with_methods(self.problem.with_modes(kept.modes), kept.methods)
        descent = replace(self, problem=problem, spare=kept.spare)
        trial = descent.tried(kept.now)
        return descent, trial, descent.tried(kept.best) if kept.best else trial

    def moved(self, trial: Trial, step: _Step) -> Trial | None:
        """The boundaries after a step, None if no mesh fits them or they cannot be simulated."""
        try:
            moved = {n: b.moved(step.offsets[n]) for n, b in trial.boundaries.items()}
            return self.tried(moved)
        except (ValueError, SimulationError):
            return None

    def accurate(
        self, trial: Trial, tolerance: float | None, first: Mapping[str, int]
    ) -> tuple[_Descent, Trial, dict[str, float]]:
        """With as many normal modes, and as short time steps, as the parts need; collective."""
        x, problem, found = self.point(trial.problem), trial.problem, trial.evaluation
        errors: dict[str, float] = {}
        if tolerance is not None:
            problem, found, errors = with_enough_modes(problem, x, found, tolerance, first)
        problem, found = with_steps_for(problem, x, found)
        if problem is trial.problem:
            return self, trial, errors
        found_there = self.evaluated(trial.boundaries, problem, found)
        return replace(self, problem=problem), found_there, errors

    def resolved(self, boundaries: dict[str, Boundary | Surface]) -> Trial:
        """Boundaries on meshes that resolve notches or walls; collective."""
        fine = {n: self.kind.finer(b) for n, b in boundaries.items()}
        sizes = {n: size * (0.5 if self.turn < math.inf else 1.0) for n, size in self.sizes.items()}
        spare = _of_stress(self.problem, _SPARED)
        return replace(self, turn=_TURN, sizes=sizes, spare=spare).tried(fine)

    def finer(self, trial: Trial) -> tuple[Trial, float]:
        """The same on such meshes, if these can be made, and how much psi changed at last.

        They are made finer and finer until psi stands still; collective.
        """
        change = math.inf
        for _ in range(self.kind.meshes):
            try:
                found = self.resolved(trial.boundaries)
            except (ValueError, MemoryError, SimulationError):
                break
            change = abs(trial.evaluation.psi / found.evaluation.psi - 1.0)
            trial = found
            if change <= self.kind.still:
                break
        return trial, change

    def tightened(self, best: Trial, fine: Trial) -> dict[str, float]:
        """What to `spare` where bounds are kept by the ``best``, and not on its ``fine`` meshes.

        Empty where they are kept on these, or on neither.
        """
        if fine.excess <= _HELD or best.excess > _HELD:
            return {}
        off = {name: fine.kept[name] - value + _HELD for name, value in best.excesses.items()}
        return {name: max(value, self.spare.get(name, 0.0)) for name, value in off.items()}

    def simpler(
        self, trial: Trial, costs: dict[str, Costs], weight: float, last: bool
    ) -> tuple[Trial, int]:
        """Without struts and holes that do not pay, and how many of them went; collective.

        After the ``last`` step no size may be missed by it, as none mends that any more.
        """
        removed, most = 0, max(trial.missed, _HELD) if last else math.inf
        for name, boundary in trial.boundaries.items():
            best, fewer = None, 0
            for changed, fewest in self.kind.simpler(boundary, costs[name]):
                try:
                    other = self.tried({**trial.boundaries, name: changed})
                except (ValueError, SimulationError):
                    continue
                if other.missed > most:
                    continue
                if best is None or other.carries(weight) < best.carries(weight):
                    best, fewer = other, fewest
            if best is not None and best.carries(weight) < trial.carries(weight) + _GONE:
                removed += fewer
                trial = best
        return trial, removed


@dataclass(frozen=True, eq=False)
class _Step:
    """A step of all boundaries."""

    offsets: dict[str, Array]  #: Of the controls along their normals, by body [m]
    costs: dict[str, Costs]  #: Of struts, by body
    of_bounds: float  #: Sum of the multipliers of all bounds, in units of log psi


def _of_stress(problem: Problem, spare: float) -> dict[str, float]:
    """What to ``spare`` of bounds of a largest stress, by their names."""
    return {c.label: spare for c in problem.constraints if _is_stress(c.objective)}


def _is_stress(objective: Objective) -> bool:
    return any(isinstance(term, PeakStress) for _, term in objective._summands())


def _kind(problem: Problem) -> Kind[Any]:
    """What the boundaries of its designed bodies are."""
    first = next(iter(problem.flexible.values()))
    return _KINDS[first.domain.dimension]


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
    """Lower the objective by moving the boundaries of parts; collective.

    Each step makes new meshes that fit the boundaries, and takes the exact derivative with respect
    to each of their nodes. Constraints of the problem, the volume, and the minimum size of members,
    gaps and radii are linear constraints of the step. Every five steps struts whose minimum width
    costs more than they carry, and holes that close, are tried without, and normal modes are added
    where they do not suffice. Ctrl-C ends the run after the step at hand.

    The result is told by finer meshes. Where these exceed a bound that those of the steps keep, it
    is tightened by the difference, and four more steps follow, up to three times.

    Args:
        problem: As the parts were designed.
        boundary: Of the part; of several designed bodies a mapping from their names to one each.
        volume: Upper bound of the filled share of the body, of several one for each, or None.
        variables: Values of designs without a domain by name, shape (size,), and densities of
            bodies that stay as they are, (cells,).
        iterations: Number of gradients, at most, but for those that then mend a bound.
        size: Of the triangles [m]; by default 3.2 minimum members, or what gives 800 triangles.
        mode_tolerance: Relative error of psi by the normal modes that a body leaves out, above
            which it gets more; None leaves the modes as they are.
        progress: Show a progress bar on rank 0.

    Returns:
        The best boundaries, on every rank.

    Raises:
        TypeError: On every rank, if an argument is of a wrong kind.
        ValueError: On every rank, if a number is out of range, a designed body has no boundary, psi
            is not positive, or boundaries that are given cannot be meshed.
        SimulationError: On every rank, if those parts cannot be simulated.

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
    kind = _kind(problem)
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
    turn = _TURN if any(map(_is_stress, objectives)) else math.inf
    descent = _Descent(problem, bounds, sizes, others, turn, _of_stress(problem, _SPARE))
    ordered = {name: given[name] for name in names}
    return _descended(descent, ordered, steps, mode_tolerance, progress, checkpoint)


def _descended(
    descent: _Descent,
    boundaries: dict[str, Boundary | Surface],
    steps: int,
    tolerance: float | None,
    progress: bool,
    checkpoint: StepsCheckpoint | None,
) -> BoundaryResult:
    """The best of all steps; collective."""
    comm = ranks_of(descent.problem)
    first = {name: body.modes for name, body in descent.problem.flexible.items()}
    silent = not progress or comm.rank > 0
    with (
        tqdm(total=steps, desc="boundary", unit="step", disable=silent) as bar,
        warnings_above(bar),
        interruptible(comm) as interrupted,
    ):
        pace, reason, removed = descent.kind.pace, "iterations", 0
        if checkpoint is not None and (kept := checkpoint.load(boundaries)):
            descent, trial, best = descent.restored(kept)
            checkpoint.check(kept, trial.evaluation.psi)
            errors = known = kept.errors
            reach, weight, margin = kept.learnt.reach, kept.learnt.weight, kept.learnt.margin
            told, shown = kept.told, kept.shown
            bar.update(len(told) - 1)
        else:
            trial = descent.tried(boundaries)
            descent, trial, errors = descent.accurate(trial, tolerance, first)
            best, known = trial, errors
            reach, weight, margin = _FIRST, _OF_BOUNDS, 0.0
            told = [trial.told(0.0, 0, 0)]
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
                reach = min(reach, 2.0 * _NOISE)  # what is near its best moves little
                last += _MENDING
                bar.total = last
            if asked := interrupted():
                reason = "terminated" if asked == signal.SIGTERM else "interrupted"
                break
            slopes, rejected, found = descent.slopes(trial, margin), 0, None
            while found is None and reach >= pace.shortest:
                step = descent.step(trial, slopes, reach)
                weight = max(weight, _EXACT * step.of_bounds)
                found = descent.moved(trial, step)
                if found is not None and found.merit(weight) > trial.merit(weight) + pace.rise:
                    # shorter steps change the largest stress less than another mesh does
                    if descent.turn < math.inf and reach <= _NOISE:
                        break
                    found = None
                if found is None:
                    reach, rejected = 0.5 * reach, rejected + 1
            if found is None:
                reason = "no better step"
                break
            better = found.merit(weight) < trial.merit(weight)
            reach = min(reach * (_LONGER if better else pace.shorter), _LONGEST)
            if descent.turn < math.inf:
                reach = max(reach, _NOISE)
                # its largest value is always a little more than its slopes say
                late = _TIGHTENED * found.excess if found.excess > _HELD else -0.2 * margin
                margin = min(margin + late, _TIGHTEST)
            trial, removed = found, 0
            if number % EVERY == 0 or number == last:
                trial, removed = descent.simpler(trial, step.costs, weight, number >= steps)
                grown, trial, errors = descent.accurate(trial, tolerance, first)
                if grown is not descent:  # what was told with fewer modes does not count
                    descent, best = grown, trial
                reach = max(reach, pace.again)
            if trial.rank(weight, _GONE if removed else 0.0) <= best.rank(weight):
                best, known = trial, errors
            longest = max(float(np.max(np.abs(a))) for a in step.offsets.values())
            told.append(trial.told(longest, rejected, removed))
            for name, film in shown.items():
                film.append(trial.boundaries[name].material)
            bar.set_postfix_str(f"psi {trial.evaluation.psi:.5g}")
            bar.update()
            if checkpoint:
                learnt = Learnt(trial.evaluation.psi, reach, weight, margin)
                checkpoint.save(descent.kept(learnt, trial, best, known, told, shown))
        if reason != "iterations":
            ends.append(descent.finer(best))
        best, change = min(ends, key=lambda end: end[0].rank(weight))
        told.append(best.told(0.0, 0, 0))
        if checkpoint:
            checkpoint.tell(told)
        for name, film in shown.items():
            film.append(best.boundaries[name].material)
    _warn_of_missed(best, descent.kind, change)
    history = {key: np.array([row[key] for row in told]) for key in told[0]}
    of_best = best.boundaries, best.problem, best.evaluation
    over = {name: value for name, value in best.excesses.items() if value > _HELD}
    begun = partial(descent.resolved, boundaries)
    return BoundaryResult(*of_best, history, reason, known, shown, over, begun)


def _warn_of_missed(trial: Trial, kind: Kind[Any], change: float) -> None:
    """Warn of bounds and sizes that do not hold, of coarse meshes, and of what the parts are."""
    said = [
        f"{name!r} is violated by {over:.1%} of its bound"
        for name, over in trial.excesses.items()
        if over > _MISSED
    ]
    for found, what in ((trial.sizes, "a member or gap"), (trial.radii, "a radius")):
        said += [
            f"{what} of {name!r} is {rows.missed:.1%} below its minimum"
            for name, rows in found.items()
            if rows.missed > _MISSED
        ]
    if said:
        warnings.warn(
            f"boundary: {'; '.join(said)}: take more iterations, another start or other bounds",
            PartWarning,
            stacklevel=5,
        )
    if change > kind.still:
        told = (
            f"psi still changes by {change:.1%} on the finest mesh, by which it is told"
            if math.isfinite(change)
            else "psi is told by the mesh of the steps, as no finer one could be made"
        )
        warnings.warn(
            f"boundary: {told}: take smaller cells of the body, or a smaller size",
            PartWarning,
            stacklevel=5,
        )
    for name, boundary in trial.boundaries.items():
        for text in kind.said(boundary):
            warnings.warn(f"boundary: {name!r}: {text}", PartWarning, stacklevel=5)
