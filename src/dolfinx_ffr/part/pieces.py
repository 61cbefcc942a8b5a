# SPDX-License-Identifier: MIT
"""Which curves bound a connected piece of material, and which pieces touch an interface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..fem import Drawing, Face, ShapeError, connected, directed_loops, enclosed, nested
from .boundary import Side
from .cut import DESIGN, SOLID

_GROUPS = {DESIGN: "design", SOLID: "solid"}


@dataclass(frozen=True, eq=False)
class Piece:
    """A connected piece of material: its faces, in designed and in solid cells."""

    sides: Sequence[int]  #: Numbers of the sides that bound its faces
    faces: Sequence[Face]  #: Loops of sides; forward where the face is on the left
    interfaces: frozenset[int]  #: Numbers of the interfaces that it touches
    area: float  #: [m^2]
    center: Array  #: (2,) of its area [m]


def pieces(sides: Sequence[Side], tolerance: float) -> list[Piece]:
    """The connected pieces between the sides of all regions, the largest first.

    The tolerance is that of the polygons by which holes are found in their faces [m].
    """
    faces: list[tuple[Face, Array]] = []
    for kind, group in _GROUPS.items():
        forward = [i for i, side in enumerate(sides) if side.left == kind]
        backward = [i for i, side in enumerate(sides) if side.right == kind]
        around = [sides[i] for i in forward] + [sides[i].reversed() for i in backward]
        numbers = [(i, True) for i in forward] + [(i, False) for i in backward]
        closed = _loops(around)
        curves = [[around[i].curve for i in loop] for loop in closed]
        for nest in nested(curves, tolerance):
            moments = np.sum([enclosed(curves[n]) for n in nest], axis=0)
            faces.append((Face(group, [[numbers[i] for i in closed[n]] for n in nest]), moments))
    of_side: dict[int, list[int]] = {}
    for f, (face, _) in enumerate(faces):
        for i in (i for loop in face.loops for i, _ in loop):
            of_side.setdefault(i, []).append(f)
    pairs = np.array([[fs[0], fs[-1]] for fs in of_side.values()]).reshape(-1, 2)
    label = connected(pairs, len(faces))
    found = []
    for number in range(label.max(initial=-1) + 1):
        mine = np.flatnonzero(label == number)
        moments = np.sum([faces[f][1] for f in mine], axis=0)
        around_it = sorted({i for f in mine for loop in faces[f][0].loops for i, _ in loop})
        touched = frozenset(sides[i].interface for i in around_it) - {-1}
        center = moments[1:] / moments[0]
        found.append(Piece(around_it, [faces[f][0] for f in mine], touched, moments[0], center))
    return sorted(found, key=lambda piece: -piece.area)


def _loops(sides: Sequence[Side]) -> list[list[int]]:
    """Numbers of directed sides along each closed loop; a node alone does not join material."""
    return directed_loops([side.curve for side in sides], [side.nodes for side in sides])


def outlines(
    sides: Sequence[Side], kept: Sequence[Piece], tolerance: float
) -> list[list[list[Side]]]:
    """The boundary of pieces: for each the outer loop, then its holes."""
    walked = [each for p in kept for face in p.faces for loop in face.loops for each in loop]
    both = set(walked)
    # what bounds one face alone, from this face
    outer = [
        sides[i] if forward else sides[i].reversed()
        for i, forward in walked
        if (i, not forward) not in both
    ]
    closed = [[outer[i] for i in loop] for loop in _loops(outer)]
    nests = nested([[side.curve for side in loop] for loop in closed], tolerance)
    return [[closed[i] for i in nest] for nest in nests]


def drawing(sides: Sequence[Side], kept: Sequence[Piece], names: Sequence[str]) -> Drawing:
    """The pieces as faces between numbered curves, with the names of their interfaces."""
    number = {i: n for n, i in enumerate(i for piece in kept for i in piece.sides)}
    chosen = [sides[i] for i in number]
    return Drawing(
        curves=[side.curve for side in chosen],
        nodes=[side.nodes for side in chosen],
        groups=["" if side.interface < 0 else names[side.interface] for side in chosen],
        faces=[
            Face(face.group, [[(number[i], way) for i, way in loop] for loop in face.loops])
            for piece in kept
            for face in piece.faces
        ],
    )


def attached(
    found: Sequence[Piece],
    lengths: Mapping[str, float],
    kept: Mapping[str, float],
    *,
    joined: bool = False,
) -> tuple[list[Piece], str, list[str]]:
    """The pieces that touch an interface, what is said of the others, and other warnings.

    A ValueError where nothing connects interfaces. The lengths of interfaces [m] in the body and in
    the pieces are by name, in their order. Where a web has ``joined`` all pieces, all stay.
    """
    names = list(lengths)
    stay = [piece for piece in found if joined or piece.interfaces]
    if not any(piece.interfaces for piece in stay):
        raise ShapeError(
            f"part: no piece of the material touches an interface ({', '.join(map(repr, names))}); "
            "is the field positive in the material?"
        )
    left_out, said = "", []
    if loose := [piece for piece in found if piece not in stay]:
        shown = ", ".join(f"{1e6 * p.area:.3g} mm2 near {_point(p.center)}" for p in loose[:5])
        more = ", ..." if len(loose) > 5 else ""
        left_out = (
            f"{len(loose)} loose pieces touch no interface and are left out: {shown}{more}; the "
            "part has less material than the design"
        )
    if lost := [name for name in names if kept[name] == 0.0]:
        said.append(
            f"the interfaces {', '.join(map(repr, lost))} are left without material; make the "
            "cells at them solid, or leave them out of the mechanism"
        )
    if cut := [n for n in names if 0.0 < kept[n] < (1.0 - 1e-6) * lengths[n]]:
        shown = ", ".join(f"{100 * kept[n] / lengths[n]:.3g} % of {n!r}" for n in cut)
        said.append(
            f"of some interfaces only a share is left, {shown}; make the cells at them solid to "
            "keep all of it"
        )
    if joined:
        return stay, left_out, said
    pairs = np.array([(i, len(names) + k) for k, p in enumerate(stay) for i in p.interfaces])
    label = connected(pairs, len(names) + len(stay))
    groups: dict[int, list[str]] = {}
    for i in np.unique(pairs[:, 0]):
        groups.setdefault(int(label[i]), []).append(repr(names[i]))
    if len(groups) > 1:
        shown = " with ".join(" and ".join(group) for group in groups.values())
        raise ShapeError(
            f"part: no material connects the interfaces {shown}; the design is torn, gray, or "
            "too thin for the distance at which the field is given (more iterations, thicker "
            "members)"
        )
    if len(stay) > 1:
        said.append(
            f"the material is in {len(stay)} pieces that only interfaces hold together, the "
            f"smallest of {1e6 * stay[-1].area:.3g} mm2 near {_point(stay[-1].center)}"
        )
    return stay, left_out, said


def _point(where: Array) -> str:
    return f"({1e3 * where[0]:.4g}, {1e3 * where[1]:.4g}) mm"
