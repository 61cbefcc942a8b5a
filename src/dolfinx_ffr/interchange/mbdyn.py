# SPDX-License-Identifier: MIT
"""The ``.fem`` file of MBDyn's modal joint: records of numbers, each behind its group's title.

With the invariants 3, 4, 5, 8 and 9 of its groups 14 to 18 no nodes with masses are needed:

    3: int rho w_k     4: int rho X x w_k     5: int rho w_j x w_k
    8: -int rho [X] [w_j] = theta(P_j0)       9: int rho [w_j] [w_k] = -theta(P_kj)

Group 12 has mass, center and inertia about it. The nodes are the markers, in the order of the
comment, with labels from 1 on. In MBDyn's input they are ``damping from file`` and ``origin
position, null``. The geometric stiffness of group 19 is not written.

References:
    P. Masarati, MBDyn theory and developer's manual, Politecnico di Milano.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..files import replace_file
from .format import SEAL, Arrays, axial, elastic, markers, number, of_theta, sealed, theta, unsealed

_TITLES = {
    2: "FINITE ELEMENT NODE LIST",
    3: "INITIAL MODAL DISPLACEMENTS",
    4: "INITIAL MODAL VELOCITIES",
    5: "NODAL X COORDINATES",
    6: "NODAL Y COORDINATES",
    7: "NODAL Z COORDINATES",
    8: "MODE SHAPES",
    9: "MODAL MASS MATRIX",
    10: "MODAL STIFFNESS MATRIX",
    12: "RIGID BODY INERTIA MATRIX",
    13: "MODAL DAMPING MATRIX",
    14: "INVARIANT 3",
    15: "INVARIANT 4",
    16: "INVARIANT 8",
    17: "INVARIANT 5",
    18: "INVARIANT 9",
}


class MBDyn:
    """Files .fem."""

    name = "mbdyn"
    endings: tuple[str, ...] = (".fem",)
    holds: tuple[str, ...] = ("rotations of markers", "damping")
    readable = True

    def write(self, path: Path, arrays: Arrays) -> None:
        mass, S, P, K = elastic(arrays)
        r, (names, at) = len(S) - 1, markers(arrays)
        n, center, Q = len(names), S[0] / mass, P[1:, 1:]
        inertia = theta(P[0, 0] - mass * np.outer(center, center))
        shapes = np.concatenate([at["displacements"], at["rotations"]], axis=1)  # node, 6, mode
        groups: dict[int, Any] = {
            2: np.arange(1, n + 1)[None],
            **{k: np.zeros((1, r)) for k in (3, 4)},
            **{5 + k: at["positions"][:, [k]] for k in range(3)},
            8: shapes.transpose(2, 0, 1).reshape(r * n, 6),
            9: np.einsum("abkk->ab", Q),
            10: K,
            12: np.vstack([[mass, 0.0, 0.0], center, inertia]),
            13: arrays.get("damping", np.zeros((r, r))),
            14: S[1:].T,
            15: axial(P[1:, 0]).T,
            16: theta(P[1:, 0]).transpose(1, 0, 2).reshape(3, 3 * r),
            # axial(P_ab) is int rho w_b x w_a
            17: axial(Q.transpose(1, 0, 2, 3)).transpose(2, 0, 1).reshape(3, r * r),
            18: -theta(Q.transpose(1, 0, 2, 3)).transpose(2, 0, 1, 3).reshape(3, 3 * r * r),
        }
        lines = [f"** MBDyn MODAL DATA FILE {SEAL} markers={json.dumps(names)}"]
        lines += [
            "** RECORD GROUP 1, HEADER",
            "**   REVISION, NODE, NORMAL, ATTACHMENT, CONSTRAINT",
        ]
        lines += [f"REV0 {n} {r} 0 0 0", "**"]
        for group, table in groups.items():
            lines.append(f"** RECORD GROUP {group}, {_TITLES[group]}")
            whole = "{:d}" if group == 2 else "{:.16e}"
            rows = [[mass], *table[1:]] if group == 12 else table
            lines += [" ".join(whole.format(x) for x in row) for row in rows]
            lines.append("**")
        replace_file(path, sealed("\n".join([*lines, ""])))

    def read(self, path: Path) -> dict[str, Any]:
        text = unsealed(path)
        groups = _groups(text)
        if 1 not in groups or len(groups[1]) != 6:
            raise ValueError("RECORD GROUP 1 is missing, or has not six entries")
        n, r = (int(x) for x in groups[1][1:3])
        if min(n, r) < 0 or max(n, r) > len(text):
            raise ValueError(f"RECORD GROUP 1 has {n} nodes and {r} modes")
        sizes = {5: n, 6: n, 7: n, 8: 6 * r * n, 9: r * r, 10: r * r, 12: 13, 14: 3 * r, 15: 3 * r}
        sizes |= {16: 9 * r, 17: 3 * r * r, 18: 9 * r * r}
        table: dict[int, Array] = {}
        for group, size in sizes.items():
            found = groups.get(group, [])
            if len(found) != size:
                raise ValueError(
                    f"RECORD GROUP {group}, {_TITLES[group]}, has {len(found)} numbers and needs "
                    f"{size}; bodies without the invariants 3, 4, 5, 8 and 9 cannot be read"
                )
            table[group] = np.array([number(x, 0) for x in found])
        mass, center, inertia = np.split(table[12], [1, 4])
        P = np.zeros((r + 1, r + 1, 3, 3))
        P[0, 0] = of_theta(inertia.reshape(3, 3)) + mass * np.outer(center, center)
        P[1:, 0] = of_theta(table[16].reshape(3, r, 3).transpose(1, 0, 2))
        P[0, 1:] = P[1:, 0].transpose(0, 2, 1)
        P[1:, 1:] = of_theta(-table[18].reshape(3, r, r, 3).transpose(2, 1, 0, 3))
        twice = {
            9: np.einsum("abkk->ab", P[1:, 1:]).ravel(),
            15: axial(P[1:, 0]).T.ravel(),
            17: axial(P[1:, 1:].transpose(1, 0, 2, 3)).transpose(2, 0, 1).ravel(),
        }
        for group, known in twice.items():
            if np.any(np.abs(table[group] - known) > 1e-6 * np.max(np.abs(known), initial=0.0)):
                raise ValueError(f"RECORD GROUP {group}, {_TITLES[group]}, contradicts 16 and 18")
        told = re.search(r"markers=(\[.*\])\s*$", text.partition("\n")[0])
        names = json.loads(told[1]) if told else groups.get(2, [])
        shapes = table[8].reshape(r, n, 6).transpose(1, 2, 0)
        return {
            "mass": mass[0],
            "S": np.vstack([mass * center, table[14].reshape(3, r).T]),
            "P": P,
            "K": table[10].reshape(r, r),
            "markers": np.array([str(name) for name in names], dtype=np.str_),
            "marker_positions": np.column_stack([table[5], table[6], table[7]]),
            "marker_displacements": shapes[:, :3],
            "marker_rotations": shapes[:, 3:],
        }


def _groups(text: str) -> dict[int, list[str]]:
    """The entries of each record group; lines with asterisks are comments or titles."""
    found: dict[int, list[str]] = {}
    own: list[str] = []
    for line in text.splitlines():
        if title := re.match(r"\*\* RECORD GROUP (\d{1,3}),", line):
            if int(title[1]) in found:
                raise ValueError(f"RECORD GROUP {title[1]} stands twice")
            own = found.setdefault(int(title[1]), [])
        elif not line.startswith("**"):
            own += line.split()
    return found
