# SPDX-License-Identifier: MIT
"""Checks and remedies before other packages are loaded, without which they stop the program.

`prepare` is called when `dolfinx_ffr` is imported, and loads no package where all is well.
"""

from __future__ import annotations

import ctypes
import io
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, suppress
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

#: Where Debian's packages are, which are compiled for Debian's NumPy.
_DEBIAN = "/usr/lib/"
#: Packages compiled for a NumPy, each with the module that shows whether it is the one at hand.
_COMPILED = {"scipy": "scipy.sparse", "numba": "numba"}
#: Packages that come with FEniCSx, not from PyPI.
_FENICS = {"basix", "dolfinx", "ffcx", "gmsh", "mpi4py", "petsc4py", "slepc4py", "ufl"}
#: A function of `std::regex` that has the same name with strings of both kinds (`_load_vtk_apart`).
_AMBIGUOUS = "_ZNSt8__detail8_ScannerIcE14_M_scan_normalEv"


def prepare() -> None:
    """See to threads, NumPy, VTK, the arguments of the program, and PETSc on several ranks."""
    _limit_threads()
    _check_numpy()
    _load_vtk_apart()
    _load_dolfinx_with_readable_arguments()
    _begin_petsc_on_all_ranks()


@contextmanager
def working_with_numpy(name: str) -> Iterator[None]:
    """Context for the import of a package: where it does not work with NumPy, say what to do."""
    notes = io.StringIO()  # of NumPy, some forty lines
    try:
        with redirect_stderr(notes):
            yield
    except (AttributeError, ImportError, SystemError, ValueError) as error:
        missing = error.name or "" if isinstance(error, ModuleNotFoundError) else "numpy"
        if not missing.startswith("numpy"):
            raise
        remedy = f"install a {name} that goes with it"
        if _place(name).startswith(_DEBIAN) and not _place("numpy").startswith(_DEBIAN):
            remedy = (
                f"remove this NumPy by '{sys.executable} -m pip uninstall numpy', so that Debian's "
                "is found again, and install dolfinx_ffr as before, which puts packages that go "
                "with it in the place of those that do not"
            )
        raise ImportError(
            f"{name} {_version(name)} in {_place(name)} does not work with NumPy "
            f"{_version('numpy')} in {_place('numpy')} ({error}): {remedy}"
        ) from error
    print(notes.getvalue(), end="", file=sys.stderr)


@contextmanager
def needing_fenics(name: str) -> Iterator[None]:
    """Context for the import of what needs FEniCSx: where that is missing, say where to get it."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name not in _FENICS:
            raise
        raise ModuleNotFoundError(
            f"{name} needs {error.name}, which {sys.executable} does not find and pip does not "
            "bring: FEniCSx comes from Debian or from conda-forge, as dolfinx_ffr's README says. "
            "An environment sees Debian's packages if it is made by '/usr/bin/python3 -m venv "
            "--system-site-packages FOLDER'",
            name=error.name,
        ) from error


def _limit_threads() -> None:
    """Let CHOLMOD have as many threads as OMP_NUM_THREADS says, where that says something.

    That of SuiteSparse 5 starts four some thousands of times in a factor, whatever it says, which
    on two processors takes as long as the factor. OpenMP reads the limit when it is loaded.
    """
    wanted = os.environ.get("OMP_NUM_THREADS", "")
    if wanted.isdigit():
        os.environ.setdefault("OMP_THREAD_LIMIT", wanted)


def _check_numpy() -> None:
    """Try compiled packages that do not come from where NumPy comes from, Debian or elsewhere."""
    debian = _place("numpy").startswith(_DEBIAN)
    for name, module in _COMPILED.items():
        if _place(name) and _place(name).startswith(_DEBIAN) != debian:
            with working_with_numpy(name):
                import_module(module)


def _place(name: str) -> str:
    """Folder that a package is imported from, "" for none."""
    spec = None
    with suppress(ValueError):  # a module that somebody has made by hand
        spec = find_spec(name)
    return str(Path(spec.origin).parents[1]) + "/" if spec and spec.origin else ""


def _version(name: str) -> str:
    """Version of a package, which need not be importable."""
    from importlib.metadata import PackageNotFoundError, version  # takes a while

    with suppress(PackageNotFoundError):
        return version(name)
    return "of unknown version"


def _load_vtk_apart() -> None:
    """Load the core of VTK so that it finds its own functions before those of DOLFINx.

    VTK from PyPI is compiled with the strings that C++ had before 2011, Debian's DOLFINx with
    those of today. In `std::regex` a class that holds one has the same name with both, so that of
    two libraries that offer its functions to all, the first serves both. DOLFINx offers them: it
    is loaded with RTLD_GLOBAL. VTK, where it is loaded later, would take them for its own, and
    the first scalar bar would end the process by `std::bad_alloc`. With RTLD_DEEPBIND it takes
    its own functions, and loaded libraries do not change.
    """
    if not _place("vtkmodules") or not _place("dolfinx"):
        return
    # VTK of conda-forge and of Debian is elsewhere, and compiled like DOLFINx.
    libraries = list(Path(_place("vtkmodules"), "vtkmodules").glob("libvtkCommonCore[.-]*so*"))
    # It would also take the C library's malloc in place of one that is loaded before all else.
    apart = 0 if os.environ.get("LD_PRELOAD") else getattr(os, "RTLD_DEEPBIND", 0)
    loaded = list(sys.modules)
    has_vtk = "vtkmodules" in loaded
    after_dolfinx = "dolfinx" in (loaded[: loaded.index("vtkmodules")] if has_vtk else loaded)
    if not has_vtk and (apart or not after_dolfinx):
        for file in libraries:
            with suppress(OSError):  # its own import says what is wrong
                ctypes.CDLL(str(file), os.RTLD_NOW | os.RTLD_LOCAL | apart)
    elif libraries and after_dolfinx and hasattr(ctypes.CDLL(None), _AMBIGUOUS):
        warnings.warn(
            "dolfinx has been imported before pyvista and dolfinx_ffr, so that VTK takes functions "
            "of DOLFINx for its own: the first picture with a scalar bar would end the process "
            "(std::bad_alloc). Import dolfinx_ffr, or pyvista, before the other two, in a "
            "notebook after a restart of its kernel.",
            RuntimeWarning,
            stacklevel=4,  # who imports dolfinx_ffr
        )


def _load_dolfinx_with_readable_arguments() -> None:
    """Load DOLFINx, which cannot be imported where an argument of the program is not UTF-8."""
    arguments = sys.argv
    readable = [text.encode(errors="replace").decode() for text in arguments]
    if readable == arguments or "dolfinx" in sys.modules:
        return
    sys.argv = readable
    try:
        with suppress(ImportError):
            import_module("dolfinx")
    finally:
        sys.argv = arguments


def _begin_petsc_on_all_ranks() -> None:
    """Load PETSc and SLEPc with the package where mpi4py has been imported on several ranks.

    They begin by a call of MPI that takes all ranks. Loaded when they are first needed, as all else
    is, they would let a rank wait for ever that alone makes a body of its own.
    """
    mpi = sys.modules.get("mpi4py.MPI")
    if mpi is None or not mpi.Is_initialized() or mpi.COMM_WORLD.size == 1:
        return
    for module in ("petsc4py.PETSc", "slepc4py.SLEPc"):
        with suppress(ImportError):  # the mechanical half needs neither
            import_module(module)
