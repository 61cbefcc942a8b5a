# SPDX-License-Identifier: MIT
"""Arrays of a mechanism and work arrays, as the compiled functions take them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...mechanism import RowKind, VectorKind
from ..compilation import Array3, Array4, IntMatrix, IntVector, Kernel, Matrix, Vector

#: Kinds of rows and of vectors, as numbers for the kernels.
POINT, DOT, PLANE, DISTANCE, ANGLE, GEAR, MESH = (int(kind) for kind in RowKind)
OF_POINT, OF_DIRECTION, OF_SPIN = (int(kind) for kind in VectorKind)

#: Rows of Work.bars, derivatives with respect to a vector s, its shift L adj, its velocity and its
#: acceleration.
PLACE, SHIFT, VELOCITY, ACCELERATION = 0, 1, 2, 3

#: Rows of Work.products of a body in the plane: (1, q), (0, v), (0, w), G times each, N times each.
ONE, RATE, SECOND, G_ONE, G_RATE, G_SECOND, N_ONE, N_RATE, N_SECOND = range(9)

#: Tables and constants with respect to which transposes add derivatives to fields of Work.
TABLES = ("drive", "prescribed", "load_table", "law", "normal", "ratio")


class _Fields(NamedTuple):
    """A mechanism as flat arrays, padded to the largest number of modes.

    In the plane P is not used, in space N.
    """

    first: IntVector  # (bodies,) index of the first coordinate of each body
    modes: IntVector  # (bodies,) number of elastic coordinates
    mass: Vector  # (bodies,) [kg]
    fields: IntVector  # (bodies,) number of shape functions, with those that others carry along
    S: Array3  # (bodies, fields + 1, d)
    G: Array3  # (bodies, fields + 1, fields + 1)
    N: Array3  # (bodies, fields + 1, fields + 1)
    #: (bodies, fields + 1, 9 (fields + 1)) kl of P_ba in [a, (3 k + l) (fields + 1) + b]
    P: Array3
    K: Array3  # (bodies, fields, fields), zero for the carried ones
    alpha: Vector  # (bodies,) mass-proportional damping [1/s]
    beta: Vector  # (bodies,) stiffness-proportional damping [s]
    stiffened: IntVector  # (bodies,) whether a body has geometric stiffness
    #: (bodies or none, carried, modes, modes): in the plane by omega^2, alpha and the acceleration;
    #: in space by the nine entries of [alpha] + [omega]^2 and the acceleration
    stiffening: Array4
    carried: Array4  # (bodies or none, carried, modes, modes) C of the carried fields, carried.py
    #: (bodies, modes + rigid, modes + rigid) D of the position corrections, integration/steps.py
    inverse: Array3
    gravity: Matrix  # (instants, d) less the acceleration of the ground [m/s^2]
    reach: Vector  # (1,) largest length that constraints add up at the start [m]
    vector_body: IntVector  # (vectors,) body, or -1 for one that moves as prescribed
    vector_slot: IntVector  # (vectors,) place in `prescribed` for the latter
    vector_kind: IntVector  # (vectors,)
    vector_marker: IntVector  # (vectors,) number of the marker of a body, -1 if there is none
    #: (vectors, d, modes + 1) b(0) and b_q; of a spin, and in the plane of a direction, the
    #: rotation shape functions stand behind b(0)
    shapes: Array3
    vector_stiffened: IntVector  # (vectors,) place in the next, or -1
    vector_stiffening: Array4  # (stiffened vectors, d, modes, modes)
    prescribed: Array4  # (instants, prescribed vectors, 3 derivatives, d)
    prescribed_turn: Array3  # (instants, prescribed vectors, 3) turn of their marker so far [rad]
    kind: IntVector  # (rows and springs,) the constraints first
    side: IntMatrix  # (rows and springs, sides) vectors, -1 where there are fewer
    normal: Matrix  # (rows and springs, d) of POINT, and lever arms of MESH
    ratio: Vector  # (rows and springs,) and radial factor of MESH
    start_angles: Matrix  # (rows and springs, 2) about those of rows at the start, turns counted
    drive: Array3  # (instants, rows and springs, 3) c(t) and its two derivatives
    law: Matrix  # (springs, 2) stiffness and damping
    load_vector: IntVector  # (loads,) on which they act
    load_axes: IntMatrix  # (loads, d) directions of the components, -1 for global ones
    load_table: Array3  # (instants, loads, d)


class Arrays(_Fields):
    """A mechanism, with what tells the plane from space: see bodies_plane.py and bodies_space.py.

    Kernels and constants are attributes of the two classes, and kernels for both call them by name.
    """

    #: Components of a vector; rigid coordinates of a body, position and then rotation, which the
    #: elastic ones follow; most vectors of a row; fields that elastic coordinates of a body with
    #: geometric stiffness carry along; first kind of vectors with kernels of their own.
    d: ClassVar[int]
    rigid: ClassVar[int]
    sides: ClassVar[int]
    carries: ClassVar[int]
    own: ClassVar[int]
    #: omega x x of (omega, x, out), x x f of (x, f, out), and a multiple of it added, of
    #: (x, f, factor, out); in the plane omega and moments have one component, along z.
    swing: ClassVar[Kernel]
    torque: ClassVar[Kernel]
    add_torque: ClassVar[Kernel]
    #: Adds x . B of (B, x, out), out being a beginning of the rows of B.
    add_combination: ClassVar[Kernel]
    #: Rotation of a body; see vectors.py for those of vectors with kernels of their own.
    place_body: ClassVar[Kernel]
    place_own: ClassVar[Kernel]
    pull_velocity_own: ClassVar[Kernel]
    accelerate_own: ClassVar[Kernel]
    add_curvature_own: ClassVar[Kernel]
    pullback_own: ClassVar[Kernel]
    #: Turns derivatives with respect to dA = A [dth], of (model, work, row), into those to
    #: coordinates.
    into_coordinates: ClassVar[Kernel]
    #: Equations of one body without geometric stiffness. Forces of one whose fields all have
    #: coordinates, work.force, with their derivatives by w, v and y, work.RW, work.RV and work.RY;
    #: the latter two alone.
    body_equations: ClassVar[Kernel]
    body_blocks: ClassVar[Kernel]
    body_slopes: ClassVar[Kernel]
    #: Adds to the sizes of rigid motion, and gives the turn of a body.
    measure_body: ClassVar[Kernel]

    @property
    def turning(self) -> list[int]:
        """Places of rotation vectors among the coordinates, one for each body that turns by one."""
        return []


class Work(NamedTuple):
    """Work arrays of the kernels."""

    A: Array3  # (bodies, d, d) rotation
    T: Array3  # (bodies, 3, 3) derivative of the rotation with respect to its coordinates
    c: Matrix  # (vectors, d) b(q)
    cv: Matrix  # (vectors, d) b_q v; of directions and spins in the plane their rate of turning
    c1: Matrix  # (vectors, d) velocity in the body's axes, that of the frame left out
    c2: Matrix  # (vectors, d) acceleration likewise
    B: Array3  # (vectors, d, modes) b_q
    bend: Array3  # (vectors, d, modes) T v of those with geometric stiffness
    s: Matrix  # (vectors, d)
    sd: Matrix  # (vectors, d)
    sdd: Matrix  # (vectors, d)
    forces: Matrix  # (vectors, d) whose curvatures are to be added
    shift: Matrix  # (vectors, d) L adj
    L: Array3  # (vectors, d, modes + rigid) derivative of s
    g: Matrix  # (rows and springs, components) gradients
    hz: Vector  # (components,)
    u: Vector  # (components,)
    third: Vector  # (components,)
    dz: Vector  # (components,)
    places: Vector  # (components,) vectors of a row
    line: Vector  # (n,) gradient of a spring, and what is left of it
    drift: Vector  # (n,)
    gather: Vector  # (n,) derivatives with respect to y that are to be put into coordinates
    stretch: Vector  # (springs,) value of the row of each spring
    tension: Vector  # (springs,) force of each spring
    angles: Matrix  # (rows and springs, 2) angles of rows
    #: (instants, rows and springs, 2) angles of rows over time, turns counted; no rows where none
    #: counts turns; in the plane angles are coordinates, and only the lines of MESH count theirs
    turns: Array3
    base_angles: Matrix  # (rows and springs, 2) those at the beginning of the step
    base_instant: IntVector  # (1,) and its number in the tables
    turned: Matrix  # (bodies, 3) turns of the bodies since then, in the global axes
    loads: Matrix  # (loads, d) in the global axes
    products: Matrix  # (9, fields + 1) vectors of a body in the plane, see above
    PX: Matrix  # (3, 9 (fields + 1)) in space P_a(q), P_a(v), P_a(a), in the order of Arrays.P
    qh: Matrix  # (3, fields + 1) in space (1, q), (0, v), (0, w)
    swung: Matrix  # (3, fields) in space (P_j(q) + P_j(q)^T) omega
    traces: Matrix  # (2, fields) in space of P_j(q), P_j(v)
    moved: Matrix  # (3, carried) coordinates of carried fields and their derivatives in time
    slopes: Array3  # (3, carried, modes) C q, C v, C w
    force: Vector  # (fields + rigid,) forces of a body with geometric stiffness
    small: Array3  # (16, 3, 3)
    vectors: Matrix  # (24, 3)
    Q: Matrix  # (9, 18) equations of the stages of a rotation, and right-hand sides
    RW: Matrix  # (fields + rigid, fields + rigid) derivative of the forces of a body by w
    RV: Matrix  # (fields + rigid, fields + rigid) v
    RY: Matrix  # (fields + rigid, fields + rigid) y
    pairs: Array3  # (2, fields, fields) their elastic parts in space, see bodies_space.py
    bars: Array3  # (vectors, 4, d) derivatives with respect to vectors, see above
    #: (vectors, d + d modes, modes + 1) derivatives with respect to the shape functions of the
    #: vectors, then to their geometric stiffness
    vector_bars: Array3
    # Derivatives with respect to the fields of Arrays of these names, as transposes add them.
    drive_bars: Array3  # (instants, rows and springs, 3)
    prescribed_bars: Array4  # (instants, prescribed vectors, 3, d)
    load_table_bars: Array3  # (instants, loads, d)
    law_bars: Matrix  # (springs, 2)
    normal_bars: Matrix  # (rows and springs, d)
    ratio_bars: Vector  # (rows and springs,)


def work_arrays(model: Arrays) -> Work:
    """Work arrays of zeros for a mechanism."""
    bodies, vectors, rows = model.first.size, model.vector_body.size, model.kind.size
    modes, fields, n = model.shapes.shape[2] - 1, model.K.shape[1], size(model)
    d, rigid, components = model.d, model.rigid, model.d * model.sides
    counting = rows if counts_turns(model) else 0

    def zeros(*shape: int) -> np.ndarray:
        return np.zeros(shape)

    of_vectors = ("c", "cv", "c1", "c2", "s", "sd", "sdd", "forces", "shift")
    return Work(
        A=zeros(bodies, d, d),
        T=zeros(bodies, 3, 3),
        **{name: zeros(vectors, d) for name in of_vectors},
        **{name: zeros(vectors, d, modes) for name in ("B", "bend")},
        L=zeros(vectors, d, rigid + modes),
        g=zeros(rows, components),
        **{name: zeros(components) for name in ("hz", "u", "third", "dz", "places")},
        **{name: zeros(n) for name in ("line", "drift", "gather")},
        **{name: zeros(model.law.shape[0]) for name in ("stretch", "tension")},
        angles=zeros(rows, 2),
        turns=zeros(len(model.drive), counting, 2) + model.start_angles[:counting],
        base_angles=model.start_angles.copy(),
        base_instant=np.zeros(1, dtype=np.int64),
        turned=zeros(bodies, 3),
        loads=zeros(model.load_vector.size, d),
        products=zeros(9, fields + 1),
        PX=zeros(3, 9 * (fields + 1)),
        qh=zeros(3, fields + 1),
        swung=zeros(3, fields),
        traces=zeros(2, fields),
        moved=zeros(3, model.carries),
        slopes=zeros(3, model.carries, modes),
        force=zeros(rigid + fields),
        small=zeros(16, 3, 3),
        vectors=zeros(24, 3),
        Q=zeros(9, 18),
        **{name: zeros(rigid + fields, rigid + fields) for name in ("RW", "RV", "RY")},
        pairs=zeros(2, fields, fields),
        bars=zeros(vectors, 4, d),
        vector_bars=zeros(vectors, d + d * modes, modes + 1),
        **{f"{name}_bars": zeros(*getattr(model, name).shape) for name in TABLES},
    )


def counts_turns(model: Arrays) -> bool:
    """Whether there are angles whose full turns are counted from step to step."""
    # ANGLE, GEAR and MESH are the last kinds
    return bool(model.kind.max(initial=-1) >= ANGLE)


def size(model: Arrays) -> int:
    """Number of coordinates."""
    return int(np.sum(model.rigid + model.modes))


def constraints(model: Arrays) -> int:
    """Number of scalar constraints."""
    return int(model.kind.size - len(model.law))


def carried_of(model: Arrays, body: int) -> NDArray[np.float64] | None:
    """The matrices C of the fields that elastic coordinates carry along; None where none do."""
    r = int(model.modes[body])
    return model.carried[body, :, :r, :r] if model.stiffened[body] else None


@dataclass(frozen=True)
class _Coordinates:
    """Where the coordinates of a body stand among all coordinates, and velocities likewise."""

    first: int  #: Place of the first one.
    modes: int  #: Number of elastic coordinates.
    d: ClassVar[int]  #: Number of coordinates of the position.
    turns: ClassVar[int]  #: Number of coordinates of the rotation.

    @property
    def position(self) -> slice:
        """Place of the position of the body's frame, two or three coordinates [m]."""
        return slice(self.first, self.first + self.d)

    @property
    def rigid(self) -> slice:
        """Place of position and rotation, three or six coordinates."""
        return slice(self.first, self.first + self.d + self.turns)

    @property
    def elastic(self) -> slice:
        """Place of the elastic coordinates."""
        return slice(self.rigid.stop, self.rigid.stop + self.modes)

    @property
    def all(self) -> slice:
        """Place of all coordinates of the body."""
        return slice(self.first, self.elastic.stop)


class PlaneCoordinates(_Coordinates):
    """Coordinates of a body in the plane."""

    d, turns = 2, 1

    @property
    def rotation(self) -> int:
        """Place of the angle of the body's frame [rad]."""
        return self.first + self.d


class SpaceCoordinates(_Coordinates):
    """Coordinates of a body in space."""

    d, turns = 3, 3

    @property
    def rotation(self) -> slice:
        """Place of the rotation vector of the body's frame [rad], and of its angular velocity."""
        return slice(self.first + self.d, self.rigid.stop)


Coordinates: TypeAlias = PlaneCoordinates | SpaceCoordinates
