# SPDX-License-Identifier: MIT
"""Stress: exact for linear fields, beam theory, full finite-element solutions, worst over time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from mpi4py import MPI

import h5py
import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg
from shared.meshes import write_rod

import dolfinx_ffr as ffr
from dolfinx_ffr.fem import stress_recovery
from dolfinx_ffr.postprocessing import StressModes
from dolfinx_ffr.reduction import ReducedBody
from dolfinx_ffr.verification import convergence_order

Array = np.ndarray


def with_shapes(body: ffr.FlexibleBody, reduced: ReducedBody, shapes: Array) -> ReducedBody:
    """The same reduced body with other shape functions, all of them constraint modes."""
    basis = replace(reduced.basis, shapes=shapes, n_constraint=shapes.shape[1])
    return replace(reduced, basis=basis)


def cantilever(
    comm: MPI.Intracomm,
    elements: tuple[int, int] = (20, 4),
    *,
    order: int = 2,
    cell: str = "quadrilateral",
    modes: int = 4,
    poisson: float = 0.3,
    free: bool = False,
) -> ffr.FlexibleBody:
    """A steel bar of one metre along x, held at the left; the right end is rigid unless free."""
    domain = ffr.Domain.rectangle(comm, 1.0, 0.1, elements=elements, order=order, cell=cell)
    if free:
        domain = ffr.Domain(domain.mesh, {"left": lambda x: x[0] < 1e-9}, order=order)
    steel = ffr.PlaneStress(210e9, poisson, 7850.0, 0.01)
    return ffr.FlexibleBody(domain, steel, frame=ffr.TangentFrame("left"), modes=modes)


def largest(comm: MPI.Intracomm, values: Array) -> float:
    return float(comm.allreduce(float(np.max(np.abs(values), initial=0.0)), MPI.MAX))


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
@pytest.mark.parametrize("law", [ffr.PlaneStress, ffr.PlaneStrain])
def test_linear_fields_obey_hookes_law(comm: MPI.Comm, law: type, cell: str, order: int) -> None:
    """All components and the von Mises stress, from the three-dimensional law."""
    young, nu = 7e10, 0.33
    domain = ffr.Domain.rectangle(comm, 0.4, 0.1, elements=(8, 2), cell=cell, order=order)
    material = law(young, nu, 2700.0, 0.02)
    body = ffr.FlexibleBody(domain, material, frame=ffr.ChordFrame("left", "right"), modes=1)
    gradient = 1e-3 * np.array([[1.0, 0.4], [-0.9, 0.3]])
    field = (body.elasticity.coordinates() @ gradient.T).reshape(-1, 1)
    reduced = with_shapes(body, body.reduce(np.ones(domain.n_cells)), field)
    ex, ey, g = gradient[0, 0], gradient[1, 1], gradient[0, 1] + gradient[1, 0]
    ez = 0.0 if law is ffr.PlaneStrain else -nu / (1.0 - nu) * (ex + ey)
    mu = young / (2.0 * (1.0 + nu))
    lame = young * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    normal = [lame * (ex + ey + ez) + 2.0 * mu * e for e in (ex, ey, ez)]
    modes = StressModes.of(body, reduced, correction=False)
    expected = np.array([normal[0], normal[1], mu * g, normal[2]])
    tolerance = 1e-11 * np.max(np.abs(expected))
    for factor in (2.0, -0.5):
        stress = modes.stress([factor])
        assert largest(comm, stress - factor * expected) < abs(factor) * tolerance
    deviator = np.diag(normal - np.mean(normal))
    deviator[0, 1] = deviator[1, 0] = mu * g
    exact = np.sqrt(1.5 * np.sum(deviator**2))
    assert largest(comm, ffr.von_mises(body, reduced, [-1.0]) - exact) < tolerance


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_bending_of_a_slender_beam(comm: MPI.Intracomm, cell: str) -> None:
    """A cantilever with a force at its tip: beam theory away from both ends, in second order."""
    height, width, force = 0.1, 0.01, 2e3
    errors, sizes = [], np.array([1.0, 0.5, 0.25])
    for n in (1, 2, 4):
        body = cantilever(comm, (10 * n, 2 * n), cell=cell)
        reduced = body.reduce(np.ones(body.domain.n_cells))
        marker = reduced.integrals.markers["right"]
        q = np.linalg.solve(reduced.integrals.K, marker.displacement.T @ np.array([0.0, force]))
        modes = StressModes.of(body, reduced)
        x, y = modes.points[..., 0], modes.points[..., 1]
        sx = -force * (1.0 - x) * y / (width * height**3 / 12.0)
        t = 1.5 * force / (width * height) * (1.0 - (2.0 * y / height) ** 2)
        exact = np.sqrt(sx**2 + 3.0 * t**2)
        inner = np.abs(x - 0.5) < 0.2
        error = np.where(inner, modes.von_mises(q) - exact, 0.0)
        errors.append(largest(comm, error) / (6.0 * force * 0.5 / (width * height**2)))
    assert convergence_order(sizes, np.array(errors)) > 1.7
    assert errors[-1] < 5e-3


def moved(body: ffr.FlexibleBody, hand: ffr.Moving, *steps: Any, **start: Any) -> ffr.Problem:
    """A bar that is held at its left end by a hand."""
    placements = {"bar": ffr.Placement(angle=float(hand.angle.value(0.0)))}
    mechanism = ffr.Mechanism(placements, [ffr.Weld(("bar", "left"), hand)], **start)
    method = ffr.GeneralizedAlpha(*steps)
    return ffr.Problem({"bar": body}, mechanism, method, ffr.IntegralCompliance())


def spinning(body: ffr.FlexibleBody, omega: float) -> ffr.Problem:
    """A bar that turns steadily about its left end, from the start in its steady state."""
    integrals = body.reduce(np.ones(body.domain.n_cells)).integrals
    q = np.linalg.solve(integrals.K - omega**2 * integrals.G[1:, 1:], omega**2 * integrals.G[0, 1:])
    shaft = ffr.Moving.circle((0.0, 0.0), 0.0, ffr.Motion.polynomial([0.3, omega]), name="shaft")
    return moved(body, shaft, 1e-4, 4, start=ffr.Assembled(elastic={"bar": q}))


# bending would not be stable at this speed, and is not excited
@pytest.mark.filterwarnings("ignore::dolfinx_ffr.SofteningWarning")
def test_full_finite_element_stress_of_a_spinning_bar() -> None:
    """The error falls with the number of modes; statically corrected it is its square."""
    omega = 2500.0
    full = cantilever(MPI.COMM_SELF, free=True)
    ones = np.ones(full.domain.n_cells)
    assembled = full.elasticity.assemble(ones)
    K, M = (
        scipy.sparse.csr_matrix(matrix.getValuesCSR()[::-1])
        for matrix in (assembled.stiffness, assembled.mass)
    )
    w_0, inner = full.reduction.reference, ~full.reduction.clamped
    u = np.zeros(len(w_0))
    load = omega**2 * (M @ w_0)
    u[inner] = scipy.sparse.linalg.spsolve((K - omega**2 * M)[inner][:, inner].tocsc(), load[inner])
    exact_modes = with_shapes(full, full.reduce(ones), u[:, None])
    exact = StressModes.of(full, exact_modes, correction=False).von_mises([1.0])
    plain, corrected = [], []
    for n in (3, 12, 24):
        body = cantilever(MPI.COMM_SELF, free=True, modes=n)
        evaluation = spinning(body, omega).value(ones)
        reduced, trajectory = evaluation.bodies["bar"], evaluation.trajectory
        for errors, correction in ((plain, False), (corrected, True)):
            modes = StressModes.of(body, reduced, correction=correction)
            z = modes.coordinates(trajectory, "bar")
            errors.append(np.max(np.abs(modes.von_mises(z[-1]) - exact)) / np.max(exact))
    assert np.all(np.diff(plain) < 0.0) and np.all(np.diff(corrected) < 0.0)
    assert np.all(np.array(corrected) < 2.0 * np.array(plain) ** 2)


def accelerated(body: ffr.FlexibleBody, steps: int = 200) -> ffr.Problem:
    """A bar that is moved along its axis by one metre, from rest to rest."""
    hand = ffr.Moving(ffr.Motion.smooth_step(1.0, 0.4), ffr.Motion.constant(0.0), name="hand")
    return moved(body, hand, 0.4, steps)


def test_time_of_the_worst_stress(comm: MPI.Intracomm) -> None:
    """A bar moved along its axis has the stress rho a (L - x), largest when a is."""
    body = cantilever(comm, (20, 4), poisson=0.0, free=True, modes=4)
    domain = body.domain
    evaluation = accelerated(body).value(np.ones(domain.n_cells))
    worst = ffr.worst_stress(body, evaluation, "bar")
    acceleration = 10.0 / np.sqrt(3.0) / 0.4**2  # of the smooth step, at (3 +- sqrt 3) / 6
    # the largest one of a cell is that of its corners on the left
    column_of_cell = 0.05 * np.floor(domain.centroids[:, 0] / 0.05)
    exact = 7850.0 * acceleration * (1.0 - column_of_cell)
    top = 7850.0 * acceleration
    # the time step misses the peak, and the bar rings with a share of its period over the motion's
    assert largest(comm, worst.stress - exact) < 1e-3 * top
    instants = 0.4 * (3.0 + np.array([-1.0, 1.0]) * np.sqrt(3.0)) / 6.0
    assert np.min(np.abs(worst.largest_time - instants)) < 0.01
    assert worst.largest == pytest.approx(top, rel=1e-3)
    assert worst.largest_position[0] == 0.0
    np.testing.assert_array_equal(worst.time, evaluation.trajectory.t[worst.step])


@pytest.mark.mpi
def test_worst_is_the_largest_of_all_instants(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The envelope equals the largest field, step by step, with void left out."""
    body = cantilever(comm, (12, 4), order=1, modes=3)
    domain = body.domain
    x = np.where(np.abs(domain.centroids[:, 1]) > 0.026, 1.0, 0.1)
    x[~domain.design_cells] = 1.0
    evaluation = accelerated(body, steps=50).value(x)
    modes = StressModes.of(body, evaluation.bodies["bar"])
    z = modes.coordinates(evaluation.trajectory, "bar")
    worst = ffr.worst_stress(body, evaluation, "bar")
    fields = np.array([np.max(modes.von_mises(row), axis=1) for row in z])
    # a few cells at a time give what all of them give at once, with maps that are not kept
    monkeypatch.setattr(stress_recovery, "_BLOCK", 500)
    body.release()
    blocks = ffr.worst_stress(body, evaluation, "bar")
    at_once = modes.worst(z, evaluation.trajectory.t)
    for name in ("stress", "step", "largest", "largest_position"):
        np.testing.assert_allclose(getattr(blocks, name), getattr(at_once, name), rtol=1e-12)
    top = largest(comm, fields)
    assert largest(comm, worst.stress - fields.max(axis=0)) < 1e-7 * top
    assert worst.largest == pytest.approx(top, rel=1e-9)
    picked = np.take_along_axis(fields, worst.step[None], axis=0)[0]
    assert largest(comm, picked - worst.stress) < 1e-7 * top
    np.testing.assert_array_equal(worst.solid, x > 0.3)
    assert np.all(worst.stress[~worst.solid] == 0.0) and np.all(worst.stress[worst.solid] > 0.0)


@pytest.mark.mpi
def test_the_same_stress_on_any_number_of_ranks(comm: MPI.Intracomm) -> None:
    """All ranks together find what one finds alone, also after another design was reduced."""
    fields = []
    for group in (comm, MPI.COMM_SELF):
        body = cantilever(group, (12, 4), cell="triangle", modes=3)
        problem = accelerated(body, steps=50)
        x = 0.4 + 0.6 * np.cos(9.0 * body.domain.centroids[:, 0]) ** 2
        evaluation = problem.value(x)
        body.reduce(np.ones(body.domain.n_cells))
        worst = ffr.worst_stress(body, evaluation, "bar", relaxation=0.5)
        fields.append((body.domain.everywhere(worst.stress), worst.largest, worst.largest_time))
    np.testing.assert_allclose(fields[0][0], fields[1][0], rtol=1e-6)
    assert fields[0][1:] == pytest.approx(fields[1][1:], rel=1e-7)


@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["quadrilateral", "triangle", "curved"])
def test_fields_for_paraview(comm: MPI.Intracomm, shared_tmp_path: Path, kind: str) -> None:
    """Names, cells and values stand where the format wants them, for meshes of both orders."""
    if kind == "curved":
        if comm.rank == 0:
            write_rod(shared_tmp_path / "rod.msh", order=2)
        comm.Barrier()
        domain = ffr.Domain.from_gmsh(comm, shared_tmp_path / "rod.msh")
    else:
        domain = ffr.Domain.rectangle(comm, 1.0, 0.2, elements=(8, 2), cell=kind)
    corners = 4 if kind == "quadrilateral" else 3
    x, y = domain.centroids.T
    path = shared_tmp_path / "out" / "fields.xdmf"
    ffr.write_fields(domain, {"von_mises": 1e6 * x, "time": y}, path)
    ffr.write_density(domain, 0.5 + y, path.with_name("density"))  # gets the ending
    with pytest.raises(ValueError, match=r"density.vtu.? must end in .xdmf"):
        ffr.write_density(domain, x, path.with_name("density.vtu"))
    if comm.rank > 0:
        return
    # as the format says: VTK's own reader does not run beside every release of HDF5
    expected = {"von_mises": lambda c: 1e6 * c[:, 0], "time": lambda c: c[:, 1]}
    for file, fields in (("fields", expected), ("density", {"density": lambda c: 0.5 + c[:, 1]})):
        document = ElementTree.parse(path.with_stem(file))
        items = {item.text or "": item for item in document.iter("DataItem")}
        attributes = list(document.iter("Attribute"))
        assert {element.get("Name") for element in attributes} == {*fields}
        assert {element.get("Center") for element in attributes} == {"Cell"}

        def read(end: str, items: Any = items) -> np.ndarray:
            text = next(text for text in items if end in text)
            name, place = text.split(":")
            with h5py.File(path.parent / name) as data:
                values = np.asarray(data[place])
            assert items[text].get("Dimensions") == " ".join(map(str, values.shape))
            return values

        nodes = read("topology")
        centers = read("geometry")[nodes if kind == "curved" else nodes[:, -corners:]].mean(axis=1)
        for name, exact in fields.items():
            written = read(f"/{name}/").ravel()
            assert written.shape == (domain.n_cells_global,)
            np.testing.assert_allclose(written, exact(centers), rtol=1e-12, atol=1e-12)
