# SPDX-License-Identifier: MIT
# %% [markdown]
"""# The flexible rod of a slider-crank, designed under its own motion.

What you will see: a connecting rod of 200 x 20 elements that finds its shape, with the exact
gradient with respect to every element; its part, whose boundary moves on by the exact gradient
with respect to every node of meshes that fit it, as files for CAD; and the rod in motion.

A crank turns five times in two seconds, from rest to rest. It drives a steel rod whose other end
carries a slider along a straight line. The load on the rod is inertia, its own and the slider's.

**Problem.** Find the level set alpha that minimises the rod's integral compliance

    psi = int_0^T q^T K_e q dt      such that      volume(x(alpha)) <= 0.5,

with the density x of the elements and the elastic coordinates q of the rod in its floating frame of
reference: M(y) y'' + ... + C_y^T lambda = 0, C(y, t) = 0.

The time steps are those by which psi is known to 1e-4, 50 of the Radau IIA method. `--densities`
designs a density for each element in place of the level set: x = projection(filter(z)) with z in
[0, 1]; the projection becomes steeper along the run, so that densities end as void or solid.

Run it with `make demo`, or see `python demos/slider_crank.py --help`; also under `mpirun -n 2`; it
takes about a minute. `--iterations 30 --boundary 8 --bare` has a part that is hardly worse, and no
pictures, in less than half of that.
"""

from contextlib import suppress
from time import perf_counter
from typing import Any

from mpi4py import MPI

import numpy as np
from command_line import draw, leave, parse, run, say
from numpy.typing import NDArray

import dolfinx_ffr as ffr

# %% Parameters
LENGTH, HEIGHT, THICKNESS = 0.4, 0.04, 0.01  # of the rod [m]
STEEL = ffr.PlaneStress(young=210e9, poisson=0.3, density=7850.0, thickness=THICKNESS)
CRANK = 0.1  # radius [m]
SLIDER = 0.5  # mass [kg]
TURNS, DURATION = 5, 2.0  # [-], [s]
MODES = 8
VOLUME = 0.5  # upper bound, share of the rod


# %% The scene
def slider_crank(duration: float, slider: float, turns: int = TURNS, **more: Any) -> ffr.Mechanism:
    """The mechanism: some turns in ``duration`` [s] with a ``slider`` of a mass [kg]."""
    angle = ffr.Motion.smooth_step(2 * np.pi * turns, duration, name="crank angle")
    crank = ffr.Moving.circle((0.0, 0.0), CRANK, angle)
    return ffr.Mechanism(
        placements={"rod": ffr.Placement(position=(CRANK, 0.0))},
        joints=[
            ffr.Revolute(("rod", "left"), crank, name="crank pin"),
            ffr.PointOnLine(("rod", "right"), ffr.Ground(), name="slider"),
        ],
        point_masses=[ffr.PointMass(("rod", "right"), slider)] if slider else [],
        **more,
    )


def reference_problem(
    comm: MPI.Comm,
    elements: tuple[int, int] = (200, 20),
    *,
    domain: ffr.Domain | None = None,
    modes: int = MODES,
    steps: int | None = None,
    **mesh: Any,
) -> ffr.Problem:
    """The rod on a ``domain``, or a ``mesh`` of its own; ``steps`` to take, or psi to 1e-4."""
    if domain is None:
        domain = ffr.Domain.rectangle(comm, LENGTH, HEIGHT, elements=elements, **mesh)
    rod = ffr.FlexibleBody(domain, STEEL, frame=ffr.ChordFrame("left", "right"), modes=modes)
    times = ffr.GeneralizedAlpha(DURATION, steps) if steps else ffr.TimeInterval(DURATION)
    mechanism = slider_crank(DURATION, SLIDER)
    return ffr.Problem({"rod": rod}, mechanism, times, ffr.IntegralCompliance())


def simple_designs(domain: ffr.Domain) -> dict[str, NDArray[np.float64]]:
    """The full rod, and an even density, a strip and two flanges of half of it, (cells,) each."""
    low, high = domain.bounding_box
    offset = np.abs(domain.centroids[:, 1] - 0.5 * (low[1] + high[1])) / (high[1] - low[1])
    shapes = {
        "solid": np.ones(domain.n_cells),
        "even": np.full(domain.n_cells, VOLUME),
        "strip": np.where(offset < 0.25, 1.0, 0.0),
        "flanges": np.where(offset > 0.25, 1.0, 0.0),
    }
    return {name: np.where(domain.design_cells, x, 1.0) for name, x in shapes.items()}


def main(arguments: list[str] | None = None) -> None:
    """Design the rod, and leave numbers and pictures."""
    defaults = {"elements": (200, 20), "iterations": 36, "steps": None, "order": 1}
    defaults |= {"mesh": "", "boundary": None, "resume": False, "bare": False, "densities": False}
    options = parse(arguments, "slider_crank", **defaults)
    comm, output, start = MPI.COMM_WORLD, options.output, perf_counter()
    own_mesh = (
        ffr.Domain.from_gmsh(comm, options.mesh, order=options.order) if options.mesh else None
    )
    settings = {"order": options.order, "steps": options.steps}
    problem = reference_problem(comm, options.elements, domain=own_mesh, **settings)
    domain = problem.flexible["rod"].domain
    simple = simple_designs(domain)
    compliance: dict[str, float] = {}
    for name, x in () if options.bare else simple.items():
        with suppress(ffr.SimulationError):  # on a mesh of another shape a strip may hold nothing
            compliance[name] = problem.value(x).psi

    # %% The design: out of an even gray, symmetric where the gradient says that the loads are
    even = problem.gradient(simple["even"])
    say(f"{domain.n_cells_global} elements; even gray: {ffr.model_report(problem, even)}")
    level = ffr.LevelSet(domain, mirrors=ffr.mirror_lines(domain, even.gradient["rod"]))
    design = ffr.DensityDesign(domain) if options.densities else level
    with ffr.recorded_warnings() as warnings:
        result = ffr.optimize(problem, design, volume=VOLUME, **options.run)
        # the part: files for CAD, pictures, and psi on meshes that fit it
        checked = result.verify() if options.bare else result.finish(output)
    # a design may need more modes than the full rod, and is compared with the same ones
    final_problem, evaluation = result.final
    rod = final_problem.flexible["rod"]
    solid = result.problem.with_modes({"rod": rod.modes}).value(simple["solid"]).psi
    if options.bare and checked:
        files = result.part().write(output)
        return say(f"psi is {checked.psi / solid:.3f} of the full rod's", checked, *files, sep="\n")

    # %% Numbers and pictures
    draw(result, output, full=solid, volume=VOLUME)
    ffr.plotting.plot_modes(rod, evaluation.bodies["rod"], output / "modes.png")
    numbers: dict[str, Any] = {f"compliance_{name}": psi for name, psi in compliance.items()}
    numbers |= {"steps": problem.integrator.steps, "seconds_total": perf_counter() - start}
    numbers |= {"references": compliance, "most": (0.55 if options.densities else 0.49) * solid}
    leave(
        options, result, "The flexible rod of a slider-crank", solid, checked, warnings, **numbers
    )


if __name__ == "__main__":
    run(main)
