# SPDX-License-Identifier: MIT
"""What all objectives have in common: value, derivatives, weighted sums, bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..body import VolumeIntegrals
from ..dynamics import Trajectory, TrajectoryBar

__all__ = [
    "Constraint",
    "DensityField",
    "Derivatives",
    "Objective",
    "Response",
    "StressField",
    "Sum",
]

Array = NDArray[np.float64]
Bodies = Mapping[str, VolumeIntegrals]
#: Derivatives with respect to the trajectory (None: it does not matter), and to the integrals of
#: the bodies at fixed trajectory (a body that is missing does not matter).
Bars = tuple[TrajectoryBar | None, dict[str, VolumeIntegrals]]


def _alone(local: Array) -> list[Array]:
    """What the ranks have, of which there is one."""
    return [local]


@dataclass(frozen=True, eq=False)
class DensityField:
    """The densities of a body's cells; each rank holds those of its own cells."""

    #: Densities, shape (cells,), in [0, 1].
    values: Array
    #: Areas of the cells, in space volumes, shape (cells,) [m^2], [m^3].
    areas: Array
    #: Centroids of the cells in the undeformed body, shape (cells, dimension) [m].
    centroids: Array
    #: Sum of an array over the cells of all ranks, the same on every rank; collective.
    sum: Callable[[Array], float]
    #: What each rank has, of all ranks, the same on every rank; collective.
    gathered: Callable[[Array], list[Array]] = field(default_factory=lambda: _alone)
    #: The body as it was designed, where this is a mesh of the part that came of it: shares of
    #: volume are of its area.
    whole: DensityField | None = None


class StressField(Protocol):
    """The stress of a body for unit coordinates; each rank holds that of its own cells.

    It is that of the solid at the strain of the cell; see :func:`stress_coordinates`.
    """

    @property
    def n_constraint(self) -> int:
        """Number of constraint modes, the first of the elastic coordinates."""
        ...

    @property
    def out_of_plane(self) -> float:
        """The stress s_z / (s_x + s_y) [-]."""
        ...

    @property
    def weights(self) -> Array:
        """Area that each point stands for, in space volume, shape (cells, points) [m^2], [m^3]."""
        ...

    def modes(self, correction: bool) -> Array:
        """Stress s_x, s_y, t_xy, in space all six, for unit coordinates; collective.

        Args:
            correction: Whether those of the static correction follow the elastic coordinates.

        Returns:
            Shape (cells, points, 3 or 6, coordinates) [Pa].
        """
        ...

    def sum(self, local: Array) -> Array:
        """The sum over the ranks, bit-identical on every rank; collective.

        Args:
            local: This rank's array.
        """
        ...

    def gathered(self, value: Any) -> list[Any]:
        """The values of all ranks, alike on every one of them; collective.

        Args:
            value: This rank's.
        """
        ...


@dataclass(frozen=True, eq=False)
class Response:
    """What objectives are functions of: a motion and the bodies that made it."""

    #: The motion; None if neither objective nor constraints need it.
    trajectory: Trajectory | None
    #: Volume integrals of all bodies, by name.
    bodies: Bodies
    #: Densities of the bodies that have one, by name; none for bodies given by their integrals.
    densities: Mapping[str, DensityField] = field(default_factory=dict)
    #: Stress of the bodies that have a mesh, by name.
    stresses: Mapping[str, StressField] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Partial derivatives of a number with respect to the parts of a response."""

    #: With respect to the trajectory, at fixed bodies; None where it does not matter.
    trajectory: TrajectoryBar | None = None
    #: With respect to the integrals, at fixed trajectory and densities, by name of the body; a body
    #: that is missing does not matter.
    integrals: Mapping[str, VolumeIntegrals] = field(default_factory=dict)
    #: With respect to the densities of this rank's cells, shape (cells,), at fixed trajectory,
    #: integrals and stress for unit coordinates, likewise.
    densities: Mapping[str, Array] = field(default_factory=dict)
    #: With respect to the stress of this rank's cells for unit coordinates, shape (cells, points,
    #: 3 or 6, coordinates), at fixed trajectory and densities, likewise.
    stresses: Mapping[str, Array] = field(default_factory=dict)

    def scaled(self, factor: float) -> Derivatives:
        """The derivatives times a factor.

        Args:
            factor: The factor.
        """
        return Derivatives(
            None if self.trajectory is None else self.trajectory.scaled(factor),
            {name: bar.scaled(factor) for name, bar in self.integrals.items()},
            {name: factor * bar for name, bar in self.densities.items()},
            {name: factor * bar for name, bar in self.stresses.items()},
        )

    def __add__(self, other: Derivatives) -> Derivatives:
        """Sum part by part."""
        ours, theirs = self.trajectory, other.trajectory
        integrals, densities = dict(self.integrals), dict(self.densities)
        stresses = dict(self.stresses)
        for name, bar in other.integrals.items():
            integrals[name] = integrals[name] + bar if name in integrals else bar
        for name, part in other.densities.items():
            densities[name] = densities[name] + part if name in densities else part
        for name, part in other.stresses.items():
            stresses[name] = _sum_of_modes(stresses[name], part) if name in stresses else part
        return Derivatives(
            ours if theirs is None else theirs if ours is None else ours + theirs,
            integrals,
            densities,
            stresses,
        )


def _sum_of_modes(a: Array, b: Array) -> Array:
    """Their sum, where one may lack the last columns, those of the static correction."""
    more, less = (a, b) if a.shape[-1] >= b.shape[-1] else (b, a)
    total = more.copy()
    total[..., : less.shape[-1]] += less
    return total


class Objective:
    """A number psi of the motion, and of volume integrals, densities and stress of bodies.

    An objective of one's own derives from this class. If it depends on trajectory and integrals it
    defines :meth:`value` and :meth:`pullback`; if it depends on densities or stress too, it defines
    :meth:`evaluate` and :meth:`derivatives` instead. Objectives are added, and multiplied by
    numbers, with the usual signs.
    """

    #: SI unit of the number, for reports; "" for numbers without one, and where it is not known.
    unit: ClassVar[str] = ""

    @property
    def needs_trajectory(self) -> bool:
        """Whether the number depends on the motion; without it nothing needs to be simulated."""
        return True

    def validate(self, densities: Collection[str] | Mapping[str, DensityField]) -> None:
        """Refuse to be used where a density that the number depends on does not exist.

        Args:
            densities: Names of the bodies with a density; a problem gives a mapping to densities of
                full bodies, by which regions of them can be checked.

        Raises:
            ValueError: If a body has no density; the message lists those that have.
        """

    def validate_names(self, markers: Mapping[str, Collection[str]], joints: list[str]) -> None:
        """Refuse bodies, markers and joints that do not exist, before anything is computed.

        Args:
            markers: Names of the markers by name of the body, of all bodies.
            joints: Names of the joints.

        Raises:
            ValueError: If a name does not exist; the message lists those that do.
        """

    def validate_modes(self, modes: Mapping[str, int]) -> None:
        """Refuse bodies with too few elastic coordinates, before anything is computed.

        Args:
            modes: Number of elastic coordinates by name of the body, of all bodies; 0 of rigid
                ones. Names have been checked by :meth:`validate_names`.

        Raises:
            ValueError: If a body that must deform is rigid, or has too few coordinates.
        """

    def evaluate(self, response: Response) -> float:
        """The number, the same on every rank.

        Args:
            response: Motion, integrals, densities and stress; the motion is None for an objective
                that does not need it.

        Raises:
            ValueError: If a name does not exist; the message lists those that do.
        """
        return float(self.value(response.trajectory, response.bodies))  # type: ignore[arg-type]

    def derivatives(self, response: Response) -> Derivatives:
        """Its partial derivatives with respect to trajectory, integrals, densities and stress.

        Args:
            response: As for :meth:`evaluate`.

        Raises:
            ValueError: As :meth:`evaluate` does.
        """
        return Derivatives(*self.pullback(response.trajectory, response.bodies))  # type: ignore[arg-type]

    def calibrated(self, response: Response) -> Objective:
        """The objective corrected at one design, where it stands for another number.

        Only :class:`PeakStress` does, for the largest stress; others are returned as they are.

        Args:
            response: Of the design, as for :meth:`evaluate`.

        Raises:
            ValueError: As :meth:`evaluate` does.
        """
        return self

    def value(self, trajectory: Trajectory, bodies: Bodies) -> float:
        """The number, as a function of trajectory and integrals alone.

        Args:
            trajectory: Result of the simulation; None for an objective that does not need it.
            bodies: Volume integrals of the bodies, by name.

        Raises:
            ValueError: If a name does not exist; the message lists those that do.
        """
        raise NotImplementedError(f"{type(self).__name__} defines no value of the motion alone")

    def pullback(self, trajectory: Trajectory, bodies: Bodies) -> Bars:
        """Its derivatives with respect to the trajectory, and to the integrals at fixed trajectory.

        Args:
            trajectory: Result of the simulation; None for an objective that does not need it.
            bodies: Volume integrals of the bodies, by name.

        Returns:
            The derivative with respect to the trajectory, None where the number does not depend on
            it, and those with respect to the integrals by name of the body; a body that does not
            matter may be missing.

        Raises:
            ValueError: If a name does not exist; the message lists those that do.
        """
        raise NotImplementedError(f"{type(self).__name__} defines no pullback to the motion alone")

    def _summands(self) -> list[tuple[float, Objective]]:
        """The objective as weights and terms of a sum."""
        return [(1.0, self)]

    def __add__(self, other: Objective) -> Sum:
        """Sum of two objectives."""
        check_objective("sum of objectives: what is added", other)
        return Sum([*self._summands(), *other._summands()])

    def __radd__(self, other: float) -> Objective:
        """Start of the built-in sum, which is zero."""
        return self if other == 0 else NotImplemented

    def __sub__(self, other: Objective) -> Sum:
        """Difference of two objectives."""
        check_objective("difference of objectives: what is subtracted", other)
        return self + (-1.0) * other

    def __mul__(self, weight: float) -> Sum:
        """The objective times a weight."""
        weight = validation.number("weight of an objective", weight)
        return Sum([(weight * own, objective) for own, objective in self._summands()])

    __rmul__ = __mul__

    def __neg__(self) -> Sum:
        """The objective with the opposite sign, to be maximised."""
        return self * -1.0


class Sum(Objective):
    """Weighted sum of objectives, psi = sum_i weight_i psi_i.

    ``Sum([(0.3, a), (1.0, b)])`` and ``0.3 * a + b`` are the same. Objectives have different units
    and sizes; a weight of importance divided by the value at the start makes them comparable.

    Args:
        terms: Pairs of weight and objective.

    Raises:
        TypeError: If a term is no pair of a number and an objective.
        ValueError: If there are no terms, or a weight is not a finite number.
    """

    def __init__(self, terms: Iterable[tuple[float, Objective]]) -> None:
        #: Pairs of weight and objective.
        self.terms: list[tuple[float, Objective]] = []
        validation.instance("sum of objectives: terms", terms, Iterable, "a list of pairs")
        for term in terms:
            if not (isinstance(term, tuple | list) and len(term) == 2):
                raise TypeError(
                    "sum of objectives: each term must be a pair (weight, objective), but one is "
                    f"{validation.described(term)}"
                )
            weight, given = term
            objective = check_objective("sum of objectives: a term", given)
            self.terms.append((validation.number(f"weight of {objective}", weight), objective))
        if not self.terms:
            raise ValueError("a sum of objectives needs at least one term")

    def __repr__(self) -> str:
        """The terms with their weights."""
        return " + ".join(f"{weight:g} * {objective}" for weight, objective in self.terms)

    @property
    def needs_trajectory(self) -> bool:
        return any(objective.needs_trajectory for _, objective in self.terms)

    def validate(self, densities: Collection[str] | Mapping[str, DensityField]) -> None:
        for _, term in self.terms:
            term.validate(densities)

    def validate_names(self, markers: Mapping[str, Collection[str]], joints: list[str]) -> None:
        for _, term in self.terms:
            term.validate_names(markers, joints)

    def validate_modes(self, modes: Mapping[str, int]) -> None:
        for _, term in self.terms:
            term.validate_modes(modes)

    def evaluate(self, response: Response) -> float:
        return sum(weight * term.evaluate(response) for weight, term in self.terms)

    def derivatives(self, response: Response) -> Derivatives:
        parts = (term.derivatives(response).scaled(weight) for weight, term in self.terms)
        return sum(parts, Derivatives())

    def calibrated(self, response: Response) -> Sum:
        terms = [(weight, term.calibrated(response)) for weight, term in self.terms]
        same = all(new is old for (_, new), (_, old) in zip(terms, self.terms, strict=True))
        return self if same else Sum(terms)

    def value(self, trajectory: Trajectory, bodies: Bodies) -> float:
        return self.evaluate(Response(trajectory, bodies))

    def pullback(self, trajectory: Trajectory, bodies: Bodies) -> Bars:
        found = self.derivatives(Response(trajectory, bodies))
        return found.trajectory, dict(found.integrals)

    def _summands(self) -> list[tuple[float, Objective]]:
        return self.terms


@dataclass(frozen=True)
class Constraint:
    """A bound on an objective, for optimisers that take several: g <= 0.

        g = (psi - upper) / |upper|     or     g = (lower - psi) / |lower|

    so that g is a number without unit; with a positive upper bound g = psi / upper - 1.

    Raises:
        ValueError: If there is not exactly one bound, or if it is zero, NaN or infinite.
    """

    #: What is bounded.
    objective: Objective
    #: Largest value allowed, in the unit of the objective.
    upper: float | None = None
    #: Smallest value allowed, in the unit of the objective.
    lower: float | None = None
    #: Name for results and messages; by default the name of the objective's class.
    name: str = ""

    def __post_init__(self) -> None:
        """Check kinds and bound."""
        check_objective("constraint: the objective", self.objective)
        validation.name("constraint: name", self.name)
        if (self.upper is None) == (self.lower is None):
            raise ValueError(
                f"constraint {self.label!r} needs either an upper or a lower bound; for both, give "
                "two constraints"
            )
        given = self.lower if self.upper is None else self.upper
        if validation.number(f"constraint {self.label!r}: the bound", given) == 0.0:
            raise ValueError(
                f"constraint {self.label!r}: the bound must be a number other than zero, which the "
                "values are compared with"
            )

    @property
    def label(self) -> str:
        """Name given by the user, or that of the objective's class."""
        return self.name or type(self.objective).__name__

    @property
    def bound(self) -> float:
        """The bound, in the unit of the objective."""
        bound = self.lower if self.upper is None else self.upper
        return math.nan if bound is None else float(bound)

    @property
    def slope(self) -> float:
        """Derivative of g with respect to the objective."""
        return (-1.0 if self.upper is None else 1.0) / abs(self.bound)

    def calibrated(self, response: Response) -> Constraint:
        """The constraint with its objective corrected at a design, see `Objective.calibrated`.

        Args:
            response: Of the design.
        """
        objective = self.objective.calibrated(response)
        return self if objective is self.objective else replace(self, objective=objective)

    def scaled(self, psi: float) -> float:
        """The value of g, at most zero where the bound holds.

        Args:
            psi: Value of the objective.
        """
        return self.slope * (psi - self.bound)


def check_objective(what: str, objective: object) -> Objective:
    """The objective, or refuse what is none.

    Args:
        what: Name of the argument, for the message.
        objective: What is given for it.

    Raises:
        TypeError: If it is no objective.
    """
    needed = "an objective, as IntegralCompliance()"
    return validation.instance(what, objective, Objective, needed)


def no_body(what: str, name: str, bodies: Collection[str]) -> ValueError:
    """Error for a body that does not exist.

    Args:
        what: Name of the objective.
        name: Name of the missing body.
        bodies: Names of those that exist.
    """
    return ValueError(f"{what} of body {name!r}, but the bodies are {list(bodies)}")
