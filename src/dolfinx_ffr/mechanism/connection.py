# SPDX-License-Identifier: MIT
"""What joints and forces have in common: the markers that they connect, a name, and checks."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from .. import validation
from .marker import Marker, check_marker, marker_name
from .symbols import Symbol

__all__ = ["Connection"]


@dataclass(frozen=True)
class Connection:
    """A joint or a force.

    Raises:
        TypeError: If something else stands where a marker belongs.
    """

    #: What messages call it.
    kind: ClassVar[str]

    def __post_init__(self) -> None:
        """Check the markers."""
        what = f"{self.kind} {type(self).__name__}"
        for marker in self.markers:
            check_marker(what, marker)
        validation.name(f"{what}: name", getattr(self, "name", ""))

    @property
    def markers(self) -> tuple[Marker, ...]:
        """The markers that it connects, or the one on which it acts."""
        raise NotImplementedError

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        """What pictures show of it: of a joint a pin, of a force nothing, where nothing is said."""
        return ()

    #: Whether it is one in the plane only, or in space only; None where it is both.
    dimension: ClassVar[int | None] = None

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
            TypeError: If an argument is of a wrong kind.
            ValueError: If a number is out of range or no marker is on a body.
        """
        what = f"{self.kind} {label!r}"
        if not any(isinstance(marker, tuple) for marker in self.markers):
            raise ValueError(f"{what} has no marker on a body")
        self._check(what)
        if type(self)._faults is not Connection._faults:
            warnings.warn(
                f"{type(self).__name__} overrides _faults, which the next release ignores: name "
                "the method _check(self, what), and let it raise",
                DeprecationWarning,
                stacklevel=2,
            )
            for fault in self._faults():
                raise ValueError(f"{what}{fault}")

    def _faults(self) -> Iterator[str]:
        """What `_check` was in the release before: what is wrong, as after the name."""
        yield from ()

    def _check(self, what: str) -> None:
        """Check the numbers of a joint or force, which messages call ``what``."""
