# SPDX-License-Identifier: MIT
"""Relative decrease of psi, whatever its sign."""

from __future__ import annotations

import math
from dataclasses import dataclass

#: Size of psi, as a share of that at the start, below which a change no longer counts by its share
_SHARE = 1e-6
#: Size of psi that is round-off in any units: of SI's, each base unit from 1e-9 to 1e9
_NOTHING = 1e-60


@dataclass(frozen=True)
class SignedLog:
    """A logarithm that is defined for all psi, and rises with it everywhere.

    It is log psi where psi is positive, and falls as -log(-psi) where it is negative; between both,
    within a millionth of the psi at the start, it is a straight line.
    """

    scale: float  #: Size of psi below which it is a straight line

    @staticmethod
    def around(psi: float) -> SignedLog:
        """The logarithm of a run that starts with a ``psi``."""
        return SignedLog(_SHARE * abs(psi))

    def value(self, psi: float) -> float:
        """The logarithm."""
        return math.asinh(0.5 * psi / self.scale) + math.log(self.scale)

    def slope(self, psi: float) -> float:
        """Its derivative by psi, 1 / psi where psi is positive."""
        return 1.0 / math.hypot(psi, 2.0 * self.scale)


def check_start(what: str, psi: float) -> None:
    """Refuse, by a ValueError, a psi at the start from which nothing can fall."""
    if abs(psi) < _NOTHING:
        raise ValueError(
            f"{what}: psi of the start is {psi:.3g}, so there is nothing to lower: either nothing "
            "moves or loads the bodies that count (a drive is missing, or a table begins after the "
            "end of the simulated time), or the objective has a weight of zero"
        )
