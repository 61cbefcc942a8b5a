# SPDX-License-Identifier: MIT
"""Design of the flexible parts of moving machines with FEniCSx.

The names below are loaded when they are first used, so that the mechanical half works where no
DOLFINx is installed.

Under MPI every function and method that takes a mesh, or an object that holds one, is collective:
all ranks of its communicator call it, in the same order. An error on one rank is raised on all of
them. Arrays with an entry for each cell or node are those of the rank, and all other results are
the same on every rank, unless a docstring says otherwise.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from .surroundings import needing_fenics, prepare

__version__ = "0.1.0"


def _lists(table: dict[str, str]) -> dict[str, list[str]]:
    """The words of each text."""
    return {folder: names.split() for folder, names in table.items()}


#: Where each public name lives: a folder, or a module beside the folders.
_FOLDERS = _lists(
    {
        "body": "BodyMarker ParametricBody VolumeIntegrals",
        "boundary": "Boundary",
        "design": (
            "DensityDesign DimensionDesign ExponentialSpline Gaussian LevelSet Mirror Multiquadric "
            "ThinPlate Variables Wendland density_field mirror_lines mirror_planes"
        ),
        "dynamics": (
            "GeneralizedAlpha LargeDeformationWarning RadauIIA SimulationError SofteningWarning "
            "TimeInterval TimeStepWarning simulate"
        ),
        "fem": "Domain Isotropic LinearMass PlaneStrain PlaneStress RAMP SIMP SuppressedVoidMass",
        "io": "CheckpointError read_history write_density write_fields write_summary",
        "lower_bound": "bound",
        "mechanical_problem": "MechanicalProblem",
        "mechanism": (
            "Assembled Bushing Cylindrical Distance Force Gear Ground LinearDrive Mechanism Motion "
            "Moving Parameters Placement PlacementWarning Planar PointMass PointOnLine "
            "PointOnPlane PrescribedAngle PrescribedPosition RayleighDamping Revolute Spherical "
            "SpringDamper StaticEquilibrium Torque TorsionalSpringDamper Translational Universal "
            "Weld"
        ),
        "objective": (
            "Combination Constraint Derivatives Frequency IntegralCompliance Inventory JointForce "
            "MarkerAcceleration MarkerVelocity Mass Objective PathTracking PeakCompliance "
            "PeakStress PowerMean Response Sum Volume WeightedSum WorstCase"
        ),
        "optimization": (
            "DesignWarning ExactAdjoint LevelSetEvolution MMA Result gray_fraction move_boundary "
            "optimize"
        ),
        "part": "Part PartWarning Solid Verification verify",
        "postprocessing": (
            "LocalModesWarning local_modes mode_error model_report propose_modes "
            "select_modes von_mises worst_stress"
        ),
        "problem": "Evaluation Problem",
        "reduction": "ChordFrame FlexibleBody RoundOffWarning TangentFrame",
        "report": "recorded_warnings run_record write_report",
    }
)

#: Names for specialists, by the folder through which they are reached: `dynamics.Trajectory`.
_BY_FOLDER = _lists(
    {
        "boundary": "Surface",
        "design": ("DensityFilter Design Evolution HeavisideProjection VelocityExtension"),
        "dynamics": "GearFlankWarning TiltedAxisWarning Trajectory",
        "fem": "Bore Box ElasticMaterial Elasticity Interface",
        "interchange": (
            "AssembledMatrices Format InterchangeWarning read_abaqus read_body read_calculix "
            "read_nastran read_terms sid_terms write_body"
        ),
        "lower_bound": "LowerBound",
        "mechanical_problem": "ConstraintValue Gradients MechanicalEvaluation",
        "mechanism": "AngleCoupling Parameter ParametricMechanism",
        "objective": (
            "DensityField DrivePower DriveWork ResidualVibration StressField marker_derivatives"
        ),
        "optimization": (
            "BoundaryResult DesignLoop GradientErrors GradientMethod GradientReport Optimizer"
        ),
        "part": "Enclosed LoosePiece Width",
        "paper": (
            "ApproximateGradient ElementGradient GradientElements IllConditionedWarning "
            "IntegralDerivatives ModeDerivative ScatteredInterpolation Solver best_length "
            "elementwise_gradient gradient_errors integral_derivatives mode_derivatives"
        ),
        "postprocessing": (
            "BodyReport LocalModes ModeSelection ModelReport StressEnvelope StressModes"
        ),
        "problem": "LoadCaseEvaluation",
        "reduction": "CraigBampton ReducedBody reduce_matrices",
    }
)

__all__ = sorted(name for names in _FOLDERS.values() for name in names)

#: Folders that are used by their names.
_ROOMS = frozenset({*_FOLDERS, *_BY_FOLDER, "plotting", "verification"})

_HOME = {name: folder for folder, names in _FOLDERS.items() for name in names}

prepare()


def __getattr__(name: str) -> Any:
    """Load the module of a public name, or a folder."""
    if name not in _HOME and name not in _ROOMS:
        places = [folder for folder, names in _BY_FOLDER.items() if name in names]
        hint = f"; it is {__name__}.{places[0]}.{name}" if places else ""
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{hint}")
    with needing_fenics(f"{__name__}.{name}"):
        module = import_module(f".{_HOME.get(name, name)}", __name__)
    if name in _HOME:
        # A module of the same name may have become an attribute; the function takes its place.
        globals()[name] = getattr(module, name)
    return globals()[name]


def __dir__() -> list[str]:
    return [*__all__, *sorted(_ROOMS), "__version__"]
