# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A robot arm with two flexible links: how exact, and how heavy.

What you will see: an arm puts a payload down elsewhere. Its motors turn as a rigid arm would need
it; the real arm sags and swings, and its tip misses the path, less so with heavier links. The
picture shows this error over the mass, of links of even thickness and of a design.

**Problem.** Find the densities x of the elements of both links that minimise

    psi = int |r_tip - path|^2 dt   such that   mass(upper arm) + mass(forearm) <= bound;

the tip's error is sqrt(psi / T). How the mass is shared by the links is left to the optimiser.

Run `python demos/robot_arm.py --help`, also under `mpirun -n 2`; it takes half a minute.
"""

import numpy as np
from command_line import bars, draw, leave, parse, run

import dolfinx_ffr as ffr

# %% Parameters
UPPER, FORE, HEIGHT, THICKNESS = 0.5, 0.4, 0.05, 0.005  # lengths of the links, what both have [m]
ALUMINIUM = 70e9, 0.33, 2700.0  # Young [Pa], Poisson [-], density [kg/m^3]
PAYLOAD, ELBOW_MOTOR, GRAVITY = 1.0, 0.5, 9.81  # [kg], [kg], [m/s^2]
# shoulder and elbow with the tip at (0.70, -0.20) m and at (-0.15, 0.50) m [rad]
PICK, PLACE = (0.273398863930789, -1.2661036727794994), (2.6654302603188533, -1.9217036703859778)
BEGIN, MOVE, DURATION = 0.05, 0.6, 0.8  # the move begins, takes, all is over [s]
SHEETS = 0.3, 0.4, 0.5, 0.6, 0.75, 1.0  # shares of the full links' mass
BOUND, MODES = 0.5, 6  # share of the design, of each link


# %% The motors, and where they take the tip of a rigid arm
travels = zip(PICK, PLACE, strict=True)  # from rest to rest
SHOULDER, ELBOW = (a + ffr.Motion.smooth_step(b - a, MOVE, BEGIN) for a, b in travels)
PATH = tuple(
    lambda t, f=f: UPPER * f(SHOULDER.value(t)) + FORE * f(SHOULDER.value(t) + ELBOW.value(t))
    for f in (np.cos, np.sin)
)


# %% The scene
def mechanism(shoulder: ffr.Motion, elbow: ffr.Motion) -> ffr.Mechanism:
    """The arm with its motors and its payload, at rest under gravity."""
    upper, fore, end = ("upper arm", "left"), ("forearm", "left"), ("upper arm", "right")
    bent = ffr.Placement((UPPER * np.cos(PICK[0]), UPPER * np.sin(PICK[0])), sum(PICK))
    return ffr.Mechanism(
        {"upper arm": ffr.Placement((0.0, 0.0), PICK[0]), "forearm": bent},
        joints=[
            ffr.Revolute(upper, ffr.Ground(), name="shoulder"),
            ffr.PrescribedAngle(upper, shoulder, name="shoulder motor"),
            ffr.Revolute(fore, end, name="elbow"),
            ffr.PrescribedAngle(fore, elbow, end, name="elbow motor"),
        ],
        point_masses=[
            ffr.PointMass(("forearm", "right"), PAYLOAD),
            ffr.PointMass(end, ELBOW_MOTOR),
        ],
        gravity=(0.0, -GRAVITY),
        start=ffr.StaticEquilibrium(),
    )


def arm(domains: dict, steps: int, share: float = 1.0, bounds: tuple = ()) -> ffr.Problem:
    """The arm on its path; its links have a ``share`` of the thickness."""
    alloy, frame = ffr.PlaneStress(*ALUMINIUM, share * THICKNESS), ffr.TangentFrame("left")
    bodies = {n: ffr.FlexibleBody(d, alloy, frame=frame, modes=MODES) for n, d in domains.items()}
    times, error = ffr.GeneralizedAlpha(DURATION, steps), ffr.PathTracking("forearm", "right", PATH)
    return ffr.Problem(bodies, mechanism(SHOULDER, ELBOW), times, error, bounds)


def main(arguments: list[str] | None = None) -> None:
    """Design the links for half of the mass, and leave numbers and pictures."""
    options = parse(arguments, "robot_arm", elements=(160, 16), steps=400, iterations=60)
    links = {"upper arm": (UPPER, HEIGHT), "forearm": (FORE, HEIGHT)}
    output, domains = options.output, bars(options, links)
    solid = {name: np.ones(domain.n_cells) for name, domain in domains.items()}
    sheets = {share: arm(domains, options.steps, share).value(solid) for share in SHEETS}
    full, total = sheets[1.0].psi, ffr.Mass("upper arm") + ffr.Mass("forearm")
    heavy = sum(body.integrals.mass for body in sheets[1.0].bodies.values())
    bound = ffr.Constraint(total, upper=BOUND * heavy, name="mass")
    problem = arm(domains, options.steps, bounds=(bound,))
    designs = {k: ffr.LevelSet(d, minimum_member=0.95 * d.cell_size) for k, d in domains.items()}
    with ffr.recorded_warnings() as warnings:
        result = ffr.optimize(problem, designs, volume=1.0, **options.run)
        finished = result.finish(output)

    # %% Pictures and numbers
    *even, error = (1e3 * np.sqrt(e.psi / DURATION) for e in (*sheets.values(), result))  # [mm]
    curves = {"links of even thickness": ([share * heavy for share in SHEETS], even)}
    curves["design"] = [result.final[1].constraints["mass"].value], [error]
    labels = {"xlabel": "mass of both links [kg]", "markers": True}
    ffr.plotting.plot_curves({"tip error [mm]": curves}, output / "trade_off.png", **labels)
    draw(result, output, time=0.35)
    numbers = {"error_even": even[SHEETS.index(BOUND)], "error_design": error, "curves": curves}
    numbers["most"] = 0.64 * sheets[BOUND].psi
    leave(options, result, "A robot arm", full, finished, warnings, **numbers)


if __name__ == "__main__":
    run(main)
