# SPDX-License-Identifier: MIT
"""The one error by which a trial of boundaries may fail; whatever else is raised is a bug."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from shapely import GEOSException

from ..dynamics import SimulationError
from ..fem import ShapeError
from ..limits import LimitError

#: Errors of a reduction or a simulation that follow from the shape of a body
_OF_THE_SHAPE = (RuntimeError, SimulationError, np.linalg.LinAlgError)


class TrialFailed(Exception):
    """Boundaries of a trial cannot be meshed, or their parts cannot be simulated."""


@contextmanager
def shaping() -> Iterator[None]:
    """Context in which boundaries are changed and meshed: a shape that is refused is a failure.

    Any other error, as a bare ValueError, is a bug and goes on.
    """
    try:
        yield
    except (ShapeError, LimitError, GEOSException) as error:
        raise TrialFailed(str(error)) from error


@contextmanager
def simulating() -> Iterator[None]:
    """Context in which parts are reduced and simulated: what their shape forbids is a failure.

    An error of a derived class, as NotImplementedError, is none of the shape.
    """
    try:
        yield
    except _OF_THE_SHAPE as error:
        if type(error) not in _OF_THE_SHAPE:
            raise
        raise TrialFailed(str(error)) from error
