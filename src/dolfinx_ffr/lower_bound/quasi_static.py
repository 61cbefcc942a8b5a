# SPDX-License-Identifier: MIT
"""Quasi-static compliance of the flexible bodies of a driven machine, and bounds from below.

Stiffness K and load f of a body are affine in the densities x of all bodies, so that

    psi(x) = sum_bodies int f(x) . K(x)^-1 f(x) dt  >=  sum_bodies int (2 f(x) . u - u . K(x) u) dt

for any displacements u(t). The right side is affine in x: a constant, and for each body the
integral of x g over it, with

    g = - 2 rho sum_k F_k . y_k  -  sum_l sigma(w_l) : eps(w_l)

where F_k are the fields of its acceleration, y_k displacements that also move the body as joints
carry the deformation of all bodies on, and w_l displacements whose squares are the history of u.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..fem import PLATE, Block, FieldPairs
from ..objective import IntegralCompliance, time_weights
from ..problem import Evaluation, Problem
from ..reduction import FlexibleBody
from .driven_loads import DrivenLoads, driven_loads, rigid_motions, rigid_trajectory

#: Parts of a history whose energy is less than this share of the largest are round-off: with 1e-15
#: to 1e-7 the bound of a rod is the same to six digits
_RANK = 1e-13


@dataclass(frozen=True, eq=False)
class UnitResponse:
    """Displacements of one body at one density by each of its unit loads.

    The loads belong to the fields of acceleration, then to forces and moments at the markers.

    Attributes:
        displacements: Displacements of this rank's dofs by each load, shape (dofs, loads).
        work: Work of each load on the displacement by each other load, shape (loads, loads).
        inertia: Int rho x F_k . E_l of the fields of acceleration and the motions of the rigid
            body, shape (fields, motions).
    """

    displacements: Block
    work: Array
    inertia: Array


class StaticBody:
    """A body under its inertia and forces at its markers, stiffness and mass by its density."""

    def __init__(self, body: FlexibleBody) -> None:
        self.body = body
        reduction = body.reduction
        #: Fields of acceleration, (dofs, fields)
        self.fields = np.hstack([reduction.unit_translations, reduction.unit_gradients])
        #: Motions of the rigid body as sums of these fields
        self.rigid = rigid_motions(body.domain.dimension)

    @staticmethod
    def sheet(body: FlexibleBody) -> StaticBody:
        """The ``body`` with stiffness and mass proportional to its density."""
        # a frame that retains no motion of an interface needs one mode, which is not looked at
        modes = 0 if body.reduction.n_constraint else 1
        return StaticBody(body.with_interpolation(PLATE).with_modes(modes))

    def respond(self, density: Array) -> UnitResponse:
        """Displacements and work by unit loads, at a ``density`` of shape (cells,).

        The unit loads are unit accelerations of the frame, and unit forces and moments at each
        marker.
        """
        body, d = self.body, self.body.domain.dimension
        reduced = body.reduce(density)
        factored = body.factored(reduced)
        elasticity, clamped = body.elasticity, body.reduction.clamped
        inertia = elasticity.apply(factored.matrices.mass, self.fields)
        constraint = reduced.basis.constraint
        inside, projected = [-inertia], [-elasticity.inner(constraint, inertia)]
        for name, marker in reduced.integrals.markers.items():
            shapes = np.vstack([marker.displacement, np.atleast_2d(marker.rotation)])
            projected.append(shapes[:, : constraint.shape[1]].T)
            units = np.eye(3 * d - 3)
            if name in body.markers:
                inside.append(body.markers[name].pullback(units[:d], units[d:]))
            else:  # an interface, of which only the motion that the frame retains matters
                inside.append(np.zeros((len(inertia), len(units))))
        loads, on_constraint = np.hstack(inside), np.hstack(projected)
        loads[clamped] = 0.0
        static = factored.solve(loads)
        stiffness = reduced.integrals.K[: len(on_constraint), : len(on_constraint)]
        motion = np.linalg.solve(stiffness, on_constraint)
        work = elasticity.inner(loads, static) + on_constraint.T @ motion
        resultants = elasticity.inner(self.fields, inertia) @ self.rigid
        return UnitResponse(static + constraint @ motion, 0.5 * (work + work.T), resultants)


@dataclass(frozen=True, eq=False)
class BodyHistory:
    """The displacement history of one body, as far as a bound depends on it.

    Attributes:
        loads: y_k for each field F_k, shape (dofs, fields).
        strains: w_l, shape (dofs, l).
        by_mass: Integral of the first part of g over each cell of this rank, shape (cells,).
        by_stiffness: Likewise of the second part.
    """

    loads: Block
    strains: Block
    by_mass: Array
    by_stiffness: Array

    @property
    def integrals(self) -> Array:
        """Integral of g over each cell of this rank, shape (cells,)."""
        return self.by_mass + self.by_stiffness


class Support(NamedTuple):
    """A bound of psi that is affine in the densities, from one history of displacements."""

    weights: dict[str, float]  #: Of the load cases
    constant: float  #: Its value without any material
    histories: dict[str, BodyHistory]  #: By body


class Driven:
    """Loads of one load case on the designed bodies."""

    def __init__(self, problem: Problem, evaluation: Evaluation, name: str) -> None:
        case = problem.load_cases[name]
        bodies = problem.integrals(evaluation)
        objective = case.objective
        assert isinstance(objective, IntegralCompliance)
        counted = bodies if objective.bodies is None else objective.bodies
        of_bodies = objective.weights or {}
        #: Weights of the compliance of designed bodies
        self.weights = {n: float(of_bodies.get(n, 1.0)) * (n in counted) for n in problem.flexible}
        trajectory = rigid_trajectory(case.mechanism, bodies, case.method)
        self.loads: dict[str, DrivenLoads] = driven_loads(trajectory, list(problem.flexible))
        self.time_weights = time_weights(trajectory)

    def histories(self, responses: Mapping[str, UnitResponse]) -> dict[str, Array]:
        """Factors of the unit loads of each body over time, (instants, loads)."""
        factors = {}
        for name, loads in self.loads.items():
            forces = loads.forces.copy()
            for other, reaction in loads.reactions.items():
                resultants = self.loads[other].accelerations @ responses[other].inertia
                forces += np.einsum("tpe,te->tp", reaction, resultants)
            factors[name] = np.hstack([loads.accelerations, forces])
        return factors


@dataclass(frozen=True, eq=False)
class QuasiStatic:
    """Displacement histories of all load cases at one density of each body."""

    bodies: Mapping[str, StaticBody]
    cases: Mapping[str, Driven]
    densities: Mapping[str, Array]
    responses: Mapping[str, UnitResponse]

    @staticmethod
    def at(
        bodies: Mapping[str, StaticBody],
        cases: Mapping[str, Driven],
        densities: Mapping[str, Array],
    ) -> QuasiStatic:
        """The histories at ``densities`` by body; collective."""
        responses = {name: body.respond(densities[name]) for name, body in bodies.items()}
        return QuasiStatic(bodies, cases, densities, responses)

    @cached_property
    def histories(self) -> dict[str, dict[str, Array]]:
        """Factors of the unit loads, by load case and body."""
        return {name: case.histories(self.responses) for name, case in self.cases.items()}

    @cached_property
    def psi(self) -> dict[str, float]:
        """Integral compliance by load case."""
        compliances = {}
        for label, case in self.cases.items():
            compliances[label] = 0.0
            for name, factors in self.histories[label].items():
                compliance = np.sum(factors @ self.responses[name].work * factors, axis=1)
                compliances[label] += case.weights[name] * float(case.time_weights @ compliance)
        return compliances

    def support(self, weights: Mapping[str, float]) -> Support:
        """The bound that touches psi here, of the load cases with ``weights``; collective."""
        weighted, at_markers, constant = {}, {}, 0.0
        for label, case in self.cases.items():
            for name, factors in self.histories[label].items():
                over_time = weights[label] * case.weights[name] * case.time_weights
                weighted[label, name] = over_time[:, None] * factors
                markers = self.responses[name].work[:, len(self.bodies[name].rigid) :]
                at_markers[label, name] = weighted[label, name] @ markers
                constant += 2.0 * float(np.sum(case.loads[name].forces * at_markers[label, name]))
        histories = {}
        for name, body in self.bodies.items():
            response = self.responses[name]
            squares, by_loads, by_motions = np.zeros(()), np.zeros(()), np.zeros(())
            for label, case in self.cases.items():
                accelerations = case.loads[name].accelerations.T
                squares = squares + self.histories[label][name].T @ weighted[label, name]
                by_loads = by_loads + accelerations @ weighted[label, name]
                for other, loads in case.loads.items():  # whose deformation moves this body
                    motions = np.einsum(
                        "tpe,tp->te", loads.reactions[name], at_markers[label, other]
                    )
                    by_motions = by_motions + accelerations @ motions
            # loads have different units, and their energies have the same
            unit = np.sqrt(np.maximum(np.diag(response.work), 0.0))
            values, vectors = np.linalg.eigh(unit[:, None] * squares * unit)
            large = values > _RANK * values[-1]
            per_unit = np.divide(1.0, unit, out=np.zeros_like(unit), where=unit > 0.0)
            roots = per_unit[:, None] * vectors[:, large] * np.sqrt(values[large])
            moved = response.displacements @ by_loads.T - body.fields @ body.rigid @ by_motions.T
            histories[name] = self._history(name, moved, response.displacements @ roots)
        return Support(dict(weights), constant, histories)

    def _history(self, name: str, loads: Block, strains: Block) -> BodyHistory:
        """The history of a body with its integrals over cells; collective."""
        x, fields = self.densities[name], self.bodies[name].fields
        gradient = self.bodies[name].body.elasticity.density_gradient
        by_mass = gradient(x, FieldPairs.in_mass(fields, -2.0 * loads))
        energy = gradient(x, FieldPairs.in_stiffness(strains, strains)) / (1.0 - PLATE.floor)
        return BodyHistory(loads, strains, by_mass, -energy)
