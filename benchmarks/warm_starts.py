# SPDX-License-Identifier: MIT
"""What the modes and adjoints of the design before would save, along a run.

Designs that follow each other are close, and so are their modes. At designs of the reference scene,
early, in the middle and late, modes and adjoints are computed as in the package, and in other ways:

- modes in a block Krylov space that grows from all modes before, instead of two fields;
- modes by SLEPc's Krylov-Schur method, from its usual start, and from the sum of the modes before;
- adjoints from those before, turned into the new modes: only what these leave is solved for.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Job, Progress
from numpy.typing import NDArray
from report import Table, write_page
from scene import block_numbers, slider_crank, warm_up

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import BLUE, DARK, GRAY, ORANGE, save, styled_figure, tidy
from dolfinx_ffr.reduction import FactoredBody, ReducedBasis
from dolfinx_ffr.reduction.integrals import volume_integrals_pullback
from dolfinx_ffr.reduction.krylov import KrylovSpace

__all__ = ["report_warm_starts", "starts", "warm_starts_jobs"]

Array = NDArray[np.float64]

#: What is computed in other ways, and how
INSTEAD = (
    ("modes", "block"),
    ("modes", "Krylov-Schur"),
    ("modes", "Krylov-Schur, sum"),
    ("adjoints", "correction"),
)


def warm_starts_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each mesh."""
    common = {"coarse": [20, 4] if quick else [200, 20], "iterations": 2 if quick else 60}
    if quick:
        settings = [{"refined": 1, "at": [2], "repetitions": 1}]
    else:
        settings = [
            {"refined": 1, "at": [2, 10, 20, 30, 45, 58], "repetitions": 7},
            {"refined": 4, "at": [2, 20, 45], "repetitions": 3},
        ]
    seconds = 3.0 if quick else 100.0
    return [Job("warm_starts", "starts", seconds, {**common, **own}) for own in settings]


class _Counting:
    """A body at one density that counts the columns it solves for.

    Args:
        factored: The body.
    """

    def __init__(self, factored: FactoredBody) -> None:
        self._factored = factored
        self.columns = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._factored, name)

    def solve(self, block: Array) -> Array:
        """K^-1 times a block."""
        self.columns += block.shape[1]
        return self._factored.solve(block)


def starts(
    comm: MPI.Comm,
    progress: Progress,
    *,
    coarse: list[int],
    iterations: int,
    refined: int,
    at: list[int],
    repetitions: int,
) -> dict[str, Any]:
    """Design the rod, and measure starts at some of its designs.

    Args:
        comm: Communicator over which the mesh is distributed.
        progress: Told the part that is done.
        coarse: Elements along and across of the design run.
        iterations: Of it.
        refined: Each element of the run becomes as many, both ways, for the measurement.
        at: Iterations whose design is measured, beginning with that of the design before.
        repetitions: Of each measurement, in turn.
    """
    warm_up(comm)
    problem = slider_crank(comm, (coarse[0], coarse[1]))
    domain = problem.flexible["rod"].domain
    blocks = coarse[0], coarse[1]
    number = block_numbers(domain, blocks)
    run: dict[int, Array] = {}

    def keep(iteration: int, x: Array, *_: Any) -> None:
        run[iteration] = np.empty(coarse[0] * coarse[1])
        run[iteration][number] = x

    ffr.optimize(
        problem,
        ffr.LevelSet(domain),
        volume=0.5,
        iterations=iterations,
        mode_tolerance=None,
        callback=keep,
    )
    if refined > 1:
        problem = slider_crank(comm, (refined * coarse[0], refined * coarse[1]))
    place = block_numbers(problem.flexible["rod"].domain, blocks)
    rows = []
    for k, iteration in enumerate(at):
        rows.append(
            {
                "iteration": iteration,
                **_measured(problem, run[iteration - 1][place], run[iteration][place], repetitions),
            }
        )
        progress((k + 1) / len(at))
    return {"elements": problem.flexible["rod"].domain.n_cells_global, "rows": rows}


def _measured(problem: ffr.Problem, before: Array, x: Array, repetitions: int) -> dict[str, float]:
    """All starts at one design."""
    body = problem.flexible["rod"]
    reduction, elasticity = body.reduction, body.elasticity
    old = problem.gradient(before)
    old_basis = old.bodies["rod"].basis
    old_normal = np.hstack([old_basis.shapes[:, old_basis.n_constraint :], old_basis.outer_modes])
    old_adjoints = _solved(body, old, _right(body, old))[0]

    new = problem.gradient(x)
    basis = new.bodies["rod"].basis
    right = _right(body, new)
    # modes have any sign, and change places
    turn = elasticity.inner(old_basis.shapes[:, old_basis.n_constraint :], basis.mass_times_normal)
    guess = old_adjoints @ turn
    adjoints = _solved(body, new, right)[0]
    ratio = _size(body, new, adjoints) / _size(body, new, adjoints - guess)
    wanted, solver = reduction.modes + 1, reduction._eigensolver
    tolerance = reduction.tolerance

    def corrected(factored: Any) -> Any:
        reduction.tolerance = tolerance * ratio
        try:
            return _corrected(body, factored, basis, right, guess)
        finally:
            reduction.tolerance = tolerance

    actions: dict[str, Callable[[Any], Any]] = {
        "modes": lambda factored: solver._in_krylov_space(factored, wanted),
        "modes, block": lambda factored: _block_modes(factored, old_normal, tolerance, wanted),
        "modes, Krylov-Schur": lambda factored: solver._search(factored, solver._smooth, wanted),
        "modes, Krylov-Schur, sum": lambda factored: solver._search(
            factored, old_normal.sum(axis=1, keepdims=True), wanted
        ),
        "adjoints": lambda factored: reduction.solve_shifted(
            factored, basis, right, basis.eigenvalues
        ),
        "adjoints, correction": corrected,
    }
    times: dict[str, list[float]] = {name: [] for name in ("whole", *actions)}
    found: dict[str, Any] = {}
    columns: dict[str, int] = {}
    for _ in range(repetitions):
        start = process_time()
        new = problem.gradient(x)
        times["whole"].append(process_time() - start)
        for name, action in actions.items():
            factored = _Counting(body.factored(new.bodies["rod"]))
            start = process_time()
            found[name] = action(factored)
            times[name].append(process_time() - start)
            columns[f"{name}, solutions"] = factored.columns
    for name in ("modes, block", "modes, Krylov-Schur", "modes, Krylov-Schur, sum"):
        wrong = np.max(np.abs(found[name][0][:wanted] / found["modes"][0][:wanted] - 1.0))
        if wrong > 1e-8:
            raise RuntimeError(f"{name}: eigenvalues differ by {wrong:.1e}")
    error = _size(body, new, found["adjoints, correction"][0] - adjoints)
    return {
        **{f"{name}, time": float(np.median(values)) for name, values in times.items()},
        **columns,
        "blocks": found["adjoints"][1],
        "blocks, correction": found["adjoints, correction"][1],
        "change": float(np.mean(np.abs(x - before))),
        "adjoint change": 1.0 / ratio,
        "adjoint error": error / _size(body, new, adjoints),
    }


def _right(body: ffr.FlexibleBody, evaluation: ffr.Evaluation) -> Array:
    """Right-hand sides of the adjoints of the normal modes."""
    reduced = evaluation.bodies["rod"]
    assert evaluation.integrals_gradient is not None
    bar = evaluation.integrals_gradient["rod"]
    matrices = body.factored(reduced).matrices
    pull = volume_integrals_pullback(body.reduction, matrices, reduced.basis, body.markers, bar)
    right = -pull.shapes[:, reduced.basis.n_constraint :]
    right[body.reduction.held] = 0.0
    return right


def _solved(body: ffr.FlexibleBody, evaluation: ffr.Evaluation, right: Array) -> Any:
    """The adjoints of the normal modes, and the number of blocks."""
    reduced = evaluation.bodies["rod"]
    factored, basis = body.factored(reduced), reduced.basis
    return body.reduction.solve_shifted(factored, basis, right, basis.eigenvalues)


def _size(body: ffr.FlexibleBody, evaluation: ffr.Evaluation, fields: Array) -> float:
    """The largest norm of adjoints, as the solver's tolerance counts it."""
    reduced = evaluation.bodies["rod"]
    image = body.elasticity.apply(body.factored(reduced).held_stiffness, fields)
    energies = body.elasticity.sum(np.einsum("ij,ij->j", fields, image))
    return float(np.sqrt(np.max(reduced.basis.eigenvalues * energies)))


def _block_modes(factored: Any, start: Array, tolerance: float, wanted: int) -> Any:
    """The lowest modes from a block Krylov space that grows from those before."""
    space = KrylovSpace(factored, start, answers=True)
    while True:
        space.grow()
        values, vectors = np.linalg.eigh(space.projected)
        lowest = values[::-1][:wanted], vectors[:, ::-1][:, :wanted]
        if np.all(space.leaving(lowest[1]) <= tolerance * lowest[0]):
            # K^-1 M times a mode, which void does not spoil
            return 1.0 / lowest[0], space.answers @ (lowest[1] / lowest[0])


def _corrected(
    body: ffr.FlexibleBody, factored: Any, basis: ReducedBasis, right: Array, guess: Array
) -> tuple[Array, int]:
    """The adjoints of the normal modes from a guess."""
    elasticity, normal = body.elasticity, basis.shapes[:, basis.n_constraint :]
    guess = guess - normal @ elasticity.inner(basis.mass_times_normal, guess)
    left = right - elasticity.apply(factored.held_stiffness, guess)
    left += elasticity.apply(factored.held_mass, guess) * basis.eigenvalues
    left[body.reduction.held] = 0.0
    more, blocks = body.reduction.solve_shifted(factored, basis, left, basis.eigenvalues)
    return guess + more, blocks


# ---------------------------------------------------------------------- table and picture


def report_warm_starts(results: list[tuple[Job, dict[str, Any]]], directory: Path) -> list[Table]:
    """Write table and picture.

    Args:
        results: Of `warm_starts_jobs`.
        directory: Where to.

    Returns:
        The tables.
    """
    rows = []
    for _, result in results:
        for row in result["rows"]:
            saved = {
                f"saved, {how}": (row[f"{kind}, time"] - row[f"{kind}, {how}, time"])
                / row["whole, time"]
                for kind, how in INSTEAD
            }
            rows.append({"elements": result["elements"], **row, **saved})
    table = Table(
        "warm_starts",
        "Modes and adjoints from those of the design before",
        "Designs of the reference scene, 60 iterations of the method of moving asymptotes; on the "
        "finer mesh the same designs, each element as 4 x 4. *Change*: mean of the change of an "
        "element's density, and of the adjoints in the solver's norm, relative to them. "
        "*Solutions*: columns that are solved for, for the modes by the package's block Krylov "
        "space of two vectors, by blocks from all modes before, by Krylov-Schur, and by that from "
        "the sum of the modes before; for the adjoints, and for what those before leave of them. "
        "*Saved*: share of the processor time of value and gradient that would be saved in place "
        "of the package's way, medians of repetitions in turn; negative where it would be lost.",
        {
            "elements": "elements",
            "iteration": "iteration",
            "change": "change",
            "adjoint change": "of the adjoints",
            "modes, solutions": "solutions: modes",
            "modes, block, solutions": "from all before",
            "modes, Krylov-Schur, solutions": "Krylov-Schur",
            "modes, Krylov-Schur, sum, solutions": "that from the sum",
            "adjoints, solutions": "adjoints",
            "adjoints, correction, solutions": "from those before",
            "whole, time": "value and gradient, CPU [s]",
            "modes, time": "modes [s]",
            "adjoints, time": "adjoints [s]",
            "saved, block": "saved: modes from all before",
            "saved, Krylov-Schur": "Krylov-Schur",
            "saved, Krylov-Schur, sum": "that from the sum",
            "saved, correction": "adjoints from those before",
        },
        rows,
    )
    _draw(rows, directory / "warm_starts.png")
    picture = "![Share of the time that starts from the design before save](warm_starts.png)"
    write_page(directory, "warm_starts", "Starts from the design before", picture, [table])
    return [table]


def _draw(rows: list[dict[str, Any]], path: Path) -> None:
    sizes = sorted({row["elements"] for row in rows})
    with styled_figure(max(4.6 * len(sizes), 6.0) + 0.4, 3.8) as figure:
        figure.set_constrained_layout(True)
        for k, size in enumerate(sizes):
            axes = figure.add_subplot(1, len(sizes), k + 1)
            own = [row for row in rows if row["elements"] == size]
            iteration = [row["iteration"] for row in own]
            for name, color, label in (
                ("saved, block", BLUE, "modes from all modes before"),
                ("saved, Krylov-Schur", DARK, "modes by Krylov-Schur"),
                ("saved, Krylov-Schur, sum", GRAY, "that from the sum of the modes before"),
                ("saved, correction", ORANGE, "adjoints from those before"),
            ):
                share = [100.0 * row[name] for row in own]
                axes.plot(iteration, share, "o-", color=color, label=label)
            axes.axhline(0.0, color=GRAY, linewidth=0.8)
            axes.set_xlabel("iteration")
            axes.set_title(f"{size:,} elements: saved [% of value and gradient]", loc="left")
            tidy(axes)
            low, high = axes.get_ylim()
            axes.set_ylim(low, high + 0.5 * (high - low))  # room for the legend
            axes.legend(loc="upper left")
        save(figure, path)
