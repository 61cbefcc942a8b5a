# SPDX-License-Identifier: MIT
"""Around a run: warnings beside the progress bar, and the user's wish to stop."""

from __future__ import annotations

import re
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from mpi4py import MPI

from tqdm.auto import tqdm

from ..dynamics import (
    GearFlankWarning,
    LargeDeformationWarning,
    SofteningWarning,
    TiltedAxisWarning,
    TimeStepWarning,
)
from ..files import locked, unlocked
from ..mechanism import PlacementWarning
from ..parallel import gathered, on_rank_0
from ..postprocessing import LocalModesWarning
from ..reduction import RoundOffWarning

#: Warnings of one trajectory, which hardly differ from design to design
LIMITS = (
    GearFlankWarning,
    LargeDeformationWarning,
    LocalModesWarning,
    PlacementWarning,
    RoundOffWarning,
    SofteningWarning,
    TiltedAxisWarning,
    TimeStepWarning,
)
#: A text in quotes, or a number
_NUMBER = re.compile(r"('[^']*')|\d[\d.]*(?:e[-+]?\d+)?")


@contextmanager
def warnings_above(bar: tqdm) -> Iterator[None]:
    """Context in which warnings stand on lines of their own, above the progress bar.

    A warning of a limit that differs in numbers only is shown once.
    """
    show = warnings.showwarning
    shown_before: set[tuple[type[Warning], str]] = set()

    def shown(message: Warning | str, category: type[Warning], *rest: Any, **options: Any) -> None:
        if issubclass(category, LIMITS):
            # names of bodies are quoted, and keep their numbers
            limit = category, _NUMBER.sub(lambda found: found[1] or "", str(message))
            if limit in shown_before:
                return
            shown_before.add(limit)
        with nullcontext() if bar.disable else bar.external_write_mode(file=sys.stderr):
            show(message, category, *rest, **options)

    warnings.showwarning = shown
    try:
        yield
    finally:
        warnings.showwarning = show


@contextmanager
def alone_in(comm: MPI.Comm, folder: Path | None, what: str) -> Iterator[None]:
    """Context in which no other program that asks for it writes into a folder, which is made.

    A lock of the operating system on the file ``.lock`` in it, held by rank 0, says so; it ends
    with the process. Where the file system has no locks, nothing is said. Raises an OSError if
    another program writes there, or the folder cannot be made.
    """
    if folder is None:
        yield
        return

    def take() -> int | None:
        if folder.is_file():
            raise NotADirectoryError(f"{what}: {str(folder)!r} is a file; give a folder")
        folder.mkdir(parents=True, exist_ok=True)
        try:
            return locked(folder / ".lock")
        except BlockingIOError:
            raise BlockingIOError(
                f"{what}: another program, or another call, is writing into {str(folder)!r}: wait "
                "until it has ended, or give another folder"
            ) from None
        except OSError as error:
            if error.filename is not None:
                raise
            return None  # a file system without locks

    lock = on_rank_0(comm, take)
    try:
        yield
    finally:
        if comm.rank == 0 and lock is not None:
            unlocked(folder / ".lock", lock)


@contextmanager
def interruptible(comm: MPI.Comm) -> Iterator[Callable[[], int]]:
    """Give a function that tells, alike on every rank, the signal that asks to stop; 0 for none."""
    signals: list[int] = []
    previous: dict[signal.Signals, Any] = {}

    def handle(number: int, frame: Any) -> None:
        signals.append(number)
        if len(signals) > 1:
            raise KeyboardInterrupt

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            previous[number] = signal.signal(number, handle)
    try:
        yield lambda: max(gathered(comm, "a design loop", max(signals, default=0)))
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


class Run:
    """The progress of one phase of a run, and the user's wish to stop it.

    Args:
        comm: The ranks of the run.
        total: Number of steps, as it is planned.
        unit: Name of a step.
        progress: Whether rank 0 shows a progress bar.
        label: Text before the bar.
    """

    def __init__(
        self, comm: MPI.Comm, total: int, unit: str, progress: bool, label: str | None = None
    ) -> None:
        self.comm = comm
        silent = not progress or comm.rank > 0
        self.bar = tqdm(total=total, desc=label, unit=unit, disable=silent, dynamic_ncols=True)
        self._signal: Callable[[], int] = lambda: 0
        #: Whether SIGTERM has arrived, known at the end
        self.terminated = False

    @contextmanager
    def running(self) -> Iterator[None]:
        """Show the progress, catch signals, and warn of each limit once within this context."""
        with self.bar, warnings_above(self.bar), interruptible(self.comm) as self._signal:
            yield
            self.terminated = self.stopped() == "terminated"

    def stopped(self) -> str:
        """How the user has ended the run, alike on every rank; "" where it goes on."""
        number = self._signal()
        if not number:
            return ""
        return "terminated" if number == signal.SIGTERM else "interrupted"

    def show(self, text: str) -> None:
        """Show a text beside the bar."""
        self.bar.set_postfix_str(text)

    def advance(self, steps: int = 1) -> None:
        """Move the bar by some steps."""
        self.bar.update(steps)
