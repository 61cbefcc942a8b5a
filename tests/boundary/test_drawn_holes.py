# SPDX-License-Identifier: MIT
"""Boundaries that move stay in the outline of the body, and off the rims of its drawn holes."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import numpy as np
import shapely
from shared.meshes import write_pierced_block

import dolfinx_ffr as ffr
from dolfinx_ffr.boundary import Boundary, Surface
from dolfinx_ffr.part import outline_violations

MEMBER, RADIUS, CENTER = 6e-3, 5e-3, np.array([0.06, -0.01])
HOLE = shapely.Point(CENTER).buffer(RADIUS)


def part(void: float) -> ffr.Part:
    """A plate with a hole of 10 mm, and a round void of a radius beside its rim."""
    body = ffr.Domain.from_outline(
        MPI.COMM_SELF,
        shapely.box(0.0, -0.03, 0.26, 0.03).difference(HOLE),
        interfaces={"left": lambda x: x[0] < 1e-9},
        size=6e-3,
        solid=lambda x: x[0] < 0.012,
    )
    middle = CENTER + np.array([RADIUS + MEMBER + void, 0.0])
    return ffr.Part(body, lambda x: np.linalg.norm(x - middle, axis=1) - void, 6e-3)


def test_a_drawn_hole_that_is_smaller_than_five_squares_of_the_member_stays() -> None:
    assert HOLE.area < 5.0 * MEMBER**2
    boundary = Boundary.of(part(0.012), MEMBER)
    assert len(boundary.holes) == 1  # the void, and not the drawn hole, which does not move
    assert boundary.part.holes == 2
    assert outline_violations(boundary.part, MEMBER, MEMBER) == []
    alone = Boundary.of(part(0.012), MEMBER, rim=0.0)
    assert len(alone.holes) == 2 and alone.part.holes == 2


def test_curves_do_not_enter_a_rim_into_which_they_are_moved() -> None:
    first = Boundary.of(part(0.012), MEMBER)
    moved = first.moved(np.full(first.n_offsets, -0.4 * MEMBER))
    assert moved.valid and moved.material.area < first.material.area
    assert outline_violations(moved.part, MEMBER, MEMBER) == []


def test_what_leaves_the_body_cannot_be_meshed() -> None:
    """A strut across a drawn hole that has become part of a void."""
    boundary = Boundary.of(part(0.012), MEMBER, rim=0.0)
    x, y = CENTER
    key = min(boundary.holes, key=lambda key: boundary.hole(key).area)
    filled = boundary.without([key])
    assert boundary.valid and not filled.valid
    assert boundary.hole(key).contains(shapely.Point(x, y))


def test_a_surface_keeps_the_rim_of_a_bore(tmp_path: Path) -> None:
    write_pierced_block(tmp_path / "block.msh")
    body = ffr.Domain.from_gmsh(MPI.COMM_SELF, tmp_path / "block.msh", interfaces=["left"])
    member = 0.08
    # a void whose edge passes through the bore
    solid = ffr.Solid(body, lambda x: 0.08 - np.abs(x[:, 1]))
    surface = Surface.of(solid, member)
    assert outline_violations(surface.drawn, member, member) == []
    thinner = surface.moved(np.full(surface.n_offsets, -0.01))
    assert thinner.part.volume < surface.part.volume
    assert outline_violations(thinner.drawn, member, member) == []
    (missing,) = outline_violations(Surface.of(solid, member, rim=0.0).drawn, member, member)
    assert missing.share > 0.5
