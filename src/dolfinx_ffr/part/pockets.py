# SPDX-License-Identifier: MIT
"""Where a plate is milled down to a web: the faces that fill the holes of its full thickness."""

from __future__ import annotations

import numpy as np
import shapely

from ..fem import Drawing, Face, ShapeError, outer_sides
from .options import CURVES


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
    accuracy = 0.01 * CURVES.strip * spacing
    faces, floors = [], []
    for loops in drawing.faces_beside(sides, accuracy):
        floor = drawing.polygon(loops, accuracy)
        if body.covers(floor.representative_point()):
            faces.append(Face("pocket", loops))
            floors.append(floor)

    full = [drawing.polygon(face.loops, accuracy) for face in drawing.faces]
    missing = body.difference(shapely.union_all([*floors, *full]))
    missing = missing.buffer(-0.5 * CURVES.strip * spacing)
    if not missing.is_empty:
        x, y = 1e3 * np.array(missing.representative_point().coords[0])
        raise ShapeError(
            f"part: the pocket near ({x:.4g}, {y:.4g}) mm is open at the outline or at a hole of "
            "the body, and a web has full thickness all around: give the design a hole_rim"
        )
    return faces
