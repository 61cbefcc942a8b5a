# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A robot arm with two flexible links: how exact, and how heavy.

What you will see: an arm lifts a payload over an obstacle and puts it down. Its motors turn as a
rigid arm would need it; the real arm sags and swings, and its tip misses the path. Heavier links
miss it less. The picture shows the tip's error over the links' mass, for links of even thickness,
for narrower bars, and for designs that make the best of a given mass.

**Problem.** Find the densities x of the elements of both links that minimise

    psi = int |r_tip - path|^2 dt   such that   mass(upper arm) + mass(forearm) <= bound;

the tip's error is sqrt(psi / T). The optimiser also decides how the mass is shared by the links.
Both motors follow the inverse kinematics of the rigid arm,

    |path|^2 = a^2 + b^2 + 2 a b cos(elbow),     J(angles) angles' = path',
    J angles'' + J' angles' = path'',

the links move by M(y) y'' + ... + C_y^T lambda = 0, C(y, t) = 0 with gravity, and begin in their
static equilibrium.

**Discretisation.** Bilinear quadrilaterals in plane stress, SIMP with exponent 3; tangent frames,
six normal modes each; generalised-alpha. A level set for each link, by the method of moving
asymptotes with the mass as a constraint. All designs end as parts with smooth boundaries, computed
again on meshes that fit them.

Run it with

    python demos/robot_arm.py [--elements NX NY] [--steps N] [--iterations N]
                              [--upper-mesh FILE] [--fore-mesh FILE] [--output DIR]

also under `mpirun -n 2`; it takes about a minute and a half.
"""

# %% Imports
from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from time import perf_counter

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.program import run

# %% Parameters
UPPER, FORE = (0.5, 0.05), (0.4, 0.05)  # length and height of the links [m]
THICKNESS = 0.005  # of a full link [m]
YOUNG, POISSON, DENSITY = 70e9, 0.33, 2700.0  # aluminium [Pa], [-], [kg/m^3]
PAYLOAD, ELBOW_MOTOR = 1.0, 0.5  # [kg]
GRAVITY = 9.81  # [m/s^2]
PICK, PLACE, LIFT = (0.70, -0.20), (-0.15, 0.50), 0.15  # [m]
BEGIN, MOVE, DURATION = 0.05, 0.6, 0.8  # the move begins, takes, all is over [s]
MODES = 6
SHEETS = (0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0)  # shares of the full links' mass
BOUNDS = (0.5, 0.6, 0.75)  # of the designs

Array = NDArray[np.float64]
Densities = dict[str, Array]


# %% The path and the motion of the motors
def path() -> tuple[ffr.Motion, ffr.Motion]:
    """The path of the payload, x and y: from rest to rest, with a lift on the way."""
    progress = ffr.Motion.smooth_step(1.0, MOVE, BEGIN)

    def along(k: int) -> ffr.Motion:
        # p(s) = pick + (place - pick) s + lift 16 s^2 (1 - s)^2
        straight = np.polynomial.Polynomial([PICK[k], PLACE[k] - PICK[k]])
        lift = np.polynomial.Polynomial([0.0, 0.0, 16.0, -32.0, 16.0]) * LIFT * k
        p = straight + lift
        first, second = p.deriv(1), p.deriv(2)

        def value(t: ArrayLike) -> Array:
            return np.asarray(p(progress.tabulate(t)[0]))

        def velocity(t: ArrayLike) -> Array:
            s, ds, _ = progress.tabulate(t)
            return np.asarray(first(s) * ds)

        def acceleration(t: ArrayLike) -> Array:
            s, ds, dds = progress.tabulate(t)
            return np.asarray(second(s) * ds**2 + first(s) * dds)

        return ffr.Motion(value, velocity, acceleration, f"path along {'xy'[k]}")

    return along(0), along(1)


def motors() -> tuple[ffr.Motion, ffr.Motion]:
    """The angles of shoulder and elbow of a rigid arm on the path, elbow up."""
    x, y = path()
    a, b = UPPER[0], FORE[0]

    def angles(t: ArrayLike) -> Array:
        """Value, velocity and acceleration of both angles, shape (2, 3, times)."""
        t = np.atleast_1d(np.asarray(t, dtype=np.float64))
        (px, vx, ax), (py, vy, ay) = x.tabulate(t), y.tabulate(t)
        elbow = -np.arccos((px**2 + py**2 - a**2 - b**2) / (2.0 * a * b))
        shoulder = np.arctan2(py, px) - np.arctan2(b * np.sin(elbow), a + b * np.cos(elbow))
        sa, ca = a * np.sin(shoulder), a * np.cos(shoulder)
        sb, cb = b * np.sin(shoulder + elbow), b * np.cos(shoulder + elbow)
        J = np.moveaxis(np.array([[-sa - sb, -sb], [ca + cb, cb]]), -1, 0)

        def solved(right: Array) -> Array:
            return np.linalg.solve(J, right.T[:, :, None])[:, :, 0].T

        rates = solved(np.array([vx, vy]))
        w, v = rates[0], rates[0] + rates[1]  # of upper arm and forearm
        second = solved(np.array([ax + ca * w**2 + cb * v**2, ay + sa * w**2 + sb * v**2]))
        return np.stack([np.array([shoulder, elbow]), rates, second], axis=1)

    def part(joint: int, derivative: int, t: ArrayLike) -> Array:
        return np.asarray(angles(t)[joint, derivative]).reshape(np.shape(t))

    shoulder, elbow = (
        ffr.Motion(*(partial(part, joint, derivative) for derivative in range(3)), name)
        for joint, name in enumerate(("shoulder", "elbow"))
    )
    return shoulder, elbow


# %% The scene
def links(
    comm: MPI.Comm,
    elements: tuple[int, int] = (160, 16),
    meshes: Mapping[str, str | None] | None = None,
) -> dict[str, ffr.Domain]:
    """The meshes of upper arm and forearm.

    Args:
        comm: Communicator over which the meshes are distributed.
        elements: Of the upper arm, along and across; the forearm's are of the same length.
        meshes: Gmsh files in place of the built-in ``"upper arm"`` and ``"forearm"``, of the same
            length from interface to interface, for which the motors' motions are made.
    """
    along, across = elements
    fore = max(6, round(along * FORE[0] / UPPER[0]))
    domains = {}
    for name, size, own in (("upper arm", UPPER, elements), ("forearm", FORE, (fore, across))):
        file = (meshes or {}).get(name)
        if not file:
            domains[name] = ffr.Domain.rectangle(comm, *size, elements=own)
            continue
        domains[name] = ffr.Domain.from_gmsh(comm, file)
        left, right = (domains[name].interfaces[end].center for end in ("left", "right"))
        if not np.allclose(right - left, [size[0], 0.0], atol=1e-4 * size[0]):
            raise ValueError(
                f"{file}: from 'left' to 'right' it is {right - left} m, and the {name} needs "
                f"{size[0]} m along x"
            )
    return domains


def arm(
    domains: dict[str, ffr.Domain],
    *,
    steps: int = 400,
    share: float = 1.0,
    mass: float | None = None,
) -> ffr.Problem:
    """The arm with its payload.

    Args:
        domains: Meshes of the links by name.
        steps: Number of time steps.
        share: Of the full thickness.
        mass: Upper bound of the links' mass [kg].
    """
    material = ffr.PlaneStress(YOUNG, POISSON, DENSITY, share * THICKNESS)
    bodies = {
        name: ffr.FlexibleBody(
            domain,
            material,
            frame=ffr.TangentFrame("left"),
            modes=MODES,
        )
        for name, domain in domains.items()
    }
    shoulder, elbow = motors()
    first, second = (float(motion.value(0.0)) for motion in (shoulder, elbow))
    joint = (UPPER[0] * math.cos(first), UPPER[0] * math.sin(first))
    mechanism = ffr.Mechanism(
        placements={
            "upper arm": ffr.Placement((0.0, 0.0), first),
            "forearm": ffr.Placement(joint, first + second),
        },
        joints=[
            ffr.Revolute(("upper arm", "left"), ffr.Ground(), name="shoulder"),
            ffr.PrescribedAngle(("upper arm", "left"), shoulder, name="shoulder motor"),
            ffr.Revolute(("forearm", "left"), ("upper arm", "right"), name="elbow"),
            ffr.PrescribedAngle(
                ("forearm", "left"), elbow, ("upper arm", "right"), name="elbow motor"
            ),
        ],
        point_masses=[
            ffr.PointMass(("forearm", "right"), PAYLOAD),
            ffr.PointMass(("upper arm", "right"), ELBOW_MOTOR),
        ],
        gravity=(0.0, -GRAVITY),
        start=ffr.StaticEquilibrium(),
    )
    constraints = []
    if mass is not None:
        total = ffr.Mass("upper arm") + ffr.Mass("forearm")
        constraints = [ffr.Constraint(total, upper=mass, name="mass")]
    return ffr.Problem(
        bodies,
        mechanism,
        ffr.GeneralizedAlpha(DURATION, steps),
        ffr.PathTracking("forearm", "right", path()),
        constraints,
    )


def full(domains: dict[str, ffr.Domain]) -> Densities:
    """Densities of solid links."""
    return {name: np.ones(domain.n_cells) for name, domain in domains.items()}


def bars(domains: dict[str, ffr.Domain], share: float) -> Densities:
    """Densities of narrower bars along the middle of the links, solid at the ends."""
    x = {}
    for name, domain in domains.items():
        low, high = domain.bounding_box
        inside = np.abs(domain.centroids[:, 1]) < 0.5 * share * (high[1] - low[1])
        x[name] = np.where(inside | ~domain.design_cells, 1.0, 0.0)
    return x


def even(design: ffr.LevelSet, share: float) -> Array:
    """Equal coefficients with which a link has a share of its full mass."""
    domain, design = design.domain, design.at(0.0)

    def excess(value: float) -> float:
        x = design.density(design.even(value))
        return domain.sum(x * domain.cell_volumes) / domain.area - share

    return design.even(brentq(excess, 0.0, 1.0))


def error(psi: float) -> float:
    """The root mean square distance of the tip from its path [m]."""
    return math.sqrt(psi / DURATION)


def mass(evaluation: ffr.Evaluation) -> float:
    """The mass of both links [kg]."""
    return sum(part.integrals.mass for part in evaluation.bodies.values())


def tip(evaluation: ffr.Evaluation) -> Array:
    """The distance of the tip from its path over time, shape (steps + 1,) [m]."""
    motion = evaluation.motion
    target = np.column_stack([along.value(motion.t) for along in path()])
    return np.linalg.norm(motion.marker_path("forearm", "right") - target, axis=1)


# %% The program
def main(arguments: list[str] | None = None) -> None:
    """Design the links for several masses, and leave numbers and pictures."""
    options = parse(arguments)
    comm = MPI.COMM_WORLD
    output = Path(options.output)
    begin = perf_counter()
    say = print if comm.rank == 0 else lambda *_: None
    for motion in motors():
        motion.check(0.0, DURATION)

    # %% Links of even thickness, and narrower bars
    meshes = {"upper arm": options.upper_mesh, "forearm": options.fore_mesh}
    domains = links(comm, tuple(options.elements), meshes)
    solid = full(domains)
    problem = arm(domains, steps=options.steps)
    reference = problem.value(solid)
    heavy = mass(reference)
    curves: dict[str, list[tuple[float, float]]] = {"even thickness": [], "narrower bars": []}
    for share in SHEETS:
        found = arm(domains, steps=options.steps, share=share).value(solid)
        curves["even thickness"].append((mass(found), error(found.psi)))
    across = options.elements[1]
    for rows in range(across % 2 or 2, across + 1, 2):
        if rows >= 0.6 * across:
            found = problem.value(bars(domains, rows / across))
            curves["narrower bars"].append((mass(found), error(found.psi)))
    say(f"full links: {heavy:.3f} kg, tip error {1e3 * error(reference.psi):.3f} mm")

    # %% Designs
    results: dict[float, ffr.Result] = {}
    verified: dict[float, ffr.Verification] = {}
    for share in BOUNDS:
        bounded = arm(domains, steps=options.steps, mass=share * heavy)
        designs = {
            name: ffr.LevelSet(domain, minimum_member=0.95 * domain.cell_size)
            for name, domain in domains.items()
        }
        results[share] = ffr.optimize(
            bounded,
            designs,
            {name: even(design, share) for name, design in designs.items()},
            volume=1.0,
            iterations=options.iterations,
            output=output / f"mass_{round(100 * share)}",
        )
        if parts := results[share].finish(output / f"mass_{round(100 * share)}"):
            verified[share] = parts
    curves["designs"] = [
        (mass(result.evaluation), error(result.psi)) for result in results.values()
    ]
    if verified:
        curves["their parts"] = [
            (sum(body.mass for body in part.fitted[-1].bodies.values()), error(part.psi))
            for part in verified.values()
        ]
    thin = {
        share: arm(domains, steps=options.steps, share=mass(result.evaluation) / heavy).value(solid)
        for share, result in results.items()
    }
    for share, result in results.items():
        masses = {k: part.integrals.mass for k, part in result.evaluation.bodies.items()}
        say(
            f"{mass(result.evaluation):.3f} kg ("
            + ", ".join(f"{name} {kilograms:.3f}" for name, kilograms in masses.items())
            + f"): tip error {1e3 * error(result.psi):.3f} mm, even thickness "
            f"{1e3 * error(thin[share].psi):.3f} mm, {result.reason}"
        )
        if share in verified:
            say(verified[share])

    # %% Pictures and numbers
    plotting.plot_curves(
        {
            "tip error [mm]": {
                name: tuple(np.array(points).T * [[1.0], [1e3]]) for name, points in curves.items()
            }
        },
        output / "trade_off.png",
        xlabel="mass of both links [kg]",
        markers=True,
        comm=comm,
    )
    for name, domain in domains.items():
        plotting.plot_design(
            domain,
            {
                f"{name}: {1e3 * result.evaluation.bodies[name].integrals.mass:.0f} g, arm "
                f"{1e3 * mass(result.evaluation):.0f} g": result.densities[name]
                for result in results.values()
            },
            output / f"{name.replace(' ', '_')}.png",
        )
    share = BOUNDS[len(BOUNDS) // 2]
    best = results[share]
    t = reference.motion.t
    shoulder, elbow = (np.degrees(motion.value(t)) for motion in motors())
    plotting.plot_curves(
        {
            "distance of the tip from its path [mm]": {
                f"even thickness, {mass(thin[share]):.2f} kg": (t, 1e3 * tip(thin[share])),
                f"design, {mass(best.evaluation):.2f} kg": (t, 1e3 * tip(best.evaluation)),
                f"full links, {heavy:.2f} kg": (t, 1e3 * tip(reference)),
            },
            "angles of the motors [degrees]": {"shoulder": (t, shoulder), "elbow": (t, elbow)},
        },
        output / "tip.png",
        xlabel="time [s]",
        comm=comm,
    )
    plotting.plot_scene(best.problem, best.evaluation, output / "scene.png", time=0.35)
    plotting.animate_motion(best.problem, best.evaluation, output / "motion.gif")
    ffr.write_summary(
        comm,
        output / "summary.json",
        {
            **{f"mass and error, {name}": points for name, points in curves.items()},
            "error_even": [error(found.psi) for found in thin.values()],
            "designs": {
                f"{share:.2f}": {
                    **result.summary(),
                    **(verified[share].record() if share in verified else {}),
                }
                for share, result in results.items()
            },
            "seconds_total": perf_counter() - begin,
            "ranks": comm.size,
        },
    )
    say(f"pictures and numbers are in {output}")

    # %% What must hold
    for share, result in results.items():
        if options.iterations >= SOME:
            assert mass(result.evaluation) <= share * heavy * (1.0 + 1e-6), "too heavy"
            assert result.psi < result.history["psi"][0], f"{share}: worse than even densities"
        if options.iterations >= ENOUGH and across >= FINE and not any(meshes.values()):
            assert share in verified, f"{share}: no parts come of the designs"
            gain = error(verified[share].psi) / error(thin[share].psi)
            assert gain < BETTER, f"{share}: tip error is {gain:.3f} of that of even links"
            for name in domains:
                assert result.part(name).pieces == 1, f"{share}: {name} has fallen to pieces"


#: Iterations, and elements across, from which on a design counts as finished
SOME, ENOUGH, FINE = 20, 60, 8
#: Tip error of a finished design over that of links of even thickness with the same mass
BETTER = 0.8


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Design the flexible links of a robot arm.")
    parser.add_argument("--elements", nargs=2, type=int, default=[160, 16], metavar=("NX", "NY"))
    parser.add_argument("--steps", type=int, default=400, help="of time (default 400)")
    parser.add_argument("--iterations", type=int, default=60, help="each, at most (default 60)")
    parser.add_argument("--upper-mesh", help="gmsh file with the curves 'left' and 'right'")
    parser.add_argument("--fore-mesh", help="gmsh file with the curves 'left' and 'right'")
    parser.add_argument("--output", default="results/robot_arm", help="folder for the results")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    run(main)
