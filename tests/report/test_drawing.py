# SPDX-License-Identifier: MIT
"""The drawing of a part: what is taken from a file."""

from __future__ import annotations

from pathlib import Path

import pytest
from shared.runs import PART

from dolfinx_ffr.report.model import read_outline


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
        (PART.replace("416 56", "416"), "is no drawing of a part"),
    ],
)
def test_other_files_are_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        read_outline(outline_of(text, tmp_path))
