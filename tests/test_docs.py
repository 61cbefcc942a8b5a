# SPDX-License-Identifier: MIT
"""The programs of the documentation run as they stand, but for coarser meshes and fewer steps."""

from __future__ import annotations

import importlib
import json
import re
import sys
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared import TOP

import dolfinx_ffr as ffr

PAGE = TOP / "docs" / "scenes.md"
HOW_TO = [*sorted((TOP / "docs" / "how_to").glob("*.md")), TOP / "docs" / "how_good.md"]
#: One program over several pages
TUTORIAL = sorted((TOP / "docs" / "tutorial").glob("[1-9]*.md"))
NOTEBOOKS = sorted((TOP / "docs" / "notebooks").glob("*.ipynb"))
#: A page whose programs go on from the slider-crank
PARTS = TOP / "docs" / "from_field_to_part.md"
#: A page whose programs go on from the slider-crank and from each other
MOTIONS = TOP / "docs" / "several_load_cases.md"
#: Numbers that say how long a program takes, and those of a test
SHORTER = [
    (r"elements=\(\d+, \d+\)", "elements=(20, 4)"),
    (r"elements=\(\d+, \d+, \d+\)", "elements=(10, 3, 3)"),
    (r"iterations=\d+", "iterations=2"),
    (r"GeneralizedAlpha\(([\d.]+), \d+\)", r"GeneralizedAlpha(\1, 120)"),
    (r"steps=\d+", "steps=120"),
    (r'(animate_motion\(.*?), "motion.gif"', r'\1, "motion.gif", frames=3'),
]


def programs(page: Path) -> list[tuple[str, str]]:
    """The heading and the text of each program of a page."""
    heading, computed = "", []
    pattern = re.compile(r"^##+ ([^\n]+)$|^```python\n(.*?)^```", re.M | re.S)
    for match in pattern.finditer(page.read_text()):
        if match.group(1):
            heading = match.group(1)
        else:
            computed.append((heading, match.group(2)))
    return computed


def shorter(program: str) -> str:
    """A program with a coarser mesh, fewer steps and iterations, no steps of boundaries unasked."""
    for pattern, text in SHORTER:
        program = re.sub(pattern, text, program)
    if "boundary" not in program:
        program = re.sub(r"(optimize\((?:.|\n)*?)volume=", r"\1boundary=0, volume=", program)
    return program


def full(program: str) -> str:
    """A shorter program whose design stays full, as few iterations leave others in pieces.

    Its time steps are given.
    """
    pattern = r"optimize\((\w+), (levelset|densities|ffr\.LevelSet\(rod\)), volume=0\.5"
    start = r"optimize(\1, \2, np.ones(\2.size), boundary=0, volume=1.0"
    program = re.sub(r"TimeInterval\(([\d.]+)\)", r"GeneralizedAlpha(\1, 80)", program)
    return shorter(re.sub(pattern, start, program))


def run(program: str, name: str, before: dict[str, Any] | None = None) -> dict[str, Any]:
    """The names that a program of the documentation, which is ours, defines, and those before."""
    names = dict(before or {})
    exec(compile(program, name, "exec"), names)
    return names


@cache
def scene(name: str) -> dict[str, Any]:
    """What a scene of the page defines, for lines that are no program and go on from it."""
    return run(shorter(dict(programs(PAGE))[name]), name)


def beginning(program: str) -> dict[str, Any]:
    """What must stand before some lines: nothing before a program, else a scene of the page."""
    if "import dolfinx_ffr" in program:
        return {}
    if "coupler" in program:
        names = scene("Four-bar linkage")
        return {**names, **{link: names["meshes"][link] for link in ("coupler", "rocker")}}
    return dict(scene("Slider-crank"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "given",
    [(heading or page.stem, text) for page in (PAGE, *HOW_TO) for heading, text in programs(page)],
    ids=lambda given: given[0],
)
@pytest.mark.filterwarnings("ignore")
def test_scenes(given: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They run, and their numbers are finite; lines that are no program go on from a scene."""
    from shared.meshes import write_rod

    monkeypatch.chdir(tmp_path)
    heading, program = given
    if ".msh" in program:
        write_rod(tmp_path / "rod.msh")
    earlier = beginning(program)
    if earlier:
        program = re.sub(r"(optimize\((?:.|\n)*?)volume=", r"\1iterations=2, volume=", program)
    names = run(shorter(program), heading, earlier)
    for name in ("result", "evaluation"):
        if name in names:
            assert 0.0 < names[name].psi < float("inf")


@pytest.mark.filterwarnings("ignore")
def test_two_lines_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The program of the page on machine and part, after the short one."""
    monkeypatch.chdir(tmp_path)
    heading = "Two lines more"
    program = dict(programs(TOP / "docs" / "machine_and_part.md"))[heading]
    earlier = shorter(dict(programs(PAGE))["Slider-crank"]) + "levelset = ffr.LevelSet(rod)\n"
    steps = program.replace("ffr.TimeInterval(2.0)", "ffr.GeneralizedAlpha(2.0, 120)")
    names = run(earlier + shorter(steps), heading)
    result = names["result"]
    assert result.parameters.keys() == {"radius", "load"} and 0.0 < result.psi < float("inf")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_tutorial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its five pages are one program, whose numbers are finite; the design stays a full arm."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for page in TUTORIAL:
        text = full("\n".join(program for _, program in programs(page)))
        names = run(text, page.name, names)
    assert len(TUTORIAL) == 5 and names["together"].parameters.keys() == {"stiffness"}
    assert 0.0 < names["together"].psi < float("inf")
    for name in ("full", "result", "verification"):
        assert 20 < len(repr(names[name])) < 1000
    assert "<td>psi of the densities</td>" in names["result"]._repr_html_()


@pytest.mark.slow
def test_notebooks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They run one after the other in one kernel, and each shows tables and pictures."""
    kernel = tmp_path / "kernels" / "own" / "kernel.json"
    kernel.parent.mkdir(parents=True)
    command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    kernel.write_text(json.dumps({"argv": command, "display_name": "own", "language": "python"}))
    for variable in ("JUPYTER_PATH", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR"):
        monkeypatch.setenv(variable, str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(TOP / "src"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Debian's packages for notebooks warn of each other
        import nbformat
        from nbclient import NotebookClient

        books = [nbformat.read(notebook, as_version=4) for notebook in NOTEBOOKS]
        together = nbformat.v4.new_notebook(cells=[cell for book in books for cell in book.cells])
        for cell in together.cells:
            cell.source = full(cell.source)
        resources = {"metadata": {"path": tmp_path}}
        NotebookClient(together, kernel_name="own", resources=resources).execute()
    for book in books:
        outputs = [output for cell in book.cells for output in cell.get("outputs", [])]
        kinds = {kind for output in outputs for kind in output.get("data", {})}
        assert "text/html" in kinds and kinds & {"image/png", "image/gif"}


def test_integrals_from_another_program() -> None:
    """They give the energy of each motion of rigid body and basis that the full matrices do."""
    heading = "From another finite-element program"
    names = run(dict(programs(TOP / "docs" / "how_to" / "arrays.md"))[heading], heading)
    body, X, Phi, M = (names[name] for name in ("body", "X", "Phi", "M"))
    rigid = np.zeros((*X.shape, 6))
    rigid[:, :, :3] = np.eye(3)
    rigid[:, :, 3:] = -np.cross(X[:, None], np.eye(3)).transpose(0, 2, 1)  # e_k x X in columns
    fields = np.column_stack([rigid.reshape(-1, 6), Phi])
    np.testing.assert_allclose(body.mass_matrix(), fields.T @ (M @ fields), atol=1e-14)
    assert body.mass == pytest.approx(84 * 0.004)
    # the body's frequencies are those of the program's matrices
    squares = np.diag(Phi.T @ (names["K"] @ Phi)) / np.diag(Phi.T @ (M @ Phi))
    np.testing.assert_allclose(np.diag(body.K) / np.diag(body.G)[1:], squares, rtol=1e-12)


def test_columns_and_sign_of_multipliers() -> None:
    """Derivatives with respect to a force of a joint are minus those to its multipliers."""
    body = ffr.VolumeIntegrals.rigid(2.0, inertia=0.1, markers={"pin": (0.3, 0.0)})
    hinge = ffr.Revolute(("body", "pin"), ffr.Ground(), name="hinge")
    mechanism = ffr.Mechanism({"body": ffr.Placement((-0.3, 0.0))}, [hinge], gravity=(0.0, -9.81))
    motion = ffr.simulate(mechanism, {"body": body}, ffr.GeneralizedAlpha(0.1, 10))
    columns = motion.model.joints["hinge"]
    np.testing.assert_array_equal(motion.multipliers[:, columns], -motion.joint_force("hinge"))
    bar = ffr.JointForce("hinge").derivatives(ffr.Response(motion, motion.model.bodies)).trajectory
    force = motion.joint_force("hinge")
    along = np.sum(bar.multipliers[:, columns] * -force)
    # psi is a mean of the size of the force: its derivative along the force is psi
    psi = ffr.JointForce("hinge").evaluate(ffr.Response(motion, motion.model.bodies))
    assert along == pytest.approx(psi)


@pytest.mark.slow
@pytest.mark.parametrize("given", programs(PARTS), ids=lambda given: given[0])
@pytest.mark.filterwarnings("ignore")
def test_parts(given: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A full rod stands for the design, which so few iterations leave in pieces."""
    monkeypatch.chdir(tmp_path)
    full = "part = ffr.Part(rod, lambda x: 1.0 + x[:, 0], material=steel)"
    program = re.sub(r"part = ffr\.Part\.of\(.*\)", full, given[1])
    names = run(shorter(program), f"{PARTS.name}, {given[0]}", scene("Slider-crank"))
    files = {path.suffix for path in tmp_path.rglob("*.*")}
    if "solid" in names:
        assert isinstance(names["solid"], ffr.Solid)
        assert files - {".png"} == {".stl"}  # the scene draws a picture
        return
    part = names["part"]
    assert isinstance(part, ffr.Part)
    assert files >= ({".svg", ".dxf", ".step", ".stl", ".png"} if part.material else {".dxf"})


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_programs_of_several_load_cases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They run one after the other, and what they ask for is there."""
    monkeypatch.chdir(tmp_path)
    earlier = scene("Slider-crank")
    x = 0.7 * np.ones(earlier["rod"].n_cells)
    text = "\n".join(program for _, program in programs(MOTIONS))
    names = run(shorter(text), MOTIONS.name, {**earlier, "x": x})
    evaluation = names["apart"]
    assert isinstance(evaluation, ffr.Evaluation)
    assert list(evaluation.load_cases) == ["slow", "fast"]
    assert all(motion.gradient for motion in evaluation.load_cases.values())
    assert (tmp_path / "results" / "fast.png").exists()


def test_names_on_the_page_exist() -> None:
    """Each name in code that looks like one of the package is one, and none is missing."""
    text = "".join(page.read_text() for page in (PAGE, *HOW_TO, *TUTORIAL))
    called = set(re.findall(r"\bffr\.(\w+)", text + PARTS.read_text() + MOTIONS.read_text()))
    assert not called - set(dir(ffr))
    for module in ("mechanism", "objective"):
        kinds = vars(importlib.import_module(f"dolfinx_ffr.{module}"))
        public = [name for name in kinds if name in ffr.__all__]
        missing = [name for name in public if not re.search(rf"`[^`\n]*\b{name}\b", text)]
        assert public and not missing, f"{missing} of {module} are not in docs/how_to"


def test_pictures_are_small() -> None:
    pictures = sorted((TOP / "docs" / "pictures").glob("*.png"))
    assert [picture.name for picture in pictures if picture.stat().st_size > 150_000] == []


def test_formulas_and_gallery(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each formula becomes MathML; one that does not is found; each demo has its card."""
    monkeypatch.syspath_prepend(str(TOP / "docs" / "site"))
    formulas, gallery = (importlib.import_module(name) for name in ("formulas", "gallery"))
    typed = (TOP / "docs" / "method.md").read_text()
    matches = re.findall(r"\$\$(.+?)\$\$|\$(.+?)\$", typed, re.S)
    assert len(matches) == 20
    for formula in map("".join, matches):
        set_formula = formulas.tex2mathml(formula)
        assert set_formula.startswith("<math") and not formulas.raw(set_formula)
    assert formulas.raw("<p>where $f &gt; 1$</p><pre>$HOME</pre>") == ["$f &gt; 1$"]
    assert formulas.raw(r"<p>\(f\)</p>") == [r"\(f\)</p>"[:-4]]
    cards = gallery.cards()
    for demo in gallery.demos() + gallery.examples():
        assert f"gallery/{demo.name}.md" in cards and demo.sentence and demo.time and demo.picture
