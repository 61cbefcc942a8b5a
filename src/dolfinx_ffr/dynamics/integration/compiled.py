# SPDX-License-Identifier: MIT
"""Compilation of time integration at a chosen moment, and its announcement."""

from __future__ import annotations

import os
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context

from ..compilation import Compiled
from ..kinematics import compiled_kinematics
from ..trajectory import Integrator
from .generalized_alpha import GeneralizedAlpha
from .radau import RadauIIA

__all__ = ["INTEGRATORS", "compile_kernels", "compile_side_by_side", "compiled_functions"]

#: All integrators.
INTEGRATORS: tuple[type[Integrator], ...] = (GeneralizedAlpha, RadauIIA)

#: Seconds of silence before a compilation is announced; loading from disk takes less.
_PATIENCE = 1.5


def compiled_functions(
    integrators: Iterable[type[Integrator]] = INTEGRATORS, *, space: bool = False
) -> list[Compiled]:
    """Compiled functions that integrators need, those of the kinematics included, each once.

    Args:
        integrators: The integrators.
        space: Whether the kinematics are those in space, instead of those in the plane.
    """
    own = [function for integrator in integrators for function in integrator.compiled]
    return list(dict.fromkeys([*compiled_kinematics(space=space), *own]))


def compile_side_by_side(functions: Iterable[Compiled]) -> Iterator[str]:
    """Compile functions of integrators on all cores, into the cache from which others load them.

    For a set-up: this process itself has compiled none of them afterwards.

    Args:
        functions: The functions, the longest first.

    Yields:
        The name of each as soon as it is there.
    """
    # One function takes as long as half of all others: more processes gain nothing.
    processes = min(3, os.cpu_count() or 1)
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        tasks = [pool.submit(_compile, function.name) for function in functions]
        yield from (task.result() for task in as_completed(tasks))


def _compile(name: str) -> str:
    """Compile the function of a name."""
    every = [*compiled_functions(), *compiled_kinematics(space=True)]
    next(function for function in every if function.name == name).compile()
    return name


def compile_kernels(
    announce: Callable[[str], None] | None = None,
    *,
    integrators: Iterable[type[Integrator]] = (GeneralizedAlpha,),
    stiffened_markers: bool | None = None,
    space: bool = False,
) -> float:
    """Compile time integration and its adjoint, or load them from disk.

    Compilation happens once on a machine; later runs load the result. The simulation itself calls
    this; call it beforehand to choose the moment.

    Args:
        announce: Called with one line of text if it takes long; by default the line goes to the
            standard error. Under MPI, silence all ranks but one with ``lambda text: None``.
        integrators: The integrators that will be used.
        stiffened_markers: Without effect; goes with the next release.
        space: Whether the mechanisms are in space, instead of in the plane.

    Returns:
        Seconds taken.
    """
    if stiffened_markers is not None:
        warnings.warn(
            "compile_kernels: stiffened_markers has no effect any more and goes with the next "
            "release",
            DeprecationWarning,
            stacklevel=2,
        )
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
    """Context that says so if what is done in it takes long."""
    text = "dolfinx_ffr: compiling the time integration; this happens once and takes a while ..."
    say = announce if announce is not None else lambda line: print(line, file=sys.stderr)
    timer = threading.Timer(_PATIENCE, say, args=(text,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
