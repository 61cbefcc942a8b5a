# SPDX-License-Identifier: MIT
"""The slider-cranks of the demos in Exudyn: the same reduced rod, in the same floating frame.

Exudyn (J. Gerstmayr, https://github.com/jgerstmayr/EXUDYN, on PyPI as ``exudyn``) simulates
flexible multibody systems in C++. Its reduced body (``ObjectFFRFreducedOrder``) takes nodes, mass
and stiffness matrix and a mode basis of any finite-element code. It gets ours:

- the nodes of our mesh, relative to the origin of our frame, those of a planar mesh with z = 0;
- our mass and stiffness matrix, in the plane with a third displacement that nothing excites;
- our shape functions as modes, so that its elastic coordinates are ours and its reference node is
  our chord frame. (Linear elasticity in another frame is another model, at second order.)

The slider is one more node with its mass, at the center of the rod's right interface. The crank
pin is the origin of the frame, so that the crank prescribes coordinates of the reference node; the
slider stays on its line by a spherical joint of one axis, in space of two. In space the universal
joint at the pin keeps the y axis of the rod's left interface perpendicular to the axis of the
crank: it ends at one more node, without mass, which moves with the interface and stays in the plane
of the crank. These are three rows of constraints in the plane, six in space, as ours.

Exudyn runs with its fastest settings: no range checks, compiled user functions, dense matrices, a
Jacobian that is kept as long as Newton's method converges, no files.
"""

import pickle
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from types import ModuleType
from typing import Any

import numpy as np
import scipy.sparse
from jobs import Array, beyond
from peer_packages import use_peers

#: Exudyn's arguments for a prescribed coordinate and its velocity
OFFSETS = "offsetUserFunction", "offsetUserFunction_t"


@dataclass(frozen=True)
class ExudynRod:
    """A reduced body as a three-dimensional finite-element code would hand it over."""

    positions: Array  #: (nodes, 3) in the body's frame [m]; the last ones are those of markers
    mass: scipy.sparse.csr_matrix  #: (3 nodes, 3 nodes) [kg]
    stiffness: scipy.sparse.csr_matrix  #: (3 nodes, 3 nodes) [N/m]
    modes: Array  #: (3 nodes, r) [-]


@dataclass(frozen=True)
class AddedNode:
    """A node that moves with a marker, in the body's dimension d."""

    position: Array  #: (d,) in the body's frame [m]
    displacement: Array  #: (d, r) by each shape function [-]
    mass: float = 0.0  #: Of a point there [kg]


def rod_for_exudyn(
    reference: Array,
    mass: scipy.sparse.spmatrix,
    stiffness: scipy.sparse.spmatrix,
    shapes: Array,
    added: Sequence[AddedNode],
) -> ExudynRod:
    """A body with nodes at markers behind those of the mesh, in three dimensions.

    The ``reference`` positions [m] in the body's frame have the shape (d nodes,), the matrices are
    those of these displacements, the ``shapes`` are (d nodes, r).
    """
    d, r = len(added[0].position), shapes.shape[1]
    n = len(reference) // d + len(added)
    positions, modes = np.zeros((n, 3)), np.zeros((n, 3, r))
    positions[:, :d] = np.vstack([reference.reshape(-1, d), *(a.position for a in added)])
    own = shapes.reshape(-1, d, r)
    modes[:, :d] = np.concatenate([own, *(a.displacement[None] for a in added)])
    # all displacements of a node have the same mass: so has the third in the plane
    scalar = scipy.sparse.csr_matrix(mass)[0::d, 0::d]
    nodal = scipy.sparse.block_diag([scalar, np.diag([a.mass for a in added])])
    entries = scipy.sparse.coo_matrix(stiffness)
    row, column = (3 * (k // d) + k % d for k in (entries.row, entries.col))
    return ExudynRod(
        positions,
        scipy.sparse.csr_matrix(scipy.sparse.kron(nodal, scipy.sparse.identity(3))),
        scipy.sparse.csr_matrix((entries.data, (row, column)), shape=(3 * n, 3 * n)),
        modes.reshape(3 * n, r),
    )


def save_rod(path: Path, rod: ExudynRod) -> None:
    """Write a rod for a process that knows nothing of meshes."""
    path.write_bytes(pickle.dumps(rod))


def load_rod(path: Path) -> ExudynRod:
    """Read what `save_rod` has written, in this run."""
    rod: ExudynRod = pickle.loads(path.read_bytes())
    return rod


@dataclass(frozen=True)
class Method:
    """Time integration."""

    steps: int  #: Of equal length
    #: 3: generalised-alpha with constraints of positions; 2: trapezoidal rule with constraints of
    #: velocities, Exudyn's only implicit method with these
    index: int = 3
    spectral_radius: float = 0.8  #: At infinite frequency, of generalised-alpha
    modified: bool = True  #: Whether Newton's method keeps its Jacobian as long as it converges


@dataclass(frozen=True)
class Crank:
    """The prescribed motion, where the rod is at the start, and what else holds it."""

    radius: float  #: [m]
    turns: float  #: From rest to rest [-]
    duration: float  #: [s]
    #: Axes of the pin's circle: its displacement along them is that of cosine and sine
    axes: tuple[int, int] = (0, 1)
    held: tuple[int, ...] = ()  #: Axes along which the pin does not move
    place: tuple[float, ...] | None = None  #: Of the pin at the start [m]; None: radius along x
    #: Axes of the rod at the start, in columns
    rotation: tuple[tuple[float, ...], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    #: Nodes, counted from the last one, that do not leave their place along some axes: 1 or 0
    guides: tuple[tuple[int, tuple[int, int, int]], ...] = ((-1, (0, 1, 0)),)


@dataclass(frozen=True)
class Simulation:
    """What Exudyn has computed, and how long it took."""

    t: Array  #: (steps + 1,) [s]
    q: Array  #: (steps + 1, r) elastic coordinates
    seconds: float  #: Of the solver alone, CPU time [s]
    seconds_model: float  #: Of the model, before the solver begins, CPU time [s]


def load_exudyn() -> ModuleType:
    """The module without range checks, where the processor can run it."""
    use_peers()
    sys.exudynFast = True  # type: ignore[attr-defined]
    import exudyn

    return exudyn


def simulate(rod: ExudynRod, crank: Crank, method: Method) -> Simulation:
    """Simulate the slider-crank; the rod has the nodes that the crank's guides name."""
    exudyn = load_exudyn()
    begin = process_time()
    rotations = "EulerParameters" if crank.held else "Rxyz"
    mbs, sensor, keep = _model(exudyn, _reduced(rod, rotations), rod, crank)
    settings = _settings(exudyn, crank.duration, method)
    solvers = exudyn.DynamicSolverType
    solver = solvers.GeneralizedAlpha if method.index == 3 else solvers.TrapezoidalIndex2
    start = process_time()
    mbs.SolveDynamic(settings, solverType=solver)
    seconds = process_time() - start
    data = np.array(mbs.GetSensorStoredData(sensor))
    del keep
    return Simulation(data[:, 0], data[:, 1:], seconds, start - begin)


def _reduced(rod: ExudynRod, rotations: str) -> Any:
    """The rod's reduction to the constants of the equations of motion.

    A reference node ``"Rxyz"`` has no constraint of its own, but serves rotations about z alone
    (others end at another motion); ``"EulerParameters"`` serves all.
    """
    from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface

    fem = FEMinterface()
    fem.nodes = {"Position": rod.positions}
    fem.massMatrix, fem.stiffnessMatrix = rod.mass, rod.stiffness
    fem.modeBasis = {"matrix": rod.modes, "type": "HCBmodes"}
    return ObjectFFRFreducedOrderInterface(fem, rigidBodyNodeType=f"NodeType.Rotation{rotations}")


def _model(
    exudyn: ModuleType, reduced: Any, rod: ExudynRod, crank: Crank
) -> tuple[Any, Any, list[Any]]:
    """The system, the sensor of the elastic coordinates, and what must stay alive."""
    import exudyn.itemInterface as items
    from exudyn.advancedUtilities import CreateSymbolicUserFunction

    mbs = exudyn.SystemContainer().AddSystem()
    place = [crank.radius, 0.0, 0.0] if crank.place is None else list(crank.place)
    rotation = np.array(crank.rotation)
    body = reduced.AddObjectFFRFreducedOrder(mbs, positionRef=place, rotationMatrixRef=rotation)
    ground = mbs.AddObject(items.ObjectGround())
    origin = mbs.AddNode(items.NodePointGround())
    fixed = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=origin, coordinate=0))
    keep: list[Any] = []

    def hold(axis: int, **offsets: Any) -> None:
        """Keep a coordinate of the reference node at zero, or at an offset over time."""
        node = body["nRigidBody"]
        own = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=axis))
        mbs.AddObject(items.ObjectConnectorCoordinate(markerNumbers=[fixed, own], **offsets))

    for axis in crank.held:
        hold(axis)
    for axis, pair in zip(crank.axes, crank_pin(exudyn, crank), strict=True):
        kind = {"itemTypeName": "ObjectConnectorCoordinate"}
        offsets = {
            name: CreateSymbolicUserFunction(mbs, function, name, **kind)
            for name, function in zip(OFFSETS, pair, strict=True)
        }
        keep += offsets.values()
        hold(axis, **offsets)
    for node, axes in crank.guides:
        guided = mbs.AddMarker(
            items.MarkerSuperElementPosition(
                bodyNumber=body["oFFRFreducedOrder"],
                meshNodeNumbers=[len(rod.positions) + node],
                weightingFactors=[1.0],
            )
        )
        start = np.array(place) + rotation @ rod.positions[node]
        line = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=ground, localPosition=start))
        mbs.AddObject(
            items.ObjectJointSpherical(markerNumbers=[line, guided], constrainedAxes=list(axes))
        )
    output = {"outputVariableType": exudyn.OutputVariableType.Coordinates}
    output |= {"storeInternal": True, "writeToFile": False}
    sensor = mbs.AddSensor(items.SensorNode(nodeNumber=body["nGenericODE2"], **output))
    mbs.Assemble()
    return mbs, sensor, keep


def crank_pin(
    exudyn: ModuleType, crank: Crank
) -> list[tuple[Callable[..., Any], Callable[..., Any]]]:
    """Displacement and velocity of the crank pin along its axes, as functions of time."""
    symbolic = exudyn.symbolic
    full, end, radius = 2.0 * np.pi * crank.turns, crank.duration, crank.radius

    # Exudyn turns each function into an expression by calling it with symbols
    def angle(t):  # type: ignore[no-untyped-def]
        s = t / end
        return full * (s * s * s * (10.0 + s * (6.0 * s - 15.0)))

    def speed(t):  # type: ignore[no-untyped-def]
        s = t / end
        return (30.0 * full / end) * (s * s * (1.0 + s * (s - 2.0)))

    def x(mbs, t, item, offset):  # type: ignore[no-untyped-def]
        return radius * symbolic.cos(angle(t)) - radius

    def y(mbs, t, item, offset):  # type: ignore[no-untyped-def]
        return radius * symbolic.sin(angle(t))

    def x_t(mbs, t, item, offset):  # type: ignore[no-untyped-def]
        return -radius * (symbolic.sin(angle(t)) * speed(t))

    def y_t(mbs, t, item, offset):  # type: ignore[no-untyped-def]
        return radius * (symbolic.cos(angle(t)) * speed(t))

    return [(x, x_t), (y, y_t)]


def _settings(exudyn: ModuleType, duration: float, method: Method) -> Any:
    settings = exudyn.SimulationSettings()
    time = settings.timeIntegration
    time.numberOfSteps = method.steps
    time.endTime = duration
    time.verboseMode = 0
    time.newton.useModifiedNewton = method.modified
    time.generalizedAlpha.spectralRadius = method.spectral_radius
    time.generalizedAlpha.computeInitialAccelerations = True
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 0.5 * duration / method.steps  # every step
    settings.linearSolver.solverType = exudyn.LinearSolverType.EXUdense
    settings.parallel.numberOfThreads = 1
    return settings


def memory_of_exudyn(
    comm: Any, progress: Callable[[float], None], *, rod: str, crank: list[float], steps: int
) -> dict[str, float]:
    """Measure the peak of memory of one simulation, in a process without DOLFINx."""
    if "dolfinx" in sys.modules:
        raise RuntimeError("the process has loaded DOLFINx")
    body = load_rod(Path(rod))
    return beyond(
        lambda: simulate(body, Crank(*crank), Method(2)),
        lambda: simulate(body, Crank(*crank), Method(steps)),
    )
