# SPDX-License-Identifier: MIT
"""Runs of a design loop without noise, and what ranks have in common of them."""

from __future__ import annotations

import warnings
from typing import Any

from mpi4py import MPI

import numpy as np

import dolfinx_ffr as ffr
from dolfinx_ffr.optimization.loop import COLUMNS


def quiet(problem: Any, design: Any, start: Any = None, **options: Any) -> ffr.Result:
    """Optimise without a progress bar, and without warnings of designs that are only tried."""
    with warnings.catch_warnings():
        for expected in (ffr.SofteningWarning, ffr.LargeDeformationWarning):
            warnings.simplefilter("ignore", expected)
        warnings.filterwarnings("ignore", ".*loose pieces of", ffr.DesignWarning)
        usual = {"progress": False, "mode_tolerance": None, "boundary": 0}
        return ffr.optimize(problem, design, start, **{**usual, **options})


def check_alike(comm: MPI.Intracomm, result: ffr.Result) -> None:
    """Demand that each rank has the same bits."""
    rows = np.array([result.history[name] for name in COLUMNS])
    mine = result.coefficients.tobytes() + rows.tobytes() + result.reason.encode()
    assert len(set(comm.allgather(mine))) == 1
