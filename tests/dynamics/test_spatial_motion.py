# SPDX-License-Identifier: MIT
"""Motions in space against closed forms, published numbers, planar scenes and invariants."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.linalg
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from shared.spatial_bodies import cloud, flat_cloud

from dolfinx_ffr.body import BodyMarker, VolumeIntegrals
from dolfinx_ffr.dynamics import (
    GeneralizedAlpha,
    Integrator,
    RadauIIA,
    TimeStepWarning,
    Trajectory,
    simulate,
)
from dolfinx_ffr.dynamics.kinematics import evaluate_equations
from dolfinx_ffr.dynamics.model import assemble_model
from dolfinx_ffr.mechanism import (
    Assembled,
    Cylindrical,
    Ground,
    Joint,
    Marker,
    Mechanism,
    Motion,
    Moving,
    Placement,
    PointMass,
    PointOnLine,
    PrescribedAngle,
    RayleighDamping,
    Revolute,
    SpatialRow,
    Spherical,
    SpringDamper,
    StaticEquilibrium,
    UndeformedInSpace,
    Universal,
    Weld,
)

Array = NDArray[np.float64]


def free_body(
    inertia: tuple[float, ...], spin: tuple[float, ...], end: float, n: int
) -> Trajectory:
    """A free rigid body from its angular velocity."""
    body = VolumeIntegrals.rigid(1.0, inertia=inertia)
    mechanism = Mechanism({"top": Placement((0.0, 0.0, 0.0), angular_velocity=spin)})  # type: ignore[arg-type]
    return simulate(mechanism, {"top": body}, GeneralizedAlpha(end, n))


def extrapolated(coarse: Array, fine: Array) -> Array:
    """Limit of results of second order with steps h and h / 2."""
    return np.asarray((4.0 * fine - coarse) / 3.0)


def test_torque_free_symmetric_top_is_of_second_order() -> None:
    J, spin, end = (0.2, 0.2, 0.35), (0.8, 0.0, 5.0), 2.0
    L = np.array(J) * spin
    exact = Rotation.from_rotvec(L * end / J[0]) * Rotation.from_rotvec(
        [0.0, 0.0, -(J[2] - J[0]) / J[0] * spin[2] * end]
    )
    errors = []
    for n in (200, 400):
        trajectory = free_body(J, spin, end, n)
        A = trajectory.rotation("top")
        errors.append(np.max(np.abs(A[-1] - exact.as_matrix())))
        np.testing.assert_allclose(
            A.transpose(0, 2, 1) @ A, np.tile(np.eye(3), (n + 1, 1, 1)), atol=1e-14
        )
    assert errors[1] < 3e-5
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)
    energy = trajectory.kinetic_energy("top")
    assert np.ptp(energy) < 1e-8 * energy[0]


def test_radau_is_of_fifth_order() -> None:
    J, spin, end = (0.2, 0.2, 0.35), (0.8, 0.0, 5.0), 2.0
    body = VolumeIntegrals.rigid(1.0, inertia=J)
    mechanism = Mechanism({"top": Placement((0.0, 0.0, 0.0), angular_velocity=spin)})
    L = np.array(J) * spin
    exact = Rotation.from_rotvec(L * end / J[0]) * Rotation.from_rotvec(
        [0.0, 0.0, -(J[2] - J[0]) / J[0] * spin[2] * end]
    )

    def error(integrator: RadauIIA) -> float:
        last = simulate(mechanism, {"top": body}, integrator).rotation("top")[-1]
        return float(np.max(np.abs(last - exact.as_matrix())))

    errors = [error(RadauIIA(end, steps=n)) for n in (20, 40, 80)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 5.0, atol=0.1)
    assert error(RadauIIA(end, tolerance=1e-8)) < 1e-8


def test_intermediate_axis() -> None:
    """Dzhanibekov's body turns over; reference by a Runge-Kutta method of order 8."""
    runs = [free_body((3.0, 2.0, 1.0), (0.1, 2.0, 0.1), 5.0, n) for n in (1000, 2000)]
    coarse, fine = (run.v[-1, 3:6] for run in runs)
    expected = (0.214448400638, -1.972824282695, 0.343459385675)
    np.testing.assert_allclose(extrapolated(coarse, fine), expected, atol=1e-6)
    body = VolumeIntegrals.rigid(1.0, inertia=(3.0, 2.0, 1.0))
    mechanism = Mechanism({"top": Placement((0.0, 0.0, 0.0), angular_velocity=(0.1, 2.0, 0.1))})
    trajectory = simulate(mechanism, {"top": body}, end_time=10.0, tolerance=1e-9)
    expected = (1.150535090216, 0.242501584624, -1.987760795834)
    np.testing.assert_allclose(trajectory.v[-1, 3:6], expected, atol=1e-7)


def test_heavy_top() -> None:
    """O. Brüls, A. Cardona, M. Arnold, doi:10.1016/j.mechmachtheory.2011.07.017."""
    inertia = (0.234375, 0.46875, 0.234375)
    body = VolumeIntegrals.rigid(15.0, (0.0, 1.0, 0.0), inertia, {"tip": (0.0, 0.0, 0.0)})
    spin = (0.0, 150.0, -4.61538)
    mechanism = Mechanism(
        {"top": Placement((0.0, 0.0, 0.0), angular_velocity=spin)},
        joints=[Spherical(("top", "tip"), Ground())],
        gravity=(0.0, 0.0, -9.81),
    )

    def axis(n: int) -> Array:
        integrator = GeneralizedAlpha(0.2, n)
        return simulate(mechanism, {"top": body}, integrator).rotation("top")[-1, :, 1]

    # Euler parameters of a Runge-Kutta method, the scalar first.
    e = (-0.708279152974, 0.438781088127, 0.545728396145, 0.089399752824)
    expected = Rotation.from_quat([*e[1:], e[0]]).as_matrix()[:, 1]
    np.testing.assert_allclose(extrapolated(axis(400), axis(800)), expected, atol=1e-5)


def test_rotor_that_turns_too_far_in_a_step_is_reported() -> None:
    with pytest.warns(TimeStepWarning, match="take 30[01] steps instead of 60"):
        free_body((0.2, 0.2, 0.35), (2.0, 0.0, math.sqrt(896.0)), 1.0, 60)


def test_conical_pendulum() -> None:
    """A slender rod about its end at thirty degrees: Omega^2 = 3 g / (2 L cos)."""
    mass, length, angle, g = 2.0, 1.0, math.pi / 6.0, 9.81
    thin = 1e-9
    body = VolumeIntegrals.rigid(
        mass,
        (0.0, 0.0, -length / 2.0),
        (mass * length**2 / 12.0, mass * length**2 / 12.0, thin),
        {"pivot": (0.0, 0.0, 0.0), "end": (0.0, 0.0, -length)},
    )
    speed = math.sqrt(3.0 * g / (2.0 * length * math.cos(angle)))
    assert speed == pytest.approx(4.12206482509)
    mechanism = Mechanism(
        {
            "rod": Placement(
                (0.0, 0.0, 0.0),
                rotation=(0.0, -angle, 0.0),
                angular_velocity=(0.0, 0.0, speed),
            )
        },
        joints=[Spherical(("rod", "pivot"), Ground())],
        gravity=(0.0, 0.0, -g),
    )
    trajectory = simulate(mechanism, {"rod": body}, GeneralizedAlpha(1.0, 200))
    end = trajectory.marker_path("rod", "end")
    np.testing.assert_allclose(end[:, 2], -length * math.cos(angle), atol=2e-5)
    phase = np.unwrap(np.arctan2(end[:, 1], end[:, 0]))
    assert phase[-1] - phase[0] == pytest.approx(speed, rel=1e-3)


@dataclass(frozen=True)
class Bearing(Joint):
    """A joint of one's own: an axis of the first marker keeps its direction, two rows."""

    a: Marker
    b: Marker
    axis: tuple[float, float, float]

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return self.a, self.b

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        return Cylindrical(self.a, self.b, self.axis).spatial_rows(label, undeformed)[2:]


def test_hooke_joint_transmits_its_ratio() -> None:
    beta, speed = math.radians(30.0), 2.0
    shaft = VolumeIntegrals.rigid(1.0, inertia=(0.1, 0.2, 0.2), markers={"end": (0.0, 0.0, 0.0)})
    x, out = (1.0, 0.0, 0.0), (math.cos(beta), math.sin(beta), 0.0)
    drive, driven = ("in", "end"), ("out", "end")
    mechanism = Mechanism(
        {
            "in": Placement((0.0, 0.0, 0.0)),
            "out": Placement((0.0, 0.0, 0.0), rotation=(0.0, 0.0, beta)),
        },
        joints=[
            Revolute(drive, Ground(), axis=x),
            PrescribedAngle(drive, Motion.polynomial([0.0, speed]), axis=x),
            # At the start the driving fork is perpendicular to the plane of the shafts.
            Universal(drive, driven, (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
            Bearing(driven, Ground(), out),
        ],
    )
    end = math.radians(160.0) / speed
    trajectory = simulate(mechanism, {"in": shaft, "out": shaft}, GeneralizedAlpha(end, 160))
    ratio = trajectory.v[:, 9] / speed
    turned = np.sin(speed * trajectory.t)
    exact = math.cos(beta) / (1.0 - (math.sin(beta) * turned) ** 2)
    np.testing.assert_allclose(ratio, exact, atol=1e-10)
    assert np.max(ratio) == pytest.approx(1.154700538, rel=1e-6)
    assert np.min(ratio) == pytest.approx(0.866025404, rel=1e-3)


def test_spatial_slider_crank() -> None:
    """E. J. Haug's mechanism: the slider's place is sqrt(l^2 - y^2 - z^2) of the crank pin's."""
    crank = Moving.circle(
        (0.0, 0.1, 0.12), 0.08, Motion.smooth_step(2.0 * math.pi, 1.0), axis=(1.0, 0.0, 0.0)
    )
    rod = VolumeIntegrals.rigid(
        0.5,
        (0.15, 0.0, 0.0),
        (1e-5, 0.00375, 0.00375),
        {"pin": (0.0, 0.0, 0.0), "slider": (0.3, 0.0, 0.0)},
    )
    mechanism = Mechanism(
        {"rod": Placement((0.0, 0.18, 0.12), rotation=(0.0, 0.4, -0.6))},
        joints=[
            Spherical(("rod", "pin"), crank),
            PointOnLine(("rod", "slider"), Ground(), (1.0, 0.0, 0.0)),
        ],
        point_masses=[PointMass(("rod", "slider"), 0.5)],
    )
    trajectory = simulate(mechanism, {"rod": rod}, GeneralizedAlpha(1.0, 100))
    pin, slider = (trajectory.marker_path("rod", name) for name in ("pin", "slider"))
    np.testing.assert_allclose(
        slider[:, 0], np.sqrt(0.09 - pin[:, 1] ** 2 - pin[:, 2] ** 2), atol=1e-13
    )
    np.testing.assert_allclose(slider[:, 1:], 0.0, atol=1e-14)
    assert np.min(slider[:, 0]) == pytest.approx(0.18495188844, abs=1e-3)
    assert np.max(slider[:, 0]) == pytest.approx(0.29015995410, abs=1e-3)


def bricard(integrator: Integrator) -> Array:
    """Place of the fourth corner of Bricard's mechanism at the end, shape (3,) [m]."""
    corners = [(0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1)]
    axes = np.eye(3)[[1, 2, 0, 1, 2, 0]]
    long, across = (1.0 + 0.01) / 12.0, 0.02 / 12.0
    placements, bodies = {}, {}
    for k in range(5):
        start, end = (np.array(corners[i], dtype=float) for i in (k, k + 1))
        x = end - start
        y = np.roll(x, 1)
        frame = np.stack([x, y, np.cross(x, y)], axis=1)
        placements[f"rod {k}"] = Placement(tuple(start), rotation=frame)
        bodies[f"rod {k}"] = VolumeIntegrals.rigid(
            1.0, (0.5, 0.0, 0.0), (across, long, long), {"a": (0, 0, 0), "b": (1.0, 0, 0)}
        )

    def hinge(k: int) -> Joint:
        here = (f"rod {k}", "a") if k < 5 else ("rod 4", "b")
        if k == 0:
            return Revolute(here, Ground(corners[0]), axis=tuple(axes[0]))
        if k == 5:
            # One of the rows of six hinges is redundant: a cylinder leaves it out.
            return Cylindrical(here, Ground(corners[5]), tuple(axes[5]))
        before = f"rod {k - 1}"
        frame = np.asarray(placements[before].rotation)
        return Revolute(here, (before, "b"), axis=tuple(frame.T @ axes[k]))

    mechanism = Mechanism(placements, [hinge(k) for k in range(6)], gravity=(0.0, -9.81, 0.0))
    trajectory = simulate(mechanism, bodies, integrator)
    return trajectory.marker_path("rod 2", "b")[-1]


def test_bricard() -> None:
    """IFToMM's benchmark A04; the numbers are those of Exudyn, extrapolated, to 1e-7."""
    found = extrapolated(*(bricard(GeneralizedAlpha(0.4, n)) for n in (100, 200)))
    np.testing.assert_allclose(found, (0.987207406, -1.148426164, 0.840558673), atol=3e-7)
    found = bricard(RadauIIA(2.0, tolerance=1e-8))
    np.testing.assert_allclose(found, (-0.969340345, -1.221246895, 0.754278011), atol=3e-7)


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (1.0, 2.0, -0.5)])
def test_particle_on_a_spring_in_a_turning_frame(axis: tuple[float, float, float]) -> None:
    """Seen from outside it does not feel the frame's rotation."""
    m, w0, speed = 0.5, 20.0, 7.0
    S, P = np.zeros((4, 3)), np.zeros((4, 4, 3, 3))
    P[0, 0] = 0.5 * np.eye(3)
    P[1:, 1:] = m * np.einsum("ak,bl->abkl", np.eye(3), np.eye(3))
    # A particle at the origin, displaced by the coordinates, on a hub of mass 1.
    S[1:] = m * np.eye(3)
    point = BodyMarker(np.zeros(3), np.eye(3), np.zeros((3, 3)))
    hub = BodyMarker(np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3)))
    body = VolumeIntegrals.from_arrays(
        1.0 + m, S, P=P, K=m * w0**2 * np.eye(3), markers={"particle": point, "hub": hub}
    )
    drive = Moving(
        *(Motion.constant(0.0),) * 2,
        Motion.polynomial([0.0, speed]),
        z=Motion.constant(0.0),
        axis=axis,
    )
    unit = np.array(axis) / np.linalg.norm(axis)
    start, velocity = np.array([0.1, -0.05, 0.07]), np.array([1.0, 0.5, -0.3])
    mechanism = Mechanism(
        {"body": Placement((0.0, 0.0, 0.0), angular_velocity=tuple(speed * unit))},
        joints=[Weld(("body", "hub"), drive)],
        start=Assembled({"body": start}, {"body": velocity - speed * np.cross(unit, start)}),
    )
    end = 0.5
    paths = [
        simulate(mechanism, {"body": body}, GeneralizedAlpha(end, n, 1.0)).marker_path(
            "body", "particle"
        )[-1]
        for n in (500, 1000)
    ]
    exact = start * math.cos(w0 * end) + velocity / w0 * math.sin(w0 * end)
    np.testing.assert_allclose(extrapolated(*paths), exact, atol=1e-6)


def rotating_cantilever() -> VolumeIntegrals:
    """A slender beam of unit length, stiffness and mass per length, clamped at the origin."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    x, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    powers = np.arange(2, 10)
    w = x ** powers[:, None]
    slope = powers[:, None] * x ** (powers[:, None] - 1)
    bend = (powers * (powers - 1))[:, None] * x ** (powers[:, None] - 2)
    zero, count = np.zeros_like(w), len(powers)
    position = np.stack([x, 0.0 * x, 0.0 * x], axis=-1)[None]
    fields = np.concatenate(
        [position, np.stack([zero, w, zero], -1), np.stack([zero, zero, w], -1)]
    )
    P = np.einsum("p,apk,bpl->abkl", weights, fields, fields)
    P[0, 0] += np.diag([0.0, 1e-4, 1e-4])

    def twice(matrix: Array) -> Array:
        return np.kron(np.eye(2), matrix)

    # The load -x e_x presses with (1 - x^2) / 2.
    rotation = np.zeros((3, 3, 2 * count, 2 * count))
    rotation[0, 0] = -twice((slope * weights * 0.5 * (1.0 - x**2)) @ slope.T)
    return VolumeIntegrals.from_arrays(
        1.0,
        np.einsum("p,apk->ak", weights, fields),
        P=P,
        K=twice((bend * weights) @ bend.T),
        stiffening={"rotation": rotation, "acceleration": np.zeros((3, 2 * count, 2 * count))},
        name="beam",
    )


@pytest.mark.parametrize(
    ("gamma", "flap"), [(0.0, 3.5160153), (2.0, 4.1373196), (6.0, 7.3603730), (12.0, 13.1701508)]
)
def test_rotating_cantilever(gamma: float, flap: float) -> None:
    """A. D. Wright et al. 1982: first flap frequency; chord^2 = flap^2 - gamma^2."""
    beam = rotating_cantilever()
    mechanism = Mechanism({"beam": Placement((0.0, 0.0, 0.0))})
    arrays = assemble_model(mechanism, {"beam": beam}, np.linspace(0.0, 1.0, 2)).arrays
    v = np.zeros(6 + beam.modes)
    v[5] = gamma
    stiffness = evaluate_equations(arrays, 0, 0.0 * v, v, 0.0 * v, np.zeros(0)).stiffness[6:, 6:]
    squares = scipy.linalg.eigh(
        0.5 * (stiffness + stiffness.T), beam.G[1:, 1:], eigvals_only=True, subset_by_index=[0, 1]
    )
    expected = sorted([math.sqrt(flap**2 - gamma**2), flap])
    np.testing.assert_allclose(np.sqrt(squares), expected, rtol=2e-6)


def pendulum(space: bool, turn: Rotation | None = None) -> Trajectory:
    """Two flexible links under gravity, driven, with a spring and a damper."""
    Q = Rotation.identity() if turn is None else turn
    bodies = {name: flat_cloud(2, seed, space=space) for seed, name in enumerate(("one", "two"))}

    def at(x: float, y: float) -> tuple[float, ...]:
        return tuple(Q.apply((x, y, 0.0))) if space else (x, y)

    def place(x: float, y: float, angle: float) -> Placement:
        if not space:
            return Placement((x, y), angle)
        return Placement(at(x, y), rotation=Q * Rotation.from_rotvec((0.0, 0.0, angle)))

    normal = tuple(Q.apply((0.0, 0.0, 1.0)))
    axis = {"axis": normal} if space else {}
    mechanism = Mechanism(
        {"one": place(0.5, 0.0, 0.0), "two": place(1.4, 0.3, 0.7)},
        joints=[
            Revolute(("one", "root"), Ground(at(0.0, 0.0)), **axis),
            Revolute(("two", "root"), ("one", "tip")),
        ],
        gravity=at(1.0, -9.81),
        forces=[SpringDamper(("two", "tip"), Ground(at(2.0, -0.5)), 30.0, 0.5)],
        point_masses=[PointMass(("two", "tip"), 0.2)],
        damping={"one": RayleighDamping(0.1, 1e-3)},
    )
    return simulate(mechanism, bodies, GeneralizedAlpha(0.6, 120))


def test_planar_scene_in_space() -> None:
    plane, space = pendulum(False), pendulum(True)
    for name in ("one", "two"):
        flat, full = plane.rigid(name), space.rigid(name)
        np.testing.assert_allclose(full[:, :2], flat[:, :2], atol=1e-11)
        np.testing.assert_allclose(full[:, 5], flat[:, 2], atol=1e-11)
        np.testing.assert_allclose(full[:, 2:5], 0.0, atol=1e-11)
        np.testing.assert_allclose(space.elastic(name), plane.elastic(name), atol=1e-11)
        for part in ("kinetic_energy", "potential_energy", "strain_energy"):
            here, there = (getattr(run, part)(name) for run in (plane, space))
            np.testing.assert_allclose(there, here, atol=1e-10)
        spin = space.angular_momentum(name)[:, 2]
        np.testing.assert_allclose(spin, plane.angular_momentum(name), atol=1e-10)
    joint = plane.model.mechanism.joint_names[1]
    np.testing.assert_allclose(space.joint_force(joint)[:, :2], plane.joint_force(joint), atol=1e-8)


def test_motion_does_not_depend_on_the_frame() -> None:
    turn = Rotation.from_rotvec((0.4, -1.1, 0.7))
    plain, turned = pendulum(True), pendulum(True, turn)
    for name in ("one", "two"):
        np.testing.assert_allclose(turned.elastic(name), plain.elastic(name), atol=1e-11)
        path = turn.apply(plain.marker_path(name, "tip"))
        np.testing.assert_allclose(turned.marker_path(name, "tip"), path, atol=1e-11)


def test_free_flexible_body_keeps_its_momenta() -> None:
    body = cloud(3, 1)
    mechanism = Mechanism(
        {"body": Placement((0.1, 0.2, 0.3), (0.0), (1.0, -2.0, 0.5), (1.0, 0.3, -0.6))},
        start=Assembled({"body": [0.05, -0.02, 0.03]}),
    )
    runs = [simulate(mechanism, {"body": body}, GeneralizedAlpha(1.0, n, 1.0)) for n in (400, 800)]
    np.testing.assert_allclose(np.ptp(runs[1].linear_momentum("body"), axis=0), 0.0, atol=2e-4)
    drifts = [float(np.max(np.ptp(run.angular_momentum("body"), axis=0))) for run in runs]
    assert drifts[1] < 0.3 * drifts[0]
    energies = [run.kinetic_energy("body") + run.strain_energy("body") for run in runs]
    assert np.ptp(energies[1]) < 0.3 * np.ptp(energies[0])
    assert np.ptp(energies[1]) < 2e-3 * energies[1][0]


def test_static_equilibrium() -> None:
    """A rod hangs down from a ball, whatever its placement."""
    rod = VolumeIntegrals.rigid(
        1.0, (0.5, 0.0, 0.0), (0.01, 0.1, 0.1), {"top": (0, 0, 0), "end": (1.0, 0, 0)}
    )
    mechanism = Mechanism(
        {"rod": Placement((0.0, 0.0, 0.0), rotation=(0.3, 0.5, 0.2))},
        joints=[Universal(("rod", "top"), Ground(), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))],
        gravity=(0.0, 0.0, -9.81),
        start=StaticEquilibrium(),
    )
    trajectory = simulate(mechanism, {"rod": rod}, GeneralizedAlpha(0.1, 10))
    np.testing.assert_allclose(
        trajectory.marker_path("rod", "end"), np.tile([0.0, 0.0, -1.0], (11, 1)), atol=1e-9
    )
