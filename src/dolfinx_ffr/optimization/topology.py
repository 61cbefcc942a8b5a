# SPDX-License-Identifier: MIT
"""Changes of the topology between steps of the boundary: inserted and deleted members."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from ..arrays import Array
from ..boundary import Boundary, StrutShares, slides
from ..problem import Evaluation
from ..reduction import Struts
from .descent import Descent, Slopes, Trial
from .trial_failed import TrialFailed, shaping


def changed(
    descent: Descent,
    trial: Trial,
    evaluation: Evaluation,
    multipliers: Array,
    weight: float,
) -> tuple[Trial, int, int]:
    """Insert promising struts or windows, delete idle struts; the trial and both counts.

    The ``evaluation`` of the trial with its derivatives, and the ``multipliers`` of its bounds,
    choose what is tried. The value decides: log psi with a ``weight`` of violated bounds.
    """
    options, inserted, removed = descent.options, 0, 0
    struts = first_struts = _struts(descent, trial, evaluation, multipliers)
    while inserted < options.changes:
        better = _with_insertion(descent, trial, struts, weight)
        if better is None:
            break
        trial, inserted = better[0], inserted + better[1]
        differentiated = trial.problem.differentiate(trial.evaluation, densities=False)
        struts = _struts(descent, trial, differentiated, multipliers)
    # what was inserted counts as idle: the next strut may have made it needless
    carried = {
        name: descent.geometry.strut_shares(trial.boundaries[name], body_struts)
        for name, body_struts in first_struts.items()
    }
    # a simpler part may cost half of what a new strut must bring
    rise = 0.5 * options.worth
    for _ in range(options.changes):
        trial, fewer = _without_idle_struts(descent, trial, carried, weight, rise)
        removed += fewer
        if not fewer:
            break
    return trial, inserted, removed


def _struts(
    descent: Descent, trial: Trial, evaluation: Evaluation, multipliers: Array
) -> dict[str, Struts]:
    """Sensitivity of the Lagrangian to the stiffness of every possible strut, by body.

    Not where the largest stress counts, as that depends on more than the volume integrals, and not
    of bodies whose stiffness hardly counts.
    """
    sensitivities: dict[str, Struts] = {}
    if descent.is_stressed:
        return sensitivities
    for name in trial.boundaries:
        body, bars = trial.problem.flexible[name], evaluation.integrals_gradient or {}
        bar = bars[name].scaled(trial.logarithm.slope(evaluation.psi))
        for bound, cost in zip(evaluation.constraints.values(), multipliers, strict=False):
            if cost and bound.integrals_gradient:
                bar += bound.integrals_gradient[name].scaled(float(cost))
        struts = body.struts(evaluation.bodies[name], bar)
        if body.domain.sum(struts.carried) > descent.options.stiff:
            sensitivities[name] = struts
    return sensitivities


def _evaluated(
    descent: Descent, trial: Trial, name: str, changes: Iterator[tuple[Any, int]]
) -> Iterator[tuple[Trial, int]]:
    """The trials with one boundary changed that can be meshed and simulated, and their counts."""
    for boundary, count in changes:
        descent.tell(f"psi {trial.evaluation.psi:.5g}")
        try:
            yield descent.trial_of({**trial.boundaries, name: boundary}), count
        except TrialFailed:
            continue


def _with_insertion(
    descent: Descent, trial: Trial, struts: dict[str, Struts], weight: float
) -> tuple[Trial, int] | None:
    """The first trial with a strut across a hole, or with windows, that lowers psi; and how many.

    None if there is none.
    """
    for name, body_struts in struts.items():
        changes = descent.geometry.with_insertions(trial.boundaries[name], body_struts)
        for other, count in _evaluated(descent, trial, name, changes):
            if other.without_sizes(weight) < trial.without_sizes(weight) - descent.options.worth:
                return other, count
            other.release()
    return None


def _without_idle_struts(
    descent: Descent, trial: Trial, carried: dict[str, StrutShares], weight: float, rise: float
) -> tuple[Trial, int]:
    """The best trial without idle struts whose merit rises by less, and how many are gone."""
    removed = 0
    for name, boundary in trial.boundaries.items():
        changes = descent.geometry.without_idle_struts(boundary, carried.get(name, {}))
        best, least, fewer = trial, trial.without_sizes(weight) + rise, 0
        for other, count in _evaluated(descent, trial, name, changes):
            if other.without_sizes(weight) < least:
                best, least, fewer = other, other.without_sizes(weight), count
        trial, removed = best, removed + fewer
    return trial, removed


def shifted(
    descent: Descent, trial: Trial, slopes: Slopes, multipliers: Array, weight: float
) -> tuple[Trial, Slopes]:
    """With crossings of struts slid to where psi is lower, and the slopes there.

    A first slide tells the curvature along each, and a second one goes by that.
    """
    boundaries = {n: b for n, b in trial.boundaries.items() if isinstance(b, Boundary)}
    motions = {n: slides(b) for n, b in boundaries.items()}
    if descent.is_stressed or not any(map(len, motions.values())):
        return trial, slopes
    offsets_of_motions = [_offsets(b, motions[n]) for n, b in boundaries.items()]
    by_motions = block_diag(*offsets_of_motions)
    ends = np.cumsum(list(map(len, offsets_of_motions)))[:-1]

    def along(found: Slopes) -> Array:
        bounds = found.slopes[len(found.values) - found.bounds :]
        return np.asarray(by_motions @ (found.psi + multipliers @ bounds))

    def slid(lengths: Array) -> Trial | None:
        each = zip(boundaries.items(), np.split(lengths, ends), strict=True)
        try:
            with shaping():
                slopes_there = {
                    n: b.slid(b.member * np.tensordot(s, motions[n], 1)) for (n, b), s in each
                }
            return descent.trial_of({**trial.boundaries, **slopes_there})
        except TrialFailed:
            return None

    options, slope = descent.options, along(slopes)
    # of crossings whose slide by a member would bring a tenth of what another change must
    slides_on = np.abs(slope) > 0.1 * options.worth
    lengths = np.where(slides_on, -options.slide * np.sign(slope), 0.0)
    first_slide = slid(lengths) if np.any(lengths) else None
    if first_slide is None:
        return trial, slopes
    slopes_there = descent.slopes(first_slide)
    bends = (along(slopes_there) - slope) * lengths / options.slide**2
    least_bends = np.abs(slope) / options.slide_reach + 1e-12
    second = slid(-slope * slides_on / np.maximum(bends, least_bends))
    best = min(trial, first_slide, second or trial, key=lambda each: each.without_sizes(weight))
    if best is second:
        return second, descent.slopes(second)
    return (first_slide, slopes_there) if best is first_slide else (trial, slopes)


def _offsets(boundary: Boundary, motions: Array) -> Array:
    """Offsets of the orbits in ``motions`` (motions, controls, 2), (motions, orbits)."""
    along_normals = np.einsum("skd,kd->sk", motions, boundary.normals)
    offsets = [boundary.mean_of_orbits(row) for row in along_normals]
    return np.array(offsets).reshape(-1, boundary.n_offsets)
