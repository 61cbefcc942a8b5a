# SPDX-License-Identifier: MIT
"""Compiled kernels: announcement, cache, and what goes on without one."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import pytest

from dolfinx_ffr.dynamics import compile_kernels, compiled, loops


def test_a_long_compilation_is_announced_once(monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[str] = []
    monkeypatch.setattr(compiled, "_ready", False)
    monkeypatch.setattr(compiled, "_PATIENCE", 0.0)
    monkeypatch.setattr(compiled, "_call_on_nothing", lambda: time.sleep(0.2))
    assert compile_kernels(lines.append) > 0.0
    assert len(lines) == 1
    assert "compiling the time integration" in lines[0]
    assert compile_kernels(lines.append) == 0.0
    assert len(lines) == 1


def test_by_default_the_line_goes_to_the_standard_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compiled, "_ready", False)
    monkeypatch.setattr(compiled, "_PATIENCE", 0.0)
    monkeypatch.setattr(compiled, "_call_on_nothing", lambda: time.sleep(0.2))
    compile_kernels()
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1


def test_loading_from_the_cache_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    compile_kernels()
    lines: list[str] = []
    monkeypatch.setattr(compiled, "_ready", False)
    compile_kernels(lines.append)
    assert lines == []


def test_cached_functions_know_the_sources_of_all_they_call() -> None:
    # Otherwise a change in one of the modules would go unnoticed as long as a cache exists.
    digest = loops._digest_of_sources()
    for function in loops.kernels:
        assert digest in [cell.cell_contents for cell in function.py_func.__closure__]
    reached, waiting = {"loops"}, [loops]
    while waiting:
        for thing in vars(waiting.pop()).values():
            function = getattr(thing, "py_func", None)
            if function is None:
                continue
            module = sys.modules[function.__module__]
            name = module.__name__.rsplit(".", 1)[1]
            if name not in reached:
                reached.add(name)
                waiting.append(module)
    assert reached == set(loops.SOURCES)


def test_without_a_place_for_the_cache_functions_are_compiled_all_the_same() -> None:
    # A function without a file stands for one whose directory cannot be written.
    namespace: dict[str, Callable[[float], float]] = {}
    exec("def twice(x):\n    return 2.0 * x\n", namespace)
    assert loops._entry(namespace["twice"])(1.5) == 3.0
