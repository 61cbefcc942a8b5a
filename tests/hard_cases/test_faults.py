# SPDX-License-Identifier: MIT
"""Faults from outside: a killed process, a full disk, a rank that fails."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest

from dolfinx_ffr import read_history

pytestmark = pytest.mark.slow

DEMOS = Path(__file__).parents[2] / "demos"

#: a small design, as a program; the marks are filled in by each test
PROGRAM = """
import sys
sys.path.insert(0, {demos!r})
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


def command(folder: Path, ranks: int = 1, **marks: object) -> list[str]:
    """Return the command line of the program with its marks filled in."""
    defaults = {
        "demos": str(DEMOS),
        "before": "",
        "iterations": 12,
        "output": str(folder / "out"),
        "resume": False,
        "callback": None,
    }
    program = folder / f"program{len(list(folder.glob('program*')))}.py"
    program.write_text(textwrap.dedent(PROGRAM).format(**{**defaults, **marks}))
    line = [sys.executable, str(program)]
    return ["mpirun", "-n", str(ranks), *line] if ranks > 1 else line


def environment() -> dict[str, str]:
    """Return this process's environment, without what would make a child its rank."""
    ours = ("OMPI_COMM", "OMPI_UNIVERSE", "PMIX_", "PRTE_LAUNCHED")
    return {name: value for name, value in os.environ.items() if not name.startswith(ours)}


def run(line: list[str], **options: object) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    return subprocess.run(
        line,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        **options,  # type: ignore[call-overload]
    )


def test_killed_and_resumed(tmp_path: Path) -> None:
    """Kill -9 in the middle: the resumed run ends like one that was never killed."""
    whole = tmp_path / "whole"
    whole.mkdir()
    done = run(command(whole))
    assert done.returncode == 0, done.stderr[-2000:]

    part = tmp_path / "part"
    part.mkdir()
    # slow enough to be caught in the middle
    process = subprocess.Popen(
        command(part, before="import time", callback="lambda *_: time.sleep(0.3)"),
        env=environment(),
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
    done = run(command(part, resume=True))
    assert done.returncode == 0, done.stderr[-2000:]
    expected, found = read_history(whole / "out" / "history.csv"), read_history(history)
    assert np.array_equal(found["iteration"], expected["iteration"])
    np.testing.assert_allclose(found["psi"], expected["psi"], rtol=1e-9)


def test_full_disk(tmp_path: Path) -> None:
    """No room to write: one clear error, and the last complete checkpoint still serves."""
    assert run(command(tmp_path, iterations=3)).returncode == 0
    checkpoint = tmp_path / "out" / "checkpoint"
    good = checkpoint.read_bytes()
    # a limit on the size of files acts like a full disk from a certain byte on
    limit = "import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
    limit += (
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({len(good) // 2}, resource.RLIM_INFINITY))"
    )
    done = run(command(tmp_path, resume=True, iterations=6, before=limit))
    assert done.returncode != 0
    assert "OSError" in done.stderr and "File too large" in done.stderr
    assert checkpoint.read_bytes() == good
    resumed = run(command(tmp_path, resume=True, iterations=6))
    assert resumed.returncode == 0, resumed.stderr[-2000:]


def test_a_rank_without_disk_stops_all(tmp_path: Path) -> None:
    """The rank that writes fails: all ranks stop with its message instead of waiting for it."""
    before = (
        "import os\n"
        "if MPI.COMM_WORLD.rank == 0:\n"
        "    import resource, signal\n"
        "    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "    resource.setrlimit(resource.RLIMIT_FSIZE, (100, resource.RLIM_INFINITY))"
    )
    done = run(command(tmp_path, ranks=2, before=before))
    assert done.returncode != 0
    assert done.stderr.count("File too large") >= 2
