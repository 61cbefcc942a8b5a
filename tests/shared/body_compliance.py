# SPDX-License-Identifier: MIT
"""Compliance of a reduced body under a load by acceleration: a number without a mechanism."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

import dolfinx_ffr as ffr
from shared.derivatives import check_slope

#: By axis; in the plane the first two
LOAD = np.array([0.3, 1.0, 0.7])


def compliance(reduced: ffr.reduction.ReducedBody) -> tuple[float, ffr.VolumeIntegrals]:
    """The compliance of a reduced body, and its derivative; only the span of the modes counts."""
    integrals = reduced.integrals
    load = LOAD[: integrals.S.shape[1]]
    q = np.linalg.solve(integrals.K, integrals.S[1:] @ load)
    bar = integrals.zeros_like()
    bar.S[1:] = 2.0 * np.outer(q, load)
    bar.K[:] = -np.outer(q, q)
    return float(q @ integrals.K @ q), bar


def body_compliance(body: ffr.FlexibleBody, x: np.ndarray) -> tuple[float, np.ndarray]:
    """The compliance at densities, with its gradient."""
    reduced = body.reduce(x)
    value, bar = compliance(reduced)
    return value, body.pullback(reduced, bar)[0]


def round_off(body: ffr.FlexibleBody, x: np.ndarray) -> float:
    """The relative spread of the compliance over densities that hardly differ."""
    values = [body_compliance(body, x * (1.0 - k * 1e-13))[0] for k in range(4)]
    return float(np.ptp(values)) / values[0]


def check_body_gradient(
    body: ffr.FlexibleBody,
    x: np.ndarray,
    comm: MPI.Intracomm,
    *,
    first_step: float = 1e-2,
    roundoff: float = 1e-10,
) -> None:
    """Demand a gradient of Taylor order 2, along a direction that leads inwards."""
    c = body.domain.centroids / np.ptp(body.domain.bounding_box, axis=0)
    direction = np.abs(np.cos(7.0 * c[:, 0] + 3.0 * c[:, 1] + 1.0)) * np.where(x > 0.5, -1.0, 1.0)
    slope = comm.allreduce(float(body_compliance(body, x)[1] @ direction))
    check_slope(
        lambda way: body_compliance(body, x + way * direction)[0],
        slope,
        first_step,
        count=4,
        roundoff=roundoff,
    )
