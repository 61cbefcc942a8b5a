# SPDX-License-Identifier: MIT
"""A lower bound of psi for all parts, and the gap of a design above it."""

from __future__ import annotations

from .lower_bound import LowerBound as LowerBound
from .lower_bound import bound as bound
