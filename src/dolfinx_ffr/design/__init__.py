# SPDX-License-Identifier: MIT
"""What is designed: level sets of radial basis functions, filtered densities, their updates."""

from __future__ import annotations

from .density_filter import DensityFilter, HeavisideProjection
from .level_set import LevelSet, LevelSetDesign
from .level_set_step import Evolution, VelocityExtension
from .parametrization import DensityDesign, Design, VolumeBisection, check_stages, shrunk
from .rbf import (
    ExponentialSpline,
    Gaussian,
    Kernel,
    Multiquadric,
    RadialBasis,
    ThinPlate,
    Wendland,
    check_kernel,
)

__all__ = [
    "DensityDesign",
    "DensityFilter",
    "Design",
    "Evolution",
    "ExponentialSpline",
    "Gaussian",
    "HeavisideProjection",
    "Kernel",
    "LevelSet",
    "LevelSetDesign",
    "Multiquadric",
    "RadialBasis",
    "ThinPlate",
    "VelocityExtension",
    "VolumeBisection",
    "Wendland",
    "check_kernel",
    "check_stages",
    "shrunk",
]
