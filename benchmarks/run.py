# SPDX-License-Identifier: MIT
"""Speed beside error: tables (CSV, Markdown) and pictures.

    make benchmark [ARGS="--quick"]
    python benchmarks/run.py [--quick] [--only STUDY ...] [--output DIR] [--resume]

Everything is measured in this run: about an hour and a half on two free cores, with ``--quick``
(small meshes, few repetitions: a smoke test) about a minute. DIR/measurements.json keeps each
measurement; ``--resume`` goes on from there after an interruption or a failure, with the same code.
The study ``peers`` needs other packages, which `make benchmark-peers` installs.
"""

import argparse
import importlib
import json
from pathlib import Path
from typing import Any

from mpi4py import MPI

import report
from jobs import Job, run_jobs
from peer_packages import missing

from dolfinx_ffr.files import replace_file

#: In the order in which they run: each is a module of this folder with the functions NAME_jobs and
#: report_NAME. A study without jobs of its own stands in the module whose jobs it reports on.
STUDIES = ["growth", "accuracy", "modes", "mesh", "differences", "gradient", "boundary", "bound"]
STUDIES += [
    "known",
    "stress",
    "peers",
    "integration",
    "time_steps",
    "space",
    "published",
    "arrays",
    "ranks",
]
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

    jobs_of = {
        study: getattr(importlib.import_module(study), f"{study}_jobs")(quick=options.quick)
        for study in dict.fromkeys(MEASURED_BY.get(name, name) for name in options.only)
    }
    every = [job for some in jobs_of.values() for job in some]
    record = directory / "measurements.json"
    found: dict[str, Any] = json.loads(record.read_text()) if options.resume else {}
    if any(job.key in found for job in every):
        report.NOTES.append("some of it, or all, was measured by an earlier run (--resume)")
    todo = [job for job in every if job.key not in found]
    if todo:  # whatever is compiled is compiled before the first measurement
        todo.insert(0, Job("scene", "warm_up", 5.0))
    failed = []
    for job, measured in run_jobs(todo, together=options.quick):
        if measured is None:
            failed.append(job.title)
        else:
            found[job.key] = measured
            replace_file(record, json.dumps(found).encode())

    for study in options.only:
        jobs = jobs_of[MEASURED_BY.get(study, study)]
        own = [(job, found[job.key]) for job in jobs if job.key in found]
        if len(own) < len(jobs):
            print(f"\n{study}: no report, because one of its measurements has failed")
            continue
        page = report.Study(directory, study)
        module = importlib.import_module(MEASURED_BY.get(study, study))
        getattr(module, f"report_{study}")(page, own)
        for table in page.write():
            print(f"\n{table.markdown()}")
        print(f"{directory / study}.md, {study}.png")
    if failed:
        told = f"benchmarks: these have failed, their messages are above: {', '.join(failed)}"
        raise SystemExit(f"{told}; with --resume they alone are measured again")


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Measure speed beside error.")
    parser.add_argument("--quick", action="store_true", help="small meshes, few repetitions")
    only = {"nargs": "+", "choices": STUDIES, "help": "these studies alone (default: all)"}
    parser.add_argument("--only", **only)
    parser.add_argument("--output", default="results/benchmarks", help="folder for the results")
    text = "take what is in the folder's measurements.json"
    parser.add_argument("--resume", action="store_true", help=text)
    options = parser.parse_args(arguments)
    if options.resume and not (Path(options.output) / "measurements.json").exists():
        parser.error(f"--resume: there is no measurements.json in {options.output}")
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
