# SPDX-License-Identifier: MIT
"""Derivatives of a body's standard input data by the variables of a design, beside its file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from .. import validation
from ..interchange import write_derivatives
from .volume_integrals import VolumeIntegrals


def save_derivatives(path: str | Path, derivatives: Mapping[str, VolumeIntegrals]) -> None:
    """Write the derivatives of the terms of standard input data by the variables of a design.

    The file .npz stands beside that of the body, and holds ``variables`` (n,), and for each term of
    the body, as ``Ct``, arrays ``Ct.m0`` and ``Ct.m1`` of its derivatives by all of them, shape
    (n, rows, columns) and (n, rows, modes, columns); those of node 1 are ``node1.phi.m0``.

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
    every = {name: each.by_key for name, each in derivatives.items()}
    write_derivatives(validation.path("save_derivatives: path", path), every)
