# SPDX-License-Identifier: MIT
"""Interface of time integration, its result, and derivatives with respect to the result."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, make_interp_spline

from .. import validation
from ..arrays import Array, Integers
from ..body import BodyMarker
from ..documentation import Shown
from .compilation import Compiled
from .equations import CONSTRAINTS
from .kinematics import (
    Kinematics,
    MarkerMotion,
    Momenta,
    Samples,
    applied_forces,
    momenta_of,
    motion_of_marker,
    turned_between,
)
from .model import FlatModel

#: Arrays of a trajectory with one row for each instant.
OVER_TIME = ("t", "y", "v", "w", "a", "multipliers", "stabilization", "turns")


@dataclass(frozen=True)
class Integrator(ABC):
    """A time integration method: integration, its exact transpose, and how its steps are refined.

    A new method is one class; its loops work on the equations of motion of any kinematics, see
    :mod:`dolfinx_ffr.dynamics.equations`.
    """

    order: ClassVar[int]  #: Order of positions, velocities and objectives in the time step.
    stages: ClassVar[int] = 1  #: Rows of a trajectory for each step.
    compiled: ClassVar[tuple[Compiled, ...]]  #: Compiled functions of the method.

    end_time: float  #: Duration of the simulation, which starts at zero [s].
    #: Relative error of an objective for which a `TimeInterval` chose these steps, else None
    chosen_for: float | None = field(default=None, repr=False, compare=False, kw_only=True)

    @property
    def times(self) -> Array:
        """Ends of fixed steps, shape (steps + 1,); of others, begin and end only [s]."""
        return np.array([0.0, self.end_time])

    @property
    @abstractmethod
    def instants(self) -> int:
        """Rows of a trajectory with given steps; zero where the steps follow from a tolerance."""

    @property
    def adaptive(self) -> bool:
        """Whether the steps follow from a tolerance."""
        return False

    @abstractmethod
    def amplification(self, phase: float) -> float:
        """Factor of the amplitude of an undamped vibration in a step, phase = omega h [rad]."""

    @property
    def in_words(self) -> str:
        """Method and number of steps, for messages."""
        name = type(self).__name__
        return name if self.adaptive else f"{name} with {self.times.size - 1:,} steps"

    @property
    @abstractmethod
    def finer(self) -> Integrator:
        """The method with steps half as long, or with a tenth of the tolerance."""

    @abstractmethod
    def integrate(self, model: FlatModel, y0: Array, v0: Array) -> Trajectory:
        """Trajectory of a model, tabulated at :attr:`times`, from consistent y0 and v0 (size,)."""

    @abstractmethod
    def pullback(self, trajectory: Trajectory, bar: TrajectoryBar) -> TrajectoryPullback:
        """Transpose of :meth:`integrate`, from the derivatives ``bar`` by a trajectory."""


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Shown):
    """Trajectory of a mechanism: its coordinates and forces over time.

    Coordinates of all bodies stand side by side, (R_x, R_y, theta, q_1, ..., q_r) for each; see
    :meth:`rigid`, :meth:`elastic` and :meth:`pose`. In space they are (R, phi, q_1, ..., q_r) with
    the rotation vector phi, see :meth:`rotation`; in its place velocities and accelerations have
    the angular velocity and acceleration in the body's axes. All arrays are the same on every rank.

    Attributes:
        t: Times, shape (steps + 1,) [s].
        y: Coordinates, shape (steps + 1, size) [m, rad].
        v: Velocities, shape (steps + 1, size) [m/s, rad/s].
        w: Accelerations, derivatives of v, shape (steps + 1, size) [m/s^2, rad/s^2].
        a: Accelerations of the integration method itself, shape (steps + 1, size) [m/s^2, rad/s^2].
        multipliers: Multipliers of the constraints, shape (steps + 1, rows) [N, N m]; minus the
            forces on the first markers, joint by joint, see :meth:`joint_force`.
        stabilization: Multipliers that keep the positions on the constraints, shape (steps + 1,
            rows); they tend to zero with the step.
        iterations: Newton iterations of each step, shape (steps,).
        beginning: Near-start state, from which the method's first acceleration follows:
            coordinates, velocities, accelerations and multipliers shortly after the start, shape
            (4, size).
        model: The compiled mechanism.
        integrator: The method that made it.
        weights: Weights of integrals over time, shape of t [s]; None stands for the trapezoidal
            rule.
        error: Estimate of the relative error, NaN where there is none: with a tolerance of
            `simulate`, the error of the positions, see there. Else, with Radau IIA, the largest
            error that a single step adds; a motion that magnifies errors ends further off.
        force_error: Estimate of the largest error of forces and moments in joints at single
            instants, relative to the largest of these, NaN where there is none. Integrals over time
            of forces are closer.
        turns: Unwrapped angles of drives, couplings and torsional springs in space, and of gears,
            two of each row and spring, shape (steps + 1, rows and springs, 2) [rad]; empty without
            them.
    """

    t: Array
    y: Array
    v: Array
    w: Array
    a: Array
    multipliers: Array
    stabilization: Array
    iterations: Integers
    beginning: Array
    model: FlatModel
    integrator: Integrator
    weights: Array | None = None
    error: float = math.nan
    force_error: float = math.nan
    turns: Array = field(default_factory=lambda: np.zeros((0, 0, 2)))

    def _shown(self) -> list[tuple[str, str, str]]:
        error = "" if math.isnan(self.error) else f"estimated {self.error:.1e}"
        if not math.isnan(self.force_error):
            error += f", of forces in joints {self.force_error:.1e}"
        if self.integrator.chosen_for is not None:  # by two methods, of psi
            error = f"chosen for {self.integrator.chosen_for:.1e} of psi"
        iterations = np.sum(self.iterations) / max(self.iterations.size, 1)
        newton = f"{iterations:.2g} Newton iterations each"
        return [
            ("bodies", ", ".join(self.model.bodies), ""),
            ("joints", ", ".join(self.model.joints), ""),
            ("time", f"{self.t[0]:g} to {self.t[-1]:g} s", ""),
            ("method", f"{self.integrator.in_words}, {newton}", error),
        ]

    @property
    def numbers(self) -> dict[str, Any]:
        """All fields but mechanism and method, to be sent to other ranks; see `restored`."""
        functions = ("model", "integrator")
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name not in functions}

    @property
    def steps(self) -> int:
        """Number of instants after the start; with Radau IIA each step counts three, its stages."""
        return self.t.size - 1

    @property
    def step_ends(self) -> Array:
        """Times at which steps end, the start included [s]."""
        return self.t[:: self.integrator.stages]

    @property
    def follows_turns(self) -> bool:
        """Whether every body in space turns by less than half a turn from instant to instant."""
        steps = np.diff(self.t)
        for place in self.model.arrays.turning:
            speed = np.linalg.norm(self.v[:, place : place + 3], axis=1)
            if np.any(np.maximum(speed[1:], speed[:-1]) * steps >= np.pi):
                return False
        return True

    def at(self, times: ArrayLike) -> Trajectory:
        """The trajectory at growing times (instants,) [s] between start and end, for pictures.

        Cubic splines go through the positions alone, as velocities hold vibrations that long steps
        do not resolve; rotations in space follow splines of their own kind. Accelerations and
        multipliers are interpolated linearly. There is no adjoint of it.

        Raises:
            ValueError: If a time is before the start or after the end of the motion, or times do
                not grow; or if a body in space turns by half a turn or more between two instants,
                so that its rotation between them is not known, see :attr:`follows_turns`.
        """
        times = validation.real_array(
            "trajectory.at: times", times, (None,), expected="a list of times, [0.1] for one"
        )
        begin, end = self.t[0], self.t[-1]
        slack = 1e-12 * (end - begin)  # of times that are sums
        if not times.size or np.any(np.diff(times) < 0.0):
            raise ValueError("trajectory.at: times must increase, and there must be at least one")
        if times[0] < begin - slack or times[-1] > end + slack:
            outside = times[0] if times[0] < begin - slack else times[-1]
            raise ValueError(
                f"trajectory.at: the motion lasts from {begin:g} to {end:g} s and is not defined "
                f"at {outside:g} s; give times within it"
            )
        times = np.clip(times, begin, end)
        if not self.follows_turns:
            raise ValueError(
                "a body turns by half a turn or more between two instants, so that its rotation "
                "between them is not known; simulate with shorter steps"
            )
        path = CubicSpline(self.t, self.y)
        y, v = path(times), path(times, 1)
        for place in self.model.arrays.turning:
            turn = slice(place, place + 3)
            y[:, turn], v[:, turn] = turned_between(self.t, self.y[:, turn], times)

        def linear(rows: Array) -> Array:
            return make_interp_spline(self.t, rows, k=1)(times) if rows.size else rows

        interpolated: dict[str, Any] = {name: linear(getattr(self, name)) for name in OVER_TIME[3:]}
        return replace(
            self,
            **interpolated,
            t=times,
            y=y,
            v=v,
            iterations=np.zeros(times.size - 1, dtype=np.int64),
            model=self.model.at(times),
            weights=None,
        )

    def rigid(self, body: str) -> Array:
        """Position and angle of a body's frame over time, shape (steps + 1, 3) [m, m, rad].

        In space the position and the rotation vector, shape (steps + 1, 6) [m, rad]. The vector is
        unwrapped as long as the axis of the rotation stays, and is one of the vectors of its
        rotation else; :meth:`rotation` gives the matrix.
        """
        return self.y[:, self.model.coordinates(body).rigid]

    def rotation(self, body: str) -> Array:
        """Rotation matrix of a body's frame over time, shape (steps + 1, d, d), d = 2 or 3."""
        return self.model.arrays.rotations(self.y[:, self.model.coordinates(body).rotation])

    def elastic(self, body: str) -> Array:
        """Elastic coordinates of a body over time, shape (steps + 1, modes)."""
        return self.y[:, self.model.coordinates(body).elastic]

    def pose(self, body: str, step: int) -> tuple[Array, float | Array, Array]:
        """Position (2,) [m] and angle [rad] of a body's frame, elastic coordinates, at a step.

        In space the position (3,), the rotation vector (3,) and the elastic coordinates (modes,).
        """
        columns, y = self.model.coordinates(body), self.y[step]
        return y[columns.position], y[columns.rotation], y[columns.elastic]

    def marker_path(self, body: str, marker: str) -> Array:
        """Position of a marker of a body over time, shape (steps + 1, 2), in space (..., 3) [m]."""
        rigid, point = self.rigid(body), self._marker(body, marker)
        local = point.position + point.shift(self.elastic(body))
        turned = np.einsum("tij,tj->ti", self.rotation(body), local)
        return np.asarray(rigid[:, : self.model.dimension] + turned)

    def marker_velocity(self, body: str, marker: str) -> Array:
        """Velocity of a ``marker`` of a ``body``, (steps + 1, 2), in space (..., 3) [m/s].

        Its components are those in the global axes.
        """
        return self._marker_motion(body, marker).velocity[:, : self.model.dimension]

    def marker_acceleration(self, body: str, marker: str) -> Array:
        """Acceleration of a ``marker`` of a ``body``, (steps + 1, 2), in space (..., 3) [m/s^2].

        Its components are those in the global axes. Where the mechanism gives the ground an
        acceleration, it is that relative to the ground.
        """
        return self._marker_motion(body, marker).acceleration[:, : self.model.dimension]

    def marker_rotation(self, body: str, marker: str) -> Array:
        """Rotation matrix of a ``marker`` of a ``body`` over time, (steps + 1, d, d), d = 2 or 3.

        It is that of the body's frame, turned by the elastic rotation at the marker, and in space
        by the marker's own axes in the body.
        """
        point = self._marker(body, marker)
        turn = self.model.arrays.rotations(self.elastic(body) @ point.rotation.T)
        turned = self.rotation(body) @ turn
        return np.asarray(turned if point.axes is None else turned @ point.axes)

    def marker_angle(self, body: str, marker: str) -> Array:
        """Angle of a ``marker`` of a ``body`` in the plane, turns counted, (steps + 1,) [rad].

        It is that of the body's frame and the elastic rotation at the marker.
        """
        point, columns = self._marker(body, marker), self.model.coordinates(body)
        if not point.planar:
            raise ValueError(
                f"marker {marker!r} of body {body!r} is in space, where a rotation is no angle; "
                "take the matrices of marker_rotation(body, marker)"
            )
        return np.asarray(self.y[:, columns.rotation] + self.elastic(body) @ point.rotation)

    def marker_angular_velocity(self, body: str, marker: str) -> Array:
        """Angular velocity of a ``marker`` of a ``body``, shape (steps + 1,) [rad/s].

        In space it is a vector in the global axes, shape (steps + 1, 3).
        """
        point, columns = self._marker(body, marker), self.model.coordinates(body)
        local = self.v[:, columns.rotation] + self.v[:, columns.elastic] @ point.rotation.T
        if local.ndim == 1:  # about the normal of the plane, which does not turn
            return np.asarray(local)
        return np.asarray(np.einsum("tij,tj->ti", self.rotation(body), local))

    def _marker(self, body: str, marker: str) -> BodyMarker:
        """A marker by name, or a ValueError with those that there are."""
        if body not in self.model.bodies:
            raise ValueError(f"no body {body!r}; the bodies are {list(self.model.bodies)}")
        markers = self.model.bodies[body].markers
        if marker not in markers:
            raise ValueError(
                f"body {body!r} has no marker {marker!r}; its markers are {list(markers)}"
            )
        return markers[marker]

    def _marker_motion(self, body: str, marker: str) -> MarkerMotion:
        """The motion of a marker as if in space."""
        point, columns = self._marker(body, marker), self.model.coordinates(body).all
        return motion_of_marker(
            point, *(states[:, columns] for states in (self.y, self.v, self.w))
        )[2]

    def joint_force(self, name: str) -> Array:
        """Force of the joint of a name on its first marker, shape (steps + 1, rows) [N, N m].

        A revolute joint gives (F_x, F_y) in global axes, a weld (F_x, F_y, M), a point on a line
        the force along the normal of the line, a translational joint that force and the moment, a
        distance the force along the line from the second to the first marker, a gear the force of
        the teeth along their line of action, positive where it turns the first wheel about its
        axis, a coupling of angles the moment on its first marker, a prescribed angle or position
        the driving moment or force. In space come first forces, along the global axes where markers
        coincide and else along directions of the second marker that the joint locks, then moments
        about axes of the second marker. A joint with an axis has two perpendicular ones, x and y if
        the axis is z, y and z if it is x, and then the axis itself, where the joint locks it. On
        the second marker acts the opposite; of a coupling of angles, minus ratio times the moment;
        of a line, also the moment of the force about the marker through which the line passes.
        """
        if name not in self.model.joints:
            raise ValueError(f"no joint {name!r}; the joints are {list(self.model.joints)}")
        return -self.multipliers[:, self.model.joints[name]]

    def drive_power(self, *drives: str) -> Array:
        """Power that drives bring into the bodies over time, shape (steps + 1,) [W].

        A drive is a joint with a motion, or one on a marker in prescribed motion, as the pin of a
        crank. The powers of several add up; where they brake, the power is negative. The force
        C_y^T lam of their rows on the bodies, of the opposite sign, moves with the velocities of
        these: P = -lam . (C_y v).
        """
        for name in drives:
            if name not in self.model.drives:
                raise ValueError(
                    f"joint {name!r} has no drive and no power; the joints with a motion or a "
                    f"marker in prescribed motion are {self.model.drives}"
                )
        kinematics, multipliers = self.of_joints(drives)
        power = np.zeros(len(self.t))
        for k, lam in enumerate(multipliers):
            kinematics.set(self.y[k], self.v[k], None, lam)
            kinematics.evaluate(k, CONSTRAINTS)
            power[k] = -lam @ (kinematics.equations.C @ self.v[k])
        return power

    def of_joints(self, joints: Sequence[str]) -> tuple[Kinematics, Array]:
        """Kinematics, and multipliers (steps + 1, rows) that are zero but for some joints."""
        multipliers = np.zeros_like(self.multipliers)
        for name in joints:
            rows = self.model.joints[name]
            multipliers[:, rows] = self.multipliers[:, rows]
        return Kinematics(self.model.arrays, self.turns), multipliers

    def applied_force(self, name: str) -> Array:
        """Force of the force, spring or damper of a name, shape (steps + 1, 3) [N, N, N m].

        (F_x, F_y, M) on its first marker in global axes; on the second acts the opposite. In space
        a force or a moment has its components in global axes, shape (steps + 1, 3), and springs
        have the tension of each, positive where they pull, shape (steps + 1, springs).
        """
        names = self.model.mechanism.force_names
        if name not in names:
            raise ValueError(f"no force {name!r}; the forces are {names}")
        forces = applied_forces(self.model.arrays, self.y, self.v, self.turns)
        numbers = self.model.forces[name]
        return self.model.arrays.force_of(forces[:, numbers], numbers)

    def kinetic_energy(self, body: str) -> Array:
        """Kinetic energy of a body and its point masses over time, shape (steps + 1,) [J]."""
        return self._momenta(body).kinetic

    def strain_energy(self, body: str) -> Array:
        """Elastic energy of a body over time, shape (steps + 1,) [J]."""
        q = self.elastic(body)
        return 0.5 * np.sum((q @ self.model.bodies[body].K) * q, axis=1)

    def potential_energy(self, body: str) -> Array:
        """Energy of a body and its point masses in the field of gravity, (steps + 1,) [J].

        An acceleration of the ground counts as gravity of the opposite sign; where either changes
        over time, the energy is that in the field of the moment.
        """
        moment = self._momenta(body).first_moment
        return -np.sum(moment * self.model.arrays.gravity[: self.steps + 1], axis=1)

    def linear_momentum(self, body: str) -> Array:
        """Linear momentum of a body and its point masses, (steps + 1, 2 or 3) [kg m/s]."""
        return self._momenta(body).linear

    def angular_momentum(self, body: str) -> Array:
        """Angular momentum of a body about the global origin [kg m^2/s].

        The shape is (steps + 1,), in space (steps + 1, 3).
        """
        return self._momenta(body).angular

    def _momenta(self, body: str) -> Momenta:
        return momenta_of(self.model.arrays, self.model.body_index(body), self.y, self.v)


def at_rest(model: FlatModel, times: Array, integrator: Integrator) -> Trajectory:
    """A trajectory of zeros at the times of a method's rows, to be filled in."""
    size, steps = model.size, (times.size - 1) // integrator.stages
    y, v, w, a = (np.zeros((times.size, size)) for _ in range(4))
    multipliers, stabilization = (np.zeros((times.size, model.rows)) for _ in range(2))
    return Trajectory(
        times,
        y,
        v,
        w,
        a,
        multipliers,
        stabilization,
        iterations=np.zeros(steps, dtype=np.int64),
        beginning=np.zeros((4, size)),
        model=model,
        integrator=integrator,
    )


def leading(trajectory: Trajectory, steps: int) -> Trajectory:
    """The first steps of a trajectory."""
    if steps == trajectory.iterations.size:
        return trajectory
    rows = trajectory.integrator.stages * steps + 1
    over_time: dict[str, Any] = {name: getattr(trajectory, name)[:rows] for name in OVER_TIME}
    return replace(trajectory, **over_time, iterations=trajectory.iterations[:steps])


def joined(stretches: Sequence[Trajectory], first_rows: Sequence[int]) -> Trajectory:
    """One trajectory of several that follow each other, each taken from its first row on."""

    def join(name: str) -> Array:
        pairs = zip(stretches, first_rows, strict=True)
        return np.concatenate([getattr(stretch, name)[row:] for stretch, row in pairs])

    over_time: dict[str, Any] = {name: join(name) for name in OVER_TIME}
    iterations = np.concatenate([stretch.iterations for stretch in stretches])
    return replace(stretches[0], **over_time, iterations=iterations)


@dataclass(frozen=True, eq=False, repr=False)
class TrajectoryBar(Shown):
    """Derivatives of a number with respect to a trajectory."""

    #: With respect to the coordinates, shape (steps + 1, size); in space, at the place of
    #: rotations, with respect to turns dth about the body's axes, dA = A [dth].
    y: Array
    v: Array  #: With respect to the velocities, shape (steps + 1, size).
    w: Array  #: With respect to the accelerations, shape (steps + 1, size).
    #: With respect to the multipliers, shape (steps + 1, rows). The columns of a joint are
    #: `trajectory.model.joints[name]`, in the order of :meth:`Trajectory.joint_force`, whose force
    #: is minus the multiplier: for psi that depends on forces enter minus dpsi/dforce here.
    multipliers: Array

    @staticmethod
    def zeros(trajectory: Trajectory) -> TrajectoryBar:
        """Zero derivatives with respect to a trajectory, to be filled in."""
        y, v, w = (np.zeros_like(trajectory.y) for _ in range(3))
        return TrajectoryBar(y, v, w, np.zeros_like(trajectory.multipliers))

    def scaled(self, factor: float) -> TrajectoryBar:
        """The derivatives times a factor."""
        return TrajectoryBar(*(factor * getattr(self, f.name) for f in fields(self)))

    def __add__(self, other: TrajectoryBar) -> TrajectoryBar:
        """Sum entry by entry."""
        sums = (getattr(self, f.name) + getattr(other, f.name) for f in fields(self))
        return TrajectoryBar(*sums)


class TrajectoryPullback(NamedTuple):
    """Result of the transpose of a time integration, from which the derivatives are gathered."""

    samples: Samples  #: States at which forces were evaluated, and the adjoint of the forces there.
    #: Vectors left and right over time, shape (instants, size) each: the metric D^-1 of the
    #: position corrections has the derivative sum of left . dD^-1 right.
    corrections: tuple[Array, Array]
    y_bar: Array  #: Derivative with respect to the coordinates at the start, shape (size,).
    v_bar: Array  #: Derivative with respect to the velocities at the start, shape (size,).
    #: Derivatives with respect to the markers' shape functions, see :func:`marker_bar`.
    marker_bars: Array
    #: Derivatives with respect to tables over time and constants, by field of the arrays.
    table_bars: dict[str, Array]
