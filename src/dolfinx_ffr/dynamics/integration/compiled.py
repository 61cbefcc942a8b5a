# SPDX-License-Identifier: MIT
"""Compilation of time integration at a chosen moment, and its announcement."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context

from ..compilation import Compiled
from ..kinematics import compiled_kinematics
from ..trajectory import Integrator
from .generalized_alpha import GeneralizedAlpha
from .radau import RadauIIA

#: All integrators.
INTEGRATORS: tuple[type[Integrator], ...] = (GeneralizedAlpha, RadauIIA)

#: Seconds of silence before a compilation is announced; loading from disk takes less.
_PATIENCE = 1.5


def compiled_functions(
    integrators: Iterable[type[Integrator]] = INTEGRATORS, *, space: bool = False
) -> list[Compiled]:
    """Compiled functions of integrators and of the kinematics in the plane or space, each once."""
    of_methods = [function for integrator in integrators for function in integrator.compiled]
    return list(dict.fromkeys([*compiled_kinematics(space=space), *of_methods]))


def compile_side_by_side(functions: Iterable[Compiled]) -> Iterator[str]:
    """Compile functions, the longest first, in processes that fill the cache; yields their names.

    For a set-up: this process itself has compiled none of them afterwards.
    """
    # One function takes as long as half of all others: more processes gain nothing.
    processes = min(3, os.cpu_count() or 1)
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        tasks = [pool.submit(_compile, function.name) for function in functions]
        yield from (task.result() for task in as_completed(tasks))


def _compile(name: str) -> str:
    """Compile the function of a name."""
    functions = [*compiled_functions(), *compiled_kinematics(space=True)]
    next(function for function in functions if function.name == name).compile()
    return name


def compile_kernels(
    announce: Callable[[str], None] | None = None,
    *,
    integrators: Iterable[type[Integrator]] = (GeneralizedAlpha,),
    space: bool = False,
) -> float:
    """Compile time integration and its adjoint, or load them from disk; gives the seconds taken.

    Compilation happens once on a machine; later runs load the result. The simulation itself calls
    this; call it beforehand to choose the moment.

    Args:
        announce: Called with one line of text if it takes long; by default the line goes to the
            standard error. Under MPI, silence all ranks but one with ``lambda text: None``.
        integrators: The integrators that will be used.
        space: Whether the mechanisms are in space, instead of in the plane.
    """
    waiting = [
        function for function in compiled_functions(integrators, space=space) if not function.ready
    ]
    if not waiting:
        return 0.0
    began = time.perf_counter()
    with _announced(announce):
        for function in waiting:
            function.compile()
    return time.perf_counter() - began


@contextmanager
def _announced(announce: Callable[[str], None] | None) -> Iterator[None]:
    """Context that announces a compilation if its body takes long."""
    text = "dolfinx_ffr: compiling the time integration; this happens once and takes a while ..."
    say = announce if announce is not None else lambda line: print(line, file=sys.stderr)
    timer = threading.Timer(_PATIENCE, say, args=(text,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
