# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A beam that is spun up, with and without geometric stiffening.

What you will see: a flexible beam, turned up to 6 rad/s about its clamped end, lags behind while it
is accelerated and swings back into line as its own centrifugal force stiffens it. Without that
effect the same beam, whose first frequency is 3.8 rad/s, grows without bound, and the simulation
says so.

The case is that of J. C. Simo and L. Vu-Quoc, Journal of Sound and Vibration 119 (1987),
doi:10.1016/0022-460X(87)90410-X: length 10, EA = 2.8e7, EI = 1.4e4, mass 1.2 per length, and the
angle

    theta(t) = 6/15 (t^2/2 + (15/2pi)^2 (cos(2 pi t/15) - 1)),   t <= 15;   6 t - 45 after.

**Model.** A plane-stress strip with these stiffnesses, tangent frame at the clamped end, three
constraint modes and four normal modes. Geometric stiffness K_w by the centrifugal load:
r_q = ... + (K + omega^2 K_w) q.

Run it with

    python demos/spin_up.py [--elements NX NY] [--steps N] [--mesh FILE] [--output DIR]

also under `mpirun -n 2`; it takes some seconds.
"""

# %% Imports
from __future__ import annotations

import argparse
import math
import warnings
from pathlib import Path

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike, NDArray

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.program import run

# %% Parameters
LENGTH = 10.0  # [m]
AXIAL, BENDING, MASS = 2.8e7, 1.4e4, 1.2  # EA [N], EI [N m^2], rho A [kg/m]
HEIGHT = math.sqrt(12.0 * BENDING / AXIAL)  # of the strip of 1 m thickness [m]
MATERIAL = ffr.PlaneStress(
    young=AXIAL / HEIGHT, poisson=1.0 / 6.0, density=MASS / HEIGHT, thickness=1.0
)
SPEED, RISE, DURATION, STEPS = 6.0, 15.0, 30.0, 6000  # [rad/s], [s], [s], [-]
#: Stretch of the beam in steady rotation, tan(a L)/a - L with a^2 = rho A omega^2 / EA [m]
STRETCH = (
    math.tan(math.sqrt(MASS / AXIAL) * SPEED * LENGTH) / (math.sqrt(MASS / AXIAL) * SPEED) - LENGTH
)


# %% The prescribed angle
def angle(t: ArrayLike) -> NDArray[np.float64]:
    """The angle of the clamped end [rad]."""
    t = np.asarray(t, dtype=np.float64)
    turn = RISE / (2.0 * np.pi)
    rising = SPEED / RISE * (0.5 * t**2 + turn**2 * (np.cos(t / turn) - 1.0))
    return np.where(t < RISE, rising, SPEED * (t - 0.5 * RISE))


def speed(t: ArrayLike) -> NDArray[np.float64]:
    """Its velocity [rad/s]."""
    t = np.asarray(t, dtype=np.float64)
    turn = RISE / (2.0 * np.pi)
    return np.where(t < RISE, SPEED / RISE * (t - turn * np.sin(t / turn)), SPEED)


def acceleration(t: ArrayLike) -> NDArray[np.float64]:
    """Its acceleration [rad/s^2]."""
    t = np.asarray(t, dtype=np.float64)
    return np.where(t < RISE, SPEED / RISE * (1.0 - np.cos(2.0 * np.pi * t / RISE)), 0.0)


# %% The scene
def spin_up(
    comm: MPI.Comm,
    *,
    stiffening: bool,
    elements: tuple[int, int] = (60, 2),
    domain: ffr.Domain | None = None,
    steps: int = STEPS,
) -> ffr.Problem:
    """The beam, clamped to a hub that turns as prescribed.

    Args:
        comm: Communicator over which the mesh is distributed.
        stiffening: Model geometric stiffening by the centrifugal load.
        elements: Along and across.
        domain: A mesh with the interfaces ``"left"`` (hub) and ``"right"`` instead.
        steps: Number of time steps.
    """
    if domain is None:
        domain = ffr.Domain.rectangle(
            comm, LENGTH, HEIGHT, elements=elements, order=2, solid_columns=0
        )
    beam = ffr.FlexibleBody(
        domain,
        MATERIAL,
        frame=ffr.TangentFrame("left"),
        modes=4,
        stiffening=["omega2"] if stiffening else [],
    )
    zero = ffr.Motion.constant(0.0)
    hub = ffr.Moving(zero, zero, ffr.Motion(angle, speed, acceleration, "spin-up"), name="hub")
    mechanism = ffr.Mechanism(
        placements={"beam": ffr.Placement()},
        joints=[ffr.Weld(("beam", "left"), hub, angle=0.0, name="clamp")],
    )
    return ffr.Problem(
        {"beam": beam},
        mechanism,
        ffr.GeneralizedAlpha(DURATION, steps),
        ffr.IntegralCompliance(),
    )


def tip(evaluation: ffr.Evaluation) -> NDArray[np.float64]:
    """The displacement of the free end in the rotating axes, shape (steps + 1, 2) [m]."""
    marker = evaluation.bodies["beam"].integrals.markers["right"]
    return evaluation.trajectory.elastic("beam") @ marker.displacement.T


# %% The program
def main(arguments: list[str] | None = None) -> None:
    """Spin the beam up twice, and leave numbers and pictures."""
    options = parse(arguments)
    comm = MPI.COMM_WORLD
    output = Path(options.output)
    say = print if comm.rank == 0 else lambda *_: None

    # %% Without geometric stiffening: reported, by name, time and speed
    given = ffr.Domain.from_gmsh(comm, options.mesh, order=2) if options.mesh else None
    size = {"elements": tuple(options.elements), "steps": options.steps, "domain": given}
    linear = spin_up(comm, stiffening=False, **size)
    x = np.ones(linear.flexible["beam"].domain.n_cells)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ffr.SofteningWarning)
        try:
            trajectory = linear.value(x).trajectory
        except ffr.SimulationError as error:
            trajectory = error.trajectory
    softening = [str(w.message) for w in caught if issubclass(w.category, ffr.SofteningWarning)]
    marker = linear.flexible["beam"].reduce(x).integrals.markers["right"]
    unstable = trajectory.elastic("beam") @ marker.displacement.T
    say(f"linear: {softening[0] if softening else 'nothing reported'}")

    # %% With it
    problem = spin_up(comm, stiffening=True, **size)
    evaluation = problem.value(x)
    t, displacement = evaluation.trajectory.t, tip(evaluation)
    lag = displacement[:, 1]
    steady = t > RISE
    largest = float(lag.min())
    say(f"with stiffening: largest lag {largest:.4f} m at t = {t[np.argmin(lag)]:.2f} s")
    say(f"after spin-up: mean lag {lag[steady].mean():+.1e} m, swings {np.ptp(lag[steady]):.1e} m")
    stretch = float(displacement[steady, 0].mean())
    say(f"stretch {stretch:.6e} m, closed form {STRETCH:.6e} m")

    # %% Pictures
    shown = np.abs(unstable[:, 1]) < 2.0 * abs(largest)
    plotting.plot_curves(
        {
            "lag of the tip [m]": {
                "with geometric stiffening": (t, lag),
                "without": (trajectory.t[shown], unstable[shown, 1]),
            },
            "stretch of the beam [mm]": {
                "with geometric stiffening": (t, 1e3 * displacement[:, 0]),
                "closed form of steady rotation": (t, np.full(len(t), 1e3 * STRETCH)),
            },
            "angular velocity [rad/s]": {"of the hub": (t, speed(t))},
        },
        output / "tip.png",
        xlabel="time [s]",
        comm=comm,
    )
    plotting.plot_scene(problem, evaluation, output / "scene.png")
    plotting.animate_motion(problem, evaluation, output / "motion.gif")

    ffr.write_summary(
        comm,
        output / "summary.json",
        {"largest_lag": largest, "stretch": stretch, "stretch_closed_form": STRETCH},
    )
    say(f"pictures and numbers are in {output}")

    # %% What must hold
    assert abs(lag[steady].mean()) < 1e-2 * abs(largest), "the lag should vanish"
    if given:  # closed form and published lag are those of the built-in beam
        return
    assert any("'beam' turns with" in line for line in softening), "softening is not reported"
    assert np.abs(unstable[:, 1]).max() > 10.0 * abs(largest), "the linear beam should run away"
    assert -0.7 < largest < -0.5, f"largest lag {largest}"
    assert abs(lag[steady].mean()) < 1e-3 * abs(largest), "the lag should vanish"
    assert abs(stretch - STRETCH) < 1e-3 * STRETCH, f"stretch {stretch}, closed form {STRETCH}"


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Spin a flexible beam up.")
    parser.add_argument("--elements", nargs=2, type=int, default=[60, 2], metavar=("NX", "NY"))
    parser.add_argument("--steps", type=int, default=STEPS, help=f"of time (default {STEPS})")
    parser.add_argument("--mesh", help="gmsh file with the physical curves 'left' and 'right'")
    parser.add_argument("--output", default="results/spin_up", help="folder for the results")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    run(main)
