# SPDX-License-Identifier: MIT
"""Files that are written whole or not at all, names that are safe, locks, and spare folders.

Files that other files include are read only where they came with them.
"""

from __future__ import annotations

import codecs
import errno
import fcntl
import os
import re
import stat
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

#: Files that runs and reports leave in a folder beside the folders of bodies
_TAKEN = ("checkpoint", "history.csv", "report.html", "summary.json")
#: Characters of a name that a file name keeps at most; file systems take 255 bytes
_LONGEST = 60


def file_names(names: Iterable[str]) -> dict[str, str]:
    """A safe file or folder name for each of several names, different from each other.

    Letters, digits, hyphens and underscores stay, anything else becomes an underscore, so that no
    name leads out of its folder. Where two would become the same, also where small and
    large letters count alike, the later one gets a number; a name that is safe stays.
    """
    distinct = list(dict.fromkeys(names))
    safe = {name: re.sub(r"^-|[^\w-]", "_", name)[:_LONGEST] or "_" for name in distinct}
    file_name: dict[str, str] = {}
    used = {name.casefold() for name in _TAKEN}
    for name in sorted(distinct, key=lambda name: safe[name] != name):
        candidate, number = safe[name], 1
        while candidate.casefold() in used:
            number += 1
            candidate = f"{safe[name]}-{number}"
        used.add(candidate.casefold())
        file_name[name] = candidate
    return {name: file_name[name] for name in distinct}


def included_file(name: str, folder: Path) -> Path:
    """The path of a file that a file in a ``folder`` includes by ``name``.

    What a stranger's file names is read only if it came with it: in its folder, or below.
    """
    relative = Path(name)
    path = folder / relative
    inside = path.resolve().is_relative_to(folder.resolve())
    if relative.is_absolute() or ".." in relative.parts or not inside:
        raise ValueError(
            f"it includes {name!r}, which is outside of its folder, and only files in its folder "
            "or below are read; copy that file there, and include it by its name there"
        )
    return path


def text_of(path: Path) -> str:
    """The text of a file that a person or another program has written.

    It is in UTF-8, or in UTF-16 with a byte order mark; any other file is read as Latin-1.
    """
    data = path.read_bytes()
    utf_16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = data.decode("utf-16" if utf_16 else "utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    if "\0" in text:
        raise ValueError(f"{path} is no text that can be read; save it as UTF-8")
    return text


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A path beside a file to write to, from which it is moved to its place in one stroke.

    A reader finds the old file or the new one, and none that is cut. Errors name the file.
    """
    beside = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    with named_in_errors(path, beside):
        try:
            try:
                yield beside
            except Exception:
                if beside.exists():
                    _check_end(beside)  # a full disk is why libraries fail with their own errors
                raise
            _check_end(beside)
            os.replace(beside, path)
        finally:
            beside.unlink(missing_ok=True)


@contextmanager
def named_in_errors(path: Path, beside: Path) -> Iterator[None]:
    """Context in which errors of writing to ``beside`` name the file ``path``."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename not in (None, str(beside), os.fspath(path)):
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error


def check_room(path: Path, size: int) -> None:
    """Refuse to begin with a new file that may take ``size`` bytes, if there is less room."""
    try:
        with open(path, "wb") as file:
            if hasattr(os, "posix_fallocate"):  # not on every system
                os.posix_fallocate(file.fileno(), 0, size)
    finally:
        path.unlink(missing_ok=True)


def _check_end(file: Path) -> None:
    """Refuse a file that was cut because the disk is full, which writers in C++ do not report."""
    if not file.exists():
        raise OSError(errno.EIO, "nothing was written", str(file))
    with open(file, "ab") as end:
        length = end.tell()
        end.write(b" ")
        end.flush()
        os.ftruncate(end.fileno(), length)
        os.fsync(end.fileno())


def replace_file(path: Path, content: bytes) -> None:
    """Write a file in one stroke, see `whole_file`."""
    with whole_file(path) as beside:
        beside.write_bytes(content)


def locked(path: Path) -> int:
    """Lock a file for this process, and make it if need be; the result is for `unlocked`.

    The lock ends with the process, however that ends. Where another process or call holds it, a
    BlockingIOError is raised; an OSError without a file name means a file system without locks.
    """
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # its holder may have removed it meanwhile: a lock on a file without a name is useless
            if path.exists() and os.path.samestat(os.stat(path), os.fstat(file)):
                return file
        except OSError:
            os.close(file)
            raise
        os.close(file)


def unlocked(path: Path, file: int) -> None:
    """Give up a lock that `locked` returned, and remove its file."""
    path.unlink(missing_ok=True)
    fcntl.flock(file, fcntl.LOCK_UN)  # also for processes that were forked meanwhile
    os.close(file)


def spare_directory() -> Path | None:
    """A directory of this user alone among the temporary files, None if there can be none."""
    path = Path(tempfile.gettempdir()) / f"dolfinx_ffr-{os.getuid()}"
    try:
        path.mkdir(mode=0o700, exist_ok=True)
        status = path.lstat()
    except OSError:
        return None
    ours = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
    others = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return path if ours and not others and os.access(path, os.W_OK | os.X_OK) else None
