# SPDX-License-Identifier: MIT
"""A connecting rod with two bearing eyes, drawn with OpenCASCADE and meshed by gmsh.

    python demos/meshes/connecting_rod.py --size 0.002 --order 2 --output rod.msh

The axis of the rod runs along x, from the centre of the large eye in the origin to that of the
small eye. A tapering shank joins the eyes, with fillets where it meets them. Physical groups: the
curves ``"left"`` and ``"right"`` are the bores, full circles; the surfaces ``"solid"`` (a ring
around each bore) and ``"design"`` (all the rest) are the material. Triangles; those at curves are
curved with order 2.
"""

import argparse
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import gmsh

import dolfinx_ffr as ffr
from dolfinx_ffr.io import on_rank_0
from dolfinx_ffr.program import run

Point = tuple[float, float]


@dataclass(frozen=True)
class ConnectingRod:
    """Dimensions of the rod [m]; each pair is for the left and the right eye.

    Args:
        length: Distance of the bores' centres.
        bores: Radii of the bores.
        eyes: Outer radii of the eyes.
        rings: Thickness of the rings around the bores that are not designed.
        shank: Half heights of the shank's flanks, where they would meet the eyes' centres.
        fillet: Radius of the four fillets.

    Raises:
        ValueError: If the dimensions do not make a rod.
    """

    length: float = 0.4
    bores: Point = (0.030, 0.016)
    eyes: Point = (0.046, 0.029)
    rings: Point = (0.010, 0.008)
    shank: Point = (0.030, 0.021)
    fillet: float = 0.04

    def __post_init__(self) -> None:
        """Check the dimensions."""
        numbers = (self.length, *self.bores, *self.eyes, *self.rings, *self.shank, self.fillet)
        if not all(math.isfinite(number) and number > 0.0 for number in numbers):
            raise ValueError(f"connecting rod: {self} needs positive dimensions")
        for side in (0, 1):
            if not self.bores[side] + self.rings[side] < self.eyes[side]:
                raise ValueError(
                    f"connecting rod: a bore of {self.bores[side]} m and its ring of "
                    f"{self.rings[side]} m do not fit into the eye of {self.eyes[side]} m"
                )
            if not self.shank[side] < self.eyes[side]:
                raise ValueError(
                    f"connecting rod: the shank's half height {self.shank[side]} m must be smaller "
                    f"than the eye's radius {self.eyes[side]} m"
                )
        left, right = self._fillet(0), self._fillet(1)
        if not left[2][0] < right[2][0]:
            raise ValueError(
                f"connecting rod: fillets of {self.fillet} m overlap on a shank of {self.length} m"
            )

    def _fillet(self, side: int) -> tuple[Point, Point, Point]:
        """Centre, point on the eye and point on the flank of an upper fillet.

        The circle touches the eye from outside and the flank from above.
        """
        (h0, h1), f = self.shank, self.fillet
        slope = math.hypot(self.length, h1 - h0)
        tx, ty = self.length / slope, (h1 - h0) / slope  # along the flank
        nx, ny = -ty, tx  # away from the rod
        x0 = self.length * side
        # centre = (0, h0) + f n + s t, at the distance eye + f from the eye's centre
        ax, ay = f * nx - x0, h0 + f * ny
        along = ax * tx + ay * ty
        rest = ax**2 + ay**2 - (self.eyes[side] + f) ** 2
        s = -along + (1 if side == 0 else -1) * math.sqrt(along**2 - rest)
        center = (ax + x0 + s * tx, ay + s * ty)
        share = self.eyes[side] / (self.eyes[side] + f)
        on_eye = (x0 + share * (center[0] - x0), share * center[1])
        return center, on_eye, (center[0] - f * nx, center[1] - f * ny)

    @property
    def area(self) -> float:
        """Area of the rod [m^2], in closed form."""
        (_, e0, s0), (_, e1, s1) = self._fillet(0), self._fillet(1)
        # the polygon through the ends of arcs above the axis, doubled, and the arcs' segments
        corners = [(-self.eyes[0], 0.0), e0, s0, s1, e1, (self.length + self.eyes[1], 0.0)]
        area = -sum(
            a[0] * b[1] - b[0] * a[1]
            for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
        )
        for a, b, radius in (
            (corners[0], e0, self.eyes[0]),
            (e0, s0, -self.fillet),
            (s1, e1, -self.fillet),
            (e1, corners[5], self.eyes[1]),
        ):
            angle = 2.0 * math.asin(min(1.0, 0.5 * math.dist(a, b) / abs(radius)))
            area += math.copysign(radius**2 * (angle - math.sin(angle)), radius)
        return area - math.pi * (self.bores[0] ** 2 + self.bores[1] ** 2)

    @property
    def ring_area(self) -> float:
        """Area of both rings that are not designed [m^2]."""
        return math.pi * sum(
            (bore + ring) ** 2 - bore**2 for bore, ring in zip(self.bores, self.rings, strict=True)
        )

    def build(
        self,
        size: float,
        *,
        order: int = 1,
        near_bores: float = 0.5,
        refinements: int = 0,
        name: str = "connecting rod",
    ) -> None:
        """Draw and mesh the rod in gmsh's current session, as a model of its own.

        Args:
            size: Of the elements [m].
            order: Of the geometry, 1 or 2.
            near_bores: Size at the bores relative to ``size``; it grows over two eye walls.
            refinements: How often each triangle is cut into four.
            name: Of the model.

        Raises:
            ValueError: If size, order or refinement is out of range.
        """
        if not (math.isfinite(size) and 0.0 < size <= self.bores[1]):
            raise ValueError(
                f"connecting rod: size = {size} m must be positive and not above the smaller "
                f"bore's radius {self.bores[1]} m"
            )
        if order not in (1, 2) or not 0.0 < near_bores <= 1.0:
            raise ValueError(
                f"connecting rod: order = {order} must be 1 or 2, and near_bores = {near_bores} "
                "between 0 and 1"
            )
        gmsh.model.add(name)
        occ = gmsh.model.occ
        centers = [(0.0, 0.0), (self.length, 0.0)]
        bores, loops, rings = [], [], []
        for (x, y), bore, ring in zip(centers, self.bores, self.rings, strict=True):
            bores.append(occ.addCircle(x, y, 0.0, bore))
            inner = occ.addCurveLoop([bores[-1]])
            loops.append(occ.addCurveLoop([occ.addCircle(x, y, 0.0, bore + ring)]))
            rings.append(occ.addPlaneSurface([loops[-1], inner]))
        design = occ.addPlaneSurface([occ.addCurveLoop(self._outline(centers)), *loops])
        occ.synchronize()
        for dim, entities, group in (
            (1, bores[:1], "left"),
            (1, bores[1:], "right"),
            (2, [design], "design"),
            (2, rings, "solid"),
        ):
            gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, entities), group)
        self._set_size(centers, size, near_bores)
        gmsh.model.mesh.generate(2)
        for _ in range(refinements):
            gmsh.model.mesh.refine()
        gmsh.model.mesh.setOrder(order)

    def _outline(self, centers: list[Point]) -> list[int]:
        """Draw the outline and return its curves, from the large eye's left end anticlockwise."""
        occ = gmsh.model.occ
        (c0, e0, s0), (c1, e1, s1) = self._fillet(0), self._fillet(1)
        ends = [(-self.eyes[0], 0.0), (self.length + self.eyes[1], 0.0)]
        middles = [occ.addPoint(x, y, 0.0) for x, y in centers]
        left, right = (occ.addPoint(x, y, 0.0) for x, y in ends)
        halves = []
        for side in (-1.0, 1.0):
            a, b, c, d, f, g = (occ.addPoint(x, side * y, 0.0) for x, y in (e0, s0, s1, e1, c0, c1))
            halves.append(
                [
                    occ.addCircleArc(left, middles[0], a),
                    occ.addCircleArc(a, f, b),
                    occ.addLine(b, c),
                    occ.addCircleArc(c, g, d),
                    occ.addCircleArc(d, middles[1], right),
                ]
            )
        return [*halves[0], *(-curve for curve in reversed(halves[1]))]

    def _set_size(self, centers: list[Point], size: float, near_bores: float) -> None:
        field = gmsh.model.mesh.field
        balls = []
        for (x, y), bore, eye in zip(centers, self.bores, self.eyes, strict=True):
            balls.append(field.add("Ball"))
            for option, value in (
                ("XCenter", x),
                ("YCenter", y),
                ("Radius", bore),
                ("Thickness", 2.0 * (eye - bore)),
                ("VIn", near_bores * size),
                ("VOut", size),
            ):
                field.setNumber(balls[-1], option, value)
        least = field.add("Min")
        field.setNumbers(least, "FieldsList", balls)
        field.setAsBackgroundMesh(least)
        for option in ("FromPoints", "FromCurvature", "ExtendFromBoundary"):
            gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)
        gmsh.option.setNumber("Mesh.Algorithm", 6)  # frontal: nearly equilateral triangles

    def write(self, path: str | Path, size: float, **options: Any) -> Path:
        """Write the mesh as a file and return its path.

        Args:
            path: Ends in ``.msh``; missing folders are made.
            size: Of the elements [m].
            options: As for `build`.
        """
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        with session():
            self.build(size, **options)
            gmsh.write(str(path))
        return path

    def domain(
        self,
        comm: MPI.Comm,
        size: float,
        *,
        order: int = 2,
        degree: int | None = None,
        **options: Any,
    ) -> ffr.Domain:
        """The rod as a body, without a file.

        Args:
            comm: Communicator over which the mesh is distributed; rank 0 makes the mesh.
            size: Of the elements [m].
            order: Of the geometry, 1 or 2.
            degree: Of the displacements; by default that of the geometry.
            options: As for `build`.
        """
        with session(comm.rank == 0):
            on_rank_0(comm, lambda: self.build(size, order=order, **options))
            model = gmsh.model if comm.rank == 0 else None
            return ffr.Domain.from_gmsh_model(comm, model, order=degree or order)


@contextmanager
def session(wanted: bool = True) -> Iterator[None]:
    """Open gmsh without output, if ``wanted``, and close it again."""
    if not wanted:
        yield
        return
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    try:
        yield
    finally:
        gmsh.finalize()


def main(arguments: list[str] | None = None) -> None:
    """Write a mesh file."""
    rod = ConnectingRod()
    parser = argparse.ArgumentParser(description="Mesh a connecting rod with gmsh.")
    parser.add_argument("--size", type=float, default=0.004, help="of the elements [m]")
    parser.add_argument("--order", type=int, default=2, choices=(1, 2), help="of the geometry")
    parser.add_argument(
        "--near-bores", type=float, default=0.5, help="size at the bores, relative to --size"
    )
    parser.add_argument("--output", default="rod.msh", help="file to write (default rod.msh)")
    for name in ("length", "fillet"):
        parser.add_argument(f"--{name}", type=float, default=getattr(rod, name), help="[m]")
    pair = {"nargs": 2, "type": float, "metavar": ("LEFT", "RIGHT"), "help": "[m]"}
    for name in ("bores", "eyes", "rings", "shank"):
        parser.add_argument(f"--{name}", default=getattr(rod, name), **pair)
    given = parser.parse_args(arguments)
    shape = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in vars(given).items()
        if hasattr(rod, name)
    }
    sizes = {"order": given.order, "near_bores": given.near_bores}
    print(f"wrote {ConnectingRod(**shape).write(given.output, given.size, **sizes)}")


if __name__ == "__main__":
    run(main)
