# SPDX-License-Identifier: MIT
"""The classes and constructors that a table of a scene file can name by its ``kind``."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from .. import design, dynamics, fem, mechanism, objective, optimization, reduction
from ..body import BodyMarker, VolumeIntegrals

#: By the name of the class that an argument needs. A new joint, force, objective or design is
#: entered here.
KINDS: dict[str, tuple[Callable[..., Any], ...]] = {
    # bodies
    "FlexibleBody": (reduction.FlexibleBody,),
    "VolumeIntegrals": (
        VolumeIntegrals,
        VolumeIntegrals.in_space,
        VolumeIntegrals.rigid,
        VolumeIntegrals.from_arrays,
        VolumeIntegrals.load,
    ),
    "BodyMarker": (BodyMarker, BodyMarker.of_rigid_body),
    "Domain": (
        fem.Domain.rectangle,
        fem.Domain.box,
        fem.Domain.from_gmsh,
        fem.Domain.from_outline,
    ),
    "Bore": (fem.Bore,),
    "Box": (fem.Box,),
    "ElasticMaterial": (fem.PlaneStress, fem.PlaneStrain, fem.Isotropic),
    "Interpolation": (fem.SIMP, fem.RAMP),
    "MassLaw": (fem.LinearMass, fem.SuppressedVoidMass),
    "Frame": (reduction.TangentFrame, reduction.ChordFrame),
    # mechanism
    "Mechanism": (mechanism.Mechanism,),
    "Placement": (mechanism.Placement,),
    "Ground": (mechanism.Ground,),
    "Moving": (mechanism.Moving, mechanism.Moving.circle),
    "Motion": (
        mechanism.Motion.constant,
        mechanism.Motion.polynomial,
        mechanism.Motion.smooth_step,
        mechanism.Motion.fourier,
        mechanism.Motion.spline,
        mechanism.Motion.from_table,
    ),
    "Joint": (
        mechanism.Revolute,
        mechanism.Weld,
        mechanism.Translational,
        mechanism.PointOnLine,
        mechanism.PointOnPlane,
        mechanism.Distance,
        mechanism.Gear,
        mechanism.AngleCoupling,
        mechanism.Spherical,
        mechanism.Universal,
        mechanism.Cylindrical,
        mechanism.Planar,
        mechanism.PrescribedAngle,
        mechanism.PrescribedPosition,
        mechanism.LinearDrive,
    ),
    "AppliedForce": (
        mechanism.Force,
        mechanism.Torque,
        mechanism.SpringDamper,
        mechanism.TorsionalSpringDamper,
        mechanism.Bushing,
    ),
    "PointMass": (mechanism.PointMass,),
    "RayleighDamping": (mechanism.RayleighDamping,),
    "Start": (mechanism.Assembled, mechanism.StaticEquilibrium),
    "Parameters": (mechanism.Parameters,),
    # problem
    "Integrator": (dynamics.GeneralizedAlpha, dynamics.RadauIIA),
    "TimeInterval": (dynamics.TimeInterval,),
    "Objective": (
        objective.IntegralCompliance,
        objective.PeakCompliance,
        objective.DriveWork,
        objective.DrivePower,
        objective.JointForce,
        objective.PathTracking,
        objective.MarkerVelocity,
        objective.MarkerAcceleration,
        objective.ResidualVibration,
        objective.Mass,
        objective.Volume,
        objective.Frequency,
        objective.PeakStress,
        objective.Sum,
    ),
    "Constraint": (objective.Constraint,),
    "Combination": (objective.WeightedSum, objective.PowerMean, objective.WorstCase),
    # design
    "Variables": (design.LevelSet, design.DensityDesign),
    "Mirror": (design.Mirror,),
    "Optimizer": (optimization.MMA, optimization.LevelSetEvolution),
    "GradientMethod": (optimization.ExactAdjoint,),
}
MOTIONS = KINDS["Motion"]


def kinds_of(types: Iterable[Any]) -> dict[str, Callable[..., Any]]:
    """The kinds of table by name that give an argument one of some types."""
    names = [getattr(kind, "__name__", "") for kind in types]
    return {kind.__name__: kind for name in names for kind in KINDS.get(name, ())}
