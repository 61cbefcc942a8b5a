# SPDX-License-Identifier: MIT
"""Random scenes: whatever is accepted gives finite numbers and an exact gradient."""

from __future__ import annotations

import math
import warnings

from mpi4py import MPI

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shared.beams import beam
from shared.derivatives import along, dot, random_direction
from shared.rods import STEEL

import dolfinx_ffr as ffr
from dolfinx_ffr.verification import taylor_test

pytestmark = pytest.mark.slow

Scene = tuple[ffr.Mechanism, dict[str, ffr.VolumeIntegrals], ffr.GeneralizedAlpha]


@st.composite
def chains(draw: st.DrawFn) -> Scene:
    """An open chain of up to three links, hinged, welded or sliding, with any loads."""
    count = draw(st.integers(1, 3))
    bodies: dict[str, ffr.VolumeIntegrals] = {}
    placements, joints, forces, masses = {}, [], [], []
    end = np.zeros(2)
    previous: object = ffr.Ground()
    for i in range(count):
        name = f"link {i}"
        length = draw(st.floats(0.1, 0.6))
        modes = draw(st.integers(0, 3))
        frame = draw(st.sampled_from(["chord", "tangent"]))
        bodies[name] = beam(length, 0.01, 0.01, elements=6, modes=modes, frame=frame)
        angle = draw(st.floats(-math.pi, math.pi))
        along = np.array([math.cos(angle), math.sin(angle)])
        # the frame's origin is where its marker says
        pin = bodies[name].markers["left"].position
        turn = np.array([[along[0], -along[1]], [along[1], along[0]]])
        placements[name] = ffr.Placement(
            tuple(end - turn @ pin), angle, angular_velocity=draw(st.floats(-5.0, 5.0))
        )
        kind = draw(st.sampled_from(["revolute", "revolute", "weld", "slider"]))
        joint = {"revolute": ffr.Revolute, "weld": ffr.Weld, "slider": ffr.PointOnLine}[kind]
        if joint is ffr.PointOnLine and i == 0:
            joint = ffr.Revolute
        line = {"direction": (1.0, 0.5)} if joint is ffr.PointOnLine else {}
        joints.append(joint((name, "left"), previous, **line, name=f"joint {i}"))
        if draw(st.booleans()):
            push, rate = draw(st.floats(-20.0, 20.0)), draw(st.floats(0.0, 30.0))
            over_time = lambda t, push=push, rate=rate: push * np.cos(rate * np.asarray(t))  # noqa: E731
            follower = draw(st.booleans())
            forces.append(ffr.Force((name, "right"), push, over_time, follower))
        if draw(st.booleans()):
            strength = draw(st.floats(1.0, 1e3)), draw(st.floats(0.0, 5.0))
            forces.append(ffr.SpringDamper((name, "middle"), ffr.Ground((0.3, -0.4)), *strength))
        if draw(st.booleans()):
            masses.append(ffr.PointMass((name, "right"), draw(st.floats(0.01, 2.0))))
        end = end + length * along
        previous = (name, "right")
    damping = ffr.RayleighDamping(draw(st.floats(0.0, 5.0)), 1e-5)
    mechanism = ffr.Mechanism(
        placements=placements,
        joints=joints,
        forces=forces,
        point_masses=masses,
        gravity=(0.0, draw(st.sampled_from([0.0, -9.81]))),
        damping={"link 0": damping} if bodies["link 0"].modes else {},  # rigid ones have none
    )
    steps = draw(st.integers(50, 150))
    radius = draw(st.sampled_from([0.0, 0.5, 0.8, 1.0]))
    return mechanism, bodies, ffr.GeneralizedAlpha(0.2, steps, spectral_radius=radius)


@pytest.mark.slow
@settings(max_examples=25)
@given(chains(), st.integers(0, 1000))
def test_chains(scene: Scene, seed: int) -> None:
    """Finite, on the constraints, and with a derivative that a Taylor test confirms."""
    mechanism, bodies, integrator = scene
    objective = ffr.IntegralCompliance() if any(b.modes for b in bodies.values()) else None
    with warnings.catch_warnings():
        for expected in (ffr.SofteningWarning, ffr.LargeDeformationWarning, ffr.TimeStepWarning):
            warnings.simplefilter("ignore", expected)
        try:
            trajectory = ffr.simulate(mechanism, bodies, integrator)
        except ffr.SimulationError as error:
            # violent scenes may need smaller steps: then it says so, and hands on what is good
            assert "take smaller steps" in str(error)
            assert np.all(np.isfinite(error.trajectory.y))
            return
        for part in (trajectory.y, trajectory.v, trajectory.w, trajectory.multipliers):
            assert np.all(np.isfinite(part))
        assert np.abs(trajectory.marker_path("link 0", "left")).max() < 1e-9
        if objective is None:
            return
        problem = ffr.MechanicalProblem(mechanism, integrator, objective)
        evaluation = problem.gradient(bodies)
        direction = random_direction(bodies, seed)
        slope = dot(evaluation.integrals_gradient, direction)
        # a spring's force is known to the round-off of the distances it is computed from: what that
        # bends, relative to what bends at all, must stay below what the Taylor test resolves
        springs = [f.stiffness for f in mechanism.forces if isinstance(f, ffr.SpringDamper)]
        softest = min(np.linalg.eigvalsh(b.K)[0] for b in bodies.values() if b.modes)
        bent = math.sqrt(evaluation.psi * softest / 0.2)  # [N], of the mean generalised deflection
        if np.finfo(float).eps * max(springs, default=1.0) > 1e-9 * bent:
            return
        result = taylor_test(
            along(lambda moved: problem.value(moved).psi, bodies, direction),
            lambda s: float(s) * slope,
            0.0,
            1.0,
            steps=[2e-5 / 2**k for k in range(7)],
            roundoff=1e-9,
        )
    # order 2 where the remainder stands above round-off, of which stiff scenes have more; there the
    # derivative is right to what is left of the difference
    significant = [order for order in result.orders if np.isfinite(order)]
    right = bool(np.any(result.remainders <= 1e-5 * np.abs(result.differences)))
    assert not significant or max(significant) > 1.9 or right, result


@pytest.mark.filterwarnings("ignore:.*cuts through a cluster of frequencies")
@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 1.0), st.floats(1.0, 5.0))
def test_densities(seed: int, filled: float, exponent: float) -> None:
    """Any density in [0, 1] with any exponent: finite; of a cluster that is cut it is told."""
    domain = ffr.Domain.rectangle(MPI.COMM_SELF, 0.4, 0.04, elements=(12, 4))
    steel, frame = STEEL, ffr.ChordFrame("left", "right")
    law = ffr.SIMP(exponent=exponent)
    body = ffr.FlexibleBody(domain, steel, frame=frame, modes=3, interpolation=law)
    rng = np.random.default_rng(seed)
    x = np.where(rng.uniform(size=domain.n_cells) < filled, rng.uniform(size=domain.n_cells), 0.0)
    reduced = body.reduce(np.where(domain.design_cells, x, 1.0))
    integrals = reduced.integrals
    integrals.validate("rod")
    assert np.all(np.linalg.eigvalsh(integrals.K) > 0.0)
    assert np.all(np.diff(reduced.basis.eigenvalues) >= -1e-9 * reduced.basis.eigenvalues[:-1])
