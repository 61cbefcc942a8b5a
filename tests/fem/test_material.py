# SPDX-License-Identifier: MIT
"""Material numbers and interpolation laws."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from shared.problems import slider_crank

from dolfinx_ffr import (
    RAMP,
    SIMP,
    ChordFrame,
    Domain,
    Elasticity,
    FlexibleBody,
    LinearMass,
    PlaneStrain,
    PlaneStress,
    Problem,
    StressModes,
    SuppressedVoidMass,
)
from dolfinx_ffr.fem import cut_exponent
from dolfinx_ffr.verification import assert_taylor_order, taylor_test


@pytest.mark.parametrize("material", [PlaneStress, PlaneStrain])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"young": 0.0}, "young must .* but it is 0.0"),
        ({"young": float("nan")}, "young must .* but it is nan"),
        ({"poisson": 0.5}, "poisson must .* but it is 0.5"),
        ({"poisson": -1.0}, "poisson must .* but it is -1.0"),
        ({"density": -7850.0}, "density must .* but it is -7850.0"),
        ({"thickness": float("inf")}, "thickness must .* but it is inf"),
    ],
)
def test_bad_material(material: type, change: dict[str, float], message: str) -> None:
    """Numbers out of range are named."""
    numbers = {"young": 1.0, "poisson": 0.3, "density": 1.0, "thickness": 1.0, **change}
    with pytest.raises(ValueError, match=message):
        material(**numbers)


@pytest.mark.parametrize(
    ("law", "arguments", "message"),
    [
        (SIMP, {"exponent": 0.5}, "exponent must .* but it is 0.5"),
        (SIMP, {"floor": 0.0}, "floor must .* but it is 0.0"),
        (RAMP, {"penalty": -1.0}, "penalty must .* but it is -1.0"),
        (RAMP, {"floor": 1.0}, "floor must .* but it is 1.0"),
        (SuppressedVoidMass, {"threshold": 1.0}, "threshold must .* but it is 1.0"),
    ],
)
def test_bad_law(law: type, arguments: dict[str, float], message: str) -> None:
    """Numbers out of range are named."""
    with pytest.raises(ValueError, match=message):
        law(**arguments)


def test_uniaxial_stress(comm: MPI.Intracomm) -> None:
    """Plane stress and plane strain have their moduli in uniaxial strain and stress."""
    young, poisson, thickness = 3.0, 0.3, 2.0
    domain = Domain.rectangle(comm, 1.0, 1.0, elements=(4, 4), solid_columns=1)
    x = ufl.SpatialCoordinate(domain.mesh)
    transverse = {PlaneStress: -poisson, PlaneStrain: -poisson / (1 - poisson)}
    modulus = {PlaneStress: young, PlaneStrain: young / (1 - poisson**2)}
    for kind in (PlaneStress, PlaneStrain):
        bound = kind(young, poisson, 1.0, thickness).on(domain.mesh)
        stress = bound.stress(ufl.as_vector([x[0], transverse[kind] * x[1]]))
        for component, expected in (((0, 0), modulus[kind]), ((1, 1), 0.0), ((0, 1), 0.0)):
            total = comm.allreduce(fem.assemble_scalar(fem.form(stress[component] * ufl.dx)))
            assert total == pytest.approx(thickness * expected, abs=1e-13)


def factors(comm: MPI.Intracomm, law: object, x: float) -> tuple[float, float]:
    """Stiffness and mass factor of a law at a uniform density."""
    domain = Domain.rectangle(comm, 1.0, 1.0, elements=(4, 4), solid_columns=1)
    density = fem.Function(domain.density_space)
    density.x.array[:] = x
    return tuple(  # type: ignore[return-value]
        comm.allreduce(fem.assemble_scalar(fem.form(f * ufl.dx)))
        for f in law.on(domain.mesh, density)  # type: ignore[attr-defined]
    )


def test_laws_at_known_densities(comm: MPI.Intracomm) -> None:
    """The laws take their closed-form values."""
    floor = 1e-4
    stiffness, mass = factors(comm, SIMP(3.0, floor, LinearMass()), 0.5)
    assert stiffness == pytest.approx(floor + (1 - floor) / 8, rel=1e-13)
    assert mass == pytest.approx(0.5, rel=1e-13)
    stiffness, _ = factors(comm, RAMP(8.0, floor), 0.5)
    assert stiffness == pytest.approx(floor + (1 - floor) * 0.5 / 5, rel=1e-13)
    _, mass = factors(comm, SIMP(), 0.05)
    assert mass == pytest.approx(6e5 * 0.05**6 - 5e6 * 0.05**7, rel=1e-12)
    for law in (SIMP(3.0, floor), RAMP(8.0, floor)):
        assert factors(comm, law, 1.0) == pytest.approx((1.0, 1.0), rel=1e-13)
        assert factors(comm, law, 0.0)[0] == pytest.approx(floor, rel=1e-12)


def test_mass_law_is_smooth_at_its_threshold(comm: MPI.Intracomm) -> None:
    """Value and slope of the fading mass join those of the linear one."""
    law, t, h = SIMP(mass=SuppressedVoidMass(0.2)), 0.2, 1e-5
    below = [factors(comm, law, t - k * h)[1] for k in (1, 2)]
    assert below[0] == pytest.approx(t - h, abs=1e-7)
    # one-sided difference; the second derivative is -30/t
    assert (below[0] - below[1]) / h == pytest.approx(1.0, abs=2 * h * 30 / t)


def test_void_has_no_low_frequencies(comm: MPI.Intracomm) -> None:
    """Strips of void leave the first frequencies of a rod to the solid."""
    domain = Domain.rectangle(comm, 0.4, 0.04, elements=(80, 16))
    x = np.where(np.abs(domain.centroids[:, 1]) < 0.01, 1e-4, 1.0)
    x[~domain.design_cells] = 1.0
    steel = PlaneStress(210e9, 0.3, 7850.0, 0.01)
    lowest = {}
    for mass in (LinearMass(), SuppressedVoidMass()):
        body = FlexibleBody(
            domain,
            steel,
            frame=ChordFrame("left", "right"),
            modes=2,
            interpolation=SIMP(floor=1e-12, mass=mass),
        )
        lowest[type(mass)] = body.reduce(x).basis.frequencies[0]
    # two separate flanges of 10 mm bend like beams clamped at both ends
    flange = 4.730040745**2 * np.sqrt(210e9 / 7850 / 12) * 0.01 / 0.38**2 / (2 * np.pi)
    assert lowest[SuppressedVoidMass] == pytest.approx(flange, rel=0.1)
    assert lowest[LinearMass] < 0.1 * flange


def test_new_numbers_compile_nothing(comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another material and exponent reuse the compiled forms."""
    import dolfinx.jit

    domain = Domain.rectangle(comm, 1.0, 0.1, elements=(4, 2), solid_columns=1)
    Elasticity(domain, PlaneStress(1.0, 0.3, 1.0), SIMP())
    names = []

    def record(*arguments: object, **keywords: object) -> object:
        result = compile_form(*arguments, **keywords)
        names.append(result[1].__name__)
        return result

    compile_form = dolfinx.jit.ffcx_jit
    monkeypatch.setattr(dolfinx.jit, "ffcx_jit", record)
    Elasticity(domain, PlaneStress(1.0, 0.3, 1.0), SIMP())
    first = sorted(names)
    names.clear()
    Elasticity(domain, PlaneStrain(7.0, 0.2, 3.0, 0.1), SIMP(4.0, 1e-3))
    assert first
    assert sorted(names) == first


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

    def on(self, domain: Any) -> BoundOrthotropic:
        along, across = self.young
        compliance = np.diag([1.0 / along, 1.0 / across, 1.0 / self.shear])
        compliance[0, 1] = compliance[1, 0] = -self.poisson / along
        c, s = np.cos(self.angle), np.sin(self.angle)
        turn = np.array([[c * c, s * s, -2 * c * s], [s * s, c * c, 2 * c * s],
                         [c * s, -c * s, c * c - s * s]])  # fmt: skip
        stiffness = self.thickness * turn @ np.linalg.inv(compliance) @ turn.T
        density = np.float64(self.thickness * self.density)
        return BoundOrthotropic(fem.Constant(domain, stiffness), fem.Constant(domain, density))


@dataclass(frozen=True)
class BoundOrthotropic:
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
    domain = Domain.rectangle(comm, 0.4, 0.04, elements=(10, 2), cell="triangle")
    wood = replace(SPRUCE, angle=angle)
    body = FlexibleBody(domain, wood, frame=ChordFrame("left", "right"), modes=1)
    tension = 2e6
    gradient = tension / young * np.array([[1.0, 0.5 * shearing], [0.5 * shearing, -contraction]])
    field = (body.elasticity.coordinates() @ gradient).reshape(-1, 1)
    stiffness = body.elasticity.assemble(np.ones(domain.n_cells)).stiffness
    energy = 0.5 * body.elasticity.inner(field, body.elasticity.apply(stiffness, field))[0, 0]
    assert energy == pytest.approx(0.5 * tension**2 / young * 0.4 * 0.04 * 0.02, rel=1e-11)
    reduced = body.reduce(np.ones(domain.n_cells))
    as_shape = replace(reduced, basis=replace(reduced.basis, shapes=field))
    stress = StressModes.of(body, as_shape, correction=False).stress([1.0])
    expected = np.broadcast_to([tension, 0.0, 0.0, 0.0], stress.shape)
    np.testing.assert_allclose(stress, expected, rtol=0.0, atol=1e-9 * tension)


@pytest.mark.mpi
def test_gradient_with_an_orthotropic_material(comm: MPI.Intracomm) -> None:
    """Taylor's test of the whole simulation of a rod of wood, its fibres askew."""
    problem = slider_crank(comm, (20, 4), modes=3)
    domain = problem.flexible["rod"].domain
    frame = problem.flexible["rod"].reduction.frame
    wood = replace(SPRUCE, angle=0.4)
    rod = FlexibleBody(domain, wood, frame=frame, modes=3)
    problem = Problem({"rod": rod}, problem.mechanism, problem.integrator, problem.objective)
    c = domain.centroids
    density = 0.6 + 0.3 * np.sin(40 * c[:, 0] + 200 * c[:, 1])
    gradient = problem.gradient(density).gradient
    assert gradient is not None
    result = taylor_test(
        lambda x: problem.value(x).psi,
        lambda d: domain.sum(gradient["rod"] * d),
        density,
        np.cos(37 * c[:, 0] + 130 * c[:, 1]),
        steps=[0.08, 0.04, 0.02, 0.01],
        roundoff=1e-10,
    )
    assert_taylor_order(result)


def test_law_of_cut_elements_is_never_steeper_than_the_one_of_the_design() -> None:
    """Half an element is worth the same by SIMP and by RAMP."""
    for cell, order in (("quadrilateral", 1), ("triangle", 1), ("quadrilateral", 3)):
        exponent = cut_exponent(cell, order)
        assert 1.0 <= exponent <= 1.5
        simp, ramp = SIMP().cut(exponent), RAMP().cut(exponent)
        assert simp.exponent == exponent
        assert 0.5 / (1.0 + 0.5 * ramp.penalty) == pytest.approx(0.5**exponent)
    assert SIMP(exponent=1.0).cut(1.5).exponent == 1.0
