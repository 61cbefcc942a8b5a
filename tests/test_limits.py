# SPDX-License-Identifier: MIT
"""What would take hours or all of the memory is refused at once, in words, on every rank."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import ezdxf
import numpy as np
import pytest

from dolfinx_ffr import DensityDesign, Domain, LevelSet, Part, Solid
from dolfinx_ffr.design.level_set_step import VelocityExtension
from dolfinx_ffr.limits import INSIST, check_count, check_pairs


def square(comm: MPI.Comm, *elements: int, **options: Any) -> Domain:
    return Domain.rectangle(comm, 1, 1, elements=elements, **options)


def rod(comm: MPI.Comm) -> Domain:
    return Domain.rectangle(comm, 1.0, 0.2, elements=(20, 4))


def box(comm: MPI.Comm) -> Domain:
    return Domain.box(comm, 1.0, 0.2, 0.2, elements=(10, 2, 2))


def strip(x: np.ndarray) -> np.ndarray:
    return 0.08 - np.abs(x[:, 1])


def circle(n: int) -> np.ndarray:
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def outline(comm: MPI.Comm, drawn: Any, size: float) -> Domain:
    return Domain.from_outline(comm, drawn, interfaces={"a": lambda x: x[0] > 0.9}, size=size)


def wide_filter(comm: MPI.Comm) -> DensityDesign:
    return DensityDesign(Domain.rectangle(comm, 1, 0.2, elements=(300, 60)), radius=1.0)


def wide_extension(comm: MPI.Comm) -> VelocityExtension:
    return VelocityExtension(LevelSet(rod(comm), spacing=0.004), 9.0)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda c: square(c, 10_000, 10_000), "100,000,000 cells"),
        (lambda c: square(c, 2000, 1000, cell="triangle"), "8,000,000 cells"),
        (lambda c: Domain.box(c, 1, 1, 1, elements=(1000, 1000, 1000)), "1,000,000,000 cells"),
        (lambda c: outline(c, circle(100), 1e-5), "triangles of 1e-05 m.*give a larger size"),
        (lambda c: outline(c, circle(100), 1e-300), "inf triangles"),
        (lambda c: outline(c, circle(1_000_000), 0.1), "1,000,000 points.*simplify"),
        (lambda c: Part(rod(c), strip, spacing=1e-6), "points of a lattice.*a larger spacing"),
        (lambda c: Part(rod(c), strip, resolution=100_000), "points of a lattice.*resolution"),
        (lambda c: Part(rod(c), strip).domain(1e-5), "triangles of 1e-05 m"),
        (
            lambda c: Solid(box(c), strip).domain(1e-6),
            "tetrahedra are more than the limit of 8,000,000",
        ),
        (lambda c: LevelSet(rod(c), spacing=1e-6), "level set: some .* knots.*larger spacing"),
        (lambda c: LevelSet(rod(c), spacing=4e-4), "pairs of points within the radius"),
        (lambda c: LevelSet(rod(c), quadrature=10_000), "pairs of points.*smaller quadrature"),
        (wide_filter, "density filter: some 324,000,000 pairs.*smaller radius"),
        (wide_extension, "velocity extension: some .* pairs"),
    ],
)
def test_refused_at_once(comm: MPI.Comm, make: Callable[[MPI.Comm], object], message: str) -> None:
    """By every way in; the message has the number, the remedy and the way to insist."""
    with pytest.raises(ValueError, match=message) as error:
        make(comm)
    if "tetrahedra" not in message:  # which have numbers for so many, and no more
        assert INSIST in str(error.value)


def test_who_insists_is_let(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(INSIST, "1e10")
    check_count("mesh", 1e9, "cells", "take fewer", each=1e6)
    with pytest.raises(ValueError, match=r"10,000,000,000 that"):
        check_count("mesh", 1e11, "cells", "take fewer")
    monkeypatch.setenv(INSIST, "yes")
    with pytest.raises(ValueError, match="DOLFINX_FFR_MAX_CELLS is 'yes'; give it a number"):
        check_count("mesh", 1.0, "cells", "take fewer")


def test_memory_of_the_machine() -> None:
    check_count("mesh", 1e6, "cells", "take fewer", each=1e3, available=1e9)
    with pytest.raises(ValueError, match=r"2 GB, more than the 1 GB of this machine; take fewer"):
        check_count("mesh", 2e6, "cells", "take fewer", each=1e3, available=1e9)


@pytest.mark.parametrize("dimension", [2, 3])
def test_pairs_are_estimated(comm: MPI.Comm, dimension: int) -> None:
    """As many as there are far from the boundary, by a third, and never more than all."""
    n = 40 if dimension == 2 else 16
    x = np.stack(np.meshgrid(*[np.arange(n)] * dimension), axis=-1).reshape(-1, dimension)
    inner = np.linalg.norm(x - n // 2, axis=1) <= 4.2
    count = len(x) * int(np.count_nonzero(inner))
    arguments = ("x", (len(x), len(x)), 4.2, dimension, "take fewer")
    check_pairs(*arguments, 80 * count / 0.7)
    with pytest.raises(ValueError, match="pairs"):
        check_pairs(*arguments, 80 * count / 1.3)


def dxf_bomb(path: Path) -> None:
    """Ten inserts of ten inserts ...: 10^12 circles in a few kilobytes."""
    drawing = ezdxf.new("R2010")
    drawing.header["$INSUNITS"] = 4
    drawing.blocks.new("b0").add_circle((0, 0), 1)
    for k in range(1, 13):
        block = drawing.blocks.new(f"b{k}")
        for _ in range(10):
            block.add_blockref(f"b{k - 1}", (0, 0))
    drawing.modelspace().add_blockref("b12", (0, 0))
    drawing.saveas(path)


@pytest.mark.slow
@pytest.mark.mpi
def test_drawings(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    path = shared_tmp_path / "bomb.dxf"
    if comm.rank == 0:
        dxf_bomb(path)
    comm.Barrier()
    with pytest.raises(ValueError, match=r"curves are more than the 20,000"):
        outline(comm, path, 0.01)


@pytest.mark.slow
def test_many_holes(comm: MPI.Comm) -> None:
    """A thousand holes are nested."""
    from dolfinx_ffr.fem.outline import closed_outline, read_outline

    n, square = 32, np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    places = np.array([(i, j) for i in range(n) for j in range(n)])
    rings = [n * square, *(0.3 * square + place + 0.2 for place in places)]
    drawing = closed_outline("outline", read_outline(rings, None), [])
    assert [len(face.loops) for face in drawing.faces] == [1 + n * n]


@pytest.mark.mpi
def test_all_ranks_refuse_where_one_does(comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Launchers may hand on the environment to some ranks only."""
    if comm.rank < comm.size - 1:
        monkeypatch.setenv(INSIST, "1e12")
    for make in (
        lambda: square(comm, 10_000, 10_000),
        lambda: Part(rod(comm), strip, resolution=100_000),
        lambda: LevelSet(rod(comm), spacing=1e-6),
        lambda: wide_filter(comm),
    ):
        with pytest.raises(ValueError, match=INSIST):
            make()
