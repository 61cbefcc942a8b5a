# SPDX-License-Identifier: MIT
"""Weighted sums over the load cases of a problem, and the parameters that they share."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import ArrayLike

from ..dynamics import assemble_model, influence
from ..mechanical_problem import MechanicalProblem
from ..mechanism import Parameters, ParametricMechanism, TopologyError
from ..objective import Derivatives, Response

Cases = Mapping[str, MechanicalProblem]

#: Number of instants at which prescribed motions are compared to see which parameters matter
INSTANTS = 1001


def weighted(derivatives: Mapping[str, Derivatives], weights: Mapping[str, float]) -> Derivatives:
    """Weighted sum of derivatives by load case."""
    scaled = [p if weights[n] == 1.0 else p.scaled(weights[n]) for n, p in derivatives.items()]
    return sum(scaled[1:], scaled[0])


def parametric(cases: Cases) -> dict[str, ParametricMechanism]:
    """The mechanisms with parameters, by load case."""
    mechanisms = {name: case.mechanism for name, case in cases.items()}
    return {name: m for name, m in mechanisms.items() if isinstance(m, ParametricMechanism)}


def shared(cases: Cases) -> Parameters | None:
    """The parameters that all load cases share, or a ValueError if they have different ones."""
    by_case = {name: mechanism.parameters for name, mechanism in parametric(cases).items()}
    if not by_case:
        return None
    reference_case, reference = next(iter(by_case.items()))
    for name, parameters in by_case.items():
        if parameters != reference:
            raise ValueError(
                f"problem: the load cases {reference_case!r} and {name!r} have different "
                f"parameters, {reference} and {parameters}; make all mechanisms by the same "
                "ffr.Parameters"
            )
    return reference


def split_parameters(
    x: ArrayLike | Mapping[str, ArrayLike], bodies: Collection[str], parameters: Parameters | None
) -> tuple[str, ArrayLike | None, ArrayLike | Mapping[str, ArrayLike]]:
    """Split ``x`` into the label and the values of parameters, and the densities of ``bodies``.

    Without values of parameters the label is "" and the values are None.
    """
    if parameters is None:
        return "", None, x
    if not isinstance(x, Mapping):
        return ("", None, x) if bodies else ("parameters", x, {})
    labels = [name for name in x if name not in bodies]
    if len(labels) != 1:
        return "", None, x
    densities = {name: density for name, density in x.items() if name in bodies}
    return labels[0], x[labels[0]], densities


def check_influence(cases: Cases, reduced: Response) -> None:
    """Refuse parameters on which nothing depends, and functions that make other topologies.

    Args:
        cases: Load cases by name.
        reduced: The bodies of the problem, without a trajectory.
    """
    mechanisms = parametric(cases)
    without_influence: set[str] = set()
    for name, mechanism in mechanisms.items():
        for bound in mechanism.parameters.bounds:
            try:
                mechanism.at(bound)
            except TopologyError:
                raise
            except ValueError:  # there need not be a mechanism at these values
                continue
        case, end = cases[name], cases[name].integrator.end_time
        times = np.linspace(0.0, end, INSTANTS)
        model = assemble_model(mechanism, case.response(reduced).bodies, times, checked=True)
        in_this_case = set(influence(model))
        is_first = name == next(iter(mechanisms))
        without_influence = in_this_case if is_first else without_influence & in_this_case
    if without_influence:
        names = ", ".join(map(repr, sorted(without_influence)))
        raise ValueError(
            f"parameters: nothing depends on {names}: take them out, or use them in the function "
            "that makes the mechanism"
        )
