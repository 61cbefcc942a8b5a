# SPDX-License-Identifier: MIT
"""Agreement of the ranks of a communicator: on the calls that they make, errors and arguments.

Code of users (callbacks, objectives, motions, laws of the material) runs on every rank, and may
fail on one of them alone. The others would then wait for it for ever in the next collective call.
So such code is called within a section (`on_every_rank`): at its end the ranks tell each other how
it went, and an error of one is raised on all. A collective call within a section announces itself
beforehand (`announce`), and learns there that a rank has already left.
"""

from __future__ import annotations

import pickle
import re
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .limits import available_memory

#: Bound of the relative difference of two sums over cells that are distributed differently: n
#: positive terms in two orders differ by less than n times 2.3e-16, and bodies have less than 4e6
#: cells
ROUND_OFF = 1e-9
#: A number in a text
_NUMBER = re.compile(r"(\d+\.?\d*(?:e[-+]?\d+)?)")
#: Characters that a message shows of a long text on either side of the first difference
_EXCERPT = 60
#: Time after which a rank prints the call in which it waits for the others [s]
_PATIENCE = 60.0


class _UnmatchedCall(RuntimeError):
    """A collective call that not all ranks make."""


# ---------------------------------------------------------------------- errors


def _common_communicator(comm: MPI.Comm) -> MPI.Comm:
    """The communicator of all ranks, if the given one spans them, as the one of each mesh does.

    So ranks that make different collective calls meet in the same communicator.
    """
    spans_all_ranks = MPI.Comm.Compare(comm, MPI.COMM_WORLD) in (MPI.IDENT, MPI.CONGRUENT)
    return MPI.COMM_WORLD if spans_all_ranks else comm


def announce(comm: MPI.Comm, call: str) -> None:
    """Go on with a collective call if all ranks make it, else raise on those that do."""
    gathered(comm, call, None)


def gathered(comm: MPI.Comm, call: str, value: Any) -> list[Any]:
    """The values of all ranks on every rank, if all make the same collective call."""
    if comm.size == 1:
        return [value]
    by_rank = _exchanged(_common_communicator(comm), (call, value), call)
    calls = [rank_call for rank_call, _ in by_rank]
    if calls != [call] * comm.size:
        callers = [rank for rank, rank_call in enumerate(calls) if rank_call == call]
        ranks = ", ".join(map(str, callers))
        raise _UnmatchedCall(
            f"{call} was called on rank {ranks} of {comm.size} only; it takes all ranks: call it "
            "outside of conditions that differ between ranks"
        )
    return [rank_value for _, rank_value in by_rank]


def _exchanged(comm: MPI.Comm, value: Any, call: str) -> list[Any]:
    """The values of all ranks; a rank that waits long for the others prints once in which call.

    A rank whose program has ended, or that never makes the call, looks like a slow one.
    """
    alarm = threading.Timer(_PATIENCE, _say_who_waits, [comm.rank, comm.size, call])
    alarm.daemon = True
    alarm.start()
    try:
        return comm.allgather(value)
    finally:
        alarm.cancel()


def _say_who_waits(rank: int, size: int, call: str) -> None:
    print(
        f"dolfinx_ffr: rank {rank} of {size} has waited for {_PATIENCE:g} s in {call}, which takes "
        "all ranks. If another rank has ended, or never makes this call, stop the program: it "
        "will wait for ever",
        file=sys.stderr,
        flush=True,
    )


@contextmanager
def on_every_rank(comm: MPI.Comm, what: str) -> Iterator[None]:
    """Raise on all ranks, at the end of a section, an error that was raised in it on any rank.

    The error of the lowest rank that fails is raised, also if it is `sys.exit` or an interrupt;
    where all ranks fail by the same kind of error, each raises its own.
    """
    if comm.size == 1:
        yield
        return

    announce(comm, what)
    comm = _common_communicator(comm)
    own_error: BaseException | None = None
    try:
        yield
    except BaseException as caught:  # a rank that leaves by `sys.exit` would be waited for, too
        own_error = caught

    # a rank that is still inside learns of the error by its next call that takes all ranks
    own_kind = "" if own_error is None else _kind(own_error)
    outcomes = _exchanged(comm, (None, own_kind), what)
    while any(call is not None for call, _ in outcomes):
        outcomes = _exchanged(comm, (None, own_kind), what)
    kinds = [kind for _, kind in outcomes]
    failed = [rank for rank, kind in enumerate(kinds) if kind]
    if not failed:
        return
    if own_error is not None and kinds == [own_kind] * comm.size:
        raise own_error

    # unmatched calls follow from another error, if there is one
    source = min(failed, key=lambda rank: (kinds[rank] == _kind(_UnmatchedCall()), rank))
    sent = _portable(own_error) if comm.rank == source else None
    error = comm.bcast(sent, root=source)
    if sent is None:
        error.add_note(f"raised on rank {source} of {comm.size}")
        raise error
    if sent is own_error:
        raise sent
    raise sent from own_error


def _kind(error: BaseException) -> str:
    """The class of an error, with its module."""
    return f"{type(error).__module__}.{type(error).__qualname__}"


def _portable(error: BaseException | None) -> BaseException | None:
    """The error, or its message alone where it cannot be pickled."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # whatever pickle meets within it
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def on_rank_0(comm: MPI.Comm, action: Callable[[], Any]) -> Any:
    """Run an ``action`` on rank 0; return its result, or raise its error, on every rank."""
    result = None
    with on_every_rank(comm, "writing or reading a file"):
        if comm.rank == 0:
            result = action()
    return comm.bcast(result, root=0)


def agreed_memory(comm: MPI.Comm) -> int:
    """Least memory that a rank may take [bytes]."""
    neighbours = comm.Split_type(MPI.COMM_TYPE_SHARED)
    sharing = neighbours.size
    neighbours.Free()
    return int(comm.allreduce(available_memory(sharing), MPI.MIN))


# ---------------------------------------------------------------------- arguments


def check_alike(
    comm: MPI.Comm, where: str, arguments: Mapping[str, Any], tolerance: float = ROUND_OFF
) -> None:
    """Refuse arguments, by name, that differ between the ranks by more than round-off.

    Arrays are compared by their norms; other objects by the numbers and texts that they hold as
    mappings, sequences and dataclasses.
    """
    if comm.size == 1:
        return
    texts = {
        name: in_words(value, arrays=isinstance(value, np.ndarray))
        for name, value in arguments.items()
    }
    by_rank = gathered(comm, where, texts)
    for name in dict.fromkeys(name for texts in by_rank for name in texts):
        on_root = by_rank[0].get(name, "nothing")
        for rank, texts in enumerate(by_rank):
            on_rank = texts.get(name, "nothing")
            if not nearly_equal(on_root, on_rank, tolerance):
                root_excerpt, rank_excerpt = _first_difference(on_root, on_rank)
                raise ValueError(
                    f"{where}: {name} differs between the ranks: {root_excerpt} on rank 0, and "
                    f"{rank_excerpt} on rank {rank}; give the same on every rank"
                )


def _first_difference(one: str, other: str) -> tuple[str, str]:
    """Excerpts of two texts around their first difference."""
    pairs = zip(one, other, strict=False)
    place = next((i for i, (a, b) in enumerate(pairs) if a != b), 0)
    excerpt = slice(max(0, place - _EXCERPT), place + _EXCERPT)
    return one[excerpt], other[excerpt]


def nearly_equal(one: ArrayLike, other: ArrayLike, tolerance: float = ROUND_OFF) -> bool:
    """Whether two arrays or texts are equal but for the round-off of the numbers in them.

    The tolerance is relative to the largest number of an array. Whole numbers must be equal.
    """
    a, b = np.asarray(one), np.asarray(other)
    if a.shape != b.shape:
        return False
    if a.dtype.kind == "U" and b.dtype.kind == "U":
        return _nearly_equal_texts(str(a), str(b), tolerance)
    if a.dtype.kind != "f" or b.dtype.kind != "f":
        return bool(np.array_equal(a, b))
    if np.array_equal(a, b, equal_nan=True):
        return True
    return bool(np.max(np.abs(a - b)) <= tolerance * np.max(np.abs(b)))


def _nearly_equal_texts(one: str, other: str, tolerance: float) -> bool:
    """Whether two texts differ in the last digits of their numbers at most."""
    pieces, other_pieces = _NUMBER.split(one), _NUMBER.split(other)
    if pieces[::2] != other_pieces[::2]:  # the words between the numbers
        return False
    for a, b in zip(pieces[1::2], other_pieces[1::2], strict=True):
        counts = a.isdigit() and b.isdigit()  # whole numbers count something
        if a != b and (counts or not nearly_equal(float(a), float(b), tolerance)):
            return False
    return True


def alike(one: object, other: object) -> bool:
    """Whether two objects hold the same numbers and texts, but for round-off."""
    return one is other or nearly_equal(in_words(one, arrays=True), in_words(other, arrays=True))


def in_words(value: Any, *, arrays: bool = False) -> str:
    """A text of the numbers and texts in an object, and of the classes of its other parts.

    Arrays, which may differ between ranks, stand in it by their class alone unless ``arrays`` asks
    for their norms.
    """
    try:
        return _words(value, arrays)
    except RecursionError:
        return f"a {type(value).__qualname__} that holds itself"


def _words(value: Any, arrays: bool) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k!r}: {_words(v, arrays)}" for k, v in value.items()) + "}"
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return "(" + ", ".join(_words(entry, arrays) for entry in value) + ")"
    if is_dataclass(value) and not isinstance(value, type):
        entries = [
            f"{field.name}={_words(getattr(value, field.name), arrays)}"
            for field in fields(value)
            if field.compare
        ]
        return f"{type(value).__name__}({', '.join(entries)})"
    if arrays and isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        return _norms(value)
    if isinstance(value, np.generic):  # whose type NumPy 2 writes into the text
        value = value.item()
    if isinstance(value, str | bytes | int | float | complex) or value is None:
        return repr(value)
    return type(value).__qualname__


def _norms(array: NDArray[Any]) -> str:
    """The size of an array and two norms; the second norm depends on order and signs."""
    x = array.ravel().astype(np.float64)
    norm = float(np.linalg.norm(x))
    shifts = norm * (2.0 + np.cos(np.arange(x.size)))  # at least as large as -x: nothing cancels
    return f"{x.size} numbers of norm {norm!r} (shifted {float(np.linalg.norm(x + shifts))!r})"
