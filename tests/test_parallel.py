# SPDX-License-Identifier: MIT
"""What one rank does alone: errors are raised on all, arguments that differ are refused by name."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import Copy, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr import parallel, plotting
from dolfinx_ffr.parallel import on_every_rank, on_rank_0


class Unportable(Exception):
    """What cannot be sent to another process."""

    def __init__(self, message: str, function: Callable[[], int]) -> None:
        super().__init__(message)
        self.function = function


@pytest.mark.mpi
def test_an_error_on_one_rank_is_raised_on_all(comm: MPI.Intracomm) -> None:
    is_last = comm.size - 1
    with pytest.raises(ZeroDivisionError, match="on the last"), on_every_rank(comm, "test"):
        if comm.rank == is_last:
            raise ZeroDivisionError("on the last")
    # the lowest rank decides between two kinds, and each has its own of one kind
    kinds = {0: KeyError, 1: IndexError}
    with pytest.raises(KeyError), on_every_rank(comm, "test"):
        raise kinds.get(comm.rank, OSError)("mine")
    with pytest.raises(KeyError, match=f"{comm.rank}"), on_every_rank(comm, "test"):
        raise KeyError(f"{comm.rank}")
    with on_every_rank(comm, "test"):
        rank = comm.rank
    assert rank == comm.rank
    kind = Unportable if comm.size == 1 else RuntimeError
    with pytest.raises(kind, match="held back") as caught, on_every_rank(comm, "test"):
        if comm.rank == is_last:
            raise Unportable("held back", lambda: 0)
    if comm.rank == is_last:
        assert Unportable in map(type, (caught.value, caught.value.__cause__))
    for leaving in (SystemExit(3), KeyboardInterrupt()):
        with pytest.raises(type(leaving)), on_every_rank(comm, "test"):
            if comm.rank == is_last:
                raise leaving


@pytest.mark.mpi
def test_a_rank_that_waits_says_for_what(
    comm: MPI.Intracomm, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parallel, "_PATIENCE", 0.05)
    with on_every_rank(comm, "test"):
        pass
    assert "has waited" not in capsys.readouterr().err
    if comm.rank == comm.size - 1:
        time.sleep(0.5)
    with on_every_rank(comm, "Domain.rectangle"):
        pass
    waits = comm.rank < comm.size - 1
    assert ("has waited for 0.05 s in Domain.rectangle" in capsys.readouterr().err) == waits


@pytest.mark.mpi
def test_a_rank_that_is_still_inside_learns_of_it(comm: MPI.Intracomm) -> None:
    """Within a sum, within another section, and where it swallows what it is told."""
    domain = ffr.Domain.rectangle(comm, 1.0, 0.1, elements=(10, 2), solid_columns=0)
    ones = np.ones(domain.n_cells)

    def nested() -> None:
        with on_every_rank(comm, "test"):
            domain.check_density(ones)

    def stubborn() -> None:
        for _ in range(3):
            try:
                domain.sum(ones)
            except RuntimeError:
                pass

    calls: list[Callable[[], Any]] = [
        lambda: domain.sum(ones),
        lambda: domain.everywhere(ones),
        lambda: on_rank_0(comm, lambda: None),
        nested,
        stubborn,
    ]
    for call in calls:
        with pytest.raises(ZeroDivisionError), on_every_rank(comm, "test"):
            if comm.rank == 0:
                raise ZeroDivisionError
            call()
    assert domain.sum(ones) == domain.n_cells_global


def test_an_error_of_the_simulation_can_be_sent() -> None:
    error = ffr.SimulationError("too soft", trajectory=lambda: 0)  # type: ignore[arg-type]
    copy = pickle.loads(pickle.dumps(error))
    assert isinstance(copy, ffr.SimulationError) and str(copy) == "too soft"


class Faulty(ffr.Objective):
    """The filled area, which fails or differs on the last rank."""

    needs_trajectory = False  # type: ignore[assignment]

    def __init__(self, comm: MPI.Intracomm, fault: str) -> None:
        self.last, self.fault = comm.rank == comm.size - 1, fault

    def evaluate(self, response: ffr.Response) -> float:
        if self.last and self.fault == "value":
            raise ZeroDivisionError("of one's own")
        density = response.densities["rod"]
        area = density.sum(density.areas * density.values)
        return area * (1.1 if self.last and self.fault == "differs" else 1.0)

    def derivatives(self, response: ffr.Response) -> ffr.Derivatives:
        if self.last and self.fault == "derivatives":
            raise ZeroDivisionError("of one's own")
        return ffr.Derivatives(densities={"rod": response.densities["rod"].areas})


class Broken(ffr.PlaneStress):
    """A law of the material that fails on the last rank."""

    def on(self, domain: Any) -> Any:
        if domain.comm.rank == domain.comm.size - 1:
            raise ZeroDivisionError("of one's own")
        return super().on(domain)


@pytest.mark.mpi
def test_what_is_ones_own_and_fails_on_one_rank(comm: MPI.Intracomm) -> None:
    """Objectives, motions and laws; and the ranks still meet afterwards."""
    base = slider_crank(comm, (10, 2), modes=1, steps=20)
    domain = base.flexible["rod"].domain
    x, parts = np.full(domain.n_cells, 0.5), (base.bodies, base.mechanism, base.integrator)

    def gravity(t: np.ndarray) -> np.ndarray:
        if comm.rank == comm.size - 1:
            raise ZeroDivisionError("of one's own")
        return 0.0 * t

    mechanism = replace(base.mechanism, gravity=(0.0, gravity))  # type: ignore[arg-type]
    short, frame = ffr.GeneralizedAlpha(0.01, 5), ffr.TangentFrame("left")
    broken = Broken(1e9, 0.3, 1e3, 0.01)
    calls: list[Callable[[], object]] = [
        lambda: ffr.Problem(*parts, Faulty(comm, "value")).gradient(x),
        lambda: ffr.Problem(*parts, Faulty(comm, "derivatives")).gradient(x),
        lambda: ffr.Problem(base.bodies, mechanism, short, base.objective).value(x),
        lambda: ffr.FlexibleBody(domain, broken, frame=frame, modes=1),
    ]
    for call in 2 * calls:
        with pytest.raises(ZeroDivisionError, match="one's own"):
            call()
    if comm.size > 1:
        with pytest.raises(ValueError, match="the objective differs between the ranks"):
            ffr.Problem(*parts, Faulty(comm, "differs")).value(x)


@pytest.mark.mpi
@pytest.mark.parametrize("optimizer", [ffr.LevelSetEvolution(), ffr.MMA()], ids=["steps", "MMA"])
def test_callbacks_on_one_rank(comm: MPI.Intracomm, shared_tmp_path: Path, optimizer: Any) -> None:
    """Raised there, in a call that takes all ranks, or by calling a plot on one rank alone."""
    problem = Copy(comm, lambda c: np.ones(len(c)))
    levelset = ffr.LevelSet(problem.domain)
    start = levelset.with_holes(4, 1, 0.012)

    def fails(on: int) -> Callable[..., None]:
        def callback(iteration: int, x: np.ndarray, evaluation: Any) -> None:
            if comm.rank == on % comm.size:
                raise ZeroDivisionError("a callback")
            problem.value(x)

        return callback

    def plots_alone(iteration: int, x: np.ndarray, evaluation: Any) -> None:
        if comm.rank == 0:
            plotting.plot_design(problem.domain, x, shared_tmp_path / "design.png")

    options = {"progress": False, "iterations": 1, "optimizer": optimizer}
    for on in (0, -1):
        with pytest.raises(ZeroDivisionError, match="a callback"):
            ffr.optimize(problem, levelset, start, **options, callback=fails(on))
    if comm.size > 1:
        with pytest.raises(RuntimeError, match="drawing of a body was called on rank 0"):
            ffr.optimize(problem, levelset, start, **options, callback=plots_alone)


@pytest.mark.mpi
def test_what_differs_between_the_ranks_is_named(comm: MPI.Intracomm) -> None:
    """A wrong number or a hang, if nobody looked."""
    if comm.size == 1:
        return
    one = int(comm.rank > 0)
    copy = Copy(comm, lambda c: np.ones(len(c)))
    levelset, other = ffr.LevelSet(copy.domain), ffr.LevelSet(copy.domain)
    other.radius *= 1.0 + 0.1 * one
    problem = slider_crank(comm, (10, 2), modes=1, steps=20)
    parts, psi = (problem.bodies, problem.mechanism), problem.objective

    def run(design: Any = levelset, **options: Any) -> None:
        ffr.optimize(copy, design, **{"progress": False, "iterations": 0, **options})

    def gray(**options: float) -> ffr.DensityDesign:
        return ffr.DensityDesign(copy.domain, **options)

    def steps(of_others: int) -> ffr.GeneralizedAlpha:
        return ffr.GeneralizedAlpha(2.0, of_others if one else 20)

    approximate = ffr.paper.ApproximateGradient(compare_every=128 + one, progress=bool(one))
    methods = [(ffr.LevelSetEvolution(), ffr.MMA(tolerance=0.5)), (ffr.MMA(), ffr.MMA(move=0.2))]
    start, integrator = levelset.even() * (1.0 + comm.rank), r"problem: (the )?integrator differs"
    designs: list[tuple[dict[str, Any], str]] = [
        ({"iterations": 1 + one}, "optimize: iterations differs"),
        ({"volume": 0.5 + 0.1 * one}, "optimize: volume differs"),
        ({"resume": bool(one)}, "optimize: resume differs"),
        *(({"optimizer": pair[one]}, "optimize: optimizer differs") for pair in methods),
        ({"start": start}, "the start of 'plate' differs"),
        ({"gradient": approximate}, r"gradient differs .*128.* on rank 0"),
        ({"design": gray(eta=0.5 + 0.1 * one)}, "optimize: eta of plate differs"),
        ({"design": gray(radius=0.02 + 0.01 * one)}, "optimize: radius of plate differs"),
        ({"design": other}, "optimize: radius of plate differs between the ranks"),
    ]
    for options, message in designs:
        with pytest.raises(ValueError, match=message):
            run(**options)
    for number in (21, 10**9):
        with pytest.raises(ValueError, match=f"{integrator} .*steps=20"):
            ffr.Problem(*parts, steps(number), psi)
    with pytest.raises(ValueError, match="body: modes differs between the ranks: 1 on rank 0"):
        problem.flexible["rod"].with_modes(1 + comm.rank)
    problem.integrator = ffr.GeneralizedAlpha(0.01, 5 + one)
    with pytest.raises(ValueError, match=integrator):
        problem.value(np.ones(problem.flexible["rod"].domain.n_cells))


@pytest.mark.mpi
def test_files_and_reports_of_one_rank_alone(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """Whatever takes all ranks says so, where one of them is already elsewhere."""
    if comm.size == 1:
        return
    problem = slider_crank(comm, (10, 2), modes=1, steps=200)
    rod = problem.flexible["rod"]
    domain, path = rod.domain, shared_tmp_path / "file"
    x = np.ones(domain.n_cells)
    evaluation = problem.value(x)
    reduced = evaluation.bodies["rod"]
    calls: dict[str, Callable[[], Any]] = {
        "write_fields": lambda: ffr.write_fields(domain, {"x": x}, path.with_suffix(".xdmf")),
        "plot_stress": lambda: plotting.plot_stress(domain, x, path.with_suffix(".png")),
        "worst_stress": lambda: ffr.worst_stress(rod, evaluation, "rod"),
        "the stress of a body": lambda: ffr.von_mises(rod, reduced, np.zeros(rod.n_elastic)),
        "model_report": lambda: ffr.model_report(problem, evaluation),
    }
    for name, call in calls.items():
        message = f"{name} was called on rank 0 of"
        with pytest.raises(RuntimeError, match=message), on_every_rank(comm, "test"):
            if comm.rank == 0:
                call()
    # what is wrong on one rank alone is said on all
    short = np.ones(len(x) - (comm.rank == comm.size - 1), dtype=bool)
    with pytest.raises(ValueError, match=r"plot_gradient_elements: selections: 'design' must"):
        plotting.plot_gradient_elements(domain, {"design": (x, short)}, path.with_suffix(".png"))
    fields = {"x": x[comm.rank :]} if comm.rank == 1 else {"x": x}
    with pytest.raises(ValueError, match="'x' must have one value for each cell"):
        ffr.write_fields(domain, fields, path.with_suffix(".xdmf"))
    with pytest.raises(ValueError, match="write_fields: fields differs between the ranks"):
        ffr.write_fields(domain, {f"x{comm.rank}": x}, path.with_suffix(".xdmf"))
