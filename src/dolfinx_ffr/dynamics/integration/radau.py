# SPDX-License-Identifier: MIT
"""Radau IIA method of order 5 with steps that follow from a tolerance.

The stage equations are those of stages.py. The error of a step is the difference from an embedded
formula of order 3, relative to the sizes of the motion: by mass that of velocities and of the way
from the start, by energy that of the elastic part. The steps are chosen by a proportional-integral
controller (K. Gustafsson, Control-theoretic techniques for stepsize selection in implicit
Runge-Kutta methods, ACM Transactions on Mathematical Software 20 (1994),
doi:10.1145/198429.198437), a few equal ones at a time. A run with a large tolerance comes
first: it tells the sizes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ... import validation
from ..compilation import Compiled, Table
from ..failures import SimulationError, diagnosis
from ..kinematics import Kinematics, least_sizes, sizes_by_mass
from ..model import FlatModel
from ..samples import Samples
from ..tables import BESIDE_JUMP
from ..trajectory import Integrator, Trajectory, TrajectoryBar, TrajectoryPullback
from .linear import linear_system
from .stage_loops import REJECTED, backward, march
from .stages import NODES, A, Stages
from .start import (
    CONVERGED,
    accelerations,
    accelerations_pullback,
    start_accelerations,
    start_accelerations_pullback,
)
from .steps import step_bars

__all__ = ["RadauIIA"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Most steps between two looks at the error.
_BATCH = 16
#: Bounds of the tolerance.
TIGHTEST, LOOSEST = 1e-13, 0.1
#: Tolerance of the run that tells the sizes.
_PILOT = 0.1
#: Steps below this share of the duration mean that the motion cannot be followed.
_SHORTEST = 1e-11
#: Share of the duration, or of a step, below which two times count as the same.
_SAME = 1e-9
#: A jump of the accelerations below this share of them is round-off.
_NO_JUMP = 1e-9
#: Error of the embedded formula at the tolerance t: _FACTOR t^(2/3), as its order is 4 of 6.
_FACTOR = 1.0


@dataclass(frozen=True)
class RadauIIA(Integrator):
    """Radau IIA method of order 5 with adaptive steps, for the stabilised index-2 equations.

    Takes the steps that a tolerance needs: long ones where the motion is smooth, short ones where
    it is not. Fifth-order accurate in positions and velocities, third-order in accelerations and
    multipliers, fifth-order in objectives, which are integrated with the weights of the method;
    constraints hold to round-off in positions and in velocities, and vibrations that no step
    resolves are damped at once. Steps end at the known jumps of what is prescribed
    (:attr:`Motion.jumps`, :attr:`Mechanism.jumps`), across which no order holds. Prefer it where
    an accuracy is asked for, or where fast and slow phases alternate; :class:`GeneralizedAlpha`
    where steps are to be the same for all designs.

    A gradient is the exact one of the computed motion at the steps that were taken. The steps may
    differ from one design to the next, and psi jumps by an amount within the tolerance then; with
    ``steps`` they are the same for all designs.

    References:
        E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., Springer 1996,
        sections IV.8 and VII.4, doi:10.1007/978-3-642-05221-7.

    Example:
        >>> trajectory = simulate(mechanism, bodies, RadauIIA(2.0, tolerance=1e-8))
        >>> trajectory.error  # estimate of what was reached
        >>> again = RadauIIA(2.0, steps=trajectory.step_ends)  # the same steps for other bodies

    Raises:
        ValueError: If a number is out of range.
    """

    order: ClassVar[int] = 5
    stages: ClassVar[int] = 3
    compiled: ClassVar[tuple[Compiled, ...]] = (
        accelerations,
        accelerations_pullback,
        march,
        backward,
    )

    #: Duration of the simulation, which starts at zero [s].
    end_time: float
    #: Error of the motion relative to its size that no step exceeds. Vibrations count for as much
    #: as slow deformation: an objective that hardly feels them is far more accurate. A motion that
    #: magnifies errors, through a singular position for instance, is less accurate. At 1e-6 psi
    #: has four to five correct digits where a body vibrates and seven or more where it does not
    #: (benchmarks/integration.py); three more digits take three to eight times the steps.
    tolerance: float = 1e-6
    #: First step to try [s]; None leaves it to the method.
    first_step: float | None = None
    #: Largest step [s]; None sets no limit.
    largest_step: float | None = None
    #: Fixed steps instead of the tolerance: the number of steps, which are equal from one jump to
    #: the next, or the times at which steps end beside the jumps, from 0 to ``end_time`` [s], such
    #: as the ``step_ends`` of a trajectory.
    steps: int | Sequence[float] | Array | None = field(default=None)
    #: Whether the steps were chosen for an accuracy of an objective, as by a :class:`TimeInterval`:
    #: then no warning tells that they are too long.
    judged: bool = field(default=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        """Check the numbers."""
        validation.number("end_time", self.end_time, above=0.0, unit="s")
        validation.number("tolerance", self.tolerance, least=TIGHTEST, most=LOOSEST)
        for name in ("first_step", "largest_step"):
            if getattr(self, name) is not None:
                validation.number(name, getattr(self, name), above=0.0, unit="s")
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
    def coarser(self) -> RadauIIA:
        if self.steps is None:
            return replace(self, tolerance=min(2.0**self.order * self.tolerance, LOOSEST))
        if np.ndim(self.steps) == 0:
            return replace(self, steps=max(int(self.steps) // 2, 1))  # type: ignore[arg-type]
        return replace(self, steps=np.append(self.times[:-1:2], self.end_time))

    @property
    def finer(self) -> RadauIIA:
        if self.steps is None:
            return replace(self, tolerance=max(0.1 * self.tolerance, TIGHTEST))
        if np.ndim(self.steps) == 0:
            return replace(self, steps=2 * int(self.steps))  # type: ignore[arg-type]
        times = self.times
        return replace(self, steps=np.union1d(times, 0.5 * (times[1:] + times[:-1])))

    @property
    def times(self) -> Array:
        if self.steps is None:
            return np.array([0.0, self.end_time])
        if np.ndim(self.steps) == 0:
            return np.linspace(0.0, self.end_time, int(self.steps) + 1)  # type: ignore[arg-type]
        return np.array(self.steps)

    @property
    def instants(self) -> int:
        if self.steps is None:
            return 0
        scalar = np.ndim(self.steps) == 0
        return 3 * (int(self.steps) if scalar else len(self.steps) - 1) + 1  # type: ignore[arg-type]

    @property
    def adaptive(self) -> bool:
        return self.steps is None

    @property
    def finest(self) -> bool:
        return self.adaptive and self.tolerance <= 1.5 * TIGHTEST

    @property
    def remedy(self) -> str:
        return (
            "ask for less, or name the times at which forces or motions jump (Mechanism.jumps): "
            "the motion is not smooth, magnifies errors, or has vibrations that take shorter steps"
        )

    def with_steps_of(self, trajectory: Trajectory) -> RadauIIA:
        return replace(self, steps=trajectory.step_ends)

    def toward(self, tolerance: float) -> RadauIIA:
        return replace(self, tolerance=tolerance) if self.adaptive else self

    def integrate(self, model: FlatModel, y0: Array, v0: Array) -> Trajectory:
        start = _Rows.empty(np.zeros(1), model)
        start.y[0], start.v[0] = y0, v0
        kinematics = Kinematics(model.arrays)
        kinematics.begin(y0)
        found = start_accelerations(kinematics, 0, y0, v0)
        if found is None:
            raise SimulationError(
                "the accelerations at the start cannot be found: the mass matrix of the bodies "
                "and the joints together are singular",
                _trajectory(self, model.at(start.t), start, np.ones(3)),
            )
        start.w[0], start.multipliers[0] = found
        sizes = least_sizes(model.arrays, self.end_time)
        if self.steps is not None:
            marching = _Marching(self, model, start, sizes)
            jumps = _jumps_inside(model, self)
            ends = _step_ends(self, jumps)
            at_jumps = np.flatnonzero(np.isin(ends, jumps))
            for first, last in pairwise([0, *at_jumps, ends.size - 1]):
                status, good, rows = marching.advance(ends[first : last + 1], math.inf)
                if status != CONVERGED:
                    raise _failure(marching, rows, good, status, "take smaller steps, or ")
            rows = _Rows.joined(marching.parts)
            return _trajectory(self, model.at(rows.t), rows, sizes)
        h = self.first_step
        if self.tolerance < _PILOT:
            _, first_step = _adaptive(model, start, sizes, self, _PILOT, h)
            h = h or first_step * (self.tolerance / _PILOT) ** (1.0 / 6.0)
        rows, _ = _adaptive(model, start, sizes, self, self.tolerance, h)
        return _trajectory(self, model.at(rows.t), rows, sizes)

    def pullback(self, trajectory: Trajectory, bar: TrajectoryBar) -> TrajectoryPullback:
        model, kinematics = trajectory.model, Kinematics(trajectory.model.arrays)
        rows = _Rows(
            trajectory.t,
            # where bodies turn in space the transpose puts them into coordinates within each step
            trajectory.y.copy() if model.dimension == 3 else trajectory.y,
            trajectory.v,
            trajectory.w,
            trajectory.multipliers,
            trajectory.stabilization,
            np.zeros((trajectory.iterations.size, 3)),
            trajectory.iterations,
        )
        stages = rows.stages(np.diff(trajectory.step_ends))
        bars = step_bars(bar.y, bar.v, bar.w, bar.multipliers)
        system = Table(linear_system(3 * (model.size + 2 * model.rows)))
        kinematics.follow(trajectory.y)
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
        )


def stage_times(ends: Array) -> Array:
    """Times of all stages, the start first, shape (3 steps + 1,) [s].

    Args:
        ends: Ends of the steps, shape (steps + 1,) [s].
    """
    inner = ends[:-1, None] + np.diff(ends)[:, None] * NODES
    inner[:, 2] = ends[1:]
    return np.concatenate([ends[:1], inner.ravel()])


def _step_ends(integrator: RadauIIA, jumps: Array) -> Array:
    """Ends of fixed steps, the jumps among them [s]."""
    times = integrator.times
    if jumps.size == 0:
        return times
    if np.ndim(integrator.steps) > 0:  # type: ignore[arg-type]
        shortest = _SAME * float(np.min(np.diff(times)))
        new = jumps[np.min(np.abs(jumps[:, None] - times), axis=1) > shortest]
        return np.union1d(times, new)
    corners = np.array([0.0, *jumps, integrator.end_time])
    length = integrator.end_time / int(integrator.steps)  # type: ignore[arg-type]
    counts = np.maximum(np.rint(np.diff(corners) / length).astype(int), 1)
    stretches = zip(corners, corners[1:], counts, strict=False)
    return np.concatenate([[0.0], *(np.linspace(a, b, n + 1)[1:] for a, b, n in stretches)])


def _jumps_inside(model: FlatModel, integrator: RadauIIA) -> Array:
    """Jumps between the start and the end [s]."""
    jumps, least = model.tables.jumps, _SAME * integrator.end_time
    jumps = jumps[(jumps > least) & (jumps < integrator.end_time - least)]
    return jumps[np.diff(jumps, prepend=0.0) > least]


@dataclass(eq=False)
class _Rows:
    """A stretch of the motion: its start, and three rows for each step."""

    t: Array
    y: Array
    v: Array
    w: Array
    multipliers: Array
    stabilization: Array
    #: Sizes of the errors, shape (steps, 3).
    errors: Array
    iterations: Integers

    @staticmethod
    def empty(t: Array, model: FlatModel) -> _Rows:
        y, v, w = (np.zeros((t.size, model.size)) for _ in range(3))
        multipliers, stabilization = (np.zeros((t.size, model.rows)) for _ in range(2))
        steps = t.size // 3
        errors, iterations = np.zeros((steps, 3)), np.zeros(steps, dtype=np.int64)
        return _Rows(t, y, v, w, multipliers, stabilization, errors, iterations)

    @staticmethod
    def joined(parts: Sequence[_Rows]) -> _Rows:
        def join(name: str, begin: int) -> NDArray:
            return np.concatenate(
                [getattr(part, name)[begin if i else 0 :] for i, part in enumerate(parts)]
            )

        names = ("t", "y", "v", "w", "multipliers", "stabilization")
        arrays = [*(join(name, 1) for name in names), join("errors", 0), join("iterations", 0)]
        return _Rows(*arrays)

    def stages(self, lengths: Array) -> Stages:
        """Arrays for the compiled loops, without copies; what they keep is zero."""
        n, rows = self.y.shape[1], self.multipliers.shape[1]
        return Stages(
            lengths=lengths,
            y=self.y,
            v=self.v,
            w=self.w,
            lam=self.multipliers,
            eta=self.stabilization,
            iterations=self.iterations,
            last=np.zeros(1, dtype=np.int64),
            errors=self.errors,
            sizes=np.zeros(3),
            reference=np.zeros(n),
            w_before=np.zeros((3, n)),
            lam_before=np.zeros((3, rows)),
            kept=np.zeros(2),
            weight=np.zeros(n),
            mass=np.zeros((n, n)),
        )

    def leading(self, steps: int) -> _Rows:
        rows = 3 * steps + 1
        names = ("t", "y", "v", "w", "multipliers", "stabilization")
        parts = (getattr(self, name)[:rows] for name in names)
        arrays = [*parts, self.errors[:steps], self.iterations[:steps]]
        return _Rows(*arrays)


class _Marching:
    """State of the integration between two calls of the compiled loop."""

    def __init__(self, integrator: RadauIIA, model: FlatModel, start: _Rows, sizes: Array) -> None:
        self.integrator, self.model, self.start, self.sizes = integrator, model, start, sizes
        self.parts = [start]
        size = model.size + 2 * model.rows
        self.system, self.small = Table(linear_system(3 * size)), Table(linear_system(size))
        self.weight, self.kept = np.zeros(model.size), np.zeros(2)
        self.turns: Array | None = None

    def advance(self, ends: Array, limit: float) -> tuple:
        """Steps to the given ends, the first of which is where the motion stands.

        Returns the outcome, the number of good steps and all steps that were tried.
        """
        last = self.parts[-1]
        rows = _Rows.empty(stage_times(ends), self.model)
        for name in ("y", "v", "w", "multipliers", "stabilization"):
            getattr(rows, name)[0] = getattr(last, name)[-1]
        before, stages = 0.0, rows.stages(np.diff(ends))
        # No polynomial goes on behind a jump.
        if last.errors.size and not self._jumps(rows):
            before = float(last.t[-1] - last.t[-4])
            stages.w_before[:], stages.lam_before[:] = last.w[-3:], last.multipliers[-3:]
        stages = stages._replace(
            sizes=self.sizes, reference=self.start.y[0], kept=self.kept, weight=self.weight
        )
        arrays = self.model.arrays._replace(**self.model.tables.tabulate(rows.t))
        equations = Kinematics(arrays)
        equations.begin(rows.y[0], self.turns)
        status = march(
            equations.table, Table(stages), self.system, self.small, float(before), float(limit)
        )
        good = int(stages.last[0])
        if good:
            self.parts.append(rows.leading(good))
            self.turns = equations.turns(3 * good)
        return status, good, rows

    def _jumps(self, rows: _Rows) -> bool:
        """Add to accelerations and multipliers at the start what they jump by, if they do.

        It is the difference of two solutions at the same state. Either of them alone would differ
        from the last stage by the vibrations that no step resolves.
        """
        t, y, v = float(rows.t[0]), rows.y[0], rows.v[0]
        if t not in self.model.tables.jumps:
            return False
        sides = []
        for share in (1.0 - BESIDE_JUMP, 1.0 + BESIDE_JUMP):
            tables = self.model.tables.tabulate(np.full(2, share * t))
            kinematics = Kinematics(self.model.arrays._replace(**tables))
            kinematics.begin(y, self.turns)
            found = start_accelerations(kinematics, 0, y, v)
            if found is None:
                return False
            sides.append(found)
        jump = sides[1][0] - sides[0][0]
        by_mass = sizes_by_mass(self.model.arrays, np.stack([jump, sides[0][0]]))
        if not by_mass[0] > _NO_JUMP * by_mass[1]:
            return False
        rows.w[0] += jump
        rows.multipliers[0] += sides[1][1] - sides[0][1]
        return True

    @property
    def t(self) -> float:
        return float(self.parts[-1].t[-1])

    @property
    def h(self) -> float:
        """Length of the last step."""
        return float(self.parts[-1].t[-1] - self.parts[-1].t[-4])


def _adaptive(
    model: FlatModel,
    start: _Rows,
    sizes: Array,
    integrator: RadauIIA,
    tolerance: float,
    first: float | None,
) -> tuple[_Rows, float]:
    """Motion with steps that keep a tolerance, and the first step taken."""
    duration = integrator.end_time
    longest = min(integrator.largest_step or duration, duration)
    limit = _FACTOR * tolerance ** (2.0 / 3.0)
    h, batch, before = min(first or 1e-3 * duration, longest), 1, 1.0
    marching = _Marching(integrator, model, start, sizes)
    corners = [*_jumps_inside(model, integrator), duration]
    while marching.t < duration:
        t = marching.t
        end = next(corner for corner in corners if corner > t)
        if t in corners:
            batch, before = 1, 1.0
        count = math.ceil((end - t) / h * (1.0 - 1e-9))
        if count <= batch:
            ends = np.linspace(t, end, max(count, 1) + 1)
        else:
            ends = t + h * np.arange(batch + 1)
        status, good, rows = marching.advance(ends, limit)
        if status == CONVERGED:
            error = max(float(np.max(rows.errors / sizes)) / limit, 1e-8)
            factor = 0.9 * error ** (-0.7 / 4.0) * before ** (0.4 / 4.0)
            before = error
            if 0.95 < factor < 1.2:
                batch = min(2 * batch, _BATCH)
            else:
                h = min(h * min(max(factor, 0.2), 4.0), longest)
                batch = min(batch + 1, _BATCH) if factor < 1.5 else 1
            continue
        if status == REJECTED:
            error = min(max(float(np.max(rows.errors[good] / sizes)) / limit, 1.0), 1e8)
            h *= min(max(0.2, 0.9 * error ** (-1.0 / 4.0)), 0.7)
        else:
            h *= 0.25
        batch, before = 1, 1.0
        if h < _SHORTEST * duration:
            raise _failure(marching, rows, good, status, "")
    rows = _Rows.joined(marching.parts)
    return rows, float(rows.t[3] - rows.t[0])


def _trajectory(integrator: RadauIIA, model: FlatModel, rows: _Rows, sizes: Array) -> Trajectory:
    weights = np.zeros(rows.t.size)
    weights[1:] = np.ravel(np.diff(rows.t[::3])[:, None] * A[2])
    largest = float(np.max(rows.errors / sizes, initial=0.0))
    return Trajectory(
        t=rows.t,
        y=rows.y,
        v=rows.v,
        w=rows.w,
        a=rows.w,
        multipliers=rows.multipliers,
        stabilization=rows.stabilization,
        iterations=rows.iterations,
        beginning=np.zeros((4, model.size)),
        model=model,
        integrator=integrator,
        weights=weights,
        error=(largest / _FACTOR) ** 1.5,
    )


def _failure(
    marching: _Marching, rows: _Rows, good: int, status: int, remedy: str
) -> SimulationError:
    """What to raise where a step failed."""
    model, so_far = marching.model, _Rows.joined(marching.parts)
    trajectory = _trajectory(marching.integrator, model.at(so_far.t), so_far, marching.sizes)
    row = 3 * good + 3
    length = rows.t[row] - rows.t[row - 3]
    if status == REJECTED:
        text = (
            f"at t = {rows.t[row - 3]:.6g} s steps of {length:.1e} s are too long for the "
            "tolerance: the motion cannot go on, or is not smooth there; look at the motion so "
            "far in the exception's trajectory"
        )
        return SimulationError(text, trajectory)
    tried = _trajectory(marching.integrator, model.at(rows.t), rows, marching.sizes)
    where = f"step {trajectory.step_ends.size} of {length:.3g} s"
    iterations = int(rows.iterations[good])
    return SimulationError(diagnosis(tried, row, where, iterations, status, remedy), trajectory)
