# SPDX-License-Identifier: MIT
"""The solid that a design in space encloses: its surface, what it measures, and meshes that fit.

A field phi(X), positive in material, and the cells that stay solid give

    solid = ({phi > 0} in designed cells) and (solid cells),   without pieces that nothing holds.

The cells of the body are cut into tetrahedra, and these along the zero surface
(`tetrahedral_cut`): what is left is the solid, as a mesh and as a closed surface. The outline of
the body, its interfaces and its regions stay what they are. It is as fine as the mesh of the body,
or finer.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation
from ..design import Design
from ..fem import Domain, ElasticMaterial, GatheredMesh, Tetrahedra, fit_cylinder
from ..files import named_in_errors
from ..parallel import on_rank_0
from ..problem import Evaluation, Problem
from .ball_widths import narrowest_gap_in_space, thinnest_member_in_space
from .shape import Enclosed, PartWarning
from .tetrahedral_cut import SIDES, cut_tetrahedra, outer_faces, pieces, volumes
from .verify import Verification, verify
from .widths import Width

__all__ = ["Solid"]

Array = NDArray[np.float64]

#: Files that can be written
_KINDS = (".stl", ".ply", ".vtp", ".obj")
#: How fine the surface is, see `Tetrahedra.of`, by the body's cells
_SURFACE = {"hexahedron": 1, "tetrahedron": 0}
#: Spacing of the lattice on which members and gaps are looked for, by the size of the body's cells
_LATTICE = 0.25


@dataclass(frozen=True, eq=False)
class _Found:
    """What rank 0 has found, for all ranks but the tetrahedra."""

    points: Array
    triangles: NDArray[np.int64]
    volume: float
    pieces: int
    loose: list[float]
    lost: list[str]


class Solid(Enclosed):
    """What is to be made of a design in space, bounded by a closed surface of triangles.

    Every rank holds all of the surface. Pieces that touch no interface are left out; pieces that
    meet in an edge or a point only do not hold each other.

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

    elements = "tetrahedra"
    tolerance = 5e-3
    most = 2

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
        self.field = field  #: Positive in the material, of positions (n, 3) [m]
        self.material = material
        _, found = self._cut(_SURFACE[domain.cell])
        #: Vertices of the surface, shape (points, 3) [m]
        self.points = found.points
        #: Vertices of each triangle, anticlockwise from outside, shape (triangles, 3)
        self.triangles = found.triangles
        self.volume = found.volume  #: [m^3]
        self._pieces = found.pieces
        self.loose = found.loose  #: Volumes of the pieces that are left out [m^3]
        self._lost = found.lost
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

    # ------------------------------------------------------------------ what it is

    @property
    def pieces(self) -> int:
        """Number of connected pieces of material."""
        return self._pieces

    @property
    def lost_interfaces(self) -> list[str]:
        """Interfaces that are left without material."""
        return self._lost

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

    @cached_property
    def thinnest_member(self) -> Width | None:
        """The thinnest member, by balls that do not fit; None if it is as thick as the solid.

        It takes seconds, and is kept. What is thinner than the spacing of a lattice is not seen: a
        quarter of a cell, or more where that would be too many points for a large body.
        """
        return thinnest_member_in_space(self.points, self.triangles, self._lattice)

    @cached_property
    def narrowest_gap(self) -> Width | None:
        """The narrowest gap or hole; None if there is none narrower than the solid."""
        return narrowest_gap_in_space(self.points, self.triangles, self._lattice)

    @property
    def _lattice(self) -> float:
        return _LATTICE * self.body.cell_size

    def measures(self) -> dict[str, Width | int | None]:
        return {"thinnest member": self.thinnest_member, "narrowest gap": self.narrowest_gap}

    def surface(self) -> Any:
        """The surface as a mesh of PyVista (`pyvista.PolyData`)."""
        import pyvista  # takes a while

        faces = np.column_stack([np.full(len(self.triangles), 3), self.triangles])
        return pyvista.PolyData(self.points, faces.ravel())

    # ------------------------------------------------------------------ what becomes of it
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

    def sizes(self, size: float | None, count: int) -> list[float]:
        """Sizes of the meshes on which the solid is evaluated, each finer than the last.

        Args:
            size: Largest size of the first one [m]; by default the coarsest is the first.
            count: How many.

        Raises:
            ValueError: On every rank, if the last one has more than four million tetrahedra.
        """
        first = 0 if size is None else self._finer(size)
        Tetrahedra.check(self.body, first + count - 1)
        return [Tetrahedra.size(self.body, first + i) for i in range(count)]

    def domain(self, size: float, order: int = 2) -> Domain:
        """A mesh of tetrahedra that fits the solid; collective.

        It has the interfaces of the body, with the same centres, and its solid regions. The cells
        of the body are divided as often as the size asks for; its own size is the largest.

        Args:
            size: Of the tetrahedra, the edge of a cube that six of them fill [m].
            order: Polynomial order of the displacements.

        Raises:
            ValueError: On every rank, if a number is out of range, or a mesh of this size has no
                material at the interfaces or more than four million tetrahedra.
        """
        validation.number("solid: size", size, above=0.0, unit="m")
        degree = validation.integer("solid: order", order, least=1)
        comm, held = self.body.comm, self.body.interfaces
        cut, _ = self._cut(self._finer(size))
        centers = {name: part.center.tolist() for name, part in held.items()}
        return cut.domain(comm, list(held), centers, degree)

    def verify(self, problem: Problem, evaluation: Evaluation, **options: Any) -> Verification:
        """Evaluate a problem of one designed body with the solid in its place; see `verify`.

        Args:
            problem: With the body that was designed.
            evaluation: Of the design, what was reported.
            options: Those of `verify`.

        Raises:
            ValueError: If the problem has several bodies with a density.
        """
        return verify(problem, {self._only_body(problem): self}, evaluation, **options)

    def _finer(self, size: float) -> int:
        """How often cells are divided for tetrahedra of a size [m]."""
        finer = 0
        while Tetrahedra.size(self.body, finer) > (1.0 + 1e-9) * size:
            finer += 1
            Tetrahedra.check(self.body, finer)
        return finer

    def _cut(self, finer: int) -> tuple[Tetrahedra, _Found]:
        """The solid of tetrahedra of the body, which rank 0 has, and what was found."""
        body, mesh = Tetrahedra.of(self.body, finer), GatheredMesh.of(self.body)
        kept: list[Tetrahedra] = []

        def cut() -> _Found:
            left = cut_tetrahedra(body, self.field)
            for bore in _bores(mesh):
                bore.round(left)
            left, found = _held(left, list(self.body.interfaces))
            kept.append(left)
            return found

        found: _Found = on_rank_0(self.body.comm, cut)
        return (kept[0] if kept else body), found


def _held(cut: Tetrahedra, names: list[str]) -> tuple[Tetrahedra, _Found]:
    """The pieces that touch an interface, and what they are."""
    if not len(cut.cells):
        raise ValueError("solid: there is no material; the field is negative everywhere")
    _, _, pairs = outer_faces(cut.cells)
    piece = pieces(cut.cells, pairs)
    size = volumes(cut.points, cut.cells)
    touches = np.zeros(piece.max() + 1, dtype=bool)
    touches[piece[np.any(cut.facets >= 0, axis=1)]] = True
    if not np.any(touches):
        raise ValueError("solid: no material touches an interface; keep the cells there solid")
    stays = touches[piece]
    used, cells = np.unique(cut.cells[stays], return_inverse=True)
    cells = cells.reshape(-1, 4)
    left = Tetrahedra(cut.points[used], cells, cut.facets[stays], cut.regions[stays])
    triangles, _, _ = outer_faces(cells)
    seen, corners = np.unique(triangles, return_inverse=True)
    found = _Found(
        points=left.points[seen],
        triangles=corners.reshape(-1, 3),
        volume=float(np.sum(size[stays])),
        pieces=int(np.count_nonzero(touches)),
        loose=[float(v) for v in np.bincount(piece, size)[~touches]],
        lost=[name for i, name in enumerate(names) if not np.any(left.facets == i)],
    )
    return left, found


@dataclass(frozen=True, eq=False)
class _Bore:
    """An interface that is a cylinder."""

    number: int  #: Of the interface
    center: Array  #: (3,) of its axis [m]
    axis: Array  #: (3,) unit vector
    radius: float  #: [m]

    def round(self, cut: Tetrahedra) -> None:
        """Move points on the sides of its polygon onto the cylinder."""
        cells, opposite = np.nonzero(cut.facets == self.number)
        points = np.unique(cut.cells[cells[:, None], SIDES[opposite]])
        offset = cut.points[points] - self.center
        radial = offset - np.outer(offset @ self.axis, self.axis)
        away = np.linalg.norm(radial, axis=1, keepdims=True)
        cut.points[points] += (self.radius / away - 1.0) * radial


def _bores(mesh: GatheredMesh) -> list[_Bore]:
    """Interfaces that are cylinders."""
    found = []
    for number, (name, part) in enumerate(mesh.domain.interfaces.items()):
        points = mesh.points[mesh.interfaces[name]]
        if part.axis is None or np.ptp(points @ part.axis) < 1e-6 * part.extent:
            continue
        cylinder = fit_cylinder(points, part.axis)
        if cylinder is not None:
            center, axis = cylinder
            radius = float(np.mean(np.linalg.norm(np.cross(points - center, axis), axis=1)))
            found.append(_Bore(number, center, axis, radius))
    return found
