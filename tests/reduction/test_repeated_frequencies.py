# SPDX-License-Identifier: MIT
"""Bodies with symmetries: all copies of repeated frequencies are found, cut clusters are named."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse
from shared.body_compliance import body_compliance
from shared.derivatives import difference
from shared.meshes import annulus, bar, plate, star
from shared.rods import STEEL

from dolfinx_ffr import SIMP, Domain, FlexibleBody, Isotropic, TangentFrame
from dolfinx_ffr.fem import Elasticity
from dolfinx_ffr.reduction import CLUSTER, CraigBampton, FactoredBody, normal_modes

TOLERANCES = (1e-6, 1e-8, 1e-10, 1e-12)
BODIES: dict[str, Callable[[MPI.Intracomm], Domain]] = {
    "coarse square": lambda comm: plate(comm, 11),
    "square with a large hole": lambda comm: plate(comm, 12, hole=6),
    "annulus": lambda comm: annulus(comm, 14, 3),
    "round bar": lambda comm: bar(comm, 4, circular=True),
    **{f"star of {n}": (lambda comm, n=n: star(comm, n)) for n in (5, 8)},
}


def reduction(domain: Domain, modes: int, tolerance: float = 1e-11) -> CraigBampton:
    frame = TangentFrame(next(iter(domain.interfaces)))
    solid = Isotropic(STEEL.young, STEEL.poisson, STEEL.density)
    elasticity = Elasticity(domain, STEEL if domain.dimension == 2 else solid, SIMP())
    return CraigBampton(elasticity, frame, modes, tolerance=tolerance)


def factor(body: CraigBampton) -> FactoredBody:
    """The body at an even density, which keeps its symmetries."""
    cells = body.elasticity.domain.n_cells
    return body.factor(body.elasticity.assemble(np.full(cells, 0.7)))


def all_eigenvalues(body: CraigBampton, factored: FactoredBody) -> np.ndarray:
    """By LAPACK, on one rank."""

    def dense(matrix: PETSc.Mat) -> np.ndarray:
        rows = scipy.sparse.csr_matrix(matrix.getValuesCSR()[::-1]).toarray()
        return rows[np.ix_(~body.clamped, ~body.clamped)]

    stiffness, mass = dense(factored.clamped.stiffness), dense(factored.clamped.mass)
    return scipy.linalg.eigh(stiffness, mass, eigvals_only=True)


def round_off(exact: np.ndarray) -> float:
    """That of the largest one by LAPACK, twice; by inverses it is eps lambda^2 / lambda_1."""
    return float(2.0 * len(exact) * np.finfo(float).eps * exact[-1])


@pytest.mark.slow
@pytest.mark.parametrize("name", BODIES)
def test_no_copy_is_missed(name: str) -> None:
    """Up to 40 modes at all tolerances, against LAPACK; what is said about clusters is right."""
    domain = BODIES[name](MPI.COMM_SELF)
    reduced = reduction(domain, 1)
    factored = factor(reduced)
    exact = all_eigenvalues(reduced, factored)
    ends = np.append(0, np.flatnonzero(np.diff(exact) >= CLUSTER * exact[1:]) + 1)
    for modes in (*range(1, 21), *range(21, 41, 3)):
        tolerance = TOLERANCES[modes % 4]
        body = CraigBampton(reduced.elasticity, reduced.frame, modes, tolerance=tolerance)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            basis = body.basis(factored)
        # a Ritz value is as near to an eigenvalue as its residual is small
        error = np.abs(basis.eigenvalues - exact[:modes])
        assert np.all(error < tolerance * exact[:modes] + round_off(exact)), modes
        if modes in ends:
            assert not caught, (modes, caught[0].message)
            assert basis.first_truncated_eigenvalue == pytest.approx(exact[modes], rel=1e-2)
        else:
            right = [ends[ends < modes][-1], ends[ends > modes][0]]
            message = re.search(r"take modes = ([\d or]+)", str(caught[0].message))
            assert message and list(map(int, message[1].split(" or "))) == [
                k for k in right if k
            ], modes


def test_count_below() -> None:
    """Anywhere in the spectrum, of a body with soft elements too."""
    body = reduction(BODIES["coarse square"](MPI.COMM_SELF), 1)
    density = np.random.default_rng(1).choice([0.1, 0.5, 1.0], body.elasticity.domain.n_cells)
    factored = body.factor(body.elasticity.assemble(density))
    exact = all_eigenvalues(body, factored)
    for number in [0, 1, 2, 7, 20, *range(30, len(exact), 40), len(exact)]:
        below, above = np.concatenate([[0.0], exact, [2 * exact[-1]]])[number : number + 2]
        assert above - below > 2 * round_off(exact)
        assert factored.count_below(0.5 * (below + above)) == number


def test_modes_that_cannot_be_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where SLEPc's search and the count disagree in the end, that is an error and no guess."""
    without_certificate = replace(normal_modes.SEARCH, most=-1000)
    monkeypatch.setattr(normal_modes, "SEARCH", without_certificate)
    count = FactoredBody.count_below
    monkeypatch.setattr(FactoredBody, "count_below", lambda *args: count(*args) + 1)
    body = reduction(BODIES["coarse square"](MPI.COMM_SELF), 5)
    factored, message = factor(body), r"5 normal modes were found below .* a count gives 6"
    with pytest.raises(RuntimeError, match=message):
        body.basis(factored)
    monkeypatch.undo()
    basis = body.basis(factored)
    body.warn_of_missing_modes(factored, basis)
    with pytest.raises(RuntimeError, match="are freed"):  # the count needs the memory
        factored.solve(basis.shapes)
    count_last = FactoredBody.count_last
    monkeypatch.setattr(FactoredBody, "count_last", lambda *args: count_last(*args) + 1)
    with pytest.warns(UserWarning, match=message):
        body.warn_of_missing_modes(factor(body), basis)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("name", "modes", "most"),
    [("square with a large hole", 10, 100), ("star of 5", 10, 100), ("star of 5", 10, -1000)],
)
def test_the_same_on_several_ranks(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch, name: str, modes: int, most: int
) -> None:
    """Noise finds further copies, or SLEPc where spaces are small; all ranks go the same way."""
    monkeypatch.setattr(normal_modes, "SEARCH", replace(normal_modes.SEARCH, most=most))
    serial_reduction = reduction(BODIES[name](MPI.COMM_SELF), 1)
    exact = all_eigenvalues(serial_reduction, factor(serial_reduction))
    shared = reduction(BODIES[name](comm), modes, tolerance=1e-6)
    basis = shared.basis(factor(shared))
    error = np.abs(basis.eigenvalues - exact[:modes])
    assert np.all(error < 1e-6 * exact[:modes] + round_off(exact))
    gram = shared.elasticity.inner(basis.normal, basis.mass_times_normal)
    np.testing.assert_allclose(gram, np.eye(modes), atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "modes", "tolerance"),
    [
        *(("coarse square", 8, 1e-6), ("annulus", 5, 1e-8), ("star of 5", 10, 1e-11)),
    ],
)
def test_gradient_where_no_cluster_is_cut(name: str, modes: int, tolerance: float) -> None:
    """By differences of fourth order, along a direction that breaks all symmetries."""
    domain = BODIES[name](MPI.COMM_SELF)
    frame = TangentFrame(next(iter(domain.interfaces)))
    body = FlexibleBody(domain, STEEL, frame=frame, modes=modes, tolerance=tolerance)
    x = np.full(domain.n_cells, 0.7)
    direction = 3e-3 * np.random.default_rng(0).uniform(-1.0, 1.0, domain.n_cells)
    slope = body_compliance(body, x)[1] @ direction
    gap = body.reduce(x).basis.spectral_gap
    expected = difference(lambda way: body_compliance(body, x + way * direction)[0], 1.0)
    # differences are good to some 1e-7 here; the modes kept hold tolerance / gap of those left out
    assert slope == pytest.approx(expected, rel=1e-6 + tolerance / gap, abs=0.0)
