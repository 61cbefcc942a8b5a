# SPDX-License-Identifier: MIT
"""What is measured: the slider-crank of the demo, at designs that every mesh can hold."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from types import ModuleType

from mpi4py import MPI

import numpy as np
from jobs import Progress
from numpy.typing import NDArray

import dolfinx_ffr as ffr

__all__ = [
    "block_design",
    "block_numbers",
    "demo",
    "holes_design",
    "slider_crank",
    "slider_crank_numbers",
    "spatial_slider_crank",
    "warm_up",
]

DEMOS = Path(__file__).resolve().parents[1] / "demos"


@cache
def demo(name: str) -> ModuleType:
    """Load a demo by its ``name``: it is a program and not part of the package."""
    file = DEMOS / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise ImportError(f"cannot load {file}")
    if str(DEMOS) not in sys.path:  # what demos take from beside them
        sys.path.append(str(DEMOS))
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up, and so does what loads beside it
    spec.loader.exec_module(module)
    return module


def slider_crank_numbers() -> tuple[float, float, float, float]:
    """The demo's crank radius [m], its turns, their duration [s], the slider's mass [kg]."""
    reference = demo("slider_crank")
    return reference.CRANK, reference.TURNS, reference.DURATION, reference.SLIDER


def slider_crank(
    comm: MPI.Comm,
    elements: tuple[int, int] = (200, 20),
    *,
    order: int = 1,
    domain: ffr.Domain | None = None,
    modes: int | None = None,
    steps: int | None = None,
    tolerance: float | None = None,
) -> ffr.Problem:
    """The demo's problem, with what is given here in place of the demo's own choice.

    Args:
        comm: Communicator over which the mesh is distributed.
        elements: Along and across the rod.
        order: Polynomial order of the displacements.
        domain: A mesh that is there already, instead of a new one.
        modes: Number of normal modes.
        steps: Number of time steps.
        tolerance: Relative residual of the eigenvalue problem and of the adjoint systems.
    """
    chosen = {"modes": modes, "steps": steps}
    problem: ffr.Problem = demo("slider_crank").reference_problem(
        comm,
        elements,
        order=order,
        domain=domain,
        **{name: value for name, value in chosen.items() if value is not None},
    )
    if tolerance is None:
        return problem
    rod = problem.flexible["rod"]
    rod = ffr.FlexibleBody(
        rod.domain,
        rod.material,
        frame=rod.reduction.frame,
        modes=rod.reduction.modes,
        interpolation=rod.interpolation,
        tolerance=tolerance,
    )
    return ffr.Problem({"rod": rod}, problem.mechanism, problem.integrator, problem.objective)


def spatial_slider_crank(
    comm: MPI.Comm,
    elements: tuple[int, int, int] = (80, 8, 8),
    *,
    modes: int | None = None,
    steps: int | None = None,
) -> ffr.Problem:
    """The problem of the demo in space, with what is given here in place of the demo's own choice.

    Args:
        comm: Communicator over which the mesh is distributed.
        elements: Of the rod, along x, y and z.
        modes: Number of normal modes.
        steps: Number of time steps.
    """
    chosen = {name: n for name, n in (("modes", modes), ("steps", steps)) if n is not None}
    problem: ffr.Problem = demo("spatial_slider_crank").spatial_problem(comm, elements, **chosen)
    return problem


def holes_design(domain: ffr.Domain) -> NDArray[np.float64]:
    """A rod with three rows of ten round holes, like the start of a level-set design.

    In space the holes go through the rod along z. Elements on the edge of a hole are gray; the
    ends are solid.

    Returns:
        Density of the cells owned by this rank, shape (cells,).
    """
    low, high = domain.bounding_box
    size = (high - low)[:2]
    element = domain.cell_size
    margin = 0.25 * size[1]
    cell = np.array([(size[0] - 2.0 * margin) / 10, size[1] / 3])  # of the pattern, one hole each
    offset = (domain.centroids - low)[:, :2] - [margin, 0.0]
    from_hole = np.linalg.norm((offset / cell % 1.0 - 0.5) * cell, axis=1) - 0.1 * size[1]
    x = np.clip(0.5 + 0.5 * from_hole / element, 0.0, 1.0)
    ends = (offset[:, 0] < 0.0) | (offset[:, 0] > size[0] - 2.0 * margin)
    return np.where(ends | ~domain.design_cells, 1.0, x)


def block_design(domain: ffr.Domain, blocks: tuple[int, int]) -> NDArray[np.float64]:
    """A gray rod whose density is constant on each of a few blocks.

    On every mesh that divides the blocks evenly it is the same rod, so that nothing but the
    displacements changes with the mesh.

    Args:
        domain: The rod.
        blocks: Along and across; the first and last column are solid.

    Returns:
        Density of the cells owned by this rank, shape (cells,).
    """
    i, j = np.divmod(block_numbers(domain, blocks), blocks[1])
    x = 0.65 + 0.35 * np.sin(0.5 + 1.1 * i) * np.cos(0.3 + 1.7 * j)
    return np.where((i == 0) | (i == blocks[0] - 1), 1.0, x)


def block_numbers(domain: ffr.Domain, blocks: tuple[int, int]) -> NDArray[np.int64]:
    """The number of the block in which each cell of this rank lies, shape (cells,).

    Args:
        domain: The rod.
        blocks: Along and across.
    """
    low, high = domain.bounding_box
    i, j = np.floor((domain.centroids - low) / (high - low) * blocks).astype(np.int64).T
    return i * blocks[1] + j


def warm_up(
    comm: MPI.Comm, progress: Progress = lambda _: None, *, orders: Sequence[int] = (1,)
) -> None:
    """Evaluate a tiny rod, so that whatever is compiled or loaded once is there.

    Args:
        comm: The ranks.
        progress: Told the part that is done.
        orders: Polynomial orders of the displacements.
    """
    for place, order in enumerate(orders):
        problem = slider_crank(comm, (20, 2), order=order, modes=4, steps=400)
        problem.gradient(np.ones(problem.flexible["rod"].domain.n_cells))
        progress((place + 1) / len(orders))
