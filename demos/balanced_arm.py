# SPDX-License-Identifier: MIT
# %% [markdown]
"""# An arm that is balanced by a counterweight, and by a spring: numbers of a machine alone.

What you will see: a motor lifts an arm with a payload and lowers it again. A counterweight takes a
part of its moment away and brings inertia of its own; a spring takes nearly all of it away.

**Problem.** Find the stiffness k of the spring and the mass m of the counterweight that minimise
the root mean square of the motor's moment over the motion. No body has a mesh. It is known that

    k = <u c> / <c c> / (a b), m = 0   with the spring,    c = cos(phi), u = J phi'' + G c
    m = -<u w> / <w w>                 without it,         w = d^2 phi'' - g d c

with the inertia J and the weight's moment G about the pin, the spring without a length of its own
from the height a to the distance b on the arm, the counterweight at the distance d behind the pin,
and mean values <.> over the motion.

Run `python demos/balanced_arm.py --help`, also under `mpirun -n 2`; it takes some seconds.
"""

import numpy as np
from command_line import leave_machine, parse, run, say

import dolfinx_ffr as ffr

# %% Parameters
LENGTH, MASS, PAYLOAD, GRAVITY = 0.6, 2.0, 1.5, 9.81  # [m], [kg], [kg], [m/s^2]
HEIGHT, PLACE, BEHIND = 0.25, 0.3, 0.15  # a, b and d [m]
INERTIA = MASS * LENGTH**2 / 12.0  # of the arm about its centre [kg m^2]
DURATION, STEPS = 2.0, 800  # [s], [-]
ANGLE = ffr.Motion.spline([0.0, 1.0, 2.0], [-0.6, 0.9, -0.6], ends="rest")  # [rad]
MARKERS = {"pin": (-LENGTH / 2, 0.0), "tip": (LENGTH / 2, 0.0)}
MARKERS |= {"spring": (PLACE - LENGTH / 2, 0.0), "back": (-BEHIND - LENGTH / 2, 0.0)}
ARM = ffr.VolumeIntegrals.rigid(MASS, (0.0, 0.0), INERTIA, MARKERS)


# %% The machine, a function of what is to be designed
def machine(counterweight: float, stiffness: float = 0.0) -> ffr.Mechanism:
    """The arm on its motor, with a counterweight and a spring without a length of its own."""
    pin, start = ("arm", "pin"), float(ANGLE.value(np.zeros(1))[0])
    spring = ffr.SpringDamper(("arm", "spring"), ffr.Ground((0.0, HEIGHT)), stiffness, length=0.0)
    hung = ffr.PointMass(("arm", "back"), counterweight)
    center = 0.5 * LENGTH * np.array([np.cos(start), np.sin(start)])
    return ffr.Mechanism(
        placements={"arm": ffr.Placement(tuple(center), start)},
        joints=[ffr.Revolute(pin, ffr.Ground()), ffr.PrescribedAngle(pin, ANGLE, name="motor")],
        point_masses=[ffr.PointMass(("arm", "tip"), PAYLOAD), hung],
        gravity=(0.0, -GRAVITY),
        forces=[spring] if stiffness else [],
    )


# %% The answers by hand
def by_hand() -> dict[str, float]:
    """Stiffness of the spring [N/m], and the counterweight without it [kg]."""
    angle, _, faster = ANGLE.tabulate(np.linspace(0.0, DURATION, 20_001))
    weight = GRAVITY * (0.5 * MASS * LENGTH + PAYLOAD * LENGTH)
    inertia = INERTIA + MASS * LENGTH**2 / 4.0 + PAYLOAD * LENGTH**2
    c = np.cos(angle)
    u, w = inertia * faster + weight * c, BEHIND**2 * faster - GRAVITY * BEHIND * c
    stiffness = float(u @ c / (c @ c)) / (HEIGHT * PLACE)
    return {"stiffness": stiffness, "counterweight": -float(u @ w / (w @ w))}


def main(arguments: list[str] | None = None) -> None:
    """Design both, compare them with the answers by hand, and leave numbers and pictures."""
    options = parse(arguments, "balanced_arm", steps=STEPS, iterations=60)
    output, hand = options.output, by_hand()
    times, moment = ffr.GeneralizedAlpha(DURATION, options.steps), ffr.JointForce("motor")
    hung, stiffness = {"counterweight": (1.0, 1e-3, 20.0, "kg")}, (50.0, 10.0, 500.0, "N/m", "log")
    designs = {"counterweight": ffr.Parameters(**hung)}
    designs["spring"] = ffr.Parameters(**hung, stiffness=stiffness)
    results, runs, curves, table, exact = {}, {}, {}, {}, ffr.MMA(tolerance=1e-9)
    for name, parameters in designs.items():
        problem = ffr.Problem({"arm": ARM}, parameters.mechanism(machine), times, moment)
        run_of = {"optimizer": exact, "iterations": options.iterations, "output": output / name}
        results[name] = result = ffr.optimize(problem, parameters, **run_of)
        runs.setdefault("nothing", problem.at({"counterweight": 1e-3}).value({}))
        runs[name] = result.evaluation
    for name, evaluation in runs.items():
        curves[name] = evaluation.trajectory.t, evaluation.trajectory.joint_force("motor")[:, 0]
        parameters = evaluation.mechanism_parameters
        table[name] = {"rms": evaluation.psi, **(parameters.values if parameters else {})}
        say(f"{name}: {table[name]}")
    panels = {"moment of the motor [N m]": curves}
    ffr.plotting.plot_curves(panels, output / "moment.png", xlabel="time [s]")
    leave_machine(results["spring"], output, "A balanced arm", time=0.5, table=table, by_hand=hand)

    # %% Both are the answers by hand
    for name, value in (("counterweight", "counterweight"), ("spring", "stiffness")):
        error = abs(results[name].parameters[value] / hand[value] - 1.0)
        assert error < 1e-3, f"{value} is off by {error:.2%}"


if __name__ == "__main__":
    run(main)
