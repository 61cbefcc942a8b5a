# SPDX-License-Identifier: MIT
"""Steps of boundaries that are fields."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import shapely
from shared.problems import slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr import Constraint, Mass, PartWarning, PeakStress, Problem, worst_stress
from dolfinx_ffr.arrays import Array, Mask
from dolfinx_ffr.boundary_field import (
    FieldOptions,
    FieldSpace,
    PlaneBoundary,
    first_field,
    mended,
    redistanced,
)
from dolfinx_ffr.design import Mirror
from dolfinx_ffr.optimization import BoundaryResult
from dolfinx_ffr.optimization.checkpoint import Checkpoint
from dolfinx_ffr.optimization.field_phase import moved_fields
from dolfinx_ffr.optimization.field_steps import FieldSteps
from dolfinx_ffr.optimization.field_topology import with_better_topology
from dolfinx_ffr.optimization.field_trial import FieldProblem
from dolfinx_ffr.part import outline_violations

MEMBER, MOST = 6e-3, 0.85


def test_steps_lower_psi_within_sizes_and_the_volume_and_keep_the_mirror_line() -> None:
    problem = slider_crank(MPI.COMM_SELF, (40, 4), steps=100)
    domain = problem.flexible["rod"].domain
    mirror = Mirror((0.2, 0.0), (0.0, 1.0))
    space = FieldSpace.of(domain, MEMBER, MEMBER, mirrors=[mirror])
    holes = shapely.union_all([shapely.Point(x, 0.0).buffer(0.009) for x in (0.1, 0.2, 0.3)])
    field = PlaneBoundary.of_material(space, domain.outline.difference(holes))
    own = FieldProblem(problem, {"rod": MOST}, {}, FieldOptions())
    start = own.trial({"rod": mended(redistanced(field), MEMBER)})
    assert start.violation > 0.05  # far too much material
    steps = FieldSteps(own, start, mode_tolerance=None)
    for _ in zip(range(3), steps, strict=False):
        pass

    best = steps.best
    assert best.feasible and best.violations["volume of rod"] < 2e-3
    feasible = [row["psi"] for row in steps.history if row["excess"] < 2e-3]
    assert best.evaluation.psi <= min(feasible) * (1.0 + 1e-12)
    assert len(steps.history) == 4
    part = best.fields["rod"].part
    thinnest = part.thinnest_member
    assert thinnest is not None and thinnest.value > 0.99 * MEMBER
    image = shapely.affinity.scale(part.polygon, yfact=-1.0, origin=(0.0, 0.0))
    # the field is its own image to round-off, and curves are where they interpolate it
    difference = image.symmetric_difference(part.polygon)
    assert difference.area < 1e-3 * MEMBER * part.polygon.length


def test_a_trial_that_falls_apart_is_taken_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reach is halved until the part holds together."""
    problem = slider_crank(MPI.COMM_SELF, (40, 4), steps=100)
    domain = problem.flexible["rod"].domain
    # no member and no hole promises so much that it is tried
    options = FieldOptions(promised=np.inf, idle=-np.inf)
    space = FieldSpace.of(domain, MEMBER, MEMBER, options=options)
    gap = shapely.box(0.15, -0.03, 0.25, 0.007)
    field = redistanced(PlaneBoundary.of_material(space, domain.outline.difference(gap)))
    own = FieldProblem(problem, {}, {}, options)
    steps = FieldSteps(own, own.trial({"rod": field}), mode_tolerance=None)
    before = steps.trial.evaluation.psi
    calls = []
    tried = FieldProblem.trial

    def failing(self, fields):  # type: ignore[no-untyped-def]
        calls.append(len(calls))
        if len(calls) < 3:  # a translation, and the first step
            torn = field.with_variables(np.full(space.grid.size, -1.0))
            return tried(self, {"rod": torn})
        return tried(self, fields)

    monkeypatch.setattr(FieldProblem, "trial", failing)
    next(steps)
    assert steps.history[-1]["rejected"] == 1.0 and len(calls) == 3
    assert steps.trial.evaluation.psi < before


def test_a_full_rod_is_pierced_where_psi_falls_by_a_hole() -> None:
    problem = slider_crank(MPI.COMM_SELF, (40, 4), steps=100)
    domain = problem.flexible["rod"].domain
    space = FieldSpace.of(domain, MEMBER, MEMBER, mirrors=[Mirror((0.2, 0.0), (0.0, 1.0))])
    own = FieldProblem(problem, {}, {}, FieldOptions())
    full = own.trial({"rod": PlaneBoundary.of_material(space, domain.outline)})
    assert full.fields["rod"].part.holes == 0
    pierced = with_better_topology(own, full, own.gradients(full), np.zeros(0), 1.5)
    assert pierced.fields["rod"].part.holes > 0
    assert pierced.evaluation.psi < 0.99 * full.evaluation.psi


def rod_with_eyes(rim: float) -> ffr.Domain:
    """A rod of 150 mm with a bore of 18 mm in each of its eyes, and what stays around them."""
    ends = shapely.MultiPoint([(0.0, 0.0), (0.15, 0.0)])
    shape = shapely.box(0.0, -0.014, 0.15, 0.014).union(ends.buffer(0.02))

    def bore(x0: float) -> Callable[[Array], Mask]:
        return lambda x: np.abs(np.hypot(x[0] - x0, x[1]) - 0.009) < 2e-4

    return ffr.Domain.from_outline(
        MPI.COMM_SELF,
        shape.difference(ends.buffer(0.009)),
        interfaces={"left": bore(0.0), "right": bore(0.15)},
        size=5e-3,
        solid_rim=rim,
    )


def swung(domain: ffr.Domain) -> ffr.Problem:
    """The compliance of a rod between a crank and a line."""
    steel = ffr.PlaneStress(210e9, 0.3, 7850.0, 0.01)
    body = ffr.FlexibleBody(domain, steel, frame=ffr.ChordFrame("left", "right"), modes=3)
    crank = ffr.Moving.circle((0, 0), 0.04, ffr.Motion.smooth_step(4 * np.pi, 1.0))
    mechanism = ffr.Mechanism(
        {"rod": ffr.Placement((0.04, 0.0))},
        [ffr.Revolute(("rod", "left"), crank), ffr.PointOnLine(("rod", "right"), ffr.Ground())],
        point_masses=[ffr.PointMass(("rod", "right"), 0.5)],
    )
    return ffr.Problem(
        {"rod": body}, mechanism, ffr.RadauIIA(1.0, steps=20), ffr.IntegralCompliance()
    )


@pytest.mark.parametrize(("rim", "member"), [(4e-3, 4e-3), (3e-3, 5e-3), (8e-3, 4e-3)])
def test_the_first_field_of_a_rod_with_eyes_has_its_sizes_volume_and_rims(
    rim: float, member: float
) -> None:
    """From a design that is too thin in places, and that fills too much."""
    part = rod_with_slits(rod_with_eyes(rim), member).part
    assert part.area <= MOST * part.body.area * (1.0 + 2e-3)
    thinnest = part.thinnest_member
    assert thinnest is not None and thinnest.value > 0.99 * member
    assert outline_violations(part, member, member) == []


def rod_with_slits(domain: ffr.Domain, member: float) -> PlaneBoundary:
    """The first field of such a rod."""
    space = FieldSpace.of(domain, member, member, rim=member, volume=MOST)
    slits = [
        shapely.box(0.035, -0.014 + 0.7 * member, 0.075, 0.014 - 0.7 * member),
        shapely.box(0.075 + 0.7 * member, -0.004, 0.13, 0.004),
    ]
    return first_field(space, domain.outline.difference(shapely.union_all(slits)))


def test_a_step_of_a_rod_with_eyes_keeps_sizes_volume_and_rims() -> None:
    domain, member = rod_with_eyes(3e-3), 5e-3
    # no other topology is tried
    options = FieldOptions(promised=np.inf, idle=0.0, small_void=0.0)
    own = FieldProblem(swung(domain), {"rod": MOST}, {}, options)
    start = own.trial({"rod": rod_with_slits(domain, member)})
    steps = FieldSteps(own, start, mode_tolerance=None)
    after = next(steps)
    assert after.feasible and after.evaluation.psi < 0.99 * start.evaluation.psi
    part = after.fields["rod"].part
    thinnest = part.thinnest_member
    assert thinnest is not None and thinnest.value > 0.99 * member
    assert outline_violations(part, member, member) == []


@pytest.mark.slow
def test_steps_of_fields_go_on_from_a_checkpoint_and_keep_a_stress_below_its_bound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Least mass; after two steps a run ends exactly as it did, on a mesh that resolves notches."""
    given = slider_crank(MPI.COMM_SELF, (40, 4), steps=60)
    space = FieldSpace.of(given.flexible["rod"].domain, MEMBER, MEMBER)
    holes = shapely.MultiPoint([(x, 0.0) for x in (0.1, 0.2, 0.3)]).buffer(0.009)
    field = redistanced(PlaneBoundary.of_material(space, space.body.outline.difference(holes)))
    parts = given.bodies, given.mechanism, given.integrator
    start = FieldProblem(given, {}, {}, FieldOptions()).trial({"rod": field})
    largest = worst_stress(start.problem.flexible["rod"], start.evaluation, "rod").largest
    limit = Constraint(PeakStress("rod"), upper=1.1 * largest, name="stress")
    problem = Problem(*parts, Mass("rod"), constraints=[limit])

    def run(checkpoint: Checkpoint) -> BoundaryResult:
        checkpoint._sections.setdefault("design", {"x": np.zeros(1)})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PartWarning)
            return moved_fields(problem, {"rod": field}, {}, {}, 3, None, False, checkpoint)

    save, files = Checkpoint.save, []

    def saved_too(self: Checkpoint, phase: str, state: Any) -> None:
        save(self, phase, state)
        files.append((tmp_path / "checkpoint").read_bytes())

    monkeypatch.setattr(Checkpoint, "save", saved_too)
    whole = run(Checkpoint(MPI.COMM_SELF, tmp_path / "checkpoint", False))
    (tmp_path / "checkpoint").write_bytes(files[1])
    again = Checkpoint(MPI.COMM_SELF, tmp_path / "checkpoint", True)
    assert again.read()
    rest = run(again)
    for name, column in whole.history.items():
        np.testing.assert_array_equal(rest.history[name], column, name)
    assert len(whole.history["psi"]) >= 5 and whole.psi < whole.history["psi"][0]
    assert whole.history["excess"][-1] < 0.05
    # the mesh that tells the result is finer in notches
    assert whole.history["cells"][-1] > 1.5 * whole.history["cells"][-2]
    assert whole.part("rod").pieces == 1
