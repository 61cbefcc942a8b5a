# SPDX-License-Identifier: MIT
"""Speed beside error: tables (CSV, Markdown) and pictures.

    make benchmark [ARGS="--quick"]
    python benchmarks/run.py [--quick] [--only STUDY ...] [--output DIR]

Everything in them is measured in this run. All of it takes about a quarter of an hour on two free
cores, with ``--quick`` about one minute, on small meshes and with few repetitions: a smoke test.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from mpi4py import MPI

from accuracy import accuracy_jobs, report_accuracy
from differences import report_differences
from gradient import gradient_jobs, report_gradient
from growth import growth_jobs, report_growth
from jobs import Job, run_jobs

STUDIES = ("growth", "accuracy", "differences", "gradient")


def main(arguments: list[str] | None = None) -> None:
    """Measure, and leave tables and pictures."""
    options = parse(arguments)
    if MPI.COMM_WORLD.size > 1:
        raise SystemExit("benchmarks: start this without mpirun; it starts ranks where it wants")
    directory = Path(options.output).resolve()
    directory.mkdir(parents=True, exist_ok=True)

    # whatever is compiled is compiled before the first measurement
    jobs = [Job("scene", "warm_up", 5.0, {"orders": [1, 2] if "accuracy" in options.only else [1]})]
    if {"growth", "differences"} & set(options.only):
        jobs += growth_jobs(quick=options.quick)
    if "accuracy" in options.only:
        jobs += accuracy_jobs(quick=options.quick)
    if "gradient" in options.only:
        jobs += gradient_jobs(quick=options.quick)
    try:
        results = list(run_jobs(jobs))
    except RuntimeError as error:
        raise SystemExit(f"benchmarks: {error}; its messages are above") from error

    growth = [(job, result) for job, result in results if job.study == "growth"]
    accuracy = [(job, result) for job, result in results if job.study == "accuracy"]
    gradient = [(job, result) for job, result in results if job.study == "gradient"]
    reports = {
        "growth": lambda: report_growth(growth, directory),
        "accuracy": lambda: report_accuracy(accuracy, directory),
        "differences": lambda: report_differences(growth, directory),
        "gradient": lambda: report_gradient(gradient, directory),
    }
    for study in STUDIES:
        if study in options.only:
            for table in reports[study]():
                print(f"\n{table.markdown()}")
            print(f"{directory / study}.md, {study}.png")


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(description="Measure speed beside error.")
    parser.add_argument("--quick", action="store_true", help="small meshes, few repetitions")
    parser.add_argument(
        "--only", nargs="+", choices=STUDIES, default=list(STUDIES), help="these studies alone"
    )
    parser.add_argument("--output", default="results/benchmarks", help="folder for the results")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    main()
