# SPDX-License-Identifier: MIT
"""Measurements in processes of their own, one after the other, with progress.

A process of its own gives each measurement its own peak of memory and its own number of MPI ranks.

Started as a program this module is that process:

    python benchmarks/jobs.py TASKS RESULT

takes a list of a STUDY, a FUNCTION and its PARAMETERS each (JSON), calls FUNCTION of the module
STUDY with the communicator, a function that tells the progress and the PARAMETERS, and writes the
list of what they return to the file RESULT (JSON).
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

#: Told which part of the job is done, from 0 to 1
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Job:
    """One measurement."""

    study: str  #: Module of this folder
    function: str  #: Its function ``(comm, progress, **parameters) -> dict``
    seconds: float  #: About how long it takes, for the time left [s]
    parameters: dict[str, Any] = field(default_factory=dict)  #: JSON values
    ranks: int = 1  #: MPI ranks

    @property
    def key(self) -> str:
        """What it measures, for the record of measurements."""
        return json.dumps([self.study, self.function, self.parameters, self.ranks])

    @property
    def title(self) -> str:
        """What the progress bar says."""
        ranks = f", {self.ranks} ranks" if self.ranks > 1 else ""
        size = "x".join(map(str, self.parameters.get("elements", ())))
        return f"{self.study}: {' '.join([self.function, size]).strip()}{ranks}"


def run_jobs(
    jobs: Iterable[Job], *, together: bool = False
) -> Iterator[tuple[Job, dict[str, Any] | None]]:
    """Run jobs one after the other; one that fails does not stop the others.

    Args:
        jobs: What to run; their expected seconds weigh the progress bar.
        together: Jobs on as many ranks that follow each other share a process, which saves its
            start; what they say of memory is then rough.

    Returns:
        Iterator over each job with its result, None for those that failed: their messages are on
        standard error.
    """
    jobs = list(jobs)
    form = "{desc:32s} {percentage:3.0f}% |{bar}| {elapsed}, {remaining} left"
    with tqdm(total=sum(job.seconds for job in jobs), bar_format=form) as bar:
        for batch in _batches(jobs, together):
            begin = bar.n

            def tell(
                number: int, part: float, batch: list[Job] = batch, begin: float = begin
            ) -> None:
                job = batch[number]
                bar.set_description_str(job.title)
                done = begin + sum(before.seconds for before in batch[:number])
                bar.update(done + part * job.seconds - bar.n)

            tell(0, 0.0)
            results = _run(batch, tell)
            if len(batch) > 1 and None in results:  # those that share its process went with it
                for job in batch:
                    bar.write(f"benchmarks: again, in a process of its own: {job.title}")
                results = [one for job in batch for one in _run([job], lambda number, part: None)]
            yield from zip(batch, results, strict=True)


def _batches(jobs: list[Job], together: bool) -> list[list[Job]]:
    """The jobs of each process."""
    batches: list[list[Job]] = []
    for job in jobs:
        if together and batches and batches[-1][-1].ranks == job.ranks:
            batches[-1].append(job)
        else:
            batches.append([job])
    return batches


def _run(batch: list[Job], tell: Callable[[int, float], None]) -> list[dict[str, Any] | None]:
    """What the jobs of a process return, None for all of them where one has failed."""
    with tempfile.TemporaryDirectory(prefix="dolfinx_ffr-benchmark.") as directory:
        result = Path(directory) / "result.json"
        tasks = [(job.study, job.function, job.parameters) for job in batch]
        command = [sys.executable, str(Path(__file__).resolve()), json.dumps(tasks), str(result)]
        if batch[0].ranks > 1:
            command = ["mpirun", "-n", str(batch[0].ranks), *command]
        with subprocess.Popen(
            command, env=_environment(), stdout=subprocess.PIPE, text=True
        ) as process:
            try:
                for line in process.stdout or ():
                    if line.startswith(PROGRESS):
                        told, part = line.removeprefix(PROGRESS).split()
                        tell(int(told), float(part))
            finally:
                if process.poll() is None and sys.exc_info()[0] is not None:
                    process.terminate()
        if process.returncode != 0 or not result.exists():
            return [None] * len(batch)
        measured: list[dict[str, Any] | None] = json.loads(result.read_text())
        return [one or {} for one in measured]


def _environment() -> dict[str, str]:
    """The environment of `make`, without what would make a child a rank of our own run."""
    show = 'clone="$1"; . "$1/install/environment.sh"; env -0'
    output = subprocess.run(
        ["bash", "-c", show, "bash", str(HERE.parent)],
        env=dict(os.environ),  # MPI has changed the process's own since it began
        stdout=subprocess.PIPE,
        check=True,
    ).stdout.decode(errors="surrogateescape")
    variables = dict(entry.split("=", 1) for entry in output.split("\0") if "=" in entry)
    ours = ("OMPI_COMM", "OMPI_UNIVERSE", "PMIX_", "PRTE_ML", "ORTE_", "PMI_")
    kept = {name: value for name, value in variables.items() if not name.startswith(ours)}
    # the code of this tree is measured, whatever is installed
    return {**kept, "PYTHONPATH": str(HERE.parent / "src")}


def _main(tasks: str, result: str) -> None:
    comm = MPI.COMM_WORLD
    measured = []
    for number, (study, function, parameters) in enumerate(json.loads(tasks)):

        def tell(part: float, number: int = number) -> None:
            if comm.rank == 0:
                print(f"{PROGRESS}{number} {part}", flush=True)

        tell(0.0)
        try:
            run = getattr(importlib.import_module(study), function)
            measured.append(run(comm, tell, **parameters))
        except BaseException:
            traceback.print_exc()
            comm.Abort(1)  # the other ranks would wait for this one
        tell(1.0)
    if comm.rank == 0:
        Path(result).write_text(json.dumps(measured))


if __name__ == "__main__":
    _main(*sys.argv[1:])
