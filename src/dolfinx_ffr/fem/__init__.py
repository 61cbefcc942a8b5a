# SPDX-License-Identifier: MIT
"""Meshes with named interfaces, laws of the material, assembled matrices."""

from __future__ import annotations

from ..documentation import explain_fields
from ..surroundings import working_with_numpy

with working_with_numpy("petsc4py"):
    from petsc4py import PETSc  # noqa: F401

from .circles import fit_circle, fit_cylinder
from .curves import Arc, Array, Curve, Line, Spline, enclosed, polygon
from .domain import Domain
from .elasticity import (
    Block,
    Elasticity,
    Matrices,
    by_dense,
    dense_matrix,
    kept_by,
    rigid_fields,
    rotated,
    summed,
)
from .gathered_mesh import GatheredMesh, gathered_cells, surface_of
from .interface import Interface
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
from .nodes import MeshNodes, add_ghosts, gathered_nodes, laplace
from .outline import closed_outline, read_outline
from .plane_mesh import (
    Drawing,
    Face,
    LocalSizes,
    check_size,
    gmsh_model,
    mesh_faces,
    quiet,
    surfaces,
)
from .stress_recovery import StressRecovery
from .tetrahedra import DESIGNED, SOLID, VOID, Tetrahedra

__all__ = [
    "DESIGNED",
    "RAMP",
    "SIMP",
    "SOLID",
    "VOID",
    "Arc",
    "Array",
    "Block",
    "BoundMaterial",
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
    "LocalSizes",
    "Matrices",
    "MeshNodes",
    "PlaneStrain",
    "PlaneStress",
    "Spline",
    "StressRecovery",
    "SuppressedVoidMass",
    "Tetrahedra",
    "add_ghosts",
    "by_dense",
    "check_size",
    "closed_outline",
    "cut_exponent",
    "dense_matrix",
    "enclosed",
    "fit_circle",
    "fit_cylinder",
    "floating_cells",
    "gathered_cells",
    "gathered_nodes",
    "gmsh_model",
    "kept_by",
    "laplace",
    "mesh_faces",
    "polygon",
    "quiet",
    "read_outline",
    "rigid_fields",
    "rotated",
    "summed",
    "surface_of",
    "surfaces",
]

explain_fields(globals())
