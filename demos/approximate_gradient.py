# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A design by the paper's approximate gradient.

What you will see: the rod of a slider-crank designed with a gradient that is computed at 35 % of
the elements only, where they are, and how far this gradient is from the exact one.

**Gradient.** That of `slider_crank.py`, for explicit steps of a level set out of a rod with holes:
one linear system for each shape function and each element of a coarse grid and of a band around
the active boundary, and radial basis functions between them,

    grad psi(X) = sum_j alpha_j g(|X - X_j|).

The error is estimated in every iteration by leaving out, and measured in every fifth, beside
the exact adjoint, which is faster and the default of the package.

Run `python demos/approximate_gradient.py --help`, also under `mpirun -n 2`; it takes some minutes.
"""

import numpy as np
from command_line import draw, leave, parse, run, say
from slider_crank import VOLUME, reference_problem

import dolfinx_ffr as ffr

# %% Parameters
KERNELS = {
    "exponential": ffr.ExponentialSpline(0.1),  # the paper's; lengths in [m]
    "gaussian": ffr.Gaussian(0.002),
    "multiquadric": ffr.Multiquadric(0.002),
    "thin-plate": ffr.ThinPlate(),
    "wendland": ffr.Wendland(0.05),
}
SHARE, COMPARE_EVERY = 0.35, 5  # of the elements, iterations


def main(arguments: list[str] | None = None) -> None:
    """Design the rod, and leave numbers and pictures."""
    defaults = {"elements": (120, 12), "iterations": 60, "share": SHARE}
    options = parse(arguments, "approximate_gradient", **defaults, kernel="exponential", mesh="")
    options.complete &= options.share >= SHARE
    if options.kernel not in KERNELS:
        raise ValueError(f"--kernel {options.kernel}: there are {', '.join(KERNELS)}")
    comm, output = options.comm, options.output
    own_mesh = ffr.Domain.from_gmsh(comm, options.mesh) if options.mesh else None
    problem = reference_problem(comm, options.elements, domain=own_mesh)
    domain = problem.flexible["rod"].domain
    elements, kernel = ffr.paper.GradientElements(share=options.share), KERNELS[options.kernel]
    gradient = ffr.paper.ApproximateGradient(elements, kernel, compare_every=COMPARE_EVERY)
    levelset = ffr.LevelSet(domain)
    height = np.ptp(domain.bounding_box, axis=0)[1]
    start = levelset.with_holes(10, 3, 0.2 * height, margin=0.25 * height)
    explicit = {"optimizer": ffr.LevelSetEvolution(), "gradient": gradient}
    with ffr.recorded_warnings() as warnings:
        result = ffr.optimize(problem, levelset, start, **explicit, volume=VOLUME, **options.run)
        finished = result.finish(output)
    full = result.problem.value(np.ones(domain.n_cells)).psi
    selected = elements.select(domain, levelset.distance(result.coefficients))
    share = domain.sum(selected * 1.0) / domain.n_cells_global
    say(f"exact derivatives at {share:.0%} of the elements of the final design")

    # %% Pictures and numbers
    history, i = result.history, result.history["iteration"]
    errors = {"estimate": (i, history["gradient_estimate"]), "true": (i, history["gradient_error"])}
    panels = {"elements with exact derivatives": {"": (i, history["gradient_elements"])}}
    panels["relative error of the gradient"] = errors
    axis = {"xlabel": "iteration", "markers": True, "comm": comm}
    ffr.plotting.plot_curves(panels, output / "histories.png", **axis)
    draw(result, output, full=full, volume=VOLUME)
    title = f"{result.psi / full:.1%} of the full rod's compliance"
    selections = {title: (result.x, selected)}
    ffr.plotting.plot_gradient_elements(domain, selections, output / "elements.png")
    title = "A rod designed by an approximate gradient"  # near to that of the exact one
    leave(options, result, title, full, finished, warnings, most=0.6 * full)


if __name__ == "__main__":
    run(main)
