# SPDX-License-Identifier: MIT
"""A scene file: its tables, and the problem and run that they describe.

Here stands which tables there are, and how they are put together.
"""

from __future__ import annotations

import tomllib
import typing
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from .. import validation
from ..files import text_of
from ..mechanical_problem import MechanicalProblem
from ..mechanism import Mechanism
from ..optimization import Result, check_run, optimize
from ..problem import Problem
from ..reduction import FlexibleBody
from .calls import Call, Maker, SceneError
from .kinds import kinds_of
from .reading import Reader, Table, alternatives, arguments_of, near

#: Tables beside those of `Mechanism` and `MechanicalProblem`
_OWN = ("title", "output", "bodies", "designs", "optimize", "load_cases", "combine", "materials")
_NAMES = ("motions", "markers")
#: Arguments of `optimize` that the scene or the command gives
_GIVEN = ("problem", "design", "output", "resume", "progress", "callback")


@dataclass(frozen=True)
class Scene:
    """A checked scene whose objects are not made yet."""

    file: Path
    title: str
    output: Path  #: Folder of the results
    problem: Call
    run: Call  #: Of `optimize`
    cases: dict[str, dict[str, Call]]  #: By load case, what the bodies do not matter for

    def made(self) -> tuple[Problem, Maker]:
        """The problem, and what makes the rest of it.

        Mechanisms come first, as meshes take time, and designs last. A SceneError where the package
        refuses something.
        """
        maker = Maker()
        maker(self.cases)
        problem = maker(self.problem)
        maker(self.run.arguments["design"])
        return problem, maker

    def check_run(self, maker: Maker) -> None:
        """Refuse settings of `optimize` with which a design could not begin."""
        maker(replace(self.run, target=check_run))

    def optimized(self, maker: Maker, *, output: Path, resume: bool) -> Result:
        """The result of `optimize` for the scene."""
        arguments = {"output": str(output), "resume": resume}
        return maker(replace(self.run, arguments=self.run.arguments | arguments))


def read_scene(file: Path) -> Scene:
    """The scene of a file; a SceneError names the error and its place."""
    try:
        return _Tables(file, tomllib.loads(_text_of(file))).scene()
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{file}: {error}") from error
    except RecursionError:
        raise SceneError(f"{file}: its lists or tables are nested too deeply to be read") from None


def _text_of(file: Path) -> str:
    """The text of a scene file."""
    try:
        return text_of(file)
    except ValueError as error:
        raise SceneError(str(error)) from error


class _Tables:
    """The tables of a file."""

    def __init__(self, file: Path, data: Table) -> None:
        self.file, self.data = file, data
        bodies = data.get("bodies")
        self.reader = self._reader(data, bodies if isinstance(bodies, dict) else {})
        self.reader.check_keys("the file", data, [*_OWN, *_NAMES, *_case_keys()], "a scene")
        self.bodies = self._bodies(bodies)

    def _reader(self, data: Table, bodies: Mapping[str, Any]) -> Reader:
        named = {n: self._table(data, n) for n in (*_NAMES, "materials")}
        return Reader(self.file, named, bodies)

    def _table(self, data: Table, name: str) -> Table:
        tables = data.get(name, {})
        if not isinstance(tables, dict):
            raise SceneError(f"{self.file}: {name}: must be tables by name, as [{name}.example]")
        return tables

    def _text(self, name: str, default: str) -> str:
        text: str = self.reader.value(str, self.data.get(name, default), name)
        return text

    def _bodies(self, tables: Any) -> dict[str, Call]:
        if not isinstance(tables, dict) or not tables:
            self.reader.refuse("bodies", "the scene has none; give a table [bodies.NAME] for each")
        kinds, bodies = kinds_of(alternatives(typing.get_args(_hint(Problem, "bodies"))[1])), {}
        for name, table in tables.items():
            bodies[name] = self.reader.call(kinds, table, f"bodies.{name}")
        return bodies

    def scene(self) -> Scene:
        """The whole scene."""
        title, data = self._text("title", self.file.stem.replace("_", " ")), self.data
        folder = validation.path("output", self._text("output", f"results/{self.file.stem}"))
        output = self.file.parent / folder
        overrides = self._table(data, "load_cases")
        arguments: Table = {"bodies": self.bodies}
        if overrides:
            cases = {name: self._case(name, table) for name, table in overrides.items()}
            problems = {
                name: Call(MechanicalProblem, case, f"{self.file}: load case {name!r}")
                for name, case in cases.items()
            }
            combine = data.get("combine", {"kind": "WeightedSum"})
            hint = arguments_of(Problem.of_load_cases)["combine"].hint
            arguments["load_cases"] = problems
            arguments["combine"] = self.reader.value(hint, combine, "combine")
        elif "combine" in data:
            self.reader.refuse("combine", "there are no load cases; give [load_cases.NAME]")
        else:
            cases = {"": self._case("", {})}
            arguments |= cases[""]
        target: Any = Problem.of_load_cases if overrides else Problem
        problem = Call(target, arguments, f"{self.file}")
        return Scene(self.file, title, output, problem, self._run(problem), cases)

    def _case(self, name: str, table: object) -> dict[str, Call]:
        """Mechanism, integrator, objective and constraints, with what a load case overrides."""
        where, keys = f"load_cases.{name}", (*_NAMES, *_case_keys())
        overrides = self.reader.check_keys(where, table, keys, "a load case")
        data = {key: self.data[key] for key in keys if key in self.data}
        for key, value in overrides.items():
            both = key in (*_NAMES, "placements", "damping") and key in data
            data[key] = {**data[key], **self._table(overrides, key)} if both else value
        reader = self._reader(self.data | data, self.bodies) if overrides else self.reader
        of_mechanism = {n: data[n] for n in arguments_of(Mechanism) if n in data}
        mechanism = reader.call({"Mechanism": Mechanism}, of_mechanism, where if name else "")
        case = {"mechanism": mechanism}
        for key, parameter in arguments_of(MechanicalProblem).items():
            if key in data:
                case[key] = reader.value(parameter.hint, data[key], key)
            elif parameter.required and key != "mechanism":
                kinds = ", ".join(kinds_of([parameter.hint]))
                reader.refuse(key, f"the scene needs [{key}] with kind = one of {kinds}")
        return case

    def _run(self, problem: Call) -> Call:
        """The call of `optimize`."""
        flexible = {n: body for n, body in self.bodies.items() if body.target is FlexibleBody}
        tables = self._table(self.data, "designs")
        if unknown := [name for name in tables if name not in flexible]:
            self.reader.refuse(
                "designs", f"there is no flexible body {unknown[0]!r}; {near(unknown[0], flexible)}"
            )
        kinds = {
            name: kind
            for name, kind in kinds_of(alternatives(_hint(optimize, "design"))[:1]).items()
            if "domain" in arguments_of(kind)
        }
        designs = {
            name: self.reader.call(
                kinds,
                {"kind": "LevelSet"} | self._table(tables, name),
                f"designs.{name}",
                domain=body.arguments["domain"],
            )
            for name, body in flexible.items()
        }
        settings = self._table(self.data, "optimize")
        keys = [name for name in arguments_of(optimize) if name not in _GIVEN]
        self.reader.check_keys("optimize", settings, keys, "optimize")
        if settings.get("iterations") == 0:
            self.reader.refuse("optimize.iterations", "0 iterations design nothing; give some")
        arguments: Table = {"problem": problem, "design": designs, "output": None}
        return self.reader.call({"optimize": optimize}, settings, "optimize", **arguments)


@cache
def _case_keys() -> tuple[str, ...]:
    """Keys of mechanisms and of load cases."""
    keys = (*arguments_of(Mechanism), *arguments_of(MechanicalProblem))
    return tuple(key for key in keys if key != "mechanism")


def _hint(target: Any, name: str) -> Any:
    return arguments_of(target)[name].hint
