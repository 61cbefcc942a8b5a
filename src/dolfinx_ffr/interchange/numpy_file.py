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
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..archive import Archive, Head
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

    def write(self, path: Path, arrays: Arrays) -> None:
        write_all(path, {key: array for key, array in arrays.items() if key in _KEYS})

    def read(self, path: Path) -> dict[str, Any]:
        archive = open_archive(path)
        _check_heads(archive.heads)
        arrays = read_arrays(path, archive)
        names = [str(name) for name in arrays.get("markers", np.zeros(0, dtype=np.str_))]
        if len(set(names)) < len(names):
            raise ValueError(f"two of the markers {names} have the same name")
        return arrays


def write_all(path: Path, arrays: Arrays) -> None:
    """Write arrays by key to a file, which replaces an older one at the end."""
    content = io.BytesIO()
    np.savez(content, **arrays)
    replace_file(path, content.getvalue())


def _check_heads(heads: Mapping[str, Head]) -> None:
    """Raise a ValueError for arrays whose keys, types or shapes do not fit one body."""
    unknown = sorted(set(heads) - set(_KEYS))
    if unknown:
        raise ValueError(f"unknown keys {unknown}; the keys are {_KEYS}")
    needed = ["mass", "S", *([] if "P" in heads else ["G", "N"])]
    if any(key in heads for key in ("markers", *MARKERS)):
        needed += ["markers", *MARKERS[:3]]
    missing = [key for key in needed if key not in heads]
    if missing:
        hint = "; P may stand instead of G and N" if {"G", "N"} & set(missing) else ""
        raise ValueError(f"keys {missing} are missing; the file has {sorted(heads)}{hint}")
    for key, head in heads.items():
        kinds, content = ("U", "text") if key == "markers" else ("fiu", "real numbers")
        if head.dtype.kind not in kinds:
            raise ValueError(f"{key} must hold {content}, but its type is {head.dtype}")
    if heads["mass"].shape != ():
        raise ValueError(f"mass must be one number, but it has shape {heads['mass'].shape}")
    # second moments stand once for the rigid body and once for each shape function
    r = max(_length(heads, "P" if "P" in heads else "G") - 1, 0)
    d, n = 3 if heads["S"].shape[1:] == (3,) else 2, _length(heads, "markers")
    shapes = _shapes(r, d, n)
    for key, head in heads.items():
        if head.shape != shapes[key]:
            raise ValueError(
                f"{key} must have shape {shapes[key]} in a body with {r} shape functions and {n} "
                f"markers, but it has shape {head.shape}"
            )


def _length(heads: Mapping[str, Head], key: str) -> int:
    """The number of rows of an array, zero where there is none."""
    shape = heads[key].shape if key in heads else ()
    return shape[0] if shape else 0


def _shapes(r: int, d: int, n: int) -> dict[str, tuple[int, ...]]:
    """Shapes of arrays by key, for r shape functions in d dimensions and n markers."""
    return {
        "mass": (),
        "S": (r + 1, d),
        **dict.fromkeys("GN", (r + 1, r + 1)),
        "P": (r + 1, r + 1, d, d),
        "K": (r, r),
        "stiffening_omega2": (r, r),
        "stiffening_alpha": (r, r),
        "stiffening_rotation": (3, 3, r, r),
        "stiffening_acceleration": (d, r, r),
        "markers": (n,),
        "marker_positions": (n, d),
        "marker_displacements": (n, d, r),
        "marker_rotations": (n, r) if d == 2 else (n, 3, r),
        "marker_stiffening": (n, d, r, r),
        "marker_axes": (n, 3, 3),
    }


def open_archive(path: Path) -> Archive:
    """A file of arrays; only the heads are read."""
    content = path.read_bytes()
    with _named(path):
        return Archive.of(content)


def read_arrays(path: Path, archive: Archive) -> dict[str, Any]:
    """All arrays of the archive of a file."""
    with _named(path):
        return archive.read()


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Context in which errors about an archive name its file."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"body file {path} is damaged or no .npz file: {error}") from error
