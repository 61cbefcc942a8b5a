# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A designed rod, moved by Exudyn from its file alone.

What you will see: the rod of a slider-crank is designed, its part is verified on meshes that fit
it, and the reduction of the finest one goes into files: standard input data (SID) for Simpack and
others, and ``rod.npz`` for Exudyn. Exudyn moves the rod from that file, which knows of no mesh, and
its elastic coordinates q(t) are those of our own motion.

**Model.** Both solve the same equations of motion in the floating frame, M(q) y'' + h(q, q', w) +
K q = G^T lambda, where M, h and K follow from the mass and the integrals S_a = int rho w_a and
P_ab = int rho w_a w_b^T of the file. Exudyn integrates by generalised-alpha with steps h and h/2,
whose error of second order is extrapolated away; we by Radau IIA of order 5.

Exudyn is on PyPI: `pip install exudyn`. Run `python demos/rod_in_exudyn.py --help`; it
takes some seconds.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from command_line import parse, say

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.program import run

# %% Parameters
LENGTH, HEIGHT, CRANK = 0.4, 0.04, 0.1  # [m]
DESIGNED, MOVED = 1.0, 0.05  # One turn for the design, and one for the comparison [s]
PLASTIC = ffr.PlaneStress(young=3e9, poisson=0.35, density=1200.0, thickness=0.01)
ROWS = 40  # Instants that are compared
BETA = 1e-4  # Damping by the stiffness [s]
TURN = ffr.Motion.smooth_step(2.0 * np.pi, MOVED)


# %% The scene
def slider_crank(comm: MPI.Comm, elements: tuple[int, int], duration: float) -> ffr.Problem:
    """The rod between a crank that turns once in a duration [s] and a slider."""
    turn = ffr.Motion.smooth_step(2.0 * np.pi, duration)
    domain = ffr.Domain.rectangle(comm, LENGTH, HEIGHT, elements=elements)
    body = ffr.FlexibleBody(domain, PLASTIC, frame=ffr.ChordFrame("left", "right"), modes=3)
    mechanism = ffr.Mechanism(
        placements={"rod": ffr.Placement((CRANK, 0.0))},
        joints=[
            ffr.Revolute(("rod", "left"), ffr.Moving.circle((0.0, 0.0), CRANK, turn)),
            ffr.PointOnLine(("rod", "right"), ffr.Ground()),
        ],
        damping={"rod": ffr.RayleighDamping(beta=BETA)},
    )
    times = ffr.GeneralizedAlpha(duration, 400)
    return ffr.Problem({"rod": body}, mechanism, times, ffr.IntegralCompliance())


# %% Exudyn knows the file and the crank
def by_exudyn(path: Path, steps: int) -> np.ndarray:
    """Elastic coordinates of the rod in a file at equal steps, shape (steps + 1, r)."""
    import exudyn
    import exudyn.itemInterface as items
    from exudyn.FEM import ObjectFFRFreducedOrderInterface

    mbs, rod = exudyn.SystemContainer().AddSystem(), ObjectFFRFreducedOrderInterface()
    rod.LoadFromFile(str(path))
    made = rod.AddObjectFFRFreducedOrder(
        mbs, positionRef=[CRANK, 0.0, 0.0], stiffnessProportionalDamping=BETA
    )
    ground, origin = mbs.AddObject(items.ObjectGround()), mbs.AddNode(items.NodePointGround())
    fixed = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=origin, coordinate=0))

    def pin(t: float) -> tuple[complex, complex]:  # displacement from the start, and velocity
        place = CRANK * np.exp(1j * TURN.value(t))
        return place - CRANK, 1j * TURN.velocity(t) * place

    for axis, part in enumerate([np.real, np.imag, lambda x: 0.0 * np.real(x)]):

        def shift(mbs: Any, t: float, item: int, offset: float, part: Any = part) -> float:
            return float(part(pin(t)[0]))

        def speed(mbs: Any, t: float, item: int, offset: float, part: Any = part) -> float:
            return float(part(pin(t)[1]))

        node = {"nodeNumber": made["nRigidBody"], "coordinate": axis}
        ends = [fixed, mbs.AddMarker(items.MarkerNodeCoordinate(**node))]
        offsets = {"offsetUserFunction": shift, "offsetUserFunction_t": speed}
        mbs.AddObject(items.ObjectConnectorCoordinate(markerNumbers=ends, **offsets))
    right = 4  # the first of four nodes of the second marker
    end = {"meshNodeNumbers": [right], "weightingFactors": [1.0]}
    slider = items.MarkerSuperElementPosition(bodyNumber=made["oFFRFreducedOrder"], **end)
    line = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=ground))
    ends = [line, mbs.AddMarker(slider)]
    mbs.AddObject(items.ObjectJointSpherical(markerNumbers=ends, constrainedAxes=[0, 1, 1]))
    kept = {"storeInternal": True, "writeToFile": False}
    kept["outputVariableType"] = exudyn.OutputVariableType.Coordinates
    sensor = mbs.AddSensor(items.SensorNode(nodeNumber=made["nGenericODE2"], **kept))
    mbs.Assemble()
    settings = exudyn.SimulationSettings()
    time = settings.timeIntegration
    time.numberOfSteps, time.endTime, time.verboseMode = steps, MOVED, 0
    time.newton.relativeTolerance = time.newton.absoluteTolerance = 1e-12
    time.generalizedAlpha.spectralRadius = 0.9
    time.generalizedAlpha.computeInitialAccelerations = True
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 0.5 * MOVED / steps
    mbs.SolveDynamic(settings)
    return np.asarray(mbs.GetSensorStoredData(sensor)[:, 1:])


# %% The program
def main(arguments: list[str] | None = None) -> None:
    """Design the rod, write it, and let both programs move it."""
    options = parse(arguments, "rod_in_exudyn", elements=(60, 6), iterations=30, boundary=0)
    if find_spec("exudyn") is None:
        raise SystemExit("Exudyn is not installed: pip install exudyn")
    comm, output = MPI.COMM_WORLD, options.output
    problem = slider_crank(comm, options.elements, DESIGNED)
    levelset = ffr.LevelSet(problem.flexible["rod"].domain)
    result = ffr.optimize(problem, levelset, volume=0.6, **options.run)
    found = result.verify(modes=3)
    found.export(output / "rod.SID_FEM")
    found.export(output / "rod.npz", format="exudyn")
    comm.Barrier()
    path, body = output / "rod.npz", found.bodies["rod"][1].integrals
    motion = ffr.simulate(
        slider_crank(comm, (6, 2), MOVED).mechanism,
        {"rod": body},
        ffr.RadauIIA(MOVED, steps=10 * ROWS),
    )
    ours = motion.elastic("rod")[:: 10 * motion.integrator.stages]
    coarse, fine = (by_exudyn(path, n * ROWS)[::n] for n in (25, 50))
    theirs = fine + (fine - coarse) / 3.0
    largest = np.max(np.abs(ours))
    apart = np.max(np.abs(theirs - ours)) / largest
    say(
        f"{body.modes} elastic coordinates up to {1e3 * largest:.3g} mm differ by {apart:.1e} of it"
    )

    # %% Pictures and numbers
    t = np.linspace(0.0, MOVED, ROWS + 1)
    curves = {
        f"elastic coordinate {k + 1}": {"here": (t, ours[:, k]), "Exudyn": (t, theirs[:, k])}
        for k in (0, 3)
    }
    plotting.plot_curves(curves, output / "coordinates.png", xlabel="time [s]")
    ffr.write_summary(comm, output / "summary.json", {"difference": apart, "psi": found.psi})

    # %% One file, one motion
    assert apart < 1e-6, f"the motions differ by {apart:.1e}"


if __name__ == "__main__":
    run(main)
