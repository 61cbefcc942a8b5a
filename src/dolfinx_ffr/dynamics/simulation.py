# SPDX-License-Identifier: MIT
"""Simulation of a mechanism: start, and time integration."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from .. import validation
from ..body import VolumeIntegrals
from ..limits import available_memory
from ..mechanism import Mechanism
from .equilibrium import NoEquilibriumError
from .failures import SimulationError
from .initial import started
from .integration.compiled import compile_kernels
from .integration.radau import CONTROL, RadauIIA
from .integration.time_interval import TimeInterval
from .kinematics import mass_norm, norm_floors
from .load_steps import SAMPLING, LoadSteps, load_steps
from .model import assemble_model
from .trajectory import Integrator, Trajectory, at_rest
from .validity import warn_of_limits


def simulate(
    mechanism: Mechanism,
    bodies: Mapping[str, VolumeIntegrals],
    integrator: Integrator | TimeInterval | None = None,
    *,
    end_time: float | None = None,
    tolerance: float | None = None,
) -> Trajectory:
    """Trajectory of a mechanism, with given steps or to a given accuracy.

    With a tolerance, :class:`RadauIIA` takes shorter and shorter steps until the positions of all
    material points change by less than the tolerance when steps are twice as long: root mean square
    by mass, at any time, relative to the largest displacement from the start. The trajectory's
    ``error`` is the last change. The error itself is smaller, by up to 31 times; where unresolved
    vibrations make all of it, it is about as large. The errors of velocities and deformations, each
    relative to its own size, are larger. Forces in joints are accurate to the square root of the
    tolerance, as the trajectory's ``force_error`` tells; a warning comes where no steps follow
    them. For the error of an objective see :meth:`MechanicalProblem.with_tolerance`. A tolerance
    takes one and a half to twice the time of the last steps alone.

    Args:
        mechanism: The mechanism.
        bodies: Volume integrals of all bodies, by name.
        integrator: Time integration with its steps; or a :class:`TimeInterval`, which stands for
            its duration and its tolerance.
        end_time: Duration of the simulation, which starts at zero [s], instead of an integrator.
        tolerance: Largest relative error of the positions that is allowed until then.

    Returns:
        The trajectory; computed alike on every rank that calls, without communication.

    Raises:
        ValueError: If a name does not exist, a number is not valid, the mechanism cannot be
            assembled, not exactly one of integrator and duration is given, or a duration comes
            without a tolerance.
        MemoryError: If the trajectory would take more memory than the machine has.
        SimulationError: If Newton's method does not converge or the mechanism becomes singular;
            it names time, body and joint and keeps the trajectory so far. Likewise if a static
            equilibrium to start from is not found, or a tolerance is not reached.

    Warns:
        SofteningWarning: If a body turns faster than its lowest frequency.
        LargeDeformationWarning: If a body is deformed beyond what linear theory describes.
        TimeStepWarning: If given steps are too long for the motion.

    Example:
        >>> trajectory = simulate(mechanism, bodies, end_time=2.0, tolerance=1e-6)
        >>> trajectory.error  # estimate of what was reached
    """
    validation.instance("simulate: the mechanism", mechanism, Mechanism, "a Mechanism")
    if (integrator is None) == (end_time is None) or (integrator and tolerance is not None):
        raise ValueError("simulate: give either an integrator, or end_time and a tolerance")
    if end_time is not None:
        if tolerance is None:
            raise ValueError(
                "simulate: end_time needs a tolerance; or give an integrator with steps"
            )
        integrator = TimeInterval(end_time, tolerance)
    needed = "GeneralizedAlpha(...), RadauIIA(...) or TimeInterval(...)"
    try:
        if isinstance(integrator, TimeInterval):
            trajectory = _with_accurate_positions(mechanism, bodies, integrator)
        else:
            method = validation.instance("simulate: the integrator", integrator, Integrator, needed)
            trajectory = integrate(mechanism, bodies, method)
    except SimulationError as error:
        warn_of_limits(error.trajectory, complete=False)
        raise
    warn_of_limits(trajectory)
    return trajectory


def _with_accurate_positions(
    mechanism: Mechanism, bodies: Mapping[str, VolumeIntegrals], interval: TimeInterval
) -> Trajectory:
    """Trajectory whose positions change by less than a tolerance when steps are twice as long."""
    method = RadauIIA(interval.end_time, interval.tolerance)
    while True:
        trajectory = integrate(mechanism, bodies, method)
        ends, tables = trajectory.step_ends, trajectory.model.tables
        jumps = load_steps(tables, interval.end_time, SAMPLING.samples_of_a_look).corners
        longer = np.union1d(np.append(ends[:-1:2], ends[-1]), np.intersect1d(ends, jumps))
        twice_as_long = RadauIIA(interval.end_time, steps=longer)
        error = math.inf
        with suppress(SimulationError):  # steps twice as long may be too long
            coarse = integrate(mechanism, bodies, twice_as_long)
            error = _position_error(trajectory, coarse)
        trajectory = replace(trajectory, error=error)
        if error <= interval.tolerance:
            return trajectory

        method, steps = method.finer, ends.size - 1
        if method.tolerance <= 1.5 * CONTROL.tightest or steps > CONTROL.most_steps:
            raise SimulationError(
                f"the tolerance of {interval.tolerance:.1e} is out of reach: with {steps} steps "
                f"the estimated relative error of positions is {error:.1e}; take a larger "
                "tolerance, or name the times at which forces or motions jump (Mechanism.jumps): "
                "the motion is not smooth, magnifies errors, or has vibrations that need shorter "
                "steps",
                trajectory,
            )


def _position_error(fine: Trajectory, coarse: Trajectory) -> float:
    """Largest difference of the positions of all material points, over the largest displacement.

    Both are mass norms, at the times at which steps of both trajectories end; the displacement is
    from the start of the fine one.
    """
    common = np.intersect1d(fine.step_ends, coarse.step_ends)
    y, y_coarse = (r.y[np.searchsorted(r.t, common)] for r in (fine, coarse))
    arrays = fine.model.arrays
    difference = float(np.max(mass_norm(arrays, arrays.difference(y, y_coarse))))
    displacement = float(np.max(mass_norm(arrays, arrays.difference(fine.y, fine.y[0]))))
    floor = norm_floors(arrays, float(fine.t[-1]))[0]
    return difference / max(displacement, floor)


def integrate(
    mechanism: Mechanism, bodies: Mapping[str, VolumeIntegrals], integrator: Integrator
) -> Trajectory:
    """Trajectory with fixed steps, without warnings; raises the errors of :func:`simulate`."""
    validation.instances_by_name("bodies", bodies, VolumeIntegrals, "VolumeIntegrals")
    space = any(body.dimension == 3 for body in bodies.values())
    check_memory(integrator, [body.modes for body in bodies.values()], space=space)
    model = assemble_model(mechanism, bodies, integrator.times)
    compile_kernels(integrators=[type(integrator)], space=space)
    with one_thread():
        try:
            model, y0, v0 = started(model)
        except NoEquilibriumError as error:
            at_start = at_rest(model, model.times[:1], integrator)
            raise SimulationError(str(error), at_start) from error
        return integrator.integrate(model, y0, v0)


def load_cells(
    mechanism: Mechanism, bodies: Mapping[str, VolumeIntegrals], end_time: float
) -> tuple[LoadSteps, bool]:
    """Steps that resolve loads and prescribed motions, and whether anything damps vibrations."""
    validation.instances_by_name("bodies", bodies, VolumeIntegrals, "VolumeIntegrals")
    model = assemble_model(mechanism, bodies, np.array([0.0, end_time]))
    return load_steps(model.tables, end_time), model.damped


def restored(
    mechanism: Mechanism,
    bodies: Mapping[str, VolumeIntegrals],
    integrator: Integrator,
    numbers: Mapping[str, Any],
) -> Trajectory:
    """A trajectory that another rank has computed, from its `Trajectory.numbers`."""
    model = assemble_model(mechanism, bodies, integrator.times, checked=True)
    if not np.array_equal(model.times, numbers["t"]):  # instants within steps, or chosen ones
        model = model.at(numbers["t"])
    model = model.counting_from(numbers["turns"][:1])
    return Trajectory(**numbers, model=model, integrator=integrator)


def required_memory(
    integrator: Integrator, modes: Iterable[int], *, adjoint: bool = False, space: bool = False
) -> int:
    """Estimate of the memory of a trajectory of bodies with so many modes, 0 of adaptive steps."""
    sizes = [(6 if space else 3) + number for number in modes]
    n, rows = sum(sizes), (6 if space else 3) * len(sizes)
    # Coordinates with three derivatives, multipliers of two kinds, tables of loads and of vectors
    # with two derivatives each, while they are made; then stretches of a trajectory that are
    # joined, or derivatives, their copies and adjoints.
    passing = 15 if adjoint else 9 if integrator.stages > 1 else 4
    numbers = (4 + passing) * n + 25 * rows + 10
    return 8 * numbers * integrator.instants


def check_memory(
    integrator: Integrator,
    modes: Iterable[int],
    available: int | None = None,
    *,
    adjoint: bool = False,
    space: bool = False,
) -> None:
    """Refuse, by a MemoryError, a trajectory beyond the available memory of the machine [bytes]."""
    required = required_memory(integrator, modes, adjoint=adjoint, space=space)
    limit = available_memory() if available is None else available
    if required > limit:
        subject = "a motion and its adjoint" if adjoint else "a motion"
        raise MemoryError(
            f"{subject} of {integrator.instants:,} instants would take some "
            f"{required / 1e9:,.0f} GB, and there are {limit / 1e9:,.1f} GB on this machine for "
            "each process; take fewer steps, or RadauIIA with a tolerance, which takes as many as "
            "it needs"
        )


_controller: ThreadpoolController | None = None


def one_thread():  # type: ignore[no-untyped-def]
    """Context in which BLAS runs on one thread: for small matrices more threads cost time."""
    global _controller
    if _controller is None:
        _controller = ThreadpoolController()
    return _controller.limit(limits=1, user_api="blas")
