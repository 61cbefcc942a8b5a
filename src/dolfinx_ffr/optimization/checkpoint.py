# SPDX-License-Identifier: MIT
"""The one checkpoint of a run, with a section for each of its phases."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI

from ..io import CheckpointError, load_checkpoint, save_checkpoint
from ..parallel import on_rank_0
from .stepper import with_prefix, without_prefix

#: Number of the names and meanings in the file; files with another number are refused
_FORMAT = 3
#: The phases of a run one after the other
PHASES = ("design", "boundary")


class Checkpoint:
    """The file from which a run is resumed.

    Args:
        comm: The ranks of the run.
        path: Path of the file; None writes and reads nothing.
        resume: Whether to continue from the state in the file.
    """

    def __init__(self, comm: MPI.Comm, path: Path | None, resume: bool) -> None:
        self._comm, self.path, self.resume = comm, path, resume
        self._sections: dict[str, dict[str, Any]] = {}

    def read(self) -> bool:
        """Read the file of an earlier run that is to be resumed; whether there is one.

        A CheckpointError if it is damaged, or another version has written it.
        """
        path = self.path
        if path is None or not self.resume or not on_rank_0(self._comm, path.is_file):
            return False
        data = load_checkpoint(self._comm, path)
        if int(data.get("format", 1)) != _FORMAT:
            raise CheckpointError(
                f"checkpoint {path} was written by another version of dolfinx_ffr, and this one "
                "cannot go on from it: delete it to start anew, or write into another folder"
            )
        sections = {phase: without_prefix(phase, data) for phase in PHASES}
        self._sections = {phase: section for phase, section in sections.items() if section}
        return True

    def section(self, phase: str) -> dict[str, Any] | None:
        """The state of a phase of the earlier run, if it is to be resumed."""
        return self._sections.get(phase)

    def save(self, phase: str, state: Mapping[str, Any]) -> None:
        """Write the state of a phase after those of earlier phases; later phases begin anew.

        Nothing is written if an earlier phase has no state from which it could be resumed.
        """
        earlier_phases = PHASES[: PHASES.index(phase)]
        if self.path is None or any(earlier not in self._sections for earlier in earlier_phases):
            return
        stored = {earlier: self._sections[earlier] for earlier in earlier_phases}
        self._sections = {**stored, phase: dict(state)}
        named = [with_prefix(earlier, section) for earlier, section in self._sections.items()]
        save_checkpoint(
            self._comm,
            self.path,
            {"format": _FORMAT, **{k: v for s in named for k, v in s.items()}},
        )

    def of_another_problem(self, why: str) -> CheckpointError:
        """The error of a checkpoint that does not belong to this run."""
        return CheckpointError(
            f"checkpoint {self.path} is of another problem: {why}. Delete it to start anew, or "
            "write into another folder"
        )
