# SPDX-License-Identifier: MIT
"""The solid that a design in space encloses: its surface, what it measures, and meshes that fit.

A field phi(X), positive in material, and the cells that stay solid give

    solid = ({phi > 0} in designed cells) and (solid cells),   without pieces that nothing holds.

The cells of the body are cut into tetrahedra, and these along the zero surface
(`tetrahedral_cut`): what is left is the solid, as a mesh and as a closed surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from .. import validation
from ..arrays import Array, Integers
from ..fem import (
    Domain,
    ElasticMaterial,
    GatheredMesh,
    ShapeError,
    Tetrahedra,
    connected,
    fit_cylinder,
)
from ..files import check_room, whole_file
from ..parallel import on_rank_0
from .ball_widths import Balls, surface_balls
from .enclosed import Findings, LoosePieceWarning, PartWarning
from .export import UNITS
from .field import Field
from .options import SOLIDS
from .tetrahedral_cut import SIDES, cut_tetrahedra, outer_faces, touching, volumes
from .verify import Verifiable
from .widths import Width

#: Files that can be written
_KINDS = (".stl", ".ply", ".vtp", ".obj")
#: How often cells are divided for the surface, by their kind, see `Tetrahedra.of`
_DIVISIONS = {"hexahedron": 1, "tetrahedron": 0}


@dataclass(frozen=True, eq=False)
class Cavity:
    """A void that the solid encloses; powder of a printer stays in it."""

    volume: float  #: [m^3]
    center: Array  #: (3,) of its volume [m]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Findings(Findings):
    """What rank 0 finds out about a solid, its surface above all."""

    points: Array  #: (points, 3) vertices of the surface [m]
    triangles: Integers  #: (triangles, 3)
    volume: float  #: [m^3]
    loose: list[float]  #: Volumes of the pieces that are left out [m^3]
    cavities: list[Cavity]


class Solid(Verifiable):
    """The solid that a design in space encloses, bounded by a closed surface of triangles.

    Every rank holds all of the surface. Pieces that touch no interface are left out; pieces that
    meet in an edge or a point only do not hold each other.

    Args:
        domain: Mesh, interfaces and regions of the body, in space.
        field: Positive in material and zero on its boundary: a function of positions (n, 3) [m]
            that gives (n,) numbers. Rank 0 evaluates it, all over the body.
        material: Material of the solid, for its mass.
        size: Of the tetrahedra whose cut is its surface, and of the first that `verify` takes [m];
            by default 24 tetrahedra for each hexahedron of the body, or as many as it has.
        surface: Of those whose cut is its surface, if they are to be smaller [m].

    Raises:
        ValueError: If the body is in the plane, the field is not finite or zero over more than
            faces, no material touches an interface, or a size is out of range.

    Warns:
        PartWarning: If loose pieces are left out, an interface has no material, cavities are
            enclosed (`cavities`), or the surface touches itself, as where regions that are not
            designed meet in an edge only.
    """

    kind = "solid"
    elements = "tetrahedra"
    tolerance = 5e-3
    most = 2
    dimension = 3

    def __init__(
        self,
        domain: Domain,
        field: Field,
        *,
        material: ElasticMaterial | None = None,
        size: float | None = None,
        surface: float | None = None,
    ) -> None:
        self._set_arguments(domain, field, material, "on")
        if size is not None:
            validation.number("solid: size", size, above=0.0, unit="m")
        if surface is not None:
            largest = size or np.inf
            validation.number("solid: surface", surface, above=0.0, most=largest, unit="m")
        self._first_division = 0 if size is None else self._division(size)
        # of the first division, which is cut for the surface and for the mesh
        self._cuts: dict[int, Tetrahedra] = {}
        surface_size = surface or size
        self._findings: _Findings = self._cut(
            self._division(surface_size) if surface_size else _DIVISIONS[domain.cell]
        )[1]
        #: Vertices of the surface, shape (points, 3) [m]
        self.points = self._findings.points
        #: Vertices of each triangle, anticlockwise from outside, shape (triangles, 3)
        self.triangles = self._findings.triangles
        self._warn()

    @property
    def loose(self) -> list[float]:
        """Volumes of the pieces that nothing holds and that are left out [m^3]."""
        return self._findings.loose

    @property
    def cavities(self) -> list[Cavity]:
        """The voids that are enclosed, the largest first."""
        return self._findings.cavities

    @property
    def volume(self) -> float:
        return self._findings.volume

    @cached_property
    def thinnest_member(self) -> Width | None:
        """The thinnest member, by balls that do not fit; None if it is as thick as the solid.

        It takes seconds, and is computed once. What is thinner than two samples of the surface is
        not seen; samples are a quarter of a cell apart, or more where that would be too many.
        """
        return self._balls.thinnest()

    @cached_property
    def narrowest_gap(self) -> Width | None:
        """The narrowest gap or hole; None if there is none narrower than the solid."""
        return self._largest_balls(around=True).thinnest()

    def thinner(self, thickness: float) -> Array:
        """Centres of balls in members thinner than a thickness [m], (n, 3) [m]."""
        return self._balls.thinner(thickness)

    @cached_property
    def _balls(self) -> Balls:
        return self._largest_balls(around=False)

    def _largest_balls(self, *, around: bool) -> Balls:
        size = SOLIDS.sample * self.body.cell_size
        return surface_balls(self.points, self.triangles, size, around=around)

    def surface(self) -> Any:
        """The surface as a mesh of PyVista (`pyvista.PolyData`)."""
        import pyvista  # takes a while

        return pyvista.PolyData.from_regular_faces(self.points, self.triangles)

    def _write(self, path: str | Path, *, unit: str = "mm") -> list[Path]:
        target = validation.path("solid: file", path)
        validation.choice("solid: unit", unit, UNITS)
        is_folder = on_rank_0(self.body.comm, target.is_dir) or not target.suffix
        file = target / "solid.stl" if is_folder else target
        if file.suffix.lower() not in _KINDS:
            raise ValueError(
                f"solid: the kind {file.suffix!r} of {str(file)!r} is not known; end the name in "
                f"{', '.join(_KINDS)}"
            )

        def save() -> None:
            file.parent.mkdir(parents=True, exist_ok=True)
            with whole_file(file) as beside:
                check_room(beside, 200 * len(self.triangles))  # VTK says nothing of a full disk
                surface = self.surface()
                surface.points = surface.points / UNITS[unit]  # not in place: they are ours
                surface.save(str(beside))

        on_rank_0(self.body.comm, save)
        return [file]

    def sizes(self, size: float | None, count: int) -> list[float]:
        first = self._first_division if size is None else self._division(size)
        Tetrahedra.check(self.body, first + count - 1)
        return [Tetrahedra.size(self.body, first + i) for i in range(count)]

    def domain(self, size: float, order: int = 2) -> Domain:
        """A mesh of tetrahedra that fits the solid, see `Enclosed.domain`.

        The ``size`` is the edge of a cube that six tetrahedra fill [m]: the cells of the body are
        divided as often as it asks for. ``order`` is that of the displacements. A ValueError if a
        number is out of range, or the mesh has no material at the interfaces or more than eight
        million tetrahedra.
        """
        validation.number("solid: size", size, above=0.0, unit="m")
        degree = validation.integer("solid: order", order, least=1)
        tetrahedra, _ = self._cut(self._division(size))
        interfaces = self.body.interfaces
        centers = {name: interface.center.tolist() for name, interface in interfaces.items()}
        return tetrahedra.domain(self.body.comm, list(interfaces), centers, degree)

    def _division(self, size: float) -> int:
        """How often cells are divided for tetrahedra of a size [m]."""
        division = 0
        while Tetrahedra.size(self.body, division) > (1.0 + 1e-9) * size:
            division += 1
            Tetrahedra.check(self.body, division)
        return division

    def _cut(self, division: int) -> tuple[Tetrahedra, _Findings]:
        """The tetrahedra of the solid, on rank 0, and its surface, on all ranks."""
        if division in self._cuts:
            return self._cuts[division], self._findings
        body, mesh = Tetrahedra.of(self.body, division), GatheredMesh.of(self.body)
        result = body  # which is empty on other ranks

        def cut() -> _Findings:
            nonlocal result
            tetrahedra = cut_tetrahedra(body, self.field)
            _round_bores(tetrahedra, mesh)
            result, findings = _attached(tetrahedra, list(self.body.interfaces))
            return findings

        findings: _Findings = on_rank_0(self.body.comm, cut)
        self._cuts.setdefault(division, result)
        return result, findings


def _attached(cut: Tetrahedra, names: list[str]) -> tuple[Tetrahedra, _Findings]:
    """The pieces that touch an interface, and their surface."""
    if not len(cut.cells):
        raise ShapeError("solid: there is no material; the field is negative everywhere")
    _, _, neighbours = outer_faces(cut.cells)
    piece = connected(neighbours, len(cut.cells))
    volume = volumes(cut.points, cut.cells)
    is_attached = np.zeros(piece.max() + 1, dtype=bool)
    is_attached[piece[np.any(cut.facets >= 0, axis=1)]] = True
    if not np.any(is_attached):
        raise ShapeError("solid: no material touches an interface; keep the cells there solid")

    stays = is_attached[piece]
    used, cells = np.unique(cut.cells[stays], return_inverse=True)
    cells = cells.reshape(-1, 4)
    solid = Tetrahedra(cut.points[used], cells, cut.facets[stays], cut.regions[stays])
    on_surface, triangles = np.unique(outer_faces(cells)[0], return_inverse=True)
    triangles, points = triangles.reshape(-1, 3), solid.points[on_surface]

    loose = [float(v) for v in np.bincount(piece, volume)[~is_attached]]
    cavities = _cavities(points, triangles)
    lost = [name for i, name in enumerate(names) if not np.any(solid.facets == i)]
    warnings: list[PartWarning] = []
    if loose:
        said = f"{len(loose)} pieces of {sum(loose):.3g} m^3 touch no interface and are left out"
        warnings.append(LoosePieceWarning(said))
    said_of_surface = _warnings(points[touching(triangles)], cavities, lost)
    findings = _Findings(
        points=points,
        triangles=triangles,
        volume=float(np.sum(volume[stays])),
        pieces=int(np.count_nonzero(is_attached)),
        loose=loose,
        cavities=cavities,
        lost_interfaces=lost,
        warnings=[*warnings, *map(PartWarning, said_of_surface)],
    )
    return solid, findings


def _warnings(meeting: Array, cavities: list[Cavity], lost: list[str]) -> list[str]:
    """Warnings of points (n, 3) where a surface touches itself, of cavities and of interfaces."""
    warnings = []
    if len(meeting):
        x, y, z = meeting[0]
        warnings.append(
            f"the surface touches itself at {len(meeting)} points, the first at "
            f"({x:.4g}, {y:.4g}, {z:.4g}) m, where parts of the solid region or of the body meet "
            "in an edge or a point only; join them, or keep them apart by a cell"
        )
    if cavities:
        volume = sum(cavity.volume for cavity in cavities)
        centers = [
            ", ".join(f"{x:.4g}" for x in cavity.center) for cavity in cavities[: SOLIDS.places]
        ]
        ellipsis = ", ..." if len(cavities) > SOLIDS.places else ""
        warnings.append(
            f"enclosed cavities: {len(cavities)}, {volume:.3g} m^3 in all, about "
            f"({'), ('.join(centers)}) m{ellipsis}; powder stays in them: drill a channel to each "
            "cavity in CAD"
        )
    if lost:
        warnings.append(f"the interfaces {lost} have no material; keep the cells along them solid")
    return warnings


def _cavities(points: Array, triangles: Integers) -> list[Cavity]:
    """Pieces of a closed surface that are turned inwards, the largest first."""
    piece_of_point = connected(triangles[:, [[0, 1], [1, 2]]].reshape(-1, 2), len(points))
    piece = piece_of_point[triangles[:, 0]]

    # volumes are sums of those of tetrahedra from the origin to the triangles, with their signs
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    tetrahedron = np.einsum("td,td->t", a, np.cross(b, c)) / 6.0
    volume = np.bincount(piece, tetrahedron)
    cavities = np.flatnonzero(volume < 0.0)
    cavities = cavities[np.argsort(volume[cavities], kind="stable")]

    tetrahedron_center = (a + b + c) / 4.0
    moments = [np.bincount(piece, tetrahedron * x)[cavities] for x in tetrahedron_center.T]
    centers = np.column_stack(moments) / volume[cavities, None]
    return [
        Cavity(-float(signed), center)
        for signed, center in zip(volume[cavities], centers, strict=True)
    ]


def _round_bores(cut: Tetrahedra, mesh: GatheredMesh) -> None:
    """Move points on interfaces that are cylinders from the sides of polygons onto them."""
    for number, (name, interface) in enumerate(mesh.domain.interfaces.items()):
        nodes = mesh.points[mesh.interfaces[name]]
        if interface.axis is None or np.ptp(nodes @ interface.axis) < 1e-6 * interface.extent:
            continue
        cylinder = fit_cylinder(nodes, interface.axis)
        if cylinder is None:
            continue
        center, axis = cylinder
        radius = float(np.mean(np.linalg.norm(np.cross(nodes - center, axis), axis=1)))
        cells, opposite = np.nonzero(cut.facets == number)
        points = np.unique(cut.cells[cells[:, None], SIDES[opposite]])
        offset = cut.points[points] - center
        radial = offset - np.outer(offset @ axis, axis)
        distance = np.linalg.norm(radial, axis=1, keepdims=True)
        cut.points[points] += (radius / distance - 1.0) * radial
