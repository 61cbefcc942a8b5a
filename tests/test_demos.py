# SPDX-License-Identifier: MIT
"""The demos as a user runs them, on small meshes: serial, with two ranks, on a mesh file."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dolfinx_ffr import read_history

TOP = Path(__file__).parents[1]
DEMO = TOP / "demos" / "slider_crank.py"


def run(*arguments: str, ranks: int = 1, cwd: Path, program: Path = DEMO) -> str:
    """Run a demo from a directory of its own and return what it prints."""
    command = [sys.executable, str(program), *arguments]
    if ranks > 1:
        mpirun = shutil.which("mpirun")
        assert mpirun, "mpirun is missing: install openmpi-bin"
        command = [mpirun, "-n", str(ranks), *command]
    # this process has initialised MPI already: a child must not take it for its parent
    environment = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith(("OMPI_COMM", "PMIX_", "PRTE_LAUNCHED", "OMPI_UNIVERSE"))
    }
    done = subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, check=False, timeout=500
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


def summary(folder: Path) -> dict[str, float]:
    """Return the numbers that a demo has left."""
    return json.loads((folder / "summary.json").read_text())  # type: ignore[no-any-return]


SMALL = ["--elements", "60", "6", "--iterations", "6", "--output", "out"]
FILES = ["design.xdmf", "design.h5", "design.png", "history.png", "motion.gif", "modes.png"]


def test_slider_crank_serial_and_parallel(tmp_path: Path) -> None:
    """Files and numbers are there, and two ranks find the same design as one."""
    serial, parallel = tmp_path / "serial", tmp_path / "parallel"
    for folder, ranks in ((serial, 1), (parallel, 2)):
        folder.mkdir()
        run(*SMALL, ranks=ranks, cwd=folder)
    one, two = summary(serial / "out"), summary(parallel / "out")
    assert (one["ranks"], two["ranks"]) == (1, 2)
    assert one["design_variables"] == 360
    for key, value in one.items():
        if key.startswith("compliance"):
            assert two[key] == pytest.approx(value, rel=1e-7), key
    assert one["compliance_final"] < one["compliance_initial"]
    assert one["volume_fraction"] <= 0.5 + 1e-9
    for name in FILES:
        assert (serial / "out" / name).stat().st_size > 500, name
    history = read_history(serial / "out" / "history.csv")
    assert len(history["psi"]) == 7
    assert history["psi"][-1] == pytest.approx(one["compliance_final"], rel=1e-12)
    with Image.open(serial / "out" / "motion.gif") as film:
        assert film.n_frames > 20
        film.seek(0)
        first = np.asarray(film.convert("L"), dtype=float)
        film.seek(film.n_frames // 3)
        later = np.asarray(film.convert("L"), dtype=float)
    assert np.mean(np.abs(first - later)) > 0.5  # something moves


def test_slider_crank_on_a_mesh_file(tmp_path: Path) -> None:
    """A gmsh file takes the place of the built-in rod, of order two."""
    from test_domain import write_rod

    write_rod(tmp_path / "rod.msh")
    run("--mesh", "rod.msh", "--order", "2", "--iterations", "8", "--output", "o", cwd=tmp_path)
    numbers = summary(tmp_path / "o")
    assert numbers["compliance_final"] < numbers["compliance_initial"]
    assert 0.0 < numbers["volume_fraction"] <= 0.5 + 1e-9


def test_resumed_demo_continues(tmp_path: Path) -> None:
    """A second run with --resume goes on where the first one ended."""
    run(*SMALL, cwd=tmp_path)
    first = read_history(tmp_path / "out" / "history.csv")
    more = [*SMALL, "--resume"]
    more[4] = "8"
    run(*more, cwd=tmp_path)
    second = read_history(tmp_path / "out" / "history.csv")
    assert len(second["psi"]) == 9
    np.testing.assert_array_equal(second["psi"][:7], first["psi"])


def test_approximate_gradient_serial_and_parallel(tmp_path: Path) -> None:
    """Three gradients, all pictures, and the same designs with two ranks as with one."""
    program = TOP / "demos" / "approximate_gradient.py"
    small = ["--elements", "40", "8", "--iterations", "3", "--output", "out"]
    numbers = []
    for ranks in (1, 2):
        folder = tmp_path / str(ranks)
        folder.mkdir()
        said = run(*small, ranks=ranks, cwd=folder, program=program)
        assert "times the exact adjoint's" in said
        numbers.append(json.loads((folder / "out" / "summary.json").read_text()))
        for name in (
            "1_basis_function",
            "2_scene",
            "3_crank_motion",
            "4_and_6_histories",
            "5_designs",
            "5_gradient_elements",
        ):
            assert (folder / "out" / f"{name}.png").stat().st_size > 5000, name
    one, two = numbers
    assert list(one) == ["exact adjoint", "element by element", "approximate, 35 %"]
    for name, found in one.items():
        expected = two[name]["compliance_relative"]
        assert found["compliance_relative"] == pytest.approx(expected, rel=1e-6), name
    element = one["element by element"]["compliance_relative"]
    assert element == pytest.approx(one["exact adjoint"]["compliance_relative"], rel=1e-6)


def test_density_design_serial_and_parallel(tmp_path: Path) -> None:
    """Densities and level sets, and the same designs with two ranks as with one."""
    program = TOP / "demos" / "density_design.py"
    small = ["--elements", "40", "8", "--iterations", "5", "--output", "out"]
    numbers = []
    for ranks in (1, 2):
        folder = tmp_path / str(ranks)
        folder.mkdir()
        run(*small, ranks=ranks, cwd=folder, program=program)
        numbers.append(json.loads((folder / "out" / "summary.json").read_text()))
        for name in ("designs", "histories"):
            assert (folder / "out" / f"{name}.png").stat().st_size > 5000, name
        history = folder / "out" / "densities_moving_asymptotes" / "history.csv"
        assert len(read_history(history)["psi"]) == 6
    one, two = numbers
    assert len(one) == 3
    for name, found in one.items():
        expected = two[name]["compliance_relative"]
        assert found["compliance_relative"] == pytest.approx(expected, rel=1e-6), name


def test_readme_shows_the_short_program() -> None:
    """README's program is the one that is run here."""
    blocks = re.findall(r"```python\n(.*?)```", (TOP / "README.md").read_text(), re.DOTALL)
    program = (TOP / "demos" / "short.py").read_text().split('"""\n', 1)[1].strip()
    assert any(block.strip() == program for block in blocks)


def test_short_program(tmp_path: Path) -> None:
    """The short program runs as it stands, but for a coarser mesh and fewer iterations."""
    text = (TOP / "demos" / "short.py").read_text()
    coarse = text.replace("(200, 20)", "(40, 6)").replace("volume=0.5", "volume=0.5, iterations=2")
    assert coarse != text
    program = tmp_path / "short.py"
    program.write_text(coarse)
    run(cwd=tmp_path, program=program)
    assert (tmp_path / "results" / "short" / "motion.gif").stat().st_size > 10_000


def test_connecting_rod_from_gmsh(tmp_path: Path) -> None:
    """The rod drawn by the demo, on one and on two ranks, with pictures of its stress."""
    rod = TOP / "demos" / "connecting_rod.py"
    small = ["--size", "0.008", "--order", "1", "--iterations", "16", "--output", "out"]
    found = {}
    for ranks in (1, 2):
        folder = tmp_path / str(ranks)
        folder.mkdir()
        run(*small, ranks=ranks, cwd=folder, program=rod)
        found[ranks] = summary(folder / "out")
        for name in (*FILES, "stress_design.png", "stress_full_rod.png", "scene.png"):
            assert (folder / "out" / name).stat().st_size > 500, name
    one, two = found[1], found[2]
    assert one["compliance_final"] < one["compliance_initial"]
    for key in ("compliance_solid", "compliance_final", "stress_solid", "stress_final", "area"):
        assert two[key] == pytest.approx(one[key], rel=1e-6), key


@pytest.mark.parametrize("demo", ["slider_crank", "connecting_rod"])
def test_mesh_of_the_connecting_rod_takes_the_place_of_the_rod(tmp_path: Path, demo: str) -> None:
    """What the mesh program writes, the demos read: curved triangles, other dimensions."""
    program = TOP / "demos" / "meshes" / "connecting_rod.py"
    run("--size", "0.01", "--length", "0.3", "--output", "rod.msh", cwd=tmp_path, program=program)
    run(
        *("--mesh", "rod.msh", "--order", "1", "--iterations", "16", "--output", "out"),
        cwd=tmp_path,
        program=TOP / "demos" / f"{demo}.py",
    )
    numbers = summary(tmp_path / "out")
    assert numbers["compliance_final"] < numbers["compliance_initial"]


#: demos of single scenes with settings for which they take seconds, and pictures that they leave
SCENES = {
    "spin_up": (["--elements", "20", "1", "--steps", "1500"], ["tip.png", "motion.gif"]),
    "pendulum": (["--elements", "20", "1", "--steps", "200"], ["modes.png", "motion.gif"]),
    "four_bar": (
        ["--elements", "24", "4", "--steps", "200", "--iterations", "5"],
        ["coupler.png", "rocker.png", "history.png", "motion.gif"],
    ),
    "robot_arm": (
        ["--elements", "30", "4", "--steps", "120", "--iterations", "4"],
        ["trade_off.png", "tip.png", "upper_arm.png", "forearm.png", "motion.gif"],
    ),
}


@pytest.mark.parametrize(
    ("name", "ranks"),
    [*((name, 1) for name in SCENES), ("spin_up", 2), ("four_bar", 2)],
)
def test_scene(name: str, ranks: int, tmp_path: Path) -> None:
    """A demo's own assertions hold, and its files are there."""
    options, files = SCENES[name]
    program = TOP / "demos" / f"{name}.py"
    run(*options, "--output", "out", ranks=ranks, cwd=tmp_path, program=program)
    assert summary(tmp_path / "out")
    for file in [*files, "scene.png"]:
        assert (tmp_path / "out" / file).stat().st_size > 5000, file


def test_four_bar_on_mesh_files(tmp_path: Path) -> None:
    """Gmsh files take the place of both links; the linkage closes with their lengths."""
    from test_domain import write_rod

    write_rod(tmp_path / "rod.msh")
    meshes = ["--coupler-mesh", "rod.msh", "--rocker-mesh", "rod.msh"]
    program = TOP / "demos" / "four_bar.py"
    run(*meshes, "--steps", "100", "--iterations", "3", cwd=tmp_path, program=program)
    assert summary(tmp_path / "results" / "four_bar")["volume_coupler"] <= 0.5 * (1 + 1e-6)


#: demos, their options, and the meshes that take the place of their bodies: option, length, height
#: and size of the elements [m]
ON_MESHES = {
    "approximate_gradient": (["--iterations", "2"], [("--mesh", 0.4, 0.04, 0.02)]),
    "density_design": (["--iterations", "4"], [("--mesh", 0.4, 0.04, 0.01)]),
    "spin_up": (["--steps", "1500"], [("--mesh", 10.0, (12.0 * 1.4e4 / 2.8e7) ** 0.5, 0.2)]),
    "pendulum": (["--steps", "200"], [("--mesh", 1.0, 0.05, 0.05)]),
    "robot_arm": (
        ["--steps", "100", "--iterations", "3"],
        [("--upper-mesh", 0.5, 0.05, 0.015), ("--fore-mesh", 0.4, 0.05, 0.015)],
    ),
    "connecting_rod": (["--order", "1", "--iterations", "8"], [("--mesh", 0.3, 0.03, 0.008)]),
}


@pytest.mark.parametrize("name", ON_MESHES)
def test_gmsh_file_takes_the_place_of_the_built_in_mesh(name: str, tmp_path: Path) -> None:
    """Every demo runs on files of gmsh, its own assertions hold, and it leaves its numbers."""
    from test_domain import write_rod

    options, meshes = ON_MESHES[name]
    for option, length, height, size in meshes:
        write_rod(tmp_path / f"{option[2:]}.msh", length=length, height=height, size=size)
        options = [*options, option, f"{option[2:]}.msh"]
    run(*options, "--output", "out", cwd=tmp_path, program=TOP / "demos" / f"{name}.py")
    assert summary(tmp_path / "out")
