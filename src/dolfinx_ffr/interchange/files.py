# SPDX-License-Identifier: MIT
"""Files of bodies by their ending or the name of their format."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from .. import validation
from .exudyn import Exudyn
from .format import FEATURES, Arrays, Format, InterchangeWarning, ReadableFormat
from .nastran import Nastran
from .numpy_file import NumpyFile
from .sid import StandardInputData
from .simscape import Simscape

_KINDS = (NumpyFile(), StandardInputData(), Exudyn(), Nastran(), Simscape())
#: What reading a damaged file may end with
_DAMAGED = (LookupError, MemoryError, OverflowError, RecursionError, TypeError, ValueError)
#: By the name of the format
FORMATS: dict[str, Format] = {kind.name: kind for kind in _KINDS}


def write_body(path: str | Path, arrays: Arrays, format: str | None = None) -> None:
    """Write a body, ``arrays`` by key, to a ``path`` in a ``format``, by default of the ending.

    Raises:
        ValueError: If format or ending are not known, or the format cannot hold the body.
        OSError: If the file cannot be written.

    Warns:
        InterchangeWarning: If the body has something that the format cannot hold.
    """
    path, kind = _kind(path, format)
    if kind.name != "npz" and arrays["S"].shape[1] != 3:
        raise ValueError(
            f"body file {path}: the format {kind.name!r} is for bodies in space, but this body is "
            "in the plane; take FlexibleBody.in_space(reduced), or extruded(thickness, moments) "
            "of its integrals"
        )
    left_out = [
        feature
        for feature, keys in FEATURES.items()
        if feature not in kind.holds and any(key in arrays and np.any(arrays[key]) for key in keys)
    ]
    if kind.name != "npz" and left_out:
        warnings.warn(
            f"body file {path}: the format {kind.name!r} cannot hold {', '.join(left_out)}, which "
            "the file leaves out",
            InterchangeWarning,
            stacklevel=3,
        )
    kind.write(path, arrays)


def read_body(path: str | Path, format: str | None = None) -> dict[str, Any]:
    """The arrays by key of the body at a ``path``, in a ``format`` as of `write_body`.

    Raises:
        ValueError: If the file is damaged, or holds no body.
        OSError: If it cannot be read.
    """
    path, kind = _kind(path, format)
    if not isinstance(kind, ReadableFormat):
        raise ValueError(
            f"body file {path}: the format {kind.name!r} cannot be read, as its matrices of small "
            "motions do not determine a body that turns; save an .npz for this package"
        )
    try:
        arrays = kind.read(path)
    except (
        LookupError,
        MemoryError,
        OverflowError,
        RecursionError,
        TypeError,
        ValueError,
    ) as error:
        message = str(error)
        if not message.startswith("body file"):
            message = f"body file {path}: {message}"
        raise ValueError(message) from error

    if kind.name != "npz":
        # moments that are zero in the body, as across a flat one, are round-off after contractions
        P = arrays["P"]
        size = np.sqrt(np.abs(np.einsum("aakk->a", P)))
        arrays["P"] = np.where(
            np.abs(P) > 1e-13 * np.multiply.outer(size, size)[..., None, None], P, 0.0
        )
    return arrays


def _kind(path: str | Path, format: str | None) -> tuple[Path, Format]:
    """The path, and the format of that name or with that ending."""
    path = validation.path("body file", path)
    if format is not None:
        return path, FORMATS[validation.choice("body file: format", format, FORMATS)]
    for kind in FORMATS.values():
        if path.suffix.lower() in [ending.lower() for ending in kind.endings]:
            return path, kind
    endings = ", ".join(kind.endings[0] for kind in FORMATS.values() if kind.endings)
    raise ValueError(
        f"body file {path}: the name must end in {endings}, or give format=, one of {list(FORMATS)}"
    )
