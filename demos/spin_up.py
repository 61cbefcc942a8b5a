# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A beam that is spun up, held in line by its own centrifugal force.

What you will see: a flexible beam, turned up to 6 rad/s about its clamped end, lags behind while it
is accelerated and swings back into line as its own centrifugal force stiffens it. Without that
effect, `stiffening=[]`, the same beam grows without bound, and a `SofteningWarning` says so.

The case is that of J. C. Simo and L. Vu-Quoc, Journal of Sound and Vibration 119 (1987),
doi:10.1016/0022-460X(87)90410-X: length 10, EA = 2.8e7, EI = 1.4e4, mass 1.2 per length, and the
angle

    theta(t) = 6/15 (t^2/2 + (15/2pi)^2 (cos(2 pi t/15) - 1)),   t <= 15;   6 t - 45 after.

Run `python demos/spin_up.py --help`, also under `mpirun -n 2`; it takes some seconds.
"""

import math

import numpy as np
from command_line import bar_of, parse, run, say

import dolfinx_ffr as ffr

# %% Parameters
LENGTH = 10.0  # [m]
AXIAL, BENDING, MASS = 2.8e7, 1.4e4, 1.2  # EA [N], EI [N m^2], rho A [kg/m]
HEIGHT = math.sqrt(12.0 * BENDING / AXIAL)  # of the strip of 1 m thickness [m]
MATERIAL = ffr.PlaneStress(AXIAL / HEIGHT, 1.0 / 6.0, MASS / HEIGHT, thickness=1.0)
SPEED, RISE, DURATION, STEPS = 6.0, 15.0, 30.0, 6000  # [rad/s], [s], [s], [-]
WAVES = math.sqrt(MASS / AXIAL) * SPEED  # a with a^2 = rho A omega^2 / EA [1/m]
#: Stretch of the beam in steady rotation [m]
STRETCH = math.tan(WAVES * LENGTH) / WAVES - LENGTH
TURN = RISE / (2.0 * np.pi)  # [s]
#: The prescribed angle, its velocity and its acceleration
ANGLE = ffr.Motion(
    lambda t: np.where(
        t < RISE,
        SPEED / RISE * (0.5 * t**2 + TURN**2 * (np.cos(t / TURN) - 1.0)),
        SPEED * (t - 0.5 * RISE),
    ),
    lambda t: np.where(t < RISE, SPEED / RISE * (t - TURN * np.sin(t / TURN)), SPEED),
    lambda t: np.where(t < RISE, SPEED / RISE * (1.0 - np.cos(t / TURN)), 0.0),
    "spin-up",
)


# %% The scene
def spin_up(domain: ffr.Domain, steps: int) -> ffr.Problem:
    """The beam, clamped to a hub that turns as prescribed."""
    frame = ffr.TangentFrame("left")
    beam = ffr.FlexibleBody(domain, MATERIAL, frame=frame, modes=4, stiffening=["omega2"])
    zero = ffr.Motion.constant(0.0)
    hub = ffr.Moving(zero, zero, ANGLE, name="hub")
    clamp = ffr.Weld(("beam", "left"), hub, angle=0.0, name="clamp")
    mechanism = ffr.Mechanism({"beam": ffr.Placement()}, [clamp])
    times = ffr.GeneralizedAlpha(DURATION, steps)
    return ffr.Problem({"beam": beam}, mechanism, times, ffr.IntegralCompliance())


def main(arguments: list[str] | None = None) -> None:
    """Spin the beam up, and leave numbers and pictures."""
    options = parse(arguments, "spin_up", elements=(60, 2), steps=STEPS, mesh="")
    comm, output = options.comm, options.output
    domain = bar_of(options, LENGTH, HEIGHT)
    problem = spin_up(domain, options.steps)
    evaluation = problem.value(np.ones(domain.n_cells))
    t, marker = evaluation.trajectory.t, evaluation.bodies["beam"].integrals.markers["right"]
    along, lag = (evaluation.trajectory.elastic("beam") @ marker.displacement.T).T
    stretch = float(along[t > RISE].mean())
    say(f"largest lag {lag.min():.4f} m at t = {t[np.argmin(lag)]:.2f} s")
    say(f"stretch after the spin-up {stretch:.6e} m, closed form {STRETCH:.6e} m")

    # %% Pictures and numbers
    steady = {"closed form of steady rotation": (t, np.full(len(t), 1e3 * STRETCH))}
    curves = {
        "lag of the tip [m]": {"": (t, lag)},
        "stretch of the beam [mm]": {"with geometric stiffening": (t, 1e3 * along), **steady},
        "angular velocity [rad/s]": {"of the hub": (t, ANGLE.velocity(t))},
    }
    ffr.plotting.plot_curves(curves, output / "tip.png", xlabel="time [s]")
    ffr.plotting.plot_scene(problem, evaluation, output / "scene.png")
    ffr.plotting.animate_motion(problem, evaluation, output / "motion.gif")
    ffr.write_summary(comm, output / "summary.json", {"lag": float(lag.min()), "stretch": stretch})

    # %% In steady rotation the beam is as long as the closed form says
    assert abs(stretch - STRETCH) < 2e-3 * STRETCH, f"stretch {stretch}, closed form {STRETCH}"


if __name__ == "__main__":
    run(main)
