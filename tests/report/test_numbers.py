# SPDX-License-Identifier: MIT
"""Numbers as the report writes them."""

from __future__ import annotations

import math
from typing import Any

import pytest

from dolfinx_ffr.report.numbers import NOTHING, Scale, fixed, percent


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (0, "0"),
        (1.0, "1.000"),
        (9.99996, "10.00"),  # not 10.000: rounding may add a digit
        (-0.012344, "−0.01234"),
        (12345.6, "12\u202f346"),
        (1234567, "1\u202f234\u202f567"),
        (1e8, "1.000 × 10⁸"),
        (-2.5e-7, "−2.500 × 10⁻⁷"),
        (math.nan, NOTHING),
        (math.inf, "∞"),
        (None, NOTHING),
        ("3", NOTHING),
        (True, NOTHING),
    ],
)
def test_fixed(value: Any, text: str) -> None:
    assert fixed(value) == text


@pytest.mark.parametrize(
    ("unit", "value", "text"),
    [
        ("m", 0.04, "40.00 mm"),
        ("m^2", 0.00724, "7240 mm²"),
        ("kg", 0.0567, "56.70 g"),
        ("kg", 0.567, "0.5670 kg"),
        ("Pa", 2.416e6, "2.416 MPa"),
        ("Pa", 2.1e11, "210.0 GPa"),
        ("J s", 3.54e-5, "35.40 µJ s"),
        ("Hz", 10444.7, "10\u202f445 Hz"),
        ("m^2 s", 2.5e-6, "2.500 × 10⁻⁶ m² s"),
        ("", 0.5, "0.5000"),
        ("N", math.nan, f"{NOTHING} N"),
    ],
)
def test_scale(unit: str, value: float, text: str) -> None:
    scale = Scale(unit, value)
    assert f"{scale.text(value)} {scale.name}".strip() == text


def test_chosen_numbers_and_percent() -> None:
    """Chosen numbers end without zeros."""
    texts = [Scale("m", 1.0).without_zeros(v) for v in (0.4, 0.0125, 1e-9)]
    assert texts == ["400", "12.5", "1.00000 × 10⁻⁶"]
    assert Scale("", 1.0).without_zeros(1000.0) == "1000"
    shares = {0.0519: "5.2", -0.12: "−12", 6.5e-4: "0.065", 1e-9: "< 0.0001", 0.0: "0"}
    assert {share: percent(share) for share in shares} == shares
    assert [percent(v, sign=True) for v in (0.1, -0.1, 0.0)] == ["+10", "−10", "0"]
    assert percent(math.inf) == "∞"
