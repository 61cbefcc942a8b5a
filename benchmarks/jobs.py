# SPDX-License-Identifier: MIT
"""Measurements in processes of their own, one after the other, with progress.

A process of its own gives each measurement its own peak of memory and its own number of MPI ranks.

Started as a program this module is that process:

    python benchmarks/jobs.py STUDY FUNCTION PARAMETERS RESULT

calls FUNCTION of the module STUDY with the communicator, a function that tells the progress and the
PARAMETERS (JSON), and writes what it returns to the file RESULT (JSON).
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI

from tqdm import tqdm

__all__ = ["Job", "Progress", "run_jobs"]

HERE = Path(__file__).resolve().parent
PROGRESS = "progress "

#: told which part of the job is done, from 0 to 1
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Job:
    """One measurement."""

    study: str  #: module of this folder
    function: str  #: its function ``(comm, progress, **parameters) -> dict``
    seconds: float  #: about how long it takes, for the time left [s]
    parameters: dict[str, Any] = field(default_factory=dict)  #: JSON values
    ranks: int = 1  #: MPI ranks

    @property
    def title(self) -> str:
        """What the progress bar says."""
        ranks = f", {self.ranks} ranks" if self.ranks > 1 else ""
        size = "x".join(map(str, self.parameters.get("elements", ())))
        return f"{self.study}: {' '.join([self.function, size]).strip()}{ranks}"


def run_jobs(jobs: Iterable[Job]) -> Iterator[tuple[Job, dict[str, Any]]]:
    """Run jobs one after the other.

    Args:
        jobs: what to run; their expected seconds weigh the progress bar.

    Returns:
        Iterator over each job with its result.

    Raises:
        RuntimeError: if a job fails.
    """
    jobs = list(jobs)
    form = "{desc:32s} {percentage:3.0f}% |{bar}| {elapsed}, {remaining} left"
    with tqdm(total=sum(job.seconds for job in jobs), bar_format=form) as bar:
        for job in jobs:
            bar.set_description_str(job.title)
            start = bar.n

            def tell(part: float, start: float = start, seconds: float = job.seconds) -> None:
                bar.update(start + part * seconds - bar.n)

            result = _run(job, tell)
            tell(1.0)
            yield job, result


def _run(job: Job, tell: Progress) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="dolfinx_ffr-benchmark.") as directory:
        result = Path(directory) / "result.json"
        command = [sys.executable, str(Path(__file__).resolve()), job.study, job.function]
        command += [json.dumps(job.parameters), str(result)]
        if job.ranks > 1:
            command = ["mpirun", "-n", str(job.ranks), *command]
        with subprocess.Popen(
            command, env=_environment(), stdout=subprocess.PIPE, text=True
        ) as process:
            try:
                for line in process.stdout or ():
                    if line.startswith(PROGRESS):
                        tell(float(line.removeprefix(PROGRESS)))
            finally:
                if process.poll() is None and sys.exc_info()[0] is not None:
                    process.terminate()
        if process.returncode != 0 or not result.exists():
            raise RuntimeError(f"{job.title} has failed with exit code {process.returncode}")
        measured: dict[str, Any] | None = json.loads(result.read_text())
        return measured or {}


def _environment() -> dict[str, str]:
    """Return the environment of `make`, without what would make a child a rank of our own run."""
    show = 'clone="$1"; . "$1/install/environment.sh"; env -0'
    output = subprocess.run(
        ["bash", "-c", show, "bash", str(HERE.parent)],
        env=dict(os.environ),  # MPI has changed the process's own since it began
        stdout=subprocess.PIPE,
        check=True,
    ).stdout.decode(errors="surrogateescape")
    variables = dict(entry.split("=", 1) for entry in output.split("\0") if "=" in entry)
    ours = ("OMPI_COMM", "OMPI_UNIVERSE", "PMIX_", "PRTE_ML", "ORTE_", "PMI_")
    return {name: value for name, value in variables.items() if not name.startswith(ours)}


def _main(study: str, function: str, parameters: str, result: str) -> None:
    comm = MPI.COMM_WORLD

    def tell(part: float) -> None:
        if comm.rank == 0:
            print(f"{PROGRESS}{part}", flush=True)

    try:
        measured = getattr(importlib.import_module(study), function)(
            comm, tell, **json.loads(parameters)
        )
    except BaseException:
        traceback.print_exc()
        comm.Abort(1)  # the other ranks would wait for this one
    if comm.rank == 0:
        Path(result).write_text(json.dumps(measured))


if __name__ == "__main__":
    _main(*sys.argv[1:])
