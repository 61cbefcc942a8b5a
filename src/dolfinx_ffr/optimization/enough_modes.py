# SPDX-License-Identifier: MIT
"""As many normal modes as the design at hand needs.

A full body needs few normal modes, and a truss carved from it more: what the modes left out would
add to psi changes along a run. It is estimated every few iterations and for the result
(`mode_error`), and modes are added where the estimate exceeds a tolerance.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..dynamics import SimulationError
from ..postprocessing import mode_error, propose_modes
from ..problem import Evaluation, Problem
from .result import DesignWarning, of_problem

__all__ = ["EVERY", "with_enough_modes"]

Array = NDArray[np.float64]

#: Iterations from one estimate to the next: it costs about as much as a value
EVERY = 5
#: Share of the tolerance that is left when modes are added, so that they last for a while
ROOM = 0.5
#: Factor by which the number of modes of a body grows at most in a run: where more are asked for,
#: these are modes of nearly void pieces
MOST = 4


def with_enough_modes(
    problem: Problem,
    densities: Mapping[str, Array],
    evaluation: Evaluation,
    tolerance: float,
    first: Mapping[str, int],
) -> tuple[Problem, Evaluation, dict[str, float]]:
    """The problem with more normal modes, where those that it has are not enough.

    Args:
        problem: The problem.
        densities: Of this rank's cells by body.
        evaluation: Of these densities.
        tolerance: Relative error of psi by the modes that each body leaves out.
        first: Normal modes with which the run began, by body.

    Returns:
        The problem, the evaluation by it, and the estimated errors by body, NaN where more modes,
        or the motion with them, cannot be computed; the same on every rank.

    Warns:
        DesignWarning: If the errors stay larger with four times the modes, or with all that the
            mesh has, or cannot be estimated.
    """
    if not evaluation.moves:
        return problem, evaluation, dict.fromkeys(problem.flexible, 0.0)
    try:
        return _added(problem, densities, evaluation, tolerance, first)
    except RuntimeError as error:  # what was designed so far must not be lost for an estimate
        what = "the motion with them" if isinstance(error, SimulationError) else "they"
        warnings.warn(
            f"optimize: what the modes left out would add to psi cannot be estimated, as {what} "
            f"cannot be computed ({error}): look for loose or nearly void pieces, or take shorter "
            "steps",
            DesignWarning,
            stacklevel=4,
        )
        return problem, evaluation, dict.fromkeys(problem.flexible, math.nan)


def _added(
    problem: Problem,
    densities: Mapping[str, Array],
    evaluation: Evaluation,
    tolerance: float,
    first: Mapping[str, int],
) -> tuple[Problem, Evaluation, dict[str, float]]:
    """What `with_enough_modes` returns, or the error of what cannot be computed."""
    errors = mode_error(problem, evaluation)
    while any(error > tolerance for error in errors.values()):
        wanted = propose_modes(problem, evaluation, tolerance=ROOM * tolerance)
        present = {name: problem.flexible[name].modes for name in errors}
        most = {
            name: min(MOST * max(first[name], 4), problem.flexible[name].reduction.most_modes)
            for name in errors
        }
        more = {
            name: min(max(wanted[name], present[name] + 2), most[name])
            for name, error in errors.items()
            if error > tolerance
        }
        more = {name: count for name, count in more.items() if count > present[name]}
        if not more:
            short = max(errors, key=lambda name: errors[name])
            warnings.warn(
                f"optimize: {present[short]} normal modes of {short!r} leave out "
                f"{errors[short]:.2%} of psi, more than {tolerance:.2%}: begin with more, or look "
                "for loose or nearly void pieces, whose own vibrations take the modes",
                DesignWarning,
                stacklevel=5,
            )
            break
        problem = problem.with_modes(more)
        evaluation = problem.value(of_problem(densities))
        errors = mode_error(problem, evaluation)
    return problem, evaluation, errors
