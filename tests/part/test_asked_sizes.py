# SPDX-License-Identifier: MIT
"""Sizes of finished parts beside those that were asked for."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
import shapely

import dolfinx_ffr as ffr
from dolfinx_ffr.part import size_violations


def eye(comm: MPI.Comm, rim: float = 0.0, bolt: float = 0.002) -> ffr.Domain:
    """A plate with a bore of 9 mm, and a bolt hole beside it, to be held at the bore."""
    shape = shapely.box(-0.02, -0.02, 0.06, 0.02)
    shape = shape.difference(shapely.Point(0, 0).buffer(0.009, 48))
    shape = shape.difference(shapely.Point(0.05, 0.0).buffer(bolt, 16))
    bore = {"bore": lambda x: np.abs(np.hypot(x[0], x[1]) - 0.009) < 1e-4}
    return ffr.Domain.from_outline(comm, shape, interfaces=bore, size=0.004, solid_rim=rim)


@pytest.mark.mpi
def test_a_rim_that_is_too_thin_is_a_thin_member(comm: MPI.Intracomm) -> None:
    """Of material in a disc around the bore that is bare on one side; with place and remedy."""
    part = ffr.Part(eye(comm, rim=0.003), lambda x: x[:, 0] - 0.001 - 20.0 * x[:, 1] ** 2, 0.004)
    assert size_violations(part, 0.003) == []
    (computed,) = size_violations(part, 0.005)
    assert computed.name.startswith("thinnest member near (-")
    assert computed.share == pytest.approx(0.4, abs=0.01)
    assert "is 3 mm at (" in computed.message and "below the minimum of 5 mm" in computed.message
    assert "give a wider solid_rim" in computed.message


def test_a_thin_strut_and_a_narrow_slot_of_the_design(comm: MPI.Comm) -> None:
    """Away from what stays solid more steps help; a bolt hole of the drawing is no gap."""

    def slots(width: float) -> ffr.Part:
        """Two slots, 3 mm apart."""

        def field(x: np.ndarray) -> np.ndarray:
            beside = np.abs(np.abs(x[:, 1]) - 0.0015 - 0.5 * width) - 0.5 * width
            return np.maximum(beside, np.abs(x[:, 0] - 0.03) - 0.01)

        return ffr.Part(eye(comm), field, 0.002)

    violations = size_violations(slots(0.006), 0.004, 0.005)
    assert [each.name.partition(" near")[0] for each in violations] == ["thinnest member"]
    assert (
        violations[0].share == pytest.approx(0.25, abs=0.01)
        and "more steps" in violations[0].message
    )
    violations = size_violations(slots(0.004), 0.003, 0.005)
    assert [each.name.partition(" near")[0] for each in violations] == ["narrowest gap"]
    assert violations[0].share == pytest.approx(0.2, abs=0.01)
