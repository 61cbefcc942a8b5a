# SPDX-License-Identifier: MIT
"""What there is to be drawn of a mechanism in space at chosen instants, and its view."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from ..body import BodyMarker
from ..dynamics import Trajectory
from ..fem import GatheredMesh, fit_circle, surface_of
from ..mechanism import Line, Marker, Mechanism, Moving, Slider, Spring, Symbol
from ..problem import Evaluation, Problem
from .mechanism_view import VOID
from .rendering import Rendering
from .style import DARK, GRAY, LIGHT

__all__ = ["BodyInSpace", "SceneInSpace", "ViewOfSpace"]

Array = NDArray[np.float64]

_STEEL = "#57606a"


@dataclass(frozen=True, eq=False)
class BodyInSpace:
    """One body at the chosen instants.

    Its deformation is magnified about the undeformed body laid through the joints, which stay where
    they are.
    """

    name: str  #: Name of the body
    mesh: GatheredMesh | None  #: None for a body given by its integrals alone
    reference: Array  #: (points, 3) undeformed points in the body's frame [m]
    shapes: Array  #: (points, 3, r) their shape functions
    markers: Mapping[str, BodyMarker]  #: Markers in the body's frame
    held: Sequence[str]  #: Markers at which joints sit
    position: Array  #: (instants, 3) of the frame [m]
    rotation: Array  #: (instants, 3, 3) of the frame
    elastic: Array  #: (instants, r) elastic coordinates
    density: Array  #: (cells,) density of the cells
    energy: Array  #: (instants, cells) strain energy density [J/m^3]; no columns if not asked for

    def points(self, instant: int, magnification: float = 1.0) -> Array:
        """Where the points are drawn, shape (points, 3) [m]."""
        displacement = self.shapes @ self.elastic[instant]
        return self._moved(self.reference, displacement, instant, magnification)

    def marker(self, name: str, instant: int, magnification: float = 1.0) -> Array:
        """Where a marker is drawn, shape (3,) [m]."""
        marker = self.markers[name]
        displacement = (marker.displacement @ self.elastic[instant])[None]
        return self._moved(marker.position[None], displacement, instant, magnification)[0]

    def axes(self, name: str, instant: int) -> Array:
        """The axes of a marker, its columns, shape (3, 3)."""
        turned = Rotation.from_rotvec(self.markers[name].rotation @ self.elastic[instant])
        return np.asarray(self.rotation[instant] @ turned.as_matrix())

    def deflection(self, instant: int) -> float:
        """The largest distance of a point from the undeformed body [m]."""
        away = self.shapes @ self.elastic[instant] + self.reference
        away = away - self._undeformed(self.reference, instant)
        return float(np.max(np.linalg.norm(away, axis=1), initial=0.0))

    def _undeformed(self, reference: Array, instant: int) -> Array:
        """Lay points of the undeformed body through the joints, in the body's frame."""
        held = [self.markers[name] for name in self.held]
        if not held:
            return reference
        q = self.elastic[instant]
        before = np.array([marker.position for marker in held])
        after = before + np.array([marker.displacement @ q for marker in held])
        middle, target = before.mean(axis=0), after.mean(axis=0)
        if len(held) == 1:
            turn = Rotation.from_rotvec(held[0].rotation @ q)
            return np.asarray(turn.apply(reference - middle) + target)
        # two joints stay where they are by the smallest turn of the line between them
        a, b = before[-1] - before[0], after[-1] - after[0]
        across = np.cross(a, b)
        sine = float(np.linalg.norm(across))
        angle = np.arctan2(sine, float(a @ b))
        turn = Rotation.from_rotvec(across * (angle / sine if sine > 0.0 else 0.0))
        stretch = np.linalg.norm(b) / (np.linalg.norm(a) or 1.0)
        return np.asarray(stretch * turn.apply(reference - middle) + target)

    def _moved(
        self, reference: Array, displacement: Array, instant: int, magnification: float
    ) -> Array:
        base = self._undeformed(reference, instant)
        local = base + magnification * (reference + displacement - base)
        return np.asarray(self.position[instant] + local @ self.rotation[instant].T)


@dataclass(frozen=True, eq=False)
class SceneInSpace:
    """The parts of a mechanism at chosen instants; meshes and fields are on rank 0 only."""

    mechanism: Mechanism  #: Joints and point masses
    trajectory: Trajectory  #: The whole motion
    steps: NDArray[np.int64]  #: (instants,) time steps drawn
    times: Array  #: (instants,) their times [s]
    bodies: dict[str, BodyInSpace]  #: By name

    @staticmethod
    def gather(
        problem: Problem,
        mechanism: Mechanism,
        evaluation: Evaluation,
        steps: NDArray[np.int64],
        *,
        energy: bool,
    ) -> SceneInSpace:
        """Gather the bodies of an evaluation; collective.

        Args:
            problem: Bodies.
            mechanism: Joints and forces.
            evaluation: Trajectory and shape functions at one design.
            steps: Time steps to be drawn.
            energy: Whether to compute the strain energy density of the cells.
        """
        trajectory = evaluation.motion
        bodies = {}
        for name, integrals in trajectory.model.bodies.items():
            held = dict.fromkeys(
                marker[1]
                for joint in mechanism.joints
                for marker in joint.markers
                if isinstance(marker, tuple) and marker[0] == name
            )
            elastic = trajectory.elastic(name)[steps]
            mesh, density, fields = None, np.zeros(0), np.zeros((len(steps), 0))
            markers = list(integrals.markers.values())
            points = np.array([m.position for m in markers]).reshape(-1, 3)
            shapes = np.zeros((len(markers), 3, integrals.modes))
            for k, marker in enumerate(markers):
                shapes[k] = marker.displacement
            if name in problem.flexible:
                body, reduced = problem.flexible[name], evaluation.bodies[name]
                mesh = GatheredMesh.of(body.domain)
                points = mesh.points - body.reduction.origin
                shapes = mesh.displacements(reduced.basis.shapes)
                density = mesh.cell_values(reduced.density)
                if energy:
                    local = [
                        body.elasticity.strain_energy(reduced.density, reduced.basis.shapes @ q)
                        for q in elastic
                    ]
                    fields = mesh.cell_values((np.array(local) / body.domain.cell_volumes).T).T
            bodies[name] = BodyInSpace(
                name=name,
                mesh=mesh,
                reference=points,
                shapes=shapes,
                markers=integrals.markers,
                held=list(held),
                position=trajectory.rigid(name)[steps, :3],
                rotation=trajectory.rotation(name)[steps],
                elastic=elastic,
                density=density,
                energy=fields,
            )
        return SceneInSpace(mechanism, trajectory, steps, trajectory.t[steps], bodies)

    def position(self, marker: Marker, instant: int, magnification: float = 1.0) -> Array:
        """Where a marker is drawn, shape (3,) [m]."""
        if isinstance(marker, tuple):
            return self.bodies[marker[0]].marker(marker[1], instant, magnification)
        return self._tabulated(marker, instant)[0]

    def axes(self, marker: Marker, instant: int) -> Array:
        """The axes of a marker, its columns, shape (3, 3)."""
        if isinstance(marker, tuple):
            return self.bodies[marker[0]].axes(marker[1], instant)
        return self._tabulated(marker, instant)[1:].T

    def _tabulated(self, marker: Any, instant: int) -> Array:
        at = self.times[instant : instant + 1]
        return np.asarray(marker.tabulate_in_space(at, "picture")[0, 0])

    def circle(self, marker: Moving) -> tuple[Array, Array] | None:
        """Centre (3,) and points of the circle on which a marker moves; None if there is none."""
        path = marker.tabulate_in_space(self.trajectory.t, "picture")[:, 0, 0]
        middle = path.mean(axis=0)
        _, size, plane = np.linalg.svd(path - middle, full_matrices=False)
        if size[1] <= 1e-9 * size[0] or size[2] > 1e-6 * size[0]:
            return None
        center = fit_circle((path - middle) @ plane[:2].T)
        if center is None:
            return None
        radius = float(np.linalg.norm((path[0] - middle) @ plane[:2].T - center))
        angles = np.linspace(0.0, 2.0 * np.pi, 73)
        ring = center + radius * np.column_stack([np.cos(angles), np.sin(angles)])
        return middle + center @ plane[:2], middle + ring @ plane[:2]

    def size(self) -> float:
        """The extent of the largest body [m]."""
        extents = [np.ptp(body.reference, axis=0) for body in self.bodies.values()]
        return float(max((np.max(extent) for extent in extents), default=1.0)) or 1.0

    def seen(self, magnification: float) -> Array:
        """All that is drawn, at all instants, shape (n, 3) [m]."""
        parts = []
        for body in self.bodies.values():
            for i in range(len(self.steps)):
                points = body.points(i, magnification)
                parts.append(points[:: max(1, len(points) // 500)])
        for joint in self.mechanism.joints:
            for marker in joint.markers:
                found = self.circle(marker) if isinstance(marker, Moving) else None
                parts += [] if found is None else [found[1]]
        connections = (*self.mechanism.joints, *self.mechanism.forces)
        places = [m for part in connections for symbol in part.symbols for m in symbol.markers]
        parts += [self.position(m, 0)[None] for m in places if not isinstance(m, tuple | Moving)]
        return np.concatenate(parts)


class ViewOfSpace:
    """A picture of a mechanism in space in axes; `show` moves it to an instant.

    Args:
        axes: Where to draw.
        scene: The mechanism.
        magnification: Of the deformation.
        colors: Gives the colour value of each cell of a body at an instant.
        cmap: Colours.
        norm: Range of the values.
        labels: Whether to write the names of bodies and joints.
    """

    def __init__(
        self,
        axes: Axes,
        scene: SceneInSpace,
        magnification: float,
        colors: Callable[[Any, int], Array],
        cmap: Colormap | str,
        norm: Normalize,
        *,
        labels: bool = False,
    ) -> None:
        self.axes, self.scene, self.magnification = axes, scene, magnification
        self._updates: list[Callable[[int], None]] = []
        self._colors, self._mappable = colors, ScalarMappable(norm, cmap)
        inches = axes.get_window_extent().width / axes.figure.dpi
        tall = axes.get_window_extent().height / axes.figure.dpi
        seen = scene.seen(magnification)
        #: Size of a pin [m]
        self.unit = 0.014 * float(np.linalg.norm(np.ptp(seen, axis=0)))
        self._view = Rendering(inches, tall, seen)
        for body in scene.bodies.values():
            self._add_mesh(body) if body.mesh is not None else self._add_bar(body)
        for joint in scene.mechanism.joints:
            for symbol in joint.symbols:
                self._add_symbol(symbol)
            axis = getattr(joint, "axis", getattr(joint, "normal", None))
            if isinstance(axis, tuple):
                self._add_axis(joint.markers[-1], axis)
            for marker in joint.markers:
                if isinstance(marker, Moving):
                    self._add_crank(marker)
        for force in scene.mechanism.forces:
            for symbol in force.symbols:
                self._add_symbol(symbol)
        self._view.look()
        if labels:
            for body in scene.bodies.values():
                self._add_label(body)
        empty = np.full((2, 2, 3), 255, dtype=np.uint8)
        axes.set_axis_off()
        self._image = axes.imshow(empty, aspect="auto", interpolation="antialiased")
        self.moving: list[Artist] = [self._image]  #: Artists that `show` changes

    def show(self, instant: int) -> None:
        """Move everything to an instant."""
        for update in self._updates:
            update(instant)
        picture = self._view.picture()
        self._image.set_data(picture)
        height, width = picture.shape[:2]
        self._image.set_extent((0.0, width, 0.0, height))
        self.axes.set_xlim(0.0, width)
        self.axes.set_ylim(0.0, height)

    def close(self) -> None:
        """Free the memory of the picture."""
        self._view.plotter.close()

    # ------------------------------------------------------------------ parts

    def _add_mesh(self, body: BodyInSpace) -> None:
        """Draw the cells that are not void, and the edges of the whole body."""
        assert body.mesh is not None
        shown = np.flatnonzero(body.density >= VOID)
        grid = body.mesh.grid()
        self._add_edges(body, grid)
        if not len(shown):
            return
        cells = grid.extract_cells(shown)
        surface = surface_of(cells)
        of = np.asarray(cells["vtkOriginalPointIds"])[np.asarray(surface["vtkOriginalPointIds"])]
        cell = shown[np.asarray(surface["vtkOriginalCellIds"])]

        def update(instant: int) -> None:
            surface.points = body.points(instant, self.magnification)[of]
            values = self._colors(body, instant)[cell]
            surface.cell_data["rgb"] = self._mappable.to_rgba(values, bytes=True)[:, :3]

        update(0)
        self._view.add(surface, scalars="rgb", rgb=True)
        self._updates.append(update)

    def _add_edges(self, body: BodyInSpace, grid: Any) -> None:
        edges = surface_of(grid).extract_feature_edges(
            feature_angle=40.0, boundary_edges=False, manifold_edges=False, non_manifold_edges=False
        )
        if not edges.n_points:
            return
        of = cKDTree(grid.points).query(edges.points)[1]

        def update(instant: int) -> None:
            edges.points = body.points(instant, self.magnification)[of]

        update(0)
        self._view.plotter.add_mesh(edges, color=LIGHT, line_width=1.5, lighting=False)
        self._updates.append(update)

    def _add_bar(self, body: BodyInSpace) -> None:
        """Draw a body without a mesh as rods between its markers."""
        import pyvista

        names = list(body.markers)
        for name in names[1:]:
            self._add_line(
                lambda i, n=name: np.array(  # type: ignore[misc]
                    [body.marker(m, i, self.magnification) for m in (names[0], n)]
                ),
                _STEEL,
                0.35 * self.unit,
            )
        if len(names) == 1:
            ball = pyvista.Sphere(radius=self.unit)
            self._follow(ball, lambda i: (body.marker(names[0], i), np.eye(3)), _STEEL)

    def _follow(self, mesh: Any, pose: Callable[[int], tuple[Array, Array]], color: str) -> None:
        """Let a mesh move as a rigid body: its position, and its axes as columns."""
        still = np.array(mesh.points, dtype=np.float64)

        def update(instant: int) -> None:
            position, axes = pose(instant)
            mesh.points = position + still @ axes.T

        update(0)
        self._view.add(mesh, color=color)
        self._updates.append(update)

    def _add_line(self, ends: Callable[[int], Array], color: str, radius: float) -> None:
        """Draw a rod between two points that move."""
        import pyvista

        still = pyvista.Cylinder(
            center=(0.5, 0.0, 0.0), direction=(1.0, 0.0, 0.0), radius=radius, height=1.0
        )

        def pose(instant: int) -> tuple[Array, Array]:
            first, last = ends(instant)
            along = last - first
            length = float(np.linalg.norm(along)) or 1e-300
            n = along / length
            e = np.eye(3)[int(np.argmin(np.abs(n)))]
            e = e - (e @ n) * n
            e /= np.linalg.norm(e)
            return first, np.column_stack([along, e, np.cross(n, e)])

        self._follow(still, pose, color)

    def _at(self, marker: Marker) -> Callable[[int], tuple[Array, Array]]:
        """Position and axes of a marker."""
        scene = self.scene
        return lambda i: (scene.position(marker, i, self.magnification), scene.axes(marker, i))

    def _add_symbol(self, symbol: Symbol) -> None:
        import pyvista

        first = next((m for m in symbol.markers if isinstance(m, tuple)), symbol.markers[0])
        if isinstance(symbol, Line | Spring) and len(symbol.markers) == 2:
            a, b = (self._at(marker) for marker in symbol.markers)
            color, radius = (GRAY, 0.12) if isinstance(symbol, Spring) else (DARK, 0.2)
            self._add_line(lambda i: np.array([a(i)[0], b(i)[0]]), color, radius * self.unit)
        if isinstance(symbol, Slider):
            direction = np.zeros(3)
            direction[: len(symbol.direction)] = symbol.direction
            self._add_guide(symbol.markers[1], direction)
        if symbol.sign == "pin":
            self._follow(pyvista.Sphere(radius=0.6 * self.unit), self._at(first), DARK)
        elif symbol.sign == "square":
            cube = pyvista.Cube(x_length=self.unit, y_length=self.unit, z_length=self.unit)
            self._follow(cube, self._at(first), DARK)

    def _add_guide(self, marker: Marker, direction: Array) -> None:
        """Draw the line along which a slider moves, as far as the picture reaches."""
        reach = self._view.size
        n = direction / np.linalg.norm(direction)
        at = self._at(marker)

        def ends(instant: int) -> Array:
            position, axes = at(instant)
            along = axes @ n
            low, high = self._view.span(position, along, reach)
            return np.array([position + low * along, position + high * along])

        self._add_line(ends, LIGHT, 0.15 * self.unit)

    def _add_axis(self, marker: Marker, axis: tuple[float, ...]) -> None:
        """Draw the axis of a joint, which the second marker holds."""
        n = np.array(axis) / np.linalg.norm(axis)
        at = self._at(marker)

        def ends(instant: int) -> Array:
            position, axes = at(instant)
            along = 2.0 * self.unit * (axes @ n)
            return np.array([position - along, position + along])

        self._add_line(ends, DARK, 0.22 * self.unit)

    def _add_crank(self, marker: Moving) -> None:
        """Draw the circle of a prescribed crank, and its arm."""
        import pyvista

        found = self.scene.circle(marker)
        if found is None:
            return
        center, ring = found
        line = pyvista.lines_from_points(ring)
        self._view.plotter.add_mesh(line, color=LIGHT, line_width=3.0, lighting=False)
        at = self._at(marker)
        self._add_line(lambda i: np.array([center, at(i)[0]]), GRAY, 0.4 * self.unit)

    def _add_label(self, body: BodyInSpace) -> None:
        """Write the name of a body at its middle."""
        middle = body.points(0, self.magnification).mean(axis=0)
        self._view.plotter.add_point_labels(
            middle[None],
            [body.name],
            font_size=26,
            text_color=DARK,
            shape_color="white",
            shape_opacity=0.75,
            show_points=False,
            always_visible=True,
        )
