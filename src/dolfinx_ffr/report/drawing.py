# SPDX-License-Identifier: MIT
"""The drawing of a part with its dimensions, from its SVG file and the recorded measures."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from .numbers import Scale

_NAMESPACE = "{http://www.w3.org/2000/svg}"
#: Data of a path
_PATH = re.compile(r"[MLACQZHVmlacqzhv0-9eE+\-.,\s]+")
#: Smallest width of a drawing in units of the height of its letters
_LETTERS = 62.0


@dataclass(frozen=True)
class Outline:
    """Outline of a part in its SVG file: millimetres, y downwards."""

    path: str  #: Data of the path
    interfaces: dict[str, str]  #: Data of their paths, by name
    scale: float  #: Units of the file in one millimetre


@dataclass(frozen=True)
class Label:
    """A text with the lines that lead to the place that it names."""

    text: str
    x: float
    y: float
    turned: bool = False
    lines: list[tuple[float, float, float, float]] = field(default_factory=list)


def read_outline(path: Path) -> Outline:
    """The outlines in an SVG file that `Part.write` has written, or a ValueError."""
    try:
        root = ElementTree.fromstring(path.read_bytes())
    except ElementTree.ParseError as error:
        raise ValueError(f"{path.name} is no SVG file: {error}") from None
    found = {e.get("id", ""): e.get("d", "") for e in root.iter(f"{_NAMESPACE}path")}
    box = (root.get("viewBox") or "").split()
    width = re.fullmatch(r"([0-9.eE+-]+)mm", root.get("width") or "")
    good = all(_PATH.fullmatch(data) for data in found.values())
    if "part" not in found or not good or len(box) != 4 or width is None:
        raise ValueError(f"{path.name} is no drawing of a part")
    outline = found.pop("part")
    return Outline(outline, found, float(box[2]) / float(width[1]))


class Drawing:
    """A part with dimensions, in millimetres with y downwards; the template draws it.

    The ``figures`` are recorded: ``bounds``, ``center``, ``thinnest_member``, ``narrowest_gap``
    [m]. A KeyError or TypeError is raised where the first two are missing or no numbers.
    """

    def __init__(self, outline: Outline, figures: Mapping[str, Any]) -> None:
        self.outline = outline
        x0, y0, x1, y1 = (1e3 * float(v) for v in figures["bounds"])
        left, right, top, bottom = x0, x1, -y1, -y0
        wide, high = right - left, bottom - top
        #: Height of letters [mm]
        self.letter = max(wide, 0.6 * high) / _LETTERS
        h = self.letter
        #: Centre of mass
        self.center = (1e3 * float(figures["center"][0]), -1e3 * float(figures["center"][1]))
        self.labels: list[Label] = []
        self.widths: list[tuple[str, float, float, float, float]] = []
        rows = self._callouts(figures, left, right, top)
        below, beside = bottom + 2.6 * h, left - 2.6 * h
        along, across = (
            f"{Scale('m', wide).given(1e-3 * round(length, 3))} mm" for length in (wide, high)
        )
        self.labels.append(Label(along, 0.5 * (left + right), below - 0.5 * h))
        self.labels.append(Label(across, beside - 0.5 * h, 0.5 * (top + bottom), turned=True))
        #: Lines of dimension and of extension: x1, y1, x2, y2, whether with arrows
        self.lines = [
            (left, below, right, below, True),
            (left, bottom + 0.5 * h, left, below + 0.8 * h, False),
            (right, bottom + 0.5 * h, right, below + 0.8 * h, False),
            (beside, top, beside, bottom, True),
            (left - 0.5 * h, top, beside - 0.8 * h, top, False),
            (left - 0.5 * h, bottom, beside - 0.8 * h, bottom, False),
        ]
        above = (2.2 + 1.6 * rows) * h if rows else h
        low, head = left - 5.5 * h, top - above
        #: Of the whole drawing
        self.box = (low, head, right + 3.0 * h - low, below + 2.0 * h - head)

    def _callouts(self, figures: Mapping[str, Any], left: float, right: float, top: float) -> int:
        """Name thinnest member and narrowest gap above the part; returns the rows of text."""
        h, found = self.letter, []
        for key in ("thinnest_member", "narrowest_gap"):
            if width := figures.get(key):
                ends = 1e3 * np.asarray(width["ends"], dtype=np.float64) * [1.0, -1.0]
                text = f"{key.replace('_', ' ')} {Scale.of('m', width['value'], 3)[0]} mm"
                found.append((float(ends[:, 0].mean()), ends, text, key))
        found.sort(key=lambda each: each[0])
        halves = [0.32 * h * len(text) for _, _, text, _ in found]
        pairs = zip(found, halves, strict=True)
        middles = [min(max(each[0], left + half), right - half) for each, half in pairs]
        rows = [0] * len(found)
        if len(found) == 2 and middles[1] - halves[1] < middles[0] + halves[0] + h:
            # one below the other, the lower one beside the line of the upper one
            lower = 0 if found[0][0] - 2.0 * halves[0] > left else 1
            aside = halves[lower] + 0.4 * h
            middles[lower] = found[lower][0] + (aside if lower else -aside)
            rows[1 - lower] = 1
        places = zip(found, middles, halves, rows, strict=True)
        for (x, ends, text, key), middle, half, row in places:
            y = top - (1.6 + 1.6 * row) * h
            (xa, ya), (xb, yb) = ends
            self.widths.append((key, xa, ya, xb, yb))
            line = (x, y + 0.45 * h if abs(middle - x) < half else y - 0.8 * h)
            leader = (*line, x, float(ends[:, 1].mean()))
            self.labels.append(Label(text, middle, y, lines=[leader]))
        return max(rows) + 1 if found else 0
