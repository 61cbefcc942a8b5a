# SPDX-License-Identifier: MIT
"""Whether a part stays within the outline of its body, and its holes have the rims asked for.

It looks at the finished part and at the drawing alone, whatever made the one from the other.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely

from ..arrays import Array
from ..design import HoleRims
from ..fem import VOID, SpatialHole, Tetrahedra
from ..parallel import on_rank_0
from .asked_sizes import PartViolation, place
from .options import CHECKS
from .part import Part
from .solid import Solid
from .tetrahedral_cut import outer_faces


def outline_violations(part: Part | Solid, rim: float, least: float) -> list[PartViolation]:
    """Where a part crosses the outline of its body, or lacks the rim of a drawn hole.

    Args:
        part: The part or solid of a body.
        rim: Width of the rim around each hole of the body's drawing that was asked for [m].
        least: Minimum member, by which lengths are measured [m].

    Returns:
        What and where. The share of material outside of the body is the depth to which it leaves
        the body, in minimum members; that of a rim is what is missing of its width.
    """
    if isinstance(part, Part):
        return list(_in_the_plane(part, rim, least))
    return _in_space(part, rim, least)


def _in_the_plane(part: Part, rim: float, least: float) -> Iterator[PartViolation]:
    body, tolerance = part.body.outline, CHECKS.tolerance * least
    outside = part.polygon.difference(body.buffer(tolerance))
    for region in [] if outside.is_empty else shapely.get_parts(outside):
        corners = shapely.points(shapely.get_coordinates(region))
        inscribed = shapely.maximum_inscribed_circle(region, 0.1 * tolerance)  # a radius of it
        depth = max(float(np.max(shapely.distance(corners, body))), inscribed.length + tolerance)
        yield _outside(np.array(inscribed.coords[0]), depth, least)

    for hole, region in HoleRims(part.body, rim).regions:
        missing = region.difference(part.polygon)
        # a strip thinner than the accuracy of the curves is not missing
        missing = missing.buffer(-tolerance).buffer(tolerance)
        if not missing.is_empty:
            width = hole.shape.distance(missing)
            if width < (1.0 - CHECKS.tolerance) * rim:
                yield _rim(hole.center, width, rim)


def _in_space(solid: Solid, rim: float, least: float) -> list[PartViolation]:
    body = Tetrahedra.of(solid.body)
    holes = [hole for hole in solid.body.holes if isinstance(hole, SpatialHole)]
    tolerance = max(CHECKS.tolerance * least, CHECKS.cell_tolerance * solid.body.cell_size)

    def violations() -> list[PartViolation]:
        distances = _Distances(solid, _surface(body), holes)
        return [*distances.outside(least, tolerance), *distances.rims(rim)]

    result: list[PartViolation] = on_rank_0(solid.body.comm, violations)
    return result


class _Distances:
    """Signed distances from the surfaces of a solid and of its body, negative inside."""

    def __init__(self, solid: Solid, body: Any, holes: list[SpatialHole]) -> None:
        self.solid, self.body, self.holes = solid, body, holes
        self.surface = solid.surface()

    @staticmethod
    def _from(surface: Any, points: Array) -> Array:
        import pyvista  # takes a while

        cloud = pyvista.PolyData(points).compute_implicit_distance(surface)
        return np.asarray(cloud["implicit_distance"])

    @staticmethod
    def _rays(hole: SpatialHole, lengths: Array) -> Array:
        """Points at ``lengths`` (n,) from the walls into the hole, shape (walls, n, 3) [m]."""
        every = -(-len(hole.middles) // CHECKS.on_walls)
        starts, directions = hole.middles[::every, None], hole.outward[::every, None]
        return np.asarray(starts + lengths[:, None] * directions)

    def outside(self, least: float, tolerance: float) -> Iterator[PartViolation]:
        """The point of the solid that is farthest outside of the body, and filled holes."""
        depth = self._from(self.body, self.solid.points)
        farthest = int(np.argmax(depth))
        if depth[farthest] > tolerance:
            yield _outside(self.solid.points[farthest], float(depth[farthest]), least)
        for hole in self.holes:
            across = float(np.linalg.norm(np.ptp(hole.box, axis=0)))
            lengths = across * np.linspace(0.0, 0.5, CHECKS.depths + 1)[1:]
            points = self._rays(hole, lengths).reshape(-1, 3)
            depth = self._from(self.body, points)
            # another piece of the body may stand in the hole
            is_empty = depth > tolerance
            is_filled = self._from(self.surface, points[is_empty]) < -tolerance
            if np.any(is_filled):
                yield _outside(hole.center, float(np.max(depth[is_empty][is_filled])), least)

    def rims(self, rim: float) -> Iterator[PartViolation]:
        """The holes whose rims are thinner than asked for."""
        depths = rim * np.linspace(0.0, 1.0, CHECKS.depths + 1)[1:]
        for hole in self.holes if rim > 0.0 else ():
            rays = self._rays(hole, -depths)
            points = rays.reshape(-1, 3)
            tolerance = CHECKS.tolerance_in_space * rim
            is_within_body = self._from(self.body, points) < -tolerance
            beyond = self._from(self.surface, points)
            missing = is_within_body & (beyond > tolerance)
            # the material ends where a point outside of it is near it
            ends = np.tile(depths, len(rays)) - beyond
            width = max(float(np.min(ends[missing], initial=rim)), 0.0)
            if width < rim - tolerance:
                yield _rim(hole.center, width, rim)


def _surface(body: Tetrahedra) -> Any:
    """The closed surface of the tetrahedra that are not void, on rank 0."""
    import pyvista

    triangles = outer_faces(body.cells[body.regions != VOID])[0]
    return pyvista.PolyData.from_regular_faces(body.points, triangles)


def _outside(position: Array, depth: float, least: float) -> PartViolation:
    where = place(position)
    sentence = (
        f"material lies {1e3 * depth:.3g} mm outside of the body near {where}: take smaller "
        "elements, or leave the boundary to the mesh (boundary=0)"
    )
    return PartViolation(f"material outside of the body near {where}", depth / least, sentence)


def _rim(center: Array, width: float, rim: float) -> PartViolation:
    where = place(center)
    sentence = (
        f"the rim of the hole near {where} is {1e3 * width:.3g} mm wide, below its minimum of "
        f"{1e3 * rim:.3g} mm: take smaller elements, another start or a larger volume, or a "
        "smaller hole_rim"
    )
    return PartViolation(f"rim of the hole near {where}", 1.0 - width / rim, sentence)
