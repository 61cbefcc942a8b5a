# SPDX-License-Identifier: MIT
"""The part that a design encloses: smooth closed curves, what they measure, and a mesh that fits.

A field phi(X), positive in material, and the cells that stay solid give

    part = ({phi > 0} in designed cells) and (solid cells),   without pieces that nothing holds.

The zero line is found on a lattice that divides the cells of the mesh (`cut`). Splines follow it at
less than a given distance (`fitting`). The outline of the mesh stays what it is: lines and arcs are
recognised, also of straight cells with vertices on a circle; other curved sides become splines.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from .. import validation
from ..arrays import Array, Integers
from ..fem import (
    Curve,
    CurveError,
    Domain,
    Drawing,
    ElasticMaterial,
    Face,
    Line,
    LocalSizes,
    ShapeError,
    built_on_rank_0,
    check_size,
    enclosed,
    fit_circle,
    mesh_faces,
    polygon,
    ring,
    turns,
)
from ..parallel import on_rank_0
from .boundary import boundaries
from .cut import cut
from .enclosed import Findings, LoosePieceWarning, PartWarning
from .export import Sheet, write
from .field import Field
from .in_space import mesh_solid
from .lattice import Lattice
from .options import CURVES, MESHES
from .pieces import attached, pieces
from .pockets import pocket_faces
from .verify import Verifiable
from .widths import Width, member_widths, narrowest_gap, thinnest_member

#: For each piece the outer loop of curves, counterclockwise, then its holes, clockwise
Outlines = list[list[list[Curve]]]


@dataclass(frozen=True, eq=False)
class LoosePiece:
    """A piece of a design that nothing holds, and that is left out of the part.

    Attributes:
        area: [m^2].
        center: (2,) of its area [m].
        outline: Its outer loop, counterclockwise, then its holes, clockwise.
    """

    area: float
    center: Array
    outline: list[list[Curve]]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Findings(Findings):
    """What rank 0 finds out about a part, its boundary above all."""

    drawing: Drawing  #: Designed and solid faces
    loose: list[LoosePiece]
    crossing: str  #: Where curves cross [mm], empty if they do not


class Part(Verifiable):
    """What is to be made of a design: one flat part, bounded by smooth curves.

    Every rank holds all of it.

    Args:
        domain: Mesh, interfaces and solid cells of the body.
        field: Positive in material and zero on its boundary: a function of positions (n, 2) [m]
            that gives (n,) numbers. Rank 0 evaluates it, all over the body.
        spacing: Length on which the field varies [m], as the distance of knots or a mean element,
            which is the default.
        material: Material of the part, for its mass and thickness.
        resolution: Sides of the lattice in one spacing, at least.
        tolerance: Largest distance of a curve from points of the zero line, in spacings.
        web: Thickness where the field is negative, as a share of the part's: pockets are milled
            there, from both sides to the same depth. With 0 holes are cut.

    Raises:
        ValueError: If a number is out of range, the field is not finite or zero over more than
            lines, no material touches an interface, or interfaces are not connected by material.

    Warns:
        PartWarning: If loose pieces are left out, an interface has lost material, or only
            interfaces hold pieces together.
    """

    kind = "part"
    elements = "triangles"
    tolerance = 2e-3
    most = 5
    dimension = 2

    def __init__(
        self,
        domain: Domain,
        field: Field,
        spacing: float | None = None,
        *,
        material: ElasticMaterial | None = None,
        resolution: int = 6,
        tolerance: float = 1e-5,
        web: float = 0.0,
    ) -> None:
        self._set_arguments(domain, field, material, "thickness")
        if spacing is None:
            spacing = float(np.sqrt(domain.area / domain.n_cells_global))
        #: Length on which the field varies [m]
        self.spacing = validation.number("part: spacing", spacing, above=0.0, unit="m")
        steps = validation.integer("part: resolution", resolution, least=2)
        share = validation.number("part: tolerance", tolerance, above=0.0, below=0.1)
        #: Thickness of the floors of pockets as a share of the part's; zero where there are none
        self.web = validation.number("part: web", web, least=0.0, below=1.0)
        #: Of the polygons that stand for the curves [m]
        self.accuracy = CURVES.accuracy * self.spacing
        names = list(domain.interfaces)
        for finer in CURVES.finer_lattices:
            step = self.spacing / (finer * steps)
            lattice = Lattice.of(domain, step)
            find = partial(_find, lattice, field, self.spacing, step, share, names, self.web)
            findings: _Findings = on_rank_0(domain.comm, find)
            if not findings.crossing:
                break
        else:
            raise CurveError(
                f"part: curves cross near {findings.crossing} mm, where members or gaps are "
                "thinner than the lattice on which they are looked for; give a larger resolution, "
                "or take a design without hairlines"
            )
        self._findings: _Findings = findings
        #: Curves, and the faces between them in designed and solid cells
        self.drawing = findings.drawing
        self._warn()

    def redrawn(self, drawing: Drawing) -> Part:
        """The part of the same body between the curves of a ``drawing``."""
        part = copy(self)
        for name, value in vars(type(self)).items():
            if isinstance(value, cached_property):
                part.__dict__.pop(name, None)
        part.drawing = drawing
        part._findings = replace(
            self._findings,
            drawing=drawing,
            pieces=len(part.outlines),
            loose=[],
            warnings=[w for w in self._findings.warnings if not isinstance(w, LoosePieceWarning)],
        )
        # the field of the first part has another boundary
        part.field = lambda x: 2.0 * shapely.contains_xy(part.polygon, *np.transpose(x)) - 1.0
        return part

    @cached_property
    def outlines(self) -> Outlines:
        """For each piece the outer loop of curves, counterclockwise, then its holes, clockwise."""
        return _outlines(self.drawing, self.accuracy)

    @property
    def holes(self) -> int:
        """Number of holes that go through, in all pieces."""
        return sum(len(loops) - 1 for loops in self.outlines) - len(self.pockets)

    @cached_property
    def pockets(self) -> list[Face]:
        """The floors of all pockets, between curves of the `drawing`; none without a `web`.

        A ValueError if a pocket is open at the outline or a hole of the body.
        """
        if not self.web:
            return []
        return pocket_faces(self.drawing, self.body.outline, self.spacing)

    @property
    def loose(self) -> list[LoosePiece]:
        """The pieces that nothing holds and that are left out."""
        return self._findings.loose

    def interface(self, name: str) -> list[Curve]:
        """The curves that are the interface ``name``, which must be one of the body's."""
        validation.choice("part: interface", name, self.body.interfaces)
        curves = zip(self.drawing.curves, self.drawing.groups, strict=True)
        return [curve for curve, group in curves if group == name]

    def measures(self) -> dict[str, Width | int | None]:
        counts = {"holes": self.holes} | ({"pockets": len(self.pockets)} if self.web else {})
        return {**counts, **super().measures()}

    def _picture(self) -> str:
        left, low, right, high = self.polygon.bounds
        box = f"{left} {-high} {right - left} {high - low}"
        polygon = self.polygon.svg((right - left) / 1000.0, "#8fa1b3", 1.0)
        style = "display:block;overflow:visible;max-width:100%;width:36em"
        return (
            f'<svg viewBox="{box}" style="{style}"><g transform="scale(1 -1)">{polygon}</g></svg>'
        )

    @cached_property
    def _moments(self) -> Array:
        return np.sum([enclosed(loop) for loops in self.outlines for loop in loops], axis=0)

    @property
    def area(self) -> float:
        """Area of full thickness between the curves [m^2], exact for them."""
        return float(self._moments[0])

    @property
    def pocket_area(self) -> float:
        """Area of the floors of all pockets [m^2]."""
        return float(self._floor_moments[0])

    @property
    def center(self) -> Array:
        """Centre of the material, shape (2,) [m]."""
        moments = self._moments + self.web * self._floor_moments
        return np.asarray(moments[1:] / moments[0])

    @property
    def _floor_moments(self) -> Array:
        moments = [self.drawing.moments(face.loops) for face in self.pockets]
        return np.sum(moments, axis=0) if moments else np.zeros(3)

    @property
    def thickness(self) -> float:
        """Extent perpendicular to the plane [m]; a ValueError without a material."""
        return float(self._material_for("its thickness").thickness)

    @property
    def volume(self) -> float:
        return self.thickness * (self.area + self.web * self.pocket_area)

    @cached_property
    def polygon(self) -> shapely.MultiPolygon:
        """Polygons within `accuracy` of the curves, one a piece."""
        return _polygons(self.outlines, self.accuracy)

    @property
    def floors(self) -> list[shapely.Polygon]:
        """The floors of all pockets as polygons, which share their vertices with `polygon` [m]."""
        if not self.web:
            return []
        rings = [ring for piece in self.polygon.geoms for ring in piece.interiors]
        filled = shapely.union_all([shapely.Polygon(ring) for ring in rings])
        floors = shapely.get_parts(filled.difference(self.polygon))
        return [f for f in floors if self.body.outline.covers(f.representative_point())]

    def density(self, domain: Domain) -> Array:
        if not self.web:
            return super().density(domain)
        full = shapely.contains_xy(self.polygon, *domain.centroids.T)
        return np.where(full, 1.0, self.web)

    @cached_property
    def thinnest_member(self) -> Width | None:
        """The thinnest member, by discs that do not fit; None if it is as wide as the part."""
        return thinnest_member(self.polygon, 10.0 * self.accuracy, self._widest)

    @cached_property
    def narrowest_gap(self) -> Width | None:
        """The narrowest gap or hole; None if there is none narrower than the part."""
        return narrowest_gap(self.polygon, 10.0 * self.accuracy, self._widest)

    @property
    def _widest(self) -> float:
        low, high = np.reshape(self.polygon.bounds, (2, 2))
        return float(np.min(high - low))

    def _write(self, path: str | Path, *, unit: str = "mm") -> list[Path]:
        return write(self._sheet, path, unit, self.body.comm)

    @property
    def _sheet(self) -> Sheet:
        drawing = self.drawing
        pieces = drawing.outlines([*drawing.faces, *self.pockets], self.accuracy)
        return Sheet(
            [[drawing.grouped(loop) for loop in loops] for loops in pieces],
            list(self.body.interfaces),
            self.polygon,
            lambda: self.thickness,
            pockets=[[drawing.grouped(loop) for loop in face.loops] for face in self.pockets],
            floors=self.floors,
            web=self.web,
        )

    def sizes(self, size: float | None, count: int) -> list[float]:
        first = MESHES.first_size * self.spacing if size is None else size
        return [first / 2**halving for halving in range(count)]

    def domain(
        self,
        size: float,
        order: int = 2,
        *,
        across: float = MESHES.across,
        turn: float = MESHES.turn,
    ) -> Domain:
        """A mesh of triangles that fits the part, see `Enclosed.domain`.

        The ``size`` is that of the triangles [m]; ``across`` is their largest size in a member, in
        units of its width: thin members get smaller ones, by default about two across; ``turn`` is
        that in a notch, in radii, infinite for none: with 0.25, the default, its stress may be 5 %
        too high, with 0.1 1 %. From an ``order`` of 2 on cells at curves are curved. A ValueError
        if gmsh cannot mesh the part, or a number is out of range.
        """
        validation.number("part: size", size, above=0.0, unit="m")
        validation.number("part: across", across, above=0.0)
        if turn < math.inf:
            validation.number("part: turn", turn, above=0.0)
        degree = validation.integer("part: order", order, least=1)
        drawing = replace(self.drawing, faces=[*self.drawing.faces, *self.pockets])
        centers = {
            name: interface.center.tolist()
            for name, interface in self.body.interfaces.items()
            if name not in self.lost_interfaces
        }
        return self._built(
            lambda gmsh: self._mesh(gmsh, drawing, size, degree, across, turn), centers, degree
        )

    def _built(
        self, build: Callable[[Any], None], centers: Mapping[str, Sequence[float]], order: int
    ) -> Domain:
        """The mesh that rank 0 builds, a function of gmsh, with interfaces by their centres."""
        comm = self.body.comm
        with built_on_rank_0(comm, build) as model:
            return Domain.from_gmsh_model(
                comm, model, interfaces=list(centers), order=order, centers=centers
            )

    def in_space(self, size: float, order: int = 2) -> Domain:
        """The solid that its STEP file has, by tetrahedra, to verify the plane model by.

        Args:
            size: Of the tetrahedra at most [m]. One across a web is enough for an ``order`` of 2.
            order: Polynomial order of the displacements.

        Returns:
            A body in space, with the walls over the curves of each interface as that interface. Its
            middle plane is z = 0.
        """
        validation.number("part: size", size, above=0.0, unit="m")
        degree = validation.integer("part: order", order, least=1)
        self._material_for("its thickness")
        sheet, names = self._sheet, set(self.body.interfaces) - set(self.lost_interfaces)
        walls = {name: self.interface(name) for name in self.body.interfaces if name in names}
        centers = {name: [*self.body.interfaces[name].center, 0.0] for name in walls}
        return self._built(lambda gmsh: mesh_solid(gmsh, sheet, walls, size), centers, degree)

    def resolved(self, size: float, order: int) -> Domain:
        return self.domain(size, order, turn=MESHES.stressed)

    def _mesh(
        self, gmsh: Any, drawing: Drawing, size: float, degree: int, across: float, turn: float
    ) -> None:
        """Mesh a drawing in gmsh's model, with smaller triangles where gmsh fails."""
        check_size("part: the mesh", drawing, size)
        for factor in MESHES.smaller:
            try:
                local = self._local_sizes(factor * size, across, turn)
                # cells grow from curves on even where none is small, as the last bits of curves may
                # decide that
                mesh_faces(
                    gmsh, drawing, factor * size, order=min(degree, 2), local=local, grow=True
                )
                return
            except ShapeError:
                if factor == MESHES.smaller[-1]:
                    raise
            gmsh.model.remove()
            gmsh.model.add("dolfinx_ffr again")

    def _local_sizes(self, size: float, across: float, turn: float) -> LocalSizes | None:
        """Sizes in narrow members and in notches; None where there are none."""
        fine = max(self.accuracy, MESHES.local_accuracy * size)
        rings = [polygon(loop, fine) for loops in self.outlines for loop in loops]
        # where members are wider than that, triangles are as large as anywhere
        positions, widths = member_widths(rings, 0.1 * size, min(1.5, 1.0 / across) * size)
        sizes = across * widths
        if turn < math.inf:
            notches, radii = zip(*map(_notches, rings), strict=True)
            positions = np.vstack([positions, *notches])
            sizes = np.concatenate([sizes, *(turn * of_ring for of_ring in radii)])
        small = sizes < size
        if not np.any(small):
            return None
        return LocalSizes(positions[small], np.maximum(sizes[small], MESHES.smallest * size))


def _notches(ring: Array) -> tuple[Array, Array]:
    """Where a ring (n, 2) around material on its left bends around a notch, and the radii [m]."""
    sides = np.diff(np.vstack([ring[-1:], ring, ring[:1]]), axis=0)
    lengths = np.linalg.norm(sides, axis=1)
    shorter, angle = np.minimum(lengths[:-1], lengths[1:]), turns(sides)
    bent = (angle < 0.0) & (angle > -MESHES.corner)
    return ring[bent], shorter[bent] / -angle[bent]


def _find(
    lattice: Lattice | None,
    field: Field,
    spacing: float,
    step: float,
    share: float,
    names: Sequence[str],
    web: float,
) -> _Findings:
    """The boundary of a part on rank 0, from its field on a lattice."""
    assert lattice is not None  # on rank 0
    accuracy, segments = CURVES.accuracy * spacing, cut(lattice, field, spacing)
    bounds = boundaries(lattice, segments, field, step, share * spacing, names)

    of_segment = np.where(segments.edge < 0, -1, lattice.interface[segments.edge])
    lengths = _lengths(lattice.points[lattice.chains], lattice.interface, names)
    lengths_of_pieces = _lengths(segments.points[segments.ends], of_segment, names)
    attachment = attached(pieces(bounds, accuracy), lengths, lengths_of_pieces, joined=web > 0.0)

    curves = [i for piece in attachment.pieces for i in piece.curves]
    faces = [face for piece in attachment.pieces for face in piece.faces]
    drawn = bounds.lines.selected(curves, faces)
    around = _outlines(drawn, accuracy)
    loose = []
    for piece in attachment.loose:
        alone = bounds.lines.selected(piece.curves, piece.faces)
        (outline,) = _outlines(alone, accuracy)
        loose.append(LoosePiece(piece.area, piece.center, outline))
    return _Findings(
        pieces=len(around),
        drawing=drawn,
        warnings=attachment.warnings + _polygon_warnings(drawn, names),
        loose=loose,
        lost_interfaces=[name for name, length in lengths_of_pieces.items() if length == 0.0],
        crossing=_crossing(around, CURVES.crossing_accuracy * spacing),
    )


def _lengths(chains: Array, interface: Integers, names: Sequence[str]) -> dict[str, float]:
    """The length of each interface [m], from chains (n, points, 2) and its number on each."""
    along = np.linalg.norm(np.diff(chains, axis=1), axis=2).sum(axis=1)
    on = interface >= 0
    total = np.bincount(interface[on], along[on], len(names))
    return dict(zip(names, total.tolist(), strict=True))


def _outlines(drawing: Drawing, accuracy: float) -> Outlines:
    """The curves around the pieces of a drawing, by polygons of an accuracy [m]."""
    pieces = drawing.outlines(drawing.faces, accuracy)
    return [[drawing.walked(loop) for loop in loops] for loops in pieces]


def _polygon_warnings(drawing: Drawing, names: Sequence[str]) -> list[PartWarning]:
    """Warnings of interfaces that may be round bores, but whose mesh is too coarse for arcs."""
    warnings = []
    for name in names:
        numbers = [i for i, group in enumerate(drawing.groups) if group == name]
        wall = [drawing.curves[i] for i in numbers]
        starts, ends = ({drawing.nodes[i][k] for i in numbers} for k in (0, 1))
        if wall and starts == ends and all(isinstance(side, Line) for side in wall):
            if fit_circle(np.array([side.start for side in wall])) is not None:
                is_coarse = len(wall) < CURVES.few_sides
                remedy = (
                    "give it ten elements around, or order=2"
                    if is_coarse
                    else "draw it as a circle"
                )
                warnings.append(
                    PartWarning(
                        f"the interface {name!r} is a polygon of {len(wall)} sides, with its "
                        f"corners on a circle: if it is a round bore, {remedy}"
                    )
                )
    return warnings


def _polygons(around: Outlines, accuracy: float) -> shapely.MultiPolygon:
    rings = [[ring(loop, accuracy) for loop in loops] for loops in around]
    return shapely.MultiPolygon([shapely.Polygon(outer, holes) for outer, *holes in rings])


def _crossing(around: Outlines, accuracy: float) -> str:
    """Where the curves of outlines cross [mm], empty if they do not."""
    shape = _polygons(around, accuracy)
    if shape.is_valid:
        return ""
    numbers = shapely.is_valid_reason(shape).partition("[")[2].strip("]").split()
    return "(" + ", ".join(f"{1e3 * float(number):.5g}" for number in numbers[:2]) + ")"
