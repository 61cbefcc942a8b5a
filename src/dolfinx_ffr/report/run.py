# SPDX-License-Identifier: MIT
"""A results folder while it is turned into sections of a report, and tables for these."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeGuard

from .folder import Folder
from .numbers import Scale, aligned

__all__ = ["Row", "Run", "Table", "real", "words"]

Row = Sequence[str]


def real(value: Any) -> TypeGuard[float]:
    """Whether something is a finite number.

    Args:
        value: Anything.
    """
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def words(name: str) -> str:
    """The name of a class as words of a sentence that begins with it.

    Args:
        name: For example "IntegralCompliance".
    """
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()
    return apart[:1].upper() + apart[1:]


@dataclass(frozen=True)
class Table:
    """A table whose first column names the rows."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Row]
    numeric: frozenset[int]  #: Columns whose points stand below each other
    note: str = ""

    @staticmethod
    def of(
        caption: str,
        head: Sequence[str],
        rows: Sequence[Row],
        numeric: Sequence[int] = (),
        note: str = "",
    ) -> Table | None:
        """A table, or None without rows.

        Args:
            caption: Above it.
            head: Of the columns.
            rows: Texts, one for each column.
            numeric: Columns of numbers.
            note: Below it.
        """
        if not rows:
            return None
        columns = [list(column) for column in zip(*rows, strict=True)]
        columns = [aligned(c) if i in numeric else c for i, c in enumerate(columns)]
        return Table(caption, head, list(zip(*columns, strict=True)), frozenset(numeric), note)


class Run:
    """A folder while it is turned into sections."""

    def __init__(self, folder: Folder) -> None:
        self.folder, self.record = folder, folder.record
        objective = self.mapping("objective")
        self.psi_unit = str(objective.get("unit", "") or "")
        name = str(objective.get("name", "") or "objective")
        self.objective = words(name)
        self.verification = self.mapping("verification")
        self.references = {k: v for k, v in self.mapping("references").items() if real(v)}
        self.bounds = {
            name: given["bound"]
            for name, given in self.mapping("constraints").items()
            if name.startswith("volume of ") and isinstance(given, dict) and real(given["bound"])
        }
        psis = [self.record.get("psi"), self.verification.get("part"), *self.references.values()]
        self.psi = Scale(self.psi_unit, max([abs(p) for p in psis if real(p)], default=None))

    def mapping(self, key: str) -> dict[str, Any]:
        """What stands under a key, nothing where that is no mapping."""
        found = self.record.get(key)
        if found is not None and not isinstance(found, dict):
            self.missing(f"summary.json: what stands under {key!r} cannot be used (no mapping)")
        return found if isinstance(found, dict) else {}

    def missing(self, what: str) -> None:
        """Say once what is not there."""
        if what not in self.folder.missing:
            self.folder.missing.append(what)

    def built(self, what: str, build: Callable[[], Any], nothing: Any) -> Any:
        """What is made of the record, or nothing and a note where it holds something else.

        Args:
            what: What is made.
            build: Makes it.
            nothing: Stands for it.
        """
        try:
            return build()
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            said = f"{type(error).__name__}: {error}"
            self.missing(
                f"{what}: summary.json holds something else than run_record writes ({said})"
            )
            return nothing
