# SPDX-License-Identifier: MIT
"""What is designed: level sets of radial basis functions, filtered densities, their updates."""

from __future__ import annotations

from ..documentation import explain_fields
from .density_field import density_field
from .density_filter import DensityFilter, HeavisideProjection
from .dimensions import DimensionDesign
from .level_set import LevelSet
from .level_set_step import Evolution, VelocityExtension
from .mirrors import Isometry, Mirror, image_cells, images, mirror_lines, mirror_planes
from .node_motion import DimensionMotion
from .parametrization import DensityDesign, Design, Variables, VolumeBisection, check_volume, shrunk
from .rbf import (
    ExponentialSpline,
    Gaussian,
    Kernel,
    Multiquadric,
    ThinPlate,
    Wendland,
    check_kernel,
)

__all__ = [
    "DensityDesign",
    "DensityFilter",
    "Design",
    "DimensionDesign",
    "DimensionMotion",
    "Evolution",
    "ExponentialSpline",
    "Gaussian",
    "HeavisideProjection",
    "Isometry",
    "Kernel",
    "LevelSet",
    "Mirror",
    "Multiquadric",
    "ThinPlate",
    "Variables",
    "VelocityExtension",
    "VolumeBisection",
    "Wendland",
    "check_kernel",
    "check_volume",
    "density_field",
    "image_cells",
    "images",
    "mirror_lines",
    "mirror_planes",
    "shrunk",
]

explain_fields(globals())
