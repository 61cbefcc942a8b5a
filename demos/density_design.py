# SPDX-License-Identifier: MIT
# %% [markdown]
"""# Densities in place of a level set.

What you will see: the flexible rod of `slider_crank.py`, designed by a density for each element
instead of a level set on knots, by the same exact gradient.

**Problem.** As in `slider_crank.py`: min psi(x) such that volume(x) <= 0.5, with a variable z in
[0, 1] for each element,

    x = projection(filter(z)),

an even gray at first. The filter averages over some elements, so that none stands alone; the
projection becomes steeper along the run, so that densities end as void or solid. The variables are
updated by the method of moving asymptotes. The part's boundary is where a smooth mean of the
densities is one half, and psi is computed again on a mesh that fits it.

Run `python demos/density_design.py --help`, also under `mpirun -n 2`; it takes about a
minute.
"""

from mpi4py import MPI

import numpy as np
from command_line import draw, leave, mark, parse
from slider_crank import VOLUME, reference_problem

import dolfinx_ffr as ffr
from dolfinx_ffr.program import run


# %% The program
def main(arguments: list[str] | None = None) -> None:
    """Design the rod, and leave numbers and pictures."""
    options = parse(arguments, "density_design", elements=(200, 20), iterations=60, mesh="")
    comm, output = MPI.COMM_WORLD, options.output
    given = ffr.Domain.from_gmsh(comm, options.mesh) if options.mesh else None
    problem = reference_problem(comm, options.elements, domain=given)
    domain = problem.flexible["rod"].domain
    design = ffr.DensityDesign(domain)
    with ffr.recorded_warnings() as warnings:
        result = ffr.optimize(problem, design, design.even(VOLUME), volume=VOLUME, **options.run)
        found = result.finish(output)
    full = result.problem.value(np.ones(domain.n_cells)).psi

    # %% Numbers and pictures
    draw(result, output, full=full, volume=VOLUME)
    title = "A rod designed by densities"
    leave(result, output, title, full=full, found=found, warnings=warnings)

    # %% The finished part comes near to that of the level set; others are better than an even gray
    reached, bound = mark(options, result, found, 0.55 * full)
    assert reached <= bound, f"psi is {reached / full:.3f} of the full rod's"


if __name__ == "__main__":
    run(main)
