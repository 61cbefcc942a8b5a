# SPDX-License-Identifier: MIT
"""Pockets in place of holes: a web stays, in designs, parts, their files and their boundaries."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import ezdxf
import numpy as np
import pytest
import pyvista
import shapely
from slider_crank import STEEL, reference_problem, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.boundary import Boundary
from dolfinx_ffr.fem import PLATE, gmsh_model
from dolfinx_ffr.optimization.descent import Descent

WEB = 0.1
MEMBER = 2e-3


def plate(comm: MPI.Comm = MPI.COMM_WORLD) -> ffr.Domain:
    """A plate of 60 x 20 mm with a round hole of 6 mm near its left end."""
    shape = shapely.box(0.0, -0.01, 0.06, 0.01).difference(shapely.Point(0.01, 0.0).buffer(3e-3))
    left = {"left": lambda x: x[0] < 1e-9}
    return ffr.Domain.from_outline(comm, shape, interfaces=left, size=0.0025)


def around_pocket(x: np.ndarray) -> np.ndarray:
    """Negative in a round pocket with a round island, and in the hole of the plate."""
    away = np.hypot(x[:, 0] - 0.035, x[:, 1])
    return np.maximum(away - 7e-3, 2e-3 - away)


@pytest.fixture(scope="module")
def part() -> ffr.Part:
    return ffr.Part(plate(MPI.COMM_SELF), around_pocket, material=STEEL, web=WEB)


KINDS = pytest.mark.parametrize("kind", [ffr.LevelSet, ffr.DensityDesign])


@pytest.mark.mpi
@KINDS
def test_a_design_has_a_web_and_a_rim_along_its_outline(kind: type[ffr.DensityDesign]) -> None:
    body = plate()
    design = kind(body, web=WEB, hole_rim=4e-3)
    empty = design.density(design.even(0.0))
    away = shapely.distance(body.outline.boundary, shapely.points(body.centroids))
    size = 2.0 * body.cell_size
    assert np.all(empty[away < 4e-3 - size] > 1.0 - 1e-12)
    np.testing.assert_allclose(empty[away > 4e-3 + size], WEB, atol=1e-9)
    assert np.max(design.density(design.even(1.0))) <= 1.0
    # but for elements that the edge of the rim cuts, all have one of both thicknesses
    assert ffr.gray_fraction(body, empty, WEB) < 0.3


@pytest.mark.mpi
@KINDS
def test_the_pullback_of_a_web_is_exact(kind: type[ffr.DensityDesign]) -> None:
    body = plate()
    design = kind(body, web=0.3).at(0.3)
    rng = np.random.default_rng(1)
    z, direction = rng.uniform(0.2, 0.8, (2, design.size))
    bar = body.owned(rng.standard_normal(body.n_cells_global))
    change = [body.sum(bar * design.density(z + h * direction)) for h in (1e-5, -1e-5)]
    slope = float(design.pullback(z, bar) @ direction)
    assert slope == pytest.approx((change[0] - change[1]) / 2e-5, rel=1e-6)


def test_measures_of_a_part_count_the_web(part: ffr.Part) -> None:
    assert (part.pieces, part.holes, len(part.pockets)) == (2, 1, 1)  # the island is a piece
    floor = np.pi * (7e-3**2 - 2e-3**2)
    assert part.pocket_area == pytest.approx(floor, rel=1e-4)
    assert part.area + part.pocket_area == pytest.approx(part.body.area, rel=1e-3)
    assert part.volume == pytest.approx(STEEL.thickness * (part.area + WEB * floor), rel=1e-4)
    fitted = part.domain(2e-3)
    density = part.density(fitted)
    assert set(density) == {WEB, 1.0}
    filled = STEEL.thickness * fitted.sum(fitted.cell_volumes * density)
    assert filled == pytest.approx(part.volume, rel=1e-5)


def test_a_web_alone_may_hold_an_interface() -> None:
    """The hub around a bore is an island in a ring of web."""
    shape = shapely.box(0.0, -0.01, 0.06, 0.01).difference(shapely.Point(0.04, 0.0).buffer(2e-3))
    ends = {"left": lambda x: x[0] < 1e-9, "bore": ffr.fem.Bore(at=(0.04, 0.0))}
    body = ffr.Domain.from_outline(MPI.COMM_SELF, shape, interfaces=ends, size=0.002)

    def ring(x: np.ndarray) -> np.ndarray:
        away = np.hypot(x[:, 0] - 0.04, x[:, 1])
        return np.maximum(away - 8e-3, 4e-3 - away)

    part = ffr.Part(body, ring, material=STEEL, web=WEB)
    assert (part.pieces, part.holes, len(part.pockets)) == (2, 1, 1)
    assert part.pocket_area == pytest.approx(np.pi * (8e-3**2 - 4e-3**2), rel=1e-4)
    with pytest.raises(ValueError, match="no material connects"):
        ffr.Part(body, ring, material=STEEL)


def test_files_have_pockets_to_their_depth(part: ffr.Part, tmp_path: Path) -> None:
    part.write(tmp_path)
    solid = pyvista.read(tmp_path / "part.stl").clean()
    assert solid.n_open_edges == 0
    assert 1e-9 * solid.volume == pytest.approx(part.volume, rel=1e-3)
    with gmsh_model() as gmsh:
        (volume,) = gmsh.model.occ.importShapes(str(tmp_path / "part.step"))
        assert 1e-9 * gmsh.model.occ.getMass(*volume) == pytest.approx(part.volume, rel=1e-8)
        box = gmsh.model.occ.getBoundingBox(*volume)
    np.testing.assert_allclose(box, [0, -10, 0, 60, 10, 10], atol=1e-5)
    drawn = ezdxf.readfile(tmp_path / "part.dxf").modelspace()
    assert {e.dxf.layer for e in drawn} == {"part", "left", "pockets 4.5 mm deep from both sides"}
    assert 'id="pockets"' in (tmp_path / "part.svg").read_text()


def test_webs_that_there_cannot_be_are_refused() -> None:
    body = plate(MPI.COMM_SELF)
    with pytest.raises(ValueError, match="hole_rim = 0 leaves pockets open"):
        ffr.LevelSet(body, web=WEB, hole_rim=0.0)
    with pytest.raises(ValueError, match="web"):
        ffr.DensityDesign(body, web=1.0)
    box = ffr.Domain.box(MPI.COMM_SELF, 0.1, 0.04, 0.04, elements=(10, 4, 4))
    with pytest.raises(ValueError, match="bodies in the plane"):
        ffr.LevelSet(box, web=WEB)
    open_ = ffr.Part(body, lambda x: 0.04 - x[:, 0], material=STEEL, web=WEB)
    with pytest.raises(ValueError, match="open at the outline"):
        open_.domain(2e-3)
    problem = reference_problem(MPI.COMM_SELF, (20, 4), steps=10, modes=1)
    design = ffr.LevelSet(problem.flexible["rod"].domain, web=WEB)
    with pytest.raises(ValueError, match="takes MMA"):
        ffr.optimize(problem, design, optimizer=ffr.LevelSetEvolution())
    rod = problem.flexible["rod"]
    strain = ffr.PlaneStrain(young=210e9, poisson=0.3, density=7850.0, thickness=0.01)
    strained = ffr.FlexibleBody(rod.domain, strain, frame=ffr.ChordFrame("left", "right"), modes=1)
    with pytest.raises(ValueError, match="for plane stress"):
        ffr.optimize(problem.with_bodies({"rod": strained}), design)
    stressed = with_stress_limit(problem, relaxation=0.5)
    with pytest.raises(ValueError, match="give it relaxation=0"):
        ffr.optimize(stressed, design)


def with_stress_limit(problem: ffr.Problem, relaxation: float = 0.0) -> ffr.Problem:
    """The least material for a largest stress, whose limit the full rod keeps."""
    heavy, steps = slider_crank(2.0, 5.0), ffr.GeneralizedAlpha(2.0, 60)
    peak = ffr.PeakStress("rod", relaxation=relaxation, clear=3e-3)
    limit = ffr.Constraint(peak, upper=4e6, name="stress")
    return ffr.Problem(problem.bodies, heavy, steps, ffr.Volume("rod"), [limit])


def test_a_stress_limit_counts_the_web_in_full() -> None:
    problem = with_stress_limit(reference_problem(MPI.COMM_SELF, (40, 8), steps=60, modes=3))
    rod = problem.flexible["rod"].with_interpolation(PLATE)
    plates = problem.with_bodies({"rod": rod})
    full = np.abs(rod.domain.centroids[:, 1]) > 0.015
    evaluation = plates.value(np.where(full, 1.0, WEB))
    worst = ffr.worst_stress(rod, evaluation, "rod", clear=3e-3)
    assert worst.solid.all()  # though the web is thinner than what is void elsewhere
    assert worst.largest == pytest.approx(np.max(worst.stress[~full]), rel=1e-12)
    (limit,) = problem.constraints
    largest = limit.objective.largest(plates.response(evaluation))
    assert largest == pytest.approx(worst.largest, rel=1e-9)

    design = ffr.LevelSet(rod.domain, web=WEB)
    result = ffr.optimize(problem, design, volume=1.0, iterations=2, boundary=0, progress=False)
    assert result.problem.flexible["rod"].interpolation == PLATE


def pocketed() -> tuple[Descent, Boundary]:
    """The rod of the slider-crank with two pockets, in one of which there is an island."""
    problem = reference_problem(MPI.COMM_WORLD, (40, 4), steps=60, modes=3)
    body = problem.flexible["rod"]
    plates = problem.with_bodies({"rod": body.with_interpolation(PLATE)})

    def field(x: np.ndarray) -> np.ndarray:
        long = np.maximum(np.abs(x[:, 0] - 0.12) - 0.06, np.abs(x[:, 1]) - 0.014)
        long = np.maximum(long, 0.006 - np.hypot(x[:, 0] - 0.12, x[:, 1]))
        return np.minimum(long, np.hypot(x[:, 0] - 0.26, x[:, 1]) - 0.013)

    part = ffr.Part(body.domain, field, 0.01, material=body.material, web=WEB)
    boundary = Boundary.of(part, MEMBER, outline=False)
    return Descent(plates, {"rod": 0.9}, {"rod": 0.004}, {}), boundary


@pytest.mark.mpi
def test_boundaries_of_pockets_have_exact_slopes_on_all_ranks() -> None:
    descent, boundary = pocketed()
    trial = descent.trial_of({"rod": boundary})
    slopes = descent.slopes(trial)
    steepest = slopes.psi / np.max(np.abs(slopes.psi))
    steepest = np.where(boundary.fixed_offsets, 0.0, steepest)
    h = 0.1  # in minimum members; new meshes alone change psi by some 1e-5
    ends = [
        descent.trial_of({"rod": boundary.moved(s * h * MEMBER * steepest)}) for s in (1.0, -1.0)
    ]
    psi = [np.log(end.evaluation.psi) for end in ends]
    assert (psi[0] - psi[1]) / (2.0 * h) == pytest.approx(float(slopes.psi @ steepest), rel=5e-3)
    filled = [end.violations["volume of rod"] for end in ends]
    slope = float(slopes.slopes[-1] @ steepest)
    assert (filled[0] - filled[1]) / (2.0 * h) == pytest.approx(slope, rel=1e-3)


def test_islands_are_no_holes_and_stay_apart_from_the_edge_of_their_pocket() -> None:
    _, boundary = pocketed()
    areas = {key: boundary.hole(key).area for key in boundary.holes}
    assert len(areas) == 2  # of three closed curves
    long = max(areas, key=lambda key: areas[key])
    filled = boundary.without([long])
    assert (len(filled.holes), filled.part.pieces) == (1, 1)
    (island,) = set(boundary.free) - set(boundary.holes)
    first = boundary.first[island]
    motion = np.zeros((boundary.n_controls, 2))
    motion[first : first + len(boundary.free[island].control), 1] = 0.01
    assert boundary.valid
    assert not boundary.slid(motion).valid


def test_a_short_run_ends_with_a_part_that_is_told_as_it_is() -> None:
    problem = reference_problem(MPI.COMM_SELF, (40, 8), steps=60, modes=3)
    design = ffr.LevelSet(problem.flexible["rod"].domain, web=WEB)
    result = ffr.optimize(problem, design, iterations=8, boundary=2, progress=False)
    assert result.feasible
    assert result.moved is not None
    part = result.part()
    assert part.holes == 0
    assert part.pockets
    assert part.volume / (0.4 * 0.04 * 0.01) == pytest.approx(result.moved.volume["rod"], rel=1e-4)
    full = result.moved.problem.value(np.ones(result.moved.problem.flexible["rod"].domain.n_cells))
    # less than the rod, and than a plate of the same mass all over, which has its psi
    assert result.psi < 0.6 * full.psi
    assert result.moved.summary()["narrowest"] >= 0.99 * design.minimum_member


def test_the_solid_in_space_is_what_two_thicknesses_stand_for(part: ffr.Part) -> None:
    """Clamped at its left end, the plate has the frequencies of plane stress in its plane."""
    frame = ffr.TangentFrame("left")
    plane = part.domain(3e-3)
    flat = ffr.FlexibleBody(plane, STEEL, frame=frame, modes=2, interpolation=PLATE)
    expected = flat.reduce(part.density(plane)).basis.frequencies
    solid = part.in_space(6e-3)
    print(solid.n_cells, solid.area / part.volume)
    assert solid.area == pytest.approx(part.volume, rel=5e-3)
    low, high = solid.bounding_box
    np.testing.assert_allclose([low[2], high[2]], [-5e-3, 5e-3])
    steel = ffr.Isotropic(STEEL.young, STEEL.poisson, STEEL.density)
    body = ffr.FlexibleBody(solid, steel, frame=frame, modes=5)
    frequencies = body.reduce(np.ones(solid.n_cells)).basis.frequencies
    nearest = np.min(np.abs(frequencies[:, None] / expected - 1.0), axis=0)
    assert np.max(nearest) < 0.02
