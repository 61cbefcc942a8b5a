# SPDX-License-Identifier: MIT
"""Tables and picture of this package beside others."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jobs import Job
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from peer_packages import versions
from peer_pymoto import SOLVERS
from report import Table, duration, write_page

from dolfinx_ffr.plotting.style import BLUE, DARK, GRAY, ORANGE, RED, save, styled_figure, tidy

__all__ = [
    "ALPHA",
    "EXUDYN",
    "INSTANTS",
    "OURS",
    "PYMOTO",
    "RADAU",
    "RADIUS",
    "TRAPEZOIDAL",
    "report_peers",
    "rows_of_equal_error",
    "rows_of_plates",
    "seconds_to_reach",
]

#: Instants at which deflections are compared.
INSTANTS = 50
#: Names of the codes and their methods, as in the tables.
OURS, EXUDYN, PYMOTO = "dolfinx_ffr", "Exudyn", "pyMOTO"
ALPHA, RADAU, TRAPEZOIDAL = "generalised-alpha", "Radau IIA", "trapezoidal, index 2"
#: Radius of the plate's filter, in elements.
RADIUS = 2.5


def report_peers(results: list[tuple[Job, dict[str, Any]]], directory: Path) -> list[Table]:
    """Write tables and picture.

    Args:
        results: Of `peers_jobs`.
        directory: Where to.

    Returns:
        The tables.
    """
    by_name = {job.function: result for job, result in results}
    designs = by_name["plate_designs"]
    plane, space = (
        next(r for j, r in results if j.function == "slider_crank_times" and dimension(j) == d)
        for d in (2, 3)
    )
    plates = [(job, result) for job, result in results if job.function == "plate_times"]
    plate_rows = rows_of_plates(plates)
    tables = [
        *_motion_tables(plane, "", "Motion"),
        *_motion_tables(space, "_space", "Motion in space"),
        *_plate_tables(plate_rows, designs),
        _memory_table(results),
    ]
    _draw(plane, plate_rows, designs, directory / "peers.png")
    _draw_space(space, directory / "peers_space.png")
    picture = (
        "![Time beside error, of this package and of others](peers.png)\n\n"
        "![The same of the motion in space](peers_space.png)"
    )
    names = {"exudyn": EXUDYN, "pymoto": PYMOTO, "cvxopt": "CVXOPT", "opt_einsum": "opt_einsum"}
    peers = ", ".join(f"{names[name]} {version}" for name, version in versions().items())
    text = f"Beside {peers}; the peers' NumPy and SciPy are those of the environment.\n\n{picture}"
    write_page(directory, "peers", "Beside other packages", text, tables)
    return tables


def dimension(job: Job) -> int:
    """Of the scene of a ``job``."""
    return len(job.parameters["elements"])


def seconds_to_reach(rows: Sequence[dict[str, Any]], error: float, what: str) -> float:
    """The time in which a method reaches an error, between its measured settings.

    Args:
        rows: Of one method; time falls where the error grows.
        error: That is to be reached.
        what: Name of the error.

    Returns:
        The time interpolated in logarithms [s]; that of the coarsest setting, where even that is
        more accurate; not a number where the finest is not accurate enough.
    """
    ordered = sorted(rows, key=lambda row: row[what])
    errors = np.log([row[what] for row in ordered])
    times = np.log([row["seconds"] for row in ordered])
    if np.log(error) < errors[0]:
        return float("nan")
    return float(np.exp(np.interp(np.log(error), errors, times)))


def rows_of_equal_error(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The times of each method at equal errors, and how many times longer Exudyn takes."""
    methods = {
        (code, method): [r for r in rows if (r["code"], r["method"]) == (code, method)]
        for code, method in {(row["code"], row["method"]): None for row in rows}
    }
    found = []
    for what, name in (("error_psi", "psi"), ("error_deflection", "deflection")):
        for error in (1e-3, 3e-4, 1e-4, 3e-5, 1e-5):
            t = {key: seconds_to_reach(own, error, what) for key, own in methods.items()}
            row = {
                "of": name,
                "error": error,
                "ours_alpha": t[OURS, ALPHA],
                "ours_radau": t[OURS, RADAU],
                "exudyn_alpha": t[EXUDYN, ALPHA],
                "exudyn_trapezoidal": t[EXUDYN, TRAPEZOIDAL],
            }
            ours = np.array([row["ours_alpha"], row["ours_radau"]])
            theirs = np.array([row["exudyn_alpha"], row["exudyn_trapezoidal"]])
            if np.isnan(ours).all() or np.isnan(theirs).all():
                continue
            row["ratio_alpha"] = row["exudyn_alpha"] / row["ours_alpha"]
            row["ratio_best_alpha"] = row["exudyn_alpha"] / np.nanmin(ours)
            row["ratio_best"] = np.nanmin(theirs) / np.nanmin(ours)
            found.append(row)
    return found


#: What else is to be said of the motion, by the name of its tables
REMARKS = {
    "": "The last {nm:.0f} nm of the deflection, 2e-4 of it, are vibrations of more than 1 kHz "
    "from the start, whose phase no method of second order follows with so few steps.",
    "_space": "All elastic coordinates q(t) at these instants agree to {agreement:.1e} of the "
    "largest, Exudyn's extrapolated from the trapezoidal rule with its two largest numbers of "
    "steps. Its reference node has Euler parameters, as that of three angles ends at another "
    "motion.",
}


def _motion_tables(motion: dict[str, Any], suffix: str, title: str) -> list[Table]:
    n = motion["elements"]
    where = "demo in space" if suffix else "demo"
    scene = (
        f"Slider-crank of the {where}, rod with 30 holes, {n:,} elements, {motion['modes']} modes, "
        f"{motion['duration']:g} s. Both codes get the same shape functions, mass and stiffness of "
        "the rod, and the same floating frame."
    )
    remark = REMARKS[suffix].format(
        nm=1e9 * 2e-4 * motion["deflection"], agreement=motion["agreement"]
    )
    table = Table(
        f"peers{suffix}_motion",
        f"{title}: time and error",
        f"{scene} *Seconds* are CPU times of the solver, of the reduced rod, the fastest of "
        "several turns through all settings: of this package the model's compilation and psi "
        "included, of Exudyn without. *Error of psi* is relative; *error of deflection* is the "
        f"largest one of the rod's middle at {INSTANTS} instants over the largest deflection "
        f"({1e6 * motion['deflection']:.3g} micrometres). Exact is {RADAU} with "
        f"{motion['reference']:,} steps; half as many differ from it by "
        f"{motion['reference_error_psi']:.0e} and {motion['reference_error_deflection']:.0e}. "
        f"Spectral radius 0.8 in both; Exudyn's {ALPHA} has constraints of positions (index 3), "
        f"its module is the one without range checks and its Newton method keeps the Jacobian. "
        f"{remark}",
        {
            "code": "code",
            "method": "method",
            "steps": "steps",
            "seconds": "seconds",
            "error_psi": "error of psi",
            "error_deflection": "error of deflection",
        },
        sorted(motion["rows"], key=lambda r: (r["code"] != OURS, r["method"], r["steps"])),
    )
    equal = Table(
        f"peers{suffix}_equal_error",
        f"{title}: time at equal error",
        "From the table above, interpolated in logarithms. Where even a method's coarsest setting "
        "is more accurate than asked, its time counts; a dash where the finest is not accurate "
        f"enough. *Best* is the faster method of each code. {RADAU} is of order 5, and far ahead "
        "where an objective hardly feels vibrations or where the steps resolve them.",
        {
            "of": "error of",
            "error": "error",
            "ours_alpha": f"{OURS}, {ALPHA} [s]",
            "ours_radau": f"{OURS}, {RADAU} [s]",
            "exudyn_alpha": f"{EXUDYN}, {ALPHA} [s]",
            "exudyn_trapezoidal": f"{EXUDYN}, {TRAPEZOIDAL} [s]",
            "ratio_alpha": f"{EXUDYN} / {OURS}, both {ALPHA}",
            "ratio_best_alpha": f"{EXUDYN}'s {ALPHA} / {OURS}'s best",
            "ratio_best": f"{EXUDYN}'s best / {OURS}'s best",
        },
        rows_of_equal_error(motion["rows"]),
    )
    difference = (n + 1) * motion["exudyn_value"]
    gradient = Table(
        f"peers{suffix}_gradient",
        f"{title}: one gradient with respect to every element",
        f"{ALPHA.capitalize()} with {motion['steps']:,} steps. This package's exact gradient, with "
        f"the value, is measured. **Exudyn's is not: it has no derivatives, so its cost is "
        "extrapolated** as that of one-sided differences, the number of elements plus one times "
        f"one reduction of the rod (by this package, {1e3 * motion['reduction']:.0f} ms), "
        f"Exudyn's set-up of the body ({1e3 * motion['exudyn_setup']:.0f} ms) and one simulation, "
        "each measured.",
        {
            "code": "code",
            "how": "how",
            "value": "one value [s]",
            "gradient": "gradient [s]",
            "gradient_text": "that is",
            "ratio": "over this package's",
        },
        [
            {
                "code": OURS,
                "how": "exact, measured",
                "value": motion["value"],
                "gradient": motion["gradient"],
                "gradient_text": duration(motion["gradient"]),
                "ratio": 1.0,
            },
            {
                "code": EXUDYN,
                "how": "differences, extrapolated",
                "value": motion["exudyn_value"],
                "gradient": difference,
                "gradient_text": duration(difference),
                "ratio": difference / motion["gradient"],
            },
        ],
    )
    return [table, equal, gradient]


def rows_of_plates(plates: Sequence[tuple[Job, dict[str, Any]]]) -> list[dict[str, Any]]:
    """One row for each plate."""
    rows = []
    for job, result in plates:
        nx, ny = job.parameters["elements"]
        t, d = result["seconds"], result["differences"]
        rows.append(
            {
                "mesh": f"{nx}x{ny}",
                "elements": nx * ny,
                "unknowns": result["unknowns"],
                "ours": t[OURS],
                **{solver: t[solver] for solver in SOLVERS},
                **{f"ratio_{solver}": t[solver] / t[OURS] for solver in SOLVERS},
                "difference_compliance": max(d[solver][0] for solver in SOLVERS),
                "difference_gradient": max(d[solver][1] for solver in SOLVERS),
            }
        )
    return rows


def _plate_tables(rows: list[dict[str, Any]], designs: dict[str, Any]) -> list[Table]:
    times = Table(
        "peers_plate",
        "Static limit: compliance and gradient",
        "A plate of bilinear squares, clamped at the left, sliding at the right as a rigid piece "
        "under a force; a density of its own for each element, SIMP with exponent 3, no filter. "
        "Seconds of one compliance with its gradient, the fastest of several turns. Differences "
        "are relative, between this package and pyMOTO. SuperLU is SciPy's, which pyMOTO takes as "
        "it comes; CHOLMOD is CVXOPT's. This package assembles the mass too, and goes through its "
        "static equilibrium and adjoint of the motion, a fixed cost of some milliseconds.",
        {
            "mesh": "mesh",
            "elements": "elements",
            "unknowns": "unknowns",
            "ours": f"{OURS} [s]",
            **{solver: f"{PYMOTO}, {solver} [s]" for solver in SOLVERS},
            **{f"ratio_{solver}": f"{PYMOTO}, {solver} / {OURS}" for solver in SOLVERS},
            "difference_compliance": "difference of compliance",
            "difference_gradient": "difference of gradient",
        },
        rows,
    )
    found = []
    for name, run in designs["runs"].items():
        seconds, compliance = np.array(run["seconds"]), np.array(run["compliance"])
        best = np.minimum.accumulate(compliance)
        near = best <= 1.01 * min(min(r["compliance"]) for r in designs["runs"].values())
        found.append(
            {
                "code": name,
                "iterations": len(seconds),
                "each": float(seconds[-1] / len(seconds)),
                "total": float(seconds[-1]),
                "start": float(compliance[0] / designs["solid"]),
                "final": float(best[-1] / designs["solid"]),
                "near": float(seconds[np.argmax(near)]) if near.any() else float("nan"),
                "volume": run["volume"],
            }
        )
    design = Table(
        "peers_design",
        "Static limit: a whole design",
        f"The plate with {designs['mesh']} elements, at most half of it filled, one filter of "
        f"{RADIUS} elements for both, no projection, from an even start. Each code has its own "
        "method of moving asymptotes: this package the one of 1987, pyMOTO the one of 2007, each "
        "with its defaults. The codes take turns, iteration by iteration. Compliances are over "
        "that of the solid plate; *near* is the time until the design is within one per cent of "
        "the best of all.",
        {
            "code": "code",
            "iterations": "iterations",
            "each": "each [s]",
            "total": "all [s]",
            "start": "compliance at the start",
            "final": "at the end",
            "near": "near [s]",
            "volume": "volume",
        },
        found,
    )
    return [times, design]


def _memory_table(results: list[tuple[Job, dict[str, Any]]]) -> Table:
    rows = []
    for job, result in results:
        if not job.function.startswith("memory_of_"):
            continue
        solver = job.parameters.get("solver")
        code = {"memory_of_exudyn": EXUDYN, "memory_of_pymoto": f"{PYMOTO}, {solver}"}
        case = "motion" if job.function in ("memory_of_motion", "memory_of_exudyn") else "plate"
        if case == "plate":
            case += " of " + "x".join(map(str, job.parameters["elements"]))
        else:
            case += f", {job.parameters['steps']:,} steps"
        rows.append({"case": case, "code": code.get(job.function, OURS), **result})
    return Table(
        "peers_memory",
        "Memory",
        "Peak of the resident memory, each line in a process of its own: *beyond* what it holds "
        "(*base*) with all libraries loaded and a tiny case done; for the motion by this package "
        "with the rod reduced. The motion is that of the reduced rod, the plate one compliance "
        "with its gradient, mesh and matrices included.",
        {"case": "case", "code": "code", "base": "base [MB]", "beyond": "beyond [MB]"},
        rows,
    )


# ---------------------------------------------------------------------- picture


def _draw(
    motion: dict[str, Any], plates: list[dict[str, Any]], designs: dict[str, Any], path: Path
) -> None:
    with styled_figure(13.0, 8.6) as figure:
        pair, (plate, design) = figure.subplots(2, 2)
        _draw_errors(pair, motion, "Slider-crank")
        _draw_plates(plate, plates)
        _draw_designs(design, designs)
        figure.tight_layout(w_pad=2.0, h_pad=2.0)
        save(figure, path)


def _draw_space(motion: dict[str, Any], path: Path) -> None:
    with styled_figure(13.0, 4.3) as figure:
        _draw_errors(figure.subplots(1, 2), motion, "Slider-crank in space")
        figure.tight_layout(w_pad=2.0)
        save(figure, path)


def _draw_errors(pair: Sequence[Axes], motion: dict[str, Any], scene: str) -> None:
    """Time beside error of psi and of the deflection."""
    for axes, what, title in zip(
        pair,
        ("error_psi", "error_deflection"),
        ("psi", "deflection of the rod's middle"),
        strict=True,
    ):
        _draw_motion(axes, motion["rows"], what)
        axes.set_title(f"{scene}: {title}")
    low, high = pair[0].get_ylim()
    pair[0].set_ylim(low, high * (high / low) ** 0.3)
    pair[0].legend(loc="upper right")


def _draw_motion(axes: Axes, rows: Sequence[dict[str, Any]], what: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    for code, method, style, color in (
        (OURS, ALPHA, "o-", ORANGE),
        (OURS, RADAU, "s-", RED),
        (EXUDYN, ALPHA, "o--", BLUE),
        (EXUDYN, TRAPEZOIDAL, "s--", GRAY),
    ):
        own = [row for row in rows if (row["code"], row["method"]) == (code, method)]
        x, y = [row["seconds"] for row in own], [row[what] for row in own]
        face = color if style[1:] == "-" else "white"
        axes.plot(x, y, style, color=color, markerfacecolor=face, label=f"{code}, {method}")
        if not own or method == TRAPEZOIDAL:  # as many steps as generalised-alpha
            continue
        for row, above in ((own[0], True), (own[-1], False)):
            axes.annotate(
                f"{row['steps']:,}",
                (row["seconds"], row[what]),
                (0, 5 if above else -5),
                textcoords="offset points",
                ha="center",
                va="bottom" if above else "top",
                fontsize=8,
                color=DARK,
            )
    axes.margins(x=0.08, y=0.1)
    _label_seconds(axes.xaxis)
    axes.set_xlabel("seconds of the simulation (steps at the ends)")
    axes.set_ylabel("relative error")
    tidy(axes)


def _label_seconds(axis: Axis) -> None:
    """Label 1, 2 and 5 of each decade."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda seconds, _: f"{seconds:g}"))
    axis.set_minor_formatter(NullFormatter())


def _draw_plates(axes: Axes, rows: Sequence[dict[str, Any]]) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    n = [row["elements"] for row in rows]
    for name, label, style, color in (
        ("SuperLU", f"{PYMOTO}, SuperLU", "s--", GRAY),
        ("CHOLMOD", f"{PYMOTO}, CHOLMOD", "o--", BLUE),
        ("ours", OURS, "o-", ORANGE),
    ):
        face = color if style[1:] == "-" else "white"
        axes.plot(
            n, [row[name] for row in rows], style, color=color, markerfacecolor=face, label=label
        )
    axes.set_xticks(n, [f"{count:,}" for count in n])
    axes.minorticks_off()
    axes.margins(x=0.08)
    _label_seconds(axes.yaxis)
    axes.set_xlabel("elements")
    axes.set_ylabel("seconds")
    worst = max(row["difference_gradient"] for row in rows)
    axes.set_title(f"Plate: compliance and gradient (equal to {worst:.0e})".replace("e-0", "e-"))
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.3)
    axes.legend(loc="upper left")
    tidy(axes)


def _draw_designs(axes: Axes, designs: dict[str, Any]) -> None:
    for (name, run), (style, color) in zip(
        designs["runs"].items(), (("-", ORANGE), ("--", BLUE)), strict=True
    ):
        best = np.minimum.accumulate(run["compliance"]) / designs["solid"]
        axes.plot(run["seconds"], best, style, color=color, label=f"{name}: {best[-1]:.3f}")
    low, high = axes.get_ylim()
    axes.set_ylim(low, min(high, 2.5 * low))  # the first steps are far above
    axes.set_xlim(left=0.0)
    axes.set_xlabel("seconds")
    axes.set_ylabel("compliance / that of the solid plate")
    axes.set_title("Plate: a whole design, half of it filled")
    axes.legend(loc="upper right")
    tidy(axes)
