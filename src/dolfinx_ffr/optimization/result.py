# SPDX-License-Identifier: MIT
"""The result of a design loop: the design, its history, violated bounds, and its parts."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from shapely.geometry.base import BaseGeometry

from .. import validation
from ..arrays import Array
from ..boundary import Boundary, Surface
from ..design import Design, DimensionDesign, Variables
from ..documentation import Shown
from ..dynamics import SimulationError
from ..fem import Domain, Tetrahedra
from ..files import file_names
from ..lower_bound import LowerBound, bound
from ..part import Part, Solid, Verification, verify
from ..postprocessing import worst_stress
from ..problem import Evaluation, Problem
from .running import alone_in
from .trial_failed import TrialFailed

#: Size of the tetrahedra whose cut is the surface of a solid with bores, in widths of their rims
_RIM = 0.5
#: Largest number of these tetrahedra
_TETRAHEDRA = 250_000


class DesignWarning(UserWarning):
    """A run ignores an argument, or its result violates a constraint or makes no part."""


def warn(text: str, stacklevel: int = 4) -> None:
    """Warn of a run or its result, at the line that called `optimize`."""
    warnings.warn(text, DesignWarning, stacklevel=stacklevel + 1)


def gray_fraction(domain: Domain, x: Array, web: float = 0.0) -> float:
    """The share of a body's area whose density is between 0.1 and 0.9.

    Args:
        domain: The body.
        x: Densities of this rank's cells, shape (cells,), in [0, 1].
        web: Thickness of the web as a share of the part's; densities are then measured from it.
    """
    validation.instance("gray fraction: domain", domain, Domain, "a Domain")
    share = (domain.check_density(x) - web) / (1.0 - web)
    gray = (share > 0.1) & (share < 0.9)
    return domain.sum(domain.cell_volumes * gray) / domain.area


def drawn_of(boundary: Boundary | Surface) -> Part | Solid:
    """The part or solid that a boundary encloses."""
    return boundary.drawn if isinstance(boundary, Surface) else boundary.part


@dataclass(frozen=True, eq=False)
class BoundaryResult:
    """The result of moving the boundaries of parts.

    Attributes:
        boundaries: The best boundaries, by body.
        problem: The problem on meshes that fit these boundaries.
        evaluation: Its evaluation.
        history: By name, one number for each step taken: ``psi``, ``volume`` as a share of the
            bodies, ``narrowest`` member or gap [m], ``tightest`` radius [m], ``excess`` over a
            bound, ``step`` [m], ``cells``, ``modes``, the ``rejected`` trials, the struts and
            windows that were ``inserted`` before it and the struts and holes ``removed``. The last
            entry is the best trial on meshes that resolve notches and walls.
        reason: Why it ended: "iterations", "no better step", "interrupted", or "terminated" by
            SIGTERM.
        mode_errors: Estimated relative error of psi by the truncated normal modes of each body.
        materials: The material within the boundaries at each step of the history, as polygons
            [m], by body.
        violations: Violations of bounds and sizes by the parts, as of `Result`.
        begun: A function that evaluates the first boundaries on such meshes; its result has problem
            and evaluation.
    """

    boundaries: dict[str, Boundary | Surface]
    problem: Problem
    evaluation: Evaluation
    history: dict[str, Array]
    reason: str
    mode_errors: dict[str, float]
    materials: dict[str, list[BaseGeometry]]
    violations: dict[str, float]
    begun: Callable[[], Any] = field(repr=False)

    @property
    def psi(self) -> float:
        """Objective of the parts."""
        return self.evaluation.psi

    @property
    def volume(self) -> dict[str, float]:
        """Filled share of each body that is designed."""
        bodies, filled = self.problem.flexible, self.evaluation.volume
        return {
            n: filled[n] * bodies[n].domain.area / b.body.area for n, b in self.boundaries.items()
        }

    @property
    def boundary(self) -> Boundary | Surface:
        """The boundary of the only body that is designed."""
        boundary: Boundary | Surface = only(self.boundaries)
        return boundary

    def summary(self) -> dict[str, Any]:
        """The row of the result in the history, and why it ended, for `Result.summary`."""
        row = int(np.flatnonzero(self.history["psi"] == self.psi)[-1])
        final = {key: float(column[row]) for key, column in self.history.items()}
        return final | {
            "steps": int(np.count_nonzero(self.history["step"])),
            "reason": self.reason,
        }

    def part(self, name: str | None = None) -> Part | Solid:
        """The part or solid of the body ``name``, by default of the only one."""
        boundary = self.boundary if name is None else self.boundaries[name]
        return drawn_of(boundary)


@dataclass(frozen=True, repr=False)
class Result(Shown):
    """The result of a run: the design, its evaluation and its history.

    Attributes:
        densities: Densities of this rank's cells by body, shape (cells,).
        variables: Variables by body, the same on every rank, shape (size of the design,).
        evaluation: Evaluation of `densities` by `problem`.
        history: Columns over the iterations.
        reason: Why the loop ended: "converged" (the first-order conditions hold to the optimizer's
            tolerance), "iterations" (none were left), "interrupted", "stalled" (no step lowers psi
            without falling apart, though the conditions do not hold), or "infeasible" (no design
            satisfies all constraints and makes a part).
        designs: Designs by body, with the sharpness of the end: `Design.density` of the variables
            is the density.
        problem: The problem that evaluates the design, for a sharp level set with the law of cut
            elements.
        violations: Violations relative to the bounds, by name of the constraint ("volume of rod"
            for a volume). After steps of the boundary they belong to the parts; else the share of
            material in "loose pieces of rod", which is in psi and not in the part, and 1 for the
            "part of rod" if the design makes no part. Sizes of parts below the minimum are among
            them ("rod: thinnest member near (20, 3) mm"), struts that end free, and violations
            that `verify` and `finish` find later.
        mode_errors: Estimated relative error of psi by the normal modes that each body leaves out;
            empty where it was not asked for, NaN where it cannot be estimated.
        bounds: Upper bounds of the filled shares by body, the argument of `optimize`.
        terminated: Whether SIGTERM, as of a batch system, arrived during the run: `finish` then
            makes no parts.
        residual: Upper bound of the fall of log psi and the penalty, to first order and within the
            constraints, by one step of the largest length, at the last gradient of the loop: zero
            if the first-order conditions hold; NaN if the optimizer does not compute it.
        moved: The result of moving the boundaries of the parts, None if they were not moved.
    """

    densities: dict[str, Array]
    variables: dict[str, Array]
    evaluation: Evaluation = field(repr=False)
    history: dict[str, Array] = field(repr=False)
    reason: str
    designs: dict[str, Variables] = field(repr=False)
    problem: Problem = field(repr=False)
    violations: dict[str, float] = field(default_factory=dict)
    mode_errors: dict[str, float] = field(default_factory=dict)
    bounds: dict[str, float] = field(default_factory=dict)
    terminated: bool = False
    residual: float = math.nan
    moved: BoundaryResult | None = field(default=None, repr=False)
    _parts: dict[str, Part | Solid] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        """Copy the violations, as a verification adds to them."""
        object.__setattr__(self, "violations", dict(self.violations))

    @property
    def feasible(self) -> bool:
        """Whether the design satisfies all constraints, and its parts all bounds and sizes."""
        return not self.violations

    def _shown(self) -> list[tuple[str, str, str]]:
        summary = self.summary()
        trajectories = [case.trajectory for case in self.final[1].load_cases.values()]
        tolerances = [t.integrator.chosen_for or 0.0 for t in trajectories if t]
        errors = {
            "modes left out": summary["mode_error"],
            "time steps": max(tolerances, default=0.0),
        }
        error = ", ".join(f"{share:.1e} by {cause}" for cause, share in errors.items() if share)
        sized = self._sized.keys()
        psi_is_of_parts = self.moved or summary["volume"].keys() <= sized
        psi_label = f"psi of the {'parts' if psi_is_of_parts else 'densities'}"
        rows = [(psi_label, f"{self.psi:.6g}", error)]
        for name, share in summary["volume"].items():
            bound = f"at most {self.bounds[name]:.1%}" if name in self.bounds else ""
            if name not in sized:
                rows.append((f"volume of {name}", f"{share:.1%}", bound))
        for name, value in self.parameters.items():
            rows.append((f"parameter {name}", f"{value:.6g}", ""))
        for body, sizes in self.dimensions.items():
            rows += [(f"{name} of {body}", f"{1e3 * v:.5g} mm", "") for name, v in sizes.items()]
        rows += [
            (name, f"{share:.2%}", "beyond its bound") for name, share in self.violations.items()
        ]
        steps = f", {summary['boundary']['steps']} steps of the boundary" if self.moved else ""
        return [*rows, ("iterations", f"{self.iterations}{steps}", f"end: {self.reason}")]

    def summary(self) -> dict[str, Any]:
        """The numbers of the result and the end of the run, for `write_summary`."""
        final = self.moved or self
        errors = [error for error in final.mode_errors.values() if not np.isnan(error)]
        return {
            "psi": self.psi,
            "reason": self.reason,
            "residual": None if math.isnan(self.residual) else self.residual,
            "iterations": self.iterations,
            "feasible": self.feasible,
            "violations": self.violations,
            "volume": (self.moved or self.evaluation).volume,
            "gray": float(self.history["gray"][-1]),
            "modes": {name: body.modes for name, body in final.problem.flexible.items()},
            "mode_error": max(errors, default=None),
            **({"dimensions": self.dimensions} if self._sized else {}),
            **({"parameters": self._reported_parameters()} if self.parameters else {}),
            **({"at_bounds": self.at_bounds} if self._sized or self.parameters else {}),
        } | ({"boundary": self.moved.summary()} if self.moved else {})

    @property
    def dimensions(self) -> dict[str, dict[str, float]]:
        """Dimensions by body and name, of a `DimensionDesign`."""
        return {n: d.named(self.variables[n]) for n, d in self._sized.items()}

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the mechanism's parameters by name, where they were designed."""
        parameters = self.evaluation.mechanism_parameters
        return parameters.values if parameters is not None and self.evaluation.label else {}

    def _reported_parameters(self) -> dict[str, dict[str, Any]]:
        """The parameters with their starts, bounds and units."""
        parameters = self.evaluation.mechanism_parameters
        assert parameters is not None
        columns = zip(parameters.entries.items(), self.evaluation.labelled_values, strict=True)
        return {
            name: {"start": float(self.history[column][0]), **entry._asdict()}
            for (name, entry), column in columns
        }

    @property
    def at_bounds(self) -> dict[str, dict[str, str]]:
        """Dimensions by body, and parameters, that are at a bound: "lower" or "upper"."""
        at_bounds = {n: d.at_bounds(self.variables[n]) for n, d in self._sized.items()}
        if self.parameters and self.evaluation.mechanism_parameters is not None:
            at_bounds[self.evaluation.label] = self.evaluation.mechanism_parameters.at_bounds
        return at_bounds

    @property
    def _sized(self) -> dict[str, DimensionDesign]:
        return {n: d for n, d in self.designs.items() if isinstance(d, DimensionDesign)}

    @property
    def x(self) -> Array:
        """Density of this rank's cells, shape (cells,), where one body is designed."""
        return only(self.densities)

    @property
    def coefficients(self) -> Array:
        """Coefficients of the level set, shape (knots,), where one body is designed."""
        return only(self.variables)

    def part(self, name: str | None = None) -> Part | Solid:
        """The part that a designed body encloses, of the body's material.

        It is a `Part` of a body in the plane, a `Solid` of one in space; `Enclosed` describes both.
        It is made once, as it takes seconds; if its boundary was `moved`, it is the part within
        this boundary. The ``name`` of the body is by default the only one. It raises and warns
        as `Part` and `Solid` do; a ValueError is raised if no body of this name was designed, or
        if several are and none is named.
        """
        designs = self._designs_of_parts
        if name is None:
            name = only({body: body for body in designs})
        validation.choice("result: part", name, designs)
        if self.moved is not None and name in self.moved.boundaries:
            return self.moved.part(name)
        if name not in self._parts:
            self._parts[name] = self.enclosed(name)
        return self._parts[name]

    def enclosed(self, name: str, **options: Any) -> Part | Solid:
        """The part that the design of the body ``name`` encloses on its elements.

        The ``options`` are arguments of `Part`. Each call makes a new part.
        """
        design, body = self.designs[name], self.problem.flexible[name]
        kind: type[Part] | type[Solid] = Solid if body.domain.dimension == 3 else Part
        if isinstance(design, Design):
            if kind is Solid and design.hole_rim and body.domain.holes:
                # cells as large as a rim would cut into it
                fine = Tetrahedra.finest(body.domain, _RIM * design.hole_rim, _TETRAHEDRA)
                options = {"surface": fine, **options}
            return kind.of(design, self.variables[name], material=body.material, **options)
        assert isinstance(design, DimensionDesign)
        whole = kind(body.domain, lambda x: np.ones(len(x)), material=body.material, **options)
        drawing = design.drawing(self.variables[name])
        if isinstance(whole, Part) and drawing is not None:
            return whole.redrawn(drawing)
        return whole

    def verify(self, **options: Any) -> Verification:
        """Evaluate the problem on meshes that fit the parts of all designed bodies.

        The ``options`` are arguments of `verify`; ``volume`` is by default the bound of the run. It
        raises and warns as `part` and `verify` do. Bounds that the parts exceed are added to
        `violations`, so that the result is not `feasible`.
        """
        validation.keywords("result.verify", options, verify)
        parts = {name: self.part(name) for name in self._designs_of_parts}
        problem, evaluation = self.final
        verification = verify(problem, parts, evaluation, **{"volume": self.bounds, **options})
        self.violations.update(verification.violations)
        return verification

    def finish(self, folder: str | Path, **options: Any) -> Verification | None:
        """Write the parts of all designed bodies for CAD, draw them, and evaluate them.

        Args:
            folder: For ``part.svg``, ``.dxf``, ``.step``, ``.stl`` and ``.png``, in space
                ``solid.stl`` and ``solid.png``, and if the boundary was moved ``boundary.gif``,
                ``stress_before.png`` and ``stress.png``. Several bodies have folders with their
                names in it.
            options: Those of `verify`.

        Returns:
            The verification; None if the design encloses no part that can be moved, or the run was
            `terminated`, when nothing is computed or written.

        Raises:
            OSError: If a file cannot be written; before anything is computed, if the folder is a
                file or another program writes there.

        Warns:
            DesignWarning: Where there is no verification, with the reason.
            PartWarning: As `verify`, of every bound that the parts exceed.
        """
        path = validation.path("finish: folder", folder)
        validation.keywords("result.finish", options, verify)
        if self.terminated:
            warn(
                "finish: no part is made, because SIGTERM has interrupted the run: continue it "
                "with optimize(..., resume=True)",
                2,
            )
            return None
        from ..plotting import animate_boundary, plot_part  # takes a while

        with alone_in(ranks_of(self.problem), path, "finish: folder"):
            names = file_names(self._designs_of_parts)
            folders = {n: path / file if len(names) > 1 else path for n, file in names.items()}
            # moved parts are written first, as a verification may take long or too much memory
            moved_bodies = self.moved.boundaries if self.moved else ()
            for name in moved_bodies:
                self.part(name).write(folders[name])
            verification = None
            try:
                verification = self.verify(**options)
            except (ValueError, SimulationError) as error:
                deny(self, self._designs_of_parts, error, 2)
            folders_of_moved = dict[str, Path]()
            for name, body_folder in folders.items():
                is_moved = name in moved_bodies
                part = self.part(name) if is_moved else self._parts.get(name)
                # a solid is drawn without a verification, too
                if part is None or (verification is None and not isinstance(part, Solid)):
                    continue
                title = name
                if verification is not None:
                    ratio = 1.0 + verification.difference
                    title += f": psi of the {part.kind} is {ratio:.3f} of psi of the design"
                if not is_moved:
                    part.write(body_folder)
                plot_part(part, body_folder / f"{part.kind}.png", title=title)
                if self.moved is not None and name in self.moved.materials:
                    folders_of_moved[name] = body_folder
                    steps = self.moved.materials[name], self.moved.history["psi"]
                    animate_boundary(part.body, *steps, body_folder / "boundary.gif")
            self._draw_stress(folders_of_moved)
        return verification

    def _draw_stress(self, folders: Mapping[str, Path]) -> None:
        """Draw the stress of parts before and after the steps of their boundaries."""
        if self.moved is None or not folders:
            return
        from ..plotting import plot_stress

        try:
            for trial, time, file in (
                (self.moved.begun(), "before", "stress_before.png"),
                (self.moved, "after", "stress.png"),
            ):
                for name, folder in folders.items():
                    body, title = trial.problem.flexible[name], f"{name} {time} boundary steps"
                    worst = worst_stress(body, trial.evaluation, name)
                    plot_stress(body.domain, worst, folder / file, title=title)
        except (TrialFailed, ValueError, SimulationError) as error:
            warn(f"finish: the stress is not drawn ({error})", 3)

    @property
    def _designs_of_parts(self) -> dict[str, Variables]:
        kinds = (Design, DimensionDesign)
        return {name: design for name, design in self.designs.items() if isinstance(design, kinds)}

    @cached_property
    def lower_bound(self) -> LowerBound:
        """A number below psi of every part, see `bound`; the first call takes some seconds.

        It holds for the bounds of the volume of the run. A ValueError says why there is none.
        """
        for name, design in self.designs.items():
            if not isinstance(design, Design):
                raise ValueError(
                    f"bound: the outline of {name!r} is designed itself, by dimensions; there is a "
                    "bound for all parts within one outline"
                )
        return bound(self.problem, volume=self.bounds)

    @property
    def gap(self) -> float:
        """Largest share by which psi may be above that of the best part, see `lower_bound`."""
        return self.lower_bound.gap(self.psi)

    @property
    def final(self) -> tuple[Problem, Evaluation]:
        """The problem and the evaluation of moved parts, or else of the densities."""
        return (self.moved or self).problem, (self.moved or self).evaluation

    @property
    def psi(self) -> float:
        """Objective of the parts whose boundaries were moved, else of the densities."""
        return self.final[1].psi

    @property
    def iterations(self) -> int:
        """Number of steps tried."""
        return int(self.history["iteration"][-1])


def deny(result: Result, names: Collection[str], error: Exception, stacklevel: int) -> None:
    """Warn that the designs of some bodies make no part, which is a violation of each."""
    result.violations.update({f"part of {name}": 1.0 for name in names})
    warn(
        f"no part can be made of the design of {', '.join(map(repr, names))}, which is therefore "
        f"not feasible: {error}; take smaller elements, more volume, another start, or an "
        "objective that loads the interfaces, which the frequency of a free body does not",
        stacklevel + 1,
    )


def ranks_of(problem: Problem) -> MPI.Comm:
    """The ranks that evaluate a problem, which may be a user's own."""
    bodies = problem.flexible.values()
    return next((body.domain.comm for body in bodies), None) or problem.comm


def only(by_name: Mapping[str, Any]) -> Any:
    """The value for the only body, or a ValueError."""
    if len(by_name) > 1:
        raise ValueError(
            f"several bodies are designed ({sorted(by_name)}): ask by name, for example "
            f"result.densities[{next(iter(by_name))!r}]"
        )
    return next(iter(by_name.values()))


def of_problem(densities: Mapping[str, Array]) -> Any:
    """The argument of `Problem.value`: values by name, or the value of the only body."""
    return dict(densities) if len(densities) > 1 else only(densities)
