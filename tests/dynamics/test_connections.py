# SPDX-License-Identifier: MIT
"""Every joint and every force, in each dimension in which it exists, between flexible bodies.

Rows hold, what acts on one body acts back on the other, work is the growth of energy, nothing
depends on the direction of the axes, a scene in the plane moves alike in space, and the adjoint is
exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from shared.derivatives import along, check_slope, dot
from shared.motions import energy_and_momenta
from shared.spatial_bodies import cloud, flat_cloud, stiffened_cloud

import dolfinx_ffr as ffr
from dolfinx_ffr import mechanism as language
from dolfinx_ffr.dynamics import Integrator, Trajectory
from dolfinx_ffr.dynamics.kinematics import evaluate_equations
from dolfinx_ffr.mechanism import AngleCoupling, AppliedForce, Joint

#: What is tested are equations, of motions that no one would want.
pytestmark = [
    pytest.mark.filterwarnings(f"ignore::dolfinx_ffr.{name}Warning")
    for name in ("LargeDeformation", "Softening", "dynamics.TiltedAxis", "TimeStep", "Placement")
]

Array = NDArray[np.float64]
A, B, FAR_A, FAR_B = ("one", "tip"), ("two", "root"), ("one", "root"), ("two", "tip")
Bodies = dict[str, ffr.VolumeIntegrals]
METHODS = [ffr.RadauIIA(0.3, steps=15), ffr.GeneralizedAlpha(0.2, 24)]
WAY, STROKE = ffr.Motion.polynomial([0.1, 0.3, 0.5]), ffr.Motion.polynomial([1.9, 0.3, 0.5])


@dataclass(frozen=True)
class Frame:
    """Where a scene is: in the plane, in space, or flat in space; its global axes may be turned."""

    dimension: int
    turned: bool = False
    flat: bool = False

    @property
    def out(self) -> float:
        """By which components out of the plane are multiplied."""
        return 0.0 if self.flat else 1.0

    @property
    def turn(self) -> Array:
        """Rotation of the scene, shape (3, 3)."""
        vector = (0.4, -0.7, 1.1) if self.dimension == 3 else (0.0, 0.0, 1.1)
        return language.rotation_matrix(vector if self.turned else (0.0, 0.0, 0.0))

    def spatial(self, x: float, y: float, z: float = 0.0) -> tuple[float, ...]:
        """A vector in the global axes."""
        return tuple((self.turn @ np.array([x, y, self.out * z]))[: self.dimension].tolist())

    @property
    def line(self) -> tuple[float, ...]:
        """A direction in the axes of a marker."""
        return (1.0, 0.4, 0.2 * self.out)[: self.dimension]

    @property
    def axis(self) -> tuple[float, ...]:
        """An axis in the axes of a marker, in the plane z."""
        tilt = self.out * (self.dimension - 2.0)
        return (0.3 * tilt, 0.2 * tilt, 1.0)

    @property
    def ground_axis(self) -> tuple[float, ...]:
        """The same in the global axes."""
        return tuple((self.turn @ self.axis).tolist())

    @property
    def moment(self) -> Any:
        """A moment in the global axes."""
        axis = [0.3 * self.out, 0.2 * self.out, 3.0]
        return tuple((self.turn @ axis).tolist()) if self.dimension == 3 else 3.0

    def bodies(self, seed: int = 0) -> Bodies:
        """Two flexible bodies, the first with geometric stiffness, also of its markers."""
        if self.dimension == 3 and not self.flat:
            return {"one": stiffened_cloud(3, 1 + seed), "two": cloud(2, 2 + seed)}
        one, two = (flat_cloud(3 - k, 1 + k + seed, space=self.flat) for k in range(2))
        markers = {name: replace(marker, stiffening=None) for name, marker in two.markers.items()}
        return {"one": one, "two": replace(two, markers=markers, stiffening={})}

    def placement(self, position: tuple[float, ...], angle: float, spin: float) -> ffr.Placement:
        """A place and a spin about an axis that is z in the plane."""
        place, speed = self.spatial(*position), self.spatial(0.1, -0.3, 0.2)
        if self.dimension == 2:
            return ffr.Placement(place, angle + 1.1 * self.turned, speed, spin)
        axis = np.array([0.2 * self.out, 0.1 * self.out, 1.0])
        rotation = self.turn @ language.rotation_matrix(angle * axis)
        return ffr.Placement(place, 0.0, speed, tuple(self.turn @ (spin * axis)), rotation)


Make = Callable[[Frame], tuple[list[Joint], list[AppliedForce]]]


def joint(*make: Callable[[Frame], Joint]) -> Make:
    return lambda frame: ([one(frame) for one in make], [])


def force(make: Callable[[Frame], AppliedForce]) -> Make:
    return lambda frame: ([], [make(frame)])


#: What it is, where it exists, how many rows it has there
BOTH = {2, 3}
JOINTS: list[tuple[str, set[int], tuple[int, int], Make]] = [
    ("revolute", BOTH, (2, 5), joint(lambda f: ffr.Revolute(A, B, axis=f.axis))),
    ("weld", BOTH, (3, 6), joint(lambda f: ffr.Weld(A, B))),
    ("line", BOTH, (1, 2), joint(lambda f: ffr.PointOnLine(A, B, f.line))),
    ("translational", BOTH, (2, 5), joint(lambda f: ffr.Translational(A, B, f.line))),
    (
        "coupling",
        BOTH,
        (1, 1),
        joint(lambda f: AngleCoupling(A, B, -1.7, axis=f.ground_axis)),
    ),
    (
        *("housed", BOTH, (1, 1)),
        joint(lambda f: AngleCoupling(A, B, -1.7, axis=f.axis, relative_to=FAR_A)),
    ),
    (
        *("gear", BOTH, (1, 1)),
        joint(lambda f: ffr.Gear(A, B, -1.7, "", -0.3, relative_to=FAR_A, axis=f.axis)),
    ),
    (
        *("ring", BOTH, (1, 1)),
        joint(lambda f: ffr.Gear(A, B, 1.7, "", -0.3, relative_to=FAR_B, axis=f.axis)),
    ),
    ("distance", BOTH, (1, 1), joint(lambda f: ffr.Distance(FAR_A, FAR_B))),
    ("cylinder", BOTH, (1, 1), joint(lambda f: ffr.Distance(FAR_A, FAR_B, STROKE))),
    (
        *("angle", BOTH, (3, 6)),
        joint(
            lambda f: ffr.Revolute(A, B, axis=f.axis),
            lambda f: ffr.PrescribedAngle(A, WAY, B, axis=f.axis),
        ),
    ),
    ("position", BOTH, (1, 1), joint(lambda f: ffr.PrescribedPosition(A, "y", WAY))),
    ("drive", BOTH, (1, 1), joint(lambda f: ffr.LinearDrive(A, B, WAY, f.line))),
    ("spherical", {3}, (0, 3), joint(lambda f: ffr.Spherical(A, B))),
    ("universal", {3}, (0, 4), joint(lambda f: ffr.Universal(A, B))),
    ("cylindrical", {3}, (0, 4), joint(lambda f: ffr.Cylindrical(A, B, f.axis))),
    ("planar", {3}, (0, 3), joint(lambda f: ffr.Planar(A, B, f.axis))),
    ("plane", {3}, (0, 1), joint(lambda f: ffr.PointOnPlane(A, B, f.axis))),
]
FORCES: list[tuple[str, set[int], Callable[[Frame], AppliedForce]]] = [
    ("spring", BOTH, lambda f: ffr.SpringDamper(FAR_A, FAR_B, 40.0, 2.0)),
    ("bearing", BOTH, lambda f: ffr.SpringDamper(A, B, 40.0, length=0.0)),
    ("damper", BOTH, lambda f: ffr.SpringDamper(A, B, 0.0, 2.0, length=0.0)),
    ("torsion", BOTH, lambda f: ffr.TorsionalSpringDamper(A, B, 9.0, 0.2, 0.3, axis=f.axis)),
    ("bushing", {3}, lambda f: ffr.Bushing(A, B, (9, 8, 7), (1, 1, 1), (5, 6, 7))),
    (
        "follower",
        BOTH,
        lambda f: ffr.Force(A, 3.0, lambda t: 20.0 * t, True, z=(f.dimension - 2.0) * f.out),
    ),
    ("torque", BOTH, lambda f: ffr.Torque(A, f.moment)),
]
CASES = JOINTS + [(name, where, (0, 0), force(make)) for name, where, make in FORCES]
MAKE = {name: make for name, _, _, make in CASES}
#: What acts on the ground or from outside; the damper resists the turning of the line between ends
NOT_BETWEEN = ("coupling", "position", "damper", "follower", "torque")
DRIVEN = ("cylinder", "angle", "position", "drive")
RUNS = [(name, d, rows[d - 2], make) for name, where, rows, make in CASES for d in sorted(where)]
every = pytest.mark.parametrize(
    ("name", "dimension", "rows", "make"), RUNS, ids=[f"{name}-{d}" for name, d, *_ in RUNS]
)


def scene(frame: Frame, make: Make, **more: Any) -> ffr.Mechanism:
    joints, forces = make(frame)
    placements = {
        "one": frame.placement((0.5, 0.0, 0.0), 0.1, 0.8),
        "two": frame.placement((1.5, 0.1, -0.1), -0.2, -0.5),
    }
    return ffr.Mechanism(placements, joints, forces=forces, **more)


def run(frame: Frame, make: Make, bodies: Bodies | None = None, **more: Any) -> Trajectory:
    return ffr.simulate(scene(frame, make, **more), bodies or frame.bodies(), METHODS[0])


def weighed(frame: Frame, make: Make, bodies: Bodies | None = None) -> Trajectory:
    """Under gravity, with a point mass and damping."""
    loads = {"point_masses": [ffr.PointMass(B, 0.2)], "damping": {"one": ffr.RayleighDamping(0.1)}}
    return run(frame, make, bodies, gravity=frame.spatial(1.0, -3.0, 2.0), **loads)


@every
def test_rows_hold_and_momentum_stays(name: str, dimension: int, rows: int, make: Make) -> None:
    """So does the energy, where a joint is not driven: it does no work."""
    motion = run(Frame(dimension), make)
    model = motion.model
    assert model.rows == rows
    assert sum(motion.joint_force(label).shape[1] for label in model.joints) == rows
    state = motion.y[-1], motion.v[-1], motion.w[-1], motion.multipliers[-1]
    equations = evaluate_equations(model.arrays, motion.t.size - 1, *state, motion.turns)
    np.testing.assert_allclose(equations.residual[len(state[0]) :], 0.0, atol=1e-10)
    energy, *momenta = energy_and_momenta(motion)
    if model.joints and name not in DRIVEN:
        np.testing.assert_allclose(energy, energy[0], rtol=1e-4)
    if name in NOT_BETWEEN:
        return
    for whole in momenta:
        np.testing.assert_allclose(whole, np.broadcast_to(whole[0], whole.shape), atol=1e-5)


#: Positions along global axes, and angles about axes of the ground that no bearing holds, do
free = pytest.mark.parametrize(
    ("name", "dimension", "rows", "make"),
    [
        given
        for given in RUNS
        if given[:2] not in {("position", 2), ("position", 3), ("coupling", 3)}
    ],
    ids=lambda value: value if isinstance(value, str) else None,
)


@free
def test_nothing_depends_on_the_global_axes(
    name: str, dimension: int, rows: int, make: Make
) -> None:
    here, there = (weighed(Frame(dimension, turned), make) for turned in (False, True))
    for each in here.model.bodies:
        np.testing.assert_allclose(there.elastic(each), here.elastic(each), atol=1e-8)
        np.testing.assert_allclose(there.kinetic_energy(each), here.kinetic_energy(each), rtol=1e-7)
    for label in here.model.joints:
        sizes = (np.linalg.norm(motion.joint_force(label), axis=1) for motion in (there, here))
        np.testing.assert_allclose(*sizes, rtol=1e-6, atol=1e-6)


def without_turns(bodies: Bodies) -> Bodies:
    """Markers whose axes do not turn: in space they do so in the first order of deflections."""
    return {
        name: replace(
            body,
            markers={key: replace(m, rotation=0.0 * m.rotation) for key, m in body.markers.items()},
        )
        for name, body in bodies.items()
    }


@pytest.mark.parametrize("name", [name for name, where, *_ in CASES if 2 in where])
def test_a_scene_in_the_plane_moves_alike_in_space(name: str) -> None:
    plane, space = (
        weighed(frame, MAKE[name], without_turns(frame.bodies()))
        for frame in (Frame(2), Frame(3, flat=True))
    )
    for each in plane.model.bodies:
        flat, full = plane.rigid(each), space.rigid(each)
        np.testing.assert_allclose(full[:, [0, 1, 5]], flat, atol=1e-11)
        np.testing.assert_allclose(full[:, 2:5], 0.0, atol=1e-11)
        np.testing.assert_allclose(space.elastic(each), plane.elastic(each), atol=1e-11)
        for part in ("kinetic_energy", "potential_energy", "strain_energy"):
            here, there = (getattr(motion, part)(each) for motion in (plane, space))
            np.testing.assert_allclose(there, here, atol=1e-10)
        spin = space.angular_momentum(each)[:, 2]
        np.testing.assert_allclose(spin, plane.angular_momentum(each), atol=1e-10)
    for label in plane.model.joints:
        sizes = (np.linalg.norm(motion.joint_force(label), axis=1) for motion in (space, plane))
        np.testing.assert_allclose(*sizes, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*DRIVEN, *(name for name, where, _ in FORCES if 2 in where)])
def test_work_is_the_growth_of_energy(name: str) -> None:
    """Work and impulses of forces, and the work of drives, by differences of marker paths."""
    frame, method = Frame(2), ffr.GeneralizedAlpha(0.3, 3000, 1.0)
    t = ffr.simulate(scene(frame, MAKE[name]), frame.bodies(), method)
    power, push, moment = np.zeros(t.t.size), np.zeros((t.t.size, 2)), np.zeros(t.t.size)

    def rate(way: Array) -> Array:
        return np.gradient(way, t.t, axis=0, edge_order=2)

    for each in t.model.mechanism.forces:
        force = t.applied_force(each.label)
        for sign, (body, marker) in zip((1.0, -1.0), each.markers, strict=False):
            path, turns = t.marker_path(body, marker), t.model.bodies[body].markers[marker].rotation
            angle = t.rigid(body)[:, 2] + t.elastic(body) @ turns
            power += sign * (np.sum(force[:, :2] * rate(path), axis=1) + force[:, 2] * rate(angle))
            push += sign * force[:, :2]
            moment += sign * (path[:, 0] * force[:, 1] - path[:, 1] * force[:, 0] + force[:, 2])
    if name in DRIVEN:
        power = -t.multipliers[:, -1] * (STROKE if name == "cylinder" else WAY).tabulate(t.t)[1]
    growths = zip(energy_and_momenta(t), (power, push, moment), (1e-4, 1e-5, 1e-5), strict=True)
    for growth, part, share in list(growths)[: 1 if name in DRIVEN else 3]:
        scale = np.ptp(growth) if part is power else 1.0
        work = cumulative_trapezoid(part, t.t, axis=0, initial=0)
        np.testing.assert_allclose(growth - growth[0], work, atol=share * scale)


#: The others are in the scenes of test_adjoint.py, which are for Radau IIA, too
BY_RADAU = [
    (ffr.RadauIIA(0.2, steps=8), name, 3, rows[1], make)
    for name, where, rows, make in CASES
    if where == {3}
]
BY_ALPHA = [(ffr.GeneralizedAlpha(0.2, 24), *run) for run in RUNS]


@pytest.mark.parametrize(
    ("integrator", "name", "dimension", "rows", "make"),
    [*BY_ALPHA, *(pytest.param(*case, marks=pytest.mark.slow) for case in BY_RADAU)],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__[:7],
)
def test_taylor_order(
    integrator: Integrator, name: str, dimension: int, rows: int, make: Make
) -> None:
    """By all integrals of the bodies, also those at markers, of numbers of motions and forces."""
    frame = Frame(dimension)
    mechanism, start, end = scene(frame, make), frame.bodies(), frame.bodies(20)
    objective = ffr.IntegralCompliance() + ffr.MarkerVelocity(*FAR_B)
    objective += 1e-3 * ffr.MarkerAcceleration(*FAR_A) + ffr.PathTracking(*A, (0.1,) * dimension)
    for label in mechanism.joint_names:
        objective += 0.01 * ffr.JointForce(label)
    problem = ffr.MechanicalProblem(mechanism, integrator, objective)
    change = {each: end[each] + start[each].scaled(-1.0) for each in start}
    slope = dot(problem.gradient(start).integrals_gradient, change)
    psi = along(lambda moved: problem.value(moved).psi, start, change)
    check_slope(psi, slope, 4e-3, count=4, ratio=10.0**0.5)


def test_every_joint_and_force_is_here() -> None:
    tested = {
        type(thing)
        for _, where, _, make in CASES
        for part in make(Frame(max(where)))
        for thing in part
    }
    kinds = [kind for kind in vars(language).values() if isinstance(kind, type)]
    public = {kind for kind in kinds if issubclass(kind, Joint | AppliedForce)}
    assert public - {Joint, AppliedForce} == tested
