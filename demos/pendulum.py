# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A flexible pendulum, and how far it is from full nonlinear finite elements.

What you will see: a soft bar, hinged at one end, falls from the horizontal. Its tip is where full
nonlinear finite elements have it: four positions of theirs are stored below.

**Model.** Chord frame, three constraint modes and eight normal modes, with geometric stiffening by
the bar's own inertia and weight.

**Stored reference.** The same mesh and steps with all nodes moving by St Venant-Kirchhoff
elasticity, the left end rigid and hinged in its middle: u(X, t) such that for all v

    int rho u'' . v dX + int (F S) : grad v dX = int rho g . v dX,   F = I + grad u,
    S = lambda tr(E) I + 2 mu E,   E = (F^T F - I)/2.

Run `python demos/pendulum.py --help`, also under `mpirun -n 2`; it takes some seconds.
"""

import numpy as np
from command_line import bar_of, parse, run, say

import dolfinx_ffr as ffr

# %% Parameters
LENGTH, HEIGHT, THICKNESS = 1.0, 0.05, 0.05  # [m]
RUBBER = ffr.PlaneStress(young=20e6, poisson=0.3, density=1000.0, thickness=THICKNESS)
GRAVITY = 9.81  # [m/s^2]
DURATION, STEPS = 1.0, 400  # [s], [-]
#: Positions of the tip by full nonlinear finite elements, by time [m]
FULL_MODEL = {
    0.25: (0.90091248, -0.43444136),
    0.5: (-0.08251682, -0.99725995),
    0.75: (-0.94448743, -0.32766368),
    1.0: (-0.99982546, -0.00012344),
}


# %% The scene
def pendulum(domain: ffr.Domain, steps: int, stiffening: bool = True) -> ffr.Problem:
    """A bar with rigid end faces on its hinge."""
    hinge, tip = (domain.interfaces[name].center for name in ("left", "right"))
    chord = ffr.ChordFrame("left", "right")
    loads = ["omega2", "alpha", "acceleration"] if stiffening else []
    bar = ffr.FlexibleBody(domain, RUBBER, frame=chord, modes=8, stiffening=loads)
    mechanism = ffr.Mechanism(
        placements={"bar": ffr.Placement(tuple(hinge), np.arctan2(*(tip - hinge)[::-1]))},
        joints=[ffr.Revolute(("bar", "left"), ffr.Ground(tuple(hinge)), name="hinge")],
        gravity=(0.0, -GRAVITY),
    )
    times = ffr.GeneralizedAlpha(DURATION, steps)
    return ffr.Problem({"bar": bar}, mechanism, times, ffr.IntegralCompliance())


def main(arguments: list[str] | None = None) -> None:
    """Let the pendulum fall, and leave numbers and pictures."""
    options = parse(arguments, "pendulum", elements=(30, 2), steps=STEPS, mesh="")
    comm, output = options.comm, options.output
    problem = pendulum(bar_of(options, LENGTH, HEIGHT), options.steps)
    evaluation = problem.value(np.ones(problem.flexible["bar"].domain.n_cells))
    motion = evaluation.trajectory
    path = motion.marker_path("bar", "right")
    instants = np.searchsorted(motion.t, np.array(list(FULL_MODEL)) - 1e-9)
    full = np.array(list(FULL_MODEL.values()))
    distance = np.linalg.norm(path[instants] - full, axis=1) / LENGTH
    say(f"from full nonlinear finite elements the tip is at most {distance.max():.1e} lengths away")

    # %% Pictures and numbers
    curves = {
        "height of the tip [m]": {"": (motion.t, path[:, 1])},
        "distance from the full model, at four instants / length": {
            "": (motion.t[instants], distance)
        },
    }
    ffr.plotting.plot_curves(curves, output / "tip.png", xlabel="time [s]")
    ffr.plotting.plot_scene(problem, evaluation, output / "scene.png")
    ffr.plotting.animate_motion(problem, evaluation, output / "motion.gif")
    ffr.write_summary(comm, output / "summary.json", {"differences": distance.tolist()})

    # %% Large rotations are exact, and the deformation is small
    assert distance.max() < 1e-3, f"floating frame and full model part: {distance}"


if __name__ == "__main__":
    run(main)
