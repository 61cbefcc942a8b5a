# SPDX-License-Identifier: MIT
"""The evaluation of a problem at one design."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeVar

from .. import validation
from ..arrays import Array
from ..body import VolumeIntegrals
from ..documentation import Shown
from ..dynamics import Trajectory
from ..mechanical_problem import ConstraintValue, Gradients
from ..mechanism import Parameters
from ..reduction import ReducedBody

T = TypeVar("T")


@dataclass(frozen=True)
class LoadCaseEvaluation(Gradients):
    """The evaluation of one load case of a problem.

    It has gradients of its own where they were asked for, or where the gradient of all load cases
    together does not suffice.

    Attributes:
        psi: Value of its objective, the same on every rank.
        trajectory: Replicated on every rank; None if neither objective nor constraints depend on
            it.
        constraints: Constraints by name.
        integrals_gradient: Derivative of psi with respect to the integrals of every body, the same
            on every rank; None where only the value was asked for, or where the load case has no
            weight.
        cache: Values that its objectives store for their derivatives, see `Response.cache`.
    """

    psi: float
    trajectory: Trajectory | None = field(default=None, repr=False)
    constraints: dict[str, ConstraintValue] = field(default_factory=dict)
    integrals_gradient: dict[str, VolumeIntegrals] | None = field(default=None, repr=False)
    cache: dict[Any, Any] = field(default_factory=dict, repr=False)


@dataclass(frozen=True, repr=False)
class Evaluation(Shown, Gradients):
    """The objective, its gradient, and all other results at one design.

    Attributes:
        psi: Value of the objective (integral compliance: [J s]), of several load cases the one
            number that they become together; the same on every rank.
        gradient: dpsi/dx by body, for each cell owned by this rank, shape (cells,), and by `label`
            dpsi/dp, shape (parameters,); None where only the value was asked for.
        bodies: Shape functions and integrals.
        volume: Share of each body's area that is filled, in [0, 1].
        fixed_interface_frequencies: Natural frequencies of each body's normal modes, with all
            interfaces fixed [Hz]; the objective `Frequency` is another one, of the body on its
            supports or free.
        outer_gap: Relative gap between the eigenvalues of the last retained mode and the next one.
        solver_iterations: Conjugate gradient iterations of all pullbacks.
        seconds: Time spent by name of the part, on this rank [s].
        constraints: Constraints by name, with their gradients where the gradient was asked for; of
            several load cases "load case: name".
        integrals_gradient: Derivative of psi with respect to the integrals of every body, also of
            given ones, the same on every rank; None where only the value was asked for.
        nodes: dpsi/dX by body, for each node of the mesh on this rank in the order of
            ``mesh.geometry.x``, ghosts included, shape (nodes, dimension); None where it was not
            asked for.
        centers: dpsi by the center of each interface, by body, at fixed nodes, in the order of
            ``domain.interfaces``, shape (interfaces, dimension), the same on every rank; None where
            it was not asked for.
        parameters: Derivative of psi with respect to each parameter of the mechanism, by name, the
            same on every rank; empty where there are none, or only the value was asked for.
        mechanism_parameters: The parameters of the mechanism, with their values.
        label: Name under which their values were given beside densities; the gradient has it, too.
        load_cases: Evaluations by name of the load case.
    """

    psi: float
    bodies: dict[str, ReducedBody] = field(repr=False)
    volume: dict[str, float]
    fixed_interface_frequencies: dict[str, Array]
    outer_gap: dict[str, float]
    solver_iterations: dict[str, int]
    seconds: dict[str, float]
    constraints: dict[str, ConstraintValue] = field(default_factory=dict)
    integrals_gradient: dict[str, VolumeIntegrals] | None = field(default=None, repr=False)
    mechanism_parameters: Parameters | None = None
    label: str = ""
    load_cases: dict[str, LoadCaseEvaluation] = field(default_factory=dict, repr=False)

    def _shown(self) -> list[tuple[str, str, str]]:
        rows = [("psi", f"{self.psi:.6g}", "")]
        cases = self.load_cases if len(self.load_cases) > 1 else {}
        rows += [(f"psi of {name}", f"{case.psi:.6g}", "") for name, case in cases.items()]
        for name, bound in self.constraints.items():
            rows.append((name, f"{bound.value:.6g}", f"{bound.violation:+.2%} from its bound"))
        rows += [(f"volume of {name}", f"{share:.1%}", "") for name, share in self.volume.items()]
        for name, modes in self.fixed_interface_frequencies.items():
            range_ = f", {modes[0]:.5g} to {modes[-1]:.5g} Hz" if len(modes) else ""
            rows.append((f"modes of {name}", f"{len(modes)}{range_}", ""))
        values = self.mechanism_parameters.values if self.mechanism_parameters else {}
        rows += [(f"parameter {name}", f"{value:.6g}", "") for name, value in values.items()]
        rows.append(("gradient", ", ".join(self.gradient or {}) or "not asked for", ""))
        return rows

    @property
    def labelled_values(self) -> dict[str, float]:
        """Values of the designed parameters, by their names with units, for histories."""
        if self.mechanism_parameters is None or not self.label:
            return {}
        return {
            f"parameter {self.mechanism_parameters.labels[n]}": value
            for n, value in self.mechanism_parameters.values.items()
        }

    @property
    def is_simulated(self) -> bool:
        """Whether anything was simulated."""
        return any(case.trajectory is not None for case in self.load_cases.values())

    @property
    def trajectory(self) -> Trajectory:
        """The trajectory of the only load case.

        Raises:
            ValueError: If nothing was simulated, or there are several load cases.
        """
        self.check_simulated()
        trajectory = only_case(self.load_cases, "evaluation.alone({!r}).trajectory").trajectory
        assert trajectory is not None
        return trajectory

    def check_simulated(self) -> None:
        """Refuse an evaluation for which nothing was simulated."""
        if not self.is_simulated:
            raise ValueError(
                "there is no trajectory: nothing was simulated, because neither the objective nor "
                "the constraints of this problem depend on it"
            )

    def alone(self, load_case: str) -> Evaluation:
        """The evaluation of a single ``load_case``, by its name.

        It belongs to `Problem.alone`; pictures and reports of one load case take it. A ValueError
        is raised where there is no such name.
        """
        validation.choice("evaluation: load case", load_case, self.load_cases)
        case = self.load_cases[load_case]
        names = {f.name for f in fields(case)} & {f.name for f in fields(self)}
        values = {name: getattr(case, name) for name in names}
        return replace(self, **values, load_cases={load_case: case})


def only_case(cases: Mapping[str, T], instead: str) -> T:
    """The value for the only load case, or a ValueError that says what to ask ``instead``."""
    if len(cases) > 1:
        raise ValueError(
            f"there are {len(cases)} load cases, {list(cases)}: ask for one of them, for example "
            f"{instead.format(next(iter(cases)))}"
        )
    return next(iter(cases.values()))
