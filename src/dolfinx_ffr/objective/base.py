# SPDX-License-Identifier: MIT
"""The base of all objectives: value, derivatives, weighted sums, bounds."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Protocol

from .. import validation
from ..arrays import Array, summed
from ..body import VolumeIntegrals
from ..documentation import Shown
from ..dynamics import Trajectory, TrajectoryBar
from ..mechanism import PointMass

Bodies = Mapping[str, VolumeIntegrals]
#: Text between the label of a constraint and the number of one of its `Constraint.places`
_PLACE = ", place "


def _in_a_list(local: Array) -> list[Array]:
    """All-gather on one rank: the local array in a list."""
    return [local]


@dataclass(frozen=True, eq=False, repr=False)
class DensityField(Shown):
    """The densities of a body's cells; each rank holds its own cells.

    Attributes:
        values: Densities, shape (cells,), in [0, 1].
        areas: Areas of the cells, in space volumes, shape (cells,) [m^2], [m^3].
        centroids: Centroids of the cells in the undeformed body, shape (cells, dimension) [m].
        sum: Sum of an array over the cells of all ranks, the same on every rank.
        gathered: The arrays of all ranks in a list, the same on every rank.
        whole: The body as it was designed, if this is the mesh of a part of it; shares of volume
            are relative to its area.
    """

    values: Array
    areas: Array
    centroids: Array
    sum: Callable[[Array], float]
    gathered: Callable[[Array], list[Array]] = _in_a_list
    whole: DensityField | None = None


class StressField(Protocol):
    """The stress of a body for unit coordinates; each rank holds its own cells.

    The solid has it at the strain of the cell; see :func:`stress_coordinates`.
    """

    @property
    def n_constraint(self) -> int:
        """Number of constraint modes, the first of the elastic coordinates."""

    @property
    def out_of_plane(self) -> float:
        """The stress s_z / (s_x + s_y) [-]."""

    @property
    def weights(self) -> Array:
        """Area that each point stands for, in space volume, shape (cells, points) [m^2], [m^3]."""

    @property
    def points(self) -> Array:
        """Where the stress is given, undeformed, shape (cells, points, dimension) [m]."""

    @property
    def interface_distance(self) -> Array:
        """From each point to the nearest node of an interface, (cells, points) [m]."""

    def modes(self, correction: bool) -> Array:
        """Stress s_x, s_y, t_xy, in space all six, for unit coordinates.

        With ``correction`` the coordinates of the static correction follow the elastic ones. Shape
        (cells, points, 3 or 6, coordinates) [Pa].
        """

    def sum(self, local: Array) -> Array:
        """The sum of the ``local`` arrays of all ranks, bit-identical on every rank."""

    def gathered(self, value: Any) -> list[Any]:
        """The values of all ranks, this one's being ``value``, alike on every rank."""


@dataclass(frozen=True, eq=False, repr=False)
class Response(Shown):
    """The arguments of objectives: a trajectory, and the integrals, densities and stress of bodies.

    Attributes:
        simulated: None if neither objective nor constraints need it.
        bodies: Volume integrals of all bodies, by name.
        densities: Densities of the bodies that have one, by name; none for bodies given by their
            integrals.
        stresses: Stress of the bodies that have a mesh, by name.
        point_masses: Point masses of the mechanism, which the bodies are without; None if unknown.
        cache: Intermediate values that objectives store for their derivatives, under keys of their
            own; empty at first, also in a copy with other fields.
    """

    simulated: Trajectory | None
    bodies: Bodies
    densities: Mapping[str, DensityField] = field(default_factory=dict)
    stresses: Mapping[str, StressField] = field(default_factory=dict)
    point_masses: Sequence[PointMass] | None = None
    cache: dict[Any, Any] = field(default_factory=dict, init=False, repr=False)

    @property
    def trajectory(self) -> Trajectory:
        """The trajectory."""
        if self.simulated is None:
            raise ValueError("the objective needs a trajectory, but nothing was simulated")
        return self.simulated

    @property
    def inventory(self) -> Inventory:
        """The names that objectives may use."""
        return Inventory(
            {name: body.markers for name, body in self.bodies.items()},
            {name: body.modes for name, body in self.bodies.items()},
            [] if self.simulated is None else list(self.simulated.model.joints),
            self.densities,
        )


@dataclass(frozen=True, eq=False)
class Inventory:
    """The names that objectives may use, for :meth:`Objective.validate`.

    Attributes:
        markers: Names of the markers by name of the body, of all bodies.
        modes: Number of elastic coordinates by name of the body, of all bodies; 0 of rigid ones.
        joints: Names of the joints.
        densities: Densities of the bodies that have one, by name; of full bodies before a design
            exists.
    """

    markers: Mapping[str, Collection[str]]
    modes: Mapping[str, int]
    joints: Collection[str]
    densities: Mapping[str, DensityField] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, repr=False)
class Derivatives(Shown):
    """Partial derivatives of a number with respect to the parts of a response.

    Attributes:
        trajectory: With respect to the trajectory, at fixed bodies; None where it does not matter.
        integrals: With respect to the integrals, at fixed trajectory and densities, by name of the
            body; a body that is missing does not matter.
        densities: With respect to the densities of this rank's cells, shape (cells,), at fixed
            trajectory, integrals and stress for unit coordinates, likewise.
        stresses: With respect to the stress of this rank's cells for unit coordinates, shape
            (cells, points, 3 or 6, coordinates), at fixed trajectory and densities, likewise.
        areas: With respect to the areas of this rank's cells, in space volumes, shape (cells,),
            likewise; they matter for derivatives with respect to the nodes of a mesh alone.
        weights: With respect to the areas that the points of the stress stand for, shape (cells,
            points).
        parameters: With respect to the parameters of the mechanism, by name. An objective leaves
            them out: they are formed by a problem, for all that depends on its parameters.
    """

    trajectory: TrajectoryBar | None = None
    integrals: Mapping[str, VolumeIntegrals] = field(default_factory=dict)
    densities: Mapping[str, Array] = field(default_factory=dict)
    stresses: Mapping[str, Array] = field(default_factory=dict)
    areas: Mapping[str, Array] = field(default_factory=dict)
    weights: Mapping[str, Array] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)

    def checked(self, what: str, response: Response) -> Derivatives:
        """The derivatives as arrays; errors name them ``what``.

        Raises:
            ValueError: If a derivative is with respect to something that the ``response`` lacks,
                has another shape, or holds NaN or infinity.
        """
        bar = self.trajectory
        if bar is not None:
            by = f"{what} by the trajectory"
            validation.instance(by, bar, TrajectoryBar, "a TrajectoryBar of the trajectory")
            trajectory = validation.instance(
                f"{by}: the trajectory", response.simulated, Trajectory, "one"
            )
            zeros = vars(TrajectoryBar.zeros(trajectory))
            bar = TrajectoryBar(
                *(
                    validation.real_array(f"{what} by {key}", getattr(bar, key), zero.shape)
                    for key, zero in zeros.items()
                )
            )

        def present(
            kind: str, by_body: Mapping[str, Any], names: Collection[str], of: str
        ) -> Iterator[tuple[str, Any, str]]:
            checked = validation.by_name(f"{what} by {kind}", by_body, "derivatives")
            for name, value in checked.items():
                label = f"{what} by the {kind} of {name!r}"
                if name not in names:
                    raise ValueError(f"{label}, but the bodies {of} are {list(names)}")
                yield name, value, label

        def arrays(kind: str, names: Collection[str], of: str, shape: Callable) -> dict:
            field = {"density": "densities", "stress": "stresses"}.get(kind, kind)
            entries = present(kind, getattr(self, field), names, of)
            return {n: validation.real_array(label, value, shape(n)) for n, value, label in entries}

        bodies, fields, stresses = response.bodies, response.densities, response.stresses
        integrals = {}
        for name, value, label in present("integrals", self.integrals, bodies, "there"):
            integrals[name] = validation.instance(label, value, VolumeIntegrals, "VolumeIntegrals")
            body = bodies[name]
            for key in ("S", "K", *(("G", "N") if body.P is None else ("P",))):
                shape = getattr(body, key).shape
                validation.real_array(f"{label}: {key}", getattr(value, key), shape)
            if not math.isfinite(body.zeros_like().dot(value)):
                raise ValueError(f"{label} hold NaN or infinity")
        # the stress itself is not computed here, which takes all ranks
        cells = {name: len(field.values) for name, field in fields.items()}
        return Derivatives(
            bar,
            integrals,
            arrays("density", fields, "with a density", lambda n: fields[n].values.shape),
            arrays("stress", stresses, "with a mesh", lambda n: (cells.get(n), None, None, None)),
            arrays("areas", fields, "with a density", lambda n: fields[n].areas.shape),
            arrays("weights", stresses, "with a mesh", lambda n: stresses[n].weights.shape),
        )

    def scaled(self, factor: float) -> Derivatives:
        """The derivatives times a ``factor``."""

        def times(arrays: Mapping[str, Array]) -> dict[str, Array]:
            return {name: factor * bar for name, bar in arrays.items()}

        return Derivatives(
            None if self.trajectory is None else self.trajectory.scaled(factor),
            {name: bar.scaled(factor) for name, bar in self.integrals.items()},
            times(self.densities),
            times(self.stresses),
            times(self.areas),
            times(self.weights),
            {name: factor * slope for name, slope in self.parameters.items()},
        )

    def without_trajectory(self, through: Derivatives) -> Derivatives:
        """The derivatives as a function of the bodies and parameters alone.

        Args:
            through: Derivatives through the trajectory, with respect to the integrals of all bodies
                and to the parameters.
        """
        return through + replace(self, trajectory=None)

    def __add__(self, other: Derivatives) -> Derivatives:
        ours, theirs = self.trajectory, other.trajectory
        return Derivatives(
            ours if theirs is None else theirs if ours is None else ours + theirs,
            summed(self.integrals, other.integrals),
            summed(self.densities, other.densities),
            summed(self.stresses, other.stresses, _sum_of_modes),
            summed(self.areas, other.areas),
            summed(self.weights, other.weights),
            summed(self.parameters, other.parameters),
        )


def _sum_of_modes(a: Array, b: Array) -> Array:
    """Sum of stress derivatives; either may lack the columns of the static correction."""
    longer, shorter = (a, b) if a.shape[-1] >= b.shape[-1] else (b, a)
    total = longer.copy()
    total[..., : shorter.shape[-1]] += shorter
    return total


class Objective(ABC):
    """A number psi of the trajectory and of volume integrals, densities and stress of bodies.

    An objective of one's own derives from this class, and defines :meth:`evaluate` and
    :meth:`derivatives`. Objectives are added, and multiplied by numbers, with the usual signs.
    """

    #: SI unit of the number, for reports; "" for numbers without one, and where it is not known.
    unit: ClassVar[str] = ""

    @property
    def needs_trajectory(self) -> bool:
        """Whether the number depends on the trajectory, so that it must be simulated."""
        return True

    def validate(self, inventory: Inventory) -> None:  # noqa: B027 (many have nothing to refuse)
        """Refuse names that an ``inventory`` lacks, and bodies too rigid, before any computation.

        Raises:
            ValueError: If a body, marker, joint or density does not exist, with a list of those
                that do; if a body that must deform is rigid, or has too few elastic coordinates.
        """

    @abstractmethod
    def evaluate(self, response: Response) -> float:
        """The number at a ``response``, the same on every rank.

        The response's trajectory is None for an objective that does not need it.
        """

    @abstractmethod
    def derivatives(self, response: Response) -> Derivatives:
        """Its partial derivatives with respect to the parts of a ``response``."""

    def calibrated(self, response: Response) -> Objective:
        """The objective corrected at a ``response``, if it approximates another number.

        Only :class:`PeakStress` does, the largest stress; others are returned unchanged.
        """
        return self

    def parts(self, response: Response) -> list[Objective]:
        """Objectives whose largest value at a ``response`` is this one's value, or itself.

        Bounds on all of them have several slopes, a bound on the largest has one.
        """
        return [self]

    def places(self, response: Response) -> list[Objective]:
        """Objectives of several places, whose largest value at a ``response`` is this one's value.

        Only :class:`PeakStress` has several; others return themselves. In contrast to `parts` they
        can be evaluated on other meshes, too.
        """
        return [self]

    def _summands(self) -> list[tuple[float, Objective]]:
        """The objective as weights and terms of a sum."""
        return [(1.0, self)]

    def __add__(self, other: Objective) -> Sum:
        check_objective("sum of objectives: what is added", other)
        return Sum([*self._summands(), *other._summands()])

    def __radd__(self, other: float) -> Objective:
        return self if other == 0 else NotImplemented  # the built-in sum begins with zero

    def __sub__(self, other: Objective) -> Sum:
        check_objective("difference of objectives: what is subtracted", other)
        return self + (-1.0) * other

    def __mul__(self, weight: float) -> Sum:
        weight = validation.number("weight of an objective", weight)
        return Sum([(weight * factor, objective) for factor, objective in self._summands()])

    __rmul__ = __mul__

    def __neg__(self) -> Sum:
        return self * -1.0


class Sum(Objective):
    """Weighted sum of objectives, psi = sum_i weight_i psi_i.

    ``Sum([(0.3, a), (1.0, b)])`` and ``0.3 * a + b`` are the same. Objectives have different units
    and sizes; a weight of importance divided by the value at the start makes them comparable.

    Args:
        terms: Pairs of weight and objective.
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
            weight, summand = term
            objective = check_objective("sum of objectives: a term", summand)
            self.terms.append((validation.number(f"weight of {objective}", weight), objective))
        if not self.terms:
            raise ValueError("a sum of objectives needs at least one term")

    def __repr__(self) -> str:
        return " + ".join(f"{weight:g} * {objective}" for weight, objective in self.terms)

    @property
    def needs_trajectory(self) -> bool:
        return any(objective.needs_trajectory for _, objective in self.terms)

    def validate(self, inventory: Inventory) -> None:
        for _, term in self.terms:
            term.validate(inventory)

    def evaluate(self, response: Response) -> float:
        return sum(weight * value_of(term, response) for weight, term in self.terms)

    def derivatives(self, response: Response) -> Derivatives:
        terms = (derivatives_of(term, response).scaled(weight) for weight, term in self.terms)
        return sum(terms, Derivatives())

    def calibrated(self, response: Response) -> Sum:
        terms = [(weight, term.calibrated(response)) for weight, term in self.terms]
        unchanged = all(new is old for (_, new), (_, old) in zip(terms, self.terms, strict=True))
        return self if unchanged else Sum(terms)

    def _summands(self) -> list[tuple[float, Objective]]:
        return self.terms


@dataclass(frozen=True)
class Constraint:
    """A bound on an objective, for optimisers that take several: g <= 0.

        g = (psi - upper) / |upper|     or     g = (lower - psi) / |lower|

    so that g is a number without unit; with a positive upper bound g = psi / upper - 1.

    Attributes:
        objective: The bounded objective.
        upper: Largest value allowed, in the unit of the objective.
        lower: Smallest value allowed, in the unit of the objective.
        name: Name for results and messages; by default the name of the objective's class.
    """

    objective: Objective
    upper: float | None = None
    lower: float | None = None
    name: str = ""

    def __post_init__(self) -> None:
        check_objective("constraint: the objective", self.objective)
        validation.name("constraint: name", self.name)
        if (self.upper is None) == (self.lower is None):
            raise ValueError(
                f"constraint {self.label!r} needs either an upper or a lower bound; for both, give "
                "two constraints"
            )
        bound = self.lower if self.upper is None else self.upper
        if validation.number(f"constraint {self.label!r}: the bound", bound) == 0.0:
            raise ValueError(
                f"constraint {self.label!r}: the bound must be a number other than zero, because "
                "values are divided by it"
            )

    @property
    def label(self) -> str:
        """Name given by the user, or the name of the objective's class."""
        return self.name or type(self.objective).__name__

    @property
    def bound(self) -> float:
        """The bound, in the unit of the objective."""
        bound = self.lower if self.upper is None else self.upper
        return math.nan if bound is None else float(bound)

    @property
    def limit(self) -> str:
        """The bound in words."""
        kind = "at least" if self.upper is None else "at most"
        return f"{kind} {self.bound:.4g} {self.objective.unit}".rstrip()

    @property
    def slope(self) -> float:
        """Derivative of g with respect to the objective."""
        return (-1.0 if self.upper is None else 1.0) / abs(self.bound)

    def calibrated(self, response: Response) -> Constraint:
        """The constraint with its objective `Objective.calibrated` at a ``response``."""
        objective = self.objective.calibrated(response)
        return self if objective is self.objective else replace(self, objective=objective)

    def parts(self, response: Response) -> list[Constraint]:
        """Constraints on `Objective.parts` at a ``response``, which hold where this one does."""
        return self._each(self.objective.parts(response), ", part ")

    def places(self, response: Response) -> list[Constraint]:
        """Constraints on `Objective.places` at a ``response``, which hold where this one does."""
        return self._each(self.objective.places(response), _PLACE)

    def _each(self, objectives: Sequence[Objective], named: str) -> list[Constraint]:
        """A constraint on each of the ``objectives``, whose largest value this one bounds."""
        if len(objectives) == 1 or self.upper is None:
            return [self]
        return [
            replace(self, objective=objective, name=f"{self.label}{named}{k}")
            for k, objective in enumerate(objectives, 1)
        ]

    def scaled(self, psi: float) -> float:
        """The value of g for the objective's value ``psi``; not positive if it is satisfied."""
        return self.slope * (psi - self.bound)


def constraint_of_place(label: str) -> str:
    """The label of the constraint to whose `Constraint.places` this ``label`` belongs."""
    return label.rpartition(_PLACE)[0]


def value_of(objective: Objective, response: Response, where: str = "") -> float:
    """The value of an objective, or a TypeError or ValueError if it is no finite real number."""
    value = objective.evaluate(response)
    return validation.number(f"{where}the value of {type(objective).__name__}", value)


def derivatives_of(objective: Objective, response: Response, where: str = "") -> Derivatives:
    """The partial derivatives of an objective, or the errors of `Derivatives.checked`."""
    derivatives = objective.derivatives(response)
    label, needed = f"{where}the derivatives of {type(objective).__name__}", "ffr.Derivatives(...)"
    return validation.instance(label, derivatives, Derivatives, needed).checked(label, response)


def check_objective(what: str, objective: object) -> Objective:
    """The objective, or a TypeError for another object."""
    needed = "an objective, as IntegralCompliance()"
    return validation.instance(what, objective, Objective, needed)


def no_body(what: str, name: str, bodies: Collection[str]) -> ValueError:
    """Error for a body that is not among ``bodies``; ``what`` is the objective."""
    return ValueError(f"{what} of body {name!r}, but the bodies are {list(bodies)}")


def no_marker(what: str, marker: str, body: str, markers: Collection[str]) -> ValueError:
    """Error for a marker that is not among the ``markers`` of a body; ``what`` refers to it."""
    return ValueError(
        f"{what} of marker {marker!r}, but the markers of body {body!r} are {list(markers)}"
    )
