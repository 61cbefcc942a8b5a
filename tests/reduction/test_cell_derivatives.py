# SPDX-License-Identifier: MIT
"""Derivatives of single terms of a body by every density, as files for other programs have them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.rods import HELD, rod, solid, waves, ways

from dolfinx_ffr.interchange import DERIVED, derived_terms

pytestmark = pytest.mark.mpi
LOADS = {2: ("omega2", "alpha", "acceleration", "markers"), 3: ("rotation", "acceleration")}


@pytest.mark.parametrize(
    ("elements", "options"),
    [
        ((20, 4), {"stiffening": LOADS[2]}),
        ((8, 2, 2), {"stiffening": (*LOADS[3], "markers"), "frame": HELD, "modes": 2}),
    ],
)
def test_differences_of_terms_on_all_ranks(
    comm: MPI.Intracomm, shared_tmp_path: Path, elements: tuple[int, ...], options: dict[str, Any]
) -> None:
    """Along a direction of all densities, those of every term of the file of the body."""
    d, path = len(elements), shared_tmp_path / "slopes.npz"
    markers = {"inside": np.array([0.23, 0.013, 0.007])[:d]}
    body = rod(comm, elements, markers=markers, tolerance=1e-10, **options)
    x, direction = waves(body.domain), ways(body.domain)
    body.save_derivatives(path, body.reduce(x))
    slopes = np.load(path)
    every = body.domain.everywhere(direction)
    centroids = body.domain.everywhere(body.domain.centroids)
    np.testing.assert_array_equal(slopes["centroids"], centroids)

    step = 1e-3
    moved = [body.in_space(body.reduce(x + k * step * direction)) for k in (-2, -1, 1, 2)]
    for key, terms in derived_terms(each.by_key for each in moved).items():
        weights = np.array([1.0, -8.0, 8.0, -1.0]) / (12.0 * step)
        wanted, found = np.tensordot(weights, terms, 1), np.tensordot(every, slopes[key], 1)
        size = np.max(np.abs(wanted), initial=np.max(np.abs(terms)) * 1e-3)
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-6 * size, err_msg=key)

    body.save_derivatives(path, body.reduce(x), ["mass", "J", "Ct", "phi"])
    for key, few in np.load(path).items():
        size = np.max(np.abs(slopes[key]))
        np.testing.assert_allclose(few, slopes[key], rtol=0.0, atol=1e-9 * size, err_msg=key)
    assert set(DERIVED) - {"mass"} == {key.split(".")[-2] for key in slopes if "." in key}


def test_what_has_no_derivative(
    comm: MPI.Intracomm, shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A square bar has two modes of each frequency."""
    path = shared_tmp_path / "slopes.npz"
    bar = rod(comm, (6, 2, 2), (0.4, 0.03, 0.03), modes=2)
    with pytest.raises(RuntimeError, match="normal modes 1 and 2 have the same frequency"):
        bar.save_derivatives(path, solid(bar))
    with pytest.raises(ValueError, match=r"term must be one of .* it is 'Cu'"):
        bar.save_derivatives(path, solid(bar), ["Cu"])
    monkeypatch.setattr("dolfinx_ffr.reduction.flexible_body.agreed_memory", lambda _: 1e5)
    with pytest.raises(ValueError, match="GB of this machine; ask for fewer terms"):
        bar.save_derivatives(path, solid(bar))
    assert not path.exists()
    static = bar.with_modes(0)
    static.save_derivatives(path, solid(static), ["mass"])
    mass = 7850.0 * 0.03**2 * 0.4
    assert np.load(path)["mass"].sum() == pytest.approx(mass, rel=1e-12)  # it is linear in them
