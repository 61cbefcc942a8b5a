# SPDX-License-Identifier: MIT
"""Display of results in Python and notebooks, as tables of their numbers."""

from __future__ import annotations

import dataclasses
import html
import reprlib
from collections.abc import Mapping
from typing import Any

import numpy as np

#: Length of an array that is shown with its numbers
SHOWN_NUMBERS = 3


class Shown:
    """A result that Python and notebooks show by its numbers, and not by its arrays."""

    def _shown(self) -> list[tuple[str, str, str]]:
        """Rows of the table, in words: quantity, value, and its error, its bound or nothing.

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
