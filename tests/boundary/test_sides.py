# SPDX-License-Identifier: MIT
"""Which sides stay and move, and the faces between them."""

from __future__ import annotations

import numpy as np
import pytest

from dolfinx_ffr.boundary.sides import Side, _designed_faces
from dolfinx_ffr.fem import CurveError


def test_a_hole_that_touches_the_outline_is_in_its_face() -> None:
    """By round-off its first point is outside; one that is elsewhere is in no face."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    hole = np.array([[-1e-15, 0.5], [0.4, 0.9], [0.4, 0.1]])
    outline, rim = (Side(True, 0),), (Side(False, 1),)
    assert list(_designed_faces([(outline, square), (rim, hole)])) == [("design", (outline, rim))]
    with pytest.raises(CurveError, match="lies in no face"):
        list(_designed_faces([(outline, square), (rim, hole + 2.0)]))
