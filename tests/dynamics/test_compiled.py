# SPDX-License-Identifier: MIT
"""Compiled functions: announcement, cache, tables, and what goes on without a cache."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from dolfinx_ffr.dynamics import INTEGRATORS, compilation, compile_kernels, compiled_functions
from dolfinx_ffr.dynamics.compilation import Compiled, Matrix, Table, Vector
from dolfinx_ffr.dynamics.integration import compiled


class Slow(Compiled):
    """A function that has not been compiled, and takes its time."""

    def __init__(self) -> None:
        super().__init__(lambda: 0)
        self.done = False

    @property
    def ready(self) -> bool:
        return self.done

    def compile(self) -> None:
        time.sleep(0.2)
        self.done = True


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> Slow:
    function = Slow()
    monkeypatch.setattr(compiled, "compiled_functions", lambda _, *, space=False: [function])
    return function


def test_a_long_compilation_is_announced_once(slow: Slow, monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[str] = []
    monkeypatch.setattr(compiled, "_PATIENCE", 0.0)
    assert compile_kernels(lines.append) > 0.0
    assert len(lines) == 1
    assert "compiling the time integration" in lines[0]
    assert compile_kernels(lines.append) == 0.0
    assert len(lines) == 1


def test_by_default_the_line_goes_to_the_standard_error(
    slow: Slow, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compiled, "_PATIENCE", 0.0)
    compile_kernels()
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1


def test_what_compiles_quickly_is_silent(slow: Slow, monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[str] = []
    monkeypatch.setattr(compiled, "_PATIENCE", 60.0)
    compile_kernels(lines.append)
    assert lines == []


def test_everything_is_compiled_by_one_call() -> None:
    compile_kernels(integrators=INTEGRATORS)
    functions = compiled_functions(INTEGRATORS)
    assert len(set(functions)) == len(functions)
    assert all(function.ready for function in functions)


def test_an_argument_of_the_release_before_warns() -> None:
    with pytest.warns(DeprecationWarning, match="stiffened_markers has no effect"):
        compile_kernels(stiffened_markers=True)


def test_a_change_of_any_source_renews_what_depends_on_it(tmp_path: Path) -> None:
    # Numba itself looks at the file of the outermost function only.
    here = Path(compilation.__file__).parent
    for folder in ("planar", "integration"):
        (tmp_path / folder).mkdir()
        for file in here.glob(f"{folder}/*.py"):
            (tmp_path / folder / file.name).write_bytes(file.read_bytes())
    for file in (*here.glob("*.py"),):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    shared = ("compilation.py", "equations.py")
    for changed in (*tmp_path.glob("planar/*.py"), *tmp_path.glob("integration/*.py")):
        own, other = ("planar", "integration")
        if changed.parent.name == other:
            own, other = other, own
        before = {folder: compilation.digest(tmp_path, folder) for folder in (own, other)}
        changed.write_text(changed.read_text() + "# changed\n")
        after = {folder: compilation.digest(tmp_path, folder) for folder in (own, other)}
        assert after[own] != before[own]
        assert after[other] == before[other]
    for name in shared:
        before = {f: compilation.digest(tmp_path, f) for f in ("planar", "integration")}
        (tmp_path / name).write_text((tmp_path / name).read_text() + "# changed\n")
        assert all(compilation.digest(tmp_path, f) != old for f, old in before.items())


def test_every_compiled_function_has_a_table_of_its_own_folder() -> None:
    # The digest of its sources is part of the table's type, by which Numba keeps the function.
    for function in compiled_functions(INTEGRATORS):
        folders = {kind.__module__.rpartition(".")[0] for kind in function.arguments}
        assert function.function.__module__.rpartition(".")[0] in folders, function.name


def test_kernels_call_kernels_of_their_own_folder_only() -> None:
    for function in compiled_functions(INTEGRATORS):
        waiting, seen = [sys.modules[function.function.__module__]], set()
        while waiting:
            module = waiting.pop()
            seen.add(module.__name__)
            for thing in vars(module).values():
                kernel = getattr(thing, "py_func", None)
                if kernel is not None and kernel.__module__ not in seen:
                    waiting.append(sys.modules[kernel.__module__])
        folder = function.function.__module__.rsplit(".", 1)[0]
        strangers = {name for name in seen if name.rsplit(".", 1)[0] != folder}
        assert strangers <= {"dolfinx_ffr.dynamics.equations"}, function.name


def test_without_a_place_for_the_cache_functions_are_compiled_all_the_same() -> None:
    # A function without a file stands for one whose directory cannot be written.
    namespace: dict[str, Callable[[int], int]] = {}
    exec("def twice(x):\n    return 2 * x\n", namespace)
    with pytest.warns(UserWarning, match="is compiled in each run"):
        assert Compiled(namespace["twice"], int)(21) == 42


class Pair(NamedTuple):
    """A table with two fields."""

    line: Vector
    grid: Matrix


def _trace(pair: Pair, factor: float) -> int:
    total = 0.0
    for i in range(pair.line.size):
        total += factor * pair.grid[i, -1] * pair.line[i]
        pair.line[i] = total
    return pair.grid.shape[0]


def test_tables_hand_over_their_arrays() -> None:
    grid, line = np.arange(12.0).reshape(3, 4), np.ones(3)
    assert Compiled(_trace, Pair, float)(Table(Pair(line, grid)), 0.5) == 3
    np.testing.assert_array_equal(line, [1.5, 5.0, 10.5])


@pytest.mark.parametrize(
    "line", [np.ones((3, 1)), np.ones(6)[::2], np.ones(3, dtype=np.float32)], ids=str
)
def test_tables_refuse_other_arrays(line: np.ndarray) -> None:
    with pytest.raises(TypeError, match=r"Pair\.line must be a contiguous array of 1 dimensions"):
        Table(Pair(line, np.ones((3, 3))))


@pytest.mark.slow
def test_command_compiles_everything() -> None:
    run = subprocess.run(
        [sys.executable, "-m", "dolfinx_ffr", "compile", "--all"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert "100%" in run.stderr
    assert "compiled" in run.stdout
