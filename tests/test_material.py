# SPDX-License-Identifier: MIT
"""Material numbers and interpolation laws."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem

from dolfinx_ffr import (
    RAMP,
    SIMP,
    Domain,
    Elasticity,
    LinearMass,
    PlaneStrain,
    PlaneStress,
    SuppressedVoidMass,
)


@pytest.mark.parametrize("material", [PlaneStress, PlaneStrain])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"young": 0.0}, "young = 0.0"),
        ({"young": float("nan")}, "young = nan"),
        ({"poisson": 0.5}, "poisson = 0.5"),
        ({"poisson": -1.0}, "poisson = -1.0"),
        ({"density": -7850.0}, "density = -7850.0"),
        ({"thickness": float("inf")}, "thickness = inf"),
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
        (SIMP, {"exponent": 0.5}, "exponent = 0.5"),
        (SIMP, {"floor": 0.0}, "floor = 0.0"),
        (RAMP, {"penalty": -1.0}, "penalty = -1.0"),
        (RAMP, {"floor": 1.0}, "floor = 1.0"),
        (SuppressedVoidMass, {"threshold": 1.0}, "threshold = 1.0"),
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
    from dolfinx_ffr import ChordFrame, FlexibleBody

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
