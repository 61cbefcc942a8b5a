# SPDX-License-Identifier: MIT
# %% [markdown]
"""# Two ways to a design: densities beside a level set.

What you will see: the flexible rod of `slider_crank.py` designed in three ways from the same
problem and the same exact gradient, the designs beside each other, and how psi falls.

**Problem.** As in `slider_crank.py`: min psi(x) such that volume(x) <= 0.5.

**Three ways** to the densities x of the elements:

- *densities*: a variable z in [0, 1] for each element, x = projection(filter(z)) (SIMP), updated by
  the method of moving asymptotes. The projection becomes steeper along the run.
- *level set, explicit steps*: x is the fill fraction of phi > 0, and phi moves along its velocity.
- *level set, moving asymptotes*: the same x, its coefficients updated like the densities.

Run it with

    python demos/density_design.py [--elements NX NY] [--iterations N] [--mesh FILE] [--output DIR]

also under `mpirun -n 2`.
"""

# %% Imports
from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter

from mpi4py import MPI

import numpy as np
from slider_crank import VOLUME, reference_problem

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.program import run


# %% The program
def main(arguments: list[str] | None = None) -> None:
    """Design the rod three times, and leave numbers and pictures."""
    options = parse(arguments)
    comm = MPI.COMM_WORLD
    output = Path(options.output)
    say = print if comm.rank == 0 else lambda *_: None
    given = ffr.Domain.from_gmsh(comm, options.mesh) if options.mesh else None
    problem = reference_problem(comm, tuple(options.elements), domain=given)
    domain = problem.flexible["rod"].domain
    solid = problem.value(np.ones(domain.n_cells)).psi

    # %% Three ways
    densities = ffr.DensityDesign(domain)
    levelset = ffr.LevelSet(domain)
    low, high = domain.bounding_box
    height = high[1] - low[1]
    holes = levelset.with_holes(10, 3, 0.2 * height, margin=0.25 * height)
    ways = {
        "densities, moving asymptotes": (densities, densities.even(VOLUME), ffr.MMA()),
        "level set, explicit steps": (levelset, holes, ffr.LevelSetEvolution()),
        "level set, moving asymptotes": (levelset, holes, ffr.MMA()),
    }
    results: dict[str, ffr.Result] = {}
    summary = {}
    for name, (design, start, optimizer) in ways.items():
        began = perf_counter()
        say(name)
        result = ffr.optimize(
            problem,
            design,
            start,
            optimizer=optimizer,
            volume=VOLUME,
            iterations=options.iterations,
            output=output / name.replace(", ", "_").replace(" ", "_"),
        )
        seconds = perf_counter() - began
        results[name] = result
        summary[name] = {
            "compliance_relative": result.psi / solid,
            "compliance_relative_rounded": rounded(problem, result) / solid,
            "volume_fraction": result.evaluation.volume["rod"],
            "gray_fraction": ffr.gray_fraction(domain, result.x),
            **result.summary(),
            "seconds": seconds,
        }
        found = summary[name]
        say(
            f"  psi {found['compliance_relative']:.4f} of the full rod's (as void and solid alone "
            f"{found['compliance_relative_rounded']:.4f}), volume {found['volume_fraction']:.3f}, "
            f"gray {100 * found['gray_fraction']:.1f} %, {result.iterations} iterations "
            f"({result.reason}), {seconds:.0f} s"
        )

    # %% Numbers and pictures
    ffr.write_summary(comm, output / "summary.json", summary)
    plotting.plot_design(
        domain,
        {
            f"{name}: {100 * result.psi / solid:.1f} % of the full rod's compliance, "
            f"{100 * summary[name]['volume_fraction']:.0f} % of its material, "
            f"{result.iterations} iterations": result.x
            for name, result in results.items()
        },
        output / "designs.png",
    )
    histories = {name: result.history for name, result in results.items()}
    plotting.plot_curves(
        {
            "Integral compliance / full rod's (cut at 1)": {
                name: (h["iteration"], np.minimum(h["psi"] / solid, 1.0))
                for name, h in histories.items()
            },
            "Share between void and solid": {
                name: (h["iteration"], h["gray"]) for name, h in histories.items()
            },
        },
        output / "histories.png",
        xlabel="iteration",
        comm=comm,
    )
    say(f"pictures and numbers are in {output}")

    # %% What good designs must meet
    if given or domain.n_cells_global < FINE or options.iterations < ENOUGH:
        say("no finished designs of the reference scene: their marks are not asserted")
        return
    for name, found in summary.items():
        assert found["volume_fraction"] <= VOLUME * (1.0 + 1e-7), f"{name}: volume above its bound"
        assert results[name].psi < results[name].history["psi"][0], f"{name}: no descent"
    by_density = summary["densities, moving asymptotes"]
    assert by_density["compliance_relative"] < 0.51, "the densities have missed their mark"
    assert by_density["gray_fraction"] < 0.10, "the densities are too gray"
    assert by_density["compliance_relative_rounded"] < 0.55, "the densities do not hold together"
    for name, found in summary.items():
        assert found["compliance_relative"] < 0.55, f"{name}: has missed its mark"


def rounded(problem: ffr.Problem, result: ffr.Result) -> float:
    """Psi with every element either void or solid; infinite where that holds nothing."""
    try:
        return problem.value(np.round(result.x)).psi
    except ffr.SimulationError:
        return float("inf")


#: Iterations and elements from which on a design counts as finished
ENOUGH, FINE = 90, 4000


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Design a rod by densities and by a level set.")
    parser.add_argument("--elements", nargs=2, type=int, default=[200, 20], metavar=("NX", "NY"))
    parser.add_argument("--mesh", help="gmsh file with the physical curves 'left' and 'right'")
    parser.add_argument("--iterations", type=int, default=98, help="at most (default 98)")
    parser.add_argument("--output", default="results/density_design", help="folder for the results")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    run(main)
