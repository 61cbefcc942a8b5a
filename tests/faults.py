# SPDX-License-Identifier: MIT
"""Puts 49 faults into a copy of the source, one at a time, and counts how many the tests find.

    .venv/bin/python tests/faults.py                   # all, half an hour of processor time
    .venv/bin/python tests/faults.py fem dynamics/kin  # those of files whose paths begin so

A fault is a wrong sign, a wrong factor, an end that is off by one, a wrong index, or a term that is
left out. Each is tried with the tests beside it, up to the first that fails. Run those of a room
before and after you write its tests anew: as many must be found. Where the source changes, a fault
whose text no longer stands once in its file is named, and has to be written anew.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
#: File of the source | its text | the text with the fault | tests that are to find it
TABLE = """
body/moments.py | np.outer(scale, scale))[0] | np.outer(scale, scale))[1] | body
body/volume_integrals.py | range(weights.ndim - 1) | range(weights.ndim) | dynamics/test_stiffened_markers.py
boundary/curve.py | np.tile(0.5 * weights | np.tile(weights | boundary/test_curve.py
boundary/derivative.py | 0.5 * node_gradient[self._middles] | node_gradient[self._middles] | boundary/test_move_boundary.py
boundary/sizes.py | by_slope -= 3.0 * | by_slope -= 2.0 * | boundary/test_move_boundary.py
boundary/step.py | solved = self._solved - self | solved = self._solved + self | boundary/test_step.py
boundary/splines.py | kron(kron(x, y), z) | kron(kron(x, x), z) | boundary/test_surface.py
design/densities.py | 1.0 - np.tanh(self.beta * (means | 1.0 + np.tanh(self.beta * (means | design/test_density_filter.py
design/dimensions.py | ends[0][k] - ends[1][k] | ends[0][k] - center[k] | design/test_dimensions.py
design/level_set.py | OPTIONS.weight * ramp * late | OPTIONS.weight * late | design/test_level_set.py optimization/test_mma.py
design/level_set.py | min(row, rows - 1 - row) | min(row, rows - row) | design/test_level_set.py
design/rbf.py | x + 0.5 * width] | x + width] | design/test_rbf.py
dynamics/integration/generalized_alpha.py | (0.5 - beta) | (0.5 + beta) | dynamics/test_dynamics.py
dynamics/integration/stages.py | (rhs[p] - push) | rhs[p] | dynamics/test_radau.py
dynamics/kinematics/bodies_space.py | += Z[ix + j] - Z[xi + j] | += Z[ix + j] + Z[xi + j] | dynamics/test_spatial_adjoint.py
dynamics/kinematics/directions.py | - 2.0 * rate * inner(model, s, a) | - rate * inner(model, s, a) | dynamics/test_mechanism_bars.py::test_slopes_are_those_of_differences[linked]
dynamics/kinematics/gradients.py | [-by_c, -by_d, | [by_c, -by_d, | dynamics/test_spatial_adjoint.py
dynamics/kinematics/group.py | (1.0 - 0.5 * a / b) / q | (1.0 - a / b) / q | dynamics/test_spatial_adjoint.py
dynamics/kinematics/moments_plane.py | both = G + 1j * N | both = G - 1j * N | dynamics/test_adjoint.py
dynamics/kinematics/rows.py | complex(0.0, -first if | complex(0.0, first if | dynamics/test_joints.py dynamics/test_adjoint.py
dynamics/kinematics/rows.py | g[0] += first | g[0] -= first | dynamics/test_joints.py
dynamics/power.py | force if is_on_body[0] else -force | force | objective/test_objective.py
fem/interface.py | 2.0 * (1.0 + REFERENCE.round) * extent | (1.0 + REFERENCE.round) * extent | demos/test_connecting_rod.py
fem/material.py | (1.0 - 2.0 * self.poisson) | (1.0 - self.poisson) | fem/test_material.py
fem/material.py | 2.0 * (2.0 ** (exponent - 1.0) | 2.0 * (2.0**exponent | fem/test_material.py design/test_level_set.py
fem/outline.py | np.array([by * a - ay * b, | np.array([by * a + ay * b, | fem/test_outline.py
fem/tetrahedra.py | 1.0 - positions[:, :, None, :] | 1.0 + positions[:, :, None, :] | part/test_solid.py
interchange/nastran.py | range(1, n + 1) | range(1, n) | interchange
interchange/sid.py | gyro, by_gyro = 2.0 * theta | gyro, by_gyro = theta | interchange/test_sid.py
interchange/superelement.py | -cross_matrix(S[0]) | cross_matrix(S[0]) | interchange/test_superelements.py
lower_bound/certificate.py | share * domain.area - | share * domain.area + | lower_bound
mechanism/joints.py | np.sign(self.ratio) * distance * np.sin | np.sign(self.ratio) * distance * np.cos | mechanism dynamics/test_joints.py
mechanism/laws.py | (k * (k - 1))[2:] | (k * k)[2:] | mechanism
mechanism/laws.py | 10.0 + x * (-15.0 | 10.0 - x * (-15.0 | mechanism
objective/stress.py | 2.0 / self.power * by_square | 1.0 / self.power * by_square | reduction/test_node_derivatives.py
objective/stress.py | weights_bar - self.scale | weights_bar + self.scale | reduction/test_node_derivatives.py
objective/time_average.py | (limit - ends[:-1]) | (limit - ends[1:]) | objective/test_objective.py
optimization/descent.py | share / bound_share - 1.0 | share / bound_share | boundary/test_move_boundary.py
optimization/level_set_evolution.py | size=SHRINK * state.size | size=state.size | optimization/test_optimize.py
optimization/moving_asymptotes.py | -lagrangian * up | lagrangian * up | optimization/test_moving_asymptotes.py
optimization/moving_asymptotes.py | 0.25 * curvature * reach - 0.5 * np.abs(gradients) | 0.25 * curvature * reach | optimization/test_moving_asymptotes.py optimization/test_mma.py
part/export.py | (scale * v for v in | (v for v in | part/test_export.py
part/part.py | bent = (angle < 0.0) | bent = (angle > 0.0) | part/test_part.py part/test_asked_sizes.py
part/solid.py | (a + b + c) / 4.0 | (a + b + c) / 3.0 | part/test_solid.py
problem/bodies.py | gradient + bars.densities[name] | gradient | objective/test_density_objectives.py
problem/load_cases.py | sum(scaled[1:], scaled[0]) | sum(scaled[2:], scaled[0]) | test_several_load_cases.py
reduction/craig_bampton.py | gradients_bar[:, 0] - rotated | gradients_bar[:, 0] + rotated | reduction/test_node_derivatives.py
reduction/integrals.py | (bar.N - bar.N.T) | bar.N | reduction/test_pullback.py
reduction/residual_modes.py | residual(residual(static)) | static | reduction/test_residual_modes.py
"""  # noqa: E501


def lines_of_table(beginnings: list[str]) -> list[list[str]]:
    """File, text, text with the fault and tests of the faults that are asked for."""
    rows = [line.split(" | ") for line in TABLE.strip().splitlines()]
    return [row for row in rows if not beginnings or row[0].startswith(tuple(beginnings))]


def copy_of_tree(folder: Path) -> None:
    """Copy all files that git knows, and compiled kernels, in the place of an earlier copy."""
    for name in ("src", "tests"):
        shutil.rmtree(folder / name, ignore_errors=True)
    listed = subprocess.run(
        ["git", "ls-files"], cwd=TOP, capture_output=True, text=True, check=True
    )
    kernels = [str(file.relative_to(TOP)) for file in (TOP / "src").rglob("*.nb[ic]")]
    for name in [*listed.stdout.splitlines(), *kernels]:
        target = folder / name
        if (TOP / name).is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(TOP / name, target)


def outcome(file: Path, before: str, after: str, tests: list[str], folder: Path) -> str:
    """Which test finds a fault, or that none does."""
    source, times = file.read_text(), file.stat()
    if source.count(before) != 1:
        return "the text does not stand once in its file: write the fault anew"
    file.write_text(source.replace(before, after))
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider"]
    environment = os.environ | {"PYTHONPATH": str(folder / "src")}
    try:
        done = subprocess.run(
            [*command, *(f"tests/{name}" for name in tests)],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
        )
    finally:
        file.write_text(source)
        os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))  # for compiled code
    if done.returncode == 0:
        return "NOT FOUND"
    lines = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return f"found: {lines[0].split(' - ')[0] if lines else done.stderr.strip()[-100:]}"


def main() -> None:
    """Run the tests with each of the faults that are asked for."""
    parser = argparse.ArgumentParser(description="Count the faults that the tests find.")
    parser.add_argument("beginnings", nargs="*", help="of the files' paths (default: all)")
    parser.add_argument("--folder", type=Path, default=TOP / "build" / "faults", help="of the copy")
    options = parser.parse_args()
    folder = options.folder.resolve()
    copy_of_tree(folder)
    rows, computed = lines_of_table(options.beginnings), 0
    for name, before, after, tests in rows:
        print(f"{name}: {before!r} -> {after!r}")
        file = folder / "src" / "dolfinx_ffr" / name
        verdict = outcome(file, before, after, tests.split(), folder)
        computed += verdict.startswith("found")
        print(f"    {verdict}", flush=True)
    print(f"{computed} of {len(rows)} faults were found")


if __name__ == "__main__":
    main()
