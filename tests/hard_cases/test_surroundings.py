# SPDX-License-Identifier: MIT
"""What a program meets around it: a full disk, no home directory, odd arguments, a terminal."""

from __future__ import annotations

import errno
import os
import re
import resource
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
from shared.rods import STEEL

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.files import file_names, spare_directory
from dolfinx_ffr.io import save_checkpoint, write_history
from dolfinx_ffr.program import run
from dolfinx_ffr.surroundings import working_with_numpy

BODY = ffr.VolumeIntegrals.rigid(1.0, inertia=1.0)
ROD = ffr.Domain.rectangle(MPI.COMM_SELF, 0.4, 0.04, elements=(8, 2))
FULL = np.ones(ROD.n_cells)
PART = ffr.Part(ROD, lambda p: np.ones(len(p)), material=STEEL)


def report(path: Path) -> None:
    folder = path.parent / "run"
    if not folder.exists():
        ffr.write_summary(MPI.COMM_SELF, folder / "summary.json", {"psi": 1.0})
    ffr.write_report(MPI.COMM_SELF, folder, output=path)


WRITERS: dict[str, Callable[[Path], object]] = {
    "summary.json": lambda path: ffr.write_summary(MPI.COMM_SELF, path, {"text": 9999 * "x"}),
    "history.csv": lambda path: write_history(MPI.COMM_SELF, path, ["psi"], [{"psi": 1.0}] * 999),
    "report.html": report,
    "body.npz": BODY.save,
    "checkpoint": lambda path: save_checkpoint(MPI.COMM_SELF, path, {"phi": np.arange(99.0)}),
    "design.png": lambda path: plotting.plot_design(ROD, FULL, path),
    "design.xdmf": lambda path: ffr.write_density(ROD, FULL, path),
    **{f"part.{kind}": PART.write for kind in ("svg", "dxf", "step", "stl")},
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_is_named_with_the_file(name: str, tmp_path: Path) -> None:
    """And the file that was there stays as it was, none is cut."""
    path, write = tmp_path / name, WRITERS[name]
    write(path)  # fonts and the like are loaded before there is no room
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    room = 400
    assert len(before[path]) > room
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, limits[1]))
    try:
        with pytest.raises(OSError, match=name) as caught:
            write(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert caught.value.errno == errno.EFBIG
    after = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    assert after == before


def test_names_become_distinct_file_names_within_their_folder() -> None:
    names = ["link 1", "link_1", "../../x", "/etc/x", "..", "", "Arm", "arm", "checkpoint"]
    names += [300 * "n", 300 * "n" + "2", "Glied ä", os.fsdecode(b"gr\xf6"), "a\0b", "-rf", ".lock"]
    names_of_files = file_names(names)
    assert list(names_of_files) == names
    assert names_of_files["link_1"] == "link_1" and names_of_files["link 1"] == "link_1-2"
    assert len({directory.casefold() for directory in names_of_files.values()}) == len(names)
    for directory in names_of_files.values():
        assert (
            Path(directory).name == directory
            and directory not in ("", "checkpoint")
            and "." not in directory
        )
        assert (
            len(os.fsencode(directory)) < 200 and directory[0] not in ".-" and "\0" not in directory
        )


def test_paths_that_are_not_utf8(tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"gr\xf6\xdfe")
    plotting.plot_design(ROD, np.ones(ROD.n_cells), folder / "design.png")
    ffr.write_summary(MPI.COMM_SELF, folder / "summary.json", {})
    ffr.write_density(ROD, np.ones(ROD.n_cells), folder / "design.xdmf")
    assert sorted(os.listdir(os.fsencode(folder))) == [
        *(b"design.h5", b"design.png", b"design.xdmf", b"summary.json")
    ]


@pytest.mark.slow
def test_a_program_says_in_one_line_what_is_wrong(tmp_path: Path) -> None:
    """With an umlaut of another encoding among its arguments, in the locale C."""
    arguments = ["--elements", "0", "3", "--output", os.fsdecode(bytes(tmp_path) + b"/gr\xf6\xdfe")]
    done = processes.run(str(TOP / "demos" / "slider_crank.py"), *arguments, LC_ALL="C")
    assert done.returncode == 1
    expected = "slider_crank.py: rectangle: elements must be a positive whole number, but it is 0"
    assert done.stderr.splitlines()[-1] == expected
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("fault", "message"),
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
    fault: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line for the former; the latter keeps its traceback."""
    path = tmp_path / "program.py"
    path.write_text(f"def fault():\n    {fault}\n")
    names = {"np": np, "ffr": ffr}
    exec(compile(path.read_text(), path, "exec"), names)
    monkeypatch.setattr(sys, "argv", [str(path)])
    slips = (ValueError, RecursionError, TypeError, np.linalg.LinAlgError)
    with pytest.raises(SystemExit if message else slips) as caught:
        run(names["fault"])  # type: ignore[arg-type]
    assert str(caught.value).startswith(message)


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


@pytest.mark.slow
def test_without_a_home_compiled_functions_are_kept_among_the_temporary_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "module.py").write_text(KERNEL)
    for nothing in ("__pycache__", "no directory"):
        (tmp_path / nothing).touch()
    (tmp_path / "tmp").mkdir()
    no_home = str(tmp_path / "no directory")
    variables = {"HOME": no_home, "XDG_CACHE_HOME": no_home, "TMPDIR": str(tmp_path / "tmp")}
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    times = []
    for _ in range(2):
        program = "-W", "error::UserWarning", str(tmp_path / "module.py")
        done = processes.run(*program, **variables)
        assert done.returncode == 0, done.stderr
        kernels = (tmp_path / "tmp").glob(f"dolfinx_ffr-{os.getuid()}/kernels/**/*.nbc")
        times.append({path.name: path.stat().st_mtime_ns for path in kernels})
    assert times[0]
    assert times[1] == times[0], "compiled once more"


def test_a_directory_of_others_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    directory = spare_directory()
    assert directory is not None and directory.stat().st_mode & 0o777 == 0o700
    directory.chmod(0o777)
    assert spare_directory() is None
    directory.rmdir()
    directory.symlink_to(tmp_path)
    assert spare_directory() is None


class Hasty(Copy):
    """A problem whose motions are too fast for their steps, of each design by another number."""

    def value(self, x: np.ndarray) -> Any:
        evaluation = super().value(x)
        for name in ("link 1", "link 2"):
            text = f"body {name!r} is deformed by {0.05 + 1e-3 * self.calls:.2g} of its length"
            warnings.warn(text, ffr.LargeDeformationWarning, stacklevel=1)
        return evaluation


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
    before = lambda message, *_: print(f"said: {message}", file=sys.stderr)  # noqa: E731
    monkeypatch.setattr(warnings, "showwarning", before)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        metadata_file = {
            "volume": 0.9,
            "iterations": 2,
            "optimizer": optimizer,
            "progress": progress,
        }
        said = lambda *_: warnings.warn("something to know", stacklevel=1)  # noqa: E731
        start = levelset.with_holes(4, 1, 0.012)
        ffr.optimize(problem, levelset, start, **metadata_file, callback=said)  # type: ignore[arg-type]
    assert warnings.showwarning is before
    errors = capsys.readouterr().err
    assert errors.count("said: something to know\n") == 2
    assert [errors.count(f"said: body 'link {k}' is deformed") for k in (1, 2)] == [1, 1]
    # the line of the bar has been cleared, and the cursor stands at its beginning
    assert all(part.endswith(("\r", "\n")) for part in errors.split("said: ")[1:-1])
    assert errors.partition("said: ")[0].endswith("\r") is progress


#: Scalar bars of a plane body and of one in space, after imports in a certain order.
SCALAR_BARS = """
import sys, warnings
warnings.filterwarnings("error", ".* Import dolfinx_ffr, or pyvista, before the other")
for name in sys.argv[1:]:
    __import__(name)
import pyvista
from mpi4py import MPI
import dolfinx_ffr as ffr
from dolfinx_ffr.plotting import mesh_grid

plane = ffr.Domain.rectangle(MPI.COMM_SELF, 0.4, 0.1, elements=(8, 1))
space = ffr.Domain.box(MPI.COMM_SELF, 0.4, 0.1, 0.1, elements=(8, 1, 1))
for domain in (plane, space):
    plotter = pyvista.Plotter(off_screen=True, window_size=(200, 200))
    plotter.add_mesh(mesh_grid(domain, {"x": range(8)}), scalars="x")
    assert plotter.screenshot(return_img=True).std() > 10.0
    plotter.close()
print("drawn")
"""


#: Imports beside that of the plotting alone, which its tests have; the last may be too late.
ORDERS = (
    ("dolfinx", "dolfinx_ffr", "pyvista"),
    ("pyvista", "dolfinx", "dolfinx_ffr"),
    ("dolfinx", "pyvista", "dolfinx_ffr"),
)


@pytest.mark.slow
@pytest.mark.parametrize("order", ORDERS, ids=" ".join)
def test_pyvista_draws_whatever_is_imported_first(order: tuple[str, ...]) -> None:
    """VTK of PyPI and DOLFINx of Debian 12 differ in the kind of strings that they are made of."""
    done = processes.run("-c", SCALAR_BARS, *order)
    if order == ORDERS[-1] and done.returncode == 1:  # DOLFINx of a later release may let it work
        assert done.stderr.splitlines()[-1].startswith("RuntimeWarning: dolfinx has been")
    else:
        assert (done.returncode, done.stdout.split()) == (0, ["drawn"]), done.stderr


#: A package that does not work, its source, the module that imports it, and what is said.
STRANGE = {
    "numpy": ("", "", r"scipy \d\S+ in /usr/lib/\S+ .* NumPy 9\.0 in .*pip uninstall numpy"),
    "numba": (
        "raise ImportError('Numba needs NumPy 0.9 or less')",
        "",
        r"numba 9\.0 in .* NumPy \d\S+ in /usr/lib/\S+ \(Numba needs NumPy 0\.9 or less\): "
        "install a numba that goes with it",
    ),
    "petsc4py": (
        "raise ValueError('numpy.dtype size changed')",
        ".fem",
        r"petsc4py 9\.0 in .* NumPy \d\S+ in /usr/lib/\S+ \(numpy\.dtype size changed\): ",
    ),
}


@pytest.mark.parametrize("strange", STRANGE)
def test_a_numpy_that_others_are_not_compiled_for(strange: str, tmp_path: Path) -> None:
    """Both versions and the remedy, at the import and before anything is computed."""
    source, module, message = STRANGE[strange]
    metadata = f"Metadata-Version: 2.1\nName: {strange}\nVersion: 9.0\n"
    metadata_file = f"{strange}-9.0.dist-info/METADATA"
    for name, text in ((f"{strange}/__init__.py", source), (metadata_file, metadata)):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text(text)
    names_of_files = f"{tmp_path}{os.pathsep}{processes.environment()['PYTHONPATH']}"
    done = processes.run("-c", f"import dolfinx_ffr{module}", PYTHONPATH=names_of_files)
    assert done.returncode == 1
    assert re.match(f"ImportError: {message}", done.stderr.splitlines()[-1]), done.stderr


def test_a_missing_package_of_another_is_not_laid_to_numpy() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"^llvmlite$"), working_with_numpy("numba"):
        raise ModuleNotFoundError("llvmlite", name="llvmlite")


@pytest.mark.slow
def test_without_fenics_one_is_told_where_it_comes_from() -> None:
    program = "import sys; sys.modules['mpi4py'] = None; import dolfinx_ffr; dolfinx_ffr.Domain"
    done = processes.run("-c", program)
    assert done.returncode == 1
    message = (
        r"ModuleNotFoundError: dolfinx_ffr\.Domain needs mpi4py, .* Debian or from conda-forge"
    )
    assert re.match(message, done.stderr.splitlines()[-1]), done.stderr


def test_a_rank_makes_a_body_of_its_own() -> None:
    """The other ranks go on meanwhile: nothing that it loads takes all of them."""
    program = """
from mpi4py import MPI
import dolfinx_ffr as ffr
if MPI.COMM_WORLD.rank == 1:
    print(ffr.Domain.rectangle(MPI.COMM_SELF, 0.4, 0.04, elements=(8, 2)).n_cells)
"""
    done = processes.run("-c", program, ranks=2, OMPI_MCA_rmaps_base_oversubscribe="1")
    assert (done.returncode, done.stdout.split()) == (0, ["16"]), done.stderr
