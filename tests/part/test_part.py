# SPDX-License-Identifier: MIT
"""The boundary of a part against closed forms, what it measures, and what is refused."""

from __future__ import annotations

import warnings
from collections.abc import Callable

from mpi4py import MPI

import numpy as np
import pytest
import shapely
from meshes.connecting_rod import ConnectingRod
from shared.meshes import area_of
from shared.rods import STEEL

import dolfinx_ffr as ffr
from dolfinx_ffr.fem import Arc, Line, Spline
from dolfinx_ffr.part.part import _notches
from dolfinx_ffr.part.widths import narrowest_gap, thinnest_member

Field = Callable[[np.ndarray], np.ndarray]

#: Side of the elements of the rod, and their area
H = 0.005
ELEMENT = H**2


def rod(comm: MPI.Comm, **options: object) -> ffr.Domain:
    """A rod of 0.4 m x 0.04 m of 80 x 8 elements with solid ends of 10 mm."""
    return ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(80, 8), **options)


def disc(x: float, y: float, radius: float) -> Field:
    """Distance outside of a disc."""
    return lambda p: np.hypot(p[:, 0] - x, p[:, 1] - y) - radius


def strip(half: float) -> Field:
    """Distance within a strip about the axis."""
    return lambda p: half - np.abs(p[:, 1])


def frame(post: float, flange: float = 0.008, at: float = 0.1) -> Field:
    """Two flanges, and two posts between them at 0.2 m -+ ``at``."""

    def field(p: np.ndarray) -> np.ndarray:
        flanges = flange - np.abs(np.abs(p[:, 1]) - 0.02)
        posts = 0.5 * post - np.abs(np.abs(p[:, 0] - 0.2) - at)
        return np.maximum(flanges, posts)

    return field


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_round_hole(comm: MPI.Comm, cell: str) -> None:
    """Area to 1e-4 of an element's, centre, and curves a hundredth of an element off at most."""
    part = ffr.Part(rod(comm, cell=cell), disc(0.2031, 0.0017, 0.0111), H, material=STEEL)
    hole = np.pi * 0.0111**2
    assert part.area == pytest.approx(0.016 - hole, abs=1e-4 * ELEMENT)
    assert part.mass == pytest.approx(7850.0 * 0.01 * part.area, rel=1e-14)
    center = (0.016 * np.array([0.2, 0.0]) - hole * np.array([0.2031, 0.0017])) / (0.016 - hole)
    np.testing.assert_allclose(part.center, center, atol=1e-8)
    assert (part.pieces, part.holes) == (1, 1)
    ((_, loop),) = part.outlines
    points = np.vstack([curve.points(1e-3 * H) for curve in loop])
    assert np.max(np.abs(np.hypot(*(points - [0.2031, 0.0017]).T) - 0.0111)) < 1e-2 * H
    gap, member = part.narrowest_gap, part.thinnest_member
    assert gap is not None and member is not None
    assert gap.value == pytest.approx(0.0222, rel=5e-3)
    # between the hole and the upper side
    assert member.value == pytest.approx(0.02 - 0.0017 - 0.0111, rel=5e-3)
    assert {round(float(y), 5) for y in member.ends[:, 1]} == {0.0128, 0.02}


def test_strip_and_flanges(comm: MPI.Comm) -> None:
    """Straight boundaries are lines that end on the solid ends; areas are exact."""
    part = ffr.Part(rod(comm), strip(0.0093), H)
    assert part.area == pytest.approx(0.38 * 0.0186 + 0.02 * 0.04, rel=1e-12)
    assert all(isinstance(curve, Line) for curve in part.drawing.curves)
    member = part.thinnest_member
    assert member is not None and member.value == pytest.approx(0.0186, rel=1e-9)
    part = ffr.Part(rod(comm), lambda p: -strip(0.0093)(p), H)
    assert part.area == pytest.approx(0.016 - 0.38 * 0.0186, rel=1e-12)
    assert (part.pieces, part.holes) == (1, 1)
    gap = part.narrowest_gap
    assert gap is not None and gap.value == pytest.approx(0.0186, rel=5e-3)


def test_a_notch_is_where_the_material_bends_inwards() -> None:
    """At each point of a round notch, with its radius, and not at the corners of the plate."""
    angles = np.linspace(0.0, -np.pi, 41)
    notch = np.array([0.5, 1.0]) + 0.1 * np.column_stack([np.cos(angles), np.sin(angles)])
    ring = np.vstack([[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], notch, [[0.0, 1.0]]])
    positions, radii = _notches(ring)
    np.testing.assert_array_equal(positions, notch[1:-1])
    np.testing.assert_allclose(radii, 0.1, rtol=1e-3)


def test_corners_of_the_zero_line_stay_corners(comm: MPI.Comm) -> None:
    """Inner corners of a frame lie between the points of the lattice, and are found."""
    part = ffr.Part(rod(comm), frame(0.0083, 0.0077), H)
    height = 0.04 - 2 * 0.0077
    assert part.area == pytest.approx(0.016 - (0.38 - 2 * 0.0083) * height, rel=1e-10)
    # the middle one; those at the ends open to the solid ends
    assert part.holes == 3


@pytest.mark.parametrize("order", [1, 2])
def test_outline_of_a_curved_mesh(comm: MPI.Comm, order: int) -> None:
    """Lines and arcs of a connecting rod come back; the full part is the rod."""
    shape = ConnectingRod()
    body = shape.domain(comm, 0.01, order=order)
    part = ffr.Part(body, lambda p: np.ones(len(p)))
    assert (part.pieces, part.holes) == (1, 2)
    if order == 2:
        assert part.area == pytest.approx(area_of(shape), rel=1e-12)
        assert not any(isinstance(curve, Spline) for curve in part.drawing.curves)
    for name, radius in zip(("left", "right"), shape.bores, strict=True):
        (bore,) = part.interface(name)
        assert isinstance(bore, Arc)
        assert bore.radius == pytest.approx(radius, rel=1e-9)
        np.testing.assert_allclose(bore.center, body.interfaces[name].center, atol=1e-9)
    if order == 1:
        coarse = shape.domain(comm, 0.016, order=1, near_bores=0.8)
        with pytest.warns(ffr.PartWarning, match=r"'right' is a polygon of \d sides, .* a circle"):
            ffr.Part(coarse, lambda p: np.ones(len(p)))


def test_a_bore_that_is_drawn_as_a_polygon(comm: MPI.Comm) -> None:
    """More elements do not make it round."""
    bore = shapely.Point(0.0, 0.0).buffer(0.01, quad_segs=5)
    shape = shapely.box(-0.02, -0.02, 0.02, 0.02).difference(bore)
    interfaces = {"bore": ffr.fem.Bore((0.0, 0.0))}
    body = ffr.Domain.from_outline(comm, shape, interfaces=interfaces, size=0.003)
    with pytest.warns(ffr.PartWarning, match="polygon of 20 sides.* bore, draw it as a circle"):
        ffr.Part(body, lambda x: np.ones(len(x)))


def test_boundary_ends_on_arcs(comm: MPI.Comm) -> None:
    """A slot through the side of an eye meets the arc itself, not a chord of it."""
    shape = ConnectingRod()
    body = shape.domain(comm, 0.01, order=1)
    part = ffr.Part(body, lambda p: np.maximum(np.abs(p[:, 0]) - 0.0031, -p[:, 1]), 0.01)
    ends = [c.end for c in part.drawing.curves if abs(abs(c.end[0]) - 0.0031) < 1e-12]
    radii = sorted({round(float(np.hypot(*end)), 12) for end in ends})
    assert radii == pytest.approx([shape.bores[0] + shape.rings[0], shape.eyes[0]], rel=1e-9)


def test_void_cells_are_never_material(comm: MPI.Comm) -> None:
    x0, x1 = 0.1 - 1e-9, 0.2 + 1e-9
    domain = rod(comm)
    body = ffr.Domain(
        domain.mesh,
        {name: part.facets for name, part in domain.interfaces.items()},
        void=lambda x: (x[0] > x0) & (x[0] < x1) & (np.abs(x[1]) < 0.01 + 1e-9),
    )
    part = ffr.Part(body, lambda p: np.ones(len(p)))
    assert part.area == pytest.approx(0.016 - 0.1 * 0.02, rel=1e-12)
    assert len(part.drawing.curves) == 8


@pytest.mark.mpi
def test_islands_are_left_out(comm: MPI.Comm) -> None:
    """Loose pieces are named and counted, and leave no hole behind."""
    island = disc(0.25, 0.0, 0.004)
    field = frame(0.008)
    with pytest.warns(ffr.PartWarning, match=r"1 loose pieces touch no interface.*50\.3 mm2 near"):
        part = ffr.Part(rod(comm), lambda p: np.maximum(field(p), -island(p)), H)
    uncut = ffr.Part(rod(comm), field, H)
    assert part.area == pytest.approx(uncut.area, rel=1e-12)
    assert (part.pieces, part.holes) == (uncut.pieces, uncut.holes)
    (loose,) = part.loose
    assert loose.area == pytest.approx(np.pi * 0.004**2, rel=1e-4)
    np.testing.assert_allclose(loose.center, [0.25, 0.0], atol=1e-7)


@pytest.mark.mpi
def test_torn_design_is_refused(comm: MPI.Comm) -> None:
    with pytest.raises(ValueError, match=r"no material connects the interfaces 'left' with"):
        ffr.Part(rod(comm), lambda p: np.abs(p[:, 0] - 0.2) - 0.001, H)


def test_interfaces_without_material(comm: MPI.Comm) -> None:
    """Where no cell is solid, an interface may be lost, or a part of it."""
    body = rod(comm, solid_columns=0)
    with pytest.warns(ffr.PartWarning, match="have lost a share of their material, 50 %"):
        part = ffr.Part(body, strip(0.01), H)
    (left,) = part.interface("left")
    assert left.length == pytest.approx(0.02, rel=1e-12)
    with pytest.warns(ffr.PartWarning, match="the interfaces 'right' have no material"):
        part = ffr.Part(body, lambda p: 0.3 - p[:, 0], H)
    assert part.lost_interfaces == ["right"]
    assert part.area == pytest.approx(0.3 * 0.04, rel=1e-12)
    with pytest.raises(ValueError, match="no piece of the material touches an interface"):
        ffr.Part(body, lambda p: -np.ones(len(p)), H)


def test_hairline_neck_and_slit(comm: MPI.Comm) -> None:
    """A neck of a fiftieth of an element is found, and is part of the part and of its mesh."""
    neck = 0.02 * H

    def field(p: np.ndarray) -> np.ndarray:
        return 0.5 * neck - np.abs(p[:, 1]) + np.maximum(np.abs(p[:, 0] - 0.2) - 0.01, 0.0)

    part = ffr.Part(rod(comm), field, H)
    assert part.pieces == 1
    member = part.thinnest_member
    assert member is not None and member.value == pytest.approx(neck, rel=0.02)
    np.testing.assert_allclose(member.ends.mean(axis=0)[1], 0.0, atol=1e-3 * H)
    mesh = part.domain(H)
    assert mesh.area == pytest.approx(part.area, rel=1e-6)


def test_holes_that_touch_the_edge(comm: MPI.Comm) -> None:
    """A hole that touches the upper side from inside leaves a part that can be meshed."""
    for gap in (0.0, 1e-4 * H):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ffr.PartWarning)
            part = ffr.Part(rod(comm), disc(0.2, 0.02 - 0.008 - gap, 0.008), H)
        hole = np.pi * 0.008**2
        assert part.area == pytest.approx(0.016 - hole, abs=2e-3 * ELEMENT)
        assert part.domain(2 * H).area == pytest.approx(part.area, rel=1e-3)


SQUARE = shapely.box(0.0, 0.0, 1.0, 1.0)


def wedge(degrees: float) -> shapely.Polygon:
    """An isosceles triangle with a sharp corner and legs of 1."""
    x, y = np.cos(np.radians(degrees) / 2), np.sin(np.radians(degrees) / 2)
    return shapely.Polygon([(0.0, 0.0), (x, y), (x, -y)])


@pytest.mark.parametrize(
    ("shape", "member", "gap"),
    [
        # corners and feather edges are no members: that is the disc within
        (wedge(60.0), np.tan(np.radians(30.0)), None),
        (wedge(20.0), np.tan(np.radians(10.0)) * (2 - 2 * np.sin(np.radians(10.0))), None),
        (SQUARE, None, None),
        (SQUARE.union(shapely.box(1.0, 0.4, 1.5, 0.47)), 0.07, None),
        (SQUARE.difference(shapely.box(0.2, 0.5, 0.23, 1.1)), 0.2, 0.03),
        (SQUARE.difference(shapely.Point(0.5, 0.8).buffer(0.13, quad_segs=200)), 0.07, 0.26),
        (
            shapely.box(0, 0, 4, 1)
            .difference(shapely.box(0.1, 0.12, 1.9, 0.8))
            .difference(shapely.box(1.98, 0.12, 3.9, 0.8)),
            0.08,
            0.68,
        ),
    ],
    ids=["wedge", "feather", "square", "finger", "slit", "hole near an edge", "frame"],
)
def test_widths(shape: shapely.Polygon, member: float | None, gap: float | None) -> None:
    """Thinnest members and narrowest gaps of known shapes, to the half percent."""
    for computed, known in (
        (thinnest_member(shape, 1e-3, 0.9), member),
        (narrowest_gap(shape, 1e-3, 0.9), gap),
    ):
        if known is None:
            assert computed is None
        else:
            assert computed is not None and computed.value == pytest.approx(known, rel=5e-3)


@pytest.mark.parametrize("width", [1.6332])
def test_the_place_of_a_short_neck(width: float) -> None:
    """The thinnest member is told where it is, if hardly larger discs do not fit."""
    shape, low, high = shapely.box(0.0, 0.0, 60.0, 20.0), 10.0 - 0.5 * width, 10.0 + 0.5 * width
    for y, end in ((low - 0.5, 0.0), (high + 0.5, 20.0)):
        shape -= shapely.Point(40.0, y).buffer(0.5, quad_segs=100)
        shape -= shapely.box(39.99, min(y, end), 40.01, max(y, end))
    computed = thinnest_member(shape, 1e-2, 15.0)
    assert computed is not None
    assert np.sort(computed.ends, axis=0) == pytest.approx(
        np.array([[40, low], [40, high]]), abs=0.02
    )


def test_densities(comm: MPI.Comm) -> None:
    """Edges between solid and void cells stay where they are, members of one row remain."""
    body = rod(comm)
    y = body.centroids[:, 1]
    x = np.where(body.design_cells, np.where(np.abs(y) < 0.01, 1.0, 0.0), 1.0)
    part = ffr.Part(body, ffr.density_field(body, x))
    # inner corners at the solid ends are rounded by less than two elements
    excess = part.area - (0.38 * 0.02 + 0.02 * 0.04)
    assert 0.0 < excess < 4 * (1 - np.pi / 4) * (2 * H) ** 2
    points = np.vstack([curve.points(1e-4 * H) for curve in part.drawing.curves])
    middle = points[(points[:, 0] > 0.03) & (points[:, 0] < 0.37)]
    np.testing.assert_allclose(np.abs(middle[:, 1]), 0.01, atol=1e-3 * H)
    row = np.where(body.design_cells, np.where(np.abs(y - 0.0025) < 1e-6, 1.0, 0.0), 1.0)
    part = ffr.Part(body, ffr.density_field(body, row))
    member = part.thinnest_member
    assert part.pieces == 1
    assert member is not None and member.value == pytest.approx(H, rel=0.1)


@pytest.mark.parametrize("kind", [ffr.Part, ffr.Solid])
@pytest.mark.parametrize(
    ("field", "error", "message"),
    [
        (lambda p: np.full(len(p), np.nan), ValueError, "NaN or infinite at"),
        (lambda p: np.ones((len(p), 2)), ValueError, "it must give one number for each"),
        # neither material nor void on one half
        (lambda p: 1.0 * (p[:, 0] < 0.2), ValueError, "zero all over .* negative in void"),
        (lambda p: p[:, 0] + 1j, TypeError, "must hold real numbers"),
    ],
)
def test_unusable_field(
    comm: MPI.Comm, kind: type, field: Field, error: type[Exception], message: str
) -> None:
    body = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(20, 4))
    if kind is ffr.Solid:
        body = ffr.Domain.box(comm, 0.4, 0.04, 0.04, elements=(10, 2, 2))
    with pytest.raises(error, match=message):
        kind(body, field)
