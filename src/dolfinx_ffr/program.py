# SPDX-License-Identifier: MIT
"""The end of a program that was given wrong input: one line."""

from __future__ import annotations

import io
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path

#: Time for which ranks wait for each other at the end [s]
_PATIENCE = 5.0


def run(main: Callable[[], object]) -> None:
    """Run a program, and end it by one line where it fails because of what it was given.

    Errors that a `raise` statement of this package or of the program raises, files that cannot be
    read or written and missing memory say in their message what is wrong and what to do; ``python
    -X dev`` shows where they were raised. Other errors keep their traceback.
    """
    for stream in (sys.stdout, sys.stderr):
        # a title may have letters that the terminal has not
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        main()
    except (MemoryError, OSError) as error:
        _end(error)
    except (ImportError, RuntimeError, TypeError, ValueError) as error:
        if not refused(error):
            raise
        _end(error)


def _end(error: Exception) -> None:
    """End the program by one line, or raise the error where developers ask for that."""
    if sys.flags.dev_mode:
        raise error
    path = Path(sys.argv[0])
    name = f"python -m {path.parent.name}" if path.name == "__main__.py" else path.name
    message, mpi = f"{name}: {error}", sys.modules.get("mpi4py.MPI")
    if mpi is None or mpi.COMM_WORLD.size == 1:
        sys.exit(message)

    def together() -> bool:
        """Wait for the other ranks; whether they came."""
        barrier, patience = mpi.COMM_WORLD.Ibarrier(), time.monotonic() + _PATIENCE
        while not (came := barrier.Test()) and time.monotonic() < patience:
            time.sleep(0.01)
        return bool(came)

    # an error of all ranks is printed once
    if not together() or mpi.COMM_WORLD.rank == 0:
        print(message, file=sys.stderr, flush=True)
    together()  # mpirun ends the others with the first that has ended
    sys.exit(1)


def refused(error: Exception) -> bool:
    """Whether a `raise` statement of this package or of the program has raised an error."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    path = Path(last.filename).resolve()
    ours = path == Path(sys.argv[0]).resolve() or path.is_relative_to(Path(__file__).parent)
    return ours and (last.line or "").startswith("raise ")
