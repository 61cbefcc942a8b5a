# SPDX-License-Identifier: MIT
"""Elastic materials in the plane and their interpolation with the density.

A material gives the stress of the solid; an interpolation scales stiffness and mass with the
density field ``x`` in [0, 1]. Both are handed to UFL with their numbers as `dolfinx.fem.Constant`,
so that another steel or another exponent compiles nothing anew.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import ufl
from dolfinx import fem, mesh

__all__ = [
    "RAMP",
    "SIMP",
    "ElasticMaterial",
    "Interpolation",
    "LinearMass",
    "MassLaw",
    "PlaneStrain",
    "PlaneStress",
    "SuppressedVoidMass",
]


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise ValueError(message)


@dataclass(frozen=True)
class ElasticMaterial:
    """Isotropic linear elasticity of a flat part.

    Use `PlaneStress` for thin parts and `PlaneStrain` for thick ones.

    Args:
        young: Young's modulus E [Pa].
        poisson: Poisson's ratio nu [-].
        density: mass density of the solid [kg/m^3].
        thickness: extent perpendicular to the plane [m].

    Raises:
        ValueError: if a number is not finite or out of its range.
    """

    young: float
    poisson: float
    density: float
    thickness: float = 1.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("young", "density", "thickness"):
            value = getattr(self, name)
            _require(
                math.isfinite(value) and value > 0.0,
                f"material: {name} = {value} must be a positive, finite number",
            )
        _require(
            math.isfinite(self.poisson) and -1.0 < self.poisson < 0.5,
            f"material: poisson = {self.poisson} must lie between -1 and 0.5, both excluded",
        )

    @property
    def lame(self) -> tuple[float, float]:
        """Lame's constants of the plane problem (lambda, mu) [Pa]."""
        raise NotImplementedError("use PlaneStress or PlaneStrain")

    @property
    def out_of_plane(self) -> float:
        """Stress perpendicular to the plane over the sum of the normal stresses in it [-]."""
        raise NotImplementedError("use PlaneStress or PlaneStrain")

    def on(self, domain: mesh.Mesh) -> BoundMaterial:
        """Return this material as UFL on the mesh ``domain``."""
        lame_lambda, lame_mu = self.lame
        return BoundMaterial(
            fem.Constant(domain, np.float64(lame_lambda * self.thickness)),
            fem.Constant(domain, np.float64(lame_mu * self.thickness)),
            fem.Constant(domain, np.float64(self.density * self.thickness)),
        )


@dataclass(frozen=True)
class PlaneStress(ElasticMaterial):
    """Isotropic linear elasticity with no stress perpendicular to the plane (thin parts)."""

    @property
    def lame(self) -> tuple[float, float]:
        """Lame's constants of the plane problem (lambda, mu) [Pa]."""
        mu = self.young / (2.0 * (1.0 + self.poisson))
        return self.young * self.poisson / (1.0 - self.poisson**2), mu

    @property
    def out_of_plane(self) -> float:
        """Stress perpendicular to the plane over the sum of the normal stresses in it [-]."""
        return 0.0


@dataclass(frozen=True)
class PlaneStrain(ElasticMaterial):
    """Isotropic linear elasticity with no strain perpendicular to the plane (thick parts)."""

    @property
    def lame(self) -> tuple[float, float]:
        """Lame's constants of the plane problem (lambda, mu) [Pa]."""
        mu = self.young / (2.0 * (1.0 + self.poisson))
        return self.young * self.poisson / ((1.0 + self.poisson) * (1.0 - 2.0 * self.poisson)), mu

    @property
    def out_of_plane(self) -> float:
        """Stress perpendicular to the plane over the sum of the normal stresses in it [-]."""
        return self.poisson


@dataclass(frozen=True)
class BoundMaterial:
    """A material on a mesh, times the thickness."""

    lame_lambda: fem.Constant  #: [N/m]
    lame_mu: fem.Constant  #: [N/m]
    density: fem.Constant  #: [kg/m^2]

    def stress(self, displacement: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """Return the stress resultant sigma(u) of the solid at a ``displacement`` u [N/m]."""
        strain = ufl.sym(ufl.grad(displacement))
        return self.lame_lambda * ufl.tr(strain) * ufl.Identity(2) + 2 * self.lame_mu * strain


class MassLaw(Protocol):
    """Share of the solid's mass that an element of density x has."""

    def on(self, domain: mesh.Mesh, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """Return the mass factor as UFL of the density field ``x`` on ``domain``."""
        ...


@dataclass(frozen=True)
class LinearMass:
    """Mass proportional to the density.

    Below a density of about 0.1 the stiffness of SIMP falls faster than this mass, and void
    elements get vibrations of their own among the first frequencies. Use it for densities that
    stay away from zero; `SuppressedVoidMass` otherwise.
    """

    def on(self, domain: mesh.Mesh, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """Return the mass factor as UFL of the density field ``x`` on ``domain``."""
        return x


@dataclass(frozen=True)
class SuppressedVoidMass:
    """Mass proportional to the density, fading faster than the stiffness below a threshold.

    m(x) = x above the threshold t, and 6 x^6/t^5 - 5 x^7/t^6 below it: continuous with its first
    derivative. For t = 0.1 this is the law of Du and Olhoff, doi:10.1007/s00158-007-0101-y.

    Args:
        threshold: density t below which the mass fades, in (0, 1).
    """

    threshold: float = 0.1

    def __post_init__(self) -> None:
        """Check the threshold."""
        _require(
            0.0 < self.threshold < 1.0,
            f"mass law: threshold = {self.threshold} must lie between 0 and 1, both excluded",
        )

    def on(self, domain: mesh.Mesh, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """Return the mass factor as UFL of the density field ``x`` on ``domain``."""
        t = fem.Constant(domain, np.float64(self.threshold))
        s = x / t
        return ufl.conditional(ufl.lt(x, t), t * s**6 * (6 - 5 * s), x)


class Interpolation(Protocol):
    """Stiffness and mass of an element between void (x = 0) and solid (x = 1)."""

    def on(
        self, domain: mesh.Mesh, x: ufl.core.expr.Expr
    ) -> tuple[ufl.core.expr.Expr, ufl.core.expr.Expr]:
        """Return the factors of stiffness and mass as UFL of the density ``x`` on ``domain``."""
        ...


def _check_floor(floor: float) -> None:
    _require(
        math.isfinite(floor) and 0.0 < floor < 1.0,
        f"interpolation: floor = {floor} must lie between 0 and 1, both excluded "
        "(a void without any stiffness makes the equations singular)",
    )


@dataclass(frozen=True)
class SIMP:
    """Solid isotropic material with penalisation: E(x)/E = floor + (1 - floor) x^p.

    Args:
        exponent: p >= 1; 3 is usual (Bendsoe and Sigmund, doi:10.1007/s004190050248).
        floor: stiffness of void relative to the solid, in (0, 1).
        mass: law of the mass.
    """

    exponent: float = 3.0
    floor: float = 1e-6
    mass: MassLaw = field(default_factory=SuppressedVoidMass)

    def __post_init__(self) -> None:
        """Check the numbers."""
        _require(
            math.isfinite(self.exponent) and self.exponent >= 1.0,
            f"SIMP: exponent = {self.exponent} must be a finite number of at least 1",
        )
        _check_floor(self.floor)

    def on(
        self, domain: mesh.Mesh, x: ufl.core.expr.Expr
    ) -> tuple[ufl.core.expr.Expr, ufl.core.expr.Expr]:
        """Return the factors of stiffness and mass as UFL of the density ``x`` on ``domain``."""
        floor = fem.Constant(domain, np.float64(self.floor))
        exponent = fem.Constant(domain, np.float64(self.exponent))
        return floor + (1 - floor) * x**exponent, self.mass.on(domain, x)


@dataclass(frozen=True)
class RAMP:
    """Rational interpolation: E(x)/E = floor + (1 - floor) x / (1 + q (1 - x)).

    Its slope at x = 0 is finite, so that void elements have no low frequencies of their own even
    with `LinearMass` (Stolpe and Svanberg, doi:10.1007/s001580100129).

    Args:
        penalty: q >= 0.
        floor: stiffness of void relative to the solid, in (0, 1).
        mass: law of the mass.
    """

    penalty: float = 8.0
    floor: float = 1e-6
    mass: MassLaw = field(default_factory=LinearMass)

    def __post_init__(self) -> None:
        """Check the numbers."""
        _require(
            math.isfinite(self.penalty) and self.penalty >= 0.0,
            f"RAMP: penalty = {self.penalty} must be a finite number of at least 0",
        )
        _check_floor(self.floor)

    def on(
        self, domain: mesh.Mesh, x: ufl.core.expr.Expr
    ) -> tuple[ufl.core.expr.Expr, ufl.core.expr.Expr]:
        """Return the factors of stiffness and mass as UFL of the density ``x`` on ``domain``."""
        floor = fem.Constant(domain, np.float64(self.floor))
        penalty = fem.Constant(domain, np.float64(self.penalty))
        return floor + (1 - floor) * x / (1 + penalty * (1 - x)), self.mass.on(domain, x)
