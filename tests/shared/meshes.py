# SPDX-License-Identifier: MIT
"""Meshes that several tests use."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from meshes.connecting_rod import ConnectingRod

from dolfinx_ffr import Domain
from dolfinx_ffr.fem import _compat, gmsh_model


def prongs(comm: MPI.Intracomm) -> Domain:
    """A fork of two identical prongs on a rigid root: each frequency comes twice."""
    nx, ny = 20, 4
    i, j, prong = np.meshgrid(np.arange(nx + 1), np.arange(ny + 1), [0, 1], indexing="ij")
    points = np.column_stack([i.ravel() / nx, 0.2 * j.ravel() / ny + prong.ravel()])
    number = np.arange(i.size).reshape(i.shape)
    cells = np.vstack([_quadrilaterals(number[:, :, k]) for k in (0, 1)])
    return _domain(comm, points, cells, {"root": lambda x: x[0] < 1e-9})


def plate(comm: MPI.Intracomm, n: int, hole: int = 0) -> Domain:
    """A square of n x n elements, all edges one interface, with a hole of hole x hole elements."""
    i, j = (index.ravel() for index in np.meshgrid(*[np.arange(n + 1)] * 2, indexing="ij"))
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    low, high = (n - hole) // 2, (n + hole) // 2
    full = np.ones((n, n), dtype=bool)
    full[low:high, low:high] = False
    cells = _quadrilaterals(number)[full.ravel()]
    edges = {"edges": lambda x: np.max(np.abs(x[:2] - 0.5), axis=0) > 0.5 - 1e-9}
    return _domain(comm, np.column_stack([i, j]) / n, cells, edges)


def annulus(comm: MPI.Intracomm, around: int, across: int) -> Domain:
    """A ring of radii 0.4 and 1, held inside."""
    radius = np.linspace(0.4, 1.0, across + 1)
    angle = 2 * np.pi * np.arange(around) / around
    number = np.arange(around * (across + 1)).reshape(around, across + 1)
    cells = _quadrilaterals(np.vstack([number, number[:1]]))
    r, phi = np.tile(radius, around), np.repeat(angle, across + 1)
    points = np.column_stack([r * np.cos(phi), r * np.sin(phi)])
    return _domain(comm, points, cells, {"hub": lambda x: np.hypot(x[0], x[1]) < 0.4 + 1e-9})


def star(comm: MPI.Intracomm, blades: int, nx: int = 12, ny: int = 2) -> Domain:
    """Blades on one rigid hub: each frequency comes once for each of them."""
    i, j = (index.ravel() for index in np.meshgrid(range(nx + 1), range(ny + 1), indexing="ij"))
    number = np.arange(len(i)).reshape(nx + 1, ny + 1)
    x, y = 0.5 + i / nx, 0.1 * (j / ny - 0.5)
    points, cells = [], []
    for blade in range(blades):
        c, s = np.cos(2 * np.pi * blade / blades), np.sin(2 * np.pi * blade / blades)
        points.append(np.column_stack([c * x - s * y, s * x + c * y]))
        cells.append(_quadrilaterals(number + blade * len(i)))
    hub = {"hub": lambda x: np.hypot(x[0], x[1]) < 0.5 + 0.25 / nx}
    return _domain(comm, np.vstack(points), np.vstack(cells), hub)


def bar(comm: MPI.Intracomm, n: int, *, circular: bool) -> Domain:
    """A bar along x on a rigid root, of square or round section: it bends equally in all planes."""
    shape = 3 * n + 1, n + 1, n + 1
    i, y, z = (index.ravel() for index in np.meshgrid(*map(range, shape), indexing="ij"))
    y, z = 2.0 * y / n - 1.0, 2.0 * z / n - 1.0
    if circular:  # the square's edges become the circle
        y, z = y * np.sqrt(1.0 - 0.5 * z**2), z * np.sqrt(1.0 - 0.5 * y**2)
    number = np.arange(len(i)).reshape(shape)
    layers = (number[:-1], number[1:])
    cells = np.hstack([np.vstack([_quadrilaterals(k) for k in layer]) for layer in layers])
    order = [0, 4, 1, 5, 2, 6, 3, 7]  # x first, as DOLFINx counts corners
    return _domain(comm, np.column_stack([i / n, y, z]), cells[:, order], {"root": _at_root})


def _at_root(x: np.ndarray) -> np.ndarray:
    return x[0] < 1e-9


def _quadrilaterals(number: np.ndarray) -> np.ndarray:
    """Cells between the nodes of a grid."""
    corners = [number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]]
    return np.column_stack([corner.ravel() for corner in corners])


def _domain(comm: MPI.Intracomm, points: np.ndarray, cells: np.ndarray, interfaces: dict) -> Domain:
    """A domain of quadrilaterals or hexahedra; points without cells are left out."""
    corners, kind = cells.shape[1], "quadrilateral" if points.shape[1] == 2 else "hexahedron"
    used, cells = np.unique(cells, return_inverse=True)
    cells, points = cells.reshape(-1, corners), points[used]
    if comm.rank > 0:
        cells, points = cells[:0], points[:0]
    return Domain(_compat.create_mesh(comm, cells, points, kind, 1), interfaces)


def write_rod(
    path: Path,
    *,
    names: bool = True,
    order: int = 1,
    length: float = 0.4,
    height: float = 0.04,
    size: float = 0.02,
) -> None:
    """Write a rod with physical groups by gmsh; one twentieth of its length is solid."""
    h, solid = height / 2, length / 20
    corners = [(0, -h), (solid, -h), (length, -h), (length, h), (solid, h), (0, h)]
    with gmsh_model() as gmsh:
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        geometry = gmsh.model.geo
        points = [geometry.addPoint(x, y, 0) for x, y in corners]
        line = [geometry.addLine(points[i], points[(i + 1) % 6]) for i in range(6)]
        cut = geometry.addLine(points[1], points[4])
        end = geometry.addPlaneSurface([geometry.addCurveLoop([line[0], cut, line[4], line[5]])])
        sheet = geometry.addPlaneSurface([geometry.addCurveLoop([line[1], line[2], line[3], -cut])])
        geometry.synchronize()
        groups = [(1, line[5], "left"), (1, line[2], "right"), (2, end, "solid"), (2, sheet, "d")]
        for dim, entity, name in groups:
            tag = gmsh.model.addPhysicalGroup(dim, [entity])
            if names:
                gmsh.model.setPhysicalName(dim, tag, name)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(path))


def rod_file(comm: MPI.Intracomm, folder: Path, **options: Any) -> Path:
    """The rod as a file in a folder of all ranks."""
    path = folder / "rod.msh"
    if comm.rank == 0:
        write_rod(path, **options)
    comm.Barrier()
    return path


#: Tools that are cut out of a block, by name: each makes volumes of a model of OpenCASCADE
TOOLS: dict[str, Callable[[Any], list[int]]] = {
    "bore": lambda occ: [occ.addCylinder(0.2, 0.05, 0.0, 0.0, 0.0, 0.2, 0.1)],
    "slot": lambda occ: _union(
        occ,
        occ.addBox(0.1, 0.0, 0.0, 0.2, 0.1, 0.2),
        occ.addCylinder(0.1, 0.05, 0.0, 0.0, 0.0, 0.2, 0.05),
        occ.addCylinder(0.3, 0.05, 0.0, 0.0, 0.0, 0.2, 0.05),
    ),
    "square": lambda occ: [occ.addBox(0.1, -0.05, 0.0, 0.2, 0.2, 0.2)],
    "pocket": lambda occ: [occ.addBox(0.1, -0.05, 0.1, 0.2, 0.2, 0.1)],
    "blind bore": lambda occ: [occ.addCylinder(0.2, 0.05, 0.1, 0.0, 0.0, 0.1, 0.1)],
    "cone": lambda occ: [occ.addCone(0.2, 0.05, 0.0, 0.0, 0.0, 0.2, 0.06, 0.14)],
    "oblique bore": lambda occ: [occ.addCylinder(0.1, 0.05, -0.1, 0.2, 0.0, 0.4, 0.06)],
    "cavity": lambda occ: [occ.addSphere(0.2, 0.05, 0.1, 0.06)],
    "crossing bores": lambda occ: _union(
        occ,
        occ.addCylinder(0.2, 0.0, 0.0, 0.0, 0.0, 0.2, 0.06),
        occ.addCylinder(0.2, -0.3, 0.1, 0.0, 0.6, 0.0, 0.04),
    ),
    "fork": lambda occ: [occ.addBox(0.0, -0.1, 0.0, 1.0, 0.2, 0.2)],
    "groove": lambda occ: [occ.addBox(-0.2, -0.1, 0.1, 1.0, 0.2, 0.1)],
    "step": lambda occ: [occ.addBox(0.0, -0.25, 0.1, 0.5, 0.5, 0.1)],
    "notch": lambda occ: [occ.addBox(0.3, 0.1, 0.1, 0.2, 0.15, 0.1)],
    "half bore": lambda occ: [occ.addCylinder(0.2, 0.25, 0.0, 0.0, 0.0, 0.2, 0.1)],
}


def _union(occ: Any, first: int, *others: int) -> list[int]:
    return [tag for _, tag in occ.fuse([(3, first)], [(3, other) for other in others])[0]]


def write_pierced_block(
    path: Path, *, tool: str = "bore", tilt: float = 0.0, size: float = 0.12
) -> None:
    """A block without what a tool takes, turned about x by an angle, as a gmsh file."""
    with gmsh_model() as gmsh:
        block = gmsh.model.occ.addBox(-0.5, -0.25, 0.0, 1.0, 0.5, 0.2)
        tools = [(3, tag) for tag in TOOLS[tool](gmsh.model.occ)]
        bodies, _ = gmsh.model.occ.cut([(3, block)], tools)
        gmsh.model.occ.rotate(bodies, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, tilt)
        gmsh.model.occ.synchronize()
        surfaces = [tag for _, tag in gmsh.model.getEntities(2)]
        bore = [s for s in surfaces if gmsh.model.getType(2, s) == "Cylinder"]
        at_left = [s for s in surfaces if gmsh.model.occ.getCenterOfMass(2, s)[0] < -0.499]
        material = [tag for _, tag in bodies]
        for dim, tags, name in ((3, material, "material"), (2, bore, "bore"), (2, at_left, "left")):
            if tags:
                gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, tags), name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(path))


def area_of(rod: ConnectingRod) -> float:
    """Area of a rod with eyes [m^2], in closed form."""
    (_, e0, s0), (_, e1, s1) = rod._fillet(0), rod._fillet(1)
    # the polygon through the ends of arcs above the axis, doubled, and the arcs' segments
    corners = np.array([(-rod.eyes[0], 0.0), e0, s0, s1, e1, (rod.length + rod.eyes[1], 0.0)])
    ahead = np.roll(corners, -1, axis=0)
    area = -float(np.sum(corners[:, 0] * ahead[:, 1] - ahead[:, 0] * corners[:, 1]))
    radii = {0: rod.eyes[0], 1: -rod.fillet, 3: -rod.fillet, 4: rod.eyes[1]}
    for k, radius in radii.items():
        angle = 2.0 * np.arcsin(0.5 * np.hypot(*(ahead[k] - corners[k])) / abs(radius))
        area += np.copysign(radius**2 * (angle - np.sin(angle)), radius)
    return area - np.pi * (rod.bores[0] ** 2 + rod.bores[1] ** 2)
