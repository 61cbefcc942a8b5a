# SPDX-License-Identifier: MIT
"""The whole chain from densities to the objective and back."""

from __future__ import annotations

import traceback
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.derivatives import check_gradient
from shared.problems import slider_crank, swing_about_a_point
from shared.scenes import slider_crank_mechanism
from slider_crank import reference_problem, simple_designs

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics.compilation import Compiled
from dolfinx_ffr.verification import convergence_order

QUADS = "quadrilateral"
#: psi of the reference scene's full rod [J s], from the same code on any supported release
PSI_FULL_ROD = 5.831832625800e-05


def designs(problem: ffr.Problem) -> dict[str, np.ndarray]:
    """Densities of very different kinds, functions of position alone."""
    domain = problem.flexible["rod"].domain
    c = domain.centroids
    # as good as random, but the same on any number of ranks
    noise = np.modf(43758.5453 * np.sin(12.9898e2 * c[:, 0] + 78.233e2 * c[:, 1]))[0]
    # so steep that elements inside the hole are void to the last digit
    levelset = ffr.LevelSet(domain).with_sharpness(400.0)
    hole = levelset.from_distance(
        lambda x: 0.03 * (np.hypot((x[:, 0] - 0.2) / 0.12, x[:, 1] / 0.014) - 1.0)
    )
    full = np.ones(domain.n_cells)
    return {"random": 0.55 + 0.4 * noise, "solid": full, "level set": levelset.density(hole)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cell", "order", "kind"),
    [
        *((QUADS, 1, kind) for kind in ("random", "solid", "level set")),
        (QUADS, 2, "solid"),
        pytest.param("triangle", 2, "level set", marks=pytest.mark.mpi),
    ],
)
def test_gradient_of_the_whole_chain(comm: MPI.Intracomm, cell: str, order: int, kind: str) -> None:
    """Taylor order 2 and agreement with central differences, with elements at the floor too."""
    elements = (20, 4) if order == 2 else (40, 8)
    problem = reference_problem(comm, elements, cell=cell, order=order, modes=6, steps=300)
    domain = problem.flexible["rod"].domain
    density = designs(problem)[kind]
    c = domain.centroids
    direction = np.cos(300 * c[:, 0] + 900 * c[:, 1] + 1.0)
    if kind != "random":  # stay within [0, 1]
        inwards = np.where(density > 0.5, -1.0, 1.0)
        direction = inwards * np.abs(direction)
        density = np.clip(density, 0.0, 1.0)
    # short: at the floor the stiffness grows with the cube of the step
    difference = 1e-3 if kind == "random" else None
    check_gradient(problem, {"rod": density}, {"rod": direction}, taylor=5e-4, step=difference)
    if kind == "level set":
        share = domain.sum(domain.cell_volumes * (density < 1e-12)) / domain.area
        assert share > 0.05


@pytest.mark.mpi
def test_gradient_with_a_marker_inside(comm: MPI.Intracomm) -> None:
    """Its shape functions depend on the density."""
    damping = {"rod": ffr.RayleighDamping(1.0, 1e-5)}
    check_gradient(swing_about_a_point(comm, 200, damping=damping), step=2e-3)


@pytest.mark.mpi
def test_same_numbers_on_any_number_of_ranks(comm: MPI.Intracomm) -> None:
    """Psi to 1e-9 and gradient to 1e-7 as on one rank alone.

    The reduced half is replicated: not even round-off differs between ranks.
    """
    shared = reference_problem(comm, (40, 8), steps=400)
    serial_problem = reference_problem(MPI.COMM_SELF, (40, 8), steps=400)
    for kind in ("random", "level set"):
        one, all_ = (
            problem_of_case.gradient(designs(problem_of_case)[kind])
            for problem_of_case in (serial_problem, shared)
        )
        mine = all_.trajectory.y.tobytes() + np.float64(all_.psi).tobytes()
        assert len(set(comm.allgather(mine))) == 1
        assert all_.psi == pytest.approx(one.psi, rel=1e-9)
        computed, expected = (e.fixed_interface_frequencies["rod"] for e in (all_, one))
        np.testing.assert_allclose(computed, expected, rtol=1e-9)
        assert one.gradient is not None and all_.gradient is not None
        place = {
            tuple(p): g for p, g in zip(_keys(serial_problem), one.gradient["rod"], strict=True)
        }
        expected = np.array([place[tuple(p)] for p in _keys(shared)])
        scale = np.linalg.norm(one.gradient["rod"]) / np.sqrt(len(one.gradient["rod"]))
        worst = np.max(np.abs(all_.gradient["rod"] - expected), initial=0.0)
        assert comm.allreduce(worst, MPI.MAX) < 1e-7 * scale


def _keys(problem: ffr.Problem) -> np.ndarray:
    return np.round(problem.flexible["rod"].domain.centroids, 9)


def test_reference_scene(comm: MPI.Intracomm) -> None:
    """Psi of the full rod is the same on every DOLFINx release, and close to the published one."""
    problem = reference_problem(comm, steps=2000)
    domain = problem.flexible["rod"].domain
    values = {name: problem.value(x).psi for name, x in simple_designs(domain).items()}
    assert values["solid"] == pytest.approx(PSI_FULL_ROD, rel=1e-9)
    # strip and even density beside the full rod
    assert values["strip"] / values["solid"] == pytest.approx(1.69, abs=0.02)
    assert 2.4 < values["even"] / values["solid"] < 2.7


@pytest.mark.slow
def test_frames_agree_to_first_order(comm: MPI.Intracomm) -> None:
    """Tangent and chord frame differ only by the square of the deformation."""
    domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(32, 4))
    differences = []
    for stiffer in (1.0, 10.0, 100.0):
        psi = []
        for frame in (ffr.ChordFrame("left", "right"), ffr.TangentFrame("left")):
            problem = reference_problem(comm, domain=domain, steps=8000)
            material = ffr.PlaneStress(2e9 * stiffer, 0.3, 7850.0, 0.01)
            rod = ffr.FlexibleBody(domain, material, frame=frame, modes=8)
            problem.flexible["rod"] = problem.bodies["rod"] = rod
            psi.append(problem.value(np.ones(domain.n_cells)).psi)
        differences.append(abs(psi[1] / psi[0] - 1))
    # deformation falls with the stiffness
    assert convergence_order([1.0, 0.1, 0.01], differences) > 0.9
    assert differences[-1] < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(("order", "sizes"), [(1, (4, 8, 16, 32)), (2, (2, 4, 8, 16))])
def test_mesh_refinement_of_psi(comm: MPI.Intracomm, order: int, sizes: tuple[int, ...]) -> None:
    """Psi of the full rod converges at least with order two, the limit set by the corners."""
    values = []
    for ny in sizes:
        options = {"elements": (5 * ny, ny), "order": order, "solid_columns": 0}
        domain = ffr.Domain.rectangle(comm, 0.4, 0.04, **options)
        problem = reference_problem(comm, domain=domain, steps=400)
        values.append(problem.value(np.ones(domain.n_cells)).psi)
    differences = np.abs(np.diff(values))
    fitted = convergence_order(1.0 / np.array(sizes[:-1]), differences)
    assert 1.4 < fitted < (2.2 if order == 1 else 4.2)
    assert differences[-1] / values[-1] < (5e-3 if order == 1 else 5e-4)


def double_pendulum(upper: ffr.FlexibleBody, lower: ffr.FlexibleBody) -> ffr.Problem:
    """Two links of 0.4 m that fall from the horizontal."""
    hinge = ffr.Revolute(("upper", "left"), ffr.Ground())
    mechanism = ffr.Mechanism(
        {"upper": ffr.Placement((0.0, 0.0)), "lower": ffr.Placement((0.4, 0.0))},
        [hinge, ffr.Revolute(("lower", "left"), ("upper", "right"))],
        gravity=(0.0, -9.81),
    )
    links = {"upper": upper, "lower": lower}
    return ffr.Problem(links, mechanism, ffr.GeneralizedAlpha(0.3, 300), ffr.IntegralCompliance())


def soft_link(comm: MPI.Intracomm) -> ffr.FlexibleBody:
    domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(16, 4))
    material = ffr.PlaneStress(1e9, 0.3, 1000.0, 0.01)
    return ffr.FlexibleBody(domain, material, frame=ffr.TangentFrame("left"), modes=3)


@pytest.mark.mpi
def test_one_body_under_two_names(comm: MPI.Intracomm) -> None:
    """Both links of a double pendulum are one body, each with a density of its own."""
    link = soft_link(comm)
    problem = double_pendulum(link, link)
    c = link.domain.centroids
    x = {"upper": 0.7 + 0.2 * np.sin(60 * c[:, 0]), "lower": 0.6 + 0.3 * np.cos(40 * c[:, 0])}
    early = problem.value(x)
    problem.value({"upper": x["lower"], "lower": x["upper"]})
    later, at_once = problem.differentiate(early), problem.gradient(x)
    twins = double_pendulum(soft_link(comm), soft_link(comm)).value(x)
    assert later.psi == pytest.approx(twins.psi, rel=1e-9)
    assert later.gradient is not None and at_once.gradient is not None
    direction = np.cos(50 * c[:, 0] + 1.0)
    for name, gradient in at_once.gradient.items():
        check_gradient(problem, x, {name: direction}, step=7e-4)
        slope = link.domain.sum(gradient * direction)
        total = link.domain.sum(later.gradient[name] * direction)
        assert total == pytest.approx(slope, rel=1e-8)


def test_steps_are_chosen_where_an_integrator_is_set(comm: MPI.Intracomm) -> None:
    """As where a problem is made; an objective that needs no motion leaves them open."""
    problem = reference_problem(comm, (10, 2), steps=300)
    chosen = problem.objective
    problem.objective = ffr.Mass("rod")
    problem.integrator = ffr.TimeInterval(0.4, 1e-2)
    assert isinstance(problem.integrator, ffr.TimeInterval)
    problem.objective = chosen
    assert problem.integrator.chosen_for == 1e-2
    evaluation = problem.value(np.ones(problem.flexible["rod"].domain.n_cells))
    assert evaluation.trajectory.integrator == problem.integrator


def test_few_frames_lie_in_between(comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Six each way, so that a traceback and a profile show the chain and nothing else."""
    problem = reference_problem(comm, (10, 2), steps=300)
    x, frames = np.ones(problem.flexible["rod"].domain.n_cells), {}
    call = Compiled.__call__

    def counted(self: Compiled, *arguments: Any) -> int:
        names = [frame.name for frame in traceback.extract_stack()]
        # those of the chain, and that of the call, which this function stands for
        frames[self.function.__name__] = len(names) - names.index("gradient")
        return call(self, *arguments)

    monkeypatch.setattr(Compiled, "__call__", counted)
    problem.gradient(x)
    assert frames["march"] == frames["backward"] == 6, frames


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("objective", "message"),
    [
        (ffr.IntegralCompliance(["bar"]), r"of body 'bar', but the bodies are \['rod', 'disc'\]"),
        (ffr.PathTracking("rod", "middle", (0.0, 0.0)), r"the markers of body 'rod' are \['left'"),
        (ffr.Mass("rod") + ffr.JointForce("pin"), r"the joints are \['crank pin', 'slider'\]"),
        (ffr.PeakCompliance(["disc"]), r"'disc' is rigid .* flexible bodies are \['rod'\]"),
        (2.0 * ffr.Frequency("disc"), "frequency: body 'disc' is rigid"),
        (ffr.Volume("disc"), r"volume of body 'disc', but the .*\['rod'.* Mass is similar"),
    ],
)
def test_what_does_not_fit_a_body(comm: MPI.Comm, objective: ffr.Objective, message: str) -> None:
    problem = reference_problem(comm, (10, 2), modes=2, steps=10)
    bodies = {**problem.bodies, "disc": ffr.VolumeIntegrals.rigid(1.0, (0.0, 0.0), 1e-3, {})}
    placements = {**problem.mechanism.placements, "disc": ffr.Placement()}
    mechanism = replace(problem.mechanism, placements=placements)
    bound = ffr.Constraint(objective, upper=1.0)
    for psi, bounds in ((objective, []), (ffr.IntegralCompliance(), [bound])):
        with pytest.raises(ValueError, match=message):
            ffr.Problem(bodies, mechanism, problem.integrator, psi, bounds)


def test_start_of_a_body_whose_damping_is_stiff(comm: MPI.Comm) -> None:
    """Accelerations that damping ends within a share of a step leave no trace in psi."""
    problem = reference_problem(comm, (20, 4), modes=4, steps=200)
    angle = ffr.Motion.polynomial([0.0, 10.0 * np.pi])
    damping = {"rod": ffr.RayleighDamping(beta=1e-4)}
    mechanism = slider_crank_mechanism(angle, origin=0.0, damping=damping)

    def psi(steps: int) -> float:
        method = ffr.GeneralizedAlpha(0.2, steps)
        problem_of_case = ffr.Problem(problem.bodies, mechanism, method, problem.objective)
        return problem_of_case.value(np.ones(problem_of_case.flexible["rod"].domain.n_cells)).psi

    assert psi(200) == pytest.approx(psi(1600), rel=1e-2)


@pytest.mark.mpi
def test_densities_that_leave_their_range_by_round_off(comm: MPI.Intracomm) -> None:
    """Sums of shares do: they are taken as 0 and 1, and the gradient is that at these."""
    problem = slider_crank(comm, (10, 2), modes=1, steps=100)
    n = problem.flexible["rod"].domain.n_cells
    odd = np.arange(n) % 2 == 0
    exact = problem.gradient(np.where(odd, 1.0, 0.5))
    evaluation = problem.gradient(np.where(odd, 1.0 + 1e-15, 0.5))
    assert evaluation.psi == exact.psi
    assert evaluation.gradient is not None and exact.gradient is not None
    assert np.array_equal(evaluation.gradient["rod"], exact.gradient["rod"])
    assert np.max(evaluation.bodies["rod"].density, initial=0.0) <= 1.0
    domain = problem.flexible["rod"].domain
    assert np.array_equal(domain.check_density(np.full(n, -1e-15)), np.zeros(n))
    for far in (1.0 + 1e-12, -1e-12):
        with pytest.raises(ValueError, match=r"leave \[0, 1\]; clip them"):
            problem.value(np.full(n, far))


def test_evaluations_of_other_problems_are_refused(comm: MPI.Intracomm) -> None:
    """Of other bodies of the same name and size, machines, load cases, objectives and steps."""
    problem = slider_crank(comm, (12, 3), modes=2, steps=400)
    rod, mechanism, steps = problem.flexible["rod"], problem.mechanism, problem.integrator
    evaluation = problem.value(np.ones(rod.domain.n_cells))
    arguments = problem.bodies, mechanism, steps, problem.objective
    falling = replace(mechanism, gravity=(0.0, -9.81))
    named = ffr.Mechanism({"bar": ffr.Placement()}, [ffr.Weld(("bar", "left"), ffr.Ground())])
    bound = [ffr.Constraint(ffr.Mass("rod"), upper=1.0)]
    for other, message in (
        (slider_crank(comm, (12, 3), modes=2, steps=400), "body 'rod' is not the body that was"),
        (
            ffr.Problem({"bar": rod}, named, *arguments[2:]),
            r"flexible bodies are \['rod'\], but this problem has",
        ),
        (
            ffr.Problem(arguments[0], falling, *arguments[2:]),
            "its mechanism differs",
        ),
        (
            ffr.Problem(*arguments[:2], replace(steps, end_time=1.0), arguments[3]),
            "its end time differs",
        ),
        (ffr.Problem(*arguments, bound), "its load cases and their constraints are"),
    ):
        for use in (ffr.mode_error, ffr.Problem.differentiate, ffr.Problem.time_errors):
            with pytest.raises(ValueError, match=message):
                use(other, evaluation)
        with pytest.raises(ValueError, match=r"is not the body that was|flexible bodies|its "):
            ffr.plotting.plot_scene(other, evaluation, "never.png")
    heavy = ffr.Problem(*arguments[:3], ffr.Mass("rod"))
    for other, message in (
        (heavy, "the evaluation is of another objective: psi of the evaluation is"),
        (
            ffr.Problem(*arguments[:2], replace(steps, steps=300), arguments[3]),
            "has other time steps",
        ),
    ):
        for report in (ffr.mode_error, ffr.propose_modes, ffr.model_report):
            with pytest.raises(ValueError, match=message):
                report(other, evaluation)
    other_body = slider_crank(comm, (12, 3), modes=2, steps=400).flexible["rod"]
    with pytest.raises(ValueError, match="body 'rod' is not the body that was evaluated"):
        ffr.worst_stress(other_body, evaluation, "rod")
    with pytest.raises(ValueError, match="the body is not the body that was evaluated"):
        ffr.von_mises(other_body, evaluation.bodies["rod"], np.zeros(other_body.n_elastic))


def test_results_are_shown_without_their_arrays(comm: MPI.Intracomm) -> None:
    """In Python and notebooks each is one line of numbers and names."""
    problem = slider_crank(comm, (24, 4), modes=3, steps=400)
    rod = problem.flexible["rod"]
    evaluation = problem.value(np.ones(rod.domain.n_cells))
    reduced, response = evaluation.bodies["rod"], problem.response(evaluation)
    derivatives = problem.partial_derivatives(evaluation)
    for result in (
        evaluation,
        reduced,
        reduced.integrals,
        reduced.integrals.markers["left"],
        response,
        response.densities["rod"],
        response.trajectory,
        response.trajectory.model,
        derivatives,
        derivatives.trajectory,
        ffr.worst_stress(rod, evaluation, "rod"),
    ):
        assert "\n" not in repr(result) and len(repr(result)) < 500
    text = repr(reduced.integrals)
    assert "6 elastic coordinates, in the plane, markers left, right" in text
