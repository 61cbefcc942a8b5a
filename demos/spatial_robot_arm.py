# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A robot arm in space: both links designed for the path of the payload.

What you will see: an arm turns about a vertical axis, raises its upper arm and stretches its elbow,
all at once. Its motors turn as those of a rigid arm would; the links sag, bend and twist, and the
hand misses the path. Of half of the material, a design misses it hardly more than full links do.

**Problem.** Find the densities x of both links that minimise

    psi = int |r_hand - path|^2 dt   such that   volume(x_u) <= 0.5,   volume(x_f) <= 0.5;

the error of the hand is sqrt(psi / T). Shoulder and elbow have prescribed angles, on a column that
turns as prescribed; the motion begins in the static equilibrium.

Run `python demos/spatial_robot_arm.py --help`, also under `mpirun -n 2`; it takes some minutes.
"""

from mpi4py import MPI

import numpy as np
from command_line import draw, leave, parse, run, say

import dolfinx_ffr as ffr

# %% Parameters
UPPER, FORE = (0.5, 0.06, 0.04), (0.4, 0.05, 0.035)  # length, width and height of the links [m]
PLASTIC = ffr.Isotropic(young=3e9, poisson=0.35, density=1200.0)
PAYLOAD, ELBOW_MOTOR, GRAVITY = 0.3, 0.2, 9.81  # [kg], [kg], [m/s^2]
ELBOW = 1.8  # angle of the elbow at the start, downwards [rad]
BEGIN, MOVE, DURATION = 0.02, 0.5, 0.6  # the move begins, takes, all is over [s]
VOLUME, MODES, STEPS = 0.5, 6, 600  # bound of the filled share of each link, and numbers


# %% The scene
TURNED, SHOULDER, RISE = (
    ffr.Motion.smooth_step(angle, MOVE, start=BEGIN, name=name)
    for angle, name in ((1.5, "column"), (-0.9, "shoulder"), (-1.4, "elbow"))  # [rad]
)
BENT = ffr.Motion(lambda t: ELBOW + RISE.value(t), RISE.velocity, RISE.acceleration, "elbow")


def hand_of_rigid_arm(t: np.ndarray) -> np.ndarray:
    """Where the hand of a rigid arm is, shape (times, 3) [m]."""
    turn, shoulder, elbow = (np.asarray(motion.value(t)) for motion in (TURNED, SHOULDER, BENT))
    reach = UPPER[0] * np.cos(shoulder) + FORE[0] * np.cos(shoulder + elbow)
    up = -UPPER[0] * np.sin(shoulder) - FORE[0] * np.sin(shoulder + elbow)
    return np.stack([reach * np.cos(turn), reach * np.sin(turn), up], axis=-1)


def arm(comm: MPI.Comm, elements: tuple[int, int, int], steps: int) -> ffr.Problem:
    """The arm, with ``elements`` of each link along, across and over its height."""
    frame, links = ffr.TangentFrame("left"), {}
    for name, size in (("upper arm", UPPER), ("forearm", FORE)):
        box = ffr.Domain.box(comm, *size, elements=elements)
        links[name] = ffr.FlexibleBody(box, PLASTIC, frame=frame, modes=MODES)
    fixed, across = ffr.Motion.constant(0.0), {"axis": (0, 1, 0)}
    column = ffr.Moving(fixed, fixed, TURNED, z=fixed, name="column")
    upper, fore, end = ("upper arm", "left"), ("forearm", "left"), ("upper arm", "right")
    bent = ffr.Placement((UPPER[0], 0, 0), rotation=(0, ELBOW, 0))
    mechanism = ffr.Mechanism(
        placements={"upper arm": ffr.Placement((0, 0, 0)), "forearm": bent},
        joints=[
            ffr.Revolute(upper, column, **across, name="shoulder"),
            ffr.PrescribedAngle(upper, SHOULDER, column, **across, name="shoulder motor"),
            ffr.Revolute(fore, end, **across, name="elbow"),
            ffr.PrescribedAngle(fore, BENT, end, **across, name="elbow motor"),
        ],
        point_masses=[
            ffr.PointMass(("forearm", "right"), PAYLOAD),
            ffr.PointMass(end, ELBOW_MOTOR),
        ],
        gravity=(0, 0, -GRAVITY),
        start=ffr.StaticEquilibrium(),
    )
    path = tuple(lambda t, k=k: hand_of_rigid_arm(np.asarray(t))[..., k] for k in range(3))
    tracking = ffr.PathTracking("forearm", "right", path)
    return ffr.Problem(links, mechanism, ffr.GeneralizedAlpha(DURATION, steps), tracking)


def main(arguments: list[str] | None = None) -> None:
    """Design both links, and leave numbers and pictures."""
    options = parse(arguments, "spatial_robot_arm", elements=(40, 6, 4), steps=STEPS, iterations=60)
    problem = arm(MPI.COMM_WORLD, options.elements, options.steps)
    designs = {name: ffr.LevelSet(body.domain) for name, body in problem.flexible.items()}
    full = problem.value({name: np.ones(design.domain.n_cells) for name, design in designs.items()})
    with ffr.recorded_warnings() as warnings:
        result = ffr.optimize(problem, designs, volume=VOLUME, **options.run)
        finished = result.finish(options.output, most=3)
    numbers = {"error_full": np.sqrt(full.psi / DURATION)}  # of the hand [m]
    numbers["error_design"] = np.sqrt(result.psi / DURATION)
    say(", ".join(f"{name}: {1e3 * value:.2f} mm" for name, value in numbers.items()))

    # %% Numbers and pictures
    draw(result, options.output, volume=VOLUME)
    leave(options, result, "A robot arm in space", full.psi, finished, warnings, **numbers)

    # %% The hand of full links is where that of a rigid arm is
    path = full.trajectory.marker_path("forearm", "right")
    away = np.linalg.norm(path - hand_of_rigid_arm(full.trajectory.t), axis=1).max()
    assert away < 0.05 * FORE[0], f"the hand is {away} m from where its motors turn it"


if __name__ == "__main__":
    run(main)
