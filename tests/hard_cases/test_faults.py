# SPDX-License-Identifier: MIT
"""Faults from outside: a killed process, a full disk, a rank that fails."""

from __future__ import annotations

import runpy
import signal
import subprocess
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
from shared import processes

from dolfinx_ffr import read_history

# on so coarse a mesh the design is no good one, and says so
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::UserWarning")]

#: A small design, as a program; the marks are filled in by each test
PROGRAM = """
from mpi4py import MPI
import numpy as np
import dolfinx_ffr as ffr
from slider_crank import reference_problem

problem = reference_problem(MPI.COMM_WORLD, (40, 6), modes=4, steps=200)
domain = problem.flexible["rod"].domain
levelset = ffr.LevelSet(domain)
{before}
result = ffr.optimize(
    problem, levelset, levelset.with_holes(4, 1, 0.01), volume=0.6, iterations={iterations},
    output={output!r}, resume={resume}, progress=False, callback={callback},
)
print("psi", repr(result.psi))
"""


def written(folder: Path, **marks: object) -> Path:
    """The program with its marks filled in."""
    defaults = {
        "before": "",
        "iterations": 12,
        "output": str(folder / "out"),
        "resume": False,
        "callback": None,
    }
    program = folder / f"program{len(list(folder.glob('program*')))}.py"
    program.write_text(textwrap.dedent(PROGRAM).format(**{**defaults, **marks}))
    return program


def run(folder: Path, ranks: int = 1, **marks: object) -> subprocess.CompletedProcess[str]:
    """Run the program to its end in processes of its own."""
    return subprocess.run(
        processes.command(str(written(folder, **marks)), ranks=ranks),
        env=processes.environment(),
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def run_here(folder: Path, **marks: object) -> None:
    """Run the program in this process: nothing goes wrong in it."""
    runpy.run_path(str(written(folder, **marks)), run_name="__main__")


def test_killed_and_resumed(tmp_path: Path) -> None:
    """Kill -9 in the middle: the resumed run ends like one that was never killed."""
    whole = tmp_path / "whole"
    whole.mkdir()
    run_here(whole)

    part = tmp_path / "part"
    part.mkdir()
    # slow enough to be caught in the middle
    slow = written(part, before="import time", callback="lambda *_: time.sleep(0.3)")
    process = subprocess.Popen(
        processes.command(str(slow)),
        env=processes.environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    history = part / "out" / "history.csv"
    limit = time.monotonic() + 200.0
    while time.monotonic() < limit:
        if history.exists() and len(history.read_text().splitlines()) > 5:
            break
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    killed = read_history(history)
    assert 4 <= len(killed["psi"]) < 13
    run_here(part, resume=True)
    expected, found = read_history(whole / "out" / "history.csv"), read_history(history)
    assert np.array_equal(found["iteration"], expected["iteration"])
    np.testing.assert_allclose(found["psi"], expected["psi"], rtol=1e-9)


def test_full_disk(tmp_path: Path) -> None:
    """No room to write: one clear error, and the last complete checkpoint still serves."""
    run_here(tmp_path, iterations=3)
    checkpoint = tmp_path / "out" / "checkpoint"
    good = checkpoint.read_bytes()
    # a limit on the size of files acts like a full disk from a certain byte on
    limit = "import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
    limit += (
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({len(good) // 2}, resource.RLIM_INFINITY))"
    )
    done = run(tmp_path, resume=True, iterations=6, before=limit)
    assert done.returncode != 0
    assert "OSError" in done.stderr and "File too large" in done.stderr
    assert checkpoint.read_bytes() == good
    run_here(tmp_path, resume=True, iterations=6)
    assert len(read_history(tmp_path / "out" / "history.csv")["psi"]) == 7


def test_a_rank_without_disk_stops_all(tmp_path: Path) -> None:
    """The rank that writes fails: all ranks stop with its message instead of waiting for it."""
    before = (
        "import os\n"
        "if MPI.COMM_WORLD.rank == 0:\n"
        "    import resource, signal\n"
        "    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "    resource.setrlimit(resource.RLIMIT_FSIZE, (100, resource.RLIM_INFINITY))"
    )
    done = run(tmp_path, ranks=2, before=before)
    assert done.returncode != 0
    assert done.stderr.count("File too large") >= 2
