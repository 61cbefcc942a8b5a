# SPDX-License-Identifier: MIT
"""A level set of normalised radial basis functions, from an open gray to a sharp boundary.

One field on knots X_j, which know nothing of the mesh, with coefficients u_j in [0, 1]:

    f(X) = sum_j g(|X - X_j|) u_j / sum_j g(|X - X_j|),     0 <= f <= 1.

The body's material is where f > 1/2. The density of an element is the mean of a projection over its
area,

    x_e = sum_q w_q H(f(X_q)),   H(f) = [tanh(beta/2) + tanh(beta (f - 1/2))] / [2 tanh(beta/2)].

At beta = 1 this is a filtered density: all of the body is gray, and there are derivatives
everywhere. At beta = 32 the projection steps from void to solid within a fifth of an element, and
x_e is the share of the element that the boundary f = 1/2 encloses. The derivative with respect to
the coefficients is exact at each beta. Coefficients are replicated: every rank holds all of them,
bit-identical.

**Minimum size.** Where f is flat it must be far enough from 1/2, or a member (a gap) is thinner
than wanted. With E = exp(-c |R grad f|^2), which is one where f is flat, the penalty is

    g = sum_e V_e/V E { H min(0, f - eta_s)^2 + 0.2 (1 - H) max(0, f - eta_v)^2 }.

The thresholds eta_s > 1/2 and eta_v < 1/2 belong to the thinnest member and the narrowest gap: in
the middle of a strip of coefficients 1, on which f > 1/2 over the minimum width, f is eta_s.

References:
    C. S. Andreasen, M. O. Elingaard and N. Aage, Structural and Multidisciplinary Optimization 62
    (2020), doi:10.1007/s00158-020-02527-1 (level sets by the ingredients of density methods).
    M. Zhou, B. S. Lazarov, F. Wang and O. Sigmund, Computer Methods in Applied Mechanics and
    Engineering 293 (2015), doi:10.1016/j.cma.2015.05.003 (minimum size by geometric constraints).
    P. Wei, Z. Li, X. Li and M. Y. Wang, Structural and Multidisciplinary Optimization 58 (2018),
    doi:10.1007/s00158-018-1904-8 (level sets of radial basis functions).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import contourpy
import numpy as np
import shapely
from numpy.typing import ArrayLike
from scipy.sparse import csr_matrix, diags
from scipy.spatial import cKDTree

from .. import validation
from ..arrays import Integers, Mask
from ..fem import Array, Domain, summed
from ..limits import PAIR, check_count
from ..parallel import ROUND_OFF, on_every_rank
from .base import SHARP, Design, checked_web, finite_vector, steepness
from .densities import HeavisideProjection, check_neighbours
from .mirrors import Mirror, Symmetry, images
from .rbf import Wendland, kernel_matrix, neighbours, strip_middle, strip_width
from .rims import HoleRims


@dataclass(frozen=True)
class LevelSetOptions:
    """Sizes of the kernel, and the penalty that asks for minimum sizes."""

    #: Shortest radius of the kernel in mean elements; one of 2.75 costs 1 % of psi
    shortest_radius: float = 2.25
    #: Radius of the kernel in distances of knots
    knots_in_radius: float = 2.75
    #: f in the middle of the thinnest member or the narrowest gap, see `strip_width`
    middle: float = 0.6
    #: c of the penalty: it must see the flanks of a strip, as the middle alone is flat
    decay: float = 0.93
    #: Factor of the penalty beside log psi: with less than half of it struts thin out, four times
    #: as much costs 2 % of psi
    weight: float = 100.0
    #: Factor of the weight at the end, where a strut must become thick enough or vanish
    late: float = 2.0
    #: Least share that one minimum size may be of the other
    least_share: float = 0.25
    #: Weight of gaps relative to members, as a gap too narrow costs less than a broken strut
    gap: float = 0.2
    #: Progress at which the penalty sets in, has its weight, and has its weight at the end; the
    #: topology is found before
    progress: tuple[float, float, float] = (0.4, 0.5, 0.75)
    #: Size for which the penalty asks over the minimum size, as it allows a fifth less
    safety: float = 1.3
    #: Contrast with which moving asymptotes begin: the slope of SIMP is zero in void elements, in
    #: which nothing would ever grow
    contrast: float = 0.25
    #: f on the boundary of the eroded design
    eroded: float = 0.54
    #: Progress from which on psi of the eroded design counts, so that no member hangs by a bridge
    #: of elements
    eroded_progress: float = 0.7
    #: Distance from its boundary over which a start goes from 1/2 to 0 or 1 [mean elements]
    start_width: float = 3.0
    #: Number of points at which the field is evaluated at a time, which bounds the memory
    batch: int = 200_000
    #: Bound of the round-off of f: an even gray of 1/2 has no boundary
    round_off: float = 1e-12


OPTIONS = LevelSetOptions()


class LevelSet(Design):
    """A level set on knots over a body, and the fill fraction of the body's elements.

    Args:
        domain: The body.
        minimum_member: Width that no member may fall below [m]. By default the smallest that the
            elements resolve, 0.64 mean elements, and at least a quarter of `minimum_gap`. On the
            elements a penalty asks for it, or for the smallest that they resolve if that is larger;
            in steps of the boundary it is a bound. The thinnest member of the finished part is
            `Part.thinnest_member`.
        minimum_gap: Width that no gap or hole may fall below [m]; by default `minimum_member`, or
            if neither is given the smallest that the elements resolve.
        hole_rim: Width of the rim that stays solid around each hole of the body's drawing, with a
            name or without [m]; by default `minimum_member`, 0 for none. With a `web` there is such
            a rim along the outline, too.
        web: Thickness of the web that stays where material is milled away, as a share of the
            part's thickness: pockets, from both sides to the same depth, take the place of holes.
            Then `minimum_gap` is the least width of a pocket, and half of it the least radius of
            its corners, the radius of the cutter. With 0, the default, holes are cut.
        mirrors: Lines, in space planes, about which the design is its own mirror image, exactly, on
            any mesh; see `mirror_lines` and `mirror_planes`.
        spacing: Distance of the grid's knots [m]; by default the kernel's radius / 2.75. The radius
            is 3.5 times the larger of the two sizes.
        quadrature: Points in each direction of an element, by default four, in space three.

    Raises:
        ValueError: If a size is not positive, one is less than a quarter of the other, a mirror is
            none of the body, or the knots are fewer than three across the body or do not cover it.
    """

    each: ClassVar[str] = "knot"
    fills: ClassVar[bool] = True

    def __init__(
        self,
        domain: Domain,
        *,
        minimum_member: float | None = None,
        minimum_gap: float | None = None,
        hole_rim: float | None = None,
        web: float = 0.0,
        mirrors: Sequence[Mirror] = (),
        spacing: float | None = None,
        quadrature: int | None = None,
    ) -> None:
        self.domain = validation.instance("level set: domain", domain, Domain, "a Domain")
        self.element = domain.cell_size  #: Size of a mean element [m]
        d = domain.dimension
        points_across = 4 if d == 2 else 3
        if quadrature is not None:
            points_across = validation.integer("level set: quadrature", quadrature, least=1)
        #: Width of the thinnest member and of the narrowest gap [m]
        self.minimum_member, self.minimum_gap = self._sizes(minimum_member, minimum_gap)
        #: Whether one of them was given, and does not follow from the mesh
        self.sizes_asked = minimum_member is not None or minimum_gap is not None
        width = self.minimum_member if hole_rim is None else hole_rim
        self.web = checked_web("level set", domain, web, width)
        self._rims = HoleRims(domain, width, outline=self.web > 0.0)
        #: Width of the solid rim around each hole of the body's drawing [m]
        self.hole_rim = self._rims.width
        # sizes that the elements do not resolve are left to the steps of the boundary
        sizes = np.maximum((self.minimum_member, self.minimum_gap), self._least)
        member, gap = OPTIONS.safety * sizes
        self.radius = max(member, gap) / strip_width(OPTIONS.middle, d)  #: Of the kernel [m]
        #: Thresholds of f where it is flat: eta_s of members, eta_v of gaps
        self._solid = strip_middle(member / self.radius, d)
        self._void = 1.0 - strip_middle(gap / self.radius, d)
        self.mirrors = self._checked_mirrors(mirrors)
        self._images = images(self.mirrors, d)
        self.kernel = Wendland(self.radius)
        grid = self._grid_of_knots(spacing)
        low, high = domain.bounding_box
        mean_distance = float(np.prod(high - low) / len(grid)) ** (1.0 / d)
        counts_of_pairs = domain.n_cells_global * float(points_across) ** d, len(grid)
        remedy = "take a larger spacing [m] or a smaller quadrature"
        ranks = domain.comm.size  # share the points
        check_neighbours(
            domain, "level set", counts_of_pairs, self.radius / mean_distance, remedy, ranks
        )
        points, self._weights = domain.quadrature_points(points_across)
        self._in_rims = self._rims.contain(points)
        points = points.reshape(-1, d)
        # knots that no element depends on are no variables
        tree = cKDTree(grid)
        self._check_cover(points, tree)
        reached = np.unique(kernel_matrix(self.kernel, points, tree).indices)
        is_reached = np.zeros(len(grid), dtype=bool)
        is_reached[np.concatenate(domain.comm.allgather(reached))] = True
        #: Positions of the knots, shape (knots, dimension) [m]
        self.knots = grid[is_reached]
        self._tree = cKDTree(self.knots)
        self.size = len(self.knots)
        self._matrix = self._means(points)
        self._origin = self  #: Copies of other attributes have the same knots
        self.sharpness = SHARP  #: Steepness beta of the projection
        self.threshold = 0.5  #: f at which it steps from void to solid
        self.weight = (
            OPTIONS.weight * OPTIONS.late
        )  #: Of the penalty of sizes below the minimum ones

    def _checked_mirrors(self, mirrors: Sequence[Mirror]) -> tuple[Mirror, ...]:
        """The mirrors, or a ValueError for one in which the body is not its own image."""
        d = self.domain.dimension
        name = "mirror line" if d == 2 else "mirror plane"
        checked = validation.instances(
            "level set: mirrors", mirrors, Mirror, f"{name}s of the body"
        )
        symmetry = Symmetry(self.domain) if checked else None
        for mirror in checked:
            if len(mirror.normal) != d or (symmetry and symmetry.reason(mirror)):
                raise ValueError(
                    f"level set: {mirror} is no {name} of the body or of its solid regions; "
                    f"{name.replace(' ', '_')}s(domain) lists the symmetries of a body"
                )
        return tuple(checked)

    def _grid_of_knots(self, spacing: float | None) -> Array:
        """The points of a regular grid over the body's bounding box, shape (knots, dimension)."""
        distance = self.radius / OPTIONS.knots_in_radius
        if spacing is not None:
            distance = validation.number("level set: spacing", spacing, above=0.0, unit="m")
        low, high = self.domain.bounding_box
        # halves are rounded up, whatever the order in which the ranks add up the area
        counts = np.floor((high - low) / distance + 0.5 + ROUND_OFF).astype(int) + 1
        if counts.min() < 3:
            argument = "spacing" if spacing is not None else "minimum_member or minimum_gap"
            extents = " x ".join(f"{extent:.4g} m" for extent in high - low)
            raise ValueError(
                f"level set: {argument} is too large for the body of {extents}, as knots "
                f"{distance:.4g} m apart leave fewer than 3 across it; take a smaller {argument}, "
                "in metres"
            )
        count = math.prod(map(float, counts))
        with on_every_rank(self.domain.comm, "level set"):
            check_count("level set", count, "knots", "take a larger spacing [m]", each=PAIR)
        lines = _lines(self.domain, counts)
        #: Distance of neighbouring knots of the grid [m]
        self.spacing = float(max(line[1] - line[0] for line in lines))
        return _grid(lines)

    def _sizes(self, member: float | None, gap: float | None) -> tuple[float, float]:
        """Both minimum sizes; a ValueError for sizes that one kernel cannot resolve."""
        arguments = {"minimum_member": member, "minimum_gap": gap}
        given_sizes = {name: value for name, value in arguments.items() if value is not None}
        for name, value in given_sizes.items():
            validation.number(f"level set: {name}", value, above=0.0, unit="m")
        # one kernel resolves both sizes: a size that is not given follows the other one
        smallest = max(self._least, OPTIONS.least_share * given_sizes.get("minimum_gap", 0.0))
        least_member = given_sizes.get("minimum_member", smallest)
        follows = given_sizes.get("minimum_member", self._least)
        sizes = least_member, given_sizes.get("minimum_gap", follows)
        if min(sizes) < OPTIONS.least_share * max(*sizes, self._least):
            raise ValueError(
                f"level set: minimum_member and minimum_gap, {sizes[0]:.4g} m and {sizes[1]:.4g} m,"
                f" may differ from each other, and from the {self._least:.4g} m that the elements "
                "resolve, by a factor of four at most; raise the smaller one, or take smaller "
                "elements"
            )
        return sizes

    @property
    def _least(self) -> float:
        """The smallest size that the elements resolve [m]."""
        return (
            OPTIONS.shortest_radius
            * self.element
            * strip_width(OPTIONS.middle, self.domain.dimension)
            / OPTIONS.safety
        )

    # ------------------------------------------------------------------ field

    def _means(self, points: Array) -> csr_matrix:
        """The matrix that takes coefficients to f at points, averaged over the mirror images."""
        total = 0.0
        for image in self._images:
            g = kernel_matrix(self.kernel, image(points), self._tree)
            sums = np.asarray(g.sum(axis=1)).ravel()
            # beyond the reach of all knots, far outside of the body, f is 0
            total = total + diags(1.0 / np.where(sums > 0.0, sums, 1.0)) @ g
        return csr_matrix(total / len(self._images))

    def _slopes(self, points: Array) -> tuple[csr_matrix, ...]:
        """The matrices that take coefficients to the derivatives of f at points, one by direction.

        Each is (points, coefficients). The weights of the coefficients are kernels g over their
        sum at the point; so the quotient rule subtracts the weight times the sum's derivative.
        """
        total: list[Any] = [0.0] * points.shape[1]
        for image in self._images:
            x = image(points)
            g = kernel_matrix(self.kernel, x, self._tree).tocoo()
            sums = np.bincount(g.row, weights=g.data, minlength=len(x))

            # of the kernel by the point
            offset = x[g.row] - self.knots[g.col]
            s = np.linalg.norm(offset, axis=1) / self.radius
            slope = (-20.0 / self.radius**2 * (1.0 - s) ** 3)[:, None] * offset

            values = np.empty_like(slope)
            for k, component in enumerate(slope.T):
                mean = np.bincount(g.row, weights=component, minlength=len(x)) / sums
                values[:, k] = (component - g.data * mean[g.row]) / sums[g.row]
            values = values @ image.turn  # back from the image
            for k in range(len(total)):
                total[k] = total[k] + csr_matrix((values[:, k], (g.row, g.col)), shape=g.shape)
        return tuple(csr_matrix(matrix / len(self._images)) for matrix in total)

    def _check_cover(self, points: Array, knots: cKDTree) -> None:
        """Refuse a grid of knots with points of the body beyond the reach of all of them."""
        bare = np.isinf(knots.query(points, distance_upper_bound=self.radius)[0])
        missing = np.any(bare.reshape(len(self._weights), -1), axis=1)
        share = self.domain.sum(missing * self.domain.cell_volumes) / self.domain.area
        if share:
            raise ValueError(
                f"level set: {100.0 * share:.2g} % of the body is beyond the reach of all "
                "knots; take a smaller spacing, or ask for a larger minimum size"
            )

    def level(self, variables: ArrayLike) -> Callable[[ArrayLike], Array]:
        """F - 1/2 by coefficients ``variables`` (knots,), positive in the material and its rims.

        A function of positions (n, dimension) [m] that each rank may call for its own points.
        """
        return self._rims.added_to(self._field(self._check(variables)))

    def _field(self, u: Array) -> Callable[[ArrayLike], Array]:
        """F - 1/2 by coefficients, without the rims."""

        def value_at(points: ArrayLike) -> Array:
            x = np.asarray(points, dtype=np.float64).reshape(-1, self.domain.dimension)
            values = []
            for chunk in np.array_split(x, len(x) // OPTIONS.batch + 1):
                total = sum(self._mean(image(chunk), u) for image in self._images)
                values.append(np.asarray(total / len(self._images)) - 0.5)
            return np.concatenate(values)

        return value_at

    def _mean(self, points: Array, u: Array) -> Array:
        """F at points of one mirror image, without the matrix of `_means`."""
        pairs = neighbours(points, self._tree, self.kernel.support)
        weights = self.kernel(pairs["v"])
        sums = np.bincount(pairs["i"], weights, len(points))
        values = np.bincount(pairs["i"], weights * u[pairs["j"]], len(points))
        return np.asarray(values / np.where(sums > 0.0, sums, 1.0))

    # ------------------------------------------------------------------ density

    @property
    def projection(self) -> HeavisideProjection:
        """The projection from f to material."""
        return HeavisideProjection(self.sharpness, self.threshold)

    @property
    def nominal(self) -> LevelSet:
        """The nominal level set: its material is where f > 1/2."""
        return self._with(threshold=0.5)

    @property
    def eroded(self) -> LevelSet:
        """The eroded level set: its material lies a little within the nominal boundary.

        Optimised for its psi, no member is as thin as the mesh bridges (robust design; F. Wang,
        B. S. Lazarov and O. Sigmund, doi:10.1007/s00158-010-0602-y).
        """
        return self._with(threshold=OPTIONS.eroded)

    def _with(self, **changed: float) -> LevelSet:
        """The same level set with other attributes, or itself if they do not differ."""
        if all(getattr(self, name) == value for name, value in changed.items()):
            return self
        changed_copy = copy(self)
        vars(changed_copy).update(changed)
        return changed_copy

    def at(self, progress: float) -> LevelSet:
        """The design at a ``progress``: its sharpness and penalty, near the end `eroded`."""
        design = self.with_sharpness(steepness(progress))
        begin, full, end = OPTIONS.progress
        late = OPTIONS.late ** min(max((progress - full) / (end - full), 0.0), 1.0)
        ramp = min(max((progress - begin) / (full - begin), 0.0), 1.0)
        design = design._with(weight=OPTIONS.weight * ramp * late)
        return design.eroded if progress >= OPTIONS.eroded_progress else design

    def with_sharpness(self, sharpness: float) -> LevelSet:
        """The same level set with another steepness ``sharpness`` of its projection."""
        value = validation.number("level set: sharpness", sharpness, above=0.0)
        return self._with(sharpness=value)

    def density(self, variables: ArrayLike) -> Array:
        """The density of each cell owned by this rank, shape (cells,), in [0, 1].

        ValueError if there is not one finite coefficient a knot in ``variables``.
        """
        f = self._at_points(variables)
        x = np.einsum("cq,cq->c", self._weights, self.projection(f))
        # the mean of values in [0, 1] may leave it by round-off
        x = self.with_web(np.clip(x, 0.0, 1.0))
        return np.where(self.domain.design_cells, x, self.domain.passive_density)

    def pullback(self, variables: ArrayLike, x_bar: Array) -> Array:
        thickness_bar = np.where(self.domain.design_cells, x_bar, 0.0)
        bar = (1.0 - self.web) * thickness_bar[:, None] * self._weights
        f_bar = self.projection.pullback(self._at_points(variables), bar)
        f_bar[self._in_rims] = 0.0
        return summed(self.domain.comm, self._matrix.T @ f_bar.ravel())

    def _at_points(self, variables: ArrayLike) -> Array:
        f = np.asarray(self._matrix @ self._check(variables)).reshape(self._weights.shape)
        return np.where(self._in_rims, 1.0, f)

    def _check(self, variables: ArrayLike) -> Array:
        return finite_vector(variables, self.size, "level set", "coefficients, one a knot")

    # ------------------------------------------------------------------ minimum size

    @cached_property
    def _at_centroids(self) -> tuple[csr_matrix, ...]:
        points = self.domain.centroids
        return self._means(points), *self._slopes(points)

    @cached_property
    def _sized_cells(self) -> Mask:
        """Whether a cell of this rank is designed and not in a rim, shape (cells,)."""
        return self.domain.design_cells & ~self._rims.contain(self.domain.centroids)

    def penalty(self, variables: ArrayLike) -> tuple[float, Array]:
        """The penalty of members and gaps below their minimum sizes, beside log psi.

        Value and derivative by the coefficients ``variables``, shape (knots,), on every rank.
        """
        weight = self.weight
        if weight == 0.0:
            return 0.0, np.zeros(self.size)
        u = self._check(variables)
        mean, *slopes = self._origin._at_centroids
        f, *gradient = (np.asarray(matrix @ u) for matrix in (mean, *slopes))
        share = self.domain.cell_volumes / self.domain.area * self._origin._sized_cells
        project = HeavisideProjection(max(self.sharpness, 8.0))
        decay = OPTIONS.decay * self.radius**2
        flat = share * np.exp(-decay * sum(slope * slope for slope in gradient))
        material = project(f)
        thin = np.minimum(0.0, f - self._solid)
        narrow = np.maximum(0.0, f - self._void)
        violation = material * thin**2 + OPTIONS.gap * (1.0 - material) * narrow**2
        value = weight * self.domain.sum(flat * violation)
        f_bar = weight * flat * 2.0 * (material * thin + OPTIONS.gap * (1.0 - material) * narrow)
        f_bar += project.pullback(f, weight * flat * (thin**2 - OPTIONS.gap * narrow**2))
        slope_bar = -2.0 * decay * weight * flat * violation
        local = mean.T @ f_bar
        for matrix, slope in zip(slopes, gradient, strict=True):
            local = local + matrix.T @ (slope_bar * slope)
        return value, summed(self.domain.comm, local)

    # ------------------------------------------------------------------ starts

    def from_distance(self, distance: ArrayLike | Callable[[Array], Array]) -> Array:
        """Coefficients whose boundary is the zero line of a signed ``distance``.

        It is positive in the material, and given at the knots, shape (knots,) [m], or as a function
        of positions (n, dimension) [m]. Coefficients (knots,) are 1 or 0 from three mean elements
        off the boundary on. ValueError if there is not one finite value a knot.
        """
        distances = distance(self.knots) if callable(distance) else distance
        d = finite_vector(distances, self.size, "level set", "distances, one a knot")
        return 0.5 + 0.5 * np.clip(d / (OPTIONS.start_width * self.element), -1.0, 1.0)

    def with_holes(
        self, columns: int, rows: int, radius: float, *, margin: float | None = None
    ) -> Array:
        """A start design: solid with staggered round holes, mirror-symmetric about the axis.

        In space they go through the body along its shortest side.

        Args:
            columns: Number of holes along the longer side of the body's bounding box.
            rows: Number of holes across.
            radius: Radius of the holes [m]; zero leaves the body solid.
            margin: Distance of the outermost rows' centers from the longer sides [m]; by default
                half the distance between rows.

        Returns:
            Coefficients, shape (knots,), see `from_distance`.
        """
        columns = validation.integer("level set: columns of holes", columns, least=1)
        rows = validation.integer("level set: rows of holes", rows, least=1)
        validation.number("level set: radius of holes", radius, least=0.0, unit="m")
        if margin is not None:
            validation.number("level set: margin", margin, unit="m")
        low, high = self.domain.bounding_box
        long, side = np.argsort(low - high, kind="stable")[:2]
        length, height = (high - low)[long], (high - low)[side]
        edge = height / (2 * rows) if margin is None else margin
        across = np.linspace(edge, height - edge, rows) if rows > 1 else np.array([height / 2])
        pitch = length / columns
        # staggered, and symmetric about the middle row
        shift = [0.5 * (min(row, rows - 1 - row) % 2) for row in range(rows)]
        along = np.arange(-1, columns + 1) + 0.5 + np.array(shift)[:, None]
        centers = np.stack(np.broadcast_arrays(along * pitch, across[:, None]), axis=-1)
        centers = centers.reshape(-1, 2) + low[[long, side]]
        across_holes = self.knots[:, [long, side]]
        return self.from_distance(cKDTree(centers).query(across_holes)[0] - radius)

    def begin(self, start: ArrayLike) -> Array:
        """A ``start`` with a quarter of its contrast, so that there are derivatives everywhere."""
        return 0.5 + OPTIONS.contrast * (self.check(start) - 0.5)

    # ------------------------------------------------------------------ boundary

    @cached_property
    def _contour_grid(self) -> tuple[list[Array], csr_matrix]:
        """The lines of a grid of half elements over the body, and the matrix to f on this grid."""
        sizes = np.ptp(self.domain.bounding_box, axis=0)
        lines = _lines(self.domain, np.ceil(sizes / (0.5 * self.element)).astype(int) + 1)
        return lines, self._means(_grid(lines))

    def distance(self, variables: ArrayLike, points: ArrayLike | None = None) -> Array:
        """The signed distance from the boundary f = 1/2, positive in the material.

        The boundary is the contour of f, linear between the points of a grid of half elements. Not
        collective: each rank may ask for its own points.

        Args:
            variables: Coefficients, shape (knots,).
            points: Positions, shape (n, dimension) [m]; by default the centroids of its cells.

        Returns:
            Shape (n,) [m]; infinite, with the sign of f - 1/2, where there is no boundary.
        """
        u = self._check(variables)
        x = np.asarray(self.domain.centroids if points is None else points, dtype=np.float64)
        d = self.domain.dimension
        if x.ndim != 2 or x.shape[1] != d or not np.all(np.isfinite(x)):
            raise ValueError(
                f"level set: points in an array of shape {x.shape} must be finite coordinates of "
                f"shape (n, {d})"
            )
        sign = np.where(self._field(u)(x) >= -OPTIONS.round_off, 1.0, -1.0)
        grid, matrix = self._contour_grid
        values = np.asarray(matrix @ u).reshape([len(line) for line in grid])
        return sign * _distance_from_contour(x, grid, values, 0.5 - OPTIONS.round_off)

    def identity(self) -> dict[str, Any]:
        return {
            "knots": self.knots,
            "radius": self.radius,
            "sizes": [self.minimum_member, self.minimum_gap, self.hole_rim, self.web],
            # as one array, since some numbers are zero but for round-off
            "mirrors": np.array([[*m.point, *m.normal] for m in self.mirrors]),
            "cells": self.domain.n_cells_global,
        }


def _lines(domain: Domain, counts: Integers) -> list[Array]:
    """As many coordinates along each axis over the box of a body."""
    return [np.linspace(*ends) for ends in zip(*domain.bounding_box, counts, strict=True)]


def _grid(lines: Sequence[Array]) -> Array:
    """The points of a regular grid, shape (points, dimension)."""
    return np.column_stack([x.ravel() for x in np.meshgrid(*lines, indexing="ij")])


def _distance_from_contour(
    points: Array, grid: Sequence[Array], values: Array, level: float
) -> Array:
    """The distance of points (n, d) from a contour, (n,) [m], infinity where there is none.

    The contour at ``level`` is that of the field with ``values`` on a ``grid``, whose coordinates
    are given along each axis.
    """
    if len(grid) == 3:
        return _distance_in_space(points, grid, values, level)
    lines = contourpy.contour_generator(grid[0], grid[1], values.T).lines(level)
    lines = [line for line in lines if len(line) > 1]
    if not lines or len(points) == 0:
        return np.full(len(points), math.inf)
    contour = shapely.MultiLineString(lines)
    shapely.prepare(contour)
    return np.asarray(shapely.distance(contour, shapely.points(points)))


def _distance_in_space(points: Array, grid: Sequence[Array], values: Array, level: float) -> Array:
    """The distance of points (n, 3) from a contour in space, as `_distance_from_contour`."""
    import pyvista  # takes a while

    origin = tuple(line[0] for line in grid)
    spacing = tuple(line[1] - line[0] for line in grid)
    image = pyvista.ImageData(dimensions=values.shape, origin=origin, spacing=spacing)
    surface = image.contour([level], scalars=values.ravel(order="F"))
    if not surface.n_cells or len(points) == 0:
        return np.full(len(points), math.inf)
    _, nearest = surface.find_closest_cell(points, return_closest_point=True)
    return np.linalg.norm(points - nearest, axis=1)
