# SPDX-License-Identifier: MIT
"""The boundary of a solid as a field that moves: its motion, its walls, its descent."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import pyvista

import dolfinx_ffr as ffr
from dolfinx_ffr.boundary import Surface, wall_rows
from dolfinx_ffr.optimization import move_boundary
from dolfinx_ffr.optimization.boundary_steps import _Descent

SIZE, ELEMENTS, MEMBER = (0.2, 0.04, 0.04), (8, 4, 4), 4e-3
PLASTIC = ffr.Isotropic(young=3e9, poisson=0.35, density=1200.0)


def two_holes(x: np.ndarray) -> np.ndarray:
    """A beam with a hole through it, and one that is a dent in a side."""
    through = np.hypot(x[:, 0] - 0.07, x[:, 2]) - 0.014
    dent = np.linalg.norm((x - [0.14, 0.0, 0.02]) / [1.5, 1.0, 1.0], axis=1) - 0.012
    return 3.0 * np.minimum(through, dent)


def beam(comm: MPI.Comm) -> ffr.Problem:
    """A beam that is built in at its left end and bends under its weight."""
    domain = ffr.Domain.box(comm, *SIZE, elements=ELEMENTS, solid_layers=1)
    body = ffr.FlexibleBody(domain, PLASTIC, frame=ffr.TangentFrame("left"), modes=3)
    mechanism = ffr.Mechanism(
        {"beam": ffr.Placement((0.0, 0.0, 0.0))},
        [ffr.Weld(("beam", "left"), ffr.Ground())],
        point_masses=[ffr.PointMass(("beam", "right"), 0.2)],
        gravity=(0.0, 3.0, -9.81),
    )
    times = ffr.GeneralizedAlpha(0.02, 40)
    return ffr.Problem({"beam": body}, mechanism, times, ffr.IntegralCompliance())


def surface(
    problem: ffr.Problem, field: Callable[[np.ndarray], np.ndarray] = two_holes, member: float = MEMBER
) -> Surface:
    domain = problem.flexible["beam"].domain
    solid = ffr.Solid(domain, field, material=PLASTIC)
    return Surface.of(solid, member, size=0.8 * domain.cell_size)


def waves(found: Surface) -> np.ndarray:
    """A motion that leaves no two points alike, up to 1 [1]."""
    return np.sin(1.0 + 0.7 * np.arange(found.n_controls) ** 1.1)


@pytest.mark.mpi
def test_the_field_has_the_surface_of_the_solid(comm: MPI.Comm) -> None:
    """It is a distance, whatever the field that was given, and points of the solid are its zeros."""
    found = surface(beam(comm))
    x = found.part.points[found.moving.numbers]
    assert len(x) > 100
    assert np.max(np.abs(found.field(x))) < 1e-9
    assert np.max(np.abs(two_holes(x))) < 3.0 * 0.03 * MEMBER
    away = np.array([[0.07, 0.013, 0.017], [0.07, 0.0, 0.005]])
    np.testing.assert_allclose(found.field(away), [0.003, -0.009], atol=0.03 * MEMBER)
    assert found.part.volume == pytest.approx(found.origin.volume, rel=5e-3)


def test_points_follow_the_field() -> None:
    """To first order they stay on its surface, and on the outline of the body."""
    found = surface(beam(MPI.COMM_SELF))
    points = found.moving
    x, offsets = found.part.points[points.numbers], waves(found)
    faces = np.abs(np.abs(x[:, 1:]) - 0.02) < 1e-9
    assert np.any(faces)
    missed = []
    for step in (2e-4, 1e-4):
        moved = x - (points.rows @ (step * offsets))[:, None] * points.ways
        np.testing.assert_allclose(moved[:, 1:][faces], x[:, 1:][faces], atol=1e-12)
        missed.append(np.max(np.abs(found.shifted(step * offsets).field(moved))))
    assert missed[0] < 0.2 * 2e-4
    assert missed[1] < 0.3 * missed[0]


def test_derivative_of_psi_is_that_of_new_solids() -> None:
    """Beside differences over solids that are cut anew, whose meshes make some 1e-4 of psi."""
    problem = beam(MPI.COMM_SELF)
    found = surface(problem)
    descent = _Descent(problem, {"beam": 0.9}, {"beam": found.size}, {})
    slopes = descent.slopes(descent.tried({"beam": found}))
    along = -0.3 * slopes.psi / np.max(np.abs(slopes.psi))
    sides = [
        descent.tried({"beam": found.shifted(side * MEMBER * along)}) for side in (1.0, -1.0)
    ]
    psi = [np.log(side.evaluation.psi) for side in sides]
    assert 0.5 * (psi[0] - psi[1]) == pytest.approx(slopes.psi @ along, rel=0.03)
    volume = [side.excesses["volume of beam"] for side in sides]
    assert 0.5 * (volume[0] - volume[1]) == pytest.approx(slopes.slopes[-1] @ along, rel=0.03)


@pytest.mark.parametrize("place", [0.0, 0.0163])
def test_walls(place: float) -> None:
    """Of a plate between two voids and of one beside a face, exactly; and how they change."""

    def field(x: np.ndarray) -> np.ndarray:
        return np.minimum(np.abs(x[:, 2] - place) - 0.007, 1.0)

    def plate(x: np.ndarray) -> np.ndarray:
        return np.where(np.abs(x[:, 0] - 0.1) < 0.06, -field(x), 1.0)

    found = surface(beam(MPI.COMM_SELF), plate, 0.012)
    rows = wall_rows(found)
    thick, sides = (0.014, 2) if place == 0.0 else (0.02 - place + 0.007, 1)
    assert rows.smallest == pytest.approx(thick, rel=0.02)
    # the field is a sum of splines that add up to one
    outwards = 1e-4 * np.ones(found.n_controls)
    assert wall_rows(found.shifted(outwards)).smallest - rows.smallest == pytest.approx(
        sides * 1e-4, rel=0.05
    )
    told = -rows.least * (rows.slopes @ outwards)
    assert told[np.argmax(rows.values)] == pytest.approx(sides * 1e-4, rel=0.05)


@pytest.mark.mpi
def test_steps_lower_psi_and_tell_what_the_solid_is(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """On any number of ranks alike; the file is closed."""
    results = []
    for ranks in (comm, MPI.COMM_SELF):
        problem = beam(ranks)
        results.append(
            move_boundary(
                problem, surface(problem), volume=0.95, iterations=3, progress=False
            )
        )
    result = results[0]
    assert result.history["psi"] == pytest.approx(results[1].history["psi"], rel=1e-6)
    assert result.psi < 0.95 * result.history["psi"][0]
    assert result.history["volume"][-1] < 0.95 * 1.01
    solid = result.part()
    found = solid.verify(result.problem, result.evaluation, progress=False, tolerance=0.02)
    assert found.fitted[0].psi == pytest.approx(result.psi, rel=1e-6)
    (path,) = solid.write(shared_tmp_path / "beam.stl")
    if comm.rank == 0:
        assert pyvista.read(path).clean().is_manifold
    assert solid.volume == pytest.approx(result.summary()["volume"] * np.prod(SIZE), rel=1e-9)


def test_a_design_in_space_ends_with_steps_of_its_surface() -> None:
    problem = beam(MPI.COMM_SELF)
    design = ffr.DensityDesign(problem.flexible["beam"].domain)
    run = {"volume": 0.85, "iterations": 15, "progress": False, "mode_tolerance": None}
    result = ffr.optimize(problem, design, boundary=2, **run)
    assert result.moved is not None and not result.moved.materials
    assert result.part() is result.moved.part("beam")
    assert result.moved.psi < result.moved.history["psi"][0]


def test_what_has_no_surface_that_moves() -> None:
    problem = beam(MPI.COMM_SELF)
    domain = problem.flexible["beam"].domain
    full = ffr.Solid(domain, lambda x: np.ones(len(x)))
    with pytest.raises(ValueError, match="no zero surface that could move"):
        Surface.of(full, MEMBER)
    with pytest.raises(TypeError, match="a Surface"):
        move_boundary(problem, full)
    with pytest.raises(ValueError, match="member"):
        Surface.of(full, -1.0)
