# SPDX-License-Identifier: MIT
"""Discrete adjoint of the simulation: derivatives with respect to the integrals of the bodies."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..body import VolumeIntegrals
from .initial import start_pullback
from .kinematics import (
    Samples,
    field_bars,
    integral_bars,
    marker_bar,
    metric_bars,
    vector_bars,
)
from .mechanism_bars import MechanismBars, without_markers
from .simulation import check_memory, one_thread
from .trajectory import Trajectory, TrajectoryBar, TrajectoryPullback


@dataclass(frozen=True)
class Bars:
    """Derivatives of a number with respect to the bodies and to the mechanism."""

    bodies: dict[str, VolumeIntegrals]  #: By the integrals of all bodies, by name
    _trajectory: Trajectory = field(repr=False)
    _pulled: TrajectoryPullback = field(repr=False)

    @cached_property
    def mechanism(self) -> MechanismBars:
        """By all that the mechanism says, at fixed bodies; formed when it is asked for."""
        with one_thread():
            return _by_mechanism(self._trajectory, self._pulled)


def adjoint(trajectory: Trajectory, bar: TrajectoryBar) -> Bars:
    """Derivatives of a number with respect to all bodies and all that the mechanism says.

    The transpose of the computed time steps, of the method's first acceleration and of the start,
    solved backward once. It is the exact derivative of the computed numbers, for any step, and
    tends to the adjoint system of the continuous problem as the step tends to zero (A. Held,
    S. Knüfer, R. Seifried, Structural sensitivity analysis of flexible multibody systems modeled
    with the floating frame of reference approach using the adjoint variable method, Multibody
    System Dynamics 40 (2017), doi:10.1007/s11044-016-9540-9). The cost does not depend on the
    number of parameters.

    The derivatives by bodies are by name, those by the markers' positions and shape functions
    included, the start among what depends on them. Those by the mechanism have the start apart.
    The number's own dependence on the integrals, at fixed trajectory, is not included.
    """
    model, size, rows = trajectory.model, trajectory.y.shape, trajectory.multipliers.shape
    for name, shape in (("y", size), ("v", size), ("w", size), ("multipliers", rows)):
        array = getattr(bar, name)
        if array.shape != shape:
            raise ValueError(f"bar.{name} must have shape {shape}, but it has shape {array.shape}")
        if not np.all(np.isfinite(array)):
            raise ValueError(f"bar.{name} holds NaN or infinity")
    modes = [body.modes for body in model.bodies.values()]
    check_memory(trajectory.integrator, modes, adjoint=True, space=model.dimension == 3)
    with one_thread():
        pulled = trajectory.integrator.pullback(trajectory, bar)
        samples, markers = pulled.samples, pulled.marker_bars
        # without the start, whose transpose adds to these
        names = ("y_bar", "v_bar", "marker_bars")
        without_start = {name: getattr(pulled, name).copy() for name in names}
        static = start_pullback(
            model, trajectory.y[0], trajectory.v[0], pulled.y_bar, pulled.v_bar, markers
        )
        if static is not None:
            at_rest, instant = np.zeros((1, model.size)), np.zeros(1, dtype=np.int64)
            samples += Samples(instant, trajectory.y[:1], at_rest, at_rest, static[None])
        bars = {
            name: integral_bars(model.arrays, b, model.bodies[name], samples)
            + metric_bars(model.arrays, b, model.bodies[name], *pulled.corrections)
            for b, name in enumerate(model.bodies)
        }
    for (body, marker), number in model.markers.items():
        bars[body].markers[marker] += marker_bar(model.arrays, number, markers)
    for point in reversed(model.mechanism.point_masses):
        body, marker = point.marker
        bars[body] = model.bodies[body].point_mass_pullback(bars[body], marker, point.mass)
    # Loads of point masses alone are no integrals of the body.
    for name, bar_of_body in bars.items():
        loads = model.bodies[name].stiffening.keys()
        stiffening = {load: K for load, K in bar_of_body.stiffening.items() if load in loads}
        bars[name] = replace(bar_of_body, stiffening=stiffening)
    return Bars(bars, trajectory, pulled._replace(**without_start))


def _by_mechanism(trajectory: Trajectory, pulled: TrajectoryPullback) -> MechanismBars:
    """Derivatives by all that the mechanism says, the start apart."""
    model, samples = trajectory.model, pulled.samples
    arrays = {**pulled.table_bars, **vector_bars(model.arrays, pulled.marker_bars)}
    bodies, count = {}, len(model.bodies)
    gravity, alpha, beta = 0.0 * model.arrays.gravity, np.zeros(count), np.zeros(count)
    for b, (name, integrals) in enumerate(model.bodies.items()):
        fall, alpha[b], beta[b] = field_bars(model.arrays, b, samples)
        gravity += fall
        bar = integral_bars(model.arrays, b, integrals, samples)
        bar += metric_bars(model.arrays, b, integrals, *pulled.corrections)
        bodies[name] = without_markers(bar)
    arrays |= {"gravity": gravity, "alpha": alpha, "beta": beta}
    return MechanismBars(arrays, bodies, pulled.y_bar, pulled.v_bar)
