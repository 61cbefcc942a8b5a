# SPDX-License-Identifier: MIT
"""A mechanism in space and its bodies as flat arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...body import VolumeIntegrals
from ...mechanism import (
    BodyVector,
    Ground,
    Mechanism,
    Moving,
    SpatialLoad,
    SpatialRow,
    SpatialSpring,
    UndeformedInSpace,
    VectorKind,
    marker_name,
)
from ..body_matrices import inverse_mass, padded_stiffening
from ..tables import TimeTables, free_fall
from .arrays import RIGID, SIDES, ModelArrays

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SpatialTables(TimeTables):
    """What a mechanism in space prescribes over time."""

    #: Vectors that move as prescribed, with their first users for messages.
    vectors: Sequence[tuple[BodyVector, str]] = ()
    #: Springs, with their names.
    springs: Sequence[tuple[SpatialSpring, str]] = ()
    #: Loads, with their names.
    loads: Sequence[tuple[SpatialLoad, str]] = ()

    def tabulate(self, instants: Array) -> dict[str, Any]:
        instants = self.beside_jumps(instants)
        known: dict[int, Array] = {}
        prescribed = np.zeros((instants.size, len(self.vectors), 3, 3))
        for slot, (vector, where) in enumerate(self.vectors):
            marker = vector.marker
            assert isinstance(marker, Ground | Moving)
            if id(marker) not in known:
                known[id(marker)] = marker.tabulate_in_space(instants, where)
            table = known[id(marker)]
            if vector.kind == VectorKind.POINT:
                prescribed[:, slot] = table[:, :, 0]
            else:
                prescribed[:, slot] = np.einsum("k,tdki->tdi", vector.components, table[:, :, 1:])
        rows = [row.tabulate(instants, label) for row, label in self.rows]
        rows += [spring.tabulate(instants, label) for spring, label in self.springs]
        loads = [load.tabulate(instants, label) for load, label in self.loads]
        return {
            "gravity": free_fall(self.mechanism, instants, 3),
            "prescribed": prescribed,
            "drive": _stack(rows, instants.size),
            "load_table": _stack(loads, instants.size),
        }


@dataclass
class _Vectors:
    """Vectors of markers, each entered once."""

    bodies: Mapping[str, VolumeIntegrals]
    entries: list[BodyVector] = field(default_factory=list)
    prescribed: list[tuple[BodyVector, str]] = field(default_factory=list)

    def place(self, vector: BodyVector, user: str) -> int:
        """Number of a vector."""
        for number, known in enumerate(self.entries):
            same = known.marker is vector.marker or known.marker == vector.marker
            if same and (known.kind, known.components) == (vector.kind, vector.components):
                return number
        if not isinstance(vector.marker, tuple):
            self.prescribed.append((vector, f"{user}, marker {marker_name(vector.marker)!r}"))
        self.entries.append(vector)
        return len(self.entries) - 1

    def arrays(self, modes: int, markers: Mapping[tuple[str, str], int]) -> dict[str, NDArray]:
        """Flat arrays by name of the field of ModelArrays."""
        count, names = len(self.entries), list(self.bodies)
        body, slot, marker, stiffened = (np.full(count, -1, dtype=np.int64) for _ in range(4))
        bends: list[Array] = []
        shapes = np.zeros((count, 3, modes + 1))
        for number, vector in enumerate(self.entries):
            if not isinstance(vector.marker, tuple):
                slot[number] = [known for known, _ in self.prescribed].index(vector)
                continue
            integrals = self.bodies[vector.marker[0]]
            point, r = integrals.markers[vector.marker[1]], integrals.modes
            body[number], marker[number] = names.index(vector.marker[0]), markers[vector.marker]
            if vector.kind == VectorKind.POINT:
                shapes[number, :, : r + 1] = point.basis
                if point.stiffening is not None and r:
                    stiffened[number] = len(bends)
                    bends.append(padded_stiffening(point.stiffening, modes))
            elif vector.kind == VectorKind.DIRECTION:
                n = np.array(vector.components)
                n = n if point.axes is None else point.axes @ n
                shapes[number, :, 0] = n
                shapes[number, :, 1 : r + 1] = np.cross(point.rotation, n, axisa=0, axisc=0)
            else:
                shapes[number, :, 1 : r + 1] = point.rotation
        return {
            "vector_body": body,
            "vector_slot": np.maximum(slot, 0),
            "vector_kind": np.array([vector.kind for vector in self.entries], dtype=np.int64),
            "vector_marker": marker,
            "shapes": shapes,
            "vector_stiffened": stiffened,
            "vector_stiffening": np.array(bends).reshape(len(bends), 3, modes, modes),
        }


@dataclass(frozen=True, eq=False)
class Assembly:
    """What becomes of a mechanism in space."""

    arrays: ModelArrays
    #: Number of each marker of a body that is used, by (body, marker).
    markers: dict[tuple[str, str], int]
    #: Rows of each joint in the multipliers, by name of the joint.
    joints: dict[str, slice]
    #: Places of each force among springs and loads, by name of the force.
    forces: dict[str, list[int]]
    #: What is prescribed over time.
    tables: SpatialTables


def assemble(
    mechanism: Mechanism,
    bodies: Mapping[str, VolumeIntegrals],
    effective: Mapping[str, VolumeIntegrals],
    instants: Array,
) -> Assembly:
    """Compile a mechanism in space to flat arrays.

    Args:
        mechanism: The mechanism.
        bodies: Volume integrals of all bodies, by name.
        effective: The same with their point masses.
        instants: Times, shape (instants,) [s].

    Raises:
        ValueError: If a joint or a force has no meaning in space, or its markers coincide where
            they must not.
    """
    positions = {
        (name, point): marker.position
        for name, integrals in bodies.items()
        for point, marker in integrals.markers.items()
    }
    own_axes = {
        (name, point): marker.axes
        for name, integrals in bodies.items()
        for point, marker in integrals.markers.items()
        if marker.axes is not None
    }
    undeformed = UndeformedInSpace(mechanism.placements, positions, instants[:1], own_axes)
    vectors = _Vectors(bodies)
    rows: list[tuple[SpatialRow, str]] = []
    joints: dict[str, slice] = {}
    sides: list[list[int]] = []

    def enter(row: SpatialRow, user: str) -> None:
        numbers = [vectors.place(vector, user) for vector in row.vectors]
        sides.append(numbers + [-1] * (SIDES - len(numbers)))

    for label, joint in zip(mechanism.joint_names, mechanism.joints, strict=True):
        own = joint.spatial_rows(label, undeformed)
        joints[label] = slice(len(rows), len(rows) + len(own))
        rows += [(row, label) for row in own]
        for row in own:
            enter(row, f"joint {label!r}")
    springs: list[tuple[SpatialSpring, str]] = []
    loads: list[tuple[SpatialLoad, str]] = []
    for label, force in zip(mechanism.force_names, mechanism.forces, strict=True):
        element = force.spatial_element(label, undeformed)
        springs += [(spring, label) for spring in element.springs]
        loads += [(load, label) for load in element.loads]
    for spring, label in springs:
        enter(spring.row, f"force {label!r}")
    targets = [vectors.place(load.target, f"force {label!r}") for load, label in loads]
    axes = [
        [vectors.place(axis, f"force {label!r}") for axis in load.axes] or [-1] * 3
        for load, label in loads
    ]
    forces: dict[str, list[int]] = {label: [] for label in mechanism.force_names}
    for number, label in enumerate([*(name for _, name in springs), *(name for _, name in loads)]):
        forces[label].append(number)
    used = list(dict.fromkeys(v.marker for v in vectors.entries if isinstance(v.marker, tuple)))
    markers = {marker: number for number, marker in enumerate(used)}
    arrays = _body_arrays(mechanism, effective)
    modes = int(arrays["modes"].max())
    every = [row for row, _ in rows] + [spring.row for spring, _ in springs]
    tables = SpatialTables(
        mechanism,
        [(vector.marker, where) for vector, where in vectors.prescribed],  # type: ignore[misc]
        rows,
        [*springs, *loads],
        vectors.prescribed,
        springs,
        loads,
    )
    flat = ModelArrays(
        **arrays,
        **tables.tabulate(instants),
        **vectors.arrays(modes, markers),
        kind=np.array([row.kind for row in every], dtype=np.int64),
        side=np.array(sides, dtype=np.int64).reshape(-1, SIDES),
        normal=np.array([row.normal for row in every], dtype=np.float64).reshape(-1, 3),
        ratio=np.array([row.ratio for row in every], dtype=np.float64),
        law=np.array([(s.stiffness, s.damping) for s, _ in springs], dtype=np.float64).reshape(
            -1, 2
        ),
        load_vector=np.array(targets, dtype=np.int64),
        load_axes=np.array(axes, dtype=np.int64).reshape(-1, 3),
    )
    return Assembly(flat, markers, joints, forces, tables)


def _stack(tables: Sequence[Array], instants: int) -> Array:
    """Tables (instants, 3) side by side along a second axis, which may be empty."""
    if not tables:
        return np.zeros((instants, 0, 3))
    return np.ascontiguousarray(np.stack(tables, axis=1))


def _body_arrays(mechanism: Mechanism, bodies: Mapping[str, VolumeIntegrals]) -> dict[str, NDArray]:
    """Padded arrays of all bodies, by name of the field of ModelArrays."""
    count, modes = len(bodies), max(integrals.modes for integrals in bodies.values())
    out = {
        "modes": np.array([integrals.modes for integrals in bodies.values()], dtype=np.int64),
        "mass": np.array([integrals.mass for integrals in bodies.values()]),
        "S": np.zeros((count, modes + 1, 3)),
        "P": np.zeros((count, modes + 1, 9, modes + 1)),
        "pairs": np.zeros((count, 10, modes * modes)),
        "K": np.zeros((count, modes, modes)),
        "alpha": np.zeros(count),
        "beta": np.zeros(count),
        "stiffened": np.array([bool(b.stiffening) for b in bodies.values()], dtype=np.int64),
        "stiffening": np.zeros((0, 12, modes, modes)),
        "inverse": np.zeros((count, modes + RIGID, modes + RIGID)),
    }
    if np.any(out["stiffened"]):
        out["stiffening"] = np.zeros((count, 12, modes, modes))
    for b, (name, integrals) in enumerate(bodies.items()):
        r, P = integrals.modes, integrals.P
        assert P is not None
        if integrals.stiffening:
            out["stiffening"][b] = padded_stiffening(integrals.stacked_stiffening, modes)
        out["S"][b, : r + 1] = integrals.S
        P = 0.5 * (P + P.transpose(1, 0, 3, 2))
        out["P"][b, : r + 1, :, : r + 1] = P.reshape(r + 1, r + 1, 9).transpose(1, 2, 0)
        out["pairs"][b] = _elastic_pairs(P, modes)
        out["K"][b, :r, :r] = 0.5 * (integrals.K + integrals.K.T)
        inverse = out["inverse"][b]
        inverse[:3, :3] = np.eye(3) / integrals.mass
        inverse[3:6, 3:6] = inverse_mass(np.trace(P[0, 0]) * np.eye(3) - P[0, 0])
        inverse[6 : r + 6, 6 : r + 6] = inverse_mass(np.einsum("abkk->ab", P[1:, 1:]))
        if name in mechanism.damping:
            out["alpha"][b] = mechanism.damping[name].alpha
            out["beta"][b] = mechanism.damping[name].beta
    out["P"] = out["P"].reshape(count, modes + 1, 9 * (modes + 1))
    out["first"] = np.concatenate([[0], np.cumsum(RIGID + out["modes"])[:-1]]).astype(np.int64)
    return out


def _elastic_pairs(P: Array, modes: int) -> Array:
    """Elastic part of the second moments as `ModelArrays.pairs` holds it, (10, modes * modes)."""
    out, r = np.zeros((10, modes, modes)), len(P) - 1
    E = P[1:, 1:]
    axial = (E[:, :, k, i] - E[:, :, i, k] for k, i in ((2, 1), (0, 2), (1, 0)))
    square = (E[:, :, k, k] for k in range(3))
    mixed = (E[:, :, k, i] + E[:, :, i, k] for k, i in ((0, 1), (0, 2), (1, 2)))
    for place, values in zip(out, (*axial, *square, *mixed, np.einsum("abkk->ab", E)), strict=True):
        place[:r, :r] = values
    return out.reshape(10, modes * modes)
