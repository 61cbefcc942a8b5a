# SPDX-License-Identifier: MIT
"""Pictures: the right parts in the right places, judged by geometry and by pixels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from subprocess import CalledProcessError

from mpi4py import MPI

import ezdxf
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from shared.problems import four_bar, slider_crank
from shared.rods import STEEL

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting import (
    animate_motion,
    mesh_grid,
    plot_design,
    plot_history,
    plot_modes,
    plot_part,
    plot_scene,
)
from dolfinx_ffr.plotting.drawn_mesh import DrawnMesh
from dolfinx_ffr.plotting.part_view import STEEL as MATERIAL
from dolfinx_ffr.plotting.scene import Scene
from dolfinx_ffr.plotting.style import ACCENTS, GRAY, RED

LENGTH, HEIGHT = 0.4, 0.04
MESHES = [(cell, order) for cell in ("quadrilateral", "triangle") for order in (1, 2)]


def rod(
    comm: MPI.Comm, cell: str = "quadrilateral", order: int = 1, elements: tuple[int, int] = (40, 4)
) -> ffr.Domain:
    return ffr.Domain.rectangle(comm, LENGTH, HEIGHT, elements=elements, cell=cell, order=order)


def ladder(domain: ffr.Domain) -> NDArray[np.float64]:
    """Two flanges, rungs and massive ends, the rest at a small density."""
    x, y = domain.centroids.T
    solid = (np.abs(y) > 0.009) | (np.mod(x, 0.1) < 0.02) | (np.abs(x - 0.2) > 0.18)
    return np.where(solid | ~domain.design_cells, 1.0, 1e-3)


@dataclass
class Solved:
    problem: ffr.Problem
    evaluation: ffr.Evaluation

    @property
    def body(self) -> ffr.FlexibleBody:
        return self.problem.flexible["rod"]


def solve(problem: ffr.Problem) -> Solved:
    return Solved(problem, problem.value(ladder(problem.flexible["rod"].domain)))


@pytest.fixture(scope="module")
def solved() -> Solved:
    return solve(slider_crank(MPI.COMM_WORLD, (40, 4), modes=6))


@pytest.fixture(scope="module")
def alone() -> Solved:
    """The same on each rank by itself."""
    return solve(slider_crank(MPI.COMM_SELF, (40, 4), modes=6))


def pixels(path: Path, frame: int = 0) -> NDArray[np.float64]:
    with Image.open(path) as image:
        image.seek(frame)
        return np.asarray(image.convert("RGB"), dtype=np.float64)


def near(picture: NDArray[np.float64], color: str, tolerance: float = 25.0) -> NDArray[np.bool_]:
    """Which pixels have a colour."""
    rgb = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)])
    return np.max(np.abs(picture - rgb), axis=2) < tolerance


def colorful(picture: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which pixels are clearly no shade of gray."""
    return np.ptp(picture, axis=2) > 60.0


def piece_areas(drawn: DrawnMesh) -> NDArray[np.float64]:
    x, y = np.moveaxis(drawn.points[drawn.pieces], 2, 0)
    x2, y2 = np.roll(x, -1, axis=1), np.roll(y, -1, axis=1)
    return 0.5 * np.sum(x * y2 - x2 * y, axis=1)


def press() -> Solved:
    """The rod on a spring, with a carriage, a wheel and a strut: joints and forces of all kinds."""
    frame = ffr.ChordFrame("left", "right")
    body = ffr.FlexibleBody(rod(MPI.COMM_SELF), STEEL, frame=frame, modes=4)
    ends, slope = {"left": (-0.05, 0.0), "right": (0.05, 0.0)}, ffr.Ground(angle=0.1)
    mechanism = ffr.Mechanism(
        placements={
            "rod": ffr.Placement(),
            "carriage": ffr.Placement((0.45, 0.0)),
            "wheel": ffr.Placement((0.1, -0.2)),
            "flag": ffr.Placement((0.45, 0.0)),
        },
        joints=[
            ffr.Revolute(("rod", "right"), ("carriage", "left"), name="pin"),
            ffr.Translational(("carriage", "right"), slope, (1.0, -0.1), name="rails"),
            ffr.Revolute(("wheel", "left"), ffr.Ground((0.05, -0.2)), name="axle"),
            ffr.mechanism.AngleCoupling(("wheel", "left"), ("rod", "left"), -2.0, name="gear"),
            ffr.Distance(("rod", "left"), ffr.Ground((-0.2, -0.1)), name="strut"),
            ffr.Weld(("flag", "right"), ("carriage", "right"), name="weld"),
        ],
        forces=[
            ffr.SpringDamper(("rod", "left"), ffr.Ground((0.0, 0.2)), 1e3, name="spring"),
            ffr.TorsionalSpringDamper(("rod", "left"), ffr.Ground((9.0, 9.0)), 10.0),
            ffr.Force(("rod", "right"), lambda t: 50.0 * np.sin(40.0 * t)),
        ],
        gravity=(0.0, -9.81),
    )
    piece = ffr.VolumeIntegrals.rigid(0.5, (0, 0), 1e-3, ends)
    bodies = {"rod": body, **dict.fromkeys(("carriage", "wheel", "flag"), piece)}
    integrator = ffr.GeneralizedAlpha(0.2, 100)
    return solve(ffr.Problem(bodies, mechanism, integrator, ffr.IntegralCompliance()))


@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "order"), MESHES)
def test_gathered_mesh_is_the_body(comm: MPI.Comm, cell: str, order: int) -> None:
    domain = rod(comm, cell, order)
    drawn = DrawnMesh.of(domain)
    centroids = domain.on_rank_0(domain.centroids)
    if comm.rank > 0:
        assert len(drawn.points) == len(drawn.pieces) == len(centroids) == 0
        return
    areas = np.abs(piece_areas(drawn))
    assert len(drawn.pieces) == domain.n_cells_global * order**2
    assert np.sum(areas) == pytest.approx(LENGTH * HEIGHT, rel=1e-12)
    middles = drawn.points[drawn.pieces].mean(axis=1)
    middles_of_parents = np.zeros_like(centroids)
    np.add.at(middles_of_parents, drawn.parents, middles * areas[:, None])
    cell_area = np.bincount(drawn.parents, areas)
    assert middles_of_parents / cell_area[:, None] == pytest.approx(centroids, abs=1e-13)

    def length(lines: NDArray[np.int64]) -> float:
        ends = drawn.points[lines]
        return float(np.sum(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)))

    assert length(drawn.outline) == pytest.approx(2.0 * (LENGTH + HEIGHT), rel=1e-12)
    for name, x in (("left", 0.0), ("right", LENGTH)):
        assert length(drawn.interfaces[name]) == pytest.approx(HEIGHT, rel=1e-12)
        assert drawn.points[drawn.interfaces[name]][..., 0] == pytest.approx(x, abs=1e-14)


@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "order"), MESHES)
def test_gathered_displacements_follow_the_field(comm: MPI.Comm, cell: str, order: int) -> None:
    domain = rod(comm, cell, order)
    drawn = DrawnMesh.of(domain)
    x, y = domain.space.tabulate_dof_coordinates()[:, :2].T
    n = 2 * domain.space.dofmap.index_map.size_local

    def field(x: NDArray, y: NDArray) -> NDArray:
        return np.stack([1.0 + 2.0 * x - y, x**order + 3.0 * y**order], axis=-1)

    block = np.column_stack([field(x, y).ravel()[:n], np.ones(n)])
    gathered = drawn.displacements(block)
    assert gathered.shape == (len(drawn.points), 2, 2)
    assert gathered[:, :, 0] == pytest.approx(field(*drawn.points.T), abs=1e-13)
    assert gathered[:, :, 1] == pytest.approx(1.0, abs=1e-14)


@pytest.mark.mpi
def test_curved_cells_are_drawn_with_middle_nodes(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    path, radius = shared_tmp_path / "disc.dxf", 0.5
    if comm.rank == 0:
        drawing = ezdxf.new("R2010")
        for layer, begin in (("rim", -90.0), ("rest", 90.0)):
            look = {"layer": layer}
            drawing.modelspace().add_arc((0, 0), radius, begin, begin + 180.0, dxfattribs=look)
        drawing.saveas(path)
    comm.Barrier()
    rims = {"rim": "rim"}
    domain = ffr.Domain.from_outline(comm, path, interfaces=rims, size=0.2, unit="m", order=2)
    drawn = DrawnMesh.of(domain)
    if comm.rank > 0:
        return
    assert len(drawn.pieces) == 4 * domain.n_cells_global
    rim = drawn.points[drawn.outline] - domain.interfaces["rim"].center
    assert np.linalg.norm(rim, axis=2) == pytest.approx(radius, rel=1e-9)
    # the drawn pieces fill the polygon through all nodes on the rim, the middle ones included
    across = np.abs(rim[:, 0, 0] * rim[:, 1, 1] - rim[:, 1, 0] * rim[:, 0, 1])
    assert np.sum(np.abs(piece_areas(drawn))) == pytest.approx(0.5 * np.sum(across), rel=1e-12)
    corners = 0.5 * len(rim)
    assert np.sum(across) / 2 > 1.005 * corners / 2 * radius**2 * np.sin(2 * np.pi / corners)


def test_shade_is_the_density(tmp_path: Path) -> None:
    domain = rod(MPI.COMM_SELF)
    for density in (0.0, 0.25, 0.8):
        path = plot_design(domain, np.full(domain.n_cells, density), tmp_path / "even.png")
        picture = pixels(path)
        frame = near(picture, ACCENTS[0]) | near(picture, ACCENTS[1])
        rows, columns = np.flatnonzero(frame.any(axis=1)), np.flatnonzero(frame.any(axis=0))
        # the interfaces are the tallest coloured things; go to the middle between them
        row = rows[0] + 20
        inside = picture[row, columns[0] + 60 : columns[0] + 260]
        # edges between cells are smoothed
        assert np.median(inside, axis=0) == pytest.approx(255.0 * (1.0 - density), abs=1.0)


def test_interfaces_are_marked_in_colour(tmp_path: Path) -> None:
    domain = rod(MPI.COMM_SELF)
    picture = pixels(plot_design(domain, np.zeros(domain.n_cells), tmp_path / "x.png"))
    left, right = (near(picture, color).sum(axis=0) for color in ACCENTS[:2])
    first, second = (np.flatnonzero(count > 0.9 * count.max()) for count in (left, right))
    assert len(first) >= 3 and len(second) >= 3
    width = picture.shape[1]
    assert first.max() < 0.15 * width and second.min() > 0.8 * width


def test_several_designs_stand_under_each_other(tmp_path: Path) -> None:
    domain = rod(MPI.COMM_SELF)
    solid, void = np.ones(domain.n_cells), np.zeros(domain.n_cells)
    one = pixels(plot_design(domain, {"solid": solid}, tmp_path / "1.png"))
    two = pixels(plot_design(domain, {"void": void, "solid": solid}, tmp_path / "2.png"))
    assert two.shape[1] == one.shape[1]
    assert two.shape[0] > one.shape[0] + 90
    dark = near(two, "#000000", 60.0).sum(axis=1) > 0.6 * two.shape[1]
    assert np.flatnonzero(dark).min() > 0.4 * two.shape[0]  # the solid one is the lower one


@pytest.mark.mpi
def test_design_looks_the_same_on_any_number_of_ranks(
    comm: MPI.Comm, shared_tmp_path: Path, tmp_path: Path
) -> None:
    def draw(over: MPI.Comm, path: Path) -> Path:
        domain = rod(over, "triangle", 2)
        return plot_design(domain, ladder(domain), path, title="Rod")

    on_all_ranks = draw(comm, shared_tmp_path / "together.png")
    assert on_all_ranks == shared_tmp_path / "together.png"
    assert_same_picture(on_all_ranks, draw(MPI.COMM_SELF, tmp_path / "alone.png"))


def assert_same_picture(one: Path, other: Path, frame: int = 0) -> None:
    """Demand that two pictures differ at most by a few pixels on edges."""
    a, b = pixels(one, frame), pixels(other, frame)
    assert a.shape == b.shape
    assert np.ptp(a) > 100.0  # not blank
    assert np.mean(np.max(np.abs(a - b), axis=2) > 8.0) < 1e-4


@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "order"), [*MESHES, ("hexahedron", 1), ("tetrahedron", 1)])
def test_grid_for_pyvista_is_the_body(comm: MPI.Comm, cell: str, order: int) -> None:
    if cell in ("hexahedron", "tetrahedron"):
        size = (LENGTH, HEIGHT, HEIGHT)
        domain = ffr.Domain.box(comm, *size, elements=(8, 1, 1), cell=cell)
    else:
        domain = rod(comm, cell, order)
    x = domain.centroids[:, 0] / LENGTH
    grid = mesh_grid(domain, {"density": x})
    exact = LENGTH * HEIGHT ** (domain.dimension - 1)
    weighed = domain.sum(x * domain.cell_volumes)  # on all ranks
    assert (grid is None) == (comm.rank > 0)
    if grid is None:
        return
    kind, accuracy = ("Area", 1e-12) if domain.dimension == 2 else ("Volume", 1e-6)
    sizes = np.abs(grid.compute_cell_sizes(length=False).cell_data[kind])
    assert np.sum(sizes) == pytest.approx(exact, rel=accuracy)
    assert np.sum(sizes * grid.cell_data["density"]) == pytest.approx(weighed, rel=accuracy)


def some_history(rows: int = 30) -> dict[str, NDArray[np.float64]]:
    k = np.arange(rows, dtype=float)
    return {
        "iteration": k,
        "psi": 3e-5 + 4e-5 * np.exp(-k / 5),
        "volume": 0.48 + 0.3 * np.exp(-k / 4),
        "gray": 0.05 + 0.2 * np.exp(-k / 9),
        "frequency": 1200.0 + k,
        "step": 0.5 * 0.9**k,
        "seconds": k,
    }


def test_history_has_curves_and_a_bound(tmp_path: Path) -> None:
    history = some_history()
    bounded = pixels(plot_history(history, tmp_path / "a.png", psi_solid=5.8e-5, volume_bound=0.5))
    assert near(bounded, "#0b62a4").sum() > 2000  # the curves
    assert near(bounded, "#c8352b").sum() > 200  # the bound
    without = pixels(plot_history(history, tmp_path / "c.png"))
    assert near(without, "#c8352b").sum() == 0


def test_history_draws_parameters_between_their_bounds(tmp_path: Path) -> None:
    """On the scale of each; the lines of the bounds are there only where these are known."""
    k = np.arange(30.0)
    settings = {"radius": (0.1, 0.08, 0.12, "m"), "stiffness": (40.0, 10.0, 200.0, "N/m", "log")}
    columns = {"parameter radius [m]": 0.1 + 5e-4 * k, "parameter stiffness [N/m]": 40.0 + 5.0 * k}
    history = {"psi": some_history()["psi"], **columns}
    parameters = ffr.Parameters(**settings)
    bounded = pixels(plot_history(history, tmp_path / "a.png", parameters=parameters))
    free = pixels(plot_history(history, tmp_path / "b.png"))
    for color in ACCENTS[:2]:
        assert near(bounded, color).sum() > 300 and near(free, color).sum() > 300
    lines = [(near(each, GRAY).sum(axis=1) > 200).sum() for each in (bounded, free)]
    assert lines[0] >= lines[1] + 2


def test_modes_do_not_depend_on_their_signs(solved: Solved, tmp_path: Path) -> None:
    reduced = solved.evaluation.bodies["rod"]
    a = pixels(plot_modes(solved.body, reduced, tmp_path / "a.png", title="Modes"))
    reduced.basis.shapes[:, 1::2] *= -1.0
    try:
        b = pixels(plot_modes(solved.body, reduced, tmp_path / "b.png", title="Modes"))
    finally:
        reduced.basis.shapes[:, 1::2] *= -1.0
    assert np.array_equal(a, b)
    # three static and six normal modes in three columns: something colourful in each of nine places
    colored = colorful(a)[int(0.2 * a.shape[0]) :]
    for band in np.array_split(colored, 3, axis=0):
        for place in np.array_split(band, 3, axis=1):
            assert np.count_nonzero(place) > 1000


@pytest.mark.mpi
def test_energy_of_the_cells_adds_up(solved: Solved) -> None:
    body, evaluation = solved.body, solved.evaluation
    reduced, trajectory = evaluation.bodies["rod"], evaluation.trajectory
    total = trajectory.strain_energy("rod")
    for step in (60, 97, 140):
        field = reduced.basis.shapes @ trajectory.elastic("rod")[step]
        energy = body.elasticity.strain_energy(reduced.density, field)
        assert np.all(energy >= 0.0)
        assert body.domain.sum(energy) == pytest.approx(total[step], rel=1e-9)


def gathered(case: Solved, steps: list[int]) -> Scene:
    return Scene.gather(case.problem, case.evaluation, np.array(steps), energy=False)


def test_magnified_deformation_leaves_the_joints_where_they_are(solved: Solved) -> None:
    scene = gathered(solved, [60, 97, 140])
    trajectory, body = solved.evaluation.trajectory, scene.bodies["rod"]
    for i, step in enumerate(scene.steps):
        for marker in ("left", "right"):
            path = trajectory.marker_path("rod", marker)[step]
            for magnification in (1.0, 1000.0):
                drawn = body.marker(marker, i, magnification)
                assert drawn == pytest.approx(path, abs=1e-12)
        away = body.points(i, 1000.0) - body.points(i, 0.0)
        assert np.max(np.linalg.norm(away, axis=1)) == pytest.approx(1000.0 * body.deflection(i))
        assert body.deflection(i) > 1e-8


def test_magnified_deformation_does_not_depend_on_the_frame(solved: Solved) -> None:
    """Chord and tangent frame span the same deformations; the picture must be the same."""
    in_tangent_frame = solve(
        slider_crank(MPI.COMM_SELF, (40, 4), modes=6, frame=ffr.TangentFrame("left"))
    )
    a, b = (
        gathered(solved, [60, 97]).bodies["rod"],
        gathered(in_tangent_frame, [60, 97]).bodies["rod"],
    )
    for i in range(2):
        colored = 1000.0 * a.deflection(i)
        away = np.max(np.abs(a.points(i, 1000.0) - b.points(i, 1000.0)))
        assert away < 0.02 * colored


def test_crank_is_found_from_its_motion(solved: Solved) -> None:
    (arm,) = gathered(solved, [0]).arms.values()
    assert arm.center == pytest.approx([0.0, 0.0], abs=1e-12)
    assert np.linalg.norm(arm.ring - arm.center, axis=1) == pytest.approx(0.1, rel=1e-12)
    assert arm.marker.name == "crank pin"


def test_scene_shows_joints_and_springs_of_every_kind(tmp_path: Path) -> None:
    press_ = press()
    scene = gathered(press_, [0, 100])
    points = scene.visible_points(1.0, lambda point: point)
    low, high = points.min(axis=0), points.max(axis=0)
    assert low == pytest.approx([-0.2, -0.2], abs=0.06)  # foot of the strut, axle of the wheel
    assert high == pytest.approx([0.5, 0.2], abs=0.06)  # carriage, top of the spring
    picture = pixels(plot_scene(press_.problem, press_.evaluation, tmp_path / "x.png", time=0.1))
    assert near(picture, "#b6bec8", 8.0).sum() > 300  # the block of the carriage
    animate_motion(press_.problem, press_.evaluation, tmp_path / "x.gif", frames=2)


def test_scene_shows_crank_design_and_names(solved: Solved, tmp_path: Path) -> None:
    draw = partial(plot_scene, solved.problem, solved.evaluation, tmp_path / "x.png", time=0.9)
    picture = pixels(draw())
    assert near(picture, "#57606a").sum() > 3000  # the crank
    assert near(picture, "#1e1e1e", 12.0).sum() > 10000  # the design
    assert colorful(picture).sum() == 0
    assert colorful(pixels(draw(color="energy"))).sum() > 10000


def test_void_is_left_out(solved: Solved, tmp_path: Path) -> None:
    """The dark share of the body's picture is that of the solid cells."""
    domain = solved.body.domain
    full = solved.problem.value(np.ones(domain.n_cells))
    counts = []
    for evaluation in (solved.evaluation, full):
        path = plot_scene(solved.problem, evaluation, tmp_path / "x.png", time=0.9)
        counts.append(np.count_nonzero(near(pixels(path), "#1e1e1e", 12.0)))
    share = domain.sum((ladder(domain) > 0.5) * domain.cell_volumes) / domain.area
    assert counts[0] / counts[1] == pytest.approx(share, abs=0.04)


def test_bodies_without_mesh_and_joints_that_stay_closed(tmp_path: Path) -> None:
    """A four-bar linkage with a rigid crank that a motor turns."""
    problem = four_bar(MPI.COMM_SELF, ffr.IntegralCompliance(), steps=50)
    x = {name: np.ones(body.domain.n_cells) for name, body in problem.flexible.items()}
    evaluation = problem.value(x)
    scene = Scene.gather(problem, evaluation, np.array([0, 50]), energy=True)
    assert not scene.arms
    for i in range(2):  # in the picture, however much is magnified
        for joint in problem.mechanism.joints[1:3]:
            ends = [scene.position(marker, i, 500.0) for marker in joint.markers]
            assert ends[0] == pytest.approx(ends[1], abs=1e-9)
    picture = pixels(plot_scene(problem, evaluation, tmp_path / "x.png", color="energy"))
    assert near(picture, "#57606a").sum() > 3000  # the bar
    assert colorful(picture).sum() > 5000  # the coupler and the rocker


@pytest.mark.slow
def test_film_has_its_frames_and_shows_the_motion(solved: Solved, tmp_path: Path) -> None:
    settings = {"frames": 11, "frames_per_second": 10.0, "title": "Slider-crank"}
    path = tmp_path / "new" / "motion.gif"
    animate_motion(solved.problem, solved.evaluation, path, **settings)
    with Image.open(path) as film:
        assert film.n_frames == 11
        assert film.info["duration"] == 100
        assert film.info["loop"] == 0
    pictures = [pixels(path, i) for i in range(11)]
    for picture in pictures:
        assert picture.shape == pictures[0].shape
        assert np.all(picture[0] == 255.0)
        assert colorful(picture).sum() > 3000  # rod and colour bar
    for a, b in pairwise(pictures[1:-1]):  # it moves from rest to rest
        assert np.mean(np.any(a != b, axis=2)) > 0.005
    # what stands still does not flicker: the heading above, the axes below
    assert all(np.array_equal(p[:35, :400], pictures[0][:35, :400]) for p in pictures)
    # the right end of the slider's block, which nothing covers, moves like the rod's end
    ends = [np.flatnonzero(near(p, "#b6bec8", 8.0).sum(axis=0) > 8)[-1] for p in pictures]
    steps = np.round(np.linspace(0, 200, 11)).astype(int)
    slider = solved.evaluation.trajectory.marker_path("rod", "right")[steps, 0]
    fit = np.polynomial.Polynomial.fit(slider, ends, 1)
    assert np.max(np.abs(fit(slider) - ends)) < 2.0  # pixels
    assert np.ptp(ends) > 150.0


@pytest.mark.slow
@pytest.mark.mpi
def test_film_looks_the_same_on_any_number_of_ranks(
    comm: MPI.Comm, solved: Solved, alone: Solved, shared_tmp_path: Path, tmp_path: Path
) -> None:
    on_all_ranks, by_itself = (
        animate_motion(case.problem, case.evaluation, path, frames=5)
        for case, path in ((solved, shared_tmp_path / "a.gif"), (alone, tmp_path / "b.gif"))
    )
    for frame in range(5):
        assert_same_picture(on_all_ranks, by_itself, frame)


def test_film_by_ffmpeg_gets_every_pixel(
    solved: Solved, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ValueError, match=r"ffmpeg.*end the name in \.gif"):
        animate_motion(solved.problem, solved.evaluation, tmp_path / "x.mp4", frames=3)
    program = tmp_path / "ffmpeg"
    program.write_text(
        f'#!/bin/sh\necho "$@" > {tmp_path}/called\nfor file; do :; done\n'
        f'/bin/cat > "$file"\n/bin/cp "$file" {tmp_path}/film\n'
    )
    program.chmod(0o755)
    animate_motion(solved.problem, solved.evaluation, tmp_path / "x.mp4", frames=3)
    size = (tmp_path / "called").read_text().split(" -s ")[1].split()[0]
    width, height = (int(n) for n in size.split("x"))
    assert width % 2 == 0 and height % 2 == 0
    film = np.fromfile(tmp_path / "film", dtype=np.uint8)
    assert film.tobytes() == (tmp_path / "x.mp4").read_bytes()
    assert film.size == 3 * width * height * 4
    assert np.all(film.reshape(3, height, width, 4)[:, 0] == 255)
    program.write_text("#!/bin/sh\n/bin/cat > /dev/null\necho broken >&2\nexit 3\n")
    with pytest.raises((OSError, CalledProcessError)):
        animate_motion(solved.problem, solved.evaluation, tmp_path / "x.mp4", frames=3)


@pytest.mark.mpi
def test_picture_of_a_part_on_all_ranks(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """Material, interfaces and what was lost have their places and sizes; two dimensions in red."""

    def field(p: NDArray[np.float64]) -> NDArray[np.float64]:
        island = 0.004 - np.hypot(p[:, 0] - 0.25, p[:, 1])
        web = np.maximum(0.012 - np.abs(np.abs(p[:, 1]) - 0.02), 0.006 - np.abs(p[:, 0] - 0.2))
        return np.maximum(island, web)

    with pytest.warns(ffr.PartWarning, match="1 loose pieces"):
        part = ffr.Part(rod(comm), field)
    picture = pixels(plot_part(part, shared_tmp_path / "part.png", title="a part"))
    steel, red = near(picture, MATERIAL, 12.0), near(picture, RED, 12.0)
    rows = np.flatnonzero(steel.any(axis=1))
    overview = slice(rows[0], rows[np.flatnonzero(np.diff(rows) > 20)[0]] + 1)
    scale = np.ptp(np.flatnonzero(steel[overview].any(axis=0))) / LENGTH
    # lines, letters and frames hide some of it
    assert steel[overview].sum() / scale**2 == pytest.approx(part.area, rel=0.12)
    for color, side in zip(ACCENTS, (0.1, 0.9), strict=False):
        columns = np.flatnonzero(near(picture, color, 12.0)[overview].any(axis=0))
        assert len(columns) and np.all(np.abs(columns / steel.shape[1] - side) < 0.1)
    assert red[: overview.stop - 1].any() and red[overview.stop - 1 :].any()
    drawn = plot_part(part, shared_tmp_path / "part.svg")
    assert comm.bcast(drawn.stat().st_size if comm.rank == 0 else None) > 1000


@pytest.mark.mpi
def test_bad_input_is_refused_on_every_rank(
    comm: MPI.Comm, solved: Solved, shared_tmp_path: Path
) -> None:
    domain, png = solved.body.domain, shared_tmp_path / "x.png"
    both = solved.problem, solved.evaluation
    part = ffr.Part(domain, lambda p: np.ones(len(p)))
    for message, call in (
        (r"columns \['iteration'\]", lambda: plot_history({"iteration": [1.0]}, png)),
        ("needs a line", lambda: plot_history({"psi": []}, png)),
        ("the kind '.bmp' is not known", lambda: plot_part(part, png.with_suffix(".bmp"))),
        ("time = 7.0 s lies", lambda: plot_scene(*both, png, time=7.0)),
    ):
        with pytest.raises(ValueError, match=message):
            call()
    assert comm.allreduce(len(list(png.parent.iterdir()))) == 0


def test_settings_of_matplotlib_stay_as_they_were(tmp_path: Path) -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    plot_history(some_history(), tmp_path / "x.png")
    assert dict(matplotlib.rcParams) == before
