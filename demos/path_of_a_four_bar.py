# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A four-bar linkage that leads a tool along a path, and shakes its frame no more than it may.

What you will see: pins, lengths and tool of a linkage are found that follow a given curve at given
instants. With bounds on the forces on its frame the linkage gives way by as little as it must.

**Problem.** Find the lengths of crank, coupler and rocker, the place of the rocker's pin on the
frame, the place of the tool on the coupler, and a spring at the rocker, that minimise

    psi = int |r_tool - path|^2 dt   such that   F_crank, F_rocker, M_motor <= bounds,

the largest forces on the frame and the root mean square of the motor's moment over a turn. No body
has a mesh. The path is that of a linkage which is known, so that psi can be zero without bounds.

Run `python demos/path_of_a_four_bar.py --help`, also under `mpirun -n 2`; it takes some seconds.
"""

import math

import numpy as np
from command_line import leave_machine, parse, run, say
from scipy.interpolate import CubicSpline

import dolfinx_ffr as ffr

# %% Parameters
BAR, TOOL, TURN = 1.2, 0.5, 0.5  # mass of the bars [kg/m], of the tool [kg], time of a turn [s]
KNOWN = {"crank": 0.1, "coupler": 0.28, "rocker": 0.24, "pin_x": 0.3, "pin_y": 0.05}  # [m]
KNOWN |= {"tool_x": 0.16, "tool_y": 0.12}  # on the coupler, from the crank's pin [m]
START = dict(zip(KNOWN, (0.085, 0.3, 0.26, 0.33, 0.02, 0.13, 0.09), strict=True))
ranges = {name: (value, value - 0.05, value + 0.05, "m") for name, value in START.items()}
PARAMETERS = ffr.Parameters(**ranges, stiffness=(0.1, 0.05, 20.0, "N m/rad", "log"))
BOUNDS = {"crank's bearing": 26.0, "rocker's bearing": 14.0, "motor": 0.5}  # [N], [N], [N m]


# %% The machine, a function of what is to be designed
def bar(length: float, **markers: tuple[float, float]) -> ffr.VolumeIntegrals:
    """A bar from its left to its right end, along x."""
    m, ends = BAR * length, {"left": (0.0, 0.0), "right": (length, 0.0)}
    return ffr.VolumeIntegrals.rigid(m, (0.5 * length, 0.0), m * length**2 / 12.0, ends | markers)


def machine(
    crank: float, coupler: float, rocker: float, pin_x: float, pin_y: float,
    tool_x: float, tool_y: float, stiffness: float = 0.1,
) -> tuple[ffr.Mechanism, dict[str, ffr.VolumeIntegrals]]:  # fmt: skip
    """The linkage with its crank along x, turned by a motor."""
    gap = np.array([pin_x - crank, pin_y])  # from the pin of the crank to that of the rocker
    d = float(np.hypot(*gap))
    along = (coupler**2 - rocker**2 + d**2) / (2.0 * d)
    across = math.sqrt(coupler**2 - along**2)  # a ValueError where the linkage does not close
    knee = along * gap / d + across * np.array([-gap[1], gap[0]]) / d
    lean = math.atan2(*(knee - gap)[::-1])
    turn = ffr.Motion.polynomial([0.0, 2.0 * np.pi / TURN])
    mechanism = ffr.Mechanism(
        placements={
            "crank": ffr.Placement(angular_velocity=2.0 * np.pi / TURN),
            "coupler": ffr.Placement((crank, 0.0), math.atan2(knee[1], knee[0])),
            "rocker": ffr.Placement((pin_x, pin_y), lean),
        },
        joints=[
            ffr.Revolute(("crank", "left"), ffr.Ground(), name="crank's bearing"),
            ffr.PrescribedAngle(("crank", "left"), turn, name="motor"),
            ffr.Revolute(("coupler", "left"), ("crank", "right"), name="pin"),
            ffr.Revolute(("rocker", "right"), ("coupler", "right"), name="knee"),
            ffr.Revolute(("rocker", "left"), ffr.Ground((pin_x, pin_y)), name="rocker's bearing"),
        ],
        point_masses=[ffr.PointMass(("coupler", "tool"), TOOL)],
        forces=[ffr.TorsionalSpringDamper(("rocker", "left"), ffr.Ground(), stiffness, angle=1.9)],
    )
    coupled = bar(coupler, tool=(tool_x, tool_y))
    return mechanism, {"crank": bar(crank), "coupler": coupled, "rocker": bar(rocker)}


def main(arguments: list[str] | None = None) -> None:
    """Design the linkage without and with bounds, and leave numbers and pictures."""
    options = parse(arguments, "path_of_a_four_bar", steps=300, iterations=80)
    output, times = options.output, ffr.GeneralizedAlpha(TURN, options.steps)
    reference = ffr.simulate(*machine(**KNOWN), times)
    line = CubicSpline(reference.t, reference.marker_path("coupler", "tool"))
    path = tuple(lambda t, k=k: line(t)[:, k] for k in range(2))
    error, force = ffr.PathTracking("coupler", "tool", path), ffr.JointForce
    forces = {n: force(n, peak=True, power=8.0) for n in BOUNDS} | {"motor": force("motor")}
    limits = [ffr.Constraint(forces[n], upper=largest, name=n) for n, largest in BOUNDS.items()]
    results, curves = {}, {"asked for": tuple(1e3 * line(reference.t).T)}
    for name, constraints in (("free", ()), ("bounded", limits)):
        problem = ffr.Problem({}, PARAMETERS.mechanism(machine), times, error, constraints)
        designed = ffr.optimize(
            problem, PARAMETERS, iterations=options.iterations, output=output / name
        )
        tool = designed.evaluation.trajectory.marker_path("coupler", "tool")
        results[name], curves[name] = designed, tuple(1e3 * tool.T)
    off = {
        name: 1e3 * float(np.sqrt(evaluation.psi / TURN)) for name, evaluation in results.items()
    }
    best, panels = results["bounded"], {"path of the tool, y [mm]": curves}
    reached = {c.name: best.evaluation.constraints[c.name].value for c in limits}
    say(f"off the path [mm]: {off}", f"forces [N, N, N m]: {reached}", best.parameters, sep="\n")
    ffr.plotting.plot_curves(panels, output / "path.png", xlabel="x [mm]")
    leave_machine(best, output, "The path of a four-bar linkage", time=0.1, off_path=off)

    # %% The bounds hold, and without them the path is found
    assert best.feasible and off["free"] < 2.0, (reached, off)


if __name__ == "__main__":
    run(main)
