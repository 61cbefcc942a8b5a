# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A connecting rod with two bearings, designed under its own motion.

What you will see: a rod drawn in gmsh, with a large and a small bearing eye and fillets, finds its
shape. It is shown in motion, with the largest stress that each of its elements sees.

The mechanism is that of `slider_crank.py`, psi the integral compliance, the bound half of the rod.
The bores are rigid interfaces: each pin sits in the centre of its eye, where there is no material,
and moves as the whole bore does. A ring around each bore stays solid. Triangles are of order two,
with curved sides at bores and fillets.

Run `python demos/connecting_rod.py --help`, also under `mpirun -n 2`; it takes about a minute. A
planar mesh with physical curves "left" and "right" takes the rod's place: `--mesh my_rod.msh`.
"""

from mpi4py import MPI

import numpy as np
from command_line import draw, leave, parse, run, say
from meshes.connecting_rod import ConnectingRod
from slider_crank import VOLUME, reference_problem

import dolfinx_ffr as ffr

# %% Parameters
SIZE = 0.004  # of the elements [m]
STEPS = 2000  # close enough to each other to show the largest stress


def main(arguments: list[str] | None = None) -> None:
    """Design the rod, and leave numbers and pictures."""
    defaults = {"size": SIZE, "order": 2, "iterations": 60, "mesh": "", "resume": False}
    options = parse(arguments, "connecting_rod", **defaults, boundary=None)
    comm, output = MPI.COMM_WORLD, options.output
    if options.mesh:
        domain = ffr.Domain.from_gmsh(comm, options.mesh, order=options.order)
    else:
        order = {"order": min(options.order, 2), "degree": options.order}
        domain = ConnectingRod().domain(comm, options.size, **order)
    problem = reference_problem(comm, domain=domain, steps=STEPS)

    # %% The design, symmetric; members as wide as the largest elements, not as those at the bores
    largest = comm.allreduce(float(np.sqrt(domain.cell_volumes.max(initial=0.0))), MPI.MAX)
    even = problem.gradient(np.where(domain.design_cells, VOLUME, 1.0)).gradient
    mirrors = ffr.mirror_lines(domain, even["rod"])
    levelset = ffr.LevelSet(domain, minimum_member=1.3 * largest, mirrors=mirrors)
    with ffr.recorded_warnings() as warnings:
        start = levelset.with_holes(8, 2, 0.007)  # an even gray ends 1 % softer
        result = ffr.optimize(problem, levelset, start, volume=VOLUME, **options.run)
        finished = result.finish(output)
    # a design may need more modes than the full rod, and is compared with the same ones
    solid = result.problem.value(np.ones(domain.n_cells))

    # %% Numbers and pictures of the part
    draw(result, output, full=solid.psi, volume=VOLUME)
    final_problem, evaluation = result.final
    rod, full_rod = final_problem.flexible["rod"], result.problem.flexible["rod"]
    worst, full = ffr.worst_stress(rod, evaluation, "rod"), ffr.worst_stress(full_rod, solid, "rod")
    ffr.write_fields(rod.domain, {"von_mises": worst.stress}, output / "stress.xdmf")
    # without steps of the boundary these are the elements of the design
    last_shape = "part" if result.moved else "design"
    for name, shape, body, stress in (
        ("full_rod", "full rod", full_rod, full),
        ("part", last_shape, rod, worst),
    ):
        title = f"{shape}: largest stress of each element during the motion"
        ffr.plotting.plot_stress(body.domain, stress, output / f"stress_{name}.png", title=title)
    ffr.plotting.plot_modes(rod, evaluation.bodies["rod"], output / "modes.png")
    say(f"largest stress {worst.largest:.3e} Pa, that of the full rod {full.largest:.3e} Pa")
    stresses = {"stress_solid": full.largest, "stress_final": worst.largest}
    title, most = "A rod with two bearings", 0.55 * solid.psi
    leave(options, result, title, solid.psi, finished, warnings, most=most, **stresses)


if __name__ == "__main__":
    run(main)
