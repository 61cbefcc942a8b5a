# SPDX-License-Identifier: MIT
"""Objectives that depend on the densities themselves: alone, in sums, as constraints."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.derivatives import check_gradient, waves
from shared.problems import four_bar
from shared.rods import HELD, STEEL, rod, ways

import dolfinx_ffr as ffr


class Grayness(ffr.Objective):
    """Area of a body times x (1 - x): zero for void and solid [m^2]."""

    unit = "m^2"

    def __init__(self, body: str) -> None:
        self.body = body

    @property
    def needs_trajectory(self) -> bool:
        return False

    def validate(self, inventory: ffr.Inventory) -> None:
        if self.body not in inventory.densities:
            raise ValueError(f"grayness of body {self.body!r}, which has no density")

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

    def validate(self, inventory: ffr.Inventory) -> None:
        self.volume.validate(inventory)

    def evaluate(self, response: ffr.Response) -> float:
        return self.compliance.evaluate(response) * self.volume.evaluate(response)

    def derivatives(self, response: ffr.Response) -> ffr.Derivatives:
        by_compliance = self.compliance.derivatives(response).scaled(self.volume.evaluate(response))
        share = self.compliance.evaluate(response)
        return by_compliance + self.volume.derivatives(response).scaled(share)


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
    x = waves(size)
    direction = {name: ways(body.domain) for name, body in size.flexible.items()}
    scale = abs(size.value(x).psi)
    problem = four_bar(
        comm, objective, constraints=[ffr.Constraint(objective, upper=scale, name="bound")]
    )
    evaluation = problem.gradient(x)
    # of the same evaluation: on several ranks another one differs by the order of MUMPS's sums
    expected = evaluation.psi / scale - 1.0
    assert evaluation.constraints["bound"].violation == pytest.approx(expected, abs=1e-14)
    slopes = [
        comm.allreduce(sum(float(each.gradient[name] @ d) for name, d in direction.items()))
        for each in (evaluation, evaluation.constraints["bound"])
    ]
    assert slopes[1] == pytest.approx(slopes[0] / scale, rel=1e-9)
    check_gradient(problem, x, direction, taylor=4e-3, roundoff=1e-14)


def test_nothing_is_simulated_for_densities(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: object) -> None:
        raise AssertionError("a simulation")

    monkeypatch.setattr("dolfinx_ffr.problem.spread.integrate", refuse)
    problem = four_bar(comm, ffr.Volume("coupler") + 0.5 * Grayness("rocker"))
    x = waves(problem)
    evaluation = problem.gradient(x)
    assert not evaluation.is_simulated
    with pytest.raises(ValueError, match="there is no trajectory: nothing was simulated"):
        _ = evaluation.trajectory
    volume = problem.flexible["coupler"].volume(x["coupler"])
    rocker = problem.flexible["rocker"].domain
    gray = rocker.sum(rocker.cell_volumes * x["rocker"] * (1.0 - x["rocker"]))
    assert evaluation.psi == pytest.approx(volume[0] + 0.5 * gray, rel=1e-14)
    assert evaluation.gradient is not None
    np.testing.assert_allclose(evaluation.gradient["coupler"], volume[1], rtol=1e-14)


def test_elements_one_by_one_see_the_densities(comm: MPI.Intracomm) -> None:
    problem = four_bar(comm, ffr.IntegralCompliance() + 1e-3 * Grayness("rocker"))
    x = waves(problem)
    evaluation = problem.gradient(x)
    assert evaluation.gradient is not None
    cells = {"rocker": np.arange(0, problem.flexible["rocker"].domain.n_cells, 7)}
    single = ffr.paper.elementwise_gradient(problem, evaluation, cells, progress=False)["rocker"]
    exact = evaluation.gradient["rocker"][single.cells]
    np.testing.assert_allclose(single.values, exact, atol=1e-8 * np.max(np.abs(exact), initial=0.0))


@pytest.mark.parametrize(
    "options",
    [{"point_masses": True}, {"point_masses": True, "pinned": ["right"]}],
    ids=["mass", "mass and bearing"],
)
def test_taylor_order_of_frequencies_with_what_hangs_on_the_body(options: dict[str, Any]) -> None:
    domain = ffr.Domain.rectangle(MPI.COMM_SELF, 0.3, 0.02, elements=(12, 2))
    body = ffr.FlexibleBody(domain, STEEL, frame=ffr.TangentFrame("left"), modes=4)
    weights = [ffr.PointMass(("rod", "right"), 0.3)]
    mechanism = ffr.Mechanism({"rod": ffr.Placement()}, point_masses=weights)
    method = ffr.GeneralizedAlpha(0.1, 2)  # nothing is simulated
    problem = ffr.Problem({"rod": body}, mechanism, method, ffr.Frequency("rod", **options))
    check_gradient(problem, waves(problem), {"rod": ways(domain)}, taylor=4e-3)


def test_refused_where_there_is_no_density(comm: MPI.Intracomm) -> None:
    with pytest.raises(ValueError, match="grayness of body 'crank', which has no density"):
        four_bar(comm, Grayness("crank"))
    with pytest.raises(ValueError, match=r"volume of body 'rod', but the bodies with a density"):
        ffr.Volume("rod").evaluate(ffr.Response(None, {}))
    with pytest.raises(ValueError, match="the objective needs a trajectory"):
        ffr.IntegralCompliance().evaluate(ffr.Response(None, {}))


@pytest.mark.mpi
def test_volume_of_regions(comm: MPI.Intracomm) -> None:
    """Two halves make the whole; a mask and a predicate are the same; void regions are empty."""
    gap = {"void": lambda x: (x[0] > 0.199) & (x[0] < 0.261)}
    body = rod(comm, frame=HELD, modes=1, **gap)
    domain = body.domain
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
    evaluation = problem.gradient(x)
    shares = {name: bound.value for name, bound in evaluation.constraints.items()}
    assert shares["left"] == pytest.approx((2 * 1.0 + 8 * 0.6) / 10, rel=1e-13)
    assert shares["right"] == pytest.approx((2 * 1.0 + 5 * 0.6) / 10, rel=1e-13)
    assert shares["void"] == 0.0
    assert evaluation.psi == pytest.approx(0.5 * (shares["left"] + shares["right"]), rel=1e-13)
    gradient = evaluation.constraints["left"].gradient
    assert gradient is not None
    half = np.where(domain.centroids[:, 0] < 0.2, 2.0 * domain.cell_volumes / domain.area, 0.0)
    np.testing.assert_allclose(gradient["bar"], half / 0.5, rtol=1e-13)
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
