# SPDX-License-Identifier: MIT
"""The programs of the documentation run as they stand, but for coarser meshes and fewer steps."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest
from shared import TOP

import dolfinx_ffr as ffr

PAGE = TOP / "docs" / "scenes.md"
#: Pages whose programs stand alone
PARTS = TOP / "docs" / "from_field_to_part.md"
#: A page whose programs go on from the slider-crank and from each other
MOTIONS = TOP / "docs" / "several_motions.md"
#: Numbers that say how long a program takes, and those of a test
SHORTER = [
    (r"elements=\(\d+, \d+\)", "elements=(20, 4)"),
    (r"iterations=\d+", "iterations=2"),
    (r"GeneralizedAlpha\(([\d.]+), \d+\)", r"GeneralizedAlpha(\1, 120)"),
    (r"steps=\d+", "steps=120"),
    (
        r'plotting\.animate_motion\((.*?), "motion.gif"',
        r'plotting.animate_motion(\1, "motion.gif", frames=3',
    ),
]


def programs(page: Path) -> list[tuple[str, str]]:
    """The heading and the text of each program of a page."""
    heading, found = "", []
    for match in re.finditer(
        r"^##+ ([^\n]+)$|^```python\n(.*?)^```", page.read_text(), re.M | re.S
    ):
        if match.group(1):
            heading = match.group(1)
        else:
            found.append((heading, match.group(2)))
    return found


def shorter(program: str) -> str:
    """A program with a coarser mesh, fewer steps and iterations."""
    for pattern, text in SHORTER:
        program = re.sub(pattern, text, program)
    return program


def beginning(program: str) -> str:
    """What must stand before some lines that are no program: a scene of the page."""
    if "import dolfinx_ffr" in program:
        return ""
    scenes = dict(programs(PAGE))
    if "coupler" in program:
        links = "coupler, rocker = meshes['coupler'], meshes['rocker']\n"
        return shorter(scenes["Four-bar linkage"]) + links
    return shorter(scenes["Slider-crank"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("heading", "program"), programs(PAGE), ids=[heading for heading, _ in programs(PAGE)]
)
@pytest.mark.filterwarnings("ignore")
def test_program_of_a_scene(
    heading: str, program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It runs, and its numbers are finite; lines that are no program go on from a scene."""
    from shared.meshes import write_rod

    monkeypatch.chdir(tmp_path)
    if ".msh" in program:
        write_rod(tmp_path / "rod.msh")
    before = beginning(program)
    if before:
        program = program.replace("volume=", "iterations=2, volume=")
    names: dict[str, object] = {}
    # the documentation is ours
    exec(compile(before + shorter(program), f"{PAGE.name}, {heading}", "exec"), names)
    for name in ("result", "evaluation"):
        if name in names:
            assert 0.0 < names[name].psi < float("inf")  # type: ignore[attr-defined]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("heading", "program"), programs(PARTS), ids=[heading for heading, _ in programs(PARTS)]
)
@pytest.mark.filterwarnings("ignore")
def test_program_of_a_part(
    heading: str, program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It runs; a full rod stands for the design, which so few iterations leave in pieces."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    full = "part = ffr.Part(rod, lambda x: 1.0 + x[:, 0], material=steel)"
    program = re.sub(r"part = ffr\.Part\.of\(.*\)", full, program)
    exec(compile(shorter(program), f"{PARTS.name}, {heading}", "exec"), names)
    files = {path.suffix for path in tmp_path.rglob("*.*")}
    if "solid" in names:
        assert isinstance(names["solid"], ffr.Solid)
        assert files == {".stl"}
        return
    part = names["part"]
    assert isinstance(part, ffr.Part)
    assert files >= ({".svg", ".dxf", ".step", ".stl", ".png"} if part.material else {".dxf"})


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_programs_of_several_motions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They run one after the other, and what they ask for is there."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    scene = shorter(dict(programs(PAGE))["Slider-crank"])
    lines = "x = 0.7 * np.ones(rod.n_cells)\n"
    text = "\n".join(program for _, program in programs(MOTIONS))
    exec(compile(scene + lines + shorter(text), MOTIONS.name, "exec"), names)
    evaluation = names["apart"]
    assert isinstance(evaluation, ffr.Evaluation)
    assert list(evaluation.motions) == ["slow", "fast"]
    assert all(motion.gradient for motion in evaluation.motions.values())
    assert (tmp_path / "results" / "fast.png").exists()


def test_names_on_the_page_exist() -> None:
    """Each name in code that looks like one of the package is one, and none is missing."""
    text = PAGE.read_text()
    called = set(re.findall(r"\bffr\.(\w+)", text + PARTS.read_text() + MOTIONS.read_text()))
    assert not called - set(dir(ffr))
    for module in ("mechanism", "objective"):
        kinds = importlib.import_module(f"dolfinx_ffr.{module}").__all__
        public = [name for name in kinds if name in ffr.__all__]
        missing = [name for name in public if not re.search(rf"`[^`\n]*\b{name}\b", text)]
        assert public and not missing, f"{missing} of {module} are not in {PAGE.name}"


def test_pictures_are_small() -> None:
    text = "".join(page.read_text() for page in (PAGE, PARTS, MOTIONS))
    for target in re.findall(r"!\[.*?\]\(([^)]+)\)", text):
        assert (PAGE.parent / target).stat().st_size < 150_000, target
