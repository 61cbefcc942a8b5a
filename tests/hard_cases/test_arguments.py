# SPDX-License-Identifier: MIT
"""Arguments of a wrong kind, or out of range: refused at once and in words, never read as others.

Each row of the table is a public name, and what its arguments must refuse: values that a person
could plausibly give. Arguments of one name refuse the same wherever they stand, where a row does
not say otherwise. Refused in words is what ends in a `raise` of the package: not in a trace from
the inside, and not in a result.
"""

from __future__ import annotations

import enum
import linecache
import math
import re
import traceback
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.meshes import write_rod
from shared.problems import Copy
from shared.rods import STEEL

import dolfinx_ffr as ffr
from dolfinx_ffr import design, paper, plotting, postprocessing
from dolfinx_ffr.mechanism import AngleCoupling

PACKAGE = Path(ffr.__file__).parent
COMM = MPI.COMM_SELF

#: What no argument of some kind takes.
NO_NUMBER = ("1.0", None, True, 1j, [1.0], {}, np.sin)
ENDLESS = (math.nan, math.inf)
HUGE = 10**5000  # neither a float nor shown in digits
NUMBER = (*NO_NUMBER, *ENDLESS, HUGE)
POSITIVE = (*NUMBER, 0.0, -1.0)
NOT_NEGATIVE = (*NUMBER, -1.0)
SHARE = (*NUMBER, -0.1, 1.1)
INNER_SHARE = (*SHARE, 0.0, 1.0)
COUNT = (*NUMBER, -1, 2.5, HUGE)
WHOLE_FROM_1 = (*COUNT, 0)
VECTOR = ("ab", None, 1.0, (1.0,), (1.0,) * 4, (1.0, math.nan), ("1", "0"), (1.0, 1j), np.sin)
PAIR = (*VECTOR, (1.0, 0.0, 0.0))
DIRECTION = (*VECTOR, (0.0, 0.0))
TEXT = (None, 1, True, ("rod",))
FLAG = (None, "no", 2, 1.0)
SIGNAL = ("1.0", None, True, 1j, (1.0,), *ENDLESS, ffr.Motion)
MOTION = (0.0, "swing", None, np.sin, ffr.Motion)
MARKER = (0.0, "rod", None, ("rod",), ["rod", "left"], ("rod", 1), ffr.Ground, np.sin)
LIST = (1.0, None, "rod", {"rod": 1.0}, np.sin)
MAPPING = (1.0, None, "rod", ["rod"], np.sin, {1: 1.0})
FUNCTION = (0.0, "sin", None, [np.sin])
OBJECTIVE = (1.0, "compliance", None, ffr.IntegralCompliance, np.sin)
LAW = (3.0, "SIMP", ffr.SIMP, np.sin)
WINDOW = ("ab", 1.0, (0.1,), (0.0, 0.1, 0.2), (0.2, 0.1), (0.0, math.nan), np.sin)
ARRAY = ("rod", None, 1j, ["0.5"], [1j], np.sin, {})
STAGES = (*ARRAY, (), 1.0, (1.0, 0.0), (1.0, -1.0), (1.0, math.nan))
NOTHING = (None, 1.0, "rod", np.sin, [], {})
PATH = (None, 1, 1.0, True, ["a"], np.sin)
WEIGHTS = (*MAPPING[:1], *MAPPING[2:], {}, {"a": 0.0}, {"a": -1.0}, {"a": "1"}, {"a": None})

PIN, END = ("rod", "left"), ("rod", "right")
CRANK = ffr.Moving.circle((0.0, 0.0), 0.1, ffr.Motion.smooth_step(1.0, 0.1))
MARKERS = {"left": (0.0, 0.0), "right": (0.4, 0.0)}

#: The same by the name of an argument.
BY_NAME: dict[str, Sequence[Any]] = {
    **dict.fromkeys(("young", "density", "thickness", "length", "height", "inertia"), POSITIVE),
    **dict.fromkeys(("radius", "extent", "duration", "end_time", "tolerance"), POSITIVE),
    **dict.fromkeys(("sharpness", "psi_solid", "mass", "frames_per_second"), POSITIVE),
    **dict.fromkeys(("stiffness", "damping", "alpha", "beta"), NOT_NEGATIVE),
    **dict.fromkeys(("relaxation", "frequency"), NOT_NEGATIVE),
    **dict.fromkeys(("distance", "start", "angle", "low", "high"), NUMBER),
    **dict.fromkeys(("floor", "threshold", "eta"), INNER_SHARE),
    **dict.fromkeys(("void", "progress", "spectral_radius"), SHARE),
    **dict.fromkeys(("modes", "iterations", "compare_every"), COUNT),
    **dict.fromkeys(("order", "steps", "n", "number", "cluster"), WHOLE_FROM_1),
    **dict.fromkeys(("a", "b", "marker", "point", "line", "relative_to"), MARKER),
    **dict.fromkeys(("follower", "free", "moment", "resume", "markers"), FLAG),
    **dict.fromkeys(("name", "title", "xlabel", "joint"), TEXT),
    **dict.fromkeys(("value", "velocity", "acceleration"), FUNCTION),
    **dict.fromkeys(("function", "jacobian", "kernel"), FUNCTION),
    **dict.fromkeys(("position", "center"), VECTOR),
    **{"x": SIGNAL, "y": SIGNAL, "motion": MOTION, "direction": DIRECTION, "window": WINDOW},
    **{"poisson": (*NUMBER, 0.5, -1.0), "comm": (None, 1, "world", MPI), "path": PATH},
    **{"objective": OBJECTIVE, "other": OBJECTIVE, "interpolation": LAW, "weights": WEIGHTS},
    **{"mechanism": (*NOTHING, ffr.Mechanism), "solver": (*TEXT, "lu")},
    "integrator": (*NOTHING[:2], 100, "radau", ffr.GeneralizedAlpha),
}


def some(values: Sequence[Any]) -> list[Any]:
    """What an argument refuses that may be None."""
    return [value for value in values if value is not None]


def in_mechanism(**parts: Any) -> ffr.Mechanism:
    return ffr.Mechanism({"rod": ffr.Placement()}, **parts)


def listed(field: str, kind: type) -> Callable[..., ffr.Mechanism]:
    """A mechanism with one joint or force, whose numbers are judged with it."""
    return lambda **arguments: in_mechanism(**{field: [kind(**arguments)]})


#: A call, arguments with which it works, and what each of them must refuse.
Row = tuple[Callable[..., Any], dict[str, Any], dict[str, Sequence[Any]]]
Rows = Iterator[Row]


class Scene:
    """What the valid calls take."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.rod = ffr.Domain.rectangle(COMM, 0.4, 0.04, elements=(20, 3))
        chord = ffr.ChordFrame("left", "right")
        self.body = ffr.FlexibleBody(self.rod, STEEL, frame=chord, modes=2)
        self.mechanism = ffr.Mechanism(
            {"rod": ffr.Placement((0.1, 0.0))},
            [ffr.Revolute(PIN, CRANK), ffr.PointOnLine(END, ffr.Ground())],
        )
        self.steps = ffr.GeneralizedAlpha(0.1, 40)
        chain = (self.mechanism, self.steps, ffr.IntegralCompliance())
        self.problem = ffr.Problem({"rod": self.body}, *chain)
        self.levelset = ffr.LevelSet(self.rod)
        self.design = ffr.DensityDesign(self.rod)
        self.full = np.ones(self.rod.n_cells)
        self.bodies = {"rod": ffr.VolumeIntegrals.rigid(1.0, (0.2, 0.0), 0.02, MARKERS)}
        self.evaluation = self.problem.value(self.full)
        self.held = ffr.Motion.constant(0.1)
        mesh, full = self.rod.mesh, self.full
        fields = (*ARRAY, 1.0, full[1:], math.nan * full)
        objects = {
            "domain": (self.rod, (*NOTHING, mesh, self.body)),
            "body": (self.body, (*NOTHING, self.rod)),
            "reduced": (self.evaluation.bodies["rod"], (*NOTHING, self.evaluation)),
            "problem": (self.problem, (*NOTHING, self.body, ffr.Problem)),
            "evaluation": (self.evaluation, (*NOTHING, full)),
            "levelset": (self.levelset, (*NOTHING, "phi", self.rod)),
            "density": (full, (*fields, 2.0 * full)),
            "gradient": (full, fields),
            "exact": (full, fields),
        }
        self.works = {
            **{"a": PIN, "b": ffr.Ground((1.0, 0.0)), "marker": PIN, "point": PIN},
            **{"line": ffr.Ground(), "motion": self.held, "comm": COMM},
            **{"mechanism": self.mechanism, "integrator": self.steps},
            **{"objective": ffr.IntegralCompliance(), "path": folder / "picture.png"},
            **{name: good for name, (good, _) in objects.items()},
        }
        self.refused = {**BY_NAME, **{name: bad for name, (_, bad) in objects.items()}}

    def row(self, call: Callable[..., Any], names: str, given: Any = None, **refused: Any) -> Row:
        """Arguments that work and refuse as by their names, or as given."""
        usual = names.split()
        works = {name: self.works[name] for name in usual if name in self.works}
        judged = {name: self.refused[name] for name in usual}
        return call, {**works, **(given or {})}, {**judged, **refused}

    def calls(self) -> Rows:
        yield from self.of_mechanisms()
        yield from self.of_bodies()
        yield from self.of_objectives()
        yield from self.of_designs()
        yield from self.of_parts()
        yield from self.of_files()
        yield from self.of_pictures()

    def of_mechanisms(self) -> Rows:
        row, held = self.row, self.held
        of_time = "value velocity acceleration"
        functions = dict.fromkeys(of_time.split(), np.sin)
        jumps = (math.nan, (math.nan,), ("1",), 1.0)
        yield row(ffr.Motion, f"name {of_time}", functions, jumps=jumps)
        yield row(ffr.Motion.constant, "", {"value": 1.0}, value=NUMBER)
        constant = {"coefficients": [1.0]}
        yield row(ffr.Motion.polynomial, "", constant, coefficients=(*ARRAY, (), 1.0))
        step = {"distance": 1.0, "duration": 1.0, "start": 0.0}
        yield row(ffr.Motion.smooth_step, "distance duration start", step)
        yield row(ffr.Ground, "position angle name")
        moving = {"x": held, "y": held}
        yield row(ffr.Moving, "", moving, **dict.fromkeys(("x", "y", "angle"), MOTION))
        circle = {"center": (0, 0), "radius": 0.1, "angle": held}
        yield row(ffr.Moving.circle, "center", circle, radius=NUMBER, angle=MOTION)

        joint, force = (partial(listed, field) for field in ("joints", "forces"))
        yield row(joint(ffr.Revolute), "a b name")
        yield row(joint(ffr.Weld), "a b name", angle=("1", True, *ENDLESS, held))
        along = {"direction": (1.0, 0.0)}
        yield row(joint(ffr.Translational), "a b name direction", along)
        yield row(joint(AngleCoupling), "a b name", {"ratio": 2.0}, ratio=(*NUMBER, 0.0))
        teeth = {"ratio": (*NUMBER, 0.0, 1.0), "pressure_angle": (*NUMBER, 20.0)}
        yield row(joint(ffr.Gear), "a b name", {"ratio": 2.0}, relative_to=MARKER, **teeth)
        length = ("1", True, 1j, *ENDLESS, 0.0, -1.0, np.sin)
        yield row(joint(ffr.Distance), "a b name", length=length)
        yield row(joint(ffr.PointOnLine), "point line direction", along)
        yield row(joint(ffr.LinearDrive), "point line direction motion", along)
        yield row(joint(ffr.PrescribedAngle), "marker motion", relative_to=MARKER)
        axis = (*TEXT, "w", 0)
        yield row(joint(ffr.PrescribedPosition), "marker motion", {"axis": "x"}, axis=axis)

        on_ground = (*MARKER, ffr.Ground())
        yield row(force(ffr.Force), "x y follower", {"marker": PIN}, marker=on_ground)
        yield row(force(ffr.Torque), "marker", moment=SIGNAL)
        spring = {"stiffness": 1.0}
        strength = "a b name stiffness damping"
        yield row(force(ffr.SpringDamper), strength, spring, length=(*some(SIGNAL), -1.0))
        yield row(force(ffr.TorsionalSpringDamper), strength, spring, angle=some(SIGNAL))

        def placed(**given: Any) -> ffr.Mechanism:
            return ffr.Mechanism({"rod": ffr.Placement(**given)})

        yield row(placed, "position angle", velocity=VECTOR, angular_velocity=NUMBER)
        yield row(listed("point_masses", ffr.PointMass), "marker mass", {"mass": 1.0})

        def damped(**given: Any) -> ffr.Mechanism:
            return in_mechanism(damping={"rod": ffr.RayleighDamping(**given)})

        yield row(damped, "alpha beta")
        fields = (*VECTOR[:5], ("0", 0.0), (None, 0.0), (math.nan, 0.0))
        pin = ffr.Revolute(PIN, ffr.Ground())
        yield row(
            ffr.Mechanism,
            "",
            {"placements": {"rod": ffr.Placement()}},
            placements=(*MAPPING, {"rod": (0.0, 0.0)}, {"rod": None}),
            joints=(*LIST, pin, [PIN], [None], [ffr.Force(PIN)]),
            forces=(*LIST, ffr.Force(PIN), [1.0], [pin]),
            point_masses=(*LIST, ffr.PointMass(PIN, 1.0), [1.0]),
            gravity=fields,
            ground_acceleration=fields,
            damping=(*MAPPING, ffr.RayleighDamping(), {"rod": 0.1}),
            start=(None, "rest", ffr.StaticEquilibrium, ffr.Placement()),
            jumps=(*ARRAY, 1.0, (math.nan,)),
        )
        elastic = (*MAPPING, {"rod": "a"}, {"rod": [math.nan]})
        yield row(ffr.Assembled, "", elastic=elastic, elastic_velocity=elastic)
        span = {"end_time": 1.0, "steps": 2}
        yield row(ffr.GeneralizedAlpha, "end_time steps spectral_radius", span)
        yield row(
            ffr.RadauIIA,
            "end_time",
            {"end_time": 1.0},
            tolerance=(*POSITIVE, 1.0),
            steps=("2", 0, -1, 2.5, True, (0.0, 2.0), (0.0, "1"), (1.0, 0.0), math.nan),
        )
        yield row(
            ffr.simulate,
            "mechanism integrator",
            {"bodies": self.bodies},
            bodies=(*MAPPING, {"rod": None}, {"rod": 1.0}, {}),
            end_time=(1.0,),
            tolerance=(*some(POSITIVE), 1.0),
        )

    def of_bodies(self) -> Rows:
        row, cells = self.row, self.rod.n_cells
        numbers = {"young": 1.0, "poisson": 0.3, "density": 1.0}
        for material in (ffr.PlaneStress, ffr.PlaneStrain):
            yield row(material, "young poisson thickness", numbers, density=POSITIVE)
        yield row(ffr.SIMP, "floor", exponent=(*NUMBER, 0.5), mass=(None, *LAW))
        yield row(ffr.RAMP, "floor", penalty=NOT_NEGATIVE, mass=(None, *LAW))
        yield row(ffr.SuppressedVoidMass, "threshold")
        yield row(
            ffr.Domain.rectangle,
            "comm length height order",
            {"length": 0.4, "height": 0.04, "elements": (4, 2), "solid_columns": 1},
            elements=(8, "ab", None, (8,), (8, 2, 2), (0, 2), (8, -1), (8.5, 2), (8, "2")),
            cell=(*TEXT, "hexagon"),
            solid_columns=(*COUNT, 2),
        )
        facets = self.rod.mesh.topology.index_map(1).size_local
        wrong = (
            *(1.0, None, "left", [0.5], ["0"], [[0, 1]]),
            *(lambda x: x[0], lambda x: True, lambda x: math.sin(x[0]) > 0.5),
        )
        no_facets = (
            *(*wrong, *([number] for number in (-1, facets, 10**9, -(10**9)))),
            *(np.ones(n, dtype=bool) for n in (facets - 1, facets + 1, cells)),
        )
        no_cells = ([-1], [cells], [10**9], [True] * (cells - 1), np.ones((cells, 1), bool))
        yield row(
            ffr.Domain,
            "order",
            {"domain": self.rod.mesh, "interfaces": {"left": lambda x: x[0] < 1e-9}},
            domain=(None, self.rod, "rod.msh", COMM),
            interfaces=(*MAPPING, {}, *({"left": value} for value in no_facets)),
            solid=(*some(wrong), *no_cells),
            centers=(*MAPPING[:1], {"no": (0.0, 0.0)}, *({"left": p} for p in PAIR)),
        )
        yield row(ffr.LinearMass, "")
        frames = (None, 0.0, "chord", ffr.ChordFrame, np.sin)
        yield row(
            ffr.FlexibleBody,
            "domain interpolation",
            {"material": STEEL, "frame": ffr.TangentFrame("left"), "modes": 1},
            material=(None, "steel", 2.1e11, ffr.PlaneStress, ffr.SIMP()),
            frame=(*frames, ffr.TangentFrame("no"), ffr.ChordFrame("left", "left")),
            modes=(*COUNT, 10**6),
            markers=(*MAPPING[:1], *MAPPING[2:], {"tip": 1.0}, {"left": (0.2, 0.0)}),
            tolerance=(*POSITIVE, 1.0, 1e-20),
            stiffening=(1.0, None, "omega2", ["wind"], [1], np.sin),
        )
        yield row(
            lambda **given: ffr.FlexibleBody(self.rod, STEEL, frame=ffr.ChordFrame(**given)),
            "",
            {"start": "left", "end": "right"},
            start=(*TEXT, "no"),
            end=(*TEXT, "no", "left"),
        )
        pins = (*MAPPING[:1], *MAPPING[2:], *({"pin": pair} for pair in PAIR))
        unit = {"mass": 1.0, "inertia": 1.0}
        rigid = ffr.VolumeIntegrals.rigid
        yield row(rigid, "mass inertia", unit, center=some(PAIR), markers=pins)
        moments = {"mass": 1.0, "S": np.zeros((1, 2)), "G": np.eye(1), "N": np.zeros((1, 1))}
        matrices = dict.fromkeys("SGN", (*ARRAY, 1.0, np.ones(3), [[math.nan]]))
        yield row(ffr.VolumeIntegrals.from_arrays, "mass", moments, **matrices)
        full = self.full
        shapes = (*ARRAY, 0.5, [0.5], full[1:], 1.5 * full, -full)
        densities = (*shapes, 0 * full, math.nan * full, 1j * full, ["1"] * cells, [None] * cells)
        by_name = ({"arm": full}, {"rod": "a"}, {})
        yield row(self.problem.value, "", {"x": full}, x=(*densities, *by_name))
        yield row(self.body.reduce, "", {"x": full}, x=densities)
        yield row(self.body.volume, "", {"x": full}, x=shapes)

    def of_objectives(self) -> Rows:
        row = self.row
        weights = (1.0, "rod", ["rod"], {"rod": "1"}, {"rod": math.nan}, {1: 1.0})
        compliance = {"bodies": ("rod", [], 1.0, [1], np.sin), "weights": weights}
        yield row(ffr.IntegralCompliance, "", **compliance)
        yield row(ffr.PeakCompliance, "", **compliance, power=(*NUMBER, 0.5))
        rod = {"body": "rod"}
        yield row(ffr.Mass, "", rod, body=TEXT)
        yield row(ffr.Volume, "", rod, body=TEXT)
        body_options = {"pinned": ("left", [1], 1.0), "point_masses": FLAG}
        yield row(ffr.Frequency, "number cluster free", rod, body=TEXT, **body_options)
        power = (*NUMBER, 1.0)
        joints = [value for value in TEXT if value != ("rod",)]  # several are a tuple of names
        yield row(ffr.JointForce, "moment window", {"joint": "pin"}, joint=joints, power=power)
        place = {"body": "rod", "marker": "left"}
        for objective in (ffr.MarkerAcceleration, ffr.MarkerVelocity):
            yield row(objective, "window", place, body=TEXT, marker=TEXT)
        yield row(
            ffr.PathTracking,
            "window",
            {**place, "path": (0.0, np.sin)},
            body=TEXT,
            marker=TEXT,
            path=(*ARRAY, (0.0, "1"), (np.sin, *[0.0] * 3), (None, 0.0), (math.nan, 0.0)),
            weight=("1", ["1"], [1j]),
        )
        mass = ffr.Mass("rod")
        terms = (1.0, [], [1.0], [mass], [("1", mass)], [(1.0, "mass")], [(math.nan, mass)], None)
        yield row(ffr.Sum, "", {"terms": [(1.0, mass)]}, terms=terms)
        factor = ("2", None, *ENDLESS)
        yield row(lambda weight: weight * mass, "", {"weight": 2.0}, weight=factor)
        yield row(lambda other: mass + other, "other", {"other": mass})
        yield row(lambda other: mass - other, "other", {"other": mass})
        bound = {"objective": mass, "upper": 1.0}
        yield row(ffr.Constraint, "objective name", bound, upper=(*NUMBER, 0.0), lower=(1.0,))
        bounds = (*LIST, ffr.Constraint(mass, 1.0), [mass], [1.0])
        of_motion = "mechanism integrator objective"
        yield row(ffr.MechanicalProblem, of_motion, constraints=bounds)
        settings = {"bodies": {"rod": self.body}}
        bodies = (*MAPPING, {}, {"rod": None}, {"rod": self.rod}, self.body, self.bodies)
        yield row(ffr.Problem, of_motion, settings, constraints=bounds, bodies=bodies)
        for combine in (ffr.WeightedSum, ffr.WorstCase):
            yield row(combine, "weights")
        yield row(ffr.PowerMean, "weights", p=(*NUMBER, 0.5))
        motion = ffr.MechanicalProblem(self.mechanism, self.steps, ffr.IntegralCompliance())
        yield row(
            ffr.Problem.of_load_cases,
            "",
            {**settings, "load_cases": {"a": motion, "b": motion}},
            bodies=bodies,
            load_cases=(*MAPPING, {}, {"a": None}, {"a": self.problem}, motion, [motion]),
            combine=(1.0, "sum", ffr.WeightedSum, np.sum, ffr.WorstCase({"a": 1.0})),
        )
        for thing in (self.problem, self.evaluation):
            yield row(thing.alone, "", {"load_case": "load case"}, load_case=(*TEXT, "fast"))

    def of_designs(self) -> Rows:
        row, optional = self.row, some(POSITIVE)
        yield row(ffr.Wendland, "radius", {"radius": 1.0})
        for kernel in (ffr.Multiquadric, ffr.Gaussian, ffr.ExponentialSpline):
            yield row(kernel, "length", {"length": 1.0})
        knots = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        yield row(
            paper.ScatteredInterpolation,
            "",
            {"points": knots, "kernel": ffr.Wendland(3.0)},
            points=(*ARRAY, 1.0, [], knots * math.nan),
            kernel=(None, 1.0, "gaussian", ffr.Wendland, np.sin),
            degree=("1", 1.5, -2, True, 5),
        )
        yield row(
            ffr.LevelSet,
            "domain",
            spacing=(*optional, 1.0),
            minimum_member=(*optional, 1e-6),
            minimum_gap=(*optional, 1e-6),
            mirrors=(1.0, [1.0], "axis", [ffr.Mirror((0.0, 0.01), (0.0, 1.0))]),
            quadrature=some(WHOLE_FROM_1),
        )
        levelset, flat = self.levelset, np.ones(len(self.levelset.knots))
        yield row(
            levelset.with_holes,
            "",
            {"columns": 1, "rows": 1, "radius": 0.01},
            columns=WHOLE_FROM_1,
            rows=WHOLE_FROM_1,
            radius=NOT_NEGATIVE,
            margin=some(NUMBER),
        )
        no_vector = (*ARRAY, 1.0, np.ones(2), np.full(len(flat), math.nan))
        for of in (levelset.density, levelset.level, levelset.penalty, levelset.distance):
            yield row(of, "", {"variables": flat}, variables=no_vector)
        yield row(levelset.from_distance, "", {"distance": flat}, distance=no_vector)
        yield row(levelset.with_sharpness, "sharpness", {"sharpness": 8.0})
        for part in (levelset, self.design):
            yield row(part.at, "progress", {"progress": 0.5})
        line = {"point": (0.0, 0.0), "normal": (1.0, 0.0)}
        yield row(ffr.Mirror, "", line, point=PAIR, normal=(*PAIR, (0.0, 0.0)))
        gradient = (*some(ARRAY), 1.0, np.ones(2))
        yield row(ffr.mirror_lines, "domain", gradient=gradient)
        shares = (*SHARE, 0.0, 0.01)
        yield row(design.Evolution, "levelset", {"volume": 0.7}, volume=shares, band=POSITIVE)
        yield row(design.VelocityExtension, "levelset", radius=optional)
        yield row(ffr.DensityDesign, "domain eta", radius=some(NOT_NEGATIVE))
        yield row(self.design.even, "", {"value": 0.5}, value=(*SHARE, 2.0))
        yield row(design.DensityFilter, "domain", {"radius": 0.1}, radius=NOT_NEGATIVE)
        yield row(design.HeavisideProjection, "eta", {"beta": 1.0}, beta=POSITIVE)
        yield row(
            ffr.LevelSetEvolution,
            "",
            sharpness=STAGES,
            step=POSITIVE,
            tolerance=NOT_NEGATIVE,
            stage_iterations=some(WHOLE_FROM_1),
        )
        once = {"iterations": 0, "progress": False, "volume": 1.0}
        asymptotes = {"tolerance": NOT_NEGATIVE, "length": some(WHOLE_FROM_1)}
        yield row(ffr.MMA, "", move=(*SHARE, 0.0), **asymptotes)
        yield row(
            ffr.optimize,
            "problem iterations resume",
            {**once, "design": levelset, "start": flat},
            design=(None, "level set", self.rod, ffr.LevelSet, self.design, {"arm": levelset}),
            start=(*some(no_vector), {"arm": flat}),
            optimizer=(1.0, "mma", ffr.MMA, np.sin),
            volume=(*shares, {"arm": 0.5}),
            gradient=(1.0, "adjoint", ffr.ExactAdjoint, np.sin),
            output=(1.0, True, ["results"]),
            progress=FLAG,
            callback=(1.0, "print", [print]),
        )

    def of_parts(self) -> Rows:
        """What the chain consists of, for those who call its links one by one."""
        row, full = self.row, self.full
        x = {"x": full}
        yield row(ffr.gray_fraction, "domain", x, x=self.refused["density"])
        everywhere = np.ones(self.rod.n_cells, bool)
        cells = (*ARRAY, [0], everywhere[1:])
        errors = paper.gradient_errors
        yield row(errors, "domain gradient exact", {"cells": everywhere}, cells=cells)

        def mode_derivatives(**given: Any) -> list[Any]:
            return list(paper.mode_derivatives(**given))

        elements = ("rod", [1.5], [10**6], [-1], ["a"])
        for derivatives in (mode_derivatives, paper.integral_derivatives):
            yield row(derivatives, "body reduced", {"cells": [0]}, cells=elements)
        elements = (*elements, {"arm": [0]})
        of_cells = paper.elementwise_gradient
        yield row(of_cells, "problem evaluation solver", {"cells": [0]}, cells=elements)
        optional = some(POSITIVE)
        grid = {"grid": optional, "band": optional, "share": (*optional, 1.1)}
        yield row(paper.GradientElements, "", {"grid": 0.1}, **grid)
        yield row(
            paper.ApproximateGradient,
            "compare_every solver",
            elements=(None, 0.3, "grid"),
            kernel=(1.0, "gaussian", np.sin),
            degree=("1", 1.5, -2, True),
            band=optional,
        )
        points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.7, 0.6]])
        yield row(
            paper.best_length,
            "",
            {"kernel": ffr.Gaussian, "points": points, "values": [0.0, 1.0, 2.0, 1.0]},
            kernel=(None, 1.0, "gaussian"),
            points=ARRAY,
            values=ARRAY,
            bounds=("ab", (1.0,), (2.0, 1.0), (0.0, 1.0), 1.0, ("1", "2")),
        )
        stress_modes = postprocessing.StressModes.of
        yield row(stress_modes, "body reduced relaxation void", correction=FLAG[1:])
        q = (*ARRAY, np.zeros(2), np.full(5, math.nan))
        rest_state = {"q": np.zeros(5)}
        yield row(ffr.von_mises, "body reduced", rest_state, q=q)
        name = (*TEXT[:2], "arm")
        yield row(ffr.worst_stress, "body evaluation", {"name": "rod"}, name=name)
        for call in (ffr.model_report, ffr.mode_error, ffr.local_modes):
            yield row(call, "problem evaluation")
        yield row(ffr.propose_modes, "problem evaluation tolerance", {"tolerance": 1.0})
        of_rod = {"x": ("rod", 1.0, full[1:])}
        yield row(ffr.select_modes, "problem tolerance", {"tolerance": 1.0}, **of_rod)
        modes = (*MAPPING, {"arm": 1}, {"rod": -1}, {"rod": "1"})
        yield row(self.problem.with_modes, "", {"modes": {"rod": 1}}, modes=modes)
        looser = {**x, "tolerance": 0.1}
        yield row(self.problem.with_tolerance, "", looser, tolerance=NUMBER)
        yield row(self.problem.differentiate, "evaluation")
        rigid = {"function": lambda p: self.bodies["rod"], "jacobian": lambda p: []}
        yield row(ffr.ParametricBody, "function jacobian", rigid)
        none = np.zeros((2, 0))
        marker = {"position": (0.0, 0.0), "displacement": none, "rotation": []}
        yield row(ffr.BodyMarker, "", marker, **dict.fromkeys(marker, ARRAY))
        variables = (*ARRAY, np.ones(2), np.full(self.design.size, math.nan))
        even = {"variables": self.design.even(0.5)}
        yield row(self.design.density, "", even, variables=variables)

    def of_files(self) -> Rows:
        """What a run leaves, and finds again."""
        row, place, full = self.row, self.folder, self.full

        def file(
            call: Callable[..., Any], name: str, names: str, given: Any = None, **refused: Any
        ) -> Row:
            return row(call, f"path {names}", {"path": place / name, **(given or {})}, **refused)

        psi = {"summary": {"psi": 1.0}}
        summary = (*MAPPING[:3], ["a"], {"psi": 1j})
        yield file(ffr.write_summary, "summary.json", "comm", psi, summary=summary)
        (place / "run.csv").write_text("psi\n1\n")
        yield file(ffr.read_history, "run.csv", "")
        write_rod(place / "rod.msh")
        yield file(ffr.Domain.from_gmsh, "rod.msh", "comm")
        self.bodies["rod"].save(place / "rod.npz")
        yield file(ffr.VolumeIntegrals.load, "rod.npz", "", path=(*PATH, "rod"))
        fields = (1.0, None, "x", [full], {"x": full[1:]}, {"x": "1"}, {1: full})
        by_name = {"fields": {"x": full}}
        yield file(ffr.write_fields, "fields.xdmf", "domain", by_name, fields=fields)
        x = (None, "x", full[1:], 2.0 * full)
        yield file(ffr.write_density, "density.xdmf", "domain", {"x": full}, x=x)
        wrong = {"x": (*x, {}), "path": (*PATH, "design.xyz")}
        yield file(plotting.plot_design, "design.png", "domain", {"x": full}, **wrong)

    def of_pictures(self) -> Rows:
        columns = {"iteration": [0.0, 1.0], "psi": [2.0, 1.0]}
        no_columns = ({}, {"psi": 1.0}, {"psi": ["1"]}, {"psi": [1.0, 2.0], "volume": [1.0]})
        full, scale = self.full, some(NOT_NEGATIVE)
        cells = (*ARRAY, full[1:])

        def row(call: Callable[..., Any], names: str, given: Any = None, **refused: Any) -> Row:
            no_path = (None, 1, ["a.png"], "picture.xyz")
            return self.row(call, f"path title {names}", given, **{"path": no_path, **refused})

        yield row(
            plotting.plot_history,
            "comm",
            {"history": columns},
            history=(*MAPPING[:2], *no_columns),
            psi_solid=some(POSITIVE),
            volume_bound=(0.0, "1", math.nan),
        )
        curves = ({"a": 1.0}, {"a": {"b": 1.0}}, {"a": {"b": ([0.0], [0.0, 1.0])}}, {"a": {1: 1}})
        panels = {"panels": {"psi": {"run": ([0.0, 1.0], [1.0, 2.0])}}}
        wrong = (*MAPPING, {}, *curves)
        yield row(plotting.plot_curves, "comm xlabel markers", panels, panels=wrong)
        shown, solid = {"stress": full}, (cells[0], *cells[2:], full < 0.0)
        yield row(plotting.plot_stress, "domain", shown, stress=cells, solid=solid)
        chosen = {"selections": {"a": (full, full > 0.5)}}
        selections = (*MAPPING, {}, {"a": 1.0}, {"a": (full,)})
        yield row(plotting.plot_gradient_elements, "domain", chosen, selections=selections)
        yield row(plotting.plot_modes, "body reduced")
        fields = (*MAPPING, {"x": full[1:]}, {"x": "1"})
        yield self.row(plotting.mesh_grid, "domain", {"fields": {"x": full}}, fields=fields)
        colors = (*TEXT[:3], "red")
        yield row(plotting.plot_scene, "problem evaluation", time=(*scale, 1.0), color=colors)
        film = {"path": self.folder / "motion.gif", "frames": 2}
        yield row(
            plotting.animate_motion,
            "problem evaluation frames_per_second",
            film,
            frames=(*COUNT, 1),
        )


#: What messages call arguments that they do not name as they are.
CALLED = {
    **dict.fromkeys(("point", "line", "relative_to", "marker", "a", "b"), "marker"),
    **dict.fromkeys(("S", "G", "N", "position", "displacement", "rotation"), "integrals of a body"),
    **dict.fromkeys(("minimum_member", "minimum_gap"), "minimum size"),
    **dict.fromkeys(("state", "fields"), "'x'"),
    **dict.fromkeys(("bodies", "modes", "name"), "bod(y|ies)"),
    **{"markers": "marker|inertia", "center": "inertia", "interfaces": "interface"},
    **{"centers": "center", "start": "interface|design", "end": "interface", "x": "density|design"},
    **{"q": "coordinates", "cells": "elements|flexible body", "knots": "knot"},
    **{"variables": "coefficients", "combine": "weights", "rows": "row", "images": "image"},
    **{"mirrors": "mirror", "terms": "term|weight of", "other": "objective", "upper": "bound"},
    **{"load_cases": "load cases?", "path": "end (in|the name in)", "panels": "curves"},
}


def answer(call: Callable[[], Any], name: str) -> str:
    """What is wrong with the way in which a call is refused; nothing where it is in words.

    The argument is named, as it is or by the word for it.
    """
    try:
        computed = call()
    except (TypeError, ValueError) as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        line = linecache.getline(frame.filename, frame.lineno or 0).strip()
        if PACKAGE in Path(frame.filename).parents and line.startswith("raise"):
            words = rf"\b{name}\b|{name.replace('_', ' ')}|{CALLED.get(name, name)}"
            return "" if re.search(words, str(error)) else f"does not name it: {error}"
        return f"a trace from the inside: {type(error).__name__}: {error} ({line})"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return f"taken: {computed!r:.60}"


@pytest.mark.slow
def test_arguments_are_refused_in_words(tmp_path: Path) -> None:
    scene, faults, count = Scene(tmp_path), [], 0
    for call, works, refused in scene.calls():
        call(**works)  # else it is not the value that is refused
        for name, values in refused.items():
            for value in values:
                count += 1
                fault = answer(lambda: call(**{**works, name: value}), name)  # noqa: B023
                if fault:
                    where = getattr(call, "__qualname__", call)
                    faults.append(f"{where}({name}={value!r:.40}): {fault:.160}")
    assert count > 1000
    assert not faults, f"{len(faults)} of {count}:\n" + "\n".join(faults)


class Name(enum.StrEnum):
    ROD = "rod"
    LEFT = "left"


def test_what_says_the_same_is_taken(tmp_path: Path) -> None:
    """Arrays, sets and views in place of lists, other kinds of texts, a path in two forms."""
    fields = {"gravity": np.array([0.0, -9.81]), "ground_acceleration": np.zeros(2)}
    joints = {"pin": ffr.Revolute(PIN, CRANK), "line": ffr.PointOnLine(END, ffr.Ground())}
    forces = {ffr.Force(marker) for marker in ((Name.ROD, Name.LEFT), ("rod", np.str_("left")))}
    mechanism = in_mechanism(joints=joints.values(), forces=forces, **fields)
    lists = {"joints": list(joints.values()), "forces": [ffr.Force(PIN)]}
    assert mechanism == in_mechanism(**lists, gravity=(0.0, -9.81))
    scene = Scene(tmp_path)
    assert scene.problem.value({"rod": scene.full}).psi == scene.evaluation.psi
    instants = scene.steps.instants
    both = ffr.PathTracking("rod", "right", np.zeros((instants, 2)))
    bounds = {ffr.Constraint(ffr.Mass("rod"), 9.0)}
    for path in ((np.zeros(instants), 0.0), (0.0, [0.0] * instants)):
        objective = ffr.PathTracking("rod", "right", path)
        problem = ffr.MechanicalProblem(mechanism, scene.steps, objective, bounds)
        returned = problem.value(scene.bodies).psi
    trajectory = ffr.simulate(mechanism, scene.bodies, scene.steps)
    assert returned == both.evaluate(ffr.Response(trajectory, scene.bodies))
    body = ffr.FlexibleBody(
        scene.rod, STEEL, frame=ffr.TangentFrame("left"), modes=0, stiffening={"omega2", "alpha"}
    )
    assert body.stiffening is not None and set(body.stiffening.loads) == {"omega2", "alpha"}


def test_functions_of_one_number_are_refused_with_what_to_write(tmp_path: Path) -> None:
    swing = ffr.Motion(math.sin, math.cos, lambda t: -math.sin(t), "swing")
    with pytest.raises(ValueError, match=r"motion 'swing': the value .*numpy\.sin instead of math"):
        swing.check(0.0, 1.0)
    scene = Scene(tmp_path)
    step = [ffr.Force(END, lambda t: 1.0 if t < 0.05 else 0.0, name="push")]
    mechanism = ffr.Mechanism(scene.mechanism.placements, scene.mechanism.joints, forces=step)
    with pytest.raises(ValueError, match=r"force 'push': x .*numpy\.where instead of if"):
        ffr.simulate(mechanism, scene.bodies, scene.steps)


@pytest.mark.mpi
def test_masks_and_numbers_choose_the_same_cells_and_facets(comm: MPI.Intracomm) -> None:
    rod = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(8, 2))
    facets, cells = rod.interfaces["left"].facets, np.flatnonzero(~rod.design_cells)
    index_map = rod.mesh.topology.index_map(1)
    of_facets = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=bool)
    of_facets[facets] = True
    by_numbers = ffr.Domain(rod.mesh, {"left": facets}, cells)
    by_masks = ffr.Domain(rod.mesh, {"left": of_facets}, ~rod.design_cells)
    for returned in (by_numbers, by_masks):
        np.testing.assert_array_equal(returned.interfaces["left"].facets, facets)
        np.testing.assert_array_equal(returned.design_cells, rod.design_cells)


@pytest.mark.mpi
def test_what_is_wrong_on_one_rank_is_refused_on_all(comm: MPI.Intracomm) -> None:
    rod = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(8, 2))
    is_last = comm.rank == comm.size - 1
    wrong = np.array([10**9] if is_last else [], dtype=np.int32)
    with pytest.raises(ValueError, match="facet 1000000000 does not exist"):
        ffr.Domain(rod.mesh, {"left": wrong})
    ones = np.ones(rod.n_cells)
    bad: list[tuple[Any, type[Exception], str]] = [
        (["1"] * rod.n_cells, TypeError, "density must hold real numbers"),
        (ones[1:], ValueError, "density: has shape"),
        (np.nan * ones, ValueError, "are NaN or infinite"),
        (2.0 * ones, ValueError, r"leave \[0, 1\]"),
    ]
    for density, kind, message in bad:
        with pytest.raises(kind, match=message):
            rod.check_density(density if is_last else ones)


def test_slips_in_the_names_of_options() -> None:
    problem = Copy(COMM, lambda p: np.full(len(p), 0.5))
    design = ffr.DensityDesign(problem.domain)
    full = design.even(1.0)
    result = ffr.Result({}, {"plate": full}, None, {}, "", {"plate": design}, None)  # type: ignore[arg-type]
    part = ffr.Part.of(design, full)
    run = partial(ffr.optimize, problem, design, progress=False)
    tolerance = {"tolerence": 1.0}, "has no option 'tolerence'; did you mean 'tolerance'"
    calls: list[tuple[Callable[..., object], dict[str, Any], str]] = [
        (run, {"iteration": 4}, "optimize has no option 'iteration'; did you mean 'iterations'?"),
        (run, {"calback": print}, "did you mean 'callback'?"),
        (run, {"mov": 0.1, "optimizer": ffr.MMA()}, "did you mean 'move'?"),
        (run, {"xyz": 0.1}, "optimize has no option 'xyz'; there are problem, design, start"),
        (result.verify, *tolerance),
        (partial(result.finish, "folder"), *tolerance),
        (partial(part.verify, None, None), *tolerance),
        (partial(ffr.Part.of, design, full), *tolerance),
        (partial(part.write, "folder"), {"units": "mm"}, "no option 'units'; did you mean 'unit'"),
    ]
    for call, options, message in calls:
        with pytest.raises(TypeError, match=re.escape(message)):
            call(**options)
    assert not Path("folder").exists()
