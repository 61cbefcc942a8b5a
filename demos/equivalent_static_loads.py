# SPDX-License-Identifier: MIT
"""Equivalent static loads beside the gradient of the whole motion.

The usual way to design parts of moving machines: simulate the motion once, freeze the loads that
deform the part in it, optimise the part statically under these loads, and repeat with the motion
of the new part until nothing changes. What you will see: where that ends, what it costs, and where
the gradient of the whole simulation ends, on a slider-crank and on a four-bar linkage.

The equivalent static load of an instant is the one whose static response is the displacement in the
motion (W. S. Choi, G. J. Park, Computer Methods in Applied Mechanics and Engineering 191 (2002),
doi:10.1016/S0045-7825(01)00373-5; for flexible multibody systems B. S. Kang, G. J. Park,
J. S. Arora, AIAA Journal 43 (2005), doi:10.2514/1.4294),

    f(t) = K u(t) = K Phi q(t),

with the supports of the floating frame. It holds the inertia forces, the forces of the joints, and
whatever else bends the part. In the static problem it is fixed,

    min over x of  int f . K(x)^-1 f dt = Q : (K0 Phi0)^T K(x)^-1 (K0 Phi0),   Q = int q q^T dt,

which is psi at the design whose motion the loads are of. All instants count, and still there are no
more load cases than shape functions: the loads of all instants are combinations of K0 Phi0.

Its gradient leaves out that the loads change with the design: a lighter part makes smaller inertia
forces. A third way renews the loads in every iteration, and follows the gradient at fixed loads.

Run it with `make demo DEMO=equivalent_static_loads`, or

    python demos/equivalent_static_loads.py [--scene slider_crank|four_bar] [--elements NX NY]
                                            [--iterations N] [--cycles N] [--output DIR]

also under `mpirun -n 2`.
"""

# %% Imports
from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from four_bar import four_bar
from numpy.typing import NDArray
from slider_crank import reference_problem

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.program import run

Array = NDArray[np.float64]

# %% Parameters
VOLUME = 0.5  # upper bound, share of each body
WIDTHS = (9, 8, 12, 7, 6)  # of the columns that are printed
STANDS = 1e-3  # relative change of psi from cycle to cycle that counts as none
JUDGE = 24  # normal modes of each body with which all designs are compared


# %% Scenes
def slider_crank(comm: MPI.Comm, elements: tuple[int, int]) -> ffr.Problem:
    """The rod of the slider-crank."""
    return reference_problem(comm, elements)


def linkage(comm: MPI.Comm, elements: tuple[int, int]) -> ffr.Problem:
    """Coupler and rocker of the four-bar linkage, each counting by the full one's compliance."""
    problem = four_bar(comm, elements)
    full = problem.value({n: np.ones(b.domain.n_cells) for n, b in problem.flexible.items()})
    weights = {}
    for name in problem.flexible:
        of_one = ffr.IntegralCompliance([name])
        weights[name] = 1.0 / of_one.value(full.motion, problem.integrals(full))
    problem.objective = ffr.IntegralCompliance(list(weights), weights)
    return problem


SCENES = {"slider_crank": slider_crank, "four_bar": linkage}


# %% Loads of a motion, frozen
@dataclass(frozen=True, eq=False)
class Loads:
    """Equivalent static loads of one body over a motion."""

    forces: Array  #: K Phi, shape (dofs, shapes), of this rank
    squares: Array  #: Integral of w q q^T over time, with the body's weight w, (shapes, shapes)


def squares(problem: ffr.Problem, evaluation: ffr.Evaluation, name: str) -> Array:
    """The integral of w q q^T over the motion."""
    objective, motion = problem.objective, evaluation.motion
    assert isinstance(objective, ffr.IntegralCompliance)
    q, weights = motion.elastic(name), motion.weights
    if weights is None:  # the trapezoidal rule
        weights = np.gradient(motion.t)
        weights[[0, -1]] = 0.5 * np.diff(motion.t)[[0, -1]]
    return float((objective.weights or {}).get(name, 1.0)) * (q.T * weights) @ q


def frozen(problem: ffr.Problem, evaluation: ffr.Evaluation) -> dict[str, Loads]:
    """The loads of a motion, by name of the body."""
    found = {}
    for name, body in problem.flexible.items():
        reduced = evaluation.bodies[name]
        stiffness = body.factored(reduced).matrices.stiffness
        forces = body.elasticity.apply(stiffness, reduced.basis.shapes)
        found[name] = Loads(forces, squares(problem, evaluation, name))
    return found


# %% The static problem
class StaticProblem:
    """Minimise the static compliance under fixed loads; for `optimize`, as a `Problem` is.

    Args:
        bodies: The bodies, by name.
        loads: Fixed, by name.
    """

    def __init__(self, bodies: Mapping[str, ffr.FlexibleBody], loads: Mapping[str, Loads]) -> None:
        # without normal modes: constraint modes and the factor of the held stiffness are enough
        self.flexible = {name: body.with_modes(0) for name, body in bodies.items()}
        self.loads = dict(loads)
        self.constraints: list[ffr.Constraint] = []
        self.motions: dict[str, Any] = {}
        self.combine = ffr.WeightedSum()

    def with_bodies(self, bodies: Mapping[str, ffr.FlexibleBody]) -> StaticProblem:
        """The same loads on other bodies."""
        return StaticProblem({**self.flexible, **bodies}, self.loads)

    def value(self, x: Any) -> ffr.Evaluation:
        """The compliance at densities, and its gradient, which needs no further solution."""
        given = x if isinstance(x, Mapping) else dict.fromkeys(self.flexible, x)
        psi, gradient, volume, bodies, gaps = 0.0, {}, {}, {}, {}
        for name, body in self.flexible.items():
            domain, elasticity, loads = body.domain, body.elasticity, self.loads[name]
            reduced = bodies[name] = body.reduce(domain.check_density(given[name]))
            # held at all interfaces, and then moved by the constraint modes
            inner = loads.forces.copy()
            inner[body.reduction.held] = 0.0
            modes = reduced.basis.shapes
            work = elasticity.inner(modes, loads.forces)
            response = body.factored(reduced).solve(inner)
            response = response + modes @ np.linalg.solve(reduced.integrals.K, work)
            psi += float(np.sum(loads.squares * elasticity.inner(loads.forces, response)))
            none = np.zeros_like(response)
            gradient[name] = elasticity.density_gradient(
                reduced.density, none, none, response, -(response @ loads.squares)
            )
            volume[name] = domain.sum(reduced.density * domain.cell_volumes) / domain.area
            gaps[name] = float("nan")
        held = {name: np.zeros(0) for name in bodies}
        none_yet = dict.fromkeys(bodies, 0)
        return ffr.Evaluation(psi, gradient, bodies, volume, held, gaps, none_yet, {})

    def differentiate(self, evaluation: ffr.Evaluation) -> ffr.Evaluation:
        """The evaluation, whose gradient is there."""
        return evaluation

    def calibrated(self, evaluation: ffr.Evaluation) -> tuple[StaticProblem, ffr.Evaluation]:
        """Problem and evaluation as they are."""
        return self, evaluation


# %% Loads that are renewed in every iteration
@dataclass(frozen=True)
class FixedLoads(ffr.ExactAdjoint):
    """The gradient at fixed loads: the exact one without what changes the loads."""

    def __call__(
        self, problem: ffr.Problem, evaluation: ffr.Evaluation, distance: Any, iteration: int
    ) -> tuple[ffr.Evaluation, dict[str, ffr.GradientReport]]:
        """See `GradientMethod`."""
        gradient, reports = {}, {}
        for name, body in problem.flexible.items():
            reduced, design = evaluation.bodies[name], body.domain.design_cells
            shapes = reduced.basis.shapes
            none, weighted = np.zeros_like(shapes), shapes @ squares(problem, evaluation, name)
            gradient[name] = body.elasticity.density_gradient(
                reduced.density, none, none, shapes, -weighted
            )
            reports[name] = ffr.GradientReport(body.domain.n_cells_global, 1.0, design)
        return replace(evaluation, gradient=gradient), reports


# %% The three ways
@dataclass(frozen=True, eq=False)
class Way:
    """Where a way has led, and what it took."""

    result: ffr.Result  #: Of the last optimisation, or the best one; its bodies are crisp
    simulations: int
    adjoints: int
    static: int  #: Static analyses
    seconds: float  #: Of the processor
    history: list[float]  #: psi of the designs of all cycles, by simulation


def by_gradient(problem: ffr.Problem, iterations: int, method: ffr.GradientMethod) -> Way:
    """Follow a gradient of the whole motion.

    Args:
        problem: The scene.
        iterations: One value and one gradient each.
        method: `ExactAdjoint`, or `FixedLoads`.
    """
    begin = process_time()
    result = ffr.optimize(
        problem,
        levelsets(problem),
        volume=VOLUME,
        iterations=iterations,
        gradient=method,
        mode_tolerance=None,
    )
    exact = not isinstance(method, FixedLoads)
    return Way(
        result,
        simulations=iterations + 2,
        adjoints=iterations if exact else 0,
        static=0,
        seconds=process_time() - begin,
        history=[result.psi],
    )


def by_static_loads(problem: ffr.Problem, iterations: int, cycles: int) -> Way:
    """Freeze the loads, optimise statically from an even gray, repeat until psi stands.

    Args:
        problem: The scene.
        iterations: Of each static optimisation.
        cycles: At most.
    """
    begin = process_time()
    designs = levelsets(problem)
    even = {name: d.at(0.0).density(d.even()) for name, d in designs.items()}
    evaluation = problem.value(of_problem(even))
    loads, best = frozen(problem, evaluation), None
    history: list[float] = []
    for _ in range(cycles):
        result = ffr.optimize(
            StaticProblem(problem.flexible, loads),  # type: ignore[arg-type]
            designs,
            volume=VOLUME,
            iterations=iterations,
            mode_tolerance=None,
        )
        # its motion, by the law of cut elements of the finished design
        crisp = {
            name: problem.flexible[name].with_interpolation(body.interpolation)
            for name, body in result.problem.flexible.items()
        }
        moving = problem.with_bodies(crisp)
        evaluation = moving.value(of_problem(result.densities))
        loads = frozen(moving, evaluation)
        history.append(evaluation.psi)
        if best is None or evaluation.psi < history[best[0]]:
            best = len(history) - 1, result
        if len(history) > 1 and abs(history[-1] / history[-2] - 1.0) < STANDS:
            break
    assert best is not None
    return Way(
        best[1],
        simulations=1 + len(history),
        adjoints=0,
        static=len(history) * (iterations + 2),
        seconds=process_time() - begin,
        history=history,
    )


def levelsets(problem: ffr.Problem) -> dict[str, ffr.LevelSet]:
    """A level set for each body."""
    return {name: ffr.LevelSet(body.domain) for name, body in problem.flexible.items()}


def of_problem(densities: Mapping[str, Array]) -> Any:
    """By name, or those of the only body."""
    return dict(densities) if len(densities) > 1 else next(iter(densities.values()))


def judged(problem: ffr.Problem, way: Way) -> tuple[ffr.Problem, ffr.Evaluation]:
    """The motion of a design, with more modes than it was designed with, and its problem."""
    result = way.result
    many = with_many_modes(problem, result.problem.flexible)
    return many, many.value(of_problem(result.densities))


def with_many_modes(
    problem: ffr.Problem, bodies: Mapping[str, ffr.FlexibleBody] | None = None
) -> ffr.Problem:
    """The problem by which designs are judged, with the laws of given bodies."""
    bodies = bodies or problem.flexible
    return problem.with_bodies({name: body.with_modes(JUDGE) for name, body in bodies.items()})


def agreement(problem: ffr.Problem, x: Mapping[str, Array]) -> float:
    """Cosine of the angle between the gradient at fixed loads and the exact one."""
    evaluation = problem.value(of_problem(x))
    gradients = [
        method(problem, evaluation, lambda name: None, 0)[0].gradient or {}
        for method in (ffr.ExactAdjoint(), FixedLoads())
    ]
    products = np.zeros(3)
    for name, body in problem.flexible.items():
        a, b = (gradient[name] * body.domain.design_cells for gradient in gradients)
        products += [body.domain.sum(c) for c in (a * b, a * a, b * b)]
    return float(products[0] / np.sqrt(products[1] * products[2]))


#: By name: what leads from a scene, a number of iterations and of cycles to a design
WAYS: dict[str, Callable[[ffr.Problem, int, int], Way]] = {
    "whole motion": lambda scene, iterations, _: by_gradient(scene, iterations, ffr.ExactAdjoint()),
    "static loads, renewed in cycles": by_static_loads,
    "static loads, renewed in iterations": lambda scene, iterations, _: by_gradient(
        scene, iterations, FixedLoads()
    ),
}


# %% The program
def main(arguments: list[str] | None = None) -> None:
    """Design in three ways, and compare."""
    options = parse(arguments)
    comm, output = MPI.COMM_WORLD, Path(options.output)
    say = print if comm.rank == 0 else lambda *_: None
    problem = SCENES[options.scene](comm, tuple(options.elements))
    full = full_psi(problem)
    even = {n: np.where(b.domain.design_cells, VOLUME, 1.0) for n, b in bodies(problem)}

    # %% The static problem is psi at the design whose loads it has
    there = problem.value(of_problem(even))
    static = StaticProblem(problem.flexible, frozen(problem, there)).value(of_problem(even))
    say(f"static compliance under its own loads over psi - 1: {static.psi / there.psi - 1.0:.1e}")
    cosine = agreement(problem, even)
    say(f"cosine of the gradients at fixed loads and of the motion, even gray: {cosine:.4f}")

    # %% Three designs
    ways = {name: way(problem, options.iterations, options.cycles) for name, way in WAYS.items()}
    psi = {name: judged(problem, way)[1].psi for name, way in ways.items()}
    whole = psi["whole motion"]
    summary: dict[str, Any] = {"scene": options.scene, "cosine_even": cosine}
    head = ("psi/full", "excess", "simulations", "static", "CPU s")
    say(" " * 36 + "".join(f" {text:>{n}s}" for text, n in zip(head, WIDTHS, strict=True)))
    for name, way in ways.items():
        summary[name] = {
            "psi_over_full": psi[name] / full,
            "excess": psi[name] / whole - 1.0,
            "simulations": way.simulations,
            "adjoints": way.adjoints,
            "static_analyses": way.static,
            "cpu_seconds": way.seconds,
            "psi_of_cycles": [value / full for value in way.history],
        }
        say(
            f"{name:36s} {psi[name] / full:9.4f} {psi[name] / whole - 1.0:+8.2%} "
            f"{way.simulations:12d} {way.static:7d} {way.seconds:6.1f}"
        )
    ffr.write_summary(comm, output / "summary.json", summary)
    for name, body in bodies(problem):
        plotting.plot_design(
            body.domain,
            {
                f"{label}: ψ {psi[label] / full:.4f} of the full "
                f"{'body' if len(problem.flexible) == 1 else 'links'}": way.result.densities[name]
                for label, way in ways.items()
            },
            output / f"{name}.png",
        )
    say(f"pictures and numbers are in {output}")

    # %% What must hold
    assert abs(static.psi / there.psi - 1.0) < 1e-6, "loads do not give back the displacements"
    assert 0.0 < cosine <= 1.0, "the gradient at fixed loads does not even point downwards"


def full_psi(problem: ffr.Problem) -> float:
    """Psi of the full bodies, with as many modes as designs are judged with."""
    solid = {name: np.ones(body.domain.n_cells) for name, body in problem.flexible.items()}
    return with_many_modes(problem).value(of_problem(solid)).psi


def bodies(problem: ffr.Problem) -> list[tuple[str, ffr.FlexibleBody]]:
    """Designed bodies with their names."""
    return list(problem.flexible.items())


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Equivalent static loads beside the whole motion.")
    parser.add_argument("--scene", choices=list(SCENES), default="slider_crank")
    parser.add_argument("--elements", nargs=2, type=int, default=[200, 20], metavar=("NX", "NY"))
    parser.add_argument("--iterations", type=int, default=60, help="of each optimisation")
    parser.add_argument("--cycles", type=int, default=6, help="of frozen loads, at most")
    parser.add_argument("--output", default="results/equivalent_static_loads")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    run(main)
