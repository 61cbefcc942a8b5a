# SPDX-License-Identifier: MIT
"""All numbers that are chosen for boundaries that move, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StepOptions:
    """Steps of boundaries; lengths are in minimum members."""

    # the step
    smooth: float = 2.4  #: Length over which a step is smooth
    first: float = 0.5  #: Reach of the first step, which is its longest offset
    longest: float = 0.65  #: Largest reach
    longer: float = 1.2  #: Factor of the reach after a step that lowers the merit
    shorter: float = 0.7  #: Factor of the reach after any other step
    shortest: float = 1e-3  #: Reach below which a new mesh changes psi more than the step does
    reach_again: float = 0.0  #: Least reach after a change of the topology or of the modes
    mesh_noise: float = 0.0  #: Rise of the merit by a new mesh alone, for which no step is rejected
    promised_share: float = 0.25  #: Share of its predicted fall that a successful step brings
    secants: int = 8  #: Earlier steps from which the curvature is estimated
    violation_share: float = 0.25  #: Largest violation that one step tries to remove
    #: Weight of the largest violated bound in the merit, and its least ratio to the sum of the
    #: multipliers: beyond one the penalty is exact
    penalty: float = 1.5
    size_penalty: float = 0.05  #: Weight of the largest violated size in the merit

    # the largest stress
    stress_reach: float = 0.06  #: Least reach: shorter steps change it less than a new mesh does
    stress_margin: float = 0.01  #: Share by which stresses stay below their bounds
    tightening: float = 0.4  #: Share of its violation by which a bound is tightened after a step
    largest_margin: float = 0.08  #: Largest share by which it is tightened
    stress_fall: float = 0.05  #: Share by which a step lowers the largest stress as objective

    # after the steps
    more_steps: int = 4  #: Steps that follow where finer meshes exceed a bound
    more_rounds: int = 3  #: How often they follow

    # the topology
    worth: float = 1e-3  #: Fall of the merit for which it changes; simpler parts may cost half
    changes: int = 8  #: Most changes of each kind between two steps
    slide: float = 1.0  #: First slide of a crossing
    slide_reach: float = 4.0  #: Longest slide, and length over which holes around it slide along

    def rejects(self, merit: float, before: float, best: float) -> bool:
        """Whether a step to a merit is rejected, by the merits before it and of the best trial.

        A new mesh alone may change the merit, and the changes of several steps add up.
        """
        if merit > before + self.mesh_noise:
            return True
        return self.mesh_noise > 0.0 and merit > best + self.mesh_noise


PLANE_STEPS = StepOptions()
#: Steps of surfaces: a cut through tetrahedra changes psi by a per cent or more
SPACE_STEPS = StepOptions(smooth=1.4, shorter=0.9, shortest=0.02, reach_again=0.3, mesh_noise=2e-2)


@dataclass(frozen=True)
class BoundaryOptions:
    """The curves of a part in the plane; lengths are in minimum members."""

    # the mesh of a step
    triangle: float = 3.2  #: Largest size of triangles
    triangle_across: float = 1.2  #: Largest size of triangles in a member, in its widths
    triangles: int = 800  #: Number of triangles at least, so that slender parts have enough
    #: Factor of the sizes where no stress counts, as psi differs by no more than 0.1 % by it
    coarser: float = 1.3

    # the curves
    accuracy: float = 5e-3  #: Distance between curves and the polygons that stand for them
    clear: float = 0.05  #: Least distance of curves from what must stay solid
    off_solid: float = 0.25  #: The same of controls: material that they leave there is no member
    confinements: int = 40  #: Most rounds in which a curve is moved into the region allowed
    overshoot: float = 1.5  #: Factor of the motion in each of these rounds

    # constraints on sizes
    sample: float = 0.2  #: Distance of the points at which members, gaps and radii are measured
    oversize: float = 1.02  #: Factor by which minimum sizes are exceeded, as rows are linear
    constrained: float = 1.5  #: Sizes up to so many times the minimum have a row
    across: float = 0.8  #: Least cosine between a width and the normals at its ends
    mending: int = 3  #: Most rounds in which the sizes of a trial are mended

    # the topology
    idle: float = 2e-3  #: Share of psi that a strut carries at most to be removed on trial
    idle_tried: int = 3  #: Idle struts that are tried at one time
    promised: float = 0.01  #: Fall of log psi that a new strut must promise to be tried
    strut_ends: float = 1.5  #: Distance of points between which struts are looked for
    shortest_strut: float = 3.0  #: Length
    steep: float = 0.3  #: Least cosine between a strut and the normals at its ends
    strut_width: float = 1.1  #: Width of struts that are inserted
    joined: float = 6.0  #: Largest distance of holes that are joined
    convex: float = 3.0  #: How far from the strut between them joined holes are made convex
    smallest_hole: float = 5.0  #: Area, in squares of the minimum member


CURVES = BoundaryOptions()


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
    slope_range: tuple[float, float] = (0.5, 1.7)

    # walls
    oversize: float = CURVES.oversize  #: Factor by which walls exceed members, as rows are linear
    constrained: float = CURVES.constrained  #: Walls up to so many times the minimum have a row
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
    rim: float = 1.03  #: Least width of rims around holes, a little more than that of walls

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
