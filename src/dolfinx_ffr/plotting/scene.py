# SPDX-License-Identifier: MIT
"""What there is to be drawn of a mechanism at chosen instants, gathered on rank 0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body import BodyMarker
from ..dynamics import Trajectory
from ..mechanism import BodyPoint, Joint, Marker, Mechanism, Moving
from ..problem import Evaluation, Problem
from .drawn_mesh import DrawnMesh

__all__ = ["Arm", "DrawnBody", "Scene"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DrawnBody:
    """One body at the chosen instants.

    Its deformation is magnified about the undeformed body laid through the joints: the joints stay
    where they are, and the picture does not depend on the choice of the floating frame.
    """

    name: str  #: Name of the body
    drawn: DrawnMesh | None  #: Its mesh; None for a body given by its integrals alone
    reference: Array  #: (points, 2) undeformed points in the body's frame [m]
    shapes: Array  #: (points, 2, r) their shape functions
    markers: Mapping[str, BodyMarker]  #: Markers in the body's frame
    held: Sequence[str]  #: Markers at which joints sit
    welded: bool  #: Whether its only joint is a weld
    rigid: Array  #: (instants, 3) position and angle of the frame [m, m, rad]
    elastic: Array  #: (instants, r) elastic coordinates
    density: Array  #: (cells,) density of the cells
    energy: Array  #: (instants, cells) strain energy density [J/m^3]; no columns if not asked for

    def points(self, instant: int, magnification: float = 1.0) -> Array:
        """Where the points are drawn, shape (points, 2) [m]."""
        return self._moved(
            self.reference, self.shapes @ self.elastic[instant], instant, magnification
        )

    def marker(self, name: str, instant: int, magnification: float = 1.0) -> Array:
        """Where a marker is drawn, shape (2,) [m]."""
        marker = self.markers[name]
        displacement = marker.displacement @ self.elastic[instant]
        return self._moved(marker.position[None], displacement[None], instant, magnification)[0]

    def marker_angle(self, name: str, instant: int) -> float:
        """The angle of a marker's axes [rad]."""
        return float(self.rigid[instant, 2] + self.markers[name].rotation @ self.elastic[instant])

    def deflection(self, instant: int) -> float:
        """The largest distance of a point from the undeformed body [m]."""
        deformed = self.reference + self.shapes @ self.elastic[instant]
        away = deformed - self._undeformed(self.reference, instant)
        return float(np.max(np.linalg.norm(away, axis=1), initial=0.0))

    def _undeformed(self, reference: Array, instant: int) -> Array:
        """Lay points of the undeformed body through the joints, in the body's frame."""
        q = self.elastic[instant]
        held = [self.markers[name] for name in self.held]
        if not held:
            return reference
        before = np.array([marker.position for marker in held])
        after = before + np.array([marker.displacement @ q for marker in held])
        middle, target = before.mean(axis=0), after.mean(axis=0)
        # turn and stretch: two joints then stay exactly where they are
        a, b = _complex(before - middle), _complex(after - target)
        weight = float(np.sum(np.abs(a) ** 2))
        turn = complex(np.sum(b * a.conj())) / weight if weight > 0.0 else 1.0 + 0.0j
        if len(held) == 1 and self.welded:
            turn = np.exp(1j * float(held[0].rotation @ q))
        laid = turn * _complex(reference - middle)
        return target + np.column_stack([laid.real, laid.imag])

    def _moved(
        self, reference: Array, displacement: Array, instant: int, magnification: float
    ) -> Array:
        base = self._undeformed(reference, instant)
        local = base + magnification * (reference + displacement - base)
        x, y, angle = self.rigid[instant]
        return np.array([x, y]) + local @ _rotation(angle).T


@dataclass(frozen=True, eq=False)
class Arm:
    """A prescribed crank: a marker that moves on a circle."""

    center: Array  #: (2,) centre of the circle [m]
    radius: float  #: [m]
    name: str  #: Name of the marker


@dataclass(frozen=True, eq=False)
class Scene:
    """The parts of a mechanism at chosen instants; meshes and fields are on rank 0 only."""

    mechanism: Mechanism  #: Joints and point masses
    trajectory: Trajectory  #: The whole motion
    steps: NDArray[np.int64]  #: (instants,) time steps drawn
    times: Array  #: (instants,) their times [s]
    bodies: dict[str, DrawnBody]  #: By name
    arms: dict[int, Arm]  #: By number of the joint: the crank that drives it

    @staticmethod
    def gather(
        problem: Problem, evaluation: Evaluation, steps: NDArray[np.int64], *, energy: bool
    ) -> Scene:
        """Gather the bodies of an evaluation; collective.

        Args:
            problem: Bodies and mechanism.
            evaluation: Trajectory and shape functions at one design.
            steps: Time steps to be drawn.
            energy: Whether to compute the strain energy density of the cells.
        """
        mechanism, trajectory = problem.mechanism, evaluation.motion
        bodies = {}
        for name, integrals in trajectory.model.bodies.items():
            own = [joint for joint in mechanism.joints if name in _bodies_of(joint)]
            held = dict.fromkeys(
                marker[1]
                for joint in own
                for marker in joint.markers
                if isinstance(marker, tuple) and marker[0] == name
            )
            elastic = trajectory.elastic(name)[steps]
            drawn, density = None, np.zeros(0)
            fields = np.zeros((len(steps), 0))  # a body without cells
            markers = list(integrals.markers.values())
            points, motion = (
                np.zeros((len(markers), 2)),
                np.zeros((len(markers), 2, integrals.modes)),
            )
            for k, point in enumerate(markers):
                points[k], motion[k] = point.position, point.displacement
            if name in problem.flexible:
                body, reduced = problem.flexible[name], evaluation.bodies[name]
                drawn = DrawnMesh.of(body.domain)
                points = drawn.points - body.reduction.origin
                motion = drawn.displacements(reduced.basis.shapes)
                density = drawn.cell_values(reduced.density)
                if energy:
                    volume = body.domain.cell_volumes * body.material.thickness
                    local = [
                        body.elasticity.strain_energy(reduced.density, reduced.basis.shapes @ q)
                        for q in elastic
                    ]
                    fields = drawn.cell_values((np.array(local) / volume).T).T
            bodies[name] = DrawnBody(
                name=name,
                drawn=drawn,
                reference=points,
                shapes=motion,
                markers=integrals.markers,
                held=list(held),
                welded=all(joint.rigid for joint in own),
                rigid=trajectory.rigid(name)[steps],
                elastic=elastic,
                density=density,
                energy=fields,
            )
        arms = {}
        for i, joint in enumerate(mechanism.joints):
            for marker in joint.markers:
                arm = _arm(marker, trajectory.t) if isinstance(marker, Moving) else None
                if arm is not None:
                    arms[i] = arm
        return Scene(mechanism, trajectory, steps, trajectory.t[steps], bodies, arms)

    def position(self, marker: Marker, instant: int, magnification: float = 1.0) -> Array:
        """Where a marker is drawn, shape (2,) [m]."""
        if isinstance(marker, tuple):
            return self.bodies[marker[0]].marker(marker[1], instant, magnification)
        at = self.times[instant : instant + 1]
        return np.array([motion.tabulate(at)[0, 0] for motion in marker.motions[:2]])

    def angle(self, marker: Marker, instant: int) -> float:
        """The angle of a marker's axes [rad]."""
        if isinstance(marker, tuple):
            return self.bodies[marker[0]].marker_angle(marker[1], instant)
        return float(marker.motions[2].tabulate(self.times[instant : instant + 1])[0, 0])

    def on_body(self, markers: Sequence[Marker], instant: int, magnification: float = 1.0) -> Array:
        """Where the first of some markers that is on a body is drawn, shape (2,) [m]."""
        marker = next(m for m in markers if isinstance(m, tuple))
        return self.position(marker, instant, magnification)

    def size(self) -> float:
        """The extent of the largest body [m]."""
        extents = [np.ptp(body.reference, axis=0) for body in self.bodies.values()]
        return float(max((np.max(extent) for extent in extents), default=1.0)) or 1.0

    def box(self, magnification: float) -> Array:
        """Lower and upper corner of all that is drawn, shape (2, 2) [m]."""
        corners = []
        for body in self.bodies.values():
            for i in range(len(self.steps)):
                points = body.points(i, magnification)
                corners += [points.min(axis=0), points.max(axis=0)]
        for arm in self.arms.values():
            corners += [arm.center - arm.radius, arm.center + arm.radius]
        # What has no symbol acts on angles alone: its place on the ground means nothing.
        connections = (*self.mechanism.joints, *self.mechanism.forces)
        places = [m for part in connections for symbol in part.symbols for m in symbol.markers]
        corners += [self.position(m, 0) for m in places if not isinstance(m, tuple | Moving)]
        return np.array([np.min(corners, axis=0), np.max(corners, axis=0)])


def _bodies_of(joint: Joint) -> list[str]:
    points: list[BodyPoint] = [m for m in joint.markers if isinstance(m, tuple)]
    return [name for name, _ in points]


def _complex(vectors: Array) -> NDArray[np.complex128]:
    return vectors[:, 0] + 1j * vectors[:, 1]


def _rotation(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _arm(marker: Moving, times: Array) -> Arm | None:
    """Find the centre about which a marker turns together with its axes; None if there is none."""
    x, y, angle = (motion.tabulate(times)[0] for motion in marker.motions)
    c, s, one, zero = np.cos(angle), np.sin(angle), np.ones_like(x), np.zeros_like(x)
    # (x, y) = centre + rotation(angle) e
    matrix = np.vstack([np.column_stack([one, zero, c, -s]), np.column_stack([zero, one, s, c])])
    path = np.concatenate([x, y])
    solution, _, rank, _ = np.linalg.lstsq(matrix, path, rcond=1e-9)
    radius = float(np.hypot(solution[2], solution[3]))
    misfit = float(np.max(np.abs(matrix @ solution - path)))
    if rank < 4 or radius == 0.0 or misfit > 1e-6 * radius:
        return None
    return Arm(solution[:2], radius, marker.name)
