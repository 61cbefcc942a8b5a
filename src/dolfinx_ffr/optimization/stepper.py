# SPDX-License-Identifier: MIT
"""What the loop asks of an optimiser: an iterator, whose state can be kept and restored."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, Protocol

from shapely.geometry.base import BaseGeometry

from ..boundary import Boundary, Surface
from ..boundary_field import MovingBoundary
from ..part import Part, Solid
from ..problem import Evaluation, Problem

AnyBoundary = Boundary | Surface | MovingBoundary


#: Violation of bounds and of minimum sizes up to which a trial may be the best one: the accuracy of
#: sizes and of a mesh
FEASIBLE = 2e-3


class AskedSizes(NamedTuple):
    """Sizes that were asked for of one boundary [m]."""

    member: float  #: Minimum member
    gap: float  #: Minimum gap, 0 where there is none
    rim: float  #: Width of the rim around holes of the body's drawing


class BoundaryTrial(Protocol):
    """Boundaries with the meshes that fit them, and what was computed there."""

    @property
    def boundaries(self) -> Mapping[str, Any]:
        """By body."""

    @property
    def parts(self) -> dict[str, Part | Solid]:
        """What they enclose, by body."""

    @property
    def materials(self) -> dict[str, BaseGeometry]:
        """The same as polygons [m], by body in the plane."""

    @property
    def asked(self) -> dict[str, AskedSizes]:
        """Sizes that were asked for, by body."""

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
    def with_margins(self) -> dict[str, float]:
        """The same with the safety margins that steps keep."""

    @property
    def violation(self) -> float:
        """The largest violation with its margin, at least zero."""

    @property
    def warned(self) -> tuple[warnings.WarningMessage, ...]:
        """Warnings while it was computed."""


class BoundarySteps(Protocol):
    """Steps of the boundaries of parts: an iterator of trials that ends where no step is better.

    It is made from the boundaries that are handed over, or from the state of an earlier run.
    """

    reason: str  #: Why no step follows, where none does
    converged: bool  #: Always false, as boundaries end where no step is better
    number: int  #: Of the step that was taken last
    last: int  #: Number of the last step, which is followed by finer meshes
    row: dict[str, float]  #: Of the history, for the present trial

    @property
    def trial(self) -> BoundaryTrial:
        """The present trial."""

    @property
    def mode_errors(self) -> dict[str, float]:
        """Of psi of the best trial, by the modes that bodies leave out."""

    @property
    def first(self) -> Callable[[], Any]:
        """Evaluates the boundaries at the start on finer meshes."""

    @property
    def still(self) -> float:
        """Largest change of psi by finer meshes that is not worth a warning."""

    def __iter__(self) -> Iterator[Any]:
        """The steps themselves."""

    def __next__(self) -> Any:
        """The trial after one step; collective."""

    def rank(self, trial: Any) -> tuple[bool, float]:
        """Which of several trials is the best: the one of the least rank."""

    def row_of(self, trial: Any) -> dict[str, float]:
        """The row of the history for a trial that no step has led to."""

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


def safety_margins(
    margins: Mapping[str, float], coarse: BoundaryTrial, fine: BoundaryTrial
) -> dict[str, float]:
    """Safety margin of each constraint, enlarged by what a finer mesh adds to its violation.

    Empty if the finer mesh satisfies all constraints.
    """
    if fine.violation <= FEASIBLE:
        return {}
    enlarged = {}
    for name, violation in coarse.violations.items():
        mesh_error = fine.with_margins[name] - violation
        enlarged[name] = max(margins.get(name, 0.0), mesh_error + FEASIBLE)
    return enlarged


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


class Optimizes(Protocol):
    """An optimiser: an iterator of what it comes to."""

    reason: str  #: Why no step follows, where none does

    @property
    def converged(self) -> bool:
        """Whether what it has come to is what it looks for."""

    def __next__(self) -> Any:
        """What it comes to by one step; collective."""


def follow(
    optimizer: Optimizes,
    record: Callable[[Any], None],
    stopped: Callable[[], str],
    goes_on: Callable[[], bool],
) -> str:
    """Record each iterate of an optimiser until it ends; the reason why it has ended.

    It ends where it has converged, where it has taken all steps, as ``goes_on`` tells, where the
    user has ``stopped`` it, or where no step follows.
    """
    while not optimizer.converged:
        if not goes_on():
            return "iterations"
        if reason := stopped():
            return reason
        try:
            iterate = next(optimizer)
        except StopIteration:
            break
        record(iterate)
    return "converged" if optimizer.converged else optimizer.reason
