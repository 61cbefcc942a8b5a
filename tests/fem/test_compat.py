# SPDX-License-Identifier: MIT
"""What DOLFINx and UFL name differently from release to release stands in `_compat` only."""

from __future__ import annotations

import functools
import io
import re
import tokenize
from pathlib import Path
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
from shared import TOP

import dolfinx_ffr
from dolfinx_ffr.fem import _compat

PACKAGE = Path(dolfinx_ffr.__file__).parent
#: Programs that may not ask either; each of them runs on every release.
PROGRAMS = [
    path
    for folder in (PACKAGE, TOP / "tests", TOP / "demos", TOP / "benchmarks")
    for path in sorted(folder.rglob("*.py"))
    if path not in (PACKAGE / "fem" / "_compat.py", Path(__file__))
]
#: Each name or call that has changed, as it would stand in a program.
CHANGED = {
    r"(?<!_compat)\.cellname\b": "kind = domain.ufl_cell().cellname()",
    r"\bfunctionspace\(": "space = fem.functionspace(domain, ('DG', 0))",
    r"\b(Vector)?FunctionSpace\(": "space = fem.FunctionSpace(domain, ('DG', 0))",
    r"\bufl\.(Finite|Vector|Tensor|Mixed)Element\b": "ufl.VectorElement('CG', cell, 1)",
    r"\bbasix\.ufl\b": "basix.ufl.element('Lagrange', 'triangle', 1)",
    r"\.vector\b": "x = u.vector",
    r"\.petsc_vec\b": "x = u.x.petsc_vec",
    r"\bgmshio\b|\bio\.gmsh\b|\bio import gmsh\b": "from dolfinx.io import gmshio",
    r"\b(create_)?vtk_mesh\b": "plot.create_vtk_mesh(domain)",
    r"\b(jit|form_compiler)_params\b": "fem.form(a, jit_params={})",
    r"\bform_compiler_options\b": "fem.form(a, form_compiler_options={})",
    r"DEFAULT_JIT_(OPTIONS|PARAMETERS)\b": "jit.DOLFINX_DEFAULT_JIT_OPTIONS",
    r"(?<!_compat)\.interpolation_points\b": "x = V.element.interpolation_points()",
    r"\bdofmap\.list\b": "cells = V.dofmap.list",
    r"\bgeometry\.dofmaps?\b": "nodes = domain.geometry.dofmap",
    r"\bgeometry\.cmaps?\b": "element = domain.geometry.cmap",
    r"\bfem\.Expression\(|(?<!_compat)\bExpression\(": "fem.Expression(f, points)",
    r"(?<!_compat)\b(fem|petsc)\.create_vector\(": "b = petsc.create_vector(form)",
    r"\bassemble_matrix\([^)]*\bdiag(onal)?=": "petsc.assemble_matrix(a, bcs, diagonal=0.0)",
    r"\b(apply_lifting|set_bc)\([^)]*\b(scale|alpha)=": "set_bc(b, bcs, x0, scale=-1.0)",
    r"\b(assemble|create)_(matrix|vector)_(block|nest)\b": "A = petsc.assemble_matrix_block(a)",
    r"\b(num_)?entity_closure_dofs\b": "layout.num_entity_closure_dofs(1)",
    r"\bmesh\.create_mesh\(": "mesh.create_mesh(comm, cells, x, domain)",
    r"\bcreate_submesh\(": "mesh.create_submesh(domain, 1, facets)",
    r"\bla\.(Scatter|Insert)Mode\b": "la.ScatterMode.reverse",
    r"\bLinearProblem\(": "petsc.LinearProblem(a, L)",
}


def code(text: str) -> str:
    """A program without strings, comments and most of its spaces."""
    lines = [
        token.string
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type not in (tokenize.STRING, tokenize.COMMENT, tokenize.INDENT, tokenize.DEDENT)
    ]
    return re.sub(r" ?([.()=,]) ?", r"\1", " ".join(lines))


@functools.cache
def programs() -> dict[str, str]:
    """The code of each program, read once for all names."""
    return {str(path.relative_to(TOP)): code(path.read_text()) for path in PROGRAMS}


@pytest.mark.parametrize(("pattern", "example"), CHANGED.items(), ids=CHANGED.values())
def test_changing_names_stand_in_compat_only(pattern: str, example: str) -> None:
    assert re.search(pattern, code(example)), "the pattern does not find what it is for"
    assert not [name for name, program in programs().items() if re.search(pattern, program)]


@pytest.mark.parametrize("cellname", ["triangle", lambda: "triangle"], ids=["property", "method"])
def test_cell_name_of_either_spelling(cellname: object) -> None:
    domain = SimpleNamespace(ufl_cell=lambda: SimpleNamespace(cellname=cellname))
    assert _compat.cell_name(domain) == "triangle"


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_geometry_is_that_of_the_cells(cell: str) -> None:
    """Nodes, vertices and dofs of one cell in the unit square, whichever way they are stored."""
    nodes = {"triangle": 3, "quadrilateral": 4}[cell]
    x = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])[:nodes]
    domain = _compat.create_mesh(
        MPI.COMM_SELF, np.arange(nodes, dtype=np.int64)[None, :], x, cell, 1
    )
    assert _compat.cell_name(domain) == cell
    assert _compat.cell_geometry(domain).shape == (1, nodes)
    assert _compat.entity_vertices(domain, 2).shape == (1, nodes)
    assert _compat.entity_vertices(domain, 1).shape == (nodes, 2)
    assert _compat.coordinate_element(domain).degree == 1
    space = _compat.function_space(domain, "Lagrange", 2, (2,))
    assert _compat.dofmap_array(space).shape == (1, {3: 6, 4: 9}[nodes])


@pytest.mark.mpi
def test_densities_are_numbered_as_cells(comm: MPI.Intracomm) -> None:
    """Ghosts included: a field of one density a cell needs no map."""
    domain = dolfinx_ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(12, 3))
    cells = domain.mesh.topology.index_map(2)
    dofs = _compat.dofmap_array(domain.density_space).ravel()
    assert np.array_equal(dofs, np.arange(cells.size_local + cells.num_ghosts))
