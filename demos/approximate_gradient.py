# SPDX-License-Identifier: MIT
# %% [markdown]
"""# The paper's approximate gradient beside the exact one.

What you will see: the flexible rod of a slider-crank designed from the same start with three
gradients, the pictures of the paper's figures 1 to 6, and what each gradient costs.

**Problem.** As in `slider_crank.py`: min psi(x(alpha)) such that volume(x(alpha)) <= 0.5.

**Three gradients** dpsi/dx of the same discrete problem:

- *exact adjoint*: one linear system for each shape function, whatever the number of elements;
- *element by element*: one linear system for each shape function and each element, the paper's
  exact gradient;
- *approximate*: the same at 35 % of the elements, on a coarse grid and in a band around the active
  boundary, and radial basis functions between them, grad psi(X) = sum_j alpha_j g(|X - X_j|). The
  error is estimated in every iteration by leaving out, and measured in every fifth.

The first two differ by round-off only, but each design loop is a long chain of decisions: where a
strut is about to vanish, they may part.

Run it with

    python demos/approximate_gradient.py [--full] [--elements NX NY] [--iterations N] [--share S]
                                         [--kernel exponential|gaussian|multiquadric|thin-plate|
                                          wendland] [--without-element-by-element] [--mesh FILE]
                                         [--output DIR]

also under `mpirun -n 2`. By default it takes a coarser mesh than `slider_crank.py` and about four
minutes; `--full` does all three runs with 200 x 20 elements to the end, most of an hour, most of
it element by element, which one may leave out.
"""

# %% Imports
from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter

from mpi4py import MPI

from slider_crank import VOLUME, part_record, reference_problem, simple_designs

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting
from dolfinx_ffr.program import run

# %% Parameters
KERNELS = {
    "exponential": ffr.ExponentialSpline(0.1),  # the paper's; lengths in [m]
    "gaussian": ffr.Gaussian(0.002),
    "multiquadric": ffr.Multiquadric(0.002),
    "thin-plate": ffr.ThinPlate(),
    "wendland": ffr.Wendland(0.05),
}
COMPARE_EVERY = 5  # iterations


def folder(name: str) -> str:
    """Where a design is kept."""
    return name.split(",")[0].replace(" ", "_")


# %% The program
def main(arguments: list[str] | None = None) -> None:
    """Design the rod three times, and leave numbers and pictures."""
    options = parse(arguments)
    comm = MPI.COMM_WORLD
    output = Path(options.output)
    say = print if comm.rank == 0 else lambda *_: None

    given = ffr.Domain.from_gmsh(comm, options.mesh) if options.mesh else None
    problem = reference_problem(comm, tuple(options.elements), domain=given)
    domain = problem.flexible["rod"].domain
    solid = problem.value(simple_designs(domain)["solid"]).psi
    kernel = KERNELS[options.kernel]
    elements = ffr.GradientElements(share=options.share)
    methods: dict[str, ffr.GradientMethod] = {
        "exact adjoint": ffr.ExactAdjoint(),
        "element by element": ffr.ElementByElement(),
        f"approximate, {100 * options.share:.0f} %": ffr.ApproximateGradient(
            elements, kernel, compare_every=COMPARE_EVERY
        ),
    }
    exact, element, near = list(methods)
    designed_by = [exact, near] if options.without_element_by_element else [exact, element, near]

    # %% Three designs from the same start
    results: dict[str, ffr.Result] = {}
    verified: dict[str, ffr.Verification | None] = {}
    full: dict[str, float] = {}  # psi of the full rod with as many modes
    seconds: dict[str, float] = {}
    for name in designed_by:
        method = methods[name]
        say(f"{name}: {domain.n_cells_global} elements, at most {options.iterations} iterations")
        levelset = ffr.LevelSet(domain)
        low, high = domain.bounding_box
        height = high[1] - low[1]
        start = levelset.with_holes(10, 3, 0.2 * height, margin=0.25 * height)
        begin = perf_counter()
        results[name] = ffr.optimize(
            problem,
            levelset,
            start,
            optimizer=ffr.LevelSetEvolution(),
            volume=VOLUME,
            gradient=method,
            iterations=options.iterations,
            output=output / folder(name),
        )
        seconds[name] = comm.bcast(perf_counter() - begin, root=0)
        verified[name] = results[name].finish(output / folder(name))
        full[name] = results[name].problem.value(simple_designs(domain)["solid"]).psi

    # %% One gradient of the start design, timed by each method
    levelset = ffr.LevelSet(domain).with_sharpness(ffr.LevelSetEvolution().sharpness[0])
    evolution = ffr.Evolution(levelset, VOLUME)
    shrunk = evolution.variables(evolution.start(start))
    x_start = levelset.density(shrunk)
    evaluation = problem.value(x_start)
    distance = levelset.distance(shrunk)
    once: dict[str, float] = {}
    found: dict[str, ffr.Evaluation] = {}
    reports: dict[str, ffr.GradientReport] = {}
    for name, method in methods.items():
        if isinstance(method, ffr.ApproximateGradient):
            method = ffr.ApproximateGradient(elements, kernel)  # without the comparison
        comm.Barrier()
        begin = perf_counter()
        found[name], report = method(problem, evaluation, lambda _: distance, 1)
        once[name] = comm.bcast(perf_counter() - begin, root=0)
        reports[name] = report["rod"]
    design = domain.design_cells
    errors = {
        name: ffr.gradient_errors(
            domain, found[name].gradient["rod"], found[exact].gradient["rod"], design
        )
        for name in (element, near)
    }

    # %% Pictures, in the order of the paper's figures
    plotting.plot_kernel(
        kernel, output / "1_basis_function.png", extent=0.2, title=f"{kernel}", comm=comm
    )
    plotting.plot_scene(problem, results[exact].evaluation, output / "2_scene.png")
    plotting.plot_crank_motion(
        results[exact].evaluation.trajectory, output / "3_crank_motion.png", comm=comm
    )
    plotting.plot_gradient_histories(
        {name: result.history for name, result in results.items()},
        output / "4_and_6_histories.png",
        psi_solid=solid,
        comm=comm,
    )
    last = results[near]
    final = levelset.distance(last.coefficients)
    plotting.plot_gradient_elements(
        domain,
        {
            f"start: exact derivatives at {reports[near].elements} of "
            f"{reports[exact].elements} designed elements": (x_start, reports[near].selected),
            "final design": (last.x, elements.select(domain, final)),
        },
        output / "5_gradient_elements.png",
    )
    plotting.plot_design(
        domain,
        {
            "start": x_start,
            **{
                f"{name}: {100 * result.psi / full[name]:.1f} % of the full rod's compliance, "
                f"{result.iterations} iterations": result.x
                for name, result in results.items()
            },
        },
        output / "5_designs.png",
    )

    # %% Numbers
    parts = {name: part_record(v, full[name]) if v else {} for name, v in verified.items()}
    summary = {
        name: {
            "compliance_relative": result.psi / full[name],
            **result.summary(),
            **parts[name],
            "seconds": seconds[name],
            "seconds_one_gradient": once[name],
            "elements_with_exact_derivatives": reports[name].elements,
        }
        for name, result in results.items()
    }
    ffr.write_summary(comm, output / "summary.json", summary)
    for name, result in results.items():
        part = parts[name].get("compliance_part_relative")
        of_part = "unknown" if part is None else f"{part:.4f}"
        say(
            f"  {name:20s} psi {result.psi / full[name]:.4f} of the full rod's, that of the part "
            f"{of_part}, {result.iterations:3d} iterations in {seconds[name]:5.0f} s; one gradient "
            f"{once[name]:6.2f} s, "
            f"{once[name] / once[exact]:5.1f} times the exact adjoint's"
        )
    say(
        f"  start design: element by element differs by {errors[element].l2:.1e}, the "
        f"approximation by {errors[near].l2:.2f} (estimated {reports[near].estimate:.2f}), cosine "
        f"{errors[near].cosine:.3f}"
    )
    for name in designed_by[1:]:
        apart = results[name].psi / results[exact].psi - 1.0
        say(f"  {name}: final compliance {100 * apart:+.1f} % from the exact adjoint's")
    say(f"pictures and numbers are in {output}")

    # %% What must hold
    assert errors[element].l2 < 1e-7, "element by element is not the exact gradient"
    assert errors[near].l2 > errors[element].l2
    for name, result in results.items():
        assert result.evaluation.volume["rod"] <= VOLUME + 1e-9, f"{name}: volume above its bound"
        assert result.psi < result.history["psi"][0], f"{name}: no descent"
    if (
        not given
        and domain.n_cells_global >= 1000
        and options.iterations >= 60
        and options.share >= 0.35
    ):
        # designs along different ways of descent: neither is the lower one by nature
        apart = abs(results[near].psi / results[exact].psi - 1.0)
        assert apart < 0.15, f"final compliances are {100 * apart:.1f} % apart"


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Design a rod with three gradients.")
    parser.add_argument("--full", action="store_true", help="200 x 20 elements, 100 iterations")
    parser.add_argument("--elements", nargs=2, type=int, metavar=("NX", "NY"))
    parser.add_argument("--mesh", help="gmsh file with the physical curves 'left' and 'right'")
    parser.add_argument("--iterations", type=int, help="at most (default 60)")
    parser.add_argument("--share", type=float, default=0.35, help="of the elements (default 0.35)")
    parser.add_argument("--kernel", choices=list(KERNELS), default="exponential")
    parser.add_argument("--without-element-by-element", action="store_true")
    parser.add_argument("--output", default="results/approximate_gradient")
    options = parser.parse_args(arguments)
    options.elements = options.elements or ([200, 20] if options.full else [120, 12])
    options.iterations = options.iterations or (100 if options.full else 60)
    return options


if __name__ == "__main__":
    run(main)
