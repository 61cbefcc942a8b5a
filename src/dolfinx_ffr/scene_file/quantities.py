# SPDX-License-Identifier: MIT
"""Numbers with units, as "40 mm", and the units that the docstrings of the package state."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from functools import cache
from typing import Any

from ..documentation import field_comments

#: A number and what follows it
_QUANTITY = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*)?")
#: A unit in brackets, or several, "[m or rad]"; intervals and shapes are none
_STATED = re.compile(r"\[((?:1/)?[A-Za-z-][^\],]*)\]")
#: An entry of a section "Args" or "Attributes"
_ENTRY = re.compile(r"^ {4,}(\w+): +(.+(?:\n {8,}.*)*)", re.M)


def looks_like_a_number(text: str) -> bool:
    """Whether a text begins with a number."""
    return _QUANTITY.fullmatch(text.strip()) is not None


def stated_units(target: Callable[..., Any]) -> dict[str, tuple[str, ...]]:
    """The units that the documentation of a class or function states, by name of its argument."""
    said = dict(_ENTRY.findall(inspect.getdoc(target) or ""))
    if inspect.isclass(target):
        said |= field_comments(target)
    found = {name: _STATED.findall(text) for name, text in said.items()}
    return {
        name: tuple(unit for group in groups for unit in group.split(" or "))
        for name, groups in found.items()
        if groups
    }


def in_si(text: str, units: tuple[str, ...]) -> float:
    """A number with a unit in SI units, which must be one of some ``units``; any if there are none.

    Radians count: a moment is no stiffness by angle, and turns a second are no hertz.
    """
    match = _QUANTITY.fullmatch(text.strip())
    if match is None:
        raise ValueError(f'{text!r} is no number; write 0.04, or with its unit "40 mm"')
    number, unit = float(match[1]), match[2]
    if unit is None:
        return number
    try:
        factor, kind = _base(unit)
    except Exception as error:  # what a reader of units meets within a text
        raise ValueError(f"{unit!r} is no unit that is known (in {text!r})") from error
    if units and kind not in {_base(known)[1] for known in units}:
        needed = " or ".join(known if known != "-" else "a number without unit" for known in units)
        raise ValueError(f"{text!r} has a wrong unit: it takes {needed}")
    return number * factor


@cache
def _base(unit: str) -> tuple[float, str]:
    """What one of a unit is in base units of SI, and these."""
    if unit == "-":
        return 1.0, "dimensionless"
    factor, base = _registry().get_base_units(_registry().parse_units(unit.replace("°", "deg")))
    if unit.count("deg") and "kelvin" in str(base):
        raise ValueError("temperatures have no part here")
    return float(factor), str(base)


@cache
def _registry() -> Any:
    """The units that are known."""
    import pint  # takes a second

    registry = pint.UnitRegistry()
    registry.define("rev = turn")
    return registry
