# SPDX-License-Identifier: MIT
"""Numbers of normal modes and lengths of time steps that the current design needs.

The error of psi by the modes left out is estimated every few iterations and for the result, and
modes are added where it exceeds a tolerance: a truss needs more than the full body.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping

from ..arrays import Array
from ..dynamics import SimulationError, TimeInterval, TimeStepWarning, recorded, restored_method
from ..postprocessing import mode_error, propose_modes
from ..problem import Evaluation, Problem
from .result import of_problem, warn

#: Iterations from one estimate to the next: it costs about as much as a value
EVERY = 5
#: Share of the tolerance for which modes are added, so that they suffice for a while
ROOM = 0.5
#: Largest factor by which the number of modes of a body grows in a run; if more are needed, these
#: are modes of nearly void pieces
MOST = 4


def chosen_methods(problem: Problem) -> list[str]:
    """Method and steps of each load case where they were chosen, "" for others."""
    if not isinstance(problem, Problem):  # one of the user's own
        return []
    texts = []
    for case in problem.load_cases.values():
        method = case.integrator
        left_open = isinstance(method, TimeInterval) or method.chosen_for is None
        texts.append("" if left_open else recorded(case.method))
    return texts


def with_methods(problem: Problem, chosen: Iterable[str]) -> Problem:
    """The problem with the methods and steps that `chosen_methods` gave."""
    cases = zip(problem.load_cases, map(str, chosen), strict=False)
    methods = {name: restored_method(text) for name, text in cases if text}
    return problem.with_integrators(methods) if methods else problem


def with_steps_for(
    problem: Problem, x: Mapping[str, Array], evaluation: Evaluation
) -> tuple[Problem, Evaluation]:
    """The problem with time steps chosen anew where they do not suffice, and the evaluation by it.

    A TimeStepWarning is given if none suffice, or if their error cannot be estimated.
    """
    if not isinstance(problem, Problem):  # one of the user's own
        return problem, evaluation
    problem = problem.at_evaluation(evaluation)
    try:
        changed = problem.with_steps_for(evaluation)
        if changed is problem:
            return problem, evaluation
        return changed, changed.value(of_problem(x))
    except SimulationError as error:  # what was designed so far must not be lost for an estimate
        warnings.warn(
            "optimize: the error of the time steps cannot be estimated, as no motion with other "
            f"steps was found ({error})",
            TimeStepWarning,
            stacklevel=4,
        )
        return problem, evaluation


def with_enough_modes(
    problem: Problem,
    x: Mapping[str, Array],
    evaluation: Evaluation,
    tolerance: float,
    first: Mapping[str, int],
) -> tuple[Problem, Evaluation, dict[str, float]]:
    """The problem with more normal modes where it needs them, the evaluation, and errors by body.

    ``first`` are the numbers of modes with which the run began. A DesignWarning says if the errors
    of psi stay above the tolerance with four times those, or with all that the mesh has, or cannot
    be estimated; then they are NaN.
    """
    if not evaluation.is_simulated:
        return problem, evaluation, dict.fromkeys(problem.flexible, 0.0)
    grown = problem = problem.at_evaluation(evaluation)
    evaluated = evaluation
    try:
        while True:
            errors = mode_error(grown, evaluated)
            missing = [name for name, error in errors.items() if error > tolerance]
            if not missing:
                break
            proposed = propose_modes(grown, evaluated, tolerance=ROOM * tolerance)
            added = {}
            for name, body in ((name, grown.flexible[name]) for name in missing):
                limit = min(MOST * max(first[name], 4), body.reduction.most_modes)
                if (count := min(max(proposed[name], body.modes + 2), limit)) > body.modes:
                    added[name] = count
            if not added:
                short = max(errors, key=lambda name: errors[name])
                warn(
                    f"optimize: {grown.flexible[short].modes} normal modes of {short!r} leave out "
                    f"{errors[short]:.2%} of psi, more than {tolerance:.2%}: begin with more "
                    "modes, or look for loose or nearly void pieces, whose vibrations fill the "
                    "modes"
                )
                break
            grown = grown.with_modes(added)
            evaluated = grown.value(of_problem(x))
    except RuntimeError as error:  # what was designed so far must not be lost for an estimate
        motion = "the motion with them" if isinstance(error, SimulationError) else "they"
        warn(
            f"optimize: the effect of truncated modes on psi cannot be estimated, as {motion} "
            f"cannot be computed ({error}): look for loose or nearly void pieces, or take shorter "
            "steps"
        )
        return problem, evaluation, dict.fromkeys(problem.flexible, math.nan)
    return grown, evaluated, errors
