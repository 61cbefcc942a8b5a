# SPDX-License-Identifier: MIT
"""Speed beside error: tables (CSV, Markdown) and pictures.

    make benchmark [ARGS="--quick"]
    python benchmarks/run.py [--quick] [--only STUDY ...] [--output DIR]

Everything in them is measured in this run. All of it takes about a quarter of an hour on two
free cores, with ``--quick`` about two minutes, on small meshes and with few repetitions: a smoke
test.

The study ``peers`` needs other packages, which `make benchmark-peers` installs; it is left out as
long as they are not there.
"""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path

from mpi4py import MPI

from jobs import Job, run_jobs
from peer_packages import missing

#: In the order in which they run: each is a module of this folder with the functions NAME_jobs and
#: report_NAME. A study without jobs of its own reports on those of another.
STUDIES = (
    "growth",
    "accuracy",
    "modes",
    "mesh",
    "model",
    "differences",
    "gradient",
    "designs",
    "solids",
    "peers",
    "integration",
    "motions",
    "static_loads",
    "warm_starts",
    "space",
)
MEASURED_BY = {"differences": "growth"}
#: It needs packages that are not part of the environment, and is left out where they are not there.
PEERS = "peers"


def main(arguments: list[str] | None = None) -> None:
    """Measure, and leave tables and pictures."""
    options = parse(arguments)
    if MPI.COMM_WORLD.size > 1:
        raise SystemExit("benchmarks: start this without mpirun; it starts ranks where it wants")
    directory = Path(options.output).resolve()
    directory.mkdir(parents=True, exist_ok=True)

    # whatever is compiled is compiled before the first measurement
    jobs = [Job("scene", "warm_up", 5.0)]
    jobs_of = {
        study: getattr(importlib.import_module(study), f"{study}_jobs")(quick=options.quick)
        for study in dict.fromkeys(MEASURED_BY.get(name, name) for name in options.only)
    }
    jobs += [job for some in jobs_of.values() for job in some]
    results = list(run_jobs(jobs, together=options.quick))

    failed = [job.title for job, measured in results if measured is None]
    for study in options.only:
        jobs = jobs_of[MEASURED_BY.get(study, study)]
        own = [(job, found) for job, found in results if job in jobs and found is not None]
        if len(own) < len(jobs):
            print(f"\n{study}: no report, because one of its measurements has failed")
            continue
        report = getattr(importlib.import_module(study), f"report_{study}")
        for table in report(own, directory):
            print(f"\n{table.markdown()}")
        print(f"{directory / study}.md, {study}.png")
    if failed:
        raise SystemExit(
            "benchmarks: these have failed, their messages are above: " + ", ".join(failed)
        )


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Measure speed beside error.")
    parser.add_argument("--quick", action="store_true", help="small meshes, few repetitions")
    parser.add_argument(
        "--only", nargs="+", choices=STUDIES, help="these studies alone (default: all)"
    )
    parser.add_argument("--output", default="results/benchmarks", help="folder for the results")
    options = parser.parse_args(arguments)
    absent = missing()
    if options.only is None:
        options.only = [study for study in STUDIES if study != PEERS or absent is None]
        if absent:
            print(f"{absent}; left out here")
    elif PEERS in options.only and absent:
        raise SystemExit(absent)
    return options


if __name__ == "__main__":
    main()
