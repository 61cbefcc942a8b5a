# SPDX-License-Identifier: MIT
"""Changes of the topology between steps of the boundary: what is missing, and what may go."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from ..arrays import Array
from ..boundary import Boundary, Costs, slides
from ..problem import Evaluation
from ..reduction import Struts
from .descent import Descent, Slopes, Step, Trial
from .trial_failed import TrialFailed, shaping

#: Fall of log psi at least for which a strut is inserted, rise up to which one, or a hole, goes,
#: and where no step is better otherwise
_WORTH, GONE, _STUCK = 1e-3, 5e-4, 2e-3
#: Least share of psi that a body's stiffness carries
_STIFF = 0.1
#: How often struts are inserted, and things go, between two steps
_MOST = 8
#: First slide of crossings, the slope of log psi at least for which it is tried, and the longest
#: one, in minimum members
_SLIDE, _SLOPE, _FARTHEST = 1.0, 1e-4, 4.0


def changed(
    descent: Descent,
    trial: Trial,
    evaluation: Evaluation,
    step: Step,
    weight: float,
    stuck: bool,
    first: bool,
) -> tuple[Trial, int, int]:
    """With struts and windows that were missing, without what does not pay.

    And how many of both.

    The ``evaluation`` is that of the trial with its derivatives, and the ``step`` the best one from
    there: they choose what is tried, and the values decide, by log psi and a ``weight`` of bounds.
    Where steps are ``stuck``, psi may rise by more; before the ``first`` small holes may yet grow.
    """
    inserted, removed = 0, 0
    given = struts = _struts(descent, trial, evaluation, step)
    while inserted < _MOST:
        more = _braced(descent, trial, struts, weight)
        if more is None:
            break
        trial, inserted = more[0], inserted + more[1]
        there = trial.problem.differentiate(trial.evaluation, densities=False)
        struts = _struts(descent, trial, there, step)
    # what was inserted counts as idle: the next strut may have made it needless
    carried = {n: descent.kind.carried(trial.boundaries[n], own) for n, own in given.items()}
    rise = _STUCK if stuck else GONE
    for _ in range(_MOST):
        trial, fewer = _simpler(descent, trial, step.costs, carried, weight, rise, first)
        removed += fewer
        if not fewer:
            break
    return trial, inserted, removed


def _struts(
    descent: Descent, trial: Trial, evaluation: Evaluation, step: Step
) -> dict[str, Struts]:
    """What struts of bodies carry, and others would, of log psi and bounds, and what holes change.

    Not where the largest stress counts, as that depends on more than the volume integrals, and not
    of bodies whose stiffness hardly counts.
    """
    found: dict[str, Struts] = {}
    if descent.turn < math.inf:
        return found
    for name in trial.boundaries:
        body, bars = trial.problem.flexible[name], evaluation.integrals_gradient or {}
        bar = bars[name].scaled(trial.logarithm.slope(evaluation.psi))
        for bound, cost in zip(evaluation.constraints.values(), step.of_bounds, strict=False):
            if cost and bound.integrals_gradient:
                bar += bound.integrals_gradient[name].scaled(float(cost))
        own = body.struts(evaluation.bodies[name], bar)
        if body.domain.sum(own.carried) > _STIFF:
            found[name] = own
    return found


def _tried(
    descent: Descent, trial: Trial, name: str, others: Iterator[tuple[Any, int, float]]
) -> Iterator[tuple[Trial, int, float]]:
    """Those of the ``others`` in the place of a boundary that can be meshed and simulated."""
    for changed, count, making in others:
        descent.tell(f"psi {trial.evaluation.psi:.5g}")
        try:
            yield descent.tried({**trial.boundaries, name: changed}), count, making
        except TrialFailed:
            continue


def _braced(
    descent: Descent, trial: Trial, struts: dict[str, Struts], weight: float
) -> tuple[Trial, int] | None:
    """With a strut across a hole, or windows, that lower psi, and how many.

    None if there are none.
    """
    for name, own in struts.items():
        others = descent.kind.braced(trial.boundaries[name], own)
        for other, count, _ in _tried(descent, trial, name, others):
            if other.carries(weight) < trial.carries(weight) - _WORTH:
                return other, count
            other.release()
    return None


def _simpler(
    descent: Descent,
    trial: Trial,
    costs: dict[str, Costs],
    carried: dict[str, Costs],
    weight: float,
    rise: float,
    first: bool,
) -> tuple[Trial, int]:
    """Without struts and holes that do not pay, and how many of them went."""
    removed = 0
    for name, boundary in trial.boundaries.items():
        others = descent.kind.simpler(boundary, costs[name], carried.get(name, {}))
        there = trial.carries(weight), trial, 0
        found = [
            (other.carries(weight) - (rise if first else max(rise, making)), other, fewer)
            for other, fewer, making in _tried(descent, trial, name, others)
        ]
        _, trial, fewer = min([there, *found], key=lambda each: each[0])
        removed += fewer
    return trial, removed


def shifted(
    descent: Descent, trial: Trial, slopes: Slopes, of_bounds: Array, weight: float
) -> tuple[Trial, Slopes]:
    """With crossings of struts slid to where psi is lower, and the slopes there.

    A first slide tells the curvature along each, and a second one goes by that.
    """
    boundaries = {n: b for n, b in trial.boundaries.items() if isinstance(b, Boundary)}
    motions = {n: slides(b) for n, b in boundaries.items()}
    if descent.turn < math.inf or not any(map(len, motions.values())):
        return trial, slopes
    by_masters = [
        np.einsum("skd,kd->sk", motions[n], b.normals) @ b.shares / b.shares.sum(axis=0).A1
        for n, b in boundaries.items()
    ]
    ways, ends = block_diag(*by_masters), np.cumsum(list(map(len, by_masters)))[:-1]

    def along(found: Slopes) -> Array:
        bounds = found.slopes[len(found.values) - found.bounds :]
        return np.asarray(ways @ (found.psi + of_bounds @ bounds))

    def slid(lengths: Array) -> Trial | None:
        each = zip(boundaries.items(), np.split(lengths, ends), strict=True)
        try:
            with shaping():
                there = {n: b.slid(b.member * np.tensordot(s, motions[n], 1)) for (n, b), s in each}
            return descent.tried({**trial.boundaries, **there})
        except TrialFailed:
            return None

    slope = along(slopes)
    lengths = np.where(np.abs(slope) > _SLOPE, -_SLIDE * np.sign(slope), 0.0)
    first = slid(lengths) if np.any(lengths) else None
    if first is None:
        return trial, slopes
    there = descent.slopes(first)
    bends = (along(there) - slope) * lengths / _SLIDE**2
    second = slid(-slope * (lengths != 0.0) / np.maximum(bends, np.abs(slope) / _FARTHEST + 1e-12))
    best = min(trial, first, second or trial, key=lambda each: each.carries(weight))
    if best is second:
        return second, descent.slopes(second)
    return (first, there) if best is first else (trial, slopes)
