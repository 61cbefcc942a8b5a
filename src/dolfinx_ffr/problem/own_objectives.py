# SPDX-License-Identifier: MIT
"""Checks of the derivatives of users' own objectives, which no package can know to be right."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from weakref import WeakSet

import numpy as np

from ..arrays import Array
from ..body import VolumeIntegrals
from ..dynamics import assemble_model
from ..objective import Derivatives, Objective, Response, Sum, derivatives_of, value_of
from ..reduction import FlexibleBody

#: Relative change of the integrals for a central difference: its error is about 1e-10 of the slope
STEP = 1e-5
#: Relative deviation of a derivative from the central difference that is an error of the user's
WRONG = 1e-3
#: Part of a value that its round-off, divided by the step, may add to the difference
ROUND_OFF = 1e-7
#: Objectives whose derivatives are right, so that each is checked once
_CHECKED: WeakSet[Objective] = WeakSet()


def check_integrals(
    objective: Objective, response: Response, bodies: Mapping[str, FlexibleBody]
) -> None:
    """Raise a ValueError for an objective of a user that lacks derivatives by the integrals.

    At a fixed trajectory it may depend on shape functions at markers inside of a body, for
    instance, which change with its density. Each body is changed once, and the central difference
    of the value is compared with the derivatives. Markers at interfaces stay: no design by density
    moves them in the body.

    Args:
        objective: An objective or a sum; terms from this package are not checked.
        response: Where it is differentiated.
        bodies: The bodies with a density, by name.
    """
    for term in _terms(objective):
        if _is_ours(term) or term in _CHECKED:
            continue
        stated = derivatives_of(term, response)
        for name, body in bodies.items():
            _check_body(term, stated, response, name, body.markers)
        with suppress(TypeError):  # some objects take no weak references, or have no hash
            _CHECKED.add(term)


def replicated(derivatives: Derivatives, response: Response) -> dict[str, Array]:
    """Arrays of derivatives that are the same on every rank, by their names in messages."""
    arrays: dict[str, Array] = {}
    if derivatives.trajectory is not None:
        by_name = vars(derivatives.trajectory).items()
        arrays = {f"by {name} of the trajectory": array for name, array in by_name}
    for name, bar in derivatives.integrals.items():
        arrays[f"by the integrals of {name!r}"] = _in_one_unit(bar, response.bodies[name])
    return arrays


def _in_one_unit(bar: VolumeIntegrals, body: VolumeIntegrals) -> Array:
    """Derivatives by the integrals of a body times their largest entries, shape (entries,)."""
    pairs = [(np.array(bar.mass), np.array(body.mass))]
    pairs += [(getattr(bar, key), getattr(body, key)) for key in _arrays(body)]
    for marker, point in body.markers.items():
        of_marker = bar.markers[marker]
        for key in ("position", "displacement", "rotation"):
            pairs.append((getattr(of_marker, key), getattr(point, key)))
    return np.concatenate([np.ravel(a) * np.max(np.abs(b), initial=0.0) for a, b in pairs])


def _arrays(body: VolumeIntegrals) -> tuple[str, ...]:
    """Names of the arrays of a body beside its mass and its geometric stiffness."""
    return ("S", "K", "G", "N") if body.P is None else ("S", "K", "P")


def _terms(objective: Objective) -> Iterator[Objective]:
    """An objective, or the terms of a sum."""
    if isinstance(objective, Sum):
        for _, term in objective.terms:
            yield from _terms(term)
    else:
        yield objective


def _is_ours(objective: Objective) -> bool:
    """Whether an objective is one of this package, whose derivatives have tests."""
    return type(objective).__module__.partition(".")[0] == __name__.partition(".")[0]


def _check_body(
    objective: Objective,
    stated: Derivatives,
    response: Response,
    name: str,
    inside: Collection[str],
) -> None:
    """Compare the derivatives by the integrals of one body, at a fixed trajectory."""
    body = response.bodies[name]
    direction = _direction(body, inside)

    def value(step: float) -> float:
        bodies = {**response.bodies, name: body + direction.scaled(step)}
        run = response.simulated
        if run is not None:
            model = assemble_model(run.model.mechanism, bodies, run.model.times, checked=True)
            run = replace(run, model=model)
        return value_of(objective, replace(response, simulated=run, bodies=bodies))

    psi = value_of(objective, response)
    change = (value(STEP) - value(-STEP)) / (2.0 * STEP)
    bar = stated.integrals.get(name)
    slope = 0.0 if bar is None else bar.dot(direction)
    if abs(change - slope) > WRONG * max(abs(change), abs(slope)) + ROUND_OFF * abs(psi):
        raise ValueError(
            f"the derivatives of {type(objective).__name__} by the integrals of {name!r} do not "
            f"fit its value: at a fixed trajectory a change of the body changes it by "
            f"{change:.4g}, and they say {slope:.4g}. A marker inside of a body has shape "
            "functions that depend on the density: objective.marker_derivatives(response, body, "
            "marker, position=...) has these derivatives, too; for others fill in "
            "response.bodies[name].zeros_like()"
        )


def _direction(body: VolumeIntegrals, inside: Collection[str]) -> VolumeIntegrals:
    """A change of a body: each array times a factor of its own, so that no two can cancel.

    The shape functions of markers ``inside`` of the body change, too, those at interfaces do not.
    """
    factors = iter([0.7, -0.4, 0.9, 0.5, -0.8, 0.6])
    changed = body.scaled(next(factors))
    arrays = {key: next(factors) * getattr(body, key) for key in _arrays(body)}
    markers = {}
    for marker, point in body.markers.items():
        change = point.scaled(0.0)
        if marker in inside:
            change = replace(
                change, displacement=0.8 * point.displacement, rotation=-point.rotation
            )
        if point.stiffening is not None:
            change = replace(change, stiffening=-0.6 * point.stiffening)
        markers[marker] = change
    return replace(changed, **arrays, markers=markers)
