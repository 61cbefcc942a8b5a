# SPDX-License-Identifier: MIT
"""Bodies that strain the elements: slender, distorted, incompressible, very stiff or soft."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import mesh
from shared.body_compliance import check_body_gradient, round_off
from shared.rods import STEEL

import dolfinx_ffr as ffr

BETA = 1.87510406871196  # clamped-free beam


def first_frequency(body: ffr.FlexibleBody) -> float:
    """The first fixed-interface frequency of the full body [Hz]."""
    return float(body.reduce(np.ones(body.domain.n_cells)).basis.frequencies[0])


@contextmanager
def warns_of_round_off(expected: bool) -> Iterator[None]:
    """Demand a warning of round-off, or that there is none."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    assert any(issubclass(w.category, ffr.RoundOffWarning) for w in caught) == expected


def cantilever(
    comm: MPI.Intracomm,
    length: float,
    height: float,
    elements: tuple[int, int],
    material: ffr.PlaneStress,
    cell: str = "quadrilateral",
    **options: object,
) -> ffr.FlexibleBody:
    """A bar held at its left end alone."""
    corners = [np.array([0.0, -height / 2]), np.array([length, height / 2])]
    grid = mesh.create_rectangle(comm, corners, list(elements), getattr(mesh.CellType, cell))
    domain = ffr.Domain(grid, {"root": lambda x: x[0] < 1e-9 * length}, order=2)
    frame = ffr.TangentFrame("root")
    return ffr.FlexibleBody(domain, material, frame=frame, modes=2, **options)  # type: ignore[arg-type]


def beam_frequency(length: float, height: float, material: ffr.PlaneStress) -> float:
    """The first frequency of a clamped-free Euler-Bernoulli beam [Hz]."""
    young = material.young
    if isinstance(material, ffr.PlaneStrain):
        young /= 1.0 - material.poisson**2
    stiffness = young * height**2 / 12.0
    return (BETA / length) ** 2 * math.sqrt(stiffness / material.density) / (2.0 * math.pi)


@pytest.mark.parametrize("aspect", [100.0, 1000.0])
def test_slender_rods(comm: MPI.Intracomm, aspect: float) -> None:
    """Elements as long as 25 times their height do not lock; round-off is told where it shows."""
    body = cantilever(comm, 1.0, 1.0 / aspect, (40, 1), STEEL)
    expected = beam_frequency(1.0, 1.0 / aspect, STEEL)
    with warns_of_round_off(aspect > 300.0):
        frequency = first_frequency(body)
    # the clamped end's hindered contraction adds about a height times nu to the stiffness
    assert frequency == pytest.approx(expected, rel=max(2e-3, 0.2 / aspect))
    x = np.full(body.domain.n_cells, 0.9)
    if aspect < 300.0:
        check_body_gradient(body, x, comm)
    else:
        with warns_of_round_off(True):
            assert 1e-6 < round_off(body, x) < 1e-2


@pytest.mark.parametrize("poisson", [0.4999, 0.499999])
def test_nearly_incompressible_plane_strain(comm: MPI.Intracomm, poisson: float) -> None:
    """Biquadratic elements bend as they should, however little the volume may change."""
    material = ffr.PlaneStrain(1e6, poisson, 1000.0, 1.0)
    body = cantilever(comm, 1.0, 0.05, (80, 4), material)
    with warns_of_round_off(poisson > 0.4999):
        frequency = first_frequency(body)
    assert frequency == pytest.approx(beam_frequency(1.0, 0.05, material), rel=2e-2)
    x = np.full(body.domain.n_cells, 0.9)
    if poisson <= 0.4999:
        # steps whose remainders stand above the round-off
        check_body_gradient(body, x, comm, first_step=0.1, roundoff=round_off(body, x))
    else:
        with warns_of_round_off(True):
            assert 1e-6 < round_off(body, x) < 1e-3


def test_badly_shaped_triangles(comm: MPI.Intracomm) -> None:
    """Needles with angles of half a degree: frequencies from above, and within a few percent."""
    # elements 0.125 x 0.0042, cut along their diagonal
    body = cantilever(comm, 1.0, 0.1, (8, 24), STEEL, "triangle")
    frequency = first_frequency(body)
    fine = first_frequency(cantilever(comm, 1.0, 0.1, (40, 4), STEEL))
    # conforming elements are too stiff, never too soft
    assert fine < frequency < 1.03 * fine
    check_body_gradient(body, np.full(body.domain.n_cells, 0.9), comm)


@pytest.mark.mpi
def test_contrast_of_materials(comm: MPI.Intracomm) -> None:
    """Stiffness that jumps by 1e9 from element to element: a sandwich like its solid layers."""
    body = cantilever(comm, 1.0, 0.1, (40, 4), STEEL, interpolation=ffr.SIMP(floor=1e-9))
    domain = body.domain
    outer = np.abs(domain.centroids[:, 1]) > 0.025
    x = np.where(outer, 1.0, 0.0)
    layers = body.reduce(x)
    # next to nothing holds the layers together: each bends by itself
    reference = first_frequency(cantilever(comm, 1.0, 0.025, (40, 1), STEEL))
    assert layers.basis.frequencies[0] == pytest.approx(reference, rel=2e-3)
    assert layers.basis.frequencies[1] == pytest.approx(reference, rel=2e-3)
    check_body_gradient(body, x, comm)
