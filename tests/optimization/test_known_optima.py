# SPDX-License-Identifier: MIT
"""Optima that are known in closed form are reached, where psi is not monotone in the densities."""

from __future__ import annotations

import math
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shapely import Polygon

import dolfinx_ffr as ffr

#: Thickness in a cell is its density times the full one; the mean of the densities is bounded
MEAN, LEAST = 0.05, 0.002


class Sheet(ffr.DensityDesign):
    """A sheet of variable thickness: densities are the variables, and become no sharper."""

    class Identity:
        """From a variable in [0, 1] to a density in [LEAST, 1]."""

        beta, eta = 1.0, 0.5

        def __call__(self, variables: np.ndarray) -> np.ndarray:
            return LEAST + (1.0 - LEAST) * variables

        def pullback(self, variables: np.ndarray, bar: np.ndarray) -> np.ndarray:
            return (1.0 - LEAST) * bar

    def __init__(self, domain: ffr.Domain) -> None:
        super().__init__(domain, radius=0.0)
        self.projection = self.Identity()  # type: ignore[assignment]

    def at(self, progress: float) -> Sheet:
        return self


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:optimize. no cell of 'bar' along")
# a sheet as thin as this is neither a part nor a solid for the warnings that look for these
@pytest.mark.filterwarnings("ignore:no part comes of the design of .bar.")
@pytest.mark.filterwarnings("ignore:.*normal modes of body 'bar' shake nothing but")
@pytest.mark.parametrize("ratio", [0.05, 0.25, 1.0])
def test_a_bar_that_hangs_with_a_mass_at_its_end(ratio: float) -> None:
    """The bar of least compliance under its own weight and that of an end mass.

    The end mass is ``ratio`` times the largest mass m of the bar; s runs from 0 at the support to
    1. psi is the largest value of 2 f u - E A u'^2 over all displacements, so its derivative by
    the area at s is 2 rho g u - E u'^2, which is minus the multiplier of the mean. Therefore the
    strain u' is linear in s, and with the force at the end it is rho g L (ratio + s) / E. The
    equilibrium of the force E A u' gives the area ratio (1 + ratio) / (ratio + s)^2 of its mean A,
    and psi = (m g)^2 L / (E A) ratio (1 + ratio). Densities are both the load and the strength, so
    psi is monotone in none of them.
    """
    bar = ffr.Domain.rectangle(MPI.COMM_SELF, 1.0, 0.05, elements=(60, 2), solid_columns=0)
    steel = ffr.PlaneStress(210e9, 0.0, 7850.0, 0.01)
    law = ffr.SIMP(exponent=1.0, floor=1e-9, mass=ffr.LinearMass())
    body = ffr.FlexibleBody(bar, steel, frame=ffr.TangentFrame("left"), modes=24, interpolation=law)
    mass, gravity, stiffness = 3.925 * MEAN, 9.81, 210e9 * 0.05 * 0.01 * MEAN
    mechanism = ffr.Mechanism(
        placements={"bar": ffr.Placement()},
        joints=[ffr.Weld(("bar", "left"), ffr.Ground())],
        point_masses=[ffr.PointMass(("bar", "right"), ratio * mass)],
        gravity=(gravity, 0.0),
        start=ffr.StaticEquilibrium(),
    )
    at_rest = ffr.GeneralizedAlpha(1.0, 10)
    problem = ffr.Problem({"bar": body}, mechanism, at_rest, ffr.IntegralCompliance())

    even = np.full(bar.n_cells, (MEAN - LEAST) / (1.0 - LEAST))
    result = ffr.optimize(
        problem, Sheet(bar), even, volume=MEAN, iterations=60, boundary=0, progress=False
    )

    optimum = (mass * gravity) ** 2 / stiffness * ratio * (1.0 + ratio)
    assert result.psi == pytest.approx(optimum, rel=2e-3)  # modes left out: 1e-3 at 24 of them
    feasible = result.history["psi"][result.history["volume"] <= MEAN * (1.0 + 1e-8)]
    assert result.evaluation.volume["bar"] <= MEAN * (1.0 + 1e-8)
    assert result.psi <= np.min(feasible) * (1.0 + 1e-9)
    assert result.residual < 2e-3


# it is straight for good, so that the bending that would grow without bound never begins
@pytest.mark.filterwarnings("ignore:body 'arm' turns with")
# one triangle across is enough for a bar that is only pulled
@pytest.mark.filterwarnings("ignore:outline. size = ")
# long steps damp the vibrations of the start, as they should: the steady state is wanted
@pytest.mark.filterwarnings("ignore:the start excites vibrations")
@pytest.mark.slow
@pytest.mark.parametrize(("chi", "stations"), [(0.25, 4), (0.75, 6)])
def test_a_spinning_arm_of_least_mass_for_a_stress(chi: float, stations: int) -> None:
    """An arm that turns at a constant speed with a mass at its end, by its widths at stations.

    The least mass has the limit S of the stress everywhere: (S A)' = -rho omega^2 r A, and at the
    end, r = L, S A = M omega^2 L with the end mass M. With chi = omega L / sqrt(2 S / rho) this is
    A = M omega^2 L / S exp(chi^2 (1 - (r / L)^2)), of mass sqrt(pi) chi exp(chi^2) erf(chi) M. A
    design in which the force and the area fall everywhere has no less: each section must carry what
    is outside it. The one mean of the stress over the arm cannot tell which station needs more.
    """
    length, density, thickness, limit = 0.3, 7850.0, 0.01, 100e6
    speed = chi * math.sqrt(2.0 * limit / density) / length
    even = 1.4e-3  # width of the even arm that just meets the limit
    mass = density * length * thickness * even * (1.0 - chi**2) / (2.0 * chi**2)
    least = mass * speed**2 * length / limit / thickness
    places, names = np.linspace(0.0, length, stations + 1), [f"w{i}" for i in range(stations + 1)]

    def shape(widths: dict[str, float]) -> dict[str, Any]:
        half = 0.5 * np.array([widths[name] for name in names])
        outline = np.r_[np.c_[places, -half], np.c_[places, half][::-1]]
        ends = {"left": lambda p: p[0] < 1e-9, "right": lambda p: p[0] > length - 1e-9}
        return {"outline": Polygon(outline), "interfaces": ends}

    bounds = dict.fromkeys(names, (0.8 * least, 3.0 * even))
    design = ffr.DimensionDesign(shape, bounds, size=6e-3, start=dict.fromkeys(names, 1.3 * even))
    steel = ffr.PlaneStress(210e9, 0.0, density, thickness)
    domain = design.domain(MPI.COMM_SELF)
    arm = ffr.FlexibleBody(domain, steel, frame=ffr.TangentFrame("left"), modes=8)
    still = ffr.Motion.constant(0.0)
    hub = ffr.Moving(still, still, ffr.Motion.polynomial([0.0, speed]))
    mechanism = ffr.Mechanism(
        placements={"arm": ffr.Placement(angular_velocity=speed)},
        joints=[ffr.Weld(("arm", "left"), hub)],
        point_masses=[ffr.PointMass(("arm", "right"), mass)],
    )
    problem = ffr.Problem(
        {"arm": arm},
        mechanism,
        ffr.RadauIIA(1.0, steps=3),
        ffr.Mass("arm"),
        [ffr.Constraint(ffr.PeakStress("arm"), upper=limit)],
    )
    result = ffr.optimize(problem, design, iterations=25, progress=False)
    optimum = mass * math.sqrt(math.pi) * chi * math.exp(chi**2) * math.erf(chi)
    assert result.feasible
    assert optimum <= result.psi <= 1.01 * optimum
