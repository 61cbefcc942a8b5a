# SPDX-License-Identifier: MIT
"""Measurements in processes of their own, one after the other, with progress.

A process of its own gives each measurement its own peak of memory and its own number of MPI ranks.

Started as a program with TASKS and RESULT this module is that process: it calls each FUNCTION of a
STUDY in TASKS (JSON), and writes the list of what they return to the file RESULT (JSON).
"""

import contextlib
import importlib
import json
import os
import re
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

HERE = Path(__file__).resolve().parent
#: A line about the job of a number; from several ranks what others write may stand behind it
PROGRESS = re.compile(r"progress (\d+) (\d[\d.]*(?:e-\d+)?)")

#: Variables that MPI sets in a process, also in one that nobody has started by mpirun, and that a
#: worker of pytest-xdist inherits. With them a child would take itself for a rank of that process;
#: by "OMPI_MCA_ess" alone mpirun fails without a message.
MPI_VARIABLES = (
    *("OMPI_COMM", "OMPI_UNIVERSE", "OMPI_APP_CTX", "OMPI_MCA_ess", "OMPI_MCA_orte_"),
    *("OMPI_MCA_pmix", "PMIX_", "PMI_", "PRTE_ML", "PRTE_LAUNCHED", "ORTE_"),
)

Array = NDArray[np.float64]
#: Told which part of the job is done, from 0 to 1
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Job:
    """One measurement; of ``repetitions`` the fastest counts where nothing else is said."""

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


#: What a study reports on: its jobs and what they returned
Results = list[tuple[Job, dict[str, Any]]]


def the(function: str, results: Results) -> dict[str, Any]:
    """What the first job of a function returned."""
    return next(result for job, result in results if job.function == function)


def measure(
    actions: Mapping[Any, Callable[[], Any]],
    turns: int,
    progress: Progress,
    clock: Callable[[], Any] = perf_counter,
    *,
    untimed: int = 1,
) -> tuple[dict[Any, list[Any]], dict[Any, Any]]:
    """Sweep through actions in turn, so that a busy moment of the machine hits all alike.

    The first turns are ``untimed``, where things are compiled; without ``turns`` the first counts.
    Returned are the seconds of each turn by setting, and what the last calls have returned.
    """
    seconds: dict[Any, list[Any]] = {setting: [] for setting in actions}
    found: dict[Any, Any] = {}
    untimed = untimed if turns else 0
    whole = untimed + max(turns, 1)
    for turn in range(whole):
        for place, (setting, action) in enumerate(actions.items()):
            begin = clock()
            found[setting] = action()
            if turn >= untimed:
                seconds[setting].append(clock() - begin)
            progress((turn + (place + 1) / len(actions)) / whole)
    return seconds, found


def fits(what: str, memory: float) -> bool:
    """Whether the memory [bytes] that a measurement takes is free, told before all begin."""
    free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    print(f"{what} takes {memory / 1e9:.0f} GB of memory, free are {free / 1e9:.0f} GB")
    return memory <= free


def reset_peak_memory() -> float:
    """Begin a new record of the peak memory of this process, and return it [MB]."""
    with contextlib.suppress(OSError):  # the record goes on
        Path("/proc/self/clear_refs").write_text("5")
    return peak_memory()


def peak_memory() -> float:
    """The peak of the resident memory of this process [MB].

    That of `resource.getrusage` would include that of the process that started this one.
    """
    found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    return float(found[1]) * 1024e-6 if found else float("nan")


def beyond(tiny: Callable[[], Any], action: Callable[[], Any]) -> dict[str, float]:
    """Peaks of memory [MB]: of a tiny action (*base*), and of another one beyond it."""
    tiny()
    base, _ = reset_peak_memory(), action()
    return {"base": base, "beyond": peak_memory() - base}


def run_jobs(
    jobs: Iterable[Job], *, together: bool = False
) -> Iterator[tuple[Job, dict[str, Any] | None]]:
    """Run jobs one after the other, and yield each with its result, None for one that failed.

    A failure stops no other. ``together``: jobs on as many ranks share a process; what they say of
    memory is then rough.
    """
    jobs = sorted(jobs, key=lambda job: job.ranks) if together else list(jobs)
    form = "{desc:32s} {percentage:3.0f}% |{bar}| {elapsed}, {remaining} left"
    with tqdm(total=sum(job.seconds for job in jobs), bar_format=form) as bar:
        batches = [list(some) for _, some in groupby(jobs, lambda job: job.ranks)]
        for batch in batches if together else [[job] for job in jobs]:
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


def _run(batch: list[Job], tell: Callable[[int, float], None]) -> list[dict[str, Any] | None]:
    """What the jobs of a process return, None for all of them where one has failed.

    What the process writes to standard error is passed on at once; its exit code, and what else it
    has written to standard output, is shown where it fails.
    """
    messages = []
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
                    if told := PROGRESS.match(line):
                        tell(int(told[1]), float(told[2]))
                    else:
                        messages.append(line)
            finally:
                if process.poll() is None and sys.exc_info()[0] is not None:
                    process.terminate()
        if process.returncode != 0 or not result.exists():
            titles = ", ".join(job.title for job in batch)
            ending = f"benchmarks: {titles}: ended with exit code {process.returncode}"
            tqdm.write("".join([*messages, ending]), file=sys.stderr)
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
    for name in [name for name in variables if name.startswith(MPI_VARIABLES)]:
        del variables[name]
    # the code of this tree is measured, whatever is installed
    return {**variables, "PYTHONPATH": str(HERE.parent / "src")}


def _main(tasks: str, result: str) -> None:
    comm = MPI.COMM_WORLD
    measured = []
    for number, (study, function, parameters) in enumerate(json.loads(tasks)):

        def tell(part: float, number: int = number) -> None:
            if comm.rank == 0:
                print(f"progress {number} {part}", flush=True)

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
