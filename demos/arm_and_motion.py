# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A robot arm whose links, motions and counterweight are designed together.

What you will see: the arm of `robot_arm.py` puts its payload down, which swings about its place
when the motors stand still. Links and motion know of each other if they have one gradient.

**Problem.** Find the heights of both links at three places, the angles of both motors at four
instants on their way, and the mass of a counterweight behind the elbow that minimise

    psi = 1/T int |r_tip - place|^2 + tau^2 |v_tip|^2 dt      after the stop, such that
    mass(links) + mass(counterweight) <= bound;

the table has sqrt(psi) of either alone, of one after the other, and of all together.

Run `python demos/arm_and_motion.py --help`, also under `mpirun -n 2`; it takes some minutes.
"""

from dataclasses import replace

import numpy as np
from command_line import leave_machine, parse, run, say
from robot_arm import ALUMINIUM, FORE, PICK, PLACE, THICKNESS, UPPER, mechanism

import dolfinx_ffr as ffr

# %% Parameters
START, RANGE = {"left": 0.03, "mid": 0.033, "right": 0.024}, (0.012, 0.075)  # heights [m]
TIP = tuple(UPPER * f(PLACE[0]) + FORE * f(sum(PLACE)) for f in (np.cos, np.sin))  # at the end [m]
MOVE, DURATION, TAU = 0.4, 0.6, 5e-3  # the motion takes, all is over, tau [s]
LINKS, BEHIND = {"upper arm": UPPER, "forearm": FORE}, 0.1  # of the weight behind the elbow [m]
angles = {f"{joint}_{k}": (0.0, -0.2, 0.2, "rad") for joint in "ab" for k in range(1, 5)}
PARAMETERS = ffr.Parameters(mass=(2e-3, 1e-3, 0.3, "kg"), **angles)


def machine(mass: float, **bends: float) -> tuple[ffr.Mechanism, dict]:
    """The arm: motors that take a detour, and a weight behind the elbow."""
    motors = []
    for joint, start, end in zip("ab", PICK, PLACE, strict=True):
        along = [0.0, *(bends[f"{joint}_{k}"] for k in range(1, 5)), 0.0]
        detour = ffr.Motion.spline(np.linspace(0.0, MOVE, 6), along, ends="rest")
        motors.append(start + ffr.Motion.smooth_step(end - start, MOVE) + detour)
    arm, hung = mechanism(*motors), ffr.Weld(("weight", "hub"), ("forearm", "left"), angle=0.0)
    places = {**arm.placements, "weight": arm.placements["forearm"]}
    weight = ffr.VolumeIntegrals.rigid(mass, (-BEHIND, 0.0), 1e-3 * mass, {"hub": (0.0, 0.0)})
    return replace(arm, placements=places, joints=[*arm.joints, hung]), {"weight": weight}


def link(length: float, size: float) -> ffr.DimensionDesign:
    """A link of three heights, with arcs between them."""
    ends = {"left": lambda p: p[0] < 1e-9, "right": lambda p: p[0] > length - 1e-9}

    def shape(h: dict) -> dict:
        x, y = np.array([0.0, 0.5, 1.0]) * length, 0.5 * np.array(list(h.values()))
        low, top = np.column_stack([x, -y]), np.column_stack([x, y])[::-1]
        return {"outline": [[low, [low[-1], top[0]], top, [top[-1], low[0]]]], "interfaces": ends}

    sized = {"size": size, "start": START, "order": 2}
    return ffr.DimensionDesign(shape, dict.fromkeys(START, RANGE), **sized)


def main(arguments: list[str] | None = None) -> None:
    """Design the arm in four ways, and leave a table and pictures."""
    options = parse(arguments, "arm_and_motion", size=0.015, steps=240, iterations=50)
    output, comm, alloy = options.output, options.comm, ffr.PlaneStress(*ALUMINIUM, THICKNESS)
    designs = {name: link(length, options.size) for name, length in LINKS.items()}
    reduced = {"frame": ffr.TangentFrame("left"), "modes": 4}
    bodies = {k: ffr.FlexibleBody(d.domain(comm), alloy, **reduced) for k, d in designs.items()}
    fixed = {n: b.reduce(np.ones(b.domain.n_cells)).integrals for n, b in bodies.items()}
    error = ffr.objective.ResidualVibration("forearm", "right", (MOVE, DURATION), TAU, TIP)
    times = ffr.GeneralizedAlpha(DURATION, options.steps)
    machine_terms = PARAMETERS.mechanism(machine), times, error
    total = ffr.Mass("upper arm") + ffr.Mass("forearm") + ffr.Mass("weight")
    mass_of_all = sum(body.mass for body in fixed.values()) + 2e-3  # of all designs [kg]

    def designed(
        bodies: dict,
        design: object,
        moves: ffr.Mechanism = machine_terms[0],
        **options_of_run: object,
    ) -> ffr.Result:
        bound = ffr.Constraint(total, upper=mass_of_all, name="mass")
        problem = ffr.Problem(bodies, moves, *machine_terms[1:], [bound])
        options_of_run |= {"iterations": options.iterations, "mode_tolerance": None}
        return ffr.optimize(problem, design, **options_of_run)

    with ffr.recorded_warnings() as warnings:
        straight, weight = machine(**PARAMETERS.values)  # without parameters
        links = designed({**bodies, **weight}, designs, straight)
        motion = designed(fixed, PARAMETERS)
        designed_links = {n: b.integrals for n, b in links.evaluation.bodies.items()}
        motion_later = designed(designed_links, PARAMETERS)
        best = designed(bodies, {**designs, "machine": PARAMETERS}, output=output)

    # %% Pictures and numbers
    results = {"links": links, "motion": motion, "motion after links": motion_later}
    results["together"] = best
    evaluations = {"start": ffr.Problem(fixed, *machine_terms).value({})}
    evaluations |= {name: result.evaluation for name, result in results.items()}
    table, swing = {}, {}
    for name, evaluation in evaluations.items():
        table[name] = 1e3 * float(np.sqrt(evaluation.psi))
        moves = evaluation.trajectory
        off = np.linalg.norm(moves.marker_path("forearm", "right") - np.array(TIP), axis=1)
        swing[name] = moves.t[moves.t >= MOVE], 1e3 * off[moves.t >= MOVE]
    say(", ".join(f"{name}: {value:.4f} mm" for name, value in table.items()))
    panel = {"tip off its place [mm]": swing}
    ffr.plotting.plot_curves(panel, output / "swing.png", xlabel="time [s]")
    leave_machine(best, output, "An arm and its motion", time=0.2, warnings=warnings, error=table)

    # %% Together they miss less than one after the other
    compared = ("motion after links", "motion") if options.complete else ("start",)
    assert table["together"] < min(table[name] for name in compared), table


if __name__ == "__main__":
    run(main)
