# SPDX-License-Identifier: MIT
"""Faults from outside: a killed process, a rank that fails."""

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

problem = reference_problem(MPI.COMM_WORLD, (30, 5), modes=3, steps=100)
domain = problem.flexible["rod"].domain
levelset = ffr.LevelSet(domain)
{before}
result = ffr.optimize(
    problem, levelset, levelset.with_holes(4, 1, 0.01), volume=0.6, iterations=8, boundary=0,
    output={output!r}, resume={resume}, progress=False, callback={callback},
)
print("psi", repr(result.psi))
"""


def written(folder: Path, **marks: object) -> str:
    """A file with the program, its marks filled in."""
    usual = {"before": "", "output": str(folder / "out"), "resume": False, "callback": None}
    program = folder / f"program{len(list(folder.glob('program*')))}.py"
    program.write_text(textwrap.dedent(PROGRAM).format(**{**usual, **marks}))
    return str(program)


def test_killed_and_resumed(tmp_path: Path) -> None:
    """Kill -9 in the middle: the resumed run ends like one that was never killed."""
    whole, part = tmp_path / "whole", tmp_path / "part"
    for folder in (whole, part):
        folder.mkdir()
    runpy.run_path(written(whole), run_name="__main__")
    # it waits in the middle until it is killed
    waits = "lambda iteration, *_: time.sleep(300.0 * (iteration == 4))"
    slow = written(part, before="import time", callback=waits)
    process = subprocess.Popen(
        processes.command(slow),
        env=processes.environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    history = part / "out" / "history.csv"
    limit = time.monotonic() + 200.0
    while time.monotonic() < limit:
        if history.exists() and len(history.read_text().splitlines()) > 5:
            break
        time.sleep(0.1)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    killed = read_history(history)
    assert 4 <= len(killed["psi"]) < 9
    runpy.run_path(written(part, resume=True), run_name="__main__")
    expected, computed = read_history(whole / "out" / "history.csv"), read_history(history)
    assert np.array_equal(computed["iteration"], expected["iteration"])
    # processes differ in their last bits: a start with another last bit ends 4e-9 apart, a run
    # that goes on without the state of the optimizer 4e-3 at once
    np.testing.assert_allclose(computed["psi"][:4], expected["psi"][:4], rtol=1e-9)
    np.testing.assert_allclose(computed["psi"], expected["psi"], rtol=1e-7)


def test_a_rank_without_disk_stops_all(tmp_path: Path) -> None:
    """The rank that writes fails: all ranks stop with its message instead of waiting for it."""
    before = (
        "import os\n"
        "if MPI.COMM_WORLD.rank == 0:\n"
        "    import resource, signal\n"
        "    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "    resource.setrlimit(resource.RLIMIT_FSIZE, (100, resource.RLIM_INFINITY))"
    )
    done = processes.run(written(tmp_path, before=before), ranks=2)
    assert done.returncode != 0
    assert done.stderr.count("File too large") >= 2
