# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A robot arm whose links, motions and counterweight are designed together.

What you will see: an arm with two flexible links puts a payload down. When its motors stand still,
the payload still swings about its place. Better links swing less, and so does a better motion; both
know of each other only if they are designed by one gradient. The arm is that of `robot_arm.py`.

**Problem.** Find the heights of both links at three places, the angles of both motors at four
instants on their way, and the mass of a counterweight behind the elbow that minimise

    psi = 1/T int |r_tip - place|^2 + tau^2 |v_tip|^2 dt      after the stop, such that
    mass(links) + mass(counterweight) <= bound;

start, end and time of the motion are given. The table has sqrt(psi) of designs of equal mass: links
alone, motion and counterweight alone, one after the other, and all together.

Run `python demos/arm_and_motion.py --help`, also under `mpirun -n 2`; it takes some minutes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
from command_line import leave_machine, parse, say
from robot_arm import ALUMINIUM, FORE, PICK, PLACE, THICKNESS, UPPER, mechanism

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.program import run

# %% Parameters
HEIGHT, BEHIND = 0.03, 0.1  # of the links, from the elbow to the counterweight [m]
TIP = tuple(UPPER * f(PLACE[0]) + FORE * f(sum(PLACE)) for f in (np.cos, np.sin))  # at the end [m]
MOVE, DURATION, TAU = 0.4, 0.6, 5e-3  # the motion takes, all is over, tau [s]
KNOTS = np.linspace(0.0, MOVE, 6)  # instants of the splines [s]
LINKS = {"upper arm": UPPER, "forearm": FORE}

# %% What is designed of the machine
angles = {f"{joint}_{k}": (0.0, -0.2, 0.2, "rad") for joint in "ab" for k in range(1, 5)}
PARAMETERS = ffr.Parameters(counterweight=(2e-3, 1e-3, 0.3, "kg"), **angles)


def machine(counterweight: float, **bends: float) -> tuple[ffr.Mechanism, dict[str, Any]]:
    """The arm: motors that take a detour, and a weight behind the elbow."""
    motors = []
    for joint, start, end in zip("ab", PICK, PLACE, strict=True):
        detour = [0.0, *(bends[f"{joint}_{k}"] for k in range(1, 5)), 0.0]
        step = ffr.Motion.smooth_step(end - start, MOVE)
        motors.append(start + step + ffr.Motion.spline(KNOTS, detour, ends="rest"))
    arm, hung = mechanism(*motors), ffr.Weld(("weight", "hub"), ("forearm", "left"), angle=0.0)
    places = {**arm.placements, "weight": arm.placements["forearm"]}
    center, inertia, hub = (-BEHIND, 0.0), 1e-3 * counterweight, {"hub": (0.0, 0.0)}  # [kg m^2]
    weight = ffr.VolumeIntegrals.rigid(counterweight, center, inertia, hub)
    return replace(arm, placements=places, joints=[*arm.joints, hung]), {"weight": weight}


def link(length: float, size: float) -> ffr.DimensionDesign:
    """A link of three heights, straight between them."""

    def shape(h: Any) -> dict[str, Any]:
        x, half = np.array([0.0, 0.5, 1.0]) * length, 0.5 * np.array(list(h.values()))
        lower, upper = np.column_stack([x, -half]), np.column_stack([x, half])[::-1]
        ends = {"left": lambda p: p[0] < 1e-9, "right": lambda p: p[0] > length - 1e-9}
        sides = [lower, [lower[-1], upper[0]], upper, [upper[-1], lower[0]]]
        return {"outline": [sides], "interfaces": ends}

    start = {"left": HEIGHT, "mid": 1.1 * HEIGHT, "right": 0.8 * HEIGHT}
    bounds = dict.fromkeys(start, (0.4 * HEIGHT, 2.5 * HEIGHT))
    return ffr.DimensionDesign(shape, bounds, size=size, start=start, order=2)


def integrals(evaluation: ffr.Evaluation) -> dict[str, ffr.VolumeIntegrals]:
    """The links of an evaluation as bodies that stay as they are."""
    return {name: body.integrals for name, body in evaluation.bodies.items()}


# %% The program
def main(arguments: list[str] | None = None) -> None:
    """Design the arm in four ways, and leave a table and pictures."""
    options = parse(arguments, "arm_and_motion", size=0.015, steps=240, iterations=50)
    output, alloy = options.output, ffr.PlaneStress(*ALUMINIUM, THICKNESS)
    designs = {name: link(length, options.size) for name, length in LINKS.items()}
    error = ffr.objective.ResidualVibration("forearm", "right", (MOVE, DURATION), TAU, TIP)
    times, frame = ffr.GeneralizedAlpha(DURATION, options.steps), ffr.TangentFrame("left")
    moved, masses = PARAMETERS.mechanism(machine), [ffr.Mass(n) for n in (*LINKS, "weight")]
    bodies = {
        name: ffr.FlexibleBody(d.domain(MPI.COMM_WORLD), alloy, frame=frame, modes=4)
        for name, d in designs.items()
    }
    full = {name: np.ones(body.domain.n_cells) for name, body in bodies.items()}
    start = ffr.Problem(bodies, moved, times, error).value(full)
    mass = sum(body.mass for body in integrals(start).values()) + 2e-3  # of all designs
    bound = ffr.Constraint(masses[0] + masses[1] + masses[2], upper=mass, name="mass")

    def designed(bodies: dict[str, Any], design: Any, **more: Any) -> ffr.Result:
        problem = ffr.Problem(bodies, moved, times, error, [bound])
        same = {"iterations": options.iterations, "mode_tolerance": None}
        return ffr.optimize(problem, design, **same, **more)

    found: dict[str, Any] = {"start": start}
    with ffr.recorded_warnings() as warnings:
        found["links"] = designed(bodies, designs)
        found["motion"] = designed(integrals(start), PARAMETERS)
        found["motion after links"] = designed(integrals(found["links"].evaluation), PARAMETERS)
        best = designed(bodies, {**designs, "machine": PARAMETERS}, output=output)
        found["together"] = best
    table = {name: 1e3 * float(np.sqrt(each.psi)) for name, each in found.items()}
    say(", ".join(f"{name}: {value:.4f} mm" for name, value in table.items()))

    # %% Pictures and numbers
    swing = {}
    for name, each in found.items():
        moves = getattr(each, "evaluation", each).trajectory
        off = np.linalg.norm(moves.marker_path("forearm", "right") - np.array(TIP), axis=1)
        swing[name] = moves.t[moves.t >= MOVE], 1e3 * off[moves.t >= MOVE]
    panels = {"distance of the tip from its place [mm]": swing}
    plotting.plot_curves(panels, output / "swing.png", xlabel="time [s]")
    told: dict[str, Any] = {"warnings": warnings, "error": table}
    leave_machine(best, output, "An arm and its motion", time=0.2, **told)

    # %% Together they miss less than one after the other
    others = ("motion after links", "motion") if options.complete else ("start",)
    least = min(table[name] for name in others)
    assert table["together"] < least, table


if __name__ == "__main__":
    run(main)
