# SPDX-License-Identifier: MIT
"""How far a design is from the best possible one: a bound that no part can pass."""

from __future__ import annotations

from .lower_bound import LowerBound as LowerBound
from .lower_bound import bound as bound
