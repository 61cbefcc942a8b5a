# SPDX-License-Identifier: MIT
"""The protocols of optimisers: iterators of designs or boundaries, with a state that is stored."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, Protocol

from shapely.geometry.base import BaseGeometry

from ..part import Part, Solid
from ..problem import Evaluation, Problem

#: Largest violation of bounds and minimum sizes of a feasible trial, the accuracy of sizes and of a
#: mesh
FEASIBLE = 2e-3


class AskedSizes(NamedTuple):
    """The sizes that the user asks for, of one boundary [m]."""

    member: float  #: Minimum member
    gap: float  #: Minimum gap, 0 where there is none
    rim: float  #: Width of the rim around holes of the body's drawing


class BoundaryTrial(Protocol):
    """Boundaries with the meshes that fit them, and the evaluation there."""

    @property
    def boundaries(self) -> Mapping[str, Any]:
        """The boundaries, by body."""

    @property
    def parts(self) -> dict[str, Part | Solid]:
        """The parts within the boundaries, by body."""

    @property
    def materials(self) -> dict[str, BaseGeometry]:
        """The parts as polygons [m], by body in the plane."""

    @property
    def asked(self) -> dict[str, AskedSizes]:
        """The sizes that the user asks for, by body."""

    @property
    def problem(self) -> Problem:
        """The problem on these meshes."""

    @property
    def evaluation(self) -> Evaluation:
        """The evaluation of the parts."""

    @property
    def violations(self) -> dict[str, float]:
        """Violations of constraints and volumes, negative where they are satisfied."""

    @property
    def with_margins(self) -> dict[str, float]:
        """Violations plus the safety margins of the steps."""

    @property
    def violation(self) -> float:
        """The largest violation with its margin, at least zero."""

    @property
    def warned(self) -> tuple[warnings.WarningMessage, ...]:
        """Warnings while it was computed."""


class BoundarySteps(Protocol):
    """Steps of the boundaries of parts: an iterator of trials that ends where no step is better.

    It begins at boundaries, or with the state of an earlier run.
    """

    reason: str  #: Why the iterator ends
    converged: bool  #: Always false, as boundaries end where no step is better
    number: int  #: Number of the step that was taken last
    last: int  #: Number of the last step, which is followed by finer meshes
    row: dict[str, float]  #: Row of the history for the present trial

    @property
    def trial(self) -> BoundaryTrial:
        """The present trial."""

    @property
    def mode_errors(self) -> dict[str, float]:
        """Errors of psi of the best trial by the modes that bodies leave out."""

    @property
    def first(self) -> Callable[[], Any]:
        """A function that evaluates the first boundaries on finer meshes."""

    @property
    def mesh_tolerance(self) -> float:
        """Largest change of psi by finer meshes without a warning."""

    def __iter__(self) -> Iterator[Any]:
        """The steps themselves."""

    def __next__(self) -> Any:
        """The trial after one step."""

    def rank(self, trial: Any) -> tuple[bool, float]:
        """The rank of a trial, which is least for the best one."""

    def row_of(self, trial: Any) -> dict[str, float]:
        """The row of the history for a trial on finer meshes."""

    def refined(self) -> tuple[Any, float]:
        """The best trial on finer meshes, and how much psi changed from one to the next."""

    def tighten(self, fine: Any) -> bool:
        """Enlarge the margins of bounds that only ``fine`` meshes of the best trial exceed.

        Returns whether there are any. The steps then continue from the best trial.
        """

    def remarks(self, trial: Any) -> list[str]:
        """Sentences for warnings of a result, besides bounds and sizes of its parts."""

    def state(self) -> dict[str, Any]:
        """The state on which the next step depends, as arrays by name."""


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
    """The values by names that begin with a prefix."""
    return {f"{prefix} {name}": value for name, value in values.items()}


def without_prefix(prefix: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """The values whose names begin with a prefix, by names without it."""
    start = f"{prefix} "
    return {n.removeprefix(start): v for n, v in values.items() if n.startswith(start)}


def numbers_by_name(prefix: str, values: Mapping[str, Any]) -> dict[str, float]:
    """The numbers of a state whose names begin with a prefix, by names without it."""
    return {name: float(value) for name, value in without_prefix(prefix, values).items()}


class Optimizes(Protocol):
    """An optimiser: an iterator of iterates."""

    reason: str  #: Why the iterator ends

    @property
    def converged(self) -> bool:
        """Whether the last iterate satisfies the conditions of an optimum."""

    def __next__(self) -> Any:
        """The iterate after one step."""


def follow(
    optimizer: Optimizes,
    record: Callable[[Any], None],
    stopped: Callable[[], str],
    goes_on: Callable[[], bool],
) -> str:
    """Record each iterate of an optimiser until it ends; return the reason of the end.

    It ends when it has converged, when no steps are left (``goes_on`` is false), when the user has
    ``stopped`` it for a reason, or when no step follows.
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
