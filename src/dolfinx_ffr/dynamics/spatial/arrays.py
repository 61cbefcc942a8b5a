# SPDX-License-Identifier: MIT
"""Arrays of a mechanism in space and work arrays, as the compiled functions take them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...mechanism import SpatialRowKind, VectorKind
from ..compilation import Array3, Array4, IntMatrix, IntVector, Matrix, Vector

#: Place of the rotation among the coordinates of a body, and number of its rigid coordinates:
#: position of the frame (3), rotation vector (3); the elastic ones follow.
ROTATION, RIGID = 3, 6

#: Kinds of rows and of vectors, as numbers for the kernels.
POINT, DOT, PLANE, DISTANCE, ANGLE, GEAR = (int(kind) for kind in SpatialRowKind)
OF_POINT, OF_DIRECTION, OF_SPIN = (int(kind) for kind in VectorKind)

#: Most vectors of a row, and its components.
SIDES, COMPONENTS = 6, 18

#: Rows of Work.bars, derivatives with respect to a vector s, its shift L adj, its velocity and its
#: acceleration.
PLACE, SHIFT, VELOCITY, ACCELERATION = 0, 1, 2, 3


class ModelArrays(NamedTuple):
    """A mechanism in space as flat arrays, padded to the largest number of modes."""

    first: IntVector  # (bodies,) index of the first coordinate of each body
    modes: IntVector  # (bodies,) number of elastic coordinates
    mass: Vector  # (bodies,) [kg]
    S: Array3  # (bodies, modes + 1, 3)
    #: (bodies, modes + 1, 9 (modes + 1)) component kl of P_ba in [a, (3 k + l) (modes + 1) + b]
    P: Array3
    #: (bodies, 10, modes * modes) elastic part of P: the three components of its axial vector; 11,
    #: 22, 33, 12 + 21, 13 + 31, 23 + 32; its trace
    pairs: Array3
    K: Array3  # (bodies, modes, modes)
    alpha: Vector  # (bodies,) mass-proportional damping [1/s]
    beta: Vector  # (bodies,) stiffness-proportional damping [s]
    stiffened: IntVector  # (bodies,) whether a body has geometric stiffness
    #: (bodies or none, 12, modes, modes) by [alpha] + [omega]^2, nine, and by the acceleration
    stiffening: Array4
    #: (bodies, modes + 6, modes + 6) D of the position corrections, see integration/steps.py
    inverse: Array3
    gravity: Matrix  # (instants, 3) less the acceleration of the ground [m/s^2]
    vector_body: IntVector  # (vectors,) body, or -1 for one that moves as prescribed
    vector_slot: IntVector  # (vectors,) place in `prescribed` for the latter
    vector_kind: IntVector  # (vectors,)
    vector_marker: IntVector  # (vectors,) number of the marker of a body, -1 if there is none
    #: (vectors, 3, modes + 1) b(0) and b_q; of a spin the rotation shape functions behind zeros
    shapes: Array3
    vector_stiffened: IntVector  # (vectors,) place in the next, or -1
    vector_stiffening: Array4  # (stiffened vectors, 3, modes, modes)
    prescribed: Array4  # (instants, prescribed vectors, 3 derivatives, 3)
    #: (rows and springs,) the constraints first
    kind: IntVector
    side: IntMatrix  # (rows and springs, 6) vectors, -1 where there are fewer
    normal: Matrix  # (rows and springs, 3) of POINT
    ratio: Vector  # (rows and springs,)
    drive: Array3  # (instants, rows and springs, 3) c(t) and its two derivatives
    law: Matrix  # (springs, 2) stiffness and damping
    load_vector: IntVector  # (loads,) on which they act
    load_axes: IntMatrix  # (loads, 3) directions of the components, -1 for global ones
    load_table: Array3  # (instants, loads, 3)


class Work(NamedTuple):
    """Work arrays of the kernels."""

    A: Array3  # (bodies, 3, 3) rotation
    T: Array3  # (bodies, 3, 3) derivative of the rotation with respect to its coordinates
    c: Matrix  # (vectors, 3) b(q)
    cv: Matrix  # (vectors, 3) b_q v
    c1: Matrix  # (vectors, 3) velocity in the body's axes, that of the frame left out
    c2: Matrix  # (vectors, 3) acceleration likewise
    B: Array3  # (vectors, 3, modes) b_q
    bend: Array3  # (vectors, 3, modes) T v of those with geometric stiffness
    s: Matrix  # (vectors, 3)
    sd: Matrix  # (vectors, 3)
    sdd: Matrix  # (vectors, 3)
    forces: Matrix  # (vectors, 3) whose curvatures are to be added
    shift: Matrix  # (vectors, 3) L adj
    L: Array3  # (vectors, 3, modes + 6) derivative of s
    g: Matrix  # (rows and springs, 18) gradients
    hz: Vector  # (18,)
    u: Vector  # (18,)
    third: Vector  # (18,)
    dz: Vector  # (18,)
    line: Vector  # (n,) gradient of a spring, and what is left of it
    drift: Vector  # (n,)
    gather: Vector  # (n,) derivatives with respect to y that are to be put into coordinates
    stretch: Vector  # (springs,) value of the row of each spring
    tension: Vector  # (springs,) force of each spring
    angles: Matrix  # (rows and springs, 2) angles of rows
    #: (instants, rows and springs, 2) angles to which those of rows are close
    turns: Array3
    loads: Matrix  # (loads, 3) in the global axes
    PX: Matrix  # (3, 9 (modes + 1)) P_a(q), P_a(v), P_a(a), in the order of ModelArrays.P
    qh: Matrix  # (3, modes + 1) (1, q), (0, v), (0, w)
    small: Array3  # (16, 3, 3)
    vectors: Matrix  # (24, 3)
    Q: Matrix  # (9, 18) equations of the stages of a rotation, and right-hand sides
    RW: Matrix  # (modes + 6, modes + 6) derivative of the forces of a body with respect to w
    RV: Matrix  # (modes + 6, modes + 6) v
    RY: Matrix  # (modes + 6, modes + 6) y
    pairs: Matrix  # (2, modes * modes) their elastic parts, see bodies.py
    bars: Array3  # (vectors, 4, 3) derivatives with respect to vectors, see above
    #: (vectors, 3 + 3 modes, modes + 1) derivatives with respect to the shape functions of the
    #: vectors, then to their geometric stiffness
    vector_bars: Array3


#: Fields of Work of shape (vectors, 3)
_OF_VECTORS = ("c", "cv", "c1", "c2", "s", "sd", "sdd", "forces", "shift")


def work_arrays(model: ModelArrays) -> Work:
    """Work arrays of zeros for a mechanism.

    Args:
        model: Flat arrays of the mechanism.
    """
    bodies, vectors, rows = model.first.size, model.vector_body.size, model.kind.size
    modes, n = model.K.shape[1], size(model)

    def zeros(*shape: int) -> np.ndarray:
        return np.zeros(shape)

    return Work(
        A=zeros(bodies, 3, 3),
        T=zeros(bodies, 3, 3),
        **{name: zeros(vectors, 3) for name in _OF_VECTORS},
        B=zeros(vectors, 3, modes),
        bend=zeros(vectors, 3, modes),
        L=zeros(vectors, 3, RIGID + modes),
        g=zeros(rows, COMPONENTS),
        **{name: zeros(COMPONENTS) for name in ("hz", "u", "third", "dz")},
        **{name: zeros(n) for name in ("line", "drift", "gather")},
        stretch=zeros(model.law.shape[0]),
        tension=zeros(model.law.shape[0]),
        angles=zeros(rows, 2),
        turns=zeros(len(model.drive), rows, 2),
        loads=zeros(model.load_vector.size, 3),
        PX=zeros(3, 9 * (modes + 1)),
        qh=zeros(3, modes + 1),
        small=zeros(16, 3, 3),
        vectors=zeros(24, 3),
        Q=zeros(9, 18),
        **{name: zeros(RIGID + modes, RIGID + modes) for name in ("RW", "RV", "RY")},
        pairs=zeros(2, modes * modes),
        bars=zeros(vectors, 4, 3),
        vector_bars=zeros(vectors, 3 + 3 * modes, modes + 1),
    )


def size(model: ModelArrays) -> int:
    """Number of coordinates.

    Args:
        model: Flat arrays of the mechanism.
    """
    return int(np.sum(RIGID + model.modes))


def constraints(model: ModelArrays) -> int:
    """Number of scalar constraints.

    Args:
        model: Flat arrays of the mechanism.
    """
    return int(model.kind.size - len(model.law))
