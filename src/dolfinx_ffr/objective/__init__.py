# SPDX-License-Identifier: MIT
"""Objectives: numbers of a trajectory and of the bodies, and their exact derivatives.

Objectives can be weighted and added (``0.3 * a + b``), and bounded by a :class:`Constraint`. Those
of several motions become one number by a :class:`Combination`.
"""

from __future__ import annotations

from .base import Constraint as Constraint
from .base import DensityField as DensityField
from .base import Derivatives as Derivatives
from .base import Inventory as Inventory
from .base import Objective as Objective
from .base import Response as Response
from .base import StressField as StressField
from .base import Sum as Sum
from .base import check_objective, constraint_of_place, derivatives_of, value_of
from .combination import Combination as Combination
from .combination import PowerMean as PowerMean
from .combination import WeightedSum as WeightedSum
from .combination import WorstCase as WorstCase
from .compliance import IntegralCompliance as IntegralCompliance
from .compliance import PeakCompliance as PeakCompliance
from .joints import DrivePower as DrivePower
from .joints import DriveWork as DriveWork
from .joints import JointForce as JointForce
from .markers import MarkerAcceleration as MarkerAcceleration
from .markers import MarkerVelocity as MarkerVelocity
from .markers import PathTracking as PathTracking
from .markers import ResidualVibration as ResidualVibration
from .markers import marker_derivatives as marker_derivatives
from .properties import Frequency as Frequency
from .properties import Mass as Mass
from .properties import Volume as Volume
from .stress import PeakStress as PeakStress
from .stress import is_stress, von_mises_root
from .stress_coordinates import stress_coordinates
from .time_average import time_weights
