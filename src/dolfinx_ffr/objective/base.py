# SPDX-License-Identifier: MIT
"""What all objectives have in common: value, pullback, weighted sums, bounds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ..body import VolumeIntegrals
from ..dynamics.trajectory import Trajectory, TrajectoryBar

__all__ = ["Constraint", "Objective", "Sum"]

Bodies = Mapping[str, VolumeIntegrals]
#: Derivatives with respect to the trajectory (None: it does not matter), and to the integrals of
#: the bodies at fixed trajectory (a body that is missing does not matter).
Bars = tuple[TrajectoryBar | None, dict[str, VolumeIntegrals]]


class Objective:
    """A number psi that depends on the trajectory and on the volume integrals of the bodies.

    An objective of one's own derives from this class and defines :meth:`value` and
    :meth:`pullback`. Objectives are added, and multiplied by numbers, with the usual signs.
    """

    @property
    def needs_trajectory(self) -> bool:
        """Whether the number depends on the motion; without it nothing needs to be simulated."""
        return True

    def value(self, trajectory: Trajectory, bodies: Bodies) -> float:
        """The number.

        Args:
            trajectory: Result of the simulation.
            bodies: Volume integrals of the bodies, by name.
        """
        raise NotImplementedError

    def pullback(self, trajectory: Trajectory, bodies: Bodies) -> Bars:
        """Its derivatives with respect to the trajectory, and to the integrals at fixed trajectory.

        Args:
            trajectory: Result of the simulation.
            bodies: Volume integrals of the bodies, by name.

        Returns:
            The derivative with respect to the trajectory, None where the number does not depend on
            it, and those with respect to the integrals by name of the body; a body that does not
            matter may be missing.
        """
        raise NotImplementedError

    def __add__(self, other: Objective) -> Sum:
        """Sum of two objectives."""
        return Sum([*_terms(self), *_terms(other)])

    def __radd__(self, other: float) -> Objective:
        """Start of the built-in sum, which is zero."""
        return self if other == 0 else NotImplemented

    def __sub__(self, other: Objective) -> Sum:
        """Difference of two objectives."""
        return self + (-1.0) * other

    def __mul__(self, weight: float) -> Sum:
        """The objective times a weight."""
        return Sum([(weight * own, objective) for own, objective in _terms(self)])

    __rmul__ = __mul__

    def __neg__(self) -> Sum:
        """The objective with the opposite sign, to be maximised."""
        return self * -1.0


def _terms(objective: Objective) -> list[tuple[float, Objective]]:
    return objective.terms if isinstance(objective, Sum) else [(1.0, objective)]


class Sum(Objective):
    """Weighted sum of objectives, psi = sum_i weight_i psi_i.

    ``Sum([(0.3, a), (1.0, b)])`` and ``0.3 * a + b`` are the same. Objectives have different units
    and sizes; a weight of importance divided by the value at the start makes them comparable.

    Args:
        terms: Pairs of weight and objective.

    Raises:
        ValueError: If there are no terms, or a weight is not a finite number.
    """

    def __init__(self, terms: Iterable[tuple[float, Objective]]) -> None:
        #: Pairs of weight and objective.
        self.terms = [(float(weight), objective) for weight, objective in terms]
        if not self.terms:
            raise ValueError("a sum of objectives needs at least one term")
        for weight, objective in self.terms:
            if not math.isfinite(weight):
                raise ValueError(f"weight of {objective} is {weight}")

    def __repr__(self) -> str:
        """The terms with their weights."""
        return " + ".join(f"{weight:g} * {objective}" for weight, objective in self.terms)

    @property
    def needs_trajectory(self) -> bool:
        """Whether a term depends on the motion."""
        return any(objective.needs_trajectory for _, objective in self.terms)

    def value(self, trajectory: Trajectory, bodies: Bodies) -> float:
        """The weighted sum.

        Args:
            trajectory: Result of the simulation.
            bodies: Volume integrals of the bodies, by name.
        """
        return sum(weight * term.value(trajectory, bodies) for weight, term in self.terms)

    def pullback(self, trajectory: Trajectory, bodies: Bodies) -> Bars:
        """The weighted sum of the derivatives of the terms.

        Args:
            trajectory: Result of the simulation.
            bodies: Volume integrals of the bodies, by name.
        """
        total: TrajectoryBar | None = None
        bars: dict[str, VolumeIntegrals] = {}
        for weight, term in self.terms:
            part, direct = term.pullback(trajectory, bodies)
            if part is not None:
                arrays = (weight * a for a in (part.y, part.v, part.w, part.multipliers))
                scaled = TrajectoryBar(*arrays)
                total = scaled if total is None else total + scaled
            for name, bar in direct.items():
                own = bar.scaled(weight)
                bars[name] = bars[name] + own if name in bars else own
        return total, bars


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
        """Check the bound."""
        if (self.upper is None) == (self.lower is None):
            raise ValueError(
                f"constraint {self.label!r} needs either an upper or a lower bound; for both, give "
                "two constraints"
            )
        if not math.isfinite(self.bound) or self.bound == 0.0:
            raise ValueError(
                f"constraint {self.label!r}: the bound is {self.bound}, but it must be a finite "
                "number other than zero, which the values are compared with"
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

    def scaled(self, psi: float) -> float:
        """The value of g, at most zero where the bound holds.

        Args:
            psi: Value of the objective.
        """
        return self.slope * (psi - self.bound)


def no_body(what: str, name: str, bodies: Bodies) -> ValueError:
    """Error for a body that does not exist.

    Args:
        what: Name of the objective.
        name: Name of the missing body.
        bodies: The bodies that exist.
    """
    return ValueError(f"{what} of body {name!r}, but the bodies are {list(bodies)}")
