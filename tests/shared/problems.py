# SPDX-License-Identifier: MIT
"""Problems with bodies on meshes that several tests use."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import numpy as np
from slider_crank import reference_problem

import dolfinx_ffr as ffr
from shared.rods import rod
from shared.scenes import COUPLER, CRANK, ROCKER, four_bar_mechanism, slider_crank_mechanism


class Copy:
    """A problem with a known answer: psi = sum_e V_e (x_e - target_e)^2 / sum_e V_e."""

    def __init__(self, comm: MPI.Intracomm, target: Callable[[np.ndarray], np.ndarray]) -> None:
        self.domain = ffr.Domain.rectangle(comm, 0.4, 0.08, elements=(40, 8))
        plate = SimpleNamespace(domain=self.domain, modes=1)
        plate.with_cut_elements = lambda: plate
        self.flexible = {"plate": plate}
        self.constraints: list[Any] = []
        self.combine = ffr.WeightedSum()
        self.load_cases: dict[str, Any] = {}
        self.target = np.where(self.domain.design_cells, target(self.domain.centroids), 1.0)
        #: Number of the values that fail, from 1
        self.broken: set[int] = set()
        self.calls = 0

    def value(self, x: np.ndarray) -> Any:
        self.calls += 1
        if self.calls in self.broken:
            raise ffr.SimulationError("too soft", trajectory=None)
        domain = self.domain
        defect = x - self.target
        return ffr.Evaluation(
            psi=domain.sum(domain.cell_volumes * defect**2) / domain.area + 1.0,
            gradient={"plate": 2.0 * domain.cell_volumes * defect / domain.area},
            bodies={},
            volume={"plate": domain.sum(domain.cell_volumes * x) / domain.area},
            fixed_interface_frequencies={"plate": np.array([7.0])},
            outer_gap={"plate": 1.0},
            solver_iterations={"plate": 3},
            seconds={},
        )

    def differentiate(self, evaluation: Any) -> Any:
        return evaluation

    def calibrated(self, evaluation: Any) -> tuple[Any, Any]:
        return self, evaluation

    gradient = value


def four_bar(comm: MPI.Comm, objective: ffr.Objective, steps: int = 150, **options) -> ffr.Problem:  # type: ignore[no-untyped-def]
    """Rigid crank driven by a motor, flexible coupler and flexible rocker."""
    mechanism = four_bar_mechanism({"coupler": ffr.RayleighDamping(1.0, 1e-5)}, origin=0.0)
    plastic = ffr.PlaneStress(3e9, 0.35, 1200.0, 0.01)
    bodies = {
        "crank": ffr.VolumeIntegrals.rigid(
            0.2, (0.05, 0.0), 3e-4, {"left": (0.0, 0.0), "right": (CRANK, 0.0)}
        ),
        "coupler": rod(comm, (20, 4), (COUPLER, 0.03), plastic, stiffening=("omega2",)),
        "rocker": rod(comm, (15, 3), (ROCKER, 0.03), plastic, frame=ffr.TangentFrame("right")),
    }
    return ffr.Problem(bodies, mechanism, ffr.GeneralizedAlpha(0.25, steps), objective, **options)


def slider_crank(
    comm: MPI.Comm,
    elements: tuple[int, int] = (40, 8),
    *,
    modes: int = 4,
    steps: int = 200,
    **of_the_rod: Any,
) -> ffr.Problem:
    """The slider-crank of the demo on a coarse mesh, its rod with options of `FlexibleBody`."""
    domain = of_the_rod.pop("domain", None)
    problem = reference_problem(comm, elements, domain=domain, modes=modes, steps=steps)
    if not of_the_rod:
        return problem
    plain = problem.flexible["rod"]
    options = {"frame": plain.reduction.frame, "modes": modes, **of_the_rod}
    bodies = {"rod": ffr.FlexibleBody(plain.domain, plain.material, **options)}
    return ffr.Problem(bodies, problem.mechanism, problem.integrator, problem.objective)


def crank_motion(duration: float, slider: float = 0.5, *, turns: float = 5.0) -> ffr.Mechanism:
    """The slider-crank of the demo at another speed, with another mass of the slider."""
    angle = ffr.Motion.smooth_step(2.0 * np.pi * turns, duration, name="crank angle")
    return slider_crank_mechanism(angle, slider=slider, origin=0.0)


def swing_about_a_point(comm: MPI.Comm, steps: int, **options: Any) -> ffr.Problem:
    """A soft rod that is driven about a joint in its middle, with a mass at another point."""
    soft = ffr.PlaneStress(2e9, 0.3, 1000.0, 0.01)
    markers = {"middle": (0.2, 0.003), "tip": (0.3, 0.02)}
    body = rod(comm, (32, 4), material=soft, modes=4, markers=markers)
    angle = ffr.Motion.smooth_step(2.0, 0.2)
    mechanism = ffr.Mechanism(
        placements={"rod": ffr.Placement(position=(0.0, 0.0))},
        joints=[
            ffr.Revolute(("rod", "middle"), ffr.Ground((0.2, 0.003))),
            ffr.PrescribedAngle(("rod", "middle"), angle),
        ],
        point_masses=[ffr.PointMass(("rod", "tip"), 0.05)],
        gravity=(0.0, -9.81),
        **options,
    )
    integrator = ffr.GeneralizedAlpha(0.2, steps)
    return ffr.Problem({"rod": body}, mechanism, integrator, ffr.IntegralCompliance())


def three_load_cases(
    comm: MPI.Comm,
    combine: ffr.Combination | None = None,
    elements: tuple[int, int] = (40, 8),
    *,
    constraints: bool = True,
    steps: int = 400,
    **of_the_rod: Any,
) -> ffr.Problem:
    """One rod: slow and light, fast, and heavy with an oscillating line in the place of a crank."""
    bodies = slider_crank(comm, elements, **of_the_rod).bodies
    swing = ffr.Motion.smooth_step(np.pi, 0.5)
    lever = ffr.Mechanism(
        placements={"rod": ffr.Placement(position=(0.0, 0.0))},
        joints=[
            ffr.Revolute(("rod", "left"), ffr.Ground(), name="bearing"),
            ffr.PrescribedAngle(("rod", "left"), swing, name="motor"),
        ],
        point_masses=[ffr.PointMass(("rod", "right"), 1.0)],
        damping={"rod": ffr.RayleighDamping(1.0, 1e-5)},
    )

    def case(
        mechanism: ffr.Mechanism, end: float, objective: ffr.Objective, *bounds: ffr.Constraint
    ) -> ffr.MechanicalProblem:
        constraints_given = bounds if constraints else ()
        return ffr.MechanicalProblem(
            mechanism, ffr.GeneralizedAlpha(end, steps), objective, constraints_given
        )

    force = ffr.Constraint(ffr.JointForce("slider"), upper=8.0)
    # psi of the three is about as large
    energy = 0.02 * ffr.PeakCompliance()
    load_cases = {
        "slow": case(crank_motion(2.0), 2.0, ffr.IntegralCompliance(), force),
        "fast": case(crank_motion(1.6, 0.4), 1.6, ffr.IntegralCompliance() + 0.5 * energy, force),
        "lever": case(
            lever, 0.5, energy, ffr.Constraint(ffr.PeakStress("rod"), upper=1.0e8, name="stress")
        ),
    }
    return ffr.Problem.of_load_cases(bodies, load_cases, combine)
