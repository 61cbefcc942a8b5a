# SPDX-License-Identifier: MIT
"""The bodies of a problem: from their densities to a response of objectives, and back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array, summed
from ..body import VolumeIntegrals
from ..fem import Domain
from ..mechanical_problem import Gradients
from ..mechanism import Mechanism
from ..objective import DensityField, Derivatives, Inventory, Response
from ..reduction import BodyStress, FlexibleBody, ReducedBody

Body = FlexibleBody | VolumeIntegrals
Densities = ArrayLike | Mapping[str, ArrayLike]
Reduced = Mapping[str, ReducedBody]


def lengths_of_placements(mechanisms: Iterable[Mechanism]) -> Iterator[tuple[str, str, str]]:
    """Connections whose length follows from placements: label, and body and marker at an end."""
    for mechanism in mechanisms:
        for connection in (*mechanism.joints, *mechanism.forces):
            if getattr(connection, "length", 0.0) is None:
                ends = [marker for marker in connection.markers if isinstance(marker, tuple)]
                yield from ((connection.label, *end) for end in ends)


class DesignedBodies:
    """Bodies by name, some with a density."""

    def __init__(self, bodies: Mapping[str, Body]) -> None:
        kinds = (FlexibleBody, VolumeIntegrals)
        validation.instances_by_name(
            "problem: bodies", bodies, kinds, "a FlexibleBody or VolumeIntegrals"
        )
        self.every = dict(bodies)
        #: The bodies with a density
        self.flexible = {
            name: body for name, body in bodies.items() if isinstance(body, FlexibleBody)
        }

    @property
    def comm(self) -> MPI.Comm:
        """The ranks that share the bodies; all where none has a density."""
        comms = (body.domain.comm for body in self.flexible.values())
        return next(comms, MPI.COMM_WORLD)

    @property
    def space(self) -> bool:
        """Whether the bodies are in space."""
        return any(
            (body.dimension if isinstance(body, VolumeIntegrals) else body.domain.dimension) == 3
            for body in self.every.values()
        )

    @property
    def modes(self) -> dict[str, int]:
        """Number of elastic coordinates of each body."""
        return {
            name: body.modes if isinstance(body, VolumeIntegrals) else body.n_elastic
            for name, body in self.every.items()
        }

    def inventory(self) -> Inventory:
        """The bodies as objectives may name them, without joints and before there is a design."""
        markers = {
            name: body.markers
            if isinstance(body, VolumeIntegrals)
            else [*body.domain.interfaces, *body.markers]
            for name, body in self.every.items()
        }
        full = {
            name: _field(body, np.ones(body.domain.n_cells)) for name, body in self.flexible.items()
        }
        return Inventory(markers, self.modes, (), full)

    def refuse_lengths_of_placements(self, mechanisms: Iterable[Mechanism]) -> None:
        """Refuse lengths between markers that move with the nodes: their derivative is missing."""
        for label, body, point in lengths_of_placements(mechanisms):
            if body in self.flexible and point in self.flexible[body].markers:
                raise ValueError(
                    f"problem: {label!r} takes its length from the placements, where marker "
                    f"{point!r} of {body!r} moves with the nodes: give its length, which then has "
                    "no derivative"
                )

    def filled(self, share: float) -> dict[str, Array]:
        """Densities, shape (cells,), that equal ``share`` in all designed elements."""
        domains = {name: body.domain for name, body in self.flexible.items()}
        return {
            name: np.where(domain.design_cells, share, domain.passive_density)
            for name, domain in domains.items()
        }

    def checked(self, x: Densities) -> dict[str, Array]:
        """Densities by body, shape (cells,), from a mapping or, for the only body, an array."""
        if isinstance(x, Mapping):
            if set(x) != set(self.flexible):
                raise ValueError(
                    f"problem: densities given for {sorted(x)}, but the flexible bodies are "
                    f"{sorted(self.flexible)}"
                )
            by_body = dict(x)
        elif len(self.flexible) > 1:
            raise ValueError(
                f"problem: {len(self.flexible)} bodies have densities ({sorted(self.flexible)}); "
                "give a mapping from name to density"
            )
        else:
            by_body = {next(iter(self.flexible)): x}
        return {
            name: body.domain.check_density(by_body[name], f"density of {name!r}")
            for name, body in self.flexible.items()
        }

    def reduce(self, densities: Mapping[str, Array]) -> dict[str, ReducedBody]:
        """Shape functions and integrals at densities that have been checked."""
        return {name: body.reduce_checked(densities[name]) for name, body in self.flexible.items()}

    def volume(self, reduced: Reduced) -> dict[str, float]:
        """The filled share of each body."""
        domains = {name: self.flexible[name].domain for name in reduced}
        return {
            name: domain.sum(reduced[name].density * (domain.cell_volumes / domain.area))
            for name, domain in domains.items()
        }

    def refuse_foreign(self, reduced: Reduced) -> None:
        """Raise a ValueError unless these bodies are the ones that were ``reduced``."""
        if set(reduced) != set(self.flexible):
            raise ValueError(
                "problem: the evaluation is of another problem: its flexible bodies are "
                f"{sorted(reduced)}, but this problem has {sorted(self.flexible)}"
            )
        for name, body in self.flexible.items():
            body.refuse_foreign(reduced[name], name)

    def response(self, reduced: Reduced) -> Response:
        """The bodies as a response without a trajectory; no stress is computed yet."""
        self.refuse_foreign(reduced)
        return Response(
            None,
            {
                name: body if isinstance(body, VolumeIntegrals) else reduced[name].integrals
                for name, body in self.every.items()
            },
            {name: _field(self.flexible[name], body.density) for name, body in reduced.items()},
            {name: BodyStress(self.flexible[name], body) for name, body in reduced.items()},
        )


class Pullback:
    """The map from derivatives of a number by bodies and parameters to gradients of the design.

    Derivatives by integrals and stress go back through the reduction. Each call takes adjoint
    solutions of the finite elements, and adds up their iterations and time.
    """

    def __init__(
        self,
        bodies: Mapping[str, FlexibleBody],
        reduced: Reduced,
        label: str,
        *,
        densities: bool,
        nodes: bool,
    ) -> None:
        """Prepare gradients by ``densities`` and by ``nodes``; the ``label`` is of parameters."""
        self.bodies, self.reduced, self.label = bodies, reduced, label
        self.densities, self.nodes = densities, nodes
        #: Conjugate gradient iterations, by body
        self.iterations = dict.fromkeys(bodies, 0)
        #: Time by name of the step [s]
        self.seconds: dict[str, float] = {}

    def __call__(self, bars: Derivatives) -> Gradients:
        """The gradients of a number from its derivatives ``bars``, the trajectory eliminated."""
        parameters = dict(bars.parameters)
        if not (self.densities or self.nodes):
            return Gradients(parameters=parameters)
        gradient, nodes, centers = dict[str, Array](), dict[str, Array](), dict[str, Array]()
        for name in self.bodies:
            gradient[name], nodes[name], centers[name] = self._of_body(name, bars)
        if self.label:
            gradient[self.label] = np.array(list(parameters.values()))
        return Gradients(
            gradient=gradient if self.densities else None,
            nodes=nodes if self.nodes else None,
            centers=centers if self.nodes else None,
            parameters=parameters,
        )

    def _of_body(self, name: str, bars: Derivatives) -> tuple[Array, Array, Array]:
        """Derivatives by the density of cells, by nodes and by centers of interfaces of a body."""
        body, dimension = self.bodies[name], self.bodies[name].domain.dimension
        gradient = np.zeros(body.domain.n_cells)
        by_nodes: Array | None = None
        by_centers: Array | None = None
        integrals = bars.integrals[name]
        # the same on every rank, so all skip a body that does not matter, or none
        if name in bars.stresses or integrals.dot(integrals) != 0.0:
            shapes = None
            if name in bars.stresses:
                shapes = body.stress_pullback(self.reduced[name], bars.stresses[name])
            gradient, by_nodes, by_centers, statistics = body.pullback(
                self.reduced[name], integrals, shapes, nodes=self.nodes, cells=self.densities
            )
            self.iterations[name] += int(statistics.pop("iterations"))
            self.seconds = summed(self.seconds, statistics)
        if name in bars.densities:
            gradient = gradient + bars.densities[name]
        if by_centers is None:
            by_centers = np.zeros((len(body.domain.interfaces), dimension))
        if by_nodes is None:
            by_nodes = np.zeros((len(body.domain.mesh.geometry.x), dimension))
        areas, weights = bars.areas.get(name), bars.weights.get(name)
        if self.nodes and (areas is not None or weights is not None):
            by_nodes = by_nodes + body.measures_pullback(areas, weights)
        return gradient, by_nodes, by_centers


def _field(body: FlexibleBody, density: Array) -> DensityField:
    """A density as objectives see it, with the full body as it was designed, if there is one."""
    designed = body.domain.whole
    full = None if designed is None else _field_on(designed, np.ones(designed.n_cells))
    return _field_on(body.domain, density, full)


def _field_on(domain: Domain, values: Array, whole: DensityField | None = None) -> DensityField:
    """The density field of ``values``, shape (cells,), on a domain."""
    areas, gathered = domain.cell_volumes, domain.comm.allgather
    return DensityField(values, areas, domain.centroids, domain.sum, gathered, whole)
