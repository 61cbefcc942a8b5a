# SPDX-License-Identifier: MIT
"""The directory in which DOLFINx keeps the compiled forms of this session.

FFCx marks a form that is being compiled by the existence of its C file. When a run is killed
meanwhile, the mark stays, and every later run waits for that compiler until it gives up. So each
session locks the first free directory of ``$XDG_CACHE_HOME/dolfinx_ffr/forms-0``, ``forms-1``, ...,
removes the unfinished forms there, and links finished ones of the others whenever it makes a mesh.
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
from pathlib import Path

from mpi4py import MPI

from ..files import locked, spare_directory
from ..parallel import on_every_rank
from . import _compat

#: Directory that this process uses, and on the rank that holds it the open file with the lock.
_directory: Path | None = None
_lock: int | None = None
#: When the directories beside it had last been changed when their forms were taken over [ns].
_looked_at: dict[Path, int] = {}


def claim_form_cache(comm: MPI.Intracomm) -> Path:
    """Make DOLFINx keep compiled forms in a directory that this session alone uses.

    Calling it again takes over what other sessions have compiled since.
    """
    global _directory
    if _quiet not in logging.getLogger().filters:
        logging.getLogger().addFilter(_quiet)
    directories = comm.allgather(_directory)
    if directories[0] is not None and directories == [directories[0]] * len(directories):
        if comm.rank == 0 and _lock is not None:
            _link_finished(directories[0])
        return directories[0]
    with on_every_rank(comm, "the directory of compiled forms"):
        if comm.rank == 0 and _directory is None:
            try:
                _directory = _claim_first_free(_pool())
            except OSError as error:
                raise RuntimeError(f"no directory for compiled forms: {error}") from error
    _directory = comm.bcast(_directory)
    _compat.set_form_cache(_directory)
    return _directory


class _Announcement(logging.Filter):
    """One line on the screen in place of each command that the compiler is called with."""

    said = False
    how_often = "once"

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a ``record`` is shown."""
        if "distutils" not in record.pathname or record.levelno >= logging.WARNING:
            return True
        if not self.said:
            message = f"compiling finite-element forms, {self.how_often}: about 10 s"
            print(message, file=sys.stderr, flush=True)
            self.said = True
        return False


_quiet = _Announcement()


def _pool() -> Path:
    """The pool, where files can be locked: the user's, a temporary one, or this process's alone."""
    users = os.environ.get("XDG_CACHE_HOME")
    for place in (lambda: Path(users or Path.home() / ".cache") / "dolfinx_ffr", spare_directory):
        with contextlib.suppress(OSError, RuntimeError):
            if (pool := place()) is not None:
                pool.mkdir(parents=True, exist_ok=True)
                with tempfile.TemporaryFile(dir=pool) as file:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return pool
    _quiet.how_often = "in each run, as no cache directory can be written (XDG_CACHE_HOME sets one)"
    pool = Path(tempfile.mkdtemp(prefix="dolfinx_ffr-"))
    atexit.register(shutil.rmtree, pool, ignore_errors=True)
    return pool


def _claim_first_free(pool: Path) -> Path:
    """Lock the first directory of the pool that no living session holds, and tidy it."""
    global _lock
    number = 0
    while True:
        directory = pool / f"forms-{number}"
        directory.mkdir(exist_ok=True)
        try:
            _lock = locked(directory / "lock")
        except BlockingIOError:
            number += 1
            continue
        _remove_unfinished(directory)
        _link_finished(directory)
        return directory


def _link_finished(directory: Path) -> None:
    """Take over the forms that sessions beside this one have compiled to their end."""
    for neighbour in set(directory.parent.glob("forms-*")) - {directory}:
        with contextlib.suppress(OSError):  # no links here, or no longer there: compiled as ever
            changed = neighbour.stat().st_mtime_ns
            if _looked_at.get(neighbour) == changed:
                continue
            _looked_at[neighbour] = changed
            names, names_of_neighbour = set(os.listdir(directory)), os.listdir(neighbour)
            libraries = {
                name.partition(".")[0]: name for name in names_of_neighbour if name.endswith(".so")
            }
            for mark in names_of_neighbour:
                stem = mark.removesuffix(".c.cached")
                if stem != mark and stem in libraries and f"{stem}.c" not in names:
                    for name in (f"{stem}.c", libraries[stem], mark):
                        os.link(neighbour / name, directory / name)


def _remove_unfinished(directory: Path) -> None:
    """Remove the forms whose compilation did not come to its end."""
    for source in directory.glob("*.c"):
        if not source.with_suffix(".c.cached").exists():
            # The C file is the mark: it goes last, so that a kill here leaves nothing behind it.
            for leftover in directory.glob(f"{source.stem}.*"):
                if leftover != source:
                    leftover.unlink(missing_ok=True)
            source.unlink(missing_ok=True)
