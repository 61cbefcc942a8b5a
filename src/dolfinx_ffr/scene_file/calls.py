# SPDX-License-Identifier: MIT
"""Calls of the public API with checked arguments, from which objects are made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ..program import refused


class SceneError(ValueError):
    """An error in a scene file: file, table, key and remedy, in one line."""


@dataclass(frozen=True, eq=False)
class Call:
    """A class or function of the package with arguments: numbers, texts, lists, mappings, calls."""

    target: Callable[..., Any]
    arguments: dict[str, Any]
    where: str  #: File and table, for messages


def total(motions: list[Any]) -> Any:
    """The sum of motions and numbers."""
    return sum(motions[1:], motions[0])


@dataclass
class Maker:
    """Makes the objects of calls, each once."""

    _made: dict[int, Any] = field(default_factory=dict)

    def __call__(self, node: Any) -> Any:
        """The object of a call; a SceneError where the package refuses something."""
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
