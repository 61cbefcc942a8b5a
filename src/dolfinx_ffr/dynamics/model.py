# SPDX-License-Identifier: MIT
"""A mechanism and its bodies as flat arrays over a grid of times."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import Array, Integers, Mask
from ..body import VolumeIntegrals
from ..documentation import Shown
from ..mechanism import (
    Element,
    Mechanism,
    Moving,
    RayleighDamping,
    Row,
    Undeformed,
    is_zero,
    marker_name,
)
from .kinematics import (
    KINDS,
    Coordinates,
    ModelArrays,
    SpaceCoordinates,
    body_arrays,
    is_spatial,
    largest_length,
)
from .tables import TimeTables

#: Fields of the arrays with one row for each instant, as `TimeTables.tabulate` gives them
OVER_TIME = ("gravity", "prescribed", "prescribed_turn", "drive", "load_table")
#: Rows of all joints and elements of all forces, with the names of these
Connected = tuple[list[tuple[Row, str]], list[tuple[Element, str]]]

#: Part of a step to the near-start instant, at which the accelerations are evaluated once more.
START_OFFSET = 1e-4


@dataclass(frozen=True, eq=False, repr=False)
class FlatModel(Shown):
    """A mechanism compiled for the kernels, with the names of its rows and coordinates."""

    arrays: ModelArrays  #: Flat arrays.
    times: Array  #: Times, shape (steps + 1,) [s].
    offset: float  #: Time from the start to the extra instant at the end of the tables [s].
    mechanism: Mechanism
    #: Integrals of the bodies, as given, without the point masses.
    bodies: Mapping[str, VolumeIntegrals]
    #: Place of each body marker in the arrays, by (body, marker).
    markers: Mapping[tuple[str, str], int]
    joints: Mapping[str, slice]  #: Rows of each joint in the multipliers, by name of the joint.
    tables: TimeTables  #: Loads and prescribed motions over time.
    #: Places of each force in :func:`applied_forces`, by name of the force.
    forces: Mapping[str, Sequence[int]]
    effective: Mapping[str, VolumeIntegrals]  #: Integrals of the bodies with their point masses.
    #: Rows and elements of the mechanism's twin, None without one.
    twins: Connected | None

    def _shown(self) -> list[tuple[str, str, str]]:
        return [
            ("bodies", ", ".join(self.bodies), ""),
            ("joints", ", ".join(self.joints) or "none", ""),
            ("forces", ", ".join(self.forces) or "none", ""),
            ("coordinates", str(self.size), ""),
            ("instants", str(len(self.times)), ""),
        ]

    def at(self, times: Array) -> FlatModel:
        """The same mechanism, tabulated at other times (instants,) [s]."""
        tables = self.tables.tabulate(np.append(times, times[0] + self.offset))
        return replace(self, arrays=self.arrays._replace(**tables), times=times)

    def between(self, begin: int, end: int) -> ModelArrays:
        """The arrays with the tables of the instants from number ``begin`` to before ``end``."""
        tables = {name: getattr(self.arrays, name)[begin:end] for name in OVER_TIME}
        return self.arrays._replace(**tables)

    def stated_by(self, mechanism: Mechanism, *, tabulated: bool = True) -> FlatModel:
        """The flat model of another ``mechanism`` of the same bodies, at the same instants.

        Its angles are counted from the same start as here. Its motions, drives and loads are
        tabulated anew; if not ``tabulated``, it has the tables of this model.
        """
        model = assemble_model(
            mechanism, self.bodies, self.times, checked=True, like=self, tabulated=tabulated
        )
        return replace(model, arrays=model.arrays._replace(start_angles=self.arrays.start_angles))

    def counting_from(self, turns: Array) -> FlatModel:
        """The model with angles counted from the start's, (1, rows and springs, 2) [rad]."""
        if not turns.size:
            return self
        return replace(self, arrays=self.arrays._replace(start_angles=turns[0].copy()))

    def counting_from_placements(self) -> FlatModel:
        """The model with angles counted from the placements, wherever the motion begins."""
        placed = self.tables.lowering.start_angles
        return replace(self, arrays=self.arrays._replace(start_angles=placed))

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return int(np.sum(self.arrays.rigid + self.arrays.modes))

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return self.arrays.d

    @property
    def rows(self) -> int:
        """Number of scalar constraints."""
        return len(self.angular)

    @cached_property
    def angular(self) -> Mask:
        """Which scalar constraints count angles, their multipliers moments, shape (rows,)."""
        return np.array([row.angular for row, _ in self.tables.rows], dtype=bool)

    @cached_property
    def drives(self) -> list[str]:
        """Names of the joints that drive the mechanism: by a motion, or by a marker that moves."""
        names = []
        for name, rows in self.joints.items():
            of_joint = [row for row, _ in self.tables.rows[rows]]
            moving = (isinstance(v.marker, Moving) for row in of_joint for v in row.vectors)
            if any(row.motion is not None for row in of_joint) or any(moving):
                names.append(name)
        return names

    @property
    def damped(self) -> bool:
        """Whether a body, a spring or a damper takes energy from vibrations."""
        arrays = self.arrays
        return any(
            bool(np.any(factors)) for factors in (arrays.alpha, arrays.beta, arrays.law[:, 1])
        )

    def coordinates(self, body: str) -> Coordinates:
        """Places of a body's position, rotation and elastic coordinates among all coordinates."""
        return self.arrays.coordinates(self.body_index(body))

    def coordinates_in_space(self, body: str) -> SpaceCoordinates:
        """The coordinates of a body in space; a ValueError if the mechanism is in the plane."""
        if not is_spatial(self.arrays):
            raise ValueError(f"body {body!r} is in the plane, and has no coordinates in space")
        return self.arrays.coordinates(self.body_index(body))

    @cached_property
    def rigid(self) -> Integers:
        """Places of the rigid coordinates of all bodies, shape (rigid,)."""
        places = np.arange(self.size)
        return np.concatenate([places[self.coordinates(name).rigid] for name in self.bodies])

    @cached_property
    def rotations(self) -> Mask:
        """Mask of the coordinates that rotate the bodies' frames, shape (size,)."""
        angles = np.zeros(self.size, dtype=bool)
        for name in self.bodies:
            angles[self.coordinates(name).rotation] = True
        return angles

    def body_index(self, body: str) -> int:
        """Number of a body; a ValueError lists the bodies if there is none of that name."""
        names = list(self.bodies)
        if body not in self.bodies:
            raise ValueError(f"no body {body!r}; the bodies are {names}")
        return names.index(body)

    def joint_of_row(self, row: int) -> str:
        """Name of the joint to which a row belongs."""
        return next(name for name, rows in self.joints.items() if rows.start <= row < rows.stop)

    def body_of_coordinate(self, index: int) -> str:
        """Name of the body to which a coordinate belongs."""
        return list(self.bodies)[int(np.searchsorted(self.arrays.first, index, "right")) - 1]


def without(arrays: ModelArrays, column: int, *fields: str) -> ModelArrays:
    """The arrays with zero stiffness (column 0) or damping (1) of all springs, and zero fields."""
    law = arrays.law.copy()
    law[:, column] = 0.0
    changed: dict[str, Any] = {field: np.zeros_like(getattr(arrays, field)) for field in fields}
    return arrays._replace(law=law, **changed)


def check_names(
    mechanism: Mechanism, modes: Mapping[str, int], markers: Mapping[str, Collection[str]]
) -> None:
    """Refuse, by a ValueError, names in a mechanism that do not exist, listing those that do."""
    names = list(modes)
    for kind, by_name in (("placement", mechanism.placements), ("damping", mechanism.damping)):
        for name in by_name:
            if name not in modes:
                raise ValueError(f"{kind} for {name!r}, but the bodies are {names}")
    for name, damping in mechanism.damping.items():
        if not modes[name] and damping != RayleighDamping():
            raise ValueError(
                f"damping for body {name!r}, which is rigid and has no elastic coordinates to "
                "damp: leave it out, or give its joints a SpringDamper or a TorsionalSpringDamper"
            )
    for name in modes:
        if name not in mechanism.placements:
            raise ValueError(
                f"body {name!r} has no placement; placements are given for "
                f"{list(mechanism.placements)}"
            )
    mechanism.start.validate(modes)
    uses = [
        (f"{thing.kind} {label!r}", marker)
        for thing, label in mechanism.connections
        for marker in thing.markers
        if isinstance(marker, tuple)
    ]
    uses += [("point mass", point.marker) for point in mechanism.point_masses]
    for kind, (body, marker) in uses:
        if body not in modes:
            raise ValueError(f"{kind} refers to body {body!r}, but the bodies are {names}")
        if marker not in markers[body]:
            raise ValueError(
                f"{kind} refers to marker {marker!r} of body {body!r}, whose markers are "
                f"{list(markers[body])}"
            )


def check_dimension(mechanism: Mechanism, bodies: Mapping[str, VolumeIntegrals]) -> int:
    """2 if bodies and mechanism are all in the plane, 3 if all are in space; or a ValueError."""
    phrase = {2: "in the plane", 3: "in space"}
    first_body = next(iter(bodies))
    d = bodies[first_body].dimension
    dimensions: list[tuple[str, int | None]] = [
        (f"body {name!r}", integrals.dimension) for name, integrals in bodies.items()
    ]
    dimensions += [
        (f"placement of body {n!r}", p.dimension) for n, p in mechanism.placements.items()
    ]
    for name_of_part in ("gravity", "ground_acceleration"):
        components = getattr(mechanism, name_of_part)
        if not is_zero(*components):
            dimensions.append(
                (f"{name_of_part} with {len(components)} components", len(components))
            )
    for thing, label in mechanism.connections:
        user = f"{thing.kind} {label!r}"
        if thing.in_the_plane and thing.dimension != d:
            raise ValueError(
                f"{user} is in space, but body {first_body!r} is in the plane; there it is "
                f"{thing.in_the_plane}"
            )
        dimensions.append((user, thing.dimension))
        dimensions += [
            (f"{user}: marker {marker_name(marker)!r}", marker.dimension)
            for marker in thing.markers
            if not isinstance(marker, tuple)
        ]
    for name_of_part, dimension in dimensions:
        if dimension is not None and dimension != d:
            raise ValueError(
                f"{name_of_part} is {phrase[dimension]}, but body {first_body!r} is {phrase[d]}; "
                "give all parts of a mechanism in the plane, or all in space (three components, a "
                "rotation)"
            )
    return d


def assemble_model(
    mechanism: Mechanism,
    bodies: Mapping[str, VolumeIntegrals],
    times: Array,
    *,
    checked: bool = False,
    like: FlatModel | None = None,
    tabulated: bool = True,
) -> FlatModel:
    """Flat arrays of a mechanism in the plane or in space at times (steps + 1,) [s].

    The derivatives of all motions are compared with differences, and given bodies validated, unless
    they have been `checked`.
    The instant near the start is a share of the first step later. A model that this one is `like`,
    of the same bodies, provides this instant and everything that is stated alike, and the tables,
    too, unless they are to be `tabulated`.
    """
    bodies = {**bodies, **mechanism.own_bodies}
    if not bodies:
        raise ValueError("a mechanism needs at least one body")
    check_names(
        mechanism,
        {name: integrals.modes for name, integrals in bodies.items()},
        {name: integrals.markers for name, integrals in bodies.items()},
    )
    for name, integrals in (mechanism.own_bodies if checked else bodies).items():
        integrals.validate(name)
    dimension = check_dimension(mechanism, bodies)

    # rows and forces, as the markers of the undeformed bodies make them
    offset = like.offset if like else START_OFFSET * float(times[1] - times[0])
    instants = np.append(times, times[0] + offset)
    undeformed = _undeformed(mechanism, bodies, instants[:1], dimension)
    rows, elements = _connected(mechanism, undeformed)
    if like and like.mechanism.twin is mechanism.twin:
        twins = like.twins
    else:
        twins = _twins(mechanism.twin, bodies, instants[:1], dimension)
    kind = KINDS[dimension]
    lowering = kind.lowering(bodies, undeformed)
    lowering.enter(rows, elements, twins)

    tables = TimeTables(mechanism, rows, elements, lowering)
    over_time = tables.tabulate(instants) if tabulated or like is None else {}
    if not checked:
        tables.check(float(times[0]), float(times[-1]))

    # a model of the same bodies provides what does not change
    effective: Mapping[str, VolumeIntegrals] = effective_bodies(mechanism, bodies)
    if like and mechanism.point_masses == like.mechanism.point_masses:
        if all(bodies[name] is body for name, body in like.bodies.items()):
            effective = like.effective
    if like and effective is like.effective and mechanism.damping == like.mechanism.damping:
        of_bodies = like.arrays._asdict()
    else:
        of_bodies = body_arrays(effective, mechanism.damping)

    of_connections = lowering.arrays(int(of_bodies["modes"].max()))
    fields = {} if like is None else like.arrays._asdict()
    fields |= {**of_bodies, **over_time, **of_connections, "reach": np.zeros(1)}
    arrays = kind(**fields)
    arrays.reach[0] = largest_length(arrays)
    return FlatModel(
        arrays,
        times,
        offset,
        mechanism,
        dict(bodies),
        markers=lowering.markers,
        joints=_places(mechanism.joint_names, [label for _, label in rows]),
        tables=tables,
        forces=lowering.forces,
        effective=effective,
        twins=twins,
    )


def effective_bodies(
    mechanism: Mechanism, bodies: Mapping[str, VolumeIntegrals]
) -> dict[str, VolumeIntegrals]:
    """Integrals of the bodies with their point masses."""
    effective = dict(bodies)
    for point in mechanism.point_masses:
        body, marker = point.marker
        effective[body] = effective[body].with_point_mass(marker, point.mass)
    return effective


def _connected(mechanism: Mechanism, undeformed: Undeformed) -> Connected:
    """Rows of all joints and elements of all forces, with the names of these."""
    rows = [
        (row, label)
        for label, joint in zip(mechanism.joint_names, mechanism.joints, strict=True)
        for row in joint.rows(undeformed.of(f"joint {label!r}"))
    ]
    elements = [
        (force.element(undeformed.of(f"force {label!r}")), label)
        for label, force in zip(mechanism.force_names, mechanism.forces, strict=True)
    ]
    return rows, elements


def _twins(
    twin: Mechanism | None,
    bodies: Mapping[str, VolumeIntegrals],
    start: Array,
    dimension: int,
) -> Connected | None:
    """Rows and elements of the twin of a mechanism, if it has one."""
    if twin is None:
        return None
    of_twin = {**bodies, **twin.own_bodies}
    return _connected(twin, _undeformed(twin, of_twin, start, dimension))


def _places(names: Sequence[str], labels: Sequence[str]) -> dict[str, slice]:
    """Place of each name among labels, which follow the order of the names."""
    ends = np.cumsum([labels.count(name) for name in names], dtype=int).tolist()
    return {n: slice(end - labels.count(n), end) for n, end in zip(names, ends, strict=True)}


def _undeformed(
    mechanism: Mechanism, bodies: Mapping[str, VolumeIntegrals], start: Array, dimension: int
) -> Undeformed:
    """Markers of all bodies in the placements, at the time of the start, shape (1,) [s]."""
    points = {
        (name, point): marker
        for name, integrals in bodies.items()
        for point, marker in integrals.markers.items()
    }
    positions = {name: marker.position for name, marker in points.items()}
    axes = {name: marker.axes for name, marker in points.items() if marker.axes is not None}
    return Undeformed(mechanism.placements, positions, start, dimension, axes)
