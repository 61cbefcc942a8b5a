# SPDX-License-Identifier: MIT
"""A body whose volume integrals are a function of a few parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array
from .volume_integrals import VolumeIntegrals


class ParametricBody:
    """A body given by a formula: parameters p -> volume integrals, and derivatives back.

    It extends the chain of derivatives by one link of the user's, so that lengths, thicknesses or
    masses can be designed without a mesh:

        >>> rod = ParametricBody(lambda p: VolumeIntegrals.rigid(p[0], inertia=p[1]), jacobian)
        >>> evaluation = problem.gradient({"rod": rod(p)})
        >>> slope = rod.pullback(p, evaluation.integrals_gradient["rod"])

    Args:
        function: Maps parameters, shape (n,), to the integrals.
        jacobian: Maps parameters to the n derivatives of the integrals, each one of the same shape
            as the integrals, with G and K symmetric and N antisymmetric.
        pullback: Maps parameters and the derivative of a number with respect to the integrals to
            that with respect to the parameters, shape (n,); instead of ``jacobian``, for many
            parameters.
    """

    def __init__(
        self,
        function: Callable[[Array], VolumeIntegrals],
        jacobian: Callable[[Array], Sequence[VolumeIntegrals]] | None = None,
        *,
        pullback: Callable[[Array, VolumeIntegrals], ArrayLike] | None = None,
    ) -> None:
        if (jacobian is None) == (pullback is None):
            raise ValueError("a parametric body needs either a jacobian or a pullback")
        for name, given in (("function", function), ("jacobian", jacobian), ("pullback", pullback)):
            if given is not None or name == "function":
                validation.function(f"parametric body: {name}", given, "parameters")
        self._function, self._jacobian, self._pullback = function, jacobian, pullback

    def __call__(self, parameters: ArrayLike) -> VolumeIntegrals:
        """The integrals at parameters (n,), checked."""
        integrals = self._function(_checked(parameters))
        integrals.validate("parametric body")
        return integrals

    def pullback(self, parameters: ArrayLike, bar: VolumeIntegrals) -> Array:
        """The derivative (n,) by the ``parameters`` (n,), from ``bar``, that by the integrals."""
        p = _checked(parameters)
        if self._pullback is not None:
            out = np.asarray(self._pullback(p, bar), dtype=np.float64)
        else:
            assert self._jacobian is not None
            out = np.array([bar.dot(direction) for direction in self._jacobian(p)])
        if out.shape != p.shape:
            raise ValueError(
                f"parametric body: {p.size} parameters, but derivatives of shape {out.shape}"
            )
        return out


def _checked(parameters: ArrayLike) -> Array:
    p = np.atleast_1d(validation.numbers("parametric body: parameters", parameters))
    if p.ndim != 1 or not np.all(np.isfinite(p)):
        raise ValueError(f"parametric body: parameters must be a row of finite numbers, not {p}")
    return p
