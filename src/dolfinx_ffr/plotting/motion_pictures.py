# SPDX-License-Identifier: MIT
"""The mechanism at one instant and in motion, and a boundary that moves, step by step."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from shapely.geometry.base import BaseGeometry

from .. import validation
from ..arrays import Array
from ..fem import Domain
from ..problem import Evaluation, Problem
from . import style
from .in_space import MechanismInSpace, Rendering
from .mechanism_view import VOID, MechanismView
from .part_view import STEEL, outline_of
from .scene import Scene

#: Shown deflection relative to the body, at the instant of the largest one
_SHOWN_DEFLECTION = 0.1
#: Instants from one picture of a film to the next, where those of the motion are few
BETWEEN = 10
#: Height of the curve below the part, and of the margins around both [inches]
_CURVE, _MARGIN = 0.75, 0.55


def plot_scene(
    problem: Problem,
    evaluation: Evaluation,
    path: str | Path,
    *,
    time: float | None = None,
    color: str = "density",
    deformation_scale: float | None = None,
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
        time: Instant [s]; by default that of the largest strain energy.
        color: What the colour of the cells tells: ``"density"`` or ``"energy"`` (strain energy
            density relative to its largest value at this instant).
        deformation_scale: Factor by which the deformation is magnified; by default a round number
            that makes it visible with ``"energy"``, and 1 with ``"density"``.
        path: File to write.
        title: Heading.

    Raises:
        ValueError: If the colour is not known, or the time outside the simulation.
    """
    path = style.writable(path, title)
    _check("plot_scene", problem, evaluation, deformation_scale)
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
    if deformation_scale is None and color == "density":
        deformation_scale = 1.0

    def draw(file: Path) -> None:
        scale = deformation_scale or _visible_scale(scene)
        width, tall = 9.0, _height_of_view(scene, scale, 8.8)
        with style.styled_figure(width, tall + 0.75, file) as figure:
            if color == "energy":
                colors, top = _energy_colors(scene)
                _add_color_bar(figure, top)
            else:
                # shaded bodies in space must not be black
                norm = Normalize(-0.15, 2.5 if scene.dimension == 3 else 1.15)
                colors = ScalarMappable(norm, "gray_r")
            axes = style.axes_at(figure, 0.1, 0.1, 8.8, tall)
            view = _view(scene)(axes, scene, scale, colors, labels=True)
            view.show(0)
            view.close()
            _write(figure, _heading(title, scale), f"t = {scene.times[0]:.3f} s")

    return style.written(problem.comm, path, draw)


def _check(
    what: str, problem: Problem, evaluation: Evaluation, deformation_scale: float | None
) -> None:
    """Refuse arguments of a wrong kind."""
    validation.instance(f"{what}: problem", problem, Problem, "a Problem")
    validation.instance(f"{what}: evaluation", evaluation, Evaluation, "an Evaluation")
    problem.refuse_foreign(evaluation)
    if deformation_scale is not None:
        validation.number(f"{what}: deformation_scale", deformation_scale, least=0.0)


def animate_motion(
    problem: Problem,
    evaluation: Evaluation,
    path: str | Path,
    *,
    deformation_scale: float | None = None,
    frames: int = 96,
    frames_per_second: float = 16.0,
    title: str = "",
) -> Path:
    """Show the mechanism in motion, with the deformed bodies coloured by strain energy density.

    One sees what `plot_scene` shows, moving. The colour of a cell is its strain energy density
    relative to the largest one of all pictures, on a scale that spreads the small values.
    Below, the strain energy of all flexible bodies runs along with time; without any, the kinetic
    energy of all bodies.

    Args:
        problem: Bodies and mechanism.
        evaluation: Result of `Problem.value` or `Problem.gradient` at the design.
        path: File to write, .gif, or .mp4 where ffmpeg is installed.
        deformation_scale: Factor by which the deformation is magnified about the undeformed body
            laid through its joints; by default a round number that makes it visible.
        frames: Number of pictures, at equal intervals of time.
        frames_per_second: Of the film.
        title: Heading.

    Raises:
        ValueError: If a number is out of range, or ffmpeg is not there for .mp4.
    """
    path = check_film(path, title)
    _check("animate_motion", problem, evaluation, deformation_scale)
    frames = validation.integer("animate_motion: frames", frames, least=2)
    rate = validation.number("animate_motion: frames_per_second", frames_per_second, above=0.0)
    trajectory = evaluation.trajectory
    t = trajectory.t
    # Few instants, and at unlike distances.
    if trajectory.integrator.stages > 1 and trajectory.follows_turns:
        t = np.linspace(t[0], t[-1], BETWEEN * (frames - 1) + 1)
        ((name, case),) = evaluation.load_cases.items()
        even = replace(case, trajectory=trajectory.at(t))
        evaluation = replace(evaluation, load_cases={name: even})
    wanted = np.interp(np.linspace(t[0], t[-1], frames), t, np.arange(t.size))
    steps = np.unique(np.round(wanted).astype(np.int64))
    scene = Scene.gather(problem, evaluation, steps, energy=True)

    def draw(file: Path) -> None:
        write_film(_film(scene, list(problem.flexible), deformation_scale, title), file, rate)

    return style.written(problem.comm, path, draw)


def check_film(path: str | Path, title: str) -> Path:
    """The path of a film that can be written; a ValueError for another one."""
    path = style.writable(path, title, (".gif", ".mp4"))
    if path.suffix.lower() == ".mp4" and shutil.which("ffmpeg") is None:
        raise ValueError(
            f"picture {str(path)!r}: .mp4 needs the program ffmpeg, which is not there; install it "
            "(apt-get install ffmpeg) or end the name in .gif"
        )
    return path


def write_film(pictures: list[NDArray[np.uint8]], path: Path, rate: float) -> None:
    """Write pictures (height, width, 3) as a film of so many a second."""
    (_write_gif if path.suffix.lower() == ".gif" else _write_mp4)(pictures, path, rate)


def _view(scene: Scene) -> type[MechanismView]:
    """The class that draws scenes in the plane or in space."""
    return MechanismView if scene.dimension == 2 else MechanismInSpace


def _film(
    scene: Scene, flexible: list[str], scale: float | None, title: str
) -> list[NDArray[np.uint8]]:
    """The pictures, each of shape (height, width, 3)."""
    scale = scale or _visible_scale(scene)
    width, tall, head, foot = 9.0, _height_of_view(scene, scale, 8.8), 0.75, 1.45
    height = round(100 * (head + tall + foot)) // 2 * 2 / 100  # even, as films want it
    with style.styled_figure(width, height, dpi=100.0) as figure:
        axes = style.axes_at(figure, 0.1, foot, 8.8, tall)
        colors, top = _energy_colors(scene)
        view = _view(scene)(axes, scene, scale, colors)
        stamp = _write(figure, _heading(title, scale), "")
        if flexible:
            _add_color_bar(figure, top)
        below = style.axes_at(figure, 0.6, 0.5, 8.15, 0.75)
        t = scene.trajectory.t
        run, kind = scene.trajectory, "strain" if flexible else "kinetic"
        energy = run.strain_energy if flexible else run.kinetic_energy
        total = np.sum([energy(name) for name in flexible or scene.bodies], axis=0)
        unit, factor = style.prefixed(float(np.max(total)), "J")
        below.plot(t, total * factor, color=style.BLUE, linewidth=1.2)
        below.set_xlim(t[0], t[-1])
        below.set_ylim(0.0, max(1.12 * float(np.max(total)) * factor, 1e-300))
        below.set_xlabel("time [s]", labelpad=1.0)
        below.set_title(f"{kind} energy [{unit}]", loc="left", fontsize=9.5, pad=4.0)
        below.locator_params(axis="y", nbins=3)
        style.tidy(below)
        (line,) = below.plot([], [], color=style.GRAY, linewidth=0.8)
        (dot,) = below.plot([], [], "o", color=style.RED, markersize=6.0, clip_on=False)
        moving = [*view.moving, stamp, line, dot]
        canvas, background = _still(figure, moving)
        order = sorted(view.moving, key=lambda artist: artist.get_zorder())
        pictures = []
        for i, step in enumerate(scene.steps):
            canvas.restore_region(background)
            view.show(i)
            stamp.set_text(f"t = {t[step]:.2f} s")
            line.set_data([t[step]] * 2, below.get_ylim())
            dot.set_data([t[step]], [total[step] * factor])
            for artist in order:
                axes.draw_artist(artist)
            for artist in (line, dot):
                below.draw_artist(artist)
            figure.draw_artist(stamp)
            pictures.append(np.asarray(canvas.buffer_rgba())[..., :3].copy())
        view.close()
    return pictures


def _energy_colors(scene: Scene) -> tuple[ScalarMappable, float]:
    """The colour scale, and the largest strain energy density that is drawn [J/m^3]."""
    drawn = [body.energy[:, body.density >= VOID] for body in scene.bodies.values()]
    top = float(max((np.max(energy, initial=0.0) for energy in drawn), default=0.0))
    return ScalarMappable(PowerNorm(0.5, 0.0, top if top > 0.0 else 1.0), style.GLOW), top


def _visible_scale(scene: Scene) -> float:
    """A round magnification that makes the largest deflection visible."""
    instants, bodies = range(len(scene.steps)), scene.bodies.values()
    largest = max((body.deflection(i) for body in bodies for i in instants), default=0.0)
    if largest <= 1e-12 * scene.size():
        return 1.0
    return max(style.nice_number(_SHOWN_DEFLECTION * scene.size() / largest), 1.0)


def _height_of_view(scene: Scene, scale: float, width: float) -> float:
    """The height [inches] of axes of a width that fit all that is drawn."""
    seen = scene.seen(scale)
    if scene.dimension == 3:
        shape = Rendering.shape_of(seen)
    else:
        extent = np.ptp(seen, axis=0)
        extent = extent + 2.0 * 3.2 * 0.018 * float(np.max(extent))  # margins of MechanismView
        shape = extent[1] / extent[0]
    return float(np.clip(width * shape, 1.0, 7.0))


def _heading(title: str, scale: float) -> str:
    magnified = f"deformation magnified {scale:g} times" if scale != 1.0 else "deformation to scale"
    return f"{title}   ({magnified})" if title else magnified


def _write(figure: Figure, heading: str, stamp: str) -> Any:
    width, height = figure.get_size_inches()
    look = {"va": "center", "fontsize": 11}
    figure.text(0.2 / width, 1.0 - 0.28 / height, heading, **look)
    return figure.text(0.2 / width, 1.0 - 0.56 / height, stamp, family="monospace", **look)


def _add_color_bar(figure: Figure, top: float) -> None:
    unit, factor = style.prefixed(top, "J/m³")
    colors = ScalarMappable(PowerNorm(0.5, 0.0, 1.0), style.GLOW)
    label = f"strain energy density / {top * factor:.3g} {unit}"
    how: dict[str, Any] = {"ticks": [0.0, 0.05, 0.2, 0.5, 1.0], "format": "{x:g}"}
    style.color_bar(figure, colors, label, (0.645, 0.965, 0.46), **how)


def _write_gif(pictures: list[NDArray[np.uint8]], path: Path, rate: float) -> None:
    """Write an animated GIF with one palette, so that resting parts do not flicker."""
    chosen = Image.fromarray(np.vstack(pictures[:: max(1, len(pictures) // 8)]))
    common = chosen.quantize(96, method=Image.Quantize.MEDIANCUT).getpalette() or []
    glow = np.round(255.0 * style.GLOW(np.linspace(0.0, 1.0, 120))[:, :3]).astype(int)
    grays = np.repeat(np.round(np.linspace(0, 255, 40)).astype(int), 3)
    nearly_white = np.min(np.reshape(common, (-1, 3)), axis=1) > 240
    common = np.where(nearly_white[:, None], 255, np.reshape(common, (-1, 3)))[:96]
    palette = Image.new("P", (1, 1))
    palette.putpalette([*grays, *glow.ravel(), *common.ravel()])
    flat: dict[str, Any] = {"palette": palette, "dither": Image.Dither.NONE}
    images = [Image.fromarray(picture).quantize(**flat) for picture in pictures]
    how: dict[str, Any] = {"append_images": images[1:], "loop": 0, "optimize": False}
    images[0].save(path, save_all=True, duration=max(20, round(1000.0 / rate)), **how)


def _write_mp4(pictures: list[NDArray[np.uint8]], path: Path, rate: float) -> None:
    """Write a film by ffmpeg."""
    height, width, _ = pictures[0].shape
    command = ["ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{width}x{height}", "-r", f"{rate:g}", "-i", "-"]
    command += ["-an", "-pix_fmt", "yuv420p", str(path)]
    film = b"".join(picture.tobytes() for picture in pictures)
    result = subprocess.run(command, input=film, capture_output=True, check=False)
    if result.returncode:
        message = result.stderr.decode(errors="replace").strip()
        raise RuntimeError(f"ffmpeg could not write {path}: {message}")


def animate_boundary(
    body: Domain,
    materials: Sequence[BaseGeometry],
    psi: ArrayLike,
    path: str | Path,
    *,
    frames_per_second: float = 5.0,
    title: str = "",
) -> Path:
    """Show how the boundary of a part moves, and psi with it.

    One sees the material of each step in steel blue, with the outline of the body in dashes and the
    boundary of the first step in red. Below, psi relative to that of the first step runs along.

    Args:
        body: That was designed, in the plane.
        materials: What the boundary encloses, of each step, as `BoundaryResult.materials` has it.
        psi: Of each step, shape (steps,).
        path: File to write, .gif, or .mp4 where ffmpeg is installed.
        frames_per_second: Of the film.
        title: Heading.

    Raises:
        ValueError: If there are not as many numbers as steps, or a number is out of range, or
            ffmpeg is not there for .mp4.
    """
    path = check_film(path, title)
    validation.instance("animate_boundary: body", body, Domain, "a Domain")
    values = validation.real_array("animate_boundary: psi", psi, (len(materials),))
    rate = validation.number("animate_boundary: frames_per_second", frames_per_second, above=0.0)
    low, high = (corner[:2] for corner in body.bounding_box)

    def draw(file: Path) -> None:
        width, shares = 9.0, values / values[0]
        tall = float(np.clip((width - 0.4) * (high - low)[1] / (high - low)[0], 0.8, 6.0))
        height = round(100 * (tall + _CURVE + 3.0 * _MARGIN)) // 2 * 2 / 100
        pictures = []
        with style.styled_figure(width, height, dpi=100.0) as figure:
            axes = style.axes_at(figure, 0.2, _CURVE + 2.0 * _MARGIN, width - 0.4, tall)
            axes.set_aspect("equal")
            axes.set_xlim(low[0], high[0])
            axes.set_ylim(low[1], high[1])
            axes.set_axis_off()
            box = {"facecolor": "none", "edgecolor": style.GRAY, "lw": 0.6, "ls": (0, (4, 3))}
            axes.add_patch(PathPatch(outline_of(shapely.box(*low, *high)), **box))
            own = {"facecolor": STEEL, "edgecolor": style.DARK, "lw": 0.8}
            shape = axes.add_patch(PathPatch(outline_of(materials[0]), **own))
            before = {"facecolor": "none", "edgecolor": style.RED, "lw": 0.5, "alpha": 0.7}
            first = axes.add_patch(PathPatch(outline_of(materials[0]), **before))
            said = figure.text(0.02, 1.0 - 0.28 / height, "", fontsize=11)
            below, dot = _curve(figure, shares, width)
            moving = ((axes, shape), (axes, first), (below, dot), (figure, said))
            canvas, background = _still(figure, [artist for _, artist in moving])
            for step, material in enumerate(materials):
                canvas.restore_region(background)
                shape.set_path(outline_of(material))
                dot.set_data([step], [shares[step]])
                told = f"step {step}: psi {shares[step]:.4f} of the first one's"
                said.set_text(f"{title}   {told}".strip())
                for where, artist in moving:
                    where.draw_artist(artist)
                pictures.append(np.asarray(canvas.buffer_rgba())[..., :3].copy())
        write_film([pictures[0]] * 3 + pictures + [pictures[-1]] * 6, file, rate)

    return style.written(body.comm, path, draw)


def _still(figure: Figure, moving: Iterable[Artist]) -> tuple[Any, Any]:
    """The canvas of a figure, and what stays on it while the ``moving`` artists are drawn."""
    for artist in moving:
        artist.set_animated(True)
    canvas: Any = figure.canvas
    canvas.draw()
    return canvas, canvas.copy_from_bbox(figure.bbox)


def _curve(figure: Figure, values: Array, width: float) -> tuple[Axes, Line2D]:
    """The axes with the history of psi, relative to its start, and a dot that moves."""
    axes = style.axes_at(figure, _MARGIN + 0.2, _MARGIN, width - 0.6 - _MARGIN, _CURVE)
    axes.plot(values, color=style.BLUE, linewidth=1.2)
    (dot,) = axes.plot([], [], "o", color=style.RED, markersize=6.0, clip_on=False)
    axes.set_xlim(0.0, max(len(values) - 1.0, 1.0))
    axes.set_xlabel("step of the boundary", labelpad=1.0)
    axes.locator_params(axis="y", nbins=3)
    style.tidy(axes)
    return axes, dot
