# SPDX-License-Identifier: MIT
"""The mechanism at one instant and in motion, and a boundary that moves, step by step."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from numpy.typing import ArrayLike
from PIL import Image
from shapely.geometry.base import BaseGeometry

from .. import validation
from ..arrays import Array
from ..fem import Domain
from ..problem import Evaluation, Problem
from . import style
from .mechanism_view import MechanismView
from .part_view import STEEL, outline_path
from .scene import Scene


def plot_scene(
    problem: Problem,
    evaluation: Evaluation,
    path: str | Path,
    *,
    time: float | None = None,
    color: str = "density",
    title: str = "",
) -> Path:
    """Draw the mechanism at one instant.

    One sees the flexible bodies with their design (cells of density below 0.3 are left out, the
    outline remains), bodies given by integrals as bars, prescribed cranks with their circles,
    supports, guides and sliders, joints as pins and welds as squares, names of bodies and joints.
    Mechanisms in space are seen from the front, the right and above, with the axes of joints.

    Args:
        problem: Bodies and mechanism.
        evaluation: Result of `Problem.value` or `Problem.gradient` at the design.
        time: Instant [s]; by default the instant of the largest strain energy.
        color: Meaning of the colour of the cells: ``"density"``, or ``"energy"`` (strain energy
            density relative to its largest value at this instant), for which the deformation is
            magnified by a round number that makes it visible.
        path: File to write.
        title: Heading.
    """
    path = style.writable(path, title)
    _check("plot_scene", problem, evaluation)
    validation.choice("plot_scene: color", color, ("density", "energy"))
    if time is not None:
        time = validation.number("plot_scene: time", time, unit="s")
    trajectory = evaluation.trajectory
    energy = sum(trajectory.strain_energy(name) for name in problem.flexible)
    if time is None:
        step = int(np.argmax(energy))
    elif trajectory.t[0] <= time <= trajectory.t[-1]:
        step = int(np.argmin(np.abs(trajectory.t - time)))
    else:
        raise ValueError(
            f"plot_scene: time = {time} s lies outside the simulation, which runs from "
            f"{trajectory.t[0]:g} to {trajectory.t[-1]:g} s"
        )
    scene = Scene.gather(problem, evaluation, np.array([step]), energy=color == "energy")

    def draw(file: Path) -> None:
        scale = 1.0
        # black hides the shading of bodies in space
        darkest = 2.5 if scene.dimension == 3 else 1.15
        colors, label = ScalarMappable(Normalize(-0.15, darkest), "gray_r"), ""
        if color == "energy":
            scale = _visible_magnification(scene)
            colors, label = _energy_colors(scene)
        heading = f"{_heading(title, scale)}   t = {scene.times[0]:.3f} s"
        with style.page(file, [heading], width=style.PICTURES.scene_width) as (axes,):
            view = MechanismView(axes, scene, scale, colors, labels=True)
            view.show(0)
            view.canvas.close()
            if label:
                _add_energy_bar(axes, label)

    return style.written(problem.comm, path, draw)


def animate_motion(
    problem: Problem,
    evaluation: Evaluation,
    path: str | Path,
    *,
    frames: int = 96,
    frames_per_second: float = 16.0,
    title: str = "",
) -> Path:
    """Show the mechanism in motion, with the deformed bodies coloured by strain energy density.

    One sees what `plot_scene` shows, moving. The colour of a cell is its strain energy density
    relative to the largest one of all pictures, on a scale that spreads the small values. The
    deformation is magnified about the undeformed body laid through its joints, by a round number
    that makes it visible. Below, the strain energy of all flexible bodies runs along with time;
    without any, the kinetic energy of all bodies.

    Args:
        problem: Bodies and mechanism.
        evaluation: Result of `Problem.value` or `Problem.gradient` at the design.
        path: File to write, .gif, or .mp4 where ffmpeg is installed.
        frames: Number of pictures, at equal intervals of time.
        frames_per_second: Pictures in a second of the film.
        title: Heading.

    Raises:
        ValueError: If a number is out of range, or ffmpeg is not there for .mp4.
    """
    path = _film_path(path, title)
    _check("animate_motion", problem, evaluation)
    frames = validation.integer("animate_motion: frames", frames, least=2)
    rate = validation.number("animate_motion: frames_per_second", frames_per_second, above=0.0)
    trajectory = evaluation.trajectory
    t = trajectory.t
    # long steps of unequal lengths are evaluated in between
    if trajectory.integrator.stages > 1 and trajectory.follows_turns:
        t = np.linspace(t[0], t[-1], style.PICTURES.between * (frames - 1) + 1)
        ((name, case),) = evaluation.load_cases.items()
        even = replace(case, trajectory=trajectory.at(t))
        evaluation = replace(evaluation, load_cases={name: even})
    indices = np.interp(np.linspace(t[0], t[-1], frames), t, np.arange(t.size))
    steps = np.unique(np.round(indices).astype(np.int64))
    scene = Scene.gather(problem, evaluation, steps, energy=True)

    def draw(file: Path) -> None:
        _film_motion(scene, list(problem.flexible), title, file, rate)

    return style.written(problem.comm, path, draw)


def animate_boundary(
    body: Domain,
    materials: Sequence[BaseGeometry],
    psi: ArrayLike,
    path: str | Path,
) -> Path:
    """Show how the boundary of a part moves, and psi with it.

    One sees the material of each step in steel blue, with the outline of the body in dashes and the
    boundary of the first step in red. Below, psi relative to that of the first step runs along.

    Args:
        body: The plane body that was designed.
        materials: The enclosed material of each step, as in `BoundaryResult.materials`.
        psi: Objective of each step, shape (steps,).
        path: File to write, .gif, or .mp4 where ffmpeg is installed.

    Raises:
        ValueError: If there are not as many numbers as steps, or ffmpeg is not there for .mp4.
    """
    path = _film_path(path)
    validation.instance("animate_boundary: body", body, Domain, "a Domain")
    values = validation.real_array("animate_boundary: psi", psi, (len(materials),))
    low, high = (corner[:2] for corner in body.bounding_box)

    def draw(file: Path) -> None:
        with _film(file, 5.0) as (axes, below, add_pictures):
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
            axes.set_axis_off()

            def add_outline(shape: BaseGeometry, **look: Any) -> PathPatch:
                return axes.add_patch(PathPatch(outline_path(shape), **look))

            dashes: Any = {"fill": False, "edgecolor": style.GRAY, "lw": 0.6, "linestyle": "--"}
            add_outline(shapely.box(*low, *high), **dashes)
            material = add_outline(materials[0], facecolor=STEEL, edgecolor=style.DARK, lw=0.8)
            add_outline(materials[0], fill=False, edgecolor=style.RED, lw=0.5, alpha=0.7)
            shares = values / values[0]
            below.set(xlim=(0.0, max(len(shares) - 1.0, 1.0)), xlabel="step of the boundary")
            below.set_title("psi / psi of the first step", loc="left", fontsize=9.5)
            dot = _add_curve(below, np.arange(float(len(shares))), shares)

            def update(step: int) -> None:
                material.set_path(outline_path(materials[step]))
                dot.set_data([step], [shares[step]])
                axes.set_title(f"step {step}: psi is {shares[step]:.4f} of the first")

            # the start and the end are shown for a while
            last = len(materials) - 1
            add_pictures([0] * 3 + [*range(len(materials))] + [last] * 6, update)

    return style.written(body.comm, path, draw)


def _check(what: str, problem: Problem, evaluation: Evaluation) -> None:
    """Refuse arguments of a wrong kind."""
    validation.instance(f"{what}: problem", problem, Problem, "a Problem")
    validation.instance(f"{what}: evaluation", evaluation, Evaluation, "an Evaluation")
    problem.refuse_foreign(evaluation)


def _film_motion(scene: Scene, flexible: list[str], title: str, file: Path, rate: float) -> None:
    """Write a film of a mechanism in motion."""
    scale = _visible_magnification(scene)
    trajectory = scene.trajectory
    energy = trajectory.strain_energy if flexible else trajectory.kinetic_energy
    total = np.sum([energy(name) for name in flexible or scene.bodies], axis=0)
    unit, factor = style.prefixed(float(np.max(total)), "J")
    t, total = trajectory.t, total * factor

    with _film(file, rate) as (axes, below, add_pictures):
        colors, label = _energy_colors(scene)
        view = MechanismView(axes, scene, scale, colors)
        if flexible:
            _add_energy_bar(axes, label)
        top = max(1.12 * float(np.max(total)), 1e-300)
        below.set(xlim=(t[0], t[-1]), ylim=(0.0, top), xlabel="time [s]")
        kind = "strain" if flexible else "kinetic"
        below.set_title(f"{kind} energy [{unit}]", loc="left", fontsize=9.5)
        dot = _add_curve(below, t, total)

        def update(instant: int) -> None:
            step = scene.steps[instant]
            view.show(instant)
            axes.set_title(f"{_heading(title, scale)}   t = {t[step]:.2f} s")
            dot.set_data([t[step]], [total[step]])

        add_pictures(range(len(scene.steps)), update)
        view.canvas.close()


#: Adds pictures of some instants to a film; the update of each changes the figure
AddPictures = Callable[[Sequence[int], Callable[[int], None]], None]


@contextmanager
def _film(file: Path, rate: float) -> Iterator[tuple[Axes, Axes, AddPictures]]:
    """Axes of a film with so many pictures a second, axes below, and what adds pictures.

    Beside the first axes, the last line of the axes below moves.
    """
    width = style.PICTURES.scene_width
    with style.styled_figure(width, style.PICTURES.tallest_film * width, dpi=100.0) as figure:
        axes, below = figure.subplots(2, 1)
        below.set_box_aspect(style.PICTURES.curve)
        below.locator_params(axis="y", nbins=3)
        style.tidy(below)

        def add_pictures(instants: Sequence[int], update: Callable[[int], None]) -> None:
            update(instants[0])
            style.fit_height(figure, [axes, below])
            figure.draw_without_rendering()
            figure.set_layout_engine("none")
            writer: AbstractMovieWriter = GifWriter(rate, [axes, below.lines[-1]])
            if file.suffix.lower() == ".mp4":
                writer = FFMpegWriter(rate)
            with writer.saving(figure, file, figure.dpi):
                for instant in instants:
                    update(instant)
                    writer.grab_frame()

        yield axes, below, add_pictures


class GifWriter(AbstractMovieWriter):
    """Writes an animated GIF with one palette, so that resting parts do not flicker.

    All but the ``moving`` artists of a figure is drawn once.
    """

    def __init__(self, rate: float, moving: Sequence[Artist]) -> None:
        super().__init__(rate)
        self.moving = moving
        self.pictures: list[Image.Image] = []

    def setup(self, figure: Figure, outfile: Any, dpi: float | None = None) -> None:
        super().setup(figure, outfile, dpi)
        for artist in self.moving:
            artist.set_animated(True)
        canvas: Any = figure.canvas
        canvas.draw()
        self.background = canvas.copy_from_bbox(figure.bbox)

    def grab_frame(self, **_: Any) -> None:
        canvas: Any = self.fig.canvas
        canvas.restore_region(self.background)
        for artist in self.moving:
            self.fig.draw_artist(artist)
        self.pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]))

    def finish(self) -> None:
        """Write the file."""
        n_glow_colors = style.PICTURES.glowing
        n_film_colors = 256 - n_glow_colors
        # all pictures share the colours of about eight of them, so that no colour flickers
        sample = self.pictures[:: max(1, len(self.pictures) // 8)]
        stacked = Image.fromarray(np.vstack([np.asarray(picture) for picture in sample]))
        palette = stacked.quantize(n_film_colors, method=Image.Quantize.MEDIANCUT)
        film = np.reshape(palette.getpalette(), (-1, 3))[:n_film_colors]
        film[film.min(axis=1) > style.PICTURES.white] = 255

        # first the colours of the film, then those of the energy density
        glow = np.round(255.0 * style.GLOW(np.linspace(0.0, 1.0, n_glow_colors))[:, :3])
        palette.putpalette(np.vstack([film, glow]).astype(int).ravel().tolist())
        dither = Image.Dither.NONE
        first, *rest = [p.quantize(palette=palette, dither=dither) for p in self.pictures]

        duration = max(20, round(1000.0 / self.fps))
        options: dict[str, Any] = {"loop": 0, "optimize": False, "duration": duration}
        first.save(self.outfile, save_all=True, append_images=rest, **options)


def _add_curve(axes: Axes, x: Array, y: Array) -> Any:
    """Draw a curve, and return a dot that runs along it."""
    axes.plot(x, y, color=style.BLUE, linewidth=1.2)
    (dot,) = axes.plot([], [], "o", color=style.RED, markersize=6.0, clip_on=False)
    return dot


def _visible_magnification(scene: Scene) -> float:
    """A round magnification that makes the largest deflection visible."""
    instants, bodies = range(len(scene.steps)), scene.bodies.values()
    largest = max((body.deflection(i) for body in bodies for i in instants), default=0.0)
    if largest <= 1e-12 * scene.size():
        return 1.0
    return max(style.nice_number(style.PICTURES.deflection * scene.size() / largest), 1.0)


def _heading(title: str, magnification: float) -> str:
    """The title, with the magnification of the deformation."""
    text = "deformation to scale"
    if magnification != 1.0:
        text = f"deformation magnified {magnification:g} times"
    return f"{title}   ({text})" if title else text


def _energy_colors(scene: Scene) -> tuple[ScalarMappable, str]:
    """Colours of strain energy densities, and the name of their scale."""
    drawn = [body.energy[:, body.density >= style.PICTURES.void] for body in scene.bodies.values()]
    top = max((float(np.max(energy, initial=0.0)) for energy in drawn), default=0.0)
    unit, factor = style.prefixed(top, "J/m³")
    colors = ScalarMappable(PowerNorm(0.5, 0.0, top or 1.0), style.GLOW)
    return colors, f"strain energy density / {top * factor:.3g} {unit}"


def _add_energy_bar(axes: Axes, label: str) -> None:
    colors = ScalarMappable(PowerNorm(0.5, 0.0, 1.0), style.GLOW)
    style.add_color_bar([axes], colors, label, ticks=[0.0, 0.05, 0.2, 0.5, 1.0], format="{x:g}")


def _film_path(path: str | Path, title: str = "") -> Path:
    """Check the path of a film."""
    path = style.writable(path, title, (".gif", ".mp4"))
    if path.suffix.lower() == ".mp4" and not FFMpegWriter.isAvailable():
        raise ValueError(
            f"picture {str(path)!r}: .mp4 needs the program ffmpeg, which is not there; install it "
            "(apt-get install ffmpeg) or end the name in .gif"
        )
    return path
