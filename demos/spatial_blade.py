# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A blade that spins about an axis that is not its own, with geometric stiffening.

What you will see: a flat blade with a weight at its end sits askew on a hub, runs up and stops. Its
inertia pulls it along and bends it towards the plane in which it turns; the pull stiffens it, which
a linear model misses.
Of half of the material a design by filtered densities is made with the stiffening in the gradient.

**Problem.** Find densities x that minimise

    psi = int q^T K q dt   such that   volume(x) <= 0.5,

where q are the elastic coordinates of the blade in the frame of its root, which turns with the hub;
their stiffness is K + sum_kl B_kl K^kl with B = [alpha] + [omega]^2, the geometric stiffness by the
nine loads of rotation.

**Discretisation.** Hexahedra of order 2, one over the thickness, SIMP with exponent 3; a tangent
frame, six constraint modes and eight normal modes; generalised-alpha on the group of rotations.
Densities, filtered and projected, by the method of moving asymptotes.

Run it with

    python demos/spatial_blade.py [--elements NX NY NZ] [--steps N] [--iterations N] [--output DIR]

also under `mpirun -n 2`; it takes some minutes.
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

# %% Parameters
BLADE = (0.3, 0.06, 0.008)  # length, width and thickness of the blade [m]
PLASTIC = ffr.Isotropic(young=3e9, poisson=0.35, density=1200.0)
TILT, PITCH = 0.3, 0.5  # of the blade out of the plane of rotation and about its length [rad]
TIP = 0.03  # mass of what it carries at its end [kg]
TURNS, DURATION = 4, 1.0  # of the hub, from rest to rest; time [s]
VOLUME = 0.5  # bound of the filled share
MODES, STEPS = 8, 1000


# %% The scene
def blade_problem(
    comm: MPI.Comm,
    elements: tuple[int, int, int] = (40, 8, 1),
    *,
    stiffening: bool = True,
    steps: int = STEPS,
) -> ffr.Problem:
    """The blade on its hub.

    Args:
        comm: Communicator over which the mesh is distributed.
        elements: Along, across and over the thickness.
        stiffening: Whether its own inertia stiffens the blade.
        steps: Number of time steps.
    """
    box = ffr.Domain.box(comm, *BLADE, elements=elements, order=2)
    ends = {"root": box.interfaces["left"].facets, "tip": box.interfaces["right"].facets}
    blade = ffr.FlexibleBody(
        ffr.Domain(box.mesh, ends, box.solid_cells, order=2),
        PLASTIC,
        frame=ffr.TangentFrame("root"),
        modes=MODES,
        stiffening=("rotation",) if stiffening else (),
    )
    still = ffr.Motion.constant(0.0)
    turn = ffr.Motion.smooth_step(2 * np.pi * TURNS, DURATION, name="hub")
    hub = ffr.Moving(still, still, turn, z=still, axis=(0, 0, 1), name="hub")
    c, s, a, b = np.cos(TILT), np.sin(TILT), np.cos(PITCH), np.sin(PITCH)
    tilted = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) @ np.array(
        [[1, 0, 0], [0, a, -b], [0, b, a]]
    )
    mechanism = ffr.Mechanism(
        placements={"blade": ffr.Placement((0, 0, 0), rotation=tilted)},
        joints=[ffr.Weld(("blade", "root"), hub, name="hub")],
        point_masses=[ffr.PointMass(("blade", "tip"), TIP)],
    )
    integrator = ffr.GeneralizedAlpha(DURATION, steps)
    return ffr.Problem({"blade": blade}, mechanism, integrator, ffr.IntegralCompliance())


# %% The program
def main(arguments: list[str] | None = None) -> None:
    """Design the blade, and leave numbers and pictures."""
    options = parse(arguments)
    comm = MPI.COMM_WORLD
    output = Path(options.output)
    start_time = perf_counter()
    say = print if comm.rank == 0 else lambda *_: None
    elements = tuple(options.elements)
    problem = blade_problem(comm, elements, steps=options.steps)
    domain = problem.flexible["blade"].domain
    say(
        f"blade of {domain.n_cells_global} elements, {options.steps} steps, {comm.size} rank(s), "
        f"DOLFINx {version('fenics-dolfinx')}"
    )
    ones = np.ones(domain.n_cells)
    full = problem.value(ones)
    linear = blade_problem(comm, elements, stiffening=False, steps=options.steps).value(ones)
    bent = {
        name: float(np.max(np.abs(each.motion.elastic("blade") @ _tip(each))))
        for name, each in (("stiffened", full), ("linear", linear))
    }
    say(f"the tip bends by {1e3 * bent['stiffened']:.2f} mm, linearly {1e3 * bent['linear']:.2f}")

    # %% The design
    design = ffr.DensityDesign(domain)
    with ffr.recorded_warnings() as warnings:
        result = ffr.optimize(
            problem, design, volume=VOLUME, iterations=options.iterations, output=output
        )
        verified = result.finish(output, most=3)

    # %% Numbers and pictures
    solid = result.problem.value(ones).psi
    ffr.write_density(domain, result.x, output / "design.xdmf")
    heading = (
        f"densities above one half: {100 * result.psi / solid:.0f} % of the full blade's compliance"
    )
    plotting.plot_design(domain, {heading: result.x}, output / "design.png")
    plotting.plot_history(result.history, output / "history.png", psi_solid=solid, comm=comm)
    plotting.plot_scene(result.problem, result.evaluation, output / "scene.png", color="energy")
    plotting.animate_motion(result.problem, result.evaluation, output / "motion.gif")
    enclosed = result.solid()
    summary = {
        "bending_stiffened": bent["stiffened"],
        "bending_linear": bent["linear"],
        "compliance_full": full.psi,
        "compliance_final": result.psi,
        "compliance_final_relative": result.psi / solid,
        **({} if verified is None else verified.record()),
        "solid_mass": enclosed.mass,
        "solid_pieces": enclosed.pieces,
        **ffr.run_record(
            result,
            title="A blade on a hub",
            verification=verified,
            warnings=warnings,
            references={"full blade": full.psi},
            volume=VOLUME,
        ),
        "seconds_total": perf_counter() - start_time,
    }
    ffr.write_summary(comm, output / "summary.json", summary)
    ffr.write_report(comm, output)
    say(f"{result.reason} after {result.iterations} iterations")
    say(f"  design {result.psi:.4e} J s   {result.psi / solid:6.3f} of the full blade")
    say(str(verified or "no solid of this design can be moved"))
    say(f"pictures and numbers are in {output}")

    # %% What must hold
    assert bent["stiffened"] < 0.97 * bent["linear"], "the pull has not stiffened the blade"
    if domain.n_cells_global < FINE or options.iterations < ENOUGH:
        say("no finished design of the reference scene: its marks are not asserted")
        return
    assert result.feasible, f"bounds are violated: {result.violations}"
    assert enclosed.pieces == 1, "the blade has fallen to pieces"
    assert result.psi < solid, "the full blade is stiffer"


def _tip(evaluation: ffr.Evaluation) -> np.ndarray:
    """Shape functions of the tip's displacement across the blade."""
    return np.asarray(evaluation.motion.model.bodies["blade"].markers["tip"].displacement[2])


#: Iterations and elements from which on a design counts as finished
ENOUGH, FINE = 60, 300


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Design a blade that spins askew on its hub.")
    parser.add_argument(
        "--elements", nargs=3, type=int, default=[40, 8, 1], metavar=("NX", "NY", "NZ")
    )
    parser.add_argument("--steps", type=int, default=STEPS, help=f"(default {STEPS})")
    parser.add_argument("--iterations", type=int, default=60, help="at most (default 60)")
    parser.add_argument("--output", default="results/spatial_blade", help="folder for the results")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    run(main)
