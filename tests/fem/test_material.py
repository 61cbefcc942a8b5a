# SPDX-License-Identifier: MIT
"""Material numbers and interpolation laws."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from shared.derivatives import check_gradient
from shared.problems import slider_crank
from shared.rods import STEEL, rod, solid

import dolfinx_ffr as ffr
from dolfinx_ffr.fem import Elasticity, cut_exponent
from dolfinx_ffr.postprocessing import StressModes


def factors(comm: MPI.Intracomm, law: object, x: float) -> tuple[float, float]:
    """Stiffness and mass factor of a law at a uniform density."""
    domain = ffr.Domain.rectangle(comm, 1.0, 1.0, elements=(4, 4), solid_columns=1)
    density = fem.Function(domain.density_space)
    density.x.array[:] = x
    return tuple(  # type: ignore[return-value]
        comm.allreduce(fem.assemble_scalar(fem.form(f * ufl.dx)))
        for f in law.on(domain.mesh, density)  # type: ignore[attr-defined]
    )


def test_laws_at_known_densities(comm: MPI.Intracomm) -> None:
    """The laws take their closed-form values."""
    floor = 1e-4
    densities = factors(comm, ffr.SIMP(3.0, floor, ffr.LinearMass()), 0.5)
    assert densities == pytest.approx((floor + (1 - floor) / 8, 0.5), rel=1e-13)
    stiffness, _ = factors(comm, ffr.RAMP(8.0, floor), 0.5)
    assert stiffness == pytest.approx(floor + (1 - floor) * 0.5 / 5, rel=1e-13)
    _, mass = factors(comm, ffr.SIMP(), 0.05)
    assert mass == pytest.approx(6e5 * 0.05**6 - 5e6 * 0.05**7, rel=1e-12)
    for law in (ffr.SIMP(3.0, floor), ffr.RAMP(8.0, floor)):
        assert factors(comm, law, 1.0) == pytest.approx((1.0, 1.0), rel=1e-13)
        assert factors(comm, law, 0.0)[0] == pytest.approx(floor, rel=1e-12)


def test_mass_law_is_smooth_at_its_threshold(comm: MPI.Intracomm) -> None:
    """Value and slope of the fading mass join those of the linear one."""
    law, t, h = ffr.SIMP(mass=ffr.SuppressedVoidMass(0.2)), 0.2, 1e-5
    below = [factors(comm, law, t - k * h)[1] for k in (1, 2)]
    assert below[0] == pytest.approx(t - h, abs=1e-7)
    # one-sided difference; the second derivative is -30/t
    assert (below[0] - below[1]) / h == pytest.approx(1.0, abs=2 * h * 30 / t)


def test_new_numbers_compile_nothing(comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another material and exponent reuse the compiled forms."""
    import dolfinx.jit

    domain = ffr.Domain.rectangle(comm, 1.0, 0.1, elements=(4, 2), solid_columns=1)
    Elasticity(domain, ffr.PlaneStress(1.0, 0.3, 1.0), ffr.SIMP())
    names = []

    def record(*arguments: object, **keywords: object) -> object:
        result = compile_form(*arguments, **keywords)
        names.append(result[1].__name__)
        return result

    compile_form = dolfinx.jit.ffcx_jit
    monkeypatch.setattr(dolfinx.jit, "ffcx_jit", record)
    Elasticity(domain, ffr.PlaneStress(1.0, 0.3, 1.0), ffr.SIMP())
    sorted_names = sorted(names)
    names.clear()
    Elasticity(domain, ffr.PlaneStrain(7.0, 0.2, 3.0, 0.1), ffr.SIMP(4.0, 1e-3))
    assert sorted_names
    assert sorted(names) == sorted_names


@dataclass(frozen=True)
class Orthotropic:
    """Wood, a laminate, a printed part: two moduli in plane stress, fibres at an angle."""

    young: tuple[float, float]  #: Along and across the fibres [Pa]
    poisson: float  #: Contraction across the fibres by tension along them [-]
    shear: float  #: Shear modulus [Pa]
    density: float  #: [kg/m^3]
    thickness: float  #: [m]
    angle: float = 0.0  #: From the x axis to the fibres [rad]

    out_of_plane = 0.0

    def on(self, domain: mesh.Mesh) -> BoundOrthotropic:
        along, across = self.young
        compliance = np.diag([1.0 / along, 1.0 / across, 1.0 / self.shear])
        compliance[0, 1] = compliance[1, 0] = -self.poisson / along
        c, s = np.cos(self.angle), np.sin(self.angle)
        turn = np.array(
            [[c * c, s * s, -2 * c * s], [s * s, c * c, 2 * c * s], [c * s, -c * s, c * c - s * s]]
        )
        stiffness = self.thickness * turn @ np.linalg.inv(compliance) @ turn.T
        density = np.float64(self.thickness * self.density)
        return BoundOrthotropic(fem.Constant(domain, stiffness), fem.Constant(domain, density))


@dataclass(frozen=True)
class BoundOrthotropic:
    """The law on a mesh, with numbers as constants of forms."""

    stiffness: fem.Constant
    density: fem.Constant

    def stress(self, displacement: Any) -> Any:
        strain = ufl.sym(ufl.grad(displacement))
        sx, sy, txy = self.stiffness * ufl.as_vector([strain[0, 0], strain[1, 1], 2 * strain[0, 1]])
        return ufl.as_matrix([[sx, txy], [txy, sy]])


SPRUCE = Orthotropic((11e9, 0.45e9), 0.4, 0.65e9, 430.0, 0.02)


@pytest.mark.mpi
@pytest.mark.parametrize("angle", [0.0, 0.3, 0.5 * np.pi, -1.2])
def test_orthotropic_bar_under_tension(comm: MPI.Intracomm, angle: float) -> None:
    """Moduli along and off the axis of the fibres, in closed form.

    R. M. Jones, Mechanics of composite materials, 2nd edition, Taylor and Francis 1999, eq. 2.97.
    """
    (along, across), nu, shear = SPRUCE.young, SPRUCE.poisson, SPRUCE.shear
    c, s = np.cos(angle), np.sin(angle)
    mixed = 1.0 / shear - 2.0 * nu / along
    young = 1.0 / (c**4 / along + mixed * c * c * s * s + s**4 / across)
    contraction = young * (
        nu / along * (c**4 + s**4) - (1.0 / along + 1.0 / across - 1.0 / shear) * c * c * s * s
    )
    shearing = young * (
        (2.0 / along + 2.0 * nu / along - 1.0 / shear) * s * c**3
        - (2.0 / across + 2.0 * nu / along - 1.0 / shear) * s**3 * c
    )
    wood = replace(SPRUCE, angle=angle)
    body = rod(comm, (10, 2), material=wood, cell="triangle", modes=1)
    tension = 2e6
    gradient = tension / young * np.array([[1.0, 0.5 * shearing], [0.5 * shearing, -contraction]])
    field = (body.elasticity.coordinates() @ gradient).reshape(-1, 1)
    reduced = solid(body)
    stiffness = body.factored(reduced).matrices.stiffness
    energy = 0.5 * body.elasticity.inner(field, body.elasticity.apply(stiffness, field))[0, 0]
    assert energy == pytest.approx(0.5 * tension**2 / young * 0.4 * 0.04 * 0.02, rel=1e-11)
    as_shape = replace(reduced, basis=replace(reduced.basis, shapes=field))
    stress = StressModes.of(body, as_shape, correction=False).stress([1.0])
    expected = np.broadcast_to([tension, 0.0, 0.0, 0.0], stress.shape)
    np.testing.assert_allclose(stress, expected, rtol=0.0, atol=1e-9 * tension)


@pytest.mark.mpi
def test_gradient_with_an_orthotropic_material(comm: MPI.Intracomm) -> None:
    """Taylor's test of the whole simulation of a rod of wood, its fibres askew."""
    problem = slider_crank(comm, (20, 4), modes=3)
    wooden = rod(comm, material=replace(SPRUCE, angle=0.4))
    problem = ffr.Problem({"rod": wooden}, problem.mechanism, problem.integrator, problem.objective)
    check_gradient(problem, taylor=0.08, roundoff=1e-10)


def test_law_of_cut_elements_is_never_steeper_than_the_one_of_the_design() -> None:
    """Half an element is worth the same by SIMP and by RAMP."""
    for cell, order in (("quadrilateral", 1), ("triangle", 1), ("quadrilateral", 3)):
        exponent = cut_exponent(cell, order)
        assert 1.0 <= exponent <= 1.5
        simp, ramp = ffr.SIMP().cut(exponent), ffr.RAMP().cut(exponent)
        assert simp.exponent == exponent
        assert 0.5 / (1.0 + 0.5 * ramp.penalty) == pytest.approx(0.5**exponent)
    assert ffr.SIMP(exponent=1.0).cut(1.5).exponent == 1.0


def test_void_has_no_low_frequencies(comm: MPI.Intracomm) -> None:
    """Strips of void leave the first frequencies of a rod to the solid; with linear mass not."""
    domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(80, 16))
    x = np.where(np.abs(domain.centroids[:, 1]) < 0.01, 1e-4, 1.0)
    x[~domain.design_cells] = 1.0
    lowest = {}
    for mass in (ffr.LinearMass(), ffr.SuppressedVoidMass()):
        law = ffr.SIMP(floor=1e-12, mass=mass)
        frame = ffr.ChordFrame("left", "right")
        body = ffr.FlexibleBody(domain, STEEL, frame=frame, modes=2, interpolation=law)
        lowest[type(mass)] = body.reduce(x).basis.frequencies[0]
    # two separate flanges of 10 mm bend like beams clamped at both ends
    flange = 4.730040745**2 * np.sqrt(210e9 / 7850 / 12) * 0.01 / 0.38**2 / (2 * np.pi)
    assert lowest[ffr.SuppressedVoidMass] == pytest.approx(flange, rel=0.1)
    assert lowest[ffr.LinearMass] < 0.1 * flange


@pytest.mark.parametrize("law", [ffr.PlaneStress, ffr.PlaneStrain])
def test_a_thickness_that_is_a_density_is_said(comm: MPI.Intracomm, law: Any) -> None:
    """In any system of units; the thickness of one that is no number of the user's is none."""
    domain = ffr.Domain.rectangle(comm, 0.04, 0.02, elements=(6, 2))
    frame = ffr.TangentFrame("left")
    message = f"the thickness 7850 m of {law.__name__} is 1.96e.05 times the extent of the body"
    with pytest.warns(UserWarning, match=message):
        ffr.FlexibleBody(domain, law(210e9, 0.3, 0.01, 7850.0), frame=frame, modes=1)
    ffr.FlexibleBody(domain, law(210e3, 0.3, 7.85e-9, 0.1), frame=frame, modes=1)
    ffr.FlexibleBody(domain, ffr.PlaneStrain(210e9, 0.3, 7850.0), frame=frame, modes=1)


def test_constants_of_lame() -> None:
    """Young's modulus and Poisson's ratio come back from them."""
    first, second = ffr.Isotropic(210e9, 0.3, 7850.0).lame
    assert second * (3.0 * first + 2.0 * second) / (first + second) == pytest.approx(210e9)
    assert 0.5 * first / (first + second) == pytest.approx(0.3)
