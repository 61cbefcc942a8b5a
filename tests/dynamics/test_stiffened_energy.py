# SPDX-License-Identifier: MIT
"""Geometric stiffening derives from one energy: mass matrix, energy, momentum, choice of frame."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from mpi4py import MPI

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from shared.motions import energy_and_momenta
from shared.spatial_bodies import cloud, stiffened_cloud

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Trajectory
from dolfinx_ffr.dynamics.kinematics import evaluate_equations, momenta_of
from dolfinx_ffr.dynamics.model import FlatModel, assemble_model
from dolfinx_ffr.verification import convergence_order

# Bodies without geometric stiffness do run away, and what random ones do need not be stable.
pytestmark = pytest.mark.filterwarnings("ignore::dolfinx_ffr.SofteningWarning")

Array = NDArray[np.float64]

LENGTH = 0.3


@cache
def bar(tangent: bool, young: float, modes: int = 6) -> ffr.VolumeIntegrals:
    """A slender bar of plane elements in the frame of its left end or of its chord."""
    domain = ffr.Domain.rectangle(
        MPI.COMM_SELF, LENGTH, 0.008, elements=(12, 1), order=2, solid_columns=0
    )
    frame = ffr.TangentFrame("left") if tangent else ffr.ChordFrame("left", "right")
    plastic = ffr.PlaneStress(young, 0.3, 840.0, 0.01)
    loads = ["omega2", "alpha", "acceleration", "markers"]
    body = ffr.FlexibleBody(domain, plastic, frame=frame, modes=modes, stiffening=loads)
    return body.reduce(np.ones(domain.n_cells)).integrals


def pendulum(mass: float) -> ffr.Mechanism:
    """The bar falls from the horizontal, with a point mass at its end."""
    return ffr.Mechanism(
        {"bar": ffr.Placement()},
        [ffr.Revolute(("bar", "left"), ffr.Ground(), name="hinge")],
        point_masses=[ffr.PointMass(("bar", "right"), mass)] if mass else [],
        gravity=(0.0, -9.81),
    )


@pytest.mark.slow
@pytest.mark.parametrize("mass", [0.0, 0.05])
@pytest.mark.parametrize("young", [8e7, 2e7])
def test_frames_agree_to_the_square_of_the_deflection(mass: float, young: float) -> None:
    """With a point mass, or without, and unlike bodies without geometric stiffness."""
    paths, linear = [], []
    for body in (bar(True, young, 8), bar(False, young, 8)):
        markers = {name: replace(m, stiffening=None) for name, m in body.markers.items()}
        for part, momenta in (
            (body, paths),
            (replace(body, markers=markers, stiffening={}), linear),
        ):
            t = ffr.simulate(pendulum(mass), {"bar": part}, ffr.RadauIIA(0.25, steps=500))
            momenta.append(t.marker_path("bar", "right") / LENGTH)
            if len(paths) == 1 and part is body:
                shift = body.markers["right"].shift(t.elastic("bar"))
    deflection = float(np.max(np.abs(shift))) / LENGTH
    difference = float(np.max(np.abs(paths[1] - paths[0])))
    assert deflection > 0.01
    assert difference < 0.3 * deflection**2
    assert difference < 0.1 * np.max(np.abs(linear[1] - linear[0]))


def random_model(space: bool) -> FlatModel:
    """A body with geometric stiffness, and point masses at markers that have it too."""
    if space:
        body, placement = stiffened_cloud(3), ffr.Placement((0.0, 0.0, 0.0))
        points = [ffr.PointMass(("bar", "tip"), 0.5), ffr.PointMass(("bar", "root"), 2.0)]
    else:
        body, placement = bar(True, 1e7), ffr.Placement()
        points = [ffr.PointMass(("bar", "right"), 0.2)]
    mechanism = ffr.Mechanism({"bar": placement}, point_masses=points)
    return assemble_model(mechanism, {"bar": body}, np.linspace(0.0, 1.0, 3))


@pytest.mark.parametrize("space", [False, True], ids=["plane", "space"])
def test_mass_matrix(space: bool) -> None:
    """Symmetric and positive for deformations of any size, and that of the kinetic energy."""
    model, rng = random_model(space), np.random.default_rng(0)
    coordinates = model.coordinates("bar")
    for size in (0.01, 0.1, 1.0):
        y, v = rng.standard_normal((2, model.size))
        y[coordinates.elastic] *= size * LENGTH
        none = np.zeros(model.size)
        mass = evaluate_equations(model.arrays, 0, y, none, none, np.zeros(0)).mass
        scale = 1.0 / np.sqrt(np.diag(mass))
        scaled = mass * np.outer(scale, scale)
        np.testing.assert_allclose(scaled, scaled.T, atol=1e-13)
        assert np.linalg.eigvalsh(scaled)[0] > 0.0
        momenta = momenta_of(model.arrays, 0, y[None], v[None])
        assert momenta.kinetic[0] == pytest.approx(0.5 * v @ mass @ v, rel=1e-12)


@pytest.mark.parametrize("stiff", [True, False])
@pytest.mark.parametrize("d", [2, 3])
def test_energy_momentum_and_equations_are_those_of_points(d: int, stiff: bool) -> None:
    """Of points whose second displacement is linear in their position, by differences in time."""
    rng, r, n = np.random.default_rng(d), 2, 20
    mass, X = rng.uniform(0.1, 0.3, n), rng.uniform(-0.5, 0.5, (n, d))
    phi = 0.3 * rng.standard_normal((r, n, d))
    moves, stretch = rng.standard_normal((d, r, r)), rng.standard_normal((d, d, r, r))
    if d == 2:  # loads of rotation are those of omega^2 and alpha alone
        (a, b), turned = stretch[0], np.array([[0.0, -1.0], [1.0, 0.0]])
        stretch = np.einsum("kl,ij->klij", np.eye(2), a) + np.einsum("kl,ij->klij", turned, b)
    moves, stretch = (part + np.swapaxes(part, -1, -2) for part in (moves, stretch))
    second = stiff * (moves + np.einsum("klij,pl->pkij", stretch, X))

    # int rho u2_k and int rho X_l u2_k, half of whose second derivatives are geometric stiffness
    second_moment = np.einsum("p,pkij->kij", mass, second)
    pairs = np.einsum("p,pl,pkij->klij", mass, X, second)
    W = np.concatenate([X[None], phi])
    P = np.einsum("p,apk,bpl->abkl", mass, W, W)
    loads = {"rotation": pairs, "acceleration": second_moment}
    if d == 2:
        loads = {
            "omega2": -pairs[0, 0] - pairs[1, 1],
            "alpha": pairs[1, 0] - pairs[0, 1],
            "acceleration": second_moment,
        }
    S = np.einsum("p,apk->ak", mass, W)
    body = ffr.VolumeIntegrals.from_arrays(
        mass.sum(), S, P=P, K=np.eye(r), stiffening=loads if stiff else {}
    )
    places = ffr.Placement((0.0,) * d) if d == 3 else ffr.Placement()
    model = assemble_model(ffr.Mechanism({"bar": places}), {"bar": body}, np.linspace(0.0, 1.0, 3))
    y, v, w = rng.standard_normal((3, model.size))
    y *= 0.5

    def points(t: float, rate: Array, growth: Array) -> Array:
        """On a path with velocities and accelerations in the axes of the body."""
        (position, angle, q), (shift, turn, x) = (
            np.split(part, [d, model.size - r]) for part in (y, t * rate + 0.5 * t**2 * growth)
        )
        x = q + x
        local = X + np.einsum("j,jpk->pk", x, phi) + 0.5 * np.einsum("i,pkij,j->pk", x, second, x)
        if d == 2:
            ((c, s),) = np.column_stack([np.cos(angle + turn), np.sin(angle + turn)])
            A = np.array([[c, -s], [s, c]])
        else:
            A = (Rotation.from_rotvec(angle) * Rotation.from_rotvec(turn)).as_matrix()
        return np.asarray(position + shift + local @ A.T)

    h, none, here = 1e-2, np.zeros(model.size), points(0.0, v, w)
    once, twice = {1: 0.75, 2: -0.15, 3: 1.0 / 60.0}, {1: 1.5, 2: -0.15, 3: 1.0 / 90.0}

    def rate_of(rate: Array) -> Array:
        ahead = (
            f * (points(k * h, rate, none) - points(-k * h, rate, none)) for k, f in once.items()
        )
        return sum(ahead) / h

    speed = rate_of(v)
    momenta = momenta_of(model.arrays, 0, y[None], v[None])
    assert momenta.kinetic[0] == pytest.approx(0.5 * mass @ np.sum(speed**2, axis=1), rel=1e-9)
    np.testing.assert_allclose(momenta.linear[0], mass @ speed, rtol=1e-9)
    np.testing.assert_allclose(momenta.first_moment[0], mass @ here, rtol=1e-12)
    outer = np.einsum("p,pi,pj->ij", mass, here, speed)
    pairs = ((0, 1),) if d == 2 else ((1, 2), (2, 0), (0, 1))
    spin = np.squeeze([outer[i, j] - outer[j, i] for i, j in pairs])
    np.testing.assert_allclose(momenta.angular[0], spin, rtol=1e-9)

    # d'Alembert: inertia does the work of the points on each virtual displacement
    growth = sum(
        f * (points(k * h, v, w) + points(-k * h, v, w) - 2.0 * here) for k, f in twice.items()
    )
    work = [np.einsum("p,pk,pk", mass, growth / h**2, rate_of(each)) for each in np.eye(model.size)]
    residual = evaluate_equations(model.arrays, 0, y, v, w, np.zeros(0)).residual
    elastic = np.concatenate([np.zeros(model.size - r), y[-r:]])
    np.testing.assert_allclose(residual, work + elastic, rtol=1e-8, atol=1e-8)


def thrown(space: bool, integrator: ffr.GeneralizedAlpha | ffr.RadauIIA) -> Trajectory:
    """A free body that turns and vibrates, with point masses at markers with stiffness."""
    if space:
        small = stiffened_cloud(3)
        body = replace(small, K=cloud(3, stiffness=40.0).K)
        placement = ffr.Placement(
            (0.3, -0.2, 0.1), velocity=(0.4, 0.3, -0.2), angular_velocity=(3.0, 1.0, -2.0)
        )
        shape, points = [0.05, -0.03, 0.04], [("tip", 0.5), ("root", 1.0)]
    else:
        body = bar(False, 2e7, 2)
        placement = ffr.Placement((0.3, -0.2), 0.4, (0.4, 0.3), 9.0)
        shape = [0.01, -0.002, *np.zeros(body.modes - 2)]
        points = [("right", 0.02), ("left", 0.01)]
    mechanism = ffr.Mechanism(
        {"bar": placement},
        start=ffr.Assembled(elastic={"bar": shape}),
        point_masses=[ffr.PointMass(("bar", marker), mass) for marker, mass in points],
    )
    return ffr.simulate(mechanism, {"bar": body}, integrator)


@pytest.mark.parametrize("space", [False, True], ids=["plane", "space"])
@pytest.mark.parametrize("radau", [False, True], ids=["generalized-alpha", "Radau"])
def test_a_free_body_keeps_energy_and_momentum(space: bool, radau: bool) -> None:
    end, errors = 1.0 if space else 0.03, []
    counts = np.array([100, 200, 400] if radau else [1000, 2000, 4000])
    for count in counts:
        method = (
            ffr.RadauIIA(end, steps=int(count))
            if radau
            else ffr.GeneralizedAlpha(end, int(count), 1.0)
        )
        t = thrown(space, method)
        conserved = np.column_stack(energy_and_momenta(t))[:: method.stages]
        scale = [
            1.0 / conserved[0, 0],
            *[1.0 / np.linalg.norm(conserved[0, 1:])] * (conserved.shape[1] - 1),
        ]
        errors.append(np.max(np.abs(conserved - conserved[0]), axis=0) * scale)
    assert np.max(errors[-1]) < (1e-9 if radau else 1e-5)
    for part in np.transpose(errors):
        if part[-1] > 1e-13:
            assert convergence_order(1.0 / counts, part) > (4.5 if radau else 1.9)
