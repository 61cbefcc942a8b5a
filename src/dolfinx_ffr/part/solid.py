# SPDX-License-Identifier: MIT
"""The solid that a design in space encloses: a closed surface of triangles, and what it measures.

A field phi(X), positive in material, is given at the vertices of the mesh, and in the middle of
hexahedra and of their faces; the tetrahedra between them are cut where its interpolation is zero.
The surface of what is left is closed: it is the zero surface inside of the body, and the surface of
the body elsewhere. It is as fine as the mesh.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation
from ..design import Design
from ..fem import Domain, ElasticMaterial, GatheredMesh, surface_of
from ..files import named_in_errors
from ..parallel import on_rank_0
from .shape import PartWarning

__all__ = ["Solid"]

Array = NDArray[np.float64]

#: Files that can be written
_KINDS = (".stl", ".ply", ".vtp", ".obj")
#: Least distance of the zero surface from a vertex, in units of the field's range: a cut through a
#: vertex itself leaves triangles without area
_OFF = 1e-4


@dataclass(frozen=True, eq=False)
class _Found:
    """What rank 0 has found, for all ranks."""

    points: Array
    triangles: NDArray[np.int64]
    volume: float
    pieces: int
    loose: list[float]
    lost: list[str]


class Solid:
    """What is to be made of a design in space, bounded by a closed surface of triangles.

    Every rank holds all of it. Pieces that touch no interface are left out.

    Args:
        domain: Mesh, interfaces and regions of the body, in space.
        field: Positive in material and zero on its boundary: a function of positions (n, 3) [m]
            that gives (n,) numbers. Rank 0 evaluates it, all over the body.
        material: Of the solid, for its mass.

    Raises:
        TypeError: On every rank, if an argument is of a wrong kind.
        ValueError: On every rank, if the body is in the plane, the field is not finite, or no
            material touches an interface.

    Warns:
        PartWarning: If loose pieces are left out, or an interface has no material.
    """

    def __init__(
        self,
        domain: Domain,
        field: Callable[[Array], ArrayLike],
        *,
        material: ElasticMaterial | None = None,
    ) -> None:
        self.body = validation.instance("solid: domain", domain, Domain, "a Domain")
        if domain.dimension != 3:
            raise ValueError("solid: the body is in the plane; Part is for such bodies")
        validation.function("solid: field", field, "positions")
        self.material = material
        mesh = GatheredMesh.of(domain)
        solid, void = mesh.cell_values(domain.solid_cells), mesh.cell_values(domain.void_cells)
        self._found: _Found = on_rank_0(domain.comm, lambda: _found(mesh, field, solid, void))
        found = self._found
        #: Vertices of the surface, shape (points, 3) [m]
        self.points = found.points
        #: Vertices of each triangle, anticlockwise from outside, shape (triangles, 3)
        self.triangles = found.triangles
        self.volume = found.volume  #: [m^3]
        self.pieces = found.pieces  #: Number of connected pieces of material
        self.loose = found.loose  #: Volumes of the pieces that are left out [m^3]
        self.lost_interfaces = found.lost  #: Interfaces that are left without material
        if found.loose:
            warnings.warn(
                f"solid: {len(found.loose)} pieces of {sum(found.loose):.3g} m^3 touch no "
                "interface and are left out",
                PartWarning,
                stacklevel=2,
            )
        if found.lost:
            warnings.warn(
                f"solid: the interfaces {found.lost} have no material; keep the cells along them "
                "solid",
                PartWarning,
                stacklevel=2,
            )

    @staticmethod
    def of(
        design: Design, variables: ArrayLike, *, material: ElasticMaterial | None = None
    ) -> Solid:
        """The solid of a design.

        Args:
            design: A `DensityDesign` or `LevelSet` of a body in space.
            variables: Shape (size,).
            material: Of the solid, for its mass.
        """
        validation.instance("solid: design", design, Design, "a design, as DensityDesign(...)")
        return Solid(design.domain, design.level(design.check(variables)), material=material)

    @property
    def mass(self) -> float:
        """Mass [kg].

        Raises:
            ValueError: If no material was given.
        """
        density = getattr(self.material, "density", None)
        if density is None:
            raise ValueError("solid: without a material there is no mass; give material=...")
        return float(density) * self.volume

    def surface(self) -> Any:
        """The surface as a mesh of PyVista (`pyvista.PolyData`)."""
        import pyvista  # takes a while

        faces = np.column_stack([np.full(len(self.triangles), 3), self.triangles])
        return pyvista.PolyData(self.points, faces.ravel())

    def write(self, path: str | Path) -> Path:
        """Write the surface, for a printer or another program; collective.

        Args:
            path: File that ends in .stl, .ply, .vtp or .obj, lengths in metres.

        Returns:
            The path, on every rank.

        Raises:
            ValueError: If the kind of file is not known.
            OSError: On every rank, if it cannot be written.
        """
        file = validation.path("solid: path", path)
        if file.suffix.lower() not in _KINDS:
            raise ValueError(
                f"solid: the kind {file.suffix!r} of {str(file)!r} is not known; end the name in "
                f"{', '.join(_KINDS)}"
            )

        def save() -> None:
            file.parent.mkdir(parents=True, exist_ok=True)
            with named_in_errors(file):
                self.surface().save(str(file))

        on_rank_0(self.body.comm, save)
        return file


def _found(
    mesh: GatheredMesh,
    field: Callable[[Array], ArrayLike],
    solid: NDArray[np.bool_],
    void: NDArray[np.bool_],
) -> _Found:
    """The surface of the material."""
    import pyvista  # takes a while

    points, cells, parents = _tetrahedra(mesh)
    level = validation.real_array("solid: field", field(points), (len(points),)).copy()
    largest = float(np.max(np.abs(level), initial=0.0)) or 1.0
    level[np.unique(cells[void[parents]])] = -largest
    level[np.unique(cells[solid[parents]])] = largest
    near = np.abs(level) < _OFF * largest
    level[near] = np.where(level[near] < 0.0, -_OFF, _OFF) * largest
    kinds = np.full(len(cells), pyvista.CellType.TETRA)
    grid = pyvista.UnstructuredGrid(
        np.column_stack([np.full(len(cells), 4), cells]).ravel(), kinds, points
    )
    grid.point_data["level"] = level
    for name, held in mesh.interfaces.items():
        on = np.zeros(len(points))
        on[: len(held)] = held
        grid.point_data[f"held {name}"] = on
    cut = grid.clip_scalar(scalars="level", value=0.0, invert=False)
    if not cut.n_cells:
        raise ValueError("solid: there is no material; the field is negative everywhere")
    numbers = cut.connectivity("all").cell_data["RegionId"]
    pieces = [cut.extract_cells(np.flatnonzero(numbers == k)) for k in np.unique(numbers)]
    held_by = [
        {name for name in mesh.interfaces if np.any(piece.point_data[f"held {name}"] > 1.0 - 1e-9)}
        for piece in pieces
    ]
    kept = [piece for piece, by in zip(pieces, held_by, strict=True) if by]
    if not kept:
        raise ValueError("solid: no material touches an interface; keep the cells there solid")
    surface = surface_of(pyvista.merge(kept)).triangulate()
    return _Found(
        points=np.asarray(surface.points, dtype=np.float64),
        triangles=np.asarray(surface.faces.reshape(-1, 4)[:, 1:], dtype=np.int64),
        volume=float(sum(piece.volume for piece in kept)),
        pieces=len(kept),
        loose=[float(piece.volume) for piece, by in zip(pieces, held_by, strict=True) if not by],
        lost=[name for name in mesh.interfaces if not any(name in by for by in held_by)],
    )


#: Corners of the faces of a hexahedron in the order of VTK
_FACES = np.array(
    [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [0, 3, 2, 1], [4, 5, 6, 7]]
)


def _tetrahedra(mesh: GatheredMesh) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Points, tetrahedra and the cell of each; neighbours agree about the face between them.

    A hexahedron is cut into 24 of them, by its middle and those of its faces.
    """
    number = np.arange(len(mesh.cells))
    if mesh.cells.shape[1] == 4:
        return mesh.points, mesh.cells, number
    faces = mesh.cells[:, _FACES]
    unique, of = np.unique(np.sort(faces.reshape(-1, 4), axis=1), axis=0, return_inverse=True)
    n = len(mesh.points)
    points = np.vstack(
        [mesh.points, mesh.points[unique].mean(axis=1), mesh.points[mesh.cells].mean(axis=1)]
    )
    middle = n + of.reshape(faces.shape[:2])
    inner = n + len(unique) + number
    cells = [
        np.column_stack([faces[:, f, (i + 1) % 4], faces[:, f, i], middle[:, f], inner])
        for f in range(6)
        for i in range(4)
    ]
    return points, np.concatenate(cells), np.tile(number, 24)
