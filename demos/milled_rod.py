# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A rod that is milled: pockets in place of holes.

What you will see: the rod of a slider-crank with pockets from both sides, between which a web of
1 mm stays; its part as files for CAD, STEP with the pockets to their depth; and how far the plane
model of two thicknesses is from the solid in space.

In plane stress stiffness and mass are both in proportion to the thickness, so nothing of the two
levels is penalised:

    min over the pockets of psi = int_0^T q^T K_e(t) q dt,      t(X) = web in pockets, 1 elsewhere.

The cutter has a diameter of 6 mm: no pocket is narrower, and no corner of one has a smaller radius
than 3 mm. The ends of the rod need no solid columns, as its outline has a rim of full thickness.

The solid is meshed by tetrahedra and simulated in the same motion, with a crank pin that holds it
in its plane. It takes a minute; `--elements 200 20 --iterations 36` finds a part that is a little
better.
"""

from typing import Any

from mpi4py import MPI

import numpy as np
from command_line import draw, leave, parse, run, say
from slider_crank import CRANK, DURATION, SLIDER, STEEL, TURNS, reference_problem

import dolfinx_ffr as ffr

# %% Parameters
WEB = 0.1  # share of the thickness of 10 mm
RIB, CUTTER = 1.5e-3, 6e-3  # least width of what has full thickness, diameter of the cutter [m]
IN_SPACE = ffr.Isotropic(STEEL.young, STEEL.poisson, STEEL.density)
MODES = 60  # in space, where most of them leave the plane [-]


# %% The solid in the same motion
def problem_in_space(domain: ffr.Domain, integrator: Any, modes: int = MODES) -> ffr.Problem:
    """The slider-crank in space: the crank pin holds the rod in its plane."""
    rod = ffr.FlexibleBody(domain, IN_SPACE, frame=ffr.ChordFrame("left", "right"), modes=modes)
    angle = ffr.Motion.smooth_step(2 * np.pi * TURNS, DURATION, name="crank angle")
    crank = ffr.Moving.circle((0.0, 0.0, 0.0), CRANK, angle, axis=(0.0, 0.0, 1.0))
    mechanism = ffr.Mechanism(
        placements={"rod": ffr.Placement(position=(CRANK, 0.0, 0.0))},
        joints=[
            ffr.Revolute(("rod", "left"), crank, name="crank pin"),
            ffr.PointOnPlane(("rod", "right"), ffr.Ground(), normal=(0, 1, 0), name="slider"),
        ],
        point_masses=[ffr.PointMass(("rod", "right"), SLIDER)],
    )
    return ffr.Problem({"rod": rod}, mechanism, integrator, ffr.IntegralCompliance())


def main(arguments: list[str] | None = None) -> None:
    """Design the pockets, and verify them in the plane and in space."""
    defaults = {"elements": (100, 10), "iterations": 24, "boundary": 12, "resume": False}
    options = parse(arguments, "milled_rod", **defaults, steps=None, tetrahedra=8e-3)
    problem = reference_problem(
        MPI.COMM_WORLD, options.elements, steps=options.steps, solid_columns=0
    )
    domain = problem.flexible["rod"].domain
    even = problem.gradient(np.full(domain.n_cells, 0.5))
    mirrors = ffr.mirror_lines(domain, even.gradient["rod"])
    sizes = {"minimum_member": RIB, "minimum_gap": CUTTER}
    design = ffr.LevelSet(domain, web=WEB, mirrors=mirrors, **sizes)
    with ffr.recorded_warnings() as warnings:
        result = ffr.optimize(problem, design, **options.run)
        finished = result.finish(options.output)
    # a mesh that fits pockets covers all of the rod
    final_problem = result.final[0]
    full = final_problem.value(np.ones(final_problem.flexible["rod"].domain.n_cells)).psi
    draw(result, options.output, full=full)

    # %% Two thicknesses in plane stress beside the solid
    part = result.part()
    solid = part.in_space(options.tetrahedra)
    in_space = problem_in_space(solid, final_problem.integrator)
    difference = in_space.value(np.ones(solid.n_cells)).psi / result.psi - 1.0
    say(f"psi of {solid.n_cells_global} tetrahedra is {100 * difference:+.2f} % of the plane's")
    assert abs(difference) < 0.005, "the plane model is not that of the solid"
    numbers = {"apart_in_space": difference, "most": 0.425 * full}
    leave(options, result, "A milled rod", full, finished, warnings, **numbers)


if __name__ == "__main__":
    run(main)
