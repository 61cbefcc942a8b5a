# SPDX-License-Identifier: MIT
"""Objectives that depend on the densities themselves: alone, in sums, as constraints."""

from __future__ import annotations

from collections.abc import Collection

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import four_bar

import dolfinx_ffr as ffr
from dolfinx_ffr.verification import assert_taylor_order, taylor_test

Field = dict[str, np.ndarray]


class Grayness(ffr.Objective):
    """Area of a body times x (1 - x): zero for void and solid [m^2]."""

    def __init__(self, body: str) -> None:
        self.body = body

    @property
    def needs_trajectory(self) -> bool:
        return False

    def evaluate(self, response: ffr.Response) -> float:
        density = response.densities[self.body]
        return density.sum(density.areas * density.values * (1.0 - density.values))

    def derivatives(self, response: ffr.Response) -> ffr.Derivatives:
        density = response.densities[self.body]
        return ffr.Derivatives(densities={self.body: density.areas * (1.0 - 2.0 * density.values)})


class SpecificCompliance(ffr.Objective):
    """Integral compliance times the filled share of a body, a product of both worlds [J s]."""

    def __init__(self, body: str) -> None:
        self.compliance, self.volume = ffr.IntegralCompliance(), ffr.Volume(body)

    def validate(self, densities: Collection[str]) -> None:
        self.volume.validate(densities)

    def evaluate(self, response: ffr.Response) -> float:
        return self.compliance.evaluate(response) * self.volume.evaluate(response)

    def derivatives(self, response: ffr.Response) -> ffr.Derivatives:
        through = self.compliance.derivatives(response).scaled(self.volume.evaluate(response))
        share = self.compliance.evaluate(response)
        return through + self.volume.derivatives(response).scaled(share)


def designs(problem: ffr.Problem) -> tuple[Field, Field]:
    """Densities, and directions in which to move them, as functions of position alone."""
    centroids = {name: body.domain.centroids for name, body in problem.flexible.items()}
    x = {name: 0.7 + 0.2 * np.sin(60 * c[:, 0] + 90 * c[:, 1]) for name, c in centroids.items()}
    return x, {name: np.cos(50 * c[:, 0] + 70 * c[:, 1]) for name, c in centroids.items()}


def moved(x: Field, direction: Field, step: float) -> Field:
    return {name: x[name] + step * direction[name] for name in x}


def slope(comm: MPI.Comm, gradient: Field | None, direction: Field) -> float:
    assert gradient is not None
    return comm.allreduce(sum(float(gradient[name] @ d) for name, d in direction.items()))


@pytest.mark.mpi
@pytest.mark.parametrize(
    "objective",
    [
        Grayness("coupler"),
        ffr.Volume("rocker"),
        ffr.Volume("rocker", region=lambda x: x[0] < 0.1),
        2e-3 * Grayness("coupler") + ffr.IntegralCompliance() - 1e-6 * ffr.Volume("rocker"),
        SpecificCompliance("coupler"),
    ],
    ids=["alone", "volume", "region", "sum", "product"],
)
def test_taylor_order_as_objective_and_as_constraint(
    comm: MPI.Intracomm, objective: ffr.Objective
) -> None:
    size = four_bar(comm, objective)
    x, direction = designs(size)
    scale = abs(size.value(x).psi)
    problem = four_bar(
        comm, objective, constraints=[ffr.Constraint(objective, upper=scale, name="bound")]
    )
    found = problem.gradient(x)
    # of the same evaluation: on several ranks another one differs by the order of MUMPS's sums
    expected = found.psi / scale - 1.0
    assert found.constraints["bound"].value == pytest.approx(expected, abs=1e-14)
    slopes = (
        slope(comm, found.gradient, direction),
        slope(comm, found.constraints["bound"].gradient, direction),
    )
    assert slopes[1] == pytest.approx(slopes[0] / scale, rel=1e-9)

    def value(step: np.ndarray) -> float:
        return problem.value(moved(x, direction, float(step))).psi / scale

    steps = [4e-3 / 2.0**k for k in range(4)]
    result = taylor_test(value, lambda s: float(s) * slopes[0] / scale, 0.0, 1.0, steps=steps)
    if isinstance(objective, ffr.Volume):  # linear
        assert np.max(result.remainders) < 1e-12
    else:
        assert_taylor_order(result)


@pytest.mark.mpi
def test_nothing_is_simulated_for_densities(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: object) -> None:
        raise AssertionError("a simulation")

    monkeypatch.setattr("dolfinx_ffr.mechanical_problem.simulate", refuse)
    problem = four_bar(comm, ffr.Volume("coupler") + 0.5 * Grayness("rocker"))
    x, _ = designs(problem)
    found = problem.gradient(x)
    volume = problem.flexible["coupler"].volume(x["coupler"])
    rocker = problem.flexible["rocker"].domain
    gray = rocker.sum(rocker.cell_volumes * x["rocker"] * (1.0 - x["rocker"]))
    assert found.psi == pytest.approx(volume[0] + 0.5 * gray, rel=1e-14)
    assert found.gradient is not None
    np.testing.assert_allclose(found.gradient["coupler"], volume[1], rtol=1e-14)


@pytest.mark.mpi
def test_elements_one_by_one_see_the_densities(comm: MPI.Intracomm) -> None:
    problem = four_bar(comm, ffr.IntegralCompliance() + 1e-3 * Grayness("rocker"))
    x, _ = designs(problem)
    found = problem.gradient(x)
    assert found.gradient is not None
    cells = {"rocker": np.arange(0, problem.flexible["rocker"].domain.n_cells, 7)}
    single = ffr.elementwise_gradient(problem, found, cells, progress=False)["rocker"]
    exact = found.gradient["rocker"][single.cells]
    np.testing.assert_allclose(single.values, exact, atol=1e-8 * np.max(np.abs(exact), initial=0.0))


def test_refused_where_there_is_no_density() -> None:
    with pytest.raises(ValueError, match=r"volume of body 'rod', but the bodies with a density"):
        ffr.Volume("rod").evaluate(ffr.Response(None, {}))
    with pytest.raises(NotImplementedError, match="Volume defines no value of the motion alone"):
        ffr.Volume("rod").value(None, {})  # type: ignore[arg-type]


@pytest.mark.mpi
def test_volume_of_regions(comm: MPI.Intracomm) -> None:
    """Two halves make the whole; a mask and a predicate are the same; void regions are empty."""
    domain = ffr.Domain.rectangle(
        comm, 0.4, 0.04, elements=(20, 4), void=lambda x: (x[0] > 0.199) & (x[0] < 0.261)
    )
    steel = ffr.PlaneStress(210e9, 0.3, 7850.0, 0.01)
    body = ffr.FlexibleBody(domain, steel, frame=ffr.TangentFrame("left"), modes=1)
    sides = {
        "left": lambda x: x[0] < 0.2,
        "right": domain.centroids[:, 0] > 0.2,
        "void": lambda x: np.abs(x[0] - 0.23) < 0.03,
    }
    problem = ffr.Problem(
        {"bar": body},
        ffr.Mechanism({"bar": ffr.Placement()}, [ffr.Weld(("bar", "left"), ffr.Ground())]),
        ffr.GeneralizedAlpha(0.1, 10),
        ffr.Volume("bar"),
        [ffr.Constraint(ffr.Volume("bar", mask), 0.5, name=name) for name, mask in sides.items()],
    )
    x = np.where(domain.design_cells, 0.6, domain.passive_density)
    found = problem.gradient(x)
    shares = {name: bound.psi for name, bound in found.constraints.items()}
    assert shares["left"] == pytest.approx((2 * 1.0 + 8 * 0.6) / 10, rel=1e-13)
    assert shares["right"] == pytest.approx((2 * 1.0 + 5 * 0.6) / 10, rel=1e-13)
    assert shares["void"] == 0.0
    assert found.psi == pytest.approx(0.5 * (shares["left"] + shares["right"]), rel=1e-13)
    left = found.constraints["left"].gradient
    assert left is not None
    half = np.where(domain.centroids[:, 0] < 0.2, 2.0 * domain.cell_volumes / domain.area, 0.0)
    np.testing.assert_allclose(left["bar"], half / 0.5, rtol=1e-13)
    for region, message in (
        (lambda x: x[0] > 1.0, "its region holds no cell"),
        (lambda x: x[0], "True or False for each of the rank's"),
        (np.ones(3, dtype=bool), "True or False for each of the rank's"),
    ):
        with pytest.raises(ValueError, match=message):
            ffr.Problem(
                problem.bodies, problem.mechanism, problem.integrator, ffr.Volume("bar", region)
            )
    with pytest.raises(TypeError, match="the region must be a predicate"):
        ffr.Volume("bar", "left")  # type: ignore[arg-type]
