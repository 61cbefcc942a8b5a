# SPDX-License-Identifier: MIT
"""Compiled entry points, kept on disk between runs, and the announcement of their compilation."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from . import steps
from .arrays import ModelArrays, make_work
from .rows import evaluate_rows

__all__ = ["compile_kernels", "kernels"]

#: Seconds of silence before a compilation is announced; loading from disk takes less.
_PATIENCE = 1.5


class Kernels(NamedTuple):
    """The compiled functions that Python calls."""

    #: (model, k, y, v) -> position constraints, velocity constraints, constraint Jacobian.
    constraints: Callable[..., Any]
    #: (model, k, y, v, w, lam, cy, cv) -> residual of the equations of motion, of the constraints.
    residual: Callable[..., Any]
    #: See ``steps.start``, ``steps.march`` and ``steps.backward``.
    start: Callable[..., Any]
    march: Callable[..., Any]
    backward: Callable[..., Any]


def _entry(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile and keep on disk, where there is a place for it."""
    try:
        return njit(cache=True, error_model="numpy")(function)  # type: ignore[no-any-return]
    except RuntimeError:  # neither the package's directory nor the user's cache can be written
        return njit(error_model="numpy")(function)  # type: ignore[no-any-return]


def _make_kernels(digest: str) -> Kernels:
    # Numba renews a cached function when its own file changes, but not when that of a function
    # that it calls does. It also renews it when a value changes over which the function closes:
    # hence the digest of the sources in each of them.
    @_entry
    def constraints(model, k, y, v):  # type: ignore[no-untyped-def]
        _ = digest
        work = make_work(model)
        evaluate_rows(model, k, y, v, work)
        return work.value, work.rate, work.C

    @_entry
    def residual(model, k, y, v, w, lam):  # type: ignore[no-untyped-def]
        _ = digest
        work = make_work(model)
        steps.step_system(model, k, y, v, w, lam, 1.0, 1.0, work)
        return work.rhs

    @_entry
    def start(model, y, v, w, lam, instant, offset, extra):  # type: ignore[no-untyped-def]
        _ = digest
        return steps.start(model, y, v, w, lam, instant, offset, extra)

    @_entry
    def march(model, h, method, y, v, w, a, lam, eta, iterations):  # type: ignore[no-untyped-def]
        _ = digest
        return steps.march(model, h, method, y, v, w, a, lam, eta, iterations)

    @_entry
    def backward(  # type: ignore[no-untyped-def]
        model, h, method, offset, states, multipliers, extra, bars, lam_bars, x, markers
    ):
        _ = digest
        return steps.backward(
            model, h, method, offset, states, multipliers, extra, bars, lam_bars, x, markers
        )

    return Kernels(constraints, residual, start, march, backward)


def _digest_of_sources() -> str:
    sources = sorted(Path(__file__).parent.glob("*.py"))
    return sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()


kernels = _make_kernels(_digest_of_sources())

_ready = False


def compile_kernels(announce: Callable[[str], None] | None = None) -> float:
    """Compile the time integration and its adjoint, or load them from disk.

    Compilation takes about half a minute and happens once on a machine; later runs load the
    result. It is called by the simulation itself; call it beforehand to choose the moment.

    Args:
        announce: Called with one line of text if it takes long; by default the line goes to the
            standard error. Under MPI, silence all ranks but one with ``lambda text: None``.

    Returns:
        Seconds taken.
    """
    global _ready
    if _ready:
        return 0.0
    began = time.perf_counter()
    text = "dolfinx_ffr: compiling the time integration; this happens once and takes a while ..."
    say = announce if announce is not None else lambda line: print(line, file=sys.stderr)
    timer = threading.Timer(_PATIENCE, say, args=(text,))
    timer.daemon = True
    timer.start()
    try:
        _call_on_nothing()
    finally:
        timer.cancel()
    _ready = True
    return time.perf_counter() - began


def _call_on_nothing() -> None:
    """Call every kernel on a mechanism without bodies, which makes Numba compile or load it."""
    floats = np.zeros
    model = ModelArrays(
        *(np.zeros(0, dtype=np.int64) for _ in range(2)),
        floats(0),
        floats((0, 1, 2)),
        floats((0, 1, 1)),
        floats((0, 1, 1)),
        floats((0, 0, 0)),
        floats(0),
        floats(0),
        floats(2),
        *(np.zeros(0, dtype=np.int64) for _ in range(2)),
        floats((0, 2, 1)),
        floats((0, 0)),
        floats((2, 0, 3, 3)),
        np.zeros(0, dtype=np.int64),
        np.zeros((0, 2), dtype=np.int64),
        floats((0, 2)),
        floats((2, 0, 3)),
    )
    none, table, method = floats(0), floats((1, 0)), (0.0, 0.0, 0.5, 0.25)
    kernels.constraints(model, 0, none, none)
    kernels.residual(model, 0, none, none, none, none)
    kernels.start(model, none, none, none, none, 1, 1.0, floats((4, 0)))
    steps_taken = np.zeros(0, dtype=np.int64)
    kernels.march(model, 1.0, method, *(table.copy() for _ in range(6)), steps_taken)
    kernels.backward(
        model,
        1.0,
        method,
        1.0,
        floats((4, 1, 0)),
        floats((2, 1, 0)),
        floats((4, 0)),
        floats((3, 1, 0)),
        table,
        floats((2, 0)),
        floats((0, 3, 1)),
    )
