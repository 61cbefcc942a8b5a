# SPDX-License-Identifier: MIT
"""The same machine in any consistent system of units: the same motion, psi and gradient."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from shared.scenes import SCENES, Scene
from shared.units import ACCELERATION, COMPLIANCE, FORCE, LENGTH, MASS, SYSTEMS, TIME, Powers, Units

import dolfinx_ffr as ffr

#: Largest relative difference; the motions magnify round-off by no more than that.
SAME = 1e-9


def double_pendulum(length: float = 1e-4, steps: int = 20) -> Scene:
    """Two rigid links of silicon that fall, a tenth of a millimetre long."""
    mass, ends = 2330.0 * length**3 / 400.0, {"a": (-length / 2, 0.0), "b": (length / 2, 0.0)}
    link = ffr.VolumeIntegrals.rigid(mass, (0.0, 0.0), mass * length**2 / 12.0, ends)
    places = {"upper": (length / 2, 0.0), "lower": (1.5 * length, 0.0)}
    mechanism = ffr.Mechanism(
        {name: ffr.Placement(place) for name, place in places.items()},
        [ffr.Revolute(("upper", "a"), ffr.Ground()), ffr.Revolute(("upper", "b"), ("lower", "a"))],
        gravity=(0.0, -9.81),
    )
    duration = 0.5 * (length / 9.81) ** 0.5
    return Scene(mechanism, {"upper": link, "lower": link}, ffr.GeneralizedAlpha(duration, steps))


def hanging(scene: Scene) -> Scene:
    """A scene that starts from its static equilibrium, and is swung out of it by its base."""
    shaken = (ffr.Motion.polynomial([0.0, 300.0]), 0.0)
    mechanism = replace(scene.mechanism, start=ffr.StaticEquilibrium(), ground_acceleration=shaken)
    return replace(scene, mechanism=mechanism)


SHAKING = ffr.MarkerAcceleration("lower", "b"), (0, 2, -3)
ENERGY = ffr.IntegralCompliance(), COMPLIANCE

CASES: dict[str, tuple[Callable[[], Scene], tuple[ffr.Objective, Powers]]] = {
    # sought from a position in which it would fall upwards
    "rigid, at rest": (lambda: hanging(double_pendulum()), SHAKING),
    "flexible": (lambda: SCENES["slider-crank"](0.05, 8), ENERGY),
    "closed loop": (lambda: SCENES["four-bar"](0.03, 8), ENERGY),
    "joints": (lambda: SCENES["stiffened"](0.03, 8), ENERGY),
    "forces, at rest": (lambda: hanging(SCENES["loader"](0.02, 8)), ENERGY),
}


def differences(
    scene: Scene, given: tuple[ffr.Objective, Powers], systems: tuple[Units, ...]
) -> list[float]:
    """Relative differences of psi and of its derivatives in systems of units from those in SI."""
    objective, powers = given

    def solved(scene: Scene) -> tuple[float, dict[str, ffr.VolumeIntegrals]]:
        problem = ffr.MechanicalProblem(scene.mechanism, scene.integrator, objective)
        evaluation = problem.gradient(scene.bodies)
        assert evaluation.integrals_gradient is not None
        return evaluation.psi, evaluation.integrals_gradient

    psi, gradient = solved(scene)
    values = []
    for units in systems:
        here, bars = solved(units.scene(scene))
        values.append(abs(here / units.factor(powers) / psi - 1.0))
        for name, bar in bars.items():
            # A derivative is psi over an integral: it goes back as the integral comes.
            back, exact = units.body(bar).scaled(1.0 / units.factor(powers)), gradient[name]
            for key in "SGNK":
                ours, theirs = getattr(back, key), getattr(exact, key)
                integral = np.max(np.abs(getattr(scene.bodies[name], key)), initial=0.0)
                if integral > 0.0:
                    # Where next to nothing depends on an integral, that is round-off of psi.
                    size = max(float(np.max(np.abs(theirs))), abs(psi) / integral)
                    values.append(float(np.max(np.abs(ours - theirs))) / size)
    return values


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*excites vibrations:dolfinx_ffr.TimeStepWarning")
@pytest.mark.parametrize(
    ("case", "method"),
    [
        *((case, ffr.GeneralizedAlpha) for case in CASES),
        *((case, ffr.RadauIIA) for case in ("rigid, at rest", "joints", "forces, at rest")),
    ],
)
def test_mechanisms(case: str, method: type) -> None:
    """Psi and its derivatives by the bodies' integrals are those in SI.

    In the mixed systems, and where all joints or all forces are in all others, too.
    """
    make, objective = CASES[case]
    scene, systems = make(), SYSTEMS[-3:]
    if method is ffr.RadauIIA:
        duration, steps = scene.integrator.end_time, scene.integrator.steps
        scene = replace(scene, integrator=ffr.RadauIIA(duration, steps=steps // 4))
    elif case in ("joints", "forces, at rest"):
        systems = SYSTEMS
    assert max(differences(scene, objective, systems)) < SAME


def test_adaptive_steps() -> None:
    """Steps that follow from a tolerance, and end where the prescribed motion jumps."""
    scene = SCENES["slider-crank"](0.02)
    drop = ffr.Motion(np.square, lambda t: 2.0 * np.asarray(t), lambda t: 2.0, "drop", (0.01,))
    mechanism = replace(scene.mechanism, ground_acceleration=(0.0, drop))
    scene = Scene(mechanism, scene.bodies, ffr.RadauIIA(0.02, tolerance=1e-3))
    assert max(differences(scene, ENERGY, SYSTEMS[-3:])) < SAME


def proof_mass(comm: MPI.Intracomm, units: Units) -> tuple[float, np.ndarray]:
    """Psi and its gradient for a silicon cantilever of 200 micrometres with a welded mass."""
    length, force = units.factor(LENGTH), units.factor(FORCE)
    pressure = force / length**2
    long, high = 200e-6 * length, 20e-6 * length
    beam = ffr.Domain.rectangle(comm, long, high, elements=(8, 1), solid_columns=1)
    density = 2330.0 * units.factor((1, -3, 0))
    silicon = ffr.PlaneStress(169e9 * pressure, 0.22, density, 10e-6 * length)
    mass, size = 1e-9 * units.factor(MASS), 50e-6 * length
    side = {"side": (-size / 2, 0.0)}
    bodies = {
        "beam": ffr.FlexibleBody(beam, silicon, frame=ffr.TangentFrame("left"), modes=2),
        "mass": ffr.VolumeIntegrals.rigid(mass, (0.0, 0.0), mass * size**2 / 6.0, side),
    }
    mechanism = ffr.Mechanism(
        {"beam": ffr.Placement(), "mass": ffr.Placement((long + size / 2, 0.0))},
        [ffr.Weld(("beam", "left"), ffr.Ground()), ffr.Weld(("mass", "side"), ("beam", "right"))],
        ground_acceleration=(0.0, units.quantity(lambda t: 1e3 * np.sin(1e5 * t), ACCELERATION)),
    )
    integrator = ffr.GeneralizedAlpha(5e-5 * units.factor(TIME), 24)
    problem = ffr.Problem(bodies, mechanism, integrator, ffr.IntegralCompliance())
    evaluation = problem.gradient(np.full(beam.n_cells, 0.9))
    assert evaluation.gradient is not None
    scale = units.factor(COMPLIANCE)
    return evaluation.psi / scale, evaluation.gradient["beam"] / scale


@pytest.mark.slow
def test_cantilever_with_a_proof_mass(comm: MPI.Intracomm) -> None:
    """The whole chain, mesh and reduction included, in SI and in other units."""
    psi, gradient = proof_mass(comm, Units())
    for units in SYSTEMS:
        here, there = proof_mass(comm, units)
        assert here == pytest.approx(psi, rel=SAME)
        assert there == pytest.approx(gradient, rel=0.0, abs=SAME * np.abs(gradient).max())
