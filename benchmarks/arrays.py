# SPDX-License-Identifier: MIT
"""The flexible slider-cranks of the demos as arrays, with psi and its gradient to ten digits.

The study leaves for each a file of the rod, as `VolumeIntegrals.save` writes a body in space, and
one of the machine, for programs that know nothing of this package: `read_arrays.py` is one. How
many digits are sure follows from half as many steps, and from SciPy's integrator.
"""

from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
import read_arrays
from jobs import Array, Job, Progress, Results
from report import Study, line, plot
from scene import demo, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import BLUE, ORANGE

#: Meshes, and the times in which the cranks turn from rest to rest [s]
MESHES = {"plane": [80, 8], "space": [40, 4, 4]}
TIMES = {"plane": 0.1, "space": 0.3}


def arrays_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one for each machine; the quick one ends long before its crank."""
    steps = [60, 120] if quick else [1000, 2000, 4000, 8000, 16000, 32000, 64000]
    ends, tolerance = ({"plane": 0.002}, 1e-7) if quick else (TIMES, 1e-10)
    own = [{"name": name, "end": end} for name, end in ends.items()]
    common = {"steps": steps, "tolerance": tolerance}
    return [Job("arrays", "machine", 3.0 if quick else 150.0, {**one, **common}) for one in own]


def machine(
    comm: MPI.Comm, progress: Progress, *, name: str, end: float, steps: list[int], tolerance: float
) -> dict[str, Any]:
    """The arrays of a slider-crank, psi and its gradient over steps, and psi by SciPy."""
    problem, plane = slider_crank(comm, MESHES[name], modes=2, steps=100), name == "plane"
    scene, duration = demo("slider_crank" if plane else "spatial_slider_crank"), TIMES[name]
    turns, mechanism = scene.TURNS, problem.mechanism
    if plane:
        turns, mechanism = 1, scene.slider_crank(duration, scene.SLIDER, turns=1)
    body = problem.flexible["rod"]
    reduced = body.reduce(np.ones(body.domain.n_cells))
    rod = body.in_space(reduced)
    found = []
    for n in steps:
        method = ffr.RadauIIA(end, steps=n)
        motion = ffr.MechanicalProblem(mechanism, method, ffr.IntegralCompliance())
        evaluation = motion.gradient({"rod": reduced.integrals})
        slopes = by_arrays(evaluation.integrals_gradient["rod"])
        found.append({"psi": evaluation.psi, **slopes})
        progress(0.5 * len(found) / len(steps))
    law = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
    arrays = {
        **rows_of(rod, np.asarray(mechanism.placements["rod"].rotation), plane=plane),
        "circle": scene.CRANK * np.eye(3)[[0, 1] if plane else [1, 2]],
        "angle": 2 * np.pi * turns * law / duration ** np.arange(6.0),
        **{"times": np.array([0.0, end]), "mass": np.float64(scene.SLIDER)},
    }
    began = process_time()
    again = float(read_arrays.end_of(rod.by_key, arrays, tolerance)[-1])
    seconds = process_time() - began
    *_, half, last = found
    errors = {"psi_error": max(abs(half["psi"] - last["psi"]), abs(again - last["psi"]))}
    for key in ("by_S", "by_P", "by_K"):
        errors[f"{key}_error"] = np.max(np.abs(half[key] - last[key]))
    rows = [
        {"machine_text": name, "steps": n, "psi_text": f"{one['psi']:.13g}"}
        | {"error_psi": abs(one["psi"] / last["psi"] - 1.0)}
        | {f"error_{k}": relative(one[f"by_{k}"], last[f"by_{k}"]) for k in "SPK"}
        for n, one in zip(steps, found, strict=True)
    ]
    scipy = {"machine_text": name, "psi_text": f"{again:.13g}", "seconds": seconds}
    scipy |= {"tolerance": tolerance, "error_psi": abs(again / last["psi"] - 1.0)}
    files = {"rod": rod.by_key, "machine": {**arrays, **last, **errors}}
    files = {part: {k: np.asarray(a).tolist() for k, a in f.items()} for part, f in files.items()}
    return {"name": name, "files": files, "rows": rows, "scipy": scipy}


def relative(slopes: Array, exact: Array) -> float:
    """The largest difference of derivatives relative to the largest of them."""
    return float(np.max(np.abs(slopes - exact)) / np.max(np.abs(exact)))


def by_arrays(bar: ffr.VolumeIntegrals) -> dict[str, Array]:
    """Derivatives by S, P and K of a body in space from those of one there or in the plane."""
    if bar.P is not None:
        return {"by_S": bar.S, "by_P": bar.P, "by_K": bar.K}
    return {"by_S": padded(bar.S), "by_P": moments(bar.G, bar.N), "by_K": bar.K}


def moments(G: Array, N: Array) -> Array:
    """What is P of a body in the plane, twice; of derivatives by G and N it is that by P."""
    turned = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    return np.multiply.outer(G, np.diag([1.0, 1.0, 0.0])) + np.multiply.outer(N, turned)


def padded(rows: Array) -> Array:
    """Vectors in the plane as those in space, shape (n, 3)."""
    return np.pad(rows, ((0, 0), (0, 1)))


def rows_of(rod: ffr.VolumeIntegrals, axes: Array, *, plane: bool) -> dict[str, Array]:
    """Three equations of the joints, the slider's shape functions, and the start.

    With d and w a row of `directions` and `rows` they are d . (pinned R + A w(q)) = constant. In
    the plane two of them keep z upright, in space one is the universal joint's.
    """
    left, right = rod.markers["left"], rod.markers["right"].basis
    x, y, z = np.eye(3)

    def turning(axis: Array) -> Array:  # with the left end
        return np.column_stack([axis, np.cross(left.rotation, axis, axisa=0, axisc=0)])

    upright = np.column_stack([z, np.zeros((3, rod.modes))])
    if plane:
        own, rows, axes = [y, x, y], [right, upright, upright], np.eye(3)
    else:
        own, rows = [y, z, x], [right, right, turning(y)]
    pinned = [1.0, 0.0, 0.0] if plane else [1.0, 1.0, 0.0]
    found = {"directions": np.array(own), "rows": np.array(rows), "pinned": np.array(pinned)}
    start = np.concatenate([axes.ravel(), [0.0, 0.0, 0.0, 1.0], np.zeros(2 * rod.modes + 2)])
    return {**found, "slider": right, "start": start}


def report_arrays(study: Study, results: Results) -> None:
    """The files, tables and a picture."""
    found = [result for _, result in results]
    for result in found:
        for part, arrays in result["files"].items():
            stored = {key: np.array(array) for key, array in arrays.items()}
            np.savez(study.directory / f"arrays_{result['name']}_{part}.npz", **stored)
    study.table("arrays", [row for result in found for row in result["rows"]])
    study.table("arrays_scipy", [result["scipy"] for result in found])
    caption = "How psi and its gradient settle with the steps"
    with study.picture(caption, 1, len(found), (6.0 * len(found), 3.6)) as panels:
        for axes, result in zip(panels, found, strict=True):
            rows = result["rows"][:-1]
            line(axes, rows, "steps", "error_psi", "o-", BLUE, label="psi")
            for key, mark in zip("SPK", "s^v", strict=True):
                line(axes, rows, "steps", f"error_{key}", f"{mark}-", ORANGE, label=f"by {key}")
            plot(axes, result["name"], "steps", "difference from the most steps", legend="best")
