# SPDX-License-Identifier: MIT
"""A flat part in space: the solid that its STEP file has, by tetrahedra."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import shapely

from ..fem import Curve, gmsh_options, quiet
from .export import Sheet, add_solid
from .options import MESHES


def mesh_solid(
    gmsh: Any, sheet: Sheet, interfaces: Mapping[str, Sequence[Curve]], size: float
) -> None:
    """Mesh the solid of a part in gmsh's model by tetrahedra of a ``size``, or smaller [m].

    Its middle plane is z = 0. Physical groups are the volume, "design", and the walls over the
    curves of each interface.
    """
    add_solid(gmsh, sheet, 1.0, whole_splines=True)
    model = gmsh.model
    model.occ.translate(model.occ.getEntities(3), 0.0, 0.0, -0.5 * sheet.thickness())
    model.occ.synchronize()
    options = {"Mesh.MeshSizeMax": size, "Mesh.MeshSizeFromCurvature": MESHES.around}
    with gmsh_options(gmsh, options), quiet():
        model.mesh.generate(3)
    volumes = [tag for _, tag in model.getEntities(3)]
    model.setPhysicalName(3, model.addPhysicalGroup(3, volumes), "design")

    lines = {
        name: shapely.union_all(
            [
                shapely.LineString(curve.points(0.01 * MESHES.on_interface * size))
                for curve in curves
            ]
        )
        for name, curves in interfaces.items()
    }
    walls: dict[str, list[int]] = {name: [] for name in lines}
    for _, tag in model.getEntities(2):
        x = np.reshape(model.mesh.getNodes(2, tag, includeBoundary=True)[1], (-1, 3))
        if np.ptp(x[:, 2]) > 0.0:  # floors and faces of the plate are flat
            for name, line in lines.items():
                if (
                    np.max(shapely.distance(line, shapely.points(x[:, :2])))
                    < MESHES.on_interface * size
                ):
                    walls[name].append(tag)
    for name, tags in walls.items():
        model.setPhysicalName(2, model.addPhysicalGroup(2, tags), name)
