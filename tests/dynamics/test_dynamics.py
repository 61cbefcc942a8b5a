# SPDX-License-Identifier: MIT
"""Simulation: invariants, closed forms, published cases, orders in time, and refused runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.beams import beam
from shared.motions import check_order
from shared.scenes import (
    SCENES,
    Scene,
    calm,
    four_bar,
    out_of_reach,
    parallelograms,
    slider_crank,
    slider_crank_mechanism,
)

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Integrator, Trajectory, TrajectoryBar, adjoint
from dolfinx_ffr.dynamics.kinematics import evaluate_equations

Array = NDArray[np.float64]
QUANTITIES = ("y", "v", "w", "multipliers")


def run(scene: Scene, **changes: float) -> Trajectory:
    return ffr.simulate(scene.mechanism, scene.bodies, replace(scene.integrator, **changes))


def rod(mass: float = 1.0, length: float = 1.0) -> ffr.VolumeIntegrals:
    """Rigid uniform rod with markers at its ends and in the middle."""
    markers = {"left": (-0.5 * length, 0), "middle": (0, 0), "right": (0.5 * length, 0)}
    return ffr.VolumeIntegrals.rigid(mass, (0, 0), mass * length**2 / 12.0, markers)


def change_basis(body: ffr.VolumeIntegrals, T: Array) -> ffr.VolumeIntegrals:
    """The same body in other elastic coordinates, q = T q_new."""
    extended = np.eye(body.modes + 1)
    extended[1:, 1:] = T
    return ffr.VolumeIntegrals(
        body.mass,
        extended.T @ body.S,
        extended.T @ body.G @ extended,
        extended.T @ body.N @ extended,
        T.T @ body.K @ T,
        {
            name: ffr.BodyMarker(m.position, m.displacement @ T, m.rotation @ T)
            for name, m in body.markers.items()
        },
        {load: T.T @ array @ T for load, array in body.stiffening.items()},
    )


@pytest.mark.parametrize("name", SCENES)
def test_objective_does_not_depend_on_the_basis(name: str) -> None:
    scene, rng = SCENES[name](), np.random.default_rng(0)
    bodies = {
        key: change_basis(body, rng.normal(size=(body.modes, body.modes)))
        for key, body in scene.bodies.items()
    }
    psi, other = (
        ffr.IntegralCompliance().evaluate(ffr.Response(run(each), each.bodies))
        for each in (scene, replace(scene, bodies=bodies))
    )
    assert other == pytest.approx(psi, rel=1e-10)


@pytest.mark.parametrize("radau", [False, True])
@pytest.mark.parametrize("name", SCENES)
def test_equations_and_constraints_hold_to_round_off_at_all_times(name: str, radau: bool) -> None:
    scene = calm(name) if radau else SCENES[name]()
    end_time = scene.integrator.end_time
    method = ffr.RadauIIA(end_time, steps=300) if radau else scene.integrator
    trajectory = ffr.simulate(scene.mechanism, scene.bodies, method)
    model, n = trajectory.model, trajectory.model.size
    speed, force = np.max(np.abs(trajectory.v)), np.max(np.abs(trajectory.multipliers))
    if radau:
        elastic = [trajectory.elastic(name) @ body.K for name, body in model.bodies.items()]
        force = 10.0 * max(force, *(np.max(np.abs(part), initial=0.0) for part in elastic))
    states = zip(*(getattr(trajectory, part) for part in QUANTITIES), strict=True)
    equations_at_states = [
        evaluate_equations(model.arrays, k, *state)[0] for k, state in enumerate(states)
    ]
    residuals = np.array(equations_at_states)
    assert np.max(np.abs(residuals[:, :n])) < 1e-12 * force
    assert np.max(np.abs(residuals[:, n : n + model.rows])) < 1e-14  # metres, of parts of 0.4 m
    assert np.max(np.abs(residuals[:, n + model.rows :])) < 1e-14 * speed


#: Lengths of crank and rod [m], masses of slider and rod [kg].
CRANK, ROD, SLIDER, MASS = 0.1, 0.4, 0.5, 1.256


def slider_crank_forces(t: Array, motion: ffr.Motion) -> tuple[Array, Array]:
    """Pin force on a rigid uniform rod (n, 2) and the guide's force on its end (n,)."""
    phi, rate, growth = motion.tabulate(t)
    # in complex numbers: the pin, its velocity and acceleration, and the end's acceleration
    pin = CRANK * np.exp(1j * phi)
    y, dy = pin.imag, (1j * rate * pin).imag
    acceleration = (1j * growth - rate**2) * pin
    reach = np.sqrt(ROD**2 - y**2)
    end = acceleration.real - (dy**2 + y * acceleration.imag + (y * dy / reach) ** 2) / reach
    middle, back = 0.5 * (acceleration + end), (reach + 1j * y) / ROD
    # Moments about the pin: inertia of the rod, of the slider, and the guide's force.
    inertia = MASS * ROD / 12.0 * ((end - acceleration) * back).imag
    inertia += ROD * (back * (0.5 * MASS * middle + SLIDER * end)).imag
    guide = inertia / reach
    force = MASS * middle + SLIDER * end - 1j * guide
    return np.stack([force.real, force.imag], axis=1), guide


def rigid_slider_crank(body: ffr.VolumeIntegrals, steps: int) -> tuple[Trajectory, ffr.Motion]:
    motion = ffr.Motion.smooth_step(4.0 * math.pi, 0.6)
    mechanism = slider_crank_mechanism(motion, crank=CRANK, rod=ROD, slider=SLIDER)
    return ffr.simulate(mechanism, {"rod": body}, ffr.GeneralizedAlpha(0.6, steps)), motion


def force_error(body: ffr.VolumeIntegrals, steps: int) -> float:
    trajectory, motion = rigid_slider_crank(body, steps)
    pin, guide = slider_crank_forces(trajectory.t, motion)
    error = np.max(np.abs(trajectory.joint_force("crank pin") - pin))
    error = max(error, np.max(np.abs(trajectory.joint_force("slider")[:, 0] - guide)))
    return float(error / np.max(np.abs(pin)))


def test_joint_forces_of_the_rigid_slider_crank() -> None:
    check_order(lambda n: [force_error(rod(MASS, ROD), n)], [300, 600, 1200], 1e-4)


@pytest.mark.parametrize(("modulus", "limit"), [(2.1e14, 1e-5)])
def test_stiff_rod_has_the_joint_forces_of_the_rigid_one(modulus: float, limit: float) -> None:
    # What is left at infinite stiffness is the start of the drive, which no step resolves then.
    stiff = beam(youngs_modulus=modulus, modes=4)
    assert stiff.mass == pytest.approx(MASS)
    flexible, _ = rigid_slider_crank(stiff, 1200)
    rigid, _ = rigid_slider_crank(rod(MASS, ROD), 1200)
    gap = np.max(np.abs(flexible.multipliers - rigid.multipliers))
    assert gap < limit * np.max(np.abs(rigid.multipliers))
    assert force_error(stiff, 1200) < 2e-4


def check_published(path: Callable[[int], Array], exact: Array, steps: Array) -> None:
    """Order two towards a published case, and its digits by extrapolation to no step at all."""
    values: list[Array] = []

    def error(count: int) -> list[float]:
        values.append(path(count))
        return [float(np.max(np.abs(values[-1] - exact)))]

    check_order(error, steps, 1.5e-4)
    for power in (2, 3):  # of the step, in the error that one more halving removes
        factor = 2.0**power
        values = [(factor * fine - coarse) / (factor - 1.0) for coarse, fine in pairwise(values)]
    assert np.max(np.abs(values[-1] - exact)) < 1e-6


#: Of the right end of the first crank of the parallelograms [m], by time [s]
PARALLELOGRAMS = {
    1.0: (-0.1950203019, -0.9807992057),
    5.0: (-0.8113104610, -0.5846155454),
    10.0: (0.3284581115, 0.9445185382),
}


@pytest.mark.slow
def test_parallelograms_through_their_singular_positions() -> None:
    def path(steps: int) -> Array:
        t = ffr.simulate(*parallelograms(), ffr.GeneralizedAlpha(10.0, steps))
        indices = [round(time * steps / 10.0) for time in PARALLELOGRAMS]
        return t.marker_path("crank 0", "right")[indices]

    check_published(path, np.array(list(PARALLELOGRAMS.values())), np.array([2000, 4000, 8000]))


def soft_slider_crank() -> tuple[Scene, int]:
    """All oscillations of the rod are slow enough for the steps to resolve."""
    scene = slider_crank(end_time=0.2)
    return replace(scene, bodies={"rod": beam(modes=2, youngs_modulus=5e8)}), 1600


def pendulum() -> tuple[Scene, int]:
    """Flexible arm on a pin, welded to a rigid bob, in the field of gravity."""
    arm = beam(0.5, 0.01, 0.01, 2e9, elements=8, modes=2, frame="tangent")
    mechanism = ffr.Mechanism(
        {"arm": ffr.Placement((0.25, 0.0)), "bob": ffr.Placement((0.55, 0.0))},
        [
            ffr.Revolute(("arm", "left"), ffr.Ground(), name="pivot"),
            ffr.Weld(("arm", "right"), ("bob", "rim"), name="weld"),
        ],
        gravity=(0.0, -9.81),
    )
    bob = ffr.VolumeIntegrals.rigid(0.4, (0.0, 0.0), 5e-4, {"rim": (-0.05, 0.0)})
    return Scene(mechanism, {"arm": arm, "bob": bob}, ffr.GeneralizedAlpha(0.4, 1)), 1600


@cache
def solution(make: Callable[[], tuple[Scene, int]]) -> list[np.ndarray]:
    """Quantities at the ends of short steps, by Radau's method, of third order and more."""
    scene, coarsest = make()
    method = ffr.RadauIIA(scene.integrator.end_time, steps=4 * coarsest)
    trajectory = ffr.simulate(scene.mechanism, scene.bodies, method)
    return [getattr(trajectory, name)[::3] for name in QUANTITIES]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "radius"), [(soft_slider_crank, 0.5), (soft_slider_crank, 1.0), (pendulum, 0.8)]
)
def test_order_two_in_positions_velocities_and_multipliers(
    make: Callable[[], tuple[Scene, int]], radius: float
) -> None:
    scene, coarsest = make()
    exact = solution(make)

    def errors(count: int) -> list[float]:
        trajectory, computed = run(scene, steps=count, spectral_radius=radius), []
        for name, values in zip(QUANTITIES, exact, strict=True):
            values = values[:: 4 * coarsest // count]
            error = np.max(np.abs(getattr(trajectory, name) - values), axis=0)
            scale = np.max(np.abs(values), axis=0)
            computed.append(float(np.max(error / np.maximum(scale, 1e-3 * scale.max()))))
        return computed

    check_order(errors, coarsest * np.array([1, 2, 4]), *[1e-2] * 4)


def test_multipliers_are_right_from_the_first_step() -> None:
    # The index-3 form, or a_0 = w_0, would leave errors of several per cent that keep ringing.
    scene, coarsest = pendulum()
    coarse, fine = run(scene, steps=coarsest), run(scene, steps=8 * coarsest)
    gap = np.abs(coarse.multipliers[:5] - fine.multipliers[:33:8])
    assert np.max(gap) < 1e-3 * np.max(np.abs(fine.multipliers))


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
        ValueError, match=r"'crank' has no marker 'middle'; its markers are \['left', 'right'\]"
    ):
        t.marker_path("crank", "middle")
    with pytest.raises(ValueError, match=r"no body 'rod'; the bodies are \['crank', 'coupler'"):
        t.elastic("rod")


@pytest.mark.filterwarnings("ignore::dolfinx_ffr.SofteningWarning")  # where it locks, it is thrown
@pytest.mark.parametrize(
    "integrator",
    [
        ffr.GeneralizedAlpha(1.0, 100),
        ffr.RadauIIA(1.0, tolerance=1e-6),
        ffr.RadauIIA(1.0, steps=200),
    ],
    ids=["generalized-alpha", "Radau by tolerance", "Radau"],
)
def test_a_mechanism_that_locks_is_named_and_the_motion_so_far_is_kept(
    integrator: Integrator,
) -> None:
    """It has derivatives, too."""
    message = r"at t = 0\.[34].*trajectory"
    if isinstance(integrator, ffr.GeneralizedAlpha):
        message = (
            r"at t = 0\.4\d* s \(step \d+ of 100, 0\.01 s each\) .* in body '(carrier|rod)' and .* "
            r"in joint '"
        )
    with pytest.raises(ffr.SimulationError, match=message) as caught:
        ffr.simulate(*out_of_reach(), integrator)
    so_far = caught.value.trajectory
    assert 0.3 < so_far.t[-1] <= 0.41
    if isinstance(integrator, ffr.RadauIIA):
        assert 0.39 < so_far.t[-1] <= 0.4
    assert np.all(np.isfinite(so_far.y))
    assert so_far.y.shape[0] == so_far.t.size
    height = so_far.marker_path("carrier", "left")[:, 1]
    np.testing.assert_allclose(height, 2.5 * so_far.t, atol=1e-13)
    bar = TrajectoryBar.zeros(so_far)
    bar.y[-1] = 1.0
    bars = adjoint(so_far, bar).bodies
    assert np.isfinite(bars["carrier"].mass)
    assert np.all(np.isfinite(bars["rod"].K)) and np.any(bars["rod"].K != 0.0)
