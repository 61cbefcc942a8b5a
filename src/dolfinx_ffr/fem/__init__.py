# SPDX-License-Identifier: MIT
"""Meshes with named interfaces, laws of the material, assembled matrices."""

from __future__ import annotations

from .circles import fit_circle, fit_cylinder
from .curves import Arc, Curve, Line, Spline, enclosed, polygon
from .domain import Domain
from .elasticity import Block, CellFields, Elasticity, Matrices, rigid_fields, rotated
from .gathered_mesh import GatheredMesh, gathered_cells, surface_of
from .interface import Interface
from .lifetime import kept_by
from .material import (
    RAMP,
    SIMP,
    BoundMaterial,
    ElasticMaterial,
    Interpolation,
    Isotropic,
    LinearMass,
    PlaneStrain,
    PlaneStress,
    SuppressedVoidMass,
    cut_exponent,
)
from .mesh_checks import floating_cells
from .plane_mesh import Drawing, Face, gmsh_model, mesh_faces, quiet, surfaces
from .stress_recovery import StressRecovery
from .tetrahedra import DESIGNED, SOLID, VOID, Tetrahedra

__all__ = [
    "DESIGNED",
    "RAMP",
    "SIMP",
    "SOLID",
    "VOID",
    "Arc",
    "Block",
    "BoundMaterial",
    "CellFields",
    "Curve",
    "Domain",
    "Drawing",
    "ElasticMaterial",
    "Elasticity",
    "Face",
    "GatheredMesh",
    "Interface",
    "Interpolation",
    "Isotropic",
    "Line",
    "LinearMass",
    "Matrices",
    "PlaneStrain",
    "PlaneStress",
    "Spline",
    "StressRecovery",
    "SuppressedVoidMass",
    "Tetrahedra",
    "cut_exponent",
    "enclosed",
    "fit_circle",
    "fit_cylinder",
    "floating_cells",
    "gathered_cells",
    "gmsh_model",
    "kept_by",
    "mesh_faces",
    "polygon",
    "quiet",
    "rigid_fields",
    "rotated",
    "surface_of",
    "surfaces",
]
