# SPDX-License-Identifier: MIT
"""Where a plate is milled down to a web: the faces that fill the holes of its full thickness."""

from __future__ import annotations

import numpy as np
import shapely

from ..fem import Drawing, Face, ShapeError, directed_faces, face_polygon, ring, walked
from .options import CURVES
from .pieces import outer_sides


def pocket_faces(drawing: Drawing, body: shapely.Geometry, spacing: float) -> list[Face]:
    """The faces of a body that are in no face of a drawing: the floors of its pockets.

    Args:
        drawing: Drawing of the region with full thickness.
        body: The body as polygons [m]; its own holes are no pockets.
        spacing: Length on which the field of the design varies [m].

    Raises:
        ShapeError: If a pocket is open at the outline or at a hole of the body.
    """
    # with the face on the right
    sides = [(i, not forward) for i, forward in outer_sides(drawing.faces)]
    curves = walked(drawing.curves, sides)
    nodes = [drawing.nodes[i] if forward else drawing.nodes[i][::-1] for i, forward in sides]
    accuracy = 0.01 * CURVES.strip * spacing

    def polygon(loop: list[int]) -> shapely.Polygon:
        return shapely.Polygon(ring([curves[i] for i in loop], accuracy))

    faces, floors = [], []
    for loops in directed_faces(curves, nodes, accuracy):
        outer, *islands = map(polygon, loops)
        floor = outer.difference(shapely.union_all(islands))
        if body.covers(floor.representative_point()):
            faces.append(Face("pocket", [[sides[i] for i in loop] for loop in loops]))
            floors.append(floor)

    full = [face_polygon(drawing.curves, face.loops, accuracy) for face in drawing.faces]
    missing = body.difference(shapely.union_all([*floors, *full]))
    missing = missing.buffer(-0.5 * CURVES.strip * spacing)
    if not missing.is_empty:
        x, y = 1e3 * np.array(missing.representative_point().coords[0])
        raise ShapeError(
            f"part: the pocket near ({x:.4g}, {y:.4g}) mm is open at the outline or at a hole of "
            "the body, and a web has full thickness all around: give the design a hole_rim"
        )
    return faces
