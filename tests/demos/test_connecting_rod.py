# SPDX-License-Identifier: MIT
"""A connecting rod from gmsh: area and mass in closed form, round interfaces, physical groups."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
from dolfinx import mesh
from meshes.connecting_rod import ConnectingRod, main, session
from shared.meshes import area_of

from dolfinx_ffr import ChordFrame, Domain, FlexibleBody, PlaneStress
from dolfinx_ffr.fem import _compat, fit_circle
from dolfinx_ffr.io import on_rank_0
from dolfinx_ffr.verification import convergence_order

ROD = ConnectingRod()
AREA = area_of(ROD)
RINGS = np.pi * sum((b + r) ** 2 - b**2 for b, r in zip(ROD.bores, ROD.rings, strict=True))


@pytest.mark.mpi
@pytest.mark.parametrize(("order", "expected"), [(1, 2.0), (2, 4.0)])
def test_area_converges_to_the_closed_form(comm: MPI.Comm, order: int, expected: float) -> None:
    """Straight cells cut curves off in the second order, curved ones in the fourth."""
    levels = [0, 1, 2]
    domains = [ROD.domain(comm, 0.01, order=order, refinements=n) for n in levels]
    holes = [abs(d.sum(d.cell_volumes * ~d.design_cells) / RINGS - 1.0) for d in domains]
    errors = [abs(d.area / AREA - 1.0) for d in domains]
    sizes = 0.5 ** np.array(levels)
    assert convergence_order(sizes, np.array(holes)) == pytest.approx(expected, abs=0.1)
    assert convergence_order(sizes, np.array(errors)) == pytest.approx(expected, abs=0.1)
    assert errors[-1] < (2e-5 if order == 1 else 1e-8)


def test_other_dimensions_have_the_area_of_the_closed_form(comm: MPI.Comm) -> None:
    """A shank that widens towards the right, small fillets, a short rod."""
    dimensions = {
        "bores": (0.01, 0.02),
        "eyes": (0.03, 0.04),
        "rings": (0.01, 0.005),
        "fillet": 0.005,
    }
    rod = ConnectingRod(length=0.2, shank=(0.01, 0.03), **dimensions)
    domain = rod.domain(comm, 0.003)
    assert domain.area == pytest.approx(area_of(rod), rel=2e-7)
    assert domain.bounding_box == pytest.approx(np.array([[-0.03, -0.04], [0.24, 0.04]]), rel=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rings": (0.03, 0.005)}, "do not fit into the eye"),
        ({"fillet": 2.0}, "fillets of 2.0 m overlap"),
        ({"length": -1.0}, "positive dimensions"),
    ],
)
def test_impossible_dimensions(change: dict[str, object], message: str) -> None:
    """What cannot be drawn is named before gmsh tries."""
    with pytest.raises(ValueError, match=message):
        ConnectingRod(**change)


@pytest.mark.mpi
def test_impossible_sizes(comm: MPI.Comm) -> None:
    """An error on rank 0 is raised everywhere, and gmsh is closed again."""
    with pytest.raises(ValueError, match="size = -1"):
        ROD.domain(comm, -1.0)
    with pytest.raises(ValueError, match="order = 3"):
        ROD.domain(comm, 0.01, order=3)
    assert ROD.domain(comm, 0.012).n_cells_global > 300


def permuted(numbers: list[tuple[str, int]], *, twice: str = "") -> Callable[[], None]:
    """A function that makes the rod in gmsh with other numbers of its physical groups."""

    def build() -> None:
        ROD.build(0.01, order=2)
        groups = {}
        for dim, tag in gmsh.model.getPhysicalGroups():
            name = gmsh.model.getPhysicalName(dim, tag)
            groups[name] = (dim, list(gmsh.model.getEntitiesForPhysicalGroup(dim, tag)))
            gmsh.model.removePhysicalName(name)
        gmsh.model.removePhysicalGroups()
        for name, number in numbers:
            dim, entities = groups[name]
            tag = gmsh.model.addPhysicalGroup(dim, entities[::-1], number)
            gmsh.model.setPhysicalName(dim, tag, name)
        if twice:
            dim, entities = groups[twice]
            gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, entities), "again")

    return build


ORDERS = {
    "as drawn": [("left", 1), ("right", 2), ("design", 3), ("solid", 4)],
    "other order": [("solid", 7), ("right", 1), ("design", 2), ("left", 33)],
    "curves and surfaces share numbers": [("design", 1), ("right", 1), ("left", 2), ("solid", 2)],
}


@pytest.mark.mpi
@pytest.mark.parametrize("from_file", [True, False])
@pytest.mark.parametrize("numbers", ORDERS.values(), ids=ORDERS)
def test_groups_are_found_by_name(
    comm: MPI.Comm, shared_tmp_path: Path, numbers: list[tuple[str, int]], from_file: bool
) -> None:
    """Numbers and order of the physical groups have no meaning."""
    with session(comm.rank == 0):
        on_rank_0(comm, permuted(numbers))
        if from_file:
            path = shared_tmp_path / "rod.msh"
            on_rank_0(comm, lambda: gmsh.write(str(path)))
        else:
            model = gmsh.model if comm.rank == 0 else None
            domain = Domain.from_gmsh_model(comm, model, order=2)
    if from_file:
        domain = Domain.from_gmsh(comm, path, order=2)
    assert domain.area == pytest.approx(AREA, rel=1e-6)
    solid = domain.sum(domain.cell_volumes * ~domain.design_cells)
    assert solid == pytest.approx(RINGS, rel=1e-5)
    for name, x, radius in (("left", 0.0, ROD.bores[0]), ("right", ROD.length, ROD.bores[1])):
        interface = domain.interfaces[name]
        np.testing.assert_allclose(interface.center, [x, 0.0], atol=1e-12)
        points = domain.space.tabulate_dof_coordinates()[interface.dofs, :2]
        distance = np.linalg.norm(points - interface.center, axis=1)
        np.testing.assert_allclose(distance, radius, rtol=1e-4)


def drawn_alone() -> None:
    """The rod in gmsh without a mesh."""
    ROD.build(0.01)
    gmsh.model.mesh.clear()


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("build", "message"),
    [
        # cells would count twice: both groups are named
        (permuted(ORDERS["as drawn"], twice="solid"), r"physical surfaces \['again', 'solid'\]"),
        (drawn_alone, r"has no mesh; call gmsh\.model\.mesh\.generate"),
    ],
)
def test_unusable_models(comm: MPI.Comm, build: Callable[[], None], message: str) -> None:
    with session(comm.rank == 0), pytest.raises(ValueError, match=message):
        on_rank_0(comm, build)
        Domain.from_gmsh_model(comm, gmsh.model if comm.rank == 0 else None)


@pytest.mark.mpi
def test_folded_curved_cell(comm: MPI.Comm) -> None:
    """A curved cell whose middle node has gone astray is refused."""
    domain = ROD.domain(comm, 0.012).mesh
    cells = _compat.cell_geometry(domain)
    if comm.rank == 0:
        x = domain.geometry.x
        x[cells[0, 5]] += 3.0 * (x[cells[0, 2]] - x[cells[0, 5]])
    with pytest.raises(ValueError, match="are inverted or without area"):
        Domain(domain, {"left": lambda x: np.hypot(x[0], x[1]) < 0.031})


@pytest.mark.parametrize("share", [1.0, 0.5, 0.2, 0.05])
def test_center_of_an_arc(comm: MPI.Comm, share: float) -> None:
    """The center of a bore, of half of it, and of a fifth, is that of the circle."""
    domain = ROD.domain(comm, 0.006).mesh
    low = np.cos(np.pi * share) - 1e-9

    def arc(x: np.ndarray) -> np.ndarray:
        radius = np.maximum(np.hypot(x[0], x[1]), 1e-12)
        return (radius < 1.001 * ROD.bores[0]) & (x[0] / radius > low)

    interface = Domain(domain, {"arc": arc}, order=2).interfaces["arc"]
    if share < 0.1:  # too short an arc keeps its centroid
        assert np.hypot(*interface.center) == pytest.approx(ROD.bores[0], rel=0.01)
    else:
        np.testing.assert_allclose(interface.center, [0.0, 0.0], atol=1e-12)


def test_what_is_not_round(comm: MPI.Comm) -> None:
    """A bent edge and three sides of a rectangle keep their centroids; an ellipse is no circle."""
    corners = [np.zeros(2), np.array([4.0, 2.0])]
    strip = mesh.create_rectangle(comm, corners, [8, 4], mesh.CellType.quadrilateral)

    def corner(x: np.ndarray) -> np.ndarray:
        return (np.minimum(x[0], x[1]) < 1e-9) & (np.maximum(x[0], x[1]) < 0.6)

    def sides(x: np.ndarray) -> np.ndarray:
        return (np.minimum(x[0], x[1]) < 1e-9) | (x[1] > 2.0 - 1e-9)

    parts = {"corner": corner, "sides": sides}
    for name, center in (("corner", [0.125, 0.125]), ("sides", [1.6, 1.0])):
        computed = Domain(strip, {name: parts[name]}).interfaces[name].center
        np.testing.assert_allclose(computed, center, atol=1e-13)
    angles = np.linspace(0.0, 2.0 * np.pi, 40)
    assert fit_circle(np.column_stack([np.cos(angles), 1.01 * np.sin(angles)])) is None


@pytest.mark.mpi
def test_bearing_moves_about_its_center(comm: MPI.Comm) -> None:
    """The marker of a bore, in empty space, has the motion of the whole bore."""
    domain = ROD.domain(comm, 0.006)
    steel = PlaneStress(210e9, 0.3, 7850.0, 0.01)
    body = FlexibleBody(domain, steel, frame=ChordFrame("left", "right"), modes=3)
    reduced = body.reduce(np.ones(domain.n_cells))
    assert reduced.integrals.mass == pytest.approx(7850.0 * 0.01 * AREA, rel=1e-7)
    # symmetric about its axis
    assert abs(reduced.integrals.S[0, 1]) < 1e-6 * reduced.integrals.S[0, 0]
    coordinates = body.elasticity.coordinates()
    q = np.array([0.3, -0.2, 0.5, 1.0, 2.0, -3.0])
    field = (reduced.basis.shapes @ q).reshape(-1, 2)
    for name, interface in domain.interfaces.items():
        marker = reduced.integrals.markers[name]
        place = interface.center - body.reduction.origin
        np.testing.assert_allclose(marker.position, place, atol=1e-15)
        nodes = interface.dofs[interface.dofs < len(coordinates)]
        arm = coordinates[nodes] - interface.center
        turned = np.column_stack([-arm[:, 1], arm[:, 0]])
        expected = marker.displacement @ q + (marker.rotation @ q) * turned
        np.testing.assert_allclose(field[nodes], expected, atol=1e-14)
    # chord frame: the left center stays, the right one moves along the chord
    left, right = (reduced.integrals.markers[name] for name in ("left", "right"))
    assert np.all(left.displacement == 0.0)
    np.testing.assert_allclose(right.displacement[1], 0.0, atol=1e-15)
    assert left.rotation @ q == 0.3


def test_program_writes_a_mesh(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """The command line takes all dimensions."""
    path = shared_tmp_path / "new" / "rod.msh"
    options = ["--size", "0.01", "--length", "0.3", "--eyes", "0.045", "0.03"]
    on_rank_0(comm, lambda: main([*options, "--output", str(path)]))
    domain = Domain.from_gmsh(comm, path)
    rod = ConnectingRod(length=0.3, eyes=(0.045, 0.03))
    assert domain.area == pytest.approx(area_of(rod), rel=1e-6)
    assert _compat.coordinate_element(domain.mesh).degree == 2
