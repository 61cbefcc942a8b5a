# SPDX-License-Identifier: MIT
"""A mechanism and its bodies as flat arrays over a grid of times."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..body import VolumeIntegrals
from ..mechanism import (
    ANGULAR,
    Element,
    Ground,
    Marker,
    Mechanism,
    Motion,
    Moving,
    Row,
    RowKind,
    Undeformed,
    marker_name,
)
from . import planar, spatial
from .body_matrices import inverse_mass, padded_stiffening
from .kinematics import Coordinates, ModelArrays, coordinates_of, is_spatial
from .tables import TimeTables

__all__ = ["FlatModel", "assemble_model", "check_names"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Share of a step after which the accelerations are taken a second time to start the integration.
START_OFFSET = 1e-4


@dataclass(frozen=True, eq=False)
class FlatModel:
    """A mechanism compiled for the kernels, with the names of what stands where."""

    #: Flat arrays.
    arrays: ModelArrays
    #: Times, shape (steps + 1,) [s].
    times: Array
    #: Time from the start to the extra instant at the end of the tables [s].
    offset: float
    #: The mechanism.
    mechanism: Mechanism
    #: Integrals of the bodies, as given, without the point masses.
    bodies: Mapping[str, VolumeIntegrals]
    #: Place of each body marker in the arrays, by (body, marker).
    markers: Mapping[tuple[str, str], int]
    #: Rows of each joint in the multipliers, by name of the joint.
    joints: Mapping[str, slice]
    #: What is prescribed over time.
    tables: TimeTables
    #: Places of each force in :func:`applied_forces`, by name of the force.
    forces: Mapping[str, Sequence[int]]

    def at(self, times: Array) -> FlatModel:
        """The same mechanism, tabulated at other times.

        Args:
            times: Times, shape (instants,) [s].

        Raises:
            ValueError: If a value is NaN or infinite, or a length is not positive.
        """
        tables = self.tables.tabulate(np.append(times, times[0] + self.offset))
        return replace(self, arrays=self.arrays._replace(**tables), times=times)

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return int(np.sum((6 if self.dimension == 3 else 3) + self.arrays.modes))

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return 3 if is_spatial(self.arrays) else 2

    @property
    def rows(self) -> int:
        """Number of scalar constraints."""
        return len(self.angular)

    @cached_property
    def angular(self) -> NDArray[np.bool_]:
        """Which scalar constraints count angles, their multipliers moments, shape (rows,)."""
        kind = self.arrays.kind
        if isinstance(self.arrays, spatial.ModelArrays):
            return np.isin(kind[: kind.size - len(self.arrays.law)], ANGULAR)
        return np.asarray(kind == RowKind.ANGLE)

    def coordinates(self, body: str) -> Coordinates:
        """Places of a body's position, rotation and elastic coordinates among all coordinates.

        Args:
            body: Name of the body.

        Raises:
            ValueError: If there is no such body; the message lists the bodies.
        """
        return coordinates_of(self.arrays, self.body_index(body))

    def coordinates_in_space(self, body: str) -> spatial.Coordinates:
        """The same of a body in space.

        Args:
            body: Name of the body.

        Raises:
            ValueError: If there is no such body, or the mechanism is in the plane.
        """
        found = self.coordinates(body)
        if not isinstance(found, spatial.Coordinates):
            raise ValueError(f"body {body!r} is in the plane, and has no coordinates in space")
        return found

    @cached_property
    def rigid(self) -> Integers:
        """Places of the rigid coordinates of all bodies, shape (rigid,)."""
        every = np.arange(self.size)
        return np.concatenate([every[self.coordinates(name).rigid] for name in self.bodies])

    @cached_property
    def rotations(self) -> NDArray[np.bool_]:
        """Which coordinates are those of rotations of the bodies' frames, shape (size,)."""
        angles = np.zeros(self.size, dtype=bool)
        for name in self.bodies:
            angles[self.coordinates(name).rotation] = True
        return angles

    def body_index(self, body: str) -> int:
        """Number of a body.

        Args:
            body: Name of the body.

        Raises:
            ValueError: If there is no such body; the message lists the bodies.
        """
        names = list(self.bodies)
        if body not in self.bodies:
            raise ValueError(f"no body {body!r}; the bodies are {names}")
        return names.index(body)

    def joint_of_row(self, row: int) -> str:
        """Name of the joint to which a row belongs.

        Args:
            row: Number of the row.
        """
        return next(name for name, rows in self.joints.items() if rows.start <= row < rows.stop)

    def body_of_coordinate(self, index: int) -> str:
        """Name of the body to which a coordinate belongs.

        Args:
            index: Number of the coordinate.
        """
        return list(self.bodies)[int(np.searchsorted(self.arrays.first, index, "right")) - 1]


def check_names(
    mechanism: Mechanism, modes: Mapping[str, int], markers: Mapping[str, Collection[str]]
) -> None:
    """Refuse names in a mechanism that do not exist, listing those that do.

    Args:
        mechanism: The mechanism.
        modes: Number of elastic coordinates by name of the body.
        markers: Names of the markers by name of the body.

    Raises:
        ValueError: If the mechanism names a body or a marker that does not exist, or lacks the
            placement of a body.
    """
    names = list(modes)
    for what, given in (("placement", mechanism.placements), ("damping", mechanism.damping)):
        for name in given:
            if name not in modes:
                raise ValueError(f"{what} for {name!r}, but the bodies are {names}")
    for name in modes:
        if name not in mechanism.placements:
            raise ValueError(
                f"body {name!r} has no placement; placements are given for "
                f"{list(mechanism.placements)}"
            )
    mechanism.start.validate(modes)
    uses = [
        (f"joint {label!r}", marker)
        for label, joint in zip(mechanism.joint_names, mechanism.joints, strict=True)
        for marker in joint.markers
        if isinstance(marker, tuple)
    ]
    uses += [
        (f"force {label!r}", marker)
        for label, force in zip(mechanism.force_names, mechanism.forces, strict=True)
        for marker in force.markers
        if isinstance(marker, tuple)
    ]
    uses += [("point mass", point.marker) for point in mechanism.point_masses]
    for what, (body, marker) in uses:
        if body not in modes:
            raise ValueError(f"{what} refers to body {body!r}, but the bodies are {names}")
        if marker not in markers[body]:
            raise ValueError(
                f"{what} refers to marker {marker!r} of body {body!r}, whose markers are "
                f"{list(markers[body])}"
            )


def check_dimension(mechanism: Mechanism, bodies: Mapping[str, VolumeIntegrals]) -> int:
    """Whether bodies and mechanism are in the plane (2) or in space (3).

    Args:
        mechanism: The mechanism.
        bodies: Volume integrals of all bodies, by name.

    Raises:
        ValueError: If they are not all in the same.
    """
    where = {2: "in the plane", 3: "in space"}
    first = next(iter(bodies))
    d = bodies[first].dimension
    parts: list[tuple[str, int | None]] = [
        (f"body {name!r}", integrals.dimension) for name, integrals in bodies.items()
    ]
    parts += [(f"placement of body {n!r}", p.dimension) for n, p in mechanism.placements.items()]
    for what in ("gravity", "ground_acceleration"):
        given = getattr(mechanism, what)
        still = all(not callable(s) and not isinstance(s, Motion) and s == 0.0 for s in given)
        if not still:
            parts.append((f"{what} with {len(given)} components", len(given)))
    for names, things in (
        (mechanism.joint_names, mechanism.joints),
        (mechanism.force_names, mechanism.forces),
    ):
        for label, thing in zip(names, things, strict=True):
            user = f"{thing.kind} {label!r}"
            parts.append((user, thing.dimension))
            parts += [
                (f"{user}: marker {marker_name(marker)!r}", marker.dimension)
                for marker in thing.markers
                if not isinstance(marker, tuple)
            ]
    for what, found in parts:
        if found is not None and found != d:
            raise ValueError(
                f"{what} is {where[found]}, but body {first!r} is {where[d]}; all parts of a "
                "mechanism must be in the plane, or all in space (three components, a rotation)"
            )
    return d


def assemble_model(
    mechanism: Mechanism,
    bodies: Mapping[str, VolumeIntegrals],
    times: Array,
    *,
    checked: bool = False,
) -> FlatModel:
    """Compile a mechanism and its bodies to flat arrays, in the plane or in space.

    Args:
        mechanism: The mechanism.
        bodies: Volume integrals of all bodies, by name.
        times: Times, shape (steps + 1,) [s].
        checked: Whether the derivatives of all motions are known to be right.

    Raises:
        ValueError: If a name does not exist, integrals are not valid, a motion is NaN or its
            derivatives are wrong; the message names the thing.
    """
    if not bodies:
        raise ValueError("a mechanism needs at least one body")
    check_names(
        mechanism,
        {name: integrals.modes for name, integrals in bodies.items()},
        {name: integrals.markers for name, integrals in bodies.items()},
    )
    for name, integrals in bodies.items():
        integrals.validate(name)
    effective = dict(bodies)
    for point in mechanism.point_masses:
        body, marker = point.marker
        effective[body] = effective[body].with_point_mass(marker, point.mass)

    offset = START_OFFSET * float(times[1] - times[0])
    instants = np.append(times, times[0] + offset)
    if check_dimension(mechanism, bodies) == 3:
        found = spatial.assemble(mechanism, bodies, effective, instants)
        if not checked:
            found.tables.check(float(times[0]), float(times[-1]))
        known = found.markers, found.joints, found.tables, found.forces
        return FlatModel(found.arrays, times, offset, mechanism, dict(bodies), *known)
    index: dict[tuple[str, str], int] = {}
    table: list[Marker] = []
    prescribed: list[tuple[Ground | Moving, str]] = []

    def place(marker: Marker, user: str) -> int:
        """Number of a marker, entered in the table at its first use."""
        if isinstance(marker, tuple):
            if marker not in index:
                index[marker] = len(table)
                table.append(marker)
            return index[marker]
        for number, known in enumerate(table):
            if known is marker or (isinstance(marker, Ground) and known == marker):
                return number
        prescribed.append((marker, f"{user}, marker {marker_name(marker)!r}"))
        table.append(marker)
        return len(table) - 1

    positions = {
        (name, point): marker.position
        for name, integrals in bodies.items()
        for point, marker in integrals.markers.items()
    }
    undeformed = Undeformed(mechanism.placements, positions, instants[:1])
    rows: list[tuple[Row, str]] = []
    joints: dict[str, slice] = {}
    sides: list[tuple[int, int]] = []
    for label, joint in zip(mechanism.joint_names, mechanism.joints, strict=True):
        own = joint.rows(label, undeformed)
        joints[label] = slice(len(rows), len(rows) + len(own))
        user = f"joint {label!r}"
        sides += [(place(row.a, user), place(row.b, user)) for row in own]
        rows += [(row, label) for row in own]
    elements: list[tuple[Element, str]] = []
    ends: list[tuple[int, int]] = []
    for label, force in zip(mechanism.force_names, mechanism.forces, strict=True):
        element = force.element(label, undeformed)
        elements.append((element, label))
        ends.append((place(element.a, f"force {label!r}"), place(element.b, f"force {label!r}")))
    tables = TimeTables(mechanism, prescribed, rows, elements)
    over_time = tables.tabulate(instants)
    if not checked:
        tables.check(float(times[0]), float(times[-1]))

    arrays = _body_arrays(mechanism, effective)
    modes = int(arrays["modes"].max())
    shapes = np.zeros((len(table), 2, modes + 1))
    psi = np.zeros((len(table), modes))
    body_of, slot_of = np.full(len(table), -1), np.zeros(len(table), dtype=np.int64)
    stiffened = np.full(len(table), -1)
    bends: list[Array] = []
    slots = 0
    for number, entry in enumerate(table):
        if isinstance(entry, tuple):
            point_of_body = bodies[entry[0]].markers[entry[1]]
            r = bodies[entry[0]].modes
            shapes[number, :, : r + 1] = point_of_body.basis
            psi[number, :r] = point_of_body.rotation
            body_of[number] = list(bodies).index(entry[0])
            if point_of_body.stiffening is not None and r:
                stiffened[number] = len(bends)
                bends.append(padded_stiffening(point_of_body.stiffening, modes))
        else:
            slot_of[number] = slots
            slots += 1
    flat = planar.ModelArrays(
        **arrays,
        **over_time,
        marker_body=body_of.astype(np.int64),
        marker_slot=slot_of,
        shapes=shapes,
        psi=psi,
        marker_stiffened=stiffened.astype(np.int64),
        marker_stiffening=np.array(bends).reshape(len(bends), 2, modes, modes),
        kind=np.array([row.kind for row, _ in rows], dtype=np.int64),
        side=np.array(sides, dtype=np.int64).reshape(-1, 2),
        normal=_pairs([row.normal for row, _ in rows]),
        ratio=np.array([row.ratio for row, _ in rows], dtype=np.float64),
        force_kind=np.array([element.kind for element, _ in elements], dtype=np.int64),
        force_side=np.array(ends, dtype=np.int64).reshape(-1, 2),
        force_constants=_pairs([element.constants for element, _ in elements]),
    )
    forces = {label: [number] for number, label in enumerate(mechanism.force_names)}
    names = index, joints, tables, forces
    return FlatModel(flat, times, offset, mechanism, dict(bodies), *names)


def _pairs(pairs: Sequence[tuple[float, float]]) -> Array:
    return np.array(pairs, dtype=np.float64).reshape(-1, 2)


def _body_arrays(mechanism: Mechanism, bodies: Mapping[str, VolumeIntegrals]) -> dict[str, NDArray]:
    """Padded arrays of all bodies, by name of the field of ModelArrays."""
    count, modes = len(bodies), max(integrals.modes for integrals in bodies.values())
    out = {
        "modes": np.array([integrals.modes for integrals in bodies.values()], dtype=np.int64),
        "mass": np.array([integrals.mass for integrals in bodies.values()]),
        "S": np.zeros((count, modes + 1, 2)),
        "G": np.zeros((count, modes + 1, modes + 1)),
        "N": np.zeros((count, modes + 1, modes + 1)),
        "K": np.zeros((count, modes, modes)),
        "alpha": np.zeros(count),
        "beta": np.zeros(count),
        "stiffened": np.array([bool(b.stiffening) for b in bodies.values()], dtype=np.int64),
        "stiffening": np.zeros((0, 4, modes, modes)),
        "inverse": np.zeros((count, modes + 3, modes + 3)),
    }
    if np.any(out["stiffened"]):
        out["stiffening"] = np.zeros((count, 4, modes, modes))
    for b, (name, integrals) in enumerate(bodies.items()):
        r = integrals.modes
        if integrals.stiffening:
            out["stiffening"][b] = padded_stiffening(integrals.stacked_stiffening, modes)
        out["S"][b, : r + 1] = integrals.S
        # The kernels use rows as columns: remove what round-off has left of the other part.
        out["G"][b, : r + 1, : r + 1] = 0.5 * (integrals.G + integrals.G.T)
        out["N"][b, : r + 1, : r + 1] = 0.5 * (integrals.N - integrals.N.T)
        out["K"][b, :r, :r] = 0.5 * (integrals.K + integrals.K.T)
        out["inverse"][b, :2, :2] = np.eye(2) / integrals.mass
        out["inverse"][b, 2, 2] = 1.0 / integrals.G[0, 0]
        out["inverse"][b, 3 : r + 3, 3 : r + 3] = inverse_mass(out["G"][b, 1 : r + 1, 1 : r + 1])
        if name in mechanism.damping:
            out["alpha"][b] = mechanism.damping[name].alpha
            out["beta"][b] = mechanism.damping[name].beta
    out["first"] = np.concatenate([[0], np.cumsum(3 + out["modes"])[:-1]]).astype(np.int64)
    return out
