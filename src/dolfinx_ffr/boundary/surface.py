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
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import dctn, idctn
from scipy.ndimage import map_coordinates, spline_filter
from scipy.sparse import csc_matrix, csr_matrix, diags, eye, kron
from scipy.sparse.linalg import lsmr
from scipy.spatial import cKDTree

from .. import validation
from ..arrays import Array, Integers, Mask
from ..design import HoleRims, Mirror, images
from ..fem import Domain, ShapeError, Tetrahedra
from ..limits import PAIR, check_count
from ..parallel import agreed_memory, on_every_rank, on_rank_0
from ..part import PartWarning, Solid
from .derivative import NodeMotion
from .options import SURFACES, SurfaceOptions
from .sizes import Rows
from .step import best_step
from .walls import Field, Sides, Walls, contour
from .windows import pierced, promising

#: Step of central differences, in spacings of the grid: its error is near that of round-off
_DIFFERENCE = 1e-4


class _Points(NamedTuple):
    """Points of a solid's surface that move with the field."""

    numbers: Integers  #: Among the points of the surface, (n,)
    inward: Array  #: Unit normals into the material, (n, 3)
    ways: Array  #: By how much a point moves where the surface moves inwards by one, (n, 3)
    rows: csr_matrix  #: Its motion outwards by the variables of the field, (n, variables)


class Surface:
    """The boundary of a solid in space, with the coefficients of its field; made by `of`.

    Args:
        origin: The solid that it was made of.
        sides: Sides of the body, on rank 0.
        member: Width of the thinnest member [m].
        coefficients: B-spline coefficients on the grid, shape (nx, ny, nz) [m], equal on all ranks.
        low: First point of the grid, shape (3,) [m].
        spacing: Spacing of the grid, shape (3,) [m].
        mirrors: Planes about which the surface is its own mirror image.
        size: Size of the tetrahedra [m].
        rim: Width of the rim around each hole of the body's drawing [m].
        rims: The rims themselves, where another surface of the body has them; made by default.
        options: Numbers of the method.
    """

    normals: Array
    holes: tuple[()] = ()
    material = None

    def __init__(
        self,
        origin: Solid,
        sides: Sides | None,
        member: float,
        coefficients: Array,
        low: Array,
        spacing: Array,
        mirrors: Sequence[Mirror],
        size: float,
        rim: float,
        rims: HoleRims | None = None,
        options: SurfaceOptions = SURFACES,
    ) -> None:
        self.options = options
        #: The solid that it was made of
        self.origin, self._sides = origin, sides
        #: Width of the thinnest member [m]
        self.member = self.gap = member
        #: Of the B-spline on the grid, shape (nx, ny, nz) [m]
        self.coefficients = coefficients
        self._low, self._spacing, self.mirrors = low, spacing, tuple(mirrors)
        self._images = images(self.mirrors, 3)
        self.knots = 2.0 * spacing  #: Distances of the knots of the motion, (3,) [m]
        self.size = size  #: Of the tetrahedra [m]
        self.body: Domain = origin.body
        self.rim = rim  #: Width of the rim around each hole of the body's drawing [m]
        # collective, so that surfaces which rank 0 makes alone take those of the first
        self._rims = rims or HoleRims(self.body, max(rim, options.rim * member) if rim else 0.0)
        lines = [_refined(count) for count in coefficients.shape]
        self._counts = [line.shape[1] for line in lines]
        #: From motions to coefficients
        self._finer = csr_matrix(kron(kron(lines[0], lines[1]), lines[2]))
        self.n_controls = self._finer.shape[1]
        self.expansion = csr_matrix(eye(self.n_controls))
        self.fixed = np.zeros(self.n_controls, dtype=bool)
        self.normals = np.ones((self.n_controls, 1))

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
        knots = float(np.prod((high - low) / (options.spacing * member) + 4.0))
        with on_every_rank(body.comm, "surface"):
            check_count("surface", knots, "knots", "take a larger member [m]", each=64.0 * PAIR)
        counts = np.ceil((high - low) / (options.spacing * member) - 1e-9).astype(int)
        spacing = (high - low) / counts
        if size is None:
            size = _size(body, member, options)

        if size > options.coarse * member:
            warnings.warn(
                f"surface: tetrahedra of {size:.3g} m may miss members of {member:.3g} m; give a "
                f"member of {size / options.coarse:.3g} m or more, a smaller size, or smaller "
                "cells",
                PartWarning,
                stacklevel=2,
            )
        sides = Sides.of(body, options.sample * member, options)
        none = np.zeros(tuple(counts + 3))
        empty = Surface(
            solid, sides, member, none, low - spacing, spacing, planes, size, rim, None, options
        )

        def found() -> Surface:
            fitted = empty._fitted(lambda x: solid.field(np.clip(x, low, high)))
            return fitted._rounded()

        return empty._made(found)

    # ------------------------------------------------------------------ field

    def field(self, points: ArrayLike) -> Array:
        """The field at ``points`` (n, 3) [m], positive in material and rims, (n,) [m]."""
        x = np.asarray(points, dtype=np.float64)
        return np.maximum(self._moving_field(x), self._rims.margin(x))

    def _moving_field(self, x: Array) -> Array:
        """The field at points (n, 3) without the rims of holes, which stay, (n,) [m]."""
        total = np.zeros(len(x))
        for image in self._images:
            at = (image(x) - self._low) / self._spacing
            total += map_coordinates(
                self.coefficients, at.T, order=3, prefilter=False, mode="nearest"
            )
        return total / len(self._images)

    def _rows(self, x: Array) -> csr_matrix:
        """The field at points by the coefficients, (n, coefficients)."""
        shape = self.coefficients.shape
        parts = [_basis(i(x), self._low, self._spacing, shape) for i in self._images]
        return csr_matrix(sum(parts) / len(parts))

    def _slopes(self, x: Array) -> Array:
        """The gradient of the field at points, (n, 3)."""
        found = np.zeros((len(x), 3))
        for image in self._images:
            found += _gradients(image(x), self._low, self._spacing, self.coefficients) @ image.turn
        found /= len(self._images)
        if np.any(rims := self._in_rims(x)):
            steps = _DIFFERENCE * np.diag(self._spacing)
            margin = self._rims.margin
            change = [(margin(x[rims] + s) - margin(x[rims] - s)) / (2.0 * s.sum()) for s in steps]
            found[rims] = np.column_stack(change)
        return found

    def _in_rims(self, x: Array) -> Mask:
        """Whether a rim, and not what moves, decides on the material at points (n, 3), (n,)."""
        return np.asarray(self._rims.margin(x) > self._moving_field(x))

    # ------------------------------------------------------------------ solid

    @cached_property
    def part(self) -> Solid:
        """The enclosed solid."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PartWarning)  # said of the last one
            return Solid(self.body, self.field, material=self.origin.material, size=self.size)

    @cached_property
    def drawn(self) -> Solid:
        """The same solid, its surface cut out of smaller tetrahedra than its mesh."""
        most = min(
            self.options.most_drawn,
            int(agreed_memory(self.body.comm) / self.options.bytes_of_drawn),
        )
        size = min(self.size, Tetrahedra.finest(self.body, self.options.drawn * self.member, most))
        material = self.origin.material
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PartWarning)
            return Solid(self.body, self.field, material=material, size=self.size, surface=size)

    def moved(self, offsets: Array) -> Surface:
        """With changes ``offsets`` of the coefficients of motion (variables,) [m].

        Short waves become smaller, as meshes cannot show them. The field becomes a distance again
        where it no longer is one: each fit moves the surface a little, by more than a short step
        may cost.
        """

        def found() -> Surface:
            changed = self.shifted(offsets)._faired()
            assert self._sides is not None
            x, _ = self._sides.surface(changed.field, changed._slopes)
            steep = np.quantile(np.linalg.norm(changed._slopes(x), axis=1), self.options.quantiles)
            gentlest, steepest = self.options.steep
            if steep[0] < gentlest or steep[1] > steepest:
                changed = changed._fitted(changed.field)
            return changed

        return self._made(found)

    def pierced(self, places: Array, changes: Array) -> Iterator[tuple[Surface, int]]:
        """The same with windows that may lower psi, and how many.

        All that promise it, and fewer and fewer of them. ``changes`` (cells,) are those of log psi
        if the material of the cells at ``places`` (cells, 3) went.
        """
        images, walls = self._images, self.walls
        every = promising(walls, images, self.member, places, changes, self.options)
        count = len(every)
        while count:
            field = pierced(self.field, every[:count], images)
            yield self._made(partial(self._as, field)), count
            count //= 2

    def _made(self, make: Callable[[], Surface]) -> Surface:
        """What is made on rank 0, with thick walls, and sent to all ranks."""

        def found() -> tuple[Array, Walls]:
            thick = make()._thick()
            return thick.coefficients, thick.walls

        coefficients, walls = on_rank_0(self.body.comm, found)
        made = self._with(coefficients)
        made.walls = walls
        return made

    def _fitted(self, field: Field) -> Surface:
        """The surface of a field, which becomes a distance; on rank 0."""
        shape = self.coefficients.shape
        iterations = self.options.fit_iterations
        return self._with(_fitted(field, self._low, self._spacing, shape, iterations))

    def _rounded(self) -> Surface:
        """The same without slots, pockets and pinholes that are too narrow; on rank 0."""
        assert self._sides is not None
        return self._as(self._sides.rounded(self.field, self.gap))

    def _faired(self) -> Surface:
        """The same without waves that are too short for the mesh; on rank 0.

        The field is that which minimises its square distance from this one plus that of its
        Laplacian, so waves of six members hardly change.
        """
        waves = [
            2.0 * (1.0 - np.cos(np.pi * np.arange(count) / count)) / spacing**2
            for count, spacing in zip(self.coefficients.shape, self._spacing, strict=True)
        ]
        left = 1.0 / (1.0 + (self.options.fair * self.member) ** 4 * sum(np.ix_(*waves)) ** 2)
        return self._with(idctn(left * dctn(self.coefficients, norm="ortho"), norm="ortho"))

    def _thick(self) -> Surface:
        """The same without windows that are too narrow, with walls as thick as asked; on rank 0."""
        assert self._sides is not None
        member, options, found = self.member, self.options, self
        if closed := self._sides.closed(self.field, self.gap, options.ball * member):
            found = self._as(closed)
        walls, everywhere = found._walls(), True
        for _ in range(options.thickening):
            if not everywhere and walls.least > (1.0 - options.thin_share) * member:
                walls, everywhere = found._walls(), True
            if walls.least > (1.0 - options.thin_share) * member:
                break
            thin = walls.upto(options.thickened * member)
            if walls.least < options.thin * member:
                found = found._with_balls(thin.middles, options.ball)
            else:
                rows = found.rows(thin, options.thickened * member)
                still = np.zeros(self.n_controls)
                of_rows = rows.values, rows.slopes, self.fixed, member
                step = best_step(self.metric(member), still, *of_rows)
                found = found.shifted(step.offsets)
            walls, everywhere = found._walls(thin.middles), False
        found.walls = walls if everywhere else found._walls()
        return found

    def with_drawn_sizes(self) -> Surface:
        """The same without windows that end in points, and members as thick as asked.

        Between the points of the grid, and where a wall becomes a wedge, what is drawn is thinner
        than the walls of the field. The balls that are added grow, as the grid takes some of them.
        """
        found = self._blunted()
        thickest = 0.0, found
        for number in range(self.options.settling):
            thin = found.drawn.thinnest_member
            if thin is None or thin.value >= self.member:
                return found
            thickest = max(thickest, (thin.value, found), key=lambda each: each[0])
            middle = thin.ends.mean(axis=0, keepdims=True)
            centers = np.vstack([found.drawn.thinner(self.member), middle])
            centers = np.vstack([image(centers) for image in self._images])
            thickness = self.options.ball + self.options.grows * number
            found = self._made(partial(found._with_balls, centers, thickness))
        return thickest[1]

    def _blunted(self) -> Surface:
        """The same with windows that end as round as asked."""
        fields: list[Field] = []

        def found() -> bool:
            assert self._sides is not None
            ended = self._sides.blunted(self.field, self.gap)
            fields.extend([ended] if ended else [])
            return bool(fields)

        if not on_rank_0(self.body.comm, found):
            return self
        return self._made(lambda: self._as(fields[0]))

    def _with_balls(self, centers: Array, thickness: float) -> Surface:
        """With balls as thick as so many members at centres (n, 3) [m]; on rank 0."""
        assert self._sides is not None
        return self._as(self._sides.thickened(self.field, centers, thickness * self.member))

    def _as(self, field: Field) -> Surface:
        """With the values of a field, which differs in places, at the points of the grid."""
        nodes = self._low + self._spacing * np.indices(self.coefficients.shape).reshape(3, -1).T
        more = (field(nodes) - self.field(nodes)).reshape(self.coefficients.shape)
        return self._with(self.coefficients + spline_filter(more, mode="mirror"))

    @cached_property
    def walls(self) -> Walls:
        """Members up to 1.5 times the minimum."""
        return on_rank_0(self.body.comm, self._walls)

    def _walls(self, near: Array | None = None) -> Walls:
        """The same, or those near some places (n, 3) [m] only; on rank 0."""
        assert self._sides is not None
        least = self.options.oversize * self.member
        return self._sides.walls(self.field, self._slopes, least, self.options.seen * least, near)

    def rows(self, walls: Walls, least: float | None = None) -> Rows:
        """1 - d / d_min for the thinnest of walls, one in each cell of the grid of the motion.

        By default the ``least`` thickness [m] is a little more than the member.

        The thickness d is the diameter of a ball that touches both sides. It grows as these move
        outwards; where their normals are not opposite, the ball also moves along the wall.
        """
        # of each cell the thinnest wall, found from either side: one without a row would become
        # thinner for nothing
        cell = np.floor((walls.middles - self.body.bounding_box[0]) / self.knots + 1e-9)
        first = np.sort(np.unique(cell.astype(int), axis=0, return_index=True)[1])
        cosine = np.einsum("nd,nd->n", walls.inward[first], walls.across[first])
        there = diags(1.0 * walls.moving[first]) @ self.outwards(walls.ends[first])
        there = there - diags(cosine) @ self.outwards(walls.points[first])
        least = least or self.options.oversize * self.member
        slopes = diags(-2.0 / (1.0 - cosine) / least) @ there
        values = 1.0 - walls.thickness[first] / least
        minima = np.full(len(first), least)
        return Rows(values, csr_matrix(slopes), minima, self.options.oversize)

    def finer(self) -> Surface:
        """The same, to be cut out of the next finer lattice; ValueError if that is too fine."""
        size = self.part.sizes(None, 2)[1]
        if 6.0 * self.part.volume > self.options.most_tetrahedra * size**3:
            raise ShapeError(
                "surface: the next finer lattice exceeds the number of points that is allowed"
            )
        return self._with(self.coefficients, size)

    def shifted(self, offsets: Array) -> Surface:
        """The surface moved by ``offsets`` as in `moved`, before thin walls are thickened."""
        change = (self._finer @ offsets).reshape(self.coefficients.shape)
        return self._with(self.coefficients + change)

    def offsets_to(self, other: Surface) -> Array:
        """Offsets of a motion that come nearest to ``other``, a surface, (variables,) [m]."""
        change = (other.coefficients - self.coefficients).ravel()
        return np.asarray(lsmr(self._finer, change, maxiter=self.options.fit_iterations)[0])

    def _with(self, coefficients: Array, size: float | None = None) -> Surface:
        own = self.origin, self._sides, self.member, coefficients, self._low, self._spacing
        size = size or self.size
        return Surface(*own, self.mirrors, size, self.rim, self._rims, self.options)

    def state(self) -> dict[str, Array]:
        """What has changed since `of`, as arrays by name."""
        return {"coefficients": self.coefficients}

    def restored(self, state: Mapping[str, Array]) -> Surface:
        """The surface with that `state`, which this one had come to."""
        return self._with(state["coefficients"])

    def metric(self, length: float) -> csc_matrix:
        """The matrix of motions that are smooth over a ``length`` [m], (variables, variables)."""
        lines = []
        for count, spacing in zip(self._counts, self._spacing, strict=True):
            steps = np.diff(np.eye(count), axis=0)
            lines.append(csr_matrix((length / (2.0 * spacing)) ** 2 * steps.T @ steps))
        one = [eye(count) for count in self._counts]
        found = eye(self.n_controls)
        found = found + kron(kron(lines[0], one[1]), one[2])
        found = found + kron(kron(one[0], lines[1]), one[2])
        return csc_matrix(found + kron(kron(one[0], one[1]), lines[2]))

    @cached_property
    def moving(self) -> _Points:
        """The points of the solid's surface that move with the field."""
        x, triangles = self.part.points, self.part.triangles
        slope, level = self._slopes(x), self.field(x)
        steep = np.linalg.norm(slope, axis=1)
        inward = slope / np.maximum(steep, 1e-300)[:, None]
        a, b, c = np.moveaxis(x[triangles], 1, 0)
        normal = np.cross(b - a, c - a)
        edge = np.sqrt(np.linalg.norm(normal, axis=1))
        normal /= np.maximum(edge**2, 1e-300)[:, None]
        away = np.abs(level) / np.maximum(steep, 1e-300)
        free = np.max(away[triangles], axis=1) < self.options.from_zero * edge
        free &= -np.einsum("td,td->t", normal, inward[triangles].mean(axis=1)) > self.options.along
        chosen = np.zeros(len(x), dtype=bool)
        chosen[triangles[free]] = True
        near = np.full(len(x), np.inf)
        np.minimum.at(near, triangles.ravel(), np.repeat(edge, 3))
        chosen &= away < self.options.corner_from_zero * near
        # along the planes of the outline on which it lies
        planes = np.zeros((len(x), 3, 3))
        fixed = ~free
        square = np.einsum("ti,tj->tij", normal[fixed], normal[fixed])
        np.add.at(planes, triangles[fixed], square[:, None])
        numbers = np.flatnonzero(chosen)
        sizes, axes = np.linalg.eigh(planes[numbers])
        total = np.maximum(np.sum(sizes, axis=1, keepdims=True), 1e-300)
        loose = np.where(sizes > self.options.plane_share * total, 0.0, 1.0)
        n = inward[numbers]
        along = np.einsum("pik,pk,pjk,pj->pi", axes, loose, axes, n)
        share = np.einsum("pi,pi->p", along, n)
        ways = np.where(share[:, None] > 0.1, along / np.maximum(share, 0.1)[:, None], 0.0)
        return _Points(numbers, n, ways, self.outwards(x[numbers]))

    def outwards(self, x: Array) -> csr_matrix:
        """How points ``x`` (n, 3) of the surface move along its normal, (n, variables)."""
        steep = np.linalg.norm(self._slopes(x), axis=1, keepdims=True)
        steep[self._in_rims(x)] = np.inf
        return csr_matrix(self._rows(x).multiply(1.0 / steep).tocsr() @ self._finer)


def _size(body: Domain, member: float, options: SurfaceOptions) -> float:
    """The size of tetrahedra [m] that is fine enough for psi and walls, if it is not too dear."""
    size = Tetrahedra.finest(body, 0.0, options.tetrahedra)
    return (
        size
        if size <= options.small * member
        else Tetrahedra.finest(body, options.small * member, options.more_tetrahedra)
    )


def _along(
    x: Array, low: Array, spacing: Array, shape: Sequence[int]
) -> tuple[list[Array], list[Array], list[Integers]]:
    """B-splines at points along each axis: values, derivatives, and numbers, (n, 4) each."""
    at = (x - low) / spacing
    values, slopes, places = [], [], []
    for k, count in enumerate(shape):
        first = np.floor(at[:, k])
        t = at[:, k] - first
        s = 1.0 - t
        own = [s**3, 4.0 - 6.0 * t**2 + 3.0 * t**3, 4.0 - 6.0 * s**2 + 3.0 * s**3, t**3]
        values.append(np.stack(own, axis=1) / 6.0)
        own = [-0.5 * s**2, 1.5 * t**2 - 2.0 * t, 0.5 + t - 1.5 * t**2, 0.5 * t**2]
        slopes.append(np.stack(own, axis=1) / spacing[k])
        place = first[:, None].astype(np.int64) + np.arange(-1, 3)
        places.append(np.clip(place, 0, count - 1))  # as `map_coordinates` does
    return values, slopes, places


def _basis(x: Array, low: Array, spacing: Array, shape: Sequence[int]) -> csr_matrix:
    """Values of the tensor-product B-splines at points, (n, product of shape)."""
    weights, _, (i, j, k) = _along(x, low, spacing, shape)
    values = np.einsum("ni,nj,nk->nijk", *weights).reshape(len(x), 64)
    columns = (i[:, :, None, None] * shape[1] + j[:, None, :, None]) * shape[2] + k[:, None, None]
    rows = np.repeat(np.arange(len(x)), 64)
    size = len(x), int(np.prod(shape))
    return csr_matrix((values.ravel(), (rows, columns.ravel())), shape=size)


def _gradients(x: Array, low: Array, spacing: Array, c: Array) -> Array:
    """Derivatives of the splines with coefficients c at points, (n, 3)."""
    (u, v, w), (du, dv, dw), (i, j, k) = _along(x, low, spacing, c.shape)
    near = c[i[:, :, None, None], j[:, None, :, None], k[:, None, None]]
    of_z, of_w = (np.einsum("nijk,nk->nij", near, part) for part in (w, dw))
    parts = (of_z, v, du), (of_z, dv, u), (of_w, v, u)
    found = [np.einsum("nij,nj,ni->n", *part, optimize=True) for part in parts]
    return np.stack(found, axis=1)


def _refined(count: int) -> csr_matrix:
    """From B-splines on every second knot of a line to those on all, (count, about half)."""
    coarse = (count - 1) // 2 + 2  # from the one before the first knot to the one after the last
    table = np.zeros((count, coarse + 1))
    for j in range(coarse + 1):
        for step, weight in zip(range(-2, 3), (1.0, 4.0, 6.0, 4.0, 1.0), strict=True):
            i = 2 * (j - 1) + step + 1
            if 0 <= i < count:
                table[i, j] += weight / 8.0
    return csr_matrix(table[:, np.any(table, axis=0)])


def _fitted(
    field: Field, low: Array, spacing: Array, shape: Sequence[int], iterations: int
) -> Array:
    """Coefficients of the spline that has a field's zero surface and is near the distance."""
    nodes = low + spacing * np.indices(shape).reshape(3, -1).T
    points = contour(field, low, nodes[-1], 0.5 * spacing)
    if not len(points):
        raise ShapeError("surface: the field has no zero surface to move")
    # off the contour of linear pieces the first-order distance is exact on the field's zero surface
    step = 1e-4 * spacing
    slope = [(field(points + s) - field(points - s)) / (2.0 * s.sum()) for s in np.diag(step)]
    steep = np.maximum(np.linalg.norm(slope, axis=0), 1e-300)
    target = np.clip(field(points) / steep, -spacing.min(), spacing.min())
    normal = (slope / steep).T
    _, near = cKDTree(points).query(nodes)
    way = nodes - (points - target[:, None] * normal)[near]
    length, along = np.linalg.norm(way, axis=1), np.einsum("nd,nd->n", way, normal[near])
    # from the plane at the nearest point, but for nodes beyond an edge of the surface
    beside = np.sqrt(np.maximum(length**2 - along**2, 0.0)) < 0.5 * spacing.min()
    distance = np.where(beside, np.abs(along), length)
    distance *= np.where(field(nodes) > 0.0, 1.0, -1.0)
    rows = _basis(np.vstack([nodes, points]), low, spacing, shape)
    right = np.concatenate([distance, target])
    coefficients = lsmr(rows, right, x0=distance, maxiter=iterations, atol=1e-8, btol=1e-8)[0]
    return np.asarray(coefficients.reshape(tuple(shape)))


class SurfaceMotion(NodeMotion[Surface]):
    """Nodes that follow the field of a surface: (controls, 1) of a `pullback`."""

    def _prepare(self, boundary: Surface, x: Array, cells: Integers) -> None:
        self._points = boundary.moving
        away, self._node = cKDTree(x).query(boundary.part.points[self._points.numbers])
        assert np.max(away, initial=0.0) < 1e-9 * boundary.member

    def _back(self, bar: Array) -> Array:
        inwards = np.einsum("pd,pd->p", bar[self._node], self._points.ways)
        return np.asarray(-(self._points.rows.T @ inwards)[:, None])
