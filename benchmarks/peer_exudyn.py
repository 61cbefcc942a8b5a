# SPDX-License-Identifier: MIT
"""The slider-cranks of the demos in Exudyn: the same reduced rod, in the same floating frame.

Exudyn (J. Gerstmayr, https://github.com/jgerstmayr/EXUDYN, on PyPI as ``exudyn``) simulates
flexible multibody systems in C++. Its reduced body gets the file that `VolumeIntegrals.save` writes
for it, with the slider as a point mass, so that its elastic coordinates are ours and its reference
node is our chord frame. (Linear elasticity in another frame is another model, at second order.)

The crank pin is the origin of the frame, so that the crank prescribes coordinates of the reference
node; the slider stays on its line by a spherical joint of one axis, in space of two. In space the
universal joint at the pin keeps the y axis of the rod's left interface perpendicular to the axis of
the crank: the node of the file on this axis stays in the plane of the crank. These are three rows
of constraints in the plane, six in space, as ours.

Exudyn runs with its fastest settings: no range checks, compiled user functions, dense matrices, a
Jacobian that is kept as long as Newton's method converges, no files.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from types import ModuleType
from typing import Any

import numpy as np
from jobs import Array, beyond
from peer_packages import use_peers

#: Exudyn's arguments for a prescribed coordinate and its velocity
OFFSETS = "offsetUserFunction", "offsetUserFunction_t"


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
    #: Nodes of the file that do not leave their place along some axes: 1 or 0
    guides: tuple[tuple[int, tuple[int, int, int]], ...] = ((4, (0, 1, 0)),)


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


def simulate(rod: Path, crank: Crank, method: Method) -> Simulation:
    """Simulate the slider-crank with the rod of a file."""
    exudyn = load_exudyn()
    begin = process_time()
    mbs, sensor, keep = _model(exudyn, rod, crank)
    settings = _settings(exudyn, crank.duration, method)
    solvers = exudyn.DynamicSolverType
    solver = solvers.GeneralizedAlpha if method.index == 3 else solvers.TrapezoidalIndex2
    start = process_time()
    mbs.SolveDynamic(settings, solverType=solver)
    seconds = process_time() - start
    data = np.array(mbs.GetSensorStoredData(sensor))
    del keep
    return Simulation(data[:, 0], data[:, 1:], seconds, start - begin)


def _model(exudyn: ModuleType, rod: Path, crank: Crank) -> tuple[Any, Any, list[Any]]:
    """The system, the sensor of the elastic coordinates, and what must stay alive.

    A reference node ``Rxyz`` has no constraint of its own, but serves rotations about z alone
    (others end at another motion); ``EulerParameters`` serve all.
    """
    import exudyn.itemInterface as items
    from exudyn.advancedUtilities import CreateSymbolicUserFunction
    from exudyn.FEM import ObjectFFRFreducedOrderInterface

    reduced = ObjectFFRFreducedOrderInterface()
    reduced.LoadFromFile(str(rod))
    rotations = "EulerParameters" if crank.held else "Rxyz"
    reduced.rigidBodyNodeType = f"NodeType.Rotation{rotations}"
    nodes = reduced.xRef.reshape(-1, 3)
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
                bodyNumber=body["oFFRFreducedOrder"], meshNodeNumbers=[node], weightingFactors=[1.0]
            )
        )
        start = np.array(place) + rotation @ nodes[node]
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
    cos, sin, radius = exudyn.symbolic.cos, exudyn.symbolic.sin, crank.radius
    full, end = 2.0 * np.pi * crank.turns, crank.duration

    # Exudyn turns each function into an expression by calling it with symbols
    def angle(t):  # type: ignore[no-untyped-def]
        s = t / end
        return full * (s * s * s * (10.0 + s * (6.0 * s - 15.0)))

    def speed(t):  # type: ignore[no-untyped-def]
        s = t / end
        return (30.0 * full / end) * (s * s * (1.0 + s * (s - 2.0)))

    x = lambda mbs, t, item, offset: radius * cos(angle(t)) - radius  # noqa: E731
    y = lambda mbs, t, item, offset: radius * sin(angle(t))  # noqa: E731
    x_t = lambda mbs, t, item, offset: -radius * (sin(angle(t)) * speed(t))  # noqa: E731
    y_t = lambda mbs, t, item, offset: radius * (cos(angle(t)) * speed(t))  # noqa: E731
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
    return beyond(
        lambda: simulate(Path(rod), Crank(*crank), Method(2)),
        lambda: simulate(Path(rod), Crank(*crank), Method(steps)),
    )
