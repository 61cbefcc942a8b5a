# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A slider-crank in space, and its flexible rod designed.

What you will see: a crank turns about an axis that is skew to the way of a slider. The rod between
them is joined to the crank by a universal joint and bends in two planes at once; its shape is found
by its inertia and that of the slider.

The crank of 80 mm turns about x at (0, 0.1, 0.12) m, twice in 0.3 s, from rest to rest; the slider
of 20 g runs along x, and the rod is 0.3 m long (E. J. Haug's mechanism, Computer Aided Kinematics
and Dynamics of Mechanical Systems, Allyn and Bacon 1989).

**Problem.** Find densities x that minimise

    psi = int q^T K q dt   such that   volume(x) <= 0.5,

where q are the elastic coordinates of the rod in its floating frame, which moves by
M(A, q) v' + ... + C_y^T lambda = 0, C(R, A, q, t) = 0, with the rotation matrix A of the frame.

**Discretisation.** Trilinear hexahedra, SIMP with exponent 3; a chord frame, six constraint modes
and ten normal modes; 2000 steps of generalised-alpha on the group of rotations. A level set out of
an even gray, by the method of moving asymptotes with the exact gradient.

Run it with

    python demos/spatial_slider_crank.py [--elements NX NY NZ] [--steps N] [--iterations N]
                                         [--mesh FILE] [--output DIR]

also under `mpirun -n 2`; it takes some minutes. A mesh file has the physical surfaces `left`
and `right`, whose centres are as far apart as the rod is long.
"""

# %% Imports
from __future__ import annotations

import argparse
from importlib.metadata import version
from pathlib import Path
from time import perf_counter

from mpi4py import MPI

import numpy as np

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.program import run
from dolfinx_ffr.verification import central_difference

# %% Parameters
ROD, SECTION = 0.3, (0.02, 0.016)  # length, height and width of the rod [m]
CRANK, CENTER = 0.08, (0.0, 0.1, 0.12)  # radius and bearing of the crank, its axis is x [m]
SLIDER = 0.02  # mass [kg]
TURNS, DURATION = 2, 0.3  # of the crank, time [s]
PLASTIC = ffr.Isotropic(young=3e9, poisson=0.35, density=1200.0)
VOLUME = 0.5  # bound of the filled share
MODES, STEPS = 10, 2000


# %% The scene
def crank_angle() -> ffr.Motion:
    """Of the crank from y, about x [rad]."""
    return ffr.Motion.smooth_step(2 * np.pi * TURNS, DURATION, name="crank angle")


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
    """The slider-crank with a rod on a built-in or a given mesh.

    Args:
        comm: Communicator over which the mesh is distributed.
        elements: Of the built-in rod, along x, y and z.
        domain: A mesh with the interfaces ``"left"`` (crank) and ``"right"`` (slider) instead.
        modes: Number of normal modes.
        steps: Number of time steps.
    """
    if domain is None:
        domain = ffr.Domain.box(comm, ROD, *SECTION, elements=elements)
    rod = ffr.FlexibleBody(domain, PLASTIC, frame=ffr.ChordFrame("left", "right"), modes=modes)
    # the rod's x axis points to the slider, its y axis is across the crank's axis
    pin = np.array([CENTER[0], CENTER[1] + CRANK, CENTER[2]])
    along = (np.array([slider_of(0.0), 0.0, 0.0]) - pin) / ROD
    across = np.cross([1.0, 0.0, 0.0], along)
    across /= np.linalg.norm(across)
    axes = np.column_stack([along, across, np.cross(along, across)])
    crank = ffr.Moving.circle(CENTER, CRANK, crank_angle(), axis=(1.0, 0.0, 0.0))
    mechanism = ffr.Mechanism(
        placements={"rod": ffr.Placement(tuple(pin), rotation=axes)},
        joints=[
            # its forks: the rod's y axis, and the axis of the crank
            ffr.Universal(
                ("rod", "left"), crank, axis=(0, 1, 0), second_axis=(0, 0, 1), name="pin"
            ),
            ffr.PointOnLine(("rod", "right"), ffr.Ground(), direction=(1, 0, 0), name="slider"),
        ],
        point_masses=[ffr.PointMass(("rod", "right"), SLIDER)],
    )
    integrator = ffr.GeneralizedAlpha(DURATION, steps)
    return ffr.Problem({"rod": rod}, mechanism, integrator, ffr.IntegralCompliance())


# %% The program
def main(arguments: list[str] | None = None) -> None:
    """Design the rod, and leave numbers and pictures."""
    options = parse(arguments)
    comm = MPI.COMM_WORLD
    output = Path(options.output)
    start_time = perf_counter()
    say = print if comm.rank == 0 else lambda *_: None

    domain = None
    if options.mesh:
        domain = ffr.Domain.from_gmsh(comm, options.mesh)
    elements = tuple(options.elements)
    problem = spatial_problem(comm, elements, domain=domain, steps=options.steps)
    domain = problem.flexible["rod"].domain
    say(
        f"rod of {domain.n_cells_global} elements, {problem.flexible['rod'].n_elastic} elastic "
        f"coordinates, {options.steps} steps, {comm.size} rank(s), "
        f"DOLFINx {version('fenics-dolfinx')}"
    )
    full = problem.value(np.ones(domain.n_cells))
    path = full.motion.marker_path("rod", "right")
    angles = np.asarray(crank_angle().value(full.motion.t))
    rigid = np.array([slider_of(angle) for angle in angles])
    stretch = float(np.max(np.abs(path[:, 0] - rigid)))
    say(f"the slider is at most {1e6 * stretch:.1f} um from where that of a rigid rod is")

    # %% The gradient beside a central difference
    even = np.where(domain.design_cells, 0.5, 1.0)
    gradient = problem.gradient(even).gradient
    assert gradient is not None
    c = domain.centroids
    direction = np.cos(40 * c @ [1.0, 2.0, 3.0]) * domain.design_cells
    slope = comm.allreduce(float(gradient["rod"] @ direction))
    difference = central_difference(lambda x: problem.value(x).psi, even, direction, 1e-3)
    say(f"derivative along a direction {slope:.8e}, central difference {difference:.8e}")

    # %% The design
    levelset = ffr.LevelSet(domain)
    with ffr.recorded_warnings() as warnings:
        result = ffr.optimize(
            problem,
            levelset,
            volume=VOLUME,
            iterations=options.iterations,
            output=output,
            resume=options.resume,
        )
        verified = result.finish(output)
    # a design may need more modes than the full rod, and is compared with the same ones
    solid = result.problem.value(np.ones(domain.n_cells)).psi
    enclosed = result.solid()

    # %% Numbers and pictures
    ffr.write_density(domain, result.x, output / "design.xdmf")
    share = result.evaluation.volume["rod"]
    # walls thinner than half an element are in solid.png
    heading = f"densities above 1/2: {100 * result.psi / solid:.1f} % of the full rod's compliance"
    heading += f" with {100 * share:.0f} % of its material"
    plotting.plot_design(domain, {heading: result.x}, output / "design.png")
    plotting.plot_history(
        result.history, output / "history.png", psi_solid=solid, volume_bound=VOLUME, comm=comm
    )
    rod = result.problem.flexible["rod"]
    plotting.plot_modes(rod, result.evaluation.bodies["rod"], output / "modes.png")
    stress = ffr.worst_stress(rod, result.evaluation, "rod")
    plotting.plot_stress(domain, stress, output / "stress.png")
    plotting.plot_scene(result.problem, result.evaluation, output / "scene.png", color="energy")
    plotting.animate_motion(result.problem, result.evaluation, output / "motion.gif")
    summary = {
        "compliance_full": full.psi,
        "compliance_final": result.psi,
        "compliance_final_relative": result.psi / solid,
        "volume_fraction": share,
        **({} if verified is None else verified.record()),
        "solid_volume": enclosed.volume,
        "solid_mass": enclosed.mass,
        "solid_pieces": enclosed.pieces,
        "gradient": slope,
        "central_difference": difference,
        "slider_deviation": stretch,
        **ffr.run_record(
            result,
            title="The flexible rod of a slider-crank in space",
            verification=verified,
            warnings=warnings,
            references={"full rod": full.psi},
            volume=VOLUME,
        ),
        "seconds_total": perf_counter() - start_time,
    }
    ffr.write_summary(comm, output / "summary.json", summary)
    ffr.write_report(comm, output)
    say(f"{result.reason} after {result.iterations} iterations")
    say(f"  full rod {full.psi:.4e} J s")
    say(f"  design   {result.psi:.4e} J s   {result.psi / solid:6.3f} of the full rod")
    say(f"  solid: {enclosed.pieces} piece, {1e3 * enclosed.mass:.2f} g")
    say(str(verified or "no solid of this design can be moved"))
    say(f"pictures and numbers are in {output}")

    # %% What must hold
    assert abs(slope / difference - 1.0) < 1e-4, f"{slope} is not {difference}"
    assert stretch < 1e-3 * ROD, f"the slider is {stretch} m from where it should be"
    assert np.max(np.abs(path[:, 1:])) < 1e-12, "the slider has left its line"
    fine = options.mesh is None and domain.n_cells_global >= FINE
    if not fine or options.iterations < ENOUGH or result.reason == "interrupted":
        say("no finished design of the reference scene: its marks are not asserted")
        return
    assert result.feasible, f"volume {share} above its bound {VOLUME}"
    assert enclosed.pieces == 1, "the solid has fallen to pieces"
    assert verified is not None and abs(verified.difference) < 0.05, "psi is not that of the solid"
    assert result.psi < 0.25 * solid, f"psi is {result.psi / solid:.3f} of the full rod's"


#: Iterations and elements from which on a design counts as finished
ENOUGH, FINE = 60, 5000


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Design the rod of a slider-crank in space.")
    parser.add_argument(
        "--elements", nargs=3, type=int, default=[80, 8, 8], metavar=("NX", "NY", "NZ")
    )
    parser.add_argument("--steps", type=int, default=STEPS, help=f"(default {STEPS})")
    parser.add_argument("--iterations", type=int, default=60, help="at most (default 60)")
    parser.add_argument("--mesh", help="gmsh file with the physical surfaces 'left' and 'right'")
    parser.add_argument(
        "--output", default="results/spatial_slider_crank", help="folder for the results"
    )
    parser.add_argument("--resume", action="store_true", help="go on from the last checkpoint")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    run(main)
