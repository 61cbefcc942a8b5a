# SPDX-License-Identifier: MIT
"""Limits within which a computed motion is one of the mechanism, and warnings beyond them."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from . import planar, spatial
from .kinematics import (
    coordinates_of,
    evaluate_equations,
    least_sizes,
    place_markers,
    sizes_by_mass,
    ways,
)
from .trajectory import Trajectory

__all__ = [
    "LargeDeformationWarning",
    "SofteningWarning",
    "TiltedAxisWarning",
    "TimeStepWarning",
    "warn_of_limits",
]

Array = NDArray[np.float64]

#: Steps whose stiffness is looked at together.
_CHUNK = 2000
#: Largest deformation in parts of a body's length, a root mean square by mass: that of a cantilever
#: whose end moves by a tenth of its length, or of a rod that is stretched by nine percent. The end
#: of such a cantilever is 0.6 percent of its length, (3/5) d^2 / L, nearer than by linear theory.
LARGEST_DEFORMATION = 0.05
#: Largest estimates of the relative errors of positions, and of deformations in the mean, chosen so
#: that the integral compliance is off by a tenth or so where they are reached. Its error, measured
#: with generalised-alpha and 10 to 640 steps, is 4 times the first estimate on a slider-crank, and
#: 2 (slider-crank), 0.2 to 2 (four-bar linkage), 3 to 5 (robot) and 3 times (loader) the second.
LARGEST_STEP_ERROR = 0.03
LARGEST_ELASTIC_STEP_ERROR = 0.015
#: Square of omega h up to which a method shows its order. Beyond, a step spans a sixth of an
#: oscillation: Radau IIA damps such vibrations away instead of following them, and what is left of
#: them tells their size no more. With 8 and 12 steps it is off by 43 and 17 percent on the robot,
#: where its order would promise 0.7 percent.
LARGEST_RESOLVED = 1.0
#: Angle by which a body may turn in one step about an axis that moves [rad]. With generalised-alpha
#: a heavy top that turns by 0.15, 0.075 and 0.0375 rad a step is off by 9, 2 and 0.5 percent of its
#: length after one second.
LARGEST_TURN = 0.1
#: Sine of the angle between the axes of two markers up to which an angle about them counts: that
#: angle is off by a fifth of the square of this one, and a bushing's moments by half of it.
LARGEST_TILT = 0.1
#: Steps to advise at least: from a handful nothing can be told about a motion between them.
_FEWEST_STEPS = 20


class SofteningWarning(UserWarning):
    """A body turns faster than its lowest frequency, where the linear theory fails.

    Judged by the loads of the body's own inertia, and of point masses at markers with geometric
    stiffness. Forces of joints, springs and others at such markers may take the warning back, where
    they hold the body; that they alone buckle a body is not reported, as this depends on how its
    neighbours hold it.
    """


class LargeDeformationWarning(UserWarning):
    """A body is deformed so much that its linear theory does not describe it."""


class TiltedAxisWarning(UserWarning):
    """An angle counts about an axis that nothing holds, or a bushing turns too far, in space."""


class TimeStepWarning(UserWarning):
    """The time steps are too long for the motion, or for the vibrations among its deformations.

    Vibrations that the method has damped away because the steps are far too long for them leave
    nothing to be seen; :func:`model_report` repeats the motion with longer steps.
    """


def warn_of_limits(
    trajectory: Trajectory, *, complete: bool = True, steps_given: bool = True
) -> None:
    """Warn once of each limit beyond which a motion leads.

    Args:
        trajectory: The motion.
        complete: Whether it came to its end; of one that failed, only softening and tilted axes
            are reported, as likely reasons.
        steps_given: Whether the caller chose the steps; those of a tolerance are what it asked for.
    """
    reported = _warn_of_softening(trajectory)
    _warn_of_tilted_axes(trajectory)
    if complete:
        _warn_of_deformation(trajectory, reported)
    method = trajectory.integrator
    if complete and steps_given and not (method.adaptive or method.judged):
        _warn_of_steps(trajectory)
        _warn_of_turns(trajectory)
        _warn_of_reversed_axes(trajectory)


def _warn_of_deformation(trajectory: Trajectory, reported: set[str]) -> None:
    """Warn once of each body that is deformed by more than a share of its length, others apart."""
    for name, body in trajectory.model.bodies.items():
        if body.modes == 0 or name in reported:
            continue
        q, center = trajectory.elastic(name), body.S[0] / body.mass
        squares = np.sum((q @ body.G[1:, 1:]) * q, axis=1) / body.mass
        # The length of a slender rod with this radius of gyration.
        length = math.sqrt(12.0 * max(body.G[0, 0] / body.mass - center @ center, 0.0))
        k = int(np.argmax(squares))
        deformation = math.sqrt(max(squares[k], 0.0))
        if deformation > LARGEST_DEFORMATION * length:
            warnings.warn(
                f"body {name!r} is deformed by {deformation / length:.2g} of its length (root mean "
                f"square) at t = {trajectory.t[k]:.4g} s, and linear theory holds to about "
                f"{LARGEST_DEFORMATION:g}: loads or drives are too strong, joints fight each other "
                "where a direction should be free, or the body is too soft",
                LargeDeformationWarning,
                stacklevel=4,
            )


def _warn_of_reversed_axes(trajectory: Trajectory) -> None:
    """Warn of a joint in space whose axis is the other way round at the end."""
    model, last = trajectory.model, trajectory.steps
    if not isinstance(model.arrays, spatial.ModelArrays):
        return
    before, after = (place_markers(model.arrays, k, trajectory.y[k]) for k in (0, last))
    row = spatial.reversed_row(model.arrays, model.joints.values(), before, after)
    if row >= 0:
        warnings.warn(
            f"joint {model.joint_of_row(row)!r} has its axis reversed at the end: a step was so "
            "long that the joint closed the other way round; take shorter steps",
            TimeStepWarning,
            stacklevel=4,
        )


def _warn_of_tilted_axes(trajectory: Trajectory) -> None:
    """Warn of drives, gears and torsional springs in space whose axis no joint holds."""
    model = trajectory.model
    if not isinstance(model.arrays, spatial.ModelArrays):
        return
    found = spatial.tilts(model.arrays, trajectory.y)
    for name, rows in model.joints.items():
        if (tilt := float(np.max(found[rows], initial=0.0))) > LARGEST_TILT:
            _warn_of_tilt(f"joint {name!r}", tilt)
    springs = found[model.rows :]
    for name, places in model.forces.items():
        own = [springs[k] for k in places if k < len(springs)]
        if (tilt := float(np.max(own, initial=0.0))) > LARGEST_TILT:
            _warn_of_tilt(f"force {name!r}", tilt)


def _warn_of_tilt(what: str, tilt: float) -> None:
    angle = math.asin(min(tilt, 1.0))
    warnings.warn(
        f"{what}: the axes of its markers part by {angle:.2g} rad, and an angle about them means "
        f"little beyond {LARGEST_TILT:g}: hold its axis by a joint (Revolute, Cylindrical), or, of "
        "a Bushing, make it stiffer about all axes",
        TiltedAxisWarning,
        stacklevel=5,
    )


def _warn_of_turns(trajectory: Trajectory) -> None:
    """Warn of a rotor in space that turns too far in one step about an axis that moves.

    The phase of its own rotation acts on its axis then, with an error of the square of the angle.
    """
    model = trajectory.model
    if not isinstance(model.arrays, spatial.ModelArrays) or trajectory.integrator.order > 2:
        return
    h, steps = np.diff(trajectory.t, prepend=trajectory.t[0]), len(trajectory.step_ends) - 1
    for b, name in enumerate(model.bodies):
        turn = spatial.largest_turn(model.arrays, b, trajectory.y, trajectory.v, h)
        if turn > LARGEST_TURN:
            warnings.warn(
                f"body {name!r} turns by up to {turn:.2g} rad in one time step about an axis that "
                f"moves, which takes steps below {LARGEST_TURN:g} rad to follow: take "
                f"{math.ceil(steps * turn / LARGEST_TURN)} steps instead of {steps}",
                TimeStepWarning,
                stacklevel=4,
            )


def _warn_of_steps(trajectory: Trajectory) -> None:
    """Warn of fixed steps that do not resolve the motion, or the deformations by their own size.

    A motion of frequency omega is computed by a method of order p with a relative error of about
    (omega^2 h^2 / 12)^(p/2), where omega h is less than one; beyond, no order is better than two.
    """
    order, steps = trajectory.integrator.order, len(trajectory.step_ends) - 1
    rigid, elastic = _squared_phase(trajectory), _squared_elastic_phase(trajectory)

    def error(squared: float) -> float:
        return float((squared / 12.0) ** (0.5 * order if squared < LARGEST_RESOLVED else 1.0))

    excess, what, squared, remedy = max(
        (error(squared) / allowed, what, squared, remedy)
        for what, squared, allowed, remedy in [
            ("positions", rigid, LARGEST_STEP_ERROR, "simulate(tolerance=...)"),
            ("deformations", elastic, LARGEST_ELASTIC_STEP_ERROR, "Problem.with_tolerance"),
        ]
    )
    if excess > 1.0:
        # One order less than the method's, as of vibrations beyond the steps but a part is seen.
        more = excess ** (1.0 / (order - 1))
        if squared >= LARGEST_RESOLVED:
            more = max(more, 1.1 * math.sqrt(squared / LARGEST_RESOLVED))
        enough = max(math.ceil(steps * more), _FEWEST_STEPS)
        warnings.warn(
            f"the time steps are too long for the motion: there are "
            f"{2.0 * math.pi / math.sqrt(squared):.2g} to an oscillation of its {what}, an "
            f"estimated relative error of {error(squared):.1g} in them and of "
            f"more in psi; take {enough} steps instead of {steps}, or see {remedy}",
            TimeStepWarning,
            stacklevel=4,
        )


def _squared_phase(trajectory: Trajectory) -> float:
    """Square of omega h, where a motion of frequency omega has accelerations of omega^2 its way."""
    model = trajectory.model
    h = np.repeat(np.diff(trajectory.step_ends), trajectory.integrator.stages)
    way = ways(model.arrays, trajectory.y, trajectory.y[0])
    # Of a turning body the chord, which does not grow from turn to turn.
    way[:, model.rotations] = 2.0 * np.sin(0.5 * way[:, model.rotations])
    least = least_sizes(model.arrays, float(trajectory.t[-1]))[0]
    size = max(float(np.max(sizes_by_mass(model.arrays, way))), least)
    swing = sizes_by_mass(model.arrays, trajectory.w[1:] - trajectory.w[0])
    return float(np.max(h**2 * swing)) / size


def _squared_elastic_phase(trajectory: Trajectory) -> float:
    """Square of omega h in the mean, by the strain energy of what deformations change in a step.

    Relative to the strain energy of the deformations, static ones included. Vibrations that the
    steps do not resolve count by their own energy, four times at most; where nothing excites them
    they do not count, however high their frequency.
    """
    model, stages = trajectory.model, trajectory.integrator.stages
    h, duration = np.diff(trajectory.step_ends), float(trajectory.t[-1])
    change, energy = 0.0, duration * least_sizes(model.arrays, duration)[2] ** 2
    for name, body in model.bodies.items():
        if body.modes:
            q = trajectory.elastic(name)[::stages]
            squares = np.sum((q @ body.K) * q, axis=1)
            energy += 0.5 * float(h @ (squares[1:] + squares[:-1]))
            q = np.diff(q, axis=0)
            change += float(h @ np.sum((q @ body.K) * q, axis=1))
    return change / energy


def _warn_of_softening(trajectory: Trajectory) -> set[str]:
    """Warn once of each body whose stiffness less omega^2 G loses definiteness; their names."""
    model, reported = trajectory.model, set()
    for b, name in enumerate(model.bodies):
        n = int(model.arrays.modes[b])
        if n == 0:
            continue
        if isinstance(model.arrays, spatial.ModelArrays):
            if _warn_of_softening_in_space(trajectory, b, name):
                reported.add(name)
            continue
        G, K = model.arrays.G[b, 1 : n + 1, 1 : n + 1], model.arrays.K[b, :n, :n]
        speed = np.abs(trajectory.v[:, coordinates_of(model.arrays, b).rotation])
        if model.arrays.stiffened[b]:
            k = _first_unheld(trajectory, b, _softening(trajectory, b))
            if k >= 0:
                reported.add(name)
                warnings.warn(
                    f"body {name!r} loses its stiffness at t = {trajectory.t[k]:.4g} s, where it "
                    f"turns with {speed[k]:.4g} rad/s, in spite of geometric stiffening: while "
                    "that lasts, its deformation grows without bound",
                    SofteningWarning,
                    stacklevel=4,
                )
            continue
        lowest = scipy.linalg.eigh(K, G, eigvals_only=True, subset_by_index=[0, 0])[0]
        fast = np.flatnonzero((speed**2 > lowest) & (lowest > 0.0))
        k = _first_unheld(trajectory, b, fast)
        if k >= 0:
            reported.add(name)
            warnings.warn(
                f"body {name!r} turns with {speed[k]:.4g} rad/s at t = {trajectory.t[k]:.4g} s, "
                f"faster than its lowest frequency of {math.sqrt(lowest):.4g} rad/s: without "
                "geometric stiffening its deformation grows without bound",
                SofteningWarning,
                stacklevel=4,
            )
    return reported


def _warn_of_softening_in_space(trajectory: Trajectory, b: int, name: str) -> bool:
    """Warn of one body in space; gives whether there was a reason."""
    arrays = trajectory.model.arrays
    assert isinstance(arrays, spatial.ModelArrays)
    steps = spatial.softened(arrays, b, trajectory.y, trajectory.v, trajectory.w)
    k = _first_unheld(trajectory, b, steps)
    if k < 0:
        return False
    speed = float(np.linalg.norm(trajectory.v[k, trajectory.model.coordinates(name).rotation]))
    reason = (
        "in spite of geometric stiffening: while that lasts, its deformation grows without bound"
        if arrays.stiffened[b]
        else "without geometric stiffening its deformation grows without bound"
    )
    warnings.warn(
        f"body {name!r} loses its stiffness at t = {trajectory.t[k]:.4g} s, where it turns with "
        f"{speed:.4g} rad/s: {reason}",
        SofteningWarning,
        stacklevel=5,
    )
    return True


def _softening(trajectory: Trajectory, b: int) -> Iterator[int]:
    """Steps at which K + B - omega^2 G is indefinite, B the stiffness by the body's inertia."""
    arrays = trajectory.model.arrays
    assert isinstance(arrays, planar.ModelArrays)
    where, n = coordinates_of(arrays, b), int(arrays.modes[b])
    G, T = arrays.G[b, 1 : n + 1, 1 : n + 1], arrays.stiffening[b, :, :n, :n]
    # In the basis of the modes at rest, so that no unit hides a slip.
    frequencies, modes = scipy.linalg.eigh(arrays.K[b, :n, :n], G)
    parts = np.concatenate([T, -np.eye(n)[None]])
    parts[:4] = modes.T @ T @ modes
    fall = arrays.gravity[: trajectory.steps + 1]
    c, s = np.cos(trajectory.y[:, where.rotation]), np.sin(trajectory.y[:, where.rotation])
    ax, ay = (trajectory.w[:, where.position] - fall).T
    spin = trajectory.v[:, where.rotation] ** 2
    loads = np.stack(
        [spin, trajectory.w[:, where.rotation], c * ax + s * ay, c * ay - s * ax, spin], 1
    )
    for start in range(0, len(loads), _CHUNK):
        stiffness = np.diag(frequencies) + np.tensordot(loads[start : start + _CHUNK], parts, 1)
        soft = np.linalg.eigvalsh(stiffness)[:, 0] < min(0.0, -1e-12 * frequencies[-1])
        yield from start + np.flatnonzero(soft)


def _first_unheld(trajectory: Trajectory, b: int, steps: Iterable[int]) -> int:
    """First of these steps at which forces at markers do not hold the body either; or -1."""
    arrays = trajectory.model.arrays
    elastic = coordinates_of(arrays, b).elastic
    if isinstance(arrays, spatial.ModelArrays):
        stiffened = np.any(arrays.vector_stiffened[arrays.vector_body == b] >= 0)
        inertia = np.diag(arrays.pairs[b, 9].reshape(arrays.K.shape[1:]))
    else:
        stiffened = np.any(arrays.marker_stiffened[arrays.marker_body == b] >= 0)
        inertia = np.diag(arrays.G[b])[1:]
    for k in steps:
        if not stiffened:
            return int(k)
        y, v, w = trajectory.y[k], trajectory.v[k], trajectory.w[k]
        Ky = evaluate_equations(arrays, int(k), y, v, w, trajectory.multipliers[k]).stiffness
        stiffness = Ky[elastic, elastic] + Ky[elastic, elastic].T
        scale = 1.0 / np.sqrt(inertia[: len(stiffness)])
        squares = np.linalg.eigvalsh(scale[:, None] * stiffness * scale)
        if squares[0] < min(0.0, -1e-12 * squares[-1]):
            return int(k)
    return -1
