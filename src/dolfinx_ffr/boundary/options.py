# SPDX-License-Identifier: MIT
"""All numbers that are chosen for boundaries that move, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SurfaceOptions:
    """The surface of a solid and its walls; lengths are in minimum members if nothing is said."""

    # the field
    spacing: float = 0.5  #: Of the grid of splines; knots of a motion are twice as far apart
    #: Iterations of a fit: more of them draw creases, and thin walls, that the grid cannot show
    fit_iterations: int = 60
    #: Length whose fourth power is the weight of the squared Laplacian: of waves of 1.6 members,
    #: which tetrahedra cannot show, a step leaves 87 %
    fair: float = 0.18
    quantiles: tuple[float, float] = (0.05, 0.95)  #: Of the field's slopes at the surface
    #: Slopes at these quantiles beyond which the field is made a distance again
    steep: tuple[float, float] = (0.5, 1.7)

    # walls
    sample: float = 0.25  #: Distance of the points of the surface at which walls are measured
    #: Angle between the sides of a wall up to which they count as opposite [degree]: at the tip of
    #: a hollow all normals of samples are inclined
    inclined: float = 30.0
    near: float = 3.0  #: Distance from mended places up to which walls are measured again
    thickening: int = 10  #: Most rounds in which thin walls are made thicker
    thin_share: float = 1e-3  #: Share by which the thinnest wall may stay thinner
    thickened: float = 1.005  #: Thickness to which thin walls are mended
    thin: float = 0.8  #: Thickness below which a wall is not moved, but made of balls
    ball: float = 1.06  #: Diameter of these balls, as the fit takes some of it away
    settling: int = 8  #: Most rounds in which thin places of the drawn solid are mended
    grows: float = 0.02  #: By which the balls grow from one of these rounds to the next
    rim: float = 1.03  #: Width of rims, at least: a little more than walls are kept to

    # the tetrahedra
    tetrahedra: int = 30_000  #: Most tetrahedra of the full body, if these are small enough
    small: float = 0.8  #: Their size that is small enough: larger ones lose bars by chance
    more_tetrahedra: int = 250_000  #: The same where they are not small enough
    most_tetrahedra: int = 150_000  #: Most tetrahedra of the solid by which psi is reported
    coarse: float = 2.0  #: Size of tetrahedra beyond which they may miss a wall
    #: Size of tetrahedra whose cut is drawn: chords of larger ones cut into bars
    drawn: float = 0.25
    most_drawn: int = 8_000_000  #: Most of these tetrahedra
    bytes_of_drawn: float = 800.0  #: Memory that one of them takes, twice what was measured

    # points that follow the field
    from_zero: float = 0.25  #: Distance of triangles on the zero surface from it, in their edges
    corner_from_zero: float = 0.1  #: The same of their corners
    along: float = 0.3  #: Least cosine between the normals of such a triangle and of the field
    plane_share: float = 0.05  #: Share of a plane's normals that keeps a point from moving

    # windows
    radii: tuple[float, ...] = (0.75, 1.0, 1.5, 2.0, 3.0)  #: Of windows that are tried
    bridge: float = 1.5  #: Least width of the wall around a window
    deeper: float = 0.75  #: By which a window is deeper than its wall, on each side
    places: float = 0.5  #: Distance of the places that are tried
    wall_near: float = 0.6  #: Distance up to which the wall around a window is looked for
    flat: float = 0.9  #: Least cosine between the normals of the wall around a window
    promised: float = 5e-4  #: Fall of log psi that a window must promise


SURFACES = SurfaceOptions()
