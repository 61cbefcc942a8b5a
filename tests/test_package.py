# SPDX-License-Identifier: MIT
"""The package as a whole: names, documentation, and which module may use what."""

from __future__ import annotations

import ast
import inspect
import re
import tomllib
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from shared import TOP

import dolfinx_ffr

#: Names that are reached through their folders
BY_FOLDER = dolfinx_ffr._BY_FOLDER
SOURCES = sorted(Path(dolfinx_ffr.__file__).parent.rglob("*.py"))


def public_objects() -> list[tuple[str, Any]]:
    """Name and object of each public function, class and method of the package."""
    values = []
    inside = [f"{folder}.{name}" for folder, names in BY_FOLDER.items() for name in names]
    for name in [*dolfinx_ffr.__all__, *inside]:
        thing = attrgetter(name)(dolfinx_ffr)
        if inspect.isclass(thing) or inspect.isroutine(thing):
            values.append((name, thing))
        for key, member in vars(thing).items() if inspect.isclass(thing) else ():
            function = member.__func__ if isinstance(member, staticmethod | classmethod) else member
            if isinstance(function, property):
                if not function.fget.__doc__ and inspect.getdoc(function):
                    continue  # documented in the base
                function = function.fget
            if key.startswith("_") or not inspect.isfunction(function):
                continue
            if function.__module__.startswith(dolfinx_ffr.__name__):
                values.append((f"{name}.{key}", function))
    return values


def entries(docstring: str, sections: str = "Args|Attributes") -> list[tuple[str, str]]:
    """Names and description of each entry in some sections of a Google docstring."""
    matches: list[tuple[str, str]] = []
    for section in re.findall(rf"^(?:{sections}):\n((?: +.*\n|\n)+)", docstring + "\n", re.M):
        entry = r"^ {4}([\w*, ]+)(?: \([^)]*\))?:\s+(.*(?:\n {8}.*)*)"
        matches += re.findall(entry, section, re.M)
    return matches


def documented_parameters(docstring: str) -> list[str]:
    return [name.lstrip("*") for names, _ in entries(docstring) for name in names.split(", ")]


def test_exported_names_exist() -> None:
    assert sorted(set(dolfinx_ffr.__all__)) == sorted(dolfinx_ffr.__all__), "a name stands twice"
    missing = [name for name in dolfinx_ffr.__all__ if not hasattr(dolfinx_ffr, name)]
    assert not missing
    assert set(dolfinx_ffr.__all__) <= set(dir(dolfinx_ffr))
    remedy = "names of specialists are reached by their folders: put the new one into _BY_FOLDER"
    assert len(dolfinx_ffr.__all__) <= 120, remedy


def test_names_of_specialists_are_reached_by_their_folders() -> None:
    """Without an import of the folder, and where they are asked for at the top, that says so."""
    for folder, names in BY_FOLDER.items():
        for name in names:
            assert getattr(getattr(dolfinx_ffr, folder), name)
            with pytest.raises(AttributeError, match=rf"it is dolfinx_ffr\.{folder}\.{name}$"):
                getattr(dolfinx_ffr, name)
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = dolfinx_ffr.no_such_name


def faults_of_docstring(thing: Callable[..., Any]) -> str:
    """What a docstring leaves out or has too much; nothing where all is well."""
    docstring = inspect.getdoc(thing)
    if not docstring:
        return "no docstring"
    if inspect.isclass(thing):
        documented = set(documented_parameters(docstring))
        for base in thing.__mro__[:-1]:
            if base.__module__.startswith(dolfinx_ffr.__name__):
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
    values = {name: faults_of_docstring(thing) for name, thing in public_objects()}
    assert len(values) > 300
    assert not {name: fault for name, fault in values.items() if fault}


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
        for _, entry in entries(docstring, "Args|Attributes|Raises|Warns"):
            if entry[0].islower() and not SYMBOLS.match(entry):
                faults.append(f"{where}: {entry!r} begins with a small letter")
            if not entry.rstrip().endswith((".", ":")):
                faults.append(f"{where}: {entry!r} does not end with a period")
    return faults


def test_docstrings_speak_one_dialect() -> None:
    assert not [fault for path in SOURCES for fault in faults_of_dialect(path)]


@pytest.mark.parametrize(
    ("python", "versions", "refused"),
    [
        ("3.11", "numpy 1.24.2, scipy 1.10.1, numba 0.56.4, matplotlib 3.6.3", "1.26.4"),
        ("3.13", "numpy 2.2.4, scipy 1.15.3, numba 0.61.2, matplotlib 3.10.1", "2.3.0"),
        ("3.14", "numpy 2.4.4, scipy 1.17.1, numba 0.65.0, matplotlib 3.10.7", None),
    ],
    ids=["Debian 12", "Debian 13", "Debian unstable"],
)
def test_pip_keeps_the_packages_of_debian(python: str, versions: str, refused: str | None) -> None:
    """And puts no NumPy in the place of Debian's that its Numba does not work with."""
    project = tomllib.loads((TOP / "pyproject.toml").read_text())["project"]
    expected = [Requirement(text) for text in project["dependencies"]]
    expected = [
        r for r in expected if not r.marker or r.marker.evaluate({"python_version": python})
    ]
    for name, version in (entry.split() for entry in versions.split(", ")):
        specifiers = [requirement.specifier for requirement in expected if requirement.name == name]
        assert specifiers and all(version in specifier for specifier in specifiers), name
    numpy = [requirement.specifier for requirement in expected if requirement.name == "numpy"]
    assert refused is None or not all(refused in specifier for specifier in numpy)


def test_packages_of_others_are_of_this_version_and_want_the_same() -> None:
    """Debian's has dependencies by PyPI's names from here; conda-forge's are named once more."""
    project = tomllib.loads((TOP / "pyproject.toml").read_text())["project"]
    version = project["version"]
    assert (TOP / "debian/changelog").read_text().startswith(f"dolfinx-ffr ({version}-")
    recipe = (TOP / "packaging/meta.yaml").read_text()
    assert f'set version = "{version}"' in recipe
    for requirement in map(Requirement, project["dependencies"]):
        name, least = requirement.name, [s for s in requirement.specifier if s.operator == ">="]
        wanted = f"- {name}(-base)?" + "".join(f" >={bound.version}" for bound in least)
        assert requirement.marker or re.search(f"{wanted}$", recipe, re.M), name


def test_fields_of_public_dataclasses_are_documented() -> None:
    """In a docstring, where `help` and the site show them."""
    classes = [thing for _, thing in public_objects() if is_dataclass(thing)]
    assert {dolfinx_ffr.Placement, dolfinx_ffr.dynamics.Trajectory} <= {*classes}
    for thing in classes:
        bases = [base for base in thing.__mro__ if base in classes]
        documented = {n for base in bases for n in documented_parameters(inspect.getdoc(base))}
        public = {field.name for field in fields(thing) if not field.name.startswith("_")}
        assert not public - documented, thing.__name__
