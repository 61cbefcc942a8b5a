# SPDX-License-Identifier: MIT
"""Block Krylov spaces: the basis, the operator in it, modes beside SLEPc's, and adjoints' error."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from shared.rods import rod

from dolfinx_ffr import FlexibleBody
from dolfinx_ffr.reduction import ReducedBody
from dolfinx_ffr.reduction.krylov import KrylovSpace


def body_of(comm: MPI.Intracomm, tolerance: float = 1e-8) -> tuple[FlexibleBody, ReducedBody]:
    """A rod held at both ends, with void and gray, the same on any number of ranks."""
    body = rod(comm, (30, 4), modes=6, tolerance=tolerance)
    x, y = body.domain.centroids.T
    return body, body.reduce(np.clip(0.6 + 0.7 * np.sin(40.0 * x + 90.0 * y), 0.0, 1.0))


def waves(body: FlexibleBody, columns: int) -> np.ndarray:
    """Fields that vanish where the body is held, shape (dofs, columns)."""
    place = np.repeat(body.elasticity.coordinates() @ [21.0, 37.0], 2)
    fields = np.sin(np.outer(place, 1.0 + np.arange(columns)) + np.arange(len(place))[:, None] % 2)
    fields[body.reduction.clamped] = 0.0
    return fields


def test_invariant_space(comm: MPI.Intracomm) -> None:
    """A space of modes does not grow, and one of nothing is empty."""
    body, reduced = body_of(comm)
    factored, basis = body.factored(reduced), reduced.basis
    space = KrylovSpace(factored, basis.normal)
    space.grow()
    inverses = np.linalg.eigvalsh(space.projected[:6, :6])[::-1]
    np.testing.assert_allclose(1.0 / inverses, basis.eigenvalues, rtol=1e-9)
    empty = KrylovSpace(factored, np.zeros((body.elasticity.n_dofs, 2)))
    assert empty.invariant and empty.size == 0


@pytest.mark.mpi
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_error_of_adjoints_is_below_its_bound(comm: MPI.Intracomm, tolerance: float) -> None:
    """In the norm of K, weighted by frequencies, relative to the largest of all solutions."""
    body, reduced = body_of(comm, tolerance=1e-13)
    factored, basis = body.factored(reduced), reduced.basis
    right = waves(body, 6)
    exact, _ = body.reduction.solve_shifted(factored, basis, right, basis.eigenvalues)
    body.reduction.tolerance = tolerance
    loose, iterations = body.reduction.solve_shifted(factored, basis, right, basis.eigenvalues)

    def norms(fields: np.ndarray) -> np.ndarray:
        image = body.elasticity.apply(factored.clamped.stiffness, fields)
        return np.sqrt(basis.eigenvalues * np.diag(body.elasticity.inner(fields, image)))

    assert iterations > 1
    assert np.max(norms(loose - exact)) <= tolerance * np.max(norms(exact))
    residual = body.elasticity.apply(factored.clamped.stiffness, exact)
    residual -= basis.eigenvalues * body.elasticity.apply(factored.clamped.mass, exact)
    residual -= right - basis.mass_times_normal @ body.elasticity.inner(basis.normal, right)
    residual[body.reduction.clamped] = 0.0
    assert body.elasticity.largest(np.abs(residual)) < 1e-9 * body.elasticity.largest(np.abs(right))
