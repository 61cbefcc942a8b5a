# SPDX-License-Identifier: MIT
"""Speed beside error: tables (CSV, Markdown) and pictures.

    make benchmark [ARGS="--quick"]
    python benchmarks/run.py [--quick] [--only STUDY ...] [--output DIR]

Everything in them is measured in this run. All of it takes about a quarter of an hour on two free
cores, with ``--quick`` about one minute, on small meshes and with few repetitions: a smoke test.
"""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path

from mpi4py import MPI

from jobs import Job, run_jobs

#: In the order in which they run: each is a module of this folder with the functions NAME_jobs and
#: report_NAME. A study without jobs of its own reports on those of another.
STUDIES = ("growth", "accuracy", "differences", "gradient")
MEASURED_BY = {"differences": "growth"}


def main(arguments: list[str] | None = None) -> None:
    """Measure, and leave tables and pictures."""
    options = parse(arguments)
    if MPI.COMM_WORLD.size > 1:
        raise SystemExit("benchmarks: start this without mpirun; it starts ranks where it wants")
    directory = Path(options.output).resolve()
    directory.mkdir(parents=True, exist_ok=True)

    # whatever is compiled is compiled before the first measurement
    jobs = [Job("scene", "warm_up", 5.0, {"orders": [1, 2] if "accuracy" in options.only else [1]})]
    for study in dict.fromkeys(MEASURED_BY.get(name, name) for name in options.only):
        jobs += getattr(importlib.import_module(study), f"{study}_jobs")(quick=options.quick)
    try:
        results = list(run_jobs(jobs))
    except RuntimeError as error:
        raise SystemExit(f"benchmarks: {error}; its messages are above") from error

    for study in options.only:
        own = [result for result in results if result[0].study == MEASURED_BY.get(study, study)]
        report = getattr(importlib.import_module(study), f"report_{study}")
        for table in report(own, directory):
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
