# SPDX-License-Identifier: MIT
"""Stress of a reduced body for unit coordinates, as objectives and pictures see it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from scipy.spatial import cKDTree

from ..fem import Array
from ..parallel import announce, gathered
from .flexible_body import FlexibleBody, ReducedBody

Kept = TypeVar("Kept")


class BodyStress:
    """Stress of a reduced body for unit coordinates, on each rank at its own cells."""

    def __init__(self, body: FlexibleBody, reduced: ReducedBody) -> None:
        body.refuse_foreign(reduced)
        self.body, self.reduced = body, reduced
        self._modes: dict[bool, Array] = {}

    @property
    def n_constraint(self) -> int:
        return self.reduced.basis.n_constraint

    @property
    def out_of_plane(self) -> float:
        """The stress s_z / (s_x + s_y) [-]."""
        return self.body.material.out_of_plane

    @property
    def points(self) -> Array:
        """Where the stress is given, undeformed, shape (cells, points, dimension) [m]."""
        return self.body.stress_recovery.points

    @property
    def weights(self) -> Array:
        """Area that each point stands for, in space volume, shape (cells, points) [m^2], [m^3]."""
        return self.body.stress_recovery.weights

    @cached_property
    def interface_distance(self) -> Array:
        """From each point to the nearest node of an interface, (cells, points) [m]."""
        domain, points = self.body.domain, self.points
        nodes = domain.space.tabulate_dof_coordinates()[:, : domain.dimension]
        interface_dofs = np.unique(
            np.concatenate([interface.dofs for interface in domain.interfaces.values()])
        )
        tree = cKDTree(np.vstack(self.gathered(nodes[interface_dofs])))
        distance, _ = tree.query(points.reshape(-1, domain.dimension))
        return np.asarray(distance.reshape(points.shape[:2]))

    def modes(self, correction: bool) -> Array:
        """`FlexibleBody.stress_modes`, shape (cells, points, 3 or 6, coordinates) [Pa]."""
        if correction not in self._modes:
            announce(self.body.domain.comm, "the stress of a body")
            self._modes[correction] = self.body.stress_modes(self.reduced, correction=correction)
        return self._modes[correction]

    @property
    def components(self) -> int:
        """Number of components of the stress: 3, in space 6."""
        d = self.body.domain.dimension
        return d * (d + 1) // 2

    def in_blocks(self, correction: bool) -> Iterator[tuple[slice, Array]]:
        """`modes` of some cells at a time, with their places."""
        announce(self.body.domain.comm, "the stress of a body")
        fields = self.body.stress_fields(self.reduced, correction=correction)
        return self.body.stress_recovery.in_blocks(fields)

    def sum(self, local: Array) -> Array:
        """The sum over the ranks of an array, bit-identical on every rank."""
        announce(self.body.domain.comm, "a sum over the stresses of a body")
        return self.body.elasticity.sum(np.ascontiguousarray(local))

    def gathered(self, value: Kept) -> list[Kept]:
        """The values of all ranks, alike on every one of them."""
        values: list[Any] = gathered(self.body.domain.comm, "the stresses of a body", value)
        return values
