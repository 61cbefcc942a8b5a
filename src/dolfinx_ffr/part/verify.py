# SPDX-License-Identifier: MIT
"""Verification of parts: the problem evaluated again on meshes that fit the boundary."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from tqdm.auto import tqdm

from .. import validation
from ..arrays import Array
from ..fem import ShapeError
from ..limits import LimitError
from ..objective import is_stress
from ..parallel import on_every_rank, on_rank_0
from ..postprocessing import worst_stress
from ..problem import Evaluation, Problem
from ..reduction import FlexibleBody, ReducedBody
from .enclosed import Enclosed, PartWarning
from .figures import BodyFigures, Figures
from .widths import Width


@dataclass(frozen=True)
class VerificationOptions:
    """When a verification is done, and which differences it names."""

    #: Share by which psi of the parts may exceed the reported one, a constraint its bound, and a
    #: frequency differ from the reported one, before that is named
    difference: float = 0.02
    #: The same of the largest stress, which differs as much from mesh to mesh where edges begin at
    #: an interface
    stress_difference: float = 0.1
    #: Number of meshes at most if psi has converged and only constraints are undecided
    meshes_for_bounds: int = 3
    frequencies: int = 3  #: Number of frequencies that are compared and shown
    recorded_frequencies: int = 6  #: Number of frequencies that are recorded


VERIFICATION = VerificationOptions()


@dataclass(frozen=True, eq=False, repr=False)
class Verification:
    """The figures of a design, and of its parts on finer and finer meshes.

    Largest stresses are known of the design and of the parts on their finest mesh.

    Attributes:
        reported: Figures of the design.
        fitted: Figures of the parts, each time on finer meshes.
        tolerance: Largest change of psi from one mesh to the next that counts as none.
        modes: Number of normal modes of each part.
        parts: Parts by name of the body.
        limits: Bounds of constraints and volumes in words, by name.
        bodies: Each part on its finest mesh and its reduction, by name of the body.
    """

    reported: Figures
    fitted: list[Figures]
    tolerance: float
    modes: dict[str, int]
    parts: Mapping[str, Enclosed]
    limits: Mapping[str, str] = field(default_factory=dict)
    bodies: Mapping[str, tuple[FlexibleBody, ReducedBody]] = field(default_factory=dict, repr=False)

    def export(
        self,
        path: str | Path,
        name: str | None = None,
        *,
        format: str | None = None,
    ) -> None:
        """Write the reduction of a part on its finest mesh, which others move.

        It is what the objective was verified with. A part in the plane becomes a body in space
        (`FlexibleBody.in_space`), but for this package's own files.

        Args:
            path: Where rank 0 writes, as `VolumeIntegrals.save`.
            name: Name of the body; by default the only one.
            format: Format as in `VolumeIntegrals.save`.

        Raises:
            ValueError: If the name is needed or not known, or the format cannot hold the body.
            OSError: If the file cannot be written.
        """
        if name is None and len(self.bodies) == 1:
            name = next(iter(self.bodies))
        if name is None or name not in self.bodies:
            raise ValueError(f"export: name = {name!r}, but the parts are {sorted(self.bodies)}")
        body, reduced = self.bodies[name]
        is_ours = format == "npz" or (format is None and Path(path).suffix == ".npz")
        integrals = reduced.integrals if is_ours else body.in_space(reduced)
        on_rank_0(body.domain.comm, lambda: integrals.save(path, format=format))

    @property
    def psi(self) -> float:
        """Psi of the parts on the finest mesh."""
        return self.fitted[-1].psi

    @property
    def difference(self) -> float:
        """Relative excess of psi of the parts over the reported psi."""
        reported = self.reported.psi
        return (self.psi - reported) / abs(reported) if reported else 0.0

    @property
    def change(self) -> float:
        """The last relative change of psi from one mesh to the next; infinite with one mesh."""
        if len(self.fitted) < 2:
            return float("inf")
        return abs(self.fitted[-2].psi / self.psi - 1.0)

    @property
    def converged(self) -> bool:
        """Whether the last change of psi is within the tolerance."""
        return self.change <= self.tolerance

    @property
    def decided(self) -> bool:
        """Whether each constraint has converged, or is farther from its bound than it changed."""
        if len(self.fitted) < 2:
            return False
        coarse, fine = (figures.excesses for figures in self.fitted[-2:])
        return all(
            abs(excess - coarse[name]) <= max(self.tolerance, abs(excess))
            for name, excess in fine.items()
        )

    @property
    def violations(self) -> dict[str, float]:
        """Constraints and volumes that are more than 2 % beyond their bounds, by how much."""
        # NaN is not below a bound
        excesses = self.fitted[-1].excesses
        return {
            name: excess
            for name, excess in excesses.items()
            if not excess <= VERIFICATION.difference
        }

    @property
    def differences(self) -> list[str]:
        """Reported numbers that differ from the parts' numbers, each in words.

        psi and frequencies that differ by more than 2 %, and a largest stress by more than 10 %.
        """
        sentences = []
        if abs(self.difference) > VERIFICATION.difference:
            sentences.append(f"psi {self.reported.psi:.4g}, of the parts {self.psi:.4g}")
        for name, body in self.fitted[-1].bodies.items():
            design = self.reported.bodies[name]
            for number, (reported, fitted) in enumerate(_frequencies(design, body), 1):
                if abs(fitted - reported) > VERIFICATION.difference * abs(reported):
                    sentences.append(
                        f"frequency {number} of {name!r} {reported:.4g} Hz, "
                        f"of the part {fitted:.4g} Hz"
                    )
            if design.stress is None or body.stress is None:
                continue
            if abs(body.stress - design.stress) > VERIFICATION.stress_difference * design.stress:
                sentences.append(
                    f"largest stress of {name!r} {design.stress / 1e6:.4g} MPa, "
                    f"of the part {body.stress / 1e6:.4g} MPa"
                )
        return sentences

    def summary(self) -> str:
        """The table as text."""
        lines = [f"{'':24s} {'psi':>12s} {'vs reported':>12s}"]
        for figures in (self.reported, *self.fitted):
            size = figures.size
            label = "reported (design)" if size is None else f"part, {1e3 * size:.3g} mm"
            ratio = figures.psi / self.reported.psi
            lines.append(f"{label:24s} {figures.psi:12.5e} {ratio:12.4f}")

        if len(self.fitted) > 1:
            state = "has converged" if self.converged else "still changes"
            lines.append(
                f"psi {state}: last change {100 * self.change:.2g} % "
                f"(tolerance {100 * self.tolerance:.2g} %)"
            )
        else:
            lines.append("psi of one mesh only")

        finest = self.fitted[-1]
        for name in finest.bodies:
            lines += self._lines_of_body(name)
        for name, psi in finest.load_cases.items():
            reported = self.reported.load_cases[name]
            lines.append(
                f"load case {name}: psi {reported:.5e} -> {psi:.5e}, ratio {psi / reported:.4f}"
            )
        for name, excess in finest.excesses.items():
            beyond = f", {100 * excess:.1f} % beyond its bound" if excess > 0.0 else ""
            values = f"{self.reported.values[name]:.4g} -> {finest.values[name]:.4g}"
            lines.append(f"constraint {name}: {values}, {self.limits[name]}{beyond}")
        return "\n".join(lines)

    def _lines_of_body(self, name: str) -> list[str]:
        """The lines of the summary on one body."""
        part, measures = self.parts[name], self.parts[name].measures()
        design, body = self.reported.bodies[name], self.fitted[-1].bodies[name]
        holes, pockets = measures.get("holes"), measures.get("pockets")
        counts = "" if holes is None else f", with {holes} hole{'s' * (holes != 1)}"
        if pockets:
            counts += f" and {pockets} pocket{'s' * (pockets != 1)}"

        lines = [
            f"{name}: {body.cells} {part.elements}, {self.modes[name]} modes; reported -> part",
            f"  pieces       {part.pieces}{counts}",
        ]
        for label, width in measures.items():
            if isinstance(width, Width):
                lines.append(f"  {label}: {1e3 * width.value:.3g} mm")
        lines.append(f"  mass         {design.mass:.5g} -> {body.mass:.5g} kg")
        lines.append(f"  volume       {design.volume:.4f} -> {body.volume:.4f}")
        for number, (reported, fitted) in enumerate(_frequencies(design, body), 1):
            lines.append(f"  frequency {number}  {reported:.5g} -> {fitted:.5g} Hz")
        if design.stress is not None and body.stress is not None:
            assert body.place is not None
            place = ", ".join(f"{1e3 * x:.4g}" for x in body.place)
            lines.append(
                f"  stress       {design.stress / 1e6:.4g} -> {body.stress / 1e6:.4g} MPa, "
                f"at ({place}) mm"
            )
        return lines

    def record(self) -> dict[str, Any]:
        """The entry ``verification`` of `summary.json`, see `run_record`.

        Where it holds pairs of numbers, the first one is the reported number, and the second one
        is that of the part on its finest mesh.
        """
        reported, finest = self.reported, self.fitted[-1]
        keys = "difference differences violations change tolerance converged".split()
        return {
            "reported": reported.psi,
            "part": self.psi,
            **{key: getattr(self, key) for key in keys},
            "meshes": [{"size": figures.size, "psi": figures.psi} for figures in self.fitted],
            "constraints": _pairs(reported.constraints, finest.constraints),
            "load_cases": _pairs(reported.load_cases, finest.load_cases),
            "bodies": {name: self._record_of_body(name) for name in finest.bodies},
        }

    def _record_of_body(self, name: str) -> dict[str, Any]:
        part, bodies = self.parts[name], (self.reported.bodies[name], self.fitted[-1].bodies[name])
        measures = part.measures()
        most = VERIFICATION.recorded_frequencies
        return {
            "cells": bodies[1].cells,
            "elements": part.elements,
            "modes": self.modes[name],
            "pieces": part.pieces,
            **{
                label.replace(" ", "_"): value.value if isinstance(value, Width) else value
                for label, value in measures.items()
            },
            **{
                key: [getattr(body, key) for body in bodies] for key in ("mass", "volume", "stress")
            },
            "frequencies": [body.frequencies[:most] for body in bodies],
        }

    def __repr__(self) -> str:
        """The table as text."""
        return self.summary()


def _pairs(reported: Mapping[str, float], fitted: Mapping[str, float]) -> dict[str, list[float]]:
    """Pairs by name: the reported value and that of the parts."""
    return {name: [reported[name], value] for name, value in fitted.items()}


def _frequencies(design: BodyFigures, part: BodyFigures) -> Iterator[tuple[float, float]]:
    """The lowest frequencies of a design and of its part [Hz]."""
    return zip(design.frequencies[: VERIFICATION.frequencies], part.frequencies, strict=False)


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
    volume: float | Mapping[str, float] | None = None,
    progress: bool = True,
) -> Verification:
    """Evaluate a problem with parts in the place of designed bodies.

    Each part is meshed by triangles, small ones in notches where a largest stress counts, each
    solid by tetrahedra that fit its boundary, all of full density, and the whole motion is computed
    again; on finer meshes, until psi stands still. Its difference to the reported psi is then that
    between the densities and the part. A third mesh tells of constraints that are nearer to their
    bounds than they have changed.

    Objectives that stand for other numbers are corrected at the densities and anew at each mesh
    (`Problem.calibrated`): a `PeakStress` is the largest stress of the part itself.

    Args:
        problem: The problem that was designed.
        parts: A `Part` in the plane or a `Solid` in space, by name of the body.
        evaluation: The reported evaluation of the design.
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
        volume: Upper bound of the filled share of the bodies as they were designed, one for all or
            by name; by default none, and of a `Result` that which it was designed with.
        progress: Show a progress bar on rank 0.

    Raises:
        ValueError: If a name is not that of a flexible body, a part has lost an interface that the
            problem uses, or cannot be meshed.
        SimulationError: If the motion of the parts cannot be computed.

    Warns:
        PartWarning: If psi does not stand still, is more than 2 % above the reported one, a finer
            mesh could not be made or does not fit into the memory, or a constraint or a volume is
            more than 2 % beyond its bound; and of all `Verification.differences`.
    """
    validation.instance("verify: problem", problem, Problem, "a Problem")
    validation.instances_by_name("verify: parts", parts, Enclosed, "a Part or a Solid")
    validation.instance("verify: evaluation", evaluation, Evaluation, "an Evaluation")
    if tolerance is None:
        tolerance = max((part.tolerance for part in parts.values()), default=1.0)
    if most is None:
        most = max((part.most for part in parts.values()), default=2)
    validation.number("verify: tolerance", tolerance, above=0.0)
    if size is not None:
        validation.number("verify: size", size, above=0.0, unit="m")
    meshes = validation.integer("verify: most", most, least=2)
    validation.flag("verify: progress", progress)
    volume_bounds = _volume_bounds(problem, parts, volume)
    _check_parts(problem, parts)
    normal_modes = _normal_modes(problem, parts, modes)
    limits = {f"volume of {name}": f"at most {v:.4g}" for name, v in volume_bounds.items()}
    limits |= {constraint.label: constraint.limit for constraint in problem.constraints}

    corrected, calibrated = problem.calibrated(evaluation)
    reported = _figures(None, corrected, calibrated, parts, volume_bounds)
    reported = _with_stress(reported, corrected, calibrated)
    for name in parts:  # the factor of the design would stay beside those of its parts
        problem.flexible[name].release()

    fitted: list[Figures] = []
    bodies: dict[str, tuple[FlexibleBody, ReducedBody]] = {}
    sizes_of = {name: part.sizes(size, meshes) for name, part in parts.items()}
    is_silent = not progress or problem.comm.rank > 0
    for mesh in tqdm(range(meshes), "verify", unit="mesh", leave=False, disable=is_silent):
        for body, _ in bodies.values():  # of which the factor is large
            body.release()
        sizes = {name: of_meshes[mesh] for name, of_meshes in sizes_of.items()}
        try:
            with_parts = _meshed(problem, parts, sizes, order, normal_modes)
        except (ShapeError, LimitError) as error:
            if not fitted:
                raise
            warnings.warn(
                "verify: the last mesh could not be made, so that psi of the mesh before is "
                f"reported and may still change: {error}",
                PartWarning,
                stacklevel=2,
            )
            break

        # the first mesh of a solid whose surface was moved is that on which it was reported
        is_reported = not fitted and all(
            reported.bodies[name].is_of(with_parts.flexible[name], problem.flexible[name])
            for name in parts
        )
        if not is_reported:
            densities = _densities(with_parts, parts, evaluation)
            corrected, calibrated = with_parts.calibrated(with_parts.value(densities))

        fitted.append(_figures(max(sizes.values()), corrected, calibrated, parts, volume_bounds))
        bodies = {name: (corrected.flexible[name], calibrated.bodies[name]) for name in parts}
        for body, reduced in bodies.values():
            body.warn_of_missing_modes(reduced)
        result = Verification(reported, fitted, tolerance, normal_modes, parts, limits, bodies)
        if result.converged and (result.decided or len(fitted) >= VERIFICATION.meshes_for_bounds):
            break

    fitted[-1] = _with_stress(fitted[-1], corrected, calibrated)
    for body, _ in bodies.values():
        body.release()
    for text in _doubts(result):
        warnings.warn(f"verify: {text}", PartWarning, stacklevel=2)
    return result


def _normal_modes(
    problem: Problem, parts: Mapping[str, Enclosed], modes: Mapping[str, int] | int | None
) -> dict[str, int]:
    """The number of normal modes of each part, by default as many as the problem's body has."""
    wanted = modes if isinstance(modes, Mapping) else dict.fromkeys(parts, modes)
    numbers = {name: body.modes for name, body in problem.flexible.items() if name in parts}
    return numbers | {name: n for name, n in wanted.items() if name in parts and n is not None}


def _densities(
    with_parts: Problem, parts: Mapping[str, Enclosed], evaluation: Evaluation
) -> dict[str, Array]:
    """The density of each body: of parts on their meshes, of other bodies as it was designed."""
    bodies = with_parts.flexible
    return {
        name: parts[name].density(body.domain) if name in parts else evaluation.bodies[name].density
        for name, body in bodies.items()
    }


def _volume_bounds(
    problem: Problem,
    parts: Mapping[str, Enclosed],
    volume: float | Mapping[str, float] | None,
) -> dict[str, float]:
    """The upper bound of the filled share of each part that has one, checked."""
    shares = dict(volume) if isinstance(volume, Mapping) else dict.fromkeys(parts, volume)
    if unknown := sorted(set(shares) - set(problem.flexible) - set(parts)):
        raise ValueError(
            f"verify: volume is given for {unknown}, but the flexible bodies are "
            f"{sorted(problem.flexible)}"
        )
    return {
        name: validation.number(f"verify: volume of {name!r}", share, above=0.0)
        for name, share in shares.items()
        if name in parts and share is not None
    }


def _check_parts(problem: Problem, parts: Mapping[str, Enclosed]) -> None:
    """Refuse parts that belong to no flexible body, or that lack an interface."""
    if not parts or set(parts) - set(problem.flexible):
        raise ValueError(
            f"verify: parts for {sorted(parts)}, but the flexible bodies are "
            f"{sorted(problem.flexible)}"
        )
    for name, part in parts.items():
        if part.lost_interfaces:
            raise ValueError(
                f"verify: the part {name!r} has no material at the interfaces "
                f"{part.lost_interfaces}, which the problem needs; keep the cells there solid"
            )


def _meshed(
    problem: Problem,
    parts: Mapping[str, Enclosed],
    sizes: Mapping[str, float],
    order: int,
    modes: Mapping[str, int],
) -> Problem:
    """The problem with parts on meshes of ``sizes`` [m]; ValueError where memory is too small."""
    is_stress_limited = any(
        is_stress(objective)
        for case in problem.load_cases.values()
        for objective in case.objectives.values()
    )
    bodies = dict(problem.bodies)
    for name, part in parts.items():
        design = problem.flexible[name]
        make_mesh = part.resolved if is_stress_limited else part.domain
        domain = make_mesh(sizes[name], order)
        domain.whole = design.domain.whole or design.domain
        body = design.with_domain(domain).with_modes(modes[name])
        body.check_memory(
            f"verify: a mesh of {name!r} with cells of {1e3 * sizes[name]:.3g} mm",
            'give a larger size, or solver="iterative" to the body',
        )
        bodies[name] = body
    return problem.with_bodies(bodies)


def _doubts(result: Verification) -> Iterator[str]:
    """Warnings: where psi still changes, is larger than reported, or a bound is exceeded."""
    if not result.converged and len(result.fitted) > 1:
        coarse, fine = (1e3 * (figures.size or 0.0) for figures in result.fitted[-2:])
        elements = next(iter(result.parts.values())).elements
        yield (
            f"psi still changes by {100 * result.change:.2g} % from {elements} of {coarse:.3g} mm "
            f"to {fine:.3g} mm; give a smaller size or more meshes (most=), or look for members "
            f"thinner than {fine:.3g} mm"
        )
    if result.difference > VERIFICATION.difference:
        yield (
            f"psi is {100 * result.difference:.1f} % above the reported value: elements bridge a "
            "member that is broken or thinner than an element, or are too coarse. Look at the "
            "picture of the part; design with a larger minimum_member, on smaller elements, or "
            "from another start"
        )
    if result.differences:
        yield (
            f"the parts differ from their design: {'; '.join(result.differences)}. Use the values "
            "of the parts; smaller elements, or steps of the boundary, make the differences "
            "smaller"
        )
    for name, excess in result.violations.items():
        of_design = result.reported.excesses[name]
        if of_design <= VERIFICATION.difference:
            remedy = "design with a bound that much tighter"
        else:
            remedy = (
                f"the design itself exceeds it by {100 * of_design:.1f} %: take more iterations, "
                "another start or another bound"
            )
        yield (
            f"the part violates {name!r} by {100 * excess:.1f} % of the bound "
            f"({result.reported.values[name]:.4g} of the design, "
            f"{result.fitted[-1].values[name]:.4g} of the part, {result.limits[name]}); {remedy}"
        )


def _figures(
    size: float | None,
    problem: Problem,
    evaluation: Evaluation,
    parts: Mapping[str, Enclosed],
    volume_bounds: Mapping[str, float],
) -> Figures:
    """The figures of one problem, without stresses."""
    bodies = {}
    for name, part in parts.items():
        domain, reduced = problem.flexible[name].domain, evaluation.bodies[name]
        bodies[name] = BodyFigures(
            cells=domain.n_cells_global,
            mass=reduced.integrals.mass,
            volume=domain.sum(reduced.density * domain.cell_volumes) / part.body.area,
            frequencies=evaluation.fixed_interface_frequencies[name],
        )
    load_cases = {name: float(case.psi) for name, case in evaluation.load_cases.items()}
    constraints = evaluation.constraints
    excesses = {
        f"volume of {name}": bodies[name].volume / bound - 1.0
        for name, bound in volume_bounds.items()
    }
    excesses |= {name: float(value.violation) for name, value in constraints.items()}
    with on_every_rank(problem.comm, "verify"):
        return Figures(
            size=size,
            psi=float(evaluation.psi),
            constraints={name: float(value.value) for name, value in constraints.items()},
            bodies=bodies,
            load_cases=load_cases if len(load_cases) > 1 else {},
            excesses=excesses,
        )


def _with_stress(figures: Figures, problem: Problem, evaluation: Evaluation) -> Figures:
    """The figures of one problem with the largest stresses of its bodies, if these move."""
    if not evaluation.is_simulated:
        return figures
    bodies = {}
    for name, body in figures.bodies.items():
        worst = worst_stress(problem.flexible[name], evaluation, name)
        bodies[name] = replace(body, stress=worst.largest, place=worst.largest_position)
    return replace(figures, bodies=bodies)


class Verifiable(Enclosed):
    """What a design encloses, with its verification."""

    def verify(self, problem: Problem, evaluation: Evaluation, **options: Any) -> Verification:
        """Evaluate a ``problem`` of one designed body with this in its place, see `verify`.

        The ``evaluation`` is that of the design, the ``options`` are those of `verify`; a
        ValueError if several bodies are designed.
        """
        validation.keywords(f"{self.kind}.verify", options, verify)
        names = list(problem.flexible)
        if len(names) != 1:
            raise ValueError(
                f"{self.kind}: the problem designs the bodies {sorted(names)}; verify them "
                f"together by verify(problem, {{name: {self.kind}, ...}}, evaluation)"
            )
        return verify(problem, {names[0]: self}, evaluation, **options)
