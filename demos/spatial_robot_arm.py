# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A robot arm in space: both links designed for the path of the payload.

What you will see: an arm turns about a vertical axis, raises its upper arm and stretches its elbow,
all at once, with a payload in its hand. Its motors turn as those of a rigid arm would; the links
sag, bend and twist, and the hand misses the path. Of half of the material, the design misses it
less than bars do.

**Problem.** Find the densities x of both links that minimise

    psi = int |r_hand - path|^2 dt   such that   volume(x_u) <= 0.5,   volume(x_f) <= 0.5;

the error of the hand is sqrt(psi / T). The links move by M(A, q) v' + ... + C_y^T lambda = 0,
C(R, A, q, t) = 0 with gravity, from their static equilibrium; shoulder and elbow are revolute
joints about horizontal axes with prescribed angles, on a column that turns as prescribed.

**Discretisation.** Trilinear hexahedra, SIMP with exponent 3; tangent frames, six constraint and
six normal modes each; generalised-alpha on the group of rotations. A level set for each link out of
an even gray, by the method of moving asymptotes with the exact gradient.

Run it with

    python demos/spatial_robot_arm.py [--elements NX NY NZ] [--steps N] [--iterations N]
                                      [--output DIR]

also under `mpirun -n 2`; it takes some minutes.
"""

# %% Imports
from __future__ import annotations

import argparse
from importlib.metadata import version
from pathlib import Path
from time import perf_counter

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.program import run

# %% Parameters
UPPER, FORE = (0.5, 0.06, 0.04), (0.4, 0.05, 0.035)  # length, width and height of the links [m]
PLASTIC = ffr.Isotropic(young=3e9, poisson=0.35, density=1200.0)
PAYLOAD, ELBOW_MOTOR = 0.3, 0.2  # [kg]
GRAVITY = 9.81  # [m/s^2]
TURN, RAISE, STRETCH = 1.5, 0.9, -1.4  # of the column, the shoulder and the elbow [rad]
ELBOW = 1.8  # angle of the elbow at the start, downwards [rad]
BEGIN, MOVE, DURATION = 0.02, 0.5, 0.6  # the move begins, takes, all is over [s]
VOLUME = 0.5  # bound of the filled share of each link
MODES, STEPS = 6, 600

Array = NDArray[np.float64]


# %% The scene
def angles() -> tuple[ffr.Motion, ffr.Motion, ffr.Motion]:
    """Of the column about z, of the shoulder and the elbow about y, where down is positive."""
    return (
        ffr.Motion.smooth_step(TURN, MOVE, start=BEGIN, name="column"),
        ffr.Motion.smooth_step(-RAISE, MOVE, start=BEGIN, name="shoulder"),
        _shifted(ffr.Motion.smooth_step(STRETCH, MOVE, start=BEGIN), ELBOW),
    )


def _shifted(motion: ffr.Motion, by: float) -> ffr.Motion:
    """A motion that begins at another angle."""
    return ffr.Motion(
        lambda t: by + np.asarray(motion.value(t)),
        motion.velocity,
        motion.acceleration,
        "elbow",
        motion.jumps,
    )


def hand_of_rigid_arm(t: Array) -> Array:
    """Where the hand of a rigid arm is, shape (times, 3) [m]."""
    turn, shoulder, elbow = (np.asarray(motion.value(t)) for motion in angles())
    reach = UPPER[0] * np.cos(shoulder) + FORE[0] * np.cos(shoulder + elbow)
    up = -UPPER[0] * np.sin(shoulder) - FORE[0] * np.sin(shoulder + elbow)
    return np.stack([reach * np.cos(turn), reach * np.sin(turn), up], axis=-1)


def arm(
    comm: MPI.Comm, elements: tuple[int, int, int] = (40, 6, 4), *, steps: int = STEPS
) -> ffr.Problem:
    """The arm.

    Args:
        comm: Communicator over which the meshes are distributed.
        elements: Of each link, along, across and over its height.
        steps: Number of time steps.
    """
    links = {
        name: ffr.FlexibleBody(
            ffr.Domain.box(comm, *size, elements=elements),
            PLASTIC,
            frame=ffr.TangentFrame("left"),
            modes=MODES,
        )
        for name, size in (("upper arm", UPPER), ("forearm", FORE))
    }
    turn, shoulder, elbow = angles()
    still = ffr.Motion.constant(0.0)
    column = ffr.Moving(still, still, turn, z=still, name="column")
    across = (0, 1, 0)
    mechanism = ffr.Mechanism(
        placements={
            "upper arm": ffr.Placement((0, 0, 0)),
            "forearm": ffr.Placement((UPPER[0], 0, 0), rotation=(0, ELBOW, 0)),
        },
        joints=[
            ffr.Revolute(("upper arm", "left"), column, axis=across, name="shoulder"),
            ffr.PrescribedAngle(
                ("upper arm", "left"), shoulder, column, axis=across, name="shoulder motor"
            ),
            ffr.Revolute(("forearm", "left"), ("upper arm", "right"), axis=across, name="elbow"),
            ffr.PrescribedAngle(
                ("forearm", "left"), elbow, ("upper arm", "right"), axis=across, name="elbow motor"
            ),
        ],
        point_masses=[
            ffr.PointMass(("forearm", "right"), PAYLOAD),
            ffr.PointMass(("upper arm", "right"), ELBOW_MOTOR),
        ],
        gravity=(0, 0, -GRAVITY),
        start=ffr.StaticEquilibrium(),
    )
    path = tuple(Along(k) for k in range(3))
    return ffr.Problem(
        links,
        mechanism,
        ffr.GeneralizedAlpha(DURATION, steps),
        ffr.PathTracking("forearm", "right", path),
    )


class Along:
    """A coordinate of the hand of a rigid arm over time."""

    def __init__(self, axis: int) -> None:
        self.axis = axis

    def __call__(self, t: Array) -> Array:
        """The coordinate at times ``t``."""
        return np.asarray(hand_of_rigid_arm(np.asarray(t))[..., self.axis])


def bars(problem: ffr.Problem) -> dict[str, Array]:
    """Bars of half the width, densities of this rank's cells by body."""
    found = {}
    for name, body in problem.flexible.items():
        domain = body.domain
        width = np.ptp(domain.bounding_box, axis=0)[1]
        inside = np.abs(domain.centroids[:, 1]) < 0.5 * VOLUME * width
        found[name] = np.where(domain.design_cells, inside, 1.0).astype(float)
    return found


# %% The program
def main(arguments: list[str] | None = None) -> None:
    """Design both links, and leave numbers and pictures."""
    options = parse(arguments)
    comm = MPI.COMM_WORLD
    output = Path(options.output)
    start_time = perf_counter()
    say = print if comm.rank == 0 else lambda *_: None
    problem = arm(comm, tuple(options.elements), steps=options.steps)
    domains = {name: body.domain for name, body in problem.flexible.items()}
    say(
        f"links of {[d.n_cells_global for d in domains.values()]} elements, {options.steps} steps, "
        f"{comm.size} rank(s), DOLFINx {version('fenics-dolfinx')}"
    )
    full = problem.value({name: np.ones(d.n_cells) for name, d in domains.items()})
    half = problem.value(bars(problem))

    # %% The design
    designs = {name: ffr.LevelSet(domain) for name, domain in domains.items()}
    with ffr.recorded_warnings() as warnings:
        result = ffr.optimize(
            problem, designs, volume=VOLUME, iterations=options.iterations, output=output
        )
        verified = result.finish(output, most=3)

    # %% Numbers and pictures
    error = {
        name: float(np.sqrt(psi / DURATION))
        for name, psi in (("full", full.psi), ("bars", half.psi), ("design", result.psi))
    }
    for name, domain in domains.items():
        place = output / name.replace(" ", "_")
        ffr.write_density(domain, result.densities[name], place / "design.xdmf")
        plotting.plot_design(domain, result.densities[name], place / "design.png", title=name)
    plotting.plot_history(result.history, output / "history.png", psi_unit="m^2 s", comm=comm)
    plotting.plot_scene(result.problem, result.evaluation, output / "scene.png")
    plotting.animate_motion(result.problem, result.evaluation, output / "motion.gif")
    solids = {name: result.solid(name) for name in designs}
    summary = {
        **{f"error_{name}": value for name, value in error.items()},
        **({} if verified is None else verified.record()),
        "solid_mass": {name: solid.mass for name, solid in solids.items()},
        "solid_pieces": {name: solid.pieces for name, solid in solids.items()},
        **ffr.run_record(
            result,
            title="A robot arm in space",
            verification=verified,
            warnings=warnings,
            references={"full links": full.psi, "bars": half.psi},
            volume=VOLUME,
        ),
        "seconds_total": perf_counter() - start_time,
    }
    ffr.write_summary(comm, output / "summary.json", summary)
    ffr.write_report(comm, output)
    say(f"{result.reason} after {result.iterations} iterations; error of the hand (r.m.s.)")
    for name, value in error.items():
        say(f"  {name:7s} {1e3 * value:.3f} mm")
    say(str(verified or "no solids of this design can be moved"))
    say(f"pictures and numbers are in {output}")

    # %% What must hold
    away = np.linalg.norm(
        full.motion.marker_path("forearm", "right") - hand_of_rigid_arm(full.motion.t), axis=1
    )
    assert np.max(away) < 0.05 * FORE[0], "the arm does not go where its motors turn it"
    fine = min(d.n_cells_global for d in domains.values()) >= FINE
    if not fine or options.iterations < ENOUGH or result.reason == "interrupted":
        say("no finished design of the reference scene: its marks are not asserted")
        return
    assert result.feasible, f"bounds are violated: {result.violations}"
    assert all(solid.pieces == 1 for solid in solids.values()), "a link has fallen to pieces"
    assert error["design"] < error["bars"], "bars are better than the design"


#: Iterations and elements of a link from which on a design counts as finished
ENOUGH, FINE = 60, 900


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Design the links of a robot arm in space.")
    parser.add_argument(
        "--elements", nargs=3, type=int, default=[40, 6, 4], metavar=("NX", "NY", "NZ")
    )
    parser.add_argument("--steps", type=int, default=STEPS, help=f"(default {STEPS})")
    parser.add_argument("--iterations", type=int, default=60, help="at most (default 60)")
    parser.add_argument(
        "--output", default="results/spatial_robot_arm", help="folder for the results"
    )
    return parser.parse_args(arguments)


if __name__ == "__main__":
    run(main)
