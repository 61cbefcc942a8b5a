# SPDX-License-Identifier: MIT
"""The design loop: descent, stages, interruption, checkpoints, histories."""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import signal
import subprocess
import warnings
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any
from unittest.mock import patch

from mpi4py import MPI

import numpy as np
import pytest
from optimization.quiet import check_alike, quiet
from shared import processes
from shared.problems import Copy, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr import io
from dolfinx_ffr.optimization.loop import COLUMNS, GRADIENT_COLUMNS
from dolfinx_ffr.optimization.moved_parts import with_checked_parts


def disc(c: np.ndarray) -> np.ndarray:
    """Solid but for an ellipse."""
    return np.where(np.hypot((c[:, 0] - 0.2) / 0.12, c[:, 1] / 0.025) < 1.0, 0.0, 1.0)


def scene(comm: MPI.Intracomm) -> tuple[ffr.Problem, ffr.LevelSet, np.ndarray]:
    """The slider-crank on a coarse mesh, with a start design."""
    problem = slider_crank(comm)
    levelset = ffr.LevelSet(problem.flexible["rod"].domain)
    return problem, levelset, levelset.with_holes(6, 1, 0.011)


def copy(comm: MPI.Intracomm) -> tuple[Copy, ffr.LevelSet, np.ndarray]:
    """A problem with a known answer that costs next to nothing, with a start design."""
    problem = Copy(comm, disc)
    levelset = ffr.LevelSet(problem.domain)
    return problem, levelset, levelset.with_holes(8, 1, 0.016)


def run(parts: Any, **options: Any) -> ffr.Result:
    """Run the loop on a scene, without noise."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*violates", ffr.DesignWarning)
        return quiet(*parts, **{"iterations": 3, "volume": 0.6, **options})


STEPS = ffr.LevelSetEvolution()
#: Both ways to move a level set
BOTH = pytest.mark.parametrize("optimizer", [STEPS, ffr.MMA()], ids=["steps", "MMA"])


def test_a_known_shape_is_found(comm: MPI.Intracomm) -> None:
    """Eight small holes merge into the one that is wanted; the volume bound is not in the way."""
    setup = copy(comm)
    problem = setup[0]
    result = run(setup, volume=1.0, iterations=60, optimizer=STEPS)
    assert result.history["sharpness"][-1] == 56.0
    assert result.psi - 1.0 < 0.02 * (result.history["psi"][0] - 1.0) + 0.006
    differs = np.abs(result.x - problem.target) > 0.5
    wrong = problem.domain.sum(problem.domain.cell_volumes * differs)
    assert wrong / problem.domain.area < 0.01
    assert ffr.gray_fraction(problem.domain, result.x) < 0.15
    assert np.all(result.history["multiplier"] == 0.0)


def test_the_volume_bound_is_kept(comm: MPI.Intracomm) -> None:
    """More material would be better, and the bound is used up."""
    result = run(copy(comm), iterations=20, optimizer=STEPS)
    assert np.all(result.history["volume"] <= 0.6 + 1e-12)
    assert np.all(result.history["multiplier"] >= 0.0)
    # at last the history tells the design that is analysed, a little within the one that is made
    assert result.history["volume"][-1] < 0.59
    assert result.evaluation.volume["plate"] == pytest.approx(0.6, rel=1e-3)
    assert result.history["multiplier"][1:].max() > 0.0


@pytest.mark.mpi
def test_ranks_agree(comm: MPI.Intracomm) -> None:
    check_alike(comm, run(scene(comm), optimizer=STEPS))


@pytest.mark.slow
def test_psi_falls_in_every_stage(comm: MPI.Intracomm) -> None:
    setup = scene(comm)
    result = run(setup, iterations=12, optimizer=STEPS)
    history, levelset = result.history, setup[1]
    same_stage = np.diff(history["sharpness"]) == 0.0
    kept = history["accepted"] == 1.0
    falls = np.diff(history["psi"])
    assert np.all(falls[same_stage & kept[1:]] < 0.0)
    assert np.all(falls[same_stage & ~kept[1:]] == 0.0)
    assert history["psi"][-1] < 0.5 * history["psi"][0]
    assert np.unique(history["sharpness"]).tolist() == [11.0, 19.0, 32.0, 56.0]
    # the last row is the design a little within its boundary; the result is the one that is made,
    # told by the law of cut elements, and fits together
    assert result.iterations == 12
    last = levelset.with_sharpness(history["sharpness"][-1])
    analysed = last.eroded.density(result.coefficients)
    value = setup[0].value(analysed)
    assert value.psi == pytest.approx(history["psi"][-1], rel=1e-9)
    assert value.volume["rod"] == pytest.approx(history["volume"][-1], rel=1e-12)
    assert ffr.gray_fraction(levelset.domain, analysed) == history["gray"][-1]
    assert np.array_equal(result.x, last.density(result.coefficients))
    assert np.array_equal(result.x, result.designs["rod"].density(result.coefficients))
    assert result.psi < setup[0].value(result.x).psi
    assert result.evaluation.volume["rod"] > value.volume["rod"]


@pytest.mark.mpi
def test_what_cannot_be_simulated(comm: MPI.Intracomm) -> None:
    """A step is halved, and a design that cannot be sharpened is kept."""
    problem, levelset, start = copy(comm)
    one_stage, two_stages = ((11.0,), (8.0, 32.0))
    problem.broken = {3, 4}  # after the even density and the start
    moves = ffr.LevelSetEvolution(sharpness=one_stage)
    result = run((problem, levelset, start), volume=1.0, optimizer=moves)
    assert result.history["accepted"].tolist() == [1, 0, 0, 1]
    assert result.history["step"].tolist() == pytest.approx([1.0, 0.5, 0.25, 0.325])
    problem.calls, problem.broken = 0, {5}  # and after two steps
    moves = ffr.LevelSetEvolution(sharpness=two_stages)
    result = run((problem, levelset, start), iterations=4, volume=1.0, optimizer=moves)
    assert (result.reason, result.iterations) == ("stalled", 2)
    assert result.designs["plate"].sharpness == 8.0
    x = levelset.with_sharpness(8.0).density(result.coefficients)
    assert result.psi == problem.value(x).psi


@pytest.mark.mpi
def test_a_start_in_pieces_gives_way_to_an_even_density(comm: MPI.Intracomm) -> None:
    problem, levelset, _ = scene(comm)
    cut = levelset.from_distance(lambda x: np.abs(x[:, 0] - 0.2) - 0.04)
    with pytest.warns(UserWarning, match="the start design has fallen apart"):
        result = run((problem, levelset, cut), iterations=0, optimizer=STEPS)
    assert result.history["gray"][0] > 0.8
    assert result.reason == "iterations"


def test_the_start_is_even_where_none_is_given(comm: MPI.Intracomm) -> None:
    for design in (ffr.LevelSet, ffr.DensityDesign):
        problem = Copy(comm, disc)
        part = design(problem.domain)
        result = run((problem, part))
        given = run((problem, part, part.even()))
        assert np.array_equal(result.variables["plate"], given.variables["plate"])


def test_gray_fraction_counts_areas() -> None:
    domain = ffr.Domain.rectangle(MPI.COMM_SELF, 1.0, 0.1, elements=(10, 1), solid_columns=0)
    x = np.zeros(domain.n_cells)
    x[:4] = [0.1, 0.9, 0.5, 0.11]
    assert ffr.gray_fraction(domain, x) == pytest.approx(0.2)


@BOTH
def test_one_level_set_serves_two_optimisations(comm: MPI.Intracomm, optimizer: Any) -> None:
    """One within an iteration of the other: both as if each had a level set of its own."""
    problem = Copy(comm, disc)
    first, second = ffr.LevelSet(problem.domain), ffr.LevelSet(problem.domain)
    start = first.with_holes(8, 1, 0.016)
    before = first.density(start)
    inner: list[ffr.Result] = []

    def other(iteration: int, x: np.ndarray, evaluation: ffr.Evaluation) -> None:
        if iteration == 2:
            inner.extend(run((problem, each, start), iterations=2) for each in (first, second))

    result = run((problem, first, start), optimizer=optimizer, callback=other)
    alone = run((problem, second, start), optimizer=optimizer)
    assert np.array_equal(first.density(start), before)
    for computed, expected in ((result, alone), inner):
        assert np.array_equal(computed.coefficients, expected.coefficients)
        assert np.array_equal(computed.x, expected.x)
        assert np.array_equal(computed.history["psi"], expected.history["psi"])


@pytest.mark.parametrize("first", ["exact", "approximate"])
def test_columns_of_approximations(comm: MPI.Intracomm, shared_tmp_path: Path, first: str) -> None:
    """A run may go on with the other kind of gradient; what was not known then is NaN."""
    elements, kernel = ffr.paper.GradientElements(share=0.4), ffr.ExponentialSpline(0.1)
    approximate = ffr.paper.ApproximateGradient(elements, kernel)
    kinds = {"exact": ffr.ExactAdjoint(), "approximate": approximate}
    second = next(name for name in kinds if name != first)
    setup, folder = scene(comm), {"output": shared_tmp_path}
    begun = run(setup, **folder, iterations=1, gradient=kinds[first])
    assert list(begun.history) == COLUMNS + (GRADIENT_COLUMNS if first == "approximate" else [])
    result = run(setup, **folder, iterations=2, resume=True, gradient=kinds[second])
    assert set(result.history) == {*COLUMNS, *GRADIENT_COLUMNS}
    estimate = result.history["gradient_estimate"]
    if first == "exact":
        assert np.all(np.isnan(estimate[:2])) and estimate[2] > 0.0
    else:
        assert np.all(estimate[:2] > 0.0)
    comm.Barrier()
    computed = ffr.read_history(shared_tmp_path / "history.csv")
    np.testing.assert_array_equal(computed["gradient_estimate"], estimate)


@pytest.mark.mpi
def test_history_is_on_the_disk_at_once(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    lengths = []

    def look(iteration: int, x: np.ndarray, evaluation: ffr.Evaluation) -> None:
        lengths.append(len(ffr.read_history(shared_tmp_path / "history.csv")["psi"]) - iteration)

    result = run(copy(comm), output=shared_tmp_path, callback=look, iterations=4)
    assert lengths == [1, 1, 1, 1]
    comm.Barrier()
    computed = ffr.read_history(shared_tmp_path / "history.csv")
    assert list(computed) == COLUMNS
    for name in COLUMNS:
        np.testing.assert_array_equal(computed[name], result.history[name], name)
    assert sorted(p.name for p in shared_tmp_path.iterdir()) == ["checkpoint", "history.csv"]


@pytest.mark.mpi
@pytest.mark.parametrize("last", [2, 3], ids=["between", "in the last iteration"])
@BOTH
def test_nothing_is_finished_after_sigterm(
    comm: MPI.Intracomm, shared_tmp_path: Path, optimizer: Any, last: int
) -> None:
    """Which asks the program to end: neither parts nor pictures, and one warning of the reason."""

    def end(iteration: int, x: np.ndarray, evaluation: ffr.Evaluation) -> None:
        if iteration == last and comm.rank == comm.size - 1:
            os.kill(os.getpid(), signal.SIGTERM)

    result = run(copy(comm), optimizer=optimizer, callback=end)
    assert result.terminated and result.iterations == last
    with pytest.warns(ffr.DesignWarning, match="SIGTERM .* resume=True"):
        assert result.finish(shared_tmp_path / "parts") is None
    assert not (shared_tmp_path / "parts").exists()
    assert not run(copy(comm), optimizer=optimizer).terminated


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.parametrize(
    ("optimizer", "number"),
    [(STEPS, signal.SIGTERM), (ffr.MMA(), signal.SIGINT)],
    ids=["steps, ended", "MMA"],
)
def test_interrupted_and_resumed_is_as_if_uninterrupted(
    comm: MPI.Intracomm, shared_tmp_path: Path, optimizer: Any, number: signal.Signals
) -> None:
    """A signal on the last rank alone ends the loop on all of them, after the iteration at hand.

    What follows agrees to the accuracy of the solvers, whose iterations begin where the last ended,
    and of MMA, which magnifies it.
    """
    setup = scene(comm)
    uninterrupted = run(setup, iterations=5, optimizer=optimizer)

    def interrupt(iteration: int, x: np.ndarray, evaluation: ffr.Evaluation) -> None:
        if iteration == 3 and comm.rank == comm.size - 1:
            os.kill(os.getpid(), number)

    before = signal.getsignal(number)
    options = {"iterations": 5, "optimizer": optimizer, "output": shared_tmp_path}
    first = run(setup, **options, callback=interrupt)
    assert signal.getsignal(number) == before
    assert (first.reason, first.iterations) == ("interrupted", 3)
    assert len(ffr.read_history(shared_tmp_path / "history.csv")["psi"]) == 4
    # on several ranks MUMPS adds up in an order that changes from run to run
    near = 1e-12 if comm.size == 1 else 1e-9 if optimizer is STEPS else 1e-6
    assert first.history["psi"][3] == pytest.approx(uninterrupted.history["psi"][3], rel=near)

    # on the same mesh: another one may be distributed differently
    levelset = ffr.LevelSet(setup[1].domain)
    rest = run((setup[0], levelset, setup[2]), **options, resume=True)
    assert (rest.reason, rest.iterations) == (uninterrupted.reason, uninterrupted.iterations)
    accuracy = 1e-9 if optimizer is STEPS else 1e-6
    for name in ("psi", "volume", "gray", "accepted", "step", "sharpness", "merit"):
        assert np.array_equal(rest.history[name][:4], first.history[name]), name
        near = accuracy * np.abs(uninterrupted.history[name]).max()
        assert rest.history[name] == pytest.approx(uninterrupted.history[name], abs=near), name
    scale = np.max(np.abs(uninterrupted.coefficients))
    assert rest.coefficients == pytest.approx(uninterrupted.coefficients, abs=accuracy * scale)
    assert rest.x == pytest.approx(uninterrupted.x, abs=10.0 * accuracy)


@pytest.mark.mpi
@BOTH
def test_cells_distributed_otherwise(comm: MPI.Comm, shared_tmp_path: Path, optimizer: Any) -> None:
    """Begun on all ranks and ended on one less; sums over the cells differ in their last bits."""
    first = run(scene(comm), output=shared_tmp_path, iterations=1, optimizer=optimizer)
    fewer = comm.Split(int(comm.rank > 0 or comm.size == 1))
    if comm.rank > 0 or comm.size == 1:
        setup = scene(fewer)
        domain = setup[1].domain
        # as any order of the sum may make it
        area = domain.area
        domain.__dict__["cell_volumes"] = domain.cell_volumes * (1.0 + 4.0 * np.finfo(float).eps)
        assert domain.area != area
        setup = (setup[0], ffr.LevelSet(domain), setup[2])
        more = run(setup, output=shared_tmp_path, iterations=2, resume=True, optimizer=optimizer)
        assert more.iterations == 2
        assert np.array_equal(more.history["psi"][:2], first.history["psi"])
    fewer.Free()


@pytest.mark.mpi
def test_resuming_without_a_checkpoint(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    with pytest.warns(ffr.DesignWarning, match="no checkpoint .*new.checkpoint to resume"):
        result = run(copy(comm), output=shared_tmp_path / "new", iterations=1, resume=True)
    assert result.iterations == 1
    with pytest.raises(ValueError, match="resume=True needs the folder of the checkpoint"):
        run(copy(comm), iterations=1, resume=True)


#: A run in pieces: what makes a step of it, and of those that go on, which keep what it began with
CUT = {
    "steps of a given length": (ffr.LevelSetEvolution(stage_iterations=3), None),
    "MMA of a given length": (ffr.MMA(length=12), ffr.MMA()),
    "MMA of another length": (ffr.MMA(length=12), ffr.MMA(length=99)),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CUT)
def test_a_run_that_is_cut_up(comm: MPI.Intracomm, shared_tmp_path: Path, case: str) -> None:
    """Neither with a given length, nor with what the first call has planned."""
    setup, (given, later) = copy(comm), CUT[case]

    def through(iterations: list[int], folder: str) -> list[ffr.Result]:
        options = {"output": shared_tmp_path / folder}
        result = [run(setup, iterations=iterations[0], **options, optimizer=given)]
        options |= {"optimizer": later or given, "resume": True}
        return result + [run(setup, iterations=number, **options) for number in iterations[1:]]

    first, uninterrupted = through([6, 12], "whole")
    cut = through([6, 7, 10, 12], "cut")[-1]
    if later:  # the length alone decides
        assert first.designs["plate"].sharpness == pytest.approx(32.0**0.9)
        uninterrupted = run(setup, iterations=12, optimizer=given)
    assert len(np.unique(uninterrupted.history["sharpness"])) > 1
    for column in ("psi", "volume", "gray", "accepted", "step", "sharpness", "merit"):
        expected = uninterrupted.history[column]
        np.testing.assert_allclose(cut.history[column], expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(cut.coefficients, uninterrupted.coefficients, atol=1e-9)


@pytest.mark.mpi
@BOTH
def test_iterations_that_were_done(comm: MPI.Comm, shared_tmp_path: Path, optimizer: Any) -> None:
    """As many of them, or less, change nothing."""
    options = {"output": shared_tmp_path, "optimizer": optimizer}
    first = run(copy(comm), iterations=4, **options)
    comm.Barrier()
    before = (shared_tmp_path / "checkpoint").read_bytes()
    for wanted in (4, 2):
        again = run(copy(comm), iterations=wanted, resume=True, **options)
        assert (again.reason, again.iterations) == ("iterations", 4)
        for column in ("psi", "seconds"):
            assert again.history[column].tolist() == first.history[column].tolist()
        # the knots are factored anew, and what BLAS makes of that depends on the place in memory
        scale = np.max(np.abs(first.coefficients))
        assert again.coefficients == pytest.approx(first.coefficients, abs=1e-12 * scale)
        assert again.designs["plate"].sharpness == first.designs["plate"].sharpness
        comm.Barrier()
        assert (shared_tmp_path / "checkpoint").read_bytes() == before


def test_a_gray_result_is_said_with_the_remedy(comm: MPI.Intracomm) -> None:
    problem = Copy(comm, lambda c: np.full(len(c), 0.4))
    design = ffr.DensityDesign(problem.domain)
    options = {"volume": 1.0, "iterations": 1, "progress": False}
    with pytest.warns(ffr.DesignWarning, match="% of 'plate' is gray.*give more iterations"):
        ffr.optimize(problem, design, optimizer=ffr.MMA(length=9), **options)
    with pytest.warns(ffr.DesignWarning, match="'plate' is gray.*take smaller elements"):
        result = ffr.optimize(problem, design, optimizer=ffr.MMA(move=1e-3), **options)
    assert result.summary()["gray"] > 0.5 and result.summary()["feasible"]


@pytest.mark.mpi
def test_loose_pieces_are_no_feasible_design(comm: MPI.Intracomm) -> None:
    """An island in a hole, which densities hold by next to nothing, and the part has not."""
    problem = slider_crank(comm, elements=(120, 12))
    levelset = ffr.LevelSet(problem.flexible["rod"].domain)

    def island(p: np.ndarray) -> np.ndarray:
        r = np.linalg.norm(p - [0.2, 0.0], axis=1)
        return np.maximum(0.007 - r, r - 0.016)

    start = levelset.from_distance(island)
    begun = quiet(problem, levelset, start, volume=1.0, iterations=0, optimizer=STEPS)
    assert begun.feasible  # it is not sharp
    sharp = replace(begun, designs={"rod": levelset}, variables={"rod": start})
    with pytest.warns(ffr.DesignWarning, match="1 loose pieces.*take smaller elements"):
        result = with_checked_parts(sharp)
    assert not result.feasible and result.reason == "infeasible"
    assert 0.001 < result.violations["loose pieces of rod"] < 0.02


@pytest.mark.mpi
@pytest.mark.parametrize("kind", [ffr.LevelSet, ffr.DensityDesign])
def test_a_torn_design_is_no_feasible_one(comm: MPI.Intracomm, kind: Any) -> None:
    """All material between the solid ends is void, so that they are parts of nothing."""
    problem = slider_crank(comm)
    design = kind(problem.flexible["rod"].domain)
    begun = quiet(problem, design, design.even(), volume=1.0, iterations=0)
    assert begun.feasible  # it is gray, which is no part yet
    sharp, variables = {"rod": design.at(1.0)}, {"rod": np.zeros(design.size)}
    torn = replace(begun, designs=sharp, variables=variables)
    message = (
        "no part can be made of the design of 'rod', .* an objective that loads the interfaces"
    )
    with pytest.warns(ffr.DesignWarning, match=message):
        result = with_checked_parts(torn)
    assert not result.feasible and result.reason == "infeasible"
    assert result.violations == {"part of rod": 1.0}


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (np.linalg.LinAlgError("Singular matrix"), "LinAlgError, .*: Singular matrix"),
        (KeyError("a bug"), "KeyError, mock.py, line [0-9]+: 'a bug'"),
        (ValueError("curves cross"), "curves cross"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_densities_are_not_lost_where_steps_of_the_boundary_fail(
    error: Exception, message: str
) -> None:
    """By whatever they fail: the result before them is returned, and the cause named."""
    problem, levelset, _ = scene(MPI.COMM_SELF)
    with (
        patch("dolfinx_ffr.optimization.moved_parts.moved", side_effect=error),
        pytest.warns(ffr.DesignWarning, match=f"the boundary was not moved.*{message}"),
    ):
        result = quiet(problem, levelset, volume=0.8, iterations=1, boundary=2)
    assert result.moved is None and result.psi == result.evaluation.psi > 0.0


@pytest.mark.parametrize("weight", [0.0, 1e-69])
def test_nothing_to_lower_is_said_before_the_run(weight: float) -> None:
    problem, levelset, _ = scene(MPI.COMM_SELF)
    empty = ffr.Problem(
        problem.bodies, problem.mechanism, problem.integrator, weight * ffr.IntegralCompliance()
    )
    for optimizer in (ffr.MMA(), STEPS):
        with pytest.raises(ValueError, match=r"optimize: psi of the start is .* nothing to lower"):
            quiet(empty, levelset, volume=0.8, iterations=3, optimizer=optimizer)
    still = ffr.Motion.smooth_step(1.0, 0.1, start=10.0)  # begins after the end
    crank = ffr.Moving.circle((0.0, 0.0), 0.1, still)
    joints = [
        ffr.Revolute(("rod", "left"), crank),
        ffr.PointOnLine(("rod", "right"), ffr.Ground()),
    ]
    resting = ffr.Mechanism(problem.mechanism.placements, joints)
    late = ffr.Problem(problem.bodies, resting, problem.integrator, ffr.IntegralCompliance())
    with pytest.raises(ValueError, match="a table begins after the end"):
        quiet(late, levelset, volume=0.8, iterations=3)


@BOTH
def test_an_objective_may_be_negative(optimizer: Any) -> None:
    """The largest first frequency of a rod whose ends are held rises from the even density's."""
    problem, levelset, _ = scene(MPI.COMM_SELF)
    of_bodies = problem.bodies, problem.mechanism, problem.integrator
    highest = ffr.Problem(*of_bodies, -ffr.Frequency("rod"))
    result = quiet(highest, levelset, volume=0.8, iterations=5, optimizer=optimizer)
    psi = result.history["psi"]
    assert psi[-1] < 1.05 * psi[0] < 0.0
    if isinstance(optimizer, ffr.MMA):
        assert result.history["merit"][-1] < result.history["merit"][0]


@pytest.mark.mpi
def test_damaged_checkpoints(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    setup, path = copy(comm), shared_tmp_path / "checkpoint"
    run(setup, output=shared_tmp_path, iterations=1)
    comm.Barrier()
    good = path.read_bytes()
    half = len(good) // 2
    flipped = good[:half] + bytes([good[half] ^ 1]) + good[half + 1 :]
    packed = BytesIO()  # with a checksum of its own, as anybody can make
    np.savez_compressed(packed, zeros=np.zeros(10**5))
    zeros = packed.getvalue()
    zeros = hashlib.sha256(zeros).hexdigest().encode() + b"\n" + zeros
    for damaged in (flipped, good[:-100], b"", b"not a checkpoint\n", zeros):
        comm.Barrier()
        if comm.rank == 0:
            path.write_bytes(damaged)
        comm.Barrier()
        with pytest.raises(ffr.CheckpointError, match=r"is damaged.*Delete it to start anew"):
            run(setup, output=shared_tmp_path, resume=True)


@pytest.mark.mpi
def test_checkpoints_of_other_problems(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    problem, levelset, start = copy(comm)
    domain, spacing = levelset.domain, levelset.spacing
    options: dict[str, Any] = {"output": shared_tmp_path, "iterations": 1, "optimizer": STEPS}
    run((problem, levelset, start), **options)
    others: dict[str, dict[str, Any]] = {
        "volume": {"volume": 0.55},
        "sharpness": {"optimizer": ffr.LevelSetEvolution(sharpness=(8.0, 32.0))},
        "knots": {"design": ffr.LevelSet(domain, spacing=0.01)},
        "radius": {"design": ffr.LevelSet(domain, spacing=spacing, minimum_gap=0.0075)},
        "mirrors": {"design": ffr.LevelSet(domain, mirrors=ffr.mirror_lines(domain))},
        "psi of its design was": {},
    }
    for name, changed in others.items():
        design = changed.pop("design", levelset)
        if not changed and design is levelset:
            problem.target = 1.0 - problem.target
        with pytest.raises(ffr.CheckpointError, match=f"of another problem.*{name}"):
            setup = (problem, design, design.with_holes(6, 1, 0.01))
            run(setup, resume=True, **{**options, **changed})


@pytest.mark.mpi
def test_files_of_a_state(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """They hold it; those that are missing or cannot be written are named."""
    state = {"phi": np.arange(5.0), "iteration": 3, "kernel": "Wendland"}
    io.save_checkpoint(comm, shared_tmp_path / "state", state)
    result = io.load_checkpoint(comm, shared_tmp_path / "state")
    assert np.array_equal(result["phi"], state["phi"])
    assert (result["iteration"].item(), result["kernel"].item()) == (3, "Wendland")
    with pytest.raises(FileNotFoundError, match="nowhere"):
        io.load_checkpoint(comm, shared_tmp_path / "nowhere")
    if comm.rank == 0:
        (shared_tmp_path / "taken").write_text("a file, not a folder")
    comm.Barrier()
    with pytest.raises(OSError, match="taken"):
        run(copy(comm), output=shared_tmp_path / "taken", iterations=1)


@pytest.mark.mpi
def test_what_does_not_go_together_is_refused(comm: MPI.Intracomm) -> None:
    problem, levelset, start = copy(comm)
    other, gray = ffr.LevelSet(Copy(comm, disc).domain), ffr.DensityDesign(problem.domain)
    cases: list[tuple[tuple[Any, ...], dict[str, Any], str]] = [
        ((other, start), {}, "not on the domain of the problem's body"),
        ((gray,), {"optimizer": STEPS}, "moves level sets"),
        ((gray,), {"optimizer": ffr.MMA(), "move": 0.5}, r"\['move'\] to the optimizer, opt.*=MMA"),
        (({"beam": gray}, gray.even(0.5)), {}, r"designs are given for \['beam'\]"),
    ]
    for setup, options, message in cases:
        with pytest.raises(ValueError, match=message):
            run((problem, *setup), **options)
    problem.flexible["twin"] = problem.flexible["plate"]
    message = r"designs one body, and the problem has \['plate', 'twin'\]"
    with pytest.raises(ValueError, match=message):
        run((problem, levelset, start))


@pytest.mark.mpi
def test_two_programs_do_not_write_into_one_folder(
    comm: MPI.Intracomm, shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second is told so on every rank; a run that has ended, or was killed, holds nothing."""
    problem = Copy(comm, lambda p: 0.5 + 0.0 * p[:, 0])
    design = ffr.DensityDesign(problem.domain)

    def once(**options: Any) -> ffr.Result:
        return run((problem, design), iterations=1, output=shared_tmp_path, **options)

    message = "another program, or another call, is writing into"
    with pytest.raises(BlockingIOError, match=message):
        once(callback=lambda *_: once())
    once()
    hold = "import sys, time; from pathlib import Path; from dolfinx_ffr.files import locked; "
    hold += "locked(Path(sys.argv[1]) / '.lock'); print('held', flush=True); time.sleep(100)"
    if comm.rank == 0:
        program = processes.command("-c", hold, str(shared_tmp_path))
        other = subprocess.Popen(program, env=processes.environment(), stdout=subprocess.PIPE)
        assert other.stdout is not None and other.stdout.readline() == b"held\n"
    comm.Barrier()
    with pytest.raises(BlockingIOError, match=message):
        once()
    if comm.rank == 0:
        other.kill()
        other.communicate()
    comm.Barrier()
    once()
    # a file system without locks

    def no_locks(*_: object) -> None:
        raise OSError(errno.ENOTSUP, "Operation not supported")

    monkeypatch.setattr("fcntl.flock", no_locks)
    once()


@pytest.mark.mpi
@BOTH
def test_a_start_without_use(comm: MPI.Intracomm, shared_tmp_path: Path, optimizer: Any) -> None:
    """Not where it is the one that the run began with, as in a program that is called again."""
    problem, levelset, start = copy(comm)
    options: dict[str, Any] = {"output": shared_tmp_path, "optimizer": optimizer}
    run((problem, levelset, start), iterations=1, **options)
    options |= {"iterations": 2, "resume": True}
    run((problem, levelset, start), **options)
    run((problem, levelset), **options)
    with pytest.warns(ffr.DesignWarning, match="ignores the start, which differs"):
        run((problem, levelset, levelset.even(0.6)), **options)


@pytest.mark.mpi
def test_summaries_are_json_whatever_they_hold(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """NaN and infinity, for which JSON has no word, are null, and the report goes on."""
    file = shared_tmp_path / "sub" / "summary.json"
    numbers = {"psi": np.float64(1.5), "steps": np.int64(3), "list": np.arange(2), "name": "x"}
    values = {"a": math.nan, "b": [1.0, -math.inf], "c": {"d": np.array([np.nan, 2.0])}, "e": True}
    ffr.write_summary(comm, file, {**numbers, **values, "volume": {"rod": np.nan}})

    def refuse(word: str) -> None:
        raise AssertionError(word)

    comm.Barrier()
    assert json.loads(file.read_text(), parse_constant=refuse) == {
        **{"psi": 1.5, "steps": 3, "list": [0, 1], "name": "x", "volume": {"rod": None}},
        **{"a": None, "b": [1.0, None], "c": {"d": [None, 2.0]}, "e": True},
    }
    ffr.write_summary(comm, file, {"psi": math.nan})
    assert ffr.write_report(comm, file.parent).is_file()
    endless: dict[str, Any] = {}
    endless["inner"] = endless
    deep: list[Any] = []
    for _ in range(100_000):
        deep = [deep]
    for bad in (endless, {"deep": deep}):
        with pytest.raises(ValueError, match="write_summary: the summary contains itself"):
            ffr.write_summary(comm, file, bad)


@pytest.mark.filterwarnings("ignore::dolfinx_ffr.DesignWarning")
def test_other_objectives_are_told_during_a_run(comm: MPI.Intracomm) -> None:
    """By a callback, as if each had been asked for; also where the loop has added modes."""
    problem = slider_crank(comm, (20, 4), modes=1)
    watched = [problem.objective, ffr.Mass("rod"), ffr.JointForce("slider"), ffr.PeakStress("rod")]
    reported: list[list[float]] = []

    def watch(iteration: int, x: np.ndarray, evaluation: ffr.Evaluation) -> None:
        response = problem.response(evaluation)
        reported.append([objective.evaluate(response) for objective in watched])

    design = ffr.DensityDesign(problem.flexible["rod"].domain)
    options: dict[str, Any] = {"optimizer": ffr.MMA(length=40), "mode_tolerance": 1e-5}
    result = run((problem, design), iterations=2, volume=0.8, callback=watch, **options)
    np.testing.assert_allclose([row[0] for row in reported], result.history["psi"][1:], rtol=1e-12)
    modes = result.problem.flexible["rod"].modes
    assert modes > 1
    setup = (problem.bodies, problem.mechanism, problem.integrator)
    alone = [
        ffr.Problem(*setup, objective).with_modes({"rod": modes}).value(result.x).psi
        for objective in watched
    ]
    np.testing.assert_allclose(reported[-1], alone, rtol=1e-8)


@pytest.mark.mpi
def test_a_second_interruption(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """`KeyboardInterrupt` at once, and the run goes on from the last whole iteration."""
    setup = copy(comm)
    options: dict[str, Any] = {"output": shared_tmp_path, "iterations": 6}

    def interrupt(iteration: int, x: np.ndarray, evaluation: ffr.Evaluation) -> None:
        if iteration == 3:
            os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        run(setup, **options, callback=interrupt)
    rest = run(setup, **options, resume=True)
    uninterrupted = run(copy(comm), iterations=6)
    np.testing.assert_allclose(rest.history["psi"], uninterrupted.history["psi"], rtol=1e-12)
