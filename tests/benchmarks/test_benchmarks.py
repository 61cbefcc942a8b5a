# SPDX-License-Identifier: MIT
"""The benchmarks run, and what they measure of errors is right; times are not judged."""

from __future__ import annotations

import csv
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from growth import exponents
from jobs import Job, run_jobs
from matplotlib.image import imread
from run import PEERS, STUDIES, main
from shared import TOP

import dolfinx_ffr as ffr

# what libraries warn of while pages are written is not judged here
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]

#: Without the study that needs other packages, whether they are there or not
PAGES = [study for study in STUDIES if study != PEERS]
#: Entries that may be nothing: time lost between parts, and what the
#: eigenvalue solver adds to psi where it does better than it was asked; errors of exact gradients,
#: and the fixed part of a measurement that is too short for it.
MAY_BE_ZERO = set(
    "modes rest error_psi estimated "
    "iterations error band_error estimate fixed each_ms difference difference_psi "
    "difference_gradient error_S error_P error_K rims".split()
)
#: Columns that hold words
WORDS = {"mesh", "task", "design", "kernel", "kind", "cell", "scene", "method", "solver", "start"}
WORDS |= {"drawing"}
#: Cosines and differences may have any sign
SIGNED = {"cosine", "levelset_cosine", "difference", "excess", "error", "above"}
#: Columns that may hold nothing, where a part has no such place, or ranks no parts
LEFT_OUT = {"thinnest", "gap", "on_4", "on_16", "on_64"}
#: Tables and their numbers of rows
TABLES = """growth 3, growth_exponents 1, growth_parts 3, growth_memory 3, accuracy_steps 2,
accuracy_tolerance 3, accuracy_differences 3, mesh 12, mesh_orders 6, mesh_smooth 18,
mesh_smooth_orders 6, mesh_locking 10, modes 8, modes_estimate 10,
differences 2, gradient 21, gradient_designs 3, gradient_growth 1, integration 22,
integration_summary 4, integration_damping 10, time_steps 3,
bound 2, known 1, known_balanced 1, known_value 5, boundary_starts 1,
boundary_stress_limit 1, boundary_drawn 1, space 3, space_parts 3,
space_solvers 1, space_steps 1, published_slider_crank 11, published_rod 3, published_squeezer 11,
arrays 2, arrays_scipy 1, ranks 1, stress 2"""
Rows = Callable[..., list[dict[str, str]]]


def run(folder: Path, *options: str) -> None:
    """Run the studies with small meshes."""
    main(["--quick", "--output", str(folder), *options])


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What ``run.py --quick`` leaves."""
    directory = tmp_path_factory.mktemp("benchmarks")
    run(directory, "--only", *PAGES)
    return directory


@pytest.fixture(scope="module")
def rows(output: Path) -> Rows:
    """Rows of a table with the given words in their columns."""

    def read(table: str, **wanted: object) -> list[dict[str, str]]:
        with (output / f"{table}.csv").open() as file:
            computed = list(csv.DictReader(file))
        return [row for row in computed if all(row[n] == str(word) for n, word in wanted.items())]

    return read


def column(rows: list[dict[str, str]], name: str) -> np.ndarray:
    """A column of rows as an array."""
    return np.array([float(row[name]) for row in rows])


def test_a_run_goes_on_with_what_is_measured(output: Path, tmp_path: Path) -> None:
    """The same tables from the record alone, and the page says so."""
    shutil.copy(output / "measurements.json", tmp_path)
    run(tmp_path, "--only", "differences", "--resume")
    before, after = (folder / "differences.csv" for folder in (output, tmp_path))
    assert after.read_text() == before.read_text()
    assert "earlier run" in (tmp_path / "differences.md").read_text()


@pytest.mark.parametrize(("table", "count"), [entry.split() for entry in TABLES.split(",")])
def test_tables_hold_finite_positive_numbers(rows: Rows, table: str, count: str) -> None:
    computed = rows(table)
    assert len(computed) == int(count)
    for name, text in (entry for row in computed for entry in row.items()):
        if name in WORDS or name.endswith("_text"):
            assert text
        elif name not in LEFT_OUT:
            value = float(text)
            assert np.isfinite(value), name
            # no test judges memory or growth: differences of small measurements may have any sign
            if not name.startswith(("memory", "saved")) and not name.endswith("_exponent"):
                zero = name in MAY_BE_ZERO and value == 0.0
                assert value > 0.0 or zero or (name in SIGNED and abs(value) <= 1.0 + 1e-9), name


@pytest.mark.parametrize("page", PAGES)
def test_pages_have_facts_and_a_picture(output: Path, page: str) -> None:
    text = (output / f"{page}.md").read_text()
    assert "DOLFINx" in text and "cores" in text and f"({page}.png)" in text
    picture = imread(output / f"{page}.png")
    assert picture.shape[0] > 400 and picture.shape[1] > 800
    assert len(np.unique(picture[::7, ::7, :3].reshape(-1, 3), axis=0)) > 10


def test_scipy_finds_the_published_bending(output: Path) -> None:
    """To the accuracy that is asked of it here."""
    measurements = json.loads((output / "measurements.json").read_text())
    (computed,) = (one for key, one in measurements.items() if '"published", "slider_crank"' in key)
    assert computed["apart"] < 0.01


def test_arrays_are_read_without_this_package(output: Path) -> None:
    """Psi and slopes are those of the files, and the rod's file is one of this package, too."""
    files = [str(output / f"arrays_plane_{part}.npz") for part in ("rod", "machine")]
    reader = TOP / "benchmarks" / "read_arrays.py"
    assert reader.read_text().count("\n") <= 50 and "dolfinx" not in reader.read_text()
    command = [sys.executable, "-I", str(reader), *files, "1e-6"]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    for line in printed.splitlines():
        computed, given = (float(part.split()[-1]) for part in line.split(", "))
        assert computed == pytest.approx(given, rel=1e-4)
    rod, stored = ffr.VolumeIntegrals.load(files[0]), np.load(files[0])
    assert rod.dimension == 3 and np.array_equal(rod.K, stored["K"])


def test_ranks_that_fail_say_why(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Also where this process has inherited what MPI sets in one that mpirun has not started."""
    monkeypatch.setenv("OMPI_MCA_ess", "singleton")
    job = Job("scene", "warm_up", 1.0, {"unknown": 0}, ranks=2)
    assert [result for _, result in run_jobs([job])] == [None]
    message = capfd.readouterr().err
    assert "unexpected keyword argument 'unknown'" in message
    assert "scene: warm_up, 2 ranks: ended with exit code 1" in message


def test_meshes_that_take_no_memory_have_an_exponent() -> None:
    """As what came before them in their process took as much."""
    none = {"ranks": 1, "gradient": 1.0, "bound": 1.0, "memory_value": 0.0, "memory_gradient": 0.0}
    meshes = [{**none, "mesh": f"{n}", "elements": n} for n in (10, 20)]
    (computed,) = exponents(meshes)
    assert [computed[f"{name}_exponent"] for name in ("gradient", "memory_gradient")] == [0.0, 0.0]


def test_single_columns(rows: Rows) -> None:
    """Both numbers of ranks, multigrid beside factors, the reference in time, costs of values."""
    assert sorted(column(rows("growth"), "ranks")) == [1, 1, 2]
    assert np.all(column(rows("space_solvers"), "difference_psi") < 1e-9)
    assert np.all(column(rows("space_solvers"), "difference_gradient") < 1e-8)
    assert np.all(column(rows("integration_summary"), "check") < 1e-5)
    names = ("elements", "value", "one_sided", "central")
    elements, value, one_sided, central = (column(rows("differences"), name) for name in names)
    assert np.allclose(one_sided, (elements + 1) * value, rtol=1e-12)
    assert np.allclose(central, 2 * elements * value, rtol=1e-12)


def test_error_falls_with_the_tolerance(rows: Rows) -> None:
    table = rows("accuracy_tolerance")
    for error in ("error_psi", "error_gradient"):
        assert np.all(column(table, error) <= column(table, "setting"))
    # not at every tolerance: tight ones know more of the outer modes, which saves iterations
    iterations = column(table, "iterations")
    assert iterations[0] < iterations[-1]


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_smooth_solution_has_the_full_order(rows: Rows, cell: str, order: int) -> None:
    (computed,) = rows("mesh_smooth_orders", cell=cell, order=order)
    assert float(computed["order_frequency"]) == pytest.approx(2 * order, abs=0.2)
