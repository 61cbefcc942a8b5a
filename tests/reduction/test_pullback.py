# SPDX-License-Identifier: MIT
"""From the densities to the volume integrals and back, in the plane and in space."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.derivatives import check_slope, difference
from shared.rods import HELD, Response, rod, waves, ways

import dolfinx_ffr as ffr

SOFT = {"elements": (16, 4), "material": ffr.PlaneStress(2e9, 0.3, 1000.0, 0.01), "modes": 4}
LOADS = {"speed": ["omega2"], "inertia": ["omega2", "alpha", "acceleration"], "forces": ["markers"]}
BOX = {"elements": (8, 2, 2), "modes": 6, "tip": (0.21, 0.003, 0.004)}
#: Options of `rod`; "tip" is the place of a marker
BODIES: dict[str, dict[str, Any]] = {
    "bilinear": {"elements": (24, 4), "modes": 4},
    "biquadratic": {
        **{"elements": (12, 2), "order": 2, "tip": (0.2, 0.0), "frame": HELD, "modes": 5},
        "material": ffr.PlaneStrain(70e9, 0.33, 2700.0, 0.02),
    },
    "triangles": {
        **{"elements": (12, 2), "order": 2, "cell": "triangle", "tip": (0.37, 0.02)},
        "interpolation": ffr.RAMP(6.0, 1e-2),
    },
    "no normal modes": {
        **{"elements": (12, 2), "modes": 0},
        "interpolation": ffr.SIMP(3.0, 1e-6, ffr.LinearMass()),
    },
    **{f"chord, {name}": {**SOFT, "stiffening": loads} for name, loads in LOADS.items()},
    **{f"held, {n}": {**SOFT, "frame": HELD, "stiffening": loads} for n, loads in LOADS.items()},
    "box": BOX,
    "square box": {**BOX, "sizes": (0.4, 0.04, 0.04)},  # repeated frequencies
    "stiffened box": {**BOX, "stiffening": ("rotation", "acceleration", "markers")},
}


def made(comm: MPI.Intracomm, kind: str) -> ffr.FlexibleBody:
    options = dict(BODIES[kind])
    return rod(comm, markers={"tip": options.pop("tip", (0.21, 0.003))}, **options)


def design(body: ffr.FlexibleBody, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Densities, and a direction that does not leave their range."""
    domain, c = body.domain, body.domain.centroids
    x, direction = waves(domain), ways(domain)
    if where == "symmetric":
        x = 0.6 + 0.3 * np.sin(40.0 * c[:, 0])
    elif where == "thin":  # on both sides of the mass law's threshold
        x = 0.52 + 0.46 / 0.3 * (x - 0.6)
    elif where == "solid":
        x, direction = np.ones_like(x), -np.abs(direction)
    elif where == "with void":
        hole = (np.abs(c[:, 0] - 0.1) < 0.05) & (c[:, 1] > 0.0) & domain.design_cells
        x = np.where(hole, 0.0, 1.0)
        direction = np.where(hole, 1.0, -1.0) * np.abs(direction)
    return x, direction


CASES = [
    *(("bilinear", where) for where in ("solid", "with void")),
    *((kind, "symmetric" if kind == "square box" else "smooth") for kind in BODIES),
    *(("bilinear", "thin"), ("triangles", "thin")),
]


#: One of each kind of cells, of laws of stiffening and of voids: what the ranks share is alike.
RANKS = {
    *(("bilinear", "with void"), ("biquadratic", "smooth"), ("triangles", "thin")),
    *(("chord, inertia", "smooth"), ("square box", "symmetric"), ("stiffened box", "smooth")),
}


@pytest.mark.parametrize(
    ("kind", "where"),
    [
        pytest.param(*case, marks=pytest.mark.mpi if case in RANKS else pytest.mark.slow)
        for case in CASES
    ],
)
def test_pullback_from_integrals_to_density(comm: MPI.Intracomm, kind: str, where: str) -> None:
    """Taylor order 2, and agreement with differences, of density -> integrals -> number."""
    body = made(comm, kind)
    psi, domain = Response(body.domain.dimension), body.domain
    x, direction = design(body, where)
    reduced = body.reduce(x)
    assert set(reduced.integrals.stiffening) == set(BODIES[kind].get("stiffening", ())) - {
        "markers"
    }
    gradient = body.pullback(reduced, psi.bar(reduced.integrals))
    assert 0 < gradient.learnt["iterations"] < 60 or not body.modes
    slope = domain.sum(gradient.density * direction)

    def value(way: float) -> float:
        return psi.value(body.reduce(x + way * direction).integrals)

    # RAMP leaves its floor at a finite slope: steps must stay well below floor (1 + q)
    first_step = 1e-3 if kind == "triangles" else 1e-2
    check_slope(
        value, slope, first_step, count=4, roundoff=1e-11 if domain.dimension == 2 else 1e-10
    )
    if where in ("smooth", "symmetric"):
        # the number is solved for with n equations, and rounded off by n eps cond(K)
        off = np.finfo(float).eps * np.linalg.cond(reduced.integrals.K) * abs(value(0.0))
        off *= len(reduced.integrals.K)
        assert slope == pytest.approx(difference(value, 2e-3), rel=1e-6, abs=off / 2e-3)
    # the filled share is linear in the density
    share = body.volume(x)[0] + domain.sum(body.volume(x)[1] * first_step * direction)
    assert body.volume(x + first_step * direction)[0] == pytest.approx(share, rel=1e-12)
    assert body.volume(np.ones(domain.n_cells))[0] == pytest.approx(1.0, rel=1e-13)


@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["held, inertia", "chord, forces", "stiffened box"])
def test_same_numbers_on_any_number_of_ranks(comm: MPI.Intracomm, kind: str) -> None:
    """Frequencies, and a number that reads every integral, do not depend on the partition."""
    values = []
    for ranks in (comm, MPI.COMM_SELF):
        body = made(ranks, kind)
        reduced = body.reduce(waves(body.domain))
        psi = Response(body.domain.dimension).value(reduced.integrals)
        values.append([*reduced.basis.frequencies, psi])
    np.testing.assert_allclose(values[0], values[1], rtol=1e-9)
