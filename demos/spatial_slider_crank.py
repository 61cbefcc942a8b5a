# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A slider-crank in space, and its flexible rod designed.

What you will see: a crank turns about an axis that is skew to the way of a slider. The rod between
them hangs on a universal joint, bends in two planes at once, and finds its shape. The mechanism is
that of E. J. Haug (Computer Aided Kinematics and Dynamics of Mechanical Systems, 1989).

**Problem.** Find densities x that minimise

    psi = int q^T K q dt   such that   volume(x) <= 0.5,

where q are the elastic coordinates of the rod in its floating frame. The solid that the design
encloses is written for a printer, in millimetres. With `--elements 40 4 4 --iterations 30
--boundary 20` its surface is then moved by the exact gradient, with a least thickness of walls.

Run `python demos/spatial_slider_crank.py --help`, also under `mpirun -n 2`; it takes some minutes.
A mesh file has the physical surfaces `left` and `right`, as far apart as the rod is long.
"""

from mpi4py import MPI

import numpy as np
from command_line import draw, leave, parse, run

import dolfinx_ffr as ffr

# %% Parameters
ROD, SECTION = 0.3, (0.02, 0.016)  # length, height and width of the rod [m]
CRANK, CENTER = 0.08, (0.0, 0.1, 0.12)  # radius and bearing of the crank, its axis is x [m]
TURNS, DURATION, STEPS = 2, 0.3, 2000  # of the crank, time [s], of time
PLASTIC = ffr.Isotropic(young=3e9, poisson=0.35, density=1200.0)
SLIDER, VOLUME, MODES = 0.02, 0.5, 10  # mass [kg], bound of the filled share, of the rod
ANGLE = ffr.Motion.smooth_step(2 * np.pi * TURNS, DURATION, name="crank angle")  # from y [rad]


# %% The scene
def slider_of(angle: float) -> float:
    """Where the slider is on its line if the rod is rigid, at an angle of the crank from y [m]."""
    y, z = CENTER[1] + CRANK * np.cos(angle), CENTER[2] + CRANK * np.sin(angle)
    return float(np.sqrt(ROD**2 - y**2 - z**2))


def spatial_problem(
    comm: MPI.Comm,
    elements: tuple[int, int, int] = (80, 8, 8),
    *,
    domain: ffr.Domain | None = None,
    modes: int = MODES,
    steps: int = STEPS,
) -> ffr.Problem:
    """The slider-crank with a rod built in or on a given ``domain``."""
    if domain is None:
        domain = ffr.Domain.box(comm, ROD, *SECTION, elements=elements)
    rod = ffr.FlexibleBody(domain, PLASTIC, frame=ffr.ChordFrame("left", "right"), modes=modes)
    # the rod's x axis points to the slider, its y axis is across the crank's axis
    pin = np.add(CENTER, [0.0, CRANK, 0.0])
    along = (np.array([slider_of(0.0), 0.0, 0.0]) - pin) / ROD
    across = np.cross([1.0, 0.0, 0.0], along) / np.linalg.norm(along[1:])
    axes = np.column_stack([along, across, np.cross(along, across)])
    crank = ffr.Moving.circle(CENTER, CRANK, ANGLE, axis=(1.0, 0.0, 0.0))
    forks = {"axis": (0, 1, 0), "second_axis": (0, 0, 1)}  # the rod's y axis, the crank's axis
    mechanism = ffr.Mechanism(
        placements={"rod": ffr.Placement(tuple(pin), rotation=axes)},
        joints=[
            ffr.Universal(("rod", "left"), crank, **forks, name="pin"),
            ffr.PointOnLine(("rod", "right"), ffr.Ground(), direction=(1, 0, 0), name="slider"),
        ],
        point_masses=[ffr.PointMass(("rod", "right"), SLIDER)],
    )
    times = ffr.GeneralizedAlpha(DURATION, steps)
    return ffr.Problem({"rod": rod}, mechanism, times, ffr.IntegralCompliance())


def main(arguments: list[str] | None = None) -> None:
    """Design the rod, and leave numbers and pictures."""
    defaults = {"elements": (80, 8, 8), "steps": STEPS, "iterations": 60, "boundary": 0}
    options = parse(arguments, "spatial_slider_crank", **defaults, mesh="", resume=False)
    comm, output = MPI.COMM_WORLD, options.output
    own_mesh = ffr.Domain.from_gmsh(comm, options.mesh) if options.mesh else None
    problem = spatial_problem(comm, options.elements, domain=own_mesh, steps=options.steps)
    domain = problem.flexible["rod"].domain
    # with three points in each direction 69,120 elements had 190 million pairs of points and knots
    quadrature = 2 if domain.n_cells_global > 20_000 else None
    design = ffr.LevelSet(domain, quadrature=quadrature)
    with ffr.recorded_warnings() as warnings:
        result = ffr.optimize(problem, design, volume=VOLUME, **options.run)
        finished = result.finish(output)
    # a design may need more modes than the full rod, and is compared with the same ones
    full = result.problem.value(np.ones(domain.n_cells))

    # %% Numbers and pictures; walls thinner than half an element are in solid.png
    draw(result, output, full=full.psi, volume=VOLUME, color="energy")
    stress = ffr.worst_stress(result.problem.flexible["rod"], result.evaluation, "rod")
    ffr.plotting.plot_stress(domain, stress, output / "stress.png")
    title = "The flexible rod of a slider-crank in space"
    leave(options, result, title, full.psi, finished, warnings)

    # %% The slider of the full rod is where that of a rigid one is
    rigid = [[slider_of(angle), 0.0, 0.0] for angle in ANGLE.tabulate(full.trajectory.t)[0]]
    deviation = float(np.abs(full.trajectory.marker_path("rod", "right") - rigid).max())
    assert deviation < 1e-3 * ROD, f"the slider is {deviation} m from where it should be"


if __name__ == "__main__":
    run(main)
