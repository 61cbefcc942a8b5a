# SPDX-License-Identifier: MIT
"""The folders as a map: which folder may import which, and what each half may use."""

from __future__ import annotations

import ast
import importlib.util
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from shared import processes

#: Source folder of the package, found without importing it.
ROOT = Path(importlib.util.find_spec("dolfinx_ffr").origin).parent  # type: ignore[union-attr, arg-type]
SOURCES = sorted(ROOT.rglob("*.py"))
#: Folders, and modules beside them, from top to bottom: each may import those that stand below it.
FLOORS = (
    "__init__",
    "__main__",
    "scene_file",
    "program",
    "report",
    "paper",
    "optimization",
    "boundary",
    "plotting",
    "part",
    "lower_bound",
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
    "interchange",
    "parallel",
    "verification",
    "archive",
    "limits",
    "validation",
    "files",
    "surroundings",
    "documentation",
    "tensors",
    "arrays",
)
#: What knows nothing of finite elements and of other ranks.
MECHANICAL = ("body", "dynamics", "interchange", "mechanical_problem", "mechanism", "objective")
FINITE_ELEMENTS = {"basix", "dolfinx", "ffcx", "mpi4py", "petsc4py", "slepc4py", "ufl"}
VERSION_QUESTION = re.compile(
    r"__version__|hasattr\((dolfinx|fem|mesh|io|la|plot)\b|packaging\.version|except TypeError"
)


@cache
def nodes(path: Path) -> list[ast.AST]:
    """The syntax of a module."""
    return list(ast.walk(ast.parse(path.read_text())))


def imports(path: Path) -> Iterator[tuple[str, str]]:
    """Imported modules of this package: the name of the folder, and the rest of the path."""
    names_of_path = path.relative_to(ROOT).with_suffix("").parts
    for node in nodes(path):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = [*names_of_path[: len(names_of_path) - node.level]]
            names = [node.module] if node.module else [alias.name for alias in node.names]
            for name in names:
                folder, _, tail = ".".join([*base, name]).partition(".")
                yield folder, tail


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_floors_name_every_folder() -> None:
    folders = {path.relative_to(ROOT).with_suffix("").parts[0] for path in SOURCES}
    assert folders == set(FLOORS)


def test_no_import_runs_upwards() -> None:
    upwards = []
    for path in SOURCES:
        own_folder = path.relative_to(ROOT).with_suffix("").parts[0]
        for folder, _ in imports(path):
            if folder != own_folder and FLOORS.index(folder) <= FLOORS.index(own_folder):
                upwards.append(f"{name(path)} imports {folder}")
    assert not upwards


def test_other_folders_are_entered_by_their_door() -> None:
    """What a folder offers to others stands in its __init__; only _compat is used by its name."""
    past_the_door = []
    for path in SOURCES:
        own_folder = path.relative_to(ROOT).with_suffix("").parts[0]
        for folder, rest in imports(path):
            if folder != own_folder and rest and rest != "_compat":
                past_the_door.append(f"{name(path)} imports {folder}.{rest}")
    assert not past_the_door


def offered_by(path: Path) -> set[str]:
    """What an __init__ imports from its folder, what a module defines without an underscore."""
    names = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.ImportFrom):
            names |= {a.name for a in node.names if node.level == 1 or a.name == a.asname}
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
        elif isinstance(node, ast.AnnAssign):
            names.add(ast.unparse(node.target))
    return {name for name in names if not name.startswith("_")}


def test_names_from_other_folders_are_on_offer_there() -> None:
    """Each is imported in the folder's __init__, so none is private."""
    offered = {path.parent.name: offered_by(path) for path in ROOT.glob("*/__init__.py")}
    offered |= {path.stem: offered_by(path) for path in ROOT.glob("[!_]*.py")}
    private = []
    for path in SOURCES:
        names_of_path = path.relative_to(ROOT).with_suffix("").parts
        for node in nodes(path):
            if not (isinstance(node, ast.ImportFrom) and node.level and node.module):
                continue
            folder, *tail = [
                *names_of_path[: len(names_of_path) - node.level],
                *node.module.split("."),
            ]
            if folder == names_of_path[0] or tail:
                continue
            names = {alias.name for alias in node.names} - {"_compat"}
            private += [f"{name(path)}: {n}" for n in names - offered[folder]]
    assert not private


def test_a_folder_says_once_what_it_offers() -> None:
    """The imports of its __init__ are the table of contents; nothing within has a list of names."""
    lists = [name(path) for path in SOURCES if "__all__ = [" in path.read_text()]
    assert lists == ["dynamics/kinematics/__init__.py"]


def test_time_integration_knows_kinematics_by_their_door_alone() -> None:
    """So bodies in the plane and in space are integrated by the same methods."""
    past_the_door = []
    for path in sorted((ROOT / "dynamics" / "integration").glob("*.py")):
        for folder, rest in imports(path):
            if folder == "dynamics" and rest.startswith("kinematics."):
                past_the_door.append(f"{name(path)} imports {rest}")
    assert not past_the_door


def test_folders_are_free_of_circles() -> None:
    """No module imports itself by way of others."""
    edges: dict[str, set[str]] = {}
    for path in SOURCES:
        names_of_path = path.relative_to(ROOT).with_suffix("").parts
        if path.name == "__init__.py":
            continue
        names = edges.setdefault(".".join(names_of_path), set())
        for folder, rest in imports(path):
            if folder == names_of_path[0] and rest:
                names.add(f"{folder}.{rest}")
    edges_left = dict(edges)
    while leaves := [
        module for module, below in edges_left.items() if not below & edges_left.keys()
    ]:
        for module in leaves:
            del edges_left[module]
    assert not edges_left


@pytest.mark.parametrize(
    ("modules", "others"),
    [
        ([f"dolfinx_ffr.{name}" for name in MECHANICAL], FINITE_ELEMENTS),
        (["dolfinx_ffr"], {"dolfinx", "numba", "pyvista"}),
    ],
    ids=["mechanical half", "package"],
)
def test_what_is_imported_with_it(modules: list[str], others: set[str]) -> None:
    """No finite elements with the mechanical half, and nothing heavy with the package itself."""
    program = (
        f"import importlib, sys\nfor name in {modules!r}:\n    importlib.import_module(name)\n"
    )
    program += f"print(*sorted({others!r} & set(sys.modules)))\n"
    run = processes.run("-c", program)
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == []


def test_source_files() -> None:
    for path in SOURCES:
        text = path.read_text()
        assert text.startswith("# SPDX-License-Identifier: MIT\n"), name(path)
        assert ast.get_docstring(ast.parse(text)), f"{name(path)}: no module docstring"


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


#: Questions whether a mechanism is in the plane or in space, outside the two files of its bodies.
MOST_SWITCHES = 10
SWITCH = re.compile(
    r"dimension (==|!=|<|>) ?[23]|\bd (==|!=|<|>) [23]\b|is_spatial\(|isinstance\(.*(Space|Plane)"
)


def test_plane_and_space_are_told_apart_in_few_places() -> None:
    switches = [
        f"{name(path)}: {line.strip()}"
        for path in SOURCES
        if name(path).startswith(("dynamics/", "mechanism/"))
        and path.name not in {"bodies_plane.py", "bodies_space.py"}
        for line in path.read_text().splitlines()
        if SWITCH.search(line) and "def " not in line
    ]
    remedy = "ask what a row or a body has, or use a method of PlaneArrays and SpaceArrays"
    assert len(switches) <= MOST_SWITCHES, "\n".join([remedy, *switches])


def test_a_joint_states_its_rows_once() -> None:
    """In vectors, for the plane and for space: no second method, and no second class."""
    for module, method in (("joints", "rows"), ("forces", "element")):
        tree = ast.parse((ROOT / "mechanism" / f"{module}.py").read_text())
        for kind in (node for node in tree.body if isinstance(node, ast.ClassDef)):
            own_methods = [node.name for node in kind.body if isinstance(node, ast.FunctionDef)]
            alike = [n for n in own_methods if re.search(rf"(^|_){method}($|_)", n)]
            assert alike in ([], [method]), f"{kind.name}: {alike}"
            assert not re.search(r"Spatial|InSpace|Planar(?!$)|InPlane", kind.name), kind.name
