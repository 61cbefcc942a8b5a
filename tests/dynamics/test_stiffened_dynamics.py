# SPDX-License-Identifier: MIT
"""Geometric stiffening in the dynamics: rotating beams, choice of the frame, warnings, files."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from numpy.typing import NDArray
from shared.beams import beam
from shared.scenes import robot, stiffened

from dolfinx_ffr.body import QUARTER_TURN, BodyMarker, VolumeIntegrals
from dolfinx_ffr.dynamics import GeneralizedAlpha, SofteningWarning, Trajectory, simulate
from dolfinx_ffr.mechanism import Mechanism, Placement
from dolfinx_ffr.mechanism.initial_conditions import Assembled, StaticEquilibrium
from dolfinx_ffr.mechanism.joints import PrescribedAngle, Revolute, Weld
from dolfinx_ffr.mechanism.marker import Ground
from dolfinx_ffr.mechanism.motion import Motion
from dolfinx_ffr.verification import convergence_order

Array = NDArray[np.float64]

#: Beam of ANSYS VM258 (Simo and Vu-Quoc), turning about its left end.
LENGTH, BENDING, LINE_MASS = 10.0, 1.4e4, 1.2
HEIGHT = math.sqrt(12.0 * BENDING / 2.8e7)


def blade(stiffening: bool = True, modes: int = 3) -> VolumeIntegrals:
    return beam(
        LENGTH, HEIGHT, 1.0, 2.8e7 / HEIGHT, LINE_MASS / HEIGHT, 10, modes, "tangent", stiffening
    )


def turning(drive: Motion, speed: float = 0.0, **options: object) -> Mechanism:
    return Mechanism(
        {"beam": Placement((0.5 * LENGTH, 0.0), 0.0, (0.0, 0.5 * LENGTH * speed), speed)},
        [
            Revolute(("beam", "left"), Ground(), name="hub"),
            PrescribedAngle(("beam", "left"), drive, name="drive"),
        ],
        **options,  # type: ignore[arg-type]
    )


def stiffness_at(body: VolumeIntegrals, speed: float) -> Array:
    """Stiffness of the beam that turns about its left end; its frame sits in the middle."""
    hub = -0.5 * LENGTH * body.stiffening["acceleration"][0]
    return body.K + speed**2 * (body.stiffening["omega2"] + hub - body.G[1:, 1:])


@pytest.mark.parametrize(("ratio", "flap"), [(1.0, 3.6817), (2.0, 4.1373), (3.0, 4.7973)])
def test_frequency_of_a_rotating_beam(ratio: float, flap: float) -> None:
    """Wright, Smith, Thresher, Wang, J. Appl. Mech. 49 (1982), doi:10.1115/1.3161966.

    In the plane of rotation the squared frequency is less by that of the rotation.
    """
    unit = math.sqrt(BENDING / (LINE_MASS * LENGTH**4))
    speed, body = ratio * unit, blade()
    squares, shapes = scipy.linalg.eigh(stiffness_at(body, speed), body.G[1:, 1:])
    omega = math.sqrt(squares[0])
    assert omega / unit == pytest.approx(math.sqrt(flap**2 - ratio**2), rel=1e-3)
    q0, steps, errors = 1e-3 * shapes[:, 0], np.array([400, 800, 1600]), []
    mechanism = turning(
        Motion.polynomial([0.0, speed]), speed, start=Assembled(elastic={"beam": q0})
    )
    for count in steps:
        integrator = GeneralizedAlpha(4.0 * math.pi / omega, int(count))
        t = simulate(mechanism, {"beam": body}, integrator)
        swing = t.elastic("beam") @ body.G[1:, 1:] @ shapes[:, 0]
        errors.append(float(np.max(np.abs(swing - 1e-3 * np.cos(omega * t.t))) / 1e-3))
    assert errors[-1] < 1e-2
    assert convergence_order(1.0 / steps, errors) == pytest.approx(2.0, abs=0.1)


def spin_up() -> Motion:
    rate = 2.0 * np.pi / 15.0
    return Motion(
        lambda t: np.where(
            t < 15.0, 0.4 * (0.5 * t**2 + (np.cos(rate * t) - 1.0) / rate**2), 6.0 * t - 45.0
        ),
        lambda t: np.where(t < 15.0, 0.4 * (t - np.sin(rate * t) / rate), 6.0),
        lambda t: np.where(t < 15.0, 0.4 * (1.0 - np.cos(rate * t)), 0.0),
        "spin-up",
    )


def lag(t: Trajectory) -> Array:
    """Deflection of the tip in the axes of the hub."""
    return t.elastic("beam") @ t.model.bodies["beam"].markers["right"].displacement[1]


def test_spin_up_stays_bounded_and_the_lag_vanishes() -> None:
    # The first frequency at rest, 3.798 rad/s, is passed at about ten seconds.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        t = simulate(turning(spin_up()), {"beam": blade()}, GeneralizedAlpha(20.0, 4000))
    tip = lag(t)
    # Simo and Vu-Quoc's figure shows a lag of a bit less than 0.6 m at about 7 s.
    assert 0.5 < np.max(-tip) < 0.6
    assert 6.0 < t.t[np.argmax(-tip)] < 7.5
    assert np.max(np.abs(tip[t.t > 15.0])) < 0.02 * np.max(np.abs(tip))
    with pytest.warns(SofteningWarning, match="faster than its lowest frequency of 3.798"):
        loose = simulate(turning(spin_up()), {"beam": blade(False)}, GeneralizedAlpha(12.0, 2400))
    assert np.max(np.abs(lag(loose))) > 100.0


def test_column_softens_under_its_own_weight() -> None:
    """A standing column buckles where w L^3 / (E I) = 7.8373 (Greenhill)."""
    body = blade(modes=6)
    critical = 7.8373 * BENDING / (LINE_MASS * LENGTH**3)

    def column(g: float) -> Mechanism:
        # the body's x axis points along y: gravity along -x of the body
        return Mechanism(
            {"beam": Placement((0.0, 0.5 * LENGTH), 0.5 * math.pi)},
            [Weld(("beam", "left"), Ground(), angle=0.5 * math.pi)],
            gravity=(1e-3, -g),
            start=StaticEquilibrium(),
        )

    def sideways(g: float) -> float:
        t = simulate(column(g), {"beam": body}, GeneralizedAlpha(0.1, 2))
        return float(abs(lag(t)[0]))

    # The deflection grows like 1 / (1 - g / critical) to good accuracy.
    assert sideways(0.5 * critical) == pytest.approx(2.0 * sideways(0.0), rel=0.02)
    assert sideways(0.9 * critical) == pytest.approx(10.0 * sideways(0.0), rel=0.05)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sideways(0.99 * critical)
    falling = replace(column(1.01 * critical), start=Assembled())
    with pytest.warns(SofteningWarning, match=r"body 'beam' loses its stiffness at t = 0 s"):
        simulate(falling, {"beam": body}, GeneralizedAlpha(0.1, 2))


def moved_frame(body: VolumeIntegrals, c: Array) -> VolumeIntegrals:
    """The same body in a frame whose origin lies at -c of the old one."""
    S, G, N = body.S.copy(), body.G.copy(), body.N.copy()
    jc = QUARTER_TURN @ c
    G[0, 0] += 2.0 * c @ body.S[0] + body.mass * c @ c
    G[0, 1:] += body.S[1:] @ c
    G[1:, 0] = G[0, 1:]
    N[0, 1:] += body.S[1:] @ jc
    N[1:, 0] = -N[0, 1:]
    S[0] += body.mass * c
    spun, swung, pulled, lifted = body.stacked_stiffening
    stiffening = {
        "omega2": spun - c[0] * pulled - c[1] * lifted,
        "alpha": swung - c[1] * pulled + c[0] * lifted,
        "acceleration": np.stack([pulled, lifted]),
    }
    markers = {
        name: BodyMarker(m.position + c, m.displacement, m.rotation)
        for name, m in body.markers.items()
    }
    return VolumeIntegrals(body.mass, S, G, N, body.K, markers, stiffening)


def test_motion_does_not_depend_on_the_origin_of_the_frame() -> None:
    scene, c = stiffened(), np.array([0.15, -0.07])
    weak = {name: replace(body, stiffening={}) for name, body in scene.bodies.items()}
    parts = {load: 0.2 * array for load, array in scene.bodies["arm"].stiffening.items()}
    scene = replace(scene, bodies={**weak, "arm": replace(weak["arm"], stiffening=parts)})
    q = 5e-6 / np.arange(1.0, 6.0)
    start = Assembled({"arm": q}, {"arm": -20.0 * q})
    placement = scene.mechanism.placements["arm"]
    turn = np.array(
        [
            [math.cos(placement.angle), -math.sin(placement.angle)],
            [math.sin(placement.angle), math.cos(placement.angle)],
        ]
    )
    position = tuple(np.array(placement.position) - turn @ c)
    placements = {**scene.mechanism.placements, "arm": replace(placement, position=position)}
    mechanism = replace(scene.mechanism, start=start)
    other = replace(mechanism, placements=placements)
    bodies = {**scene.bodies, "arm": moved_frame(scene.bodies["arm"], c)}
    integrator = GeneralizedAlpha(0.02, 20)
    first = simulate(mechanism, scene.bodies, integrator)
    second = simulate(other, bodies, integrator)
    position = first.model.coordinates("arm").position
    same = np.delete(np.arange(first.model.size), position)
    scale = np.max(np.abs(first.w[0]))
    np.testing.assert_allclose(second.y[0, same], first.y[0, same], atol=1e-13)
    np.testing.assert_allclose(second.w[0, same], first.w[0, same], rtol=1e-9, atol=1e-11 * scale)
    np.testing.assert_allclose(second.multipliers[0], first.multipliers[0], rtol=1e-9)
    np.testing.assert_allclose(
        first.marker_path("arm", "right"), second.marker_path("arm", "right"), atol=1e-4
    )
    # The geometric stiffness takes part in it.
    loose = {name: replace(body, stiffening={}) for name, body in scene.bodies.items()}
    third = simulate(mechanism, loose, integrator)
    assert np.max(np.abs(third.w[0] - first.w[0])) > 1e-6 * scale


def test_no_geometric_stiffness_is_zero_geometric_stiffness() -> None:
    scene = robot(steps=20, end_time=0.05)
    zero = {
        name: replace(body, stiffening={"omega2": np.zeros((body.modes, body.modes))})
        for name, body in scene.bodies.items()
    }
    first = simulate(scene.mechanism, scene.bodies, scene.integrator)
    second = simulate(scene.mechanism, zero, scene.integrator)
    np.testing.assert_allclose(second.y, first.y, rtol=1e-12, atol=1e-15)


def test_file_keeps_the_geometric_stiffness(tmp_path: Path) -> None:
    body = blade()
    body.save(tmp_path / "blade.npz")
    loaded = VolumeIntegrals.load(tmp_path / "blade.npz")
    assert loaded.stiffening.keys() == body.stiffening.keys()
    for load, array in body.stiffening.items():
        np.testing.assert_array_equal(loaded.stiffening[load], array)


def test_sums_and_products_include_the_geometric_stiffness() -> None:
    body, loose = blade(), blade(False)
    part = sum(float(np.sum(array**2)) for array in body.stiffening.values())
    assert body.dot(body) == pytest.approx(loose.dot(loose) + part, rel=1e-14)
    assert body.dot(loose) == loose.dot(loose)
    double = body + body.scaled(1.0)
    for load, array in (body + loose).stiffening.items():
        np.testing.assert_array_equal(array, body.stiffening[load])
        np.testing.assert_array_equal(double.stiffening[load], 2.0 * array)


@pytest.mark.parametrize(
    ("stiffening", "message"),
    [
        ({"wind": np.eye(3)}, "stiffening by 'wind', but the loads are"),
        ({"omega2": np.eye(2)}, r"stiffening by 'omega2' must have shape \(3, 3\)"),
        (
            {"acceleration": np.zeros((3, 3))},
            r"stiffening by 'acceleration' must have shape \(2, 3, 3\)",
        ),
        ({"alpha": np.full((3, 3), np.nan)}, "stiffening by 'alpha' holds NaN"),
        ({"alpha": np.triu(np.ones((3, 3)))}, "stiffening by 'alpha' must be symmetric"),
    ],
)
def test_refused(stiffening: dict[str, Array], message: str) -> None:
    with pytest.raises(ValueError, match=f"body 'beam': {message}"):
        replace(blade(), stiffening=stiffening).validate("beam")
