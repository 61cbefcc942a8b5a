# SPDX-License-Identifier: MIT
"""What is known of a problem at one design."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..body import VolumeIntegrals
from ..dynamics import Trajectory
from ..mechanical_problem import ConstraintValue
from ..reduction import ReducedBody

__all__ = ["Evaluation", "MotionEvaluation", "only_motion"]

Array = NDArray[np.float64]
T = TypeVar("T")


@dataclass(frozen=True)
class MotionEvaluation:
    """What one of the motions of a problem gives at one design."""

    psi: float  #: Value of this motion's objective, the same on every rank
    #: The motion, replicated on every rank; None if neither objective nor constraints depend on it
    trajectory: Trajectory | None = field(default=None, repr=False)
    #: This motion's constraints by their own names
    constraints: dict[str, ConstraintValue] = field(default_factory=dict)
    #: dpsi/dx of this motion by body, for each cell owned by this rank, shape (cells,); None where
    #: it was not asked for, or where that of all motions together is enough
    gradient: dict[str, Array] | None = field(default=None, repr=False)
    #: Derivative of this motion's psi with respect to the integrals of every body, the same on
    #: every rank; None where only the value was asked for
    integrals_gradient: dict[str, VolumeIntegrals] | None = field(default=None, repr=False)


@dataclass(frozen=True)
class Evaluation:
    """A value of the objective, its gradient, and what was learnt on the way."""

    #: Value of the objective (integral compliance: [J s]), of several motions the one number that
    #: they become together; the same on every rank
    psi: float
    #: dpsi/dx by body, for each cell owned by this rank, shape (cells,); None where only the value
    #: was asked for
    gradient: dict[str, Array] | None
    bodies: dict[str, ReducedBody] = field(repr=False)  #: Shape functions and integrals
    volume: dict[str, float]  #: Share of each body's area that is filled, in [0, 1]
    #: Natural frequencies of each body with all interfaces held, those of its normal modes [Hz];
    #: the objective `Frequency` is another one, of the body on its supports or free
    fixed_interface_frequencies: dict[str, Array]
    outer_gap: dict[str, float]  #: Relative gap between the last mode kept and the next one
    solver_iterations: dict[str, int]  #: Conjugate gradient iterations of all pullbacks
    seconds: dict[str, float]  #: Time spent by name of the part, on this rank [s]
    #: Constraints by name, with their gradients where the gradient was asked for; of several
    #: motions "motion: name"
    constraints: dict[str, ConstraintValue] = field(default_factory=dict)
    #: Derivative of psi with respect to the integrals of every body, those of given bodies too, the
    #: same on every rank; None where only the value was asked for
    integrals_gradient: dict[str, VolumeIntegrals] | None = field(default=None, repr=False)
    #: By name of the motion
    motions: dict[str, MotionEvaluation] = field(default_factory=dict, repr=False)

    @property
    def frequencies(self) -> dict[str, Array]:
        """The name of `fixed_interface_frequencies` in the release before."""
        warnings.warn(
            "Evaluation.frequencies is now called fixed_interface_frequencies; the old name goes "
            "with the next release",
            DeprecationWarning,
            stacklevel=2,
        )
        return self.fixed_interface_frequencies

    @property
    def moves(self) -> bool:
        """Whether anything was simulated."""
        return any(motion.trajectory is not None for motion in self.motions.values())

    @property
    def trajectory(self) -> Trajectory | None:
        """The only motion, replicated on every rank; None if nothing depends on it.

        Raises:
            ValueError: On every rank, if there are several motions.
        """
        if not self.motions:
            return None
        return only_motion(self.motions, "evaluation.alone({!r}).trajectory").trajectory

    @property
    def motion(self) -> Trajectory:
        """The trajectory, where there must be one.

        Raises:
            ValueError: On every rank, if nothing was simulated, or there are several motions.
        """
        found = self.trajectory
        self.check_motion()
        assert found is not None
        return found

    def check_motion(self) -> None:
        """Refuse an evaluation for which nothing was simulated.

        Raises:
            ValueError: On every rank, if it is one.
        """
        if not self.moves:
            raise ValueError(
                "there is no motion: nothing was simulated, because neither the objective nor the "
                "constraints of this problem depend on it"
            )

    def alone(self, motion: str) -> Evaluation:
        """What this says of one of several motions, as if its problem had no other.

        It belongs to `Problem.alone`, and is what pictures and reports of one motion take.

        Args:
            motion: Name of the motion.

        Raises:
            ValueError: If there is no motion of this name.
        """
        validation.choice("evaluation: motion", motion, self.motions)
        found = self.motions[motion]
        return replace(
            self,
            psi=found.psi,
            gradient=found.gradient,
            constraints=found.constraints,
            integrals_gradient=found.integrals_gradient,
            motions={motion: found},
        )


def only_motion(motions: Mapping[str, T], instead: str) -> T:
    """The value of a mapping with one motion.

    Args:
        motions: By name.
        instead: What to ask where there are several, with a place for the name of one.

    Raises:
        ValueError: If there are several.
    """
    if len(motions) > 1:
        first = next(iter(motions))
        raise ValueError(
            f"there are {len(motions)} motions, {list(motions)}: ask for one of them, for example "
            f"{instead.format(first)}"
        )
    return next(iter(motions.values()))
