# SPDX-License-Identifier: MIT
"""The commands on scene files: design, check and new."""

from __future__ import annotations

import json
import os
import re
import signal
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from shared import processes

import dolfinx_ffr as ffr
from dolfinx_ffr import plotting, scene_file
from dolfinx_ffr.__main__ import _COMMANDS, main
from dolfinx_ffr.scene_file import commands

EXAMPLES = ("crane", "four_bar", "outline", "slider_crank", "spatial")
#: Coarser meshes and fewer steps
SMALLER = [
    (r"elements = \[\d+, \d+\]", "elements = [30, 6]"),
    (r"elements = \[\d+, \d+, \d+\]", "elements = [16, 3, 3]"),
    (r'size = "4 mm"', 'size = "10 mm"'),
    (r'solid_rim = "6 mm"', 'solid_rim = "10 mm"'),
    (r'minimum_member = "\d mm"', 'minimum_member = "12 mm"'),
    (r'kind = "TimeInterval"(.*?)\ntolerance = 1e-3', r'kind = "GeneralizedAlpha"\1\nsteps = 100'),
    (r"steps = 1000", "steps = 60"),
    (r'kind = "TimeInterval"(\nend_time = "2 s")', r'kind = "GeneralizedAlpha"\1\nsteps = 120'),
    (r"volume = 0\.\d+ .*\niterations = \d+", "volume = 1.0\nboundary = 0\niterations = 3"),
]


@pytest.fixture
def example(
    comm: MPI.Intracomm, shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[str], Path]:
    """A function that writes an example, smaller, and gives its path; films are short."""
    film = partial(plotting.animate_motion, frames=3)
    monkeypatch.setattr(plotting, "animate_motion", film)

    def written(name: str) -> Path:
        monkeypatch.chdir(shared_tmp_path)
        assert scene_file.new(name, Path()) == 0
        file = shared_tmp_path / f"{name}.toml"
        comm.Barrier()
        text = file.read_text()
        for pattern, new in SMALLER:
            text = re.sub(pattern, new, text, flags=re.S if "TimeInterval" in pattern else 0)
        comm.Barrier()
        if comm.rank == 0:
            file.write_text(text)
        comm.Barrier()
        return Path(file.name)

    return written


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.filterwarnings("ignore")
def test_examples_can_be_checked(
    name: str, example: Callable[[str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """Each is checked and drawn."""
    file = example(name)
    assert scene_file.check(file, output=None) == 0
    assert "; a design about " in capsys.readouterr().out
    assert Path("results", name, "check.png").stat().st_size > 5_000


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore")
def test_design_interrupted_and_resumed_on_several_ranks(
    comm: MPI.Intracomm,
    example: Callable[[str], Path],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Ctrl-C ends with 130 and a checkpoint; all files in the end."""
    file, folder = example("slider_crank"), Path("results", "slider_crank")

    def interrupt(iteration: int, x: np.ndarray, evaluation: ffr.Evaluation) -> None:
        if iteration == 2 and comm.rank == comm.size - 1:
            os.kill(os.getpid(), signal.SIGINT)

    def interrupted(file: Path) -> scene_file.Scene:
        scene = scene_file.read_scene(file)
        arguments = {**scene.run.arguments, "callback": interrupt}
        return replace(scene, run=replace(scene.run, arguments=arguments))

    with monkeypatch.context() as patched:
        patched.setattr(commands, "read_scene", interrupted)
        with pytest.raises(SystemExit) as ended:
            main(["design", str(file)])
    assert ended.value.code == 130
    assert comm.rank or f"dolfinx_ffr design {file} --resume" in capsys.readouterr().out
    assert {path.name for path in folder.iterdir()} <= {".lock", "checkpoint", "history.csv"}
    main(["design", str(file), "--resume"])
    assert ("report.html" in capsys.readouterr().out) == (comm.rank == 0)
    assert list(ffr.read_history(folder / "history.csv")["iteration"]) == list(range(4))
    # what is finished is not overwritten without a word
    again = ["design", str(file)]
    with pytest.raises(
        scene_file.SceneError, match=r"holds the results of an earlier run \(summary"
    ):
        main(again)
    names = "part.step part.dxf part.svg part.stl report.html motion.gif scene.png design.png"
    assert set(names.split()) <= {path.name for path in folder.iterdir()}
    record = json.loads((folder / "summary.json").read_text())
    assert record["references"]["full"] > 0.0


@pytest.mark.filterwarnings("ignore")
def test_what_only_the_package_knows_is_told_with_file_and_table(
    example: Callable[[str], Path],
) -> None:
    """Interfaces that are not there, numbers out of range, columns that are missing."""
    for name, old, new, message in (
        ("slider_crank", '"rod.right"\nl', '"rod.rihgt"\nl', "slider_crank.toml: .*'rihgt'"),
        ("outline", 'pin = "pin"', 'pin = "pni"', "bodies.lever.domain: .* 'pni'"),
        ("outline", 'value = "lever"', 'value = "arm"', "motions.swing: .* no column 'arm'"),
        ("outline", '"12 mm"', '"12 m"', "designs.lever: .*minimum_member .*too large"),
        ("outline", '"8 mm"', '"-8 mm"', "bodies.lever.material: .*thickness must be positive"),
    ):
        Path(f"{name}.toml").unlink(missing_ok=True)
        for companion in ("lever.dxf", "angles.csv"):
            Path(companion).unlink(missing_ok=True)
        file = example(name)
        file.write_text(file.read_text().replace(old, new, 1))
        with pytest.raises(scene_file.SceneError, match=message):
            scene_file.read_scene(file).made()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("volume = 50", r"volume of 'rod' must lie between 0 and 1, 0 excluded, but it is 50"),
        ("volume = { rood = 0.5 }", "volume is given for .'rood'., and the designs are of .'rod'."),
        ("boundary = -1", "boundary must be a whole number that is not negative"),
    ],
)
def test_check_looks_at_the_settings_of_the_run(
    example: Callable[[str], Path], setting: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything is simulated."""
    file = example("slider_crank")
    text, count = re.subn(
        r"\[optimize\].*", f"[optimize]\n{setting}\n", file.read_text(), flags=re.S
    )
    assert count == 1
    file.write_text(text)
    monkeypatch.setattr(ffr.Problem, "value", lambda *_: pytest.fail("it was simulated"))
    with pytest.raises(scene_file.SceneError, match=message):
        scene_file.check(file, output=None)


def test_results_are_overwritten_only_where_that_is_said(
    example: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of a finished run, and the checkpoint of one that was interrupted."""
    file, reached = example("slider_crank"), []

    def begun(scene: scene_file.Scene) -> None:
        reached.append(scene.title)
        raise KeyboardInterrupt

    monkeypatch.setattr(scene_file.Scene, "made", begun)
    for name in ("summary.json", "checkpoint"):
        folder = Path("results", name)
        folder.mkdir(parents=True)
        (folder / name).touch()
        for option in ([], ["--overwrite"], ["--resume"]):
            arguments = ["design", str(file), "--output", str(folder), *option]
            with pytest.raises(SystemExit if option else scene_file.SceneError) as ended:
                main(arguments)
            assert option or f"holds the results of an earlier run ({name})" in str(ended.value)
    assert len(reached) == 4


def test_a_title_that_the_terminal_has_not(example: Callable[[str], Path]) -> None:
    file = example("slider_crank")
    file.write_text(re.sub("title = .*", "title = 'Kürbel'", file.read_text()))
    code = "from pathlib import Path; from dolfinx_ffr import program, scene_file; "
    code += f"program.run(lambda: print(scene_file.read_scene(Path({str(file)!r})).title))"
    printed = processes.run("-c", code, PYTHONIOENCODING="ascii")
    assert printed.returncode == 0 and printed.stdout.strip() == r"K\xfcrbel", printed.stderr


@pytest.mark.slow
def test_errors_are_told_once_by_all_ranks(example: Callable[[str], Path]) -> None:
    file = example("slider_crank")
    file.write_text(file.read_text().replace("rod.right", "rod.top"))
    run = processes.run("-m", "dolfinx_ffr", "check", str(file), ranks=2)
    lines = [line for line in run.stderr.splitlines() if "slider_crank.toml" in line]
    assert run.returncode == 1 and len(lines) == 1, run.stderr
    assert lines[0].startswith("python -m dolfinx_ffr: slider_crank.toml: ")


def test_new_overwrites_nothing(
    example: Callable[[str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert scene_file.new(None, Path()) == 0
    assert all(re.search(rf"^{name} +\w", capsys.readouterr().out, re.M) for name in EXAMPLES[:1])
    file = example("outline")
    with pytest.raises(scene_file.SceneError, match="is there already"):
        scene_file.new("outline", Path())
    assert file.exists() and Path("lever.dxf").exists() and Path("angles.csv").exists()
    with pytest.raises(scene_file.SceneError, match="did you mean 'slider_crank'"):
        scene_file.new("slidercrank", Path())


@pytest.mark.parametrize("command", _COMMANDS)
def test_help_fits_a_screen_with_an_example(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([command, "--help"])
    text = capsys.readouterr().out
    assert f"Example: dolfinx_ffr {command} " in text and len(text.splitlines()) <= 24
