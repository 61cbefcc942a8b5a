# SPDX-License-Identifier: MIT
"""Exudyn moves our bodies from their files alone as we do."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from exudyn_motion import body_from, elastic_coordinates, hold
from numpy.typing import NDArray
from shared.rods import rod, solid

import dolfinx_ffr as ffr

exudyn = pytest.importorskip("exudyn", reason="PyPI has no Exudyn for this Python")

Array = NDArray[np.float64]
SPIN = (3.0, 8.0, 20.0)
DURATION = 0.1


def swing(path: Path, steps: int) -> Array:
    """Elastic coordinates of a file's body that turns about its first marker, (steps + 1, r)."""
    mbs, body_numbers = body_from(path, initialAngularVelocity=list(SPIN))
    hold(mbs, body_numbers, 0, [1, 1, 1])
    return elastic_coordinates(mbs, body_numbers, DURATION, steps)


def test_a_pendulum_moves_from_its_file(tmp_path: Path) -> None:
    soft = ffr.Isotropic(young=2e7, poisson=0.3, density=7850.0)
    body = solid(rod(MPI.COMM_SELF, (8, 1, 1), material=soft, modes=3)).integrals
    body.save(tmp_path / "rod.npz", format="exudyn")
    mechanism = ffr.Mechanism(
        {"rod": ffr.Placement((0.0, 0.0, 0.0), angular_velocity=SPIN)},
        [ffr.Spherical(("rod", "left"), ffr.Ground((0.0, 0.0, 0.0)))],
    )
    motion = ffr.simulate(mechanism, {"rod": body}, ffr.RadauIIA(DURATION, steps=400))
    ours = motion.elastic("rod")[:: motion.integrator.stages][::40]
    coarse, fine = (swing(tmp_path / "rod.npz", n)[:: n // 10] for n in (1000, 2000))
    theirs = (4.0 * fine - coarse) / 3.0
    np.testing.assert_allclose(theirs, ours, rtol=0.0, atol=1e-6 * np.abs(ours).max())
