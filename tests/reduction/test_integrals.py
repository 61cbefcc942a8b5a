# SPDX-License-Identifier: MIT
"""Volume integrals: rigid-body invariants, markers, and the pullback to the density."""

from __future__ import annotations

from collections.abc import Callable

from mpi4py import MPI

import numpy as np
import pytest

from dolfinx_ffr import (
    RAMP,
    SIMP,
    ChordFrame,
    Domain,
    FlexibleBody,
    LinearMass,
    PlaneStrain,
    PlaneStress,
    TangentFrame,
    VolumeIntegrals,
)
from dolfinx_ffr.reduction.point_marker import PointMarker
from dolfinx_ffr.verification import assert_taylor_order, central_difference, taylor_test

STEEL = PlaneStress(210e9, 0.3, 7850.0, 0.01)
pytestmark = pytest.mark.mpi


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
@pytest.mark.parametrize("order", [1, 2])
def test_rigid_body_integrals(comm: MPI.Intracomm, cell: str, order: int) -> None:
    """Mass, first moment and inertia of a uniform rod are exact."""
    length, height = 0.4, 0.04
    domain = Domain.rectangle(comm, length, height, elements=(12, 2), cell=cell, order=order)
    body = FlexibleBody(domain, STEEL, frame=ChordFrame("left", "right"), modes=3)
    integrals = body.reduce(np.ones(domain.n_cells)).integrals
    mass = 7850.0 * 0.01 * length * height
    assert integrals.mass == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(integrals.S[0], [mass * length / 2, 0.0], atol=1e-13 * mass)
    assert integrals.G[0, 0] == pytest.approx(mass * (length**2 / 3 + height**2 / 12), rel=1e-12)
    integrals.validate("rod")
    np.testing.assert_array_equal(integrals.N, -integrals.N.T)
    np.testing.assert_allclose(integrals.markers["right"].position, [length, 0.0], atol=1e-15)


def test_volume_and_its_derivative(comm: MPI.Intracomm) -> None:
    """The filled share is linear in the density, on cells of different size too."""
    body = BODIES["triangles"](comm)
    c = body.domain.centroids
    density, direction = 0.5 + 0.3 * np.sin(40 * c[:, 0]), 0.1 * np.cos(90 * c[:, 1])
    before, derivative = body.volume(density)
    after, _ = body.volume(density + direction)
    slope = comm.allreduce(float(derivative @ direction))
    assert after - before == pytest.approx(slope, rel=1e-9)
    assert body.volume(np.ones(body.domain.n_cells))[0] == pytest.approx(1.0, rel=1e-13)


def test_frames_agree_on_rigid_motion(comm: MPI.Intracomm) -> None:
    """The rotating field J w_0 is a combination of rigid fields: its products are S and G."""
    domain = Domain.rectangle(comm, 0.4, 0.04, elements=(12, 2))
    body = FlexibleBody(domain, STEEL, frame=TangentFrame("right"), modes=3)
    integrals = body.reduce(np.linspace(0.2, 1.0, domain.n_cells)).integrals
    # left end as a marker of the frame in the right end
    np.testing.assert_allclose(integrals.markers["left"].position, [-0.4, 0.0], atol=1e-14)
    np.testing.assert_array_equal(integrals.markers["right"].displacement, np.zeros((2, 6)))
    np.testing.assert_array_equal(integrals.markers["left"].displacement[:, :3], np.eye(3)[:2])


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
@pytest.mark.parametrize("order", [1, 2])
def test_marker_motion_of_known_fields(comm: MPI.Intracomm, cell: str, order: int) -> None:
    """Displacement and rotation at a point are exact for fields that the space holds."""
    domain = Domain.rectangle(comm, 1.0, 0.3, elements=(7, 3), cell=cell, order=order)
    x = domain.space.tabulate_dof_coordinates()[: domain.space.dofmap.index_map.size_local, :2]
    fields = np.zeros((2 * len(x), 2))
    fields[0::2, 0], fields[1::2, 0] = 1.0 - 2.0 * x[:, 1], 0.5 + 3.0 * x[:, 0]
    if order == 2:
        fields[1::2, 1] = x[:, 0] ** 2
    # inside a cell, on an edge, in a vertex, and on the boundary
    for point in ([0.31, 0.07], [0.31, 0.05], [2 / 7, 0.05], [1.0, 0.15]):
        displacement, rotation = PointMarker.at(domain, point).motion(fields)
        exact = [1.0 - 2.0 * point[1], 0.5 + 3.0 * point[0]]
        np.testing.assert_allclose(displacement[:, 0], exact, rtol=1e-12)
        assert rotation[0] == pytest.approx(2.5, rel=1e-11)
        if order == 2:
            assert displacement[1, 1] == pytest.approx(point[0] ** 2, rel=1e-12)
            assert rotation[1] == pytest.approx(point[0], rel=1e-11)


def test_marker_pullback_is_the_transpose(comm: MPI.Intracomm) -> None:
    """<motion(u), p> = <u, pullback(p)>."""
    domain = Domain.rectangle(comm, 1.0, 0.3, elements=(7, 3), order=2)
    marker = PointMarker.at(domain, (2 / 7, 0.05))
    x = domain.space.tabulate_dof_coordinates()[: domain.space.dofmap.index_map.size_local, :2]
    field = np.sin(7 * x).reshape(-1, 1)
    displacement, rotation = marker.motion(field)
    p, s = np.array([[0.3], [-2.0]]), np.array([1.7])
    forward = float((displacement * p).sum() + (rotation * s).sum())
    backward = comm.allreduce(float((marker.pullback(p, s) * field).sum()))
    assert backward == pytest.approx(forward, rel=1e-13)


def test_marker_outside(comm: MPI.Intracomm) -> None:
    """A point off the body is refused on every rank."""
    domain = Domain.rectangle(comm, 1.0, 0.3, elements=(7, 3))
    for point in ((1.2, 0.0), (0.5, 0.1501)):
        with pytest.raises(ValueError, match=r"marker 'tip'.*lies outside the body"):
            PointMarker.at(domain, point, "tip")
    with pytest.raises(ValueError, match="position holds NaN"):
        PointMarker.at(domain, (float("nan"), 0.0))


def test_point_with_the_name_of_an_interface(comm: MPI.Intracomm) -> None:
    """Markers have names of their own."""
    domain = Domain.rectangle(comm, 1.0, 0.3, elements=(7, 3))
    with pytest.raises(ValueError, match=r"markers \['left'\] have the names of interfaces"):
        FlexibleBody(
            domain, STEEL, frame=TangentFrame("left"), modes=1, markers={"left": (0.5, 0.0)}
        )


def forced_response(integrals: VolumeIntegrals) -> tuple[float, VolumeIntegrals]:
    """A number that reads every integral and does not depend on the choice of basis.

    psi = f^T (K - w^2 G)^-1 f + c m, with loads f from S, G, N and from markers.
    """
    frequency_squared, tip, end = 1e6, integrals.markers["tip"], integrals.markers["right"]
    f = integrals.S[1:] @ np.array([3.0, 2.0]) + 50 * integrals.N[0, 1:] + 70 * integrals.G[0, 1:]
    f = f + 0.1 * tip.displacement[1] + 0.01 * tip.rotation + 0.1 * end.rotation
    q = np.linalg.solve(integrals.K - frequency_squared * integrals.G[1:, 1:], f)
    bar = integrals.zeros_like()
    bar.S[1:] = np.outer(2 * q, [3.0, 2.0])
    bar.N[0, 1:], bar.N[1:, 0] = 50 * q, -50 * q
    bar.G[0, 1:] = bar.G[1:, 0] = 70 * q
    bar.G[1:, 1:] = frequency_squared * np.outer(q, q)
    bar.K[:] = -np.outer(q, q)
    bar.markers["tip"].displacement[1] = 0.2 * q
    bar.markers["tip"].rotation[:] = 0.02 * q
    object.__setattr__(bar, "mass", 1e-5)
    object.__setattr__(bar, "S", bar.S + np.outer(np.eye(len(bar.S))[0], [0.0, 2e-4]))
    first_moment = 2e-4 * integrals.S[0, 1]
    return float(f @ q) + 1e-5 * integrals.mass + first_moment, bar


BODIES: dict[str, Callable[[MPI.Intracomm], FlexibleBody]] = {
    "bilinear": lambda comm: FlexibleBody(
        Domain.rectangle(comm, 0.4, 0.04, elements=(24, 4)),
        STEEL,
        frame=ChordFrame("left", "right"),
        modes=4,
        markers={"tip": (0.21, 0.003)},
    ),
    "biquadratic": lambda comm: FlexibleBody(
        Domain.rectangle(comm, 0.4, 0.04, elements=(12, 2), order=2),
        PlaneStrain(70e9, 0.33, 2700.0, 0.02),
        frame=TangentFrame("left"),
        modes=5,
        markers={"tip": (0.2, 0.0)},
    ),
    "triangles": lambda comm: FlexibleBody(
        Domain.rectangle(comm, 0.4, 0.04, elements=(12, 2), cell="triangle", order=2),
        STEEL,
        frame=ChordFrame("left", "right"),
        modes=3,
        interpolation=RAMP(6.0, 1e-2),
        markers={"tip": (0.37, 0.02)},
    ),
    "no normal modes": lambda comm: FlexibleBody(
        Domain.rectangle(comm, 0.4, 0.04, elements=(12, 2)),
        STEEL,
        frame=ChordFrame("left", "right"),
        modes=0,
        interpolation=SIMP(3.0, 1e-6, LinearMass()),
        markers={"tip": (0.21, 0.003)},
    ),
}


@pytest.mark.parametrize("kind", BODIES)
@pytest.mark.parametrize("where", ["smooth", "solid", "with void"])
def test_pullback_from_integrals_to_density(comm: MPI.Intracomm, kind: str, where: str) -> None:
    """Taylor order 2, and agreement with differences, of density -> integrals -> number."""
    body = BODIES[kind](comm)
    c = body.domain.centroids
    wave = np.sin(40 * c[:, 0] + 200 * c[:, 1])
    direction = np.cos(37 * c[:, 0] + 130 * c[:, 1] + 0.3)
    density = 0.6 + 0.3 * wave
    if where == "solid":
        density, direction = np.ones_like(wave), -np.abs(direction)
    elif where == "with void":
        density = np.where((np.abs(c[:, 0] - 0.1) < 0.05) & (c[:, 1] > 0.0), 0.0, 1.0)
        density[~body.domain.design_cells] = 1.0
        direction = np.where(density > 0.5, -np.abs(direction), np.abs(direction))

    def value(x: np.ndarray) -> float:
        return forced_response(body.reduce(x).integrals)[0]

    reduced = body.reduce(density)
    gradient, _ = body.pullback(reduced, forced_response(reduced.integrals)[1])

    def slope(d: np.ndarray) -> float:
        return comm.allreduce(float(gradient @ d))

    # RAMP leaves its floor at a finite slope: steps must stay well below floor (1 + q)
    largest = 1e-3 if kind == "triangles" else 1e-2
    steps = [largest / 2**k for k in range(4)]
    result = taylor_test(value, slope, density, direction, steps=steps, roundoff=1e-11)
    assert_taylor_order(result)
    if where == "smooth":
        difference = central_difference(value, density, direction, 2e-3)
        assert slope(direction) == pytest.approx(difference, rel=1e-6)
