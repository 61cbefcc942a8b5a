# SPDX-License-Identifier: MIT
"""Compiled functions: announcement, cache, tables, and what goes on without a cache."""

from __future__ import annotations

import ast
import importlib
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from enum import EnumMeta
from pathlib import Path
from types import FunctionType
from typing import NamedTuple

import numpy as np
import pytest

from dolfinx_ffr import dynamics
from dolfinx_ffr.__main__ import main
from dolfinx_ffr.dynamics import (
    INTEGRATORS,
    compilation,
    compile_kernels,
    compile_side_by_side,
    compiled_functions,
)
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


@pytest.mark.parametrize(("patience", "count"), [(0.0, 1), (60.0, 0)])
def test_a_long_compilation_is_announced_once(
    slow: Slow,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    patience: float,
    count: int,
) -> None:
    """To what is given, by default the standard error; what compiles quickly is silent."""
    monkeypatch.setattr(compiled, "_PATIENCE", patience)
    lines: list[str] = []
    assert compile_kernels(lines.append) > 0.0
    assert ["compiling the time integration" in line for line in lines] == [True] * count
    assert compile_kernels(lines.append) == 0.0
    assert len(lines) == count
    slow.done = False
    compile_kernels()
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == count


def test_everything_is_compiled_by_one_call() -> None:
    compile_kernels(integrators=INTEGRATORS)
    functions = compiled_functions(INTEGRATORS)
    assert len(set(functions)) == len(functions)
    assert all(function.ready for function in functions)


def test_a_change_of_any_source_renews_what_depends_on_it(tmp_path: Path) -> None:
    # Numba itself looks at the file of the outermost function only.
    package = Path(compilation.__file__).parents[1]
    for part in ("dynamics", "mechanism"):
        shutil.copytree(package / part, tmp_path / part, ignore=shutil.ignore_patterns("__pyc*"))
    folder_of_package, folders = tmp_path / "dynamics", ("kinematics", "integration")

    def renewed(changed: Path) -> set[str]:
        digests = {folder: compilation.digest(folder_of_package, folder) for folder in folders}
        changed.write_text(changed.read_text() + "# changed\n")
        return {
            folder
            for folder in folders
            if compilation.digest(folder_of_package, folder) != digests[folder]
        }

    for folder in folders:
        for changed in folder_of_package.glob(f"{folder}/*.py"):
            assert renewed(changed) == {folder}
    shared = ("compilation.py", "equations.py", "../mechanism/rows.py")
    for name in shared:
        assert renewed(folder_of_package / name) == set(folders), name
    assert renewed(folder_of_package / "../mechanism/joints.py") == set()


def _kernels(function: Compiled) -> dict[str, FunctionType]:
    """All functions that become part of a compiled one, by module and name."""
    waiting, computed = [function.function], {}
    while waiting:
        body = waiting.pop()
        computed[f"{body.__module__}.{body.__qualname__}"] = body
        for used in (body.__globals__.get(name) for name in body.__code__.co_names):
            kernel = getattr(used, "py_func", None)
            if kernel and f"{kernel.__module__}.{kernel.__qualname__}" not in computed:
                waiting.append(kernel)
    return computed


def test_all_that_compiled_functions_hold_is_among_their_sources() -> None:
    """Kernels, numbers imported from elsewhere, and the enumerations that number kinds."""
    folder_of_package = Path(compilation.__file__).parent
    for function in compiled_functions(INTEGRATORS, space=True):
        folder = function.function.__module__.split(".")[-2]
        files = {str(file.resolve()) for file in compilation.sources(folder_of_package, folder)}
        for name, kernel in _kernels(function).items():
            module = sys.modules[kernel.__module__]
            assert str(module.__file__) in files, name
            frozen = [thing for thing in vars(module).values() if isinstance(thing, EnumMeta)]
            for node in ast.walk(ast.parse(Path(str(module.__file__)).read_text())):
                if not isinstance(node, ast.ImportFrom):
                    continue
                origin = importlib.import_module(
                    "." * node.level + (node.module or ""), module.__package__
                )
                for alias in node.names:
                    thing = getattr(origin, alias.name, None)
                    if isinstance(thing, int | float) and alias.name in kernel.__code__.co_names:
                        assert str(origin.__file__) in files, f"{alias.name} of {origin.__name__}"
            for kind in frozen:
                assert str(sys.modules[kind.__module__].__file__) in files, kind.__name__


def test_every_compiled_function_has_a_table_of_its_own_folder() -> None:
    # The digest of its sources is part of the table's type, by which Numba keeps the function.
    for function in compiled_functions(INTEGRATORS):
        folders = {kind.__module__.rpartition(".")[0] for kind in function.arguments}
        assert function.function.__module__.rpartition(".")[0] in folders, function.name


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
def test_command_compiles_everything(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In processes beside it, of which one is started here."""
    chosen: list[Compiled] = []

    def first_of(functions: list[Compiled]) -> Iterator[str]:
        chosen.extend(functions)
        return compile_side_by_side(functions[:1])

    monkeypatch.setattr(dynamics, "compile_side_by_side", first_of)
    main(["compile", "--all"])
    assert set(chosen) == {*compiled_functions(), *compiled_functions(space=True)}
    captured = capsys.readouterr()
    assert chosen[0].name in captured.err and f"compiled {len(chosen)} functions" in captured.out
