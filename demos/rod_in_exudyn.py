# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A designed rod, moved by Exudyn from its file alone.

What you will see: the part of a designed rod goes into files: standard input data (SID) for Simpack
and others, and ``rod.npz`` for Exudyn. Exudyn moves the rod from that file, which knows of no mesh,
and its elastic coordinates q(t) are those of our own motion.

**Model.** Both solve M(q) y'' + h(q, q', w) + K q = G^T lambda in the floating frame, where M, h
and K follow from the mass, S_a = int rho w_a and P_ab = int rho w_a w_b^T of the file: Exudyn by
generalised-alpha with steps h and h/2, whose error is extrapolated away; we by Radau IIA.

Exudyn is on PyPI: `pip install exudyn`. Run `python demos/rod_in_exudyn.py --help`; it
takes some seconds.
"""

from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from command_line import parse, run, say
from exudyn_motion import body_from, elastic_coordinates, hold
from slider_crank import CRANK, HEIGHT, LENGTH, slider_crank

import dolfinx_ffr as ffr

# %% Parameters
DESIGNED, MOVED, ROWS = 1.0, 0.05, 40  # one turn each [s]; instants that are compared
PLASTIC = ffr.PlaneStress(young=3e9, poisson=0.35, density=1200.0, thickness=0.01)
DAMPED = ffr.RayleighDamping(beta=1e-4)  # by the stiffness [s]
#: The mechanism over a time [s], without a mass of the slider
one_turn = partial(slider_crank, slider=0.0, turns=1, damping={"rod": DAMPED})
TURN = ffr.Motion.smooth_step(2.0 * np.pi, MOVED)


# %% Exudyn knows the file and the crank
def by_exudyn(path: Path, steps: int) -> np.ndarray:
    """Elastic coordinates of the rod in a file at equal steps, shape (steps + 1, r)."""
    import exudyn.itemInterface as items

    start = {"positionRef": [CRANK, 0.0, 0.0], "stiffnessProportionalDamping": DAMPED.beta}
    mbs, created = body_from(path, **start)
    hold(mbs, created, 4, [0, 1, 1])  # the slider, the first node of the second marker
    origin = mbs.AddNode(items.NodePointGround())
    fixed = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=origin, coordinate=0))

    def pin(t: float) -> tuple[complex, complex]:  # displacement from the start, and velocity
        place = CRANK * np.exp(1j * TURN.value(t))
        return place - CRANK, 1j * TURN.velocity(t) * place

    for axis, along in enumerate((1.0, -1.0j, 0.0)):  # Re(along z) is x, y or 0 of a complex z
        node = {"nodeNumber": created["nRigidBody"], "coordinate": axis}
        ends = [fixed, mbs.AddMarker(items.MarkerNodeCoordinate(**node))]
        shift, speed = (
            lambda mbs, t, item, offset, k=k, along=along: float((along * pin(t)[k]).real)
            for k in range(2)
        )
        offsets = {"offsetUserFunction": shift, "offsetUserFunction_t": speed}
        mbs.AddObject(items.ObjectConnectorCoordinate(markerNumbers=ends, **offsets))
    return elastic_coordinates(mbs, created, MOVED, steps)


def main(arguments: list[str] | None = None) -> None:
    """Design the rod, write it, and let both programs move it."""
    options = parse(arguments, "rod_in_exudyn", elements=(60, 6), iterations=30, boundary=0)
    if find_spec("exudyn") is None:
        raise SystemExit("Exudyn is not installed: pip install exudyn")
    comm, output = options.comm, options.output
    domain = ffr.Domain.rectangle(comm, LENGTH, HEIGHT, elements=options.elements)
    body = ffr.FlexibleBody(domain, PLASTIC, frame=ffr.ChordFrame("left", "right"), modes=3)
    times = ffr.GeneralizedAlpha(DESIGNED, 400)
    problem = ffr.Problem({"rod": body}, one_turn(DESIGNED), times, ffr.IntegralCompliance())
    result = ffr.optimize(problem, ffr.LevelSet(domain), volume=0.6, **options.run)
    verification = result.verify(modes=3)
    verification.export(output / "rod.SID_FEM")
    verification.export(output / "rod.npz", format="exudyn")
    comm.Barrier()
    rod, radau = (
        {"rod": verification.bodies["rod"][1].integrals},
        ffr.RadauIIA(MOVED, steps=10 * ROWS),
    )
    motion = ffr.simulate(one_turn(MOVED), rod, radau)
    ours = motion.elastic("rod")[:: 10 * motion.integrator.stages]
    coarse, fine = (by_exudyn(output / "rod.npz", n * ROWS)[::n] for n in (25, 50))
    theirs = fine + (fine - coarse) / 3.0
    largest = np.max(np.abs(ours))
    difference = np.max(np.abs(theirs - ours)) / largest
    say(f"elastic coordinates up to {1e3 * largest:.3g} mm differ by {difference:.1e} of it")

    # %% Pictures and numbers
    t, histories = np.linspace(0.0, MOVED, ROWS + 1), {"here": ours, "Exudyn": theirs}
    curves = {
        f"coordinate {k + 1}": {n: (t, q[:, k]) for n, q in histories.items()} for k in (0, 3)
    }
    ffr.plotting.plot_curves(curves, output / "coordinates.png", xlabel="time [s]")
    ffr.write_summary(
        comm, output / "summary.json", {"difference": difference, "psi": verification.psi}
    )

    # %% One file, one motion
    assert difference < 1e-6, f"the motions differ by {difference:.1e}"


if __name__ == "__main__":
    run(main)
