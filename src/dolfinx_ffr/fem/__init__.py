# SPDX-License-Identifier: MIT
"""Meshes with named interfaces, laws of the material, assembled matrices."""

from __future__ import annotations

from ..surroundings import working_with_numpy

with working_with_numpy("petsc4py"):
    from petsc4py import PETSc

from ..arrays import Array as Array
from .curves import Arc, Curve, CurveError, Line, ShapeError, Spline, enclosed
from .curves import polygon as polygon
from .domain import Domain as Domain
from .drawing import Drawing, Face, outer_sides, ring
from .drawn_outline import FlatHole
from .elasticity import Block as Block
from .elasticity import (
    CellFields,
    FieldPairs,
    Matrices,
    by_dense,
    dense_matrix,
    kept_by,
    rigid_fields,
    rotated,
    summed,
)
from .elasticity import Elasticity as Elasticity
from .holes_in_space import SpatialHole
from .interface import Bore as Bore
from .interface import Box as Box
from .interface import Interface as Interface
from .interface import fit_circle, fit_cylinder, nearest_circle, surface_reference
from .material import PLATE, cut_exponent
from .material import RAMP as RAMP
from .material import SIMP as SIMP
from .material import BoundMaterial as BoundMaterial
from .material import ElasticMaterial as ElasticMaterial
from .material import Interpolation as Interpolation
from .material import Isotropic as Isotropic
from .material import LinearMass as LinearMass
from .material import PlaneStrain as PlaneStrain
from .material import PlaneStress as PlaneStress
from .material import SuppressedVoidMass as SuppressedVoidMass
from .mesh_checks import connected, floating_cells
from .nodes import MeshNodes, add_ghosts, gathered_nodes, laplace
from .outline import closed_outline, read_outline
from .plane_mesh import (
    LocalSizes,
    built_on_rank_0,
    check_size,
    gmsh_model,
    gmsh_options,
    mesh_faces,
    quiet,
    surfaces,
)
from .polylines import chord_lengths, cross, turns
from .stress_recovery import StressRecovery
from .tetrahedra import DESIGNED, SOLID, VOID, GatheredMesh, Tetrahedra, surface_of
