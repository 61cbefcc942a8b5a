# SPDX-License-Identifier: MIT
"""A problem whose variables are named dimensions of some bodies, and densities of others.

Each design has a mesh of its own, and the exact gradient on this mesh. A design without a valid
geometry cannot be simulated, so the optimiser rejects its step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from mpi4py import MPI

from ..arrays import Array
from ..design import DimensionDesign, DimensionMotion, Variables
from ..dynamics import SimulationError
from ..mechanical_problem import MechanicalProblem
from ..problem import Change, Evaluation, Problem, lengths_of_placements
from ..reduction import FlexibleBody
from .enough_modes import with_enough_modes, with_steps_for
from .result import Result, of_problem, warn
from .trial_failed import TrialFailed, shaping, simulating


@dataclass(frozen=True)
class SizedEvaluation(Evaluation):
    """An evaluation on meshes that follow the dimensions."""

    problem: Problem | None = field(default=None, repr=False)  #: On these meshes
    motions: dict[str, DimensionMotion] = field(default_factory=dict, repr=False)  #: By body
    dimensions: dict[str, float] = field(default_factory=dict)  #: By "body: name"

    @property
    def labelled_values(self) -> dict[str, float]:
        return self.dimensions | super().labelled_values


class Sizing:
    """A `problem` with ``designs`` of some of its flexible bodies, for `DesignLoop`."""

    def __init__(self, problem: Problem, designs: Mapping[str, DimensionDesign]) -> None:
        self._problem, self._designs = problem, dict(designs)
        self.comm: MPI.Comm = problem.comm
        #: Bodies whose densities are designed
        self.flexible = {n: body for n, body in problem.flexible.items() if n not in designs}
        self.load_cases, self.combine = problem.load_cases, problem.combine
        self._begun = False
        mechanisms = [case.mechanism for case in self.load_cases.values()]
        for label, body, _ in lengths_of_placements(mechanisms):
            if body in designs:
                raise ValueError(
                    f"optimize: {label!r} takes its length from the placements, where bearings may "
                    "move: give its length"
                )

    def with_bodies(self, bodies: Mapping[str, Any]) -> Sizing:
        """The same problem with other bodies whose densities are designed."""
        return Sizing(self._problem.with_bodies(bodies), self._designs)

    def value(self, x: Array | Mapping[str, Array]) -> SizedEvaluation:
        """Objective and constraints at variables and densities ``x``.

        A SimulationError is raised if there is no geometry with these dimensions.
        """
        by_name = x if isinstance(x, Mapping) else dict.fromkeys(self._designs, x)
        bodies, motions = {}, {}
        try:  # motions are computed here, too, so that an accepted design has a gradient
            with shaping():
                for name, design in self._designs.items():
                    domain = design.domain(self.comm, by_name[name])
                    bodies[name] = body = self._problem.flexible[name].with_domain(domain)
                    motions[name] = design.motion(domain, by_name[name], body.marker_nodes)
                problem = self._problem.with_bodies(bodies)
            with simulating():
                evaluated = problem.value(of_problem({**by_name, **_full(bodies)}))
        except TrialFailed as failed:
            error = failed.__cause__
            if self._begun and len(bodies) < len(self._designs):
                warn(f"optimize: a step is rejected, because its body cannot be made: {error}")
            raise SimulationError(str(error), getattr(error, "trajectory", None)) from error  # type: ignore[arg-type]
        self._begun = True
        dimensions = {
            f"{name}: {key}": number
            for name, design in self._designs.items()
            for key, number in design.named(by_name[name]).items()
        }
        own_fields: dict[str, Any] = {
            "problem": problem,
            "motions": motions,
            "dimensions": dimensions,
        }
        return SizedEvaluation(**_fields(evaluated), **own_fields)

    def differentiate(self, evaluation: SizedEvaluation) -> SizedEvaluation:
        """The evaluation with gradients by the variables instead of densities."""
        assert evaluation.problem is not None
        differentiated = evaluation.problem.differentiate(evaluation, nodes=True)
        motions = evaluation.motions.items()

        def by_variables(evaluated: Any) -> Any:
            """Values with their gradient by the variables."""
            if evaluated.nodes is None:
                return evaluated
            slopes = {n: m.pullback(evaluated.nodes[n], evaluated.centers[n]) for n, m in motions}
            by_density = evaluated.gradient if isinstance(evaluated.gradient, Mapping) else {}
            return replace(evaluated, gradient={**by_density, **slopes})

        cases = {n: by_variables(case) for n, case in differentiated.load_cases.items()}
        bounds = {n: by_variables(bound) for n, bound in differentiated.constraints.items()}
        return by_variables(replace(differentiated, constraints=bounds, load_cases=cases))

    def calibrated(self, evaluation: SizedEvaluation) -> tuple[Sizing, SizedEvaluation]:
        """Calibrate as `Problem.calibrated`, for this and all later designs."""
        return self.adapted(evaluation, MechanicalProblem.calibrated_at)

    def adapted(
        self, evaluation: SizedEvaluation, changed: Change
    ) -> tuple[Sizing, SizedEvaluation]:
        """Adapt as `Problem.adapted`, for this and all later designs."""
        earlier = evaluation.problem
        assert earlier is not None
        problem, adapted_evaluation = earlier.adapted(evaluation, changed)
        if problem is earlier:
            return self, evaluation
        sizing = Sizing(problem, self._designs)
        return sizing, replace(adapted_evaluation, problem=problem)  # type: ignore[return-value, call-arg]

    def full(self, problem: Problem) -> dict[str, Array]:
        """Densities of the bodies by dimensions, on the meshes of a ``problem``, (cells,) each."""
        return _full({name: problem.flexible[name] for name in self._designs})

    def finished(self, result: Result, tolerance: float | None) -> Result:
        """The result of a run with its problem on the last meshes, with as many modes as needed."""
        evaluation = result.evaluation
        assert isinstance(evaluation, SizedEvaluation) and evaluation.problem is not None
        problem, final = evaluation.problem, Evaluation(**_fields(evaluation))
        x = {**result.variables, **result.densities, **self.full(problem)}
        if final.mechanism_parameters is not None and final.label:
            x[final.label] = final.mechanism_parameters.array
        errors: dict[str, float] = {}
        if tolerance is not None:
            first_modes = {name: body.modes for name, body in problem.flexible.items()}
            problem, final, errors = with_enough_modes(problem, x, final, tolerance, first_modes)
        problem, final = with_steps_for(problem, x, final)
        return replace(result, problem=problem, evaluation=final, mode_errors=errors)


def _full(bodies: Mapping[str, FlexibleBody]) -> dict[str, Array]:
    """Densities of full bodies, shape (cells,) each."""
    return {name: 1.0 - body.domain.void_cells for name, body in bodies.items()}


def _fields(evaluation: Evaluation) -> dict[str, Any]:
    """The fields of an evaluation by name."""
    return {entry.name: getattr(evaluation, entry.name) for entry in fields(Evaluation)}


def sized(
    problem: Problem, design: Variables | Mapping[str, Variables]
) -> tuple[Sizing, dict[str, Variables]] | None:
    """The problem of dimensions, and all designs by name; None if there are no dimensions."""
    names = list(problem.flexible)
    by_name = design if isinstance(design, Mapping) else dict.fromkeys(names[:1], design)
    dimensioned = {n: entry for n, entry in by_name.items() if isinstance(entry, DimensionDesign)}
    if not dimensioned:
        return None
    if not dimensioned.keys() <= set(names) <= by_name.keys():
        raise ValueError(
            f"optimize: dimensions are given for {sorted(dimensioned)}, and the problem designs "
            f"{sorted(names)}; give dimensions or densities of each, or some bodies by their "
            "volume integrals"
        )
    return Sizing(problem, dimensioned), {name: by_name[name] for name in [*names, *by_name]}
