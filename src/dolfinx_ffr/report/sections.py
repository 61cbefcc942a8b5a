# SPDX-License-Identifier: MIT
"""The sections of a report: what a results folder holds, as tables and texts for the template."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from mpi4py import MPI

import jinja2
import numpy as np

from .. import validation
from ..files import replace_file
from ..mechanism import Parameters
from ..parallel import on_rank_0
from . import model, results
from .folder import PICTURES, Folder, Row, Run, Table, data_uri
from .numbers import Scale, fixed, percent, real
from .record import KEYS

#: Panels of the history: columns, and the alternative text
_PANELS = {
    "psi": "Objective over the iterations",
    "load_cases": "Objectives of the load cases over the iterations, relative to the start",
    "parameters": "Parameters of the mechanism over the iterations, between their bounds",
    "volume": "Volume and gray share over the iterations",
    "sharpness": "Sharpness of the projection over the iterations",
    "frequency": "First frequency over the iterations",
    "modes": "Number of normal modes over the iterations",
    "mode_error": "Estimated error by truncated modes over the iterations",
}
#: Entries of the record that are reported as missing
_NEEDED = "psi scene parts verification constraints stress warnings versions command date".split()
#: Columns of the table of the history, with their headings and units of SI
_COLUMNS = {
    "iteration": ("Iteration", ""),
    "psi": ("ψ", "psi"),
    "volume": ("Volume", "%"),
    "gray": ("Gray", "%"),
    "sharpness": ("Sharpness", ""),
    "modes": ("Modes", ""),
    "mode_error": ("Mode error", "%"),
    "frequency": ("First frequency", "Hz"),
    "step": ("Step", ""),
    "accepted": ("Accepted", "yes"),
}
#: Columns of the table of the steps of boundaries, likewise
_STEPS = {
    "iteration": ("Step", ""),
    "psi": ("ψ", "psi"),
    "volume": ("Volume", "%"),
    "narrowest": ("Narrowest member or gap", "m"),
    "tightest": ("Smallest radius", "m"),
    "excess": ("Over a bound", "%"),
    "step": ("Longest motion", "m"),
    "cells": ("Cells", ""),
    "modes": ("Modes", ""),
    "rejected": ("Trials rejected before", ""),
    "inserted": ("Struts inserted", ""),
    "removed": ("Struts and holes removed", ""),
}


def sections(folder: Folder, title: str = "") -> dict[str, Any]:
    """The variables of the template for a folder; missing entries are added to `Folder.missing`."""
    run = Run(folder)
    record = run.record
    if record:
        _note_missing_keys(run)
    by_default = re.sub(r"[_-]+", " ", f"Design run {folder.path.resolve().name}")
    return {
        "title": title or str(record.get("title") or "") or by_default,
        "package": f"dolfinx_ffr {run.mapping('versions').get('dolfinx_ffr', '')}".strip(),
        "ranks": record.get("ranks"),
        "objective": run.objective,
        "feasible": record.get("feasible"),
        "moved": run.moved,
        **{name: run.built(what, build, nothing) for name, what, build, nothing in _BUILT},
        "command": record.get("command") or "",
        "seconds": _duration(record.get("seconds")),
        "pictures": {Path(name).stem: folder.picture(name) for name in PICTURES},
        "pictures_of_bodies": folder.pictures_of_bodies(),
        "further_pictures": folder.further_pictures(),
        "files": _files(folder),
        "missing": folder.missing,
    }


def _note_missing_keys(run: Run) -> None:
    lacking = [key for key in _NEEDED if run.record.get(key) in (None, {}, "")]
    if lacking:
        run.missing(f"summary.json: {', '.join(lacking)} (ffr.run_record writes them)")


def _date(run: Run) -> str:
    text = run.record.get("date")
    if not isinstance(text, str) or not text:
        return ""
    when = datetime.fromisoformat(text)
    zone = f" {when:%Z}" if when.tzinfo else ""
    return f"{when.day} {when:%B %Y, %H:%M}{zone}"


def _history(run: Run) -> dict[str, Any]:
    columns = run.folder.history
    if not columns:
        return {}
    panels = _panels(run, columns)
    if not panels:
        run.missing("history.csv: it has none of the columns that are drawn")
    return {
        "panels": panels,
        "note": _last_psi(run, columns),
        "table": _table(run, columns, _COLUMNS, "Iterations"),
        "iterations": len(next(iter(columns.values()))) - 1,
    }


def _boundary(run: Run) -> dict[str, Any]:
    """Steps of the boundary; the last row is the result, on meshes that resolve its notches."""
    columns = run.folder.boundary
    if not columns:
        return {}
    count = len(columns["psi"])
    columns = {"iteration": np.arange(float(count)), **columns}
    steps = int(run.mapping("boundary").get("steps", count - 1))
    table = _table(run, columns, _STEPS, "Steps of the boundary")
    return {"panels": _panels(run, columns), "table": table, "steps": steps}


def _panels(run: Run, columns: Mapping[str, Any]) -> list[dict[str, str]]:
    """The diagrams over the iterations: of each its text, and its picture as a data URI."""
    from ..plotting import plot_history  # takes a while

    iteration = columns.get("iteration", np.arange(float(len(next(iter(columns.values()))))))
    panels = []
    bound = next(iter(run.bounds.values())) if len(run.bounds) == 1 else None
    with tempfile.TemporaryDirectory() as place:
        for name, text in _PANELS.items():
            values = columns.get(name)
            curves = {"iteration": iteration}
            if name == "load_cases":
                curves |= {n: v for n, v in columns.items() if n.startswith("psi of ")}
            elif name == "parameters":
                curves |= {n: v for n, v in columns.items() if n.startswith("parameter ")}
            elif values is not None and np.isfinite(values).any():
                curves[name] = values
            if len(curves) == 1:
                continue
            if name == "volume" and "gray" in columns:
                curves["gray"] = columns["gray"]
            file = Path(place) / f"{name}.svg"
            options = {"psi_unit": run.psi_unit, "volume_bound": bound, "comm": MPI.COMM_SELF}
            plot_history(curves, file, parameters=_parameters(run), **options)
            panels.append({"text": text, "source": data_uri(file.read_bytes(), "image/svg+xml")})
    return panels


def _parameters(run: Run) -> Parameters | None:
    """The parameters of the mechanism with their bounds, if there are any."""
    keys, recorded = ("value", "lower", "upper", "unit", "scale"), run.mapping("parameters")
    entries = {name: tuple(entry[key] for key in keys) for name, entry in recorded.items()}
    return Parameters(**entries) if entries else None


def _table(
    run: Run, columns: Mapping[str, Any], layout: Mapping[str, tuple[str, str]], caption: str
) -> Table | None:
    """A table of the columns in a ``layout``, with their headings and units."""
    chosen = {n: columns[n] for n in layout if n in columns and np.isfinite(columns[n]).any()}
    head, texts = [], []
    for name, values in chosen.items():
        heading, unit = layout[name]
        if unit == "%":
            texts.append([percent(float(v), 3) for v in values])
            heading += " [%]"
        elif unit == "yes":
            texts.append(["yes" if v else "no" for v in values])
        else:
            si = run.psi_unit if unit == "psi" else unit
            scale = Scale(si, float(np.nanmax(np.abs(values))))
            is_integer = bool(np.all(values == np.round(values)))
            texts.append([scale.text(int(v) if is_integer else float(v)) for v in values])
            heading += f" [{scale.name}]" if scale.name else ""
        head.append(heading)
    rows = list(zip(*texts, strict=True))
    numeric = [i for i, name in enumerate(chosen) if name not in {"iteration", "accepted"}]
    return Table.of(caption, head, rows, numeric)


def _last_psi(run: Run, columns: Mapping[str, Any]) -> str:
    """The reason why the last psi of the history differs from the reported one, if it does."""
    psi, history_psi = run.record.get("psi"), columns.get("psi")
    if history_psi is None or not real(psi) or abs(float(history_psi[-1]) / psi - 1.0) < 1e-6:
        return ""
    reason = "the finished design is evaluated once more, with the law for cut elements"
    if run.moved:
        reason = "steps of its boundary have followed, and the reported value belongs to the part"
    return (
        f"The last ψ of the history is {run.psi.text(float(history_psi[-1]))} {run.psi.name}, the "
        f"reported one {run.psi.text(psi)} {run.psi.name}: {reason}."
    )


def _warnings(run: Run) -> list[Row] | None:
    entries = run.record.get("warnings")
    return entries and [(str(entry["category"]), str(entry["message"])) for entry in entries]


def _versions(run: Run) -> Table | None:
    rows = [(name, str(text)) for name, text in run.mapping("versions").items()]
    return Table.of("Versions", ["", ""], rows)


def _duration(seconds: Any) -> str:
    if not real(seconds):
        return ""
    short = seconds < 120.0
    return f"{fixed(float(seconds), 3)} s" if short else f"{fixed(seconds / 60.0, 3)} min"


def _further(run: Run) -> Table | None:
    rows: list[Row] = []
    for key, value in run.record.items():
        if key not in KEYS:
            inner = value if isinstance(value, dict) else {"": value}
            for below, number in inner.items():
                name = f"{key} {below}".replace("_", " ").strip()
                if isinstance(number, bool):
                    rows.append((name, "yes" if number else "no"))
                elif real(number):
                    rows.append((name, fixed(number, 5)))
                elif isinstance(number, str):
                    rows.append((name, number))
    return Table.of("Further numbers of the run, in units of SI", ["", "Value"], rows)


def _files(folder: Folder) -> list[str]:
    """Names and sizes of the other files in the folder."""
    files = sorted(f for f in folder.path.iterdir() if f.is_file() and not f.name.startswith("."))
    files = [f for f in files if f.suffix != ".html"]
    return [f"{f.name} ({fixed(max(f.stat().st_size / 1e3, 0.1), 2)} kB)" for f in files]


#: Sections that a damaged record may make impossible: name in the template, name for the list of
#: missing entries, function that makes it, and value in its place
_BUILT: tuple[tuple[str, str, Callable[[Run], Any], Any], ...] = (
    ("date", "the date", _date, ""),
    ("status", "how the run ended", results.status, []),
    ("cards", "numbers at the top", results.cards, []),
    ("accuracy", "errors of psi", results.accuracy, {}),
    ("constraints", "constraints", results.constraints, None),
    ("parameters", "parameters", results.parameters, None),
    ("load_cases", "load_cases", results.load_cases, None),
    ("comparison", "other designs", results.comparison, None),
    ("bodies", "figures of part and design", results.reported_and_part, []),
    ("figures_of_densities", "stress and frequencies", results.figures_of_densities, None),
    ("parts", "parts", model.parts, []),
    ("scene", "scene", model.scene, {}),
    ("history", "history", _history, {}),
    ("boundary", "steps of the boundary", _boundary, {}),
    ("warnings", "warnings", _warnings, None),
    ("versions", "versions", _versions, None),
    ("further", "further numbers", _further, None),
)


def write_report(
    comm: MPI.Comm, folder: str | Path, *, output: str | Path | None = None, title: str = ""
) -> Path:
    """Write the report of a run as one HTML file; rank 0 reads and writes.

    It is made from the files of the folder: ``summary.json`` (`run_record` lists the keys),
    ``history.csv`` and the pictures, of several bodies those of their parts in the folders of the
    bodies. Missing entries are left out, and listed at the end of the page.

    Args:
        comm: The ranks that call.
        folder: The folder of a run.
        output: The file; by default ``report.html`` in the folder.
        title: Heading, by default the recorded one.

    Returns:
        The file, on every rank.

    Raises:
        FileNotFoundError: If the folder holds no run.
        ValueError: If summary or history are damaged.
        OSError: If a file cannot be read or written.
    """
    validation.instance("write_report: comm", comm, MPI.Comm, "an MPI communicator")
    place = validation.path("write_report: folder", folder)
    validation.instance("write_report: title", title, str, "a text")
    file = place / "report.html"
    if output is not None:
        file = validation.path("write_report: output", output)

    def write() -> None:
        content = render(Folder.read(place), title).encode()
        file.parent.mkdir(parents=True, exist_ok=True)
        replace_file(file, content)

    on_rank_0(comm, write)
    return file


def render(folder: Folder, title: str = "") -> str:
    """The page of a run, with the recorded heading unless a title is given."""
    blocks: dict[str, Any] = {"trim_blocks": True, "lstrip_blocks": True, "autoescape": True}
    loader = jinja2.PackageLoader("dolfinx_ffr.report")
    environment = jinja2.Environment(loader=loader, undefined=jinja2.StrictUndefined, **blocks)
    return environment.get_template("report.html").render(sections(folder, title))
