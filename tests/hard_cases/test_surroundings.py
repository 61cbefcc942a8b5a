# SPDX-License-Identifier: MIT
"""What a program meets around it: a full disk, no home directory, odd arguments, a terminal."""

from __future__ import annotations

import errno
import os
import resource
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared import TOP, processes
from shared.problems import Copy

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.caches import spare_directory
from dolfinx_ffr.program import run

BODY = ffr.VolumeIntegrals.rigid(1.0, inertia=1.0)
ROD = ffr.Domain.rectangle(MPI.COMM_SELF, 0.4, 0.04, elements=(8, 2))


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("summary.json", lambda path: ffr.write_summary(MPI.COMM_SELF, path, {"text": 99 * "x"})),
        ("body.npz", BODY.save),
        ("design.png", lambda path: plotting.plot_design(ROD, np.ones(ROD.n_cells), path)),
    ],
)
def test_a_full_disk_is_named_with_the_file(
    name: str, write: Callable[[Path], object], tmp_path: Path
) -> None:
    path = tmp_path / name
    write(path)  # fonts and the like are loaded before there is no room
    path.unlink()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, limits[1]))
    try:
        with pytest.raises(OSError, match=name) as caught:
            write(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert caught.value.errno == errno.EFBIG


def test_paths_that_are_not_utf8(tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"gr\xf6\xdfe")
    plotting.plot_design(ROD, np.ones(ROD.n_cells), folder / "design.png")
    ffr.write_summary(MPI.COMM_SELF, folder / "summary.json", {})
    ffr.write_density(ROD, np.ones(ROD.n_cells), folder / "design.xdmf")
    assert sorted(os.listdir(os.fsencode(folder))) == [
        *(b"design.h5", b"design.png", b"design.xdmf", b"summary.json"),
    ]


def test_a_program_says_in_one_line_what_is_wrong(tmp_path: Path) -> None:
    """With an umlaut of another encoding among its arguments, in the locale C."""
    arguments = ["--elements", "0", "3", "--output", os.fsdecode(bytes(tmp_path) + b"/gr\xf6\xdfe")]
    done = subprocess.run(
        processes.command(str(TOP / "demos" / "slider_crank.py"), *arguments),
        env=processes.environment(LC_ALL="C"),
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 1
    expected = "slider_crank.py: rectangle: elements must be a positive whole number, but it is 0"
    assert done.stderr.splitlines()[-1] == expected
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("raise ValueError('take more')", "program.py: take more"),
        ("ffr.Wendland(-1.0)", "program.py: Wendland kernel: radius must be positive"),
        ("raise MemoryError('too many steps')", "program.py: too many steps"),
        ("open('/no such file')", "program.py: [Errno 2] No such file"),
        ("np.ones(2) @ np.ones(3)", ""),
        ("np.linalg.inv(np.zeros((2, 2)))", ""),
        ("[].remove(1)", ""),
        ("fault()", ""),  # without end
        ("1 + None", ""),
    ],
)
def test_what_a_program_was_given_and_what_is_a_slip_in_it(
    fault: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line for the former; the latter keeps its traceback."""
    path = tmp_path / "program.py"
    path.write_text(f"def fault():\n    {fault}\n")
    names = {"np": np, "ffr": ffr}
    exec(compile(path.read_text(), path, "exec"), names)
    monkeypatch.setattr(sys, "argv", [str(path)])
    slips = (ValueError, RecursionError, TypeError, np.linalg.LinAlgError)
    with pytest.raises(SystemExit if said else slips) as caught:
        run(names["fault"])  # type: ignore[arg-type]
    assert str(caught.value).startswith(said)


#: A compiled function beside which nothing can be kept, as in a package that another has installed.
KERNEL = """
import numba
from dolfinx_ffr.dynamics.compilation import compiled

@compiled(float)
def one(x):
    return 1

before = numba.config.CACHE_DIR
assert one(0.0) == 1
assert numba.config.CACHE_DIR == before
"""


def test_without_a_home_compiled_functions_are_kept_among_the_temporary_files(
    tmp_path: Path,
) -> None:
    (tmp_path / "module.py").write_text(KERNEL)
    for nothing in ("__pycache__", "no directory"):
        (tmp_path / nothing).touch()
    (tmp_path / "tmp").mkdir()
    no_home = str(tmp_path / "no directory")
    environment = processes.environment(
        HOME=no_home, XDG_CACHE_HOME=no_home, TMPDIR=str(tmp_path / "tmp")
    )
    environment.pop("NUMBA_CACHE_DIR", None)
    times = []
    for _ in range(2):
        subprocess.run(
            processes.command("-W", "error::UserWarning", str(tmp_path / "module.py")),
            env=environment,
            timeout=300,
            check=True,
        )
        kept = (tmp_path / "tmp").glob(f"dolfinx_ffr-{os.getuid()}/kernels/**/*.nbc")
        times.append({path.name: path.stat().st_mtime_ns for path in kept})
    assert times[0]
    assert times[1] == times[0], "compiled once more"


def test_a_directory_that_others_may_write_to_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    own = spare_directory()
    assert own is not None and own.stat().st_mode & 0o777 == 0o700
    own.chmod(0o777)
    assert spare_directory() is None
    own.rmdir()
    own.symlink_to(tmp_path)
    assert spare_directory() is None


class Hasty(Copy):
    """A problem whose motions are too fast for their steps, of each design by another number."""

    def value(self, x: np.ndarray) -> Any:
        found = super().value(x)
        for name in ("link 1", "link 2"):
            text = f"body {name!r} is deformed by {0.05 + 1e-3 * self.calls:.2g} of its length"
            warnings.warn(text, ffr.LargeDeformationWarning, stacklevel=1)
        return found


@pytest.mark.parametrize("progress", [True, False])
@pytest.mark.parametrize("optimizer", [ffr.LevelSetEvolution(), ffr.MMA()], ids=["steps", "MMA"])
def test_warnings_of_a_run(
    optimizer: Any,
    progress: bool,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They stand above the progress bar, and those of the motions come once for each body."""
    problem = Hasty(MPI.COMM_SELF, lambda c: 0.5 + 0.0 * c[:, 0])
    levelset = ffr.LevelSet(problem.domain)
    monkeypatch.setattr(
        warnings, "showwarning", lambda message, *_: print(f"said: {message}", file=sys.stderr)
    )
    before = warnings.showwarning
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        ffr.optimize(
            problem,  # type: ignore[arg-type]
            levelset,
            levelset.with_holes(4, 1, 0.012),
            volume=0.9,
            iterations=2,
            optimizer=optimizer,
            progress=progress,
            callback=lambda *_: warnings.warn("something to know", stacklevel=1),
        )
    assert warnings.showwarning is before
    shown = capsys.readouterr().err
    assert shown.count("said: something to know\n") == 2
    assert [shown.count(f"said: body 'link {k}' is deformed") for k in (1, 2)] == [1, 1]
    # the line of the bar has been cleared, and the cursor stands at its beginning
    assert all(part.endswith(("\r", "\n")) for part in shown.split("said: ")[1:-1])
    assert shown.partition("said: ")[0].endswith("\r") is progress
