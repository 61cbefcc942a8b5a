# SPDX-License-Identifier: MIT
"""The .npz file that ``ObjectFFRFreducedOrderInterface.LoadFromFile`` of Exudyn reads.

Exudyn keeps the constants of the equations of motion as products of nodal matrices. With the skew
matrix [x] of a vector they are, for columns phi_a of the modes and the reference position X,

    int rho [phi_a]^T phi_b = -int rho phi_a x phi_b,     int rho [phi_a]^T [phi_b] = theta(P_ba),

and likewise with X in the place of a mode: no mesh is needed. Its markers take nodes, so each of
ours becomes four, that have no mass: one at the marker and one on each axis of the body, a lever
away, that turns with it. ``MarkerSuperElementPosition`` takes the first one, and
``MarkerSuperElementRigid`` all four, which follow each other: marker k has the nodes 4 k to
4 k + 3, in the order of the array ``markers`` of the file.

References:
    A. Zwoelfer, J. Gerstmayr, The nodal-based floating frame of reference formulation with modal
    reduction, Acta Mechanica 232 (2021), doi:10.1007/s00707-020-02886-2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..archive import Head
from ..tensors import axial, cross_matrix, of_theta, theta
from .format import Arrays, elastic, markers
from .numpy_file import open_archive, read_arrays, write_all

#: Arrays of a file of Exudyn from which a body is made
_NEEDED = (
    *("modeBasis", "massMatrixReduced", "stiffnessMatrixReduced", "xRef", "inertiaLocal"),
    *("totalMass", "chiU", "mPsiTildePsiTilde", "mPhitTPsi", "mXRefTildePsiTilde"),
)
_NODES = 4


class Exudyn:
    """Files of reduced bodies for Exudyn, which end in .npz as this package's own files."""

    name = "exudyn"
    endings: tuple[str, ...] = ()
    holds: tuple[str, ...] = ("rotations of markers",)

    def write(self, path: Path, arrays: Arrays) -> None:
        mass, S, P, K = elastic(arrays)
        r, (names, marker_arrays) = len(S) - 1, markers(arrays)
        # a power of two near the radius of gyration, so that the lever costs no digits
        lever = 2.0 ** np.round(0.5 * np.log2(np.trace(P[0, 0]) / mass))
        arms = lever * np.vstack([np.zeros(3), np.eye(3)])
        rotations = marker_arrays["rotations"]
        turns = np.array([[np.cross(psi.T, arm).T for arm in arms] for psi in rotations])
        shapes = marker_arrays["displacements"][:, None] + turns.reshape(len(names), _NODES, 3, r)
        nodes = marker_arrays["positions"][:, None] + arms
        skew = np.array([cross_matrix(s) for s in S]).reshape(-1, 3, 3)
        write_all(
            path,
            {
                "modeBasis": shapes.reshape(3 * _NODES * len(names), r),
                "trigList": np.zeros((0, 3), dtype=int),
                "postProcessingModes": np.array(""),  # no modes of stress
                "massMatrixReduced": np.einsum("abkk->ab", P[1:, 1:]),
                "stiffnessMatrixReduced": K,
                "infoList": np.array([r, _NODES * len(names), 3, 4, 7, 7 + r]),
                "rigidBodyNodeType": np.array("NodeType.RotationEulerParameters"),
                "xRef": nodes.ravel(),
                "inertiaLocal": theta(P[0, 0]),
                "Mtt": mass * np.eye(3),
                "totalMass": np.float64(mass),
                "chiU": S[0] / mass,
                "chiUtilde": skew[0] / mass,
                # axial(P_ab) is int rho w_b x w_a
                "mPsiTildePsi": axial(P[1:, 1:]).transpose(0, 2, 1).reshape(3 * r, r),
                "mPsiTildePsiTilde": theta(P[1:, 1:].transpose(1, 0, 2, 3))
                .transpose(0, 2, 1, 3)
                .reshape(3 * r, 3 * r),
                "mPhitTPsi": S[1:].T.copy(),
                "mPhitTPsiTilde": skew[1:].transpose(1, 0, 2).reshape(3, 3 * r),
                "mXRefTildePsi": axial(P[0, 1:]).T.copy(),
                "mXRefTildePsiTilde": theta(P[1:, 0]).transpose(1, 0, 2).reshape(3, 3 * r),
                "fileVersion": np.array(1),
                "markers": np.array(names, dtype=np.str_),
                "markerLever": np.float64(lever),
            },
        )

    def read(self, path: Path) -> dict[str, Any]:
        archive = open_archive(path)
        _check_heads(archive.heads)
        file = read_arrays(path, archive)
        basis, mass = file["modeBasis"], file["totalMass"]
        r = basis.shape[1]
        S = np.vstack([mass * file["chiU"].reshape(1, 3), file["mPhitTPsi"].reshape(3, r).T])
        P = np.zeros((r + 1, r + 1, 3, 3))
        P[0, 0] = of_theta(file["inertiaLocal"])
        P[1:, 0] = of_theta(file["mXRefTildePsiTilde"].reshape(3, r, 3).transpose(1, 0, 2))
        P[0, 1:] = P[1:, 0].transpose(0, 2, 1)
        squares = file["mPsiTildePsiTilde"].reshape(r, 3, r, 3).transpose(2, 0, 1, 3)
        P[1:, 1:] = of_theta(squares)
        mass_matrix = file["massMatrixReduced"]
        difference = np.abs(np.einsum("abkk->ab", P[1:, 1:]) - mass_matrix)
        if np.any(difference > 1e-9 * np.max(np.abs(mass_matrix), initial=0.0)):
            raise ValueError("mPsiTildePsiTilde and massMatrixReduced contradict each other")
        arrays = {"mass": mass, "S": S, "P": P, "K": file["stiffnessMatrixReduced"]}
        if "markers" in file and "markerLever" in file:
            nodes = file["xRef"].reshape(len(file["markers"]), _NODES, 3)
            shapes = basis.reshape(len(nodes), _NODES, 3, r)
            turned = (shapes[:, 1:] - shapes[:, :1]) / file["markerLever"]  # psi x e_k
            arrays |= {
                "markers": file["markers"],
                "marker_positions": nodes[:, 0],
                "marker_displacements": shapes[:, 0],
                "marker_rotations": np.stack(
                    [turned[:, 1, 2], turned[:, 2, 0], turned[:, 0, 1]], axis=1
                ),
            }
        return arrays


def _check_heads(heads: Mapping[str, Head]) -> None:
    """Raise a ValueError for arrays whose names or sizes do not fit one body."""
    if missing := [key for key in _NEEDED if key not in heads]:
        raise ValueError(f"the arrays {missing} are missing: it is no file of Exudyn")
    rows, *columns = heads["modeBasis"].shape
    r = math.prod(columns)
    sizes = {
        "modeBasis": rows * r,
        "xRef": rows,
        "markers": rows // (3 * _NODES),
        **dict.fromkeys(("massMatrixReduced", "stiffnessMatrixReduced"), r * r),
        "mPsiTildePsiTilde": 9 * r * r,
        "mXRefTildePsiTilde": 9 * r,
        "mPhitTPsi": 3 * r,
        "inertiaLocal": 9,
        "chiU": 3,
        **dict.fromkeys(("totalMass", "markerLever"), 1),
    }
    for key, size in sizes.items():
        if key in heads and math.prod(heads[key].shape) != size:
            raise ValueError(
                f"{key} must have {size} entries beside {r} modes of {rows} displacements, but its "
                f"shape is {heads[key].shape}"
            )
