# SPDX-License-Identifier: MIT
"""The check of a file of a stranger before gmsh sees it.

gmsh takes a file for what its name and its first line suggest. Whatever it does not know is for it
a program in its own language (``.geo``), which can execute commands of the shell, and so is a file
``NAME.opt`` beside ``NAME``. Therefore gmsh is given only copies that begin as a mesh does, in a
folder that is empty otherwise, under a name that this package has chosen.
"""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: First line of a mesh in the formats 2 and 4 of gmsh
_HEAD = b"$MeshFormat"
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


#: Bytes of a line that are looked at, and characters of a foreign one that a message shows
_LINE, _SHOWN = 1000, 40


@contextmanager
def private_copy(path: Path) -> Iterator[Path]:
    """Copy a mesh into a folder of this user alone, as long as the context lasts.

    The copy is what has been checked, whatever happens to the file meanwhile.
    """
    with tempfile.TemporaryDirectory(prefix="dolfinx_ffr-mesh-") as folder:
        copy = Path(folder) / "mesh.msh"
        shutil.copyfile(path, copy)
        with open(copy, "rb") as file:
            head, second = file.readline(_LINE), file.readline(_LINE)
        _check_head(head, second, path)
        yield copy


def _check_head(head_line: bytes, second: bytes, path: Path) -> None:
    """Refuse a file whose first two lines do not begin a mesh."""
    if not head_line.startswith(_HEAD):
        for head, description in _OTHERS.items():
            if head_line.startswith(head):
                raise ValueError(f"{path} is not a mesh of gmsh: it is {description}")
        if not head_line:
            raise ValueError(f"{path} is not a mesh of gmsh: it is empty")
        line = head_line[:_SHOWN].decode("utf-8", "replace").rstrip("\r\n")
        raise ValueError(
            f"{path} is not a mesh of gmsh: it begins with {line!r} instead of $MeshFormat. gmsh "
            "would execute such a file as a program (.geo), so it is not read; if you trust "
            "this program, let gmsh make a mesh of it (gmsh -2 FILE.geo -o FILE.msh, in space -3) "
            "and give that"
        )
    if not re.fullmatch(rb"\s*[24](\.\d*)?\s+[01]\s+\d+\s*", second):
        line = second[:_SHOWN].decode("utf-8", "replace").rstrip("\r\n")
        raise ValueError(
            f"{path}: the line below $MeshFormat is {line!r}, and only the formats 2 and 4 are "
            "read; save the mesh in format 4.1 or 2.2"
        )
