# SPDX-License-Identifier: MIT
"""Selected facets and cells, and interfaces: boundary facets that move as one rigid body."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from .. import validation
from ..arrays import Array, Mask
from ..parallel import on_every_rank
from .curves import ShapeError
from .mesh_checks import facet_nodes, facet_points

Predicate = Callable[[Array], Mask]


@dataclass(frozen=True)
class ReferenceOptions:
    """What is a plane, a circle or a cylinder among interfaces, and how their centers are moved."""

    flat: float = 1e-6  #: Largest deviation of normals from each other that counts as none
    #: Fewer points lie on a circle by chance: any three do, and the corners of a rectangle
    fewest: int = 5
    round: float = 1e-4  #: Largest distance of a point from the circle, relative to its radius
    #: By which nodes are moved for differences of centers, in extents of the interface
    step: float = 1e-6


REFERENCE = ReferenceOptions()


@dataclass(frozen=True)
class Bore:
    """The closed curve of an outline around a point, as an interface of a body in the plane.

    Attributes:
        at: A point in the bore [m].
    """

    at: tuple[float, float]

    def __post_init__(self) -> None:
        validation.real_array("bore: at", self.at, (2,), expected="two coordinates")


@dataclass(frozen=True)
class Box:
    """The boundary between two corners, as an interface.

    Attributes:
        lower: Smallest coordinates, two or three by the dimension [m].
        upper: Largest coordinates [m].
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def __post_init__(self) -> None:
        low = validation.real_array("box: lower", self.lower, (None,))
        high = validation.real_array("box: upper", self.upper, (None,))
        if len(low) != len(high) or len(low) not in (2, 3) or not np.all(low < high):
            raise ValueError(
                f"box: lower {self.lower} and upper {self.upper} are no corners; give two or three "
                "coordinates each, all of lower smaller than of upper"
            )

    def __call__(self, x: Array) -> Mask:
        """Whether points (3, n) are between the corners, shape (n,)."""
        low, high = np.array(self.lower)[:, None], np.array(self.upper)[:, None]
        inside = x[: len(low)]
        return np.asarray(np.all((low <= inside) & (inside <= high), axis=0))


def located(
    domain: mesh.Mesh, argument: str, selection: Predicate | ArrayLike, dim: int
) -> NDArray[np.int32]:
    """Numbers of boundary facets, or of cells, by dimension: by a predicate, numbers or a mask."""
    facets = dim < domain.topology.dim
    entities = domain.topology.index_map(dim)
    sizes = entities.size_local, entities.size_local + entities.num_ghosts
    with on_every_rank(domain.comm, argument):
        if not callable(selection):
            entities_found = _numbers_of(
                argument, selection, "facets" if facets else "cells", sizes
            )
        else:
            checked(argument, selection, domain.geometry.x.T)
    if callable(selection):
        locate = mesh.locate_entities_boundary if facets else mesh.locate_entities
        entities_found = np.asarray(locate(domain, dim, selection), dtype=np.int32)
    return entities_found


def located_cells(
    domain: mesh.Mesh, argument: str, selection: Predicate | ArrayLike | None
) -> Mask:
    """Mask over the cells owned by this rank, true where they are selected; None selects none."""
    dim = domain.topology.dim
    n = int(domain.topology.index_map(dim).size_local)
    chosen = np.zeros(n, dtype=bool)
    if selection is not None:
        cells = located(domain, argument, selection, dim)
        chosen[cells[cells < n]] = True
    return chosen


def checked(argument: str, predicate: Predicate, points: Array) -> Mask:
    """Where a predicate holds, (points,); refused if it does not say yes or no for each.

    The points are of shape (3, points).
    """
    try:
        answer = predicate(points)
    except Exception as error:
        raise ValueError(
            f"{argument}: the predicate fails on an array of points: {error}"
        ) from error
    validation.refuse_masked(argument, answer)
    mask = np.asarray(answer)
    if mask.dtype != np.bool_ or mask.shape != points.shape[1:]:
        raise ValueError(
            f"{argument}: the predicate must give True or False for each of {points.shape[1]} "
            f"points, but it gives an array of shape {mask.shape} of {mask.dtype}; write a "
            "comparison, as lambda x: x[0] < 0.01"
        )
    return mask


def _numbers_of(
    argument: str, selection: ArrayLike, kind: str, sizes: tuple[int, int]
) -> NDArray[np.int32]:
    """The given numbers, or those where a mask is true; the sizes are without and with ghosts."""
    validation.refuse_masked(argument, selection)
    array = np.asarray(selection)
    if array.shape == (0,):  # a rank may have none
        return array.astype(np.int32)
    if array.dtype == np.bool_ and array.ndim == 1:
        if array.size not in sizes:
            raise ValueError(
                f"{argument}: a mask must have one entry for each of the rank's {sizes[0]} {kind} "
                f"({sizes[1]} with ghosts), but it has {array.size}"
            )
        return np.flatnonzero(array).astype(np.int32)
    if array.dtype.kind not in "iu" or array.ndim != 1:
        raise TypeError(
            f"{argument} must be a predicate, numbers of {kind} or a mask over them, but it is "
            f"{validation.described(selection)}"
        )
    outside = array[(array < 0) | (array >= sizes[1])]
    if outside.size:
        raise ValueError(
            f"{argument}: {kind[:-1]} {outside[0]} does not exist; the rank has the {kind} 0 to "
            f"{sizes[1] - 1}"
        )
    return np.unique(array).astype(np.int32)


@dataclass(frozen=True)
class Interface:
    """Boundary facets that move as one rigid body.

    Attributes:
        name: How joints and frames refer to it.
        facets: Local facets on this rank, ghosts included.
        dofs: Local (blocked) dofs on this rank, ghosts included.
        center: (dimension,) reference point of the rigid motion [m], the same on every rank.
        extent: Diagonal of the box around its nodes [m], the same on every rank.
        axis: (3,) unit vector along the axis of a cylinder, or normal to a plane and out of the
            body; the same on every rank. None for other surfaces and in the plane.
    """

    name: str
    facets: NDArray[np.int32]
    dofs: NDArray[np.int32]
    center: Array
    extent: float
    axis: Array | None = None

    def center_rates(self, domain: mesh.Mesh, rates: Array) -> Array:
        """How its center, as it is found by default, moves with the nodes, (dimension, k).

        The nodes of the mesh ``domain`` on this rank move by ``rates`` (nodes, dimension, k).
        """
        comm, x, d = domain.comm, domain.geometry.x, rates.shape[1]
        speeds = np.abs(rates[facet_nodes(domain, self.facets).ravel()])
        fastest = np.max(comm.allgather(np.max(speeds, axis=(0, 1), initial=0.0)), axis=0)
        center_rates, positions = np.zeros(rates.shape[1:]), x.copy()
        try:
            for k in np.flatnonzero(fastest):
                step = REFERENCE.step * self.extent / fastest[k]
                for side in (1.0, -1.0):
                    x[:, :d] = positions[:, :d] + side * step * rates[:, :, k]
                    center_rates[:, k] += side * _surface(domain, self.facets)[0] / (2.0 * step)
        finally:
            x[:] = positions
        return center_rates


def find_interfaces(
    space: Any,
    interfaces: Mapping[str, Predicate | ArrayLike],
    centers: Mapping[str, Sequence[float]],
    box: Array,
) -> dict[str, Interface]:
    """The interfaces of a body by name, from predicates or facets."""
    if not interfaces:
        raise ValueError(
            "domain: no interfaces given; a body needs at least one rigid interface to be held by"
        )
    unknown = sorted(set(centers) - set(interfaces))
    if unknown:
        raise ValueError(
            f"domain: centers for unknown interfaces {unknown}; there are {sorted(interfaces)}"
        )
    by_name: dict[str, Interface] = {}
    for name, selection in interfaces.items():
        interface = _interface(space, name, selection, box)
        if name in centers:
            d = len(interface.center)
            expected = "two components" if d == 2 else "three components"
            argument = f"interface {name!r}: center"
            center = validation.real_array(argument, centers[name], (d,), expected=expected)
            interface = replace(interface, center=center.copy())
        _refuse_shared_nodes(space.mesh.comm, interface, by_name)
        by_name[name] = interface
    return by_name


def _interface(
    space: Any,
    name: str,
    selection: Predicate | ArrayLike,
    box: Array,
) -> Interface:
    """The interface of selected facets, with the center of its surface.

    The bounding ``box`` of the body, shape (2, dimension) [m], is for messages.
    """
    domain: mesh.Mesh = space.mesh
    comm, dim = domain.comm, domain.topology.dim
    facets = located(domain, f"interface {name!r}", selection, dim - 1)
    if comm.allreduce(len(facets)) == 0:
        spans = (
            f"{axis} from {low:.6g} to {high:.6g} m"
            for axis, low, high in zip("xyz", *box, strict=False)
        )
        raise ShapeError(
            f"interface {name!r} has no facets: its predicate or tag picks no boundary facet "
            f"of the body, which spans {' and '.join(spans)}"
        )

    dofs = np.asarray(fem.locate_dofs_topological(space, dim - 1, facets), dtype=np.int32)
    nodes = space.tabulate_dof_coordinates()[dofs, :dim]
    extent = float(np.linalg.norm(np.ptp(np.vstack(comm.allgather(nodes)), axis=0)))
    if not extent > 0.0:
        raise ShapeError(
            f"interface {name!r} is a single point: it cannot hold the body against rotation"
        )

    center, axis = _surface(domain, facets)
    return Interface(name, facets, dofs, center, extent, axis)


def _refuse_shared_nodes(
    comm: MPI.Comm, interface: Interface, earlier_ones: Mapping[str, Interface]
) -> None:
    """Refuse an interface that has nodes in common with earlier ones."""
    for name, earlier in earlier_ones.items():
        shared = np.intersect1d(interface.dofs, earlier.dofs)
        if comm.allreduce(bool(len(shared)), MPI.LOR):
            raise ShapeError(
                f"interfaces {name!r} and {interface.name!r} overlap: they share nodes, and a "
                "node cannot follow two rigid motions; leave at least one free facet between "
                "them or join them into one"
            )


def refuse_whole_edge(domain: mesh.Mesh, interfaces: Mapping[str, Interface]) -> None:
    """Refuse an interface that holds all facets on the boundary of a mesh.

    A file or a drawing of which all curves have one name says so without meaning it.
    """
    boundary = mesh.exterior_facet_indices(domain.topology)
    for name, interface in interfaces.items():
        free = np.setdiff1d(boundary, interface.facets)
        if domain.comm.allreduce(len(free)) == 0:
            raise ValueError(whole_edge(name))


def whole_edge(name: str) -> str:
    """The message about an interface that leaves nothing of a body free."""
    return (
        f"interface {name!r} holds the whole edge of the body, which cannot deform then; name a "
        "part of it: a layer or group of its own, a point in a bore (Bore), a box (Box), or a "
        "predicate"
    )


def _surface(domain: mesh.Mesh, facets: NDArray[np.int32]) -> tuple[Array, Array | None]:
    """Reference point of facets: of a circle, a cylinder or all; and the axis or the normal."""
    dim = domain.topology.dim
    points = facet_points(domain, facets)
    if dim == 2:
        circle = fit_circle(points)
        return (_moments(domain, facets)[1] if circle is None else circle), None
    return surface_reference(points, *_moments(domain, facets))


def surface_reference(
    points: Array, area: float, centroid: Array, normal: Array, spread: Array
) -> tuple[Array, Array | None]:
    """Reference point and axis, (3,), of a surface in space with some points (n, 3).

    By its area, its centroid (3,), and the integrals of its normal, (3,), and of n n^T, (3, 3).
    """
    length = float(np.linalg.norm(normal))
    if length > (1.0 - REFERENCE.flat) * area:
        return centroid, normal / length
    cylinder = fit_cylinder(points, np.asarray(np.linalg.eigh(spread)[1][:, 0]))
    return (centroid, None) if cylinder is None else cylinder


def _moments(domain: mesh.Mesh, facets: NDArray[np.int32]) -> tuple[float, Array, Array, Array]:
    """Size of facets, their centroid, and the integrals of the normal n and of n n^T."""
    dim = domain.topology.dim
    tags = mesh.meshtags(domain, dim - 1, np.sort(facets), np.ones(len(facets), dtype=np.int32))
    ds = ufl.Measure("ds", domain=domain, subdomain_data=tags)(1)
    x, n = ufl.SpatialCoordinate(domain), ufl.FacetNormal(domain)
    integrands = [1.0, *(x[i] for i in range(dim))]
    if dim == 3:
        integrands += [n[i] for i in range(dim)]
        integrands += [n[i] * n[j] for i in range(dim) for j in range(i, dim)]
    # one form for all of them: each would be compiled by itself
    weights = fem.Constant(domain, np.zeros(len(integrands)))
    form = fem.form(sum(weights[k] * integrand for k, integrand in enumerate(integrands)) * ds)
    moments = []
    for row in np.eye(len(integrands)):
        weights.value = row
        moments.append(domain.comm.allreduce(fem.assemble_scalar(form)))
    size, *moments = moments
    spread = np.zeros((dim, dim))
    if dim == 3:
        spread[np.triu_indices(3)] = moments[6:]
        spread = spread + np.triu(spread, 1).T
    return size, np.array(moments[:dim]) / size, np.array(moments[dim : 2 * dim]), spread


def nearest_circle(points: Array, accuracy: float) -> tuple[Array, float] | None:
    """Centre (2,) and radius of the circle of points (n, 2); None beyond an accuracy, in radii.

    The centre (a, b) and c = r^2 - a^2 - b^2 minimise sum (x^2 + y^2 - 2 a x - 2 b y - c)^2, a
    linear problem (I. Kasa, IEEE Transactions on Instrumentation and Measurement 25 (1976),
    doi:10.1109/TIM.1976.6312298), whose solution is exact for points on a circle.
    """
    middle = points.mean(axis=0)
    extent = float(np.max(np.linalg.norm(points - middle, axis=1)))
    if not extent > 0.0:
        return None
    s = (points - middle) / extent
    matrix = np.column_stack([2.0 * s, np.ones(len(s))])
    solution, _, rank, _ = np.linalg.lstsq(matrix, np.sum(s**2, axis=1), rcond=1e-9)
    radii = np.linalg.norm(s - solution[:2], axis=1)
    radius = float(radii.mean())
    if rank < 3 or np.max(np.abs(radii - radius)) > accuracy * radius:
        return None
    return np.asarray(middle + extent * solution[:2]), extent * radius


def fit_circle(points: Array) -> Array | None:
    """The centre (2,) of the circle of points (n, 2); None for fewer than five or under a sixth."""
    circle, offset = nearest_circle(points, REFERENCE.round), points - points.mean(axis=0)
    extent = float(np.max(np.linalg.norm(offset, axis=1)))
    # the chord of a sixth of the circle is as long as the radius; these points extend to its half
    if circle is None or circle[1] > 2.0 * (1.0 + REFERENCE.round) * extent:
        return None
    return (
        circle[0]
        if len(np.unique(np.round(offset / extent, 9), axis=0)) >= REFERENCE.fewest
        else None
    )


def fit_cylinder(points: Array, axis: Array) -> tuple[Array, Array] | None:
    """Middle and axis, (3,), of the cylinder of points (n, 3) near a guessed ``axis``, or None."""
    middle = points.mean(axis=0)
    extent = np.max(np.linalg.norm(points - middle, axis=1))
    if not extent > 0.0:
        return None
    s = np.unique(np.round((points - middle) / extent, 12), axis=0)
    across = np.linalg.svd(axis[None, :])[2][1:]  # two directions perpendicular to it

    def along(tilt: Array) -> Array:
        direction = axis + tilt @ across
        return np.asarray(direction / np.linalg.norm(direction))

    def distances(unknown: Array) -> Array:
        offset, direction = s - unknown[2:4] @ across, along(unknown[:2])
        radial = offset - np.outer(offset @ direction, direction)
        return np.asarray(np.linalg.norm(radial, axis=1) - unknown[4])

    circle = fit_circle(s @ across.T)
    center = s.mean(axis=0) @ across.T if circle is None else circle
    radius = np.mean(np.linalg.norm(s @ across.T - center, axis=1))
    start = np.array([0.0, 0.0, *center, radius])
    direction = along(least_squares(distances, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x[:2])
    plane = np.linalg.svd(direction[None, :])[2][1:]
    circle = fit_circle(s @ plane.T)
    if circle is None:
        return None
    height = s @ direction
    center = circle @ plane + 0.5 * (height.min() + height.max()) * direction
    return middle + extent * center, direction * np.sign(direction[np.argmax(np.abs(direction))])
