# SPDX-License-Identifier: MIT
"""The directory in which DOLFINx keeps the compiled forms of this session.

FFCx marks a form that is being compiled by the mere existence of its C file. When a run is killed
meanwhile, the mark stays, and every later run waits for a compiler that is long gone until it gives
up. Nothing in the mark tells a dead owner from one at work. Here each session therefore owns one
directory of a small pool, ``$XDG_CACHE_HOME/dolfinx_ffr/forms-0``, ``forms-1``, ..., for as long as
it lives: the first one that no living session holds, nearly always ``forms-0`` with the forms of
all earlier runs. What is unfinished in a directory that nobody holds has no owner any more and is
removed; what others have finished is linked into it, whenever a mesh is made.

The hold is a lock of the operating system on an open file: it ends with the process, however that
ends.
"""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import logging
import os
import shutil
import sys
import tempfile
from itertools import count
from pathlib import Path

from mpi4py import MPI

from ..caches import spare_directory
from . import _compat

__all__ = ["claim_form_cache"]

#: Directory that this process uses, and on the rank that holds it the open file with the lock.
_directory: Path | None = None
_lock: int | None = None
#: When the directories beside it had last been changed when their forms were taken over [ns].
_looked_at: dict[Path, int] = {}


def claim_form_cache(comm: MPI.Intracomm) -> Path:
    """Make DOLFINx keep compiled forms in a directory that this session alone uses.

    Call it before the first form on a communicator is compiled; `Domain` does. Calling it again
    takes over what sessions beside this one have compiled since. Collective over ``comm``.

    Args:
        comm: Communicator of the mesh.

    Returns:
        The directory, the same on every rank of ``comm``. Where the user's cache directory cannot
        be written, it is the user's among the temporary files; where there is none either, one
        that is removed when the process ends.

    Raises:
        RuntimeError: On every rank, if not even a temporary directory can be made.
    """
    global _directory
    if _quiet not in logging.getLogger().filters:
        logging.getLogger().addFilter(_quiet)
    held = comm.allgather(_directory)
    if held[0] is not None and all(other == held[0] for other in held):
        if comm.rank == 0 and _lock is not None:
            _link_finished(held[0])
        return held[0]
    answer: Path | str = ""
    if comm.rank == 0:
        try:
            answer = _directory or _claim_first_free(_pool())
        except OSError as error:
            answer = f"no directory for compiled forms: {error}"
    answer = comm.bcast(answer)
    if isinstance(answer, str):
        raise RuntimeError(answer)
    _directory = answer
    _compat.set_form_cache(answer)
    return answer


class _Announcement(logging.Filter):
    """One line on the screen in place of each command that the compiler is called with."""

    said = False
    how_often = "once"

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a ``record`` is shown."""
        if "distutils" not in record.pathname or record.levelno >= logging.WARNING:
            return True
        if not self.said:
            print(
                f"compiling finite-element forms, {self.how_often}: about 10 s",
                file=sys.stderr,
                flush=True,
            )
            self.said = True
        return False


_quiet = _Announcement()


def _pool() -> Path:
    """The directory of the pool: the user's, or a temporary one where that is read-only."""
    with contextlib.suppress(OSError, RuntimeError):
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        return _usable(Path(home) / "dolfinx_ffr")
    spare = spare_directory()
    with contextlib.suppress(OSError):
        if spare is not None:
            return _usable(spare)
    _quiet.how_often = "in each run, as no cache directory can be written (XDG_CACHE_HOME sets one)"
    pool = Path(tempfile.mkdtemp(prefix="dolfinx_ffr-"))
    atexit.register(shutil.rmtree, pool, ignore_errors=True)
    return pool


def _usable(pool: Path) -> Path:
    """The directory, in which files can be made and locked."""
    pool.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=pool) as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return pool


def _claim_first_free(pool: Path) -> Path:
    """Lock the first directory of the pool that no living session holds, and tidy it."""
    global _lock
    for number in count():
        directory = pool / f"forms-{number}"
        directory.mkdir(exist_ok=True)
        lock = os.open(directory / "lock", os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
            continue
        _lock = lock
        _remove_unfinished(directory)
        _link_finished(directory)
        return directory
    raise AssertionError("unreachable")


def _link_finished(directory: Path) -> None:
    """Take over the forms that sessions beside this one have compiled to their end."""
    for other in set(directory.parent.glob("forms-*")) - {directory}:
        with contextlib.suppress(OSError):  # no links here, or no longer there: compiled as ever
            changed = other.stat().st_mtime_ns
            if _looked_at.get(other) == changed:
                continue
            _looked_at[other] = changed
            here, there = set(os.listdir(directory)), os.listdir(other)
            libraries = {name.partition(".")[0]: name for name in there if name.endswith(".so")}
            for mark in there:
                stem = mark.removesuffix(".c.cached")
                if stem != mark and stem in libraries and f"{stem}.c" not in here:
                    for name in (f"{stem}.c", libraries[stem], mark):
                        os.link(other / name, directory / name)


def _remove_unfinished(directory: Path) -> None:
    """Remove the forms whose compilation did not come to its end."""
    for source in directory.glob("*.c"):
        if not source.with_suffix(".c.cached").exists():
            # The C file is the mark: it goes last, so that a kill here leaves nothing behind it.
            for leftover in directory.glob(f"{source.stem}.*"):
                if leftover != source:
                    leftover.unlink(missing_ok=True)
            source.unlink(missing_ok=True)
