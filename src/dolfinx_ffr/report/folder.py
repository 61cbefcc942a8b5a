# SPDX-License-Identifier: MIT
"""The files of a results folder, the record of its run, and a list of missing entries."""

from __future__ import annotations

import base64
import csv
import io
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from PIL import Image, UnidentifiedImageError

from ..arrays import Array
from ..files import file_names
from ..io import read_history
from .numbers import Scale, aligned, real

#: Captions of pictures that have a place on the page
PICTURES = {
    "scene.png": "The mechanism at one instant of its motion.",
    "design.png": "Densities of the design: solid is black, void is white.",
    "part.png": "The part, and enlarged where it is thinnest and tightest.",
    "solid.png": "The part, as a solid.",
    "boundary.gif": "The boundary of the part as it moves.",
    "motion.gif": "The mechanism in motion.",
    "stress.png": "Largest von Mises stress over the motion.",
    "stress_before.png": "Largest von Mises stress before the boundary of the part was moved.",
    "modes.png": "Shape functions of the body.",
}
#: Pictures that are reported as missing, with the functions of `plotting` that draw them
_EXPECTED = {"scene.png": "plot_scene", "motion.gif": "animate_motion", "design.png": "plot_design"}
#: Pictures of the history, which the report draws itself
_OF_HISTORY = ("history.png", "history.svg")
#: Largest size of all pictures on a page [bytes]
LIMIT = 3_300_000
Row = Sequence[str]


@dataclass(frozen=True)
class Picture:
    """A picture as part of a page."""

    caption: str
    source: str  #: Data URI
    width: int  #: [pixels]
    height: int  #: [pixels]
    still: str = ""  #: Data URI of the first frame, for those who want no motion


@dataclass
class Folder:
    """The usable files of a run."""

    path: Path
    record: dict[str, Any]  #: Content of summary.json
    history: dict[str, Array]  #: Columns of history.csv
    missing: list[str] = field(default_factory=list)  #: Missing files and entries, in words
    boundary: dict[str, Array] = field(default_factory=dict)  #: Columns of boundary.csv
    _bytes: int = 0

    @staticmethod
    def read(path: Path) -> Folder:
        """Read summary and history; raises what `write_report` does."""
        summary, history = path / "summary.json", path / "history.csv"
        if not summary.is_file() and not history.is_file():
            below = [f.parent for f in sorted(path.glob("*/summary.json"))]
            hint = f"; there are runs in {', '.join(map(str, below[:5]))}" if below else ""
            problem = "is no folder" if not path.is_dir() else "holds no run"
            raise FileNotFoundError(
                f"report: {str(path)!r} {problem}: neither summary.json nor history.csv is there"
                f"{hint}. Give the folder that a demo wrote to, for example results/slider_crank "
                "(make demo)"
            )
        folder = Folder(path, {}, {})
        if summary.is_file():
            folder.record = _record(summary)
        else:
            folder.missing.append(
                "summary.json: nothing is known but the history; a run that was not interrupted "
                "writes it by ffr.write_summary with ffr.run_record(result, ...)"
            )
        if history.is_file():
            folder.history = _columns(history)
        if (steps := path / "boundary.csv").is_file():
            folder.boundary = _columns(steps)
        if not folder.history or not len(next(iter(folder.history.values()))):
            folder.history = {}
            folder.missing.append("history.csv: how the design came about (optimize(output=...))")
        return folder

    def picture(self, name: str) -> Picture | None:
        """A picture of the folder, or None if it is missing, damaged or too large."""
        file = self.path / name
        if not file.is_file():
            if name in _EXPECTED:
                drawn = PICTURES[name][:-1].lower()
                self.missing.append(f"{name}: {drawn} (plotting.{_EXPECTED[name]})")
            return None
        content = file.read_bytes()
        try:
            # of other kinds some are programs, as PostScript, which Pillow hands to Ghostscript
            with Image.open(io.BytesIO(content), formats=("PNG", "GIF")) as image:
                kind, (width, height) = str(image.format), image.size
                image.load()
                first_frame = _still(image) if getattr(image, "is_animated", False) else b""
        except Image.DecompressionBombError:
            self.missing.append(f"{name}: it has too many pixels")
            return None
        except (OSError, SyntaxError, UnidentifiedImageError, ValueError):
            self.missing.append(f"{name}: the file is damaged")
            return None
        if self._bytes + len(content) + len(first_frame) > LIMIT:
            consequence = "only its first frame is shown" if first_frame else "it is left out"
            self.missing.append(
                f"{name}: with {len(content) / 1e6:.1f} MB it would make the page too large; "
                f"{consequence}"
            )
            if not first_frame:
                return None
            content, kind, first_frame = first_frame, "PNG", b""
        self._bytes += len(content) + len(first_frame)
        words = re.sub(r"[_-]+", " ", file.stem).strip()
        caption = PICTURES.get(file.name, f"{words[:1].upper()}{words[1:]}.")
        if file.parent != self.path:
            caption = f"{file.parent.name}: {caption}"
        first_frame_source = data_uri(first_frame, "image/png") if first_frame else ""
        return Picture(
            caption, data_uri(content, f"image/{kind.lower()}"), width, height, first_frame_source
        )

    def further_pictures(self) -> list[Picture]:
        """Pictures of the folder that are not among `PICTURES`."""
        names = sorted(f.name for f in self.path.iterdir() if f.suffix.lower() in {".png", ".gif"})
        further = [n for n in names if n not in (*PICTURES, *_OF_HISTORY) and not n.startswith(".")]
        return [picture for name in further if (picture := self.picture(name)) is not None]

    def pictures_of_bodies(self) -> list[Picture]:
        """Pictures of the parts of several bodies, which stand in a folder each."""
        bodies = self.record.get("volume")
        folders = file_names(bodies).values() if isinstance(bodies, dict) else ()
        names = [f"{body}/{kind}.png" for body in folders for kind in ("part", "solid")]
        return [picture for name in names if (picture := self.picture(name)) is not None]


def _columns(file: Path) -> dict[str, Array]:
    """The columns of a history; a ValueError if the file is damaged."""
    try:
        return read_history(file)
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        raise ValueError(f"report: {file} is damaged: {error}") from error


def data_uri(content: bytes, mime: str) -> str:
    """A file's content as an address."""
    return f"data:{mime};base64,{base64.b64encode(content).decode()}"


def _still(image: Image.Image) -> bytes:
    """The first frame of an animation as PNG."""
    image.seek(0)
    buffer = io.BytesIO()
    image.convert("RGB").quantize(64).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _record(file: Path) -> dict[str, Any]:
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
    except (RecursionError, ValueError) as error:  # no text, or no JSON
        raise ValueError(f"report: {file} is damaged: {error}; run the program again") from error
    if not isinstance(record, dict):
        raise ValueError(f"report: {file} must hold a mapping from names to numbers and texts")
    return record


def words(name: str) -> str:
    """The name of a class, "IntegralCompliance", as the words that begin a sentence."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()
    return text[:1].upper() + text[1:]


@dataclass(frozen=True)
class Table:
    """A table whose first column names the rows."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Row]
    numeric: frozenset[int]  #: Columns whose decimal points are aligned
    note: str = ""

    @staticmethod
    def of(
        caption: str,
        head: Sequence[str],
        rows: Sequence[Row],
        numeric: Sequence[int] = (),
        note: str = "",
    ) -> Table | None:
        """A table, or None without rows; ``numeric`` are the columns of numbers."""
        if not rows:
            return None
        columns = [list(column) for column in zip(*rows, strict=True)]
        columns = [aligned(c) if i in numeric else c for i, c in enumerate(columns)]
        return Table(caption, head, list(zip(*columns, strict=True)), frozenset(numeric), note)


class Run:
    """A folder, with the values that several sections of its report use."""

    def __init__(self, folder: Folder) -> None:
        self.folder, self.record = folder, folder.record
        objective = self.mapping("objective")
        self.psi_unit = str(objective.get("unit") or "")
        self.objective = words(str(objective.get("name") or "objective"))
        self.verification = self.mapping("verification")
        #: Whether the boundary of the part was moved; then the report is about the part
        self.moved = bool(self.record.get("boundary"))
        self.references = {k: v for k, v in self.mapping("references").items() if real(v)}
        self.bounds = {
            name: entry["bound"]
            for name, entry in self.mapping("constraints").items()
            if name.startswith("volume of ") and isinstance(entry, dict) and real(entry["bound"])
        }
        psis = [self.record.get("psi"), self.verification.get("part"), *self.references.values()]
        self.psi = Scale(self.psi_unit, max([abs(p) for p in psis if real(p)], default=None))

    def mapping(self, key: str) -> dict[str, Any]:
        """The mapping under a key; empty where there is none."""
        entry = self.record.get(key)
        if entry is not None and not isinstance(entry, dict):
            self.missing(f"summary.json: what stands under {key!r} cannot be used (no mapping)")
        return entry if isinstance(entry, dict) else {}

    def missing(self, what: str) -> None:
        """Note once that something is missing."""
        if what not in self.folder.missing:
            self.folder.missing.append(what)

    def built(self, what: str, build: Callable[[Run], Any], nothing: Any) -> Any:
        """The section that ``build`` makes; ``nothing`` and a note if the record is not usable."""
        try:
            return build(self)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            reason = f"{type(error).__name__}: {error}"
            self.missing(
                f"{what}: summary.json holds something else than run_record writes ({reason})"
            )
            return nothing
