# SPDX-License-Identifier: MIT
"""Bodies without a mesh: Craig-Bampton reduction of matrices from another finite-element program.

The matrices stand in the place of those that a mesh and a density give (`AssembledElasticity`), and
go through the same code. Each rank works at the whole body; the integrals are those of rank 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse

from .. import validation
from ..arrays import Integers
from ..body import VolumeIntegrals
from ..fem import Array, Elasticity, Interface, Matrices, kept_by, surface_reference
from ..interchange import AssembledMatrices
from ..parallel import on_every_rank
from .craig_bampton import CraigBampton
from .direct_solver import DIRECT
from .frame import Frame
from .integrals import volume_integrals


@dataclass(frozen=True)
class NodalDomain:
    """Nodes without a mesh, in the place of a `Domain`: what frames and reductions ask it for."""

    comm: MPI.Comm
    interfaces: dict[str, Interface]
    bounding_box: Array  #: (2, 3) [m]
    dimension: int = 3
    order: int = 1
    cell_size: float = np.inf  #: Not known: no bound for the band of a factor


class AssembledElasticity(Elasticity):
    """Assembled matrices in the place of a mesh and a density, on one rank.

    Blocks of fields work as for `Elasticity`; methods that need a mesh do not.
    """

    def __init__(self, matrices: AssembledMatrices, interfaces: dict[str, Interface]) -> None:
        nodes = matrices.nodes
        self.comm, self.dimension = MPI.COMM_SELF, 3
        self.n_dofs = self.n_dofs_global = nodes.size
        box = np.array([nodes.min(axis=0), nodes.max(axis=0)])
        self.domain = NodalDomain(self.comm, interfaces, box)  # type: ignore[assignment]
        self._nodes, self._given = nodes, matrices
        pattern = (abs(matrices.stiffness) + abs(matrices.mass)).tocsr()
        pattern.sort_indices()
        pattern.data[:] = 0.0
        self._zeros = pattern
        self._pattern = kept_by(self, self.comm)
        self._pattern.append(self._petsc(matrices.stiffness))

    def _petsc(self, matrix: scipy.sparse.csr_matrix) -> PETSc.Mat:
        """A matrix with the entries that all matrices of the body share."""
        entries = self._zeros.copy()
        rows = np.repeat(np.arange(self.n_dofs), np.diff(entries.indptr))
        entries.data = np.asarray(matrix[rows, entries.indices]).ravel()
        index = entries.indptr.astype(PETSc.IntType), entries.indices.astype(PETSc.IntType)
        shared = PETSc.Mat().createAIJ(entries.shape, csr=(*index, entries.data), comm=self.comm)
        numbering = PETSc.LGMap().create(
            np.arange(self.n_dofs, dtype=PETSc.IntType), comm=self.comm
        )
        shared.setLGMap(numbering, numbering)
        shared.assemble()
        return shared

    def matrices(self) -> Matrices:
        """Stiffness and mass."""
        stiffness_and_mass = (
            self._petsc(matrix) for matrix in (self._given.stiffness, self._given.mass)
        )
        return Matrices(np.ones(1), *stiffness_and_mass)

    @property
    def mass_over_diagonal(self) -> int:
        """As for a mesh; without elements it is the largest number of entries of a row."""
        return int(np.diff(self._given.mass.tocsr().indptr).max())

    def coordinates(self) -> Array:
        return self._nodes


def reduce_matrices(
    matrices: AssembledMatrices,
    *,
    frame: Frame,
    interfaces: Sequence[str],
    modes: int = 8,
    centers: Mapping[str, Sequence[float]] | None = None,
    tolerance: float = 1e-8,
    mass: float | None = None,
    comm: MPI.Comm | None = None,
) -> VolumeIntegrals:
    """The volume integrals of a body by its ``matrices``; it moves beside bodies with a mesh.

    Args:
        matrices: Matrices of the free body, with its nodes.
        frame: Reference conditions of the floating frame.
        interfaces: Node sets that move as rigid bodies each.
        modes: Number of fixed-interface normal modes.
        centers: Reference points of interfaces by name, shape (3,) [m]; by default the middle of a
            cylinder's axis, or the centroid of the faces between the nodes.
        tolerance: Tolerance of the modes, as for `FlexibleBody`.
        mass: Mass [kg] that the body is known to have, within one per cent: a check of units.
        comm: Ranks that share the result, by default all; they call with the same arguments.

    Raises:
        ValueError: If a node set is not there or lies on a line, two share nodes, frame or modes do
            not fit, or the mass differs.
        RuntimeError: If a solver fails.
    """
    world = MPI.COMM_WORLD if comm is None else comm
    needed = "AssembledMatrices, as from read_calculix(...)"
    validation.instance("reduction: matrices", matrices, AssembledMatrices, needed)
    if mass is not None:
        expected = validation.number("reduction: mass", mass, above=0.0, unit="kg")
        total = matrices.total_mass
        if abs(total - expected) > 0.01 * expected:
            raise ValueError(
                f"reduction: the mass of the matrices is {total:.6g} and not {expected:.6g} kg: "
                "are they in kg, m and s? A model in t, mm and s has matrices in t and N/mm"
            )
    with on_every_rank(world, "reduction"):
        names = validation.names("reduction: interfaces", interfaces)
        held = _interfaces(matrices, names, centers)
        elasticity = AssembledElasticity(matrices, held)
        reduction = CraigBampton(elasticity, frame, modes, tolerance=tolerance, solver=DIRECT)
        factored = reduction.factor(elasticity.matrices())
        try:
            basis = reduction.basis(factored)
            integrals = volume_integrals(reduction, factored.matrices, basis, {})
        finally:
            factored.destroy()
    shared: VolumeIntegrals = world.bcast(integrals)
    return shared


def _interfaces(
    matrices: AssembledMatrices, names: list[str], centers: Mapping[str, Sequence[float]] | None
) -> dict[str, Interface]:
    """The interfaces by name, with their reference points."""
    if not names:
        raise ValueError("reduction: a body needs at least one interface to be held by")
    positions = validation.by_name("reduction: centers", centers or {}, "positions")
    if unknown := sorted(set(positions) - set(names)):
        raise ValueError(f"reduction: centers for {unknown}, but the interfaces are {names}")
    result: dict[str, Interface] = {}
    for name in names:
        if name not in matrices.node_sets:
            raise ValueError(
                f"reduction: there is no node set {name!r}; there are {sorted(matrices.node_sets)}"
            )
        nodes = matrices.node_sets[name]
        points = matrices.nodes[nodes]
        sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if not sizes[1] > 1e-6 * sizes[0]:
            raise ValueError(
                f"interface {name!r} lies on a line or in one point: it cannot hold the body "
                "against rotation"
            )
        for name_before, interface_before in result.items():
            if np.intersect1d(nodes, interface_before.dofs).size:
                raise ValueError(
                    f"interfaces {name_before!r} and {name!r} overlap: they share nodes"
                )
        center, axis = _reference(matrices, nodes)
        if name in positions:
            argument = f"interface {name!r}: center"
            center = validation.real_array(
                argument, positions[name], (3,), expected="three components"
            )
        extent = float(np.linalg.norm(np.ptp(points, axis=0)))
        none = np.zeros(0, dtype=np.int32)
        result[name] = Interface(name, none, nodes.astype(np.int32), center, extent, axis)
    return result


def _reference(matrices: AssembledMatrices, nodes: Integers) -> tuple[Array, Array | None]:
    """Reference point (3,) and axis (3,) of the faces between some nodes, see `surface_reference`.

    Without faces it is the mean of the nodes, and no axis.
    """
    faces = matrices.faces[np.all(np.isin(matrices.faces, nodes), axis=1)]
    if not len(faces):
        return matrices.nodes[nodes].mean(axis=0), None

    a, b, c = (matrices.nodes[faces[:, k]] for k in range(3))
    normals = 0.5 * np.cross(b - a, c - a)  # as long as the area of a face
    areas = np.linalg.norm(normals, axis=1)
    centroid = areas @ (a + b + c) / (3.0 * areas.sum())
    spread = np.einsum("f,fi,fj->ij", 1.0 / areas, normals, normals)
    points = matrices.nodes[np.unique(faces)]
    return surface_reference(points, areas.sum(), centroid, normals.sum(axis=0), spread)
