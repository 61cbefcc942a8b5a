# SPDX-License-Identifier: MIT
"""Pictures: the right parts in the right places, judged by geometry and by pixels."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from shared.problems import slider_crank

from dolfinx_ffr.body.volume_integrals import VolumeIntegrals
from dolfinx_ffr.dynamics import GeneralizedAlpha
from dolfinx_ffr.fem.domain import Domain
from dolfinx_ffr.fem.material import PlaneStress
from dolfinx_ffr.mechanism import (
    Distance,
    Force,
    Gear,
    Ground,
    Mechanism,
    Placement,
    PointMass,
    PrescribedAngle,
    Revolute,
    SpringDamper,
    TorsionalSpringDamper,
    Translational,
    Weld,
)
from dolfinx_ffr.mechanism.motion import Motion
from dolfinx_ffr.objective import IntegralCompliance
from dolfinx_ffr.plotting import (
    animate_motion,
    mesh_grid,
    plot_crank_motion,
    plot_design,
    plot_history,
    plot_modes,
    plot_scene,
    plot_trade_off,
)
from dolfinx_ffr.plotting.drawn_mesh import DrawnMesh
from dolfinx_ffr.plotting.scene import Scene
from dolfinx_ffr.plotting.style import ACCENTS, nice_number, prefixed
from dolfinx_ffr.problem import Evaluation, Problem
from dolfinx_ffr.reduction.flexible_body import FlexibleBody
from dolfinx_ffr.reduction.frame import ChordFrame, TangentFrame

LENGTH, HEIGHT = 0.4, 0.04
STEEL = PlaneStress(210e9, 0.3, 7850.0, 0.01)
MESHES = [(cell, order) for cell in ("quadrilateral", "triangle") for order in (1, 2)]


def rod(
    comm: MPI.Comm, cell: str = "quadrilateral", order: int = 1, elements: tuple[int, int] = (40, 4)
) -> Domain:
    return Domain.rectangle(comm, LENGTH, HEIGHT, elements=elements, cell=cell, order=order)


def ladder(domain: Domain) -> NDArray[np.float64]:
    """Two flanges, rungs and massive ends, the rest at a small density."""
    x, y = domain.centroids.T
    solid = (np.abs(y) > 0.009) | (np.mod(x, 0.1) < 0.02) | (np.abs(x - 0.2) > 0.18)
    return np.where(solid | ~domain.design_cells, 1.0, 1e-3)


@dataclass
class Solved:
    problem: Problem
    evaluation: Evaluation

    @property
    def body(self) -> FlexibleBody:
        return self.problem.flexible["rod"]


def solve(problem: Problem) -> Solved:
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
    body = FlexibleBody(rod(MPI.COMM_SELF), STEEL, frame=ChordFrame("left", "right"), modes=4)
    ends = {"left": (-0.05, 0.0), "right": (0.05, 0.0)}
    mechanism = Mechanism(
        placements={
            "rod": Placement(),
            "carriage": Placement((0.45, 0.0)),
            "wheel": Placement((0.1, -0.2)),
        },
        joints=[
            Revolute(("rod", "right"), ("carriage", "left"), name="pin"),
            Translational(("carriage", "right"), Ground(angle=0.1), (1.0, -0.1), name="rails"),
            Revolute(("wheel", "left"), Ground((0.05, -0.2)), name="axle"),
            Gear(("wheel", "left"), ("rod", "left"), -2.0, name="gear"),
            Distance(("rod", "left"), Ground((-0.2, -0.1)), name="strut"),
        ],
        forces=[
            SpringDamper(("rod", "left"), Ground((0.0, 0.2)), 1e3, name="spring"),
            TorsionalSpringDamper(("rod", "left"), Ground((9.0, 9.0)), 10.0),
            Force(("rod", "right"), lambda t: 50.0 * np.sin(40.0 * t)),
        ],
        gravity=(0.0, -9.81),
    )
    rigid = {name: VolumeIntegrals.rigid(0.5, (0, 0), 1e-3, ends) for name in ("carriage", "wheel")}
    return solve(
        Problem({"rod": body, **rigid}, mechanism, GeneralizedAlpha(0.2, 100), IntegralCompliance())
    )


# ---------------------------------------------------------------------- gathered meshes


@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "order"), MESHES)
def test_gathered_mesh_is_the_body(comm: MPI.Comm, cell: str, order: int) -> None:
    domain = rod(comm, cell, order)
    drawn = DrawnMesh.of(domain)
    centroids = drawn.cell_values(domain.centroids)
    if comm.rank > 0:
        assert len(drawn.points) == len(drawn.pieces) == len(centroids) == 0
        return
    areas = np.abs(piece_areas(drawn))
    assert len(drawn.pieces) == domain.n_cells_global * order**2
    assert np.sum(areas) == pytest.approx(LENGTH * HEIGHT, rel=1e-12)
    middles = drawn.points[drawn.pieces].mean(axis=1)
    own = np.zeros_like(centroids)
    np.add.at(own, drawn.parents, middles * areas[:, None])
    cell_area = np.bincount(drawn.parents, areas)
    assert own / cell_area[:, None] == pytest.approx(centroids, abs=1e-13)

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
def test_gathered_mesh_is_the_same_on_any_number_of_ranks(comm: MPI.Comm) -> None:
    parallel, serial = DrawnMesh.of(rod(comm)), DrawnMesh.of(rod(MPI.COMM_SELF))
    if comm.rank == 0:
        assert parallel.points[parallel.pieces].mean(axis=1) == pytest.approx(
            serial.points[serial.pieces].mean(axis=1), abs=1e-14
        )


@pytest.mark.mpi
def test_curved_cells_are_drawn_with_their_middle_nodes(
    comm: MPI.Comm, shared_tmp_path: Path
) -> None:
    path = shared_tmp_path / "disc.msh"
    radius = 0.5
    if comm.rank == 0:
        gmsh.initialize()
        try:
            gmsh.option.setNumber("General.Terminal", 0)
            geometry = gmsh.model.geo
            center = geometry.addPoint(0.0, 0.0, 0.0, 0.2)
            corners = [
                geometry.addPoint(radius * math.cos(a), radius * math.sin(a), 0.0, 0.2)
                for a in np.arange(4) * 0.5 * np.pi
            ]
            arcs = [
                geometry.addCircleArc(corners[k], center, corners[(k + 1) % 4]) for k in range(4)
            ]
            surface = geometry.addPlaneSurface([geometry.addCurveLoop(arcs)])
            geometry.synchronize()
            for dim, tag, name in (
                (1, arcs[0], "left"),
                (1, arcs[2], "right"),
                (2, surface, "all"),
            ):
                gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [tag]), name)
            gmsh.model.mesh.generate(2)
            gmsh.model.mesh.setOrder(2)
            gmsh.write(str(path))
        finally:
            gmsh.finalize()
    comm.Barrier()
    domain = Domain.from_gmsh(comm, path)
    drawn = DrawnMesh.of(domain)
    if comm.rank > 0:
        return
    assert len(drawn.pieces) == 4 * domain.n_cells_global
    rim = drawn.points[drawn.outline]
    assert np.linalg.norm(rim, axis=2) == pytest.approx(radius, rel=1e-9)
    # the drawn pieces fill the polygon through all nodes on the rim, the middle ones included
    across = np.abs(rim[:, 0, 0] * rim[:, 1, 1] - rim[:, 1, 0] * rim[:, 0, 1])
    assert np.sum(np.abs(piece_areas(drawn))) == pytest.approx(0.5 * np.sum(across), rel=1e-12)
    corners = 0.5 * len(rim)
    assert np.sum(across) / 2 > 1.005 * corners / 2 * radius**2 * np.sin(2 * np.pi / corners)


# ---------------------------------------------------------------------- designs


@pytest.mark.slow
@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_dark_share_of_a_design_is_its_volume(tmp_path: Path, cell: str) -> None:
    domain = rod(MPI.COMM_SELF, cell)
    some = (np.random.default_rng(7).random(domain.n_cells) < 0.37).astype(float)
    share = domain.sum(some * domain.cell_volumes) / domain.area

    def dark(x: NDArray[np.float64], name: str) -> int:
        path = plot_design(domain, x, tmp_path / f"{name}.png")
        return int(np.count_nonzero(near(pixels(path), "#000000", 100.0)))

    void = dark(np.zeros(domain.n_cells), "void")
    solid = dark(np.ones(domain.n_cells), "solid")
    assert (dark(some, "some") - void) / (solid - void) == pytest.approx(share, abs=0.02)
    assert solid - void == pytest.approx(1500 * 150, rel=0.03)


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
        assert inside == pytest.approx(255.0 * (1.0 - density), abs=3.0)


def test_interfaces_are_marked_in_colour(tmp_path: Path) -> None:
    domain = rod(MPI.COMM_SELF)
    picture = pixels(plot_design(domain, np.zeros(domain.n_cells), tmp_path / "x.png"))
    left, right = (near(picture, color).sum(axis=0) for color in ACCENTS[:2])
    height = 0.9 * 150
    first, second = np.flatnonzero(left > height), np.flatnonzero(right > height)
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

    together = draw(comm, shared_tmp_path / "together.png")
    assert together == shared_tmp_path / "together.png"
    by_itself = draw(MPI.COMM_SELF, tmp_path / f"alone-{comm.rank}.png")
    assert_same_picture(pixels(together), pixels(by_itself))


def assert_same_picture(a: NDArray[np.float64], b: NDArray[np.float64]) -> None:
    """Assert that two pictures differ at most by a few pixels on edges."""
    assert a.shape == b.shape
    assert np.ptp(a) > 100.0  # not blank
    assert np.mean(np.max(np.abs(a - b), axis=2) > 8.0) < 1e-4


@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "order"), MESHES)
def test_grid_for_pyvista_is_the_body(comm: MPI.Comm, cell: str, order: int) -> None:
    domain = rod(comm, cell, order)
    x = domain.centroids[:, 0] / LENGTH
    grid = mesh_grid(domain, {"density": x})
    volume = domain.sum(x * domain.cell_volumes)
    if comm.rank > 0:
        assert grid is None
        return
    assert grid is not None
    areas = grid.compute_cell_sizes(length=False, volume=False).cell_data["Area"]
    assert np.sum(areas) == pytest.approx(LENGTH * HEIGHT, rel=1e-12)
    assert np.sum(areas * grid.cell_data["density"]) == pytest.approx(volume, rel=1e-12)


def test_the_other_backend_is_named(tmp_path: Path) -> None:
    domain = rod(MPI.COMM_SELF)
    with pytest.warns(DeprecationWarning, match="mesh_grid"):
        path = plot_design(domain, ladder(domain), tmp_path / "a.pdf", backend="pyvista")
    assert path.read_bytes().startswith(b"%PDF")


# ---------------------------------------------------------------------- diagrams


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


@pytest.mark.slow
def test_history_from_a_file_looks_like_that_from_columns(tmp_path: Path) -> None:
    history = some_history()
    file = tmp_path / "history.csv"
    rows = zip(*history.values(), strict=True)
    lines = [",".join(history), *(",".join(repr(float(v)) for v in row) for row in rows)]
    file.write_text("\n".join(lines) + "\n")
    a = pixels(plot_history(history, tmp_path / "a.png", psi_solid=5.8e-5, volume_bound=0.5))
    b = pixels(plot_history(file, tmp_path / "b.png", psi_solid=5.8e-5, volume_bound=0.5))
    assert np.array_equal(a, b)
    assert near(a, "#0b62a4").sum() > 2000  # the curves
    assert near(a, "#c8352b").sum() > 200  # the bound
    without = pixels(plot_history(history, tmp_path / "c.png"))
    assert near(without, "#c8352b").sum() == 0


def test_history_has_a_panel_for_each_column(tmp_path: Path) -> None:
    history = some_history()
    sizes = []
    for names in (["psi"], ["psi", "volume"], ["psi", "volume", "step"]):
        part = {name: history[name] for name in names}
        sizes.append(pixels(plot_history(part, tmp_path / "x.png")).shape)
    assert sizes[0][1] < sizes[1][1] < sizes[2][1]


def test_history_has_a_panel_for_several_motions(tmp_path: Path) -> None:
    """A curve for each, relative to the start, beside that of all together."""
    psi = some_history()["psi"]
    motions = {"psi of slow": 2.0 * psi, "psi of fast": 3.0 * psi[0] - psi}
    one, two, alone = (
        pixels(plot_history(columns, tmp_path / "x.png"))
        for columns in ({"psi": psi}, {"psi": psi, **motions}, motions)
    )
    assert one.shape[1] < two.shape[1] and alone.shape == one.shape
    assert near(alone, "#0b62a4").sum() > 300 and near(alone, "#d9822b").sum() > 300


def test_trade_off_has_a_row_for_each_design(tmp_path: Path) -> None:
    """And images beside them, where there are any; the best are cool, the worst warm."""
    psi = {f"design {k}": {"slow": 1.0 + k, "fast": 4.0 - k} for k in range(3)}
    plain = pixels(plot_trade_off(psi, tmp_path / "a.png"))
    images = {"design 1": np.eye(40)}
    drawn = pixels(plot_trade_off(psi, tmp_path / "b.png", images=images))
    assert drawn.shape[0] == plain.shape[0] and drawn.shape[1] > plain.shape[1]
    more = pixels(plot_trade_off({**psi, "all": psi["design 1"]}, tmp_path / "c.png"))
    assert more.shape[0] > plain.shape[0]


@pytest.mark.mpi
def test_history_without_anything_to_draw_is_refused_on_every_rank(shared_tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"columns \['iteration'\]"):
        plot_history({"iteration": [1.0]}, shared_tmp_path / "x.png")
    with pytest.raises(ValueError, match="must have a line"):
        plot_history({"psi": []}, shared_tmp_path / "x.png")


def test_crank_motion_of_a_trajectory_is_that_of_its_motion(solved: Solved, tmp_path: Path) -> None:
    motion = Motion.smooth_step(10.0 * np.pi, 2.0)
    a = pixels(plot_crank_motion(motion, tmp_path / "a.png", end_time=2.0, title="Crank"))
    b = pixels(plot_crank_motion(solved.evaluation.trajectory, tmp_path / "b.png", title="Crank"))
    assert np.array_equal(a, b)
    # three curves, each across the whole diagram
    assert np.mean(near(a, "#0b62a4").any(axis=0)) > 0.75
    with pytest.raises(ValueError, match="end_time = None must be given"):
        plot_crank_motion(motion, tmp_path / "a.png")


# ---------------------------------------------------------------------- modes


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
    shown = colorful(a)[int(0.2 * a.shape[0]) :]
    for band in np.array_split(shown, 3, axis=0):
        for place in np.array_split(band, 3, axis=1):
            assert np.count_nonzero(place) > 1000


@pytest.mark.mpi
def test_modes_look_the_same_on_any_number_of_ranks(
    comm: MPI.Comm, solved: Solved, alone: Solved, shared_tmp_path: Path, tmp_path: Path
) -> None:
    paths = [
        plot_modes(case.body, case.evaluation.bodies["rod"], path)
        for case, path in (
            (solved, shared_tmp_path / "together.png"),
            (alone, tmp_path / f"alone-{comm.rank}.png"),
        )
    ]
    assert_same_picture(pixels(paths[0]), pixels(paths[1]))


# ---------------------------------------------------------------------- scenes


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


def test_energy_density_of_a_uniform_stretch() -> None:
    """Free stretch along x: sigma^2 / (2 E) everywhere."""
    domain = rod(MPI.COMM_SELF)
    body = FlexibleBody(domain, STEEL, frame=ChordFrame("left", "right"), modes=1)
    x, y = domain.space.tabulate_dof_coordinates()[:, :2].T
    strain = 1e-4
    field = np.column_stack([strain * x, -0.3 * strain * y]).ravel()
    energy = body.elasticity.strain_energy(np.ones(domain.n_cells), field)
    density = energy / (domain.cell_volumes * STEEL.thickness)
    assert density == pytest.approx(0.5 * 210e9 * strain**2, rel=1e-12)


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
    other = solve(slider_crank(MPI.COMM_SELF, (40, 4), modes=6, frame=TangentFrame("left")))
    a, b = gathered(solved, [60, 97]).bodies["rod"], gathered(other, [60, 97]).bodies["rod"]
    for i in range(2):
        shown = 1000.0 * a.deflection(i)
        away = np.max(np.abs(a.points(i, 1000.0) - b.points(i, 1000.0)))
        assert away < 0.02 * shown


def test_crank_is_found_from_its_motion(solved: Solved) -> None:
    (arm,) = gathered(solved, [0]).arms.values()
    assert arm.center == pytest.approx([0.0, 0.0], abs=1e-12)
    assert arm.radius == pytest.approx(0.1, rel=1e-12)
    assert arm.name == "crank pin"


def test_scene_shows_joints_and_springs_of_every_kind(tmp_path: Path) -> None:
    press_ = press()
    scene = gathered(press_, [0, 100])
    low, high = scene.box(1.0)
    assert low == pytest.approx([-0.2, -0.2], abs=0.06)  # foot of the strut, axle of the wheel
    assert high == pytest.approx([0.5, 0.2], abs=0.06)  # carriage, top of the spring
    picture = pixels(plot_scene(press_.problem, press_.evaluation, tmp_path / "x.png", time=0.1))
    assert near(picture, "#b6bec8", 8.0).sum() > 300  # the block of the carriage
    animate_motion(press_.problem, press_.evaluation, tmp_path / "x.gif", frames=2)


def test_scene_shows_crank_design_and_names(solved: Solved, tmp_path: Path) -> None:
    path = plot_scene(solved.problem, solved.evaluation, tmp_path / "scene.png", time=0.9)
    picture = pixels(path)
    assert near(picture, "#57606a").sum() > 3000  # the crank
    assert near(picture, "#1e1e1e", 12.0).sum() > 10000  # the design
    assert colorful(picture).sum() == 0
    energy = pixels(
        plot_scene(
            solved.problem, solved.evaluation, tmp_path / "energy.png", time=0.9, color="energy"
        )
    )
    assert colorful(energy).sum() > 10000


def test_void_is_left_out(solved: Solved, tmp_path: Path) -> None:
    """The share of the body's picture that has a colour is that of the solid cells."""
    domain = solved.body.domain
    full = solved.problem.value(np.ones(domain.n_cells))
    counts = []
    for evaluation in (solved.evaluation, full):
        path = plot_scene(
            solved.problem,
            evaluation,
            tmp_path / "x.png",
            time=0.9,
            color="energy",
            deformation_scale=1.0,
        )
        below_the_heading = pixels(path)[120:]
        counts.append(np.count_nonzero(np.ptp(below_the_heading, axis=2) > 30.0))
    share = domain.sum((ladder(domain) > 0.5) * domain.cell_volumes) / domain.area
    assert counts[0] / counts[1] == pytest.approx(share, abs=0.04)


def test_bodies_without_mesh_and_all_kinds_of_joints(tmp_path: Path) -> None:
    """A four-bar with rigid crank and rocker, and a beam welded to the rocker."""
    coupler = FlexibleBody(
        rod(MPI.COMM_SELF, "triangle", 2, (16, 2)), STEEL, frame=TangentFrame("left"), modes=3
    )

    def bar(length: float) -> VolumeIntegrals:
        markers = {"a": (0.0, 0.0), "b": (length, 0.0)}
        return VolumeIntegrals.rigid(0.5, (length / 2, 0.0), 0.5 * length**2 / 3, markers)

    mechanism = Mechanism(
        placements={
            "crank": Placement((0.0, 0.0), np.pi / 2),
            "coupler": Placement((0.0, 0.1), 0.2),
            "rocker": Placement((0.4, 0.0), 1.4),
            "flag": Placement((0.45, 0.3), 1.4),
        },
        joints=[
            Revolute(("crank", "a"), Ground()),
            PrescribedAngle(("crank", "a"), Motion.polynomial([np.pi / 2, 20.0])),
            Revolute(("coupler", "left"), ("crank", "b"), name="pin"),
            Revolute(("coupler", "right"), ("rocker", "b")),
            Revolute(("rocker", "a"), Ground((0.4, 0.0))),
            Weld(("flag", "a"), ("rocker", "b"), name="weld"),
        ],
        point_masses=[PointMass(("flag", "b"), 1.0)],
    )
    problem = Problem(
        {"crank": bar(0.1), "coupler": coupler, "rocker": bar(0.25), "flag": bar(0.05)},
        mechanism,
        GeneralizedAlpha(0.1, 50),
        IntegralCompliance(["coupler"]),
    )
    evaluation = problem.value(np.ones(coupler.domain.n_cells))
    scene = Scene.gather(problem, evaluation, np.array([0, 50]), energy=True)
    assert not scene.arms
    for i in range(2):  # joints close in the picture, however much is magnified
        for joint in mechanism.joints[2:4]:
            ends = [scene.position(marker, i, 500.0) for marker in joint.markers]
            assert ends[0] == pytest.approx(ends[1], abs=1e-9)
    picture = pixels(plot_scene(problem, evaluation, tmp_path / "x.png", color="energy"))
    assert near(picture, "#57606a").sum() > 3000  # the bars
    assert colorful(picture).sum() > 5000  # the coupler


# ---------------------------------------------------------------------- animations


@pytest.mark.slow
def test_film_has_the_frames_that_were_asked_for(solved: Solved, tmp_path: Path) -> None:
    path = animate_motion(
        solved.problem,
        solved.evaluation,
        tmp_path / "new" / "motion.gif",
        frames=9,
        frames_per_second=10.0,
        title="Slider-crank",
    )
    with Image.open(path) as film:
        assert film.n_frames == 9
        assert film.info["duration"] == 100
        assert film.info["loop"] == 0
    pictures = [pixels(path, i) for i in range(9)]
    for picture in pictures:
        assert picture.shape == pictures[0].shape
        assert np.all(picture[0] == 255.0)
        assert colorful(picture).sum() > 3000  # rod and colour bar
    for a, b in pairwise(pictures[1:]):
        assert np.mean(np.any(a != b, axis=2)) > 0.005
    # what stands still does not flicker: the heading above, the axes below
    assert all(np.array_equal(p[:35, :500], pictures[0][:35, :500]) for p in pictures)


@pytest.mark.slow
def test_film_shows_the_motion(solved: Solved, tmp_path: Path) -> None:
    """The right end of the slider's block, which nothing covers, moves like the rod's end."""
    path = animate_motion(solved.problem, solved.evaluation, tmp_path / "x.gif", frames=21)
    blocks = [near(pixels(path, i), "#b6bec8", 8.0).sum(axis=0) > 8 for i in range(21)]
    ends = [np.flatnonzero(block)[-1] for block in blocks]
    steps = np.round(np.linspace(0, 200, 21)).astype(int)
    slider = solved.evaluation.trajectory.marker_path("rod", "right")[steps, 0]
    fit = np.polynomial.Polynomial.fit(slider, ends, 1)
    assert np.max(np.abs(fit(slider) - ends)) < 2.0  # pixels
    assert np.ptp(ends) > 150.0


@pytest.mark.slow
@pytest.mark.mpi
def test_film_looks_the_same_on_any_number_of_ranks(
    comm: MPI.Comm, solved: Solved, alone: Solved, shared_tmp_path: Path, tmp_path: Path
) -> None:
    paths = [
        animate_motion(case.problem, case.evaluation, path, frames=5)
        for case, path in (
            (solved, shared_tmp_path / "together.gif"),
            (alone, tmp_path / f"alone-{comm.rank}.gif"),
        )
    ]
    for i in range(5):
        assert_same_picture(pixels(paths[0], i), pixels(paths[1], i))


def test_film_by_ffmpeg_gets_every_pixel(
    solved: Solved, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ValueError, match=r"ffmpeg.*end the name in \.gif"):
        animate_motion(solved.problem, solved.evaluation, tmp_path / "x.mp4", frames=3)
    program = tmp_path / "ffmpeg"
    program.write_text(f'#!/bin/sh\necho "$@" > {tmp_path}/called\n/bin/cat > {tmp_path}/film\n')
    program.chmod(0o755)
    animate_motion(solved.problem, solved.evaluation, tmp_path / "x.mp4", frames=3)
    size = (tmp_path / "called").read_text().split(" -s ")[1].split()[0]
    width, height = (int(n) for n in size.split("x"))
    assert width % 2 == 0 and height % 2 == 0
    film = np.fromfile(tmp_path / "film", dtype=np.uint8)
    assert film.size == 3 * width * height * 3
    assert np.all(film.reshape(3, height, width, 3)[:, 0] == 255)
    program.write_text("#!/bin/sh\n/bin/cat > /dev/null\necho broken >&2\nexit 3\n")
    with pytest.raises(RuntimeError, match=r"could not write .*broken"):
        animate_motion(solved.problem, solved.evaluation, tmp_path / "x.mp4", frames=3)


# ---------------------------------------------------------------------- bad input


@pytest.mark.mpi
def test_bad_input_is_refused_on_every_rank(
    comm: MPI.Comm, solved: Solved, shared_tmp_path: Path
) -> None:
    domain, here = solved.body.domain, shared_tmp_path
    problem, evaluation = solved.problem, solved.evaluation
    x = np.ones(domain.n_cells)
    cases: list[tuple[str, Callable[[], Path]]] = [
        ("the kind '.jpg' is not known", lambda: plot_design(domain, x, here / "x.jpg")),
        ("the kind '' is not known", lambda: plot_history({"psi": [1.0]}, here / "x")),
        ("no design given", lambda: plot_design(domain, {}, here / "x.png")),
        ("design 'b': values from 2", lambda: plot_design(domain, {"b": 2 * x}, here / "x.png")),
        (
            "color must be 'density' or",
            lambda: plot_scene(problem, evaluation, here / "x.png", color="red"),
        ),
        ("time = 7.0 s lies", lambda: plot_scene(problem, evaluation, here / "x.png", time=7.0)),
        (
            "frames must be .* at least 2",
            lambda: animate_motion(problem, evaluation, here / "x.gif", frames=1),
        ),
        (
            "frames_per_second must be .*, but it is 0",
            lambda: animate_motion(problem, evaluation, here / "x.gif", frames_per_second=0),
        ),
    ]
    for message, call in cases:
        with pytest.raises(ValueError, match=message):
            call()
    assert comm.allreduce(len(list(here.iterdir()))) == 0


@pytest.mark.mpi
def test_unwritable_place_is_refused_on_every_rank(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    domain = rod(comm)
    if comm.rank == 0:
        (shared_tmp_path / "file").write_text("not a directory")
    comm.Barrier()
    with pytest.raises(OSError, match="file"):
        plot_design(domain, np.ones(domain.n_cells), shared_tmp_path / "file" / "x.png")


def test_settings_of_matplotlib_stay_as_they_were(tmp_path: Path) -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    plot_history(some_history(), tmp_path / "x.png")
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize(
    ("value", "expected"), [(0.37, 0.2), (5.0, 5.0), (1.0, 1.0), (9999.0, 5000.0), (0.0, 1.0)]
)
def test_nice_number(value: float, expected: float) -> None:
    assert nice_number(value) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("value", "unit", "factor"), [(3e-5, "µJ", 1e6), (1200.0, "kJ", 1e-3), (2.0, "J", 1.0)]
)
def test_prefixed_units(value: float, unit: str, factor: float) -> None:
    assert prefixed(value, "J") == (unit, pytest.approx(factor))
