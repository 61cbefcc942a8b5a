# SPDX-License-Identifier: MIT
"""CHOLMOD's factor of a sparse matrix by an order of its unknowns, in its parts.

PETSc solves with a whole factor only. Where ranks factor a body together, each needs solutions with
L and L^T, and the end of L; so the library that PETSc has loaded is called itself.
"""

from __future__ import annotations

import ctypes
from ctypes import c_double, c_int, c_size_t, c_void_p
from functools import cache
from typing import Any

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Integers

#: Main versions whose structures are those below
VERSIONS = 3, 4, 5


class _Common(ctypes.Structure):
    """The head of CHOLMOD's settings, up to the first ordering, and room for the rest."""

    _fields_ = (
        ("_growth", c_double * 3),
        ("_grow2", c_size_t),
        ("maxrank", c_size_t),
        ("supernodal_switch", c_double),
        ("supernodal", c_int),
        ("_final", c_int * 6),
        ("_zrelax", c_double * 3),
        ("_nrelax", c_size_t * 3),
        ("_preferences", c_int * 4),
        ("print", c_int),
        ("_precise", c_int * 2),
        ("_handler", c_void_p),
        ("nmethods", c_int),
        ("_selected", c_int * 2),
        ("_method", c_double * 14),
        ("_choices", c_int * 5),
        ("ordering", c_int),
        ("_rest", c_double * 2048),
    )


class _Sparse(ctypes.Structure):
    _fields_ = (
        *((name, c_size_t) for name in ("nrow", "ncol", "nzmax")),
        *((name, c_void_p) for name in ("p", "i", "nz", "x", "z")),
        *((name, c_int) for name in ("stype", "itype", "xtype", "dtype", "sorted", "packed")),
    )


class _Dense(ctypes.Structure):
    _fields_ = (
        *((name, c_size_t) for name in ("nrow", "ncol", "nzmax", "d")),
        *((name, c_void_p) for name in ("x", "z")),
        *((name, c_int) for name in ("xtype", "dtype")),
    )

    @classmethod
    def of(cls, block: Array) -> _Dense:
        """A ``block`` in Fortran's order, which must outlive it."""
        n, columns = block.shape
        return cls(n, columns, block.size, max(n, 1), block.ctypes.data, None, _REAL, 0)


class _Factor(ctypes.Structure):
    _fields_ = (
        *((name, c_size_t) for name in ("n", "minor")),
        *((name, c_void_p) for name in ("perm", "colcount", "iperm")),
        ("nzmax", c_size_t),
        *((name, c_void_p) for name in ("p", "i", "x", "z", "nz", "next", "prev")),
        *((name, c_size_t) for name in ("nsuper", "ssize", "xsize", "maxcsize", "maxesize")),
        *((name, c_void_p) for name in ("super", "pi", "px", "s")),
        *((name, c_int) for name in ("ordering", "is_ll", "is_super", "is_monotonic")),
        *((name, c_int) for name in ("itype", "xtype", "dtype", "gpu")),
    )


_NO_MEMORY = 'reduction: no memory for the factor of a part of the body: take solver="iterative"'
_REAL, _SIMPLICIAL, _SUPERNODAL, _GIVEN = 1, 0, 2, 1
_LONG = PETSc.IntType().itemsize == 8


@cache
def _library() -> tuple[Any, _Common] | None:
    """CHOLMOD as PETSc has loaded it, and its settings; None without a known version."""
    library, common, version = ctypes.CDLL(PETSc.__file__), _Common(), (c_int * 3)()
    try:
        library.cholmod_version(version)
        _call(library, "start", ctypes.byref(common))
    except AttributeError:  # PETSc is built without it
        return None
    begins = common.maxrank, common.supernodal_switch, common.print, common.nmethods
    if version[0] not in VERSIONS or begins != (8, 40.0, 3, 0):
        return None
    common.print = 0
    return library, common


def _call(library: Any, name: str, *arguments: Any, result: Any = c_int) -> Any:
    function = getattr(library, f"cholmod_{'l_' if _LONG else ''}{name}")
    function.restype = result
    return function(*arguments)


def is_known() -> bool:
    """Whether PETSc has loaded a CHOLMOD whose structures are known."""
    return _library() is not None


class OrderedFactor:
    """L L^T of symmetric matrices of one pattern, some unknowns at its end.

    Args:
        begins: Where rows begin (n + 1,), as PETSc stores them, in its integers.
        columns: Columns of the entries of the whole matrix, sorted within rows.
        at_end: Mask of the unknowns that come after all others.

    Attributes:
        size: Number of unknowns n.
        places: Place of each unknown in L (n,).
        entries: Numbers that L holds, zeros in its blocks among them.
    """

    def __init__(self, begins: NDArray[Any], columns: NDArray[Any], at_end: NDArray[np.bool_]):
        library = _library()
        assert library is not None
        self._library, self._common = library
        n = self.size = len(begins) - 1
        self._values = np.zeros(len(columns))
        self._matrix = self._sparse(begins, columns, self._values)
        interior = np.flatnonzero(~at_end)
        number = np.cumsum(~at_end) - 1
        rows = np.repeat(np.arange(n), np.diff(begins))
        inner = ~at_end[rows] & ~at_end[columns]
        counts = np.bincount(number[rows[inner]], minlength=len(interior))
        ends = np.concatenate([[0], np.cumsum(counts)]).astype(PETSc.IntType)
        inside = number[columns[inner]].astype(PETSc.IntType)
        ordering = self._analysed(self._sparse(ends, inside, None), None)
        order = interior[self._integers(ordering, "perm", len(interior))]
        self._free(ordering)
        order = np.concatenate([order, np.flatnonzero(at_end)]).astype(PETSc.IntType)
        self._factor = self._analysed(self._matrix, order)
        self.places = np.argsort(self._integers(self._factor, "perm", n))
        self.entries = int(self._factor.contents.xsize)
        self._corner = self._corner_entries(np.sort(self.places[at_end]))

    def _sparse(self, begins: NDArray[Any], rows: NDArray[Any], values: Array | None) -> _Sparse:
        """A symmetric matrix; CHOLMOD reads its upper part."""
        n, address = len(begins) - 1, None if values is None else values.ctypes.data
        kind = 0 if values is None else _REAL
        matrix = _Sparse(n, n, len(rows), begins.ctypes.data, rows.ctypes.data, None, address, None)
        matrix.stype, matrix.itype, matrix.xtype = 1, 2 if _LONG else 0, kind
        matrix.sorted, matrix.packed = 1, 1
        matrix.held = begins, rows, values  # CHOLMOD only points at them
        return matrix

    def _analysed(self, matrix: _Sparse, order: NDArray[Any] | None) -> Any:
        """A factor without numbers, by an ``order`` or, column by column, by the best one."""
        common, address = self._common, None if order is None else order.ctypes.data
        common.supernodal = _SIMPLICIAL if order is None else _SUPERNODAL
        common.nmethods, common.ordering = int(order is not None), _GIVEN
        arguments = ctypes.byref(matrix), c_void_p(address), None, c_size_t(0), ctypes.byref(common)
        result = ctypes.POINTER(_Factor)
        factor = _call(self._library, "analyze_p", *arguments, result=result)
        if not factor or factor.contents.n != matrix.nrow:
            raise MemoryError(_NO_MEMORY)
        return factor

    def _integers(self, factor: Any, name: str, count: int) -> Integers:
        kind = ctypes.c_int64 if _LONG else ctypes.c_int32
        numbers = (kind * count).from_address(getattr(factor.contents, name)) if count else ()
        return np.array(numbers, dtype=np.int64)

    def _corner_entries(self, ends: Integers) -> tuple[Integers, Integers, Integers]:
        """Where the entries of L in the rows ``ends`` stand, their rows and columns there."""
        factor = self._factor
        count = int(factor.contents.nsuper) + 1
        first_columns, begins, blocks = (
            self._integers(factor, k, count) for k in ("super", "pi", "px")
        )
        rows = self._integers(factor, "s", int(factor.contents.ssize))
        is_at_end = np.zeros(int(factor.contents.n), dtype=bool)
        is_at_end[ends] = True
        entries = []
        for k in np.unique(np.searchsorted(first_columns, ends, side="right") - 1):
            of_block = rows[begins[k] : begins[k + 1]]
            columns = np.arange(first_columns[k], first_columns[k + 1])
            i, j = np.nonzero((of_block[:, None] >= columns) & is_at_end[columns])
            entries.append((blocks[k] + i + len(of_block) * j, of_block[i], columns[j]))
        if not entries:
            return (np.zeros(0, dtype=np.int64),) * 3
        places, i, j = map(np.concatenate, zip(*entries, strict=True))
        return places, np.searchsorted(ends, i), np.searchsorted(ends, j)

    def factor(self, values: Array) -> bool:
        """Factor the matrix of ``values`` of the entries; whether it is positive definite."""
        self._values[:] = values
        common = ctypes.byref(self._common)
        if not _call(self._library, "factorize", ctypes.byref(self._matrix), self._factor, common):
            raise MemoryError(_NO_MEMORY)
        return bool(self._factor.contents.minor == self._factor.contents.n)

    def corner(self, count: int) -> Array:
        """L in the rows and columns of the last ``count`` unknowns, as they stand in L."""
        contents, (places, i, j) = self._factor.contents, self._corner
        result = np.zeros((count, count))
        if count and contents.x:
            numbers = (c_double * contents.xsize).from_address(contents.x)
            result[i, j] = np.ctypeslib.as_array(numbers)[places]
        return result

    def solve(self, block: Array) -> Array:
        """The inverse times a ``block``."""
        local = np.empty(block.shape, order="F")
        local[self.places] = block
        self.forward(local)
        self.backward(local)
        return local[self.places]

    def forward(self, block: Array) -> None:
        """L^-1 times a ``block`` in Fortran's order, rows as in L, in its place."""
        self._half("super_lsolve", block)

    def backward(self, block: Array) -> None:
        """L^-T times a ``block`` in Fortran's order, rows as in L, in its place."""
        self._half("super_ltsolve", block)

    def _half(self, name: str, block: Array) -> None:
        work = np.empty((max(int(self._factor.contents.maxesize), 1), block.shape[1]), order="F")
        sides = (ctypes.byref(_Dense.of(dense)) for dense in (block, work))
        done = _call(self._library, name, self._factor, *sides, ctypes.byref(self._common))
        assert done, "sizes that do not fit"

    def _free(self, factor: Any) -> None:
        _call(self._library, "free_factor", ctypes.byref(factor), ctypes.byref(self._common))

    def destroy(self) -> None:
        """Free the factor."""
        self._free(self._factor)
