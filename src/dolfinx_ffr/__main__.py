# SPDX-License-Identifier: MIT
"""Commands of the package.

``python -m dolfinx_ffr compile`` compiles the time integration before its first use;
``python -m dolfinx_ffr report FOLDER`` writes the report of a run from the files of its folder.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence

from .program import run


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command with ``arguments``, by default those of the process."""
    parser = argparse.ArgumentParser(
        "python -m dolfinx_ffr",
        description="Commands beside the package; designs are made by programs (make demo).",
        epilog="python -m dolfinx_ffr COMMAND --help tells what a command takes.",
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    compilation = commands.add_parser(
        "compile",
        help="compile the time integration before its first use, once on a machine",
        description="Compiles what the demos need, or loads it where that has been done.",
    )
    compilation.add_argument("--all", action="store_true", help="all integrators")
    report = commands.add_parser(
        "report",
        help="write the report of a run as one HTML file",
        description="Writes the report of a run from the files that it has left in its folder.",
    )
    report.add_argument("folder", help="of the run, for example results/slider_crank")
    report.add_argument("--output", help="file to write (default: report.html in the folder)")
    report.add_argument("--title", default="", help="heading (default: the recorded one)")
    given = parser.parse_args(arguments)
    if given.command is None:
        parser.print_help(sys.stderr)
        parser.exit(2, "\npython -m dolfinx_ffr: error: say which command\n")
    if given.command == "compile":
        compile_beforehand(everything=given.all)
    else:
        make_report(given.folder, given.output, given.title)


def compile_beforehand(*, everything: bool) -> None:
    """Compile what demos need, or ``everything``: all integrators, in the plane and in space."""
    from tqdm import tqdm

    from .dynamics import INTEGRATORS, GeneralizedAlpha, compile_side_by_side, compiled_functions

    began = time.perf_counter()
    functions = compiled_functions(INTEGRATORS if everything else (GeneralizedAlpha,))
    if everything:
        functions = list(dict.fromkeys([*compiled_functions(space=True), *functions]))
    text = "compiling the time integration"
    with tqdm(total=len(functions), desc=text, unit="function") as bar:
        for name in compile_side_by_side(functions):
            bar.set_postfix_str(name, refresh=False)
            bar.update()
    print(f"compiled {len(functions)} functions in {time.perf_counter() - began:.0f} s")


def make_report(folder: str, output: str | None, title: str) -> None:
    """Write the report of a run and print where it is."""
    from mpi4py import MPI

    from .report import write_report

    comm = MPI.COMM_WORLD
    file = write_report(comm, folder, output=output, title=title)
    if comm.rank == 0:
        print(file)


if __name__ == "__main__":
    run(main)
