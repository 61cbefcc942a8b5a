# SPDX-License-Identifier: MIT
"""The boundary of a solid as a field on a grid, which moves where the field changes.

The field phi is a uniform tensor-product cubic B-spline, positive in the material, and close to the
distance from its zero surface. Each step cuts the body's tetrahedra anew (`Solid`), so no mesh is
repaired, and parts of the surface may meet. A change of the field moves the surface along its
normal n by the change over the slope, so the derivative by the nodes gives that by the field.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import dctn, idctn
from scipy.sparse import csc_matrix, csr_matrix, diags
from scipy.sparse.linalg import lsmr
from scipy.spatial import cKDTree

from .. import validation
from ..arrays import Array, Integers, Mask
from ..design import HoleRims, Isometry, Mirror, images
from ..fem import Domain, ShapeError, Tetrahedra
from ..limits import PAIR, check_count
from ..parallel import agreed_memory, on_every_rank, on_rank_0
from ..part import PartWarning, Solid
from .derivative import NodeMotion
from .fields import Field
from .options import SURFACES, SurfaceOptions
from .sizes import Rows
from .splines import DIFFERENCE, SplineGrid
from .step import best_step
from .walls import Sides, Walls
from .windows import promising, with_openings


class MovingPoints(NamedTuple):
    """Points of a solid's surface that move with the field."""

    numbers: Integers  #: Among the points of the surface, (n,)
    inward: Array  #: Unit normals into the material, (n, 3)
    motions: Array  #: Motion of a point where the surface moves inwards by one, (n, 3)
    rows: csr_matrix  #: Its motion outwards by the offsets, (n, offsets)


@dataclass(eq=False)
class Surface:
    """The boundary of a solid in space; made by `of`.

    Its *offsets* are changes of the coefficients of coarser splines, by which the surface moves
    outwards [m].

    Attributes:
        origin: The solid whose boundary this is.
        member: Width of the thinnest member, and of the narrowest gap [m].
        grid: Grid of the splines of the field.
        coefficients: Coefficients of the field [m], of the shape of the grid, equal on all ranks.
        mirrors: Planes about which the surface is its own mirror image.
        size: Size of the tetrahedra [m].
        rim: Width of the rim around each hole of the body's drawing [m].
        rims: The rims of all holes.
        sides: Sides of the body, on rank 0; None elsewhere.
        options: Numbers of the method.
    """

    origin: Solid
    member: float
    grid: SplineGrid
    coefficients: Array
    mirrors: tuple[Mirror, ...]
    size: float
    rim: float
    rims: HoleRims
    sides: Sides | None
    options: SurfaceOptions

    @staticmethod
    def of(
        solid: Solid,
        member: float,
        *,
        rim: float | None = None,
        mirrors: Sequence[Mirror] = (),
        size: float | None = None,
        options: SurfaceOptions = SURFACES,
    ) -> Surface:
        """The boundary of a ``solid``.

        Args:
            solid: A solid of any field.
            member: Width of the thinnest member [m]; it sets the grid of the field, too.
            rim: Width of the rim of material around each hole of the body's drawing [m]; by default
                as the member, 0 for none. Others are at least a member wide.
            mirrors: Planes about which the surface is its own mirror image.
            size: Of the tetrahedra [m], see `Solid`; by default as small as the cells of the body
                allow with 30,000 of them for all of it, or with 250,000 where fewer are larger than
                0.8 members.
            options: Numbers of the method.

        Raises:
            ValueError: If a number is out of range, the member is thicker than the body, the grid
                is too fine, or no surface lies within the body.

        Warns:
            PartWarning: If the tetrahedra are too coarse for the member.
        """
        validation.instance("surface: solid", solid, Solid, "a Solid")
        validation.number("surface: member", member, above=0.0, unit="m")
        rim = validation.number("surface: rim", member if rim is None else rim, least=0.0, unit="m")
        planes = validation.instances("surface: mirrors", mirrors, Mirror, "planes of the body")
        if any(len(mirror.normal) != 3 for mirror in planes):
            raise ValueError(
                "surface: mirrors of a body in space are planes; give normals of three components"
            )
        body = solid.body
        low, high = body.bounding_box
        if member > np.min(high - low):
            raise ValueError(
                f"surface: a member of {member:.4g} m is thicker than the body, which is "
                f"{np.min(high - low):.4g} m; give a smaller one"
            )
        grid = _grid(body, options.spacing * member)
        if size is None:
            size = _default_size(body, member, options)
        if size > options.coarse * member:
            warnings.warn(
                f"surface: tetrahedra of {size:.3g} m may miss members of {member:.3g} m; give a "
                f"member of {size / options.coarse:.3g} m or more, a smaller size, or smaller "
                "cells",
                PartWarning,
                stacklevel=2,
            )
        # collective, so that surfaces which rank 0 makes alone take these
        rims = HoleRims(body, max(rim, options.rim * member) if rim else 0.0)
        empty = Surface(
            origin=solid,
            member=member,
            grid=grid,
            coefficients=np.zeros(grid.shape),
            mirrors=tuple(planes),
            size=size,
            rim=rim,
            rims=rims,
            sides=Sides.of(body, options.sample * member, options),
            options=options,
        )

        def smooth() -> Surface:
            return empty._fitted(lambda x: solid.field(np.clip(x, low, high)))._rounded()

        return empty._agreed(smooth)

    @property
    def body(self) -> Domain:
        """The body that was designed."""
        return self.origin.body

    @property
    def _body_sides(self) -> Sides:
        """The sides of the body; on rank 0."""
        assert self.sides is not None
        return self.sides

    # ------------------------------------------------------------------ field

    @cached_property
    def _images(self) -> list[Isometry]:
        return images(self.mirrors, 3)

    def field(self, points: ArrayLike) -> Array:
        """The field at ``points`` (n, 3) [m], positive in material and rims, (n,) [m]."""
        x = np.asarray(points, dtype=np.float64)
        return np.maximum(self._moving_field(x), self.rims.margin(x))

    def _moving_field(self, x: Array) -> Array:
        """The field at points (n, 3) without the rims of holes, which stay, (n,) [m]."""
        total = np.zeros(len(x))
        for image in self._images:
            total += self.grid.values(self.coefficients, image(x))
        return total / len(self._images)

    def _field_rows(self, x: Array) -> csr_matrix:
        """The field at points by the coefficients, (n, coefficients)."""
        rows = [self.grid.basis(image(x)) for image in self._images]
        return csr_matrix(sum(rows) / len(rows))

    def _slopes(self, x: Array) -> Array:
        """The gradient of the field at points, (n, 3)."""
        slopes = np.zeros((len(x), 3))
        for image in self._images:
            slopes += self.grid.gradients(self.coefficients, image(x)) @ image.turn
        slopes /= len(self._images)
        in_rims = self._in_rims(x)
        if np.any(in_rims):
            margin, of_rims = self.rims.margin, x[in_rims]
            steps = DIFFERENCE * np.diag(self.grid.spacing)
            slopes[in_rims] = np.column_stack(
                [(margin(of_rims + s) - margin(of_rims - s)) / (2.0 * s.sum()) for s in steps]
            )
        return slopes

    def _in_rims(self, x: Array) -> Mask:
        """Whether a rim, and not what moves, decides on the material at points (n, 3), (n,)."""
        return np.asarray(self.rims.margin(x) > self._moving_field(x))

    # ------------------------------------------------------------------ solid

    @cached_property
    def part(self) -> Solid:
        """The enclosed solid."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PartWarning)  # the last solid of all warns
            return Solid(self.body, self.field, material=self.origin.material, size=self.size)

    @cached_property
    def drawn(self) -> Solid:
        """The same solid, its surface cut out of smaller tetrahedra than its mesh."""
        affordable = int(agreed_memory(self.body.comm) / self.options.bytes_of_drawn)
        most_tetrahedra = min(self.options.most_drawn, affordable)
        finest = Tetrahedra.finest(self.body, self.options.drawn * self.member, most_tetrahedra)
        material, surface = self.origin.material, min(self.size, finest)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PartWarning)
            return Solid(self.body, self.field, material=material, size=self.size, surface=surface)

    def finer(self) -> Surface:
        """The same, to be cut out of the next finer lattice; a ShapeError if that is too fine."""
        size = self.part.sizes(None, 2)[1]
        if 6.0 * self.part.volume > self.options.most_tetrahedra * size**3:
            raise ShapeError(
                "surface: the next finer lattice exceeds the number of points that is allowed"
            )
        return replace(self, size=size)

    # ------------------------------------------------------------------ motion

    @property
    def n_offsets(self) -> int:
        """Number of independent offsets."""
        return int(self.grid.refinement.shape[1])

    @property
    def fixed_offsets(self) -> Mask:
        """Whether an offset stays zero, which none does, (offsets,)."""
        return np.zeros(self.n_offsets, dtype=bool)

    def metric(self, length: float) -> csc_matrix:
        """The matrix of motions that are smooth over a ``length`` [m], (offsets, offsets)."""
        return self.grid.coarse_metric(length)

    def shifted(self, offsets: Array) -> Surface:
        """The surface moved by ``offsets`` as in `moved`, before thin walls are thickened."""
        change = (self.grid.refinement @ offsets).reshape(self.grid.shape)
        return replace(self, coefficients=self.coefficients + change)

    def moved(self, offsets: Array) -> Surface:
        """The surface moved by ``offsets`` (offsets,) [m].

        Short waves become smaller, as meshes cannot show them. The field becomes a distance again
        where it no longer is one: each fit moves the surface a little, by more than a short step
        may cost.
        """

        def faired() -> Surface:
            surface = self.shifted(offsets)._faired()
            points, _ = self._body_sides.surface(surface.field, surface._slopes)
            slope_lengths = np.linalg.norm(surface._slopes(points), axis=1)
            gentle, steep = np.quantile(slope_lengths, self.options.quantiles)
            gentlest, steepest = self.options.slope_range
            is_distance = gentle >= gentlest and steep <= steepest
            return surface if is_distance else surface._fitted(surface.field)

        return self._agreed(faired)

    def offsets_to(self, other: Surface) -> Array:
        """Offsets of a motion that come nearest to ``other``, a surface, (offsets,) [m]."""
        change = (other.coefficients - self.coefficients).ravel()
        iterations = self.options.fit_iterations
        return np.asarray(lsmr(self.grid.refinement, change, maxiter=iterations)[0])

    def outwards(self, x: Array) -> csr_matrix:
        """How points ``x`` (n, 3) of the surface move along its normal, (n, offsets)."""
        slope_lengths = np.linalg.norm(self._slopes(x), axis=1, keepdims=True)
        slope_lengths[self._in_rims(x)] = np.inf
        scaled = self._field_rows(x).multiply(1.0 / slope_lengths).tocsr()
        return csr_matrix(scaled @ self.grid.refinement)

    @cached_property
    def moving(self) -> MovingPoints:
        """The points of the solid's surface that move with the field."""
        points, triangles = self.part.points, self.part.triangles
        slopes = self._slopes(points)
        slope_lengths = np.maximum(np.linalg.norm(slopes, axis=1), 1e-300)
        inward = slopes / slope_lengths[:, None]
        distance = np.abs(self.field(points)) / slope_lengths

        a, b, c = np.moveaxis(points[triangles], 1, 0)
        normals = np.cross(b - a, c - a)
        edges = np.sqrt(np.linalg.norm(normals, axis=1))
        normals /= np.maximum(edges**2, 1e-300)[:, None]

        # triangles of the zero surface
        is_near = np.max(distance[triangles], axis=1) < self.options.from_zero * edges
        cosine = -np.einsum("td,td->t", normals, inward[triangles].mean(axis=1))
        moves = is_near & (cosine > self.options.along)
        # their corners, but for those off the zero surface
        is_corner = np.zeros(len(points), dtype=bool)
        is_corner[triangles[moves]] = True
        shortest_edge = np.full(len(points), np.inf)
        np.minimum.at(shortest_edge, triangles.ravel(), np.repeat(edges, 3))
        is_on_zero = distance < self.options.corner_from_zero * shortest_edge
        numbers = np.flatnonzero(is_corner & is_on_zero)

        # squares of the normals of the outline at each point
        planes = np.zeros((len(points), 3, 3))
        squares = np.einsum("ti,tj->tij", normals[~moves], normals[~moves])
        np.add.at(planes, triangles[~moves], squares[:, None])
        motions = self._within_planes(inward[numbers], planes[numbers])
        return MovingPoints(numbers, inward[numbers], motions, self.outwards(points[numbers]))

    def _within_planes(self, normals: Array, planes: Array) -> Array:
        """Motions (n, 3) in planes by which points move by one along their ``normals`` (n, 3).

        The ``planes`` are sums of the squares of their normals at each point, (n, 3, 3).
        """
        eigenvalues, axes = np.linalg.eigh(planes)
        total = np.maximum(np.sum(eigenvalues, axis=1, keepdims=True), 1e-300)
        is_free = np.where(eigenvalues > self.options.plane_share * total, 0.0, 1.0)
        projected = np.einsum("pik,pk,pjk,pj->pi", axes, is_free, axes, normals)
        share = np.einsum("pi,pi->p", projected, normals)
        scaled = projected / np.maximum(share, 0.1)[:, None]
        return np.where(share[:, None] > 0.1, scaled, 0.0)

    # ------------------------------------------------------------------ other fields

    def _agreed(self, make: Callable[[], Surface]) -> Surface:
        """A surface that is made on rank 0, with thick walls, and sent to all ranks."""

        def thick() -> tuple[Array, Walls]:
            surface = make()._thick()
            return surface.coefficients, surface.walls

        coefficients, walls = on_rank_0(self.body.comm, thick)
        surface = replace(self, coefficients=coefficients)
        surface.walls = walls
        return surface

    def _fitted(self, field: Field) -> Surface:
        """The surface of a field, which becomes a distance; on rank 0."""
        coefficients = self.grid.fitted(field, self.options.fit_iterations)
        return replace(self, coefficients=coefficients)

    def _with_values_of(self, field: Field) -> Surface:
        """The surface with the values of a ``field``, which differs in places, at all nodes."""
        nodes = self.grid.nodes
        change = self.grid.interpolated(field(nodes) - self.field(nodes))
        return replace(self, coefficients=self.coefficients + change)

    def _rounded(self) -> Surface:
        """The surface without slots, pockets and pinholes that are too narrow; on rank 0."""
        return self._with_values_of(self._body_sides.rounded(self.field, self.member))

    def _faired(self) -> Surface:
        """The surface without waves that are too short for the mesh; on rank 0.

        The field is that which minimises its square distance from this one plus that of its
        Laplacian, so waves of six members hardly change.
        """
        laplacians = [
            2.0 * (1.0 - np.cos(np.pi * np.arange(count) / count)) / spacing**2
            for count, spacing in zip(self.grid.shape, self.grid.spacing, strict=True)
        ]
        penalty = (self.options.fair * self.member) ** 4 * sum(np.ix_(*laplacians)) ** 2
        smooth = 1.0 / (1.0 + penalty) * dctn(self.coefficients, norm="ortho")
        return replace(self, coefficients=idctn(smooth, norm="ortho"))

    def with_windows(self, places: Array, changes: Array) -> Iterator[tuple[Surface, int]]:
        """Surfaces with windows that may lower psi, and the number of windows in each.

        The first has all promising windows, each further one half as many. ``changes`` (cells,)
        are the changes of log psi if the material of the cells at ``places`` (cells, 3) were
        removed.
        """
        windows = promising(self.walls, self._images, self.member, places, changes, self.options)
        count = len(windows)
        while count:
            field = with_openings(self.field, windows[:count], self._images)
            yield self._agreed(partial(self._with_values_of, field)), count
            count //= 2

    def _with_balls(self, centers: Array, thickness: float) -> Surface:
        """With balls as thick as so many members at centres (n, 3) [m]; on rank 0."""
        thickened = self._body_sides.thickened(self.field, centers, thickness * self.member)
        return self._with_values_of(thickened)

    # ------------------------------------------------------------------ walls

    @cached_property
    def walls(self) -> Walls:
        """Members up to 1.5 times the minimum."""
        return on_rank_0(self.body.comm, self._walls)

    def _walls(self, near: Array | None = None) -> Walls:
        """The walls, or those near some places (n, 3) [m] only; on rank 0."""
        least = self.options.oversize * self.member
        widest = self.options.constrained * least
        return self._body_sides.walls(self.field, self._slopes, least, widest, near)

    def rows(self, walls: Walls, least: float | None = None) -> Rows:
        """1 - d / d_min for the thinnest of walls, one in each cell of the grid of the motion.

        By default the ``least`` thickness [m] is a little more than the member.

        The thickness d is the diameter of a ball that touches both sides. It grows as these move
        outwards; where their normals are not opposite, the ball also moves along the wall.
        """
        least = least or self.options.oversize * self.member
        # of each cell the thinnest wall, found from either side: one without a row would become
        # thinner for nothing
        knots = 2.0 * self.grid.spacing
        cell = np.floor((walls.middles - self.body.bounding_box[0]) / knots + 1e-9)
        thinnest = np.sort(np.unique(cell.astype(int), axis=0, return_index=True)[1])

        cosine = np.einsum("nd,nd->n", walls.inward[thinnest], walls.across[thinnest])
        end_motion = diags(1.0 * walls.moving[thinnest]) @ self.outwards(walls.ends[thinnest])
        point_motion = diags(cosine) @ self.outwards(walls.points[thinnest])
        slopes = diags(-2.0 / (1.0 - cosine) / least) @ (end_motion - point_motion)
        values = 1.0 - walls.thickness[thinnest] / least
        minima = np.full(len(thinnest), least)
        return Rows(values, csr_matrix(slopes), minima, self.options.oversize)

    def _thick(self) -> Surface:
        """The surface with windows as wide and walls as thick as asked; on rank 0."""
        member, options = self.member, self.options
        least = (1.0 - options.thin_share) * member
        closed = self._body_sides.closed(self.field, member, options.ball * member)
        surface = self._with_values_of(closed) if closed else self

        walls, are_all = surface._walls(), True
        for _ in range(options.thickening):
            if not are_all and walls.least > least:
                walls, are_all = surface._walls(), True
            if walls.least > least:
                break
            thin = walls.upto(options.thickened * member)
            if walls.least < options.thin * member:
                surface = surface._with_balls(thin.middles, options.ball)
            else:
                surface = surface._with_thicker(thin, options.thickened * member)
            # elsewhere they are as before
            walls, are_all = surface._walls(thin.middles), False
        surface.walls = walls if are_all else surface._walls()
        return surface

    def _with_thicker(self, walls: Walls, thickness: float) -> Surface:
        """The surface moved by as little as makes some walls as thick as asked [m]."""
        rows = self.rows(walls, thickness)
        no_gradient = np.zeros(self.n_offsets)
        constraints = rows.values, rows.slopes, self.fixed_offsets
        step = best_step(self.metric(self.member), no_gradient, *constraints, self.member)
        return self.shifted(step.offsets)

    def with_drawn_sizes(self) -> Surface:
        """The surface without windows that end in points, and members as thick as asked.

        Between the points of the grid, and where a wall becomes a wedge, what is drawn is thinner
        than the walls of the field. The balls that are added grow, as the grid takes some of them.
        """
        surface = self._blunted()
        best, best_thickness = surface, 0.0
        for number in range(self.options.settling):
            thinnest = surface.drawn.thinnest_member
            if thinnest is None or thinnest.value >= self.member:
                return surface
            if thinnest.value > best_thickness:
                best, best_thickness = surface, thinnest.value
            middle = thinnest.ends.mean(axis=0, keepdims=True)
            centers = np.vstack([surface.drawn.thinner(self.member), middle])
            centers = np.vstack([image(centers) for image in self._images])
            thickness = self.options.ball + self.options.grows * number
            surface = self._agreed(partial(surface._with_balls, centers, thickness))
        return best

    def _blunted(self) -> Surface:
        """The surface with windows that end as round as asked."""
        fields: list[Field] = []

        def has_pointed_windows() -> bool:
            blunted = self._body_sides.blunted(self.field, self.member)
            fields.extend([blunted] if blunted else [])
            return bool(fields)

        if not on_rank_0(self.body.comm, has_pointed_windows):
            return self
        return self._agreed(lambda: self._with_values_of(fields[0]))

    # ------------------------------------------------------------------ in a checkpoint

    def state(self) -> dict[str, Array]:
        """What has changed since `of`, as arrays by name."""
        return {"coefficients": self.coefficients}

    def restored(self, state: Mapping[str, Array]) -> Surface:
        """The surface with that `state`, which this one had come to."""
        return replace(self, coefficients=state["coefficients"])


def _grid(body: Domain, spacing: float) -> SplineGrid:
    """The grid of at most a ``spacing`` [m] over a body; an error if it is too fine."""
    low, high = body.bounding_box
    n_knots = float(np.prod((high - low) / spacing + 4.0))
    with on_every_rank(body.comm, "surface"):
        check_count("surface", n_knots, "knots", "take a larger member [m]", each=64.0 * PAIR)
    counts = np.ceil((high - low) / spacing - 1e-9).astype(int)
    actual_spacing = (high - low) / counts
    n_x, n_y, n_z = (int(count) + 3 for count in counts)
    return SplineGrid(low - actual_spacing, actual_spacing, (n_x, n_y, n_z))


def _default_size(body: Domain, member: float, options: SurfaceOptions) -> float:
    """The size of tetrahedra [m] that is fine enough for psi and walls, if it is not too dear."""
    size = Tetrahedra.finest(body, 0.0, options.tetrahedra)
    if size <= options.small * member:
        return size
    return Tetrahedra.finest(body, options.small * member, options.more_tetrahedra)


class SurfaceMotion(NodeMotion[Surface]):
    """Nodes that follow the field of a surface."""

    def _prepare(self, boundary: Surface, x: Array, cells: Integers) -> None:
        self._points = boundary.moving
        surface_points = boundary.part.points[self._points.numbers]
        distance, self._nodes = cKDTree(x).query(surface_points)
        assert np.max(distance, initial=0.0) < 1e-9 * boundary.member

    def _back(self, node_gradient: Array) -> Array:
        inwards = np.einsum("pd,pd->p", node_gradient[self._nodes], self._points.motions)
        return np.asarray(-(self._points.rows.T @ inwards))
