# SPDX-License-Identifier: MIT
"""Let Exudyn integrate a system, and read the elastic coordinates of a reduced body in it."""

from __future__ import annotations

from typing import Any

import numpy as np


def elastic_coordinates(mbs: Any, body: dict[str, Any], end: float, steps: int) -> np.ndarray:
    """Those at equal steps until ``end`` [s], shape (steps + 1, r), by generalised-alpha.

    ``body`` is what `AddObjectFFRFreducedOrder` has returned.
    """
    import exudyn
    import exudyn.itemInterface as items

    kept: dict[str, Any] = {"storeInternal": True, "writeToFile": False}
    kept["outputVariableType"] = exudyn.OutputVariableType.Coordinates
    sensor = mbs.AddSensor(items.SensorNode(nodeNumber=body["nGenericODE2"], **kept))
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
