# SPDX-License-Identifier: MIT
"""What steps ask of a boundary that moves, in the plane and in space."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np

from ..arrays import Array
from ..fem import Domain
from ..part import Part, Solid
from ..reduction import Struts
from .options import FieldOptions
from .projection import SmoothMotion
from .sizes import SizeRows


class NodeMotion(Protocol):
    """How the nodes of a mesh follow a boundary."""

    def pullback(self, nodes: Array) -> Array:
        """From the derivative by the nodes of this rank, (nodes, d), to that by motions, (n,)."""


class Change(NamedTuple):
    """One kind of change of the topology."""

    #: Makes changed boundaries from what struts and holes promise, the most promising one first
    candidates: Callable[[Any, Struts], Iterator[Any]]
    #: Whether it makes a part simpler, so that psi may rise by what another mesh changes
    simplifies: bool


class MovingBoundary(ABC):
    """The boundary of a part: a field, which moves by combinations of smooth motions."""

    #: Kinds of changes of its topology, in the order in which they are tried
    changes: ClassVar[tuple[Change, ...]]
    #: Finer meshes at most on which a result is told
    finer_meshes: ClassVar[int]
    #: Change of psi from one of them to the next that is small enough
    still: ClassVar[float]
    variables: Array  #: That tell the boundary, (variables,) [m]

    @property
    @abstractmethod
    def options(self) -> FieldOptions:
        """Numbers that are chosen."""

    @property
    @abstractmethod
    def body(self) -> Domain:
        """The body that is designed."""

    @property
    @abstractmethod
    def member(self) -> float:
        """Minimum member [m]."""

    @property
    @abstractmethod
    def gap(self) -> float:
        """Minimum gap that is checked on the part [m], 0 where none is."""

    @property
    @abstractmethod
    def rim(self) -> float:
        """Width of the rims around the holes of the body's drawing [m]."""

    @property
    @abstractmethod
    def n_motions(self) -> int:
        """Number of motions that steps combine."""

    @abstractmethod
    def with_variables(self, variables: Array) -> Self:
        """The boundary that other ``variables`` tell."""

    @property
    @abstractmethod
    def drawn(self) -> Part | Solid:
        """What it encloses, drawn as finely as a result is."""

    @property
    @abstractmethod
    def part(self) -> Part | Solid:
        """The same as its mesh shows it."""

    @property
    @abstractmethod
    def n_holes(self) -> int:
        """Number of holes through what it encloses."""

    @abstractmethod
    def mesh(self, turn: float, *, fine: bool, size: float | None = None) -> Domain:
        """A mesh that fits; its cells in notches have ``turn`` radii, if that is finite.

        They are as large as ``size`` [m], or as is fine enough.
        """

    @abstractmethod
    def node_motion(self, domain: Domain) -> NodeMotion:
        """How the nodes of that mesh follow its motions."""

    @property
    @abstractmethod
    def sizes(self) -> SizeRows:
        """Its minimum sizes as linear constraints on motions."""

    @abstractmethod
    def smooth_motion(self, slope: Array) -> SmoothMotion:
        """The metric of motions, of which those downhill a ``slope`` (motions,) are possible."""

    @abstractmethod
    def moved(self, motion: Array, smooth: SmoothMotion) -> Self:
        """After a ``motion`` (motions,) [m], with minimum sizes."""

    @abstractmethod
    def motion_to(self, after: Self) -> Array:
        """The motion from this boundary to one ``after`` a step, (motions,) [m]."""

    def translated(self, slope: Array) -> Self | None:
        """With material displaced as a whole downhill a ``slope`` (motions,), None for nothing."""
        return None

    def mended_drawing(self) -> Self:
        """With what is drawn mended where it is narrower than the boundary itself."""
        return self

    def finer(self) -> Self:
        """The same for a finer mesh; a ShapeError if that is too fine."""
        return self

    def remarks(self) -> list[str]:
        """What is to be said of the part of a result."""
        return []


def split_by_boundary(values: Array, boundaries: dict[str, MovingBoundary]) -> dict[str, Array]:
    """The pieces of ``values`` (n,) of the motions of all boundaries, by body."""
    ends = np.cumsum([boundary.n_motions for boundary in boundaries.values()])[:-1]
    return dict(zip(boundaries, np.split(values, ends), strict=True))
