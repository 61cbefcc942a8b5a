# SPDX-License-Identifier: MIT
"""Simulation: invariants, closed forms, published cases, orders in time, and refused runs."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.beams import beam
from shared.scenes import SCENES, Bodies, Scene, four_bar, slider_crank, slider_crank_mechanism

from dolfinx_ffr.body import BodyMarker, VolumeIntegrals
from dolfinx_ffr.dynamics import (
    GeneralizedAlpha,
    LargeDeformationWarning,
    SimulationError,
    SofteningWarning,
    Trajectory,
    simulate,
)
from dolfinx_ffr.dynamics.kinematics import evaluate_equations
from dolfinx_ffr.mechanism import (
    Ground,
    Mechanism,
    Moving,
    Placement,
    PointMass,
    PointOnLine,
    PrescribedAngle,
    RayleighDamping,
    Revolute,
    Weld,
)
from dolfinx_ffr.mechanism.motion import Motion
from dolfinx_ffr.objective import IntegralCompliance
from dolfinx_ffr.verification import convergence_order

Array = NDArray[np.float64]
QUANTITIES = ("y", "v", "w", "multipliers")


def run(scene: Scene, **changes: float) -> Trajectory:
    return simulate(scene.mechanism, scene.bodies, replace(scene.integrator, **changes))


def rod(mass: float = 1.0, length: float = 1.0) -> VolumeIntegrals:
    """Rigid uniform rod with markers at its ends and in the middle."""
    markers = {"left": (-0.5 * length, 0), "middle": (0, 0), "right": (0.5 * length, 0)}
    return VolumeIntegrals.rigid(mass, (0, 0), mass * length**2 / 12.0, markers)


# --- Invariants ----------------------------------------------------------------------------------


def change_basis(body: VolumeIntegrals, T: Array) -> VolumeIntegrals:
    """The same body in other elastic coordinates, q = T q_new."""
    extended = np.eye(body.modes + 1)
    extended[1:, 1:] = T
    return VolumeIntegrals(
        body.mass,
        extended.T @ body.S,
        extended.T @ body.G @ extended,
        extended.T @ body.N @ extended,
        T.T @ body.K @ T,
        {
            name: BodyMarker(m.position, m.displacement @ T, m.rotation @ T)
            for name, m in body.markers.items()
        },
        {load: T.T @ array @ T for load, array in body.stiffening.items()},
    )


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("seed", [0, 1])
def test_objective_does_not_depend_on_the_basis(name: str, seed: int) -> None:
    scene, rng = SCENES[name](), np.random.default_rng(seed)
    objective = IntegralCompliance()
    psi = objective.value(run(scene), scene.bodies)
    bodies = {
        key: change_basis(body, rng.normal(size=(body.modes, body.modes)))
        for key, body in scene.bodies.items()
    }
    other = objective.value(simulate(scene.mechanism, bodies, scene.integrator), bodies)
    assert other == pytest.approx(psi, rel=1e-10)


@pytest.mark.parametrize("name", SCENES)
def test_equations_and_constraints_hold_to_round_off_at_all_times(name: str) -> None:
    trajectory = run(SCENES[name]())
    model, n = trajectory.model, trajectory.model.size
    speed, force = np.max(np.abs(trajectory.v)), np.max(np.abs(trajectory.multipliers))
    residuals = np.array(
        [
            evaluate_equations(
                model.arrays, k, *(getattr(trajectory, part)[k] for part in QUANTITIES)
            )[0]
            for k in range(trajectory.steps + 1)
        ]
    )
    assert np.max(np.abs(residuals[:, :n])) < 1e-12 * force
    assert np.max(np.abs(residuals[:, n : n + model.rows])) < 1e-14  # metres, of parts of 0.4 m
    assert np.max(np.abs(residuals[:, n + model.rows :])) < 1e-14 * speed


def free_pair(steps: int, frame: str) -> Trajectory:
    """Two flexible beams on a common pin, thrown with spin, held by nothing else."""
    bodies = {
        "front": beam(0.4, 0.01, 0.01, 2e8, elements=8, modes=2, frame=frame),
        "back": beam(0.3, 0.008, 0.01, 2e8, elements=8, modes=2, frame=frame),
    }
    mechanism = Mechanism(
        {
            "front": Placement((0.2, 0.0), 0.0, (1.5, -0.7), 5.0),
            "back": Placement((0.0, -0.15), 0.5 * math.pi, (1.5, -1.7), -9.0),
        },
        [Revolute(("front", "left"), ("back", "right"), name="pin")],
    )
    return simulate(mechanism, bodies, GeneralizedAlpha(0.12, steps, 1.0))


@pytest.mark.filterwarnings("ignore::dolfinx_ffr.LargeDeformationWarning")  # they are soft
@pytest.mark.parametrize("frame", ["chord", "tangent", "free"])
def test_energy_and_momentum_of_free_flexible_bodies(frame: str) -> None:
    steps = np.array([800, 1600, 3200])
    drifts = []
    for count in steps:
        t = free_pair(int(count), frame)
        bodies = list(t.model.bodies)
        strain = sum(t.strain_energy(b) for b in bodies)
        energy = strain + sum(t.kinetic_energy(b) for b in bodies)
        linear = sum(t.linear_momentum(b) for b in bodies)
        angular = sum(t.angular_momentum(b) for b in bodies)
        assert np.max(strain) > 1e-3 * energy[0], "the bodies hardly deform"
        drifts.append(
            [
                np.max(np.abs(energy / energy[0] - 1.0)),
                np.max(np.abs(linear - linear[0])) / np.linalg.norm(linear[0]),
                np.max(np.abs(angular / angular[0] - 1.0)),
            ]
        )
    if frame == "free":
        # Frame and centre of mass coincide: the sum of m R' is linear in what is integrated.
        assert np.max(np.array(drifts)[:, 1]) < 1e-12
    for name, drift in zip(("energy", "linear", "angular"), np.array(drifts).T, strict=True):
        if name == "linear" and frame == "free":
            continue
        assert drift[-1] < 1e-3, name
        assert convergence_order(1.0 / steps, drift) == pytest.approx(2.0, abs=0.1), name


@pytest.mark.filterwarnings("ignore::dolfinx_ffr.LargeDeformationWarning")  # they are soft
@pytest.mark.parametrize("frame", ["chord", "tangent", "free"])
def test_centre_of_mass_of_free_bodies_is_not_accelerated(frame: str) -> None:
    t = free_pair(200, frame)
    total, scale = np.zeros((201, 2)), 0.0
    for name, body in t.model.bodies.items():
        # Second derivative of m R + A S(q), independent of the compiled equations of motion.
        where = t.model.coordinates(name).all
        y, v, w = t.y[:, where], t.v[:, where], t.w[:, where]
        omega = v[:, 2:3]
        s = np.column_stack([np.ones(201), y[:, 3:]]) @ body.S
        ds, dds = v[:, 3:] @ body.S[1:], w[:, 3:] @ body.S[1:]
        local = dds + w[:, 2:3] * quarter_turn(s) - omega**2 * s + 2.0 * omega * quarter_turn(ds)
        c, sn = np.cos(y[:, 2:3]), np.sin(y[:, 2:3])
        total += body.mass * w[:, :2] + c * local + sn * quarter_turn(local)
        scale = max(scale, float(np.max(np.abs(body.mass * w[:, :2]))))
    assert np.max(np.abs(total)) < 1e-12 * scale


def quarter_turn(vectors: Array) -> Array:
    return np.stack([-vectors[:, 1], vectors[:, 0]], axis=1)


# --- Closed forms --------------------------------------------------------------------------------

#: Lengths of crank and rod [m], masses of slider and rod [kg].
CRANK, ROD, SLIDER, MASS = 0.1, 0.4, 0.5, 1.256


def slider_crank_forces(t: Array, motion: Motion) -> tuple[Array, Array]:
    """Pin force on a rigid uniform rod (n, 2) and the guide's force on its end (n,)."""
    phi, rate, growth = motion.tabulate(t)
    sin_b = -CRANK * np.sin(phi) / ROD
    cos_b = np.sqrt(1.0 - sin_b**2)
    b1 = -CRANK * np.cos(phi) * rate / (ROD * cos_b)
    b2 = CRANK * (np.sin(phi) * rate**2 - np.cos(phi) * growth) / ROD + sin_b * b1**2
    b2 /= cos_b
    pin = CRANK * np.stack(
        [
            -np.cos(phi) * rate**2 - np.sin(phi) * growth,
            -np.sin(phi) * rate**2 + np.cos(phi) * growth,
        ],
        axis=1,
    )
    along = np.stack([cos_b, sin_b], axis=1)
    across = np.stack([-sin_b, cos_b], axis=1)
    turn = b2[:, None] * across - b1[:, None] ** 2 * along
    middle, end = pin + 0.5 * ROD * turn, pin + ROD * turn
    # Moments about the pin: inertia of the rod, of the slider, and the guide's force.
    inertia = MASS * ROD**2 / 12.0 * b2
    inertia += MASS * 0.5 * ROD * (along[:, 0] * middle[:, 1] - along[:, 1] * middle[:, 0])
    inertia += SLIDER * ROD * (along[:, 0] * end[:, 1] - along[:, 1] * end[:, 0])
    guide = inertia / (ROD * cos_b)
    force = MASS * middle + SLIDER * end
    force[:, 1] -= guide
    return force, guide


def rigid_slider_crank(body: VolumeIntegrals, steps: int) -> tuple[Trajectory, Motion]:
    motion = Motion.smooth_step(4.0 * math.pi, 0.6)
    mechanism = slider_crank_mechanism(motion, crank=CRANK, rod=ROD, slider=SLIDER)
    return simulate(mechanism, {"rod": body}, GeneralizedAlpha(0.6, steps)), motion


def force_error(body: VolumeIntegrals, steps: int) -> float:
    trajectory, motion = rigid_slider_crank(body, steps)
    pin, guide = slider_crank_forces(trajectory.t, motion)
    error = np.max(np.abs(trajectory.joint_force("crank pin") - pin))
    error = max(error, np.max(np.abs(trajectory.joint_force("slider")[:, 0] - guide)))
    return float(error / np.max(np.abs(pin)))


def test_joint_forces_of_the_rigid_slider_crank() -> None:
    steps = np.array([300, 600, 1200])
    errors = [force_error(rod(MASS, ROD), int(n)) for n in steps]
    assert errors[-1] < 1e-4
    assert convergence_order(1.0 / steps, errors) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize(("modulus", "limit"), [(2.1e12, 1e-4), (2.1e14, 1e-5)])
def test_stiff_rod_has_the_joint_forces_of_the_rigid_one(modulus: float, limit: float) -> None:
    # What is left at infinite stiffness is the start of the drive, which no step resolves then.
    stiff = beam(youngs_modulus=modulus, modes=4)
    assert stiff.mass == pytest.approx(MASS)
    flexible, _ = rigid_slider_crank(stiff, 1200)
    rigid, _ = rigid_slider_crank(rod(MASS, ROD), 1200)
    gap = np.max(np.abs(flexible.multipliers - rigid.multipliers))
    assert gap < limit * np.max(np.abs(rigid.multipliers))
    assert force_error(stiff, 1200) < 2e-4


def test_rotating_bar_stretches_by_the_linear_theory() -> None:
    """Code_Aster SSLV104: tip elongation tan(a L) / a - L with a^2 = rho omega^2 / E."""
    L, E, rho, omega = 0.5, 2e11, 7800.0, 3000.0
    powers = np.arange(1, 7)
    x, weight = np.polynomial.legendre.leggauss(12)
    x, weight = 0.5 * L * (x + 1.0), 0.5 * L * weight
    w = np.zeros((x.size, 2, powers.size + 1))
    w[:, 0, 0] = x
    w[:, 0, 1:] = (x[:, None] / L) ** powers
    strain = powers * (x[:, None] / L) ** (powers - 1) / L
    tip = np.vstack([np.ones(powers.size), np.zeros(powers.size)])
    bar = VolumeIntegrals(
        rho * L,
        np.einsum("p,pia->ai", rho * weight, w),
        np.einsum("p,pia,pib->ab", rho * weight, w, w),
        np.zeros((powers.size + 1, powers.size + 1)),
        np.einsum("p,pi,pj->ij", E * weight, strain, strain),
        {
            "axis": BodyMarker([0.0, 0.0], 0.0 * tip, np.zeros(powers.size)),
            "tip": BodyMarker([L, 0.0], tip, np.zeros(powers.size)),
        },
    )
    mechanism = Mechanism(
        {"bar": Placement()},
        [
            Revolute(("bar", "axis"), Ground()),
            PrescribedAngle(("bar", "axis"), Motion.polynomial([0.0, omega])),
        ],
        damping={"bar": RayleighDamping(4e4, 0.0)},
    )
    trajectory = simulate(mechanism, {"bar": bar}, GeneralizedAlpha(4e-3, 4000))
    path = trajectory.marker_path("bar", "tip")[-1]
    a = math.sqrt(rho * omega**2 / E)
    exact = math.tan(a * L) / a - L
    assert exact == pytest.approx(0.0151572423864638, rel=1e-12)
    assert np.hypot(*path) - L == pytest.approx(exact, rel=1e-7)


# --- Published cases -----------------------------------------------------------------------------


def n_four_bar(loops: int, steps: int, radius: float = 0.8) -> Trajectory:
    """IFToMM benchmark A02, parallelograms in a row; passes positions with all links in line."""
    bodies: Bodies = {}
    placements, joints = {}, []
    for i in range(loops + 1):
        bodies[f"crank {i}"] = rod()
        placements[f"crank {i}"] = Placement((float(i), 0.5), 0.5 * math.pi, (0.5, 0.0), -1.0)
        joints.append(Revolute((f"crank {i}", "left"), Ground((float(i), 0.0))))
    for i in range(loops):
        bodies[f"coupler {i}"] = rod()
        placements[f"coupler {i}"] = Placement((i + 0.5, 1.0), 0.0, (1.0, 0.0), 0.0)
        joints.append(Revolute((f"crank {i}", "right"), (f"coupler {i}", "left")))
        joints.append(Revolute((f"coupler {i}", "right"), (f"crank {i + 1}", "right")))
    mechanism = Mechanism(placements, joints, gravity=(0.0, -9.81))
    return simulate(mechanism, bodies, GeneralizedAlpha(10.0, steps, radius))


def check_published(path: Callable[[int], Array], exact: Array, steps: Array) -> None:
    """Order two towards a published case, and its digits by extrapolation to no step at all."""
    values = [path(int(count)) for count in steps]
    errors = [float(np.max(np.abs(value - exact))) for value in values]
    assert errors[-1] < 1.5e-4
    assert convergence_order(1.0 / steps, errors) == pytest.approx(2.0, abs=0.1)
    for power in (2, 3):  # of the step, in the error that one more halving removes
        factor = 2.0**power
        values = [(factor * fine - coarse) / (factor - 1.0) for coarse, fine in pairwise(values)]
    assert np.max(np.abs(values[-1] - exact)) < 1e-6


def test_n_four_bar_through_its_singular_positions() -> None:
    reference = {
        1.0: (-0.1950203019, -0.9807992057),
        5.0: (-0.8113104610, -0.5846155454),
        10.0: (0.3284581115, 0.9445185382),
    }

    def path(steps: int) -> Array:
        whole = n_four_bar(2, steps).marker_path("crank 0", "right")
        return whole[[round(time * steps / 10.0) for time in reference]]

    check_published(path, np.array(list(reference.values())), np.array([2000, 4000, 8000]))


@pytest.mark.slow
@pytest.mark.parametrize("steps", [8000, 16000])
def test_singular_positions_without_numerical_damping(steps: int) -> None:
    t = n_four_bar(2, steps, radius=1.0)
    assert t.marker_path("crank 0", "right")[-1] == pytest.approx((0.3284581, 0.9445185), abs=2e-4)


def test_equal_link_slider_crank_through_its_singular_position() -> None:
    reference = {
        0.1: 1.024519073884,
        0.5: -0.367349163389,
        1.0: -1.951288388413,
        2.0: 0.554605256459,
        5.0: 1.445320498549,
    }
    c, rate = math.sqrt(0.5), 2.0 * math.sqrt(2.0)
    mechanism = Mechanism(
        {
            "crank": Placement(
                (0.5 * c, 0.5 * c), 0.25 * math.pi, (-0.5 * c * rate, 0.5 * c * rate), rate
            ),
            "rod": Placement(
                (1.5 * c, 0.5 * c), -0.25 * math.pi, (-1.5 * c * rate, 0.5 * c * rate), -rate
            ),
        },
        [
            Revolute(("crank", "left"), Ground()),
            Revolute(("crank", "right"), ("rod", "left")),
            PointOnLine(("rod", "right"), Ground()),
        ],
        gravity=(0.0, -9.81),
    )

    def path(steps: int) -> Array:
        t = simulate(mechanism, {"crank": rod(), "rod": rod()}, GeneralizedAlpha(5.0, steps))
        x = t.marker_path("rod", "right")[:, 0]
        return x[[round(time * steps / 5.0) for time in reference]]

    check_published(path, np.array(list(reference.values())), np.array([2000, 4000, 8000]))


# --- Orders in time ------------------------------------------------------------------------------


def soft_slider_crank() -> tuple[Scene, int]:
    """All oscillations of the rod are slow enough for the steps to resolve."""
    scene = slider_crank(end_time=0.2)
    return replace(scene, bodies={"rod": beam(modes=2, youngs_modulus=5e8)}), 1600


def pendulum() -> tuple[Scene, int]:
    """Flexible arm on a pin, welded to a rigid bob, in the field of gravity."""
    arm = beam(0.5, 0.01, 0.01, 2e9, elements=8, modes=2, frame="tangent")
    mechanism = Mechanism(
        {"arm": Placement((0.25, 0.0)), "bob": Placement((0.55, 0.0))},
        [
            Revolute(("arm", "left"), Ground(), name="pivot"),
            Weld(("arm", "right"), ("bob", "rim"), name="weld"),
        ],
        gravity=(0.0, -9.81),
    )
    bob = VolumeIntegrals.rigid(0.4, (0.0, 0.0), 5e-4, {"rim": (-0.05, 0.0)})
    return Scene(mechanism, {"arm": arm, "bob": bob}, GeneralizedAlpha(0.4, 1)), 1600


@pytest.mark.slow
@pytest.mark.parametrize("make", [soft_slider_crank, pendulum])
@pytest.mark.parametrize("radius", [0.5, 0.8, 1.0])
def test_order_two_in_positions_velocities_and_multipliers(
    make: Callable[[], tuple[Scene, int]], radius: float
) -> None:
    scene, coarsest = make()
    counts = coarsest * np.array([1, 2, 4])
    reference = run(scene, steps=16 * coarsest, spectral_radius=1.0)
    finer = run(scene, steps=32 * coarsest, spectral_radius=1.0)
    errors: dict[str, list[float]] = {name: [] for name in QUANTITIES}
    for count in counts:
        trajectory = run(scene, steps=int(count), spectral_radius=radius)
        for name in QUANTITIES:
            stride = 16 * coarsest // int(count)
            # Richardson's extrapolation of two fine runs stands for the exact solution.
            fine = getattr(finer, name)[:: 2 * stride]
            exact = fine + (fine - getattr(reference, name)[::stride]) / 3.0
            error = np.max(np.abs(getattr(trajectory, name) - exact), axis=0)
            scale = np.max(np.abs(exact), axis=0)
            errors[name].append(float(np.max(error / np.maximum(scale, 1e-3 * scale.max()))))
    for name in QUANTITIES:
        assert errors[name][-1] < 1e-2, name
        assert convergence_order(1.0 / counts, errors[name]) == pytest.approx(2.0, abs=0.1), name


def test_multipliers_are_right_from_the_first_step() -> None:
    # The index-3 form, or a_0 = w_0, would leave errors of several per cent that keep ringing.
    scene, coarsest = pendulum()
    coarse, fine = run(scene, steps=coarsest), run(scene, steps=8 * coarsest)
    gap = np.abs(coarse.multipliers[:5] - fine.multipliers[:33:8])
    assert np.max(gap) < 1e-3 * np.max(np.abs(fine.multipliers))


# --- Results by name -----------------------------------------------------------------------------


def test_trajectory_by_name() -> None:
    scene = four_bar(steps=40)
    t = run(scene)
    assert t.steps == 40
    assert t.rigid("coupler").shape == (41, 3)
    assert t.elastic("coupler").shape == (41, 3)
    assert t.elastic("crank").shape == (41, 0)
    position, angle, q = t.pose("rocker", 7)
    rocker = t.y[7, t.model.coordinates("rocker").all]
    np.testing.assert_array_equal(np.r_[position, angle, q], rocker)
    # Both sides of a pin follow the same path.
    gap = t.marker_path("coupler", "right") - t.marker_path("rocker", "left")
    assert np.max(np.abs(gap)) < 1e-15
    assert t.joint_force("motor").shape == (41, 1)
    np.testing.assert_array_equal(t.strain_energy("crank"), 0.0)
    with pytest.raises(ValueError, match=r"no joint 'pin'; the joints are \['motor bearing'"):
        t.joint_force("pin")
    with pytest.raises(
        ValueError, match=r"'crank' has no marker 'middle', but \['left', 'right'\]"
    ):
        t.marker_path("crank", "middle")
    with pytest.raises(ValueError, match=r"no body 'rod'; the bodies are \['crank', 'coupler'"):
        t.elastic("rod")


def test_joint_force_carries_the_weight() -> None:
    mechanism = Mechanism(
        {"rod": Placement((0.5, 0.0))},
        [Weld(("rod", "left"), Ground(), name="clamp")],
        point_masses=[PointMass(("rod", "right"), 2.0)],
        gravity=(0.0, -10.0),
    )
    t = simulate(mechanism, {"rod": rod(3.0)}, GeneralizedAlpha(0.1, 10))
    expected = np.tile([0.0, 50.0, 3.0 * 10.0 * 0.5 + 2.0 * 10.0 * 1.0], (11, 1))
    np.testing.assert_allclose(t.joint_force("clamp"), expected, rtol=1e-13, atol=1e-12)


def test_power_of_the_motor_is_the_growth_of_energy() -> None:
    scene = four_bar(steps=3000)
    undamped = replace(scene.mechanism, damping={})
    t = simulate(undamped, scene.bodies, replace(scene.integrator, spectral_radius=1.0))
    energy = sum(
        t.kinetic_energy(b) + t.strain_energy(b) + t.potential_energy(b) for b in scene.bodies
    )
    power = t.joint_force("motor")[:, 0] * t.v[:, t.model.coordinates("crank").rotation]
    work = np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(t.t))
    assert np.max(np.abs(work - (energy - energy[0])[1:])) < 1e-3 * np.ptp(energy)


# --- Bad input and failures ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.0, 10), "end_time must be positive, but it is 0.0 s"),
        ((-1.0, 10), "end_time must be positive"),
        ((np.nan, 10), "end_time must be positive"),
        ((1.0, 0), "steps must be a positive whole number, but it is 0"),
        ((1.0, 2.5), "steps must be a positive whole number, but it is 2.5"),
        ((1.0, 10, 1.2), "spectral_radius must lie between 0 and 1, but it is 1.2"),
        ((1.0, 10, -0.1), "spectral_radius must lie between 0 and 1"),
        ((1.0, 10, np.nan), "spectral_radius must lie between 0 and 1"),
    ],
)
def test_refused_integrator(arguments: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        GeneralizedAlpha(*arguments)  # type: ignore[arg-type]


def test_a_mechanism_that_locks_is_named_and_the_motion_so_far_is_kept() -> None:
    # The pin moves away from the guide until the rod no longer reaches it, at t = 0.4 s.
    pin = Moving(Motion.constant(0.0), Motion.polynomial([0.0, 2.5]), name="lift")
    mechanism = Mechanism(
        {"rod": Placement((0.5, 0.0))},
        [
            Revolute(("rod", "left"), pin, name="pin"),
            PointOnLine(("rod", "right"), Ground(), name="guide"),
        ],
    )
    message = r"at t = 0\.4\d* s \(step \d+ of 100\) .* in body 'rod' and .* in joint '(pin|guide)'"
    with pytest.raises(SimulationError, match=message) as caught:
        simulate(mechanism, {"rod": rod()}, GeneralizedAlpha(1.0, 100))
    so_far = caught.value.trajectory
    assert 30 <= so_far.steps <= 41
    assert so_far.y.shape == (so_far.steps + 1, 3)
    assert np.all(np.isfinite(so_far.y))
    height = so_far.marker_path("rod", "left")[:, 1]
    np.testing.assert_allclose(height, 2.5 * so_far.t, atol=1e-13)


def test_a_body_faster_than_its_first_frequency_is_reported() -> None:
    """ANSYS VM258, spin-up of a beam: without geometric stiffening it must be called unstable."""

    def angle(t: Array) -> Array:
        up = 0.4 * (0.5 * t**2 + (7.5 / np.pi) ** 2 * (np.cos(2.0 * np.pi * t / 15.0) - 1.0))
        return np.where(t < 15.0, up, 6.0 * t - 45.0)

    def speed(t: Array) -> Array:
        return np.where(t < 15.0, 0.4 * (t - 7.5 / np.pi * np.sin(2.0 * np.pi * t / 15.0)), 6.0)

    def growth(t: Array) -> Array:
        return np.where(t < 15.0, 0.4 * (1.0 - np.cos(2.0 * np.pi * t / 15.0)), 0.0)

    # EI = 1.4e4, EA = 2.8e7, rho A = 1.2: a section of 0.0775 m by 1 m.
    height = math.sqrt(12.0 * 1.4e4 / 2.8e7)
    blade = beam(10.0, height, 1.0, 2.8e7 / height, 1.2 / height, 10, 3, "tangent")
    mechanism = Mechanism(
        {"beam": Placement((5.0, 0.0))},
        [
            Revolute(("beam", "left"), Ground(), name="hub"),
            PrescribedAngle(("beam", "left"), Motion(angle, speed, growth), name="drive"),
        ],
    )
    t = np.linspace(0.0, 12.0, 1201)
    frequency = 1.87510406871196**2 * math.sqrt(1.4e4 / 1.2) / 100.0
    assert frequency == pytest.approx(3.798, abs=5e-4)
    crossing = t[np.argmax(speed(t) > frequency)]
    message = rf"body 'beam' turns with 3\.\d+ rad/s at t = {crossing:.4g} s, faster .* of 3\.798"
    with pytest.warns(SofteningWarning, match=message):
        simulate(mechanism, {"beam": blade}, GeneralizedAlpha(12.0, 1200))
    with warnings.catch_warnings():
        # So close to that speed it bends by more than linear theory describes.
        warnings.simplefilter("error", SofteningWarning)
        warnings.simplefilter("ignore", LargeDeformationWarning)
        simulate(mechanism, {"beam": blade}, GeneralizedAlpha(float(crossing) - 0.1, 1200))
