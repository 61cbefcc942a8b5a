# SPDX-License-Identifier: MIT
"""Command of the package: ``python -m dolfinx_ffr compile`` compiles the time integration."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from .program import run


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command.

    Args:
        arguments: Arguments; those of the process if left out.
    """
    parser = argparse.ArgumentParser("python -m dolfinx_ffr", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    compilation = commands.add_parser(
        "compile",
        help="compile the time integration before its first use, once on a machine",
        description="Compiles what the demos need, or loads it where that has been done.",
    )
    compilation.add_argument("--all", action="store_true", help="all integrators")
    compile_beforehand(everything=parser.parse_args(arguments).all)


def compile_beforehand(*, everything: bool) -> None:
    """Compile the time integration, with a bar of progress.

    Args:
        everything: Whether to compile all integrators, or only the one that the demos take.
    """
    from tqdm import tqdm

    from .dynamics import INTEGRATORS, GeneralizedAlpha, compile_side_by_side, compiled_functions

    began = time.perf_counter()
    functions = compiled_functions(INTEGRATORS if everything else (GeneralizedAlpha,))
    text = "compiling the time integration"
    with tqdm(total=len(functions), desc=text, unit="function") as bar:
        for name in compile_side_by_side(functions):
            bar.set_postfix_str(name, refresh=False)
            bar.update()
    print(f"compiled {len(functions)} functions in {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    run(main)
