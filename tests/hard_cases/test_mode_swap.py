# SPDX-License-Identifier: MIT
"""Modes that cross between two designs, through the whole chain from densities to psi."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from shared.meshes import prongs

import dolfinx_ffr as ffr

STEEL = ffr.PlaneStress(210e9, 0.3, 7850.0, 0.01)
SWING = ffr.Motion(
    lambda t: 0.3 * np.sin(40.0 * t),
    lambda t: 12.0 * np.cos(40.0 * t),
    lambda t: -480.0 * np.sin(40.0 * t),
    "swing",
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("integrator", "modes"),
    [
        # what the ranks share ends with the volume integrals
        pytest.param(ffr.GeneralizedAlpha(0.1, 400), 2, marks=pytest.mark.mpi),
        (ffr.GeneralizedAlpha(0.1, 400), 4),
        (ffr.RadauIIA(0.1, steps=100), 4),
        (ffr.RadauIIA(0.1, tolerance=1e-7), 4),
    ],
    ids=["2 modes", "generalised alpha", "Radau IIA", "Radau IIA, adaptive"],
)
def test_psi_and_gradient_pass_on_continuously(
    comm: MPI.Intracomm, integrator: ffr.GeneralizedAlpha | ffr.RadauIIA, modes: int
) -> None:
    """A fork on a hub that swings: one prong becomes the softer one."""
    domain = prongs(comm)
    fork = ffr.FlexibleBody(domain, STEEL, frame=ffr.TangentFrame("root"), modes=modes)
    still = ffr.Motion.constant(0.0)
    hub = ffr.Moving(still, still, SWING, "hub")
    mechanism = ffr.Mechanism(
        placements={"fork": ffr.Placement((0.0, 0.0))},
        joints=[ffr.Weld(("fork", "root"), hub, angle=0.0)],
    )
    problem = ffr.Problem({"fork": fork}, mechanism, integrator, ffr.IntegralCompliance())
    upper = np.where(domain.centroids[:, 1] > 0.5, 1.0, -1.0)
    step = 2e-5
    # adaptive steps may differ from one design to the next
    jump = 1e-7 if integrator.steps is None else 1e-10
    line = [problem.gradient(0.8 + step * k * upper) for k in (-2, -1, 0, 1, 2)]
    slopes = [comm.allreduce(float(e.gradient["fork"] @ upper)) for e in line]
    first = [e.fixed_interface_frequencies["fork"][:2] for e in line]
    assert first[2][1] - first[2][0] < 1e-6 * first[2][0]  # they meet in the middle
    assert all(pair[1] - pair[0] > 1e-6 * pair[0] for k, pair in enumerate(first) if k != 2)
    for k in range(4):
        # the trapezoidal rule for the gradient gives the difference, to third order
        change = line[k + 1].psi - line[k].psi
        rule = 0.5 * step * (slopes[k] + slopes[k + 1])
        size = step * max(abs(slope) for slope in slopes)
        assert change == pytest.approx(rule, abs=1e-4 * size + jump * line[2].psi)
    bends = np.diff(slopes)
    assert np.max(np.abs(bends - np.mean(bends))) < 2e-2 * np.max(np.abs(bends))
