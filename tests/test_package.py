# SPDX-License-Identifier: MIT
"""The package as a whole: names, documentation, and which module may use what."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import dolfinx_ffr

SOURCES = sorted(Path(dolfinx_ffr.__file__).parent.rglob("*.py"))


def public_objects() -> list[tuple[str, Any]]:
    """Name and object of each public function, class and method of the package."""
    found = []
    for name in dolfinx_ffr.__all__:
        thing = getattr(dolfinx_ffr, name)
        if not (inspect.isclass(thing) or inspect.isroutine(thing)):
            continue
        found.append((name, thing))
        if not inspect.isclass(thing):
            continue
        for key, member in vars(thing).items():
            function = member.__func__ if isinstance(member, staticmethod | classmethod) else member
            if isinstance(function, property):
                if not function.fget.__doc__ and inspect.getdoc(function):
                    continue  # documented in the base
                function = function.fget
            if key.startswith("_") or not inspect.isfunction(function):
                continue
            if function.__module__.startswith(dolfinx_ffr.__name__):
                found.append((f"{name}.{key}", function))
    return found


def documented_parameters(docstring: str) -> list[str]:
    """The names in the sections `Args` and `Attributes` of a Google docstring."""
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
    """The fields of a dataclass that a ``#:`` comment explains, on or above their line."""
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


def test_renamed_names_work_and_say_the_new_one() -> None:
    for old, new in dolfinx_ffr._RENAMED.items():
        with pytest.warns(DeprecationWarning, match=f"{old} is now called {new}"):
            assert getattr(dolfinx_ffr, old) is getattr(dolfinx_ffr, new)


def faults_of_docstring(thing: Callable[..., Any]) -> str:
    """What a docstring leaves out or has too much; nothing where all is well."""
    docstring = inspect.getdoc(thing)
    if not docstring:
        return "no docstring"
    if inspect.isclass(thing):
        documented = set(documented_parameters(docstring))
        for base in thing.__mro__[:-1]:
            if base.__module__.startswith(dolfinx_ffr.__name__):
                documented |= field_comments(base)
                documented |= set(documented_parameters(inspect.getdoc(base) or ""))
        if issubclass(thing, Exception) or getattr(thing, "_is_protocol", False):
            return ""
    else:
        documented = set(documented_parameters(docstring))
    parameters = [
        name for name in inspect.signature(thing).parameters if name not in {"self", "cls"}
    ]
    if not documented:  # a short docstring without sections: it must name them in its text
        documented = set(re.findall(r"\w+", docstring))
    undocumented = [name for name in parameters if name not in documented]
    if undocumented:
        return f"parameters without a word in the docstring: {undocumented}"
    stale = [name for name in documented_parameters(docstring) if name not in parameters]
    if stale and not inspect.isclass(thing):
        return f"documented, but not parameters: {stale}"
    return ""


def test_public_parameters_are_documented() -> None:
    found = {name: faults_of_docstring(thing) for name, thing in public_objects()}
    assert len(found) > 300
    assert not {name: fault for name, fault in found.items() if fault}


#: First words of a description that are no words but symbols, and stay as they are.
SYMBOLS = re.compile(r"(psi|dpsi|eta|omega|[a-z]\b|[a-z]_|\w*[_/(^])")


def faults_of_dialect(path: Path) -> list[str]:
    """Return where docstrings of a file leave the dialect that all of them share."""
    faults = []
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef
    for node in ast.walk(ast.parse(path.read_text())):
        docstring = ast.get_docstring(node) if isinstance(node, kinds) else None
        if not docstring:
            continue
        where = f"{path.name}: {getattr(node, 'name', 'module')}"
        first = docstring.splitlines()[0]
        if first.startswith(("Return ", "Returns ")):
            faults.append(f"{where}: say what it is, not that it is returned")
        if first[0].islower() and not SYMBOLS.match(first):
            faults.append(f"{where}: {first!r} begins with a small letter")
        for section in re.findall(
            r"^(?:Args|Attributes|Raises|Warns):\n((?:[ ]+.*\n|\n)+)", docstring + "\n", re.M
        ):
            entries = re.findall(r"^ {4}[\w*, ]+: (.*(?:\n {8}.*)*)", section, re.M)
            for entry in entries:
                if entry[0].islower() and not SYMBOLS.match(entry):
                    faults.append(f"{where}: {entry!r} begins with a small letter")
                if not entry.rstrip().endswith((".", ":")):
                    faults.append(f"{where}: {entry!r} does not end with a period")
    return faults


def test_docstrings_speak_one_dialect() -> None:
    assert not [fault for path in SOURCES for fault in faults_of_dialect(path)]
