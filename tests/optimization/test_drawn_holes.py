# SPDX-License-Identifier: MIT
"""Holes that a user has drawn are holes of the part, with their rims, in every kind of design."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import shapely
from shared.meshes import write_pierced_block

import dolfinx_ffr as ffr
from dolfinx_ffr.part import outline_violations

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

STEEL = ffr.PlaneStress(210e9, 0.3, 7850.0, 0.01)
MEMBER = 6e-3


def swung(body: ffr.FlexibleBody, frame: tuple[str, str]) -> ffr.Problem:
    """The compliance of a rod between a crank and a line."""
    crank = ffr.Moving.circle((0, 0), 0.04, ffr.Motion.smooth_step(4 * np.pi, 1.0))
    mechanism = ffr.Mechanism(
        {"rod": ffr.Placement((0.04, 0.0))},
        [
            ffr.Revolute(("rod", frame[0]), crank),
            ffr.PointOnLine(("rod", frame[1]), ffr.Ground()),
        ],
        point_masses=[ffr.PointMass(("rod", frame[1]), 0.5)],
    )
    steps = ffr.RadauIIA(1.0, steps=20)
    return ffr.Problem({"rod": body}, mechanism, steps, ffr.IntegralCompliance())


def plate() -> tuple[ffr.Domain, ffr.Problem]:
    """A plate of 260 x 60 mm with a hole of 10 mm, and void wanted most of all beside the hole."""
    shape = shapely.box(0.0, -0.03, 0.26, 0.03)
    domain = ffr.Domain.from_outline(
        MPI.COMM_WORLD,
        shape.difference(shapely.Point(0.06, -0.01).buffer(0.005)),
        interfaces={"left": lambda x: x[0] < 1e-9, "right": lambda x: x[0] > 0.26 - 1e-9},
        size=6e-3,
        solid=lambda x: (x[0] < 0.012) | (x[0] > 0.248),
    )
    body = ffr.FlexibleBody(domain, STEEL, frame=ffr.ChordFrame("left", "right"), modes=3)
    return domain, swung(body, ("left", "right"))


def lever() -> tuple[ffr.Domain, ffr.Problem]:
    """A lever between two bores, with four bolt holes of 5 mm that have no names."""
    pins, bolts = (
        [(0.0, 0.0), (0.15, 0.0)],
        [(0.05, 0.01), (0.05, -0.01), (0.1, 0.01), (0.1, -0.01)],
    )
    shape = shapely.box(0.0, -0.022, 0.15, 0.022).union(shapely.MultiPoint(pins).buffer(0.022))
    shape = shape.difference(shapely.MultiPoint(pins).buffer(0.008))
    shape = shape.difference(shapely.MultiPoint(bolts).buffer(0.0025))

    def at(middle: float) -> Any:
        return lambda x: np.abs(np.hypot(x[0] - middle, x[1]) - 0.008) < 2e-4

    domain = ffr.Domain.from_outline(
        MPI.COMM_WORLD, shape, interfaces={"left": at(0.0), "right": at(0.15)}, size=4e-3
    )
    body = ffr.FlexibleBody(domain, STEEL, frame=ffr.ChordFrame("left", "right"), modes=3)
    return domain, swung(body, ("left", "right"))


def faults(part: ffr.Part | ffr.Solid, rim: float, member: float) -> list[str]:
    return [each.message for each in outline_violations(part, rim, member)]


@pytest.mark.parametrize(("scene", "holes", "boundary"), [(plate, 1, 0), (lever, 6, 1)])
def test_drawn_holes_of_a_level_set(scene: Any, holes: int, boundary: int) -> None:
    domain, problem = scene()
    assert len(domain.holes) == holes
    member = MEMBER if scene is plate else 4e-3
    design = ffr.LevelSet(domain, minimum_member=member)
    options: dict[str, Any] = {"volume": 0.7, "iterations": 4, "progress": False}
    result = ffr.optimize(problem, design, boundary=boundary, mode_tolerance=None, **options)
    assert bool(result.moved) == bool(boundary)
    part = result.part()
    assert part.holes >= holes
    assert faults(part, member, member) == []
    assert not [name for name in result.violations if "rim of" in name or "outside" in name]


def test_drawn_holes_of_densities() -> None:
    domain, problem = plate()
    design = ffr.DensityDesign(domain, hole_rim=MEMBER)
    options: dict[str, Any] = {"volume": 0.6, "iterations": 3, "progress": False}
    result = ffr.optimize(problem, design, boundary=0, mode_tolerance=None, **options)
    assert faults(result.part(), MEMBER, MEMBER) == []


def test_a_hole_without_a_rim_is_a_violation() -> None:
    """A design that does not keep the rim that it names is not feasible, and the place is told."""
    domain, problem = plate()
    design = ffr.DensityDesign(domain, radius=0.0, hole_rim=0.0)
    design.hole_rim = MEMBER
    cells = domain.everywhere(domain.centroids)[domain.everywhere(domain.design_cells)]
    start = np.where(np.hypot(cells[:, 0] - 0.06, cells[:, 1] + 0.024) < 0.01, 0.0, 1.0)
    options: dict[str, Any] = {"volume": 1.0, "iterations": 1, "progress": False, "start": start}
    with pytest.warns(ffr.DesignWarning, match=r"the rim of the hole near \(60, -10\) mm is"):
        result = ffr.optimize(problem, design, boundary=0, mode_tolerance=None, **options)
    assert result.violations["rod: rim of the hole near (60, -10) mm"] > 0.1
    assert not result.feasible and result.reason == "infeasible"


@pytest.mark.parametrize("kind", ["level set", "densities"])
def test_a_slot_of_a_body_in_space(tmp_path: Path, kind: str) -> None:
    write_pierced_block(tmp_path / "block.msh", tool="slot", size=0.065)
    block = ffr.Domain.from_gmsh(MPI.COMM_WORLD, tmp_path / "block.msh", interfaces=["left"])
    ends = {"left": lambda x: x[0] < -0.5 + 1e-9, "right": lambda x: x[0] > 0.5 - 1e-9}
    domain = ffr.Domain(block.mesh, ends, lambda x: np.abs(x[0]) > 0.35)
    material = ffr.Isotropic(210e9, 0.3, 7850.0)
    body = ffr.FlexibleBody(domain, material, frame=ffr.TangentFrame("left"), modes=2)
    still = ffr.Motion.constant(0.0)
    turned = ffr.Moving(still, still, ffr.Motion.smooth_step(1.0, 1.0), z=still)
    mechanism = ffr.Mechanism(
        {"rod": ffr.Placement((0, 0, 0))},
        [ffr.Weld(("rod", "left"), turned)],
        point_masses=[ffr.PointMass(("rod", "right"), 1e4)],
    )
    steps = ffr.RadauIIA(1.0, steps=10)
    problem = ffr.Problem({"rod": body}, mechanism, steps, ffr.IntegralCompliance())
    rim = 0.08
    design: Any = ffr.DensityDesign(domain, hole_rim=rim)
    if kind == "level set":
        design = ffr.LevelSet(domain, minimum_member=rim)
    options: dict[str, Any] = {"volume": 0.7, "iterations": 3, "progress": False}
    result = ffr.optimize(problem, design, boundary=0, mode_tolerance=None, **options)
    assert faults(result.part(), rim, rim) == []
