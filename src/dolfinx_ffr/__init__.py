# SPDX-License-Identifier: MIT
"""Design of the flexible parts of moving machines with FEniCSx.

The names below are loaded when they are first used, so that the mechanical half works where no
DOLFINx is installed.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

#: where each public name lives
_ROOMS = {
    "approximate_gradient": ["ApproximateGradient"],
    "body": ["BodyMarker", "VolumeIntegrals"],
    "density_filter": ["DensityFilter", "HeavisideProjection"],
    "design": ["DensityDesign", "Design", "LevelSetDesign"],
    "design_loop": ["DesignLoop"],
    "domain": ["Domain", "Interface"],
    "dynamics": [
        "GeneralizedAlpha",
        "RadauIIA",
        "SimulationError",
        "SofteningWarning",
        "Trajectory",
        "simulate",
    ],
    "elasticity": ["Elasticity"],
    "elementwise": [
        "ElementGradient",
        "IntegralDerivatives",
        "elementwise_gradient",
        "integral_derivatives",
    ],
    "evolution": ["Evolution", "VelocityExtension", "VolumeBisection"],
    "flexible_body": ["FlexibleBody", "ReducedBody"],
    "forces": ["Force", "SpringDamper", "Torque", "TorsionalSpringDamper"],
    "gradient_elements": ["GradientElements"],
    "gradient_method": [
        "ElementByElement",
        "ExactAdjoint",
        "GradientErrors",
        "GradientMethod",
        "GradientReport",
        "gradient_errors",
    ],
    "io": ["CheckpointError", "read_history", "write_density", "write_fields", "write_summary"],
    "integrals": ["RoundOffWarning"],
    "joints": [
        "Distance",
        "Gear",
        "PointOnLine",
        "PrescribedAngle",
        "PrescribedPosition",
        "Revolute",
        "Translational",
        "Weld",
    ],
    "level_set_evolution": ["LevelSetEvolution"],
    "levelset": ["LevelSet"],
    "material": [
        "RAMP",
        "SIMP",
        "LinearMass",
        "PlaneStrain",
        "PlaneStress",
        "SuppressedVoidMass",
    ],
    "mechanical_problem": ["ConstraintValue", "MechanicalEvaluation", "MechanicalProblem"],
    "mechanism": ["Mechanism", "Placement", "PointMass", "RayleighDamping"],
    "mma": ["MMA"],
    "motion": ["Motion"],
    "objective": [
        "Constraint",
        "Frequency",
        "IntegralCompliance",
        "JointForce",
        "MarkerAcceleration",
        "Mass",
        "Objective",
        "PathTracking",
        "PeakCompliance",
        "Sum",
        "Volume",
    ],
    "optimization": ["Optimizer", "Result", "gray_fraction", "optimize"],
    "parametric_body": ["ParametricBody"],
    "points": ["Ground", "Moving"],
    "rbf": [
        "ExponentialSpline",
        "Gaussian",
        "Multiquadric",
        "RadialBasis",
        "ThinPlate",
        "Wendland",
    ],
    "reduction": ["ChordFrame", "CraigBampton", "TangentFrame"],
    "scattered": ["IllConditionedWarning", "ScatteredInterpolation", "best_length"],
    "scene_report": [
        "BodyReport",
        "ModeSelection",
        "ModelReport",
        "model_report",
        "modes_below",
        "select_modes",
    ],
    "sensitivity": ["Evaluation", "Problem"],
    "shape_sensitivity": ["ShapeDerivative", "Solver", "shape_derivatives"],
    "start": ["Assembled", "StaticEquilibrium"],
    "stress": ["StressEnvelope", "StressModes", "von_mises", "worst_stress"],
}

__all__ = sorted(name for names in _ROOMS.values() for name in names)

_HOME = {name: room for room, names in _ROOMS.items() for name in names}


def __getattr__(name: str) -> Any:
    """Load the module of a public name."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_HOME[name]}", __name__), name)
    # The import has made a module of the same name an attribute; the function takes its place.
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names."""
    return [*__all__, "__version__"]
