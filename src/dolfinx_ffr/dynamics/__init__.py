# SPDX-License-Identifier: MIT
"""Equations of motion, time integration and its discrete adjoint, by NumPy and Numba only."""

from __future__ import annotations

from ..documentation import explain_fields
from .adjoint import Bars, adjoint
from .failures import SimulationError
from .integration.certificate import Certificate, Judge, Run, certified, relative_change
from .integration.compiled import (
    INTEGRATORS,
    compile_kernels,
    compile_side_by_side,
    compiled_functions,
)
from .integration.generalized_alpha import GeneralizedAlpha
from .integration.radau import RadauIIA
from .integration.stages import stage_integrals
from .integration.time_interval import (
    REFERENCE,
    StepChoice,
    TimeInterval,
    recorded,
    refined,
    restored_method,
)
from .kinematics import MarkerMotion, marker_motion, marker_motion_pullback
from .mechanism_bars import MechanismBars, influence, parameter_slopes
from .memory import check_memory, required_memory
from .model import FlatModel, assemble_model, check_names
from .power import drives, driving_power, driving_power_pullback
from .simulation import integrate, load_cells, restored, simulate
from .trajectory import Integrator, Trajectory, TrajectoryBar
from .validity import (
    LargeDeformationWarning,
    SofteningWarning,
    TiltedAxisWarning,
    TimeStepWarning,
    warn_of_limits,
)

__all__ = [
    "INTEGRATORS",
    "REFERENCE",
    "Bars",
    "Certificate",
    "FlatModel",
    "GeneralizedAlpha",
    "Integrator",
    "Judge",
    "LargeDeformationWarning",
    "MarkerMotion",
    "MechanismBars",
    "RadauIIA",
    "Run",
    "SimulationError",
    "SofteningWarning",
    "StepChoice",
    "TiltedAxisWarning",
    "TimeInterval",
    "TimeStepWarning",
    "Trajectory",
    "TrajectoryBar",
    "adjoint",
    "assemble_model",
    "certified",
    "check_memory",
    "check_names",
    "compile_kernels",
    "compile_side_by_side",
    "compiled_functions",
    "drives",
    "driving_power",
    "driving_power_pullback",
    "influence",
    "integrate",
    "load_cells",
    "marker_motion",
    "marker_motion_pullback",
    "parameter_slopes",
    "recorded",
    "refined",
    "relative_change",
    "required_memory",
    "restored",
    "restored_method",
    "simulate",
    "stage_integrals",
    "warn_of_limits",
]

explain_fields(globals())
