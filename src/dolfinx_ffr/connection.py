# SPDX-License-Identifier: MIT
"""What joints and forces have in common: the markers that they connect, a name, and checks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from .points import Marker, marker_name

__all__ = ["Connection"]


@dataclass(frozen=True)
class Connection:
    """A joint or a force."""

    #: What messages call it.
    kind: ClassVar[str]
    #: What it does to its markers, for messages.
    verb: ClassVar[str]

    @property
    def markers(self) -> tuple[Marker, ...]:
        """The markers that it connects, or the one on which it acts."""
        raise NotImplementedError

    @property
    def label(self) -> str:
        """Name given by the user, or one made from the kind and the markers."""
        given: str = getattr(self, "name", "")
        between = ", ".join(marker_name(marker) for marker in self.markers)
        return given or f"{type(self).__name__}({between})"

    def validate(self, label: str) -> None:
        """Check the numbers.

        Args:
            label: Its name, for the message.

        Raises:
            ValueError: If a number is out of range or no body is connected.
        """
        for fault in self._faults():
            raise ValueError(f"{self.kind} {label!r}{fault}")

    def _faults(self) -> Iterator[str]:
        """What is wrong, as messages go on after the name."""
        if not any(isinstance(marker, tuple) for marker in self.markers):
            yield f" {self.verb} no body"
