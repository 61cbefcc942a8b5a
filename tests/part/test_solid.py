# SPDX-License-Identifier: MIT
"""Solids of designs in space: closed, of the right volume, in pieces, written and read back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import pyvista
from shared.meshes import write_pierced_block
from spatial_slider_crank import ROD, SECTION, spatial_problem

import dolfinx_ffr as ffr
from dolfinx_ffr import Solid
from dolfinx_ffr.part import ball_widths


@pytest.fixture(autouse=True)
def few_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Members and gaps are looked for in a moment."""
    monkeypatch.setattr(ball_widths, "MOST_SAMPLES", 3_000)


def enclosed(points: np.ndarray, triangles: np.ndarray) -> float:
    """The volume that a closed surface encloses, by the divergence theorem."""
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return float(np.sum(a * np.cross(b, c))) / 6.0


def faults(triangles: np.ndarray) -> int:
    """Edges that are not of two triangles, and vertices whose triangles are no single fan.

    The triangles of a fan follow each other in one direction: all are turned alike.
    """
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    faults = int(np.count_nonzero(np.unique(sides, axis=0, return_counts=True)[1] != 2))
    around: dict[int, dict[int, int]] = {}
    for triangle in triangles.tolist():
        for i in range(3):
            around.setdefault(triangle[i], {})[triangle[i - 2]] = triangle[i - 1]
    for follows in around.values():
        first = here = next(iter(follows))
        steps = 0
        while steps < len(follows):
            here, steps = follows.get(here, -1), steps + 1
            if here in (first, -1):
                break
        faults += steps != len(follows) or here != first
    return faults


def full(x: np.ndarray) -> np.ndarray:
    """A field that is positive all over."""
    return np.ones(len(x))


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_block_with_a_cavity(comm: MPI.Comm, cell: str) -> None:
    """A round cavity: closed, turned outwards, the volume right to the square of the mesh size."""
    errors = []
    for n in (6, 12):
        elements = (2 * n, n, n)
        domain = ffr.Domain.box(comm, 0.8, 0.4, 0.4, elements=elements, cell=cell, solid_layers=1)
        with pytest.warns(ffr.PartWarning, match="enclosed cavities: 1, .* powder stays in"):
            solid = Solid(
                domain,
                lambda x: np.linalg.norm(x - [0.4, 0.0, 0.0], axis=1) - 0.15,
                material=ffr.Isotropic(1.0, 0.3, 1000.0),
            )
        assert n > 6 or faults(solid.triangles) == 0
        (cavity,) = solid.cavities
        assert cavity.volume == pytest.approx(0.128 - solid.volume, rel=1e-9)
        np.testing.assert_allclose(cavity.center, [0.4, 0.0, 0.0], atol=2e-3)
        assert solid.pieces == 1
        assert not solid.loose
        assert enclosed(solid.points, solid.triangles) == pytest.approx(solid.volume, rel=1e-12)
        assert solid.mass == pytest.approx(1000.0 * solid.volume)
        errors.append(abs(solid.volume - (0.128 - 4.0 / 3.0 * np.pi * 0.15**3)))
    assert errors[0] < 2e-2 * 0.128
    assert errors[1] < 0.4 * errors[0]


@pytest.mark.mpi
def test_pieces(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """A piece that nothing holds is left out and said, and the rest is written and read back."""
    domain = ffr.Domain.box(comm, 0.8, 0.2, 0.2, elements=(16, 4, 4), solid_layers=1)

    def field(x: np.ndarray) -> np.ndarray:
        ends = np.abs(x[:, 0] - 0.4) - 0.22
        return np.maximum(ends, 0.06 - np.linalg.norm(x - [0.4, 0.0, 0.0], axis=1))

    with pytest.warns(ffr.PartWarning, match="1 pieces of .* touch no interface and are left out"):
        solid = Solid(domain, field)
    assert solid.pieces == 2
    assert solid.volume == pytest.approx(2 * 0.18 * 0.04, rel=1e-9)
    for unit, cubic in (("mm", 1e-9), ("m", 1.0)):
        (path,) = solid.write(shared_tmp_path / f"{unit}.stl", unit=unit)
        if comm.rank == 0:
            surface = pyvista.read(path)
            assert surface.n_cells == len(solid.triangles)
            assert cubic * surface.volume == pytest.approx(solid.volume, rel=1e-6)
    with pytest.raises(ValueError, match=r"the kind '\.step' .* is not known"):
        solid.write(shared_tmp_path / "solid.step")


def plate(x: np.ndarray) -> np.ndarray:
    """A plate of 62 mm between two blocks."""
    return np.maximum(0.031 - np.abs(x[:, 2] + 0.01), np.abs(x[:, 0] - 0.4) - 0.25)


def slot(x: np.ndarray) -> np.ndarray:
    """Two prongs of 150 and 130 mm with 120 mm between them, which end freely."""
    return np.maximum(np.abs(x[:, 1] - 0.01) - 0.06, 0.2 - x[:, 0])


@pytest.mark.parametrize(("field", "member", "gap"), [(slot, 0.13, 0.12), (plate, 0.062, None)])
def test_thinnest_member_and_narrowest_gap(
    comm: MPI.Comm, field: Callable[[np.ndarray], np.ndarray], member: float, gap: float | None
) -> None:
    """Flat ones are exact, as the surface is."""
    domain = ffr.Domain.box(comm, 0.8, 0.4, 0.4, elements=(16, 8, 8), solid_layers=0)
    solid = Solid(domain, field)
    measured = solid.thinnest_member, solid.narrowest_gap
    for width, exact in zip(measured, (member, gap), strict=True):
        assert (width is None) == (exact is None)
        if width is not None:
            assert width.value == pytest.approx(exact, rel=1e-9)
            assert np.linalg.norm(width.ends[1] - width.ends[0]) == pytest.approx(width.value)


def post(x: np.ndarray) -> np.ndarray:
    """A post between two blocks, its section a triangle of equal sides about a disc of 80 mm."""
    turns = 2.0 * np.pi / 3.0 * np.arange(3) + 0.2
    sides = 0.04 - x[:, 1:] @ np.stack([np.cos(turns), np.sin(turns)])
    return np.maximum(sides.min(axis=1), np.abs(x[:, 0] - 0.4) - 0.22)


def window(x: np.ndarray) -> np.ndarray:
    """A plate of 70 mm with a window whose rims are bevelled."""
    beside = np.hypot(x[:, 0] - 0.4, x[:, 1]) - 0.06 - np.maximum(x[:, 2] + 0.02, 0.0)
    return np.minimum(0.035 - np.abs(x[:, 2]), beside)


@pytest.mark.parametrize(("field", "member"), [(post, 0.08), (window, None)])
def test_posts_are_members_and_rims_are_none(
    comm: MPI.Comm, field: Callable[[np.ndarray], np.ndarray], member: float | None
) -> None:
    """No side of the post is opposite of another; the window has rims thinner than its plate."""
    domain = ffr.Domain.box(comm, 0.8, 0.4, 0.4, elements=(16, 8, 8), solid_layers=0)
    measured = Solid(domain, field).thinnest_member
    assert (measured is None) == (member is None)
    assert measured is None or measured.value == pytest.approx(member, rel=0.05)


def test_gap_between_two_edges(comm: MPI.Comm) -> None:
    """No way across leads straight from face to face: the ball is told, right to a spacing."""
    blocks = [pyvista.Box((a, a + 1.0, a, a + 1.0, 0.0, 1.0)).triangulate() for a in (0.0, 1.4)]
    points = np.concatenate([block.points for block in blocks])
    faces = [block.faces.reshape(-1, 4)[:, 1:] for block in blocks]
    triangles = np.concatenate([faces[0], faces[1] + len(blocks[0].points)])
    measured = ball_widths.surface_balls(points, triangles, 0.05, around=True).thinnest()
    assert measured is not None
    assert measured.value == pytest.approx(0.4 * np.sqrt(2.0), abs=0.125)


@pytest.mark.mpi
@pytest.mark.parametrize("finer", [0, 1, 3])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_meshes_have_the_interfaces_and_regions(comm: MPI.Comm, cell: str, finer: int) -> None:
    """A slanted cut of known volume, past a region that stays solid and one that stays void."""
    options = {"cell": cell, "solid_layers": 1}
    options["void"] = lambda x: (x[0] > 0.29) & (x[0] < 0.51) & (x[1] > 0.03)
    domain = ffr.Domain.box(comm, 0.8, 0.2, 0.2, elements=(8, 3, 3), **options)
    # above the plane, but for the regions
    solid = Solid(domain, lambda x: 0.02 + 0.5 * (x[:, 0] - 0.4) - x[:, 1])
    size = ffr.fem.Tetrahedra.size(domain, finer if cell == "hexahedron" else finer // 2)
    mesh = solid.domain(size, order=1)
    x = np.linspace(0.1, 0.7, 600_001)
    top = 0.02 + 0.5 * (x - 0.4)
    top = np.where((x > 0.3) & (x < 0.5), np.minimum(top, 0.1 / 3.0), top)
    volume = 2 * 0.1 * 0.04 + 0.2 * 0.6 * np.mean(np.clip(top + 0.1, 0.0, 0.2))
    assert mesh.area == pytest.approx(volume, rel=1e-5)
    assert faults(solid.triangles) == 0
    assert mesh.sum(mesh.cell_volumes * mesh.solid_cells) == pytest.approx(0.008, rel=1e-12)
    assert list(mesh.interfaces) == ["left", "right"]
    for name, part in mesh.interfaces.items():
        before = domain.interfaces[name]
        np.testing.assert_allclose(part.center, before.center, atol=1e-15)
        np.testing.assert_allclose(part.axis, before.axis, atol=1e-12)
        assert part.extent == pytest.approx(before.extent, rel=1e-12)


@pytest.mark.mpi
def test_a_bore_is_found_again(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """Finer meshes are rounder: their nodes are on the cylinder, of which the axis is found."""
    path = shared_tmp_path / "block.msh"
    if comm.rank == 0:
        write_pierced_block(path, tilt=0.3)
    comm.Barrier()
    domain = ffr.Domain.from_gmsh(comm, path, interfaces=["left", "bore"])
    solid = Solid(domain, lambda x: np.linalg.norm(x - [-0.2, 0.0, 0.1], axis=1) - 0.07)
    mesh = solid.domain(0.5 * ffr.fem.Tetrahedra.size(domain), order=1)
    for name, part in mesh.interfaces.items():
        before = domain.interfaces[name]
        np.testing.assert_allclose(part.center, before.center, atol=1e-15)
        np.testing.assert_allclose(part.axis, before.axis, atol=1e-6)
    bore = domain.interfaces["bore"]
    assert bore.axis is not None
    nodes = mesh.space.tabulate_dof_coordinates()[mesh.interfaces["bore"].dofs] - bore.center
    radii = np.linalg.norm(np.cross(nodes, bore.axis), axis=1)
    np.testing.assert_allclose(radii, 0.1, rtol=1e-6)


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:reduction. modes")
def test_psi_of_a_mesh_of_its_own(comm: MPI.Comm) -> None:
    """A solid has the psi of hexahedra of order 2 that fit it, on any number of ranks."""

    def verified(of: MPI.Comm) -> ffr.Verification:
        domain = ffr.Domain.box(of, ROD, *SECTION, elements=(8, 1, 4), order=2)
        scene = spatial_problem(of, domain=domain, modes=4, steps=240)
        rod = scene.flexible["rod"].with_interpolation(ffr.SIMP(floor=1e-9))
        limit = ffr.Constraint(ffr.PeakStress("rod"), upper=1e12, name="stress")
        arguments = scene.mechanism, scene.integrator, scene.objective, [limit]
        problem = ffr.Problem({"rod": rod}, *arguments)

        def half(x: np.ndarray) -> np.ndarray:
            return 0.25 * SECTION[1] - np.abs(x[:, 2])

        full_cells = domain.solid_cells | (half(domain.centroids) > 0.0)
        solid = Solid(domain, half, material=rod.material)
        verification = solid.verify(problem, problem.value(1.0 * full_cells), tolerance=0.05)
        finest = verification.fitted[-1]
        assert finest.bodies["rod"].mass == pytest.approx(solid.mass, rel=1e-9)
        # what is held against the limit is the largest stress of the solid itself
        assert finest.constraints["stress"] == pytest.approx(finest.bodies["rod"].stress, rel=1e-9)
        return verification

    verification = verified(comm)
    assert verification.difference == pytest.approx(0.0, abs=0.01)
    assert "tetrahedra, 4 modes" in str(verification)
    record = verification.record()["bodies"]["rod"]
    assert record["pieces"] == 1 and "holes" not in record
    if comm.size > 1:
        assert verification.psi == pytest.approx(verified(MPI.COMM_SELF).psi, rel=1e-8)


def test_refusals(comm: MPI.Comm) -> None:
    """No material, and a body in the plane."""
    free = ffr.Domain.box(comm, 0.8, 0.2, 0.2, elements=(8, 2, 2), solid_layers=0)
    with pytest.raises(ValueError, match="the field is negative everywhere"):
        Solid(free, lambda x: -full(x))
    with pytest.raises(ValueError, match="no material touches an interface"):
        Solid(free, lambda x: 0.1 - np.linalg.norm(x - [0.4, 0.0, 0.0], axis=1))
    with pytest.raises(ValueError, match=r"surface must lie between 0 and 0\.05, 0 excluded"):
        Solid(free, full, size=0.05, surface=0.1)
    complete = Solid(free, full)
    with pytest.raises(ValueError, match="tetrahedra are more than the limit of 8,000,000"):
        complete.domain(1e-9)
    with pytest.raises(ValueError, match="or fewer meshes"):
        complete.sizes(None, 200)
    flat = ffr.Domain.rectangle(comm, 0.8, 0.2, elements=(8, 2))
    with pytest.raises(ValueError, match="the body is in the plane; take a Part"):
        Solid(flat, full)
    with pytest.raises(ValueError, match="the body is in space; take a Solid"):
        ffr.Part(free, full)


def test_a_density_design_in_space(comm: MPI.Comm) -> None:
    """Filter, projection and pullback on hexahedra; its solid keeps what stays solid."""
    domain = ffr.Domain.box(comm, 0.8, 0.2, 0.2, elements=(16, 4, 4), solid_layers=1)
    design = ffr.DensityDesign(domain).at(0.3)
    assert design.filter.radius == pytest.approx(2.5 * 0.05)
    rng = np.random.default_rng(1)
    z, direction = rng.uniform(0.2, 0.8, design.size), rng.standard_normal(design.size)
    weights = np.cos(9.0 * domain.centroids[:, 0]) * domain.cell_volumes
    slope = design.pullback(z, weights) @ direction
    step = 1e-5
    pair = [domain.sum(weights * design.density(z + s * direction)) for s in (step, -step)]
    assert slope == pytest.approx((pair[0] - pair[1]) / (2 * step), rel=1e-6)
    tube = np.linalg.norm(domain.everywhere(domain.centroids)[:, 1:], axis=1) < 0.1
    values = tube[domain.everywhere(domain.design_cells)].astype(float)
    solid = Solid.of(ffr.DensityDesign(domain, radius=0.0), values)
    assert solid.pieces == 1
    assert faults(solid.triangles) == 0
    assert 0.3 < solid.volume / domain.area < 0.9


@pytest.mark.filterwarnings("ignore:solid. :dolfinx_ffr.part.PartWarning")
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_surfaces_of_random_fields_are_manifold(comm: MPI.Comm, cell: str) -> None:
    """Waves shorter than a few cells and signs at the corners alone: no edge has four faces."""
    counts = np.array([6, 3, 3])
    regions = {"solid": lambda x: x[2] < -0.08, "void": lambda x: np.hypot(x[0] - 0.5, x[1]) < 0.15}
    # each kind of field with and without regions; of several ranks a few show that they agree
    for seed in range(12 if comm.size == 1 else 4):
        options = {"cell": cell, "solid_layers": 1, **(regions if seed % 4 == 3 else {})}
        domain = ffr.Domain.box(comm, 1.0, 0.5, 0.5, elements=(6, 3, 3), **options)
        rng = np.random.default_rng(seed)
        waves, phase = rng.normal(0.0, 6.0 * (1 + seed % 3), (6, 3)), rng.uniform(0.0, 6.0, 6)
        sign = rng.choice([-1.0, 1.0], counts + 1)

        def field(
            x: np.ndarray,
            waves: np.ndarray = waves,
            phase: np.ndarray = phase,
            sign: np.ndarray | None = sign if seed % 3 == 2 else None,
        ) -> np.ndarray:
            if sign is None:
                return np.cos(x @ waves.T + phase).sum(axis=1)
            places = np.rint(np.add(x, [0.0, 0.25, 0.25]) * counts / [1.0, 0.5, 0.5]).astype(int)
            return sign[tuple(places.T)]

        solid = Solid(domain, field)
        assert faults(solid.triangles) == 0, seed
        assert enclosed(solid.points, solid.triangles) == pytest.approx(solid.volume, rel=1e-9)


def test_regions_that_meet_in_an_edge(comm: MPI.Comm) -> None:
    """What no cut can mend is told, with the place."""
    domain = ffr.Domain.box(
        comm, 1.0, 0.5, 0.5, elements=(4, 2, 2), solid_layers=1,
        solid=lambda x: (x[0] < 0.51) & (x[1] * x[2] > -1e-9),
    )  # fmt: skip
    with pytest.warns(ffr.PartWarning, match=r"touches itself at 2 points.*\(0\.(25|5), 0, 0\) m"):
        solid = Solid(domain, lambda x: -full(x))
    assert faults(solid.triangles) > 0
