# SPDX-License-Identifier: MIT
"""Values of a scene file as arguments of the public API, by the type hints of its signatures."""

from __future__ import annotations

import collections.abc
import functools
import inspect
import operator
import os
import re
import tomllib
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import is_dataclass
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, NoReturn, Union

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..fem import ElasticMaterial
from ..mechanism import Ground, Motion, Moving
from ..objective import Constraint
from .calls import Call, SceneError, total
from .kinds import MOTIONS, kinds_of

Table = dict[str, Any]
#: Objects with names that other tables use, by the table in which they stand
NAMED: dict[str, tuple[type, ...]] = {
    "motions": (Motion,),
    "markers": (Ground, Moving),
    "materials": (ElasticMaterial,),
}
#: Numbers of materials by name, each with its ``source``
SOLIDS: dict[str, Table] = tomllib.loads(
    (files(__package__) / "materials.toml").read_text(encoding="utf-8")
)
_ARRAYS = set(typing.get_args(ArrayLike)) or {ArrayLike}
#: Stands for arrays among what a hint allows
_ARRAY = "array"
#: A number and what follows it
_QUANTITY = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*)?")
#: A whole number
_WHOLE = re.compile(r"[-+]?\d+")
#: A number with a decimal comma
_COMMA = re.compile(r"([-+]?\d+),(\d+)(.*)")
_METRES = (
    "at center centers clear extent field gap height hole_rim inside knots length markers member "
    "minimum_gap minimum_member place position radius region rim size solid_length solid_rim "
    "spacing surface thickness width"
)
_SECONDS = "beta duration end_time jumps period smoothing start tau times window"
#: Units of arguments by their names; all other arguments have no unit
_UNITS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(_METRES.split(), ("m",)),
    **dict.fromkeys(("cosines", "distance", "mean", "sines", "value", "values"), ("m", "rad")),
    **dict.fromkeys(_SECONDS.split(), ("s",)),
    **dict.fromkeys(("angle", "pressure_angle", "rotation"), ("rad",)),
    **dict.fromkeys(("inertia", "P", "G", "N"), ("kg m^2",)),
    **dict.fromkeys(("gravity", "ground_acceleration"), ("m/s^2",)),
    **dict.fromkeys(("x", "y", "z"), ("N",)),
    "K": ("N/m",),
    "S": ("kg m",),
    "acceleration": ("m/s^2", "rad/s^2"),
    "alpha": ("1/s",),
    "angular_velocity": ("rad/s",),
    "coefficients": ("m", "rad", "m/s", "rad/s", "m/s^2", "rad/s^2"),
    "damping": ("N s/m", "N m s/rad"),
    "density": ("kg/m^3",),
    "mass": ("kg",),
    "moment": ("N m",),
    "motion": ("m",),
    "stiffness": ("N/m", "N m/rad"),
    "torsional_damping": ("N m s/rad",),
    "torsional_stiffness": ("N m/rad",),
    "velocity": ("m/s", "rad/s"),
    "young": ("Pa",),
}
#: Units of arguments that mean something else by a name of these
_OTHER_UNITS = {
    ("Assembled", "elastic_velocity"): (),
    ("BodyMarker", "rotation"): ("rad/m",),
    ("BodyMarker", "stiffening"): ("1/m",),
    ("Bushing", "damping"): ("N s/m",),
    ("Bushing", "stiffness"): ("N/m",),
    ("ChordFrame", "start"): ("-",),
    ("DimensionDesign", "start"): ("-",),
    ("MMA", "length"): ("-",),
    ("Mechanism", "damping"): ("-",),
    ("Mechanism", "start"): ("-",),
    ("Mirror", "point"): ("m",),
    ("Motion.from_table", "value"): ("-",),
    ("Moving", "x"): ("m",),
    ("Moving", "y"): ("m",),
    ("Moving", "z"): ("m",),
    ("PathTracking", "path"): ("m",),
    ("PeakStress", "box"): ("m",),
    ("Placement", "velocity"): ("m/s",),
    ("PrescribedAngle", "motion"): ("rad",),
    ("RadauIIA", "steps"): ("s",),
    ("Box", "lower"): ("m",),
    ("Box", "upper"): ("m",),
}
_LISTS = (collections.abc.Sequence, collections.abc.Iterable, list)
_BODY_POINT = tuple[str, str]


class Reader:
    """Makes calls of the tables of a file, whose paths are relative to its folder."""

    def __init__(
        self,
        file: Path,
        named: Mapping[str, Table],
        bodies: Iterable[str],
    ) -> None:
        self.file, self.named, self.bodies = file, named, list(bodies)
        self._made: dict[tuple[str, str, tuple[str, ...]], Call | None] = {}

    def refuse(self, where: str, problem: str) -> NoReturn:
        """Raise the error of a place in the file."""
        raise SceneError(f"{self.file}: {where or 'the scene'}: {problem}")

    def check_keys(self, where: str, table: object, known: Iterable[str], of: str) -> Table:
        """The table if it is one with known keys only."""
        if not isinstance(table, dict):
            self.refuse(where, f"must be a table, but it is {validation.described(table)}")
        known = list(known)
        for key in table:
            if key not in known:
                self.refuse(where, f"{of} has no key {key!r}; {near(key, known)}")
        return table

    # ------------------------------------------------------------------ tables

    def call(
        self,
        kinds: Mapping[str, Callable[..., Any]],
        table: object,
        where: str,
        of: tuple[str, ...] = (),
        **fixed: Any,
    ) -> Call:
        """The call that a table describes: one of some kinds, with its keys as arguments.

        Arguments that are ``given`` by their names are no keys of the table. A motion is ``of`` the
        unit that its user needs.
        """
        if not isinstance(table, dict):
            self.refuse(where, f"must be a table, but it is {validation.described(table)}")
        target, keys = self._chosen(kinds, table, where, fixed)
        parameters = arguments_of(target)
        if "name" in keys and {"young", "poisson", "density"} <= parameters.keys():
            keys = self._solid(keys, where)
        label = target.__qualname__
        keys_allowed = {
            n: p for n, p in parameters.items() if n not in fixed and p.hint is not MPI.Comm
        }
        self.check_keys(where, keys, keys_allowed, label)
        units = stated_units(target)
        if of and target in MOTIONS:
            units = {n: _of_unit(stated, of) for n, stated in units.items()}
        if target is Constraint and "objective" in keys:
            keys = dict(keys)
            bounded = self.value(
                keys_allowed["objective"].hint, keys["objective"], f"{where}.objective"
            )
            unit = getattr(bounded.target, "unit", "")
            units |= dict.fromkeys(("upper", "lower"), (unit or "-",))
        arguments = {}
        for name, parameter in parameters.items():
            if parameter.hint is MPI.Comm:
                arguments[name] = MPI.COMM_WORLD
            elif name in fixed:
                arguments[name] = fixed[name]
            elif name in keys:
                at = f"{where}.{name}".lstrip(".")
                arguments[name] = self.value(parameter.hint, keys[name], at, units.get(name, ()))
            elif parameter.required:
                self.refuse(where, f"{label} needs the key {name!r}")
        return Call(target, arguments, f"{self.file}: {where or label}")

    def _chosen(
        self, kinds: Mapping[str, Callable[..., Any]], table: Table, where: str, fixed: Table
    ) -> tuple[Callable[..., Any], Table]:
        """The kind of a table, as it says or as its keys fit, and the other keys."""
        keys = {key: value for key, value in table.items() if key != "kind"}
        if "kind" in table:
            kind = table["kind"]
            if kind not in kinds:
                self.refuse(f"{where}.kind", f"there is no {kind!r}; {near(str(kind), kinds)}")
            return kinds[kind], keys
        fitting = {}
        for name, target in kinds.items():
            parameters = arguments_of(target)
            needed = {n for n, p in parameters.items() if p.required and p.hint is not MPI.Comm}
            if keys.keys() <= parameters.keys() and needed - fixed.keys() <= keys.keys():
                fitting[name] = target
        if len(kinds) == 1 or len(fitting) == 1:
            return next(iter((fitting or kinds).values())), keys
        self.refuse(where, f"say which kind it is, kind = one of {', '.join(fitting or kinds)}")

    def _solid(self, keys: Table, where: str) -> Table:
        """The keys of a material with the numbers of that which it names."""
        keys = dict(keys)
        name = keys.pop("name")
        if name not in SOLIDS:
            self.refuse(f"{where}.name", f"there is no {name!r}; {near(str(name), SOLIDS)}")
        return {key: v for key, v in SOLIDS[name].items() if key != "source"} | keys

    # ------------------------------------------------------------------ values

    def value(self, hint: Any, raw: Any, where: str, units: tuple[str, ...] = ()) -> Any:
        """A value of the file as a type hint wants it; texts may be numbers with ``units``."""
        options = alternatives(hint)
        if isinstance(raw, dict):
            return self._of_table(options, raw, where, units)
        if isinstance(raw, list):
            return self._of_list(options, raw, where, units)
        if isinstance(raw, str):
            return self._of_text(options, raw, where, units)
        if isinstance(raw, bool):
            if bool in options and not numeric(options):
                return raw
        elif isinstance(raw, int | float):
            if numeric(options) or (int in options and isinstance(raw, int)):
                return float(raw) if float in options and int not in options else raw
            if Motion in options:
                return Call(Motion.constant, {"value": float(raw)}, f"{self.file}: {where}")
        self.refuse(where, f"{raw!r} is {self.none_of(options)}")

    def _of_table(self, options: list[Any], raw: Table, where: str, units: tuple[str, ...]) -> Any:
        mapping = [o for o in options if typing.get_origin(o) is collections.abc.Mapping]
        kinds = kinds_of(options)
        if kinds and not (mapping and "kind" not in raw):
            return self.call(kinds, raw, where, units)
        if not mapping:
            self.refuse(where, f"a table is {self.none_of(options)}")
        inner = typing.get_args(mapping[0])[1]
        return {name: self.value(inner, v, f"{where}.{name}", units) for name, v in raw.items()}

    def _of_list(
        self, options: list[Any], raw: list[Any], where: str, units: tuple[str, ...]
    ) -> Any:
        tuples = [typing.get_args(o) for o in options if typing.get_origin(o) is tuple]
        fitting = [t for t in tuples if t[1:] == (...,) or len(t) == len(raw)]
        if fitting:
            # choose the kind of pair, texts or numbers, by the first entry
            entry = raw[0] if raw else 0.0
            texts = isinstance(entry, str) and not _QUANTITY.fullmatch(entry.strip())
            chosen = next((t for t in fitting if (t[0] is str) == texts), fitting[0])
            hints = chosen[:1] * len(raw) if chosen[1:] == (...,) else chosen
            values = tuple(self._entries(hints, raw, where, units))
            if _BODY_POINT in options and chosen == typing.get_args(_BODY_POINT):
                self._check_body(values[0], where)
            return values
        lists = [o for o in options if typing.get_origin(o) in _LISTS]
        if lists:
            hints = typing.get_args(lists[0]) * len(raw)
            return list(self._entries(hints, raw, where, units))
        if Motion in options:
            terms = [
                self.value(Motion | float, v, f"{where}, entry {k}", units)
                for k, v in enumerate(raw, 1)
            ]
            return Call(total, {"motions": terms}, f"{self.file}: {where}")
        if _ARRAY in options:
            return list(self._entries([ArrayLike] * len(raw), raw, where, units))
        if tuples:
            counts = " or ".join(sorted({str(len(t)) for t in tuples}))
            self.refuse(where, f"must have {counts} entries, but there are {len(raw)}")
        self.refuse(where, f"a list is {self.none_of(options)}")

    def _entries(
        self, hints: Iterable[Any], raw: list[Any], where: str, units: tuple[str, ...]
    ) -> Iterator[Any]:
        for k, (hint, entry) in enumerate(zip(hints, raw, strict=True), 1):
            label = entry.get("name") if isinstance(entry, dict) else None
            place = f"{where}[{k}]" + (f" ({label})" if isinstance(label, str) else "")
            yield self.value(hint, entry, place, units)

    def _of_text(self, options: list[Any], raw: str, where: str, units: tuple[str, ...]) -> Any:
        tables = [name for name, types in NAMED.items() if set(types) & set(options)]
        for table in tables:
            if raw in self.named[table]:
                return self.shared(table, raw, units)
        if _QUANTITY.fullmatch(raw.strip()) and numeric(options):
            try:
                return in_si(raw, units)
            except ValueError as error:
                self.refuse(where, str(error))
        if int in options and str not in options and _WHOLE.fullmatch(raw.strip()):
            return int(raw)
        if any(typing.get_origin(o) is os.PathLike or o is Path for o in options):
            path = self.file.parent / validation.path(where, raw)
            if not path.is_file():
                self.refuse(where, f"there is no file {str(path)!r}")
            return str(path)
        if _BODY_POINT in options and "." in raw:
            body, _, marker = raw.partition(".")
            self._check_body(body, where)
            return body, marker
        kinds = kinds_of(options)
        if raw in kinds:
            return self.call(kinds, {"kind": raw}, where)
        words = [w for o in options if typing.get_origin(o) is Literal for w in typing.get_args(o)]
        if raw in words or str in options:
            return raw
        if _BODY_POINT in options and raw in self.bodies:
            self.refuse(
                where,
                f'{raw!r} is a body; name a marker of it, "{raw}.NAME", where NAME is one of its '
                "interfaces",
            )
        points = [f"{body}.MARKER" for body in self.bodies] if _BODY_POINT in options else []
        words_known = [*words, *kinds, *points, *(n for table in tables for n in self.named[table])]
        self.refuse(where, f"{raw!r} is {self.none_of(options)}; {near(raw, words_known)}")

    def _check_body(self, body: str, where: str) -> None:
        if body not in self.bodies:
            self.refuse(where, f"there is no body {body!r}; {near(body, self.bodies)}")

    def shared(self, table: str, name: str, units: tuple[str, ...]) -> Call:
        """The object of a name in a table, the same for all users that need the same ``units``."""
        key, where = (table, name, units if table == "motions" else ()), f"{table}.{name}"
        if key not in self._made:
            self._made[key] = None
            hint = functools.reduce(operator.or_, NAMED[table])
            self._made[key] = self.value(hint, self.named[table][name], where, key[2])
        made = self._made[key]
        if made is None:
            self.refuse(where, "it needs itself")
        return made

    def none_of(self, options: list[Any]) -> str:
        """What a value is not, in words."""
        origins = {typing.get_origin(o) for o in options}
        words = {
            "name of a motion": Motion in options,
            'marker, as "body.marker"': _BODY_POINT in options,
            "name of one": Ground in options,
            "number": numeric(options),
            "whole number": int in options and float not in options,
            "text": str in options,
            "true or false": bool in options,
            "list": bool(origins & {tuple, *_LISTS}),
            "table": collections.abc.Mapping in origins or bool(kinds_of(options)),
        }
        words_ = " nor ".join(word for word, applies in words.items() if applies)
        return f"no {words_}" if words_ else "of no use here, which takes what only a program has"


# ---------------------------------------------------------------------- type hints


class Parameter(typing.NamedTuple):
    """A parameter of a class or function."""

    hint: Any
    required: bool


@cache
def arguments_of(target: Callable[..., Any]) -> dict[str, Parameter]:
    """The parameters of a class or function by name, but those that no file can give."""
    plain = inspect.isclass(target) and not is_dataclass(target)
    hints = typing.get_type_hints(
        target.__init__ if plain else target,
        localns={"Rotation": NoneType},  # of SciPy, which is not loaded for a hint
    )
    by_name = {
        n: p
        for n, p in inspect.signature(target).parameters.items()
        if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)
    }
    return {n: Parameter(hints[n], p.default is p.empty) for n, p in by_name.items()}


def alternatives(hint: Any) -> list[Any]:
    """What a hint allows, but None, functions and anything else that no file can hold."""
    types = typing.get_args(hint) if typing.get_origin(hint) in (Union, UnionType) else (hint,)
    options = []
    if set(types) >= _ARRAYS:
        types = tuple(type_ for type_ in types if type_ not in _ARRAYS)
        options.append(_ARRAY)
    for type_ in types:
        if len(types) > 1 and typing.get_origin(type_) in (Union, UnionType):
            options += alternatives(type_)
        elif typing.get_origin(type_) is np.ndarray:
            options.append(_ARRAY)
        elif (
            type_ not in (NoneType, Any)
            and typing.get_origin(type_) is not collections.abc.Callable
        ):
            options.append(type_)
    return list(dict.fromkeys(options))


def numeric(options: list[Any]) -> bool:
    """Whether a real number is allowed."""
    return float in options or _ARRAY in options


def near(word: str, known: Iterable[str]) -> str:
    """The known words that are near to another, or all of them."""
    words = list(known)
    matches = get_close_matches(word, words, 3, 0.6)
    if matches:
        return f"did you mean {' or '.join(map(repr, matches))}?"
    return f"there are {', '.join(words)}" if words else "there are none"


# ---------------------------------------------------------------------- numbers with units


def stated_units(target: Callable[..., Any]) -> dict[str, tuple[str, ...]]:
    """The units of the arguments of a class or function, by their names; "-" stands for none."""
    label = target.__qualname__
    return {
        name: _OTHER_UNITS.get((label, name), _UNITS.get(name, ("-",)))
        for name in arguments_of(target)
    }


def in_si(text: str, units: tuple[str, ...]) -> float:
    """A number with a unit in SI units, which must be one of some ``units``; any if there are none.

    Radians count: a moment is no stiffness by angle, and turns a second are no hertz.
    """
    if comma := _COMMA.fullmatch(text.strip()):
        point = "".join((comma[1], ".", *comma.groups()[1:]))
        raise ValueError(f'{text!r} has a decimal comma; write a point: "{point}"')
    match = _QUANTITY.fullmatch(text.strip())
    if match is None:
        raise ValueError(f'{text!r} is no number; write 0.04, or with its unit "40 mm"')
    number, unit = float(match[1]), match[2]
    if unit is None:
        return number
    try:
        factor, kind = _base(unit)
    except ImportError as error:
        raise ValueError(f"units need pint ({error}): install it, or write SI numbers") from error
    except Exception as error:  # what a reader of units meets within a text
        raise ValueError(f"{unit!r} is no unit that is known (in {text!r})") from error
    allowed = _kinds(units)
    if allowed and kind not in allowed:
        needed = " or ".join("no unit" if known == "-" else known for known in units)
        raise ValueError(f"{text!r} has a wrong unit: it takes {needed}")
    return number * factor


def _of_unit(stated: tuple[str, ...], of: tuple[str, ...]) -> tuple[str, ...]:
    """Units of a number of a motion, [m or rad] in general, that is ``of`` others."""
    if set(stated) == {"m", "rad"}:
        return of
    return stated if "m" not in stated or set(of) <= {"m", "rad"} else ()


def _kinds(units: tuple[str, ...]) -> set[str]:
    """Base units of some units; other words in brackets do not count."""
    bases = set()
    for unit in units:
        with suppress(Exception):
            bases.add(_base(unit)[1])
    return bases


@cache
def _base(unit: str) -> tuple[float, str]:
    """What one of a unit is in base units of SI, and these."""
    if unit == "-":
        return 1.0, "dimensionless"
    factor, base = _registry().get_base_units(_registry().parse_units(unit.replace("°", "deg")))
    if unit.count("deg") and "kelvin" in str(base):
        raise ValueError("a temperature is not possible here")
    return float(factor), str(base)


@cache
def _registry() -> Any:
    """The units that are known."""
    import pint  # takes a second

    registry: Any = pint.UnitRegistry()
    registry.define("rev = turn")
    return registry
