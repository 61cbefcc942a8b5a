# SPDX-License-Identifier: MIT
"""The parts of a mechanism at chosen instants, ready to be drawn, in d = 2 or 3 dimensions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from ..arrays import Array, Integers
from ..body import BodyMarker
from ..dynamics import Trajectory
from ..fem import GatheredMesh
from ..mechanism import Ground, Marker, Mechanism, Moving
from ..problem import Evaluation, Problem
from .drawn_mesh import DrawnMesh, gathered_mesh


@dataclass(frozen=True, eq=False)
class DrawnBody:
    """One body at the chosen instants.

    Its deformation is magnified about the undeformed body laid through the joints: the joints stay
    where they are, and the picture does not depend on the choice of the floating frame.
    """

    name: str
    mesh: DrawnMesh | GatheredMesh | None  #: None for a body given by its integrals alone
    reference: Array  #: (points, d) undeformed points in the body's frame [m]
    shapes: Array  #: (points, d, r) shape functions at the points
    markers: Mapping[str, BodyMarker]  #: Markers in the body's frame
    jointed: Sequence[str]  #: Names of the markers at which joints sit
    welded: bool  #: Whether all of its joints are welds
    position: Array  #: (instants, d) of the frame [m]
    rotation: Array  #: (instants, d, d) of the frame
    elastic: Array  #: (instants, r) elastic coordinates
    density: Array  #: (cells,)
    energy: Array  #: (instants, cells) strain energy density [J/m^3]; no columns if not gathered

    def points(self, instant: int, magnification: float = 1.0) -> Array:
        """Where the points are drawn, shape (points, d) [m]."""
        displacement = self.shapes @ self.elastic[instant]
        return self._moved(self.reference, displacement, instant, magnification)

    def marker(self, name: str, instant: int, magnification: float = 1.0) -> Array:
        """Where a marker is drawn, shape (d,) [m]."""
        marker = self.markers[name]
        displacement = (marker.displacement @ self.elastic[instant])[None]
        return self._moved(marker.position[None], displacement, instant, magnification)[0]

    def axes(self, name: str, instant: int) -> Array:
        """The axes of a marker as columns, shape (d, d)."""
        turn = self.markers[name].rotation @ self.elastic[instant]
        return np.asarray(self.rotation[instant] @ _rotation(turn))

    def cell_values(self, instant: int) -> Array:
        """Energy density of the cells if it was gathered, else their density, shape (cells,)."""
        return self.energy[instant] if self.energy.shape[1] else self.density

    def deflection(self, instant: int) -> float:
        """The largest distance of a point from the undeformed body [m]."""
        deformed = self.reference + self.shapes @ self.elastic[instant]
        away = deformed - self._undeformed(self.reference, instant)
        return float(np.max(np.linalg.norm(away, axis=1), initial=0.0))

    def _undeformed(self, points: Array, instant: int) -> Array:
        """Points (n, d) of the undeformed body where its joints are, in the body's frame.

        The points are moved by the similarity that takes the joints to their deformed places.
        """
        joint_markers = [self.markers[name] for name in self.jointed]
        if not joint_markers:
            return points
        q = self.elastic[instant]
        undeformed = np.array([marker.position for marker in joint_markers])
        deformed = undeformed + np.array([marker.displacement @ q for marker in joint_markers])
        middle, target = undeformed.mean(axis=0), deformed.mean(axis=0)
        if len(joint_markers) == 1 and (self.welded or len(middle) == 3):
            turn = _rotation(joint_markers[0].rotation @ q)
        else:
            turn = _similarity(undeformed - middle, deformed - target)
        return np.asarray(target + (points - middle) @ turn.T)

    def _moved(self, points: Array, displacement: Array, instant: int, scale: float) -> Array:
        base = self._undeformed(points, instant)
        local = base + scale * (points + displacement - base)
        return np.asarray(self.position[instant] + local @ self.rotation[instant].T)


@dataclass(frozen=True, eq=False)
class Arm:
    """A prescribed crank: a marker that moves on a circle."""

    center: Array  #: (d,) of the circle [m]
    ring: Array  #: (points, d) along the circle [m]
    marker: Moving


@dataclass(frozen=True, eq=False)
class Scene:
    """The parts of a mechanism at chosen instants; meshes and fields are on rank 0 only."""

    mechanism: Mechanism
    trajectory: Trajectory  #: The whole motion
    steps: Integers  #: (instants,) time steps that are drawn
    times: Array  #: (instants,) [s]
    bodies: dict[str, DrawnBody]
    arms: dict[int, Arm]  #: By number of the joint that the crank drives

    @staticmethod
    def gather(problem: Problem, evaluation: Evaluation, steps: Integers, *, energy: bool) -> Scene:
        """Gather the bodies at some time steps, with strain energies if asked for."""
        trajectory = evaluation.trajectory
        mechanism = trajectory.model.mechanism
        bodies = {}
        for name in trajectory.model.bodies:
            drawn = _rigid_body(name, trajectory, steps)
            if name in problem.flexible:
                drawn = _with_mesh(drawn, problem, evaluation, energy)
            bodies[name] = drawn
        arms = {}
        for i, joint in enumerate(mechanism.joints):
            for marker in joint.markers:
                arm = _arm(marker, trajectory) if isinstance(marker, Moving) else None
                if arm is not None:
                    arms[i] = arm
        return Scene(mechanism, trajectory, steps, trajectory.t[steps], bodies, arms)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.trajectory.model.dimension

    def position(self, marker: Marker, instant: int, magnification: float = 1.0) -> Array:
        """Where a marker is drawn, shape (d,) [m]."""
        if isinstance(marker, tuple):
            return self.bodies[marker[0]].marker(marker[1], instant, magnification)
        return self._tabulated(marker, instant)[0]

    def axes(self, marker: Marker, instant: int) -> Array:
        """The axes of a marker as columns, shape (d, d)."""
        if isinstance(marker, tuple):
            return self.bodies[marker[0]].axes(marker[1], instant)
        return self._tabulated(marker, instant)[1 : 1 + self.dimension].T

    def _tabulated(self, marker: Ground | Moving, instant: int) -> Array:
        """Position and axes of a marker that is not on a body, as rows, shape (4, d)."""
        at = self.times[instant : instant + 1]
        return np.asarray(marker.tabulate_in_space(at, "picture")[0, 0, :, : self.dimension])

    def size(self) -> float:
        """The extent of the largest body [m]."""
        extents = [np.ptp(body.reference, axis=0) for body in self.bodies.values()]
        return float(max((np.max(extent) for extent in extents), default=1.0)) or 1.0

    def visible_points(self, magnification: float, project: Callable[[Array], Array]) -> Array:
        """Points that reach as far as all that is drawn at all instants.

        They are in the plane of the picture, to which ``project`` takes points; shape (n, 2) [m].
        """
        points = [project(arm.ring) for arm in self.arms.values()]
        for body in self.bodies.values():
            for instant in range(len(self.steps)):
                shape = project(body.points(instant, magnification))
                points.append(np.array([shape.min(axis=0), shape.max(axis=0)]))
        # a connection without symbol acts on angles alone: its place on the ground means nothing
        connections = (*self.mechanism.joints, *self.mechanism.forces)
        symbols = [symbol for connection in connections for symbol in connection.symbols]
        markers = [marker for symbol in symbols for marker in symbol.markers]
        on_ground = [self.position(m, 0) for m in markers if isinstance(m, Ground)]
        points += [project(position)[None] for position in on_ground]
        return np.concatenate(points)


def _rigid_body(name: str, trajectory: Trajectory, steps: Integers) -> DrawnBody:
    """A body as its markers, without a mesh."""
    markers = trajectory.model.bodies[name].markers
    d, elastic = trajectory.model.dimension, trajectory.elastic(name)[steps]
    shapes = np.array([marker.displacement for marker in markers.values()])
    joints = trajectory.model.mechanism.joints
    on_body = [
        (j, m[1]) for j in joints for m in j.markers if isinstance(m, tuple) and m[0] == name
    ]
    return DrawnBody(
        name=name,
        mesh=None,
        reference=np.array([marker.position for marker in markers.values()]).reshape(-1, d),
        shapes=shapes.reshape(len(markers), d, elastic.shape[1]),
        markers=markers,
        jointed=list(dict.fromkeys(marker for _, marker in on_body)),
        welded=all(joint.rigid for joint, _ in on_body),
        position=trajectory.rigid(name)[steps, :d],
        rotation=trajectory.rotation(name)[steps],
        elastic=elastic,
        density=np.zeros(0),
        energy=np.zeros((len(steps), 0)),
    )


def _with_mesh(
    body: DrawnBody, problem: Problem, evaluation: Evaluation, energy: bool
) -> DrawnBody:
    """The body with its mesh and design, and with strain energies if asked for; collective."""
    flexible, reduced = problem.flexible[body.name], evaluation.bodies[body.name]
    domain = flexible.domain
    mesh = gathered_mesh(domain)
    energies = body.energy
    if energy:
        volumes = domain.cell_volumes * flexible.material.thickness
        fields = [reduced.basis.shapes @ q for q in body.elastic]
        total = [flexible.elasticity.strain_energy(reduced.density, field) for field in fields]
        energies = domain.on_rank_0((np.array(total) / volumes).T).T
    return replace(
        body,
        mesh=mesh,
        reference=mesh.points - flexible.reduction.origin,
        shapes=mesh.displacements(reduced.basis.shapes),
        density=domain.on_rank_0(reduced.density),
        energy=energies,
    )


def _rotation(turn: Array) -> Array:
    """The matrix of an angle or of a rotation vector, shape (d, d)."""
    if np.ndim(turn):
        return np.asarray(Rotation.from_rotvec(turn).as_matrix())
    c, s = np.cos(turn), np.sin(turn)
    return np.array([[c, -s], [s, c]])


def _similarity(a: Array, b: Array) -> Array:
    """The rotation times a stretch, (d, d), that takes points ``a`` to ``b``, (n, d) each.

    Points are relative to their means. Two of them come to their places exactly; of more, those in
    the plane do so in the sense of least squares, in space the line from the first to the last.
    """
    if a.shape[1] == 2:
        # as complex numbers: to turn and to stretch is to multiply by a factor
        before, after = a @ [1.0, 1.0j], b @ [1.0, 1.0j]
        squares = np.vdot(before, before).real
        factor = np.vdot(before, after) / squares if squares > 0.0 else 1.0
        return np.array([[factor.real, -factor.imag], [factor.imag, factor.real]])

    # the smallest turn of the line between the first and the last
    start, end = a[-1] - a[0], b[-1] - b[0]
    normal = np.cross(start, end)
    sine = float(np.linalg.norm(normal))
    angle = np.arctan2(sine, float(start @ end))
    turn = _rotation(normal * (angle / sine if sine > 0.0 else 0.0))
    stretch = np.linalg.norm(end) / (np.linalg.norm(start) or 1.0)
    return np.asarray(stretch * turn)


def _arm(marker: Moving, trajectory: Trajectory) -> Arm | None:
    """The circle on which a marker turns together with its axes; None if there is none."""
    table = marker.tabulate_in_space(trajectory.t, "picture")[:, 0]
    path, axes = table[:, 0], table[:, 1:].transpose(0, 2, 1)

    # path = centre + axes e, but for what both have along the axis of rotation
    matrix = np.concatenate([np.broadcast_to(np.eye(3), axes.shape), axes], axis=2).reshape(-1, 6)
    solution, _, rank, _ = np.linalg.lstsq(matrix, path.ravel(), rcond=1e-9)

    # of all points of the axis of rotation, the centre is the one beside the path
    normal = axes[0] @ np.array(marker.axis) / np.linalg.norm(marker.axis)
    center = solution[:3] + ((path[0] - solution[:3]) @ normal) * normal
    radius = float(np.linalg.norm(path[0] - center))
    misfit = float(np.max(np.abs(matrix @ solution - path.ravel())))
    if rank < 5 or radius == 0.0 or misfit > 1e-6 * radius:
        return None

    spoke = path[0] - center
    angles = np.linspace(0.0, 2.0 * np.pi, 181)[:, None]
    ring = center + np.cos(angles) * spoke + np.sin(angles) * np.cross(normal, spoke)
    d = trajectory.model.dimension
    return Arm(center[:d], ring[:, :d], marker)
