# SPDX-License-Identifier: MIT
"""The state of boundary steps, in the checkpoint of the run that designed the densities.

A run of densities that goes on writes that file anew, without the steps from an earlier design.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ..boundary import Boundary, Surface
from ..io import CheckpointError, load_checkpoint, save_checkpoint, write_history
from ..parallel import on_rank_0, same

Boundaries = dict[str, Boundary | Surface]
Arrays = Mapping[str, NDArray[Any]]

#: Beginning of the names of these arrays, beside those of the densities
_OURS = "boundary "
#: Relative difference of controls from which on two starts are others; round-off changes less
_SAME = 1e-5
#: The same of psi, which is that of a mesh made anew: another release of gmsh makes another one
_SAME_PSI = 1e-4


@dataclass(frozen=True)
class Learnt:
    """What the descent has learnt, beside boundaries, modes and time steps."""

    psi: float  #: At the boundaries
    reach: float  #: Of the next step, in minimum members
    weight: float  #: Of bounds in the merit
    margin: float  #: By which bounds are tightened


@dataclass(frozen=True, eq=False)
class Kept:
    """All that the next step depends on, beside the start."""

    learnt: Learnt
    spare: dict[str, float]  #: By how much more than to their bounds constraints are kept, by name
    now: Boundaries
    best: Boundaries | None  #: None where it is the present one
    modes: dict[str, int]
    methods: list[str]  #: Of each load case, "" where none was chosen
    errors: dict[str, float]  #: Of the best by its modes
    told: list[dict[str, float]]  #: One row for the start and each step
    shown: dict[str, list[BaseGeometry]]  #: Material at the same places, by body
    known: NDArray[np.float64]  #: By the last steps, see `boundary.secants`

    def arrays(self) -> dict[str, Any]:
        """As arrays by name."""
        films = {n: [shapely.to_wkb(shape) for shape in film] for n, film in self.shown.items()}
        return {
            **asdict(self.learnt),
            **_named("now", self.now),
            **_named("best", self.best or {}),
            **{f"spare {n}": more for n, more in self.spare.items()},
            **{f"modes {n}": count for n, count in self.modes.items()},
            **{f"error {n}": error for n, error in self.errors.items()},
            "methods": self.methods,
            "known": self.known,
            "columns": list(self.told[0]),
            "rows": [list(row.values()) for row in self.told],
            **{f"film {n}": np.frombuffer(b"".join(film), np.uint8) for n, film in films.items()},
            **{f"lengths {n}": [len(shape) for shape in film] for n, film in films.items()},
        }

    @staticmethod
    def of(data: Arrays, start: Boundaries) -> Kept:
        """From `arrays`, and boundaries that began as the ``start`` did."""
        columns, shown = data["columns"].tolist(), {}
        for name in (name for name in start if f"film {name}" in data):
            ends = np.cumsum(data[f"lengths {name}"])[:-1]
            parts = np.split(data[f"film {name}"], ends)
            shown[name] = [shapely.from_wkb(part.tobytes()) for part in parts]
        best = any(key.startswith("best ") for key in data)
        return Kept(
            Learnt(**{name: float(data[name]) for name in Learnt.__dataclass_fields__}),
            {n: float(more) for n, more in _under("spare ", data).items()},
            {n: b.restored(_under(f"now {n} ", data)) for n, b in start.items()},
            {n: b.restored(_under(f"best {n} ", data)) for n, b in start.items()} if best else None,
            {n: int(count) for n, count in _under("modes ", data).items()},
            data["methods"].tolist(),
            {n: float(error) for n, error in _under("error ", data).items()},
            [dict(zip(columns, row, strict=True)) for row in data["rows"].tolist()],
            shown,
            data["known"],
        )


class StepsCheckpoint:
    """The checkpoint at a ``path``, from which a run goes on if it is to ``resume``."""

    def __init__(self, comm: MPI.Comm, path: Path | None, resume: bool) -> None:
        self._comm, self._path, self._resume = comm, path, resume
        self._other: dict[str, Any] = {}

    def load(self, start: Boundaries) -> Kept | None:
        """The state of an earlier run from the same ``start``, if there is one to be resumed.

        A CheckpointError if the checkpoint is damaged, or began with another start.
        """
        path = self._path
        if path is None or not on_rank_0(self._comm, path.is_file):
            self._path = None  # nothing from which the densities could be resumed
            return None
        data = load_checkpoint(self._comm, path)
        began, found = _named("start", start), _under(_OURS, data)
        self._other = {k: v for k, v in data.items() if not k.startswith(_OURS)}
        self._other |= {_OURS + k: v for k, v in began.items()}
        if not found or not self._resume:
            return None
        try:
            if all(same(found[name], array, _SAME) for name, array in began.items()):
                return Kept.of(found, start)
        except (KeyError, ValueError):
            pass
        raise self._foreign("the boundaries with which its steps began are none of this run")

    def save(self, kept: Kept) -> None:
        """Write a state beside that of the densities."""
        if self._path is not None:
            own = {_OURS + name: value for name, value in kept.arrays().items()}
            save_checkpoint(self._comm, self._path, self._other | own)
            self.tell(kept.told)

    def tell(self, told: list[dict[str, float]]) -> None:
        """Write a row for each step, ``boundary.csv`` beside the checkpoint."""
        if self._path is not None:
            file = self._path.with_name("boundary.csv")
            write_history(self._comm, file, list(told[0]), told)

    def check(self, kept: Kept, psi: float) -> None:
        """Refuse a state whose boundaries have another ``psi`` here."""
        if not abs(psi - kept.learnt.psi) <= _SAME_PSI * abs(kept.learnt.psi):
            raise self._foreign(f"psi of its boundaries was {kept.learnt.psi:.8g} and is {psi:.8g}")

    def _foreign(self, why: str) -> CheckpointError:
        """The error of steps that are not of this run."""
        return CheckpointError(
            f"checkpoint {self._path} is of another problem: {why}. Delete it to start anew, or "
            "write into another folder"
        )


def _named(what: str, boundaries: Boundaries) -> dict[str, NDArray[Any]]:
    """The states of boundaries in one mapping."""
    every = {name: boundary.state() for name, boundary in boundaries.items()}
    return {f"{what} {n} {key}": array for n, own in every.items() for key, array in own.items()}


def _under(prefix: str, data: Arrays) -> dict[str, NDArray[Any]]:
    """The arrays whose names begin so, without that beginning."""
    return {k.removeprefix(prefix): v for k, v in data.items() if k.startswith(prefix)}
