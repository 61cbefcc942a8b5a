# SPDX-License-Identifier: MIT
"""Compiled functions and the tables of arrays that they take.

A compiled function takes numbers and tables: named tuples of arrays, handed over as one pointer
to addresses and shapes. A named tuple itself would become some two hundred arguments of every
call, which compile for a minute; a table costs nothing.

Compiled functions call functions of another folder by address, so that each is compiled once and
none has to be compiled anew when the other changes.
"""

from __future__ import annotations

import ctypes
import gc
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, cached_property
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias, cast, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ..files import spare_directory
from ..surroundings import working_with_numpy

with working_with_numpy("numba"):
    from llvmlite import ir
    from numba import cfunc, njit, types
    from numba.core import cgutils, config
    from numba.core.dispatcher import Dispatcher
    from numba.core.typing.templates import AttributeTemplate
    from numba.extending import (
        infer_getattr,
        intrinsic,
        lower_getattr_generic,
        models,
        register_model,
    )
    from numba.np.arrayobj import populate_array

#: Arrays of one to four dimensions, as the fields of tables are declared.
Vector: TypeAlias = Annotated[NDArray[np.float64], 1]
Matrix: TypeAlias = Annotated[NDArray[np.float64], 2]
Array3: TypeAlias = Annotated[NDArray[np.float64], 3]
Array4: TypeAlias = Annotated[NDArray[np.float64], 4]
IntVector: TypeAlias = Annotated[NDArray[np.int64], 1]
IntMatrix: TypeAlias = Annotated[NDArray[np.int64], 2]

#: Kernels that are attributes of the classes of tables, by the name of their type. Types are stored
#: on disk, and must not contain kernels.
_KERNELS: dict[str, dict[str, Dispatcher]] = {}
#: A part of compiled functions, see :func:`kernel`.
Kernel: TypeAlias = Callable[..., Any]
#: Entries of one field in a table: the address, and up to four lengths.
_ENTRIES = 5
_NONE = (0,) * _ENTRIES


class TableType(types.Type):
    """Numba's type of a table; its name holds a digest of the sources that work on it.

    Numba stores compiled functions on disk by the types of their arguments. It compiles them anew
    when their own file changes, but not when the file of a called function does: hence the digest.
    """

    def __init__(
        self,
        name: str,
        fields: tuple[tuple[str, bool, int], ...],
        constants: dict[str, int],
        digest: str,
    ) -> None:
        self.fields, self.constants = fields, constants
        super().__init__(name=f"{name}_{digest}")

    def field_type(self, position: int) -> types.Array:
        """Type of a field."""
        _, real, dimensions = self.fields[position]
        return types.Array(types.float64 if real else types.int64, dimensions, "C")


@register_model(TableType)
class _TableModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: TableType) -> None:
        super().__init__(dmm, fe_type, ir.IntType(64).as_pointer())


@infer_getattr
class _TableFields(AttributeTemplate):
    key = TableType

    def generic_resolve(self, table: TableType, name: str) -> types.Type | None:
        if name in table.constants:
            return types.intp
        if name in _KERNELS[table.name]:
            return types.Dispatcher(_KERNELS[table.name][name])
        names = [field[0] for field in table.fields]
        return table.field_type(names.index(name)) if name in names else None


@lower_getattr_generic(TableType)
def _load_field(context: Any, builder: Any, table: TableType, pointer: Any, name: str) -> Any:
    if name in table.constants:
        return context.get_constant(types.intp, table.constants[name])
    if name in _KERNELS[table.name]:
        return context.get_dummy_value()
    position = [field[0] for field in table.fields].index(name)
    kind = table.field_type(position)
    entries = []
    for entry in range(1 + kind.ndim):
        place = context.get_constant(types.intp, _ENTRIES * position + entry)
        load = builder.load(builder.gep(pointer, [place]))
        # Tables do not change while compiled functions run: loads may leave loops.
        load.set_metadata("invariant.load", builder.module.add_metadata([]))
        entries.append(load)
    size = context.get_constant(types.intp, 8)
    strides = [size]
    for length in reversed(entries[2:]):
        strides.insert(0, builder.mul(strides[0], length))
    array = context.make_array(kind)(context, builder)
    data = builder.inttoptr(entries[0], context.get_data_type(kind.dtype).as_pointer())
    populate_array(
        array, data=data, shape=entries[1:], strides=strides, itemsize=size, meminfo=None
    )
    return array._getvalue()


@intrinsic
def call_at(_: Any, address: Any, arguments: Any) -> tuple:
    """Result of the compiled function at an address, an integer; arguments is a tuple."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kinds = [context.get_value_type(kind) for kind in signature.args[1]]
        kind = ir.FunctionType(ir.IntType(64), kinds)
        target = builder.inttoptr(values[0], kind.as_pointer())
        return builder.call(target, cgutils.unpack_tuple(builder, values[1]))

    return types.int64(address, arguments), generate


@cache
def table_type(arrays: type) -> TableType:
    """Numba's type of a named tuple of arrays, declared as Vector, Matrix and so on.

    Integers that are attributes of the class are constants of the functions that take such tables,
    and kernels that are attributes are called as such: so a kernel serves tables of several classes
    and leaves to each what they do in ways of their own.
    """
    hints = get_type_hints(arrays, include_extras=True)
    fields = []
    for name in arrays._fields:  # type: ignore[attr-defined]
        (dimensions,) = hints[name].__metadata__
        fields.append((name, "float64" in str(hints[name]), int(dimensions)))
    attributes = {n: v for n, v in vars(arrays).items() if n[0] != "_"}
    constants = {n: v for n, v in attributes.items() if isinstance(v, int)}
    sources = digest(Path(__file__).parent, arrays.__module__.split(".")[-2])
    table = TableType(arrays.__name__, tuple(fields), constants, sources)
    _KERNELS[table.name] = {n: v for n, v in attributes.items() if isinstance(v, Dispatcher)}
    return table


def sources(here: Path, folder: str) -> list[Path]:
    """Files on which compiled functions of a folder in `here`, or of `here` itself, depend."""
    files = [here / "compilation.py", here / "equations.py"]
    if folder != here.name:
        files += sorted((here / folder).glob("*.py"))
        # Kinds of rows and vectors are numbers in kernels.
        files.append(here.parent / "mechanism" / "rows.py")
    return files


def digest(here: Path, folder: str) -> str:
    """Digest of the sources of compiled functions, see :func:`sources`."""
    content = b"".join(file.read_bytes() for file in sources(here, folder))
    return sha256(content).hexdigest()[:16]


class Table:
    """Addresses and shapes of the arrays of a named tuple, which it keeps alive."""

    def __init__(self, arrays: NamedTuple) -> None:
        """Look up where the arrays are; refuse one that is not as its field declares."""
        self.arrays = arrays
        fields = table_type(type(arrays)).fields
        entries: list[int] = []
        for (name, real, dimensions), array in zip(
            fields, cast("tuple[NDArray, ...]", arrays), strict=True
        ):
            kind = np.float64 if real else np.int64
            if array.dtype != kind or array.ndim != dimensions or not array.flags.c_contiguous:
                raise TypeError(
                    f"{type(arrays).__name__}.{name} must be a contiguous array of "
                    f"{dimensions} dimensions of {kind.__name__}, but it is of {array.ndim} "
                    f"dimensions of {array.dtype}"
                )
            entries += (_address(array), *array.shape, *_NONE[dimensions + 1 :])
        self.entries = np.array(entries, dtype=np.int64)
        self.address = _address(self.entries)


def _address(array: Any) -> int:
    """Where an array begins in memory; zero of an empty one, where nothing is ever read."""
    if not array.size:
        return 0
    if array.flags.writeable:  # several times as fast as to ask the array
        return ctypes.addressof(ctypes.c_char.from_buffer(array))
    return int(array.__array_interface__["data"][0])


def kernel(function: Kernel) -> Kernel:
    """Compile a function as a part of the compiled functions that call it."""
    return njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)


class Compiled:
    """A function that is compiled at its first use, and cached on disk if possible."""

    def __init__(self, function: Callable[..., int], *arguments: Any) -> None:
        """Note a function that gives an integer, and the types of its arguments.

        They are float, int, or named tuples of arrays.
        """
        self.function, self.arguments = function, arguments

    @property
    def name(self) -> str:
        """Where the function is, and its name."""
        return ".".join([*self.function.__module__.split(".")[-2:], self.function.__name__])

    @property
    def ready(self) -> bool:
        """Whether the function has been compiled or loaded."""
        return "address" in self.__dict__

    def compile(self) -> None:
        """Compile the function, or load it from disk."""
        _ = self.address

    @cached_property
    def address(self) -> int:
        """Address of the compiled function; the first use compiles it or loads it from disk."""
        known = {float: types.float64, int: types.int64}
        kinds = [known.get(kind) or table_type(kind) for kind in self.arguments]
        signature, options = types.int64(*kinds), {"error_model": "numpy"}
        try:
            with _without_collector():
                self._native = cfunc(signature, cache=True, **options)(self.function)
        except RuntimeError:  # neither the package's directory nor the user's cache can be written
            before, spare = config.CACHE_DIR, spare_directory()
            try:
                config.CACHE_DIR = str(spare / "kernels") if spare else before
                self._native = cfunc(signature, cache=True, **options)(self.function)
            except RuntimeError:
                _warn_of_no_cache()
                self._native = cfunc(signature, **options)(self.function)
            finally:
                config.CACHE_DIR = before
        return int(self._native.address)

    @cached_property
    def _call(self) -> Callable[..., int]:
        known: dict[Any, Any] = {float: ctypes.c_double, int: ctypes.c_int64}
        kinds: list[Any] = [known.get(kind, ctypes.c_void_p) for kind in self.arguments]
        return ctypes.CFUNCTYPE(ctypes.c_int64, *kinds)(self.address)

    def __call__(self, *arguments: float | Table) -> int:
        """Result of the function for numbers and tables."""
        return int(self._call(*(a.address if isinstance(a, Table) else a for a in arguments)))


@cache
def _warn_of_no_cache() -> None:
    """Warn once that compiled code cannot be cached."""
    warnings.warn(
        "the time integration is compiled in each run, because neither the package's directory "
        "nor a cache directory can be written; set NUMBA_CACHE_DIR to a directory that can be "
        "written",
        stacklevel=2,
    )


@contextmanager
def _without_collector() -> Iterator[None]:
    """Context without garbage collection, which finds next to nothing and slows compilation."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def compiled(*arguments: Any) -> Callable[[Callable[..., int]], Compiled]:
    """Decorator that makes a compiled function, see :class:`Compiled`."""
    return lambda function: Compiled(function, *arguments)
