# SPDX-License-Identifier: MIT
"""Programs that tests start."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

from jobs import MPI_VARIABLES

from shared import TOP


def environment(**variables: str) -> dict[str, str]:
    """This process's environment, without what would make a child a rank of its run.

    The child finds the modules of this tree, also those of the demos and of the benchmarks.
    """
    own = {name: text for name, text in os.environ.items() if not name.startswith(MPI_VARIABLES)}
    own["PYTHONPATH"] = os.pathsep.join(str(TOP / name) for name in ("src", "demos", "benchmarks"))
    # its ranks let others work while they wait: tests run beside this one
    own["OMPI_MCA_mpi_yield_when_idle"] = "1"
    return {**own, **variables}


def command(*arguments: str, ranks: int = 1) -> list[str]:
    """The command line of this Python with arguments, on a number of ranks."""
    line = [sys.executable, *arguments]
    if ranks == 1:
        return line
    mpirun = shutil.which("mpirun")
    assert mpirun, "mpirun is missing: install openmpi-bin"
    return [mpirun, "-n", str(ranks), *line]


def run(*arguments: str, ranks: int = 1, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run this Python with arguments to its end; variables go into its environment."""
    return subprocess.run(
        command(*arguments, ranks=ranks),
        env=environment(**variables),
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
