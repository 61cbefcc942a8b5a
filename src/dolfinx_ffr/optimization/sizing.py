# SPDX-License-Identifier: MIT
"""Bodies by named dimensions, as a problem whose variables are these, and densities of others.

Each design has a mesh of its own, and the exact gradient of what was computed there. A design that
has no valid geometry is one that cannot be simulated, so the optimiser takes its step back.
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
    """An evaluation on meshes of the dimensions."""

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
        """The same with other bodies whose densities are designed."""
        return Sizing(self._problem.with_bodies(bodies), self._designs)

    def value(self, x: Array | Mapping[str, Array]) -> SizedEvaluation:
        """Objective and constraints at variables and densities; SimulationError: no geometry."""
        given = x if isinstance(x, Mapping) else dict.fromkeys(self._designs, x)
        bodies, motions = {}, {}
        try:  # also what its gradient takes: a design that is kept has one
            with shaping():
                for name, design in self._designs.items():
                    domain = design.domain(self.comm, given[name])
                    bodies[name] = body = self._problem.flexible[name].with_domain(domain)
                    motions[name] = design.motion(domain, given[name], body.marker_nodes)
                problem = self._problem.with_bodies(bodies)
            with simulating():
                evaluated = problem.value(of_problem({**given, **_full(bodies)}))
        except TrialFailed as failed:
            error = failed.__cause__
            if self._begun and len(bodies) < len(self._designs):
                warn(f"optimize: a step is taken back, as its body cannot be made: {error}")
            raise SimulationError(str(error), getattr(error, "trajectory", None)) from error  # type: ignore[arg-type]
        self._begun = True
        dimensions = {
            f"{name}: {key}": number
            for name, design in self._designs.items()
            for key, number in design.named(given[name]).items()
        }
        own_fields: dict[str, Any] = {
            "problem": problem,
            "motions": motions,
            "dimensions": dimensions,
        }
        return SizedEvaluation(**_parts(evaluated), **own_fields)

    def differentiate(self, evaluation: SizedEvaluation) -> SizedEvaluation:
        """The evaluation with gradients by the variables in the place of those by densities."""
        assert evaluation.problem is not None
        differentiated = evaluation.problem.differentiate(evaluation, nodes=True)
        motions = evaluation.motions.items()

        def along(part: Any) -> Any:
            """The same with its gradient by the variables."""
            if part.nodes is None:
                return part
            slopes = {n: m.pullback(part.nodes[n], part.centers[n]) for n, m in motions}
            others = part.gradient if isinstance(part.gradient, Mapping) else {}
            return replace(part, gradient={**others, **slopes})

        cases = {n: along(case) for n, case in differentiated.load_cases.items()}
        bounds = {n: along(bound) for n, bound in differentiated.constraints.items()}
        return along(replace(differentiated, constraints=bounds, load_cases=cases))

    def calibrated(self, evaluation: SizedEvaluation) -> tuple[Sizing, SizedEvaluation]:
        """As `Problem.calibrated`, for this and all later designs."""
        return self.adapted(evaluation, MechanicalProblem.calibrated_at)

    def adapted(
        self, evaluation: SizedEvaluation, changed: Change
    ) -> tuple[Sizing, SizedEvaluation]:
        """As `Problem.adapted`, for this and all later designs."""
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
        problem, final = evaluation.problem, Evaluation(**_parts(evaluation))
        x = {**result.variables, **result.densities, **self.full(problem)}
        if final.mechanism_parameters is not None and final.label:
            x[final.label] = final.mechanism_parameters.array
        errors: dict[str, float] = {}
        if tolerance is not None:
            first = {name: body.modes for name, body in problem.flexible.items()}
            problem, final, errors = with_enough_modes(problem, x, final, tolerance, first)
        problem, final = with_steps_for(problem, x, final)
        return replace(result, problem=problem, evaluation=final, mode_errors=errors)


def _full(bodies: Mapping[str, FlexibleBody]) -> dict[str, Array]:
    """Full bodies, (cells,) each."""
    return {name: 1.0 - body.domain.void_cells for name, body in bodies.items()}


def _parts(evaluation: Evaluation) -> dict[str, Any]:
    """What an evaluation consists of."""
    return {part.name: getattr(evaluation, part.name) for part in fields(Evaluation)}


def sized(
    problem: Problem, design: Variables | Mapping[str, Variables]
) -> tuple[Sizing, dict[str, Variables]] | None:
    """The problem of dimensions, and all designs by name; None if there are no dimensions."""
    names = list(problem.flexible)
    by_name = design if isinstance(design, Mapping) else dict.fromkeys(names[:1], design)
    dimensioned = {n: part for n, part in by_name.items() if isinstance(part, DimensionDesign)}
    if not dimensioned:
        return None
    if not dimensioned.keys() <= set(names) <= by_name.keys():
        raise ValueError(
            f"optimize: dimensions are given for {sorted(dimensioned)}, and the problem designs "
            f"{sorted(names)}; give dimensions or densities of each, or some bodies by their "
            "volume integrals"
        )
    return Sizing(problem, dimensioned), {name: by_name[name] for name in [*names, *by_name]}
