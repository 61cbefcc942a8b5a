# SPDX-License-Identifier: MIT
"""The files of a results folder, and a list of missing ones."""

from __future__ import annotations

import base64
import io
import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from PIL import Image, UnidentifiedImageError

from ..arrays import Array
from ..files import file_names
from ..io import read_history

#: Pictures that demos leave, what they show, and the function of `plotting` that draws them
PICTURES = {
    "scene.png": ("The mechanism at one instant of its motion.", "plot_scene"),
    "design.png": ("Densities of the design: solid is black, void is white.", "plot_design"),
    "part.png": ("The part, and enlarged where it is thinnest and tightest.", "plot_part"),
    "boundary.gif": ("The boundary of the part as it moves.", "animate_boundary"),
    "motion.gif": ("The mechanism in motion.", "animate_motion"),
    "crank_motion.png": ("The prescribed motion over time.", "plot_crank_motion"),
    "stress.png": ("Largest von Mises stress over the motion.", "plot_stress"),
    "stress_before.png": ("The same before the boundary of the part was moved.", "plot_stress"),
    "modes.png": ("Shape functions of the body.", "plot_modes"),
}
#: Pictures that every run can have; others are not missed
_WANTED = ("scene.png", "motion.gif", "design.png")
#: Drawn by the report itself
_OWN = ("history.png", "history.svg")
#: Bytes of pictures that a page holds
LIMIT = 3_300_000


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
    """Files of a run, as far as they exist and are sound."""

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
            found = f"; there are runs in {', '.join(map(str, below[:5]))}" if below else ""
            what = "is no folder" if not path.is_dir() else "holds no run"
            raise FileNotFoundError(
                f"report: {str(path)!r} {what}: neither summary.json nor history.csv is there"
                f"{found}. Give the folder that a demo wrote to, for example results/slider_crank "
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
        known, made_by = PICTURES.get(name, ("", ""))
        if not file.is_file():
            if name in _WANTED:
                self.missing.append(f"{name}: {known[:-1].lower()} (plotting.{made_by})")
            return None
        content = file.read_bytes()
        try:
            with Image.open(io.BytesIO(content)) as image:
                kind, (width, height) = str(image.format), image.size
                image.load()
                still = _still(image) if getattr(image, "is_animated", False) else b""
        except (OSError, SyntaxError, UnidentifiedImageError, ValueError):
            self.missing.append(f"{name}: the file is damaged")
            return None
        if self._bytes + len(content) + len(still) > LIMIT:
            shown = "only its first frame is shown" if still else "it is left out"
            self.missing.append(
                f"{name}: with {len(content) / 1e6:.1f} MB it would make the page too large; "
                f"{shown}"
            )
            if not still:
                return None
            content, kind, still = still, "PNG", b""
        self._bytes += len(content) + len(still)
        words = re.sub(r"[_-]+", " ", Path(name).stem).strip()
        caption = known or f"{words[:1].upper()}{words[1:]}."
        first = data_uri(still, "image/png") if still else ""
        return Picture(caption, data_uri(content, f"image/{kind.lower()}"), width, height, first)

    def further_pictures(self) -> list[Picture]:
        """Pictures of the folder that the report does not know."""
        names = sorted(f.name for f in self.path.iterdir() if f.suffix.lower() in {".png", ".gif"})
        others = [n for n in names if n not in (*PICTURES, *_OWN) and not n.startswith(".")]
        return [picture for name in others if (picture := self.picture(name)) is not None]

    def drawing_of(self, body: str, *, alone: bool) -> Path | None:
        """The SVG file of the part of a body; ``alone`` if there is no other part."""
        bodies = self.record.get("volume")
        safe = file_names([*(bodies if isinstance(bodies, dict) else ()), body])[body]
        names = [f"{safe}/part.svg", f"part_{safe}.svg", f"{safe}.svg"]
        if alone:
            names = ["part.svg", "part/part.svg", *names]
        return next((self.path / name for name in names if (self.path / name).is_file()), None)


def _columns(file: Path) -> dict[str, Array]:
    """The columns of a history; a ValueError if the file is damaged."""
    try:
        return read_history(file)
    except (KeyError, TypeError, ValueError) as error:
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
        found = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:  # no text, or no JSON
        raise ValueError(f"report: {file} is damaged: {error}; run the program again") from error
    if not isinstance(found, dict):
        raise ValueError(f"report: {file} must hold a mapping from names to numbers and texts")
    return found
