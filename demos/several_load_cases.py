# SPDX-License-Identifier: MIT
# %% [markdown]
"""# One rod for six load cases.

What you will see: the rod of a small pump, whose slider works against a constant pressure, runs at
three speeds with two loads. It is designed for the load case in which it does worst.

**Problem.** Find the level set alpha that minimises

    max_i psi_i(x(alpha)) / psi_i(x_i)      such that      volume(x(alpha)) <= 0.5,

where psi_i is the integral compliance in the load case i, and x_i a design for it alone; psi is
minimised as z such that no load case has more than z. The mechanism is that of `slider_crank.py`.
The body is reduced once for all load cases, and one adjoint solution for each gives the gradient.

Run `python demos/several_load_cases.py --help`, also under `mpirun -n 2`: ranks share the
cases; it takes some minutes.
"""

from mpi4py import MPI

import numpy as np
from command_line import leave, parse, run, say
from slider_crank import HEIGHT, LENGTH, MODES, STEEL, VOLUME, slider_crank

import dolfinx_ffr as ffr

# %% Parameters
SPEEDS = {"slow": 4.0, "medium": 2.0, "fast": 1.0}  # time of five turns, from rest to rest [s]
SLIDERS = {"light": 0.1, "heavy": 1.0}  # mass [kg]
PRESSURE = 60.0  # force on the slider, towards the crank [N]
#: psi of designs on elements for a load case alone, over that of the full rod; light and heavy
ALONE = {"slow": (2.04, 2.02), "medium": (1.23, 1.36), "fast": (0.46, 0.88)}
MARK = 1.15  # what a finished design has at most in any load case, over the best one for it


# %% The scene
def six_load_cases(comm: MPI.Comm, elements: tuple[int, int], steps: int | None) -> ffr.Problem:
    """The rod in all load cases, with ``steps`` of generalised-alpha, or psi of each to 1e-4."""
    domain = ffr.Domain.rectangle(comm, LENGTH, HEIGHT, elements=elements)
    rod = ffr.FlexibleBody(domain, STEEL, frame=ffr.ChordFrame("left", "right"), modes=MODES)
    pressure = ffr.Force(("rod", "right"), x=-PRESSURE, name="pressure")
    # the pressure is there before the crank turns, and does not make the rod ring
    pumping = {"forces": [pressure], "start": ffr.StaticEquilibrium()}
    load_cases = {
        f"{speed}, {payload}": ffr.MechanicalProblem(
            slider_crank(duration, mass, **pumping),
            ffr.GeneralizedAlpha(duration, steps) if steps else ffr.TimeInterval(duration),
            ffr.IntegralCompliance(),
        )
        for speed, duration in SPEEDS.items()
        for payload, mass in SLIDERS.items()
    }
    return ffr.Problem.of_load_cases({"rod": rod}, load_cases)


def main(arguments: list[str] | None = None) -> None:
    """Design the rod for the worst of its load cases, and leave numbers and pictures."""
    defaults = {"elements": (120, 12), "iterations": 60, "steps": None, "resume": False}
    options = parse(arguments, "several_load_cases", **defaults, boundary=None)
    comm, output = MPI.COMM_WORLD, options.output
    problem_of_all = six_load_cases(comm, options.elements, options.steps)
    domain = problem_of_all.flexible["rod"].domain
    full = problem_of_all.value(np.ones(domain.n_cells)).load_cases
    share_alone = dict(zip(full, (share for pair in ALONE.values() for share in pair), strict=True))
    weights = {name: 1.0 / (share_alone[name] * case.psi) for name, case in full.items()}
    problem = ffr.Problem.of_load_cases(
        problem_of_all.bodies, problem_of_all.load_cases, ffr.WorstCase(weights)
    )
    with ffr.recorded_warnings() as warnings:
        result = ffr.optimize(problem, ffr.LevelSet(domain), volume=VOLUME, **options.run)
        finished = result.finish(output)
    ratios = {m: e.psi * weights[m] for m, e in result.final[1].load_cases.items()}
    listed = ", ".join(f"{name} {ratio:.3f}" for name, ratio in ratios.items())
    say("psi of the part over that of designs on elements for each load case alone:", listed)

    # %% Numbers and pictures
    drawn = {"psi_unit": "", "volume_bound": VOLUME, "comm": comm}
    ffr.plotting.plot_history(result.history, output / "history.png", **drawn)
    for speed in ("slow", "fast"):
        own = (each.alone(f"{speed}, heavy") for each in result.final)
        ffr.plotting.plot_scene(*own, output / f"scene_{speed}.png")
    own = (each.alone("fast, light") for each in result.final)
    ffr.plotting.animate_motion(*own, output / "motion.gif")
    numbers = {"psi_over_best": ratios, "psi_full": {m: e.psi for m, e in full.items()}}
    worst, numbers["most"] = max(1.0 / share for share in share_alone.values()), MARK
    leave(options, result, "One rod for six load cases", worst, finished, warnings, **numbers)


if __name__ == "__main__":
    run(main)
