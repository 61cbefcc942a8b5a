# SPDX-License-Identifier: MIT
"""Geometric stiffening by forces at markers: struts, foreshortening, energy, files."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.scenes import Bodies
from shared.spatial_bodies import flat_cloud

import dolfinx_ffr as ffr
from dolfinx_ffr.verification import convergence_order

Array = NDArray[np.float64]

LENGTH, BENDING, LINE_MASS = 2.0, 50.0, 1.5
EULER = math.pi**2 * BENDING / LENGTH**2


def sine_beam(waves: int = 2, *, tip_mass: float = 0.0) -> ffr.VolumeIntegrals:
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
        "left": ffr.BodyMarker([0.0, 0.0], np.zeros((2, waves)), j * math.pi / LENGTH),
        "right": ffr.BodyMarker(
            [LENGTH, 0.0],
            np.zeros((2, waves)),
            (-1.0) ** j * j * math.pi / LENGTH,
            np.stack([slope, np.zeros_like(slope)]),
        ),
    }
    return ffr.VolumeIntegrals(
        mass=mass,
        S=np.vstack([[0.5 * mass * LENGTH, 0.0], np.column_stack([0.0 * area, area])]),
        G=G,
        N=N,
        K=np.diag(0.5 * BENDING * (j * math.pi) ** 4 / LENGTH**3),
        markers=ends,
    )


def strut(force: float, deflection: float) -> ffr.Mechanism:
    """The pinned beam on a fixed and a sliding bearing, under an axial force on the latter."""
    return ffr.Mechanism(
        {"beam": ffr.Placement()},
        [
            ffr.Revolute(("beam", "left"), ffr.Ground(), name="bearing"),
            ffr.PointOnLine(("beam", "right"), ffr.Ground(), name="slider"),
        ],
        forces=[ffr.Force(("beam", "right"), force, 0.0)],
        start=ffr.Assembled(elastic={"beam": [deflection, 0.0]}),
    )


@pytest.mark.parametrize("share", [-1.1, -0.9, -0.5, 0.0, 2.0])
def test_frequency_of_a_strut(share: float) -> None:
    """Its square falls like 1 - N / N_E under compression N; beyond Euler's load N_E it buckles."""
    omega = math.pi**2 * math.sqrt(BENDING / LINE_MASS * abs(1.0 + share)) / LENGTH**2
    size, end, form = (1e-6, 2.0 * math.pi, np.cos) if share > -1.0 else (1e-8, 2.0, np.cosh)
    mechanism = strut(share * EULER, size)
    t = ffr.simulate(mechanism, {"beam": sine_beam()}, ffr.RadauIIA(end / omega, steps=60))
    computed, exact = t.elastic("beam")[:, 0], size * form(omega * t.t)
    if share > -1.0:
        np.testing.assert_allclose(computed, exact, atol=1e-11)
    else:
        np.testing.assert_allclose(computed, exact, rtol=1e-7)


def test_the_ends_of_a_bent_beam_come_nearer() -> None:
    body, q = sine_beam(), np.array([[0.1, 0.0], [0.05, -0.02]])
    x, weights = np.polynomial.legendre.leggauss(20)
    phase = 0.5 * math.pi * (x + 1.0)
    slope = sum(q[:, j, None] * (j + 1) * np.cos((j + 1) * phase) for j in range(2))
    shortened = 0.25 * LENGTH * (math.pi / LENGTH * slope) ** 2 @ weights
    shift = body.markers["right"].shift(q)
    np.testing.assert_allclose(shift[:, 0], -shortened, rtol=1e-9)
    np.testing.assert_array_equal(shift[:, 1], 0.0)
    t = ffr.simulate(strut(0.0, 0.1), {"beam": body}, ffr.GeneralizedAlpha(0.01, 2))
    assert t.marker_path("beam", "right")[0, 0] == pytest.approx(LENGTH - shortened[0])


def spinning(body: ffr.VolumeIntegrals, speed: float, mass: float, q: Array) -> ffr.Mechanism:
    hub, drive = ("beam", "left"), ffr.Motion.polynomial([0.0, speed])
    return ffr.Mechanism(
        {"beam": ffr.Placement(angular_velocity=speed)},
        [ffr.Revolute(hub, ffr.Ground(), name="hub"), ffr.PrescribedAngle(hub, drive)],
        start=ffr.Assembled(elastic={"beam": q}),
        point_masses=[ffr.PointMass(("beam", "right"), mass)] if mass else [],
    )


def cantilever(mass: float = 1e-6) -> ffr.VolumeIntegrals:
    """A light cantilever, by its deflection under a force at the tip."""
    x, weights = np.polynomial.legendre.leggauss(8)
    x, weights = 0.5 * LENGTH * (x + 1.0), 0.5 * LENGTH * weights
    shape = 0.5 * (3.0 * (x / LENGTH) ** 2 - (x / LENGTH) ** 3)
    slope = 0.5 * (6.0 * x / LENGTH**2 - 3.0 * x**2 / LENGTH**3)
    W = np.array([[x, 0.0 * x], [0.0 * x, shape]])
    rho = mass / LENGTH * weights
    bend = [[[float(weights @ slope**2)]], [[0.0]]]
    return ffr.VolumeIntegrals.from_arrays(
        mass,
        np.einsum("p,akp->ak", rho, W),
        P=np.einsum("p,akp,blp->abkl", rho, W, W),
        K=[[3.0 * BENDING / LENGTH**3]],
        markers={
            "left": ffr.BodyMarker([0.0, 0.0], [[0.0], [0.0]], [0.0]),
            "right": ffr.BodyMarker([LENGTH, 0.0], [[0.0], [1.0]], [1.5 / LENGTH], bend),
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
        t = ffr.simulate(
            spinning(body, speed, mass, np.array([1e-5])),
            {"beam": body},
            ffr.RadauIIA(2.0 * math.pi / omega, steps=80),
        )
    swing = t.elastic("beam")[:, 0]
    np.testing.assert_allclose(swing, 1e-5 * np.cos(omega * t.t), atol=3e-10)


def rigid_tip(body: ffr.VolumeIntegrals, mass: float, speed: float) -> tuple[ffr.Mechanism, Bodies]:
    """The same with a small rigid body pinned to the tip instead of a point mass."""
    mechanism = spinning(body, speed, 0.0, np.array([1e-5]))
    tip = ffr.VolumeIntegrals.rigid(mass, markers={"pin": (0.0, 0.0)}, inertia=1e-3)
    place = ffr.Placement((LENGTH, 0.0), 0.0, (0.0, LENGTH * speed), speed)
    return replace(
        mechanism,
        placements={**mechanism.placements, "tip": place},
        joints=[*mechanism.joints, ffr.Revolute(("tip", "pin"), ("beam", "right"), name="pin")],
    ), {"beam": body, "tip": tip}


def test_a_force_at_the_tip_takes_a_warning_back() -> None:
    body = cantilever(0.5)
    speed = 1.1 * math.sqrt(body.K[0, 0] / body.G[1, 1])
    integrator = ffr.RadauIIA(0.2, steps=40)
    loose = replace(body, markers={n: replace(m, stiffening=None) for n, m in body.markers.items()})
    with pytest.warns(ffr.SofteningWarning, match="faster than its lowest frequency"):
        ffr.simulate(*rigid_tip(loose, 0.7, speed), integrator)
    with pytest.warns(ffr.SofteningWarning, match="faster than its lowest frequency"):
        ffr.simulate(spinning(body, speed, 0.0, np.zeros(1)), {"beam": body}, integrator)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ffr.simulate(*rigid_tip(body, 0.7, speed), integrator)
        ffr.simulate(spinning(body, speed, 0.7, np.zeros(1)), {"beam": body}, integrator)


@pytest.mark.parametrize("radau", [False, True])
def test_energy_is_conserved(radau: bool) -> None:
    """Large deflections, an axial spring, a spring across, a constant force; no gravity."""
    body, stiffness, end = sine_beam(), 3e3, ("beam", "right")
    ahead, aside = ffr.Ground((1.2 * LENGTH, 0.0)), ffr.Ground((LENGTH, 0.1))
    mechanism = ffr.Mechanism(
        {"beam": ffr.Placement()},
        [ffr.Revolute(("beam", "left"), ffr.Ground(), name="bearing")],
        forces=[
            ffr.SpringDamper(end, ahead, stiffness, length=0.1),
            ffr.SpringDamper(end, aside, 0.1 * stiffness, length=0.0),
            ffr.Force(end, 20.0, -10.0),
        ],
        start=ffr.Assembled(elastic={"beam": [0.12, -0.02]}),
    )
    steps, errors = np.array([200, 400, 800] if radau else [1000, 2000, 4000]), []
    for count in steps:
        integrator = (
            ffr.RadauIIA(0.5, steps=count) if radau else ffr.GeneralizedAlpha(0.5, int(count), 1.0)
        )
        t = ffr.simulate(mechanism, {"beam": body}, integrator)
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


def test_point_masses_pass_their_stiffness_back() -> None:
    body, other, bar = (flat_cloud(3, seed) for seed in range(3))

    def loaded(part: ffr.VolumeIntegrals) -> ffr.VolumeIntegrals:
        return part.with_point_mass("tip", 0.3).with_point_mass("root", 0.2)

    back = body.point_mass_pullback(bar, "root", 0.2)
    back = body.point_mass_pullback(back, "tip", 0.3)
    direction = other + body.scaled(-1.0)
    ahead, behind = (bar.dot(loaded(body + direction.scaled(h))) for h in (0.5, -0.5))
    assert back.dot(direction) == pytest.approx(ahead - behind, rel=1e-9)


def test_files_sums_and_fewer_modes_keep_the_geometric_stiffness(tmp_path: Path) -> None:
    """That of the body, and that of a marker."""
    body = flat_cloud(3)
    tip, root = body.markers["tip"], replace(body.markers["root"], stiffening=None)
    body = replace(body, markers={"tip": tip, "root": root})
    loose = replace(
        body, markers={"tip": replace(tip, stiffening=None), "root": root}, stiffening={}
    )
    body.save(tmp_path / "body.npz")
    loaded = ffr.VolumeIntegrals.load(tmp_path / "body.npz")
    assert loaded.markers["root"].stiffening is None
    for total, factor in ((loaded, 1.0), (body + loose, 1.0), (body + body.scaled(1.0), 2.0)):
        assert total.stiffening.keys() == body.stiffening.keys()
        for load, array in total.stiffening.items():
            np.testing.assert_array_equal(array, factor * body.stiffening[load])
        np.testing.assert_array_equal(total.markers["tip"].stiffening, factor * tip.stiffening)
    own = [*body.stiffening.values(), tip.stiffening]
    part = sum(float(np.sum(array**2)) for array in own)
    assert body.dot(body) == pytest.approx(loose.dot(loose) + part, rel=1e-14)
    assert body.dot(loose) == loose.dot(loose)
    fewer = body.leading(2).markers["tip"].stiffening
    np.testing.assert_array_equal(fewer, tip.stiffening[:, :2, :2])
    arrays = dict(np.load(tmp_path / "body.npz"))
    arrays["marker_stiffening"] = arrays["marker_stiffening"][:1]
    np.savez(tmp_path / "short.npz", **arrays)
    with pytest.raises(ValueError, match="marker_stiffening must have shape"):
        ffr.VolumeIntegrals.load(tmp_path / "short.npz")


@pytest.mark.parametrize(
    ("stiffening", "message"),
    [
        ({"wind": np.eye(3)}, ": stiffening by 'wind' is not supported"),
        ({"omega2": np.eye(2)}, r": stiffening by 'omega2' must have shape \(3, 3\)"),
        ({"acceleration": np.zeros((3, 3))}, r".* 'acceleration' must have shape \(2, 3, 3\)"),
        ({"alpha": np.full((3, 3), np.nan)}, ": stiffening by 'alpha' holds NaN"),
        ({"alpha": np.triu(np.ones((3, 3)))}, ": stiffening by 'alpha' must be symmetric"),
        (np.eye(3), r", marker 'tip': stiffening must have shape \(2, 3, 3\)"),
        (np.full((2, 3, 3), np.nan), ", marker 'tip': stiffening holds NaN"),
        (np.triu(np.ones((2, 3, 3))), ", marker 'tip': stiffening must be symmetric"),
    ],
)
def test_refused(stiffening: Array | dict[str, Array], message: str) -> None:
    body = flat_cloud(3)
    if isinstance(stiffening, dict):
        body = replace(body, stiffening=stiffening)
    else:
        body.markers["tip"] = replace(body.markers["tip"], stiffening=stiffening)
    with pytest.raises(ValueError, match=f"body 'strut'{message}"):
        body.validate("strut")
