# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A flexible pendulum: floating frame of reference beside full nonlinear finite elements.

What you will see: a soft bar, hinged at one end, falls from the horizontal. Both models have the
same mesh and the same time step; the floating frame moves a few shape functions, the full model
all nodes, with St Venant-Kirchhoff elasticity (linear in Green's strain, large rotations exact).
The difference and the time of both, over the number of shape functions.

**Problem.** Find u(X, t) such that for all v

    int rho u'' . v dX + int (F S) : grad v dX = int rho g . v dX,   F = I + grad u,
    S = lambda tr(E) I + 2 mu E,   E = (F^T F - I)/2,

the left end rigid and hinged in its middle: u = (R(theta) - I) (X - X_0) there, theta free. (The
floating frame takes the free end for rigid too, which hardly matters.)

**Discretisation.** Biquadratic quadrilaterals in plane stress, generalised-alpha with the same
step and spectral radius. Full model: Newton's method on nodes and theta. Floating frame:
constraint modes and normal modes of the same mesh, chord frame, without and with geometric
stiffening.

Run it with

    python demos/pendulum.py [--elements NX NY] [--steps N] [--mesh FILE] [--output DIR]

also under `mpirun -n 2` (the full model then runs on every rank alike); it takes half a minute.
"""

# %% Imports
from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter

from mpi4py import MPI

import dolfinx.fem.petsc  # noqa: F401  (a release may not load it by itself)
import numpy as np
import scipy.sparse
import scipy.sparse.linalg
import ufl
from dolfinx import fem
from numpy.typing import NDArray

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.program import run

# %% Parameters
LENGTH, HEIGHT, THICKNESS = 1.0, 0.05, 0.05  # [m]
RUBBER = ffr.PlaneStress(young=20e6, poisson=0.3, density=1000.0, thickness=THICKNESS)
GRAVITY = 9.81  # [m/s^2]
DURATION = 1.0  # [s]
MODES = (1, 2, 4, 8)  # besides the three constraint modes

Array = NDArray[np.float64]


# %% The body
def pendulum(
    comm: MPI.Comm, elements: tuple[int, int] = (30, 2), file: str | None = None
) -> ffr.Domain:
    """A bar along x with rigid end faces.

    Args:
        comm: Communicator over which the mesh is distributed.
        elements: Along and across.
        file: Gmsh file with the physical curves 'left' (hinge) and 'right' instead.
    """
    if file:
        return ffr.Domain.from_gmsh(comm, file, order=2)
    return ffr.Domain.rectangle(comm, LENGTH, HEIGHT, elements=elements, order=2, solid_columns=0)


# %% Floating frame of reference
def floating_frame(
    domain: ffr.Domain,
    modes: int,
    steps: int,
    *,
    stiffening: bool,
    material: ffr.PlaneStress = RUBBER,
) -> tuple[ffr.Problem, ffr.Evaluation, float]:
    """Problem, motion, and the time that the motion took, reduction included [s].

    Args:
        domain: The bar.
        modes: Number of normal modes.
        steps: Number of time steps.
        stiffening: Model geometric stiffening by the bar's own inertia and weight.
        material: Of the bar.
    """
    hinge, tip = (domain.interfaces[name].center for name in ("left", "right"))
    bar = ffr.FlexibleBody(
        domain,
        material,
        frame=ffr.ChordFrame("left", "right"),
        modes=modes,
        markers={"middle": 0.5 * (hinge + tip)},
        stiffening=["omega2", "alpha", "acceleration"] if stiffening else [],
    )
    mechanism = ffr.Mechanism(
        placements={"bar": ffr.Placement(tuple(hinge), np.arctan2(*(tip - hinge)[::-1]))},
        joints=[ffr.Revolute(("bar", "left"), ffr.Ground(tuple(hinge)), name="hinge")],
        gravity=(0.0, -GRAVITY),
    )
    integrator = ffr.GeneralizedAlpha(DURATION, steps)
    problem = ffr.Problem({"bar": bar}, mechanism, integrator, ffr.IntegralCompliance())
    begin = perf_counter()
    evaluation = problem.value(np.ones(domain.n_cells))
    return problem, evaluation, perf_counter() - begin


# %% Full nonlinear finite elements
def full_model(
    steps: int,
    elements: tuple[int, int] = (30, 2),
    file: str | None = None,
    *,
    material: ffr.PlaneStress = RUBBER,
) -> tuple[Array, Array, float]:
    """The paths of tip and middle, and the time that they took [s].

    Args:
        steps: Number of time steps.
        elements: Along and across.
        file: Gmsh file instead.
        material: Of the bar.

    Returns:
        Positions of the tip and of the node next to the middle, shape (steps + 1, 2) [m] each, and
        the time.
    """
    domain = pendulum(MPI.COMM_SELF, elements, file)
    space = domain.space
    u, v = fem.Function(space), ufl.TestFunction(space)
    lame, shear = (value * THICKNESS for value in material.lame)
    deformation = ufl.Identity(2) + ufl.grad(u)
    strain = 0.5 * (deformation.T * deformation - ufl.Identity(2))
    stress = lame * ufl.tr(strain) * ufl.Identity(2) + 2.0 * shear * strain
    dx = ufl.Measure("dx", domain=domain.mesh, metadata={"quadrature_degree": 6})
    internal = ufl.inner(deformation * stress, ufl.grad(v)) * dx
    force_form = fem.form(internal)
    tangent_form = fem.form(ufl.derivative(internal, u))
    density = material.density * THICKNESS
    mass_form = fem.form(density * ufl.inner(ufl.TrialFunction(space), v) * dx)

    def matrix(form: fem.Form) -> scipy.sparse.csr_matrix:
        assembled = fem.petsc.assemble_matrix(form)
        assembled.assemble()
        indptr, indices, values = assembled.getValuesCSR()
        assembled.destroy()
        return scipy.sparse.csr_matrix((values, indices, indptr))

    def vector(form: fem.Form) -> Array:
        assembled = fem.petsc.assemble_vector(form)
        values = np.array(assembled.array)
        assembled.destroy()
        return values

    begin = perf_counter()
    mass = matrix(mass_form)
    n = mass.shape[0]
    weight = mass @ np.tile([0.0, -GRAVITY], n // 2)
    x = space.tabulate_dof_coordinates()[:, :2]
    held = domain.interfaces["left"].dofs
    rows = np.column_stack([2 * held, 2 * held + 1])
    arm = x[held] - domain.interfaces["left"].center
    free = np.setdiff1d(np.arange(n), rows.ravel())
    keep = scipy.sparse.csr_matrix(
        (np.ones(len(free)), (free, np.arange(len(free)))), shape=(n, len(free))
    )

    def turned(angle: float) -> Array:
        """The held nodes' positions after a rotation."""
        c, s = np.cos(angle), np.sin(angle)
        return arm @ np.array([[c, s], [-s, c]])

    def motions(angle: float) -> scipy.sparse.csr_matrix:
        """The derivative of all displacements by those of free nodes and the angle."""
        column = np.zeros((n, 1))
        column[rows, 0] = turned(angle + 0.5 * np.pi)
        return scipy.sparse.hstack([keep, scipy.sparse.csr_matrix(column)]).tocsc()

    end, tip = domain.interfaces["right"].dofs, domain.interfaces["right"].center
    half = 0.5 * (domain.interfaces["left"].center + tip)
    center = int(np.argmin(np.linalg.norm(x - half, axis=1)))
    h = DURATION / steps
    alpha_m, alpha_f, gamma, beta = ffr.GeneralizedAlpha(DURATION, steps).parameters
    angle, now, rate = 0.0, np.zeros(n), np.zeros(n)
    T = motions(angle)
    acceleration = T @ scipy.sparse.linalg.spsolve((T.T @ mass @ T).tocsc(), T.T @ weight)
    path, middle = np.empty((steps + 1, 2)), np.empty((steps + 1, 2))
    path[0], middle[0] = tip, x[center]
    before = -weight  # internal less external forces at the beginning of the step
    for step in range(steps):
        guess = now + h * rate + 0.5 * h**2 * acceleration
        reached = guess.copy()
        across = np.column_stack([-arm[:, 1], arm[:, 0]]) @ np.array(
            [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
        )
        angle += h * float(np.sum(rate[rows] * across) / np.sum(arm**2))
        predicted = now + h * rate + (0.5 - beta) * h**2 * acceleration
        for _ in range(20):
            reached[rows] = turned(angle) - arm
            u.x.array[:] = reached
            new_acceleration = (reached - predicted) / (beta * h**2)
            forces = vector(force_form) - weight
            residual = mass @ ((1.0 - alpha_m) * new_acceleration + alpha_m * acceleration)
            residual += (1.0 - alpha_f) * forces + alpha_f * before
            T = motions(angle)
            reduced = T.T @ residual
            if np.linalg.norm(reduced) <= 1e-7 * np.linalg.norm(weight):
                break
            K = (1.0 - alpha_f) * matrix(tangent_form) + (1.0 - alpha_m) / (beta * h**2) * mass
            K = (T.T @ K @ T).tolil()
            K[-1, -1] -= np.sum(turned(angle) * residual[rows])
            update = scipy.sparse.linalg.spsolve(K.tocsc(), -reduced)
            reached[free] += update[:-1]
            angle += float(update[-1])
        else:
            raise RuntimeError(f"full model: Newton's method fails at t = {h * (step + 1):.4g} s")
        rate = rate + h * ((1.0 - gamma) * acceleration + gamma * new_acceleration)
        now, acceleration, before = reached.copy(), new_acceleration, forces
        path[step + 1] = tip + now.reshape(-1, 2)[end].mean(axis=0)
        middle[step + 1] = x[center] + now.reshape(-1, 2)[center]
    return path, middle, perf_counter() - begin


# %% The program
def main(arguments: list[str] | None = None) -> None:
    """Let the pendulum fall in both models, and leave numbers and pictures."""
    options = parse(arguments)
    comm = MPI.COMM_WORLD
    output = Path(options.output)
    say = print if comm.rank == 0 else lambda *_: None

    full, _, full_seconds = full_model(options.steps, tuple(options.elements), options.mesh)
    domain = pendulum(comm, tuple(options.elements), options.mesh)
    floating_frame(domain, 1, 100, stiffening=True)  # whatever is compiled once
    differences: dict[bool, list[float]] = {False: [], True: []}
    seconds: dict[bool, list[float]] = {False: [], True: []}
    for stiffening in (False, True):
        for modes in MODES:
            problem, evaluation, took = floating_frame(
                domain, modes, options.steps, stiffening=stiffening
            )
            path = evaluation.trajectory.marker_path("bar", "right")
            differences[stiffening].append(
                float(np.linalg.norm(path - full, axis=1).max()) / LENGTH
            )
            seconds[stiffening].append(comm.bcast(took, root=0))
    marker = evaluation.bodies["bar"].integrals.markers["middle"]
    bending = evaluation.trajectory.elastic("bar") @ marker.displacement.T
    largest = float(np.abs(bending[:, 1]).max()) / LENGTH

    say(f"full model {full_seconds:.1f} s; the middle bends by {100 * largest:.2f} % of the length")
    say("modes   linear: difference, time      with geometric stiffening")
    for place, modes in enumerate(MODES):
        row = [f"{differences[s][place]:10.2e} {seconds[s][place]:8.3f} s" for s in (False, True)]
        say(f"{modes:5d} {row[0]} {row[1]}")

    # %% Pictures
    t = evaluation.trajectory.t
    plotting.plot_curves(
        {
            "height of the tip [m]": {
                "full nonlinear model": (t, full[:, 1]),
                f"floating frame, {MODES[-1]} modes": (t, path[:, 1]),
            },
            "their distance / length": {
                f"{MODES[-1]} modes, with geometric stiffening": (
                    t,
                    np.linalg.norm(path - full, axis=1) / LENGTH,
                )
            },
            "deflection of the middle from the chord / length": {"": (t, bending[:, 1] / LENGTH)},
        },
        output / "tip.png",
        xlabel="time [s]",
        comm=comm,
    )
    plotting.plot_curves(
        {
            "largest distance of the tips / length": {
                "linear": (MODES, differences[False]),
                "with geometric stiffening": (MODES, differences[True]),
            },
            "time [s]": {
                "linear": (MODES, seconds[False]),
                "with geometric stiffening": (MODES, seconds[True]),
                "full nonlinear model": (MODES, [full_seconds] * len(MODES)),
            },
        },
        output / "modes.png",
        xlabel="normal modes",
        logarithmic=True,
        comm=comm,
    )
    plotting.plot_scene(problem, evaluation, output / "scene.png")
    plotting.animate_motion(problem, evaluation, output / "motion.gif")
    ffr.write_summary(
        comm,
        output / "summary.json",
        {
            "modes": list(MODES),
            "difference_linear": differences[False],
            "difference_stiffening": differences[True],
            "seconds_linear": seconds[False],
            "seconds_stiffening": seconds[True],
            "seconds_full": full_seconds,
            "largest_deflection": largest,
        },
    )
    say(f"pictures and numbers are in {output}")

    # %% What must hold
    assert largest < 0.02, "the deformation is not small"
    assert differences[True][-1] < 1e-3, "floating frame and full model part"
    assert differences[True][-1] < 0.2 * differences[False][-1], "stiffening should matter here"
    assert differences[True][-1] < differences[True][0], "modes should help"


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Let a flexible pendulum fall in two models.")
    parser.add_argument("--elements", nargs=2, type=int, default=[30, 2], metavar=("NX", "NY"))
    parser.add_argument("--steps", type=int, default=400, help="of both models (default 400)")
    parser.add_argument("--mesh", help="gmsh file with the physical curves 'left' and 'right'")
    parser.add_argument("--output", default="results/pendulum", help="folder for the results")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    run(main)
