# SPDX-License-Identifier: MIT
"""The picture of a part, judged by its pixels."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.plotting.part_view import STEEL
from dolfinx_ffr.plotting.style import ACCENTS, RED


def pixels(path: Path, color: str) -> np.ndarray:
    """Where a picture has a colour, rows from the top."""
    with Image.open(path) as image:
        found = np.asarray(image.convert("RGB"), dtype=float)
    return np.asarray(np.max(np.abs(found - 255.0 * np.array(to_rgb(color))), axis=2) < 12.0)


@pytest.mark.mpi
def test_picture_of_a_part(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """Material, interfaces and what was lost have their places and sizes; two dimensions in red."""
    body = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(40, 4))

    def field(p: np.ndarray) -> np.ndarray:
        x, y = p.T
        island = 0.004 - np.hypot(x - 0.25, y)
        web = np.maximum(0.012 - np.abs(np.abs(y) - 0.02), 0.006 - np.abs(x - 0.2))
        return np.maximum(island, web)

    with pytest.warns(ffr.PartWarning, match="1 loose pieces"):
        part = ffr.Part(body, field)
    path = plotting.plot_part(part, shared_tmp_path / "part.png", title="a part")
    comm.Barrier()
    steel = pixels(path, STEEL)
    rows = np.flatnonzero(steel.any(axis=1))
    upper = rows[: np.flatnonzero(np.diff(rows) > 20)[0] + 1]
    overview = steel[upper[0] : upper[-1] + 1]
    scale = (overview.any(axis=0).nonzero()[0][-1] - overview.any(axis=0).nonzero()[0][0]) / 0.4
    # lines, letters and frames hide some of it
    assert overview.sum() / scale**2 == pytest.approx(part.area, rel=0.12)
    for color, side in zip(ACCENTS, (0.1, 0.9), strict=False):
        columns = pixels(path, color)[upper[0] : upper[-1] + 1].any(axis=0).nonzero()[0]
        assert len(columns) and np.all(np.abs(columns / steel.shape[1] - side) < 0.1)
    red = pixels(path, RED)
    assert red[: upper[-1]].any() and red[upper[-1] :].any()


def test_kind_of_picture(comm: MPI.Comm, tmp_path: Path) -> None:
    part = ffr.Part(ffr.Domain.rectangle(comm, 1, 0.2, elements=(20, 4)), lambda p: 1 + p[:, 0])
    with pytest.raises(ValueError, match="picture"):
        plotting.plot_part(part, tmp_path / "part.bmp")
    assert plotting.plot_part(part, tmp_path / "part.svg").stat().st_size > 1000
