# SPDX-License-Identifier: MIT
"""One rod for six motions: three speeds, each with a light and a heavy slider.

What you will see: the rod of a small pump, whose slider works against a constant pressure. Turning
slowly, the rod is a strut between crank and slider; turning fast, it is bent by its own inertia,
and pulled by that of the slider. A rod that is best for one of these motions is not for the others.
So it is designed eight times: for each motion alone; for the sum of all; and for the worst of them.

    min over x of        psi_i(x)                      for a motion i alone, best value b_i
    min over x of  sum_i psi_i(x) / b_i                for all together
    min over x of  max_i psi_i(x) / b_i                for the worst of them,

with psi_i the integral compliance of the rod in motion i, volume(x) <= 1/2, and x the densities of
the elements behind a level set. The largest ratio is minimised without a max: z is, such that
psi_i(x) / b_i <= z. The rod is reduced once for all six motions, and their derivatives go back to
its elements together. Under `mpirun` the motions are spread over the ranks.

The table at the end has a row for each design and a column for each motion. The design for the
worst case ends as a part, which is moved in all motions on a mesh that fits it.

Run it with `make demo DEMO=several_motions`, or

    python demos/several_motions.py [--elements NX NY] [--iterations N] [--steps N] [--output DIR]
                                    [--resume]

also under `mpirun -n 2`.
"""

# %% Imports
from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from slider_crank import CRANK, HEIGHT, LENGTH, STEEL, TURNS

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.program import run

# %% Parameters
SPEEDS = {"slow": 4.0, "medium": 2.0, "fast": 1.0}  # time of five turns, from rest to rest [s]
SLIDERS = {"light": 0.1, "heavy": 1.0}  # mass [kg]
PRESSURE = 60.0  # force on the slider, towards the crank [N]
VOLUME = 0.5  # upper bound, share of the rod
MODES = 8


# %% The scene
def mechanism(duration: float, slider: float) -> ffr.Mechanism:
    """The slider-crank at one speed with one slider.

    Args:
        duration: Time of five turns of the crank [s].
        slider: Mass [kg].
    """
    angle = ffr.Motion.smooth_step(2 * np.pi * TURNS, duration, name="crank angle")
    return ffr.Mechanism(
        placements={"rod": ffr.Placement(position=(CRANK, 0.0))},
        joints=[
            ffr.Revolute(
                ("rod", "left"), ffr.Moving.circle((0.0, 0.0), CRANK, angle), name="crank pin"
            ),
            ffr.PointOnLine(("rod", "right"), ffr.Ground(), name="slider"),
        ],
        point_masses=[ffr.PointMass(("rod", "right"), slider)],
        forces=[ffr.Force(("rod", "right"), x=-PRESSURE, name="pressure")],
    )


def six_motions(comm: MPI.Comm, elements: tuple[int, int], steps: int | None) -> ffr.Problem:
    """The rod in all motions.

    Args:
        comm: Communicator over which the mesh is distributed.
        elements: Along and across the rod.
        steps: Number of time steps of generalised-alpha; by default method and number are those
            that give psi of each motion to 1e-4.
    """
    domain = ffr.Domain.rectangle(comm, LENGTH, HEIGHT, elements=elements)
    rod = ffr.FlexibleBody(domain, STEEL, frame=ffr.ChordFrame("left", "right"), modes=MODES)
    motions = {
        f"{speed}, {payload}": ffr.MechanicalProblem(
            mechanism(duration, mass),
            ffr.TimeInterval(duration) if steps is None else ffr.GeneralizedAlpha(duration, steps),
            ffr.IntegralCompliance(),
        )
        for speed, duration in SPEEDS.items()
        for payload, mass in SLIDERS.items()
    }
    return ffr.Problem.of_motions({"rod": rod}, motions)


# %% The program
def main(arguments: list[str] | None = None) -> None:
    """Design the rod for each motion, their sum and the worst, and compare."""
    options = parse(arguments)
    comm, output = MPI.COMM_WORLD, Path(options.output)
    say = print if comm.rank == 0 else lambda *_: None
    began = perf_counter()

    every = six_motions(comm, tuple(options.elements), options.steps)
    domain = every.flexible["rod"].domain
    full = every.value(np.ones(domain.n_cells))
    say(f"full rod: {ffr.model_report(every, full)}")
    levelset = ffr.LevelSet(domain)

    # %% Each motion alone
    results: dict[str, ffr.Result] = {}
    psi: dict[str, dict[str, float]] = {}

    def design(name: str, problem: ffr.Problem) -> ffr.Result:
        """Design the rod, and move it in all motions."""
        begin = perf_counter()
        results[name] = result = ffr.optimize(
            problem,
            levelset,
            volume=VOLUME,
            iterations=options.iterations,
            output=output / folder(name),
            resume=options.resume,
        )
        psi[name] = in_all_motions(every.with_bodies(result.problem.bodies), result.x)
        relative = [psi[name][m] / full.motions[m].psi for m in psi[name]]
        say(
            f"{name:14s} psi over the full rod's "
            + "  ".join(f"{value:6.3f}" for value in relative)
            + f"   {perf_counter() - begin:.0f} s"
        )
        return result

    for name in every.motions:
        design(name, every.alone(name))

    # %% All together, by what each could be at best
    best = {  # not a full rod's, but for runs that are too short for a design
        motion: min(full.motions[motion].psi * WORST, *(values[motion] for values in psi.values()))
        for motion in every.motions
    }
    weights = {motion: 1.0 / value for motion, value in best.items()}
    combinations = {"sum of all": ffr.WeightedSum(weights), "worst case": ffr.WorstCase(weights)}
    with ffr.recorded_warnings() as warnings:
        for name, combine in combinations.items():
            design(name, ffr.Problem.of_motions(every.bodies, every.motions, combine))
        worst = results["worst case"]
        found = worst.finish(output)
    largest = {
        name: max(values[m] / best[m] for m in best) for name, values in psi.items()
    }  # how far a design is from the best one, in the motion that suits it least

    # %% Numbers and pictures
    plotting.plot_trade_off(
        psi,
        output / "trade_off.png",
        images={name: picture(levelset, result) for name, result in results.items()},
        title="ψ of eight designs in six motions, over that of the best design for the motion",
        comm=comm,
    )
    plotting.plot_design(domain, {"For the worst of six motions": worst.x}, output / "design.png")
    plotting.plot_history(
        worst.history,
        output / "history.png",
        psi_unit="",
        volume_bound=VOLUME,
        comm=comm,
    )
    slowest, *_, fastest = every.motions
    for name, file in ((slowest, "slow"), (fastest, "fast")):
        plotting.plot_scene(
            worst.problem.alone(name), worst.evaluation.alone(name), output / f"scene_{file}.png"
        )
    plotting.animate_motion(
        worst.problem.alone(fastest), worst.evaluation.alone(fastest), output / "motion.gif"
    )
    record = ffr.run_record(
        worst,
        title="One rod for six motions",
        warnings=warnings,
        volume=VOLUME,
        parts={"rod": worst.part()} if found else None,
        verification=found,
    )
    numbers = {
        "psi_by_design": psi,
        "psi_of_full_rod": {motion: part.psi for motion, part in full.motions.items()},
        "largest_ratio": largest,
        "seconds_total": perf_counter() - began,
    }
    ffr.write_summary(comm, output / "summary.json", {**record, **numbers})
    ffr.write_report(comm, output)
    for name, value in largest.items():
        say(f"  {name:14s} at worst {value:.3f} times the best design for a motion")
    if found:
        say(found)
    say(f"pictures and numbers are in {output}")

    # %% What good designs must meet
    if domain.n_cells_global < FINE or options.iterations < ENOUGH:
        say("no finished designs: their marks are not asserted")
        return
    assert worst.feasible, f"violated: {worst.violations}"
    mean = {
        name: float(np.mean([values[m] / best[m] for m in best])) for name, values in psi.items()
    }
    assert min(largest, key=lambda name: largest[name]) == "worst case", (
        f"others are better: {largest}"
    )
    assert mean["sum of all"] < mean["worst case"], f"the sum is no better in the mean: {mean}"
    assert found is not None and worst.part().pieces == 1, "the part has fallen to pieces"
    # cells of order one, few across a flange, are stiffer than they should be
    assert abs(found.difference) < 0.06, f"the part is {found.difference:+.2%} from its design"


def in_all_motions(problem: ffr.Problem, x: NDArray[np.float64]) -> dict[str, float]:
    """Psi of a design by motion, infinite where it is too soft to be moved."""
    try:
        return {name: found.psi for name, found in problem.value(x).motions.items()}
    except ffr.SimulationError:
        psi = {}
    for name in problem.motions:  # those that can be
        try:
            psi[name] = problem.alone(name).value(x).psi
        except ffr.SimulationError:
            psi[name] = float("inf")
    return psi


def picture(levelset: ffr.LevelSet, result: ffr.Result) -> NDArray[np.float64]:
    """Where a design has material, shape (rows, columns)."""
    low, high = levelset.domain.bounding_box
    x, y = (np.linspace(low[k], high[k], n) for k, n in ((0, 600), (1, 60)))
    points = np.column_stack([part.ravel() for part in np.meshgrid(x, y)])
    return (levelset.level(result.coefficients)(points) > 0.0).reshape(len(y), len(x)) * 1.0


def folder(name: str) -> str:
    """Where a design leaves its history."""
    return name.replace(", ", "_").replace(" ", "_")


#: Times the full rod's psi from which on a design is none
WORST = 100.0
#: Iterations and elements from which on a design counts as finished
ENOUGH, FINE = 60, 1440


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Design one rod for six motions.")
    parser.add_argument("--elements", nargs=2, type=int, default=[120, 12], metavar=("NX", "NY"))
    parser.add_argument("--iterations", type=int, default=60, help="at most (default 60)")
    parser.add_argument(
        "--steps", type=int, help="of generalised-alpha (default: those that 1e-4 of psi takes)"
    )
    parser.add_argument(
        "--output", default="results/several_motions", help="folder for the results"
    )
    parser.add_argument("--resume", action="store_true", help="go on from the last checkpoints")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    run(main)
