# SPDX-License-Identifier: MIT
"""Which curves bound a connected piece of material, and which pieces touch an interface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..fem import Curve, Drawing, Face, ShapeError, connected, directed_faces, enclosed, walked
from .boundary import Side
from .lattice import DESIGN, SOLID

_GROUPS = {DESIGN: "design", SOLID: "solid"}


@dataclass(frozen=True, eq=False)
class Piece:
    """A connected piece of material: its faces, in designed and in solid cells."""

    sides: Sequence[int]  #: Numbers of the sides that bound its faces
    faces: Sequence[Face]  #: Loops of sides; forward where the face is on the left
    interfaces: frozenset[int]  #: Numbers of the interfaces that it touches
    area: float  #: [m^2]
    center: Array  #: (2,) of its area [m]


@dataclass(frozen=True, eq=False)
class Attachment:
    """Which pieces touch an interface, and what a user must know of them."""

    pieces: list[Piece]  #: Those that touch one, which the part is made of
    loose: list[Piece]  #: Those that touch none, which are left out
    loose_warning: str  #: Says that they are left out; empty if there are none
    warnings: list[str]  #: All other warnings


def pieces(sides: Sequence[Side], tolerance: float) -> list[Piece]:
    """The connected pieces between the sides of all regions, the largest first.

    The tolerance is that of the polygons by which holes are found in their faces [m].
    """
    faces, moments = _faces(sides, tolerance)
    faces_at: dict[int, list[int]] = {}  # by the number of a side
    for number, face in enumerate(faces):
        for loop in face.loops:
            for side, _ in loop:
                faces_at.setdefault(side, []).append(number)
    neighbours = np.array([[at[0], at[-1]] for at in faces_at.values()]).reshape(-1, 2)
    label = connected(neighbours, len(faces))

    result = []
    for piece in range(label.max(initial=-1) + 1):
        members = np.flatnonzero(label == piece)
        bounds = sorted({i for f in members for loop in faces[f].loops for i, _ in loop})
        interfaces = frozenset(sides[i].interface for i in bounds) - {-1}
        area, *moment = np.sum([moments[f] for f in members], axis=0)
        center = np.array(moment) / area
        result.append(Piece(bounds, [faces[f] for f in members], interfaces, area, center))
    return sorted(result, key=lambda piece: -piece.area)


def _faces(sides: Sequence[Side], tolerance: float) -> tuple[list[Face], list[Array]]:
    """The faces between sides, and the area and the first moments of each, (3,)."""
    faces, moments = [], []
    for kind, group in _GROUPS.items():
        forward = [i for i, side in enumerate(sides) if side.left == kind]
        backward = [i for i, side in enumerate(sides) if side.right == kind]
        numbers = [(i, True) for i in forward] + [(i, False) for i in backward]
        directed = [sides[i] for i in forward] + [sides[i].reversed() for i in backward]
        for loops in _directed(directed, tolerance):
            faces.append(Face(group, [[numbers[i] for i in loop] for loop in loops]))
            areas = [enclosed([directed[i].curve for i in loop]) for loop in loops]
            moments.append(np.sum(areas, axis=0))
    return faces, moments


def _directed(sides: Sequence[Side], tolerance: float) -> list[list[list[int]]]:
    """The faces on the left of directed sides, by the numbers of these along each loop."""
    curves = [side.curve for side in sides]
    return directed_faces(curves, [side.nodes for side in sides], tolerance)


def outlines(
    drawing: Drawing, faces: Sequence[Face], tolerance: float
) -> list[list[list[tuple[Curve, str]]]]:
    """The boundary of some faces of a drawing together: for each piece the outer loop, then holes.

    Loops are of curves with their groups, the faces on the left. The tolerance is that of the
    polygons by which holes are found in pieces [m].
    """
    sides = outer_sides(faces)
    curves = walked(drawing.curves, sides)
    nodes = [drawing.nodes[i] if forward else drawing.nodes[i][::-1] for i, forward in sides]
    return [
        [[(curves[k], drawing.groups[sides[k][0]]) for k in loop] for loop in loops]
        for loops in directed_faces(curves, nodes, tolerance)
    ]


def outer_sides(faces: Sequence[Face]) -> list[tuple[int, bool]]:
    """The sides that bound one of some faces alone; forward where it is on the left."""
    around = [side for face in faces for loop in face.loops for side in loop]
    walked_both_ways = set(around)
    return [(i, forward) for i, forward in around if (i, not forward) not in walked_both_ways]


def drawing(sides: Sequence[Side], pieces: Sequence[Piece], names: Sequence[str]) -> Drawing:
    """The pieces as faces between numbered curves, with the names of their interfaces."""
    number = {i: n for n, i in enumerate(i for piece in pieces for i in piece.sides)}
    drawn = [sides[i] for i in number]
    return Drawing(
        curves=[side.curve for side in drawn],
        nodes=[side.nodes for side in drawn],
        groups=["" if side.interface < 0 else names[side.interface] for side in drawn],
        faces=[
            Face(face.group, [[(number[i], forward) for i, forward in loop] for loop in face.loops])
            for piece in pieces
            for face in piece.faces
        ],
    )


def attached(
    pieces: Sequence[Piece],
    lengths: Mapping[str, float],
    lengths_of_pieces: Mapping[str, float],
    *,
    joined: bool = False,
) -> Attachment:
    """The pieces that touch an interface; a ValueError where nothing connects interfaces.

    The lengths of interfaces [m], in the body and in the pieces, are by name, in their order. Where
    a web has ``joined`` all pieces, all are attached.
    """
    names = list(lengths)
    in_part = [piece for piece in pieces if joined or piece.interfaces]
    if not any(piece.interfaces for piece in in_part):
        raise ShapeError(
            f"part: no piece of the material touches an interface ({', '.join(map(repr, names))}); "
            "is the field positive in the material?"
        )
    loose_warning, warnings = "", []
    loose = [piece for piece in pieces if not (joined or piece.interfaces)]
    if loose:
        listed = ", ".join(f"{1e6 * p.area:.3g} mm2 near {_point(p.center)}" for p in loose[:5])
        ellipsis = ", ..." if len(loose) > 5 else ""
        loose_warning = (
            f"{len(loose)} loose pieces touch no interface and are left out: {listed}{ellipsis}; "
            "the part has less material than the design"
        )
    remaining = {name: lengths_of_pieces[name] / lengths[name] for name in names}
    if lost := [name for name, share in remaining.items() if share == 0.0]:
        warnings.append(
            f"the interfaces {', '.join(map(repr, lost))} are left without material; make the "
            "cells at them solid, or leave them out of the mechanism"
        )
    if cut := {name: share for name, share in remaining.items() if 0.0 < share < 1.0 - 1e-6}:
        listed = ", ".join(f"{100 * share:.3g} % of {name!r}" for name, share in cut.items())
        warnings.append(
            f"of some interfaces only a share is left, {listed}; make the cells at them solid to "
            "keep all of it"
        )
    if not joined:
        _check_connected(in_part, names)
    if not joined and len(in_part) > 1:
        warnings.append(
            f"the material is in {len(in_part)} pieces that only interfaces hold together, the "
            f"smallest of {1e6 * in_part[-1].area:.3g} mm2 near {_point(in_part[-1].center)}"
        )
    return Attachment(in_part, loose, loose_warning, warnings)


def _check_connected(pieces: Sequence[Piece], names: Sequence[str]) -> None:
    """Refuse pieces that all touch interfaces but do not connect them."""
    pairs = np.array([(i, len(names) + k) for k, p in enumerate(pieces) for i in p.interfaces])
    label = connected(pairs, len(names) + len(pieces))
    groups: dict[int, list[str]] = {}
    for i in np.unique(pairs[:, 0]):
        groups.setdefault(int(label[i]), []).append(repr(names[i]))
    if len(groups) > 1:
        listed = " with ".join(" and ".join(group) for group in groups.values())
        raise ShapeError(
            f"part: no material connects the interfaces {listed}; the design is torn, gray, or "
            "too thin for the distance at which the field is given (more iterations, thicker "
            "members)"
        )


def _point(position: Array) -> str:
    return f"({1e3 * position[0]:.4g}, {1e3 * position[1]:.4g}) mm"
