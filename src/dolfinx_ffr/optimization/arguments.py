# SPDX-License-Identifier: MIT
"""The arguments of `optimize`, checked before anything is computed, with defaults in place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array
from ..design import Design, ParameterDesign, Variables
from ..fem import PLATE, Domain
from ..mechanism import Parameters
from ..objective import PeakStress
from ..parallel import check_alike
from ..problem import Problem
from .loop import Callback, GradientMethod, Optimizer
from .mma import MMA
from .result import warn
from .sizing import Sizing, sized

#: Filled share by default
VOLUME = 0.5
#: Most steps of boundaries by default
MOST_BOUNDARY_STEPS = 25


@dataclass(frozen=True)
class RunSettings:
    """What a run designs, from where, and below which volume."""

    problem: Problem
    designs: dict[str, Variables]
    domains: dict[str, Domain]
    begin: dict[str, Array]  #: Variables of the start by design
    filled: dict[str, float]  #: Bounds of the volume by body
    sizing: tuple[Sizing, Any] | None  #: Problem and design of dimensions, None without them
    tuned: bool  #: Whether parameters of the mechanism are designed
    folder: Path | None
    steps: int  #: Of the boundary


def checked(
    comm: MPI.Comm,
    problem: Problem,
    design: Any,
    start: Any,
    *,
    optimizer: Optimizer | None,
    volume: float | Mapping[str, float],
    gradient: GradientMethod | None,
    iterations: int,
    output: str | Path | None,
    resume: bool,
    progress: bool,
    callback: Callback | None,
    mode_tolerance: float | None,
    boundary: int | None,
) -> RunSettings:
    """The run that the arguments of `optimize` describe, or an error if they do not fit."""
    check_alike(
        comm,
        "optimize",
        {
            "iterations": iterations,
            "volume": volume,
            "resume": resume,
            "output": output is not None,
            "optimizer": optimizer,
            "gradient": gradient,
            "mode_tolerance": mode_tolerance,
            "boundary": boundary,
        },
    )
    iterations = validation.integer("optimize: iterations", iterations)
    if boundary is not None:
        validation.integer("optimize: boundary", boundary)
    validation.flag("optimize: resume", resume)
    validation.flag("optimize: progress", progress)
    folder = None if output is None else validation.path("optimize: output", output)
    if resume and output is None:
        raise ValueError(
            "optimize: resume=True needs the folder of the checkpoint: give it as output"
        )
    if callback is not None:
        takes = "iteration, density and evaluation"
        validation.function("optimize: callback", callback, takes)
    if gradient is not None:
        members = ("__call__", "exact")
        validation.implementation("optimize: gradient", gradient, members, "ExactAdjoint()")
    if mode_tolerance is not None:
        validation.number("optimize: mode_tolerance", mode_tolerance, above=0.0)
    is_exact = gradient is None or gradient.exact

    # what is designed
    design = _with_parameters(problem, design)
    sizing = sized(problem, design)
    if sizing is not None:
        _check_sizing(sizing[0], optimizer, volume, gradient)
    designs = _by_body(*(sizing or (problem, design)))
    tuned = any(isinstance(entry, ParameterDesign) for entry in designs.values())
    if tuned and not is_exact:
        raise ValueError("optimize: parameters take the exact gradient")
    if optimizer is not None:
        needed = "LevelSetEvolution(...) or MMA(...)"
        validation.implementation("optimize: optimizer", optimizer, ("run",), needed)
    problem = _of_plates(problem, designs, optimizer)
    domains = {name: d.domain for name, d in designs.items() if isinstance(d, Design)}

    steps = boundary or 0
    if boundary is None and is_exact and _are_flat(problem, domains):
        steps = default_steps(iterations)
    if steps and not (isinstance(problem, Problem) and domains):
        raise ValueError(
            "optimize: only the boundary of a Problem with densities can be moved; give boundary=0"
        )
    return RunSettings(
        problem=problem if sizing is None else sizing[0],  # type: ignore[arg-type]
        designs=designs,
        domains=domains,
        begin=_starts(comm, designs, start),
        filled=_volumes(domains, volume),
        sizing=sizing,
        tuned=tuned,
        folder=folder,
        steps=steps,
    )


def default_steps(iterations: int) -> int:
    """The default number of boundary steps for a number of iterations on the elements."""
    return min(iterations // 2, MOST_BOUNDARY_STEPS)


def _are_flat(problem: Problem, domains: Mapping[str, Domain]) -> bool:
    """Whether all designed domains are plane, and there is one."""
    return isinstance(problem, Problem) and {d.dimension for d in domains.values()} == {2}


def _check_sizing(
    sizing: Sizing,
    optimizer: Optimizer | None,
    volume: float | Mapping[str, float],
    gradient: GradientMethod | None,
) -> None:
    """Refuse what a design by dimensions does not take."""
    has_volume = not sizing.flexible and volume != VOLUME
    if has_volume or gradient or not isinstance(optimizer, MMA | None):
        raise ValueError(
            "optimize: a design by dimensions needs MMA, the exact gradient, and no volume; bound "
            "the material by a constraint, ffr.Constraint(ffr.Mass(name), upper=...)"
        )


def _starts(
    comm: MPI.Comm,
    designs: Mapping[str, Variables],
    start: ArrayLike | Mapping[str, ArrayLike] | None,
) -> dict[str, Array]:
    """The variables with which each design begins."""
    if start is None:
        start = {name: design.even() for name, design in designs.items()}
    by_design = start if isinstance(start, Mapping) else dict.fromkeys(designs, start)
    _check_names("start", by_design, designs)
    begin = {name: validation.numbers("optimize: start", by_design[name]) for name in designs}
    check_alike(comm, "optimize", {f"the start of {n!r}": x for n, x in begin.items()})
    return begin


def _volumes(
    domains: Mapping[str, Domain], volume: float | Mapping[str, float]
) -> dict[str, float]:
    """The upper bound of the filled share of each body."""
    bounds = volume if isinstance(volume, Mapping) else dict.fromkeys(domains, volume)
    _check_names("volume", bounds, domains)
    return {
        name: validation.number(f"optimize: volume of {name!r}", bounds[name], above=0.0, most=1.0)
        for name in domains
    }


def _check_names(argument: str, by_name: Mapping[str, Any], designs: Mapping[str, Any]) -> None:
    """Refuse an argument that is not given for exactly the designs."""
    if set(by_name) != set(designs):
        raise ValueError(
            f"optimize: {argument} is given for {sorted(by_name)}, and the designs are of "
            f"{sorted(designs)}"
        )


def _of_plates(
    problem: Problem, designs: Mapping[str, Variables], optimizer: Optimizer | None
) -> Problem:
    """The problem with stiffness and mass in proportion to the thickness of designs with a web.

    A ValueError is raised if that is not so, or if the web would not matter.
    """
    webs = [n for n, design in designs.items() if isinstance(design, Design) and design.web]
    if not webs:
        return problem
    named = ", ".join(map(repr, webs))
    if optimizer is not None and not isinstance(optimizer, MMA):
        raise ValueError(f"optimize: the web of {named} takes MMA(...), not {optimizer!r}")
    for name in webs:
        if problem.flexible[name].material.out_of_plane:
            raise ValueError(
                f"optimize: the web of {name!r} is for plane stress, in which stiffness and mass "
                "are in proportion to the thickness; give the body PlaneStress(...), or leave the "
                "web out"
            )
    objectives = [case.objective for case in problem.load_cases.values()]
    objectives += [constraint.objective for constraint in problem.constraints]
    for term in (term for objective in objectives for _, term in objective._summands()):
        if isinstance(term, PeakStress) and term.body in webs and term.relaxation:
            raise ValueError(
                f"optimize: PeakStress({term.body!r}) would count only a share of the stress in "
                "the web; give it relaxation=0"
            )
    plates = {name: problem.flexible[name].with_interpolation(PLATE) for name in webs}
    return problem.with_bodies(plates)


def _with_parameters(
    problem: Problem, design: Variables | Parameters | Mapping[str, Variables | Parameters]
) -> Variables | Mapping[str, Variables]:
    """The designs with parameters as variables, or an error if the problem has others."""
    if isinstance(design, Parameters) and not problem.flexible:
        design = {"parameters": design}
    by_name = design if isinstance(design, Mapping) else {"": design}
    parameters = {name: entry for name, entry in by_name.items() if isinstance(entry, Parameters)}
    expected = getattr(problem, "parameters", None)
    for name, entry in parameters.items():
        if expected is None or not entry.fits(expected):
            raise ValueError(
                f"optimize: {name or 'the design'!r} has the parameters {entry.names}, but the "
                f"mechanism of the problem has {'none' if expected is None else expected.names}, "
                "or other bounds; make the mechanism by parameters.mechanism(...)"
            )
        if name in problem.bodies or len(parameters) > 1:
            raise ValueError(
                f"optimize: give the parameters once, and not by the name of a body, {name!r}"
            )
    if not parameters:
        if expected is not None:
            warn(
                f"optimize: the parameters {expected.names} of the mechanism keep their values, as "
                "no design is given for them; give a mapping, as {'rod': design, 'machine': "
                "problem.parameters}, to design them, too, or make the mechanism without them",
            )
        return design  # type: ignore[return-value]
    return {n: ParameterDesign(p) if n in parameters else p for n, p in by_name.items()}  # type: ignore[misc, arg-type]


def _by_body(problem: Problem, design: Variables | Mapping[str, Variables]) -> dict[str, Variables]:
    """The designs in the order of the problem's bodies, and then those without a domain."""
    names = list(problem.flexible)
    if isinstance(design, Mapping):
        without_domain = [
            n for n, entry in design.items() if n not in names and not isinstance(entry, Design)
        ]
        if set(design) != {*names, *without_domain} or not design:
            raise ValueError(
                f"optimize: designs are given for {sorted(design)}, and the problem has {names}"
            )
        by_body = {name: design[name] for name in [*names, *without_domain]}
    elif len(names) != 1:
        raise ValueError(
            f"optimize: one design designs one body, and the problem has {sorted(names)}; give a "
            "mapping from name to design, or some bodies as VolumeIntegrals"
        )
    else:
        by_body = {names[0]: design}
    for name, entry in by_body.items():
        label = f"optimize: the design of {name!r}"
        if name in names:
            validation.instance(label, entry, Design, "a LevelSet or a DensityDesign")
        else:
            validation.instance(label, entry, Variables, "Variables")
        if not isinstance(entry, Design):
            continue
        if entry.domain is not problem.flexible[name].domain:
            raise ValueError(
                f"optimize: the design of {name!r} is not on the domain of the problem's body; "
                f"make it on problem.bodies[{name!r}].domain"
            )
        # with a web there is a rim along all of the outline
        undefended = [] if entry.web else entry.domain.designed_interfaces
        if entry.hole_rim:
            undefended = [
                interface for interface in undefended if not entry.domain.on_hole(interface)
            ]
        if undefended:
            warn(
                f"optimize: no cell of {name!r} along {', '.join(map(repr, undefended))} stays "
                "solid, so that the design may lose all material there and enclose no part; keep "
                "cells along each interface solid (Domain(..., solid=...))",
            )
    return by_body
