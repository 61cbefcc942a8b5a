# SPDX-License-Identifier: MIT
"""Level sets and mirror planes of bodies in space."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from numpy.testing import assert_allclose

import dolfinx_ffr as ffr
from dolfinx_ffr import Domain, LevelSet, MirrorPlane, mirror_planes

pytestmark = pytest.mark.mpi


def rod(comm: MPI.Intracomm, width: float = 0.3, **options: object) -> Domain:
    """A short rod of cubes, or nearly."""
    return Domain.box(
        comm,
        0.8,
        0.2,
        width,
        elements=(16, 4, 6),
        solid_layers=1,
        **options,  # type: ignore[arg-type]
    )


def test_density_and_penalty_have_their_derivatives(comm: MPI.Intracomm) -> None:
    """Against central differences, from gray to crisp, and the same on any number of ranks."""
    domain = rod(comm)
    found = LevelSet(domain)
    rng = np.random.default_rng(0)
    u = found.from_distance(lambda x: 0.1 - np.linalg.norm(x[:, 1:], axis=1))
    u = np.clip(u + 0.2 * rng.standard_normal(found.size), 0.0, 1.0)
    direction = rng.standard_normal(found.size)
    weights = np.cos(7.0 * domain.centroids @ [1.0, 2.0, 3.0])
    for levelset in (found.at(0.3), found.at(0.6), found):
        slope = levelset.pullback(u, weights) @ direction
        step = 1e-6
        pair = [domain.sum(weights * levelset.density(u + s * direction)) for s in (step, -step)]
        assert slope == pytest.approx((pair[0] - pair[1]) / (2 * step), rel=1e-5)
        value, bar = levelset.penalty(u)
        if value:
            pair = [levelset.penalty(u + s * direction)[0] for s in (step, -step)]
            assert bar @ direction == pytest.approx((pair[0] - pair[1]) / (2 * step), rel=1e-5)
    alone = LevelSet(rod(MPI.COMM_SELF))
    assert_allclose(found.penalty(u)[0], alone.penalty(u)[0], rtol=1e-12)
    everywhere = domain.everywhere(found.density(u))
    assert_allclose(everywhere, alone.domain.everywhere(alone.density(u)), atol=1e-12)


def test_distance_from_a_ball(comm: MPI.Intracomm) -> None:
    """The boundary of a ball is a ball, up to what the kernel smooths."""
    domain = Domain.box(comm, 0.8, 0.4, 0.4, elements=(16, 8, 8), solid_layers=0)
    levelset = LevelSet(domain)
    off = np.linalg.norm(domain.centroids - [0.4, 0.0, 0.0], axis=1) - 0.13
    u = levelset.from_distance(lambda x: np.linalg.norm(x - [0.4, 0.0, 0.0], axis=1) - 0.13)
    found = levelset.distance(u)
    near = np.abs(off) < 0.1
    assert_allclose(found[near], off[near], atol=0.25 * levelset.element)
    full = levelset.distance(levelset.even(1.0))
    assert np.all(np.isposinf(full))


@pytest.mark.parametrize(("width", "planes"), [(0.3, 3), (0.2, 5)])
def test_mirror_planes(comm: MPI.Intracomm, width: float, planes: int) -> None:
    """Those of a rod, of a square one also the diagonals; a design is symmetric exactly."""
    elements = (16, 4, round(width / 0.05))
    domain = Domain.box(comm, 0.8, 0.2, width, elements=elements, solid_layers=1)
    found = mirror_planes(domain)
    assert len(found) == planes
    weight = domain.cell_volumes * (1.0 + domain.centroids[:, 1])
    assert len(mirror_planes(domain, weight)) < planes
    levelset = LevelSet(domain, mirrors=found[:2])
    u = np.random.default_rng(0).uniform(0.0, 1.0, levelset.size)
    at = levelset.level(u)
    points = np.random.default_rng(1).uniform(-0.1, 0.1, (20, 3)) + np.array([0.4, 0.0, 0.0])
    for mirror in found[:2]:
        assert_allclose(at(points), at(mirror.reflection(points)), atol=1e-14)


def test_refusals(comm: MPI.Intracomm) -> None:
    """Planes that the body does not have, lines in space, directions without length."""
    domain = rod(comm)
    with pytest.raises(
        ValueError, match=r"is no mirror plane of the body.*mirror_planes\(domain\)"
    ):
        LevelSet(domain, mirrors=[MirrorPlane((0.1, 0.0, 0.0), (1.0, 0.0, 0.0))])
    with pytest.raises(TypeError, match="mirror planes of the body"):
        LevelSet(domain, mirrors=[ffr.Mirror((0.0, 0.0), (1.0, 0.0))])
    with pytest.raises(ValueError, match="the body has 3 dimensions; take mirror_planes"):
        ffr.mirror_lines(domain)
    with pytest.raises(ValueError, match="must have finite coordinates and a normal"):
        MirrorPlane((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
