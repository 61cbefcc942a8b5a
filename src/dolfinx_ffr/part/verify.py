# SPDX-License-Identifier: MIT
"""What a design is worth as a part: the problem evaluated again on meshes that fit the boundary."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from .. import validation
from ..fem import Domain
from ..parallel import on_every_rank
from ..postprocessing import worst_stress
from ..problem import Evaluation, Problem
from .shape import Enclosed, PartWarning
from .widths import Width

__all__ = ["BodyFigures", "Figures", "Verification", "verify"]

#: Share by which psi of the parts may exceed the reported one, and a constraint its bound, before
#: that is said
SOFTER = 0.02
#: Frequencies that the summary shows
_SHOWN = 3


@dataclass(frozen=True, eq=False)
class BodyFigures:
    """What is known of one body."""

    cells: int  #: Of its mesh
    mass: float  #: [kg]
    volume: float  #: Material, as a share of the area of the body that was designed
    frequencies: NDArray[np.float64]  #: With all interfaces held [Hz]
    stress: float | None  #: Largest von Mises stress in the motion [Pa]; None without a motion


@dataclass(frozen=True, eq=False)
class Figures:
    """One line of the table: a problem with certain meshes."""

    size: float | None  #: Of the cells [m]; None for the design as it was reported
    psi: float  #: Value of the objective
    constraints: dict[str, float]  #: Values of the constrained objectives
    bodies: dict[str, BodyFigures]  #: Of the designed bodies
    #: Value of the objective of each motion by its name; empty where there is one
    motions: dict[str, float] = field(default_factory=dict)
    #: By how much constraints exceed their bounds, relative to these; negative where they hold
    excesses: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Verification:
    """What was reported of a design, and what its parts are worth."""

    reported: Figures  #: Of the densities
    fitted: list[Figures]  #: Of the parts, each time on finer meshes
    tolerance: float  #: Largest change of psi from one mesh to the next that counts as none
    modes: dict[str, int]  #: Number of normal modes of each part
    parts: Mapping[str, Enclosed]  #: By name of the body

    @property
    def psi(self) -> float:
        """Of the parts on the finest mesh."""
        return self.fitted[-1].psi

    @property
    def difference(self) -> float:
        """How much larger psi of the parts is than the reported one, relative to it."""
        return self.psi / self.reported.psi - 1.0

    @property
    def change(self) -> float:
        """The last relative change of psi from one mesh to the next; infinite with one mesh."""
        if len(self.fitted) < 2:
            return float("inf")
        return abs(self.fitted[-2].psi / self.psi - 1.0)

    @property
    def converged(self) -> bool:
        """Whether psi stands still."""
        return self.change <= self.tolerance

    def summary(self) -> str:
        """The table as text."""
        lines = [f"{'':24s} {'psi':>12s} {'vs reported':>12s}"]
        for row in (self.reported, *self.fitted):
            name = "reported (densities)" if row.size is None else f"part, {1e3 * row.size:.3g} mm"
            lines.append(f"{name:24s} {row.psi:12.5e} {row.psi / self.reported.psi:12.4f}")
        still = "stands still" if self.converged else "still changes"
        lines.append(
            f"psi {still}: last change {100 * self.change:.2g} % "
            f"(tolerance {100 * self.tolerance:.2g} %)"
        )
        last = self.fitted[-1]
        for name, body in last.bodies.items():
            before = self.reported.bodies[name]
            lines.append(
                f"{name}: {body.cells} {self.parts[name].elements}, {self.modes[name]} modes; "
                "reported -> part"
            )
            measures = self.parts[name].measures()
            holes = ""
            if "holes" in measures:
                holes = f", with {measures['holes']} hole{'s' * (measures['holes'] != 1)}"
            lines.append(f"  pieces       {self.parts[name].pieces}{holes}")
            for what, width in measures.items():
                if isinstance(width, Width):
                    lines.append(f"  {what}: {1e3 * width.value:.3g} mm")
            lines.append(f"  mass         {before.mass:.5g} -> {body.mass:.5g} kg")
            lines.append(f"  volume       {before.volume:.4f} -> {body.volume:.4f}")
            for i in range(min(_SHOWN, len(before.frequencies), len(body.frequencies))):
                lines.append(
                    f"  frequency {i + 1}  {before.frequencies[i]:.5g} -> "
                    f"{body.frequencies[i]:.5g} Hz"
                )
            if before.stress is not None and body.stress is not None:
                lines.append(
                    f"  stress       {before.stress / 1e6:.4g} -> {body.stress / 1e6:.4g} MPa"
                )
        for name, psi in last.motions.items():
            before_of = self.reported.motions[name]
            lines.append(
                f"motion {name}: psi {before_of:.5e} -> {psi:.5e}, {psi / before_of:.4f} of that"
            )
        for name, value in last.constraints.items():
            over = last.excesses[name]
            lines.append(
                f"constraint {name}: {self.reported.constraints[name]:.4g} -> {value:.4g}"
                + (f", {100 * over:.1f} % beyond its bound" if over > 0.0 else "")
            )
        return "\n".join(lines)

    def record(self) -> dict[str, Any]:
        """What the parts are worth and measure, for `write_summary`; lengths in metres.

        Values of bodies are numbers where one is designed, and by its name where several are.
        """

        def of_each(values: Mapping[str, Any]) -> Any:
            return next(iter(values.values())) if len(values) == 1 else dict(values)

        parts = self.parts
        measures = {name: part.measures() for name, part in parts.items()}
        told = {what for of in measures.values() for what in of}

        def measure(what: str) -> Any:
            found = {name: of.get(what) for name, of in measures.items()}
            return of_each({n: v.value if isinstance(v, Width) else v for n, v in found.items()})

        def by_name(what: str, key: str) -> dict[str, Any]:
            return {key: measure(what)} if what in told else {}

        return {
            "psi_part": self.psi,
            **({"psi_part_by_motion": self.fitted[-1].motions} if self.reported.motions else {}),
            "part_difference": self.difference,
            "part_change": self.change,
            "part_pieces": of_each({name: part.pieces for name, part in parts.items()}),
            **by_name("holes", "part_holes"),
            "part_mass": of_each({n: body.mass for n, body in self.fitted[-1].bodies.items()}),
            **by_name("thinnest member", "thinnest_member"),
            **by_name("narrowest gap", "narrowest_gap"),
        }

    def __str__(self) -> str:
        """The table as text."""
        return self.summary()


def verify(
    problem: Problem,
    parts: Mapping[str, Enclosed],
    evaluation: Evaluation,
    *,
    modes: Mapping[str, int] | int | None = None,
    size: float | None = None,
    tolerance: float | None = None,
    order: int = 2,
    most: int | None = None,
    progress: bool = True,
) -> Verification:
    """Evaluate a problem with parts in the place of designed bodies; collective.

    Each part is meshed by triangles, each solid by tetrahedra that fit its boundary, all of full
    density, and the whole motion is computed again; on finer meshes, until psi stands still. What
    then is left between it and the reported psi is the difference between the densities and the
    part.

    Args:
        problem: As it was designed.
        parts: By name of the body, a `Part` in the plane or a `Solid` in space.
        evaluation: Of the design, what was reported.
        modes: Number of normal modes of the parts, one for all or by name; by default that of the
            problem. Slender parts may need more than full bodies.
        size: Of the cells at first [m]. In the plane by default two spacings of each part; they are
            halved at least once, and members narrower than that get smaller ones. In space by
            default twelve tetrahedra for each hexahedron of the body, then 24, 96, 192, ..., or as
            many as the body has, then eight times as many.
        tolerance: Largest relative change of psi from mesh to mesh that counts as none; by default
            2e-3 in the plane, 5e-3 in space.
        order: Polynomial order of the displacements.
        most: Largest number of meshes; by default 5 in the plane, 2 in space.
        progress: Show a progress bar on rank 0.

    Raises:
        TypeError: On every rank, if an argument is of a wrong kind.
        ValueError: On every rank, if a name is not that of a flexible body, a part has lost an
            interface that the problem uses, or cannot be meshed.
        SimulationError: On every rank, if the motion of the parts cannot be computed.

    Warns:
        PartWarning: If psi does not stand still, or is more than 2 % above the reported one, or a
            constraint is more than 2 % beyond its bound.
    """
    validation.instance("verify: problem", problem, Problem, "a Problem")
    validation.instances_by_name("verify: parts", parts, Enclosed, "a Part or a Solid")
    validation.instance("verify: evaluation", evaluation, Evaluation, "an Evaluation")
    if tolerance is None:
        tolerance = max((part.tolerance for part in parts.values()), default=1.0)
    validation.number("verify: tolerance", tolerance, above=0.0)
    if most is None:
        most = max((part.most for part in parts.values()), default=2)
    if size is not None:
        validation.number("verify: size", size, above=0.0, unit="m")
    meshes = validation.integer("verify: most", most, least=2)
    validation.flag("verify: progress", progress)
    unknown = sorted(set(parts) - set(problem.flexible))
    if unknown or not parts:
        raise ValueError(
            f"verify: parts for {sorted(parts)}, but the flexible bodies are "
            f"{sorted(problem.flexible)}"
        )
    for name, part in parts.items():
        if part.lost_interfaces:
            raise ValueError(
                f"verify: the part {name!r} has no material at the interfaces "
                f"{part.lost_interfaces}, by which the problem holds it"
            )
    if modes is None or isinstance(modes, Mapping):
        given = dict(modes or {})
    else:
        given = dict.fromkeys(parts, modes)
    wanted = {name: given.get(name, problem.flexible[name].modes) for name in parts}
    reported = _figures(None, problem, evaluation, parts)
    fitted: list[Figures] = []
    every = {name: part.sizes(size, meshes) for name, part in parts.items()}
    silent = not progress or problem.comm.rank > 0
    for mesh in tqdm(range(meshes), "verify", unit="mesh", leave=False, disable=silent):
        sizes = {name: of[mesh] for name, of in every.items()}
        domains = {name: part.domain(sizes[name], order) for name, part in parts.items()}
        for name, domain in domains.items():
            domain.whole = problem.flexible[name].domain
        again = _with_parts(problem, domains, wanted)
        densities = {
            name: np.ones(body.domain.n_cells) if name in parts else evaluation.bodies[name].density
            for name, body in again.flexible.items()
        }
        fitted.append(_figures(max(sizes.values()), again, again.value(densities), parts))
        found = Verification(reported, fitted, tolerance, wanted, parts)
        if found.converged:
            break
    if not found.converged:
        before, last = (1e3 * (row.size or 0.0) for row in fitted[-2:])
        warnings.warn(
            f"verify: psi still changes by {100 * found.change:.2g} % from "
            f"{next(iter(parts.values())).elements} of {before:.3g} mm to "
            f"{last:.3g} mm; give a smaller size or more meshes (most=), or look "
            "for members thinner than that",
            PartWarning,
            stacklevel=2,
        )
    excess = (found.psi - reported.psi) / abs(reported.psi) if reported.psi else 0.0
    if excess > SOFTER:
        warnings.warn(
            f"verify: psi is {100 * excess:.1f} % above what was reported: elements "
            "bridge a member that is broken or thinner than they are, or are coarse themselves. "
            "Look at the picture of the part; design with a larger minimum_member, on smaller "
            "elements, or from another start",
            PartWarning,
            stacklevel=2,
        )
    for name, over in fitted[-1].excesses.items():
        if not over <= SOFTER:
            before = reported.excesses[name]
            remedy = (
                "design with a bound that much tighter"
                if before <= SOFTER
                else f"the design exceeds it by {100 * before:.1f} % itself: more iterations, "
                "another start or another bound"
            )
            warnings.warn(
                f"verify: the part violates {name!r} by {100 * over:.1f} % of the bound; {remedy}",
                PartWarning,
                stacklevel=2,
            )
    return found


def _with_parts(
    problem: Problem, domains: Mapping[str, Domain], modes: Mapping[str, int]
) -> Problem:
    """The problem with other meshes and numbers of modes of some bodies."""
    bodies = {
        name: problem.flexible[name].with_domain(domains[name]).with_modes(modes[name])
        if name in domains
        else body
        for name, body in problem.bodies.items()
    }
    return problem.with_bodies(bodies)


def _figures(
    size: float | None, problem: Problem, evaluation: Evaluation, parts: Mapping[str, Enclosed]
) -> Figures:
    bodies = {}
    for name, part in parts.items():
        body = problem.flexible[name]
        stress = None
        if evaluation.moves:
            stress = worst_stress(body, evaluation, name).largest
        domain = body.domain
        filled = domain.sum(evaluation.bodies[name].density * domain.cell_volumes)
        bodies[name] = BodyFigures(
            cells=domain.n_cells_global,
            mass=evaluation.bodies[name].integrals.mass,
            volume=filled / part.body.area,
            frequencies=evaluation.fixed_interface_frequencies[name],
            stress=stress,
        )
    constraints = {name: float(value.psi) for name, value in evaluation.constraints.items()}
    motions = {name: float(motion.psi) for name, motion in evaluation.motions.items()}
    with on_every_rank(problem.comm, "verify"):
        return Figures(
            size,
            float(evaluation.psi),
            constraints,
            bodies,
            motions if len(motions) > 1 else {},
            {name: float(value.value) for name, value in evaluation.constraints.items()},
        )
