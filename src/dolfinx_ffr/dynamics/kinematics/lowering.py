# SPDX-License-Identifier: MIT
"""Rows and forces stated in vectors as the kernels take them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...body import BodyMarker, VolumeIntegrals
from ...mechanism import (
    BodyPoint,
    BodyVector,
    Element,
    Ground,
    Load,
    Marker,
    Moving,
    Row,
    SpringRow,
    Undeformed,
    VectorKind,
    marker_name,
)
from .carried import padded_stiffening


@dataclass(frozen=True)
class _Entry:
    """A row or a spring as the kernels take it."""

    row: Row
    #: States its right-hand side over time.
    source: Row | SpringRow
    #: Name of the joint or the force.
    label: str
    #: Angle of the vectors minus the angle of the markers [rad].
    offset: float = 0.0

    def tabulate(self, instants: Array) -> Array:
        """Right-hand side over time, shape (instants, 3)."""
        table = self.source.tabulate(instants, self.label)
        table[:, 0] -= self.offset
        return table


@dataclass
class Lowering:
    """Vectors, rows, springs and loads of a mechanism in space, in the order of their numbers."""

    d: ClassVar[int] = 3  #: Components of a vector.
    sides: ClassVar[int] = 6  #: Most vectors of a row.

    bodies: Mapping[str, VolumeIntegrals]
    undeformed: Undeformed
    #: Places of each force among springs and loads, by name of the force.
    forces: dict[str, list[int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Begin without vectors, rows and loads."""
        self._vectors: list[BodyVector] = []
        #: Vectors of the twin mechanism in the same places
        self._twins: list[BodyVector] = []
        self._prescribed: list[tuple[BodyVector, str]] = []
        self._slots: dict[int, int] = {}
        self._rows: list[_Entry] = []
        self._loads: list[tuple[Load, str]] = []
        self._springs = 0
        self._sides: list[list[int]] = []
        self._targets: list[int] = []
        self._axes: list[list[int]] = []

    @property
    def prescribed(self) -> list[tuple[Ground | Moving, str]]:
        """Markers of vectors that move as prescribed, with the first users of these."""
        return [(vector.marker, user) for vector, user in self._prescribed]  # type: ignore[misc]

    @property
    def markers(self) -> dict[BodyPoint, int]:
        """Number of each marker of a body that is used, by (body, marker)."""
        used = dict.fromkeys(v.marker for v in self._vectors if isinstance(v.marker, tuple))
        return {marker: number for number, marker in enumerate(used)}

    def enter(
        self,
        rows: Sequence[tuple[Row, str]],
        elements: Sequence[tuple[Element, str]],
        twins: tuple[Sequence[tuple[Row, str]], Sequence[tuple[Element, str]]] | None = None,
    ) -> None:
        """Take all rows and forces, with the names of their joints and forces.

        Vectors that are alike become one, unless they are not in the twin of the mechanism.
        """
        springs, self._loads = _springs_and_loads(elements)
        other_rows, other_elements = twins or (rows, elements)
        other_springs, other_loads = _springs_and_loads(other_elements)
        entered: list[tuple[Row, Row | SpringRow, str, str]]
        entered = [(row, row, label, f"joint {label!r}") for row, label in rows]
        entered += [(spring.row, spring, label, f"force {label!r}") for spring, label in springs]
        twin_rows = [row for row, _ in other_rows] + [spring.row for spring, _ in other_springs]
        self._springs = len(springs)
        counts = [len(entered), len(self._loads)]
        if counts != [len(twin_rows), len(other_loads)]:
            raise ValueError(
                "the rows of joints, springs or loads of the mechanism change with its "
                "parameters; their number and kind must not change"
            )
        for (row, source, label, user), twin_row in zip(entered, twin_rows, strict=True):
            lowered, offset = self._own_row(row, user)
            self._rows.append(_Entry(lowered, source, label, offset))
            beside = lowered if twin_row is row else self._own_row(twin_row, user)[0]
            pairs = zip(lowered.vectors, beside.vectors, strict=True)
            numbers = [self._place(*pair, user) for pair in pairs]
            self._sides.append(numbers + [-1] * (self.sides - len(numbers)))
        for (load, label), (twin, _) in zip(self._loads, other_loads, strict=True):
            user = f"force {label!r}"
            self._check_load(load, user)
            self._targets.append(self._place(load.target, twin.target, user))
            pairs = zip(load.axes[: self.d], twin.axes[: self.d], strict=True)
            axes = [self._place(*pair, user) for pair in pairs]
            self._axes.append(axes or [-1] * self.d)
        self.forces = {label: [] for _, label in elements}
        for number, (_, label) in enumerate([*springs, *self._loads]):
            self.forces[label].append(number)

    def tabulate(self, instants: Array) -> dict[str, Array]:
        """Tables over time, by name of the field of ModelArrays."""
        by_marker: dict[int, tuple[Array, Array]] = {}
        prescribed = np.zeros((instants.size, len(self._prescribed), 3, self.d))
        turns = np.zeros((instants.size, len(self._prescribed), 3))
        for slot, (vector, user) in enumerate(self._prescribed):
            marker = vector.marker
            assert isinstance(marker, Ground | Moving)
            if id(marker) not in by_marker:
                times = instants[:1] if isinstance(marker, Ground) else instants
                by_marker[id(marker)] = self._tabulated(marker, times, user)
            table, turns[:, slot] = by_marker[id(marker)]
            prescribed[:, slot] = self._prescribed_vector(vector, table)
        drives = [row.tabulate(instants) for row in self._rows]
        loads = [
            self._components(load, instants, label)[:, : self.d] for load, label in self._loads
        ]
        return {
            "prescribed": prescribed,
            "prescribed_turn": turns,
            "drive": _stacked(drives, (instants.size, 3)),
            "load_table": _stacked(loads, (instants.size, self.d)),
        }

    def _tabulated(
        self, marker: Ground | Moving, instants: Array, where: str
    ) -> tuple[Array, Array]:
        """Position and axes with derivatives, (instants, 3, 4, 3), and turns (instants, 3).

        In the plane position and angle with derivatives, (instants, 3, 3).
        """
        return marker.tabulate_in_space(instants, where), marker.turns_in_space(instants, where)

    def _prescribed_vector(self, vector: BodyVector, table: Array) -> Array:
        """A vector with its derivatives, (instants, 3, d), of a marker as tabulated above."""
        if vector.kind == VectorKind.POINT:
            return np.asarray(table[:, :, 0, : self.d])
        return np.einsum("k,tdki->tdi", vector.components, table[:, :, 1:, : self.d])

    def _own_row(self, row: Row, user: str) -> tuple[Row, float]:
        """A row as the kernels take it, and the angle of its vectors minus the markers' angle."""
        return row, 0.0

    def _check_load(self, load: Load, user: str) -> None:
        """Refuse a load that does not exist."""

    def _components(self, load: Load, instants: Array, label: str) -> Array:
        """Components of a load over time, (instants, 3); only the first d are used."""
        return load.tabulate(instants, label)

    def _set_shapes(self, vector: BodyVector, point: BodyMarker, shapes: Array) -> None:
        """Set b(0) and its derivatives (d, modes + 1) of a direction or a spin."""
        if vector.kind == VectorKind.SPIN:
            shapes[:, 1:] = point.rotation
            return
        n = np.array(vector.components)
        n = n if point.axes is None else point.axes @ n
        shapes[:, 0], shapes[:, 1:] = n, np.cross(point.rotation, n, axisa=0, axisc=0)

    def arrays(self, modes: int) -> dict[str, NDArray]:
        """Flat arrays by name of the field of ModelArrays."""
        rows, d = [entry.row for entry in self._rows], self.d
        springs = [entry.source for entry in self._rows[len(self._rows) - self._springs :]]
        law = [(s.stiffness, s.damping) for s in springs if isinstance(s, SpringRow)]
        normals = np.array([row.normal for row in rows], dtype=np.float64).reshape(-1, 3)
        return {
            **self._vector_arrays(modes),
            "kind": np.array([row.kind for row in rows], dtype=np.int64),
            "side": np.array(self._sides, dtype=np.int64).reshape(-1, self.sides),
            "normal": np.ascontiguousarray(normals[:, :d]),
            "ratio": np.array([row.ratio for row in rows], dtype=np.float64),
            "start_angles": self.start_angles,
            "law": np.array(law, dtype=np.float64).reshape(-1, 2),
            "load_vector": np.array(self._targets, dtype=np.int64),
            "load_axes": np.array(self._axes, dtype=np.int64).reshape(-1, d),
        }

    @property
    def start_angles(self) -> Array:
        """Angles of rows and springs in the placements, shape (rows and springs, 2) [rad]."""
        angles = [(entry.row.start_angle, 0.0) for entry in self._rows]
        return np.array(angles, dtype=np.float64).reshape(-1, 2)

    def _place(self, vector: BodyVector, twin: BodyVector, user: str) -> int:
        """Number of a vector and its twin, each pair entered once."""
        for number, pair in enumerate(zip(self._vectors, self._twins, strict=True)):
            if _alike(pair[0], vector) and _alike(pair[1], twin):
                return number
        if not isinstance(vector.marker, tuple):
            self._slots[len(self._vectors)] = len(self._prescribed)
            self._prescribed.append((vector, f"{user}, marker {marker_name(vector.marker)!r}"))
        self._vectors.append(vector)
        self._twins.append(twin)
        return len(self._vectors) - 1

    def _vector_arrays(self, modes: int) -> dict[str, NDArray]:
        """Arrays of the vectors, by name of the field of ModelArrays."""
        count, names, markers = len(self._vectors), list(self.bodies), self.markers
        body, slot, marker, stiffened = (np.full(count, -1, dtype=np.int64) for _ in range(4))
        bends: list[Array] = []
        d = self.d
        shapes = np.zeros((count, d, modes + 1))
        for number, vector in enumerate(self._vectors):
            if not isinstance(vector.marker, tuple):
                slot[number] = self._slots[number]
                continue
            integrals = self.bodies[vector.marker[0]]
            point, r = integrals.markers[vector.marker[1]], integrals.modes
            body[number], marker[number] = names.index(vector.marker[0]), markers[vector.marker]
            if vector.kind == VectorKind.POINT:
                shapes[number, :, : r + 1] = point.basis
                if point.stiffening is not None and r:
                    stiffened[number] = len(bends)
                    bends.append(padded_stiffening(point.stiffening, modes))
            else:
                self._set_shapes(vector, point, shapes[number, :, : r + 1])
        return {
            "vector_body": body,
            "vector_slot": np.maximum(slot, 0),
            "vector_kind": np.array([vector.kind for vector in self._vectors], dtype=np.int64),
            "vector_marker": marker,
            "shapes": shapes,
            "vector_stiffened": stiffened,
            "vector_stiffening": np.array(bends).reshape(len(bends), d, modes, modes),
        }


def same(a: Marker, b: Marker) -> bool:
    """Whether two markers are one."""
    return a is b or a == b


def _alike(a: BodyVector, b: BodyVector) -> bool:
    """Whether two vectors are one."""
    return (a.kind, a.components) == (b.kind, b.components) and same(a.marker, b.marker)


def _springs_and_loads(
    elements: Sequence[tuple[Element, str]],
) -> tuple[list[tuple[SpringRow, str]], list[tuple[Load, str]]]:
    """Springs and loads of all forces, with the names of the forces."""
    springs = [(spring, label) for element, label in elements for spring in element.springs]
    return springs, [(load, label) for element, label in elements for load in element.loads]


def _stacked(tables: Sequence[Array], shape: tuple[int, ...]) -> Array:
    """Tables over time, of shape (instants, ...), side by side along a second axis."""
    if not tables:
        return np.zeros((shape[0], 0, *shape[1:]))
    return np.ascontiguousarray(np.stack(tables, axis=1))
