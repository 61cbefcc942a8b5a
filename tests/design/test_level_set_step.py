# SPDX-License-Identifier: MIT
"""Explicit steps of the level set: descent, bounds, the volume's multiplier."""

from __future__ import annotations

import math
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dolfinx_ffr as ffr
from dolfinx_ffr.design.base import volume_multiplier


def evolution_on(comm: MPI.Intracomm, bound: float, **options: Any) -> ffr.design.Evolution:
    domain = ffr.Domain.rectangle(comm, 0.4, 0.08, elements=(40, 8))
    return ffr.design.Evolution(ffr.LevelSet(domain), bound, **options)


def started(evolution: ffr.design.Evolution) -> np.ndarray:
    return evolution.start(evolution.levelset.with_holes(6, 2, 0.012))


def filled(evolution: ffr.design.Evolution, phi: np.ndarray) -> float:
    """The share of the body that is material."""
    domain = evolution.levelset.domain
    x = evolution.levelset.density(evolution.variables(phi))
    return domain.sum(x * domain.cell_volumes) / domain.area


def loads(domain: ffr.Domain) -> np.ndarray:
    """A gradient with both signs, in proportion to the cells, a function of position alone."""
    c = domain.centroids
    return domain.cell_volumes * np.sin(31.0 * c[:, 0] + 0.3) * np.cos(40.0 * c[:, 1] - 0.2)


@given(bound=st.floats(0.01, 0.99))
def test_bisection_finds_the_multiplier(bound: float) -> None:
    """For the volume 1 / (1 + Lambda) it is 1 / bound - 1."""
    multiplier = volume_multiplier(lambda m: 1.0 / (1.0 + m), bound, 1e-12)
    assert multiplier == pytest.approx(1.0 / bound - 1.0, rel=1e-9)
    assert 1.0 / (1.0 + multiplier) <= bound


def test_bisection_takes_the_feasible_side_of_a_jump() -> None:
    multiplier = volume_multiplier(lambda m: 0.8 if m < 3.7 else 0.2, 0.5)
    assert multiplier == pytest.approx(3.7)
    assert multiplier >= 3.7


@pytest.mark.mpi
def test_bounds_out_of_reach_are_named(comm: MPI.Intracomm) -> None:
    with pytest.raises(ValueError, match=r"stays at 0\.6, above its bound 0\.5"):
        volume_multiplier(lambda m: 0.6 + 0.3 * math.exp(-m), 0.5)
    with pytest.raises(ValueError, match=r"the solid regions alone fill 0\.1 of the body"):
        evolution_on(comm, 0.1)


@pytest.mark.mpi
def test_start_is_a_signed_distance_within_bounds(comm: MPI.Intracomm) -> None:
    evolution = evolution_on(comm, 0.6, band=2.0)
    phi = started(evolution)
    # shrunk by a shift, which moves both ends of the band alike
    assert np.ptp(phi) <= 2 * 2.0 * evolution.levelset.spacing * (1 + 1e-12)
    volume = filled(evolution, phi)
    assert volume <= 0.6
    assert volume == pytest.approx(0.6, rel=1e-5)


@pytest.mark.mpi
def test_start_below_the_bound_is_left_alone(comm: MPI.Intracomm) -> None:
    """Its boundary stays where it is, however often it is re-initialised."""
    evolution = evolution_on(comm, 1.0)
    levelset = evolution.levelset
    start = levelset.with_holes(3, 1, 0.025)  # as wide as the kernel; smaller ones shrink
    phi = evolution.start(start)
    for _ in range(3):
        phi = evolution.reinitialize(phi)
    before, after = (levelset.distance(u) for u in (start, evolution.variables(phi)))
    near = np.abs(before) < levelset.spacing
    assert np.max(np.abs(after - before), where=near, initial=0.0) < 0.1 * levelset.spacing


@pytest.mark.mpi
@pytest.mark.parametrize("value", [1.0, 0.5])
def test_an_even_start_becomes_even_gray(comm: MPI.Intracomm, value: float) -> None:
    """Of one half, too, about which f has round-off of both signs."""
    evolution = evolution_on(comm, 0.5)
    levelset = evolution.levelset
    phi = evolution.start(levelset.even(value))
    assert np.ptp(phi) == 0.0
    assert filled(evolution, phi) == pytest.approx(0.5, rel=1e-5)
    design = levelset.density(evolution.variables(phi))[levelset.domain.design_cells]
    # the ends are solid
    assert design == pytest.approx((0.5 - 0.1) / 0.9, rel=1e-4)


@pytest.mark.mpi
@pytest.mark.parametrize("size", [1.0, 0.3])
def test_a_step_keeps_the_cfl_and_the_volume_bound(comm: MPI.Intracomm, size: float) -> None:
    """All material is dear: without the bound it would only grow; where it pays, it goes."""
    evolution = evolution_on(comm, 0.7)
    levelset, phi = evolution.levelset, started(evolution)
    moved, multiplier = evolution.step(phi, -levelset.domain.cell_volumes, size)
    assert multiplier > 0.0
    assert np.max(np.abs(moved - phi)) <= size * levelset.spacing * (1 + 1e-12)
    volume = filled(evolution, moved)
    assert volume <= 0.7
    assert volume == pytest.approx(0.7, rel=1e-5)
    moved, multiplier = evolution.step(phi, levelset.domain.cell_volumes, 1.0)
    assert multiplier == 0.0
    assert filled(evolution, moved) < filled(evolution, phi) - 0.05


@pytest.mark.mpi
@pytest.mark.parametrize("sharpness", [8.0, 32.0])
def test_a_short_step_descends(comm: MPI.Intracomm, sharpness: float) -> None:
    """By about what the gradient promises."""
    evolution = evolution_on(comm, 1.0).with_sharpness(sharpness)
    levelset, domain, phi = evolution.levelset, evolution.levelset.domain, started(evolution)
    gradient = loads(domain)
    moved, multiplier = evolution.step(phi, gradient, 0.01)
    assert multiplier == 0.0
    before, after = evolution.variables(phi), evolution.variables(moved)
    promised = float(levelset.pullback(before, gradient) @ (after - before))
    change = domain.sum(gradient * (levelset.density(after) - levelset.density(before)))
    assert promised < 0.0
    assert change == pytest.approx(promised, rel=0.1)


@pytest.mark.mpi
def test_a_step_follows_the_design_that_is_analysed(comm: MPI.Intracomm) -> None:
    """Against its derivatives, where they are not cut off; volumes are of the one that is made."""
    plain = evolution_on(comm, 1.0).with_sharpness(32.0)
    plain.extension = lambda values: values
    eroded = plain.with_sharpness(32.0, eroded=True)
    gradient, phi = loads(plain.levelset.domain), started(plain)
    slope = plain.levelset.eroded.pullback(plain.variables(phi), gradient)
    move = phi - eroded.step(phi, gradient, 0.01)[0]
    free = np.abs(move) < 0.99 * np.abs(move).max()
    free &= np.abs(slope) > 1e-3 * np.abs(slope).max()
    assert np.count_nonzero(free) > 20
    np.testing.assert_allclose(move[free] / slope[free], move[free][0] / slope[free][0], rtol=1e-6)
    assert filled(eroded, phi) == filled(plain, phi)


@pytest.mark.mpi
def test_steps_are_bit_identical_on_all_ranks(comm: MPI.Intracomm) -> None:
    evolution = evolution_on(comm, 0.6)
    phi = started(evolution)
    for _ in range(3):
        phi, multiplier = evolution.step(phi, loads(evolution.levelset.domain), 1.0)
        phi = evolution.reinitialize(phi)
    assert len(set(comm.allgather((phi.tobytes(), multiplier)))) == 1


def test_without_a_derivative_nothing_moves() -> None:
    """In a solid body the slope of so steep a projection is zero to the last digit."""
    evolution = evolution_on(MPI.COMM_SELF, 1.0).with_sharpness(1500.0)
    phi = np.full(len(evolution.levelset.knots), 1.0)
    moved, multiplier = evolution.step(phi, loads(evolution.levelset.domain), 1.0)
    assert np.array_equal(moved, phi)
    assert multiplier == 0.0
