# SPDX-License-Identifier: MIT
"""The exact gradient beside finite differences for every element."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from growth import rows_of_growth
from jobs import Job
from report import Table, duration, write_page

from dolfinx_ffr.plotting.style import BLUE, DARK, GRAY, ORANGE, save, styled_figure, tidy

__all__ = ["report_differences"]


def report_differences(results: list[tuple[Job, dict[str, Any]]], directory: Path) -> list[Table]:
    """Write table and picture.

    Args:
        results: Of `growth_jobs`; nothing else is measured.
        directory: Where to.

    Returns:
        The tables.
    """
    rows = [
        {
            "mesh": row["mesh"],
            "elements": row["elements"],
            "value": row["value"],
            "gradient": row["gradient"],
            "one_sided": (row["elements"] + 1) * row["value"],
            "one_sided_text": duration((row["elements"] + 1) * row["value"]),
            "central": 2 * row["elements"] * row["value"],
            "central_text": duration(2 * row["elements"] * row["value"]),
            "speedup": (row["elements"] + 1) * row["value"] / row["gradient"],
        }
        for row in rows_of_growth(results)
        if row["ranks"] == 1
    ]
    table = Table(
        "differences",
        "Cost of a whole gradient",
        "The exact gradient is measured. **The differences are not: their cost is extrapolated** "
        "as the measured time of one value times the number of values that they need, one more "
        "than there are elements (one-sided) or twice as many (central). They would reach the "
        "accuracy that the page on time beside error shows for central differences, the exact "
        "gradient that of the solvers.",
        {
            "mesh": "mesh",
            "elements": "elements",
            "value": "one value [s], measured",
            "gradient": "exact gradient [s], measured",
            "one_sided": "one-sided differences [s], extrapolated",
            "one_sided_text": "that is",
            "central": "central differences [s], extrapolated",
            "central_text": "that is",
            "speedup": "one-sided differences / exact gradient",
        },
        rows,
    )
    _draw(rows, directory / "differences.png")
    picture = "![Cost of the exact gradient and of differences](differences.png)"
    write_page(directory, "differences", "Exact gradient beside differences", picture, [table])
    return [table]


def _draw(rows: list[dict[str, Any]], path: Path) -> None:
    n = [row["elements"] for row in rows]
    with styled_figure(7.0, 4.6) as figure:
        axes = figure.subplots()
        for name, style, color, label in (
            ("central", "o:", GRAY, "central differences (extrapolated)"),
            ("one_sided", "o--", BLUE, "one-sided differences (extrapolated)"),
            ("gradient", "o-", ORANGE, "exact gradient (measured)"),
        ):
            face = color if style == "o-" else "white"
            axes.plot(
                n, [row[name] for row in rows], style, color=color, label=label,
                markerfacecolor=face,
            )  # fmt: skip
        for row in rows:
            for name, above in (("one_sided", False), ("gradient", False)):
                axes.annotate(
                    duration(row[name]),
                    (row["elements"], row[name]),
                    (0, 8 if above else -9),
                    textcoords="offset points",
                    ha="center",
                    va="bottom" if above else "top",
                    fontsize=9,
                    color=DARK,
                )
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xticks(n, [f"{count:,}" for count in n])
        axes.minorticks_off()
        axes.margins(x=0.1)
        low, high = axes.get_ylim()
        axes.set_ylim(low / 4.0, high * 3.0)
        axes.set_xlabel("elements, each with a density")
        axes.set_ylabel("seconds for a whole gradient")
        axes.set_title("Derivative of psi with respect to every element")
        axes.legend(loc="upper left")
        tidy(axes)
        figure.tight_layout()
        save(figure, path)
