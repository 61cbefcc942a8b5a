# SPDX-License-Identifier: MIT
"""Equations of motion, time integration and its discrete adjoint, by NumPy and Numba only."""

from __future__ import annotations

from .adjoint import Bars as Bars
from .adjoint import adjoint
from .equations import ACCELERATIONS, CONSTRAINTS, FORCES
from .failures import SimulationError as SimulationError
from .integration.compiled import INTEGRATORS as INTEGRATORS
from .integration.compiled import compile_kernels as compile_kernels
from .integration.compiled import compile_side_by_side as compile_side_by_side
from .integration.compiled import compiled_functions as compiled_functions
from .integration.generalized_alpha import GeneralizedAlpha as GeneralizedAlpha
from .integration.radau import RadauIIA as RadauIIA
from .integration.stages import stage_integrals as stage_integrals
from .integration.step_choice import StepChoice as StepChoice
from .integration.step_choice import StepSearch as StepSearch
from .integration.step_choice import recorded as recorded
from .integration.step_choice import restored_method as restored_method
from .integration.time_interval import TimeInterval as TimeInterval
from .kinematics import (
    IN_SPACE,
    Kinematics,
    MarkerMotion,
    State,
    columns_in_space,
    marker_motion_pullback,
    motion_of_marker,
)
from .mechanism_bars import MechanismBars as MechanismBars
from .mechanism_bars import fixed_slopes, influence, parameter_slopes, parametric
from .model import FlatModel as FlatModel
from .model import assemble_model, check_names
from .power import driving_power_pullback, forces_on_frame
from .simulation import check_memory, load_cells, required_memory, restored
from .simulation import integrate as integrate
from .simulation import simulate as simulate
from .trajectory import Integrator as Integrator
from .trajectory import Trajectory as Trajectory
from .trajectory import TrajectoryBar as TrajectoryBar
from .validity import GearFlankWarning as GearFlankWarning
from .validity import LargeDeformationWarning as LargeDeformationWarning
from .validity import SofteningWarning as SofteningWarning
from .validity import TiltedAxisWarning as TiltedAxisWarning
from .validity import TimeStepWarning as TimeStepWarning
from .validity import warn_of_limits
