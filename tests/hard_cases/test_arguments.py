# SPDX-License-Identifier: MIT
"""Arguments of a wrong kind, or out of range: refused at once and in words, never read as others.

Each row of the table is an argument of a public name and a set of values that a person could
plausibly give for it. Refused in words is what ends in a `raise` of the package: not in a trace
from the inside, and not in a result.
"""

from __future__ import annotations

import enum
import linecache
import math
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.io import load_checkpoint, save_checkpoint, write_history
from dolfinx_ffr.plotting import plot_design

PACKAGE = Path(ffr.__file__).parent

#: What no argument of some kind takes.
NO_NUMBER = ("1.0", None, True, 1j, [1.0], {}, np.sin)
ENDLESS = (math.nan, math.inf)
HUGE = 10**5000  # neither a float nor shown in digits
NUMBER = (*NO_NUMBER, *ENDLESS, HUGE)
POSITIVE = (*NUMBER, 0.0, -1.0)
NOT_NEGATIVE = (*NUMBER, -1.0)
SHARE = (*NUMBER, -0.1, 1.1)
COUNT = (*NUMBER, -1, 2.5, HUGE)
WHOLE_FROM_1 = (*COUNT, 0)
VECTOR = ("ab", None, 1.0, (1.0,), (1.0,) * 4, (1.0, math.nan), ("1", "0"), (1.0, 1j), np.sin)
PAIR = (*VECTOR, (1.0, 0.0, 0.0))
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

PIN, END = ("rod", "left"), ("rod", "right")
CRANK = ffr.Moving.circle((0.0, 0.0), 0.1, ffr.Motion.smooth_step(1.0, 0.1))
STEEL = ffr.PlaneStress(2.1e11, 0.3, 7850.0, 0.01)
MARKERS = {"left": (0.0, 0.0), "right": (0.4, 0.0)}


def in_mechanism(**parts: Any) -> ffr.Mechanism:
    return ffr.Mechanism({"rod": ffr.Placement()}, **parts)


def joint(kind: type) -> Callable[..., ffr.Mechanism]:
    """A mechanism with one joint, whose numbers are judged with it."""
    return lambda **arguments: in_mechanism(joints=[kind(**arguments)])


def force(kind: type) -> Callable[..., ffr.Mechanism]:
    return lambda **arguments: in_mechanism(forces=[kind(**arguments)])


class Scene:
    """What the valid calls take."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.rod = ffr.Domain.rectangle(MPI.COMM_SELF, 0.4, 0.04, elements=(20, 3))
        self.body = ffr.FlexibleBody(
            self.rod, STEEL, frame=ffr.ChordFrame("left", "right"), modes=2
        )
        self.mechanism = ffr.Mechanism(
            {"rod": ffr.Placement((0.1, 0.0))},
            [ffr.Revolute(PIN, CRANK), ffr.PointOnLine(END, ffr.Ground())],
        )
        self.steps = ffr.GeneralizedAlpha(0.1, 40)
        self.problem = ffr.Problem(
            {"rod": self.body}, self.mechanism, self.steps, ffr.IntegralCompliance()
        )
        self.levelset = ffr.LevelSet(self.rod)
        self.design = ffr.DensityDesign(self.rod)
        self.full = np.ones(self.rod.n_cells)
        self.bodies = {"rod": ffr.VolumeIntegrals.rigid(1.0, (0.2, 0.0), 0.02, MARKERS)}
        self.evaluation = self.problem.value(self.full)

    def calls(self) -> Iterator[tuple[Callable[..., Any], dict[str, Any], dict[str, Any]]]:
        """A call, arguments with which it works, and what each of them must refuse."""
        yield from self.of_mechanisms()
        yield from self.of_bodies()
        yield from self.of_objectives()
        yield from self.of_designs()
        yield from self.of_parts()
        yield from self.of_files()
        yield from self.of_runs()
        yield from self.of_pictures()

    def of_mechanisms(self) -> Iterator[tuple[Callable[..., Any], dict[str, Any], dict[str, Any]]]:
        held = ffr.Motion.constant(0.1)
        yield (
            ffr.Motion,
            {"value": np.sin, "velocity": np.cos, "acceleration": lambda t: -np.sin(t)},
            {
                **dict.fromkeys(("value", "velocity", "acceleration"), FUNCTION),
                "jumps": (math.nan, (math.nan,), ("1",), 1.0),
                "name": TEXT,
            },
        )
        yield ffr.Motion.constant, {"value": 1.0}, {"value": NUMBER}
        yield ffr.Motion.polynomial, {"coefficients": [1.0]}, {"coefficients": (*ARRAY, (), 1.0)}
        yield (
            ffr.Motion.smooth_step,
            {"distance": 1.0, "duration": 1.0, "start": 0.0},
            {"distance": NUMBER, "duration": POSITIVE, "start": NUMBER},
        )
        yield ffr.Ground, {}, {"position": VECTOR, "angle": NUMBER, "name": TEXT}
        yield ffr.Moving, {"x": held, "y": held}, dict.fromkeys(("x", "y", "angle"), MOTION)
        yield (
            ffr.Moving.circle,
            {"center": (0, 0), "radius": 0.1, "angle": held},
            {"center": VECTOR, "radius": NUMBER, "angle": MOTION},
        )
        ends = {"a": PIN, "b": ffr.Ground((1.0, 0.0))}
        markers = {"a": MARKER, "b": MARKER, "name": TEXT}
        yield joint(ffr.Revolute), ends, markers
        yield joint(ffr.Weld), ends, {**markers, "angle": ("1", True, *ENDLESS, held)}
        yield joint(ffr.Translational), ends, {**markers, "direction": (*VECTOR, (0.0, 0.0))}
        yield joint(ffr.Gear), {**ends, "ratio": 2.0}, {**markers, "ratio": (*NUMBER, 0.0)}
        yield (
            joint(ffr.Distance),
            ends,
            {**markers, "length": ("1", True, 1j, *ENDLESS, 0.0, -1.0, np.sin)},
        )
        line = {"point": PIN, "line": ffr.Ground()}
        across = {"point": MARKER, "line": MARKER, "direction": (*VECTOR, (0.0, 0.0))}
        yield joint(ffr.PointOnLine), line, across
        yield joint(ffr.LinearDrive), {**line, "motion": held}, {**across, "motion": MOTION}
        driven = {"marker": PIN, "motion": held}
        drive = {"marker": MARKER, "motion": MOTION}
        yield joint(ffr.PrescribedAngle), driven, {**drive, "relative_to": MARKER}
        along = {**driven, "axis": "x"}
        yield joint(ffr.PrescribedPosition), along, {**drive, "axis": (*TEXT, "w", 0)}
        yield (
            force(ffr.Force),
            {"marker": PIN},
            {"marker": (*MARKER, ffr.Ground()), "x": SIGNAL, "y": SIGNAL, "follower": FLAG},
        )
        yield force(ffr.Torque), {"marker": PIN}, {"marker": MARKER, "moment": SIGNAL}
        spring = {**ends, "stiffness": 1.0}
        strength = {**markers, "stiffness": NOT_NEGATIVE, "damping": NOT_NEGATIVE}
        signal = tuple(value for value in SIGNAL if value is not None)
        yield force(ffr.SpringDamper), spring, {**strength, "length": (*signal, -1.0)}
        yield force(ffr.TorsionalSpringDamper), spring, {**strength, "angle": signal}
        yield (
            lambda **given: ffr.Mechanism({"rod": ffr.Placement(**given)}),
            {},
            {"position": VECTOR, "angle": NUMBER, "velocity": VECTOR, "angular_velocity": NUMBER},
        )
        yield (
            lambda **given: in_mechanism(point_masses=[ffr.PointMass(**given)]),
            {"marker": PIN, "mass": 1.0},
            {"marker": MARKER, "mass": POSITIVE},
        )
        yield (
            lambda **given: in_mechanism(damping={"rod": ffr.RayleighDamping(**given)}),
            {},
            {"alpha": NOT_NEGATIVE, "beta": NOT_NEGATIVE},
        )
        fields = (*VECTOR[:5], ("0", 0.0), (None, 0.0), (math.nan, 0.0))
        yield (
            ffr.Mechanism,
            {"placements": {"rod": ffr.Placement()}},
            {
                "placements": (*MAPPING, {"rod": (0.0, 0.0)}, {"rod": None}),
                "joints": (*LIST, ffr.Revolute(**ends), [PIN], [None], [ffr.Force(PIN)]),
                "forces": (*LIST, ffr.Force(PIN), [1.0], [ffr.Revolute(**ends)]),
                "point_masses": (*LIST, ffr.PointMass(PIN, 1.0), [1.0]),
                "gravity": fields,
                "ground_acceleration": fields,
                "damping": (*MAPPING, ffr.RayleighDamping(), {"rod": 0.1}),
                "start": (None, "rest", ffr.StaticEquilibrium, ffr.Placement()),
                "jumps": (*ARRAY, 1.0, (math.nan,)),
            },
        )
        yield (
            ffr.Assembled,
            {},
            dict.fromkeys(
                ("elastic", "elastic_velocity"), (*MAPPING, {"rod": "a"}, {"rod": [math.nan]})
            ),
        )
        yield (
            ffr.GeneralizedAlpha,
            {"end_time": 1.0, "steps": 2},
            {"end_time": POSITIVE, "steps": WHOLE_FROM_1, "spectral_radius": SHARE},
        )
        optional = tuple(value for value in POSITIVE if value is not None)
        yield (
            ffr.RadauIIA,
            {"end_time": 1.0},
            {
                "end_time": POSITIVE,
                "tolerance": (*POSITIVE, 1.0),
                "first_step": optional,
                "largest_step": optional,
                "steps": ("2", 0, -1, 2.5, True, (0.0, 2.0), (0.0, "1"), (1.0, 0.0), math.nan),
            },
        )
        yield (
            ffr.simulate,
            {"mechanism": self.mechanism, "bodies": self.bodies, "integrator": self.steps},
            {
                "mechanism": (None, 1.0, [], ffr.Mechanism),
                "bodies": (*MAPPING, {"rod": None}, {"rod": 1.0}, {}),
                "integrator": (None, 1.0, 100, "radau", ffr.GeneralizedAlpha),
                "end_time": (1.0,),
                "tolerance": (*optional, 1.0),
            },
        )

    def of_bodies(self) -> Iterator[tuple[Callable[..., Any], dict[str, Any], dict[str, Any]]]:
        comm = MPI.COMM_SELF
        numbers = {"young": 1.0, "poisson": 0.3, "density": 1.0}
        solid = {"young": POSITIVE, "poisson": (*NUMBER, 0.5, -1.0), "density": POSITIVE}
        for material in (ffr.PlaneStress, ffr.PlaneStrain):
            yield material, numbers, {**solid, "thickness": POSITIVE}
        interval = (*SHARE, 0.0, 1.0)
        yield ffr.SIMP, {}, {"exponent": (*NUMBER, 0.5), "floor": interval, "mass": (None, *LAW)}
        yield ffr.RAMP, {}, {"penalty": NOT_NEGATIVE, "floor": interval, "mass": (None, *LAW)}
        yield ffr.SuppressedVoidMass, {}, {"threshold": interval}
        yield (
            ffr.Domain.rectangle,
            {"comm": comm, "length": 0.4, "height": 0.04, "elements": (4, 2), "solid_columns": 1},
            {
                "comm": (None, 1, "world", MPI),
                "length": POSITIVE,
                "height": POSITIVE,
                "elements": (8, "ab", None, (8,), (8, 2, 2), (0, 2), (8, -1), (8.5, 2), (8, "2")),
                "cell": (*TEXT, "hexagon"),
                "order": WHOLE_FROM_1,
                "solid_columns": (*COUNT, 2),
            },
        )
        cells = self.rod.n_cells
        facets = self.rod.mesh.topology.index_map(1).size_local
        ends = {"left": lambda x: x[0] < 1e-9}
        wrong = (
            *(1.0, None, "left", [0.5], ["0"], [[0, 1]]),
            *(lambda x: x[0], lambda x: True, lambda x: math.sin(x[0]) > 0.5),
        )
        yield (
            ffr.Domain,
            {"domain": self.rod.mesh, "interfaces": ends},
            {
                "domain": (None, self.rod, "rod.msh", comm),
                "interfaces": (
                    *(*MAPPING, {}, *({"left": value} for value in wrong)),
                    *({"left": [number]} for number in (-1, facets, 10**9, -(10**9))),
                    *({"left": np.ones(n, dtype=bool)} for n in (facets - 1, facets + 1, cells)),
                ),
                "solid": (
                    *(value for value in wrong if value is not None),
                    *([-1], [cells], [10**9], [True] * (cells - 1), np.ones((cells, 1), bool)),
                ),
                "order": WHOLE_FROM_1,
                "centers": (*MAPPING[:1], {"no": (0.0, 0.0)}, *({"left": p} for p in PAIR)),
            },
        )
        yield ffr.LinearMass, {}, {}
        frames = (None, 0.0, "chord", ffr.ChordFrame, np.sin)
        yield (
            ffr.FlexibleBody,
            {"domain": self.rod, "material": STEEL, "frame": ffr.TangentFrame("left"), "modes": 1},
            {
                "domain": (None, "rod", self.rod.mesh, 1.0),
                "material": (None, "steel", 2.1e11, ffr.PlaneStress, ffr.SIMP()),
                "frame": (*frames, ffr.TangentFrame("no"), ffr.ChordFrame("left", "left")),
                "modes": (*COUNT, 10**6),
                "interpolation": LAW,
                "markers": (*MAPPING[:1], *MAPPING[2:], {"tip": 1.0}, {"left": (0.2, 0.0)}),
                "tolerance": (*POSITIVE, 1.0, 1e-20),
                "stiffening": (1.0, None, "omega2", ["wind"], [1], np.sin),
            },
        )
        yield (
            lambda **given: ffr.FlexibleBody(self.rod, STEEL, frame=ffr.ChordFrame(**given)),
            {"start": "left", "end": "right"},
            {"start": (*TEXT, "no"), "end": (*TEXT, "no", "left")},
        )
        yield (
            ffr.VolumeIntegrals.rigid,
            {"mass": 1.0, "inertia": 1.0},
            {
                "mass": POSITIVE,
                "center": [center for center in PAIR if center is not None],
                "inertia": POSITIVE,
                "markers": (*MAPPING[:1], *MAPPING[2:], *({"pin": pair} for pair in PAIR)),
            },
        )
        moments = {"mass": 1.0, "S": np.zeros((1, 2)), "G": np.eye(1), "N": np.zeros((1, 1))}
        matrix = (*ARRAY, 1.0, np.ones(3), [[math.nan]])
        yield (
            ffr.VolumeIntegrals.from_arrays,
            moments,
            {"mass": POSITIVE, "S": matrix, "G": matrix, "N": matrix},
        )
        densities = (*ARRAY, 0.5, [0.5], self.full[1:], 1.5 * self.full, -self.full, 0 * self.full)
        densities = (
            *densities,
            math.nan * self.full,
            1j * self.full,
            ["1"] * cells,
            [None] * cells,
        )
        by_name = ({"arm": self.full}, {"rod": "a"}, {})
        yield self.problem.value, {"x": self.full}, {"x": (*densities, *by_name)}
        yield self.body.reduce, {"x": self.full}, {"x": densities}
        yield self.body.volume, {"x": self.full}, {"x": densities[:-1][: len(ARRAY) + 5]}

    def of_objectives(self) -> Iterator[tuple[Callable[..., Any], dict[str, Any], dict[str, Any]]]:
        weights = (1.0, "rod", ["rod"], {"rod": "1"}, {"rod": math.nan}, {1: 1.0})
        compliance = {"bodies": ("rod", [], 1.0, [1], np.sin), "weights": weights}
        yield ffr.IntegralCompliance, {}, compliance
        yield ffr.PeakCompliance, {}, {**compliance, "power": (*NUMBER, 0.5)}
        yield ffr.Mass, {"body": "rod"}, {"body": TEXT}
        yield ffr.Volume, {"body": "rod"}, {"body": TEXT}
        yield (
            ffr.Frequency,
            {"body": "rod"},
            {"body": TEXT, "number": WHOLE_FROM_1, "cluster": WHOLE_FROM_1, "free": FLAG},
        )
        yield (
            ffr.JointForce,
            {"joint": "pin"},
            {"joint": TEXT, "power": (*NUMBER, 1.0), "moment": FLAG, "window": WINDOW},
        )
        marker = {"body": "rod", "marker": "left"}
        for objective in (ffr.MarkerAcceleration, ffr.MarkerVelocity):
            yield (objective, marker, {"body": TEXT, "marker": TEXT, "window": WINDOW})
        yield (
            ffr.PathTracking,
            {**marker, "path": (0.0, np.sin)},
            {
                **{"body": TEXT, "marker": TEXT, "window": WINDOW},
                "path": (*ARRAY, (0.0, "1"), (np.sin, *[0.0] * 3), (None, 0.0), (math.nan, 0.0)),
                "weight": ("1", ["1"], [1j]),
            },
        )
        mass = ffr.Mass("rod")
        terms = (1.0, [], [1.0], [mass], [("1", mass)], [(1.0, "mass")], [(math.nan, mass)], None)
        yield ffr.Sum, {"terms": [(1.0, mass)]}, {"terms": terms}
        yield lambda weight: weight * mass, {"weight": 2.0}, {"weight": ("2", None, *ENDLESS)}
        yield lambda other: mass + other, {"other": mass}, {"other": OBJECTIVE}
        yield lambda other: mass - other, {"other": mass}, {"other": OBJECTIVE}
        yield (
            ffr.Constraint,
            {"objective": mass, "upper": 1.0},
            {"objective": OBJECTIVE, "upper": (*NUMBER, 0.0), "lower": (1.0,), "name": TEXT},
        )
        chain = {
            "mechanism": (None, 1.0, [], ffr.Mechanism),
            "integrator": (None, 1.0, 100, "radau", ffr.GeneralizedAlpha),
            "objective": OBJECTIVE,
            "constraints": (*LIST, ffr.Constraint(mass, 1.0), [mass], [1.0]),
        }
        given = {
            "mechanism": self.mechanism,
            "integrator": self.steps,
            "objective": ffr.IntegralCompliance(),
        }
        yield ffr.MechanicalProblem, given, chain
        bodies = (*MAPPING, {}, {"rod": None}, {"rod": self.rod}, self.body, self.bodies)
        yield ffr.Problem, {**given, "bodies": {"rod": self.body}}, {**chain, "bodies": bodies}
        weights = (*MAPPING[:1], *MAPPING[2:], {}, {"a": 0.0}, {"a": -1.0}, {"a": "1"}, {"a": None})
        yield ffr.WeightedSum, {}, {"weights": weights}
        yield ffr.WorstCase, {}, {"weights": weights}
        yield ffr.PowerMean, {}, {"weights": weights, "p": (*NUMBER, 0.5)}
        motion = ffr.MechanicalProblem(**given)
        yield (
            ffr.Problem.of_motions,
            {"bodies": {"rod": self.body}, "motions": {"a": motion, "b": motion}},
            {
                "bodies": bodies,
                "motions": (*MAPPING, {}, {"a": None}, {"a": self.problem}, motion, [motion]),
                "combine": (1.0, "sum", ffr.WeightedSum, np.sum, ffr.WorstCase({"a": 1.0})),
            },
        )
        yield self.problem.alone, {"motion": "motion"}, {"motion": (*TEXT, "fast")}
        yield self.evaluation.alone, {"motion": "motion"}, {"motion": (*TEXT, "fast")}

    def of_designs(self) -> Iterator[tuple[Callable[..., Any], dict[str, Any], dict[str, Any]]]:
        no_domain = (None, "rod", self.rod.mesh, self.body)
        optional = tuple(value for value in POSITIVE if value is not None)
        yield ffr.Wendland, {"radius": 1.0}, {"radius": POSITIVE}
        for kernel in (ffr.Multiquadric, ffr.Gaussian, ffr.ExponentialSpline):
            yield kernel, {"length": 1.0}, {"length": POSITIVE}
        knots = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        kernels = (1.0, "gaussian", ffr.Wendland, np.sin)
        yield (
            ffr.ScatteredInterpolation,
            {"points": knots, "kernel": ffr.Wendland(3.0)},
            {
                "points": (*ARRAY, 1.0, [], knots * math.nan),
                "kernel": (None, *kernels),
                "degree": ("1", 1.5, -2, True, 5),
            },
        )
        yield (
            ffr.LevelSet,
            {"domain": self.rod},
            {
                "domain": no_domain,
                "knots": (*(v for v in ARRAY if v is not None), 1.0, [], [[0.0, math.nan]] * 3),
                "spacing": (*optional, 1.0),
                "minimum_member": (*optional, 1e-6),
                "minimum_gap": (*optional, 1e-6),
                "mirrors": (1.0, [1.0], "axis", [ffr.Mirror((0.0, 0.01), (1.0, 0.0))]),
                "quadrature": [value for value in WHOLE_FROM_1 if value is not None],
            },
        )
        yield (
            self.levelset.with_holes,
            {"columns": 1, "rows": 1, "radius": 0.01},
            {
                **{"columns": WHOLE_FROM_1, "rows": WHOLE_FROM_1, "radius": NOT_NEGATIVE},
                "margin": tuple(value for value in NUMBER if value is not None),
            },
        )
        no_vector = (*ARRAY, 1.0, np.ones(2), np.full(len(self.levelset.knots), math.nan))
        flat = np.ones(len(self.levelset.knots))
        for method in (self.levelset.density, self.levelset.level, self.levelset.penalty):
            yield method, {"variables": flat}, {"variables": no_vector}
        yield self.levelset.distance, {"variables": flat}, {"variables": no_vector}
        yield self.levelset.from_distance, {"distance": flat}, {"distance": no_vector}
        yield self.levelset.with_sharpness, {"sharpness": 8.0}, {"sharpness": POSITIVE}
        for part in (self.levelset, self.design):
            yield part.at, {"progress": 0.5}, {"progress": SHARE}
        yield (
            ffr.Mirror,
            {"point": (0.0, 0.0), "direction": (1.0, 0.0)},
            {"point": PAIR, "direction": (*PAIR, (0.0, 0.0))},
        )
        yield (
            ffr.mirror_lines,
            {"domain": self.rod},
            {
                "domain": no_domain,
                "gradient": (*(v for v in ARRAY if v is not None), 1.0, np.ones(2)),
                "tolerance": NOT_NEGATIVE,
            },
        )
        yield (
            ffr.Evolution,
            {"levelset": self.levelset, "volume": 0.7},
            {
                "levelset": (None, "phi", self.rod),
                "volume": (*SHARE, 0.0, 0.01),
                "band": POSITIVE,
            },
        )
        yield (
            ffr.VelocityExtension,
            {"levelset": self.levelset},
            {"levelset": (None, self.rod), "radius": optional},
        )
        yield ffr.VolumeBisection, {"bound": 0.5}, {"bound": POSITIVE, "tolerance": (*SHARE, 1.0)}
        negative = tuple(value for value in NOT_NEGATIVE if value is not None)
        yield (
            ffr.DensityDesign,
            {"domain": self.rod},
            {"domain": no_domain, "radius": negative, "eta": (*SHARE, 0.0, 1.0)},
        )
        yield self.design.even, {"value": 0.5}, {"value": (*SHARE, 2.0)}
        yield (
            ffr.DensityFilter,
            {"domain": self.rod, "radius": 0.1},
            {"domain": no_domain, "radius": NOT_NEGATIVE},
        )
        yield ffr.HeavisideProjection, {"beta": 1.0}, {"beta": POSITIVE, "eta": (*SHARE, 0.0, 1.0)}
        yield (
            ffr.LevelSetEvolution,
            {},
            {
                **{"evolution": (1.0, "fast", {"rod": 1.0}), "sharpness": STAGES, "step": POSITIVE},
                **{"tolerance": NOT_NEGATIVE, "reinitialize_every": COUNT},
            },
        )
        yield (
            ffr.MMA,
            {},
            {
                "move": (*SHARE, 0.0),
                "tolerance": NOT_NEGATIVE,
                "length": tuple(value for value in WHOLE_FROM_1 if value is not None),
            },
        )
        yield (
            ffr.optimize,
            {
                **{"problem": self.problem, "design": self.levelset, "start": flat},
                **{"iterations": 0, "progress": False, "volume": 1.0},
            },
            {
                "problem": (None, 1.0, self.body, ffr.Problem),
                "design": (None, "level set", self.rod, ffr.LevelSet, ffr.DensityDesign(self.rod)),
                "start": (*(v for v in no_vector if v is not None), {"arm": flat}),
                "optimizer": (1.0, "mma", ffr.MMA, np.sin),
                "volume": (*SHARE, 0.0, 0.01, {"arm": 0.5}),
                "gradient": (1.0, "adjoint", ffr.ExactAdjoint, np.sin),
                "iterations": COUNT,
                "output": (1.0, True, ["results"]),
                "resume": FLAG,
                "progress": FLAG,
                "callback": (1.0, "print", [print]),
            },
        )
        nothing = tuple(value for value in POSITIVE if value is not None)
        yield (
            ffr.GradientElements,
            {"grid": 0.1},
            {"grid": nothing, "band": nothing, "share": (*nothing, 1.1)},
        )
        yield (
            ffr.ApproximateGradient,
            {},
            {
                **{"elements": (None, 0.3, "grid"), "kernel": (1.0, "gaussian")},
                **{"degree": ("1", 1.5, -2, True), "tolerance": nothing, "band": nothing},
                **{"largest_share": (*SHARE, 0.0), "compare_every": COUNT},
                **{"solver": (*TEXT, "lu"), "batch": WHOLE_FROM_1},
            },
        )
        yield ffr.ElementByElement, {}, {"solver": (*TEXT, "lu"), "batch": WHOLE_FROM_1}
        yield (
            ffr.von_mises,
            {"body": self.body, "reduced": self.evaluation.bodies["rod"], "q": np.zeros(5)},
            {
                "body": (None, "rod", self.rod),
                "reduced": (None, self.evaluation),
                "q": (*ARRAY, np.zeros(2), np.full(5, math.nan)),
                "relaxation": NOT_NEGATIVE,
                "void": SHARE,
            },
        )
        yield (
            ffr.worst_stress,
            {"body": self.body, "evaluation": self.evaluation, "name": "rod"},
            {"body": (None, "rod"), "evaluation": (None, self.full), "name": (*TEXT[:2], "arm")},
        )
        yield (
            ffr.modes_below,
            {"body": self.body, "frequency": 1.0},
            {"body": (None, self.rod), "frequency": NOT_NEGATIVE},
        )
        yield (
            ffr.model_report,
            {"problem": self.problem, "evaluation": self.evaluation},
            {"problem": (None, self.body), "evaluation": (None, self.full)},
        )
        for call in (ffr.mode_error, ffr.local_modes, ffr.propose_modes):
            yield (
                call,
                {"problem": self.problem, "evaluation": self.evaluation},
                {"problem": (None, self.body), "evaluation": (None, self.full)},
            )
        yield (
            ffr.propose_modes,
            {"problem": self.problem, "evaluation": self.evaluation},
            {"tolerance": POSITIVE},
        )

    def of_files(self) -> Iterator[tuple[Callable[..., Any], dict[str, Any], dict[str, Any]]]:
        comm, place, no_path = MPI.COMM_SELF, self.folder, (None, 1, 1.0, True, ["a"], np.sin)
        no_comm, no_domain = (None, 1, "world", MPI), (None, "rod", self.rod.mesh, self.body)
        fields = (1.0, None, "x", [self.full], {"x": self.full[1:]}, {"x": "1"}, {1: self.full})
        density = (None, "x", self.full[1:], 2.0 * self.full)
        (place / "history.csv").write_text("psi\n1.0\n")
        self.bodies["rod"].save(place / "rod.npz")
        yield (
            ffr.write_summary,
            {"comm": comm, "path": place / "summary.json", "summary": {"psi": 1.0}},
            {"comm": no_comm, "path": no_path, "summary": (1.0, None, "a", ["a"], {"psi": 1j})},
        )
        yield ffr.read_history, {"path": place / "history.csv"}, {"path": no_path}
        yield ffr.VolumeIntegrals.load, {"path": place / "rod.npz"}, {"path": (*no_path, "rod")}
        yield (
            ffr.write_fields,
            {"domain": self.rod, "fields": {"x": self.full}, "path": place / "fields.xdmf"},
            {"domain": no_domain, "fields": fields, "path": no_path},
        )
        yield (
            ffr.write_density,
            {"domain": self.rod, "x": self.full, "path": place / "density.xdmf"},
            {"domain": no_domain, "x": density, "path": no_path},
        )
        yield (
            plot_design,
            {"domain": self.rod, "x": self.full, "path": place / "design.png"},
            {"domain": no_domain, "x": (*density, {}), "path": (*no_path, "design.xyz")},
        )

    def of_runs(self) -> Iterator[tuple[Callable[..., Any], dict[str, Any], dict[str, Any]]]:
        """What a run leaves, and finds again."""
        comm, place, no_path = MPI.COMM_SELF, self.folder, (None, 1, 1.0, True, ["a"], np.sin)
        no_comm = (None, 1, "world", MPI)
        yield (
            write_history,
            {**{"comm": comm, "path": place / "run.csv"}, "columns": ["psi"], "rows": [{"psi": 1}]},
            {
                **{"comm": no_comm, "path": no_path, "columns": (*LIST[:4], [1.0], ["x"])},
                "rows": (*LIST[:3], [1.0], [{"x": 1.0}], [{"psi": 1.0, "x": 1.0}], [{}]),
            },
        )
        yield (
            save_checkpoint,
            {"comm": comm, "path": place / "checkpoint", "state": {"x": self.full, "n": 1}},
            {"comm": no_comm, "path": no_path, "state": (*MAPPING, {"x": self.rod}, {"x": None})},
        )
        yield (
            load_checkpoint,
            {"comm": comm, "path": place / "checkpoint"},
            {"comm": no_comm, "path": no_path},
        )

    def of_pictures(self) -> Iterator[tuple[Callable[..., Any], dict[str, Any], dict[str, Any]]]:
        place, evaluation = self.folder, self.evaluation
        no_path = (None, 1, ["a.png"], "picture.xyz")
        picture = {"path": place / "picture.png"}
        common = {"path": no_path, "title": TEXT, "comm": (None, 1, "world", MPI)}
        alone = {"path": no_path, "title": TEXT}
        columns = {"iteration": [0.0, 1.0], "psi": [2.0, 1.0]}
        no_columns = ({}, {"psi": 1.0}, {"psi": ["1"]}, {"psi": [1.0, 2.0], "volume": [1.0]})
        runs = (*MAPPING, {"a": 1.0}, *({"a": history} for history in no_columns))
        nothing = (None, 1.0, "rod", np.sin, [], {})
        cells = (*ARRAY, self.full[1:])
        yield (
            plotting.plot_history,
            {"history": columns, **picture},
            {
                **{"history": (*MAPPING[:2], *no_columns), **common},
                **{"psi_solid": POSITIVE[:1] + POSITIVE[2:], "volume_bound": (0.0, "1", math.nan)},
            },
        )
        yield (
            plotting.plot_gradient_histories,
            {"histories": {"exact": columns}, "psi_solid": 1.0, **picture},
            {"histories": runs, "psi_solid": POSITIVE, **common},
        )
        yield (
            plotting.plot_crank_motion,
            {"source": CRANK.angle, "end_time": 1.0, **picture},
            {"source": MOTION, "end_time": POSITIVE, **common},
        )
        worth = (*MAPPING, {}, {"a": {}}, {"a": {"b": 0.0}}, {"a": {"b": "1"}})
        yield (
            plotting.plot_trade_off,
            {"psi": {"a": {"slow": 1.0, "fast": 2.0}, "b": {"slow": 2.0, "fast": 1.0}}, **picture},
            {
                "psi": (*worth, {"a": {"b": 1.0}, "c": {"d": 1.0}}),
                "images": (1.0, "a", [1.0], {"c": np.ones((2, 2))}, {"a": np.ones(2)}, {"a": "x"}),
                **common,
            },
        )
        curves = ({"a": 1.0}, {"a": {"b": 1.0}}, {"a": {"b": ([0.0], [0.0, 1.0])}}, {"a": {1: 1}})
        yield (
            plotting.plot_curves,
            {"panels": {"psi": {"run": ([0.0, 1.0], [1.0, 2.0])}}, **picture},
            {
                **{"panels": (*MAPPING, {}, *curves), "xlabel": TEXT, "logarithmic": FLAG},
                **{"markers": FLAG, **common},
            },
        )
        yield (
            plotting.plot_kernel,
            {"kernel": ffr.Gaussian(0.1), "extent": 1.0, **picture},
            {"kernel": FUNCTION[:3], "extent": POSITIVE, **common},
        )
        yield (
            plotting.plot_stress,
            {"domain": self.rod, "stress": self.full, **picture},
            {"domain": nothing, "stress": cells, "solid": (cells[0], *cells[2:]), **alone},
        )
        yield (
            plotting.plot_gradient_elements,
            {"domain": self.rod, "selections": {"a": (self.full, self.full > 0.5)}, **picture},
            {
                **{"domain": nothing, **alone},
                "selections": (*MAPPING, {}, {"a": 1.0}, {"a": (self.full,)}),
            },
        )
        yield (
            plotting.plot_modes,
            {"body": self.body, "reduced": evaluation.bodies["rod"], **picture},
            {"body": nothing, "reduced": nothing, **alone},
        )
        yield (
            plotting.mesh_grid,
            {"domain": self.rod, "fields": {"x": self.full}},
            {"domain": nothing, "fields": (*MAPPING, {"x": self.full[1:]}, {"x": "1"})},
        )
        scene = {"problem": self.problem, "evaluation": evaluation}
        no_scene = {"problem": nothing, "evaluation": nothing}
        scale = tuple(value for value in NOT_NEGATIVE if value is not None)
        yield (
            plotting.plot_scene,
            {**scene, **picture},
            {
                **{**no_scene, **alone, "time": (*scale, 1.0), "color": (*TEXT[:3], "red")},
                "deformation_scale": scale,
            },
        )
        yield (
            plotting.animate_motion,
            {**scene, "path": place / "motion.gif", "frames": 2},
            {
                **{**no_scene, **alone, "deformation_scale": scale},
                **{"frames": (*COUNT, 1), "frames_per_second": POSITIVE},
            },
        )

    def of_parts(self) -> Iterator[tuple[Callable[..., Any], dict[str, Any], dict[str, Any]]]:
        """What the chain consists of, for those who call its links one by one."""
        nothing = (None, 1.0, "rod", np.sin, [], {})
        reduced = self.evaluation.bodies["rod"]
        yield self.rod.quadrature_points, {"n": 1}, {"n": WHOLE_FROM_1}
        yield (
            ffr.Elasticity,
            {"domain": self.rod, "material": STEEL, "interpolation": ffr.SIMP()},
            dict.fromkeys(("domain", "material", "interpolation"), nothing),
        )
        yield (
            ffr.CraigBampton,
            {"elasticity": self.body.elasticity, "frame": ffr.TangentFrame("left"), "modes": 1},
            {"elasticity": nothing, "frame": nothing, "modes": COUNT, "tolerance": POSITIVE},
        )
        elements = ("rod", [1.5], [10**6], [-1], ["a"], {"arm": [0]})
        yield (
            lambda **given: list(ffr.mode_derivatives(**given)),
            {"body": self.body, "reduced": reduced, "cells": [0]},
            {"body": nothing, "reduced": nothing, "cells": elements[:-1]},
        )
        no_density = (*ARRAY, 1.0, self.full[1:], 2.0 * self.full, math.nan * self.full)
        yield (
            ffr.gray_fraction,
            {"domain": self.rod, "x": self.full},
            {"domain": nothing, "x": no_density, "low": NUMBER, "high": NUMBER},
        )
        everywhere = np.ones(self.rod.n_cells, bool)
        gradient = (*ARRAY, 1.0, self.full[1:], math.nan * self.full)
        yield (
            ffr.gradient_errors,
            {"domain": self.rod, "gradient": self.full, "exact": self.full, "cells": everywhere},
            {
                **{"domain": nothing, "gradient": gradient, "exact": gradient},
                "cells": (*ARRAY, [0], everywhere[1:]),
            },
        )
        yield (
            ffr.StressModes.of,
            {"body": self.body, "reduced": reduced},
            {
                **{"body": nothing, "reduced": nothing, "correction": FLAG[1:]},
                **{"relaxation": NOT_NEGATIVE, "void": SHARE},
            },
        )
        yield (
            ffr.select_modes,
            {"problem": self.problem, "tolerance": 1.0},
            {"problem": nothing, "tolerance": POSITIVE, "x": ("rod", 1.0, self.full[1:])},
        )
        modes = (*MAPPING, {"arm": 1}, {"rod": -1}, {"rod": "1"})
        yield self.problem.with_modes, {"modes": {"rod": 1}}, {"modes": modes}
        yield self.problem.with_tolerance, {"x": self.full, "tolerance": 0.1}, {"tolerance": NUMBER}
        yield (
            self.problem.differentiate,
            {"evaluation": self.evaluation},
            {"evaluation": (*nothing, self.full)},
        )
        yield (
            ffr.elementwise_gradient,
            {**{"problem": self.problem, "evaluation": self.evaluation}, "cells": [0]},
            {"problem": nothing, "evaluation": nothing, "cells": elements, "solver": (*TEXT, "lu")},
        )
        yield (
            ffr.integral_derivatives,
            {"body": self.body, "reduced": reduced, "cells": [0]},
            {"body": nothing, "reduced": nothing, "cells": elements[:-1]},
        )
        points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.7, 0.6]])
        yield (
            ffr.best_length,
            {"kernel": ffr.Gaussian, "points": points, "values": [0.0, 1.0, 2.0, 1.0]},
            {
                **{"kernel": (None, 1.0, "gaussian"), "points": ARRAY, "values": ARRAY},
                "bounds": ("ab", (1.0,), (2.0, 1.0), (0.0, 1.0), 1.0, ("1", "2")),
            },
        )
        yield (
            ffr.ParametricBody,
            {"function": lambda p: self.bodies["rod"], "jacobian": lambda p: []},
            {"function": FUNCTION[:3], "jacobian": FUNCTION[:3]},
        )
        none = np.zeros((2, 0))
        yield (
            ffr.BodyMarker,
            {"position": (0.0, 0.0), "displacement": none, "rotation": []},
            {"position": ARRAY, "displacement": ARRAY, "rotation": ARRAY},
        )
        variables = (*ARRAY, np.ones(2), np.full(self.design.size, math.nan))
        yield self.design.density, {"variables": self.design.even(0.5)}, {"variables": variables}


def answer(call: Callable[[], Any]) -> str:
    """What is wrong with the way in which a call is refused; nothing where it is in words."""
    try:
        found = call()
    except (TypeError, ValueError) as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        line = linecache.getline(last.filename, last.lineno or 0).strip()
        if PACKAGE in Path(last.filename).parents and line.startswith("raise"):
            return ""
        return f"a trace from the inside: {type(error).__name__}: {error} ({line})"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return f"taken: {found!r:.60}"


def test_arguments_are_refused_in_words(tmp_path: Path) -> None:
    scene, faults, count = Scene(tmp_path), [], 0
    for call, works, refused in scene.calls():
        call(**works)  # else it is not the value that is refused
        for name, values in refused.items():
            for value in values:
                count += 1
                fault = answer(lambda: call(**{**works, name: value}))  # noqa: B023
                if fault:
                    where = getattr(call, "__qualname__", call)
                    faults.append(f"{where}({name}={value!r:.40}): {fault:.160}")
    assert count > 1000
    assert not faults, f"{len(faults)} of {count}:\n" + "\n".join(faults)


@pytest.mark.parametrize(("comm", "path"), [(None, "rod.msh"), (MPI.COMM_SELF, None)])
def test_files_of_gmsh_are_refused_in_words(comm: Any, path: Any) -> None:
    with pytest.raises(TypeError, match=r"from_gmsh: (comm|path) must be .*, but it is None"):
        ffr.Domain.from_gmsh(comm, path)


class Name(enum.StrEnum):
    ROD = "rod"
    LEFT = "left"


def test_what_says_the_same_is_taken(tmp_path: Path) -> None:
    """Arrays, sets and views in place of lists, other kinds of texts, a path in two forms."""
    fields = {"gravity": np.array([0.0, -9.81]), "ground_acceleration": np.zeros(2)}
    joints = {"pin": ffr.Revolute(PIN, CRANK), "line": ffr.PointOnLine(END, ffr.Ground())}
    forces = {ffr.Force(marker) for marker in ((Name.ROD, Name.LEFT), ("rod", np.str_("left")))}
    mechanism = in_mechanism(joints=joints.values(), forces=forces, **fields)
    assert mechanism == in_mechanism(
        joints=list(joints.values()), forces=[ffr.Force(PIN)], gravity=(0.0, -9.81)
    )
    scene = Scene(tmp_path)
    instants = scene.steps.instants
    both = ffr.PathTracking("rod", "right", np.zeros((instants, 2)))
    for path in ((np.zeros(instants), 0.0), (0.0, [0.0] * instants)):
        objective = ffr.PathTracking("rod", "right", path)
        problem = ffr.MechanicalProblem(
            mechanism, scene.steps, objective, {ffr.Constraint(ffr.Mass("rod"), 9.0)}
        )
        found = problem.value(scene.bodies).psi
    trajectory = ffr.simulate(mechanism, scene.bodies, scene.steps)
    assert found == both.value(trajectory, scene.bodies)
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
    for found in (by_numbers, by_masks):
        np.testing.assert_array_equal(found.interfaces["left"].facets, facets)
        np.testing.assert_array_equal(found.design_cells, rod.design_cells)


@pytest.mark.mpi
def test_what_is_wrong_on_one_rank_is_refused_on_all(comm: MPI.Intracomm) -> None:
    rod = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(8, 2))
    here = comm.rank == comm.size - 1
    wrong = np.array([10**9] if here else [], dtype=np.int32)
    with pytest.raises(ValueError, match="facet 1000000000 does not exist"):
        ffr.Domain(rod.mesh, {"left": wrong})
    with pytest.raises(TypeError, match="density must hold real numbers"):
        rod.check_density(["1"] * rod.n_cells if here else np.ones(rod.n_cells))
