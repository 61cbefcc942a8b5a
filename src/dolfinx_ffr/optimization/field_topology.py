# SPDX-License-Identifier: MIT
"""Changes of the topology of boundaries that are fields, each tried and kept if it is better.

Material is displaced as a whole, missing members are joined to it, holes pierce it, idle members
are cut, and small voids are filled. The adjoint fields choose what is tried, and a value decides.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import shapely

from ..arrays import Array
from ..boundary_field import (
    BoundaryField,
    best_hole,
    best_member,
    cut,
    most_idle,
    small_voids,
    translated,
    united,
)
from ..problem import Evaluation
from ..reduction import Struts
from .field_trial import FieldGradients, FieldProblem, FieldTrial
from .trial_failed import TrialFailed, shaping

#: Least share of psi that a body's stiffness carries: else members are no springs that count
_STIFF = 0.1
#: Changes of one kind at one time
_MOST = 8

Promising = Callable[[BoundaryField, Struts], shapely.Geometry | None]


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
    noise, evaluation = problem.options.noise, gradients.evaluation
    ends = np.cumsum([len(field.variables) for field in trial.fields.values()])[:-1]
    slopes = np.split(gradients.psi, ends)
    for name, slope in zip(tuple(trial.fields), slopes, strict=True):
        change = partial(translated, slope=slope)
        trial = _better(problem, trial, name, change, weight, -noise) or trial
    if trial.evaluation is not gradients.evaluation:
        evaluation = trial.problem.differentiate(trial.evaluation, densities=False)
    own = _struts(trial, evaluation, costs)
    kinds: list[tuple[Promising, Callable[..., BoundaryField], float]] = [
        (best_member, united, -noise),
        (best_hole, cut, -noise),
        (most_idle, cut, noise),
        (lambda field, _: small_voids(field), united, noise),
    ]
    for name in tuple(own):
        for promising, operation, rise in kinds:
            for _ in range(_MOST):
                shape = promising(trial.fields[name], own[name]) if name in own else None
                if shape is None:
                    break
                change = partial(operation, shape=shape)
                better = _better(problem, trial, name, change, weight, rise)
                if better is None:
                    break
                trial = better
                evaluation = trial.problem.differentiate(trial.evaluation, densities=False)
                own = _struts(trial, evaluation, costs)
    return trial


def _better(
    problem: FieldProblem,
    trial: FieldTrial,
    name: str,
    change: Callable[[BoundaryField], BoundaryField],
    weight: float,
    rise: float,
) -> FieldTrial | None:
    """The trial after a change of a body if its merit rises by less, None otherwise."""
    problem.tell(f"psi {trial.evaluation.psi:.5g}")
    try:
        with shaping():
            changed = change(trial.fields[name])
        other = problem.trial({**trial.fields, name: changed})
    except TrialFailed:
        return None
    # sizes are mended by the steps that follow
    if other.merit(weight) < trial.merit(weight) + rise:
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
