# SPDX-License-Identifier: MIT
"""Standard input data of flexible bodies (SID), the text that Simpack, Neweul-M2 and others read.

The equations of motion in the body's frame, with v' its acceleration less gravity, w its angular
velocity and q the elastic coordinates, are

    [m     -[d]   Ct^T ] [v']   [ [w] [w] d + 2 [w] Ct^T q'   ]
    [[d]    J     Cr^T ] [w'] + [ Gr(q') w + [w] J w          ] = forces
    [Ct     Cr    Me   ] [q'']  [ Ge(q') w + Oe (w w) + Ke q + De q' ]

and each matrix is a Taylor series m0 + sum_k m1_k q_k, whose entry m1_k(i, j) stands in the file as
m1(i, k, j). With the arrays of a body (see `numpy_file`), K_l of translation and K_kl of rotation
its geometric stiffness:

    d = S_0 + sum q_k S_k                 J = theta(P_00 + sum q_k (P_0k + P_k0))
    Ct_j = S_j + sum q_k K_jk             Cr_j = axial(P_j0 + sum q_k (P_jk + K_jk))
    Gr_k = 2 theta(P_k0 + sum q_l P_kl)   Ge_k = 2 axial(P_jk)
    Oe_j = w . Z w - w^2 tr Z             with Z = P_j0 + sum q_k (P_jk + K_jk)

J stands as a column 11, 22, 33, 12, 13, 23, the columns of Oe are 11, 22, 33, 12, 23, 13, and Gr
and Ge have three columns for each k. The first order of Gr, which the standard allows and others
leave out, tells inertia and stiffening in Oe apart. Nodes are the markers: their names stand in
the first line, ``origin``, ``phi`` and ``psi`` have position and shape functions, ``AP`` the axes,
and the first order of ``phi`` the geometric stiffness by forces there.

References:
    O. Wallrapp, Standardization of flexible body modeling in multibody system codes, Part I:
    definition of standard input data, Mechanics of Structures and Machines 22 (1994),
    doi:10.1080/08905459408905214.
"""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg

from ..arrays import Array
from ..files import replace_file
from ..limits import available_memory
from ..tensors import axial, cross_matrix, of_theta, theta
from .format import (
    FEATURES,
    SEAL,
    Arrays,
    InterchangeWarning,
    elastic,
    markers,
    number,
    sealed,
    unsealed,
)

#: Terms of order zero, and of order one with the index of q before the index of the column
Taylor = tuple[Array, Array | None]
#: Pairs of axes of products of angular velocities 11, 22, 33, 12, 23, 13
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
_J = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
#: Shapes of the terms of a node but phi and psi, which have a column for each mode
_NODE = {"origin": (3, 1), "AP": (3, 3), "sigma": (6, 1)}
#: An entry of a term, without spaces
_ENTRY = re.compile(r"m([01])\(([\d,]+)\)")
_FIELDS = ("order", "nrow", "ncol", "nq", "nqn", "structure")
#: Largest difference of redundant terms, relative to their size, as files have few digits
_SAME = 1e-5
#: Largest difference that is round-off and no stiffening, as a share of the inertia
_ROUND_OFF = 1e-9
#: Smallest factor that scales terms which are too large for any mass
_SMALLEST_SCALE = 0.5


class StandardInputData:
    """Files .SID_FEM."""

    name = "sid"
    endings: tuple[str, ...] = (".SID_FEM", ".sid")
    holds: tuple[str, ...] = tuple(FEATURES)

    def write(self, path: Path, arrays: Arrays) -> None:
        terms, (names, marker_arrays), r = sid_terms(arrays), markers(arrays), len(arrays["S"]) - 1
        lines = [
            f"{len(names):5d}{r:5d}    :No. nodes, No. modes:{SEAL} markers={json.dumps(names)}",
            " part",
            "      new modal                                 =",
            "           refmod",
            f"                mass                            ={_fortran(float(arrays['mass']))}",
            f"                nelastq                         ={r:6d}",
        ]
        for k, frequency in enumerate(_frequencies(arrays), 1):
            mode = f"Eigen Mode {k:4d} :{frequency:13.6g} Hz"
            lines.append(f"                ielastq ({k:4d})                  = {mode}")
        lines += ["           end refmod", "           frame"]
        for k, node in enumerate(zip(*marker_arrays.values(), strict=True), 1):
            lines.append(f"                new node                        ={k:6d}")
            lines.append("                     rframe                     =    body ref")
            for key, term in _node_terms(*node).items():
                lines += _written(key, *term, indent=21)
            lines.append("                end node")
        lines.append("           end frame")
        for key, term in terms.items():
            lines += _written(key, *term, indent=11)
        lines += ["      end modal", " end part", ""]
        replace_file(path, sealed("\n".join(lines)))

    def read(self, path: Path) -> dict[str, Any]:
        text = unsealed(path)
        modal = _Modal.of(text)
        stated_names = re.search(r"markers=(\[.*?\])\s*$", text.partition("\n")[0])
        names = (
            [str(name) for name in json.loads(stated_names[1])]
            if stated_names
            else list(modal.nodes)
        )
        if len(names) != len(modal.nodes):
            raise ValueError(f"line 1: {len(names)} names of {len(modal.nodes)} nodes")
        return _body(replace(modal, nodes=dict(zip(names, modal.nodes.values(), strict=True))))


def read_terms(path: str | Path) -> dict[str, Taylor]:
    """The terms of the file at a ``path`` by name, of order zero and one in q.

    They need not make a body. The first order has the index of q before the index of the column,
    and may be None.
    """
    return _Modal.of(unsealed(Path(path))).terms


def sid_terms(arrays: Arrays) -> dict[str, Taylor]:
    """The terms of the standard input data of a body by name, from its ``arrays``."""
    _, S, P, K = elastic(arrays)
    r = len(S) - 1
    zeros = np.zeros((3, 3, r, r))
    turned = np.moveaxis(arrays.get("stiffening_rotation", zeros), (0, 1), (2, 3))
    moved = np.moveaxis(arrays.get("stiffening_acceleration", zeros[0]), 0, 2)
    mixed, squares = P[1:, 0], P[1:, 1:]
    inertia, by_q = theta(P[0, 0]), theta(P[0, 1:] + P[1:, 0])
    bent = squares + turned  # j, k
    gyro, by_gyro = 2.0 * theta(mixed), 2.0 * theta(squares)  # k, i, j and k, l, i, j
    mass_matrix = np.trace(P[1:, 1:], axis1=2, axis2=3)
    return {
        "mdCM": (S[0][:, None], S[1:].T[:, :, None]),
        "J": (
            np.array([[inertia[i, j]] for i, j in _J]),
            np.array([by_q[:, i, j] for i, j in _J])[:, :, None],
        ),
        "Ct": (S[1:], moved),
        "Cr": (axial(mixed), axial(bent)),
        "Me": (mass_matrix, None),
        "Gr": (
            gyro.transpose(1, 0, 2).reshape(3, 3 * r),
            by_gyro.transpose(2, 1, 0, 3).reshape(3, r, 3 * r),
        ),
        "Ge": (2.0 * axial(squares).reshape(r, 3 * r), None),
        "Oe": (_centrifugal(mixed), _centrifugal(bent)),
        "ksigma": (np.zeros((r, 1)), None),
        "Ke": (K, None),
        "De": (arrays.get("damping", np.zeros((r, r))), None),
    }


def _node_terms(x: Array, phi: Array, psi: Array, bent: Array, axes: Array) -> dict[str, Taylor]:
    """The terms of a node from position, shape functions, geometric stiffness and axes."""
    turns = np.array([cross_matrix(column) @ axes for column in psi.T]).reshape(-1, 3, 3)
    return {
        "origin": (x[:, None], phi[:, :, None]),
        "phi": (phi, -bent if np.any(bent) else None),
        "psi": (psi, None),
        "AP": (axes, turns.transpose(1, 0, 2)),
    }


def _frequencies(arrays: Arrays) -> Array:
    """Square roots of diagonal stiffness over mass [Hz], as the names of the coordinates."""
    _, _, P, K = elastic(arrays)
    mass = np.einsum("aakk->a", P)[1:]
    ratio = np.divide(np.diag(K), mass, out=np.zeros(len(mass)), where=mass > 0.0)
    return np.asarray(np.sqrt(np.maximum(ratio, 0.0)) / (2.0 * np.pi))


def _fortran(value: float) -> str:
    return f"{value: .16E}".replace("E", "D")


def _written(name: str, m0: Array, m1: Array | None, indent: int) -> Iterator[str]:
    """The lines of a term; zeros are left out."""
    outer, inner = " " * indent, " " * (indent + 5)
    rows, columns = m0.shape
    r = m1.shape[1] if m1 is not None else {"Me": rows, "Ke": rows, "De": rows}.get(name, columns)
    r = {"ksigma": rows, "Ge": rows}.get(name, r)
    order = int(m1 is not None)
    zero = not np.any(m0) and (m1 is None or not np.any(m1))
    numbers = (order, rows, columns, r, 0, 0 if zero else 3)
    yield outer + name
    for key, value in zip(_FIELDS, numbers, strict=True):
        yield f"{inner}{key:<22}={value:5d}"
    for i, j in np.argwhere(m0):
        yield f"{inner}{f'm0({i + 1:4d},{j + 1:4d})':<22}={_fortran(m0[i, j])}"
    if m1 is None:
        m1 = np.zeros((0, 0, 0))
    for i, k, j in np.argwhere(m1):
        yield f"{inner}{f'm1({i + 1:4d},{k + 1:4d},{j + 1:4d})':<22}={_fortran(m1[i, k, j])}"
    yield f"{outer}end {name}"


@dataclass
class _Block:
    """The lines between the opening and the end of a block."""

    name: str
    title: str = ""  #: What stands behind "new node ="
    line: int = 1
    #: Number of the line, and text behind "=", by the text before it without spaces
    values: dict[str, tuple[int, str]] = field(default_factory=dict)
    blocks: list[_Block] = field(default_factory=list)

    def inner(self, name: str) -> _Block:
        """The only block of a name."""
        blocks = [block for block in self.blocks if block.name == name]
        if len(blocks) != 1:
            raise ValueError(f"line {self.line}: {self.name} has {len(blocks)} blocks {name!r}")
        return blocks[0]

    def value(self, key: str) -> tuple[int, str]:
        """Number of the line, and text behind a key."""
        if key not in self.values:
            raise ValueError(f"line {self.line}: {self.name} has no {key!r}")
        return self.values[key]

    def integer(self, key: str) -> int:
        """The whole number behind a key."""
        line, text = self.value(key)
        if not re.fullmatch(r"\d{1,9}", text):
            raise ValueError(f"line {line}: {key} must be a whole number, not {text!r}")
        return int(text)


def _blocks(text: str) -> _Block:
    """The blocks of a file, whose first line is not one of them."""
    opened = [_Block("file")]
    for number_of_line, line in enumerate(text.splitlines()[1:], 2):
        before, equals, after = line.partition("=")
        words, value = before.split(), after.strip()
        if not words:
            continue
        if words[0] == "end":
            if len(opened) == 1 or words[1:] != [opened[-1].name]:
                raise ValueError(f"line {number_of_line}: {line.strip()[:60]!r} ends no block")
            opened.pop()
        elif equals and words[0] != "new":
            key, values = "".join(words), opened[-1].values
            if key in values:
                raise ValueError(f"line {number_of_line}: {key[:60]!r} stands twice")
            values[key] = number_of_line, value
        else:
            block = _Block(words[-1], value, number_of_line)
            opened[-1].blocks.append(block)
            opened.append(block)
    if len(opened) > 1:
        raise ValueError(f"the file ends within {opened[-1].name!r}: it was cut short")
    return opened[0]


@dataclass(frozen=True)
class _Modal:
    """The contents of a file."""

    r: int  #: Number of modes
    mass: float  #: [kg]
    terms: dict[str, Taylor]  #: Of the body, by name
    nodes: dict[str, dict[str, Taylor]]  #: Terms of each node, by its name

    @staticmethod
    def of(text: str) -> _Modal:
        """The contents of a file's text."""
        head = re.match(r"\s*(\d+)\s+(\d+)\b", text)
        if not head:
            raise ValueError("line 1: it must begin with the numbers of nodes and modes")
        n, r = int(head[1]), int(head[2])
        if max(n, r) > text.count("\n") + 1:
            raise ValueError(f"line 1: {n} nodes and {r} modes in so short a file")

        modal = _blocks(text).inner("part").inner("modal")
        refmod, frame = modal.inner("refmod"), modal.inner("frame")
        line, mass = refmod.value("mass")
        if refmod.integer("nelastq") != r:
            raise ValueError(f"line {refmod.line}: nelastq differs from {r} in the first line")
        in_node = {**_NODE, "phi": (3, r), "psi": (3, r)}
        nodes = {node.title: _terms(node.blocks, in_node, r) for node in frame.blocks}
        if not len(nodes) == len(frame.blocks) == n or "" in nodes:
            raise ValueError(
                f"line {frame.line}: {n} nodes with names of their own are expected, and there "
                f"are {list(nodes)}"
            )
        in_body = {"mdCM": (3, 1), "J": None, "Ct": (r, 3), "Cr": (r, 3), "Me": (r, r)}
        in_body |= {"Gr": (3, 3 * r), "Ge": (r, 3 * r), "Oe": (r, 6), "ksigma": (r, 1)}
        in_body |= {"Ke": (r, r), "De": (r, r)}
        of_body = [block for block in modal.blocks if block.name not in ("refmod", "frame")]
        terms = _terms(of_body, in_body, r)
        if missing := sorted({"mdCM", "J", "Ct", "Cr", "Me", "Gr", "Oe", "Ke"} - set(terms)):
            raise ValueError(f"the terms {missing} are missing")
        return _Modal(r, number(mass, line), terms, nodes)


def _terms(
    blocks: Sequence[_Block], shapes: Mapping[str, tuple[int, int] | None], r: int
) -> dict[str, Taylor]:
    """The terms in some blocks by name; without a shape one is (6, 1) or (3, 3)."""
    terms: dict[str, Taylor] = {}
    for block in blocks:
        if block.name not in shapes or block.name in terms:
            raise ValueError(
                f"line {block.line}: {block.name[:60]!r} is not one of {list(shapes)}, or stands "
                "twice"
            )
        terms[block.name] = _taylor(block, shapes[block.name], r)
    return terms


def _taylor(block: _Block, expected: tuple[int, int] | None, r: int) -> Taylor:
    """A term of a shape, of ``r`` modes."""
    order, nrow, ncol, nq, _, structure = (block.integer(key) for key in _FIELDS)
    shape = nrow, ncol
    fits = shape in ((6, 1), (3, 3)) if expected is None else shape == expected
    if not fits or order > 1 or structure > 4 or nq not in (0, r):
        raise ValueError(
            f"line {block.line}: {block.name} has order {order}, {nrow} x {ncol} entries, nq = "
            f"{nq} and structure {structure}; that does not fit {r} modes"
        )
    by_modes = nrow, r if order else 0, ncol
    if 8 * nrow * ncol * (1 + by_modes[1]) > available_memory():  # it is text of any size
        raise ValueError(f"line {block.line}: {block.name} of {r} modes is more than the memory")

    orders = np.zeros(shape), np.zeros(by_modes)
    if structure == 4:
        orders[0][:] = np.eye(*shape)
    for key, (line, text) in block.values.items():
        if key in _FIELDS:
            continue
        entry = _ENTRY.fullmatch(key)
        index = tuple(int(k) - 1 for k in entry[2].split(",")) if entry else ()
        array = orders[int(entry[1])] if entry else orders[0]
        inside = [0 <= k < size for k, size in zip(index, array.shape, strict=False)]
        if len(index) != array.ndim or not all(inside):
            raise ValueError(f"line {line}: {key[:60]!r} is no entry of {block.name}")
        array[index] = number(text, line)
    if structure == 2 and nrow == ncol:  # one triangle
        for array in (orders[0], *orders[1].transpose(1, 0, 2)):
            one_sided = not (np.any(np.tril(array, -1)) and np.any(np.triu(array, 1)))
            array += array.T - np.diag(np.diag(array)) if one_sided else 0.0
    return orders[0], orders[1] if order else None


def _body(modal: _Modal) -> dict[str, Any]:
    """The arrays of a body from what a file holds."""
    r, mass, terms, nodes = modal.r, modal.mass, modal.terms, modal.nodes

    def first_order(name: str) -> Array:
        m0, m1 = terms[name]
        return np.zeros((m0.shape[0], r, m0.shape[1])) if m1 is None else m1

    S = np.vstack([terms["mdCM"][0].T, terms["Ct"][0]])
    mixed = _mixed_moments(terms)
    P = np.zeros((r + 1, r + 1, 3, 3))
    P[1:, 0], P[0, 1:] = mixed, mixed.transpose(0, 2, 1)
    P[0, 0] = of_theta(_inertia(terms["J"], mixed))
    if np.any(first_order("mdCM")):
        _check_agreement("mdCM", first_order("mdCM")[:, :, 0], "Ct", S[1:].T)
    Me = terms["Me"][0]
    # the antisymmetric part of Cr in j and k is inertia, the symmetric part is stiffening
    by_cr = first_order("Cr")
    spun, symmetric = (0.5 * (by_cr + sign * by_cr.transpose(1, 0, 2)) for sign in (-1.0, 1.0))
    by_oe = first_order("Oe")
    if np.any(first_order("Gr")):
        T = first_order("Gr").reshape(3, r, r, 3).transpose(2, 1, 0, 3)
        P[1:, 1:] = of_theta(0.5 * T)
    else:
        scale, P[1:, 1:] = _second_moments(by_oe, spun, Me, mass, S, P)
        S[1:], P[1:, 0], P[0, 1:] = scale * S[1:], scale * P[1:, 0], scale * P[0, 1:]
    P[1:, 1:] = 0.5 * (P[1:, 1:] + P[1:, 1:].transpose(1, 0, 3, 2))
    _check_agreement("Me", Me, "Gr or Oe", np.trace(P[1:, 1:], axis1=2, axis2=3))
    if np.any(first_order("Gr")):
        _check_agreement("Cr", spun, "Gr", axial(P[1:, 1:]))
    size = np.sqrt(np.abs(np.outer(np.diag(Me), np.diag(Me))))
    turned = _of_parts(by_oe - _centrifugal(P[1:, 1:]), symmetric)
    stiff = {
        "stiffening_rotation": np.moveaxis(turned, (2, 3), (0, 1)),
        "stiffening_acceleration": np.moveaxis(first_order("Ct"), 2, 0),
    }
    for key, array in (("Oe", by_oe), ("Ct", first_order("Ct"))):
        difference = _difference(array, array.transpose(1, 0, 2))
        _warn_of_contradiction(f"{key} by q_j and by q_k, whose mean is taken", difference)
    arrays: dict[str, Any] = {
        **{key: 0.5 * (a + np.swapaxes(a, -1, -2)) for key, a in stiff.items()},
        "mass": np.float64(mass),
        "S": S,
        "P": P,
        "K": terms["Ke"][0],
        "markers": np.array(list(nodes), dtype=np.str_),
        **_markers(nodes, r),
    }
    for key in stiff:
        if not np.any(np.abs(arrays[key]) > _ROUND_OFF * size):
            del arrays[key]
    if np.any(terms["ksigma"][0] if "ksigma" in terms else 0.0):
        raise ValueError("ksigma is not zero: bodies with stress at rest are not modelled")
    if "De" in terms and np.any(terms["De"][0]):
        warnings.warn(
            "the file has damping, which belongs to the mechanism here and is left out: give "
            "Mechanism(damping=...) a RayleighDamping",
            InterchangeWarning,
            stacklevel=2,
        )
    return arrays


def _markers(nodes: dict[str, dict[str, Taylor]], r: int) -> dict[str, Array]:
    """The arrays of the markers from the terms of the nodes."""
    lists: dict[str, list[Array]] = {f"marker_{key}": [] for key in ("positions", "displacements")}
    lists |= {f"marker_{key}": [] for key in ("rotations", "stiffening", "axes")}
    for name, terms in nodes.items():
        if missing := sorted({"origin", "phi", "psi", "AP"} - set(terms)):
            raise ValueError(f"node {name}: the terms {missing} are missing")
        (x, moved), (phi, bent), (psi, _), (axes, _) = (
            terms[key] for key in ("origin", "phi", "psi", "AP")
        )
        if moved is not None and np.any(moved) and np.any(phi):
            _check_agreement(f"node {name}: origin", moved[:, :, 0], "phi", phi)
        lists["marker_positions"].append(x[:, 0])
        lists["marker_displacements"].append(phi)
        lists["marker_rotations"].append(psi)
        lists["marker_stiffening"].append(np.zeros((3, r, r)) if bent is None else -bent)
        lists["marker_axes"].append(axes)
    n = len(nodes)
    shapes = ((n, 3), (n, 3, r), (n, 3, r), (n, 3, r, r), (n, 3, 3))
    arrays = {
        key: np.array(values).reshape(shape)
        for (key, values), shape in zip(lists.items(), shapes, strict=True)
    }
    if not np.any(arrays["marker_stiffening"]):
        del arrays["marker_stiffening"]
    if np.array_equal(arrays["marker_axes"], np.broadcast_to(np.eye(3), (n, 3, 3))):
        del arrays["marker_axes"]
    return arrays


def _mixed_moments(terms: dict[str, Taylor]) -> Array:
    """P_k0, (r, 3, 3), from Cr and Oe, which Gr must confirm in one of the orders in use."""
    vectors, coefficients = terms["Cr"][0], terms["Oe"][0]
    r = len(vectors)
    gyro = 0.5 * terms["Gr"][0].reshape(3, r, 3).transpose(1, 0, 2)
    # some write the columns 13 and 23 of Oe the other way round
    candidates = [
        _of_parts(coefficients[:, order], vectors) for order in ([*range(6)], [0, 1, 2, 3, 5, 4])
    ]
    differences = [_difference(theta(moments), gyro) for moments in candidates]
    _warn_of_contradiction("Gr, and Cr and Oe, which are taken", min(differences))
    if differences[1] < 1e-3 * differences[0]:
        coefficients[:] = coefficients[:, [0, 1, 2, 3, 5, 4]]
        if terms["Oe"][1] is not None:
            terms["Oe"][1][:] = terms["Oe"][1][:, :, [0, 1, 2, 3, 5, 4]]
        return candidates[1]
    return candidates[0]


def _inertia(J: Taylor, mixed: Array) -> Array:
    """The inertia (3, 3) from a column or matrix ``J``; its first order must fit ``mixed``."""
    m0, m1 = J
    expected = theta(mixed + mixed.transpose(0, 2, 1)).transpose(1, 0, 2)
    best: tuple[float, Array] = (np.inf, m0)
    for pairs in (_J, (*_J[:4], _J[5], _J[4])):
        tensor, by_q = m0, m1
        if m0.shape == (6, 1):
            tensor, by_q = np.zeros((3, 3)), None if m1 is None else np.zeros((3, len(mixed), 3))
            for row, (i, j) in enumerate(pairs):
                tensor[i, j] = tensor[j, i] = m0[row, 0]
                if by_q is not None and m1 is not None:
                    by_q[i, :, j] = by_q[j, :, i] = m1[row, :, 0]
        difference = 0.0 if by_q is None or not np.any(by_q) else _difference(by_q, expected)
        if difference < best[0]:
            best = difference, tensor
    if best[0] > _SAME:
        raise ValueError(f"the terms J, Cr and Oe contradict each other by {best[0]:.1e}")
    _check_agreement("J", best[1], "its transpose", best[1].T)
    return best[1]


def _second_moments(
    by_oe: Array, spun: Array, Me: Array, mass: float, S: Array, P: Array
) -> tuple[float, Array]:
    """P_jk, (r, r, 3, 3), if Gr does not have it, and the factor for S_j and P_j0.

    It follows from Oe and Cr if Oe has no stiffening. Else it is estimated: the least moments that
    S_j and P_j0 allow, the rest of Me in equal shares along all axes, and the turning part of Cr as
    far as no mass becomes negative. Bodies with other moments differ by terms of second order in q,
    which the standard leaves out, and by the first order of Cr and Ge.
    """

    def smallest(moments: Array) -> float:
        flat = moments.transpose(0, 2, 1, 3).reshape(3 * len(Me), 3 * len(Me))
        return float(np.linalg.eigvalsh(0.5 * (flat + flat.T))[0])

    gram = np.block([[np.array([[mass]]), S[:1]], [S[:1].T, P[0, 0]]])
    along = np.concatenate([S[1:, :, None], P[1:, 0]], axis=2)  # j, component, 1 and X
    least = np.einsum("jma,ab,knb->jkmn", along, np.linalg.pinv(gram, hermitian=True), along)
    moments_by_oe = _of_parts(by_oe, spun)
    moments_by_oe = 0.5 * (moments_by_oe + moments_by_oe.transpose(1, 0, 3, 2))
    size = float(np.max(np.diag(Me), initial=0.0))
    exact = _difference(np.trace(moments_by_oe, axis1=2, axis2=3), Me) <= _SAME
    if not len(Me) or (exact and smallest(moments_by_oe - least) >= -_SAME * size):
        return 1.0, moments_by_oe
    needed = np.trace(least, axis1=2, axis2=3)
    largest_ratio = np.max(scipy.linalg.eigh(needed, Me, eigvals_only=True))
    square = float(min(1.0, 0.999 / largest_ratio))
    if square < _SMALLEST_SCALE**2:
        raise ValueError(
            f"no distribution of mass has these Ct, Cr and Oe, which are {square ** (-0.5):.1f} "
            "times as large as Me and J allow; read_terms returns the terms"
        )
    remainder = (Me - square * needed)[:, :, None, None] * np.eye(3) / 3.0
    turns = _of_parts(np.zeros((*Me.shape, 6)), spun - square * axial(least))
    # the share of turns with which no mass is negative
    shares = (
        share for share in np.linspace(1.0, 0.0, 101) if smallest(remainder + share * turns) >= 0
    )
    share = float(next(shares, 0.0))
    warnings.warn(
        "Oe and Cr contain more than the inertia in Me, either geometric stiffening or a "
        "contradiction, which a file without the first order of Gr leaves open: the inertia of "
        "pairs of coordinates is estimated, and the rest of Oe is taken as stiffening"
        + (f"; Ct, Cr and Oe are too large for Me, and scaled by {square**0.5:.3f}" * (square < 1))
        + (f"; only {share:.0%} of the turning part of Cr is used" * (share < 1)),
        InterchangeWarning,
        stacklevel=2,
    )
    return square**0.5, np.asarray(square * least + remainder + share * turns)


def _difference(one: Array, other: Array) -> float:
    """Largest difference relative to the largest entry."""
    size = max(np.max(np.abs(one), initial=0.0), np.max(np.abs(other), initial=0.0))
    return float(np.max(np.abs(one - other), initial=0.0) / size) if size > 0.0 else 0.0


def _warn_of_contradiction(terms: str, difference: float) -> None:
    """Warn of redundant terms that differ, as when a program approximates some."""
    if difference > _SAME:
        warnings.warn(
            f"the file contradicts itself: {terms}, differ by {difference:.1e} of the largest "
            "entry",
            InterchangeWarning,
            stacklevel=3,
        )


def _check_agreement(name: str, values: Array, other_name: str, other_values: Array) -> None:
    """Raise a ValueError if redundant terms differ."""
    difference = _difference(values, other_values)
    if difference > _SAME:
        raise ValueError(
            f"{name} and {other_name} must agree, but entries differ by {difference:.1e}"
        )


def _centrifugal(Z: Array) -> Array:
    """Coefficients of w . Z w - w^2 tr Z by products of angular velocities (`_PAIRS`), (..., 6)."""
    turned = -theta(Z)
    products = [turned[..., i, j] + (turned[..., j, i] if i != j else 0.0) for i, j in _PAIRS]
    return np.stack(products, axis=-1)


def _of_parts(coefficients: Array, vectors: Array) -> Array:
    """The matrices (..., 3, 3) with these `_centrifugal` (..., 6) and `axial` (..., 3) parts."""
    Z = np.empty((*coefficients.shape[:-1], 3, 3))
    # the coefficients are Z_ii - tr Z for 11, 22 and 33, and Z_ij + Z_ji for the others
    trace = -0.5 * coefficients[..., :3].sum(axis=-1)
    for coefficient, (i, j) in zip(np.moveaxis(coefficients, -1, 0), _PAIRS, strict=True):
        if i == j:
            Z[..., i, i] = coefficient + trace
            continue
        # axial's component beside i and j is Z_ji - Z_ij for 12 and 23, and the negative for 13
        difference = vectors[..., 3 - i - j] * (1.0 if j == i + 1 else -1.0)
        Z[..., i, j] = 0.5 * (coefficient - difference)
        Z[..., j, i] = 0.5 * (coefficient + difference)
    return Z
