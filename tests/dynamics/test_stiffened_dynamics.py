# SPDX-License-Identifier: MIT
"""Geometric stiffening in the dynamics: a beam that is spun up, a column, warnings."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.beams import beam

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Trajectory

Array = NDArray[np.float64]

#: Beam of ANSYS VM258 (Simo and Vu-Quoc), turning about its left end.
LENGTH, BENDING, LINE_MASS = 10.0, 1.4e4, 1.2
HEIGHT = math.sqrt(12.0 * BENDING / 2.8e7)


def blade(stiffening: bool = True, modes: int = 3) -> ffr.VolumeIntegrals:
    return beam(
        LENGTH, HEIGHT, 1.0, 2.8e7 / HEIGHT, LINE_MASS / HEIGHT, 10, modes, "tangent", stiffening
    )


def turning(drive: ffr.Motion) -> ffr.Mechanism:
    hub = ffr.Revolute(("beam", "left"), ffr.Ground(), name="hub")
    motor = ffr.PrescribedAngle(("beam", "left"), drive, name="drive")
    return ffr.Mechanism({"beam": ffr.Placement((0.5 * LENGTH, 0.0))}, [hub, motor])


def spin_up() -> ffr.Motion:
    rate = 2.0 * np.pi / 15.0
    return ffr.Motion(
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
    """ANSYS VM258: without geometric stiffening it must be called unstable, and from when."""
    drive = spin_up()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        t = ffr.simulate(turning(drive), {"beam": blade()}, ffr.GeneralizedAlpha(20.0, 4000))
    tip = lag(t)
    # Simo and Vu-Quoc's figure shows a lag of a bit less than 0.6 m at about 7 s.
    assert 0.5 < np.max(-tip) < 0.6
    assert 6.0 < t.t[np.argmax(-tip)] < 7.5
    assert np.max(np.abs(tip[t.t > 15.0])) < 0.02 * np.max(np.abs(tip))
    frequency = 1.87510406871196**2 * math.sqrt(BENDING / LINE_MASS) / LENGTH**2
    assert frequency == pytest.approx(3.798, abs=5e-4)
    times = np.linspace(0.0, 12.0, 2401)
    crossing = times[np.argmax(drive.velocity(times) > frequency)]
    message = rf"body 'beam' turns with 3\.\d+ rad/s at t = {crossing:.4g} s, faster .* of 3\.798"
    with pytest.warns(ffr.SofteningWarning, match=message):
        loose = ffr.simulate(
            turning(drive), {"beam": blade(False)}, ffr.GeneralizedAlpha(12.0, 2400)
        )
    assert np.max(np.abs(lag(loose))) > 100.0
    with warnings.catch_warnings():
        # So close to that speed it bends by more than linear theory describes.
        warnings.simplefilter("error", ffr.SofteningWarning)
        warnings.simplefilter("ignore", ffr.LargeDeformationWarning)
        before = ffr.GeneralizedAlpha(float(crossing) - 0.1, 1200)
        ffr.simulate(turning(drive), {"beam": blade(False)}, before)


def test_column_softens_under_its_own_weight() -> None:
    """A standing column buckles where w L^3 / (E I) = 7.8373 (Greenhill)."""
    body = blade(modes=6)
    critical = 7.8373 * BENDING / (LINE_MASS * LENGTH**3)

    def column(g: float) -> ffr.Mechanism:
        # the body's x axis points along y: gravity along -x of the body
        return ffr.Mechanism(
            {"beam": ffr.Placement((0.0, 0.5 * LENGTH), 0.5 * math.pi)},
            [ffr.Weld(("beam", "left"), ffr.Ground(), angle=0.5 * math.pi)],
            gravity=(1e-3, -g),
            start=ffr.StaticEquilibrium(),
        )

    def sideways(g: float) -> float:
        t = ffr.simulate(column(g), {"beam": body}, ffr.GeneralizedAlpha(0.1, 2))
        return float(abs(lag(t)[0]))

    # The deflection grows like 1 / (1 - g / critical) to good accuracy.
    assert sideways(0.5 * critical) == pytest.approx(2.0 * sideways(0.0), rel=0.02)
    assert sideways(0.9 * critical) == pytest.approx(10.0 * sideways(0.0), rel=0.05)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sideways(0.99 * critical)
    falling = replace(column(1.01 * critical), start=ffr.Assembled())
    with pytest.warns(ffr.SofteningWarning, match=r"body 'beam' loses its stiffness at t = 0 s"):
        ffr.simulate(falling, {"beam": body}, ffr.GeneralizedAlpha(0.1, 2))
