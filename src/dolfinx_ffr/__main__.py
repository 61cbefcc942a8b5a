# SPDX-License-Identifier: MIT
"""Commands of the package: ``dolfinx_ffr design rod.toml``, and what stands beside it."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from .program import run

#: Name, line of help, and an example, in the order in which a user meets them
_COMMANDS = {
    "new": ("write a commented example of a scene file", "slider_crank"),
    "check": ("draw a scene, simulate its full bodies, say what to expect", "slider_crank.toml"),
    "design": ("design the bodies of a scene file, to parts and a report", "slider_crank.toml"),
    "report": ("write the report of a run as one HTML file", "results/slider_crank"),
    "compile": ("compile the time integration before its first use, once on a machine", "--all"),
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command with ``arguments``, by default the arguments of the process."""
    parser = argparse.ArgumentParser(
        "dolfinx_ffr",
        description="From an outline and a motion to a part.",
        epilog="dolfinx_ffr COMMAND --help says what a command takes.",
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    parsers = {
        name: commands.add_parser(
            name,
            help=text,
            description=f"{text[0].upper()}{text[1:]}.",
            epilog=f"Example: dolfinx_ffr {name} {example}",
        )
        for name, (text, example) in _COMMANDS.items()
    }
    new, check, design, report, compile_ = parsers.values()
    new.add_argument("name", nargs="?", help="of the example; without it they are listed")
    for command in (check, design):
        command.add_argument("file", type=Path, help="scene file, TOML")
        text = "folder of the results (default: as in the file)"
        command.add_argument("--output", type=Path, help=text)
    text = "go on from the checkpoint, as after Ctrl-C"
    design.add_argument("--resume", action="store_true", help=text)
    text = "replace the results of an earlier run"
    design.add_argument("--overwrite", action="store_true", help=text)
    report.add_argument("folder", help="of the run, for example results/slider_crank")
    report.add_argument("--output", help="file to write (default: report.html in the folder)")
    report.add_argument("--title", default="", help="heading (default: the recorded one)")
    compile_.add_argument("--all", action="store_true", help="all integrators")
    options = parser.parse_args(arguments)
    if options.command is None:
        parser.print_help(sys.stderr)
        parser.exit(2, "\ndolfinx_ffr: error: say which command\n")
    if options.command == "compile":
        compile_beforehand(everything=options.all)
    elif options.command == "report":
        make_report(options.folder, options.output, options.title)
    elif code := with_scene(options):
        sys.exit(code)


def with_scene(options: argparse.Namespace) -> int:
    """Run a command on a scene file; the exit code."""
    from . import scene_file

    try:
        if options.command == "new":
            return scene_file.new(options.name, Path())
        if options.command == "check":
            return scene_file.check(options.file, output=options.output)
        how = {"resume": options.resume, "overwrite": options.overwrite}
        return scene_file.design(options.file, output=options.output, **how)
    except KeyboardInterrupt:
        print("dolfinx_ffr: interrupted", file=sys.stderr)
        return scene_file.INTERRUPTED


def console() -> None:
    """The program ``dolfinx_ffr``."""
    run(main)


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
    console()
