# SPDX-License-Identifier: MIT
"""Changes of the topology of boundaries that are fields, each tried and kept if it is better.

Members that are missing are united with the material, members that are idle or dear are cut, and
small voids are filled. The adjoint fields choose what is tried, and a value decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from ..arrays import Array
from ..boundary_field import (
    BoundaryField,
    cut,
    dear_or_idle,
    missing_members,
    small_voids,
    united,
)
from ..problem import Evaluation
from ..reduction import Struts
from .field_trial import FieldProblem, FieldTrial
from .trial_failed import TrialFailed, shaping

#: Least share of psi that a body's stiffness carries: else members are no springs that count
_STIFF = 0.1
#: Members that are inserted, and rounds in which things go, at one time
_MOST = 8

Change = Callable[[], BoundaryField]


def with_better_topology(
    problem: FieldProblem, trial: FieldTrial, evaluation: Evaluation, costs: Array
) -> FieldTrial:
    """The trial with members that lower psi, without what is not worth its making; collective.

    Args:
        problem: What is lowered.
        trial: Where the steps are.
        evaluation: Of the trial, with derivatives by the integrals of the bodies.
        costs: What all constraints cost, sizes first and others last, as shares of psi.
    """
    options = problem.options
    struts = _struts(trial, evaluation, costs)
    for name, own in struts.items():
        for _ in range(_MOST):
            better = _first_better(problem, trial, name, _joins(trial, name, own), options.worth)
            if better is None:
                break
            trial = better
            evaluation = trial.problem.differentiate(trial.evaluation, densities=False)
            own = _struts(trial, evaluation, costs[:0])[name]
    for name in trial.fields:
        for _ in range(_MOST):
            # costs are those of the rows of the first trial, whose places stay
            changes = _cuts(trial, name, costs, struts.get(name))
            better = _first_better(problem, trial, name, changes, -options.gone)
            if better is None:
                break
            trial, costs = better, costs[:0]
    return trial


def _joins(trial: FieldTrial, name: str, struts: Struts) -> Iterator[Change]:
    field = trial.fields[name]
    for shape in missing_members(field, struts):
        yield lambda shape=shape: united(field, shape)  # type: ignore[misc]


def _cuts(trial: FieldTrial, name: str, costs: Array, struts: Struts | None) -> Iterator[Change]:
    field, rows = trial.fields[name], trial.rows[name]
    first = 0
    for other in trial.fields:
        if other == name:
            break
        first += len(trial.rows[other].values)
    own = costs[first : first + rows.members]
    places = rows.places[: len(own)]
    for shape in dear_or_idle(field, places, own, struts):
        yield lambda shape=shape: cut(field, shape)  # type: ignore[misc]
    voids = small_voids(field)
    if voids is not None:
        yield lambda: united(field, voids)


def _first_better(
    problem: FieldProblem,
    trial: FieldTrial,
    name: str,
    changes: Iterator[Change],
    worth: float,
) -> FieldTrial | None:
    """The first change of a body by which the merit falls by what it must, None if none does."""
    weight = problem.options.bound_weight
    for change in changes:
        try:
            with shaping():
                changed = change()
            other = problem.trial({**trial.fields, name: changed})
        except TrialFailed:
            continue
        if other.merit(weight, 0.0) < trial.merit(weight, 0.0) - worth:
            return other
        other.release()
    return None


def _struts(trial: FieldTrial, evaluation: Evaluation, costs: Array) -> dict[str, Struts]:
    """What members carry, and others would, of log psi and of constraints, by body; collective.

    Not of bodies whose stiffness hardly counts.
    """
    struts = {}
    bounds = list(evaluation.constraints.values())
    # the constraints of the problem stand before the volumes
    multipliers = costs[len(costs) - len(trial.violations) :][: len(bounds)]
    for name in trial.fields:
        body, gradients = trial.problem.flexible[name], evaluation.integrals_gradient or {}
        bar = gradients[name].scaled(trial.logarithm.slope(evaluation.psi))
        for bound, cost in zip(bounds, multipliers, strict=False):
            if cost and bound.integrals_gradient:
                bar += bound.integrals_gradient[name].scaled(float(cost))
        own = body.struts(evaluation.bodies[name], bar)
        if body.domain.sum(own.carried) > _STIFF:
            struts[name] = own
    return struts
