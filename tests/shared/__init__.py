# SPDX-License-Identifier: MIT
"""What several tests use: bodies, meshes, scenes."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

#: The source tree.
TOP = Path(__file__).resolve().parents[2]


def names_of_program(page: Path, name: str) -> dict[str, Any]:
    """What the program of a page defines that has a class of some name."""
    programs = re.findall(r"^```python\n(.*?)^```", page.read_text(), re.M | re.S)
    (program,) = [each for each in programs if f"class {name}" in each]
    names: dict[str, Any] = {}
    before = "from dataclasses import dataclass\nimport numpy as np\nimport ufl\n"
    before += "from dolfinx import fem\nimport dolfinx_ffr as ffr\n"
    names["__name__"] = __name__  # in which dataclasses look for their annotations
    exec(compile(before + program, f"{page.name}, {name}", "exec"), names)  # the page is ours
    return names
