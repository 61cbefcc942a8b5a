# SPDX-License-Identifier: MIT
"""Equations of motion, time integration and its discrete adjoint, by NumPy and Numba only."""

from __future__ import annotations

from .adjoint import adjoint
from .compiled import compile_kernels
from .failures import SimulationError
from .generalized_alpha import GeneralizedAlpha
from .initial import initial_state
from .model import FlatModel, assemble_model
from .radau import RadauIIA, compile_stage_kernels
from .simulation import Integrator, SofteningWarning, simulate
from .trajectory import Trajectory, TrajectoryBar

__all__ = [
    "FlatModel",
    "GeneralizedAlpha",
    "Integrator",
    "RadauIIA",
    "SimulationError",
    "SofteningWarning",
    "Trajectory",
    "TrajectoryBar",
    "adjoint",
    "assemble_model",
    "compile_kernels",
    "compile_stage_kernels",
    "initial_state",
    "simulate",
]
