# SPDX-License-Identifier: MIT
"""The package as a whole: names, documentation, and which module may use what."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import dolfinx_ffr

ROOT = Path(dolfinx_ffr.__file__).parent
SOURCES = sorted(ROOT.rglob("*.py"))
#: Modules that know nothing of finite elements and of other ranks.
MECHANICAL = [
    "body",
    "body_file",
    "dynamics",
    "forces",
    "joints",
    "mechanical_problem",
    "mechanism",
    "motion",
    "objective",
    "parametric_body",
    "points",
    "start",
]
FINITE_ELEMENTS = {"basix", "dolfinx", "ffcx", "mpi4py", "petsc4py", "slepc4py", "ufl"}
MAX_LINES = 650
VERSION_QUESTION = re.compile(
    r"__version__|hasattr\((dolfinx|fem|mesh|io|la|plot)\b|packaging\.version|except TypeError"
)


def module_name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def public_objects() -> list[Any]:
    """One test parameter for each public function, class and method of the package."""
    found = []
    for name in dolfinx_ffr.__all__:
        thing = getattr(dolfinx_ffr, name)
        if not (inspect.isclass(thing) or inspect.isroutine(thing)):
            continue
        found.append(pytest.param(thing, id=name))
        if not inspect.isclass(thing):
            continue
        for key, member in vars(thing).items():
            function = member.__func__ if isinstance(member, staticmethod | classmethod) else member
            if isinstance(function, property):
                function = function.fget
            if key.startswith("_") or not inspect.isfunction(function):
                continue
            if function.__module__.startswith(dolfinx_ffr.__name__):
                found.append(pytest.param(function, id=f"{name}.{key}"))
    return found


def documented_parameters(docstring: str) -> list[str]:
    """Return the names in the sections `Args` and `Attributes` of a Google docstring."""
    names: list[str] = []
    for section in re.findall(
        r"^(?:Args|Attributes):\n((?:[ \t]+.*\n|\n)+)", docstring + "\n", re.M
    ):
        depth = len(section) - len(section.lstrip(" "))
        for line in section.splitlines():
            entry = re.match(rf" {{{depth}}}((?:\*{{0,2}}\w+(?:, )?)+)(?: \([^)]*\))?:", line)
            if entry:
                names += [name.lstrip("*") for name in entry.group(1).split(", ")]
    return names


def field_comments(thing: type) -> set[str]:
    """Return the fields of a dataclass that a ``#:`` comment explains, on or above their line."""
    lines = inspect.getsource(thing).splitlines()
    return {
        match.group(1)
        for number, line in enumerate(lines)
        if (match := re.match(r"    (\w+):", line))
        and ("#:" in line or lines[number - 1].lstrip().startswith("#:"))
    }


def test_exported_names_exist() -> None:
    assert sorted(set(dolfinx_ffr.__all__)) == sorted(dolfinx_ffr.__all__), "a name stands twice"
    missing = [name for name in dolfinx_ffr.__all__ if not hasattr(dolfinx_ffr, name)]
    assert not missing
    assert set(dolfinx_ffr.__all__) <= set(dir(dolfinx_ffr))


def test_unknown_name_is_refused() -> None:
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = dolfinx_ffr.no_such_name


@pytest.mark.parametrize("thing", public_objects())
def test_public_parameters_are_documented(thing: Callable[..., Any]) -> None:
    docstring = inspect.getdoc(thing)
    assert docstring, "no docstring"
    if inspect.isclass(thing):
        documented = set(documented_parameters(docstring))
        for base in thing.__mro__[:-1]:
            if base.__module__.startswith(dolfinx_ffr.__name__):
                documented |= field_comments(base)
                documented |= set(documented_parameters(inspect.getdoc(base) or ""))
        if issubclass(thing, Exception) or getattr(thing, "_is_protocol", False):
            return
    else:
        documented = set(documented_parameters(docstring))
    parameters = [
        name for name in inspect.signature(thing).parameters if name not in {"self", "cls"}
    ]
    if not documented:  # a short docstring without sections: it must name them in its text
        documented = set(re.findall(r"\w+", docstring))
    undocumented = [name for name in parameters if name not in documented]
    assert not undocumented, f"parameters without a word in the docstring: {undocumented}"
    stale = [name for name in documented_parameters(docstring) if name not in parameters]
    if not inspect.isclass(thing):
        assert not stale, f"documented, but not parameters: {stale}"


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


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_source_file(path: Path) -> None:
    text = path.read_text()
    assert text.startswith("# SPDX-License-Identifier: MIT\n")
    assert ast.get_docstring(ast.parse(text)), "no module docstring"
    assert text.count("\n") <= MAX_LINES


@pytest.mark.parametrize(
    "path", [path for path in SOURCES if path.name != "_compat.py"], ids=module_name
)
def test_only_compat_asks_which_release_is_installed(path: Path) -> None:
    if path.name != "__init__.py":
        assert not VERSION_QUESTION.search(path.read_text())


def test_compat_asks_for_what_is_there_not_for_numbers() -> None:
    assert not re.search(r"__version__|packaging", (ROOT / "_compat.py").read_text())
