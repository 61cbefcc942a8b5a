# SPDX-License-Identifier: MIT
"""The demos on small meshes: as programs of a user, in this process on its ranks, on mesh files."""

from __future__ import annotations

import importlib
import inspect
import json
import re
import shutil
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import spatial_robot_arm
from matplotlib.figure import Figure
from PIL import Image
from shared import TOP
from shared.derivatives import check_gradient
from shared.meshes import write_rod
from slider_crank import reference_problem, simple_designs
from spatial_blade import blade_problem
from spatial_slider_crank import slider_of, spatial_problem

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting, read_history
from dolfinx_ffr.part import export

# on meshes as coarse as here designs are not what they should be, and say so
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::UserWarning")]


def run(name: str, folder: Path, *arguments: str) -> Path:
    """The output of the main function of a demo, on the ranks at hand, with a short film."""
    # tests/plotting looks at films, and the short program has a whole one
    film = plotting.animate_motion
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(plotting, "animate_motion", lambda *a, **k: film(*a, **{**k, "frames": 6}))
        importlib.import_module(name).main([*arguments, "--output", str(folder / "out")])
    MPI.COMM_WORLD.Barrier()
    return folder / "out"


@pytest.fixture
def demo(shared_tmp_path: Path) -> Callable[..., Path]:
    """A function that runs a demo, and gives its output."""
    return lambda name, *arguments: run(name, shared_tmp_path, *arguments)


def assert_left(folder: Path, *names: str) -> None:
    """Demand files that hold something."""
    for name in names:
        assert (folder / name).stat().st_size > 500, name


def summary(folder: Path) -> dict[str, Any]:
    """The numbers that a demo has left."""
    return json.loads((folder / "summary.json").read_text())  # type: ignore[no-any-return]


@pytest.fixture
def undrawn(demo: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Run a demo for its numbers: pictures are put together and not drawn, films left out.

    Of films and the report the arguments are looked at, and whether there is what they need.
    """

    def left_out(function: Callable[..., Any]) -> Callable[..., None]:
        takes = inspect.signature(function)

        def called(*arguments: Any, **options: Any) -> None:
            problem, evaluation = (*takes.bind(*arguments, **options).args, None)[:2]
            if isinstance(problem, ffr.Problem):
                assert set(evaluation.bodies) == set(problem.flexible) and evaluation.trajectory
            else:
                assert problem.rank > 0 or (evaluation / "summary.json").exists()

        return called

    monkeypatch.setattr(plotting, "animate_motion", left_out(plotting.animate_motion))
    monkeypatch.setattr(Figure, "savefig", lambda _, path, **__: Path(path).touch())
    # solids of gmsh are those of the slider-crank's files, and of tests/part
    monkeypatch.setitem(export._WRITERS, ".step", lambda part, path, unit: path.touch())
    monkeypatch.setattr(ffr, "write_report", left_out(ffr.write_report))
    return demo


STEPS = 200
SMALL = ["--elements", "40", "4", "--steps", f"{STEPS}", "--boundary", "1", "--iterations", "6"]
FILES = ["design.xdmf", "design.h5", "design.png", "history.png", "motion.gif", "modes.png"]
PART = ["part.svg", "part.dxf", "part.step", "part.stl", "part.png"]


@pytest.mark.mpi
def test_slider_crank_on_any_number_of_ranks(undrawn: Callable[..., Path]) -> None:
    """The program on several ranks finds the same design as a call on one."""
    iterations = 3
    out = undrawn("slider_crank", *SMALL[:5], "--boundary", "0", "--iterations", f"{iterations}")
    numbers, history = summary(out), read_history(out / "history.csv")
    assert numbers["ranks"] == MPI.COMM_WORLD.size
    assert numbers["elements"] == {"rod": 160}
    problem = reference_problem(MPI.COMM_SELF, (40, 4), steps=STEPS)
    domain = problem.flexible["rod"].domain
    for name, x in simple_designs(domain).items():
        assert numbers[f"compliance_{name}"] == pytest.approx(problem.value(x).psi, rel=1e-7)
    with warnings.catch_warnings():  # no good design in so few iterations
        warnings.simplefilter("ignore")
        options = {"volume": 0.5, "iterations": iterations, "boundary": 0, "progress": False}
        even = problem.gradient(simple_designs(domain)["even"]).gradient["rod"]
        levelset = ffr.LevelSet(domain, mirrors=ffr.mirror_lines(domain, even))
        serial_result = ffr.optimize(problem, levelset, **options)
    np.testing.assert_allclose(history["psi"], serial_result.history["psi"], rtol=1e-7)


def test_files_of_the_slider_crank(demo: Callable[..., Path]) -> None:
    out = demo("slider_crank", *SMALL)
    assert_left(out, *FILES, *PART, "report.html")
    history = read_history(out / "history.csv")
    assert len(history["psi"]) == 7
    # the law of cut elements tells of a stiffer rod than that of densities
    numbers = summary(out)
    final = numbers["compliance_final"]
    assert 0.5 * history["psi"].min() < final < history["psi"].min()
    assert numbers["psi"] == final
    verified = numbers["verification"]
    assert verified["bodies"]["rod"]["pieces"] == 1
    assert verified["change"] < 0.01
    by_steps = numbers["boundary"]["psi"] / final  # by the steps of the boundary
    assert numbers["boundary"]["steps"] == 1 and 0.5 < by_steps < 1.5
    relative = by_steps * numbers["compliance_final_relative"] * (1.0 + verified["difference"])
    assert numbers["compliance_part_relative"] == pytest.approx(relative, rel=1e-9)
    with Image.open(out / "motion.gif") as film:
        assert film.n_frames == 6
        pictures = []
        for frame in (0, film.n_frames // 3):
            film.seek(frame)
            pictures.append(np.asarray(film.convert("L"), dtype=float))
    assert np.mean(np.abs(pictures[0] - pictures[1])) > 0.5  # something moves


def test_short_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """README's program runs as it stands, but for a coarser mesh and fewer iterations."""
    text = (TOP / "demos" / "short.py").read_text()
    blocks = re.findall(r"```python\n(.*?)```", (TOP / "README.md").read_text(), re.DOTALL)
    program = text.split('"""\n', 1)[1].strip()
    assert any(block.strip() == program for block in blocks)
    coarse = text.replace("(200, 20)", "(40, 6)").replace("iterations=36", "iterations=2")
    assert coarse != text
    monkeypatch.chdir(tmp_path)
    exec(compile(coarse, "short.py", "exec"), {"__name__": "__main__"})
    assert (tmp_path / "results" / "short" / "motion.gif").stat().st_size > 10_000


#: Demos, settings for which they take seconds, and pictures that they leave
MILLED = ["--elements", "40", "8", "--steps", "60"]
SCENES = {
    "four_bar": (
        ["--elements", "24", "4", "--steps", "200", "--iterations", "4"],
        ["coupler.png", "rocker.png", "history.png", "motion.gif"],
    ),
    "connecting_rod": (
        ["--size", "0.01", "--order", "1", "--iterations", "8", "--boundary", "0"],
        [*FILES, *PART, "stress_part.png", "stress_full_rod.png"],
    ),
    "spin_up": (["--elements", "20", "1", "--steps", "1500"], ["tip.png", "motion.gif"]),
    "pendulum": (["--elements", "20", "1", "--steps", "200"], ["tip.png", "motion.gif"]),
    "robot_arm": (
        ["--elements", "30", "4", "--steps", "120", "--iterations", "4"],
        ["trade_off.png", "upper_arm.png", "upper_arm.xdmf", "forearm.png", "motion.gif"],
    ),
    "balanced_arm": (["--steps", "200"], ["moment.png", "scene.png", "motion.gif", "report.html"]),
    "arm_and_motion": (
        ["--size", "0.04", "--steps", "60", "--iterations", "3"],
        ["swing.png", "scene.png", "motion.gif", "report.html"],
    ),
    "path_of_a_four_bar": (["--steps", "30", "--iterations", "12"], ["path.png", "motion.gif"]),
    "slider_crank": (
        ["--densities", "--elements", "30", "4", "--iterations", "3"],
        ["design.png", "history.csv", "motion.gif"],
    ),
    "milled_rod": (
        [*MILLED, "--iterations", "2", "--boundary", "1", "--tetrahedra", "0.04"],
        ["design.png", "part.png", "motion.gif", "report.html"],
    ),
    "several_load_cases": (
        ["--elements", "20", "4", "--iterations", "2", "--boundary", "1", "--steps", "60"],
        ["history.png", "scene_slow.png", "scene_fast.png", "report.html", "motion.gif"],
    ),
    "approximate_gradient": (
        ["--elements", "24", "6", "--iterations", "3"],
        ["histories.png", "elements.png", "design.png", "motion.gif"],
    ),
}


#: Those that draw, also of parameters and of several load cases; the others call the same
#: functions, whose pictures tests/plotting looks at
DRAWN = ("balanced_arm", "several_load_cases")


@pytest.mark.parametrize("name", SCENES)
def test_scene(name: str, request: pytest.FixtureRequest) -> None:
    """A demo's own assertions hold, and its files are there; some draw them."""
    options, files = SCENES[name]
    drawn = name in DRAWN
    out = request.getfixturevalue("demo" if drawn else "undrawn")(name, *options)
    numbers = summary(out)
    assert numbers
    if name == "connecting_rod":
        assert numbers["compliance_final"] < numbers["compliance_initial"]
    if drawn:
        assert_left(out, *files)
    assert all((out / file).exists() for file in files if file[-3:] in ("png", "csv", "dmf"))


#: Demos whose bodies may come from files of gmsh, by the options that name them
ON_MESHES = {
    "slider_crank": ["mesh"],
    "four_bar": ["coupler-mesh", "rocker-mesh"],
}


@pytest.mark.parametrize("name", ON_MESHES)
def test_gmsh_files_take_the_places_of_built_in_meshes(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Of all bodies; ``connecting_rod`` below runs as a whole on a mesh of gmsh."""
    write_rod(tmp_path / "rod.msh")
    bodies: list[ffr.FlexibleBody] = []
    make = ffr.FlexibleBody

    def made(domain: ffr.Domain, *arguments: Any, **options: Any) -> ffr.FlexibleBody:
        bodies.append(make(domain, *arguments, **options))
        if len(bodies) == len(ON_MESHES[name]):
            raise KeyboardInterrupt
        return bodies[-1]

    monkeypatch.setattr(ffr, "FlexibleBody", made)
    options = [f"--{option}={tmp_path / 'rod.msh'}" for option in ON_MESHES[name]]
    with pytest.raises(KeyboardInterrupt):
        importlib.import_module(name).main([*options, f"--output={tmp_path}"])
    assert [body.domain.cell for body in bodies] == ["triangle"] * len(bodies)


def test_way_of_the_slider() -> None:
    """The closed form, beside E. J. Haug's numbers for angles that he counts from z."""
    for degrees, x in ((0, 0.2), (45, 0.238615293517), (90, 0.274226184016), (180, 0.28)):
        assert slider_of(np.radians(degrees + 90.0)) == pytest.approx(x, abs=1e-12)


@pytest.mark.mpi
def test_design_in_space_on_any_number_of_ranks(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The program leaves its files; several ranks, which draw none, find the design of one."""
    several = MPI.COMM_WORLD.size > 1
    demo = request.getfixturevalue("undrawn" if several else "demo")
    for name in ("animate_motion", "plot_scene"):
        monkeypatch.setattr(plotting, name, lambda *_, **__: None)
    small = ["--elements", "12", "3", "3", "--steps", "200", "--iterations", "2"]
    out = demo("spatial_slider_crank", *small, "--boundary", "0")
    assert_left(out, "design.xdmf", "solid.stl")
    if not several:
        return assert_left(out, "design.png", "solid.png", "stress.png", "report.html")
    problem = spatial_problem(MPI.COMM_SELF, (12, 3, 3), steps=200)
    with warnings.catch_warnings():  # no good design in so few iterations
        warnings.simplefilter("ignore")
        levelset = ffr.LevelSet(problem.flexible["rod"].domain)
        serial_result = ffr.optimize(problem, levelset, volume=0.5, iterations=2, progress=False)
    assert summary(out)["compliance_final"] == pytest.approx(serial_result.psi, rel=1e-6)


def test_arm_follows_its_motors(demo: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """The program of the arm leaves its files, and its hand is where that of a rigid arm is."""
    monkeypatch.setattr(plotting, "animate_motion", lambda *_, **__: None)
    small = ["--elements", "12", "3", "3", "--steps", "150", "--iterations", "2"]
    out = demo("spatial_robot_arm", *small)
    assert summary(out)["error_full"] < 0.01 * spatial_robot_arm.FORE[0]
    assert_left(out, "scene.png", "forearm/solid.stl", "upper_arm.xdmf", "report.html")


def test_pull_stiffens_the_blade(comm: MPI.Comm) -> None:
    """It bends less than a linear one, and the gradient holds the nine loads of rotation."""
    problem, linear = (
        blade_problem(comm, (8, 3, 1), stiffening=stiffening, steps=200)
        for stiffening in (True, False)
    )
    domain = problem.flexible["blade"].domain
    ones = np.ones(domain.n_cells)
    assert problem.value(ones).psi < 0.9 * linear.value(ones).psi
    c = domain.centroids
    x = np.where(domain.design_cells, 0.7 + 0.2 * np.sin(40 * c[:, 0] + 90 * c[:, 1]), 1.0)
    direction = np.cos(60 * c[:, 0] - 70 * c[:, 1]) * domain.design_cells
    # thin elements of order 2 are ill-conditioned: the spread over densities that hardly differ
    values = [problem.value(x * (1.0 - k * 1e-13)).psi for k in range(4)]
    roundoff = 4.0 * float(np.ptp(values)) / values[0]
    way = {"blade": x}, {"blade": direction}
    check_gradient(problem, *way, taylor=0.04, roundoff=roundoff)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="no ccx, as on Debian 13")
def test_a_part_from_calculix(undrawn: Callable[..., Path]) -> None:
    """Frequencies to 1e-8 and psi to 1e-6 of the same mesh, which the demo asserts."""
    undrawn("part_from_calculix", "--size", "0.02")


def test_a_rod_in_exudyn(undrawn: Callable[..., Path]) -> None:
    """Its motion from the file is ours to 1e-6, which the demo asserts."""
    pytest.importorskip("exudyn", reason="PyPI has no Exudyn for this Python")
    out = undrawn("rod_in_exudyn", "--elements", "30", "4", "--iterations", "15")
    part = ffr.VolumeIntegrals.load(out / "rod.SID_FEM")
    again = ffr.VolumeIntegrals.load(out / "rod.npz", format="exudyn")
    np.testing.assert_allclose(part.P, again.P, atol=1e-12)
