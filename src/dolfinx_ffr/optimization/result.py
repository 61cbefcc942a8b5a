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

#: Size of the tetrahedra whose cut is the surface of a solid with bores, in widths of their rims,
#: and the most of them
_RIM, _TETRAHEDRA = 0.5, 250_000


class DesignWarning(UserWarning):
    """A run that began otherwise than it was asked to, or a result that is not what was wanted."""


def warn(text: str, stacklevel: int = 4) -> None:
    """Warn of a run or its result, at the line that called `optimize`."""
    warnings.warn(text, DesignWarning, stacklevel=stacklevel + 1)


def gray_fraction(domain: Domain, x: Array, web: float = 0.0) -> float:
    """The share of a body's area whose density is between 0.1 and 0.9.

    The densities ``x`` are those of this rank's cells of the ``domain``, shape (cells,). Where a
    ``web`` stays, 0 and 1 stand for its thickness and the full one. A ValueError if densities have
    the wrong size, are NaN or leave [0, 1].
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
    """What moving boundaries has come to.

    Attributes:
        boundaries: The best ones, by body.
        problem: On the meshes that fit them.
        evaluation: There.
        history: By name, one number for each step taken: ``psi``, ``volume`` as a share of the
            bodies, ``narrowest`` member or gap [m], ``tightest`` radius [m], ``excess`` over a
            bound, ``step`` [m], ``cells``, ``modes``, the ``rejected`` trials, the struts and
            windows that were ``inserted`` before it and the struts and holes ``removed``; at last
            those of the best on meshes that resolve notches and walls.
        reason: Why it ended: "iterations", "no better step", "interrupted", or "terminated" by
            SIGTERM.
        mode_errors: Estimated relative error of psi by the normal modes that each body leaves out.
        materials: What the boundaries enclose at each step of the history, as polygons [m], by
            body.
        violations: As those of `Result`, of the parts.
        begun: Evaluates the boundaries that it began with, on such meshes; has problem and
            evaluation.
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
        """Of the parts."""
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
        """Where one body is designed, its boundary."""
        found: Boundary | Surface = only(self.boundaries)
        return found

    def summary(self) -> dict[str, Any]:
        """The row of the history that the result is, and how it ended, for `Result.summary`."""
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
    """A design and its history.

    Attributes:
        densities: Of this rank's cells by body, shape (cells,).
        variables: By body, the same on every rank, shape (size of the design,).
        evaluation: psi and trajectory of `densities`, by `problem`.
        history: Columns over the iterations.
        reason: Why the loop ended: "converged" (the first-order conditions hold to the optimizer's
            tolerance), "iterations" (none were left), "interrupted", "stalled" (no step lowers psi
            any more, or only by falling apart, though the conditions do not hold), or "infeasible"
            (without a design that fulfils all constraints, and of which a part comes).
        designs: By body, as sharp as at the end: its `Design.density` of the variables is the
            density.
        problem: The problem that evaluates the design: for a sharp level set with the law of cut
            elements.
        violations: Violations relative to the bounds, by name of the constraint ("volume of rod"
            for a volume); those of the parts, where boundaries were moved, and else the share of
            material in "loose pieces of rod", which psi counts and the part has not, and 1 for the
            "part of rod" where none comes of the design. Sizes of parts below the minimum are among
            them ("rod: thinnest member near (20, 3) mm"), struts that end free, and what `verify`
            and `finish` have found since.
        mode_errors: Estimated relative error of psi by the normal modes that each body leaves out;
            empty where it was not asked for, NaN where it cannot be estimated.
        bounds: Upper bounds of the filled shares by body, as `optimize` was given them.
        terminated: Whether SIGTERM, as of a batch system, arrived during the run: `finish` then
            makes no parts.
        residual: By how much, to first order, log psi and the penalty could still fall within the
            constraints by one step of the largest length, when the last gradient of the loop was
            computed: zero where the first-order conditions hold; NaN where the optimizer does not
            tell.
        moved: What moving the boundaries of the parts has come to, None where they were not moved.
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
        """Give each result violations of its own, as a verification adds to them."""
        object.__setattr__(self, "violations", dict(self.violations))

    @property
    def feasible(self) -> bool:
        """Whether the design fulfils all constraints, and its parts all bounds and sizes."""
        return not self.violations

    def _shown(self) -> list[tuple[str, str, str]]:
        told = self.summary()
        cases = self.final[1].load_cases.values()
        asked = [case.trajectory.integrator.chosen_for or 0.0 for case in cases if case.trajectory]
        errors = {"modes left out": told["mode_error"], "time steps": max(asked, default=0.0)}
        error = ", ".join(f"{share:.1e} by {why}" for why, share in errors.items() if share)
        sized = self._sized.keys()
        of = "of the parts" if self.moved or told["volume"].keys() <= sized else "of the densities"
        rows = [(f"psi {of}", f"{self.psi:.6g}", error)]
        for name, share in told["volume"].items():
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
        moved = f", {told['boundary']['steps']} steps of the boundary" if self.moved else ""
        return [*rows, ("iterations", f"{self.iterations}{moved}", f"end: {self.reason}")]

    def summary(self) -> dict[str, Any]:
        """How the run ended, for `write_summary`."""
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
            **({"parameters": self._told_parameters()} if self.parameters else {}),
            **({"at_bounds": self.at_bounds} if self._sized or self.parameters else {}),
        } | ({"boundary": self.moved.summary()} if self.moved else {})

    @property
    def dimensions(self) -> dict[str, dict[str, float]]:
        """Dimensions by body and name, of a `DimensionDesign`."""
        return {n: d.named(self.variables[n]) for n, d in self._sized.items()}

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the mechanism's parameters by name, where they were designed."""
        at = self.evaluation.mechanism_parameters
        return at.values if at is not None and self.evaluation.label else {}

    def _told_parameters(self) -> dict[str, dict[str, Any]]:
        """The parameters with their starts, bounds and units."""
        at, history, found = self.evaluation.mechanism_parameters, self.history, {}
        assert at is not None
        for (name, entry), key in zip(
            at.entries.items(), self.evaluation.labelled_values, strict=True
        ):
            found[name] = {"start": float(history[key][0]), **entry._asdict()}
        return found

    @property
    def at_bounds(self) -> dict[str, dict[str, str]]:
        """Dimensions by body, and parameters, that stand at a bound: "lower" or "upper"."""
        found = {n: d.at_bounds(self.variables[n]) for n, d in self._sized.items()}
        if self.parameters and self.evaluation.mechanism_parameters is not None:
            found[self.evaluation.label] = self.evaluation.mechanism_parameters.at_bounds
        return found

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

        A `Part` of a body in the plane, a `Solid` of one in space; `Enclosed` describes both. It is
        made once and kept, as it takes seconds; where its boundary was `moved`, it is that of this
        boundary. The ``name`` is that of the body, by default the only one. Errors and warnings are
        those of `Part` and `Solid`; a ValueError if no body of this name was designed, or several
        are and none is named.
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
        """What the design of the body ``name`` encloses on its elements.

        The ``options`` are those of `Part`; it is made anew each time.
        """
        design, body = self.designs[name], self.problem.flexible[name]
        kind: type[Part] | type[Solid] = Solid if body.domain.dimension == 3 else Part
        if isinstance(design, Design):
            if kind is Solid and design.hole_rim and body.domain.holes:
                # cells as large as a rim would cut into it
                fine = Tetrahedra.finest(body.domain, _RIM * design.hole_rim, _TETRAHEDRA)
                options = {"surface": fine, **options}
            return kind.of(design, self.variables[name], material=body.material, **options)
        # all of the body
        assert isinstance(design, DimensionDesign)
        found = kind(body.domain, lambda x: np.ones(len(x)), material=body.material, **options)
        drawing = design.drawing(self.variables[name])
        if isinstance(found, Part) and drawing is not None:
            found = found.redrawn(drawing)
        return found

    def verify(self, **options: Any) -> Verification:
        """Evaluate the problem with all designed bodies as parts that fit.

        The ``options`` are those of `verify`; its ``volume`` is that of the run by default. Errors
        and warnings are those of `part` and `verify`. Bounds that the parts exceed are `violations`
        from then on, and the result is not `feasible`.
        """
        validation.keywords("result.verify", options, verify)
        parts = {name: self.part(name) for name in self._designs_of_parts}
        problem, evaluation = self.final
        found = verify(problem, parts, evaluation, **{"volume": self.bounds, **options})
        self.violations.update(found.violations)
        return found

    def finish(self, folder: str | Path, **options: Any) -> Verification | None:
        """Write the parts of all designed bodies for CAD, draw them, and evaluate them.

        Args:
            folder: For ``part.svg``, ``.dxf``, ``.step``, ``.stl`` and ``.png``, in space
                ``solid.stl`` and ``solid.png``, and where the boundary was moved ``boundary.gif``,
                ``stress_before.png`` and ``stress.png``; of several bodies for folders with their
                names.
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
        place = validation.path("finish: folder", folder)
        validation.keywords("result.finish", options, verify)
        if self.terminated:
            warn(
                "finish: no part is made of this design, as SIGTERM has ended its run: go on with "
                "optimize(..., resume=True)",
                2,
            )
            return None
        from ..plotting import animate_boundary, plot_part  # takes a while

        with alone_in(ranks_of(self.problem), place, "finish: folder"):
            found, names = None, file_names(self._designs_of_parts)
            folders = {n: place / own if len(names) > 1 else place for n, own in names.items()}
            for name in self.moved.boundaries if self.moved else ():
                # first, as a verification may take long, or more memory than there is
                self.part(name).write(folders[name])
            try:
                found = self.verify(**options)
            except (ValueError, SimulationError) as error:
                deny(self, self._designs_of_parts, error, 2)
            moved = dict[str, Path]()
            for name, at in folders.items():
                part, title = self._parts.get(name), name
                if written := self.moved is not None and name in self.moved.boundaries:
                    part = self.moved.part(name)
                # the surface of a solid is worth a look in any case
                if part is None or (found is None and not isinstance(part, Solid)):
                    continue
                if found is not None:
                    ratio = 1.0 + found.difference
                    title += f": psi of the {part.kind} is {ratio:.3f} of that of the design"
                if not written:
                    part.write(at)
                plot_part(part, at / f"{part.kind}.png", title=title)
                if self.moved is not None and name in self.moved.materials:
                    moved[name] = at
                    steps = self.moved.materials[name], self.moved.history["psi"]
                    animate_boundary(part.body, *steps, at / "boundary.gif")
            self._draw_stress(moved)
        return found

    def _draw_stress(self, folders: Mapping[str, Path]) -> None:
        """Draw the stress of parts before and after the steps of their boundaries."""
        if self.moved is None or not folders:
            return
        from ..plotting import plot_stress

        try:
            for told, when, file in (
                (self.moved.begun(), "before", "stress_before.png"),
                (self.moved, "after", "stress.png"),
            ):
                for name, folder in folders.items():
                    body, title = told.problem.flexible[name], f"{name} {when} boundary steps"
                    worst = worst_stress(body, told.evaluation, name)
                    plot_stress(body.domain, worst, folder / file, title=title)
        except (TrialFailed, ValueError, SimulationError) as error:
            warn(f"finish: the stress is not drawn ({error})", 3)

    @property
    def _designs_of_parts(self) -> dict[str, Variables]:
        kinds = (Design, DimensionDesign)
        return {name: design for name, design in self.designs.items() if isinstance(design, kinds)}

    @cached_property
    def lower_bound(self) -> LowerBound:
        """What psi of every part must be at least, see `bound`; the first time takes some seconds.

        It holds for the bounds of the volume that the run had. Collective; a ValueError on every
        rank says why there is none.
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
        """By what share psi is above the `lower_bound` at most; it raises what that raises."""
        return self.lower_bound.gap(self.psi)

    @property
    def final(self) -> tuple[Problem, Evaluation]:
        """The problem of the parts that were moved, else of the densities, and its evaluation."""
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
    """Warn that no part comes of the designs of some bodies, which is a violation of each."""
    result.violations.update({f"part of {name}": 1.0 for name in names})
    warn(
        f"no part comes of the design of {', '.join(map(repr, names))}, so it is not feasible: "
        f"{error}; take smaller elements, more volume, another start, or an objective that loads "
        "the interfaces, which the frequency of a free body does not",
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
