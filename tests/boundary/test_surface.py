# SPDX-License-Identifier: MIT
"""The boundary of a solid as a field that moves: its motion, its walls, its descent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import pyvista
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

import dolfinx_ffr as ffr
from dolfinx_ffr.boundary import Surface
from dolfinx_ffr.boundary.options import SURFACES, SurfaceOptions
from dolfinx_ffr.optimization import move_boundary
from dolfinx_ffr.optimization.descent import Descent
from dolfinx_ffr.part import tangent_balls

SIZE, ELEMENTS, MEMBER = (0.16, 0.04, 0.04), (8, 4, 4), 6e-3
PLASTIC = ffr.Isotropic(young=3e9, poisson=0.35, density=1200.0)


def notched(x: np.ndarray) -> np.ndarray:
    """A beam with a deep notch and a hole through it, by a field that is no distance."""
    notch = np.hypot(x[:, 0] - 0.06, x[:, 2] - 0.02) - 0.018
    hole = np.hypot(x[:, 0] - 0.11, x[:, 2]) - 0.013
    return 3.0 * np.minimum(notch, hole)


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
    problem: ffr.Problem,
    field: Callable[[np.ndarray], np.ndarray] = notched,
    member: float = MEMBER,
    share: float = 0.65,
    options: SurfaceOptions = SURFACES,
) -> Surface:
    domain = problem.flexible["beam"].domain
    solid = ffr.Solid(domain, field, material=PLASTIC)
    return Surface.of(solid, member, size=share * domain.cell_size, options=options)


def waves(found: Surface) -> np.ndarray:
    """A motion that leaves no two points alike, up to 1 [1]."""
    return np.sin(1.0 + 0.7 * np.arange(found.n_offsets) ** 1.1)


@pytest.mark.slow
def test_the_field_has_the_surface_of_the_solid(comm: MPI.Comm) -> None:
    """It is a distance, whatever field was given, and the solid's points are its zeros."""
    solid_surface = surface(beam(comm))
    x = solid_surface.part.points[solid_surface.moving.numbers]
    assert len(x) > 60
    assert np.max(np.abs(solid_surface.field(x))) < 1e-9
    assert np.max(np.abs(notched(x))) < 3.0 * 0.03 * MEMBER
    away = np.array([[0.06, 0.013, -0.002], [0.11, 0.0, 0.005]])
    np.testing.assert_allclose(solid_surface.field(away), [0.004, -0.008], atol=0.03 * MEMBER)
    assert solid_surface.part.volume == pytest.approx(solid_surface.origin.volume, rel=5e-3)
    assert len(solid_surface.drawn.triangles) > 2 * len(solid_surface.part.triangles)


def test_points_follow_the_field() -> None:
    """To first order they stay on its surface, and on the outline of the body."""
    solid_surface = surface(beam(MPI.COMM_SELF))
    points = solid_surface.moving
    x, offsets = solid_surface.part.points[points.numbers], waves(solid_surface)
    faces = np.abs(np.abs(x[:, 1:]) - 0.02) < 1e-9
    assert np.any(faces)
    missed = []
    for step in (2e-4, 1e-4):
        moved = x - (points.rows @ (step * offsets))[:, None] * points.motions
        np.testing.assert_allclose(moved[:, 1:][faces], x[:, 1:][faces], atol=0.02 * step)
        missed.append(np.max(np.abs(solid_surface.shifted(step * offsets).field(moved))))
    assert missed[0] < 0.2 * 2e-4
    assert missed[1] < 0.3 * missed[0]


@pytest.mark.slow
@pytest.mark.mpi
def test_derivative_of_psi_is_that_of_the_mesh_that_moves(comm: MPI.Comm) -> None:
    problem = beam(comm)
    solid_surface = surface(problem)
    descent = Descent(problem, {"beam": 0.9}, {"beam": solid_surface.size}, {})
    slopes = descent.slopes(descent.trial_of({"beam": solid_surface}))
    cut = solid_surface.part._cuts[solid_surface.part._first_division]
    points, centers = solid_surface.moving, {"left": [0.0, 0.0, 0.0], "right": [SIZE[0], 0.0, 0.0]}
    offsets, step, values = waves(solid_surface), 1e-6, []
    for side in (step, -step):
        x = cut.points.copy()
        if comm.rank == 0:
            number = cKDTree(x).query(solid_surface.part.points[points.numbers])[1]
            x[number] -= (points.rows @ (side * offsets))[:, None] * points.motions
        moved = replace(cut, points=x).domain(comm, ["left", "right"], centers, 2)
        again = problem.with_bodies({"beam": problem.flexible["beam"].with_domain(moved)})
        values.append([np.log(again.value(np.ones(moved.n_cells)).psi), moved.area])
    psi, volume = np.subtract(*values) / (2.0 * step) * MEMBER
    assert psi == pytest.approx(slopes.psi @ offsets, rel=1e-4)
    expected = 0.9 * np.prod(SIZE) * (slopes.slopes[-1] @ offsets)
    assert volume == pytest.approx(expected, rel=1e-4)


def plate(thickness: float, place: float) -> Callable[[np.ndarray], np.ndarray]:
    """A plate between two voids that is as thick as told, with its middle at a height [m]."""

    def field(x: np.ndarray) -> np.ndarray:
        inside = 0.5 * thickness - np.abs(x[:, 2] - place)
        return np.where(np.abs(x[:, 0] - 0.08) < 0.05, inside, 1.0)

    return field


@pytest.mark.parametrize("place", [0.0, 0.0163])
def test_walls(place: float) -> None:
    """Of a plate between two voids and of one beside a face, exactly; and how they change."""
    solid_surface = surface(beam(MPI.COMM_SELF), plate(0.014, place), 0.01)
    rows = solid_surface.rows(solid_surface.walls)
    thick = 0.014 if place == 0.0 else 0.02 - place + 0.007
    assert np.median(solid_surface.walls.thickness) == pytest.approx(thick, rel=0.01)
    outwards = 1e-4 * np.ones(solid_surface.n_offsets)
    beside = [solid_surface.shifted(side * outwards) for side in (1.0, -1.0)]
    mean = [np.median(other.walls.thickness) for other in beside]
    expected = -np.median(rows.least * (rows.slopes @ outwards))
    assert 0.5 * np.subtract(*mean) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("place", [0.0, 0.018])
def test_thin_walls_become_as_thick_as_asked(place: float) -> None:
    """Also beside a face of the body, which stays; and the solid that is cut has them, too."""
    solid_surface = surface(beam(MPI.COMM_SELF), plate(0.3 * MEMBER, place), MEMBER, share=0.4)
    walls = solid_surface.walls
    assert walls.thickness[0] > 0.999 * MEMBER
    inside = np.array([[0.08, 0.003, min(place, 0.02 - 0.5 * MEMBER) + y] for y in (0.002, -0.002)])
    assert np.all(solid_surface.field(inside) > 0.0)
    cut = solid_surface.part.points[np.abs(solid_surface.part.points[:, 0] - 0.08) < 0.02]
    assert np.ptp(cut[:, 2]) > 0.98 * MEMBER


def test_what_is_drawn_thinner_is_mended(monkeypatch: pytest.MonkeyPatch) -> None:
    """Until the measure of the solid, which knows nothing of the field, finds nothing thinner."""

    def left(self: Surface) -> Surface:
        self.walls = self._walls()
        return self

    monkeypatch.setattr(Surface, "_thick", left)  # the walls of the field stay
    member = 1.5 * MEMBER
    solid_surface = surface(beam(MPI.COMM_SELF), plate(0.94 * member, 0.0), member)
    before, after = (
        solid_surface.drawn.thinnest_member,
        solid_surface.with_drawn_sizes().drawn.thinnest_member,
    )
    assert before is not None and before.value == pytest.approx(0.94 * member, rel=0.02)
    assert after is None or after.value >= member
    wider = surface(beam(MPI.COMM_SELF), plate(1.2 * member, 0.0), member)
    assert wider.with_drawn_sizes() is wider


@pytest.mark.parametrize(("depth", "stays"), [(0.0118, False), (0.01, True)])
def test_windows_in_which_no_member_fits_are_closed(depth: float, stays: bool) -> None:
    """A hollow that opens through a face by 4.4 mm, and one that opens by 13 mm."""
    middle = np.array([0.08, 0.003, 0.02 - depth])

    def hollow(x: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.norm(x - middle, axis=1) - 0.012)

    solid_surface = surface(beam(MPI.COMM_SELF), hollow)
    face = np.linspace(-0.006, 0.006, 41)
    face_points = np.stack(np.meshgrid(0.08 + face, 0.003 + face, [0.02], indexing="ij"), axis=-1)
    assert np.any(solid_surface.field(face_points.reshape(-1, 3)) < 0.0) == stays
    assert len(solid_surface.part.cavities) == (not stays)
    assert solid_surface.walls.thickness[0] > 0.999 * MEMBER


def test_windows_that_end_in_points_are_blunted() -> None:
    """In the face of what is told only places where a disc fits stay open."""
    options = replace(SURFACES, settling=0)  # thin places have a test of their own

    def pointed(x: np.ndarray) -> np.ndarray:
        hollow = np.max([np.abs(x[:, 0] - 0.08) / 4.0, *np.abs(x[:, 1:]).T], axis=0) - 0.012
        lens = (np.abs(x[:, 1]) + 0.3 * np.abs(x[:, 0] - 0.08) - 0.01) / np.hypot(1.0, 0.3)
        return np.where(x[:, 2] > 0.0, np.minimum(hollow, lens), hollow)

    computed = surface(beam(MPI.COMM_SELF), pointed, options=options)._with_values_of(pointed)
    grid = np.arange(-80, 81) * 5e-4
    face = np.stack(np.meshgrid(0.08 + grid, grid, [0.02], indexing="ij"), axis=-1)

    def least(surface: Surface) -> tuple[float, float]:
        """Length of the windows, and diameter of a disc that fits wherever they are open [m]."""
        open_ = surface.field(face.reshape(-1, 3)).reshape(161, 161) < 0.0
        depth = 5e-4 * distance_transform_edt(open_)
        for diameter in np.arange(12, 1, -1) * 5e-4:
            away = distance_transform_edt(depth < 0.5 * diameter)
            if np.max(away[open_]) * 5e-4 <= 0.5 * diameter + 5e-4:
                break
        return float(5e-4 * np.sum(np.any(open_, axis=1))), float(diameter)

    ended = computed.with_drawn_sizes()
    (long, sharp), (short, blunt) = least(computed), least(ended)
    # the circle that touches both sides, inclined by arctan(0.3), is the end
    tip = 0.5 * MEMBER * (np.hypot(1.0, 0.3) / 0.3 - 1.0)
    assert long == pytest.approx(0.02 / 0.3, abs=1e-3) and sharp < 0.4 * MEMBER
    assert short == pytest.approx(0.02 / 0.3 - 2.0 * tip, abs=0.25 * MEMBER)  # a sample
    assert blunt > 0.9 * MEMBER
    assert ended.walls.least > 0.998 * MEMBER


def test_pockets_that_are_too_narrow_go() -> None:
    """A pinhole, a slot, and all that is beside a solid region; a wide trough stays."""

    def hollows(x: np.ndarray) -> np.ndarray:
        trough = np.max([np.abs(x[:, 1]) - 0.0103, -0.0097 - x[:, 2], x[:, 0] - 0.0704], axis=0)
        pinhole = np.hypot(x[:, 0] - 0.085, x[:, 1]) - 0.4 * MEMBER
        slot = np.maximum(np.abs(x[:, 0] - 0.12) - 0.4 * MEMBER, np.abs(x[:, 1]) - 0.012)
        return np.asarray(np.min([trough, pinhole, slot], axis=0))

    solid_surface = surface(beam(MPI.COMM_SELF), hollows)
    x = np.array([[x, 0.0, z] for x in (0.05, 0.0205, 0.085, 0.12) for z in (-0.005, 0.005)])
    assert np.all(hollows(x) < 0.0)
    np.testing.assert_array_equal(solid_surface.field(x) < 0.0, [True] * 2 + [False] * 6)


@pytest.mark.parametrize(("angle", "least"), [(25.0, 0.009), (45.0, 0.006)])
def test_a_pointed_hollow_ends_in_a_wall(angle: float, least: float) -> None:
    """All samples around its tip have inclined normals; the nearest is at most half apart."""
    slope = np.tan(np.radians(angle))

    def hollow(x: np.ndarray) -> np.ndarray:
        away = np.hypot(x[:, 0] - 0.0813, x[:, 1] - 0.0017)
        return (least - 0.02 - x[:, 2] + slope * away) / np.hypot(1.0, slope)

    solid_surface = surface(beam(MPI.COMM_SELF), hollow, 0.01)
    line = np.column_stack([np.tile([0.0813, 0.0017], (2001, 1)), np.linspace(-0.02, 0.0, 2001)])
    tip = line[np.argmax(solid_surface.field(line) < 0.0), 2] + 0.02
    assert tip > 0.98 * solid_surface.member
    spacing = 0.5 * np.sqrt(2.0) * 0.25 * solid_surface.member
    if angle < 30.0:  # else none is as thin any more
        assert len(solid_surface.walls.thickness) > 20
        assert 0.99 * tip < solid_surface.walls.thickness[0] < tip + slope * spacing


@pytest.mark.parametrize(("length", "left"), [(1.6, 0.87), (6.0, 1.0)])
def test_short_waves_become_smaller_as_a_surface_moves(length: float, left: float) -> None:
    """By an eighth where they are too short for tetrahedra; a long one stays."""
    wave = 2.0 * np.pi / (length * MEMBER)

    def wavy(x: np.ndarray) -> np.ndarray:
        return np.asarray(-x[:, 2] + 0.04 * MEMBER * np.cos(wave * x[:, 0]))

    solid_surface = surface(beam(MPI.COMM_SELF), wavy)
    x = np.column_stack([np.linspace(0.05, 0.11, 200), np.zeros((200, 2))])
    heights = [
        s.field(x) for s in (solid_surface, solid_surface.moved(np.zeros(solid_surface.n_offsets)))
    ]
    before, after = (np.cos(wave * x[:, 0]) @ (z - z.mean()) for z in heights)
    assert after == pytest.approx(left * before, rel=0.05)


def test_a_bar_at_an_edge_is_as_thick_as_the_ball_amid_it() -> None:
    """Those in the wedges beside it are smaller, and no members."""
    radius = 0.51 * MEMBER

    def quarter(x: np.ndarray) -> np.ndarray:
        bar = (1.0 + np.sqrt(2.0)) * radius - np.hypot(x[:, 1] - 0.02, x[:, 2] - 0.02)
        return np.where(np.abs(x[:, 0] - 0.08) < 0.04, bar, 0.02)

    solid_surface = surface(beam(MPI.COMM_SELF), quarter)
    assert solid_surface.sides is not None
    walls = solid_surface.sides.walls(
        solid_surface.field, solid_surface._slopes, 1.2 * MEMBER, 1.5 * MEMBER
    )
    amid = np.abs(walls.middles[:, 0] - 0.08) < 0.03
    line = np.linspace(0.02, 0.01, 2001)
    inside = solid_surface.field(np.column_stack([np.full(2001, 0.08), line, line])) > 0.0
    exact = 2.0 * np.sqrt(2.0) * (0.02 - line[inside].min()) / (1.0 + np.sqrt(2.0))
    assert np.count_nonzero(amid) > 20
    np.testing.assert_allclose(walls.thickness[amid], exact, rtol=0.05)


def test_windows_are_where_they_pay_and_walls_go_on_around_them() -> None:
    """Two in a plate, as far apart as members; none at its edge, nor where they cost."""
    solid_surface = surface(beam(MPI.COMM_SELF), plate(0.9 * MEMBER, 0.0), 0.75 * MEMBER)
    corners = [0.03, -0.02, -0.004], [0.13, 0.02, 0.004]
    cells = np.random.default_rng(1).uniform(*corners, (40_000, 3))
    places = np.array([[0.06, 0.0, 0.0], [0.1, 0.003, 0.0], [0.032, 0.0, 0.0]])
    changes = np.where(cKDTree(places).query(cells)[0] < 0.004, -1e-4, 1e-4)
    (opened, count), (fewer, one) = solid_surface.with_windows(cells, changes)
    assert (count, one) == (2, 1)
    np.testing.assert_array_equal(solid_surface.field(places) > 0.0, [True] * 3)
    np.testing.assert_array_equal(opened.field(places) > 0.0, [False, False, True])
    assert np.count_nonzero(fewer.field(places[:2]) < 0.0) == 1
    assert opened.walls.least > 0.999 * solid_surface.member
    assert opened.part.volume < fewer.part.volume < solid_surface.part.volume
    assert not list(solid_surface.with_windows(cells, np.abs(changes)))


def test_balls_that_touch_a_surface() -> None:
    """Between two planes that are not parallel, exactly, and none where larger balls fit."""
    x = np.column_stack([np.linspace(0.0, 1.0, 5), np.zeros((5, 2))])
    u = np.linspace(-1.0, 2.0, 31)
    slope = np.array([0.1, 0.0, -1.0]) / np.hypot(0.1, 1.0)  # into the material below
    at = np.stack([*np.meshgrid(u, u, indexing="ij"), 0.0 * np.ones((31, 31))], axis=-1)
    at = at.reshape(-1, 3)
    at[:, 2] = 0.3 + 0.1 * at[:, 0]
    radius, end = tangent_balls(
        x, np.tile([0.0, 0.0, 1.0], (5, 1)), at, np.tile(slope, (961, 1)), 1.0
    )
    # where the ball's centre is as far from both
    exact = (0.3 + 0.1 * x[:, 0]) / (1.0 + np.hypot(0.1, 1.0))
    np.testing.assert_allclose(radius, exact, rtol=1e-12)
    assert np.all(end >= 0)
    none = tangent_balls(x, np.tile([0.0, 0.0, 1.0], (5, 1)), at, np.tile(slope, (961, 1)), 0.1)
    np.testing.assert_array_equal(none, (np.full(5, 0.1), np.full(5, -1)))


@pytest.mark.slow
@pytest.mark.mpi
def test_steps_lower_psi_and_tell_what_the_solid_is(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """On any number of ranks alike, beside a finer mesh; the file is closed."""
    steps = 2 if comm.size == 1 else 1
    results = []
    for ranks in (comm, MPI.COMM_SELF)[: comm.size]:
        problem = beam(ranks)
        start = surface(problem, share=0.95, options=replace(SURFACES, most_tetrahedra=5_000))
        with pytest.warns(ffr.PartWarning, match="still changes by .* whose value is reported"):
            ended = move_boundary(problem, start, volume=0.9, iterations=steps, progress=False)
        results.append(ended)
    result = results[0]
    assert result.history["psi"] == pytest.approx(results[-1].history["psi"], rel=1e-6)
    if comm.size > 1:  # verification and files on several ranks are tested in tests/part
        return
    assert result.psi < 0.95 * result.history["psi"][0]
    assert result.history["volume"][-1] < 0.9 * 1.01
    solid = result.part()
    assert result.history["narrowest"][-1] > 0.998 * MEMBER
    verification = solid.verify(result.problem, result.evaluation, progress=False, tolerance=0.05)
    assert verification.fitted[0].psi == result.psi  # told by that mesh, and not computed again
    assert (
        verification.fitted[1].bodies["beam"].cells
        > 1.8 * verification.fitted[0].bodies["beam"].cells
    )
    (path,) = solid.write(shared_tmp_path / "beam.stl")
    assert pyvista.read(path).clean().is_manifold
    expected = result.summary()["volume"]
    assert verification.fitted[0].bodies["beam"].volume == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("finer", "reported"), [((1.2, 1.3), 1.3), ((1.2, MemoryError()), 1.2), ((1.0001, 9.9), 1.0001)]
)
def test_solids_are_cut_finer_until_psi_stands(
    monkeypatch: pytest.MonkeyPatch, finer: tuple[Any, ...], reported: float
) -> None:
    """Twice at most, and no finer than there is memory for."""
    results = iter(finer)

    def trial(psi: float) -> Any:
        return SimpleNamespace(evaluation=SimpleNamespace(psi=psi), release=str, boundaries={})

    def cut(*_: Any) -> Any:
        if isinstance(psi := next(results), Exception):
            raise psi
        return trial(psi)

    monkeypatch.setattr(Descent, "resolved", cut)
    finest, change = Descent(beam(MPI.COMM_SELF), {}, {}, {}).finer(trial(1.0))
    assert finest.evaluation.psi == reported
    steps = [1.0, *(psi for psi in finer[: 1 + (reported == 1.3)])]
    assert change == pytest.approx(abs(steps[-2] / steps[-1] - 1.0))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:boundary. psi")
def test_a_design_in_space_ends_with_steps_of_its_surface(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A run that goes on finds them again."""
    # as fine as it takes is tested above
    coarse = partial(Surface.of, options=replace(SURFACES, tetrahedra=1200, most_tetrahedra=5_000))
    monkeypatch.setattr(Surface, "of", staticmethod(coarse))
    problem = beam(MPI.COMM_SELF)
    design = ffr.DensityDesign(problem.flexible["beam"].domain)
    run = {"volume": 0.85, "iterations": 15, "progress": False, "mode_tolerance": None}
    run |= {"boundary": 1, "output": tmp_path}
    result = ffr.optimize(problem, design, **run)
    assert result.moved is not None and not result.moved.materials
    assert result.part() is result.moved.part("beam")
    assert result.moved.psi < result.moved.history["psi"][0]
    again = ffr.optimize(problem, design, resume=True, **run).moved
    assert again is not None and again.psi == pytest.approx(result.moved.psi, rel=1e-12)
    np.testing.assert_array_equal(again.history["cells"], result.moved.history["cells"])


def test_what_has_no_surface_that_moves() -> None:
    problem = beam(MPI.COMM_SELF)
    domain = problem.flexible["beam"].domain
    full = ffr.Solid(domain, lambda x: np.ones(len(x)))
    with pytest.raises(ValueError, match="no zero surface to move"):
        Surface.of(full, MEMBER)
    with pytest.raises(TypeError, match="a Surface"):
        move_boundary(problem, full)
    refused = (-1.0, "surface: member"), (1e-7, "take a larger member"), (0.05, "thicker than the")
    for member, why in refused:
        with pytest.raises(ValueError, match=why):
            Surface.of(full, member)
    with pytest.warns(ffr.PartWarning, match="may miss members"):
        surface(problem, member=0.6 * MEMBER)
    with pytest.raises(ValueError, match="give normals"):
        Surface.of(full, MEMBER, mirrors=[ffr.Mirror((0.0, 0.0), (0.0, 1.0))])
