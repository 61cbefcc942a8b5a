# SPDX-License-Identifier: MIT
"""Geometric stiffening by forces at markers: struts, foreshortening, energy, derivatives."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.scenes import SCENES, Bodies, Scene, moved, random_direction

from dolfinx_ffr.body import BodyMarker, VolumeIntegrals
from dolfinx_ffr.dynamics import (
    GeneralizedAlpha,
    RadauIIA,
    SofteningWarning,
    adjoint,
    simulate,
)
from dolfinx_ffr.mechanism import Mechanism, Placement, PointMass
from dolfinx_ffr.mechanism.forces import Force, SpringDamper
from dolfinx_ffr.mechanism.initial_conditions import Assembled, StaticEquilibrium
from dolfinx_ffr.mechanism.joints import PointOnLine, PrescribedAngle, Revolute
from dolfinx_ffr.mechanism.marker import Ground
from dolfinx_ffr.mechanism.motion import Motion
from dolfinx_ffr.objective import (
    IntegralCompliance,
    MarkerAcceleration,
    MarkerVelocity,
    PathTracking,
)
from dolfinx_ffr.verification import (
    assert_taylor_order,
    central_difference,
    convergence_order,
    taylor_test,
)

Array = NDArray[np.float64]

LENGTH, BENDING, LINE_MASS = 2.0, 50.0, 1.5
EULER = math.pi**2 * BENDING / LENGTH**2


def sine_beam(waves: int = 2, *, tip_mass: float = 0.0) -> VolumeIntegrals:
    """A pinned beam by its modes sin(j pi x / L), in the frame through both ends.

    The ends come nearer by 1/4 sum_j (j pi)^2 / L q_j^2, half the integral of the squared slope.
    """
    j = np.arange(1, waves + 1)
    mass = LINE_MASS * LENGTH
    turned = LINE_MASS * LENGTH**2 * -((-1.0) ** j) / (j * math.pi)  # int rho x sin
    area = mass * (1.0 - (-1.0) ** j) / (j * math.pi)
    G, N = np.zeros((2, waves + 1, waves + 1))
    G[0, 0] = mass * LENGTH**2 / 3.0
    G[1:, 1:] = 0.5 * mass * np.eye(waves)
    N[0, 1:], N[1:, 0] = turned, -turned
    slope = np.diag(0.5 * (j * math.pi) ** 2 / LENGTH)
    ends = {
        "left": BodyMarker([0.0, 0.0], np.zeros((2, waves)), j * math.pi / LENGTH),
        "right": BodyMarker(
            [LENGTH, 0.0],
            np.zeros((2, waves)),
            (-1.0) ** j * j * math.pi / LENGTH,
            np.stack([slope, np.zeros_like(slope)]),
        ),
    }
    return VolumeIntegrals(
        mass=mass,
        S=np.vstack([[0.5 * mass * LENGTH, 0.0], np.column_stack([0.0 * area, area])]),
        G=G,
        N=N,
        K=np.diag(0.5 * BENDING * (j * math.pi) ** 4 / LENGTH**3),
        markers=ends,
    )


def strut(force: float, deflection: float, **options: object) -> Mechanism:
    """The pinned beam on a fixed and a sliding bearing, under an axial force on the latter."""
    return Mechanism(
        {"beam": Placement()},
        [
            Revolute(("beam", "left"), Ground(), name="bearing"),
            PointOnLine(("beam", "right"), Ground(), name="slider"),
        ],
        forces=[Force(("beam", "right"), force, 0.0)],
        start=Assembled(elastic={"beam": [deflection, 0.0]}),
        **options,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize("share", [-0.9, -0.5, 0.0, 2.0])
def test_frequency_of_a_strut(share: float) -> None:
    """The squared frequency falls like 1 - N / N_E under compression N, by Euler's load N_E."""
    omega = math.pi**2 * math.sqrt(BENDING / LINE_MASS) / LENGTH**2 * math.sqrt(1.0 + share)
    mechanism = strut(share * EULER, 1e-6)
    t = simulate(mechanism, {"beam": sine_beam()}, RadauIIA(2.0 * math.pi / omega, steps=60))
    np.testing.assert_allclose(t.elastic("beam")[:, 0], 1e-6 * np.cos(omega * t.t), atol=1e-11)


def test_a_strut_buckles_beyond_the_load_of_euler() -> None:
    rate = math.pi**2 * math.sqrt(BENDING / LINE_MASS) / LENGTH**2 * math.sqrt(0.1)
    t = simulate(strut(-1.1 * EULER, 1e-8), {"beam": sine_beam()}, RadauIIA(2.0 / rate, steps=60))
    np.testing.assert_allclose(t.elastic("beam")[:, 0], 1e-8 * np.cosh(rate * t.t), rtol=1e-7)


def test_the_ends_of_a_bent_beam_come_nearer() -> None:
    body, q = sine_beam(), np.array([[0.1, 0.0], [0.05, -0.02]])
    x, weights = np.polynomial.legendre.leggauss(20)
    phase = 0.5 * math.pi * (x + 1.0)
    slope = sum(q[:, j, None] * (j + 1) * np.cos((j + 1) * phase) for j in range(2))
    shortened = 0.25 * LENGTH * (math.pi / LENGTH * slope) ** 2 @ weights
    shift = body.markers["right"].shift(q)
    np.testing.assert_allclose(shift[:, 0], -shortened, rtol=1e-9)
    np.testing.assert_array_equal(shift[:, 1], 0.0)
    t = simulate(strut(0.0, 0.1), {"beam": body}, GeneralizedAlpha(0.01, 2))
    assert t.marker_path("beam", "right")[0, 0] == pytest.approx(LENGTH - shortened[0])


def spinning(body: VolumeIntegrals, speed: float, mass: float, q: Array) -> Mechanism:
    return Mechanism(
        {"beam": Placement(angular_velocity=speed)},
        [
            Revolute(("beam", "left"), Ground(), name="hub"),
            PrescribedAngle(("beam", "left"), Motion.polynomial([0.0, speed]), name="drive"),
        ],
        start=Assembled(elastic={"beam": q}),
        point_masses=[PointMass(("beam", "right"), mass)] if mass else [],
    )


def cantilever(mass: float = 1e-6) -> VolumeIntegrals:
    """A light cantilever, by its deflection under a force at the tip."""
    x, weights = np.polynomial.legendre.leggauss(8)
    x, weights = 0.5 * LENGTH * (x + 1.0), 0.5 * LENGTH * weights
    shape = 0.5 * (3.0 * (x / LENGTH) ** 2 - (x / LENGTH) ** 3)
    slope = 0.5 * (6.0 * x / LENGTH**2 - 3.0 * x**2 / LENGTH**3)
    W = np.stack([np.column_stack([x, 0.0 * x]), np.column_stack([0.0 * x, shape])], axis=1)
    rho = mass / LENGTH * weights
    turned = np.stack([-W[..., 1], W[..., 0]], axis=-1)
    return VolumeIntegrals(
        mass=mass,
        S=np.einsum("p,pad->ad", rho, W),
        G=np.einsum("p,pad,pbd->ab", rho, W, W),
        N=np.einsum("p,pad,pbd->ab", rho, turned, W),
        K=[[3.0 * BENDING / LENGTH**3]],
        markers={
            "left": BodyMarker([0.0, 0.0], [[0.0], [0.0]], [0.0]),
            "right": BodyMarker(
                [LENGTH, 0.0],
                [[0.0], [1.0]],
                [1.5 / LENGTH],
                [[[float(weights @ slope**2)]], [[0.0]]],
            ),
        },
    )


def test_a_point_mass_stiffens_the_beam_that_swings_it() -> None:
    """K = 3 E I / L^3, and m omega^2 (L int w'^2 dx - 1) of the centrifugal force, w(L) = 1."""
    body, mass, speed = cantilever(), 0.7, 6.0
    slope = 1.2 / LENGTH  # int w'^2 dx
    omega = math.sqrt(3.0 * BENDING / LENGTH**3 / mass + speed**2 * (LENGTH * slope - 1.0))
    assert body.with_point_mass("right", mass).stiffening["omega2"] == pytest.approx(
        mass * LENGTH * slope, rel=1e-12
    )
    # Faster than its frequency at rest, and no warning: the mass stiffens the beam.
    assert speed > math.sqrt(3.0 * BENDING / LENGTH**3 / mass)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        t = simulate(
            spinning(body, speed, mass, np.array([1e-5])),
            {"beam": body},
            RadauIIA(2.0 * math.pi / omega, steps=80),
        )
    swing = t.elastic("beam")[:, 0]
    np.testing.assert_allclose(swing, 1e-5 * np.cos(omega * t.t), atol=3e-10)


def rigid_tip(body: VolumeIntegrals, mass: float, speed: float) -> tuple[Mechanism, Bodies]:
    """The same with a small rigid body pinned to the tip instead of a point mass."""
    mechanism = spinning(body, speed, 0.0, np.array([1e-5]))
    velocity = (0.0, LENGTH * speed)
    tip = VolumeIntegrals.rigid(mass, markers={"pin": (0.0, 0.0)}, inertia=1e-3)
    return replace(
        mechanism,
        placements={**mechanism.placements, "tip": Placement((LENGTH, 0.0), 0.0, velocity, speed)},
        joints=[*mechanism.joints, Revolute(("tip", "pin"), ("beam", "right"), name="pin")],
        point_masses=[],
    ), {"beam": body, "tip": tip}


def test_a_body_at_a_joint_stiffens_as_the_point_mass_does() -> None:
    body, mass, speed = cantilever(1e-6), 0.7, 6.0
    integrator = RadauIIA(0.6, steps=80)
    first = simulate(spinning(body, speed, mass, np.array([1e-5])), {"beam": body}, integrator)
    second = simulate(*rigid_tip(body, mass, speed), integrator)
    np.testing.assert_allclose(second.elastic("beam"), first.elastic("beam"), atol=1e-9)


def test_a_force_at_the_tip_takes_a_warning_back() -> None:
    body = cantilever(0.5)
    speed = 1.1 * math.sqrt(body.K[0, 0] / body.G[1, 1])
    integrator = RadauIIA(0.2, steps=40)
    loose = replace(body, markers={n: replace(m, stiffening=None) for n, m in body.markers.items()})
    with pytest.warns(SofteningWarning, match="faster than its lowest frequency"):
        simulate(*rigid_tip(loose, 0.7, speed), integrator)
    with pytest.warns(SofteningWarning, match="faster than its lowest frequency"):
        simulate(spinning(body, speed, 0.0, np.zeros(1)), {"beam": body}, integrator)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulate(*rigid_tip(body, 0.7, speed), integrator)
        simulate(spinning(body, speed, 0.7, np.zeros(1)), {"beam": body}, integrator)


@pytest.mark.parametrize("radau", [False, True])
def test_energy_is_conserved(radau: bool) -> None:
    """Large deflections, an axial spring, a spring across, a constant force; no gravity."""
    body, stiffness = sine_beam(), 3e3
    mechanism = Mechanism(
        {"beam": Placement()},
        [Revolute(("beam", "left"), Ground(), name="bearing")],
        forces=[
            SpringDamper(("beam", "right"), Ground((1.2 * LENGTH, 0.0)), stiffness, 0.0, 0.1),
            SpringDamper(("beam", "right"), Ground((LENGTH, 0.1)), 0.1 * stiffness, 0.0, 0.0),
            Force(("beam", "right"), 20.0, -10.0),
        ],
        start=Assembled(elastic={"beam": [0.12, -0.02]}),
    )
    steps, errors = np.array([200, 400, 800] if radau else [1000, 2000, 4000]), []
    for count in steps:
        integrator = RadauIIA(0.5, steps=count) if radau else GeneralizedAlpha(0.5, int(count), 1.0)
        t = simulate(mechanism, {"beam": body}, integrator)
        tip, kinetic = t.marker_path("beam", "right"), t.kinetic_energy("beam")
        stretch = np.hypot(*(tip - [1.2 * LENGTH, 0.0]).T) - 0.1
        energy = kinetic + t.strain_energy("beam") - tip @ [20.0, -10.0]
        energy += 0.5 * stiffness * stretch**2
        energy += 0.05 * stiffness * np.sum((tip - [LENGTH, 0.1]) ** 2, axis=1)
        ends = energy[::3] if radau else energy
        errors.append(float(np.max(np.abs(ends - ends[0])) / np.max(kinetic)))
    assert errors[-1] < 1e-6
    assert convergence_order(1.0 / steps, errors) > (4.5 if radau else 1.9)
    # The shortening matters by far more than that.
    shortened = body.markers["right"].shift(t.elastic("beam"))[:, 0]
    assert np.max(np.abs(stiffness * stretch * shortened)) > 0.05 * np.max(kinetic)


def hanging_loader() -> Scene:
    """The loader from its static equilibrium."""
    scene = SCENES["loader"](end_time=0.05, steps=40)
    return replace(scene, mechanism=replace(scene.mechanism, start=StaticEquilibrium()))


def deformed_robot() -> Scene:
    """The robot with bodies that are bent and swing at the start."""
    scene, rng = SCENES["robot"](end_time=0.05, steps=40), np.random.default_rng(5)
    shapes = {
        name: 1e-4 * rng.uniform(-1.0, 1.0, body.modes) / np.arange(1, body.modes + 1) ** 2
        for name, body in scene.bodies.items()
        if body.modes
    }
    start = Assembled(shapes, {name: 30.0 * shape for name, shape in shapes.items()})
    return replace(scene, mechanism=replace(scene.mechanism, start=start))


MAKE = SCENES | {"hanging loader": hanging_loader, "deformed robot": deformed_robot}

#: Scenes, the size of the geometric stiffness beside that of shape functions, and the first step.
CASES = {
    "slider-crank": (0.01, 4e-3),
    "four-bar": (0.01, 2e-4),
    "robot": (0.1, 4e-3),
    "deformed robot": (0.02, 4e-3),
    "loader": (0.1, 1e-3),
    "hanging loader": (0.1, 1e-3),
    "stiffened": (0.05, 4e-3),
}


def bent(name: str) -> Scene:
    """A scene whose markers all have geometric stiffness."""
    scene, rng = MAKE[name](), np.random.default_rng(11)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        motion = simulate(scene.mechanism, scene.bodies, scene.integrator)
    bodies = dict(scene.bodies)
    for key, body in scene.bodies.items():
        r = body.modes
        size = 1.0 / np.sqrt(np.max(np.abs(motion.elastic(key)), axis=0, initial=1e-9))
        markers = {}
        for marker, point in body.markers.items():
            array = CASES[name][0] * rng.uniform(-1.0, 1.0, (2, r, r)) * np.outer(size, size)
            stiffening = array + array.transpose(0, 2, 1) if r else None
            markers[marker] = replace(point, stiffening=stiffening)
        bodies[key] = replace(body, markers=markers)
    return replace(scene, bodies=bodies)


def change(bodies: Bodies, seed: int, fields: str) -> Bodies:
    """A random direction of all integrals (see scenes.py), or of T of the markers alone."""
    direction, rng = random_direction(bodies, seed, fields), np.random.default_rng(seed + 100)
    for name, body in bodies.items():
        for marker, point in body.markers.items():
            if point.stiffening is not None:
                array = rng.uniform(-1.0, 1.0, point.stiffening.shape)
                array *= 0.1 * np.max(np.abs(point.stiffening))
                old = direction[name].markers[marker]
                direction[name].markers[marker] = replace(
                    old, stiffening=array + array.transpose(0, 2, 1)
                )
    return direction


#: Each with both integrators; the stiffness of the last one is not made for longer steps.
RUNS = [(name, False) for name in CASES] + [(name, True) for name in list(CASES)[:-1]]
Derivative = tuple[Callable[..., float], Bodies, Bodies, float]


@pytest.fixture(scope="module", params=RUNS)
def derivative(
    request: pytest.FixtureRequest,
) -> tuple[Callable[..., float], Bodies, Bodies, float]:
    """The function of the bodies, the bodies, its derivative, and the first step."""
    name, radau = request.param
    scene = bent(name)
    flexible = [key for key, body in scene.bodies.items() if body.modes]
    objective = IntegralCompliance() + 1e-8 * MarkerAcceleration(flexible[0], "middle")
    objective = objective + 1e-4 * MarkerVelocity(flexible[0], "middle")
    objective += 1e-3 * PathTracking(flexible[-1], "right", (0.1, 0.2))
    integrator: GeneralizedAlpha | RadauIIA = scene.integrator
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if radau:
            end = 0.3 * scene.integrator.end_time
            integrator = RadauIIA(end, steps=60)
        trajectory = simulate(scene.mechanism, scene.bodies, integrator)
    bar, explicit = objective.pullback(trajectory, scene.bodies)
    through = adjoint(trajectory, bar)
    gradient = {key: through[key] + explicit[key] for key in through}

    def value(bodies: Bodies) -> float:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return objective.value(simulate(scene.mechanism, bodies, integrator), bodies)

    return value, scene.bodies, gradient, CASES[name][1]


@pytest.mark.slow
@pytest.mark.parametrize("fields", ["", "mSGNKWPT"])
def test_derivative(derivative: Derivative, fields: str) -> None:
    """By the geometric stiffness of markers alone, and by all integrals together."""
    value, bodies, gradient, first = derivative
    direction = change(bodies, 3, fields)
    slope = sum(gradient[name].dot(direction[name]) for name in bodies)

    def along(step: float) -> float:
        return value(moved(bodies, direction, float(step)))

    largest = first if fields else 10.0 * first
    result = taylor_test(
        along,
        lambda step: float(step) * slope,
        0.0,
        1.0,
        steps=[largest / 2.0**k for k in range(5)],
        roundoff=1e-13,
    )
    assert_taylor_order(result, points=3)
    difference = central_difference(along, 0.0, 1.0, 0.15 * largest)
    assert slope == pytest.approx(difference, rel=2e-6)


def test_point_masses_pass_their_stiffness_back() -> None:
    body, rng = bent("robot").bodies["arm"], np.random.default_rng(1)

    def loaded(part: VolumeIntegrals) -> VolumeIntegrals:
        return part.with_point_mass("right", 0.3).with_point_mass("left", 0.2)

    bar = loaded(body).scaled(rng.uniform(0.5, 1.0))
    bar = replace(bar, K=0.0 * bar.K)  # large, and not concerned
    back = body.point_mass_pullback(bar, "left", 0.2)
    back = body.point_mass_pullback(back, "right", 0.3)
    direction = change({"arm": body}, 2, "WT")["arm"]
    ahead, behind = (bar.dot(loaded(body + direction.scaled(h))) for h in (0.5, -0.5))
    assert back.dot(direction) == pytest.approx(ahead - behind, rel=1e-9)


def test_no_geometric_stiffness_is_zero_geometric_stiffness() -> None:
    scene = SCENES["loader"]()
    bodies = {
        name: replace(
            body,
            markers={
                key: replace(marker, stiffening=np.zeros((2, body.modes, body.modes)))
                for key, marker in body.markers.items()
            },
        )
        for name, body in scene.bodies.items()
    }
    first = simulate(scene.mechanism, scene.bodies, scene.integrator)
    second = simulate(scene.mechanism, bodies, scene.integrator)
    np.testing.assert_allclose(second.y, first.y, rtol=1e-9, atol=1e-12)


def test_file_keeps_the_geometric_stiffness_of_markers(tmp_path: Path) -> None:
    body = sine_beam()
    body.save(tmp_path / "strut.npz")
    loaded = VolumeIntegrals.load(tmp_path / "strut.npz")
    assert loaded.markers["left"].stiffening is None
    np.testing.assert_array_equal(
        loaded.markers["right"].stiffening, body.markers["right"].stiffening
    )
    arrays = dict(np.load(tmp_path / "strut.npz"))
    arrays["marker_stiffening"] = arrays["marker_stiffening"][:1]
    np.savez(tmp_path / "short.npz", **arrays)
    with pytest.raises(ValueError, match="marker_stiffening has shape"):
        VolumeIntegrals.load(tmp_path / "short.npz")


def test_sums_products_and_fewer_modes() -> None:
    body = sine_beam(3)
    stiffening = body.markers["right"].stiffening
    assert stiffening is not None
    loose = replace(body, markers={n: replace(m, stiffening=None) for n, m in body.markers.items()})
    assert body.dot(body) == pytest.approx(loose.dot(loose) + np.sum(stiffening**2), rel=1e-14)
    assert body.dot(loose) == loose.dot(loose)
    for total in (body + loose, body.scaled(2.0) + body.scaled(-1.0)):
        np.testing.assert_allclose(total.markers["right"].stiffening, stiffening)
    np.testing.assert_array_equal(
        body.leading(2).markers["right"].stiffening, stiffening[:, :2, :2]
    )


@pytest.mark.parametrize(
    ("stiffening", "message"),
    [
        (np.eye(2), r"must have shape \(2, 2, 2\)"),
        (np.full((2, 2, 2), np.nan), "holds NaN"),
        (np.triu(np.ones((2, 2, 2))), "must be symmetric"),
    ],
)
def test_refused(stiffening: Array, message: str) -> None:
    body = sine_beam()
    body.markers["right"] = replace(body.markers["right"], stiffening=stiffening)
    with pytest.raises(ValueError, match=f"body 'strut', marker 'right': stiffening {message}"):
        body.validate("strut")
