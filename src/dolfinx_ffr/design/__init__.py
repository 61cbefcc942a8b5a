# SPDX-License-Identifier: MIT
"""Designs: level sets of radial basis functions, filtered densities, their updates."""

from __future__ import annotations

from .density_filter import DensityFilter as DensityFilter
from .density_filter import HeavisideProjection as HeavisideProjection
from .dimensions import DimensionDesign as DimensionDesign
from .dimensions import DimensionMotion
from .level_set import LevelSet as LevelSet
from .level_set_step import Evolution as Evolution
from .level_set_step import VelocityExtension as VelocityExtension
from .mirrors import Isometry, images
from .mirrors import Mirror as Mirror
from .mirrors import mirror_lines as mirror_lines
from .mirrors import mirror_planes as mirror_planes
from .parametrization import LEAST as LEAST
from .parametrization import SHARP as SHARP
from .parametrization import SHARP_PROGRESS as SHARP_PROGRESS
from .parametrization import DensityDesign as DensityDesign
from .parametrization import Design as Design
from .parametrization import ParameterDesign, check_volume, shrunk
from .parametrization import Variables as Variables
from .parametrization import density_field as density_field
from .rbf import ExponentialSpline as ExponentialSpline
from .rbf import Gaussian as Gaussian
from .rbf import Kernel as Kernel
from .rbf import Multiquadric as Multiquadric
from .rbf import ThinPlate as ThinPlate
from .rbf import Wendland as Wendland
from .rbf import check_kernel
from .rims import HoleRims
