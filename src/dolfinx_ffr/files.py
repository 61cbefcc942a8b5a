# SPDX-License-Identifier: MIT
"""Writing of files: in one stroke, and with the file's name in errors."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["named_in_errors", "replace_file"]


def replace_file(path: Path, content: bytes) -> None:
    """Write a file beside its place and move it there: a reader finds the old one or the new one.

    Args:
        path: The file, in a directory that is there.
        content: What it holds.

    Raises:
        OSError: With the name of the file, if it cannot be written; an older one stays.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with open(beside, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    except OSError as error:  # a full disk names no file, other errors name the one beside
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        beside.unlink(missing_ok=True)


@contextmanager
def named_in_errors(path: Path) -> Iterator[None]:
    """Context in which errors of writing name the file, as that of a full disk does not.

    Args:
        path: The file.

    Raises:
        OSError: With the name of the file.
    """
    try:
        yield
    except OSError as error:
        if error.filename is not None or error.errno is None:
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error
