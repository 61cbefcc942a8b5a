# SPDX-License-Identifier: MIT
"""Flat arrays of a mechanism and work arrays, as the compiled kernels take them."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit, types
from numba.extending import overload
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Kinds of rows. The first three are one coordinate of the first marker minus `ratio` times that of
#: the second, numbered as the coordinate; LINE is the distance of the first marker from a line
#: fixed to the second, DISTANCE that of the two markers.
X, Y, ANGLE, LINE, DISTANCE = 0, 1, 2, 3, 4

#: Kinds of forces: force and moment in the global axes, force in the axes of the marker, spring and
#: damper along the line between two markers, in the plane, and between two angles.
GLOBAL, FOLLOWER, SPRING, PLANE_SPRING, TORSION = 0, 1, 2, 3, 4


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function as a part of the compiled functions that call it.

    It is inlined: a call would hand over some hundred numbers, those of ModelArrays and Work.
    """
    return njit(
        error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True
    )(function)


def stiffened_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel that only markers with geometric stiffness need.

    For a model whose `bent` is None it becomes nothing when the functions that call it are
    compiled, so that such mechanisms run as if it were not there. Its first argument must be the
    model.
    """
    names = ", ".join(inspect.signature(function).parameters)
    nothing = eval(f"lambda {names}: None")

    @overload(function, strict=False, jit_options={"error_model": "numpy", "forceinline": True})
    def choose(model: Any, *_: Any) -> Callable[..., Any]:
        without = isinstance(model.types[model.fields.index("bent")], types.NoneType)
        return nothing if without else function

    return function


class ModelArrays(NamedTuple):
    """A mechanism as flat arrays, padded to the largest number of modes."""

    first: Integers  # (bodies,) index of the first coordinate of each body
    modes: Integers  # (bodies,) number of elastic coordinates
    mass: Array  # (bodies,) [kg]
    S: Array  # (bodies, modes + 1, 2)
    G: Array  # (bodies, modes + 1, modes + 1)
    N: Array  # (bodies, modes + 1, modes + 1)
    K: Array  # (bodies, modes, modes)
    alpha: Array  # (bodies,) mass-proportional damping [1/s]
    beta: Array  # (bodies,) stiffness-proportional damping [s]
    stiffened: Integers  # (bodies,) whether a body has geometric stiffness
    stiffening: Array  # (bodies or none, 4, modes, modes) by omega^2, alpha, acceleration x and y
    inverse: Array  # (bodies, modes + 3, modes + 3) D of the position corrections, see steps.py
    gravity: Array  # (instants, 2) less the acceleration of the ground [m/s^2]
    marker_body: Integers  # (markers,) body, or -1 for a marker that moves as prescribed
    marker_slot: Integers  # (markers,) place in `prescribed` for the latter
    W: Array  # (markers, 2, modes + 1) reference position and shape functions
    psi: Array  # (markers, modes) rotation shape functions
    #: (markers,) place in the table, or -1 for a marker without geometric stiffness, and the table
    #: (stiffened markers, 2, modes, modes); None where no marker has any
    bent: Any
    prescribed: Array  # (instants, prescribed markers, 3 derivatives, 3) of (x, y, angle)
    kind: Integers  # (rows,)
    side: Integers  # (rows, 2) the two markers
    normal: Array  # (rows, 2) normal of the line in the frame of the second marker
    ratio: Array  # (rows,)
    drive: Array  # (instants, rows, 3) c(t) and its two derivatives
    force_kind: Integers  # (forces,)
    force_side: Integers  # (forces, 2) the two markers
    force_constants: Array  # (forces, 2) stiffness and damping
    force_table: Array  # (instants, forces, 3) force and moment, or length or angle without force


class Work(NamedTuple):
    """Work arrays of the kernels."""

    rotation: Array  # (bodies, 2) cosine and sine
    P: Array  # (markers, 2, modes) derivative with respect to q, in the global axes
    bend: Any  # (markers, 2, modes) A T v of markers with geometric stiffness; None likewise
    arm: Array  # (markers, 2) marker minus origin of the body's frame
    swing: Array  # (markers, 2) elastic part of the velocity
    z: Array  # (markers, 3)
    zd: Array  # (markers, 3)
    g: Array  # (rows, 6) gradients
    hz: Array  # (rows, 6) Hessian times marker velocities
    u: Array  # (6,)
    out: Array  # (6,)
    value: Array  # (rows,) position constraints
    rate: Array  # (rows,) velocity constraints
    load: Array  # (6,) force on two markers
    load_z: Array  # (6, 6) its derivative with respect to their coordinates
    load_v: Array  # (6, 6) and velocities
    C: Array  # (rows, n) constraint Jacobian
    D: Array  # (rows, n) derivative of the velocity constraints with respect to the coordinates
    correction: Array  # (rows, n) D C_y^T at the beginning of the step, transposed
    r: Array  # (n,) inertia and elastic forces
    M: Array  # (n, n) derivative with respect to accelerations (and velocities)
    Ky: Array  # (n, n) derivative with respect to coordinates
    v6: Array  # (9, modes + 1) vectors of one body
    A: Array  # (n + 2 rows, n + 2 rows)
    rhs: Array  # (n + 2 rows,)
    scale: Array  # (n + 2 rows,)
    pivot: Integers  # (n + 2 rows,)


@stiffened_kernel
def make_bend(model: ModelArrays) -> Any:
    """Array for A T v of the markers."""
    return np.zeros((model.marker_body.size, 2, model.psi.shape[1]))


@kernel
def make_work(model: ModelArrays) -> Work:
    """Work arrays for a model."""
    bodies, markers, rows = model.first.size, model.marker_body.size, model.kind.size
    n = 0
    for b in range(bodies):
        n += 3 + model.modes[b]
    modes = model.psi.shape[1]
    size = n + 2 * rows
    return Work(
        np.zeros((bodies, 2)),
        np.zeros((markers, 2, modes)),
        make_bend(model),
        np.zeros((markers, 2)),
        np.zeros((markers, 2)),
        np.zeros((markers, 3)),
        np.zeros((markers, 3)),
        np.zeros((rows, 6)),
        np.zeros((rows, 6)),
        np.zeros(6),
        np.zeros(6),
        np.zeros(rows),
        np.zeros(rows),
        np.zeros(6),
        np.zeros((6, 6)),
        np.zeros((6, 6)),
        np.zeros((rows, n)),
        np.zeros((rows, n)),
        np.zeros((rows, n)),
        np.zeros(n),
        np.zeros((n, n)),
        np.zeros((n, n)),
        np.zeros((9, modes + 1)),
        np.zeros((size, size)),
        np.zeros(size),
        np.zeros(size),
        np.zeros(size, dtype=np.int64),
    )
