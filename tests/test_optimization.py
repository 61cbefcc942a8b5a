# SPDX-License-Identifier: MIT
"""The design loop: descent, stages, interruption, checkpoints, histories."""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import dolfinx_ffr as ffr
from dolfinx_ffr import io
from dolfinx_ffr.optimization import COLUMNS

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
from slider_crank import reference_problem

ITERATIONS = 12


class Copy:
    """A problem with a known answer: psi = sum_e V_e (x_e - target_e)^2 / sum_e V_e."""

    def __init__(self, comm: MPI.Intracomm, target: Callable[[np.ndarray], np.ndarray]) -> None:
        self.domain = ffr.Domain.rectangle(comm, 0.4, 0.08, elements=(40, 8))
        self.flexible = {"plate": SimpleNamespace(domain=self.domain)}
        self.constraints: list[Any] = []
        self.target = np.where(self.domain.design_cells, target(self.domain.centroids), 1.0)
        #: number of the values that fail, from 1
        self.broken: set[int] = set()
        self.calls = 0

    def value(self, x: np.ndarray) -> Any:
        self.calls += 1
        if self.calls in self.broken:
            raise ffr.SimulationError("too soft", trajectory=None)
        domain = self.domain
        defect = x - self.target
        return ffr.Evaluation(
            psi=domain.sum(domain.cell_volumes * defect**2) / domain.area + 1.0,
            gradient={"plate": 2.0 * domain.cell_volumes * defect / domain.area},
            trajectory=None,
            bodies={},
            volume={"plate": domain.sum(domain.cell_volumes * x) / domain.area},
            frequencies={"plate": np.array([7.0])},
            outer_gap={"plate": 1.0},
            solver_iterations={"plate": 3},
            seconds={},
        )

    def differentiate(self, evaluation: Any) -> Any:
        return evaluation

    gradient = value


def disc(c: np.ndarray) -> np.ndarray:
    """Solid but for an ellipse."""
    return np.where(np.hypot((c[:, 0] - 0.2) / 0.12, c[:, 1] / 0.025) < 1.0, 0.0, 1.0)


def scene(comm: MPI.Intracomm) -> tuple[ffr.Problem, ffr.LevelSet, np.ndarray]:
    """The slider-crank on a coarse mesh, with a start design."""
    problem = reference_problem(comm, (40, 8), modes=4, steps=200)
    levelset = ffr.LevelSet(problem.flexible["rod"].domain)
    return problem, levelset, levelset.with_holes(6, 1, 0.01)


def run(parts: Any, **options: Any) -> ffr.Result:
    """Run the loop on a scene, without noise."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ffr.SofteningWarning)
        return ffr.optimize(
            *parts, **{"iterations": ITERATIONS, "progress": False, "volume": 0.6, **options}
        )


# ---------------------------------------------------------------------- descent


@pytest.mark.mpi
def test_a_known_shape_is_found(comm: MPI.Intracomm) -> None:
    """Eight small holes merge into the one that is wanted; the volume bound is not in the way."""
    problem = Copy(comm, disc)
    levelset = ffr.LevelSet(problem.domain)
    result = run((problem, levelset, levelset.with_holes(8, 1, 0.012)), volume=1.0, iterations=80)
    assert result.reason == "converged"
    assert result.psi - 1.0 < 0.02 * (result.history["psi"][0] - 1.0) + 0.006
    differs = np.abs(result.x - problem.target) > 0.5
    wrong = problem.domain.sum(problem.domain.cell_volumes * differs)
    assert wrong / problem.domain.area < 0.01
    assert np.all(result.history["multiplier"] == 0.0)


@pytest.mark.mpi
def test_the_volume_bound_is_kept(comm: MPI.Intracomm) -> None:
    """More material would be better, and the bound is used up."""
    problem = Copy(comm, disc)
    levelset = ffr.LevelSet(problem.domain)
    result = run((problem, levelset, levelset.with_holes(8, 1, 0.02)), iterations=30)
    assert np.all(result.history["volume"] <= 0.6 + 1e-12)
    assert np.all(result.history["multiplier"] >= 0.0)
    assert result.history["volume"][-1] == pytest.approx(0.6, rel=1e-3)
    assert result.history["multiplier"][1:].max() > 0.0


@pytest.mark.mpi
def test_psi_falls_in_every_stage(comm: MPI.Intracomm) -> None:
    parts = scene(comm)
    result = run(parts)
    history, levelset = result.history, parts[1]
    same_stage = np.diff(history["width"]) == 0.0
    kept = history["accepted"] == 1.0
    falls = np.diff(history["psi"])
    assert np.all(falls[same_stage & kept[1:]] < 0.0)
    assert np.all(falls[same_stage & ~kept[1:]] == 0.0)
    assert history["psi"][-1] < 0.5 * history["psi"][0]
    assert np.unique(history["width"] / levelset.element) == pytest.approx([0.2, 0.35, 0.6, 1.0])
    # the result is what the last row says, and fits together
    assert result.iterations == ITERATIONS
    assert result.psi == history["psi"][-1]
    assert np.array_equal(result.x, levelset.fill_fraction(result.coefficients))
    assert levelset.volume(result.coefficients) == pytest.approx(history["volume"][-1], rel=1e-12)
    domain = levelset.domain
    assert ffr.gray_fraction(domain, result.x) == history["gray"][-1]
    assert result.evaluation.gradient is not None


@pytest.mark.mpi
def test_ranks_agree(comm: MPI.Intracomm) -> None:
    result = run(scene(comm), iterations=4)
    rows = np.array([result.history[name] for name in COLUMNS if name != "seconds"])
    mine = result.coefficients.tobytes() + rows.tobytes() + result.reason.encode()
    assert len(set(comm.allgather(mine))) == 1


@pytest.mark.mpi
def test_a_step_that_cannot_be_simulated_is_halved(comm: MPI.Intracomm) -> None:
    problem = Copy(comm, disc)
    levelset = ffr.LevelSet(problem.domain)
    problem.broken = {3, 4}  # after the even density and the start
    start = levelset.with_holes(8, 1, 0.012)
    result = run((problem, levelset, start), iterations=3, volume=1.0, widths=(1.0,))
    assert result.history["accepted"].tolist() == [1, 0, 0, 1]
    assert result.history["step"].tolist() == pytest.approx([1.0, 0.5, 0.25, 0.325])


@pytest.mark.mpi
def test_a_design_that_cannot_be_narrowed_is_kept(comm: MPI.Intracomm) -> None:
    problem = Copy(comm, disc)
    levelset = ffr.LevelSet(problem.domain)
    problem.broken = {5}  # after the even density, the start and two steps
    start = levelset.with_holes(8, 1, 0.012)
    result = run((problem, levelset, start), iterations=4, volume=1.0, widths=(1.0, 0.5))
    assert (result.reason, result.iterations) == ("stalled", 2)
    assert levelset.width == levelset.element
    assert result.psi == problem.value(levelset.fill_fraction(result.coefficients)).psi


@pytest.mark.mpi
def test_a_start_in_pieces_gives_way_to_an_even_density(comm: MPI.Intracomm) -> None:
    problem, levelset, _ = scene(comm)
    cut = levelset.interpolate(lambda x: np.abs(x[:, 0] - 0.2) - 0.04)
    with pytest.warns(UserWarning, match="the start design has fallen apart"):
        result = run((problem, levelset, cut), iterations=0)
    assert result.history["gray"][0] > 0.8
    assert result.reason == "iterations"


def test_gray_fraction_counts_areas() -> None:
    domain = ffr.Domain.rectangle(MPI.COMM_SELF, 1.0, 0.1, elements=(10, 1), solid_columns=0)
    x = np.zeros(domain.n_cells)
    x[:4] = [0.1, 0.9, 0.5, 0.11]
    assert ffr.gray_fraction(domain, x) == pytest.approx(0.2)
    assert ffr.gray_fraction(domain, x, 0.05, 0.95) == pytest.approx(0.4)


# ---------------------------------------------------------------------- files


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


@pytest.mark.mpi
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_and_resumed_is_as_if_uninterrupted(
    comm: MPI.Intracomm, shared_tmp_path: Path, number: signal.Signals
) -> None:
    """A signal on the last rank alone ends the loop on all of them, after the iteration at hand."""
    parts = scene(comm)
    whole = run(parts)

    def interrupt(iteration: int, x: np.ndarray, evaluation: ffr.Evaluation) -> None:
        if iteration == 7 and comm.rank == comm.size - 1:
            os.kill(os.getpid(), number)

    before = signal.getsignal(number)
    first = run(parts, output=shared_tmp_path, callback=interrupt)
    assert signal.getsignal(number) == before
    assert (first.reason, first.iterations) == ("interrupted", 7)
    # on several ranks MUMPS adds up in an order that changes from run to run
    assert first.psi == pytest.approx(
        whole.history["psi"][7], rel=1e-12 if comm.size == 1 else 1e-9
    )
    assert len(ffr.read_history(shared_tmp_path / "history.csv")["psi"]) == 8

    # on the same mesh: another one may be distributed differently
    levelset = ffr.LevelSet(parts[1].domain)
    rest = run((parts[0], levelset, parts[2]), output=shared_tmp_path, resume=True)
    assert (rest.reason, rest.iterations) == (whole.reason, whole.iterations)
    for name in ("psi", "volume", "gray", "accepted", "step", "width"):
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
    assert np.array_equal(again.coefficients, first.coefficients)
    assert np.array_equal(again.history["seconds"], first.history["seconds"])
    more = run(scene(comm), output=shared_tmp_path, iterations=5, resume=True)
    assert more.iterations == 5
    assert np.array_equal(more.history["psi"][:4], first.history["psi"])


@pytest.mark.mpi
def test_resume_without_a_checkpoint_starts_anew(
    comm: MPI.Intracomm, shared_tmp_path: Path
) -> None:
    result = run(scene(comm), output=shared_tmp_path / "new", iterations=1, resume=True)
    assert result.iterations == 1


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
@pytest.mark.parametrize("change", ["volume", "widths", "knots", "kernel", "steps"])
def test_a_checkpoint_of_another_problem_is_refused(
    comm: MPI.Intracomm, shared_tmp_path: Path, change: str
) -> None:
    problem, levelset, start = scene(comm)
    run((problem, levelset, start), output=shared_tmp_path, iterations=1)
    options: dict[str, Any] = {}
    name = change
    if change == "volume":
        options["volume"] = 0.55
    elif change == "widths":
        options["widths"] = (1.0, 0.5)
    elif change == "knots":
        levelset = ffr.LevelSet(levelset.domain, spacing=0.008)
    elif change == "kernel":
        levelset = ffr.LevelSet(levelset.domain, kernel=ffr.Wendland(0.031))
    else:
        problem.integrator = ffr.GeneralizedAlpha(2.0, 190)
        name = "psi of its design was"
    start = levelset.with_holes(6, 1, 0.01)
    with pytest.raises(ffr.CheckpointError, match=f"of another problem.*{name}"):
        run((problem, levelset, start), output=shared_tmp_path, resume=True, **options)


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
        ({"iterations": -1}, "iterations = -1"),
        ({"widths": ()}, r"widths = \(\)"),
        ({"widths": (1.0, 0.0)}, r"widths = \(1.0, 0.0\)"),
        ({"step": 0.0}, "step = 0.0"),
        ({"step": math.nan}, "step = nan"),
        ({"tolerance": -1.0}, "tolerance = -1.0"),
        ({"reinitialize_every": -1}, "reinitialize_every = -1"),
        ({"volume": 1.5}, "volume = 1.5 must be a share"),
        ({"volume": 0.05}, "leaves nothing to design"),
    ],
)
def test_bad_options_are_refused(
    comm: MPI.Intracomm, options: dict[str, Any], message: str
) -> None:
    parts = scene(comm)
    with pytest.raises(ValueError, match=message):
        run(parts, **options)


@pytest.mark.mpi
def test_parts_that_do_not_fit_are_refused(comm: MPI.Intracomm) -> None:
    problem, levelset, start = scene(comm)
    other = ffr.LevelSet(ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(40, 8)))
    with pytest.raises(ValueError, match="not on the domain of the problem's body"):
        run((problem, other, start))
    with pytest.raises(ValueError, match="the evolution moves another level set"):
        run((problem, levelset, start), evolution=ffr.Evolution(other, 0.6))
    with pytest.raises(ValueError, match="finite coefficients, one a knot"):
        run((problem, levelset, start[:-1]))
    with pytest.raises(ValueError, match="with NaN or infinity"):
        run((problem, levelset, np.full(len(start), np.nan)))
    two = ffr.Problem(
        {**problem.bodies, "twin": problem.bodies["rod"]},
        problem.mechanism,
        problem.integrator,
        problem.objective,
    )
    with pytest.raises(
        ValueError, match=r"designs one body, and the problem has \['rod', 'twin'\]"
    ):
        run((two, levelset, start))
