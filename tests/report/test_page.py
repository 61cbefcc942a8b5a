# SPDX-License-Identifier: MIT
"""The page of a run: what a browser shows of it, what it says of files that lack or are damaged."""

from __future__ import annotations

import html
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mpi4py import MPI

import pytest
from PIL import EpsImagePlugin, Image
from shared.browser import Seen, look, printed
from shared.runs import record, write_run

import dolfinx_ffr as ffr
from dolfinx_ffr.__main__ import main
from dolfinx_ffr.io import write_history
from dolfinx_ffr.program import run
from dolfinx_ffr.report.folder import LIMIT
from dolfinx_ffr.report.record import KEYS


def page_of(folder: Path) -> str:
    """The report of a folder as text."""
    return ffr.write_report(MPI.COMM_SELF, folder).read_text(encoding="utf-8")


def words(page: str) -> str:
    """What a page says, with plain spaces."""
    text = re.sub(r"<style>.*?</style>|<[^>]*>", " ", page, flags=re.S)
    return re.sub(r"[\s\u2007\u2008\u202f]+", " ", html.unescape(text))


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a run from which nothing is missing."""
    folder = write_run(tmp_path_factory.mktemp("run"), record())
    return ffr.write_report(MPI.COMM_SELF, folder)


#: What the page of that run says, among other things
SAID = """Rod <no. 7> & slider | 4 March 2026, 05:06 | 2 MPI ranks |
Constraints are violated: volume of rod by 2.0 %. |
No part has less than 0.408 of the full rod's psi. |
ψ of the part 33.00 µJ s reported 30.00 µJ s |
ψ relative 55.0 % of ψ of the full rod | Narrowest gap 20.0 mm | Thinnest member 10.0 mm |
Area 12 000 mm² | Mass 0.9420 kg | Part, triangles of 2.50 mm 33.000 µJ s +10.0 |
8.0 % of the area is neither void nor solid | Normal modes left out 0.13 0.039 |
Time step 0.020 0.0060 | volume of rod 0.5100 0.5200 at most 0.5 |
Mass 0.6000 0.6500 at most 0.7 kg none | Largest stress 2.500 5.000 MPa +100 |
crank pin Revolute rod.left, pin | Generalized-Alpha of order 2, 2 s in 2000 steps |
22 coordinates, 3 constraints; psi = 3e-05 | DesignWarning: 12 % of 'rod' is gray |
python demos/slider_crank.py --elements 80 8 | DOLFINx 0.5.2 | level set knots 729 |
The last ψ of the history is 15.00 µJ s, the reported one 30.00 µJ s"""


@pytest.fixture(scope="module")
def seen(page: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Seen]:
    """The page on a telephone."""
    yield look(page, tmp_path_factory.mktemp("browser"), width=390)


@pytest.mark.slow
def test_browser_shows_all_pictures_and_asks_for_nothing(seen: Seen) -> None:
    images = dict(seen.found["images"])
    # scene, design, part, motion, another one, and panels of the history, but for what is not known
    assert len(images) == 5 + 5
    assert min(images.values()) > 0
    assert seen.found["requested"] == seen.requests == []
    assert seen.console == []
    assert seen.found["width"] <= seen.found["window"]  # only tables and drawings are scrolled
    assert seen.found["title"] == "Rod <no. 7> & slider"


@pytest.mark.slow
def test_browser_shows_the_numbers_with_their_units(seen: Seen) -> None:
    text = re.sub(r"[\s\u2007\u2008\u202f]+", " ", seen.found["text"])
    for message in SAID.split("|"):
        assert message.strip() in text, message
    assert "What is missing" not in text


@pytest.mark.slow
def test_page_is_printed(page: Path, tmp_path: Path) -> None:
    sheets, console = printed(page, tmp_path)
    assert 2 <= sheets <= 6
    assert console == []


def test_steps_of_the_boundary(tmp_path: Path) -> None:
    """Their history is shown, and what is reported is said to be the part."""
    folder = write_run(tmp_path, record() | {"boundary": {"steps": 2}})
    columns = {"psi": 3e-5, "volume": 0.5, "narrowest": 1.3e-3, "excess": 0.0, "removed": 1.0}
    write_history(MPI.COMM_SELF, folder / "boundary.csv", list(columns), 4 * [columns])
    text = words(page_of(folder))
    for message in (
        "2 steps have moved the boundary of the part",
        "Narrowest member or gap [mm]",
        "Reported, of the part, on the mesh of its last step",
        "steps of its boundary have followed, and the reported value belongs to the part",
    ):
        assert message in text, message
    assert "of the densities" not in text


@pytest.mark.parametrize("key", ["psi", "scene", "parts", "verification", "warnings", "versions"])
def test_what_is_missing_is_named(key: str, tmp_path: Path) -> None:
    summary = record()
    del summary[key]
    text = words(page_of(write_run(tmp_path, summary, history=False)))
    assert f"summary.json: {key} (ffr.run_record writes them)" in text
    assert ("Not recorded: the part and its dimensions" in text) == (key == "parts")
    assert "history.csv: how the design came about" in text


@pytest.mark.parametrize(
    ("feasible", "message"),
    [
        (True, "All constraints hold for the densities, but the part exceeds"),
        (False, "Constraints are violated: volume of rod by 2.0 %. The part exceeds"),
        (None, "The part exceeds"),
    ],
)
def test_a_limit_that_the_part_exceeds_is_named_with_its_numbers(
    feasible: bool | None, message: str, tmp_path: Path
) -> None:
    settings = {**record(), "feasible": feasible}
    stress = {"value": 24.6e6, "bound": 60e6, "unit": "Pa", "kind": "at most", "violation": 0.0}
    settings["constraints"] = {"stress": stress}
    settings["verification"]["constraints"] = {"stress": [24.6e6, 99.3e6]}
    text = words(page_of(write_run(tmp_path, settings, history=False)))
    assert f"{message} stress by 66 % (reported 24.60, part 99.30, at most 60 MPa)." in text


@pytest.mark.parametrize("nonsense", ["words", {"rod": 3}, {"rod": None}])
def test_what_makes_no_sense_is_named(nonsense: Any, tmp_path: Path) -> None:
    keys = "bound constraints frequencies parts references scene stress verification".split()
    for key in keys:
        folder = write_run(tmp_path / key, {**record(), key: nonsense}, history=False)
        text = words(page_of(folder))
        assert "How to repeat it" in text
        if nonsense == "words":
            assert f"summary.json: what stands under {key!r} cannot be used (no mapping)" in text
        elif key in {"constraints", "parts", "stress", "verification"}:
            assert "summary.json holds something else than run_record writes" in text


def test_summary_of_another_program_is_shown_as_it_is(tmp_path: Path) -> None:
    settings = {"compliance_final": 3.125e-5, "note": "<b>bold</b>", "ok": True, "list": [1, 2]}
    page = page_of(write_run(tmp_path, settings))
    assert "<b>" not in page
    expected = ("compliance final 3.1250 × 10⁻⁵", "note <b>bold</b>", "ok yes", "What is missing")
    assert all(message in words(page) for message in expected)


def test_history_alone_makes_a_report(tmp_path: Path) -> None:
    text = words(page_of(write_run(tmp_path / "four_bar", None)))
    assert "Design run four bar" in text
    assert "summary.json: nothing is known but the history" in text
    assert "Not recorded: bodies, joints and time integration" in text


def test_damaged_and_large_pictures_are_named(tmp_path: Path) -> None:
    folder = write_run(tmp_path, record(), history=False)
    (folder / "scene.png").write_bytes((folder / "scene.png").read_bytes()[:60])
    for name in ("own_thing.png", "motion.gif"):  # what stands behind a picture does not matter
        with (folder / name).open("ab") as file:
            file.write(bytes(LIMIT))
    page = page_of(folder)
    for message in (
        "scene.png: the file is damaged",
        "own_thing.png: with 3.3 MB it would make the page too large; it is left out",
        "motion.gif: with 3.3 MB",
        "only its first frame is shown",
    ):
        assert message in words(page)
    assert "data:image/gif" not in page
    assert len(page) < 1e6


def test_pictures_and_summaries_that_are_meant_to_do_harm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PostScript is not executed, too many pixels are named, texts without end are damaged."""
    folder = write_run(tmp_path, record(), history=False)
    (folder / "other.png").write_text("%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EOF\n")
    monkeypatch.setattr(EpsImagePlugin, "Ghostscript", lambda *_, **__: pytest.fail("executed"))
    assert "other.png: the file is damaged" in words(page_of(folder))
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 0.4)
    assert "scene.png: it has too many pixels" in words(page_of(folder))
    (folder / "history.csv").write_text(f"iteration,psi\n0,{'1' * 200_000}\n")
    with pytest.raises(ValueError, match=r"history.csv is damaged: field larger"):
        page_of(folder)
    (folder / "summary.json").write_text("[" * 100_000)
    with pytest.raises(ValueError, match=r"summary.json is damaged: maximum recursion"):
        page_of(folder)


def test_parts_of_several_bodies_are_shown_from_their_folders(tmp_path: Path) -> None:
    """Each by the name of its folder."""
    volume = {"upper arm": 0.5, "forearm": 0.5}
    folder = write_run(tmp_path, record() | {"volume": volume}, history=False)
    for name in ("upper_arm", "forearm"):
        (folder / name).mkdir()
        (folder / "part.png").rename(folder / name / "part.png")
        Image.new("RGB", (8, 8)).save(folder / "part.png")
    text = page_of(folder)
    for name in ("upper_arm", "forearm"):
        assert f"{name}: The part, and enlarged where it is thinnest and tightest." in text


@pytest.mark.mpi
def test_folder_without_run_is_refused_on_every_rank(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    if comm.rank == 0:
        write_run(shared_tmp_path / "below", record(), history=False)
    comm.Barrier()
    with pytest.raises(FileNotFoundError, match=r"holds no run.*there are runs in .*below.*Give"):
        ffr.write_report(comm, shared_tmp_path)
    with pytest.raises(FileNotFoundError, match="is no folder"):
        ffr.write_report(comm, shared_tmp_path / "nothing")
    with pytest.raises(TypeError, match="folder must be a path, but it is 3"):
        ffr.write_report(comm, 3)  # type: ignore[arg-type]
    place = shared_tmp_path / "r" / "a.html"
    report = ffr.write_report(comm, shared_tmp_path / "below", output=place)
    comm.Barrier()
    assert report.is_file()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("summary.json", b"{", "is damaged"),
        ("summary.json", b"[1, 2]", "must hold"),
        ("summary.json", b"\xff\xfe", "is damaged"),
        ("history.csv", b"iteration,psi\n0,abc\n", "is damaged"),
    ],
)
def test_damaged_files_are_refused(name: str, content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=rf"{re.escape(name)} {message}"):
        ffr.write_report(MPI.COMM_SELF, tmp_path)


def test_command_makes_the_report_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_run(tmp_path / "run", record(), history=False)
    main(["report", str(folder), "--title", "Another title"])
    assert capsys.readouterr().out.strip() == str(folder / "report.html")
    assert "<h1>Another title</h1>" in (folder / "report.html").read_text()
    program = "/usr/lib/dolfinx_ffr/__main__.py"
    monkeypatch.setattr(sys, "argv", [program, "report", str(tmp_path)])
    with pytest.raises(SystemExit, match=r"^python -m dolfinx_ffr: .* holds no run"):
        run(main)


def test_commands_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, message in (
        ([], "new .* check .* design .* report .* compile .* error: say which command"),
        (["optimise"], r"'?new'?, '?check'?, '?design'?, '?report'?, '?compile'?"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 2
        assert re.search(message, " ".join(capsys.readouterr().err.split()))


def test_record_of_the_tests_has_all_keys() -> None:
    assert set(KEYS) == set(record()) - {"level_set_knots"}
    assert json.loads(json.dumps(record())) == record()
