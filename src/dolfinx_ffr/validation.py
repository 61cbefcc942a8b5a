# SPDX-License-Identifier: MIT
"""What arguments must be: one check and one wording for each kind, for all folders.

Each check gives back the argument in the form in which it is used, or refuses it by name: with a
TypeError where a thing of another kind is needed, with a ValueError where it is out of its range.
"""

from __future__ import annotations

import math
import os
import reprlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "by_name",
    "choice",
    "described",
    "flag",
    "function",
    "implementation",
    "instance",
    "instances",
    "instances_by_name",
    "integer",
    "is_number",
    "listed",
    "name",
    "names",
    "number",
    "numbers",
    "path",
    "plane_vector",
    "real_array",
]

T = TypeVar("T")


def described(value: Any) -> str:
    """A few words that show what was given.

    Args:
        value: Anything.
    """
    text = reprlib.repr(value)
    kind = type(value).__name__
    return text if isinstance(value, type) or kind in text else f"{text} ({kind})"


def _refused(what: str, needed: str, value: Any) -> TypeError:
    return TypeError(f"{what} must be {needed}, but it is {described(value)}")


def is_number(value: Any) -> bool:
    """Whether something is a real number; True and False, texts and arrays are none.

    Args:
        value: Anything.
    """
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_)


def number(
    what: str,
    value: Any,
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    below: float = math.inf,
    most: float = math.inf,
    unit: str = "",
) -> float:
    """A finite real number in its range.

    Args:
        what: Name of the argument, for the message.
        value: The argument.
        above: Largest number that is too small.
        least: Smallest number that is allowed.
        below: Smallest number that is too large.
        most: Largest number that is allowed.
        unit: Its unit, for the message.

    Raises:
        TypeError: If it is no real number; True and False, texts and arrays are none.
        ValueError: If it is NaN, infinite or out of its range.
    """
    found = _as_float(what, value)
    if not (math.isfinite(found) and above < found < below and least <= found <= most):
        needed = _range(above, least, below, most)
        raise ValueError(f"{what} must {needed}, but it is {value} {unit}".rstrip())
    return found


def _as_float(what: str, value: Any) -> float:
    if not is_number(value):
        raise _refused(what, "a number", value)
    try:
        return float(value)
    except OverflowError:  # whole numbers and fractions have no largest one
        raise ValueError(f"{what} is too large for a floating-point number") from None


def _range(above: float, least: float, below: float, most: float) -> str:
    """What a number in a range must do, as a message goes on after "must"."""
    low, high = max(above, least), min(below, most)
    if high == math.inf:
        if low == -math.inf:
            return "be finite"
        if low == 0.0:
            return "be positive" if above == 0.0 else "not be negative"
        return f"be above {low:g}" if above == low else f"be at least {low:g}"
    if low == -math.inf:
        return f"be below {high:g}" if below == high else f"be at most {high:g}"
    excluded = [f"{end:g}" for end, given in ((low, above), (high, below)) if end == given]
    without = ["", f", {excluded[0]} excluded" if excluded else "", ", both excluded"]
    return f"lie between {low:g} and {high:g}{without[len(excluded)]}"


def integer(what: str, value: Any, *, least: float = 0, most: float = math.inf) -> int:
    """A whole number in its range; 2.0 is one.

    Args:
        what: Name of the argument, for the message.
        value: The argument.
        least: Smallest number that is allowed.
        most: Largest number that is allowed.

    Raises:
        TypeError: If it is no real number.
        ValueError: If it is not whole, or out of its range.
    """
    found = _as_float(what, value)
    if not (found.is_integer() and least <= found <= most):
        kind = {
            -math.inf: "a whole number",
            0: "a whole number that is not negative",
            1: "a positive whole number",
        }
        needed = kind.get(least, f"a whole number of at least {least:g}")
        if most < math.inf:
            needed = f"a whole number from {least} to {most:g}"
        raise ValueError(f"{what} must be {needed}, but it is {value}")
    return int(value)


def flag(what: str, value: Any) -> bool:
    """True or False.

    Args:
        what: Name of the argument, for the message.
        value: The argument.

    Raises:
        TypeError: If it is something else.
    """
    if not isinstance(value, bool | np.bool_):
        raise _refused(what, "True or False", value)
    return bool(value)


def function(what: str, value: Any, of: str) -> None:
    """Refuse what cannot be called.

    Args:
        what: Name of the argument, for the message.
        value: The argument.
        of: What it must be a function of, for the message.

    Raises:
        TypeError: If it cannot be called.
    """
    if not callable(value):
        raise _refused(what, f"a function of {of}", value)


def name(what: str, value: Any) -> str:
    """A text.

    Args:
        what: Name of the argument, for the message.
        value: The argument.

    Raises:
        TypeError: If it is something else.
    """
    if not isinstance(value, str):
        raise _refused(what, "a text", value)
    return value


def names(what: str, value: Any) -> list[str]:
    """A list of texts.

    Args:
        what: Name of the argument, for the message.
        value: The argument.

    Raises:
        TypeError: If it is something else; a text alone is no list of texts.
    """
    if isinstance(value, str):
        raise TypeError(f"{what} must be a list of texts, as [{value!r}], but it is {value!r}")
    found = instances(what, value, str, "texts")
    # the order of a set of texts differs from process to process
    return sorted(found) if isinstance(value, set | frozenset) else found


def path(what: str, value: Any) -> Path:
    """The path of a file or folder.

    Args:
        what: Name of the argument, for the message.
        value: The argument.

    Raises:
        TypeError: If it is neither a text nor a path.
    """
    if not isinstance(value, str | os.PathLike):
        raise _refused(what, "a path", value)
    return Path(value)


def choice(what: str, value: Any, options: Iterable[str]) -> str:
    """One of several words.

    Args:
        what: Name of the argument, for the message.
        value: The argument.
        options: The words.

    Raises:
        TypeError: If it is no text.
        ValueError: If it is another text.
    """
    words = list(options)
    if name(what, value) not in words:
        one = " or ".join(map(repr, words)) if len(words) < 3 else f"one of {words}"
        raise ValueError(f"{what} must be {one}, but it is {value!r}")
    return str(value)


def real_array(
    what: str,
    value: Any,
    shape: tuple[int | None, ...] | None = None,
    *,
    expected: str = "",
) -> NDArray[np.float64]:
    """An array of finite real numbers.

    Args:
        what: Name of the argument, for the message.
        value: Numbers, or nested lists of them; True and False count as 1 and 0.
        shape: The shape that it must have; None stands for any length, or for any shape.
        expected: What the message says of the shape instead of the shape.

    Raises:
        TypeError: If it holds something else than real numbers.
        ValueError: If it has another shape, or holds NaN or infinity.
    """
    array = numbers(what, value)
    if shape is not None and not (
        len(shape) == array.ndim
        and all(n is None or n == m for n, m in zip(shape, array.shape, strict=True))
    ):
        lengths = ", ".join("n" if n is None else str(n) for n in shape)
        wanted = expected or f"shape ({lengths}{',' if len(shape) == 1 else ''})"
        raise ValueError(f"{what} must have {wanted}, but it has shape {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{what} holds NaN or infinity")
    return array


def numbers(what: str, value: Any) -> NDArray[np.float64]:
    """An array of real numbers, of any shape, NaN and infinity included.

    Args:
        what: Name of the argument, for the message.
        value: Numbers, or nested lists of them; True and False count as 1 and 0.

    Raises:
        TypeError: If it holds something else: texts, complex numbers, None.
        ValueError: If its rows have different lengths.
    """
    try:
        given = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{what} must be an array, but its rows differ in length") from error
    if given.dtype.kind not in "biuf":
        holds = {"c": "complex numbers", "U": "texts", "S": "texts"}.get(given.dtype.kind)
        shown = f"it holds {holds}" if holds and given.ndim else f"it is {described(value)}"
        raise TypeError(f"{what} must hold real numbers, but {shown}")
    return np.asarray(given, dtype=np.float64)


def plane_vector(what: str, value: Any) -> tuple[float, float]:
    """Two finite numbers.

    Args:
        what: Name of the argument, for the message.
        value: The argument.

    Raises:
        TypeError: If it holds something else than real numbers.
        ValueError: If there are not two, or one is NaN or infinite.
    """
    x, y = real_array(what, value, (2,), expected="two components")
    return float(x), float(y)


def instance(what: str, value: Any, kind: type[T] | tuple[type[T], ...], needed: str) -> T:
    """An object of a class.

    Args:
        what: Name of the argument, for the message.
        value: The argument.
        kind: The class, or several.
        needed: What the message says must be given.

    Raises:
        TypeError: If it is of another class.
    """
    if not isinstance(value, kind):
        raise _refused(what, needed, value)
    return value


def instances(what: str, value: Any, kind: type[T] | tuple[type[T], ...], needed: str) -> list[T]:
    """A list of objects of a class, from a list, an array, a set, values of a mapping and the like.

    Args:
        what: Name of the argument, for the message.
        value: The argument.
        kind: The class, or several.
        needed: What the message says must be given, in the plural.

    Raises:
        TypeError: If it is no list, or an entry is of another class.
    """
    entries = listed(what, value, f"a list of {needed}")
    for position, entry in enumerate(entries):
        if not isinstance(entry, kind):
            raise TypeError(
                f"{what} must be a list of {needed}, but entry {position} is {described(entry)}"
            )
    return entries


def listed(what: str, value: Any, needed: str) -> list[Any]:
    """The entries of a list, an array, a set, values of a mapping and the like.

    Args:
        what: Name of the argument, for the message.
        value: The argument.
        needed: What the message says must be given.

    Raises:
        TypeError: If it is a text or a mapping, or has no entries.
    """
    no_list = isinstance(value, str | bytes | Mapping | type) or not isinstance(value, Collection)
    if no_list or (isinstance(value, np.ndarray) and value.ndim == 0):
        raise _refused(what, needed, value)
    return list(value)


def by_name(what: str, value: Mapping[str, T], needed: str) -> dict[str, T]:
    """A mapping from names to anything.

    Args:
        what: Name of the argument, for the message.
        value: The argument.
        needed: What the message says must be given for each name.

    Raises:
        TypeError: If it is no mapping, or a key is no text.
    """
    if not isinstance(value, Mapping):
        raise _refused(what, f"a mapping from names to {needed}", value)
    for key in value:
        name(f"{what}: a key", key)
    return dict(value)


def instances_by_name(
    what: str, value: Any, kind: type[T] | tuple[type[T], ...], needed: str
) -> dict[str, T]:
    """A mapping from names to objects of a class.

    Args:
        what: Name of the argument, for the message.
        value: The argument.
        kind: The class, or several.
        needed: What the message says must be given for each name.

    Raises:
        TypeError: If it is no mapping, a key is no text, or a value is of another class.
    """
    found = by_name(what, value, needed)
    for key, entry in found.items():
        instance(f"{what}: that of {key!r}", entry, kind, needed)
    return found


def implementation(what: str, value: Any, members: Sequence[str], needed: str) -> Any:
    """An object, of whatever class, that has all members of a protocol.

    Args:
        what: Name of the argument, for the message.
        value: The argument.
        members: Names of the members.
        needed: What the message says must be given.

    Raises:
        TypeError: If a member is missing, or if the class is given instead of an object.
    """
    missing = [member for member in members if not hasattr(value, member)]
    if isinstance(value, type) or missing:
        lacks = "" if isinstance(value, type) else f", which has no {missing[0]!r}"
        raise TypeError(f"{what} must be {needed}, but it is {described(value)}{lacks}")
    return value
