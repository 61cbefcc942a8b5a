# SPDX-License-Identifier: MIT
"""Parameters of the mechanisms of a problem's load cases."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import ArrayLike

from ..dynamics import assemble_model, influence
from ..mechanical_problem import MechanicalProblem
from ..mechanism import Parameters, ParametricMechanism, TopologyError
from ..objective import Response

Cases = Mapping[str, MechanicalProblem]

#: Instants at which it is looked whether anything depends on a parameter
INSTANTS = 1001


def parametric(cases: Cases) -> dict[str, ParametricMechanism]:
    """The mechanisms with parameters, by load case."""
    given = {name: case.mechanism for name, case in cases.items()}
    return {name: m for name, m in given.items() if isinstance(m, ParametricMechanism)}


def shared(cases: Cases) -> Parameters | None:
    """The parameters that all load cases share, or a ValueError if they have different ones."""
    found = {name: mechanism.parameters for name, mechanism in parametric(cases).items()}
    first = next(iter(found), "")
    for name, each in found.items():
        if each != found[first]:
            raise ValueError(
                f"problem: the load cases {first!r} and {name!r} have different parameters, "
                f"{found[first]} and {each}; make all mechanisms by the same ffr.Parameters"
            )
    return found.get(first)


def apart(
    x: ArrayLike | Mapping[str, ArrayLike], bodies: Collection[str], parameters: Parameters | None
) -> tuple[str, ArrayLike | None, ArrayLike | Mapping[str, ArrayLike]]:
    """The name and the values of parameters among densities, and the rest; "" without any."""
    if parameters is None:
        return "", None, x
    if not isinstance(x, Mapping):
        return ("", None, x) if bodies else ("parameters", x, {})
    names = [name for name in x if name not in bodies]
    if len(names) != 1:
        return "", None, x
    return names[0], x[names[0]], {name: part for name, part in x.items() if name in bodies}


def check_influence(cases: Cases, given: Response) -> None:
    """Refuse parameters on which nothing depends, and functions that make other topologies.

    The bodies of any design are ``given``.
    """
    mechanisms = parametric(cases)
    idle: set[str] = set()
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
        model = assemble_model(mechanism, case.response(given).bodies, times, checked=True)
        own = set(influence(model))
        idle = own if name == next(iter(mechanisms)) else idle & own
    if idle:
        said = ", ".join(map(repr, sorted(idle)))
        raise ValueError(
            f"parameters: nothing depends on {said}: take them out, or use them in the function "
            "that makes the mechanism"
        )
