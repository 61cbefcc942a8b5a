# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A blade that spins about an axis that is not its own, with geometric stiffening.

What you will see: a flat blade with a weight at its end sits askew on a hub, runs up and stops. The
pull of its inertia stiffens it, which a linear model misses, and a design's gradient knows.

**Problem.** Find densities x that minimise

    psi = int q^T K q dt   such that   volume(x) <= 0.5,

where q are the elastic coordinates of the blade in the frame of its root, which turns with the hub;
their stiffness is K + sum_kl B_kl K^kl with B = [alpha] + [omega]^2, the geometric stiffness by the
nine loads of rotation.

Run `python demos/spatial_blade.py --help`, also under `mpirun -n 2`; it takes some minutes.
"""

from mpi4py import MPI

import numpy as np
from command_line import draw, leave, parse, run, say

import dolfinx_ffr as ffr

# %% Parameters
BLADE = (0.3, 0.06, 0.008)  # length, width and thickness of the blade [m]
PLASTIC = ffr.Isotropic(young=3e9, poisson=0.35, density=1200.0)
TILT, PITCH = 0.3, 0.5  # of the blade out of the plane of rotation and about its length [rad]
TIP = 0.03  # mass of what it carries at its end [kg]
TURNS, DURATION = 4, 1.0  # of the hub, from rest to rest; time [s]
VOLUME, MODES, STEPS = 0.5, 8, 1000  # bound of the filled share, and numbers


# %% The scene
def blade_problem(
    comm: MPI.Comm, elements: tuple[int, int, int], *, stiffening: bool = True, steps: int = STEPS
) -> ffr.Problem:
    """The blade on its hub, with ``elements`` along, across and over the thickness."""
    box = ffr.Domain.box(comm, *BLADE, elements=elements, order=2)
    ends = {"root": box.interfaces["left"].facets, "tip": box.interfaces["right"].facets}
    settings = {"frame": ffr.TangentFrame("root"), "stiffening": ["rotation"] if stiffening else []}
    domain = ffr.Domain(box.mesh, ends, box.solid_cells, order=2)
    blade = ffr.FlexibleBody(domain, PLASTIC, modes=MODES, **settings)
    fixed = ffr.Motion.constant(0.0)
    turn = ffr.Motion.smooth_step(2 * np.pi * TURNS, DURATION, name="hub")
    hub = ffr.Moving(fixed, fixed, turn, z=fixed, axis=(0, 0, 1), name="hub")
    c, s, a, b = np.cos(TILT), np.sin(TILT), np.cos(PITCH), np.sin(PITCH)
    tilted = [[c, -s * b, -s * a], [0, a, -b], [s, c * b, c * a]]
    mechanism = ffr.Mechanism(
        placements={"blade": ffr.Placement((0, 0, 0), rotation=np.array(tilted))},
        joints=[ffr.Weld(("blade", "root"), hub, name="hub")],
        point_masses=[ffr.PointMass(("blade", "tip"), TIP)],
    )
    times = ffr.GeneralizedAlpha(DURATION, steps)
    return ffr.Problem({"blade": blade}, mechanism, times, ffr.IntegralCompliance())


def main(arguments: list[str] | None = None) -> None:
    """Design the blade, and leave numbers and pictures."""
    options = parse(arguments, "spatial_blade", elements=(40, 8, 1), steps=STEPS, iterations=60)
    comm, output = MPI.COMM_WORLD, options.output
    problem = blade_problem(comm, options.elements, steps=options.steps)
    domain = problem.flexible["blade"].domain
    motion = problem.value(np.ones(domain.n_cells)).trajectory
    across = motion.model.bodies["blade"].markers["tip"].displacement[2]
    bent = float(np.abs(motion.elastic("blade") @ across).max())
    say(f"the tip of the full blade bends by {1e3 * bent:.2f} mm")
    with ffr.recorded_warnings() as warnings:
        result = ffr.optimize(problem, ffr.DensityDesign(domain), volume=VOLUME, **options.run)
        finished = result.finish(output, most=3)
    full, enclosed = result.problem.value(np.ones(domain.n_cells)).psi, result.part()

    # %% Numbers and pictures
    draw(result, output, full=full, color="energy")
    numbers = {"bending": bent, "solid_mass": enclosed.mass, "solid_pieces": enclosed.pieces}
    # A finished design of half of the material is stiffer than the full blade, which pulls more
    leave(options, result, "A blade on a hub", full, finished, warnings, **numbers, most=0.8 * full)


if __name__ == "__main__":
    run(main)
