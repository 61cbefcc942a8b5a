# SPDX-License-Identifier: MIT
"""Drawn parts with bores, on which boundaries are moved; a table of the study `boundary`."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
import shapely
from jobs import Progress

import dolfinx_ffr as ffr
from dolfinx_ffr.part import outline_violations

STEEL = ffr.PlaneStress(210e9, 0.3, 7850.0, 0.01)
#: Load at each free bore [kg]
LOAD = 0.5

Point = tuple[float, float]


@dataclass(frozen=True)
class Drawn:
    """A drawing, the bores that hold and load it, and what is asked of the part."""

    outline: shapely.Polygon  #: With all of its holes [m]
    bores: dict[str, tuple[Point, float]]  #: Middle and radius of each interface [m]
    size: float  #: Of triangles [m]
    member: float  #: Minimum member [m]
    volume: float  #: Largest filled share
    rim: float = 0.0  #: Width of what stays solid around the bores [m], by default a minimum member
    slides: bool = False  #: Whether a crank moves it along a line, or else its first bore turns it

    def domain(self, comm: MPI.Comm) -> ffr.Domain:
        """Its triangles."""

        def at(middle: Point, radius: float) -> Any:
            return lambda x: np.abs(np.hypot(x[0] - middle[0], x[1] - middle[1]) - radius) < 2e-4

        places = {name: at(*bore) for name, bore in self.bores.items()}
        return ffr.Domain.from_outline(
            comm, self.outline, interfaces=places, size=self.size, solid_rim=self.rim
        )

    def problem(self, domain: ffr.Domain) -> ffr.Problem:
        """The compliance of the part in its motion."""
        first, *loaded = self.bores
        frame: Any = ffr.ChordFrame(first, loaded[0]) if self.slides else ffr.TangentFrame(first)
        body = ffr.FlexibleBody(domain, STEEL, frame=frame, modes=4)
        masses = [ffr.PointMass(("body", name), LOAD) for name in loaded]
        if self.slides:
            crank = ffr.Moving.circle((0, 0), 0.04, ffr.Motion.smooth_step(4.0 * np.pi, 1.0))
            joints: list[Any] = [
                ffr.Revolute(("body", first), crank),
                ffr.PointOnLine(("body", loaded[0]), ffr.Ground()),
            ]
            mechanism = ffr.Mechanism(
                {"body": ffr.Placement((0.04, 0.0))}, joints, point_masses=masses
            )
        else:
            still = ffr.Motion.constant(0.0)
            turned = ffr.Moving(still, still, ffr.Motion.smooth_step(1.5, 0.4))
            mechanism = ffr.Mechanism(
                {"body": ffr.Placement()},
                [ffr.Weld(("body", first), turned)],
                point_masses=masses,
            )
        steps = ffr.RadauIIA(1.0 if self.slides else 0.5, steps=20)
        return ffr.Problem({"body": body}, mechanism, steps, ffr.IntegralCompliance())


def round_(middle: Point, radius: float) -> shapely.Polygon:
    """A circle."""
    return shapely.Point(middle).buffer(radius, quad_segs=24)


def bar(points: Sequence[Point], radii: Sequence[float]) -> shapely.Polygon:
    """The hulls of circles that follow each other."""
    circles = [round_(p, r) for p, r in zip(points, radii, strict=True)]
    return shapely.union_all([shapely.union(a, b).convex_hull for a, b in pairwise(circles)])


def drawn(
    shape: shapely.Polygon,
    bores: dict[str, tuple[Point, float]],
    *holes: shapely.Geometry,
    **asked: Any,
) -> Drawn:
    """A part of a ``shape`` with bores and other holes."""
    inner = shapely.union_all([*(round_(*bore) for bore in bores.values()), *holes])
    return Drawn(shape.difference(inner), bores, **asked)


def lever() -> Drawn:
    """Between two bores, with four bolt holes."""
    ends: list[Point] = [(0.0, 0.0), (0.15, 0.0)]
    shape = shapely.box(0.0, -0.022, 0.15, 0.022).union(
        shapely.union_all([round_(x, 0.022) for x in ends])
    )
    bolts = [round_((x, y), 0.0025) for x in (0.05, 0.1) for y in (0.01, -0.01)]
    bores = {"left": (ends[0], 0.008), "right": (ends[1], 0.008)}
    return drawn(shape, bores, *bolts, size=4e-3, member=3e-3, volume=0.6, slides=True)


def rod(rim: float, member: float, volume: float) -> Drawn:
    """With an eye at each end and a rim around each bore."""
    ends: list[Point] = [(0.0, 0.0), (0.15, 0.0)]
    shape = shapely.box(0.0, -0.014, 0.15, 0.014).union(
        shapely.union_all([round_(x, 0.02) for x in ends])
    )
    bores = {"left": (ends[0], 0.009), "right": (ends[1], 0.009)}
    asked = {"size": 3e-3, "member": member, "volume": volume, "rim": rim}
    return drawn(shape, bores, **asked, slides=True)


def wiper_arm() -> Drawn:
    """Long and tapered, driven at its hub."""
    points: list[Point] = [(0.0, 0.0), (0.12, 0.012), (0.3, 0.0)]
    shape = bar(points, [0.024, 0.02, 0.012])
    return drawn(
        shape,
        {"hub": (points[0], 0.009), "tip": (points[2], 0.004)},
        size=3e-3,
        member=2.6e-3,
        volume=0.6,
    )


def crane_arm() -> Drawn:
    """A bent boom with a bore at its foot, one for the hook, and one that is left free."""
    points: list[Point] = [(0.0, 0.0), (0.1, 0.08), (0.25, 0.09)]
    shape = bar(points, [0.026, 0.032, 0.014])
    free = round_((0.1, 0.085), 0.007)
    return drawn(
        shape,
        {"foot": (points[0], 0.01), "hook": (points[2], 0.006)},
        free,
        size=4e-3,
        member=3e-3,
        volume=0.5,
    )


def bell_crank() -> Drawn:
    """Two arms at a right angle, turned at the middle."""
    arms = bar([(0.12, 0.0), (0.0, 0.0), (0.0, 0.09)], [0.014, 0.024, 0.014])
    fillet = shapely.Polygon([(0.0, 0.0), (0.1, 0.0), (0.0, 0.075)])
    bores = {
        "pivot": ((0.0, 0.0), 0.009),
        "right": ((0.12, 0.0), 0.006),
        "top": ((0.0, 0.09), 0.006),
    }
    return drawn(arms.union(fillet), bores, size=4e-3, member=3e-3, volume=0.5)


def yoke() -> Drawn:
    """A fork with two bores at its prongs and one at its shaft."""
    shaft = bar([(0.0, 0.0), (0.06, 0.0)], [0.018, 0.03])
    prongs = [
        bar([(0.06, s * 0.012), (0.08, s * 0.035), (0.14, s * 0.035)], [0.018, 0.016, 0.012])
        for s in (1, -1)
    ]
    shape = shapely.union_all([shaft, *prongs]).buffer(4e-3).buffer(-4e-3)
    bores = {"shaft": ((0.0, 0.0), 0.008)}
    bores |= {name: ((0.14, s * 0.035), 0.005) for name, s in (("upper", 1), ("lower", -1))}
    return drawn(shape, bores, size=4e-3, member=3e-3, volume=0.65)


def gripper_finger() -> Drawn:
    """Bent, with a straight jaw, a driven bore and a guided one."""
    shape = bar([(0.0, 0.0), (0.05, 0.03), (0.1, 0.02)], [0.016, 0.018, 0.012])
    jaw = shapely.box(0.1, 0.006, 0.14, 0.026)
    shape = shape.union(jaw).buffer(3e-3).buffer(-3e-3)
    bores = {"drive": ((0.0, 0.0), 0.006), "tip": ((0.13, 0.016), 0.003)}
    return drawn(shape, bores, round_((0.05, 0.03), 0.005), size=3e-3, member=2.2e-3, volume=0.5)


def plate() -> Drawn:
    """A plate with a hole of 10 mm beside its middle line."""
    bores = {"left": ((0.02, 0.03), 0.008), "right": ((0.24, 0.03), 0.008)}
    hole = round_((0.06, 0.02), 0.005)
    return drawn(
        shapely.box(0.0, 0.0, 0.26, 0.06),
        bores,
        hole,
        size=6e-3,
        member=5e-3,
        volume=0.5,
        slides=True,
    )


#: The parts by name; of the rod those rims, members and volumes that have been hard
PARTS: dict[str, Any] = {
    "lever": lever,
    "rod 4 4 0.3": lambda: rod(4e-3, 4e-3, 0.3),
    "rod 3 5 0.5": lambda: rod(3e-3, 5e-3, 0.5),
    "rod 10 4 0.5": lambda: rod(10e-3, 4e-3, 0.5),
    "rod 8 4 0.5": lambda: rod(8e-3, 4e-3, 0.5),
    "wiper arm": wiper_arm,
    "crane arm": crane_arm,
    "bell crank": bell_crank,
    "yoke": yoke,
    "gripper finger": gripper_finger,
    "plate": plate,
}


def moved(
    comm: MPI.Comm, progress: Progress, *, name: str, iterations: int = 25, steps: int = 8
) -> dict[str, Any]:
    """A part after a short run of a level set and some steps of its boundary, on one rank.

    Psi is relative to the full body, sizes and the volume to what was asked for.
    """
    part = PARTS[name]()
    domain = part.domain(comm)
    problem = part.problem(domain)
    design = ffr.LevelSet(domain, minimum_member=part.member)
    clock = [process_time()]

    def callback(iteration: int, *_: Any) -> None:
        progress(0.5 * iteration / iterations)
        clock.append(process_time())

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = ffr.optimize(
            problem,
            design,
            volume=part.volume,
            iterations=iterations,
            boundary=steps,
            mode_tolerance=None,
            progress=False,
            callback=callback,
        )
    seconds = process_time() - clock[-1]
    full = problem.value(np.ones(domain.n_cells)).psi
    row = {"drawing": name, "psi": result.evaluation.psi / full, "seconds": seconds}
    if result.moved is None:
        return row
    moved_part = result.part()
    assert isinstance(moved_part, ffr.Part)
    thin, gap = moved_part.thinnest_member, moved_part.narrowest_gap
    boundary = result.moved.boundary
    assert isinstance(boundary, ffr.Boundary)
    violations = outline_violations(moved_part, design.hole_rim, part.member)
    return {
        **row,
        "first": result.moved.history["psi"][0] / full,
        "moved": result.psi / full,
        "thinnest": thin.value / design.minimum_member if thin else np.nan,
        "gap": gap.value / design.minimum_gap if gap else np.nan,
        "radius": boundary.smallest_radius / boundary.radius,
        "volume": moved_part.area / (part.volume * domain.area),
        "rims": float(len(violations)),
    }
