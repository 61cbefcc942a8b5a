# SPDX-License-Identifier: MIT
"""Derivatives of a body's standard input data by the variables of a design, beside its file."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from operator import add
from pathlib import Path

import numpy as np

from .. import validation
from ..interchange import derived_terms, write_all
from .volume_integrals import VolumeIntegrals


def save_derivatives(path: str | Path, derivatives: Mapping[str, VolumeIntegrals]) -> None:
    """Write the derivatives of the terms of standard input data by the variables of a design.

    The file .npz stands beside that of the body, and holds ``variables`` (n,), and for each term of
    the body, as ``Ct``, arrays ``Ct.m0`` and ``Ct.m1`` of its derivatives by all of them, shape
    (n, rows, columns) and (n, rows, modes, columns); those of node 1 are ``node1.phi.m0``. De has
    those of Me and Ke, times the factors of the damping. `FlexibleBody.save_derivatives` writes
    those of a body with a mesh.

    Args:
        path: Of the file; an older one is replaced.
        derivatives: By name of the variable, that of the integrals of the body in space, as the
            ``jacobian`` of a `ParametricBody` has them.

    Raises:
        ValueError: If there are none, or they are of bodies in the plane.
        OSError: If the file cannot be written.
    """
    needed = "the derivatives of a body in space, as VolumeIntegrals"
    validation.instances_by_name("save_derivatives", derivatives, VolumeIntegrals, needed)
    if not derivatives or any(each.P is None for each in derivatives.values()):
        raise ValueError("save_derivatives: give derivatives, of a body in space")
    # geometric stiffness that depends on some of the variables alone
    nothing = reduce(add, (each.zeros_like() for each in derivatives.values()))
    found = derived_terms((each + nothing).by_key for each in derivatives.values())
    found["variables"] = np.array(list(derivatives), dtype=np.str_)
    write_all(validation.path("save_derivatives: path", path), found)
