# SPDX-License-Identifier: MIT
"""Tables and picture of this package beside others."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jobs import Job, Results
from matplotlib.axes import Axes
from peer_packages import versions
from peer_pymoto import SOLVERS
from report import Study, duration, line, plot, seconds_to_reach, tick_labels

from dolfinx_ffr.plotting.style import BLUE, GRAY, ORANGE, RED

#: Instants at which deflections are compared.
INSTANTS = 50
#: Names of the codes and their methods, as in the tables.
OURS, EXUDYN, PYMOTO = "dolfinx_ffr", "Exudyn", "pyMOTO"
ALPHA, RADAU, TRAPEZOIDAL = "generalised-alpha", "Radau IIA", "trapezoidal, index 2"


def report_peers(study: Study, results: Results) -> None:
    """Tables and pictures."""
    plane, space = (
        next(r for j, r in results if j.function == "slider_crank_times" and dimension(j) == d)
        for d in (2, 3)
    )
    plates = rows_of_plates([pair for pair in results if pair[0].function == "plate_times"])
    _motion_tables(study, plane, "", "Motion")
    _motion_tables(study, space, "_space", "Motion in space")
    study.table("peers_plate", plates)
    _memory_table(study, results)
    names = {"exudyn": EXUDYN, "pymoto": PYMOTO, "cvxopt": "CVXOPT", "opt_einsum": "opt_einsum"}
    peers = ", ".join(f"{names[name]} {version}" for name, version in versions().items())
    text = f"Beside {peers}; the peers' NumPy and SciPy are those of the environment.\n"
    study.pictures.append(text)
    caption = "Time beside error, of this package and of others"
    with study.picture(caption, 1, 3, (15.0, 4.3)) as (psi, deflection, plate):
        _draw_errors((psi, deflection), plane, "Slider-crank")
        for name, label, style, color in (
            ("SuperLU", f"{PYMOTO}, SuperLU", "s--", GRAY),
            ("CHOLMOD", f"{PYMOTO}, CHOLMOD", "o--", BLUE),
            ("ours", OURS, "o-", ORANGE),
        ):
            line(plate, plates, "elements", name, style, color, hollow=name != "ours", label=label)
        worst = max(row["difference_gradient"] for row in plates)
        title = f"Plate: compliance and gradient (equal to {worst:.0e})".replace("e-0", "e-")
        plot(plate, title, "elements", "time [s]", room=0.3, legend="upper left")
    caption = "The same of the motion in space"
    with study.picture(caption, 1, 2, (13.0, 4.3), "peers_space") as pair:
        _draw_errors(pair, space, "Slider-crank in space")


def dimension(job: Job) -> int:
    """Of the scene of a ``job``."""
    return len(job.parameters["elements"])


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


def _motion_tables(study: Study, motion: dict[str, Any], suffix: str, title: str) -> None:
    words = {name: value for name, value in motion.items() if name != "rows"}
    words |= {"title": title, "where": "demo in space" if suffix else "demo"}
    words["micrometres"] = 1e6 * motion["deflection"]
    words["remark"] = REMARKS[suffix].format(nm=1e9 * 2e-4 * motion["deflection"], **motion)
    words |= {"reduction_ms": 1e3 * motion["reduction"], "setup_ms": 1e3 * motion["exudyn_setup"]}
    rows = sorted(motion["rows"], key=lambda r: (r["code"] != OURS, r["method"], r["steps"]))
    study.table(f"peers{suffix}_motion", rows, like="peers_motion", **words)
    equal = rows_of_equal_error(motion["rows"])
    study.table(f"peers{suffix}_equal_error", equal, like="peers_equal_error", **words)
    # by one-sided differences: one value more than there are elements
    theirs = (motion["elements"] + 1) * motion["exudyn_value"]
    rows = [
        {
            **{"code": code, "how": how, "value": value, "gradient": gradient},
            "gradient_text": duration(gradient),
            "ratio": gradient / motion["gradient"],
        }
        for code, how, value, gradient in (
            (OURS, "exact, measured", motion["value"], motion["gradient"]),
            (EXUDYN, "differences, extrapolated", motion["exudyn_value"], theirs),
        )
    ]
    study.table(f"peers{suffix}_gradient", rows, like="peers_gradient", **words)


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


def _memory_table(study: Study, results: Results) -> None:
    rows = []
    for job, result in results:
        if not job.function.startswith("memory_of_"):
            continue
        own = job.parameters
        names = {"memory_of_exudyn": EXUDYN, "memory_of_pymoto": f"{PYMOTO}, {own.get('solver')}"}
        if "steps" in own:
            case = f"motion, {own['steps']:,} steps"
        else:
            case = "plate of " + "x".join(map(str, own["elements"]))
        rows.append({"case": case, "code": names.get(job.function, OURS), **result})
    study.table("peers_memory", rows)


def _draw_errors(pair: Sequence[Axes], motion: dict[str, Any], scene: str) -> None:
    """Time beside error of psi and of the deflection."""
    for axes, what, title in zip(
        pair, ("psi", "deflection"), ("psi", "deflection of the rod's middle"), strict=True
    ):
        for code, method, style, color in (
            (OURS, ALPHA, "o-", ORANGE),
            (OURS, RADAU, "s-", RED),
            (EXUDYN, ALPHA, "o--", BLUE),
            (EXUDYN, TRAPEZOIDAL, "s--", GRAY),
        ):
            own = [row for row in motion["rows"] if (row["code"], row["method"]) == (code, method)]
            more = {"hollow": code != OURS, "label": f"{code}, {method}"}
            line(axes, own, "seconds", f"error_{what}", style, color, **more)
            if method != TRAPEZOIDAL:  # as many steps as generalised-alpha
                for row in (own[:1], own[-1:]):
                    tick_labels(axes, row, "seconds", f"error_{what}", "{steps:,}")
        x = "seconds of the simulation (steps at the ends)"
        plot(axes, f"{scene}: {title}", x, "relative error", room=0.3, legend="upper right")
