# SPDX-License-Identifier: MIT
"""Designs of one's own: slices of a body, and variables of something without a mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import slider_crank
from shared.scenes import four_bar

import dolfinx_ffr as ffr


class Slices(ffr.design.Design):
    """One density for each of some slices of a body along x."""

    each = "slice"

    def __init__(self, domain: ffr.Domain, slices: int) -> None:
        self.domain, self.size = domain, slices
        everywhere = domain.everywhere(domain.centroids)[:, 0]
        edges = np.linspace(everywhere.min(), everywhere.max(), slices + 1)
        self.slice = np.searchsorted(edges[1:-1], domain.centroids[:, 0])

    def density(self, variables: np.ndarray) -> np.ndarray:
        designed = self.domain.design_cells
        return np.where(designed, variables[self.slice], self.domain.passive_density)

    def pullback(self, variables: np.ndarray, x_bar: np.ndarray) -> np.ndarray:
        designed = np.where(self.domain.design_cells, x_bar, 0.0)
        own = np.bincount(self.slice, designed, minlength=self.size)
        return sum(self.domain.comm.allgather(own))  # in the same order on every rank

    def identity(self) -> dict[str, Any]:
        return {"slices": self.size}


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore:no part can be made of the design")  # gray
def test_slices(comm: MPI.Intracomm) -> None:
    """Its way back is the transpose; moving asymptotes lower psi with it below the volume."""
    problem = slider_crank(comm, (20, 4), modes=2, steps=100)
    domain = problem.flexible["rod"].domain
    design = Slices(domain, 6)
    rng = np.random.default_rng(0)
    u, direction = rng.random(6), rng.random(6)
    x_bar = np.cos(50.0 * domain.centroids[:, 0] + 90.0 * domain.centroids[:, 1])
    along = design.density(u + direction) - design.density(u)
    bar = design.pullback(u, x_bar)
    assert all(np.array_equal(bar, other) for other in comm.allgather(bar))
    assert bar @ direction == pytest.approx(domain.sum(x_bar * along), rel=1e-12)
    result = ffr.optimize(problem, design, volume=0.6, iterations=6, boundary=0, progress=False)
    assert result.psi < result.history["psi"][0]
    np.testing.assert_array_equal(result.x, design.density(result.coefficients))
    assert domain.sum(result.x * domain.cell_volumes) / domain.area <= 0.6 * (1.0 + 1e-9)


class Crank(ffr.Variables):
    """Mass [kg] and centre of mass [0.1 m] of a rigid crank."""

    each, size = "parameter of the crank", 2
    lower, upper = 0.1, 0.9

    @staticmethod
    def make(p: np.ndarray) -> ffr.VolumeIntegrals:
        markers = {"left": (-0.05, 0.0), "right": (0.05, 0.0)}
        return ffr.VolumeIntegrals.rigid(p[0], (0.1 * p[1], 0.005), 4e-4, markers)

    @staticmethod
    def jacobian(p: np.ndarray) -> list[ffr.VolumeIntegrals]:
        def along(k: int) -> ffr.VolumeIntegrals:
            ends = (Crank.make(p + sign * 0.05 * np.eye(2)[k]) for sign in (1.0, -1.0))
            more, less = ends
            return (more + less.scaled(-1.0)).scaled(10.0)  # exact: quadratic in each

        return [along(0), along(1)]

    def identity(self) -> dict[str, Any]:
        return {"crank": self.size}


class CrankProblem:
    """A problem of one's own, whose only variables are the parameters of the crank."""

    def __init__(self) -> None:
        self.scene, self.comm = four_bar(steps=60), MPI.COMM_SELF
        self.mechanics = ffr.MechanicalProblem(
            self.scene.mechanism, self.scene.integrator, ffr.JointForce("motor bearing")
        )
        self.body = ffr.ParametricBody(Crank.make, Crank.jacobian)
        self.flexible: dict[str, Any] = {}
        self.load_cases: dict[str, Any] = {}
        self.constraints: list[Any] = []
        self.combine = ffr.WeightedSum()

    def value(self, p: np.ndarray) -> ffr.Evaluation:
        self.at = p
        evaluation = self.mechanics.gradient({**self.scene.bodies, "crank": self.body(p)})
        assert evaluation.derivatives is not None
        slope = self.body.pullback(p, evaluation.derivatives.integrals["crank"])
        gradient = {"crank": slope}
        return ffr.Evaluation(evaluation.psi, {}, {}, {}, {}, {}, {}, gradient=gradient)

    def differentiate(self, evaluation: ffr.Evaluation) -> ffr.Evaluation:
        return evaluation

    def calibrated(self, evaluation: ffr.Evaluation) -> tuple[Any, ffr.Evaluation]:
        return self, evaluation


def test_variables_without_a_domain_are_optimised(tmp_path: Path) -> None:
    """By moving asymptotes, which a checkpoint interrupts; a crank that is light is the best."""
    crank, options = Crank(), {"progress": False, "output": tmp_path}
    assert crank.even(0.25) == pytest.approx([0.3, 0.3], abs=1e-15) and crank.at(0.5) is crank
    assert np.array_equal(crank.check([0.0, 0.4]), [0.1, 0.4])
    with pytest.raises(
        ValueError, match="expected 2 finite variables, one a parameter of the cran"
    ):
        crank.check([0.5])
    ffr.optimize(CrankProblem(), {"crank": crank}, iterations=6, **options)  # type: ignore[arg-type]
    result = ffr.optimize(
        CrankProblem(),  # type: ignore[arg-type]
        {"crank": crank},
        iterations=12,
        resume=True,
        **options,  # type: ignore[arg-type]
    )
    assert result.psi < 0.99 * result.history["psi"][0] and result.feasible
    assert result.psi == CrankProblem().value(result.variables["crank"]).psi
    assert result.variables["crank"][0] == pytest.approx(0.1, abs=1e-6)
    assert result.densities == {} and np.isnan(result.history["volume"]).all()
    problem = slider_crank(MPI.COMM_SELF, (20, 4), modes=2, steps=100)
    rod = ffr.DensityDesign(problem.flexible["rod"].domain)
    with pytest.raises(ValueError, match=r"densities given for \['crank', 'rod'\], but the flex"):
        ffr.optimize(problem, {"crank": crank, "rod": rod}, progress=False)
