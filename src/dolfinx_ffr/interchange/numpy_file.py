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
from pathlib import Path
from typing import Any

import numpy as np

from ..files import replace_file
from .format import FEATURES, Arrays

_LOADS = ("omega2", "alpha", "rotation", "acceleration")
#: Geometric stiffness: load by key
STIFFENING = {f"stiffening_{load}": load for load in _LOADS}
_OF_MARKERS = ("positions", "displacements", "rotations", "stiffening", "axes")
#: Arrays of the markers in the order of the fields of `BodyMarker`; the last two may be missing
MARKERS = [f"marker_{key}" for key in _OF_MARKERS]
_KEYS = ["mass", "S", "G", "N", "P", "K", *STIFFENING, "markers", *MARKERS]


class NumpyFile:
    """This package's own files, .npz."""

    name = "npz"
    endings: tuple[str, ...] = (".npz",)
    holds: tuple[str, ...] = tuple(feature for feature in FEATURES if feature != "damping")
    readable = True

    def write(self, path: Path, arrays: Arrays) -> None:
        write_all(path, {key: array for key, array in arrays.items() if key in _KEYS})

    def read(self, path: Path) -> dict[str, Any]:
        return _checked(path, read_all(path))


def write_all(path: Path, arrays: Arrays) -> None:
    """Write arrays by key to a file; an older file is replaced when all is written."""
    content = io.BytesIO()
    np.savez(content, **arrays)
    replace_file(path, content.getvalue())


def _checked(path: Path, arrays: dict[str, Any]) -> dict[str, Any]:
    """The arrays of a body file by key; an inconsistent file is refused."""
    unknown = sorted(set(arrays) - set(_KEYS))
    if unknown:
        raise ValueError(f"body file {path}: unknown keys {unknown}; the keys are {_KEYS}")
    needed = ["mass", "S", *([] if "P" in arrays else ["G", "N"])]
    if any(key in arrays for key in ("markers", *MARKERS)):
        needed += ["markers", *MARKERS[:3]]
    missing = [key for key in needed if key not in arrays]
    if missing:
        hint = "; P may stand instead of G and N" if {"G", "N"} & set(missing) else ""
        raise ValueError(
            f"body file {path}: keys {missing} are missing, there are {sorted(arrays)}{hint}"
        )
    for key, array in arrays.items():
        kinds, held = ("U", "text") if key == "markers" else ("fiu", "real numbers")
        if array.dtype.kind not in kinds:
            raise ValueError(
                f"body file {path}: {key} must hold {held}, but its type is {array.dtype}"
            )
    if arrays["mass"].shape != ():
        raise ValueError(
            f"body file {path}: mass must be one number, but it has shape {arrays['mass'].shape}"
        )
    if "markers" in arrays:
        names = [str(name) for name in arrays["markers"].ravel()]
        if len(set(names)) < len(names):
            raise ValueError(f"body file {path}: two of the markers {names} have the same name")
        for key in MARKERS:
            if key in arrays and arrays[key].shape[:1] != (len(names),):
                raise ValueError(
                    f"body file {path}: {key} has shape {arrays[key].shape}, but there are "
                    f"{len(names)} markers {names}"
                )
    return arrays


def read_all(path: Path) -> dict[str, Any]:
    """All arrays of a file, whose contents have been checked against their checksums."""
    content = io.BytesIO(path.read_bytes())
    try:
        with np.load(content, allow_pickle=False) as arrays:
            # how many there are stands at the end of the archive, which nothing else compares
            if int.from_bytes(content.getvalue()[-12:-10], "little") != len(arrays.files):
                raise ValueError("arrays are lost")
            return {key: arrays[key] for key in arrays.files}
    # a damaged directory of the archive raises anything from NotImplementedError to OSError
    except Exception as error:
        raise ValueError(f"body file {path} is damaged or no .npz file: {error}") from error
