# SPDX-License-Identifier: MIT
"""A body whose volume integrals are a function of a few parameters, and a file of derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from operator import add
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array
from ..interchange import derived_terms, write_all
from .volume_integrals import VolumeIntegrals


class ParametricBody:
    """A body given by a formula: parameters p -> volume integrals, and derivatives back.

    It extends the chain of derivatives by one link of the user's, so that lengths, thicknesses or
    masses can be designed without a mesh:

        >>> rod = ParametricBody(lambda p: VolumeIntegrals.rigid(p[0], inertia=p[1]), jacobian)
        >>> evaluation = problem.gradient({"rod": rod(p)})
        >>> slope = rod.pullback(p, evaluation.integrals_gradient["rod"])

    Args:
        function: From parameters, shape (n,), to the integrals.
        jacobian: From parameters to the n derivatives of the integrals, each one of the same shape
            as the integrals, with G and K symmetric and N antisymmetric.
        pullback: From parameters and the derivative of a number with respect to the integrals to
            that with respect to the parameters, shape (n,); instead of ``jacobian``, for many
            parameters.

    Raises:
        ValueError: If not exactly one of ``jacobian`` and ``pullback`` is given.
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
        """The derivative (n,) by the ``parameters`` (n,), from ``bar``, that by the integrals.

        Raises:
            ValueError: If a parameter is NaN or infinite, or the result has the wrong shape.
        """
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


def save_derivatives(path: str | Path, derivatives: Mapping[str, VolumeIntegrals]) -> None:
    """Write the derivatives of the terms of standard input data by the variables of a design.

    The file .npz stands beside that of the body, and holds ``variables`` (n,), and for each term of
    the body, as ``Ct``, arrays ``Ct.m0`` and ``Ct.m1`` of its derivatives by all of them, shape
    (n, rows, columns) and (n, rows, modes, columns); those of node 1 are ``node1.phi.m0``. De has
    those of Me and Ke, times the factors of the damping. `FlexibleBody.save_derivatives` writes
    those of a body with a mesh.

    Args:
        path: Of the file; an older one is replaced.
        derivatives: By name of the variable, that of the integrals of the body in space, as the
            ``jacobian`` of a `ParametricBody` has them.

    Raises:
        ValueError: If there are none, or they are of bodies in the plane.
        OSError: If the file cannot be written.
    """
    needed = "the derivatives of a body in space, as VolumeIntegrals"
    validation.instances_by_name("save_derivatives", derivatives, VolumeIntegrals, needed)
    if not derivatives or any(each.P is None for each in derivatives.values()):
        raise ValueError("save_derivatives: give derivatives, of a body in space")
    # geometric stiffness that depends on some of the variables alone
    nothing = reduce(add, (each.zeros_like() for each in derivatives.values()))
    found = derived_terms((each + nothing).by_key for each in derivatives.values())
    found["variables"] = np.array(list(derivatives), dtype=np.str_)
    write_all(validation.path("save_derivatives: path", path), found)
