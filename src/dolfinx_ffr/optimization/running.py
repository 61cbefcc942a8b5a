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
from typing import Any

from mpi4py import MPI

from tqdm import tqdm

from ..dynamics import LargeDeformationWarning, SofteningWarning, TiltedAxisWarning, TimeStepWarning
from ..postprocessing import LocalModesWarning
from ..reduction import RoundOffWarning

__all__ = ["interruptible", "warnings_above"]

#: Warnings that speak of one motion, and hardly differ from design to design
LIMITS = (
    LargeDeformationWarning,
    LocalModesWarning,
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

    What the motion of each design says anew, with other numbers, is shown once.
    """
    show = warnings.showwarning
    known: set[tuple[type[Warning], str]] = set()

    def shown(message: Warning | str, category: type[Warning], *rest: Any, **options: Any) -> None:
        if issubclass(category, LIMITS):
            # names of bodies are quoted, and keep their numbers
            said = category, _NUMBER.sub(lambda found: found[1] or "", str(message))
            if said in known:
                return
            known.add(said)
        with nullcontext() if bar.disable else bar.external_write_mode(file=sys.stderr):
            show(message, category, *rest, **options)

    warnings.showwarning = shown
    try:
        yield
    finally:
        warnings.showwarning = show


@contextmanager
def interruptible(comm: MPI.Comm) -> Iterator[Callable[[], bool]]:
    """Give a function that tells, alike on every rank, whether the user wants to stop."""
    asked = threading.Event()
    previous: dict[signal.Signals, Any] = {}

    def handle(number: int, frame: Any) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            previous[number] = signal.signal(number, handle)
    try:
        yield lambda: bool(comm.allreduce(asked.is_set(), MPI.LOR))
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
