# SPDX-License-Identifier: MIT
"""Derivatives by the numbers of a mechanism, against differences of whole simulations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from shared.spatial_bodies import cloud, flat_cloud, stiffened_cloud
from shared.spatial_scenes import chain, geared, hub
from shared.spatial_scenes import driven as driven_in_space

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Integrator, TrajectoryBar, adjoint, influence, parameter_slopes

#: What is tested are derivatives, of motions that no one would want.
pytestmark = [
    pytest.mark.filterwarnings(f"ignore::dolfinx_ffr.dynamics.{name}Warning")
    for name in ("LargeDeformation", "Softening", "TiltedAxis", "TimeStep")
]

END = ("arm", "end")
TWO, ROOT = ("two", "root"), ("one", "root")


def bodies(mass: float = 1.3) -> dict[str, ffr.VolumeIntegrals]:
    markers = {"pin": (-0.3, 0.0), "end": (0.2, 0.0)}
    return {"arm": ffr.VolumeIntegrals.rigid(mass, (0.02, 0.01), 0.05, markers)}


def machine(
    stiffness: float,
    damping: float,
    rest: float,
    tip: float,
    fall: float,
    push: float,
    height: float,
    anchor: float,
    speed: float,
    mass: float,
) -> Any:
    """A pendulum with a spring, whose pin and anchor share a point at the start values."""
    return ffr.Mechanism(
        {"arm": ffr.Placement((0.3, 0.0), angular_velocity=speed, velocity=(0.0, 0.3 * speed))},
        [ffr.Revolute(("arm", "pin"), ffr.Ground((0.0, height)))],
        point_masses=[ffr.PointMass(END, tip)],
        gravity=(0.0, -fall),
        forces=[
            ffr.SpringDamper(END, ffr.Ground((anchor, 0.0)), stiffness, length=rest),
            ffr.SpringDamper(END, ffr.Ground((0.1, -0.4)), 0.0, damping, length=0.3),
            ffr.Force(END, x=lambda t: push * np.sin(9.0 * t), follower=True),
        ],
    ), bodies(mass)


PENDULUM = {
    "stiffness": (40.0, 10.0, 90.0),
    "damping": (0.4, 0.0, 2.0),
    "rest": (0.25, 0.1, 0.4),
    "tip": (0.2, 0.1, 0.5),
    "fall": (9.81, 5.0, 15.0),
    "push": (1.0, -2.0, 2.0),
    "height": (0.0, -0.1, 0.1),
    "anchor": (0.0, -0.1, 0.1),
    "speed": (0.5, -1.0, 1.0),
    "mass": (1.3, 1.0, 2.0),
}


CHAIN = {
    "turn": (6.0, 5.0, 7.0),
    "radius": (0.2, 0.1, 0.3),
    "fall": (9.81, 5.0, 15.0),
    "alpha": (0.3, 0.0, 1.0),
    "beta": (1e-3, 5e-4, 2e-3),
    "push": (1.0, -2.0, 2.0),
    "moment": (0.2, -1.0, 1.0),
    "stiffness": (5.0, 1.0, 9.0),
    "damping": (0.7, 0.1, 2.0),
    "anchor": (1.0, 0.5, 1.5),
    "tip": (0.3, 0.1, 0.5),
    "bent": (0.05, -0.1, 0.1),
}


SETTLED = {
    "drive": (3.0, 2.0, 4.0),
    "place": (0.2, 0.1, 0.3),
    "pin": (0.0, -0.1, 0.1),
    "axis": (0.3, 0.2, 0.4),
    "side": (3.0, 2.0, 4.0),
    "stiffness": (15.0, 10.0, 20.0),
    "bushing": (30.0, 20.0, 40.0),
}


GEARED = {
    "spin": (20.0, 15.0, 25.0),
    "ratio": (-2.0, -3.0, -1.0),
    "stiffness": (5.0, 2.0, 8.0),
    "rest": (0.1, -1.0, 1.0),
}


def toothed(dimension: int) -> Callable[..., ffr.Mechanism]:
    """A wheel that goes more than halfway round another one, whose axle is at the ground."""

    def build(**p: float) -> ffr.Mechanism:
        def spatial(*components: float) -> tuple[float, ...]:
            return (*components, 0.0, 0.0, 0.0)[:dimension]

        def about(z: float) -> Any:
            return (0.0, 0.0, z) if dimension == 3 else z

        orbit, origin = (-0.1 * p["orbit"], p["reach"] * p["orbit"]), ffr.Ground(spatial())
        joints = [
            ffr.Revolute(ROOT, origin),
            ffr.Distance(TWO, origin),
            ffr.Gear(TWO, ROOT, p["ratio"], "gear", p["angle"]),
        ]
        return ffr.Mechanism(
            {
                "one": ffr.Placement(spatial(), angular_velocity=about(p["spin"])),
                "two": ffr.Placement(spatial(p["reach"], 0.1), velocity=spatial(*orbit)),
            },
            joints + [ffr.Planar(TWO, origin)] * (dimension == 3),
            forces=[ffr.Torque(TWO, about(p["moment"]))],
        )

    return build


TOOTHED = {
    "reach": (1.0, 0.8, 1.2),
    "ratio": (-0.7, -1.0, -0.5),
    "angle": (0.3, 0.1, 0.5),
    "moment": (1.0, 0.5, 2.0),
    "spin": (3.0, 2.0, 4.0),
    "orbit": (12.0, 10.0, 14.0),
}


def linked(**p: float) -> ffr.Mechanism:
    """A bar in the plane that a spindle of its own drives along a line, on a strut and a spring."""
    motion = ffr.Motion.polynomial([0.1, 0.3])
    return ffr.Mechanism(
        {"arm": ffr.Placement((0.3, 0.0), angular_velocity=p["spin"])},
        [
            ffr.LinearDrive(
                ffr.Ground((0.1, p["height"])), ("arm", "pin"), motion, (1.0, p["slope"])
            ),
            ffr.Distance(END, ffr.Ground((0.5, 0.6)), p["strut"], name="strut"),
        ],
        gravity=(0.0, -9.81),
        forces=[
            ffr.TorsionalSpringDamper(
                ("arm", "pin"), ffr.Ground(), p["stiffness"], 0.1, angle=p["rest"]
            )
        ],
    )


LINKED = {
    "height": (0.0, -0.1, 0.1),
    "slope": (0.2, 0.1, 0.3),
    "strut": (0.6, 0.5, 0.7),
    "stiffness": (3.0, 1.0, 5.0),
    "rest": (0.1, -1.0, 1.0),
    "spin": (0.5, -1.0, 1.0),
}


@dataclass(frozen=True)
class Scene:
    """A mechanism of parameters with its bodies and steps."""

    build: Callable[..., Any]
    bounds: dict[str, tuple[float, float, float]]
    bodies: dict[str, ffr.VolumeIntegrals]
    integrator: Integrator


def two(make: Callable[[int, int], ffr.VolumeIntegrals]) -> dict[str, ffr.VolumeIntegrals]:
    return {"one": make(3, 1), "two": make(2, 2)}


ALPHA, RADAU = ffr.GeneralizedAlpha(0.3, 30), ffr.RadauIIA(0.3, steps=10)
SCENES = {
    "pendulum": Scene(machine, PENDULUM, bodies(), ALPHA),
    "linked": Scene(linked, LINKED, bodies(), ALPHA),
    "chain": Scene(chain, CHAIN, two(stiffened_cloud), ALPHA),
    "settled": Scene(driven_in_space, SETTLED, two(cloud), ALPHA),
    "geared": Scene(geared, GEARED, two(lambda _, seed: hub(0, seed)), ALPHA),
    "toothed": Scene(toothed(2), TOOTHED, two(flat_cloud), ALPHA),
    "toothed radau": Scene(toothed(2), TOOTHED, two(flat_cloud), RADAU),
    "toothed in space": Scene(toothed(3), TOOTHED, two(cloud), ALPHA),
}


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES.values(), ids=list(SCENES))
def test_slopes_are_those_of_differences(scene: Scene) -> None:
    mechanism = ffr.Parameters(**scene.bounds).mechanism(scene.build)
    run = ffr.simulate(mechanism, scene.bodies, scene.integrator)
    bar, rng = TrajectoryBar.zeros(run), np.random.default_rng(0)
    quantities = ("y", "v", "w", "multipliers")
    for part in quantities:
        values, bar_values = getattr(run, part), getattr(bar, part)
        bar_values[:] = rng.uniform(-1.0, 1.0, bar_values.shape) / np.max(np.abs(values))
    slopes = parameter_slopes(run, [adjoint(run, bar).mechanism])[0]

    def number(shift: np.ndarray) -> float:
        t = ffr.simulate(mechanism.shifted(shift), scene.bodies, scene.integrator)
        moved = run.model.arrays.difference(t.y, run.y)  # in space by turns, as the bar
        others_product = sum(np.sum(getattr(bar, p) * getattr(t, p)) for p in quantities[1:])
        return float(np.sum(bar.y * moved) + others_product)

    for k, (name, below, above) in enumerate(mechanism.parameters.ranges):
        errors = []
        for share in (3e-3, 1e-3, 3e-4):
            h = share * (below + above) * np.eye(len(slopes))[k]
            # of fourth order
            near, far = (number(h * s) - number(-h * s) for s in (1.0, 2.0))
            expected = (8.0 * near - far) / (12.0 * h[k])
            errors.append(abs(slopes[k] - expected) / abs(expected))
            if errors[-1] < 1e-7:
                break
        assert min(errors) < 1e-7, (name, errors)


def weighed(build: Callable[..., Any], **given: tuple[float, float, float]) -> np.ndarray:
    """Slopes of the sum of all coordinates of a pendulum."""
    mechanism = ffr.Parameters(**given).mechanism(build)
    run = ffr.simulate(mechanism, bodies(), ffr.GeneralizedAlpha(0.1, 5))
    bar = TrajectoryBar.zeros(run)
    bar.y[:] = 1.0
    return parameter_slopes(run, [adjoint(run, bar).mechanism])[0]


def pendulum(**other: Any) -> ffr.Mechanism:
    joints = [ffr.Revolute(("arm", "pin"), ffr.Ground()), *other.pop("joints", [])]
    return ffr.Mechanism({"arm": ffr.Placement((0.3, 0.0))}, joints, **other)


def driven(p: float) -> ffr.Mechanism:
    motion = ffr.Motion.smooth_step(1.0, p)
    return pendulum(joints=[ffr.PrescribedAngle(("arm", "pin"), motion)])


def spring(stiffness: float, damping: float = 0.0) -> ffr.SpringDamper:
    return ffr.SpringDamper(END, ffr.Ground((0.1, -0.4)), stiffness, damping, length=0.3)


def test_many_parameters_take_few_calls() -> None:
    """Values of a drive, in groups; what depends on several, and on the start, is found alone."""
    calls, times = [0], np.linspace(0.0, 0.3, 32)

    def build(near: float, far: float, height: float, **detours: float) -> ffr.Mechanism:
        calls[0] += 1
        angles = 30.0 * times**2 + np.array([0.0, *detours.values(), 0.0])
        joints = [
            ffr.Revolute(("arm", "pin"), ffr.Ground((0.0, height))),
            ffr.PrescribedAngle(("arm", "pin"), ffr.Motion.spline(times, angles), name="motor"),
        ]
        forces = [ffr.SpringDamper(END, ffr.Ground((0.9, far - near)), 200.0)]
        return ffr.Mechanism({"arm": ffr.Placement((0.3, 0.0))}, joints, forces=forces)

    settings = {f"d{k}": (0.0, -0.1, 0.1) for k in range(30)}
    joint = {"near": (0.1, 0.0, 0.2), "far": (0.6, 0.5, 0.8), "height": (0.0, -0.1, 0.1)}
    mechanism = ffr.Parameters(**joint, **settings).mechanism(build)
    run = ffr.simulate(mechanism, bodies(), ALPHA)
    bar, rng = TrajectoryBar.zeros(run), np.random.default_rng(0)
    bar.multipliers[:] = rng.uniform(-1.0, 1.0, bar.multipliers.shape)
    before, bars = calls[0], adjoint(run, bar).mechanism
    slopes = parameter_slopes(run, [bars])[0]
    assert calls[0] - before < 30  # of 66

    def number(shift: np.ndarray) -> float:
        t = ffr.simulate(mechanism.shifted(shift), bodies(), ALPHA)
        return float(np.sum(bar.multipliers * t.multipliers))

    for along in (*np.eye(33)[[0, 1, 2, 3, 17]], rng.uniform(-1.0, 1.0, 33)):
        near, far = (number(1e-4 * s * along) - number(-1e-4 * s * along) for s in (1.0, 2.0))
        assert slopes @ along == pytest.approx((8.0 * near - far) / 12e-4, rel=1e-7)


AT = 0.05
SINE = ffr.Motion.fourier(1.0, sines=[1.0])
NO = "parameter 'p': no derivative: "
REFUSED = {
    NO + "the times of jumps depend on it": driven,
    NO + "parameters: the forces of a mechanism must not": lambda p: pendulum(
        forces=[spring(9.0)] * (1 + (p > AT))
    ),
    NO + "parameters: the number of point masses of a": lambda p: pendulum(
        point_masses=[ffr.PointMass(END, 0.1)] * (1 + (p > AT))
    ),
    NO + "parameters: no mechanism with p = ": lambda p: pendulum(
        forces=[spring(9.0 if p <= AT else np.nan)]
    ),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_has_no_derivative_is_refused(message: str) -> None:
    with pytest.raises(ValueError, match=message):
        weighed(REFUSED[message], p=(AT, 0.01, 0.08))


def test_signals_may_be_of_another_kind_at_other_values() -> None:
    def pushed(p: float, q: float, *, plain: bool) -> ffr.Mechanism:
        push = p if plain or p == AT else lambda t: np.full(t.size, p)
        turn = ffr.Motion.fourier(1.0, sines=[p]) if plain or p == AT else SINE * p
        angle = ffr.PrescribedAngle(("arm", "pin"), turn)
        return pendulum(joints=[angle], forces=[ffr.Force(END, push, q)])

    settings = {"p": (AT, 0.01, 0.08), "q": (1.0, 0.0, 2.0)}
    slopes, plain = (
        weighed(lambda p, q, s=s: pushed(p, q, plain=s), **settings) for s in (False, True)
    )
    np.testing.assert_allclose(slopes, plain, rtol=1e-9, atol=1e-12)


def test_slope_at_a_bound_is_one_sided() -> None:
    def damped(d: float) -> ffr.Mechanism:
        return pendulum(forces=[spring(9.0, d)], gravity=(0.0, -9.81))

    inside, at_bound = (weighed(damped, d=(0.5, low, 2.0)) for low in (0.0, 0.5))
    np.testing.assert_allclose(at_bound, inside, rtol=1e-9)


@pytest.mark.parametrize("value", [(np.nan, 0.0, 1.0), (2.0, 0.0, 1.0), (1.0, 1.0, 1.0)])
def test_bounds_of_parameters(value: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="parameter 'p'"):
        ffr.Parameters(p=value)
    with pytest.raises(TypeError, match="what the function returns must be a Mechanism"):
        ffr.Parameters(p=(0.5, 0.0, 1.0)).mechanism(lambda p: p)


def test_parameters_of_no_influence_are_named() -> None:
    def build(used: float, idle: float, spin: float) -> ffr.Mechanism:
        placed = {"arm": ffr.Placement((0.3, 0.0), angular_velocity=spin)}
        return ffr.Mechanism(placed, gravity=(0.0, -used))

    settings = {name: (0.5, 0.0, 1.0) for name in ("used", "idle", "spin")}
    mechanism = ffr.Parameters(**settings).mechanism(build)
    model = ffr.simulate(mechanism, bodies(), ffr.GeneralizedAlpha(0.1, 2)).model
    assert influence(model) == ["idle"]


def coordinate(build: Callable[..., Any], place: tuple[int, int], steps: Any, **given: Any) -> Any:
    """A coordinate at an instant, its velocity, and its slopes by the parameters."""
    run = ffr.simulate(ffr.Parameters(**given).mechanism(build), {}, steps)
    bar = TrajectoryBar.zeros(run)
    bar.y[place] = 1.0
    return run.y[place], run.v[place], parameter_slopes(run, [adjoint(run, bar).mechanism])[0]


def point(mass: float, place: Any, **other: Any) -> Any:
    """A body whose mass is at its only marker, and a mechanism with it."""
    markers, inertia = {"at": (0.0, 0.0), **other.pop("to", {})}, other.pop("inertia", 1e-12)
    body = ffr.VolumeIntegrals.rigid(mass, (0.0, 0.0), inertia, markers)
    return ffr.Mechanism({"mass": place}, **other), {"mass": body}


def test_spring_and_mass_by_stiffness_damping_and_mass() -> None:
    """Its free vibration, whose derivatives are taken by complex steps."""
    values, end = np.array([40.0, 1.5, 0.8]), 0.6

    def swinging(k: float, d: float, m: float) -> Any:
        spring = ffr.SpringDamper(("mass", "at"), ffr.Ground(), k, d, length=0.0)
        guide = ffr.Translational(("mass", "at"), ffr.Ground())
        return point(m, ffr.Placement((0.2, 0.0)), joints=[guide], forces=[spring])

    def closed(k: complex, d: complex, m: complex) -> complex:
        decay = 0.5 * d / m
        omega = np.sqrt(k / m - decay**2)
        return (
            0.2 * np.exp(-decay * end) * (np.cos(omega * end) + decay / omega * np.sin(omega * end))
        )

    settings = {n: (v, 0.5 * v, 2.0 * v) for n, v in zip("kdm", values, strict=True)}
    at, _, slopes = coordinate(swinging, (-1, 0), ffr.RadauIIA(end, steps=60), **settings)
    assert at == pytest.approx(closed(*values).real, rel=1e-9)
    for slope, step in zip(slopes, 1e-30j * np.eye(3), strict=True):
        assert slope == pytest.approx(closed(*(values + step)).imag / 1e-30, rel=1e-8)


def test_functions_without_a_derivative_are_refused() -> None:
    """Random machines, and kinks and jumps at the values; beside them slopes are exact."""
    draw = np.random.default_rng(0)

    def gravity(of: Callable[[float], float]) -> Callable[[float], Any]:
        return lambda p: point(2.0, ffr.Placement(), gravity=(0.0, of(p)))

    place = (-1, 1)
    steps = ffr.GeneralizedAlpha(0.5, 4)
    drawn = {
        "gravity": gravity(lambda p: p + 1e-6 * draw.random()),
        "place": lambda p: point(2.0, ffr.Placement((draw.random(), 0.0)), gravity=(0.0, p)),
        "mass": lambda p: point(2.0 + draw.random(), ffr.Placement(), gravity=(0.0, p)),
    }
    for build in drawn.values():
        with pytest.raises(ValueError, match="returns different mechanisms for the same values"):
            coordinate(build, place, steps, p=(0.5, 0.0, 1.0))
    branches: list[Callable[[float], float]] = [
        lambda p: 3.0 * p if p > 0.5 else p,  # a jump
        lambda p: 2.0 * p if p > 0.5 else 1.5 - p,  # a kink
        lambda p: max(p, 0.5),
        lambda p: float(np.ceil(2.0 * p)),
    ]
    for number in branches:
        with pytest.raises(ValueError, match=r"parameter 'p': no derivative: slopes .* from below"):
            coordinate(gravity(number), place, steps, p=(0.5, 0.0, 1.0))
    for value, slope in ((0.5001, 2.0), (0.4999, -1.0)):
        slopes = coordinate(gravity(branches[1]), place, steps, p=(value, 0.0, 1.0))[2]
        assert slopes[0] == pytest.approx(0.5 * 0.5**2 * slope, rel=1e-6)
    # a slope that vanishes, and one that bends strongly, are no kinks
    for number in (lambda p: (p - 0.5) ** 2, lambda p: np.exp(200.0 * (p - 0.5))):
        coordinate(gravity(number), place, steps, p=(0.5, 0.0, 1.0))
