# SPDX-License-Identifier: MIT
"""Pictures of bodies in space: drawn without a screen, the same on any number of ranks."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image
from spatial_slider_crank import spatial_problem

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting import animate_motion, plot_design, plot_modes, plot_scene, plot_stress


@pytest.mark.slow
def test_pictures_of_a_body(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """A design, its shape functions and its stress: no page is empty, and each shows colours."""
    domain = ffr.Domain.box(comm, 0.4, 0.05, 0.04, elements=(12, 3, 2))
    c = domain.centroids
    x = np.where((np.abs(c[:, 0] - 0.2) < 0.08) & (np.abs(c[:, 1]) < 0.01), 0.0, 1.0)
    material = ffr.Isotropic(210e9, 0.3, 7800.0)
    body = ffr.FlexibleBody(domain, material, frame=ffr.ChordFrame("left", "right"), modes=1)
    reduced = body.reduce(x)
    stress = ffr.von_mises(body, reduced, 1e-4 * np.eye(body.n_elastic)[1])
    pictures = [
        plot_design(domain, {"one": x, "full": np.ones_like(x)}, shared_tmp_path / "design.png"),
        plot_modes(body, reduced, shared_tmp_path / "modes.png", title="shapes"),
        plot_stress(domain, stress, shared_tmp_path / "stress.png", solid=x > 0.5),
    ]
    for path in pictures:
        image = imread(path)[..., :3]
        drawn = np.any(image < 0.97, axis=2)
        assert 0.05 < drawn.mean() < 0.9
        # interfaces, or values, in colour
        assert np.mean(np.ptp(image, axis=2) > 0.3) > 1e-3


@pytest.mark.mpi
@pytest.mark.slow
def test_pictures_of_a_motion(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """A rod between a crank and a slider, skew to each other: something moves, and is in colour."""
    problem = spatial_problem(comm, (6, 1, 1), modes=2, steps=240)
    evaluation = problem.value(np.ones(problem.flexible["rod"].domain.n_cells))
    picture = plot_scene(problem, evaluation, shared_tmp_path / "scene.png", color="energy")
    film = animate_motion(problem, evaluation, shared_tmp_path / "film.gif", frames=4)
    if comm.rank == 0:
        image = imread(picture)[..., :3]
        assert np.mean(np.ptp(image, axis=2) > 0.3) > 0.01
        # the block of the slider, as in the plane
        block = np.array([0xB6, 0xBE, 0xC8]) / 255.0
        assert np.sum(np.max(np.abs(image - block), axis=2) < 0.02) > 200
        frames = []
        with Image.open(film) as pictures:
            assert pictures.n_frames == 4
            for frame in (0, 1):
                pictures.seek(frame)
                frames.append(np.asarray(pictures.convert("L"), dtype=float))
        assert np.mean(np.abs(frames[0] - frames[1]) > 60.0) > 0.01
