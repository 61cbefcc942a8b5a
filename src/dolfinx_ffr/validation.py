# SPDX-License-Identifier: MIT
"""Checks of arguments: one check and one wording for each kind, for all folders.

Each check gives back the argument in the form in which it is used, or refuses it by name: with a
TypeError where a thing of another kind is needed, with a ValueError where it is out of its range.
"""

from __future__ import annotations

import math
import os
import reprlib
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from difflib import get_close_matches
from inspect import Parameter, signature
from numbers import Real
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .arrays import Array

T = TypeVar("T")

#: Shortest and longest vector that gives a direction, whose squares neither under- nor overflow
_SHORTEST, _LONGEST = 1e-12, 1e12
#: Largest entry of R^T R - 1 for a rotation whose entries are rounded to six digits
_ROUNDED = 1e-5
#: Largest entry of R^T R - 1 that is round-off of double precision
_EXACT = 1e-14


def described(value: Any) -> str:
    """A few words that show a value and its type."""
    text = reprlib.repr(value)
    kind = type(value).__name__
    return text if isinstance(value, type) or kind in text else f"{text} ({kind})"


def _refused(label: str, needed: str, value: Any) -> TypeError:
    return TypeError(f"{label} must be {needed}, but it is {described(value)}")


def is_number(value: Any) -> bool:
    """Whether something is a real number; True and False, texts and arrays are none."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_)


def number(
    label: str,
    value: Any,
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    below: float = math.inf,
    most: float = math.inf,
    unit: str = "",
) -> float:
    """A finite real number in its range: above, at least, below, at most."""
    converted = _as_float(label, value)
    inside = above < converted < below and least <= converted <= most
    if not (math.isfinite(converted) and inside):
        endless = converted == math.inf and min(below, most) == math.inf
        needed = "be finite" if endless else _range(above, least, below, most)
        raise ValueError(f"{label} must {needed}, but it is {value} {unit}".rstrip())
    return converted


def _as_float(label: str, value: Any) -> float:
    if not is_number(value):
        raise _refused(label, "a number", value)
    try:
        return float(value)
    except OverflowError:  # whole numbers and fractions have no largest one
        raise ValueError(f"{label} is too large for a floating-point number") from None


def _range(above: float, least: float, below: float, most: float) -> str:
    """The words after "must" in a message about a number out of its range."""
    low, high = max(above, least), min(below, most)
    if high == math.inf:
        if low == -math.inf:
            return "be finite"
        if low == 0.0:
            return "be positive" if above == 0.0 else "not be negative"
        return f"be above {low:g}" if above == low else f"be at least {low:g}"
    if low == -math.inf:
        return f"be below {high:g}" if below == high else f"be at most {high:g}"
    excluded = [f"{end:g}" for end, open_end in ((low, above), (high, below)) if end == open_end]
    exception = ["", f", {excluded[0]} excluded" if excluded else "", ", both excluded"]
    return f"lie between {low:g} and {high:g}{exception[len(excluded)]}"


def integer(label: str, value: Any, *, least: float = 0) -> int:
    """A whole number in its range; 2.0 is one."""
    converted = _as_float(label, value)
    if not (converted.is_integer() and least <= converted):
        kind = {
            -math.inf: "a whole number",
            0: "a whole number that is not negative",
            1: "a positive whole number",
        }
        needed = kind.get(least, f"a whole number of at least {least:g}")
        raise ValueError(f"{label} must be {needed}, but it is {value}")
    return int(value)


def flag(label: str, value: Any) -> bool:
    """True or False."""
    if not isinstance(value, bool | np.bool_):
        raise _refused(label, "True or False", value)
    return bool(value)


def function(label: str, value: Any, of: str) -> None:
    """Refuse an argument that is no function ``of`` something."""
    if not callable(value):
        raise _refused(label, f"a function of {of}", value)


def name(label: str, value: Any) -> str:
    """A text."""
    if not isinstance(value, str):
        raise _refused(label, "a text", value)
    return value


def names(label: str, value: Any) -> list[str]:
    """A list of texts; a text alone is none."""
    if isinstance(value, str):
        raise TypeError(f"{label} must be a list of texts, as [{value!r}], but it is {value!r}")
    texts = instances(label, value, str, "texts")
    # the order of a set of texts differs from process to process
    return sorted(texts) if isinstance(value, set | frozenset) else texts


def keywords(label: str, names: Iterable[str], *functions: Callable[..., Any]) -> None:
    """Refuse names of options that none of the functions takes, and suggest the nearest one."""
    named = (Parameter.KEYWORD_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
    parameters = [p for function in functions for p in signature(function).parameters.values()]
    options = [p.name for p in parameters if p.kind in named]
    for option in names:
        if option not in options:
            matches = get_close_matches(option, options, 1)
            hint = f"did you mean {matches[0]!r}?" if matches else f"there are {', '.join(options)}"
            raise TypeError(f"{label} has no option {option!r}; {hint}")


def path(label: str, value: Any) -> Path:
    """The path of a file or folder, in which ~ is the home directory."""
    if not isinstance(value, str | os.PathLike):
        raise _refused(label, "a path", value)
    try:
        return Path(value).expanduser()
    except RuntimeError as error:
        raise ValueError(
            f"{label}: {str(value)!r} is in no home directory that is known"
        ) from error


def choice(label: str, value: Any, options: Iterable[str]) -> str:
    """One of several words."""
    words = list(options)
    if name(label, value) not in words:
        needed = " or ".join(map(repr, words)) if len(words) < 3 else f"one of {words}"
        raise ValueError(f"{label} must be {needed}, but it is {value!r}")
    return str(value)


def real_array(
    label: str,
    value: Any,
    shape: tuple[int | None, ...] | None = None,
    *,
    expected: str = "",
) -> Array:
    """An array of finite real numbers of a shape, in which None stands for any length.

    The text ``expected`` replaces the shape in the message.
    """
    array = numbers(label, value)
    if shape is not None and not (
        len(shape) == array.ndim
        and all(n is None or n == m for n, m in zip(shape, array.shape, strict=True))
    ):
        lengths = ", ".join("n" if n is None else str(n) for n in shape)
        needed = expected or f"shape ({lengths}{',' if len(shape) == 1 else ''})"
        raise ValueError(f"{label} must have {needed}, but it has shape {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{label} holds NaN or infinity")
    return array


def numbers(label: str, value: Any) -> Array:
    """An array of real numbers, of any shape, NaN and infinity included."""
    if type(value) is not np.ndarray:
        refuse_masked(label, value)
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{label} must be an array, but its rows differ in length") from error
    if array.dtype.kind not in "biuf":
        entries = {"c": "complex numbers", "U": "texts", "S": "texts"}.get(array.dtype.kind)
        reason = f"it holds {entries}" if entries and array.ndim else f"it is {described(value)}"
        raise TypeError(f"{label} must hold real numbers, but {reason}")
    return np.asarray(array, dtype=np.float64)


def refuse_masked(label: str, value: Any) -> None:
    """Refuse masked entries, which NumPy would replace by the values below the mask."""
    rows = value if isinstance(value, list | tuple) else [value]
    arrays = [row for row in rows if isinstance(row, np.ma.MaskedArray)]
    if masked := sum(int(np.sum(np.ma.getmaskarray(array))) for array in arrays):
        raise ValueError(
            f"{label} has {masked} masked entries, which are no values; "
            "fill them (array.filled(0.0)), or leave them out (array.compressed())"
        )


def direction(label: str, value: Any, dimension: int, *, expected: str = "") -> tuple[float, ...]:
    """The components of a vector of any length from which a unit vector can be made."""
    vector = real_array(label, value, (dimension,), expected=expected)
    length = math.hypot(*vector)
    if not length > _SHORTEST:
        raise ValueError(f"{label} has no length; give a direction, of any length")
    if length > _LONGEST:
        raise ValueError(f"{label} is too long, {length:.3g}; give a direction, as a unit vector")
    return tuple(vector.tolist())


def rotation(label: str, value: Any) -> Array:
    """The matrix of a rotation, shape (3, 3); a rounded matrix becomes the nearest rotation."""
    matrix = nearest_rotation(real_array(label, value, (3, 3)))
    if np.max(np.abs(matrix.T @ matrix - np.eye(3))) > _ROUNDED or np.linalg.det(matrix) < 0.0:
        raise ValueError(
            f"{label} must be the matrix of a rotation, whose columns are perpendicular unit "
            f"vectors in a right-handed order, but it is {matrix.tolist()}"
        )
    return matrix


def nearest_rotation(matrix: Array) -> Array:
    """The rotation nearest to a matrix that is a rotation but for rounding; else the matrix."""
    defect = float(np.max(np.abs(matrix.T @ matrix - np.eye(3))))
    if not _EXACT < defect < _ROUNDED:
        return matrix
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ vt)


def instance(label: str, value: Any, kind: type[T] | tuple[type[T], ...], needed: str) -> T:
    """An object of a class, or of one of several."""
    if not isinstance(value, kind):
        raise _refused(label, needed, value)
    return value


def instances(label: str, value: Any, kind: type[T] | tuple[type[T], ...], needed: str) -> list[T]:
    """A list of objects of a class."""
    entries = listed(label, value, f"a list of {needed}")
    for position, entry in enumerate(entries):
        if not isinstance(entry, kind):
            raise TypeError(
                f"{label} must be a list of {needed}, but entry {position} is {described(entry)}"
            )
    return entries


def listed(label: str, value: Any, needed: str) -> list[Any]:
    """The entries of a list, an array, a set or the values of a mapping."""
    no_list = isinstance(value, str | bytes | Mapping | type) or not isinstance(value, Collection)
    if no_list or (isinstance(value, np.ndarray) and value.ndim == 0):
        raise _refused(label, needed, value)
    return list(value)


def by_name(label: str, value: Mapping[str, T], needed: str) -> dict[str, T]:
    """A mapping from names to anything."""
    if not isinstance(value, Mapping):
        raise _refused(label, f"a mapping from names to {needed}", value)
    for key in value:
        name(f"{label}: a key", key)
    return dict(value)


def instances_by_name(
    label: str, value: Any, kind: type[T] | tuple[type[T], ...], needed: str
) -> dict[str, T]:
    """A mapping from names to objects of a class."""
    entries = by_name(label, value, needed)
    for key, entry in entries.items():
        instance(f"{label}: {key!r}", entry, kind, needed)
    return entries


def implementation(label: str, value: Any, members: Sequence[str], needed: str) -> Any:
    """An object, of whatever class, that has all members of a protocol."""
    missing = [member for member in members if not hasattr(value, member)]
    if isinstance(value, type) or missing:
        lacks = "" if isinstance(value, type) else f", which has no {missing[0]!r}"
        raise TypeError(f"{label} must be {needed}, but it is {described(value)}{lacks}")
    return value
