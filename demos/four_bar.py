# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A four-bar linkage with two flexible links, both designed.

What you will see: a crank shakes a disc to and fro by a coupler and a rocker. Both links are
flexible, each on its own mesh and of its own material, and both find their shape in the same
optimisation. One adjoint pass gives the gradient for both.

The crank turns three times in one second, from rest to rest. The rocker is welded to the shaft of
the disc, so that it bends like a cantilever; the coupler is pushed, pulled, and bent by its own
inertia.

**Problem.** Find the densities x of the coupler and of the rocker that minimise

    psi = int q_c^T K_c q_c dt / psi_c + int q_r^T K_r q_r dt / psi_r
    such that   volume(x_c) <= 0.5,   volume(x_r) <= 0.5,

where q are the elastic coordinates of the links in their floating frames and psi_c, psi_r the
values of the full links, so that full links have psi = 2. The links move by M(y) y'' + ... +
C_y^T lambda = 0, C(y, t) = 0, and each feels the other's mass and deformation through the pin.

**Discretisation.** Bilinear quadrilaterals in plane stress, SIMP with exponent 3; chord frame for
the coupler, tangent frame at the disc for the rocker, six normal modes each; equal time steps by
which psi is known to 1e-3, 100 of the Radau IIA method. A level set for each link, by the method of
moving asymptotes. What is drawn at the end are parts with smooth boundaries, computed again
together on meshes that fit them.

Run it with

    python demos/four_bar.py [--elements NX NY] [--steps N] [--iterations N]
                             [--coupler-mesh FILE] [--rocker-mesh FILE] [--output DIR]

also under `mpirun -n 2`; it takes some minutes. A mesh file has the physical curves
`left` and `right`; the lengths of the links are then those between the centres of these curves.
"""

# %% Imports
from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from time import perf_counter

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.program import run
from dolfinx_ffr.verification import central_difference

# %% Parameters
CRANK, GROUND = 0.1, 0.4  # radius of the crank, distance of its bearing from the disc's [m]
COUPLER, ROCKER = (0.4, 0.04), (0.3, 0.04)  # length and height of the links [m]
ALUMINIUM = ffr.PlaneStress(young=70e9, poisson=0.33, density=2700.0, thickness=0.01)
STEEL = ffr.PlaneStress(young=210e9, poisson=0.3, density=7850.0, thickness=0.006)
DISC, DISC_INERTIA = 1.0, 0.004  # of the driven disc [kg], [kg m^2]
PIN = 0.1  # mass of the pin between coupler and rocker [kg]
TURNS, DURATION = 3, 1.0  # [-], [s]
TOLERANCE = 1e-3  # of psi, by the time steps
MODES = 6
VOLUME = 0.5  # upper bound, share of each link

Array = NDArray[np.float64]
Designs = dict[str, Array]


# %% The scene
def four_bar(
    comm: MPI.Comm,
    elements: tuple[int, int] = (200, 20),
    *,
    steps: int | None = None,
    meshes: Mapping[str, str | None] | None = None,
    objective: ffr.Objective | None = None,
) -> ffr.Problem:
    """The linkage with full or given links.

    Args:
        comm: Communicator over which the meshes are distributed.
        elements: Of the built-in coupler, along and across; the rocker's are of the same length.
        steps: Number of time steps of generalised-alpha; by default method and number are those
            that give psi to `TOLERANCE`.
        meshes: Gmsh files in place of the built-in ``"coupler"`` and ``"rocker"``.
        objective: By default the integral compliance of both links.
    """
    along, across = elements
    counts = {"coupler": along, "rocker": max(6, round(along * ROCKER[0] / COUPLER[0]))}
    domains = {}
    for name, size in (("coupler", COUPLER), ("rocker", ROCKER)):
        file = (meshes or {}).get(name)
        if file:
            domains[name] = ffr.Domain.from_gmsh(comm, file)
        else:
            domains[name] = ffr.Domain.rectangle(comm, *size, elements=(counts[name], across))
    coupler, rocker = (
        float(np.hypot(*(d.interfaces["right"].center - d.interfaces["left"].center)))
        for d in domains.values()
    )
    # the crank starts along x; the pin of coupler and rocker is where two circles meet
    crank_pin, bearing = np.array([CRANK, 0.0]), np.array([GROUND, 0.0])
    gap = bearing - crank_pin
    d = float(np.hypot(*gap))
    foot = (coupler**2 - rocker**2 + d**2) / (2.0 * d)
    up = np.array([-gap[1], gap[0]]) / d
    pin = crank_pin + foot * gap / d + math.sqrt(coupler**2 - foot**2) * up

    crank = ffr.Moving.circle(
        (0.0, 0.0), CRANK, ffr.Motion.smooth_step(2 * np.pi * TURNS, DURATION, name="crank angle")
    )
    mechanism = ffr.Mechanism(
        placements={
            "coupler": ffr.Placement(tuple(crank_pin), angle(pin - crank_pin)),
            "rocker": ffr.Placement(tuple(bearing), angle(pin - bearing)),
            "disc": ffr.Placement(tuple(bearing)),
        },
        joints=[
            ffr.Revolute(("coupler", "left"), crank, name="crank pin"),
            ffr.Revolute(("coupler", "right"), ("rocker", "right"), name="pin"),
            ffr.Weld(("rocker", "left"), ("disc", "hub"), name="shaft"),
            ffr.Revolute(("disc", "hub"), ffr.Ground(tuple(bearing)), name="bearing"),
        ],
        point_masses=[ffr.PointMass(("rocker", "right"), PIN)],
    )
    bodies = {
        "coupler": ffr.FlexibleBody(
            domains["coupler"], ALUMINIUM, frame=ffr.ChordFrame("left", "right"), modes=MODES
        ),
        "rocker": ffr.FlexibleBody(
            domains["rocker"], STEEL, frame=ffr.TangentFrame("left"), modes=MODES
        ),
        "disc": ffr.VolumeIntegrals.rigid(DISC, inertia=DISC_INERTIA, markers={"hub": (0.0, 0.0)}),
    }
    return ffr.Problem(
        bodies,
        mechanism,
        ffr.TimeInterval(DURATION, TOLERANCE)
        if steps is None
        else ffr.GeneralizedAlpha(DURATION, steps),
        objective or ffr.IntegralCompliance(["coupler", "rocker"]),
    )


def angle(vector: Array) -> float:
    """The angle of a vector [rad]."""
    return float(np.arctan2(vector[1], vector[0]))


# %% Check of the gradient
def gradient_errors(problem: ffr.Problem, x: Designs) -> dict[str, float]:
    """How far the slope along a direction is from a central difference, by link, relatively.

    Args:
        problem: The linkage.
        x: Densities by name of the link.
    """
    gradient = problem.gradient(x).gradient  # of both links
    assert gradient is not None
    errors = {}
    for name, body in problem.flexible.items():
        domain, c = body.domain, body.domain.centroids
        wave = np.where(domain.design_cells, np.cos(50.0 * c[:, 0] + 70.0 * c[:, 1]), 0.0)

        def psi(step: Array, name: str = name, wave: Array = wave) -> float:
            return problem.value({**x, name: x[name] + float(step) * wave}).psi

        slope = domain.sum(gradient[name] * wave)
        errors[name] = abs(slope / central_difference(psi, 0.0, 1.0, 2e-3) - 1.0)
    return errors


# %% The program
def main(arguments: list[str] | None = None) -> None:
    """Design both links, and leave numbers and pictures."""
    options = parse(arguments)
    comm = MPI.COMM_WORLD
    output = Path(options.output)
    begin = perf_counter()
    say = print if comm.rank == 0 else lambda *_: None

    # %% Full links, whose compliances are the units of the objective
    settings = {
        "steps": options.steps,
        "meshes": {"coupler": options.coupler_mesh, "rocker": options.rocker_mesh},
    }
    problem = four_bar(comm, tuple(options.elements), **settings)
    domains = {name: body.domain for name, body in problem.flexible.items()}
    names = list(domains)
    full_motion = problem.value({k: np.ones(d.n_cells) for k, d in domains.items()})
    parts = compliances(full_motion)
    say(
        f"coupler of {domains['coupler'].n_cells_global}, rocker of "
        f"{domains['rocker'].n_cells_global} elements, {comm.size} rank(s), "
        f"DOLFINx {version('fenics-dolfinx')}"
    )
    say("full: " + ", ".join(f"{name} {value:.3e} J s" for name, value in parts.items()))
    weights = {name: 1.0 / value for name, value in parts.items()}
    problem.objective = ffr.IntegralCompliance(names, weights)
    even = {k: np.where(d.design_cells, VOLUME, 1.0) for k, d in domains.items()}
    psi = {"full": 2.0, "even": problem.value(even).psi}

    errors = gradient_errors(problem, even)
    for name, error in errors.items():
        say(f"gradient of the {name} is {error:.1e} from a central difference")

    # %% The designs
    slope = problem.gradient(even).gradient
    assert slope is not None
    designs = {
        name: ffr.LevelSet(domain, mirrors=ffr.mirror_lines(domain, slope[name]))
        for name, domain in domains.items()
    }
    result = ffr.optimize(
        problem,
        designs,
        volume=VOLUME,
        iterations=options.iterations,
        output=output,
    )

    # %% The parts
    found = result.finish(output)
    if found:
        psi["parts"] = found.psi
    psi["design"] = result.psi
    volume = result.evaluation.volume
    gray = {k: ffr.gray_fraction(d, result.densities[k]) for k, d in domains.items()}
    relative = {k: v * weights[k] for k, v in compliances(result.evaluation).items()}

    # %% Numbers and pictures
    for name, domain in domains.items():
        ffr.write_density(domain, result.densities[name], output / f"{name}.xdmf")
        plotting.plot_design(
            domain,
            {
                f"{name}: {100 * relative[name]:.0f} % of the full one's compliance with "
                f"{100 * volume[name]:.0f} % of its material": result.densities[name]
            },
            output / f"{name}.png",
        )
    plotting.plot_history(
        result.history, output / "history.png", psi_solid=2.0, volume_bound=VOLUME, comm=comm
    )
    plotting.plot_scene(
        result.problem, result.evaluation, output / "scene.png", time=0.35 * DURATION
    )
    plotting.animate_motion(result.problem, result.evaluation, output / "motion.gif")
    motions = {"full links": full_motion.motion, "designs": result.evaluation.motion}
    plotting.plot_curves(
        {
            "angle of the disc [rad]": {
                k: (m.t, m.rigid("disc")[:, 2]) for k, m in motions.items()
            },
            "force in the crank pin [N]": {
                k: (m.t, np.linalg.norm(m.joint_force("crank pin"), axis=1))
                for k, m in motions.items()
            },
            "strain energy of the coupler [mJ]": {
                k: (m.t, 1e3 * m.strain_energy("coupler")) for k, m in motions.items()
            },
            "strain energy of the rocker [mJ]": {
                k: (m.t, 1e3 * m.strain_energy("rocker")) for k, m in motions.items()
            },
        },
        output / "motion.png",
        xlabel="time [s]",
        comm=comm,
    )
    ffr.write_summary(
        comm,
        output / "summary.json",
        {
            **{f"psi_{name}": value for name, value in psi.items()},
            **{f"compliance_relative_{name}": value for name, value in relative.items()},
            **{f"volume_{name}": value for name, value in volume.items()},
            **{f"gray_{name}": value for name, value in gray.items()},
            **{f"gradient_error_{name}": value for name, value in errors.items()},
            **result.summary(),
            **(found.record() if found else {}),
            "seconds_total": perf_counter() - begin,
            "ranks": comm.size,
        },
    )
    say(f"{result.reason} after {result.iterations} iterations")
    for name, value in psi.items():
        say(f"  {name:8s} psi = {value:6.3f}")
    for name in names:
        say(
            f"  {name}: {relative[name]:.3f} of the full one's compliance, volume "
            f"{volume[name]:.3f}, gray {gray[name]:.3f}"
        )
    if found:
        say(found)
    say(f"pictures and numbers are in {output}")

    # %% What must hold
    for name in names:
        assert volume[name] <= VOLUME * (1.0 + 1e-6), f"{name}: volume {volume[name]}"
        assert errors[name] < 1e-5, f"{name}: the gradient is off by {errors[name]:.1e}"
    if options.iterations >= 20:
        assert psi["design"] < psi["even"], "the designs are worse than even densities"
    finished = options.iterations >= ENOUGH and result.reason != "interrupted"
    if finished and not any(settings["meshes"].values()):
        assert psi["design"] < SHARE * psi["even"], f"psi is {psi['design']:.3f}"
        assert found, "no parts come of the designs"
        assert psi["parts"] < FULL * psi["full"], f"psi of the parts is {psi['parts']:.3f}"
        assert abs(found.difference) < NEAR, f"parts are {found.difference:+.2%} from their designs"
        for name in names:
            assert result.part(name).pieces == 1, f"{name} has fallen to pieces"


#: What a finished design must reach, as a share of psi of even densities and of the full links
ENOUGH, SHARE, FULL = 60, 0.3, 0.8
#: Largest difference of the parts from their designs
NEAR = 0.02


def compliances(evaluation: ffr.Evaluation) -> dict[str, float]:
    """The integral compliance of each flexible link [J s]."""
    integrals = {name: reduced.integrals for name, reduced in evaluation.bodies.items()}
    return {
        name: ffr.IntegralCompliance([name]).value(evaluation.motion, integrals)
        for name in integrals
    }


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Design both links of a four-bar linkage.")
    parser.add_argument("--elements", nargs=2, type=int, default=[200, 20], metavar=("NX", "NY"))
    parser.add_argument(
        "--steps", type=int, help="of generalised-alpha (default: those that 1e-3 of psi takes)"
    )
    parser.add_argument("--iterations", type=int, default=60, help="at most (default 60)")
    parser.add_argument("--coupler-mesh", help="gmsh file with the curves 'left' and 'right'")
    parser.add_argument("--rocker-mesh", help="gmsh file with the curves 'left' and 'right'")
    parser.add_argument("--output", default="results/four_bar", help="folder for the results")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    run(main)
