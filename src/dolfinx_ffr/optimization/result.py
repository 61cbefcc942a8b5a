# SPDX-License-Identifier: MIT
"""What a design loop ends with: the design, its history, and what it falls short of."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..design import Design
from ..dynamics import SimulationError
from ..fem import Domain
from ..part import Part, Solid, Verification, verify
from ..plotting import plot_part
from ..problem import Evaluation, Problem

__all__ = ["DesignWarning", "Result", "gray_fraction", "of_problem", "only"]

Array = NDArray[np.float64]


class DesignWarning(UserWarning):
    """A run that began otherwise than it was asked to, or a result that is not what was wanted."""


def gray_fraction(domain: Domain, x: Array, low: float = 0.1, high: float = 0.9) -> float:
    """The share of the body's area whose density is neither void nor solid.

    Args:
        domain: The body.
        x: Density of this rank's cells, shape (cells,).
        low: Densities up to this one count as void.
        high: Densities from this one on count as solid.

    Raises:
        TypeError: If an argument is of a wrong kind.
        ValueError: On every rank, if the density has the wrong size, is NaN or leaves [0, 1].
    """
    validation.instance("gray fraction: domain", domain, Domain, "a Domain")
    validation.number("gray fraction: low", low)
    validation.number("gray fraction: high", high)
    density = domain.check_density(x)
    gray = (density > low) & (density < high)
    return domain.sum(domain.cell_volumes * gray) / domain.area


@dataclass(frozen=True)
class Result:
    """A design and how it came about."""

    densities: dict[str, Array]  #: Of this rank's cells by body, shape (cells,)
    #: By body, the same on every rank: coefficients of a level set, shape (knots,), or design
    #: variables of a `DensityDesign`, shape (designed cells,)
    variables: dict[str, Array]
    #: psi and motion of the design, by `problem`
    evaluation: Evaluation = field(repr=False)
    history: dict[str, Array] = field(repr=False)  #: Columns over the iterations
    #: Why the loop ended: "converged", "iterations" (none were left), "interrupted", "stalled" (the
    #: design would fall apart with a narrower Heaviside function), or "infeasible" (without a
    #: design that fulfils all constraints)
    reason: str
    #: By body, as sharp as at the end: its `Design.density` of the variables is the density
    designs: dict[str, Design] = field(repr=False)
    #: The one that evaluates the design: of a crisp level set with the law of cut elements, of
    #: anything else the one that was given
    problem: Problem = field(repr=False)
    #: Constraints that the design violates, by name (that of a volume bound is "volume of rod"), by
    #: how much relative to their bounds
    violations: dict[str, float] = field(default_factory=dict)
    #: Estimated relative error of psi by the normal modes that each body leaves out; empty where it
    #: was not asked for, NaN where it cannot be estimated
    mode_errors: dict[str, float] = field(default_factory=dict)
    _parts: dict[str, Part | Solid] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @property
    def feasible(self) -> bool:
        """Whether the design fulfils all constraints and volume bounds."""
        return not self.violations

    def summary(self) -> dict[str, Any]:
        """How the run ended, for `write_summary`."""
        return {
            "psi": self.psi,
            "reason": self.reason,
            "iterations": self.iterations,
            "feasible": self.feasible,
            "violations": self.violations,
            "volume": self.evaluation.volume,
            "gray": float(self.history["gray"][-1]),
            "modes": {name: body.modes for name, body in self.problem.flexible.items()},
            "mode_error": max(
                (error for error in self.mode_errors.values() if not np.isnan(error)), default=None
            ),
        }

    @property
    def x(self) -> Array:
        """Density of this rank's cells, shape (cells,), where one body is designed."""
        return only(self.densities)

    @property
    def coefficients(self) -> Array:
        """Coefficients of the level set, shape (knots,), where one body is designed."""
        return only(self.variables)

    def part(self, name: str | None = None) -> Part:
        """The part that a designed body encloses, of the body's material; collective.

        Args:
            name: Of the body; by default the only one.

        Raises:
            ValueError: On every rank, if no body of this name was designed, several are and none is
                named, or the part cannot be made (`Part`).

        Warns:
            PartWarning: Of loose pieces and lost interfaces, see `Part`.
        """
        found = self._part("part", Part, name)
        assert isinstance(found, Part)
        return found

    def solid(self, name: str | None = None) -> Solid:
        """The solid that a designed body in space encloses, of the body's material; collective.

        Args:
            name: Of the body; by default the only one.

        Raises:
            ValueError: On every rank, if no body of this name was designed, several are and none is
                named, the body is in the plane, or the solid cannot be made (`Solid`).

        Warns:
            PartWarning: Of loose pieces and lost interfaces, see `Solid`.
        """
        found = self._part("solid", Solid, name)
        assert isinstance(found, Solid)
        return found

    def _part(self, what: str, kind: type[Part] | type[Solid], name: str | None) -> Part | Solid:
        """What a designed body encloses, of a kind; kept, as it takes seconds."""
        if name is None:
            name = only({body: body for body in self.designs})
        validation.choice(f"result: {what}", name, self.designs)
        if not isinstance(self._parts.get(name), kind):
            material = self.problem.flexible[name].material
            design, variables = self.designs[name], self.variables[name]
            self._parts[name] = kind.of(design, variables, material=material)
        return self._parts[name]

    def _enclosed(self, name: str) -> Part | Solid:
        """The part of a body in the plane, the solid of one in space."""
        space = self.designs[name].domain.dimension == 3
        return self.solid(name) if space else self.part(name)

    def verify(self, **options: Any) -> Verification:
        """Evaluate the problem with all designed bodies as parts or solids that fit; collective.

        Args:
            options: Those of `verify`.

        Raises:
            ValueError: As `part` and `verify`.
            SimulationError: On every rank, if the motion of the parts cannot be computed.
        """
        parts = {name: self._enclosed(name) for name in self.designs}
        return verify(self.problem, parts, self.evaluation, **options)

    def finish(self, folder: str | Path, **options: Any) -> Verification | None:
        """Leave the parts of all designed bodies: files for CAD, a picture, psi again; collective.

        Args:
            folder: For ``part.svg``, ``.dxf``, ``.step``, ``.stl`` and ``.png``, in space
                ``solid.stl`` and ``solid.png``, where one body is designed; where several are, for
                folders with their names.
            options: Those of `verify`.

        Returns:
            What the parts are worth; None if the design encloses no part that can be moved.

        Raises:
            OSError: On every rank, if a file cannot be written.

        Warns:
            DesignWarning: Where there is no such part, with the reason.
        """
        found = None
        try:
            found = self.verify(**options)
        except (ValueError, SimulationError) as error:
            warnings.warn(f"no part comes of this design: {error}", DesignWarning, stacklevel=2)
        for name, own in self._folders(folder).items():
            part = self._parts.get(name)
            solid = isinstance(part, Solid)
            if part is None or (found is None and not solid):
                continue
            # the surface of a solid is worth a look in any case
            part.write(own / "solid.stl" if solid else own)
            what, title = "solid" if solid else "part", name
            if found is not None:
                title += f": psi of the {what} is {found.psi / self.psi:.3f} of that of the design"
            plot_part(part, own / f"{what}.png", title=title)
        return found

    def _folders(self, folder: str | Path) -> dict[str, Path]:
        """Where the files of each body go."""
        if len(self.designs) == 1:
            return dict.fromkeys(self.designs, Path(folder))
        return {name: Path(folder) / name.replace(" ", "_") for name in self.designs}

    @property
    def psi(self) -> float:
        """Objective of the design."""
        return self.evaluation.psi

    @property
    def iterations(self) -> int:
        """Number of steps tried."""
        return int(self.history["iteration"][-1])


def only(by_name: Mapping[str, Any]) -> Any:
    """The value of a mapping with one name.

    Args:
        by_name: Values by body.

    Raises:
        ValueError: If there are several.
    """
    if len(by_name) > 1:
        raise ValueError(
            f"several bodies are designed ({sorted(by_name)}): ask by name, for example "
            f"result.densities[{next(iter(by_name))!r}]"
        )
    return next(iter(by_name.values()))


def of_problem(densities: Mapping[str, Array]) -> Any:
    """Densities as `Problem.value` takes them: by name, or those of the only body.

    Args:
        densities: By body.
    """
    return dict(densities) if len(densities) > 1 else only(densities)
