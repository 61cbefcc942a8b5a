# SPDX-License-Identifier: MIT
"""Arrays of a planar mechanism and work arrays, as the compiled functions take them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...mechanism import ElementKind, RowKind
from ..compilation import Array3, Array4, IntMatrix, IntVector, Matrix, Vector

#: Place of the rotation among the coordinates of a body, and number of its rigid coordinates:
#: position of the frame (2), rotation (1); the elastic ones follow.
ROTATION, RIGID = 2, 3

#: Kinds of rows and of forces, as numbers for the kernels.
X, Y, ANGLE, LINE, DISTANCE = (int(kind) for kind in RowKind)
GLOBAL, FOLLOWER, SPRING, PLANE_SPRING, TORSION = (int(kind) for kind in ElementKind)

#: Rows of Work.bars, derivatives with respect to the place z of a marker, its shift z_y adj, its
#: velocity and its acceleration; and of Work.pulls, in the global axes: derivatives with respect to
#: its arm and to the shape functions' products with elastic velocities, shift and accelerations.
PLACE, SHIFT, VELOCITY, ACCELERATION = 0, 1, 2, 3

#: Rows of Work.products: (1, q), (0, v), (0, w), then G times each, then N times each.
ONE, RATE, SECOND, G_ONE, G_RATE, G_SECOND, N_ONE, N_RATE, N_SECOND = range(9)


class ModelArrays(NamedTuple):
    """A mechanism as flat arrays, padded to the largest number of modes."""

    first: IntVector  # (bodies,) index of the first coordinate of each body
    modes: IntVector  # (bodies,) number of elastic coordinates
    mass: Vector  # (bodies,) [kg]
    S: Array3  # (bodies, modes + 1, 2)
    G: Array3  # (bodies, modes + 1, modes + 1)
    N: Array3  # (bodies, modes + 1, modes + 1)
    K: Array3  # (bodies, modes, modes)
    alpha: Vector  # (bodies,) mass-proportional damping [1/s]
    beta: Vector  # (bodies,) stiffness-proportional damping [s]
    stiffened: IntVector  # (bodies,) whether a body has geometric stiffness
    #: (bodies or none, 4, modes, modes) by omega^2, alpha, acceleration x and y
    stiffening: Array4
    #: (bodies, modes + 3, modes + 3) D of the position corrections, see integration/steps.py
    inverse: Array3
    gravity: Matrix  # (instants, 2) less the acceleration of the ground [m/s^2]
    marker_body: IntVector  # (markers,) body, or -1 for a marker that moves as prescribed
    marker_slot: IntVector  # (markers,) place in `prescribed` for the latter
    shapes: Array3  # (markers, 2, modes + 1) reference position and shape functions
    psi: Matrix  # (markers, modes) rotation shape functions
    #: (markers,) place in the next, or -1 for a marker without geometric stiffness
    marker_stiffened: IntVector
    marker_stiffening: Array4  # (stiffened markers, 2, modes, modes)
    prescribed: Array4  # (instants, prescribed markers, 3 derivatives, 3) of (x, y, angle)
    kind: IntVector  # (rows,)
    side: IntMatrix  # (rows, 2) the two markers
    normal: Matrix  # (rows, 2) normal of the line in the frame of the second marker
    ratio: Vector  # (rows,)
    drive: Array3  # (instants, rows, 3) c(t) and its two derivatives
    force_kind: IntVector  # (forces,)
    force_side: IntMatrix  # (forces, 2) the two markers
    force_constants: Matrix  # (forces, 2) stiffness and damping
    force_table: Array3  # (instants, forces, 3) force and moment, or length or angle without force


class Work(NamedTuple):
    """Work arrays of the kernels."""

    rotation: Matrix  # (bodies, 2) cosine and sine
    P: Array3  # (markers, 2, modes) derivative with respect to q, in the global axes
    bend: Array3  # (markers, 2, modes) A T v of markers with geometric stiffness
    arm: Matrix  # (markers, 2) marker minus origin of the body's frame
    swing: Matrix  # (markers, 2) elastic part of the velocity
    z: Matrix  # (markers, 3)
    zd: Matrix  # (markers, 3)
    zdd: Matrix  # (markers, 3)
    g: Matrix  # (rows, 6) gradients
    hz: Matrix  # (rows, 6) Hessian times marker velocities
    u: Vector  # (6,) shifts or velocities of two markers
    du: Vector  # (6,) shifts or their change
    hessian: Vector  # (6,) products with derivatives of a row
    third: Vector  # (6,)
    loads: Matrix  # (forces, 3) forces and moments on the first markers
    load: Vector  # (6,) force on two markers
    load_z: Matrix  # (6, 6) its derivative with respect to their coordinates
    load_v: Matrix  # (6, 6) and velocities
    unit: Vector  # (n,)
    column: Vector  # (n,)
    products: Matrix  # (9, modes + 1) vectors of one body, see above
    bars: Matrix  # (4, 6) derivatives with respect to two markers, see above
    pulls: Matrix  # (4, 2) see above
    #: (markers, 3 + 2 modes, modes + 1) derivatives with respect to the shape functions of the
    #: markers: x, y in the body's axes, and those of the rotation, whose first entry stays zero;
    #: then those of the geometric stiffness T_x and T_y, whose first column stays zero
    marker_bars: Array3


def work_arrays(model: ModelArrays) -> Work:
    """Work arrays of zeros for a mechanism.

    Args:
        model: Flat arrays of the mechanism.
    """
    bodies, markers, rows = model.first.size, model.marker_body.size, model.kind.size
    modes, n = model.psi.shape[1], size(model)
    return Work(
        rotation=np.zeros((bodies, 2)),
        P=np.zeros((markers, 2, modes)),
        bend=np.zeros((markers, 2, modes)),
        arm=np.zeros((markers, 2)),
        swing=np.zeros((markers, 2)),
        z=np.zeros((markers, 3)),
        zd=np.zeros((markers, 3)),
        zdd=np.zeros((markers, 3)),
        g=np.zeros((rows, 6)),
        hz=np.zeros((rows, 6)),
        u=np.zeros(6),
        du=np.zeros(6),
        hessian=np.zeros(6),
        third=np.zeros(6),
        loads=np.zeros((model.force_kind.size, 3)),
        load=np.zeros(6),
        load_z=np.zeros((6, 6)),
        load_v=np.zeros((6, 6)),
        unit=np.zeros(n),
        column=np.zeros(n),
        products=np.zeros((9, modes + 1)),
        bars=np.zeros((4, 6)),
        pulls=np.zeros((4, 2)),
        marker_bars=np.zeros((markers, 3 + 2 * modes, modes + 1)),
    )


def size(model: ModelArrays) -> int:
    """Number of coordinates.

    Args:
        model: Flat arrays of the mechanism.
    """
    return int(np.sum(RIGID + model.modes))
