# SPDX-License-Identifier: MIT
"""Arrays in archives of NumPy (.npz), whose shapes are known before they are read.

A packed archive of megabytes can contain gigabytes of zeros, so the sizes in its heads are checked
first.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .limits import available_memory

#: How the heads of arrays are read, by the version of the format
_HEADS: dict[tuple[int, int], Callable[..., Any]] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


@dataclass(frozen=True)
class Head:
    """The head of an array in an archive."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]


@dataclass(frozen=True)
class Archive:
    """An archive of arrays: the bytes of its file, and what it promises by the arrays' names."""

    content: bytes
    heads: Mapping[str, Head]

    @staticmethod
    def of(content: bytes, *, packed: bool = True) -> Archive:
        """The archive with the bytes of a file; its arrays may be compressed if ``packed``."""
        with _damaged():
            with zipfile.ZipFile(io.BytesIO(content)) as members:
                names = members.namelist()
                heads = {name.removesuffix(".npy"): _head(members, name) for name in names}
        promised = sum(math.prod(head.shape) * head.dtype.itemsize for head in heads.values())
        most = available_memory() if packed else len(content)
        if promised > most:
            room = "the free memory" if packed else "the file itself"
            raise ValueError(
                f"its arrays need {promised:,} bytes, more than {room} has, {most:,} bytes"
            )
        return Archive(content, heads)

    def read(self) -> dict[str, NDArray[Any]]:
        """All arrays by name, which have been compared with their checksums."""
        with _damaged(), np.load(io.BytesIO(self.content), allow_pickle=False) as arrays:
            # how many there are stands at the end of the archive, which nothing else compares
            if int.from_bytes(self.content[-12:-10], "little") != len(arrays.files):
                raise ValueError("some arrays of the file are lost")
            return {key: arrays[key] for key in arrays.files}


@contextmanager
def _damaged() -> Iterator[None]:
    """Context in which a damaged archive is a ValueError: it raises anything from within."""
    try:
        yield
    except Exception as error:
        raise ValueError(str(error)) from error


def _head(archive: zipfile.ZipFile, name: str) -> Head:
    """The head of an array, whose size must equal the size of its member of the archive."""
    with archive.open(name) as member:
        version = np.lib.format.read_magic(member)
        if version not in _HEADS:
            raise ValueError(f"{name} has the unknown version {version} of NumPy's format")
        shape, _, dtype = _HEADS[version](member)
        size = member.tell() + math.prod(shape) * dtype.itemsize
    if dtype.hasobject:
        raise ValueError(f"{name} holds objects of Python, which are never read")
    if size != archive.getinfo(name).file_size:
        raise ValueError(f"{name} has another size than its shape {shape} says")
    return Head(shape, dtype)
