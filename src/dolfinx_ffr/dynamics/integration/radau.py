# SPDX-License-Identifier: MIT
"""Radau IIA method of order 5 with steps that follow from a tolerance.

The stage equations are in stages.py. The error of a step is the difference from an embedded formula
of order 3, relative to the norms of the trajectory: the mass norms of the velocities and of the
displacement from the start, and the energy norm of the elastic part. In the directions of joints,
which that formula does not see, it is the jump of accelerations and of multipliers from one step
to the next. The steps are chosen by a
proportional-integral controller (K. Gustafsson, Control-theoretic techniques for stepsize selection
in implicit Runge-Kutta methods, ACM Transactions on Mathematical Software 20 (1994),
doi:10.1145/198429.198437), a few equal ones at a time. A run with a large tolerance comes first: it
finds the norms.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import ClassVar, NamedTuple

import numpy as np

from ... import validation
from ...arrays import Array
from ..compilation import Compiled, Table
from ..failures import SimulationError, diagnosis
from ..kinematics import Kinematics, Samples, mass_norm, norm_floors
from ..load_steps import SAMPLING, LoadSteps, equal_steps, load_steps
from ..model import FlatModel
from ..trajectory import (
    Integrator,
    Trajectory,
    TrajectoryBar,
    TrajectoryPullback,
    at_rest,
    joined,
    leading,
)
from .linear import linear_system
from .stage_loops import OF_FORCES, REJECTED, backward, march
from .stages import NODES, A, Stages
from .start import (
    CONVERGED,
    NO_START,
    accelerations,
    accelerations_at_jump,
    accelerations_pullback,
    start_accelerations,
    start_accelerations_pullback,
)
from .steps import step_bars


@dataclass(frozen=True)
class StepControl:
    """Options for the choice of steps during a run."""

    tightest: float = 1e-13  #: Least tolerance.
    #: Largest tolerance, and that of the run which finds the norms of the motion.
    loosest: float = 0.1
    most_at_once: int = 16  #: Most steps between two looks at the error.
    first_step: float = 1e-3  #: First step to try, in parts of the duration.
    #: Steps below this share of the duration mean that the motion cannot be followed.
    shortest: float = 1e-11
    #: Steps beyond which no smaller tolerance is tried for the sake of the positions.
    most_steps: int = 2**17
    #: Share of the duration, or of a step, below which two times count as the same.
    same_time: float = 1e-9
    no_jump: float = 1e-9  #: A jump of accelerations below this share of them is round-off.
    steps_for_one: int = 50  #: Steps of a motion for which there is one at least between jumps.
    #: Share of the duration below which steps are the less judged by their multipliers, so that a
    #: force that jumps at a time that nobody named ends no motion: loads are sampled no closer.
    brief: float = 1.0 / SAMPLING.samples
    #: Exponent of the tolerance in the error of the embedded formula, whose order is 4 of 6.
    exponent: float = 2.0 / 3.0
    #: Exponents of the error of a step and of the one before in the controller.
    proportional: float = 0.7 / 4.0
    integral: float = 0.4 / 4.0
    #: Share of the step that the error allows which is taken.
    safety: float = 0.9
    #: Least and largest factor from one step to the next.
    least_factor: float = 0.2
    largest_factor: float = 4.0
    after_rejection: float = 0.7  #: Largest factor after a step with too large an error.
    after_divergence: float = 0.25  #: Factor after a step for which Newton's method failed.
    #: Factors between these leave the step as it is, and twice as many are taken at once.
    steady: tuple[float, float] = (0.95, 1.2)


CONTROL = StepControl()


@dataclass(frozen=True)
class RadauIIA(Integrator):
    """Radau IIA method of order 5 with adaptive steps, for the stabilised index-2 equations.

    Takes the steps that a tolerance needs: long ones where the motion is smooth, short ones where
    it is not. Fifth-order accurate in positions and velocities, third-order in accelerations and
    multipliers, fifth-order in objectives, which are integrated with the weights of the method;
    constraints hold to round-off in positions and in velocities, and vibrations that no step
    resolves are damped at once. Steps end at the known jumps of loads and prescribed motions
    (:attr:`Motion.jumps`, :attr:`Mechanism.jumps`), across which no order holds. Prefer it for a
    given accuracy, or where fast and slow phases alternate; :class:`GeneralizedAlpha` for the same
    steps with all designs.

    A gradient is exact for the computed trajectory with the steps that were taken. The steps may
    differ from one design to the next, and psi jumps by an amount within the tolerance then; with
    ``steps`` they are the same for all designs.

    References:
        E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., Springer 1996,
        sections IV.8 and VII.4, doi:10.1007/978-3-642-05221-7.

    Example:
        >>> trajectory = simulate(mechanism, bodies, RadauIIA(2.0, tolerance=1e-8))
        >>> trajectory.error  # estimate of what was reached
        >>> again = RadauIIA(2.0, steps=trajectory.step_ends)  # the same steps for other bodies

    Attributes:
        end_time: Duration of the simulation, which starts at zero [s].
        chosen_for: Relative error of an objective for which a `TimeInterval` chose these steps,
            else None.
        tolerance: Relative error of the motion that no step exceeds. Vibrations count as much as
            slow deformation: an objective that hardly depends on them is far more accurate. A
            motion that magnifies errors, through a singular position for instance, is less
            accurate. At 1e-6 psi has four to five correct digits where a body vibrates and seven or
            more where it does not (benchmarks/integration.py); three more digits take three to
            eight times the steps. Forces in joints limit the steps, too, also of a machine whose
            motion is prescribed: at single instants they are accurate to the square root of the
            tolerance (`Trajectory.force_error`), and their integrals over time far better.
        steps: Fixed steps instead of the tolerance: the number of steps, which are equal from one
            jump to the next, or the times at which steps end beside the jumps, from 0 to
            ``end_time`` [s], such as the ``step_ends`` of a trajectory.
    """

    order: ClassVar[int] = 5
    stages: ClassVar[int] = 3
    compiled: ClassVar[tuple[Compiled, ...]] = (
        accelerations,
        accelerations_pullback,
        march,
        backward,
    )

    tolerance: float = 1e-6
    steps: int | Sequence[float] | Array | None = field(default=None)

    def __post_init__(self) -> None:
        validation.number("end_time", self.end_time, above=0.0, unit="s")
        validation.number("tolerance", self.tolerance, least=CONTROL.tightest, most=CONTROL.loosest)
        if self.steps is None:
            return
        if np.ndim(self.steps) == 0:
            validation.integer("steps", self.steps, least=1)
            return
        ends = validation.numbers("steps", self.steps)
        if ends.ndim != 1 or ends.size < 2 or not np.all(np.diff(ends) > 0.0):
            raise ValueError("steps must be a number, or times that grow from 0 to end_time")
        if ends[0] != 0.0 or not math.isclose(ends[-1], self.end_time, rel_tol=1e-12):
            raise ValueError(
                f"steps must go from 0 to end_time = {self.end_time} s, but they go from {ends[0]} "
                f"to {ends[-1]} s"
            )
        object.__setattr__(self, "steps", tuple(float(end) for end in ends))

    @property
    def _count(self) -> int | None:
        """Number of fixed steps, where it was given as a number."""
        return None if self.steps is None or np.ndim(self.steps) else int(self.steps)  # type: ignore[arg-type]

    @property
    def finer(self) -> RadauIIA:
        if self.steps is None:
            return replace(self, tolerance=max(0.1 * self.tolerance, CONTROL.tightest))
        if self._count is not None:
            return replace(self, steps=2 * self._count)
        times = self.times
        return replace(self, steps=np.union1d(times, 0.5 * (times[1:] + times[:-1])))

    @property
    def times(self) -> Array:
        if self.steps is None:
            return np.array([0.0, self.end_time])
        if self._count is not None:
            return np.linspace(0.0, self.end_time, self._count + 1)
        return np.array(self.steps)

    @property
    def instants(self) -> int:
        if self.steps is None:
            return 0
        count = len(self.times) - 1 if self._count is None else self._count
        return 3 * count + 1

    @property
    def adaptive(self) -> bool:
        return self.steps is None

    def amplification(self, phase: float) -> float:
        z = 1j * phase
        over = 1.0 + z * (2.0 / 5.0 + z / 20.0)
        return float(abs(over / (1.0 - z * (3.0 / 5.0 - z * (3.0 / 20.0 - z / 60.0)))))

    def integrate(self, model: FlatModel, y0: Array, v0: Array) -> Trajectory:
        start = at_rest(model, np.zeros(1), self)
        start.y[0], start.v[0] = y0, v0
        kinematics = Kinematics(model.arrays)
        kinematics.begin(y0)
        start = replace(start, turns=kinematics.turns(1))
        at_start = start_accelerations(kinematics, 0, y0, v0)
        if at_start is None:
            raise SimulationError(NO_START, start)
        start.w[0], start.multipliers[0] = at_start

        if self.steps is not None:
            ends = _step_ends(self, _jumps_inside(model, self))
            march_state = _March(model.at(_stage_times(ends)), start)
            march_state.in_steps(ends)
            return march_state.trajectory()

        loads = load_steps(model.tables, self.end_time, SAMPLING.samples_of_a_look)
        # no step follows the forces under a load that is noise
        if loads.resolved:
            try:
                return self._adaptive(model, start, loads, by_forces=True).trajectory()
            except SimulationError:
                # Where links come into line, forces grow without bound: steps that follow them come
                # to no end, and longer ones pass.
                pass
        march_state = self._adaptive(model, start, loads, by_forces=False)
        return replace(march_state.trajectory(), force_error=math.nan)

    def _adaptive(
        self, model: FlatModel, start: Trajectory, loads: LoadSteps, *, by_forces: bool
    ) -> _March:
        """The motion in steps that keep the tolerance, after a run that finds its norms.

        Forces in joints limit the steps `by_forces`, too.
        """
        brief = CONTROL.brief * self.end_time if by_forces else math.inf
        march_state = _March(model, start, loads, brief)
        first_step = CONTROL.first_step * self.end_time
        if self.tolerance < CONTROL.loosest:
            march_state.adaptively(CONTROL.loosest, first_step)
            first_step = march_state.first_step * (self.tolerance / CONTROL.loosest) ** (1.0 / 6.0)
            march_state.begin_anew()
        march_state.adaptively(self.tolerance, first_step)
        return march_state

    def pullback(self, trajectory: Trajectory, bar: TrajectoryBar) -> TrajectoryPullback:
        model, rows = trajectory.model, trajectory
        if model.arrays.turning:  # the transpose changes them to coordinates within each step
            rows = replace(trajectory, y=trajectory.y.copy(), v=trajectory.v.copy())
        kinematics = Kinematics(model.arrays, trajectory.turns)
        lengths = np.diff(trajectory.step_ends)
        stages = _stages(rows, lengths, np.zeros((lengths.size, 4)), _state(model))
        bars = step_bars(bar.y, bar.v, bar.w, bar.multipliers)
        system = Table(linear_system(3 * (model.size + 2 * model.rows)))
        if backward(kinematics.table, Table(stages), Table(bars), system) != CONVERGED:
            t = trajectory.t[stages.last[0]]
            raise RuntimeError(f"the matrix of the step at t = {t:.6g} s is singular")
        state = trajectory.y[0], trajectory.v[0], trajectory.w[0], trajectory.multipliers[0]
        y_bar, v_bar, bars.adjoint[0] = start_accelerations_pullback(
            kinematics, 0, state, bars.w[0], bars.lam[0]
        )
        instants = np.arange(trajectory.t.size)
        return TrajectoryPullback(
            Samples(instants, trajectory.y, trajectory.v, trajectory.w, bars.adjoint),
            (bars.left, bars.right),
            bars.start[0] + bars.y[0] + y_bar,
            bars.start[1] + bars.v[0] + v_bar,
            kinematics.marker_bars,
            kinematics.table_bars,
        )


def _stage_times(ends: Array) -> Array:
    """Times of all stages, the start first, (3 steps + 1,), from the ends of steps (steps + 1,)."""
    inner = ends[:-1, None] + np.diff(ends)[:, None] * NODES
    inner[:, 2] = ends[1:]
    return np.concatenate([ends[:1], inner.ravel()])


def _step_ends(integrator: RadauIIA, jumps: Array) -> Array:
    """Ends of fixed steps, the jumps among them [s]."""
    times = integrator.times
    if jumps.size == 0:
        return times
    if integrator._count is None:
        shortest = CONTROL.same_time * float(np.min(np.diff(times)))
        new = jumps[np.min(np.abs(jumps[:, None] - times), axis=1) > shortest]
        return np.union1d(times, new)
    corners = np.array([0.0, *jumps, integrator.end_time])
    length = integrator.end_time / integrator._count
    # However close two jumps are: with twice as many steps there are more between them, too.
    fewest = math.ceil(integrator._count / CONTROL.steps_for_one)
    return equal_steps(corners, np.diff(corners) / length, fewest)


def _jumps_inside(model: FlatModel, integrator: Integrator) -> Array:
    """Jumps between the start and the end [s]."""
    jumps, least = model.tables.jumps, CONTROL.same_time * integrator.end_time
    jumps = jumps[(jumps > least) & (jumps < integrator.end_time - least)]
    return jumps[np.diff(jumps, prepend=0.0) > least]


def _state(model: FlatModel) -> dict[str, Array]:
    """What the compiled loop hands on from call to call, see :class:`Stages`."""
    n = model.size
    return {
        "sizes": np.zeros(4),
        "brief": np.zeros(1),
        "reference": np.zeros(n),
        "factor_state": np.zeros(2),
        "weight": np.zeros(n),
        "mass": np.zeros((n, n)),
    }


def _stages(rows: Trajectory, lengths: Array, errors: Array, state: dict[str, Array]) -> Stages:
    """Arrays of a trajectory and a state for the compiled loops, without copies."""
    n, constraints = rows.y.shape[1], rows.multipliers.shape[1]
    return Stages(
        lengths=lengths,
        y=rows.y,
        v=rows.v,
        w=rows.w,
        lam=rows.multipliers,
        eta=rows.stabilization,
        iterations=rows.iterations,
        last=np.zeros(1, dtype=np.int64),
        errors=errors,
        w_before=np.zeros((3, n)),
        lam_before=np.zeros((3, constraints)),
        **state,
    )


class _Attempt(NamedTuple):
    """Steps that were tried at once."""

    outcome: int  #: Of the compiled loop.
    good: int  #: Number of steps before the one that failed.
    rows: Trajectory  #: All of them, with their start.
    errors: Array  #: Norms of their errors, shape (steps, 4).


@dataclass
class _StepSize:
    """Proportional-integral controller of the steps' length, and of how many are taken at once."""

    length: float  #: Of the next steps [s].
    longest: float  #: Largest length [s].
    batch: int = 1  #: Number of steps that are taken at once.
    #: Largest error of the steps before, in parts of the admissible one.
    last_error: float = 1.0

    def begin_anew(self) -> None:
        """Forget the steps before, behind which the motion is another one."""
        self.batch, self.last_error = 1, 1.0

    def ends(self, t: float, end: float) -> Array:
        """Ends of the next steps from t [s], the first of them t; none goes beyond the end."""
        count = math.ceil((end - t) / self.length * (1.0 - 1e-9))
        if count <= self.batch:
            return np.linspace(t, end, max(count, 1) + 1)
        return t + self.length * np.arange(self.batch + 1)

    def accepted(self, error: float) -> None:
        """Adapt to steps with an error in parts of the admissible one."""
        error = max(error, 1e-8)
        factor = CONTROL.safety * error**-CONTROL.proportional
        factor *= self.last_error**CONTROL.integral
        self.last_error = error
        if CONTROL.steady[0] < factor < CONTROL.steady[1]:
            self.batch = min(2 * self.batch, CONTROL.most_at_once)
            return
        self.length *= min(max(factor, CONTROL.least_factor), CONTROL.largest_factor)
        self.length = min(self.length, self.longest)
        self.batch = min(self.batch + 1, CONTROL.most_at_once) if factor < 1.5 else 1

    def rejected(self, error: float) -> None:
        """Shorten a step whose error was too large."""
        factor = CONTROL.safety * min(max(error, 1.0), 1e8) ** (-1.0 / 4.0)
        self.length *= min(max(CONTROL.least_factor, factor), CONTROL.after_rejection)
        self.begin_anew()

    def diverged(self) -> None:
        """Shorten a step for which Newton's method failed."""
        self.length *= CONTROL.after_divergence
        self.begin_anew()


class _March:
    """State of the integration between two calls of the compiled loop."""

    def __init__(
        self,
        model: FlatModel,
        start: Trajectory,
        loads: LoadSteps | None = None,
        brief: float = float(np.finfo(float).tiny),
    ) -> None:
        """Begin at a start, with steps for the `loads` and motions where steps are adaptive.

        Steps below a `brief` length [s] are the less judged by their multipliers.
        """
        self.model, self.start, self.integrator = model, start, start.integrator
        self.end_time = start.integrator.end_time
        self.norms = norm_floors(model.arrays, self.end_time)
        self.jumps = _jumps_inside(model, self.integrator)
        self.corners, self.ends = model.tables.jumps, [self.end_time]
        if loads is not None:
            self.corners = np.union1d(self.corners, loads.corners)
            # Steps end where loads or motions change so fast that a step might not see it.
            inside = np.union1d(self.jumps, loads.special)
            self.ends = [*inside.tolist(), self.end_time]
        size = model.size + 2 * model.rows
        self.system, self.small = Table(linear_system(3 * size)), Table(linear_system(size))
        self.state = _state(model)
        self.state |= {"sizes": self.norms, "brief": np.full(1, brief), "reference": start.y[0]}
        self._kinematics: Kinematics | None = None
        self.begin_anew()

    def begin_anew(self) -> None:
        """Go back to the start, with the norms that have been found."""
        self.stretches = [self.start]
        self.largest_errors = np.zeros((1, 4))
        for name in ("factor_state", "weight", "mass"):
            self.state[name][:] = 0.0

    @property
    def t(self) -> float:
        return float(self.stretches[-1].t[-1])

    @property
    def first_step(self) -> float:
        """Length of the first step [s]."""
        return float(self.stretches[1].t[3] - self.stretches[1].t[0])

    def trajectory(self) -> Trajectory:
        """The motion so far."""
        trajectory = joined(self.stretches, [0, *[1] * (len(self.stretches) - 1)])
        t, model = trajectory.t, self.model
        if not np.array_equal(t, model.times):
            model = model.at(t)
        weights = np.zeros(t.size)
        weights[1:] = np.ravel(np.diff(t[::3])[:, None] * A[2])
        return replace(
            trajectory,
            a=trajectory.w,
            model=model,
            weights=weights,
            error=_relative(self.largest_errors, self.norms) ** (1.0 / CONTROL.exponent),
            force_error=float(self.largest_errors[0, 3] / self.norms[3]),
        )

    def in_steps(self, ends: Array) -> None:
        """Take all steps with the given ends, the start first; their stages are tabulated."""
        at_jumps = np.flatnonzero(np.isin(ends, self.jumps))
        for begin, end in pairwise([0, *at_jumps, ends.size - 1]):
            arrays = self.model.between(3 * begin, 3 * end + 1)
            kinematics = Kinematics(arrays, self.stretches[-1].turns[-1:])
            attempt = self.advance(ends[begin : end + 1], math.inf, kinematics)
            if attempt.outcome != CONVERGED:
                raise self.failure(attempt)

    def adaptively(self, tolerance: float, first_step: float) -> None:
        """Go on to the end in steps that keep a tolerance, the first one as long as given.

        The norms grow on the way.
        """
        limit = tolerance**CONTROL.exponent
        step = _StepSize(min(first_step, self.end_time), self.end_time)
        while self.t < self.end_time:
            if self.t in self.ends:
                step.begin_anew()
            end = next(end for end in self.ends if end > self.t)
            attempt = self.advance(step.ends(self.t, end), limit)
            if attempt.outcome == CONVERGED:
                step.accepted(_relative(attempt.errors, self.norms) / limit)
                continue

            if attempt.outcome == REJECTED:
                errors_of_step = attempt.errors[attempt.good : attempt.good + 1]
                step.rejected(_relative(errors_of_step, self.norms) / limit)
            else:
                step.diverged()
            if step.length < CONTROL.shortest * self.end_time:
                raise self.failure(attempt)

    def advance(self, ends: Array, limit: float, kinematics: Kinematics | None = None) -> _Attempt:
        """Take steps from ends[0], the present time, to the others.

        The equations of motion are tabulated at the stages of the steps where no `kinematics` are
        given.
        """
        so_far = self.stretches[-1]
        rows = at_rest(self.model, _stage_times(ends), self.integrator)
        for name in ("y", "v", "w", "multipliers", "stabilization"):
            getattr(rows, name)[0] = getattr(so_far, name)[-1]
        lengths = np.diff(ends)
        errors = np.zeros((lengths.size, 4))
        last_step, stages = 0.0, _stages(rows, lengths, errors, self.state)
        # No polynomial goes on behind a jump.
        if so_far.steps and not self._jumps(rows):
            last_step = float(so_far.t[-1] - so_far.t[-4])
            stages.w_before[:], stages.lam_before[:] = so_far.w[-3:], so_far.multipliers[-3:]
        if kinematics is None:
            kinematics = self._kinematics_at(rows.t, so_far.turns[-1:])
        kinematics.begin(rows.y[0])
        outcome = march(kinematics.table, Table(stages), self.system, self.small, last_step, limit)

        good = int(stages.last[0])
        if so_far.turns.size:
            rows = replace(rows, turns=kinematics.turns(rows.t.size))
        if good:
            self.stretches.append(leading(rows, good))
            largest_of_these = np.max(errors[:good], axis=0)
            self.largest_errors = np.maximum(self.largest_errors, largest_of_these)
        return _Attempt(outcome, good, rows, errors)

    def _kinematics_at(self, times: Array, turns: Array) -> Kinematics:
        """Equations of motion at times (instants,) [s], whose angles count on from turns.

        Their arrays serve all batches: to make them takes as long as some steps.
        """
        kinematics, tabulate = self._kinematics, self.model.tables.tabulate
        if kinematics is not None and len(kinematics.model.drive) >= times.size:
            kinematics.set_tables(tabulate(times), turns)
            return kinematics
        missing = max((3 * CONTROL.most_at_once + 1) - times.size, 0)
        tables = tabulate(np.append(times, np.full(missing, times[-1])))
        self._kinematics = Kinematics(self.model.arrays._replace(**tables), turns)
        return self._kinematics

    def _jumps(self, rows: Trajectory) -> bool:
        """Add the jumps of accelerations and multipliers at the start, if there are any.

        Each is the difference of two solutions at the same state. Either of them alone would differ
        from the last stage by the vibrations that no step resolves.
        """
        t, model = float(rows.t[0]), self.model.counting_from(self.stretches[-1].turns[-1:])
        if t not in self.corners:
            return False
        # One that nobody named is known to some units in the last place of the end time.
        named = t in model.tables.jumps
        slack = 0.0 if named else SAMPLING.just_before * self.end_time
        sides = accelerations_at_jump(model, t, rows.y[0], rows.v[0], slack)
        if sides is None:
            return False
        (_, w, multipliers), (_, w_after, multipliers_after) = sides
        jump, usual = mass_norm(model.arrays, np.stack([w_after - w, w]))
        change, force = np.abs(multipliers_after - multipliers), np.abs(multipliers)
        forces_jump = np.max(change, initial=0.0) > CONTROL.no_jump * np.max(force, initial=0.0)
        if not jump > CONTROL.no_jump * usual and not forces_jump:
            return False
        rows.w[0] += w_after - w
        rows.multipliers[0] += multipliers_after - multipliers
        return True

    def failure(self, attempt: _Attempt) -> SimulationError:
        """The exception for a failed step."""
        so_far, rows, row = self.trajectory(), attempt.rows, 3 * attempt.good + 3
        length = rows.t[row] - rows.t[row - 3]
        if attempt.outcome == REJECTED:
            text = (
                f"at t = {rows.t[row - 3]:.6g} s steps of {length:.1e} s are too long for the "
                "tolerance: the motion cannot go on, or is not smooth there; look at the motion so "
                "far in the exception's trajectory"
            )
            return SimulationError(text, so_far)
        tried = replace(rows, model=self.model.at(rows.t))
        step = f"step {so_far.step_ends.size} of {length:.3g} s"
        iterations = int(rows.iterations[attempt.good])
        return SimulationError(diagnosis(tried, row, step, iterations, attempt.outcome), so_far)


def _relative(errors: Array, norms: Array) -> float:
    """Largest error of steps (steps, 4) relative to norms (4,), as of the fourth order.

    The errors of multipliers are those of one order less.
    """
    displacement, velocity, strain, force = (errors.max(axis=0, initial=0.0) / norms).tolist()
    return max(displacement, velocity, strain, force ** (1.0 / OF_FORCES))
