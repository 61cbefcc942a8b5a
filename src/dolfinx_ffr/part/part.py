# SPDX-License-Identifier: MIT
"""The part that a design encloses: smooth closed curves, what they measure, and a mesh that fits.

A field phi(X), positive in material, and the cells that stay solid give

    part = ({phi > 0} in designed cells) and (solid cells),   without pieces that nothing holds.

The zero line is found on a lattice that divides the cells of the mesh (`cut`), as are the places in
which it meets the outline. Splines follow it at less than a given distance (`fitting`). The outline
of the mesh stays what it is: lines and arcs of circles are recognised, other sides of curved cells
become splines, and straight sides of straight cells stay. Sides of straight cells whose vertices
are on a circle become arcs of this circle.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from .. import validation
from ..design import Design
from ..fem import Curve, Domain, Drawing, ElasticMaterial, gmsh_model, mesh_faces, polygon
from ..parallel import on_rank_0
from ..problem import Evaluation, Problem
from .boundary import Side, boundary
from .cut import Field, cut, evaluated
from .export import write
from .lattice import Lattice
from .pieces import Piece, drawing, held, outlines, pieces
from .shape import LoosePiece, PartWarning, Shape
from .verify import Verification, verify
from .widths import member_widths

__all__ = ["Part"]

Array = NDArray[np.float64]

#: How much finer lattices are tried where curves cross
_FINER = (2, 4)
#: Accuracy of the polygons by which crossings are found, in spacings
_CROSSING = 1e-4
#: Largest size of triangles in a member, in units of its width
_ACROSS = 0.7
#: Sizes that are tried where gmsh fails, in units of what was asked for
_SMALLER = (1.0, 0.5, 0.25)
#: Smallest size of triangles, in units of what was asked for
_SMALLEST = 0.03


@dataclass(frozen=True, eq=False)
class _Found:
    """What rank 0 has found, for all ranks."""

    drawing: Drawing  #: Designed and solid faces
    outlines: list[list[list[Curve]]]  #: For each piece the outer loop, then the holes
    on_field: list[bool]  #: Of each curve, whether it is the zero line of the field
    deviation: float  #: Largest distance of curves from the zero line [m]
    said: list[str]  #: Warnings
    loose: list[LoosePiece]  #: What is left out
    lost: list[str]  #: Interfaces without material
    crossing: str  #: Where curves cross, "" if they do not
    groups: list[str]  #: Interface of each curve of all outlines, "" if it is none


class Part(Shape):
    """What is to be made of a design: one flat part, bounded by smooth curves.

    Every rank holds all of it.

    Args:
        domain: Mesh, interfaces and solid cells of the body.
        field: Positive in material and zero on its boundary: a function of positions (n, 2) [m]
            that gives (n,) numbers. Rank 0 evaluates it, all over the body.
        spacing: Length on which the field varies [m], as the distance of knots or a mean element,
            which is the default.
        material: Of the part, for its mass and thickness.
        resolution: Sides of the lattice in one spacing, at least.
        tolerance: Largest distance of a curve from points of the zero line, in spacings.

    Raises:
        TypeError: On every rank, if an argument is of a wrong kind.
        ValueError: On every rank, if a number is out of range, the field is not finite, no material
            touches an interface, or interfaces are not connected by material.

    Warns:
        PartWarning: If loose pieces are left out, an interface has lost material, or only
            interfaces hold pieces together.
    """

    def __init__(
        self,
        domain: Domain,
        field: Field,
        spacing: float | None = None,
        *,
        material: ElasticMaterial | None = None,
        resolution: int = 6,
        tolerance: float = 1e-5,
    ) -> None:
        self.body = validation.instance("part: domain", domain, Domain, "a Domain")
        if domain.dimension == 3:
            raise ValueError("part: the body is in space; Solid is for such bodies")
        validation.function("part: field", field, "positions")
        if spacing is None:
            spacing = float(np.sqrt(domain.area / domain.n_cells_global))
        #: Length on which the field varies [m]
        self.spacing = validation.number("part: spacing", spacing, above=0.0, unit="m")
        steps = validation.integer("part: resolution", resolution, least=2)
        share = validation.number("part: tolerance", tolerance, above=0.0, below=0.1)
        if material is not None:
            validation.implementation(
                "part: material", material, ["thickness"], "an elastic material"
            )
        self.material = material
        self.accuracy = 1e-3 * self.spacing
        self.field = field  #: Positive in the material, of positions (n, 2) [m]
        found = self._found_on(self.spacing / steps, share)
        for finer in _FINER:
            if not found.crossing:
                break
            found = self._found_on(self.spacing / (finer * steps), share)
        if found.crossing:
            raise ValueError(
                f"part: curves cross near {found.crossing} mm, where members or gaps are thinner "
                "than the lattice on which they are looked for; give a larger resolution, or take "
                "a design without hairlines"
            )
        self._found = found
        self.drawing, self.outlines = found.drawing, found.outlines
        every = (curve for loops in self.outlines for loop in loops for curve in loop)
        self._groups = {id(c): group for c, group in zip(every, found.groups, strict=True)}
        for text in found.said:
            warnings.warn(f"part: {text}", PartWarning, stacklevel=2)

    def _found_on(self, step: float, share: float) -> _Found:
        """What is found on a lattice of sides of a length [m]."""
        lattice, names = Lattice.of(self.body, step), list(self.body.interfaces)
        found: _Found = on_rank_0(
            self.body.comm,
            lambda: _find(lattice, self.field, self.spacing, step, share, names),
        )
        return found

    @classmethod
    def of(cls, design: Design, variables: ArrayLike, **options: Any) -> Part:
        """The part that a design encloses; collective.

        Args:
            design: A level set, whose zero line is the boundary, or densities, whose boundary is
                where a smooth mean of them is one half (`density_field`).
            variables: At which it ended, as ``Result.variables``.
            options: Those of `Part`.
        """
        validation.instance("part: design", design, Design, "a LevelSet or a DensityDesign")
        return cls(design.domain, design.level(design.check(variables)), **options)

    # ------------------------------------------------------------------ what it is

    @property
    def deviation(self) -> float:
        """Largest distance of the curves from the zero line of the field [m].

        It is |phi| / |grad phi| at eight points of each span of the splines, and within a tenth of
        a spacing of corners is not looked at.
        """
        return self._found.deviation

    @property
    def loose(self) -> list[LoosePiece]:
        """The pieces that nothing holds and that are left out."""
        return self._found.loose

    @property
    def lost_interfaces(self) -> list[str]:
        """Interfaces that are left without material."""
        return self._found.lost

    # ------------------------------------------------------------------ what becomes of it

    def write(self, path: str | Path, **options: Any) -> list[Path]:
        """Write the part for CAD and machines; see `export.write`.

        Args:
            path: A file ending in .svg, .dxf, .step or .stl, or a folder for all four.
            options: ``unit``, "mm" by default.
        """
        return write(self, path, **options)

    def domain(self, size: float, order: int = 2) -> Domain:
        """A mesh of triangles that fits the part; collective.

        It has the interfaces of the body, with the same centres, and its solid regions. Thin
        members get smaller triangles, about two across.

        Args:
            size: Of the triangles [m].
            order: Polynomial order of the displacements; from 2 on cells at curves are curved.

        Raises:
            ValueError: On every rank, if gmsh cannot mesh the part, or a number is out of range.
        """
        validation.number("part: size", size, above=0.0, unit="m")
        degree = validation.integer("part: order", order, least=1)
        comm = self.body.comm
        with gmsh_model() if comm.rank == 0 else _nothing() as gmsh:
            on_rank_0(comm, lambda: self._build(gmsh, size, degree))
            kept = [n for n in self.body.interfaces if n not in self.lost_interfaces]
            centers = {n: self.body.interfaces[n].center.tolist() for n in kept}
            return Domain.from_gmsh_model(
                comm,
                gmsh.model if gmsh is not None else None,
                interfaces=kept,
                order=degree,
                centers=centers,
            )

    def _build(self, gmsh: Any, size: float, degree: int) -> None:
        for attempt in _SMALLER:
            try:
                local = self._local_size(attempt * size)
                mesh_faces(gmsh, self.drawing, attempt * size, order=min(degree, 2), local=local)
                return
            except ValueError:
                if attempt == _SMALLER[-1]:
                    raise
            gmsh.model.remove()
            gmsh.model.add("dolfinx_ffr again")

    def _local_size(self, size: float) -> Callable[[float, float], float] | None:
        """The largest size at a place: less than the width of the member there."""
        rings = [polygon(loop, self.accuracy) for loops in self.outlines for loop in loops]
        places, widths = member_widths(rings, 0.1 * size, 1.5 * size)
        narrow = _ACROSS * widths < size
        if not np.any(narrow):
            return None
        sizes = np.maximum(_ACROSS * widths[narrow], _SMALLEST * size)
        tree = cKDTree(places[narrow])
        count = min(8, len(sizes))

        def local(x: float, y: float) -> float:
            distance, which = tree.query([x, y], k=count)
            # from a narrow place on cells may grow
            return float(np.min(sizes[which] + 0.3 * distance))

        return local

    def verify(self, problem: Problem, evaluation: Evaluation, **options: Any) -> Verification:
        """Evaluate a problem of one designed body with the part in its place; see `verify`.

        Args:
            problem: With the body that was designed.
            evaluation: Of the design, what was reported.
            options: Those of `verify`.

        Raises:
            ValueError: If the problem has several bodies with a density.
        """
        return verify(problem, {self._only_body(problem): self}, evaluation, **options)


class _nothing:
    """What other ranks have in place of gmsh."""

    def __enter__(self) -> None:
        return None

    def __exit__(self, *_: object) -> None:
        return None


def _find(
    lattice: Lattice | None,
    field: Field,
    spacing: float,
    step: float,
    share: float,
    names: Sequence[str],
) -> _Found:
    assert lattice is not None  # on rank 0
    segments = cut(lattice, field, spacing)
    sides = boundary(lattice, segments, field, step, share * spacing)
    found = pieces(sides, 1e-3 * spacing)
    full = np.zeros(len(names))
    ends = lattice.points[lattice.chains]
    along = np.linalg.norm(np.diff(ends, axis=1), axis=2).sum(axis=1)
    marked = lattice.interface >= 0
    np.add.at(full, lattice.interface[marked], along[marked])
    left = np.zeros(len(names))
    for i in range(len(names)):
        mine = segments.edge >= 0
        mine[mine] = lattice.interface[segments.edge[mine]] == i
        pair = segments.points[segments.ends[mine]]
        left[i] = np.linalg.norm(pair[:, 1] - pair[:, 0], axis=1).sum()
    stay, said = held(
        found, dict(zip(names, full, strict=True)), dict(zip(names, left, strict=True))
    )
    drawn = drawing(sides, stay, names)
    on_field = [sides[i].field for piece in stay for i in piece.sides]
    bounds = outlines(sides, stay, 1e-3 * spacing)
    around = [[[side.curve for side in loop] for loop in loops] for loops in bounds]
    every = [side.interface for loops in bounds for loop in loops for side in loop]
    return _Found(
        drawn,
        around,
        on_field,
        _deviation(drawn, on_field, field, spacing),
        said,
        [_loose(sides, piece, spacing) for piece in found if not piece.interfaces],
        [name for name, length in zip(names, left, strict=True) if length == 0.0],
        _crossing(around, _CROSSING * spacing),
        ["" if i < 0 else names[i] for i in every],
    )


def _crossing(around: list[list[list[Curve]]], fine: float) -> str:
    """Where the curves of outlines cross [mm], "" if they do not."""
    rings = [[polygon(loop, fine) for loop in loops] for loops in around]
    shape = shapely.MultiPolygon([shapely.Polygon(first, rest) for first, *rest in rings])
    if shape.is_valid:
        return ""
    numbers = shapely.is_valid_reason(shape).partition("[")[2].strip("]").split()
    return "(" + ", ".join(f"{1e3 * float(number):.5g}" for number in numbers[:2]) + ")"


def _loose(sides: Sequence[Side], piece: Piece, spacing: float) -> LoosePiece:
    (outline,) = outlines(sides, [piece], 1e-3 * spacing)
    curves = [[side.curve for side in loop] for loop in outline]
    return LoosePiece(piece.area, piece.center, curves)


def _deviation(drawn: Drawing, on_field: Sequence[bool], field: Field, spacing: float) -> float:
    """Largest distance of curves from the zero line of a field [m], corners left out."""
    points, ends = [], []
    for curve, chosen in zip(drawn.curves, on_field, strict=True):
        if chosen:
            knots = curve.breaks()
            t = (knots[:-1, None] + np.diff(knots)[:, None] * (np.arange(8) + 0.5) / 8).ravel()
            points.append(curve.at(t))
            ends += [curve.start, curve.end]
    if not points:
        return 0.0
    x = np.vstack(points)
    x = x[cKDTree(np.array(ends)).query(x)[0] > 0.1 * spacing]
    if not len(x):
        return 0.0
    step = 1e-4 * spacing
    gradient = [
        (evaluated(field, x + step * e) - evaluated(field, x - step * e)) / (2.0 * step)
        for e in np.eye(2)
    ]
    slope = np.maximum(np.hypot(*gradient), 1e-300)
    return float(np.max(np.abs(evaluated(field, x)) / slope))
