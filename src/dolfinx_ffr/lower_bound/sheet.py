# SPDX-License-Identifier: MIT
"""The best sheet of variable thickness: a convex problem, solved by separable approximations.

Of the derivative m - e of psi by a density, e comes from its stiffness. Were the forces in the body
fixed, its energy would change with x^2 e / y from the density x to y, which gives the step

    y = x sqrt(e / (m + lambda)),      or 1 where m + lambda <= 0,

with the multiplier lambda of the volume. It leads downhill, and is shortened until psi falls.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from tqdm.auto import tqdm

from ..arrays import Array
from ..fem import Domain
from ..objective import Combination
from .certificate import least_over_cells, room_of
from .quasi_static import BodyHistory, Driven, QuasiStatic, StaticBody, Support

#: Least density of a designed cell while a sheet is sought, so that nothing of it falls apart: ten
#: times as much, or a tenth, changes the bound of a rod by 1e-5 of it
LEAST = 1e-3
#: Logarithm of the largest multiplier over the least, which is round-off beside it, and bisections
#: of this range, after which the multiplier has thirteen digits
_RANGE, _BISECTIONS = 60.0, 50
#: Time after which the progress of a search is shown [s]
_QUIET = 3.0
#: Shortest step, as a share of the full one: below it round-off decides
_SHORTEST = 1.0 / 64.0


def best_sheet(
    bodies: Mapping[str, StaticBody],
    cases: Mapping[str, Driven],
    volume: Mapping[str, float],
    combine: Combination,
    tolerance: float,
    iterations: int,
) -> tuple[QuasiStatic, Support]:
    """The sheet with the least psi, and the highest bound that was found on the way; collective.

    It ends where both differ by less than the ``tolerance``, relative to psi.
    """
    domains = {name: body.body.domain for name, body in bodies.items()}
    state = QuasiStatic.at(
        bodies, cases, {n: _filled(d, volume.get(n)) for n, d in domains.items()}
    )
    weights = _weights(combine, state.psi, {name: combine.weight(name) for name in cases})
    highest, best = -np.inf, None
    rank = next(iter(domains.values())).comm.rank
    bar = tqdm(
        range(iterations),
        "lower bound",
        unit="step",
        leave=False,
        delay=_QUIET,
        disable=rank > 0,
    )
    for _ in bar:
        support = state.support(weights)
        value = least_over_cells(support, bodies, volume)
        if value > highest:
            highest, best = value, support
        psi = combine.value(state.psi)
        bar.set_postfix_str(f"apart {100.0 * (1.0 - highest / psi):.2g} %", refresh=False)
        if psi - highest <= tolerance * psi:
            break
        target = {
            name: stepped(domains[name], x, support.histories[name], volume.get(name))
            for name, x in state.densities.items()
        }
        state, moved = _downhill(state, target, weights)
        if not moved and not combine.bounds:
            break
        weights = _weights(combine, state.psi, weights)
    bar.close()
    assert best is not None
    return state, best


def stepped(domain: Domain, x: Array, history: BodyHistory, share: float | None) -> Array:
    """The minimiser of the separable approximation of psi at ``x``, within the volume, (cells,)."""
    sizes, designed = domain.cell_volumes, domain.design_cells
    m, e = history.by_mass / sizes, np.maximum(-history.by_stiffness / sizes, 0.0)
    room = room_of(domain, share)

    def at(multiplier: float) -> Array:
        cost = m + multiplier
        y = np.ones_like(x)
        np.divide(e, cost, out=y, where=cost > 0.0)
        y = np.clip(x * np.sqrt(y), LEAST, 1.0)
        return np.where(designed, np.where(cost > 0.0, y, 1.0), domain.passive_density)

    def filled(y: Array) -> float:
        return domain.sum(np.where(designed, y * sizes, 0.0))

    y = at(0.0)
    if filled(y) <= room:
        return y
    largest = max(domain.everywhere(e + np.abs(m))) / LEAST**2
    low, high = np.log(largest) - _RANGE, np.log(largest)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if filled(at(np.exp(middle))) > room else (low, middle)
    return at(np.exp(high))


def _filled(domain: Domain, share: float | None) -> Array:
    """Designed cells of one density that the volume allows."""
    size = domain.sum(domain.cell_volumes * domain.design_cells)
    density = 0.5 if share is None else min(room_of(domain, share) / size, 1.0)
    return np.where(domain.design_cells, max(density, LEAST), domain.passive_density)


def _downhill(
    state: QuasiStatic, target: Mapping[str, Array], weights: Mapping[str, float]
) -> tuple[QuasiStatic, bool]:
    """The state on the way to the ``target`` densities where psi is less, and whether it is."""
    start = _weighted(state.psi, weights)
    share = 1.0
    while share >= _SHORTEST:
        x = {n: y + share * (target[n] - y) for n, y in state.densities.items()}
        trial = QuasiStatic.at(state.bodies, state.cases, x)
        if _weighted(trial.psi, weights) < start:
            return trial, True
        share *= 0.5
    return state, False


def _weighted(psi: Mapping[str, float], weights: Mapping[str, float]) -> float:
    return sum(weights[name] * value for name, value in psi.items())


def _weights(
    combine: Combination, psi: Mapping[str, float], before: Mapping[str, float]
) -> dict[str, float]:
    """Weights of the load cases with which to go on: of a worst case those that even it out."""
    if not combine.bounds:
        return combine.slopes(psi)
    weighted = combine.weighted(psi)
    largest = max(weighted.values())
    shares = {n: before[n] / combine.weight(n) * weighted[n] / largest for n in weighted}
    total = sum(shares.values())
    return {n: combine.weight(n) * shares.get(n, 0.0) / total for n in psi}
