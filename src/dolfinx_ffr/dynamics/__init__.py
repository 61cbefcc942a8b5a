# SPDX-License-Identifier: MIT
"""Equations of motion, time integration and its discrete adjoint, by NumPy and Numba only."""

from __future__ import annotations

from .adjoint import adjoint
from .compiled import compile_kernels
from .generalized_alpha import GeneralizedAlpha, SimulationError, SofteningWarning, simulate
from .initial import initial_state
from .model import FlatModel, assemble_model
from .trajectory import Trajectory, TrajectoryBar

__all__ = [
    "FlatModel",
    "GeneralizedAlpha",
    "SimulationError",
    "SofteningWarning",
    "Trajectory",
    "TrajectoryBar",
    "adjoint",
    "assemble_model",
    "compile_kernels",
    "initial_state",
    "simulate",
]
