# SPDX-License-Identifier: MIT
"""What Python shows of a class and of a result: comments of fields in `help`, numbers as a table.

A field of a dataclass is explained by a comment ``#:`` on or above its line, of which Python knows
nothing. Here they become a section `Attributes` of the class's docstring, from the source of its
module, in some forty milliseconds for the whole package, a fiftieth of its import.
"""

from __future__ import annotations

import dataclasses
import html
import linecache
import re
import reprlib
import sys
import textwrap
from collections.abc import Mapping
from typing import Any

import numpy as np

#: Length of an array that is shown with its numbers
SHOWN_NUMBERS = 3


class Shown:
    """A result that Python and notebooks show by its numbers, and not by its arrays."""

    def _shown(self) -> list[tuple[str, str, str]]:
        """What there is to tell, in words: quantity, value, and its error or bound or nothing.

        Of a dataclass all fields, with the shape of arrays and the keys of mappings.
        """
        assert dataclasses.is_dataclass(self)
        return [
            (field.name, _in_brief(getattr(self, field.name)), "")
            for field in dataclasses.fields(self)
            if field.repr
        ]

    def _picture(self) -> str:
        """A drawing as SVG, where there is one."""
        return ""

    def __repr__(self) -> str:
        rows = (
            f"{what} {value}" + f" ({aside})" * bool(aside) for what, value, aside in self._shown()
        )
        return f"<{type(self).__name__}: {', '.join(rows)}>"

    def _repr_html_(self) -> str:
        """The table of a notebook."""
        rows = "".join(
            "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>"
            for row in self._shown()
        )
        head = f"<tr><th>{type(self).__name__}</th><th>value</th><th>error, bound</th></tr>"
        return f"{self._picture()}<table><thead>{head}</thead><tbody>{rows}</tbody></table>"


def _in_brief(value: Any) -> str:
    """A value in a few words: the shape of an array, the keys of a mapping."""
    if isinstance(value, np.ndarray):
        return f"of shape {value.shape}" if value.size > SHOWN_NUMBERS else str(value.tolist())
    if isinstance(value, Mapping):
        return f"for {', '.join(map(str, value))}" if value else "for nothing"
    return reprlib.repr(value) if isinstance(value, list | tuple | set) else repr(value)


def field_comments(thing: type) -> dict[str, str]:
    """The comments ``#:`` of the fields of a class and its bases, by name of the field."""
    comments: dict[str, str] = {}
    for base in reversed(thing.__mro__):
        if "__dataclass_fields__" not in vars(base):
            continue
        above: list[str] = []
        for line in _body(base):
            code, mark, comment = line.partition("#:")
            if found := re.match(r"    (\w+):", code):
                text = [comment.strip()] if mark else above
                if text:
                    comments[found[1]] = " ".join(text)
            above = [*above, comment.strip()] if mark and not code.strip() else []
    return comments


def _body(thing: type) -> list[str]:
    """The lines of a class that stands in a module, after its first one."""
    module = sys.modules[thing.__module__]
    lines = linecache.getlines(getattr(module, "__file__", None) or "", vars(module))
    start = re.compile(rf"class {thing.__name__}\b")
    first = next((k for k, line in enumerate(lines) if start.match(line)), len(lines)) + 1
    inside = (k for k in range(first, len(lines)) if re.match(r"[\w@#]", lines[k]))
    return lines[first : next(inside, len(lines))]


def explain_fields(names: dict[str, Any]) -> None:
    """Let `help` show the comments of fields of all dataclasses that a module offers."""
    for thing in [*names.values()]:
        if not isinstance(thing, type) or "__dataclass_fields__" not in vars(thing):
            continue
        given, comments = vars(thing).get("__doc__"), field_comments(thing)
        fields = [field.name for field in dataclasses.fields(thing) if field.name in comments]
        if not fields or not isinstance(given, str) or "\n    Attributes:\n" in given:
            continue
        entries = [textwrap.fill(f"{name}: {comments[name]}", 92) for name in fields]
        section = [textwrap.indent(entry, " " * 8).replace("\n", "\n    ") for entry in entries]
        thing.__doc__ = "\n".join([given.rstrip(), "", "    Attributes:", *section, "    "])
