# SPDX-License-Identifier: MIT
"""Meshes that several tests use."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from dolfinx_ffr import Domain, _compat


def prongs(comm: MPI.Intracomm) -> Domain:
    """A fork of two identical prongs on a rigid root: each frequency comes twice."""
    nx, ny = 20, 4
    i, j, prong = np.meshgrid(np.arange(nx + 1), np.arange(ny + 1), [0, 1], indexing="ij")
    points = np.column_stack([i.ravel() / nx, 0.2 * j.ravel() / ny + prong.ravel()])
    number = np.arange(i.size).reshape(i.shape)
    corners = [number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]]
    cells = np.column_stack([corner.ravel() for corner in corners])
    if comm.rank > 0:
        cells, points = cells[:0], points[:0]
    mesh = _compat.create_mesh(comm, cells, points, "quadrilateral", 1)
    return Domain(mesh, {"root": lambda x: x[0] < 1e-9})
