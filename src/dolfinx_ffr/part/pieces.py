# SPDX-License-Identifier: MIT
"""Which curves bound a connected piece of material, and which pieces touch an interface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..fem import Face, ShapeError, connected
from .boundary import Boundaries
from .enclosed import LoosePieceWarning, PartWarning
from .lattice import DESIGN, SOLID

_GROUPS = {DESIGN: "design", SOLID: "solid"}


@dataclass(frozen=True, eq=False)
class Piece:
    """A connected piece of material: its faces, in designed and in solid cells."""

    curves: Sequence[int]  #: Numbers of the curves that bound its faces
    faces: Sequence[Face]
    interfaces: frozenset[str]  #: Names of the interfaces that it touches
    area: float  #: [m^2]
    center: Array  #: (2,) of its area [m]


@dataclass(frozen=True, eq=False)
class Attachment:
    """Which pieces touch an interface, and what a user must know of them."""

    pieces: list[Piece]  #: Those that touch one, which the part is made of
    loose: list[Piece]  #: Those that touch none, which are left out
    warnings: list[PartWarning]  #: The first says that loose ones are left out


def pieces(bounds: Boundaries, tolerance: float) -> list[Piece]:
    """The connected pieces between the boundaries of all regions, the largest first.

    The tolerance is that of the polygons by which holes are found in their faces [m].
    """
    lines = bounds.lines
    faces = [
        Face(group, loops)
        for kind, group in _GROUPS.items()
        for loops in lines.faces_beside(bounds.around(kind), tolerance)
    ]
    moments = [lines.moments(face.loops) for face in faces]

    faces_at: dict[int, list[int]] = {}  # by the number of a curve
    for number, face in enumerate(faces):
        for loop in face.loops:
            for curve, _ in loop:
                faces_at.setdefault(curve, []).append(number)
    neighbours = np.array([[at[0], at[-1]] for at in faces_at.values()]).reshape(-1, 2)
    label = connected(neighbours, len(faces))

    result = []
    for piece in range(label.max(initial=-1) + 1):
        members = np.flatnonzero(label == piece)
        curves = sorted({i for f in members for loop in faces[f].loops for i, _ in loop})
        interfaces = frozenset(lines.groups[i] for i in curves) - {""}
        area, *moment = np.sum([moments[f] for f in members], axis=0)
        center = np.array(moment) / area
        result.append(Piece(curves, [faces[f] for f in members], interfaces, area, center))
    return sorted(result, key=lambda piece: -piece.area)


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
    warnings: list[PartWarning] = []
    loose = [piece for piece in pieces if not (joined or piece.interfaces)]
    if loose:
        listed = ", ".join(f"{1e6 * p.area:.3g} mm2 near {_point(p.center)}" for p in loose[:5])
        ellipsis = ", ..." if len(loose) > 5 else ""
        sentence = (
            f"{len(loose)} loose pieces touch no interface and are left out: {listed}{ellipsis}; "
            "the part has less material than the design"
        )
        warnings.append(LoosePieceWarning(sentence))

    remaining = {name: lengths_of_pieces[name] / lengths[name] for name in names}
    sentences = []
    if lost := [name for name, share in remaining.items() if share == 0.0]:
        sentences.append(
            f"the interfaces {', '.join(map(repr, lost))} have no material; keep the cells along "
            "them solid, or leave them out of the mechanism"
        )
    if cut := {name: share for name, share in remaining.items() if 0.0 < share < 1.0 - 1e-6}:
        listed = ", ".join(f"{100 * share:.3g} % of {name!r}" for name, share in cut.items())
        sentences.append(
            f"some interfaces have lost a share of their material, {listed}; keep the cells along "
            "them solid"
        )
    if not joined:
        _check_connected(in_part, names)
    if not joined and len(in_part) > 1:
        sentences.append(
            f"the material is in {len(in_part)} pieces that only interfaces hold together, the "
            f"smallest of {1e6 * in_part[-1].area:.3g} mm2 near {_point(in_part[-1].center)}"
        )
    return Attachment(in_part, loose, [*warnings, *map(PartWarning, sentences)])


def _check_connected(pieces: Sequence[Piece], names: Sequence[str]) -> None:
    """Refuse pieces that all touch interfaces but do not connect them."""
    number = {name: i for i, name in enumerate(names)}
    pairs = np.array(
        [
            (number[name], len(names) + k)
            for k, piece in enumerate(pieces)
            for name in piece.interfaces
        ]
    )
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
