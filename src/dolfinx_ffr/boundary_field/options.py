# SPDX-License-Identifier: MIT
"""All numbers that are chosen for boundaries that are fields, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FieldOptions:
    """Numbers of the method; lengths are in minimum members where nothing else is said."""

    # the field
    spacing: float = 0.7  #: Of the splines; from 1.1 on redistancing loses members
    cut_off: float = 3.0  #: Distance beyond which the field is constant at the start, in spacings
    slopes: tuple[float, float] = (0.6, 1.6)  #: Of the field at its zero, else it is made anew
    steep_share: float = 0.03  #: Share of the boundary that may leave these slopes
    zero_weight: float = 30.0  #: Of the zero in a new field, beside its slope there
    far_weight: float = 0.03  #: Of the distance away from the boundary, likewise
    bending_weight: float = 1e-3  #: Of second differences beside values that tell a field

    skin: float = 0.25  #: Width of material around what stays solid at the start

    # the boundary
    sample: float = 0.2  #: Distance of points on the boundary
    on_zero: float = 0.05  #: Distance from the zero of nodes that follow it, in spacings
    triangle: float = 3.2  #: Largest size of triangles
    triangle_across: float = 1.56  #: Largest size of triangles in a member, in its widths
    triangles: int = 470  #: Number of triangles at least, so that slender parts have enough

    # constraints on sizes
    spare: float = 1.02  #: Factor by which minimum sizes are exceeded, as rows are linear
    seen: float = 1.5  #: Sizes up to so many times the minimum have a row
    facing: float = -0.5  #: Largest product of the normals at both ends of a member
    across: float = 0.8  #: Least cosine between a member's width and the normal
    bin: float = 1.5  #: Size of the places of which each has one row
    at_once: float = 0.25  #: Share of a violation that one step mends at most
    mending: int = 3  #: Rounds in which a trial's sizes are mended
    unmended: float = 1e-3  #: Violation of a size or the volume that needs no mending

    # the step
    smooth: float = 5.0  #: Length over which a step is smooth along the boundary
    bulk: float = 1.0  #: Weight of the field's bulk in the metric
    longest_reach: float = 0.95  #: Longest motion of any step, and of the first one
    longer: float = 1.2  #: Factor of the reach after a better step
    shorter: float = 0.5  #: Factor of the reach after a step that is no better
    shortest: float = 2e-3  #: Reach that ends the steps
    #: The same where the largest stress counts: shorter steps change it less than another mesh does
    shortest_of_stress: float = 0.06
    noise: float = 1e-3  #: Change of log psi that another mesh alone may cause
    bound_weight: float = 1.5  #: Of the largest violation of a constraint, at least
    secants: int = 8  #: Steps that tell the curvature
    curvature_share: float = 1e-2  #: Of the largest curvature, from which on one is told

    # the topology
    worth: float = 1e-3  #: Fall of log psi for which it changes; the same rise for a simpler part
    topology_every: int = 5  #: Steps from one look at the topology to the next, at first
    shift: float = 3.0  #: Length over which a translation differs
    opened: float = 0.75  #: Half of it is the radius of discs that thin members do not hold
    small_void: float = 6.0  #: Area of voids that are filled on trial, in squared members
    idle: float = 2e-3  #: Share of psi that a member carries at most to be cut on trial
    noses: float = 3.0  #: How far from a member that is cut voids become convex
    stiff: float = 0.1  #: Share of psi that a body's stiffness carries where members count at all
    promised: float = 0.01  #: Fall of log psi that a new member or hole must promise to be tried
    bar: float = 1.1  #: Width of members that are inserted
    members_tried: int = 3  #: Members that are tried at one time, if the first is not worth it
