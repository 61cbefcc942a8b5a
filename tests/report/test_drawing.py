# SPDX-License-Identifier: MIT
"""The drawing of a part: what it takes from a file, and labels that keep apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from shared.runs import PART

from dolfinx_ffr.report.model import Drawing, read_outline


def outline_of(text: str, folder: Path) -> Path:
    file = folder / "part.svg"
    file.write_text(text)
    return file


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("words", "is no SVG file"),
        (PART.replace('id="part"', 'id="other"'), "is no drawing of a part"),
        (PART.replace("M 0,20", "url(x)"), "is no drawing of a part"),
        (PART.replace("416mm", "416"), "is no drawing of a part"),
    ],
)
def test_other_files_are_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        read_outline(outline_of(text, tmp_path))


def test_drawing_in_metres_is_scaled(tmp_path: Path) -> None:
    metres = PART.replace("-8 -28 416 56", "-0.008 -0.028 0.416 0.056")
    assert read_outline(outline_of(metres, tmp_path)).scale == pytest.approx(1e-3)


@pytest.mark.parametrize("where", [(0.2, 0.25), (0.25, 0.2), (0.0, 0.4), (0.01, 0.02), (0.39, 0.4)])
def test_labels_and_their_lines_keep_apart(where: tuple[float, float], tmp_path: Path) -> None:
    figures = {"bounds": [0.0, -0.02, 0.4, 0.02], "center": [0.2, 0.0]}
    for key, x in zip(("thinnest_member", "narrowest_gap"), where, strict=True):
        figures[key] = {"value": 0.01, "ends": [[x, 0.01], [x, 0.02]]}
    drawing = Drawing(read_outline(outline_of(PART, tmp_path)), figures)
    h = drawing.letter
    callouts = [label for label in drawing.labels if label.lines]
    boxes = [
        (b.x - 0.32 * h * len(b.text), b.y - h, b.x + 0.32 * h * len(b.text), b.y) for b in callouts
    ]
    (a0, a1, a2, a3), (b0, b1, b2, b3) = boxes
    assert a2 <= b0 or b2 <= a0 or a3 <= b1 or b3 <= a1
    for label in callouts:
        x, y0, _, y1 = label.lines[0]
        for left, top, right, bottom in boxes:
            assert not (left < x < right and min(y0, y1) < bottom and max(y0, y1) > top)
    x0, y0, wide, high = drawing.box
    for left, top, right, bottom in boxes:
        assert x0 <= left and right <= x0 + wide and y0 <= top and bottom <= y0 + high
    assert np.isclose(callouts[0].lines[0][2], 1e3 * min(where))
