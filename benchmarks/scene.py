# SPDX-License-Identifier: MIT
"""What is measured: the slider-cranks of the demos, at designs that every mesh can hold."""

import importlib.util
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Progress
from numpy.typing import NDArray

import dolfinx_ffr as ffr

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


def slider_crank(comm: MPI.Comm, elements: Sequence[int] = (200, 20), **own: Any) -> ffr.Problem:
    """The problem of the demo in the plane, or in space for three numbers of ``elements``.

    ``own`` options take the place of the demo's choice.
    """
    plane = len(elements) == 2
    scene = demo("slider_crank" if plane else "spatial_slider_crank")
    make = scene.reference_problem if plane else scene.spatial_problem
    return make(comm, tuple(elements), **own)


def with_rod(problem: ffr.Problem, **own: Any) -> ffr.Problem:
    """The problem with a rod built again with ``own`` options of `FlexibleBody`."""
    old = problem.flexible["rod"]
    options = {"frame": old.reduction.frame, "modes": old.reduction.modes, **own}
    rod = ffr.FlexibleBody(old.domain, old.material, interpolation=old.interpolation, **options)
    return ffr.Problem({"rod": rod}, problem.mechanism, problem.integrator, problem.objective)


def holes_design(domain: ffr.Domain) -> NDArray[np.float64]:
    """A rod with three rows of ten round holes, like the start of a level-set design, (cells,).

    In space the holes go through the rod along z. Elements on the edge of a hole are gray; the
    ends are solid.
    """
    low, high = domain.bounding_box
    size = (high - low)[:2]
    margin = 0.25 * size[1]
    cell = np.array([(size[0] - 2.0 * margin) / 10, size[1] / 3])  # of the pattern, one hole each
    offset = (domain.centroids - low)[:, :2] - [margin, 0.0]
    from_hole = np.linalg.norm((offset / cell % 1.0 - 0.5) * cell, axis=1) - 0.1 * size[1]
    x = np.clip(0.5 + 0.5 * from_hole / domain.cell_size, 0.0, 1.0)
    ends = (offset[:, 0] < 0.0) | (offset[:, 0] > size[0] - 2.0 * margin)
    return np.where(ends | ~domain.design_cells, 1.0, x)


def block_design(domain: ffr.Domain, blocks: tuple[int, int]) -> NDArray[np.float64]:
    """A gray rod whose density is constant on each of a few blocks along and across, (cells,).

    On every mesh that divides the blocks evenly it is the same rod, so that nothing but the
    displacements changes with the mesh. The first and last column are solid.
    """
    i, j = np.divmod(block_numbers(domain, blocks), blocks[1])
    x = 0.65 + 0.35 * np.sin(0.5 + 1.1 * i) * np.cos(0.3 + 1.7 * j)
    return np.where((i == 0) | (i == blocks[0] - 1), 1.0, x)


def block_numbers(domain: ffr.Domain, blocks: tuple[int, int]) -> NDArray[np.int64]:
    """The number of the block in which each cell of this rank lies, shape (cells,)."""
    low, high = domain.bounding_box
    i, j = np.floor((domain.centroids - low) / (high - low) * blocks).astype(np.int64).T
    return i * blocks[1] + j


def warm_up(
    comm: MPI.Comm, progress: Progress = lambda _: None, *, dimension: int = 2, **own: Any
) -> None:
    """Evaluate a tiny rod, so that whatever is compiled or loaded once is there."""
    small, modes = ((20, 2), 4) if dimension == 2 else ((8, 2, 2), 2)
    problem = slider_crank(comm, small, modes=modes, steps=400)
    if own:
        problem = with_rod(problem, **own)
    problem.gradient(np.ones(problem.flexible["rod"].domain.n_cells))
    progress(1.0)
