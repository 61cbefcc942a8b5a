# SPDX-License-Identifier: MIT
"""The folders as a map: what stands above what, what each half may use, how long modules may be."""

from __future__ import annotations

import ast
import importlib.util
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

#: Source folder of the package, found without importing it.
ROOT = Path(importlib.util.find_spec("dolfinx_ffr").origin).parent  # type: ignore[union-attr, arg-type]
SOURCES = sorted(ROOT.rglob("*.py"))
#: Folders, and modules beside them, from top to bottom: each may import those that stand below it.
FLOORS = (
    "__main__",
    "program",
    "report",
    "optimization",
    "plotting",
    "gradients",
    "part",
    "postprocessing",
    "problem",
    "mechanical_problem",
    "objective",
    "design",
    "reduction",
    "dynamics",
    "io",
    "fem",
    "body",
    "mechanism",
    "parallel",
    "verification",
    "validation",
    "caches",
    "files",
)
#: What knows nothing of finite elements and of other ranks.
MECHANICAL = ("body", "dynamics", "mechanical_problem", "mechanism", "objective")
FINITE_ELEMENTS = {"basix", "dolfinx", "ffcx", "mpi4py", "petsc4py", "slepc4py", "ufl"}
MAX_LINES = 600
VERSION_QUESTION = re.compile(
    r"__version__|hasattr\((dolfinx|fem|mesh|io|la|plot)\b|packaging\.version|except TypeError"
)


def imports(path: Path) -> Iterator[tuple[str, str]]:
    """Imported modules of this package: the name of the folder, and the rest of the path."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = [*parts[: len(parts) - node.level]]
            names = [node.module] if node.module else [alias.name for alias in node.names]
            for name in names:
                folder, _, rest = ".".join([*base, name]).partition(".")
                yield folder, rest


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_floors_name_every_folder() -> None:
    here = {path.relative_to(ROOT).with_suffix("").parts[0] for path in SOURCES}
    assert here - {"__init__"} == set(FLOORS)


def test_no_import_runs_upwards() -> None:
    upwards = []
    for path in SOURCES:
        own = path.relative_to(ROOT).with_suffix("").parts[0]
        for folder, _ in imports(path):
            if folder != own and FLOORS.index(folder) <= FLOORS.index(own):
                upwards.append(f"{name(path)} imports {folder}")
    assert not upwards


def test_other_folders_are_entered_by_their_door() -> None:
    """What a folder offers to others stands in its __init__; only _compat is used by its name."""
    past_the_door = []
    for path in SOURCES:
        own = path.relative_to(ROOT).with_suffix("").parts[0]
        for folder, rest in imports(path):
            if folder != own and rest and rest != "_compat":
                past_the_door.append(f"{name(path)} imports {folder}.{rest}")
    assert not past_the_door


def test_time_integration_knows_no_kind_of_kinematics_but_by_its_door() -> None:
    """So any kind, in the folders `planar` and `spatial`, is integrated by the same methods."""
    past_the_door = []
    for path in sorted((ROOT / "dynamics" / "integration").glob("*.py")):
        for folder, rest in imports(path):
            if folder == "dynamics" and rest.startswith(("planar", "spatial")):
                past_the_door.append(f"{name(path)} imports {rest}")
    assert not past_the_door


def test_folders_are_free_of_circles() -> None:
    """No module imports itself by way of others."""
    edges: dict[str, set[str]] = {}
    for path in SOURCES:
        parts = path.relative_to(ROOT).with_suffix("").parts
        if path.name == "__init__.py":
            continue
        found = edges.setdefault(".".join(parts), set())
        for folder, rest in imports(path):
            if folder == parts[0] and rest:
                found.add(f"{folder}.{rest}")
    left = dict(edges)
    while leaves := [module for module, below in left.items() if not below & left.keys()]:
        for module in leaves:
            del left[module]
    assert not left


def test_mechanical_half_needs_no_finite_elements() -> None:
    program = (
        "import importlib, sys\n"
        f"for name in {MECHANICAL!r}:\n"
        "    importlib.import_module('dolfinx_ffr.' + name)\n"
        f"print(*sorted({FINITE_ELEMENTS!r} & set(sys.modules)))\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == []


def test_package_itself_imports_nothing_heavy() -> None:
    heavy = {"dolfinx", "numba", "pyvista"}
    program = f"import sys, dolfinx_ffr; print(*sorted({heavy!r} & set(sys.modules)))"
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == []


def test_source_files() -> None:
    for path in SOURCES:
        text = path.read_text()
        assert text.startswith("# SPDX-License-Identifier: MIT\n"), name(path)
        assert ast.get_docstring(ast.parse(text)), f"{name(path)}: no module docstring"
        assert text.count("\n") <= MAX_LINES, f"{name(path)} is too long"


def test_only_compat_asks_which_release_is_installed() -> None:
    asking = [
        name(path)
        for path in SOURCES
        if path.name not in {"_compat.py", "__init__.py"}
        and VERSION_QUESTION.search(path.read_text())
    ]
    assert not asking
    compat = (ROOT / "fem" / "_compat.py").read_text()
    assert not re.search(r"__version__|packaging", compat)
