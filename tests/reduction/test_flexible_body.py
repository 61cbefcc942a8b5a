# SPDX-License-Identifier: MIT
"""A body keeps matrices and factor of one density; what belongs to others is made again."""

from __future__ import annotations

import gc
from collections.abc import Callable

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest

import dolfinx_ffr as ffr
from dolfinx_ffr.gradients import integral_derivatives, mode_derivatives
from dolfinx_ffr.postprocessing import StressModes, modes_below
from dolfinx_ffr.reduction import with_residual_modes

STEEL = ffr.PlaneStress(210e9, 0.3, 7850.0, 0.01)


def rod(comm: MPI.Intracomm, **options: object) -> ffr.FlexibleBody:
    """A small steel rod between two pins."""
    domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(16, 3))
    frame = ffr.ChordFrame("left", "right")
    return ffr.FlexibleBody(domain, STEEL, frame=frame, modes=3, **options)  # type: ignore[arg-type]


def waves(domain: ffr.Domain, phase: float = 0.0) -> np.ndarray:
    """A density that does not depend on the partition."""
    x, y = domain.centroids.T
    return 0.6 + 0.3 * np.sin(31.0 * x + 70.0 * y + phase)


def assert_same(comm: MPI.Intracomm, found: np.ndarray, expected: np.ndarray) -> None:
    """One rank does the same work twice; several may add up in another order."""
    scale = comm.allreduce(float(np.max(np.abs(expected), initial=0.0)), MPI.MAX)
    atol = 1e-9 * scale if comm.size > 1 else 0.0
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=atol)


def compliance_gradient(body: ffr.FlexibleBody, reduced: ffr.ReducedBody) -> np.ndarray:
    """Of the compliance under an acceleration, which depends on the span of the modes alone."""
    integrals, load = reduced.integrals, np.array([0.3, 1.0])
    q = np.linalg.solve(integrals.K, integrals.S[1:] @ load)
    bar = integrals.zeros_like()
    bar.S[1:] = 2.0 * np.outer(q, load)
    bar.K[:] = -np.outer(q, q)
    return body.pullback(reduced, bar)[0]


USES: dict[str, Callable[[ffr.FlexibleBody, ffr.ReducedBody], np.ndarray]] = {
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
    body = rod(comm, stiffening=stiffening)
    first = body.reduce(waves(body.domain))
    of_first = USES[use](body, first)
    second = body.reduce(waves(body.domain, 1.0))
    of_second = USES[use](body, second)
    assert not np.allclose(of_first, of_second, rtol=1e-3, atol=0.0)
    for reduced, expected in ((first, of_first), (second, of_second), (first, of_first)):
        assert_same(comm, USES[use](body, reduced), expected)


@pytest.mark.mpi
@pytest.mark.parametrize("solver", ["bordered", "deflated"])
def test_element_by_element_at_any_time(comm: MPI.Intracomm, solver: ffr.Solver) -> None:
    """Also while the body is reduced at another density between two batches."""
    body = rod(comm)
    cells = np.arange(min(2, body.domain.n_cells))
    first = body.reduce(waves(body.domain))
    expected = integral_derivatives(body, first, cells, solver=solver)
    fields = [part.fields for part in mode_derivatives(body, first, cells, solver=solver, batch=1)]
    body.reduce(waves(body.domain, 1.0))
    found = integral_derivatives(body, first, cells, solver=solver)
    for key in ("S", "G", "N", "K"):
        assert_same(comm, getattr(found, key), getattr(expected, key))
    parts = mode_derivatives(body, first, cells, solver=solver, batch=1)
    for number, part in enumerate(parts):
        assert_same(comm, part.fields, fields[number])
        body.reduce(waves(body.domain, 1.0 + number))


@pytest.mark.mpi
def test_matrices_of_one_density_are_kept(comm: MPI.Intracomm) -> None:
    """Reductions that are kept hold no matrices; those of the last one are not made twice."""
    body = rod(comm)
    kept = [body.reduce(waves(body.domain, phase)) for phase in range(4)]
    last = body.factored(kept[-1])
    assert body.factored(kept[-1]) is last
    assert last.held_stiffness and last.matrices.stiffness
    assert body.factored(kept[0]) is not last
    with pytest.raises(RuntimeError, match="matrices of this density are freed"):
        last.solve(np.zeros((body.elasticity.n_dofs, 1)))
    assert not last.matrices.stiffness and not last.matrices.mass


def test_nothing_is_left_to_petsc(capfd: pytest.CaptureFixture[str]) -> None:
    """What Python drops last, PETSc keeps until the program ends: a factor for each reduction."""
    body = rod(MPI.COMM_SELF)
    cells = np.arange(2)
    for phase in range(2):
        reduced = body.reduce(waves(body.domain, phase))
        compliance_gradient(body, reduced)
        for _ in mode_derivatives(body, reduced, cells):
            pass
        modes_below(body, 1e4)
    capfd.readouterr()
    PETSc.garbage_view(body.elasticity.comm)
    assert "Total entries: 0" in capfd.readouterr().out


def test_a_body_takes_along_what_it_keeps(capfd: pytest.CaptureFixture[str]) -> None:
    """Its factor, the analysis for counts and the pattern go with it, if nobody holds them."""
    body = rod(MPI.COMM_SELF)
    held = body.factored(body.reduce(waves(body.domain))).held_mass
    body = None
    gc.collect()
    PETSc.garbage_view(MPI.COMM_SELF)
    assert "Total entries: 0" in capfd.readouterr().out
    assert held.norm() > 0.0


@pytest.mark.mpi
def test_two_bodies_count_in_turn(comm: MPI.Intracomm) -> None:
    """What is kept for counts belongs to one body and to no density."""
    one, two = rod(comm), rod(comm).with_modes(6)
    found = {}
    for body, phase in ((one, 0), (two, 0), (one, 1), (two, 1), (one, 0)):
        reduced = body.reduce(waves(body.domain, phase))
        limit = reduced.basis.eigenvalues[-1] * (1.0 + 1e-6)
        assert body.count_below(reduced, limit) == body.modes
        found.setdefault((body.modes, phase), reduced.basis.eigenvalues)
        assert_same(comm, reduced.basis.eigenvalues, found[body.modes, phase])


@pytest.mark.mpi
def test_density_of_a_reduction_stays_as_it_is(comm: MPI.Intracomm) -> None:
    """It is a copy of what was given, and cannot be written to."""
    body = rod(comm)
    x = waves(body.domain)
    reduced = body.reduce(x)
    x[:] = 0.0
    np.testing.assert_array_equal(reduced.density, waves(body.domain))
    with pytest.raises(ValueError, match="read-only"):
        reduced.density[:] = 0.5


@pytest.mark.mpi
def test_body_serves_on_after_a_failure(comm: MPI.Intracomm) -> None:
    """A density that is refused leaves nothing behind that an older reduction would use."""
    body = rod(comm)
    reduced = body.reduce(waves(body.domain))
    expected = compliance_gradient(body, reduced)
    with pytest.raises(ValueError, match=r"leave \[0, 1\]"):
        body.reduce(2.0 * waves(body.domain))
    assert_same(comm, compliance_gradient(body, reduced), expected)


def test_old_name_of_markers() -> None:
    """It works for one more release, with a warning."""
    with pytest.warns(DeprecationWarning, match="points is now called markers"):
        body = rod(MPI.COMM_SELF, points={"middle": (0.2, 0.0)})
    assert list(body.markers) == ["middle"]
    with pytest.warns(DeprecationWarning, match="points is now called markers"):
        assert body.points is body.markers


def test_numbers_of_modes() -> None:
    """What was asked for, and with the constraint modes."""
    body = rod(MPI.COMM_SELF)
    assert (body.modes, body.n_elastic) == (3, 6)
    assert body.reduce(waves(body.domain)).basis.shapes.shape[1] == body.n_elastic
    assert body.with_modes(2).modes == 2
