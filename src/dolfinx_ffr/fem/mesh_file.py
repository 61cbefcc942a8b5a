# SPDX-License-Identifier: MIT
"""Meshes from gmsh, with the names of their physical groups."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from dolfinx import mesh
from numpy.typing import NDArray

from .. import validation
from ..arrays import Array, Integers
from ..limits import available_memory
from ..parallel import on_every_rank
from . import _compat
from .mesh_format import private_copy
from .plain_model import COMPLETE, is_plain, plain
from .plane_mesh import gmsh_model

#: Largest distance from the plane, relative to the size of a surface, that counts as round-off
FLAT = 1e-6

#: Program by which another process tries to read a file: if it crashes, or takes all memory, this
#: one does not
_TRIAL = """
import resource
import sys
sys.path.append(sys.argv[1])
import gmsh
gmsh.initialize(readConfigFiles=False)
gmsh.option.setNumber("General.Terminal", 0)
try:
    with open("/proc/self/statm") as file:
        held = int(file.read().split()[0]) * resource.getpagesize()
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    most = held + int(sys.argv[3])
    resource.setrlimit(resource.RLIMIT_AS, (most if hard < 0 else min(most, hard), hard))
except OSError:  # not every system tells how much a process holds
    pass
gmsh.merge(sys.argv[2])
gmsh.model.mesh.renumberNodes()
gmsh.model.mesh.getNodes()
"""
#: Time after which the other process is given up, beside a second for each megabyte [s]
_PATIENCE = 60.0
#: Beginnings of the environment variables that launchers of MPI set
_RANK = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI")
#: Curves, surfaces and volumes by their dimension
KINDS = ("point", "curve", "surface", "volume")
#: Numbers that gmsh gives to kinds of cells: triangles, quadrilaterals and tetrahedra of order 1, 2
#: and 3, hexahedra of order 1 and 2
CELLS_TAKEN = (2, 9, 21, 3, 10, 36, 4, 11, 29, 5, 12)

Groups = dict[tuple[int, str], int]


@dataclass(frozen=True)
class GroupedMesh:
    """A mesh with its physical groups: facets and cells by the names that they have in gmsh."""

    source: str  #: Name of the mesh in messages
    mesh: mesh.Mesh  #: Distributed over its communicator
    facets: dict[str, NDArray[np.int32]]  #: Facets of this rank by physical curve or surface
    cells: dict[str, NDArray[np.int32]]  #: Cells of this rank by physical surface or volume
    numbers: Groups  #: Number of each physical group by dimension and name

    def facets_of(self, argument: str, groups: Any) -> dict[str, NDArray[np.int32]]:
        """The facets of physical ``groups``, by names or numbers; the ``argument`` has them."""
        dim = self.mesh.topology.dim - 1
        return {name: self.facets[name] for name in self._checked(dim, argument, groups)}

    def cells_of(self, argument: str, groups: Any) -> NDArray[np.int32]:
        """The cells in physical ``groups``, by names or numbers; the ``argument`` has them."""
        names = self._checked(self.mesh.topology.dim, argument, groups)
        none = np.zeros(0, dtype=np.int32)
        return np.concatenate([none, *(self.cells[name] for name in names)])

    def _checked(self, dim: int, argument: str, groups: Any) -> list[str]:
        """The names of groups of a dimension that are given by names or numbers."""
        what = f"{self.source}: {argument}"
        if isinstance(groups, str):
            return validation.names(what, groups)  # a text alone is refused
        by_number = {number: name for (d, name), number in self.numbers.items() if d == dim}
        entries = validation.listed(what, groups, "a list of names or numbers of physical groups")
        names = validation.names(what, [_by_number(entry, by_number) for entry in entries])
        missing = [name for name in names if (dim, name) not in self.numbers]
        if missing:
            facet, cell = KINDS[self.mesh.topology.dim - 1 :][:2]
            raise ValueError(
                f"{self.source}: no physical {KINDS[dim]} named {', '.join(map(repr, missing))}; "
                f"it has the physical {facet}s {sorted(self.facets) or 'none'} and the physical "
                f"{cell}s {sorted(self.cells) or 'none'}. Name the groups in gmsh, or pass "
                f"{argument}=[...]"
            )
        return names


def _by_number(entry: Any, names: dict[int, str]) -> Any:
    """The name of a group that is given by its number; anything else as it is."""
    if isinstance(entry, int | np.integer) and not isinstance(entry, bool):
        return names.get(int(entry), str(entry))
    return entry


def read_gmsh(comm: MPI.Comm, path: Path) -> GroupedMesh:
    """Read a ``.msh`` file: a mesh in space if it has physical volumes, else in the plane."""
    with ExitStack() as stack:
        return _distribute(comm, lambda: _opened(path, stack), str(path))


def read_gmsh_model(comm: MPI.Comm, model: Any) -> GroupedMesh:
    """Take a mesh from gmsh's current model on rank 0, as `read_gmsh` does from a file."""
    return _distribute(comm, lambda: model, "gmsh model")


def _distribute(comm: MPI.Comm, get: Callable[[], Any], source: str) -> GroupedMesh:
    model: Any = None
    groups: Groups = {}
    with ExitStack() as stack:
        with on_every_rank(comm, "reading a mesh"):
            if comm.rank == 0:
                model = get()
                groups, used = _groups(model, source)
                if not is_plain(model, used):
                    model = stack.enter_context(plain(model, used))
        groups = comm.bcast(groups, root=0)
        dim = max(d for d, _ in groups)
        domain, cell_tags, facet_tags = _compat.gmsh_model_to_mesh(model, comm, 0, dim)
    facets, cells = (
        {
            name: tags.indices[tags.values == number]
            for (d, name), number in groups.items()
            if d == k
        }
        for k, tags in ((dim - 1, facet_tags), (dim, cell_tags))
    )
    return GroupedMesh(source, domain, facets, cells, groups)


def _opened(path: Path, stack: ExitStack) -> Any:
    """A model of gmsh with the mesh of a file, until the stack ends."""
    if not path.is_file():
        raise FileNotFoundError(f"mesh file {path} does not exist")
    gmsh = stack.enter_context(gmsh_model(f"reading {path} needs"))
    copy = stack.enter_context(private_copy(path))
    _try_to_read(copy, path, gmsh.__file__)
    try:
        gmsh.merge(str(copy))
        tags = gmsh.model.mesh.getNodes()[0]
        if len(tags) and np.max(tags) != len(tags):  # a mesh of DOLFINx has no gaps in them
            gmsh.model.mesh.renumberNodes()
    except Exception as exc:
        message = str(exc).replace(str(copy), str(path))
        raise ValueError(f"{path} is not a mesh that gmsh can read: {message}") from exc
    return gmsh.model


def _try_to_read(copy: Path, path: Path, module: str) -> None:
    """Refuse a file by which gmsh crashes or never ends: another process reads it first.

    That process reads the ``copy`` of the file at ``path``, which the message names.
    """
    patience = _PATIENCE + copy.stat().st_size / 1e6
    # the process is no rank of MPI, and must not take itself for one
    clean = {name: value for name, value in os.environ.items() if not name.startswith(_RANK)}
    arguments = [str(Path(module).parent), str(copy), str(available_memory())]
    # -I: modules in the working directory, where the mesh may have come with some, are not imported
    command = [sys.executable, "-I", "-c", _TRIAL, *arguments]
    fault = ""
    try:
        trial = subprocess.run(
            command,
            env=clean,
            cwd=copy.parent,
            stdin=subprocess.DEVNULL,
            timeout=patience,
            capture_output=True,
        )
        if trial.returncode < 0:
            fault = f"gmsh crashes (signal {-trial.returncode})"
        elif trial.returncode > 0:
            *_, last_line = trial.stderr.decode(errors="replace").splitlines() or [""]
            reason = last_line.partition(": ")[2].replace(str(copy), str(path))
            fault = reason or "it gives no reason"
    except subprocess.TimeoutExpired:
        fault = f"it is not done after {patience:.0f} s"
    if fault:
        raise ValueError(
            f"{path} is not a mesh that gmsh can read: {fault}; the file is damaged: write it again"
        )


def _groups(model: Any, source: str) -> tuple[Groups, Integers]:
    """The numbers of a model's physical groups, and the nodes of its cells; or refuse the model."""
    groups = _named_groups(model, source)
    names = {dim: sorted(name for d, name in groups if d == dim) for dim in (1, 2, 3)}
    dim = 3 if names[3] else 2
    facet, cell = KINDS[dim - 1 : dim + 1]
    if not names[dim - 1] or not names[dim]:
        raise ValueError(
            f"{source}: needs physical groups of {facet}s (interfaces) and of {cell}s (material); "
            f"it has the {facet}s {names[dim - 1] or 'none'} and the {cell}s {names[dim] or 'none'}"
        )
    for _, entity in model.getEntities(dim):
        tags = model.getPhysicalGroupsForEntity(dim, entity)
        if len(tags) > 1:
            several = sorted(_name(model, dim, tag) for tag in tags)
            raise ValueError(
                f"{source}: {cell} {entity} belongs to the physical {cell}s {several}, and "
                "its cells would count more than once; leave it in one of them"
            )
        if len(tags) and not len(model.mesh.getElementTypes(dim, entity)):
            raise ValueError(
                f"{source}: {cell} {entity} has no mesh; call gmsh.model.mesh.generate({dim}) first"
            )
    used = _checked_cells(model, dim, source)
    _check_facets(model, dim, source, used)
    return groups, used


def _named_groups(model: Any, source: str) -> Groups:
    """The numbers of the physical groups by dimension and name, which must be different names."""
    groups: Groups = {}
    for dim, tag in model.getPhysicalGroups():
        try:
            name = _name(model, dim, tag)
        except UnicodeDecodeError as error:
            raise ValueError(f"{source}: a physical group has a name that is no text") from error
        if (dim, name) in groups:
            raise ValueError(
                f"{source}: the physical {KINDS[dim]}s {groups[dim, name]} and {tag} are both "
                f"called {name!r} (one without a name is called by its number); give each a name "
                "of its own"
            )
        groups[dim, name] = int(tag)
    return groups


def _name(model: Any, dim: int, tag: int) -> str:
    """The name of a physical group, or its number where it has none."""
    return model.getPhysicalName(dim, tag) or str(tag)


def _parts(model: Any, dim: int) -> Iterator[tuple[int, str]]:
    """The entities in physical groups of a dimension, and the names of their groups."""
    for _, group in model.getPhysicalGroups(dim):
        for entity in model.getEntitiesForPhysicalGroup(dim, group):
            yield int(entity), _name(model, dim, group)


def _checked_cells(model: Any, dim: int, source: str) -> Integers:
    """The nodes of the cells; cells of several kinds, or of a damaged file, are refused."""
    kinds: dict[str, str] = {}
    nodes: dict[int, list[Integers]] = {}
    corners, sides = [], []
    for entity, name in _parts(model, dim):
        for kind, node_tags in zip(*model.mesh.getElements(dim, entity)[::2], strict=True):
            kind_name, _, order, count, _, vertices = model.mesh.getElementProperties(kind)
            if kind not in CELLS_TAKEN and kind not in COMPLETE:
                raise ValueError(
                    f"{source}: the cells of {name!r} are of the kind {kind_name}, of order "
                    f"{order}; taken are triangles, quadrilaterals and tetrahedra of order 1 to 3 "
                    "and hexahedra of order 1 and 2: mesh it with order 2 (Mesh.ElementOrder)"
                )
            kinds.setdefault(kind_name, name)
            cell_nodes = np.asarray(node_tags, dtype=np.int64)
            nodes.setdefault(entity, []).append(cell_nodes)
            corners.append(cell_nodes.reshape(-1, count)[:, :vertices])
            if dim == 2:
                side, width = model.mesh.getElementEdgeNodes(kind, entity, primary=True), 2
            else:
                width = 3 if vertices == 4 else 4
                side = model.mesh.getElementFaceNodes(kind, width, entity, primary=True)
            sides.append(np.asarray(side, dtype=np.int64).reshape(-1, width))
    if len(kinds) > 1:
        mixed = " and ".join(f"{kind} ({name!r})" for kind, name in sorted(kinds.items()))
        raise ValueError(
            f"{source}: the mesh mixes {mixed}; mesh all {KINDS[dim]}s with cells of one kind and "
            "order"
        )
    tags, positions, _ = model.mesh.getNodes()
    if not np.all(np.isfinite(positions)):
        raise ValueError(f"{source}: a node has no finite position; mesh it again")
    if not np.array_equal(np.sort(tags), np.arange(1, len(tags) + 1)):
        raise ValueError(
            f"{source}: the nodes are not numbered from 1 without gaps; call "
            "gmsh.model.mesh.renumberNodes() first"
        )
    if dim == 2:
        points = np.reshape(positions, (-1, 3))[np.argsort(tags)]
        for entity, nodes_by_kind in nodes.items():
            _check_plane(points[np.concatenate(nodes_by_kind) - 1], entity, source)
    cells = np.sort(np.concatenate(corners), axis=1)
    if np.any(cells[:, 1:] == cells[:, :-1]):
        raise ValueError(f"{source}: a cell has the same node twice; mesh it again")
    facets = np.sort(np.concatenate(sides), axis=1)
    facets = facets[np.lexsort(facets.T)]
    repeated = np.all(facets[1:] == facets[:-1], axis=1)
    if np.any(repeated[1:] & repeated[:-1]):
        raise ValueError(
            f"{source}: more than two cells share a side, so some lie on each other; mesh it again"
        )
    return np.unique(
        np.concatenate(
            [nodes_of_kind for of_entity in nodes.values() for nodes_of_kind in of_entity]
        )
    )


def _check_facets(model: Any, dim: int, source: str, nodes: Integers) -> None:
    """Refuse facets in physical groups that are no facets of cells, by the nodes of the cells."""
    facet, cell = KINDS[dim - 1 : dim + 1]
    for entity, name in _parts(model, dim - 1):
        for node_tags in model.mesh.getElements(dim - 1, entity)[2]:
            if not np.all(np.isin(node_tags, nodes)):
                raise ValueError(
                    f"{source}: {facet} {entity} of the physical {facet} {name!r} is no boundary "
                    f"of the physical {cell}s: a body is of {cell}s alone; leave it out, or join "
                    "it to them (fragment) before meshing"
                )


def _check_plane(points: Array, surface: int, source: str) -> None:
    """Refuse a surface that is not parallel to the x-y plane: its nodes would lose their z.

    The ``points`` are those of its cells, of shape (nodes, 3) [m].
    """
    extent = np.ptp(points, axis=0)
    if extent[2] > FLAT * max(extent):
        raise ValueError(
            f"{source}: surface {surface} leaves the x-y plane: its z spans {extent[2]:.4g} m; "
            "turn the part into the x-y plane; for a body in space mesh its volume, and make it a "
            "physical volume"
        )
