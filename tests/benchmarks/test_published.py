# SPDX-License-Identifier: MIT
"""Machines of others are set up right: forces and accelerations at their starts, which are told."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from arrays import moments
from published import ROD, START, START_VELOCITY, beam, meshed_rod, squeezer_scene, turning

import dolfinx_ffr as ffr


def test_slider_crank_starts_as_published() -> None:
    """Accelerations of rod, slider and elastic coordinates."""
    start = ffr.Assembled({"rod": START}, {"rod": START_VELOCITY})
    motion = turning(beam(), ffr.RadauIIA(1e-4, steps=10), start)
    own, w = motion.model.coordinates("rod"), motion.w[0]
    assert w[own.rotation] == pytest.approx(-1.344541576008661e-03, rel=1e-6)
    published = [-6.833142732779555e-05, 0.0, -4.268463211410861, 2.098334687947376e-01]
    # terms of the size of the slider's 5,062 m/s^2 cancel in these: ten digits of them agree
    assert w[own.elastic] == pytest.approx(published, rel=0.0, abs=5e-7)
    slider = w[own.position][0] + w[own.elastic][3]  # the rod lies along x
    slider -= (ROD + START[3]) * motion.v[0][own.rotation] ** 2
    assert slider == pytest.approx(-5.062194923138079e03, rel=1e-9)


def test_squeezer_starts_as_published() -> None:
    mechanism, bodies = squeezer_scene()
    motion = ffr.simulate(mechanism, bodies, ffr.RadauIIA(1e-5, steps=2))
    first, second = (motion.w[0][motion.model.coordinates(f"K{k}").rotation] for k in (1, 2))
    expected = [14222.4439199541139, -10666.8329399655854]
    assert [first, second - first] == pytest.approx(expected, rel=1e-10)
    published = [98.5668703962410896, -6.12268834425566265]
    assert motion.joint_force("K3 E")[0] == pytest.approx(published, rel=1e-8)
    for name in ("K4", "K6"):
        assert motion.joint_force(f"{name} E")[0] == pytest.approx([0.0, 0.0], abs=1e-6)


def test_meshed_rod_bends_as_the_beam() -> None:
    """First frequency and deflection of a coarse mesh, 1 % off."""
    rows = meshed_rod(MPI.COMM_SELF, lambda _: None, meshes=[[30, 1]], steps=3000)["rows"]
    for what in ("frequency", "deflection", "rms"):
        assert rows[2][what] == pytest.approx(rows[0][what], rel=0.01)


def test_moments_in_the_plane_have_the_views_that_they_are_made_of() -> None:
    G, N = np.diag([2.0, 3.0]), np.array([[0.0, 1.0], [-1.0, 0.0]])
    P = 0.5 * moments(G, N)
    assert np.array_equal(np.einsum("abkk->ab", P), G)
    assert np.array_equal(P[..., 0, 1] - P[..., 1, 0], N)
