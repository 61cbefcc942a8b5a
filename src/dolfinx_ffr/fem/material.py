# SPDX-License-Identifier: MIT
"""Elastic materials and their interpolation with the density.

A material gives the stress of the solid; an interpolation scales stiffness and mass with the
density field ``x`` in [0, 1]. Both are handed to UFL with their numbers as `dolfinx.fem.Constant`,
so that another steel or another exponent compiles nothing anew.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Protocol

import numpy as np
import ufl
from dolfinx import fem, mesh

from .. import validation

__all__ = [
    "RAMP",
    "SIMP",
    "BoundMaterial",
    "ElasticMaterial",
    "Interpolation",
    "Isotropic",
    "LinearMass",
    "MassLaw",
    "PlaneStrain",
    "PlaneStress",
    "SuppressedVoidMass",
]


class BoundMaterial(Protocol):
    """A material on a mesh; in the plane times the thickness of the part."""

    @property
    def density(self) -> ufl.core.expr.Expr:
        """Mass of the solid by area [kg/m^2], in space by volume [kg/m^3].

        A scalar that does not depend on time.
        """
        ...

    def stress(self, displacement: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """The stress resultant sigma(u) of the solid, in space its stress.

        It is linear in u, and a(u, v) = int sigma(u) : eps(v) dX is symmetric and positive but for
        rigid motions: the stiffness is factored by Cholesky's method, and the pullback takes it for
        its own transpose.

        Args:
            displacement: u, a field of as many components as the mesh has dimensions: a
                `dolfinx.fem.Function`, or the trial or test function of a form [m].

        Returns:
            Symmetric, of shape (2, 2) [N/m] or (3, 3) [Pa], in the axes of the mesh.
        """
        ...


class ElasticMaterial(Protocol):
    """What a body must know of its solid.

    Any class with these three serves; it need not derive from this one. `PlaneStress` and
    `PlaneStrain` do, and CONTRIBUTING.md has an orthotropic one. A material for bodies in space, as
    `Isotropic`, has ``dimension = 3`` besides, and thickness 1.

    An element of density x has E(x) times the stress and rho(x) times the mass that are given here
    (`Interpolation`). Derivatives are taken with respect to x alone, by UFL; a material has none to
    give, and does not depend on x.
    """

    @property
    def thickness(self) -> float:
        """Extent perpendicular to the plane, by which resultants are divided for stresses [m]."""
        ...

    @property
    def out_of_plane(self) -> float:
        """Stress perpendicular to the plane over the sum of the normal stresses in it [-].

        Zero in plane stress. It enters the von Mises stress and nothing else.
        """
        ...

    def on(self, domain: mesh.Mesh) -> BoundMaterial:
        """This material as UFL on a mesh.

        Numbers should be `dolfinx.fem.Constant`, so that others compile nothing anew. Fields of
        `ufl.SpatialCoordinate` serve as well; they are integrated by the rule that is exact for the
        displacements.

        Args:
            domain: The mesh, in metres.
        """
        ...


@dataclass(frozen=True)
class _Isotropic:
    """Isotropic linear elasticity, in space or in plane strain."""

    young: float
    poisson: float
    density: float

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("young", "density"):
            validation.number(f"material: {name}", getattr(self, name), above=0.0)
        validation.number("material: poisson", self.poisson, above=-1.0, below=0.5)

    @property
    def lame(self) -> tuple[float, float]:
        """Lame's constants of the problem (lambda, mu) [Pa]."""
        first = self.young * self.poisson / ((1.0 + self.poisson) * (1.0 - 2.0 * self.poisson))
        return first, self.young / (2.0 * (1.0 + self.poisson))

    def _on(self, domain: mesh.Mesh, thickness: float) -> _BoundIsotropic:
        first, second = self.lame
        numbers = (first * thickness, second * thickness, self.density * thickness)
        return _BoundIsotropic(*(fem.Constant(domain, np.float64(number)) for number in numbers))


@dataclass(frozen=True)
class Isotropic(_Isotropic):
    """Isotropic linear elasticity of a body in space.

    Args:
        young: Young's modulus E [Pa].
        poisson: Poisson's ratio nu, between -1 and 0.5 [-].
        density: Mass density of the solid [kg/m^3].

    Raises:
        ValueError: If a number is not finite or out of its range.
    """

    dimension: ClassVar[int] = 3  #: Of its meshes
    thickness: ClassVar[float] = 1.0  #: Of no meaning in space [-]
    out_of_plane: ClassVar[float] = 0.0  #: Of no meaning in space [-]

    def on(self, domain: mesh.Mesh) -> BoundMaterial:
        """This material as UFL on the mesh ``domain``."""
        return self._on(domain, 1.0)


@dataclass(frozen=True)
class _Flat(_Isotropic):
    """Isotropic linear elasticity of a flat part."""

    thickness: float = 1.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        super().__post_init__()
        validation.number("material: thickness", self.thickness, above=0.0)

    def on(self, domain: mesh.Mesh) -> BoundMaterial:
        """This material as UFL on the mesh ``domain``."""
        return self._on(domain, self.thickness)


@dataclass(frozen=True)
class _BoundIsotropic:
    """Isotropic linear elasticity on a mesh, in the plane times the thickness."""

    lame_lambda: fem.Constant  #: [N/m], in space [Pa]
    lame_mu: fem.Constant  #: [N/m], in space [Pa]
    density: fem.Constant  #: [kg/m^2], in space [kg/m^3]

    def stress(self, displacement: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        strain = ufl.sym(ufl.grad(displacement))
        unit = ufl.Identity(len(displacement))
        return self.lame_lambda * ufl.tr(strain) * unit + 2 * self.lame_mu * strain


@dataclass(frozen=True)
class PlaneStress(_Flat):
    """Isotropic linear elasticity with no stress perpendicular to the plane (thin parts).

    Args:
        young: Young's modulus E [Pa].
        poisson: Poisson's ratio nu, between -1 and 0.5 [-].
        density: Mass density of the solid [kg/m^3].
        thickness: Extent perpendicular to the plane [m].

    Raises:
        ValueError: If a number is not finite or out of its range.
    """

    @property
    def lame(self) -> tuple[float, float]:
        """Lame's constants of the plane problem (lambda, mu) [Pa]."""
        first = self.young * self.poisson / (1.0 - self.poisson**2)
        return first, self.young / (2.0 * (1.0 + self.poisson))

    @property
    def out_of_plane(self) -> float:
        """Zero [-]."""
        return 0.0


@dataclass(frozen=True)
class PlaneStrain(_Flat):
    """Isotropic linear elasticity with no strain perpendicular to the plane (thick parts).

    Args:
        young: Young's modulus E [Pa].
        poisson: Poisson's ratio nu, between -1 and 0.5 [-].
        density: Mass density of the solid [kg/m^3].
        thickness: Extent perpendicular to the plane [m].

    Raises:
        ValueError: If a number is not finite or out of its range.
    """

    @property
    def out_of_plane(self) -> float:
        """Poisson's ratio [-]."""
        return self.poisson


class MassLaw(Protocol):
    """Share of the solid's mass that an element of density x has."""

    def on(self, domain: mesh.Mesh, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """The mass factor as UFL of the density field ``x`` on ``domain``."""
        ...


@dataclass(frozen=True)
class LinearMass:
    """Mass proportional to the density.

    Below a density of about 0.1 the stiffness of SIMP falls faster than this mass, and void
    elements get vibrations of their own among the first frequencies. Use it for densities that
    stay away from zero; `SuppressedVoidMass` otherwise.
    """

    def on(self, domain: mesh.Mesh, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """The mass factor as UFL of the density field ``x`` on ``domain``."""
        return x


@dataclass(frozen=True)
class SuppressedVoidMass:
    """Mass proportional to the density, fading faster than the stiffness below a threshold.

    m(x) = x above the threshold t, and 6 x^6/t^5 - 5 x^7/t^6 below it: continuous with its first
    derivative. For t = 0.1 this is the law of Du and Olhoff, doi:10.1007/s00158-007-0101-y.

    Args:
        threshold: Density t below which the mass fades, in (0, 1).
    """

    threshold: float = 0.1

    def __post_init__(self) -> None:
        """Check the threshold."""
        validation.number("mass law: threshold", self.threshold, above=0.0, below=1.0)

    def on(self, domain: mesh.Mesh, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """The mass factor as UFL of the density field ``x`` on ``domain``."""
        t = fem.Constant(domain, np.float64(self.threshold))
        s = x / t
        return ufl.conditional(ufl.lt(x, t), t * s**6 * (6 - 5 * s), x)


class Interpolation(Protocol):
    """Stiffness and mass of an element between void (x = 0) and solid (x = 1)."""

    def on(
        self, domain: mesh.Mesh, x: ufl.core.expr.Expr
    ) -> tuple[ufl.core.expr.Expr, ufl.core.expr.Expr]:
        """The factors of stiffness and mass as UFL of the density ``x`` on ``domain``."""
        ...


def _check_law(floor: float, mass: MassLaw) -> None:
    validation.implementation("interpolation: mass", mass, ["on"], "a law of mass, as LinearMass()")
    # a void without any stiffness makes the equations singular
    validation.number("interpolation: floor", floor, above=0.0, below=1.0)


#: Exponent of SIMP for elements that a boundary cuts, by cell and order: psi by it is that of a
#: mesh which fits the boundary, as measured by the last table of docs/benchmarks/designs.md. Linear
#: elements add stiffness of their own, which makes up for a larger exponent.
CUT = {
    ("quadrilateral", 1): 1.35,
    ("triangle", 1): 1.5,
    ("quadrilateral", 2): 1.25,
    ("triangle", 2): 1.0,
    # docs/benchmarks/solids.md: those of members two to three elements wide scatter about these;
    # linear tetrahedra are too stiff for any exponent
    ("hexahedron", 1): 1.25,
    ("tetrahedron", 1): 3.0,
    ("hexahedron", 2): 1.25,
    ("tetrahedron", 2): 1.25,
}


def cut_exponent(cell: str, order: int) -> float:
    """The exponent of SIMP for elements that a boundary cuts.

    Args:
        cell: Its name, as ``"triangle"``.
        order: Polynomial order of the displacements; above two that of two is taken.
    """
    return CUT[cell, min(order, 2)]


@dataclass(frozen=True)
class SIMP:
    """Solid isotropic material with penalisation: E(x)/E = floor + (1 - floor) x^p.

    Args:
        exponent: p >= 1; 3 is usual (Bendsoe and Sigmund, doi:10.1007/s004190050248).
        floor: Stiffness of void relative to the solid, in (0, 1).
        mass: Law of the mass.
    """

    exponent: float = 3.0
    floor: float = 1e-6
    mass: MassLaw = field(default_factory=SuppressedVoidMass)

    def __post_init__(self) -> None:
        """Check the numbers."""
        validation.number("SIMP: exponent", self.exponent, least=1.0)
        _check_law(self.floor, self.mass)

    def on(
        self, domain: mesh.Mesh, x: ufl.core.expr.Expr
    ) -> tuple[ufl.core.expr.Expr, ufl.core.expr.Expr]:
        """The factors of stiffness and mass as UFL of the density ``x`` on ``domain``."""
        floor = fem.Constant(domain, np.float64(self.floor))
        exponent = fem.Constant(domain, np.float64(self.exponent))
        return floor + (1 - floor) * x**exponent, self.mass.on(domain, x)

    def cut(self, exponent: float) -> SIMP:
        """The law for densities that are the share of an element which a boundary encloses.

        Args:
            exponent: That of the elements, see `cut_exponent`.
        """
        return replace(self, exponent=min(exponent, self.exponent))


@dataclass(frozen=True)
class RAMP:
    """Rational interpolation: E(x)/E = floor + (1 - floor) x / (1 + q (1 - x)).

    Its slope at x = 0 is finite, so that void elements have no low frequencies of their own even
    with `LinearMass` (Stolpe and Svanberg, doi:10.1007/s001580100129).

    Args:
        penalty: q >= 0.
        floor: Stiffness of void relative to the solid, in (0, 1).
        mass: Law of the mass.
    """

    penalty: float = 8.0
    floor: float = 1e-6
    mass: MassLaw = field(default_factory=LinearMass)

    def __post_init__(self) -> None:
        """Check the numbers."""
        validation.number("RAMP: penalty", self.penalty, least=0.0)
        _check_law(self.floor, self.mass)

    def on(
        self, domain: mesh.Mesh, x: ufl.core.expr.Expr
    ) -> tuple[ufl.core.expr.Expr, ufl.core.expr.Expr]:
        """The factors of stiffness and mass as UFL of the density ``x`` on ``domain``."""
        floor = fem.Constant(domain, np.float64(self.floor))
        penalty = fem.Constant(domain, np.float64(self.penalty))
        return floor + (1 - floor) * x / (1 + penalty * (1 - x)), self.mass.on(domain, x)

    def cut(self, exponent: float) -> RAMP:
        """The law for densities that are the share of an element which a boundary encloses.

        Args:
            exponent: That of SIMP for the elements, by which half an element is worth as much.
        """
        return replace(self, penalty=min(2.0 * (2.0 ** (exponent - 1.0) - 1.0), self.penalty))
