# SPDX-License-Identifier: MIT
"""Derivatives with respect to the nodes of a mesh: whole evaluations on meshes that have moved."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import mesh
from shared.rods import STEEL

import dolfinx_ffr as ffr
from dolfinx_ffr.fem import _compat
from dolfinx_ffr.optimization.descent import parted
from dolfinx_ffr.reduction.point_marker import PointMarker, _shape_functions

# forty steps damp what a thrown rod excites, and its mount tilts; the derivative is that of this
pytestmark = [
    pytest.mark.filterwarnings("ignore::dolfinx_ffr.TimeStepWarning"),
    pytest.mark.filterwarnings("ignore::dolfinx_ffr.dynamics.TiltedAxisWarning"),
]

ELEMENTS = (12, 3)
SIZE = np.array([0.4, 0.04, 0.03])
KINDS = {
    "triangle": mesh.CellType.triangle,
    "quadrilateral": mesh.CellType.quadrilateral,
    "tetrahedron": mesh.CellType.tetrahedron,
    "hexahedron": mesh.CellType.hexahedron,
}


def motion(x: np.ndarray) -> np.ndarray:
    """A motion of the nodes that leaves no two of them alike, up to 0.5 mm [m]."""
    phase = 60.0 * x[:, 0] + 300.0 * x[:, 1] + (170.0 * x[:, 2] if x.shape[1] > 2 else 0.0)
    columns = [np.sin(phase + 0.3), np.cos(1.7 * phase), np.sin(2.3 * phase + 1.0)]
    return 5e-4 * np.column_stack(columns)[:, : x.shape[1]]


def curved(comm: MPI.Comm) -> mesh.Mesh:
    """Triangles of order 2 on the rectangle."""
    nx, ny = ELEMENTS
    i, j = np.meshgrid(np.arange(2 * nx + 1), np.arange(2 * ny + 1), indexing="ij")
    number = np.arange(i.size).reshape(i.shape)
    a, b, c, d = number[:-2:2, :-2:2], number[2::2, :-2:2], number[:-2:2, 2::2], number[2::2, 2::2]
    bottom, top, left = number[1:-1:2, :-2:2], number[1:-1:2, 2::2], number[:-2:2, 1:-1:2]
    right, middle = number[2::2, 1:-1:2], number[1:-1:2, 1:-1:2]
    cells = np.concatenate(  # vertices, then the middles of the edges opposite to them
        [
            np.stack([a, b, d, right, middle, bottom], axis=-1).reshape(-1, 6),
            np.stack([a, d, c, top, left, middle], axis=-1).reshape(-1, 6),
        ]
    )
    points = np.column_stack([i.ravel() / (2 * nx), j.ravel() / (2 * ny)]) * SIZE[:2]
    if comm.rank:
        cells = cells[:0]
    return _compat.create_mesh(comm, cells.astype(np.int64), points, "triangle", 2)


def made(comm: MPI.Comm, cell: str) -> mesh.Mesh:
    if cell == "curved":
        return curved(comm)
    kind = KINDS[cell]
    if cell in ("triangle", "quadrilateral"):
        return mesh.create_rectangle(comm, [np.zeros(2), SIZE[:2]], ELEMENTS, kind)
    return mesh.create_box(comm, [np.zeros(3), SIZE], (8, 2, 2), kind)


def moved(comm: MPI.Comm, cell: str, order: int, step: float) -> ffr.Domain:
    """The rod after a share of the motion; interfaces and their centers stay where they are."""
    domain = made(comm, cell)
    d = domain.geometry.dim
    domain.topology.create_connectivity(d - 1, d)
    ends = {
        "left": mesh.locate_entities_boundary(domain, d - 1, lambda x: x[0] < 1e-9),
        "right": mesh.locate_entities_boundary(domain, d - 1, lambda x: x[0] > SIZE[0] - 1e-9),
    }
    domain.geometry.x[:, :d] += step * motion(domain.geometry.x[:, :d])
    center = 0.5 * SIZE[:d]
    centers = {"left": [0.0, *center[1:]], "right": [SIZE[0], *center[1:]]}
    return ffr.Domain(domain, ends, order=order, centers=centers)


def follows(comm: MPI.Comm, cell: str, order: int, step: float, place: list[float]) -> list[float]:
    """Where a point of the rod is after a share of the motion: it moves with its cell."""
    before, after = (moved(comm, cell, order, h) for h in (0.0, step))
    values = []
    for number, reference in PointMarker.at(before, place).cells:
        weights = _shape_functions(before, number, reference)[2][0]
        nodes = _compat.cell_geometry(after.mesh)[number]
        values.append(weights @ after.mesh.geometry.x[nodes, : after.dimension])
    all_places = [place for part in comm.allgather(values) for place in part]
    return np.mean(all_places, axis=0).tolist()


def density(domain: ffr.Domain) -> np.ndarray:
    """The same in each cell wherever its nodes have moved, and on any number of ranks."""
    original = domain.mesh.topology.original_cell_index[: domain.n_cells]
    return 0.6 + 0.3 * np.sin(np.asarray(original, dtype=float))


def slider_crank(
    domain: ffr.Domain, objective: ffr.Objective, integrator: Any, **options: Any
) -> ffr.Problem:
    """The rod between a crank and a slider, under gravity, in the plane."""
    body = ffr.FlexibleBody(
        domain, STEEL, frame=ffr.ChordFrame("left", "right"), modes=3, tolerance=1e-12, **options
    )
    masses, springs = [], []
    if body.markers:  # they move with their cells
        spot = ("rod", "spot")
        masses = [ffr.PointMass(spot, 0.1)]
        springs = [
            ffr.SpringDamper(spot, ffr.Ground((0.3, 0.2)), stiffness=2e3, length=0.1),
            ffr.TorsionalSpringDamper(spot, ffr.Ground(), stiffness=5.0),
        ]
    crank = ffr.Moving.circle((0, 0), 0.1, ffr.Motion.smooth_step(10 * math.pi, 0.5))
    mechanism = ffr.Mechanism(
        placements={"rod": ffr.Placement(position=(0.1, 0.0))},
        joints=[
            ffr.Revolute(("rod", "left"), crank, name="crank pin"),
            ffr.PointOnLine(("rod", "right"), ffr.Ground()),
        ],
        point_masses=[ffr.PointMass(("rod", "right"), 0.5), *masses],
        gravity=(0.0, -9.81),
        forces=springs,
    )
    return ffr.Problem({"rod": body}, mechanism, integrator, objective)


def pendulum(
    domain: ffr.Domain, objective: ffr.Objective, integrator: Any, **options: Any
) -> ffr.Problem:
    """The rod on a universal joint in space, thrown."""
    body = ffr.FlexibleBody(
        domain,
        ffr.Isotropic(3e9, 0.35, 1200.0),
        frame=ffr.TangentFrame("left"),
        modes=3,
        tolerance=1e-12,
        **options,
    )
    masses, forces = [], []
    if body.markers:
        spot, post = ("rod", "spot"), ffr.Ground((0.25, 0.1, -0.05))
        masses = [ffr.PointMass(spot, 0.02)]
        forces = [
            ffr.SpringDamper(spot, post, stiffness=40.0, damping=0.1, length=0.05),
            ffr.Bushing(
                spot, post, (30.0, 10.0, 20.0), torsional_stiffness=(0.2, 0.3, 0.1), name="mount"
            ),
        ]
    mechanism = ffr.Mechanism(
        placements={
            "rod": ffr.Placement(position=(0.0, 0.0, 0.0), angular_velocity=(0.0, 2.0, 1.0))
        },
        joints=[ffr.Spherical(("rod", "left"), ffr.Ground((0.0, 0.0, 0.0)))],
        point_masses=[ffr.PointMass(("rod", "right"), 0.05), *masses],
        gravity=(0.0, 0.0, -9.81),
        forces=forces,
    )
    return ffr.Problem({"rod": body}, mechanism, integrator, objective)


Scene = Callable[..., ffr.Problem]


def errors(
    scene: Scene,
    comm: MPI.Intracomm,
    cell: str,
    order: int,
    objectives: tuple[ffr.Objective, ...],
    integrator: Any,
    **own: Any,
) -> list[float]:
    """Relative distances of the exact derivatives along the motion from differences."""
    step = 0.12

    def made_with(h: float) -> tuple[ffr.Problem, np.ndarray]:
        markers = own.get("markers", {})
        places = {name: follows(comm, cell, order, h, x) for name, x in markers.items()}
        domain = moved(comm, cell, order, h)
        first, *others = objectives
        made = scene(domain, first, integrator, **own | ({"markers": places} if places else {}))
        bounds = [ffr.Constraint(each, upper=1.0, name=str(k)) for k, each in enumerate(others)]
        return ffr.Problem(made.bodies, made.mechanism, integrator, first, bounds), density(domain)

    def values(h: float) -> np.ndarray:
        problem, x = made_with(h)
        evaluation = problem.value(x)
        return np.array(
            [evaluation.psi, *(bound.value for bound in evaluation.constraints.values())]
        )

    problem, x = made_with(0.0)
    body = problem.flexible["rod"]
    evaluation = problem.differentiate(problem.value(x), nodes=True, densities=False)
    assert evaluation.gradient is None
    direction = motion(body.domain.mesh.geometry.x[:, : body.domain.dimension])
    exact = np.empty(len(objectives))
    for k, one in enumerate([evaluation, *evaluation.constraints.values()]):
        assert one.nodes is not None
        exact[k] = body.elasticity.nodes.inner(one.nodes["rod"], direction)
    assert np.all(exact != 0.0)
    differences = [values(k * step) - values(-k * step) for k in (1, 2, 3)]
    return list(
        np.abs(
            (45 * differences[0] - 9 * differences[1] + differences[2]) / (60 * step * exact) - 1.0
        )
    )


ALPHA, RADAU = ffr.GeneralizedAlpha(0.1, 40), ffr.RadauIIA(0.1, steps=10)
COMPLIANCE = ffr.IntegralCompliance()
HALF = ffr.Volume("rod", region=lambda x: x[0] < 0.2)
STIFF = ("omega2", "alpha", "acceleration", "markers")
SPOT, IN_SPACE = {"spot": (0.213, 0.011)}, {"spot": (0.213, 0.011, 0.02)}
STRESS, PATH = ffr.PeakStress("rod", power=4), ffr.PathTracking("rod", "spot", (0.2, 0.1))
UNCORRECTED = ffr.PeakStress("rod", power=4, correction=False)
PATH_IN_SPACE = ffr.PathTracking("rod", "spot", (0.2, 0.1, 0.05))
ACCELERATION = ffr.MarkerAcceleration("rod", "spot")
LOADED = ffr.Frequency("rod", point_masses=True)
JOINT = (COMPLIANCE, ffr.JointForce("crank pin"), HALF)
#: What is not the same on several ranks is cells, stress, and a marker that one of them has.
mpi, slow = pytest.mark.mpi, pytest.mark.slow
PLANE = [
    pytest.param("triangle", 1, JOINT, RADAU, {}, id="joint"),
    pytest.param(
        *("quadrilateral", 2, (COMPLIANCE, LOADED, ffr.Volume("rod")), ALPHA, {}),
        marks=mpi,
    ),
    pytest.param("triangle", 3, (PATH, COMPLIANCE), ALPHA, {"markers": SPOT}, marks=[mpi, slow]),
    pytest.param(
        *("curved", 2, (COMPLIANCE, UNCORRECTED, ffr.Mass("rod")), RADAU, {}), marks=[mpi, slow]
    ),
    pytest.param("quadrilateral", 1, (STRESS,), ALPHA, {}, marks=slow),
    pytest.param(
        *("quadrilateral", 1, (ACCELERATION, COMPLIANCE), ALPHA),
        {"markers": SPOT, "stiffening": STIFF},
        marks=slow,
    ),
]


@pytest.mark.parametrize(("cell", "order", "objectives", "integrator", "options"), PLANE)
def test_in_the_plane(
    cell: str, order: int, objectives: Any, integrator: Any, options: dict[str, Any]
) -> None:
    comm = MPI.COMM_WORLD
    assert max(errors(slider_crank, comm, cell, order, objectives, integrator, **options)) < 1e-7


SPACE = [
    ("hexahedron", 1, (STRESS, COMPLIANCE), {}),
    ("tetrahedron", 2, (ACCELERATION, COMPLIANCE), {"markers": IN_SPACE}),
    (
        *("hexahedron", 1, (PATH_IN_SPACE, COMPLIANCE)),
        {"markers": IN_SPACE, "stiffening": ("rotation", "acceleration", "markers")},
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(("cell", "order", "objectives", "options"), SPACE)
def test_in_space(cell: str, order: int, objectives: Any, options: dict[str, Any]) -> None:
    serial = MPI.COMM_SELF
    assert max(errors(pendulum, serial, cell, order, objectives, ALPHA, **options)) < 1e-7


def test_parts_of_a_largest_stress() -> None:
    """The bounds that steps of the boundary keep where it is the objective, one for each range."""
    serial, whole = MPI.COMM_SELF, ffr.PeakStress("rod", clear=5e-3)
    domain = moved(serial, "triangle", 2, 0.0)
    problem = slider_crank(domain, whole, ALPHA)
    by_places, _ = problem.adapted(problem.value(density(domain)), parted)
    objectives = tuple(bound.objective for bound in by_places.constraints)
    assert len(objectives) > 1
    assert max(errors(slider_crank, serial, "triangle", 2, objectives, ALPHA)) < 1e-7


def test_a_length_that_would_change_is_refused() -> None:
    """The free length of a spring at a marker that moves with its cell, where none is given."""
    domain = moved(MPI.COMM_SELF, "triangle", 1, 0.0)
    made = slider_crank(domain, ffr.IntegralCompliance(), ALPHA, markers={"spot": (0.213, 0.011)})
    spring = ffr.SpringDamper(("rod", "spot"), ffr.Ground((0.3, 0.2)), stiffness=2e3, name="cord")
    mechanism = dataclasses.replace(made.mechanism, forces=[spring])
    problem = ffr.Problem(made.bodies, mechanism, ALPHA, ffr.IntegralCompliance())
    evaluation = problem.value(density(domain))
    assert problem.differentiate(evaluation).gradient is not None
    with pytest.raises(ValueError, match=r"'cord' takes its length .* 'spot' of 'rod' moves"):
        problem.differentiate(evaluation, nodes=True)
