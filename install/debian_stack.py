# SPDX-License-Identifier: MIT
"""Versions of Debian's numerical packages: constraints for pip and the check that pip kept to them.

`constraints` is run by Debian's Python and prints one pip constraint for each package; `check FILE`
is run by the virtual environment's Python and fails when one of them no longer comes from Debian.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

#: Distribution and module names: DOLFINx and what is compiled together with it.
STACK = {
    "numpy": "numpy",
    "scipy": "scipy",
    "numba": "numba",
    "llvmlite": "llvmlite",
    "matplotlib": "matplotlib",
    "pillow": "PIL",
    "cffi": "cffi",
    "threadpoolctl": "threadpoolctl",
    "mpi4py": "mpi4py",
    "petsc4py": "petsc4py",
    "slepc4py": "slepc4py",
    "fenics-dolfinx": "dolfinx",
}


def constraints() -> None:
    """Print one line `name==version` for each package of the stack that Debian has installed."""
    for name in STACK:
        try:
            print(f"{name}=={distribution(name).version}")
        except PackageNotFoundError:
            pass


def check(path: Path) -> None:
    """Check origin and version of the packages named in the file, and that the BLAS is a fast one.

    Raises:
        SystemExit: If a package does not come from Debian, or if the BLAS is the reference one.
    """
    faults = []
    for line in path.read_text().split():
        name, version = line.split("==")
        spec = importlib.util.find_spec(STACK[name])
        origin = str(spec and spec.origin)
        if not origin.startswith("/usr/lib/"):
            faults.append(f"{name} is {origin}, which is not Debian's")
        if distribution(name).version != version:
            faults.append(f"{name} is {distribution(name).version}, Debian's is {version}")
    if faults:
        sys.exit("\n".join(faults))

    for module_name in ("dolfinx.fem", "dolfinx.mesh", "gmsh", "pyvista"):
        importlib.import_module(module_name)

    from threadpoolctl import threadpool_info

    if not any(library["user_api"] == "blas" for library in threadpool_info()):
        sys.exit(
            "NumPy uses the slow reference BLAS; select OpenBLAS for the names that "
            "`update-alternatives --get-selections | grep blas` lists, "
            "each by `update-alternatives --config NAME`"
        )


if __name__ == "__main__":
    if sys.argv[1:] == ["constraints"]:
        constraints()
    elif sys.argv[1:2] == ["check"] and len(sys.argv) == 3:
        check(Path(sys.argv[2]))
    else:
        sys.exit("usage: debian_stack.py constraints | check FILE")
