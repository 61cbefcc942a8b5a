# SPDX-License-Identifier: MIT
"""Prescribed motions: exact derivatives, and refused ones."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dolfinx_ffr.mechanism import Moving
from dolfinx_ffr.mechanism.motion import Motion


def test_smooth_step_rests_at_both_ends_and_holds() -> None:
    motion = Motion.smooth_step(3.0, 2.0, start=0.5)
    table = motion.tabulate([0.0, 0.5, 1.5, 2.5, 4.0])
    np.testing.assert_allclose(table[0], [0.0, 0.0, 1.5, 3.0, 3.0], rtol=1e-15)
    np.testing.assert_allclose(table[1], [0.0, 0.0, 1.875 * 3.0 / 2.0, 0.0, 0.0], rtol=1e-15)
    np.testing.assert_allclose(table[2], 0.0, atol=1e-15)


def pulse() -> Motion:
    """A pulse of a millisecond long after the start."""

    def values(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = (np.asarray(t) - 17.0) / 1e-3
        return x, np.exp(-(x**2))

    return Motion(
        lambda t: values(t)[1],
        lambda t: -2e3 * np.prod(values(t), axis=0),
        lambda t: 1e6 * (4.0 * values(t)[0] ** 2 - 2.0) * values(t)[1],
    )


def sawtooth() -> Motion:
    """A value that jumps every second, with a velocity that is held."""
    return Motion(lambda t: np.mod(t, 1.0), lambda t: 0.0 * t + 1.0, lambda t: 0.0 * t, "saw")


#: Motions with short or no changes in a long time, and oscillations that are much faster; others.
SCALES = [
    Motion.smooth_step(6.0, 1.0, start=250.0),
    Motion.smooth_step(1e-3, 1e-4, start=0.3),
    Moving.circle((0.0, 0.0), 0.3, Motion.smooth_step(60.0, 1.0)).x,
    Motion(
        lambda t: np.sin(900.0 * t),
        lambda t: 900.0 * np.cos(900.0 * t),
        lambda t: -810000.0 * np.sin(900.0 * t),
    ),
    pulse(),
    sawtooth(),
    Motion(lambda t: np.abs(t - 1.0), lambda t: np.sign(t - 1.0), lambda t: 0.0 * t, "kink"),
    Motion.constant(3.0),
    Motion.polynomial([1.0, -2.0, 0.5, 3.0]),
    Moving.circle((1.0, 2.0), 0.3, Motion.smooth_step(20.0, 2.0)).x,
    Moving.circle((1.0, 2.0), 0.3, Motion.smooth_step(20.0, 2.0)).y,
]


@pytest.mark.parametrize("end", [2.0, 300.0, 1e5])
@pytest.mark.parametrize("motion", SCALES, ids=range(len(SCALES)))
def test_right_derivatives_pass_in_times_of_any_length(motion: Motion, end: float) -> None:
    motion.check(0.0, end)


@pytest.mark.parametrize("part", ["velocity", "acceleration"])
@pytest.mark.parametrize("motion", SCALES[:4], ids=range(4))
def test_wrong_derivatives_are_found_in_long_times(motion: Motion, part: str) -> None:
    right = getattr(motion, part)
    wrong = replace(motion, **{part: lambda t: 1.01 * np.asarray(right(t))})
    with pytest.raises(ValueError, match=f"{part} is not the derivative"):
        wrong.check(0.0, 300.0)


def test_circle_stays_on_the_circle() -> None:
    pin = Moving.circle((0.1, -0.2), 0.3, Motion.polynomial([0.3, 2.0, 5.0]))
    t = np.linspace(0.0, 1.0, 11)
    x, y = pin.x.tabulate(t), pin.y.tabulate(t)
    np.testing.assert_allclose(np.hypot(x[0] - 0.1, y[0] + 0.2), 0.3, rtol=1e-14)
    np.testing.assert_allclose(np.hypot(x[1], y[1]), 0.3 * (2.0 + 10.0 * t), rtol=1e-14)
    np.testing.assert_allclose(x[0, 0], 0.1 + 0.3 * np.cos(0.3), rtol=1e-15)
    np.testing.assert_allclose(y[0, 0], -0.2 + 0.3 * np.sin(0.3), rtol=1e-15)


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        (
            Motion(np.sin, lambda t: -np.cos(t), lambda t: -np.sin(t), "swing"),
            "motion 'swing': the velocity is not the derivative of the value: at t = .* s it is",
        ),
        (
            Motion(np.sin, np.cos, np.sin, "swing"),
            "motion 'swing': the acceleration is not the derivative of the velocity",
        ),
        (
            Motion(lambda t: np.where(t < 1.0, t, np.nan), lambda t: 1.0, lambda t: 0.0, "gap"),
            "motion 'gap': the value is NaN or infinite at t = 1",
        ),
        (Motion(lambda t: t[:-1], lambda t: 1.0, lambda t: 0.0, "short"), "has shape"),
    ],
)
def test_refused(motion: Motion, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        motion.check(0.0, 2.0)


ENDS = ["rest", "uniform", "natural", ("rest", "natural"), ("natural", "uniform"), "periodic"]


@pytest.mark.parametrize("degree", [5, 7])
@pytest.mark.parametrize("ends", ENDS, ids=str)
def test_splines(ends: str | tuple[str, str], degree: int) -> None:
    """Through their values, with exact derivatives, linear in the values, ends as stated."""
    rng = np.random.default_rng(0)
    t = 5.0 + 1e-3 * np.cumsum(rng.uniform(0.5, 1.5, 12))
    coefficients, other_coefficients = rng.uniform(-1.0, 1.0, (2, 12))
    if ends == "periodic":
        coefficients[-1], other_coefficients[-1] = coefficients[0], other_coefficients[0]
    pair = (ends, ends) if isinstance(ends, str) else ends
    motion = Motion.spline(t, coefficients, ends=ends, degree=degree)
    np.testing.assert_allclose(motion.value(t), coefficients, atol=1e-11)
    away = [1e-3 * (end != "natural") for end in pair]
    low, high = t[0] - away[0], t[-1] + away[1]
    motion.check(low, high)
    instants = np.linspace(low, high, 101)
    table = motion.tabulate(instants)
    other = Motion.spline(t, other_coefficients, ends=ends, degree=degree).tabulate(instants)
    combined = Motion.spline(
        t, coefficients - 3.0 * other_coefficients, ends=ends, degree=degree
    ).tabulate(instants)
    for row, expected in zip(combined, table - 3.0 * other, strict=True):
        np.testing.assert_allclose(row, expected, atol=1e-9 * np.max(np.abs(expected)))
    marked = [edge for end, edge in zip(pair, t[[0, -1]], strict=True) if end in ENDS[:2]]
    assert motion.jumps == pytest.approx(marked, rel=1e-15)
    for end, beyond, edge, value in zip(
        pair, (low, high), t[[0, -1]], coefficients[[0, -1]], strict=True
    ):
        far, here = motion.tabulate([beyond])[:, 0], motion.tabulate([edge])[:, 0]
        if end == "rest":
            np.testing.assert_array_equal(far[1:], 0.0)
            assert far[0] == pytest.approx(value, abs=1e-12)
            assert np.all(np.abs(here[1:]) < 1e-10 * np.max(np.abs(table[1:]), axis=1))
        elif end == "uniform":
            assert far[2] == 0.0
            assert far[1] == here[1] != 0.0
        elif end == "natural":
            with pytest.raises(ValueError, match=r"defined from .* not at t = .*ends=.rest"):
                motion.tabulate([edge + np.sign(edge - 5.006) * 1e-4])
        else:
            again = motion.tabulate(instants + 3.0 * (t[-1] - t[0]))
            np.testing.assert_allclose(again[0], table[0], atol=1e-9)


def test_a_natural_spline_repeats_polynomials_and_converges() -> None:
    """Exact for degree 2, and of order 6 in the middle of a smooth motion."""
    t = np.array([0.0, 0.3, 0.5, 1.1, 2.0])
    square = Motion.polynomial([1.0, -2.0, 0.5])
    computed = Motion.spline(t, square.value(t), ends="natural").tabulate(np.linspace(0.0, 2.0, 41))
    np.testing.assert_allclose(computed, square.tabulate(np.linspace(0.0, 2.0, 41)), atol=1e-12)
    errors, middle = [], np.linspace(0.4, 0.6, 50)
    for n in (40, 80):
        t = np.linspace(0.0, 1.0, n + 1)
        motion = Motion.spline(t, np.sin(9.0 * t), ends="natural")
        errors.append(np.max(np.abs(motion.value(middle) - np.sin(9.0 * middle))))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(6.0, abs=0.3)


@pytest.mark.parametrize("ends", ["rest", "natural", "periodic"])
def test_smoothing_only_where_asked_for(ends: str) -> None:
    """Of noise stays the square root of knots over values; a spline of the knots is reproduced."""
    t, rng = np.linspace(0.0, 1.0, 401), np.random.default_rng(3)
    noise = rng.standard_normal(t.size)
    noise[-1] = noise[0]
    np.testing.assert_allclose(Motion.spline(t, noise, ends=ends).value(t), noise, atol=1e-12)
    fitted = Motion.spline(t, noise, ends=ends, smoothing=0.1)
    assert np.sqrt(np.mean(fitted.value(t) ** 2)) == pytest.approx(np.sqrt(11 / 401), rel=0.5)
    again = Motion.spline(t, fitted.value(t), ends=ends, smoothing=0.1)
    np.testing.assert_allclose(again.value(t), fitted.value(t), atol=1e-12)
    fitted.check(0.0, 1.0)


def test_fourier_sums_and_composition() -> None:
    wave = Motion.fourier(0.5, [1.0, 0.2], [0.3, 0.1, -0.05], mean=2.0)
    wave.check(0.0, 3.0)
    t, omega = np.linspace(0.0, 2.0, 41), 4.0 * np.pi
    expected = 2.0 + np.cos(omega * t) + 0.2 * np.cos(2 * omega * t)
    expected += 0.3 * np.sin(omega * t) + 0.1 * np.sin(2 * omega * t) - 0.05 * np.sin(3 * omega * t)
    np.testing.assert_allclose(wave.value(t), expected, atol=1e-13)
    step = Motion.smooth_step(3.0, 1.0, start=0.5)
    total = 2.0 * wave - step / 4.0 + np.float64(0.3) - sum([step, -wave])
    np.testing.assert_allclose(
        total.tabulate(t),
        3.0 * wave.tabulate(t) - 1.25 * step.tabulate(t) + [[0.3], [0.0], [0.0]],
        atol=1e-11,
    )
    assert total.jumps == (0.5, 1.5)
    total.check(0.0, 2.0)
    assert (1.0 - step).tabulate(t)[0] == pytest.approx(1.0 - step.tabulate(t)[0])
    # A cam, whose angle speeds up; a delay at double speed
    angle = np.linspace(0.0, 2.0 * np.pi, 9)
    profile = Motion.spline(angle, 1.0 - np.cos(angle), ends="periodic", name="cam")
    cam = profile.of(Motion.polynomial([0.1, 20.0]) + step)
    cam.check(0.0, 2.0)
    assert cam.jumps == step.jumps
    late = step.of(Motion.polynomial([-1.0, 2.0]))
    assert late.jumps == (0.75, 1.25)
    np.testing.assert_allclose(late.value(t), step.value(2.0 * t - 1.0))
    bent = Motion.polynomial([0.0, 0.0, 1.0])
    assert step.of(bent, jumps=np.sqrt([0.5, 1.5])).jumps == tuple(np.sqrt([0.5, 1.5]))
    pickle.loads(pickle.dumps([total, cam, late]))[1].check(0.0, 2.0)


def test_table(tmp_path: Path) -> None:
    path = tmp_path / "angles.csv"
    path.write_text("# measured\ntime [ms]; shoulder (deg); slide\n0; 350; 1\n\n10;5;2\n20; 8;4\n")
    motion = Motion.from_table(path, "shoulder", unwrap=True)
    np.testing.assert_allclose(
        motion.value(np.array([0.0, 0.01, 0.02])), np.radians([350.0, 365.0, 368.0]), rtol=1e-14
    )
    assert motion.name == "angles.csv: shoulder"
    slide = Motion.from_table(str(path), "slide", unit="mm", ends="rest")
    np.testing.assert_allclose(slide.value(np.array([0.01, 9.0])), [2e-3, 4e-3], rtol=1e-12)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1", "cp1252"])
def test_tables_in_other_encodings(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "angles.csv"
    path.write_bytes("Zeit [µs];Drehwinkel Kürbel [°]\n0;90\n1;180\n2;180\n".encode(encoding))
    motion = Motion.from_table(path, "Drehwinkel Kürbel", time="Zeit")
    np.testing.assert_allclose(motion.value(np.array([0.0, 1e-6])), [np.pi / 2, np.pi], rtol=1e-14)
    path.write_bytes(path.read_text(encoding=encoding).encode("utf-16-be"))
    with pytest.raises(ValueError, match="is no text that can be read; save it as UTF-8"):
        Motion.from_table(path, "Drehwinkel Kürbel", time="Zeit")


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("time [s],a [rad]\n0,1\n1,2\n1,3\n", {}, "line 4 repeats the time of line 3, 1; times"),
        ("time [s],a [rad]\n0,1\n2,2\n1,3\n", {}, "line 4 is earlier than line 3, 2"),
        ("time [s],a [rad]\n0,1\n1,nan\n2,3\n", {}, "'nan' in line 3 is no finite number$"),
        ("time [s];a [rad]\n0;1\n1;1,5\n", {}, "'1,5' in line 3 is no finite .* decimal point"),
        ("time [s],a [rad]\n0,1\n1\n", {}, "line 3 has 1 columns only"),
        pytest.param(
            f"time [s],a [rad]\n0,{'1' * 200_000}\n",
            {},
            "no table of numbers: field larger than",
            id="an endless field",
        ),
        ("time [s],b [rad]\n0,1\n", {}, r"there is no column 'a'; the columns are \['time', 'b'\]"),
        ("time [s],a,a\n0,1,2\n", {}, "2 columns 'a'"),
        ("time [s],a\n0,1\n1,2\n", {}, "column 'a' has no unit; write it in brackets"),
        ("time [s],a [grad]\n0,1\n1,2\n", {}, "the unit must be one of .*, but it is 'grad'"),
        ("time [s],a [deg]\n0,1\n1,2\n", {"unit": "rad"}, "unit='rad' contradicts the unit 'deg'"),
        (
            "time [s],a [deg]\n0,350\n1,5\n2,9\n",
            {},
            "from line 2 to line 3 the angle changes by 345",
        ),
        ("time [s],a [mm]\n0,1\n1,2\n", {"unwrap": True}, "unwrap is for angles, but 'a' is in mm"),
        ("time [s],a [mm]\n", {}, "there is no line of numbers"),
        ("time [s],a [mm]\n0,1\n1,2\n", {}, "needs at least 3 values, but there are 2"),
    ],
)
def test_refused_tables(text: str, options: dict, message: str, tmp_path: Path) -> None:
    path = tmp_path / "angles.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as caught:
        Motion.from_table(path, "a", **options)
    assert "angles.csv" in str(caught.value)


T = np.linspace(0.0, 1.0, 5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Motion.spline([0.0, 1.0, 1.0], T[:3]), "entry 2 is 1 s after 1 s"),
        (lambda: Motion.spline(T, T[:4]), "one value for each of the 5 times"),
        (lambda: Motion.spline(T, T * np.nan, name="arm"), "spline 'arm': values holds NaN"),
        (lambda: Motion.spline(T, T, degree=3), "the degree must be 5 or 7"),
        (lambda: Motion.spline(T, T, ends="free"), "ends must be one of"),
        (lambda: Motion.spline(T, T, ends=("rest", "periodic")), "ends must be one of"),
        (lambda: Motion.spline(T, T, ends="periodic"), "periodic motion ends with its first value"),
        (lambda: Motion.spline(T, 0.0 * T, ends="periodic"), "at least 6 values"),
        (lambda: Motion.spline(T, T, smoothing=0.1), "more knots than there are values"),
        (
            lambda: Motion.spline([0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 1.0], np.arange(7.0),
                                  smoothing=0.2),
            "too few values near some of the 6 knots",
        ),
        (lambda: Motion.fourier(0.0, [1.0]), "the period must be positive"),
        (lambda: Motion.fourier(1.0, [np.inf]), "cosines holds NaN or infinity"),
        (
            lambda: Motion.smooth_step(1.0, 1.0).of(Motion.fourier(1.0, [1.0])),
            "jumps cannot be found: give the times at which 'Fourier series' passes",
        ),
        (
            lambda: Motion.smooth_step(1.0, 1.0).of(Motion.fourier(1.0, [1.0]), jumps=[0.1]),
            r"at t = 0.1 s 'Fourier series' is 0.809.* jumps at \[0.0, 1.0\]",
        ),
    ],
)  # fmt: skip
def test_refused_when_made(make: Callable[[], Motion], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_refused_sums() -> None:
    with pytest.raises(TypeError):
        Motion.constant(1.0) + "1"  # type: ignore[operator]
    with pytest.raises(TypeError):
        Motion.constant(1.0) * np.ones(2)  # type: ignore[operator]
    with pytest.raises(ZeroDivisionError, match="divided by zero"):
        Motion.constant(1.0) / 0.0


KNOTS = np.array([0.0, 0.3, 0.9, 1.1, 1.6, 2.0])
SPLINES = {
    f"{ends} {degree}": lambda p, e=ends, d=degree: Motion.spline(KNOTS, p, ends=e, degree=d)
    for ends in ("rest", "uniform")
    for degree in (5, 7)
}
MADE = {
    **SPLINES,
    "periodic": lambda p: Motion.spline(KNOTS, np.append(p[:-1], p[0]), ends="periodic"),
    "fourier": lambda p: Motion.fourier(1.3, p[:2], p[2:5], p[5]),
    "polynomial": Motion.polynomial,
    "smooth step": lambda p: Motion.smooth_step(p[0], 1.0, 0.2),
    "sum": lambda p: p[0] * Motion.fourier(1.3, p[1:3]) - SPLINES["rest 5"](p) / 3.0,
    "circle": lambda p: Moving.circle(p[:2], p[2], SPLINES["rest 5"](p)).y,
    "direction": lambda p: Moving.circle(
        p[:3], p[2], SPLINES["rest 5"](p), "", (1.0, 2.0, 0.3)
    ).direction((0.3, p[1], p[2]))[0],
}


@pytest.mark.parametrize("make", MADE.values(), ids=list(MADE))
def test_derivatives_by_the_numbers_of_a_motion(make: Callable[[np.ndarray], Motion]) -> None:
    rng, t = np.random.default_rng(0), np.linspace(-0.3, 2.4, 61)
    p, along, bars = *rng.normal(size=(2, 6)), rng.normal(size=(3, 61))
    (before, fixed), (after, same) = (make(p + s * 1e-5 * along).stated() for s in (-1.0, 1.0))
    assert fixed == same is not None
    slope = make(p).pullback(t, bars) @ (after - before)
    far, near = (make(p + s * 1e-5 * along).tabulate(t) for s in (1.0, -1.0))
    assert slope == pytest.approx(np.vdot(bars, far - near), rel=1e-7)


@pytest.mark.parametrize("near", [1e-300, 1e-9])
def test_values_at_nearly_the_same_time_are_refused(near: float) -> None:
    """No spline goes through both without a derivative of 1e9 and more, and round-off takes it."""
    with pytest.raises(ValueError, match=r"entries 0 and 1 are .* apart in a motion of"):
        Motion.spline([0.0, near, 1.0], [0.0, 0.1, 1.0])
