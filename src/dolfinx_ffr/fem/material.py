# SPDX-License-Identifier: MIT
"""Elastic materials and their interpolation with the density field ``x`` in [0, 1].

Both are handed to UFL with their numbers as `dolfinx.fem.Constant`, so that another steel or
another exponent compiles nothing anew.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Protocol

import numpy as np
import ufl
from dolfinx import fem, mesh
from ufl.core.expr import Expr

from .. import validation


class BoundMaterial(Protocol):
    """A material on a mesh; in the plane times the thickness of the part."""

    @property
    def density(self) -> Expr:
        """Mass of the solid by area, in space by volume; a constant scalar [kg/m^2], [kg/m^3]."""
        ...

    def stress(self, displacement: Expr) -> Expr:
        """The stress resultant sigma(u) of the solid, in space its stress.

        For a ``displacement`` u of as many components as the mesh has dimensions, a
        `dolfinx.fem.Function`, or the trial or test function of a form [m]. Symmetric, of shape
        (2, 2) [N/m] or (3, 3) [Pa], in the axes of the mesh.

        It is linear in u, and a(u, v) = int sigma(u) : eps(v) dX is symmetric and positive but for
        rigid motions: the stiffness is factored by Cholesky's method, and the pullback takes it for
        its own transpose.
        """
        ...


class ElasticMaterial(Protocol):
    """The solid of a body.

    Any class with these members serves; it need not derive from this one. `PlaneStress`,
    `PlaneStrain` and `Isotropic` have them; tests/fem/test_material.py has a law of wood.

    An element of density x has E(x) times the stress and rho(x) times the mass that are given here
    (`Interpolation`). Derivatives are taken with respect to x alone, by UFL; a material has none to
    give, and does not depend on x.
    """

    @property
    def thickness(self) -> float:
        """Extent perpendicular to the plane, stress resultant over stress; 1 in space [m]."""
        ...

    @property
    def out_of_plane(self) -> float:
        """Normal stress out of the plane over the sum of those in it, for von Mises' stress [-]."""
        ...

    @property
    def density(self) -> float:
        """Mass of the solid by volume, to weigh parts; it may be missing [kg/m^3].

        Bodies have their mass by `BoundMaterial.density`.
        """
        ...

    @property
    def dimension(self) -> int:
        """Dimension of its meshes, 2 or 3; a law without it is one for the plane."""
        ...

    def on(self, domain: mesh.Mesh) -> BoundMaterial:
        """This material as UFL on a mesh, ``domain``, in metres.

        Numbers should be `dolfinx.fem.Constant`, so that others compile nothing anew. Fields of
        `ufl.SpatialCoordinate` serve as well; they are integrated by the rule that is exact for the
        displacements.
        """
        ...


@dataclass(frozen=True)
class _BoundIsotropic:
    """Isotropic linear elasticity on a mesh, in the plane times the thickness."""

    lame_lambda: fem.Constant  #: [N/m], in space [Pa]
    lame_mu: fem.Constant  #: [N/m], in space [Pa]
    density: fem.Constant  #: [kg/m^2], in space [kg/m^3]

    def stress(self, displacement: Expr) -> Expr:
        strain = ufl.sym(ufl.grad(displacement))
        unit = ufl.Identity(len(displacement))
        return self.lame_lambda * ufl.tr(strain) * unit + 2 * self.lame_mu * strain


@dataclass(frozen=True)
class _LinearElastic:
    """Isotropic linear elasticity in space or in plane strain."""

    young: float  #: Young's modulus E [Pa]
    poisson: float  #: Poisson's ratio nu, between -1 and 0.5 [-]
    density: float  #: Mass density of the solid [kg/m^3]

    dimension: ClassVar[int] = 3
    # of no meaning in space
    thickness: ClassVar[float] = 1.0
    out_of_plane: ClassVar[float] = 0.0

    def __post_init__(self) -> None:
        for name in ("young", "density", "thickness"):
            validation.number(f"material: {name}", getattr(self, name), above=0.0)
        validation.number("material: poisson", self.poisson, above=-1.0, below=0.5)

    @property
    def lame(self) -> tuple[float, float]:
        """Lame's constants of the problem (lambda, mu) [Pa]."""
        lame_lambda = (
            self.young * self.poisson / ((1.0 + self.poisson) * (1.0 - 2.0 * self.poisson))
        )
        return lame_lambda, self.young / (2.0 * (1.0 + self.poisson))

    def on(self, domain: mesh.Mesh) -> BoundMaterial:
        """This material as UFL on the mesh ``domain``."""
        numbers = (number * self.thickness for number in (*self.lame, self.density))
        return _BoundIsotropic(*(fem.Constant(domain, np.float64(number)) for number in numbers))


@dataclass(frozen=True)
class Isotropic(_LinearElastic):
    """Isotropic linear elasticity of a body in space.

    Attributes:
        young: Young's modulus E [Pa].
        poisson: Poisson's ratio nu, between -1 and 0.5 [-].
        density: Mass density of the solid [kg/m^3].
    """


@dataclass(frozen=True)
class PlaneStrain(_LinearElastic):
    """Isotropic linear elasticity with no strain perpendicular to the plane (thick parts).

    Attributes:
        young: Young's modulus E [Pa].
        poisson: Poisson's ratio nu, between -1 and 0.5 [-].
        density: Mass density of the solid [kg/m^3].
        thickness: Extent perpendicular to the plane [m].
    """

    dimension: ClassVar[int] = 2
    thickness: float = 1.0  # type: ignore[misc]

    @property
    def out_of_plane(self) -> float:  # type: ignore[override]
        """Poisson's ratio [-]."""
        return self.poisson


@dataclass(frozen=True)
class PlaneStress(_LinearElastic):
    """Isotropic linear elasticity with no stress perpendicular to the plane (thin parts).

    Attributes:
        young: Young's modulus E [Pa].
        poisson: Poisson's ratio nu, between -1 and 0.5 [-].
        density: Mass density of the solid [kg/m^3].
        thickness: Extent perpendicular to the plane [m].
    """

    dimension: ClassVar[int] = 2
    thickness: float = 1.0  # type: ignore[misc]

    @property
    def lame(self) -> tuple[float, float]:
        """Lame's constants of the plane problem (lambda, mu) [Pa]."""
        lame_lambda = self.young * self.poisson / (1.0 - self.poisson**2)
        return lame_lambda, self.young / (2.0 * (1.0 + self.poisson))


class MassLaw(Protocol):
    """Share of the solid's mass that an element of density x has."""

    def on(self, domain: mesh.Mesh, x: Expr) -> Expr:
        """The mass factor as UFL of the density field ``x`` on ``domain``."""
        ...


@dataclass(frozen=True)
class LinearMass:
    """Mass proportional to the density.

    Below a density of about 0.1 the stiffness of SIMP falls faster than this mass, and void
    elements get vibrations of their own among the first frequencies. Use it for densities that
    stay away from zero; `SuppressedVoidMass` otherwise.
    """

    def on(self, domain: mesh.Mesh, x: Expr) -> Expr:
        """The mass factor as UFL of the density field ``x`` on ``domain``."""
        return x


@dataclass(frozen=True)
class SuppressedVoidMass:
    """Mass proportional to the density, fading faster than the stiffness below a threshold.

    m(x) = x above the threshold t, and 6 x^6/t^5 - 5 x^7/t^6 below it: continuous with its first
    derivative. For t = 0.1 this is the law of Du and Olhoff, doi:10.1007/s00158-007-0101-y.

    Attributes:
        threshold: Density t below which the mass fades, in (0, 1).
    """

    threshold: float = 0.1

    def __post_init__(self) -> None:
        validation.number("mass law: threshold", self.threshold, above=0.0, below=1.0)

    def on(self, domain: mesh.Mesh, x: Expr) -> Expr:
        """The mass factor as UFL of the density field ``x`` on ``domain``."""
        t = fem.Constant(domain, np.float64(self.threshold))
        s = x / t
        return ufl.conditional(ufl.lt(x, t), t * s**6 * (6 - 5 * s), x)


class Interpolation(Protocol):
    """Stiffness and mass of an element between void (x = 0) and solid (x = 1)."""

    def on(self, domain: mesh.Mesh, x: Expr) -> tuple[Expr, Expr]:
        """The factors of stiffness and mass as UFL of ``x`` on ``domain``, constant in cells."""
        ...


#: Exponents of SIMP for elements that a boundary cuts, by cell, for orders 1 and 2, which give psi
#: of a mesh that fits the boundary (docs/from_field_to_part.md).
#: Linear elements add stiffness of their own, which makes up for a larger exponent.
CUT = {
    "quadrilateral": (1.35, 1.25),
    "triangle": (1.5, 1.0),
    # in members two to three elements wide the best exponents scatter about these;
    # linear tetrahedra are too stiff for any exponent
    "hexahedron": (1.25, 1.25),
    "tetrahedron": (3.0, 1.25),
}


def cut_exponent(cell: str, order: int) -> float:
    """The exponent of SIMP for elements that a boundary cuts; order 2 stands for higher ones."""
    return CUT[cell][min(order, 2) - 1]


class _WithFloor:
    """Stiffness floor + (1 - floor) s(x), and mass by a law of its own."""

    floor: float
    mass: MassLaw
    _own: ClassVar[tuple[str, float]]  #: The number of the law itself, and the least that it is

    def __post_init__(self) -> None:
        name, least = self._own
        validation.number(f"{type(self).__name__}: {name}", getattr(self, name), least=least)
        law = "a law of mass, as LinearMass()"
        validation.implementation("interpolation: mass", self.mass, ["on"], law)
        # a void without any stiffness makes the equations singular
        validation.number("interpolation: floor", self.floor, above=0.0, below=1.0)

    def on(self, domain: mesh.Mesh, x: Expr) -> tuple[Expr, Expr]:
        """The factors of stiffness and mass as UFL of ``x`` on ``domain``, constant in cells."""
        floor = fem.Constant(domain, np.float64(self.floor))
        return floor + (1 - floor) * self._stiffness(domain, x), self.mass.on(domain, x)

    def _stiffness(self, domain: mesh.Mesh, x: Expr) -> Expr:
        """The share s(x) of the solid's stiffness, 0 for void and 1 for solid, as UFL."""
        raise NotImplementedError


@dataclass(frozen=True)
class SIMP(_WithFloor):
    """Solid isotropic material with penalisation: E(x)/E = floor + (1 - floor) x^p.

    Attributes:
        exponent: p >= 1; 3 is usual (Bendsoe and Sigmund, doi:10.1007/s004190050248).
        floor: Stiffness of void relative to the solid, in (0, 1).
        mass: Law of the mass.
    """

    exponent: float = 3.0
    floor: float = 1e-6
    mass: MassLaw = field(default_factory=SuppressedVoidMass)
    _own = "exponent", 1.0

    def _stiffness(self, domain: mesh.Mesh, x: Expr) -> Expr:
        return x ** fem.Constant(domain, np.float64(self.exponent))

    def cut(self, exponent: float) -> SIMP:
        """The law for elements that a boundary cuts, with at most their ``exponent``."""
        return replace(self, exponent=min(exponent, self.exponent))


#: Stiffness and mass in proportion to the thickness, as plane stress has them of a milled plate;
#: the floor is what no thickness may fall below, and far less than a web
PLATE = SIMP(exponent=1.0, floor=1e-9, mass=LinearMass())


@dataclass(frozen=True)
class RAMP(_WithFloor):
    """Rational interpolation: E(x)/E = floor + (1 - floor) x / (1 + q (1 - x)).

    Its slope at x = 0 is finite, so that void elements have no low frequencies of their own even
    with `LinearMass` (Stolpe and Svanberg, doi:10.1007/s001580100129).

    Attributes:
        penalty: q >= 0.
        floor: Stiffness of void relative to the solid, in (0, 1).
        mass: Law of the mass.
    """

    penalty: float = 8.0
    floor: float = 1e-6
    mass: MassLaw = field(default_factory=LinearMass)
    _own = "penalty", 0.0

    def _stiffness(self, domain: mesh.Mesh, x: Expr) -> Expr:
        penalty = fem.Constant(domain, np.float64(self.penalty))
        return x / (1 + penalty * (1 - x))

    def cut(self, exponent: float) -> RAMP:
        """The law by which half an element has the stiffness that SIMP of an ``exponent`` gives."""
        return replace(self, penalty=min(2.0 * (2.0 ** (exponent - 1.0) - 1.0), self.penalty))
