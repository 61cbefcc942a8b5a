# SPDX-License-Identifier: MIT
"""The design loop: descent, stages, interruption, checkpoints, histories."""

from __future__ import annotations

import json
import math
import os
import signal
import warnings
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import Copy, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr import io
from dolfinx_ffr.optimization.loop import COLUMNS, GRADIENT_COLUMNS


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
        for expected in (ffr.SofteningWarning, ffr.LargeDeformationWarning):
            warnings.simplefilter("ignore", expected)
        warnings.filterwarnings("ignore", ".*(is gray|violates)", ffr.DesignWarning)
        usual = {"iterations": 3, "progress": False, "volume": 0.6, "mode_tolerance": None}
        return ffr.optimize(*parts, **{**usual, **options})


#: Both ways to move a level set
BOTH = pytest.mark.parametrize(
    "optimizer", [ffr.LevelSetEvolution(), ffr.MMA()], ids=["steps", "MMA"]
)
STEPS = ffr.LevelSetEvolution()


def one_stage(**options: Any) -> ffr.LevelSetEvolution:
    return ffr.LevelSetEvolution(sharpness=(11.0,), **options)


# ---------------------------------------------------------------------- explicit steps


@pytest.mark.mpi
def test_a_known_shape_is_found(comm: MPI.Intracomm) -> None:
    """Eight small holes merge into the one that is wanted; the volume bound is not in the way."""
    parts = copy(comm)
    problem = parts[0]
    result = run(parts, volume=1.0, iterations=60, optimizer=STEPS)
    assert result.history["sharpness"][-1] == 56.0
    assert result.psi - 1.0 < 0.02 * (result.history["psi"][0] - 1.0) + 0.006
    differs = np.abs(result.x - problem.target) > 0.5
    wrong = problem.domain.sum(problem.domain.cell_volumes * differs)
    assert wrong / problem.domain.area < 0.01
    assert ffr.gray_fraction(problem.domain, result.x) < 0.15
    assert np.all(result.history["multiplier"] == 0.0)


@pytest.mark.mpi
def test_the_volume_bound_is_kept(comm: MPI.Intracomm) -> None:
    """More material would be better, and the bound is used up."""
    result = run(copy(comm), iterations=20, optimizer=STEPS)
    assert np.all(result.history["volume"] <= 0.6 + 1e-12)
    assert np.all(result.history["multiplier"] >= 0.0)
    # at last the history tells the design that is analysed, a little within the one that is made
    assert result.history["volume"][-1] < 0.59
    (made,) = result.evaluation.volume.values()
    assert made == pytest.approx(0.6, rel=1e-3)
    assert result.history["multiplier"][1:].max() > 0.0


@pytest.mark.slow
@pytest.mark.mpi
def test_psi_falls_in_every_stage(comm: MPI.Intracomm) -> None:
    parts = scene(comm)
    result = run(parts, iterations=12, optimizer=STEPS)
    history, levelset = result.history, parts[1]
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
    value = parts[0].value(analysed)
    assert value.psi == pytest.approx(history["psi"][-1], rel=1e-9)
    assert value.volume["rod"] == pytest.approx(history["volume"][-1], rel=1e-12)
    assert ffr.gray_fraction(levelset.domain, analysed) == history["gray"][-1]
    assert np.array_equal(result.x, last.density(result.coefficients))
    assert np.array_equal(result.x, result.designs["rod"].density(result.coefficients))
    assert result.psi < parts[0].value(result.x).psi
    assert result.evaluation.volume["rod"] > value.volume["rod"]


@pytest.mark.mpi
@BOTH
def test_ranks_agree(comm: MPI.Intracomm, optimizer: Any) -> None:
    result = run(scene(comm), optimizer=optimizer)
    rows = np.array([result.history[name] for name in COLUMNS if name != "seconds"])
    mine = result.coefficients.tobytes() + rows.tobytes() + result.reason.encode()
    assert len(set(comm.allgather(mine))) == 1


@pytest.mark.mpi
def test_a_step_that_cannot_be_simulated_is_halved(comm: MPI.Intracomm) -> None:
    parts = copy(comm)
    parts[0].broken = {3, 4}  # after the even density and the start
    result = run(parts, volume=1.0, optimizer=one_stage())
    assert result.history["accepted"].tolist() == [1, 0, 0, 1]
    assert result.history["step"].tolist() == pytest.approx([1.0, 0.5, 0.25, 0.325])


@pytest.mark.mpi
def test_a_design_that_cannot_be_sharpened_is_kept(comm: MPI.Intracomm) -> None:
    parts = copy(comm)
    problem, levelset, _ = parts
    problem.broken = {5}  # after the even density, the start and two steps
    two_stages = ffr.LevelSetEvolution(sharpness=(8.0, 32.0))
    result = run(parts, iterations=4, volume=1.0, optimizer=two_stages)
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


@pytest.mark.mpi
def test_the_start_is_even_where_none_is_given(comm: MPI.Intracomm) -> None:
    for design in (ffr.LevelSet, ffr.DensityDesign):
        problem = Copy(comm, disc)
        part = design(problem.domain)
        found = run((problem, part))
        given = run((problem, part, part.even()))
        assert np.array_equal(found.variables["plate"], given.variables["plate"])


def test_gray_fraction_counts_areas() -> None:
    domain = ffr.Domain.rectangle(MPI.COMM_SELF, 1.0, 0.1, elements=(10, 1), solid_columns=0)
    x = np.zeros(domain.n_cells)
    x[:4] = [0.1, 0.9, 0.5, 0.11]
    assert ffr.gray_fraction(domain, x) == pytest.approx(0.2)
    assert ffr.gray_fraction(domain, x, 0.05, 0.95) == pytest.approx(0.4)


# ---------------------------------------------------------------------- no hidden state


@pytest.mark.mpi
@BOTH
def test_one_level_set_serves_two_optimisations(comm: MPI.Intracomm, optimizer: Any) -> None:
    """One within an iteration of the other: both as if each had a level set of its own."""
    problem = Copy(comm, disc)
    inner: list[ffr.Result] = []

    def results(shared: bool) -> list[ffr.Result]:
        first = ffr.LevelSet(problem.domain)
        second = first if shared else ffr.LevelSet(problem.domain)
        start = first.with_holes(8, 1, 0.016)
        before = first.density(start)
        inner.clear()

        def other(iteration: int, x: np.ndarray, evaluation: ffr.Evaluation) -> None:
            if iteration == 2:
                inner.append(run((problem, second, start), optimizer=one_stage()))

        outer = run((problem, first, start), iterations=5, optimizer=optimizer, callback=other)
        assert np.array_equal(first.density(start), before)
        return [outer, *inner]

    for shared, alone in zip(results(True), results(False), strict=True):
        assert np.array_equal(shared.coefficients, alone.coefficients)
        assert np.array_equal(shared.x, alone.x)
        assert np.array_equal(shared.history["psi"], alone.history["psi"])


@pytest.mark.mpi
def test_one_problem_serves_two_optimisations(comm: MPI.Intracomm) -> None:
    """One within an iteration of the other, with another kind of design on the same body."""
    inner: list[ffr.Result] = []

    def results(shared: bool) -> list[ffr.Result]:
        first, levelset, start = scene(comm)
        second = first if shared else scene(comm)[0]
        densities = ffr.DensityDesign(second.flexible["rod"].domain)
        inner.clear()

        def other(iteration: int, x: np.ndarray, evaluation: ffr.Evaluation) -> None:
            if iteration == 1:
                inner.append(run((second, densities), iterations=2))

        return [run((first, levelset, start), iterations=2, callback=other), *inner]

    for shared, alone in zip(results(True), results(False), strict=True):
        # cells may be distributed differently on each mesh
        for name in ("psi", "volume", "gray"):
            assert shared.history[name] == pytest.approx(alone.history[name], rel=1e-8), name


# ---------------------------------------------------------------------- files


@pytest.mark.mpi
@pytest.mark.parametrize("first", ["exact", "approximate"])
def test_the_gradient_has_columns_where_it_is_approximated(
    comm: MPI.Intracomm, shared_tmp_path: Path, first: str
) -> None:
    """A run may go on with the other kind of gradient; what was not known then is NaN."""
    kinds = {
        "exact": ffr.ExactAdjoint(),
        "approximate": ffr.ApproximateGradient(
            ffr.GradientElements(share=0.4), ffr.ExponentialSpline(0.1)
        ),
    }
    second = next(name for name in kinds if name != first)
    begun = run(scene(comm), output=shared_tmp_path, iterations=1, gradient=kinds[first])
    assert list(begun.history) == COLUMNS + (GRADIENT_COLUMNS if first == "approximate" else [])
    result = run(
        scene(comm), output=shared_tmp_path, iterations=2, resume=True, gradient=kinds[second]
    )
    assert set(result.history) == {*COLUMNS, *GRADIENT_COLUMNS}
    estimate = result.history["gradient_estimate"]
    if first == "exact":
        assert np.all(np.isnan(estimate[:2])) and estimate[2] > 0.0
    else:
        assert np.all(estimate[:2] > 0.0)
    comm.Barrier()
    found = ffr.read_history(shared_tmp_path / "history.csv")
    np.testing.assert_array_equal(found["gradient_estimate"], estimate)


@pytest.mark.mpi
def test_history_is_on_the_disk_after_each_iteration(
    comm: MPI.Intracomm, shared_tmp_path: Path
) -> None:
    lengths = []

    def look(iteration: int, x: np.ndarray, evaluation: ffr.Evaluation) -> None:
        lengths.append(len(ffr.read_history(shared_tmp_path / "history.csv")["psi"]) - iteration)

    result = run(scene(comm), output=shared_tmp_path, callback=look, iterations=4)
    assert lengths == [1, 1, 1, 1]
    comm.Barrier()
    found = ffr.read_history(shared_tmp_path / "history.csv")
    assert list(found) == COLUMNS
    for name in COLUMNS:
        np.testing.assert_array_equal(found[name], result.history[name], name)
    assert sorted(p.name for p in shared_tmp_path.iterdir()) == ["checkpoint", "history.csv"]


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_and_resumed_is_as_if_uninterrupted(
    comm: MPI.Intracomm, shared_tmp_path: Path, number: signal.Signals
) -> None:
    """A signal on the last rank alone ends the loop on all of them, after the iteration at hand."""
    parts = scene(comm)
    whole = run(parts, iterations=8, optimizer=STEPS)

    def interrupt(iteration: int, x: np.ndarray, evaluation: ffr.Evaluation) -> None:
        if iteration == 5 and comm.rank == comm.size - 1:
            os.kill(os.getpid(), number)

    before = signal.getsignal(number)
    options = {"iterations": 8, "optimizer": STEPS, "output": shared_tmp_path}
    first = run(parts, **options, callback=interrupt)
    assert signal.getsignal(number) == before
    assert (first.reason, first.iterations) == ("interrupted", 5)
    # on several ranks MUMPS adds up in an order that changes from run to run
    assert first.history["psi"][5] == pytest.approx(
        whole.history["psi"][5], rel=1e-12 if comm.size == 1 else 1e-9
    )
    assert len(ffr.read_history(shared_tmp_path / "history.csv")["psi"]) == 6

    # on the same mesh: another one may be distributed differently
    levelset = ffr.LevelSet(parts[1].domain)
    rest = run((parts[0], levelset, parts[2]), **options, resume=True)
    assert (rest.reason, rest.iterations) == (whole.reason, whole.iterations)
    for name in ("psi", "volume", "gray", "accepted", "step", "sharpness"):
        assert rest.history[name] == pytest.approx(whole.history[name], rel=1e-9), name
    scale = np.max(np.abs(whole.coefficients))
    assert rest.coefficients == pytest.approx(whole.coefficients, abs=1e-9 * scale)
    assert rest.x == pytest.approx(whole.x, abs=1e-8)
    comm.Barrier()
    found = ffr.read_history(shared_tmp_path / "history.csv")
    assert np.array_equal(found["psi"], rest.history["psi"])


@pytest.mark.mpi
def test_resuming_a_finished_run_changes_nothing(
    comm: MPI.Intracomm, shared_tmp_path: Path
) -> None:
    first = run(scene(comm), output=shared_tmp_path, iterations=3)
    again = run(scene(comm), output=shared_tmp_path, iterations=3, resume=True)
    # the knots are factored anew, and what BLAS makes of that depends on the place in memory
    scale = np.max(np.abs(first.coefficients))
    assert again.coefficients == pytest.approx(first.coefficients, abs=1e-12 * scale)
    assert np.array_equal(again.history["seconds"], first.history["seconds"])
    more = run(scene(comm), output=shared_tmp_path, iterations=5, resume=True)
    assert more.iterations == 5
    assert np.array_equal(more.history["psi"][:4], first.history["psi"])


@pytest.mark.mpi
@BOTH
def test_a_checkpoint_serves_where_cells_are_distributed_otherwise(
    comm: MPI.Intracomm, shared_tmp_path: Path, optimizer: Any
) -> None:
    """Begun on all ranks and ended on one less; sums over the cells differ in their last bits."""
    first = run(scene(comm), output=shared_tmp_path, iterations=1, optimizer=optimizer)
    fewer = comm.Split(int(comm.rank > 0 or comm.size == 1))
    if comm.rank > 0 or comm.size == 1:
        parts = scene(fewer)
        domain = parts[1].domain
        # as any order of the sum may make it
        area = domain.area
        domain.__dict__["cell_volumes"] = domain.cell_volumes * (1.0 + 4.0 * np.finfo(float).eps)
        assert domain.area != area
        parts = (parts[0], ffr.LevelSet(domain), parts[2])
        more = run(parts, output=shared_tmp_path, iterations=2, resume=True, optimizer=optimizer)
        assert more.iterations == 2
        assert np.array_equal(more.history["psi"][:2], first.history["psi"])
    fewer.Free()


@pytest.mark.mpi
def test_resume_without_a_checkpoint_starts_anew(
    comm: MPI.Intracomm, shared_tmp_path: Path
) -> None:
    with pytest.warns(ffr.DesignWarning, match="no checkpoint .*new.checkpoint to go on from"):
        result = run(scene(comm), output=shared_tmp_path / "new", iterations=1, resume=True)
    assert result.iterations == 1
    with pytest.raises(ValueError, match="resume=True needs the folder of the checkpoint"):
        run(scene(comm), iterations=1, resume=True)


@pytest.mark.mpi
@pytest.mark.parametrize(
    "given",
    [ffr.LevelSetEvolution(stage_iterations=3), ffr.LevelSetEvolution(), ffr.MMA()],
    ids=["steps of a given length", "steps", "MMA"],
)
def test_the_way_does_not_depend_on_how_a_run_is_cut_up(
    comm: MPI.Intracomm, shared_tmp_path: Path, given: Any
) -> None:
    """Neither with stages of a given length, nor with what the first call has planned."""
    parts = copy(comm)

    def through(iterations: list[int], folder: str) -> ffr.Result:
        options = {"output": shared_tmp_path / folder, "optimizer": given}
        result = run(parts, iterations=iterations[0], **options)
        for later in iterations[1:]:
            result = run(parts, iterations=later, resume=True, **options)
        return result

    whole, cut = through([6, 12], "whole"), through([6, 7, 10, 12], "cut")
    assert len(np.unique(whole.history["sharpness"])) > 1
    for column in ("psi", "sharpness", "accepted", "step"):
        np.testing.assert_allclose(cut.history[column], whole.history[column], rtol=1e-9)


@pytest.mark.mpi
@BOTH
def test_less_iterations_than_done_change_nothing(
    comm: MPI.Intracomm, shared_tmp_path: Path, optimizer: Any
) -> None:
    parts = copy(comm)
    options = {"output": shared_tmp_path, "optimizer": optimizer}
    first = run(parts, iterations=4, **options)
    comm.Barrier()
    before = (shared_tmp_path / "checkpoint").read_bytes()
    again = run(parts, iterations=2, resume=True, **options)
    assert (again.reason, again.iterations) == ("iterations", 4)
    assert again.history["psi"].tolist() == first.history["psi"].tolist()
    assert again.designs["plate"].sharpness == first.designs["plate"].sharpness
    comm.Barrier()
    assert (shared_tmp_path / "checkpoint").read_bytes() == before


@pytest.mark.mpi
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
@pytest.mark.parametrize("damage", ["flipped", "truncated", "empty", "text"])
def test_a_damaged_checkpoint_is_refused(
    comm: MPI.Intracomm, shared_tmp_path: Path, damage: str
) -> None:
    parts = scene(comm)
    run(parts, output=shared_tmp_path, iterations=1)
    path = shared_tmp_path / "checkpoint"
    if comm.rank == 0:
        content = bytearray(path.read_bytes())
        if damage == "flipped":
            content[len(content) // 2] ^= 1
        path.write_bytes(
            {"flipped": bytes(content), "truncated": bytes(content[:-100]), "empty": b""}.get(
                damage, b"not a checkpoint\n"
            )
        )
    comm.Barrier()
    with pytest.raises(ffr.CheckpointError, match=r"is damaged.*Delete it to start anew"):
        run(parts, output=shared_tmp_path, resume=True)


@pytest.mark.mpi
@pytest.mark.parametrize("change", ["volume", "sharpness", "knots", "radius", "mirrors", "steps"])
def test_a_checkpoint_of_another_problem_is_refused(
    comm: MPI.Intracomm, shared_tmp_path: Path, change: str
) -> None:
    problem, levelset, start = scene(comm)
    options: dict[str, Any] = {"output": shared_tmp_path, "iterations": 1, "optimizer": STEPS}
    run((problem, levelset, start), **options)
    name = change
    if change == "volume":
        options["volume"] = 0.55
    elif change == "sharpness":
        options["optimizer"] = ffr.LevelSetEvolution(sharpness=(8.0, 32.0))
    elif change == "knots":
        levelset = ffr.LevelSet(levelset.domain, spacing=0.01)
    elif change == "radius":
        levelset = ffr.LevelSet(levelset.domain, knots=levelset.knots, minimum_gap=0.0075)
    elif change == "mirrors":
        lines = ffr.mirror_lines(levelset.domain)
        levelset = ffr.LevelSet(levelset.domain, mirrors=lines)
    else:
        problem.integrator = ffr.GeneralizedAlpha(2.0, 190)
        name = "psi of its design was"
    start = levelset.with_holes(6, 1, 0.01)
    with pytest.raises(ffr.CheckpointError, match=f"of another problem.*{name}"):
        run((problem, levelset, start), resume=True, **options)


@pytest.mark.mpi
def test_checkpoints_survive_a_failed_write(
    comm: MPI.Intracomm, shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = shared_tmp_path / "state"
    state = {"phi": np.arange(5.0), "iteration": 3, "kernel": "Wendland"}
    io.save_checkpoint(comm, path, state)

    def full(*_: Any) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="no space left"):
        io.save_checkpoint(comm, path, {"phi": np.zeros(2)})
    found = io.load_checkpoint(comm, path)
    assert np.array_equal(found["phi"], state["phi"])
    assert (found["iteration"].item(), found["kernel"].item()) == (3, "Wendland")
    comm.Barrier()
    assert [p.name for p in shared_tmp_path.iterdir()] == ["state"]


@pytest.mark.mpi
def test_missing_and_unwritable_files_are_named(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nowhere"):
        io.load_checkpoint(comm, shared_tmp_path / "nowhere")
    if comm.rank == 0:
        (shared_tmp_path / "taken").write_text("a file, not a folder")
    comm.Barrier()
    with pytest.raises(OSError, match="taken"):
        run(scene(comm), output=shared_tmp_path / "taken", iterations=1)


@pytest.mark.mpi
def test_summary_holds_numbers(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    summary = {"psi": np.float64(1.5), "steps": np.int64(3), "list": np.arange(2), "name": "x"}
    ffr.write_summary(comm, shared_tmp_path / "sub" / "summary.json", summary)
    comm.Barrier()
    found = json.loads((shared_tmp_path / "sub" / "summary.json").read_text())
    assert found == {"psi": 1.5, "steps": 3, "list": [0, 1], "name": "x"}
    with pytest.raises(TypeError, match="cannot hold a set"):
        ffr.write_summary(comm, shared_tmp_path / "summary.json", {"bad": {1}})


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_density_files_hold_the_density(
    comm: MPI.Intracomm, shared_tmp_path: Path, cell: str
) -> None:
    """What a reader finds beside each cell's centroid is the density there."""
    h5py = pytest.importorskip("h5py")
    domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(20, 3), cell=cell)
    path = shared_tmp_path / "design.xdmf"
    ffr.write_density(domain, 0.5 + domain.centroids[:, 0], path)
    comm.Barrier()
    items = [e.text or "" for e in ElementTree.parse(path).iter("DataItem")]
    with h5py.File(path.with_suffix(".h5")) as file:
        arrays = [np.array(file[item.strip().split(":", 1)[1]]) for item in items]
    topology, geometry, density = arrays[:3]
    centroids = geometry[topology[:, -4 if cell == "quadrilateral" else -3 :]].mean(axis=1)
    assert len(density) == domain.n_cells_global
    assert density.ravel() == pytest.approx(0.5 + centroids[:, 0], abs=1e-12)


# ---------------------------------------------------------------------- bad input


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"iterations": -1}, "iterations must be a whole number that is not negative"),
        ({"volume": 1.5}, "volume must lie between 0 and 1, 0 excluded, but it is 1.5"),
        ({"volume": 0.05}, "leaves nothing to design"),
    ],
)
def test_bad_options_are_refused(
    comm: MPI.Intracomm, options: dict[str, Any], message: str
) -> None:
    parts = scene(comm)
    with pytest.raises(ValueError, match=message):
        run(parts, **options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sharpness": ()}, "sharpness must have a number for each stage"),
        ({"sharpness": (8.0, 0.0)}, "sharpness must be positive, but it is 0.0"),
        ({"step": 0.0}, "step must be positive, but it is 0.0"),
        ({"step": math.nan}, "step must be positive, but it is nan"),
        ({"tolerance": -1.0}, "tolerance must not be negative"),
        ({"reinitialize_every": -1}, "reinitialize_every must be a whole number"),
        ({"stage_iterations": 0}, "stage_iterations must be a positive whole number"),
    ],
)
def test_bad_options_of_the_evolution_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ffr.LevelSetEvolution(**options)


@pytest.mark.mpi
def test_options_of_the_optimizer_still_work(comm: MPI.Intracomm) -> None:
    parts = copy(comm)
    with pytest.warns(DeprecationWarning, match=r"\['move'\].*optimizer=MMA\(\.\.\.\)"):
        old = run(parts, move=0.05)
    new = run(parts, optimizer=ffr.MMA(move=0.05))
    assert np.array_equal(old.coefficients, new.coefficients)
    with pytest.warns(DeprecationWarning), pytest.raises(TypeError, match="'stride'"):
        run(parts, stride=1.0)


@pytest.mark.mpi
def test_parts_that_do_not_fit_are_refused(comm: MPI.Intracomm) -> None:
    problem, levelset, start = scene(comm)
    other = ffr.LevelSet(ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(40, 8)))
    with pytest.raises(ValueError, match="not on the domain of the problem's body"):
        run((problem, other, start))
    with pytest.raises(ValueError, match="the evolution moves another level set"):
        moving = ffr.LevelSetEvolution(ffr.Evolution(other, 0.6))
        run((problem, levelset, start), optimizer=moving)
    with pytest.raises(ValueError, match="finite variables, one a knot"):
        run((problem, levelset, start[:-1]))
    with pytest.raises(ValueError, match="with NaN or infinity"):
        run((problem, levelset, np.full(len(start), np.nan)))
    placements = dict.fromkeys(("rod", "twin"), ffr.Placement())
    two = ffr.Problem(
        {**problem.bodies, "twin": problem.bodies["rod"]},
        replace(problem.mechanism, placements=placements),
        problem.integrator,
        problem.objective,
    )
    with pytest.raises(
        ValueError, match=r"designs one body, and the problem has \['rod', 'twin'\]"
    ):
        run((two, levelset, start))
