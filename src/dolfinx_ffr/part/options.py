# SPDX-License-Identifier: MIT
"""All numbers that are chosen for parts and solids but those that measure widths, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CurveOptions:
    """From a field to the curves of a part; lengths are in spacings where nothing else is said."""

    # the lattice on which the zero line is looked for
    finer_lattices: tuple[int, ...] = (1, 2, 4)  #: How much finer ones are tried where curves cross
    most_points: int = 20_000_000  #: Most points, which take a minute without those of the field
    bytes_of_point: int = 300  #: Memory that a point takes, at least
    points_at_once: int = 100_000  #: At which a field is evaluated, so that memory stays small
    zero_steps: int = 60  #: Most steps by which a zero is found; every fourth halves the bracket
    snap: float = 1e-3  #: Distance from the zero line within which a point counts as material
    short: float = 0.02  #: Segments that are contracted, in longest sides of the lattice
    #: Distance of zeros that are thinned out, in sides of the lattice, whose direction they have
    thin: float = 0.35

    # splines along the zero line
    corner: float = 0.7  #: Turn of a corner [rad]; smooth zero lines turn by less
    rounds: int = 4  #: How often points are added where a curve leaves the zero line
    #: Shares of the tolerance with which a spline is smoothed, until it is within the tolerance
    smoothing: tuple[float, ...] = (0.35, 0.15, 0.05, 0.0)

    # lines and circles along the mesh
    straight: float = 1e-6  #: Turn of sides that belong to one straight line [rad]
    #: Turn of sides of a circle [rad]: a regular decagon is one, an octagon is an octagon
    round: float = 0.65
    on_circle: float = 1e-5  #: Distance of vertices from the circle that they are on, in radii
    fewest: int = 4  #: Straight sides of the mesh that make a circle: any three points are on one
    fewest_curved: int = 2  #: Sides with a node in the middle that make a circle
    few_sides: int = 10  #: A polygon with fewer sides than these may be the coarse mesh of a circle

    # polygons that stand for the curves
    accuracy: float = 1e-3  #: Distance between curves and their polygons
    crossing_accuracy: float = 1e-4  #: The same where crossings of curves are looked for
    #: Width up to which a strip along the outline is the difference of two polygons, and no pocket
    strip: float = 0.1


@dataclass(frozen=True)
class MeshOptions:
    """Meshes that fit a part, by triangles, and by tetrahedra for its solid."""

    first_size: float = 2.0  #: Of the triangles of order 2 of a verification, in spacings
    across: float = 0.7  #: Largest size of triangles in a member, in its widths: two lie across it
    turn: float = 0.25  #: Size of triangles in a notch, in its radii: its stress is within 5 %
    stressed: float = 0.1  #: The same where the stress counts: it is within 1 %
    corner: float = 0.5  #: Angle between sides of a polygon that is a corner, and no curve [rad]
    #: Sizes that are tried where gmsh fails, in sizes that were asked for
    smaller: tuple[float, ...] = (1.0, 0.5, 0.25)
    #: Smallest size of triangles, likewise, so that their number stays bounded
    smallest: float = 0.03
    local_accuracy: float = 2e-3  #: Of polygons by which members and notches are found, likewise
    around: int = 24  #: Tetrahedra around a circle: so many straight sides miss 1 % of its area
    on_interface: float = 1e-4  #: Distance of nodes that lie on an interface, in sizes


@dataclass(frozen=True)
class SolidOptions:
    """Tetrahedra cut along the zero surface of a field."""

    near: float = 0.25  #: Distance of corners that are moved onto it, in edges, as in the paper
    on_it: float = 0.05  #: Distance of corners that cannot move and count as on it, likewise
    flat: float = 0.15  #: Smallest volume of a tetrahedron whose corners move, in its first volume
    rounds: int = 20  #: How often corners are looked for at which the surface touches itself
    outside: float = -1e-300  #: Level of corners that count as outside: only its sign matters
    sample: float = 0.25  #: Distance of samples by which members are looked for, in cells
    places: int = 3  #: Most cavities whose places are listed


@dataclass(frozen=True)
class CheckOptions:
    """When a finished part does not satisfy what was asked for."""

    tolerance: float = 0.01  #: Share of a minimum by which a size of a part may be below it
    tolerance_in_space: float = 0.03  #: The same of a solid, whose surface is known by samples
    #: Area of a narrow region of a drawing that is a hole or a notch, and no corner, in squares of
    #: the minimum gap
    corner_area: float = 0.1
    #: Distance from a solid region within which a member is one of that region, in its widths: its
    #: middle is half a width away
    beside: float = 0.6
    cell_tolerance: float = 0.1  #: Share of a cell by which a solid may leave a body that is curved
    #: Depths at which a rim in space, and its hole, are sampled: steps of less than the tolerance
    depths: int = 40
    on_walls: int = 400  #: Points on the walls of a hole from which they are sampled, at most


CURVES, MESHES, SOLIDS, CHECKS = CurveOptions(), MeshOptions(), SolidOptions(), CheckOptions()
#: Sizes of triangles in notches, for those who move boundaries
TURN, STRESSED = MESHES.turn, MESHES.stressed
