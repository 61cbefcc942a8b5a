# SPDX-License-Identifier: MIT
"""Design of the flexible parts of moving machines with FEniCSx.

The names below are loaded when they are first used, so that the mechanical half works where no
DOLFINx is installed.
"""

from __future__ import annotations

import contextlib
import sys
import warnings
from importlib import import_module
from typing import Any

__version__ = "0.1.0"

#: Where each public name lives: a folder, or a module beside the folders.
_FOLDERS = {
    "body": ["BodyMarker", "ParametricBody", "VolumeIntegrals"],
    "design": [
        "DensityDesign",
        "DensityFilter",
        "Design",
        "Evolution",
        "ExponentialSpline",
        "Gaussian",
        "HeavisideProjection",
        "LevelSet",
        "Mirror",
        "MirrorPlane",
        "Multiquadric",
        "ThinPlate",
        "VelocityExtension",
        "VolumeBisection",
        "Wendland",
        "density_field",
        "mirror_lines",
        "mirror_planes",
    ],
    "dynamics": [
        "GeneralizedAlpha",
        "LargeDeformationWarning",
        "RadauIIA",
        "SimulationError",
        "SofteningWarning",
        "TimeInterval",
        "TiltedAxisWarning",
        "TimeStepWarning",
        "Trajectory",
        "simulate",
    ],
    "fem": [
        "Domain",
        "ElasticMaterial",
        "Elasticity",
        "Interface",
        "Isotropic",
        "LinearMass",
        "PlaneStrain",
        "PlaneStress",
        "RAMP",
        "SIMP",
        "SuppressedVoidMass",
    ],
    "gradients": [
        "ApproximateGradient",
        "ElementByElement",
        "ElementGradient",
        "ExactAdjoint",
        "GradientElements",
        "GradientErrors",
        "GradientMethod",
        "GradientReport",
        "IllConditionedWarning",
        "IntegralDerivatives",
        "ModeDerivative",
        "ScatteredInterpolation",
        "Solver",
        "best_length",
        "elementwise_gradient",
        "gradient_errors",
        "integral_derivatives",
        "mode_derivatives",
    ],
    "io": ["CheckpointError", "read_history", "write_density", "write_fields", "write_summary"],
    "mechanical_problem": ["ConstraintValue", "MechanicalEvaluation", "MechanicalProblem"],
    "mechanism": [
        "Assembled",
        "Bushing",
        "Cylindrical",
        "Distance",
        "Force",
        "Gear",
        "Ground",
        "LinearDrive",
        "Mechanism",
        "Motion",
        "Moving",
        "Placement",
        "Planar",
        "PointMass",
        "PointOnLine",
        "PointOnPlane",
        "PrescribedAngle",
        "PrescribedPosition",
        "RayleighDamping",
        "Revolute",
        "Spherical",
        "SpringDamper",
        "StaticEquilibrium",
        "Torque",
        "TorsionalSpringDamper",
        "Translational",
        "Universal",
        "Weld",
    ],
    "objective": [
        "Combination",
        "Constraint",
        "DensityField",
        "Derivatives",
        "Frequency",
        "IntegralCompliance",
        "JointForce",
        "MarkerAcceleration",
        "MarkerVelocity",
        "Mass",
        "Objective",
        "PathTracking",
        "PeakCompliance",
        "PeakStress",
        "PowerMean",
        "Response",
        "StressField",
        "Sum",
        "Volume",
        "WeightedSum",
        "WorstCase",
    ],
    "optimization": [
        "DesignLoop",
        "DesignWarning",
        "LevelSetEvolution",
        "MMA",
        "Optimizer",
        "Result",
        "gray_fraction",
        "optimize",
    ],
    "part": [
        "Part",
        "PartWarning",
        "Solid",
        "Verification",
        "verify",
    ],
    "postprocessing": [
        "BodyReport",
        "LocalModes",
        "LocalModesWarning",
        "ModeSelection",
        "ModelReport",
        "StressEnvelope",
        "StressModes",
        "local_modes",
        "mode_error",
        "model_report",
        "modes_below",
        "propose_modes",
        "select_modes",
        "von_mises",
        "worst_stress",
    ],
    "problem": ["Evaluation", "MotionEvaluation", "Problem"],
    "reduction": [
        "ChordFrame",
        "CraigBampton",
        "FlexibleBody",
        "ReducedBody",
        "RoundOffWarning",
        "TangentFrame",
    ],
    "report": ["recorded_warnings", "run_record", "write_report"],
}

__all__ = sorted(name for names in _FOLDERS.values() for name in names)

_HOME = {name: folder for folder, names in _FOLDERS.items() for name in names}


#: Names of the release before, each with the one that took its place.
_RENAMED: dict[str, str] = {
    "ShapeDerivative": "ModeDerivative",
    "shape_derivatives": "mode_derivatives",
}


def _load_dolfinx_with_readable_arguments() -> None:
    """Load DOLFINx, which cannot be imported where an argument of the program is not UTF-8."""
    given = sys.argv
    readable = [text.encode(errors="replace").decode() for text in given]
    if readable == given or "dolfinx" in sys.modules:
        return
    sys.argv = readable
    try:
        with contextlib.suppress(ImportError):
            import_module("dolfinx")
    finally:
        sys.argv = given


_load_dolfinx_with_readable_arguments()


def __getattr__(name: str) -> Any:
    """Load the module of a public name."""
    if name in _RENAMED:
        new = _RENAMED[name]
        warnings.warn(
            f"dolfinx_ffr.{name} is now called {new}; the old name goes with the next release",
            DeprecationWarning,
            stacklevel=2,
        )
        return __getattr__(new)
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_HOME[name]}", __name__), name)
    # The import has made a module of the same name an attribute; the function takes its place.
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names."""
    return [*__all__, "__version__"]
