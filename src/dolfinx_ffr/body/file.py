# SPDX-License-Identifier: MIT
"""Volume integrals of a body in a NumPy file (.npz), to hand bodies from one code to another.

With r shape functions and n markers the file holds these arrays, in SI units and in the notation
of :class:`VolumeIntegrals`:

| key | shape | |
|---|---|---|
| ``mass`` | () | mass |
| ``S`` | (r + 1, d) | int rho w_a, d = 2 in the plane and 3 in space |
| ``G``, ``N`` | (r + 1, r + 1) each | int rho w_a . w_b and int rho (J w_a) . w_b |
| ``P`` | (r + 1, r + 1, d, d) | int rho w_a w_b^T, instead of G and N; in space always |
| ``K`` | (r, r) | reduced stiffness; may be missing for a rigid body |
| ``stiffening_omega2`` | (r, r) | geometric stiffness by omega^2; these three may be missing |
| ``stiffening_alpha`` | (r, r) | geometric stiffness by the angular acceleration |
| ``stiffening_rotation`` | (3, 3, r, r) | in space instead of both, see :class:`VolumeIntegrals` |
| ``stiffening_acceleration`` | (d, r, r) | by the acceleration of the frame along its axes |
| ``markers`` | (n,) | names; these four may be missing for a body without markers |
| ``marker_positions`` | (n, d) | undeformed positions in the body's frame |
| ``marker_displacements`` | (n, d, r) | shape functions of the displacement at the markers |
| ``marker_rotations`` | (n, r) | shape functions of the rotation there; in space (n, 3, r) |
| ``marker_stiffening`` | (n, d, r, r) | geometric stiffness by unit forces there; may be missing |
| ``marker_axes`` | (n, 3, 3) | axes of the markers as columns, in space; may be missing |

A marker whose geometric stiffness is all zero has none.

``numpy.savez`` writes such a file from anywhere.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..files import replace_file

__all__ = ["checked_ending", "read_arrays", "write_arrays"]

_MARKERS = ["markers", "marker_positions", "marker_displacements", "marker_rotations"]
_MARKER_STIFFENING, _MARKER_AXES = "marker_stiffening", "marker_axes"
_STIFFENING = {
    f"stiffening_{load}": load for load in ("omega2", "alpha", "rotation", "acceleration")
}
_KEYS = ["mass", "S", "G", "N", "P", "K", *_STIFFENING, *_MARKERS, _MARKER_STIFFENING]
_KEYS.append(_MARKER_AXES)


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays to a file; an older one is replaced when all is written.

    Args:
        path: The file.
        arrays: Arrays by key.

    Raises:
        OSError: If the file cannot be written.
    """
    content = io.BytesIO()
    np.savez(content, **arrays)
    replace_file(path, content.getvalue())


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read the arrays of a body.

    Args:
        path: The file.

    Raises:
        ValueError: If the file is damaged, a key is missing or unknown, or the arrays of the
            markers do not go together; the message names it.
        OSError: If the file cannot be read.
    """
    arrays = _read(path)
    unknown = sorted(set(arrays) - set(_KEYS))
    if unknown:
        raise ValueError(f"body file {path}: unknown keys {unknown}; the keys are {_KEYS}")
    needed = ["mass", "S", *([] if "P" in arrays else ["G", "N"])]
    if any(key in arrays for key in (*_MARKERS, _MARKER_STIFFENING, _MARKER_AXES)):
        needed += _MARKERS
    missing = [key for key in needed if key not in arrays]
    if missing:
        hint = "; P may stand instead of G and N" if {"G", "N"} & set(missing) else ""
        raise ValueError(
            f"body file {path}: keys {missing} are missing, there are {sorted(arrays)}{hint}"
        )
    for key, array in arrays.items():
        kinds = "U" if key == "markers" else "fiu"
        if array.dtype.kind not in kinds:
            raise ValueError(
                f"body file {path}: {key} must hold {'text' if kinds == 'U' else 'real numbers'}, "
                f"but its type is {array.dtype}"
            )
    if arrays["mass"].shape != ():
        raise ValueError(
            f"body file {path}: mass must be one number, but it has shape {arrays['mass'].shape}"
        )
    names: list[str] = []
    if "markers" in arrays:
        names = [str(name) for name in arrays["markers"].ravel()]
        if len(set(names)) < len(names):
            raise ValueError(f"body file {path}: two of the markers {names} have the same name")
        for key in [*_MARKERS[1:], *({_MARKER_STIFFENING, _MARKER_AXES} & arrays.keys())]:
            if arrays[key].shape[:1] != (len(names),):
                raise ValueError(
                    f"body file {path}: {key} has shape {arrays[key].shape}, but there are "
                    f"{len(names)} markers {names}"
                )
    return arrays


def checked_ending(path: str | Path) -> Path:
    """The path of a file with the right ending.

    Args:
        path: The path given.

    Raises:
        TypeError: If it is no path.
        ValueError: If it has another ending.
    """
    path = validation.path("body file", path)
    if path.suffix != ".npz":
        raise ValueError(f"body file {path}: the name must end in .npz")
    return path


def _read(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of a file, whose contents have been checked against their checksums."""
    content = io.BytesIO(path.read_bytes())
    try:
        with np.load(content, allow_pickle=False) as arrays:
            return {key: arrays[key] for key in arrays.files}
    # What a damaged directory of the archive raises ranges from NotImplementedError to OSError.
    except Exception as error:
        raise ValueError(f"body file {path} is damaged or no .npz file: {error}") from error
