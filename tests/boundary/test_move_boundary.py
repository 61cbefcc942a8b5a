# SPDX-License-Identifier: MIT
"""Moving the boundary of a part: its derivative, its sizes, its bounds."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

from mpi4py import MPI

import numpy as np
import pytest
import shapely
from PIL import Image
from scipy.spatial import cKDTree
from shapely.affinity import affine_transform
from slider_crank import STEEL, reference_problem

import dolfinx_ffr as ffr
from dolfinx_ffr.boundary import Boundary, PlaneGeometry
from dolfinx_ffr.boundary import geometry as geometry_module
from dolfinx_ffr.boundary.derivative import CurveMotion
from dolfinx_ffr.boundary.holes import joined
from dolfinx_ffr.boundary.sizes import Rows, radius_rows, size_rows
from dolfinx_ffr.boundary.spread import spread
from dolfinx_ffr.boundary.step import best_step
from dolfinx_ffr.fem import CurveError
from dolfinx_ffr.io import load_checkpoint, save_checkpoint
from dolfinx_ffr.optimization import BoundaryResult, move_boundary
from dolfinx_ffr.optimization import descent as descent_module
from dolfinx_ffr.optimization.checkpoint import Checkpoint
from dolfinx_ffr.optimization.descent import Descent, Trial

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

MEMBER = 2e-3
CENTERS = np.linspace(0.04, 0.32, 8)


def field(x: np.ndarray) -> np.ndarray:
    """Round holes of 12 mm along the middle of the rod, one touches the solid end."""
    holes = np.array([*CENTERS, 0.378])
    distance = np.hypot(x[:, :1] - holes, x[:, 1:2] - 1e-3 * np.sin(np.arange(len(holes))))
    return np.min(distance, axis=1) - 0.011


@functools.cache
def scene(alone: bool = False) -> tuple[ffr.Problem, Boundary]:
    comm = MPI.COMM_SELF if alone else MPI.COMM_WORLD
    problem = reference_problem(comm, (40, 4), steps=60, modes=3)
    body = problem.flexible["rod"]
    part = ffr.Part(body.domain, field, 0.01, material=body.material)
    return problem, Boundary.of(part, MEMBER)


def test_what_stays_and_what_moves() -> None:
    _, boundary = scene(alone=True)
    closed = [curve for curve in boundary.free.values() if curve.closed]
    assert len(closed) == len(CENTERS) + 1  # the one beside the solid end is closed, too
    assert len(boundary.free) == len(closed) + 2
    material = boundary.material
    assert material.is_valid
    assert len(material.interiors) == len(closed)
    # controls are a quarter of a minimum member off the solid end
    for curve in closed:
        x = curve.at(np.linspace(0.0, curve.spans, 300))
        assert np.min(x[:, 0]) > 0.0
        assert np.max(x[:, 0]) < 0.38 - 0.24 * MEMBER


@pytest.mark.parametrize("outline", [True, False])
def test_no_notch_where_a_side_meets_a_solid_end(outline: bool) -> None:
    """A strip of half the height between solid ends: each side runs on to the outline's corners."""
    problem, _ = scene(alone=True)
    body = problem.flexible["rod"].domain
    strip = ffr.Part(body, lambda x: 0.01 - np.abs(x[:, 1]), 0.01)
    made = Boundary.of(strip, MEMBER, outline=outline)
    assert len(made.free) == 2
    for curve in made.free.values():
        assert np.abs(curve.control[[0, -1], 1]) == pytest.approx(0.02)
        assert curve.smallest_radius > 2.0 * made.radius
    ring = np.asarray(made.material.exterior.coords)[:-1]
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    turn = np.angle((after @ [1.0, 1.0j]) / (before @ [1.0, 1.0j]))
    turn *= np.sign(np.sum(turn))
    assert np.min(turn) > -0.2
    assert made.part.domain(0.01).area == pytest.approx(made.material.area, rel=1e-3)


def shifted(boundary: Boundary, offsets: np.ndarray) -> Boundary:
    """With its controls moved along their normals, wherever that is."""
    free = {}
    for key, curve in boundary.free.items():
        part = slice(boundary.first[key], boundary.first[key] + len(curve.control))
        free[key] = curve.moved(curve.control + offsets[part, None] * boundary.normals[part])
    return replace(boundary, free=free)


def psi(problem: ffr.Problem, boundary: Boundary) -> tuple[ffr.Problem, ffr.Evaluation]:
    domain = boundary.part.domain(3.2 * MEMBER, across=1.2)
    moved = problem.with_bodies({"rod": problem.flexible["rod"].with_domain(domain)})
    return moved, moved.value(np.ones(domain.n_cells))


@pytest.mark.slow
@pytest.mark.mpi
def test_the_derivative_on_several_ranks_is_that_of_parts_meshed_anew() -> None:
    """Beside differences over new meshes; their own noise is some 1e-5 of psi."""
    problem, boundary = scene()
    here, evaluation = psi(problem, boundary)
    evaluation = here.differentiate(evaluation, nodes=True)
    assert evaluation.nodes is not None
    slope = CurveMotion(boundary, here.flexible["rod"].domain).pullback(evaluation.nodes["rod"])
    slope = np.where(boundary.fixed, 0.0, boundary.expansion @ slope)
    offsets = -5e-4 * slope / np.max(np.abs(slope))
    exact = float(slope @ offsets)
    values = [psi(problem, shifted(boundary, side * offsets))[1].psi for side in (1.0, -1.0)]
    result = 0.5 * (values[0] - values[1])
    assert abs(exact) > 0.01 * evaluation.psi
    assert result == pytest.approx(exact, rel=0.01)


@pytest.mark.mpi
def test_rank_0_decides_on_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps that differ between ranks, as round-off may choose other rows, lead to one boundary."""
    problem, boundary = scene()
    comm = MPI.COMM_WORLD

    def differently(*arguments: Any) -> Any:
        step = best_step(*arguments)
        return replace(step, offsets=(1.0 + 1e-3 * comm.rank) * step.offsets)

    for module in (descent_module, geometry_module):
        monkeypatch.setattr(module, "best_step", differently)
    descent = Descent(problem, {}, {"rod": 3.2 * MEMBER}, {})
    trial = descent.trial_of({"rod": boundary})
    moved = descent.moved(trial, descent.step(trial, descent.slopes(trial), 0.3))
    assert moved is not None
    control = np.vstack([curve.control for curve in moved.boundaries["rod"].free.values()])
    assert np.ptp(comm.allgather(control), axis=0).max() == 0.0
    assert np.any(control != np.vstack([c.control for c in boundary.free.values()]))


@pytest.mark.parametrize(
    ("rows_of", "least"), [(size_rows, 0.014), (radius_rows, 0.012)], ids=["members", "radii"]
)
def test_narrow_and_tight_places_and_their_derivatives(
    rows_of: Callable[[Boundary], Rows], least: float
) -> None:
    """Holes of 22 mm are 18 mm apart; moved along their normals they come closer and turn more."""
    boundary = replace(scene(alone=True)[1], member=least, gap=least, radius=least)
    rows = rows_of(boundary)
    assert 0.0 < np.max(rows.values) < 0.9
    random = np.random.default_rng(0)
    offsets = np.where(boundary.fixed, 0.0, random.standard_normal(boundary.n_controls))
    step = 1e-8
    ahead, behind = (
        float(np.max(rows_of(shifted(boundary, h * offsets)).values)) for h in (step, -step)
    )
    exact = float(rows.slopes[np.argmax(rows.values)] @ offsets)
    assert (ahead - behind) / (2.0 * step) == pytest.approx(exact, rel=1e-3)


def test_sizes_that_are_missed_are_mended_by_a_small_motion() -> None:
    """A member is 3 % too thin; where none is, controls are spread along the curves only."""
    kind, boundary = PlaneGeometry(), scene(alone=True)[1]
    smallest = kind.sizes(replace(boundary, member=0.0185)).smallest
    thin = replace(boundary, member=1.03 * smallest)
    assert kind.sizes(thin).size_violation == pytest.approx(1.0 - 1.0 / 1.03, rel=0.01)
    mended = kind.with_minimum_sizes(thin, 2e-3)
    assert kind.sizes(mended).size_violation <= 2e-3 and kind.radii(mended).size_violation <= 2e-3
    assert mended.material.area < spread(thin).material.area * (1.0 + 1e-4)
    way = thin.expansion @ kind.offsets_between(thin, mended)
    assert 1e-4 < np.max(np.abs(way)) < 3e-3
    there, here = (np.vstack([c.control for c in b.free.values()]) for b in (thin, mended))
    # across the curves, but for controls that are kept where they may be
    off = np.einsum("kd,kd->k", here - there, thin.normals) - way
    assert np.quantile(np.abs(off), 0.9) < 1e-9
    for key, curve in kind.with_minimum_sizes(boundary, 2e-3).free.items():
        assert np.array_equal(curve.control, spread(boundary).free[key].control)


def test_mirror_images_move_alike() -> None:
    """Of a part with two mirror lines a quarter is free, and all that moves stays symmetric."""
    problem, boundary = scene(alone=True)
    holes = np.linspace(0.05, 0.35, 8)

    def even(x: np.ndarray) -> np.ndarray:
        sides = ((x[:, :1] - holes) / 0.016) ** 6 + (x[:, 1:2] / 0.011) ** 6
        return 0.01 * (np.min(sides, axis=1) ** (1 / 6) - 1.0)

    body = problem.flexible["rod"].domain
    lines = (ffr.Mirror((0.2, 0.0), (1.0, 0.0)), ffr.Mirror((0.2, 0.0), (0.0, 1.0)))
    part = ffr.Part(body, even, 0.01)
    made = Boundary.of(part, MEMBER, mirrors=lines)
    assert made.n_controls < Boundary.of(part, MEMBER).n_controls + 4 * len(holes)
    assert made.n_offsets < 0.3 * made.n_controls + 4
    random = np.random.default_rng(1)
    moved = made.moved(2e-4 * random.standard_normal(made.n_offsets))
    control = np.vstack([curve.control for curve in moved.free.values()])
    for line in lines:
        image = line.reflection(control)
        assert np.max(cKDTree(control).query(image)[0]) < 1e-12
    turned = affine_transform(moved.material, [1, 0, 0, -1, 0, 0])
    assert moved.material.symmetric_difference(turned).area < 1e-9 * moved.material.area
    # a pair that is joined is joined on the other side, too
    keys = sorted(moved.holes, key=lambda key: moved.hole(key).centroid.x)
    wide = replace(moved, member=0.008, gap=0.008)
    fewer = joined(wide, (keys[0], keys[1]))
    assert len(fewer.holes) == len(holes) - 2
    assert fewer.n_offsets < 0.4 * fewer.n_controls
    with pytest.raises(ValueError, match="too far apart"):
        joined(moved, (keys[0], keys[3]))
    with pytest.raises(ValueError, match="has no mirror image"):
        Boundary.of(boundary.origin, MEMBER, mirrors=lines[:1])


def test_nodes_follow_the_controls() -> None:
    """What goes back from nodes to controls is the transpose of the motion that it stands for."""
    boundary = scene(alone=True)[1]
    domain = boundary.part.domain(3.2 * MEMBER, across=1.2)
    motion, x = CurveMotion(boundary, domain), domain.mesh.geometry.x[:, :2]
    random = np.random.default_rng(0)
    controls = random.standard_normal((boundary.n_controls, 2))
    numbers, _ = motion._numbers
    moved = motion._follow @ controls
    edge, inside = motion._edge, motion._inside
    moved[inside] = -motion._factor.solve(motion._coupling.T @ moved[edge])
    moved[motion._middles] = moved[motion._ends].mean(axis=1)
    bar = random.standard_normal(x.shape)
    there = motion.by_controls(bar)
    assert np.sum(there * controls) == pytest.approx(np.sum(bar * moved), rel=1e-12)
    along_normals = np.einsum("kd,kd->k", there, boundary.normals)
    np.testing.assert_allclose(motion.pullback(bar[numbers]), boundary.expansion.T @ along_normals)
    # nodes on the curves are where the controls put them
    control = np.vstack([curve.control for curve in boundary.free.values()])
    on = np.flatnonzero(np.diff(motion._follow.indptr))
    assert len(on) > 300
    assert np.max(np.abs((motion._follow @ control)[numbers] - x)[np.isin(numbers, on)]) < 1e-8


@pytest.mark.slow
def test_psi_falls_and_members_stay(capsys: pytest.CaptureFixture[str]) -> None:
    problem, boundary = scene()
    result = move_boundary(problem, boundary, iterations=4, volume=0.79)
    # the bar stands still, but shows what is tried
    assert f"psi {result.history['psi'][0]:.5g}, trial 1 between steps" in capsys.readouterr().err
    history = result.history
    assert len(history["psi"]) == 1 + 4 + 1  # the start, the steps, and the result on finer meshes
    assert history["psi"][-1] < 0.99 * history["psi"][0]
    assert history["excess"][-1] < 2e-3 and history["volume"][-1] < 0.7915
    assert history["narrowest"][-1] > 0.99 * MEMBER
    part = result.boundary.part
    assert part.pieces == 1 and part.holes == len(CENTERS) + 1
    assert part.area == pytest.approx(history["volume"][-1] * boundary.body.area, rel=2e-3)
    # polygons of the accuracy of 0.5 % of a member along a metre of boundary
    assert part.area == pytest.approx(result.boundary.material.area, rel=1e-3)
    assert part.thinnest_member is None or part.thinnest_member.value > 0.99 * MEMBER
    computed = part.verify(result.problem, result.evaluation, most=2, progress=False)
    assert computed.psi == pytest.approx(result.psi, rel=2e-3)
    assert result.psi == history["psi"][-1]
    assert result.psi == pytest.approx(history["psi"].min(), rel=2e-3)


def test_struts_that_carry_next_to_nothing_are_tried_without() -> None:
    boundary = replace(scene(alone=True)[1], member=8e-3, gap=8e-3)
    first, second, third = sorted(boundary.holes, key=lambda key: boundary.hole(key).centroid.x)[:3]
    carried = {(first, second): 1e-3, (second, third): 0.05}
    ((joined, count),) = PlaneGeometry().without_idle_struts(boundary, carried)
    assert count == 1 and len(joined.holes) == len(boundary.holes) - 1
    assert third in joined.holes and first not in joined.holes


@pytest.mark.slow
def test_a_stress_limit_is_one_of_the_part() -> None:
    """Least volume: what is bounded, and told where it is missed, is the stress of the part."""
    problem, boundary = scene(alone=True)
    free, evaluation = psi(problem, boundary)
    largest = ffr.worst_stress(free.flexible["rod"], evaluation, "rod").largest

    def bounded(share: float) -> ffr.Problem:
        limit = ffr.Constraint(ffr.PeakStress("rod"), upper=share * largest)
        parts = problem.bodies, problem.mechanism, problem.integrator
        return ffr.Problem(*parts, ffr.Mass("rod"), constraints=[limit])

    coarse = {"size": 3.2 * MEMBER, "progress": False}
    with pytest.warns(ffr.PartWarning, match="PeakStress' is violated by .*% of its bound"):
        result = move_boundary(bounded(0.5), boundary, iterations=1, **coarse)
    # on a mesh that is finer in notches
    assert result.history["excess"][0] == pytest.approx(1.0, rel=0.1)
    result = move_boundary(bounded(1.05), boundary, iterations=5, **coarse)
    computed = ffr.worst_stress(result.problem.flexible["rod"], result.evaluation, "rod").largest
    assert computed < 1.05 * 1.003 * largest
    assert "PeakStress" not in result.violations
    verified = result.part("rod").verify(result.problem, result.evaluation, progress=False)
    assert verified.fitted[-1].bodies["rod"].stress == pytest.approx(computed, rel=0.01)
    # the first steps go beyond the limit, and the later ones come back to it with less material
    excess = result.history["excess"]
    assert np.min(excess[np.argmax(excess) :]) < 0.5 * np.max(excess)
    assert result.psi < 0.8 * result.history["psi"][0]


def test_the_least_largest_stress_is_sought_at_several_places() -> None:
    """Each range of stresses is to become less than the largest, with a slope of its own."""
    problem, boundary = scene(alone=True)
    parts = problem.bodies, problem.mechanism, problem.integrator
    least = ffr.Problem(*parts, ffr.PeakStress("rod", clear=5e-3))
    descent = Descent(least, {}, {"rod": 3.2 * MEMBER}, {})
    slopes = descent.slopes(descent.trial_of({"rod": boundary}))
    values, rows = slopes.values[-slopes.n_bounds :], slopes.slopes[-slopes.n_bounds :]
    assert len(values) > 1 and np.max(values) == pytest.approx(1.0 / 0.95 - 1.0, rel=1e-6)
    unit = rows / np.linalg.norm(rows, axis=1)[:, None]
    assert np.max(np.abs((unit @ unit.T)[~np.eye(len(unit), dtype=bool)])) < 0.99
    mean = slopes.psi / np.linalg.norm(slopes.psi)
    assert np.min(unit @ mean) < 0.9


def test_a_step_lowers_all_load_cases_where_the_worst_is_minimised() -> None:
    """Compliance and material fall at once and by the same share, so neither becomes the worst."""
    alone, boundary = scene(alone=True)

    def trial_with(weights: dict[str, float]) -> tuple[Descent, Trial]:
        objectives = {"soft": ffr.IntegralCompliance(), "heavy": ffr.Volume("rod")}
        load_cases = {
            name: ffr.MechanicalProblem(alone.mechanism, alone.integrator, objective)
            for name, objective in objectives.items()
        }
        combine = ffr.WorstCase(weights)
        problem = ffr.Problem.of_load_cases(alone.bodies, load_cases, combine)
        descent = Descent(problem, {}, {"rod": 3.2 * MEMBER}, {})
        return descent, descent.trial_of({"rod": boundary})

    def values(trial: Trial) -> dict[str, float]:
        return {name: case.psi for name, case in trial.evaluation.load_cases.items()}

    first = values(trial_with({"soft": 1.0, "heavy": 1.0})[1])
    descent, trial = trial_with({name: 1.0 / psi for name, psi in first.items()})
    slopes = descent.slopes(trial)
    step = descent.step(trial, slopes, 0.1)
    # slopes of both beside differences over new meshes, whose own noise is some 5e-5 of psi; sides
    # on the outline, which is a limit, stay
    closed = [np.full(len(curve.control), curve.closed) for curve in boundary.free.values()]
    offsets = np.where(
        np.concatenate(closed), 4.0 * (boundary.expansion @ step.offsets["rod"]), 0.0
    )
    ends = [
        values(descent.trial_of({"rod": shifted(boundary, side * offsets)})) for side in (1.0, -1.0)
    ]
    orbits = boundary.mean_of_orbits(offsets) / MEMBER
    predicted = {"soft": slopes.psi @ orbits, "heavy": (slopes.psi + slopes.slopes[-1]) @ orbits}
    for name, change in predicted.items():
        assert 0.5 * np.log(ends[0][name] / ends[1][name]) == pytest.approx(change, rel=0.01)
    after = descent.moved(trial, step)
    assert after is not None
    assert all(psi < 0.995 * first[name] for name, psi in values(after).items())


def test_a_bound_that_only_finer_meshes_exceed_is_tightened(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By as much as these differ; a few more steps keep it, and the finer meshes are told."""
    problem, boundary = scene(alone=True)
    limit = 0.95 * psi(problem, boundary)[1].psi
    soft = ffr.Constraint(ffr.IntegralCompliance(), upper=limit, name="soft")
    parts = problem.bodies, problem.mechanism, problem.integrator
    heavy = ffr.Problem(*parts, ffr.Mass("rod"), constraints=[soft])
    computed: list[float] = []
    finer = Descent.finer

    def off(descent: Descent, trial: Trial) -> tuple[Trial, float]:
        reported, change = finer(descent, trial)
        computed.append(reported.violations["soft"])
        return replace(reported, violations={"soft": computed[-1] + 0.01}), change

    monkeypatch.setattr(Descent, "finer", off)
    short = {"iterations": 3, "progress": False, "mode_tolerance": None}
    result = move_boundary(heavy, boundary, **short)
    assert len(result.history["psi"]) == 3 + 4 + 2 and len(computed) == 2
    assert computed[0] > -0.01 + 2e-3 > computed[1] > -0.02
    assert result.violations == {} and result.psi < result.history["psi"][0]


def test_a_void_between_solid_regions_is_one_hole_with_rounded_corners() -> None:
    """It ends at both columns that stay solid; the flanges beside it become one region."""
    rod = ffr.Domain.rectangle(MPI.COMM_SELF, 0.4, 0.04, elements=(80, 8))
    part = ffr.Part(rod, lambda x: np.abs(x[:, 1]) - 0.008, 0.005)
    result = Boundary.of(part, 1e-3, gap=4e-3)
    hole = shapely.Polygon(result.free[result.holes[0]].spline().points(1e-5))
    assert len(result.holes) == 1 and result.valid
    assert [len(loops) for group, loops in result.faces if group == "design"] == [2]
    # as large as the void, but for its corners, and off the columns of 0.01 m
    assert hole.area == pytest.approx(0.38 * 0.016, rel=0.03)
    assert 0.01 < hole.bounds[0] < 0.015 and 0.385 < hole.bounds[2] < 0.39
    assert result.material.area == pytest.approx(0.4 * 0.04 - hole.area, rel=1e-3)


def test_what_cannot_be_moved() -> None:
    problem, boundary = scene(alone=True)
    part, plane = boundary.origin, ffr.Mirror((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    for call, why in (
        (lambda: Boundary.of(part, 0.03), "do not fit into the body"),
        (lambda: Boundary.of(part, -1.0), "member must"),
        (lambda: Boundary.of(part, MEMBER, mirrors=[plane]), "is a plane; give lines"),
        (lambda: move_boundary(problem, boundary, iterations=0), "iterations"),
        (lambda: move_boundary(problem, boundary, volume=1.5), "volume"),
        (lambda: move_boundary(problem, boundary, size=0.0), "size"),
        (lambda: move_boundary(problem.with_bodies({**problem.bodies}), part), "a Boundary"),
    ):
        with pytest.raises((TypeError, ValueError), match=why):
            call()
    nothing = ffr.Problem(
        problem.bodies, problem.mechanism, problem.integrator, 0.0 * ffr.Mass("rod")
    )
    with pytest.raises(ValueError, match="boundary: psi of the start is 0, so there is nothing"):
        move_boundary(nothing, boundary, progress=False)
    with pytest.warns(ffr.PartWarning, match="holes or islands .* near .* mm are left out"):
        Boundary.of(part, 9e-3)


def test_the_largest_frequency_is_a_negative_objective() -> None:
    problem, boundary = scene(alone=True)
    highest = ffr.Problem(
        problem.bodies, problem.mechanism, problem.integrator, -ffr.Frequency("rod")
    )
    result = move_boundary(highest, boundary, iterations=2, volume=0.85, progress=False)
    assert result.reason == "iterations" and not result.violations
    assert result.psi < 1.005 * result.history["psi"][0] < 0.0


def test_only_what_a_shape_forbids_is_no_better_step() -> None:
    """A trial that cannot be meshed or simulated is rejected; any other error is a bug, and seen.

    Warnings of trials that are rejected are none of the result.
    """
    problem, boundary = scene(alone=True)
    mesh, calls = PlaneGeometry.mesh, [0]

    def failing(error: Exception) -> Any:
        def meshed(self: PlaneGeometry, *given: Any) -> ffr.Domain:
            calls[0] += 1
            if calls[0] == 2:
                warnings.warn("of a rejected trial", UserWarning, stacklevel=1)
                raise error
            warnings.warn("of a trial that is taken", UserWarning, stacklevel=1)
            return mesh(self, *given)

        return patch.object(PlaneGeometry, "mesh", meshed)

    options = {"iterations": 1, "volume": 0.85, "progress": False}
    for error in (CurveError("curves cross"), shapely.GEOSException("no ring")):
        calls[0] = 0
        with failing(error), warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            result = move_boundary(problem, boundary, **options)
        assert result.reason == "iterations" and len(result.history["psi"]) == 3
        message = [str(warning.message) for warning in warned]
        assert (
            message.count("of a trial that is taken") == 1 and "of a rejected trial" not in message
        )
    for kind in (KeyError, ValueError):
        calls[0] = 0
        with failing(kind("a bug")), pytest.raises(kind, match="a bug"):
            move_boundary(problem, boundary, **options)


@pytest.mark.slow
def test_boundaries_of_two_bodies_move_together() -> None:
    """A double pendulum: one has a bound, and the derivative is that of both."""
    bodies, boundaries = {}, {}

    def four_holes(x: np.ndarray) -> np.ndarray:
        from_holes = np.abs(np.abs(x[:, 0] - 0.2) - 0.08) - 0.04
        return np.hypot(from_holes, x[:, 1]) - 0.011

    for name in ("upper", "lower"):
        domain = ffr.Domain.rectangle(MPI.COMM_SELF, 0.4, 0.04, elements=(40, 4))
        bodies[name] = ffr.FlexibleBody(
            domain, STEEL, frame=ffr.ChordFrame("left", "right"), modes=4
        )
        boundaries[name] = Boundary.of(ffr.Part(domain, four_holes, 0.01), MEMBER, gap=3e-3)
    mechanism = ffr.Mechanism(
        {"upper": ffr.Placement((0.0, 0.0)), "lower": ffr.Placement((0.4, 0.0))},
        [
            ffr.Revolute(("upper", "left"), ffr.Ground()),
            ffr.Revolute(("lower", "left"), ("upper", "right")),
        ],
        gravity=(0.0, -9.81),
    )
    integrator = ffr.GeneralizedAlpha(0.2, 200)
    problem = ffr.Problem(bodies, mechanism, integrator, ffr.IntegralCompliance())
    with pytest.raises(ValueError, match=r"given for \['upper'\], and the problem designs"):
        move_boundary(problem, {"upper": boundaries["upper"]})
    # beside differences over new meshes, whose own noise is some 1e-5 of psi
    descent = Descent(problem, {}, dict.fromkeys(boundaries, 3.2 * MEMBER), {})
    slope = descent.slopes(descent.trial_of(boundaries)).psi
    along, first, log_psi = -0.2 * slope / np.max(np.abs(slope)), 0, []
    offsets = {}
    for name, b in boundaries.items():
        part = slice(first, first + b.n_offsets)
        # the outline of the body is a limit: its sides stay
        counts = [(len(curve.control), not curve.closed) for curve in b.free.values()]
        stays = b.fixed | np.concatenate([np.full(count, outer) for count, outer in counts])
        offsets[name] = np.where(stays, 0.0, b.member * (b.expansion @ along[part]))
        along[part][b.expansion.T @ stays > 0] = 0.0
        first = part.stop
    for side in (1.0, -1.0):
        beside = {n: shifted(b, side * offsets[n]) for n, b in boundaries.items()}
        log_psi.append(np.log(descent.trial_of(beside).evaluation.psi))
    assert 0.5 * (log_psi[0] - log_psi[1]) == pytest.approx(slope @ along, rel=0.01)
    result = move_boundary(
        problem, boundaries, volume={"lower": 0.78}, iterations=2, progress=False
    )
    assert result.psi < 0.97 * result.history["psi"][0]
    assert result.part("lower").area < 0.7815 * 0.016
    assert [len(shapes) for shapes in result.materials.values()] == [4, 4]
    for name, boundary in boundaries.items():
        moved = boundary.material.symmetric_difference(result.boundaries[name].material)
        assert moved.area > 1e-2 * boundary.material.area


@pytest.mark.slow
def test_a_design_ends_with_steps_of_its_boundary(shared_tmp_path: Path) -> None:
    """What is told then is the part: psi, volume and sizes, in files and pictures."""
    problem = reference_problem(MPI.COMM_WORLD, (40, 4), steps=100, modes=4)
    domain = problem.flexible["rod"].domain
    levelset = ffr.LevelSet(domain, mirrors=ffr.mirror_lines(domain))
    run = {"volume": 0.6, "iterations": 12, "progress": False, "mode_tolerance": None}
    result = ffr.optimize(problem, levelset, boundary=2, output=shared_tmp_path, **run)
    moved = result.moved
    assert moved is not None and result.psi == moved.psi != result.evaluation.psi
    part = result.part("rod")
    assert part.area == pytest.approx(moved.summary()["volume"] * domain.area, rel=2e-3)
    computed = result.finish(shared_tmp_path, progress=False)
    assert computed is not None and (shared_tmp_path / "part.step").exists()
    assert abs(computed.difference) < 2e-3 and computed.psi < 0.99 * moved.history["psi"][0]
    with patch.object(ffr.Result, "verify", side_effect=MemoryError), pytest.raises(MemoryError):
        result.finish(shared_tmp_path / "early")
    assert (shared_tmp_path / "early" / "part.step").exists()
    summary = result.summary()["boundary"]
    assert summary["steps"] == len(moved.history["psi"]) - 2 and summary["psi"] == moved.psi
    reported = ffr.run_record(result, title="A part")
    assert reported["constraints"]["volume of rod"]["value"] == moved.volume["rod"]
    steps = ffr.read_history(shared_tmp_path / "boundary.csv")
    np.testing.assert_array_equal(steps["psi"], moved.history["psi"])
    assert all((shared_tmp_path / name).exists() for name in ("stress_before.png", "stress.png"))
    with Image.open(shared_tmp_path / "boundary.gif") as pictures:
        assert pictures.n_frames >= len(moved.history["psi"])
    with pytest.raises(TypeError, match="optimize: boundary must be a number"):
        ffr.optimize(problem, levelset, boundary="3", **run)


@pytest.mark.slow
@pytest.mark.mpi
def test_steps_go_on_where_they_were_ended(
    shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From its checkpoint after two steps, a run ends as it did; others' steps are refused.

    On one rank exactly. On several MUMPS adds up in an order that changes from run to run, and the
    mesh of a boundary follows its last bits: the first step after the checkpoint, whose gradient is
    that of the same mesh, leads to the same boundary, and psi ends at the same value.
    """
    domain = ffr.Domain.rectangle(MPI.COMM_WORLD, 0.4, 0.04, elements=(40, 4))
    problem = reference_problem(domain.comm, domain=domain, steps=60, modes=3)
    options = {"volume": 0.6, "iterations": 4, "progress": False, "output": shared_tmp_path}

    def run(**others: Any) -> BoundaryResult:
        result = ffr.optimize(problem, ffr.LevelSet(domain), **options, boundary=3, **others)
        assert result.moved is not None
        return result.moved

    save, saved, path = Checkpoint.save, [], shared_tmp_path / "checkpoint"

    def saved_too(self: Checkpoint, phase: str, state: Any) -> None:
        save(self, phase, state)
        if phase == "boundary":
            saved.append(load_checkpoint(domain.comm, path))

    monkeypatch.setattr(Checkpoint, "save", saved_too)
    uninterrupted, steps = run(), list(saved)
    secants = steps[1]["boundary steps secants"]
    assert secants.shape[:2] == (2, 3)  # a slide of struts is one of them
    save_checkpoint(domain.comm, path, steps[1])
    rest = run(resume=True)
    assert len(saved) == 2 * len(steps) - 2  # those before are not made again
    one, near = domain.comm.size == 1, 1e-4
    exact = slice(None if one else 3)
    for name, column in uninterrupted.history.items():
        np.testing.assert_array_equal(rest.history[name][exact], column[exact], name)
        if name != "cells":
            assert rest.history[name] == pytest.approx(column, rel=near, abs=near), name
    control = "boundary steps now rod control"
    np.testing.assert_allclose(saved[len(steps)][control], steps[2][control], rtol=0.0, atol=1e-10)
    assert len(rest.materials["rod"]) == len(uninterrupted.materials["rod"])
    # once it has ended, nothing is left to do
    again = run(resume=True)
    assert again.psi == pytest.approx(uninterrupted.psi, rel=1e-12 if one else near)
    data = load_checkpoint(domain.comm, path)
    for key, value, why in (
        ("boundary start rod control", 1.001, "its steps began with other boundaries"),
        ("boundary psi", 1.001, "psi of its boundaries was"),
    ):
        save_checkpoint(domain.comm, path, {**data, key: value * data[key]})
        with pytest.raises(ffr.CheckpointError, match=f"is of another problem: {why}"):
            run(resume=True)
    del data["format"]
    save_checkpoint(domain.comm, path, data)
    with pytest.raises(ffr.CheckpointError, match="was written by another version of dolfinx_ffr"):
        run(resume=True)


def test_a_curve_around_a_solid_rim_stays_off_it_and_in_the_body() -> None:
    """A bar between two rims of 12 mm, and a knee of the outline; controls are 10 mm apart."""
    ends = [[-0.02, -0.02], [0.17, -0.02], [0.17, 0.03], [0.08, 0.018], [-0.02, 0.03]]
    bar = shapely.Polygon(ends).difference(shapely.MultiPoint([(0, 0), (0.15, 0)]).buffer(0.006))
    bores = {"bores": lambda x: np.hypot(np.abs(x[0] - 0.075) - 0.075, x[1]) < 0.0061}
    body = ffr.Domain.from_outline(MPI.COMM_SELF, bar, interfaces=bores, size=5e-3, solid_rim=6e-3)
    for strip in (lambda x: 0.008 - np.abs(x[:, 1]), lambda x: x[:, 1] + 0.008):
        made = Boundary.of(ffr.Part(body, strip, 0.0025), 0.005)
        for result in (made, made.moved(np.linspace(-2e-3, 2e-3, made.n_offsets))):
            outer, room = (
                shapely.Polygon(x.exterior) for x in (result.material, result.body_polygon)
            )
            assert result.valid and outer.difference(room).area < 1e-3 * result.member**2
