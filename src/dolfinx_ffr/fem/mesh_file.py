# SPDX-License-Identifier: MIT
"""Meshes from gmsh, with the names of their physical groups."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from dolfinx import mesh
from numpy.typing import NDArray

from .. import validation
from ..limits import available_memory
from ..parallel import on_every_rank
from .gmsh_arrays import KINDS, Groups, arrays_of_model
from .mesh_arrays import MeshArrays, distribute
from .mesh_format import private_copy
from .plane_mesh import gmsh_model

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
gmsh.model.mesh.getNodes()
"""
#: Time after which the other process is given up, beside a second for each megabyte [s]
_PATIENCE = 60.0
#: Memory that it may take at most, and more for each byte of the file [bytes]: gmsh takes some
#: three for a byte of a mesh, and any number for a file that promises more nodes than it holds
_MEMORY, _MEMORY_OF_BYTE = 10**9, 100
#: Beginnings of the environment variables that launchers of MPI set
_RANK = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI")


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
        return _distributed(comm, lambda: _opened(path, stack), str(path))


def read_gmsh_model(comm: MPI.Comm, model: Any) -> GroupedMesh:
    """Take a mesh from gmsh's current model on rank 0, as `read_gmsh` does from a file."""
    return _distributed(comm, lambda: model, "gmsh model")


def _distributed(comm: MPI.Comm, open_model: Callable[[], Any], source: str) -> GroupedMesh:
    arrays: MeshArrays | None = None
    groups: Groups = {}
    with on_every_rank(comm, "reading a mesh"):
        if comm.rank == 0:
            arrays, groups = arrays_of_model(open_model(), source)
    domain, facets, cells = distribute(comm, arrays)
    return GroupedMesh(source, domain, facets, cells, comm.bcast(groups))


def _opened(path: Path, stack: ExitStack) -> Any:
    """A model of gmsh with the mesh of a file; it exists until the stack closes."""
    if not path.is_file():
        raise FileNotFoundError(f"mesh file {path} does not exist")
    gmsh = stack.enter_context(gmsh_model())
    copy = stack.enter_context(private_copy(path))
    _try_to_read(copy, path, gmsh.__file__)
    try:
        gmsh.merge(str(copy))
    except Exception as exc:
        message = str(exc).replace(str(copy), str(path))
        raise ValueError(f"{path} is not a mesh that gmsh can read: {message}") from exc
    return gmsh.model


def _try_to_read(copy: Path, path: Path, module: str) -> None:
    """Refuse a file by which gmsh crashes or never ends: another process reads it first.

    That process reads the ``copy`` of the file at ``path``, which the message names.
    """
    size = copy.stat().st_size
    patience = _PATIENCE + size / 1e6
    memory = min(available_memory(), _MEMORY + _MEMORY_OF_BYTE * size)
    # the process is no rank of MPI, and must not take itself for one
    clean = {name: value for name, value in os.environ.items() if not name.startswith(_RANK)}
    arguments = [str(Path(module).parent), str(copy), str(memory)]
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
            fault = reason or "memory does not suffice, or it ends too early"
    except subprocess.TimeoutExpired:
        fault = f"it is not done after {patience:.0f} s"
    if fault:
        raise ValueError(
            f"{path} is not a mesh that gmsh can read: {fault}; the file is damaged: write it again"
        )
