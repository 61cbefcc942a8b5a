# SPDX-License-Identifier: MIT
"""The history of one phase of a run: a row of numbers for the start and for each step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from ..arrays import Array
from ..io import write_history

Row = dict[str, float]


@dataclass
class History:
    """Rows with the same columns, and a file that has them, too."""

    comm: MPI.Comm
    file: Path | None  #: None where nothing is written
    columns: list[str] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)

    def add(self, row: Mapping[str, float]) -> None:
        """Add a row, and write the file anew."""
        self.columns = self.columns or list(row)
        self.rows.append({name: row[name] for name in self.columns})
        self.write()

    def write(self) -> None:
        """Write the file."""
        if self.file is not None:
            write_history(self.comm, self.file, self.columns, self.rows)

    def arrays(self) -> dict[str, Array]:
        """The columns by name, (rows,) each."""
        return {name: np.array([row[name] for row in self.rows]) for name in self.columns}

    def state(self) -> dict[str, Any]:
        """The history as arrays for a checkpoint."""
        rows = [[row[name] for name in self.columns] for row in self.rows]
        return {"columns": self.columns, "rows": np.array(rows)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on with the rows of a `state`."""
        self.columns = [str(name) for name in state["columns"]]
        self.rows = [dict(zip(self.columns, map(float, row), strict=True)) for row in state["rows"]]
