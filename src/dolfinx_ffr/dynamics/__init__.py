# SPDX-License-Identifier: MIT
"""Equations of motion, time integration and its discrete adjoint, by NumPy and Numba only."""

from __future__ import annotations

from .adjoint import adjoint
from .failures import SimulationError
from .initial import initial_state
from .integration.accuracy import coarser_run, run_to_tolerance
from .integration.compiled import (
    INTEGRATORS,
    compile_kernels,
    compile_side_by_side,
    compiled_functions,
)
from .integration.generalized_alpha import GeneralizedAlpha
from .integration.radau import RadauIIA
from .integration.stages import stage_integrals
from .integration.time_interval import TimeInterval
from .memory import available_memory, check_memory, required_memory
from .model import FlatModel, assemble_model, check_names
from .simulation import integrate, restored, simulate
from .spatial import MarkerMotion, marker_motion, marker_motion_pullback
from .trajectory import Integrator, Trajectory, TrajectoryBar
from .validity import LargeDeformationWarning, SofteningWarning, TiltedAxisWarning, TimeStepWarning

__all__ = [
    "INTEGRATORS",
    "FlatModel",
    "GeneralizedAlpha",
    "Integrator",
    "LargeDeformationWarning",
    "MarkerMotion",
    "RadauIIA",
    "SimulationError",
    "SofteningWarning",
    "TiltedAxisWarning",
    "TimeInterval",
    "TimeStepWarning",
    "Trajectory",
    "TrajectoryBar",
    "adjoint",
    "assemble_model",
    "available_memory",
    "check_memory",
    "check_names",
    "coarser_run",
    "compile_kernels",
    "compile_side_by_side",
    "compiled_functions",
    "initial_state",
    "integrate",
    "marker_motion",
    "marker_motion_pullback",
    "required_memory",
    "restored",
    "run_to_tolerance",
    "simulate",
    "stage_integrals",
]
