# SPDX-License-Identifier: MIT
"""What a design encloses, and what it is worth: evaluated again on meshes that fit the boundary."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike
from tqdm.auto import tqdm

from .. import validation
from ..arrays import Array
from ..design import Design
from ..documentation import Shown
from ..fem import Domain, ElasticMaterial
from ..mechanism import RayleighDamping
from ..objective import is_stress
from ..parallel import on_every_rank, on_rank_0
from ..postprocessing import worst_stress
from ..problem import Evaluation, Problem
from ..reduction import FlexibleBody, ReducedBody
from .field import Field
from .figures import BodyFigures, Figures
from .widths import Width

#: Share by which psi of the parts may exceed the reported one, and a constraint its bound, before
#: that is said
SOFTER = 0.02
#: Meshes at most where psi stands still and a bound is neither kept nor exceeded for sure
_FOR_BOUNDS = 3
#: Frequencies that the summary shows
_SHOWN = 3
#: Shares by which frequencies and the largest stress of the part may differ from the reported ones
#: before that is said: stress differs as much from mesh to mesh where edges begin at an interface
_FREQUENCY, _STRESS = 0.02, 0.1


class PartWarning(UserWarning):
    """What is drawn as a part is not all of the design, or not held as it should be."""


class LoosePieceWarning(PartWarning):
    """Pieces of a design touch no interface, and its part is without them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Found:
    """Found on rank 0, of a part or a solid, and sent to all ranks."""

    pieces: int
    lost: list[str]  #: Interfaces without material
    left_out: str  #: What is said of loose pieces
    warnings: list[str]  #: What is said besides


class Enclosed(Shown, ABC):
    """What a design encloses, to be made: a `Part` in the plane, a `Solid` in space.

    Both have the members below, and `Result.part` gives the one that fits the body.
    """

    kind: ClassVar[str]  #: "part" or "solid", also the name of its files
    elements: ClassVar[str]  #: What its meshes are made of
    #: Largest change of psi from one of its meshes to the next that counts as none, by default
    tolerance: ClassVar[float]
    most: ClassVar[int]  #: Number of meshes that are tried by default
    dimension: ClassVar[int]  #: Of its body
    _found: Found

    def _keep(
        self, domain: Domain, field: Field, material: ElasticMaterial | None, needed: str
    ) -> None:
        """Check and keep the arguments; the material needs a certain attribute."""
        #: The body that was designed
        self.body = validation.instance(f"{self.kind}: domain", domain, Domain, "a Domain")
        if domain.dimension != self.dimension:
            where, fitting = ("space", "Solid") if domain.dimension == 3 else ("the plane", "Part")
            raise ValueError(f"{self.kind}: the body is in {where}; {fitting} is for such bodies")
        validation.function(f"{self.kind}: field", field, "positions")
        #: Positive in the material, of positions (n, dimension) [m]
        self.field = field
        if material is not None:
            what = f"{self.kind}: material"
            validation.implementation(what, material, [needed], "an elastic material")
        #: What it is made of, for its mass
        self.material = material

    @classmethod
    def of(cls, design: Design, variables: ArrayLike, **options: Any) -> Self:
        """What a ``design`` encloses at its ``variables``; ``options`` as of the class.

        The boundary is the zero line or surface of a level set, of densities that where a smooth
        mean of them is one half (`density_field`).
        """
        needed = "a LevelSet or a DensityDesign"
        validation.instance(f"{cls.kind}: design", design, Design, needed)
        if design.web:
            options = {"web": design.web, **options}
        validation.keywords(f"{cls.__name__}.of", options, cls)
        field = design.level(design.check(variables))
        return cls(design.domain, field, **options)  # type: ignore[call-arg]

    def _shown(self) -> list[tuple[str, str, str]]:
        """What is known without more work."""
        rows = [("pieces", f"{self.pieces}", "")]
        if self.weighs:
            rows.append(("mass", f"{self.mass:.5g} kg", ""))
        known = ("thinnest member", "narrowest gap")
        found = {name: vars(self).get(name.replace(" ", "_")) for name in known}
        rows += [(name, f"{1e3 * w.value:.3g} mm", "") for name, w in found.items() if w]
        return rows + [("warning", text, "") for text in self.warnings]

    @property
    def pieces(self) -> int:
        """Number of connected pieces of material."""
        return self._found.pieces

    @property
    def warnings(self) -> list[str]:
        """What was said of it as it was made."""
        return [self._found.left_out] * bool(self._found.left_out) + self._found.warnings

    def _warn(self) -> None:
        """Warn of what was found, at the line that makes the part or the solid."""
        for text in self.warnings:
            kind = LoosePieceWarning if text == self._found.left_out else PartWarning
            warnings.warn(f"{self.kind}: {text}", kind, stacklevel=3)

    @property
    def lost_interfaces(self) -> list[str]:
        """Interfaces that are left without material."""
        return self._found.lost

    @property
    @abstractmethod
    def volume(self) -> float:
        """Volume [m^3]; in the plane area times thickness, which is that of a material."""

    @property
    def mass(self) -> float:
        """Mass [kg]; a ValueError without a material that tells its density."""
        material = self._made_of("its mass")
        if not self.weighs:
            raise ValueError(
                f"{self.kind}: its material {type(material).__name__} has no attribute density "
                "[kg/m^3], which its mass needs"
            )
        return self.volume * float(material.density)

    @property
    def weighs(self) -> bool:
        """Whether its mass is known: whether it has a material that tells its density."""
        return getattr(self.material, "density", None) is not None

    def density(self, domain: Domain) -> Array:
        """The density of each cell of a mesh ``domain`` that fits it, (cells,): that of the solid.

        In pockets it is the thickness of their floor as a share of the part's.
        """
        return np.ones(domain.n_cells)

    @property
    @abstractmethod
    def thinnest_member(self) -> Width | None:
        """The thinnest member, by discs or balls that do not fit; None if there is none."""

    @property
    @abstractmethod
    def narrowest_gap(self) -> Width | None:
        """The narrowest gap or hole, likewise."""

    def measures(self) -> dict[str, Width | int | None]:
        """What summaries tell of it beside its pieces."""
        return {"thinnest member": self.thinnest_member, "narrowest gap": self.narrowest_gap}

    def _made_of(self, what: str) -> ElasticMaterial:
        """The material, which a number asks for."""
        if self.material is None:
            raise ValueError(
                f"{self.kind}: {what} is that of a material; make it with "
                f"{type(self).__name__}(..., material=)"
            )
        return self.material

    def write(self, path: str | Path, **options: Any) -> list[Path]:
        """Write it for CAD, printers and machines; rank 0 writes.

        Args:
            path: A file: of a part .svg, .dxf, .step or .stl, of a solid .stl, .ply, .vtp or .obj.
                Or a folder, for "part.svg" and all others of a part, for "solid.stl" of a solid.
            options: ``unit`` of lengths, "mm" (the default) or "m". Files .step are in
                millimetres and say so.

        Returns:
            The files, on every rank.

        Raises:
            ValueError: If kind of file or unit are not known, or a part has no thickness.
            OSError: If a file cannot be written; older ones stay.
        """
        validation.keywords(f"{self.kind}.write", options, self._write)
        return self._write(path, **options)

    @abstractmethod
    def _write(self, path: str | Path, *, unit: str) -> list[Path]:
        """See `write`."""

    @abstractmethod
    def sizes(self, size: float | None, count: int) -> list[float]:
        """Sizes of ``count`` meshes to evaluate it on, each finer than the last [m].

        The first ``size`` is by default one that suits it.
        """

    @abstractmethod
    def domain(self, size: float, order: int = 2) -> Domain:
        """A mesh with cells of a ``size`` [m] that fits it, for displacements of an ``order``.

        It has the interfaces of the body, with the same centres, and its solid regions.
        """

    def resolved(self, size: float, order: int) -> Domain:
        """As `domain` for a ``size`` and ``order``, with smaller cells where the stress is high."""
        return self.domain(size, order)

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


@dataclass(frozen=True, eq=False, repr=False)
class Verification:
    """The figures of a design as reported, and of its parts on finer and finer meshes.

    Attributes:
        reported: Of the design.
        fitted: Of the parts, each time on finer meshes.
        tolerance: Largest change of psi from one mesh to the next that counts as none.
        modes: Number of normal modes of each part.
        parts: By name of the body.
        limits: Bounds of constraints and volumes in words, by name.
        bodies: By name, each part on its finest mesh, and its reduction there.
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
        damping: RayleighDamping | None = None,
    ) -> None:
        """Write the reduction of a part on its finest mesh, which others move.

        It is what the objective was verified with. A part in the plane becomes a body in space
        (`FlexibleBody.in_space`), but for this package's own files.

        Args:
            path: Where rank 0 writes, as `VolumeIntegrals.save`.
            name: Of the body; by default the only one.
            format: As `VolumeIntegrals.save`, as ``damping``.
            damping: Of the elastic coordinates, where the format holds it.

        Raises:
            ValueError: If the name is needed or not known, or the format cannot hold the body.
            OSError: If the file cannot be written.
        """
        if name is None and len(self.bodies) == 1:
            name = next(iter(self.bodies))
        if name is None or name not in self.bodies:
            raise ValueError(f"export: name = {name!r}, but the parts are {sorted(self.bodies)}")
        body, reduced = self.bodies[name]
        own = format == "npz" or (format is None and Path(path).suffix == ".npz")
        integrals = reduced.integrals if own else body.in_space(reduced)
        how: dict[str, Any] = {"format": format, "damping": damping}
        on_rank_0(body.domain.comm, lambda: integrals.save(path, **how))

    @property
    def psi(self) -> float:
        """Of the parts on the finest mesh."""
        return self.fitted[-1].psi

    @property
    def difference(self) -> float:
        """How much larger psi of the parts is than the reported one, relative to its size."""
        before = self.reported.psi
        return (self.psi - before) / abs(before) if before else 0.0

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

    @property
    def decided(self) -> bool:
        """Whether constraints stand still, or changed at last by less than they are off bounds."""
        if len(self.fitted) < 2:
            return False
        before, last = (row.excesses for row in self.fitted[-2:])
        return all(abs(v - before[n]) <= max(self.tolerance, abs(v)) for n, v in last.items())

    @property
    def violations(self) -> dict[str, float]:
        """Constraints and volumes that are more than 2 % beyond their bounds, by how much."""
        # what is not a number is no value below a bound
        return {n: over for n, over in self.fitted[-1].excesses.items() if not over <= SOFTER}

    @property
    def differences(self) -> list[str]:
        """What of the reported numbers is another one of the parts, each in words.

        psi and frequencies that differ by more than 2 %, and a largest stress by more than 10 %.
        """
        found, psi = [], (self.reported.psi, self.psi)
        if abs(self.difference) > SOFTER:
            found.append("psi {:.4g}, of the parts {:.4g}".format(*psi))
        for name, body in self.fitted[-1].bodies.items():
            before, of = self.reported.bodies[name], f"of {name!r}"
            shown = zip(before.frequencies[:_SHOWN], body.frequencies, strict=False)
            for i, (old, new) in enumerate(shown, 1):
                if abs(new - old) > _FREQUENCY * abs(old):
                    found.append(f"frequency {i} {of} {old:.4g} Hz, of the part {new:.4g} Hz")
            if before.stress is not None and body.stress is not None:
                old, new = before.stress, body.stress
                if abs(new - old) > _STRESS * old:
                    found.append(
                        f"largest stress {of} {old / 1e6:.4g} MPa, of the part {new / 1e6:.4g} MPa"
                    )
        return found

    def _told(self, name: str) -> str:
        """A constraint or a volume of the design and of the part beside its bound."""
        before, last = (row.values[name] for row in (self.reported, self.fitted[-1]))
        return f"{before:.4g} of the design, {last:.4g} of the part, {self.limits[name]}"

    def summary(self) -> str:
        """The table as text."""
        lines = [f"{'':24s} {'psi':>12s} {'vs reported':>12s}"]
        for row in (self.reported, *self.fitted):
            name = "reported (design)" if row.size is None else f"part, {1e3 * row.size:.3g} mm"
            lines.append(f"{name:24s} {row.psi:12.5e} {row.psi / self.reported.psi:12.4f}")
        state = "has converged" if self.converged else "still changes"
        change = f"last change {100 * self.change:.2g} % (tolerance {100 * self.tolerance:.2g} %)"
        lines.append(f"psi {state}: {change}" if len(self.fitted) > 1 else "psi of one mesh only")
        last = self.fitted[-1]
        for name, body in last.bodies.items():
            lines += self._told_of_body(name, self.reported.bodies[name], body)
        for name, psi in last.load_cases.items():
            before = self.reported.load_cases[name]
            share = f"{psi / before:.4f} of that"
            lines.append(f"load case {name}: psi {before:.5e} -> {psi:.5e}, {share}")
        for name, over in last.excesses.items():
            beyond = f", {100 * over:.1f} % beyond its bound" if over > 0.0 else ""
            lines.append(
                f"constraint {name}: {self.reported.values[name]:.4g} -> {last.values[name]:.4g}, "
                f"{self.limits[name]}{beyond}"
            )
        return "\n".join(lines)

    def _told_of_body(self, name: str, before: BodyFigures, after: BodyFigures) -> list[str]:
        """The lines of the summary on one body."""
        part, measures = self.parts[name], self.parts[name].measures()
        holes = measures.get("holes")
        told = "" if holes is None else f", with {holes} hole{'s' * (holes != 1)}"
        if pockets := measures.get("pockets"):
            told += f" and {pockets} pocket{'s' * (pockets != 1)}"
        lines = [
            f"{name}: {after.cells} {part.elements}, {self.modes[name]} modes; reported -> part",
            f"  pieces       {part.pieces}{told}",
        ]
        widths = {what: w.value for what, w in measures.items() if isinstance(w, Width)}
        lines += [f"  {what}: {1e3 * value:.3g} mm" for what, value in widths.items()]
        lines.append(f"  mass         {before.mass:.5g} -> {after.mass:.5g} kg")
        lines.append(f"  volume       {before.volume:.4f} -> {after.volume:.4f}")
        pairs = zip(before.frequencies[:_SHOWN], after.frequencies, strict=False)
        for i, (old, new) in enumerate(pairs, 1):
            lines.append(f"  frequency {i}  {old:.5g} -> {new:.5g} Hz")
        if before.stress is not None and after.stress is not None:
            old, new = before.stress / 1e6, after.stress / 1e6
            assert after.place is not None
            at = ", ".join(f"{1e3 * x:.4g}" for x in after.place)
            lines.append(f"  stress       {old:.4g} -> {new:.4g} MPa, at ({at}) mm")
        return lines

    def record(self) -> dict[str, Any]:
        """What the parts are worth and measure, for `write_summary`; lengths in metres.

        Values of bodies are numbers where one is designed, and by name where several are.
        """

        def of_each(values: Mapping[str, Any]) -> Any:
            return next(iter(values.values())) if len(values) == 1 else dict(values)

        last = self.fitted[-1]
        record: dict[str, Any] = {"psi_part": self.psi}
        if self.reported.load_cases:
            record["psi_part_by_load_case"] = last.load_cases
        for key in ("difference", "differences", "change", "violations"):
            record[f"part_{key}"] = getattr(self, key)
        record["part_pieces"] = of_each({name: part.pieces for name, part in self.parts.items()})
        record["part_mass"] = of_each({name: body.mass for name, body in last.bodies.items()})
        measures = {name: part.measures() for name, part in self.parts.items()}
        keys = {"holes": "part_holes", "pockets": "part_pockets"}
        for what in dict.fromkeys(what for measured in measures.values() for what in measured):
            found = {name: measured.get(what) for name, measured in measures.items()}
            record[keys.get(what, what.replace(" ", "_"))] = of_each(
                {name: v.value if isinstance(v, Width) else v for name, v in found.items()}
            )
        return record

    def __repr__(self) -> str:
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
    shares = dict(volume) if isinstance(volume, Mapping) else dict.fromkeys(parts, volume)
    there = f"but the flexible bodies are {sorted(problem.flexible)}"
    if unknown := sorted(set(shares) - set(problem.flexible) - set(parts)):
        raise ValueError(f"verify: volume is given for {unknown}, {there}")
    bounds = {
        name: validation.number(f"verify: volume of {name!r}", share, above=0.0)
        for name, share in shares.items()
        if name in parts and share is not None
    }
    if not parts or set(parts) - set(problem.flexible):
        raise ValueError(f"verify: parts for {sorted(parts)}, {there}")
    for name, part in parts.items():
        if part.lost_interfaces:
            raise ValueError(
                f"verify: the part {name!r} has no material at the interfaces "
                f"{part.lost_interfaces}, by which the problem holds it"
            )
    given = modes if isinstance(modes, Mapping) else dict.fromkeys(parts, modes)
    wanted = {name: problem.flexible[name].modes for name in parts}
    wanted |= {n: number for n, number in given.items() if n in wanted and number is not None}
    limits = {f"volume of {name}": f"at most {bound:.4g}" for name, bound in bounds.items()}
    limits |= {constraint.label: constraint.limit for constraint in problem.constraints}
    own = problem.calibrated(evaluation)
    reported = _figures(None, *own, parts, bounds)
    for name in parts:  # the factor of the design would stay beside those of its parts
        problem.flexible[name].release()
    fitted: list[Figures] = []
    every = {name: part.sizes(size, meshes) for name, part in parts.items()}
    silent = not progress or problem.comm.rank > 0
    for mesh in tqdm(range(meshes), "verify", unit="mesh", leave=False, disable=silent):
        sizes = {name: of[mesh] for name, of in every.items()}
        try:
            again = _meshed(problem, parts, sizes, order, wanted)
        except ValueError as error:
            if not fitted:
                raise
            warnings.warn(
                f"verify: psi is that of one mesh less, and may still change: {error}",
                PartWarning,
                stacklevel=2,
            )
            if len(fitted) == 1:  # its stress was left to finer ones
                fitted = [_figures(fitted[0].size, *own, parts, bounds)]
            break
        densities = {
            name: parts[name].density(body.domain)
            if name in parts
            else evaluation.bodies[name].density
            for name, body in again.flexible.items()
        }
        # solids whose surface was moved are told by their first meshes
        of = {name: (again.flexible[name], problem.flexible[name]) for name in parts}
        if fitted or not all(reported.bodies[n].told_by(*pair) for n, pair in of.items()):
            own = again.calibrated(again.value(densities))
        # the first mesh is never the last one, of which the stress is told
        fitted.append(_figures(max(sizes.values()), *own, parts, bounds, stressed=mesh > 0))
        last = {name: (own[0].flexible[name], own[1].bodies[name]) for name in parts}
        for body, reduced in last.values():
            body.warn_of_missing_modes(reduced)
            body.release()
        found = Verification(reported, fitted, tolerance, wanted, parts, limits, last)
        if found.converged and (found.decided or len(fitted) >= _FOR_BOUNDS):
            break
    found = Verification(reported, fitted, tolerance, wanted, parts, limits, last)
    for text in _doubts(found):
        warnings.warn(f"verify: {text}", PartWarning, stacklevel=2)
    return found


def _meshed(
    problem: Problem,
    parts: Mapping[str, Enclosed],
    sizes: Mapping[str, float],
    order: int,
    modes: Mapping[str, int],
) -> Problem:
    """The problem with parts on meshes of ``sizes`` [m]; ValueError where memory is too small."""
    bodies, cases = dict(problem.bodies), problem.load_cases.values()
    stressed = any(is_stress(each) for case in cases for each in case.objectives.values())
    for name, part in parts.items():
        given, make = problem.flexible[name], part.resolved if stressed else part.domain
        domain = make(sizes[name], order)
        domain.whole = given.domain.whole or given.domain
        bodies[name] = body = given.with_domain(domain).with_modes(modes[name])
        body.check_memory(
            f"verify: a mesh of {name!r} with cells of {1e3 * sizes[name]:.3g} mm",
            'give a larger size, or solver="iterative" to the body',
        )
    return problem.with_bodies(bodies)


def _doubts(found: Verification) -> Iterator[str]:
    """Warnings: where psi still changes, is larger than reported, or a bound is exceeded."""
    if not found.converged and len(found.fitted) > 1:
        before, last = (1e3 * (row.size or 0.0) for row in found.fitted[-2:])
        elements = next(iter(found.parts.values())).elements
        yield (
            f"psi still changes by {100 * found.change:.2g} % from {elements} of {before:.3g} mm "
            f"to {last:.3g} mm; give a smaller size or more meshes (most=), or look for members "
            "thinner than that"
        )
    if found.difference > SOFTER:
        yield (
            f"psi is {100 * found.difference:.1f} % above what was reported: elements bridge a "
            "member that is broken or thinner than they are, or are coarse themselves. Look at "
            "the picture of the part; design with a larger minimum_member, on smaller elements, "
            "or from another start"
        )
    if found.differences:
        yield (
            f"what was reported is not what the parts have: {'; '.join(found.differences)}. The "
            "values of the parts are the ones to go by; smaller elements, or steps of the "
            "boundary, bring both together"
        )
    for name, over in found.violations.items():
        before = found.reported.excesses[name]
        remedy = (
            "design with a bound that much tighter"
            if before <= SOFTER
            else f"the design exceeds it by {100 * before:.1f} % itself: more iterations, another "
            "start or another bound"
        )
        yield (
            f"the part violates {name!r} by {100 * over:.1f} % of the bound "
            f"({found._told(name)}); {remedy}"
        )


def _figures(
    size: float | None,
    problem: Problem,
    evaluation: Evaluation,
    parts: Mapping[str, Enclosed],
    bounds: Mapping[str, float],
    *,
    stressed: bool = True,
) -> Figures:
    """The figures of one problem; ``bounds`` are those of the bodies' volumes."""
    bodies = {}
    for name, part in parts.items():
        body, reduced = problem.flexible[name], evaluation.bodies[name]
        domain, mass = body.domain, reduced.integrals.mass
        worst = worst_stress(body, evaluation, name) if stressed and evaluation.moves else None
        stress = (worst.largest, worst.largest_position) if worst else (None, None)
        share = domain.sum(reduced.density * domain.cell_volumes) / part.body.area
        held = evaluation.fixed_interface_frequencies[name]
        bodies[name] = BodyFigures(domain.n_cells_global, mass, share, held, *stress)
    constraints = {name: float(bound.value) for name, bound in evaluation.constraints.items()}
    excesses = {f"volume of {n}": bodies[n].volume / bound - 1.0 for n, bound in bounds.items()}
    excesses |= {name: float(bound.violation) for name, bound in evaluation.constraints.items()}
    load_cases = {name: float(case.psi) for name, case in evaluation.load_cases.items()}
    several = load_cases if len(load_cases) > 1 else {}
    with on_every_rank(problem.comm, "verify"):
        return Figures(size, float(evaluation.psi), constraints, bodies, several, excesses)
