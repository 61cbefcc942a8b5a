# SPDX-License-Identifier: MIT
"""A body keeps matrices and factor of one density; what belongs to others is made again."""

from __future__ import annotations

import gc
from collections.abc import Callable

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from shared.body_compliance import compliance
from shared.rods import rod, waves

import dolfinx_ffr as ffr
from dolfinx_ffr.paper import integral_derivatives, mode_derivatives
from dolfinx_ffr.postprocessing import StressModes
from dolfinx_ffr.reduction import with_residual_modes


def body_of(comm: MPI.Intracomm, **options: object) -> ffr.FlexibleBody:
    """A small steel rod between two pins."""
    return rod(comm, (16, 3), **options)


def assert_same(comm: MPI.Intracomm, found: np.ndarray, expected: np.ndarray) -> None:
    """One rank does the same work twice; several may add up in another order."""
    scale = comm.allreduce(float(np.max(np.abs(expected), initial=0.0)), MPI.MAX)
    atol = 1e-9 * scale if comm.size > 1 else 0.0
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=atol)


def compliance_gradient(body: ffr.FlexibleBody, reduced: ffr.reduction.ReducedBody) -> np.ndarray:
    return body.pullback(reduced, compliance(reduced)[1])[0]


USES: dict[str, Callable[[ffr.FlexibleBody, ffr.reduction.ReducedBody], np.ndarray]] = {
    "pullback": compliance_gradient,
    "residual modes": lambda body, reduced: with_residual_modes(body, reduced).integrals.K,
    "stress": lambda body, reduced: StressModes.of(body, reduced).values,
}


@pytest.mark.mpi
@pytest.mark.parametrize("stiffening", [(), ("omega2", "markers")], ids=["linear", "stiffened"])
@pytest.mark.parametrize("use", USES)
def test_reductions_serve_at_any_time(
    comm: MPI.Intracomm, use: str, stiffening: tuple[str, ...]
) -> None:
    """Whatever the body has been reduced at since, and back again."""
    body = body_of(comm, stiffening=stiffening)
    first = body.reduce(waves(body.domain))
    of_first = USES[use](body, first)
    second = body.reduce(waves(body.domain, 1.0))
    of_second = USES[use](body, second)
    assert not np.allclose(of_first, of_second, rtol=1e-3, atol=0.0)
    for reduced, expected in ((first, of_first), (second, of_second), (first, of_first)):
        assert_same(comm, USES[use](body, reduced), expected)


@pytest.mark.mpi
@pytest.mark.parametrize("solver", ["bordered", "deflated"])
def test_element_by_element_at_any_time(comm: MPI.Intracomm, solver: ffr.paper.Solver) -> None:
    """Also while the body is reduced at another density between two shape functions."""
    body = body_of(comm)
    reduced, cells = body.reduce(waves(body.domain)), np.arange(min(2, body.domain.n_cells))
    expected = integral_derivatives(body, reduced, cells, solver=solver)
    fields = [part.fields for part in mode_derivatives(body, reduced, cells, solver=solver)]
    body.reduce(waves(body.domain, 1.0))
    derivatives = integral_derivatives(body, reduced, cells, solver=solver)
    for key in ("S", "G", "N", "K"):
        assert_same(comm, getattr(derivatives, key), getattr(expected, key))
    for number, part in enumerate(mode_derivatives(body, reduced, cells, solver=solver)):
        assert_same(comm, part.fields, fields[number])
        body.reduce(waves(body.domain, 1.0 + number))


@pytest.mark.mpi
def test_matrices_of_one_density_are_kept(comm: MPI.Intracomm) -> None:
    """Reductions that are kept hold no matrices; those of the last one are not made twice."""
    body = body_of(comm)
    bodies_kept = [body.reduce(waves(body.domain, phase)) for phase in range(4)]
    last_factored = body.factored(bodies_kept[-1])
    assert body.factored(bodies_kept[-1]) is last_factored
    assert last_factored.clamped.stiffness and last_factored.matrices.stiffness
    assert body.factored(bodies_kept[0]) is not last_factored
    with pytest.raises(RuntimeError, match="matrices of this density are freed"):
        last_factored.solve(np.zeros((body.elasticity.n_dofs, 1)))
    assert not last_factored.matrices.stiffness and not last_factored.matrices.mass


def test_nothing_is_left_to_petsc(capfd: pytest.CaptureFixture[str]) -> None:
    """What Python drops last, PETSc keeps until the program ends: a factor for each reduction."""
    body = body_of(MPI.COMM_SELF)
    cells = np.arange(2)
    for phase in range(2):
        reduced = body.reduce(waves(body.domain, phase))
        compliance_gradient(body, reduced)
        for _ in mode_derivatives(body, reduced, cells):
            pass
        body.count_below(reduced, 1e9)
    capfd.readouterr()
    PETSc.garbage_view(body.elasticity.comm)
    assert "Total entries: 0" in capfd.readouterr().out


def test_a_body_takes_along_what_it_keeps(capfd: pytest.CaptureFixture[str]) -> None:
    """Its factor, the analysis for counts and the pattern go with it, if nobody holds them."""
    body = body_of(MPI.COMM_SELF)
    clamped_mass = body.factored(body.reduce(waves(body.domain))).clamped.mass
    body = None
    gc.collect()
    PETSc.garbage_view(MPI.COMM_SELF)
    assert "Total entries: 0" in capfd.readouterr().out
    assert clamped_mass.norm() > 0.0


@pytest.mark.mpi
def test_two_bodies_count_in_turn(comm: MPI.Intracomm) -> None:
    """What is kept for counts belongs to one body and to no density."""
    one, two = body_of(comm), body_of(comm).with_modes(6)
    values = {}
    for body, phase in ((one, 0), (two, 0), (one, 1), (two, 1), (one, 0)):
        reduced = body.reduce(waves(body.domain, phase))
        limit = reduced.basis.eigenvalues[-1] * (1.0 + 1e-6)
        assert body.count_below(reduced, limit) == body.modes
        values.setdefault((body.modes, phase), reduced.basis.eigenvalues)
        assert_same(comm, reduced.basis.eigenvalues, values[body.modes, phase])


@pytest.mark.mpi
def test_density_of_a_reduction_stays_as_it_is(comm: MPI.Intracomm) -> None:
    """It is a copy of what was given, and cannot be written to.

    A density that is refused leaves nothing behind that an older reduction would use.
    """
    body = body_of(comm)
    x = waves(body.domain)
    reduced = body.reduce(x)
    expected = compliance_gradient(body, reduced)
    x[:] = 0.0
    np.testing.assert_array_equal(reduced.density, waves(body.domain))
    with pytest.raises(ValueError, match="read-only"):
        reduced.density[:] = 0.5
    with pytest.raises(ValueError, match=r"leave \[0, 1\]"):
        body.reduce(2.0 * waves(body.domain))
    assert_same(comm, compliance_gradient(body, reduced), expected)
    assert body.modes == 3 and reduced.basis.shapes.shape[1] == body.n_elastic == 6
