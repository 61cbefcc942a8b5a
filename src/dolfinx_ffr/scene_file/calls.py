# SPDX-License-Identifier: MIT
"""Calls of the public API with checked arguments, which are made, or written as a program."""

from __future__ import annotations

import json
import keyword
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from ..program import refused

#: The package, whose names programs use
PACKAGE = import_module(__package__.partition(".")[0])
#: Columns of a program
_WIDTH = 96


class SceneError(ValueError):
    """What is wrong in a scene file: file, table, key and remedy, in one line."""


@dataclass(frozen=True, eq=False)
class Name:
    """A variable of the program, and its value."""

    text: str
    value: Any


@dataclass(frozen=True, eq=False)
class Call:
    """A class or function of the package with arguments: numbers, texts, lists, mappings, calls."""

    target: Callable[..., Any]
    arguments: dict[str, Any]
    where: str  #: File and table, for messages
    variable: str = ""  #: Its name where several use it, "" where it stands in the call of its user


def total(motions: list[Any]) -> Any:
    """The sum of motions and numbers."""
    return sum(motions[1:], motions[0])


@dataclass
class Maker:
    """Makes the objects of calls, each once."""

    _made: dict[int, Any] = field(default_factory=dict)

    def __call__(self, node: Any) -> Any:
        """The object of a call; a SceneError where the package refuses something."""
        if isinstance(node, Name):
            return node.value
        if isinstance(node, list | tuple):
            return type(node)(map(self, node))
        if isinstance(node, dict):
            return {name: self(part) for name, part in node.items()}
        if not isinstance(node, Call):
            return node
        if id(node) not in self._made:
            arguments = self(node.arguments)
            try:
                self._made[id(node)] = node.target(**arguments)
            except (ImportError, OSError, RuntimeError, TypeError, ValueError) as error:
                if not (isinstance(error, OSError) or refused(error)):
                    raise
                raise SceneError(f"{node.where}: {error}") from error
        return self._made[id(node)]


class Writer:
    """Writes calls as a program of the public API."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._known: dict[int, str] = {}

    def __call__(self, node: Any, indent: int = 0, before: int = 0) -> str:
        """The text of a call; variables that it uses are assigned in ``lines`` above it."""
        if isinstance(node, Name):
            return node.text
        if isinstance(node, Call) and node.variable:
            if id(node) not in self._known:
                text = self._call(node, 0, len(node.variable) + 3)
                self.lines.append(f"{node.variable} = {text}")
                self._known[id(node)] = node.variable
            return self._known[id(node)]
        if isinstance(node, Call):
            return self._call(node, indent, before)
        if isinstance(node, dict):
            entries = [(f"{_plain(key)}: ", part) for key, part in node.items()]
            return self._several("{", entries, "}", indent, before)
        if isinstance(node, list):
            return self._several("[", [("", part) for part in node], "]", indent, before)
        if isinstance(node, tuple):
            right = ",)" if len(node) == 1 else ")"
            return self._several("(", [("", part) for part in node], right, indent, before)
        return _plain(node)

    def _call(self, call: Call, indent: int, before: int) -> str:
        if call.target is total:
            return " + ".join(self(part) for part in call.arguments["motions"])
        entries = [(f"{name}=", part) for name, part in call.arguments.items()]
        left = f"{public_name(call.target)}("
        return self._several(left, entries, ")", indent, before)

    def _several(
        self, left: str, entries: list[tuple[str, Any]], right: str, indent: int, before: int
    ) -> str:
        """Entries on one line, or on one line each."""
        parts = [begin + self(part, indent + 4, len(begin)) for begin, part in entries]
        line = f"{left}{', '.join(parts)}{right}"
        if not parts or (indent + before + len(line) < _WIDTH and "\n" not in line):
            return line
        margin = " " * (indent + 4)
        body = "".join(f"{margin}{part},\n" for part in parts)
        return f"{left}\n{body}{' ' * indent}{right.lstrip(',')}"


def _plain(value: Any) -> str:
    """A number or a text."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, float) and abs(value) >= 1e6:
        short = f"{value:g}".replace("e+", "e")
        return short if float(short) == value else repr(value)
    return repr(value)


def public_name(target: Callable[..., Any]) -> str:
    """How a program that has imported the package as ffr calls a class or function."""
    name = target.__qualname__
    owner = name.partition(".")[0]
    if owner in PACKAGE.__all__:
        return f"ffr.{name}"
    return f"ffr.{target.__module__.split('.')[1]}.{name}"


def is_public(kind: type) -> bool:
    """Whether a class has a public name."""
    folder = kind.__module__.split(".")[1:2]
    offered = [*PACKAGE.__all__, *PACKAGE._BY_FOLDER.get(folder[0], ())] if folder else []
    return kind.__name__ in offered


def variables(taken: set[str]) -> Callable[[str], str]:
    """A function that makes of a text a variable's name that is not yet taken."""

    def made(text: str) -> str:
        name = re.sub(r"\W+", "_", text).strip("_") or "x"
        name = f"{name}_" if keyword.iskeyword(name) or name[0].isdigit() else name
        name = f"_{name}" if name[0].isdigit() else name
        found = next(n for n in _numbered(name) if n not in taken)
        taken.add(found)
        return found

    return made


def _numbered(name: str) -> Iterator[str]:
    yield name
    k = 2
    while True:
        yield f"{name}_{k}"
        k += 1
