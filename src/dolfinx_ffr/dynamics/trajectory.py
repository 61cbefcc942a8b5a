# SPDX-License-Identifier: MIT
"""Time integration as a contract, its result, and derivatives with respect to that."""

from __future__ import annotations

import math
import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, make_interp_spline

from . import planar, spatial
from .compilation import Compiled
from .kinematics import applied_forces
from .model import FlatModel
from .samples import Samples

__all__ = ["Integrator", "Trajectory", "TrajectoryBar", "TrajectoryPullback"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Integrator(ABC):
    """A time integration method: integration, its exact transpose, and how its steps are refined.

    A new method is one class; its loops work on the equations of motion of any kinematics, see
    :mod:`dolfinx_ffr.dynamics.equations`.
    """

    #: Order of positions, velocities and objectives in the time step.
    order: ClassVar[int]
    #: Rows of a trajectory for each step.
    stages: ClassVar[int] = 1
    #: Compiled functions of the method.
    compiled: ClassVar[tuple[Compiled, ...]]

    #: Duration of the simulation, which starts at zero [s].
    end_time: float
    #: Whether the steps were chosen for an accuracy of an objective.
    judged: bool = False

    @property
    @abstractmethod
    def times(self) -> Array:
        """Ends of fixed steps, shape (steps + 1,); of adaptive ones, begin and end only [s]."""

    @property
    @abstractmethod
    def instants(self) -> int:
        """Rows of a trajectory with given steps; zero where the steps follow from a tolerance."""

    @property
    def adaptive(self) -> bool:
        """Whether the steps follow from a tolerance."""
        return False

    @property
    @abstractmethod
    def coarser(self) -> Integrator:
        """The method with steps about twice as long, for an estimate of the error."""

    @property
    @abstractmethod
    def finer(self) -> Integrator:
        """The method with steps half as long, or with a tenth of the tolerance."""

    @property
    def finest(self) -> bool:
        """Whether a smaller tolerance would not be met."""
        return False

    @property
    @abstractmethod
    def remedy(self) -> str:
        """What to do where an accuracy is out of reach."""

    def with_steps_of(self, trajectory: Trajectory) -> Integrator:
        """The method with the steps that a motion has taken.

        Args:
            trajectory: A motion that the method has computed.
        """
        return self

    def toward(self, tolerance: float) -> Integrator:
        """The method from which to seek steps for a tolerance.

        Args:
            tolerance: Largest error of the result that is allowed.
        """
        return self

    @abstractmethod
    def integrate(self, model: FlatModel, y0: Array, v0: Array) -> Trajectory:
        """Motion from a consistent start.

        Args:
            model: The compiled mechanism, tabulated at :attr:`times`.
            y0: Coordinates at the start, shape (size,).
            v0: Velocities at the start, shape (size,).

        Raises:
            SimulationError: If Newton's method does not converge, the mechanism becomes singular,
                or the steps become too small.
        """

    @abstractmethod
    def pullback(self, trajectory: Trajectory, bar: TrajectoryBar) -> TrajectoryPullback:
        """Transpose of :meth:`integrate`.

        Args:
            trajectory: A motion that the method has computed.
            bar: Derivatives of a number with respect to it.

        Raises:
            RuntimeError: If the matrix of a step is singular.
        """


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Motion of a mechanism over time.

    Coordinates of all bodies stand side by side, (R_x, R_y, theta, q_1, ..., q_r) for each; see
    :meth:`rigid`, :meth:`elastic` and :meth:`pose`. In space they are (R, phi, q_1, ..., q_r) with
    the vector phi of the rotation, whose place angular velocity and angular acceleration in the
    body's axes take among velocities and accelerations; see :meth:`rotation`. All arrays are the
    same on every rank.
    """

    #: Times, shape (steps + 1,) [s].
    t: Array
    #: Coordinates, shape (steps + 1, size) [m, rad].
    y: Array
    #: Velocities, shape (steps + 1, size) [m/s, rad/s].
    v: Array
    #: Accelerations, derivatives of v, shape (steps + 1, size) [m/s^2, rad/s^2].
    w: Array
    #: Accelerations of the integration method itself, shape (steps + 1, size) [m/s^2, rad/s^2].
    a: Array
    #: Multipliers of the constraints, shape (steps + 1, rows) [N, N m].
    multipliers: Array
    #: Multipliers that keep the positions on the constraints, shape (steps + 1, rows); they tend
    #: to zero with the step.
    stabilization: Array
    #: Newton iterations of each step, shape (steps,).
    iterations: Integers
    #: Coordinates, velocities, accelerations and multipliers shortly after the start, shape
    #: (4, size); they settle the method's first acceleration.
    beginning: Array
    #: The compiled mechanism.
    model: FlatModel
    #: The method that made it.
    integrator: Integrator
    #: Weights of integrals over time, shape of t [s]; None stands for the trapezoidal rule.
    weights: Array | None = None
    #: Estimate of the relative error, NaN where there is none. Where `simulate` was given a
    #: tolerance, the error of the positions, see there. Else, with Radau IIA, the error that a
    #: single step adds, the largest of all; a motion that magnifies errors ends further off.
    error: float = math.nan

    @property
    def method(self) -> tuple[float, ...]:
        """Parameters of the generalised-alpha method, else empty; use `integrator`."""
        warnings.warn(
            "Trajectory.method goes with the next release; use Trajectory.integrator",
            DeprecationWarning,
            stacklevel=2,
        )
        return getattr(self.integrator, "parameters", ())

    @property
    def numbers(self) -> dict[str, Any]:
        """All of it but the mechanism and the method, to be sent to other ranks; see `restored`."""
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

    def at(self, times: Array) -> Trajectory:
        """The motion between its instants, for pictures: by cubic splines, in the plane only.

        They go through the positions alone, as velocities hold vibrations that long steps do not
        resolve. Accelerations and multipliers go straight. There is no adjoint of it.

        Args:
            times: Times that grow, from the start to the end, shape (instants,) [s].
        """
        path = CubicSpline(self.t, self.y)

        def straight(rows: Array) -> Array:
            return make_interp_spline(self.t, rows, k=1)(times)

        return replace(
            self,
            t=times,
            y=path(times),
            v=path(times, 1),
            w=straight(self.w),
            a=straight(self.a),
            multipliers=straight(self.multipliers),
            stabilization=straight(self.stabilization),
            iterations=np.zeros(times.size - 1, dtype=np.int64),
            model=self.model.at(times),
            weights=None,
        )

    def rigid(self, body: str) -> Array:
        """Position and angle of a body's frame over time, shape (steps + 1, 3) [m, m, rad].

        In space the position and the vector of the rotation, shape (steps + 1, 6) [m, rad].

        Args:
            body: Name of the body.
        """
        return self.y[:, self.model.coordinates(body).rigid]

    def rotation(self, body: str) -> Array:
        """Rotation matrix of a body's frame over time, shape (steps + 1, d, d), d = 2 or 3.

        Args:
            body: Name of the body.
        """
        where = self.model.coordinates(body)
        if isinstance(where, spatial.Coordinates):
            return spatial.rotations_of(self.y[:, where.rotation])
        c, s = np.cos(self.y[:, where.rotation]), np.sin(self.y[:, where.rotation])
        return np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)

    def elastic(self, body: str) -> Array:
        """Elastic coordinates of a body over time, shape (steps + 1, modes).

        Args:
            body: Name of the body.
        """
        return self.y[:, self.model.coordinates(body).elastic]

    def pose(self, body: str, step: int) -> tuple[Array, float | Array, Array]:
        """Position (2,) [m] and angle [rad] of a body's frame, elastic coordinates (modes,).

        In space position (3,), the vector of the rotation (3,) and elastic coordinates.

        Args:
            body: Name of the body.
            step: Number of the time step, from 0.
        """
        if self.model.dimension == 3:
            return *np.split(self.rigid(body)[step], 2), self.elastic(body)[step]
        x, y, angle = self.rigid(body)[step]
        return np.array([x, y]), float(angle), self.elastic(body)[step]

    def marker_path(self, body: str, marker: str) -> Array:
        """Position of a marker over time, shape (steps + 1, 2), in space (steps + 1, 3) [m].

        Args:
            body: Name of the body.
            marker: Name of the marker.

        Raises:
            ValueError: If there is no such marker; the message lists the markers.
        """
        rigid, elastic = self.rigid(body), self.elastic(body)
        markers = self.model.bodies[body].markers
        if marker not in markers:
            raise ValueError(f"body {body!r} has no marker {marker!r}, but {list(markers)}")
        local = markers[marker].position + markers[marker].shift(elastic)
        if self.model.dimension == 3:
            return rigid[:, :3] + np.einsum("tij,tj->ti", self.rotation(body), local)
        return rigid[:, :2] + _rotated(local, rigid[:, 2])

    def joint_force(self, name: str) -> Array:
        """Force of a joint on its first marker over time, shape (steps + 1, rows) [N, N m].

        A revolute joint gives (F_x, F_y) in global axes, a weld (F_x, F_y, M), a point on a line
        the force along the normal of the line, a translational joint that force and the moment, a
        distance the force along the line from the second to the first marker, a gear the moment on
        its first marker, a prescribed angle or position the driving moment or force. In space come
        first forces, along the global axes where markers coincide and else along directions of the
        second marker that the joint locks, then moments about axes of the second marker. Those of
        a joint with an axis are two perpendicular ones, x and y if the axis is z, y and z if it is
        x, and then the axis itself, where the joint locks it. On the second
        marker acts the opposite; of a gear, minus ratio times the moment; of a line, also the
        moment of the force about the marker through which the line passes.

        Args:
            name: Name of the joint.

        Raises:
            ValueError: If there is no such joint; the message lists the joints.
        """
        if name not in self.model.joints:
            raise ValueError(f"no joint {name!r}; the joints are {list(self.model.joints)}")
        return -self.multipliers[:, self.model.joints[name]]

    def applied_force(self, name: str) -> Array:
        """Force of a force, spring or damper over time, shape (steps + 1, 3) [N, N, N m].

        Args:
            name: Name of the force.

        Returns:
            (F_x, F_y, M) on its first marker in global axes; on the second acts the opposite. In
            space a force or a moment has its components in global axes, shape (steps + 1, 3), and
            of springs there is the tension of each, positive where they pull, shape
            (steps + 1, springs).

        Raises:
            ValueError: If there is no such force; the message lists the forces.
        """
        names = self.model.mechanism.force_names
        if name not in names:
            raise ValueError(f"no force {name!r}; the forces are {names}")
        found = applied_forces(self.model.arrays, self.y, self.v)[:, self.model.forces[name]]
        arrays = self.model.arrays
        if isinstance(arrays, spatial.ModelArrays) and self.model.forces[name][0] < len(arrays.law):
            return np.asarray(found[:, :, 0])
        return np.asarray(found[:, 0])

    def kinetic_energy(self, body: str) -> Array:
        """Kinetic energy of a body and its point masses over time, shape (steps + 1,) [J].

        Args:
            body: Name of the body.
        """
        if self.model.dimension == 3:
            return self._momenta(body).kinetic
        m, S, G, N, _, _, velocity, omega, qh, vh = self._products(body)
        drift = _quarter_turn(qh @ S) * omega[:, None] + vh @ S
        turned = _rotated(velocity, -self.rigid(body)[:, 2])
        energy = 0.5 * m * np.sum(velocity**2, axis=1) + np.sum(turned * drift, axis=1)
        energy += 0.5 * omega**2 * _form(qh, G, qh) + omega * _form(qh, N, vh)
        return energy + 0.5 * _form(vh, G, vh)

    def strain_energy(self, body: str) -> Array:
        """Elastic energy of a body over time, shape (steps + 1,) [J].

        Args:
            body: Name of the body.
        """
        q = self.elastic(body)
        return 0.5 * _form(q, self.model.bodies[body].K, q)

    def potential_energy(self, body: str) -> Array:
        """Energy of a body and its point masses in the field of gravity, (steps + 1,) [J].

        An acceleration of the ground counts as gravity of the opposite sign; where either changes
        over time, the energy is that in the field of the moment.

        Args:
            body: Name of the body.
        """
        if self.model.dimension == 3:
            moment = self._momenta(body).first_moment
            return -np.sum(moment * self.model.arrays.gravity[: self.steps + 1], axis=1)
        m, S, _, _, position, angle, _, _, qh, _ = self._products(body)
        moment = m * position + _rotated(qh @ S, angle)
        return -np.sum(moment * self.model.arrays.gravity[: self.steps + 1], axis=1)

    def linear_momentum(self, body: str) -> Array:
        """Linear momentum of a body and its point masses [kg m/s].

        Args:
            body: Name of the body.

        Returns:
            Shape (steps + 1, 2), in space (steps + 1, 3).
        """
        if self.model.dimension == 3:
            return self._momenta(body).linear
        m, S, _, _, _, angle, velocity, omega, qh, vh = self._products(body)
        return m * velocity + _rotated(omega[:, None] * _quarter_turn(qh @ S) + vh @ S, angle)

    def angular_momentum(self, body: str) -> Array:
        """Angular momentum about the origin of the global axes [kg m^2/s].

        Args:
            body: Name of the body.

        Returns:
            Shape (steps + 1,), in space (steps + 1, 3).
        """
        if self.model.dimension == 3:
            return self._momenta(body).angular
        _, S, G, N, position, angle, velocity, omega, qh, vh = self._products(body)
        own = omega * _form(qh, G, qh) + _form(qh, N, vh)
        arm = _rotated(qh @ S, angle)
        return _cross(position, self.linear_momentum(body)) + _cross(arm, velocity) + own

    def _momenta(self, body: str) -> spatial.Momenta:
        arrays, b = self.model.arrays, self.model.body_index(body)
        assert isinstance(arrays, spatial.ModelArrays)
        return spatial.momenta_of(arrays, b, self.y, self.v)

    def _products(self, body: str) -> tuple:
        arrays, b = self.model.arrays, self.model.body_index(body)
        assert isinstance(arrays, planar.ModelArrays)
        n, where = int(arrays.modes[b]) + 1, self.model.coordinates(body)
        y, v = self.y, self.v
        qh = np.column_stack([np.ones(len(y)), y[:, where.elastic]])
        vh = np.column_stack([np.zeros(len(v)), v[:, where.elastic]])
        S, G, N = arrays.S[b, :n], arrays.G[b, :n, :n], arrays.N[b, :n, :n]
        position, velocity = y[:, where.position], v[:, where.position]
        angle, omega = y[:, where.rotation], v[:, where.rotation]
        return arrays.mass[b], S, G, N, position, angle, velocity, omega, qh, vh


@dataclass(frozen=True, eq=False)
class TrajectoryBar:
    """Derivatives of a number with respect to a trajectory."""

    #: With respect to the coordinates, shape (steps + 1, size); in space, at the place of
    #: rotations, with respect to turns dth about the body's axes, dA = A [dth].
    y: Array
    #: With respect to the velocities, shape (steps + 1, size).
    v: Array
    #: With respect to the accelerations, shape (steps + 1, size).
    w: Array
    #: With respect to the multipliers, shape (steps + 1, rows).
    multipliers: Array

    @staticmethod
    def zeros(trajectory: Trajectory) -> TrajectoryBar:
        """Zero derivatives, to be filled in.

        Args:
            trajectory: The trajectory.
        """
        y, v, w = (np.zeros_like(trajectory.y) for _ in range(3))
        return TrajectoryBar(y, v, w, np.zeros_like(trajectory.multipliers))

    def scaled(self, factor: float) -> TrajectoryBar:
        """The derivatives times a factor.

        Args:
            factor: The factor.
        """
        parts = (self.y, self.v, self.w, self.multipliers)
        return TrajectoryBar(*(factor * part for part in parts))

    def __add__(self, other: TrajectoryBar) -> TrajectoryBar:
        """Sum entry by entry."""
        return TrajectoryBar(
            self.y + other.y,
            self.v + other.v,
            self.w + other.w,
            self.multipliers + other.multipliers,
        )


class TrajectoryPullback(NamedTuple):
    """What the transpose of a time integration leaves to be gathered."""

    #: States at which forces were evaluated, and the adjoint of the forces there.
    samples: Samples
    #: Vectors left and right over time, shape (instants, size) each: the metric D^-1 of the
    #: position corrections has the derivative sum of left . dD^-1 right.
    corrections: tuple[Array, Array]
    #: Derivative with respect to the coordinates at the start, shape (size,).
    y_bar: Array
    #: Derivative with respect to the velocities at the start, shape (size,).
    v_bar: Array
    #: Derivatives with respect to the markers' shape functions, see :func:`marker_bar`.
    marker_bars: Array


def _rotated(vectors: Array, angles: Array) -> Array:
    """Turn vectors (n, 2) by angles (n,)."""
    c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
    return c * vectors + s * _quarter_turn(vectors)


def _quarter_turn(vectors: Array) -> Array:
    return np.stack([-vectors[:, 1], vectors[:, 0]], axis=1)


def _cross(a: Array, b: Array) -> Array:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _form(a: Array, matrix: Array, b: Array) -> Array:
    """Row by row a . matrix b."""
    return np.sum((a @ matrix) * b, axis=1)
