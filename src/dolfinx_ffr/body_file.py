# SPDX-License-Identifier: MIT
"""Volume integrals of a body in a NumPy file (.npz), to hand bodies from one code to another.

With r shape functions and n markers the file holds these arrays, in SI units and in the notation
of :class:`VolumeIntegrals`:

| key | shape | |
|---|---|---|
| ``mass`` | () | mass |
| ``S`` | (r + 1, 2) | int rho w_a |
| ``G``, ``N`` | (r + 1, r + 1) each | int rho w_a . w_b and int rho (J w_a) . w_b |
| ``P`` | (r + 1, r + 1, 2, 2) | int rho w_a w_b^T, instead of G and N |
| ``K`` | (r, r) | reduced stiffness; may be missing for a rigid body |
| ``stiffening_omega2`` | (r, r) | geometric stiffness by omega^2; these three may be missing |
| ``stiffening_alpha`` | (r, r) | geometric stiffness by the angular acceleration |
| ``stiffening_acceleration`` | (2, r, r) | by the acceleration of the frame along its axes |
| ``markers`` | (n,) | names; these four may be missing for a body without markers |
| ``marker_positions`` | (n, 2) | undeformed positions in the body's frame |
| ``marker_displacements`` | (n, 2, r) | shape functions of the displacement at the markers |
| ``marker_rotations`` | (n, r) | shape functions of the rotation at the markers |
| ``marker_stiffening`` | (n, 2, r, r) | geometric stiffness by unit forces there; may be missing |

A marker whose geometric stiffness is all zero has none.

``numpy.savez`` writes such a file from anywhere.
"""

from __future__ import annotations

import io
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .body import BodyMarker, VolumeIntegrals

__all__ = ["load_body", "save_body"]

_MARKERS = ["markers", "marker_positions", "marker_displacements", "marker_rotations"]
_MARKER_STIFFENING = "marker_stiffening"
_STIFFENING = {f"stiffening_{load}": load for load in ("omega2", "alpha", "acceleration")}
_KEYS = ["mass", "S", "G", "N", "P", "K", *_STIFFENING, *_MARKERS, _MARKER_STIFFENING]


def save_body(path: str | Path, integrals: VolumeIntegrals) -> None:
    """Write the integrals of a body to a file; an older one is replaced when all is written.

    Args:
        path: File that ends in ``.npz``.
        integrals: The integrals.

    Raises:
        ValueError: If the integrals are not valid, or the path has another ending.
        OSError: If the file cannot be written.
    """
    path = _checked_ending(path)
    integrals.validate(path.stem)
    points, n, r = integrals.markers.values(), len(integrals.markers), integrals.modes
    arrays: dict[str, Any] = {
        "mass": np.float64(integrals.mass),
        "S": integrals.S,
        "G": integrals.G,
        "N": integrals.N,
        "K": integrals.K,
        **{f"stiffening_{load}": array for load, array in integrals.stiffening.items()},
        "markers": np.array(list(integrals.markers), dtype=np.str_),
        "marker_positions": np.array([p.position for p in points]).reshape(n, 2),
        "marker_displacements": np.array([p.displacement for p in points]).reshape(n, 2, r),
        "marker_rotations": np.array([p.rotation for p in points]).reshape(n, r),
    }
    if any(point.stiffening is not None for point in points):
        none = np.zeros((2, r, r))
        arrays[_MARKER_STIFFENING] = np.array(
            [none if point.stiffening is None else point.stiffening for point in points]
        )
    descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=path.stem, suffix=".part")
    try:
        with os.fdopen(descriptor, "wb") as file:
            np.savez(file, **arrays)
        # Readable for those who may read other new files of this user.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(name, 0o666 & ~mask)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def load_body(path: str | Path) -> VolumeIntegrals:
    """Read the integrals of a body, written by :func:`save_body` or by another code.

    Args:
        path: File that ends in ``.npz``.

    Raises:
        ValueError: If the file is damaged, a key is missing or unknown, an array has the wrong
            shape or holds NaN, or the integrals are not those of a body; the message names it.
        OSError: If the file cannot be read.
    """
    path = _checked_ending(path)
    arrays = _read(path)
    unknown = sorted(set(arrays) - set(_KEYS))
    if unknown:
        raise ValueError(f"body file {path}: unknown keys {unknown}; the keys are {_KEYS}")
    needed = ["mass", "S", *([] if "P" in arrays else ["G", "N"])]
    if any(key in arrays for key in (*_MARKERS, _MARKER_STIFFENING)):
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
        for key in [*_MARKERS[1:], *({_MARKER_STIFFENING} & arrays.keys())]:
            if arrays[key].shape[:1] != (len(names),):
                raise ValueError(
                    f"body file {path}: {key} has shape {arrays[key].shape}, but there are "
                    f"{len(names)} markers {names}"
                )
    stiffening = arrays.get(_MARKER_STIFFENING, np.zeros((len(names), 1)))
    try:
        return VolumeIntegrals.from_arrays(
            float(arrays["mass"]),
            arrays["S"],
            **{key: arrays.get(key) for key in "PGNK"},
            markers={
                name: BodyMarker(
                    arrays["marker_positions"][number],
                    arrays["marker_displacements"][number],
                    arrays["marker_rotations"][number],
                    stiffening[number] if np.any(stiffening[number]) else None,
                )
                for number, name in enumerate(names)
            },
            stiffening={load: arrays[key] for key, load in _STIFFENING.items() if key in arrays},
            name=path.stem,
        )
    except ValueError as error:
        raise ValueError(f"body file {path}: {error}") from error


def _checked_ending(path: str | Path) -> Path:
    path = Path(path)
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
