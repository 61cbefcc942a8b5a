# SPDX-License-Identifier: MIT
"""What the loop asks of an optimiser: an iterator, whose state can be kept and restored."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from ..boundary import Boundary, Surface
from ..boundary_field import BoundaryField
from ..part import Part, Solid
from ..problem import Evaluation, Problem

AnyBoundary = Boundary | Surface | BoundaryField


class BoundaryTrial(Protocol):
    """Boundaries with the meshes that fit them, and what was computed there."""

    @property
    def boundaries(self) -> Mapping[str, Any]:
        """By body."""

    @property
    def parts(self) -> dict[str, Part | Solid]:
        """What they enclose, by body."""

    @property
    def problem(self) -> Problem:
        """On these meshes."""

    @property
    def evaluation(self) -> Evaluation:
        """Of the parts."""

    @property
    def violations(self) -> dict[str, float]:
        """Of constraints and volumes, negative where they are satisfied."""

    @property
    def missed_radii(self) -> dict[str, float]:
        """Share by which the smallest radius of each body is below its minimum."""

    @property
    def warned(self) -> tuple[Any, ...]:
        """Warnings while it was computed."""

    def told(self, step: float, rejected: int, removed: int, inserted: int) -> dict[str, float]:
        """Its row of the history."""

    def rank(self, weight: float) -> tuple[bool, float]:
        """Which of several trials is the best, by the weight of the largest violation."""


@dataclass(frozen=True, eq=False)
class BoundaryIterate:
    """A trial that was accepted, and its row of the history."""

    trial: Any
    row: dict[str, float]


class BoundarySteps(Protocol):
    """Steps of the boundaries of parts: an iterator that ends where no step is better.

    It is made from the boundaries that are handed over, or from the state of an earlier run.
    """

    reason: str  #: Why it ended
    number: int  #: Of the step that was taken last
    last: int  #: Number of the last step, which is followed by finer meshes
    best: Any  #: The best trial
    trial: Any  #: The present trial
    mode_errors: dict[str, float]  #: Of psi of the best trial, by the modes that bodies leave out

    @property
    def iterate(self) -> BoundaryIterate:
        """Where the steps are before the first one."""

    @property
    def weight(self) -> float:
        """Of the largest violation of bounds, by which trials are ranked."""

    @property
    def first(self) -> Callable[[], Any]:
        """Evaluates the boundaries at the start on finer meshes."""

    @property
    def still(self) -> float:
        """Largest change of psi by finer meshes that is not worth a warning."""

    def __iter__(self) -> Iterator[BoundaryIterate]:
        """The steps themselves."""

    def __next__(self) -> BoundaryIterate:
        """The trial after one step; collective."""

    def refined(self) -> tuple[Any, float]:
        """The best trial on finer meshes, and how much psi changed from one to the next."""

    def tighten(self, fine: Any) -> bool:
        """Tighten the bounds that only ``fine`` meshes of the best trial exceed; if there are any.

        The steps then go on from the best trial.
        """

    def remarks(self, trial: Any) -> list[str]:
        """What is to be said of a result, besides bounds and sizes of its parts."""

    def state(self) -> dict[str, Any]:
        """All that the next step depends on, as arrays by name."""


def with_prefix(prefix: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """The values by names that begin with a word."""
    return {f"{prefix} {name}": value for name, value in values.items()}


def without_prefix(prefix: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """The values whose names begin with a word, by names without it."""
    start = f"{prefix} "
    return {n.removeprefix(start): v for n, v in values.items() if n.startswith(start)}


def numbers_by_name(prefix: str, values: Mapping[str, Any]) -> dict[str, float]:
    """The numbers of a state whose names begin with a word."""
    return {name: float(value) for name, value in without_prefix(prefix, values).items()}


def follow(
    optimizer: Iterator[Any],
    record: Callable[[Any], None],
    stopped: Callable[[], str],
    goes_on: Callable[[], bool],
) -> str:
    """Record what an optimiser comes to until it ends; the reason why it has ended.

    It ends where the optimiser does, whose ``reason`` that is, where it has taken all steps, as
    ``goes_on`` tells, or where the user has ``stopped`` it.
    """
    while goes_on():
        if reason := stopped():
            return reason
        iterate = next(optimizer, None)
        if iterate is None:
            return str(optimizer.reason)  # type: ignore[attr-defined]
        record(iterate)
    return "iterations"
