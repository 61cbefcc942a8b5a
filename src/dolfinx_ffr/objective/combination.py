# SPDX-License-Identifier: MIT
"""One number from the objectives of several motions.

    weighted sum    psi = sum_i w_i psi_i
    power mean      psi = (1/n sum_i (w_i psi_i)^p)^(1/p),   p >= 1
    worst case      psi = max_i w_i psi_i

over the n motions of positive weight. The power mean lies between the mean (p = 1) and the largest
value (p to infinity), and is smooth. The largest value is not where several motions reach it; `MMA`
minimises it without a max, by the bound formulation

    min over z and the design of z   such that   w_i psi_i <= z.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from .. import validation

__all__ = ["Combination", "PowerMean", "WeightedSum", "WorstCase"]

Numbers = Mapping[str, float]

#: Share of the largest value below which a motion does not bound a step: a step that raises psi by
#: so much is taken back
NEAR = 0.5


@dataclass(frozen=True)
class Combination(ABC):
    """How the objectives of several motions become one number.

    Args:
        weights: By name of the motion, not negative; one for each motion, or none at all, which
            stands for ones. A motion of weight zero counts by its constraints only.

    Raises:
        TypeError: If the weights are no mapping from names to numbers.
        ValueError: If a weight is negative, or none is positive.
    """

    weights: Mapping[str, float] | None = None

    #: Whether psi is the least bound of several functions instead of a smooth one of them.
    bounds: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Check the weights."""
        what = f"{type(self).__name__}: weights"
        if self.weights is None:
            return
        given = validation.by_name(what, self.weights, "weights")
        for name, weight in given.items():
            validation.number(f"{what}: that of {name!r}", weight, least=0.0)
        if not any(given.values()):
            raise ValueError(f"{what}: one at least must be positive, but they are {given}")
        object.__setattr__(self, "weights", {name: float(w) for name, w in given.items()})

    def check(self, motions: Iterable[str]) -> None:
        """Refuse weights that do not fit the motions.

        Args:
            motions: Their names.

        Raises:
            ValueError: If a name is not known, or has no weight.
        """
        names = list(motions)
        if self.weights is None:
            return
        what = f"{type(self).__name__}: weights"
        unknown = [name for name in self.weights if name not in names]
        if unknown:
            raise ValueError(f"{what}: there is no motion {unknown[0]!r}, but {names}")
        missing = [name for name in names if name not in self.weights]
        if missing:
            raise ValueError(
                f"{what}: that of {missing[0]!r} is missing; a motion that is not to count has the "
                "weight 0"
            )

    def weight(self, motion: str) -> float:
        """The weight of a motion.

        Args:
            motion: Its name.
        """
        return 1.0 if self.weights is None else self.weights[motion]

    def weighted(self, psi: Numbers) -> dict[str, float]:
        """The objectives times their weights, of the motions that count.

        Args:
            psi: Values of the objectives by motion.
        """
        return {n: self.weight(n) * value for n, value in psi.items() if self.weight(n)}

    def near(self, psi: Numbers) -> list[str]:
        """The motions whose gradients an optimiser needs beside that of psi.

        Args:
            psi: Values of the objectives by motion.
        """
        return []

    @abstractmethod
    def value(self, psi: Numbers) -> float:
        """The one number.

        Args:
            psi: Values of the objectives by motion.

        Raises:
            ValueError: If it is not defined for these values.
        """

    @abstractmethod
    def slopes(self, psi: Numbers) -> dict[str, float]:
        """Its derivatives with respect to the objectives, by motion.

        Args:
            psi: Values of the objectives by motion.
        """


@dataclass(frozen=True)
class WeightedSum(Combination):
    """The sum of the objectives, each times its weight.

    A fast motion has a much larger compliance than a slow one. Weights of importance over the value
    at the start, or at the full body, make them comparable.
    """

    def value(self, psi: Numbers) -> float:
        return sum(self.weight(name) * value for name, value in psi.items())

    def slopes(self, psi: Numbers) -> dict[str, float]:
        return {name: self.weight(name) for name in psi}


@dataclass(frozen=True)
class PowerMean(Combination):
    """The power mean of the objectives, which must be positive; it favours the larger ones.

    Args:
        p: Exponent, at least 1, the weighted mean; about 8 comes near to the largest value.
        weights: As for every combination.

    Raises:
        ValueError: If p is below 1, a weight is negative, or none is positive.
    """

    p: float = field(default=8.0, kw_only=True)

    def __post_init__(self) -> None:
        """Check the weights and the exponent."""
        super().__post_init__()
        validation.number("PowerMean: p", self.p, least=1.0)

    def value(self, psi: Numbers) -> float:
        ratios, largest = self._ratios(psi)
        return float(largest * self._mean(ratios))

    def slopes(self, psi: Numbers) -> dict[str, float]:
        ratios, _ = self._ratios(psi)
        mean, count = self._mean(ratios), len(ratios)
        return {
            name: self.weight(name) / count * (ratios[name] / mean) ** (self.p - 1.0)
            if name in ratios
            else 0.0
            for name in psi
        }

    def _mean(self, ratios: Numbers) -> float:
        mean: float = sum(ratio**self.p for ratio in ratios.values()) / len(ratios)
        return mean ** (1.0 / self.p)

    def _ratios(self, psi: Numbers) -> tuple[dict[str, float], float]:
        """Weighted objectives over the largest, whose powers do not overflow, and the largest."""
        weighted = self.weighted(psi)
        for name, value in weighted.items():
            if not value > 0.0:
                raise ValueError(
                    f"PowerMean needs positive objectives, and that of motion {name!r} is "
                    f"{psi[name]:.6g}; take WeightedSum or WorstCase"
                )
        largest = max(weighted.values())
        return {name: value / largest for name, value in weighted.items()}, largest


@dataclass(frozen=True)
class WorstCase(Combination):
    """The largest of the objectives, each times its weight; for `MMA`.

    Its gradient is that of the motion with the largest value. Beside it each motion that comes near
    gets a gradient of its own, with which `MMA` minimises the bound of all.
    """

    bounds: ClassVar[bool] = True

    def value(self, psi: Numbers) -> float:
        return max(self.weighted(psi).values())

    def slopes(self, psi: Numbers) -> dict[str, float]:
        weighted = self.weighted(psi)
        worst = max(weighted, key=lambda name: weighted[name])
        return {name: self.weight(name) if name == worst else 0.0 for name in psi}

    def near(self, psi: Numbers) -> list[str]:
        weighted = self.weighted(psi)
        largest = max(weighted.values())
        return [n for n, v in weighted.items() if v >= NEAR * largest or largest <= 0.0]
