# SPDX-License-Identifier: MIT
"""Values of a scene file as arguments of the public API, by the type hints of its signatures."""

from __future__ import annotations

import collections.abc
import inspect
import os
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import is_dataclass
from difflib import get_close_matches
from functools import cache
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
from .calls import PACKAGE, Call, Name, SceneError, is_public, public_name, total, variables
from .materials import SOLIDS
from .quantities import in_si, looks_like_a_number, stated_units

Table = dict[str, Any]
#: Objects with names that other tables use, by the table in which they stand
NAMED: dict[str, tuple[type, ...]] = {
    "motions": (Motion,),
    "markers": (Ground, Moving),
    "materials": (ElasticMaterial,),
}
COMM = Name("comm", MPI.COMM_WORLD)
_ARRAYS = set(typing.get_args(ArrayLike))
#: Stands for arrays among what a hint allows
_ARRAY = "array"
_LISTS = (collections.abc.Sequence, collections.abc.Iterable, list)
_BODY_POINT = tuple[str, str]


class Reader:
    """Makes calls of the tables of a file.

    Args:
        file: For messages; paths in the file are relative to its folder.
        named: The tables of objects with names.
        bodies: Names of the bodies.
        variable: Makes names of variables of texts.
    """

    def __init__(
        self,
        file: Path,
        named: Mapping[str, Table],
        bodies: Iterable[str],
        variable: Callable[[str], str],
    ) -> None:
        self.file, self.named, self.bodies, self.variable = file, named, list(bodies), variable
        self._made: dict[tuple[str, str], Call | None] = {}

    def refuse(self, where: str, problem: str) -> NoReturn:
        """Raise the error of a place in the file."""
        raise SceneError(f"{self.file}: {where}: {problem}")

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
        self, kinds: Mapping[str, Callable[..., Any]], table: object, where: str, **given: Any
    ) -> Call:
        """The call that a table describes: one of some kinds, with its keys as arguments.

        Arguments that are ``given`` by their names are no keys of the table.
        """
        if not isinstance(table, dict):
            self.refuse(where, f"must be a table, but it is {validation.described(table)}")
        target, keys = self._chosen(kinds, table, where, given)
        parameters = arguments_of(target)
        if "name" in keys and {"young", "poisson", "density"} <= parameters.keys():
            keys = self._solid(keys, where)
        label = public_name(target).removeprefix("ffr.")
        own = {n: p for n, p in parameters.items() if n not in given and p.hint is not MPI.Comm}
        self.check_keys(where, keys, own, label)
        units = stated_units(target)
        if target is Constraint and "objective" in keys:
            keys = dict(keys)
            bounded = self.value(own["objective"].hint, keys["objective"], f"{where}.objective")
            unit = getattr(bounded.target, "unit", "")
            units |= dict.fromkeys(("upper", "lower"), (unit or "-",))
        found = {}
        for name, parameter in parameters.items():
            if parameter.hint is MPI.Comm:
                found[name] = COMM
            elif name in given:
                found[name] = given[name]
            elif name in keys:
                at = f"{where}.{name}"
                found[name] = self.value(parameter.hint, keys[name], at, units.get(name, ()))
            elif parameter.required:
                self.refuse(where, f"{label} needs the key {name!r}")
        return Call(target, found, f"{self.file}: {where}")

    def _chosen(
        self, kinds: Mapping[str, Callable[..., Any]], table: Table, where: str, given: Table
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
            if keys.keys() <= parameters.keys() and needed - given.keys() <= keys.keys():
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
        self.refuse(where, f"must be {self.described(options)}, but it is {raw!r}")

    def _of_table(self, options: list[Any], raw: Table, where: str, units: tuple[str, ...]) -> Any:
        mapping = [o for o in options if typing.get_origin(o) is collections.abc.Mapping]
        kinds = kinds_of(options)
        if kinds and not (mapping and "kind" not in raw):
            return self.call(kinds, raw, where)
        if not mapping:
            self.refuse(where, f"must be {self.described(options)}, but it is a table")
        inner = typing.get_args(mapping[0])[1]
        return {name: self.value(inner, v, f"{where}.{name}", units) for name, v in raw.items()}

    def _of_list(self, options: list[Any], raw: list[Any], where: str, units: tuple[str, ...]) -> Any:
        tuples = [typing.get_args(o) for o in options if typing.get_origin(o) is tuple]
        fitting = [t for t in tuples if t[1:] == (...,) or len(t) == len(raw)]
        if fitting:
            # of pairs of texts and of numbers that which begins alike
            texts = bool(raw) and isinstance(raw[0], str) and not looks_like_a_number(raw[0])
            chosen = next((t for t in fitting if (t[0] is str) == texts), fitting[0])
            hints = chosen[:1] * len(raw) if chosen[1:] == (...,) else chosen
            found = tuple(self._entries(hints, raw, where, units))
            if _BODY_POINT in options and chosen == typing.get_args(_BODY_POINT):
                self._check_body(found[0], where)
            return found
        lists = [o for o in options if typing.get_origin(o) in _LISTS]
        if lists:
            hints = typing.get_args(lists[0]) * len(raw)
            return list(self._entries(hints, raw, where, units))
        if Motion in options:
            parts = [self.value(Motion | float, v, f"{where}, entry {k}", units) for k, v in enumerate(raw, 1)]
            return Call(total, {"motions": parts}, f"{self.file}: {where}")
        if _ARRAY in options:
            return list(self._entries([ArrayLike] * len(raw), raw, where, units))
        if tuples:
            counts = " or ".join(sorted({str(len(t)) for t in tuples}))
            self.refuse(where, f"must have {counts} entries, but there are {len(raw)}")
        self.refuse(where, f"must be {self.described(options)}, but it is a list")

    def _entries(
        self, hints: Iterable[Any], raw: list[Any], where: str, units: tuple[str, ...]
    ) -> Iterator[Any]:
        for k, (hint, entry) in enumerate(zip(hints, raw, strict=True), 1):
            label = entry.get("name") if isinstance(entry, dict) else None
            said = f"{where}[{k}]" + (f" ({label})" if isinstance(label, str) else "")
            yield self.value(hint, entry, said, units)

    def _of_text(self, options: list[Any], raw: str, where: str, units: tuple[str, ...]) -> Any:
        for table, kinds in NAMED.items():
            if set(kinds) & set(options) and raw in self.named[table]:
                return self.shared(table, raw)
        if looks_like_a_number(raw) and str not in options:
            if numeric(options):
                try:
                    return in_si(raw, units)
                except ValueError as error:
                    self.refuse(where, str(error))
            if int in options:
                self.refuse(where, f"must be a whole number, but it is {raw!r}")
        if any(isinstance(o, type) and issubclass(o, os.PathLike) for o in options):
            path = self.file.parent / raw
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
        known = [*words, *kinds]
        for table, types in NAMED.items():
            known += self.named[table] if set(types) & set(options) else []
        if _BODY_POINT in options:
            known += [f"{body}.…" for body in self.bodies]
        needed = self.described(options)
        self.refuse(where, f"must be {needed}, but it is {raw!r}" + (f"; {near(raw, known)}" if known else ""))

    def _check_body(self, body: str, where: str) -> None:
        if body not in self.bodies:
            self.refuse(where, f"there is no body {body!r}; {near(body, self.bodies)}")

    def shared(self, table: str, name: str) -> Call:
        """The object of a name in a table, the same for all its users."""
        key, where = (table, name), f"{table}.{name}"
        if key not in self._made:
            self._made[key] = None
            found = self.value(Union[NAMED[table]], self.named[table][name], where)
            call = Call(found.target, found.arguments, found.where, self.variable(name))
            self._made[key] = call
        known = self._made[key]
        if known is None:
            self.refuse(where, "it needs itself")
        return known

    def described(self, options: list[Any]) -> str:
        """What a value may be, in words."""
        words = []
        if Motion in options:
            words.append("the name of a motion")
        if set(NAMED["markers"]) & set(options):
            words.append('a marker, as "body.marker" or a name of [markers]')
        if numeric(options):
            words.append("a number")
        elif int in options:
            words.append("a whole number")
        words += ["true or false"] if bool in options and not numeric(options) else []
        words += ["a text"] if str in options else []
        origins = {typing.get_origin(o) for o in options}
        words += ["a list"] if origins & {tuple, *_LISTS} else []
        words += ["a table"] if collections.abc.Mapping in origins or kinds_of(options) else []
        words += ["one of " + ", ".join(kinds_of(options))] if len(words) == 1 and kinds_of(options) else []
        return " or ".join(words) or "left to a program (a scene file has no functions)"


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
        target.__init__ if plain else target,  # type: ignore[misc]
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
    parts = typing.get_args(hint) if typing.get_origin(hint) in (Union, UnionType) else (hint,)
    found = []
    if set(parts) >= _ARRAYS:
        parts = tuple(part for part in parts if part not in _ARRAYS)
        found.append(_ARRAY)
    for part in parts:
        if len(parts) > 1 and typing.get_origin(part) in (Union, UnionType):
            found += alternatives(part)
        elif typing.get_origin(part) is np.ndarray:
            found.append(_ARRAY)
        elif part not in (NoneType, Any) and typing.get_origin(part) is not collections.abc.Callable:
            found.append(part)
    return list(dict.fromkeys(found))


def numeric(options: list[Any]) -> bool:
    """Whether a real number is allowed."""
    return float in options or _ARRAY in options


@cache
def _below(kind: type) -> tuple[type, ...]:
    """A class and all that derive from it."""
    return (kind, *(each for child in kind.__subclasses__() for each in _below(child)))


def kinds_of(options: Iterable[Any]) -> dict[str, Callable[..., Any]]:
    """The classes, and their other constructors, by which a table can make one of some kinds."""
    found: dict[str, Callable[..., Any]] = {}
    for option in options:
        if not (isinstance(option, type) and option.__module__.startswith(PACKAGE.__name__)):
            continue
        for kind in _implementing(option) if getattr(option, "_is_protocol", False) else _below(option):
            if not is_public(kind) or inspect.isabstract(kind):
                continue
            makers = {kind.__name__: kind} | {
                name: getattr(kind, name)
                for name, member in vars(kind).items()
                if isinstance(member, classmethod | staticmethod)
                and not name.startswith("_")
                and _returned(getattr(kind, name)) in (kind, typing.Self)
            }
            found |= {name: maker for name, maker in makers.items() if _can_be_written(maker)}
    return found


def _returned(function: Callable[..., Any]) -> Any:
    try:
        return typing.get_type_hints(function).get("return")
    except NameError:
        return None


def _can_be_written(target: Callable[..., Any]) -> bool:
    """Whether each argument that is needed has a value that a file can hold."""
    return all(
        p.hint is MPI.Comm or any(_writable(option) for option in alternatives(p.hint))
        for p in arguments_of(target).values()
        if p.required
    )


def _writable(option: Any) -> bool:
    """Whether a file can hold a value: no object of another package."""
    own = getattr(option, "__module__", "").startswith((PACKAGE.__name__, "pathlib", "os"))
    return own or option in (float, int, str, bool, _ARRAY) or bool(typing.get_origin(option))


@cache
def _implementing(protocol: type) -> tuple[type, ...]:
    """The classes that derive from a protocol, or else have its methods and their signatures."""
    if derived := _below(protocol)[1:]:
        return derived
    methods = {n: f for n, f in vars(protocol).items() if inspect.isfunction(f) and _counts(n)}

    def fits(kind: type) -> bool:
        own = {n: getattr(kind, n) for n in methods if any(n in vars(c) for c in kind.__mro__)}
        return own.keys() == methods.keys() and all(
            str(inspect.signature(own[n])) == str(inspect.signature(f)) for n, f in methods.items()
        )

    every = (getattr(PACKAGE, name) for name in PACKAGE.__all__)
    return tuple(kind for kind in every if is_dataclass(kind) and fits(kind))


def _counts(name: str) -> bool:
    return name == "__call__" or not name.startswith("_")


def near(word: str, known: Iterable[str]) -> str:
    """The known words that are near to another, or all of them."""
    words = list(known)
    found = get_close_matches(word, words, 3, 0.6)
    if found:
        return f"did you mean {' or '.join(map(repr, found))}?"
    return f"there are {', '.join(words)}" if words else "there are none"
