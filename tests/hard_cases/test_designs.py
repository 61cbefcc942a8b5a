# SPDX-License-Identifier: MIT
"""Designs that strain the reduction: void, islands, checkerboards, necks, modes that swap."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.body_compliance import body_compliance
from shared.derivatives import check_gradient, difference
from shared.meshes import prongs
from shared.problems import slider_crank
from shared.rods import STEEL
from slider_crank import reference_problem

import dolfinx_ffr as ffr


def check(
    comm: MPI.Intracomm, design: Callable[[np.ndarray, np.ndarray], Any], **of_the_rod: Any
) -> tuple[ffr.Problem, np.ndarray, float]:
    """The slider-crank on a coarse mesh, with a design by the columns and rows of its elements.

    Its gradient must have Taylor order 2 inwards. The problem, the density and psi.
    """
    problem = slider_crank(comm, modes=5, steps=300, **of_the_rod)
    domain = problem.flexible["rod"].domain
    c = domain.centroids
    i, j = np.floor((c - domain.bounding_box[0]) / [0.01, 0.005]).astype(int).T
    x = np.where(design(i, j) | ~domain.design_cells, 1.0, 0.0)
    direction = np.abs(np.cos(300 * c[:, 0] + 900 * c[:, 1] + 1.0))
    direction *= np.where(x > 0.5, -1.0, 1.0) * domain.design_cells
    check_gradient(problem, {"rod": x}, {"rod": direction}, taylor=4e-4, roundoff=1e-11)
    return problem, x, problem.value(x).psi


@pytest.mark.mpi
def test_half_the_body_is_void(comm: MPI.Intracomm) -> None:
    """A strip in a void of next to no stiffness: psi of the strip alone, and an exact gradient."""
    floor = 1e-9
    law = ffr.SIMP(floor=floor)
    problem, strip, psi = check(comm, lambda i, j: np.abs(j - 3.5) < 2, interpolation=law)
    # the void bears a share of the load in proportion to its stiffness, from both sides of a strip
    # of half the height, at up to twice its lever: psi changes by some times that stiffness
    stiffer, domain = 1e3 * floor, problem.flexible["rod"].domain
    law = ffr.SIMP(floor=stiffer)
    other = slider_crank(comm, modes=5, steps=300, interpolation=law, domain=domain)
    assert other.value(strip).psi < psi
    assert psi == pytest.approx(other.value(strip).psi, rel=10.0 * stiffer)


def test_many_modes_beside_void(comm: MPI.Intracomm) -> None:
    """Void has next to no mass; what a hundred modes move there is no more than its motion is."""
    problem = reference_problem(comm, (50, 5), modes=100, steps=300)
    body = problem.flexible["rod"]
    domain = body.domain
    inside = np.abs(domain.centroids[:, 1]) < 0.01
    strip = np.where(inside | ~domain.design_cells, 1.0, 0.0)
    basis = body.reduce(strip).basis
    normal = basis.shapes[:, basis.n_constraint :]
    assert body.elasticity.largest(np.abs(normal)) < 100.0
    gram = body.elasticity.inner(normal, basis.mass_times_normal)
    assert np.abs(gram - np.eye(100)).max() < 1e-10
    fewer_modes = problem.with_modes({"rod": 20}).value(strip).psi
    assert problem.value(strip).psi == pytest.approx(fewer_modes, rel=1e-3)


def test_checkerboard(comm: MPI.Intracomm) -> None:
    """Bilinear elements take it for stiffer than it is; value and gradient are sound."""
    check(comm, lambda i, j: (i + j) % 2 == 0, interpolation=ffr.SIMP(floor=1e-9))


def test_necks_of_one_element(comm: MPI.Intracomm) -> None:
    """Blocks hang together by single elements."""
    problem, necks, psi = check(comm, lambda i, j: (i % 8 != 4) | (j == 3))
    assert psi > problem.value(np.ones(len(necks))).psi


@pytest.mark.mpi
def test_islands(comm: MPI.Intracomm) -> None:
    """A design that has fallen apart: refused by name and time, or reported as far too soft."""
    problem = slider_crank(comm, modes=5, steps=300)
    domain = problem.flexible["rod"].domain
    gap = np.abs(domain.centroids[:, 0] - 0.205) < 0.016
    islands = np.where(gap & domain.design_cells, 0.0, 1.0)
    full = problem.value(np.ones(domain.n_cells)).psi
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            psi = problem.value(islands).psi
        except ffr.SimulationError as error:
            assert "body 'rod'" in str(error) and "t = " in str(error)
            assert np.all(np.isfinite(error.trajectory.y))
            return
    softened = any(issubclass(w.category, ffr.SofteningWarning) for w in caught)
    assert np.isfinite(psi) and (softened or psi > 100.0 * full)


def fork(comm: MPI.Intracomm, modes: int) -> tuple[ffr.FlexibleBody, np.ndarray]:
    """Two prongs, and 1 on the upper one, -1 on the lower."""
    domain = prongs(comm)
    body = ffr.FlexibleBody(domain, STEEL, frame=ffr.TangentFrame("root"), modes=modes)
    return body, np.where(domain.centroids[:, 1] > 0.5, 1.0, -1.0)


def slope(body: ffr.FlexibleBody, x: np.ndarray, direction: np.ndarray) -> float:
    return body.domain.sum(body_compliance(body, x)[1] * direction)


@pytest.mark.mpi
@pytest.mark.parametrize("difference", [0.0, 1e-10, 1e-5])
def test_cluster_at_the_edge_of_the_basis(comm: MPI.Intracomm, difference: float) -> None:
    """Cutting through a pair of equal frequencies is reported, with a number that does not.

    The gradient is that of the value where the solver tells them apart, and refused where not.
    """
    body, upper = fork(comm, 3)
    x = np.where(upper > 0.0, 0.8 * (1.0 + difference), 0.8)
    cut = pytest.warns(UserWarning, match=r"cuts through a cluster.*take modes = 2 or 4")
    if difference < 1e-6:
        with cut:
            reduced = body.reduce(x)
        with pytest.raises(RuntimeError, match=r"there is no gradient; take modes = 2 or 4"):
            body.pullback(reduced, reduced.integrals)
        with pytest.raises(RuntimeError, match="there is no gradient"):
            next(ffr.paper.mode_derivatives(body, reduced, [0]))
        return
    direction = upper * np.cos(3 * body.domain.centroids[:, 0])
    step = 0.1 * difference
    with cut:
        derivative = slope(body, x, direction)
    with cut:
        ends = [body_compliance(body, x + s * step * direction)[0] for s in (-1.0, 1.0)]
    assert derivative == pytest.approx((ends[1] - ends[0]) / (2.0 * step), rel=1e-3)


@pytest.mark.parametrize("gap", [pytest.param(0.0, marks=pytest.mark.mpi), 1e-9, 1e-3])
def test_nearly_equal_frequencies(comm: MPI.Intracomm, gap: float) -> None:
    """The gradient is exact however close two frequencies are."""
    body, upper = fork(comm, 2)
    x = np.where(upper > 0.0, 0.8 * (1.0 + gap), 0.8)
    direction = np.where(upper > 0.0, 0.2, -0.1) * np.cos(3 * body.domain.centroids[:, 0])
    assert body.reduce(x).basis.spectral_gap > 1.0  # nothing is cut, and no warning comes
    expected = difference(lambda way: body_compliance(body, x + way * direction)[0], 2e-3)
    assert slope(body, x, direction) == pytest.approx(expected, rel=1e-7)


@pytest.mark.mpi
def test_interfaces_that_may_lose_their_material_are_named(comm: MPI.Intracomm) -> None:
    domain = ffr.Domain.rectangle(
        comm, 0.4, 0.04, elements=(20, 4), solid_columns=0, solid=lambda x: x[0] < 0.03
    )
    assert domain.designed_interfaces == ["right"]
    problem = slider_crank(comm, domain=domain, modes=2)
    design = ffr.DensityDesign(domain)
    with pytest.warns(ffr.DesignWarning) as caught:
        ffr.optimize(problem, design, design.even(1.0), volume=1.0, iterations=0, progress=False)
    assert "no cell of 'rod' along 'right' stays solid" in str(caught[0].message)
    assert "solid=" in str(caught[0].message) and len(caught) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("integrator", "modes"),
    [
        # what the ranks share ends with the volume integrals
        pytest.param(ffr.GeneralizedAlpha(0.1, 400), 2, marks=pytest.mark.mpi),
        (ffr.RadauIIA(0.1, steps=100), 4),
        (ffr.RadauIIA(0.1, tolerance=1e-7), 4),
    ],
    ids=["generalised alpha", "Radau IIA", "Radau IIA, adaptive"],
)
def test_psi_and_gradient_pass_on_continuously(
    comm: MPI.Intracomm, integrator: ffr.GeneralizedAlpha | ffr.RadauIIA, modes: int
) -> None:
    """A fork on a hub that swings: one prong becomes the softer one."""
    body, upper = fork(comm, modes)
    rest_motion = ffr.Motion.constant(0.0)
    swing = ffr.Motion(
        lambda t: 0.3 * np.sin(40.0 * t),
        lambda t: 12.0 * np.cos(40.0 * t),
        lambda t: -480.0 * np.sin(40.0 * t),
    )
    weld = ffr.Weld(("fork", "root"), ffr.Moving(rest_motion, rest_motion, swing, "hub"), angle=0.0)
    mechanism = ffr.Mechanism({"fork": ffr.Placement((0.0, 0.0))}, [weld])
    problem = ffr.Problem({"fork": body}, mechanism, integrator, ffr.IntegralCompliance())
    step = 2e-5
    # adaptive steps may differ from one design to the next
    jump = 1e-7 if integrator.steps is None else 1e-10
    line = [problem.gradient(0.8 + step * k * upper) for k in (-2, -1, 0, 1, 2)]
    slopes = [comm.allreduce(float(e.gradient["fork"] @ upper)) for e in line]
    frequencies = [e.fixed_interface_frequencies["fork"][:2] for e in line]
    assert (
        frequencies[2][1] - frequencies[2][0] < 1e-6 * frequencies[2][0]
    )  # they meet in the middle
    assert all(pair[1] - pair[0] > 1e-6 * pair[0] for k, pair in enumerate(frequencies) if k != 2)
    # the trapezoidal rule for the gradient gives the difference, to third order
    rule = 0.5 * step * np.add(slopes[1:], slopes[:-1])
    for k, change in enumerate(np.diff([evaluation.psi for evaluation in line])):
        size = step * max(abs(slope) for slope in slopes)
        assert change == pytest.approx(rule[k], abs=1e-4 * size + jump * line[2].psi)
    bends = np.diff(slopes)
    assert np.max(np.abs(bends - np.mean(bends))) < 2e-2 * np.max(np.abs(bends))
