# SPDX-License-Identifier: MIT
"""Meshes from gmsh, with the names of their physical groups."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from dolfinx import mesh

from ..parallel import on_every_rank
from . import _compat

__all__ = ["TaggedMesh", "read_gmsh", "read_gmsh_model"]

#: Largest distance from the plane, relative to the size of a surface, that counts as round-off
FLAT = 1e-6

Groups = dict[tuple[int, str], int]


@dataclass(frozen=True)
class TaggedMesh:
    """A mesh with its physical groups."""

    source: str  #: What error messages call it
    mesh: mesh.Mesh  #: Distributed over its communicator
    cell_tags: Any  #: Number of the physical surface, in space volume, of each cell
    facet_tags: Any  #: Number of the physical curve, in space surface, of each facet
    numbers: Groups  #: Number of each physical group by dimension and name

    def groups(self, dim: int) -> dict[str, int]:
        """The numbers of the physical curves (``dim`` 1), surfaces (2), volumes (3) by name."""
        return {name: tag for (d, name), tag in self.numbers.items() if d == dim}


def read_gmsh(comm: MPI.Comm, path: Path) -> TaggedMesh:
    """Read a mesh from a file: one in space, if it has physical volumes, or one in the plane.

    Args:
        comm: Communicator over which the mesh is distributed; rank 0 reads the file.
        path: The ``.msh`` file.

    Raises:
        FileNotFoundError: On every rank, if there is no such file.
        ValueError: On every rank, if gmsh cannot read it, it has no named physical groups, or a
            cell belongs to several of them.
    """
    gmsh = None

    def open_() -> Any:
        nonlocal gmsh
        gmsh = _open_gmsh(path)
        return gmsh.model

    try:
        return _distribute(comm, open_, str(path))
    finally:
        if gmsh is not None:
            gmsh.finalize()


def read_gmsh_model(comm: MPI.Comm, model: Any) -> TaggedMesh:
    """Take a mesh from gmsh's current model, as `read_gmsh` does from a file.

    Args:
        comm: Communicator over which the mesh is distributed.
        model: ``gmsh.model`` on rank 0; not used on the others.

    Raises:
        ValueError: On every rank, if the model has no mesh or no named physical groups, or a
            cell belongs to several of them.
    """
    return _distribute(comm, lambda: model, "gmsh model")


def _distribute(comm: MPI.Comm, get: Callable[[], Any], source: str) -> TaggedMesh:
    model, groups = None, {}
    with on_every_rank(comm, "reading a mesh"):
        if comm.rank == 0:
            model = get()
            groups = _groups(model, source)
    groups = comm.bcast(groups, root=0)
    dim = max(d for d, _ in groups)
    domain, cell_tags, facet_tags = _compat.gmsh_model_to_mesh(model, comm, 0, dim)
    return TaggedMesh(source, domain, cell_tags, facet_tags, groups)


def _open_gmsh(path: Path) -> Any:
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
    return gmsh


def _groups(model: Any, source: str) -> Groups:
    """The numbers of a model's physical groups, or refuse the model."""
    groups = {(dim, model.getPhysicalName(dim, tag)): tag for dim, tag in model.getPhysicalGroups()}
    names = {dim: [name for d, name in groups if d == dim] for dim in (1, 2, 3)}
    dim = 3 if names[3] else 2
    facets, cells = (("curve", "surface"), ("surface", "volume"))[dim - 2]
    if not names[dim - 1] or not names[dim]:
        raise ValueError(
            f"{source}: needs physical groups of {facets}s (interfaces) and of {cells}s "
            f"(material); it has the {facets}s {sorted(names[dim - 1]) or 'none'} and the {cells}s "
            f"{sorted(names[dim]) or 'none'}"
        )
    for _, part in model.getEntities(dim):
        of = [
            model.getPhysicalName(dim, tag) for tag in model.getPhysicalGroupsForEntity(dim, part)
        ]
        if len(of) > 1:
            raise ValueError(
                f"{source}: {cells} {part} belongs to the physical {cells}s {sorted(of)}, and "
                "its cells would count more than once; leave it in one of them"
            )
        if of and not len(model.mesh.getElementTypes(dim, part)):
            raise ValueError(
                f"{source}: {cells} {part} has no mesh; call gmsh.model.mesh.generate({dim}) first"
            )
        if of and dim == 2:
            _check_plane(model, part, source)
    _check_kinds(model, dim, source)
    return groups


def _check_kinds(model: Any, dim: int, source: str) -> None:
    """Refuse cells of several kinds, and facets that are not those of cells."""
    facets, cells = (("curve", "surface"), ("surface", "volume"))[dim - 2]

    def parts(d: int, group: int) -> list[int]:
        return [int(part) for part in model.getEntitiesForPhysicalGroup(d, group)]

    kinds: dict[str, str] = {}
    nodes = [np.zeros(0, dtype=np.uint64)]
    for _, group in model.getPhysicalGroups(dim):
        for part in parts(dim, group):
            types, _, found = model.mesh.getElements(dim, part)
            nodes += [np.asarray(some, dtype=np.uint64) for some in found]
            for kind in types:
                what = model.mesh.getElementProperties(kind)[0]
                kinds.setdefault(what, model.getPhysicalName(dim, group))
    if len(kinds) > 1:
        mixed = " and ".join(f"{kind} ({name!r})" for kind, name in sorted(kinds.items()))
        raise ValueError(
            f"{source}: the mesh mixes {mixed}; mesh all {cells}s with cells of one kind and order"
        )
    own = np.unique(np.concatenate(nodes))
    for _, group in model.getPhysicalGroups(dim - 1):
        for part in parts(dim - 1, group):
            for some in model.mesh.getElements(dim - 1, part)[2]:
                if not np.all(np.isin(some, own)):
                    raise ValueError(
                        f"{source}: {facets} {part} of the physical {facets} "
                        f"{model.getPhysicalName(dim - 1, group)!r} is no boundary of the physical "
                        f"{cells}s: a body is of {cells}s alone; leave it out, or join it to them "
                        "(fragment) before meshing"
                    )


def _check_plane(model: Any, surface: int, source: str) -> None:
    """Refuse a surface that is not parallel to the x-y plane: its nodes lose their z."""
    coordinates = model.mesh.getNodes(2, surface, includeBoundary=True)[1]
    extent = np.ptp(np.reshape(coordinates, (-1, 3)), axis=0)
    if extent[2] > FLAT * max(extent):
        raise ValueError(
            f"{source}: surface {surface} leaves the x-y plane: its z spans {extent[2]:.4g} m; "
            "turn the part into the x-y plane; for a body in space mesh its volume, and make it a "
            "physical volume"
        )
