# SPDX-License-Identifier: MIT
# %% [markdown]
"""# The flexible rod of a slider-crank, designed under its own motion.

What you will see: a connecting rod of 200 x 20 elements that finds its shape, with the exact
gradient with respect to every element in every iteration; the part that comes of it, as files for
CAD and computed again on a mesh that fits its boundary; and the finished rod in motion.

A crank of 0.1 m turns five times in two seconds, from rest to rest. It drives a steel rod of
0.4 m x 0.04 m x 0.01 m, whose other end carries a slider of 0.5 kg along a straight line. The load
on the rod is inertia, its own and the slider's, so that it changes with the rod's shape.

**Problem.** Find the level set alpha that minimises the rod's integral compliance

    psi = int_0^T q^T K_e q dt      such that      volume(x(alpha)) <= 0.5,

where x is the density of the elements and q are the elastic coordinates of the rod in its floating
frame of reference: M(y) y'' + ... + C_y^T lambda = 0, C(y, t) = 0.

**Discretisation.** Bilinear quadrilaterals in plane stress, SIMP with exponent 3; chord frame with
three constraint modes and eight normal modes; equal time steps by which psi is known to 1e-4, which
are 50 of the Radau IIA method (of generalised-alpha it takes more than 2000, `--steps 2000`). The
gradient is that of the discrete problem.

Run it with `make demo`, or

    python demos/slider_crank.py [--elements NX NY] [--iterations N] [--mesh FILE] [--order P]
                                 [--steps N] [--output DIR]

also under `mpirun -n 2`.
"""

# %% Imports
from __future__ import annotations

import argparse
from importlib.metadata import version
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.program import run

# %% Parameters
LENGTH, HEIGHT, THICKNESS = 0.4, 0.04, 0.01  # of the rod [m]
STEEL = ffr.PlaneStress(young=210e9, poisson=0.3, density=7850.0, thickness=THICKNESS)
CRANK = 0.1  # radius [m]
SLIDER = 0.5  # mass [kg]
TURNS, DURATION = 5, 2.0  # [-], [s]
MODES = 8
VOLUME = 0.5  # upper bound, share of the rod


# %% The scene
def reference_problem(
    comm: MPI.Comm,
    elements: tuple[int, int] = (200, 20),
    *,
    cell: str = "quadrilateral",
    order: int = 1,
    domain: ffr.Domain | None = None,
    modes: int = MODES,
    steps: int | None = None,
) -> ffr.Problem:
    """The slider-crank with a rod on a built-in or a given mesh.

    Args:
        comm: Communicator over which the mesh is distributed.
        elements: Of the built-in rod, along and across.
        cell: Of the built-in rod, ``"quadrilateral"`` or ``"triangle"``.
        order: Polynomial order of the displacements of the built-in rod.
        domain: A mesh with the interfaces ``"left"`` (crank) and ``"right"`` (slider) instead.
        modes: Number of normal modes.
        steps: Number of time steps of generalised-alpha; by default method and number are those
            that give psi to 1e-4.
    """
    if domain is None:
        domain = ffr.Domain.rectangle(
            comm, LENGTH, HEIGHT, elements=elements, cell=cell, order=order
        )
    rod = ffr.FlexibleBody(domain, STEEL, frame=ffr.ChordFrame("left", "right"), modes=modes)
    crank_angle = ffr.Motion.smooth_step(2 * np.pi * TURNS, DURATION, name="crank angle")
    mechanism = ffr.Mechanism(
        placements={"rod": ffr.Placement(position=(CRANK, 0.0))},
        joints=[
            ffr.Revolute(
                ("rod", "left"), ffr.Moving.circle((0.0, 0.0), CRANK, crank_angle), name="crank pin"
            ),
            ffr.PointOnLine(("rod", "right"), ffr.Ground(), name="slider"),
        ],
        point_masses=[ffr.PointMass(("rod", "right"), SLIDER)],
    )
    integrator = (
        ffr.TimeInterval(DURATION) if steps is None else ffr.GeneralizedAlpha(DURATION, steps)
    )
    return ffr.Problem({"rod": rod}, mechanism, integrator, ffr.IntegralCompliance())


# %% Designs to compare with
def simple_designs(domain: ffr.Domain) -> dict[str, NDArray[np.float64]]:
    """The full rod, an even density, a strip and two flanges, shape (cells,) each.

    All but the full rod fill half of the region that is designed.
    """
    low, high = domain.bounding_box
    offset = np.abs(domain.centroids[:, 1] - 0.5 * (low[1] + high[1])) / (high[1] - low[1])
    shapes = {
        "solid": np.ones(domain.n_cells),
        "even": np.full(domain.n_cells, VOLUME),
        "strip": np.where(offset < 0.25, 1.0, 0.0),
        "flanges": np.where(offset > 0.25, 1.0, 0.0),
    }
    return {name: np.where(domain.design_cells, x, 1.0) for name, x in shapes.items()}


def asymmetry(levelset: ffr.LevelSet, coefficients: NDArray[np.float64]) -> float:
    """The largest difference of the field, which is between 0 and 1, from its mirror image."""
    low, high = levelset.domain.bounding_box
    field = levelset.level(coefficients)
    x, y = (np.linspace(low[k], high[k], n) for k, n in ((0, 801), (1, 81)))
    points = np.column_stack([part.ravel() for part in np.meshgrid(x, y, indexing="ij")])
    return max(
        (
            float(np.abs(field(points) - field(mirror.reflection(points))).max())
            for mirror in levelset.mirrors
        ),
        default=float("inf"),
    )


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
        domain = ffr.Domain.from_gmsh(comm, options.mesh, order=options.order)
    problem = reference_problem(
        comm, tuple(options.elements), order=options.order, domain=domain, steps=options.steps
    )
    domain = problem.flexible["rod"].domain
    say(
        f"rod of {domain.n_cells_global} elements, {problem.flexible['rod'].n_elastic} elastic "
        f"coordinates, {problem.integrator.times.size - 1} steps, {comm.size} rank(s), "
        f"DOLFINx {version('fenics-dolfinx')}"
    )
    compliance = {}
    for name, x in simple_designs(domain).items():
        try:
            compliance[name] = problem.value(x).psi
        except ffr.SimulationError:  # on a mesh of another shape a strip may hold nothing
            compliance[name] = float("inf")
    solid = compliance["solid"]
    full = problem.value(simple_designs(domain)["solid"])
    say(f"full rod: {ffr.model_report(problem, full)}")

    # %% The design: out of an even gray, symmetric where the gradient says that the loads are
    even = problem.gradient(simple_designs(domain)["even"])
    assert even.gradient is not None
    mirrors = ffr.mirror_lines(domain, even.gradient["rod"])
    levelset = ffr.LevelSet(domain, mirrors=mirrors)
    x_start = levelset.at(0.0).density(levelset.even())
    clock = Clock()
    with ffr.recorded_warnings() as warnings:
        result = ffr.optimize(
            problem,
            levelset,
            volume=VOLUME,
            iterations=options.iterations,
            output=output,
            resume=options.resume,
        )
        clock.lap("design")
        # the part that it encloses: files for CAD, and psi on meshes that fit its boundary
        found = result.finish(output)
        clock.lap("part")
    gray = ffr.gray_fraction(domain, result.x)
    volume = result.evaluation.volume["rod"]
    mirrored = asymmetry(levelset, result.coefficients)
    # a design may need more modes than the full rod, and is compared with the same ones
    solid = result.problem.value(simple_designs(domain)["solid"]).psi

    # %% Numbers and pictures
    ffr.write_density(domain, result.x, output / "design.xdmf")
    plotting.plot_design(
        domain,
        {
            "start": x_start,
            f"design: {100 * result.psi / solid:.1f} % of the full rod's compliance with "
            f"{100 * volume:.0f} % of its material": result.x,
        },
        output / "design.png",
    )
    plotting.plot_history(
        result.history, output / "history.png", psi_solid=solid, volume_bound=VOLUME, comm=comm
    )
    plotting.plot_modes(
        problem.flexible["rod"], result.evaluation.bodies["rod"], output / "modes.png"
    )
    plotting.plot_crank_motion(result.evaluation.trajectory, output / "crank_motion.png", comm=comm)
    plotting.plot_scene(problem, result.evaluation, output / "scene.png")
    plotting.animate_motion(problem, result.evaluation, output / "motion.gif")
    clock.lap("pictures")
    summary = {
        "compliance_initial": float(result.history["psi"][0]),
        "compliance_final": result.psi,
        **{f"compliance_{name}": psi for name, psi in compliance.items()},
        "compliance_final_relative": result.psi / solid,
        "compliance_solid_same_modes": solid,
        **(part_record(found, solid) if found else {}),
        "volume_fraction": volume,
        "gray_fraction": gray,
        "asymmetry": mirrored,
        "first_fixed_interface_frequency": float(
            result.evaluation.fixed_interface_frequencies["rod"][0]
        ),
        **ffr.run_record(
            result,
            title="The flexible rod of a slider-crank",
            warnings=warnings,
            references={"full rod" if n == "solid" else n: psi for n, psi in compliance.items()},
            volume=VOLUME,
            parts={"rod": result.part()} if found else None,
            verification=found,
        ),
        "seconds_total": perf_counter() - start_time,
        "seconds_per_iteration": clock.wall["design"] / max(result.iterations, 1),
        "seconds_by_phase": clock.wall,
        "cpu_seconds": clock.cpu,
        "design_variables": domain.n_cells_global,
        "level_set_knots": len(levelset.knots),
        "elastic_coordinates": problem.flexible["rod"].n_elastic,
        "integrator": type(problem.integrator).__name__,
        "steps": problem.integrator.times.size - 1,
    }
    ffr.write_summary(comm, output / "summary.json", summary)
    ffr.write_report(comm, output)
    say(f"{result.reason} after {result.iterations} iterations")
    for name, psi in {"design": result.psi, **compliance}.items():
        say(f"  {name:8s} {psi:.4e} J s   {psi / solid:6.3f} of the full rod")
    if found:
        say(f"  {'part':8s} {found.psi:.4e} J s   {found.psi / solid:6.3f} of the full rod")
        say(found)
        say(f"thinnest member that was asked for: {1e3 * levelset.minimum_member:.3g} mm")
    say("CPU seconds: " + ", ".join(f"{name} {t:.1f}" for name, t in clock.cpu.items()))
    say(f"pictures and numbers are in {output}")

    # %% What a good design must meet
    fine = options.mesh is None and domain.n_cells_global >= FINE
    if not fine or options.iterations < ENOUGH or result.reason == "interrupted":
        say("no finished design of the reference scene: its marks are not asserted")
        return
    assert result.feasible, f"volume {volume} above its bound {VOLUME}"
    assert gray < 0.20, f"{100 * gray:.1f} % of the elements are cut by the boundary, or gray"
    assert found is not None and result.part().pieces == 1, "the part has fallen to pieces"
    assert not result.part().loose, "pieces are left out of the part"
    assert abs(found.difference) < 0.01, f"the part is {found.difference:+.2%} from its design"
    assert mirrored < 1e-12, f"the field differs from its mirror image by {mirrored:.1e}"
    assert found.psi < 0.52 * solid, f"psi of the part is {found.psi / solid:.3f} of the full's"
    thinnest = result.part().thinnest_member
    assert thinnest is None or thinnest.value >= levelset.minimum_member, (
        f"the thinnest member is {thinnest.value} m, {levelset.minimum_member} m was asked for"
    )


def part_record(found: ffr.Verification, solid: float) -> dict[str, Any]:
    """What the part is worth beside the full rod, and what it measures."""
    return {
        "compliance_part": found.psi,
        "compliance_part_relative": found.psi / solid,
        **found.record(),
    }


#: Iterations and elements from which on a design counts as finished
ENOUGH, FINE = 60, 4000


class Clock:
    """Seconds of each phase, on the wall and of this process."""

    def __init__(self) -> None:
        """Begin the first phase."""
        self.wall: dict[str, float] = {}
        self.cpu: dict[str, float] = {}
        self._last = perf_counter(), process_time()

    def lap(self, name: str) -> None:
        """End a phase."""
        now = perf_counter(), process_time()
        for times, begin, end in zip((self.wall, self.cpu), self._last, now, strict=True):
            times[name] = end - begin
        self._last = now


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Design the flexible rod of a slider-crank.")
    parser.add_argument("--elements", nargs=2, type=int, default=[200, 20], metavar=("NX", "NY"))
    parser.add_argument("--iterations", type=int, default=60, help="at most (default 60)")
    parser.add_argument(
        "--steps", type=int, help="of generalised-alpha (default: those that 1e-4 of psi takes)"
    )
    parser.add_argument("--mesh", help="gmsh file with the physical curves 'left' and 'right'")
    parser.add_argument("--order", type=int, default=1, help="of the displacements (default 1)")
    parser.add_argument("--output", default="results/slider_crank", help="folder for the results")
    parser.add_argument("--resume", action="store_true", help="go on from the last checkpoint")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    run(main)
