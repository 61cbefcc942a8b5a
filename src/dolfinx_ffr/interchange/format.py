# SPDX-License-Identifier: MIT
"""The protocol of file formats, checksums of texts, and the arrays of a body."""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ..arrays import Array

#: A body by key, see `numpy_file`; ``damping`` (modes, modes) may stand there, too
Arrays = Mapping[str, Any]
#: Pattern of the checksum in a text
_SEAL = re.compile(rb"dolfinx_ffr crc32=([0-9a-f]{8})")
SEAL = "dolfinx_ffr crc32=00000000"

#: Properties that a format may be unable to hold, with the keys of their arrays
FEATURES = {
    "geometric stiffening": ("stiffening_rotation", "stiffening_acceleration"),
    "stiffening by forces at markers": ("marker_stiffening",),
    "axes of markers": ("marker_axes",),
    "rotations of markers": ("marker_rotations",),
    "damping": ("damping",),
}


class InterchangeWarning(UserWarning):
    """A file cannot hold a property of a body, or a property in a file is not used."""


class Format(Protocol):
    """A file format for a body in space."""

    name: str  #: Name for the argument ``format``
    endings: tuple[str, ...]  #: Endings of its files; the first one is usual
    holds: tuple[str, ...]  #: Properties of `FEATURES` that it can hold

    def write(self, path: Path, arrays: Arrays) -> None:
        """Write a body, its ``arrays`` by key, to a ``path`` completely or not at all."""
        ...


@runtime_checkable
class ReadableFormat(Format, Protocol):
    """A file format whose files have all that makes a body."""

    def read(self, path: Path) -> dict[str, Any]:
        """The arrays of the body at a ``path``; a ValueError explains the defect of a file."""
        ...


def sealed(text: str) -> bytes:
    """A text whose `SEAL` is replaced by its checksum."""
    content = text.encode()
    return content.replace(SEAL.encode(), b"%s%08x" % (SEAL[:-8].encode(), zlib.crc32(content)), 1)


def unsealed(path: Path) -> str:
    """The text of a file; a ValueError if it has a checksum that differs from its own."""
    content = path.read_bytes()
    if checksum := _SEAL.search(content):
        unstamped = _SEAL.sub(SEAL.encode(), content, count=1)
        if int(checksum[1], 16) != zlib.crc32(unstamped):
            raise ValueError(
                "the file was changed or cut after it was written (its checksum differs); write it "
                "again, or delete the checksum if the change was meant"
            )
    try:
        return content.decode()
    except UnicodeDecodeError as error:
        raise ValueError(f"the file is damaged or no text: {error}") from None


def number(text: str, line: int) -> float:
    """The number in a text, whose exponent may be Fortran's."""
    try:
        value = float(text.replace("D", "E").replace("d", "e"))
    except ValueError:
        raise ValueError(f"line {line}: {text!r} is no number") from None
    if not np.isfinite(value):
        raise ValueError(f"line {line}: {text!r} is not finite")
    return value


def elastic(arrays: Arrays) -> tuple[Array, ...]:
    """Mass, S, P and K of a body."""
    S = arrays["S"]
    r = len(S) - 1
    return np.asarray(arrays["mass"]), S, arrays["P"], arrays.get("K", np.zeros((r, r)))


def markers(arrays: Arrays) -> tuple[list[str], dict[str, Array]]:
    """Names of the markers, and their arrays without the prefix; none where they are missing."""
    r = len(arrays["S"]) - 1
    names = [str(name) for name in arrays.get("markers", np.zeros(0, dtype=np.str_)).ravel()]
    n = len(names)
    zeros = {
        "positions": np.zeros((n, 3)),
        "displacements": np.zeros((n, 3, r)),
        "rotations": np.zeros((n, 3, r)),
        "stiffening": np.zeros((n, 3, r, r)),
        "axes": np.broadcast_to(np.eye(3), (n, 3, 3)),
    }
    return names, {key: arrays.get(f"marker_{key}", default) for key, default in zeros.items()}
