# SPDX-License-Identifier: MIT
"""The check of a file of a stranger before gmsh sees it.

gmsh takes a file for what its name and its first line suggest. Whatever it does not know is for it
a program in its own language (``.geo``), which can execute commands of the shell, and so is a file
``NAME.opt`` beside ``NAME``. Therefore gmsh is given only copies that begin as a mesh does, in a
folder that is empty otherwise, under a name that this package has chosen.
"""

from __future__ import annotations

import mmap
import re
import shutil
import struct
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

#: First line of a mesh in the formats 2 and 4 of gmsh
_HEAD = b"$MeshFormat"
#: Heads of sections whose first line counts what follows; without "^", which would be slow
_COUNTED = re.compile(rb"\n\$(Nodes|ParametricNodes|Elements)[ \t\r]*\n")
#: First bytes of files that people take for meshes, and what to do with each
_OTHERS = {
    b"\x1f\x8b": "compressed by gzip; unpack it (gunzip) and give the .msh file",
    b"BZh": "compressed by bzip2; unpack it (bunzip2) and give the .msh file",
    b"\xfd7zXZ": "compressed by xz; unpack it (unxz) and give the .msh file",
    b"PK": "a zip archive; unpack it (unzip) and give the .msh file",
    b"ISO-10303-21": "a STEP file, a geometry without a mesh; let gmsh mesh it, and save as .msh",
    b"DBRep_DrawableShape": "a BREP file, a geometry without a mesh; let gmsh mesh it",
    b"CASCADE Topology": "a BREP file, a geometry without a mesh; let gmsh mesh it",
    b"$NOD": "a mesh in format 1 of gmsh; save it in format 4.1 or 2.2",
}


@dataclass(frozen=True)
class FormatOptions:
    """What of a file is looked at, and what it can hold."""

    line: int = (
        1000  #: Bytes of a line that are looked at; those that are read here are far shorter
    )
    shown: int = 40  #: Characters of a foreign line that a message shows
    #: A node or an element takes at least so many bytes of a file, "1 1" and the end of the line
    least_bytes: int = 4


FORMAT = FormatOptions()


@contextmanager
def private_copy(path: Path) -> Iterator[Path]:
    """Copy a mesh into a folder of this user alone, as long as the context lasts.

    The copy is what has been checked, whatever happens to the file meanwhile.
    """
    with tempfile.TemporaryDirectory(prefix="dolfinx_ffr-mesh-") as folder:
        copy = Path(folder) / "mesh.msh"
        shutil.copyfile(path, copy)
        with open(copy, "rb") as file:
            head, second = file.readline(FORMAT.line), file.readline(FORMAT.line)
            _check_head(head, second, path)
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
                _check_counts(content, second, path)
        yield copy


def _check_head(head_line: bytes, second: bytes, path: Path) -> None:
    """Refuse a file whose first two lines do not begin a mesh."""
    if not head_line.startswith(_HEAD):
        for head, description in _OTHERS.items():
            if head_line.startswith(head):
                raise ValueError(f"{path} is not a mesh of gmsh: it is {description}")
        if not head_line:
            raise ValueError(f"{path} is not a mesh of gmsh: it is empty")
        line = head_line[: FORMAT.shown].decode("utf-8", "replace").rstrip("\r\n")
        raise ValueError(
            f"{path} is not a mesh of gmsh: it begins with {line!r} instead of $MeshFormat. gmsh "
            "would execute such a file as a program (.geo), so it is not read; if you trust "
            "this program, let gmsh make a mesh of it (gmsh -2 FILE.geo -o FILE.msh, in space -3) "
            "and give that"
        )
    if not re.fullmatch(rb"\s*[24](\.\d*)?\s+[01]\s+\d+\s*", second):
        line = second[: FORMAT.shown].decode("utf-8", "replace").rstrip("\r\n")
        raise ValueError(
            f"{path}: the line below $MeshFormat is {line!r}, and only the formats 2 and 4 are "
            "read; save the mesh in format 4.1 or 2.2"
        )


def _check_counts(content: mmap.mmap, format_line: bytes, path: Path) -> None:
    """Refuse a file that promises more nodes or elements than its bytes can hold.

    Memory would be taken for as many before the first of them is read.
    """
    version, binary, size = format_line.split()
    for section in _COUNTED.finditer(content):
        things = "elements" if section[1] == b"Elements" else "nodes"
        start = section.end()
        if version.startswith(b"4") and binary == b"1":
            if size != b"8":
                raise ValueError(f"{path}: its numbers have {size.decode()} bytes instead of 8")
            # blocks, nodes or elements, smallest and largest tag
            block = content[start : start + 16].ljust(16, b"\0")
            count = min(struct.unpack(order, block)[1] for order in ("<2Q", ">2Q"))
        else:
            line = content[start : start + FORMAT.line].split(b"\n", 1)[0].split()
            position = 1 if version.startswith(b"4") else 0
            if len(line) <= position or not line[position].isdigit():
                raise ValueError(f"{path}: there is no number of its {things}; the file is damaged")
            count = int(line[position])
        if count * FORMAT.least_bytes > len(content):
            raise ValueError(
                f"{path} promises {count:,} {things}, which its {len(content):,} bytes cannot "
                "hold; the file is damaged or was cut short: write it again"
            )
