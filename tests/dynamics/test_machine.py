# SPDX-License-Identifier: MIT
"""A machine with many kinds of parts, from densities to the objective and back."""

from __future__ import annotations

import math
from dataclasses import replace

from mpi4py import MPI

import pytest
from shared.derivatives import check_gradient
from shared.scenes import loader

import dolfinx_ffr as ffr


@pytest.mark.parametrize(
    "stiffening", [(), pytest.param(("omega2", "acceleration"), marks=pytest.mark.mpi)]
)
def test_gradient(comm: MPI.Intracomm, stiffening: tuple[str, ...]) -> None:
    """Of the loader from its equilibrium, its boom on a mesh, with a marker beside its axis."""
    scene = loader(0.1, 100)
    boom = ffr.FlexibleBody(
        ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(24, 4)),
        ffr.PlaneStress(2e9, 0.3, 1000.0, 0.01),
        frame=ffr.ChordFrame("left", "right"),
        modes=4,
        markers={"middle": (0.2, 0.003)},
        stiffening=stiffening,
    )
    angle = scene.mechanism.placements["boom"].angle
    left = ffr.Placement((-0.2 * math.cos(angle), -0.2 * math.sin(angle)), angle)
    placements, start = {**scene.mechanism.placements, "boom": left}, ffr.StaticEquilibrium()
    mechanism = replace(scene.mechanism, placements=placements, start=start)
    bodies = {**scene.bodies, "boom": boom}
    problem = ffr.Problem(bodies, mechanism, scene.integrator, ffr.IntegralCompliance())
    check_gradient(problem, taylor=2e-2)
