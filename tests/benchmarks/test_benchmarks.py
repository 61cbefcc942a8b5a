# SPDX-License-Identifier: MIT
"""The benchmarks run, and what they measure of errors is right; times are not judged."""

from __future__ import annotations

import csv
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from shared import TOP, processes

pytestmark = pytest.mark.slow

BENCHMARKS = TOP / "benchmarks"
PAGES = (
    "growth",
    "accuracy",
    "modes",
    "mesh",
    "model",
    "differences",
    "gradient",
    "integration",
    "motions",
    "static_loads",
    "warm_starts",
    "space",
)
#: Entries that may be nothing: memory that was there before, time lost between parts, and what the
#: eigenvalue solver adds to psi where it does better than it was asked.
#: Errors of exact gradients, and the fixed part of a measurement that is too short for it.
MAY_BE_ZERO = {
    "modes",
    "memory_value",
    "memory_gradient",
    "memory_direct",
    "memory_iterative",
    "rest",
    "error_psi",
    "iterations",
    "error",
    "band_error",
    "estimate",
    "fixed",
    "each_ms",
    "difference",
    "adjoints",
    "change",
    "static",
    "difference_psi",
    "difference_gradient",
}
#: Columns that hold words
WORDS = {"mesh", "design", "kernel", "kind", "cell", "scene", "method", "model", "solver", "way"}
#: Cosines may have any sign
SIGNED = {"cosine", "levelset_cosine", "excess"}
TABLES = {
    "growth": 3,
    "growth_exponents": 1,
    "growth_parts": 3,
    "growth_memory": 3,
    "accuracy_steps": 3,
    "accuracy_tolerance": 3,
    "accuracy_differences": 3,
    "mesh": 27,
    "mesh_orders": 12,
    "mesh_smooth": 36,
    "mesh_smooth_orders": 12,
    "mesh_locking": 16,
    "model": 6,
    "modes": 12,
    "modes_free": 8,
    "modes_estimate": 10,
    "modes_selected": 5,
    "differences": 2,
    "gradient": 36,
    "gradient_designs": 3,
    "gradient_growth": 1,
    "integration": 22,
    "integration_summary": 4,
    "integration_orders": 6,
    "integration_damping": 10,
    "motions": 4,
    "static_loads": 3,
    "static_loads_cycles": 1,
    "warm_starts": 1,
    "space": 3,
    "space_parts": 3,
    "space_solvers": 1,
    "space_steps": 1,
}
#: Columns that are not measured quickly
LEFT_OUT = {"part", "part_excess"}
Column = Callable[[str, str], np.ndarray]


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What ``run.py --quick`` leaves."""
    directory = tmp_path_factory.mktemp("benchmarks")
    # without the study that needs other packages, whether they are there or not
    quick = [str(BENCHMARKS / "run.py"), "--quick", "--only", *PAGES, "--output", str(directory)]
    subprocess.run(
        processes.command(*quick), env=processes.environment(), cwd=directory, check=True
    )
    return directory


def test_a_run_goes_on_with_what_is_measured(output: Path, tmp_path: Path) -> None:
    """The same tables from the record alone, and the page says so."""
    shutil.copy(output / "measurements.json", tmp_path)
    command = [str(BENCHMARKS / "run.py"), "--quick", "--only", "differences", "--resume"]
    command += ["--output", str(tmp_path)]
    subprocess.run(
        processes.command(*command), env=processes.environment(), cwd=tmp_path, check=True
    )
    before, after = (folder / "differences.csv" for folder in (output, tmp_path))
    assert after.read_text() == before.read_text()
    assert "earlier run" in (tmp_path / "differences.md").read_text()


@pytest.fixture(scope="module")
def column(output: Path) -> Column:
    """A column of a table as an array."""

    def read(table: str, name: str) -> np.ndarray:
        with (output / f"{table}.csv").open() as file:
            return np.array([float(row[name]) for row in csv.DictReader(file)])

    return read


@pytest.mark.parametrize("table", TABLES)
def test_tables_hold_finite_positive_numbers(output: Path, table: str) -> None:
    with (output / f"{table}.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == TABLES[table]
    for row in rows:
        for name, text in row.items():
            if name in WORDS or name.endswith("_text"):
                assert text
            elif name not in LEFT_OUT:
                value = float(text)
                assert np.isfinite(value), name
                if name.endswith("_exponent") or name.startswith(
                    "saved"
                ):  # small meshes take what they take
                    continue
                zero = name in MAY_BE_ZERO and value == 0.0
                assert value > 0.0 or zero or (name in SIGNED and abs(value) <= 1.0 + 1e-9), name


@pytest.mark.parametrize("page", PAGES)
def test_pages_have_facts_and_a_picture(output: Path, page: str) -> None:
    text = (output / f"{page}.md").read_text()
    assert "DOLFINx" in text and "cores" in text and f"({page}.png)" in text
    picture = imread(output / f"{page}.png")
    assert picture.shape[0] > 400 and picture.shape[1] > 800
    assert len(np.unique(picture[::7, ::7, :3].reshape(-1, 3), axis=0)) > 10


def test_both_numbers_of_ranks_are_measured(column: Column) -> None:
    assert sorted(column("growth", "ranks")) == [1, 1, 2]


@pytest.mark.parametrize("error", ["error_psi", "error_gradient"])
def test_error_in_time_is_of_second_order(column: Column, error: str) -> None:
    steps, errors = column("accuracy_steps", "setting"), column("accuracy_steps", error)
    # the reference has four times the finest number of steps: its own error adds 0.03 to the order
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(2.0, abs=0.1)


def test_error_falls_with_the_tolerance(column: Column) -> None:
    tolerance = column("accuracy_tolerance", "setting")
    assert np.all(column("accuracy_tolerance", "error_psi") <= tolerance)
    assert np.all(column("accuracy_tolerance", "error_gradient") <= tolerance)
    # not at every tolerance: tight ones know more of the outer modes, which saves iterations
    iterations = column("accuracy_tolerance", "iterations")
    assert iterations[0] < iterations[-1]


def test_multigrid_agrees_with_factors(column: Column) -> None:
    assert np.all(column("space_solvers", "difference_psi") < 1e-9)
    assert np.all(column("space_solvers", "difference_gradient") < 1e-8)


def rows_of(output: Path, table: str, **wanted: str) -> list[dict[str, str]]:
    """Rows of a table with the given words in their columns."""
    with (output / f"{table}.csv").open() as file:
        rows = list(csv.DictReader(file))
    return [row for row in rows if all(row[name] == word for name, word in wanted.items())]


@pytest.mark.parametrize("error", ["error_psi", "error_gradient"])
def test_error_falls_with_the_number_of_modes(output: Path, error: str) -> None:
    rows = rows_of(output, "modes", kind="stretch, rotations, normal modes")
    errors = np.array([float(row[error]) for row in rows])
    assert np.all(np.diff(errors) < 0.0)
    assert errors[-1] < 1e-2 * errors[0]


@pytest.mark.parametrize("kind", ["stretch, normal modes", "normal modes alone"])
def test_normal_modes_do_not_replace_constraint_modes(output: Path, kind: str) -> None:
    rows = [row for row in rows_of(output, "modes", kind=kind) if int(row["modes"]) > 0]
    for error in ("error_psi", "error_gradient"):
        errors = np.array([float(row[error]) for row in rows])
        assert np.all(errors > 0.5)  # a clamped beam bears six times as much as a pinned one
        assert np.ptp(errors) < 1e-3


def test_modes_of_the_free_body_are_a_poor_basis(output: Path) -> None:
    full = rows_of(output, "modes", kind="stretch, rotations, normal modes", modes="4")
    for design in ("full rod", "holes"):
        free = rows_of(output, "modes_free", design=design)
        errors = np.array([float(row["error_psi"]) for row in free])
        assert np.all(np.diff(errors) < 0.0)
        nine = errors[[row["modes"] for row in free].index("9")]
        assert 0.01 < nine < 0.15
        assert nine > 10.0 * float(full[0]["error_psi"])


def test_estimated_error_brackets_the_true_one(column: Column) -> None:
    ratio = column("modes_estimate", "ratio")
    assert np.all((ratio > 1.0 / 1.25) & (ratio < 1.25))
    assert np.all(column("modes_selected", "error_psi") <= column("modes_selected", "tolerance"))


@pytest.mark.parametrize("error", ["psi", "gradient", "frequencies", "integrals"])
@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_error_falls_with_mesh_and_order(output: Path, cell: str, error: str) -> None:
    at_size = []
    for order in ("1", "2", "3"):
        for kind in ("structured", "gmsh"):
            rows = rows_of(output, "mesh", cell=cell, kind=kind, order=order)
            errors = np.array([float(row[f"error_{error}"]) for row in rows])
            assert np.all(errors[1:] < 0.6 * errors[:-1])
        rows = rows_of(output, "mesh", cell=cell, kind="structured", order=order)
        at_size.append(float(rows[1][f"error_{error}"]))
        # the corners' singularity, not the order of the displacements, limits the order
        observed = rows_of(output, "mesh_orders", cell=cell, kind="structured", order=order)
        assert 1.0 < float(observed[0][f"order_{error}"]) < 2.5
    assert at_size[2] < 0.5 * at_size[1] and at_size[1] < 0.1 * at_size[0]


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_smooth_solution_has_the_full_order(output: Path, cell: str, order: int) -> None:
    wanted = {"cell": cell, "order": str(order)}
    (row,) = rows_of(output, "mesh_smooth_orders", kind="structured", **wanted)
    assert float(row["order_frequency"]) == pytest.approx(2 * order, abs=0.2)
    # sizes of gmsh's elements vary, so that an order from three meshes is rough
    (row,) = rows_of(output, "mesh_smooth_orders", kind="gmsh", **wanted)
    assert float(row["order_frequency"]) > 2 * order - 1


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_linear_cells_lock_in_a_thin_rod(output: Path, cell: str) -> None:
    def errors(order: int, error: str) -> list[float]:
        rows = rows_of(output, "mesh_locking", cell=cell, order=str(order))
        return [float(row[error]) for row in rows]  # of 25, 50 and 100 elements along

    assert min(errors(1, "error_psi")) > 0.2
    assert errors(1, "error_frequency")[0] > 1.0
    for order in (2, 3):
        assert max(errors(order, "error_psi")) < 2e-3
        assert max(errors(order, "error_frequency")) < 1e-2


def test_linear_elasticity_ends_where_deformations_are_large(output: Path) -> None:
    linear, stiffened = (
        rows_of(output, "model", model=model) for model in ("linear", "with geometric stiffening")
    )
    for error, least in (("error_tip", 1e-3), ("error_deflection", 0.05)):
        errors = np.array([[float(row[error]) for row in rows] for rows in (linear, stiffened)])
        assert np.all(np.diff(errors, axis=1) > 0.0)  # the softer, the further apart
        assert np.all(errors[:, 0] < least)  # a deflection of 0.02 %
        assert errors[1, 1] < 0.2 * errors[0, 1]  # of 1.6 %: stiffening matters
        assert np.all(errors[:, 2] > 0.1) and errors[0, 2] > 1.0  # of 23 %: no model for it


def test_gradient_agrees_with_central_differences(column: Column) -> None:
    steps = column("accuracy_differences", "setting")
    differences = column("accuracy_differences", "error_gradient")
    assert differences.min() < 1e-6
    # as long as the error of the difference itself prevails, it falls with the square of the step
    large = steps >= 1e-3
    order = np.polyfit(np.log(steps[large]), np.log(differences[large]), 1)[0]
    assert order == pytest.approx(2.0, abs=0.2)


def test_cost_of_differences_is_that_of_their_values(column: Column) -> None:
    elements, value = column("differences", "elements"), column("differences", "value")
    assert np.allclose(column("differences", "one_sided"), (elements + 1) * value, rtol=1e-12)
    assert np.allclose(column("differences", "central"), 2 * elements * value, rtol=1e-12)


def test_element_by_element_is_exact_and_the_approximation_is_not(output: Path) -> None:
    with (output / "gradient.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["design"] for row in rows} == {"start", "middle", "final"}
    for row in rows:
        error = float(row["error"])
        if row["kernel"] in ("exact adjoint", "element by element"):
            assert error < 1e-7 and float(row["cosine"]) > 1.0 - 1e-9
        else:
            assert error > 1e-6 and float(row["estimate"]) > 0.0
    # at the even start, whose gradient is smooth, those at more elements are nearer to the exact
    # one; where members are as thin as these large elements it depends on which are taken
    few, many = (
        np.mean(
            [
                float(row["cosine"])
                for row in rows
                if row["design"] == "start" and float(row["percent"]) == percent
            ]
        )
        for percent in (20.0, 40.0)
    )
    assert many > few


@pytest.mark.parametrize(("method", "order"), [("generalised alpha", 2.0), ("Radau IIA", 5.0)])
def test_orders_of_time_integration(output: Path, method: str, order: float) -> None:
    own = rows_of(output, "integration_orders", method=method)
    steps = np.log([float(row["steps"]) for row in own])
    for what in ("psi", "gradient", "positions", "multipliers"):
        errors = np.log([float(row[f"error_{what}"]) for row in own])
        assert np.all(np.diff(errors) < 0.0)
        found = -np.polyfit(steps, errors, 1)[0]
        if what in ("psi", "gradient"):
            assert found == pytest.approx(order, abs=0.05 * order)
        else:  # the largest at any time; forces of Radau IIA are of order 3
            assert found > (min(order, 3.0) if what == "multipliers" else order) - 0.7


@pytest.mark.parametrize("scene", ["reference", "fast", "stiff", "long"])
def test_errors_of_time_integration_fall(output: Path, scene: str) -> None:
    own = rows_of(output, "integration", scene=scene)
    assert max(float(row["violation"]) for row in own) < 1e-12
    for what in ("psi", "gradient"):
        errors = {
            method: np.array([float(r[f"error_{what}"]) for r in own if r["method"] == method])
            for method in ("generalised alpha", "Radau IIA")
        }
        assert np.all(errors["generalised alpha"][1:] < 0.35 * errors["generalised alpha"][:-1])
        # down to vibrations that are as small, which no step resolves
        falls = errors["Radau IIA"][1:] < 0.2 * errors["Radau IIA"][:-1]
        assert np.all(falls | (errors["Radau IIA"][1:] < 1e-7))


@pytest.mark.parametrize("scene", ["reference", "fast"])
def test_default_damping_costs_little_accuracy(output: Path, scene: str) -> None:
    own = rows_of(output, "integration_damping", scene=scene)
    errors = {float(row["radius_text"]): float(row["error_gradient"]) for row in own}
    assert errors[0.8] < 1.2 * errors[1.0]
    assert errors[0.8] < 0.5 * errors[0.0]


def test_reference_of_time_integration(column: Column) -> None:
    assert np.all(column("integration_summary", "check") < 1e-5)
