# SPDX-License-Identifier: MIT
"""The demos on small meshes: as programs of a user, in this process on its ranks, on mesh files."""

from __future__ import annotations

import functools
import importlib
import json
import re
import shutil
import subprocess
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from shared import TOP, processes
from shared.meshes import write_rod
from slider_crank import reference_problem, simple_designs

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting, read_history

# on meshes as coarse as here designs are not what they should be, and say so
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::UserWarning")]

DEMO = TOP / "demos" / "slider_crank.py"


def run(*arguments: str, ranks: int = 1, cwd: Path, program: Path = DEMO) -> str:
    """Start a program from a directory of its own and return what it prints."""
    done = subprocess.run(
        processes.command(str(program), *arguments, ranks=ranks),
        cwd=cwd,
        env=processes.environment(),
        capture_output=True,
        text=True,
        check=False,
        timeout=500,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


@pytest.fixture
def demo(monkeypatch: pytest.MonkeyPatch, shared_tmp_path: Path) -> Callable[..., Path]:
    """Run the main function of a demo on the ranks at hand, with a short film; gives its output."""
    # tests/plotting looks at films, and one test here at a whole one
    short = functools.partial(plotting.animate_motion, frames=6)
    monkeypatch.setattr(plotting, "animate_motion", short)
    monkeypatch.chdir(shared_tmp_path)

    def run(name: str, *arguments: str) -> Path:
        importlib.import_module(name).main([*arguments, "--output", "out"])
        MPI.COMM_WORLD.Barrier()
        return shared_tmp_path / "out"

    return run


def summary(folder: Path) -> dict[str, Any]:
    """The numbers that a demo has left."""
    return json.loads((folder / "summary.json").read_text())  # type: ignore[no-any-return]


@pytest.fixture
def undrawn(demo: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Run a demo for its numbers: pictures are put together and not drawn, films left out."""
    monkeypatch.setattr(plotting, "animate_motion", lambda *_, **__: None)
    monkeypatch.setattr(Figure, "savefig", lambda *_, **__: None)
    monkeypatch.setattr(ffr, "write_report", lambda *_, **__: None)
    return demo


SMALL = ["--elements", "60", "6", "--iterations", "8"]
FILES = ["design.xdmf", "design.h5", "design.png", "history.png", "motion.gif", "modes.png"]
PART = ["part.svg", "part.dxf", "part.step", "part.stl", "part.png"]


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the slider-crank leaves, run as a user runs it: one process, the whole film."""
    folder = tmp_path_factory.mktemp("serial")
    run(*SMALL, "--output", "out", cwd=folder)
    return folder / "out"


@pytest.mark.mpi
def test_slider_crank_on_any_number_of_ranks(demo: Callable[..., Path]) -> None:
    """Several ranks find the same design as one."""
    found = summary(demo("slider_crank", *SMALL))
    assert found["ranks"] == MPI.COMM_WORLD.size
    assert found["design_variables"] == 360
    problem = reference_problem(MPI.COMM_SELF, (60, 6))
    domain = problem.flexible["rod"].domain
    for name, x in simple_designs(domain).items():
        assert found[f"compliance_{name}"] == pytest.approx(problem.value(x).psi, rel=1e-7)
    with warnings.catch_warnings():  # no good design in so few iterations
        warnings.simplefilter("ignore")
        options = {"volume": 0.5, "iterations": 8, "progress": False}
        even = problem.gradient(simple_designs(domain)["even"]).gradient["rod"]
        levelset = ffr.LevelSet(domain, mirrors=ffr.mirror_lines(domain, even))
        alone = ffr.optimize(problem, levelset, **options)
    assert found["compliance_initial"] == pytest.approx(alone.history["psi"][0], rel=1e-7)
    assert found["compliance_final"] == pytest.approx(alone.psi, rel=1e-7)
    assert found["compliance_final"] < found["compliance_initial"]


def test_files_of_the_slider_crank(serial: Path) -> None:
    for name in [*FILES, *PART, "report.html"]:
        assert (serial / name).stat().st_size > 500, name
    history = read_history(serial / "history.csv")
    assert len(history["psi"]) == 9
    # the law of cut elements tells of a stiffer rod than that of densities
    final = summary(serial)["compliance_final"]
    assert 0.5 * history["psi"].min() < final < history["psi"].min()
    found = summary(serial)
    assert found["psi"] == final
    assert found["part_pieces"] == 1
    assert found["part_change"] < 0.01
    difference = found["compliance_part"] / found["compliance_final"] - 1.0
    assert found["part_difference"] == pytest.approx(difference, rel=1e-9)
    with Image.open(serial / "motion.gif") as film:
        assert film.n_frames > 20
        film.seek(0)
        first = np.asarray(film.convert("L"), dtype=float)
        film.seek(film.n_frames // 3)
        later = np.asarray(film.convert("L"), dtype=float)
    assert np.mean(np.abs(first - later)) > 0.5  # something moves


def test_resumed_demo_continues(serial: Path, demo: Callable[..., Path], tmp_path: Path) -> None:
    """A second run with --resume goes on where the first one ended."""
    shutil.copytree(serial, tmp_path / "out")
    out = demo("slider_crank", *SMALL[:-1], "9", "--resume")
    first, second = read_history(serial / "history.csv"), read_history(out / "history.csv")
    assert len(second["psi"]) == 10
    np.testing.assert_array_equal(second["psi"][:9], first["psi"])


def test_approximate_gradient(demo: Callable[..., Path], capsys: pytest.CaptureFixture) -> None:
    """Three gradients and all pictures; element by element is the exact gradient."""
    out = demo("approximate_gradient", "--elements", "24", "6", "--iterations", "3")
    assert "times the exact adjoint's" in capsys.readouterr().out
    numbers = json.loads((out / "summary.json").read_text())
    for name in (
        "1_basis_function",
        "2_scene",
        "3_crank_motion",
        "4_and_6_histories",
        "5_designs",
        "5_gradient_elements",
    ):
        assert (out / f"{name}.png").stat().st_size > 5000, name
    assert list(numbers) == ["exact adjoint", "element by element", "approximate, 35 %"]
    psi = {name: found["compliance_relative"] for name, found in numbers.items()}
    assert psi["element by element"] == pytest.approx(psi["exact adjoint"], rel=1e-6)


def test_density_design(demo: Callable[..., Path]) -> None:
    """Level sets and densities; what is torn after so few iterations makes no part."""
    out = demo("density_design", "--elements", "40", "8", "--iterations", "4")
    assert len(json.loads((out / "summary.json").read_text())) == 3
    for name in ("designs", "histories"):
        assert (out / f"{name}.png").stat().st_size > 5000, name
    history = out / "densities_moving_asymptotes" / "history.csv"
    assert len(read_history(history)["psi"]) == 5


def test_several_motions(demo: Callable[..., Path]) -> None:
    """Eight designs in six motions, whose table is complete, and a report of all motions."""
    small = ["--elements", "40", "8", "--iterations", "6", "--steps", "300"]
    out = demo("several_motions", *small)
    numbers = summary(out)
    assert len(numbers["psi_by_design"]) == 8 and len(numbers["motions"]) == 6
    for values in numbers["psi_by_design"].values():
        assert list(values) == list(numbers["motions"]) and min(values.values()) > 0.0
    assert min(numbers["largest_ratio"].values()) >= 1.0
    for name in ("trade_off", "design", "history", "scene_slow", "scene_fast"):
        assert (out / f"{name}.png").stat().st_size > 5000, name
    assert "psi of fast, heavy" in read_history(out / "worst_case" / "history.csv")
    assert "Reported, weighted" in (out / "report.html").read_text()


@pytest.mark.mpi
def test_six_motions_on_several_ranks() -> None:
    """The demo's numbers are those of one rank."""
    found = []
    for comm in (MPI.COMM_SELF, MPI.COMM_WORLD):
        problem = importlib.import_module("several_motions").six_motions(comm, (20, 4), 250)
        found.append(problem.value(0.7 * np.ones(problem.flexible["rod"].domain.n_cells)).motions)
    alone, shared = ([motion.psi for motion in motions.values()] for motions in found)
    assert len(shared) == 6 and shared == pytest.approx(alone, rel=1e-9)


@pytest.mark.mpi
@pytest.mark.parametrize("scene", ["slider_crank", "four_bar"])
def test_equivalent_static_loads(demo: Callable[..., Path], scene: str) -> None:
    """The static problem gives back psi under its own loads, which the demo asserts."""
    options = ["--elements", "30", "6", "--iterations", "2", "--cycles", "1"]
    numbers = summary(demo("equivalent_static_loads", "--scene", scene, *options))
    ways = [found for found in numbers.values() if isinstance(found, dict)]
    assert [found["simulations"] for found in ways] == [4, 2, 4]
    assert [found["adjoints"] for found in ways] == [2, 0, 0]
    assert all(np.isfinite(found["psi_over_full"]) for found in ways)


def test_readme_shows_the_short_program() -> None:
    """README's program is the one that is run here."""
    blocks = re.findall(r"```python\n(.*?)```", (TOP / "README.md").read_text(), re.DOTALL)
    program = (TOP / "demos" / "short.py").read_text().split('"""\n', 1)[1].strip()
    assert any(block.strip() == program for block in blocks)


def test_short_program(tmp_path: Path) -> None:
    """The short program runs as it stands, but for a coarser mesh and fewer iterations."""
    text = (TOP / "demos" / "short.py").read_text()
    coarse = text.replace("(200, 20)", "(40, 6)").replace("iterations=60", "iterations=2")
    assert coarse != text
    program = tmp_path / "short.py"
    program.write_text(coarse)
    run(cwd=tmp_path, program=program)
    assert (tmp_path / "results" / "short" / "motion.gif").stat().st_size > 10_000


@pytest.fixture(scope="module")
def curved_rod(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The mesh that the mesh program writes: curved triangles, not the dimensions of the demo."""
    folder = tmp_path_factory.mktemp("mesh")
    program = TOP / "demos" / "meshes" / "connecting_rod.py"
    size = ("--size", "0.01", "--length", "0.3", "--output", "rod.msh")
    run(*size, cwd=folder, program=program)
    return folder / "rod.msh"


@pytest.mark.parametrize(("name", "order"), [("slider_crank", "2"), ("connecting_rod", "1")])
def test_mesh_of_the_connecting_rod_takes_the_place_of_the_rod(
    curved_rod: Path, undrawn: Callable[..., Path], name: str, order: str
) -> None:
    """What the mesh program writes, the demos read."""
    mesh = ("--mesh", str(curved_rod))
    short = ("--iterations", "16", *(("--steps", "200") if name == "slider_crank" else ()))
    numbers = summary(undrawn(name, *mesh, "--order", order, *short))
    assert numbers["compliance_final"] < numbers["compliance_initial"]


#: Demos, settings for which they take seconds, and pictures that they leave; those that stand first
#: run on several ranks too, with two bodies and on a mesh of gmsh
SCENES = {
    "four_bar": (
        ["--elements", "24", "4", "--steps", "200", "--iterations", "5"],
        ["coupler.png", "rocker.png", "history.png", "motion.gif"],
    ),
    "connecting_rod": (
        ["--size", "0.008", "--order", "1", "--iterations", "16"],
        [*FILES, *PART, "stress_design.png", "stress_full_rod.png"],
    ),
    "spin_up": (["--elements", "20", "1", "--steps", "1500"], ["tip.png", "motion.gif"]),
    "pendulum": (["--elements", "20", "1", "--steps", "200"], ["modes.png", "motion.gif"]),
    "robot_arm": (
        ["--elements", "30", "4", "--steps", "120", "--iterations", "4"],
        ["trade_off.png", "tip.png", "upper_arm.png", "forearm.png", "motion.gif"],
    ),
}


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.mpi] * (k < 2)) for k, name in enumerate(SCENES)],
)
def test_scene(name: str, demo: Callable[..., Path]) -> None:
    """A demo's own assertions hold, and its files are there."""
    options, files = SCENES[name]
    out = demo(name, *options)
    numbers = summary(out)
    assert numbers
    if "compliance_initial" in numbers:
        assert numbers["compliance_final"] < numbers["compliance_initial"]
    for file in [*files, "scene.png"]:
        assert (out / file).stat().st_size > 500, file


def test_four_bar_on_mesh_files(undrawn: Callable[..., Path], tmp_path: Path) -> None:
    """Gmsh files take the place of both links; the linkage closes with their lengths."""
    write_rod(tmp_path / "rod.msh")
    meshes = ["--coupler-mesh", "rod.msh", "--rocker-mesh", "rod.msh"]
    out = undrawn("four_bar", *meshes, "--steps", "100", "--iterations", "3")
    assert summary(out)["volume_coupler"] <= 0.5 * (1 + 1e-6)


#: Demos, their options, and the meshes that take the place of their bodies: option, length, height
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
}


@pytest.mark.parametrize("name", ON_MESHES)
def test_gmsh_file_takes_the_place_of_the_built_in_mesh(
    name: str, undrawn: Callable[..., Path], tmp_path: Path
) -> None:
    """Other demos run on files of gmsh, their own assertions hold, and they leave their numbers."""
    options, meshes = ON_MESHES[name]
    for option, length, height, size in meshes:
        write_rod(tmp_path / f"{option[2:]}.msh", length=length, height=height, size=size)
        options = [*options, option, f"{option[2:]}.msh"]
    assert summary(undrawn(name, *options))
