# SPDX-License-Identifier: MIT
"""Limits within which a computed motion is one of the mechanism, and warnings beyond them."""

from __future__ import annotations

import math
import warnings
from collections.abc import Container, Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ..arrays import Array, Integers, symmetric
from ..mechanism import Gear, PlacementWarning
from .initial import placement_corrections, reversed_joint, widest_gap
from .kinematics import Kinematics, elastic_mass, length_of, mass_norm, norm_floors, tilts
from .load_steps import SAMPLING, load_steps
from .trajectory import Trajectory
from .vibrations import lost_vibrations, resonance_error

#: Kinds and texts of warnings.
Warnings = Iterator[tuple[type[UserWarning], str]]


@dataclass(frozen=True)
class Limits:
    """Limits above which a motion causes a warning."""

    #: Deformation in parts of a body's length, a root mean square by mass: that of a cantilever
    #: whose end moves by a tenth of its length, or of a rod that is stretched by nine percent. The
    #: end of such a cantilever is 0.6 percent of its length, (3/5) d^2 / L, nearer than by linear
    #: theory.
    deformation: float = 0.05
    #: Estimates of the relative errors of positions, and of deformations in the mean, chosen so
    #: that the integral compliance is off by a tenth or so where they are reached. Its error,
    #: measured with generalised-alpha and 10 to 640 steps, is 4 times the first estimate on a
    #: slider-crank, and 2 (slider-crank), 0.2 to 2 (four-bar linkage), 3 to 5 (robot) and 3 times
    #: (loader) the second.
    step_error: float = 0.03
    elastic_step_error: float = 0.015
    #: Share of the mean strain energy that a motion may have lost by vibrations that its steps damp
    #: away; the integral compliance is off by as much.
    loss: float = 0.05
    #: Square of omega h up to which a method shows its order. Beyond, a step spans a sixth of an
    #: oscillation: Radau IIA damps such vibrations away instead of following them, and the rest
    #: tells their size no more. With 8 and 12 steps it is off by 43 and 17 percent on the robot,
    #: where its order would promise 0.7 percent.
    resolved: float = 1.0
    #: Angle by which a body may turn in one step about an axis that moves [rad]. With
    #: generalised-alpha a heavy top that turns by 0.15, 0.075 and 0.0375 rad a step is off by 9, 2
    #: and 0.5 percent of its length after one second.
    turn: float = 0.1
    #: Sine of the angle between the axes of two markers up to which an angle about them counts:
    #: that angle is off by a fifth of the square of this one, and a bushing's moments by half.
    tilt: float = 0.1
    #: Corrections of placements that are made without a word: in parts of the largest distance of a
    #: marker from the origin of its body's frame, and [rad]. That distance is half a rod's length
    #: where the frame lies in its middle, and rough placements are off by it at times.
    correction: float = 1.2
    correcting_turn: float = 0.35
    #: Least number of advised steps: a handful of steps says nothing about the motion between them.
    fewest_steps: int = 20


LIMITS = Limits()

#: Steps whose stiffness is looked at together.
_CHUNK = 2000


class SofteningWarning(UserWarning):
    """A body turns faster than its lowest frequency, where the linear theory fails.

    Judged by the loads of the body's own inertia, and of point masses at markers with geometric
    stiffness. Forces of joints and springs at such markers may stabilise the body, and withdraw the
    warning; buckling by them alone is not reported, as it depends on the neighbours.
    """


class LargeDeformationWarning(UserWarning):
    """A body is deformed so much that its linear theory does not describe it."""


class TiltedAxisWarning(UserWarning):
    """An angle counts about an axis that nothing holds, or a bushing turns too far, in space."""


class GearFlankWarning(UserWarning):
    """The teeth of a gear carry most where its pressure angle makes them pull instead of push."""


class TimeStepWarning(UserWarning):
    """The time steps are too long for the motion, or for the vibrations among its deformations.

    Vibrations that the steps damp away leave no trace; they are predicted from the modes at the
    start and at the known jumps.
    """


def warn_of_limits(trajectory: Trajectory, *, complete: bool = True) -> None:
    """Warn once of each limit that a trajectory exceeds.

    One that failed is not `complete`: only placements, softening and tilted axes are reported, as
    likely reasons. Steps are judged where the caller gave them.
    """
    for kind, text in _exceeded(trajectory, complete):
        warnings.warn(text, kind, stacklevel=3)


def _exceeded(trajectory: Trajectory, complete: bool) -> Warnings:
    yield from _placements(trajectory)
    softening = _softening(trajectory)
    yield from ((SofteningWarning, text) for text in softening.values())
    yield from _tilted_axes(trajectory)
    if not complete:
        return
    yield from _deformations(trajectory, softening)
    yield from _flanks(trajectory)
    yield from _lost_vibrations(trajectory)
    yield from _resonance(trajectory)
    yield from _unjudged_forces(trajectory)
    yield from _reversed_axes(trajectory)
    method = trajectory.integrator
    if not method.adaptive and method.chosen_for is None:
        yield from _loads(trajectory)
        yield from _steps(trajectory)
        yield from _turns(trajectory)


def _placements(trajectory: Trajectory) -> Warnings:
    """Joints that close far from the placements."""
    model = trajectory.model
    corrections = placement_corrections(model, trajectory.y[0])
    if not corrections:
        return
    length = length_of(model.arrays)

    def size(name: str) -> float:
        distance, angle = corrections[name]
        return max(distance / length, angle)

    body = max(corrections, key=size)
    distance, angle = corrections[body]
    if distance <= LIMITS.correction * length and angle <= LIMITS.correcting_turn:
        return
    joint, gap = widest_gap(model)
    yield (
        PlacementWarning,
        f"body {body!r} starts {distance:.3g} m and {angle:.2g} rad from its placement, because "
        f"the joints do not close nearer to it; joint {joint!r} is open the most in the "
        f"placements, by {gap}. Correct the placement, or the joint",
    )


def _deformations(trajectory: Trajectory, reported: Container[str]) -> Warnings:
    """Bodies that are deformed by more than a share of their length, but for those reported."""
    for name, body in trajectory.model.bodies.items():
        if body.modes == 0 or name in reported:
            continue
        q, center = trajectory.elastic(name), body.S[0] / body.mass
        squares = np.sum((q @ body.G[1:, 1:]) * q, axis=1) / body.mass
        # The length of a slender rod with this radius of gyration.
        length = math.sqrt(12.0 * max(body.G[0, 0] / body.mass - center @ center, 0.0))
        k = int(np.argmax(squares))
        deformation = math.sqrt(max(squares[k], 0.0))
        if deformation > LIMITS.deformation * length:
            yield (
                LargeDeformationWarning,
                f"body {name!r} is deformed by {deformation / length:.2g} of its length (root mean "
                f"square) at t = {trajectory.t[k]:.4g} s, and linear theory holds to about "
                f"{LIMITS.deformation:g}: loads or drives are too strong, joints fight each other "
                "where a direction should be free, or the body is too soft",
            )


def _reversed_axes(trajectory: Trajectory) -> Warnings:
    """A joint in space whose axis points the other way at the end."""
    start, end = (0, trajectory.y[0]), (trajectory.steps, trajectory.y[-1])
    joint = reversed_joint(trajectory.model, start, end)
    if joint is not None:
        yield (
            TimeStepWarning,
            f"joint {joint!r} has its axis reversed at the end, because it closed the other way "
            "round after a long step; take shorter steps",
        )


def _tilted_axes(trajectory: Trajectory) -> Warnings:
    """Drives, gears and torsional springs in space whose axis no joint fixes."""
    model = trajectory.model
    tilt_of_row = tilts(model.arrays, trajectory.y)
    tilt_of_spring = tilt_of_row[model.rows :]
    by_user = {f"joint {name!r}": tilt_of_row[rows] for name, rows in model.joints.items()}
    for name, numbers in model.forces.items():
        springs = [number for number in numbers if number < len(tilt_of_spring)]
        by_user[f"force {name!r}"] = tilt_of_spring[springs]
    for what, tilts_of_user in by_user.items():
        tilt = float(np.max(tilts_of_user, initial=0.0))
        if tilt > LIMITS.tilt:
            yield (
                TiltedAxisWarning,
                f"{what}: the axes of its markers differ by {math.asin(min(tilt, 1.0)):.2g} rad, "
                f"but an angle about them is meaningful up to {LIMITS.tilt:g} rad only: hold the "
                "axis by a joint (Revolute, Cylindrical), or make a Bushing stiffer about all axes",
            )


def _flanks(trajectory: Trajectory) -> Warnings:
    """Gears whose largest force acts on the other flank than the one of their pressure angle."""
    mechanism = trajectory.model.mechanism
    for name, joint in zip(mechanism.joint_names, mechanism.joints, strict=True):
        if not isinstance(joint, Gear) or joint.pressure_angle == 0.0:
            continue
        force = trajectory.joint_force(name)[:, 0] * np.sign(joint.pressure_angle)
        push, pull = float(np.max(force)), -float(np.min(force))
        if pull > max(push, 0.0):
            yield (
                GearFlankWarning,
                f"joint {name!r}: with this sign of the pressure angle the teeth pull the wheels "
                f"together by up to {pull:.3g} N, and push by {max(push, 0.0):.3g} N at most: give "
                f"pressure_angle={-joint.pressure_angle:.4g}, or 0 where the load alternates",
            )


def _turns(trajectory: Trajectory) -> Warnings:
    """Rotors in space that turn too far in one step about an axis that moves.

    The phase of its own rotation acts on its axis then, with an error of the square of the angle.
    """
    model = trajectory.model
    if trajectory.integrator.order > 2:
        return
    h, steps = np.diff(trajectory.t, prepend=trajectory.t[0]), len(trajectory.step_ends) - 1
    for b, name in enumerate(model.bodies):
        turn = model.arrays.largest_turn(b, trajectory.y, trajectory.v, h)
        if turn > LIMITS.turn:
            yield (
                TimeStepWarning,
                f"body {name!r} turns by up to {turn:.2g} rad in one time step about an axis that "
                f"moves, but steps should turn it by less than {LIMITS.turn:g} rad: take "
                f"{math.ceil(steps * turn / LIMITS.turn)} steps instead of {steps}",
            )


def _lost_vibrations(trajectory: Trajectory) -> Warnings:
    """Vibrations that the start or a jump excites and that the steps damp away."""
    lost, method = lost_vibrations(trajectory), trajectory.integrator
    # A tolerance that was asked for may allow more than the limit without one.
    if lost.share <= max(LIMITS.loss, 2.0 * (method.chosen_for or 0.0)):
        return
    flexible = any(body.modes for body in trajectory.model.bodies.values())
    what = "strain energy" if flexible else "square of the accelerations"
    cause = "the start" if lost.time == 0.0 else f"the jump at t = {lost.time:.4g} s"
    remedy = "Take TimeInterval(end_time, tolerance), which finds steps that resolve them"
    if method.chosen_for is not None:
        remedy = (
            f"These steps were chosen for an error of {method.chosen_for:.1e} of other designs; "
            "estimate their error for this design by model_report, or choose steps by "
            "Problem.with_steps_for"
        )
    yield (
        TimeStepWarning,
        f"{cause} excites vibrations, the first of {lost.frequency:.4g} Hz, with "
        f"{100.0 * lost.share:.2g} percent of the mean {what}: {method.in_words} damp them, the "
        f"machine does not. {remedy}, let loads and drives begin smoothly (Motion.smooth_step), "
        "begin in StaticEquilibrium(), or give the bodies their damping (RayleighDamping)",
    )


def _resonance(trajectory: Trajectory) -> Warnings:
    """Warn of resonance that the steps, chosen for other designs, do not resolve accurately."""
    tolerance = trajectory.integrator.chosen_for
    if tolerance is None:
        return
    worst = resonance_error(trajectory, tolerance)
    if worst.share > tolerance:
        yield (
            TimeStepWarning,
            f"body {worst.body!r} vibrates with {worst.frequency:.4g} Hz, near a frequency of its "
            f"own, and {trajectory.integrator.in_words}, chosen for an error of {tolerance:.1e} of "
            f"other designs, change its mean strain energy by an estimated {worst.share:.1e}; "
            "choose anew at this one by Problem.with_steps_for, or give TimeInterval a tolerance "
            f"of {0.5 * tolerance * tolerance / worst.share:.1e}",
        )


def _unjudged_forces(trajectory: Trajectory) -> Warnings:
    """Warn that adaptive steps bound the error of the motion, and not that of joint forces."""
    forces_judged = not math.isnan(trajectory.force_error)
    if forces_judged or not trajectory.integrator.adaptive or not trajectory.model.rows:
        return
    yield (
        TimeStepWarning,
        "the steps keep their tolerance in the motion, but not in the forces in joints, which "
        "grow without bound as links come into line, or follow a noisy load or motion. Forces at "
        "single instants may be wrong; TimeInterval(end_time, tolerance) estimates their means "
        "over time, and objectives that use them",
    )


def _loads(trajectory: Trajectory) -> Warnings:
    """Loads and motions that change within a step.

    In each cell of `load_steps`, loads and motions follow a cubic polynomial of time, as a step of
    Radau IIA does; a method of order 2 needs two steps for a cell.
    """
    step_ends, order = trajectory.step_ends, trajectory.integrator.order
    cells = load_steps(trajectory.model.tables, float(step_ends[-1]), SAMPLING.samples_of_a_look)
    begins, lengths = cells.ends[:-1], np.diff(cells.ends)
    # the step in which the middle of each cell lies
    middles = begins + 0.5 * lengths
    number = np.clip(np.searchsorted(step_ends, middles) - 1, 0, step_ends.size - 2)
    steps = np.diff(step_ends)[number]
    # one or two steps, less a hundredth for cells that are as long as these
    steps_of_cell = 0.99 if order > 2 else 1.99
    unresolved = np.flatnonzero(cells.fast & (lengths < steps * steps_of_cell))
    if not unresolved.size:
        return
    worst = unresolved[int(np.argmin(lengths[unresolved]))]
    yield (
        TimeStepWarning,
        f"a load or a motion changes within {lengths[worst]:.2g} s at t = {begins[worst]:.6g} s, "
        f"which time steps of {steps[worst]:.2g} s do not resolve: take shorter steps, or "
        "TimeInterval(end_time, tolerance)",
    )


def _steps(trajectory: Trajectory) -> Warnings:
    """Fixed steps that do not resolve the motion, or the deformations by their own size.

    A motion of frequency omega is computed by a method of order p with a relative error of about
    (omega^2 h^2 / 12)^(p/2), where omega h is less than one; beyond, no order is better than two.
    """
    order, steps = trajectory.integrator.order, len(trajectory.step_ends) - 1
    rigid, elastic = _squared_phase(trajectory), _squared_elastic_phase(trajectory)

    def error(squared: float) -> float:
        return float((squared / 12.0) ** (0.5 * order if squared < LIMITS.resolved else 1.0))

    excess, what, squared, remedy = max(
        (error(squared) / allowed, what, squared, remedy)
        for what, squared, allowed, remedy in [
            ("positions", rigid, LIMITS.step_error, "simulate(end_time=..., tolerance=...)"),
            ("deformations", elastic, LIMITS.elastic_step_error, "Problem.with_tolerance"),
        ]
    )
    if excess > 1.0:
        # One order less than the method's, as vibrations beyond the steps show in part only.
        factor = excess ** (1.0 / (order - 1))
        if squared >= LIMITS.resolved:
            factor = max(factor, 1.1 * math.sqrt(squared / LIMITS.resolved))
        enough = max(math.ceil(steps * factor), LIMITS.fewest_steps)
        yield (
            TimeStepWarning,
            f"the time steps are too long for the motion: an oscillation of its {what} has "
            f"{2.0 * math.pi / math.sqrt(squared):.2g} steps, with an estimated relative error of "
            f"{error(squared):.1g}, and a larger error of psi; take {enough} steps instead of "
            f"{steps}, or see {remedy}",
        )


def _squared_phase(trajectory: Trajectory) -> float:
    """(omega h)^2, with omega^2 estimated as largest acceleration over largest displacement."""
    model = trajectory.model
    h = np.repeat(np.diff(trajectory.step_ends), trajectory.integrator.stages)  # of each stage

    displacement = model.arrays.difference(trajectory.y, trajectory.y[0])
    # Of a turning body the chord, which does not grow from turn to turn.
    displacement[:, model.rotations] = 2.0 * np.sin(0.5 * displacement[:, model.rotations])
    floor = norm_floors(model.arrays, float(trajectory.t[-1]))[0]
    largest_displacement = max(float(np.max(mass_norm(model.arrays, displacement))), floor)

    # Without that of the start, so that a constant acceleration is no vibration.
    acceleration = mass_norm(model.arrays, trajectory.w[1:] - trajectory.w[0])
    return float(np.max(h**2 * acceleration)) / largest_displacement


def _squared_elastic_phase(trajectory: Trajectory) -> float:
    """Mean of (omega h)^2: strain energy of the change of deformations in a step over their own.

    The latter includes static deformations. Vibrations beyond the steps count by their own energy,
    four times at most; where nothing excites them they do not count, whatever their frequency.
    """
    model, stages = trajectory.model, trajectory.integrator.stages
    h, duration = np.diff(trajectory.step_ends), float(trajectory.t[-1])
    change, energy = 0.0, duration * norm_floors(model.arrays, duration)[2] ** 2
    for name, body in model.bodies.items():
        if body.modes:
            q = trajectory.elastic(name)[::stages]
            squares = np.sum((q @ body.K) * q, axis=1)
            energy += 0.5 * float(h @ (squares[1:] + squares[:-1]))
            q = np.diff(q, axis=0)
            change += float(h @ np.sum((q @ body.K) * q, axis=1))
    return change / energy


def _softening(trajectory: Trajectory) -> dict[str, str]:
    """Warnings of bodies whose elastic plus inertial stiffness is indefinite, by their names."""
    model, arrays, texts = trajectory.model, trajectory.model.arrays, {}
    for b, name in enumerate(model.bodies):
        if not arrays.modes[b]:
            continue
        turning = trajectory.v[:, model.coordinates(name).rotation]
        soft, lowest = _softened(trajectory, b)
        k = _first_unstable(trajectory, b, soft)
        if k < 0:
            continue
        time, speed = f"at t = {trajectory.t[k]:.4g} s", float(np.linalg.norm(turning[k]))
        if arrays.stiffened[b]:
            text = (
                f"loses its stiffness {time}, when it turns with {speed:.4g} rad/s, in spite of "
                "geometric stiffening: as long as it turns so fast,"
            )
        else:
            text = (
                f"turns with {speed:.4g} rad/s {time}, faster than its lowest frequency of "
                f"{math.sqrt(max(lowest, 0.0)):.4g} rad/s: without geometric stiffening"
            )
        texts[name] = f"body {name!r} {text} its deformation grows without bound"
    return texts


def _softened(trajectory: Trajectory, b: int) -> tuple[Integers, float]:
    """Time steps at which elastic plus inertial stiffness of a body is indefinite.

    Also the square of its lowest frequency: without geometric stiffness no slower turns soften it.
    """
    arrays, y, v, w = trajectory.model.arrays, trajectory.y, trajectory.v, trajectory.w
    columns, n = arrays.coordinates(b), int(arrays.modes[b])
    # In the basis of the modes at rest, so that no unit hides a slip.
    squares, modes = scipy.linalg.eigh(arrays.K[b, :n, :n], elastic_mass(arrays, b))
    turning, lowest = v[:, columns.rotation], float(squares[0])
    W = arrays.cross_matrices(turning)
    loads: Array = (W @ W).reshape(len(y), -1)
    parts = arrays.moments(b)[1:, 1:].transpose(2, 3, 0, 1).reshape(-1, n, n)
    suspects = np.arange(len(y))
    if arrays.stiffened[b]:
        full = arrays.loads_of_rotation(turning, w[:, columns.rotation])
        fall = w[:, columns.position] - arrays.gravity[: len(y)]
        f = np.einsum("tki,tk->ti", arrays.rotations(y[:, columns.rotation]), fall)
        loads = np.hstack([loads, full, f])
        parts = np.concatenate([parts, arrays.stiffening[b, :, :n, :n]])
    else:
        suspects = np.flatnonzero(np.sum(turning.reshape(len(y), -1) ** 2, axis=1) > lowest)
    parts = modes.T @ parts @ modes
    parts, least = symmetric(parts), min(0.0, -1e-12 * squares[-1])
    soft = [
        chunk[
            np.linalg.eigvalsh(np.diag(squares) + np.tensordot(loads[chunk], parts, 1))[:, 0]
            < least
        ]
        for chunk in np.split(suspects, range(_CHUNK, len(suspects), _CHUNK))
    ]
    return np.concatenate(soft), lowest


def _first_unstable(trajectory: Trajectory, b: int, steps: Integers) -> int:
    """First of these steps at which forces at markers do not stabilise the body; or -1."""
    arrays = trajectory.model.arrays
    elastic = arrays.coordinates(b).elastic
    stiffened = np.any(arrays.vector_stiffened[arrays.vector_body == b] >= 0)
    inertia = np.diag(elastic_mass(arrays, b))
    kinematics: Kinematics | None = None  # for most bodies there are no such steps
    for k in steps:
        if not stiffened:
            return int(k)
        kinematics = kinematics or Kinematics(arrays, trajectory.turns)
        y, v, w = trajectory.y[k], trajectory.v[k], trajectory.w[k]
        Ky = kinematics.evaluated(int(k), y, v, w, trajectory.multipliers[k]).stiffness
        stiffness = Ky[elastic, elastic] + Ky[elastic, elastic].T
        scale = 1.0 / np.sqrt(inertia)
        squares = np.linalg.eigvalsh(scale[:, None] * stiffness * scale)
        if squares[0] < min(0.0, -1e-12 * squares[-1]):
            return int(k)
    return -1
