# SPDX-License-Identifier: MIT
"""Compilation of the kernels at a chosen moment, and its announcement."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable

import numpy as np

from .arrays import ModelArrays
from .loops import kernels

__all__ = ["compile_kernels"]

#: Seconds of silence before a compilation is announced; loading from disk takes less.
_PATIENCE = 1.5


_ready = False
_stiffened_ready = False


def compile_kernels(
    announce: Callable[[str], None] | None = None, *, stiffened_markers: bool = False
) -> float:
    """Compile the time integration and its adjoint, or load them from disk.

    Compilation takes about half a minute and happens once on a machine; later runs load the
    result. It is called by the simulation itself; call it beforehand to choose the moment.

    Args:
        announce: Called with one line of text if it takes long; by default the line goes to the
            standard error. Under MPI, silence all ranks but one with ``lambda text: None``.
        stiffened_markers: Compile for mechanisms whose markers have geometric stiffness, which is
            another compilation; the others do without what these need.

    Returns:
        Seconds taken.
    """
    global _ready, _stiffened_ready
    if stiffened_markers:
        if _stiffened_ready:
            return 0.0
        seconds = announced(lambda: _call_on(empty_model(stiffened_markers=True)), announce)
        _stiffened_ready = True
        return seconds
    if _ready:
        return 0.0
    seconds = announced(_call_on_nothing, announce)
    _ready = True
    return seconds


def announced(work: Callable[[], None], announce: Callable[[str], None] | None = None) -> float:
    """Do what may take long, and say so if it does.

    Args:
        work: What to do.
        announce: Called with one line of text; by default it goes to the standard error.

    Returns:
        Seconds taken.
    """
    began = time.perf_counter()
    text = "dolfinx_ffr: compiling the time integration; this happens once and takes a while ..."
    say = announce if announce is not None else lambda line: print(line, file=sys.stderr)
    timer = threading.Timer(_PATIENCE, say, args=(text,))
    timer.daemon = True
    timer.start()
    try:
        work()
    finally:
        timer.cancel()
    return time.perf_counter() - began


def empty_model(*, stiffened_markers: bool = False) -> ModelArrays:
    """A mechanism without bodies.

    Args:
        stiffened_markers: Whether it counts as one whose markers have geometric stiffness.
    """
    z, none = np.zeros, np.zeros(0, dtype=np.int64)
    return ModelArrays(
        first=none,
        modes=none,
        mass=z(0),
        S=z((0, 1, 2)),
        G=z((0, 1, 1)),
        N=z((0, 1, 1)),
        K=z((0, 0, 0)),
        alpha=z(0),
        beta=z(0),
        stiffened=none,
        stiffening=z((0, 4, 0, 0)),
        inverse=z((0, 3, 3)),
        gravity=z((2, 2)),
        marker_body=none,
        marker_slot=none,
        W=z((0, 2, 1)),
        psi=z((0, 0)),
        bent=(none, z((0, 2, 0, 0))) if stiffened_markers else None,
        prescribed=z((2, 0, 3, 3)),
        kind=none,
        side=z((0, 2), dtype=np.int64),
        normal=z((0, 2)),
        ratio=z(0),
        drive=z((2, 0, 3)),
        force_kind=none,
        force_side=z((0, 2), dtype=np.int64),
        force_constants=z((0, 2)),
        force_table=z((2, 0, 3)),
    )


def _call_on_nothing() -> None:
    """Call every kernel on a mechanism without bodies, which makes Numba compile or load it."""
    _call_on(empty_model())


def _call_on(model: ModelArrays) -> None:
    """Call every kernel on an empty model."""
    z, none = np.zeros, np.zeros(0, dtype=np.int64)
    state, table, method = z(0), [z((1, 0)) for _ in range(6)], (0.0, 0.0, 0.5, 0.25)
    kernels.evaluate(model, 0, state, state, state, state)
    kernels.place(model, 0, state)
    kernels.loads(model, table[0], table[0], z((1, 0, 3)))
    kernels.start(model, state, state, state, state, 1, 1.0, z((4, 0)))
    kernels.march(model, 1.0, method, *table, none)
    states, bars, multipliers = z((4, 1, 0)), z((3, 1, 0)), z((2, 1, 0))
    kernels.backward(
        model, 1.0, method, 1.0, states, multipliers, z((4, 0)), bars, table[0], z((2, 0)),
        z((2, 1, 0)), z((0, 3, 1)), z((2, 0)),
    )  # fmt: skip
    kernels.transpose(model, 0, state, state, state, state, state, state, True, state, z((0, 3, 1)))
