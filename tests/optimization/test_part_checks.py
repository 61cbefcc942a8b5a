# SPDX-License-Identifier: MIT
"""What finished parts do not keep is a violation of the result."""

from __future__ import annotations

import warnings
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import shapely
from shared.problems import slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.fem import CurveError, ShapeError
from dolfinx_ffr.limits import LimitError
from dolfinx_ffr.optimization import moved_parts
from dolfinx_ffr.optimization.part_checks import part_violations
from dolfinx_ffr.optimization.trial_failed import TrialFailed, shaping
from dolfinx_ffr.part import free_ends

LENGTH, BORE = 0.15, 0.009


def eyes(rim: float, size: float) -> ffr.Domain:
    """A rod between two eyes of 40 mm whose bores of 18 mm predicates name."""
    middles = shapely.MultiPoint([(0, 0), (LENGTH, 0)])
    shape = shapely.box(0, -0.014, LENGTH, 0.014).union(middles.buffer(0.02, 48))
    shape = shape.difference(middles.buffer(BORE, 48))

    def at(middle: float) -> Any:
        return lambda x: np.abs(np.hypot(x[0] - middle, x[1]) - BORE) < 2e-4

    pins = {"left": at(0.0), "right": at(LENGTH)}
    return ffr.Domain.from_outline(MPI.COMM_SELF, shape, interfaces=pins, size=size, solid_rim=rim)


@pytest.mark.parametrize(("rim", "member", "volume"), [(3e-3, 5e-3, 0.5)])
def test_walls_at_eyes_are_as_asked_or_violations(rim: float, member: float, volume: float) -> None:
    """A rod between two eyes, after two steps from a strip that lies on their rims."""
    domain = eyes(rim, 6e-3)
    steel = ffr.PlaneStress(210e9, 0.3, 7850.0, 0.01)
    body = ffr.FlexibleBody(domain, steel, frame=ffr.ChordFrame("left", "right"), modes=2)
    pin = ffr.Moving.circle((0, 0), 0.04, ffr.Motion.smooth_step(10 * np.pi, 1.0))
    mechanism = ffr.Mechanism(
        {"rod": ffr.Placement((0.04, 0))},
        [
            ffr.Revolute(("rod", "left"), pin),
            ffr.PointOnLine(("rod", "right"), ffr.Ground()),
        ],
        point_masses=[ffr.PointMass(("rod", "right"), 0.5)],
    )
    steps = ffr.RadauIIA(1.0, steps=25)
    problem = ffr.Problem({"rod": body}, mechanism, steps, ffr.IntegralCompliance())
    strip = ffr.Part(domain, lambda x: 0.006 - np.abs(x[:, 1]), 0.003)
    boundary = ffr.Boundary.of(strip, member)
    options: dict[str, Any] = {"mode_tolerance": None, "progress": False}
    with warnings.catch_warnings(record=True) as message:
        warnings.simplefilter("always")
        result = ffr.move_boundary(problem, boundary, volume=volume, iterations=2, **options)
    part = result.part()
    assert isinstance(part, ffr.Part) and part.thinnest_member is not None
    for middle in (0.0, LENGTH):
        around = shapely.Point(middle, 0.0)
        inner = around.buffer(1.001 * BORE, quad_segs=96)
        ring = around.buffer(0.99 * rim + BORE).difference(inner)
        assert part.polygon.covers(ring)
    thin = [name for name in result.violations if name.startswith("rod: thinnest member")]
    assert bool(thin) == (part.thinnest_member.value < 0.99 * member)
    assert bool(thin) == any("the thinnest member is" in str(each.message) for each in message)


def test_what_the_part_of_curves_that_cross_exceeds_is_no_result(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The reason is told with what a user of `optimize` can do, and the part is verified."""
    body = ffr.Domain.rectangle(MPI.COMM_SELF, 0.4, 0.04, elements=(20, 4))
    scene = slider_crank(MPI.COMM_SELF, domain=body, modes=1, steps=100)
    design, filled = ffr.LevelSet(body), ffr.Volume("rod", lambda x: x[0] < 0.36)

    def run(boundary: int, upper: float) -> ffr.Result:
        limit = ffr.Constraint(filled, upper=upper, name="filled")
        of = scene.mechanism, scene.integrator, ffr.IntegralCompliance()
        problem = ffr.Problem(scene.bodies, *of, [limit])
        how: dict[str, Any] = {"progress": False, "mode_tolerance": None}
        return ffr.optimize(
            problem, design, design.even(1.0), volume=1.0, iterations=0, boundary=boundary, **how
        )

    share = run(0, 1.0).evaluation.constraints["filled"].value
    assert share < 0.95 and run(0, 1.01 * share).feasible

    def crossed(*args: Any, **options: Any) -> None:
        raise CurveError("boundary: curves cross; give a smaller spacing")

    monkeypatch.setattr(moved_parts.Boundary, "of", crossed)
    with (
        pytest.warns(ffr.part.PartWarning, match="the part violates 'filled'"),
        pytest.warns(ffr.DesignWarning, match="cross or almost touch.* give a larger minimum_mem"),
    ):
        result = run(1, 1.01 * share)
    assert not result.feasible and result.reason == "infeasible"
    assert result.violations["filled"] > 0.02

    def torn(*args: Any, **options: Any) -> None:
        raise ValueError("part: no material connects")

    monkeypatch.setattr(ffr.Result, "enclosed", torn)
    with (
        pytest.warns(ffr.DesignWarning, match="the boundary was not moved"),
        pytest.warns(
            ffr.DesignWarning, match=r"no part can be made of the design of .*: part: no material"
        ),
    ):
        result = run(1, 1.01 * share)
    assert result.violations["part of rod"] == 1.0 and not result.feasible


def part_of(shape: shapely.Geometry) -> ffr.Part:
    """A plate of 100 mm x 40 mm, held on the left, whose part is a shape."""
    body = ffr.Domain.rectangle(MPI.COMM_SELF, 0.1, 0.04, elements=(50, 20), solid_columns=1)

    def field(x: np.ndarray) -> np.ndarray:
        points = shapely.points(x)
        inside = shapely.distance(points, shape.boundary)
        return np.where(shapely.contains_xy(shape, *x.T), inside, -inside)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ffr.part.PartWarning)
        return ffr.Part(body, field, 0.002)


def test_struts_that_end_free() -> None:
    """A spur on a frame, and not the frame's corners; none where a force acts at its tip."""
    frame = shapely.box(-0.001, -0.021, 0.101, 0.021).difference(
        shapely.box(0.01, -0.012, 0.09, 0.012)
    )
    part = part_of(frame)
    assert free_ends(part, 0.004, np.zeros((0, 2))) == []
    spur = part_of(frame.union(shapely.box(0.03, -0.013, 0.034, 0.005)))
    (place,) = free_ends(spur, 0.004, np.zeros((0, 2)))
    assert 0.03 < place[0] < 0.034 and -0.012 < place[1] < 0.005
    assert free_ends(spur, 0.004, np.array([[0.032, 0.004]])) == []
    problem: Any = SimpleNamespace(flexible={"plate": SimpleNamespace(markers={})})
    sizes = {"plate": (0.004, 0.004)}
    (name,) = part_violations(problem, {"plate": spur}, sizes, sizes)
    assert name.startswith("plate: strut that ends free near (3")


@pytest.mark.parametrize(
    "error",
    [
        ShapeError("no mesh"),
        CurveError("curves cross"),
        LimitError("too many triangles"),
        shapely.GEOSException("torn"),
    ],
)
def test_shapes_that_are_refused_fail_a_trial(error: Exception) -> None:
    with pytest.raises(TrialFailed, match=str(error)), shaping():
        raise error


def test_a_bug_in_the_geometry_is_no_failed_trial() -> None:
    """What is no error of a shape goes on, rather than end in shorter and shorter steps."""
    with pytest.raises(ValueError, match="could not be broadcast"), shaping():
        np.zeros(2) + np.zeros(3)
