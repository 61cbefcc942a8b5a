# SPDX-License-Identifier: MIT
"""What the demos have in common: options, the record that they leave, and what rank 0 says."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

import dolfinx_ffr as ffr
from dolfinx_ffr.program import run as run

HELP = {
    "elements": "of a body, along its axes",
    "iterations": "at most",
    "steps": "of time; by default some demos choose them for an accuracy of psi",
    "order": "of the displacements",
    "boundary": "steps of the boundary after them; by default half as many",
    "resume": "go on from the last checkpoint",
    "bare": "only verify the part, and write it for CAD",
    "densities": "for each element, in place of a level set",
}
#: What is as fine as a default
AS_FINE = {"elements": np.greater_equal, "iterations": np.greater_equal, "size": np.less_equal}


def parse(arguments: list[str] | None, name: str, **defaults: Any) -> argparse.Namespace:
    """The options of a demo, ``run`` those of `optimize`; ``complete`` if as fine as by default.

    The defaults tell of which kind options are: None stands for a whole number that is chosen
    elsewhere, an empty text for a gmsh file.
    """
    style = argparse.ArgumentDefaultsHelpFormatter
    parser = argparse.ArgumentParser(description=f"The demo {name}.", formatter_class=style)
    for option, default in {**defaults, "output": Path("results", name)}.items():
        kind: dict[str, Any] = {"type": int if default is None else type(default)}
        if default is False:
            kind = {"action": "store_true"}
        elif isinstance(default, tuple):
            kind = {"nargs": len(default), "type": int}
        text = HELP.get(option, "gmsh file, its ends 'left' and 'right'" if default == "" else " ")
        parser.add_argument("--" + option.replace("_", "-"), default=default, help=text, **kind)
    options = parser.parse_args(arguments)
    settings = vars(options)
    if "elements" in settings:
        options.elements = tuple(options.elements)
    own_mesh = any(value for option, value in settings.items() if "mesh" in option)
    fine = [fits(settings[n], defaults[n]) for n, fits in AS_FINE.items() if n in defaults]
    options.complete = not own_mesh and all(np.all(entry) for entry in fine)
    options.comm = MPI.COMM_WORLD
    of_run = ("iterations", "boundary", "resume", "output")
    options.run = {name: settings[name] for name in of_run if name in settings}
    return options


def say(*words: object, sep: str = " ") -> None:
    """Print on rank 0."""
    if MPI.COMM_WORLD.rank == 0:
        print(*words, sep=sep)


def bars(options: argparse.Namespace, sizes: Mapping[str, Any]) -> dict[str, ffr.Domain]:
    """Bars of lengths and heights [m] with equal elements, or gmsh files that take their places."""
    comm, domains = MPI.COMM_WORLD, {}
    first_length = next(iter(sizes.values()))[0]
    for name, (length, height) in sizes.items():
        file = getattr(options, f"{name}_mesh", "")
        along = max(6, round(options.elements[0] * length / first_length))
        elements = along, options.elements[1]
        built = None if file else ffr.Domain.rectangle(comm, length, height, elements=elements)
        domains[name] = built or ffr.Domain.from_gmsh(comm, file)
    return domains


def bar_of(options: argparse.Namespace, length: float, height: float) -> ffr.Domain:
    """A bar of order 2 without solid columns [m], or the gmsh file of the options."""
    if options.mesh:
        return ffr.Domain.from_gmsh(MPI.COMM_WORLD, options.mesh, order=2)
    size = {"elements": options.elements, "order": 2, "solid_columns": 0}
    return ffr.Domain.rectangle(MPI.COMM_WORLD, length, height, **size)


def draw(
    result: ffr.Result, output: Path, *, full: float = 0.0, volume: float | None = None, **view: Any
) -> None:
    """Draw the design of each body, the history, the scene and the film; collective.

    ``full`` is the compliance of full bodies, ``volume`` the bound of the filled share, and the
    options ``view`` are for `plot_scene`. Without ``full`` psi is an error of a path.
    """
    for name, x in result.densities.items():
        single = len(result.densities) == 1
        domain, file = result.problem.flexible[name].domain, name.replace(" ", "_")
        share, file = result.evaluation.psi / (full or 1.0), "design" if single else file
        title = f"{share:.1%} of the full {name}'s psi with " if single and full else f"{name}: "
        title = f"{title}{result.evaluation.volume[name]:.0%} of its material"
        ffr.write_density(domain, x, output / f"{file}.xdmf")
        ffr.plotting.plot_design(domain, {title: x}, output / f"{file}.png")
    bounds: dict[str, Any] = {"psi_solid": full} if full else {"psi_unit": "m^2 s"}
    ffr.plotting.plot_history(result.history, output / "history.png", volume_bound=volume, **bounds)
    ffr.plotting.plot_scene(*result.final, output / "scene.png", **view)
    solid = any(body.domain.dimension == 3 for body in result.problem.flexible.values())
    # a picture in space takes a third of a second
    film: dict[str, Any] = {"frames": 48, "frames_per_second": 8.0} if solid else {}
    ffr.plotting.animate_motion(*result.final, output / "motion.gif", **film)


def leave_machine(
    result: ffr.Result, output: Path, title: str, *, time: float, warnings: Any = (), **numbers: Any
) -> None:
    """Draw scene and film of a machine that parameters have designed, write summary and report."""
    problem, evaluation = result.problem, result.evaluation
    ffr.plotting.plot_scene(problem, evaluation, output / "scene.png", time=time)
    ffr.plotting.animate_motion(problem, evaluation, output / "motion.gif")
    record = ffr.run_record(result, title=title, warnings=warnings)
    ffr.write_summary(problem.comm, output / "summary.json", {**record, **numbers})
    ffr.write_report(problem.comm, output)


def leave(
    options: argparse.Namespace,
    result: ffr.Result,
    title: str,
    full: float,
    found: ffr.Verification | None,
    warnings: list[dict[str, str]],
    *,
    references: Mapping[str, float] | None = None,
    most: float = np.inf,
    **numbers: Any,
) -> None:
    """Write summary.json and the report of a run, and say how it ended; collective.

    ``full`` is psi of full bodies with the modes of the result, ``references`` have psi of other
    designs. Of a run as long and fine as by default psi of the parts must be ``most`` or less.
    """
    output, bodies, share = options.output, result.problem.flexible, result.psi / full
    ratio = found.psi / full if found else share
    flat = found and all(body.domain.dimension == 2 for body in bodies.values())
    reported = {"references": references or {"full": full}, "verification": found}
    parts = {name: result.part(name) for name in bodies} if flat else None
    summary = {
        "compliance_initial": float(result.history["psi"][0]),
        "compliance_final": result.psi,
        "compliance_final_relative": share,
        **numbers,
        **ffr.run_record(result, title=title, parts=parts, warnings=warnings, **reported),
        **({"compliance_part_relative": found.psi / full} if found else {}),
        "elements": {name: body.domain.n_cells_global for name, body in bodies.items()},
    }
    ffr.write_summary(MPI.COMM_WORLD, output / "summary.json", summary)
    ffr.write_report(MPI.COMM_WORLD, output)
    say(f"{result.reason} after {result.iterations} iterations: psi is {ratio:.3f} of the full one")
    say(found or "no parts come of this design")
    say(f"pictures and numbers are in {output}")
    if options.complete and result.reason != "interrupted" and most < np.inf:
        assert found and found.psi <= most, f"psi should be at most {most:.4g}: {found}"
