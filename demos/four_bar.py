# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A four-bar linkage with two flexible links, designed together.

What you will see: a crank shakes a disc to and fro by a coupler and a rocker. Both are flexible, of
different materials, and find their shape in the same optimisation, by one adjoint pass.

**Problem.** Find the densities x of the coupler and of the rocker that minimise

    psi = int q_c^T K_c q_c dt / psi_c + int q_r^T K_r q_r dt / psi_r
    such that   volume(x_c) <= 0.5,   volume(x_r) <= 0.5,

where q are the links' elastic coordinates and psi_c, psi_r the values of the full links.

Run `python demos/four_bar.py --help`, also under `mpirun -n 2`; it takes some minutes. The lengths
of links from gmsh are those between the centres of their curves `left` and `right`.
"""

import math

import numpy as np
from command_line import bars, draw, leave, parse, run

import dolfinx_ffr as ffr

# %% Parameters
CRANK, GROUND = 0.1, 0.4  # radius of the crank, distance of its bearing from the disc's [m]
LINKS = {"coupler": (0.4, 0.04), "rocker": (0.3, 0.04)}  # length and height [m]
ALUMINIUM = ffr.PlaneStress(young=70e9, poisson=0.33, density=2700.0, thickness=0.01)
STEEL = ffr.PlaneStress(young=210e9, poisson=0.3, density=7850.0, thickness=0.006)
DISC, DISC_INERTIA, PIN = 1.0, 0.004, 0.1  # of the driven disc [kg], [kg m^2], of the pin [kg]
TURNS, DURATION = 3, 1.0  # [-], [s]
TIMES = ffr.TimeInterval(DURATION, 1e-3)  # steps by which psi is known to 1e-3
MODES, VOLUME = 6, 0.5  # of each link; upper bound, share of each link


# %% The scene
def four_bar(domains: dict[str, ffr.Domain], steps: int | None = None) -> ffr.Problem:
    """The linkage, with ``steps`` of generalised-alpha, or `TIMES`."""
    ends = [[d.interfaces[end].center for end in ("left", "right")] for d in domains.values()]
    coupler, rocker = (float(np.hypot(*(right - left))) for left, right in ends)
    d = GROUND - CRANK  # the crank starts along x; the pin of the links is where two circles meet
    along = (coupler**2 - rocker**2 + d**2) / (2.0 * d)
    across = math.sqrt(coupler**2 - along**2)
    turn = ffr.Motion.smooth_step(2 * np.pi * TURNS, DURATION, name="crank angle")
    crank = ffr.Moving.circle((0.0, 0.0), CRANK, turn)
    mechanism = ffr.Mechanism(
        placements={
            "coupler": ffr.Placement((CRANK, 0.0), math.atan2(across, along)),
            "rocker": ffr.Placement((GROUND, 0.0), math.atan2(across, along - d)),
            "disc": ffr.Placement((GROUND, 0.0)),
        },
        joints=[
            ffr.Revolute(("coupler", "left"), crank, name="crank pin"),
            ffr.Revolute(("coupler", "right"), ("rocker", "right"), name="pin"),
            ffr.Weld(("rocker", "left"), ("disc", "hub"), name="shaft"),
            ffr.Revolute(("disc", "hub"), ffr.Ground((GROUND, 0.0)), name="bearing"),
        ],
        point_masses=[ffr.PointMass(("rocker", "right"), PIN)],
    )
    chord, tangent = ffr.ChordFrame("left", "right"), ffr.TangentFrame("left")
    bodies = {
        "coupler": ffr.FlexibleBody(domains["coupler"], ALUMINIUM, frame=chord, modes=MODES),
        "rocker": ffr.FlexibleBody(domains["rocker"], STEEL, frame=tangent, modes=MODES),
        "disc": ffr.VolumeIntegrals.rigid(DISC, inertia=DISC_INERTIA, markers={"hub": (0.0, 0.0)}),
    }
    times = ffr.GeneralizedAlpha(DURATION, steps) if steps else TIMES
    problem = ffr.Problem(bodies, mechanism, times, ffr.IntegralCompliance(list(LINKS)))
    full = problem.value({name: np.ones(domain.n_cells) for name, domain in domains.items()})
    response = problem.response(full)  # each link counts by its compliance
    weights = {name: 1.0 / ffr.IntegralCompliance([name]).evaluate(response) for name in LINKS}
    problem.objective = ffr.IntegralCompliance(list(LINKS), weights)
    return problem


def main(arguments: list[str] | None = None) -> None:
    """Design both links, and leave numbers and pictures."""
    defaults = {"elements": (200, 20), "steps": None, "iterations": 60, "boundary": None}
    options = parse(arguments, "four_bar", **defaults, coupler_mesh="", rocker_mesh="")
    output, domains = options.output, bars(options, LINKS)
    problem = four_bar(domains, options.steps)

    # %% The designs, symmetric where the gradient says that the loads are, and their parts
    even = {k: np.where(d.design_cells, VOLUME, 1.0) for k, d in domains.items()}
    slope = problem.gradient(even).gradient
    mirrors = {name: ffr.mirror_lines(domain, slope[name]) for name, domain in domains.items()}
    designs = {name: ffr.LevelSet(domains[name], mirrors=lines) for name, lines in mirrors.items()}
    with ffr.recorded_warnings() as warnings:
        result = ffr.optimize(problem, designs, volume=VOLUME, **options.run)
        finished = result.finish(output)

    # %% Numbers and pictures
    draw(result, output, full=2.0, volume=VOLUME, time=0.35 * DURATION)
    # Finished parts have six tenths of the full links' compliance
    leave(options, result, "A four-bar linkage", 2.0, finished, warnings, most=2.0 * 0.6)


if __name__ == "__main__":
    run(main)
