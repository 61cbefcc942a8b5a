# SPDX-License-Identifier: MIT
"""Differences between DOLFINx releases, in one place.

The package is written in the current DOLFINx spelling, and an older one is known here alone.
Releases are told apart by the names that they have, never by version number, so that dropping a
release means deleting lines.
"""

from __future__ import annotations

import platform
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import dolfinx.fem.petsc  # noqa: F401  (a release may not load it by itself)
import numpy as np
import ufl
from dolfinx import fem, mesh
from numpy.typing import NDArray

from ..arrays import Array, Integers


def function_space(domain: mesh.Mesh, family: str, degree: int, shape: tuple[int, ...] = ()) -> Any:
    """The Lagrange or DG space of scalars (``shape=()``) or vectors."""
    if hasattr(fem, "functionspace"):
        element = (family, degree, shape) if shape else (family, degree)
        return fem.functionspace(domain, element)
    name = {"Lagrange": "CG"}.get(family, family)
    if name == "DG" and degree > 0 and cell_name(domain) in ("quadrilateral", "hexahedron"):
        name = "DQ"
    if not shape:
        return fem.FunctionSpace(domain, (name, degree))
    return fem.VectorFunctionSpace(domain, (name, degree), dim=shape[0])


def interpolation_points(space: Any) -> Array:
    """The reference points of an element's interpolation operator."""
    points = space.element.interpolation_points
    return points() if callable(points) else points


def coordinate_space(domain: mesh.Mesh) -> Any:
    """The space to which the positions of the mesh belong."""
    element = domain.ufl_domain().ufl_coordinate_element()
    make_space = getattr(fem, "functionspace", None) or fem.FunctionSpace
    return make_space(domain, element)


def quadrature_space(domain: mesh.Mesh, degree: int) -> Any:
    """Numbers at the points of the rule of a degree."""
    try:
        import basix.ufl

        element = basix.ufl.quadrature_element(cell_name(domain), degree=degree)
    except ImportError:
        element = ufl.FiniteElement("Quadrature", domain.ufl_cell(), degree, quad_scheme="default")
    make_space = getattr(fem, "functionspace", None) or fem.FunctionSpace
    return make_space(domain, element)


def geometry_element(domain: mesh.Mesh) -> Any:
    """Basix's element of the shape functions by which the mesh has its positions."""
    import basix

    element = coordinate_element(domain)
    variant = basix.LagrangeVariant(int(getattr(element, "variant", 0)))
    if variant == basix.LagrangeVariant.unset:
        variant = basix.LagrangeVariant.equispaced
    kind = getattr(basix.CellType, cell_name(domain))
    return basix.create_element(basix.ElementFamily.P, kind, element.degree, variant)


def cell_name(domain: mesh.Mesh) -> str:
    """The name of the mesh's cells, ``"triangle"``, ``"hexahedron"`` and so on."""
    name = domain.ufl_cell().cellname
    return name() if callable(name) else name


def petsc_vector(function: fem.Function) -> PETSc.Vec:
    """The PETSc vector that shares memory with ``function``."""
    if hasattr(function.x, "petsc_vec"):
        return function.x.petsc_vec
    return function.vector


def _as_table(adjacency: Any) -> NDArray[np.int32]:
    """A regular adjacency list as a table."""
    if isinstance(adjacency, np.ndarray):
        return adjacency
    array = np.asarray(adjacency.array)  # a rank may hold no cells
    return array.reshape(adjacency.num_nodes, len(array) // max(adjacency.num_nodes, 1))


def dofmap_array(space: Any) -> NDArray[np.int32]:
    """The (blocked) dofs of each local cell, shape (cells, dofs per cell)."""
    return _as_table(space.dofmap.list)


def cell_geometry(domain: mesh.Mesh) -> NDArray[np.int32]:
    """The geometry nodes of each local cell, shape (cells, nodes per cell)."""
    geometry = domain.geometry
    if hasattr(geometry, "dofmaps") and not callable(geometry.dofmaps):
        return _as_table(geometry.dofmaps[0])
    return _as_table(geometry.dofmap)


def coordinate_element(domain: mesh.Mesh) -> Any:
    """The element that maps the reference cell to physical cells."""
    geometry = domain.geometry
    if hasattr(geometry, "cmaps"):
        return geometry.cmaps[0]
    return geometry.cmap


def compiled_expression(
    expression: ufl.core.expr.Expr, points: Array, domain: mesh.Mesh
) -> Callable[[NDArray[np.int32]], Array]:
    """A UFL expression at reference points, a function of cells to (cells, points, components)."""
    compiled = fem.Expression(expression, points)
    components = int(np.prod(expression.ufl_shape))

    def evaluate(cells: NDArray[np.int32]) -> Array:
        try:
            values = compiled.eval(domain, cells)
        except TypeError:  # before 0.7 the mesh was not an argument
            values = compiled.eval(cells)
        return np.asarray(values).reshape(len(cells), len(points), components)

    return evaluate


def entity_vertices(domain: mesh.Mesh, dim: int) -> NDArray[np.int32]:
    """The vertices of each local entity of dimension ``dim``, one row each."""
    domain.topology.create_entities(dim)
    domain.topology.create_connectivity(dim, 0)
    return _as_table(domain.topology.connectivity(dim, 0))


def gmsh_order(cell: str, nodes: int) -> list[int]:
    """Where the nodes of DOLFINx's cell stand among those of gmsh's."""
    from dolfinx.cpp.io import perm_gmsh

    return list(perm_gmsh(getattr(mesh.CellType, cell), nodes))


def set_form_cache(directory: Path) -> None:
    """Make DOLFINx compile fast forms from now on, and keep them in ``directory``."""
    import dolfinx.jit as jit

    # named ..._PARAMETERS before 0.6
    names = ("DOLFINX_DEFAULT_JIT_OPTIONS", "DOLFINX_DEFAULT_JIT_PARAMETERS")
    defaults = next(getattr(jit, name) for name in names if hasattr(jit, name))
    defaults["cache_dir"] = (directory, defaults["cache_dir"][1])
    flags, meaning = defaults["cffi_extra_compile_args"]
    flags = [flag for flag in flags if flag not in _for_this_processor()]
    defaults["cffi_extra_compile_args"] = [*flags, *_for_this_processor()], meaning


@cache
def _for_this_processor() -> list[str]:
    """Flags for faster forms with the same bits, which name the processor for shared caches."""
    described = Path("/proc/cpuinfo")
    if platform.machine() != "x86_64" or not described.exists():
        return ["-O3"]
    first_processor, *_ = described.read_text().split("\n\n")
    lines = [line for line in first_processor.splitlines() if line.startswith(("model", "flags"))]
    name = sha256("\n".join(lines).encode()).hexdigest()[:16]
    # without fused products, whose rounding breaks the symmetries of meshes
    return ["-O3", "-march=native", "-ffp-contract=off", f"-DPROCESSOR_{name}"]


def create_mesh(comm: MPI.Comm, cells: Integers, x: Array, cell: str, degree: int) -> mesh.Mesh:
    """A mesh of cells (cells, nodes per cell) in DOLFINx's order and positions (nodes, d) [m]."""
    import inspect

    try:
        import basix.ufl

        equispaced = basix.LagrangeVariant.equispaced
        element = basix.ufl.element("P", cell, degree, equispaced, shape=(x.shape[1],))
    except ImportError:
        shape = ufl.Cell(cell, geometric_dimension=x.shape[1])
        scalar = ufl.FiniteElement("Lagrange", shape, degree, variant="equispaced")
        element = ufl.VectorElement(scalar)
    names = list(inspect.signature(mesh.create_mesh).parameters)
    arguments = {names[0]: comm, "cells": cells, "x": x}
    name_of_element = next(n for n in names[1:] if n not in arguments)  # "domain" or "e"
    arguments[name_of_element] = ufl.Mesh(element) if name_of_element == "domain" else element
    return mesh.create_mesh(**arguments)
