# SPDX-License-Identifier: MIT
"""Meshes from gmsh files, with the names of their physical groups."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

from dolfinx import mesh

from . import _compat

__all__ = ["read_gmsh"]


def read_gmsh(comm: MPI.Comm, path: Path) -> tuple[mesh.Mesh, Any, Any, dict[tuple[int, str], int]]:
    """Read a planar mesh with its tags and physical groups.

    Args:
        comm: communicator over which the mesh is distributed; rank 0 reads the file.
        path: the ``.msh`` file.

    Returns:
        Mesh, cell tags, facet tags, and the tag of each physical group by dimension and name.

    Raises:
        FileNotFoundError: on every rank, if there is no such file.
        ValueError: on every rank, if gmsh cannot read it or it has no named physical groups.
    """
    error: Exception | None = None
    groups: dict[tuple[int, str], int] = {}
    gmsh = None
    if comm.rank == 0:
        try:
            groups, gmsh = _open_gmsh(path)
        except (OSError, ValueError, ImportError) as exc:
            error = exc
    error = comm.bcast(error, root=0)
    if error is not None:
        raise error
    groups = comm.bcast(groups, root=0)
    try:
        model = gmsh.model if gmsh is not None else None
        domain, cell_tags, facet_tags = _compat.gmsh_model_to_mesh(model, comm, 0)
    finally:
        if gmsh is not None:
            gmsh.finalize()
    return domain, cell_tags, facet_tags, groups


def _open_gmsh(path: Path) -> tuple[dict[tuple[int, str], int], Any]:
    if not path.is_file():
        raise FileNotFoundError(f"mesh file {path} does not exist")
    try:
        import gmsh
    except ImportError as exc:
        raise ImportError(
            f"reading {path} needs gmsh's Python module (Debian: python3-gmsh)"
        ) from exc
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
    except Exception as exc:
        gmsh.finalize()
        raise ValueError(f"{path} is not a mesh that gmsh can read: {exc}") from exc
    groups = {
        (dim, gmsh.model.getPhysicalName(dim, tag)): tag
        for dim, tag in gmsh.model.getPhysicalGroups()
    }
    names = {dim: [name for d, name in groups if d == dim] for dim in (1, 2)}
    if not names[1] or not names[2]:
        gmsh.finalize()
        raise ValueError(
            f"{path}: needs physical groups of curves (interfaces) and of surfaces (material); "
            f"it has the curves "
            f"{sorted(names[1]) or 'none'} and the surfaces {sorted(names[2]) or 'none'}"
        )
    return groups, gmsh
