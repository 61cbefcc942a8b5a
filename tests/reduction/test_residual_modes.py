# SPDX-License-Identifier: MIT
"""Residual modes: exact static displacements, and the estimated error of psi beside the true one.

The true error is that against all modes that the mesh has.
"""

from __future__ import annotations

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from four_bar import LINKS, four_bar
from shared.rods import rod
from slider_crank import LENGTH, reference_problem

import dolfinx_ffr as ffr
from dolfinx_ffr.postprocessing.model_report import model_report
from dolfinx_ffr.reduction.residual_modes import with_residual_modes

#: The estimate lies within this factor of the true error
FACTOR = 1.25


def psi_with_all_modes(problem: ffr.Problem, x: np.ndarray) -> float:
    """Psi with a complete basis, from SciPy's dense eigenvalue solver."""
    (name, body), *_ = problem.flexible.items()
    reduced = body.reduce(x)
    elasticity, k = body.elasticity, reduced.basis.n_constraint
    factored = body.factored(reduced)
    free = np.flatnonzero(~body.reduction.clamped)
    K, M = (
        elasticity.apply(matrix, np.eye(elasticity.n_dofs))[np.ix_(free, free)]
        for matrix in (factored.matrices.stiffness, factored.matrices.mass)
    )
    eigenvalues, vectors = scipy.linalg.eigh(K, M)
    shapes = np.zeros((elasticity.n_dofs, k + len(free)))
    shapes[:, :k] = reduced.basis.shapes[:, :k]
    shapes[free, k:] = vectors
    basis = replace(reduced.basis, shapes=shapes, eigenvalues=eigenvalues)
    integrals = body.integrals(factored, basis)
    motion = ffr.MechanicalProblem(problem.mechanism, problem.integrator, problem.objective)
    return float(motion.value({name: integrals}).psi)


def check_estimates(
    problem: ffr.Problem, x: dict[str, np.ndarray], modes: tuple[int, ...], exact: float
) -> None:
    """Demand that the error of psi with some modes each is estimated."""
    for number in modes:
        fewer = problem.with_modes(dict.fromkeys(x, number))
        evaluation = fewer.value(x)
        true = abs(evaluation.psi / exact - 1.0)
        estimate = model_report(fewer, evaluation).modes_error
        assert true / FACTOR < estimate < FACTOR * true, number


def designs(domain: ffr.Domain) -> dict[str, np.ndarray]:
    """Densities that do not depend on the partition."""
    x, y = domain.centroids.T
    waves = 0.55 + 0.45 * np.sin(40.0 * x + 1.0) * np.cos(90.0 * y + 0.3)
    values = {
        "solid": np.ones(domain.n_cells),
        "waves": waves,
        "strip": np.where(y > -0.001, 1.0, 0.05),  # no centre lies on the edge, on any mesh
        "one-sided": np.where(x > 0.6 * LENGTH, 0.2, 1.0),
    }
    return {name: np.where(domain.design_cells, part, 1.0) for name, part in values.items()}


@pytest.mark.mpi
@pytest.mark.parametrize("modes", [0, 3])
def test_static_displacements_are_exact(comm: MPI.Intracomm, modes: int) -> None:
    """The loads' static displacements lie in the span of normal and residual modes."""
    body = rod(comm, modes=modes, markers={"middle": (0.2, 0.0)})
    reduced = body.reduce(designs(body.domain)["waves"])
    with_residuals = with_residual_modes(body, reduced)
    elasticity, factored = body.elasticity, body.factored(reduced)
    matrices, normal = factored.matrices, with_residuals.basis.normal
    added = normal.shape[1] - modes
    # four of the frame's motion, three constraint modes, three of the point; and their inertia
    assert 10 < added <= 20
    gram = elasticity.inner(normal, elasticity.apply(matrices.mass, normal))
    assert np.allclose(gram, np.eye(modes + added), atol=1e-9)
    stiffness = elasticity.inner(normal, elasticity.apply(matrices.stiffness, normal))
    scale = np.sqrt(with_residuals.basis.eigenvalues)
    assert np.allclose(stiffness / np.outer(scale, scale), np.eye(modes + added), atol=1e-9)
    assert np.all(np.diff(with_residuals.basis.eigenvalues) > 0.0)
    # displacements under the centrifugal load and under a force at the point
    weight = elasticity.apply(matrices.mass, body.reduction.reference[:, None])
    force = body.markers["middle"].rows.T.toarray()[:, 1:2]
    for load in (weight, force):
        load[body.reduction.clamped] = 0.0
        exact = factored.solve(load)
        value = normal @ (
            elasticity.inner(normal, load) / with_residuals.basis.eigenvalues[:, None]
        )
        size = elasticity.largest(np.abs(exact))
        assert elasticity.largest(np.abs(value - exact)) < 1e-9 * size
    # the first shape functions stay as they are, and so do their integrals
    r = body.n_elastic
    assert np.array_equal(with_residuals.basis.shapes[:, :r], reduced.basis.shapes)
    leading, integrals = with_residuals.integrals.leading(r), reduced.integrals
    assert np.allclose(leading.K, integrals.K, rtol=0.0, atol=1e-12 * np.abs(integrals.K).max())
    assert np.allclose(leading.G, integrals.G, rtol=0.0, atol=1e-12 * np.abs(integrals.G).max())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("elements", "cell", "order", "design"),
    [
        *(((14, 2), "quadrilateral", 1, name) for name in ("solid", "strip", "one-sided")),
        ((10, 1), "triangle", 1, "waves"),
        ((10, 1), "quadrilateral", 2, "one-sided"),
    ],
)
def test_estimate_is_near_the_true_error(
    elements: tuple[int, int], cell: str, order: int, design: str
) -> None:
    """For several designs and numbers of modes, and on other meshes."""
    problem = reference_problem(MPI.COMM_SELF, elements, cell=cell, order=order, steps=200)
    x = designs(problem.flexible["rod"].domain)[design]
    check_estimates(problem, {"rod": x}, (0, 1, 4, 8), psi_with_all_modes(problem, x))


@pytest.mark.slow
def test_estimate_for_two_bodies() -> None:
    """The errors of both links together; twenty modes each count as all."""
    domains = {
        name: ffr.Domain.rectangle(MPI.COMM_SELF, *size, elements=(n, 2))
        for (name, size), n in zip(LINKS.items(), (16, 12), strict=True)
    }
    problem = four_bar(domains, steps=200)
    x = {name: np.ones(body.domain.n_cells) for name, body in problem.flexible.items()}
    check_estimates(problem, x, (0, 2), problem.with_modes(dict.fromkeys(x, 20)).value(x).psi)
