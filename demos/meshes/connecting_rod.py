# SPDX-License-Identifier: MIT
"""A connecting rod with two bearing eyes, drawn with OpenCASCADE and meshed by gmsh.

    python demos/meshes/connecting_rod.py --size 0.002 --order 2 --output rod.msh

The axis of the rod runs along x, from the centre of the large eye in the origin to that of the
small eye; a tapering shank with fillets joins them. Physical groups: the curves ``"left"`` and
``"right"`` are the bores; the surfaces ``"solid"`` (a ring around each bore) and ``"design"`` (all
the rest) are the material. Triangles; those at curves are curved with order 2.
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
    """Dimensions of the rod [m]; each pair is for the left and the right eye."""

    length: float = 0.4  #: Distance of the bores' centres
    bores: Point = (0.030, 0.016)  #: Radii of the bores
    eyes: Point = (0.046, 0.029)  #: Outer radii of the eyes
    rings: Point = (0.010, 0.008)  #: Thickness of the rings around the bores that stay solid
    shank: Point = (0.030, 0.021)  #: Half heights of the flanks, at the eyes' centres
    fillet: float = 0.04  #: Radius of the four fillets

    def __post_init__(self) -> None:
        """Check the dimensions."""
        dimensions = (self.length, *self.bores, *self.eyes, *self.rings, *self.shank, self.fillet)
        if not all(math.isfinite(number) and number > 0.0 for number in dimensions):
            raise ValueError(f"connecting rod: {self} needs positive dimensions")
        pairs = self.bores, self.eyes, self.rings, self.shank
        for bore, eye, ring, half in zip(*pairs, strict=True):
            if not bore + ring < eye:
                problem = f"a bore of {bore} m and its ring of {ring} m do not fit into the eye"
                raise ValueError(f"connecting rod: {problem} of {eye} m")
            if not half < eye:
                problem = f"the shank's half height {half} m must be smaller than the eye's radius"
                raise ValueError(f"connecting rod: {problem} {eye} m")
        if not self._fillet(0)[2][0] < self._fillet(1)[2][0]:
            problem = f"fillets of {self.fillet} m overlap on a shank of {self.length} m"
            raise ValueError(f"connecting rod: {problem}")

    def _fillet(self, side: int) -> tuple[Point, Point, Point]:
        """Centre, point on the eye and point on the flank of an upper fillet, touched by it."""
        (h0, h1), f = self.shank, self.fillet
        slope = math.hypot(self.length, h1 - h0)
        tx, ty = self.length / slope, (h1 - h0) / slope  # along the flank
        nx, ny = -ty, tx  # away from the rod
        x0 = self.length * side
        # centre = (0, h0) + f n + s t, at the distance eye + f from the eye's centre
        ax, ay = f * nx - x0, h0 + f * ny
        along = ax * tx + ay * ty
        discriminant = ax**2 + ay**2 - (self.eyes[side] + f) ** 2
        s = -along + (1 if side == 0 else -1) * math.sqrt(along**2 - discriminant)
        center = (ax + x0 + s * tx, ay + s * ty)
        share = self.eyes[side] / (self.eyes[side] + f)
        on_eye = (x0 + share * (center[0] - x0), share * center[1])
        return center, on_eye, (center[0] - f * nx, center[1] - f * ny)

    def build(
        self, size: float, *, order: int = 1, near_bores: float = 0.5, refinements: int = 0
    ) -> None:
        """Draw and mesh the rod in gmsh's current session, as a model of its own.

        Elements of a ``size`` [m] shrink to its share ``near_bores`` over two eye walls; the
        ``order`` of the geometry is 1 or 2; a refinement cuts each triangle into four.
        """
        if not 0.0 < size <= self.bores[1]:
            bound = f"positive and not above the smaller bore's radius {self.bores[1]} m"
            raise ValueError(f"connecting rod: size = {size} m must be {bound}")
        if order not in (1, 2) or not 0.0 < near_bores <= 1.0:
            orders = f"order = {order} must be 1 or 2, and near_bores = {near_bores}"
            raise ValueError(f"connecting rod: {orders} between 0 and 1")
        gmsh.model.add("connecting rod")
        occ = gmsh.model.occ
        centers, bores, loops, rings = [(0.0, 0.0), (self.length, 0.0)], [], [], []
        for (x, y), bore, ring in zip(centers, self.bores, self.rings, strict=True):
            bores.append(occ.addCircle(x, y, 0.0, bore))
            inner = occ.addCurveLoop([bores[-1]])
            loops.append(occ.addCurveLoop([occ.addCircle(x, y, 0.0, bore + ring)]))
            rings.append(occ.addPlaneSurface([loops[-1], inner]))
        design = occ.addPlaneSurface([occ.addCurveLoop(self._outline(centers)), *loops])
        occ.synchronize()
        groups = {"left": (1, bores[:1]), "right": (1, bores[1:])}
        for group, (dim, tags) in (groups | {"design": (2, [design]), "solid": (2, rings)}).items():
            gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, tags), group)
        self._set_size(centers, size, near_bores)
        gmsh.model.mesh.generate(2)
        for _ in range(refinements):
            gmsh.model.mesh.refine()
        gmsh.model.mesh.setOrder(order)

    def _outline(self, centers: list[Point]) -> list[int]:
        """Draw the outline and return its curves, from the large eye's left end anticlockwise."""
        occ, arc = gmsh.model.occ, gmsh.model.occ.addCircleArc
        (c0, e0, s0), (c1, e1, s1) = self._fillet(0), self._fillet(1)
        ends = [(-self.eyes[0], 0.0), (self.length + self.eyes[1], 0.0)]
        middles = [occ.addPoint(x, y, 0.0) for x, y in centers]
        left, right = (occ.addPoint(x, y, 0.0) for x, y in ends)
        halves = []
        for side in (-1.0, 1.0):
            a, b, c, d, f, g = (occ.addPoint(x, side * y, 0.0) for x, y in (e0, s0, s1, e1, c0, c1))
            first = [arc(left, middles[0], a), arc(a, f, b), occ.addLine(b, c)]
            halves.append([*first, arc(c, g, d), arc(d, middles[1], right)])
        return [*halves[0], *(-curve for curve in reversed(halves[1]))]

    def _set_size(self, centers: list[Point], size: float, near_bores: float) -> None:
        field, balls = gmsh.model.mesh.field, []
        for (x, y), bore, eye in zip(centers, self.bores, self.eyes, strict=True):
            balls.append(field.add("Ball"))
            sizes = {"VIn": near_bores * size, "VOut": size, "Thickness": 2.0 * (eye - bore)}
            for option, value in {"XCenter": x, "YCenter": y, "Radius": bore, **sizes}.items():
                field.setNumber(balls[-1], option, value)
        least = field.add("Min")
        field.setNumbers(least, "FieldsList", balls)
        field.setAsBackgroundMesh(least)
        for option in ("FromPoints", "FromCurvature", "ExtendFromBoundary"):
            gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)
        gmsh.option.setNumber("Mesh.Algorithm", 6)  # frontal: nearly equilateral triangles

    def write(self, path: str | Path, size: float, **options: Any) -> Path:
        """Write the mesh as a file ``.msh``, with the options of `build`, and return its path."""
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        with session():
            self.build(size, **options)
            gmsh.write(str(path))
        return path

    def domain(
        self, comm: MPI.Comm, size: float, *, order: int = 2, degree: int = 0, **options: Any
    ) -> ffr.Domain:
        """The rod as a body, meshed by rank 0, with the options of `build`.

        The displacements are of the order of the geometry, or of another ``degree``.
        """
        with session(comm.rank == 0):
            on_rank_0(comm, lambda: self.build(size, order=order, **options))
            model = gmsh.model if comm.rank == 0 else None
            return ffr.Domain.from_gmsh_model(comm, model, order=degree or order)


@contextmanager
def session(wanted: bool = True) -> Iterator[None]:
    """Open gmsh without output, if ``wanted``, and close it again."""
    if wanted:
        gmsh.initialize(["", "-v", "0"])
    try:
        yield
    finally:
        if wanted:
            gmsh.finalize()


def main(arguments: list[str] | None = None) -> None:
    """Write a mesh file."""
    shape = vars(ConnectingRod())
    sizes = {"size": 0.004, "order": 2, "near_bores": 0.5}
    style = argparse.ArgumentDefaultsHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=style)
    for name, default in {**sizes, "output": "rod.msh", **shape}.items():
        pair = isinstance(default, tuple)
        kind: dict[str, Any] = {"nargs": 2, "type": float} if pair else {"type": type(default)}
        parser.add_argument(f"--{name.replace('_', '-')}", default=default, help=" ", **kind)
    dimensions = vars(parser.parse_args(arguments))
    rod = ConnectingRod(**{name: dimensions[name] for name in shape})
    print(f"wrote {rod.write(dimensions['output'], **{name: dimensions[name] for name in sizes})}")


if __name__ == "__main__":
    run(main)
