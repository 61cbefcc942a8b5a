from __future__ import annotations
import numpy as np
from mpi4py import MPI
import dolfinx_ffr as ffr

def reference_problem(comm, elements=(200, 20), order=1, domain=None, steps=2000, cell="quadrilateral"):
    if domain is None:
        domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=elements, order=order, cell=cell)
    rod = ffr.FlexibleBody(domain, ffr.PlaneStress(210e9, 0.3, 7850.0, 0.01), frame=ffr.ChordFrame("left", "right"), modes=8)
    angle = ffr.Motion.smooth_step(2 * np.pi * 5, 2.0)
    mechanism = ffr.Mechanism(
        placements={"rod": ffr.Placement(position=(0.1, 0.0))},
        joints=[
            ffr.Revolute(("rod", "left"), ffr.Moving.circle((0.0, 0.0), 0.1, angle)),
            ffr.PointOnLine(("rod", "right"), ffr.Ground()),
        ],
        point_masses=[ffr.PointMass(("rod", "right"), 0.5)],
    )
    return ffr.Problem({"rod": rod}, mechanism, ffr.GeneralizedAlpha(2.0, steps), ffr.IntegralCompliance())
