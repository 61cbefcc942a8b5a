# SPDX-License-Identifier: MIT
"""One number from the objectives of several load cases.

    weighted sum    psi = sum_i w_i psi_i
    power mean      psi = (1/n sum_i (w_i psi_i)^p)^(1/p),   p >= 1
    worst case      psi = max_i w_i psi_i

over the n load cases of positive weight. The power mean lies between the mean (p = 1) and the
largest value (p to infinity), and is smooth. The largest value has kinks; `MMA` minimises it by

    min over z and the design of z   such that   w_i psi_i <= z.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from .. import validation

Numbers = Mapping[str, float]

#: Least share of the largest value for which a load case bounds a step; psi of a smaller one may
#: double before it counts, and a step that raises psi by so much is rejected
NEAR = 0.5


@dataclass(frozen=True)
class Combination(ABC):
    """A combination of the objectives of several load cases to one number.

    Args:
        weights: By name of the load case, not negative; one for each, or None, which stands for
            ones. A load case of weight zero has constraints, but no share in psi.
    """

    weights: Mapping[str, float] | None = None

    #: Whether psi is the largest of several functions instead of a smooth function of them
    bounds: ClassVar[bool] = False

    def __post_init__(self) -> None:
        label = f"{type(self).__name__}: weights"
        if self.weights is None:
            return
        weights = {
            name: validation.number(f"{label}: weight of {name!r}", weight, least=0.0)
            for name, weight in validation.by_name(label, self.weights, "weights").items()
        }
        if not any(weights.values()):
            raise ValueError(
                f"{label}: at least one weight must be positive, but they are {weights}"
            )
        object.__setattr__(self, "weights", weights)

    def check(self, load_cases: Iterable[str]) -> None:
        """Refuse weights that do not fit the ``load_cases``, given by name."""
        names = list(load_cases)
        if self.weights is None:
            return
        label = f"{type(self).__name__}: weights"
        unknown = [name for name in self.weights if name not in names]
        if unknown:
            raise ValueError(
                f"{label}: there is no load case {unknown[0]!r}; the load cases are {names}"
            )
        missing = [name for name in names if name not in self.weights]
        if missing:
            raise ValueError(
                f"{label}: the weight of {missing[0]!r} is missing; give the weight 0 to a load "
                "case that does not count"
            )

    def weight(self, load_case: str) -> float:
        """The weight of a ``load_case``, by its name."""
        return 1.0 if self.weights is None else self.weights[load_case]

    def weighted(self, psi: Numbers) -> dict[str, float]:
        """The objectives ``psi`` times their weights, where these are positive, by load case."""
        return {n: self.weight(n) * value for n, value in psi.items() if self.weight(n)}

    def near(self, psi: Numbers) -> list[str]:
        """Load cases whose own gradients an optimiser needs at the values ``psi``."""
        return []

    @abstractmethod
    def value(self, psi: Numbers) -> float:
        """The one number from the objectives ``psi`` by load case.

        Raises:
            ValueError: If it is not defined for these values.
        """

    @abstractmethod
    def slopes(self, psi: Numbers) -> dict[str, float]:
        """Its derivatives with respect to the objectives at values ``psi``, by load case."""


@dataclass(frozen=True)
class WeightedSum(Combination):
    """The sum of the objectives, each times its weight.

    A fast machine has a much larger compliance than a slow one. Weights of importance over the
    value at the start, or at the full body, make them comparable.
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
        weights: Weights as for every combination.
    """

    p: float = field(default=8.0, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        validation.number("PowerMean: p", self.p, least=1.0)

    def value(self, psi: Numbers) -> float:
        _, mean, largest = self._mean(psi)
        return largest * mean

    def slopes(self, psi: Numbers) -> dict[str, float]:
        ratios, mean, _ = self._mean(psi)
        share = {n: (ratio / mean) ** (self.p - 1.0) / len(ratios) for n, ratio in ratios.items()}
        return {name: self.weight(name) * share.get(name, 0.0) for name in psi}

    def _mean(self, psi: Numbers) -> tuple[dict[str, float], float, float]:
        """Ratios of weighted objectives to the largest, their mean, and the largest."""
        weighted = self.weighted(psi)
        for name, value in weighted.items():
            if not value > 0.0:
                raise ValueError(
                    f"PowerMean needs positive objectives, but psi of load case {name!r} is "
                    f"{psi[name]:.6g}; take WeightedSum or WorstCase"
                )
        largest = max(weighted.values())
        ratios = {name: value / largest for name, value in weighted.items()}
        mean: float = sum(ratio**self.p for ratio in ratios.values()) / len(ratios)
        return ratios, mean ** (1.0 / self.p), largest


@dataclass(frozen=True)
class WorstCase(Combination):
    """The largest of the objectives, each times its weight; for `MMA`.

    Its gradient is the gradient of the load case with the largest value. Each load case near the
    largest has a gradient of its own, too, with which `MMA` minimises the bound of all.
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
