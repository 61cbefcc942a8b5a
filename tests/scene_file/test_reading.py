# SPDX-License-Identifier: MIT
# ruff: noqa: E501  a line for each mistake
"""What a scene file may say, and what is wrong in one is told in one line."""

from __future__ import annotations

import codecs
import inspect
import re
from importlib.resources import files
from inspect import isabstract
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared import TOP

import dolfinx_ffr as ffr
from dolfinx_ffr import validation
from dolfinx_ffr.mechanism import Joint
from dolfinx_ffr.scene_file import SceneError, read_scene
from dolfinx_ffr.scene_file.calls import Call, Maker
from dolfinx_ffr.scene_file.kinds import KINDS, kinds_of
from dolfinx_ffr.scene_file.reading import SOLIDS, arguments_of, in_si, stated_units

EXAMPLES = files("dolfinx_ffr.scene_file") / "examples"
CRANK = (EXAMPLES / "slider_crank.toml").read_text()


@pytest.mark.parametrize(
    ("text", "units", "number"),
    [
        ("40 mm", ("m",), 0.04),
        ("90 deg", ("rad",), np.pi / 2),
        ("-90°", ("m", "rad"), -np.pi / 2),
        ("5 rev", ("m", "rad"), 10 * np.pi),
        ("600 rpm", ("rad/s",), 20 * np.pi),
        ("210 GPa", ("Pa",), 210e9),
        ("2 N/m", ("N/m", "N m/rad"), 2.0),
        ("7.85 g/cm^3", ("kg/m^3",), 7850.0),
        ("0.3", ("-",), 0.3),
    ],
)
def test_units(text: str, units: tuple[str, ...], number: float) -> None:
    assert in_si(text, units) == pytest.approx(number, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "units", "message"),
    [
        ("5 kg", ("m",), "'5 kg' has a wrong unit: it takes m$"),
        ("600 rpm", ("Hz",), "it takes Hz"),  # turns are angles
        ("3 N m", ("N m/rad",), "it takes N m/rad"),
        ("0.3 m", ("-",), "it takes no unit"),
        ("1 furrlong", (), "'furrlong' is no unit that is known"),
        ("20 degC", (), "wrong|no unit"),
        ("many mm", (), "is no number"),
    ],
)
def test_wrong_units(text: str, units: tuple[str, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        in_si(text, units)


def test_units_are_those_of_the_documentation() -> None:
    """All that docstrings state of arguments of classes and their constructors is known."""
    # Python 3.13 takes the indentation of a class away from its docstring
    entry = re.compile(r"^ {4,}(\w+): +(.+(?:\n {8,}(?!\w+: ).*)*)", re.M)
    compared = 0
    for kinds in KINDS.values():
        for target in kinds:
            if target is ffr.VolumeIntegrals:
                continue  # its docstring has shapes beside units
            units = stated_units(target)
            for name, text in entry.findall(inspect.getdoc(target) or ""):
                written = re.findall(r"\[((?:1/)?[A-Za-z-][^\],]*)\]", text)
                if written and name in units and (target, name) != (ffr.Domain, "domain"):
                    assert units[name] == tuple(" or ".join(written).split(" or ")), (target, name)
                    compared += 1
    assert compared > 50


def test_every_joint_force_and_objective_can_be_written() -> None:
    """The table of kinds names all that are public."""
    public = {name: getattr(ffr, name) for name in ffr.__all__}
    for folder, names in ffr._BY_FOLDER.items():
        public |= {name: getattr(getattr(ffr, folder), name) for name in names}
    classes = {name: thing for name, thing in public.items() if isinstance(thing, type)}
    needs_a_function = {"DimensionDesign"}
    bases = (Joint, ffr.mechanism.AppliedForce, ffr.Objective, ffr.mechanism.Start)
    for base in (*bases, ffr.design.Variables):
        concrete = {n for n, k in classes.items() if issubclass(k, base) and not isabstract(k)}
        kinds = kinds_of([base])
        assert kinds and not concrete - {*kinds, "Objective"} - needs_a_function
    motions = "constant polynomial smooth_step fourier spline from_table".split()
    assert list(kinds_of([ffr.Motion])) == motions
    for target, argument, kinds in (
        (ffr.FlexibleBody, "domain", {"rectangle", "box", "from_gmsh", "from_outline"}),
        (ffr.FlexibleBody, "material", {"PlaneStress", "PlaneStrain", "Isotropic"}),
        (ffr.FlexibleBody, "interpolation", {"SIMP", "RAMP"}),
        (ffr.FlexibleBody, "frame", {"ChordFrame", "TangentFrame"}),
        (ffr.Problem, "integrator", {"TimeInterval", "GeneralizedAlpha", "RadauIIA"}),
        (ffr.optimize, "optimizer", {"MMA", "LevelSetEvolution"}),
        (ffr.optimize, "gradient", {"ExactAdjoint"}),
    ):
        hint = arguments_of(target)[argument].hint
        options = getattr(hint, "__args__", None) or (hint,)
        assert set(kinds_of(options)) == kinds, argument


def test_materials_have_sources() -> None:
    for name, numbers in SOLIDS.items():
        assert len(numbers["source"]) > 10, name
        settings = {key: numbers[key] for key in ("young", "poisson", "density")}
        assert ffr.Isotropic(**settings).young > 1e9


def written(folder: Path, *edits: tuple[str, str]) -> Path:
    """The example of a slider-crank with some edits."""
    text = CRANK
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new, 1)
    (folder / "rod.toml").write_text(text)
    return folder / "rod.toml"


#: An edit, and the message behind the name of the file
WRONG = [
    ('"0.4 m"', '"0.4 kg"', r"bodies.rod.domain.length: '0.4 kg' has a wrong unit: it takes m"),
    ("height =", "heigth =", r"bodies.rod.domain: Domain.rectangle has no key 'heigth'; did you mean 'height'"),
    ('height = "40 mm", ', "", r"bodies.rod.domain: Domain.rectangle needs the key 'height'"),
    ('"steel"', '"stel"', r"bodies.rod.material.name: there is no 'stel'; did you mean 'steel'"),
    ("[200, 20]", '[200, "a few"]', r"bodies.rod.domain.elements\[2\]: 'a few' is no whole number"),
    ("[200, 20]", "[200, 20, 4]", r"bodies.rod.domain.elements: must have 2 entries, but there are 3"),
    ("modes = 8", "modes = true", r"bodies.rod.modes: True is no whole number"),
    ('angle = "turns"', 'angle = "turn"', r"markers.crank.angle: 'turn' is no name of a motion .*did you mean 'turns'"),
    ('a = "rod.left"', 'a = "rodd.left"', r"joints\[1\] \(crank pin\).a: there is no body 'rodd'; did you mean 'rod'"),
    ('b = "crank"', 'b = "crnk"', r"joints\[1\] \(crank pin\).b: 'crnk' is no marker.*did you mean 'crank'"),
    ('kind = "Revolute"\nname', 'kind = "Revolut"\nname', r"joints\[1\] \(crank pin\).kind: there is no 'Revolut'; did you mean 'Revolute'"),
    ("[objective]", "[objectiv]", r"the file: a scene has no key 'objectiv'"),
    ('[objective] # what is minimised\nkind = "IntegralCompliance"', "", r"objective: the scene needs \[objective\]"),
    ("[designs.rod]", "[designs.arm]", r"designs: there is no flexible body 'arm'; there are rod"),
    ("volume = 0.5", 'volume = "0,5"', r"""optimize.volume: '0,5' has a decimal comma; write a point: "0.5\""""),
    ('a = "rod.left"', 'a = "rod"', r"""joints\[1\] \(crank pin\).a: 'rod' is a body; name a marker of it, "rod.NAME\""""),
    ('marker = "rod.right"', 'marker = "right"', r"""point_masses\[1\].marker: 'right' is no marker, as "body.marker\""""),
    ("iterations = 60", "iterations = 0", r"optimize.iterations: 0 iterations design nothing"),
    ("iterations = 60", "iteration = 60", r"optimize: optimize has no key 'iteration'; did you mean 'iterations'"),
    ("title =", "title", r"Expected '='"),
    ('kind = "TimeInterval"', "", r"integrator: say which kind it is, kind = one of"),
    (
        'kind = "smooth_step"\ndistance = "5 rev"\nduration = "2 s"',
        'kind = "from_table"\npath = "none.csv"\nvalue = "a"',
        r"motions.turns.path: there is no file .*none.csv",
    ),
]  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "message"), WRONG, ids=[new or old for old, new, _ in WRONG]
)
def test_what_is_wrong_is_told_with_its_place(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    file = written(tmp_path, (old, new))
    with pytest.raises(SceneError, match=f"^{re.escape(str(file))}: .*{message}") as caught:
        read_scene(file)
    assert "\n" not in str(caught.value)


def test_nesting_without_end_is_told_in_a_line(tmp_path: Path) -> None:
    file = tmp_path / "rod.toml"
    for depth in (200, 20_000):
        file.write_text(f"jumps = {'[' * depth}{']' * depth}\n{CRANK}")
        with pytest.raises(SceneError, match=r": jumps.*no number|nested too deeply to be read$"):
            read_scene(file)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-be", "latin-1"])
def test_files_in_other_encodings_are_read(tmp_path: Path, encoding: str) -> None:
    file = written(tmp_path, ("title =", 'title = "Kurbelschlägel"\n#'), ("= 60", '= "16"'))
    text = file.read_text()
    file.write_bytes(
        (codecs.BOM_UTF16_BE if encoding == "utf-16-be" else b"") + text.encode(encoding)
    )
    scene = read_scene(file)
    assert scene.title == "Kurbelschlägel" and scene.run.arguments["iterations"] == 16
    file.write_bytes(text.encode("utf-16-le"))
    with pytest.raises(SceneError, match="is no text that can be read; save it as UTF-8"):
        read_scene(file)


def test_a_tilde_is_the_home_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    output = next(line for line in CRANK.splitlines() if line.startswith("output"))
    file = written(tmp_path, (output, 'output = "~/rods"'))
    assert read_scene(file).output == tmp_path / "home" / "rods"
    assert validation.path("a path", "~/x") == tmp_path / "home" / "x"
    with pytest.raises(ValueError, match="'~nobody at all/x' is in no home directory"):
        validation.path("a path", "~nobody at all/x")


def test_interfaces_by_place(tmp_path: Path) -> None:
    """A point in a bore, and a box."""
    (tmp_path / "lever.dxf").write_bytes((EXAMPLES / "lever.dxf").read_bytes())
    (tmp_path / "angles.csv").write_bytes((EXAMPLES / "angles.csv").read_bytes())
    text = (EXAMPLES / "outline.toml").read_text()
    places = '{ shaft = { at = [0, "1 mm"] }, pin = { lower = ["1 mm", 0], upper = [1, 1] } }'
    by_layer = '{ shaft = "shaft", pin = "pin" }'
    assert by_layer in text
    file = tmp_path / "lever.toml"
    file.write_text(text.replace(by_layer, places))
    scene = read_scene(file)
    body = scene.problem.arguments["bodies"]["lever"]
    interfaces = of(body.arguments["domain"].arguments["interfaces"])
    assert interfaces == {
        "shaft": ffr.fem.Bore((0, 0.001)),
        "pin": ffr.fem.Box((0.001, 0), (1, 1)),
    }


def of(call: Call) -> Any:
    return Maker()(call)


def test_tables_become_what_they_say(tmp_path: Path) -> None:
    """Units, sums of motions, kinds that keys tell, bounds in the unit of their objective."""
    limit = '[[constraints]]\nobjective = { kind = "Frequency", body = "rod" }\nlower = "1.2 kHz"\n'
    file = written(
        tmp_path,
        ('angle = "turns"', 'angle = ["10 deg", "turns"]'),
        ('line = { kind = "Ground" }', 'line = { position = ["1 cm", 0] }'),
        ('kind = "FlexibleBody"\n', ""),
        ("# A limit, for example of the stress:", limit),
    )
    case = read_scene(file).cases[""]
    mechanism, constraint = of(case["mechanism"]), of(case["constraints"][0])  # type: ignore[index]
    crank = mechanism.joints[0].b
    np.testing.assert_allclose(crank.angle.tabulate([0.0, 2.0])[0], np.radians([10.0, 1810.0]))
    assert mechanism.joints[1].line == ffr.Ground((0.01, 0.0))
    assert (constraint.objective, constraint.lower) == (ffr.Frequency("rod"), 1200.0)
    wrong = limit.replace("kHz", "MPa")
    file.write_text(file.read_text().replace(limit, wrong))
    with pytest.raises(SceneError, match=r"constraints\[1\].lower: '1.2 MPa' .* takes Hz"):
        read_scene(file)


CASES = """
[load_cases.slow]
[load_cases.fast]
motions.turns = { kind = "smooth_step", distance = "5 rev", duration = "1 s" }
integrator = { kind = "TimeInterval", end_time = "1 s" }
[combine]
kind = "WorstCase"
weights = { slow = 16.0, fast = 1.0 }
"""


def test_motions_have_the_unit_of_their_users(tmp_path: Path) -> None:
    """An angle, a length, a force over time."""
    force = '[[forces]]\nkind = "Force"\nmarker = "rod.right"\nx = "pull"\n[motions.pull]\n'
    force += 'kind = "fourier"\nperiod = "1 s"\nmean = "2 kN"\nsines = ["30 N"]\n[optimize]'
    file = written(tmp_path, ("[optimize]", force))
    pull = of(read_scene(file).cases[""]["mechanism"]).forces[0].x
    assert pull.value(np.array(0.25)) == pytest.approx(2030.0)
    for old, new, message in (("2 kN", "2 kg", "takes N$"), ("5 rev", "5 m", "takes rad$")):
        file = written(tmp_path, ("[optimize]", force), (old, new))
        with pytest.raises(SceneError, match=message):
            read_scene(file)


def test_load_cases_give_what_differs(tmp_path: Path) -> None:
    file = written(tmp_path, ("[optimize]", f"{CASES}\n[optimize]"))
    scene = read_scene(file)
    slow, fast = (Maker()(scene.cases[name]) for name in ("slow", "fast"))
    assert (slow["integrator"].end_time, fast["integrator"].end_time) == (2.0, 1.0)
    angles = [each["mechanism"].joints[0].b.angle.value(np.array(0.5)) for each in (slow, fast)]
    assert angles[1] == pytest.approx(5 * np.pi) and angles[0] < angles[1]
    assert of(scene.problem.arguments["combine"]) == ffr.WorstCase({"slow": 16.0, "fast": 1.0})
    file.write_text(file.read_text().replace("motions.turns =", "motion.turns ="))
    with pytest.raises(SceneError, match=r"load_cases.fast: a load case has no key 'motion'"):
        read_scene(file)


def test_page(tmp_path: Path) -> None:
    """The files of the page on the command are scenes, and its table is that of the materials."""
    text = (TOP / "docs" / "command.md").read_text()
    first, *more = re.findall(r"^```toml\n(.*?)^```", text, re.M | re.S)
    for name in ("lever.dxf", "angles.csv"):
        (tmp_path / name).write_bytes((EXAMPLES / name).read_bytes())
    for addition in ("", *more):
        (tmp_path / "lever.toml").write_text(f"{first}\n{addition}")
        scene = read_scene(tmp_path / "lever.toml")
        assert of(scene.cases)
    assert list(scene.cases) == ["slow", "loaded"]
    (tmp_path / "lever.toml").write_text(first.replace('"lever.shaft"', '"levr.shaft"', 1))
    with pytest.raises(SceneError) as caught:
        read_scene(tmp_path / "lever.toml")
    assert str(caught.value).replace(f"{tmp_path}/", "dolfinx_ffr: ") in text
    rows = re.findall(r"^\| `([\w ]+)` \| ([\d.]+) \| ([\d.]+) \| (\d+) \|", text, re.M)
    told_solids = {n: (1e9 * float(E), float(nu), float(rho)) for n, E, nu, rho in rows}
    assert told_solids == {n: (s["young"], s["poisson"], s["density"]) for n, s in SOLIDS.items()}
    assert all(f"`{name}`" in text for name in ("[optimize]", "[integrator]", "[[joints]]"))
