# SPDX-License-Identifier: MIT
"""Meshes with named interfaces, laws of the material, assembled matrices."""

from __future__ import annotations

from .domain import Domain, Interface
from .elasticity import Block, CellFields, Elasticity, Matrices, rigid_fields, rotated
from .lifetime import kept_by
from .material import (
    RAMP,
    SIMP,
    BoundMaterial,
    ElasticMaterial,
    Interpolation,
    LinearMass,
    PlaneStrain,
    PlaneStress,
    SuppressedVoidMass,
)
from .mesh_checks import floating_cells

__all__ = [
    "RAMP",
    "SIMP",
    "Block",
    "BoundMaterial",
    "CellFields",
    "Domain",
    "ElasticMaterial",
    "Elasticity",
    "Interface",
    "Interpolation",
    "LinearMass",
    "Matrices",
    "PlaneStrain",
    "PlaneStress",
    "SuppressedVoidMass",
    "floating_cells",
    "kept_by",
    "rigid_fields",
    "rotated",
]
