# SPDX-License-Identifier: MIT
"""Changes of the topology of boundaries that are fields, each tried and kept if it is better.

Material is displaced as a whole, missing members are joined to it, holes pierce it, idle members
are cut, and small voids are filled. The adjoint fields choose what is tried, and a value decides.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

from ..arrays import Array
from ..boundary_field import MovingBoundary, split_by_boundary
from ..problem import Evaluation
from ..reduction import Struts
from .field_trial import FieldGradients, FieldProblem, FieldTrial
from .trial_failed import TrialFailed, shaping


def with_better_topology(
    problem: FieldProblem, trial: FieldTrial, gradients: FieldGradients, costs: Array, weight: float
) -> FieldTrial:
    """The trial with material displaced and members and holes that lower psi, without idle ones.

    Of each kind the most promising change is tried, and the next one if that was better;
    collective.

    Args:
        problem: What is lowered.
        trial: Where the steps are.
        gradients: Of the trial.
        costs: What all constraints cost, sizes first and others last, as shares of psi.
        weight: Of the largest violation of constraints and volumes in the merit.
    """
    if problem.turn < math.inf:  # the largest stress depends on more than the integrals
        return trial
    for name, slope in split_by_boundary(gradients.psi, trial.fields).items():
        moved = partial(trial.fields[name].translated, slope)
        trial = _first_better(problem, trial, name, _one(moved), weight, simplifies=False) or trial

    evaluation = gradients.evaluation
    if trial.evaluation is not evaluation:
        evaluation = trial.problem.differentiate(trial.evaluation, densities=False)
    struts = _struts(problem, trial, evaluation, costs)
    for name in tuple(struts):
        for change in trial.fields[name].changes:
            # each change lowers psi by what it is worth, or leaves fewer holes, or is the last one
            ends = False
            while name in struts and not ends:
                candidates = change.candidates(trial.fields[name], struts[name])
                better = _first_better(
                    problem, trial, name, candidates, weight, simplifies=change.simplifies
                )
                if better is None:
                    break
                fewer = better.fields[name].n_holes < trial.fields[name].n_holes
                ends = change.simplifies and not fewer
                trial = better
                evaluation = trial.problem.differentiate(trial.evaluation, densities=False)
                struts = _struts(problem, trial, evaluation, costs)
    return trial


def _one(make: Callable[[], MovingBoundary | None]) -> Iterator[MovingBoundary]:
    """The boundary that is made, if it is one."""
    boundary = make()
    if boundary is not None:
        yield boundary


def _first_better(
    problem: FieldProblem,
    trial: FieldTrial,
    name: str,
    candidates: Iterator[MovingBoundary],
    weight: float,
    *,
    simplifies: bool,
) -> FieldTrial | None:
    """The first trial with another boundary of a body that is worth its change, None otherwise."""
    worth = problem.options.worth
    highest = trial.merit(weight) + (worth if simplifies else -worth)
    while True:
        problem.tell(f"psi {trial.evaluation.psi:.5g}")
        try:
            with shaping():
                changed = next(candidates, None)
            if changed is None:
                return None
            other = problem.trial({**trial.fields, name: changed})
        except TrialFailed:
            continue  # a generator that has failed is at its end
        # sizes are mended by the steps that follow
        if other.merit(weight) < highest:
            return other
        other.release()


def _struts(
    problem: FieldProblem, trial: FieldTrial, evaluation: Evaluation, costs: Array
) -> dict[str, Struts]:
    """What members carry, and others would, of log psi and of constraints, by body; collective.

    Not of bodies whose stiffness hardly counts.
    """
    struts: dict[str, Struts] = {}
    bounds = list(evaluation.constraints.values())
    # the constraints of the problem stand before the volumes
    multipliers = costs[len(costs) - len(trial.violations) :][: len(bounds)]
    for name in trial.fields:
        body, gradients = trial.problem.flexible[name], evaluation.integrals_gradient or {}
        bar = gradients[name].scaled(trial.logarithm.slope(evaluation.psi))
        for bound, cost in zip(bounds, multipliers, strict=False):
            if cost and bound.integrals_gradient:
                bar += bound.integrals_gradient[name].scaled(float(cost))
        body_struts = body.struts(evaluation.bodies[name], bar)
        if body.domain.sum(body_struts.carried) > problem.options.stiff:
            struts[name] = body_struts
    return struts
