# SPDX-License-Identifier: MIT
"""A results folder as the sections of a report use it, and their tables."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from .folder import Folder
from .numbers import Scale, aligned, real

Row = Sequence[str]


def words(name: str) -> str:
    """The name of a class, "IntegralCompliance", as the words that begin a sentence."""
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
        """A table, or None without rows; ``numeric`` are the columns of numbers."""
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
        self.psi_unit = str(objective.get("unit") or "")
        self.objective = words(str(objective.get("name") or "objective"))
        self.verification = self.mapping("verification")
        #: Whether the boundary of the part was moved: what is reported then is the part
        self.moved = bool(self.record.get("boundary"))
        self.references = {k: v for k, v in self.mapping("references").items() if real(v)}
        self.bounds = {
            name: given["bound"]
            for name, given in self.mapping("constraints").items()
            if name.startswith("volume of ") and isinstance(given, dict) and real(given["bound"])
        }
        psis = [self.record.get("psi"), self.verification.get("part"), *self.references.values()]
        self.psi = Scale(self.psi_unit, max([abs(p) for p in psis if real(p)], default=None))

    def mapping(self, key: str) -> dict[str, Any]:
        """The mapping under a key; empty where there is none."""
        found = self.record.get(key)
        if found is not None and not isinstance(found, dict):
            self.missing(f"summary.json: what stands under {key!r} cannot be used (no mapping)")
        return found if isinstance(found, dict) else {}

    def missing(self, what: str) -> None:
        """Note once that something is missing."""
        if what not in self.folder.missing:
            self.folder.missing.append(what)

    def built(self, what: str, build: Callable[[Run], Any], nothing: Any) -> Any:
        """The section that ``build`` makes; ``nothing`` and a note if the record is not usable."""
        try:
            return build(self)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            said = f"{type(error).__name__}: {error}"
            self.missing(
                f"{what}: summary.json holds something else than run_record writes ({said})"
            )
            return nothing
