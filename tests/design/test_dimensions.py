# SPDX-License-Identifier: MIT
"""Named dimensions: derivatives beside moved and new meshes, runs, values without a geometry."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.rods import STEEL

import dolfinx_ffr as ffr
from dolfinx_ffr.optimization.sizing import sized

pytestmark = pytest.mark.filterwarnings("ignore::dolfinx_ffr.TimeStepWarning")

LENGTH = 0.3
BOUNDS = {
    "start": (0.02, 0.05),
    "middle": (0.012, 0.05),
    "bore": (0.005, 0.008),
    "bearing": (-0.004, 0.004),
}


def bore(x: float, y: float, radius: float) -> list[list[tuple[float, float]]]:
    """A circle of two arcs."""
    east, west = (x + radius, y), (x - radius, y)
    return [[east, (x, y + radius), west], [west, (x, y - radius), east]]


def lever(d: Mapping[str, float]) -> dict[str, Any]:
    """A bar whose flanks are splines, between two bores, one of which has a place of its own."""
    x = np.linspace(-0.02, LENGTH + 0.02, 5)
    half = 0.5 * np.array([d["start"], d["start"], d["middle"], 0.03, 0.03])
    lower, upper = np.column_stack([x, -half]), np.column_stack([x, half])[::-1]
    flanks = [lower, [lower[-1], upper[0]], upper, [upper[-1], lower[0]]]
    right = np.array([LENGTH, d["bearing"]])
    return {
        "outline": [flanks, bore(0.0, 0.0, d["bore"]), bore(*right, 0.006)],
        "interfaces": {
            "left": lambda x: np.hypot(x[0], x[1]) < 1.01 * d["bore"],
            "right": lambda x: np.hypot(x[0] - right[0], x[1] - right[1]) < 0.0061,
        },
    }


def given_center(d: Mapping[str, float]) -> dict[str, Any]:
    """A center that is not the middle of its bore, and goes half as far."""
    return lever(d) | {"centers": {"right": (LENGTH, 0.5 * d["bearing"] + 1e-3)}}


def design(shape: Callable[..., Any] = lever, size: float = 0.008) -> ffr.DimensionDesign:
    start = {"bearing": 1e-3, "middle": 0.025}
    return ffr.DimensionDesign(shape, BOUNDS, size=size, start=start, order=2)


def machine(domain: ffr.Domain, **options: Any) -> ffr.Problem:
    """The lever between a crank and a slider."""
    frame = ffr.ChordFrame("left", "right")
    objective = options.pop("objective", ffr.IntegralCompliance())
    constraints = options.pop("constraints", ())
    body = ffr.FlexibleBody(domain, STEEL, frame=frame, modes=3, tolerance=1e-12, **options)
    crank = ffr.Moving.circle((0, 0), 0.1, ffr.Motion.smooth_step(10 * math.pi, 0.5))
    mechanism = ffr.Mechanism(
        placements={"rod": ffr.Placement(position=(0.1, 0.0))},
        joints=[
            ffr.Revolute(("rod", "left"), crank),
            ffr.PointOnLine(("rod", "right"), ffr.Ground()),
        ],
        point_masses=[ffr.PointMass(("rod", "right"), 0.5)]
        + [ffr.PointMass(("rod", name), 0.2) for name in body.markers],
    )
    return ffr.Problem(
        {"rod": body}, mechanism, ffr.GeneralizedAlpha(0.1, 40), objective, constraints
    )


def slopes(problem: ffr.Problem, made: ffr.DimensionDesign, x: np.ndarray) -> np.ndarray:
    """The derivative of psi by the dimensions, as `optimize` has it."""
    body = problem.flexible["rod"]
    evaluation = problem.gradient(np.ones(body.domain.n_cells), nodes=True)
    assert evaluation.nodes is not None and evaluation.centers is not None
    motion = made.motion(body.domain, x, body.marker_nodes)
    return motion.pullback(evaluation.nodes["rod"], evaluation.centers["rod"])


def of_moved_meshes(
    scene: Callable[[ffr.Domain], ffr.Problem], made: ffr.DimensionDesign, along: np.ndarray
) -> float:
    """The derivative by differences of whole evaluations on meshes whose nodes follow."""
    x, domain = made.even(), made.domain(MPI.COMM_SELF)
    body = scene(domain).flexible["rod"]
    motion = made.motion(domain, x, body.marker_nodes)
    facets = {name: part.facets for name, part in domain.interfaces.items()}
    nodes, places = domain.mesh.geometry.x, domain.mesh.geometry.x.copy()
    centers = np.array([part.center for part in domain.interfaces.values()])

    def psi(h: float) -> float:
        nodes[:, : domain.dimension] += h * motion.nodes @ along
        moved_centers = dict(
            zip(facets, (centers + h * motion.centers @ along).tolist(), strict=True)
        )
        moved = ffr.Domain(domain.mesh, facets, order=2, centers=moved_centers)
        moved_psi = scene(moved).value(np.ones(domain.n_cells)).psi
        nodes[:] = places
        return moved_psi

    h = 1e-3
    return (8.0 * (psi(h) - psi(-h)) - psi(2.0 * h) + psi(-2.0 * h)) / (12.0 * h)


#: A change of all dimensions by shares of their ranges
ALONG = np.array([0.3, -0.5, 0.2, 0.9]) * [np.ptp(pair) for pair in BOUNDS.values()]


@pytest.mark.parametrize(
    ("shape", "options"),
    [
        pytest.param(lever, {}, id="center of the bore"),
        pytest.param(given_center, {}, id="given center"),
        pytest.param(lever, {"markers": {"spot": (0.08, 0.003)}}, id="marker"),
    ],
)
def test_derivative(shape: Callable[..., Any], options: dict[str, Any]) -> None:
    """It is that of meshes that move, to round-off, and of meshes made anew, to their noise."""
    dimension_design = design(shape)

    def scene(domain: ffr.Domain) -> ffr.Problem:
        return machine(domain, **options)

    x = dimension_design.even()
    exact = slopes(scene(dimension_design.domain(MPI.COMM_SELF)), dimension_design, x) @ ALONG
    assert of_moved_meshes(scene, dimension_design, ALONG) == pytest.approx(exact, rel=1e-6)
    ends = [scene(dimension_design.domain(MPI.COMM_SELF, x + h * ALONG)) for h in (0.04, -0.04)]
    psi = [p.value(np.ones(p.flexible["rod"].domain.n_cells)).psi for p in ends]
    assert (psi[0] - psi[1]) / 0.08 == pytest.approx(exact, rel=0.01)


def test_the_place_of_a_bearing_counts() -> None:
    """Alone, by nodes and by centers: without the latter the derivative is another one."""
    made, along = design(), np.array([0.0, 0.0, 0.0, 1e-3])
    problem = machine(made.domain(MPI.COMM_SELF))
    body = problem.flexible["rod"]
    evaluation = problem.gradient(np.ones(body.domain.n_cells), nodes=True)
    assert evaluation.nodes is not None and evaluation.centers is not None
    motion = made.motion(body.domain, made.even())
    np.testing.assert_allclose(motion.centers[1, :, 3], [0.0, 1.0], atol=1e-6)
    total = motion.pullback(evaluation.nodes["rod"], evaluation.centers["rod"]) @ along
    assert of_moved_meshes(machine, made, along) == pytest.approx(total, rel=1e-6)
    part = motion.pullback(evaluation.nodes["rod"], 0.0 * evaluation.centers["rod"]) @ along
    assert abs(part / total - 1.0) > 0.1
    idle = ffr.DimensionDesign(lever, {**BOUNDS, "idle": (0.0, 1.0)}, size=0.02)
    with pytest.warns(UserWarning, match=r"\['idle'\] have no influence on the body"):
        idle.motion(idle.domain(MPI.COMM_SELF), idle.even())


def arm(d: Mapping[str, float], model: Any) -> None:
    """A tapered arm in space with two bores, one of which has a place of its own."""
    occ, half = model.occ, [0.5 * d["width"], 0.012, 0.012, 0.5 * d["width"]]
    corners = [
        occ.addPoint(x, side * h, 0.0)
        for x, side, h in zip((-0.02, 0.14, 0.14, -0.02), (-1, -1, 1, 1), half, strict=True)
    ]
    lines = [occ.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    body = [(3, occ.extrude([(2, face)], 0, 0, d["thickness"])[1][1])]
    bores = [
        (3, occ.addCylinder(x, y, 0, 0, 0, d["thickness"], 0.006))
        for x, y in ((0.0, 0.0), (0.12, d["bearing"]))
    ]
    ((_, volume),), _ = occ.cut(body, bores)
    occ.synchronize()
    round_ones = [tag for dim, tag in model.getEntities(2) if model.getType(2, tag) == "Cylinder"]
    for name, left in (("left", True), ("right", False)):
        tags = [tag for tag in round_ones if (occ.getCenterOfMass(2, tag)[0] < 0.06) == left]
        model.setPhysicalName(2, model.addPhysicalGroup(2, tags), name)
    model.setPhysicalName(3, model.addPhysicalGroup(3, [volume]), "arm")


def test_a_size_in_another_unit_is_refused_before_the_mesh() -> None:
    """Dimensions in millimetres against a size in metres ask for millions of cells."""
    bounds = {"width": (0.03, 0.05), "thickness": (0.01, 0.02), "bearing": (-0.01, 0.01)}
    dimension_design = ffr.DimensionDesign(arm, bounds, size=1.2e-5)
    with pytest.raises(
        ValueError, match=r"cells of 1\.2e-05 m .*all dimensions in metres: the body"
    ):
        dimension_design.domain(MPI.COMM_SELF)


def pendulum(domain: ffr.Domain) -> ffr.Problem:
    """The arm in space, thrown."""
    body = ffr.FlexibleBody(
        domain,
        ffr.Isotropic(3e9, 0.35, 1200.0),
        frame=ffr.TangentFrame("left"),
        modes=3,
        tolerance=1e-12,
    )
    mechanism = ffr.Mechanism(
        placements={"rod": ffr.Placement((0.0, 0.0, 0.0), angular_velocity=(0.0, 2.0, 1.0))},
        joints=[ffr.Spherical(("rod", "left"), ffr.Ground((0.0, 0.0, 0.0)))],
        point_masses=[ffr.PointMass(("rod", "right"), 0.05)],
        gravity=(0.0, 0.0, -9.81),
    )
    steps = ffr.GeneralizedAlpha(0.1, 40)
    return ffr.Problem({"rod": body}, mechanism, steps, ffr.IntegralCompliance())


@pytest.mark.slow
@pytest.mark.mpi
def test_derivative_in_space(comm: MPI.Intracomm) -> None:
    """Of all ranks together; the meshes that move are of each alone."""
    bounds = {"width": (0.03, 0.06), "thickness": (0.008, 0.02), "bearing": (-0.003, 0.003)}
    dimension_design = ffr.DimensionDesign(
        arm, bounds, size=0.012, start={"bearing": 1e-3}, order=2
    )
    along = np.array([0.3, -0.4, 0.6]) * [np.ptp(pair) for pair in bounds.values()]
    exact = (
        slopes(pendulum(dimension_design.domain(comm)), dimension_design, dimension_design.even())
        @ along
    )
    assert of_moved_meshes(pendulum, dimension_design, along) == pytest.approx(exact, rel=1e-5)


@pytest.mark.slow
@pytest.mark.mpi
def test_sizing(comm: MPI.Intracomm) -> None:
    """Psi falls below a mass that is held; the ranks together do what one of them does alone."""

    def run(on: MPI.Comm) -> ffr.Result:
        dimension_design = design(size=0.012)
        limit = ffr.Constraint(ffr.Mass("rod"), upper=0.75)
        problem = machine(dimension_design.domain(on), constraints=[limit])
        return ffr.optimize(
            problem, dimension_design, iterations=4, progress=False, mode_tolerance=None
        )

    result = run(comm)
    history = result.history
    assert result.psi < 0.97 * history["psi"][0] and result.feasible
    assert history["constraint Mass"][-1] <= 1e-8
    dimensions, even = result.dimensions["rod"], design().named(design().even())
    for name, (lower, upper) in BOUNDS.items():
        assert lower <= dimensions[name] <= upper
        assert history[f"rod: {name}"][0] == pytest.approx(even[name], rel=1e-12)
    assert set(result.at_bounds["rod"]) == {
        name
        for name, pair in BOUNDS.items()
        if min(abs(dimensions[name] - end) for end in pair) < 1e-5
    }
    assert result.summary()["dimensions"] == result.dimensions and "of the parts" in str(result)
    part, domain = result.part("rod"), result.problem.flexible["rod"].domain
    assert isinstance(part, ffr.Part) and part.holes == 2 and part.pieces == 1
    assert len(part.interface("right")) == 2 and part.area == pytest.approx(domain.area, rel=1e-4)
    serial_result = run(MPI.COMM_SELF) if comm.size > 1 else result
    np.testing.assert_allclose(history["psi"], serial_result.history["psi"], rtol=1e-9)
    for name, value in serial_result.dimensions["rod"].items():
        assert dimensions[name] == pytest.approx(value, abs=1e-7 * np.ptp(BOUNDS[name]))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::dolfinx_ffr.PartWarning")
def test_dimensions_of_one_body_beside_densities_of_another() -> None:
    """The lever hangs from a link that is designed by a level set, whose boundary then moves."""
    dimension_design = design(size=0.012)
    link = ffr.Domain.rectangle(MPI.COMM_SELF, 0.4, 0.04, elements=(40, 4))
    frame = ffr.ChordFrame("left", "right")
    bodies = {
        "link": ffr.FlexibleBody(link, STEEL, frame=frame, modes=3),
        "rod": ffr.FlexibleBody(
            dimension_design.domain(MPI.COMM_SELF), STEEL, frame=frame, modes=3
        ),
    }
    mechanism = ffr.Mechanism(
        {"link": ffr.Placement((0.0, 0.0)), "rod": ffr.Placement((0.4, 0.0))},
        [
            ffr.Revolute(("link", "left"), ffr.Ground()),
            ffr.Revolute(("rod", "left"), ("link", "right")),
        ],
        gravity=(0.0, -9.81),
    )
    limit = ffr.Constraint(ffr.Mass("rod"), upper=0.75)
    steps, objective = ffr.GeneralizedAlpha(0.1, 40), ffr.IntegralCompliance()
    problem = ffr.Problem(bodies, mechanism, steps, objective, [limit])
    designs = {"rod": dimension_design, "link": ffr.LevelSet(link)}
    options: dict[str, Any] = {"volume": 0.7, "progress": False, "mode_tolerance": None}
    result = ffr.optimize(problem, designs, iterations=6, boundary=1, **options)
    history = result.history
    assert history["psi"][-1] < 0.5 * history["psi"][0] and result.feasible
    assert np.all(np.ptp([history[f"rod: {name}"] for name in BOUNDS], axis=1) > 0.0)
    assert result.densities.keys() == {"link"} and result.dimensions.keys() == {"rod"}
    assert result.moved is not None and result.psi == result.moved.psi < history["psi"][-1]
    assert result.problem.flexible["rod"].domain is result.moved.problem.flexible["rod"].domain
    # the derivatives are those of each kind
    x = {"rod": dimension_design.even(), "link": np.full(link.n_cells, 0.7)}
    sizing, _ = sized(problem, designs)
    slopes = sizing.differentiate(sizing.value(x)).gradient
    along = {"rod": 0.04 * ALONG, "link": 1e-3 * np.random.default_rng(0).random(link.n_cells)}
    ends = [sizing.value({n: x[n] + side * along[n] for n in x}).psi for side in (1.0, -1.0)]
    exact = sum(slopes[name] @ along[name] for name in x)
    assert 0.5 * (ends[0] - ends[1]) == pytest.approx(exact, rel=0.01)
    for part in ("rod", "link"):
        assert result.part(part).pieces == 1


def test_values_without_a_geometry_are_taken_back() -> None:
    """The least mass is where holes and flanks touch: the run stays on the near side."""
    fixed = {"start": 0.04, "bore": 0.006, "bearing": 0.0}

    def touching(d: Mapping[str, float]) -> dict[str, Any]:
        sizes = lever(d | fixed)
        return sizes | {"outline": [*sizes["outline"], bore(0.5 * LENGTH, 0.0, 0.008)]}

    bounds, start = {"middle": (0.005, 0.04)}, {"middle": 0.024}
    dimension_design = ffr.DimensionDesign(touching, bounds, size=0.01, start=start)
    with pytest.raises(ValueError, match=r"can be made with middle = 0\.01: .*cross or touch at"):
        dimension_design.domain(MPI.COMM_SELF, [0.01])
    problem = machine(dimension_design.domain(MPI.COMM_SELF), objective=ffr.Mass("rod"))
    with pytest.warns(ffr.DesignWarning, match=r"step is rejected.* cross or touch"):
        result = ffr.optimize(
            problem, dimension_design, iterations=12, progress=False, mode_tolerance=None
        )
    history = result.history
    assert np.any(history["accepted"] == 0.0) and np.all(np.diff(history["rod: middle"]) <= 0.0)
    assert result.psi == history["psi"].min()
    least = result.dimensions["rod"]["middle"]
    with pytest.raises(ValueError, match="no body can be made with"):
        dimension_design.domain(MPI.COMM_SELF, [least - 0.03 * 0.035])


def test_what_is_refused() -> None:
    for bounds, start, why in (
        ({}, {}, "give at least one"),
        ({"a": (2.0, 1.0)}, {}, "'a' is between 2 and 1; give two bounds"),
        ({"a": (0.0, np.inf)}, {}, "dimensions: 'a' holds NaN or infinity"),
        ({"a": (1.0, 2.0)}, {"b": 1.0}, "dimensions: name"),
        ({"a": (1.0, 2.0)}, {"a": 3.0}, "dimensions: 'a'"),
    ):
        with pytest.raises(ValueError, match=why):
            ffr.DimensionDesign(lever, bounds, size=0.01, start=start)
    with pytest.raises(TypeError, match="dimensions: shape"):
        ffr.DimensionDesign("lever", BOUNDS, size=0.01)  # type: ignore[arg-type]

    def holes(d: Mapping[str, float]) -> dict[str, Any]:
        sizes = lever({"start": 0.04, "middle": 0.04, "bore": 0.006, "bearing": 0.0})
        more = [bore(0.1 * (k + 1), 0.0, 0.005) for k in range(round(d["holes"]))]
        return sizes | {"outline": [*sizes["outline"], *more]}

    dimension_design = ffr.DimensionDesign(holes, {"holes": (0.0, 2.0)}, size=0.02)
    with pytest.raises(ValueError, match="12 curves and 1 faces, and at the start 16 curves"):
        dimension_design.domain(MPI.COMM_SELF, [0.0])

    def vanishing(d: Mapping[str, float]) -> dict[str, Any]:
        sizes = lever({"start": 0.04, "middle": 0.04, "bore": 0.006, "bearing": 0.0})
        nowhere = {"right": lambda x: np.hypot(x[0] - LENGTH, x[1]) < d["reach"]}
        return sizes | {"interfaces": sizes["interfaces"] | nowhere}

    dimension_design = ffr.DimensionDesign(vanishing, {"reach": (0.0, 0.014)}, size=0.02)
    with pytest.raises(ValueError, match=r"reach = 0\.004: interface 'right' has no facets"):
        dimension_design.domain(MPI.COMM_SELF, [0.004])
    wrong = ffr.DimensionDesign(lambda d: {"outline": []}, {"a": (0.0, 1.0)}, size=0.01)
    with pytest.raises(ValueError, match=r"can be made with a = 0\.5: .*returns \['outline'\]"):
        wrong.domain(MPI.COMM_SELF)
    dimension_design = design(size=0.02)
    problem = machine(dimension_design.domain(MPI.COMM_SELF))
    with pytest.raises(ValueError, match="give boundary=0"):
        ffr.optimize(problem, dimension_design, boundary=2, progress=False)
    others: list[dict[str, Any]] = [{"volume": 0.4}, {"optimizer": ffr.LevelSetEvolution()}]
    for asked in (*others, {"gradient": ffr.paper.ApproximateGradient()}):
        with pytest.raises(ValueError, match="needs MMA, the exact gradient, and no volume; bound"):
            ffr.optimize(problem, dimension_design, progress=False, **asked)
    with pytest.raises(ValueError, match=r"dimensions are given for \['crank', 'rod'\]"):
        ffr.optimize(problem, {"rod": dimension_design, "crank": dimension_design}, progress=False)
    edge = machine(dimension_design.domain(MPI.COMM_SELF), markers={"spot": (-0.0199, 0.005)})
    with pytest.raises(ffr.SimulationError, match="a marker is in a cell whose boundary moves"):
        ffr.optimize(edge, dimension_design, iterations=1, progress=False)
    cord = ffr.SpringDamper(("rod", "right"), ffr.Ground((0.3, 0.2)), stiffness=1e3, name="cord")
    mechanism = replace(problem.mechanism, forces=[cord])
    hung = ffr.Problem(problem.bodies, mechanism, problem.integrator, problem.objective)
    with pytest.raises(ValueError, match="'cord' takes its length from the placements"):
        ffr.optimize(hung, dimension_design, progress=False)
