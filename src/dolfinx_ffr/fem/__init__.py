# SPDX-License-Identifier: MIT
"""Meshes with named interfaces, laws of the material, assembled matrices."""

from __future__ import annotations

from ..documentation import explain_fields
from ..surroundings import working_with_numpy

with working_with_numpy("petsc4py"):
    from petsc4py import PETSc  # noqa: F401

from ..arrays import Array as Array
from .circles import fit_circle as fit_circle
from .circles import fit_cylinder as fit_cylinder
from .circles import nearest_circle as nearest_circle
from .curves import Arc as Arc
from .curves import Curve as Curve
from .curves import Line as Line
from .curves import Spline as Spline
from .curves import enclosed as enclosed
from .curves import polygon as polygon
from .domain import Domain as Domain
from .elasticity import Block as Block
from .elasticity import CellFields as CellFields
from .elasticity import Elasticity as Elasticity
from .elasticity import Matrices as Matrices
from .elasticity import by_dense as by_dense
from .elasticity import dense_matrix as dense_matrix
from .elasticity import kept_by as kept_by
from .elasticity import rigid_fields as rigid_fields
from .elasticity import rotated as rotated
from .elasticity import summed as summed
from .gathered_mesh import GatheredMesh as GatheredMesh
from .gathered_mesh import surface_of as surface_of
from .interface import Interface as Interface
from .interface import surface_reference as surface_reference
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
from .material import cut_exponent as cut_exponent
from .mesh_checks import connected as connected
from .mesh_checks import floating_cells as floating_cells
from .nodes import MeshNodes as MeshNodes
from .nodes import add_ghosts as add_ghosts
from .nodes import gathered_nodes as gathered_nodes
from .nodes import laplace as laplace
from .outline import closed_outline as closed_outline
from .outline import read_outline as read_outline
from .plane_mesh import Drawing as Drawing
from .plane_mesh import Face as Face
from .plane_mesh import LocalSizes as LocalSizes
from .plane_mesh import check_size as check_size
from .plane_mesh import gmsh_model as gmsh_model
from .plane_mesh import mesh_faces as mesh_faces
from .plane_mesh import quiet as quiet
from .plane_mesh import surfaces as surfaces
from .stress_recovery import StressRecovery as StressRecovery
from .tetrahedra import DESIGNED as DESIGNED
from .tetrahedra import SOLID as SOLID
from .tetrahedra import VOID as VOID
from .tetrahedra import Tetrahedra as Tetrahedra

explain_fields(globals())
