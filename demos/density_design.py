# SPDX-License-Identifier: MIT
# %% [markdown]
"""# Three ways to a design, and what their parts are worth.

What you will see: the flexible rod of `slider_crank.py` designed in three ways from the same
problem and the same exact gradient, the parts beside each other, and how psi falls.

**Problem.** As in `slider_crank.py`: min psi(x) such that volume(x) <= 0.5.

**Three ways** to the densities x of the elements:

- *level set, moving asymptotes*, the default: a field on knots becomes crisp along the run, and x
  is the share of an element that its zero line encloses;
- *densities, moving asymptotes*: a variable z in [0, 1] for each element, x = projection(filter(z))
  (SIMP), updated in the same way. The projection becomes steeper along the run;
- *level set, explicit steps*: the level set begins crisp, with holes, and its zero line moves along
  a velocity.

Each ends as a part, whose psi is computed again on a mesh that fits its boundary; the boundary of
the densities is where a smooth mean of them is one half.

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
from slider_crank import VOLUME, part_record, reference_problem

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
        "level set, moving asymptotes": (levelset, levelset.even(), ffr.MMA()),
        "densities, moving asymptotes": (densities, densities.even(VOLUME), ffr.MMA()),
        "level set, explicit steps": (levelset, holes, ffr.LevelSetEvolution()),
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
            output=output / folder(name),
        )
        seconds = perf_counter() - began
        results[name] = result
        found = result.finish(output / folder(name))
        full = result.problem.value(np.ones(domain.n_cells)).psi
        summary[name] = {
            "compliance_relative": result.psi / full,
            **(part_record(found, full) if found else {}),
            "volume_fraction": result.evaluation.volume["rod"],
            "gray_fraction": ffr.gray_fraction(domain, result.x),
            **result.summary(),
            "gradients": gradients(result),
            "seconds": seconds,
        }
        of_part = f"{found.psi / full:.4f}" if found else "unknown"
        say(
            f"  psi {result.psi / full:.4f} of the full rod's, that of the part {of_part}, "
            f"{gradients(result)} gradients ({result.reason}), {seconds:.0f} s"
        )

    # %% Numbers and pictures
    ffr.write_summary(comm, output / "summary.json", summary)
    plotting.plot_design(
        domain,
        {
            f"{name}: {100 * summary[name]['compliance_relative']:.1f} % of the full rod's "
            f"compliance, "
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
    for name, found in summary.items():
        assert found["compliance_relative"] < 0.55, f"{name}: has missed its mark"
    default = summary["level set, moving asymptotes"]
    assert default.get("part_pieces") == 1, "the default's part has fallen to pieces"
    assert abs(default["part_difference"]) < 0.01, "the default's part is not its design"


def gradients(result: ffr.Result) -> int:
    """How many were computed, that of the start included."""
    return len(result.history["psi"])


def folder(name: str) -> str:
    """Where a way leaves its history."""
    return name.replace(", ", "_").replace(" ", "_")


#: Iterations and elements from which on a design counts as finished
ENOUGH, FINE = 60, 4000


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Design a rod by densities and by a level set.")
    parser.add_argument("--elements", nargs=2, type=int, default=[200, 20], metavar=("NX", "NY"))
    parser.add_argument("--mesh", help="gmsh file with the physical curves 'left' and 'right'")
    parser.add_argument("--iterations", type=int, default=60, help="at most (default 60)")
    parser.add_argument("--output", default="results/density_design", help="folder for the results")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    run(main)
