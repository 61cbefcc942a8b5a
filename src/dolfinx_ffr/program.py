# SPDX-License-Identifier: MIT
"""The last line of a program that was given something wrong."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from pathlib import Path

__all__ = ["run"]


def run(main: Callable[[], object]) -> None:
    """Run a program, and end it by one line where it fails for what it was given.

    What this package or the program itself refuses, files that cannot be read or written and memory
    that is not there say in their message what is wrong and what to do; where in the sources they
    were raised is shown by ``python -X dev``. Other errors keep their traceback.

    Args:
        main: The program.
    """
    try:
        main()
    except (MemoryError, OSError) as error:
        _end(error)
    except (ImportError, RuntimeError, TypeError, ValueError) as error:
        if not _refused(error):
            raise
        _end(error)


def _end(error: Exception) -> None:
    """End the program by one line, or raise the error where developers ask for that."""
    if sys.flags.dev_mode:
        raise error
    sys.exit(f"{Path(sys.argv[0]).name}: {error}")


def _refused(error: Exception) -> bool:
    """Whether a statement of this package or the program has raised an error, and no slip."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    path = Path(last.filename).resolve()
    own = path == Path(sys.argv[0]).resolve() or path.is_relative_to(Path(__file__).parent)
    return own and (last.line or "").startswith("raise ")
