# SPDX-License-Identifier: MIT
"""Motions in text files: two columns by their names, in SI units."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from os import PathLike

import numpy as np

from .. import validation
from ..arrays import Array
from ..files import text_of

#: Units of times in seconds, of angles in radians, of lengths in metres.
_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0}
_ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0, "rev": 2.0 * math.pi}
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
#: Other spellings of units
_SPELLINGS = {"°": "deg", "µs": "us", "μs": "us", "µm": "um", "μm": "um", "sec": "s"}
#: A column: its name, and perhaps its unit in brackets.
_TITLE = re.compile(r"^(?P<name>.*?)\s*(?:[\[(]\s*(?P<unit>[^\])]*?)\s*[\])])?$")


def read_motion(
    path: str | PathLike[str],
    columns: tuple[str, str],
    units: tuple[str | None, str | None],
    unwrap: bool | None,
) -> tuple[Array, Array]:
    """Times [s] and values [m or rad] of a file, shape (n,) each; see `Motion.from_table`."""
    file = validation.path("table: the path", path)
    label = f"table {str(file)!r}"
    if unwrap is not None:
        validation.flag(f"{label}: unwrap", unwrap)
    text = text_of(file).splitlines()
    lines = [(k, line) for k, line in enumerate(text, 1) if line.strip() and line.strip()[0] != "#"]
    if len(lines) < 2:
        raise ValueError(f"{label}: there is no line of numbers below one with the columns' names")
    separator = max(",;\t", key=lines[0][1].count)
    try:
        rows = [next(csv.reader([line], delimiter=separator)) for _, line in lines]
    except csv.Error as error:
        raise ValueError(f"{label}: it is no table of numbers: {error}") from error
    numbers = [k for k, _ in lines[1:]]
    kinds: tuple[Mapping[str, float], ...] = (_TIMES, {**_ANGLES, **_LENGTHS})
    quantities = zip(("time", "value"), columns, strict=True)
    places = [_column(label, rows[0], name, key) for key, name in quantities]
    if places[0] == places[1]:
        raise ValueError(f"{label}: column {columns[0]!r} cannot be both times and values")
    chosen = [
        _unit(f"{label}: column {name!r}", rows[0][place], stated_unit, known_units)
        for name, place, stated_unit, known_units in zip(columns, places, units, kinds, strict=True)
    ]
    t, c = (
        np.array([_entry(label, k, row, place) for k, row in zip(numbers, rows[1:], strict=True)])
        for place in places
    )
    for earlier_line, line, earlier, time in zip(numbers, numbers[1:], t, t[1:], strict=False):
        if not time > earlier:
            wrong = "repeats the time of" if time == earlier else "is earlier than"
            raise ValueError(
                f"{label}: line {line} {wrong} line {earlier_line}, {earlier:.9g}; times must "
                "increase from line to line"
            )
    t, c = t * kinds[0][chosen[0]], c * kinds[1][chosen[1]]
    if chosen[1] in _ANGLES:
        c = _unwrapped(label, c, numbers, unwrap)
    elif unwrap:
        raise ValueError(f"{label}: unwrap is for angles, but {columns[1]!r} is in {chosen[1]}")
    return t, c


def _column(what: str, titles: Sequence[str], name: str, key: str) -> int:
    """Place of the column of a ``name``, which the argument ``key`` gives."""
    searched = validation.name(f"{what}: the name of a column", name).strip()
    names = [_split(title)[0] for title in titles]
    matches = [k for k, column in enumerate(names) if searched in (column, titles[k].strip())]
    if len(matches) != 1:
        number = "is no column" if not matches else f"are {len(matches)} columns"
        raise ValueError(
            f"{what}: there {number} {searched!r}; the columns are {names}; name one by {key}="
        )
    return matches[0]


def _split(title: str) -> tuple[str, str | None]:
    """Name and unit of a column."""
    match = _TITLE.match(title.strip())
    assert match is not None  # every text is a name
    return match["name"], match["unit"]


def _unit(what: str, title: str, stated_unit: str | None, known_units: Mapping[str, float]) -> str:
    """The unit of a column, from its title or from an argument."""
    written = _split(title)[1]
    units = {_SPELLINGS.get(unit, unit) for unit in (written, stated_unit) if unit is not None}
    if not units:
        raise ValueError(
            f"{what} has no unit; write it in brackets behind the name in the first line, or give "
            f"it: one of {list(known_units)}"
        )
    if len(units) > 1:
        raise ValueError(
            f"{what}: unit={stated_unit!r} contradicts the unit {written!r} in the file; leave it "
            "out"
        )
    unit = units.pop()
    if unit not in known_units:
        raise ValueError(f"{what}: the unit must be one of {list(known_units)}, but it is {unit!r}")
    return unit


def _entry(what: str, line: int, row: Sequence[str], place: int) -> float:
    """A number of a line."""
    if place >= len(row):
        raise ValueError(f"{what}: line {line} has {len(row)} columns only")
    text = row[place].strip()
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        hint = "; numbers have a decimal point" if "," in text else ""
        raise ValueError(f"{what}: {text!r} in line {line} is no finite number{hint}")
    return number


def _unwrapped(what: str, angles: Array, lines: Sequence[int], unwrap: bool | None) -> Array:
    """Angles without jumps of full turns; a ValueError where large steps may be jumps or not."""
    if unwrap:
        return np.asarray(np.unwrap(angles))
    steps = np.abs(np.diff(angles))
    if unwrap is None and np.any(steps > math.pi):
        k = int(np.argmax(steps > math.pi))
        raise ValueError(
            f"{what}: from line {lines[k]} to line {lines[k + 1]} the angle changes by "
            f"{math.degrees(steps[k]):.4g} deg, more than half a turn; give unwrap=True where it "
            "jumps by full turns, or unwrap=False where it really turns so far"
        )
    return angles
