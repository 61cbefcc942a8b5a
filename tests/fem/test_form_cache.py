# SPDX-License-Identifier: MIT
"""The directory of compiled forms: what a killed run leaves, and who may use which directory."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from mpi4py import MPI

import pytest
from shared import processes

from dolfinx_ffr.fem import form_cache
from dolfinx_ffr.fem.form_cache import claim_form_cache

#: Compiles one form; the first argument is put into it, so that another one is another form.
COMPILE = """
import sys
from mpi4py import MPI
import ufl
from dolfinx import fem, mesh
from dolfinx_ffr.fem.form_cache import claim_form_cache

directory = claim_form_cache(MPI.COMM_WORLD)
assert claim_form_cache(MPI.COMM_WORLD) == directory
print(directory, flush=True)
square = mesh.create_unit_square(MPI.COMM_WORLD, 2, 2)
x = ufl.SpatialCoordinate(square)
print(fem.assemble_scalar(fem.form(x[0] ** int(sys.argv[1]) * ufl.dx)), flush=True)
"""


def start(cache: Path, exponent: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        processes.command("-c", COMPILE, exponent),
        env=processes.environment(XDG_CACHE_HOME=str(cache)),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process: subprocess.Popen[str]) -> tuple[Path, float]:
    output, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors
    directory, value = output.split()
    return Path(directory), float(value)


@pytest.mark.slow
def test_finished_forms_are_kept_between_runs_and_others_removed(tmp_path: Path) -> None:
    directory, value = finish(start(tmp_path, "2"))
    assert directory == tmp_path / "dolfinx_ffr" / "forms-0"
    assert value == pytest.approx(1 / 3)
    finished = {path.name for path in directory.iterdir()}
    times = {path.name: path.stat().st_mtime_ns for path in directory.glob("*.so")}
    assert times
    for name in ("libffcx_forms_abc.c", "libffcx_forms_abc.o", "libffcx_forms_abc.x.so"):
        (directory / name).touch()
    again, value = finish(start(tmp_path, "2"))
    assert again == directory
    assert value == pytest.approx(1 / 3)
    assert {path.name: path.stat().st_mtime_ns for path in directory.glob("*.so")} == times
    assert {path.name for path in directory.iterdir()} == finished


@pytest.mark.slow
def test_run_killed_while_compiling_leaves_nothing_in_the_way(tmp_path: Path) -> None:
    process = start(tmp_path, "3")
    assert process.stdout is not None
    directory = Path(process.stdout.readline().strip())
    deadline = time.monotonic() + 120
    while not list(directory.glob("*.c")) and time.monotonic() < deadline:
        time.sleep(1e-3)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    marks = list(directory.glob("*.c"))
    assert marks
    assert not marks[0].with_suffix(".c.cached").exists(), "compiled before it could be killed"
    again, value = finish(start(tmp_path, "3"))
    assert again == directory
    assert value == pytest.approx(1 / 4)


def test_living_session_keeps_its_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another one has a directory beside it, with links to the forms that are finished."""
    monkeypatch.setattr(form_cache, "_lock", None)
    own_directory = form_cache._claim_first_free(tmp_path)
    lock = form_cache._lock
    for name in ("finished.c", "finished.c.cached", "finished.x.so", "unfinished.c"):
        (own_directory / name).touch()
    other_directory = form_cache._claim_first_free(tmp_path)
    assert other_directory == own_directory.with_name("forms-1")
    assert (own_directory / "unfinished.c").exists(), "a living session's form was removed"
    assert (own_directory / "finished.x.so").samefile(other_directory / "finished.x.so")
    assert not (other_directory / "unfinished.c").exists(), "an unfinished form was taken over"
    for descriptor in (lock, form_cache._lock):
        assert descriptor is not None
        os.close(descriptor)


@pytest.fixture
def no_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where temporary files are; the cache directory of the user is a file."""
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(form_cache, "_quiet", form_cache._Announcement())
    return tmp_path


def test_without_any_place_forms_are_removed_and_that_is_said(
    no_cache: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (no_cache / f"dolfinx_ffr-{os.getuid()}").touch()
    at_exit: list[Callable[[], None]] = []
    register = lambda call, *args, **options: at_exit.append(partial(call, *args, **options))  # noqa: E731
    monkeypatch.setattr("atexit.register", register)
    pool = form_cache._pool()
    assert no_cache in pool.parents and pool.is_dir()
    record = logging.LogRecord("", logging.INFO, "distutils/spawn.py", 1, "gcc", (), None)
    assert not form_cache._quiet.filter(record)
    assert "compiling finite-element forms, in each run" in capsys.readouterr().err
    at_exit[0]()
    assert not pool.exists()


@pytest.mark.mpi
def test_all_ranks_share_one_directory(comm: MPI.Intracomm) -> None:
    directory = claim_form_cache(comm)
    assert len(set(comm.allgather(directory))) == 1
    assert directory.is_dir()
    # A part of the ranks stays where it is.
    assert claim_form_cache(MPI.COMM_SELF) == directory
