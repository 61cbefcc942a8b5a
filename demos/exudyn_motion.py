# SPDX-License-Identifier: MIT
"""A reduced body in Exudyn: from its file, on a bearing, in motion."""

from pathlib import Path
from typing import Any

import numpy as np


def body_from(path: Path, **start: Any) -> tuple[Any, dict[str, Any]]:
    """A system with the body of a file, and what `AddObjectFFRFreducedOrder` returns of it."""
    import exudyn
    from exudyn.FEM import ObjectFFRFreducedOrderInterface

    mbs, body = exudyn.SystemContainer().AddSystem(), ObjectFFRFreducedOrderInterface()
    body.LoadFromFile(str(path))
    return mbs, body.AddObjectFFRFreducedOrder(mbs, **start)


def hold(mbs: Any, body: dict[str, Any], node: int, axes: list[int]) -> None:
    """Hold a node of a body at the origin, along those of the axes whose number is 1."""
    import exudyn.itemInterface as items

    ground = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mbs.AddObject(items.ObjectGround())))
    single_node = {"meshNodeNumbers": [node], "weightingFactors": [1.0]}
    marker = items.MarkerSuperElementPosition(bodyNumber=body["oFFRFreducedOrder"], **single_node)
    ends = [ground, mbs.AddMarker(marker)]
    mbs.AddObject(items.ObjectJointSpherical(markerNumbers=ends, constrainedAxes=axes))


def elastic_coordinates(mbs: Any, body: dict[str, Any], end: float, steps: int) -> np.ndarray:
    """Those of a body at equal steps until ``end`` [s], (steps + 1, r), by generalised-alpha."""
    import exudyn
    import exudyn.itemInterface as items

    recorded = {"storeInternal": True, "writeToFile": False, "nodeNumber": body["nGenericODE2"]}
    coordinates = exudyn.OutputVariableType.Coordinates
    sensor = mbs.AddSensor(items.SensorNode(outputVariableType=coordinates, **recorded))
    mbs.Assemble()
    settings = exudyn.SimulationSettings()
    time = settings.timeIntegration
    time.numberOfSteps, time.endTime, time.verboseMode = steps, end, 0
    time.newton.relativeTolerance, time.newton.absoluteTolerance = 1e-12, 1e-13
    time.generalizedAlpha.spectralRadius = 0.9
    time.generalizedAlpha.computeInitialAccelerations = True
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 0.5 * end / steps
    mbs.SolveDynamic(settings)
    return np.asarray(mbs.GetSensorStoredData(sensor)[:, 1:])
