# SPDX-License-Identifier: MIT
"""Parts between the zero of a field, what stays solid and the rims of drawn holes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import shapely
from shared.problems import slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.boundary import free_ends
from dolfinx_ffr.boundary_field import (
    FieldSpace,
    FittedNodes,
    PlaneBoundary,
    SizeRows,
    first_field,
    mended,
    redistanced,
)
from dolfinx_ffr.boundary_field.operations import cut, thin_members, with_its_ends
from dolfinx_ffr.boundary_field.sizes import curvatures
from dolfinx_ffr.fem import Spline
from dolfinx_ffr.part import outline_violations

MEMBER, RADIUS, CENTER = 4e-3, 5e-3, np.array([0.06, -0.01])


@cache
def plate() -> FieldSpace:
    """A plate with a hole of 10 mm, solid at its left end."""
    hole = shapely.Point(CENTER).buffer(RADIUS)
    body = ffr.Domain.from_outline(
        MPI.COMM_SELF,
        shapely.box(0.0, -0.03, 0.16, 0.03).difference(hole),
        interfaces={"left": lambda x: x[0] < 1e-9},
        size=6e-3,
        solid=lambda x: x[0] < 0.012,
    )
    return FieldSpace.of(body, MEMBER, MEMBER, rim=MEMBER)


def with_voids(space: FieldSpace, *voids: shapely.Geometry) -> PlaneBoundary:
    """The body of a space without some regions, as a field."""
    material = space.body.outline
    for void in voids:
        material = material.difference(void)
    return PlaneBoundary.of_material(space, material)


def plate_with_void() -> PlaneBoundary:
    """A plate with a round void that reaches to the rim of the hole, and without a corner."""
    corner = shapely.Polygon([(0.17, 0.0), (0.17, 0.04), (0.1, 0.04)])
    return redistanced(with_voids(plate(), shapely.Point(0.09, 0.0).buffer(0.022), corner))


def test_a_part_keeps_the_outline_its_holes_and_their_rims() -> None:
    field = plate_with_void()
    part = field.part
    body = field.space.body
    # chords of the drawn circle
    assert part.polygon.difference(body.outline.buffer(2e-5)).is_empty
    assert outline_violations(part, MEMBER, MEMBER) == []
    assert part.holes == 2
    assert field.area == pytest.approx(part.area, rel=1e-4)
    mesh = field.mesh(np.inf, fine=False)
    assert mesh.area == pytest.approx(part.area, rel=1e-3)
    assert np.any(mesh.solid_cells)


def test_curves_of_a_part_are_as_round_as_the_zero_of_its_field() -> None:
    void = shapely.box(0.09, -0.012, 0.12, 0.012).buffer(-2e-3).buffer(2e-3)
    field = redistanced(with_voids(plate(), void))
    curve = max(
        (c for c in field.part.drawing.curves if isinstance(c, Spline)), key=lambda c: c.length
    )
    x = curve.at(np.linspace(0.0, 1.0, 2000))
    before, points, after = x[:-8:8], x[4:-4:8], x[8::8]
    doubled = np.abs(np.linalg.det(np.stack([points - before, after - before], axis=1)))
    sides = [np.linalg.norm(a - b, axis=1) for a, b in ((points, before), (after, points))]
    radii = sides[0] * sides[1] * np.linalg.norm(after - before, axis=1) / (2.0 * doubled)
    sharp = radii < 3e-3
    assert np.any(sharp)
    curvature = np.abs(curvatures(field, points[sharp]))
    assert np.allclose(radii[sharp] * curvature, 1.0, rtol=0.1)


@pytest.mark.parametrize("angle", [0.0, 90.0, 180.0, 270.0])
def test_a_void_may_meet_the_rim_of_a_hole_from_any_side(angle: float) -> None:
    """The material goes around the rim past the point where its circle begins."""
    way = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    void = shapely.Point(CENTER + 0.018 * way).buffer(0.011)
    rim = shapely.Point(CENTER).buffer(RADIUS + MEMBER)
    part = with_voids(plate(), void).part
    wanted = plate().body.outline.difference(void.difference(rim))
    # a field does not follow the two corners at the rim
    corners = 2.0 * plate().grid.spacing ** 2
    assert part.polygon.symmetric_difference(wanted).area < corners


def test_all_of_a_body_with_round_ends_and_bores_is_its_part() -> None:
    """Polygons of its arcs, which differ by their accuracy, leave no void."""
    ends = shapely.MultiPoint([(0.0, 0.0), (0.1, 0.0)])
    shape = shapely.box(0.0, -0.02, 0.1, 0.02).union(ends.buffer(0.02))
    body = ffr.Domain.from_outline(
        MPI.COMM_SELF,
        shape.difference(ends.buffer(0.008)),
        interfaces={"pin": lambda x: np.abs(np.hypot(x[0], x[1]) - 0.008) < 2e-4},
        size=6e-3,
    )
    space = FieldSpace.of(body, 3e-3, 3e-3, rim=3e-3)
    part = PlaneBoundary.of_material(space, body.outline).part
    assert part.holes == 2
    # splines do not follow an arc to round-off
    assert part.area == pytest.approx(body.outline.area, rel=2e-3)


def test_what_follows_the_zero_of_a_field_is_exact_to_second_order() -> None:
    """The area between curves by the variables, and the zero where the nodes of a mesh go."""
    field = plate_with_void()
    way = np.sin(150.0 * field.space.grid.nodes @ [1.0, 0.7])
    way[field.variables >= field.space.upper - MEMBER] = 0.0
    edge = field.edge
    slope = float(edge.lengths @ (edge.rows @ way))
    step = 1e-5
    ends = [field.with_variables(field.variables + side * step * way) for side in (1.0, -1.0)]
    difference = (ends[0].part.area - ends[1].part.area) / (2.0 * step)
    assert difference == pytest.approx(slope, rel=2e-3)

    mesh = field.mesh(np.inf, fine=False)
    nodes = FittedNodes(field, mesh)
    points = mesh.mesh.geometry.x[:, :2]
    moved = np.column_stack([nodes.motion[i] @ way for i in (0, 1)])
    follows = np.flatnonzero(np.any(moved, axis=1))
    # all nodes on the zero follow, but where it is in what stays solid
    on_zero = np.abs(field.spline(points)) < 1e-6
    on_zero &= shapely.distance(field.space.solid, shapely.points(points)) > 1e-6
    assert np.sum(on_zero) > 50
    assert np.all(sum(abs(motion) for motion in nodes.motion).sum(axis=1)[on_zero] > 0.0)

    for size, bound in ((1e-4, 1e-5), (1e-5, 1e-7)):
        after = field.with_variables(field.variables + size * way)
        before = field.spline(points[follows])
        error = after.spline((points + size * moved)[follows]) - before
        assert np.max(np.abs(error)) < bound


def test_the_gradient_of_psi_by_the_variables_is_that_of_meshes_that_follow() -> None:
    """As nodes follow to first order, a smooth motion changes psi as by new meshes."""
    problem = slider_crank(MPI.COMM_SELF, (40, 4), steps=100)
    rod = problem.flexible["rod"]
    space = FieldSpace.of(rod.domain, 5e-3, 5e-3)
    holes = [shapely.Point(x, 0.0).buffer(0.009) for x in (0.1, 0.2, 0.3)]
    field = redistanced(with_voids(space, *holes))

    def evaluated(field: PlaneBoundary) -> tuple[ffr.Problem, ffr.problem.Evaluation, ffr.Domain]:
        domain = field.part.domain(5e-3)
        own = problem.with_bodies({"rod": rod.with_domain(domain)})
        return own, own.value(np.ones(domain.n_cells)), domain

    own, evaluation, domain = evaluated(field)
    nodes = own.differentiate(evaluation, nodes=True, densities=False).nodes
    assert nodes is not None
    gradient = FittedNodes(field, domain).pullback(nodes["rod"])
    # larger holes in the middle, smaller ones at the ends
    way = np.cos(30.0 * (space.grid.nodes[:, 0] - 0.2))
    way[field.variables >= space.upper - 5e-3] = 0.0
    step = 2e-4
    ends = [
        evaluated(field.with_variables(field.variables + side * step * way))[1].psi
        for side in (1.0, -1.0)
    ]
    assert (ends[0] - ends[1]) / (2.0 * step) == pytest.approx(float(gradient @ way), rel=0.02)


def test_rows_of_sizes_are_the_changes_of_members_gaps_and_radii() -> None:
    space = plate()
    slots = [shapely.box(0.08, -0.02, 0.105, 0.02), shapely.box(0.1085, -0.02, 0.13, 0.02)]
    field = with_voids(space, *(slot.buffer(-2e-3).buffer(2e-3) for slot in slots))
    rows = SizeRows.of(field)
    assert 0 < rows.members < len(rows.values)
    worst = int(np.argmax(rows.values[: rows.members]))
    thinnest = field.part.thinnest_member
    assert thinnest is not None
    assert rows.values[worst] == pytest.approx(1.0 - thinnest.value / (1.02 * MEMBER), abs=0.02)
    way = np.cos(60.0 * space.grid.nodes @ [0.5, 1.0])
    step = 1e-4
    ends = [
        SizeRows.of(field.with_variables(field.variables + side * step * way))
        for side in (1.0, -1.0)
    ]
    place = rows.places[worst]

    def value(other: SizeRows) -> float:
        near = np.argmin(np.linalg.norm(other.places[: other.members] - place, axis=1))
        return float(other.values[near])

    slope = float((rows.slopes @ way)[worst])
    assert (value(ends[0]) - value(ends[1])) / (2.0 * step) == pytest.approx(slope, rel=0.1)


def test_sizes_are_mended_by_small_motions() -> None:
    space = plate()
    slots = [shapely.box(0.08, -0.02, 0.105, 0.02), shapely.box(0.1082, -0.02, 0.13, 0.02)]
    field = with_voids(space, *(slot.buffer(-1.5e-3).buffer(1.5e-3) for slot in slots))
    assert SizeRows.of(field).violation > 0.1
    for _ in range(2):
        field = mended(field, MEMBER)
    assert SizeRows.of(field).violation < 2e-3
    thinnest = field.part.thinnest_member
    assert thinnest is not None and thinnest.value > 0.99 * MEMBER


def slit_along_the_rim(width: float) -> shapely.Geometry:
    """A slit along a third of a rim, so many members wide."""
    ways = [(0.0, 0.0), (0.03, -0.02), (0.03, 0.03), (0.0, 0.03)]
    sector = shapely.Polygon([CENTER + way for way in ways])
    rim = shapely.Point(CENTER).buffer(RADIUS + MEMBER)
    return rim.buffer(width * MEMBER).difference(rim).intersection(sector)


def test_rows_see_slits_along_what_stays_solid() -> None:
    """The wall of a rim faces the zero of the field like any other side, but for its end."""
    rows = SizeRows.of(with_voids(plate(), slit_along_the_rim(0.8)))
    gaps = rows.places[rows.members :] - CENTER
    middle = np.abs(np.arctan2(*gaps.T[::-1]) - np.radians(30.0)) < np.radians(20.0)
    seen = middle & (np.abs(np.hypot(*gaps.T) - RADIUS - 1.4 * MEMBER) < 0.1 * MEMBER)
    assert np.max(rows.values[rows.members :][seen]) == pytest.approx(1.0 - 0.8 / 1.02, abs=0.1)


def test_slits_along_what_stays_solid_are_filled_at_the_start() -> None:
    space = plate()
    field = first_field(space, space.body.outline.difference(slit_along_the_rim(0.9)))
    assert field.part.holes == 1
    assert SizeRows.of(field).violation < 2e-3


@pytest.mark.parametrize("width", [0.4, 0.8])
def test_thin_members_are_widened_before_the_first_field(width: float) -> None:
    """In one piece: between two voids, between a void and the outline, and beside a rim."""
    space = plate()
    middle = 0.5 * width * MEMBER
    voids = [
        shapely.box(0.08, -0.02, 0.11 - middle, 0.03 - 2.0 * middle),
        shapely.box(0.11 + middle, -0.02, 0.14, 0.02),
    ]
    material = space.body.outline.difference(shapely.union_all(voids))
    field = first_field(space, material)
    assert field.part.holes == 3
    assert SizeRows.of(field).violation < 2e-3
    thinnest = field.part.thinnest_member
    assert thinnest is not None and thinnest.value > 0.99 * MEMBER


def test_a_volume_is_kept_where_sizes_are_mended() -> None:
    space = replace(plate(), volume=0.9)
    field = first_field(space, space.body.outline.difference(shapely.Point(0.11, 0.0).buffer(0.01)))
    assert field.part.area == pytest.approx(0.9 * space.body.area, rel=2e-3)
    assert SizeRows.of(field).violation < 2e-3


def test_material_that_falls_apart_is_no_part() -> None:
    gap = shapely.box(0.1, -0.04, 0.11, 0.04)
    field = with_voids(plate(), gap)
    assert field.part.polygon.bounds[2] < 0.11  # the loose end is left out
    with pytest.raises(ffr.fem.ShapeError, match="falls apart"):
        _ = with_voids(plate(), shapely.box(0.02, -0.04, 0.03, 0.04)).part


def test_a_translation_moves_a_hole_as_a_whole() -> None:
    """It is displaced downhill, here for a function that falls as the hole goes to the right."""
    space = plate()
    hole = shapely.Point(0.1, 0.0).buffer(0.008)
    field = redistanced(with_voids(space, hole))
    edge = field.edge
    around = hole.buffer(MEMBER)
    near = shapely.contains_xy(around, *edge.points.T)
    # minus the moment of the void about its center: material that grows takes void away
    slope = edge.rows.T @ (near * edge.lengths * (edge.points[:, 0] - 0.1))
    after = field.translated(slope)
    center = around.buffer(MEMBER).difference(after.part.polygon).centroid
    assert 0.3 * MEMBER < center.x - 0.1 < MEMBER
    assert abs(center.y) < 0.1 * MEMBER


def test_what_a_cut_member_leaves_as_noses_goes_with_it() -> None:
    """Between two round holes a member is thinnest in the middle."""
    space = plate()
    holes = shapely.MultiPoint([(0.09, 0.0), (0.1245, 0.0)]).buffer(0.015)
    field = redistanced(with_voids(space, holes))
    (member,) = thin_members(field)
    after = cut(field, with_its_ends(field, member))
    assert after.part.holes == field.part.holes - 1
    assert free_ends(after.part, MEMBER, np.zeros((0, 2))) == []
    # the waist is nearly as wide as the holes
    waist = shapely.box(0.106, -0.03, 0.1085, 0.03).difference(after.part.polygon)
    assert waist.bounds[3] - waist.bounds[1] > 0.02


def test_material_may_grow_beside_what_stays_solid() -> None:
    """Around a rim that stands free there is some, which moves."""
    space = plate()
    void = shapely.Point(CENTER).buffer(0.02).difference(shapely.box(0.0, -0.002, CENTER[0], 0.002))
    field = first_field(space, space.body.outline.difference(void))
    edge = field.edge
    away = np.linalg.norm(edge.points - CENTER, axis=1) - RADIUS - MEMBER
    beside = np.abs(away) < 0.5 * MEMBER
    assert np.any(beside) and np.mean(edge.moves[beside]) > 0.9


def test_a_part_is_a_boundary_as_it_is_given() -> None:
    """What cannot be moved is refused, and holes that are too small are named."""
    part = with_voids(plate(), shapely.Point(0.11, 0.005).buffer(0.01)).part
    boundary = PlaneBoundary.of(part, MEMBER, volume=0.95)
    assert boundary.part.area == pytest.approx(part.area, rel=0.02)
    line, plane = ffr.Mirror((0.08, 0.0), (1.0, 0.0)), ffr.Mirror((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    wrong: tuple[tuple[dict[str, Any], str], ...] = (
        ({"member": 0.07}, "do not fit into the body"),
        ({"member": -1.0}, "member must"),
        ({"mirrors": [line]}, "has no mirror image near"),
        ({"mirrors": [plane]}, "is a plane; give lines"),
    )
    for options, why in wrong:
        with pytest.raises(ValueError, match=why):
            PlaneBoundary.of(part, **{"member": MEMBER, **options})
    with pytest.warns(ffr.PartWarning, match="holes of the design near .* are left out"):
        PlaneBoundary.of(with_voids(plate(), shapely.Point(0.11, 0.0).buffer(2e-3)).part, 1.5e-2)
