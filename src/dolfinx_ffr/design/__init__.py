# SPDX-License-Identifier: MIT
"""Designs: level sets of radial basis functions, filtered densities, their updates."""

from __future__ import annotations

from .base import SHARP as SHARP
from .base import SHARP_PROGRESS as SHARP_PROGRESS
from .base import Design as Design
from .base import ParameterDesign, check_volume, shrunk
from .base import Variables as Variables
from .base import density_field as density_field
from .densities import LEAST as LEAST
from .densities import DensityDesign as DensityDesign
from .densities import DensityFilter as DensityFilter
from .densities import HeavisideProjection as HeavisideProjection
from .dimensions import DimensionDesign as DimensionDesign
from .dimensions import DimensionMotion
from .level_set import LevelSet as LevelSet
from .level_set_step import Evolution as Evolution
from .level_set_step import VelocityExtension as VelocityExtension
from .mirrors import Isometry, images
from .mirrors import Mirror as Mirror
from .mirrors import mirror_lines as mirror_lines
from .mirrors import mirror_planes as mirror_planes
from .rbf import ExponentialSpline as ExponentialSpline
from .rbf import Gaussian as Gaussian
from .rbf import Kernel as Kernel
from .rbf import Multiquadric as Multiquadric
from .rbf import ThinPlate as ThinPlate
from .rbf import Wendland as Wendland
from .rbf import check_kernel
from .rims import HoleRims
