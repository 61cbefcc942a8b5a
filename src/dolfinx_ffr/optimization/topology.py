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

    Empty where the largest stress counts, as that depends on more than the volume integrals.
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
        sensitivities[name] = body.struts(evaluation.bodies[name], bar)
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


def with_slides(
    descent: Descent, trial: Trial, slopes: Slopes, multipliers: Array, weight: float
) -> tuple[Trial, Slopes]:
    """Slide crossings of struts to where psi is lower; return the trial and its slopes.

    A first slide of each crossing shows the curvature, and a second one goes to the minimum.
    """
    crossings = _Crossings(trial)
    if descent.is_stressed or not crossings.count:
        return trial, slopes
    options, slope = descent.options, crossings.slope(slopes, multipliers)
    # of crossings whose slide by a member would bring a tenth of what another change must
    is_worth_it = np.abs(slope) > 0.1 * options.worth
    if not np.any(is_worth_it):
        return trial, slopes
    lengths = np.where(is_worth_it, -options.slide * np.sign(slope), 0.0)
    first_trial = crossings.slid(descent, trial, lengths)
    if first_trial is None:
        return trial, slopes

    first_slopes = descent.slopes(first_trial)
    change_of_slope = crossings.slope(first_slopes, multipliers) - slope
    curvature = change_of_slope * lengths / options.slide**2
    least_curvature = np.abs(slope) / options.slide_reach + 1e-12  # no slide is longer
    lengths = -slope * is_worth_it / np.maximum(curvature, least_curvature)
    second_trial = crossings.slid(descent, trial, lengths)

    trials = [trial, first_trial, second_trial or trial]
    best = min(trials, key=lambda candidate: candidate.without_sizes(weight))
    if best is trial:
        return trial, slopes
    return best, first_slopes if best is first_trial else descent.slopes(best)


class _Crossings:
    """The crossings of struts of a trial's boundaries in the plane, and how they slide."""

    def __init__(self, trial: Trial) -> None:
        self._boundaries = {
            name: boundary
            for name, boundary in trial.boundaries.items()
            if isinstance(boundary, Boundary)
        }
        self._motions = {name: slides(boundary) for name, boundary in self._boundaries.items()}
        counts = [len(motions) for motions in self._motions.values()]
        self.count = sum(counts)
        self._ends = np.cumsum(counts)[:-1]

    def slope(self, slopes: Slopes, multipliers: Array) -> Array:
        """Slopes of log psi and of the bounds with their ``multipliers`` by each slide."""
        offsets = [
            _offsets(boundary, self._motions[name]) for name, boundary in self._boundaries.items()
        ]
        bounds = slopes.slopes[len(slopes.values) - slopes.n_bounds :]
        return np.asarray(block_diag(*offsets) @ (slopes.psi + multipliers @ bounds))

    def slid(self, descent: Descent, trial: Trial, lengths: Array) -> Trial | None:
        """The trial after slides by ``lengths`` in minimum members, None if it fails."""
        try:
            with shaping():
                boundaries = {
                    name: boundary.slid(
                        boundary.member * np.tensordot(body_lengths, self._motions[name], 1)
                    )
                    for (name, boundary), body_lengths in zip(
                        self._boundaries.items(), np.split(lengths, self._ends), strict=True
                    )
                }
            return descent.trial_of({**trial.boundaries, **boundaries})
        except TrialFailed:
            return None


def _offsets(boundary: Boundary, motions: Array) -> Array:
    """Offsets of the orbits in ``motions`` (motions, controls, 2), (motions, orbits)."""
    along_normals = np.einsum("skd,kd->sk", motions, boundary.normals)
    offsets = [boundary.mean_of_orbits(row) for row in along_normals]
    return np.array(offsets).reshape(-1, boundary.n_offsets)
