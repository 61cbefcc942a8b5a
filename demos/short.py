# SPDX-License-Identifier: MIT
# %% [markdown]
"""# The shortest program that designs a flexible rod.

What you will see: the rod of a slider-crank in motion, and its part as files for CAD. It takes
about a minute.
"""

from mpi4py import MPI

import numpy as np

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting

rod = ffr.Domain.rectangle(MPI.COMM_WORLD, 0.4, 0.04, elements=(200, 20))
steel = ffr.PlaneStress(young=210e9, poisson=0.3, density=7850.0, thickness=0.01)
body = ffr.FlexibleBody(rod, steel, frame=ffr.ChordFrame("left", "right"), modes=8)

crank = ffr.Moving.circle((0, 0), 0.1, ffr.Motion.smooth_step(10 * np.pi, 2.0))
mechanism = ffr.Mechanism(
    placements={"rod": ffr.Placement(position=(0.1, 0.0))},
    joints=[
        ffr.Revolute(("rod", "left"), crank),
        ffr.PointOnLine(("rod", "right"), ffr.Ground()),
    ],
    point_masses=[ffr.PointMass(("rod", "right"), 0.5)],
)
problem = ffr.Problem({"rod": body}, mechanism, ffr.TimeInterval(2.0), ffr.IntegralCompliance())

levelset = ffr.LevelSet(rod)
result = ffr.optimize(problem, levelset, volume=0.5, iterations=36, output="results/short")

print(result.finish("results/short"))  # files for CAD, a picture, psi of the part
plotting.animate_motion(*result.final, "results/short/motion.gif")
