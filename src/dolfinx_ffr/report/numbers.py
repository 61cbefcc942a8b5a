# SPDX-License-Identifier: MIT
"""Numbers for readers: few digits, a unit of the right size, and aligned points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeGuard

from .. import validation

#: Text for a number that is not known
NOTHING = "–"
#: Spaces as wide as a digit and as a point
_DIGIT, _POINT = "\u2007", "\u2008"
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
#: Units that engineers use in place of SI units, and the factor from SI
_USUAL = {"m": ("mm", 1e3), "m^2": ("mm²", 1e6), "rad": ("rad", 1.0), "-": ("", 1.0)}
#: Units whose first letter takes a prefix
_PREFIXED = ("J", "J s", "N", "N m", "W", "Pa", "Hz", "s")


def real(value: Any) -> TypeGuard[float]:
    """Whether something is a finite number."""
    return validation.is_number(value) and math.isfinite(value)


class Scale:
    """A unit that suits the size of a number, or of the largest of several, for an SI ``unit``."""

    def __init__(self, unit: str, value: Any) -> None:
        size = abs(float(value)) if real(value) else 0.0
        #: Name of the unit
        self.name = unit.replace("^2", "²").replace("^3", "³")
        #: Size of the SI unit in this unit
        self.factor = 1.0
        if unit in _USUAL:
            self.name, self.factor = _USUAL[unit]
        elif unit == "kg" and 0.0 < size < 0.1:
            self.name, self.factor = "g", 1e3
        elif unit == "Pa" and 1e6 <= size < 1e10:
            self.name, self.factor = "MPa", 1e-6
        elif unit == "Hz" and size < 1e5:
            pass
        elif unit in _PREFIXED and size > 0.0 and not 0.1 <= size < 1e3:
            size_of_prefix, prefix = next(
                (p for p in _PREFIXES if size >= 0.999999 * p[0]), _PREFIXES[-1]
            )
            self.name, self.factor = prefix + self.name, 1.0 / size_of_prefix

    def text(self, value: Any, digits: int = 4) -> str:
        """A number of SI in this unit, with a number of significant digits."""
        return fixed(value * self.factor, digits) if validation.is_number(value) else NOTHING

    @staticmethod
    def of(unit: str, value: Any, digits: int = 4) -> tuple[str, str]:
        """A number of SI in a unit that suits it, and the name of this unit."""
        scale = Scale(unit, value)
        return scale.text(value, digits), scale.name

    def without_zeros(self, value: Any) -> str:
        """A number of SI in this unit without zeros at its end, for numbers that users choose."""
        text = self.text(value, 6)
        return text if "×" in text or "." not in text else text.rstrip("0").rstrip(".")


def fixed(value: Any, digits: int = 4) -> str:
    """A number with a fixed point, or with a power of ten where that would be long."""
    if not validation.is_number(value) or math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "∞" if value > 0.0 else "−∞"
    if value == 0:
        return "0"
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    exponent = int(power)
    if isinstance(value, int) and abs(value) < 10**9:
        text = str(value)
    elif not -4 <= exponent <= 6:
        return f"{mantissa} × 10{str(exponent).translate(_SUPERSCRIPTS)}".replace("-", "−")
    else:
        text = f"{value:.{max(digits - 1 - exponent, 0)}f}"
    integer_part, decimal_point, decimals = text.lstrip("-").partition(".")
    if len(integer_part) > 4:  # thin spaces between thousands
        integer_part = f"{int(integer_part):,}".replace(",", "\u202f")
    return ("−" if value < 0 else "") + integer_part + decimal_point + decimals


def percent(value: Any, digits: int = 2, *, sign: bool = False) -> str:
    """A share in percent, 0.01 as "1", with a plus sign where ``sign`` asks for it."""
    if not real(value):
        return fixed(value)
    if 0.0 < abs(value) < 5e-7:
        return "< 0.0001" if value > 0.0 or not sign else "> −0.0001"
    text = fixed(round(100.0 * value, 4), digits)
    return f"+{text}" if sign and value > 0.0 else text


def aligned(texts: Sequence[str]) -> list[str]:
    """Numbers of a column, filled on the right so that their points stand below each other."""
    decimals = [None if "×" in text else text.partition(".")[2] for text in texts]
    longest = max((len(digits) for digits in decimals if digits), default=0)
    if not longest:
        return list(texts)
    fillings = [
        "" if digits is None else ("" if digits else _POINT) + _DIGIT * (longest - len(digits))
        for digits in decimals
    ]
    return [text + filling for text, filling in zip(texts, fillings, strict=True)]
