# SPDX-License-Identifier: MIT
"""A lower bound of psi for every part within the body of a design."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from .. import validation
from ..arrays import Array
from ..body import VolumeIntegrals
from ..documentation import Shown
from ..objective import IntegralCompliance, PowerMean, WeightedSum, WorstCase
from ..parallel import on_every_rank
from ..problem import Problem
from .certificate import least_over_points, refuse_curved_cells
from .quasi_static import Driven, QuasiStatic, StaticBody
from .sheet import best_sheet

#: Difference of the sheet's psi and its bound over densities of cells at which the search ends,
#: relative to psi. With 1e-3 to 8e-3 the bound of a rod of 200 x 20 elements is the same to 0.1 %,
#: as integration over points, for which cells are too coarse, takes 1 % of it.
_TOLERANCE = 4e-3
#: Steps of a search at most; rods take 20 to 60
_STEPS = 200
#: Relative difference of psi with and without vibrations from which on these count. Where the full
#: rod of the slider-crank has 1.8 %, by a faster crank, the best sheet and a rod of two flanges,
#: which are near the bound, have 0.5 %. A thin strip, far above it, has 9 %: upwards, as all.
_VIBRATIONS = 0.02
WORK = "a lower bound"  #: The name of the sections in messages


@dataclass(frozen=True, eq=False, repr=False)
class LowerBound(Shown):
    """A value of psi that no part of the same material within the same outline can fall below.

    It holds for all parts, of whatever shape and topology, also with pockets, which keep what stays
    solid and the bound of the volume, in the model of the problem and without vibrations.

    Attributes:
        psi: No part has less [unit of the objective].
        full: Psi of the full bodies without vibrations.
        sheet: Density of this rank's cells of the best sheet of variable thickness, by body, shape
            (cells,).
        sheet_psi: psi of this sheet without vibrations, on its mesh.
        sheet_volume: Filled share of each body's area that the sheet has.
        volume: Upper bounds of the filled shares that it holds for, by body.
        vibrations: Relative change of the full bodies' psi by vibrations.
    """

    psi: float
    full: float
    sheet: dict[str, Array] = field(repr=False)
    sheet_psi: float
    sheet_volume: dict[str, float]
    volume: dict[str, float]
    vibrations: float

    def _shown(self) -> list[tuple[str, str, str]]:
        shares = ", ".join(f"{share:.1%} of {name}" for name, share in self.sheet_volume.items())
        return [
            ("no part has less than", f"{self.psi:.6g}", f"{self.psi / self.full:.3f} of full"),
            ("best sheet", f"{self.sheet_psi:.6g}", f"{self.sheet_psi / self.full:.3f} of full"),
            ("volume of the sheet", shares, ""),
            ("vibrations", f"{self.vibrations:+.1e}", "of the full bodies' psi"),
        ]

    def gap(self, psi: float) -> float:
        """Relative gap of a value ``psi`` of a part above the bound."""
        return psi / self.psi - 1.0

    def record(self, psi: float) -> dict[str, float | str]:
        """Bound and gap of a part with the value ``psi``, for `write_summary`."""
        numbers = {"psi": self.psi, "full": self.full, "gap": self.gap(psi)}
        return {**numbers, "sheet": self.sheet_psi, "text": self.sentence(psi)}

    def sentence(self, psi: float) -> str:
        """Bound and gap of a part with the value ``psi``, in words."""
        names = list(self.sheet)
        if len(names) == 1:
            parts, whose = "no part of this material within this outline has", f"full {names[0]}'s"
            design = "this one is"
        else:
            parts = "no parts of these materials within these outlines have"
            whose, design = "full bodies'", "these are"
        above = f"{design} at most {100.0 * self.gap(psi):.2g} % above"
        if psi < self.psi:
            above = "what has less is gray, or its mesh is too coarse"
        return f"{parts} less than {self.psi / self.full:.3f} of the {whose} psi: {above}"


def bound(problem: Problem, *, volume: float | Mapping[str, float] | None = None) -> LowerBound:
    """A lower bound of psi for all parts in the place of the flexible bodies; collective.

    It takes a fraction of the time of a design: the best sheet of variable thickness is a convex
    problem, and its displacements give a bound for every point, not only for cells of the mesh.
    Constraints leave it valid, as they only exclude parts.

    Args:
        problem: Problem of a driven machine, whose objectives are `IntegralCompliance`.
        volume: Upper bound of the filled share of the body, in (0, 1], as for `optimize`; for
            several bodies one for all or a mapping by name. None is no bound.

    Raises:
        ValueError: On every rank, where the reasoning does not hold: the rigid motion depends on
            the parts, vibrations count, an objective is another one, a body has geometric
            stiffness, a mesh has curved cells, or is so coarse that the bound is not above zero.
    """
    validation.instance("bound: the problem", problem, Problem, "a Problem")
    with on_every_rank(problem.comm, WORK):
        shares = _shares(problem, volume)
        _refuse(problem)
    for body in problem.flexible.values():
        refuse_curved_cells(body.domain)
    full = problem.value({n: 1.0 - b.domain.void_cells for n, b in problem.flexible.items()})
    with on_every_rank(problem.comm, WORK):
        cases = {name: Driven(problem, full, name) for name in problem.load_cases}
    bodies = {name: StaticBody.sheet(body) for name, body in problem.flexible.items()}
    solid = QuasiStatic.at(bodies, cases, {n: body.density for n, body in full.bodies.items()})
    static = problem.combine.value(solid.psi)
    if not static > 0.0:
        raise ValueError("bound: nothing loads the bodies, and psi is zero")
    vibrations = full.psi / static - 1.0
    if abs(vibrations) > _VIBRATIONS:
        raise ValueError(
            "bound: vibrations or truncated modes change psi of the full bodies: it is "
            f"{full.psi:.4g}, but {static:.4g} without vibrations; there is a bound only where "
            "both agree to 2 %"
        )
    sheet, support = best_sheet(bodies, cases, shares, problem.combine, _TOLERANCE, _STEPS)
    psi = least_over_points(support, bodies, shares)
    if not psi > 0.0:
        raise ValueError("bound: the bound is not above zero on this mesh; take smaller elements")
    for static_body in bodies.values():
        static_body.body.release()
    return LowerBound(
        psi=psi,
        full=static,
        sheet=dict(sheet.densities),
        sheet_psi=problem.combine.value(sheet.psi),
        sheet_volume={n: b.body.volume(sheet.densities[n])[0] for n, b in bodies.items()},
        volume=shares,
        vibrations=vibrations,
    )


def _shares(problem: Problem, volume: float | Mapping[str, float] | None) -> dict[str, float]:
    """The bounds of the volume by body, checked."""
    if volume is None:
        return {}
    by_body = volume if isinstance(volume, Mapping) else dict.fromkeys(problem.flexible, volume)
    shares = {}
    for name, share in validation.by_name("bound: volume", by_body, "shares").items():
        validation.choice("bound: volume of body", name, problem.flexible)
        what = f"bound: volume of {name!r}"
        shares[name] = validation.number(what, share, above=0.0, most=1.0)
        domain = problem.flexible[name].domain
        least = domain.sum(domain.cell_volumes * domain.solid_cells) / domain.area
        if shares[name] < least:
            raise ValueError(
                f"{what} is {share:g}, but the solid regions take {least:.3g}; give a larger volume"
            )
    return shares


def _refuse(problem: Problem) -> None:
    """Refuse, by a ValueError, problems for which the bound does not hold."""
    if problem.parameters is not None:
        raise ValueError(
            "bound: the mechanism has parameters, so that the rigid motion is designed, too, and "
            "psi is not convex; make the mechanism with their values"
        )
    if not isinstance(problem.combine, WeightedSum | PowerMean | WorstCase):
        raise ValueError(
            f"bound: {type(problem.combine).__name__} need not be convex; there is a bound for "
            "WeightedSum, PowerMean and WorstCase"
        )
    for name, body in problem.flexible.items():
        if body.stiffening is not None:
            raise ValueError(
                f"bound: body {name!r} has geometric stiffness, which makes psi not convex; leave "
                "the stiffening out"
            )
    for case in problem.load_cases.values():
        objective = case.objective
        if type(objective) is not IntegralCompliance:
            raise ValueError(
                f"bound: the objective is {type(objective).__name__}; there is a bound for "
                "IntegralCompliance alone"
            )
        for name in objective.bodies or problem.bodies:
            counted = problem.bodies[name]
            if isinstance(counted, VolumeIntegrals) and counted.modes:
                raise ValueError(
                    f"bound: the objective contains the compliance of {name!r}, whose stiffness is "
                    "known only as a matrix; leave this body out of the objective by bodies=[...]"
                )
